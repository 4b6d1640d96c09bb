//! Cells of a volume and the samples at their corners, shared by position.
//!
//! Places are whole numbers in half edges of the finest cell, so that corners and centres of all cells have one.

use std::collections::HashMap;

use super::forest::Forest;

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
    /// Octrees side by side: roots first, then blocks of eight children. An entry with [`LEAF`] is a cell, others are the place of the
    /// first child.
    Forest { roots: Place, max_level: u32, nodes: Vec<u32> },
    /// A grid of cells of which some hold a finer grid: per outer cell its first cell and whether it is divided.
    TwoLevel { outer: Place, inner: u32, first: Vec<(u32, bool)> },
}

/// Marks an entry of a forest that is a cell.
pub const LEAF: u32 = 1 << 31;

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
        let mut nodes = vec![0; forest.root_count()];
        // breadth first, children in blocks of eight
        let mut queue: Vec<(u32, usize)> = (0..forest.root_count()).map(|root| (root as u32, root)).collect();
        let mut at = 0;
        while at < queue.len() {
            let (node, entry) = queue[at];
            at += 1;
            match forest.children(node) {
                Some(children) => {
                    nodes[entry] = nodes.len() as u32;
                    for child in children {
                        queue.push((child, nodes.len()));
                        nodes.push(0);
                    }
                }
                None => {
                    nodes[entry] = LEAF | cells.len() as u32;
                    let (low, size) = forest.extent(node);
                    let corners = corner_places(low, size).map(|place| numbering.of(place));
                    cells.push(Cell { low, size, corners, hanging: 0 });
                }
            }
        }
        let hanging = find_hanging(&mut cells, &numbering.number_of);
        let locator = Locator::Forest { roots: forest.roots(), max_level: forest.max_level(), nodes };
        Self { half, resolution: forest.resolution(), locator, cells, places: numbering.places, hanging }
    }

    /// A grid of `outer` cells of which those that `divided` chooses hold `inner`^3 cells.
    pub fn two_level(outer: Place, inner: u32, half: [f64; 3], divided: impl Fn(Place, u32) -> bool) -> Self {
        let mut numbering = Numbering::default();
        let mut cells = Vec::new();
        let mut first = Vec::new();
        let coarse = 2 * inner;
        for z in 0..outer[2] {
            for y in 0..outer[1] {
                for x in 0..outer[0] {
                    let low = [x * coarse, y * coarse, z * coarse];
                    let finer = divided(low, coarse);
                    first.push((cells.len() as u32, finer));
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
    #[inline]
    pub fn locate(&self, at: Place) -> usize {
        match &self.locator {
            Locator::Forest { roots, max_level, nodes } => {
                // a finest cell is two units wide
                let fine = at.map(|u| u >> 1);
                let [x, y, z] = fine.map(|u| u >> max_level);
                let mut node = nodes[(x + roots[0] * (y + roots[1] * z)) as usize];
                let mut level = *max_level;
                while node & LEAF == 0 {
                    level -= 1;
                    let [x, y, z] = fine.map(|u| u >> level & 1);
                    node = nodes[(node + x + 2 * y + 4 * z) as usize];
                }
                (node & !LEAF) as usize
            }
            Locator::TwoLevel { outer, inner, first } => {
                let [x, y, z] = at.map(|u| u / (2 * inner));
                let (cell, divided) = first[(x + outer[0] * (y + outer[1] * z)) as usize];
                if !divided {
                    return cell as usize;
                }
                let [x, y, z] = at.map(|u| u % (2 * inner) / 2);
                (cell + x + inner * (y + inner * z)) as usize
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
