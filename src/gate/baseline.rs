use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::check::{Check, Kind, Verdict};
use super::interval::Estimate;
use super::stored::{Draw, Place, ResultKind, Stored, StoredRow, TIMES};
use crate::experiment::TimingIdentity;
use crate::input::InputError;

/// What results are held against: `results/baselines/NAME.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    pub version: u32,
    pub experiment: String,
    /// Why it is what it is, the last change last.
    pub accepted: Vec<Accepted>,
    pub rows: Vec<BaselineRow>,
}

/// One `--accept`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Accepted {
    pub reason: String,
    /// Values and rows that it changed.
    pub changed: usize,
    /// The program's version.
    pub rigbench: String,
}

/// A row that is held. Its place is its name: the run's key changes with every algorithm and stands here for the record.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaselineRow {
    pub place: Place,
    /// Of rows on the GPU: they are held on this adapter alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
    pub run: String,
    /// Deterministic values, and standard errors under `METRIC_se`.
    pub values: BTreeMap<String, f64>,
    /// Median, and the ends of its interval, of each kind of time.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub times: BTreeMap<String, [f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timed_on: Option<TimingIdentity>,
}

const VERSION: u32 = 1;

impl Baseline {
    /// `None` where there is no such file.
    pub fn read(path: &Path) -> Result<Option<Self>, InputError> {
        let broken = |why: String| InputError::of_file(path, why);
        let bytes = match std::fs::read(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            read => read.map_err(|e| broken(format!("cannot be read: {e}")))?,
        };
        let baseline: Self =
            serde_json::from_slice(&bytes).map_err(|e| broken(format!("is no baseline of this program: {e}")))?;
        match baseline.version {
            VERSION => Ok(Some(baseline)),
            other => Err(broken(format!("version {other}; this program reads {VERSION}"))),
        }
    }

    pub fn to_json(&self) -> Vec<u8> {
        let mut bytes = serde_json::to_vec_pretty(self).expect("a baseline is plain JSON");
        bytes.push(b'\n');
        bytes
    }

    pub fn empty(experiment: &str) -> Self {
        Self { version: VERSION, experiment: experiment.to_owned(), ..Self::default() }
    }
}

impl BaselineRow {
    pub fn of(row: &StoredRow, kind: ResultKind, with_times: bool) -> Self {
        let times = TIMES.iter().filter(|_| with_times).filter_map(|column| {
            let estimate = Estimate::of(row.samples(column)?)?;
            let (low, high) = estimate.interval?;
            Some(((*column).to_owned(), [estimate.value, low, high]))
        });
        let times: BTreeMap<String, [f64; 3]> = times.collect();
        let timed_on = row.times.as_ref().filter(|_| !times.is_empty()).map(|times| times.on.clone());
        Self {
            place: row.place().clone(),
            adapter: adapter_of(row).map(str::to_owned),
            run: row.text("run").to_owned(),
            values: kind.held().iter().filter_map(|column| Some(((*column).to_owned(), row.number(column)?))).collect(),
            times,
            timed_on,
        }
    }

    /// As far as the baseline knows: rays without noise are those of the row that is held against it.
    pub fn draw(&self) -> Draw<'_> {
        Draw { run: &self.run, noise: self.values.get("ref_noise").copied().unwrap_or(0.0), casts_rays: false }
    }

    pub fn estimate(&self, column: &str) -> Option<Estimate> {
        let [value, low, high] = *self.times.get(column)?;
        Some(Estimate { value, interval: Some((low, high)) })
    }
}

/// The adapter of a row on the GPU.
pub fn adapter_of(row: &StoredRow) -> Option<&str> {
    (row.text("backend") == "gpu").then(|| row.text("adapter"))
}

/// Takes over what failed and nothing else: values that got worse, rows that are new (their times only `with_times`), rows that are gone. Gives
/// how many it changed.
pub fn accept(baseline: &mut Baseline, stored: &Stored, checks: &[Check], reason: &str, with_times: bool) -> usize {
    let mut changed = 0;
    let mut gone: Vec<usize> = Vec::new();
    for check in checks.iter().filter(|check| matches!(check.verdict, Verdict::Failed | Verdict::Unknown)) {
        let row = check.row.map(|row| &stored.rows[row]);
        match (&check.kind, check.baseline_row, row) {
            (Kind::Presence, Some(index), None) => gone.push(index),
            (Kind::Presence, None, Some(row)) if row.is_ok() => {
                baseline.rows.push(BaselineRow::of(row, stored.kind, with_times))
            }
            (Kind::Quality, Some(index), Some(row)) => {
                let held = &mut baseline.rows[index];
                // values of two draws are no result together
                if !held.draw().is_same(&row.draw()) {
                    held.values = BaselineRow::of(row, stored.kind, false).values;
                    held.run = row.text("run").to_owned();
                }
                for column in [check.metric.clone(), format!("{}_se", check.metric)] {
                    match row.number(&column) {
                        Some(value) => drop(held.values.insert(column, value)),
                        None => drop(held.values.remove(&column)),
                    }
                }
                held.run = row.text("run").to_owned();
            }
            (Kind::Cost, Some(index), Some(_)) => {
                // the ratio to the others of the block is what is held: its change is taken over, the machine's speed is not
                let held = baseline.rows[index].times.get_mut(&check.metric).expect("it was compared");
                held.iter_mut().for_each(|end| *end *= check.value.unwrap_or(1.0));
            }
            _ => continue,
        }
        changed += 1;
    }
    gone.sort_unstable();
    gone.into_iter().rev().for_each(|index| drop(baseline.rows.remove(index)));
    if changed > 0 {
        let rigbench = env!("CARGO_PKG_VERSION").to_owned();
        baseline.accepted.push(Accepted { reason: reason.to_owned(), changed, rigbench });
    }
    changed
}
