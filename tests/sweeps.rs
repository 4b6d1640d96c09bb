//! Sweeps from the command line: workers and their limits, shards, full disks, the gate and comparisons, and Slurm.

#[path = "sweeps/fire.rs"]
mod fire;
mod folder;
#[path = "sweeps/gate.rs"]
mod gate;
#[path = "sweeps/overhead.rs"]
mod overhead;
#[path = "sweeps/slurm.rs"]
mod slurm;
#[path = "sweeps/volume_gate.rs"]
mod volume_gate;
#[path = "sweeps/volumes.rs"]
mod volumes;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use assert_cmd::cargo::CommandCargoExt;

/// A folder with a scene, layouts and an experiment of five rigs; `more` goes to the end of the experiment.
fn project(more: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| folder::write(folder.path(), name, text);
    write("scenes/ball.toml", include_str!("folder/ball.toml"));
    for (name, x) in [("lamp", 0.0), ("side", 1.5)] {
        let sphere = format!("sphere = {{ center = [{x}, 1.6, 0.3], radius = 0.3, radiance = [1, 2, 3] }}");
        write(
            &format!("scenes/lights/{name}.toml"),
            &format!("schema_version = 1\n[[light]]\nname = \"a\"\n{sphere}\n"),
        );
    }
    write(
        "experiments/small.toml",
        &format!(
            "schema_version = 1\nname = \"small\"\ntitle = \"small\"\n[image]\nwidth = 32\nheight = 18\nkeep = \"none\"\n\
             [timing]\nwarmup = 0\nrepeat = 6\nonly = {{ rig = [\"constant\", \"gradient\"], lights = \"lamp\" }}\n\
             [matrix]\nscene = [\"ball\"]\nlights = [\"lamp\", \"side\"]\n\
             rig = [\"direct\", \"constant\", \"gradient\", \"lattice\", \"mixed\"]\n\
             [rig.constant]\nconstant = {{}}\n[rig.gradient]\ngradient = {{}}\n[rig.lattice]\nlattice = {{ samples = [2, 2, 2] }}\n\
             [rig.mixed]\nmixed = {{ x = {{ lattice = 3 }}, y = \"gradient\", z = \"constant\" }}\n{more}"
        ),
    );
    folder
}

const RUNS: usize = 10;

/// The program; RIGBENCH_PROGRAM names another build of it, for measuring.
fn rigbench(folder: &Path) -> Command {
    let mut command = match std::env::var_os("RIGBENCH_PROGRAM") {
        Some(program) => Command::new(program),
        None => Command::cargo_bin("rigbench").expect("cargo builds the binary for its tests"),
    };
    command.current_dir(folder);
    command
}

/// Exit code, standard output and what it said.
fn done(command: &mut Command) -> (i32, String, String) {
    let output = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().unwrap_or(-1), text(&output.stdout), text(&output.stderr))
}

fn rigbench_does(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    done(rigbench(folder).args(arguments))
}

fn results(folder: &Path) -> PathBuf {
    folder.join("results/small")
}

/// results.csv by column, without what a clock said.
fn rows(results: &Path) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(results.join("results.csv")).unwrap();
    let mut rows: Vec<BTreeMap<String, String>> = reader.deserialize().map(|row| row.unwrap()).collect();
    for row in &mut rows {
        row.retain(|column, _| !["_us", "_ns_", "pareto", "flip_hdr"].iter().any(|timed| column.contains(timed)));
    }
    rows
}
