use std::f64::consts::PI;

use glam::DMat3;

use super::{MAX_COEFFICIENTS, MAX_ORDER, ShRgb, basis, order_of};
use crate::math::{Real, Rgb, Vector3, gauss_legendre};

/// The rotation of SH vectors by a rotation matrix R: the signal w -> f(R^T w), so that a peak at d moves to R d.
///
/// Bands rotate apart; band l has the (2l+1) x (2l+1) matrix D_mm' = integral of Y_m(w) Y_m'(R^T w) dw,
/// here by a product quadrature that is exact for these polynomials.
#[derive(Clone, Debug)]
pub struct Rotation {
    /// Rows of the whole matrix; entries outside the diagonal blocks are never read.
    matrix: Box<[[f64; MAX_COEFFICIENTS]; MAX_COEFFICIENTS]>,
}

impl Rotation {
    /// From a proper or improper orthogonal matrix.
    pub fn new(rotation: DMat3) -> Self {
        let mut matrix = Box::new([[0.0; MAX_COEFFICIENTS]; MAX_COEFFICIENTS]);
        let inverse = rotation.transpose();
        let polar = gauss_legendre(MAX_ORDER);
        let azimuths = 2 * MAX_ORDER;
        for (z, weight) in polar.nodes.iter().zip(&polar.weights) {
            let r = (1.0 - z * z).sqrt();
            for k in 0..azimuths {
                let phi = 2.0 * PI * (k as f64 + 0.5) / azimuths as f64;
                let d = glam::DVec3::new(r * phi.cos(), r * phi.sin(), *z);
                let at = basis::<f64, MAX_COEFFICIENTS>(Vector3::of(d));
                let from = basis::<f64, MAX_COEFFICIENTS>(Vector3::of(inverse * d));
                let area = weight * 2.0 * PI / azimuths as f64;
                for degree in 0..MAX_ORDER {
                    for i in degree * degree..(degree + 1) * (degree + 1) {
                        for j in degree * degree..(degree + 1) * (degree + 1) {
                            matrix[i][j] += area * at[i] * from[j];
                        }
                    }
                }
            }
        }
        Self { matrix }
    }

    /// The rotated coefficients.
    pub fn apply<T: Real, const C: usize>(&self, coefficients: &ShRgb<T, C>) -> ShRgb<T, C> {
        let mut rotated = [Rgb::zero(); C];
        for degree in 0..order_of(C) {
            for i in degree * degree..(degree + 1) * (degree + 1) {
                for j in degree * degree..(degree + 1) * (degree + 1) {
                    rotated[i] += coefficients[j] * T::of(self.matrix[i][j]);
                }
            }
        }
        rotated
    }
}
