//! The path tracer against answers that are known in closed form.

use std::f64::consts::PI;

use glam::DVec3;
use rigbench::light::{self, Constant, Light, Point, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::scene::SurfacePoint;
use rigbench::sh::Lobe;
use rigbench::trace::{
    Bounces, Counters, Effects, Effort, Estimate, SceneFacts, Seed, TracedGeometry, TracedMaterial, Tracer, Transport,
};

const SEED: Seed = Seed { seed: 1, purpose: StreamPurpose::Test };

fn material(albedo: f64, emission: f64) -> TracedMaterial {
    TracedMaterial { albedo: Rgb::splat(albedo), emission: Rgb::splat(emission) }
}

fn bounces(count: u32) -> Effects {
    Effects::bounces(Bounces::Count(count))
}

/// The six walls of a box; the front side of every wall looks inwards.
fn room(materials: [TracedMaterial; 6], half: DVec3) -> TracedGeometry {
    let mut geometry = TracedGeometry::default();
    let (x, y, z) = (DVec3::X * half.x, DVec3::Y * half.y, DVec3::Z * half.z);
    // the normal u x v looks to the middle
    for (material, (center, u, v)) in
        materials.into_iter().zip([(-x, y, z), (x, z, y), (-y, z, x), (y, x, z), (-z, x, y), (z, y, x)])
    {
        geometry.add_quad(material, center, u, v);
    }
    geometry
}

fn random_points(count: usize, half: f64, index: u64) -> Vec<SurfacePoint> {
    let mut stream = Stream::indexed(11, StreamPurpose::Test, index);
    let coordinate = |stream: &mut Stream| stream.uniform_between(-half, half);
    (0..count)
        .map(|_| SurfacePoint {
            position: DVec3::new(coordinate(&mut stream), coordinate(&mut stream), coordinate(&mut stream)),
            normal: stream.direction(),
        })
        .collect()
}

/// (estimate - truth)/standard error of every channel that is estimated; exact ones must agree.
fn z_scores(estimates: &[Estimate<Rgb<f64>>], truth: &[Rgb<f64>]) -> Vec<f64> {
    assert_eq!(estimates.len(), truth.len());
    let mut scores = Vec::new();
    for (estimate, truth) in estimates.iter().zip(truth) {
        let (value, error) = (estimate.value.to_array(), estimate.standard_error.to_array());
        for ((value, error), truth) in value.into_iter().zip(error).zip(truth.to_array()) {
            let difference = value - truth;
            if error <= 1e-13 * truth.abs() {
                assert!(difference.abs() <= 1e-9 * truth.abs().max(1e-9), "{value} said to be exact, for {truth}");
            } else {
                scores.push(difference / error);
            }
        }
    }
    scores
}

/// Whether scores are those of an unbiased estimate: none beyond 4, and their sum of squares within 4.5 sigma of its mean.
fn honest(scores: &[f64]) -> Result<(), String> {
    let count = scores.len() as f64;
    let worst = scores.iter().fold(0.0f64, |m, z| m.max(z.abs()));
    let chi_square: f64 = scores.iter().map(|z| z * z).sum();
    let mean = scores.iter().sum::<f64>() / count;
    // var z^2 = 2 for normal scores; those of few batches have slightly heavier tails
    let chi_score = (chi_square - count) / (2.2 * count).sqrt();
    match worst < 4.0 && chi_score < 4.5 && (mean * count.sqrt()).abs() < 4.0 {
        true => Ok(()),
        false => {
            Err(format!("worst {worst:.2}, chi-square {chi_score:.2} sigma, mean {:.2} sigma", mean * count.sqrt()))
        }
    }
}

fn scaled(truth: &[Rgb<f64>], factor: f64) -> Vec<Rgb<f64>> {
    truth.iter().map(|t| *t * factor).collect()
}

#[test]
fn furnace_at_every_number_of_bounces() {
    // walls that emit L and reflect a: L(1 + a + ... + a^N) from everywhere
    for albedo in [0.0, 0.5, 0.8] {
        let emission = 0.7;
        let tracer = Tracer::new(&room([material(albedo, emission); 6], DVec3::new(1.0, 1.3, 0.8)));
        let points = random_points(12, 0.7, 1);
        let counts = [0, 1, 2, 3, 7].map(bounces);
        for effects in counts.into_iter().chain([Effects::bounces(Bounces::Infinite)]) {
            let sum: f64 = match effects.most_bounces() {
                Some(count) => (0..=count).map(|k| f64::powi(albedo, k as i32)).sum(),
                None => 1.0 / (1.0 - albedo),
            };
            let transport = Transport::new(&tracer, &[], effects);
            for lobe in [Lobe::lambert(), Lobe::new(0.6)] {
                let truth = vec![Rgb::splat(lobe.bands()[0] * emission * sum); points.len()];
                let estimates = transport.irradiance(&points, &lobe, SEED, Effort::Samples(4096));
                let scores: Vec<f64> = z_scores(&estimates, &truth).into_iter().step_by(3).collect();
                honest(&scores).unwrap_or_else(|why| panic!("albedo {albedo}, {effects}, wrap {}: {why}", lobe.wrap()));
            }
        }
    }
}

#[test]
fn a_bias_of_one_percent_in_bounced_light_is_seen() {
    // the same furnace with enough paths, and none of the emission that directions find by themselves: what a path carries is tested
    let (albedo, emission) = (0.6, 0.7);
    let tracer = Tracer::new(&room([material(albedo, emission); 6], DVec3::new(1.0, 1.3, 0.8)));
    let points = random_points(48, 0.7, 9);
    for effects in [bounces(1), bounces(2), bounces(3), Effects::bounces(Bounces::Infinite)] {
        let sum: f64 = match effects.most_bounces() {
            Some(count) => (0..=count).map(|k| f64::powi(albedo, k as i32)).sum(),
            None => 1.0 / (1.0 - albedo),
        };
        let transport = Transport::new(&tracer, &[], effects);
        let truth = vec![Rgb::splat(PI * emission * sum); points.len()];
        let estimates = transport.irradiance(&points, &Lobe::lambert(), SEED, Effort::Samples(8192));
        let against = |truth: &[Rgb<f64>]| {
            let scores: Vec<f64> = z_scores(&estimates, truth).into_iter().step_by(3).collect();
            honest(&scores)
        };
        against(&truth).unwrap_or_else(|why| panic!("{effects}: {why}"));
        for bias in [0.99, 1.01] {
            assert!(against(&scaled(&truth, bias)).is_err(), "{effects}: a bias of {bias} must not pass");
        }
    }
}

#[test]
fn surroundings_are_a_furnace_too() {
    // in a constant light everything outside is L, and a white surface (a = 1) that sees nothing else sends L too
    let mut geometry = TracedGeometry::default();
    geometry.add_quad(material(1.0, 0.0), DVec3::ZERO, DVec3::Z, DVec3::X);
    let tracer = Tracer::new(&geometry);
    let lights = [Light::Constant(Constant { radiance: Rgb::new(0.3, 1.0, 2.0) })];
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Infinite));
    let points: Vec<_> = random_points(10, 0.5, 2);
    let truth = vec![Rgb::new(0.3, 1.0, 2.0) * PI; points.len()];
    for estimate in transport.irradiance(&points, &Lobe::lambert(), SEED, Effort::Samples(256)) {
        for (value, truth) in estimate.value.to_array().into_iter().zip(truth[0].to_array()) {
            assert!((value / truth - 1.0).abs() < 1e-12, "{value} for {truth}");
        }
    }
    // without the bounce it is black, and takes half of what a vertical surface close above the middle of a large one sees
    let mut floor = TracedGeometry::default();
    floor.add_quad(material(1.0, 0.0), DVec3::ZERO, DVec3::Z * 1e3, DVec3::X * 1e3);
    let tracer = Tracer::new(&floor);
    let black = Transport::new(&tracer, &lights, Effects::SHADOWS);
    let above = SurfacePoint { position: DVec3::new(0.0, 0.01, 0.0), normal: DVec3::X };
    let estimate = &black.irradiance(&[above], &Lobe::lambert(), SEED, Effort::Samples(1 << 14))[0];
    let score = (estimate.value.g - PI / 2.0) / estimate.standard_error.g;
    assert!(score.abs() < 4.0 && estimate.standard_error.g < 0.01, "{estimate:?}");
}

#[test]
fn emission_is_of_the_front_alone_and_a_quad_is_lamberts_polygon() {
    let (center, u, v) = (DVec3::new(0.2, 2.0, -0.1), DVec3::new(0.5, 0.1, 0.0), DVec3::new(0.0, 0.2, 0.7));
    // u x v looks down: -y
    let (u, v) = if u.cross(v).y < 0.0 { (u, v) } else { (v, u) };
    let mut geometry = TracedGeometry::default();
    let radiance = Rgb::new(3.0, 1.0, 0.5);
    geometry.add_quad(TracedMaterial { albedo: Rgb::zero(), emission: radiance }, center, u, v);
    let tracer = Tracer::new(&geometry);
    let corners = [center - u - v, center + u - v, center + u + v, center - u + v];
    // normals for which no corner is behind the horizon, at distances from near to far
    let mut stream = Stream::indexed(5, StreamPurpose::Test, 3);
    let mut points = Vec::new();
    while points.len() < 40 {
        let at = center - DVec3::Y * (0.02 + 3.0 * stream.uniform()) + 0.8 * stream.direction() * stream.uniform();
        let normal = stream.direction();
        if corners.iter().all(|c| (*c - at).dot(normal) > 0.0) && (at - center).dot(u.cross(v)) > 0.0 {
            points.push(SurfacePoint { position: at, normal });
        }
    }
    let lambert = |point: &SurfacePoint| {
        let edges = (0..4).map(|k| {
            let (a, b) =
                ((corners[k] - point.position).normalize(), (corners[(k + 1) % 4] - point.position).normalize());
            let cross = a.cross(b);
            cross.length().atan2(a.dot(b)) * point.normal.dot(cross.normalize())
        });
        radiance * (0.5 * edges.sum::<f64>().abs())
    };
    let truth: Vec<_> = points.iter().map(lambert).collect();
    let transport = Transport::new(&tracer, &[], bounces(0));
    let estimates = transport.irradiance(&points, &Lobe::lambert(), SEED, Effort::Samples(8192));
    let scores: Vec<f64> = z_scores(&estimates, &truth).into_iter().step_by(3).collect();
    honest(&scores).unwrap();
    // the same points mirrored to the back see nothing
    let behind: Vec<_> =
        points.iter().map(|p| SurfacePoint { position: 2.0 * center - p.position, normal: -p.normal }).collect();
    for estimate in transport.irradiance(&behind, &Lobe::lambert(), SEED, Effort::Samples(1024)) {
        assert_eq!(estimate.value, Rgb::zero());
    }
}

#[test]
fn unblocked_lights_are_their_closed_forms_and_a_bias_of_one_percent_is_seen() {
    // something far away that blocks nothing, so that shadow rays are traced
    let mut geometry = TracedGeometry::default();
    geometry.add_quad(material(0.0, 0.0), DVec3::Y * -40.0, DVec3::X, DVec3::Z);
    let tracer = Tracer::new(&geometry);
    let lights = [
        Light::Sphere(Sphere { center: Vector3::new(1.5, 2.0, 0.3), radius: 0.8, radiance: Rgb::new(2.0, 1.0, 0.2) }),
        Light::Sphere(Sphere { center: Vector3::new(-3.0, 0.0, 1.0), radius: 1.4, radiance: Rgb::splat(0.7) }),
        Light::Point(Point { position: Vector3::new(0.0, 3.0, 0.0), intensity: Rgb::splat(0.4) }),
    ];
    let points = random_points(150, 0.6, 4);
    for lobe in [Lobe::lambert(), Lobe::new(0.4)] {
        let truth: Vec<_> = points
            .iter()
            .map(|p| light::irradiance(&lights, Vector3::of(p.position), Vector3::of(p.normal), &lobe).value)
            .collect();
        let transport = Transport::new(&tracer, &lights, Effects::NONE);
        let estimates = transport.irradiance(&points, &lobe, SEED, Effort::Samples(2048));
        let scores = z_scores(&estimates, &truth);
        let scores: Vec<f64> = scores.into_iter().step_by(3).collect();
        assert!(scores.len() >= 100);
        honest(&scores).unwrap_or_else(|why| panic!("wrap {}: {why}", lobe.wrap()));
        for bias in [0.99, 1.01] {
            let wrong: Vec<f64> = z_scores(&estimates, &scaled(&truth, bias)).into_iter().step_by(3).collect();
            assert!(honest(&wrong).is_err(), "a bias of 1 % must not pass");
        }
        // shadow rays that find nothing change no value
        let shadowed = Transport::new(&tracer, &lights, Effects::SHADOWS);
        for (with, without) in shadowed.irradiance(&points, &lobe, SEED, Effort::Samples(2048)).iter().zip(&estimates) {
            assert_eq!(with.value, without.value);
            let lobes = without.counters.wrap_evaluations;
            assert_eq!(without.counters, Counters { wrap_evaluations: lobes, ..Counters::default() });
            assert_eq!(with.counters.shadow_rays > 0, with.value != Rgb::zero());
        }
    }
}

#[test]
fn a_half_blocked_sphere_gives_half_and_umbra_nothing() {
    // a black half plane through the line from the point to the light's centre
    let mut geometry = TracedGeometry::default();
    geometry.add_quad(material(0.0, 0.0), DVec3::new(50.0, 1.0, 0.0), DVec3::X * 50.0, DVec3::Z * 50.0);
    let tracer = Tracer::new(&geometry);
    let lights =
        [Light::Sphere(Sphere { center: Vector3::new(0.0, 2.0, 0.0), radius: 0.5, radiance: Rgb::new(1.0, 2.0, 4.0) })];
    let transport = Transport::new(&tracer, &lights, Effects::SHADOWS);
    let at = |x: f64| SurfacePoint { position: DVec3::new(x, 0.0, 0.0), normal: DVec3::Y };
    let estimates = transport.irradiance(&[at(0.0), at(3.0), at(-3.0)], &Lobe::lambert(), SEED, Effort::ACCURATE);
    let open = |x: f64| {
        light::irradiance(&lights, Vector3::new(x, 0.0, 0.0), Vector3::new(0.0, 1.0, 0.0), &Lobe::lambert()).value
    };
    let truth = [open(0.0) * 0.5, Rgb::zero(), open(-3.0)];
    for (estimate, truth) in estimates.iter().zip(truth) {
        let score = (estimate.value.g - truth.g) / estimate.standard_error.g;
        assert!(score.abs() < 4.0, "{estimate:?} for {truth:?}");
    }
    assert!(estimates[0].standard_error.g <= 0.005 * truth[0].g);
    assert_eq!(estimates[1].value, Rgb::zero());
}

#[test]
fn enclosed_energy_balances() {
    // walls of different albedo around one emissive wall: what is emitted equals what is absorbed.
    // absorbed = sum over walls of (1 - a) times the integral of E, by points drawn over the walls
    let half = DVec3::new(1.0, 0.8, 1.2);
    let albedos = [0.7, 0.2, 0.5, 0.9, 0.35, 0.6];
    let emission = 2.0;
    let materials = std::array::from_fn(|wall| material(albedos[wall], if wall == 3 { emission } else { 0.0 }));
    let tracer = Tracer::new(&room(materials, half));
    let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Infinite));
    let mut stream = Stream::indexed(17, StreamPurpose::Test, 6);
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let per_wall = 400;
    let (mut absorbed, mut variance) = (0.0, 0.0);
    let mut emitted = 0.0;
    for wall in 0..6 {
        let axis = wall / 2;
        let inwards = if wall % 2 == 0 { axes[axis] } else { -axes[axis] };
        let (s, t) = (axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
        let area = 4.0 * s.dot(half) * t.dot(half);
        let points: Vec<_> = (0..per_wall)
            .map(|_| {
                let across = s * s.dot(half) * stream.uniform_between(-1.0, 1.0)
                    + t * t.dot(half) * stream.uniform_between(-1.0, 1.0);
                SurfacePoint { position: across - inwards * inwards.abs().dot(half), normal: inwards }
            })
            .collect();
        let estimates = transport.irradiance(&points, &Lobe::lambert(), SEED, Effort::Samples(64));
        let values: Vec<f64> = estimates.iter().map(|e| e.value.r).collect();
        let mean = values.iter().sum::<f64>() / per_wall as f64;
        let spread = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (per_wall * (per_wall - 1)) as f64;
        absorbed += (1.0 - albedos[wall]) * area * mean;
        variance += ((1.0 - albedos[wall]) * area).powi(2) * spread;
        if wall == 3 {
            emitted = PI * emission * area;
        }
    }
    let score = (absorbed - emitted) / variance.sqrt();
    assert!(score.abs() < 4.0, "absorbed {absorbed}, emitted {emitted}: {score} sigma");
    assert!(variance.sqrt() < 0.02 * emitted, "no test: {}", variance.sqrt() / emitted);
}

#[test]
fn the_same_bits_on_any_number_of_threads_in_any_order_and_for_one_point_alone() {
    let tracer = Tracer::new(&room([material(0.6, 0.0); 6], DVec3::ONE));
    let lights = [
        Light::Sphere(Sphere { center: Vector3::new(0.2, 0.6, 0.1), radius: 0.2, radiance: Rgb::splat(5.0) }),
        Light::Point(Point { position: Vector3::new(-0.5, 0.1, 0.3), intensity: Rgb::new(1.0, 0.4, 0.1) }),
    ];
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Infinite));
    let points = random_points(24, 0.8, 7);
    let run = |threads: usize, points: &[SurfacePoint]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| transport.irradiance(points, &Lobe::lambert(), SEED, Effort::Samples(512)))
    };
    let one = run(1, &points);
    assert_eq!(one, run(2, &points));
    let reversed: Vec<_> = points.iter().rev().copied().collect();
    assert!(run(2, &reversed).iter().rev().eq(&one));
    assert_eq!(run(1, &points[5..6])[0], one[5]);
    // another purpose and another seed draw other numbers
    for seed in [Seed { purpose: StreamPurpose::Probe, ..SEED }, Seed { seed: 2, ..SEED }] {
        let other = transport.irradiance(&points, &Lobe::lambert(), seed, Effort::Samples(512));
        assert!(other.iter().zip(&one).all(|(a, b)| a.value != b.value));
    }
}

#[test]
fn what_is_not_called_for_is_not_computed() {
    let tracer = Tracer::new(&room([material(0.5, 0.0); 6], DVec3::ONE));
    let lights =
        [Light::Sphere(Sphere { center: Vector3::new(0.2, 0.6, 0.1), radius: 0.2, radiance: Rgb::splat(5.0) })];
    let points = random_points(4, 0.5, 8);
    let total = |effects: Effects, lobe: Lobe<f64>| -> Counters {
        let transport = Transport::new(&tracer, &lights, effects);
        transport.irradiance(&points, &lobe, SEED, Effort::Samples(256)).iter().map(|e| e.counters).sum()
    };
    assert_eq!(total(Effects::NONE, Lobe::lambert()), Counters::default());
    let shadows = total(Effects::SHADOWS, Lobe::new(1.0));
    // a full wrap sees every direction but the last: one shadow ray and one lobe a sample
    assert_eq!((shadows.shadow_rays, shadows.closest_rays, shadows.bounces), (4 * 256, 0, 0));
    assert_eq!(shadows.wrap_evaluations, 4 * 256);
    // inside a closed room every path has exactly as many bounces as it may, one closest ray each
    for count in [1, 2, 3] {
        let counted = total(bounces(count), Lobe::lambert());
        assert_eq!(counted.bounces, 4 * 256 * u64::from(count));
        assert_eq!(counted.closest_rays, 4 * 256 * u64::from(count));
        assert_eq!((counted.emitter_samples, counted.wrap_evaluations), (0, 0));
    }
}

#[test]
fn simulating_everything_changes_a_picture_by_less_than_its_noise_where_auto_left_it_out() {
    // pixels of a ball in the middle of a room
    let pixels: Vec<SurfacePoint> = (0..24 * 16)
        .map(|k| {
            let (polar, azimuth) = (PI * (f64::from(k / 24) + 0.5) / 16.0, 2.0 * PI * f64::from(k % 24) / 24.0);
            let normal = DVec3::new(polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin());
            SurfacePoint { position: 0.3 * normal, normal }
        })
        .collect();
    let lamp =
        Light::Sphere(Sphere { center: Vector3::new(0.3, 0.7, 0.1), radius: 0.15, radiance: Rgb::new(9.0, 7.0, 5.0) });
    let everything = Effects::bounces(Bounces::Infinite);
    let picture = |geometry: &TracedGeometry, lights: &[Light<f64>], effects: Effects, seed: u64| {
        let tracer = Tracer::new(geometry);
        let transport = Transport::new(&tracer, lights, effects);
        transport.irradiance(&pixels, &Lobe::lambert(), Seed { seed, ..SEED }, Effort::Samples(256))
    };
    let rms = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
        f64::sqrt(sum / count)
    };
    // difference of two pictures over the noise that both have
    let change = |a: &[Estimate<Rgb<f64>>], b: &[Estimate<Rgb<f64>>]| {
        let difference = rms(&mut a.iter().zip(b).flat_map(|(a, b)| (a.value - b.value).to_array()));
        let noise = rms(&mut a.iter().chain(b).flat_map(|e| e.standard_error.to_array()));
        difference / (noise * 2f64.sqrt())
    };
    let mut block = TracedGeometry::default();
    block.add_quad(material(0.0, 0.0), DVec3::new(0.0, 0.5, 0.0), DVec3::Z * 0.2, DVec3::X * 0.2);
    let glow = room([material(0.0, 0.8); 6], DVec3::ONE);
    let nothing = TracedGeometry::default();
    let facts = |geometry: &TracedGeometry, lights: usize| SceneFacts {
        lights,
        static_triangles: geometry.triangles.len(),
        reflects: geometry.reflects(),
        emits: geometry.materials.iter().any(|m| m.emission.max_abs() > 0.0),
        wrap: false,
    };
    let lit = std::slice::from_ref(&lamp);
    for (name, geometry, lights, auto) in [
        ("no occluder", &nothing, lit, Effects::NONE),
        ("a black block", &block, lit, Effects::SHADOWS),
        ("glowing black walls", &glow, &[][..], bounces(0)),
    ] {
        assert_eq!(Effects::called_for(&facts(geometry, lights.len())).0, auto, "{name}");
        let left_out = picture(geometry, lights, auto, 1);
        let ratio = change(&left_out, &picture(geometry, lights, everything, 2));
        assert!(ratio < 1.2, "{name}: {ratio} times the noise");
        // what was left out was not computed
        let counted: Counters = left_out.iter().map(|e| e.counters).sum();
        match auto {
            Effects::NONE => assert_eq!(counted, Counters::default()),
            Effects::SHADOWS => assert!(counted.shadow_rays > 0 && counted.closest_rays + counted.bounces == 0),
            _ => assert!(counted.closest_rays > 0 && counted.bounces == 0),
        }
    }
    // and what a scene calls for is seen, if it is left out
    let grey = room([material(0.5, 0.0); 6], DVec3::ONE);
    assert_eq!(Effects::called_for(&facts(&grey, 1)).0, everything);
    let full = picture(&grey, lit, everything, 1);
    for less in [Effects::NONE, Effects::SHADOWS, bounces(0), bounces(1)] {
        let ratio = change(&full, &picture(&grey, lit, less, 2));
        assert!(ratio > 2.0, "{less}: {ratio} times the noise");
    }
    assert!(change(&picture(&block, lit, Effects::NONE, 1), &picture(&block, lit, Effects::SHADOWS, 2)) > 2.0);
}
