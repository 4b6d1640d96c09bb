use super::Scheme;
use crate::math::Real;
use crate::rig::{Grid, GridAxis, Lane, Nodes, tensor_taps};

/// Each corner's first-order expansion at p, trilinear weights ("functions and gradients"):
/// l(p) = sum_k w_k (f_k + g_k . (p - x_k)). Second order, like trilinear, with the opposite sign of the leading error.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct GradientCorrected {}

/// Linear value weights, and slopes w_i (q - x_i) times `share`. An axis with one sample takes the full derivative,
/// whatever the share.
#[inline(always)]
pub fn corrected_nodes<T: Real, L: Lane<Scalar = T>>(axis: &GridAxis<T>, q: L, share: f64) -> Nodes<L> {
    if axis.count == 1 {
        return Nodes::one(axis.clamp(q));
    }
    let (lower, t) = axis.cell(q);
    let rest = L::constant(1.0) - t;
    // q - x is t spacings beyond the lower sample and 1 - t before the upper one
    let slope = L::splat(T::of(share) * axis.spacing) * t * rest;
    Nodes::two(lower, [rest, t], [slope, L::constant(0.0) - slope])
}

/// The weights with this share of the derivatives.
#[inline(always)]
pub fn corrected_taps<T: Real, L: Lane<Scalar = T>>(
    grid: &Grid<T>,
    [x, y, z]: [L; 3],
    share: f64,
    tap: &mut impl FnMut(L::Index, usize, L),
) {
    let [along_x, along_y, along_z] = &grid.axes;
    let nodes =
        [corrected_nodes(along_x, x, share), corrected_nodes(along_y, y, share), corrected_nodes(along_z, z, share)];
    tensor_taps(grid, &nodes, tap);
}

impl Scheme for GradientCorrected {
    fn configured(_power: f64) -> Self {
        Self {}
    }

    fn uses_derivatives(&self) -> bool {
        true
    }

    #[inline(always)]
    fn taps<T: Real, L: Lane<Scalar = T>>(&self, grid: &Grid<T>, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        corrected_taps(grid, q, 1.0, tap);
    }

    fn wgsl(&self) -> String {
        corrected_wgsl(1.0)
    }

    /// A product of linear factors, of which sums with full derivatives have one on one-sample axes at most.
    fn reproduces(&self, counts: [usize; 3], exponents: [u32; 3]) -> bool {
        exponents.iter().all(|e| *e <= 1) && one_expanded_axis(counts, exponents)
    }
}

/// Whether at most one of the axes with a single sample has a factor: cross terms need mixed derivatives.
pub fn one_expanded_axis(counts: [usize; 3], exponents: [u32; 3]) -> bool {
    (0..3).filter(|a| counts[*a] == 1 && exponents[*a] > 0).count() <= 1
}

/// The twin with this share of the derivatives.
pub fn corrected_wgsl(share: f32) -> String {
    format!("const GRADIENT_SHARE = {};\n{}", crate::rig::wgsl_number(share), include_str!("gradient_corrected.wgsl"))
}
