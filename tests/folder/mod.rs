//! A folder that a test fills with scenes, layouts and experiments.

use std::path::Path;

/// Writes a file at `name` under `folder`, with the folders on the way.
pub fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().expect("a file's name")).expect("folders can be made");
    std::fs::write(path, text).expect("the file can be written");
}
