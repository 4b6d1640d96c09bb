//! Scenes and light layouts: files, meshes, transforms, camera, surface points.

mod area;
mod bounds;
mod bvh;
mod camera;
mod file;
mod finder;
mod layout;
mod mesh;
mod motion;
mod pixels;
mod random;
mod receiver;
mod resolve;
mod shape;
mod transform;

pub use bounds::OrientedBox;
pub use bvh::{binary_bvh, wide_bvh};
pub use camera::{Camera, Raster};
pub use file::{PathFile, Scene, SceneFile};
pub use finder::SurfaceFinder;
pub use layout::{Layout, LayoutInstance, NamedLight};
pub use mesh::{MESH_EXTENSIONS, Mesh};
pub use motion::MotionPath;
pub use pixels::{PixelHit, Pixels, View};
pub use random::{RandomKind, RandomLayouts};
pub use receiver::{Material, Receiver, StaticObject};
pub use resolve::{resolve_layout, resolve_scene, root};
pub use shape::Shape;
pub use transform::Transform;

use glam::DVec3;

/// A point of a surface with its unit shading normal, world coordinates, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    pub position: DVec3,
    pub normal: DVec3,
}
