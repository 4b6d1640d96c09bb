//! A query on the GPU: the shaders that the renders run, read at the user's points.

use super::projection::{coefficients_at, rows};
use super::values::Values;
use super::{Lighting, Quantity, Query, doubles, gradient_step, mean_position, rig_values};
use crate::candidate::{Arithmetic, FittedRig, GpuBench, Recipe, Surroundings, local_points, prepare};
use crate::cli::{Exit, Failure};
use crate::gpu::{AdapterKind, Evaluator, Gpu};
use crate::rig::AnyRig;
use crate::scene::{OrientedBox, SurfacePoint};

/// A rig from its buffer, or every light at every point.
pub(super) fn values(
    args: &Query,
    lighting: &Lighting,
    rig: Option<&AnyRig>,
    points: &[SurfacePoint],
    bounds: Option<OrientedBox>,
) -> Result<Values, Failure> {
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
            let evaluator = Evaluator::of_rig(&gpu, rig, bounds.half, usize::from(args.order));
            let reader = Reader { evaluator: evaluator.map_err(Failure::internal)?, bounds };
            rig_values::<f32>(args, lighting, rig, bounds, |fitted| reader.read(args.quantity, fitted, points))
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
        let step = (quantity == Quantity::ShGradient).then(|| gradient_step::<f32>(&self.bounds));
        let value = rows(step, points, |places| {
            coefficients_at(fitted.radiance.order, places, |points| {
                let local = local_points(&self.bounds, points);
                Ok(doubles(&self.evaluator.evaluate(&fitted.radiance, &local).map_err(Failure::internal)?))
            })
        })?;
        Ok(Values::Sh { value, error: Vec::new() })
    }
}
