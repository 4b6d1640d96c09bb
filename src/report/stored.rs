use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::Value;

use super::hard_cases;
use crate::experiment::Axis;
use crate::figure::table::{Row, Table};
use crate::run::Times;
use crate::run::results::shell_word;

/// A folder of results as it lies on the disk.
pub struct Stored {
    pub folder: PathBuf,
    /// results.csv; of hard cases a row a curve.
    pub table: Table,
    /// results.csv of hard cases as it is: a row a curve and value of the parameter.
    pub points: Option<Table>,
    /// results.json; null where it is missing or damaged.
    pub document: Value,
    /// claims.csv
    pub claims: Option<Table>,
    /// What the folders of the runs say, by run.
    pub runs: BTreeMap<String, RunFiles>,
}

/// What the folder of one run says beyond its row.
#[derive(Clone, Debug, Default)]
pub struct RunFiles {
    pub has_log: bool,
    pub has_configuration: bool,
    pub has_image: bool,
    /// The last lines of the log of a run that failed.
    pub last_words: String,
    /// How long the run took, seconds.
    pub seconds: Option<f64>,
    /// Every sample of its times.
    pub times: Option<Times>,
}

impl Stored {
    pub fn read(folder: &Path) -> io::Result<Self> {
        let table = Table::read(&folder.join("results.csv"))
            .map_err(|e| io::Error::new(e.kind(), format!("{}: {e}", folder.join("results.csv").display())))?;
        let (table, points) = match hard_cases::curves(&table) {
            Some(curves) => (curves, Some(table)),
            None => (table, None),
        };
        let document = read_json(&folder.join("results.json"));
        let claims = Table::read(&folder.join("claims.csv")).ok().filter(|t| !t.rows.is_empty());
        let mut names: Vec<(String, bool, Option<f64>)> = Vec::new();
        for row in table.rows() {
            let run = row.text("run");
            if !run.is_empty() && names.last().is_none_or(|(last, ..)| last != run) {
                names.push((run.to_owned(), row.text("status") == "failed", row.number("setup_us")));
            }
        }
        let runs = names
            .into_par_iter()
            .map(|(run, failed, setup)| {
                let files = RunFiles::read(folder, &run, failed, setup);
                (run, files)
            })
            .collect();
        Ok(Self { folder: folder.to_owned(), table, points, document, claims, runs })
    }

    /// A text of results.json; empty where it is not there.
    pub fn text(&self, pointer: &str) -> &str {
        self.document.pointer(pointer).and_then(Value::as_str).unwrap_or_default()
    }

    pub fn name(&self) -> String {
        match self.text("/experiment") {
            "" => self.table.rows().next().map_or(String::new(), |r| r.text("experiment").to_owned()),
            name => name.to_owned(),
        }
    }

    /// The pooled row of every run, whatever became of it, in the order of the table.
    pub fn runs(&self) -> Vec<Row<'_>> {
        let mut seen = std::collections::HashSet::new();
        self.table.rows().filter(|r| r.text("run").is_empty() || seen.insert(r.text("run"))).collect()
    }

    /// The command that makes one run again: the sweep's, with a filter on every axis of the row.
    pub fn command(&self, row: &Row) -> String {
        let mut command = match self.text("/provenance/command") {
            "" => format!("rigbench run experiments/{}.toml", self.name()),
            command => command.to_owned(),
        };
        let words = match self.points {
            Some(_) => vec!["family", "model", "order", "backend"],
            None => Axis::names().to_vec(),
        };
        for word in words.into_iter().filter(|word| !row.text(word).is_empty()) {
            command += &format!(" --filter {}", shell_word(&format!("{word}={}", row.text(word))));
        }
        command
    }
}

impl RunFiles {
    fn read(folder: &Path, run: &str, failed: bool, setup: Option<f64>) -> Self {
        let own = folder.join("runs").join(run);
        let log = own.join("log.txt");
        let status = read_json(&own.join("status.json"));
        let last_words = match failed {
            true => {
                let text = std::fs::read_to_string(&log).unwrap_or_default();
                let lines: Vec<&str> = text.lines().collect();
                lines[lines.len().saturating_sub(6)..].join("\n")
            }
            false => String::new(),
        };
        Self {
            has_log: log.exists(),
            has_configuration: own.join("config.json").exists(),
            has_image: folder.join("images").join(format!("{run}.exr")).exists(),
            last_words,
            seconds: status["seconds"].as_f64(),
            times: setup.and_then(|setup| times(&own.join("timings"), setup)),
        }
    }
}

/// Of the times that were taken on several machines those that the row's median comes from.
fn times(folder: &Path, setup: f64) -> Option<Times> {
    let files = std::fs::read_dir(folder).ok()?;
    files.flatten().find_map(|file| {
        let content = read_json(&file.path());
        let times: Times = serde_json::from_value(content.pointer("/content/times")?.clone()).ok()?;
        (times.setup_us.median() == Some(setup)).then_some(times)
    })
}

fn read_json(path: &Path) -> Value {
    std::fs::read(path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
}
