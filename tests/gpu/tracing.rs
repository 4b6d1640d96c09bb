//! Light traced to probes on the GPU against the CPU's tracer, and against what a furnace must give.

use std::f64::consts::PI;

use glam::DVec3;
use rigbench::gpu::{Gpu, ProbeTracer};
use rigbench::light::{
    Constant, Directional, Disk, Environment, EnvironmentMap, Light, Point, Polygon, Rect, Sphere, Tube,
};
use rigbench::math::{Rgb, StreamPurpose, Vector3};
use rigbench::probe::{depths, texels};
use rigbench::trace::{
    Bounces, Effects, Effort, Estimate, Projected, Seed, TracedGeometry, TracedMaterial, Tracer, Transport,
};

use crate::on_gpu;

const PATHS: u64 = 8192;
const ORDER: usize = 3;

/// A room of 4 x 3 x 5 m open towards +z, coloured walls, a block and a sheet in it and a glowing panel under its ceiling.
pub fn room() -> TracedGeometry {
    let wall = |r: f64, g: f64, b: f64| TracedMaterial { albedo: Rgb::new(r, g, b), emission: Rgb::zero() };
    let mut room = TracedGeometry::default();
    let (x, y, z) = (DVec3::X * 2.0, DVec3::Y * 1.5, DVec3::Z * 2.5);
    room.add_quad(wall(0.7, 0.2, 0.2), -x, y, z);
    room.add_quad(wall(0.2, 0.7, 0.2), x, z, y);
    room.add_quad(wall(0.6, 0.6, 0.6), -y, z, x);
    room.add_quad(wall(0.5, 0.5, 0.8), y, x, z);
    room.add_quad(wall(0.4, 0.4, 0.4), -z, x, y);
    let block = DVec3::new(0.6, -1.0, 0.4);
    for (out, u, v) in [(DVec3::X, DVec3::Y, DVec3::Z), (DVec3::Y, DVec3::Z, DVec3::X), (DVec3::Z, DVec3::X, DVec3::Y)]
    {
        room.add_quad(wall(0.8, 0.8, 0.3), block + out * 0.4, u * 0.4, v * 0.4);
        room.add_quad(wall(0.8, 0.8, 0.3), block - out * 0.4, v * 0.4, u * 0.4);
    }
    // a sheet, seen and lit from both sides
    room.add_quad(wall(0.9, 0.5, 0.9), DVec3::new(-0.4, -0.3, 0.7), DVec3::X * 1.1, DVec3::Y * 1.0);
    let glow = TracedMaterial { albedo: Rgb::splat(0.1), emission: Rgb::new(6.0, 5.0, 3.0) };
    room.add_quad(glow, DVec3::new(-0.8, 1.4, -0.7), DVec3::X * 0.5, DVec3::Z * 0.4);
    room
}

pub fn lights() -> Vec<Light<f64>> {
    let v = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
    let corners = [[-1.2, 0.2, 1.0], [-1.2, 0.8, 1.2], [-1.0, 0.9, 1.6], [-0.9, 0.1, 1.7]];
    let hexagon: Vec<DVec3> = corners.iter().map(|c| DVec3::new(-1.2, c[1], c[2])).collect();
    vec![
        Light::Sphere(Sphere { center: v(1.2, 0.8, -1.0), radius: 0.3, radiance: Rgb::new(4.0, 1.0, 2.0) }),
        Light::Disk(Disk {
            center: v(-1.5, 0.0, -1.0),
            normal: v(1.0, 0.0, 0.0),
            radius: 0.4,
            radiance: Rgb::splat(3.0),
        }),
        Light::Rect(
            Rect::new(DVec3::new(0.0, 1.2, 1.0), DVec3::X * 0.4, DVec3::Z * 0.3, Rgb::new(1.0, 4.0, 4.0)).unwrap(),
        ),
        Light::Polygon(Polygon::new(&hexagon, Rgb::new(2.0, 2.0, 0.5)).unwrap()),
        Light::Tube(Tube { from: v(-1.0, 0.9, 0.0), to: v(1.0, 1.0, 0.2), intensity: Rgb::splat(0.5) }),
        Light::Point(Point { position: v(0.3, 0.4, -1.8), intensity: Rgb::new(0.5, 0.6, 0.9) }),
        Light::Directional(Directional {
            towards: v(0.0, 0.2, 1.0).normalized().unwrap(),
            irradiance: Rgb::new(0.8, 0.7, 0.4),
        }),
        Light::Constant(Constant { radiance: Rgb::new(0.1, 0.2, 0.3) }),
    ]
}

pub fn places() -> [DVec3; 3] {
    // beside the block and behind it; in the open end
    [DVec3::new(-0.5, -0.6, 0.2), DVec3::new(1.3, -1.2, 0.4), DVec3::new(0.2, 0.3, 2.2)]
}

/// A coarse map, turned.
pub fn sky() -> Light<f64> {
    let texels = (0..32).map(|i| [0.2 + 0.1 * (i % 7) as f32, 0.5, 0.05 * (i / 8) as f32]).collect();
    let map = EnvironmentMap::new(8, 4, texels).unwrap();
    Light::Environment(Environment::new(map.into(), 1.5, glam::DMat3::from_rotation_y(0.7)))
}

/// Values, then derivatives.
fn numbers(projected: &Projected) -> Vec<f64> {
    let gradient = projected.gradient.iter().flatten().flatten();
    projected.value.iter().chain(gradient).flat_map(|v| v.to_array()).collect()
}

/// Values of an order alone, and with their derivatives.
const VALUES: usize = 3 * ORDER * ORDER;
const ALL: usize = 4 * VALUES;

/// Mean square and largest of the differences in their standard errors, of so many numbers of each probe.
fn scores(gpu: &[Estimate<Projected>], cpu: &[(Vec<f64>, Vec<f64>)], count: usize) -> (f64, f64) {
    let mut scores = Vec::new();
    for (gpu, (value, error)) in gpu.iter().zip(cpu) {
        let (own, own_error) = (numbers(&gpu.value), numbers(&gpu.standard_error));
        assert_eq!(own.len(), value.len());
        for k in 0..count {
            // 1e-6: the light's roundings in f32, where hardly anything is drawn at random
            let sigma = own_error[k].hypot(error[k]).max(1e-6 * value[k].abs().max(1.0));
            scores.push((own[k] - value[k]) / sigma);
        }
    }
    let square = scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64;
    (square, scores.iter().fold(0.0, |most, z| most.max(z.abs())))
}

fn on_the_cpu(lights: &[Light<f64>], effects: Effects) -> Vec<(Vec<f64>, Vec<f64>)> {
    let tracer = Tracer::new(&room());
    let transport = Transport::new(&tracer, lights, effects);
    let seed = Seed { seed: 5, purpose: StreamPurpose::Test };
    let estimates = transport.projection(&places(), ORDER, true, seed, Effort::Samples(PATHS));
    estimates.into_iter().map(|e| (numbers(&e.value), numbers(&e.standard_error))).collect()
}

fn closed_forms(lights: &[Light<f64>]) -> Vec<(Vec<f64>, Vec<f64>)> {
    let exact = |p: &DVec3| {
        let exact = rigbench::light::projection_with_gradient::<f64, 9>(lights, Vector3::of(*p)).value;
        let numbers: Vec<f64> =
            exact.value.iter().chain(exact.gradient.iter().flatten()).flat_map(|v| v.to_array()).collect();
        let none = vec![0.0; numbers.len()];
        (numbers, none)
    };
    places().iter().map(exact).collect()
}

fn traced(tracer: &ProbeTracer, places: &[DVec3]) -> Vec<Estimate<Projected>> {
    let found = tracer.trace(places, ORDER, true, Effort::Samples(PATHS)).unwrap();
    found.into_iter().map(|estimate| estimate.light).collect()
}

fn honest((square, largest): (f64, f64)) -> bool {
    square < 1.8 && largest < 6.0
}

#[test]
fn probes_traced_on_the_gpu_agree_with_the_cpu() {
    on_gpu("probes_traced_on_the_gpu_agree_with_the_cpu", |gpu| {
        let (room, lights) = (room(), lights());
        let shader = include_str!("../../src/gpu/passes/trace_probes.wgsl");
        for effects in [
            Effects::NONE,
            Effects::SHADOWS,
            Effects::bounces(Bounces::Count(0)),
            Effects::bounces(Bounces::Count(1)),
            Effects::bounces(Bounces::Count(2)),
            Effects::bounces(Bounces::Infinite),
        ] {
            // what a derivative at fixed visibility is hangs on how samples of a light move, where it is half hidden: there values alone
            let (expected, count) = match effects == Effects::NONE {
                true => (closed_forms(&lights), ALL),
                false => (on_the_cpu(&lights, effects), VALUES),
            };
            let tracer = ProbeTracer::new(gpu, &room, &lights, effects, 11).unwrap();
            let found = traced(&tracer, &places());
            let z = scores(&found, &expected, count);
            println!("{effects}: {z:?}");
            assert!(honest(z), "{effects}: {z:?}");
            let broken = |right: &str, wrong: &str, lights: &[Light<f64>]| {
                let broken = shader.replacen(right, wrong, 1);
                assert_ne!(broken, shader, "`{right}` is not in the shader");
                let tracer = ProbeTracer::with_model(gpu, &room, lights, effects, 11, &broken).unwrap();
                traced(&tracer, &places())
            };
            // emission and reflected light: places on surfaces stay, on both
            if effects.bounces.is_some() {
                let expected = on_the_cpu(&[], effects);
                let tracer = ProbeTracer::new(gpu, &room, &[], effects, 11).unwrap();
                let z = scores(&traced(&tracer, &places()), &expected, ALL);
                println!("{effects}, surfaces alone: {z:?}");
                assert!(honest(z), "{effects}, surfaces alone: {z:?}");
                // what surfaces emit is drawn on them, what they reflect comes along directions
                if effects.most_bounces() != Some(0) {
                    let wrong = broken("vec4f(direction, from_surface)", "vec4f(direction, -1.0)", &[]);
                    let z = scores(&wrong, &expected, ALL);
                    assert!(!honest(z), "surfaces that stand nowhere pass with {z:?}");
                }
            }
            // a probe's paths are its own: another order, other company, the same bits
            if effects == Effects::SHADOWS {
                let [a, b, _] = places();
                let again = traced(&tracer, &[b, a]);
                assert_eq!((&again[0], &again[1]), (&found[1], &found[0]));
                let other = ProbeTracer::new(gpu, &room, &lights, effects, 12).unwrap();
                assert_ne!(found[0], traced(&other, &[a])[0]);
                // and what was not called for was not done
                let counted = found[0].counters;
                assert_eq!((counted.bounces, counted.emitter_samples), (0, 0));
                assert!(counted.shadow_rays > 0 && counted.shadow_rays <= 2 * PATHS);
            }
            if effects == Effects::NONE {
                let counted = found[0].counters;
                assert_eq!((counted.rays(), counted.bounces, counted.emitter_samples), (0, 0, 0));
                let wrong = broken("vec4f(light.direction, from_light)", "vec4f(light.direction, -1.0)", &lights);
                let z = scores(&wrong, &expected, ALL);
                assert!(!honest(z), "lights that stand nowhere pass with {z:?}");
            }
            if effects == Effects::bounces(Bounces::Count(2)) {
                assert!(found[0].counters.bounces <= 2 * PATHS && found[0].counters.closest_rays <= 3 * PATHS);
                for (right, wrong) in [
                    ("sum += throughput * direct(s, start) / PI;", "sum += throughput * direct(s, start) / 2.6;"),
                    ("s.emission * power_heuristic(pdf, drawn)", "s.emission"),
                    ("throughput *= s.albedo;", "throughput *= s.albedo * 1.3;"),
                    ("select(-outward, outward, front)", "outward"),
                    ("strength * (2.0 * PI * height)", "strength * (PI * height)"),
                    ("scene[shares + light].x - below", "scene[shares + light].x"),
                ] {
                    let z = scores(&broken(right, wrong, &lights), &expected, VALUES);
                    assert!(!honest(z), "`{wrong}` passes with {z:?}");
                }
            }
        }
    });
}

/// A court of 4 x 4 m between walls 2 m high, open to the sky.
fn court() -> TracedGeometry {
    let wall = |r: f64, g: f64, b: f64| TracedMaterial { albedo: Rgb::new(r, g, b), emission: Rgb::zero() };
    let mut court = TracedGeometry::default();
    let (x, y, z) = (DVec3::X * 2.0, DVec3::Y, DVec3::Z * 2.0);
    court.add_quad(wall(0.6, 0.6, 0.6), -y, z, x);
    for (out, along, colour) in [
        (x, z, wall(0.7, 0.3, 0.2)),
        (-x, -z, wall(0.3, 0.6, 0.3)),
        (z, -x, wall(0.5, 0.5, 0.7)),
        (-z, x, wall(0.7, 0.7, 0.5)),
    ] {
        court.add_quad(colour, out, along, y);
    }
    court
}

/// A dim sky with a sun of 0.006 sr, which sends half of all light.
fn sun_and_sky() -> Light<f64> {
    let (width, height) = (64, 32);
    let mut texels: Vec<[f32; 3]> = (0..width * height).map(|i| [0.2, 0.3, 0.4 + 0.01 * (i % 5) as f32]).collect();
    texels[6 * width + 20] = [900.0, 800.0, 600.0];
    let map = EnvironmentMap::new(width, height, texels).unwrap();
    Light::Environment(Environment::new(map.into(), 0.8, glam::DMat3::from_rotation_y(0.7)))
}

#[test]
fn environment_maps_are_drawn_from_on_the_gpu_as_on_the_cpu() {
    on_gpu("environment_maps_are_drawn_from_on_the_gpu_as_on_the_cpu", |gpu| {
        let court = court();
        let places = [DVec3::new(-0.5, 0.3, 0.2), DVec3::new(1.6, -0.7, 0.4), DVec3::new(0.2, 1.6, -1.0)];
        // alone, and beside a lamp with which it shares the draws
        let lamp = Light::Sphere(Sphere {
            center: Vector3::new(1.2, 0.3, -1.0),
            radius: 0.3,
            radiance: Rgb::new(4.0, 1.0, 2.0),
        });
        let shader = include_str!("../../src/gpu/passes/trace_probes.wgsl");
        let with = |changes: &[(&str, &str)]| {
            changes.iter().fold(shader.to_owned(), |text, (right, wrong)| {
                assert!(text.contains(right), "`{right}` is not in the shader");
                text.replacen(right, wrong, 1)
            })
        };
        // texels drawn evenly, whatever they send: right on the mean, and what importance sampling is held against
        let evenly = with(&[
            ("first_above(rows, size.y, 0u, v)", "min(u32(v * f32(size.y)), size.y - 1u)"),
            ("first_above(texels, size.x, 3u, u)", "min(u32(u * f32(size.x)), size.x - 1u)"),
            (
                "(power / (radiance.x + radiance.y + radiance.z))",
                "(power / scene[LIGHTS + 4u * picked_light + 3u].x * 4.0 * PI * f32(size.y) * (band.z - band.y))",
            ),
        ]);
        for (lights, effects) in [
            (vec![sun_and_sky()], Effects::SHADOWS),
            (vec![sun_and_sky()], Effects::bounces(Bounces::Count(1))),
            (vec![lamp, sun_and_sky()], Effects::bounces(Bounces::Count(2))),
        ] {
            let cpu = Tracer::new(&court);
            let seed = Seed { seed: 5, purpose: StreamPurpose::Test };
            let cpu =
                Transport::new(&cpu, &lights, effects).projection(&places, ORDER, true, seed, Effort::Samples(PATHS));
            let expected: Vec<_> = cpu.iter().map(|e| (numbers(&e.value), numbers(&e.standard_error))).collect();
            let on_the_gpu = |model: &str| {
                let tracer = ProbeTracer::with_model(gpu, &court, &lights, effects, 4, model).unwrap();
                traced(&tracer, &places)
            };
            let error = |estimates: &[Estimate<Projected>]| {
                let errors = estimates.iter().flat_map(|e| numbers(&e.standard_error)[..VALUES].to_vec());
                (errors.map(|e| e * e).sum::<f64>() / (estimates.len() * VALUES) as f64).sqrt()
            };
            let found = on_the_gpu(shader);
            let z = scores(&found, &expected, VALUES);
            let ratio = error(&found) / error(&cpu);
            let even = on_the_gpu(&evenly);
            let (even_z, even_ratio) = (scores(&even, &expected, VALUES), error(&even) / error(&cpu));
            println!("{effects}: {z:?}, {ratio} times the CPU's error; texels drawn evenly: {even_z:?}, {even_ratio}");
            assert!(honest(z), "{effects}: {z:?}");
            assert!(ratio < 3.0, "{effects}: {ratio} times the CPU's error");
            assert!(even_ratio > 3.0 * ratio, "{effects}: drawn evenly {even_ratio} times the CPU's error");
            if effects != Effects::bounces(Bounces::Count(1)) {
                continue;
            }
            for (right, wrong) in [
                ("(power / (radiance.x", "(0.9 * power / (radiance.x"),
                ("(power / (radiance.x + radiance.y", "(power / (radiance.x"),
                ("f32(size.x) - 0.5)", "f32(size.x))"),
                ("band.w * (1.0 - 2.0 * lift)", "1.0 - 2.0 * lift"),
            ] {
                let z = scores(&on_the_gpu(&with(&[(right, wrong)])), &expected, VALUES);
                assert!(!honest(z), "{effects}: `{wrong}` passes with {z:?}");
            }
        }
    });
}

#[test]
fn environment_maps_light_probes_on_the_gpu_as_on_the_cpu() {
    on_gpu("environment_maps_light_probes_on_the_gpu_as_on_the_cpu", |gpu| {
        // beside another light, so that it has its place among several; and a black one, of which nothing is drawn
        let black = EnvironmentMap::new(4, 2, vec![[0.0; 3]; 8]).unwrap();
        let black = Light::Environment(Environment::new(black.into(), 1.0, glam::DMat3::IDENTITY));
        let lights = [lights().remove(0), black, sky()];
        let shader = include_str!("../../src/gpu/passes/trace_probes.wgsl");
        for effects in [Effects::NONE, Effects::SHADOWS, Effects::bounces(Bounces::Count(1))] {
            let (expected, count) = match effects == Effects::NONE {
                true => (closed_forms(&lights), ALL),
                false => (on_the_cpu(&lights, effects), VALUES),
            };
            let found = traced(&ProbeTracer::new(gpu, &room(), &lights, effects, 4).unwrap(), &places());
            let z = scores(&found, &expected, count);
            println!("{effects}: {z:?}");
            assert!(honest(z), "{effects}: {z:?}");
            let (right, wrong) = ("first_above(rows, size.y, 0u, v)", "first_above(rows, size.y, 0u, 0.7 * v)");
            let broken = shader.replacen(right, wrong, 1);
            assert_ne!(broken, shader, "`{right}` is not in the shader");
            let tracer = ProbeTracer::with_model(gpu, &room(), &lights, effects, 4, &broken).unwrap();
            let z = scores(&traced(&tracer, &places()), &expected, count);
            assert!(!honest(z), "{effects}: `{wrong}` passes with {z:?}");
        }
    });
}

#[test]
fn directions_of_the_gpu_tell_depths() {
    on_gpu("directions_of_the_gpu_tell_depths", |gpu| {
        // and the same with a sheet that lies there two hundred times: no tree of neighbours is shallow then
        let mut crowded = room();
        let grey = TracedMaterial { albedo: Rgb::splat(0.5), emission: Rgb::zero() };
        (0..200).for_each(|_| crowded.add_quad(grey, DVec3::new(-0.4, -0.3, 0.7), DVec3::X * 1.1, DVec3::Y));
        for geometry in [room(), crowded] {
            let tracer = ProbeTracer::new(gpu, &geometry, &[], Effects::bounces(Bounces::Count(0)), 2).unwrap();
            let found = tracer.trace(&places(), 1, false, Effort::Samples(4 * PATHS)).unwrap();
            let cpu = Tracer::new(&geometry);
            for (place, found) in places().into_iter().zip(&found) {
                let truth = depths(&cpu, place, &texels(64), |_| ());
                // 30,000 directions: half a percent
                assert!((found.harmonic_mean / truth.harmonic_mean - 1.0).abs() < 0.02, "{found:?} for {truth:?}");
                assert!((found.minimum / truth.minimum - 1.0).abs() < 0.02, "{found:?} for {truth:?}");
            }
            assert!(
                found[0].harmonic_mean.is_finite()
                    && (found[0].harmonic_mean / found[2].harmonic_mean - 1.0).abs() > 0.1
            );
        }
    });
}

#[test]
fn a_furnace_on_the_gpu_glows_as_the_series_says() {
    on_gpu("a_furnace_on_the_gpu_glows_as_the_series_says", |gpu: &Gpu| {
        let mut furnace = TracedGeometry::default();
        let material = TracedMaterial { albedo: Rgb::splat(0.6), emission: Rgb::splat(1.0) };
        for (out, u, v) in
            [(DVec3::X, DVec3::Y, DVec3::Z), (DVec3::Y, DVec3::Z, DVec3::X), (DVec3::Z, DVec3::X, DVec3::Y)]
        {
            furnace.add_quad(material, out, v, u);
            furnace.add_quad(material, -out, u, v);
        }
        // of a closed room every place says the same: eight together
        let places: Vec<DVec3> = (0..8).map(|k| DVec3::new(0.3, -0.2, 0.5) * (f64::from(k) * 0.2 - 0.7)).collect();
        for (effects, expected) in [
            (Effects::bounces(Bounces::Count(0)), 1.0),
            (Effects::bounces(Bounces::Count(1)), 1.6),
            (Effects::bounces(Bounces::Count(2)), 1.96),
            (Effects::bounces(Bounces::Count(3)), 2.176),
            (Effects::bounces(Bounces::Infinite), 2.5),
        ] {
            let tracer = ProbeTracer::new(gpu, &furnace, &[], effects, 3).unwrap();
            let found = tracer.trace(&places, 1, false, Effort::Samples(4 * PATHS)).unwrap();
            // radiance L everywhere has L_0 = L sqrt(4 pi)
            let scale = 1.0 / ((4.0 * PI).sqrt() * places.len() as f64);
            let value = found.iter().map(|e| e.light.value.value[0].g).sum::<f64>() * scale;
            let error = found.iter().map(|e| e.light.standard_error.value[0].g.powi(2)).sum::<f64>().sqrt() * scale;
            println!("{effects}: {value} +- {error} for {expected}");
            assert!((value - expected).abs() < 4.0 * error, "{value} +- {error} for {expected}");
            // one percent more or less would have been seen
            for planted in [0.99, 1.01] {
                assert!(
                    (value * planted - expected).abs() > 4.0 * error,
                    "{effects}: {value} +- {error}, times {planted}"
                );
            }
        }
        // until an error is reached: no more than that takes, and it is reached
        let tracer = ProbeTracer::new(gpu, &furnace, &[], Effects::bounces(Bounces::Count(1)), 3).unwrap();
        let effort = |relative| Effort::Error { relative, most_samples: 100_000, deadline: None };
        let [rough, fine] =
            [0.004, 0.002].map(|relative| tracer.trace(&places[..2], 1, false, effort(relative)).unwrap());
        for (found, relative) in [(&rough, 0.004), (&fine, 0.002)] {
            for estimate in found.iter().map(|e| &e.light) {
                let share = estimate.standard_error.value[0].g / estimate.value.value[0].g;
                assert!(share <= relative && share > 0.3 * relative, "{share} where {relative} was asked for");
            }
        }
        assert!(fine[0].light.samples >= 2 * rough[0].light.samples);
    });
}

#[test]
fn volumes_of_probes_traced_on_the_gpu_are_those_of_the_cpu() {
    use rigbench::probe::{GradientSource, Prober, Probes};
    use rigbench::scene::OrientedBox;
    use rigbench::sh::Window;
    use rigbench::volume::{BakedVolume, Volume, bake};
    on_gpu("volumes_of_probes_traced_on_the_gpu_are_those_of_the_cpu", |gpu| {
        let (tracer, lights) = (Tracer::new(&room()), lights());
        let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(1)));
        let device = ProbeTracer::of_transport(gpu, &transport, 3).unwrap();
        let table = "grid = { bounds = \"room\", samples = [3, 3, 3], interpolation = \"half_gradient\" }";
        let volume = Volume::inline(table).unwrap();
        let prober = Prober {
            bounds: OrientedBox::aligned(DVec3::new(-1.1, -0.9, -1.4), DVec3::new(0.1, 0.6, 2.0)),
            order: 2,
            lights: &lights,
            transport: Some(&transport),
            device: Some(&device),
            probes: Probes::TracedOnGpu { effort: Effort::Samples(4096), seed: 3 },
            gradients: GradientSource::Analytic,
            window: Window::None,
        };
        let baked = |prober: &Prober| bake(&volume, prober).unwrap();
        let on_gpu = baked(&prober);
        assert_eq!(on_gpu.values, baked(&prober).values, "the same bits");
        assert!(on_gpu.counts.rays.closest_rays >= 27 * 4096 && on_gpu.counts.rays.bounces > 0);
        let cpu = baked(&Prober { probes: Probes::Traced { effort: Effort::Samples(4096), seed: 3 }, ..prober });
        let rms = |data: &mut dyn Iterator<Item = f64>| data.map(|v| v * v).sum::<f64>().sqrt();
        let apart = |a: &[f64], b: &[f64]| rms(&mut a.iter().zip(b).map(|(a, b)| a - b)) / rms(&mut b.iter().copied());
        let slopes = |volume: &BakedVolume| volume.slopes.as_ref().unwrap().data.clone();
        let (values, derivatives) =
            (apart(&on_gpu.values.data, &cpu.values.data), apart(&slopes(&on_gpu), &slopes(&cpu)));
        println!("values {values}, derivatives {derivatives}");
        assert!(values < 0.06 && derivatives < 0.3, "values {values}, derivatives {derivatives}");
        // central differences: six more samples each, and noise over the step
        let central = baked(&Prober { gradients: GradientSource::Central { step: 0.2 }, ..prober });
        assert!(central.counts.rays.closest_rays >= 7 * 27 * 4096);
        assert!(apart(&slopes(&central), &slopes(&cpu)) < 1.0 && apart(&slopes(&central), &slopes(&cpu)) > 0.0);
        // no device, no samples, and it says why
        let missing = bake(&volume, &Prober { device: None, ..prober }).unwrap_err().to_string();
        assert!(missing.contains("GPU"), "{missing}");
    });
}
