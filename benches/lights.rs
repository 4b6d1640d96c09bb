//! Projection of lights: `cargo bench --bench lights`.
//!
//! Batched spheres (2,000 spheres into an 8x8x8 lattice with gradients) in lights x samples a second on one core, against seven
//! value-only projections by the same kernel (what central differences take) and against one light at a point at a time;
//! then every area shape's projection with gradient, one at a time, at orders 3 and 6; irradiance of a disk by each of its formulas; and the same
//! spheres into the same lattice on the GPU, if there is one (a software adapter is named as such: its times are no GPU's). Variants are timed in turn; medians.

use std::hint::black_box;
use std::time::Instant;

use glam::DVec3;
use rigbench::gpu::{AdapterKind, Gpu, SphereProjector};
use rigbench::light::{
    DIRECT_ORDER, Disk, Light, LightModel, LightShape, ModelledLight, Polygon, Rect, ShGradient, Sphere, SphereBatch,
    Tube,
};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::sh::{Lobe, ShRgb};

const REPEATS: usize = 15;
const LIGHTS: usize = 2000;
const LATTICE: usize = 8;

fn spheres() -> Vec<Sphere<f32>> {
    let mut stream = Stream::indexed(1, StreamPurpose::Test, 1);
    (0..LIGHTS)
        .map(|_| {
            let radius = stream.uniform_between(0.05, 0.4);
            Sphere {
                center: Vector3::of(stream.direction() * stream.uniform_between(2.5, 8.0)),
                radius: radius as f32,
                radiance: Rgb::of([stream.uniform(), stream.uniform(), stream.uniform()]),
            }
        })
        .collect()
}

fn lattice() -> Vec<Vector3<f32>> {
    let at = |i: usize| 2.0 * i as f32 / (LATTICE - 1) as f32 - 1.0;
    (0..LATTICE.pow(3))
        .map(|i| Vector3::new(at(i % LATTICE), at(i / LATTICE % LATTICE), at(i / LATTICE / LATTICE)))
        .collect()
}

/// Median seconds of each variant; variants take turns.
fn medians(variants: &mut [&mut dyn FnMut()]) -> Vec<f64> {
    let mut seconds = vec![Vec::new(); variants.len()];
    for round in 0..REPEATS + 1 {
        for (variant, seconds) in variants.iter_mut().zip(&mut seconds) {
            let start = Instant::now();
            variant();
            // the first round warms up
            if round > 0 {
                seconds.push(start.elapsed().as_secs_f64());
            }
        }
    }
    let median = |mut s: Vec<f64>| {
        s.sort_by(f64::total_cmp);
        s[s.len() / 2]
    };
    seconds.into_iter().map(median).collect()
}

fn batched<const C: usize>(order: usize) {
    let (spheres, points) = (spheres(), lattice());
    let batch = SphereBatch::new(&spheres);
    let mut gradients = vec![ShGradient::<f32, C>::zero(); points.len()];
    let mut portable = gradients.clone();
    let mut values: Vec<ShRgb<f32, C>> = vec![[Rgb::zero(); C]; points.len()];
    let h = 0.01;
    let moved: Vec<Vec<Vector3<f32>>> =
        [[0.0; 3], [h, 0.0, 0.0], [-h, 0.0, 0.0], [0.0, h, 0.0], [0.0, -h, 0.0], [0.0, 0.0, h], [0.0, 0.0, -h]]
            .iter()
            .map(|step| points.iter().map(|p| *p + Vector3::from_array(*step)).collect())
            .collect();
    let lights: Vec<Light<f32>> = spheres.iter().take(50).cloned().map(Light::Sphere).collect();
    let seconds = medians(&mut [
        &mut || {
            batch.projection_with_gradient::<C>(black_box(&points), &mut gradients);
        },
        &mut || {
            for points in &moved {
                batch.projection::<C>(black_box(points), &mut values);
                black_box(&values);
            }
        },
        &mut || batch.portable_projection_with_gradient::<C>(black_box(&points), &mut portable),
        &mut || {
            for p in &points {
                black_box(rigbench::light::projection_with_gradient::<f32, C>(&lights, black_box(*p)));
            }
        },
    ]);
    assert_eq!(gradients, portable, "the kernels' bits");
    let pairs = (LIGHTS * points.len()) as f64;
    let single = seconds[3] / (lights.len() * points.len()) as f64;
    println!(
        "order {order}: batch {:.1} M lights x samples/s; seven projections take {:.2} times as long; without AVX2 {:.2}; one at a time {:.2} ({:.0} ns)",
        pairs / seconds[0] / 1e6,
        seconds[1] / seconds[0],
        seconds[2] / seconds[0],
        single / (seconds[0] / pairs),
        single * 1e9
    );
}

fn shapes() -> Vec<Light<f64>> {
    let radiance = Rgb::splat(1.0);
    let corner = |x: f64, y: f64| DVec3::new(x, y, 2.0);
    let polygon = [corner(0.0, 0.0), corner(0.2, 0.5), corner(0.6, 0.6), corner(0.7, 0.1), corner(0.4, -0.1)];
    vec![
        Light::Sphere(Sphere { center: Vector3::new(0.3, 0.2, 2.0), radius: 0.3, radiance }),
        Light::Disk(Disk {
            center: Vector3::new(0.3, 0.2, 2.0),
            normal: Vector3::new(0.0, 0.0, -1.0),
            radius: 0.4,
            radiance,
        }),
        Light::Rect(Rect::new(DVec3::new(0.3, 0.2, 2.0), DVec3::Y * 0.3, DVec3::X * 0.4, radiance).expect("an area")),
        Light::Polygon(Polygon::new(&polygon, radiance).expect("convex")),
        Light::Tube(Tube { from: Vector3::new(-0.5, 0.2, 2.0), to: Vector3::new(0.7, 0.3, 2.0), intensity: radiance }),
    ]
}

fn one_at_a_time() {
    let points = lattice();
    for light in shapes() {
        let single = light.relative_to::<f32>(DVec3::ZERO);
        let doubles: Vec<Vector3<f64>> = points.iter().map(|p| Vector3::of(p.to_double())).collect();
        let seconds = medians(&mut [
            &mut || {
                points.iter().for_each(|p| {
                    black_box(single.projection_with_gradient::<9>(black_box(*p)));
                })
            },
            &mut || {
                points.iter().for_each(|p| {
                    black_box(single.projection_with_gradient::<36>(black_box(*p)));
                })
            },
            &mut || {
                doubles.iter().for_each(|p| {
                    black_box(light.projection_with_gradient::<9>(black_box(*p)));
                })
            },
            &mut || {
                doubles.iter().for_each(|p| {
                    black_box(light.projection_with_gradient::<36>(black_box(*p)));
                })
            },
        ]);
        let each: Vec<String> = seconds.iter().map(|s| format!("{:.0}", s / points.len() as f64 * 1e9)).collect();
        println!(
            "{}: SH with gradient, ns a light and sample: f32 order 3 {}, order 6 {}; f64 order 3 {}, order 6 {}",
            light.kind_name(),
            each[0],
            each[1],
            each[2],
            each[3]
        );
    }
}

/// Irradiance of one disk at points half a radius to eight radii away, all normals.
fn disk_formulas() {
    let mut stream = Stream::indexed(2, StreamPurpose::Test, 1);
    let receivers: Vec<(Vector3<f32>, Vector3<f32>)> = (0..20_000)
        .map(|_| {
            let place = stream.direction() * stream.uniform_between(0.5, 8.0);
            (Vector3::of(DVec3::new(place.x, place.y, place.z.abs())), Vector3::of(stream.direction()))
        })
        .collect();
    let disk =
        Disk { center: Vector3::zero(), normal: Vector3::new(0.0, 0.0, 1.0), radius: 1.0, radiance: Rgb::splat(1.0) };
    let words = ["exact", "wallace", "sphere_proxy", "table"];
    let lights: Vec<ModelledLight<f32>> = words
        .iter()
        .map(|word| LightModel::named(word).expect("a word").light(Light::Disk(disk.clone()), DIRECT_ORDER))
        .collect();
    let lobe = Lobe::lambert();
    let mut runs: Vec<Box<dyn FnMut() + '_>> = lights
        .iter()
        .map(|light| {
            let (lobe, receivers) = (&lobe, &receivers);
            Box::new(move || {
                for (p, n) in receivers {
                    black_box(light.irradiance(black_box(*p), *n, lobe));
                }
            }) as Box<dyn FnMut()>
        })
        .collect();
    let mut variants: Vec<&mut dyn FnMut()> = runs.iter_mut().map(|run| &mut **run as &mut dyn FnMut()).collect();
    let seconds = medians(&mut variants);
    let each: Vec<String> = words
        .iter()
        .zip(&seconds)
        .map(|(word, s)| format!("{word} {:.1} ns ({:.2})", s / receivers.len() as f64 * 1e9, s / seconds[0]))
        .collect();
    println!("disk: irradiance a light and point, f32, one core: {}", each.join(", "));
}

fn on_gpu() {
    let gpu = match Gpu::open(AdapterKind::Any) {
        Ok(gpu) => gpu,
        Err(why) => return println!("GPU: none: {why}"),
    };
    let (spheres, points) = (spheres(), lattice());
    for order in [3, 6] {
        let timed =
            SphereProjector::new(&gpu, order).and_then(|projector| projector.prepare(&spheres, &points)).and_then(
                |mut prepared| prepared.time(1, if gpu.adapter().label().contains("software") { 3 } else { REPEATS }),
            );
        match timed {
            Err(why) => println!("GPU order {order}: {why}"),
            Ok(timing) => {
                let median = {
                    let mut samples = timing.samples_ns_per_point.clone();
                    samples.sort_by(f64::total_cmp);
                    samples[samples.len() / 2]
                };
                println!(
                    "GPU order {order}: {:.1} M lights x samples/s with gradients, {} ({})",
                    LIGHTS as f64 / median * 1e3,
                    gpu.adapter().label(),
                    timing.timer.name()
                );
            }
        }
    }
}

fn main() {
    // `cargo test` runs benches too: there one small pass is enough to see that they work
    if std::env::args().any(|a| a == "--test") {
        return;
    }
    batched::<9>(3);
    batched::<36>(6);
    one_at_a_time();
    disk_formulas();
    on_gpu();
}
