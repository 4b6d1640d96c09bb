//! The gate holds what is right and sees what is wrong: sabotaged runs, a missing baseline, empty results.

use std::path::Path;

use rigbench::candidate::{Lit, Surroundings, prepare};
use rigbench::experiment::{Candidate, Experiment};
use rigbench::math::Rgb;
use rigbench::metric::{self, Scored};
use rigbench::reference;
use rigbench::run::{Claim, Findings, Scores, Store, recipe_of};
use rigbench::sh::Lobe;
use serde_json::Value;

use super::{RUNS, done, project, results, rigbench, rigbench_does};

const THRESHOLDS: &str = "[[threshold]]\nwhere = { rig = \"direct\" }\nmetric = \"nrmse\"\nmax = 1e-5\n\
     [[threshold]]\nwhere = { rig = [\"gradient\", \"lattice\"] }\nmetric = \"interpolation_nrmse\"\nper = { rig = \"constant\" }\nmax = 0.9\n";

/// Every metric of what `sabotage` makes of the irradiance of a candidate: E of the candidate itself and of the rig `constant`.
fn sabotaged(folder: &Path, rig: &str, sabotage: impl Fn(Rgb<f64>, Rgb<f64>) -> Rgb<f64>) {
    let experiment = Experiment::load(&folder.join("experiments/small.toml")).unwrap();
    let store = Store::at(&results(folder));
    let named = |candidate: &&Candidate, rig: &str| candidate.label().split(' ').nth(2) == Some(rig);
    for candidate in experiment.candidates.iter().filter(|c| named(c, rig)) {
        let receiver = &candidate.scene.receivers[0];
        let (points, bounds) = (receiver.area_points(0, 4096), receiver.oriented_box(0));
        let lights = candidate.lights.at(0, 1);
        let around = Surroundings { bounds, lights: &lights, wrap: 0.0, transport: None };
        let values = |candidate: &Candidate| {
            let lit: Box<dyn Lit> = prepare(&recipe_of(candidate, experiment.seed), &around, None).unwrap();
            lit.irradiance(&points).unwrap()
        };
        let constant =
            experiment.candidates.iter().find(|c| named(c, "constant") && c.lights.name() == candidate.lights.name());
        let own = values(candidate);
        let wrong: Vec<Rgb<f64>> = own.iter().zip(values(constant.unwrap())).map(|(e, c)| sabotage(*e, c)).collect();
        let lobe = Lobe::<f64>::new(0.0);
        let truth = reference::exact(&lights, &points, &lobe, glam::DVec3::ZERO).irradiance;
        let truncated = candidate
            .order
            .filter(|_| candidate.rig().is_some())
            .map(|order| reference::truncated(&lights, &points, &lobe, &[order]).remove(0));
        let scored =
            Scored { reference: &truth, standard_error: None, truncated: truncated.as_deref(), candidate: &wrong };
        let identity = candidate.identity();
        let before = store.record(&identity.key()).expect("it was run before").metrics;
        let mut findings: Findings = serde_json::from_value(before).unwrap();
        findings.pooled = Scores::default();
        for (key, score) in metric::measure(&scored) {
            findings.pooled.values.extend(score.ok().map(|score| (key.to_owned(), score.value)));
        }
        let Claim::Mine(writer) = store.claim(&identity, true, true).unwrap() else { panic!("someone else has it") };
        writer.finish(serde_json::to_value(&findings).unwrap()).unwrap();
    }
    // the results as the store has them now
    let (exit, _, log) = rigbench_does(folder, &["run", "experiments/small.toml", "--no-figures"]);
    assert!([0, 101].contains(&exit) && log.contains(&format!("0 computed, {RUNS} cached")), "{log}");
}

fn check(folder: &Path, more: &[&str]) -> (i32, String, String) {
    rigbench_does(folder, &[&["check", "results/small"][..], more].concat())
}

/// Elements of an XML document by name; a document that is not well formed fails.
fn xml(text: &str) -> std::collections::HashMap<String, usize> {
    use quick_xml::events::Event;
    let mut reader = quick_xml::Reader::from_str(text);
    reader.config_mut().check_end_names = true;
    let (mut counted, mut open) = (std::collections::HashMap::new(), Vec::new());
    loop {
        let event = reader.read_event().unwrap_or_else(|why| panic!("{why} at {}: {text}", reader.buffer_position()));
        let mut count = |name: &[u8]| *counted.entry(String::from_utf8_lossy(name).into_owned()).or_default() += 1;
        match event {
            Event::Start(element) => {
                count(element.name().as_ref());
                element
                    .attributes()
                    .for_each(|a| drop(a.unwrap().normalized_value(quick_xml::XmlVersion::Explicit1_0).unwrap()));
                open.push(element.name().as_ref().to_vec());
            }
            Event::Empty(element) => {
                count(element.name().as_ref());
                element
                    .attributes()
                    .for_each(|a| drop(a.unwrap().normalized_value(quick_xml::XmlVersion::Explicit1_0).unwrap()));
            }
            Event::End(element) => assert_eq!(open.pop().as_deref(), Some(element.name().as_ref())),
            Event::Text(text) => drop(text.decode().unwrap()),
            Event::Eof => break,
            _ => {}
        }
    }
    assert!(open.is_empty(), "{text}");
    counted
}

/// A project that was run and accepted.
fn accepted() -> tempfile::TempDir {
    let folder = project(THRESHOLDS);
    let at = folder.path();
    let (exit, _, log) = rigbench_does(at, &["run", "experiments/small.toml", "--no-figures"]);
    assert_eq!(exit, 0, "{log}");
    let (exit, out, log) = check(at, &[]);
    assert_eq!(exit, 102, "a missing baseline: {out}{log}");
    assert!(log.contains("results/baselines/small.json"), "{log}");
    assert_eq!(check(at, &["--accept"]).0, 2, "accepting needs a reason");
    let (exit, out, log) = check(at, &["--accept", "--reason", "first results"]);
    assert_eq!(exit, 0, "{out}{log}");
    let (exit, out, _) = check(at, &[]);
    assert_eq!(exit, 0, "{out}");
    assert!(!out.contains("no baseline") && out.contains("quality: nrmse") && out.contains("cost: setup_us"), "{out}");
    folder
}

#[test]
fn sabotaged_runs_fail_and_accepting_takes_over_what_failed_alone() {
    let folder = accepted();
    let at = folder.path();
    let failing = |rig: &str, out: &str| {
        let lines: Vec<&str> = out.lines().filter(|line| line.starts_with("FAILED: quality")).collect();
        assert!(!lines.is_empty() && lines.iter().all(|line| line.contains(rig)), "{rig}: {out}");
        assert!(lines.iter().any(|line| line.contains("it would pass with [check] quality =")), "{out}");
    };
    // the sign of the gradient: l(c) - (p - c).grad = 2 l(c) - (l(c) + (p - c).grad)
    sabotaged(at, "gradient", |own, constant| constant + constant - own);
    let (exit, out, _) = check(at, &[]);
    assert_eq!(exit, 101);
    failing("gradient", &out);
    // a weight of the lattice: a tenth of it goes to the wrong place
    sabotaged(at, "lattice", |own, constant| own * 0.9 + constant * 0.1);
    let (exit, out, _) = check(at, &[]);
    assert_eq!(exit, 101);
    assert!(out.lines().any(|line| line.starts_with("FAILED: quality") && line.contains("lattice")), "{out}");
    // one per cent
    sabotaged(at, "direct", |own, _| own * 1.01);
    sabotaged(at, "mixed", |own, _| own * 1.01);
    let (exit, out, _) = check(at, &[]);
    assert_eq!(exit, 101);
    for what in ["FAILED: threshold of line", "FAILED: quality: nrmse"] {
        assert!(out.lines().any(|line| line.starts_with(what) && line.contains("direct")), "{what}: {out}");
    }
    assert!(out.lines().any(|line| line.starts_with("FAILED: quality") && line.contains("mixed")), "{out}");

    // other formats say the same
    let (exit, json, _) = check(at, &["--format", "json"]);
    assert_eq!(exit, 101);
    let json: Value = serde_json::from_str(&json).unwrap();
    let failed = json["checks"].as_array().unwrap().iter().filter(|c| c["verdict"] == "failed").count();
    assert_eq!(json["failed"], failed);
    let (_, junit, _) = check(at, &["--format", "junit"]);
    let counted = xml(&junit);
    assert_eq!((counted["failure"], counted["testsuites"]), (failed, 1), "{junit}");
    assert_eq!(counted["testcase"], json["checks"].as_array().unwrap().len(), "{junit}");
    assert!(junit.contains("<testsuite name=\"quality\""), "{junit}");
    let (_, github, _) = check(at, &["--format", "github"]);
    assert_eq!(github.lines().filter(|line| line.starts_with("::error file=")).count(), failed, "{github}");

    // accepting changes what failed and nothing else; a threshold cannot be accepted
    let path = at.join("results/baselines/small.json");
    let before: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let (exit, _, _) = check(at, &["--accept", "--reason", "a test says so"]);
    assert_eq!(exit, 101);
    let (_, out, _) = check(at, &[]);
    let failing: Vec<&str> = out.lines().filter(|line| line.starts_with("FAILED")).collect();
    assert!(!failing.is_empty() && failing.iter().all(|line| line.contains("threshold")), "{out}");
    let after: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    assert_eq!(after["accepted"][1]["reason"], "a test says so");
    for (old, new) in before["rows"].as_array().unwrap().iter().zip(after["rows"].as_array().unwrap()) {
        let untouched = old["place"]["rig"] == "constant";
        assert_eq!(old["values"] == new["values"], untouched, "{old} {new}");
        assert_eq!((&old["place"], &old["times"]), (&new["place"], &new["times"]));
    }
}

#[test]
fn a_baseline_may_leave_times_out() {
    let folder = accepted();
    let at = folder.path();
    let path = at.join("experiments/small.toml");
    let baseline = at.join("results/baselines/small.json");
    let has_times = || std::fs::read_to_string(&baseline).unwrap().contains("eval_ns_per_point");
    assert!(has_times());
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, format!("{text}\n[check]\ntimes = false\n")).unwrap();
    let (exit, out, log) = check(at, &[]);
    assert!(exit == 0 && !out.contains("cost: ") && out.contains("quality: nrmse"), "{out}{log}");
    std::fs::remove_file(&baseline).unwrap();
    assert_eq!(check(at, &["--accept", "--reason", "values alone"]).0, 0);
    assert!(!has_times());
    std::fs::write(&path, text).unwrap();
    let (exit, out, _) = check(at, &[]);
    assert!(exit == 0 && !out.contains("cost: "), "there is nothing to hold times against: {out}");
}

#[test]
fn what_is_gone_new_empty_or_better_is_told_apart() {
    let folder = accepted();
    let at = folder.path();
    let path = results(at).join("results.json");
    let whole = std::fs::read_to_string(&path).unwrap();
    let with_rows = |change: &dyn Fn(&mut Vec<Value>)| {
        let mut document: Value = serde_json::from_str(&whole).unwrap();
        change(document["rows"].as_array_mut().unwrap());
        std::fs::write(&path, document.to_string()).unwrap();
    };
    with_rows(&|rows| rows.clear());
    let (exit, out, _) = check(at, &[]);
    assert_eq!(exit, 101, "{out}");
    assert!(out.contains("hold no run"), "{out}");
    with_rows(&|rows| drop(rows.remove(3)));
    let (exit, out, _) = check(at, &[]);
    assert_eq!(exit, 101, "{out}");
    assert!(out.contains("FAILED: run: ball lamp lattice") && out.contains("not in the results"), "{out}");
    with_rows(&|rows| {
        let mut other = rows[2].clone();
        other["rig"] = "another".into();
        rows.push(other);
    });
    let (exit, out, _) = check(at, &[]);
    assert_eq!(exit, 102, "{out}");
    assert!(out.contains("no baseline: run: ball lamp another"), "{out}");
    with_rows(&|rows| rows[1]["status"] = "failed".into());
    assert_eq!(check(at, &[]).0, 101);
    // better passes and is told; strict holds it too
    let scaled = |factor: f64| {
        move |rows: &mut Vec<Value>| rows[1]["max_abs"] = (rows[1]["max_abs"].as_f64().unwrap() * factor).into()
    };
    with_rows(&scaled(0.5));
    let (exit, out, _) = check(at, &[]);
    assert_eq!(exit, 0, "{out}");
    assert!(out.contains("better: quality: max_abs"), "{out}");
    assert_eq!(check(at, &["--strict"]).0, 101);
    // rounding passes, a thousandth does not
    with_rows(&scaled(1.00001));
    assert_eq!(check(at, &[]).0, 0);
    with_rows(&scaled(1.001));
    assert_eq!(check(at, &[]).0, 101);
    // times: a slower machine is no regression, one candidate that is slower is; on another machine nothing is said
    let slower = |rows: &mut Vec<Value>, which: &[usize], factor: f64| {
        for row in which {
            let samples = rows[*row]["times"]["samples"]["setup_us"].as_array_mut().unwrap();
            samples.iter_mut().for_each(|sample| *sample = (sample.as_f64().unwrap() * factor).into());
        }
    };
    let even = |rows: &mut Vec<Value>| {
        for row in [1, 2] {
            let samples = &mut rows[row]["times"]["samples"]["setup_us"];
            let first = samples[0].as_f64().unwrap();
            *samples = (0..6).map(|i| first * (1.0 + 0.001 * i as f64)).collect::<Vec<f64>>().into();
        }
    };
    let baseline = ["--baseline", "even.json"];
    with_rows(&even);
    assert_eq!(check(at, &[&baseline[..], &["--accept", "--reason", "steady times"]].concat()).0, 0);
    with_rows(&|rows| {
        even(rows);
        slower(rows, &[1, 2], 3.0);
    });
    let (exit, out, _) = check(at, &baseline);
    assert_eq!(exit, 0, "{out}");
    with_rows(&|rows| {
        even(rows);
        slower(rows, &[2], 3.0);
    });
    let (exit, out, _) = check(at, &baseline);
    assert_eq!(exit, 101, "{out}");
    assert!(out.contains("FAILED: cost: setup_us") && out.contains("it would pass with [check] cost ="), "{out}");
    with_rows(&|rows| {
        even(rows);
        slower(rows, &[2], 3.0);
        rows[2]["times"]["on"]["machine"] = "another".into();
    });
    let (exit, out, _) = check(at, &baseline);
    assert_eq!(exit, 0, "{out}");
    assert!(out.contains("not compared: cost"), "{out}");
    // where the same numbers were drawn nothing is noise; drawn anew, with another noise, the standard error decides
    let noisy = |rows: &mut Vec<Value>, factor: f64, noise: f64| {
        let nrmse = rows[1]["nrmse"].as_f64().unwrap();
        rows[1]["ref_noise"] = (noise * nrmse).into();
        rows[1]["nrmse_se"] = (0.002 * nrmse).into();
        rows[1]["nrmse"] = (factor * nrmse).into();
    };
    let baseline = ["--baseline", "noisy.json"];
    with_rows(&|rows| noisy(rows, 1.0, 0.01));
    assert_eq!(check(at, &[&baseline[..], &["--accept", "--reason", "noise"]].concat()).0, 0);
    with_rows(&|rows| noisy(rows, 1.005, 0.01));
    let (exit, out, _) = check(at, &baseline);
    assert!(exit == 101 && out.contains("it would pass with [check] quality"), "{exit}: {out}");
    with_rows(&|rows| noisy(rows, 1.005, 0.0101));
    let (exit, out, _) = check(at, &baseline);
    assert_eq!(exit, 0, "{out}");
    with_rows(&|rows| noisy(rows, 1.02, 0.0101));
    let (exit, out, _) = check(at, &baseline);
    assert_eq!(exit, 101, "{out}");
    assert!(out.contains("it would pass with a limit of |z|"), "{out}");
}

#[test]
fn comparisons_tell_significant_changes_and_refuse_times_of_other_machines() {
    let folder = project("");
    let at = folder.path();
    for out in ["a", "b"] {
        let (exit, _, log) = rigbench_does(at, &["run", "experiments/small.toml", "--no-figures", "--out", out]);
        assert_eq!(exit, 0, "{log}");
    }
    let compare = |more: &[&str]| {
        let (exit, out, log) = rigbench_does(at, &[&["compare", "a", "b"][..], more].concat());
        assert_eq!(exit, 0, "{log}");
        out
    };
    let change = |edit: &dyn Fn(&mut Vec<Value>)| {
        let path = at.join("b/results.json");
        let mut document: Value = serde_json::from_slice(&std::fs::read(at.join("a/results.json")).unwrap()).unwrap();
        edit(document["rows"].as_array_mut().unwrap());
        std::fs::write(path, document.to_string()).unwrap();
    };
    change(&|_| {});
    let same = compare(&[]);
    assert!(same.contains("same") && !same.contains("worse") && !same.contains("better"), "{same}");
    change(&|rows| {
        rows[2]["nrmse"] = (2.0 * rows[2]["nrmse"].as_f64().unwrap()).into();
        rows[3]["bias"] = 0.0.into();
        let samples = &mut rows[1]["times"]["samples"]["eval_ns_per_point"];
        *samples = samples.as_array().unwrap().iter().map(|v| v.as_f64().unwrap() * 20.0).collect::<Vec<f64>>().into();
        rows.remove(4);
    });
    let table = compare(&[]);
    for (row, metric, word) in
        [("gradient", "nrmse", "worse"), ("lattice", "bias", "better"), ("constant", "eval_ns_per_point", "worse")]
    {
        let found = table.lines().any(|line| line.contains(row) && line.contains(metric) && line.contains(word));
        assert!(found, "{row} {metric} {word}: {table}");
    }
    assert!(table.contains("only in A"), "{table}");
    let rows: Vec<std::collections::HashMap<String, String>> =
        csv::Reader::from_reader(compare(&["--format", "csv"]).as_bytes())
            .deserialize()
            .map(|row| row.unwrap())
            .collect();
    let slow = rows
        .iter()
        .find(|row| row["metric"] == "eval_ns_per_point" && row["rig"] == "constant" && row["lights"] == "lamp")
        .unwrap();
    let number = |column: &str| slow[column].parse::<f64>().unwrap();
    assert!((number("change") - 20.0).abs() < 1e-6 && number("low") < 20.0 && number("high") > 20.0, "{slow:?}");
    let json: Value = serde_json::from_str(&compare(&["--format", "json"])).unwrap();
    assert_eq!(json["changes"].as_array().unwrap().len(), rows.len());
    assert!(compare(&["--format", "markdown"]).contains("| worse |"));
    change(&|rows| rows[1]["times"]["on"]["machine"] = "another".into());
    let other = compare(&["--all"]);
    assert!(other.contains("note: times are not compared") && other.contains("timed on another machine"), "{other}");
}

/// An experiment of hard cases, run and accepted.
fn hard_cases() -> tempfile::TempDir {
    let folder = project("");
    let at = folder.path();
    let light = "{ sphere = { center = [0, \"=1 + t\", 0], radius = 1, radiance = [1, 0.5, 0.25] } }";
    std::fs::write(
        at.join("experiments/hard.toml"),
        format!(
            "schema_version = 1\nname = \"hard\"\nkind = \"stability\"\n[matrix]\nrig = [\"direct\", \"constant\", \"gradient\"]\norder = [3]\n\
             backend = [\"cpu\"]\n[rig.constant]\nconstant = {{}}\n[rig.gradient]\ngradient = {{}}\n[[family]]\nname = \"touches\"\n\
             parameter = {{ name = \"gap\", from = 1.0, to = 1e-6, steps = 5 }}\nbox = {{ half = [0.5, 0.25, 0.5] }}\n\
             point = [{{ position = [0, 0, 0] }}]\nlight = [{light}]\n\
             [[threshold]]\nmetric = \"non_finite\"\nmax = 0\n[[threshold]]\nwhere = {{ model = \"constant\" }}\nmetric = \"error\"\nmax = 1e-5\n"
        ),
    )
    .unwrap();
    let (exit, _, log) = rigbench_does(at, &["run", "experiments/hard.toml", "--no-figures", "--no-report"]);
    assert_eq!(exit, 0, "{log}");
    let (exit, out, log) = rigbench_does(at, &["check", "results/hard"]);
    assert_eq!(exit, 102, "{out}{log}");
    let (exit, _, log) = rigbench_does(at, &["check", "results/hard", "--accept", "--reason", "the first"]);
    assert_eq!(exit, 0, "{log}");
    folder
}

#[test]
fn hard_cases_are_held_by_thresholds_and_a_baseline_and_compared() {
    let folder = hard_cases();
    let at = folder.path();
    let path = at.join("results/hard/results.json");
    let whole = std::fs::read_to_string(&path).unwrap();
    let check = |edit: &dyn Fn(&mut Vec<Value>)| {
        let mut document: Value = serde_json::from_str(&whole).unwrap();
        edit(document["rows"].as_array_mut().unwrap());
        std::fs::write(&path, document.to_string()).unwrap();
        let (exit, out, log) = rigbench_does(at, &["check", "results/hard"]);
        assert!(log.is_empty(), "{log}");
        (exit, out)
    };
    // rows of a model, scaled
    let scale = |rows: &mut Vec<Value>, model: &str, column: &str, factor: f64| {
        for row in rows.iter_mut().filter(|row| row["model"] == model) {
            row[column] = (row[column].as_f64().unwrap() * factor).into();
        }
    };
    let (exit, out) = check(&|_| {});
    assert_eq!(exit, 0, "{out}");
    assert!(out.contains("holds: threshold of line 21: error") && out.contains("quality: f64_error"), "{out}");
    assert!(out.contains("touches constant order=3 cpu: at gap = "), "a curve says where it is worst: {out}");
    // rounding errors of another size fail, of another digit do not
    let set = |rows: &mut Vec<Value>, error: f64| {
        rows.iter_mut().filter(|row| row["model"] == "gradient").for_each(|row| row["error"] = error.into());
    };
    assert_eq!(check(&|rows| set(rows, 1.5e-6)).0, 0);
    let (exit, out) = check(&|rows| set(rows, 4e-3));
    assert_eq!(exit, 101, "{out}");
    let failed: Vec<&str> = out.lines().filter(|line| line.starts_with("FAILED")).collect();
    assert!(failed.len() == 2 && failed.iter().all(|line| line.contains("touches gradient")), "{out}");
    assert!(failed[0].contains("it would pass with [check] error ="), "{out}");
    // the values themselves: one per cent
    let (exit, out) = check(&|rows| scale(rows, "direct", "largest", 1.01));
    assert_eq!(exit, 101, "{out}");
    assert!(out.contains("FAILED: quality: largest") && out.contains("touches direct"), "{out}");
    // a threshold, whatever the baseline says
    let (exit, out) = check(&|rows| rows[7]["error"] = 2e-5.into());
    assert_eq!(exit, 101, "{out}");
    assert!(out.contains("FAILED: threshold of line 21: error") && out.contains("it would pass with max ="), "{out}");
    let (exit, out) = check(&|rows| rows[7]["non_finite"] = 2.into());
    assert!(exit == 101 && out.contains("FAILED: threshold of line 18: non_finite"), "{out}");
    // gone, failed, empty, new
    let (exit, out) = check(&|rows| rows.retain(|row| row["model"] != "direct"));
    assert!(exit == 101 && out.contains("in the baseline, not in the results"), "{out}");
    assert_eq!(check(&|rows| rows.iter_mut().for_each(|row| row["status"] = "failed".into())).0, 101);
    assert_eq!(check(&|rows| rows.clear()).0, 101);
    let (exit, _) = check(&|rows| rows.iter_mut().for_each(|row| row["order"] = 5.into()));
    assert_eq!(exit, 102, "curves that are new want a baseline");
    // two of them
    let (_, _) = check(&|rows| set(rows, 4e-3));
    let (exit, _, log) = rigbench_does(at, &["run", "experiments/hard.toml", "--out", "again", "--no-figures"]);
    assert_eq!(exit, 0, "{log}");
    let (exit, out, log) = rigbench_does(at, &["compare", "again", "results/hard"]);
    assert_eq!(exit, 0, "{log}");
    let worse: Vec<&str> = out.lines().filter(|line| line.contains(" worse ")).collect();
    assert!(worse.len() == 2 && worse.iter().all(|line| line.contains("touches gradient order=3 cpu")), "{out}");
    // results of another experiment, and a baseline of one
    let (exit, _, log) = rigbench_does(at, &["check", "again", "--experiment", "experiments/small.toml"]);
    assert_eq!(exit, 3, "{log}");
    let (exit, _, log) = rigbench_does(at, &["compare", "again", "nowhere"]);
    assert!(exit == 3 && log.contains("nowhere"), "{log}");
}

#[test]
fn a_rig_that_sets_up_twice_as_long_is_caught_and_noise_is_not() {
    let folder = project("");
    let at = folder.path();
    let path = at.join("experiments/small.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let text = text.replace("repeat = 6", "repeat = 21").replace(
        "rig = [\"constant\", \"gradient\"], lights = \"lamp\"",
        "rig = [\"constant\", \"gradient\", \"lattice\", \"mixed\"], lights = \"lamp\"",
    );
    // lights enough that a setup is longer than a clock's tick
    let lights: String = (0..200)
        .map(|i| {
            let turn = f64::from(i) * 0.61803398875;
            let [x, z] = [turn.cos() * 1.5, turn.sin() * 1.5];
            format!("[[light]]\nname = \"{i}\"\nsphere = {{ center = [{x}, 1.6, {z}], radius = 0.1, radiance = [1, 2, 3] }}\n")
        })
        .collect();
    std::fs::write(at.join("scenes/lights/lamp.toml"), format!("schema_version = 1\n{lights}")).unwrap();
    std::fs::write(&path, text).unwrap();
    let run = ["run", "experiments/small.toml", "--no-figures", "--no-report", "--filter", "lights=lamp"];
    let (exit, _, log) = rigbench_does(at, &run);
    assert_eq!(exit, 0, "{log}");
    assert_eq!(check(at, &["--accept", "--reason", "first results"]).0, 0);
    let again = |fault: &str, out: &str| {
        let mut command = rigbench(at);
        let (exit, _, log) = done(command.args(run).args(["--out", out]).env("RIGBENCH_FAULT", fault));
        assert_eq!(exit, 0, "{log}");
        let (exit, told, _) = rigbench_does(at, &["check", out]);
        (exit, told.lines().filter(|line| line.contains(": cost: ")).map(str::to_owned).collect::<Vec<_>>())
    };
    let (exit, told) = again("", "noise");
    assert!(exit == 0 && told.len() == 8 && told.iter().all(|line| !line.starts_with("not")), "{told:#?}");
    // on a machine so busy that twice the time lies within the noise nothing is said, and the next look tells
    let caught = (0..6).any(|look| {
        let (exit, told) = again("slow:lattice", &format!("slow-{look}"));
        let failed: Vec<&String> = told.iter().filter(|line| line.starts_with("FAILED")).collect();
        assert_eq!(exit, if failed.is_empty() { 0 } else { 101 }, "{told:#?}");
        for line in &failed {
            assert!(line.contains("setup_us") && line.contains("ball lamp lattice"), "{line}");
        }
        !failed.is_empty()
    });
    assert!(caught, "six looks at a rig that sets up twice as long");
}

/// How often a rig of a block is found slower, of many blocks whose times scatter as times do.
#[test]
fn noise_is_rarely_a_regression_and_a_factor_of_two_nearly_always() {
    use rigbench::experiment::CheckSettings;
    use rigbench::gate::{Baseline, BaselineRow, Kind, Options, Stored, Thresholds, Verdict};
    use rigbench::math::{Stream, StreamPurpose};
    let folder = tempfile::tempdir().unwrap();
    let (trials, rigs) = (60, 6);
    let mut stream = Stream::indexed(29, StreamPurpose::Test, 0);
    // log-normal about a fifth, now and then a sample that something else delayed; the whole machine drifts from run to run
    let mut block = |slow: f64| -> Stored {
        let drift = 0.7 + 0.8 * stream.uniform();
        let rows: Vec<Value> = (0..rigs)
            .map(|rig| {
                let median = 10.0 * f64::from(rig + 1) * drift * if rig == 2 { slow } else { 1.0 };
                let mut samples = || -> Vec<f64> {
                    let mut sample = || {
                        let normal = (0..12).map(|_| stream.uniform()).sum::<f64>() - 6.0;
                        let delay = if stream.uniform() < 0.05 { 3.0 } else { 1.0 };
                        median * (0.2 * normal).exp() * delay
                    };
                    (0..15).map(|_| sample()).collect()
                };
                serde_json::json!({
                    "scene": "s", "lights": "a", "rig": format!("rig-{rig}"), "backend": "cpu", "status": "ok", "run": format!("{rig:012}"),
                    "times": { "on": { "machine": "m", "adapter": null, "driver": null, "warmup": 1, "repeat": 15, "algorithms": 1 },
                        "samples": { "setup_us": samples(), "eval_ns_per_point": samples(), "once_us": null, "timer": "wall" } },
                })
            })
            .collect();
        let document = serde_json::json!({ "experiment": "e", "experiment_file": "e.toml", "rows": rows });
        std::fs::write(folder.path().join("results.json"), document.to_string()).unwrap();
        Stored::read(folder.path()).unwrap()
    };
    let options = Options { settings: CheckSettings::default(), strict: false };
    let mut found = |slow: f64| -> (usize, usize) {
        let (mut right, mut wrong) = (0, 0);
        for _ in 0..trials {
            let before = block(1.0);
            let mut baseline = Baseline::empty("e");
            baseline.rows.extend(before.rows.iter().map(|row| BaselineRow::of(row, before.kind, true)));
            let checks = rigbench::gate::check(&block(slow), Thresholds::OfRuns(&[]), Some(&baseline), options);
            let costs = checks.iter().filter(|check| check.kind == Kind::Cost);
            for check in costs.filter(|check| check.verdict == Verdict::Failed) {
                if check.place.contains("rig-2") { right += 1 } else { wrong += 1 }
            }
        }
        (right, wrong)
    };
    let (of_two, wrong) = found(1.0);
    assert!(of_two + wrong <= trials * 2 * rigs as usize / 500 + 1, "false alarms: {of_two} + {wrong}");
    let (right, wrong) = found(2.0);
    assert!(right >= 2 * trials * 95 / 100, "{right} of {} found", 2 * trials);
    assert!(wrong <= 2, "others are blamed: {wrong}");
}
