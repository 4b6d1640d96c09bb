//! A candidate at work: from lights and a rig to irradiance at points, on the CPU. It knows no reference.

mod prepared;
mod transition;
mod volume;

pub use crate::probe::Probes;
pub use prepared::{
    Arithmetic, CandidateError, Counts, GpuBench, Lit, Recipe, Surroundings, Timed, prepare, prepare_radiance,
    prepare_volume, probe_device,
};
pub use transition::{FarField, Transition, direct_shares, light_errors, nearer_than_served};
pub use volume::{Reading, along_path};

use rayon::prelude::*;

use crate::light::{self, DIRECT_ORDER, Light, LightModel, ModelledLight};
use crate::math::{Real, Rgb, Vector3};
use crate::probe::{GradientSource, ProbeDevice, Prober, Sampled, sample_lights};
use crate::rig::{AnyRig, LocalPoints, Model, Rig, RigModel, SampleRequest, ShVectors};
use crate::scene::{OrientedBox, SurfacePoint};
use crate::sh::{Lobe, Window};
use crate::trace::{Counters, Transport};
use crate::with_order;

/// A rig over one receiver's box, ready to be set up for the lights of a frame.
#[derive(Clone, Debug)]
pub struct RigStage<T> {
    pub rig: AnyRig,
    pub bounds: OrientedBox,
    pub order: usize,
    pub gradients: GradientSource,
    pub window: Window,
    pub lobe: Lobe<T>,
    /// The lights relative to the box's centre, with the formulas that answer for them.
    pub lights: Vec<ModelledLight<T>>,
    requests: Vec<SampleRequest>,
    /// Samples that were taken before the first frame, with what they took: a bake, where the lights are not projected every frame.
    baked: Option<Bake<T>>,
}

/// Samples taken ahead of time.
#[derive(Clone, Debug)]
struct Bake<T> {
    sampled: Sampled<T>,
    counters: Counters,
    seconds: f64,
}

/// A rig's parameters for the lights of a frame.
#[derive(Clone, Debug)]
pub struct FittedRig<T> {
    pub model: Model<T>,
    /// Radiance coefficients of the vectors that the rig keeps.
    pub radiance: ShVectors<T>,
    /// The same after convolution with the receiver's lobe.
    pub irradiance: ShVectors<T>,
    pub projections: u64,
    pub singular: u64,
    /// Condition number, where the fit solved a system.
    pub condition: Option<f64>,
}

impl<T: Real> RigStage<T> {
    pub fn new(
        rig: &AnyRig,
        bounds: OrientedBox,
        order: usize,
        lights: &[Light<f64>],
        model: LightModel,
        lobe: Lobe<T>,
        gradients: GradientSource,
        window: Window,
    ) -> Self {
        Self {
            rig: rig.clone(),
            bounds,
            order,
            gradients,
            window,
            lobe,
            lights: modelled(lights, model, order, bounds.center),
            requests: rig.placement(bounds.half),
            baked: None,
        }
    }

    /// Takes the samples by rays or captures now; [`RigStage::fit`] then starts from them. For scenes whose static environment blocks and
    /// reflects. `device` takes those that want one.
    pub fn bake(
        &mut self,
        transport: &Transport,
        probes: Probes,
        device: Option<&dyn ProbeDevice>,
    ) -> Result<(), String> {
        let start = std::time::Instant::now();
        let prober = Prober {
            bounds: self.bounds,
            order: self.order,
            lights: &[],
            transport: Some(transport),
            device,
            probes,
            gradients: self.gradients,
            window: self.window,
        };
        let (sampled, counters) = prober.take(&self.requests)?;
        let vectors = sampled.vectors.rounded();
        let sampled = Sampled { vectors, projections: sampled.projections, singular: sampled.singular };
        self.baked = Some(Bake { sampled, counters, seconds: start.elapsed().as_secs_f64() });
        Ok(())
    }

    /// What a bake computed and how long it took, seconds.
    pub fn baked(&self) -> Option<(Counters, f64)> {
        self.baked.as_ref().map(|bake| (bake.counters, bake.seconds))
    }

    /// Projects every light at every sample (or takes what was baked), fits, convolves: what an engine does each frame.
    pub fn fit(&self) -> FittedRig<T> {
        self.fit_to(match &self.baked {
            Some(bake) => bake.sampled.clone(),
            None => sample_lights(&self.lights, &self.bounds, &self.requests, self.order, self.gradients, self.window),
        })
    }

    fn fit_to(&self, sampled: Sampled<T>) -> FittedRig<T> {
        let fit = self.rig.fit(self.bounds.half, sampled.vectors);
        FittedRig {
            model: self.rig.model(self.bounds.half),
            irradiance: fit.vectors.clone().convolved(self.lobe.bands()),
            radiance: fit.vectors,
            projections: sampled.projections,
            singular: sampled.singular,
            condition: fit.condition,
        }
    }
}

/// Points in the coordinates of a box, rounded to `T`.
pub fn local_points<T: Real>(bounds: &OrientedBox, points: &[SurfacePoint]) -> LocalPoints<T> {
    let mut local = LocalPoints::default();
    for point in points {
        local.push(bounds.local(point.position), point.normal);
    }
    local
}

impl<T: Real> FittedRig<T> {
    /// E at every point. One thread: what is timed.
    pub fn irradiance(&self, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        with_order!(self.irradiance.order, C => self.model.irradiance::<C>(&self.irradiance, points, out));
    }

    /// The reconstructed SH radiance vector at box coordinates `q`, as the channels of each coefficient.
    pub fn sh_at(&self, q: Vector3<T>) -> Vec<Rgb<T>> {
        let mut sum = vec![Rgb::zero(); self.radiance.stride() / 3];
        self.model.taps(q, &mut |vector, weight| {
            for (s, c) in sum.iter_mut().zip(self.radiance.vector(vector).chunks_exact(3)) {
                *s += Rgb::new(c[0], c[1], c[2]) * weight;
            }
        });
        sum
    }
}

/// Lights about an origin, each with its formula; tables serve SH of `order`.
fn modelled<T: Real>(
    lights: &[Light<f64>],
    model: LightModel,
    order: usize,
    origin: glam::DVec3,
) -> Vec<ModelledLight<T>> {
    lights.iter().map(|light| model.light(light.relative_to(origin), order)).collect()
}

/// The candidate `direct`: no rig, every light at every point.
pub fn direct<T: Real>(
    lights: &[Light<f64>],
    model: LightModel,
    points: &[SurfacePoint],
    lobe: &Lobe<T>,
    origin: glam::DVec3,
) -> (Vec<Rgb<T>>, u64) {
    let lights = modelled::<T>(lights, model, DIRECT_ORDER, origin);
    let terms: Vec<_> = points
        .par_iter()
        .with_min_len(64)
        .map(|point| light::irradiance(&lights, Vector3::of(point.position - origin), Vector3::of(point.normal), lobe))
        .collect();
    let singular = terms.iter().map(|t| u64::from(t.singular)).sum();
    (terms.into_iter().map(|t| t.value).collect(), singular)
}
