use super::Scheme;
use super::gradient_corrected::{corrected_taps, corrected_wgsl};
use crate::math::Real;
use crate::rig::{Grid, Lane};

/// Trilinear weights on each corner's expansion with half of its gradient: l(p) = sum_k w_k (f_k + 1/2 g_k . (p - x_k)).
/// The leading errors of trilinear and of the full gradient are equal and opposite, so that half of the gradient
/// cancels them: third order. On an axis with one sample there is nothing to cancel, and it uses the full derivative.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct HalfGradient {}

impl Scheme for HalfGradient {
    fn configured(_power: f64) -> Self {
        Self {}
    }

    fn uses_derivatives(&self) -> bool {
        true
    }

    #[inline(always)]
    fn taps<T: Real, L: Lane<Scalar = T>>(&self, grid: &Grid<T>, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        corrected_taps(grid, q, 0.5, tap);
    }

    fn wgsl(&self) -> String {
        corrected_wgsl(0.5)
    }

    /// Quadratics, and products of linear factors with one square at most; a factor of a one-sample axis leaves no square.
    fn reproduces(&self, counts: [usize; 3], exponents: [u32; 3]) -> bool {
        let squares = exponents.iter().filter(|e| **e == 2).count();
        let expanded = (0..3).filter(|a| counts[*a] == 1 && exponents[*a] > 0).count();
        (0..3).all(|a| exponents[a] <= if counts[a] == 1 { 1 } else { 2 }) && squares + expanded <= 1
    }
}
