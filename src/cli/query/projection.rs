//! SH coefficients of what can be asked for its sum c_i Y_i(w) in any direction.

use std::f64::consts::PI;

use glam::DVec3;

use crate::cli::Failure;
use crate::math::{Rgb, Vector3, gauss_legendre};
use crate::scene::SurfacePoint;
use crate::sh::{basis, coefficients};

/// Directions and weights of a quadrature over the sphere that is exact for products of two functions of this order: Gauss-Legendre
/// in z, equal steps around it.
fn rule(order: usize) -> Vec<(DVec3, f64)> {
    let rule = gauss_legendre(order);
    let around = 2 * order - 1;
    rule.nodes
        .iter()
        .zip(&rule.weights)
        .flat_map(|(z, weight)| {
            (0..around).map(move |k| {
                let (sin, cos) = (2.0 * PI * k as f64 / around as f64).sin_cos();
                let radius = (1.0 - z * z).sqrt();
                (DVec3::new(radius * cos, radius * sin, *z), weight * 2.0 * PI / around as f64)
            })
        })
        .collect()
}

/// The SH vectors at places in the world of what `radiance` sums up there, by direction.
pub(super) fn coefficients_at(
    order: usize,
    places: &[DVec3],
    radiance: impl Fn(&[SurfacePoint]) -> Result<Vec<Rgb<f64>>, Failure>,
) -> Result<Vec<Vec<Rgb<f64>>>, Failure> {
    let directions = rule(order);
    let seen = |position: &DVec3| -> Vec<SurfacePoint> {
        directions.iter().map(|(normal, _)| SurfacePoint { position: *position, normal: *normal }).collect()
    };
    let points: Vec<SurfacePoint> = places.iter().flat_map(seen).collect();
    let radiance = radiance(&points)?;
    let project = |values: &[Rgb<f64>]| {
        let mut sum = vec![Rgb::zero(); coefficients(order)];
        for (value, (direction, weight)) in values.iter().zip(&directions) {
            let y = basis::<f64, 36>(Vector3::of(*direction));
            for (sum, y) in sum.iter_mut().zip(y) {
                *sum += *value * (y * weight);
            }
        }
        sum
    };
    Ok(radiance.chunks_exact(directions.len()).map(project).collect())
}

/// Coefficients at every point, or their derivatives along the world's axes by central differences with a step in metres.
/// `at` gives the SH vectors at places.
pub(super) fn rows(
    step: Option<f64>,
    points: &[SurfacePoint],
    at: impl Fn(&[DVec3]) -> Result<Vec<Vec<Rgb<f64>>>, Failure>,
) -> Result<Vec<Vec<Vec<Rgb<f64>>>>, Failure> {
    let offsets: Vec<DVec3> = match step {
        Some(step) => DVec3::AXES.iter().flat_map(|axis| [*axis * step, *axis * -step]).collect(),
        None => vec![DVec3::ZERO],
    };
    let places: Vec<DVec3> =
        points.iter().flat_map(|point| offsets.iter().map(|offset| point.position + *offset)).collect();
    let found = at(&places)?;
    let of_point = |vectors: &[Vec<Rgb<f64>>]| match step {
        None => vec![vectors[0].clone()],
        Some(step) => vectors
            .chunks_exact(2)
            .map(|pair| pair[0].iter().zip(&pair[1]).map(|(a, b)| (*a - *b) * (0.5 / step)).collect())
            .collect(),
    };
    Ok(found.chunks_exact(offsets.len()).map(of_point).collect())
}
