//! Scenes and light layouts: files, meshes, transforms, camera, surface points.

mod area;
mod bounds;
mod camera;
mod file;
mod mesh;
mod motion;
mod pixels;
mod receiver;
mod shape;
mod transform;

pub use bounds::OrientedBox;
pub use camera::Camera;
pub use file::{Scene, SceneFile};
pub use mesh::{MESH_EXTENSIONS, Mesh};
pub use motion::MotionPath;
pub use pixels::{PixelHit, Pixels, View};
pub use receiver::{Material, Receiver, StaticObject};
pub use shape::Shape;
pub use transform::Transform;

use glam::DVec3;

/// A point of a surface with its unit shading normal, world coordinates, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    pub position: DVec3,
    pub normal: DVec3,
}
