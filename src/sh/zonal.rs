use std::f64::consts::PI;

use super::MAX_ORDER;
use crate::math::Real;

/// The reflectance lobe f with which a receiver gathers light about its normal:
/// f(c) = ((c + a)/(1 + a))^(1 + a) for c = cos(angle) > -a, else 0. `a = 0` is Lambert's clamped cosine,
/// `a = 1` the squared half-Lambert.
///
/// E(p, n) = integral of L(p, w) f(n . w) dw; in SH, E_i = A_degree(i) L_i with A = [`Lobe::bands`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe<T> {
    wrap: T,
    bands: [T; MAX_ORDER],
}

impl<T: Real> Lobe<T> {
    /// The lobe of wrap `a` in [0, 1].
    pub fn new(wrap: f64) -> Self {
        assert!((0.0..=1.0).contains(&wrap), "a wrap lies in [0, 1], got {wrap}");
        Self { wrap: T::of(wrap), bands: wrap_bands(wrap).map(T::of) }
    }

    /// The clamped cosine.
    pub fn lambert() -> Self {
        Self::new(0.0)
    }

    #[inline(always)]
    pub fn wrap(&self) -> T {
        self.wrap
    }

    /// Whether this is the clamped cosine, for which shapes have closed forms.
    #[inline(always)]
    pub fn is_lambert(&self) -> bool {
        self.wrap == T::zero()
    }

    /// A_0 to A_5.
    #[inline(always)]
    pub fn bands(&self) -> &[T; MAX_ORDER] {
        &self.bands
    }

    /// f at the cosine of the angle to the normal.
    #[inline(always)]
    pub fn value(&self, cosine: T) -> T {
        if self.is_lambert() {
            return cosine.max(T::zero());
        }
        let one = T::one();
        let u = (cosine + self.wrap) / (one + self.wrap);
        if u <= T::zero() { T::zero() } else { u.powf(one + self.wrap) }
    }
}

/// Coefficients of the Legendre polynomials of degree 0 to 5, ascending powers.
const LEGENDRE: [[f64; 6]; 6] = [
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    [-0.5, 0.0, 1.5, 0.0, 0.0, 0.0],
    [0.0, -1.5, 0.0, 2.5, 0.0, 0.0],
    [0.375, 0.0, -3.75, 0.0, 4.375, 0.0],
    [0.0, 1.875, 0.0, -8.75, 0.0, 7.875],
];

/// A_k = 2 pi integral over [-a, 1] of f P_k. With u = (c + a)/(1 + a), c = (1 + a) u - a, f = u^(1+a):
/// A_k = 2 pi (1 + a) sum_p [P_k]_p sum_j binomial(p, j) (1 + a)^j (-a)^(p - j) / (2 + a + j).
/// Odd degrees above 1 vanish for the clamped cosine; they are written as exact zeros there.
fn wrap_bands(a: f64) -> [f64; MAX_ORDER] {
    std::array::from_fn(|degree| {
        if a == 0.0 && degree > 1 && degree % 2 == 1 {
            return 0.0;
        }
        let mut sum = 0.0;
        for (power, coefficient) in LEGENDRE[degree].iter().enumerate() {
            let mut binomial = 1.0;
            for j in 0..=power {
                if j > 0 {
                    binomial *= (power - j + 1) as f64 / j as f64;
                }
                let term = binomial * (1.0 + a).powi(j as i32) * (-a).powi((power - j) as i32);
                sum += coefficient * term / (2.0 + a + j as f64);
            }
        }
        2.0 * PI * (1.0 + a) * sum
    })
}

/// P_0(x) to P_(N-1)(x) by the three-term recurrence.
#[inline(always)]
pub fn legendre_polynomials<T: Real, const N: usize>(x: T) -> [T; N] {
    let mut p = [T::one(); N];
    if N > 1 {
        p[1] = x;
    }
    for k in 2..N {
        let degree = k as f64;
        p[k] = (T::of(2.0 * degree - 1.0) * x * p[k - 1] - T::of(degree - 1.0) * p[k - 2]) / T::of(degree);
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::gauss_legendre;

    #[test]
    fn bands_are_the_legendre_integrals_of_the_lobe() {
        for wrap in [0.0, 0.1, 0.25, 0.5, 0.77, 1.0] {
            let lobe = Lobe::<f64>::new(wrap);
            // t = -a + (1 + a) s^4 tames the power at the lobe's foot
            for degree in 0..6 {
                let quadrature = gauss_legendre(64).integrate(0.0, 1.0, |s| {
                    let t = -wrap + (1.0 + wrap) * s.powi(4);
                    let jacobian = (1.0 + wrap) * 4.0 * s.powi(3);
                    lobe.value(t) * legendre_polynomials::<f64, 6>(t)[degree] * jacobian
                }) * 2.0
                    * PI;
                let closed = lobe.bands()[degree];
                assert!((closed - quadrature).abs() < 1e-10, "a = {wrap}, degree {degree}: {closed} for {quadrature}");
            }
        }
    }

    #[test]
    fn low_bands_have_their_published_factors() {
        for a in [0.0f64, 0.3, 1.0] {
            let bands = wrap_bands(a);
            let expected = [
                2.0 * (1.0 + a) / (2.0 + a),
                4.0 * (1.0 + a) / ((2.0 + a) * (3.0 + a)),
                2.0 * (1.0 + a) * (3.0 - 2.0 * a + a * a) / ((2.0 + a) * (3.0 + a) * (4.0 + a)),
            ];
            for degree in 0..3 {
                assert!((bands[degree] / PI - expected[degree]).abs() < 1e-14, "a = {a}, degree {degree}");
            }
        }
    }
}
