use super::Scheme;
use crate::math::Real;
use crate::rig::{Grid, GridAxis, Lane};

/// The nearest sample; ties go to the lower index.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Nearest {}

/// How far above the middle of a cell still is the middle: places, boxes and spacings are rounded numbers, and a tie
/// must not be broken by the last bits. In units of epsilon times the number of samples.
pub const TIE_WIDTH: f64 = 4.0;

/// Index of the nearest sample on an axis.
#[inline(always)]
fn nearest_index<T: Real, L: Lane<Scalar = T>>(axis: &GridAxis<T>, q: L) -> L::Index {
    if axis.count == 1 {
        return L::index(0);
    }
    let (lower, t) = axis.cell(q);
    let middle = T::of(0.5) + T::of(TIE_WIDTH * axis.count as f64) * T::epsilon();
    L::index_sum(lower, t.above(middle), 1)
}

impl Scheme for Nearest {
    fn configured(_power: f64) -> Self {
        Self {}
    }

    #[inline(always)]
    fn taps<T: Real, L: Lane<Scalar = T>>(&self, grid: &Grid<T>, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        let [x, y, z] = &grid.axes;
        let nearest = [nearest_index(x, q[0]), nearest_index(y, q[1]), nearest_index(z, q[2])];
        tap(grid.value_vector::<L>(nearest), 0, L::constant(1.0));
    }

    fn wgsl(&self) -> String {
        let width = crate::rig::wgsl_number((TIE_WIDTH * f64::from(f32::EPSILON)) as f32);
        format!("const NEAREST_TIE_WIDTH = {width};\n{}", include_str!("nearest.wgsl"))
    }

    fn reproduces(&self, _counts: [usize; 3], exponents: [u32; 3]) -> bool {
        exponents == [0; 3]
    }
}
