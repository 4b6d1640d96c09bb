use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use rayon::prelude::*;

use super::pass::{BoundPass, Grid, Parameters, PointPass};
use super::{Gpu, GpuError, Sample, ShaderText};
use crate::light::{Constant, Environment, Light, LightShape};
use crate::math::{Rgb, Vector3};
use crate::probe::{ProbeDevice, TraceTask};
use crate::rig::LocalPoints;
use crate::scene::binary_bvh;
use crate::trace::{
    Arrival, Bounces, Counters, Effects, Effort, Estimate, Gather, LightChoice, Origin, Projected, ProjectionGather,
    TracedGeometry, Transport,
};

/// Rows of the header, of a triangle, of a light.
const HEADER_ROWS: usize = 4;
const TRIANGLE_ROWS: usize = 5;
pub(super) const LIGHT_ROWS: usize = 4;
const MAP_ROWS: usize = 3;
/// Rows of the grid by which lights are chosen, before its table.
const CHOICE_ROWS: usize = 3;
/// The kinds of a rectangle's or polygon's triangles and of environment maps among the lights.
const KIND_TRIANGLE: u32 = 2;
pub(super) const KIND_MAP: u32 = 6;
/// Rows that a path writes.
const ARRIVAL_ROWS: usize = 7;
/// As for the CPU's rays: 32 roundings of the largest coordinate.
const EPSILON: f32 = 32.0 * f32::EPSILON;
/// Nodes that the shader's stack holds.
const STACK: usize = 48;
/// Paths of one run: 60 MB of arrivals.
const MOST_PATHS: usize = 1 << 19;
/// The number of a path is kept in an f32.
const MOST_SAMPLES: u64 = 1 << 24;
/// Paths that every probe gets before its error is believed.
const FIRST_ROUND: u64 = 1024;
/// Errors are judged against at least this share of the mean over the probes, as the CPU's are.
const DARK_SHARE: f64 = 0.01;
/// No distance that a ray found is so large.
const NO_HIT: f64 = 2.9e38;

/// A static environment under lights, on the device: path tracing of light to probes in compute, next-event estimation to the lights
/// (environment maps among them, by texel) and to emissive geometry, diffuse bounces with Russian roulette. The CPU gathers what
/// arrives: SH and its derivatives, in f64.
///
/// It is the twin of [`crate::trace::Transport`]: other random numbers and f32, the same expectation.
pub struct ProbeTracer {
    gpu: Gpu,
    pass: PointPass,
    scene: wgpu::Buffer,
    origin: DVec3,
    /// Metres within which a surface is touched: there its derivatives are left out, as on the CPU.
    touch: f64,
    /// Unit normals of the triangles, in the shader's order.
    normals: Vec<DVec3>,
    lights: Vec<DrawnLight>,
    /// Lights without extent: a probe on one leaves it out.
    pointlike: Vec<Light<f64>>,
}

/// How samples of a light change with the probe's place.
#[derive(Clone, Copy, Debug)]
enum DrawnLight {
    /// By the cone that it fills; centre in the world.
    Sphere { center: DVec3, radius: f64 },
    /// By places on it; its normal.
    Flat(DVec3),
    /// By places without a surface.
    Line,
    /// By directions.
    Distant,
}

/// SH radiance at a probe, W sr^-1 m^-2, with its standard error, and what its directions saw.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeEstimate {
    pub light: Estimate<Projected>,
    /// Of the surfaces around it, by directions drawn over the sphere, metres; infinite where none is seen, or none is looked for.
    pub harmonic_mean: f64,
    pub minimum: f64,
}

impl ProbeTracer {
    /// Refuses scenes whose tree the adapter cannot bind.
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
        let normal = |source: &u32| {
            let [a, b, c] = traced.triangles[*source as usize];
            (b - a).cross(c - a).normalize()
        };
        Ok(Self {
            gpu: gpu.clone(),
            pass,
            scene,
            origin: packed.origin,
            touch: f64::from(16.0 * EPSILON * packed.half_diagonal),
            normals: packed.sources.iter().map(normal).collect(),
            lights: packed.drawn,
            pointlike: lights.iter().filter(|l| matches!(l, Light::Point(_) | Light::Tube(_))).cloned().collect(),
        })
    }

    /// The environment, lights and effects of a transport.
    pub fn of_transport(gpu: &Gpu, transport: &Transport, seed: u64) -> Result<Self, GpuError> {
        let mut lights = transport.lights().to_vec();
        lights.push(Light::Constant(Constant { radiance: transport.surroundings() }));
        Self::new(gpu, transport.tracer().geometry(), &lights, transport.effects(), seed)
    }

    /// SH of an order at places, with derivatives along x, y and z where `gradient` says so. A path's random numbers hang on its place,
    /// its number and the seed alone: with so many samples, the same bits in any order and company.
    pub fn trace(
        &self,
        places: &[DVec3],
        order: usize,
        gradient: bool,
        effort: Effort,
    ) -> Result<Vec<ProbeEstimate>, GpuError> {
        crate::with_order!(order, C => self.trace_of_order(places, &ProjectionGather::<C> { gradient, touch: self.touch }, effort))
    }

    fn trace_of_order<const C: usize>(
        &self,
        places: &[DVec3],
        gather: &ProjectionGather<C>,
        effort: Effort,
    ) -> Result<Vec<ProbeEstimate>, GpuError> {
        let (first, most) = match effort {
            Effort::Samples(samples) => (samples.max(1), samples.max(1)),
            Effort::Error { most_samples, .. } => (FIRST_ROUND.min(most_samples.max(1)), most_samples.max(1)),
        };
        if first > MOST_SAMPLES {
            return Err(GpuError::TooLarge { what: "the paths a probe", needed: first, limit: MOST_SAMPLES });
        }
        let mut sums: Vec<Sums> = places.iter().map(|place| Sums::new(*place, gather.width())).collect();
        let mut open: Vec<usize> = (0..places.len()).collect();
        let mut more = first as usize;
        loop {
            self.advance(&mut sums, &open, more, gather)?;
            let Effort::Error { relative, deadline, .. } = effort else { break };
            if deadline.is_some_and(|deadline| std::time::Instant::now() >= deadline) {
                break;
            }
            let mean: [f64; 3] =
                std::array::from_fn(|c| sums.iter().map(|s| s.mean(c).abs()).sum::<f64>() / sums.len().max(1) as f64);
            let is_good = |sums: &Sums| {
                (0..gather.tested()).all(|k| {
                    let allowed = relative * sums.mean(k % 3).abs().max(DARK_SHARE * mean[k % 3]);
                    sums.error(k) <= allowed
                })
            };
            let limit = most.min(MOST_SAMPLES) as usize;
            open.retain(|place| sums[*place].samples < limit && !is_good(&sums[*place]));
            let Some(taken) = open.iter().map(|place| sums[*place].samples).max() else { break };
            more = taken.min(limit - taken);
        }
        Ok(sums.into_iter().map(|sums| sums.estimate(C, self)).collect())
    }

    /// So many more paths to each of some probes.
    fn advance<const C: usize>(
        &self,
        sums: &mut [Sums],
        chosen: &[usize],
        more: usize,
        gather: &ProjectionGather<C>,
    ) -> Result<(), GpuError> {
        let paths = chosen.len() * more;
        for first in (0..paths).step_by(MOST_PATHS) {
            let range = first..(first + MOST_PATHS).min(paths);
            let numbered = |path: usize| {
                let sums = &sums[chosen[path / more]];
                (sums.place, sums.before + path % more)
            };
            let mut bound = self.bind(range.clone().map(numbered))?;
            bound.run()?;
            let rows = bound.result()?;
            // each probe's arrivals of this run, in their order
            let mut tasks: Vec<(usize, &mut Sums)> = Vec::new();
            for (index, sums) in sums.iter_mut().enumerate() {
                if let Ok(at) = chosen.binary_search(&index) {
                    tasks.push((at, sums));
                }
            }
            tasks.into_par_iter().for_each(|(at, sums)| {
                let from = (at * more).max(range.start);
                let to = ((at + 1) * more).min(range.end);
                if from < to {
                    let own = &rows[(from - range.start) * ARRIVAL_ROWS..(to - range.start) * ARRIVAL_ROWS];
                    own.chunks_exact(ARRIVAL_ROWS).for_each(|path| sums.add(path, self, gather));
                }
            });
        }
        chosen.iter().for_each(|index| sums[*index].before += more);
        Ok(())
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

    /// How light that was drawn on one of the layout's lights changes with the probe's place.
    fn from_light(&self, light: usize, place: DVec3, w: DVec3, distance: f64, weight: Rgb<f64>) -> Origin {
        match self.lights[light] {
            DrawnLight::Distant => Origin::Distant,
            DrawnLight::Flat(normal) => Origin::Surface { distance, normal, drawn: true },
            // the place stays: its direction turns, the weight goes with 1/distance^2
            DrawnLight::Line => Origin::Drawn {
                direction_slopes: DVec3::AXES.map(|axis| (w * w.dot(axis) - axis) / distance),
                weight_slopes: DVec3::AXES.map(|axis| weight * (2.0 * w.dot(axis) / distance)),
            },
            DrawnLight::Sphere { center, radius } => cone_slopes(center - place, radius, w, weight),
        }
    }
}

impl ProbeDevice for ProbeTracer {
    fn trace(&self, places: &[DVec3], task: TraceTask) -> Result<Vec<Estimate<Projected>>, String> {
        let found = ProbeTracer::trace(self, places, task.order, task.gradient, task.effort);
        Ok(found.map_err(|error| error.to_string())?.into_iter().map(|estimate| estimate.light).collect())
    }
}

/// How a direction within the cone that a sphere fills changes, a metre of the probe along x, y and z, when its share of the cone's height
/// and its azimuth stay; and its weight, which goes with the cone's solid angle 2 pi h, h = 1 - sqrt(1 - (radius/distance)^2).
fn cone_slopes(to: DVec3, radius: f64, w: DVec3, weight: Rgb<f64>) -> Origin {
    let distance = to.length();
    let s2 = (radius / distance).powi(2);
    if s2 >= 1.0 {
        return Origin::Distant; // from within, directions are drawn over the whole sphere
    }
    let axis = to / distance;
    let root = (1.0 - s2).sqrt();
    let height = s2 / (1.0 + root);
    let z = w.dot(axis).min(1.0);
    let r = ((1.0 - z) * (1.0 + z)).sqrt();
    let across = (w - axis * z).normalize_or_zero();
    let slope_of_height = -s2 / (distance * root);
    let (mut direction_slopes, mut weight_slopes) = ([DVec3::ZERO; 3], [Rgb::zero(); 3]);
    for (k, moved) in DVec3::AXES.into_iter().enumerate() {
        let along = axis.dot(moved);
        let turn = axis.cross((axis * along - moved) / distance);
        let growth = -along * slope_of_height;
        let drop = -(1.0 - z) / height * growth;
        let widening = if r > 0.0 { -z * drop / r } else { 0.0 };
        direction_slopes[k] = turn.cross(w) + axis * drop + across * widening;
        weight_slopes[k] = weight * (growth / height);
    }
    Origin::Drawn { direction_slopes, weight_slopes }
}

/// Sums over a probe's paths.
#[derive(Clone)]
struct Sums {
    place: DVec3,
    value: Vec<f64>,
    square: Vec<f64>,
    /// Of one path.
    path: Vec<f64>,
    samples: usize,
    /// Paths of the rounds before.
    before: usize,
    inverse_depth: f64,
    least_depth: f64,
    counters: Counters,
}

impl Sums {
    fn new(place: DVec3, width: usize) -> Self {
        let zeros = vec![0.0; width];
        Self {
            place,
            value: zeros.clone(),
            square: zeros.clone(),
            path: zeros,
            samples: 0,
            before: 0,
            inverse_depth: 0.0,
            least_depth: f64::INFINITY,
            counters: Counters::default(),
        }
    }

    /// One path: its three arrivals together are one sample of the SH vector.
    fn add<const C: usize>(&mut self, path: &[[f32; 4]], tracer: &ProbeTracer, gather: &ProjectionGather<C>) {
        self.samples += 1;
        self.path.fill(0.0);
        for (source, rows) in path[..6].chunks_exact(2).enumerate() {
            let [x, y, z, from] = rows[0].map(f64::from);
            let [r, g, b, distance] = rows[1].map(f64::from);
            let (direction, weight) = (DVec3::new(x, y, z), Rgb::new(r, g, b));
            if source == 2 && from >= 0.0 {
                self.inverse_depth += 1.0 / distance;
                self.least_depth = self.least_depth.min(distance);
            }
            // at a singular place the term is dropped
            if !(weight.max_abs() > 0.0 && weight.is_finite()) {
                continue;
            }
            let origin = match source {
                _ if !gather.gradient || from < 0.0 || distance > NO_HIT => Origin::Distant,
                0 => tracer.from_light(from as usize, self.place, direction, distance, weight),
                _ => {
                    let normal = tracer.normals[from as usize];
                    let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
                    Origin::Surface { distance, normal, drawn: source == 1 }
                }
            };
            gather.add(&mut self.path, &Arrival { direction, weight, origin }, &mut self.counters);
        }
        for (k, sample) in self.path.iter().enumerate() {
            self.value[k] += sample;
            self.square[k] += sample * sample;
        }
        let [closest, shadow, bounces, emitters] = path[6].map(|count| count as u64);
        self.counters.closest_rays += closest;
        self.counters.shadow_rays += shadow;
        self.counters.bounces += bounces;
        self.counters.emitter_samples += emitters;
    }

    fn mean(&self, k: usize) -> f64 {
        self.value[k] / self.samples as f64
    }

    /// Standard error of a mean; infinite where one path alone was taken.
    fn error(&self, k: usize) -> f64 {
        let count = self.samples as f64;
        let variance = self.square[k] / count - self.mean(k).powi(2);
        if self.samples > 1 { (variance.max(0.0) / (count - 1.0)).sqrt() } else { f64::INFINITY }
    }

    fn estimate(self, coefficients: usize, tracer: &ProbeTracer) -> ProbeEstimate {
        let numbers = |of: &dyn Fn(usize) -> f64| (0..self.value.len()).map(of).collect::<Vec<f64>>();
        let read = |numbers: Vec<f64>| Projected::from_numbers(&numbers, coefficients);
        let singular = tracer.pointlike.iter().map(|light| light.projection::<1>(Vector3::of(self.place)).singular);
        ProbeEstimate {
            light: Estimate {
                value: read(numbers(&|k| self.mean(k))),
                standard_error: read(numbers(&|k| self.error(k))),
                samples: self.samples as u64,
                singular: singular.sum(),
                counters: self.counters,
            },
            harmonic_mean: self.samples as f64 / self.inverse_depth,
            minimum: self.least_depth,
        }
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
    /// What each light of the rows is.
    drawn: Vec<DrawnLight>,
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
            .with_count("STACK", STACK as u32)
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
        // a ray puts aside one node at each inner level
        let tree = binary_bvh(&boxes, STACK + 1);
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
        let mut kinds = Vec::new();
        let mut maps = Vec::new();
        let mut parts = Vec::new();
        for light in lights {
            let before = kinds.len();
            match light {
                Light::Constant(constant) => {
                    surroundings += constant.radiance;
                    continue;
                }
                Light::Environment(environment) => {
                    pack_map_light(environment, maps.len() as u32, &mut rows, &mut kinds);
                    maps.push(environment);
                }
                light => pack_light(light, origin, &mut rows, &mut kinds),
            }
            parts.push(rows[first_light + LIGHT_ROWS * before..].chunks_exact(LIGHT_ROWS).map(size_of_part).collect());
        }
        let count = (rows.len() - first_light) / LIGHT_ROWS;
        let first_map = rows.len();
        rows.resize(first_map + MAP_ROWS * maps.len(), [0.0; 4]);
        for (index, environment) in maps.iter().enumerate() {
            pack_map(environment, first_map + MAP_ROWS * index, &mut rows);
        }
        let choosing: Vec<Light<f64>> = lights.iter().filter(|l| !matches!(l, Light::Constant(_))).cloned().collect();
        let choice = LightChoice::new(&choosing, (!geometry.triangles.is_empty()).then_some((min, max)));
        let first_choice = pack_choice(&choice, &parts, origin, &mut rows);
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
        rows[3] = [first_map as u32, maps.len() as u32, first_choice as u32, 0].map(f32::from_bits);
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
            drawn: kinds,
        })
    }
}

/// Four rows a light: place and kind; two rows of its shape; radiance, intensity or irradiance.
fn pack_light(light: &Light<f64>, origin: DVec3, rows: &mut Vec<[f32; 4]>, kinds: &mut Vec<DrawnLight>) {
    let about = |p: Vector3<f64>| (p.to_double() - origin).as_vec3();
    let mut push = |kind: u32, drawn, a: glam::Vec3, b: [f32; 4], c: [f32; 4], strength: Rgb<f64>| {
        let [r, g, blue] = strength.to_array().map(|v| v as f32);
        rows.extend([a.extend(f32::from_bits(kind)).to_array(), b, c, [r, g, blue, 0.0]]);
        kinds.push(drawn);
    };
    let none = [0.0; 4];
    // triangles about the first corner, each a light of its own
    let mut fan = |corners: &[DVec3], radiance: Rgb<f64>| {
        for pair in corners[1..].windows(2) {
            let edge = |p: DVec3| (p - corners[0]).as_vec3().extend(0.0).to_array();
            let normal = (pair[0] - corners[0]).cross(pair[1] - corners[0]).normalize_or_zero();
            let drawn = DrawnLight::Flat(normal);
            push(KIND_TRIANGLE, drawn, (corners[0] - origin).as_vec3(), edge(pair[0]), edge(pair[1]), radiance);
        }
    };
    let direction = |v: Vector3<f64>| v.to_double().as_vec3();
    match light {
        Light::Sphere(sphere) => {
            let drawn = DrawnLight::Sphere { center: sphere.center.to_double(), radius: sphere.radius };
            push(0, drawn, about(sphere.center), [sphere.radius as f32, 0.0, 0.0, 0.0], none, sphere.radiance);
        }
        Light::Disk(disk) => {
            let b = direction(disk.normal).extend(disk.radius as f32).to_array();
            push(1, DrawnLight::Flat(disk.normal.to_double()), about(disk.center), b, none, disk.radiance);
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
            let to = about(tube.to).extend(0.0).to_array();
            push(3, DrawnLight::Line, about(tube.from), to, none, tube.intensity);
        }
        Light::Point(point) => push(4, DrawnLight::Line, about(point.position), none, none, point.intensity),
        Light::Directional(sun) => push(5, DrawnLight::Distant, direction(sun.towards), none, none, sun.irradiance),
        Light::Constant(_) | Light::Environment(_) => unreachable!("what is infinitely far is no light that is drawn"),
    }
}

/// A light by the number of its map, with the map's power. None where the map is black: there is nothing to draw.
fn pack_map_light(environment: &Environment<f64>, number: u32, rows: &mut Vec<[f32; 4]>, kinds: &mut Vec<DrawnLight>) {
    let power = environment.map().cumulative_power().1.last().map_or(0.0, |power| power * environment.scale()) as f32;
    if power > 0.0 {
        let [kind, number] = [KIND_MAP, number].map(f32::from_bits);
        rows.extend([[0.0, 0.0, 0.0, kind], [number, 0.0, 0.0, 0.0], [0.0; 4], [power, power, power, 0.0]]);
        kinds.push(DrawnLight::Distant);
    }
}

/// How large a part a light's rows are of it: of the triangles of a rectangle or polygon their area, of other lights all.
fn size_of_part(rows: &[[f32; 4]]) -> f64 {
    let [x, y] = [rows[1], rows[2]].map(|[x, y, z, _]| DVec3::new(x.into(), y.into(), z.into()));
    if rows[0][3].to_bits() == KIND_TRIANGLE { x.cross(y).length() } else { 1.0 }
}

/// The grid's least corner, cells a metre, and cells along the axes; then, cell by cell, the probability of all lights up to each. `parts`
/// are the sizes of the parts that each light was cut into. Says where it begins; 0 where there is nothing to choose.
fn pack_choice(choice: &LightChoice, parts: &[Vec<f64>], origin: DVec3, rows: &mut Vec<[f32; 4]>) -> usize {
    if choice.cells.contains(&0) || parts.iter().all(Vec::is_empty) {
        return 0;
    }
    let first = rows.len();
    let cells = choice.cells.map(|count| f32::from_bits(count as u32));
    let [x, y] = [choice.min - origin, choice.density].map(|v| v.as_vec3().extend(0.0).to_array());
    rows.extend([x, y, [cells[0], cells[1], cells[2], 0.0]]);
    debug_assert_eq!(rows.len(), first + CHOICE_ROWS);
    for shares in choice.shares() {
        // what is not drawn (a black map) has no part, and leaves its share to the others
        let whole: f64 = shares.iter().zip(parts).filter(|(_, parts)| !parts.is_empty()).map(|(share, _)| share).sum();
        let mut sum = 0.0;
        for (share, parts) in shares.iter().zip(parts) {
            let size: f64 = parts.iter().sum();
            for part in parts {
                sum += share / whole * if size > 0.0 { part / size } else { 1.0 / parts.len() as f64 };
                rows.push([sum as f32, 0.0, 0.0, 0.0]);
            }
        }
        let last = rows.len() - 1;
        rows[last][0] = 1.0;
    }
    first
}

/// Three rows of the rotation to the map, each with one of the map's width, height and first row of its table. The table: of each row
/// of texels the share of the map's power up to it, and where it begins and ends as squared sines of half the angles from the nearer
/// pole, with that pole's sign; then the texels, each with the share of its row's power up to it.
fn pack_map(environment: &Environment<f64>, at: usize, rows: &mut Vec<[f32; 4]>) {
    let map = environment.map();
    let (width, height) = map.size();
    let turn = environment.map_from_world();
    let numbers = [width, height, rows.len()].map(|number| f32::from_bits(number as u32));
    for (axis, number) in numbers.into_iter().enumerate() {
        rows[at + axis] = turn.row(axis).as_vec3().extend(number).to_array();
    }
    let (within, above) = map.cumulative_power();
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole) as f32 } else { 0.0 };
    for (row, power) in above.iter().enumerate() {
        let (from_pole, side) = if 2 * row < height { (row, 1.0) } else { (height - 1 - row, -1.0) };
        let edge = |row: usize| (0.5 * std::f64::consts::PI * row as f64 / height as f64).sin().powi(2) as f32;
        rows.push([share(*power, above[height - 1]), edge(from_pole), edge(from_pole + 1), side]);
    }
    let scale = environment.scale();
    for (texels, within) in map.texels().chunks_exact(width).zip(within.chunks_exact(width)) {
        for (texel, power) in texels.iter().zip(within) {
            let [r, g, b] = texel.map(|radiance| (f64::from(radiance) * scale) as f32);
            rows.push([r, g, b, share(*power, within[width - 1])]);
        }
    }
}
