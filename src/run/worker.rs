//! A worker: a child process that does what it is told over a pipe, so that whatever a run does to its process costs that run alone.
//!
//! One JSON value a line. Orders come on standard input, reports go to standard output, everything it computes into the store. When its
//! standard input ends, the one that gave the orders is gone, and so is the worker: the store is safe at any moment.

use std::collections::HashMap;
use std::io::{BufRead, Write};
use std::sync::Mutex;
use std::sync::mpsc;

use serde::{Deserialize, Serialize};

use super::bakery::Bakery;
use super::sweep::{self, Ending, Run, Step, Workshop, run_of};
use super::{ArrayCache, Store, StoreError, interrupt};
use crate::candidate::GpuBench;
use crate::experiment::{Experiment, Key};
use crate::gpu::{AdapterKind, Gpu};

/// What a worker is told to do with runs of one scene x lights.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// Compute what they share, and keep it.
    Reference(Vec<Key>),
    Render(Vec<Key>),
    Time(Vec<Key>),
    /// Keep their images; of those that are on a front (true) measure HDR FLIP.
    Picture(Vec<(Key, bool)>),
    /// End after what is being computed.
    Stop,
}

/// What a worker says.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Report {
    Begins(Key),
    Ok(Key),
    Failed(Key, String),
    Skipped(Key, String),
    /// It was told to stop before this run.
    Open(Key),
    /// A piece of a timing is done.
    Step,
    /// The order is carried out; false where it was told to stop.
    Done(bool),
    /// The disk, or an order that makes no sense: the sweep cannot go on.
    Broken(String),
}

/// Bounds the memory that this process may write to; what asks for more aborts. Memory that is only reserved, as drivers do, is free.
pub fn limit_memory(bytes: u64) -> std::io::Result<()> {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let maximum = getrlimit(Resource::Data).maximum;
    let current = maximum.map_or(bytes, |maximum| maximum.min(bytes));
    Ok(setrlimit(Resource::Data, Rlimit { current: Some(current), maximum })?)
}

/// Carries out orders until there are no more.
pub fn serve(experiment: &Experiment, store: &Store, force: bool) {
    let (sender, orders) = mpsc::channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            match line.ok().and_then(|line| serde_json::from_str(&line).ok()) {
                Some(Order::Stop) => interrupt::ask(),
                Some(order) => drop(sender.send(order)),
                None => break,
            }
        }
        std::process::exit(0);
    });
    let out = Mutex::new(std::io::stdout());
    let say = |report: &Report| {
        let mut line = serde_json::to_string(report).expect("reports are plain JSON");
        line.push('\n');
        let mut out = out.lock().expect("nothing panics while it speaks");
        if out.write_all(line.as_bytes()).and_then(|()| out.flush()).is_err() {
            std::process::exit(0); // no one listens
        }
    };
    let by_key: HashMap<Key, usize> = experiment
        .candidates
        .iter()
        .enumerate()
        .map(|(index, candidate)| (candidate.identity().key(), index))
        .collect();
    let cache = ArrayCache::at(&experiment.cache_folder());
    let bakery = Bakery::of(store);
    let mut gpu: Option<Result<GpuBench, String>> = None;
    for order in orders {
        let keys: Vec<(Key, bool)> = match &order {
            Order::Reference(keys) | Order::Render(keys) | Order::Time(keys) => {
                keys.iter().map(|key| (*key, false)).collect()
            }
            Order::Picture(keys) => keys.clone(),
            Order::Stop => continue,
        };
        let Some(runs) = runs_of(experiment, &by_key, &keys) else {
            say(&Report::Broken("the experiment or its scenes changed while it ran".to_owned()));
            continue;
        };
        if gpu.is_none() && runs.iter().any(|run| run.candidate.wants_gpu()) {
            gpu = Some(Gpu::open(AdapterKind::Any).map(GpuBench::new).map_err(|why| why.to_string()));
        }
        let opened = gpu.as_ref();
        let bench = opened.and_then(|opened| opened.as_ref().ok());
        let work = Workshop {
            experiment,
            store,
            cache: &cache,
            bakery: &bakery,
            bench,
            no_gpu: opened.and_then(|opened| opened.as_ref().err().cloned()),
            driver: bench.map(|bench| bench.gpu.adapter().driver.clone()),
            force,
        };
        let all: Vec<usize> = (0..runs.len()).collect();
        match carry_out(&order, &work, &runs, &all, &say) {
            Ok(whole) => say(&Report::Done(whole)),
            Err(error) => say(&Report::Broken(error.to_string())),
        }
    }
}

/// The runs that are meant; none where one is unknown.
fn runs_of(experiment: &Experiment, by_key: &HashMap<Key, usize>, keys: &[(Key, bool)]) -> Option<Vec<Run>> {
    keys.iter()
        .map(|(key, on_front)| {
            let candidate = experiment.candidates[*by_key.get(key)?].clone();
            let identity = candidate.identity();
            let mut run = run_of(candidate, identity);
            if *on_front {
                run.fronts.push("nrmse");
            }
            Some(run)
        })
        .collect()
}

/// `RIGBENCH_FAULT=KIND:TEXT` makes a worker fail at every run whose label has the text: what limits, retries and logs are tested with.
/// `KIND:TEXT:PATH` does so once: the file is made then, and holds the process and its parent.
fn planted_fault(label: &str) {
    let Ok(fault) = std::env::var("RIGBENCH_FAULT") else { return };
    let mut parts = fault.splitn(3, ':');
    let (kind, text, once) = (parts.next(), parts.next(), parts.next());
    if let Some(path) = once {
        if !text.is_some_and(|text| label.contains(text)) || std::path::Path::new(path).exists() {
            return;
        }
        let ids = format!("{} {}", std::process::id(), std::os::unix::process::parent_id());
        let _ = super::write_atomic(std::path::Path::new(path), ids.as_bytes());
    }
    match kind.zip(text) {
        Some((kind, text)) if label.contains(text) => match kind {
            "abort" => std::process::abort(),
            "hang" => loop {
                std::thread::sleep(std::time::Duration::from_secs(1));
            },
            "memory" => {
                let mut hoard: Vec<Vec<u8>> = Vec::new();
                loop {
                    hoard.push(vec![1; 64 << 20]);
                }
            }
            _ => {}
        },
        _ => {}
    }
}

/// `RIGBENCH_FAULT=slow:TEXT` makes runs whose label has the text set up twice for every sample of their times: a regression to be caught.
pub(super) fn planted_laps(label: &str) -> usize {
    let fault = std::env::var("RIGBENCH_FAULT").unwrap_or_default();
    if fault.strip_prefix("slow:").is_some_and(|text| label.contains(text)) { 2 } else { 1 }
}

fn carry_out(
    order: &Order,
    work: &Workshop,
    runs: &[Run],
    all: &[usize],
    say: &(dyn Fn(&Report) + Sync),
) -> Result<bool, StoreError> {
    let key = |index: usize| runs[index].identity.key();
    match order {
        Order::Reference(_) => sweep::reference(work, runs, all),
        Order::Render(_) => {
            let tell = |index: usize, step: Step| match step {
                Step::Begins => {
                    say(&Report::Begins(key(index)));
                    planted_fault(&runs[index].candidate.label());
                }
                Step::Ended(Ending::Ok(_)) => say(&Report::Ok(key(index))),
                Step::Ended(Ending::Failed(why)) => say(&Report::Failed(key(index), why.clone())),
                Step::Ended(Ending::Skipped(why)) => say(&Report::Skipped(key(index), why.clone())),
                Step::Ended(Ending::Open) => say(&Report::Open(key(index))),
            };
            sweep::render(work, runs, all, &tell)?;
        }
        Order::Time(_) => match sweep::time(work, runs, all, &mut || say(&Report::Step))? {
            None => return Ok(false),
            Some(failures) => failures.into_iter().for_each(|(index, why)| say(&Report::Failed(key(index), why))),
        },
        Order::Picture(_) => {
            let failures = sweep::picture(work, runs, all)?;
            failures.into_iter().for_each(|(index, why)| say(&Report::Failed(key(index), why)));
        }
        Order::Stop => {}
    }
    Ok(!interrupt::interrupted())
}
