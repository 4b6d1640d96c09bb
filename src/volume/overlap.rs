use glam::DVec3;

/// Whether a triangle and a box about the origin with these half extents have a place in common, surfaces included
/// (Akenine-Moller 2001: the thirteen axes on which two such shapes can be apart).
pub fn triangle_overlaps_box(triangle: &[DVec3; 3], half: DVec3) -> bool {
    let [a, b, c] = *triangle;
    let edges = [b - a, c - b, a - c];
    let apart = |axis: DVec3| {
        let along = [a.dot(axis), b.dot(axis), c.dot(axis)];
        let reach = half.dot(axis.abs());
        let lowest = along.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = along.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        lowest > reach || highest < -reach
    };
    let faces = DVec3::AXES.into_iter().any(apart);
    let crosses = || edges.iter().any(|edge| DVec3::AXES.into_iter().any(|axis| apart(axis.cross(*edge))));
    !(faces || apart(edges[0].cross(edges[1])) || crosses())
}

/// Triangles sorted into boxes within boxes, for the question how far away the nearest is.
pub struct NearestSurface {
    triangles: Vec<[DVec3; 3]>,
    nodes: Vec<Node>,
}

/// A box about some triangles that follow one another.
struct Node {
    low: DVec3,
    high: DVec3,
    members: std::ops::Range<usize>,
    /// The second of two parts; the first is the next node. 0 where the triangles are few.
    second: usize,
}

impl NearestSurface {
    /// Triangles of a box that is not divided.
    const FEW: usize = 4;

    pub fn new(triangles: &[[DVec3; 3]]) -> Self {
        let mut sorted = Self { triangles: triangles.to_vec(), nodes: Vec::new() };
        if !triangles.is_empty() {
            sorted.divide(0..triangles.len());
        }
        sorted
    }

    fn divide(&mut self, members: std::ops::Range<usize>) {
        let own = &mut self.triangles[members.clone()];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in own.iter().flatten() {
            (low, high) = (low.min(*corner), high.max(*corner));
        }
        let node = self.nodes.len();
        self.nodes.push(Node { low, high, members: members.clone(), second: 0 });
        if own.len() <= Self::FEW {
            return;
        }
        let size = high - low;
        let axis = (0..3).max_by(|a, b| size[*a].total_cmp(&size[*b])).expect("three axes");
        let middle = |[a, b, c]: &[DVec3; 3]| a[axis] + b[axis] + c[axis];
        let half = own.len() / 2;
        own.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
        self.divide(members.start..members.start + half);
        self.nodes[node].second = self.nodes.len();
        self.divide(members.start + half..members.end);
    }

    /// Metres from a place to the nearest triangle; infinite where there is none.
    pub fn distance(&self, place: DVec3) -> f64 {
        let mut nearest = f64::INFINITY;
        let mut open = Vec::from_iter((!self.nodes.is_empty()).then_some(0));
        while let Some(index) = open.pop() {
            let node = &self.nodes[index];
            if (place.clamp(node.low, node.high) - place).length() > nearest {
                continue;
            }
            if node.second > 0 {
                open.extend([node.second, index + 1]);
                continue;
            }
            for triangle in &self.triangles[node.members.clone()] {
                nearest = nearest.min(distance_to_triangle(place, triangle));
            }
        }
        nearest
    }
}

/// Metres from a place to a triangle (Ericson 2005, 5.1.5, by the regions of the triangle's plane).
fn distance_to_triangle(place: DVec3, [a, b, c]: &[DVec3; 3]) -> f64 {
    let to_edge = |from: DVec3, to: DVec3| {
        let edge = to - from;
        let along = ((place - from).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (from + edge * along - place).length()
    };
    let normal = (*b - *a).cross(*c - *a);
    // above the triangle: on the inner side of every edge
    let inner = |from: DVec3, to: DVec3| normal.cross(to - from).dot(place - from) >= 0.0;
    if inner(*a, *b) && inner(*b, *c) && inner(*c, *a) && normal.length_squared() > 0.0 {
        return (place - *a).dot(normal.normalize()).abs();
    }
    to_edge(*a, *b).min(to_edge(*b, *c)).min(to_edge(*c, *a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_misses_are_told_from_hits() {
        let half = DVec3::ONE;
        let triangle = |offset: DVec3| [DVec3::X, DVec3::Y, DVec3::Z].map(|corner| corner + offset);
        assert!(triangle_overlaps_box(&triangle(DVec3::ZERO), half));
        // a plane across a corner: x + y + z = 3 touches, above it misses although the boxes overlap
        let corner = |d: f64| [DVec3::new(d, 0.0, 0.0), DVec3::new(0.0, d, 0.0), DVec3::new(0.0, 0.0, d)];
        assert!(triangle_overlaps_box(&corner(2.99), half));
        assert!(!triangle_overlaps_box(&corner(3.01), half));
        // a needle that passes an edge
        let needle = |d: f64| [DVec3::new(d, 0.0, -5.0), DVec3::new(0.0, d, -5.0), DVec3::new(0.5 * d, 0.5 * d, 5.0)];
        assert!(triangle_overlaps_box(&needle(1.9), half));
        assert!(!triangle_overlaps_box(&needle(2.1), half));
    }

    #[test]
    fn distances_over_face_edge_and_corner() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for (place, distance) in [
            (DVec3::new(0.2, 0.3, 2.0), 2.0),
            (DVec3::new(0.5, -3.0, 4.0), 5.0),
            (DVec3::new(4.0, 0.0, 4.0), 5.0),
            (DVec3::new(1.0, 1.0, 0.0), 0.5f64.sqrt()),
            (DVec3::new(-3.0, -4.0, 0.0), 5.0),
        ] {
            assert!((distance_to_triangle(place, &triangle) - distance).abs() < 1e-12, "{place}");
        }
    }

    #[test]
    fn the_nearest_of_many_is_that_of_a_search_through_all() {
        use crate::math::{Stream, StreamPurpose};
        let mut stream = Stream::indexed(5, StreamPurpose::Test, 1);
        for count in [0, 1, 4, 5, 300] {
            let soup: Vec<[DVec3; 3]> = (0..count)
                .map(|_| {
                    let at = 4.0 * stream.direction() * stream.uniform();
                    std::array::from_fn(|_| at + stream.direction())
                })
                .collect();
            let surface = NearestSurface::new(&soup);
            for _ in 0..200 {
                let place = 6.0 * stream.direction() * stream.uniform();
                let all = soup.iter().map(|t| distance_to_triangle(place, t)).fold(f64::INFINITY, f64::min);
                let found = surface.distance(place);
                assert!(found == all || (found - all).abs() < 1e-12, "{count} at {place}: {found} for {all}");
            }
        }
    }
}
