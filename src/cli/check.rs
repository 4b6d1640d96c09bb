//! `rigbench check`: results against thresholds and baseline.

use std::path::PathBuf;

use clap::Args;

use super::{Exit, Failure, print};
use crate::gate::{self, Baseline, Format, Law, Options, Stored, Verdict};
use crate::run::write_atomic;

/// Hold results against the experiment's thresholds and a baseline
#[derive(Args, Debug)]
pub struct Check {
    /// Folder of results
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The baseline; by default results/baselines/NAME.json of the experiment's project
    #[arg(long, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// The experiment's file, where it is no longer where the results say
    #[arg(long, value_name = "FILE")]
    experiment: Option<PathBuf>,
    /// Take what failed over into the baseline, and nothing else
    #[arg(long, requires = "reason")]
    accept: bool,
    /// Why it is accepted; the baseline keeps it
    #[arg(long, value_name = "TEXT", requires = "accept", value_parser = clap::builder::NonEmptyStringValueParser::new())]
    reason: Option<String>,
    /// What is better than the baseline, or could not be compared, fails too
    #[arg(long)]
    strict: bool,
    /// How it is told
    #[arg(long, value_name = "FORMAT", default_value = "human", value_parser = Format::NAMES)]
    format: String,
}

impl Check {
    pub fn run(self) -> Result<Exit, Failure> {
        let stored = Stored::read(&self.folder)?;
        let file = self.experiment.as_ref().or(stored.experiment_file.as_ref());
        let file = file.ok_or_else(|| {
            Failure::usage(format!(
                "{}: the results do not say of which file; give --experiment",
                self.folder.display()
            ))
        })?;
        let law = Law::read(file, &stored)?;
        let path = self.baseline.clone().unwrap_or_else(|| law.baseline.clone());
        let mut baseline = Baseline::read(&path)?;
        if let Some(other) = baseline.as_ref().filter(|baseline| baseline.experiment != law.name) {
            let message =
                format!("{} is the baseline of `{}`, not of `{}`", path.display(), other.experiment, law.name);
            return Err(Failure::new(Exit::InvalidInput, message));
        }
        let options = Options { settings: law.settings, strict: self.strict };
        let hold = |baseline: &Option<Baseline>| gate::check(&stored, law.thresholds(), baseline.as_ref(), options);
        let mut checks = hold(&baseline);
        if self.accept {
            let mut accepted = baseline.take().unwrap_or_else(|| Baseline::empty(&law.name));
            let before = gate::check(&stored, law.thresholds(), Some(&accepted), options);
            let reason = self.reason.as_deref().unwrap_or_default();
            let changed = gate::accept(&mut accepted, &stored, &before, reason, law.settings.times);
            if changed > 0 {
                write_atomic(&path, &accepted.to_json())?;
            }
            eprintln!("{changed} accepted into {}", path.display());
            baseline = Some(accepted);
            checks = hold(&baseline);
        }
        let format = Format::named(&self.format).expect("clap allows no other");
        print(gate::checks(&checks, format, &law.name, file))?;
        let mut exit = Exit::Ok;
        if baseline.is_none() {
            eprintln!("there is no baseline {}; `--accept --reason TEXT` makes it from these results", path.display());
            exit = exit.and(Exit::BaselineMissing);
        }
        for check in &checks {
            exit = match check.verdict {
                Verdict::Failed => exit.and(Exit::Regression),
                Verdict::Unknown => exit.and(Exit::BaselineMissing),
                _ => exit,
            };
        }
        Ok(exit)
    }
}
