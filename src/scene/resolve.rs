//! Which file a word means (design 6.3, "Paths").

use std::path::{Path, PathBuf};

use crate::input::{InputError, nearest_word, unknown_word_message};

/// The file of a scene: a word with `/` or ending in `.toml` is a path relative to `from` (the folder of the file that
/// says it; empty: the current folder), any other a name under ROOT/scenes.
pub fn resolve_scene(word: &str, from: &Path) -> Result<PathBuf, InputError> {
    resolve("scene", Path::new("scenes"), word, from)
}

/// The file of a light layout: as [`resolve_scene`], with names under ROOT/scenes/lights.
pub fn resolve_layout(word: &str, from: &Path) -> Result<PathBuf, InputError> {
    resolve("light layout", &Path::new("scenes").join("lights"), word, from)
}

fn resolve(what: &str, folder: &Path, word: &str, from: &Path) -> Result<PathBuf, InputError> {
    if word.contains('/') || word.ends_with(".toml") {
        let path = from.join(word);
        return match path.is_file() {
            true => Ok(path),
            false => {
                let error = InputError::of_file(&path, format!("there is no such {what} file"));
                Err(with_nearest(
                    error,
                    &stem(Path::new(word)),
                    &names(path.parent().unwrap_or(Path::new(""))),
                    |near| Path::new(word).with_file_name(format!("{near}.toml")).display().to_string(),
                ))
            }
        };
    }
    let Some(root) = root(from) else {
        let error = InputError::of_file(from, format!("{what} `{word}`: no folder from here upwards holds `scenes/`"));
        return Err(error.with_help("give the file's path, with a `/` or its `.toml`"));
    };
    let path = root.join(folder).join(format!("{word}.toml"));
    if !word.is_empty() && path.is_file() {
        return Ok(path);
    }
    let known = names(&root.join(folder));
    let list: Vec<&str> = known.iter().map(String::as_str).collect();
    let error = InputError::of_file(&root.join(folder), unknown_word_message(what, word, &list));
    Err(with_nearest(error, word, &known, str::to_owned))
}

/// The nearest folder from `from` upwards that holds `scenes/`.
pub fn root(from: &Path) -> Option<PathBuf> {
    let here = if from.as_os_str().is_empty() { Path::new(".") } else { from };
    let absolute = std::path::absolute(here).ok()?;
    absolute.ancestors().find(|folder| folder.join("scenes").is_dir()).map(Path::to_owned)
}

/// Names of the TOML files in a folder, without their endings, sorted.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        .map(|path| stem(&path))
        .collect();
    names.sort();
    names
}

fn stem(path: &Path) -> String {
    super::file::stem(path)
}

fn with_nearest(error: InputError, word: &str, known: &[String], written: impl Fn(&str) -> String) -> InputError {
    match nearest_word(word, known.iter().map(String::as_str)) {
        Some(near) => error.with_help(format!("did you mean `{}`?", written(near))),
        None => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_names_under_the_root_or_paths_beside_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        std::fs::create_dir_all(root.join("scenes/lights")).unwrap();
        std::fs::create_dir_all(root.join("experiments/old")).unwrap();
        for file in ["scenes/car.toml", "scenes/lights/lamps.toml", "experiments/old/own.toml"] {
            std::fs::write(root.join(file), "").unwrap();
        }
        let from = root.join("experiments/old");
        assert_eq!(resolve_scene("car", &from).unwrap(), root.join("scenes/car.toml"));
        assert_eq!(resolve_layout("lamps", &from).unwrap(), root.join("scenes/lights/lamps.toml"));
        assert_eq!(resolve_scene("own.toml", &from).unwrap(), from.join("own.toml"));
        assert_eq!(resolve_scene("../../scenes/car.toml", &from).unwrap(), from.join("../../scenes/car.toml"));

        let error = resolve_layout("lamp", &from).unwrap_err();
        assert!(error.message.contains("`lamps`") && error.help.unwrap().contains("`lamps`"));
        let error = resolve_scene("../owns.toml", &root.join("experiments/old/deeper")).unwrap_err();
        assert_eq!(error.help, None, "the folder is not there");
        let error = resolve_scene("./owns.toml", &from).unwrap_err();
        assert_eq!(error.help.as_deref(), Some("did you mean `./own.toml`?"));
        assert!(resolve_scene("", &from).is_err());
        // a layout is no scene
        assert!(resolve_scene("lamps", &from).is_err());
        // nothing above a bare root holds scenes
        assert!(resolve_scene("car", Path::new("/")).unwrap_err().help.is_some());
    }
}
