//! Two result folders, run by run.

use std::collections::HashMap;

use serde::Serialize;

use super::interval::{Estimate, z_limit};
use super::stored::{Place, Stored, StoredRow, TIMES};
use crate::experiment::{COLUMNS, ColumnKind};
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

/// Everything in which two results differ, and in which they agree. `effect` is the factor from which a change of a time counts.
pub fn compare(a: &Stored, b: &Stored, effect: f64) -> Comparison {
    let mut flags = Vec::new();
    if a.experiment != b.experiment {
        flags.push(format!("A is of the experiment `{}`, B of `{}`", a.experiment, b.experiment));
    }
    let in_b: HashMap<Place, &StoredRow> = b.rows.iter().map(|row| (row.place(), row)).collect();
    let in_a: std::collections::HashSet<Place> = a.rows.iter().map(StoredRow::place).collect();
    let mut changes = Vec::new();
    let pairs: Vec<(Place, &StoredRow, &StoredRow)> =
        a.rows.iter().filter_map(|row| Some((row.place(), row, *in_b.get(&row.place())?))).collect();
    let tests = pairs
        .iter()
        .map(|(_, row, _)| quality_columns().filter(|c| row.number(&format!("{}_se", c.name)).is_some()).count())
        .sum();
    let z = z_limit(tests);
    for row in &a.rows {
        let place = row.place();
        match in_b.get(&place) {
            None => changes.push(lone(place, Word::OnlyA)),
            Some(other) => pair(&place, row, other, z, effect, &mut changes, &mut flags),
        }
    }
    for row in b.rows.iter().filter(|row| !in_a.contains(&row.place())) {
        changes.push(lone(row.place(), Word::OnlyB));
    }
    Comparison { a: a.folder.display().to_string(), b: b.folder.display().to_string(), flags, changes }
}

fn quality_columns() -> impl Iterator<Item = &'static crate::experiment::Column> {
    let counts = ["sh_vectors", "projections", "direct_lights", "model_bytes"];
    COLUMNS
        .iter()
        .filter(move |c| (c.kind == ColumnKind::Quality && !c.name.ends_with("_se")) || counts.contains(&c.name))
}

fn lone(place: Place, word: Word) -> Change {
    let label = place.to_string();
    Change {
        place,
        label,
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

fn pair(
    place: &Place,
    a: &StoredRow,
    b: &StoredRow,
    z: f64,
    effect: f64,
    changes: &mut Vec<Change>,
    flags: &mut Vec<String>,
) {
    let mut flag = |text: String| {
        if !flags.contains(&text) {
            flags.push(text);
        }
    };
    let statuses = [a.text("status"), b.text("status")];
    if statuses != ["ok", "ok"] {
        let note = format!("status {} and {}", statuses[0], statuses[1]);
        let word = if statuses[0] == statuses[1] { Word::Same } else { Word::NotCompared };
        changes.push(Change { note, ..lone(place.clone(), word) });
        return;
    }
    let adapters = [a.text("adapter"), b.text("adapter")];
    let same_adapter = adapters[0] == adapters[1];
    if !same_adapter {
        flag(format!("the GPU rows are of `{}` in A and of `{}` in B", adapters[0], adapters[1]));
    }
    for column in quality_columns() {
        let (own, other) = (a.number(column.name), b.number(column.name));
        if own.is_none() && other.is_none() {
            continue;
        }
        let mut change = Change {
            metric: column.name.to_owned(),
            unit: column.unit,
            a: own,
            b: other,
            ..lone(place.clone(), Word::Open)
        };
        if let Some((own, other)) = own.zip(other) {
            let difference = other - own;
            change.change = Some(difference);
            let errors = [a, b].map(|row| row.number(&format!("{}_se", column.name)));
            let error = errors[0].zip(errors[1]).map(|(x, y)| x.hypot(y));
            let half = error.map_or(0.0, |error| Z * error);
            change.interval = Some((difference - half, difference + half));
            let scale = match (column.unit, a.number("rmse"), a.number("nrmse")) {
                ("W/m^2", Some(rmse), Some(nrmse)) if nrmse > 0.0 => rmse / nrmse,
                _ => 1.0,
            };
            let rounding = ROUNDING.0 * own.abs() + ROUNDING.1 * scale;
            let noisy = error.is_none() && a.number("ref_noise").is_some_and(|noise| noise > 0.0);
            change.word = match () {
                () if difference == 0.0 || difference.abs() <= rounding => Word::Same,
                () if noisy || error.is_some_and(|error| difference.abs() <= rounding + z * error) => Word::Open,
                () => direction(column.name, own, other),
            };
            if noisy && change.word == Word::Open {
                change.note = "the reference is noisy, and this has no standard error".to_owned();
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
        let unit = COLUMNS.iter().find(|c| c.name == name).map_or("", |c| c.unit);
        let mut change = Change {
            metric: name.to_owned(),
            unit,
            a: own.map(|e| e.value),
            b: other.map(|e| e.value),
            ratio: true,
            ..lone(place.clone(), Word::NotCompared)
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
                    flag(format!("times are not compared: A on `{}`, B on `{}`", name(&on_a), name(&on_b)));
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
}

fn direction(column: &str, a: f64, b: f64) -> Word {
    let lower = if b < a { Word::Better } else { Word::Worse };
    match (column, metric::metric(column).map(|m| m.direction)) {
        (_, Some(Direction::Lower)) => lower,
        ("flip" | "flip_hdr" | "jump" | "condition" | "singular" | "non_finite", None) => lower,
        ("sh_vectors" | "projections" | "direct_lights" | "model_bytes", None) => lower,
        (_, Some(Direction::NearerZero)) if b.abs() < a.abs() => Word::Better,
        (_, Some(Direction::NearerZero)) => Word::Worse,
        _ => Word::Changed,
    }
}
