//! Laws that every registered light shape keeps.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use rigbench::light::{
    Constant, Directional, Disk, Environment, EnvironmentMap, Light, LightShape, Point, Polygon, Rect, ShGradient,
    Sphere, Term, Tube,
};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3, gauss_legendre};
use rigbench::sh::{Lobe, Rotation, basis, convolve, spread};
use serde_json::Value;

type V = Vector3<f64>;

fn stream(index: u64) -> Stream {
    Stream::indexed(12, StreamPurpose::Test, index)
}

fn case(name: &str) -> Value {
    let path = format!("{}/tests/cases/{name}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn vector(value: &Value) -> V {
    let v = numbers(value);
    V::new(v[0], v[1], v[2])
}

/// Five irregular corners in a plane through (-0.6, 0.2, -0.5), lit towards the origin.
fn pentagon() -> Vec<DVec3> {
    let m = DVec3::new(0.6, -0.3, 0.5).normalize();
    let u = m.any_orthonormal_vector();
    let v = m.cross(u);
    [(0.5, 0.0), (0.2, 0.4), (-0.3, 0.35), (-0.45, -0.1), (0.1, -0.5)]
        .map(|(x, y)| DVec3::new(-0.6, 0.2, -0.5) + u * x + v * y)
        .into()
}

/// A small map: a broad glow over a ground.
fn sky() -> EnvironmentMap {
    let (width, height) = (48, 24);
    let texel = |k: usize| {
        let (u, v) = ((k % width) as f32 / width as f32, (k / width) as f32 / height as f32);
        let glow = (-8.0 * ((u - 0.3).powi(2) + (v - 0.35).powi(2))).exp();
        [0.2 + 3.0 * glow, 0.3 + 2.0 * glow, 0.5 + glow * v]
    };
    EnvironmentMap::new(width, height, (0..width * height).map(texel).collect()).unwrap()
}

/// One light of each kind, about a metre from the origin, all of which light it.
fn every_kind() -> Vec<Light<f64>> {
    let radiance = Rgb::new(3.0, 2.0, 0.5);
    let lights = vec![
        Light::Sphere(Sphere { center: V::new(0.4, 1.1, -0.3), radius: 0.35, radiance }),
        Light::Disk(Disk {
            center: V::new(-0.3, 0.7, 0.4),
            normal: V::of(DVec3::new(0.3, -0.9, 0.1).normalize()),
            radius: 0.6,
            radiance,
        }),
        Light::Rect(
            Rect::new(DVec3::new(0.5, -0.6, 0.1), DVec3::new(0.1, 0.3, 0.2), DVec3::new(0.1, 0.1, -0.2), radiance)
                .unwrap(),
        ),
        Light::Polygon(Polygon::new(&pentagon(), radiance).unwrap()),
        Light::Tube(Tube { from: V::new(-0.8, 0.5, 0.3), to: V::new(0.9, 0.6, 0.2), intensity: radiance }),
        Light::Point(Point { position: V::new(0.2, -0.8, 0.7), intensity: radiance }),
        Light::Directional(Directional {
            towards: V::of(DVec3::new(0.5, 0.6, -0.2).normalize()),
            irradiance: radiance,
        }),
        Light::Constant(Constant { radiance }),
        Light::Environment(Environment::new(Arc::new(sky()), 0.7, DMat3::from_rotation_y(0.4))),
    ];
    assert_eq!(lights.iter().map(Light::kind_name).collect::<Vec<_>>(), Light::KINDS, "a shape without its laws");
    lights
}

fn projection(light: &Light<f64>, p: DVec3) -> ShGradient<f64, 36> {
    light.projection_with_gradient::<36>(V::of(p)).value
}

/// Largest coefficient over all channels.
fn largest(sh: &[Rgb<f64>; 36]) -> f64 {
    sh.iter().map(|c| c.max_abs()).fold(0.0, f64::max)
}

fn difference(a: &[Rgb<f64>; 36], b: &[Rgb<f64>; 36]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (*x - *y).max_abs()).fold(0.0, f64::max)
}

/// Central difference with its h^2 error removed by Richardson's step.
fn derivative(f: &impl Fn(DVec3) -> [Rgb<f64>; 36], p: DVec3, axis: usize, h: f64) -> [Rgb<f64>; 36] {
    let mut step = DVec3::ZERO;
    step[axis] = 1.0;
    let central = |h: f64| {
        let (above, below) = (f(p + step * h), f(p - step * h));
        std::array::from_fn::<_, 36, _>(|i| (above[i] - below[i]) * (0.5 / h))
    };
    let (coarse, fine) = (central(2.0 * h), central(h));
    std::array::from_fn(|i| fine[i] + (fine[i] - coarse[i]) * (1.0 / 3.0))
}

#[test]
fn gradients_are_derivatives_of_the_projection() {
    let mut places = stream(1);
    for light in every_kind() {
        for _ in 0..8 {
            let p = places.direction() * 0.25;
            let sh = projection(&light, p);
            let value = |q: DVec3| light.projection::<36>(V::of(q)).value;
            assert!(difference(&sh.value, &value(p)) <= 1e-13 * largest(&sh.value));
            for axis in 0..3 {
                let expected = derivative(&value, p, axis, 1e-3);
                let scale = largest(&expected).max(largest(&sh.value));
                let error = difference(&sh.gradient[axis], &expected) / scale;
                assert!(error < 2e-8, "{} at {p}, axis {axis}: {error}", light.kind_name());
                let other = difference(&sh.gradient[(axis + 1) % 3], &expected) / scale;
                let varies = light.bounds().is_some();
                assert!(!varies || other > 1e-4, "the gradient along another axis must not pass");
            }
        }
    }
}

#[test]
fn irradiance_is_the_limit_of_its_series_and_its_mean_is_exact() {
    // the mean of E over normals is A_0/(4 pi) of the integral of L; a product rule of 16 x 32 normals
    let rule = gauss_legendre(16);
    for wrap in [0.0, 0.4, 1.0] {
        let lobe = Lobe::new(wrap);
        let factors: [f64; 36] = spread(lobe.bands());
        for light in every_kind() {
            let sh = projection(&light, DVec3::ZERO).value;
            let (mut mean, mut square, mut most) = (0.0, 0.0, 0.0f64);
            for (z, weight) in rule.nodes.iter().zip(&rule.weights) {
                for k in 0..32 {
                    let (sine, cosine) = (std::f64::consts::TAU * (f64::from(k) + 0.5) / 32.0).sin_cos();
                    let r = (1.0 - z * z).sqrt();
                    let n = V::new(r * cosine, r * sine, *z);
                    let e = light.irradiance(V::zero(), n, &lobe).value.r;
                    let series = convolve(&sh, &factors, &basis::<f64, 36>(n)).r;
                    mean += weight / 64.0 * e;
                    square += weight / 64.0 * (e - series).powi(2);
                    most = most.max(e);
                    assert!(e >= 0.0);
                }
            }
            let expected = lobe.bands()[0] * basis::<f64, 1>(V::new(0.0, 0.0, 1.0))[0] * sh[0].r;
            let name = light.kind_name();
            assert!((mean / expected - 1.0).abs() < 4e-3, "{name} wrap {wrap}: {mean} for {expected}");
            assert!(square.sqrt() < 0.025 * most, "{name} wrap {wrap}: {} of {most}", square.sqrt());
        }
    }
}

#[test]
fn odd_part_of_lambert_irradiance_is_degree_one_alone() {
    // E(n) - E(-n) = integral of (n.w) L = (4 pi/3) sum of degree 1
    let lobe = Lobe::lambert();
    let mut normals = stream(3);
    for light in every_kind() {
        let sh = projection(&light, DVec3::ZERO).value;
        for _ in 0..20 {
            let n = V::of(normals.direction());
            let odd = light.irradiance(V::zero(), n, &lobe).value.g - light.irradiance(V::zero(), -n, &lobe).value.g;
            let y = basis::<f64, 4>(n);
            let expected = 4.0 * std::f64::consts::PI / 3.0 * (1..4).map(|i| sh[i].g * y[i]).sum::<f64>();
            // an environment's is summed to convergence, the others are closed
            let allowed = if light.kind_name() == "environment" { 1e-6 } else { 1e-11 };
            assert!((odd - expected).abs() < allowed * sh[0].g, "{}: {odd} for {expected}", light.kind_name());
        }
    }
}

#[test]
fn turning_light_and_place_turns_the_answer() {
    let mut draws = stream(4);
    for light in every_kind() {
        for _ in 0..4 {
            let turn = DQuat::from_axis_angle(draws.direction(), draws.uniform_between(0.2, 3.0));
            let motion = DAffine3::from_rotation_translation(turn, DVec3::new(1.0, -2.0, 0.5));
            let moved = light.transformed(&motion);
            let (p, n) = (draws.direction() * 0.2, draws.direction());
            let (q, m) = (V::of(motion.transform_point3(p)), V::of(turn * n));
            for wrap in [0.0, 0.6] {
                let lobe = Lobe::new(wrap);
                let before = light.irradiance(V::of(p), V::of(n), &lobe).value.r;
                let after = moved.irradiance(q, m, &lobe).value.r;
                let scale = projection(&light, p).value[0].r;
                assert!((before - after).abs() < 1e-9 * scale, "{} wrap {wrap}: {before}, {after}", light.kind_name());
            }
            let rotation = Rotation::new(DMat3::from_quat(turn));
            let expected = rotation.apply(&projection(&light, p).value);
            let got = moved.projection::<36>(q).value;
            assert!(difference(&got, &expected) < 1e-11 * largest(&expected), "{}", light.kind_name());
            let unturned = difference(&got, &projection(&light, p).value) / largest(&expected);
            assert!(light.kind_name() == "constant" || unturned > 1e-3, "an unturned answer must not pass");
        }
    }
}

#[test]
fn scaled_radiance_scales_every_answer() {
    for light in every_kind() {
        let twice = light.scaled_radiance(2.0);
        let (n, lobe) = (V::of(DVec3::new(0.3, 0.5, 0.2).normalize()), Lobe::new(0.3));
        let (a, b) = (light.irradiance(V::zero(), n, &lobe).value, twice.irradiance(V::zero(), n, &lobe).value);
        assert_eq!(a * 2.0, b, "{}", light.kind_name());
        let (a, b) = (projection(&light, DVec3::ZERO), projection(&twice, DVec3::ZERO));
        assert!(a.value.iter().zip(&b.value).all(|(x, y)| *x * 2.0 == *y));
    }
}

#[test]
fn samples_estimate_the_projection_and_know_their_density() {
    for light in every_kind() {
        let p = V::new(0.05, 0.1, -0.02);
        let expected = light.projection::<36>(p).value;
        let side = 96;
        let mut sum = [Rgb::zero(); 36];
        for i in 0..side {
            for j in 0..side {
                let u = [(i as f64 + 0.5) / side as f64, (j as f64 + 0.5) / side as f64];
                let sample = light.sample(p, u).unwrap();
                assert!((sample.direction.length() - 1.0).abs() < 1e-12);
                let y = basis::<f64, 36>(sample.direction);
                (0..36).for_each(|k| sum[k] += sample.weight * (y[k] / (side * side) as f64));
                let density = light.pdf_solid_angle(p, sample.direction);
                match sample.pdf_solid_angle {
                    // rounding may put the very edge outside
                    Some(pdf) => {
                        assert!((density / pdf - 1.0).abs() < 1e-6, "{} {u:?}: {density} {pdf}", light.kind_name());
                        let (got, seen) = (sample.radiance().unwrap(), light.radiance(p, sample.direction));
                        assert!((got - seen).max_abs() < 1e-9 * got.max_abs());
                    }
                    None => assert_eq!(density, 0.0),
                }
            }
        }
        let error = difference(&sum, &expected) / largest(&expected);
        assert!(error < 8e-3, "{}: {error}", light.kind_name());
        // sampled in a wrong place it must not agree
        let other = light.projection::<36>(V::new(0.3, -0.2, 0.1)).value;
        assert!(light.bounds().is_none() || difference(&sum, &other) / largest(&expected) > 3e-2);
    }
}

#[test]
fn single_precision_follows_double() {
    let mut draws = stream(5);
    for light in every_kind() {
        let origin = DVec3::new(0.1, -0.2, 0.05);
        let single = light.relative_to::<f32>(origin);
        for _ in 0..40 {
            let (p, n) = (draws.direction() * 0.3, draws.direction());
            let q = Vector3::<f32>::of(p - origin);
            let at = V::of(q.to_double() + origin);
            let sh = light.projection_with_gradient::<36>(at).value;
            let got = single.projection_with_gradient::<36>(q).value;
            let scale = largest(&sh.value);
            for i in 0..36 {
                assert!(
                    (got.value[i].to_double() - sh.value[i]).max_abs() < 1e-5 * scale,
                    "{} Y{i}",
                    light.kind_name()
                );
                for axis in 0..3 {
                    let steepest = sh.gradient.iter().map(largest).fold(scale, f64::max);
                    let error = (got.gradient[axis][i].to_double() - sh.gradient[axis][i]).max_abs() / steepest;
                    assert!(error < 1e-4, "{} Y{i} axis {axis}: {error}", light.kind_name());
                }
            }
            for wrap in [0.0, 0.5] {
                let n32 = Vector3::<f32>::of(n);
                let e = light.irradiance(at, V::of(n32.to_double()), &Lobe::new(wrap)).value;
                let e32 = single.irradiance(q, n32, &Lobe::new(wrap)).value.to_double();
                let error = (e32 - e).max_abs() / scale;
                assert!(error < 2e-5, "{} wrap {wrap}: {error}", light.kind_name());
            }
        }
    }
}

fn finite<const C: usize>(term: &Term<ShGradient<f64, C>>) -> bool {
    (0..C).all(|i| term.value.value[i].is_finite() && (0..3).all(|axis| term.value.gradient[axis][i].is_finite()))
}

#[test]
fn every_answer_is_finite_everywhere() {
    let mut draws = stream(6);
    for light in every_kind() {
        let center = light.bounds().map_or(DVec3::ZERO, |b| b.center);
        let size = light.bounds().map_or(1.0, |b| b.radius.max(0.1));
        let mut places = vec![center, center + DVec3::X * size, center + DVec3::Y * size];
        for exponent in -16..=8 {
            places.push(center + draws.direction() * size * 10f64.powi(exponent));
            places.push(center + draws.direction() * size * (1.0 + 10f64.powi(exponent)));
        }
        if let Light::Disk(disk) = &light {
            let (t, b) = disk.normal.frame();
            for towards in [t, b, disk.normal, (t + b) * 0.5f64.sqrt()] {
                for scale in [0.5, 1.0, 1.0 + 1e-15, 2.0] {
                    for lift in [0.0, 1e-300, 1e-16, 1e-9, -1e-9] {
                        places.push(center + towards.to_double() * size * scale + disk.normal.to_double() * lift);
                    }
                }
            }
        }
        if let Light::Tube(tube) = &light {
            // on it, at its ends, in line with it, and beside it by less and less
            for along in [0.0, 0.3, 1.0, 1.0 + 1e-15, 1.5, 1e6] {
                let at = (tube.from + (tube.to - tube.from) * along).to_double();
                places.extend([0.0, 1e-300, 1e-100, 1e-30, 1e-12, 1e-6].map(|aside| at + DVec3::Y * aside));
            }
        }
        for p in places {
            assert!(finite(&light.projection_with_gradient::<36>(V::of(p))), "{} at {p}", light.kind_name());
            let single = light.relative_to::<f32>(DVec3::ZERO);
            let sh = single.projection_with_gradient::<36>(Vector3::of(p)).value;
            assert!((0..36).all(|i| sh.value[i].is_finite() && sh.gradient.iter().all(|g| g[i].is_finite())));
            for wrap in [0.0, 0.3, 1.0] {
                for n in [DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, draws.direction()] {
                    let e = light.irradiance(V::of(p), V::of(n), &Lobe::new(wrap)).value;
                    assert!(e.is_finite() && e.r >= 0.0, "{} at {p}, n {n}, wrap {wrap}: {e:?}", light.kind_name());
                    let e = single.irradiance(Vector3::of(p), Vector3::of(n), &Lobe::new(wrap)).value;
                    assert!(e.is_finite() && e.r >= 0.0, "{} f32 at {p}, n {n}, wrap {wrap}", light.kind_name());
                }
            }
            if let Some(sample) = light.sample(V::of(p), [0.3, 0.7]) {
                assert!(sample.direction.is_finite() && sample.weight.is_finite(), "{} at {p}", light.kind_name());
            }
        }
    }
}

fn lights_of(file: &Value) -> Vec<Light<f64>> {
    file["lights"]
        .as_array()
        .unwrap()
        .iter()
        .map(|light| {
            let (center, radius) = (vector(&light["center"]), light["radius"].as_f64().unwrap());
            let radiance = Rgb::splat(light["radiance"].as_f64().unwrap());
            match light["type"].as_str().unwrap() {
                "sphere" => Light::Sphere(Sphere { center, radius, radiance }),
                "disk" => Light::Disk(Disk { center, normal: vector(&light["normal"]), radius, radiance }),
                other => panic!("{other}"),
            }
        })
        .collect()
}

#[test]
fn shared_rig_cases() {
    let file = case("07_rigs");
    let lights = lights_of(&file);
    let lobe = Lobe::lambert();
    let normals: Vec<V> = file["normals"].as_array().unwrap().iter().map(vector).collect();
    for (p, expected) in file["queries"].as_array().unwrap().iter().zip(file["exact_irradiance"].as_array().unwrap()) {
        for (n, expected) in normals.iter().zip(numbers(expected)) {
            let e = rigbench::light::irradiance(&lights, vector(p), *n, &lobe).value.r;
            assert!((e - expected).abs() < 1e-10, "{e} for {expected}");
        }
    }
    let samples = file["samples"].as_array().unwrap();
    assert!(samples.len() >= 9);
    for sample in samples {
        let sh = rigbench::light::projection_with_gradient::<f64, 9>(&lights, vector(&sample["p"])).value;
        let expected = numbers(&sample["sh"]);
        for i in 0..9 {
            assert!((sh.value[i].r - expected[i]).abs() < 1e-9 * expected[0], "Y{i}");
        }
        for axis in 0..3 {
            let expected = numbers(&sample["sh_gradient_xyz"][axis]);
            let scale = expected.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            for i in 0..9 {
                let error = (sh.gradient[axis][i].r - expected[i]).abs() / scale;
                assert!(error < 1e-9, "Y{i} axis {axis}: {error}");
            }
        }
    }
}
