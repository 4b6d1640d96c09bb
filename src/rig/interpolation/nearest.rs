use super::Scheme;
use crate::math::{Real, Vector3};
use crate::rig::{Grid, GridAxis};

/// The nearest sample; ties go to the lower index.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Nearest {}

/// How far above the middle of a cell still is the middle: places, boxes and spacings are rounded numbers, and a tie
/// must not be broken by the last bits. In units of epsilon times the number of samples.
pub const TIE_WIDTH: f64 = 4.0;

/// Index of the nearest sample on an axis.
#[inline(always)]
fn nearest_index<T: Real>(axis: &GridAxis<T>, q: T) -> usize {
    let (lower, t) = axis.cell(q);
    let middle = T::of(0.5) + T::of(TIE_WIDTH * axis.count as f64) * T::epsilon();
    lower + usize::from(t > middle)
}

impl Scheme for Nearest {
    fn configured(_power: f64) -> Self {
        Self {}
    }

    #[inline(always)]
    fn taps<T: Real>(&self, grid: &Grid<T>, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        let [x, y, z] = std::array::from_fn(|a| nearest_index(&grid.axes[a], q[a]));
        tap(grid.value_vector(x, y, z), T::one());
    }

    fn wgsl(&self) -> String {
        let width = crate::rig::wgsl_number((TIE_WIDTH * f64::from(f32::EPSILON)) as f32);
        format!("const NEAREST_TIE_WIDTH = {width};\n{}", include_str!("nearest.wgsl"))
    }

    fn reproduces(&self, _counts: [usize; 3], exponents: [u32; 3]) -> bool {
        exponents == [0; 3]
    }
}
