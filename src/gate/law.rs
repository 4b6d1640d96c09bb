use std::path::{Path, PathBuf};

use super::check::Thresholds;
use super::stored::{ResultKind, Stored};
use crate::experiment::{CheckSettings, Experiment, Override, Threshold};
use crate::input::InputError;
use crate::stability::{Bound, HardCases};

/// What results are held against, from the experiment's file.
pub struct Law {
    pub name: String,
    /// The baseline's place.
    pub baseline: PathBuf,
    pub settings: CheckSettings,
    limits: Limits,
}

enum Limits {
    OfRuns(Vec<Threshold>),
    OfCurves(Vec<Bound>),
}

impl Law {
    /// From a file, with the changes of the command line under which the results came to be. Another experiment's file is a mistake.
    pub fn read(file: &Path, stored: &Stored) -> Result<Self, InputError> {
        let changes: Vec<Override> = stored
            .changes
            .iter()
            .map(|text| text.parse())
            .collect::<Result<_, String>>()
            .map_err(|why| InputError::of_file(&stored.folder.join("results.json"), format!("changes: {why}")))?;
        let (name, root, settings, limits) = match stored.kind {
            ResultKind::Sweep => {
                let experiment = Experiment::load_with(file, &changes)?;
                (experiment.name, experiment.root, experiment.check, Limits::OfRuns(experiment.thresholds))
            }
            ResultKind::Curves => {
                let cases = HardCases::load_with(file, &changes)?;
                (cases.name, cases.root, cases.check, Limits::OfCurves(cases.bounds))
            }
        };
        if name != stored.experiment {
            let folder = stored.folder.display();
            let message =
                format!("this is the experiment `{name}`, and {folder} holds results of `{}`", stored.experiment);
            return Err(InputError::of_file(file, message));
        }
        let baseline = root.join("results/baselines").join(format!("{name}.json"));
        Ok(Self { name, baseline, settings, limits })
    }

    pub fn thresholds(&self) -> Thresholds<'_> {
        match &self.limits {
            Limits::OfRuns(thresholds) => Thresholds::OfRuns(thresholds),
            Limits::OfCurves(bounds) => Thresholds::OfCurves(bounds),
        }
    }
}
