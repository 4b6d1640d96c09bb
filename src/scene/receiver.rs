use glam::{DAffine3, DVec3};

use super::{Mesh, MotionPath, OrientedBox, SurfacePoint, Transform, area};

/// What a surface answers to light.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    pub name: String,
    /// Reflected over incident flux, 0 to 1 a channel.
    pub albedo: [f64; 3],
    /// a of the wrap lobe, 0 to 1; 0 is Lambert.
    pub wrap: f64,
    /// Radiance of the front side, W sr^-1 m^-2.
    pub emission: [f64; 3],
}

impl Material {
    /// What an object has that names none, and a receiver without geometry.
    pub fn grey() -> Self {
        Self { name: "grey".to_owned(), albedo: [0.5; 3], wrap: 0.0, emission: [0.0; 3] }
    }
}

/// A dynamic object, lit by a rig; or bounds without geometry, for queries and volumes.
#[derive(Clone, Debug)]
pub struct Receiver {
    pub name: String,
    pub material: Material,
    /// Object space; `None` for bounds.
    pub mesh: Option<Mesh>,
    pub(super) transform: Transform,
    pub(super) path: Option<MotionPath>,
    /// Frames of the scene.
    pub(super) frames: usize,
    /// Smallest and largest object coordinates.
    pub(super) bounds: (DVec3, DVec3),
}

impl Receiver {
    /// Where the object stands in a frame: its transform, with the path's place for the translation.
    pub fn world_from_object(&self, frame: usize) -> DAffine3 {
        let mut transform = self.transform;
        if let Some(path) = &self.path {
            transform.translate = path.position(frame, self.frames);
        }
        transform.world_from_object()
    }

    /// Whether it moves from frame to frame.
    pub fn moves(&self) -> bool {
        self.path.is_some()
    }

    /// The bounding box in object space, carried by the transform: its x, y and z are the object's.
    pub fn oriented_box(&self, frame: usize) -> OrientedBox {
        let (min, max) = self.bounds;
        OrientedBox::aligned(min, max).carried(&self.world_from_object(frame))
    }

    /// The centre of its box at the k-th of `count` times that are spread evenly over the animation, the ends among them.
    pub fn center_along(&self, k: usize, count: usize) -> DVec3 {
        let mut transform = self.transform;
        if let Some(path) = &self.path {
            transform.translate = path.position(k, count);
        }
        let (min, max) = self.bounds;
        transform.world_from_object().transform_point3(0.5 * (min + max))
    }

    /// The mesh in world coordinates.
    pub fn world_mesh(&self, frame: usize) -> Option<Mesh> {
        self.mesh.as_ref().map(|mesh| mesh.transformed(&self.world_from_object(frame)))
    }

    /// Points spread evenly over the surface, world coordinates; the k-th is the same place of the object in every frame.
    /// None where there is no geometry.
    pub fn area_points(&self, frame: usize, count: usize) -> Vec<SurfacePoint> {
        self.world_mesh(frame).map_or_else(Vec::new, |mesh| area::area_points(&mesh, count))
    }

    pub fn vertex_count(&self) -> usize {
        self.mesh.as_ref().map_or(0, |mesh| mesh.positions.len())
    }
}

/// An object of the static environment.
#[derive(Clone, Debug)]
pub struct StaticObject {
    pub name: String,
    pub material: Material,
    /// World coordinates.
    pub mesh: Mesh,
}
