//! Near and far: some lights directly, the rest in the rig, by how large an error each would add in the rig.

use crate::light::{Light, LightModel, LightShape};
use crate::math::{Rgb, Vector3};
use crate::probe::{GradientSource, sample_lights};
use crate::rig::{AnyRig, Rig, RigModel, ShVectors};
use crate::scene::OrientedBox;
use crate::sh::{MAX_COEFFICIENTS, MAX_ORDER, Window, degree_of};

/// When a light leaves the rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Transition {
    /// By the error that it would add in the rig, RMS over the RMS of the total irradiance in the box ([`light_errors`]): in the rig
    /// below `threshold` (1 - `blend`), direct above `threshold` (1 + `blend`), and between them a share of both.
    Error { threshold: f64, blend: f64 },
    /// The rule of thumb of Annen et al. 2004: direct where the light comes nearer to a sample than the part of the box that the sample serves
    /// reaches from it ([`nearer_than_served`]).
    Nearer,
}

/// For each light, the share of it that is evaluated directly, in [0, 1]; and how many projections finding it took.
pub fn direct_shares(transition: Transition, far: &FarField) -> (Vec<f64>, u64) {
    match transition {
        Transition::Error { threshold, blend } => {
            let (errors, projections) = light_errors(far);
            let share = |error: f64| {
                let (from, to) = (threshold * (1.0 - blend), threshold * (1.0 + blend));
                if error >= to {
                    1.0
                } else if error <= from {
                    0.0
                } else {
                    let t = (error - from) / (to - from);
                    t * t * (3.0 - 2.0 * t)
                }
            };
            (errors.into_iter().map(share).collect(), projections)
        }
        Transition::Nearer => {
            let share = |light: &Light<f64>| if nearer_than_served(far, light) { 1.0 } else { 0.0 };
            (far.lights.iter().map(share).collect(), 0)
        }
    }
}

/// What the criterion looks at: a rig over a box and the lights that it would hold.
pub struct FarField<'a> {
    pub rig: &'a AnyRig,
    pub bounds: OrientedBox,
    pub order: usize,
    pub lights: &'a [Light<f64>],
    pub model: LightModel,
    /// A_k of the receiver's lobe.
    pub bands: [f64; MAX_ORDER],
    pub gradients: GradientSource,
    pub window: Window,
}

/// Where the rig is checked: the middles of the box's faces and the eight points between them on the ellipsoid in the box.
fn checks(half: [f64; 3]) -> Vec<[f64; 3]> {
    let mut places = Vec::with_capacity(14);
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let mut place = [0.0; 3];
            place[axis] = side * half[axis];
            places.push(place);
        }
    }
    let diagonal = 1.0 / 3f64.sqrt();
    for corner in 0..8 {
        places.push(std::array::from_fn(
            |axis| if corner >> axis & 1 == 0 { -half[axis] } else { half[axis] } * diagonal,
        ));
    }
    places
}

/// For each light, an estimate of the error that it adds in the rig over the object, RMS over the RMS of the irradiance of all lights.
///
/// Derivation. A rig is linear in its samples and samples are sums over lights, so the error is a sum of each light's own,
/// E_rig(p, n) - E(p, n) = sum over i of A_k (r_i(p) - c_i(p)) Y_i(n), with c the light's SH at p and r what the rig makes of the light's samples, 0 from degree n on. By
/// Parseval its mean square over all normals is the sum of A_k^2 |r_i - c_i|^2/(4 pi): below degree n what the rig interpolates wrongly, from n on what the
/// order leaves out, and the two do not mix. The mean over the object's surface becomes the mean over 14 points of an ellipsoid in its box;
/// the object's normals become all normals; degrees from 6 on are left out (A_6^2 is 7 % of A_4^2). The light's samples are those that the rig takes anyway;
/// the 14 projections a light are the criterion's cost. No constant is fitted. What it gives on 500 random layouts is tested (`tests/transitions.rs`):
/// half of the estimates are too large and half too small, one in a hundred by more than 1.7 times too small.
pub fn light_errors(far: &FarField) -> (Vec<f64>, u64) {
    const C: usize = MAX_COEFFICIENTS;
    let half = far.bounds.half;
    let requests = far.rig.placement(half);
    let places = checks(half);
    let model = far.rig.model::<f64>(half);
    let weights: [f64; C] = std::array::from_fn(|i| far.bands[degree_of(i)].powi(2));
    let mean_square = |sh: &[Rgb<f64>; C]| -> f64 {
        (0..C).map(|i| weights[i] * (sh[i].r.powi(2) + sh[i].g.powi(2) + sh[i].b.powi(2))).sum()
    };
    let mut total = vec![[Rgb::<f64>::zero(); C]; places.len()];
    let mut squares = Vec::with_capacity(far.lights.len());
    let mut projections = 0;
    for light in far.lights {
        let lamp = far.model.light(light.relative_to::<f64>(far.bounds.center), far.order);
        let exact = light.relative_to::<f64>(far.bounds.center);
        let sampled =
            sample_lights(std::slice::from_ref(&lamp), &far.bounds, &requests, far.order, far.gradients, far.window);
        let vectors: ShVectors<f64> = far.rig.fit(half, sampled.vectors).vectors;
        let mut square = 0.0;
        for (place, total) in places.iter().zip(&mut total) {
            let p = far.bounds.world(*place) - far.bounds.center;
            let truth = exact.projection::<C>(Vector3::of(p)).value;
            projections += 1;
            let mut off = truth.map(|c| c * -1.0);
            model.taps(Vector3::from_array(*place), &mut |vector, weight| {
                for (o, v) in off.iter_mut().zip(vectors.vector(vector).chunks_exact(3)) {
                    *o += Rgb::new(v[0], v[1], v[2]) * weight;
                }
            });
            square += mean_square(&off);
            for (sum, c) in total.iter_mut().zip(truth) {
                *sum += c;
            }
        }
        squares.push(square);
    }
    let all: f64 = total.iter().map(&mean_square).sum();
    let errors = squares.into_iter().map(|square| if all > 0.0 { (square / all).sqrt() } else { 0.0 });
    (errors.collect(), projections)
}

/// Whether a light's nearest point is nearer to a sample of the rig than the farthest point of the box that this sample serves:
/// the half diagonal for one sample in the middle, half a cell's diagonal on a lattice.
pub fn nearer_than_served(far: &FarField, light: &Light<f64>) -> bool {
    let Some(bounds) = light.bounds() else { return false };
    let half = far.bounds.half;
    let requests = far.rig.placement(half);
    let corners = far.bounds.corners();
    let samples: Vec<glam::DVec3> = requests.iter().map(|request| far.bounds.world(request.position)).collect();
    // the reach of a sample: to the farthest place of the box's corners, edges' and faces' middles and centre that has no nearer sample
    let mut places: Vec<glam::DVec3> = checks(half).into_iter().map(|place| far.bounds.world(place)).collect();
    places.extend(corners);
    samples.iter().any(|sample| {
        let served = places.iter().filter(|place| {
            let mine = place.distance(*sample);
            samples.iter().all(|other| place.distance(*other) >= mine - 1e-9)
        });
        let reach = served.map(|place| place.distance(*sample)).fold(0.0, f64::max);
        bounds.center.distance(*sample) - bounds.radius < reach
    })
}
