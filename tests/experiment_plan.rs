//! `rigbench plan`, the exit codes of what it is asked, and the verbs that print what clap knows.

use std::path::{Path, PathBuf};
use std::process::Output;

use rigbench::experiment::Experiment;
use rigbench::run::{Claim, Store};
use serde_json::json;

const EXPERIMENT: &str = r#"
schema_version = 1
name = "small"
[image]
width = 32
height = 18
[matrix]
scene = ["car"]
lights = ["lamp"]
rig = ["direct", "constant", "gradient"]
[rig.constant]
constant = {}
[rig.gradient]
gradient = {}
"#;

const SCENE: &str = r#"
schema_version = 1
[[object]]
name = "body"
receiver = true
shape = { box = { min = [-1, -1, -1], max = [1, 1, 1] } }
"#;

const LIGHTS: &str = r#"
schema_version = 1
[[light]]
name = "key"
point = { position = [0, 3, 0], intensity = [1, 1, 1] }
"#;

struct Project(tempfile::TempDir);

impl Project {
    fn new() -> Self {
        let project = Self(tempfile::tempdir().unwrap());
        project.put("scenes/car.toml", SCENE);
        project.put("scenes/lights/lamp.toml", LIGHTS);
        project.put("experiments/small.toml", EXPERIMENT);
        project
    }
    fn put(&self, path: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    }
    fn experiment(&self) -> PathBuf {
        self.0.path().join("experiments/small.toml")
    }
    fn results(&self) -> PathBuf {
        self.0.path().join("results/small")
    }
    /// Computes every run of the experiment, as far as the store is concerned.
    fn finish_all(&self) {
        let store = Store::at(&self.results());
        for candidate in Experiment::load(&self.experiment()).unwrap().candidates {
            if let Claim::Mine(writer) = store.claim(&candidate.identity(), false, false).unwrap() {
                writer.finish(json!({ "nrmse": 0.5 })).unwrap();
            }
        }
    }
    fn plan(&self, arguments: &[&str]) -> (i32, String, String) {
        let path = self.experiment();
        rigbench([&["plan", path.to_str().unwrap()], arguments].concat().as_slice())
    }
}

fn rigbench(arguments: &[&str]) -> (i32, String, String) {
    let mut command = assert_cmd::Command::cargo_bin("rigbench").unwrap();
    let Output { status, stdout, stderr } = command.args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code().unwrap(), text(stdout), text(stderr))
}

#[test]
fn a_plan_says_what_would_run_and_why() {
    let project = Project::new();
    let (code, out, err) = project.plan(&[]);
    assert_eq!((code, err.as_str()), (0, ""));
    assert!(out.contains("small: 3 runs, 0 cached, 3 to compute"), "{out}");
    assert_eq!(
        out.lines().filter(|line| line.ends_with("  new")).count(),
        3 + 1,
        "a line a run and one of the summary"
    );
    assert!(!project.0.path().join("results").exists(), "a plan writes nothing");

    project.finish_all();
    let (_, out, _) = project.plan(&[]);
    assert!(out.contains("3 runs, 3 cached, 0 to compute"), "{out}");
    let (_, out, _) = project.plan(&["--force"]);
    assert!(out.contains("0 cached, 3 to compute") && out.contains("forced"), "{out}");
    let (_, out, _) = project.plan(&["--set", "image.width=64"]);
    assert_eq!(out.matches("configuration changed: image.width 32 -> 64").count(), 3, "{out}");
    let (_, out, _) =
        project.plan(&["--set", "rig.gradient.gradient={}", "--set", "title=Other", "--set", "timing.repeat=2"]);
    assert!(out.contains("3 cached"), "what changes no number runs nothing: {out}");

    project.put("scenes/car.toml", &SCENE.replace("[1, 1, 1]", "[1, 1, 2]"));
    let (_, out, _) = project.plan(&[]);
    assert_eq!(out.lines().filter(|line| line.ends_with("  scene changed")).count(), 4, "{out}");
    project.put("scenes/car.toml", SCENE);
    let store = Store::at(&project.results());
    let run = &Experiment::load(&project.experiment()).unwrap().candidates[1];
    let Claim::Mine(writer) = store.claim(&run.identity(), true, false).unwrap() else { panic!("not claimed") };
    writer.fail("the lamp broke").unwrap();
    let (_, out, _) = project.plan(&[]);
    assert!(out.contains("2 cached, 1 to compute") && out.contains("failed before: the lamp broke"), "{out}");
    // elsewhere there is nothing yet
    let elsewhere = project.0.path().join("elsewhere");
    let (_, out, _) = project.plan(&["--out", elsewhere.to_str().unwrap()]);
    assert!(out.contains("0 cached") && !elsewhere.exists(), "{out}");
}

#[test]
fn a_plan_tells_the_disk_it_takes() {
    let project = Project::new();
    let size = |sets: &[&str]| {
        let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
        let (_, out, _) = project.plan(&sets);
        out.lines().find(|line| line.starts_with("disk:")).unwrap().to_owned()
    };
    let large = ["image.width=320", "image.height=180"];
    assert!(size(&[large[0], large[1], "image.keep=all"]).contains("3 images of 320 x 180 at 735 kB"));
    assert!(size(&["image.width=640", "image.height=360", "image.keep=all"]).contains("at 2.9 MB"));
    assert!(size(&["image.keep=none"]).contains("no image is kept"));
    assert!(size(&large).starts_with("disk: 2.3 MB to 2.3 MB"), "{}", size(&large));
}

#[test]
fn exit_codes_are_the_contract_s() {
    let project = Project::new();
    for (arguments, code, part) in [
        (vec!["--filter", "rig=gradient"], 0, ""),
        (vec!["--filter", "rgi=gradient"], 2, "did you mean `rig`"),
        (vec!["--filter", "rig"], 2, "axis=value"),
        (vec!["--set", "image"], 2, "key=value"),
        (vec!["--backend", "gppu"], 2, "gpu"),
        (vec!["--filter", "rig=gradeint"], 4, "did you mean `gradient`"),
        (vec!["--filter", "rig=gradient", "--filter", "order=2"], 4, "order"),
        (vec!["--backend", "gpu"], 4, "backend"),
        (vec!["--set", "image.width=0"], 3, "--set image.width=0:1:13: width 0"),
        (vec!["--set", "matrix.rig=[\"constnt\"]"], 3, "did you mean `constant`"),
    ] {
        let (got, out, err) = project.plan(&arguments);
        assert_eq!(got, code, "{arguments:?}: {err}");
        assert!(err.contains(part), "{arguments:?}: {err}");
        assert_eq!(out.is_empty(), code != 0, "data goes to stdout, all else to stderr");
    }
    let (code, out, err) = rigbench(&["plan", "no/such.toml"]);
    assert_eq!((code, out.as_str()), (3, ""));
    assert!(err.contains("no/such.toml"), "{err}");
    let (code, ..) = rigbench(&["plan"]);
    assert_eq!(code, 2);
    let (code, ..) = rigbench(&["plam"]);
    assert_eq!(code, 2);
    assert!(!project.0.path().join("results").exists(), "nothing is written");
}

#[test]
fn a_mistake_names_file_line_and_column() {
    let project = Project::new();
    project.put("experiments/small.toml", &EXPERIMENT.replace("\"gradient\"]", "\"gradint\"]"));
    let (code, _, err) = project.plan(&[]);
    assert_eq!(code, 3);
    assert!(
        err.contains("small.toml:10:30: unknown rig `gradint`") && err.contains("did you mean `gradient`?"),
        "{err}"
    );
    project.put("experiments/small.toml", EXPERIMENT);
    project.put("scenes/lights/lamp.toml", &LIGHTS.replace("intensity", "intensty"));
    let (code, _, err) = project.plan(&[]);
    assert_eq!(code, 3);
    assert!(err.contains("lamp.toml:5:") && err.contains("`intensity`"), "{err}");
}

#[test]
fn what_clap_knows_is_printed() {
    let (code, man, _) = rigbench(&["man"]);
    assert_eq!(code, 0);
    for part in ["RIGBENCH PLAN", "\\-\\-filter", "EXIT STATUS", "\\fB130\\fR"] {
        assert!(man.contains(part), "no {part} in the manual");
    }
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let (code, script, _) = rigbench(&["completions", shell]);
        assert!(code == 0 && script.contains("plan") && script.contains("filter"), "{shell}");
    }
    assert_eq!(rigbench(&["completions", "tcsh"]).0, 2);
    let (code, out, _) = rigbench(&["--version"]);
    assert_eq!((code, out.trim()), (0, concat!("rigbench ", env!("CARGO_PKG_VERSION"))));
    assert!(Path::new(env!("CARGO_BIN_EXE_rigbench")).is_file());
}
