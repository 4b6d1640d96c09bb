//! The ground truth per surface point, in f64, with its own standard error. It knows no rig.

use rayon::prelude::*;

use crate::light::{self, Light};
use crate::math::{Real, Rgb, StreamPurpose, Vector3};
use crate::scene::SurfacePoint;
use crate::sh::{Lobe, convolve, spread};
use crate::trace::{Counters, Effort, Seed, Transport};
use crate::with_order;

/// Irradiance at points, with the standard error of each value where it is an estimate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reference {
    /// E, W m^-2, one a point.
    pub irradiance: Vec<Rgb<f64>>,
    /// Empty where the values are exact.
    pub standard_error: Vec<Rgb<f64>>,
    /// Terms dropped because a point is singular for a light.
    pub singular: u64,
    /// What was simulated for it.
    pub counters: Counters,
}

/// Exact irradiance of lights that nothing blocks: the sum of each light's closed form, with the receiver's horizon.
/// Positions are taken relative to `origin` before they are rounded to `T`, so that f32 shows its arithmetic and not
/// the distance of the scene from the world's origin.
pub fn exact<T: Real>(
    lights: &[Light<f64>],
    points: &[SurfacePoint],
    lobe: &Lobe<T>,
    origin: glam::DVec3,
) -> Reference {
    let lights: Vec<Light<T>> = lights.iter().map(|light| light.relative_to(origin)).collect();
    let terms: Vec<_> = points
        .par_iter()
        .with_min_len(64)
        .map(|point| light::irradiance(&lights, Vector3::of(point.position - origin), Vector3::of(point.normal), lobe))
        .collect();
    Reference {
        irradiance: terms.iter().map(|t| t.value.to_double()).collect(),
        standard_error: Vec::new(),
        singular: terms.iter().map(|t| u64::from(t.singular)).sum(),
        counters: wrap_counters(points.len() * lights.len(), lobe),
    }
}

/// What exact lighting computes: no ray, no bounce; each light under the wrap lobe, where there is one.
fn wrap_counters<T: Real>(terms: usize, lobe: &Lobe<T>) -> Counters {
    Counters { wrap_evaluations: if lobe.is_lambert() { 0 } else { terms as u64 }, ..Counters::default() }
}

/// Irradiance with shadows and bounces: estimates that carry their standard error.
pub fn traced(
    transport: &Transport,
    points: &[SurfacePoint],
    lobe: &Lobe<f64>,
    seed: u64,
    effort: Effort,
) -> Reference {
    let estimates = transport.irradiance(points, lobe, Seed { seed, purpose: StreamPurpose::Reference }, effort);
    Reference {
        irradiance: estimates.iter().map(|e| e.value).collect(),
        standard_error: estimates.iter().map(|e| e.standard_error).collect(),
        singular: estimates.iter().map(|e| u64::from(e.singular)).sum(),
        counters: estimates.iter().map(|e| e.counters).sum(),
    }
}

/// Exact irradiance at one point, f64.
pub fn exact_at(lights: &[Light<f64>], point: &SurfacePoint, lobe: &Lobe<f64>) -> Rgb<f64> {
    light::irradiance(lights, Vector3::of(point.position), Vector3::of(point.normal), lobe).value
}

/// Irradiance from the exact SH projection of the lights at every point, truncated at each of `orders`: what an order costs,
/// with no rig at all. One projection at the highest order serves the lower ones, which are its prefixes.
pub fn truncated(
    lights: &[Light<f64>],
    points: &[SurfacePoint],
    lobe: &Lobe<f64>,
    orders: &[usize],
) -> Vec<Vec<Rgb<f64>>> {
    let highest = orders.iter().copied().max().unwrap_or(1);
    let rows: Vec<Vec<Rgb<f64>>> = points
        .par_iter()
        .with_min_len(16)
        .map(|point| {
            let (p, n) = (Vector3::of(point.position), Vector3::of(point.normal));
            with_order!(highest, C => {
                let sh = light::projection::<f64, C>(lights, p).value;
                let (factors, basis) = (spread::<f64, C>(lobe.bands()), crate::sh::basis::<f64, C>(n));
                orders.iter().map(|order| {
                    let mut low = [Rgb::zero(); C];
                    low[..order * order].copy_from_slice(&sh[..order * order]);
                    convolve(&low, &factors, &basis)
                }).collect()
            })
        })
        .collect();
    (0..orders.len()).map(|k| rows.iter().map(|row| row[k]).collect()).collect()
}

/// As [`truncated`], with shadows and bounces: SH of one order at every point, by rays of the reference's own.
pub fn truncated_traced(
    transport: &Transport,
    points: &[SurfacePoint],
    lobe: &Lobe<f64>,
    order: usize,
    seed: u64,
    effort: Effort,
) -> Vec<Rgb<f64>> {
    let places: Vec<glam::DVec3> = points.iter().map(|p| p.position).collect();
    let estimates =
        transport.projection(&places, order, false, Seed { seed, purpose: StreamPurpose::Reference }, effort);
    let factors = spread::<f64, 36>(lobe.bands());
    let of = |point: &SurfacePoint, sh: &[Rgb<f64>]| {
        let basis = crate::sh::basis::<f64, 36>(Vector3::of(point.normal));
        sh.iter().enumerate().fold(Rgb::zero(), |sum, (i, c)| sum + *c * (factors[i] * basis[i]))
    };
    points.iter().zip(&estimates).map(|(point, estimate)| of(point, &estimate.value.value)).collect()
}
