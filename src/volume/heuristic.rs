//! When an octree's cell is divided.

use std::ops::Range;

use serde::Deserialize;
use serde_json::Value;

use crate::input::{Finite, InputError, Source, Spanned, schema};

/// Where it is read from that a cell contains geometry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Evidence {
    /// A triangle overlaps the cell.
    #[default]
    Triangles,
    /// A place that a depth capture at the cell's centre sees lies in the cell.
    Depth,
}

/// One rule for dividing a cell.
///
/// Thresholds of difference mean the RMS over normals of an irradiance difference, relative to the larger of the local value and 1 % of
/// the volume's mean.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// The gradient at a corner or the centre, times the cell's edges, foretells a larger change.
    Gradient { threshold: f64 },
    /// The cell contains static geometry.
    ContainsGeometry { from: Evidence },
    /// HM * threshold <= s/2 for the harmonic mean HM of the depths seen from the centre and the cell's largest edge s;
    /// with `minimum` also where the least depth <= s/2 (the historic rule).
    HarmonicMean { threshold: f64, minimum: bool },
    /// The interpolated centre differs from the true centre by more.
    Error { threshold: f64 },
    /// Divide to the maximum level first; afterwards cells whose children change nothing by more are undone.
    Prune { threshold: f64 },
}

/// Any of its criteria divides a cell.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Heuristic {
    pub any: Vec<Criterion>,
}

impl Heuristic {
    /// The words that need no definition, the default first.
    pub const WORDS: [&'static str; 5] = ["gradient", "contains_geometry", "harmonic_mean", "error", "prune"];

    /// A word with its usual threshold.
    pub fn named(word: &str) -> Option<Self> {
        let criterion = match word {
            "gradient" => Criterion::Gradient { threshold: 0.2 },
            "contains_geometry" => Criterion::ContainsGeometry { from: Evidence::Triangles },
            "harmonic_mean" => Criterion::HarmonicMean { threshold: 0.5, minimum: true },
            "error" => Criterion::Error { threshold: 0.05 },
            "prune" => Criterion::Prune { threshold: 0.05 },
            _ => return None,
        };
        Some(Self { any: vec![criterion] })
    }

    /// The threshold of the prune criterion, where it is one of the list.
    pub fn prune(&self) -> Option<f64> {
        self.any.iter().find_map(|criterion| match criterion {
            Criterion::Prune { threshold } => Some(*threshold),
            _ => None,
        })
    }

    /// Whether samples need derivatives for it.
    pub fn uses_derivatives(&self) -> bool {
        self.any.iter().any(|criterion| matches!(criterion, Criterion::Gradient { .. }))
    }
}

/// One criterion with its parameters: exactly one key.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CriterionFile {
    gradient: Option<Spanned<ThresholdFile>>,
    contains_geometry: Option<Spanned<GeometryFile>>,
    harmonic_mean: Option<Spanned<HarmonicFile>>,
    error: Option<Spanned<ThresholdFile>>,
    prune: Option<Spanned<ThresholdFile>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with `threshold`")]
struct ThresholdFile {
    threshold: Spanned<Finite>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table, empty or with `from`")]
struct GeometryFile {
    #[serde(default)]
    from: Evidence,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with `threshold`")]
struct HarmonicFile {
    threshold: Spanned<Finite>,
    #[serde(default = "yes")]
    minimum: bool,
}

fn yes() -> bool {
    true
}

/// `[heuristic.NAME]`: one criterion, or `any = [...]` of several.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeuristicFile {
    any: Option<Spanned<Vec<Spanned<CriterionFile>>>>,
    gradient: Option<Spanned<ThresholdFile>>,
    contains_geometry: Option<Spanned<GeometryFile>>,
    harmonic_mean: Option<Spanned<HarmonicFile>>,
    error: Option<Spanned<ThresholdFile>>,
    prune: Option<Spanned<ThresholdFile>>,
}

impl CriterionFile {
    fn given(&self) -> Vec<(&'static str, Range<usize>)> {
        [
            ("gradient", self.gradient.as_ref().map(Spanned::span)),
            ("contains_geometry", self.contains_geometry.as_ref().map(Spanned::span)),
            ("harmonic_mean", self.harmonic_mean.as_ref().map(Spanned::span)),
            ("error", self.error.as_ref().map(Spanned::span)),
            ("prune", self.prune.as_ref().map(Spanned::span)),
        ]
        .into_iter()
        .filter_map(|(key, span)| span.map(|span| (key, span)))
        .collect()
    }

    fn resolve(&self, source: &Source, span: Range<usize>) -> Result<Criterion, InputError> {
        let threshold = |value: &Spanned<Finite>| match value.get_ref().0 {
            number if number > 0.0 => Ok(number),
            number => Err(source.error(value.span(), format!("threshold {number}; it must be above 0"))),
        };
        match self.given().as_slice() {
            [_] => {}
            [] => {
                let message = format!("no criterion; give one key of {}", Heuristic::WORDS.join(", "));
                return Err(source.error(span, message));
            }
            [(first, _), (second, place), ..] => {
                let message = format!("`{first}` and `{second}` in one criterion; list them in `any`");
                return Err(source.error(place.clone(), message));
            }
        }
        if let Some(table) = &self.gradient {
            return Ok(Criterion::Gradient { threshold: threshold(&table.get_ref().threshold)? });
        }
        if let Some(table) = &self.contains_geometry {
            return Ok(Criterion::ContainsGeometry { from: table.get_ref().from });
        }
        if let Some(table) = &self.harmonic_mean {
            let table = table.get_ref();
            return Ok(Criterion::HarmonicMean { threshold: threshold(&table.threshold)?, minimum: table.minimum });
        }
        if let Some(table) = &self.error {
            return Ok(Criterion::Error { threshold: threshold(&table.get_ref().threshold)? });
        }
        let table = self.prune.as_ref().expect("one key is given");
        Ok(Criterion::Prune { threshold: threshold(&table.get_ref().threshold)? })
    }
}

impl HeuristicFile {
    pub fn schema() -> Value {
        let threshold = || {
            schema::table([schema::required("threshold", schema::described(schema::above(0.0), "relative difference"))])
        };
        let evidence = schema::default(schema::word(["triangles", "depth"]), "triangles");
        let criteria = || {
            [
                ("gradient", threshold()),
                ("contains_geometry", schema::table([schema::optional("from", evidence.clone())])),
                (
                    "harmonic_mean",
                    schema::table([
                        schema::required("threshold", schema::above(0.0)),
                        schema::optional("minimum", schema::default(schema::flag(), true)),
                    ]),
                ),
                ("error", threshold()),
                ("prune", threshold()),
            ]
        };
        let one = schema::one_key(criteria(), []);
        schema::one_key(criteria().into_iter().chain([("any", schema::some(one))]), [])
    }

    pub fn resolve(&self, source: &Source, span: Range<usize>) -> Result<Heuristic, InputError> {
        let own = CriterionFile {
            gradient: self.gradient.clone(),
            contains_geometry: self.contains_geometry.clone(),
            harmonic_mean: self.harmonic_mean.clone(),
            error: self.error.clone(),
            prune: self.prune.clone(),
        };
        let Some(any) = &self.any else { return Ok(Heuristic { any: vec![own.resolve(source, span)?] }) };
        if let Some((key, place)) = own.given().first() {
            return Err(source.error(place.clone(), format!("`{key}` beside `any`; put it into the list")));
        }
        if any.get_ref().is_empty() {
            return Err(source.error(any.span(), "`any` of nothing would never divide; list at least one criterion"));
        }
        let criteria = any.get_ref().iter().map(|item| item.get_ref().resolve(source, item.span()));
        Ok(Heuristic { any: criteria.collect::<Result<_, _>>()? })
    }
}
