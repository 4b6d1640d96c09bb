//! The integrals to which the shapes' answers come down: rules in one dimension, and what a piece of an emitter's
//! contour or area adds to the SH projection and to the irradiance.
//!
//! An emitter of uniform radiance is a region of directions w; with r the vector from the point to the emitter's contour,
//! w = r/|r|, and nu ds = (r x dr)/|r|^2 the region's outward conormal times the contour's length on the sphere (the contour
//! runs counter-clockwise as the point sees it), Gauss's theorem on the sphere turns each area integral into one over the contour:
//! - SH of degree k >= 1, as Y is an eigenfunction of the Laplacian: L_i = -1/(k (k + 1)) contour integral of grad Y_i . nu ds;
//! - the spatial gradient, as the contour moves by -dp/|r|: grad L_i = -(contour integral of Y_i (1/|r|) nu ds), for every degree;
//! - the solid angle: -(contour integral of d . nu ds/(1 + d . w)) for any d with d . w > -1 on the region;
//! - irradiance under a lobe: [`lobe_flux`].

use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

use super::UnitGradient;
use crate::math::{Real, Vector3, gauss_legendre};
use crate::sh::{Lobe, basis, basis_gradient, degree_of};

/// A node of a rule on (0, 1): its distances from both ends, each to full relative precision, and its weight.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    pub from_start: f64,
    pub to_end: f64,
    pub weight: f64,
}

/// The tanh-sinh rule (Takahasi and Mori 1974): nodes crowd towards both ends double-exponentially, so that an integrand
/// with any integrable behaviour at the ends of the interval converges as fast as a smooth one.
fn tanh_sinh(step: f64, reach: f64) -> Vec<Node> {
    let count = (reach / step).round() as i32;
    (-count..=count)
        .map(|k| {
            let t = f64::from(k) * step;
            let s = FRAC_PI_2 * t.sinh();
            Node {
                from_start: 1.0 / (1.0 + (-2.0 * s).exp()),
                to_end: 1.0 / (1.0 + (2.0 * s).exp()),
                weight: step * 0.5 * FRAC_PI_2 * t.cosh() / s.cosh().powi(2),
            }
        })
        .collect()
}

/// The tanh-sinh rule that suits a scalar's precision.
pub fn end_crowding<T: Real>() -> &'static [Node] {
    static DOUBLE: LazyLock<Vec<Node>> = LazyLock::new(|| tanh_sinh(0.0625, 3.25));
    static SINGLE: LazyLock<Vec<Node>> = LazyLock::new(|| tanh_sinh(0.2, 2.4));
    if is_double::<T>() { &DOUBLE } else { &SINGLE }
}

/// The most nodes of [`gauss`].
pub const MOST_NODES: usize = 48;

/// The Gauss-Legendre rule of `count` nodes on (0, 1): (node, weight).
pub fn gauss(count: usize) -> &'static [(f64, f64)] {
    static RULES: LazyLock<Vec<Vec<(f64, f64)>>> = LazyLock::new(|| {
        (1..=MOST_NODES)
            .map(|count| {
                let rule = gauss_legendre(count);
                rule.nodes.iter().zip(&rule.weights).map(|(x, w)| (0.5 + 0.5 * x, 0.5 * w)).collect()
            })
            .collect()
    });
    &RULES[count - 1]
}

/// Whether a scalar has the precision of `f64`: rules take as many nodes as the precision can use.
#[inline(always)]
pub fn is_double<T: Real>() -> bool {
    T::epsilon().to_double() < 1e-10
}

/// Adds what a node of the contour gives to SH coefficients of degree 1 and up. `conormal` is nu ds there.
#[inline(always)]
pub fn add_contour_node<T: Real, const C: usize>(sh: &mut [T; C], w: Vector3<T>, conormal: Vector3<T>) {
    let (_, gradients) = basis_gradient::<T, C>(w);
    for i in 1..C {
        let degree = degree_of(i);
        sh[i] -= gradients[i].dot(conormal) / T::of((degree * (degree + 1)) as f64);
    }
}

/// As [`add_contour_node`], and what it gives to the spatial gradients of all degrees.
#[inline(always)]
pub fn add_contour_node_with_gradient<T: Real, const C: usize>(
    sh: &mut UnitGradient<T, C>,
    w: Vector3<T>,
    conormal: Vector3<T>,
    inverse_distance: T,
) {
    let (values, gradients) = basis_gradient::<T, C>(w);
    let spread = conormal * inverse_distance;
    sh.gradient[0] -= spread * values[0];
    for i in 1..C {
        let degree = degree_of(i);
        sh.value[i] -= gradients[i].dot(conormal) / T::of((degree * (degree + 1)) as f64);
        sh.gradient[i] -= spread * values[i];
    }
}

/// Adds what a piece of the emitter's area gives: dL_i = Y_i cos_e dA/r^2. `to` goes from the point to the piece.
/// For emitters that are small as seen from the point, where the contour's two sides would cancel.
#[inline(always)]
pub fn add_area_node<T: Real, const C: usize>(sh: &mut [T; C], to: Vector3<T>, normal: Vector3<T>, area: T) {
    let distance = to.length();
    let w = to / distance;
    let solid_angle = -normal.dot(w) * area / (distance * distance);
    let values = basis::<T, C>(w);
    for i in 0..C {
        sh[i] += values[i] * solid_angle;
    }
}

/// As [`add_area_node`] with the gradient of Annen et al. 2004: dA/r^3 { Y_i [3 cos_e w + m] - cos_e grad_S Y_i }.
#[inline(always)]
pub fn add_area_node_with_gradient<T: Real, const C: usize>(
    sh: &mut UnitGradient<T, C>,
    to: Vector3<T>,
    normal: Vector3<T>,
    area: T,
) {
    let distance = to.length();
    let w = to / distance;
    let cosine = -normal.dot(w);
    let (values, gradients) = basis_gradient::<T, C>(w);
    let per_square = area / (distance * distance);
    let per_cube = per_square / distance;
    let along = (w * (T::of(3.0) * cosine) + normal) * per_cube;
    for i in 0..C {
        sh.value[i] += values[i] * cosine * per_square;
        let surface = gradients[i] - w * gradients[i].dot(w);
        sh.gradient[i] += along * values[i] - surface * (cosine * per_cube);
    }
}

/// The kernel of an irradiance as a contour integral, for any lobe f about the normal n:
/// E = G(-1)/2 * solid angle - contour integral of K(n . w) n . nu ds, K(c) = (G(c) - G(-1) (1 - c)/2)/(1 - c^2).
///
/// f minus its mean over the sphere is the divergence of a field along the meridians about n; taking the mean out makes the field
/// regular at both poles, so that no case asks whether the region holds a pole. With p = 2 + a:
/// K = G(-1) [1/(2 (1 - c)) - u^p/(1 - c^2)], and near c = 1, where both parts grow, G(-1) (-x/2 - expm1(p ln(1 - x/(1 + a))))/(x (2 - x)).
pub fn lobe_flux<T: Real>(lobe: &Lobe<T>, cosine: T) -> T {
    let (one, two, a) = (T::one(), T::of(2.0), lobe.wrap());
    let whole = lobe_integral_whole(lobe);
    let x = one - cosine;
    let foot = (cosine + a) / (one + a);
    if foot <= T::zero() {
        return whole / (two * x);
    }
    let power = two + a;
    if x < T::of(0.5) {
        if x.abs() <= T::epsilon() {
            return whole * (power / (one + a) - T::of(0.5)) / two;
        }
        let rise = (power * (-x / (one + a)).ln_1p()).exp_m1();
        return -whole * (x / two + rise) / (x * (two - x));
    }
    // u/(1 + c) <= 1/(1 + a): finite where c goes to -1 with a = 1
    whole / x * (T::of(0.5) - foot.powf(one + a) * (foot / (one + cosine)))
}

/// G(c) = integral of the lobe f over cosines from c to 1, as a function of x = 1 - c (so that c near 1 keeps its precision):
/// G = (1 + a)/(2 + a) (1 - u^(2+a)), u = max(0, 1 - x/(1 + a)).
pub fn lobe_integral<T: Real>(lobe: &Lobe<T>, one_minus_cosine: T) -> T {
    let (one, a) = (T::one(), lobe.wrap());
    let foot = one_minus_cosine / (one + a);
    let whole = lobe_integral_whole(lobe);
    if foot >= one { whole } else { -whole * ((a + T::of(2.0)) * (-foot).ln_1p()).exp_m1() }
}

/// G(-1) = (1 + a)/(2 + a).
pub fn lobe_integral_whole<T: Real>(lobe: &Lobe<T>) -> T {
    (T::one() + lobe.wrap()) / (T::of(2.0) + lobe.wrap())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tanh_sinh_integrates_end_singularities() {
        for power in [-0.5, 0.0, 0.1, 0.5, 1.7, 3.0] {
            let expected = 1.0 / (power + 1.0);
            let double: f64 = end_crowding::<f64>().iter().map(|n| n.weight * n.from_start.powf(power)).sum();
            let single: f64 = end_crowding::<f32>().iter().map(|n| n.weight * n.to_end.powf(power)).sum();
            let allowed = if power < 0.0 { (1e-7, 1e-3) } else { (1e-13, 1e-5) };
            assert!((double - expected).abs() < allowed.0 * expected, "{power}: {double}");
            assert!((single - expected).abs() < allowed.1 * expected, "{power}: {single}");
        }
    }

    #[test]
    fn the_lobe_integral_is_that_of_the_lobe() {
        for wrap in [0.0, 0.3, 1.0] {
            let lobe = Lobe::<f64>::new(wrap);
            for c in [-1.0, -0.7, -0.3, 0.0, 0.4, 0.999999, 1.0f64] {
                let foot = c.max(-wrap);
                let direct: f64 = end_crowding::<f64>()
                    .iter()
                    .map(|n| n.weight * lobe.value(foot + (1.0 - foot) * n.from_start) * (1.0 - foot))
                    .sum();
                assert!((lobe_integral(&lobe, 1.0 - c) - direct).abs() < 1e-14, "a = {wrap}, c = {c}");
            }
        }
    }
}
