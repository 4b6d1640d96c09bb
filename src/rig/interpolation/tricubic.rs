use super::Scheme;
use super::gradient_corrected::one_expanded_axis;
use crate::math::Real;
use crate::rig::{Grid, GridAxis, Lane, Nodes, tensor_taps};

/// Tensor cubic Hermite interpolation from values and gradients, mixed derivatives taken as zero.
/// The Hermite data of an axis with one sample are a value and a derivative: the straight line.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Tricubic {}

/// Cubic Hermite weights h00 = (1 + 2t)(1 - t)^2, h01 = t^2 (3 - 2t) on the values and h10 = t (1 - t)^2,
/// h11 = -t^2 (1 - t), times the spacing, on the derivatives.
#[inline(always)]
pub fn hermite_nodes<T: Real, L: Lane<Scalar = T>>(axis: &GridAxis<T>, q: L) -> Nodes<L> {
    if axis.count == 1 {
        return Nodes::one(axis.clamp(q));
    }
    let (lower, t) = axis.cell(q);
    let rest = L::constant(1.0) - t;
    let upper = t * t * (L::constant(3.0) - L::constant(2.0) * t);
    let slope = L::splat(axis.spacing) * t * rest;
    Nodes::two(lower, [L::constant(1.0) - upper, upper], [slope * rest, L::constant(0.0) - slope * t])
}

impl Scheme for Tricubic {
    fn configured(_power: f64) -> Self {
        Self {}
    }

    fn uses_derivatives(&self) -> bool {
        true
    }

    #[inline(always)]
    fn taps<T: Real, L: Lane<Scalar = T>>(&self, grid: &Grid<T>, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        let [x, y, z] = &grid.axes;
        tensor_taps(grid, &[hermite_nodes(x, q[0]), hermite_nodes(y, q[1]), hermite_nodes(z, q[2])], tap);
    }

    fn wgsl(&self) -> String {
        format!(
            "{}\nfn rig_taps(q: vec3f) {{\n    \
             tensor_taps(hermite_nodes(grid_x(), q.x), hermite_nodes(grid_y(), q.y), hermite_nodes(grid_z(), q.z));\n}}\n",
            include_str!("tricubic.wgsl")
        )
    }

    /// Cubics of one variable: without mixed derivatives no product of two is exact.
    fn reproduces(&self, counts: [usize; 3], exponents: [u32; 3]) -> bool {
        (0..3).all(|a| exponents[a] <= if counts[a] == 1 { 1 } else { 3 })
            && exponents.iter().filter(|e| **e > 0).count() <= 1
            && one_expanded_axis(counts, exponents)
    }
}
