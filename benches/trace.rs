//! What the path tracer makes of obvhs: its rays with all shading against a bare replay of the same rays, two cores against one, and
//! the projection with gradients against the rays that it comes from; and probes by the GPU, traced and captured, beside the CPU's.
//! `cargo bench --bench trace`. Ratios within one run; measurements that are compared take turns.

use std::hint::black_box;
use std::time::{Duration, Instant};

use glam::DVec3;
use obvhs::BvhBuildParams;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use rigbench::gpu::{AdapterKind, CubeCapturer, Gpu, GpuError, ProbeTracer};
use rigbench::light::{Light, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::probe::{CaptureTask, texels};
use rigbench::scene::SurfacePoint;
use rigbench::sh::Lobe;
use rigbench::trace::{
    Bounces, CapturePlace, CastRay, Counters, Effects, Effort, Reflected, Seed, TracedGeometry, TracedMaterial, Tracer,
    Transport, Visibility,
};

const SEED: Seed = Seed { seed: 1, purpose: StreamPurpose::Test };
const ROUNDS: usize = 40;

fn ball(center: DVec3, radius: f64, rings: usize) -> impl Iterator<Item = [DVec3; 3]> {
    let sectors = 2 * rings;
    let at = move |i: usize, j: usize| {
        let polar = std::f64::consts::PI * i as f64 / rings as f64;
        let azimuth = std::f64::consts::TAU * (j % sectors) as f64 / sectors as f64;
        // bumps, so that no two neighbours lie in a plane
        let bumpy = radius * (1.0 + 0.05 * (9.0 * polar).sin() * (7.0 * azimuth).cos());
        center + bumpy * DVec3::new(polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin())
    };
    (0..rings).flat_map(move |i| {
        (0..sectors)
            .flat_map(move |j| [[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]])
    })
}

/// A room with bumpy balls: 86 thousand triangles, half of every path within touch of them.
fn scene() -> TracedGeometry {
    let material = |albedo: f64| TracedMaterial { albedo: Rgb::splat(albedo), emission: Rgb::zero() };
    let mut geometry = TracedGeometry::default();
    let (x, y, z) = (DVec3::X * 3.0, DVec3::Y * 2.0, DVec3::Z * 3.0);
    for (center, u, v) in [(-x, y, z), (x, z, y), (-y, z, x), (y, x, z), (-z, x, y), (z, y, x)] {
        geometry.add_quad(material(0.6), center, u, v);
    }
    let mut stream = Stream::indexed(8, StreamPurpose::Test, 0);
    for _ in 0..30 {
        let center = DVec3::new(
            stream.uniform_between(-2.4, 2.4),
            stream.uniform_between(-1.5, 1.2),
            stream.uniform_between(-2.4, 2.4),
        );
        geometry.add(material(0.5), ball(center, stream.uniform_between(0.25, 0.6), 27));
    }
    geometry
}

fn lights() -> Vec<Light<f64>> {
    let sphere =
        |x, y, z, radius| Light::Sphere(Sphere { center: Vector3::new(x, y, z), radius, radiance: Rgb::splat(4.0) });
    vec![sphere(1.8, 1.7, -0.5, 0.2), sphere(-2.0, 1.6, 1.0, 0.15)]
}

fn points(count: usize) -> Vec<SurfacePoint> {
    let mut stream = Stream::indexed(9, StreamPurpose::Test, 0);
    (0..count)
        .map(|_| SurfacePoint {
            position: DVec3::new(
                stream.uniform_between(-2.5, 2.5),
                stream.uniform_between(-1.5, 1.5),
                stream.uniform_between(-2.5, 2.5),
            ),
            normal: stream.direction(),
        })
        .collect()
}

/// The fastest way that obvhs offers to cast rays at these triangles: its own triangle, in the order of the leaves.
struct Bare {
    bvh: obvhs::cwbvh::CwBvh,
    leaves: Vec<RtTriangle>,
}

impl Bare {
    fn new(geometry: &TracedGeometry) -> Self {
        let triangles: Vec<Triangle> = geometry
            .triangles
            .iter()
            .map(|t| t.map(|v| v.as_vec3a()))
            .map(|[v0, v1, v2]| Triangle { v0, v1, v2 })
            .collect();
        let bvh = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
        let leaves = bvh.primitive_indices.iter().map(|i| RtTriangle::from(&triangles[*i as usize])).collect();
        Self { bvh, leaves }
    }

    fn ray(ray: &CastRay) -> (Ray, bool) {
        let [origin, direction] = [ray.origin, ray.direction].map(|v| v.as_vec3a());
        let end = ray.within.map_or(f32::INFINITY, |d| d as f32);
        (Ray::new(origin, direction, 1e-4, end), ray.within.is_some())
    }

    /// How many of the rays met something.
    fn replay(&self, rays: &[(Ray, bool)]) -> usize {
        let mut met = 0;
        for (ray, any) in rays {
            let intersect = |ray: &Ray, leaf: usize| self.leaves[leaf].intersect(ray);
            met += usize::from(match any {
                true => !self.bvh.ray_traverse_miss(*ray, intersect),
                false => self.bvh.ray_traverse(*ray, &mut RayHit::none(), intersect),
            });
        }
        met
    }
}

/// Seconds that the processor has spent on this thread: what other programs take does not count. (The kernel's figure, Linux.)
fn processor_seconds() -> f64 {
    let text =
        std::fs::read_to_string("/proc/thread-self/schedstat").expect("a Linux kernel with scheduler statistics");
    text.split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).expect("nanoseconds first") * 1e-9
}

/// Shortest processor times of workloads that take turns on one thread, seconds: what they take when nothing else disturbs them.
fn shortest<const N: usize>(rounds: usize, works: [&(dyn Fn() + Sync); N]) -> [f64; N] {
    let thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut best = [f64::INFINITY; N];
    for _ in 0..rounds {
        for k in 0..N {
            let seconds = thread.install(|| {
                let start = processor_seconds();
                works[k]();
                processor_seconds() - start
            });
            best[k] = best[k].min(seconds);
        }
    }
    best
}

/// Shortest wall time of a workload on so many threads.
fn wall(rounds: usize, threads: usize, work: &(dyn Fn() + Sync)) -> f64 {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let timed = |_| {
        let start = Instant::now();
        pool.install(work);
        start.elapsed().as_secs_f64()
    };
    (0..rounds).map(timed).fold(f64::INFINITY, f64::min)
}

/// Prints a ratio beside what is asked of it; whether it holds.
fn holds(what: &str, ratio: f64, asked: f64, at_least: bool) -> bool {
    let good = if at_least { ratio >= asked } else { ratio <= asked };
    let word = if at_least { "at least" } else { "at most" };
    println!("{what}: {ratio:.3} ({word} {asked}) {}", if good { "ok" } else { "MISSED" });
    good
}

/// Probes of order 3 with gradients by the GPU, and by all cores of the CPU: paths traced, and texels of cube maps with the paths behind
/// them. Wall times of all that a bake waits for; nothing is asked of them.
fn probes_on_the_gpu(gpu: &Gpu, transport: &Transport, places: &[DVec3]) -> Result<(), GpuError> {
    const PATHS: u64 = 512;
    const TASK: CaptureTask = CaptureTask { face: 16, paths: 2, order: 3, gradient: true };
    let adapter = gpu.adapter().label();
    let cores = rayon::current_num_threads();
    let shortest = |work: &mut dyn FnMut() -> Result<Counters, GpuError>| -> Result<(f64, Counters), GpuError> {
        let mut counters = work()?;
        let mut best = f64::INFINITY;
        for _ in 0..3 {
            let start = Instant::now();
            counters = work()?;
            best = best.min(start.elapsed().as_secs_f64());
        }
        Ok((best, counters))
    };
    let line = |what: &str, by: &str, count: f64, unit: &str, (seconds, counters): (f64, Counters)| {
        println!(
            "{what} by {by}: {:.3} million {unit} a second, {:.2} million rays a second",
            count / seconds / 1e6,
            counters.rays() as f64 / seconds / 1e6
        );
    };
    let tracer = ProbeTracer::of_transport(gpu, transport, 1)?;
    let paths = places.len() as f64 * PATHS as f64;
    let effort = Effort::Samples(PATHS);
    let on_gpu = shortest(&mut || {
        Ok(tracer.trace(places, TASK.order, true, effort)?.iter().map(|estimate| estimate.light.counters).sum())
    })?;
    let on_cpu = shortest(&mut || {
        Ok(transport.projection(places, TASK.order, true, SEED, effort).iter().map(|estimate| estimate.counters).sum())
    })?;
    line("probes traced", &adapter, paths, "paths", on_gpu);
    line("probes traced", &format!("{cores} cores"), paths, "paths", on_cpu);

    let capturer = CubeCapturer::new(gpu, transport, 1)?;
    let places: Vec<CapturePlace> =
        places.iter().map(|place| CapturePlace { position: *place, numbers_of: *place }).collect();
    let directions: Vec<(DVec3, f64)> =
        texels(TASK.face as usize).iter().map(|texel| (texel.direction, texel.solid_angle)).collect();
    let count = (places.len() * directions.len()) as f64;
    let on_gpu = shortest(&mut || Ok(capturer.capture(&places, TASK)?.iter().map(|capture| capture.counters).sum()))?;
    let on_cpu = shortest(&mut || {
        let reflected = Reflected::Paths(TASK.paths);
        let captures = transport.capture(&places, &directions, TASK.order, TASK.gradient, reflected, SEED);
        Ok(captures.iter().map(|capture| capture.counters).sum())
    })?;
    line("probes captured", &adapter, count, "texels", on_gpu);
    line("probes captured", &format!("{cores} cores"), count, "texels", on_cpu);
    Ok(())
}

fn main() {
    let geometry = scene();
    println!("{} triangles", geometry.triangles.len());
    assert!(geometry.triangles.len() >= 80_000);
    let tracer = Tracer::new(&geometry);
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Infinite));
    let points = points(200);
    let lobe = Lobe::lambert();
    let samples = 256;

    let rays = transport.rays(&points, &lobe, SEED, samples);
    let bare = Bare::new(&geometry);
    let replayed: Vec<(Ray, bool)> = rays.iter().map(Bare::ray).collect();
    let visibility = Visibility::new(&geometry.triangles);
    let traced = transport.irradiance(&points, &lobe, SEED, Effort::Samples(samples));
    assert_eq!(traced.iter().map(|e| e.counters).sum::<Counters>().rays(), rays.len() as u64);
    let met = bare.replay(&replayed);
    let met_here = rays
        .iter()
        .filter(|ray| match ray.within {
            Some(within) => visibility.occluded_within(ray.origin, ray.direction, within),
            None => visibility.closest(ray.origin, ray.direction).is_some(),
        })
        .count();
    println!("{} rays, {met} meet something in the bare replay, {met_here} in the tracer", rays.len());
    assert!((met as f64 / met_here as f64 - 1.0).abs() < 1e-2, "not the same work");

    let mut all_hold = true;
    let few = &points[..20];
    let slice = transport.rays(few, &lobe, SEED, samples).len();
    let (rays, replayed) = (&rays[..slice], &replayed[..slice]);
    let [one, replay, watertight] = shortest(
        ROUNDS,
        [
            &|| {
                black_box(transport.irradiance(few, &lobe, SEED, Effort::Samples(samples)));
            },
            &|| {
                black_box(bare.replay(black_box(replayed)));
            },
            &|| {
                for ray in black_box(rays) {
                    black_box(match ray.within {
                        Some(within) => visibility.occluded_within(ray.origin, ray.direction, within),
                        None => visibility.closest(ray.origin, ray.direction).is_some(),
                    });
                }
            },
        ],
    );
    let million = slice as f64 / 1e6;
    println!(
        "million rays a second on one core: bare obvhs {:.2}, watertight {:.2}, with shading {:.2}",
        million / replay,
        million / watertight,
        million / one
    );
    all_hold &= holds("rays with shading over bare replay", replay / one, 0.6, true);

    // the projection's share: the same paths gathered as order 3 with gradients, and as one number a channel
    let places: Vec<DVec3> = few.iter().map(|p| p.position).collect();
    let project = |order, gradient| {
        black_box(transport.projection(&places, order, gradient, SEED, Effort::Samples(samples)));
    };
    let [with, without] = shortest(ROUNDS, [&|| project(3, true), &|| project(1, false)]);
    all_hold &= holds("order 3 with gradients over tracing alone", with / without - 1.0, 0.2, false);

    let all = || {
        black_box(transport.irradiance(&points, &lobe, SEED, Effort::Samples(samples)));
    };
    let [one, two] = [1, 2].map(|threads| wall(ROUNDS / 4, threads, &all));
    all_hold &= holds("two cores over one (a quiet machine)", one / two, 1.8, true);
    match Gpu::open(AdapterKind::Any) {
        Ok(gpu) => {
            if let Err(error) = probes_on_the_gpu(&gpu, &transport, &places) {
                println!("probes by the GPU: MISSED: {error}");
                all_hold = false;
            }
        }
        Err(error) => println!("probes by the GPU: SKIPPED: {error}"),
    }
    std::process::exit(i32::from(!all_hold));
}
