use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::PlocBuilder;
use rayon::prelude::*;

use super::pass::{BoundPass, Grid, Parameters, PointPass};
use super::{Gpu, GpuError, Sample, ShaderText};
use crate::light::{Environment, Light};
use crate::math::{Rgb, Vector3};
use crate::rig::LocalPoints;
use crate::sh::{basis, coefficients};
use crate::trace::{Bounces, Effects, TracedGeometry};

/// Rows of the header, of a triangle, of a light.
const HEADER_ROWS: usize = 4;
const TRIANGLE_ROWS: usize = 5;
pub(super) const LIGHT_ROWS: usize = 4;
const MAP_ROWS: usize = 3;
/// Rows that a path writes.
const ARRIVAL_ROWS: usize = 6;
/// As for the CPU's rays: 32 roundings of the largest coordinate.
const EPSILON: f32 = 32.0 * f32::EPSILON;
/// Levels of the tree that the shader's stack holds.
const DEEPEST: usize = 32;
/// Paths of one run: 100 MB of arrivals.
const MOST_PATHS: usize = 1 << 20;
/// The number of a path is kept in an f32.
const MOST_SAMPLES: u64 = 1 << 24;

/// A static environment under lights, on the device: path tracing of light to probes in compute, next-event estimation to the lights
/// and to emissive geometry, diffuse bounces with Russian roulette.
///
/// It is the twin of [`crate::trace::Transport`]: other random numbers and f32, the same expectation.
pub struct ProbeTracer {
    gpu: Gpu,
    pass: PointPass,
    scene: wgpu::Buffer,
    origin: DVec3,
}

/// SH radiance at a probe, W sr^-1 m^-2: an estimate with its standard error, a row of channels a coefficient.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeEstimate {
    pub value: Vec<Rgb<f64>>,
    pub standard_error: Vec<Rgb<f64>>,
}

impl ProbeTracer {
    /// Refuses trees deeper than its stack. Environment maps are met by the rays that miss everything, and not drawn from.
    pub fn new(
        gpu: &Gpu,
        geometry: &TracedGeometry,
        lights: &[Light<f64>],
        effects: Effects,
        seed: u64,
    ) -> Result<Self, GpuError> {
        Self::with_model(gpu, geometry, lights, effects, seed, include_str!("passes/trace_probes.wgsl"))
    }

    /// With another text than the shader's own: for tests that break it.
    pub fn with_model(
        gpu: &Gpu,
        geometry: &TracedGeometry,
        lights: &[Light<f64>],
        effects: Effects,
        seed: u64,
        model: &str,
    ) -> Result<Self, GpuError> {
        let traced = match effects == Effects::NONE {
            true => &TracedGeometry::default(),
            false => geometry,
        };
        let packed = Packed::new(traced, lights, effects, seed)?;
        let text = packed.text().with(model);
        let grid = Grid { rows_a_point: ARRIVAL_ROWS as u32, ..Grid::THREAD_A_POINT };
        let pass = PointPass::new(gpu, "trace_probes", text, Parameters::Buffer, grid)?;
        let scene = gpu.checked("uploading the scene", || {
            gpu.storage("the buffer of the scene", bytemuck::cast_slice(&packed.rows))
        })?;
        Ok(Self { gpu: gpu.clone(), pass, scene, origin: packed.origin })
    }

    /// SH of an order at places, from so many paths each. A path's random numbers hang on its place, its number and the seed alone:
    /// the same bits in any order and company.
    pub fn trace(&self, places: &[DVec3], order: usize, samples: u64) -> Result<Vec<ProbeEstimate>, GpuError> {
        if samples > MOST_SAMPLES {
            return Err(GpuError::TooLarge { what: "the paths a probe", needed: samples, limit: MOST_SAMPLES });
        }
        let samples = samples as usize;
        let mut sums = vec![Sums::zero(coefficients(order)); places.len()];
        let paths = places.len() * samples;
        for first in (0..paths).step_by(MOST_PATHS) {
            let range = first..(first + MOST_PATHS).min(paths);
            let mut bound = self.bind(range.clone().map(|path| (places[path / samples], path % samples)))?;
            bound.run()?;
            let rows = bound.result()?;
            // each probe's arrivals of this run, in their order
            let probes = range.start / samples..(range.end - 1) / samples + 1;
            sums[probes.clone()].par_iter_mut().zip(probes).for_each(|(sums, probe)| {
                let from = (probe * samples).max(range.start) - range.start;
                let to = ((probe + 1) * samples).min(range.end) - range.start;
                rows[from * ARRIVAL_ROWS..to * ARRIVAL_ROWS].chunks_exact(ARRIVAL_ROWS).for_each(|path| sums.add(path));
            });
        }
        Ok(sums.into_iter().map(|sums| sums.estimate(samples as f64)).collect())
    }

    /// Time of one run of paths, everything on the device: for benches.
    pub fn sample(&self, places: &[DVec3], samples: usize) -> Result<Sample, GpuError> {
        let paths = places.iter().flat_map(|place| (0..samples).map(move |number| (*place, number)));
        self.bind(paths)?.sample()
    }

    fn bind(&self, paths: impl Iterator<Item = (DVec3, usize)>) -> Result<BoundPass, GpuError> {
        let mut points = LocalPoints::default();
        paths.for_each(|(place, number)| points.push(place - self.origin, DVec3::X * number as f64));
        debug_assert!(!self.gpu.is_lost());
        self.pass.bind(&points, points.len(), &[self.scene.as_entire_binding()])
    }
}

/// Sums over a probe's paths.
#[derive(Clone)]
struct Sums {
    value: Vec<Rgb<f64>>,
    square: Vec<Rgb<f64>>,
}

impl Sums {
    fn zero(coefficients: usize) -> Self {
        Self { value: vec![Rgb::zero(); coefficients], square: vec![Rgb::zero(); coefficients] }
    }

    /// One path: its three arrivals together are one sample of the SH vector.
    fn add(&mut self, path: &[[f32; 4]]) {
        let mut sample = [Rgb::zero(); 36];
        for arrival in path.chunks_exact(2) {
            let weight = Rgb::new(arrival[1][0], arrival[1][1], arrival[1][2]).to_double();
            if weight.max_abs() > 0.0 {
                let direction = Vector3::new(arrival[0][0], arrival[0][1], arrival[0][2]).to_double();
                let y = basis::<f64, 36>(Vector3::of(direction));
                for (sum, y) in sample.iter_mut().zip(y).take(self.value.len()) {
                    *sum += weight * y;
                }
            }
        }
        for ((value, square), sample) in self.value.iter_mut().zip(&mut self.square).zip(sample) {
            *value += sample;
            *square += sample * sample;
        }
    }

    fn estimate(self, samples: f64) -> ProbeEstimate {
        let value: Vec<Rgb<f64>> = self.value.iter().map(|sum| *sum * (1.0 / samples)).collect();
        let error = |(mean, square): (&Rgb<f64>, &Rgb<f64>)| {
            let variance = (*square * (1.0 / samples) - *mean * *mean) * (1.0 / (samples - 1.0).max(1.0));
            Rgb::from_array(variance.to_array().map(|v| v.max(0.0).sqrt()))
        };
        let standard_error = value.iter().zip(&self.square).map(error).collect();
        ProbeEstimate { value, standard_error }
    }
}

/// The scene as rows of four numbers, and where its parts begin.
pub(super) struct Packed {
    pub rows: Vec<[f32; 4]>,
    pub origin: DVec3,
    pub half_diagonal: f32,
    nodes: usize,
    pub triangles: usize,
    emitters: usize,
    pub lights: usize,
    pub light_count: usize,
    /// Sources of the triangles, in their order here.
    pub sources: Vec<u32>,
}

impl Packed {
    /// The points and the constants that trace_probes.wgsl wants before it.
    pub fn text(&self) -> ShaderText {
        ShaderText::new()
            .with_points()
            .with_count("NODES", self.nodes as u32)
            .with_count("TRIANGLES", self.triangles as u32)
            .with_count("EMITTERS", self.emitters as u32)
            .with_count("LIGHTS", self.lights as u32)
            .with_count("TRIANGLE_ROWS", TRIANGLE_ROWS as u32)
            .with_number("EPSILON", EPSILON)
            .with_number("EDGE", 8.0 * f32::EPSILON)
            .with_number("HALF_DIAGONAL", self.half_diagonal)
    }

    pub fn new(
        geometry: &TracedGeometry,
        lights: &[Light<f64>],
        effects: Effects,
        seed: u64,
    ) -> Result<Self, GpuError> {
        let corners = geometry.triangles.iter().flatten();
        let (min, max) =
            corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), p| (min.min(*p), max.max(*p)));
        let (origin, half_diagonal) = match geometry.triangles.is_empty() {
            true => (DVec3::ZERO, 1.0),
            false => (0.5 * (min + max), 0.5 * (max - min).length()),
        };
        let about = |p: DVec3| (p - origin).as_vec3a();
        let boxes: Vec<Aabb> = geometry
            .triangles
            .iter()
            .map(|t| {
                let mut bounds = Aabb::from_points(&t.map(about));
                let padding = Vec3A::splat(half_diagonal as f32 * 16.0 * f32::EPSILON);
                bounds.min -= padding;
                bounds.max += padding;
                bounds
            })
            .collect();
        let tree = tree(&boxes)?;
        let mut rows = vec![[0.0f32; 4]; HEADER_ROWS];

        let nodes = rows.len();
        for node in &tree.nodes {
            let aabb = node.aabb();
            rows.push(aabb.min.extend(f32::from_bits(node.first_index)).to_array());
            rows.push(aabb.max.extend(f32::from_bits(node.prim_count)).to_array());
        }

        let triangles = rows.len();
        let mut drawn = Vec::new();
        let mut sum = 0.0;
        for (place, source) in tree.primitive_indices.iter().enumerate() {
            let (material, [a, b, c]) = (geometry.material(*source as usize), geometry.triangles[*source as usize]);
            let area = 0.5 * (b - a).cross(c - a).length();
            let strength = material.emission.r + material.emission.g + material.emission.b;
            if strength > 0.0 {
                sum += area * strength;
                drawn.push((sum, place));
            }
            let albedo = material.albedo.to_array().map(|v| v as f32);
            for (corner, albedo) in [about(a), (b - a).as_vec3a(), (c - a).as_vec3a()].into_iter().zip(albedo) {
                rows.push(corner.extend(albedo).to_array());
            }
            // the density over the area is known when all emitters are
            rows.push((b - a).cross(c - a).normalize().as_vec3().extend(strength as f32).to_array());
            let [r, g, b] = material.emission.to_array().map(|v| v as f32);
            rows.push([r, g, b, 0.0]);
        }
        for (_, place) in &drawn {
            rows[triangles + place * TRIANGLE_ROWS + 3][3] /= sum as f32;
        }

        let emitters = rows.len();
        rows.extend(drawn.iter().map(|(below, place)| [(below / sum) as f32, f32::from_bits(*place as u32), 0.0, 0.0]));

        let first_light = rows.len();
        let mut surroundings = Rgb::zero();
        let mut maps = Vec::new();
        for light in lights {
            match light {
                Light::Constant(constant) => surroundings += constant.radiance,
                Light::Environment(environment) => maps.push(environment),
                light => pack_light(light, origin, &mut rows),
            }
        }
        let count = (rows.len() - first_light) / LIGHT_ROWS;
        let first_map = rows.len();
        rows.resize(first_map + MAP_ROWS * maps.len(), [0.0; 4]);
        for (index, environment) in maps.iter().enumerate() {
            pack_map(environment, first_map + MAP_ROWS * index, &mut rows);
        }
        // a binding is not empty, and no index leaves it
        rows.push([0.0; 4]);

        let most = match effects.bounces {
            None => 0,
            Some(Bounces::Count(count)) => count,
            Some(Bounces::Infinite) => u32::MAX - 1,
        };
        let flags = u32::from(effects.shadows) | u32::from(effects.bounces.is_some()) << 1;
        rows[0][1] = f32::from_bits(geometry.triangles.len() as u32);
        rows[1] = [drawn.len() as u32, count as u32, most, flags].map(f32::from_bits);
        let [r, g, b] = surroundings.to_array().map(|v: f64| v as f32);
        rows[2] = [r, g, b, f32::from_bits((seed ^ (seed >> 32)) as u32)];
        rows[3] = [first_map as u32, maps.len() as u32, 0, 0].map(f32::from_bits);
        Ok(Self {
            rows,
            origin,
            light_count: count,
            half_diagonal: half_diagonal as f32,
            nodes,
            triangles,
            emitters,
            lights: first_light,
            sources: tree.primitive_indices,
        })
    }
}

/// A binary tree by obvhs, with all leaves within the reach of the shader's stack.
fn tree(boxes: &[Aabb]) -> Result<Bvh2, GpuError> {
    if boxes.is_empty() {
        return Ok(Bvh2::default());
    }
    let params = obvhs::BvhBuildParams::medium_build();
    let indices = (0..boxes.len() as u32).collect();
    let tree = PlocBuilder::with_capacity(boxes.len()).build(
        params.ploc_search_distance,
        boxes,
        indices,
        params.sort_precision,
        params.search_depth_threshold,
    );
    let mut deepest = 0;
    let mut waiting = vec![(0u32, 1usize)];
    while let Some((index, level)) = waiting.pop() {
        deepest = deepest.max(level);
        let node = &tree.nodes[index as usize];
        if node.prim_count == 0 {
            waiting.extend([(node.first_index, level + 1), (node.first_index + 1, level + 1)]);
        }
    }
    match deepest <= DEEPEST {
        true => Ok(tree),
        false => Err(GpuError::TooLarge {
            what: "the depth of the tree over the scene",
            needed: deepest as u64,
            limit: DEEPEST as u64,
        }),
    }
}

/// Four rows a light: place and kind; two rows of its shape; radiance, intensity or irradiance.
fn pack_light(light: &Light<f64>, origin: DVec3, rows: &mut Vec<[f32; 4]>) {
    let about = |p: Vector3<f64>| (p.to_double() - origin).as_vec3();
    let mut push = |kind: u32, a: glam::Vec3, b: [f32; 4], c: [f32; 4], strength: Rgb<f64>| {
        let [r, g, blue] = strength.to_array().map(|v| v as f32);
        rows.extend([a.extend(f32::from_bits(kind)).to_array(), b, c, [r, g, blue, 0.0]]);
    };
    let none = [0.0; 4];
    // triangles about the first corner, each a light of its own
    let mut fan = |corners: &[DVec3], radiance: Rgb<f64>| {
        for pair in corners[1..].windows(2) {
            let edge = |p: DVec3| (p - corners[0]).as_vec3().extend(0.0).to_array();
            push(2, (corners[0] - origin).as_vec3(), edge(pair[0]), edge(pair[1]), radiance);
        }
    };
    let direction = |v: Vector3<f64>| v.to_double().as_vec3();
    match light {
        Light::Sphere(sphere) => {
            push(0, about(sphere.center), [sphere.radius as f32, 0.0, 0.0, 0.0], none, sphere.radiance);
        }
        Light::Disk(disk) => {
            let b = direction(disk.normal).extend(disk.radius as f32).to_array();
            push(1, about(disk.center), b, none, disk.radiance);
        }
        Light::Rect(rect) => {
            let (center, [u, v]) = (rect.center().to_double(), rect.half_edges().map(|edge| edge.to_double()));
            fan(&[center - u - v, center + u - v, center + u + v, center - u + v], rect.front_radiance());
        }
        Light::Polygon(polygon) => {
            let corners: Vec<DVec3> = polygon.vertices().iter().map(|v| v.to_double()).collect();
            fan(&corners, polygon.front_radiance());
        }
        Light::Tube(tube) => {
            push(3, about(tube.from), about(tube.to).extend(0.0).to_array(), none, tube.intensity);
        }
        Light::Point(point) => push(4, about(point.position), none, none, point.intensity),
        Light::Directional(sun) => push(5, direction(sun.towards), none, none, sun.irradiance),
        Light::Constant(_) | Light::Environment(_) => unreachable!("what is infinitely far is no light that is drawn"),
    }
}

/// Three rows of the rotation to the map, each with one of the map's width, height and first texel; texels behind everything.
fn pack_map(environment: &Environment<f64>, at: usize, rows: &mut Vec<[f32; 4]>) {
    let (width, height) = environment.map().size();
    let turn = environment.map_from_world();
    let numbers = [width, height, rows.len()].map(|number| f32::from_bits(number as u32));
    for (axis, number) in numbers.into_iter().enumerate() {
        rows[at + axis] = turn.row(axis).as_vec3().extend(number).to_array();
    }
    let scale = environment.scale();
    let scaled = |texel: &[f32; 3]| texel.map(|radiance| (f64::from(radiance) * scale) as f32);
    rows.extend(environment.map().texels().iter().map(scaled).map(|[r, g, b]| [r, g, b, 0.0]));
}
