//! Weights of a volume's samples at a place.

use std::sync::Arc;

use super::cells::{Cells, NONE};
use crate::math::{Real, Rgb, Vector3};
use crate::rig::interpolation::{Interpolation, corrected_nodes, hermite_nodes, linear_nodes};
use crate::rig::{Grid, GridAxis, LocalPoints, Model, Nodes, Packed, RigModel, ShVectors, scattered_irradiance};

/// How a cell meets finer neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Across {
    /// Every cell by its own corners: values jump where a face has more samples on its other side.
    Naive,
    /// A cell with finer neighbours takes their samples on its surface too, and nothing jumps.
    #[default]
    Continuous,
}

/// One-dimensional form of an interpolation that is a tensor product without mixed derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Profile {
    Linear,
    /// Linear, with this share of the derivatives.
    Corrected(f64),
    Hermite,
}

impl Profile {
    fn of(interpolation: &Interpolation) -> Option<Self> {
        match interpolation {
            Interpolation::Trilinear(_) => Some(Profile::Linear),
            Interpolation::GradientCorrected(_) => Some(Profile::Corrected(1.0)),
            Interpolation::HalfGradient(_) => Some(Profile::Corrected(0.5)),
            Interpolation::Tricubic(_) => Some(Profile::Hermite),
            Interpolation::Nearest(_) | Interpolation::InverseDistance(_) => None,
        }
    }

    #[inline(always)]
    fn nodes<T: Real>(self, axis: &GridAxis<T>, q: T) -> Nodes<T> {
        match self {
            Profile::Linear => linear_nodes(axis, q),
            Profile::Corrected(share) => corrected_nodes(axis, q, share),
            Profile::Hermite => hermite_nodes(axis, q),
        }
    }

    /// Value and slope in the middle of an edge of this length, from the values and slopes at its ends:
    /// `[what][end][of what]`, 0 value and 1 slope. With them two halves of an edge give what the whole gives.
    fn middle(self, edge: f64) -> [[[f64; 2]; 2]; 2] {
        match self {
            Profile::Linear => [[[0.5, 0.0], [0.5, 0.0]], [[0.0; 2]; 2]],
            Profile::Corrected(share) => {
                [[[0.5, 0.25 * share * edge], [0.5, -0.25 * share * edge]], [[0.0, 0.5], [0.0, 0.5]]]
            }
            Profile::Hermite => {
                [[[0.5, 0.125 * edge], [0.5, -0.125 * edge]], [[-1.5 / edge, -0.25], [1.5 / edge, -0.25]]]
            }
        }
    }
}

/// Whether cells of different size can meet without a jump under this interpolation: those that are continuous themselves can.
pub fn can_be_continuous(interpolation: &Interpolation) -> bool {
    Profile::of(interpolation).is_some()
}

/// What all cells of one size share.
#[derive(Clone, Debug)]
struct Scale<T> {
    /// Over the cell.
    grid: Grid<T>,
    /// Over one of its eight parts.
    part: Grid<T>,
    /// What the cell's corners give at each of its 27 nodes, of their values and of their derivatives along the axes whose bits are set:
    /// the slot of the corners' vectors with a weight for each corner; rows of zeros are left out.
    transfer: Vec<(usize, [T; 8])>,
    /// Where the rows of a node's jet begin, node after node, jet after jet; one entry more than there are.
    rows: Vec<u32>,
}

/// Values and derivatives of a node, mixed ones too, where samples have derivatives.
const JETS: usize = 8;

impl<T: Real> Scale<T> {
    fn new(cells: &Cells, size: u32, interpolation: &Interpolation) -> Self {
        let unit = cells.unit();
        let derivatives = [interpolation.uses_derivatives(); 3];
        let half = unit.map(|u| 0.5 * u * f64::from(size));
        let profile = Profile::of(interpolation).unwrap_or(Profile::Linear);
        // [axis][node][what][end][of what]: the nodes 0, 1 and 2 of an edge
        let along: [[[[[f64; 2]; 2]; 2]; 3]; 3] = std::array::from_fn(|axis| {
            let end = |this: usize| -> [[[f64; 2]; 2]; 2] {
                std::array::from_fn(|what| {
                    std::array::from_fn(|end| {
                        std::array::from_fn(|of| if end == this && of == what { 1.0 } else { 0.0 })
                    })
                })
            };
            [end(0), profile.middle(2.0 * half[axis]), end(1)]
        });
        let (jets, vectors) = if derivatives[0] { (JETS, 4) } else { (1, 1) };
        let mut transfer = Vec::new();
        let mut rows = vec![0];
        for node in 0..27 {
            let at = [node % 3, node / 3 % 3, node / 9];
            for jet in 0..jets {
                for vector in 0..vectors {
                    let weights: [f64; 8] = std::array::from_fn(|corner| {
                        (0..3).fold(1.0, |product, axis| {
                            let of = usize::from(vector == axis + 1);
                            product * along[axis][at[axis]][jet >> axis & 1][corner >> axis & 1][of]
                        })
                    });
                    if weights.iter().any(|weight| *weight != 0.0) {
                        transfer.push((vector, weights.map(T::of)));
                    }
                }
                rows.push(transfer.len() as u32);
            }
        }
        Self {
            grid: Grid::new([2; 3], half, derivatives),
            part: Grid::new([2; 3], half.map(|h| 0.5 * h), derivatives),
            transfer,
            rows,
        }
    }
}

/// The weights of samples at the corners of cells.
#[derive(Clone, Debug)]
pub struct CellModel<T> {
    cells: Arc<Cells>,
    interpolation: Interpolation,
    profile: Option<Profile>,
    half: [T; 3],
    unit: [T; 3],
    per_unit: [T; 3],
    scales: Vec<Scale<T>>,
    /// Each cell's scale.
    scale_of: Vec<u8>,
    /// Vectors of a sample.
    vectors: usize,
}

impl<T: Real> CellModel<T> {
    pub fn new(cells: Arc<Cells>, interpolation: Interpolation, across: Across) -> Self {
        let mut sizes: Vec<u32> = cells.cells.iter().map(|cell| cell.size).collect();
        sizes.sort_unstable();
        sizes.dedup();
        let unit = cells.unit();
        let scale_of = |size| sizes.iter().position(|known| *known == size).expect("the size is of the list") as u8;
        Self {
            interpolation,
            profile: Profile::of(&interpolation).filter(|_| across == Across::Continuous),
            half: cells.half.map(T::of),
            unit: unit.map(T::of),
            per_unit: unit.map(|u| T::of(1.0 / u)),
            scales: sizes.iter().map(|size| Scale::new(&cells, *size, &interpolation)).collect(),
            scale_of: cells.cells.iter().map(|cell| scale_of(cell.size)).collect(),
            vectors: if interpolation.uses_derivatives() { 4 } else { 1 },
            cells,
        }
    }

    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// The cell that holds box coordinates, which are clamped to the box.
    #[inline]
    pub fn cell_at(&self, q: Vector3<T>) -> usize {
        let q = q.to_array();
        self.cells.locate(std::array::from_fn(|axis| {
            let along = (q[axis].max(-self.half[axis]).min(self.half[axis]) + self.half[axis]) * self.per_unit[axis];
            along.to_u32().unwrap_or(0).min(self.cells.resolution[axis] - 1)
        }))
    }

    /// The weights at `q` by one cell; outside it `q` is clamped to the cell.
    #[inline]
    pub fn taps_of_cell(&self, index: usize, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        let cell = &self.cells.cells[index];
        let scale = &self.scales[usize::from(self.scale_of[index])];
        let q = q.to_array();
        let local: [T; 3] = std::array::from_fn(|axis| {
            let low = T::of(f64::from(cell.low[axis])) * self.unit[axis] - self.half[axis];
            q[axis] - low - scale.grid.axes[axis].half
        });
        if let (Some(profile), Some(nodes)) = (self.profile, self.cells.hanging(index)) {
            return self.blended(profile, scale, &cell.corners, nodes, local, tap);
        }
        self.interpolation.taps(&scale.grid, local, &mut |first: usize, offset, weight| {
            let vector = first + offset;
            tap(cell.corners[vector / self.vectors] as usize * self.vectors + vector % self.vectors, weight);
        });
    }

    /// A cell with finer neighbours, as its eight parts: a node of a part is a finer neighbour's sample where there is one, else what
    /// the cell's own corners give there. Where nothing hangs on a face, its parts give what the undivided face gives, so that both
    /// sides of every face agree: the finer side has the same nodes, the coarser or equal side the same corners.
    #[inline]
    fn blended(
        &self,
        profile: Profile,
        scale: &Scale<T>,
        corners: &[u32; 8],
        table: &[u32; 27],
        local: [T; 3],
        tap: &mut impl FnMut(usize, T),
    ) {
        let upper: [usize; 3] = std::array::from_fn(|axis| usize::from(local[axis] > T::zero()));
        let along: [Nodes<T>; 3] = std::array::from_fn(|axis| {
            let part = &scale.part.axes[axis];
            profile.nodes(part, if upper[axis] == 1 { local[axis] - part.half } else { local[axis] + part.half })
        });
        let jets = if self.vectors > 1 { JETS } else { 1 };
        let mut own = [[T::zero(); 8]; 4];
        for node in 0..8usize {
            let side: [usize; 3] = std::array::from_fn(|axis| node >> axis & 1);
            let at: [usize; 3] = std::array::from_fn(|axis| upper[axis] + side[axis]);
            let place = at[0] + 3 * at[1] + 9 * at[2];
            let sample = table[place];
            // weights of the node's value and derivatives: bits of `jet` say along which axes
            let weight_of = |jet: usize| {
                (0..3).fold(T::one(), |product, axis| {
                    let nodes = &along[axis];
                    product * if jet >> axis & 1 == 1 { nodes.slope[side[axis]] } else { nodes.value[side[axis]] }
                })
            };
            if sample != NONE {
                // samples have no mixed derivatives
                let first = sample as usize * self.vectors;
                tap(first, weight_of(0));
                for axis in 0..self.vectors - 1 {
                    tap(first + 1 + axis, weight_of(1 << axis));
                }
                continue;
            }
            for jet in 0..jets {
                let first = place * jets + jet;
                let rows = &scale.transfer[scale.rows[first] as usize..scale.rows[first + 1] as usize];
                if rows.is_empty() {
                    continue;
                }
                let weight = weight_of(jet);
                for (slot, shares) in rows {
                    for (own, share) in own[*slot].iter_mut().zip(shares) {
                        *own += weight * *share;
                    }
                }
            }
        }
        for (corner, sample) in corners.iter().enumerate() {
            for (slot, weights) in own[..self.vectors].iter().enumerate() {
                if weights[corner] != T::zero() {
                    tap(*sample as usize * self.vectors + slot, weights[corner]);
                }
            }
        }
    }
}

impl<T: Real> RigModel<T> for CellModel<T> {
    #[inline]
    fn taps(&self, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        self.taps_of_cell(self.cell_at(q), q, tap);
    }

    fn irradiance<const C: usize>(&self, vectors: &ShVectors<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        self.packed_irradiance::<C>(&Packed::new(vectors.clone()), points, out);
    }

    fn packed_irradiance<const C: usize>(&self, packed: &Packed<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        scattered_irradiance::<T, Self, C>(self, packed, points, out);
    }
}

/// The weights of a volume of any kind.
#[derive(Clone, Debug)]
pub enum VolumeModel<T> {
    /// One grid: a lattice over the whole box.
    Grid(Model<T>),
    Cells(CellModel<T>),
}

impl<T: Real> RigModel<T> for VolumeModel<T> {
    fn taps(&self, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        match self {
            VolumeModel::Grid(model) => model.taps(q, tap),
            VolumeModel::Cells(model) => model.taps(q, tap),
        }
    }

    fn irradiance<const C: usize>(&self, vectors: &ShVectors<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        match self {
            VolumeModel::Grid(model) => model.irradiance::<C>(vectors, points, out),
            VolumeModel::Cells(model) => model.irradiance::<C>(vectors, points, out),
        }
    }

    fn packed_irradiance<const C: usize>(&self, packed: &Packed<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        match self {
            VolumeModel::Grid(model) => model.packed_irradiance::<C>(packed, points, out),
            VolumeModel::Cells(model) => model.packed_irradiance::<C>(packed, points, out),
        }
    }
}
