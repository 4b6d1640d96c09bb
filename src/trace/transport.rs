use std::f64::consts::FRAC_1_PI;

use glam::DVec3;

use super::counters::{CastRay, Observer};
use super::effects::Effects;
use super::emitters::Emitters;
use super::gather::{Arrival, Gather, Origin, about};
use super::geometry::{TracedGeometry, TracedMaterial, doubled_area_vector};
use super::light_choice::LightChoice;
use super::sampler::Sampler;
use super::visibility::{Hit, Visibility};
use crate::light::{Light, LightShape};
use crate::math::{Rgb, Vector3};

/// Russian roulette may end a path from this bounce on.
const ROULETTE_FROM: u32 = 4;
/// No path survives a roulette with a higher probability, so that it ends even where every albedo is 1.
const HIGHEST_SURVIVAL: f64 = 0.98;
/// A change of a sample's direction, of 1e-7 to be expected, that is none of its slope.
const JUMP: f64 = 1e-4;

/// The static environment, ready for rays.
#[derive(Debug)]
pub struct Tracer {
    geometry: TracedGeometry,
    /// In the order of the visibility.
    surfaces: Vec<Surface>,
    visibility: Visibility,
    emitters: Emitters,
    reflects: bool,
}

/// The plane of a triangle and what it is made of.
#[derive(Clone, Copy, Debug)]
struct Surface {
    vertex: DVec3,
    /// Unit, towards the front.
    normal: DVec3,
    material: u32,
    /// Density of drawn places on it, m^-2; 0 where it does not emit.
    emitter_density: f64,
}

impl Tracer {
    pub fn new(geometry: &TracedGeometry) -> Self {
        let visibility = Visibility::new(&geometry.triangles);
        let emitters = Emitters::new(geometry);
        let surface = |index: &u32| {
            let triangle = &geometry.triangles[*index as usize];
            Surface {
                vertex: triangle[0],
                normal: doubled_area_vector(triangle).normalize(),
                material: geometry.material_of[*index as usize],
                emitter_density: emitters.pdf_area(*index),
            }
        };
        Self {
            geometry: geometry.clone(),
            surfaces: visibility.order().iter().map(surface).collect(),
            visibility,
            emitters,
            reflects: geometry.reflects(),
        }
    }

    pub fn visibility(&self) -> &Visibility {
        &self.visibility
    }

    pub fn triangle_count(&self) -> usize {
        self.surfaces.len()
    }

    /// Whether any surface reflects.
    pub fn reflects(&self) -> bool {
        self.reflects
    }

    /// Whether any surface emits.
    pub fn emits(&self) -> bool {
        !self.emitters.is_empty()
    }

    /// The static geometry.
    pub fn triangles(&self) -> &[[DVec3; 3]] {
        &self.geometry.triangles
    }

    /// The static geometry with its materials, in the order in which it was given.
    pub fn geometry(&self) -> &TracedGeometry {
        &self.geometry
    }

    /// What is seen from a place along a unit direction.
    pub fn look(&self, from: DVec3, direction: DVec3) -> Option<Sight> {
        let hit = self.visibility.closest(from, direction)?;
        let surface = &self.surfaces[hit.leaf as usize];
        let front = surface.normal.dot(direction) < 0.0;
        let normal = if front { surface.normal } else { -surface.normal };
        Some(Sight { distance: hit.distance, normal, front })
    }
}

/// A surface that is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Metres, to f32 accuracy.
    pub distance: f64,
    /// Unit, towards where it is seen from.
    pub normal: DVec3,
    /// Whether its front is seen: the side from which its vertices run counter-clockwise.
    pub front: bool,
}

/// A surface that a ray met, in f64.
#[derive(Clone, Copy)]
pub(super) struct Vertex {
    pub position: DVec3,
    pub distance: f64,
    /// Towards where the ray came from.
    pub normal: DVec3,
    /// Whether the ray came from the front.
    pub front: bool,
    emitter_density: f64,
    pub material: TracedMaterial,
}

impl Vertex {
    /// What it sends by itself.
    pub fn emission(&self) -> Rgb<f64> {
        if self.front { self.material.emission } else { Rgb::zero() }
    }
}

/// What lights a place, apart from one another so that each is sampled as often as it needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    /// One light of the layout, by its index, straight from it.
    Light(usize),
    /// Emissive geometry, straight, by places drawn on it.
    Emitters,
    /// What arrives along directions drawn by the receiver: surroundings, emissive geometry, reflected light.
    Directions,
}

/// A tracer under lights and effects: what arrives where.
#[derive(Debug)]
pub struct Transport<'a> {
    tracer: &'a Tracer,
    /// Those that are drawn from; all but constant ones.
    lights: Vec<Light<f64>>,
    /// Radiance of the constant lights, which rays that meet nothing see.
    surroundings: Rgb<f64>,
    effects: Effects,
    choice: LightChoice,
}

impl<'a> Transport<'a> {
    /// The static environment.
    pub fn tracer(&self) -> &'a Tracer {
        self.tracer
    }

    /// `lights` in world coordinates.
    pub fn new(tracer: &'a Tracer, lights: &[Light<f64>], effects: Effects) -> Self {
        let mut surroundings = Rgb::zero();
        let mut drawn = Vec::new();
        for light in lights {
            match light {
                Light::Constant(constant) => surroundings += constant.radiance,
                light => drawn.push(light.clone()),
            }
        }
        let choice = match effects.bounces {
            Some(_) => LightChoice::new(&drawn, (!tracer.visibility.is_empty()).then(|| tracer.visibility.bounds())),
            None => LightChoice::default(),
        };
        Self { tracer, lights: drawn, surroundings, effects, choice }
    }

    /// The layout's lights but for constant ones.
    pub fn lights(&self) -> &[Light<f64>] {
        &self.lights
    }

    /// Radiance of the constant lights.
    pub fn surroundings(&self) -> Rgb<f64> {
        self.surroundings
    }

    /// How far before a light a shadow ray ends, metres.
    pub(super) fn light_gap(&self, from: DVec3) -> f64 {
        self.tracer.visibility.light_gap(from)
    }

    pub fn effects(&self) -> Effects {
        self.effects
    }

    /// What there is to sample.
    pub(super) fn components(&self) -> Vec<Component> {
        let mut components: Vec<Component> = (0..self.lights.len()).map(Component::Light).collect();
        let sends = self.effects.bounces.is_some();
        if sends && self.tracer.emits() {
            components.push(Component::Emitters);
        }
        let surrounded = self.surroundings.max_abs() > 0.0;
        if surrounded || sends {
            components.push(Component::Directions);
        }
        components
    }

    /// Lights without extent that reach `p` with no finite value.
    pub(super) fn singular_terms(&self, p: DVec3) -> u32 {
        let p = Vector3::of(p);
        let unseen = self.lights.iter().filter(|light| light.sample(p, [0.5; 2]).is_none());
        unseen.map(|light| light.projection::<1>(p).singular).sum()
    }

    /// Whether a component's sample is its value: a light that has one direction only.
    pub(super) fn is_single(&self, component: Component, p: DVec3) -> bool {
        match component {
            Component::Light(index) => {
                let draw = |u| self.lights[index].sample(Vector3::of(p), u);
                draw([0.25, 0.25]) == draw([0.75, 0.625])
            }
            _ => false,
        }
    }

    /// One sample of a component at `p`. The flag says whether something blocked it.
    #[inline]
    pub(super) fn sample(
        &self,
        component: Component,
        p: DVec3,
        gather: &impl Gather,
        sampler: &mut Sampler,
        observer: &mut impl Observer,
    ) -> (Option<Arrival>, bool) {
        let start = match gather.normal() {
            Some(normal) => p + normal * self.tracer.visibility.epsilon(p),
            None => p,
        };
        let arrival = match component {
            Component::Light(index) => self.light_arrival(index, p, sampler.pair(), gather.wants_slopes()),
            Component::Emitters => {
                return self.emitter_arrival(p, start, gather, sampler.pair(), observer);
            }
            Component::Directions => {
                let (direction, pdf) = gather.draw(sampler.pair());
                if pdf <= 0.0 {
                    return (None, false);
                }
                if self.effects.bounces.is_some() {
                    return (self.along(start, direction, pdf, sampler, observer), false);
                }
                let weight = self.surroundings * (1.0 / pdf);
                Some((Arrival { direction, weight, origin: Origin::Distant }, f64::INFINITY))
            }
        };
        match arrival {
            Some((arrival, distance)) if gather.sees(arrival.direction) => {
                if self.effects.shadows && self.blocked(start, arrival.direction, distance, observer) {
                    return (Some(arrival), true);
                }
                (Some(arrival), false)
            }
            _ => (None, false),
        }
    }

    /// A sample of a light of the layout as seen from `p`, with the distance within which it may be blocked.
    #[inline]
    pub(super) fn light_arrival(&self, index: usize, p: DVec3, u: [f64; 2], slopes: bool) -> Option<(Arrival, f64)> {
        let light = &self.lights[index];
        let sample = light.sample(Vector3::of(p), u)?;
        let (direction, weight) = (sample.direction.to_double(), sample.weight);
        let origin = match slopes && sample.distance.is_finite() {
            false => Origin::Distant,
            true => {
                // one-sided differences: 1e-7 of the distance keeps truncation and rounding near 1e-8
                let step = 1e-7 * sample.distance;
                let mut direction_slopes = [DVec3::ZERO; 3];
                let mut weight_slopes = [Rgb::zero(); 3];
                for axis in 0..3 {
                    // where a light's way of drawing jumps (its frame may), the other side does not
                    for step in [step, -step] {
                        let moved = light.sample(Vector3::of(p + DVec3::AXES[axis] * step), u)?;
                        let turn = moved.direction.to_double() - direction;
                        if turn.length_squared() < JUMP * JUMP {
                            direction_slopes[axis] = turn / step;
                            weight_slopes[axis] = (moved.weight - weight) * (1.0 / step);
                            break;
                        }
                    }
                }
                Origin::Drawn { direction_slopes, weight_slopes }
            }
        };
        Some((Arrival { direction, weight, origin }, sample.distance))
    }

    /// A sample of emissive geometry, weighed against the receiver's own directions by the power heuristic.
    #[inline]
    fn emitter_arrival(
        &self,
        p: DVec3,
        start: DVec3,
        gather: &impl Gather,
        u: [f64; 2],
        observer: &mut impl Observer,
    ) -> (Option<Arrival>, bool) {
        observer.counters().emitter_samples += 1;
        let emitter = self.tracer.emitters.sample(u);
        let to = emitter.position - p;
        let squared = to.length_squared();
        let distance = squared.sqrt();
        let direction = to / distance;
        let cosine = -emitter.normal.dot(direction);
        if !(cosine > 0.0 && gather.sees(direction)) {
            return (None, false);
        }
        let pdf = emitter.pdf_area * squared / cosine;
        let weight = emitter.radiance * (power_heuristic(pdf, gather.pdf(direction)) / pdf);
        let origin = Origin::Surface { distance, normal: emitter.normal, drawn: true };
        let blocked = self.blocked_between(start, emitter.position, emitter.normal, observer);
        (Some(Arrival { direction, weight, origin }), blocked)
    }

    /// Whether anything blocks a light at this distance; it may lie on a surface.
    #[inline]
    pub(super) fn blocked(&self, start: DVec3, direction: DVec3, distance: f64, observer: &mut impl Observer) -> bool {
        let within = distance - self.tracer.visibility.light_gap(start);
        within > 0.0 && self.blocked_within(start, direction, within, observer)
    }

    #[inline]
    fn blocked_within(&self, start: DVec3, direction: DVec3, within: f64, observer: &mut impl Observer) -> bool {
        observer.counters().shadow_rays += 1;
        observer.ray(CastRay { origin: start, direction, within: Some(within) });
        self.tracer.visibility.occluded_within(start, direction, within)
    }

    /// Whether a surface point with this normal is hidden from `start`, which keeps clear of its own surface.
    #[inline]
    fn blocked_between(&self, start: DVec3, target: DVec3, normal: DVec3, observer: &mut impl Observer) -> bool {
        let to = target + normal * self.tracer.visibility.epsilon(target) - start;
        let distance = to.length();
        self.blocked_within(start, to / distance, distance, observer)
    }

    /// What arrives at `start` along a direction that was drawn with density `pdf`: surroundings, emission, reflected light.
    #[inline]
    fn along(
        &self,
        start: DVec3,
        direction: DVec3,
        pdf: f64,
        sampler: &mut Sampler,
        observer: &mut impl Observer,
    ) -> Option<Arrival> {
        let Some(vertex) = self.meet(start, direction, observer) else {
            let weight = self.surroundings * (1.0 / pdf);
            return Some(Arrival { direction, weight, origin: Origin::Distant });
        };
        let radiance = self.emitted(&vertex, direction, pdf) + self.reflected(vertex, sampler, observer);
        let origin = Origin::Surface { distance: vertex.distance, normal: vertex.normal, drawn: false };
        Some(Arrival { direction, weight: radiance * (1.0 / pdf), origin })
    }

    /// The first surface along a ray. Its place is where the ray meets the triangle's plane in f64.
    #[inline]
    pub(super) fn meet(&self, start: DVec3, direction: DVec3, observer: &mut impl Observer) -> Option<Vertex> {
        observer.counters().closest_rays += 1;
        observer.ray(CastRay { origin: start, direction, within: None });
        let Hit { leaf, distance } = self.tracer.visibility.closest(start, direction)?;
        let surface = &self.tracer.surfaces[leaf as usize];
        let slope = surface.normal.dot(direction);
        let exact = (surface.vertex - start).dot(surface.normal) / slope;
        // a ray in the plane meets it anywhere: then the f32 answer stands
        let near = (exact - distance).abs() <= 1e-3 * distance + self.tracer.visibility.epsilon(start);
        let distance = if near { exact } else { distance };
        let front = slope < 0.0;
        Some(Vertex {
            position: start + direction * distance,
            distance,
            normal: if front { surface.normal } else { -surface.normal },
            front,
            emitter_density: surface.emitter_density,
            material: self.tracer.geometry.materials[surface.material as usize],
        })
    }

    /// Emission of a surface that a direction drawn with density `pdf` met, weighed against drawing places on emitters.
    #[inline]
    fn emitted(&self, vertex: &Vertex, direction: DVec3, pdf: f64) -> Rgb<f64> {
        if !(vertex.front && vertex.emitter_density > 0.0) {
            return Rgb::zero();
        }
        let cosine = -vertex.normal.dot(direction);
        let drawn = vertex.emitter_density * vertex.distance * vertex.distance / cosine;
        vertex.material.emission * power_heuristic(pdf, drawn)
    }

    /// Radiance that a surface reflects diffusely towards where it was seen from, either side, up to the bounces asked for.
    pub(super) fn reflected(
        &self,
        mut vertex: Vertex,
        sampler: &mut Sampler,
        observer: &mut impl Observer,
    ) -> Rgb<f64> {
        let most = self.effects.most_bounces();
        let mut sum = Rgb::zero();
        let mut throughput = vertex.material.albedo;
        let mut bounce = 0;
        while most.is_none_or(|most| bounce < most) {
            bounce += 1;
            observer.counters().bounces += 1;
            if throughput.max_abs() <= 0.0 {
                break;
            }
            let start = vertex.position + vertex.normal * self.tracer.visibility.epsilon(vertex.position);
            let direct = self.direct(&vertex, start, sampler, observer);
            sum += throughput * direct * FRAC_1_PI;

            // the next direction: reflected light of the next surface, emission and surroundings
            let last = most == Some(bounce);
            if last && self.tracer.emitters.is_empty() && self.surroundings.max_abs() == 0.0 {
                break;
            }
            if bounce >= ROULETTE_FROM && !last {
                let survival = throughput.max_abs().min(HIGHEST_SURVIVAL);
                if sampler.one() >= survival {
                    break;
                }
                throughput = throughput * (1.0 / survival);
            }
            let [u, v] = sampler.pair();
            let cosine = u.sqrt();
            let direction = about(vertex.normal, cosine, v);
            let Some(next) = self.meet(start, direction, observer) else {
                sum += throughput * self.surroundings;
                break;
            };
            sum += throughput * self.emitted(&next, direction, cosine * FRAC_1_PI);
            throughput = throughput * next.material.albedo;
            vertex = next;
        }
        sum
    }

    /// Irradiance at a surface straight from one drawn light and one drawn emitter.
    #[inline]
    fn direct(&self, vertex: &Vertex, start: DVec3, sampler: &mut Sampler, observer: &mut impl Observer) -> Rgb<f64> {
        let mut sum = Rgb::zero();
        if !self.lights.is_empty() {
            let u = sampler.pair();
            let (index, probability) = match self.lights.len() {
                1 => (0, 1.0),
                _ => self.choice.draw(vertex.position, sampler.one()),
            };
            if let Some((arrival, distance)) = self.light_arrival(index, vertex.position, u, false) {
                let cosine = vertex.normal.dot(arrival.direction);
                if cosine > 0.0 && !self.blocked(start, arrival.direction, distance, observer) {
                    sum += arrival.weight * (cosine / probability);
                }
            }
        }
        if !self.tracer.emitters.is_empty() {
            observer.counters().emitter_samples += 1;
            let emitter = self.tracer.emitters.sample(sampler.pair());
            let to = emitter.position - vertex.position;
            let squared = to.length_squared();
            let direction = to / squared.sqrt();
            let (cosine, sent) = (vertex.normal.dot(direction), -emitter.normal.dot(direction));
            if cosine > 0.0 && sent > 0.0 {
                let pdf = emitter.pdf_area * squared / sent;
                if !self.blocked_between(start, emitter.position, emitter.normal, observer) {
                    let heuristic = power_heuristic(pdf, cosine * FRAC_1_PI);
                    sum += emitter.radiance * (cosine * heuristic / pdf);
                }
            }
        }
        sum
    }
}

/// Weight of a sample drawn with density `own` where another way would have drawn it with density `other` (Veach 1997, power 2).
#[inline(always)]
fn power_heuristic(own: f64, other: f64) -> f64 {
    // by the ratio, so that neither square overflows
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}
