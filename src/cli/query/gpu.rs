//! A query on the GPU: the shaders that the renders run, read at the user's points.

use std::f64::consts::PI;

use glam::DVec3;

use super::values::Values;
use super::{Lighting, Quantity, Query, differences, doubles, gradient_step, mean_position, rig_values};
use crate::candidate::{Arithmetic, FittedRig, GpuBench, Recipe, Surroundings, local_points, prepare};
use crate::cli::{Exit, Failure};
use crate::gpu::{AdapterKind, Evaluator, Gpu};
use crate::math::{Rgb, gauss_legendre};
use crate::rig::{AnyRig, Rig};
use crate::scene::{OrientedBox, SurfacePoint};
use crate::sh::{basis, coefficients};

/// A rig from its buffer, or every light at every point.
pub(super) fn values(
    args: &Query,
    lighting: &Lighting,
    points: &[SurfacePoint],
    bounds: Option<OrientedBox>,
) -> Result<Values, Failure> {
    let rig = match args.rig.as_deref().map(str::trim) {
        None | Some("direct") => None,
        Some(text) => Some(AnyRig::inline(text)?),
    };
    if rig.is_none() && args.quantity != Quantity::Irradiance {
        return Err(Failure::usage(
            "lights are projected on the CPU; ask for --backend cpu, or for a rig's coefficients with --rig",
        ));
    }
    if rig.is_none() && lighting.is_sampled() {
        return Err(Failure::usage(
            "the reference's shadows and bounces are traced on the CPU; ask for --effects none, or for --backend cpu",
        ));
    }
    let gpu = Gpu::open(AdapterKind::Any).map_err(|error| Failure::new(Exit::NoGpu, error.to_string()))?;
    match rig {
        Some(rig) => {
            let bounds = bounds.expect("a rig was refused without a box");
            let evaluator = Evaluator::new(&gpu, &rig.wgsl(bounds.half), usize::from(args.order));
            let reader = Reader { evaluator: evaluator.map_err(Failure::internal)?, bounds };
            rig_values::<f32>(args, lighting, &rig, bounds, |fitted| reader.read(args.quantity, fitted, points))
        }
        None => direct_values(args, lighting, points, bounds, gpu),
    }
}

fn direct_values(
    args: &Query,
    lighting: &Lighting,
    points: &[SurfacePoint],
    bounds: Option<OrientedBox>,
    gpu: Gpu,
) -> Result<Values, Failure> {
    let origin = mean_position(points);
    let recipe = Recipe::new(None, usize::from(args.order), Arithmetic::GpuBuffer);
    let around = Surroundings {
        bounds: bounds.unwrap_or(OrientedBox::aligned(origin, origin)),
        lights: lighting.lights,
        wrap: args.wrap,
        transport: None,
    };
    let lit = prepare(&recipe, &around, Some(&GpuBench::new(gpu))).map_err(Failure::internal)?;
    Ok(Values::Irradiance { value: lit.irradiance(points).map_err(Failure::internal)?, error: Vec::new() })
}

/// A rig's pipeline, read at points.
struct Reader {
    evaluator: Evaluator,
    bounds: OrientedBox,
}

impl Reader {
    fn read(&self, quantity: Quantity, fitted: &FittedRig<f32>, points: &[SurfacePoint]) -> Result<Values, Failure> {
        if quantity == Quantity::Irradiance {
            let local = local_points(&self.bounds, points);
            let values = self.evaluator.evaluate(&fitted.irradiance, &local).map_err(Failure::internal)?;
            return Ok(Values::Irradiance { value: doubles(&values), error: Vec::new() });
        }
        let step = gradient_step::<f32>(&self.bounds);
        let offsets: Vec<DVec3> = match quantity {
            Quantity::ShGradient => DVec3::AXES.iter().flat_map(|axis| [*axis * step, *axis * -step]).collect(),
            _ => vec![DVec3::ZERO],
        };
        let places = points.iter().flat_map(|point| offsets.iter().map(|offset| point.position + *offset)).collect();
        let found = self.coefficients(fitted, places)?;
        let rows = |vectors: &[Vec<Rgb<f64>>]| match quantity {
            Quantity::ShGradient => differences(step, |offset| {
                let place = offsets.iter().position(|o| *o == offset).expect("differences go along these");
                vectors[place].clone()
            }),
            _ => vec![vectors[0].clone()],
        };
        Ok(Values::Sh { value: found.chunks_exact(offsets.len()).map(rows).collect(), error: Vec::new() })
    }

    /// The reconstructed SH radiance vector at places in the world. The shader sums c_i Y_i(w) for a direction w; over the directions
    /// of a quadrature that is exact for products of two functions of this order, its projection gives the c_i back:
    /// Gauss-Legendre in z, equal steps around it.
    fn coefficients(&self, fitted: &FittedRig<f32>, places: Vec<DVec3>) -> Result<Vec<Vec<Rgb<f64>>>, Failure> {
        let order = fitted.radiance.order;
        let rule = gauss_legendre(order);
        let around = 2 * order - 1;
        let directions: Vec<(DVec3, f64)> = rule
            .nodes
            .iter()
            .zip(&rule.weights)
            .flat_map(|(z, weight)| {
                (0..around).map(move |k| {
                    let (sin, cos) = (2.0 * PI * k as f64 / around as f64).sin_cos();
                    let radius = (1.0 - z * z).sqrt();
                    (DVec3::new(radius * cos, radius * sin, *z), weight * 2.0 * PI / around as f64)
                })
            })
            .collect();
        let seen = |position: &DVec3| -> Vec<SurfacePoint> {
            directions.iter().map(|(normal, _)| SurfacePoint { position: *position, normal: *normal }).collect()
        };
        let points: Vec<SurfacePoint> = places.iter().flat_map(seen).collect();
        let local = local_points(&self.bounds, &points);
        let radiance = self.evaluator.evaluate(&fitted.radiance, &local).map_err(Failure::internal)?;
        let project = |values: &[Rgb<f32>]| {
            let mut sum = vec![Rgb::zero(); coefficients(order)];
            for (value, (direction, weight)) in values.iter().zip(&directions) {
                let y = basis::<f64, 36>(crate::math::Vector3::of(*direction));
                for (sum, y) in sum.iter_mut().zip(y) {
                    *sum += value.to_double() * (y * weight);
                }
            }
            sum
        };
        Ok(radiance.chunks_exact(directions.len()).map(project).collect())
    }
}
