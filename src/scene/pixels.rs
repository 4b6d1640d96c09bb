//! What the camera sees: the points from which pictures come.

use std::borrow::Cow;
use std::ops::Range;

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use rayon::prelude::*;

use super::{Camera, Mesh, Scene, SurfacePoint, wide_bvh};

/// Half diagonal of the geometry in the coordinates of the f32 rays: obvhs takes boxes that end within 1e-4 units of
/// a ray's origin for missed, which must be nothing beside the scene.
const HALF_DIAGONAL: f64 = 1024.0;

/// Boxes are widened by this many units, 16 roundings of the largest coordinate: flat ones are met too.
const BOX_PADDING: f32 = HALF_DIAGONAL as f32 * f32::EPSILON * 16.0;

/// Triangles are widened by this fraction of their edges, 8 roundings: no ray slips through an edge that two share.
const EDGE_TOLERANCE: f32 = 8.0 * f32::EPSILON;

/// Pixels of a tile's side: rays of one tile meet the same nodes.
const TILE: usize = 8;

/// What a pixel's ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelHit {
    /// Row by row from the top left.
    pub pixel: u32,
    /// The shading normal of the side that the camera sees.
    pub point: SurfacePoint,
    pub albedo: [f64; 3],
    /// Which receiver of the scene; `None`: static environment.
    pub receiver: Option<u16>,
}

/// A picture's surface points, one ray through the middle of each pixel.
#[derive(Clone, Debug)]
pub struct Pixels {
    pub width: usize,
    pub height: usize,
    /// The pixels that see a surface, in their order.
    pub hits: Vec<PixelHit>,
}

impl Pixels {
    /// What the scene's camera sees in a frame; a scene without a camera shows nothing.
    pub fn cast(scene: &Scene, frame: usize, width: usize, height: usize) -> Self {
        match &scene.camera {
            Some(camera) => View::new(scene, frame).cast(camera, width, height),
            None => Self { width, height, hits: Vec::new() },
        }
    }
}

/// Receivers and static objects in one frame, ready for a camera's rays.
pub struct View {
    center: DVec3,
    /// Units a metre.
    scale: f64,
    bvh: CwBvh,
    /// In the order of the BVH's leaves: for its rays in f32, and to refine what they meet.
    leaves: Vec<RtTriangle>,
    triangles: Vec<VisibleTriangle>,
    surfaces: Vec<VisibleSurface>,
}

/// World coordinates, metres.
#[derive(Clone, Copy)]
struct VisibleTriangle {
    corner: DVec3,
    /// From that corner to the second and the third.
    edges: [DVec3; 2],
    normals: [DVec3; 3],
    surface: u32,
}

#[derive(Clone, Copy)]
struct VisibleSurface {
    albedo: [f64; 3],
    receiver: Option<u16>,
}

/// Distance along the ray, infinite for a miss (Möller and Trumbore 1997, in the form of obvhs's own triangle, with
/// tolerant edges). Either side is hit.
#[inline(always)]
fn intersect(triangle: &RtTriangle, ray: &Ray) -> f32 {
    let to = triangle.v0 - ray.origin;
    let turned = ray.direction.cross(to);
    let inverse = 1.0 / triangle.ng.dot(ray.direction);
    let u = turned.dot(triangle.e2) * inverse;
    let v = turned.dot(triangle.e1) * inverse;
    let distance = triangle.ng.dot(to) * inverse;
    // false for the NaN of an edge-on triangle
    let inside = u.min(v).min(1.0 - u - v) >= -EDGE_TOLERANCE;
    if inside && distance >= ray.tmin && distance <= ray.tmax { distance } else { f32::INFINITY }
}

impl View {
    pub fn new(scene: &Scene, frame: usize) -> Self {
        let receivers = scene.receivers.iter().zip(0u16..).filter_map(|(receiver, index)| {
            let surface = VisibleSurface { albedo: receiver.material.albedo, receiver: Some(index) };
            Some((Cow::Owned(receiver.world_mesh(frame)?), surface))
        });
        let statics = scene.statics.iter().map(|object| {
            let surface = VisibleSurface { albedo: object.material.albedo, receiver: None };
            (Cow::Borrowed(&object.mesh), surface)
        });
        let objects: Vec<(Cow<Mesh>, VisibleSurface)> = receivers.chain(statics).collect();
        let (min, max) = objects
            .iter()
            .map(|(mesh, _)| mesh.bounds())
            .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
            .unwrap_or((DVec3::ZERO, DVec3::ZERO));
        let center = 0.5 * (min + max);
        let half_diagonal = 0.5 * (max - min).length();
        let scale = if half_diagonal > 0.0 { (HALF_DIAGONAL / half_diagonal).log2().floor().exp2() } else { 1.0 };

        let mut triangles = Vec::new();
        for ((mesh, _), surface) in objects.iter().zip(0..) {
            for (index, normals) in mesh.normals.iter().enumerate() {
                let [a, b, c] = mesh.corners(index);
                triangles.push(VisibleTriangle { corner: a, edges: [b - a, c - a], normals: *normals, surface });
            }
        }
        let units = |p: DVec3| ((p - center) * scale).as_vec3a();
        let corners = |t: &VisibleTriangle| [t.corner, t.corner + t.edges[0], t.corner + t.edges[1]].map(units);
        let padded = |t: &VisibleTriangle| {
            let mut bounds = Aabb::from_points(&corners(t));
            bounds.min -= Vec3A::splat(BOX_PADDING);
            bounds.max += Vec3A::splat(BOX_PADDING);
            bounds
        };
        let boxes: Vec<Aabb> = triangles.iter().map(padded).collect();
        let bvh = wide_bvh(&boxes);
        let triangles: Vec<VisibleTriangle> = bvh.primitive_indices.iter().map(|i| triangles[*i as usize]).collect();
        let for_rays = |t: &VisibleTriangle| {
            let [a, b, c] = corners(t);
            RtTriangle::new(a, b, c)
        };
        Self {
            center,
            scale,
            bvh,
            leaves: triangles.iter().map(for_rays).collect(),
            triangles,
            surfaces: objects.into_iter().map(|(_, surface)| surface).collect(),
        }
    }

    /// One ray through the middle of each pixel, in parallel over bands of rows.
    pub fn cast(&self, camera: &Camera, width: usize, height: usize) -> Pixels {
        let raster = camera.raster(width, height);
        let [columns, rows_of_view] = self.window(camera, width, height);
        let origin = ((camera.eye - self.center) * self.scale).as_vec3a();
        let bands: Vec<[Vec<PixelHit>; TILE]> = (rows_of_view.start / TILE..rows_of_view.end.div_ceil(TILE))
            .into_par_iter()
            .map(|band| {
                let mut rows: [Vec<PixelHit>; TILE] = Default::default();
                for left in columns.clone().step_by(TILE) {
                    for (row, hits) in (band * TILE..height).zip(&mut rows) {
                        for column in left..(left + TILE).min(columns.end) {
                            let direction = raster.direction(column as f64 + 0.5, row as f64 + 0.5);
                            let ray = Ray::new_inf(origin, direction.as_vec3a());
                            hits.extend(self.look(&ray, camera.eye, direction, (row * width + column) as u32));
                        }
                    }
                }
                rows
            })
            .collect();
        let hits = bands.into_iter().flatten().collect::<Vec<_>>().concat();
        Pixels { width, height, hits }
    }

    /// Columns and rows outside of which no ray meets anything: around the corners of the box of everything, or all of them where
    /// a corner is not before the eye.
    fn window(&self, camera: &Camera, width: usize, height: usize) -> [Range<usize>; 2] {
        let bounds = self.bvh.total_aabb;
        let corner = |k: usize| {
            let side = |axis: usize| if k >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
            let p = DVec3::new(f64::from(side(0)), f64::from(side(1)), f64::from(side(2))) / self.scale + self.center;
            camera.seen_at(p, width, height)
        };
        match (0..8).map(corner).collect::<Option<Vec<[f64; 2]>>>() {
            _ if self.leaves.is_empty() => [0..0, 0..0],
            None => [0..width, 0..height],
            Some(corners) => [(0, width), (1, height)].map(|(axis, size)| {
                let least = corners.iter().fold(f64::INFINITY, |a, c| a.min(c[axis]));
                let most = corners.iter().fold(f64::NEG_INFINITY, |a, c| a.max(c[axis]));
                // a pixel's middle stands half a pixel in; one more for rounding
                let size = size as f64;
                (least - 1.5).clamp(0.0, size) as usize..(most + 1.5).clamp(0.0, size).ceil() as usize
            }),
        }
    }

    /// The first surface along a pixel's ray (of any length): found in f32, its place refined in f64 (Möller and Trumbore 1997).
    #[inline(always)]
    fn look(&self, ray: &Ray, eye: DVec3, direction: DVec3, pixel: u32) -> Option<PixelHit> {
        let mut hit = RayHit::none();
        if !self.bvh.ray_traverse(*ray, &mut hit, |ray, leaf| intersect(&self.leaves[leaf], ray)) {
            return None;
        }
        let VisibleTriangle { corner, edges: [ab, ac], normals, surface } = &self.triangles[hit.primitive_id as usize];
        let face = ab.cross(*ac);
        let facing = -face.dot(direction);
        let turned = (eye - *corner).cross(direction) / facing;
        let u = ac.dot(turned).clamp(0.0, 1.0);
        let v = (-ab.dot(turned)).clamp(0.0, 1.0 - u);
        let normal = normals[0] * (1.0 - u - v) + normals[1] * u + normals[2] * v;
        let side = if facing < 0.0 { -1.0 } else { 1.0 };
        // opposite corner normals cancel: the face's own normal stands in
        let normal = normal.try_normalize().unwrap_or_else(|| face.normalize()) * side;
        let VisibleSurface { albedo, receiver } = self.surfaces[*surface as usize];
        let point = SurfacePoint { position: *corner + *ab * u + *ac * v, normal };
        Some(PixelHit { pixel, point, albedo, receiver })
    }
}
