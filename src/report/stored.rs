use std::collections::BTreeMap;
use std::fmt::Write;
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
    /// Other frames of its animation of which there are images.
    pub frames: Vec<usize>,
    /// Of volumes: whether there is a cut through it, and what that shows.
    pub has_section: bool,
    pub structure: Option<Structure>,
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
        let frames = frames_of(&folder.join("images"));
        let runs = names
            .into_par_iter()
            .map(|(run, failed, setup)| {
                let files = RunFiles::read(folder, &run, failed, setup, frames.get(&run).map_or(&[], Vec::as_slice));
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

    /// The frame of which a run's image is, where it is of an animation.
    pub fn picture_frame(&self, run: &str) -> Option<usize> {
        let frames = self.table.rows().filter(|r| r.text("run") == run).filter_map(|r| r.text("frame").parse().ok());
        let last: usize = frames.max()?;
        let chosen = self.document.pointer("/picture_frame").and_then(Value::as_u64).map(|frame| frame as usize);
        Some(chosen.unwrap_or((last + 1) / 2).min(last))
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

/// The structure of a volume in a plane, as paths of an SVG of which the longer side is 1000.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Structure {
    pub width: u32,
    pub height: u32,
    /// By kind: cell, wall, sample, inside.
    pub paths: BTreeMap<String, String>,
    pub samples: usize,
}

/// Cells, walls and samples in a cut from which no picture is made any more.
const MOST_ITEMS: usize = 8000;

impl Structure {
    /// From the cut that a run left; nothing where it is empty or too fine to be seen.
    fn of(cut: &Table) -> Option<Self> {
        let items: Vec<(&str, [f64; 4])> = cut
            .rows()
            .filter_map(|r| {
                let [a, b, c, d] = ["u0", "v0", "u1", "v1"].map(|column| r.number(column));
                Some((r.text("kind"), [a?, b?, c?, d?]))
            })
            .collect();
        if items.is_empty() || items.len() > MOST_ITEMS {
            return None;
        }
        let bound = |axis: usize, pick: fn(f64, f64) -> f64, start: f64| {
            items.iter().flat_map(|(_, p)| [p[axis], p[axis + 2]]).fold(start, pick)
        };
        let low = [0, 1].map(|axis| bound(axis, f64::min, f64::INFINITY));
        let high = [0, 1].map(|axis| bound(axis, f64::max, f64::NEG_INFINITY));
        let extent = [high[0] - low[0], high[1] - low[1]];
        // long rooms lie down
        let turned = extent[1] > extent[0];
        let scale = 1000.0 / extent[0].max(extent[1]).max(1e-9);
        let at = |u: f64, v: f64| {
            let [u, v] = [(u - low[0]) * scale, (v - low[1]) * scale].map(|x| x.round() as i64);
            if turned { (v, u) } else { (u, v) }
        };
        let mut paths: BTreeMap<String, String> = BTreeMap::new();
        for (kind, [a, b, c, d]) in &items {
            let ((x, y), (to_x, to_y)) = (at(*a, *b), at(*c, *d));
            let path = paths.entry((*kind).to_owned()).or_default();
            let _ = match *kind {
                "cell" => write!(path, "M{x} {y}H{to_x}V{to_y}H{x}Z"),
                "wall" => write!(path, "M{x} {y}L{to_x} {to_y}"),
                // a dot is a line without length and with round ends
                _ => write!(path, "M{x} {y}h0"),
            };
        }
        let [width, height] = extent.map(|side| (side * scale).round() as u32);
        let [width, height] = if turned { [height, width] } else { [width, height] };
        let samples = items.iter().filter(|(kind, _)| !["cell", "wall"].contains(kind)).count();
        Some(Self { width, height, paths, samples })
    }
}

impl RunFiles {
    fn read(folder: &Path, run: &str, failed: bool, setup: Option<f64>, frames: &[usize]) -> Self {
        let section = Table::read(&folder.join("volumes").join(format!("{run}.csv"))).ok();
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
            frames: frames.to_vec(),
            has_section: section.is_some(),
            structure: section.and_then(|cut| Structure::of(&cut)),
            last_words,
            seconds: status["seconds"].as_f64(),
            times: setup.and_then(|setup| times(&own.join("timings"), setup)),
        }
    }
}

/// The frames of which there are images beside the run's own, by run: `RUN.f07.exr`.
fn frames_of(images: &Path) -> BTreeMap<String, Vec<usize>> {
    let mut frames: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for entry in std::fs::read_dir(images).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let parts = name.strip_suffix(".exr").and_then(|name| name.split_once(".f"));
        if let Some((run, Ok(frame))) = parts.map(|(run, frame)| (run, frame.parse())) {
            frames.entry(run.to_owned()).or_default().push(frame);
        }
    }
    frames.values_mut().for_each(|frames| frames.sort_unstable());
    frames
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
