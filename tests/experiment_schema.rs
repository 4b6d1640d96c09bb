//! `rigbench schema` and the program agree on what a file may hold, and the schemas that editors read are current.

use std::path::{Path, PathBuf};

use rigbench::experiment::Experiment;
use rigbench::input::Source;
use rigbench::rig::catalogue;
use rigbench::scene::{Layout, Scene};
use rigbench::stability::{HardCases, is_stability};
use serde_json::{Value, json};

/// Why a value does not fit a schema; the keywords of draft 7 that the schemas use, any other is an error of the schema.
fn misfit(schema: &Value, value: &Value) -> Option<String> {
    misfit_in(schema, schema, value)
}

/// The same for a part of a schema; `root` holds the definitions.
fn misfit_in(root: &Value, schema: &Value, value: &Value) -> Option<String> {
    if let Value::Bool(allowed) = schema {
        return (!allowed).then(|| format!("{value} where nothing is allowed"));
    }
    let number = |v: &Value| v.as_f64();
    for (keyword, rule) in schema.as_object().expect("a schema is an object") {
        let rules = || rule.as_array().expect("a list of schemas").iter();
        let fits = match keyword.as_str() {
            "$ref" => {
                let name = rule.as_str().and_then(|path| path.strip_prefix("#/definitions/")).unwrap();
                match misfit_in(root, &root["definitions"][name], value) {
                    Some(why) => return Some(why),
                    None => true,
                }
            }
            "$schema" | "definitions" | "title" | "description" | "default" => true,
            "type" => match rule.as_str().unwrap() {
                "object" => value.is_object(),
                "array" => value.is_array(),
                "string" => value.is_string(),
                "boolean" => value.is_boolean(),
                "number" => value.is_number(),
                "integer" => value.is_i64() || value.is_u64(),
                other => panic!("unknown type {other}"),
            },
            "enum" => rules().any(|allowed| allowed == value),
            "minimum" => number(value).is_none_or(|v| v >= number(rule).unwrap()),
            "maximum" => number(value).is_none_or(|v| v <= number(rule).unwrap()),
            "exclusiveMinimum" => number(value).is_none_or(|v| v > number(rule).unwrap()),
            "exclusiveMaximum" => number(value).is_none_or(|v| v < number(rule).unwrap()),
            "minItems" => value.as_array().is_none_or(|v| v.len() as u64 >= rule.as_u64().unwrap()),
            "maxItems" => value.as_array().is_none_or(|v| v.len() as u64 <= rule.as_u64().unwrap()),
            "items" => match value.as_array().into_iter().flatten().find_map(|item| misfit_in(root, rule, item)) {
                Some(why) => return Some(why),
                None => true,
            },
            "required" => match (value.as_object(), rules().find(|key| value.get(key.as_str().unwrap()).is_none())) {
                (Some(_), Some(key)) => return Some(format!("no {key}")),
                _ => true,
            },
            "properties" => {
                let known = rule.as_object().unwrap();
                let inner = known.iter().filter_map(|(key, schema)| Some((key, schema, value.get(key)?)));
                match inner.filter_map(|(key, schema, v)| Some((key, misfit_in(root, schema, v)?))).next() {
                    Some((key, why)) => return Some(format!("{key}: {why}")),
                    None => true,
                }
            }
            "additionalProperties" => {
                let known = schema.get("properties").and_then(Value::as_object);
                let mut others = value.as_object().into_iter().flatten();
                match others.find_map(|(key, v)| {
                    let other = !known.is_some_and(|known| known.contains_key(key));
                    other.then(|| misfit_in(root, rule, v)).flatten().map(|why| format!("{key}: {why}"))
                }) {
                    Some(why) => return Some(why),
                    None => true,
                }
            }
            "anyOf" => rules().any(|schema| misfit_in(root, schema, value).is_none()),
            "oneOf" => rules().filter(|schema| misfit_in(root, schema, value).is_none()).count() == 1,
            "not" => misfit_in(root, rule, value).is_some(),
            "pattern" => {
                // the one pattern of the schemas: a folder's name
                assert_eq!(rule, "^[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}$");
                let name = value.as_str().unwrap_or_default();
                let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
                !name.is_empty() && name.len() <= 100 && !name.starts_with('.') && name.chars().all(plain)
            }
            other => panic!("the schemas do not use `{other}`"),
        };
        if !fits {
            return Some(format!("{value} against {keyword} {rule}"));
        }
    }
    None
}

fn json_of(text: &str) -> Option<Value> {
    serde_json::to_value(toml::from_str::<toml::Value>(text).ok()?).ok()
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn toml_files(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(root().join(folder)).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> =
        entries.map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "toml")).collect();
    files.sort();
    files
}

#[test]
fn shipped_files_fit_their_schemas() {
    for (folder, schema, least, line) in [
        ("experiments", Experiment::schema(), 1, "#:schema ../schemas/experiment.json\n"),
        ("scenes", Scene::schema(), 4, "#:schema ../schemas/scene.json\n"),
        ("scenes/lights", Layout::schema(), 4, "#:schema ../../schemas/lights.json\n"),
    ] {
        let files = toml_files(folder);
        assert!(files.len() >= least, "{folder}: {files:?}");
        for file in files {
            let text = std::fs::read_to_string(&file).unwrap();
            let (hard_cases, hard_line) = (HardCases::schema(), "#:schema ../schemas/hard-cases.json\n");
            let hard = is_stability(&file);
            let (schema, line) = if hard { (&hard_cases, hard_line) } else { (&schema, line) };
            assert_eq!(misfit(schema, &json_of(&text).unwrap()), None, "{}", file.display());
            // the line by which editors find the schema
            assert!(text.starts_with(line), "{} does not begin with {line}", file.display());
            let schema = line.trim_start_matches("#:schema ").trim_end();
            assert!(root().join(folder).join(schema).exists(), "{schema}");
        }
    }
}

#[test]
fn the_shipped_hard_cases_load_and_mistakes_are_pointed_at() {
    let path = root().join("experiments/hard-cases.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let cases = HardCases::load(&path).unwrap();
    assert!(cases.families.len() >= 30 && !cases.bounds.is_empty());
    let folder = tempfile::tempdir().unwrap();
    // a map that the file names by its place beside it
    let maps = folder.path().join("scenes/lights/maps");
    std::fs::create_dir_all(&maps).unwrap();
    std::fs::create_dir(folder.path().join("experiments")).unwrap();
    std::fs::copy(root().join("scenes/lights/maps/decades.hdr"), maps.join("decades.hdr")).unwrap();
    let schema = HardCases::schema();
    for (old, new, message, fits) in [
        ("kind = \"stability\"\n", "kind = \"stability\"\nseeds = 3\n", "unknown field `seeds`", false),
        ("\"=1 + t\"", "\"=1 + u\"", "unknown word `u`", true),
        ("\"=1 + t\"", "\"=1/(t - t)\"", "must be a finite number", true),
        ("\"=1 + t\"", "\"one\"", "expected", true),
        ("name = \"sphere-touches\"", "name = \"sphere touches\"", "letters, digits", true),
        ("from = 1.0, to = 1e-7", "from = -1.0, to = 1e-7", "above 0", true),
        ("half = [0.5, 0.25, 0.5]", "half = [0.5, -0.25, 0.5]", "none is negative", true),
        (
            "rig = [\"direct\", \"constant\", \"gradient\", \"mixed\"]",
            "rig = [\"direct\", \"constat\"]",
            "unknown rig `constat`",
            true,
        ),
        ("order = [2, 3, 5]", "order = [2, 7]", "order 7", false),
        ("metric = \"non_finite\"", "metric = \"nonfinite\"", "unknown metric", false),
    ] {
        assert!(text.contains(old), "{old} is not in the file");
        let changed = text.replacen(old, new, 1);
        let copy = folder.path().join("experiments/changed.toml");
        std::fs::write(&copy, &changed).unwrap();
        let error = HardCases::load(&copy).unwrap_err();
        assert!(error.message.contains(message), "{new}: {error}");
        assert!(error.place.is_some(), "{new}: {error}");
        assert_eq!(misfit(&schema, &json_of(&changed).unwrap()).is_none(), fits, "{new}");
    }
}

#[test]
fn every_rig_of_the_catalogue_fits_the_schema_of_rigs() {
    let schema = Experiment::schema();
    let schema = &schema["properties"]["rig"]["additionalProperties"];
    for entry in catalogue() {
        assert_eq!(misfit(schema, &json_of(entry.text).unwrap()), None, "{}", entry.text);
    }
}

/// Variants of a valid file by replacing one text by another; both sides must accept the first list and refuse the second.
fn agree(
    schema: &Value,
    accepts: &dyn Fn(&str) -> Result<(), String>,
    valid: &str,
    fine: &[(&str, &str)],
    wrong: &[(&str, &str)],
) {
    let verdicts = |text: &str| (accepts(text), json_of(text).and_then(|json| misfit(schema, &json)));
    assert_eq!(verdicts(valid), (Ok(()), None));
    for (list, good) in [(fine, true), (wrong, false)] {
        for (old, new) in list {
            assert!(valid.contains(old), "`{old}` is not in the file");
            let (program, misfit) = verdicts(&valid.replacen(old, new, 1));
            assert_eq!(program.is_ok(), good, "`{new}`: the program: {program:?}");
            assert_eq!(misfit.is_none(), good, "`{new}`: the schema: {misfit:?}");
        }
    }
}

const SCENE: &str = r#"
schema_version = 1
title = "Scene"
[camera]
eye = [3.0, 1.6, 4.0]
target = [0, 0.5, 0]
fov_y = 35.0
[material.paint]
albedo = [0.7, 0.2, 0.2]
wrap = 0.5
[[object]]
name = "body"
receiver = true
material = "paint"
shape = { box = { min = [-1, -1, -1], max = [1, 1, 1] } }
transform = { scale = 2, rotate = [0, 90, 0] }
[[object]]
name = "floor"
shape = { quad = { center = [0,0,0], u = [5,0,0], v = [0,0,-5] } }
[[receiver]]
name = "room"
bounds = { min = [-1,-1,-1], max = [1,1,1] }
"#;

#[test]
fn program_and_schema_agree_on_scenes() {
    let accepts = |text: &str| match Scene::of_source(&Source::inline("scene.toml", text)) {
        Ok(_) => Ok(()),
        Err(error) => Err(error.to_string()),
    };
    agree(
        &Scene::schema(),
        &accepts,
        SCENE,
        &[
            ("scale = 2", "scale = [1, 2, 3.5]"),
            ("target = [0, 0.5, 0]", "target = [0, 0.5, 0]\nup = [0, 1, 0]"),
            ("albedo = [0.7, 0.2, 0.2]\n", ""),
            ("box = { min = [-1, -1, -1], max = [1, 1, 1] }", "sphere = { center = [0, 0, 0], radius = 1 }"),
            (
                "box = { min = [-1, -1, -1], max = [1, 1, 1] }",
                "cylinder = { base = [0, 0, 0], top = [0, 1, 0], radius = 1 }",
            ),
            ("[camera]", "[animation]\nframes = 3\n[camera]"),
        ],
        &[
            ("schema_version = 1\n", ""),
            ("schema_version = 1", "schema_version = 2"),
            ("title = \"Scene\"", "titel = \"Scene\""),
            ("title = \"Scene\"", "title = 3"),
            ("eye = [3.0, 1.6, 4.0]", "eye = [3.0, 1.6, 4.0, 1.0]"),
            ("eye = [3.0, 1.6, 4.0]\n", ""),
            ("fov_y = 35.0", "fov_y = 180.0"),
            ("fov_y = 35.0", "fov_y = 0"),
            ("albedo = [0.7, 0.2, 0.2]", "albedo = [0.7, 1.2, 0.2]"),
            ("wrap = 0.5", "wrap = -0.1"),
            ("wrap = 0.5", "wrap = 0.5\nemission = [1, 1, -1]"),
            ("name = \"body\"\n", ""),
            ("receiver = true", "receiver = 1"),
            ("shape = { box = { min = [-1, -1, -1], max = [1, 1, 1] } }\n", ""),
            ("shape = { box", "mesh = \"a.ply\"\nshape = { box"),
            ("box = {", "cube = {"),
            ("max = [1, 1, 1] }", "max = [1, 1, 1] }, sphere = { center = [0, 0, 0], radius = 1 }"),
            ("box = { min = [-1, -1, -1], max = [1, 1, 1] }", "sphere = { center = [0, 0, 0], radius = 0 }"),
            ("scale = 2", "scale = [1, 2]"),
            ("rotate = [0, 90, 0]", "turn = [0, 90, 0]"),
            ("bounds = { min = [-1,-1,-1],", "bounds = {"),
            ("[camera]", "[animation]\nframes = 0\n[camera]"),
        ],
    );
}

const LAYOUT: &str = r#"
schema_version = 1
[[light]]
name = "key"
sphere = { center = [0, 2, 0], radius = 0.2, radiance = [12, 12, 12] }
[[light]]
disk = { center = [0, 2, 0], normal = [0, -2, 0], radius = 0.2, radiance = [1, 0, 0] }
[[light]]
point = { position = [0, 3, 0], intensity = [1, 1, 1] }
path = { points = [[0, 0, 0], [1, 0, 0]], spline = true }
[[light]]
directional = { towards = [0, 3, 0], irradiance = [1, 1, 1] }
[[light]]
constant = { radiance = [1, 1, 1] }
"#;

const FAMILY: &str = r#"
schema_version = 1
[random]
seed = 3
layouts = 50
lights = 4
kinds = ["sphere", "disk"]
distance = [1.0, 4.0]
size = [0.05, 0.3]
power = 10.0
"#;

#[test]
fn program_and_schema_agree_on_layouts() {
    let accepts = |text: &str| match Layout::of_source(&Source::inline("layout.toml", text)) {
        Ok(_) => Ok(()),
        Err(error) => Err(error.to_string()),
    };
    agree(
        &Layout::schema(),
        &accepts,
        LAYOUT,
        &[("name = \"key\"\n", ""), ("radiance = [12, 12, 12]", "radiance = [0, 0, 0.5]"), (", spline = true", "")],
        &[
            ("schema_version = 1", "schema_version = 1\nlamps = 2"),
            ("sphere = {", "shpere = {"),
            ("radius = 0.2", "radius = -0.2"),
            ("radius = 0.2", "radius = \"0.2\""),
            ("radius = 0.2, ", ""),
            ("radiance = [12, 12, 12]", "radiance = [12, -12, 12]"),
            ("radiance = [12, 12, 12]", "radiance = [12, 12]"),
            ("radiance = [12, 12, 12]", "radiance = 12"),
            ("point = { position", "constant = { radiance = [1, 1, 1] }\npoint = { position"),
            ("points = [[0, 0, 0], [1, 0, 0]]", "points = []"),
            ("points = [[0, 0, 0], [1, 0, 0]]", "points = [[0, 0], [1, 0]]"),
            ("constant = { radiance = [1, 1, 1] }", "name = \"none\""),
            (
                "[[light]]",
                "[random]\nlayouts = 1\nlights = 1\nkinds = [\"sphere\"]\ndistance = [0, 1]\nsize = [1, 1]\npower = 1\n[[light]]",
            ),
        ],
    );
    agree(
        &Layout::schema(),
        &accepts,
        FAMILY,
        &[
            ("power = 10.0", "power = [10, 20]"),
            ("seed = 3\n", ""),
            ("kinds = [\"sphere\", \"disk\"]", "kinds = [\"point\"]"),
        ],
        &[
            ("layouts = 50", "layouts = 0"),
            ("lights = 4\n", ""),
            ("kinds = [\"sphere\", \"disk\"]", "kinds = []"),
            ("kinds = [\"sphere\", \"disk\"]", "kinds = [\"sun\"]"),
            ("distance = [1.0, 4.0]", "distance = [1.0]"),
            ("distance = [1.0, 4.0]", "distance = [-1.0, 4.0]"),
            ("size = [0.05, 0.3]", "size = [0.0, 0.3]"),
            ("power = 10.0", "power = 0"),
        ],
    );
    // every shape has its line in the schema
    let schema = Layout::schema();
    let light = &schema["properties"]["light"]["items"]["properties"];
    for kind in rigbench::light::Light::KINDS {
        assert!(light.get(kind).is_some(), "{kind}");
    }
}

const EXPERIMENT: &str = include_str!("folder/everything.toml");

#[test]
fn program_and_schema_agree_on_experiments() {
    let project = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(project.path().join("scenes/lights")).unwrap();
    std::fs::write(project.path().join("scenes/car.toml"), SCENE).unwrap();
    std::fs::write(project.path().join("scenes/lights/lamp.toml"), LAYOUT).unwrap();
    let file = project.path().join("experiment.toml");
    let accepts = |text: &str| {
        std::fs::write(&file, text).unwrap();
        Experiment::load(&file).map(drop).map_err(|error| error.to_string())
    };
    agree(
        &Experiment::schema(),
        &accepts,
        EXPERIMENT,
        &[
            ("title = \"Everything\"\n", ""),
            ("[image]", "kind = \"sweep\"\n[image]"),
            ("mode = [\"shadows\", \"bounces=2\"]", "mode = \"auto\""),
            ("mode = [\"shadows\", \"bounces=2\"]", "mode = \"shadows,bounces=2\""),
            ("mode = [\"shadows\", \"bounces=2\"]", "mode = { shadows = true, bounces = \"inf\" }"),
            ("max = 0.5", "min = -0.5"),
            ("within = 1.25\n", ""),
            ("hann = { width = 4.0 }", "laplacian = { lambda = 0 }"),
            ("hann = { width = 4.0 }", "auto = { share = 1 }"),
            (
                "mixed = { x = { lattice = 3 }, y = \"constant\", z = \"gradient\" }",
                "mixed = { longest = { hermite = 2 }, middle = \"constant\", shortest = \"gradient\" }",
            ),
            ("centers = \"corners\"", "centers = [[0, 0, 0], [1, 1, 0.5]]"),
            ("centers = \"corners\"", "samples = [2, 2, 2]"),
            (", cull = 0.01, budget = 5000", ""),
            ("bounds = { min = [-2, 0, -1], max = [2, 2.5, 1] }", "bounds = \"room\""),
            ("any = [{ harmonic", "any = [{ gradient = { threshold = 1 } }, { harmonic"),
            (
                "[heuristic.either]\nany = [",
                "[heuristic.other]\nerror = { threshold = 0.1 }\n[heuristic.either]\nany = [",
            ),
            ("captured = { face = 8 }", "relit = { face = 8, iterations = 2 }"),
            ("traced = { spp = 64 }", "traced = { spp = 64, on = \"gpu\" }"),
        ],
        &[
            ("schema_version = 1", "schema_version = 0"),
            ("name = \"all\"", "name = \"a b\""),
            ("seed = 3", "seed = -3"),
            ("seed = 3", "sed = 3"),
            ("[image]", "kind = \"swep\"\n[image]"),
            ("width = 64", "width = 0"),
            ("width = 64", "width = 64.5"),
            ("keep = \"all\"", "keep = \"some\""),
            ("scene = [\"car\"]\n", ""),
            ("scene = [\"car\"]", "scene = \"car\""),
            ("scene = [\"car\"]", "scene = []"),
            ("scene = [\"car\"]", "scene = [1]"),
            ("order = [2, 3]", "order = [0, 3]"),
            ("order = [2, 3]", "order = [\"3\"]"),
            ("backend = [\"cpu\", \"gpu\"]", "backend = [\"cpu\", \"tpu\"]"),
            ("storage = [\"buffer\"]", "storage = [\"disk\"]"),
            ("precision = [\"f32\"]", "precisoin = [\"f32\"]"),
            ("heuristic = [\"error\", \"either\"]", "heuristic = [3]"),
            ("constant = {}\n", ""),
            ("constant = {}\n", "constant = {}\ngradient = {}\n"),
            ("constant = {}\n", "constant = { order = 3 }\n"),
            ("freeze_frame = 0", "freeze_frame = -1"),
            ("samples = [3, 2, 2]", "samples = [3, 2]"),
            ("samples = [3, 2, 2]", "samples = [3, 0, 2]"),
            ("interpolation = \"nearest\"", "interpolation = \"nearst\""),
            ("power = 2.0", "power = 0"),
            ("axes = \"longest_first\"", "axes = \"zyx\""),
            ("x = { lattice = 3 }", "x = { lattice = 3, hermite = 2 }"),
            ("x = { lattice = 3 }", "longest = { lattice = 3 }"),
            ("y = \"constant\"", "y = \"constnt\""),
            ("centers = \"corners\"", "centers = \"edges\""),
            ("centers = \"corners\"", "centers = [[0, 0, 2]]"),
            ("kernel = \"gaussian\"", "kernel = \"gauss\""),
            ("inverse_distance = { power = 3.0 }", "inverse_distance = { power = 0.0 }"),
            ("inverse_distance = { power = 3.0 }", "inverse = { power = 3.0 }"),
            ("central = { step = 0.01 }", "central = { step = 0.0 }"),
            ("central = { step = 0.01 }", "central = {}"),
            ("hann = { width = 4.0 }", "hann = { width = 0 }"),
            ("hann = { width = 4.0 }", "hann = { width = 4.0 }\nauto = { share = 0.5 }"),
            ("hann = { width = 4.0 }", "auto = { share = 1.5 }"),
            ("rig = [\"direct\", \"constant\"]\nbackend", "rig = []\nbackend"),
            ("order = 5", "ordr = 5"),
            ("mode = [\"shadows\", \"bounces=2\"]", "mode = []"),
            ("mode = [\"shadows\", \"bounces=2\"]", "mode = 3"),
            ("mode = [\"shadows\", \"bounces=2\"]", "mode = { bounces = -1 }"),
            ("mode = [\"shadows\", \"bounces=2\"]", "mod = \"auto\""),
            ("repeat = 1", "repeat = 0"),
            ("metric = \"nrmse\"", "metric = \"status\""),
            ("max = 0.5\n", ""),
            ("where = { rig", "were = { rig"),
            ("against = [\"lattice\"]", "against = []"),
            ("within = 1.25", "within = 0"),
            ("points = 100", "points = 0"),
            ("seconds = 1", "seconds = 0"),
            ("bounds = \"room\", ", ""),
            ("bounds = \"room\"", "bounds = 3"),
            ("roots = [1, 2, 1]", "roots = [1, 2]"),
            ("roots = [1, 2, 1]", "roots = [1, 0, 1]"),
            ("min_level = 1", "min_level = -1"),
            ("max_level = 2", "max_level = 13"),
            ("max_level = 2", "max_level = 2.5"),
            ("across = \"naive\"", "across = \"naiv\""),
            ("cull = 0.01", "cull = 0"),
            ("budget = 5000", "budget = 7"),
            ("budget = 5000", "buget = 5000"),
            ("max = [2, 2.5, 1] }", "max = [2, 2.5] }"),
            ("max = [2, 2.5, 1] }", "max = [2, 2.5, 1], centre = [0, 0, 0] }"),
            ("samples = [3, 3, 4]", "samples = [3, 3]"),
            ("inner = 2", "inner = 1"),
            ("repair = true", "repair = 1"),
            ("lookup = \"per_object\"", "lookup = \"per_objekt\""),
            ("smoothing = 0.25", "smoothing = 1.5"),
            ("path = { samples = 7 }", "path = { samples = 0 }"),
            ("path = { samples = 7 }", "path = { samples = 7 }\nconstant = {}"),
            ("threshold = 0.5, minimum", "threshold = 0, minimum"),
            ("minimum = false", "minimum = 0"),
            ("from = \"depth\"", "from = \"depths\""),
            ("{ prune = { threshold = 0.2 } }", "{ prune = {} }"),
            ("{ prune = { threshold = 0.2 } }", "{ prune = { threshold = 0.2 }, error = { threshold = 0.2 } }"),
            ("{ prune = { threshold = 0.2 } }", "{}"),
            ("traced = { spp = 64 }", "traced = { spp = 0 }"),
            ("captured = { face = 8 }", "captured = { face = 0 }"),
            ("captured = { face = 8 }", "captured = { face = 8, on = \"tpu\" }"),
        ],
    );
}

/// The files that editors read (`#:schema ../schemas/experiment.json`). After a change: `rigbench schema KIND > schemas/KIND.json`.
#[test]
fn checked_in_schemas_are_current() {
    for (kind, schema) in [
        ("experiment", Experiment::schema()),
        ("hard-cases", HardCases::schema()),
        ("scene", Scene::schema()),
        ("lights", Layout::schema()),
    ] {
        let path = root().join(format!("schemas/{kind}.json"));
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            text == format!("{schema:#}\n"),
            "schemas/{kind}.json is old: rigbench schema {kind} > schemas/{kind}.json"
        );
        let output = assert_cmd::Command::cargo_bin("rigbench").unwrap().args(["schema", kind]).output().unwrap();
        assert_eq!(String::from_utf8(output.stdout).unwrap(), text);
    }
    let output = assert_cmd::Command::cargo_bin("rigbench").unwrap().arg("schema").output().unwrap();
    let all: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        all,
        json!({
            "experiment": Experiment::schema(),
            "hard-cases": HardCases::schema(),
            "scene": Scene::schema(),
            "lights": Layout::schema(),
        })
    );
}
