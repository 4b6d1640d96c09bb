//! The lights' WGSL twins against Rust, one function at a time and summed over every light at every point.

use rigbench::gpu::{DirectEvaluator, Gpu, ShaderText, WgslExpression};
use rigbench::light::{
    self, Constant, Directional, Disk, Light, LightModel, LightRows, LightShape, ModelledLight, Point, Polygon, Rect,
    ShaderLight, Sphere, Tube, lights_wgsl, model_kinds, shader_kinds,
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

/// A disk light and the normal of a receiver at the origin.
struct DiskCase {
    light: Disk<f32>,
    n: Vector3<f32>,
}

/// Stratified over the distance (0.01 to 1e5 radii) and the direction from which the disk is seen, and over the normal, denser
/// where the horizon cuts the disk; then on the axis, beside the rim and grazing.
fn disk_cases() -> Vec<DiskCase> {
    let mut stream = Stream::indexed(44, StreamPurpose::Test, 0);
    let mut cases = Vec::new();
    let mut push = |place: glam::DVec3, m: glam::DVec3, radius: f64, n: glam::DVec3| {
        let light = Disk {
            center: Vector3::of(place),
            normal: Vector3::of(m),
            radius: radius as f32,
            radiance: Rgb::splat(1.0),
        };
        cases.push(DiskCase { light, n: Vector3::of(n) });
    };
    for step in 0..36 {
        let ratio = 10f64.powf(-2.0 + 7.0 * f64::from(step) / 35.0);
        for k in 0..40 {
            let m = stream.direction();
            let mut towards = stream.direction();
            if towards.dot(m) > 0.0 {
                towards = -towards;
            }
            let radius = 10f64.powf(stream.uniform_between(-2.0, 1.0));
            let place = towards * (ratio * radius);
            let mut n = stream.direction();
            if k >= 20 {
                // towards a point near the disk's edge the cosine is about 0
                let at = place + m.cross(stream.direction()) * (radius * stream.uniform_between(0.0, 1.5));
                n = (n - at * (n.dot(at) / at.length_squared())).normalize();
            }
            push(place, m, radius, n);
        }
    }
    for height in [1e-3, 0.5, 1.0, 30.0, 1e4] {
        for n in [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8], [0.8, 0.0, -0.6], [0.0, 1.0, 1e-4]] {
            let n = glam::DVec3::from_array(n).normalize();
            for offset in [0.0, 0.5, 1.0, 1.001, 3.0] {
                push(glam::DVec3::new(offset, 0.0, height), -glam::DVec3::Z, 1.0, n);
            }
        }
    }
    // behind and in the plane
    push(glam::DVec3::new(0.2, 0.0, 1.0), glam::DVec3::Z, 1.0, glam::DVec3::Z);
    push(glam::DVec3::new(0.2, 0.0, 0.0), glam::DVec3::Z, 1.0, glam::DVec3::Z);
    cases
}

/// Largest difference of the disk's twin from Rust, and of Rust in f32 from f64, relative to what a disk of this size at this
/// distance can give at most.
fn disk_disagreement(gpu: &Gpu, model: &str) -> (f64, f64) {
    let cases = disk_cases();
    let rows: Vec<f32> = cases
        .iter()
        .flat_map(|c| {
            [c.light.center.to_array(), [c.light.radius, 0.0, 0.0], c.light.normal.to_array(), c.n.to_array()].concat()
        })
        .collect();
    let got = WgslExpression {
        functions: ShaderText::new().with(model),
        body: "output(0u, disk_irradiance(input_vec3(0u), input(3u), input_vec3(6u), vec3f(0.0), input_vec3(9u)));",
        inputs: 12,
        outputs: 1,
    }
    .run(gpu, &rows)
    .unwrap();
    let of = |v: Vector3<f32>| Vector3::<f64>::of(v.to_double());
    let mut worst = (0.0f64, 0.0f64);
    for (case, got) in cases.iter().zip(got) {
        let light = &case.light;
        let rust = light.irradiance(Vector3::zero(), case.n, &Lobe::lambert()).value.r;
        let exact = Disk {
            center: of(light.center),
            normal: of(light.normal),
            radius: f64::from(light.radius),
            radiance: Rgb::splat(1.0),
        };
        let truth = exact.irradiance(Vector3::zero(), of(case.n), &Lobe::lambert()).value.r;
        // what the disk can give to any receiver here: at most pi, and its area over the squared distance
        let distance = of(light.center).length();
        let scale = std::f64::consts::PI * (exact.radius * exact.radius / (distance * distance)).min(1.0);
        let error =
            |e: f32, truth: f64| if e.is_finite() { (f64::from(e) - truth).abs() / scale } else { f64::INFINITY };
        worst = (worst.0.max(error(got, f64::from(rust))), worst.1.max(error(rust, truth)));
    }
    worst
}

/// The closed form itself is only good to this in f32 where the horizon cuts the disk: arc and chord cancel there.
/// A twin adds no more than that.
const DISK_TOLERANCE: f64 = 5e-5;

#[test]
fn the_disk_agrees_with_its_wgsl_twin() {
    on_gpu("the_disk_agrees_with_its_wgsl_twin", |gpu| {
        let right = lights_wgsl(&["disk"], &Lobe::lambert());
        let (twin, single) = disk_disagreement(gpu, &right);
        println!("disk: twin {twin:e}, f32 against f64 {single:e}");
        assert!(twin < DISK_TOLERANCE && single < DISK_TOLERANCE, "{twin:e} {single:e}");
        for (right_part, wrong) in [
            ("const PI: f32 = 3.1415927f", "const PI: f32 = 3.142f"),
            ("(2.0 * rho * h * nu - w * nm)", "(2.0 * rho * h * nu + w * nm)"),
            ("nm * ((rho - radius) * (rho + radius) + h * h)", "nm * ((rho - radius) * (rho + radius) - h * h)"),
            ("cube * 2.0 / 3.0", "cube * 2.0 / 3.1"),
            ("a.x * first + a.y * second", "a.x * first - a.y * second"),
            ("turns * PI", "0.0 * turns"),
            ("a.z * log(", "0.999 * a.z * log("),
            ("1.0 / 3.0 + s * (1.0 / 5.0", "1.0 / 3.1 + s * (1.0 / 5.0"),
            ("radius < 0.02 *", "radius < 0.2 *"),
        ] {
            let broken = right.replacen(right_part, wrong, 1);
            assert_ne!(broken, right, "{right_part} is not in the shader");
            let (off, _) = disk_disagreement(gpu, &broken);
            assert!(off > DISK_TOLERANCE, "{wrong} in place of {right_part} went unnoticed: {off:e}");
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
        // tilted away from the origin
        let center = place();
        let normal = (place() * 0.2 - center).normalized().unwrap();
        lights.push(Light::Disk(Disk { center, normal, radius: 0.9, radiance: colour(2.0, 3.0, 1.0) }));
        // as corners with their far side towards the origin
        let corners = [[-0.8, -0.5], [0.9, -0.4], [1.0, 0.6], [-0.2, 0.9], [-0.9, 0.3]];
        let (middle, aside) = (place().to_double(), place().to_double());
        let facing = (aside * 0.2 - middle).normalize();
        let x = facing.any_orthonormal_vector();
        let y = facing.cross(x);
        let vertices: Vec<_> = corners.iter().map(|c| middle + x * c[0] + y * c[1]).collect();
        let radiance = Rgb::new(1.0, 2.0, 0.5);
        lights.push(Light::Polygon(Polygon::new(&vertices, radiance).unwrap().relative_to(glam::DVec3::ZERO)));
        lights.push(Light::Rect(Rect::new(middle, x * 0.5, y * 1.5, radiance).unwrap().relative_to(glam::DVec3::ZERO)));
        lights.push(Light::Tube(Tube { from: place(), to: place(), intensity: colour(2.0, 1.0, 0.5) }));
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
fn direct_difference<L>(gpu: &Gpu, lights: &[L], model: &str, lobe: &Lobe<f32>) -> f32
where
    L: LightShape<f32> + ShaderLight + Clone + Send + 'static,
{
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

/// The lights' own tolerance (a disk's where there are flat ones), and the other order of summing a dozen lights.
fn direct_tolerance(kinds: &[&str]) -> f32 {
    if ["disk", "rect", "polygon"].iter().any(|flat| kinds.contains(flat)) { DISK_TOLERANCE as f32 } else { 4e-6 }
}

#[test]
fn every_light_at_every_point_is_what_rust_sums() {
    on_gpu("every_light_at_every_point_is_what_rust_sums", |gpu| {
        for wrap in [0.0, 0.5] {
            let lobe = Lobe::new(wrap);
            let mut lights = every_kind();
            lights.retain(|light| shader_kinds(&lobe).any(|kind| kind == light.kind_name()));
            let kinds = LightRows::new(&lights).unwrap().kinds;
            assert_eq!(kinds, shader_kinds(&lobe).collect::<Vec<_>>(), "every kind with a twin is tested");
            let right = lights_wgsl(&kinds, &lobe);
            let off = direct_difference(gpu, &lights, &right, &lobe);
            println!("wrap {wrap}: {off:e}");
            assert!(off < direct_tolerance(&kinds), "wrap {wrap}: {off}");
            // each kind alone, and left out
            for kind in &kinds {
                let alone: Vec<_> = lights.iter().filter(|light| light.kind_name() == *kind).cloned().collect();
                let off = direct_difference(gpu, &alone, &lights_wgsl(&[kind], &lobe), &lobe);
                assert!(off < direct_tolerance(&[kind]), "{kind}, wrap {wrap}: {off}");
                let without = right.replacen(&format!("sum += {kind}_light(row, p, n)"), "sum += vec3f(0.0)", 1);
                assert_ne!(without, right);
                assert!(direct_difference(gpu, &lights, &without, &lobe) > 1e-3, "nobody missed the {kind} lights");
            }
        }
        // no light at all
        let no_lights: &[Light<f32>] = &[];
        let none =
            DirectEvaluator::new(gpu, no_lights, &Lobe::lambert()).unwrap().evaluate(no_lights, &points()).unwrap();
        assert!(none.iter().all(|e| *e == Rgb::zero()));
    });
}

#[test]
fn every_formula_is_what_rust_answers() {
    on_gpu("every_formula_is_what_rust_answers", |gpu| {
        for wrap in [0.0, 0.5] {
            let lobe = Lobe::new(wrap);
            let mut lights: Vec<ModelledLight<f32>> = Vec::new();
            for word in LightModel::words() {
                let model = LightModel::named(word).unwrap();
                lights.extend(every_kind().into_iter().map(|light| model.light(light, light::DIRECT_ORDER)));
            }
            lights.retain(|light| model_kinds(&lobe).any(|kind| kind == light.kind_name()));
            let kinds = LightRows::new(&lights).unwrap().kinds;
            assert_eq!(kinds, model_kinds(&lobe).collect::<Vec<_>>(), "every formula with a twin is tested");
            let right = lights_wgsl(&kinds, &lobe);
            let off = direct_difference(gpu, &lights, &right, &lobe);
            println!("wrap {wrap}: {off:e}");
            assert!(off < DISK_TOLERANCE as f32, "wrap {wrap}: {off}");
            for kind in &kinds {
                let alone: Vec<_> = lights.iter().filter(|light| light.kind_name() == *kind).cloned().collect();
                let off = direct_difference(gpu, &alone, &lights_wgsl(&[kind], &lobe), &lobe);
                println!("{kind}: {off:e}");
                assert!(off < DISK_TOLERANCE as f32, "{kind}, wrap {wrap}: {off}");
                let without = right.replacen(&format!("sum += {kind}_light(row, p, n)"), "sum += vec3f(0.0)", 1);
                assert_ne!(without, right);
                assert!(direct_difference(gpu, &lights, &without, &lobe) > 1e-3, "nobody missed {kind}");
            }
        }
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

/// Polygons that a facet's twin must bear: a sliver, a triangle, a square, a dodecagon.
fn facets() -> Vec<Polygon<f64>> {
    let ring = |count: usize, squeeze: f64| -> Vec<glam::DVec3> {
        (0..count)
            .map(|k| std::f64::consts::TAU * k as f64 / count as f64)
            .map(|t| glam::DVec3::new(t.cos(), squeeze * t.sin(), 0.0))
            .collect()
    };
    [(3, 0.01), (3, 1.0), (4, 1.0), (12, 0.7)]
        .map(|(count, squeeze)| Polygon::new(&ring(count, squeeze), Rgb::splat(1.0)).unwrap())
        .to_vec()
}

/// Largest difference of the polygons' twin from Rust, relative to what a disk of that extent can give at most.
fn facet_disagreement(gpu: &Gpu, change: impl Fn(String) -> String) -> (f64, f64) {
    let mut stream = Stream::indexed(45, StreamPurpose::Test, 0);
    let mut points = LocalPoints::<f32>::default();
    for step in 0..30 {
        let distance = 10f64.powf(-2.0 + 5.0 * f64::from(step) / 29.0);
        for k in 0..30 {
            let p = stream.direction() * distance;
            let mut n = stream.direction();
            if k >= 15 {
                // the horizon runs through the polygon
                let at =
                    glam::DVec3::new(stream.uniform_between(-1.0, 1.0), stream.uniform_between(-1.0, 1.0), 0.0) - p;
                n = (n - at * (n.dot(at) / at.length_squared())).normalize();
            }
            points.push(p, n);
        }
    }
    let lobe = Lobe::lambert();
    let mut worst = (0.0f64, 0.0f64);
    for polygon in facets() {
        let light = Light::Polygon(polygon.relative_to(glam::DVec3::ZERO));
        let double: Light<f64> = Light::Polygon(polygon);
        let lights = std::slice::from_ref(&light);
        let model = change(lights_wgsl(&["polygon"], &lobe));
        let got = DirectEvaluator::with_model(gpu, lights, &model).unwrap().evaluate(lights, &points).unwrap();
        for (i, got) in got.iter().enumerate() {
            let (p, n) = (points.q(i), points.n(i));
            let rust = light.irradiance(p, n, &lobe).value.r;
            let truth =
                double.irradiance(Vector3::of(p.to_double()), Vector3::of(n.to_double()), &Lobe::lambert()).value.r;
            let scale = std::f64::consts::PI / p.to_double().length_squared().max(1.0);
            let error =
                |e: f32, truth: f64| if e.is_finite() { (f64::from(e) - truth).abs() / scale } else { f64::INFINITY };
            worst = (worst.0.max(error(got.r, f64::from(rust))), worst.1.max(error(rust, truth)));
        }
    }
    worst
}

#[test]
fn the_polygon_agrees_with_its_wgsl_twin() {
    on_gpu("the_polygon_agrees_with_its_wgsl_twin", |gpu| {
        let (twin, single) = facet_disagreement(gpu, |text| text);
        println!("polygon: twin {twin:e}, f32 against f64 {single:e}");
        // as for the disk: the sides' terms cancel to what is seen of the polygon
        assert!(twin < DISK_TOLERANCE && single < DISK_TOLERANCE, "{twin:e} {single:e}");
        for (right, wrong) in [
            ("leaves = a + rest", "leaves = a + along"),
            ("sum += select(angle, -angle, sine < 0.0)", "sum += 0.0"),
            ("facing_a / (facing_a - facing_b));\n                leaves", "0.9);\n                leaves"),
            ("thrice * 0.5 *", "thrice * 0.501 *"),
            ("found >= 2u", "found >= 3u"),
            ("-0.5 * sum", "-0.4995 * sum"),
        ] {
            let (off, _) = facet_disagreement(gpu, |text| {
                let broken = text.replacen(right, wrong, 1);
                assert_ne!(broken, text, "{right} is not in the shader");
                broken
            });
            assert!(off > DISK_TOLERANCE, "{wrong} in place of {right} went unnoticed: {off:e}");
        }
    });
}

#[test]
fn the_tube_agrees_with_its_wgsl_twin() {
    on_gpu("the_tube_agrees_with_its_wgsl_twin", |gpu| {
        let mut stream = Stream::indexed(46, StreamPurpose::Test, 0);
        let mut cases = Vec::new();
        for step in 0..40 {
            let length = 10f64.powf(-3.0 + 5.0 * f64::from(step) / 39.0);
            for _ in 0..25 {
                let from = stream.direction() * stream.uniform_between(0.01, 2.0);
                cases.push((from, from + stream.direction() * length, stream.direction()));
            }
        }
        // passing by closely, in line with the point, through the horizon at the point's own height
        for (from, to) in [
            ([-1.0, 0.0, 1e-3], [1.0, 0.0, 1e-3]),
            ([0.0, 0.0, 0.5], [0.0, 0.0, 2.0]),
            ([-1.0, 0.0, -0.5], [1.0, 0.0, 0.5]),
        ] {
            cases.push((glam::DVec3::from_array(from), glam::DVec3::from_array(to), glam::DVec3::Z));
        }
        let cases: Vec<[Vector3<f32>; 3]> = cases.into_iter().map(|(a, b, n)| [a, b, n].map(Vector3::of)).collect();
        let rows: Vec<f32> = cases.iter().flatten().flat_map(|v| v.to_array()).collect();
        let disagreement = |model: &str| {
            let got = WgslExpression {
                functions: ShaderText::new().with(model),
                body: "output(0u, tube_irradiance(input_vec3(0u), input_vec3(3u), input_vec3(6u)));",
                inputs: 9,
                outputs: 1,
            }
            .run(gpu, &rows)
            .unwrap();
            let off = cases.iter().zip(got).map(|([from, to, n], got)| {
                let tube = Tube { from: *from, to: *to, intensity: Rgb::splat(1.0) };
                let expected = tube.irradiance(Vector3::zero(), *n, &Lobe::lambert()).value.r;
                // its length over the least squared distance bounds what it gives; so does 2 over that distance
                let side = *to - *from;
                let along = (-from.dot(side) / side.length_squared()).clamp(0.0, 1.0);
                let nearest = (*from + side * along).length();
                let scale = (side.length() / nearest).min(2.0) / nearest;
                let off = (got - expected).abs() / scale;
                if off.is_finite() { off } else { f32::INFINITY }
            });
            off.fold(0.0, f32::max)
        };
        let right = lights_wgsl(&["tube"], &Lobe::lambert());
        let off = disagreement(&right);
        println!("tube: {off:e}");
        assert!(off < TUBE_TOLERANCE, "{off:e}");
        for (right_part, wrong) in [
            ("phase - 0.5 * PI", "phase - 0.499 * PI"),
            ("phase + 0.5 * PI", "phase + 0.501 * PI"),
            ("size * 2.0", "size * 2.001"),
            ("let across = dot", "let across = 0.999 * dot"),
        ] {
            let broken = right.replacen(right_part, wrong, 1);
            assert_ne!(broken, right, "{right_part} is not in the shader");
            let off = disagreement(&broken);
            assert!(off > TUBE_TOLERANCE, "{wrong} in place of {right_part} went unnoticed: {off:e}");
        }
    });
}

/// Some 30 roundings: the divisor's cross product of nearly parallel vectors loses most.
const TUBE_TOLERANCE: f32 = 4e-6;
