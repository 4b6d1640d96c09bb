//! Cube maps rasterised and projected on the GPU against the CPU's captures by rays: the same texels, so that what differs is texels
//! on edges, and, where surfaces reflect, the paths' noise.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec3;
use rigbench::candidate::{Arithmetic, GpuBench, Reading, Recipe, Surroundings, prepare_volume};
use rigbench::gpu::{CaptureShaders, CubeCapturer, Gpu};
use rigbench::light::Light;
use rigbench::math::{Rgb, Stream, StreamPurpose};
use rigbench::probe::{CaptureTask, GradientSource, ProbeDevice, Prober, Probes, depths, texels};
use rigbench::scene::{Mesh, OrientedBox, SurfacePoint};
use rigbench::sh::Window;
use rigbench::trace::{
    Bounces, Capture, CapturePlace, Effects, Reflected, Seed, TracedGeometry, TracedMaterial, Tracer, Transport,
};
use rigbench::volume::{Criterion, Evidence, Heuristic, Structure, Volume, bake};

use crate::on_gpu;
use crate::tracing::{lights, places, room, sky};

const FACE: u32 = 24;

fn lights_and_sky() -> Vec<Light<f64>> {
    lights().into_iter().chain([sky()]).collect()
}

fn capture_places() -> Vec<CapturePlace> {
    // moved a little, so that no texel's centre falls just on the edge of a light
    let place = |place: &DVec3| *place + DVec3::new(0.0123, 0.00457, -0.00789);
    places().iter().map(place).map(|place| CapturePlace { position: place, numbers_of: place }).collect()
}

fn on_the_cpu(transport: &Transport, task: CaptureTask, seed: u64) -> Vec<Capture> {
    let texels: Vec<(DVec3, f64)> =
        texels(task.face as usize).iter().map(|texel| (texel.direction, texel.solid_angle)).collect();
    let seed = Seed { seed, purpose: StreamPurpose::Test };
    transport.capture(&capture_places(), &texels, task.order, task.gradient, Reflected::Paths(task.paths), seed)
}

/// Largest difference of a coefficient, over the largest coefficient; of values, and of derivatives.
fn differences(a: &[Capture], b: &[Capture]) -> [f64; 2] {
    let mut off = [0.0f64; 2];
    for (a, b) in a.iter().zip(b) {
        let relative = |a: &[Rgb<f64>], b: &[Rgb<f64>]| {
            let largest = b.iter().fold(1e-12, |most: f64, v| most.max(v.max_abs()));
            let difference = |(a, b): (&Rgb<f64>, &Rgb<f64>)| {
                let off = (*a - *b).max_abs();
                if off.is_finite() { off / largest } else { f64::INFINITY }
            };
            a.iter().zip(b).map(difference).fold(0.0, f64::max)
        };
        off[0] = off[0].max(relative(&a.projected.value, &b.projected.value));
        if let (Some(a), Some(b)) = (&a.projected.gradient, &b.projected.gradient) {
            off[1] = off[1].max(relative(&a.concat(), &b.concat()));
        }
    }
    off
}

fn task(order: usize, face: u32, paths: u32) -> CaptureTask {
    CaptureTask { face, paths, order, gradient: true }
}

fn rasterised(gpu: &Gpu, transport: &Transport, task: CaptureTask, shaders: CaptureShaders) -> Vec<Capture> {
    CubeCapturer::with_shaders(gpu, transport, 7, shaders).unwrap().capture(&capture_places(), task).unwrap()
}

/// Of values and derivatives, worst first. Where only lights are seen, rounding: a light's silhouette, where derivatives go with 1/cos,
/// loses digits. Where triangles are, texels on edges too, which the rasteriser rounds to 1/256 of a texel: one or two of 3456,
/// each up to 2e-3 of the whole where the panel or a lamp is seen or not.
fn agree([value, slope]: [f64; 2], edges: bool) -> bool {
    if edges { value < 8e-3 && slope < 4e-2 } else { value < 2e-5 && slope < 2e-3 }
}

#[test]
fn lights_in_texels_are_those_of_the_cpu() {
    on_gpu("lights_in_texels_are_those_of_the_cpu", |gpu| {
        let tracer = Tracer::new(&TracedGeometry::default());
        let mut wrong = Vec::new();
        for light in lights_and_sky() {
            let own = [light];
            let transport = Transport::new(&tracer, &own, Effects::NONE);
            let task = task(4, FACE, 1);
            let (cpu, device) =
                (on_the_cpu(&transport, task, 1), rasterised(gpu, &transport, task, CaptureShaders::OWN));
            let off = differences(&device, &cpu);
            println!("{}: {:e}, derivatives {:e}", own[0].kind_name(), off[0], off[1]);
            if !agree(off, false) {
                wrong.push((own[0].kind_name(), off));
            }
        }
        assert!(wrong.is_empty(), "{wrong:?}");
        // where texels meet a map
        let (sky, own) = ([sky()], CaptureShaders::OWN);
        let transport = Transport::new(&tracer, &sky, Effects::NONE);
        let task = task(4, FACE, 1);
        let cpu = on_the_cpu(&transport, task, 1);
        for (right, wrong) in [
            ("atan2(d.x, -d.z) / (2.0 * PI) + 0.5", "atan2(d.x, d.z) / (2.0 * PI) + 0.5"),
            ("atan2(length(d.xz), d.y) / PI", "atan2(length(d.xz), -d.y) / PI"),
            ("texel.y * size.x + texel.x", "texel.y * size.x"),
        ] {
            let broken = own.shade.replacen(right, wrong, 1);
            assert_ne!(broken, own.shade, "`{right}` is not in the shader");
            let shaders = CaptureShaders { shade: &broken, ..own };
            let off = differences(&rasterised(gpu, &transport, task, shaders), &cpu);
            assert!(!agree(off, false), "`{wrong}` passes with {off:?}");
        }
    });
}

#[test]
fn captures_rasterised_on_the_gpu_are_those_of_the_cpu() {
    on_gpu("captures_rasterised_on_the_gpu_are_those_of_the_cpu", |gpu| {
        let (tracer, lights) = (Tracer::new(&room()), lights_and_sky());
        for effects in [Effects::NONE, Effects::SHADOWS, Effects::bounces(Bounces::Count(0))] {
            let transport = Transport::new(&tracer, &lights, effects);
            let capturer = CubeCapturer::new(gpu, &transport, 7).unwrap();
            for order in 1..=6 {
                let task = task(order, FACE, 4);
                let (cpu, device) =
                    (on_the_cpu(&transport, task, 1), capturer.capture(&capture_places(), task).unwrap());
                let off = differences(&device, &cpu);
                println!("{effects}, order {order}: {:e}, derivatives {:e}", off[0], off[1]);
                assert!(agree(off, effects != Effects::NONE), "{effects}, order {order}: {off:?}");
                for (device, cpu) in device.iter().zip(&cpu) {
                    assert_eq!(device.counters.texels, cpu.counters.texels);
                    assert_eq!(device.counters.draws, 6);
                    let terms = [device.counters.gradient_terms, cpu.counters.gradient_terms];
                    assert!(terms[0].abs_diff(terms[1]) < 20, "{effects}: {terms:?}");
                    if effects != Effects::NONE {
                        let [own, other] = [device.depths, cpu.depths];
                        assert!((own.harmonic_mean / other.harmonic_mean - 1.0).abs() < 5e-3, "{own:?} {other:?}");
                        assert!((own.minimum / other.minimum - 1.0).abs() < 1e-4, "{own:?} for {other:?}");
                        assert!((own.behind - other.behind).abs() < 2e-3, "{own:?} for {other:?}");
                    } else {
                        assert!(device.depths.minimum.is_infinite() && device.depths.harmonic_mean.is_infinite());
                    }
                }
            }
        }
        // wrong in one place each
        let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(0)));
        let task = task(3, FACE, 1);
        let cpu = on_the_cpu(&transport, task, 1);
        let own = CaptureShaders::OWN;
        let broken = |text: &str, right: &str, wrong: &str| {
            let broken = text.replacen(right, wrong, 1);
            assert_ne!(broken, text, "`{right}` is not in the shader");
            broken
        };
        for (right, wrong) in [("face_axes(view.face)", "face_axes(view.face ^ 1u)"), ("-along.y", "along.y")] {
            let text = broken(own.rasterise, right, wrong);
            let off = differences(&rasterised(gpu, &transport, task, CaptureShaders { rasterise: &text, ..own }), &cpu);
            assert!(!agree(off, true), "`{wrong}` passes with {off:?}");
        }
        for (right, wrong) in [
            ("let solid_angle = solid_angles[texel];", "let solid_angle = 4.0 * PI / f32(6u * job.face * job.face);"),
            ("(3.0 * direction + normal", "(2.0 * direction + normal"),
            ("shadows && within < met.distance", "false && within < met.distance"),
            ("second <= 0.0", "false"),
            ("2.0 * direction / distance", "direction / distance"),
            ("angle * length(side) / area", "angle * length(side) / area * 0.8"),
        ] {
            let text = broken(own.shade, right, wrong);
            let off = differences(&rasterised(gpu, &transport, task, CaptureShaders { shade: &text, ..own }), &cpu);
            assert!(!agree(off, true), "`{wrong}` passes with {off:?}");
        }
        for (right, wrong) in
            [("- rows[at + 2u].xyz * slopes", "+ rows[at + 2u].xyz * slopes"), ("+= part(", "= part(")]
        {
            let text = broken(own.project, right, wrong);
            let off = differences(&rasterised(gpu, &transport, task, CaptureShaders { project: &text, ..own }), &cpu);
            assert!(!agree(off, true), "`{wrong}` passes with {off:?}");
        }
    });
}

#[test]
fn captured_furnaces_on_the_gpu_are_exact_whatever_the_face() {
    on_gpu("captured_furnaces_on_the_gpu_are_exact_whatever_the_face", |gpu| {
        let mut furnace = TracedGeometry::default();
        let material = TracedMaterial { albedo: Rgb::splat(0.5), emission: Rgb::splat(1.0) };
        for (out, u, v) in
            [(DVec3::X, DVec3::Y, DVec3::Z), (DVec3::Y, DVec3::Z, DVec3::X), (DVec3::Z, DVec3::X, DVec3::Y)]
        {
            furnace.add_quad(material, out, v, u);
            furnace.add_quad(material, -out, u, v);
        }
        let tracer = Tracer::new(&furnace);
        let places = [DVec3::new(0.3, -0.2, 0.5), DVec3::new(-0.9, 0.8, 0.1)];
        let places: Vec<CapturePlace> =
            places.iter().map(|place| CapturePlace { position: *place, numbers_of: *place }).collect();
        for (effects, expected, tolerance) in [
            (Effects::bounces(Bounces::Count(0)), 1.0, 1e-6),
            // 32 paths a texel of 384: about 0.5 % of noise
            (Effects::bounces(Bounces::Infinite), 2.0, 0.02),
        ] {
            let transport = Transport::new(&tracer, &[], effects);
            let capturer = CubeCapturer::new(gpu, &transport, 3).unwrap();
            for face in [4, 8, 31] {
                let task = CaptureTask { face, paths: 32, order: 1, gradient: false };
                for capture in capturer.capture(&places, task).unwrap() {
                    let found = capture.projected.value[0].g / (4.0 * PI).sqrt();
                    assert!((found - expected).abs() < tolerance * expected, "{effects}, {face}: {found}");
                }
            }
        }
    });
}

/// Root mean square, over all coefficients, of what `a` has more than `without` beyond what `b` has: what surfaces reflect, as texels on
/// the edges of lights see them or not on both sides.
fn reflections_apart(a: [&[Capture]; 2], b: [&[Capture]; 2]) -> f64 {
    let flat = |captures: &[Capture]| -> Vec<Rgb<f64>> {
        captures.iter().flat_map(|capture| capture.projected.value.iter().copied()).collect()
    };
    let [a, a0, b, b0] = [a[0], a[1], b[0], b[1]].map(flat);
    let squares: Vec<f64> = (0..a.len()).map(|i| ((a[i] - a0[i]) - (b[i] - b0[i])).max_abs().powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn what_captured_surfaces_reflect_agrees_within_its_noise() {
    on_gpu("what_captured_surfaces_reflect_agrees_within_its_noise", |gpu| {
        let (tracer, lights) = (Tracer::new(&room()), lights());
        let task = task(3, 12, 8);
        let direct = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(0)));
        let cpu_direct = on_the_cpu(&direct, task, 1);
        let device_direct = rasterised(gpu, &direct, task, CaptureShaders::OWN);
        for effects in [Effects::bounces(Bounces::Count(1)), Effects::bounces(Bounces::Infinite)] {
            let transport = Transport::new(&tracer, &lights, effects);
            let cpu: Vec<Vec<Capture>> = (1..=4).map(|seed| on_the_cpu(&transport, task, seed)).collect();
            let device = |shade: &str| -> Vec<Vec<Capture>> {
                let shaders = CaptureShaders { shade, ..CaptureShaders::OWN };
                let take = |seed| {
                    let capturer = CubeCapturer::with_shaders(gpu, &transport, seed, shaders).unwrap();
                    capturer.capture(&capture_places(), CaptureTask { paths: 32, ..task }).unwrap()
                };
                (1..=2).map(take).collect()
            };
            // mean square of what two captures differ by
            let between = |a: &[Capture], a0: &[Capture], b: &[Capture], b0: &[Capture]| {
                reflections_apart([a, a0], [b, b0]).powi(2)
            };
            let own = device(CaptureShaders::OWN.shade);
            // 8 paths a texel here and 32 there: each has its own noise
            let noise = 0.5
                * (between(&cpu[0], &cpu_direct, &cpu[1], &cpu_direct)
                    + between(&own[0], &device_direct, &own[1], &device_direct));
            let apart = |device: &[Vec<Capture>]| -> f64 {
                let all = device.iter().flat_map(|d| cpu.iter().map(move |c| (d, c)));
                all.map(|(d, c)| between(d, &device_direct, c, &cpu_direct)).sum::<f64>() / 8.0
            };
            println!("{effects}: {:e} apart, noise {noise:e}", apart(&own));
            assert!(apart(&own) < 2.0 * noise, "{effects}: {:e} for {noise:e}", apart(&own));
            assert!(own[0][0].counters.shadow_rays > 0);
            let broken = device(&CaptureShaders::OWN.shade.replace("+= reflected(s) /", "+= 0.9 * reflected(s) /"));
            println!("ten percent less: {:e}", apart(&broken));
            assert!(apart(&broken) > 2.0 * noise, "{:e} for {noise:e}", apart(&broken));
        }
    });
}

#[test]
fn depths_rasterised_are_those_of_rays() {
    on_gpu("depths_rasterised_are_those_of_rays", |gpu| {
        let (tracer, lights) = (Tracer::new(&room()), lights());
        let transport = Transport::new(&tracer, &lights, Effects::SHADOWS);
        let device = CubeCapturer::new(gpu, &transport, 1).unwrap();
        // many places, more than one batch of faces
        let mut stream = Stream::indexed(4, StreamPurpose::Test, 9);
        let places: Vec<DVec3> = (0..60)
            .map(|_| DVec3::from_array([1.9, 1.4, 2.4].map(|half| half * stream.uniform_between(-1.0, 1.0))))
            .collect();
        let texels = texels(12);
        for (place, (found, seen)) in places.iter().zip(device.depths(&places, 12).unwrap()) {
            let mut expected_seen = Vec::new();
            let expected = depths(&tracer, *place, &texels, |world| expected_seen.push(world));
            assert!((found.harmonic_mean / expected.harmonic_mean - 1.0).abs() < 0.02, "{found:?} for {expected:?}");
            assert!((found.minimum / expected.minimum - 1.0).abs() < 0.01, "{found:?} for {expected:?}");
            assert!((found.behind - expected.behind).abs() < 0.01, "{found:?} for {expected:?}");
            assert!(seen.len().abs_diff(expected_seen.len()) < 8);
        }
    });
}

fn bounds() -> OrientedBox {
    OrientedBox::aligned(DVec3::new(-1.9, -1.4, -2.4), DVec3::new(1.9, 1.4, 2.4))
}

/// Cells that one of two volumes has and the other has not, over those of both.
fn apart(a: &[[[f64; 3]; 2]], b: &[[[f64; 3]; 2]]) -> f64 {
    let alone = |a: &[[[f64; 3]; 2]], b: &[[[f64; 3]; 2]]| a.iter().filter(|cell| !b.contains(cell)).count();
    (alone(a, b) + alone(b, a)) as f64 / (a.len() + b.len()) as f64
}

#[test]
fn heuristics_from_captured_depths_divide_alike_on_both() {
    on_gpu("heuristics_from_captured_depths_divide_alike_on_both", |gpu| {
        let (tracer, lights) = (Tracer::new(&room()), lights());
        let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(0)));
        let device = CubeCapturer::new(gpu, &transport, 1).unwrap();
        let mut sizes = Vec::new();
        for criterion in [
            Criterion::ContainsGeometry { from: Evidence::Depth },
            Criterion::HarmonicMean { threshold: 0.5, minimum: true },
            Criterion::HarmonicMean { threshold: 0.5, minimum: false },
        ] {
            let table =
                "octree = { bounds = \"room\", min_level = 0, max_level = 2, roots = [2, 1, 2], repair = true }";
            let mut volume = Volume::inline(table).unwrap();
            if let Structure::Octree { heuristic, .. } = &mut volume.structure {
                *heuristic = Heuristic { any: vec![criterion] };
            }
            let baked = |on_gpu: bool| {
                let prober = Prober {
                    bounds: bounds(),
                    order: 2,
                    lights: &lights,
                    transport: Some(&transport),
                    device: Some(&device),
                    probes: Probes::Captured { face: 8, paths: 1, seed: 1, on_gpu },
                    gradients: GradientSource::Analytic,
                    window: Window::None,
                };
                bake(&volume, &prober).unwrap()
            };
            let (cpu, device) = (baked(false), baked(true));
            // a cell whose depths lie at the threshold may go either way
            let cells = apart(&cpu.cell_boxes(), &device.cell_boxes());
            println!("{criterion:?}: {} cells, {cells} of them apart", cpu.cell_boxes().len());
            assert!(cells < 0.03, "{criterion:?}: {cells} of the cells");
            assert!(cpu.cell_boxes().len() > 20 && cpu.counts.rays.draws == 0 && device.counts.rays.draws > 0);
            assert_eq!(device.counts.rays.closest_rays, 0);
            sizes.push(cpu.cell_boxes().len());
        }
        assert!(sizes[1] > sizes[2], "the least depth divides more: {sizes:?}");
    });
}

#[test]
fn cells_and_vertices_on_the_gpu_are_those_of_the_cpu() {
    on_gpu("cells_and_vertices_on_the_gpu_are_those_of_the_cpu", |gpu| {
        let bench = GpuBench::new(gpu.clone());
        let (tracer, lights) = (Tracer::new(&room()), lights());
        let transport = Transport::new(&tracer, &lights, Effects::SHADOWS);
        let prober = Prober {
            bounds: bounds(),
            order: 3,
            lights: &lights,
            transport: Some(&transport),
            device: None,
            probes: Probes::Analytic,
            gradients: GradientSource::Analytic,
            window: Window::None,
        };
        let mut stream = Stream::indexed(8, StreamPurpose::Test, 2);
        let anywhere: Vec<SurfacePoint> = (0..400)
            .map(|_| {
                let q = bounds().half.map(|half| half * stream.uniform_between(-1.0, 1.0));
                SurfacePoint { position: bounds().world(q), normal: stream.direction() }
            })
            .collect();
        let mesh = Mesh {
            positions: [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|corner| 0.7 * corner - 0.4).to_vec(),
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            normals: vec![[DVec3::Y; 3]; 4],
        };
        let on_mesh: Vec<SurfacePoint> = (0..100)
            .map(|k| SurfacePoint {
                normal: stream.direction(),
                ..mesh.point(k % 4, 0.6 * stream.uniform(), 0.4 * stream.uniform())
            })
            .collect();
        let around = Surroundings { bounds: bounds(), lights: &lights, wrap: 0.0, transport: None };
        let schemes = ["nearest", "inverse_distance", "trilinear", "gradient_corrected", "half_gradient", "tricubic"];
        let grid = |rest: &str| format!("grid = {{ bounds = \"room\", samples = [4, 3, 5], {rest} }}");
        let two = |rest: &str| format!("two_level = {{ bounds = \"room\", samples = [4, 3, 5], inner = 2, {rest} }}");
        let tree = |rest: &str| {
            format!(
                "octree = {{ bounds = \"room\", min_level = 1, max_level = 3, heuristic = \"contains_geometry\", {rest} }}"
            )
        };
        let mut tables: Vec<String> = Vec::new();
        for scheme in schemes {
            let interpolation = format!("interpolation = \"{scheme}\"");
            tables.extend([grid(&interpolation), two(&interpolation)]);
            tables.push(tree(&format!("{interpolation}, across = \"naive\"")));
        }
        tables.extend(["trilinear", "half_gradient", "tricubic"].map(|s| tree(&format!("interpolation = \"{s}\""))));
        tables.push(two("interpolation = \"inverse_distance\", power = 2.5"));
        for lookup in ["per_vertex", "per_object"] {
            let lookup = format!("lookup = \"{lookup}\"");
            tables.extend([grid(&lookup), two(&lookup), tree(&lookup)]);
        }
        for table in &tables {
            let baked = Arc::new(bake(&Volume::inline(table).unwrap(), &prober).unwrap());
            let reading = Reading { mesh: Some(&mesh), ..Reading::default() };
            let points = if table.contains("per_vertex") { &on_mesh } else { &anywhere };
            let with = |arithmetic: Arithmetic| {
                let lit = prepare_volume(&baked, arithmetic, &around, reading, Some(&bench))
                    .unwrap_or_else(|error| panic!("{table}: {error}"));
                lit.irradiance(points).unwrap()
            };
            let (cpu, device) = (with(Arithmetic::CpuF32), with(Arithmetic::GpuBuffer));
            let mean = cpu.iter().map(|e| e.max_abs()).sum::<f64>() / cpu.len() as f64;
            let off: Vec<f64> = cpu.iter().zip(&device).map(|(a, b)| (*a - *b).max_abs() / mean).collect();
            let worst = off.iter().fold(0.0f64, |most, off| most.max(*off));
            // weights differ by roundings of coordinates within a cell
            assert!(worst < 2e-4, "{table}: {worst:e}");
            let texture = Recipe { volume: Some(baked.clone()), ..Recipe::new(None, 3, Arithmetic::GpuTexture) };
            let texture = rigbench::candidate::prepare(&texture, &around, Some(&bench));
            if table.starts_with("grid") && table.contains("\"trilinear\"") {
                // 8-bit filter weights over three axes, 16-bit floats: stated for lattices, of which a grid is one
                let filtered = texture.unwrap().irradiance(points).unwrap();
                let off = cpu.iter().zip(&filtered).map(|(a, b)| (*a - *b).max_abs() / mean).fold(0.0, f64::max);
                println!("a volume texture: {off:e}");
                assert!(off > 1e-6 && off < 0.03, "{table}: {off:e}");
            } else if table.starts_with("grid") && table.contains("interpolation") {
                assert!(texture.err().is_some_and(|error| error.to_string().contains("trilinear")), "{table}");
            }
        }
    });
}
