use crate::rig::LocalPoints;

/// One point as `SurfacePoint` of shaders/points.wgsl: two rows of 16 bytes.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct PackedPoint {
    q: [f32; 3],
    unused_q: f32,
    n: [f32; 3],
    unused_n: f32,
}

/// What one dispatch covers, as `Tile` of shaders/points.wgsl.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Tile {
    pub first: u32,
    pub end: u32,
}

/// The points, repeated from the first on until there are `total`.
pub(super) fn packed(points: &LocalPoints<f32>, total: usize) -> Vec<PackedPoint> {
    (0..points.len())
        .cycle()
        .take(total)
        .map(|i| PackedPoint { q: points.q(i).to_array(), unused_q: 0.0, n: points.n(i).to_array(), unused_n: 0.0 })
        .collect()
}
