//! A sweep that is killed at any moment or interrupted: nothing that was finished is lost or computed again, and what comes out in the
//! end is what an undisturbed sweep gives.

mod folder;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use assert_cmd::cargo::CommandCargoExt;
use rigbench::math::{Stream, StreamPurpose};

fn project() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| folder::write(folder.path(), name, text);
    write("scenes/ball.toml", include_str!("folder/ball.toml"));
    write(
        "scenes/lights/lamp.toml",
        "schema_version = 1\n[[light]]\nname = \"lamp\"\nsphere = { center = [0, 2, 0], radius = 1, radiance = [1, 1, 1] }\n",
    );
    write(
        "scenes/lights/many.toml",
        "schema_version = 1\n[random]\nseed = 3\nlayouts = 12\nlights = 4\nkinds = [\"sphere\", \"disk\"]\ndistance = [0.5, 2.0]\n\
         size = [0.1, 0.3]\npower = 100.0\n",
    );
    write(
        "experiments/long.toml",
        "schema_version = 1\nname = \"long\"\ntitle = \"long\"\n[image]\nwidth = 48\nheight = 27\nkeep = \"all\"\n\
         [timing]\nwarmup = 0\nrepeat = 2\n[matrix]\nscene = [\"ball\"]\nlights = [\"lamp\", \"many\"]\n\
         rig = [\"constant\", \"gradient\", \"lattice\"]\norder = [3, 5]\n\
         [rig.constant]\nconstant = {}\n[rig.gradient]\ngradient = {}\n[rig.lattice]\nlattice = { samples = [2, 2, 2] }\n",
    );
    folder
}

fn start(folder: &Path) -> Child {
    start_of(folder, "experiments/long.toml")
}

fn start_of(folder: &Path, experiment: &str) -> Child {
    let mut command = Command::cargo_bin("rigbench").expect("cargo builds the binary for its tests");
    command.current_dir(folder).args(["run", experiment]);
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Exit code and what it said.
fn finish(child: Child) -> (Option<i32>, String) {
    let output = child.wait_with_output().unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(sent.unwrap().success(), "the sweep was over before it was sent {name}");
}

/// metrics.json of every finished run, by folder; those half written would not parse.
fn finished(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let Ok(runs) = std::fs::read_dir(folder.join("results/long/runs")) else { return BTreeMap::new() };
    let kept = runs.filter_map(|run| {
        let run = run.unwrap().path();
        let bytes = std::fs::read(run.join("metrics.json")).ok()?;
        serde_json::from_slice::<serde_json::Value>(&bytes).expect("whole or not at all");
        Some((run.file_name().unwrap().to_string_lossy().into_owned(), bytes))
    });
    kept.collect()
}

/// The rows of results.csv without what a clock said.
fn rows(folder: &Path) -> Vec<BTreeMap<String, String>> {
    rows_of(folder, "long")
}

fn rows_of(folder: &Path, experiment: &str) -> Vec<BTreeMap<String, String>> {
    let path = folder.join("results").join(experiment).join("results.csv");
    let mut reader = csv::Reader::from_path(path).unwrap();
    let mut rows: Vec<BTreeMap<String, String>> = reader.deserialize().map(|row| row.unwrap()).collect();
    for row in &mut rows {
        row.retain(|column, _| {
            !["_us", "_ns_", "pareto", "flip_hdr", "bake_s"].iter().any(|timed| column.contains(timed))
        });
    }
    rows
}

/// A sweep of which so many runs are finished computes the others and gives what one that nobody killed gives.
fn ends_well(folder: &Path, finished: usize, whole: &Path) {
    let (exit, log) = finish(start(folder));
    assert_eq!(exit, Some(0), "{log}");
    let told = format!("78 runs: {} computed, {finished} cached, 0 failed", 78 - finished);
    assert!(log.contains(&told), "not `{told}`: {log}");
    assert_eq!(rows(folder), rows(whole));
}

#[test]
fn a_sweep_killed_at_random_moments_loses_no_finished_run() {
    let whole = project();
    let began = Instant::now();
    let (exit, log) = finish(start(whole.path()));
    let takes = began.elapsed();
    assert_eq!(exit, Some(0), "{log}");
    assert!(log.contains("78 runs: 78 computed, 0 cached, 0 failed"), "{log}");

    let mut folder = project();
    let mut stream = Stream::indexed(7, StreamPurpose::Test, u64::from(std::process::id()));
    let mut before = BTreeMap::new();
    // tests/kills asks for more
    let kills: usize =
        std::env::var("RIGBENCH_KILLS").map_or(5, |text| text.parse().expect("RIGBENCH_KILLS is a number"));
    let mut whole_again = 0;
    for kill in 0..kills {
        if before.len() == 78 {
            // there is nothing left to lose: it must be whole, and another begins
            ends_well(folder.path(), 78, whole.path());
            folder = project();
            before = BTreeMap::new();
            whole_again += 1;
        }
        let child = start(folder.path());
        std::thread::sleep(takes.mul_f64(stream.uniform_between(0.05, 0.6)));
        let mut child = child;
        child.kill().unwrap();
        finish(child);
        // its worker ends when it sees that no one gives it orders
        std::thread::sleep(Duration::from_millis(200));
        let after = finished(folder.path());
        for (run, bytes) in &before {
            assert_eq!(after.get(run), Some(bytes), "run {run} after kill {kill}");
        }
        println!("kill {kill}: {} of 78 runs finished", after.len());
        before = after;
    }
    ends_well(folder.path(), before.len(), whole.path());
    println!("{kills} kills, {} sweeps", whole_again + 1);
    // the comparison sees a difference
    let mut other = rows(whole.path());
    other[5].insert("nrmse".to_owned(), "0.5".to_owned());
    assert_ne!(rows(folder.path()), other);
}

#[test]
fn an_interrupted_sweep_says_so_and_goes_on() {
    let folder = project();
    let child = start(folder.path());
    // the first finished run, then Ctrl-C
    let deadline = Instant::now() + Duration::from_secs(60);
    while finished(folder.path()).is_empty() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(2));
    }
    signal(&child, "INT");
    let (exit, log) = finish(child);
    assert_eq!(exit, Some(130), "{log}");
    let kept = finished(folder.path());
    assert!(!kept.is_empty());
    let (exit, log) = finish(start(folder.path()));
    assert_eq!(exit, Some(0), "{log}");
    assert!(log.contains(&format!("{} cached, 0 failed", kept.len())), "{} kept: {log}", kept.len());
}

/// Adds a room to the ball and an experiment with two volumes in it, whose bakes take a while; the second has the samples of the first
/// and those between them.
fn with_volumes(folder: &Path) {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write(
        "scenes/room.toml",
        "schema_version = 1\ntitle = \"room\"\n\
         [material.grey]\nalbedo = [0.5, 0.5, 0.5]\n\
         [[object]]\nname = \"floor\"\nmaterial = \"grey\"\nshape = { quad = { center = [0, 0, 0], u = [2, 0, 0], v = [0, 0, -2] } }\n\
         [[object]]\nname = \"wall\"\nmaterial = \"grey\"\nshape = { box = { min = [-1, 0, -1], max = [-0.8, 1, 1] } }\n\
         [[object]]\nname = \"ball\"\nreceiver = true\nshape = { sphere = { center = [0, 0.5, 0], radius = 0.3 } }\n",
    );
    write(
        "experiments/volume.toml",
        "schema_version = 1\nname = \"volume\"\ntitle = \"volume\"\n[image]\nkeep = \"none\"\n\
         [timing]\nwarmup = 0\nrepeat = 1\n[reference]\npoints = 64\nrelative_error = 0.05\nseconds = 30\n\
         [effects]\nmode = \"bounces=2\"\n\
         [matrix]\nscene = [\"room\"]\nlights = [\"lamp\"]\nrig = [\"coarse\", \"fine\"]\nprobe_source = [\"rays\"]\n\
         [rig.coarse]\ngrid = { bounds = { min = [-0.7, 0.1, -1], max = [1, 1.5, 1] }, samples = [12, 8, 6] }\n\
         [rig.fine]\ngrid = { bounds = { min = [-0.7, 0.1, -1], max = [1, 1.5, 1] }, samples = [12, 8, 11] }\n\
         [probe_source.rays]\ntraced = { spp = 1500 }\n",
    );
}

/// Bytes of the logs of bakes, the shortest first.
fn logged(folder: &Path) -> Vec<u64> {
    let Ok(logs) = std::fs::read_dir(folder.join("results/volume/bakes")) else { return Vec::new() };
    let mut sizes: Vec<u64> = logs.map(|log| log.unwrap().metadata().map_or(0, |m| m.len())).collect();
    sizes.sort_unstable();
    sizes
}

#[test]
fn bakes_that_were_killed_go_on_with_the_samples_they_have() {
    let whole = project();
    with_volumes(whole.path());
    let (exit, log) = finish(start_of(whole.path(), "experiments/volume.toml"));
    assert_eq!(exit, Some(0), "{log}");
    assert!(!log.contains("went on with a bake"), "{log}");

    // killed as soon as some of the first one's samples are there, and of the second one's, behind whole ones of the first
    for (number, cut_short) in [(1, "of its 576 samples were there"), (2, "of its 1056 samples were there")] {
        let folder = project();
        with_volumes(folder.path());
        let begun = || {
            let sizes = logged(folder.path());
            sizes.len() == number && sizes[0] >= 60_000
        };
        let mut child = start_of(folder.path(), "experiments/volume.toml");
        let deadline = Instant::now() + Duration::from_secs(240);
        while !begun() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        finish(child);
        std::thread::sleep(Duration::from_millis(200));
        assert!(begun(), "{:?} bytes", logged(folder.path()));
        let (exit, log) = finish(start_of(folder.path(), "experiments/volume.toml"));
        assert_eq!(exit, Some(0), "{log}");
        assert!(log.contains("went on with a bake that was cut short") && log.contains(cut_short), "{log}");
        assert_eq!(rows_of(folder.path(), "volume"), rows_of(whole.path(), "volume"));
        assert!(rows_of(folder.path(), "volume").iter().all(|row| !row["bake_rays"].is_empty()));
        // what is done leaves no log behind
        assert!(!folder.path().join("results/volume/bakes").exists());
    }
    assert!(!whole.path().join("results/volume/bakes").exists());
}
