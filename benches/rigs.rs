//! What a rig costs at a point: every kind on the CPU (one core, `f32`, plain and wide, with ratios taken in one run) and on the GPU,
//! where there is one; and what setting it up costs, RBFs beside lattices.
//! `cargo bench --bench rigs`; the ratios are printed first, Criterion's figures follow.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput};
use glam::DVec3;
use rigbench::gpu::{AdapterKind, Evaluator, Gpu};
use rigbench::light::{Light, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::probe::{GradientSource, sample_lights};
use rigbench::rig::{AnyRig, LocalPoints, Model, Rig, RigModel, ShVectors, catalogue, plain_irradiance};
use rigbench::scene::OrientedBox;
use rigbench::sh::Window;

const HALF: [f64; 3] = [2.0, 0.7, 0.9];
/// The area points of a receiver.
const POINTS: usize = 4096;
/// More than any cache holds: 24 bytes a point.
const STREAMED: usize = 1 << 23;

fn rig(text: &str) -> AnyRig {
    AnyRig::inline(text).unwrap()
}

fn points(count: usize) -> LocalPoints<f32> {
    let mut stream = Stream::indexed(31, StreamPurpose::Test, 0);
    let mut points = LocalPoints::default();
    for _ in 0..count {
        points.push(DVec3::from_array(HALF.map(|h| stream.uniform_between(-h, h))), stream.direction());
    }
    points
}

/// Random samples, as many as the rig asks for.
fn sampled(rig: &AnyRig, order: usize) -> ShVectors<f32> {
    let mut stream = Stream::indexed(32, StreamPurpose::Test, 0);
    let count = rig.placement(HALF).iter().map(|r| r.vectors()).sum();
    let mut vectors = ShVectors::zeros(order, count);
    vectors.data.iter_mut().for_each(|v| *v = stream.uniform_between(-1.0, 1.0) as f32);
    vectors
}

struct Subject {
    model: Model<f32>,
    vectors: ShVectors<f32>,
}

impl Subject {
    fn new(text: &str, order: usize) -> Self {
        let rig = rig(text);
        Self { model: rig.model(HALF), vectors: rig.fit(HALF, sampled(&rig, order)).vectors }
    }
    fn wide<const C: usize>(&self, points: &LocalPoints<f32>, out: &mut [Rgb<f32>]) {
        self.model.irradiance::<C>(black_box(&self.vectors), black_box(points), out);
    }
    fn plain<const C: usize>(&self, points: &LocalPoints<f32>, out: &mut [Rgb<f32>]) {
        plain_irradiance::<f32, _, C>(&self.model, black_box(&self.vectors), black_box(points), out);
    }
}

/// Medians of two workloads that take turns, so that a change of the machine's pace meets both.
fn medians(repeats: usize, mut first: impl FnMut(), mut second: impl FnMut()) -> [Duration; 2] {
    let timed = |work: &mut dyn FnMut()| {
        let start = Instant::now();
        work();
        start.elapsed()
    };
    first();
    second();
    let mut samples = [Vec::new(), Vec::new()];
    for _ in 0..repeats {
        samples[0].push(timed(&mut first));
        samples[1].push(timed(&mut second));
    }
    samples.map(|mut s| {
        s.sort();
        s[s.len() / 2]
    })
}

fn per_point(time: Duration, points: usize) -> f64 {
    time.as_secs_f64() * 1e9 / points as f64
}

fn speedup<const C: usize>(text: &str, order: usize) {
    let subject = Subject::new(text, order);
    let points = points(POINTS);
    let (mut a, mut b) = (vec![Rgb::zero(); POINTS], vec![Rgb::zero(); POINTS]);
    let [plain, wide] = medians(301, || subject.plain::<C>(&points, &mut a), || subject.wide::<C>(&points, &mut b));
    let [plain, wide] = [plain, wide].map(|t| per_point(t, POINTS));
    println!("order {order}, {text}: plain {plain:.2} ns, wide {wide:.2} ns a point, ratio {:.2}", plain / wide);
}

/// The constant rig against a copy of as many bytes as it reads and writes (three normals' numbers in, three channels out).
fn bandwidth() {
    let subject = Subject::new("constant = {}", 3);
    let points = points(STREAMED);
    let mut out = vec![Rgb::zero(); STREAMED];
    let (from, mut to) = (vec![1.0f32; 3 * STREAMED], vec![0.0f32; 3 * STREAMED]);
    let [rig, copy] =
        medians(15, || subject.wide::<9>(&points, &mut out), || black_box(&mut to).copy_from_slice(black_box(&from)));
    let gigabytes = |t: Duration| 24.0 * STREAMED as f64 / t.as_secs_f64() / 1e9;
    println!(
        "order 3, constant over {STREAMED} points: {:.2} ns a point, {:.1} GB/s; copy {:.1} GB/s, share {:.2}",
        per_point(rig, STREAMED),
        gigabytes(rig),
        gigabytes(copy),
        copy.as_secs_f64() / rig.as_secs_f64()
    );
}

fn ratios() {
    bandwidth();
    for samples in ["[2, 2, 2]", "[3, 2, 2]", "[3, 3, 3]", "[8, 4, 2]", "[16, 16, 16]"] {
        speedup::<9>(&format!("lattice = {{ samples = {samples} }}"), 3);
    }
    for entry in catalogue() {
        speedup::<9>(entry.text, 3);
    }
    let lattice = "lattice = { samples = [3, 3, 3] }";
    speedup::<1>(lattice, 1);
    speedup::<4>(lattice, 2);
    speedup::<16>(lattice, 4);
    speedup::<25>(lattice, 5);
    speedup::<36>(lattice, 6);
}

/// Every kind on the GPU over a million points (fewer on a software adapter, whose times are no GPU times), an empty run subtracted.
fn on_gpu() {
    let gpu = match Gpu::open(AdapterKind::Any) {
        Ok(gpu) => gpu,
        Err(why) => return println!("no GPU: {why}"),
    };
    println!("order 3 on {}", gpu.adapter().label());
    let points = points(POINTS);
    let total = gpu.timing_points(POINTS);
    for entry in catalogue() {
        let subject = Subject::new(entry.text, 3);
        let time = Evaluator::of_rig(&gpu, &entry.rig, HALF, 3)
            .and_then(|evaluator| evaluator.prepare(&subject.vectors, &points, total)?.time(2, gpu.timing_repeats(9)));
        match time {
            Ok(timing) => {
                let mut samples = timing.samples_ns_per_point.clone();
                samples.sort_by(f64::total_cmp);
                let median = samples[samples.len() / 2];
                println!("order 3, {}: GPU {median:.3} ns a point ({})", entry.text, timing.timer.name());
            }
            Err(why) => println!("order 3, {}: {why}", entry.text),
        }
    }
}

fn evaluation(c: &mut Criterion) {
    let mut group = c.benchmark_group("order 3 irradiance, 4096 points");
    group.throughput(Throughput::Elements(POINTS as u64));
    group.sample_size(20).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    let points = points(POINTS);
    let mut out = vec![Rgb::zero(); POINTS];
    for entry in catalogue() {
        let subject = Subject::new(entry.text, 3);
        group.bench_function(BenchmarkId::new("wide", entry.text), |b| b.iter(|| subject.wide::<9>(&points, &mut out)));
        group.bench_function(BenchmarkId::new("plain", entry.text), |b| {
            b.iter(|| subject.plain::<9>(&points, &mut out))
        });
    }
}

/// What a frame costs before any point is lit: four sphere lights projected at every sample, then the fit. For RBFs also the fit
/// alone, and what is left of it where the box stays and its factorisation is kept.
fn setup(c: &mut Criterion) {
    let mut group = c.benchmark_group("order 3 setup, 4 sphere lights");
    group.sample_size(20).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    let mut stream = Stream::indexed(33, StreamPurpose::Test, 0);
    let lights: Vec<Light<f32>> = (0..4)
        .map(|_| {
            let center = Vector3::of(stream.direction() * 4.0);
            Light::Sphere(Sphere { center, radius: 0.3, radiance: Rgb::splat(1.0) })
        })
        .collect();
    let bounds = OrientedBox::aligned(-DVec3::from_array(HALF), DVec3::from_array(HALF));
    for text in [
        "constant = {}",
        "gradient = {}",
        "lattice = { samples = [2, 2, 2] }",
        "lattice = { samples = [3, 3, 3] }",
        "lattice = { samples = [2, 2, 2], interpolation = \"half_gradient\" }",
        "rbf = { centers = \"corners+centre\", kernel = \"cubic\" }",
        "rbf = { samples = [3, 3, 3], kernel = \"cubic\" }",
    ] {
        let rig = rig(text);
        let requests = rig.placement(HALF);
        let sample = || sample_lights(&lights, &bounds, &requests, 3, GradientSource::Analytic, Window::None).vectors;
        group.bench_function(text, |b| b.iter(|| rig.fit(HALF, sample())));
        if let AnyRig::Rbf(rbf) = &rig {
            let samples = sample();
            group.bench_function(format!("{text}, fit alone"), |b| {
                b.iter_batched(|| samples.clone(), |samples| rig.fit(HALF, samples), BatchSize::SmallInput)
            });
            let solver = rbf.solver(HALF);
            group
                .bench_function(format!("{text}, factorised before"), |b| b.iter(|| solver.solve(black_box(&samples))));
        }
    }
}

fn main() {
    // `cargo test --benches` and `cargo bench -- --list` want no long measurement
    if !std::env::args().any(|a| a == "--test" || a == "--list") {
        ratios();
        on_gpu();
    }
    let mut criterion = Criterion::default().configure_from_args();
    evaluation(&mut criterion);
    setup(&mut criterion);
    criterion.final_summary();
}
