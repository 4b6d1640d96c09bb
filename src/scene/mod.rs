//! Scenes and light layouts: files, meshes, transforms, camera, surface points.

mod bounds;

pub use bounds::OrientedBox;

use glam::DVec3;

/// A point of a surface with its unit shading normal, world coordinates, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    pub position: DVec3,
    pub normal: DVec3,
}
