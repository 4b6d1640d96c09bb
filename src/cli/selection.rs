use std::path::PathBuf;

use clap::Args;

use super::hard_cases::HardArguments;
use super::{Exit, Failure};
use crate::experiment::{Backend, Candidate, Experiment, Filter, Override};
use crate::run::Store;

/// An experiment and what of it: the arguments that `plan` and `run` share.
#[derive(Debug, Args)]
pub struct Selection {
    /// The experiment's file
    #[arg(value_name = "EXPERIMENT")]
    experiment: PathBuf,
    /// Folder that gets results.csv; by default results/NAME beside scenes/
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only these runs: the same axis or, different axes and
    #[arg(long, value_name = "AXIS=VALUE")]
    filter: Vec<String>,
    /// Change the experiment: dotted TOML path, value as TOML, else as a string
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<Override>,
    /// Only this backend; with gpu a missing GPU is an error
    #[arg(long, value_name = "BACKEND", value_parser = ["cpu", "gpu"])]
    backend: Option<String>,
    /// Compute what is there already
    #[arg(long)]
    pub force: bool,
}

/// What was selected; never without a candidate.
pub struct Selected {
    pub experiment: Experiment,
    pub candidates: Vec<Candidate>,
    pub store: Store,
    /// `--backend gpu`: without a GPU there is nothing to go on with.
    pub gpu_demanded: bool,
}

impl Selection {
    /// The same arguments for an experiment of hard cases, if it is one.
    pub fn hard_cases(&self) -> Option<HardArguments> {
        crate::stability::is_stability(&self.experiment).then(|| HardArguments {
            experiment: self.experiment.clone(),
            out: self.out.clone(),
            filter: self.filter.clone(),
            set: self.set.clone(),
            backend: self.backend.clone(),
            force: self.force,
            figures: false,
            report: false,
        })
    }

    /// Reads the experiment and picks its candidates. Writes nothing.
    pub fn load(&self) -> Result<Selected, Failure> {
        let filter = Filter::parse(self.filter.iter().map(String::as_str)).map_err(Failure::usage)?;
        let backend = match self.backend.as_deref() {
            Some("cpu") => Some(Backend::Cpu),
            Some(_) => Some(Backend::Gpu),
            None => None,
        };
        let experiment = Experiment::load_with(&self.experiment, &self.set)?;
        let matches = |c: &&Candidate| filter.matches(c) && backend.is_none_or(|backend| c.backend == backend);
        let candidates: Vec<Candidate> = experiment.candidates.iter().filter(matches).cloned().collect();
        if candidates.is_empty() {
            let on_backend = |c: &&Candidate| backend.is_none_or(|backend| c.backend == backend);
            let why = match experiment.candidates.iter().any(|c| on_backend(&c)) {
                true => filter.explain_nothing(&experiment.candidates),
                false => "nothing selected: no candidate has this backend".to_owned(),
            };
            return Err(Failure::new(Exit::NothingSelected, why));
        }
        let store = Store::at(&self.out.clone().unwrap_or_else(|| experiment.results_folder()));
        Ok(Selected { experiment, candidates, store, gpu_demanded: backend == Some(Backend::Gpu) })
    }
}
