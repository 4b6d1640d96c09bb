use serde::Deserialize;

use super::grid::{AxisNames, Grid, effective_count, grid_placement, has_extent};
use super::interpolation::{Interpolation, InterpolationChoice};
use super::{Lane, LaneModel, LocalPoints, Model, Packed, Resolving, Rig, RigTable, SampleRequest, ShVectors};
use crate::input::{Finite, InputError, Spanned};
use crate::math::{Real, Rgb};

/// The most samples that one lattice has.
pub const MOST_SAMPLES: usize = 65_536;

/// A lattice: a tensor grid of samples over the box and an interpolation between them. Places outside are clamped.
///
/// `lattice = { samples = [3, 2, 2], interpolation = "trilinear", power = 1.0, axes = "xyz" }`; with
/// `axes = "longest_first"` the three counts go to the box's longest, middle and shortest axis.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Lattice {
    pub samples: [usize; 3],
    pub axes: AxisNames,
    pub interpolation: Interpolation,
}

/// A lattice as a file writes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LatticeFile {
    samples: Spanned<Vec<Spanned<usize>>>,
    interpolation: Option<Spanned<String>>,
    /// Of `inverse_distance`; stands beside any interpolation, as the matrix may put another in its place.
    power: Option<Spanned<Finite>>,
    #[serde(default)]
    axes: AxisNames,
}

/// Three sample counts of at least 1, at most `most` samples together.
pub fn sample_counts(
    resolving: &Resolving,
    samples: &Spanned<Vec<Spanned<usize>>>,
    most: usize,
) -> Result<[usize; 3], InputError> {
    let source = resolving.source;
    let counts: Vec<usize> = samples.get_ref().iter().map(|n| *n.get_ref()).collect();
    let counts: [usize; 3] = counts.try_into().map_err(|counts: Vec<usize>| {
        source.error(samples.span(), format!("{} sample counts where three belong", counts.len()))
    })?;
    if let Some(none) = samples.get_ref().iter().find(|n| *n.get_ref() == 0) {
        return Err(source.error(none.span(), "0 samples; an axis has at least 1"));
    }
    let total = counts.iter().try_fold(1usize, |product, n| product.checked_mul(*n));
    if total.is_none_or(|total| total > most) {
        return Err(source.error(samples.span(), format!("{counts:?} are too many samples; at most {most} together")));
    }
    Ok(counts)
}

impl RigTable for LatticeFile {
    type Rig = Lattice;

    fn schema() -> serde_json::Value {
        use crate::input::schema::{above, default, exactly, optional, required, table, whole, word};
        let count = whole(1, MOST_SAMPLES as u64);
        table([
            required("samples", exactly(3, count)),
            optional("interpolation", default(word(Interpolation::KEYS.iter().copied()), "trilinear")),
            optional("power", default(above(0.0), 1.0)),
            optional("axes", AxisNames::schema()),
        ])
    }

    fn resolve(&self, resolving: &Resolving) -> Result<Lattice, InputError> {
        let source = resolving.source;
        let samples = sample_counts(resolving, &self.samples, MOST_SAMPLES)?;
        let own = match &self.interpolation {
            Some(word) => InterpolationChoice::new(source, word.span(), word.get_ref(), self.power.as_ref())?,
            None => InterpolationChoice::new(source, self.samples.span(), "trilinear", self.power.as_ref())?,
        };
        let power = self.power.as_ref().map(|p| p.get_ref().0);
        let interpolation = resolving.interpolation.unwrap_or(own).resolve(power);
        Ok(Lattice { samples, axes: self.axes, interpolation })
    }
}

impl Lattice {
    /// Samples along the axes of a box of these half extents: one where it has no extent. In the placement
    /// and in the vectors x runs fastest, then y, then z.
    pub fn counts(&self, half: [f64; 3]) -> [usize; 3] {
        let samples = self.axes.assign(self.samples, half);
        std::array::from_fn(|a| effective_count(samples[a], half[a]))
    }

    fn derivatives(&self, half: [f64; 3]) -> [bool; 3] {
        half.map(|h| self.interpolation.uses_derivatives() && has_extent(h))
    }
}

/// The weights of a lattice.
#[derive(Clone, Debug)]
pub struct LatticeModel<T> {
    grid: Grid<T>,
    interpolation: Interpolation,
}

impl Rig for Lattice {
    fn placement(&self, half: [f64; 3]) -> Vec<SampleRequest> {
        grid_placement(self.counts(half), half, self.derivatives(half))
    }
    fn model<T: Real>(&self, half: [f64; 3]) -> Model<T> {
        let grid = Grid::new(self.counts(half), half, self.derivatives(half));
        Model::Lattice(LatticeModel { grid, interpolation: self.interpolation })
    }
    fn wgsl(&self, half: [f64; 3]) -> String {
        let grid = Grid::<f32>::new(self.counts(half), half, self.derivatives(half));
        grid.wgsl() + &self.interpolation.wgsl()
    }
    fn wgsl_rows(&self, half: [f64; 3]) -> Vec<[f32; 4]> {
        Grid::<f32>::new(self.counts(half), half, self.derivatives(half)).wgsl_rows()
    }
    fn interpolation(&self) -> Option<&Interpolation> {
        Some(&self.interpolation)
    }
    fn reproduces(&self, half: [f64; 3], exponents: [u32; 3]) -> bool {
        self.interpolation.reproduces(self.counts(half), exponents)
    }
}

impl<T: Real> LaneModel<T> for LatticeModel<T> {
    #[inline(always)]
    fn lane_taps<L: Lane<Scalar = T>>(&self, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        self.interpolation.taps(&self.grid, q, tap);
    }

    fn lane_irradiance<const C: usize>(&self, vectors: &ShVectors<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        self.interpolation.irradiance::<T, C>(&self.grid, vectors, points, out);
    }

    fn lane_packed<const C: usize>(&self, packed: &Packed<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        self.interpolation.packed_irradiance::<T, C>(&self.grid, packed, points, out);
    }
}
