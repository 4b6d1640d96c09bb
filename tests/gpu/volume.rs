//! Lattices from hardware-filtered volume textures against trilinear interpolation in f64.

use rigbench::gpu::{Gpu, GpuError, VolumeEvaluator, VolumeFormat, VolumeShape};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::rig::{LocalPoints, ShVectors};
use rigbench::sh::{MAX_ORDER, basis, coefficients};

use crate::on_gpu;

const SHAPES: [([usize; 3], [f64; 3]); 7] = [
    ([3, 2, 2], [1.5, 0.5, 0.7]),
    ([2, 2, 2], [1.0, 1.0, 1.0]),
    ([8, 4, 2], [4.0, 1.0, 0.5]),
    ([2, 5, 9], [0.3, 3.0, 2.0]),
    ([4, 1, 3], [1.0, 0.0, 1.0]),
    ([3, 3, 1], [1.0, 2.0, 0.5]),
    ([1, 1, 1], [1.0, 1.0, 0.0]),
];

fn shape(counts: [usize; 3], half: [f64; 3], order: usize, format: VolumeFormat) -> VolumeShape {
    VolumeShape { counts, half, order, format }
}

fn vectors(shape: &VolumeShape, scale: f64) -> ShVectors<f32> {
    let mut stream = Stream::indexed(31, StreamPurpose::Test, shape.order as u64);
    let mut vectors = ShVectors::zeros(shape.order, shape.counts.iter().product());
    vectors.data.iter_mut().for_each(|v| *v = (scale * stream.uniform_between(-1.0, 1.0)) as f32);
    vectors
}

/// Every sample's place, every cell's centre on each axis and together, places between and outside.
fn points(shape: &VolumeShape) -> LocalPoints<f32> {
    let mut stream = Stream::indexed(32, StreamPurpose::Test, 1);
    let mut points = LocalPoints::default();
    let steps: [Vec<f64>; 3] = std::array::from_fn(|axis| {
        let intervals = 2 * (shape.counts[axis] - 1);
        let steps = (0..=intervals).map(|i| if intervals == 0 { 0.0 } else { 2.0 * i as f64 / intervals as f64 - 1.0 });
        steps.map(|t| t * shape.half[axis]).collect()
    });
    for z in &steps[2] {
        for y in &steps[1] {
            for x in &steps[0] {
                points.push(glam::DVec3::new(*x, *y, *z), stream.direction());
            }
        }
    }
    for _ in 0..400 {
        let q = glam::DVec3::from_array(shape.half.map(|h| h * stream.uniform_between(-1.3, 1.3)));
        points.push(q, stream.direction());
    }
    points
}

/// Trilinear E in f64, and what 8-bit filter weights may add to it.
fn expected(shape: &VolumeShape, vectors: &ShVectors<f32>, q: Vector3<f32>, n: Vector3<f32>) -> (Rgb<f64>, f64) {
    let (mut lower, mut t) = ([0; 3], [0.0; 3]);
    for axis in 0..3 {
        let (count, half) = (shape.counts[axis], f64::from(shape.half[axis] as f32));
        if count > 1 && half > 0.0 {
            let along = ((f64::from(q[axis]).clamp(-half, half) + half) / (2.0 * half) * (count - 1) as f64).max(0.0);
            lower[axis] = (along.floor() as usize).min(count - 2);
            t[axis] = along - lower[axis] as f64;
        }
    }
    let y = basis::<f64, 36>(Vector3::new(f64::from(n.x), f64::from(n.y), f64::from(n.z)));
    let mut e = [0.0; 3];
    let mut tolerance = 0.0;
    for k in 0..coefficients(shape.order) {
        let (mut least, mut largest, mut magnitude) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], 0.0f64);
        for corner in 0..8 {
            let (mut index, mut weight, mut stride) = (0, 1.0, 1);
            for axis in 0..3 {
                let upper = corner >> axis & 1;
                weight *= if upper == 1 { t[axis] } else { 1.0 - t[axis] };
                index += (lower[axis] + upper).min(shape.counts[axis] - 1) * stride;
                stride *= shape.counts[axis];
            }
            for channel in 0..3 {
                let value = f64::from(vectors.vector(index)[3 * k + channel]);
                e[channel] += weight * value * y[k];
                least[channel] = least[channel].min(value);
                largest[channel] = largest[channel].max(value);
                magnitude = magnitude.max(value.abs());
            }
        }
        let spread = (0..3).map(|channel| largest[channel] - least[channel]).fold(0.0, f64::max);
        // Filter weights have 8 fractional bits: on each of three axes a coordinate is off by up to a step of 1/256
        // where a device truncates. A 16-bit float has 11 bits, a 32-bit one adds a few roundings.
        let stored = match shape.format {
            VolumeFormat::Rgba16Float => 1.0 / 2048.0,
            VolumeFormat::Rgba32Float => 1e-6,
        };
        tolerance += y[k].abs() * (3.0 / 256.0 * spread + stored * magnitude);
    }
    (Rgb::from_array(e), tolerance)
}

/// Largest error in units of the tolerance over all points.
fn disagreement(gpu: &Gpu, shape: VolumeShape, model: &str, scale: f64) -> f64 {
    let vectors = vectors(&shape, scale);
    let points = points(&shape);
    let evaluator = VolumeEvaluator::with_model(gpu, shape, model).unwrap();
    let got = evaluator.evaluate(&vectors, &points).unwrap();
    let off = (0..points.len()).map(|i| {
        let (e, tolerance) = expected(&shape, &vectors, points.q(i), points.n(i));
        let difference = (got[i].to_double() - e).max_abs();
        if difference.is_finite() { difference / tolerance } else { f64::INFINITY }
    });
    off.fold(0.0, f64::max)
}

fn formats(gpu: &Gpu) -> Vec<VolumeFormat> {
    let mut formats = vec![VolumeFormat::Rgba16Float];
    if gpu.adapter().features.float32_filterable {
        formats.push(VolumeFormat::Rgba32Float);
    }
    formats
}

#[test]
fn volume_textures_interpolate_as_the_lattice_does() {
    on_gpu("volume_textures_interpolate_as_the_lattice_does", |gpu| {
        for format in formats(gpu) {
            let mut worst = 0.0f64;
            for (i, (counts, half)) in SHAPES.into_iter().enumerate() {
                for order in if i == 0 { 1..=MAX_ORDER } else { 3..=3 } {
                    let shape = shape(counts, half, order, format);
                    let off = disagreement(gpu, shape, &shape.wgsl(), 1.0);
                    assert!(off <= 1.0, "{} {counts:?} order {order}: {off} of the tolerance", format.name());
                    worst = worst.max(off);
                }
            }
            println!("{}: largest error {worst} of the tolerance of 8-bit filter weights", format.name());
        }
    });
}

#[test]
fn lights_of_any_strength_fit_into_sixteen_bits() {
    on_gpu("lights_of_any_strength_fit_into_sixteen_bits", |gpu| {
        let shape = shape([3, 2, 2], [1.5, 0.5, 0.7], 3, VolumeFormat::Rgba16Float);
        for scale in [1e-30, 1e-8, 3e5, 1e30] {
            let off = disagreement(gpu, shape, &shape.wgsl(), scale);
            assert!(off <= 1.0, "scale {scale:e}: {off} of the tolerance");
        }
        let black = ShVectors::zeros(3, 12);
        let e = VolumeEvaluator::new(gpu, shape).unwrap().evaluate(&black, &points(&shape)).unwrap();
        assert!(e.iter().all(|e| *e == Rgb::zero()));
    });
}

#[test]
fn samples_stand_at_texel_centres() {
    on_gpu("samples_stand_at_texel_centres", |gpu| {
        for format in formats(gpu) {
            let shape = shape([3, 2, 4], [1.0, 1.0, 1.0], 1, format);
            // order 1: E is the coefficient times Y_0; numbers that both formats hold exactly
            let mut vectors = ShVectors::zeros(1, 24);
            for (i, channels) in vectors.data.chunks_exact_mut(3).enumerate() {
                channels.copy_from_slice(&[i as f32, 32.0 - i as f32, 1.0]);
            }
            let mut points = LocalPoints::default();
            for z in 0..4 {
                for y in 0..2 {
                    for x in 0..3 {
                        let q = glam::DVec3::new(
                            f64::from(x) - 1.0,
                            2.0 * f64::from(y) - 1.0,
                            2.0 * f64::from(z) / 3.0 - 1.0,
                        );
                        points.push(q, glam::DVec3::Z);
                    }
                }
            }
            let y0 = basis::<f32, 1>(Vector3::new(0.0, 0.0, 1.0))[0];
            let e = VolumeEvaluator::new(gpu, shape).unwrap().evaluate(&vectors, &points).unwrap();
            for (i, e) in e.iter().enumerate() {
                // a step of the filter weight towards the next slice (6 apart), no more: a half-texel error would be 3 off
                let expected = Rgb::new(i as f32, 32.0 - i as f32, 1.0);
                let off = (*e * (1.0 / y0) - expected).max_abs();
                assert!(off <= 6.0 / 256.0, "{} sample {i}: {e:?}, off by {off}", format.name());
            }
        }
    });
}

#[test]
fn a_half_texel_or_group_error_is_noticed() {
    on_gpu("a_half_texel_or_group_error_is_noticed", |gpu| {
        let shape = shape([3, 2, 2], [1.5, 0.5, 0.7], 3, VolumeFormat::Rgba16Float);
        let right = shape.wgsl();
        for (from, to) in [
            ("vec3f(along.xy, z) + 0.5", "vec3f(along.xy, z)"),
            ("vec3f(along.xy, z) + 0.5", "vec3f(along.xy, z) + vec3f(0.5, 0.4, 0.5)"),
            ("group * VOLUME_COUNT.z", "group * (VOLUME_COUNT.z + 1.0)"),
            ("clamp(along.z, min(VOLUME_GUARD, 0.5 * end), max(end - VOLUME_GUARD, 0.5 * end))", "1.1 * along.z"),
            ("g2.x", "g2.y"),
        ] {
            let wrong = right.replacen(from, to, 1);
            assert_ne!(wrong, right, "{from} is not in the shader");
            let off = disagreement(gpu, shape, &wrong, 1.0);
            assert!(off > 1.0, "{to} in place of {from} went unnoticed: {off} of the tolerance");
        }
    });
}

#[test]
fn a_volume_beyond_the_limits_is_refused() {
    on_gpu("a_volume_beyond_the_limits_is_refused", |gpu| {
        let shape = shape([2, 2, 300], [1.0; 3], 6, VolumeFormat::Rgba16Float);
        match VolumeEvaluator::new(gpu, shape) {
            Err(GpuError::TooLarge { needed, limit, .. }) => assert_eq!((needed, limit), (8100, 2048)),
            other => panic!("{other:?}"),
        }
    });
}
