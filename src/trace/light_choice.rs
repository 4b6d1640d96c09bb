use glam::DVec3;

use crate::light::{Light, LightShape};
use crate::math::Vector3;

/// Most entries of the table.
const ENTRIES: usize = 4096;
/// Share of the choice that is even over the lights, for what the table does not know.
const EVEN: f64 = 0.2;

/// Which light to draw at a surface: a grid over the static geometry that knows how much of each light passes the middle of
/// each cell when nothing blocks it. Any choice is unbiased; a good one has less noise.
#[derive(Clone, Debug, Default)]
pub(crate) struct LightChoice {
    pub min: DVec3,
    /// Cells a metre, by axis.
    pub density: DVec3,
    /// None where there is nothing to choose.
    pub cells: [usize; 3],
    lights: usize,
    /// Probability of the lights up to and including each, cell by cell.
    cumulative: Vec<f64>,
}

impl LightChoice {
    /// Over the box of the static geometry, where there is any.
    pub fn new(lights: &[Light<f64>], bounds: Option<(DVec3, DVec3)>) -> Self {
        let Some((min, max)) = bounds.filter(|_| lights.len() > 1) else { return Self::default() };
        let size = max - min;
        // near-cubic cells, as many as the table may hold
        let most = (ENTRIES / lights.len()).max(1) as f64;
        let extent = size.max(DVec3::splat(1e-6 * size.max_element()));
        let edge = (extent.x * extent.y * extent.z / most).cbrt();
        let mut cells = [1; 3];
        for axis in 0..3 {
            cells[axis] = ((extent[axis] / edge).floor() as usize).clamp(1, 16);
        }
        let density = DVec3::from_array(cells.map(|c| c as f64)) / extent;
        let mut choice = Self { min, density, cells, lights: lights.len(), cumulative: Vec::new() };
        for z in 0..cells[2] {
            for y in 0..cells[1] {
                for x in 0..cells[0] {
                    let middle = min + (DVec3::new(x as f64, y as f64, z as f64) + 0.5) / density;
                    choice.push_cell(lights, middle);
                }
            }
        }
        choice
    }

    fn push_cell(&mut self, lights: &[Light<f64>], middle: DVec3) {
        // the coefficient of degree 0 goes with the integral of the radiance
        let passing: Vec<f64> = lights
            .iter()
            .map(|light| light.projection::<1>(Vector3::of(middle)).value[0].max_abs())
            .map(|value| if value.is_finite() { value } else { 0.0 })
            .collect();
        let total: f64 = passing.iter().sum();
        let even = if total > 0.0 { EVEN } else { 1.0 };
        let mut sum = 0.0;
        for value in &passing {
            let share = if total > 0.0 { value / total } else { 0.0 };
            sum += even / passing.len() as f64 + (1.0 - even) * share;
            self.cumulative.push(sum);
        }
    }

    /// Probabilities of the lights, cell by cell, x running fastest.
    pub fn shares(&self) -> impl Iterator<Item = Vec<f64>> {
        self.cumulative.chunks_exact(self.lights.max(1)).map(|row| {
            let below = std::iter::once(0.0).chain(row.iter().copied());
            row.iter().zip(below).map(|(sum, below)| (sum - below) / row[row.len() - 1]).collect()
        })
    }

    /// A light and its probability.
    #[inline]
    pub fn draw(&self, p: DVec3, u: f64) -> (usize, f64) {
        let at = ((p - self.min) * self.density).max(DVec3::ZERO);
        let [x, y, z] = std::array::from_fn(|axis| (at[axis] as usize).min(self.cells[axis] - 1));
        let cell = (z * self.cells[1] + y) * self.cells[0] + x;
        let row = &self.cumulative[cell * self.lights..(cell + 1) * self.lights];
        let u = u * row[self.lights - 1];
        let index = row.partition_point(|c| *c <= u).min(self.lights - 1);
        let below = if index == 0 { 0.0 } else { row[index - 1] };
        (index, (row[index] - below) / row[self.lights - 1])
    }
}
