//! Two result folders, run by run.

use std::collections::HashMap;

use rayon::prelude::*;
use serde::Serialize;

use super::check::is_better_lower;
use super::interval::{Estimate, z_limit};
use super::stored::{COUNTS, Place, Stored, StoredRow, TIMES, rounding_error, unit};
use crate::experiment::COLUMNS;
use crate::metric::{self, Direction};

/// How B stands to A.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Word {
    Same,
    /// Significantly.
    Better,
    Worse,
    /// Significantly other, where no direction is better.
    Changed,
    /// A difference that noise or spread can explain.
    Open,
    OnlyA,
    OnlyB,
    NotCompared,
}

/// One value in A and in B.
#[derive(Clone, Debug, Serialize)]
pub struct Change {
    #[serde(skip)]
    pub place: Place,
    #[serde(rename = "row")]
    pub label: String,
    pub metric: String,
    pub unit: &'static str,
    pub a: Option<f64>,
    pub b: Option<f64>,
    /// B - A of quality, B / A of times, and its 95 % interval.
    pub change: Option<f64>,
    pub interval: Option<(f64, f64)>,
    /// Whether `change` is a ratio.
    pub ratio: bool,
    pub word: Word,
    pub note: String,
}

#[derive(Debug, Serialize)]
pub struct Comparison {
    pub a: String,
    pub b: String,
    /// What has to be known before a number is read: other machines, adapters, experiments.
    pub flags: Vec<String>,
    pub changes: Vec<Change>,
}

/// 95 % of the normal distribution.
const Z: f64 = 1.959_963_984_540_054;

/// Rounding of deterministic values that no one need see.
const ROUNDING: (f64, f64) = (1e-4, 2e-6);

/// Within this factor rounding errors are of the same size.
const ROUNDING_FACTOR: f64 = 4.0;

/// Everything in which two results differ, and in which they agree. `effect` is the factor from which a change of a time counts.
pub fn compare(a: &Stored, b: &Stored, effect: f64) -> Comparison {
    let mut flags = Vec::new();
    if a.experiment != b.experiment {
        flags.push(format!("A is of the experiment `{}`, B of `{}`", a.experiment, b.experiment));
    }
    if a.kind != b.kind {
        flags.push("one is a sweep, the other hard cases: no row of one is in the other".to_owned());
    }
    let in_b: HashMap<&Place, &StoredRow> = b.rows.iter().map(|row| (row.place(), row)).collect();
    let in_a: std::collections::HashSet<&Place> = a.rows.iter().map(StoredRow::place).collect();
    let columns: Vec<Compared> = a.kind.compared().into_iter().map(Compared::new).collect();
    let paired = a.rows.iter().filter(|row| in_b.contains_key(row.place()));
    let tests =
        paired.map(|row| columns.iter().filter(|c| c.error.as_ref().is_some_and(|e| row.number(e).is_some())).count());
    let z = z_limit(tests.sum());
    // rows are compared beside one another; their flags come in the order of the rows
    let found: Vec<(Vec<Change>, Vec<String>)> = a
        .rows
        .par_iter()
        .map(|row| match in_b.get(row.place()) {
            None => (vec![lone(row.place(), &row.place().to_string(), Word::OnlyA)], Vec::new()),
            Some(other) => pair(row, other, &columns, z, effect),
        })
        .collect();
    let mut changes = Vec::new();
    for (of_row, told) in found {
        changes.extend(of_row);
        for flag in told {
            if !flags.contains(&flag) {
                flags.push(flag);
            }
        }
    }
    for row in b.rows.iter().filter(|row| !in_a.contains(row.place())) {
        changes.push(lone(row.place(), &row.place().to_string(), Word::OnlyB));
    }
    Comparison { a: a.folder.display().to_string(), b: b.folder.display().to_string(), flags, changes }
}

/// A column by which rows are compared.
struct Compared {
    name: &'static str,
    unit: &'static str,
    /// The column of its standard error, where it has one.
    error: Option<String>,
}

impl Compared {
    fn new(name: &'static str) -> Self {
        let error = format!("{name}_se");
        let is_column = COLUMNS.iter().any(|c| c.name == error);
        Self { name, unit: unit(name), error: is_column.then_some(error) }
    }
}

fn lone(place: &Place, label: &str, word: Word) -> Change {
    Change {
        place: place.clone(),
        label: label.to_owned(),
        metric: String::new(),
        unit: "",
        a: None,
        b: None,
        change: None,
        interval: None,
        ratio: false,
        word,
        note: String::new(),
    }
}

/// The changes of a row, and what has to be known of them.
fn pair(a: &StoredRow, b: &StoredRow, columns: &[Compared], z: f64, effect: f64) -> (Vec<Change>, Vec<String>) {
    let (mut changes, mut flags) = (Vec::with_capacity(columns.len() + TIMES.len()), Vec::new());
    let (place, label) = (a.place(), a.place().to_string());
    let statuses = [a.text("status"), b.text("status")];
    if statuses != ["ok", "ok"] {
        let note = format!("status {} and {}", statuses[0], statuses[1]);
        let word = if statuses[0] == statuses[1] { Word::Same } else { Word::NotCompared };
        changes.push(Change { note, ..lone(place, &label, word) });
        return (changes, flags);
    }
    let adapters = [a.text("adapter"), b.text("adapter")];
    let same_adapter = adapters[0] == adapters[1];
    if !same_adapter {
        flags.push(format!("the GPU rows are of `{}` in A and of `{}` in B", adapters[0], adapters[1]));
    }
    // between results of the same random numbers there is no noise
    let drawn_anew = !a.draw().is_same(&b.draw());
    if drawn_anew && a.has_drawn_probes() {
        let why = "probes by rays or captures were drawn anew (another seed, scene or version); their noise has no number, and no change of theirs is called significant";
        flags.push(why.to_owned());
    }
    for column in columns {
        let (own, other) = (a.number(column.name), b.number(column.name));
        if own.is_none() && other.is_none() {
            continue;
        }
        let mut change = Change {
            metric: column.name.to_owned(),
            unit: column.unit,
            a: own,
            b: other,
            ..lone(place, &label, Word::Open)
        };
        if let Some((own, other)) = own.zip(other) {
            let difference = other - own;
            change.change = Some(difference);
            let own_error = |row: &StoredRow| column.error.as_ref().and_then(|error| row.number(error));
            let errors = [a, b].map(|row| own_error(row).filter(|_| drawn_anew));
            let error = errors[0].zip(errors[1]).map(|(x, y)| x.hypot(y));
            let half = error.map_or(0.0, |error| Z * error);
            change.interval = Some((difference - half, difference + half));
            let scale = match (column.unit, a.number("rmse"), a.number("nrmse")) {
                ("W/m^2", Some(rmse), Some(nrmse)) if nrmse > 0.0 => rmse / nrmse,
                _ => 1.0,
            };
            let roundings = rounding_error(column.name);
            let rounding = ROUNDING.0 * own.abs() + roundings.unwrap_or(ROUNDING.1 * scale);
            // probes' own noise has no number
            let noisy = drawn_anew && (a.has_drawn_probes() || (error.is_none() && !COUNTS.contains(&column.name)));
            let alike = own.max(other) <= ROUNDING_FACTOR * own.min(other) + rounding;
            change.word = match () {
                () if difference == 0.0 || difference.abs() <= rounding => Word::Same,
                () if roundings.is_some() && alike => Word::Open,
                () if noisy || error.is_some_and(|error| difference.abs() <= rounding + z * error) => Word::Open,
                () => direction(column.name, own, other),
            };
            if noisy && change.word == Word::Open {
                change.note = match error {
                    None => "drawn anew, and this has no standard error".to_owned(),
                    Some(_) => "its probes were drawn anew, and their noise has no number".to_owned(),
                };
            }
        } else {
            change.word = Word::Changed;
        }
        changes.push(change);
    }
    for name in TIMES {
        let (own, other) = (a.samples(name).and_then(Estimate::of), b.samples(name).and_then(Estimate::of));
        if own.is_none() && other.is_none() {
            continue;
        }
        let mut change = Change {
            metric: name.to_owned(),
            unit: unit(name),
            a: own.map(|e| e.value),
            b: other.map(|e| e.value),
            ratio: true,
            ..lone(place, &label, Word::NotCompared)
        };
        let on = [a, b].map(|row| row.times.as_ref().map(|times| times.on.clone()));
        match (own.zip(other), on) {
            (Some((own, other)), [Some(on_a), Some(on_b)]) => {
                let machines =
                    (&on_a.machine, &on_a.adapter, &on_a.driver) == (&on_b.machine, &on_b.adapter, &on_b.driver);
                if !machines {
                    let name = |on: &crate::experiment::TimingIdentity| match &on.adapter {
                        Some(adapter) => format!("{adapter}, {}", on.driver.as_deref().unwrap_or("unknown driver")),
                        None => on.machine.clone(),
                    };
                    change.note = "timed on another machine or adapter".to_owned();
                    flags.push(format!("times are not compared: A on `{}`, B on `{}`", name(&on_a), name(&on_b)));
                } else {
                    let ratio = other.over(&own);
                    (change.change, change.interval) = (Some(ratio.value), ratio.interval);
                    change.word = match () {
                        () if ratio.interval.is_none() => Word::Open,
                        () if !ratio.differs(effect) => Word::Open,
                        () if ratio.value < 1.0 => Word::Better,
                        () => Word::Worse,
                    };
                    if ratio.interval.is_none() {
                        change.note = "too few samples for an interval".to_owned();
                    }
                    if a.text("adapter").contains("(software)") {
                        change.note = "a software adapter: no GPU timing".to_owned();
                    }
                }
            }
            _ => change.note = "timed in one of them only".to_owned(),
        }
        changes.push(change);
    }
    (changes, flags)
}

fn direction(column: &str, a: f64, b: f64) -> Word {
    let lower = if b < a { Word::Better } else { Word::Worse };
    match (column, metric::metric(column).map(|m| m.direction)) {
        (_, Some(Direction::Lower)) => lower,
        (column, None) if is_better_lower(column) => lower,
        (_, Some(Direction::NearerZero)) if b.abs() < a.abs() => Word::Better,
        (_, Some(Direction::NearerZero)) => Word::Worse,
        _ => Word::Changed,
    }
}
