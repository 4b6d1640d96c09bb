use std::collections::HashMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::transition::{FarField, Transition, direct_shares};
use super::volume::{CpuVolume, GpuVolume, Reading};
use super::{FittedRig, RigStage, direct, local_points, modelled};
use crate::cost::{Samples, seconds_of};
use crate::gpu::{
    CubeCapturer, DirectEvaluator, Evaluator, Gpu, GpuError, PreparedEvaluation, ProbeTracer, Sample, Timing,
    VolumeEvaluator, VolumeFormat, VolumeShape,
};
use crate::light::{self, DIRECT_ORDER, Light, LightModel, ModelledLight, ShaderLight};
use crate::math::{Real, Rgb, Vector3};
use crate::probe::{GradientSource, ProbeDevice, Probes};
use crate::rig::{AnyRig, LocalPoints, Rig};
use crate::scene::{OrientedBox, SurfacePoint};
use crate::sh::ShVectors;
use crate::sh::{Lobe, MAX_ORDER, Window};
use crate::trace::{Counters, Transport};
use crate::volume::BakedVolume;

/// How a candidate lights a receiver: everything of its configuration that changes its numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// `None` is `direct`: every light at every point.
    pub rig: Option<AnyRig>,
    /// A volume with its samples, in place of a rig.
    pub volume: Option<Arc<BakedVolume>>,
    /// Where lights move, the volume of every frame; `volume` is the first of them. Empty: one serves all frames.
    pub volume_of_frame: Vec<Arc<BakedVolume>>,
    /// Whether each frame has a volume of its own: then a bake is a part of each frame's set-up.
    pub volume_every_frame: bool,
    pub order: usize,
    pub gradients: GradientSource,
    pub window: Window,
    pub probes: Probes,
    /// The formulas of the lights.
    pub lights: LightModel,
    /// When a light leaves the rig and is evaluated directly.
    pub transition: Option<Transition>,
    pub arithmetic: Arithmetic,
}

impl Recipe {
    /// Exact lights, their closed forms as probes, no window, every light in the rig.
    pub fn new(rig: Option<AnyRig>, order: usize, arithmetic: Arithmetic) -> Self {
        Self {
            rig,
            volume: None,
            volume_of_frame: Vec::new(),
            volume_every_frame: false,
            order,
            gradients: GradientSource::Analytic,
            window: Window::None,
            probes: Probes::Analytic,
            lights: LightModel::EXACT,
            transition: None,
            arithmetic,
        }
    }
}

impl Recipe {
    /// The volume that a frame reads.
    pub fn volume_in(&self, frame: usize) -> Option<&Arc<BakedVolume>> {
        self.volume_of_frame.get(frame).or(self.volume.as_ref())
    }

    /// Every volume that was baked for it.
    pub fn volumes(&self) -> &[Arc<BakedVolume>] {
        match &self.volume_of_frame[..] {
            [] => self.volume.as_slice(),
            all => all,
        }
    }
}

/// Where and in what precision a candidate is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arithmetic {
    CpuF32,
    CpuF64,
    /// f32, parameters in a storage buffer.
    GpuBuffer,
    /// f32, parameters in hardware-filtered volume textures.
    GpuTexture,
}

impl Arithmetic {
    pub fn on_gpu(self) -> bool {
        matches!(self, Arithmetic::GpuBuffer | Arithmetic::GpuTexture)
    }
}

/// What a candidate is set up for: one receiver's box under the lights of one frame.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    pub bounds: OrientedBox,
    pub lights: &'a [Light<f64>],
    /// a of the receiver's wrap lobe.
    pub wrap: f64,
    /// The static environment under these lights, for probes by rays.
    pub transport: Option<&'a Transport<'a>>,
}

/// What a candidate keeps and what it took, by counting. `None` where a thing has no meaning for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Counts {
    pub sh_vectors: Option<u64>,
    pub projections: Option<u64>,
    pub direct_lights: Option<u64>,
    pub model_bytes: Option<u64>,
    /// Condition number, where a fit solved a system.
    pub condition: Option<f64>,
    pub singular: u64,
    /// What probe samples by rays computed.
    pub rays: Counters,
}

impl Counts {
    /// Of several receivers: costs add up; the worst condition counts.
    pub fn and(self, other: Self) -> Self {
        let sum = |a: Option<u64>, b: Option<u64>| a.map_or(b, |a| Some(a + b.unwrap_or(0)));
        Self {
            sh_vectors: sum(self.sh_vectors, other.sh_vectors),
            projections: sum(self.projections, other.projections),
            direct_lights: sum(self.direct_lights, other.direct_lights),
            model_bytes: sum(self.model_bytes, other.model_bytes),
            condition: match (self.condition, other.condition) {
                (Some(a), Some(b)) => Some(a.max(b)),
                (a, b) => a.or(b),
            },
            singular: self.singular + other.singular,
            rays: self.rays + other.rays,
        }
    }
}

/// A rig's pipeline on the GPU.
#[derive(Clone)]
pub(super) enum Pipeline {
    Buffer(Evaluator),
    Texture(VolumeEvaluator),
}

impl Pipeline {
    pub fn evaluate(&self, vectors: &ShVectors<f32>, points: &LocalPoints<f32>) -> Result<Vec<Rgb<f32>>, GpuError> {
        match self {
            Pipeline::Buffer(evaluator) => evaluator.evaluate(vectors, points),
            Pipeline::Texture(evaluator) => evaluator.evaluate(vectors, points),
        }
    }

    pub fn prepare(
        &self,
        vectors: &ShVectors<f32>,
        points: &LocalPoints<f32>,
        total: usize,
    ) -> Result<PreparedEvaluation, GpuError> {
        match self {
            Pipeline::Buffer(evaluator) => evaluator.prepare(vectors, points, total),
            Pipeline::Texture(evaluator) => evaluator.prepare(vectors, points, total),
        }
    }

    pub fn parameter_bytes(&self, vectors: &ShVectors<f32>) -> u64 {
        match self {
            Pipeline::Buffer(_) => Evaluator::parameter_bytes(vectors),
            Pipeline::Texture(evaluator) => evaluator.shape().bytes(),
        }
    }

    pub fn once(&self) -> Duration {
        match self {
            Pipeline::Buffer(evaluator) => evaluator.once(),
            Pipeline::Texture(evaluator) => evaluator.once(),
        }
    }
}

/// The device with the pipelines compiled so far, by shader text: boxes and rigs that are alike share a pipeline.
#[derive(Clone)]
pub struct GpuBench {
    pub gpu: Gpu,
    pipelines: Arc<Mutex<HashMap<(String, usize), Pipeline>>>,
    directs: Arc<Mutex<HashMap<String, DirectEvaluator>>>,
}

/// Format of a lattice's volume textures: what engines ship.
const VOLUME_FORMAT: VolumeFormat = VolumeFormat::Rgba16Float;

impl GpuBench {
    pub fn new(gpu: Gpu) -> Self {
        Self { gpu, pipelines: Arc::default(), directs: Arc::default() }
    }

    pub(super) fn pipeline(
        &self,
        rig: &AnyRig,
        half: [f64; 3],
        order: usize,
        texture: bool,
    ) -> Result<Pipeline, CandidateError> {
        let shape = match texture {
            false => None,
            true => match VolumeShape::of_rig(rig, half, order, VOLUME_FORMAT) {
                None => return Err(CandidateError::NoTexture(rig.key())),
                some => some,
            },
        };
        let text = shape.map_or_else(|| rig.wgsl(half), |shape| shape.wgsl());
        let key = (text, order);
        let known = self.pipelines.lock().expect("no holder panics").get(&key).cloned();
        let made = match (known, shape) {
            (Some(known), _) => known,
            (None, Some(shape)) => Pipeline::Texture(VolumeEvaluator::new(&self.gpu, shape)?),
            (None, None) => Pipeline::Buffer(Evaluator::new(&self.gpu, &key.0, order)?),
        };
        self.pipelines.lock().expect("no holder panics").insert(key, made.clone());
        Ok(match made {
            Pipeline::Buffer(evaluator) => Pipeline::Buffer(evaluator.with_rows(rig.wgsl_rows(half))),
            texture => texture,
        })
    }

    fn direct(&self, lights: &[impl ShaderLight], lobe: &Lobe<f32>) -> Result<DirectEvaluator, GpuError> {
        let text = DirectEvaluator::model(lights, lobe)?;
        if let Some(known) = self.directs.lock().expect("no holder panics").get(&text) {
            return Ok(known.clone());
        }
        let made = DirectEvaluator::with_model(&self.gpu, lights, &text)?;
        self.directs.lock().expect("no holder panics").insert(text, made.clone());
        Ok(made)
    }
}

/// Why a candidate could not be set up or evaluated.
#[derive(Debug, thiserror::Error)]
pub enum CandidateError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("the candidate wants a GPU and none was opened")]
    NoGpu,
    #[error("this rig `{0}` has no volume texture; a trilinear lattice has")]
    NoTexture(&'static str),
    #[error(
        "this `{0}` is too large for its twin on the GPU: its cells and samples are numbered in f32, exact up to 16,777,216"
    )]
    NoGpuVolume(&'static str),
    #[error(
        "the light model `{word}` of a {shape} knows the clamped cosine alone, and the receiver's material has a wrap"
    )]
    NoWrap { shape: &'static str, word: &'static str },
    /// What went wrong before, where it was not this call that failed.
    #[error("{0}")]
    Earlier(String),
}

/// A candidate set up for its surroundings: it lights points, says what it keeps, and can be timed.
pub trait Lit: Send + Sync {
    /// E at every point, unclamped.
    fn irradiance(&self, points: &[SurfacePoint]) -> Result<Vec<Rgb<f64>>, CandidateError>;
    fn counts(&self) -> Counts;
    /// Ready for timing over `total` points, the given ones repeated.
    fn timed<'a>(&'a self, points: &[SurfacePoint], total: usize) -> Result<Box<dyn Timed + 'a>, CandidateError>;
}

/// One candidate's work, to be timed piece by piece between the pieces of others.
pub trait Timed {
    /// One frame's set-up with nothing cached: projections, fit, upload. Seconds.
    fn setup(&mut self) -> Result<f64, CandidateError>;
    /// One evaluation over all points; its time is kept.
    fn evaluate(&mut self) -> Result<(), CandidateError>;
    /// The evaluations so far, nanoseconds a point, and the clock they come from.
    fn evaluations(&self) -> Result<(Samples, &'static str), CandidateError>;
    /// Forgets the evaluations so far: they were warm-up.
    fn forget(&mut self);
    /// What is paid once: pipelines, tables. Seconds; `None` where there is nothing.
    fn once(&self) -> Option<f64>;
}

/// Sets up what a receiver reads of a volume.
pub fn prepare_volume(
    baked: &Arc<BakedVolume>,
    arithmetic: Arithmetic,
    around: &Surroundings,
    reading: Reading,
    gpu: Option<&GpuBench>,
) -> Result<Box<dyn Lit>, CandidateError> {
    let bands = *Lobe::<f64>::new(around.wrap).bands();
    prepare_bands(baked, arithmetic, around, reading, gpu, bands)
}

/// The same without the receiver's lobe: what it lights a point with is the radiance from its normal's direction.
pub fn prepare_radiance(
    baked: &Arc<BakedVolume>,
    arithmetic: Arithmetic,
    around: &Surroundings,
    reading: Reading,
    gpu: Option<&GpuBench>,
) -> Result<Box<dyn Lit>, CandidateError> {
    prepare_bands(baked, arithmetic, around, reading, gpu, [1.0; MAX_ORDER])
}

fn prepare_bands(
    baked: &Arc<BakedVolume>,
    arithmetic: Arithmetic,
    around: &Surroundings,
    reading: Reading,
    gpu: Option<&GpuBench>,
    bands: [f64; MAX_ORDER],
) -> Result<Box<dyn Lit>, CandidateError> {
    let single = bands.map(|band| band as f32);
    Ok(match arithmetic {
        Arithmetic::CpuF64 => Box::new(CpuVolume::<f64>::new(baked.clone(), around.bounds, bands, reading)),
        Arithmetic::CpuF32 => Box::new(CpuVolume::<f32>::new(baked.clone(), around.bounds, single, reading)),
        Arithmetic::GpuBuffer | Arithmetic::GpuTexture => {
            let bench = gpu.ok_or(CandidateError::NoGpu)?;
            let texture = arithmetic == Arithmetic::GpuTexture;
            Box::new(GpuVolume::new(baked.clone(), around, reading, bench, texture, &single)?)
        }
    })
}

/// What takes the probe samples that want a GPU; none where rays or closed forms give them.
pub fn probe_device(
    probes: Probes,
    transport: Option<&Transport>,
    gpu: Option<&GpuBench>,
) -> Result<Option<Box<dyn ProbeDevice>>, CandidateError> {
    match (probes, transport) {
        (Probes::Captured { on_gpu: true, seed, .. }, Some(transport)) => {
            let bench = gpu.ok_or(CandidateError::NoGpu)?;
            Ok(Some(Box::new(CubeCapturer::new(&bench.gpu, transport, seed)?)))
        }
        (Probes::TracedOnGpu { seed, .. }, Some(transport)) => {
            let bench = gpu.ok_or(CandidateError::NoGpu)?;
            Ok(Some(Box::new(ProbeTracer::of_transport(&bench.gpu, transport, seed)?)))
        }
        _ => Ok(None),
    }
}

/// Sets a recipe up.
pub fn prepare(recipe: &Recipe, around: &Surroundings, gpu: Option<&GpuBench>) -> Result<Box<dyn Lit>, CandidateError> {
    if let Some(baked) = &recipe.volume {
        return prepare_volume(baked, recipe.arithmetic, around, Reading::default(), gpu);
    }
    if around.wrap != 0.0
        && let Some((shape, word)) = recipe.lights.without_wrap(around.lights)
    {
        return Err(CandidateError::NoWrap { shape, word });
    }
    if let (Some(transition), Some(rig)) = (recipe.transition, &recipe.rig) {
        return Ok(Box::new(NearAndFar::new(transition, rig, recipe, around, gpu)?));
    }
    Ok(match (&recipe.rig, recipe.arithmetic) {
        (None, Arithmetic::CpuF64) => Box::new(Direct::<f64>::new(recipe, around)),
        (None, Arithmetic::CpuF32) => Box::new(Direct::<f32>::new(recipe, around)),
        (Some(rig), Arithmetic::CpuF64) => Box::new(CpuRig::<f64>::new(rig, recipe, around, gpu)?),
        (Some(rig), Arithmetic::CpuF32) => Box::new(CpuRig::<f32>::new(rig, recipe, around, gpu)?),
        (rig, Arithmetic::GpuBuffer | Arithmetic::GpuTexture) => {
            let bench = gpu.ok_or(CandidateError::NoGpu)?;
            let texture = recipe.arithmetic == Arithmetic::GpuTexture;
            match rig {
                Some(rig) => Box::new(GpuRig::new(rig, recipe, around, bench, texture)?),
                None => Box::new(GpuDirect::new(recipe, around, bench)?),
            }
        }
    })
}

/// `direct` on the CPU.
struct Direct<T> {
    lights: Vec<Light<f64>>,
    model: LightModel,
    lobe: Lobe<T>,
    bounds: OrientedBox,
}

impl<T: Real> Direct<T> {
    fn new(recipe: &Recipe, around: &Surroundings) -> Self {
        let lights = around.lights.to_vec();
        Self { lights, model: recipe.lights, lobe: Lobe::new(around.wrap), bounds: around.bounds }
    }

    /// The lights about the box's centre.
    fn relative_lights(&self) -> Vec<ModelledLight<T>> {
        modelled(&self.lights, self.model, DIRECT_ORDER, self.bounds.center)
    }

    /// The tables that its formulas read: their size and the seconds that building them took.
    fn tables(&self) -> Option<(u64, f64)> {
        self.relative_lights().iter().find_map(|light| match light {
            ModelledLight::DiskTable(model) => Some((model.table.bytes() as u64, model.table.built_in())),
            ModelledLight::SphereTable(model) => Some((4 * model.1.texels().len() as u64, 0.0)),
            _ => None,
        })
    }
}

impl<T: Real> Lit for Direct<T> {
    fn irradiance(&self, points: &[SurfacePoint]) -> Result<Vec<Rgb<f64>>, CandidateError> {
        let sums = direct(&self.lights, self.model, points, &self.lobe, self.bounds.center).0;
        Ok(sums.iter().map(|e| e.to_double()).collect())
    }

    fn counts(&self) -> Counts {
        let model_bytes = self.tables().map(|(bytes, _)| bytes);
        Counts { direct_lights: Some(self.lights.len() as u64), model_bytes, ..Counts::default() }
    }

    fn timed<'a>(&'a self, points: &[SurfacePoint], total: usize) -> Result<Box<dyn Timed + 'a>, CandidateError> {
        let center = self.bounds.center;
        Ok(Box::new(TimedDirect {
            direct: self,
            lights: Vec::new(),
            rounds: rounds(points, total),
            points: points.iter().map(|p| (Vector3::of(p.position - center), Vector3::of(p.normal))).collect(),
            out: vec![Rgb::zero(); points.len()],
            times: CpuTimes::default(),
        }))
    }
}

/// The bookkeeping of [`Timed`] for a struct with `times: CpuTimes`.
macro_rules! cpu_times {
    () => {
        fn evaluations(&self) -> Result<(Samples, &'static str), CandidateError> {
            Ok((self.times.0.clone(), "monotonic"))
        }

        fn forget(&mut self) {
            self.times.0.0.clear();
        }
    };
}

struct TimedDirect<'a, T: Real> {
    direct: &'a Direct<T>,
    lights: Vec<ModelledLight<T>>,
    /// How often the points are gone through in one evaluation.
    rounds: usize,
    points: Vec<(Vector3<T>, Vector3<T>)>,
    out: Vec<Rgb<T>>,
    times: CpuTimes,
}

impl<T: Real> Timed for TimedDirect<'_, T> {
    fn setup(&mut self) -> Result<f64, CandidateError> {
        let (direct, lights) = (self.direct, &mut self.lights);
        Ok(seconds_of(|| *lights = direct.relative_lights()))
    }

    fn evaluate(&mut self) -> Result<(), CandidateError> {
        if self.lights.is_empty() {
            self.setup()?;
        }
        let (lights, lobe) = (&self.lights, &self.direct.lobe);
        let seconds = seconds_of(|| {
            for _ in 0..self.rounds {
                for (e, (p, n)) in self.out.iter_mut().zip(&self.points) {
                    *e = light::irradiance(lights, *p, *n, lobe).value;
                }
                std::hint::black_box(&mut self.out);
            }
        });
        self.times.push(seconds, self.rounds * self.points.len());
        Ok(())
    }

    cpu_times!();

    fn once(&self) -> Option<f64> {
        self.direct.tables().map(|(_, seconds)| seconds)
    }
}

/// A rig on the CPU.
struct CpuRig<T: Real> {
    stage: RigStage<T>,
    fitted: FittedRig<T>,
}

impl<T: Real> CpuRig<T> {
    fn new(
        rig: &AnyRig,
        recipe: &Recipe,
        around: &Surroundings,
        gpu: Option<&GpuBench>,
    ) -> Result<Self, CandidateError> {
        let stage = stage(rig, recipe, around, gpu)?;
        Ok(Self { fitted: stage.fit(), stage })
    }
}

fn stage<T: Real>(
    rig: &AnyRig,
    recipe: &Recipe,
    around: &Surroundings,
    gpu: Option<&GpuBench>,
) -> Result<RigStage<T>, CandidateError> {
    let lobe = Lobe::new(around.wrap);
    let mut stage = RigStage::new(
        rig,
        around.bounds,
        recipe.order,
        around.lights,
        recipe.lights,
        lobe,
        recipe.gradients,
        recipe.window,
    );
    if let Some(transport) = around.transport.filter(|_| recipe.probes != Probes::Analytic) {
        let device = probe_device(recipe.probes, around.transport, gpu)?;
        stage.bake(transport, recipe.probes, device.as_deref()).map_err(CandidateError::Earlier)?;
    }
    Ok(stage)
}

/// Counts of a fitted rig whose model takes `bytes`.
fn rig_counts<T: Real>(stage: &RigStage<T>, fitted: &FittedRig<T>, bytes: u64) -> Counts {
    Counts {
        sh_vectors: Some(fitted.irradiance.count() as u64),
        projections: Some(fitted.projections),
        direct_lights: None,
        model_bytes: Some(bytes),
        condition: fitted.condition,
        singular: fitted.singular,
        rays: stage.baked().map_or(Counters::default(), |(counters, _)| counters),
    }
}

impl<T: Real> Lit for CpuRig<T> {
    fn irradiance(&self, points: &[SurfacePoint]) -> Result<Vec<Rgb<f64>>, CandidateError> {
        let local = local_points(&self.stage.bounds, points);
        let mut out = vec![Rgb::zero(); points.len()];
        self.fitted.irradiance(&local, &mut out);
        Ok(out.iter().map(|e| e.to_double()).collect())
    }

    fn counts(&self) -> Counts {
        rig_counts(&self.stage, &self.fitted, std::mem::size_of_val(&self.fitted.irradiance.data[..]) as u64)
    }

    fn timed<'a>(&'a self, points: &[SurfacePoint], total: usize) -> Result<Box<dyn Timed + 'a>, CandidateError> {
        Ok(Box::new(TimedRig {
            stage: &self.stage,
            fitted: self.fitted.clone(),
            rounds: rounds(points, total),
            out: vec![Rgb::zero(); points.len()],
            times: CpuTimes::default(),
            points: local_points(&self.stage.bounds, points),
        }))
    }
}

struct TimedRig<'a, T: Real> {
    stage: &'a RigStage<T>,
    fitted: FittedRig<T>,
    rounds: usize,
    points: LocalPoints<T>,
    out: Vec<Rgb<T>>,
    times: CpuTimes,
}

impl<T: Real> Timed for TimedRig<'_, T> {
    fn setup(&mut self) -> Result<f64, CandidateError> {
        Ok(seconds_of(|| self.fitted = self.stage.fit()))
    }

    fn evaluate(&mut self) -> Result<(), CandidateError> {
        let seconds = seconds_of(|| {
            for _ in 0..self.rounds {
                self.fitted.irradiance(&self.points, &mut self.out);
                std::hint::black_box(&mut self.out);
            }
        });
        self.times.push(seconds, self.rounds * self.out.len());
        Ok(())
    }

    cpu_times!();

    fn once(&self) -> Option<f64> {
        self.stage.baked().map(|(_, seconds)| seconds)
    }
}

/// A rig that is fitted on the CPU and evaluated on the GPU, as engines do.
struct GpuRig {
    stage: RigStage<f32>,
    fitted: FittedRig<f32>,
    pipeline: Pipeline,
}

impl GpuRig {
    fn new(
        rig: &AnyRig,
        recipe: &Recipe,
        around: &Surroundings,
        bench: &GpuBench,
        texture: bool,
    ) -> Result<Self, CandidateError> {
        let pipeline = bench.pipeline(rig, around.bounds.half, recipe.order, texture)?;
        let stage = stage::<f32>(rig, recipe, around, Some(bench))?;
        Ok(Self { fitted: stage.fit(), stage, pipeline })
    }
}

impl Lit for GpuRig {
    fn irradiance(&self, points: &[SurfacePoint]) -> Result<Vec<Rgb<f64>>, CandidateError> {
        let local = local_points(&self.stage.bounds, points);
        let values = self.pipeline.evaluate(&self.fitted.irradiance, &local)?;
        Ok(values.iter().map(|e| e.to_double()).collect())
    }

    fn counts(&self) -> Counts {
        rig_counts(&self.stage, &self.fitted, self.pipeline.parameter_bytes(&self.fitted.irradiance))
    }

    fn timed<'a>(&'a self, points: &[SurfacePoint], total: usize) -> Result<Box<dyn Timed + 'a>, CandidateError> {
        let local = local_points(&self.stage.bounds, points);
        let prepared = self.pipeline.prepare(&self.fitted.irradiance, &local, total)?;
        let fit = Box::new(|| drop(std::hint::black_box(self.stage.fit())));
        Ok(Box::new(TimedGpu { fit, bake: 0.0, prepared, samples: Vec::new(), once: self.pipeline.once() }))
    }
}

/// `direct` on the GPU, in coordinates about the box's centre along the world's axes.
struct GpuDirect {
    direct: Direct<f32>,
    lights: Vec<ModelledLight<f32>>,
    evaluator: DirectEvaluator,
}

impl GpuDirect {
    fn new(recipe: &Recipe, around: &Surroundings, bench: &GpuBench) -> Result<Self, CandidateError> {
        let direct = Direct::<f32>::new(recipe, around);
        let lights = direct.relative_lights();
        Ok(Self { evaluator: bench.direct(&lights, &direct.lobe)?, lights, direct })
    }

    fn points(&self, points: &[SurfacePoint]) -> LocalPoints<f32> {
        let mut local = LocalPoints::default();
        for point in points {
            local.push(point.position - self.direct.bounds.center, point.normal);
        }
        local
    }
}

impl Lit for GpuDirect {
    fn irradiance(&self, points: &[SurfacePoint]) -> Result<Vec<Rgb<f64>>, CandidateError> {
        let values = self.evaluator.evaluate(&self.lights, &self.points(points))?;
        Ok(values.iter().map(|e| e.to_double()).collect())
    }

    fn counts(&self) -> Counts {
        self.direct.counts()
    }

    fn timed<'a>(&'a self, points: &[SurfacePoint], total: usize) -> Result<Box<dyn Timed + 'a>, CandidateError> {
        let prepared = self.evaluator.prepare(&self.lights, &self.points(points), total)?;
        let fit = Box::new(|| drop(std::hint::black_box(self.direct.relative_lights())));
        Ok(Box::new(TimedGpu { fit, bake: 0.0, prepared, samples: Vec::new(), once: self.evaluator.once() }))
    }
}

/// A rig for the lights that it holds well, and the others directly; a light between the two is in both, each with its share.
struct NearAndFar {
    transition: Transition,
    far: Box<dyn Lit>,
    near: Option<Box<dyn Lit>>,
    /// What the criterion looks at.
    rig: AnyRig,
    bounds: OrientedBox,
    recipe: Recipe,
    lights: Vec<Light<f64>>,
    wrap: f64,
    /// Projections for the criterion.
    projections: u64,
}

impl NearAndFar {
    fn new(
        transition: Transition,
        rig: &AnyRig,
        recipe: &Recipe,
        around: &Surroundings,
        gpu: Option<&GpuBench>,
    ) -> Result<Self, CandidateError> {
        let (shares, projections) = shares(transition, rig, recipe, around.bounds, around.lights, around.wrap);
        let part = |of: fn(f64) -> f64| -> Vec<Light<f64>> {
            let lights = around.lights.iter().zip(&shares).filter(|(_, share)| of(**share) > 0.0);
            lights.map(|(light, share)| light.scaled_radiance(of(*share))).collect()
        };
        let (near, far) = (part(|share| share), part(|share| 1.0 - share));
        let recipe = Recipe { transition: None, ..recipe.clone() };
        let direct = Recipe { rig: None, ..recipe.clone() };
        Ok(Self {
            transition,
            far: prepare(&recipe, &Surroundings { lights: &far, ..*around }, gpu)?,
            near: match near.is_empty() {
                true => None,
                false => Some(prepare(&direct, &Surroundings { lights: &near, ..*around }, gpu)?),
            },
            rig: rig.clone(),
            bounds: around.bounds,
            lights: around.lights.to_vec(),
            wrap: around.wrap,
            recipe,
            projections,
        })
    }
}

/// The share of each light that is evaluated directly, and the projections that finding it took.
fn shares(
    transition: Transition,
    rig: &AnyRig,
    recipe: &Recipe,
    bounds: OrientedBox,
    lights: &[Light<f64>],
    wrap: f64,
) -> (Vec<f64>, u64) {
    let far = FarField {
        rig,
        bounds,
        order: recipe.order,
        lights,
        model: recipe.lights,
        bands: *Lobe::<f64>::new(wrap).bands(),
        gradients: recipe.gradients,
        window: recipe.window,
    };
    direct_shares(transition, &far)
}

impl Lit for NearAndFar {
    fn irradiance(&self, points: &[SurfacePoint]) -> Result<Vec<Rgb<f64>>, CandidateError> {
        let mut sum = self.far.irradiance(points)?;
        if let Some(near) = &self.near {
            for (sum, e) in sum.iter_mut().zip(near.irradiance(points)?) {
                *sum += e;
            }
        }
        Ok(sum)
    }

    fn counts(&self) -> Counts {
        let criterion = Counts { projections: Some(self.projections), direct_lights: Some(0), ..Counts::default() };
        let near = self.near.as_ref().map(|near| near.counts()).unwrap_or_default();
        self.far.counts().and(near).and(criterion)
    }

    fn timed<'a>(&'a self, points: &[SurfacePoint], total: usize) -> Result<Box<dyn Timed + 'a>, CandidateError> {
        let near = self.near.as_ref().map(|near| near.timed(points, total)).transpose()?;
        Ok(Box::new(TimedNearAndFar { whole: self, far: self.far.timed(points, total)?, near }))
    }
}

struct TimedNearAndFar<'a> {
    whole: &'a NearAndFar,
    far: Box<dyn Timed + 'a>,
    near: Option<Box<dyn Timed + 'a>>,
}

impl Timed for TimedNearAndFar<'_> {
    fn setup(&mut self) -> Result<f64, CandidateError> {
        let NearAndFar { transition, rig, bounds, recipe, lights, wrap, .. } = self.whole;
        let mut seconds = seconds_of(|| {
            std::hint::black_box(shares(*transition, rig, recipe, *bounds, lights, *wrap));
        });
        seconds += self.far.setup()?;
        if let Some(near) = &mut self.near {
            seconds += near.setup()?;
        }
        Ok(seconds)
    }

    fn evaluate(&mut self) -> Result<(), CandidateError> {
        self.far.evaluate()?;
        self.near.as_mut().map_or(Ok(()), |near| near.evaluate())
    }

    fn evaluations(&self) -> Result<(Samples, &'static str), CandidateError> {
        let (mut samples, timer) = self.far.evaluations()?;
        if let Some(near) = &self.near {
            for (sum, more) in samples.0.iter_mut().zip(near.evaluations()?.0.0) {
                *sum += more;
            }
        }
        Ok((samples, timer))
    }

    fn forget(&mut self) {
        self.far.forget();
        if let Some(near) = &mut self.near {
            near.forget();
        }
    }

    fn once(&self) -> Option<f64> {
        let near = self.near.as_ref().and_then(|near| near.once());
        self.far.once().map_or(near, |far| Some(far + near.unwrap_or(0.0)))
    }
}

/// How often a sample without a positive time is taken again.
const NO_TIME_RETRIES: usize = 20;

/// Anything evaluated on the GPU: a frame's set-up is what the CPU does first (a rig's fit) and the upload.
pub(super) struct TimedGpu<'a> {
    pub fit: Box<dyn Fn() + 'a>,
    /// Seconds of what comes before that and is not done again for every time.
    pub bake: f64,
    pub prepared: PreparedEvaluation,
    pub samples: Vec<Sample>,
    pub once: Duration,
}

impl Timed for TimedGpu<'_> {
    fn setup(&mut self) -> Result<f64, CandidateError> {
        let fit = seconds_of(|| (self.fit)());
        Ok(self.bake + fit + self.prepared.setup_sample()?.as_secs_f64())
    }

    fn evaluate(&mut self) -> Result<(), CandidateError> {
        // little work on a busy machine may come out at no time at all: that is no measurement, and it is taken again
        for _ in 0..NO_TIME_RETRIES {
            let sample = self.prepared.sample()?;
            if Timing::of(&[sample], self.prepared.points()).is_ok() {
                self.samples.push(sample);
                return Ok(());
            }
        }
        self.samples.push(self.prepared.sample()?);
        Ok(())
    }

    fn evaluations(&self) -> Result<(Samples, &'static str), CandidateError> {
        let timing = Timing::of(&self.samples, self.prepared.points())?;
        Ok((Samples(timing.samples_ns_per_point), timing.timer.name()))
    }

    fn forget(&mut self) {
        self.samples.clear();
    }

    fn once(&self) -> Option<f64> {
        Some(self.once.as_secs_f64())
    }
}

/// Evaluation times on the CPU's monotonic clock.
#[derive(Default)]
pub(super) struct CpuTimes(pub Samples);

impl CpuTimes {
    pub fn push(&mut self, seconds: f64, points: usize) {
        self.0.0.push(seconds * 1e9 / points as f64);
    }
}

/// How often the points must be gone through for at least `total` evaluations.
pub(super) fn rounds(points: &[SurfacePoint], total: usize) -> usize {
    total.div_ceil(points.len().max(1)).max(1)
}
