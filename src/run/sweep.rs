//! A sweep in two phases: pictures and numbers first, each run isolated; then times, alone.

use std::collections::{BTreeMap, HashMap};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use serde_json::json;

use super::bakery::{Bakery, Surrounded};
use super::block::{Block, BlockRequest, Film, Findings, Sampling, View, WALK_PLACES};
use super::crew::{Crew, CrewOptions};
use super::progress::Progress;
use super::slurm::SlurmOptions;
use super::timing::{Times, time_block};
use super::walk::{self, csv_text};
use super::worker::planted_laps;
use super::{ArrayCache, Claim, Reason, Record, Store, StoreError, interrupt, write_atomic};
use crate::candidate::{Arithmetic, GpuBench, Probes, Recipe};
use crate::cost::pareto::front;
use crate::cost::processor_name;
use crate::experiment::{
    ALGORITHMS, Axis, Backend, Candidate, Experiment, Identity, Keep, Key, Precision, ProbeSource, Storage,
    TimingIdentity, Transition,
};
use crate::gpu::{AdapterKind, Gpu};
use crate::light::Light;
use crate::math::Rgb;
use crate::metric::{flip_hdr, flip_ldr};
use crate::picture::LayeredImage;
use crate::probe::GradientSource;
use crate::rig::Rig;
use crate::sh::Window;
use crate::trace::{Effects, Effort, SceneFacts, TracedGeometry, Tracer, Transport};

/// How a sweep is run.
#[derive(Clone, Debug, Default)]
pub struct SweepOptions {
    /// Compute what is there already.
    pub force: bool,
    /// Stop at the first run that fails.
    pub fail_fast: bool,
    /// A missing GPU ends the sweep instead of skipping its rows.
    pub gpu_demanded: bool,
    pub engine: Engine,
    /// Compute these alone; the others stay as they are.
    pub only: Option<Only>,
    /// Compute and time nothing: gather what is there.
    pub gather: bool,
}

/// Where runs are computed.
#[derive(Clone, Debug, Default)]
pub enum Engine {
    /// In this process.
    #[default]
    Here,
    /// In child processes with limits.
    Crew(CrewOptions),
    /// On a Slurm cluster.
    Slurm(SlurmOptions),
}

/// Runs by how they stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Only {
    Failed,
    /// Never run, or not to their end, or skipped.
    Missing,
    /// Computed by another configuration, scene or code; or damaged.
    Stale,
}

impl Only {
    fn takes(self, reason: &Reason) -> bool {
        match reason {
            Reason::Cached | Reason::Forced => false,
            Reason::FailedBefore(_) => self == Only::Failed,
            Reason::New | Reason::Unfinished | Reason::SkippedBefore(_) => self == Only::Missing,
            Reason::Changed(_) | Reason::Damaged(_) => self == Only::Stale,
        }
    }
}

/// How a run ended.
#[derive(Clone, Debug)]
pub enum Ending {
    Ok(Box<Findings>),
    Failed(String),
    /// It could not be done here.
    Skipped(String),
    /// The sweep was interrupted before it.
    Open,
}

/// One run of a sweep.
pub struct Run {
    pub candidate: Candidate,
    pub identity: Identity,
    pub ending: Ending,
    /// Whether it is to be computed.
    pub wanted: bool,
    /// Whether it was there already.
    pub cached: bool,
    pub times: Option<Times>,
    /// On what machine and adapter, and how, they were taken.
    pub timed_on: Option<TimingIdentity>,
    pub adapter: Option<String>,
    /// Fronts of its scene x lights x backend x adapter on which it lies, by metric.
    pub fronts: Vec<&'static str>,
    pub flip_hdr: Option<f64>,
}

impl Run {
    pub fn findings(&self) -> Option<&Findings> {
        match &self.ending {
            Ending::Ok(findings) => Some(findings),
            _ => None,
        }
    }
}

/// What a sweep did.
pub struct Sweep {
    pub runs: Vec<Run>,
    pub interrupted: bool,
    /// The adapter that was opened, or why none was.
    pub adapter: Option<Result<String, String>>,
    pub driver: Option<String>,
}

impl Sweep {
    pub fn failed(&self) -> usize {
        self.runs.iter().filter(|run| matches!(run.ending, Ending::Failed(_))).count()
    }
    pub fn computed(&self) -> usize {
        self.runs.iter().filter(|run| !run.cached && run.findings().is_some()).count()
    }
}

/// Why a sweep could not begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("{0}")]
    NoGpu(String),
    /// A worker or the cluster could not do what it was told.
    #[error("{0}")]
    Engine(String),
}

/// What every phase needs.
pub(super) struct Workshop<'a> {
    pub experiment: &'a Experiment,
    pub store: &'a Store,
    pub cache: &'a ArrayCache,
    pub bakery: &'a Bakery,
    pub bench: Option<&'a GpuBench>,
    /// Why there is no GPU where one is wanted.
    pub no_gpu: Option<String>,
    pub driver: Option<String>,
    pub force: bool,
}

/// What is told of a run while a block is computed.
pub(super) enum Step<'e> {
    Begins,
    Ended(&'e Ending),
}

/// Hears of every step, from any thread.
pub(super) type Tell<'t> = &'t (dyn Fn(usize, Step) + Sync);

/// The folder of where rigs' samples stand in their pictures, by run.
pub(super) const SAMPLES: &str = "samples";
/// The folder of cuts through volumes and of walks in them, by run.
pub(super) const VOLUMES: &str = "volumes";

/// Texels along the edge of a captured face where the experiment does not say.
const FACE: u32 = 32;
/// Paths a texel for what captured surfaces reflect.
const CAPTURE_PATHS: u32 = 4;

/// What makes the numbers of a candidate.
pub fn recipe_of(candidate: &Candidate, seed: u64) -> Recipe {
    Recipe {
        rig: candidate.rig().cloned(),
        volume: None,
        volume_of_frame: Vec::new(),
        volume_every_frame: false,
        order: candidate.order.unwrap_or(3),
        gradients: candidate.gradient_source.unwrap_or(GradientSource::Analytic),
        window: candidate.window.unwrap_or(Window::None),
        probes: match candidate.probe_source {
            Some(ProbeSource::Traced { spp, on }) => {
                let effort = spp.map_or(Effort::ACCURATE, |s| Effort::Samples(u64::from(s)));
                match on {
                    Backend::Cpu => Probes::Traced { effort, seed },
                    Backend::Gpu => Probes::TracedOnGpu { effort, seed },
                }
            }
            Some(ProbeSource::Captured { face, on }) => {
                Probes::Captured { face: face.unwrap_or(FACE), paths: CAPTURE_PATHS, seed, on_gpu: on == Backend::Gpu }
            }
            Some(ProbeSource::Relit { face, iterations }) => {
                Probes::Relit { face: face.unwrap_or(FACE), iterations, seed }
            }
            Some(ProbeSource::Analytic) | None => Probes::Analytic,
        },
        lights: candidate.light_model,
        transition: match candidate.transition {
            Some(Transition::Threshold { threshold, blend }) => {
                Some(crate::candidate::Transition::Error { threshold, blend })
            }
            Some(Transition::Nearer) => Some(crate::candidate::Transition::Nearer),
            Some(Transition::None) | None => None,
        },
        arithmetic: match (candidate.backend, candidate.storage, candidate.precision) {
            (Backend::Gpu, Some(Storage::Texture), _) => Arithmetic::GpuTexture,
            (Backend::Gpu, ..) => Arithmetic::GpuBuffer,
            (Backend::Cpu, _, Precision::F64) => Arithmetic::CpuF64,
            (Backend::Cpu, _, Precision::F32) => Arithmetic::CpuF32,
        },
    }
}

/// Runs whose scene and lights are the same, by index.
fn blocks(runs: &[Run]) -> Vec<Vec<usize>> {
    let mut by_content: HashMap<(String, String), usize> = HashMap::new();
    let mut blocks: Vec<Vec<usize>> = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        let key = (run.identity.scene.clone(), run.identity.lights.clone());
        let block = *by_content.entry(key).or_insert_with(|| {
            blocks.push(Vec::new());
            blocks.len() - 1
        });
        blocks[block].push(index);
    }
    blocks
}

/// A run before anything is known of it.
pub(super) fn run_of(candidate: Candidate, identity: Identity) -> Run {
    Run {
        candidate,
        identity,
        ending: Ending::Open,
        wanted: true,
        cached: false,
        times: None,
        timed_on: None,
        adapter: None,
        fronts: Vec::new(),
        flip_hdr: None,
    }
}

/// Runs a sweep of `candidates`; what the store holds already is not computed again.
pub fn sweep(
    experiment: &Experiment,
    candidates: Vec<Candidate>,
    store: &Store,
    options: &SweepOptions,
) -> Result<Sweep, SweepError> {
    if options.force && !options.gather {
        Bakery::clear(store)?;
    }
    let identities: Vec<Identity> = candidates.par_iter().map(Candidate::identity).collect();
    let surveyed = store.survey_with_records(&identities, options.force);
    let mut runs: Vec<Run> = Vec::with_capacity(candidates.len());
    for ((candidate, identity), (reason, record)) in candidates.into_iter().zip(identities).zip(surveyed) {
        let mut run = run_of(candidate, identity);
        if let Some(findings) = record.and_then(findings_of) {
            (run.ending, run.cached, run.wanted) = (Ending::Ok(Box::new(findings)), true, false);
        } else if options.gather || options.only.is_some_and(|only| !only.takes(&reason)) {
            run.wanted = false;
            run.ending = match reason {
                Reason::FailedBefore(why) => Ending::Failed(why),
                Reason::SkippedBefore(why) => Ending::Skipped(why),
                _ => Ending::Open,
            };
        }
        runs.push(run);
    }

    let elsewhere = options.gather || matches!(options.engine, Engine::Slurm(_));
    let opened = if elsewhere { None } else { open_gpu(&runs, options)? };
    let bench = opened.as_ref().and_then(|o| o.as_ref().ok());
    let adapter = opened.as_ref().map(|o| match o {
        Ok(bench) => Ok(bench.gpu.adapter().label()),
        Err(why) => Err(why.clone()),
    });
    let driver = bench.map(|b| b.gpu.adapter().driver.clone());
    for run in runs.iter_mut().filter(|run| run.candidate.wants_gpu()) {
        run.adapter = match &adapter {
            Some(label) => label.clone().ok(),
            None => run.findings().and_then(|findings| findings.adapter.clone()),
        };
    }
    let cache = ArrayCache::at(&experiment.cache_folder());
    let no_gpu = adapter.as_ref().and_then(|a| a.as_ref().err().cloned());
    let bakery = Bakery::of(store);
    let work =
        Workshop { experiment, store, cache: &cache, bakery: &bakery, bench, no_gpu, driver, force: options.force };
    let mut crew = match &options.engine {
        Engine::Crew(crew) => Some(Crew::new(crew)),
        _ => None,
    };
    let mut interrupted = numbers(&work, &mut runs, options, crew.as_mut())?;
    if !interrupted {
        interrupted = times(&work, &mut runs, options, crew.as_mut(), elsewhere)?;
    }
    fronts(&mut runs);
    let finished: Vec<(Key, Record)> = runs
        .iter()
        .filter_map(|run| {
            let metrics = serde_json::to_value(run.findings()?).expect("findings are plain JSON");
            Some((run.identity.key(), Record { metrics, seconds: 0.0 }))
        })
        .collect();
    if runs.iter().any(|run| !run.cached) {
        store.write_index(&finished)?;
    }
    if !interrupted {
        interrupted = images(&work, &mut runs, options, crew.as_mut())?;
    }
    if !interrupted && !options.gather && runs.iter().all(|run| !matches!(run.ending, Ending::Open)) {
        Bakery::clear(store)?;
    }
    let driver = work.driver.clone();
    Ok(Sweep { runs, interrupted, adapter, driver })
}

/// The GPU, where a run wants one: opened, or why not.
fn open_gpu(runs: &[Run], options: &SweepOptions) -> Result<Option<Result<GpuBench, String>>, SweepError> {
    if !runs.iter().any(|run| run.candidate.wants_gpu()) {
        return Ok(None);
    }
    match Gpu::open(AdapterKind::Any) {
        Ok(gpu) => {
            eprintln!("GPU: {}", gpu.adapter().label());
            Ok(Some(Ok(GpuBench::new(gpu))))
        }
        Err(why) if options.gpu_demanded => Err(SweepError::NoGpu(why.to_string())),
        Err(why) => {
            eprintln!("no usable GPU, going on with the CPU; GPU rows are skipped: {why}");
            Ok(Some(Err(why.to_string())))
        }
    }
}

/// The first phase. True where it was interrupted.
fn numbers(
    work: &Workshop,
    runs: &mut [Run],
    options: &SweepOptions,
    mut crew: Option<&mut Crew>,
) -> Result<bool, SweepError> {
    let wanted: Vec<Vec<usize>> = blocks(runs)
        .into_iter()
        .map(|block| block.into_iter().filter(|i| runs[*i].wanted).collect::<Vec<_>>())
        .filter(|block| !block.is_empty())
        .collect();
    let progress = Mutex::new(Progress::new("rendering", wanted.iter().map(|b| b.len() as u64).sum()));
    let failed = AtomicBool::new(false);
    for block in batches(&options.engine, wanted) {
        if interrupt::interrupted() {
            return Ok(true);
        }
        let told: &[Run] = runs;
        let tell = |index: usize, step: Step| {
            let Step::Ended(ending) = step else { return };
            let mut progress = progress.lock().expect("nothing panics while it tells");
            let label = told[index].candidate.label();
            if let Ending::Failed(why) = ending {
                let log = work.store.folder(&told[index].identity.key()).join("log.txt");
                progress.say(&format!("failed: {label}: {why} (log: {})", log.display()));
                failed.store(true, Ordering::SeqCst);
            }
            progress.step(&label);
        };
        let stop = || interrupt::interrupted() || (options.fail_fast && failed.load(Ordering::SeqCst));
        let endings = match (&options.engine, crew.as_deref_mut()) {
            (Engine::Slurm(slurm), _) => slurm.render(work, told, &block, &tell)?,
            (_, Some(crew)) => crew.render(work, told, &block, &tell, &stop)?,
            (_, None) => render(work, told, &block, &tell)?,
        };
        for (index, ending) in endings {
            if let (Ending::Ok(findings), None) = (&ending, &runs[index].adapter) {
                runs[index].adapter = findings.adapter.clone();
            }
            runs[index].ending = ending;
        }
        if options.fail_fast && failed.load(Ordering::SeqCst) {
            return Ok(false);
        }
    }
    Ok(interrupt::interrupted() && runs.iter().any(|run| run.wanted && matches!(run.ending, Ending::Open)))
}

/// What is handed over at once: a cluster gets all of it.
fn batches(engine: &Engine, blocks: Vec<Vec<usize>>) -> Vec<Vec<usize>> {
    match engine {
        Engine::Slurm(_) if !blocks.is_empty() => vec![blocks.concat()],
        _ => blocks,
    }
}

/// What the runs of a block share.
fn film_of(work: &Workshop, stage: &Stage, runs: &[Run], block: &[usize]) -> Film {
    let first = &runs[block[0]].candidate;
    let image = work.experiment.image;
    let orders = orders_of(block.iter().map(|i| &runs[*i].candidate));
    let picture = (first.lights.instance.index.is_none() && image.keep != Keep::None)
        .then_some((image.width as usize, image.height as usize));
    let cache = if work.force { work.cache.unread() } else { work.cache.clone() };
    let walks = block.iter().any(|i| runs[*i].candidate.volume().is_some());
    stage.film(work.experiment, first, orders, picture, Wanted { reference: true, walks }, &cache)
}

/// Whether what the runs of a candidate's block share is sampled, and whether it is kept.
pub(super) fn reference_is(experiment: &Experiment, candidate: &Candidate) -> (bool, bool) {
    let lights = candidate.lights.at(0, candidate.scene.frames).len();
    let (effects, _) = experiment.effects.resolve(&SceneFacts::of(&candidate.scene, lights));
    let sampled = effects != Effects::NONE;
    (sampled, sampled || candidate.lights.instance.index.is_none())
}

/// Computes what the runs of a block share, and keeps it.
pub(super) fn reference(work: &Workshop, runs: &[Run], block: &[usize]) {
    let stage = Stage::new(work.experiment, &runs[block[0]].candidate);
    film_of(work, &stage, runs, block);
}

/// Computes the runs of a block in this process.
pub(super) fn render(
    work: &Workshop,
    runs: &[Run],
    block: &[usize],
    tell: Tell,
) -> Result<Vec<(usize, Ending)>, StoreError> {
    let (skipped, todo): (Vec<usize>, Vec<usize>) =
        block.iter().partition(|i| runs[**i].candidate.wants_gpu() && work.no_gpu.is_some());
    let mut endings: Vec<(usize, Ending)> = Vec::with_capacity(block.len());
    for index in skipped {
        let why = work.no_gpu.clone().expect("partitioned by it");
        if let Claim::Mine(writer) = work.store.claim(&runs[index].identity, work.force, true)? {
            writer.skip(&why)?;
        }
        let ending = Ending::Skipped(why);
        tell(index, Step::Ended(&ending));
        endings.push((index, ending));
    }
    if todo.is_empty() {
        return Ok(endings);
    }
    let stage = Stage::new(work.experiment, &runs[todo[0]].candidate);
    let film = film_of(work, &stage, runs, &todo);
    // the CPU's candidates beside one another, the GPU's one after the other
    let (on_gpu, on_cpu): (Vec<usize>, Vec<usize>) = todo.into_iter().partition(|i| runs[*i].candidate.wants_gpu());
    // volumes first, one after the other: each bake takes all threads
    let recipes: HashMap<usize, Result<Recipe, String>> = on_cpu
        .iter()
        .chain(&on_gpu)
        .map(|index| {
            if runs[*index].candidate.rig().is_none() && runs[*index].candidate.order.is_some() {
                tell(*index, Step::Begins);
            }
            (*index, stage.recipe(work.experiment, &runs[*index].candidate, &film, work.bakery, work.bench, None))
        })
        .collect();
    let judge = |index: usize| -> Result<(usize, Ending), StoreError> {
        if interrupt::interrupted() {
            return Ok((index, Ending::Open));
        }
        tell(index, Step::Begins);
        let ending = compute(&runs[index], &recipes[&index], &stage, &film, work.store, work.bench, work.force)?;
        tell(index, Step::Ended(&ending));
        Ok((index, ending))
    };
    endings.extend(on_cpu.into_par_iter().map(judge).collect::<Result<Vec<_>, _>>()?);
    endings.extend(on_gpu.into_iter().map(judge).collect::<Result<Vec<_>, _>>()?);
    Ok(endings)
}

/// What a record holds; none where another version of the program wrote it.
fn findings_of(record: Record) -> Option<Findings> {
    serde_json::from_value(record.metrics).ok()
}

fn orders_of<'c>(candidates: impl Iterator<Item = &'c Candidate>) -> Vec<usize> {
    let mut orders: Vec<usize> = candidates.filter_map(|c| c.order).collect();
    orders.sort_unstable();
    orders.dedup();
    orders
}

/// What of the reference is wanted; timing needs the points alone.
#[derive(Clone, Copy, Default)]
struct Wanted {
    reference: bool,
    /// Along the objects' paths.
    walks: bool,
}

/// The static environment of a block's scene and the effects that are simulated in it.
struct Stage {
    tracer: Tracer,
    effects: Effects,
    why: Vec<String>,
}

impl Stage {
    fn new(experiment: &Experiment, candidate: &Candidate) -> Self {
        let lights = candidate.lights.at(0, candidate.scene.frames).len();
        let (effects, why) = experiment.effects.resolve(&SceneFacts::of(&candidate.scene, lights));
        Self { tracer: Tracer::new(&TracedGeometry::of_statics(&candidate.scene.statics)), effects, why }
    }

    /// Whether rays are cast: called for by the scene, or forced.
    fn is_sampled(&self) -> bool {
        self.effects != Effects::NONE
    }

    /// One a frame, where rays are cast.
    fn transports(&self, film: &Film) -> Vec<Transport<'_>> {
        let frames = film.frames.iter().filter(|_| self.is_sampled());
        frames.map(|block| self.transport(&block.lights)).collect()
    }

    /// The recipe of a candidate, with its volume; `only`: with that of one frame alone.
    fn recipe(
        &self,
        experiment: &Experiment,
        candidate: &Candidate,
        film: &Film,
        bakery: &Bakery,
        gpu: Option<&GpuBench>,
        only: Option<usize>,
    ) -> Result<Recipe, String> {
        let frames: Vec<Surrounded> = match candidate.volume() {
            Some(_) => film.frames.iter().map(|block| self.surrounded(block)).collect(),
            None => Vec::new(),
        };
        bakery.stock(recipe_of(candidate, experiment.seed), candidate, &frames, only, gpu)
    }

    fn surrounded<'a>(&'a self, block: &'a Block) -> Surrounded<'a> {
        // geometry that does nothing to light still tells volumes which cells hold any
        let there = self.is_sampled() || self.tracer.triangle_count() > 0;
        Surrounded { lights: &block.lights, transport: there.then(|| self.transport(&block.lights)) }
    }

    fn transport<'a>(&'a self, lights: &[Light<f64>]) -> Transport<'a> {
        Transport::new(&self.tracer, lights, self.effects)
    }

    /// All frames, with what their candidates share, and a picture of one.
    fn film(
        &self,
        experiment: &Experiment,
        candidate: &Candidate,
        orders: Vec<usize>,
        picture: Option<(usize, usize)>,
        wanted: Wanted,
        cache: &ArrayCache,
    ) -> Film {
        let of_frame = picture_frame(experiment, candidate.scene.frames);
        self.film_of(experiment, candidate, orders, &|frame| picture.filter(|_| frame == of_frame), wanted, cache)
    }

    /// As [`Stage::film`], with pictures of any frames, in their sizes.
    fn film_of(
        &self,
        experiment: &Experiment,
        candidate: &Candidate,
        orders: Vec<usize>,
        picture: &dyn Fn(usize) -> Option<(usize, usize)>,
        wanted: Wanted,
        cache: &ArrayCache,
    ) -> Film {
        let scene = &candidate.scene;
        let frames = (0..scene.frames)
            .map(|frame| {
                let lights = candidate.lights.at(frame, scene.frames);
                let transport = self.is_sampled().then(|| self.transport(&lights));
                let image = picture(frame);
                // exact references of random layouts are computed faster than they are kept
                let keep = wanted.reference && (self.is_sampled() || candidate.lights.instance.index.is_none());
                let part = json!({ "frame": frame });
                Block::new(
                    BlockRequest {
                        scene,
                        frame,
                        lights: lights.clone(),
                        orders: orders.clone(),
                        image,
                        key: keep.then(|| candidate.reference_key(&part)),
                        sampled: transport.as_ref().map(|transport| Sampling {
                            transport,
                            settings: experiment.reference,
                            seed: experiment.seed,
                        }),
                        reference: wanted.reference,
                        walk_lights: if wanted.walks && frame == 0 { walk_lights(candidate) } else { Vec::new() },
                    },
                    cache,
                )
            })
            .collect();
        Film { frames }
    }
}

/// The lights along the objects' paths: one list where none moves, else one for each of the places at which the truth is found.
fn walk_lights(candidate: &Candidate) -> Vec<Vec<Light<f64>>> {
    let places = if candidate.lights_move() { WALK_PLACES } else { 1 };
    (0..places).map(|k| candidate.lights.at(k, places)).collect()
}

/// Most frames of an animation of which pictures are kept.
const STRIP: usize = 7;

/// The frames of an animation of which pictures are kept beside the one of [`picture_frame`]: evenly spread, the first and the last among
/// them. None where references are sampled: a noisy picture of every frame costs more than all else.
fn strip(experiment: &Experiment, candidate: &Candidate) -> Vec<usize> {
    let frames = candidate.scene.frames;
    if frames < 2 || reference_is(experiment, candidate).0 {
        return Vec::new();
    }
    let count = STRIP.min(frames);
    let mut strip: Vec<usize> = (0..count).map(|i| i * (frames - 1) / (count - 1)).collect();
    strip.retain(|frame| *frame != picture_frame(experiment, frames));
    strip
}

/// The frame of which pictures are taken.
fn picture_frame(experiment: &Experiment, frames: usize) -> usize {
    experiment.image.frame.unwrap_or(frames / 2).min(frames - 1)
}

/// Computes one run and keeps it; whatever happens inside is the run's own failure.
fn compute(
    run: &Run,
    recipe: &Result<Recipe, String>,
    stage: &Stage,
    film: &Film,
    store: &Store,
    bench: Option<&GpuBench>,
    force: bool,
) -> Result<Ending, StoreError> {
    let mut writer = match store.claim(&run.identity, force, true)? {
        Claim::Mine(writer) => writer,
        Claim::Cached(record) => {
            return Ok(match serde_json::from_value(record.metrics) {
                Ok(findings) => Ending::Ok(Box::new(findings)),
                Err(error) => Ending::Failed(format!("metrics.json of another version: {error}")),
            });
        }
        Claim::Busy => return Ok(Ending::Open),
    };
    writer.log(&run.candidate.label())?;
    let judged = catch_unwind(AssertUnwindSafe(|| judge(run, recipe, stage, film, bench)));
    match judged {
        Ok(Ok(findings)) => {
            keep_tables(run, recipe, stage, film, store)?;
            for (metric, why) in &findings.pooled.reasons {
                writer.log(&format!("{metric}: {why}"))?;
            }
            writer.finish(serde_json::to_value(&findings).expect("findings are plain JSON"))?;
            Ok(Ending::Ok(Box::new(findings)))
        }
        Ok(Err(why)) => {
            writer.fail(&why)?;
            Ok(Ending::Failed(why))
        }
        Err(panic) => {
            let why = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| panic.downcast_ref::<&str>().copied())
                .unwrap_or("no message");
            let why = format!("panic: {why}");
            writer.fail(&why)?;
            Ok(Ending::Failed(why))
        }
    }
}

/// Most samples of a rig that are kept for pictures.
const SEEN_SAMPLES: usize = 64;

/// Keeps where a rig's samples stand in the picture.
fn keep_samples(
    run: &Run,
    recipe: &Recipe,
    block: &Block,
    frame: usize,
    (width, height): (usize, usize),
    store: &Store,
) -> Result<(), StoreError> {
    let (Some(rig), Some(camera)) = (&recipe.rig, &run.candidate.scene.camera) else { return Ok(()) };
    let mut text = "receiver,frame,x,y,z,pixel_x,pixel_y,distance\n".to_owned();
    let mut count = 0;
    for part in &block.parts {
        for request in rig.placement(part.bounds.half) {
            let place = part.bounds.world(request.position);
            let Some([u, v]) = camera.seen_at(place, width, height) else { continue };
            let [x, y, z] = place.to_array();
            let distance = place.distance(camera.eye);
            text += &format!("{},{frame},{x},{y},{z},{u},{v},{distance}\n", csv_text(&part.receiver));
            count += 1;
        }
    }
    if count == 0 || count > SEEN_SAMPLES {
        return Ok(());
    }
    let path = store.root().join(SAMPLES).join(format!("{}.csv", run.identity.key().run()));
    write_atomic(&path, text.as_bytes())
}

/// Keeps a cut through a run's volume and the scene around it, from above, for the debug picture, and the walks of what moves.
fn keep_tables(
    run: &Run,
    recipe: &Result<Recipe, String>,
    stage: &Stage,
    film: &Film,
    store: &Store,
) -> Result<(), StoreError> {
    let Ok(recipe) = recipe else { return Ok(()) };
    let Some(baked) = &recipe.volume else { return Ok(()) };
    let path = |what: &str| store.root().join(VOLUMES).join(format!("{}{what}.csv", run.identity.key().run()));
    let walks = walk::walks(recipe.volumes(), &run.candidate.scene);
    if !walks.is_empty() {
        write_atomic(&path("-walk"), walk::to_csv(&walks, &film.frames[0]).as_bytes())?;
    }
    if baked.volume.is_path() {
        return Ok(());
    }
    write_atomic(&path(""), baked.section(1, stage.tracer.triangles()).to_csv().as_bytes())
}

fn judge(
    run: &Run,
    recipe: &Result<Recipe, String>,
    stage: &Stage,
    film: &Film,
    bench: Option<&GpuBench>,
) -> Result<Findings, String> {
    let recipe = recipe.as_ref().map_err(Clone::clone)?;
    let cast = film
        .cast(recipe, run.candidate.freeze_frame(), &stage.transports(film), bench)
        .map_err(|error| error.to_string())?;
    let mut findings = film.judge(recipe, &cast, stage.tracer.triangles()).map_err(|error| error.to_string())?;
    if recipe.volume.is_some() {
        let jump = walk::walks(recipe.volumes(), &run.candidate.scene).iter().map(walk::Walk::jump).reduce(f64::max);
        findings.pooled.values.extend(jump.map(|jump| ("path_jump".to_owned(), jump)));
    }
    findings.effects = stage.effects.to_string();
    let on_gpu = bench.filter(|_| run.candidate.wants_gpu());
    findings.adapter = on_gpu.map(|bench| bench.gpu.adapter().label());
    findings.effects_why = stage.why.clone();
    let counters = film.counters() + findings.counts.rays;
    for (name, count) in [
        ("shadow_rays", counters.shadow_rays),
        ("closest_rays", counters.closest_rays),
        ("bounces", counters.bounces),
        ("emitter_samples", counters.emitter_samples),
        ("wrap_evaluations", counters.wrap_evaluations),
    ] {
        findings.counters.insert(name.to_owned(), count);
    }
    for (frame, block) in film.frames.iter().enumerate() {
        if let Some(view) = &block.view {
            let irradiance = view.irradiance(cast.frame(frame)).map_err(|error| error.to_string())?;
            let map = flip_ldr(&view.picture(&view.reference), &view.picture(&irradiance));
            match map {
                Ok(map) => findings.flip = Some(map.mean()),
                Err(why) => drop(findings.pooled.reasons.insert("flip".to_owned(), why.to_string())),
            }
        }
    }
    Ok(findings)
}

/// On what and how this process times a run.
fn timing_identity(work: &Workshop, run: &Run) -> TimingIdentity {
    let adapter = work.bench.filter(|_| run.candidate.wants_gpu()).map(|b| b.gpu.adapter().label());
    TimingIdentity {
        machine: processor_name(),
        driver: adapter.as_ref().and(work.driver.clone()),
        adapter,
        warmup: work.experiment.timing.warmup,
        repeat: work.experiment.timing.repeat,
        algorithms: ALGORITHMS.timing,
    }
}

/// The second phase. `elsewhere`: times of any machine count, those of one machine for a whole block. True where it was interrupted.
fn times(
    work: &Workshop,
    runs: &mut [Run],
    options: &SweepOptions,
    mut crew: Option<&mut Crew>,
    elsewhere: bool,
) -> Result<bool, SweepError> {
    let experiment = work.experiment;
    // random layouts are there for rates of quality; what they cost, layouts of as many lights show
    let is_timed = |run: &Run| {
        run.findings().is_some()
            && run.candidate.lights.instance.index.is_none()
            && experiment.timed.as_ref().is_none_or(|only| only.matches(&run.candidate))
    };
    let timed_blocks: Vec<Vec<usize>> = blocks(runs)
        .into_iter()
        .map(|block| block.into_iter().filter(|i| is_timed(&runs[*i])).collect::<Vec<_>>())
        .filter(|block| !block.is_empty())
        .collect();
    let own = [false, true].map(|on_gpu| {
        let first = runs.iter().find(|run| run.candidate.wants_gpu() == on_gpu);
        first.map(|run| timing_identity(work, run))
    });
    let read = |runs: &mut [Run], block: &[usize]| {
        for index in block {
            let run = &mut runs[*index];
            let on = match elsewhere {
                false => own[usize::from(run.candidate.wants_gpu())].clone(),
                true => None,
            };
            if let Some(on) = on {
                let kept = work.store.timing(&run.identity.key(), &on);
                run.times = kept.and_then(|times| serde_json::from_value(times).ok());
                run.timed_on = run.times.is_some().then_some(on);
            }
        }
        if elsewhere {
            read_of_any_machine(work, runs, block);
        }
    };
    for block in &timed_blocks {
        read(runs, block);
    }
    // a block is timed whole, so that its candidates stand in one shuffle
    let wanted: Vec<Vec<usize>> = timed_blocks
        .into_iter()
        .filter(|block| !options.gather && (options.force || block.iter().any(|i| runs[*i].times.is_none())))
        .collect();
    let rounds = (experiment.timing.warmup + experiment.timing.repeat) as usize;
    let mut progress = Progress::new("timing", wanted.iter().map(|b| (b.len() * rounds) as u64).sum());
    if let Engine::Slurm(slurm) = &options.engine {
        slurm.time(work, runs, &wanted)?;
        for block in &wanted {
            read(runs, block);
            for index in block.iter().filter(|i| runs[**i].times.is_none()) {
                progress.say(&format!("not timed: {}", runs[*index].candidate.label()));
            }
        }
        return Ok(interrupt::interrupted());
    }
    for block in wanted {
        if interrupt::interrupted() {
            return Ok(true);
        }
        let first = &runs[block[0]].candidate;
        let label = format!("{} {}", first.scene.name, first.lights.name());
        let failures = match crew.as_deref_mut() {
            Some(crew) => crew.time(work, runs, &block, &mut || progress.step(&label))?,
            None => time(work, runs, &block, &mut || progress.step(&label))?,
        };
        let Some(failures) = failures else { return Ok(true) };
        for (index, why) in failures {
            progress.say(&format!("not timed: {}: {why}", runs[index].candidate.label()));
        }
        read(runs, &block);
    }
    Ok(false)
}

/// The times of a block on the machine on which most of it was timed.
fn read_of_any_machine(work: &Workshop, runs: &mut [Run], block: &[usize]) {
    let timing = work.experiment.timing;
    for on_gpu in [false, true] {
        let members: Vec<usize> = block.iter().copied().filter(|i| runs[*i].candidate.wants_gpu() == on_gpu).collect();
        let kept: Vec<(usize, Vec<(TimingIdentity, serde_json::Value)>)> =
            members.iter().map(|i| (*i, work.store.timings(&runs[*i].identity.key()))).collect();
        let mut machines: BTreeMap<String, (usize, TimingIdentity)> = BTreeMap::new();
        let fits = |on: &TimingIdentity| {
            (on.warmup, on.repeat, on.algorithms) == (timing.warmup, timing.repeat, ALGORITHMS.timing)
        };
        for (on, _) in kept.iter().flat_map(|(_, all)| all).filter(|(on, _)| fits(on)) {
            machines.entry(on.key().hex()).or_insert_with(|| (0, on.clone())).0 += 1;
        }
        let most = machines.values().map(|(count, _)| *count).max();
        let Some((_, chosen)) = machines.into_values().find(|(count, _)| Some(*count) == most) else { continue };
        for (index, all) in kept {
            let found = all.into_iter().find(|(on, _)| *on == chosen);
            let run = &mut runs[index];
            run.times = found.and_then(|(_, times)| serde_json::from_value(times).ok());
            run.timed_on = run.times.is_some().then(|| chosen.clone());
            if run.times.is_some() && on_gpu {
                run.adapter = chosen.adapter.clone();
            }
        }
    }
}

/// What could not be timed in a block, and why; nothing where the timing was interrupted.
pub(super) type NotTimed = Option<Vec<(usize, String)>>;

/// Times the runs of a block in this process and keeps the times.
pub(super) fn time(
    work: &Workshop,
    runs: &[Run],
    block: &[usize],
    step: &mut dyn FnMut(),
) -> Result<NotTimed, StoreError> {
    let experiment = work.experiment;
    let first = &runs[block[0]].candidate;
    let stage = Stage::new(experiment, first);
    let film = stage.film(experiment, first, Vec::new(), None, Wanted::default(), work.cache);
    let number = first.freeze_frame().unwrap_or(picture_frame(experiment, film.frames.len()));
    let frame = &film.frames[number];
    let transport = stage.is_sampled().then(|| stage.transport(&frame.lights));
    let recipe =
        |i: &usize| stage.recipe(experiment, &runs[*i].candidate, &film, work.bakery, work.bench, Some(number));
    let stocked: Vec<Result<Recipe, String>> = block.iter().map(recipe).collect();
    let mut failures: Vec<(usize, String)> = block
        .iter()
        .zip(&stocked)
        .filter_map(|(index, recipe)| Some((*index, recipe.as_ref().err()?.clone())))
        .collect();
    let block: Vec<usize> = block.iter().zip(&stocked).filter(|(_, r)| r.is_ok()).map(|(i, _)| *i).collect();
    let recipes: Vec<Recipe> = stocked.into_iter().flatten().collect();
    let timed = time_block(
        frame,
        &recipes,
        experiment.timing,
        transport.as_ref(),
        work.bench,
        experiment.seed,
        &|i| planted_laps(&runs[block[i]].candidate.label()),
        &interrupt::interrupted,
        step,
    );
    let Some(timed) = timed else { return Ok(None) };
    for (index, times) in block.iter().zip(timed) {
        match times {
            Ok(times) => {
                let json = serde_json::to_value(&times).expect("times are plain JSON");
                work.store.keep_timing(&runs[*index].identity.key(), &timing_identity(work, &runs[*index]), &json)?;
            }
            Err(why) => failures.push((*index, why.to_string())),
        }
    }
    Ok(Some(failures))
}

/// Marks the Pareto fronts of each scene x lights x backend x adapter: error against frame time at a million points.
fn fronts(runs: &mut [Run]) {
    let mut groups: HashMap<(String, String, Backend, Option<String>), Vec<usize>> = HashMap::new();
    for (index, run) in runs.iter().enumerate() {
        let scene = run.candidate.column(Axis::Scene).unwrap_or_default().to_owned();
        let key = (scene, run.candidate.lights.name().to_owned(), run.candidate.backend, run.adapter.clone());
        groups.entry(key).or_default().push(index);
    }
    for members in groups.into_values() {
        for metric in ["nrmse", "interpolation_nrmse"] {
            let points: Vec<(usize, f64, f64)> = members
                .iter()
                .filter_map(|i| {
                    let cost = runs[*i].times.as_ref()?.frame_us(1e6)?;
                    // `direct` keeps no SH and has no such error: it stands on the front of nrmse alone
                    let error = runs[*i].findings()?.pooled.values.get(metric).copied()?;
                    Some((*i, cost, error))
                })
                .collect();
            let on_front = front(&points.iter().map(|(_, c, e)| (Some(*c), Some(*e))).collect::<Vec<_>>());
            for ((index, ..), on) in points.iter().zip(on_front) {
                if on {
                    runs[*index].fronts.push(metric);
                }
            }
        }
    }
}

/// Keeps the images that the experiment asks for, drops the others, and measures HDR FLIP on the fronts. True where interrupted.
fn images(
    work: &Workshop,
    runs: &mut [Run],
    options: &SweepOptions,
    mut crew: Option<&mut Crew>,
) -> Result<bool, SweepError> {
    let (experiment, store) = (work.experiment, work.store);
    let mut one_of_each_rig: std::collections::HashSet<String> = Default::default();
    let mut keep: Vec<bool> = vec![false; runs.len()];
    for (index, run) in runs.iter().enumerate() {
        let pictured = run.findings().is_some() && run.candidate.lights.instance.index.is_none();
        let rig = run.candidate.column(Axis::Rig).unwrap_or_default().to_owned();
        keep[index] = pictured
            && match experiment.image.keep {
                Keep::All => true,
                Keep::None => false,
                Keep::Front => run.fronts.contains(&"nrmse") || one_of_each_rig.insert(rig),
            };
    }
    for (index, run) in runs.iter().enumerate() {
        if !keep[index] && !options.gather && store.image(&run.identity.key()).exists() {
            store.drop_image(&run.identity.key())?;
        }
    }
    for run in runs.iter_mut().filter(|run| !run.fronts.is_empty()) {
        run.flip_hdr = store.flip_hdr(&run.identity.key());
    }
    let is_done = |run: &Run| {
        let key = run.identity.key();
        store.has_image(&key)
            && (run.fronts.is_empty() || run.flip_hdr.is_some())
            && strip(experiment, &run.candidate).iter().all(|frame| store.frame_image(&key, *frame).exists())
    };
    let wanted: Vec<Vec<usize>> = blocks(runs)
        .into_iter()
        .map(|block| block.into_iter().filter(|i| keep[*i] && !is_done(&runs[*i])).collect::<Vec<_>>())
        .filter(|block| !block.is_empty() && !options.gather)
        .collect();
    let mut progress = Progress::new("images", wanted.iter().map(|b| b.len() as u64).sum());
    for block in batches(&options.engine, wanted) {
        if interrupt::interrupted() {
            return Ok(true);
        }
        let failures = match (&options.engine, crew.as_deref_mut()) {
            (Engine::Slurm(slurm), _) => slurm.picture(work, runs, &block)?,
            (_, Some(crew)) => crew.picture(work, runs, &block)?,
            (_, None) => picture(work, runs, &block)?,
        };
        for index in block {
            let label = runs[index].candidate.label();
            if let Some((_, why)) = failures.iter().find(|(failed, _)| *failed == index) {
                progress.say(&format!("no image: {label}: {why}"));
            }
            if !runs[index].fronts.is_empty() {
                runs[index].flip_hdr = store.flip_hdr(&runs[index].identity.key());
            }
            progress.step(&label);
        }
    }
    Ok(false)
}

/// Keeps the images of the runs of a block, and the HDR FLIP of those on a front. Gives what failed, and why.
pub(super) fn picture(work: &Workshop, runs: &[Run], block: &[usize]) -> Result<Vec<(usize, String)>, StoreError> {
    let (experiment, store) = (work.experiment, work.store);
    let size = (experiment.image.width as usize, experiment.image.height as usize);
    let first = &runs[block[0]].candidate;
    let stage = Stage::new(experiment, first);
    let mut strip = strip(experiment, first);
    let frame = picture_frame(experiment, first.scene.frames);
    strip.push(frame);
    let wanted = Wanted { reference: true, walks: false };
    let pictured = |frame: usize| strip.contains(&frame).then_some(size);
    let film = stage.film_of(experiment, first, Vec::new(), &pictured, wanted, work.cache);
    let Some(view) = &film.frames[frame].view else { return Ok(Vec::new()) };
    let reference = view.picture(&view.reference);
    let transports = stage.transports(&film);
    let recipes: HashMap<usize, Result<Recipe, String>> = block
        .iter()
        .map(|index| (*index, stage.recipe(experiment, &runs[*index].candidate, &film, work.bakery, work.bench, None)))
        .collect();
    let one = |index: usize| -> Result<Option<f64>, String> {
        let run = &runs[index];
        let recipe = recipes[&index].as_ref().map_err(Clone::clone)?;
        let cast = film
            .cast(recipe, run.candidate.freeze_frame(), &transports, work.bench)
            .map_err(|error| error.to_string())?;
        let key = run.identity.key();
        let configuration = serde_json::to_string(&run.identity.configuration).expect("a configuration is plain JSON");
        let image_of = |frame: usize, view: &View| -> Result<(Vec<Rgb<f64>>, Vec<u8>), String> {
            let irradiance: Vec<Rgb<f64>> = view.irradiance(cast.frame(frame)).map_err(|error| error.to_string())?;
            let (own, truth) = (view.layer(&irradiance), view.layer(&view.reference));
            let image = LayeredImage::of_run(&own, &truth, Some(&view.albedo()), &key.run(), &configuration);
            Ok((irradiance, image.to_bytes().map_err(|error| error.to_string())?))
        };
        for other in strip.iter().filter(|other| **other != frame) {
            let Some(view) = &film.frames[*other].view else { continue };
            let (_, bytes) = image_of(*other, view)?;
            write_atomic(&store.frame_image(&key, *other), &bytes).map_err(|error| error.to_string())?;
        }
        let (irradiance, bytes) = image_of(frame, view)?;
        store.keep_image(&key, &bytes).map_err(|error| error.to_string())?;
        keep_samples(run, recipe, &film.frames[frame], frame, size, store).map_err(|error| error.to_string())?;
        if run.fronts.is_empty() {
            return Ok(None);
        }
        Ok(flip_hdr(&reference, &view.picture(&irradiance)).ok().map(|map| map.mean()))
    };
    let done: Vec<(usize, Result<Option<f64>, String>)> = block.par_iter().map(|index| (*index, one(*index))).collect();
    let mut failures = Vec::new();
    for (index, result) in done {
        match result {
            Ok(None) => {}
            Ok(Some(value)) => store.keep_flip_hdr(&runs[index].identity.key(), value)?,
            Err(why) => failures.push((index, why)),
        }
    }
    Ok(failures)
}
