//! The gate over volumes, whose references and samples are drawn at random: what was drawn as before is held to its digits, what was drawn
//! anew by its noise.

use std::path::Path;

use rigbench::experiment::{Experiment, Key};
use rigbench::run::ArrayCache;
use serde_json::{Value, json};

use super::folder::write;
use super::volumes::project;
use super::{done, rigbench, rigbench_does};

const FILE: &str = "experiments/gated.toml";
const SCENE: &str = "scenes/rooms.toml";
const LIGHTS: &str = "scenes/lights/left.toml";

/// Two volumes over two rooms: one whose weights are straight lines, one that keeps the rooms apart.
fn gated() -> tempfile::TempDir {
    let folder = project();
    write(
        folder.path(),
        FILE,
        "schema_version = 1\nname = \"gated\"\nseed = 1\n[image]\nwidth = 32\nheight = 18\nkeep = \"none\"\n\
         [timing]\nwarmup = 0\nrepeat = 1\nonly = { rig = \"apart\" }\n[reference]\npoints = 24\nrelative_error = 0.05\nseconds = 600\n\
         [effects]\nmode = \"shadows\"\n[matrix]\nscene = [\"rooms\"]\nlights = [\"left\"]\nrig = [\"straight\", \"apart\", \"tree\"]\n\
         heuristic = [\"fine\"]\nprobe_source = [\"fixed\"]\n[probe_source.fixed]\ntraced = { spp = 64 }\n\
         [rig.straight]\ngrid = { bounds = \"volume\", samples = [2, 1, 1] }\n\
         [rig.apart]\ngrid = { bounds = \"volume\", samples = [2, 1, 1], interpolation = \"nearest\" }\n\
         [rig.tree]\noctree = { bounds = \"volume\", min_level = 1, max_level = 2 }\n[heuristic.fine]\nerror = { threshold = 0.2 }\n",
    );
    folder
}

fn run(at: &Path, out: &str) {
    let (exit, _, log) = rigbench_does(at, &["run", FILE, "--out", out, "--no-figures", "--no-report"]);
    assert_eq!(exit, 0, "{log}");
}

fn results(at: &Path, out: &str) -> Value {
    serde_json::from_slice(&std::fs::read(at.join(out).join("results.json")).unwrap()).unwrap()
}

/// Where the truth of the experiment as it is now is kept.
fn truth(at: &Path) -> (ArrayCache, Key) {
    let experiment = Experiment::load(&at.join(FILE)).unwrap();
    (ArrayCache::at(&experiment.cache_folder()), experiment.candidates[0].reference_key(&json!({ "frame": 0 })))
}

/// Runs the experiment with one word of a file changed, in a folder of its own, as if that were a slip in the program: truth and keys stay.
fn slipped(at: &Path, out: &str, file: &str, from: &str, to: &str) {
    let (cache, key) = truth(at);
    let kept = cache.load(&key).expect("the truth was found before");
    let whole = std::fs::read_to_string(at.join(file)).unwrap();
    assert!(whole.contains(from), "{file}: {whole}");
    std::fs::write(at.join(file), whole.replace(from, to)).unwrap();
    cache.store(&truth(at).1, &kept).unwrap();
    run(at, out);
    std::fs::write(at.join(file), whole).unwrap();
    let (good, mut bad) = (results(at, "good"), results(at, out));
    for row in bad["rows"].as_array_mut().unwrap() {
        let of_rig = |other: &&Value| other["rig"] == row["rig"];
        row["run"] = good["rows"].as_array().unwrap().iter().find(of_rig).unwrap()["run"].clone();
    }
    std::fs::write(at.join(out).join("results.json"), bad.to_string()).unwrap();
}

#[test]
fn slips_in_volumes_are_seen_and_another_seed_is_none() {
    let folder = gated();
    let at = folder.path();
    let check = |out: &str, more: &[&str]| done(rigbench(at).args(["check", out, "--experiment", FILE]).args(more));
    run(at, "good");
    assert!(results(at, "good")["rows"][0]["ref_noise"].as_f64().unwrap() > 0.0, "rays were cast");
    assert_eq!(check("good", &["--accept", "--reason", "first"]).0, 0);

    // drawn once more as it was: the same digits
    run(at, "again");
    let (exit, out, _) = check("again", &[]);
    assert!(exit == 0 && !out.contains("not compared: quality") && !out.contains("noise:"), "{exit}: {out}");
    let compare = |out: &str| rigbench_does(at, &["compare", "good", out]).1;
    let same = compare("again");
    assert!(!["worse", "better", "changed"].iter().any(|word| same.contains(word)), "{same}");

    // what lies beside the runs comes along into a merge
    let (exit, _, log) = rigbench_does(at, &["merge", "merged", "good", "--no-figures", "--no-report"]);
    assert_eq!(exit, 0, "{log}");
    let cuts = |out: &str| {
        let mut names: Vec<_> =
            std::fs::read_dir(at.join(out).join("volumes")).unwrap().map(|f| f.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert!(!cuts("good").is_empty() && cuts("merged") == cuts("good"));

    // slips of one part in fifty, a hundred, a sample
    for (out, (file, from, to), rig, metric) in [
        (
            "weight",
            (SCENE, "min = [-1, -1, -1], max = [1, 1, 1]", "min = [-1.02, -1, -1], max = [1.02, 1, 1]"),
            "straight",
            "nrmse",
        ),
        ("source", (LIGHTS, "radiance = [1, 2, 3]", "radiance = [1.01, 2.02, 3.03]"), "straight", "bias"),
        (
            "leaked",
            (SCENE, "min = [-1, -1, -1], max = [1, 1, 1]", "min = [-1, -1, -1], max = [-0.1, 1, 1]"),
            "apart",
            "leak",
        ),
        ("count", (FILE, "samples = [2, 1, 1] }", "samples = [3, 1, 1] }"), "straight", "samples"),
    ] {
        slipped(at, out, file, from, to);
        let (exit, said, _) = check(out, &[]);
        assert_eq!(exit, 101, "{out}: {said}");
        let failed = |line: &str| line.starts_with(&format!("FAILED: quality: {metric} ")) && line.contains(rig);
        assert!(said.lines().any(failed), "{out}: {said}");
        // `2` samples that become `3` are said as they are
        assert!(out != "count" || said.contains("FAILED: quality: samples 3.0"), "{said}");
        let table = compare(out);
        let told = |line: &str| {
            line.contains(rig) && line.contains(metric) && (line.contains("worse") || line.contains("changed"))
        };
        assert!(table.lines().any(told), "{out}: {table}");
    }
    // one run's slip is no other's
    let (_, said, _) = check("count", &[]);
    assert!(!said.lines().any(|line| line.starts_with("FAILED") && line.contains("apart")), "{said}");

    // another seed draws anew: no regression; what the reference's noise does not explain has no baseline, until it is accepted
    let whole = std::fs::read_to_string(at.join(FILE)).unwrap();
    write(at, FILE, &whole.replace("seed = 1", "seed = 2"));
    run(at, "other");
    let (exit, said, _) = check("other", &[]);
    assert!([0, 102].contains(&exit) && !said.contains("FAILED"), "{exit}: {said}");
    assert_eq!(exit == 102, said.contains("no baseline: quality"), "{said}");
    assert!(said.contains("(noise: |z| under"), "{said}");
    let table = compare("other");
    assert!(table.contains("drawn anew") && !["worse", "better"].iter().any(|word| table.contains(word)), "{table}");
    // values of two draws are no baseline together
    assert_eq!(check("other", &["--strict", "--accept", "--reason", "another seed"]).0, 0);
    let (exit, said, _) = check("other", &["--strict"]);
    assert_eq!(exit, 0, "{said}");
}
