//! The pruned search finds what trying everything finds, for a fifth of the work.

mod folder;

use std::collections::BTreeMap;
use std::path::Path;

use assert_cmd::Command;

use rigbench::rig::{AnyRig, Rig, RigModel};
use rigbench::run::recommend::{
    CostModel, Place, Search, Work, exhaustive, exhaustive_work, signature, space, taken, toml,
};
use rigbench::scene::{Layout, OrientedBox, Scene};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Frame times as a machine might have them: by what a rig asks for, so that the test is the same everywhere.
fn costs(rigs: &[AnyRig], receivers: usize) -> CostModel {
    let mut eval_ns = BTreeMap::new();
    for rig in rigs {
        let mut taps = 0;
        rig.model::<f32>([1.0; 3]).taps(rigbench::math::Vector3::zero(), &mut |_, _| taps += 1);
        eval_ns.insert(signature(rig), 2.0 + 1.3 * f64::from(taps));
    }
    CostModel { setup_us: [0.7, 0.12, 0.31], eval_ns, points: vec![1500.0; receivers] }
}

fn scene(name: &str) -> Scene {
    Scene::load(&root().join(format!("scenes/{name}.toml"))).unwrap()
}

fn places(scene: &Scene, lights: &str, index: Option<usize>) -> Vec<Place> {
    let layout = Layout::load(&root().join(format!("scenes/lights/{lights}.toml"))).unwrap();
    let boxes: Vec<OrientedBox> = scene.receivers.iter().map(|r| r.oriented_box(0)).collect();
    let instances = layout.instances(&boxes);
    instances.iter().filter(|i| i.index == index).map(|i| Place::new(scene, i, 0, 2)).collect()
}

#[test]
fn the_pruned_search_finds_the_winner_of_the_exhaustive_one() {
    // a smaller space than the command's, so that trying everything is possible here
    let rigs = space(&[1, 2, 4]);
    assert!(rigs.len() > 200);
    let mut cases: Vec<(String, Vec<Place>, f64)> = Vec::new();
    for (name, target) in [("car", 0.02), ("body", 0.05), ("head", 0.1), ("teapot", 0.03)] {
        let scene = scene(name);
        let mut all = places(&scene, "three-lamps", None);
        all.extend(places(&scene, "near-emitters", None));
        cases.push((name.to_owned(), all, target));
    }
    for k in 0..20 {
        let name = ["car", "body", "head", "teapot"][k % 4];
        let lights = ["random-near", "random-mid", "random-far"][k % 3];
        let target = [0.2, 0.08, 0.04, 0.02, 0.01][k % 5];
        cases.push((format!("{name} {lights} {k}"), places(&scene(name), lights, Some(k % 16)), target));
    }
    let (mut pruned, mut whole) = (Work::default(), Work::default());
    let mut none = 0;
    let mut winners = std::collections::BTreeSet::new();
    let mut last_won = 0;
    for (number, (name, places, target)) in cases.iter().enumerate() {
        let costs = costs(&rigs, 1);
        let (winner, everything) = exhaustive(places, 2, *target, &rigs, &costs);
        assert_eq!(everything, exhaustive_work(places, &rigs), "{name}");
        let found = Search::new(places, 2, *target).run(&rigs, &costs, 0);
        let expected = winner.map(|w| toml(&rigs[w]));
        assert_eq!(found.ranking.first().map(|r| r.toml.clone()), expected, "{name} at {target}");
        if expected.is_some() {
            last_won = number;
        }
        winners.extend(expected);
        none += usize::from(winner.is_none());
        pruned.projections += found.work.projections;
        pruned.taps += found.work.taps;
        whole.projections += everything.projections;
        whole.taps += everything.taps;
        // a target that nothing meets is said, with the best that there is
        let impossible = Search::new(&places[..1], 2, 1e-9).run(&rigs[..20], &costs, 0);
        assert!(impossible.ranking.is_empty() && impossible.best.is_some(), "{name}");
    }
    println!("{pruned:?} of {whole:?}, {none} without a winner, winners {winners:?}");
    assert!(winners.len() >= 6, "the cases must ask for different rigs: {winners:?}");
    assert!(none <= 6, "{none} of {} targets out of reach", cases.len());
    assert!(pruned.projections * 5 < whole.projections, "{pruned:?} of {whole:?}");
    assert!(pruned.taps * 5 < whole.taps, "{pruned:?} of {whole:?}");
    // the test can fail: a search with other costs finds another winner
    let mut other = costs(&rigs, 1);
    other.eval_ns.values_mut().for_each(|v| *v = 1e3 - *v);
    let (_, places, target) = &cases[last_won];
    let cheap = Search::new(places, 2, *target).run(&rigs, &costs(&rigs, 1), 0).ranking[0].toml.clone();
    let dear = Search::new(places, 2, *target).run(&rigs, &other, 0).ranking[0].toml.clone();
    assert_ne!(cheap, dear);
}

#[test]
fn of_rigs_that_are_equally_fast_the_first_predicted_is_taken() {
    assert_eq!(taken(&[(10.4, 0.3), (10.0, 0.2), (9.0, 3.0)]), 0);
    assert_eq!(taken(&[(10.4, 0.1), (10.0, 0.2), (9.0, 0.1)]), 2);
    assert_eq!(taken(&[(7.0, 0.0)]), 0);
}

#[test]
fn every_rig_of_the_space_can_be_pasted() {
    for rig in space(&[1, 2, 3]) {
        assert_eq!(AnyRig::inline(&toml(&rig)).unwrap(), rig, "{}", toml(&rig));
    }
}

/// A folder with a box, a box beside a wall, a box that moves, and four layouts.
fn project() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| folder::write(folder.path(), name, text);
    let block = "schema_version = 1\n[[object]]\nname = \"block\"\nreceiver = true\n\
                 shape = { box = { min = [-1, -0.3, -0.4], max = [1, 0.3, 0.4] } }\n";
    write("scenes/block.toml", block);
    let wall =
        "[[object]]\nname = \"wall\"\nshape = { quad = { center = [0, -1, 0], u = [4, 0, 0], v = [0, 0, -4] } }\n";
    write("scenes/walled.toml", &format!("{block}{wall}"));
    let path = "path = { points = [[0, 0, 0], [0.5, 0, 0], [1, 0.5, 0]] }\n[animation]\nframes = 3\n";
    write("scenes/moving.toml", &format!("{block}{path}"));
    let layout = |light: &str| format!("schema_version = 1\n[[light]]\n{light}\n");
    let near = layout("sphere = { center = [1.6, 1, 0.2], radius = 0.3, radiance = [8, 6, 4] }");
    write("scenes/lights/near.toml", &near);
    write("scenes/lights/far.toml", &layout("sphere = { center = [-6, 5, 3], radius = 1, radiance = [9, 9, 9] }"));
    write("scenes/lights/dark.toml", "schema_version = 1\n");
    folder
}

fn rigbench(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = Command::cargo_bin("rigbench").unwrap().current_dir(folder).args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[test]
fn what_it_recommends_runs_in_an_experiment() {
    let folder = project();
    let at = folder.path();
    let asked = ["recommend", "block", "--lights", "near", "far", "--error", "8%", "--order", "2", "--explain"];
    let (exit, out, log) = rigbench(at, &[&asked[..], &["--json"]].concat());
    assert_eq!(exit, 0, "{log}");
    let found: serde_json::Value = serde_json::from_str(&out).unwrap();
    let (rig, error) = (found["rig"].as_str().unwrap(), found["error"].as_f64().unwrap());
    assert!(error <= 0.08 && found["left_out"].as_array().unwrap().is_empty(), "{out}");
    assert_eq!(found["explain"].as_array().unwrap().len(), 3);
    let places = found["places"].as_array().unwrap();
    assert_eq!(places.len(), 2);
    // pasted: the sweep measures what the search said, and the floor that it named
    let experiment = format!(
        "schema_version = 1\nname = \"pasted\"\n[matrix]\nscene = [\"block\"]\nlights = [\"near\", \"far\"]\n\
         rig = [\"found\"]\norder = [2]\nbackend = [\"cpu\"]\n[timing]\nwarmup = 0\nrepeat = 1\n[image]\nwidth = 16\nheight = 9\nkeep = \"none\"\n\
         [rig.found]\n{rig}\n[[threshold]]\nwhere = {{ rig = \"found\" }}\nmetric = \"interpolation_nrmse\"\nmax = 0.08\n"
    );
    std::fs::create_dir_all(at.join("experiments")).unwrap();
    std::fs::write(at.join("experiments/pasted.toml"), experiment).unwrap();
    let (exit, _, log) = rigbench(at, &["run", "experiments/pasted.toml", "--no-figures", "--no-report"]);
    assert_eq!(exit, 0, "{log}");
    let rows: Vec<BTreeMap<String, String>> = csv::Reader::from_path(at.join("results/pasted/results.csv"))
        .unwrap()
        .deserialize()
        .collect::<Result<_, _>>()
        .unwrap();
    let number = |row: &BTreeMap<String, String>, name: &str| row[name].parse::<f64>().unwrap();
    let worst = rows.iter().map(|row| number(row, "interpolation_nrmse")).fold(0.0, f64::max);
    assert!((worst / error - 1.0).abs() < 1e-3, "{worst} measured, {error} said");
    for (row, place) in rows.iter().zip(places) {
        let said = place["truncation_nrmse"].as_f64().unwrap();
        assert!((number(row, "truncation_nrmse") / said - 1.0).abs() < 1e-6, "{place}");
    }
}

#[test]
fn it_says_what_it_cannot_do() {
    let folder = project();
    let at = folder.path();
    for bad in ["2", "-2%", "0", "0%", "two", "inf", "nan", "1e-323%", "100", "%"] {
        let word = format!("--error={bad}");
        let (exit, _, log) = rigbench(at, &["recommend", "block", "--lights", "near", &word]);
        assert_eq!(exit, 2, "{bad}: {log}");
    }
    let (_, _, log) = rigbench(at, &["recommend", "block", "--lights", "near", "--error", "2"]);
    assert!(log.contains("2%") && log.contains("0.02"), "{log}");
    // out of reach: the floor, the best that there is, and an exit of its own
    let (exit, out, log) =
        rigbench(at, &["recommend", "block", "--lights", "near", "--error", "0.0001 %", "--order", "1"]);
    assert_eq!((exit, out.as_str()), (4, ""), "{log}");
    assert!(log.contains("floor of the order") && log.contains("the best adds"), "{log}");
    let json = ["recommend", "block", "--lights", "near", "--error", "1e-6", "--order", "1", "--json"];
    let (exit, out, _) = rigbench(at, &json);
    let found: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert!(exit == 4 && found["rig"].is_null() && found["best"]["error"].as_f64().unwrap() > 1e-6, "{out}");
    // a layout without light, and unknown names
    assert_eq!(rigbench(at, &["recommend", "block", "--lights", "dark", "--error", "5%"]).0, 4);
    assert_eq!(rigbench(at, &["recommend", "block", "--lights", "nera", "--error", "5%"]).0, 3);
    assert_eq!(rigbench(at, &["recommend", "block", "--lights", "near#3", "--error", "5%"]).0, 2);
    assert_eq!(rigbench(at, &["recommend", "blok", "--lights", "near", "--error", "5%"]).0, 3);
    // what blocks light is left out, and that is said
    let wide = ["recommend", "walled", "--lights", "near", "--error", "60%", "--order", "1"];
    let (exit, out, log) = rigbench(at, &wide);
    assert_eq!(exit, 0, "{log}");
    assert!(out.contains("left out: this scene calls for"), "{out}");
    assert!(out.contains("[rig.walled]"), "{out}");
    // every frame of what moves
    let (exit, out, log) = rigbench(at, &["recommend", "moving", "--lights", "near", "--error", "60%", "--order", "1"]);
    assert_eq!(exit, 0, "{log}");
    assert!(out.contains("3 place(s)") && out.contains("near frame "), "{out}");
}
