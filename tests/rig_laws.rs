//! Laws that every rig of the catalogue holds, and for each law a wrong variant that it rejects.

use glam::DVec3;
use rigbench::light::{Light, Sphere, projection};
use rigbench::math::{Real, Rgb, Stream, StreamPurpose, Vector3};
use rigbench::probe::{GradientSource, sample_lights};
use rigbench::rig::{AnyRig, Rig, RigModel, ShVectors, catalogue};
use rigbench::scene::OrientedBox;
use rigbench::sh::Window;

/// A scalar field with its gradient, in box coordinates.
type Field<'f> = &'f dyn Fn(DVec3) -> (f64, DVec3);

/// A defect planted into a model: weights of value vectors scaled, the place moved.
#[derive(Clone, Copy)]
struct Plant {
    scale: f64,
    shift: f64,
}

const HONEST: Plant = Plant { scale: 1.0, shift: 0.0 };
const LOUDER: Plant = Plant { scale: 1.001, shift: 0.0 };
const MOVED: Plant = Plant { scale: 1.0, shift: 0.01 };

/// What the rig makes of a field at some places.
fn values<T: Real>(rig: &AnyRig, half: [f64; 3], field: Field, places: &[DVec3], plant: Plant) -> Vec<f64> {
    let mut sampled = ShVectors::<T> { order: 1, data: Vec::new() };
    for request in rig.placement(half) {
        let (value, gradient) = field(DVec3::from_array(request.position));
        sampled.push(&[Rgb::splat(T::of(value))]);
        for axis in (0..3).filter(|a| request.derivatives[*a]) {
            sampled.push(&[Rgb::splat(T::of(gradient[axis]))]);
        }
    }
    let kept = rig.fit(half, sampled).vectors;
    let model = rig.model::<T>(half);
    let value_at = |q: &DVec3| {
        let mut sum = T::zero();
        model.taps(Vector3::of(*q + plant.shift), &mut |vector, weight| {
            sum += kept.vector(vector)[0] * weight * T::of(plant.scale);
        });
        sum.to_double()
    };
    places.iter().map(value_at).collect()
}

/// Places in a box grown by `reach`, its corners, faces and centre among them.
fn places(half: [f64; 3], reach: f64) -> Vec<DVec3> {
    let half = DVec3::from_array(half);
    let mut stream = Stream::indexed(11, StreamPurpose::Test, 0);
    let mut places: Vec<DVec3> = (0..27)
        .map(|i| DVec3::new((i % 3) as f64 - 1.0, (i / 3 % 3) as f64 - 1.0, (i / 9) as f64 - 1.0) * half)
        .collect();
    places.extend((0..60).map(|_| {
        half * reach
            * DVec3::new(
                stream.uniform_between(-1.0, 1.0),
                stream.uniform_between(-1.0, 1.0),
                stream.uniform_between(-1.0, 1.0),
            )
    }));
    places
}

/// Boxes with extent (one with ties), then without on one, two and three axes.
const FULL: [[f64; 3]; 3] = [[1.3, 0.5, 0.8], [0.25, 2.0, 0.25], [1.0, 1.0, 1.0]];
const FLAT: [[f64; 3]; 6] =
    [[0.0, 1.2, 0.7], [1.2, 0.0, 0.7], [1.2, 0.7, 0.0], [0.0, 0.0, 0.9], [0.0, 0.9, 0.0], [0.0, 0.0, 0.0]];

fn constant(_: DVec3) -> (f64, DVec3) {
    (1.0, DVec3::ZERO)
}

/// A smooth field with all its mixed derivatives.
fn smooth(q: DVec3) -> (f64, DVec3) {
    let d = q - DVec3::new(2.1, -1.7, 2.6);
    let r = d.length();
    (1.0 / r, -d / (r * r * r))
}

/// The largest difference.
fn worst(got: &[f64], expected: impl Iterator<Item = f64>) -> f64 {
    got.iter().zip(expected).map(|(g, e)| (g - e).abs()).fold(0.0, |a, b| if b.is_nan() { b } else { a.max(b) })
}

/// Rounding that a solved system may add: RBF coefficients carry its condition number.
fn tolerance(rig: &AnyRig, epsilon: f64) -> f64 {
    if matches!(rig, AnyRig::Rbf(_)) { 1e3 * epsilon } else { 30.0 * epsilon }
}

#[test]
fn a_constant_field_is_exact_everywhere() {
    for entry in catalogue() {
        for half in FULL.into_iter().chain(FLAT) {
            let places = places(half, 1.5);
            let error =
                |plant| worst(&values::<f64>(&entry.rig, half, &constant, &places, plant), [1.0; 87].into_iter());
            let allowed = tolerance(&entry.rig, f64::EPSILON);
            assert!(error(HONEST) <= allowed, "{} in {half:?}: {}", entry.text, error(HONEST));
            assert!(error(LOUDER) > allowed, "{}: louder weights must not pass", entry.text);
        }
    }
}

/// Weights of the value vectors, by the placement's own count of derivatives.
fn value_weight_sum(rig: &AnyRig, half: [f64; 3], q: DVec3, plant: Plant) -> f64 {
    let mut is_value = Vec::new();
    for request in rig.placement(half) {
        is_value.push(true);
        is_value.extend(std::iter::repeat_n(false, request.vectors() - 1));
    }
    let mut sum = 0.0;
    rig.model::<f64>(half).taps(Vector3::of(q), &mut |vector, weight| {
        if is_value[vector] {
            sum += weight * plant.scale;
        }
    });
    sum
}

#[test]
fn weights_of_values_sum_to_one() {
    let mut held = 0;
    for entry in catalogue() {
        // a fitted rig keeps no values: its constant fields say the same
        if matches!(entry.rig, AnyRig::Rbf(_)) {
            continue;
        }
        held += 1;
        for half in FULL.into_iter().chain(FLAT) {
            for q in places(half, 1.5) {
                let sum = value_weight_sum(&entry.rig, half, q, HONEST);
                assert!((sum - 1.0).abs() < 1e-14, "{} in {half:?} at {q}: {sum}", entry.text);
            }
        }
        assert!((value_weight_sum(&entry.rig, FULL[0], DVec3::ZERO, LOUDER) - 1.0).abs() > 1e-4);
    }
    assert!(held >= 20);
}

#[test]
fn samples_are_met() {
    for entry in catalogue() {
        for half in FULL.into_iter().chain(FLAT) {
            let samples: Vec<DVec3> = entry.rig.placement(half).iter().map(|r| DVec3::from_array(r.position)).collect();
            let expected = || samples.iter().map(|q| smooth(*q).0);
            let allowed = tolerance(&entry.rig, f64::EPSILON);
            let got = worst(&values::<f64>(&entry.rig, half, &smooth, &samples, HONEST), expected());
            assert!(got <= allowed, "{} in {half:?}: {got}", entry.text);
            let planted = worst(&values::<f64>(&entry.rig, half, &smooth, &samples, LOUDER), expected());
            assert!(planted > allowed, "{}: louder weights must not pass", entry.text);
        }
    }
}

/// x^a y^b z^c and its gradient.
fn monomial(exponents: [u32; 3]) -> impl Fn(DVec3) -> (f64, DVec3) {
    move |q: DVec3| {
        let power = |a: usize, lowered: u32| q[a].powi((exponents[a] - lowered) as i32);
        let slope = |a: usize| {
            if exponents[a] == 0 {
                return 0.0;
            }
            let others: f64 = (0..3).filter(|b| *b != a).map(|b| power(b, 0)).product();
            f64::from(exponents[a]) * power(a, 1) * others
        };
        ((0..3).map(|a| power(a, 0)).product(), DVec3::new(slope(0), slope(1), slope(2)))
    }
}

#[test]
fn polynomials_are_exact_where_claimed_and_nowhere_else() {
    let mut claimed = 0;
    for entry in catalogue() {
        let half = [1.3, 0.5, 0.8];
        let places = places(half, 1.0);
        let mut linear = 0;
        for index in 0..64u32 {
            let exponents = [index % 4, index / 4 % 4, index / 16];
            let field = monomial(exponents);
            let expected = || places.iter().map(|q| field(*q).0);
            let size = expected().map(f64::abs).fold(0.0, f64::max);
            let error = |plant| worst(&values::<f64>(&entry.rig, half, &field, &places, plant), expected()) / size;
            if entry.rig.reproduces(half, exponents) {
                claimed += 1;
                let allowed = tolerance(&entry.rig, f64::EPSILON);
                assert!(error(HONEST) <= allowed, "{} claims {exponents:?}: off by {}", entry.text, error(HONEST));
                assert!(error(LOUDER) > allowed, "{}: louder weights must not pass", entry.text);
                if exponents.iter().sum::<u32>() == 1 {
                    linear += 1;
                    assert!(error(MOVED) > allowed, "{}: a moved place must not pass", entry.text);
                }
            } else {
                assert!(error(HONEST) > 1e-3, "{} is exact for {exponents:?} and does not claim it", entry.text);
            }
        }
        let full = [
            "gradient = {}",
            "lattice = { samples = [2, 2, 2] }",
            "rbf = { samples = [3, 2, 2], kernel = \"thin_plate\" }",
        ];
        assert!(!full.contains(&entry.text) || linear == 3, "{} is exact for linear fields", entry.text);
    }
    assert!(claimed > 100);
}

#[test]
fn a_box_without_extent_is_the_limit_of_thin_ones() {
    for entry in catalogue() {
        for half in FLAT {
            let thin = half.map(|h| if h == 0.0 { 1e-7 } else { h });
            let places = places(half, 1.2);
            let flat = values::<f64>(&entry.rig, half, &smooth, &places, HONEST);
            let limit = values::<f64>(&entry.rig, thin, &smooth, &places, HONEST);
            assert!(worst(&flat, limit.iter().copied()) < 2e-6, "{} in {half:?}: {flat:?} {limit:?}", entry.text);
            let planted = values::<f64>(&entry.rig, half, &smooth, &places, LOUDER);
            assert!(worst(&planted, limit.iter().copied()) > 2e-6);
        }
    }
}

#[test]
fn weights_stay_finite_near_and_far() {
    for entry in catalogue() {
        let mut boxes: Vec<[f64; 3]> = FULL.into_iter().chain(FLAT).collect();
        boxes.extend([[1e-6; 3], [1e5, 1e5, 1e-5], [1e-20, 1.0, 1e-31], [1e-38, 1e-40, 0.0]]);
        for half in boxes {
            let reach = half.into_iter().fold(1e-3, f64::max);
            let mut at: Vec<DVec3> = entry.rig.placement(half).iter().map(|r| DVec3::from_array(r.position)).collect();
            for k in 0..at.len() {
                at.push(at[k] * (1.0 + 1e-7) + DVec3::splat(1e-30 * reach));
            }
            at.extend([DVec3::ZERO, DVec3::splat(1e-42), DVec3::splat(1e4 * reach), DVec3::splat(-1e4 * reach)]);
            let single = values::<f32>(&entry.rig, half, &constant, &at, HONEST);
            assert!(single.iter().all(|v| v.is_finite()), "{} in {half:?}: {single:?}", entry.text);
            let double = values::<f64>(&entry.rig, half, &constant, &at, HONEST);
            assert!(double.iter().all(|v| v.is_finite()), "{} in {half:?}: {double:?}", entry.text);
        }
    }
}

/// Inverse distance as it is first written down: 1/d over the sum of 1/d.
struct NaiveInverseDistance {
    samples: Vec<DVec3>,
}

impl RigModel<f32> for NaiveInverseDistance {
    fn taps(&self, q: Vector3<f32>, tap: &mut impl FnMut(usize, f32)) {
        let weights: Vec<f32> = self.samples.iter().map(|s| 1.0 / (q - Vector3::of(*s)).length()).collect();
        let sum: f32 = weights.iter().sum();
        weights.iter().enumerate().for_each(|(i, w)| tap(i, w / sum));
    }
}

#[test]
fn naive_inverse_distance_is_not_finite_at_a_sample_and_the_rigs_is() {
    let rig = AnyRig::inline("lattice = { samples = [2, 2, 2], interpolation = \"inverse_distance\" }").unwrap();
    let samples: Vec<DVec3> = rig.placement(FULL[0]).iter().map(|r| DVec3::from_array(r.position)).collect();
    let all_finite = |model: &dyn Fn(Vector3<f32>, &mut Vec<f32>)| {
        let mut weights = Vec::new();
        samples.iter().for_each(|s| model(Vector3::of(*s), &mut weights));
        weights.iter().all(|w| w.is_finite())
    };
    let naive = NaiveInverseDistance { samples: samples.clone() };
    assert!(!all_finite(&|q, weights| naive.taps(q, &mut |_, w| weights.push(w))));
    let model = rig.model::<f32>(FULL[0]);
    assert!(all_finite(&|q, weights| model.taps(q, &mut |_, w| weights.push(w))));
}

#[test]
fn single_precision_follows_double() {
    for entry in catalogue() {
        for half in FULL.into_iter().chain(FLAT) {
            let places = places(half, 1.0);
            let double = values::<f64>(&entry.rig, half, &smooth, &places, HONEST);
            let error =
                |plant| worst(&values::<f32>(&entry.rig, half, &smooth, &places, plant), double.iter().copied());
            // ties of nearest are ties in both precisions
            let allowed = tolerance(&entry.rig, f64::from(f32::EPSILON)).min(1e-4);
            assert!(error(HONEST) <= allowed, "{} in {half:?}: {}", entry.text, error(HONEST));
            assert!(error(LOUDER) > allowed, "{}: louder weights must not pass", entry.text);
        }
    }
}

/// RMS error over fixed places of a lattice with `cells` cells an axis.
fn lattice_error(interpolation: &str, cells: usize) -> f64 {
    let half = [1.0, 0.9, 1.1];
    let n = cells + 1;
    let rig =
        AnyRig::inline(&format!("lattice = {{ samples = [{n}, {n}, {n}], interpolation = \"{interpolation}\" }}"));
    let mut stream = Stream::indexed(5, StreamPurpose::Test, 2);
    let places: Vec<DVec3> = (0..400).map(|_| DVec3::from_array(half.map(|h| stream.uniform_between(-h, h)))).collect();
    let got = values::<f64>(&rig.unwrap(), half, &smooth, &places, HONEST);
    let squares: f64 = got.iter().zip(&places).map(|(g, q)| (g - smooth(*q).0).powi(2)).sum();
    (squares / places.len() as f64).sqrt()
}

/// Slope of log error against log spacing between an eighth and a thirty-second of the extent.
fn measured_order(interpolation: &str) -> f64 {
    (lattice_error(interpolation, 8) / lattice_error(interpolation, 32)).log2() / 2.0
}

#[test]
fn errors_fall_with_the_spacing_at_their_order() {
    for (interpolation, order) in [
        ("nearest", 1.0),
        ("inverse_distance", 1.0),
        ("trilinear", 2.0),
        ("gradient_corrected", 2.0),
        ("half_gradient", 3.0),
    ] {
        let measured = measured_order(interpolation);
        assert!((measured - order).abs() < 0.15, "{interpolation}: order {measured} for {order}");
    }
    // without mixed derivatives the cubic falls from nearly third order towards the second as the lattice is refined
    let coarse = (lattice_error("tricubic", 2) / lattice_error("tricubic", 4)).log2();
    let fine = measured_order("tricubic");
    assert!(coarse > 2.5 && (1.9..2.3).contains(&fine), "tricubic: {coarse}, then {fine}");
    // the full gradient in the half gradient's place must not pass for third order
    assert!((measured_order("gradient_corrected") - 3.0).abs() > 0.5);
}

#[test]
fn ties_of_nearest_go_to_the_lower_sample() {
    let rig = AnyRig::inline("lattice = { samples = [4, 3, 2], interpolation = \"nearest\" }").unwrap();
    for half in [[1.0, 1.0, 1.0], [0.3, 0.7, 1.1], [1.0 / 3.0, 1e-3, 123.4]] {
        for (i, j) in [(0, 0), (1, 1), (2, 0)] {
            // the middle of a cell, computed with its rounding
            let middle = |a: usize, cell: usize, n: usize| half[a] * ((2 * cell + 1) as f64 / (n - 1) as f64 - 1.0);
            let q = DVec3::new(middle(0, i, 4), middle(1, j, 3), middle(2, 0, 2));
            let expected = i + 4 * j;
            let mut got = Vec::new();
            rig.model::<f64>(half).taps(Vector3::of(q), &mut |vector, weight| got.push((vector, weight)));
            assert_eq!(got, [(expected, 1.0)], "double at {q}");
            let mut got = Vec::new();
            rig.model::<f32>(half).taps(Vector3::of(q), &mut |vector, weight| got.push((vector, weight)));
            assert_eq!(got, [(expected, 1.0)], "single at {q}");
            let mut above = Vec::new();
            let beyond = q + 1e-4 * DVec3::from_array(half);
            rig.model::<f32>(half).taps(Vector3::of(beyond), &mut |vector, _| above.push(vector));
            assert_eq!(above, [expected + 1 + 4 + 12], "beyond the tie at {q}");
        }
    }
}

/// Relative RMS of the order-3 SH vectors under one sphere light beside the box, exact gradients, `cells` cells an axis.
fn sphere_light_error(interpolation: &str, cells: usize) -> f64 {
    let light = Light::Sphere(Sphere { center: Vector3::zero(), radius: 0.25, radiance: Rgb::splat(1.0) });
    let bounds = OrientedBox::aligned(DVec3::new(0.6, -0.5, -0.5), DVec3::new(1.6, 0.5, 0.5));
    let lights = [light.relative_to::<f64>(bounds.center)];
    let n = cells + 1;
    let rig =
        AnyRig::inline(&format!("lattice = {{ samples = [{n}, {n}, {n}], interpolation = \"{interpolation}\" }}"));
    let rig = rig.unwrap();
    let requests = rig.placement(bounds.half);
    let sampled = sample_lights(&lights, &bounds, &requests, 3, GradientSource::Analytic, Window::None);
    let vectors = rig.fit(bounds.half, sampled.vectors).vectors;
    let model = rig.model::<f64>(bounds.half);
    let mut stream = Stream::indexed(6, StreamPurpose::Test, 0);
    let (mut error, mut size) = (0.0, 0.0);
    for _ in 0..3000 {
        let q = DVec3::from_array(bounds.half.map(|h| stream.uniform_between(-h, h)));
        let exact = projection::<f64, 9>(&lights, Vector3::of(q)).value;
        let mut got = [0.0; 9];
        model.taps(Vector3::of(q), &mut |vector, weight| {
            (0..9).for_each(|i| got[i] += vectors.vector(vector)[3 * i] * weight);
        });
        error += (0..9).map(|i| (got[i] - exact[i].r).powi(2)).sum::<f64>();
        size += exact.iter().map(|c| c.r * c.r).sum::<f64>();
    }
    (error / size).sqrt()
}

/// Figures for this light and box, at cells 2, 4, 8 and 16 an axis, of another program at other random places.
#[test]
fn errors_under_a_sphere_light_are_those_known() {
    for (interpolation, known) in [
        ("nearest", [0.482, 0.233, 0.113, 0.0577]),
        ("trilinear", [0.163, 0.0385, 0.00915, 0.00223]),
        ("gradient_corrected", [0.192, 0.0427, 0.00946, 0.00225]),
        ("half_gradient", [0.0436, 0.00546, 0.000620, 0.0000768]),
        ("tricubic", [0.0418, 0.00595, 0.000907, 0.000185]),
    ] {
        for (cells, known) in [2, 4, 8, 16].into_iter().zip(known) {
            let measured = sphere_light_error(interpolation, cells);
            println!("{interpolation} {cells}: {measured} for {known}");
            assert!((measured / known - 1.0).abs() < 0.12, "{interpolation}, {cells} cells: {measured} for {known}");
        }
    }
}
