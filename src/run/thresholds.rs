//! The thresholds of an experiment, held against what its runs found.

use super::results::cell;
use super::sweep::Sweep;
use crate::experiment::Experiment;

/// A run under a threshold.
#[derive(Clone, Debug, PartialEq)]
pub struct Held {
    pub label: String,
    pub metric: &'static str,
    /// Line of the threshold in the experiment file.
    pub line: usize,
    /// Absent where the run did not give the metric, which does not hold.
    pub value: Option<f64>,
    pub max: Option<f64>,
    pub min: Option<f64>,
}

impl Held {
    pub fn holds(&self) -> bool {
        self.value
            .is_some_and(|value| self.max.is_none_or(|max| value <= max) && self.min.is_none_or(|min| value >= min))
    }
}

/// Every selected run under every threshold; a run that failed or lacks the metric does not hold. Runs that were skipped for want of a
/// GPU, or left out by a filter, are not asked.
pub fn held(experiment: &Experiment, sweep: &Sweep) -> Vec<Held> {
    let mut all = Vec::new();
    for threshold in &experiment.thresholds {
        for run in &sweep.runs {
            let asked = !matches!(run.ending, super::Ending::Skipped(_) | super::Ending::Open);
            if asked && threshold.selection.matches(&run.candidate) {
                all.push(Held {
                    label: run.candidate.label(),
                    metric: threshold.metric.name,
                    line: threshold.line,
                    value: cell(experiment, run, threshold.metric.name).and_then(|text| text.parse().ok()),
                    max: threshold.max,
                    min: threshold.min,
                });
            }
        }
    }
    all
}
