use super::Scheme;
use crate::math::{Real, Vector3};
use crate::rig::{Grid, wgsl_number};

/// Weights 1/distance^power over the corners of the cell, from the clamped place, in metres; exact at a sample.
///
/// Only ratios of distances count, so they are taken as (nearest distance / distance)^power, which lies in [0, 1]
/// however near a sample or however high the power: no infinity, no special case at a sample.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct InverseDistance {
    pub power: f64,
}

/// ratio^power, exactly the ratio at power 1 (where a GPU's `pow` is not exact).
#[inline(always)]
fn raised<T: Real>(ratio: T, power: T) -> T {
    if power == T::one() { ratio } else { ratio.powf(power) }
}

impl Scheme for InverseDistance {
    fn configured(power: f64) -> Self {
        Self { power }
    }

    #[inline(always)]
    fn taps<T: Real>(&self, grid: &Grid<T>, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        let power = T::of(self.power);
        // Distances on each axis to its two samples, in units of the box so that squares neither overflow nor vanish.
        let [x, y, z] = std::array::from_fn(|a| {
            let axis = &grid.axes[a];
            if axis.count == 1 {
                return (0, 1, [axis.clamp(q[a]) * grid.per_reach, T::zero()]);
            }
            let (lower, t) = axis.cell(q[a]);
            let spacing = axis.spacing * grid.per_reach;
            (lower, 2, [t * spacing, (T::one() - t) * spacing])
        });
        let mut distances = [T::zero(); 8];
        let mut nearest = T::infinity();
        let mut corner = 0;
        for k in 0..z.1 {
            for j in 0..y.1 {
                for i in 0..x.1 {
                    let distance = Vector3::new(x.2[i], y.2[j], z.2[k]).length_squared().sqrt();
                    distances[corner] = distance;
                    nearest = nearest.min(distance);
                    corner += 1;
                }
            }
        }
        let mut sum = T::zero();
        for weight in &mut distances[..corner] {
            *weight = if *weight == nearest { T::one() } else { raised(nearest / *weight, power) };
            sum += *weight;
        }
        let weights = distances;
        corner = 0;
        for k in 0..z.1 {
            for j in 0..y.1 {
                for i in 0..x.1 {
                    tap(grid.value_vector(x.0 + i, y.0 + j, z.0 + k), weights[corner] / sum);
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
