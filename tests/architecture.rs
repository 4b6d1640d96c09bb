//! The one arrow: a module uses only modules that stand before it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The order of the rooms: knowledge, catalogue, flow.
const ORDER: &[&str] = &[
    "math",
    "output",
    "picture",
    "input",
    "sh",
    "light",
    "scene",
    "trace",
    "probe", // knowledge
    "rig",
    "volume",
    "metric",
    "cost", // catalogue
    "experiment",
    "gpu",
    "reference",
    "candidate",
    "stability",
    "run",
    "figure",
    "gate",
    "report",
    "cli", // flow
];

/// Two rooms that never meet, although the order would let them: the judge and the judged.
const NEVER: &[(&str, &str)] = &[("candidate", "reference"), ("reference", "rig")];

fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, files);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
}

/// Names after `crate::` in a text, comments left out.
fn used_modules(text: &str) -> Vec<String> {
    let mut used = Vec::new();
    for line in text.lines().map(str::trim_start).filter(|line| !line.starts_with("//")) {
        for rest in line.split("crate::").skip(1) {
            let names = match rest.strip_prefix('{') {
                Some(list) => list.split(['}', ',']).map(str::trim).collect::<Vec<_>>(),
                None => vec![rest],
            };
            for name in names {
                used.push(name.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect());
            }
        }
    }
    used
}

/// Every use of a room that stands later, or that must never be met.
fn violations(files: &BTreeMap<String, Vec<(String, String)>>) -> Vec<String> {
    let rank = |name: &str| ORDER.iter().position(|m| *m == name);
    let mut found = Vec::new();
    for (module, texts) in files {
        let Some(own) = rank(module) else {
            found.push(format!("`{module}` has no place in the order"));
            continue;
        };
        for (file, text) in texts {
            for used in used_modules(text) {
                if rank(&used).is_some_and(|other| other > own) || NEVER.contains(&(module.as_str(), used.as_str())) {
                    found.push(format!("{file}: `{module}` uses `{used}`"));
                }
            }
        }
    }
    found
}

fn crate_files() -> BTreeMap<String, Vec<(String, String)>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    rust_files(&root, &mut paths);
    let mut files: BTreeMap<String, Vec<(String, String)>> = BTreeMap::new();
    for path in paths {
        let relative = path.strip_prefix(&root).unwrap();
        let first = relative.components().next().unwrap().as_os_str().to_string_lossy().replace(".rs", "");
        if first != "lib" && first != "main" {
            let text = std::fs::read_to_string(&path).unwrap();
            files.entry(first).or_default().push((relative.display().to_string(), text));
        }
    }
    files
}

#[test]
fn modules_use_only_modules_before_them() {
    let files = crate_files();
    assert!(files.len() >= 8, "the modules were not found: {:?}", files.keys());
    let found = violations(&files);
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

#[test]
fn a_use_against_the_arrow_is_seen() {
    let planted = |module: &str, text: &str| {
        violations(&BTreeMap::from([(module.to_owned(), vec![("planted.rs".to_owned(), text.to_owned())])])).len()
    };
    assert_eq!(planted("reference", "use crate::light::Light;"), 0);
    assert_eq!(planted("reference", "use crate::rig::Rig;"), 1);
    assert_eq!(planted("light", "use crate::{math::Real, rig::Rig};"), 1);
    assert_eq!(planted("rig", "fn f() { crate::figure::draw() }"), 1);
    assert_eq!(planted("candidate", "use crate::reference::exact;"), 1);
    assert_eq!(planted("attic", ""), 1);
}
