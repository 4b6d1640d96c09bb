//! results/gallery is what its manifest says, byte for byte. After a change that is meant: `RIGBENCH_BLESS=1 cargo test --test gallery`;
//! a figure from a run comes in with `rigbench figures DIR --keep NAME`.

use std::path::{Path, PathBuf};

use rigbench::figure::gallery::{REFRESH, complaints, keep, manifest, refresh};
use rigbench::figure::{FORMS, TABULAR};

fn gallery() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("results/gallery")
}

#[test]
fn every_byte_of_the_gallery_is_the_committed_one() {
    if std::env::var_os("RIGBENCH_BLESS").is_some() {
        refresh(&gallery()).unwrap();
    }
    let found = complaints(&gallery()).unwrap();
    assert!(found.is_empty(), "{}\nif this is meant: {REFRESH}", found.join("\n"));
    let manifest = manifest(&gallery()).unwrap();
    assert!(manifest.len() >= 5);
    // a figure is there in every form; what was never drawn is a table alone
    for (name, entry) in &manifest {
        let forms: Vec<&str> = entry.files.keys().map(String::as_str).filter(|form| *form != TABULAR).collect();
        assert!(forms == FORMS || forms == ["csv"], "{name}: {forms:?}");
    }
}

#[test]
fn one_changed_byte_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path();
    for file in std::fs::read_dir(gallery()).unwrap() {
        let path = file.unwrap().path();
        std::fs::copy(&path, copy.join(path.file_name().unwrap())).unwrap();
    }
    let before = complaints(copy).unwrap();
    let (name, entry) = manifest(copy).unwrap().into_iter().next().unwrap();
    for extension in entry.files.keys() {
        let path = copy.join(format!("{name}.{extension}"));
        let whole = std::fs::read(&path).unwrap();
        let mut changed = whole.clone();
        *changed.last_mut().unwrap() ^= 1;
        std::fs::write(&path, changed).unwrap();
        let after = complaints(copy).unwrap();
        assert_eq!(after.len(), before.len() + 1, "{after:?}");
        assert!(after.iter().any(|c| c.starts_with(&format!("{name}.{extension}: changed"))), "{after:?}");
        std::fs::remove_file(&path).unwrap();
        assert!(complaints(copy).unwrap().contains(&format!("{name}.{extension}: missing")));
        std::fs::write(&path, whole).unwrap();
    }
    // a file that nobody entered, and a figure without its data
    std::fs::write(copy.join("stray.png"), b"x").unwrap();
    assert!(complaints(copy).unwrap().contains(&"stray.png: not in manifest.json".to_owned()));
    refresh(copy).unwrap();
    assert_eq!(complaints(copy).unwrap(), ["stray: no CSV of what it was drawn from"]);
    // taken from a folder of figures, with its command
    std::fs::remove_file(copy.join("stray.png")).unwrap();
    let figures = folder.path().join("figures");
    std::fs::create_dir(&figures).unwrap();
    std::fs::write(figures.join("new.csv"), "a\n1\n").unwrap();
    std::fs::write(figures.join("new.png"), "picture").unwrap();
    let target = folder.path().join("gallery");
    let why = keep(&figures, "new", &target, "").unwrap_err().to_string();
    assert!(why.contains("new.svg"), "a figure comes in all its forms: {why}");
    std::fs::write(figures.join("new.svg"), "<svg/>").unwrap();
    std::fs::write(figures.join("new.tex"), "a & b").unwrap();
    keep(&figures, "new", &target, "rigbench run x.toml").unwrap();
    assert_eq!(complaints(&target).unwrap(), [""; 0]);
    refresh(&target).unwrap();
    let manifest = manifest(&target).unwrap();
    assert_eq!(manifest["new"].command, "rigbench run x.toml");
    assert_eq!(manifest["new"].files.keys().collect::<Vec<_>>(), ["csv", "png", "svg", "tex"]);
    assert!(keep(&figures, "absent", &target, "").is_err());
}
