use std::collections::HashMap;

use glam::DVec3;

use super::Mesh;

/// Finds the triangle of a mesh on which a place lies.
#[derive(Clone, Debug)]
pub struct SurfaceFinder {
    triangles: Vec<[u32; 3]>,
    corners: Vec<[DVec3; 3]>,
    low: DVec3,
    /// Edge of a bucket, metres.
    edge: f64,
    buckets: HashMap<[i64; 3], Vec<u32>>,
}

impl SurfaceFinder {
    pub fn new(mesh: &Mesh) -> Self {
        let (low, high) = mesh.bounds();
        let corners: Vec<[DVec3; 3]> = (0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect();
        // about as many buckets on the surface as there are triangles
        let edge = ((high - low).length() / (corners.len() as f64).sqrt().max(1.0)).max(f64::MIN_POSITIVE);
        let mut finder = Self { triangles: mesh.triangles.clone(), corners, low, edge, buckets: HashMap::new() };
        for (index, [a, b, c]) in finder.corners.iter().enumerate() {
            let [first, last] = [finder.bucket(a.min(*b).min(*c)), finder.bucket(a.max(*b).max(*c))];
            for x in first[0] - 1..=last[0] + 1 {
                for y in first[1] - 1..=last[1] + 1 {
                    for z in first[2] - 1..=last[2] + 1 {
                        finder.buckets.entry([x, y, z]).or_default().push(index as u32);
                    }
                }
            }
        }
        finder
    }

    fn bucket(&self, place: DVec3) -> [i64; 3] {
        ((place - self.low) / self.edge).to_array().map(|x| x.floor() as i64)
    }

    /// Triangles of the mesh.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Vertices of a triangle.
    pub fn triangle(&self, index: usize) -> [u32; 3] {
        self.triangles[index]
    }

    /// Vertices of all triangles, three of each.
    pub fn vertices(&self) -> &[u32] {
        self.triangles.as_flattened()
    }

    /// The triangle nearest to a place on the surface, and the weights of its second and third vertex there, cut to the triangle.
    pub fn find(&self, place: DVec3) -> (usize, [f64; 2]) {
        let everything: Vec<u32>;
        let near = match self.buckets.get(&self.bucket(place)) {
            Some(near) => near,
            None => {
                everything = (0..self.triangles.len() as u32).collect();
                &everything
            }
        };
        let mut best = (f64::INFINITY, 0, [0.0; 2]);
        for index in near {
            let [a, b, c] = self.corners[*index as usize];
            let [u, v] = weights([a, b, c], place);
            let distance = (a + (b - a) * u + (c - a) * v - place).length_squared();
            if distance < best.0 {
                best = (distance, *index as usize, [u, v]);
            }
        }
        (best.1, best.2)
    }
}

/// Weights of b and c at the projection of a place on a triangle's plane, not negative and at most 1 together.
fn weights([a, b, c]: [DVec3; 3], place: DVec3) -> [f64; 2] {
    let (e, f, p) = (b - a, c - a, place - a);
    let (ee, ef, ff) = (e.dot(e), e.dot(f), f.dot(f));
    let determinant = ee * ff - ef * ef;
    if determinant <= 0.0 {
        return [0.0; 2];
    }
    let u = ((ff * p.dot(e) - ef * p.dot(f)) / determinant).clamp(0.0, 1.0);
    let v = ((ee * p.dot(f) - ef * p.dot(e)) / determinant).clamp(0.0, 1.0 - u);
    [u, v]
}
