//! The lights' WGSL twins against Rust, one function at a time and summed over every light at every point.

use rigbench::gpu::{DirectEvaluator, Gpu, ShaderText, WgslExpression};
use rigbench::light::{
    self, Constant, Directional, Light, LightRows, LightShape, Point, Sphere, lights_wgsl, shader_kinds,
};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::rig::LocalPoints;
use rigbench::sh::Lobe;

use crate::evaluation::broken_texts;
use crate::on_gpu;

/// A sphere light and the normal of a receiver at the origin.
struct SphereCase {
    center: Vector3<f32>,
    radius: f32,
    n: Vector3<f32>,
}

/// Stratified over distance (from the surface itself to 1e6 radii) and the angle of the normal, denser about the horizon.
fn sphere_cases() -> Vec<SphereCase> {
    let mut stream = Stream::indexed(41, StreamPurpose::Test, 0);
    let mut cases = Vec::new();
    for step in 0..40 {
        // distance over radius, 1 + 1e-7 to 1e6
        let ratio = 1.0 + 10f64.powf(-7.0 + 13.0 * f64::from(step) / 39.0);
        for k in 0..24 {
            let towards = stream.direction();
            let sine = 1.0 / ratio;
            // k below 12: evenly in the cosine; above: within twice the cap of the horizon
            let facing =
                if k < 12 { (2.0 * f64::from(k) + 1.0) / 12.0 - 1.0 } else { sine * (f64::from(k) - 17.5) / 3.0 };
            let facing = facing.clamp(-1.0, 1.0);
            let across = Vector3::<f64>::of(towards).frame().0.to_double();
            let n = (towards * facing + across * (1.0 - facing * facing).sqrt()).normalize();
            let radius = 10f64.powf(stream.uniform_between(-2.0, 1.0));
            cases.push(SphereCase {
                center: Vector3::of(towards * (ratio * radius)),
                radius: radius as f32,
                n: Vector3::of(n),
            });
        }
    }
    // inside, at the centre, on the surface, grazing
    for (center, n) in
        [([0.5, 0.0, 0.0], [0.0, 1.0, 0.0]), ([0.0; 3], [0.0, 0.0, 1.0]), ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])]
    {
        cases.push(SphereCase { center: Vector3::from_array(center), radius: 1.0, n: Vector3::from_array(n) });
    }
    cases
}

/// Largest difference of the sphere's twin from Rust, in units of the tolerance.
///
/// Tolerance: 4e-6 of pi s^2 (c + 0.1) with c the largest (wrapped) cosine of a direction in the cap: 32 roundings of what the cap
/// can give at most, and of the cosine's own rounding, which counts most where the cap is almost below the horizon.
fn sphere_disagreement(gpu: &Gpu, model: &str, lobe: &Lobe<f32>) -> f64 {
    let cases = sphere_cases();
    let rows: Vec<f32> =
        cases.iter().flat_map(|c| [c.center.to_array(), [c.radius, 0.0, 0.0], c.n.to_array()].concat()).collect();
    let got = WgslExpression {
        functions: ShaderText::new().with(model),
        body: "output(0u, sphere_irradiance(input_vec3(0u), input(3u), vec3f(0.0), input_vec3(6u)));",
        inputs: 9,
        outputs: 1,
    }
    .run(gpu, &rows)
    .unwrap();
    let off = cases.iter().zip(got).map(|(case, got)| {
        let light = Sphere { center: case.center, radius: case.radius, radiance: Rgb::splat(1.0) };
        let expected = light.irradiance(Vector3::zero(), case.n, lobe).value.r;
        let distance = case.center.length();
        let s = (case.radius / distance).min(1.0);
        let facing = if distance > 0.0 { case.n.dot(case.center) / distance } else { 1.0 };
        let wrap = lobe.wrap();
        let most = ((facing + s + wrap) / (1.0 + wrap)).clamp(0.0, 1.0).powf(1.0 + wrap);
        let tolerance = 4e-6 * std::f32::consts::PI * s * s * (most + 0.1);
        let difference = (got - expected).abs();
        if difference.is_finite() { f64::from(difference / tolerance) } else { f64::INFINITY }
    });
    off.fold(0.0, f64::max)
}

#[test]
fn the_sphere_agrees_with_its_wgsl_twin() {
    on_gpu("the_sphere_agrees_with_its_wgsl_twin", |gpu| {
        for wrap in [0.0, 0.3, 1.0] {
            let lobe = Lobe::new(wrap);
            let off = sphere_disagreement(gpu, &lights_wgsl(&["sphere"], &lobe), &lobe);
            println!("wrap {wrap}: {off} of the tolerance");
            assert!(off <= 1.0, "wrap {wrap}: {off} times the tolerance");
        }
    });
}

#[test]
fn a_changed_constant_of_the_sphere_is_noticed() {
    on_gpu("a_changed_constant_of_the_sphere_is_noticed", |gpu| {
        for wrap in [0.0, 0.3] {
            let lobe = Lobe::new(wrap);
            let text = lights_wgsl(&["sphere"], &lobe);
            for line in [
                "const PI",
                "const ATAN_0",
                "const ATAN_1",
                "const SIN_0",
                "const LOBE_INTEGRAL",
                "const WRAP",
                "const LOBE_FOOT",
            ] {
                let used = if wrap == 0.0 { ["PI", "ATAN", "INTEGRAL"] } else { ["SIN", "WRAP", "INTEGRAL"] };
                if !used.iter().any(|name| line.contains(name)) {
                    continue;
                }
                let start = text.find(line).unwrap();
                let end = start + text[start..].find('\n').unwrap();
                let (_, wrong) = broken_texts(&text[start..end]).pop().unwrap();
                let wrong = format!("{}{wrong}{}", &text[..start], &text[end..]);
                let off = sphere_disagreement(gpu, &wrong, &lobe);
                assert!(off > 1.0, "{line} was changed by a thousandth and nobody noticed: {off}");
            }
        }
        // numbers of the closed form itself
        let lobe = Lobe::lambert();
        let text = lights_wgsl(&["sphere"], &lobe);
        for (right, wrong) in [
            ("1.0 / 5.0", "1.0 / 5.1"),
            ("rest = z * s * s", "rest = z * s"),
            ("-x * tau", "-tau"),
            ("(1.0 + s)", "(1.0 - s)"),
        ] {
            let broken = text.replace(right, wrong);
            assert_ne!(broken, text, "{right} is not in the shader");
            let off = sphere_disagreement(gpu, &broken, &lobe);
            assert!(off > 1.0, "{wrong} in place of {right} went unnoticed: {off}");
        }
    });
}

/// Lights of every kind that has a twin, several of each, in no order of kinds.
fn every_kind() -> Vec<Light<f32>> {
    let colour = |r, g, b| Rgb::new(r, g, b);
    let mut stream = Stream::indexed(42, StreamPurpose::Test, 0);
    let mut lights = Vec::new();
    for _ in 0..3 {
        let mut place = || Vector3::<f32>::of(stream.direction() * stream.uniform_between(2.0, 6.0));
        lights.push(Light::Point(Point { position: place(), intensity: colour(3.0, 2.0, 1.0) }));
        lights.push(Light::Sphere(Sphere { center: place(), radius: 0.7, radiance: colour(1.0, 0.5, 4.0) }));
        lights.push(Light::Directional(Directional {
            towards: place().normalized().unwrap(),
            irradiance: colour(0.2, 0.1, 0.3),
        }));
        lights.push(Light::Constant(Constant { radiance: colour(0.1, 0.0, 0.05) }));
    }
    lights
}

fn points() -> LocalPoints<f32> {
    let mut stream = Stream::indexed(43, StreamPurpose::Test, 0);
    let mut points = LocalPoints::default();
    for _ in 0..300 {
        points.push(stream.direction() * stream.uniform_between(0.0, 1.5), stream.direction());
    }
    points
}

/// Largest difference of E from Rust over all points; relative to the mean of E.
fn direct_difference(gpu: &Gpu, lights: &[Light<f32>], model: &str, lobe: &Lobe<f32>) -> f32 {
    let points = points();
    let got = DirectEvaluator::with_model(gpu, lights, model).unwrap().evaluate(lights, &points).unwrap();
    let expected: Vec<_> =
        (0..points.len()).map(|i| light::irradiance(lights, points.q(i), points.n(i), lobe).value).collect();
    let mean = expected.iter().map(|e| e.max_abs()).sum::<f32>() / points.len() as f32;
    let off = got.iter().zip(&expected).map(|(got, e)| {
        let off = (*got - *e).max_abs() / mean;
        if off.is_finite() { off } else { f32::INFINITY }
    });
    off.fold(0.0, f32::max)
}

/// The lights' own tolerance, and the other order of summing a dozen lights.
const DIRECT_TOLERANCE: f32 = 4e-6;

#[test]
fn every_light_at_every_point_is_what_rust_sums() {
    on_gpu("every_light_at_every_point_is_what_rust_sums", |gpu| {
        let lights = every_kind();
        let kinds = LightRows::new(&lights).unwrap().kinds;
        assert_eq!(kinds, shader_kinds().collect::<Vec<_>>(), "every kind with a twin is tested");
        for wrap in [0.0, 0.5] {
            let lobe = Lobe::new(wrap);
            let right = lights_wgsl(&kinds, &lobe);
            let off = direct_difference(gpu, &lights, &right, &lobe);
            println!("wrap {wrap}: {off:e}");
            assert!(off < DIRECT_TOLERANCE, "wrap {wrap}: {off}");
            // each kind alone, and left out
            for kind in &kinds {
                let alone: Vec<_> = lights.iter().filter(|light| light.kind_name() == *kind).cloned().collect();
                let off = direct_difference(gpu, &alone, &lights_wgsl(&[kind], &lobe), &lobe);
                assert!(off < DIRECT_TOLERANCE, "{kind}, wrap {wrap}: {off}");
                let without = right.replacen(&format!("sum += {kind}_light(row, p, n)"), "sum += vec3f(0.0)", 1);
                assert_ne!(without, right);
                assert!(direct_difference(gpu, &lights, &without, &lobe) > 1e-3, "nobody missed the {kind} lights");
            }
        }
        // no light at all
        let none = DirectEvaluator::new(gpu, &[], &Lobe::lambert()).unwrap().evaluate(&[], &points()).unwrap();
        assert!(none.iter().all(|e| *e == Rgb::zero()));
    });
}

#[test]
fn touching_tiny_and_huge_lights_stay_finite() {
    on_gpu("touching_tiny_and_huge_lights_stay_finite", |gpu| {
        let grey = Rgb::splat(1.0);
        let at = Vector3::<f32>::new(0.25, -0.5, 0.125);
        let mut lights = Vec::new();
        for offset in [0.0, 1e-38, 1e-20, 1e-7, 1.0, 1e12, 1e20, 3e38] {
            let position = at + Vector3::new(offset, 0.0, 0.0);
            lights.push(Light::Point(Point { position, intensity: grey }));
            for radius in [1e-30, 1e-7, 1.0, 1e19, 1e38] {
                lights.push(Light::Sphere(Sphere { center: position, radius, radiance: grey }));
            }
        }
        let mut points = LocalPoints::default();
        for n in [glam::DVec3::X, -glam::DVec3::X, glam::DVec3::Y] {
            points.push(at.to_double(), n);
        }
        for wrap in [0.0, 1.0] {
            let lobe = Lobe::new(wrap);
            let of_kind = |sphere: bool| lights.iter().filter(move |light| matches!(light, Light::Sphere(_)) == sphere);
            let evaluators = [false, true]
                .map(|sphere| DirectEvaluator::new(gpu, &of_kind(sphere).cloned().collect::<Vec<_>>(), &lobe).unwrap());
            for light in &lights {
                let evaluator = &evaluators[usize::from(matches!(light, Light::Sphere(_)))];
                let lights = std::slice::from_ref(light);
                let got = evaluator.evaluate(lights, &points).unwrap();
                for (i, e) in got.iter().enumerate() {
                    let expected = light::irradiance(lights, points.q(i), points.n(i), &lobe).value;
                    assert!(e.is_finite(), "{light:?}, wrap {wrap}, point {i}: {e:?}");
                    // 2e-4: beside the surface E depends on the root of the distance's rounding
                    let off = (*e - expected).max_abs() / expected.max_abs().max(1e-30);
                    assert!(off < 2e-4, "{light:?}, wrap {wrap}, point {i}: {e:?} for {expected:?}");
                }
            }
        }
    });
}
