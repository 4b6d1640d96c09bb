use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Serialize};

use crate::cost::Samples;
use crate::experiment::{COLUMNS, Column, ColumnKind, TimingIdentity};
use crate::input::InputError;
use crate::run::Times;
use crate::stability;

/// Results as `results.json` keeps them.
#[derive(Debug)]
pub struct Stored {
    pub folder: PathBuf,
    pub experiment: String,
    pub kind: ResultKind,
    /// The experiment's file and the changes of the command line under which it ran.
    pub experiment_file: Option<PathBuf>,
    pub changes: Vec<String>,
    /// Of hard cases one a curve.
    pub rows: Vec<StoredRow>,
}

/// What results are of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub enum ResultKind {
    #[default]
    #[serde(rename = "sweep")]
    Sweep,
    /// Hard cases: curves over a parameter.
    #[serde(rename = "stability")]
    Curves,
}

/// A row: its columns by name, and the samples of its times.
#[derive(Clone, Debug, Default)]
pub struct StoredRow {
    cells: Vec<(&'static str, Cell)>,
    place: Place,
    /// Whether rays were cast for its run.
    casts_rays: bool,
    pub times: Option<StoredTimes>,
    /// Of curves: the value of the parameter at which a column is largest.
    worst_at: Vec<(&'static str, f64)>,
}

#[derive(Clone, Debug, PartialEq)]
enum Cell {
    Number(f64),
    Text(String),
}

#[derive(Clone, Debug, Deserialize)]
pub struct StoredTimes {
    pub on: TimingIdentity,
    pub samples: Times,
}

#[derive(Deserialize)]
struct ResultsFile {
    experiment: String,
    #[serde(default)]
    kind: ResultKind,
    experiment_file: Option<PathBuf>,
    #[serde(default)]
    changes: Vec<String>,
    rows: Vec<StoredRow>,
}

/// The random numbers of a result.
#[derive(Clone, Copy, Debug)]
pub struct Draw<'a> {
    pub run: &'a str,
    /// Of the reference; 0 where it is exact.
    pub noise: f64,
    pub casts_rays: bool,
}

impl Draw<'_> {
    /// Whether two results are made of the same random numbers, or of none: one key (configuration with the seed, content, algorithms), and
    /// references of the same noise to the last digits. One that its time limit cut short has another.
    pub fn is_same(&self, other: &Self) -> bool {
        let is_drawn = [self, other].iter().any(|draw| draw.casts_rays || draw.noise > 0.0);
        !is_drawn || (self.run == other.run && (self.noise - other.noise).abs() <= 1e-9 * other.noise)
    }
}

/// Times that are held and compared: column, and the samples behind it.
pub const TIMES: [&str; 2] = ["setup_us", "eval_ns_per_point"];

/// Columns of curves that a sweep does not have.
const OF_CURVES: [&str; 12] = [
    "family",
    "parameter",
    "t",
    "model",
    "error",
    "error_with_inputs",
    "f64_error",
    "naive_error",
    "naive_non_finite",
    "largest",
    ERROR_MEDIAN,
    F64_ERROR_MEDIAN,
];
const ERROR_MEDIAN: &str = "error_median";
const F64_ERROR_MEDIAN: &str = "f64_error_median";

/// The name of a column as the program's own text, by which rows keep it; none where the program does not know it.
fn known(name: &str) -> Option<&'static str> {
    static KNOWN: OnceLock<HashMap<&str, &'static str>> = OnceLock::new();
    let names = || COLUMNS.iter().map(|c| c.name).chain(OF_CURVES).map(|name| (name, name));
    KNOWN.get_or_init(|| names().collect()).get(name).copied()
}

impl ResultKind {
    /// The columns that say what a row is, but for the run's key and the experiment's name: the same from run to run.
    fn identity(self) -> &'static [&'static str] {
        static SWEEP: OnceLock<Vec<&str>> = OnceLock::new();
        match self {
            ResultKind::Curves => &stability::CHOICES,
            ResultKind::Sweep => SWEEP.get_or_init(|| {
                let identity = COLUMNS.iter().filter(|c| c.kind == ColumnKind::Identity).map(|c| c.name);
                identity.filter(|name| !["run", "experiment"].contains(name)).collect()
            }),
        }
    }

    /// Columns of quality that are held and compared, standard errors among them, and counts, which no machine changes.
    /// HDR FLIP is measured for the rows of a front, and fronts hang on times; naive forms are there to fail.
    pub fn held(self) -> &'static [&'static str] {
        static SWEEP: OnceLock<Vec<&str>> = OnceLock::new();
        match self {
            ResultKind::Curves => &[
                "non_finite",
                "singular",
                "error",
                "error_with_inputs",
                "f64_error",
                ERROR_MEDIAN,
                F64_ERROR_MEDIAN,
                "condition",
                "largest",
            ],
            ResultKind::Sweep => SWEEP.get_or_init(|| {
                let is_held = |c: &&Column| c.kind == ColumnKind::Quality || COUNTS.contains(&c.name);
                COLUMNS.iter().filter(is_held).map(|c| c.name).filter(|name| *name != "flip_hdr").collect()
            }),
        }
    }

    /// Columns that two results are compared by.
    pub fn compared(self) -> Vec<&'static str> {
        let held = self.held().iter().copied().filter(|name| !name.ends_with("_se"));
        match self {
            ResultKind::Sweep => held.chain(["flip_hdr"]).collect(),
            ResultKind::Curves => held.chain(["naive_error", "naive_non_finite"]).collect(),
        }
    }
}

/// Counts beside quality.
pub const COUNTS: [&str; 8] = [
    "sh_vectors",
    "projections",
    "direct_lights",
    "model_bytes",
    "samples",
    "samples_taken",
    "samples_inside",
    "floats",
];

/// Whether a column counts rounding errors, of which no digit need come back, only the size; and the rounding that is free.
pub fn rounding_error(column: &str) -> Option<f64> {
    match column {
        // sixteen roundings of f32, of f64
        "error" | "error_with_inputs" | "naive_error" | ERROR_MEDIAN => Some(2e-6),
        "f64_error" | F64_ERROR_MEDIAN => Some(4e-15),
        _ => None,
    }
}

/// The unit of a column; empty for pure numbers.
pub fn unit(column: &str) -> &'static str {
    match column {
        "largest" => "W/m^2",
        _ => COLUMNS.iter().find(|c| c.name == column).map_or("", |c| c.unit),
    }
}

impl Stored {
    /// Reads the results in a folder.
    pub fn read(folder: &Path) -> Result<Self, InputError> {
        let path = folder.join("results.json");
        let broken = |why: String| InputError::of_file(&path, why);
        let bytes = std::fs::read(&path)
            .map_err(|e| broken(format!("cannot be read: {e}")).with_help("`rigbench run` writes it"))?;
        let file: ResultsFile = serde_json::from_slice(&bytes)
            .map_err(|e| broken(format!("is no results of this program: {e}")).with_help("run the experiment again"))?;
        let mut rows = match file.kind {
            ResultKind::Sweep => file.rows,
            ResultKind::Curves => curves(file.rows),
        };
        // a run's first row says it for those of its receivers and frames
        let with_rays: HashSet<String> = rows
            .iter()
            .filter(|row| !["", "none"].contains(&row.text("effects")))
            .map(|row| row.text("run").to_owned())
            .collect();
        for row in &mut rows {
            row.casts_rays = with_rays.contains(row.text("run"));
            let named = file.kind.identity().iter().map(|name| ((*name).to_owned(), row.text(name).to_owned()));
            row.place = Place(named.filter(|(_, text)| !text.is_empty()).collect());
        }
        Ok(Self {
            folder: folder.to_owned(),
            experiment: file.experiment,
            kind: file.kind,
            experiment_file: file.experiment_file.map(|file| as_seen_from_here(&folder.join(file))),
            changes: file.changes,
            rows,
        })
    }
}

/// A path without detours, relative where it lies under the current folder: so people and GitHub know it.
fn as_seen_from_here(path: &Path) -> PathBuf {
    let Ok(whole) = path.canonicalize() else { return path.to_owned() };
    let here = std::env::current_dir().and_then(|here| here.canonicalize());
    here.ok().and_then(|here| whole.strip_prefix(here).ok().map(Path::to_owned)).unwrap_or(whole)
}

/// A row a curve from a row a value of its parameter: what it is, the largest of each number and where, and the middle of the errors.
fn curves(points: Vec<StoredRow>) -> Vec<StoredRow> {
    let mut all: Vec<StoredRow> = Vec::new();
    let mut rest = points.into_iter().peekable();
    while let Some(first) = rest.next() {
        let run = first.text("run").to_owned();
        let mut points = vec![first];
        while rest.peek().is_some_and(|next| next.text("run") == run) {
            points.extend(rest.next());
        }
        let mut curve = StoredRow::default();
        for column in ["run", "experiment", "parameter", "adapter", "status", "note"].iter().chain(&stability::CHOICES)
        {
            curve.put(column, points[0].text(column).to_owned());
        }
        let measured = stability::COLUMNS.iter().map(|c| c.0).chain(["largest"]);
        for column in measured.filter_map(known) {
            let values = points.iter().filter_map(|point| Some((point.number(column)?, point.number("t")?)));
            if let Some((value, t)) = values.max_by(|a, b| a.0.total_cmp(&b.0)) {
                curve.cells.push((column, Cell::Number(value)));
                curve.worst_at.push((column, t));
            }
        }
        for (column, middle) in [("error", ERROR_MEDIAN), ("f64_error", F64_ERROR_MEDIAN)] {
            let values = Samples(points.iter().filter_map(|point| point.number(column)).collect());
            curve.cells.extend(values.median().map(|value| (middle, Cell::Number(value))));
        }
        all.push(curve);
    }
    all
}

impl StoredRow {
    fn cell(&self, column: &str) -> Option<&Cell> {
        self.cells.iter().find(|(name, _)| *name == column).map(|(_, cell)| cell)
    }

    fn put(&mut self, column: &str, text: String) {
        if let (Some(column), false) = (known(column), text.is_empty()) {
            self.cells.push((column, Cell::Text(text)));
        }
    }

    /// What stands in a column of words; empty where that has no meaning.
    pub fn text(&self, column: &str) -> &str {
        match self.cell(column) {
            Some(Cell::Text(text)) => text,
            Some(Cell::Number(_)) | None => "",
        }
    }

    pub fn number(&self, column: &str) -> Option<f64> {
        match self.cell(column)? {
            Cell::Number(number) => Some(*number),
            Cell::Text(text) => text.parse().ok().filter(|v: &f64| v.is_finite()),
        }
    }

    /// Every column that says what the row is.
    pub fn place(&self) -> &Place {
        &self.place
    }

    pub fn is_ok(&self) -> bool {
        self.text("status") == "ok"
    }

    /// What random numbers it is made of: the run's key, the noise of its reference, and whether rays were cast at all.
    pub fn draw(&self) -> Draw<'_> {
        Draw { run: self.text("run"), noise: self.number("ref_noise").unwrap_or(0.0), casts_rays: self.casts_rays }
    }

    /// Whether rays or captures took the samples that the candidate is made of: they have noise of their own. Where nothing blocks, every
    /// source is analytic.
    pub fn has_drawn_probes(&self) -> bool {
        self.casts_rays && !["", "analytic"].contains(&self.text("probe_source"))
    }

    /// The value of the parameter at which a curve's column is largest.
    pub fn worst_at(&self, column: &str) -> Option<f64> {
        self.worst_at.iter().find(|(name, _)| *name == column).map(|(_, t)| *t)
    }

    /// For a selection of the experiment file.
    pub fn matches(&self, selection: &crate::experiment::Selection) -> bool {
        selection.matches_columns(|axis| Some(self.text(axis.name())).filter(|text| !text.is_empty()))
    }

    /// Pooled over receivers and frames.
    pub fn is_pooled(&self) -> bool {
        self.cell("receiver").is_none() && self.cell("frame").is_none()
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

/// Rows are read member by member: a sweep has thousands, and a tree of values of each costs more than all that is done with it.
impl<'de> Deserialize<'de> for StoredRow {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Members;
        impl<'de> Visitor<'de> for Members {
            type Value = StoredRow;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a row of results")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<StoredRow, A::Error> {
                let mut row = StoredRow { cells: Vec::with_capacity(48), ..StoredRow::default() };
                while let Some(name) = map.next_key::<Member>()? {
                    match name {
                        Member::Times => row.times = map.next_value()?,
                        Member::Column(column) => {
                            let cell = map.next_value::<Option<Cell>>()?.map(|cell| match (column, cell) {
                                // numbers that are names
                                ("order" | "frame", Cell::Number(number)) => Cell::Text(number.to_string()),
                                (_, cell) => cell,
                            });
                            row.cells.extend(cell.filter(|cell| !cell.is_empty()).map(|cell| (column, cell)));
                        }
                        Member::Other => drop(map.next_value::<IgnoredAny>()?),
                    }
                }
                Ok(row)
            }
        }
        deserializer.deserialize_map(Members)
    }
}

/// The name of a member of a row.
enum Member {
    Times,
    Column(&'static str),
    Other,
}

impl<'de> Deserialize<'de> for Member {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Name;
        impl Visitor<'_> for Name {
            type Value = Member;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a column")
            }
            fn visit_str<E>(self, name: &str) -> Result<Member, E> {
                Ok(match name {
                    "times" => Member::Times,
                    _ => known(name).map_or(Member::Other, Member::Column),
                })
            }
        }
        deserializer.deserialize_str(Name)
    }
}

impl Cell {
    fn is_empty(&self) -> bool {
        matches!(self, Cell::Text(text) if text.is_empty())
    }
}

impl<'de> Deserialize<'de> for Cell {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Scalar;
        impl Visitor<'_> for Scalar {
            type Value = Cell;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a number or a text")
            }
            fn visit_f64<E>(self, value: f64) -> Result<Cell, E> {
                Ok(Cell::Number(value))
            }
            fn visit_u64<E>(self, value: u64) -> Result<Cell, E> {
                Ok(Cell::Number(value as f64))
            }
            fn visit_i64<E>(self, value: i64) -> Result<Cell, E> {
                Ok(Cell::Number(value as f64))
            }
            fn visit_bool<E>(self, value: bool) -> Result<Cell, E> {
                Ok(Cell::Text(value.to_string()))
            }
            fn visit_str<E>(self, text: &str) -> Result<Cell, E> {
                Ok(Cell::Text(text.to_owned()))
            }
        }
        deserializer.deserialize_any(Scalar)
    }
}

/// What a row is about: column and text, in the order of the columns.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place(pub Vec<(String, String)>);

impl Place {
    /// Of columns in any order.
    pub fn sorted(mut columns: Vec<(String, String)>) -> Self {
        let at = |name: &str| {
            let of = |kind: ResultKind| kind.identity().iter().position(|column| *column == name);
            of(ResultKind::Sweep).or(of(ResultKind::Curves))
        };
        columns.sort_by_key(|(name, _)| at(name));
        Self(columns)
    }

    pub fn get(&self, column: &str) -> &str {
        self.0.iter().find(|(name, _)| name == column).map_or("", |(_, text)| text)
    }
}

impl Serialize for Place {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, text)| (name, text)))
    }
}

impl<'de> Deserialize<'de> for Place {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Members;
        impl<'de> Visitor<'de> for Members {
            type Value = Place;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("texts by column")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Place, A::Error> {
                let mut columns = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    columns.push(entry);
                }
                Ok(Place::sorted(columns))
            }
        }
        deserializer.deserialize_map(Members)
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
                "scene" | "lights" | "rig" | "interpolation" | "backend" | "precision" | "storage" | "family"
                | "model" => {
                    write!(f, "{space}{text}")?;
                }
                _ => write!(f, "{space}{name}={text}")?,
            }
        }
        Ok(())
    }
}
