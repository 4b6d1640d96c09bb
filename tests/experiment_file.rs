//! The experiment file: what it expands to, and that every mistake is found at its place.

use std::path::{Path, PathBuf};

use rigbench::experiment::{
    Axis, Backend, Candidate, Experiment, Filter, Identity, Keep, Override, Precision, Storage,
};
use rigbench::input::InputError;

const BOX: &str = r#"
schema_version = 1
[[object]]
name = "body"
receiver = true
shape = { box = { min = [-1, -0.5, -0.25], max = [1, 0.5, 0.25] } }
"#;

const LAMP: &str = r#"
schema_version = 1
[[light]]
name = "key"
point = { position = [0, 3, 0], intensity = [1, 1, 1] }
"#;

const FAMILY: &str = r#"
schema_version = 1
[random]
seed = 3
layouts = 3
lights = 2
kinds = ["sphere"]
distance = [1.0, 4.0]
size = [0.05, 0.3]
power = 10.0
"#;

const EMPTY: &str = "schema_version = 1\n";

const HEAD: &str = "schema_version = 1\nname = \"test\"\n";

const RIGS: &str = r#"
[rig.constant]
constant = {}
[rig.gradient]
gradient = {}
[rig.lattice]
lattice = { samples = [3, 2, 2] }
[rig.mixed]
mixed = { x = { lattice = 3 }, y = "constant", z = "gradient" }
"#;

/// A project in a folder of its own.
struct Project {
    folder: tempfile::TempDir,
}

impl Project {
    fn new() -> Self {
        let project = Self { folder: tempfile::tempdir().unwrap() };
        project.put("scenes/car.toml", BOX);
        project.put("scenes/head.toml", BOX);
        project.put("scenes/empty.toml", EMPTY);
        project.put("scenes/lights/lamp.toml", LAMP);
        project.put("scenes/lights/sun.toml", &LAMP.replace("0, 3, 0", "0, 9, 0"));
        project.put("scenes/lights/family.toml", FAMILY);
        project
    }

    fn put(&self, path: &str, text: &str) -> PathBuf {
        let path = self.folder.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    }

    fn load(&self, text: &str) -> Result<Experiment, InputError> {
        Experiment::load(&self.put("experiments/test.toml", text))
    }

    fn load_with(&self, text: &str, sets: &[&str]) -> Result<Experiment, InputError> {
        let path = self.put("experiments/test.toml", text);
        Experiment::load_with(&path, &sets.iter().map(|s| s.parse::<Override>().unwrap()).collect::<Vec<_>>())
    }
}

/// A matrix over one scene and one layout, with more lines.
fn file(matrix: &str, rest: &str) -> String {
    format!("{HEAD}[matrix]\nscene = [\"car\"]\nlights = [\"lamp\"]\n{matrix}\n{RIGS}\n{rest}\n")
}

fn labels(experiment: &Experiment) -> Vec<String> {
    experiment.candidates.iter().map(Candidate::label).collect()
}

fn column(candidate: &Candidate, axis: Axis) -> &str {
    candidate.column(axis).unwrap_or("-")
}

#[test]
fn the_product_runs_in_the_order_of_the_axes() {
    let project = Project::new();
    let text = format!(
        "{HEAD}[matrix]\nscene = [\"head\", \"car\"]\nlights = [\"sun\", \"lamp\"]\nrig = [\"mixed\", \"constant\"]\norder = [2, 3]\n{RIGS}"
    );
    let experiment = project.load(&text).unwrap();
    assert_eq!(experiment.candidates.len(), 16);
    let first: Vec<String> = experiment.candidates[..4]
        .iter()
        .map(|c| [Axis::Scene, Axis::Lights, Axis::Rig, Axis::Order].map(|a| column(c, a)).join(" "))
        .collect();
    assert_eq!(first, ["head sun mixed 2", "head sun mixed 3", "head sun constant 2", "head sun constant 3"]);
    assert_eq!(column(&experiment.candidates[15], Axis::Scene), "car");
    let defaults = &experiment.candidates[0];
    assert_eq!(defaults.backend, Backend::Cpu);
    assert_eq!(defaults.precision, Precision::F32);
    assert_eq!(column(defaults, Axis::LightModel), "exact");
    assert_eq!(column(defaults, Axis::ProbeSource), "analytic");
    assert_eq!((experiment.image.width, experiment.image.height, experiment.image.keep), (320, 180, Keep::Front));
    assert_eq!((experiment.timing.warmup, experiment.timing.repeat), (3, 15));
    assert_eq!(experiment.title, "test");
    let root = project.folder.path().canonicalize().unwrap();
    assert_eq!(
        experiment.results_folder().canonicalize().unwrap_or_else(|_| root.join("results/test")),
        root.join("results/test")
    );
}

#[test]
fn an_axis_without_a_meaning_makes_no_second_candidate() {
    let project = Project::new();
    let rigs = "rig = [\"direct\", \"constant\", \"gradient\", \"lattice\"]";
    let count = |matrix: &str| project.load(&file(&format!("{rigs}\n{matrix}"), "")).unwrap().candidates.len();
    assert_eq!(count(""), 4);
    // order: not for direct
    assert_eq!(count("order = [1, 2, 3]"), 1 + 3 * 3);
    // interpolation: only the lattice has one
    assert_eq!(count("interpolation = [\"nearest\", \"trilinear\", \"tricubic\"]"), 3 + 3);
    // precision: f64 on the CPU alone
    assert_eq!(count("precision = [\"f32\", \"f64\"]\nbackend = [\"cpu\", \"gpu\"]"), 4 * 2 + 4);
    // storage: the lattice on the GPU alone
    assert_eq!(count("storage = [\"buffer\", \"texture\"]\nbackend = [\"cpu\", \"gpu\"]"), 4 + 3 + 2);
    // hardware filters linearly, and nothing else
    let filtered =
        "storage = [\"buffer\", \"texture\"]\nbackend = [\"gpu\"]\ninterpolation = [\"tricubic\", \"trilinear\"]";
    assert_eq!(count(filtered), 3 + 1 + 2);

    // derivatives: the gradient rig, and lattices whose interpolation uses them
    let central = "[gradient_source.fd]\ncentral = { step = 0.01 }";
    let matrix =
        format!("{rigs}\ngradient_source = [\"analytic\", \"fd\"]\ninterpolation = [\"trilinear\", \"tricubic\"]");
    let experiment = project.load(&file(&matrix, central)).unwrap();
    let with_source: Vec<String> = experiment
        .candidates
        .iter()
        .filter(|c| c.gradient_source.is_some())
        .map(|c| {
            format!("{} {} {}", column(c, Axis::Rig), column(c, Axis::Interpolation), column(c, Axis::GradientSource))
        })
        .collect();
    assert_eq!(
        with_source,
        ["gradient - analytic", "gradient - fd", "lattice tricubic analytic", "lattice tricubic fd"]
    );
    assert_eq!(experiment.candidates.len(), 1 + 1 + 2 + 1 + 2);

    // rays bring derivatives of their own in place of the analytic ones, and its column says so; differences serve them too
    let traced = format!("{matrix}\nprobe_source = [\"analytic\", \"traced\"]");
    let experiment = project.load(&file(&traced, central)).unwrap();
    assert_eq!(experiment.candidates.len(), 1 + 2 + (2 + 2) + 2 + (2 + 2));
    let of_rays = experiment.candidates.iter().filter(|c| column(c, Axis::ProbeSource) == "traced");
    let sources: Vec<&str> = of_rays.map(|c| column(c, Axis::GradientSource)).collect();
    assert_eq!(sources, ["-", "semi_analytic", "fd", "-", "semi_analytic", "fd"]);

    let direct = &project.load(&file(rigs, "")).unwrap().candidates[0];
    assert!(direct.rig().is_none() && direct.order.is_none() && direct.window.is_none());
    for axis in [Axis::Order, Axis::Window, Axis::ProbeSource, Axis::GradientSource, Axis::Storage, Axis::Interpolation]
    {
        assert_eq!(direct.column(axis), None, "{axis}");
    }
    // the GPU computes in f32, and its row says so
    let gpu =
        &project.load(&file("rig = [\"lattice\"]\nbackend = [\"gpu\"]\nprecision = [\"f64\"]", "")).unwrap().candidates;
    assert_eq!((gpu.len(), gpu[0].precision, gpu[0].storage), (1, Precision::F32, Some(Storage::Buffer)));
}

#[test]
fn interpolation_of_the_matrix_overrides_the_rig_s_own() {
    let project = Project::new();
    let rig = "[rig.own]\nlattice = { samples = [2, 2, 2], interpolation = \"inverse_distance\", power = 2.0 }\n";
    let of = |matrix: &str| project.load(&file(&format!("rig = [\"own\"]\n{matrix}"), rig)).unwrap().candidates;
    let own = of("");
    assert_eq!(column(&own[0], Axis::Interpolation), "inverse_distance");
    let listed = of("interpolation = [\"inverse_distance\", \"trilinear\"]");
    assert_eq!(listed[0].rig(), own[0].rig(), "the power stays the rig's");
    assert_eq!(column(&listed[1], Axis::Interpolation), "trilinear");
    assert_ne!(listed[1].rig(), own[0].rig());
    let named = format!("{rig}\n[interpolation.steep]\ninverse_distance = {{ power = 4.0 }}");
    let steep = project.load(&file("rig = [\"own\"]\ninterpolation = [\"steep\"]", &named)).unwrap().candidates;
    assert_eq!(column(&steep[0], Axis::Interpolation), "steep");
    assert_ne!(steep[0].rig(), own[0].rig());
}

#[test]
fn random_layouts_are_candidates_each() {
    let project = Project::new();
    let text =
        format!("{HEAD}[matrix]\nscene = [\"car\", \"head\"]\nlights = [\"lamp\", \"family\"]\nrig = [\"direct\"]\n");
    let experiment = project.load(&text).unwrap();
    let names: Vec<&str> = experiment.candidates.iter().map(|c| column(c, Axis::Lights)).collect();
    assert_eq!(names[..4], ["lamp", "family#00", "family#01", "family#02"]);
    assert_eq!(names.len(), 8);
    let keys: std::collections::HashSet<_> = experiment.candidates.iter().map(|c| c.identity().key()).collect();
    assert_eq!(keys.len(), 8);
    // one of them by name, the family by its name
    let one = project.load(&text.replace("\"family\"", "\"family#1\"")).unwrap();
    assert_eq!(column(&one.candidates[1], Axis::Lights), "family#01");
    assert_eq!(one.candidates[1].identity().key(), experiment.candidates[2].identity().key());
    let without = project.load(&format!("{text}[[exclude]]\nlights = \"family\"\nscene = \"car\"\n")).unwrap();
    assert_eq!(without.candidates.len(), 5);
    let filter = Filter::parse(["lights=family#02"]).unwrap();
    assert_eq!(experiment.candidates.iter().filter(|c| filter.matches(c)).count(), 2);
    let error = project.load(&text.replace("\"family\"", "\"family#3\"")).unwrap_err();
    assert!(error.message.contains("3 random layouts"), "{error}");
}

#[test]
fn excludes_and_includes() {
    let project = Project::new();
    let matrix = "rig = [\"constant\", \"mixed\"]\norder = [2, 3]\nbackend = [\"cpu\", \"gpu\"]";
    let all = project.load(&file(matrix, "")).unwrap();
    assert_eq!(all.candidates.len(), 8);
    let some = project.load(&file(matrix, "[[exclude]]\nrig = \"mixed\"\norder = [2, 3]\nbackend = \"gpu\"")).unwrap();
    assert_eq!(some.candidates.len(), 6);
    assert!(!labels(&some).iter().any(|label| label.contains("mixed") && label.contains("gpu")));

    // an include comes after the excludes, takes one-value lists and defaults, and may name what the matrix has not
    let include = "[[include]]\nrig = \"lattice\"\norder = 5\nbackend = \"cpu\"\n";
    let more = project.load(&file(matrix, include)).unwrap();
    assert_eq!(more.candidates.len(), 9);
    let last = more.candidates.last().unwrap();
    assert_eq!((column(last, Axis::Scene), column(last, Axis::Rig), last.order), ("car", "lattice", Some(5)));
    // a duplicate appears once; an excluded candidate comes back
    let duplicate = "[[include]]\nrig = \"mixed\"\norder = 3\nbackend = \"cpu\"\n";
    assert_eq!(project.load(&file(matrix, duplicate)).unwrap().candidates.len(), 8);
    let back = format!("[[exclude]]\nrig = \"mixed\"\n{duplicate}");
    assert_eq!(project.load(&file(matrix, &back)).unwrap().candidates.len(), 5);
    // an axis with several values must be said, but only where it has a meaning
    let direct = "[[include]]\nrig = \"direct\"\nbackend = \"cpu\"\n";
    assert_eq!(project.load(&file(matrix, direct)).unwrap().candidates.len(), 9);
    // lists make several
    let several = "[[include]]\nrig = \"lattice\"\norder = [4, 5]\nbackend = [\"cpu\", \"gpu\"]\n";
    assert_eq!(project.load(&file(matrix, several)).unwrap().candidates.len(), 12);
}

#[test]
fn changes_of_the_command_line_come_before_everything() {
    let project = Project::new();
    let text = file("rig = [\"constant\"]", "[[include]]\nrig = \"mixed\"\norder = 3\n");
    let with = |sets: &[&str]| project.load_with(&text, sets);
    assert_eq!(with(&["image.width=640"]).unwrap().image.width, 640);
    assert_eq!(with(&["title=Which rig?"]).unwrap().title, "Which rig?");
    assert_eq!(with(&["title = \"quoted\""]).unwrap().title, "quoted");
    assert_eq!(with(&["matrix.order=[2, 3]", "include.0.order=2"]).unwrap().candidates.len(), 3);
    assert_eq!(with(&["rig.constant={ gradient = {} }"]).unwrap().candidates[0].rig().unwrap().key(), "gradient");
    // a part of an inline table
    let with_lattice = with(&["rig.lattice.lattice.samples=[1, 1, 2]", "matrix.rig=[\"lattice\"]"]).unwrap();
    assert!(serde_json::to_string(with_lattice.candidates[0].rig().unwrap()).unwrap().contains("[1,1,2]"));
    // later ones win
    assert_eq!(with(&["seed=4", "seed=5"]).unwrap().seed, 5);

    // mistakes are those of the change, not of a line that the file has not
    for (sets, column, part) in [
        (vec!["seed=1", "image.width=0"], 13, "width 0"),
        (vec!["image.widht=3"], 7, "widht"),
        (vec!["matrix.rig=[\"constant\", \"mixd\"]"], 25, "mixd"),
        (vec!["name.x=3"], 1, "neither a table nor a list"),
        (vec!["include.7.rig=\"direct\""], 9, "no index"),
        (vec!["matrix.scene=car"], 14, "list"),
    ] {
        let error = with(&sets).unwrap_err();
        assert_eq!(error.place, Some((1, column)), "{error}");
        assert!(error.path.to_string_lossy().starts_with("--set"), "{error}");
        assert!(error.to_string().contains(part), "{error}");
    }
    // and mistakes of the file keep their lines
    let error = project.load_with(&text.replace("order = 3", "order = 9"), &["image.width=640"]).unwrap_err();
    assert!(error.path.ends_with("test.toml"), "{error}");
    assert_eq!(error.place.unwrap().0, text.lines().position(|line| line == "order = 3").unwrap() + 1);
    for wrong in ["nothing", "=3", "a=1\nb=2"] {
        assert!(wrong.parse::<Override>().is_err());
    }
}

#[test]
fn filters_select() {
    let project = Project::new();
    let text = file("rig = [\"direct\", \"constant\", \"mixed\"]\norder = [2, 3]\nbackend = [\"cpu\", \"gpu\"]", "");
    let candidates = project.load(&text).unwrap().candidates;
    let count = |words: &[&str]| {
        let filter = Filter::parse(words.iter().copied()).unwrap();
        candidates.iter().filter(|c| filter.matches(c)).count()
    };
    assert_eq!(count(&[]), candidates.len());
    assert_eq!(count(&["rig=mixed"]), 4);
    assert_eq!(count(&["rig=mixed", "rig=constant"]), 8, "the same axis: or");
    assert_eq!(count(&["rig=mixed", "backend=gpu"]), 2, "different axes: and");
    assert_eq!(count(&["order=2"]), 4, "direct has no order");
    assert_eq!(count(&["rig=none-of-them"]), 0);
    let error = Filter::parse(["rigg=mixed"]).unwrap_err();
    assert!(error.contains("did you mean `rig`"), "{error}");
    assert!(Filter::parse(["rig"]).is_err());
    let nothing = Filter::parse(["rig=mixd"]).unwrap().explain_nothing(&candidates);
    assert!(nothing.contains("did you mean `mixed`"), "{nothing}");
}

#[test]
fn keys_hang_on_content_and_on_nothing_else() {
    let project = Project::new();
    let text = file("rig = [\"mixed\"]", "");
    let identity = |project: &Project, text: &str| -> Identity { project.load(text).unwrap().candidates[0].identity() };
    let key = |text: &str| identity(&project, text).key();
    let same = key(&text);
    // another folder, a path in place of a name, other settings that change no number
    assert_eq!(identity(&Project::new(), &text).key(), same);
    assert_eq!(key(&text.replace("\"car\"", "\"../scenes/car.toml\"")), same);
    assert_eq!(key(&text.replace("name = \"test\"", "name = \"other\"\ntitle = \"other\"")), same);
    assert_eq!(key(&file("rig = [\"mixed\"]", "[timing]\nwarmup = 1\nrepeat = 2\n[image]\nkeep = \"all\"")), same);
    assert_eq!(key(&file("rig = [\"mixed\", \"constant\"]\nbackend = [\"cpu\", \"gpu\"]", "")), same);
    assert_eq!(key(&file("rig = [\"mixed\"]\norder = [3]\nprecision = [\"f32\"]", "")), same, "defaults written out");
    let parameters = "[gradient_source.fd]\ncentral = { step = 0.01 }\n";
    let fd = "rig = [\"mixed\"]\ngradient_source = [\"fd\"]";
    // everything that changes a number changes the key, and so does what a name stands for
    let different = [
        key(&text.replace("lattice = 3 }", "lattice = 4 }")),
        key(&file("rig = [\"mixed\"]\norder = [2]", "")),
        key(&file("rig = [\"mixed\"]\nbackend = [\"gpu\"]", "")),
        key(&file("rig = [\"mixed\"]\nprecision = [\"f64\"]", "")),
        key(&file("rig = [\"mixed\"]", "[image]\nwidth = 640")),
        key(&file("rig = [\"mixed\"]", "[effects]\nmode = \"none\"")),
        key(&file("rig = [\"mixed\"]", "[reference]\npoints = 100")),
        key(&text.replace("[matrix]", "seed = 2\n[matrix]")),
        key(&text.replace("\"car\"", "\"head\"")),
        key(&text.replace("\"lamp\"", "\"sun\"")),
        key(&file(fd, parameters)),
        key(&file(fd, &parameters.replace("0.01", "0.02"))),
        key(&text.replace("z = \"gradient\" }", "z = \"gradient\" }\nfreeze_frame = 0")),
    ];
    let distinct: std::collections::HashSet<_> = different.iter().chain([&same]).collect();
    assert_eq!(distinct.len(), different.len() + 1);
    // content, not names or dates of files
    project.put("scenes/car.toml", &BOX.replace("-0.25", "-0.26"));
    assert_ne!(key(&text), same);
    project.put("scenes/car.toml", BOX);
    assert_eq!(key(&text), same);
    project.put("scenes/lights/lamp.toml", &LAMP.replace("0, 3, 0", "0, 3, 1"));
    assert_ne!(key(&text), same);
}

#[test]
fn a_reference_is_shared_by_all_candidates_that_it_judges() {
    let project = Project::new();
    let text = "rig = [\"direct\", \"mixed\", \"constant\"]\norder = [2, 3]\nbackend = [\"cpu\", \"gpu\"]";
    let experiment = project.load(&file(text, "")).unwrap();
    let part = serde_json::json!("area points");
    let keys: std::collections::HashSet<_> = experiment.candidates.iter().map(|c| c.reference_key(&part)).collect();
    assert_eq!(keys.len(), 1);
    let of = |text: String| project.load(&text).unwrap().candidates[0].reference_key(&part);
    let first = of(file(text, ""));
    assert!(keys.contains(&first));
    assert_ne!(of(file(text, "[effects]\nmode = \"none\"")), first);
    assert_ne!(of(file(text, "").replace("\"lamp\"", "\"sun\"")), first);
    assert_ne!(experiment.candidates[0].reference_key(&serde_json::json!("pixels")), first);
    // the size of the picture is part of what is asked for, not of the light
    assert_eq!(of(file(text, "[image]\nwidth = 20")), first);
}

#[test]
fn effects_are_the_words_of_the_command_line() {
    let project = Project::new();
    let mode = |mode: &str| {
        let experiment = project.load(&file("rig = [\"direct\"]", &format!("[effects]\nmode = {mode}")));
        experiment.map(|e| rigbench::experiment::effects_words(e.effects))
    };
    for (text, words) in [
        ("\"auto\"", "auto"),
        ("\"none\"", "none"),
        ("\"shadows\"", "shadows"),
        ("[\"shadows\", \"bounces=2\"]", "bounces=2"),
        ("{ shadows = true }", "shadows"),
        ("{ shadows = false }", "none"),
        ("{ bounces = \"inf\" }", "bounces=inf"),
        ("{ shadows = true, bounces = 0 }", "bounces=0"),
    ] {
        assert_eq!(mode(text).unwrap(), words, "{text}");
    }
    for (text, place, part) in [
        ("\"shadow\"", (18, 8), "shadow"),
        ("[\"shadows\", \"bounce=2\"]", (18, 20), "bounce"),
        ("[]", (18, 8), "empty"),
        ("{ bounces = -1 }", (18, 20), "bounces -1"),
        ("{ bounce = 1 }", (18, 10), "bounce"),
        ("3", (18, 8), "expected"),
    ] {
        let error = mode(text).unwrap_err();
        assert_eq!(error.place, Some(place), "{text}: {error}");
        assert!(error.message.contains(part), "{text}: {error}");
    }
}

/// Each row: the file with one thing replaced; where the mistake is, by the text at its place; what the message and the help say.
#[test]
fn every_mistake_is_found_at_its_place() {
    let project = Project::new();
    let valid = file(
        "rig = [\"direct\", \"constant\", \"lattice\", \"mixed\"]\norder = [2, 3]\nbackend = [\"cpu\", \"gpu\"]",
        r#"
[gradient_source.fd]
central = { step = 0.01 }
[window.soft]
hann = { width = 4.0 }
[image]
width = 64
height = 32
keep = "front"
[timing]
warmup = 1
repeat = 5
[reference]
points = 100
relative_error = 0.01
seconds = 5.0
[[exclude]]
rig = "mixed"
order = 2
[[include]]
rig = "lattice"
order = 5
backend = "cpu"
[[threshold]]
where = { rig = "mixed", scene = "car" }
metric = "interpolation_nrmse"
max = 0.05
"#,
    );
    project.load(&valid).unwrap();
    // (old, new, the text at the place of the mistake, part of the message, part of the help)
    let mistakes: &[(&str, &str, &str, &str, &str)] = &[
        // syntax, types, keys
        ("schema_version = 1", "schema_version = [1", "", "", ""),
        ("schema_version = 1\n", "", "name", "no schema_version", ""),
        ("schema_version = 1", "schema_version = 2", "2", "this program reads 1", ""),
        ("schema_version = 1", "schema_version = \"1\"", "\"1\"", "this program reads 1", ""),
        ("schema_version = 1", "schema_version = 2\nnews = 3", "2", "this program reads 1", ""),
        ("name = \"test\"", "nam = \"test\"", "nam =", "unknown field `nam`", "`name`"),
        ("name = \"test\"", "name = \"a/b\"", "\"a/b\"", "names a folder", ""),
        ("name = \"test\"", "name = \"..\"", "\"..\"", "names a folder", ""),
        ("name = \"test\"", "name = \"test\"\nkind = \"sweeep\"", "\"sweeep\"", "unknown kind", "`sweep`"),
        ("name = \"test\"", "name = \"test\"\nkind = \"stability\"", "\"stability\"", "hard cases", ""),
        ("name = \"test\"", "name = \"test\"\nseed = -1", "-1", "not negative", ""),
        ("name = \"test\"", "name = \"test\"\nseed = 1.5", "1.5", "whole number", ""),
        ("width = 64", "widht = 64", "widht", "unknown field", "`width`"),
        ("width = 64", "width = 0", "0", "width 0", ""),
        ("width = 64", "width = 64.5", "64.5", "whole number", ""),
        ("keep = \"front\"", "keep = \"frnt\"", "\"frnt\"", "unknown keep", "`front`"),
        ("repeat = 5", "repeat = 0", "0\n", "repeat 0", ""),
        ("warmup = 1", "warmup = -1", "-1", "warmup -1", ""),
        ("relative_error = 0.01", "relative_error = 0.0", "0.0\n", "above 0", ""),
        ("seconds = 5.0", "seconds = inf", "inf", "no finite number", ""),
        ("points = 100", "pionts = 100", "pionts", "unknown field", "`points`"),
        // the matrix
        ("order = [2, 3]", "order = 2", "2\n", "is a list in the matrix: [2]", ""),
        ("order = [2, 3]", "order = []", "[]", "empty list", ""),
        ("order = [2, 3]", "order = [2, 7]", "7]", "whole number from 1 to 6", ""),
        ("order = [2, 3]", "order = [2, \"3\"]", "\"3\"]", "whole number", ""),
        ("order = [2, 3]", "order = [2.0, 3]", "2.0", "whole number", ""),
        ("order = [2, 3]", "order = [2, [3]]", "[3]]", "expected a string, a number or a boolean", ""),
        ("order = [2, 3]", "ordr = [2, 3]", "ordr", "unknown axis `ordr`", "`order`"),
        ("order = [2, 3]", "order = [2, 3, 2]", "2]", "equal in every column", ""),
        ("order = [2, 3]", "order = [2, 3]\norder = [2]", "order = [2]", "duplicate key", ""),
        ("scene = [\"car\"]", "scene = [\"car\", \"../scenes/car.toml\"]", "\"../scenes", "equal in every column", ""),
        ("scene = [\"car\"]", "scene = [\"car\", \"kar\"]", "\"kar\"", "kar", "`car`"),
        ("scene = [\"car\"]", "scene = [\"empty\"]", "\"empty\"", "no receiver", ""),
        ("scene = [\"car\"]", "scene = [true]", "true", "string", ""),
        ("lights = [\"lamp\"]", "lights = [\"lmp\"]", "\"lmp\"", "lmp", "`lamp`"),
        ("lights = [\"lamp\"]\n", "", "[matrix]", "no `lights`", ""),
        ("\"lattice\", \"mixed\"]", "\"lattice\", \"mixxed\"]", "\"mixxed\"", "unknown rig `mixxed`", "`mixed`"),
        ("\"lattice\", \"mixed\"]", "3, \"lattice\", \"mixed\"]", "3, \"lattice\"", "string", ""),
        ("[\"cpu\", \"gpu\"]", "[\"cpu\", \"gppu\"]", "\"gppu\"", "unknown backend", "`gpu`"),
        ("order = [2, 3]", "interpolation = [\"trilinaer\"]", "\"trilinaer\"", "unknown interpolation", "`trilinear`"),
        ("order = [2, 3]", "heuristic = [\"hm\"]", "\"hm\"", "unknown heuristic `hm`", "`harmonic_mean`"),
        ("order = [2, 3]", "window = [\"hann\"]", "\"hann\"", "needs parameters", "[window.NAME]"),
        ("order = [2, 3]", "window = [\"sofft\"]", "\"sofft\"", "unknown window", "`soft`"),
        ("order = [2, 3]", "gradient_source = [\"central\"]", "\"central\"", "needs parameters", "step"),
        ("order = [2, 3]", "light_model = [\"walace\"]", "\"walace\"", "unknown light model", "`wallace`"),
        (
            "order = [2, 3]",
            "probe_source = [\"capture\"]",
            "\"capture\"",
            "unknown probe source `capture`",
            "`captured`",
        ),
        (
            "[window.soft]",
            "[probe_source.p]\nrelit = { iterations = 2, on = \"gpu\" }\n[window.soft]",
            "on = ",
            "unknown field `on`, expected `face` or `iterations`",
            "",
        ),
        (
            "[window.soft]",
            "[probe_source.p]\ncaptured = { on = \"gppu\" }\n[window.soft]",
            "\"gppu\"",
            "expected `cpu` or `gpu`",
            "`gpu`",
        ),
        // light models, transitions, frames, studies
        (
            "[window.soft]",
            "[light_model.m]\ndisk = \"wallac\"\n[window.soft]",
            "\"wallac\"",
            "unknown disk light model",
            "`wallace`",
        ),
        (
            "[window.soft]",
            "[light_model.m]\ndisk = \"wallace\"\ntable_size = 8\n[window.soft]",
            "8\n",
            "no shape by its table",
            "",
        ),
        (
            "[window.soft]",
            "[light_model.m]\ndisk = \"table\"\ntable_size = 1\n[window.soft]",
            "1\n",
            "table_size 1",
            "",
        ),
        ("[window.soft]", "[transition.t]\nthreshold = 0.0\n[window.soft]", "0.0", "above 0", ""),
        ("[window.soft]", "[transition.t]\nthreshold = 0.1\nblend = 1.5\n[window.soft]", "1.5", "0 to 1", ""),
        ("[window.soft]", "[transition.nearer]\nthreshold = 0.1\n[window.soft]", "nearer]", "built-in transition", ""),
        ("width = 64", "width = 64\nframe = 2", "2\n", "scene `car` has 1", ""),
        ("order = [2, 3]", "light_model = [\"valve\"]", "[matrix]", "no light model of the list has SH", ""),
        ("[window.soft]", "[[study]]\nname = \"s\"\n[window.soft]", "[[study]]", "no study", ""),
        (
            "[window.soft]",
            "[[study]]\nname = \"a/b\"\nwrap_lobe = { wraps = [0.0] }\n[window.soft]",
            "\"a/b\"",
            "names a file",
            "",
        ),
        ("[window.soft]", "[[study]]\nname = \"s\"\nwrap_lobe = { wraps = [1.5] }\n[window.soft]", "1.5", "0 to 1", ""),
        // definitions
        ("[rig.constant]\nconstant = {}", "[rig.constant]\nconstnt = {}", "constnt", "unknown rig", "`constant`"),
        ("[rig.constant]\nconstant = {}", "[rig.constant]", "[rig.constant]", "no rig", ""),
        (
            "[rig.constant]\nconstant = {}",
            "[rig.constant]\nconstant = {}\ngradient = {}",
            "{}\n",
            "`constant` and `gradient`",
            "",
        ),
        ("[rig.constant]\nconstant = {}", "[rig]\nconstant = 3", "3", "expected struct RigFile", ""),
        ("[rig.gradient]", "[rig.direct]", "direct", "built in", ""),
        ("gradient = {}", "gradient = {}\nfreeze_frame = -1", "-1", "", ""),
        ("constant = {}", "constant = {}\nfreeze_frame = 3", "3\n", "scene `car` has 1", ""),
        ("samples = [3, 2, 2]", "samples = [3, 2]", "[3, 2]", "three", ""),
        ("samples = [3, 2, 2]", "samples = [3, 0, 2]", "0, 2", "0 samples", ""),
        ("[window.soft]", "[window.none]", "none", "built-in window", ""),
        ("hann = { width = 4.0 }", "hann = { width = -4.0 }", "-4.0", "above 0", ""),
        ("hann = { width = 4.0 }", "hann = { wdth = 4.0 }", "wdth", "unknown field", "`width`"),
        ("central = { step = 0.01 }", "central = { step = nan }", "nan", "no finite number", ""),
        ("[gradient_source.fd]", "[gradient_sorce.fd]", "gradient_sorce", "unknown field", "`gradient_source`"),
        // exclude, include, threshold
        (
            "[[exclude]]\nrig = \"mixed\"",
            "[[exclude]]\nrig = \"mixd\"",
            "\"mixd\"",
            "unknown value of `rig`",
            "`mixed`",
        ),
        (
            "[[exclude]]\nrig = \"mixed\"",
            "[[exclude]]\nrig = \"direct\"",
            "[[exclude]]",
            "removes nothing",
            "no meaning",
        ),
        ("[[exclude]]\nrig = \"mixed\"", "[[exclude]]\nrg = \"mixed\"", "rg", "unknown axis", "`rig`"),
        ("[[exclude]]\nrig = \"mixed\"", "[[exclude]]\nrig = []", "[]", "empty list", ""),
        ("order = 5\nbackend = \"cpu\"", "order = 5", "[[include]]", "`backend` is left out", ""),
        ("order = 5\nbackend = \"cpu\"", "order = 8\nbackend = \"cpu\"", "8\n", "1 to 6", ""),
        (
            "order = 5\nbackend = \"cpu\"",
            "order = 5\nbackend = \"cpu\"\nstorage = \"buffer\"",
            "storage",
            "no meaning",
            "",
        ),
        ("where = { rig = \"mixed\"", "where = { rig = \"mxed\"", "\"mxed\"", "unknown value", "`mixed`"),
        ("where = { rig = \"mixed\"", "where = { order = 2, rig = \"mixed\"", "{ order", "matches no run", ""),
        (
            "metric = \"interpolation_nrmse\"",
            "metric = \"interpolation_nrsme\"",
            "\"interp",
            "unknown metric",
            "`interpolation_nrmse`",
        ),
        ("metric = \"interpolation_nrmse\"", "metric = \"status\"", "\"status\"", "unknown metric", ""),
        ("max = 0.05", "mx = 0.05", "mx", "unknown field", "`max`"),
        ("max = 0.05", "", "[[threshold]]", "needs `max` or `min`", ""),
        ("max = 0.05", "max = 0.05\nmin = 0.1", "[[threshold]]", "min 0.1 is above max 0.05", ""),
        ("max = 0.05", "max = nan", "nan", "no finite number", ""),
    ];
    let mut wrong = String::new();
    for (old, new, at, message, help) in mistakes {
        assert!(valid.contains(old), "`{old}` is not in the file");
        let text = valid.replacen(old, new, 1);
        let error = match project.load(&text) {
            Err(error) => error,
            Ok(_) => {
                wrong += &format!("`{new}` passed\n");
                continue;
            }
        };
        let place = error.place.unwrap_or((0, 1));
        let line = text.lines().nth(place.0.wrapping_sub(1)).unwrap_or_default();
        let rest: String = format!("{line}\n").chars().skip(place.1 - 1).collect();
        let told = error.message.contains(message) && error.help.as_deref().unwrap_or_default().contains(help);
        if !rest.starts_with(at) || !told || !error.path.ends_with("experiments/test.toml") {
            wrong += &format!("`{new}` points at `{}`, not at `{at}`: {error}\n", rest.trim_end());
        }
    }
    assert!(wrong.is_empty(), "\n{wrong}");
    assert!(!project.folder.path().join("results").exists(), "nothing is written");
}

#[test]
fn mistakes_of_other_files_name_those_files() {
    let project = Project::new();
    project.put("scenes/car.toml", "schema_version = 1\n[[object]]\nname = 3\n");
    let error = project.load(&file("rig = [\"direct\"]", "")).unwrap_err();
    assert!(error.path.ends_with("scenes/car.toml"), "{error}");
    assert_eq!(error.place, Some((3, 8)));
    let error = Experiment::load(Path::new("no/such/experiment.toml")).unwrap_err();
    assert!(error.to_string().contains("no/such/experiment.toml"), "{error}");
}

/// Planning is linear: the work of 10,000 candidates is that of 1,000, ten times (counted as bytes of configuration).
#[test]
fn ten_thousand_candidates_load_each_file_once() {
    let project = Project::new();
    let steps: Vec<usize> = (1..=834).collect();
    let rigs: String = steps.iter().map(|n| format!("[rig.r{n}]\nlattice = {{ samples = [{n}, 2, 2] }}\n")).collect();
    let names: Vec<String> = steps.iter().map(|n| format!("\"r{n}\"")).collect();
    let text = format!(
        "{HEAD}[matrix]\nscene = [\"car\", \"head\"]\nlights = [\"lamp\", \"sun\"]\nrig = [{}]\norder = [2, 3, 5]\n{rigs}",
        names.join(", ")
    );
    let experiment = project.load(&text).unwrap();
    assert_eq!(experiment.candidates.len(), 2 * 2 * 834 * 3);
    // scenes and rigs are shared, not copied
    let first = &experiment.candidates[0];
    assert!(experiment.candidates[..2502].iter().all(|c| std::sync::Arc::ptr_eq(&c.scene, &first.scene)));
    let keys: std::collections::HashSet<_> = experiment.candidates.iter().map(|c| c.identity().key()).collect();
    assert_eq!(keys.len(), experiment.candidates.len());
}

/// A light model is a value for `direct`; a rig has the models in which something has SH, and the others say nothing about it.
#[test]
fn a_rig_takes_the_light_models_that_have_sh() {
    let project = Project::new();
    let text = format!(
        "{HEAD}[matrix]\nscene = [\"car\"]\nlights = [\"lamp\"]\nrig = [\"direct\", \"constant\"]\n\
         light_model = [\"exact\", \"wallace\", \"valve\", \"table\"]\n{RIGS}"
    );
    let experiment = project.load(&text).unwrap();
    let models = |rig: &str| -> Vec<String> {
        let mine = experiment.candidates.iter().filter(|c| c.column(Axis::Rig) == Some(rig));
        mine.map(|c| c.column(Axis::LightModel).unwrap().to_owned()).collect()
    };
    assert_eq!(models("direct"), ["exact", "wallace", "valve", "table"]);
    assert_eq!(models("constant"), ["exact", "wallace", "table"]);
    // a sphere's table has no SH: the rig samples spheres exactly and disks from their table
    let tabulated = experiment.candidates.iter().find(|c| c.rig().is_some() && c.light_model.disk == "table").unwrap();
    assert_eq!(tabulated.light_model.sphere, "exact");
    let keys: std::collections::HashSet<_> = experiment.candidates.iter().map(|c| c.identity().key()).collect();
    assert_eq!(keys.len(), experiment.candidates.len());
}
