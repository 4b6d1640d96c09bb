//! The wide evaluation against the plain one.

use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::rig::{LocalPoints, Model, Rig, RigModel, ShVectors, catalogue, plain_irradiance, wide_available};
use rigbench::sh::{MAX_ORDER, basis};
use rigbench::with_order;

/// A number of points that is no multiple of a block, in and around the box.
fn points(half: [f64; 3], count: usize) -> LocalPoints<f32> {
    let mut stream = Stream::indexed(21, StreamPurpose::Test, 0);
    let mut points = LocalPoints::default();
    for _ in 0..count {
        let q = half.map(|h| 1.2 * stream.uniform_between(-h, h));
        points.push(glam::DVec3::from_array(q), stream.direction());
    }
    points
}

fn vectors(order: usize, count: usize) -> ShVectors<f32> {
    let mut stream = Stream::indexed(22, StreamPurpose::Test, order as u64);
    let mut vectors = ShVectors::zeros(order, count);
    vectors.data.iter_mut().for_each(|v| *v = stream.uniform_between(-1.0, 1.0) as f32);
    vectors
}

/// The largest difference of the two forms in roundings of 2^-24 of the sum of the terms' absolute values.
fn disagreement(model: &Model<f32>, vectors: &ShVectors<f32>, points: &LocalPoints<f32>, planted: f32) -> f32 {
    let mut wide = vec![Rgb::zero(); points.len()];
    let mut plain = wide.clone();
    with_order!(vectors.order, C => {
        model.irradiance::<C>(vectors, points, &mut wide);
        plain_irradiance::<f32, _, C>(model, vectors, points, &mut plain);
    });
    let mut worst = 0.0f32;
    for i in 0..points.len() {
        let y = basis::<f32, 36>(points.n(i));
        let mut magnitude = 0.0;
        model.taps(points.q(i), &mut |vector, weight: f32| {
            for (k, channels) in vectors.vector(vector).chunks_exact(3).enumerate() {
                magnitude += weight.abs() * y[k].abs() * Vector3::new(channels[0], channels[1], channels[2]).max_abs();
            }
        });
        let difference = (wide[i] * planted - plain[i]).max_abs();
        assert!(difference.is_finite(), "{:?} and {:?}", wide[i], plain[i]);
        worst = worst.max(difference / (magnitude * f32::EPSILON / 2.0).max(f32::MIN_POSITIVE));
    }
    worst
}

#[test]
fn wide_and_plain_agree_within_sixteen_roundings() {
    assert!(wide_available() || !cfg!(target_arch = "x86_64"), "this machine has no AVX2: nothing is compared here");
    let mut worst = 0.0f32;
    for entry in catalogue() {
        for half in [[1.3, 0.5, 0.8], [0.0, 1.2, 0.7], [0.0, 0.0, 0.0]] {
            for order in 1..=MAX_ORDER {
                let count = entry.rig.placement(half).iter().map(|r| r.vectors()).sum();
                let kept = entry.rig.fit(half, vectors(order, count)).vectors;
                let model = entry.rig.model::<f32>(half);
                let off = disagreement(&model, &kept, &points(half, 203), 1.0);
                assert!(off <= 16.0, "{} in {half:?}, order {order}: {off} roundings", entry.text);
                worst = worst.max(off);
            }
        }
    }
    println!("largest difference: {worst} roundings");
    assert!(worst > 0.0, "two forms that agree to the last bit everywhere are not two computations");
}

#[test]
fn a_wide_form_that_is_a_ten_thousandth_off_is_rejected() {
    for entry in catalogue() {
        let half = [1.3, 0.5, 0.8];
        let count = entry.rig.placement(half).iter().map(|r| r.vectors()).sum();
        // one coefficient alone, so that the sum cannot cancel against its terms
        let kept = entry.rig.fit(half, vectors(1, count)).vectors;
        let off = disagreement(&entry.rig.model(half), &kept, &points(half, 203), 1.0001);
        assert!(off > 16.0, "{}: {off} roundings", entry.text);
    }
}

#[test]
fn blocks_of_every_length_are_filled() {
    let rig = rigbench::rig::AnyRig::inline("lattice = { samples = [2, 2, 2] }").unwrap();
    let half = [1.0, 1.0, 1.0];
    for entry in [rigbench::rig::AnyRig::inline("constant = {}").unwrap(), rig] {
        let count = entry.placement(half).iter().map(|r| r.vectors()).sum();
        for length in 0..20 {
            let off = disagreement(&entry.model(half), &vectors(3, count), &points(half, length), 1.0);
            assert!(off <= 16.0, "{length} points: {off} roundings");
        }
    }
}
