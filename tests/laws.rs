//! Laws that every candidate obeys, from lights to irradiance: each over the whole catalogue of rigs, each with a planted wrong
//! variant that it must reject.

use std::f64::consts::PI;

use glam::{DAffine3, DQuat, DVec3};
use rigbench::candidate::{Arithmetic, Lit, Recipe, Surroundings, prepare};
use rigbench::light::{self, Constant, Light, Point, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3, gauss_legendre};
use rigbench::reference;
use rigbench::rig::AnyRig;
use rigbench::rig::catalogue;
use rigbench::scene::{OrientedBox, SurfacePoint};
use rigbench::sh::Lobe;

fn recipe(rig: Option<&AnyRig>, order: usize, arithmetic: Arithmetic) -> Recipe {
    Recipe::new(rig.cloned(), order, arithmetic)
}

fn sphere(center: [f64; 3], radius: f64, radiance: [f64; 3]) -> Light<f64> {
    Light::Sphere(Sphere { center: Vector3::from_array(center), radius, radiance: Rgb::of(radiance) })
}

fn lamps() -> Vec<Light<f64>> {
    vec![
        sphere([2.0, 1.5, -0.5], 0.4, [5.0, 4.0, 3.0]),
        sphere([-1.8, 0.3, 1.9], 0.3, [1.0, 6.0, 2.0]),
        Light::Point(Point { position: Vector3::new(0.2, -2.5, 0.7), intensity: Rgb::of([2.0, 0.5, 4.0]) }),
    ]
}

/// A box that is turned against the world's axes.
fn turned_box() -> OrientedBox {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 0.2);
    OrientedBox {
        center: DVec3::new(0.1, -0.05, 0.02),
        axes: [turn * DVec3::X, turn * DVec3::Y, turn * DVec3::Z],
        half: [0.9, 0.4, 0.25],
    }
}

fn points(bounds: &OrientedBox, count: usize) -> Vec<SurfacePoint> {
    let mut stream = Stream::indexed(11, StreamPurpose::Test, 0);
    (0..count)
        .map(|_| {
            let q = std::array::from_fn(|axis| bounds.half[axis] * stream.uniform_between(-1.0, 1.0));
            SurfacePoint { position: bounds.world(q), normal: stream.direction() }
        })
        .collect()
}

fn lit(rig: Option<&AnyRig>, order: usize, bounds: OrientedBox, lights: &[Light<f64>], wrap: f64) -> Box<dyn Lit> {
    let around = Surroundings { bounds, lights, wrap, transport: None };
    prepare(&recipe(rig, order, Arithmetic::CpuF64), &around, None).expect("the CPU can")
}

fn values(
    rig: Option<&AnyRig>,
    order: usize,
    bounds: OrientedBox,
    lights: &[Light<f64>],
    wrap: f64,
    points: &[SurfacePoint],
) -> Vec<Rgb<f64>> {
    lit(rig, order, bounds, lights, wrap).irradiance(points).expect("the CPU can")
}

/// Largest difference over the largest value of `expected`.
fn apart(got: &[Rgb<f64>], expected: &[Rgb<f64>]) -> f64 {
    let largest = expected.iter().map(|v| v.max_abs()).fold(1e-300, f64::max);
    got.iter().zip(expected).map(|(g, e)| (*g - *e).max_abs() / largest).fold(0.0, f64::max)
}

/// Every rig of the catalogue, and `direct`.
fn everyone() -> Vec<(String, Option<AnyRig>)> {
    let mut all = vec![("direct".to_owned(), None)];
    all.extend(catalogue().into_iter().map(|entry| (entry.text.to_owned(), Some(entry.rig))));
    assert!(all.len() > 20, "the catalogue was not found");
    all
}

#[test]
fn constant_light_gives_a0_times_its_radiance() {
    let radiance = [0.7, 1.3, 2.9];
    let constant = |scale: f64| vec![Light::Constant(Constant { radiance: Rgb::of(radiance.map(|r| r * scale)) })];
    let bounds = turned_box();
    let points = points(&bounds, 40);
    for wrap in [0.0, 0.35, 1.0] {
        let factor = 2.0 * PI * (1.0 + wrap) / (2.0 + wrap);
        let expected = vec![Rgb::of(radiance.map(|r| r * factor)); points.len()];
        for (name, rig) in everyone() {
            for order in 1..=6 {
                let got = values(rig.as_ref(), order, bounds, &constant(1.0), wrap, &points);
                assert!(
                    apart(&got, &expected) < 1e-9,
                    "{name}, order {order}, wrap {wrap}: {:e}",
                    apart(&got, &expected)
                );
            }
        }
    }
    let planted = values(None, 3, bounds, &constant(1.01), 0.0, &points);
    assert!(apart(&planted, &vec![Rgb::of(radiance.map(|r| r * PI)); points.len()]) > 5e-3, "1 % must be seen");
}

#[test]
fn the_mean_over_normals_is_a_share_of_all_light() {
    // product rule of 24 x 48 normals; clamped lobes are not polynomials, so `direct` is left to the lights' own laws
    let rule = gauss_legendre(12);
    let bounds = turned_box();
    let lights = lamps();
    for wrap in [0.0, 0.5] {
        let bands = Lobe::<f64>::new(wrap);
        let a0 = bands.bands()[0];
        for (name, rig) in everyone().into_iter().filter(|(_, rig)| rig.is_some()) {
            let q = [0.3, -0.2, 0.1];
            let mut normals = Vec::new();
            let mut weights = Vec::new();
            for (z, weight) in rule.nodes.iter().zip(&rule.weights) {
                for k in 0..12 {
                    let phi = 2.0 * PI * (k as f64 + 0.5) / 12.0;
                    let r = (1.0 - z * z).sqrt();
                    let normal = DVec3::new(r * phi.cos(), r * phi.sin(), *z);
                    normals.push(SurfacePoint { position: bounds.world(q), normal });
                    weights.push(weight / 24.0);
                }
            }
            let mean = |order: usize| {
                let e = values(rig.as_ref(), order, bounds, &lights, wrap, &normals);
                e.iter().zip(&weights).fold(Rgb::zero(), |sum, (e, w)| sum + *e * *w)
            };
            // order 1 is that mean: degree 0 alone, E = A_0 L_0 Y_0 at every normal
            let zeroth = values(rig.as_ref(), 1, bounds, &lights, wrap, &normals[..1])[0];
            let got = mean(6);
            assert!((got - zeroth).max_abs() < 1e-10 * zeroth.max_abs(), "{name}, wrap {wrap}: {got:?} for {zeroth:?}");
            // 2/sqrt(pi), the well-known mix-up of normalisations, must be seen
            assert!((got * (2.0 / PI.sqrt()) - zeroth).max_abs() > 0.1 * zeroth.max_abs());
        }
        // of the lights themselves: A_0 / 4 pi times the integral of L, which is L_0 sqrt(4 pi)
        let p = Vector3::of(bounds.center);
        let all = light::projection::<f64, 1>(&lights, p).value[0] * (4.0 * PI).sqrt();
        let constant = AnyRig::inline("constant = {}").unwrap();
        let at_centre = [SurfacePoint { position: bounds.center, normal: DVec3::Y }];
        let zeroth = values(Some(&constant), 1, bounds, &lights, wrap, &at_centre)[0];
        assert!((zeroth - all * (a0 / (4.0 * PI))).max_abs() < 1e-12 * zeroth.max_abs());
    }
}

#[test]
fn irradiance_is_linear_in_the_lights() {
    let bounds = turned_box();
    let points = points(&bounds, 60);
    let lights = lamps();
    for (name, rig) in everyone() {
        let together = values(rig.as_ref(), 3, bounds, &lights, 0.2, &points);
        let mut sum = vec![Rgb::zero(); points.len()];
        for light in &lights {
            let one = values(rig.as_ref(), 3, bounds, std::slice::from_ref(light), 0.2, &points);
            sum.iter_mut().zip(one).for_each(|(s, e)| *s += e);
        }
        assert!(apart(&together, &sum) < 1e-9, "{name}: {:e}", apart(&together, &sum));
        // one light counted twice must be seen
        let one = values(rig.as_ref(), 3, bounds, &lights[..1], 0.2, &points);
        sum.iter_mut().zip(one).for_each(|(s, e)| *s += e);
        assert!(apart(&together, &sum) > 1e-2, "{name}");
    }
}

#[test]
fn turning_object_and_lights_together_turns_the_answer() {
    let bounds = turned_box();
    let points = points(&bounds, 60);
    let motion = DAffine3::from_rotation_translation(
        DQuat::from_euler(glam::EulerRot::ZYX, 0.9, 0.3, -1.1),
        DVec3::new(0.5, -2.0, 1.0),
    );
    let moved_box = OrientedBox {
        center: motion.transform_point3(bounds.center),
        axes: bounds.axes.map(|axis| motion.transform_vector3(axis)),
        half: bounds.half,
    };
    let moved = |points: &[SurfacePoint]| -> Vec<SurfacePoint> {
        points
            .iter()
            .map(|p| SurfacePoint {
                position: motion.transform_point3(p.position),
                normal: motion.transform_vector3(p.normal),
            })
            .collect()
    };
    let lights = lamps();
    let moved_lights: Vec<Light<f64>> = lights.iter().map(|light| light.transformed(&motion)).collect();
    for (name, rig) in everyone() {
        for order in [2, 3, 5] {
            let before = values(rig.as_ref(), order, bounds, &lights, 0.0, &points);
            let after = values(rig.as_ref(), order, moved_box, &moved_lights, 0.0, &moved(&points));
            assert!(apart(&after, &before) < 1e-8, "{name}, order {order}: {:e}", apart(&after, &before));
        }
        // lights that stay behind must be seen
        let wrong = values(rig.as_ref(), 3, moved_box, &lights, 0.0, &moved(&points));
        assert!(apart(&wrong, &values(rig.as_ref(), 3, bounds, &lights, 0.0, &points)) > 1e-2, "{name}");
    }
}

#[test]
fn a_lattice_is_exact_at_its_samples() {
    let bounds = turned_box();
    let lights = lamps();
    let mut stream = Stream::indexed(12, StreamPurpose::Test, 0);
    for interpolation in ["nearest", "inverse_distance", "trilinear", "gradient_corrected", "half_gradient", "tricubic"]
    {
        let rig = AnyRig::inline(&format!("lattice = {{ samples = [3, 2, 2], interpolation = \"{interpolation}\" }}"))
            .unwrap();
        let corner =
            |i: f64, j: f64, k: f64| bounds.world([(i - 1.0) * bounds.half[0], j * bounds.half[1], k * bounds.half[2]]);
        for (i, j, k) in [(0.0, -1.0, -1.0), (1.0, 1.0, -1.0), (2.0, -1.0, 1.0)] {
            let at = |position: DVec3, normal| SurfacePoint { position, normal };
            let normal = stream.direction();
            let sample = at(corner(i, j, k), normal);
            let exact = reference::truncated(&lights, &[sample], &Lobe::lambert(), &[3]).remove(0);
            let got = values(Some(&rig), 3, bounds, &lights, 0.0, &[sample]);
            assert!(apart(&got, &exact) < 1e-10, "{interpolation} at ({i}, {j}, {k}): {:e}", apart(&got, &exact));
            // half way to the next sample it must not be
            if interpolation == "nearest" || interpolation == "trilinear" {
                let between = at(sample.position + bounds.axes[1] * (-j * bounds.half[1]), normal);
                let exact = reference::truncated(&lights, &[between], &Lobe::lambert(), &[3]).remove(0);
                assert!(
                    apart(&values(Some(&rig), 3, bounds, &lights, 0.0, &[between]), &exact) > 1e-3,
                    "{interpolation}"
                );
            }
        }
    }
}

#[test]
fn single_precision_follows_double() {
    let bounds = turned_box();
    let points = points(&bounds, 200);
    let lights = lamps();
    for (name, rig) in everyone() {
        let around = Surroundings { bounds, lights: &lights, wrap: 0.3, transport: None };
        let of = |arithmetic| {
            prepare(&recipe(rig.as_ref(), 5, arithmetic), &around, None).unwrap().irradiance(&points).unwrap()
        };
        let difference = apart(&of(Arithmetic::CpuF32), &of(Arithmetic::CpuF64));
        // kernels whose weights are large and of both signs lose more: RBF
        let tolerance = if name.starts_with("rbf") { 2e-3 } else { 1e-5 };
        assert!(difference < tolerance, "{name}: {difference:e}");
        assert!(difference > 0.0, "{name}: f32 is no f32");
    }
}

#[test]
fn the_same_bits_at_one_and_two_threads() {
    let bounds = turned_box();
    let points = points(&bounds, 3000);
    let lights = lamps();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let lobe = Lobe::<f64>::lambert();
            let exact = reference::exact(&lights, &points, &lobe, DVec3::ZERO).irradiance;
            let truncated = reference::truncated(&lights, &points, &lobe, &[3, 5]);
            (exact, truncated, values(None, 3, bounds, &lights, 0.0, &points))
        })
    };
    let (one, two) = (on(1), on(2));
    assert!(one == two);
    assert!(one.0 != one.1[0], "exact and truncated are not the same thing");
}

#[test]
fn nothing_is_ever_not_a_number() {
    let bounds = turned_box();
    let points = points(&bounds, 50);
    let surface = bounds.world([bounds.half[0], 0.0, 0.0]);
    let cases: Vec<(&str, Vec<Light<f64>>)> = vec![
        ("no light", vec![]),
        ("black", vec![sphere([2.0, 0.0, 0.0], 0.5, [0.0; 3])]),
        ("tiny", vec![sphere([2.0, 0.0, 0.0], 1e-6, [1e-8; 3])]),
        ("huge", vec![sphere([2.0, 0.0, 0.0], 0.5, [1e8; 3])]),
        ("touching", vec![sphere((surface + bounds.axes[0] * 0.5).to_array(), 0.5, [1.0; 3])]),
        ("around", vec![sphere(bounds.center.to_array(), 5.0, [1.0; 3])]),
        (
            "a point light at a sample",
            vec![Light::Point(Point { position: Vector3::of(bounds.center), intensity: Rgb::splat(1.0) })],
        ),
    ];
    for (name, rig) in everyone() {
        for (case, lights) in &cases {
            for arithmetic in [Arithmetic::CpuF32, Arithmetic::CpuF64] {
                let around = Surroundings { bounds, lights, wrap: 0.0, transport: None };
                let lit = prepare(&recipe(rig.as_ref(), 6, arithmetic), &around, None).unwrap();
                let values = lit.irradiance(&points).unwrap();
                assert!(values.iter().all(|v| v.is_finite()), "{name}, {case}, {arithmetic:?}");
            }
        }
    }
    // the check sees a value that is not finite
    assert!(![Rgb::splat(1.0), Rgb::new(0.0, f64::NAN, 0.0)].iter().all(|v: &Rgb<f64>| v.is_finite()));
}
