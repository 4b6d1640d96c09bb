//! Normals of a mesh whose file gives none: angle-weighted means over the faces around a corner, with a crease.

use std::collections::HashMap;

use glam::DVec3;

use super::RawMesh;

/// Faces that meet at more than this angle keep their own normals, degrees.
const CREASE_DEGREES: f64 = 40.0;

/// The most triangles around one vertex: the work grows with their number squared.
const MOST_AROUND_A_VERTEX: usize = 1 << 14;

/// Unit normals of all corners: the file's where it has them, else
/// n = sum of angle_j n_j over the faces j at the corner's position with n_j within 40 degrees of the corner's own face
/// (angle weights: Thürmer and Wüthrich 1998). Vertices at the same place count as one.
pub(super) fn complete(raw: &RawMesh) -> Result<Vec<[DVec3; 3]>, String> {
    if raw.normals.iter().flatten().all(Option::is_some) && !raw.normals.is_empty() {
        return Ok(raw.normals.iter().map(|n| n.map(|n| unit(n.expect("just seen")))).collect());
    }
    let faces: Vec<DVec3> = raw
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| raw.positions[i as usize]);
            unit((b - a).cross(c - a))
        })
        .collect();
    let around = faces_around_places(raw);
    if let Some(most) = around.values().map(Vec::len).max().filter(|n| *n > MOST_AROUND_A_VERTEX) {
        return Err(format!("{most} triangles share one vertex; at most {MOST_AROUND_A_VERTEX} may"));
    }
    let crease = CREASE_DEGREES.to_radians().cos();
    let smooth = |triangle: usize, corner: usize| {
        let own = faces[triangle];
        around[&place(raw.positions[raw.triangles[triangle][corner] as usize])]
            .iter()
            .filter(|(other, _)| own.dot(faces[*other as usize]) >= crease)
            .map(|(other, angle)| faces[*other as usize] * *angle)
            .sum::<DVec3>()
            .try_normalize()
            .unwrap_or(own)
    };
    Ok((0..faces.len())
        .map(|t| {
            let given = raw.normals.get(t).copied().unwrap_or([None; 3]);
            [0, 1, 2].map(|corner| given[corner].map_or_else(|| smooth(t, corner), unit))
        })
        .collect())
}

/// A vector of any length but zero, made unit without overflow or underflow of its square.
fn unit(v: DVec3) -> DVec3 {
    (v / v.abs().max_element()).normalize()
}

/// The key of a position: its bits, with -0 and 0 the same.
fn place(p: DVec3) -> [u64; 3] {
    p.to_array().map(|c| (c + 0.0).to_bits())
}

/// For every place the triangles around it and their angles there, radians.
fn faces_around_places(raw: &RawMesh) -> HashMap<[u64; 3], Vec<(u32, f64)>> {
    let mut around: HashMap<[u64; 3], Vec<(u32, f64)>> = HashMap::new();
    for (index, triangle) in raw.triangles.iter().enumerate() {
        let corners = triangle.map(|i| raw.positions[i as usize]);
        for corner in 0..3 {
            let (a, b) = (corners[(corner + 1) % 3] - corners[corner], corners[(corner + 2) % 3] - corners[corner]);
            let angle = a.cross(b).length().atan2(a.dot(b));
            around.entry(place(corners[corner])).or_default().push((index as u32, angle));
        }
    }
    around
}
