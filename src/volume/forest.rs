//! Octrees side by side while they are built: cells are split, merged and balanced.

use super::cells::Place;

/// A cube of a tree.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: Place,
    level: u32,
    /// Place of the first of eight children; 0 for a leaf.
    children: u32,
    parent: u32,
    /// Belongs to a cell that was merged.
    dropped: bool,
}

/// Octrees that fill a box side by side. Places are in half edges of a cell of the maximum level.
#[derive(Clone, Debug)]
pub struct Forest {
    roots: Place,
    max_level: u32,
    nodes: Vec<Node>,
}

impl Forest {
    pub fn new(roots: Place, max_level: u32) -> Self {
        let mut nodes = Vec::new();
        let size = 2 << max_level;
        for z in 0..roots[2] {
            for y in 0..roots[1] {
                for x in 0..roots[0] {
                    let low = [x, y, z].map(|at| at * size);
                    nodes.push(Node { low, level: 0, children: 0, parent: u32::MAX, dropped: false });
                }
            }
        }
        Self { roots, max_level, nodes }
    }

    pub fn roots(&self) -> Place {
        self.roots
    }
    pub fn root_count(&self) -> usize {
        self.roots.iter().map(|n| *n as usize).product()
    }
    pub fn max_level(&self) -> u32 {
        self.max_level
    }
    /// Lattice units along the axes.
    pub fn resolution(&self) -> Place {
        self.roots.map(|n| n * (2 << self.max_level))
    }
    pub fn level(&self, node: u32) -> u32 {
        self.nodes[node as usize].level
    }
    /// Low corner and edge in lattice units.
    pub fn extent(&self, node: u32) -> (Place, u32) {
        let node = &self.nodes[node as usize];
        (node.low, 2 << (self.max_level - node.level))
    }
    pub fn children(&self, node: u32) -> Option<std::ops::Range<u32>> {
        let first = self.nodes[node as usize].children;
        (first > 0).then_some(first..first + 8)
    }

    /// All leaves.
    pub fn leaves(&self) -> Vec<u32> {
        let is_leaf = |node: &&u32| self.nodes[**node as usize].children == 0 && !self.nodes[**node as usize].dropped;
        (0..self.nodes.len() as u32).collect::<Vec<_>>().iter().filter(is_leaf).copied().collect()
    }

    /// Divides a leaf into eight.
    pub fn split(&mut self, node: u32) {
        let (low, size) = self.extent(node);
        let parent = self.nodes[node as usize];
        debug_assert!(parent.children == 0 && parent.level < self.max_level, "a leaf above the maximum level");
        self.nodes[node as usize].children = self.nodes.len() as u32;
        for child in 0..8u32 {
            let low = std::array::from_fn(|axis| low[axis] + size / 2 * (child >> axis & 1));
            self.nodes.push(Node { low, level: parent.level + 1, children: 0, parent: node, dropped: false });
        }
    }

    /// Inner nodes whose children are all leaves, deepest first.
    pub fn mergeable(&self) -> Vec<u32> {
        let leaf = |node: u32| self.nodes[node as usize].children == 0;
        let mut found: Vec<u32> = (0..self.nodes.len() as u32)
            .filter(|node| !self.nodes[*node as usize].dropped && self.children(*node).is_some_and(|mut c| c.all(leaf)))
            .collect();
        found.sort_by_key(|node| std::cmp::Reverse(self.level(*node)));
        found
    }

    /// Makes an inner node whose children are leaves a leaf again.
    pub fn merge(&mut self, node: u32) {
        for child in self.children(node).expect("an inner node") {
            self.nodes[child as usize].dropped = true;
        }
        self.nodes[node as usize].children = 0;
    }

    /// The parent, but for roots.
    pub fn parent(&self, node: u32) -> Option<u32> {
        let parent = self.nodes[node as usize].parent;
        (parent != u32::MAX).then_some(parent)
    }

    /// The leaf that holds the lattice cube whose low corner is given.
    fn leaf_at(&self, at: Place) -> u32 {
        let root = at.map(|u| u >> (self.max_level + 1));
        let mut node = root[0] + self.roots[0] * (root[1] + self.roots[1] * root[2]);
        while let Some(children) = self.children(node) {
            let bit = self.max_level - self.level(node);
            node = children.start + (0..3).map(|axis| (at[axis] >> bit & 1) << axis).sum::<u32>();
        }
        node
    }

    /// Splits leaves until neighbours over faces, edges and corners differ by one level at most.
    pub fn balance(&mut self) {
        loop {
            let mut wide: Vec<u32> = Vec::new();
            for leaf in self.leaves() {
                let (low, size) = self.extent(leaf);
                let level = self.level(leaf);
                for direction in 0..27i64 {
                    let at = [direction % 3 - 1, direction / 3 % 3 - 1, direction / 9 - 1];
                    let at: [i64; 3] = std::array::from_fn(|a| i64::from(low[a]) + at[a] * i64::from(size));
                    let inside = (0..3).all(|a| at[a] >= 0 && at[a] < i64::from(self.resolution()[a]));
                    if !inside {
                        continue;
                    }
                    // a leaf that is coarser than the cube beside this one holds all of it
                    let neighbour = self.leaf_at(at.map(|u| u as u32));
                    if self.level(neighbour) + 1 < level {
                        wide.push(neighbour);
                    }
                }
            }
            if wide.is_empty() {
                return;
            }
            wide.sort_unstable();
            wide.dedup();
            for leaf in wide {
                self.split(leaf);
            }
        }
    }
}
