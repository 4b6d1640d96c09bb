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

/// Metres from a place to a triangle (Ericson 2005, 5.1.5, by the regions of the triangle's plane).
pub fn distance_to_triangle(place: DVec3, [a, b, c]: &[DVec3; 3]) -> f64 {
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
}
