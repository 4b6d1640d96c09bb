//! Light at a place as a cube map sees it: one radiance a texel, along its centre, weighed by the texel's solid angle.

use glam::DVec3;
use rayon::prelude::*;

use super::counters::{Counters, Observer};
use super::estimate::{Projected, Seed};
use super::gather::{Arrival, Gather, Origin, ProjectionGather};
use super::sampler::{Sampler, derive};
use super::transport::{Component, Transport};
use crate::light::{Light, LightShape};
use crate::math::{Rgb, Stream, Vector3};

/// A place and the place whose random numbers it uses: captures that are to be compared (central differences) share them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapturePlace {
    pub position: DVec3,
    pub numbers_of: DVec3,
}

/// Where the light that captured surfaces reflect comes from.
#[derive(Clone, Copy)]
pub enum Reflected<'r> {
    /// Paths through the scene, so many a texel.
    Paths(u32),
    /// The irradiance at a surface's place under its normal, from whoever knows it.
    From(&'r (dyn Fn(DVec3, DVec3) -> Rgb<f64> + Sync)),
}

/// What a capture gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    pub projected: Projected,
    /// Of the surfaces that its texels see.
    pub depths: Depths,
    pub singular: u32,
    pub counters: Counters,
}

/// What the depths around a place say of its surroundings, metres. Infinite where nothing is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Depths {
    /// 4 pi over the integral of 1/depth.
    pub harmonic_mean: f64,
    pub minimum: f64,
    /// Share of the directions that see the back of a surface.
    pub behind: f64,
}

/// Sums over directions for [`Depths`].
#[derive(Clone, Copy, Debug)]
pub struct DepthSums {
    /// Of solid angles, of solid angles over depths, of solid angles that see the back of a surface.
    pub total: f64,
    pub inverse: f64,
    pub behind: f64,
    pub minimum: f64,
}

impl Default for DepthSums {
    fn default() -> Self {
        Self { total: 0.0, inverse: 0.0, behind: 0.0, minimum: f64::INFINITY }
    }
}

impl DepthSums {
    /// A direction with its solid angle, and what it sees: the distance, and whether its front.
    pub fn add(&mut self, solid_angle: f64, seen: Option<(f64, bool)>) {
        self.total += solid_angle;
        if let Some((distance, front)) = seen {
            self.inverse += solid_angle / distance;
            self.minimum = self.minimum.min(distance);
            self.behind += if front { 0.0 } else { solid_angle };
        }
    }

    pub fn depths(&self) -> Depths {
        Depths { harmonic_mean: self.total / self.inverse, minimum: self.minimum, behind: self.behind / self.total }
    }
}

/// A surface that a texel sees.
#[derive(Clone, Copy)]
struct Seen {
    distance: f64,
    /// Towards the place.
    normal: DVec3,
    front: bool,
}

/// Where a direction meets a light's surface: distance and the normal on the side that is seen.
fn on_light(light: &Light<f64>, p: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
    if let Light::Sphere(sphere) = light {
        let to = sphere.center.to_double() - p;
        let along = to.dot(direction);
        let gap = to.length_squared() - along * along;
        let half = (sphere.radius * sphere.radius - gap).max(0.0).sqrt();
        // from within, the far side
        let distance = if along - half > 0.0 { along - half } else { along + half };
        let normal = (p + direction * distance - sphere.center.to_double()) / sphere.radius;
        return Some((distance, if normal.dot(direction) > 0.0 { -normal } else { normal }));
    }
    // flat ones: the plane through any place of theirs
    let sample = light.sample(Vector3::of(p), [0.5; 2])?;
    let normal = sample.normal?.to_double();
    let slope = normal.dot(direction);
    let distance = sample.distance * normal.dot(sample.direction.to_double()) / slope;
    (slope != 0.0 && distance.is_finite()).then_some((distance, normal))
}

impl Transport<'_> {
    /// SH radiance coefficients of cube maps around places; `texels` are directions with their solid angles. Lights without extent have no texels: they are projected as they are, behind their shadow rays.
    ///
    /// L_i is the sum over the texels of L(w) Y_i(w) dw: a quadrature, whose error shrinks with the texels. Derivatives are Annen's from
    /// the depth and normal of what each texel sees.
    pub fn capture(
        &self,
        places: &[CapturePlace],
        texels: &[(DVec3, f64)],
        order: usize,
        gradient: bool,
        reflected: Reflected,
        seed: Seed,
    ) -> Vec<Capture> {
        crate::with_order!(order, C => {
            places
                .par_iter()
                .map(|place| {
                    let gather = ProjectionGather::<C> { gradient, touch: self.light_gap(place.position) };
                    let key = Stream::at(seed.seed, seed.purpose, &place.numbers_of.to_array()).next_u64();
                    let (sum, depths, counters) = self.capture_at(place.position, texels, &gather, reflected, key);
                    let singular = self.singular_terms(place.position);
                    Capture { projected: Projected::from_numbers(&sum, C), depths, singular, counters }
                })
                .collect()
        })
    }

    fn capture_at<const C: usize>(
        &self,
        place: DVec3,
        texels: &[(DVec3, f64)],
        gather: &ProjectionGather<C>,
        reflected: Reflected,
        key: u64,
    ) -> (Vec<f64>, Depths, Counters) {
        let mut counters = Counters { texels: texels.len() as u64, ..Counters::default() };
        let mut depths = DepthSums::default();
        let mut sum = vec![0.0; gather.width()];
        let mut add = |arrival: Arrival, counters: &mut Counters| {
            if arrival.weight.max_abs() > 0.0 {
                gather.add(&mut sum, &arrival, counters);
            }
        };
        for (index, (direction, solid_angle)) in texels.iter().enumerate() {
            let (radiance, seen) = self.seen(place, *direction, reflected, derive(key, index as u64), &mut counters);
            depths.add(*solid_angle, seen.map(|seen| (seen.distance, seen.front)));
            let origin = match seen {
                Some(Seen { distance, normal, .. }) => Origin::Surface { distance, normal, drawn: false },
                None => Origin::Distant,
            };
            add(Arrival { direction: *direction, weight: radiance * *solid_angle, origin }, &mut counters);
            // lights of the layout block nothing: all that stand before the surface add up
            let within = seen.map_or(f64::INFINITY, |seen| seen.distance);
            for light in self.lights() {
                let radiance = light.radiance(Vector3::of(place), Vector3::of(*direction));
                if radiance.max_abs() <= 0.0 {
                    continue;
                }
                let (distance, origin) = match on_light(light, place, *direction) {
                    Some((distance, normal)) => (distance, Origin::Surface { distance, normal, drawn: false }),
                    None => (f64::INFINITY, Origin::Distant),
                };
                let hidden = self.effects().shadows && within < distance - self.light_gap(place);
                if !hidden {
                    add(Arrival { direction: *direction, weight: radiance * *solid_angle, origin }, &mut counters);
                }
            }
        }
        // lights without extent, a line by as many places as a face has texels along its edge
        let places = ((texels.len() / 6) as f64).sqrt().round().max(1.0) as usize;
        for (index, light) in self.lights().iter().enumerate() {
            let Some(sample) = light.sample(Vector3::of(place), [0.5; 2]) else { continue };
            if sample.pdf_solid_angle.is_some() {
                continue;
            }
            let count = if self.is_single(Component::Light(index), place) { 1 } else { places };
            for k in 0..count {
                let u = [(k as f64 + 0.5) / count as f64, 0.5];
                let Some((mut arrival, distance)) = self.light_arrival(index, place, u, false) else { continue };
                if self.effects().shadows && self.blocked(place, arrival.direction, distance, &mut counters) {
                    continue;
                }
                arrival.weight = arrival.weight * (1.0 / count as f64);
                // the place on the light stays where it is when the probe moves, and what it sends goes with 1/distance^2
                if gather.gradient && distance.is_finite() {
                    let (w, weight) = (arrival.direction, arrival.weight);
                    arrival.origin = Origin::Drawn {
                        direction_slopes: DVec3::AXES.map(|axis| (w * axis.dot(w) - axis) / distance),
                        weight_slopes: w.to_array().map(|along| weight * (2.0 * along / distance)),
                    };
                }
                add(arrival, &mut counters);
            }
        }
        (sum, depths.depths(), counters)
    }

    /// Radiance that surfaces and surroundings send to `place` against `direction`, with what is seen.
    fn seen(
        &self,
        place: DVec3,
        direction: DVec3,
        reflected: Reflected,
        key: u64,
        observer: &mut impl Observer,
    ) -> (Rgb<f64>, Option<Seen>) {
        let Some(vertex) = self.meet(place, direction, observer) else { return (self.surroundings(), None) };
        let seen = Some(Seen { distance: vertex.distance, normal: vertex.normal, front: vertex.front });
        if self.effects().bounces.is_none() {
            // surfaces block and send nothing; where not even that, what is behind them is seen
            return match self.effects().shadows {
                true => (Rgb::zero(), seen),
                false => (self.surroundings(), None),
            };
        }
        let mut radiance = vertex.emission();
        if self.effects().most_bounces() != Some(0) {
            match reflected {
                Reflected::Paths(paths) => {
                    for path in 0..paths {
                        let mut sampler = Sampler::new(key, path);
                        radiance += self.reflected(vertex, &mut sampler, observer) * (1.0 / f64::from(paths));
                    }
                }
                Reflected::From(irradiance) => {
                    let e = irradiance(vertex.position, vertex.normal);
                    radiance += vertex.material.albedo * e * std::f64::consts::FRAC_1_PI;
                }
            }
        }
        (radiance, seen)
    }
}
