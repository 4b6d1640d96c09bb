use std::f64::consts::PI;

use super::{MAX_ORDER, order_of};
use crate::math::{Real, Vector3};

/// Normalisations N(l, m) = sqrt((2l + 1)/(4 pi) (l - m)!/(l + m)!), times sqrt(2) for m > 0, by [degree][m].
fn normalisations() -> &'static [[f64; MAX_ORDER]; MAX_ORDER] {
    static TABLE: std::sync::LazyLock<[[f64; MAX_ORDER]; MAX_ORDER]> = std::sync::LazyLock::new(|| {
        let mut table = [[0.0; MAX_ORDER]; MAX_ORDER];
        for degree in 0..MAX_ORDER {
            for m in 0..=degree {
                let falling: f64 = ((degree - m + 1)..=(degree + m)).map(|k| k as f64).product();
                let both_signs = if m > 0 { 2.0 } else { 1.0 };
                table[degree][m] = ((2.0 * degree as f64 + 1.0) / (4.0 * PI) / falling * both_signs).sqrt();
            }
        }
        table
    });
    &TABLE
}

/// N(l, m) = sqrt((2l + 1)/(4 pi) (l - m)!/(l + m)!), times sqrt(2) for m > 0: what the basis scales Q(l, m) by.
/// For printing into shaders. Domain: m <= l < 6.
pub fn normalisation(degree: usize, m: usize) -> f64 {
    normalisations()[degree][m]
}

/// Legendre derivatives Q(l, m) = d^m P_l / dz^m for the `order` bands and one m more, so that
/// dQ(l, m)/dz = Q(l, m + 1). From P_l by (l - m) Q(l, m) = (2l - 1) z Q(l-1, m) - (l + m - 1) Q(l-2, m), Q(m, m) = (2m - 1)!!.
#[inline(always)]
fn legendre_derivatives<T: Real>(order: usize, z: T) -> [[T; MAX_ORDER + 1]; MAX_ORDER] {
    let mut q = [[T::zero(); MAX_ORDER + 1]; MAX_ORDER];
    let mut double_factorial = 1.0;
    for m in 0..order {
        if m > 0 {
            double_factorial *= (2 * m - 1) as f64;
        }
        q[m][m] = T::of(double_factorial);
        for degree in m + 1..order {
            let mut value = T::of((2 * degree - 1) as f64) * z * q[degree - 1][m];
            if degree >= m + 2 {
                value -= T::of((degree + m - 1) as f64) * q[degree - 2][m];
            }
            q[degree][m] = value / T::of((degree - m) as f64);
        }
    }
    q
}

/// Values Y_i(d) of the basis at the unit vector `d`, as the polynomials
/// Y(l, +m) = N Q(l, m)(z) Re (x + iy)^m, Y(l, -m) = N Q(l, m)(z) Im (x + iy)^m.
///
/// `C` coefficients, the square of the order. Units sr^-1/2. Domain: unit vectors (others give the polynomials' values).
/// Checked against the shared table of values to 1e-13 and by orthonormality under exact quadrature.
#[inline]
pub fn basis<T: Real, const C: usize>(d: Vector3<T>) -> [T; C] {
    let order = const { order_of(C) };
    let norm = normalisations();
    let q = legendre_derivatives(order, d.z);
    let mut values = [T::zero(); C];
    let (mut re, mut im) = (T::one(), T::zero());
    for m in 0..order {
        if m > 0 {
            (re, im) = (re * d.x - im * d.y, re * d.y + im * d.x);
        }
        for degree in m..order {
            let scaled = T::of(norm[degree][m]) * q[degree][m];
            let centre = degree * (degree + 1);
            values[centre + m] = scaled * re;
            if m > 0 {
                values[centre - m] = scaled * im;
            }
        }
    }
    values
}

/// Values of the basis and the gradients of its polynomials with respect to x, y, z.
///
/// The gradient on the sphere is `g - (g . d) d`. Shapes: `C` values, `C` gradients. Checked against central differences.
#[inline]
pub fn basis_gradient<T: Real, const C: usize>(d: Vector3<T>) -> ([T; C], [Vector3<T>; C]) {
    let order = const { order_of(C) };
    let norm = normalisations();
    let q = legendre_derivatives(order, d.z);
    let mut values = [T::zero(); C];
    let mut gradients = [Vector3::zero(); C];
    // Re and Im of (x + iy)^m, and of the power before it
    let (mut re, mut im) = (T::one(), T::zero());
    let (mut re_before, mut im_before) = (T::zero(), T::zero());
    for m in 0..order {
        if m > 0 {
            (re_before, im_before) = (re, im);
            (re, im) = (re * d.x - im * d.y, re * d.y + im * d.x);
        }
        let power = T::of(m as f64);
        for degree in m..order {
            let n = T::of(norm[degree][m]);
            let scaled = n * q[degree][m];
            let slope = n * q[degree][m + 1];
            let centre = degree * (degree + 1);
            values[centre + m] = scaled * re;
            gradients[centre + m] = Vector3::new(scaled * power * re_before, -scaled * power * im_before, slope * re);
            if m > 0 {
                values[centre - m] = scaled * im;
                gradients[centre - m] =
                    Vector3::new(scaled * power * im_before, scaled * power * re_before, slope * im);
            }
        }
    }
    (values, gradients)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Stream, StreamPurpose, gauss_legendre};

    #[test]
    fn orthonormal_to_order_six() {
        // product rule: 6 Gauss-Legendre nodes in z and 12 equal steps in azimuth are exact to degree 11 > 10
        let rule = gauss_legendre(6);
        let mut gram = [[0.0; 36]; 36];
        for (z, weight) in rule.nodes.iter().zip(&rule.weights) {
            for k in 0..12 {
                let phi = 2.0 * PI * k as f64 / 12.0;
                let r = (1.0 - z * z).sqrt();
                let y = basis::<f64, 36>(Vector3::new(r * phi.cos(), r * phi.sin(), *z));
                for i in 0..36 {
                    for j in 0..36 {
                        gram[i][j] += weight * 2.0 * PI / 12.0 * y[i] * y[j];
                    }
                }
            }
        }
        for i in 0..36 {
            for j in 0..36 {
                let expected = f64::from(u8::from(i == j));
                assert!((gram[i][j] - expected).abs() < 1e-13, "<Y{i}, Y{j}> = {}", gram[i][j]);
            }
        }
    }

    #[test]
    fn gradients_are_those_of_the_polynomials() {
        let mut stream = Stream::indexed(1, StreamPurpose::Test, 1);
        for _ in 0..20 {
            let d = Vector3::<f64>::of(stream.direction());
            let (values, gradients) = basis_gradient::<f64, 36>(d);
            assert_eq!(values, basis::<f64, 36>(d));
            let h = 1e-6;
            for axis in 0..3 {
                let mut step = [0.0; 3];
                step[axis] = h;
                let step = Vector3::from_array(step);
                let (above, below) = (basis::<f64, 36>(d + step), basis::<f64, 36>(d - step));
                for i in 0..36 {
                    let difference = (above[i] - below[i]) / (2.0 * h);
                    assert!((gradients[i][axis] - difference).abs() < 1e-8, "Y{i} axis {axis}");
                }
            }
        }
    }
}
