//! Faces with more than three corners, split into triangles.

use glam::{DVec2, DVec3};

/// The most corners of a concave face: cutting ears takes their number squared.
const MOST_CONCAVE_CORNERS: usize = 4096;

/// Splits a planar polygon into triangles of the same winding: a fan where it is convex, else by cutting ears
/// (Meisters 1975) in the plane of its vector area.
pub(super) fn triangles(corners: &[DVec3]) -> Result<Vec<[usize; 3]>, String> {
    let count = corners.len();
    let fan = || (1..count - 1).map(|i| [0, i, i + 1]).collect();
    match count {
        0..=2 => return Err(format!("a face of {count} corners; it needs three or more")),
        3 => return Ok(vec![[0, 1, 2]]),
        _ => {}
    }
    let Some(plane) = flattened(corners) else {
        return Ok(fan()); // no area at all: the triangles are dropped later
    };
    if is_convex(&plane) {
        return Ok(fan());
    }
    if count > MOST_CONCAVE_CORNERS {
        return Err(format!("a concave face of {count} corners; at most {MOST_CONCAVE_CORNERS}"));
    }
    Ok(cut_ears(&plane))
}

/// The corners in coordinates of their plane, counter-clockwise; `None` where the vector area (Newell) vanishes.
fn flattened(corners: &[DVec3]) -> Option<Vec<DVec2>> {
    let first = corners[0];
    let area: DVec3 = corners.windows(2).map(|w| (w[0] - first).cross(w[1] - first)).sum();
    let normal = area.try_normalize()?;
    let tangent = normal.any_orthonormal_vector();
    let bitangent = normal.cross(tangent);
    Some(corners.iter().map(|p| DVec2::new((*p - first).dot(tangent), (*p - first).dot(bitangent))).collect())
}

/// Positive where a, b, c turn left.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Whether all corners turn left and the outline goes round once.
fn is_convex(plane: &[DVec2]) -> bool {
    let count = plane.len();
    let at = |i: usize| plane[i % count];
    (0..count).all(|i| turn(at(i), at(i + 1), at(i + 2)) >= 0.0)
        && (1..count - 1).all(|i| turn(at(0), at(i), at(i + 1)) >= 0.0)
}

fn cut_ears(plane: &[DVec2]) -> Vec<[usize; 3]> {
    let mut left: Vec<usize> = (0..plane.len()).collect();
    let mut triangles = Vec::with_capacity(plane.len() - 2);
    while left.len() > 3 {
        let count = left.len();
        let ear = (0..count)
            .find(|i| {
                let [a, b, c] = [left[(i + count - 1) % count], left[*i], left[(i + 1) % count]].map(|k| plane[k]);
                turn(a, b, c) > 0.0
                    && left.iter().all(|k| {
                        let p = plane[*k];
                        let corner = p == a || p == b || p == c;
                        corner || !(turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0)
                    })
            })
            .unwrap_or(0); // crosses itself: any cut ends the loop
        triangles.push([left[(ear + count - 1) % count], left[ear], left[(ear + 1) % count]]);
        left.remove(ear);
    }
    triangles.push([left[0], left[1], left[2]]);
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[DVec3], triangles: &[[usize; 3]]) -> DVec3 {
        triangles.iter().map(|t| 0.5 * (corners[t[1]] - corners[t[0]]).cross(corners[t[2]] - corners[t[0]])).sum()
    }

    #[test]
    fn concave_faces_are_covered_once_and_a_fan_would_not() {
        // an arrow head whose first corner sees the notch from outside
        let corners = [[2.0, 0.0], [3.0, 3.0], [0.0, 0.5], [-3.0, 3.0], [-2.0, 0.0], [0.0, -1.0]]
            .map(|[x, z]| DVec3::new(x, 0.25, -z));
        let parts = triangles(&corners).unwrap();
        assert_eq!(parts.len(), 4);
        let whole = area(&corners, &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]);
        assert!((area(&corners, &parts) - whole).length() < 1e-12);
        let unsigned = |parts: &[[usize; 3]]| parts.iter().map(|t| area(&corners, &[*t]).length()).sum::<f64>();
        assert!((unsigned(&parts) - whole.length()).abs() < 1e-12, "{parts:?}");
        assert!(unsigned(&[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]) > whole.length() + 0.1);
    }

    #[test]
    fn odd_faces_end() {
        let square = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
        assert_eq!(triangles(&square).unwrap().len(), 2); // crosses itself, no vector area
        let bow = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 1.0], [0.5, 3.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
        assert_eq!(triangles(&bow).unwrap().len(), 3);
        assert_eq!(triangles(&[DVec3::ONE; 5]).unwrap().len(), 3);
        assert!(triangles(&square[..2]).is_err());
    }
}
