//! `rigbench merge`: the results of shards as those of one run.

use std::collections::HashSet;
use std::path::PathBuf;

use clap::Args;

use super::run::finish;
use super::{Exit, Failure};
use crate::experiment::{Experiment, Override};
use crate::gate::{ResultKind, Stored};
use crate::run::{Store, SweepOptions, bring, sweep};

/// Bring the results of shards together, as one run would have written them
#[derive(Args, Debug)]
pub struct Merge {
    /// Folder that gets everything; it may hold results already
    #[arg(value_name = "DIR")]
    out: PathBuf,
    /// Results of shards
    #[arg(value_name = "SHARD", required = true)]
    shards: Vec<PathBuf>,
    /// The experiment's file, where it is no longer where the results say
    #[arg(long, value_name = "FILE")]
    experiment: Option<PathBuf>,
    /// Draw no figures
    #[arg(long)]
    no_figures: bool,
    /// Write no report
    #[arg(long)]
    no_report: bool,
}

impl Merge {
    pub fn run(self) -> Result<Exit, Failure> {
        let mut stored = self.shards.iter().map(|folder| Stored::read(folder)).collect::<Result<Vec<_>, _>>()?;
        if self.out.join("results.json").exists() {
            stored.push(Stored::read(&self.out)?);
        }
        let first = &stored[0];
        if let Some(other) = stored.iter().find(|s| (&s.experiment, &s.changes) != (&first.experiment, &first.changes))
        {
            return Err(Failure::new(
                Exit::InvalidInput,
                format!(
                    "{} is of `{}` with {:?}, {} of `{}` with {:?}: shards are of one experiment",
                    first.folder.display(),
                    first.experiment,
                    first.changes,
                    other.folder.display(),
                    other.experiment,
                    other.changes
                ),
            ));
        }
        let changes: Vec<Override> =
            first.changes.iter().map(|text| text.parse()).collect::<Result<_, String>>().map_err(Failure::internal)?;
        let file = self.experiment.as_ref().or(first.experiment_file.as_ref());
        let file = file.filter(|_| first.kind == ResultKind::Sweep).ok_or_else(|| {
            Failure::new(Exit::InvalidInput, format!("{} is no part of a sweep", first.folder.display()))
        })?;
        let experiment = Experiment::load_with(file, &changes)?;
        let named: HashSet<&str> = stored.iter().flat_map(|s| &s.rows).map(|row| row.text("run")).collect();
        let chosen: Vec<_> = experiment
            .candidates
            .iter()
            .filter(|c| named.contains(c.identity().key().run().as_str()))
            .cloned()
            .collect();
        if chosen.is_empty() {
            let why = "no run of the experiment as it is now is in these results";
            return Err(Failure::new(Exit::NothingSelected, why));
        }
        let store = Store::at(&self.out);
        let _lock = store.lock_merge()?;
        for shard in &self.shards {
            let copied = bring(shard, &self.out)?;
            eprintln!("{copied} runs from {}", shard.display());
        }
        let left = experiment.candidates.len() - chosen.len();
        if left > 0 {
            eprintln!("{left} runs of the experiment are in none of these results");
        }
        let swept = sweep(&experiment, chosen, &store, &SweepOptions { gather: true, ..SweepOptions::default() })
            .map_err(Failure::internal)?;
        finish(&experiment, &swept, &store, self.no_figures, self.no_report)
    }
}
