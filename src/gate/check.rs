//! Thresholds and baseline against stored results.
//!
//! Quality is deterministic and held tightly: a value may move by rounding, which differs between processors (fused multiplications, the
//! system's `sin`), and by nothing else. Random numbers are keyed, so that a run that was drawn again as it was (one key, one noise) is as
//! deterministic as any other. Where it was drawn anew, from another seed or with another count of samples, the standard errors of both sides
//! decide (z-test, 1 % over all tests together). Times are held as ratios within one run alone: a time against the other times of its block, on the machine of the baseline,
//! and it fails only where the ratio and its whole interval lie beyond the limit. Curves of hard cases are held by their largest values;
//! a rounding error keeps its size from one processor to the next and none of its digits, so that it fails only where it grows by a factor.

use std::collections::HashMap;

use serde::Serialize;

use super::baseline::{Baseline, adapter_of};
use super::interval::{Estimate, z_limit};
use super::stored::{COUNTS, Place, Stored, StoredRow, TIMES, rounding_error};
use crate::cost::Samples;
use crate::experiment::{CheckSettings, Threshold};
use crate::metric::{self, Direction};
use crate::stability::Bound;

/// What a check says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    Holds,
    /// Better than the baseline by more than rounding.
    Better,
    /// It could not be held here: another adapter or machine, no interval, noise without a standard error.
    NotCompared,
    /// The baseline does not know it.
    Unknown,
    Failed,
}

/// What is held.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Line of the experiment file.
    Threshold(usize),
    /// A row is there and went well.
    Presence,
    Quality,
    Cost,
}

/// One value held against one limit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    pub verdict: Verdict,
    pub kind: Kind,
    /// The row, in words.
    pub place: String,
    /// Column; empty where the row itself is asked for.
    pub metric: String,
    pub value: Option<f64>,
    /// What it is held against, in words: `at most 0.05`, `0.0123 +- 3e-6`.
    pub limit: String,
    /// Share of what is allowed that is used up: above 1 it is exceeded.
    pub used: Option<f64>,
    /// The setting at which it would pass.
    pub passes_at: Option<String>,
    pub note: Option<String>,
    #[serde(skip)]
    pub row: Option<usize>,
    #[serde(skip)]
    pub baseline_row: Option<usize>,
}

impl Check {
    fn new(verdict: Verdict, kind: Kind, place: &str, metric: &str) -> Self {
        Self {
            verdict,
            kind,
            place: place.to_owned(),
            metric: metric.to_owned(),
            value: None,
            limit: String::new(),
            used: None,
            passes_at: None,
            note: None,
            row: None,
            baseline_row: None,
        }
    }

    fn noted(mut self, note: impl Into<String>) -> Self {
        self.note = Some(note.into());
        self
    }

    fn at(mut self, row: Option<usize>, baseline_row: Option<usize>) -> Self {
        (self.row, self.baseline_row) = (row, baseline_row);
        self
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Options {
    pub settings: CheckSettings,
    /// What is better or could not be compared fails too.
    pub strict: bool,
}

/// The thresholds of an experiment's file.
#[derive(Clone, Copy, Debug)]
pub enum Thresholds<'t> {
    OfRuns(&'t [Threshold]),
    /// Of hard cases.
    OfCurves(&'t [Bound]),
}

/// Every threshold and every value of the baseline.
pub fn check(stored: &Stored, limits: Thresholds, baseline: Option<&Baseline>, options: Options) -> Vec<Check> {
    let names: Vec<String> = stored.rows.iter().map(|row| row.place().to_string()).collect();
    let mut all = presence(stored, &names);
    all.extend(thresholds(stored, limits));
    if let Some(baseline) = baseline {
        against_baseline(stored, &names, baseline, options.settings, &mut all);
    }
    if options.strict {
        for check in all.iter_mut().filter(|c| matches!(c.verdict, Verdict::Better | Verdict::NotCompared)) {
            check.verdict = Verdict::Failed;
            check.note.get_or_insert_with(|| "strict: better is a change too".to_owned());
        }
    }
    all
}

/// Runs that went wrong or were not run, and results without any.
fn presence(stored: &Stored, names: &[String]) -> Vec<Check> {
    if stored.rows.is_empty() {
        let check = Check::new(Verdict::Failed, Kind::Presence, "", "");
        return vec![check.noted("the results hold no run")];
    }
    let mut all = Vec::new();
    for (index, row) in stored.rows.iter().enumerate() {
        let (verdict, word) = match row.text("status") {
            "ok" => continue,
            "skipped" => (Verdict::NotCompared, "was skipped"),
            "open" => (Verdict::Failed, "was not run"),
            _ => (Verdict::Failed, "failed"),
        };
        let note = format!("the run {word}: {}", row.text("note"));
        all.push(Check::new(verdict, Kind::Presence, &names[index], "").noted(note).at(Some(index), None));
    }
    all
}

/// Every run under every threshold; a run that failed or lacks the metric does not hold. Runs that were skipped for want of a GPU, or left
/// out by a filter, are not asked.
pub fn thresholds(stored: &Stored, thresholds: Thresholds) -> Vec<Check> {
    match thresholds {
        Thresholds::OfRuns(thresholds) => of_runs(stored, thresholds),
        Thresholds::OfCurves(bounds) => bounds.iter().flat_map(|bound| of_curves(stored, bound)).collect(),
    }
}

fn of_runs(stored: &Stored, thresholds: &[Threshold]) -> Vec<Check> {
    let mut all = Vec::new();
    let asked: Vec<(usize, &StoredRow)> = stored
        .rows
        .iter()
        .enumerate()
        .filter(|(_, row)| row.is_pooled() && !["skipped", "open"].contains(&row.text("status")))
        .collect();
    for threshold in thresholds {
        let before = all.len();
        for (index, row) in asked.iter().filter(|(_, row)| row.matches(&threshold.selection)) {
            all.push(under_threshold(threshold, row, &asked).at(Some(*index), None));
        }
        if all.len() == before {
            let kind = Kind::Threshold(threshold.line);
            let check = Check::new(Verdict::NotCompared, kind, "", threshold.metric.name);
            all.push(check.noted("no run of the results is under this threshold"));
        }
    }
    all
}

/// Every curve under a threshold. A curve that was skipped for want of a GPU is not asked; one that failed does not hold; and one without
/// the metric (a model without a naive form, a light without an independent route) is not asked, as long as another of the threshold's
/// curves has it.
fn of_curves(stored: &Stored, bound: &Bound) -> Vec<Check> {
    let metric = bound.metric.as_str();
    let kind = || Kind::Threshold(bound.line);
    let limit = match (bound.max, bound.reaches) {
        (Some(max), Some(least)) => format!("at most {max:?}, reaches {least:?}"),
        (Some(max), None) => format!("at most {max:?}"),
        (None, least) => format!("reaches {:?}", least.unwrap_or_default()),
    };
    let mut all = Vec::new();
    let mut asked = 0;
    for (index, row) in stored.rows.iter().enumerate().filter(|(_, row)| bound.selects(|column| row.text(column))) {
        if ["skipped", "open"].contains(&row.text("status")) {
            continue;
        }
        asked += 1;
        let mut check = Check::new(Verdict::Holds, kind(), &row.place().to_string(), metric).at(Some(index), None);
        check.limit.clone_from(&limit);
        let Some(value) = row.number(metric) else {
            if !row.is_ok() {
                check.verdict = Verdict::Failed;
                all.push(check.noted("the curve has no such value"));
            }
            continue;
        };
        check.value = Some(value);
        check.note = row.worst_at(metric).map(|t| format!("at {} = {t:.3e}", row.text("parameter")));
        let over = bound.max.filter(|max| value > *max);
        let under = bound.reaches.filter(|least| value < *least);
        let shares = [bound.max.map(|max| value / max), bound.reaches.map(|least| least / value)];
        check.used = shares.into_iter().flatten().filter(|share| share.is_finite()).reduce(f64::max);
        if over.is_some() || under.is_some() {
            check.verdict = Verdict::Failed;
            let word = if over.is_some() { "max" } else { "reaches" };
            check.passes_at = Some(format!("{word} = {value:?}"));
        }
        all.push(check);
    }
    if all.is_empty() {
        let (verdict, note) = match asked {
            0 => (Verdict::NotCompared, "no curve of the results is under this threshold"),
            _ => (Verdict::Failed, "no curve has this metric"),
        };
        all.push(Check::new(verdict, kind(), "", metric).noted(note));
    }
    all
}

/// A value, with its interval where it is a time with samples.
fn estimate(row: &StoredRow, column: &str) -> Option<Estimate> {
    let of_samples = row.samples(column).and_then(Estimate::of);
    of_samples.or_else(|| row.number(column).map(|value| Estimate { value, interval: None }))
}

fn under_threshold(threshold: &Threshold, row: &StoredRow, rows: &[(usize, &StoredRow)]) -> Check {
    let name = threshold.metric.name;
    let place = row.place();
    let mut check = Check::new(Verdict::Holds, Kind::Threshold(threshold.line), &place.to_string(), name);
    let own = estimate(row, name);
    let value = match &threshold.per {
        None => own,
        Some(per) => {
            // the run of the same case that the words pick; of several the one that agrees most
            let agreement = |other: &Place| place.0.iter().filter(|(c, text)| other.get(c) == text).count();
            let same_case = |other: &Place| ["scene", "lights", "backend"].iter().all(|c| other.get(c) == place.get(c));
            let picked = rows
                .iter()
                .filter(|(_, other)| other.matches(per))
                .map(|(_, other)| (other.place(), *other))
                .filter(|(other, _)| same_case(other))
                .max_by_key(|(other, _)| (agreement(other), std::cmp::Reverse(*other)));
            let Some((other_place, other)) = picked else {
                check.verdict = Verdict::Failed;
                return check.noted("no run of the same scene, lights and backend is picked by `per`");
            };
            check.note = Some(format!("as a ratio to {other_place}"));
            own.zip(estimate(other, name).filter(|e| e.value > 0.0)).map(|(own, other)| own.over(&other))
        }
    };
    check.limit = match (threshold.min, threshold.max) {
        (Some(min), Some(max)) => format!("{min} to {max}"),
        (Some(min), None) => format!("at least {min}"),
        (None, Some(max)) => format!("at most {max}"),
        (None, None) => String::new(),
    };
    let Some(value) = value else {
        check.verdict = Verdict::Failed;
        return check.noted("the run has no such value");
    };
    check.value = Some(value.value);
    let timed = TIMES.contains(&name);
    let (low, high) = value.interval.unwrap_or((value.value, value.value));
    let (mut exceeded, mut surely, mut passes) = (false, false, String::new());
    let mut used = Vec::new();
    if let Some(max) = threshold.max {
        if max != 0.0 {
            used.push(value.value / max);
        }
        if value.value > max || value.value.is_nan() {
            exceeded = true;
            surely |= low > max;
            passes = format!("max = {:?}", if timed { low } else { value.value });
        }
    }
    if let Some(min) = threshold.min {
        if value.value != 0.0 {
            used.push(min / value.value);
        }
        if value.value < min || value.value.is_nan() {
            exceeded = true;
            surely |= high < min;
            passes = format!("min = {:?}", if timed { high } else { value.value });
        }
    }
    check.used = used.into_iter().filter(|u| u.is_finite()).reduce(f64::max);
    if exceeded && (surely || !timed) {
        check.verdict = Verdict::Failed;
        check.passes_at = Some(passes);
    } else if exceeded {
        let why = match value.interval {
            Some((low, high)) => format!("beyond the limit, but its interval {low:.4} to {high:.4} is not"),
            None => "beyond the limit, but of too few samples for an interval".to_owned(),
        };
        let verdict = if value.interval.is_some() { Verdict::Holds } else { Verdict::NotCompared };
        check.verdict = verdict;
        check.note = Some(why);
    }
    check
}

fn against_baseline(
    stored: &Stored,
    names: &[String],
    baseline: &Baseline,
    settings: CheckSettings,
    all: &mut Vec<Check>,
) {
    // the rows of the baseline at a place: on the GPU one an adapter
    let mut known: HashMap<&Place, Vec<usize>> = HashMap::with_capacity(baseline.rows.len());
    for (index, row) in baseline.rows.iter().enumerate() {
        known.entry(&row.place).or_default().push(index);
    }
    let mut pairs: Vec<(usize, usize)> = Vec::new();
    let mut met = vec![false; baseline.rows.len()];
    for (index, row) in stored.rows.iter().enumerate() {
        let ok = row.is_ok();
        let check = |verdict, note: &str| {
            Check::new(verdict, Kind::Presence, &names[index], "").noted(note).at(Some(index), None)
        };
        let held = known.get(row.place()).map_or(&[][..], Vec::as_slice);
        match held.iter().find(|held| baseline.rows[**held].adapter.as_deref() == adapter_of(row)) {
            Some(held) => {
                met[*held] = true;
                if ok {
                    pairs.push((index, *held));
                }
            }
            None if held.is_empty() => {
                if ok {
                    all.push(check(Verdict::Unknown, "not in the baseline"));
                }
            }
            // the same place on another adapter, or skipped
            None => {
                held.iter().for_each(|held| met[*held] = true);
                if ok {
                    let theirs = baseline.rows[held[0]].adapter.as_deref().unwrap_or("none");
                    let note = format!("its baseline is of the adapter {theirs}, not {}", row.text("adapter"));
                    all.push(check(Verdict::NotCompared, &note));
                }
            }
        }
    }
    for (index, held) in baseline.rows.iter().enumerate().filter(|(index, _)| !met[*index]) {
        let check = Check::new(Verdict::Failed, Kind::Presence, &held.place.to_string(), "");
        all.push(check.noted("in the baseline, not in the results").at(None, Some(index)));
    }

    // columns with the name of their standard error, and whether they have one
    let held_columns: Vec<(&str, Option<String>)> = stored
        .kind
        .held()
        .iter()
        .filter(|column| !column.ends_with("_se"))
        .map(|column| {
            let error = format!("{column}_se");
            (*column, stored.kind.held().contains(&error.as_str()).then_some(error))
        })
        .collect();
    // the standard errors that decide: none where the same numbers were drawn
    let noisy = |row: usize, held: usize, error: &Option<String>| {
        let error = error.as_deref().filter(|_| !baseline.rows[held].draw().is_same(&stored.rows[row].draw()))?;
        stored.rows[row].number(error).zip(baseline.rows[held].values.get(error).copied())
    };
    let tests: usize = pairs
        .iter()
        .map(|(row, held)| held_columns.iter().filter(|(_, error)| noisy(*row, *held, error).is_some()).count())
        .sum();
    let z = z_limit(tests);
    for &(row, held) in &pairs {
        let drawn_anew = !baseline.rows[held].draw().is_same(&stored.rows[row].draw());
        for (column, error) in &held_columns {
            let own = stored.rows[row].number(column);
            let base = baseline.rows[held].values.get(*column).copied();
            if own.is_none() && base.is_none() {
                continue;
            }
            let mut check = Check::new(Verdict::Holds, Kind::Quality, &names[row], column);
            check = check.at(Some(row), Some(held));
            check.value = own;
            match (own, base) {
                (_, None) => {
                    check.verdict = Verdict::NotCompared;
                    check.note = Some("the baseline has no such value".to_owned());
                }
                (None, Some(base)) => {
                    check.verdict = Verdict::Failed;
                    check.limit = format!("{base:?}");
                    check.note = Some("the run no longer has this value".to_owned());
                }
                (Some(own), Some(base)) => {
                    let scale = scale_of(column, &baseline.rows[held].values);
                    let chance = Chance {
                        errors: noisy(row, held, error),
                        reference: drawn_anew,
                        probes: drawn_anew && stored.rows[row].has_drawn_probes(),
                    };
                    quality(&mut check, own, base, scale, chance, z, settings);
                }
            }
            all.push(check);
        }
    }
    if settings.times {
        cost(stored, names, baseline, &pairs, settings, all);
    }
}

/// Rounding that is forgiven beside the relative change, in the unit of the column: sixteen times the rounding of f32 against the reference.
fn scale_of(column: &str, values: &std::collections::BTreeMap<String, f64>) -> f64 {
    let value = |name: &str| values.get(name).copied().unwrap_or(0.0);
    match column {
        "rmse" | "p95" | "max_abs" if value("nrmse") > 0.0 => value("rmse") / value("nrmse"),
        _ => 1.0,
    }
}

/// What chance may have to do with the difference of two values.
#[derive(Clone, Copy)]
struct Chance {
    /// Standard errors of both, from the noise of their references.
    errors: Option<(f64, f64)>,
    /// Their references were drawn apart.
    reference: bool,
    /// So were the samples of the candidate's probes, whose noise has no number.
    probes: bool,
}

fn quality(check: &mut Check, own: f64, base: f64, scale: f64, chance: Chance, z: f64, settings: CheckSettings) {
    let errors = chance.errors;
    let name = check.metric.clone();
    let roundings = rounding_error(&name);
    let is_count = COUNTS.contains(&name.as_str()) || ["singular", "non_finite"].contains(&name.as_str());
    let (relative, floor) = match name.as_str() {
        _ if roundings.is_some() => (settings.error - 1.0, roundings.unwrap_or_default()),
        _ if is_count => (0.0, 0.0),
        // mean of a picture: a pixel at an edge may fall to its other side
        "flip" => (settings.quality.max(1e-3), 1e-5),
        // of a system near to singular
        "condition" => (settings.quality.max(1e-2), 0.0),
        _ => (settings.quality, 2e-6 * scale),
    };
    let rounding = relative * base.abs() + floor;
    let allowed = errors.map_or(rounding, |(a, b)| rounding + z * a.hypot(b));
    // how much worse; negative where it is better
    let lower = || own - base;
    let worse = match (name.as_str(), metric::metric(&name).map(|m| m.direction)) {
        (_, Some(Direction::Lower)) => lower(),
        (name, None) if is_better_lower(name) && !COUNTS.contains(&name) => lower(),
        // nearer to zero on the same side is better, everything else is a change
        (_, Some(Direction::NearerZero)) if own * base >= 0.0 && own.abs() <= base.abs() => own.abs() - base.abs(),
        _ => (own - base).abs(),
    };
    check.limit = match errors {
        Some(_) => format!("{base:?} +- {allowed:.2e} (noise: |z| under {z:.2})"),
        None => format!("{base:?} +- {allowed:.2e}"),
    };
    check.used = (allowed > 0.0).then(|| worse.max(0.0) / allowed);
    check.verdict = match () {
        () if worse.is_nan() => Verdict::Failed,
        () if roundings.is_some() && base > settings.error * own + floor => Verdict::Better,
        () if worse <= allowed && worse >= -allowed => Verdict::Holds,
        () if chance.reference && errors.is_none() && !is_count => {
            check.note = Some("it was drawn anew, and this has no standard error".to_owned());
            Verdict::NotCompared
        }
        // an adaptive volume's samples are as many as noise divides cells
        () if chance.probes && !["singular", "non_finite"].contains(&name.as_str()) => {
            let why = "its probes were drawn anew (another seed, scene or version), and their noise has no number: see, then accept";
            check.note = Some(why.to_owned());
            Verdict::Unknown
        }
        () if worse < 0.0 => Verdict::Better,
        () => Verdict::Failed,
    };
    if check.verdict == Verdict::Failed {
        check.passes_at = match errors {
            Some((a, b)) if a.hypot(b) > 0.0 => {
                Some(format!("a limit of |z| of {:.2}", (worse - rounding) / a.hypot(b)))
            }
            _ if roundings.is_some() => {
                (base > 0.0).then(|| format!("[check] error = {:.3e}", 1.0 + (worse - floor).max(0.0) / base))
            }
            _ if base != 0.0 && relative > 0.0 => {
                Some(format!("[check] quality = {:.3e}", (worse - floor).max(0.0) / base.abs()))
            }
            _ => None,
        };
    }
}

/// Whether less is better of a column that is no metric of points.
pub(super) fn is_better_lower(column: &str) -> bool {
    let others = ["flip", "flip_hdr", "leak", "clamped_share", "condition", "singular", "non_finite"];
    let of_volumes = column.ends_with("jump") || column.ends_with("_nrmse");
    of_volumes || others.contains(&column) || COUNTS.contains(&column) || rounding_error(column).is_some()
}

/// Times of the pairs, block by block: how each changed against the median of the others.
fn cost(
    stored: &Stored,
    names: &[String],
    baseline: &Baseline,
    pairs: &[(usize, usize)],
    settings: CheckSettings,
    all: &mut Vec<Check>,
) {
    for column in TIMES {
        let mut blocks: HashMap<[&str; 4], Vec<(usize, usize, Estimate)>> = HashMap::new();
        let mut order: Vec<[&str; 4]> = Vec::new();
        for &(row, held) in pairs {
            let (now, then) = (&stored.rows[row], &baseline.rows[held]);
            let Some(base) = then.estimate(column) else { continue };
            let mut check = Check::new(Verdict::NotCompared, Kind::Cost, &names[row], column).at(Some(row), Some(held));
            let Some(own) = now.samples(column).and_then(Estimate::of) else {
                check.note = Some("it was not timed".to_owned());
                all.push(check);
                continue;
            };
            let on = now.times.as_ref().map(|times| &times.on);
            let same = on.zip(then.timed_on.as_ref()).is_some_and(|(a, b)| {
                (&a.machine, &a.adapter, &a.driver, a.algorithms) == (&b.machine, &b.adapter, &b.driver, b.algorithms)
            });
            let why = match () {
                () if now.text("adapter").contains("(software)") => {
                    Some("times of a software adapter are no GPU timings")
                }
                () if !same => Some("the baseline was timed on another machine, adapter or driver"),
                () if own.interval.is_none() => Some("too few samples for an interval"),
                () => None,
            };
            if let Some(why) = why {
                check.note = Some(why.to_owned());
                all.push(check);
                continue;
            }
            let block = [now.text("scene"), now.text("lights"), now.text("backend"), now.text("adapter")];
            if !blocks.contains_key(&block) {
                order.push(block);
            }
            blocks.entry(block).or_default().push((row, held, own.over(&base)));
        }
        for block in order {
            let members = &blocks[&block];
            for (index, (row, held, own)) in members.iter().enumerate() {
                let mut check =
                    Check::new(Verdict::Holds, Kind::Cost, &names[*row], column).at(Some(*row), Some(*held));
                let others = members.iter().enumerate().filter(|(i, _)| *i != index).map(|(_, (_, _, e))| e.value);
                let others = Samples(others.collect());
                let Some(common) = others.median() else {
                    check.verdict = Verdict::NotCompared;
                    check.note = Some("it stands alone in its block: there is no ratio".to_owned());
                    all.push(check);
                    continue;
                };
                // the interval of the median of the others; their whole range where they are few
                let range = || {
                    let ends = others.0.iter().fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(*v), b.max(*v)));
                    (ends.0, ends.1)
                };
                let interval = others.median_interval().unwrap_or_else(range);
                let change = own.over(&Estimate { value: common, interval: Some(interval) });
                let (low, high) = change.interval.expect("both sides have one");
                check.value = Some(change.value);
                check.limit =
                    format!("at most {} times the baseline's ratio to the others of its block", settings.cost);
                check.used = Some(change.value / settings.cost);
                check.note = Some(format!("interval {low:.3} to {high:.3}"));
                if change.value > settings.cost && low > settings.cost {
                    check.verdict = Verdict::Failed;
                    check.passes_at = Some(format!("[check] cost = {low:.3}"));
                } else if change.value < 1.0 / settings.cost && high < 1.0 / settings.cost {
                    check.verdict = Verdict::Better;
                }
                all.push(check);
            }
        }
    }
}
