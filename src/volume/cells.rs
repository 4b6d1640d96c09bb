//! Cells of a volume and the samples at their corners, shared by position.
//!
//! Places are whole numbers in half edges of the finest cell, so that corners and centres of all cells have one.

use std::collections::HashMap;

use super::forest::Forest;
use crate::rig::{Lane, MARK};

/// A place in lattice units along x, y and z.
pub type Place = [u32; 3];

/// No sample.
pub const NONE: u32 = u32::MAX;

/// A cell in which one interpolation holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    pub low: Place,
    /// Edge, lattice units; even.
    pub size: u32,
    /// Samples at its corners, x fastest.
    pub corners: [u32; 8],
    /// Place in [`Cells::hanging`] plus one; 0 where no neighbour is finer.
    hanging: u32,
}

/// From lattice coordinates to the cell that holds them.
#[derive(Clone, Debug, PartialEq)]
pub enum Locator {
    /// Octrees side by side from one of their levels on, `levels` below which the finest cells are: an entry for each cube of that level
    /// (`top` of them along the axes, x fastest), then blocks of eight children. An entry with [`LEAF`] is a cell, which may hold
    /// several cubes; others are the place of the first child.
    Forest { top: Place, levels: u32, nodes: Vec<u32> },
    /// A grid of cells of which some hold a finer grid: per outer cell its first cell, with [`LEAF`] where it is the only one.
    TwoLevel { outer: Place, inner: u32, first: Vec<u32> },
}

/// Marks an entry that is a cell.
pub const LEAF: u32 = MARK;

/// Cells that fill a box without overlap.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// Half extents of the box, metres.
    pub half: [f64; 3],
    /// Lattice units along the axes.
    pub resolution: Place,
    pub locator: Locator,
    pub cells: Vec<Cell>,
    /// Where each sample stands.
    pub places: Vec<Place>,
    /// Samples of finer neighbours on a cell's surface: 3 x 3 x 3 nodes, x fastest; [`NONE`] where there is none. Corners are the cell's.
    hanging: Vec<[u32; 27]>,
}

/// Gives samples their numbers by place, first come first served.
#[derive(Default)]
struct Numbering {
    places: Vec<Place>,
    number_of: HashMap<Place, u32>,
}

impl Numbering {
    fn of(&mut self, place: Place) -> u32 {
        *self.number_of.entry(place).or_insert_with(|| {
            self.places.push(place);
            (self.places.len() - 1) as u32
        })
    }
}

/// The eight corners of a cell, x fastest.
pub fn corner_places(low: Place, size: u32) -> [Place; 8] {
    std::array::from_fn(|corner| std::array::from_fn(|axis| low[axis] + size * (corner as u32 >> axis & 1)))
}

impl Cells {
    /// The leaves of octrees side by side; `forest` is balanced.
    pub fn of_forest(forest: &Forest, half: [f64; 3]) -> Self {
        let mut numbering = Numbering::default();
        let mut cells = Vec::new();
        // a number a cell at most, to begin the search as far down as that allows
        let count = forest.leaves().len();
        let begin =
            (0..=forest.max_level()).rev().find(|level| forest.root_count() << (3 * level) <= count).unwrap_or(0);
        let levels = forest.max_level() - begin;
        let top = forest.roots().map(|n| n << begin);
        let mut nodes = vec![0; top.iter().map(|n| *n as usize).product()];
        // breadth first, children in blocks of eight; above the level where the search begins nodes have no entry
        let mut queue: Vec<(u32, Option<usize>)> = (0..forest.root_count()).map(|root| (root as u32, None)).collect();
        let mut at = 0;
        while at < queue.len() {
            let (node, entry) = queue[at];
            at += 1;
            let (low, size) = forest.extent(node);
            let value = match forest.children(node) {
                Some(children) if forest.level(node) < begin => {
                    queue.extend(children.map(|child| (child, None)));
                    continue;
                }
                Some(children) => {
                    let first = nodes.len();
                    nodes.resize(first + 8, 0);
                    queue.extend(children.zip(first..).map(|(child, entry)| (child, Some(entry))));
                    first as u32
                }
                None => {
                    let corners = corner_places(low, size).map(|place| numbering.of(place));
                    cells.push(Cell { low, size, corners, hanging: 0 });
                    LEAF | (cells.len() - 1) as u32
                }
            };
            let Some(entry) = entry else {
                // every cube of the level where the search begins that this node holds
                let [from, to] = [low.map(|u| u >> (levels + 1)), low.map(|u| (u + size) >> (levels + 1))];
                for z in from[2]..to[2] {
                    for y in from[1]..to[1] {
                        for x in from[0]..to[0] {
                            nodes[(x + top[0] * (y + top[1] * z)) as usize] = value;
                        }
                    }
                }
                continue;
            };
            nodes[entry] = value;
        }
        let hanging = find_hanging(&mut cells, &numbering.number_of);
        let locator = Locator::Forest { top, levels, nodes };
        Self { half, resolution: forest.resolution(), locator, cells, places: numbering.places, hanging }
    }

    /// A grid of `outer` cells, x fastest, of which those that are `divided` hold `inner`^3 cells.
    pub fn two_level(outer: Place, inner: u32, half: [f64; 3], divided: &[bool]) -> Self {
        let mut numbering = Numbering::default();
        let mut cells = Vec::new();
        let mut first = Vec::new();
        let coarse = 2 * inner;
        for z in 0..outer[2] {
            for y in 0..outer[1] {
                for x in 0..outer[0] {
                    let low = [x * coarse, y * coarse, z * coarse];
                    let finer = divided[first.len()];
                    first.push(cells.len() as u32 | if finer { 0 } else { LEAF });
                    let (count, size) = if finer { (inner, 2) } else { (1, coarse) };
                    for c in 0..count * count * count {
                        let offset = [c % count, c / count % count, c / (count * count)];
                        let low = std::array::from_fn(|axis| low[axis] + size * offset[axis]);
                        let corners = corner_places(low, size).map(|place| numbering.of(place));
                        cells.push(Cell { low, size, corners, hanging: 0 });
                    }
                }
            }
        }
        let resolution = outer.map(|count| count * coarse);
        let locator = Locator::TwoLevel { outer, inner, first };
        Self { half, resolution, locator, cells, places: numbering.places, hanging: Vec::new() }
    }

    /// Metres a lattice unit, along the axes.
    pub fn unit(&self) -> [f64; 3] {
        std::array::from_fn(|axis| 2.0 * self.half[axis] / f64::from(self.resolution[axis]))
    }

    /// Box coordinates of a place; exact at the box's ends and its centre.
    pub fn position(&self, place: Place) -> [f64; 3] {
        position(place, self.resolution, self.half)
    }

    /// The cell that holds a lattice cube of one unit: its low corner is given.
    pub fn locate(&self, at: Place) -> usize {
        self.lane_locate::<f64>(at.map(|unit| unit as usize))
    }

    /// [`Cells::locate`] of several.
    #[inline(always)]
    pub fn lane_locate<L: Lane>(&self, [x, y, z]: [L::Index; 3]) -> L::Index {
        match &self.locator {
            Locator::Forest { top, levels, nodes } => {
                // a finest cell is two units wide
                let mut level = *levels as usize + 1;
                let (row, column) = (top[0] as usize, (top[0] * top[1]) as usize);
                let by = L::index(level);
                let cube = L::index_sum(L::shifted(x, by), L::shifted(y, by), row);
                let mut node = L::lookup(nodes, L::index_sum(cube, L::shifted(z, by), column));
                while !L::all_marked(node) {
                    level -= 1;
                    let by = L::index(level);
                    let along_x = L::bits(L::shifted(x, by), 1);
                    let along_y = L::bits(L::shifted(y, by), 1);
                    let along_z = L::bits(L::shifted(z, by), 1);
                    let child = L::index_sum(L::index_sum(L::index_sum(node, along_x, 1), along_y, 2), along_z, 4);
                    node = L::index_where_marked(node, node, L::lookup(nodes, child));
                }
                L::bits(node, !LEAF)
            }
            Locator::TwoLevel { outer, inner, first } => {
                let coarse = 2.0 * f64::from(*inner);
                let (mut cell, mut part) = (L::index(0), L::index(0));
                let (mut row, mut part_row) = (1, 1);
                let places = [x, y, z];
                for axis in 0..3 {
                    let at = L::number(places[axis]);
                    let most = outer[axis] as usize - 1;
                    let along = ((at + L::constant(0.5)) * L::constant(1.0 / coarse)).whole(most);
                    let within = at - L::number(along) * L::constant(coarse);
                    cell = L::index_sum(cell, along, row);
                    part = L::index_sum(part, (within * L::constant(0.5)).whole(*inner as usize - 1), part_row);
                    row *= outer[axis] as usize;
                    part_row *= *inner as usize;
                }
                let entry = L::lookup(first, cell);
                L::index_where_marked(entry, L::bits(entry, !LEAF), L::index_sum(entry, part, 1))
            }
        }
    }

    /// The 3 x 3 x 3 nodes of a cell that has finer neighbours.
    pub fn hanging(&self, cell: usize) -> Option<&[u32; 27]> {
        self.cells[cell].hanging.checked_sub(1).map(|table| &self.hanging[table as usize])
    }

    /// Bytes of the structure beside the samples: nodes, cells and their tables.
    pub fn bytes(&self) -> usize {
        let locator = match &self.locator {
            Locator::Forest { nodes, .. } => 4 * nodes.len(),
            Locator::TwoLevel { first, .. } => 4 * first.len(),
        };
        // a cell: its eight corners, its place and size in one word each, its table
        locator + self.cells.len() * 4 * 11 + self.hanging.len() * 4 * 27
    }

    /// Faces between two cells: the cells and, in box coordinates, the rectangle that they share.
    pub fn faces(&self) -> Vec<Face> {
        let mut faces = Vec::new();
        for (index, cell) in self.cells.iter().enumerate() {
            for axis in 0..3 {
                let beyond = cell.low[axis] + cell.size;
                if beyond >= self.resolution[axis] {
                    continue;
                }
                // neighbours along the upper face, each unit square of it looked up once
                let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
                let mut seen = Vec::new();
                for v in (0..cell.size).step_by(2) {
                    for u in (0..cell.size).step_by(2) {
                        let mut at = cell.low;
                        at[axis] = beyond;
                        at[b] += u;
                        at[c] += v;
                        let other = self.locate(at);
                        if seen.contains(&other) {
                            continue;
                        }
                        seen.push(other);
                        let neighbour = &self.cells[other];
                        let mut low = cell.low;
                        low[axis] = beyond;
                        let mut high = low;
                        for side in [b, c] {
                            low[side] = cell.low[side].max(neighbour.low[side]);
                            high[side] = (cell.low[side] + cell.size).min(neighbour.low[side] + neighbour.size);
                        }
                        faces.push(Face {
                            cells: [index, other],
                            low: self.position(low),
                            high: self.position(high),
                            between_levels: cell.size != neighbour.size,
                        });
                    }
                }
            }
        }
        faces
    }

    /// Pairs of samples at the two ends of a cell's edge, each once.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let mut edges: Vec<[u32; 2]> = self
            .cells
            .iter()
            .flat_map(|cell| {
                (0..8usize).flat_map(move |a| {
                    (0..3).filter(move |axis| a >> axis & 1 == 0).map(move |axis| {
                        let (from, to) = (cell.corners[a], cell.corners[a | 1 << axis]);
                        [from.min(to), from.max(to)]
                    })
                })
            })
            .collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }
}

/// A rectangle between two cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Face {
    pub cells: [usize; 2],
    pub low: [f64; 3],
    pub high: [f64; 3],
    /// Whether the cells differ in size.
    pub between_levels: bool,
}

/// Box coordinates of a place among `resolution` units over the half extents: from both ends, so that the set mirrors itself.
pub fn position(place: Place, resolution: Place, half: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| {
        half[axis] * (2.0 * f64::from(place[axis]) - f64::from(resolution[axis])) / f64::from(resolution[axis])
    })
}

/// The nodes of cells that lie on a finer neighbour: by 2:1 balance they are middles of edges and faces.
fn find_hanging(cells: &mut [Cell], number_of: &HashMap<Place, u32>) -> Vec<[u32; 27]> {
    let mut tables = Vec::new();
    for cell in cells.iter_mut().filter(|cell| cell.size >= 4) {
        let step = cell.size / 2;
        let table: [u32; 27] = std::array::from_fn(|node| {
            let offset = [node as u32 % 3, node as u32 / 3 % 3, node as u32 / 9];
            let place: Place = std::array::from_fn(|axis| cell.low[axis] + step * offset[axis]);
            number_of.get(&place).copied().unwrap_or(NONE)
        });
        if table.iter().filter(|sample| **sample != NONE).count() > 8 {
            tables.push(table);
            cell.hanging = tables.len() as u32;
        }
    }
    tables
}
