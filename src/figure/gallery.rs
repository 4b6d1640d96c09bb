//! The committed set of figures, results/gallery: every file with its hash in manifest.json, so that one changed byte shows.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use super::{FORMS, TABULAR};
use crate::output::write_whole;

/// What the manifest says of one figure.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Entry {
    /// The command that makes it again; empty where nobody said.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub command: String,
    /// blake3 of each file, by extension. Every figure has a `csv`: what it was drawn from.
    pub files: BTreeMap<String, String>,
}

/// Figures by name.
pub type Manifest = BTreeMap<String, Entry>;

const MANIFEST: &str = "manifest.json";
/// How to bring the manifest up to date, for messages.
pub const REFRESH: &str = "RIGBENCH_BLESS=1 cargo test --test gallery";

pub fn manifest(gallery: &Path) -> io::Result<Manifest> {
    let path = gallery.join(MANIFEST);
    match std::fs::read(&path) {
        Ok(bytes) => serde_json::from_slice(&bytes)
            .map_err(|e| io::Error::new(io::ErrorKind::InvalidData, format!("{}: {e}", path.display()))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Manifest::new()),
        Err(error) => Err(error),
    }
}

/// The files of a gallery as they are, without commands.
fn found(gallery: &Path) -> io::Result<Manifest> {
    let mut found = Manifest::new();
    for file in std::fs::read_dir(gallery)? {
        let path = file?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name == MANIFEST {
            continue;
        }
        // a name may hold dots; the extension is what follows the last
        let (stem, extension) = name.rsplit_once('.').unwrap_or((&name, ""));
        let hash = blake3::hash(&std::fs::read(&path)?).to_hex().to_string();
        found.entry(stem.to_owned()).or_default().files.insert(extension.to_owned(), hash);
    }
    Ok(found)
}

/// Everything in which a gallery is not what its manifest says; empty where all is well.
pub fn complaints(gallery: &Path) -> io::Result<Vec<String>> {
    let (said, found) = (manifest(gallery)?, found(gallery)?);
    let mut complaints = Vec::new();
    for (name, entry) in &said {
        if !entry.files.contains_key("csv") {
            complaints.push(format!("{name}: no CSV of what it was drawn from"));
        }
        for (extension, hash) in &entry.files {
            match found.get(name).and_then(|f| f.files.get(extension)) {
                None => complaints.push(format!("{name}.{extension}: missing")),
                Some(other) if other != hash => {
                    let again = if entry.command.is_empty() { String::new() } else { format!(" ({})", entry.command) };
                    complaints.push(format!("{name}.{extension}: changed{again}"));
                }
                Some(_) => {}
            }
        }
    }
    for (name, entry) in &found {
        for extension in entry.files.keys() {
            if said.get(name).is_none_or(|s| !s.files.contains_key(extension)) {
                complaints.push(format!("{name}.{extension}: not in {MANIFEST}"));
            }
        }
    }
    Ok(complaints)
}

/// Writes the manifest anew from the files that are there; commands stay.
pub fn refresh(gallery: &Path) -> io::Result<Manifest> {
    let before = manifest(gallery)?;
    let mut now = found(gallery)?;
    for (name, entry) in &mut now {
        entry.command = before.get(name).map(|b| b.command.clone()).unwrap_or_default();
    }
    write(gallery, &now)?;
    Ok(now)
}

fn write(gallery: &Path, manifest: &Manifest) -> io::Result<()> {
    let mut bytes = serde_json::to_vec_pretty(manifest).expect("a manifest is plain JSON");
    bytes.push(b'\n');
    write_whole(&gallery.join(MANIFEST), &bytes)
}

/// Takes a figure from a folder into the gallery: its CSV, PNG and SVG, of a table its LaTeX, and the command that makes it.
pub fn keep(figures: &Path, name: &str, gallery: &Path, command: &str) -> io::Result<()> {
    for extension in FORMS.iter().chain([&TABULAR]) {
        let source = figures.join(format!("{name}.{extension}"));
        let target = gallery.join(format!("{name}.{extension}"));
        match std::fs::read(&source) {
            Ok(bytes) => write_whole(&target, &bytes)?,
            Err(error) if error.kind() == io::ErrorKind::NotFound && *extension == TABULAR => {}
            Err(error) => return Err(io::Error::new(error.kind(), format!("{}: {error}", source.display()))),
        }
    }
    let mut manifest = refresh(gallery)?;
    manifest.entry(name.to_owned()).or_default().command = command.to_owned();
    write(gallery, &manifest)
}
