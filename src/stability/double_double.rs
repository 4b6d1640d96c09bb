use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number of about 31 digits as the unevaluated sum of two: the independent route of small linear systems (Dekker 1971; Hida, Li and
/// Bailey 2001). Only what the eigenvalues of a symmetric matrix take.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DoubleDouble {
    high: f64,
    low: f64,
}

impl DoubleDouble {
    pub fn of(value: f64) -> Self {
        Self { high: value, low: 0.0 }
    }

    /// The nearest `f64`.
    pub fn rounded(self) -> f64 {
        self.high + self.low
    }

    /// The sum of two numbers of which the first is not the smaller.
    fn quick(high: f64, low: f64) -> Self {
        let sum = high + low;
        Self { high: sum, low: low - (sum - high) }
    }

    /// The exact sum.
    fn sum(a: f64, b: f64) -> Self {
        let sum = a + b;
        let part = sum - a;
        Self { high: sum, low: (a - (sum - part)) + (b - part) }
    }

    pub fn sqrt(self) -> Self {
        if self.high <= 0.0 {
            return Self::default();
        }
        // one step of Newton's iteration from the root in f64
        let root = self.high.sqrt();
        let rest = self - Self::of(root) * Self::of(root);
        Self::quick(root, rest.high / (2.0 * root))
    }

    pub fn abs(self) -> Self {
        if self.high < 0.0 { -self } else { self }
    }
}

impl Add for DoubleDouble {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let high = Self::sum(self.high, other.high);
        let low = Self::sum(self.low, other.low);
        let first = Self::quick(high.high, high.low + low.high);
        Self::quick(first.high, first.low + low.low)
    }
}

impl Neg for DoubleDouble {
    type Output = Self;
    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Sub for DoubleDouble {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for DoubleDouble {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let product = self.high * other.high;
        let error = self.high.mul_add(other.high, -product);
        Self::quick(product, error + (self.high * other.low + self.low * other.high))
    }
}

impl Div for DoubleDouble {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let first = self.high / other.high;
        let rest = self - other * Self::of(first);
        let second = rest.high / other.high;
        let rest = rest - other * Self::of(second);
        Self::quick(first, second) + Self::of(rest.high / other.high)
    }
}

/// The pseudo-inverse of a symmetric matrix (row by row), eigenvalues of at most `cut` times the largest in size left out:
/// Jacobi's rotations in double-double.
pub fn symmetric_pseudo_inverse(matrix: &[f64], size: usize, cut: f64) -> Vec<f64> {
    let mut a: Vec<DoubleDouble> = matrix.iter().map(|v| DoubleDouble::of(*v)).collect();
    let one = DoubleDouble::of(1.0);
    let mut vectors = vec![DoubleDouble::default(); size * size];
    (0..size).for_each(|i| vectors[i * size + i] = one);
    for _ in 0..60 {
        let (mut off, mut all) = (0.0, 0.0);
        for i in 0..size {
            for j in 0..size {
                let square = a[i * size + j].rounded().powi(2);
                all += square;
                off += if i == j { 0.0 } else { square };
            }
        }
        if off <= 1e-58 * all {
            break;
        }
        for p in 0..size {
            for q in p + 1..size {
                let element = a[p * size + q];
                if element.rounded() == 0.0 {
                    continue;
                }
                // the smaller root of t^2 + 2 theta t - 1 = 0
                let theta = (a[q * size + q] - a[p * size + p]) / (element + element);
                let root = (theta * theta + one).sqrt();
                let t = match theta.rounded() >= 0.0 {
                    true => one / (theta + root),
                    false => -(one / (root - theta)),
                };
                let t = if t.rounded().is_finite() { t } else { DoubleDouble::default() };
                let cosine = one / (t * t + one).sqrt();
                let sine = t * cosine;
                for k in 0..size {
                    let (x, y) = (a[k * size + p], a[k * size + q]);
                    a[k * size + p] = cosine * x - sine * y;
                    a[k * size + q] = sine * x + cosine * y;
                }
                for k in 0..size {
                    let (x, y) = (a[p * size + k], a[q * size + k]);
                    a[p * size + k] = cosine * x - sine * y;
                    a[q * size + k] = sine * x + cosine * y;
                    let (x, y) = (vectors[k * size + p], vectors[k * size + q]);
                    vectors[k * size + p] = cosine * x - sine * y;
                    vectors[k * size + q] = sine * x + cosine * y;
                }
            }
        }
    }
    let eigenvalue = |k: usize| a[k * size + k];
    let largest = (0..size).map(|k| eigenvalue(k).abs().rounded()).fold(0.0, f64::max);
    let mut inverse = vec![DoubleDouble::default(); size * size];
    for k in (0..size).filter(|k| eigenvalue(*k).abs().rounded() > cut * largest) {
        for i in 0..size {
            let scaled = vectors[i * size + k] / eigenvalue(k);
            for j in 0..size {
                inverse[i * size + j] = inverse[i * size + j] + scaled * vectors[j * size + k];
            }
        }
    }
    inverse.into_iter().map(DoubleDouble::rounded).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arithmetic_keeps_thirty_digits() {
        let (two, three) = (DoubleDouble::of(2.0), DoubleDouble::of(3.0));
        let third = DoubleDouble::of(1.0) / three;
        assert!((third * three - DoubleDouble::of(1.0)).rounded().abs() < 1e-31);
        let root = two.sqrt();
        assert!((root * root - two).rounded().abs() < 1e-31);
        let small = DoubleDouble::of(1.0) + DoubleDouble::of(1e-25);
        assert!(((small - DoubleDouble::of(1.0)).rounded() - 1e-25).abs() < 1e-31);
    }

    #[test]
    fn the_pseudo_inverse_inverts_what_has_an_inverse_and_cuts_the_rest() {
        // rank two of three: the third row is the sum of the others
        let matrix = [2.0, 1.0, 3.0, 1.0, 3.0, 4.0, 3.0, 4.0, 7.0];
        let inverse = symmetric_pseudo_inverse(&matrix, 3, 1e-11);
        let product = |a: &[f64], b: &[f64]| -> Vec<f64> {
            (0..9).map(|i| (0..3).map(|k| a[i / 3 * 3 + k] * b[k * 3 + i % 3]).sum()).collect()
        };
        let back = product(&product(&matrix, &inverse), &matrix);
        assert!(back.iter().zip(&matrix).all(|(a, b)| (a - b).abs() < 1e-13), "{back:?}");
        let again = product(&product(&inverse, &matrix), &inverse);
        assert!(again.iter().zip(&inverse).all(|(a, b)| (a - b).abs() < 1e-13), "{again:?}");
        assert!(inverse.iter().any(|v| v.abs() > 0.01));
    }
}
