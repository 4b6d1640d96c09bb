//! Reading input files: TOML with positions, errors that name the place and the nearest right word.
//!
//! Every mistake in an input is an [`InputError`]: file, line, column, what was found, what is allowed. The command line
//! prints it and exits with 3. Parsing goes in two stages: serde for shape and types, then checks of values on
//! [`Spanned`] fields, so that the second stage points at its place too.

pub mod schema;

use std::fmt;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::{DeserializeOwned, Error as _};
pub use toml::Spanned;

/// A mistake in an input file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct InputError {
    pub path: PathBuf,
    /// One-based line and column, where the file is text and the place is known.
    pub place: Option<(usize, usize)>,
    /// What was found and what is allowed.
    pub message: String,
    /// The nearest right word, or how to mend it.
    pub help: Option<String>,
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if let Some((line, column)) = self.place {
            write!(f, ":{line}:{column}")?;
        }
        write!(f, ": {}", self.message)?;
        if let Some(help) = &self.help {
            write!(f, "\n  help: {help}")?;
        }
        Ok(())
    }
}

impl InputError {
    /// A mistake of a whole file (missing, not readable, not of its format).
    pub fn of_file(path: &Path, message: impl Into<String>) -> Self {
        Self { path: path.to_owned(), place: None, message: message.into(), help: None }
    }

    pub fn with_help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// The largest TOML file that is read, bytes.
const LARGEST_FILE: u64 = 16 << 20;

/// A text file that has been read, for parsing and for pointing at places in it.
#[derive(Debug, Clone)]
pub struct Source {
    pub path: PathBuf,
    pub text: String,
}

/// A file's bytes, at most so many: a device or a pipe has no length that could be looked at before.
pub fn read_bounded(path: &Path, most: u64, what: &str) -> Result<Vec<u8>, InputError> {
    let unreadable = |e: std::io::Error| InputError::of_file(path, format!("cannot be read: {e}"));
    let mut bytes = Vec::new();
    std::fs::File::open(path).map_err(unreadable)?.take(most + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    match bytes.len() as u64 > most {
        true => Err(InputError::of_file(path, format!("{what} has at most {most} bytes; this one is larger"))),
        false => Ok(bytes),
    }
}

impl Source {
    /// Reads a UTF-8 file.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let bytes = read_bounded(path, LARGEST_FILE, "a TOML file")?;
        let text = String::from_utf8(bytes).map_err(|e| {
            InputError::of_file(path, format!("not UTF-8 text (byte {})", e.utf8_error().valid_up_to()))
        })?;
        Ok(Self { path: path.to_owned(), text })
    }

    /// A source that is no file: an inline table of the command line.
    pub fn inline(name: &str, text: &str) -> Self {
        Self { path: PathBuf::from(name), text: text.to_owned() }
    }

    /// The folder against which relative paths in this file resolve.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// Parses the whole file; syntax, unknown keys and wrong types become errors with their place.
    pub fn parse<V: DeserializeOwned>(&self) -> Result<V, InputError> {
        toml::from_str(&self.text).map_err(|e| self.toml_error(&e))
    }

    /// What the TOML reader or serde found wrong in this file, with its place and the nearest right word.
    pub fn toml_error(&self, error: &toml::de::Error) -> InputError {
        InputError {
            path: self.path.clone(),
            place: error.span().map(|s| self.line_column(s.start)),
            message: plain_types(&error.message().replace('\n', " ")),
            help: nearest_of_message(error.message()),
        }
    }

    /// An error at a place of this file, as spanned values give it.
    pub fn error(&self, span: Range<usize>, message: impl Into<String>) -> InputError {
        InputError {
            path: self.path.clone(),
            place: Some(self.line_column(span.start)),
            message: message.into(),
            help: None,
        }
    }

    /// An unknown word where one of `allowed` must stand.
    pub fn unknown_word<'a>(
        &self,
        span: Range<usize>,
        what: &str,
        word: &str,
        allowed: impl IntoIterator<Item = &'a str>,
    ) -> InputError {
        let allowed: Vec<&str> = allowed.into_iter().collect();
        let error = self.error(span, unknown_word_message(what, word, &allowed));
        match nearest_word(word, allowed.iter().copied()) {
            Some(near) => error.with_help(format!("did you mean `{near}`?")),
            None => error,
        }
    }

    fn line_column(&self, offset: usize) -> (usize, usize) {
        let offset = offset.min(self.text.len());
        let before = &self.text.as_bytes()[..offset];
        let line = before.iter().filter(|b| **b == b'\n').count() + 1;
        let start = before.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
        (line, String::from_utf8_lossy(&before[start..]).chars().count() + 1)
    }
}

/// Serde names Rust's types; a user knows numbers.
fn plain_types(message: &str) -> String {
    let whole = ["i64", "i32", "u64", "u32", "u8", "usize"]
        .iter()
        .fold(message.to_owned(), |text, name| text.replace(&format!("expected {name}"), "expected a whole number"));
    whole.replace("expected f64", "expected a number")
}

/// "unknown X `word`, allowed: ..."
pub fn unknown_word_message(what: &str, word: &str, allowed: &[&str]) -> String {
    let list: Vec<String> = allowed.iter().map(|a| format!("`{a}`")).collect();
    match list.is_empty() {
        true => format!("unknown {what} `{word}`; none is defined"),
        false => format!("unknown {what} `{word}`; allowed: {}", list.join(", ")),
    }
}

/// The allowed word that is nearest to a mistyped one, if any is near: Jaro-Winkler similarity above 0.7, or one letter away
/// (short words are less alike than they look).
pub fn nearest_word<'a>(word: &str, allowed: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let word = word.to_lowercase();
    allowed
        .into_iter()
        .map(|candidate| {
            let other = candidate.to_lowercase();
            let one_letter = strsim::osa_distance(&word, &other) <= 1 && word.chars().count() > 1;
            (one_letter, strsim::jaro_winkler(&word, &other), candidate)
        })
        .filter(|(one_letter, similarity, _)| *one_letter || *similarity > 0.7)
        .max_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))
        .map(|(_, _, candidate)| candidate)
}

/// The nearest right word of a serde message "unknown field `x`, expected one of `a`, `b`".
fn nearest_of_message(message: &str) -> Option<String> {
    let mut quoted = message.split('`').skip(1).step_by(2);
    if !(message.starts_with("unknown field") || message.starts_with("unknown variant")) {
        return None;
    }
    let word = quoted.next()?;
    nearest_word(word, quoted).map(|near| format!("did you mean `{near}`?"))
}

/// A finite number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finite(pub f64);

impl<'de> Deserialize<'de> for Finite {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let value = f64::deserialize(deserializer)?;
        if value.is_finite() { Ok(Self(value)) } else { Err(D::Error::custom(format!("{value} is no finite number"))) }
    }
}

/// Exactly three finite numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finite3(pub [f64; 3]);

impl<'de> Deserialize<'de> for Finite3 {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let values = Vec::<Finite>::deserialize(deserializer)?;
        match values[..] {
            [x, y, z] => Ok(Self([x.0, y.0, z.0])),
            _ => Err(D::Error::custom(format!("{} numbers where three belong", values.len()))),
        }
    }
}

impl Finite3 {
    pub fn vector(self) -> glam::DVec3 {
        glam::DVec3::from_array(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[allow(dead_code)]
    struct Light {
        center: Finite3,
        radius: Spanned<Finite>,
    }

    fn problem(text: &str) -> InputError {
        Source::inline("light.toml", text).parse::<Light>().unwrap_err()
    }

    #[test]
    fn errors_name_place_and_nearest_word() {
        let error = problem("center = [0,0,0]\nradus = 1.0\n");
        assert_eq!(error.place, Some((2, 1)));
        assert_eq!(error.help.as_deref(), Some("did you mean `radius`?"));
        let error = problem("center = [0,0,0,0]\nradius = 1.0\n");
        assert_eq!(error.place, Some((1, 10)), "{error}");
        assert!(error.message.contains("4 numbers"));
        let error = problem("center = [0,0,0]\nradius = nan\n");
        assert_eq!(error.place, Some((2, 10)));
        let error = problem("center = [0,0,0]\nradius = \"one\"\n");
        assert_eq!(error.place, Some((2, 10)));
        let error = problem("center = [0,0,0\n");
        assert!(error.place.is_some());
    }
}
