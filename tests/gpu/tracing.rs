//! Light traced to probes on the GPU against the CPU's tracer, and against what a furnace must give.

use std::f64::consts::PI;

use glam::DVec3;
use rigbench::gpu::{Gpu, ProbeEstimate, ProbeTracer};
use rigbench::light::{
    Constant, Directional, Disk, Environment, EnvironmentMap, Light, Point, Polygon, Rect, Sphere, Tube,
};
use rigbench::math::{Rgb, StreamPurpose, Vector3};
use rigbench::trace::{Bounces, Effects, Effort, Seed, TracedGeometry, TracedMaterial, Tracer, Transport};

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

/// A coarse map, turned.
pub fn sky() -> Light<f64> {
    let texels = (0..32).map(|i| [0.2 + 0.1 * (i % 7) as f32, 0.5, 0.05 * (i / 8) as f32]).collect();
    let map = EnvironmentMap::new(8, 4, texels).unwrap();
    Light::Environment(Environment::new(map.into(), 1.5, glam::DMat3::from_rotation_y(0.7)))
}

pub fn places() -> [DVec3; 3] {
    // beside the block and behind it; in the open end
    [DVec3::new(-0.5, -0.6, 0.2), DVec3::new(1.3, -1.2, 0.4), DVec3::new(0.2, 0.3, 2.2)]
}

/// Mean square and largest of the differences in their standard errors.
fn scores(gpu: &[ProbeEstimate], cpu: &[(Vec<Rgb<f64>>, Vec<Rgb<f64>>)]) -> (f64, f64) {
    let mut scores = Vec::new();
    for (gpu, (value, error)) in gpu.iter().zip(cpu) {
        for i in 0..value.len() {
            let off = (gpu.value[i] - value[i]).to_array();
            let errors = (gpu.standard_error[i].to_array(), error[i].to_array());
            for channel in 0..3 {
                let sigma = errors.0[channel].hypot(errors.1[channel]).max(1e-9);
                scores.push(off[channel] / sigma);
            }
        }
    }
    let square = scores.iter().map(|z| z * z).sum::<f64>() / scores.len() as f64;
    (square, scores.iter().fold(0.0, |most, z| most.max(z.abs())))
}

fn on_the_cpu(effects: Effects) -> Vec<(Vec<Rgb<f64>>, Vec<Rgb<f64>>)> {
    let (tracer, lights) = (Tracer::new(&room()), lights());
    let transport = Transport::new(&tracer, &lights, effects);
    let seed = Seed { seed: 5, purpose: StreamPurpose::Test };
    let estimates = transport.projection(&places(), ORDER, false, seed, Effort::Samples(PATHS));
    estimates.into_iter().map(|e| (e.value.value, e.standard_error.value)).collect()
}

fn honest((square, largest): (f64, f64)) -> bool {
    square < 1.8 && largest < 4.5
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
            Effects::bounces(Bounces::Count(2)),
            Effects::bounces(Bounces::Infinite),
        ] {
            let expected = match effects == Effects::NONE {
                // the closed forms
                true => places()
                    .iter()
                    .map(|p| {
                        let exact = rigbench::light::projection::<f64, 9>(&lights, Vector3::of(*p)).value;
                        (exact.to_vec(), vec![Rgb::zero(); 9])
                    })
                    .collect(),
                false => on_the_cpu(effects),
            };
            let tracer = ProbeTracer::new(gpu, &room, &lights, effects, 11).unwrap();
            let found = tracer.trace(&places(), ORDER, PATHS).unwrap();
            let z = scores(&found, &expected);
            println!("{effects}: {z:?}");
            assert!(honest(z), "{effects}: {z:?}");
            // a probe's paths are its own: another order, other company, the same bits
            if effects == Effects::SHADOWS {
                let [a, b, _] = places();
                let again = tracer.trace(&[b, a], ORDER, PATHS).unwrap();
                assert_eq!((&again[0], &again[1]), (&found[1], &found[0]));
                assert_ne!(
                    found[0],
                    ProbeTracer::new(gpu, &room, &lights, effects, 12).unwrap().trace(&[a], ORDER, PATHS).unwrap()[0]
                );
            }
            if effects == Effects::bounces(Bounces::Count(2)) {
                for (right, wrong) in [
                    ("sum += throughput * direct(s, start) / PI;", "sum += throughput * direct(s, start) / 2.6;"),
                    ("s.emission * power_heuristic(pdf, drawn)", "s.emission"),
                    ("throughput *= s.albedo;", "throughput *= s.albedo * 1.3;"),
                    ("select(-outward, outward, front)", "outward"),
                    ("strength * (2.0 * PI * height)", "strength * (PI * height)"),
                ] {
                    let broken = shader.replacen(right, wrong, 1);
                    assert_ne!(broken, shader, "`{right}` is not in the shader");
                    let tracer = ProbeTracer::with_model(gpu, &room, &lights, effects, 11, &broken).unwrap();
                    let z = scores(&tracer.trace(&places(), ORDER, PATHS).unwrap(), &expected);
                    assert!(!honest(z), "`{wrong}` passes with {z:?}");
                }
            }
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
        let place = [DVec3::new(0.3, -0.2, 0.5)];
        for (effects, expected) in [
            (Effects::bounces(Bounces::Count(0)), 1.0),
            (Effects::bounces(Bounces::Count(3)), 1.0 + 0.6 + 0.36 + 0.216),
            (Effects::bounces(Bounces::Infinite), 2.5),
        ] {
            let tracer = ProbeTracer::new(gpu, &furnace, &[], effects, 3).unwrap();
            let found = tracer.trace(&place, 1, 4 * PATHS).unwrap().remove(0);
            // radiance L everywhere has L_0 = L sqrt(4 pi)
            let (value, error) = (found.value[0].g / (4.0 * PI).sqrt(), found.standard_error[0].g / (4.0 * PI).sqrt());
            println!("{effects}: {value} +- {error} for {expected}");
            assert!(
                (value - expected).abs() < 4.0 * error && error < 0.02 * expected,
                "{value} +- {error} for {expected}"
            );
        }
        // an environment map in the open, against its closed form
        let sky = sky();
        let exact = rigbench::light::projection::<f64, 9>(&[sky.clone()], Vector3::of(place[0])).value;
        let found = ProbeTracer::new(gpu, &TracedGeometry::default(), &[sky], Effects::NONE, 5)
            .unwrap()
            .trace(&place, ORDER, 4 * PATHS)
            .unwrap();
        let z = scores(&found, &[(exact.to_vec(), vec![Rgb::zero(); 9])]);
        assert!(honest(z), "{z:?}");
    });
}
