//! A sweep on a Slurm cluster: arrays of tasks that share the store. A task is this program on a node, with a crew of its own; it keeps
//! what it computes in the store, and from there the submitting side follows it. Nothing but the store is believed: whatever becomes of a
//! task, the runs that it finished are kept and the others go again.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::bakery::Bakery;
use super::crew::{Crew, CrewOptions, bury};
use super::results::shell_word;
use super::sweep::{Ending, Run, Step, SweepError, Tell, Workshop, reference_is, run_of};
use super::worker::Order;
use super::{ArrayCache, Store, interrupt, write_atomic};
use crate::experiment::{Candidate, Experiment, Key, LimitSettings, Override, ProbeSource, SlurmSettings};
use crate::input::InputError;

/// How a sweep is handed over.
#[derive(Clone, Debug)]
pub struct SlurmOptions {
    pub settings: SlurmSettings,
    /// What a node starts as a worker.
    pub crew: CrewOptions,
}

/// How often a run goes to the cluster before it counts as failed.
const ATTEMPTS: usize = 3;

/// How long the controller may not answer.
const PATIENCE: Duration = Duration::from_secs(600);

/// What the tasks of an array do: `tasks.json` beside their logs.
#[derive(Serialize, Deserialize)]
struct TaskFile {
    experiment: PathBuf,
    changes: Vec<String>,
    out: PathBuf,
    force: bool,
    worker: Vec<String>,
    seconds: f64,
    reference_seconds: f64,
    cpus: u32,
    tasks: Vec<Vec<Order>>,
}

/// An array that was handed over.
struct Array {
    id: String,
    folder: PathBuf,
    tasks: usize,
}

impl SlurmOptions {
    /// Computes runs, references first. Gives how each ended; open are those that an interruption left to the cluster.
    pub(super) fn render(
        &self,
        work: &Workshop,
        runs: &[Run],
        wanted: &[usize],
        tell: Tell,
    ) -> Result<Vec<(usize, Ending)>, SweepError> {
        let mut endings: HashMap<usize, Ending> = HashMap::new();
        let earlier = self.queued_by_name(work)?;
        if !earlier.is_empty() {
            eprintln!("jobs of an earlier start are still in the queue, they go first: {}", earlier.join(" "));
            for id in &earlier {
                self.follow(id, &mut || false)?;
            }
        }
        for index in wanted {
            let key = runs[*index].identity.key();
            // what those jobs finished stays; all else begins anew
            if work.force || !matches!(work.store.ended(&key), Some(Ok(_))) {
                work.store.forget(&key)?;
            }
        }
        for attempt in 0..ATTEMPTS {
            gather(work, runs, wanted, &mut endings, tell);
            let open: Vec<usize> = wanted.iter().copied().filter(|index| !endings.contains_key(index)).collect();
            if open.is_empty() || interrupt::interrupted() {
                break;
            }
            let mut arrays = Vec::new();
            for members in by_backend(runs, &open) {
                let blocks = blocks_of(runs, &members);
                let references = self.references(work, runs, &blocks);
                let before = match attempt == 0 && !references.is_empty() {
                    true => Some(self.submit(work, "reference", references, runs, &members, None)?),
                    false => None,
                };
                let tasks = match attempt {
                    0 => self.cut(work, runs, &blocks),
                    _ => self.alone(runs, &members),
                };
                arrays.push(self.submit(
                    work,
                    "render",
                    tasks,
                    runs,
                    &members,
                    before.as_ref().map(|a| a.id.as_str()),
                )?);
            }
            for array in &arrays {
                self.follow(&array.id, &mut || {
                    gather(work, runs, wanted, &mut endings, tell);
                    endings.len() == wanted.len()
                })?;
            }
            gather(work, runs, wanted, &mut endings, tell);
            let left = open.iter().filter(|index| !endings.contains_key(index)).count();
            if left > 0 && !interrupt::interrupted() {
                eprintln!(
                    "{left} runs were left by tasks that ended early (preempted, killed or out of time); they go again"
                );
            }
        }
        if !interrupt::interrupted() {
            for index in wanted.iter().filter(|index| !endings.contains_key(index)).copied().collect::<Vec<_>>() {
                let why =
                    format!("its task ended before it {ATTEMPTS} times: killed, preempted or out of time or memory");
                let ending = bury(work, &runs[index], &why, &[])?;
                tell(index, Step::Ended(&ending));
                endings.insert(index, ending);
            }
        }
        Ok(wanted.iter().map(|index| (*index, endings.remove(index).unwrap_or(Ending::Open))).collect())
    }

    /// Times blocks, each on a node of its own.
    pub(super) fn time(&self, work: &Workshop, runs: &[Run], blocks: &[Vec<usize>]) -> Result<(), SweepError> {
        let is_timed = |index: &usize| !work.store.timings(&runs[*index].identity.key()).is_empty();
        for _ in 0..2 {
            let open: Vec<&Vec<usize>> = blocks.iter().filter(|block| !block.iter().all(is_timed)).collect();
            if open.is_empty() || interrupt::interrupted() {
                return Ok(());
            }
            let tasks = open.iter().map(|block| vec![Order::Time(keys(runs, block))]).collect();
            let members: Vec<usize> = open.into_iter().flatten().copied().collect();
            let array = self.submit(work, "time", tasks, runs, &members, None)?;
            self.follow(&array.id, &mut || members.iter().all(is_timed))?;
        }
        Ok(())
    }

    /// Keeps images; gives those that are not there in the end.
    pub(super) fn picture(
        &self,
        work: &Workshop,
        runs: &[Run],
        wanted: &[usize],
    ) -> Result<Vec<(usize, String)>, SweepError> {
        let missing = || -> Vec<usize> {
            wanted.iter().copied().filter(|index| !work.store.has_image(&runs[*index].identity.key())).collect()
        };
        for _ in 0..2 {
            let open = missing();
            if open.is_empty() || interrupt::interrupted() {
                break;
            }
            let tasks = blocks_of(runs, &open)
                .iter()
                .map(|block| {
                    let on_front = |index: &usize| (runs[*index].identity.key(), !runs[*index].fronts.is_empty());
                    vec![Order::Picture(block.iter().map(on_front).collect())]
                })
                .collect();
            let array = self.submit(work, "picture", tasks, runs, &open, None)?;
            self.follow(&array.id, &mut || false)?;
        }
        Ok(missing().into_iter().map(|index| (index, "no task kept it".to_owned())).collect())
    }

    /// The references that are kept: a task for each that is sampled, the others together.
    fn references(&self, work: &Workshop, runs: &[Run], blocks: &[Vec<usize>]) -> Vec<Vec<Order>> {
        let (mut tasks, mut exact) = (Vec::new(), Vec::new());
        for block in blocks {
            let order = Order::Reference(keys(runs, block));
            match reference_is(work.experiment, &runs[block[0]].candidate) {
                (true, _) => tasks.push(vec![order]),
                (false, true) => exact.push(order),
                (false, false) => {}
            }
        }
        // an exact one takes a fraction of a second
        let in_one = (self.settings.seconds * 4.0).clamp(1.0, 1e4) as usize;
        tasks.extend(exact.chunks(in_one).map(<[Order]>::to_vec));
        let most = self.settings.tasks as usize;
        let in_one = tasks.len().div_ceil(most).max(1);
        tasks.chunks(in_one).map(<[_]>::concat).collect()
    }

    /// Cuts blocks into tasks of about equal expected cost; a block is cut only where it is more than one task.
    fn cut(&self, work: &Workshop, runs: &[Run], blocks: &[Vec<usize>]) -> Vec<Vec<Order>> {
        let cost = |index: usize| expected_seconds(work.experiment, &runs[index].candidate);
        let total: f64 = blocks.iter().flatten().map(|index| cost(*index)).sum();
        let target = self.settings.seconds.max(total / f64::from(self.settings.tasks));
        let mut tasks: Vec<Vec<Order>> = vec![Vec::new()];
        let mut filled = 0.0;
        for block in blocks {
            let mut piece: Vec<Key> = Vec::new();
            for index in block {
                let own = cost(*index);
                if filled > 0.0 && filled + own > target {
                    if !piece.is_empty() {
                        tasks.last_mut().expect("never empty").push(Order::Render(std::mem::take(&mut piece)));
                    }
                    tasks.push(Vec::new());
                    filled = 0.0;
                }
                filled += own;
                piece.push(runs[*index].identity.key());
            }
            if !piece.is_empty() {
                tasks.last_mut().expect("never empty").push(Order::Render(piece));
            }
        }
        tasks.retain(|task| !task.is_empty());
        tasks
    }

    /// A task a run, so that one that takes its node with it takes no other; as many in one as the array's size demands.
    fn alone(&self, runs: &[Run], members: &[usize]) -> Vec<Vec<Order>> {
        let orders: Vec<Order> = members.iter().map(|i| Order::Render(vec![runs[*i].identity.key()])).collect();
        let in_one = orders.len().div_ceil(self.settings.tasks as usize).max(1);
        orders.chunks(in_one).map(<[Order]>::to_vec).collect()
    }

    /// The name by which jobs of a results folder are found again.
    fn job_name(&self, work: &Workshop) -> String {
        let folder = std::path::absolute(work.store.root()).unwrap_or_else(|_| work.store.root().to_owned());
        format!("rigbench-{}-{}", work.experiment.name, Key::of_bytes(folder.display().to_string().as_bytes()).run())
    }

    fn submit(
        &self,
        work: &Workshop,
        phase: &str,
        tasks: Vec<Vec<Order>>,
        runs: &[Run],
        members: &[usize],
        after: Option<&str>,
    ) -> Result<Array, SweepError> {
        let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let root = absolute(work.store.root()).join("slurm");
        let number = (0..).find(|n| !root.join(format!("{phase}-{n}")).exists()).expect("numbers do not end");
        let folder = root.join(format!("{phase}-{number}"));
        let settings = &self.settings;
        let count = tasks.len();
        let file = TaskFile {
            experiment: absolute(&work.experiment.path),
            changes: work.experiment.changes.clone(),
            out: absolute(work.store.root()),
            // what is forced was forgotten before; a task that is started twice must not compute twice
            force: false,
            worker: self.crew.arguments.clone(),
            seconds: self.crew.limits.seconds,
            reference_seconds: self.crew.limits.reference_seconds,
            cpus: settings.cpus,
            tasks,
        };
        let mut bytes = serde_json::to_vec_pretty(&file).expect("tasks are plain JSON");
        bytes.push(b'\n');
        let tasks_file = folder.join("tasks.json");
        write_atomic(&tasks_file, &bytes)?;
        let words = [&self.crew.program, &tasks_file].map(|path| shell_word(&path.display().to_string()));
        let script = format!("#!/bin/sh\nexec {} task {} \"$SLURM_ARRAY_TASK_ID\"\n", words[0], words[1]);
        let script_file = folder.join("job.sh");
        write_atomic(&script_file, script.as_bytes())?;
        let mut command = Command::new("sbatch");
        command.arg("--parsable").arg("--requeue").arg("--open-mode=append").arg("--ntasks=1");
        command.arg(format!("--array=0-{}", count - 1));
        command.arg(format!("--job-name={}", self.job_name(work)));
        command.arg(format!("--output={}", folder.join("%a.log").display()));
        command.arg(format!("--cpus-per-task={}", settings.cpus));
        for (option, value) in [
            ("partition", &settings.partition),
            ("account", &settings.account),
            ("time", &settings.time),
            ("mem", &settings.memory),
        ] {
            if let Some(value) = value {
                command.arg(format!("--{option}={value}"));
            }
        }
        let on_gpu = members.iter().any(|index| runs[*index].candidate.wants_gpu());
        if let (Some(gres), true) = (&settings.gres, on_gpu) {
            command.arg(format!("--gres={gres}"));
        }
        if phase == "time" {
            command.arg("--exclusive"); // nothing runs beside what is timed
        }
        if let Some(after) = after {
            command.arg(format!("--dependency=afterany:{after}"));
        }
        command.args(&settings.options).arg(&script_file);
        let output = command.output().map_err(|cause| SweepError::Engine(format!("cannot start sbatch: {cause}")))?;
        if !output.status.success() {
            let why = String::from_utf8_lossy(&output.stderr);
            return Err(SweepError::Engine(format!("sbatch refused the {phase} array: {}", why.trim())));
        }
        let told = String::from_utf8_lossy(&output.stdout);
        let id = told.trim().split(';').next().unwrap_or_default().to_owned();
        eprintln!("{phase}: job {id}, {count} tasks; logs in {}", folder.display());
        Ok(Array { id, folder, tasks: count })
    }

    /// Jobs of this results folder in the queue.
    fn queued_by_name(&self, work: &Workshop) -> Result<Vec<String>, SweepError> {
        let output = Command::new("squeue")
            .args(["--me", "--noheader", "--format=%A", &format!("--name={}", self.job_name(work))])
            .output()
            .map_err(|cause| SweepError::Engine(format!("cannot start squeue: {cause}; is Slurm installed here?")))?;
        if !output.status.success() {
            let why = String::from_utf8_lossy(&output.stderr);
            return Err(SweepError::Engine(format!("squeue: {}", why.trim())));
        }
        let ids: HashSet<String> =
            String::from_utf8_lossy(&output.stdout).lines().map(|id| id.trim().to_owned()).collect();
        let mut ids: Vec<String> = ids.into_iter().collect();
        ids.sort();
        Ok(ids)
    }

    /// Waits until everything is there, or until no task of a job is in the queue, or until Ctrl-C; the job then goes on without this
    /// process. The store is looked at often, the controller seldom: it has others to answer.
    fn follow(&self, id: &str, is_done: &mut dyn FnMut() -> bool) -> Result<(), SweepError> {
        let mut answered = Instant::now();
        let (mut asked, mut until_asked) = (Instant::now(), Duration::ZERO);
        let mut wait = Duration::from_millis(100);
        loop {
            if interrupt::interrupted() {
                eprintln!("job {id} goes on in the cluster: a repeat follows it, `scancel {id}` ends it");
                return Ok(());
            }
            if is_done() {
                return Ok(());
            }
            if asked.elapsed() >= until_asked {
                let output = Command::new("squeue").args(["--noheader", "--format=%T", "--jobs", id]).output();
                let output = output.map_err(|cause| SweepError::Engine(format!("cannot start squeue: {cause}")))?;
                let why = String::from_utf8_lossy(&output.stderr).trim().to_owned();
                let listed = !output.stdout.iter().all(u8::is_ascii_whitespace);
                match output.status.success() {
                    true if !listed => return Ok(()),
                    true => answered = Instant::now(),
                    // the controller forgets jobs that are over
                    false if why.contains("Invalid job id") => return Ok(()),
                    false if answered.elapsed() > PATIENCE => return Err(SweepError::Engine(format!("squeue: {why}"))),
                    false => {}
                }
                asked = Instant::now();
                until_asked = (until_asked * 6 / 5).clamp(Duration::from_millis(300), Duration::from_secs(5));
            }
            std::thread::sleep(wait);
            wait = (wait * 9 / 8).min(Duration::from_secs(1));
        }
    }
}

impl Drop for Array {
    fn drop(&mut self) {
        tracing::debug!("job {} of {} tasks: {}", self.id, self.tasks, self.folder.display());
    }
}

/// Tells of the runs that the store says have ended since the last look.
fn gather(work: &Workshop, runs: &[Run], wanted: &[usize], endings: &mut HashMap<usize, Ending>, tell: Tell) {
    for index in wanted {
        if endings.contains_key(index) {
            continue;
        }
        let ending = match work.store.ended(&runs[*index].identity.key()) {
            None => continue,
            Some(Ok(record)) => match serde_json::from_value(record.metrics) {
                Ok(findings) => Ending::Ok(Box::new(findings)),
                Err(error) => Ending::Failed(format!("metrics.json of another version: {error}")),
            },
            Some(Err((true, why))) => Ending::Failed(why),
            Some(Err((false, why))) => Ending::Skipped(why),
        };
        tell(*index, Step::Ended(&ending));
        endings.insert(*index, ending);
    }
}

fn keys(runs: &[Run], members: &[usize]) -> Vec<Key> {
    members.iter().map(|index| runs[*index].identity.key()).collect()
}

/// The CPU's and the GPU's: their tasks ask for other resources.
fn by_backend(runs: &[Run], members: &[usize]) -> Vec<Vec<usize>> {
    let (cpu, gpu): (Vec<usize>, Vec<usize>) = members.iter().partition(|index| !runs[**index].candidate.wants_gpu());
    [cpu, gpu].into_iter().filter(|members| !members.is_empty()).collect()
}

/// Members of one scene x lights together, in the order of the plan.
fn blocks_of(runs: &[Run], members: &[usize]) -> Vec<Vec<usize>> {
    let mut place: HashMap<(&str, &str), usize> = HashMap::new();
    let mut blocks: Vec<Vec<usize>> = Vec::new();
    for index in members {
        let identity = &runs[*index].identity;
        let at = *place.entry((&identity.scene, &identity.lights)).or_insert_with(|| {
            blocks.push(Vec::new());
            blocks.len() - 1
        });
        blocks[at].push(*index);
    }
    blocks
}

/// What a run is expected to cost, seconds of one core: coarse, but in proportion; only ratios count.
pub(super) fn expected_seconds(experiment: &Experiment, candidate: &Candidate) -> f64 {
    let scene = &candidate.scene;
    let lights = candidate.lights.at(0, scene.frames).len() as f64;
    let receivers = scene.receivers.iter().filter(|receiver| receiver.mesh.is_some()).count() as f64;
    let pixels = match candidate.lights.instance.index {
        None => f64::from(experiment.image.width) * f64::from(experiment.image.height),
        Some(_) => 0.0,
    };
    let points = scene.frames as f64 * receivers * 4096.0 + pixels;
    let coefficients = candidate.order.unwrap_or(3).pow(2) as f64;
    let a_point = if candidate.rig().is_some() { coefficients * 1e-8 } else { lights * 1e-6 };
    let paths = match candidate.probe_source {
        Some(ProbeSource::Traced { spp, .. }) => f64::from(spp.unwrap_or(65_536)),
        _ => 0.0,
    };
    let setup = scene.frames as f64 * receivers * 30.0 * (lights * coefficients * 1e-6 + paths * 2e-6);
    // FLIP of the picture
    points * a_point + setup + pixels * 3e-6 + 5e-3
}

/// What goes wrong before a task can begin.
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    #[error("{}: {why}", path.display())]
    File { path: PathBuf, why: String },
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Sweep(#[from] SweepError),
}

/// A task on a node: carries out its orders with a crew of its own.
pub fn run_task(file: &Path, task: usize) -> Result<(), TaskError> {
    let broken = |why: String| TaskError::File { path: file.to_owned(), why };
    let bytes = std::fs::read(file).map_err(|cause| broken(cause.to_string()))?;
    let own: TaskFile = serde_json::from_slice(&bytes).map_err(|cause| broken(cause.to_string()))?;
    let orders = own.tasks.get(task).ok_or_else(|| broken(format!("there is no task {task}")))?;
    let changes: Vec<Override> =
        own.changes.iter().map(|text| text.parse()).collect::<Result<_, String>>().map_err(broken)?;
    let experiment = Experiment::load_with(&own.experiment, &changes)?;
    let store = Store::at(&own.out);
    let cache = ArrayCache::at(&experiment.cache_folder());
    let bakery = Bakery::of(&store);
    let work = Workshop {
        experiment: &experiment,
        store: &store,
        cache: &cache,
        bakery: &bakery,
        bench: None,
        no_gpu: None,
        driver: None,
        force: own.force,
    };
    let by_key: HashMap<Key, &Candidate> = experiment.candidates.iter().map(|c| (c.identity().key(), c)).collect();
    let limits = LimitSettings { seconds: own.seconds, reference_seconds: own.reference_seconds, memory_gb: None };
    let mut arguments = own.worker.clone();
    arguments.extend(["--jobs".to_owned(), own.cpus.to_string()]);
    let program = std::env::current_exe().map_err(|cause| broken(cause.to_string()))?;
    let options = CrewOptions { program, arguments, limits };
    let mut crew = Crew::new(&options);
    for order in orders {
        let wanted: Vec<(Key, bool)> = match order {
            Order::Reference(keys) | Order::Render(keys) | Order::Time(keys) => {
                keys.iter().map(|k| (*k, false)).collect()
            }
            Order::Picture(keys) => keys.clone(),
            Order::Stop => continue,
        };
        let mut runs = Vec::with_capacity(wanted.len());
        for (key, on_front) in wanted {
            let candidate = by_key.get(&key).ok_or_else(|| broken("the experiment changed since".to_owned()))?;
            let mut run = run_of((*candidate).clone(), candidate.identity());
            run.fronts.extend(on_front.then_some("nrmse"));
            runs.push(run);
        }
        let all: Vec<usize> = (0..runs.len()).collect();
        match order {
            Order::Reference(_) => crew.reference(&runs, &all)?,
            Order::Render(_) => {
                // a task that is started again leaves what is done
                let open: Vec<usize> =
                    all.into_iter().filter(|i| store.ended(&runs[*i].identity.key()).is_none()).collect();
                let tell = |index: usize, step: Step| {
                    if let Step::Ended(ending) = step {
                        println!("{} {}", runs[index].candidate.label(), word(ending));
                    }
                };
                if !open.is_empty() {
                    crew.render(&work, &runs, &open, &tell, &interrupt::interrupted)?;
                }
            }
            Order::Time(_) => {
                let failures = crew.time(&work, &runs, &all, &mut || {})?.unwrap_or_default();
                failures
                    .iter()
                    .for_each(|(index, why)| println!("not timed: {}: {why}", runs[*index].candidate.label()));
            }
            Order::Picture(_) => {
                let failures = crew.picture(&work, &runs, &all)?;
                failures
                    .iter()
                    .for_each(|(index, why)| println!("no image: {}: {why}", runs[*index].candidate.label()));
            }
            Order::Stop => {}
        }
        if interrupt::interrupted() {
            break;
        }
    }
    drop(crew);
    if let Some(seconds) = processor_seconds() {
        println!("{seconds:.2} s of a processor");
    }
    Ok(())
}

/// Processor time of this process and of the children that it waited for, seconds; where the system says.
fn processor_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    // the name of the program, in brackets, may hold anything; utime, stime, cutime and cstime are the 14th to the 17th words
    let words: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks: u64 = words.get(11..15)?.iter().map(|word| word.parse::<u64>().ok()).sum::<Option<u64>>()?;
    Some(ticks as f64 / rustix::param::clock_ticks_per_second() as f64)
}

fn word(ending: &Ending) -> String {
    match ending {
        Ending::Ok(_) => "ok".to_owned(),
        Ending::Failed(why) => format!("failed: {why}"),
        Ending::Skipped(why) => format!("skipped: {why}"),
        Ending::Open => "open".to_owned(),
    }
}
