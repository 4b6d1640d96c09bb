//! Rules for the one-dimensional integrals to which the shapes' answers come down.

use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

use crate::math::Real;
use crate::sh::Lobe;

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
    static DOUBLE: LazyLock<Vec<Node>> = LazyLock::new(|| tanh_sinh(0.1, 3.2));
    static SINGLE: LazyLock<Vec<Node>> = LazyLock::new(|| tanh_sinh(0.2, 2.4));
    if T::epsilon().to_double() < 1e-10 { &DOUBLE } else { &SINGLE }
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
