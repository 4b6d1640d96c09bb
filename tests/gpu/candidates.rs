//! Whole candidates, set up as a run sets them up: the GPU's irradiance against the CPU's.

use rigbench::candidate::{Arithmetic, GpuBench, Recipe, Surroundings, prepare};
use rigbench::light::{Directional, Disk, Light, Point, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::rig::{AnyRig, catalogue};
use rigbench::scene::{OrientedBox, SurfacePoint};

use crate::on_gpu;

/// A turned box far from the world's origin, as a receiver's is.
fn bounds() -> OrientedBox {
    let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 1.1);
    OrientedBox {
        center: glam::DVec3::new(120.0, -35.0, 60.0),
        axes: [turn * glam::DVec3::X, turn * glam::DVec3::Y, turn * glam::DVec3::Z],
        half: [1.5, 0.5, 0.8],
    }
}

fn lights() -> Vec<Light<f64>> {
    let center = bounds().center;
    let at = |x: f64, y: f64, z: f64| Vector3::of(center + glam::DVec3::new(x, y, z));
    vec![
        Light::Sphere(Sphere { center: at(3.0, 2.0, 1.0), radius: 0.5, radiance: Rgb::new(10.0, 8.0, 6.0) }),
        Light::Point(Point { position: at(-2.0, 3.0, 2.5), intensity: Rgb::new(2.0, 5.0, 9.0) }),
        Light::Disk(Disk {
            center: at(0.0, -4.0, 0.5),
            normal: Vector3::new(0.0, 1.0, 0.0),
            radius: 1.0,
            radiance: Rgb::splat(4.0),
        }),
        Light::Directional(Directional { towards: Vector3::new(0.0, 0.6, -0.8), irradiance: Rgb::splat(0.7) }),
    ]
}

fn points() -> Vec<SurfacePoint> {
    let (bounds, mut stream) = (bounds(), Stream::indexed(51, StreamPurpose::Test, 0));
    (0..500)
        .map(|_| {
            let q = bounds.half.map(|h| h * stream.uniform_between(-1.0, 1.0));
            SurfacePoint { position: bounds.world(q), normal: stream.direction() }
        })
        .collect()
}

fn irradiance(rig: Option<&AnyRig>, arithmetic: Arithmetic, bench: Option<&GpuBench>) -> Result<Vec<Rgb<f64>>, String> {
    let recipe = Recipe::new(rig.cloned(), 3, arithmetic);
    let lights = lights();
    let around = Surroundings { bounds: bounds(), lights: &lights, wrap: 0.0, transport: None };
    let lit = prepare(&recipe, &around, bench).map_err(|error| error.to_string())?;
    lit.irradiance(&points()).map_err(|error| error.to_string())
}

/// Largest difference over the mean.
fn difference(a: &[Rgb<f64>], b: &[Rgb<f64>]) -> f64 {
    let mean = b.iter().map(|e| e.max_abs()).sum::<f64>() / b.len() as f64;
    a.iter().zip(b).map(|(a, b)| (*a - *b).max_abs() / mean).fold(0.0, f64::max)
}

#[test]
fn candidates_on_the_gpu_are_those_of_the_cpu() {
    on_gpu("candidates_on_the_gpu_are_those_of_the_cpu", |gpu| {
        let bench = GpuBench::new(gpu.clone());
        let rigs = [
            "constant = {}",
            "gradient = {}",
            "lattice = { samples = [3, 2, 2] }",
            "mixed = { x = { lattice = 3 }, y = \"constant\", z = \"gradient\" }",
        ];
        let rigs: Vec<AnyRig> = rigs.iter().map(|text| AnyRig::inline(text).unwrap()).collect();
        for rig in std::iter::once(None).chain(rigs.iter().map(Some)) {
            let cpu = irradiance(rig, Arithmetic::CpuF32, None).unwrap();
            let buffer = irradiance(rig, Arithmetic::GpuBuffer, Some(&bench)).unwrap();
            // the twins' own tolerances, of which the disk's is the largest
            let off = difference(&buffer, &cpu);
            assert!(off < 2e-5, "{rig:?}: {off:e}");
        }
    });
}

#[test]
fn only_trilinear_lattices_have_textures() {
    on_gpu("only_trilinear_lattices_have_textures", |gpu| {
        let bench = GpuBench::new(gpu.clone());
        let mut textures = 0;
        for entry in catalogue() {
            let trilinear = entry.text.starts_with("lattice") && !entry.text.contains("interpolation");
            match irradiance(Some(&entry.rig), Arithmetic::GpuTexture, Some(&bench)) {
                Ok(texture) => {
                    assert!(trilinear, "{} has no trilinear filter", entry.text);
                    let cpu = irradiance(Some(&entry.rig), Arithmetic::CpuF32, None).unwrap();
                    // 8-bit filter weights and 16-bit floats: a hundredth of the mean where neighbours differ by as much
                    let off = difference(&texture, &cpu);
                    assert!(off < 1e-2, "{}: {off:e}", entry.text);
                    textures += 1;
                }
                Err(message) => assert!(!trilinear && message.contains("trilinear"), "{}: {message}", entry.text),
            }
        }
        assert!(textures >= 4, "{textures}");
    });
}

#[test]
fn volumes_on_the_gpu_are_those_of_the_cpu() {
    use rigbench::probe::{GradientSource, Prober, Probes};
    use rigbench::sh::Window;
    use rigbench::volume::{Volume, bake};
    on_gpu("volumes_on_the_gpu_are_those_of_the_cpu", |gpu| {
        let bench = GpuBench::new(gpu.clone());
        let lights = lights();
        let prober = Prober {
            bounds: bounds(),
            order: 3,
            lights: &lights,
            transport: None,
            device: None,
            probes: Probes::Analytic,
            gradients: GradientSource::Analytic,
            window: Window::None,
        };
        let around = Surroundings { bounds: bounds(), lights: &lights, wrap: 0.0, transport: None };
        let octree = |rest: &str| {
            format!("octree = {{ bounds = \"room\", min_level = 0, max_level = 4, heuristic = \"error\", {rest} }}")
        };
        let tables = [
            "grid = { bounds = \"room\", samples = [4, 3, 5], interpolation = \"half_gradient\" }".to_owned(),
            "grid = { bounds = \"room\", samples = [4, 3, 5], lookup = \"per_object\" }".to_owned(),
            octree("interpolation = \"trilinear\", across = \"naive\""),
            octree("interpolation = \"trilinear\""),
            octree("interpolation = \"gradient_corrected\", roots = [2, 1, 1]"),
            octree("interpolation = \"half_gradient\""),
            octree("interpolation = \"tricubic\""),
        ];
        for table in &tables {
            let baked = std::sync::Arc::new(bake(&Volume::inline(table).unwrap(), &prober).unwrap());
            let with = |arithmetic: Arithmetic| {
                let recipe = Recipe { volume: Some(baked.clone()), ..Recipe::new(None, 3, arithmetic) };
                prepare(&recipe, &around, Some(&bench))
                    .map_err(|e| e.to_string())?
                    .irradiance(&points())
                    .map_err(|e| e.to_string())
            };
            let (cpu, device) = (with(Arithmetic::CpuF32).unwrap(), with(Arithmetic::GpuBuffer).unwrap());
            // weights differ by roundings of coordinates within a cell, a few hundred-thousandths of its values
            let off = difference(&device, &cpu);
            assert!(off < 5e-5, "{table}: {off:e}");
            if table.starts_with("grid") {
                assert_eq!(with(Arithmetic::GpuTexture).is_ok(), table.contains("per_object"), "{table}");
            }
        }
    });
}
