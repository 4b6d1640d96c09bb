use super::Scheme;
use super::gradient_corrected::one_expanded_axis;
use crate::math::{Real, Vector3};
use crate::rig::{Grid, GridAxis, Nodes, tensor_taps};

/// Tensor cubic Hermite interpolation from values and gradients, mixed derivatives taken as zero.
/// The Hermite data of an axis with one sample are a value and a derivative: the straight line.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Tricubic {}

/// Cubic Hermite weights h00 = (1 + 2t)(1 - t)^2, h01 = t^2 (3 - 2t) on the values and h10 = t (1 - t)^2,
/// h11 = -t^2 (1 - t), times the spacing, on the derivatives.
#[inline(always)]
pub fn hermite_nodes<T: Real>(axis: &GridAxis<T>, q: T) -> Nodes<T> {
    if axis.count == 1 {
        return Nodes::one(0, axis.clamp(q));
    }
    let (lower, t) = axis.cell(q);
    let rest = T::one() - t;
    let upper = t * t * (T::of(3.0) - T::of(2.0) * t);
    let slope = axis.spacing * t * rest;
    Nodes::two(lower, [T::one() - upper, upper], [slope * rest, -slope * t])
}

impl Scheme for Tricubic {
    fn configured(_power: f64) -> Self {
        Self {}
    }

    fn uses_derivatives(&self) -> bool {
        true
    }

    #[inline(always)]
    fn taps<T: Real>(&self, grid: &Grid<T>, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        tensor_taps(grid, &std::array::from_fn(|a| hermite_nodes(&grid.axes[a], q[a])), tap);
    }

    fn wgsl(&self) -> String {
        format!(
            "{}\nfn rig_taps(q: vec3f) {{\n    \
             tensor_taps(hermite_nodes(GRID_X, q.x), hermite_nodes(GRID_Y, q.y), hermite_nodes(GRID_Z, q.z));\n}}\n",
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
