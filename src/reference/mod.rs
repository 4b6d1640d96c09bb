//! The ground truth per surface point, in f64, with its own standard error. It knows no rig.

use rayon::prelude::*;

use crate::light::{self, Light};
use crate::math::{Real, Rgb, Vector3};
use crate::scene::SurfacePoint;
use crate::sh::{Lobe, convolve, spread};
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
