use super::Scheme;
use crate::math::{Real, Vector3};
use crate::rig::{Grid, GridAxis, Nodes, tensor_taps};

/// Linear on each axis.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Trilinear {}

/// Weights 1 - t and t on the two samples around the clamped place.
#[inline(always)]
pub fn linear_nodes<T: Real>(axis: &GridAxis<T>, q: T) -> Nodes<T> {
    if axis.count == 1 {
        return Nodes::one(0, T::zero());
    }
    let (lower, t) = axis.cell(q);
    Nodes::two(lower, [T::one() - t, t], [T::zero(); 2])
}

impl Scheme for Trilinear {
    fn configured(_power: f64) -> Self {
        Self {}
    }

    #[inline(always)]
    fn taps<T: Real>(&self, grid: &Grid<T>, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        tensor_taps(grid, &std::array::from_fn(|a| linear_nodes(&grid.axes[a], q[a])), tap);
    }

    fn wgsl(&self) -> String {
        format!(
            "{}\nfn rig_taps(q: vec3f) {{\n    \
             tensor_taps(linear_nodes(GRID_X, q.x), linear_nodes(GRID_Y, q.y), linear_nodes(GRID_Z, q.z));\n}}\n",
            include_str!("trilinear.wgsl")
        )
    }

    fn reproduces(&self, counts: [usize; 3], exponents: [u32; 3]) -> bool {
        (0..3).all(|a| exponents[a] <= u32::from(counts[a] > 1))
    }
}
