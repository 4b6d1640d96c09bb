//! The path tracer against another one: irradiance that Mitsuba computed (`tests/oracles/trace_mitsuba.py` says how).

use glam::DVec3;
use rigbench::light::{Constant, Directional, Light, Point};
use rigbench::math::{Rgb, StreamPurpose, Vector3};
use rigbench::scene::SurfacePoint;
use rigbench::sh::Lobe;
use rigbench::trace::{Bounces, Effects, Effort, Estimate, Seed, TracedGeometry, TracedMaterial, Tracer, Transport};
use serde_json::Value;

fn numbers(value: &Value) -> [f64; 3] {
    std::array::from_fn(|k| value[k].as_f64().unwrap())
}

fn vector(value: &Value) -> DVec3 {
    DVec3::from_array(numbers(value))
}

fn material(part: &Value) -> TracedMaterial {
    TracedMaterial {
        albedo: Rgb::from_array(numbers(&part["albedo"])),
        emission: Rgb::from_array(numbers(&part["emission"])),
    }
}

/// A value with its standard error.
type Estimated = (Rgb<f64>, Rgb<f64>);

struct Case {
    tracer: Tracer,
    lights: Vec<Light<f64>>,
    points: Vec<SurfacePoint>,
    /// Effects, and what the other tracer says with them.
    expected: Vec<(Effects, Vec<Estimated>)>,
}

fn case(name: &str) -> Case {
    let path = format!("{}/tests/cases/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let file: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let list = |value: &Value| value.as_array().unwrap().clone();
    let mut geometry = TracedGeometry::default();
    for quad in list(&file["quads"]) {
        geometry.add_quad(material(&quad), vector(&quad["center"]), vector(&quad["u"]), vector(&quad["v"]));
    }
    for mesh in list(&file["meshes"]) {
        let triangles = list(&mesh["triangles"]);
        geometry.add(material(&mesh), triangles.iter().map(|t| std::array::from_fn(|k| vector(&t[k]))));
    }
    let lights = list(&file["lights"])
        .iter()
        .map(|light| {
            let rgb = |key: &str| Rgb::from_array(numbers(&light[key]));
            match light["kind"].as_str().unwrap() {
                "point" => Light::Point(Point {
                    position: Vector3::of(vector(&light["position"])),
                    intensity: rgb("intensity"),
                }),
                "directional" => Light::Directional(Directional {
                    towards: Vector3::of(vector(&light["towards"])),
                    irradiance: rgb("irradiance"),
                }),
                "constant" => Light::Constant(Constant { radiance: rgb("radiance") }),
                other => panic!("unknown light {other}"),
            }
        })
        .collect();
    let points = list(&file["points"])
        .iter()
        .map(|p| SurfacePoint { position: vector(&p["position"]), normal: vector(&p["normal"]) })
        .collect();
    let expected = list(&file["irradiance"])
        .iter()
        .map(|rows| {
            let bounces = match rows["bounces"].as_u64() {
                Some(count) => Bounces::Count(count as u32),
                None => Bounces::Infinite,
            };
            let rgb = |row: &Value, key: &str| Rgb::from_array(numbers(&row[key]));
            let values = list(&rows["points"]);
            (Effects::bounces(bounces), values.iter().map(|r| (rgb(r, "value"), rgb(r, "standard_error"))).collect())
        })
        .collect();
    Case { tracer: Tracer::new(&geometry), lights, points, expected }
}

/// Largest and mean square of the difference over both standard errors, green channel and the others.
fn scores(estimates: &[Estimate<Rgb<f64>>], expected: &[(Rgb<f64>, Rgb<f64>)], factor: f64) -> (f64, f64) {
    let (mut worst, mut squares, mut count) = (0.0f64, 0.0, 0.0);
    for (estimate, (value, error)) in estimates.iter().zip(expected) {
        let channels = estimate.value.to_array().into_iter().zip(estimate.standard_error.to_array());
        for ((ours, our_error), (theirs, their_error)) in
            channels.zip(value.to_array().into_iter().zip(error.to_array()))
        {
            let both = our_error.hypot(their_error);
            if both > 0.0 {
                let z = (ours * factor - theirs) / both;
                worst = worst.max(z.abs());
                squares += z * z;
                count += 1.0;
            } else {
                // seen by neither, or exact here and there: f32 there
                assert!((ours - theirs).abs() <= 1e-4 * theirs.abs(), "{ours} for {theirs}");
            }
        }
    }
    (worst, squares / count)
}

#[test]
fn agrees_with_mitsuba_at_every_number_of_bounces() {
    let mut biased = 0;
    let mut compared = 0;
    for name in ["trace_room", "trace_yard", "trace_rooms"] {
        let case = case(name);
        assert_eq!((case.points.len(), case.expected.len()), (20, 4));
        for (effects, expected) in &case.expected {
            let transport = Transport::new(&case.tracer, &case.lights, *effects);
            let seed = Seed { seed: 1, purpose: StreamPurpose::Reference };
            let estimates = transport.irradiance(&case.points, &Lobe::lambert(), seed, Effort::Samples(1 << 14));
            let (worst, mean_square) = scores(&estimates, expected, 1.0);
            assert!(
                worst < 4.0 && mean_square < 1.6,
                "{name}, {effects}: worst {worst:.2}, mean square {mean_square:.2}"
            );
            compared += 1;
            biased += u32::from(scores(&estimates, expected, 1.01).1 > 1.6);
        }
    }
    // the errors are small enough that one percent more would have been seen
    assert!(biased > compared / 2, "{biased} of {compared}");
}
