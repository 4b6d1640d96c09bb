//! A cut through a volume and the scene around it: what a debug picture shows.

use glam::DVec3;

use super::bake::BakedVolume;

/// What lies in the plane through the middle of a volume's box, across one of its axes. Box coordinates of the other two axes, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// Low and high corners of the cells that are cut.
    pub cells: Vec<[[f64; 2]; 2]>,
    /// Samples in the plane or at the nearest corners of the cells that are cut, and whether each lies inside geometry.
    pub samples: Vec<([f64; 2], bool)>,
    /// Static geometry, cut.
    pub walls: Vec<[[f64; 2]; 2]>,
}

impl BakedVolume {
    /// The section across an axis.
    pub fn section(&self, across: usize, statics: &[[DVec3; 3]]) -> Section {
        let [a, b] = plane_axes(across);
        let flat = |place: [f64; 3]| [place[a], place[b]];
        let cut: Vec<[[f64; 3]; 2]> =
            self.cell_boxes().into_iter().filter(|[low, high]| low[across] <= 0.0 && high[across] > 0.0).collect();
        // samples at the lower face of a cell that is cut stand for it
        let lowest = cut.iter().map(|[low, _]| low[across]).fold(0.0, f64::min);
        let samples = self
            .places
            .iter()
            .zip(&self.inside)
            .filter(|(place, _)| place[across] >= lowest && place[across] <= 0.0)
            .filter(|(place, _)| {
                let corner = |[low, high]: &[[f64; 3]; 2]| {
                    place[across] == low[across]
                        && [a, b].iter().all(|axis| place[*axis] == low[*axis] || place[*axis] == high[*axis])
                };
                cut.is_empty() || cut.iter().any(corner)
            })
            .map(|(place, inside)| (flat(*place), *inside))
            .collect();
        let reach = DVec3::from_array(self.bounds.half) * 1.3;
        let walls = statics
            .iter()
            .filter_map(|triangle| {
                let corners = triangle.map(|corner| self.bounds.local(corner));
                let ends: Vec<DVec3> = (0..3)
                    .filter_map(|i| {
                        let (p, q) = (corners[i], corners[(i + 1) % 3]);
                        let (from, to) = (p[across], q[across]);
                        ((from < 0.0) != (to < 0.0)).then(|| p + (q - p) * (from / (from - to)))
                    })
                    .collect();
                let [p, q] = ends[..] else { return None };
                // what lies far beyond the box is no part of the picture
                let [p, q] = [p, q].map(|end| end.clamp(-reach, reach));
                Some([flat(p.to_array()), flat(q.to_array())])
            })
            .collect();
        Section { cells: cut.iter().map(|[low, high]| [flat(*low), flat(*high)]).collect(), samples, walls }
    }
}

/// The axes that span the plane across one: to the right and downwards, x and z seen from above.
fn plane_axes(across: usize) -> [usize; 2] {
    match across {
        0 => [2, 1],
        1 => [0, 2],
        _ => [0, 1],
    }
}

impl Section {
    /// As a table: kind (cell, sample, inside, wall) and two corners.
    pub fn to_csv(&self) -> String {
        let mut text = "kind,u0,v0,u1,v1\n".to_owned();
        let mut row = |kind: &str, [a, b]: [f64; 2], [c, d]: [f64; 2]| text += &format!("{kind},{a},{b},{c},{d}\n");
        self.walls.iter().for_each(|[p, q]| row("wall", *p, *q));
        self.cells.iter().for_each(|[low, high]| row("cell", *low, *high));
        self.samples.iter().for_each(|(p, inside)| row(if *inside { "inside" } else { "sample" }, *p, *p));
        text
    }
}
