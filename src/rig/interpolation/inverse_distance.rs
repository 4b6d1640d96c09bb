use super::Scheme;
use crate::math::Real;
use crate::rig::{Grid, GridAxis, Lane, Nodes, wgsl_number};

/// Weights 1/distance^power over the corners of the cell, from the clamped place, in metres; exact at a sample.
///
/// Only ratios of distances count, so they are taken as (nearest distance / distance)^power, which lies in [0, 1]
/// however near a sample or however high the power: no infinity, no special case at a sample.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct InverseDistance {
    pub power: f64,
}

/// Above any distance in units of the box.
const NO_DISTANCE: f64 = 1e9;

/// ratio^power, exactly the ratio at power 1 (where a GPU's `pow` is not exact).
#[inline(always)]
fn raised<T: Real, L: Lane<Scalar = T>>(ratio: L, power: T) -> L {
    if power == T::one() { ratio } else { ratio.mapped(|r| r.powf(power)) }
}

/// Squared distances along an axis to its two samples, in units of the box so that squares neither overflow nor vanish.
#[inline(always)]
fn squared_sides<T: Real, L: Lane<Scalar = T>>(axis: &GridAxis<T>, q: L, per_reach: T) -> Nodes<L> {
    let none = L::constant(0.0);
    if axis.count == 1 {
        let side = axis.clamp(q) * L::splat(per_reach);
        return Nodes { value: [side * side, none], ..Nodes::one(none) };
    }
    let (lower, t) = axis.cell(q);
    let spacing = L::splat(axis.spacing * per_reach);
    let (below, above) = (t * spacing, (L::constant(1.0) - t) * spacing);
    Nodes::two(lower, [below * below, above * above], [none, none])
}

impl Scheme for InverseDistance {
    fn configured(power: f64) -> Self {
        Self { power }
    }

    #[inline(always)]
    fn taps<T: Real, L: Lane<Scalar = T>>(&self, grid: &Grid<T>, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        let power = T::of(self.power);
        let [along_x, along_y, along_z] = &grid.axes;
        let x = squared_sides(along_x, q[0], grid.per_reach);
        let y = squared_sides(along_y, q[1], grid.per_reach);
        let z = squared_sides(along_z, q[2], grid.per_reach);
        let mut weights = [L::constant(0.0); 8];
        let mut nearest = L::constant(NO_DISTANCE);
        let mut corner = 0;
        for k in 0..z.count {
            for j in 0..y.count {
                for i in 0..x.count {
                    weights[corner] = (x.value[i] + y.value[j] + z.value[k]).root();
                    nearest = nearest.smaller(weights[corner]);
                    corner += 1;
                }
            }
        }
        let mut sum = L::constant(0.0);
        for weight in &mut weights[..corner] {
            *weight = weight.where_equal(nearest, L::constant(1.0), raised(nearest / *weight, power));
            sum = sum + *weight;
        }
        let first = grid.value_vector::<L>([x.lower, y.lower, z.lower]);
        corner = 0;
        for k in 0..z.count {
            for j in 0..y.count {
                for i in 0..x.count {
                    let offset = i * grid.steps[0] + j * grid.steps[1] + k * grid.steps[2];
                    tap(first, offset, weights[corner] / sum);
                    corner += 1;
                }
            }
        }
    }

    fn wgsl(&self) -> String {
        let power = wgsl_number(self.power as f32);
        format!("const INVERSE_DISTANCE_POWER = {power};\n{}", include_str!("inverse_distance.wgsl"))
    }

    fn reproduces(&self, _counts: [usize; 3], exponents: [u32; 3]) -> bool {
        exponents == [0; 3]
    }
}
