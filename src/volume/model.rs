//! Weights of a volume's samples at a place.

use std::sync::Arc;

use super::cells::{Cells, NONE};
use crate::math::{Real, Rgb, Vector3};
use crate::rig::interpolation::{Interpolation, corrected_nodes, hermite_nodes, linear_nodes};
use crate::rig::{
    Grid, GridAxis, Lane, LocalPoints, MARK, Model, Nodes, OnePlace, Packed, RigModel, ShVectors, TableModel, TableTaps,
};

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

    /// Weights at a share `t` of an edge of this length, metres, by those on `unit`, from -1/2 to 1/2.
    #[inline(always)]
    fn nodes<T: Real, L: Lane<Scalar = T>>(self, unit: &GridAxis<T>, t: L, edge: L) -> Nodes<L> {
        let q = t - L::constant(0.5);
        let mut nodes = match self {
            Profile::Linear => linear_nodes(unit, q),
            Profile::Corrected(share) => corrected_nodes(unit, q, share),
            Profile::Hermite => hermite_nodes(unit, q),
        };
        nodes.slope = [nodes.slope[0] * edge, nodes.slope[1] * edge];
        nodes
    }

    /// In the middle of an edge of length 1, what of the value is the slope at its lower end (minus that of its upper), and what of the slope
    /// are the slope at either end and the value at its upper end (minus that at its lower). The value is half of both values always.
    fn middle(self) -> [f64; 3] {
        match self {
            Profile::Linear => [0.0; 3],
            Profile::Corrected(share) => [0.25 * share, 0.5, 0.0],
            Profile::Hermite => [0.125, -0.25, 1.5],
        }
    }
}

/// Whether cells of different size can meet without a jump under this interpolation: those that are continuous themselves can.
pub fn can_be_continuous(interpolation: &Interpolation) -> bool {
    Profile::of(interpolation).is_some()
}

/// A weight for each jet at each of eight nodes, x fastest. Jets are the value, or it and the derivatives, mixed ones too: bits say along which
/// axes.
type Weights<L, const JETS: usize> = [[L; 8]; JETS];

/// The jets that samples have.
const fn kept(jets: usize) -> &'static [usize] {
    if jets == 1 { &[0] } else { &[0, 1, 2, 4] }
}

/// Tensor products of the weights along the axes: of values and, where there are any, of derivatives; of mixed ones where `mixed`.
#[inline(always)]
fn tensor<L: Lane, const JETS: usize>([x, y, z]: &[Nodes<L>; 3], mixed: bool) -> Weights<L, JETS> {
    let mut out = [[L::constant(0.0); 8]; JETS];
    for jet in 0..JETS {
        if !mixed && jet.count_ones() > 1 {
            continue;
        }
        let along_x = if jet & 1 == 0 { x.value } else { x.slope };
        let along_y = if jet & 2 == 0 { y.value } else { y.slope };
        let along_z = if jet & 4 == 0 { z.value } else { z.slope };
        for k in 0..2 {
            for j in 0..2 {
                let yz = along_y[j] * along_z[k];
                out[jet][2 * j + 4 * k] = along_x[0] * yz;
                out[jet][2 * j + 4 * k + 1] = along_x[1] * yz;
            }
        }
    }
    out
}

/// From weights at the nodes of one part of a cell to weights at the cell's corners, where the cell's own interpolation says what stands at
/// the nodes: axis after axis, as it is a tensor product. `upper` is 1 for the part beyond the middle of an axis, 0 for the one before;
/// `edge` are the cell's.
#[inline(always)]
fn nodes_to_corners<L: Lane, const JETS: usize>(
    profile: Profile,
    upper: &[L; 3],
    edge: &[L; 3],
    weights: &mut Weights<L, JETS>,
) {
    let mixed = profile == Profile::Hermite;
    let [value_of_slope, slope_of_slope, slope_of_value] = profile.middle();
    let (one, half) = (L::constant(1.0), L::constant(0.5));
    for axis in 0..3 {
        let bit = 1 << axis;
        let beyond = upper[axis];
        let before = one - beyond;
        // a node of the part is an end of the edge, or its middle: the lower node of the part beyond, the upper one of the part before
        let of_value = [[one - half * beyond, half * beyond], [half * before, one - half * before]];
        let middle = L::constant(value_of_slope) * edge[axis];
        let of_slope = [middle * beyond, middle * before];
        let kept = L::constant(slope_of_slope);
        let slopes = [[before + kept * beyond, kept * beyond], [kept * before, beyond + kept * before]];
        let steep = L::constant(slope_of_value) / edge[axis];
        let rise = [steep * beyond, steep * before];
        for jet in 0..JETS {
            if jet & bit != 0 || !mixed && jet.count_ones() > 1 {
                continue;
            }
            // with slopes along this axis, but for jets that would be mixed with it and count for nothing
            let sloped = JETS > 1 && (mixed || jet == 0);
            for lower in 0..8usize {
                if lower & bit != 0 {
                    continue;
                }
                let node = [lower, lower | bit];
                let value = [weights[jet][node[0]], weights[jet][node[1]]];
                for corner in 0..2 {
                    weights[jet][node[corner]] = of_value[0][corner] * value[0] + of_value[1][corner] * value[1];
                }
                if sloped {
                    let slope = [weights[jet | bit][node[0]], weights[jet | bit][node[1]]];
                    let from_values = of_slope[0] * value[0] + of_slope[1] * value[1];
                    let rises = rise[0] * slope[0] + rise[1] * slope[1];
                    weights[jet][node[0]] = weights[jet][node[0]] - rises;
                    weights[jet][node[1]] = weights[jet][node[1]] + rises;
                    let lower_slope = slopes[0][0] * slope[0] + slopes[1][0] * slope[1];
                    let upper_slope = slopes[0][1] * slope[0] + slopes[1][1] * slope[1];
                    weights[jet | bit][node[0]] = lower_slope + from_values;
                    weights[jet | bit][node[1]] = upper_slope - from_values;
                }
            }
        }
    }
}

/// Where the parts of a cell's entries in the table begin: its corners' vectors, then its low corner and its size in lattice units, the place of
/// the table of its nodes (marked where it has none), and which of these are samples, a bit each.
const LOW: usize = 8;
const SIZE: usize = 11;
const NODES: usize = 12;
const PRESENT: usize = 13;
/// Entries of a cell, and of half a table of nodes: a line of the cache.
const ENTRIES: usize = 16;

/// [`ENTRIES`] numbers in one line of the cache.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
struct Line([u32; ENTRIES]);

/// The weights of samples at the corners of cells.
#[derive(Clone, Debug)]
pub struct CellModel<T> {
    cells: Arc<Cells>,
    interpolation: Interpolation,
    half: [T; 3],
    unit: [T; 3],
    per_unit: [T; 3],
    /// An edge of length 1 with its two ends.
    edge: GridAxis<T>,
    /// A cell of one unit, for interpolations that are no tensor product: they know ratios of distances only.
    grid: Grid<T>,
    /// A line a cell, then two for each table of nodes.
    table: Vec<Line>,
    /// Vectors of a sample.
    vectors: usize,
}

impl<T: Real> CellModel<T> {
    pub fn new(cells: Arc<Cells>, interpolation: Interpolation, across: Across) -> Self {
        let vectors = if interpolation.uses_derivatives() { 4 } else { 1 };
        let continuous = across == Across::Continuous && can_be_continuous(&interpolation);
        let mut table = vec![Line([0; ENTRIES]); cells.cells.len()];
        for (index, cell) in cells.cells.iter().enumerate() {
            let mut line = Line([0; ENTRIES]);
            line.0[..LOW].copy_from_slice(&cell.corners.map(|sample| sample * vectors));
            line.0[LOW..SIZE].copy_from_slice(&cell.low);
            line.0[SIZE] = cell.size;
            line.0[NODES] = MARK;
            if let Some(samples) = cells.hanging(index).filter(|_| continuous) {
                line.0[NODES] = (table.len() * ENTRIES) as u32;
                line.0[PRESENT] = (0..27).map(|node| u32::from(samples[node] != NONE) << node).sum();
                let mut nodes = [Line([0; ENTRIES]); 2];
                for (entry, sample) in nodes.iter_mut().flat_map(|line| &mut line.0).zip(samples) {
                    *entry = if *sample == NONE { 0 } else { sample * vectors };
                }
                table.extend(nodes);
            }
            table[index] = line;
        }
        let unit = cells.unit();
        Self {
            interpolation,
            half: cells.half.map(T::of),
            unit: unit.map(T::of),
            per_unit: unit.map(|u| T::of(1.0 / u)),
            edge: GridAxis::new(2, 0.5),
            grid: Grid::new([2; 3], unit.map(|u| 0.5 * u), [false; 3]),
            table,
            vectors: vectors as usize,
            cells,
        }
    }

    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// Lattice coordinates of box coordinates, which are clamped to the box.
    #[inline(always)]
    fn lattice<L: Lane<Scalar = T>>(&self, q: [L; 3]) -> [L; 3] {
        let mut along = q;
        for axis in 0..3 {
            let half = L::splat(self.half[axis]);
            let clamped = q[axis].larger(L::splat(-self.half[axis])).smaller(half);
            along[axis] = (clamped + half) * L::splat(self.per_unit[axis]);
        }
        along
    }

    /// The cells that hold lattice coordinates.
    #[inline(always)]
    fn cells_at<L: Lane<Scalar = T>>(&self, [x, y, z]: [L; 3]) -> L::Index {
        let [last_x, last_y, last_z] = self.cells.resolution;
        let at = [x.whole(last_x as usize - 1), y.whole(last_y as usize - 1), z.whole(last_z as usize - 1)];
        self.cells.lane_locate::<L>(at)
    }

    /// The cell that holds box coordinates, which are clamped to the box.
    pub fn cell_at(&self, q: Vector3<T>) -> usize {
        self.cells_at(self.lattice(q.to_array()))
    }

    /// The weights at `q` by one cell; outside it `q` is clamped to the cell.
    pub fn taps_of_cell(&self, index: usize, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        let along = self.lattice(q.to_array());
        self.taps_of_cells(index, along, &mut OnePlace::new(self.table(), tap));
    }

    /// A number of the cells whose entries begin at `first`.
    #[inline(always)]
    fn entry<L: Lane<Scalar = T>>(&self, first: L::Index, of: usize) -> L::Index {
        L::lookup(self.table(), L::index_sum(first, L::index(of), 1))
    }

    /// The weights at lattice coordinates by the cell of each.
    #[inline(always)]
    fn taps_of_cells<L: Lane<Scalar = T>>(&self, cell: L::Index, along: [L; 3], taps: &mut impl TableTaps<L>) {
        let first = L::index_sum(L::index(0), cell, ENTRIES);
        let size = L::number(self.entry::<L>(first, SIZE));
        let mut t = along;
        for axis in 0..3 {
            let low = L::number(self.entry::<L>(first, LOW + axis));
            t[axis] = ((along[axis] - low) / size).larger(L::constant(0.0)).smaller(L::constant(1.0));
        }
        let Some(profile) = Profile::of(&self.interpolation) else {
            let mut q = t;
            for axis in 0..3 {
                q[axis] = (t[axis] - L::constant(0.5)) * L::splat(self.unit[axis]);
            }
            return self.interpolation.taps::<T, L>(&self.grid, q, &mut |corner: L::Index, offset, weight| {
                taps.group(L::index_sum(first, corner, 1));
                taps.tap(offset, 0, weight);
            });
        };
        let edge = [L::splat(self.unit[0]) * size, L::splat(self.unit[1]) * size, L::splat(self.unit[2]) * size];
        match self.vectors {
            1 => self.taps_of_kind::<L, 1>(profile, first, t, edge, taps),
            _ => self.taps_of_kind::<L, 8>(profile, first, t, edge, taps),
        }
    }

    /// The weights at shares `t` of cells whose entries begin at `first`, of values or of values and derivatives.
    #[inline(always)]
    fn taps_of_kind<L: Lane<Scalar = T>, const JETS: usize>(
        &self,
        profile: Profile,
        first: L::Index,
        t: [L; 3],
        edge: [L; 3],
        taps: &mut impl TableTaps<L>,
    ) {
        let nodes = [
            profile.nodes(&self.edge, t[0], edge[0]),
            profile.nodes(&self.edge, t[1], edge[1]),
            profile.nodes(&self.edge, t[2], edge[2]),
        ];
        let mut corners = tensor::<L, JETS>(&nodes, false);
        let table = self.entry::<L>(first, NODES);
        if !L::all_marked(table) {
            let present = self.entry::<L>(first, PRESENT);
            self.blend(profile, (table, present), t, edge, &mut corners, taps);
        }
        taps.group(first);
        for corner in 0..8 {
            for slot in 0..const { kept(JETS).len() } {
                taps.tap(corner, slot, corners[const { kept(JETS) }[slot]][corner]);
            }
        }
    }

    /// A cell with finer neighbours, as its eight parts: a node of a part is a finer neighbour's sample where there is one, else what
    /// the cell's own corners give there. Where nothing hangs on a face, its parts give what the undivided face gives, so that both
    /// sides of every face agree: the finer side has the same nodes, the coarser or equal side the same corners.
    #[inline(always)]
    fn blend<L: Lane<Scalar = T>, const JETS: usize>(
        &self,
        profile: Profile,
        (table, present): (L::Index, L::Index),
        t: [L; 3],
        edge: [L; 3],
        corners: &mut Weights<L, JETS>,
        taps: &mut impl TableTaps<L>,
    ) {
        let (zero, one, half, two) = (L::constant(0.0), L::constant(1.0), L::constant(0.5), L::constant(2.0));
        let mut upper = [zero; 3];
        let mut nodes = [Nodes::one(zero); 3];
        let mut first = L::index(0);
        for axis in 0..3 {
            let beyond = t[axis].above(T::of(0.5));
            upper[axis] = L::number(beyond);
            nodes[axis] = profile.nodes(&self.edge, two * t[axis] - upper[axis], half * edge[axis]);
            first = L::index_sum(first, beyond, [1, 3, 9][axis]);
        }
        let mut own = tensor::<L, JETS>(&nodes, profile == Profile::Hermite);
        // nodes that are marked do not count: their table is no place, and wraps
        taps.group(L::index_where_marked(table, table, L::index_sum(table, first, 1)));
        let present = L::shifted(present, first);
        for node in 0..8usize {
            let offset = (node & 1) + 3 * (node >> 1 & 1) + 9 * (node >> 2);
            let is_sample = L::number(L::bits(L::shifted(present, L::index(offset)), 1));
            for slot in 0..const { kept(JETS).len() } {
                // samples have no mixed derivatives
                taps.tap(offset, slot, is_sample * own[const { kept(JETS) }[slot]][node]);
            }
            let is_none = one - is_sample;
            for weights in &mut own {
                weights[node] = is_none * weights[node];
            }
        }
        nodes_to_corners(profile, &upper, &edge, &mut own);
        for jet in const { kept(JETS) } {
            let jet = *jet;
            for corner in 0..8 {
                corners[jet][corner] = L::where_marked(table, corners[jet][corner], own[jet][corner]);
            }
        }
    }
}

impl<T: Real> TableModel<T> for CellModel<T> {
    #[inline(always)]
    fn table(&self) -> &[u32] {
        bytemuck::cast_slice(&self.table)
    }

    #[inline(always)]
    fn lane_taps<L: Lane<Scalar = T>>(&self, q: [L; 3], taps: &mut impl TableTaps<L>) {
        let along = self.lattice(q);
        self.taps_of_cells(self.cells_at(along), along, taps);
    }
}

crate::rig_model_of_table!(CellModel);

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
