use super::Scheme;
use crate::math::Real;
use crate::rig::{Grid, GridAxis, Lane, Nodes, tensor_taps};

/// Linear on each axis.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Trilinear {}

/// Weights 1 - t and t on the two samples around the clamped place.
#[inline(always)]
pub fn linear_nodes<T: Real, L: Lane<Scalar = T>>(axis: &GridAxis<T>, q: L) -> Nodes<L> {
    if axis.count == 1 {
        return Nodes::one(L::constant(0.0));
    }
    let (lower, t) = axis.cell(q);
    Nodes::two(lower, [L::constant(1.0) - t, t], [L::constant(0.0); 2])
}

impl Scheme for Trilinear {
    fn configured(_power: f64) -> Self {
        Self {}
    }

    #[inline(always)]
    fn taps<T: Real, L: Lane<Scalar = T>>(&self, grid: &Grid<T>, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        let [x, y, z] = &grid.axes;
        tensor_taps(grid, &[linear_nodes(x, q[0]), linear_nodes(y, q[1]), linear_nodes(z, q[2])], tap);
    }

    fn wgsl(&self) -> String {
        format!(
            "{}\nfn rig_taps(q: vec3f) {{\n    \
             tensor_taps(linear_nodes(grid_x(), q.x), linear_nodes(grid_y(), q.y), linear_nodes(grid_z(), q.z));\n}}\n",
            include_str!("trilinear.wgsl")
        )
    }

    fn reproduces(&self, counts: [usize; 3], exponents: [u32; 3]) -> bool {
        (0..3).all(|a| exponents[a] <= u32::from(counts[a] > 1))
    }
}
