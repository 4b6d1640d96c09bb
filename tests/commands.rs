//! The program from its command line: query, run, repeat, bad input, exit codes.

use std::path::{Path, PathBuf};

use assert_cmd::Command;

fn rigbench() -> Command {
    Command::cargo_bin("rigbench").expect("cargo builds the binary for its tests")
}

/// A folder with one scene, one layout and one experiment.
fn project() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    write(
        "scenes/ball.toml",
        "schema_version = 1\ntitle = \"ball\"\n[camera]\neye = [0, 1, 3]\ntarget = [0, 0.5, 0]\nup = [0, 1, 0]\nfov_y = 35.0\n\
         [[object]]\nname = \"ball\"\nreceiver = true\nshape = { sphere = { center = [0, 0.5, 0], radius = 0.4 } }\n",
    );
    write(
        "scenes/lights/lamp.toml",
        "schema_version = 1\n[[light]]\nname = \"lamp\"\nsphere = { center = [0, 2, 0], radius = 1, radiance = [1, 1, 1] }\n",
    );
    write(
        "experiments/small.toml",
        "schema_version = 1\nname = \"small\"\ntitle = \"small\"\n[image]\nwidth = 32\nheight = 18\n[timing]\nwarmup = 0\nrepeat = 2\n\
         [matrix]\nscene = [\"ball\"]\nlights = [\"lamp\"]\nrig = [\"direct\", \"constant\", \"gradient\"]\n\
         [rig.constant]\nconstant = {}\n[rig.gradient]\ngradient = {}\n\
         [[threshold]]\nwhere = { rig = \"direct\" }\nmetric = \"nrmse\"\nmax = 1e-5\n",
    );
    folder
}

fn csv(bytes: &[u8]) -> Vec<std::collections::HashMap<String, String>> {
    csv::Reader::from_reader(bytes).deserialize().map(|row| row.unwrap()).collect()
}

fn run(folder: &Path, arguments: &[&str]) -> (i32, Vec<u8>, String) {
    let output = rigbench().current_dir(folder).args(arguments).output().unwrap();
    (output.status.code().unwrap(), output.stdout, String::from_utf8(output.stderr).unwrap())
}

fn results(folder: &Path) -> PathBuf {
    folder.join("results/small/results.csv")
}

#[test]
fn a_query_gives_the_closed_form() {
    let folder = project();
    // radius 1 at distance 2 from the origin: facing it E = pi / 4; on the horizon the pinned value of Snyder's formula
    std::fs::write(folder.path().join("p.csv"), "x,y,z,nx,ny,nz\n0,0,0,0,5,0\n0,0,0,1,0,0\n").unwrap();
    let (exit, out, _) = run(folder.path(), &["query", "ball", "--lights", "lamp", "--points", "p.csv"]);
    assert_eq!(exit, 0);
    let rows = csv(&out);
    let value = |row: usize| rows[row]["r"].parse::<f64>().unwrap();
    assert!((value(0) - std::f64::consts::PI / 4.0).abs() < 1e-12, "{}", value(0));
    assert!((value(1) - 0.090586073706).abs() < 1e-11, "{}", value(1));
    let sh = ["query", "ball", "--lights", "lamp", "--points", "p.csv", "--quantity", "sh-gradient", "--order", "2"];
    let (exit, out, _) = run(folder.path(), &sh);
    assert_eq!(exit, 0);
    let order: Vec<String> = csv(&out)[..12].iter().map(|row| format!("{}{}", row["axis"], row["i"])).collect();
    assert_eq!(order.join(" "), "x0 x1 x2 x3 y0 y1 y2 y3 z0 z1 z2 z3");
}

#[test]
fn a_run_repeats_byte_for_byte_and_computes_nothing_again() {
    let folder = project();
    let (exit, table, log) = run(folder.path(), &["run", "experiments/small.toml"]);
    assert_eq!(exit, 0, "{log}");
    assert!(log.contains("3 runs: 3 computed, 0 cached, 0 failed"), "{log}");
    assert!(String::from_utf8(table).unwrap().contains("gradient"));
    let first = std::fs::read(results(folder.path())).unwrap();
    let rows = csv(&first);
    assert_eq!(rows.len(), 3);
    for row in &rows {
        assert_eq!(row["status"], "ok");
        assert_eq!(row["effects"], "none");
        assert_eq!(row["shadow_rays"], "0");
        assert!(row["nrmse"].parse::<f64>().unwrap() >= 0.0 && !row["frame_us_1m"].is_empty());
    }
    let (exit, _, log) = run(folder.path(), &["run", "experiments/small.toml"]);
    assert_eq!(exit, 0);
    assert!(log.contains("3 runs: 0 computed, 3 cached"), "{log}");
    assert_eq!(std::fs::read(results(folder.path())).unwrap(), first);
    // another size of the picture is another run
    let (exit, _, log) = run(folder.path(), &["run", "experiments/small.toml", "--set", "image.width=40"]);
    assert_eq!(exit, 0);
    assert!(log.contains("3 computed"), "{log}");
}

#[test]
fn a_threshold_that_is_exceeded_exits_with_101() {
    let folder = project();
    let (exit, _, log) = run(folder.path(), &["run", "experiments/small.toml", "--set", "threshold.0.max=1e-12"]);
    assert_eq!(exit, 101, "{log}");
    assert!(log.contains("EXCEEDED"), "{log}");
}

#[test]
fn mistakes_have_their_exit_codes_and_write_nothing() {
    let folder = project();
    let at = folder.path();
    std::fs::write(at.join("p.csv"), "x,y,z,nx,ny,nz\n0,0,0,0,0,0\n").unwrap();
    let (exit, _, log) = run(at, &["query", "ball", "--lights", "lamp", "--points", "p.csv"]);
    assert_eq!(exit, 3);
    assert!(log.contains("p.csv:2:4"), "{log}");
    let (exit, _, log) = run(at, &["query", "bal", "--lights", "lamp", "--points", "p.csv"]);
    assert_eq!(exit, 3);
    assert!(log.contains("`ball`"), "{log}");
    assert_eq!(run(at, &["query", "ball", "--order", "7", "--points", "p.csv"]).0, 2);
    assert_eq!(run(at, &["run", "experiments/small.toml", "--filter", "rigg=x"]).0, 2);
    assert_eq!(run(at, &["run", "experiments/small.toml", "--filter", "rig=x"]).0, 4);
    std::fs::write(
        at.join("experiments/bad.toml"),
        "schema_version = 1\nname = \"bad\"\n[matrix]\nscen = [\"ball\"]\n",
    )
    .unwrap();
    let (exit, _, log) = run(at, &["run", "experiments/bad.toml"]);
    assert_eq!(exit, 3);
    assert!(log.contains("bad.toml:4:1") && log.contains("`scene`"), "{log}");
    assert!(!at.join("results").exists(), "a mistake left something behind");
}

#[test]
fn a_missing_gpu_is_an_error_only_where_one_was_demanded() {
    let folder = project();
    let without_driver = |arguments: &[&str]| {
        let mut command = rigbench();
        command.current_dir(folder.path()).args(arguments);
        command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        let output = command.output().unwrap();
        (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    let both = ["run", "experiments/small.toml", "--set", "matrix.backend=[\"cpu\", \"gpu\"]"];
    let (exit, log) = without_driver(&both);
    assert_eq!(exit, 0, "{log}");
    assert!(log.contains("going on with the CPU"), "{log}");
    let rows = csv(&std::fs::read(results(folder.path())).unwrap());
    assert_eq!(rows.iter().filter(|row| row["status"] == "skipped" && row["backend"] == "gpu").count(), 3);
    let (exit, _) = without_driver(&[&both[..], &["--backend", "gpu"]].concat());
    assert_eq!(exit, 5);
}
