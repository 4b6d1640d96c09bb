//! results.csv and results.json: a row a run, in the order of the plan, the columns of [`COLUMNS`].

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::block::Scores;
use super::sweep::{Ending, Run, Sweep};
use super::{Store, StoreError, write_atomic};
use crate::cost::{processor_name, software_versions};
use crate::experiment::{Axis, COLUMNS, Experiment};

/// A cell, as its column's text; absent where it has no meaning.
type Cells = BTreeMap<&'static str, String>;

/// A number that reads back to the same value.
fn number(value: f64) -> Option<String> {
    value.is_finite().then(|| format!("{value:?}"))
}

fn put(cells: &mut Cells, column: &'static str, value: Option<String>) {
    debug_assert!(COLUMNS.iter().any(|c| c.name == column), "`{column}` is no column");
    if let Some(value) = value {
        cells.insert(column, value);
    }
}

/// The rows of a run: pooled over receivers and frames; then, where there are several, one a receiver and one a frame.
fn rows(experiment: &Experiment, run: &Run) -> Vec<Cells> {
    let mut identity = Cells::new();
    put(&mut identity, "run", Some(run.identity.key().run()));
    put(&mut identity, "experiment", Some(experiment.name.clone()));
    for axis in Axis::ALL {
        put(&mut identity, axis.name(), run.candidate.column(axis).map(str::to_owned));
    }
    put(&mut identity, "adapter", run.adapter.clone());
    let mut pooled = identity.clone();
    let (status, note) = match &run.ending {
        Ending::Ok(_) => ("ok", None),
        Ending::Failed(why) => ("failed", Some(why.clone())),
        Ending::Skipped(why) => ("skipped", Some(why.clone())),
        Ending::Open => ("open", None),
    };
    put(&mut pooled, "status", Some(status.to_owned()));
    put(&mut pooled, "note", note);
    let Some(findings) = run.findings() else { return vec![pooled] };
    put(&mut pooled, "effects", Some(findings.effects.clone()));
    scores(&mut pooled, &findings.pooled);
    put(&mut pooled, "flip", findings.flip.and_then(number));
    put(&mut pooled, "flip_hdr", run.flip_hdr.and_then(number));
    let counts = &findings.counts;
    for (column, count) in [
        ("sh_vectors", counts.sh_vectors),
        ("projections", counts.projections),
        ("model_bytes", counts.model_bytes),
        ("singular", Some(counts.singular)),
        ("non_finite", Some(findings.non_finite)),
    ] {
        put(&mut pooled, column, count.map(|c| c.to_string()));
    }
    // a whole number where every frame has as many
    let direct_lights = findings.direct_lights.or(counts.direct_lights.map(|c| c as f64));
    put(&mut pooled, "direct_lights", direct_lights.map(|c| c.to_string()));
    put(&mut pooled, "condition", counts.condition.and_then(number));
    for column in ["shadow_rays", "closest_rays", "bounces", "emitter_samples", "wrap_evaluations"] {
        put(&mut pooled, column, findings.counters.get(column).map(u64::to_string));
    }
    if let Some(times) = &run.times {
        for (column, value) in [
            ("setup_us", times.setup_us.median()),
            ("setup_us_mad", times.setup_us.mad()),
            ("once_us", times.once_us),
            ("eval_ns_per_point", times.eval_ns_per_point.median()),
            ("eval_ns_per_point_mad", times.eval_ns_per_point.mad()),
            ("frame_us_vertices", times.frame_us(findings.vertices as f64)),
            ("frame_us_1m", times.frame_us(1e6)),
        ] {
            put(&mut pooled, column, value.and_then(number));
        }
        put(&mut pooled, "timer", Some(times.timer.clone()));
    }
    put(&mut pooled, "pareto", (!run.fronts.is_empty()).then(|| run.fronts.join(" ")));
    let mut all = vec![pooled];
    for (receiver, of_receiver) in &findings.receivers {
        let mut cells = identity.clone();
        put(&mut cells, "receiver", Some(receiver.clone()));
        put(&mut cells, "status", Some("ok".to_owned()));
        scores(&mut cells, of_receiver);
        all.push(cells);
    }
    for (frame, of_frame) in findings.frames.iter().enumerate() {
        let mut cells = identity.clone();
        put(&mut cells, "frame", Some(frame.to_string()));
        put(&mut cells, "status", Some("ok".to_owned()));
        scores(&mut cells, of_frame);
        all.push(cells);
    }
    all
}

/// One cell of a run's pooled row.
pub fn cell(experiment: &Experiment, run: &Run, column: &str) -> Option<String> {
    rows(experiment, run).first()?.get(column).cloned()
}

/// Metrics into their columns; what is missing or not resolved goes into the note.
fn scores(cells: &mut Cells, scores: &Scores) {
    for column in COLUMNS {
        put(cells, column.name, scores.values.get(column.name).copied().and_then(number));
    }
    let mut notes: Vec<String> = Vec::new();
    for (metric, why) in &scores.reasons {
        if metric != "ref_noise" && !why.contains("keeps no spherical harmonics") {
            notes.push(format!("{metric}: {why}"));
        }
    }
    if !scores.not_resolved.is_empty() {
        notes.push(format!("not resolved: {}", scores.not_resolved.join(" ")));
    }
    if !notes.is_empty() {
        cells.insert("note", notes.join("; "));
    }
}

/// Writes results.csv and results.json, whole or not at all. The same sweep gives the same bytes of results.csv.
pub fn write(experiment: &Experiment, sweep: &Sweep, store: &Store) -> Result<(), StoreError> {
    let _lock = store.lock_results()?;
    let mut writer = csv::Writer::from_writer(Vec::new());
    let broken = "csv in memory";
    writer.write_record(COLUMNS.iter().map(|c| c.name)).expect(broken);
    let mut json_rows = Vec::new();
    for run in &sweep.runs {
        for (index, cells) in rows(experiment, run).into_iter().enumerate() {
            let text = |name: &str| cells.get(name).map_or("", String::as_str);
            writer.write_record(COLUMNS.iter().map(|c| text(c.name))).expect(broken);
            let mut object: Map<String, Value> =
                cells.iter().map(|(name, text)| ((*name).to_owned(), value_of(name, text))).collect();
            if let (0, Some(times), Some(on)) = (index, &run.times, &run.timed_on) {
                object.insert("times".to_owned(), json!({ "on": on, "samples": times }));
            }
            json_rows.push(Value::Object(object));
        }
    }
    write_atomic(&store.root().join("results.csv"), &writer.into_inner().expect(broken))?;
    let (adapter, no_adapter) = match &sweep.adapter {
        Some(Ok(label)) => (Some(label.clone()), None),
        Some(Err(why)) => (None, Some(why.clone())),
        None => (None, None),
    };
    let effects: BTreeMap<String, Value> = sweep
        .runs
        .iter()
        .filter_map(|run| {
            let findings = run.findings()?;
            let place = format!("{} x {}", run.candidate.scene.name, run.candidate.lights.layout.name);
            Some((place, json!({ "effects": findings.effects, "why": findings.effects_why })))
        })
        .collect();
    let document = json!({
        "experiment": experiment.name,
        "title": experiment.title,
        "seed": experiment.seed,
        "provenance": {
            "versions": software_versions(),
            "processor": processor_name(),
            "adapter": adapter,
            "no_adapter": no_adapter,
            "driver": sweep.driver,
            "threads": rayon::current_num_threads(),
            "command": command_of(&experiment.path, &experiment.changes),
        },
        "experiment_file": relative_path(&experiment.path, store.root()),
        "changes": experiment.changes,
        "picture_frame": experiment.image.frame,
        "effects": effects,
        "claims": experiment.claims.iter().map(|c| json!({ "name": c.name, "says": c.says })).collect::<Vec<_>>(),
        "columns": COLUMNS.iter().map(|c| json!({ "name": c.name, "unit": c.unit, "description": c.description })).collect::<Vec<_>>(),
        "rows": json_rows,
    });
    let mut bytes = serde_json::to_vec_pretty(&document).expect("results are plain JSON");
    bytes.push(b'\n');
    write_atomic(&store.root().join("results.json"), &bytes)
}

/// The command that runs an experiment as it was run, for a shell; filters left out.
pub(super) fn command_of(path: &Path, changes: &[String]) -> String {
    let mut command = format!("rigbench run {}", shell_word(&path.display().to_string()));
    for change in changes {
        command += &format!(" --set {}", shell_word(change));
    }
    command
}

/// A word as a POSIX shell reads it back.
pub fn shell_word(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./=:,+@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text.to_owned()
    } else {
        format!("'{}'", text.replace('\'', "'\\''"))
    }
}

/// The command that made the results in a folder; empty where it is not said.
pub fn command(folder: &Path) -> String {
    let text = std::fs::read(folder.join("results.json")).unwrap_or_default();
    let document: Value = serde_json::from_slice(&text).unwrap_or_default();
    document["provenance"]["command"].as_str().unwrap_or_default().to_owned()
}

/// A path as seen from a folder, so that a project can be moved as a whole; the whole path where one of them is not there.
pub(super) fn relative_path(path: &Path, from: &Path) -> PathBuf {
    let (Ok(path), Ok(from)) = (path.canonicalize(), from.canonicalize()) else { return path.to_owned() };
    let shared = path.components().zip(from.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(shared).map(|_| Path::new(".."));
    up.chain(path.components().skip(shared).map(|c| Path::new(c.as_os_str()))).collect()
}

/// Numbers as numbers, words as words: names that look like numbers stay words.
fn value_of(column: &str, text: &str) -> Value {
    use crate::experiment::ColumnKind;
    let is_word = COLUMNS
        .iter()
        .find(|c| c.name == column)
        .is_none_or(|c| matches!(c.kind, ColumnKind::Identity | ColumnKind::Circumstance));
    let is_count = matches!(column, "order" | "frame");
    match text.parse::<f64>() {
        Ok(value) if !is_word || is_count => match text.parse::<u64>() {
            Ok(count) => json!(count),
            Err(_) => json!(value),
        },
        _ => json!(text),
    }
}
