//! `rigbench run`: an experiment from its file to its results.

use std::path::PathBuf;

use clap::Args;

use super::{Exit, Failure};
use crate::experiment::{Backend, Candidate, Experiment, Filter, Override};
use crate::run::{Ending, Store, SweepError, SweepOptions, interrupt, results, sweep};

/// Run an experiment: render, measure, time, draw
#[derive(Args, Debug)]
pub struct Run {
    /// The experiment's file
    #[arg(value_name = "EXPERIMENT")]
    experiment: PathBuf,
    /// Folder that gets results.csv; by default results/NAME beside scenes/
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only these runs: the same axis or, different axes and
    #[arg(long, value_name = "AXIS=VALUE")]
    filter: Vec<String>,
    /// Change the experiment: dotted TOML path, value as TOML else as string
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Only this backend; with gpu a missing GPU is an error
    #[arg(long, value_name = "BACKEND")]
    backend: Option<String>,
    /// Threads in all
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Compute what is there already
    #[arg(long)]
    force: bool,
    /// Stop at the first run that fails
    #[arg(long)]
    fail_fast: bool,
}

impl Run {
    pub fn run(self) -> Result<Exit, Failure> {
        let overrides: Vec<Override> =
            self.set.iter().map(|text| text.parse()).collect::<Result<_, String>>().map_err(Failure::usage)?;
        let filter = Filter::parse(self.filter.iter().map(String::as_str)).map_err(Failure::usage)?;
        let backend = match self.backend.as_deref() {
            None => None,
            Some("cpu") => Some(Backend::Cpu),
            Some("gpu") => Some(Backend::Gpu),
            Some(other) => return Err(Failure::usage(format!("unknown backend `{other}`; allowed: `cpu`, `gpu`"))),
        };
        if let Some(jobs) = self.jobs {
            let built = rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs)).build_global();
            built.map_err(Failure::internal)?;
        }
        let experiment = Experiment::load_with(&self.experiment, &overrides)?;
        let all = &experiment.candidates;
        let chosen: Vec<Candidate> = all
            .iter()
            .filter(|c| filter.matches(c) && backend.is_none_or(|backend| c.backend == backend))
            .cloned()
            .collect();
        if chosen.is_empty() {
            return Err(Failure::new(Exit::NothingSelected, filter.explain_nothing(all)));
        }
        interrupt::install().map_err(Failure::internal)?;
        let store = Store::at(&self.out.clone().unwrap_or_else(|| experiment.results_folder()));
        let options =
            SweepOptions { force: self.force, fail_fast: self.fail_fast, gpu_demanded: backend == Some(Backend::Gpu) };
        let swept = match sweep(&experiment, chosen, &store, options) {
            Ok(swept) => swept,
            Err(SweepError::NoGpu(why)) => return Err(Failure::new(Exit::NoGpu, why)),
            Err(SweepError::Store(error)) => return Err(error.into()),
        };
        results::write(&experiment, &swept, &store)?;
        let skipped = swept.runs.iter().filter(|run| matches!(run.ending, Ending::Skipped(_))).count();
        eprintln!(
            "{} runs: {} computed, {} cached, {} failed, {skipped} skipped; results in {}",
            swept.runs.len(),
            swept.computed(),
            swept.runs.iter().filter(|run| run.cached).count(),
            swept.failed(),
            store.root().display(),
        );
        let mut exit = Exit::Ok;
        if swept.interrupted {
            exit = exit.and(Exit::Interrupted);
        }
        if swept.failed() > 0 {
            exit = exit.and(Exit::RunsFailed);
        }
        Ok(exit)
    }
}
