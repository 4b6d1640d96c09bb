//! Hard cases from their file to their results: what the store holds is not measured again, a family at a time.

use std::panic::{AssertUnwindSafe, catch_unwind};

use serde_json::{Map, Value, json};

use super::progress::Progress;
use super::results::{command_of, relative_path};
use super::{Claim, Store, StoreError, interrupt, write_atomic};
use crate::candidate::GpuBench;
use crate::cost::{processor_name, software_versions};
use crate::experiment::{ALGORITHMS, Algorithms, Identity, Key};
use crate::gpu::{AdapterKind, Gpu};
use crate::stability::{COLUMNS, Curve, CurveId, Family, HardCases, Measured, curves};

/// A curve of a plan.
pub struct PlannedCurve<'c> {
    pub family: &'c Family,
    pub id: CurveId,
    pub identity: Identity,
    pub ending: CurveEnding,
    pub cached: bool,
}

/// How a curve ended.
#[derive(Clone, Debug)]
pub enum CurveEnding {
    Ok(Vec<Measured>),
    Failed(String),
    Skipped(String),
    Open,
}

/// What a run of hard cases did.
pub struct HardRun<'c> {
    pub curves: Vec<PlannedCurve<'c>>,
    pub interrupted: bool,
    pub adapter: Option<Result<String, String>>,
}

impl HardRun<'_> {
    pub fn count(&self, of: impl Fn(&CurveEnding) -> bool) -> usize {
        self.curves.iter().filter(|curve| of(&curve.ending)).count()
    }
}

/// The curves that a filter leaves, each with its identity.
pub fn planned<'c>(cases: &'c HardCases, chosen: &dyn Fn(&Family, &CurveId) -> bool) -> Vec<PlannedCurve<'c>> {
    let mut all = Vec::new();
    for family in &cases.families {
        // lights, box and places; rigs by model
        let stripped: Vec<_> =
            family.cases.iter().map(|case| (case.t, &case.lights, &case.bounds, &case.places)).collect();
        let content = Key::of_bytes(format!("{stripped:?}").as_bytes()).hex();
        for id in cases.curve_ids(family).into_iter().filter(|id| chosen(family, id)) {
            let rigs: Vec<Value> = family.cases.iter().map(|case| json!(case.rigs[id.model])).collect();
            let columns = ["family", "model", "order", "backend"]
                .into_iter()
                .map(|name| (name.to_owned(), HardCases::column(family, &id, name)))
                .filter(|(_, text)| !text.is_empty())
                .collect();
            let identity = Identity {
                columns,
                configuration: json!({ "kind": "stability", "rigs": rigs }),
                scene: content.clone(),
                lights: content.clone(),
                algorithms: Algorithms { timing: 0, ..ALGORITHMS },
            };
            all.push(PlannedCurve { family, id, identity, ending: CurveEnding::Open, cached: false });
        }
    }
    all
}

/// Measures what the store does not hold.
pub fn run<'c>(
    mut curves_planned: Vec<PlannedCurve<'c>>,
    store: &Store,
    force: bool,
    gpu_demanded: bool,
) -> Result<HardRun<'c>, super::SweepError> {
    let identities: Vec<Identity> = curves_planned.iter().map(|curve| curve.identity.clone()).collect();
    for (curve, (_, record)) in curves_planned.iter_mut().zip(store.survey_with_records(&identities, force)) {
        if let Some(points) = record.and_then(|record| serde_json::from_value(record.metrics).ok()) {
            curve.ending = CurveEnding::Ok(points);
            curve.cached = true;
        }
    }
    let bench = match curves_planned.iter().any(|curve| curve.id.gpu) {
        false => None,
        true => Some(match Gpu::open(AdapterKind::Any) {
            Ok(gpu) => Ok(GpuBench::new(gpu)),
            Err(why) if gpu_demanded => return Err(super::SweepError::NoGpu(why.to_string())),
            Err(why) => {
                eprintln!("no usable GPU, going on with the CPU; GPU curves are skipped: {why}");
                Err(why.to_string())
            }
        }),
    };
    let adapter = bench.as_ref().map(|bench| match bench {
        Ok(bench) => Ok(bench.gpu.adapter().label()),
        Err(why) => Err(why.clone()),
    });
    let mut progress = Progress::new("measuring", curves_planned.iter().filter(|c| !c.cached).count() as u64);
    let mut interrupted = false;
    let mut at = 0;
    while at < curves_planned.len() {
        // the curves of one family stand together
        let family = curves_planned[at].family;
        let end = curves_planned[at..]
            .iter()
            .position(|curve| curve.family.name != family.name)
            .map_or(curves_planned.len(), |n| at + n);
        let part = &mut curves_planned[at..end];
        at = end;
        if interrupt::interrupted() {
            interrupted = true;
            break;
        }
        let mut todo: Vec<usize> = Vec::new();
        for (index, curve) in part.iter_mut().enumerate().filter(|(_, curve)| !curve.cached) {
            match bench.as_ref().map(|bench| bench.as_ref().err()) {
                Some(Some(why)) if curve.id.gpu => {
                    if let Claim::Mine(writer) = store.claim(&curve.identity, force, true)? {
                        writer.skip(why)?;
                    }
                    curve.ending = CurveEnding::Skipped(why.clone());
                    progress.step("skipped: no GPU");
                }
                _ => todo.push(index),
            }
        }
        if todo.is_empty() {
            continue;
        }
        let asked: Vec<CurveId> = todo.iter().map(|index| part[*index].id.clone()).collect();
        let opened = bench.as_ref().and_then(|bench| bench.as_ref().ok());
        let measured = catch_unwind(AssertUnwindSafe(|| curves(family, &asked, opened)));
        let measured: Vec<Curve> = measured.unwrap_or_else(|panic| {
            let why = panic.downcast_ref::<String>().cloned().or(panic.downcast_ref::<&str>().map(|s| s.to_string()));
            let why = format!("a panic: {}", why.unwrap_or_default());
            asked.iter().map(|id| Curve { id: id.clone(), points: Err(why.clone()) }).collect()
        });
        for (index, curve) in todo.into_iter().zip(measured) {
            let planned = &mut part[index];
            planned.ending = keep(store, &planned.identity, curve, force)?;
            let label = format!("{} {}", family.name, family.models[planned.id.model].name);
            if let CurveEnding::Failed(why) = &planned.ending {
                progress.say(&format!("failed: {label}: {why}"));
            }
            progress.step(&label);
        }
    }
    Ok(HardRun { curves: curves_planned, interrupted, adapter })
}

fn keep(store: &Store, identity: &Identity, curve: Curve, force: bool) -> Result<CurveEnding, StoreError> {
    let Claim::Mine(writer) = store.claim(identity, force, true)? else {
        // another process has measured the same meanwhile
        return Ok(match curve.points {
            Ok(points) => CurveEnding::Ok(points),
            Err(why) => CurveEnding::Failed(why),
        });
    };
    Ok(match curve.points {
        Ok(points) => {
            writer.finish(serde_json::to_value(&points).expect("numbers are plain JSON"))?;
            CurveEnding::Ok(points)
        }
        Err(why) => {
            writer.fail(&why)?;
            CurveEnding::Failed(why)
        }
    })
}

/// The columns of results.csv of hard cases.
const FIRST: [&str; 10] =
    ["run", "experiment", "family", "parameter", "t", "model", "order", "backend", "adapter", "status"];

/// Writes results.csv (a row a curve and value of the parameter) and results.json.
pub fn write(cases: &HardCases, run: &HardRun, store: &Store) -> Result<(), StoreError> {
    let _lock = store.lock_results()?;
    let columns: Vec<&str> = FIRST.into_iter().chain(COLUMNS.iter().map(|c| c.0)).chain(["largest", "note"]).collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let broken = "csv in memory";
    writer.write_record(&columns).expect(broken);
    let adapter = run.adapter.as_ref().and_then(|a| a.as_ref().ok()).cloned().unwrap_or_default();
    let mut rows = Vec::new();
    for curve in &run.curves {
        let column = |name: &str| HardCases::column(curve.family, &curve.id, name);
        let (status, note, points) = match &curve.ending {
            CurveEnding::Ok(points) => ("ok", "", points.iter().map(Some).collect::<Vec<_>>()),
            CurveEnding::Failed(why) => ("failed", why.as_str(), vec![None]),
            CurveEnding::Skipped(why) => ("skipped", why.as_str(), vec![None]),
            CurveEnding::Open => ("open", "", vec![None]),
        };
        for point in points {
            let number =
                |value: Option<f64>| value.filter(|v| v.is_finite()).map_or(String::new(), |v| format!("{v:?}"));
            let cell = |name: &str| match name {
                "run" => curve.identity.key().run(),
                "experiment" => cases.name.clone(),
                "parameter" => curve.family.parameter.clone(),
                "t" => number(point.map(|p| p.t)),
                "adapter" if curve.id.gpu => adapter.clone(),
                "status" => status.to_owned(),
                "note" => note.to_owned(),
                "family" | "model" | "order" | "backend" => column(name),
                "largest" => number(point.map(|p| p.largest)),
                "non_finite" | "singular" | "naive_non_finite" => {
                    point.and_then(|p| p.column(name)).map_or(String::new(), |v| format!("{}", v as u64))
                }
                _ => number(point.and_then(|p| p.column(name))),
            };
            let cells: Vec<String> = columns.iter().map(|name| cell(name)).collect();
            writer.write_record(&cells).expect(broken);
            let named = columns.iter().zip(cells).filter(|(_, text)| !text.is_empty());
            let is_word = |name: &str| FIRST.contains(&name) && !["t", "order"].contains(&name) || name == "note";
            let object: Map<String, Value> = named
                .map(|(name, text)| match text.parse::<f64>() {
                    Ok(value) if !is_word(name) => ((*name).to_owned(), json!(value)),
                    _ => ((*name).to_owned(), json!(text)),
                })
                .collect();
            rows.push(Value::Object(object));
        }
    }
    write_atomic(&store.root().join("results.csv"), &writer.into_inner().expect(broken))?;
    let described: Vec<Value> =
        COLUMNS.iter().map(|(name, says)| json!({ "name": name, "unit": "", "description": says })).collect();
    let document = json!({
        "experiment": cases.name,
        "title": cases.title,
        "kind": "stability",
        "experiment_file": relative_path(&cases.path, store.root()),
        "changes": cases.changes,
        "families": cases.families.iter().map(|f| json!({ "name": f.name, "title": f.title, "parameter": f.parameter })).collect::<Vec<_>>(),
        "provenance": {
            "versions": software_versions(),
            "processor": processor_name(),
            "adapter": run.adapter.as_ref().and_then(|a| a.as_ref().ok()),
            "no_adapter": run.adapter.as_ref().and_then(|a| a.as_ref().err()),
            "command": command_of(&cases.path, &cases.changes),
        },
        "columns": described,
        "rows": rows,
    });
    let mut bytes = serde_json::to_vec_pretty(&document).expect("results are plain JSON");
    bytes.push(b'\n');
    write_atomic(&store.root().join("results.json"), &bytes)
}
