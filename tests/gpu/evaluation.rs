use rigbench::gpu::{Evaluator, Gpu, ShaderText, WgslExpression};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::rig::{AnyRig, Constant, LocalPoints, Model, Rig, RigModel, ShVectors, catalogue};
use rigbench::sh::{MAX_ORDER, basis, coefficients, degree_of};
use rigbench::with_order;

use crate::on_gpu;

/// Half extents that a twin must bear: an ordinary box, a long one, a plate, a line, a point, a huge and a tiny one.
const BOXES: [[f64; 3]; 7] = [
    [1.0, 0.5, 0.25],
    [4.0, 0.7, 0.7],
    [1.0, 0.0, 2.0],
    [0.0, 0.0, 1.5],
    [0.0, 0.0, 0.0],
    [2e3, 1e3, 5e2],
    [2e-3, 1e-3, 3e-3],
];

/// Points in and around a box: stratified, then the nasty ones (corners, face and cell centres, the centre, outside).
fn points(half: [f64; 3]) -> LocalPoints<f32> {
    let mut stream = Stream::indexed(11, StreamPurpose::Test, 2);
    let mut points = LocalPoints::default();
    let cells = 5;
    for cell in 0..cells * cells * cells {
        let index = [cell % cells, cell / cells % cells, cell / (cells * cells)];
        let q = glam::DVec3::from_array(std::array::from_fn(|axis| {
            1.2 * half[axis] * (2.0 * (index[axis] as f64 + stream.uniform()) / cells as f64 - 1.0)
        }));
        points.push(q, stream.direction());
    }
    for x in [-1.0, -0.5, 0.0, 1.0, 3.0] {
        for y in [-1.0, 0.0, 1.0 / 3.0, 1.0] {
            for z in [-2.0, -1.0, 0.0, 1.0] {
                points.push(glam::DVec3::new(x * half[0], y * half[1], z * half[2]), stream.direction());
            }
        }
    }
    for axis in [glam::DVec3::X, glam::DVec3::Y, glam::DVec3::Z] {
        points.push(glam::DVec3::ZERO, axis);
        points.push(glam::DVec3::ZERO, -axis);
    }
    points
}

fn vectors(order: usize, count: usize) -> ShVectors<f32> {
    let mut stream = Stream::indexed(12, StreamPurpose::Test, order as u64);
    let mut vectors = ShVectors::zeros(order, count);
    vectors.data.iter_mut().for_each(|v| *v = stream.uniform_between(-1.0, 1.0) as f32);
    vectors
}

fn on_cpu(model: &Model<f32>, vectors: &ShVectors<f32>, points: &LocalPoints<f32>) -> Vec<Rgb<f32>> {
    let mut e = vec![Rgb::zero(); points.len()];
    with_order!(vectors.order, C => model.irradiance::<C>(vectors, points, &mut e));
    e
}

/// Sum of the absolute values of all terms of E at a point: what rounding errors are relative to.
fn magnitude(model: &Model<f32>, vectors: &ShVectors<f32>, points: &LocalPoints<f32>, i: usize) -> f32 {
    let y = basis::<f32, 36>(points.n(i));
    let mut sum = 0.0;
    model.taps(points.q(i), &mut |vector, weight: f32| {
        for (k, channels) in vectors.vector(vector).chunks_exact(3).enumerate() {
            let largest = channels.iter().fold(0.0f32, |m, c| m.max(c.abs()));
            sum += weight.abs() * y[k].abs() * largest;
        }
    });
    sum
}

/// The twins' largest difference in units of the tolerance.
///
/// Tolerance: 16 roundings of 2^-24 relative to the sum of the terms' absolute values. Both sides sum the same terms in the same
/// order; the GPU may fuse a multiplication with an addition, writes the basis as polynomials where Rust runs a recurrence
/// (each good to a few roundings), and a weight is itself a few operations on the point.
fn disagreement(evaluator: Evaluator, model: &Model<f32>, vectors: &ShVectors<f32>, half: [f64; 3]) -> f32 {
    let points = points(half);
    let got = evaluator.evaluate(vectors, &points).unwrap();
    let expected = on_cpu(model, vectors, &points);
    assert_eq!(got.len(), points.len());
    (0..points.len())
        .map(|i| {
            let difference = (got[i] - expected[i]).max_abs();
            let tolerance = 16.0 * f32::EPSILON / 2.0 * magnitude(model, vectors, &points, i);
            if difference.is_finite() { difference / tolerance.max(f32::MIN_POSITIVE) } else { f32::INFINITY }
        })
        .fold(0.0, f32::max)
}

#[test]
fn every_rig_agrees_with_its_wgsl_twin() {
    let rigs = catalogue();
    // a rig without a configuration here is a rig without a twin test
    for key in AnyRig::KEYS {
        assert!(rigs.iter().any(|entry| entry.rig.key() == *key), "no twin test of the rig {key}");
    }
    on_gpu("every_rig_agrees_with_its_wgsl_twin", |gpu| {
        let mut worst = 0.0f32;
        for (r, entry) in rigs.iter().enumerate() {
            let (name, rig) = (entry.text, &entry.rig);
            // every rig at the ordinary box and at one other, so that all boxes come up; every order with every kind of box
            for half in [BOXES[0], BOXES[1 + r % (BOXES.len() - 1)]] {
                let order = 1 + (r + usize::from(half != BOXES[0])) % 3;
                let count = rig.placement(half).iter().map(|request| request.vectors()).sum();
                let fit = rig.fit(half, vectors(order, count));
                let evaluator = Evaluator::of_rig(gpu, rig, half, order).unwrap();
                let off = disagreement(evaluator, &rig.model(half), &fit.vectors, half);
                assert!(off <= 1.0, "{name}, box {half:?}, order {order}: {off} times the tolerance");
                worst = worst.max(off);
            }
        }
        assert!(worst > 0.0, "twins that agree to the last bit everywhere are not two computations");
        println!("largest difference of a rig and its twin: {worst} of the tolerance");
    });
}

/// Every number of a WGSL text, changed by itself: one part in a thousand, or 0 to 0.001.
pub fn broken_texts(text: &str) -> Vec<(String, String)> {
    let bytes = text.as_bytes();
    let mut broken = Vec::new();
    let mut i = 0;
    while i < bytes.len() {
        let starts = bytes[i].is_ascii_digit()
            && (i == 0 || !(bytes[i - 1].is_ascii_alphanumeric() || b"_.".contains(&bytes[i - 1])));
        if !starts {
            i += 1;
            continue;
        }
        let mut end = i;
        while end < bytes.len()
            && (bytes[end].is_ascii_digit()
                || bytes[end] == b'.'
                || bytes[end] == b'e'
                || (b"+-".contains(&bytes[end]) && bytes[end - 1] == b'e'))
        {
            end += 1;
        }
        let number = &text[i..end];
        // whole numbers are indices and counts: they are not tuned but structural
        if number.contains('.') || number.contains('e') {
            let value: f64 = number.parse().unwrap();
            let changed = if value == 0.0 { 1e-3 } else { value * 1.001 };
            broken.push((number.to_owned(), format!("{}{changed:?}{}", &text[..i], &text[end..])));
        }
        i = end;
    }
    broken
}

/// The sum over taps at the orders that the rigs' own tests leave out.
#[test]
fn high_orders_agree() {
    on_gpu("high_orders_agree", |gpu| {
        let (half, rig) = (BOXES[0], AnyRig::inline("lattice = { samples = [3, 2, 2] }").unwrap());
        for order in 4..=MAX_ORDER {
            let evaluator = Evaluator::of_rig(gpu, &rig, half, order).unwrap();
            let off = disagreement(evaluator, &rig.model(half), &vectors(order, 12), half);
            assert!(off <= 1.0, "order {order}: {off} times the tolerance");
        }
    });
}

#[test]
fn a_changed_constant_of_a_rig_is_noticed() {
    on_gpu("a_changed_constant_of_a_rig_is_noticed", |gpu| {
        let half = BOXES[0];
        for entry in catalogue() {
            let (name, rig) = (entry.text, entry.rig);
            let count = rig.placement(half).iter().map(|request| request.vectors()).sum();
            let fit = rig.fit(half, vectors(1, count));
            let broken = broken_texts(&rig.wgsl(half));
            assert!(!broken.is_empty(), "{name} has no constant");
            let off = |evaluator: Evaluator| disagreement(evaluator, &rig.model(half), &fit.vectors, half);
            // some numbers have no part in this configuration; the first that has must be seen
            let noticed = broken
                .iter()
                .any(|(_, text)| off(Evaluator::new(gpu, text, 1).unwrap().with_rows(rig.wgsl_rows(half))) > 1.0);
            assert!(noticed, "{name}: none of {} changed constants was noticed", broken.len());
            // and the same of the box's numbers, where there is more than one sample to stand between
            let rows = rig.wgsl_rows(half);
            if rows.is_empty() || rig.placement(half).len() == 1 {
                continue;
            }
            let evaluator = Evaluator::of_rig(gpu, &rig, half, 1).unwrap();
            let noticed = (0..4 * rows.len()).any(|k| {
                let mut broken = rows.clone();
                broken[k / 4][k % 4] =
                    broken[k / 4][k % 4] * 1.001 + if broken[k / 4][k % 4] == 0.0 { 1e-3 } else { 0.0 };
                off(evaluator.clone().with_rows(broken)) > 1.0
            });
            assert!(noticed, "{name}: none of {} changed rows was noticed", rows.len());
        }
    });
}

/// Boxes with the same counts have the same text, so that they share a pipeline, and rows of their own.
#[test]
fn boxes_of_any_size_share_a_text() {
    for entry in catalogue() {
        let (rig, [a, b]) = (&entry.rig, [BOXES[0], BOXES[5]]);
        assert_eq!(rig.wgsl(a), rig.wgsl(b), "{}", entry.text);
        assert!(rig.wgsl_rows(a).is_empty() || rig.wgsl_rows(a) != rig.wgsl_rows(b), "{}", entry.text);
    }
}

fn basis_on_gpu(gpu: &Gpu, functions: ShaderText, directions: &[Vector3<f32>], order: usize) -> Vec<f32> {
    let rows: Vec<f32> = directions.iter().flat_map(|d| d.to_array()).collect();
    let body = "sh_basis(input_vec3(0u)); for (var k = 0u; k < COEFFICIENTS; k++) { output(k, sh_y[k]); }";
    WgslExpression { functions, body, inputs: 3, outputs: coefficients(order) }.run(gpu, &rows).unwrap()
}

fn directions() -> Vec<Vector3<f32>> {
    let mut stream = Stream::indexed(13, StreamPurpose::Test, 0);
    let mut directions: Vec<_> = (0..500).map(|_| Vector3::of(stream.direction())).collect();
    for axis in [glam::DVec3::X, glam::DVec3::Y, glam::DVec3::Z] {
        directions.extend([Vector3::of(axis), Vector3::of(-axis)]);
    }
    // the zonal polynomials' cancellation is worst beside the poles
    directions.push(Vector3::of(glam::DVec3::new(1e-4, -2e-4, 1.0).normalize()));
    directions
}

/// Largest error of each basis value against f64, relative to the largest value that its band can have, sqrt((2l + 1)/(4 pi)).
fn basis_errors(gpu: &Gpu, functions: ShaderText, order: usize) -> Vec<f64> {
    let directions = directions();
    let got = basis_on_gpu(gpu, functions, &directions, order);
    let mut worst = vec![0.0f64; coefficients(order)];
    for (d, row) in directions.iter().zip(got.chunks_exact(coefficients(order))) {
        let exact = basis::<f64, 36>(Vector3::new(f64::from(d.x), f64::from(d.y), f64::from(d.z)));
        for (k, y) in row.iter().enumerate() {
            let degree = degree_of(k) as f64;
            let largest = ((2.0 * degree + 1.0) / (4.0 * std::f64::consts::PI)).sqrt();
            worst[k] = worst[k].max((f64::from(*y) - exact[k]).abs() / largest);
        }
    }
    worst
}

/// Of order 6 the zonal polynomial sums terms up to 8.75 whose value is at most 1: some 20 roundings of 2^-24.
const BASIS_TOLERANCE: f64 = 20.0 / (1 << 24) as f64;

#[test]
fn the_basis_agrees_at_every_order() {
    on_gpu("the_basis_agrees_at_every_order", |gpu| {
        for order in 1..=MAX_ORDER {
            for (k, error) in basis_errors(gpu, ShaderText::new().with_basis(order), order).into_iter().enumerate() {
                assert!(error < BASIS_TOLERANCE, "order {order}, Y{k}: {error:e}");
            }
        }
    });
}

/// The coefficients that a line of sh.wgsl (or of its printed constants) holds a number of: both signs of its m.
fn coefficients_of_line(line: &str) -> Vec<usize> {
    let line = line.trim_start();
    let pair = |degree: usize, m: usize| vec![degree * (degree + 1) + m, degree * (degree + 1) - m];
    if let Some(name) = line.strip_prefix("const SH_N") {
        let mut digits = name.chars().map(|c| c.to_digit(10).map(|d| d as usize));
        let (Some(Some(degree)), Some(Some(m))) = (digits.next(), digits.next()) else { return vec![] };
        return pair(degree, m);
    }
    let Some(index) = line.strip_prefix("sh_q[").and_then(|rest| rest.split(']').next()) else { return vec![] };
    let index: usize = index.parse().unwrap();
    let degree = (0..MAX_ORDER).rev().find(|degree| degree * (degree + 1) / 2 <= index).unwrap();
    pair(degree, index - degree * (degree + 1) / 2)
}

#[test]
fn a_changed_constant_of_the_basis_is_noticed() {
    on_gpu("a_changed_constant_of_the_basis_is_noticed", |gpu| {
        let text = ShaderText::new().with_basis(MAX_ORDER);
        // Round r changes the r-th number of every line at once: a line belongs to its own coefficients, so each must be off.
        let mut changed = 0;
        for round in 0.. {
            let (mut broken, mut concerned) = (String::new(), Vec::new());
            for line in text.text().lines() {
                let of_line = coefficients_of_line(line);
                match broken_texts(line).get(round).filter(|_| !of_line.is_empty()) {
                    Some((_, wrong)) => {
                        broken.push_str(wrong);
                        concerned.extend(of_line);
                        changed += 1;
                    }
                    None => broken.push_str(line),
                }
                broken.push('\n');
            }
            if concerned.is_empty() {
                break;
            }
            let errors = basis_errors(gpu, ShaderText::new().with(&broken), MAX_ORDER);
            for k in concerned {
                assert!(errors[k] > BASIS_TOLERANCE, "round {round}: a number of Y{k} was changed and nobody noticed");
            }
        }
        // 21 normalisations and every number of the polynomials
        assert!(changed >= 21 + 30, "{changed}");
    });
}

#[test]
fn the_same_bits_every_time_and_no_points_are_no_trouble() {
    on_gpu("the_same_bits_every_time_and_no_points_are_no_trouble", |gpu| {
        let (half, vectors) = (BOXES[0], vectors(3, 1));
        let rig = Constant {};
        let evaluator = Evaluator::of_rig(gpu, &rig, half, 3).unwrap();
        let points = points(half);
        let first = evaluator.evaluate(&vectors, &points).unwrap();
        assert_eq!(first, evaluator.evaluate(&vectors, &points).unwrap());
        assert_eq!(evaluator.evaluate(&vectors, &LocalPoints::default()).unwrap(), vec![]);
        // a repeated set gives the set's answers again and again
        let mut repeated = evaluator.prepare(&vectors, &points, 3 * points.len() + 5).unwrap();
        let e = repeated.evaluate().unwrap();
        assert_eq!(e.len(), 3 * points.len() + 5);
        for (i, value) in e.iter().enumerate() {
            assert_eq!(*value, first[i % points.len()]);
        }
    });
}
