//! A sweep in two phases: pictures and numbers first, each run isolated; then times, alone.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use rayon::prelude::*;
use serde_json::json;

use super::bakery::Bakery;
use super::block::{Block, BlockRequest, Film, Findings, Sampling};
use super::progress::Progress;
use super::timing::{Times, time_block};
use super::{ArrayCache, Claim, Record, Store, StoreError, interrupt};
use crate::candidate::{Arithmetic, GpuBench, Probes, Recipe};
use crate::cost::pareto::front;
use crate::cost::processor_name;
use crate::experiment::{
    ALGORITHMS, Axis, Backend, Candidate, Experiment, Identity, Keep, Key, Precision, ProbeSource, Storage,
    TimingIdentity, Transition,
};
use crate::gpu::{AdapterKind, Gpu};
use crate::math::Rgb;
use crate::metric::{flip_hdr, flip_ldr};
use crate::picture::LayeredImage;
use crate::probe::GradientSource;
use crate::sh::Window;
use crate::trace::{Effects, Effort, SceneFacts, TracedGeometry, Tracer, Transport};

/// How a sweep is run.
#[derive(Clone, Copy, Debug, Default)]
pub struct SweepOptions {
    /// Compute what is there already.
    pub force: bool,
    /// Stop at the first run that fails.
    pub fail_fast: bool,
    /// A missing GPU ends the sweep instead of skipping its rows.
    pub gpu_demanded: bool,
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
}

/// What makes the numbers of a candidate.
pub fn recipe_of(candidate: &Candidate, seed: u64) -> Recipe {
    Recipe {
        rig: candidate.rig().cloned(),
        volume: None,
        order: candidate.order.unwrap_or(3),
        gradients: candidate.gradient_source.unwrap_or(GradientSource::Analytic),
        window: candidate.window.unwrap_or(Window::None),
        probes: match candidate.probe_source {
            Some(ProbeSource::Traced { spp }) => {
                Probes::Traced { effort: spp.map_or(Effort::ACCURATE, |s| Effort::Samples(u64::from(s))), seed }
            }
            _ => Probes::Analytic,
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

/// Runs a sweep of `candidates`; what the store holds already is not computed again.
pub fn sweep(
    experiment: &Experiment,
    candidates: Vec<Candidate>,
    store: &Store,
    options: SweepOptions,
) -> Result<Sweep, SweepError> {
    let identities: Vec<Identity> = candidates.par_iter().map(Candidate::identity).collect();
    let surveyed = store.survey_with_records(&identities, options.force);
    let mut runs: Vec<Run> = candidates
        .into_iter()
        .zip(identities)
        .zip(surveyed)
        .map(|((candidate, identity), (_, record))| Run {
            ending: record.and_then(findings_of).map_or(Ending::Open, |findings| Ending::Ok(Box::new(findings))),
            cached: false,
            times: None,
            timed_on: None,
            adapter: None,
            fronts: Vec::new(),
            flip_hdr: None,
            candidate,
            identity,
        })
        .collect();

    let opened = open_gpu(&runs, options)?;
    let bench = opened.as_ref().and_then(|o| o.as_ref().ok()).cloned();
    let adapter = opened.as_ref().map(|o| match o {
        Ok(bench) => Ok(bench.gpu.adapter().label()),
        Err(why) => Err(why.clone()),
    });
    let driver = bench.as_ref().map(|b| b.gpu.adapter().driver.clone());
    if let Some(Ok(label)) = &adapter {
        for run in runs.iter_mut().filter(|run| run.candidate.backend == Backend::Gpu) {
            run.adapter = Some(label.clone());
        }
    }
    let cache = ArrayCache::at(&experiment.cache_folder());
    let bench = bench.as_ref();
    let bakery = Bakery::default();
    let mut interrupted = numbers(experiment, &mut runs, store, &cache, &bakery, bench, &adapter, options)?;
    if !interrupted {
        interrupted = times(experiment, &mut runs, store, &cache, &bakery, bench, &driver)?;
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
        interrupted = images(experiment, &mut runs, store, &cache, &bakery, bench)?;
    }
    Ok(Sweep { runs, interrupted, adapter, driver })
}

/// The GPU, where a run wants one: opened, or why not.
fn open_gpu(runs: &[Run], options: SweepOptions) -> Result<Option<Result<GpuBench, String>>, SweepError> {
    if !runs.iter().any(|run| run.candidate.backend == Backend::Gpu) {
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
    experiment: &Experiment,
    runs: &mut [Run],
    store: &Store,
    cache: &ArrayCache,
    bakery: &Bakery,
    bench: Option<&GpuBench>,
    adapter: &Option<Result<String, String>>,
    options: SweepOptions,
) -> Result<bool, SweepError> {
    for run in runs.iter_mut() {
        run.cached = run.findings().is_some();
    }
    let wanted: Vec<Vec<usize>> = blocks(runs)
        .into_iter()
        .map(|block| block.into_iter().filter(|i| !runs[*i].cached).collect::<Vec<_>>())
        .filter(|block| !block.is_empty())
        .collect();
    let mut progress = Progress::new("rendering", wanted.iter().map(|b| b.len() as u64).sum());
    for block in wanted {
        if interrupt::interrupted() {
            return Ok(true);
        }
        let no_gpu = adapter.as_ref().and_then(|a| a.as_ref().err());
        let (skipped, todo): (Vec<usize>, Vec<usize>) =
            block.into_iter().partition(|i| runs[*i].candidate.backend == Backend::Gpu && no_gpu.is_some());
        for index in skipped {
            let why = no_gpu.expect("partitioned by it").clone();
            if let Claim::Mine(writer) = store.claim(&runs[index].identity, options.force, true)? {
                writer.skip(&why)?;
            }
            runs[index].ending = Ending::Skipped(why);
            progress.step("skipped: no GPU");
        }
        if todo.is_empty() {
            continue;
        }
        let first = &runs[todo[0]].candidate;
        let orders = orders_of(todo.iter().map(|i| &runs[*i].candidate));
        let picture = (first.lights.instance.index.is_none() && experiment.image.keep != Keep::None)
            .then_some((experiment.image.width as usize, experiment.image.height as usize));
        let stage = Stage::new(experiment, first);
        let film = stage.film(experiment, first, orders, picture, true, cache);
        // the CPU's candidates beside one another, the GPU's one after the other
        let (on_gpu, on_cpu): (Vec<usize>, Vec<usize>) =
            todo.into_iter().partition(|i| runs[*i].candidate.backend == Backend::Gpu);
        // volumes first, one after the other: each bake takes all threads
        let recipes: HashMap<usize, Result<Recipe, String>> = on_cpu
            .iter()
            .chain(&on_gpu)
            .map(|index| (*index, stage.recipe(experiment, &runs[*index].candidate, &film, bakery)))
            .collect();
        let judge = |index: usize| -> Result<Ending, StoreError> {
            compute(&runs[index], &recipes[&index], &stage, &film, store, bench, options.force)
        };
        let mut endings: Vec<(usize, Result<Ending, StoreError>)> =
            on_cpu.into_par_iter().map(|index| (index, judge(index))).collect();
        endings.extend(on_gpu.into_iter().map(|index| (index, judge(index))));
        endings.sort_by_key(|(index, _)| *index);
        for (index, ending) in endings {
            let ending = ending?;
            let label = runs[index].candidate.label();
            if let Ending::Failed(why) = &ending {
                progress.say(&format!(
                    "failed: {label}: {why} (log: {})",
                    store.folder(&runs[index].identity.key()).join("log.txt").display()
                ));
            }
            let failed = matches!(ending, Ending::Failed(_));
            runs[index].ending = ending;
            progress.step(&label);
            if failed && options.fail_fast {
                return Ok(false);
            }
        }
    }
    Ok(false)
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
        let statics = if effects == Effects::NONE { &[][..] } else { &candidate.scene.statics[..] };
        Self { tracer: Tracer::new(&TracedGeometry::of_statics(statics)), effects, why }
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

    /// The recipe of a candidate, with its volume.
    fn recipe(
        &self,
        experiment: &Experiment,
        candidate: &Candidate,
        film: &Film,
        bakery: &Bakery,
    ) -> Result<Recipe, String> {
        let lights = &film.frames[candidate.freeze_frame().unwrap_or(0)].lights;
        let transport = self.is_sampled().then(|| self.transport(lights));
        bakery.stock(recipe_of(candidate, experiment.seed), candidate, lights, transport.as_ref())
    }

    fn transport<'a>(&'a self, lights: &[crate::light::Light<f64>]) -> Transport<'a> {
        Transport::new(&self.tracer, lights, self.effects)
    }

    /// All frames, with what their candidates share. `wanted`: the reference too, not the points alone.
    fn film(
        &self,
        experiment: &Experiment,
        candidate: &Candidate,
        orders: Vec<usize>,
        picture: Option<(usize, usize)>,
        wanted: bool,
        cache: &ArrayCache,
    ) -> Film {
        let scene = &candidate.scene;
        let picture_frame = picture_frame(experiment, scene.frames);
        let frames = (0..scene.frames)
            .map(|frame| {
                let lights = candidate.lights.at(frame, scene.frames);
                let transport = self.is_sampled().then(|| self.transport(&lights));
                let image = picture.filter(|_| frame == picture_frame);
                // exact references of random layouts are computed faster than they are kept
                let keep = wanted && (self.is_sampled() || candidate.lights.instance.index.is_none());
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
                        reference: wanted,
                    },
                    cache,
                )
            })
            .collect();
        Film { frames }
    }
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
    findings.effects = stage.effects.to_string();
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

/// The second phase. True where it was interrupted.
fn times(
    experiment: &Experiment,
    runs: &mut [Run],
    store: &Store,
    cache: &ArrayCache,
    bakery: &Bakery,
    bench: Option<&GpuBench>,
    driver: &Option<String>,
) -> Result<bool, SweepError> {
    let machine = processor_name();
    let identity_of = |run: &Run| TimingIdentity {
        machine: machine.clone(),
        adapter: run.adapter.clone(),
        driver: run.adapter.as_ref().and(driver.clone()),
        warmup: experiment.timing.warmup,
        repeat: experiment.timing.repeat,
        algorithms: ALGORITHMS.timing,
    };
    // random layouts are there for rates of quality; what they cost, layouts of as many lights show
    let is_timed = |run: &Run| {
        run.findings().is_some()
            && run.candidate.lights.instance.index.is_none()
            && experiment.timed.as_ref().is_none_or(|only| only.matches(&run.candidate))
    };
    for run in runs.iter_mut().filter(|run| is_timed(run)) {
        let kept = store.timing(&run.identity.key(), &identity_of(run));
        run.times = kept.and_then(|times| serde_json::from_value(times).ok());
        run.timed_on = run.times.is_some().then(|| identity_of(run));
    }
    let wanted: Vec<Vec<usize>> = blocks(runs)
        .into_iter()
        // a block is timed whole, so that its candidates stand in one shuffle
        .map(|block| block.into_iter().filter(|i| is_timed(&runs[*i])).collect::<Vec<_>>())
        .filter(|block| block.iter().any(|i| runs[*i].times.is_none()))
        .collect();
    let rounds = (experiment.timing.warmup + experiment.timing.repeat) as usize;
    let mut progress = Progress::new("timing", wanted.iter().map(|b| (b.len() * rounds) as u64).sum());
    for block in wanted {
        let first = &runs[block[0]].candidate;
        let stage = Stage::new(experiment, first);
        let film = stage.film(experiment, first, Vec::new(), None, false, cache);
        let frame = &film.frames[first.freeze_frame().unwrap_or(picture_frame(experiment, film.frames.len()))];
        let transport = stage.is_sampled().then(|| stage.transport(&frame.lights));
        let recipe = |i: &usize| stage.recipe(experiment, &runs[*i].candidate, &film, bakery);
        let stocked: Vec<Result<Recipe, String>> = block.iter().map(recipe).collect();
        for (index, why) in block.iter().zip(&stocked).filter_map(|(i, recipe)| Some((*i, recipe.as_ref().err()?))) {
            progress.say(&format!("not timed: {}: {why}", runs[index].candidate.label()));
        }
        let block: Vec<usize> = block.iter().zip(&stocked).filter(|(_, r)| r.is_ok()).map(|(i, _)| *i).collect();
        let recipes: Vec<Recipe> = stocked.into_iter().flatten().collect();
        let label = format!("{} {}", first.scene.name, first.lights.name());
        let timed = time_block(
            frame,
            &recipes,
            experiment.timing,
            transport.as_ref(),
            bench,
            experiment.seed,
            &interrupt::interrupted,
            &mut || progress.step(&label),
        );
        let Some(timed) = timed else { return Ok(true) };
        for (index, times) in block.into_iter().zip(timed) {
            match times {
                Ok(times) => {
                    let json = serde_json::to_value(&times).expect("times are plain JSON");
                    store.keep_timing(&runs[index].identity.key(), &identity_of(&runs[index]), &json)?;
                    runs[index].timed_on = Some(identity_of(&runs[index]));
                    runs[index].times = Some(times);
                }
                Err(why) => progress.say(&format!("not timed: {}: {why}", runs[index].candidate.label())),
            }
        }
    }
    Ok(false)
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
    experiment: &Experiment,
    runs: &mut [Run],
    store: &Store,
    cache: &ArrayCache,
    bakery: &Bakery,
    bench: Option<&GpuBench>,
) -> Result<bool, SweepError> {
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
        if !keep[index] && store.image(&run.identity.key()).exists() {
            store.drop_image(&run.identity.key())?;
        }
    }
    let hdr_key = |run: &Run| Key::of(&json!({ "flip_hdr": run.identity.key().hex() }));
    for run in runs.iter_mut().filter(|run| !run.fronts.is_empty()) {
        let kept = cache.load(&hdr_key(run));
        run.flip_hdr = kept.and_then(|arrays| arrays.get("flip_hdr").and_then(|values| values.first().copied()));
    }
    let is_done = |run: &Run| store.has_image(&run.identity.key()) && (run.fronts.is_empty() || run.flip_hdr.is_some());
    let wanted: Vec<Vec<usize>> = blocks(runs)
        .into_iter()
        .map(|block| block.into_iter().filter(|i| keep[*i] && !is_done(&runs[*i])).collect::<Vec<_>>())
        .filter(|block| !block.is_empty())
        .collect();
    let mut progress = Progress::new("images", wanted.iter().map(|b| b.len() as u64).sum());
    let size = (experiment.image.width as usize, experiment.image.height as usize);
    for block in wanted {
        if interrupt::interrupted() {
            return Ok(true);
        }
        let first = &runs[block[0]].candidate;
        let stage = Stage::new(experiment, first);
        let orders = Vec::new();
        let film = stage.film(experiment, first, orders, Some(size), true, cache);
        let frame = picture_frame(experiment, film.frames.len());
        let Some(view) = &film.frames[frame].view else { continue };
        let reference = view.picture(&view.reference);
        let transports = stage.transports(&film);
        let recipes: HashMap<usize, Result<Recipe, String>> = block
            .iter()
            .map(|index| (*index, stage.recipe(experiment, &runs[*index].candidate, &film, bakery)))
            .collect();
        let done: Vec<(usize, Result<Option<f64>, String>)> = block
            .into_par_iter()
            .map(|index| {
                let run = &runs[index];
                let recipe = recipes[&index].clone();
                let picture = || -> Result<Option<f64>, String> {
                    let recipe = recipe?;
                    let cast = film
                        .cast(&recipe, run.candidate.freeze_frame(), &transports, bench)
                        .map_err(|error| error.to_string())?;
                    let irradiance: Vec<Rgb<f64>> =
                        view.irradiance(cast.frame(frame)).map_err(|error| error.to_string())?;
                    let key = run.identity.key();
                    let image = LayeredImage::of_run(
                        &view.layer(&irradiance),
                        &view.layer(&view.reference),
                        Some(&view.albedo()),
                        &key.run(),
                        &serde_json::to_string(&run.identity.configuration).expect("a configuration is plain JSON"),
                    );
                    let bytes = image.to_bytes().map_err(|error| error.to_string())?;
                    store.keep_image(&key, &bytes).map_err(|error| error.to_string())?;
                    if run.fronts.is_empty() {
                        return Ok(None);
                    }
                    Ok(flip_hdr(&reference, &view.picture(&irradiance)).ok().map(|map| map.mean()))
                };
                (index, picture())
            })
            .collect();
        for (index, result) in done {
            let label = runs[index].candidate.label();
            match result {
                Ok(hdr) => {
                    runs[index].flip_hdr = hdr;
                    if let Some(value) = hdr {
                        let arrays =
                            super::Arrays { notes: json!(null), arrays: vec![("flip_hdr".to_owned(), vec![value])] };
                        cache.store(&hdr_key(&runs[index]), &arrays)?;
                    }
                }
                Err(why) => progress.say(&format!("no image: {label}: {why}")),
            }
            progress.step(&label);
        }
    }
    Ok(false)
}
