use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Map, Value};

use crate::cost::Samples;
use crate::experiment::{Axis, COLUMNS, ColumnKind, TimingIdentity};
use crate::input::InputError;
use crate::run::Times;

/// Results as `results.json` keeps them.
#[derive(Debug)]
pub struct Stored {
    pub folder: PathBuf,
    pub experiment: String,
    /// The experiment's file and the changes of the command line under which it ran.
    pub experiment_file: PathBuf,
    pub changes: Vec<String>,
    pub rows: Vec<StoredRow>,
}

/// A row: its columns by name, and the samples of its times.
#[derive(Clone, Debug, Default)]
pub struct StoredRow {
    cells: Map<String, Value>,
    pub times: Option<StoredTimes>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct StoredTimes {
    pub on: TimingIdentity,
    pub samples: Times,
}

#[derive(Deserialize)]
struct ResultsFile {
    experiment: String,
    experiment_file: PathBuf,
    #[serde(default)]
    changes: Vec<String>,
    rows: Vec<Map<String, Value>>,
}

/// Times that are held and compared: column, and the samples behind it.
pub const TIMES: [&str; 2] = ["setup_us", "eval_ns_per_point"];

impl Stored {
    /// Reads the results in a folder.
    pub fn read(folder: &Path) -> Result<Self, InputError> {
        let path = folder.join("results.json");
        let broken = |why: String| InputError::of_file(&path, why);
        let bytes = std::fs::read(&path)
            .map_err(|e| broken(format!("cannot be read: {e}")).with_help("`rigbench run` writes it"))?;
        let file: ResultsFile = serde_json::from_slice(&bytes)
            .map_err(|e| broken(format!("is no results of this program: {e}")).with_help("run the experiment again"))?;
        let rows = file
            .rows
            .into_iter()
            .map(|mut cells| {
                let times = cells.remove("times").map(serde_json::from_value).transpose();
                Ok(StoredRow { cells, times: times.map_err(|e| broken(format!("times: {e}")))? })
            })
            .collect::<Result<_, InputError>>()?;
        Ok(Self {
            folder: folder.to_owned(),
            experiment: file.experiment,
            experiment_file: folder.join(file.experiment_file),
            changes: file.changes,
            rows,
        })
    }
}

impl StoredRow {
    /// What stands in a column; empty where that has no meaning.
    pub fn text(&self, column: &str) -> String {
        match self.cells.get(column) {
            None | Some(Value::Null) => String::new(),
            Some(Value::String(text)) => text.clone(),
            Some(other) => other.to_string(),
        }
    }

    pub fn number(&self, column: &str) -> Option<f64> {
        match self.cells.get(column)? {
            Value::Number(number) => number.as_f64(),
            Value::String(text) => text.parse().ok().filter(|v: &f64| v.is_finite()),
            _ => None,
        }
    }

    /// Every column that says what the row is, but for the run's key and the experiment's name: the same from run to run.
    pub fn place(&self) -> Place {
        let identity = COLUMNS.iter().filter(|c| c.kind == ColumnKind::Identity);
        let named = identity.filter(|c| !["run", "experiment"].contains(&c.name));
        Place(named.map(|c| (c.name.to_owned(), self.text(c.name))).filter(|(_, text)| !text.is_empty()).collect())
    }

    /// For a selection of the experiment file.
    pub fn matches(&self, selection: &crate::experiment::Selection) -> bool {
        let columns: Vec<String> = Axis::ALL.iter().map(|axis| self.text(axis.name())).collect();
        selection.matches_columns(|axis| Some(columns[axis as usize].as_str()).filter(|text| !text.is_empty()))
    }

    /// Pooled over receivers and frames.
    pub fn is_pooled(&self) -> bool {
        self.text("receiver").is_empty() && self.text("frame").is_empty()
    }

    /// The samples behind a column of times.
    pub fn samples(&self, column: &str) -> Option<&Samples> {
        let samples = &self.times.as_ref()?.samples;
        match column {
            "setup_us" => Some(&samples.setup_us),
            "eval_ns_per_point" => Some(&samples.eval_ns_per_point),
            _ => None,
        }
    }
}

/// What a row is about: column and text, in the order of the columns.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place(pub Vec<(String, String)>);

impl Place {
    pub fn get(&self, column: &str) -> &str {
        self.0.iter().find(|(name, _)| name == column).map_or("", |(_, text)| text)
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, (name, text)) in self.0.iter().enumerate() {
            // what nearly every row has
            if matches!(text.as_str(), "exact" | "analytic" | "none" | "f32") {
                continue;
            }
            let space = if index > 0 { " " } else { "" };
            match name.as_str() {
                // words that say themselves what they are
                "scene" | "lights" | "rig" | "interpolation" | "backend" | "precision" | "storage" => {
                    write!(f, "{space}{text}")?;
                }
                _ => write!(f, "{space}{name}={text}")?,
            }
        }
        Ok(())
    }
}
