use rigbench::gpu::{AdapterKind, Evaluator, Gpu, Timer};
use rigbench::math::{Stream, StreamPurpose};
use rigbench::rig::{LocalPoints, ShVectors};

use crate::on_gpu;

fn points(count: usize) -> LocalPoints<f32> {
    let mut stream = Stream::indexed(21, StreamPurpose::Test, 0);
    let mut points = LocalPoints::default();
    for _ in 0..count {
        points.push(stream.direction(), stream.direction());
    }
    points
}

/// A model of `taps` taps that a compiler cannot fold.
fn model(taps: usize) -> String {
    format!("fn rig_taps(q: vec3f) {{ for (var k = 0u; k < {taps}u; k++) {{ tap(k, q.x + f32(k)); }} }}")
}

#[test]
fn timings_keep_all_samples_and_grow_with_the_work() {
    on_gpu("timings_keep_all_samples_and_grow_with_the_work", |_| {
        // of its own: what other tests drew before takes a software adapter's clock along
        let gpu = &Gpu::open(AdapterKind::Any).unwrap();
        let points = points(4096);
        let total = gpu.timing_points(points.len());
        assert!(total >= if gpu.adapter().software { 65_536 } else { 1_000_000 } && total.is_multiple_of(points.len()));
        let repeat = gpu.timing_repeats(15);
        assert_eq!(repeat, if gpu.adapter().software { 3 } else { 15 });
        let mut best = Vec::new();
        for taps in [1, 64] {
            let evaluator = Evaluator::new(gpu, &model(taps), 3).unwrap();
            assert!(evaluator.once().as_nanos() > 0);
            let vectors = ShVectors::zeros(3, taps);
            let mut prepared = evaluator.prepare(&vectors, &points, total).unwrap();
            assert_eq!(prepared.parameter_bytes(), taps as u64 * 9 * 16);
            let timing = prepared.time(1, repeat).unwrap();
            assert_eq!((timing.samples_ns_per_point.len(), timing.points), (repeat, total));
            assert!(timing.samples_ns_per_point.iter().all(|t| t.is_finite() && *t > 0.0), "{timing:?}");
            let expected = if gpu.adapter().features.timestamp_query { Timer::Timestamp } else { Timer::Wall };
            // on a busy machine an empty run may take a software adapter longer than a full one: then the wall clock stands in
            assert!(timing.timer == expected || gpu.adapter().software, "{timing:?}");
            let looks = if gpu.adapter().software { 6 } else { 1 };
            let times = (1..looks).flat_map(|_| prepared.time(1, repeat).unwrap().samples_ns_per_point);
            best.push(timing.samples_ns_per_point.iter().copied().chain(times).fold(f64::INFINITY, f64::min));
            assert!(prepared.setup_sample().unwrap().as_nanos() > 0);
        }
        println!("ns a point on {}: {best:?}", gpu.adapter().label());
        assert!(best[1] > 4.0 * best[0], "64 taps must cost much more than one: {best:?}");
    });
}

#[test]
fn both_clocks_see_the_same_work() {
    on_gpu("both_clocks_see_the_same_work", |_| {
        // of its own: what other tests drew before takes a software adapter's clock along
        let gpu = &Gpu::open(AdapterKind::Any).unwrap();
        let points = points(4096);
        let evaluator = Evaluator::new(gpu, &model(64), 3).unwrap();
        let mut prepared = evaluator.prepare(&ShVectors::zeros(3, 64), &points, 1 << 18).unwrap();
        prepared.warm_up().unwrap();
        prepared.warm_up().unwrap();
        // a wrong timestamp period would be off by the period every time; the wall clock adds submission, waiting and whatever else the
        // machine does, and an empty run is subtracted from each clock, so that a busy machine needs several looks
        let samples: Vec<_> = (0..25).map(|_| prepared.sample().unwrap()).collect();
        let ratios: Vec<f64> =
            samples.iter().filter_map(|s| s.timestamp_ns.map(|stamped| stamped / s.wall_ns)).collect();
        if gpu.adapter().features.timestamp_query {
            assert!(ratios.iter().any(|ratio| *ratio > 0.05 && *ratio < 2.0), "{samples:?}");
        } else {
            assert!(ratios.is_empty(), "timestamps of a device that has none: {samples:?}");
        }
    });
}
