//! Triangle meshes: what every reader gives, checked and completed with normals.

mod gltf;
mod normals;
mod obj;
mod ply;
mod polygon;

use std::collections::HashMap;
use std::path::Path;

use glam::{DAffine3, DVec3};

use crate::input::InputError;

/// Files that are read as meshes, by the end of their names.
pub const MESH_EXTENSIONS: &[&str] = &["obj", "ply", "gltf", "glb"];

/// The largest mesh file that is read, bytes.
const LARGEST_FILE: u64 = 256 << 20;

/// The most triangles of one mesh.
const MOST_TRIANGLES: usize = 1 << 24;

/// Coordinates beyond this (metres) would overflow in areas and volumes.
const LARGEST_COORDINATE: f64 = 1e30;

/// Triangles with a unit shading normal at every corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Metres. Every position belongs to a triangle.
    pub positions: Vec<DVec3>,
    /// Corners as indices of positions, counter-clockwise seen from the front. Every triangle has an area.
    pub triangles: Vec<[u32; 3]>,
    /// Unit shading normals of the corners of each triangle.
    pub normals: Vec<[DVec3; 3]>,
}

impl Mesh {
    /// Reads a mesh file with everything that it refers to; `assets` collects the bytes that were read.
    pub fn read(path: &Path, assets: &mut Vec<Vec<u8>>) -> Result<Self, InputError> {
        let bytes = read_bounded(path)?;
        let mesh = Self::of_bytes(path, &bytes, assets)?;
        assets.push(bytes);
        Ok(mesh)
    }

    /// The mesh of a file's bytes; its name says the format, its folder is where other files are looked for.
    pub fn of_bytes(path: &Path, bytes: &[u8], assets: &mut Vec<Vec<u8>>) -> Result<Self, InputError> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let raw = match extension.as_str() {
            "obj" => obj::read(path, bytes),
            "ply" => ply::read(path, bytes),
            "gltf" | "glb" => gltf::read(path, bytes, assets),
            _ => Err(InputError::of_file(path, format!("no mesh file: its name must end in {}", extension_list()))),
        }?;
        raw.finish().map_err(|message| InputError::of_file(path, message))
    }

    /// The corners of a triangle.
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|i| self.positions[i as usize])
    }

    /// Twice the area of a triangle, m^2.
    pub(super) fn doubled_area(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a).length()
    }

    /// Area of the surface, m^2.
    pub fn area(&self) -> f64 {
        0.5 * (0..self.triangles.len()).map(|t| self.doubled_area(t)).sum::<f64>()
    }

    /// Smallest and largest coordinates.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let (min, max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        self.positions.iter().fold((min, max), |(min, max), p| (min.min(*p), max.max(*p)))
    }

    /// The mesh in other coordinates. Normals go by the inverse transpose; a mirroring map turns the winding round,
    /// so that fronts stay fronts.
    pub fn transformed(&self, map: &DAffine3) -> Self {
        let normal_map = map.matrix3.inverse().transpose();
        let mirrored = map.matrix3.determinant() < 0.0;
        let turn = |[a, b, c]: [u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        Self {
            positions: self.positions.iter().map(|p| map.transform_point3(*p)).collect(),
            triangles: self.triangles.iter().map(|t| turn(*t)).collect(),
            normals: self
                .normals
                .iter()
                .map(|n| {
                    let [a, b, c] = n.map(|n| (normal_map * n).normalize());
                    if mirrored { [a, c, b] } else { [a, b, c] }
                })
                .collect(),
        }
    }

    /// Position and unit shading normal at barycentric coordinates (weights of the second and third corner).
    pub fn point(&self, triangle: usize, u: f64, v: f64) -> super::SurfacePoint {
        let [a, b, c] = self.corners(triangle);
        let [na, nb, nc] = self.normals[triangle];
        let w = 1.0 - u - v;
        let normal = (na * w + nb * u + nc * v).try_normalize();
        super::SurfacePoint {
            position: a * w + b * u + c * v,
            // opposite corner normals cancel: the face's own normal stands in
            normal: normal.unwrap_or_else(|| (b - a).cross(c - a).normalize()),
        }
    }
}

fn extension_list() -> String {
    MESH_EXTENSIONS.iter().map(|e| format!("`.{e}`")).collect::<Vec<_>>().join(", ")
}

/// A file's bytes, if it is not larger than a mesh may be.
fn read_bounded(path: &Path) -> Result<Vec<u8>, InputError> {
    crate::input::read_bounded(path, LARGEST_FILE, "a mesh file")
}

/// What a reader makes of a file: indices are in range, numbers are finite.
#[derive(Debug, Default)]
pub(super) struct RawMesh {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// The file's normals of each triangle's corners, any length but 0; empty where the file has none at all.
    pub normals: Vec<[Option<DVec3>; 3]>,
}

impl RawMesh {
    /// Adds a face of three or more corners, split into triangles.
    fn add_face(&mut self, corners: &[u32], normals: &[Option<DVec3>]) -> Result<(), String> {
        if self.triangles.len() + corners.len() > MOST_TRIANGLES {
            return Err(format!("more than {MOST_TRIANGLES} triangles"));
        }
        let places: Vec<DVec3> = corners.iter().map(|i| self.positions[*i as usize]).collect();
        for triangle in polygon::triangles(&places)? {
            self.triangles.push(triangle.map(|i| corners[i]));
            if !normals.is_empty() {
                self.normals.resize(self.triangles.len() - 1, [None; 3]);
                self.normals.push(triangle.map(|i| normals[i]));
            }
        }
        Ok(())
    }

    /// Drops triangles without area and vertices without triangle, and completes the normals.
    pub fn finish(mut self) -> Result<Mesh, String> {
        if self.positions.is_empty() {
            return Err("the mesh has no vertices".to_owned());
        }
        if self.triangles.is_empty() {
            return Err("the mesh has no triangles".to_owned());
        }
        if let Some(p) = self.positions.iter().find(|p| p.abs().max_element() > LARGEST_COORDINATE) {
            return Err(format!("the vertex {p} lies beyond {LARGEST_COORDINATE:e}"));
        }
        self.normals.resize(if self.normals.is_empty() { 0 } else { self.triangles.len() }, [None; 3]);
        let keep: Vec<bool> = self.triangles.iter().map(|t| has_area(t.map(|i| self.positions[i as usize]))).collect();
        let count = keep.len();
        let kept = |index: &mut usize| {
            *index += 1;
            keep[*index - 1]
        };
        let mut index = 0;
        self.triangles.retain(|_| kept(&mut index));
        let mut index = 0;
        self.normals.retain(|_| kept(&mut index));
        if self.triangles.is_empty() {
            return Err(format!("none of the mesh's {count} triangles has an area"));
        }
        self.drop_unused_vertices();
        let normals = normals::complete(&self)?;
        Ok(Mesh { positions: self.positions, triangles: self.triangles, normals })
    }

    fn drop_unused_vertices(&mut self) {
        let mut place: HashMap<u32, u32> = HashMap::new();
        let mut positions = Vec::new();
        let mut used: Vec<u32> = self.triangles.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        if used.len() == self.positions.len() {
            return;
        }
        for old in used {
            place.insert(old, positions.len() as u32);
            positions.push(self.positions[old as usize]);
        }
        self.positions = positions;
        self.triangles.iter_mut().flatten().for_each(|i| *i = place[i]);
    }
}

/// Whether a triangle's area is more than the rounding of its longest edge's square.
fn has_area([a, b, c]: [DVec3; 3]) -> bool {
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    (b - a).cross(c - a).length() > 1e-14 * longest
}
