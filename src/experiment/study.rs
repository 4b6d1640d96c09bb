//! `[[study]]`: numbers that are no candidate's, drawn beside the sweep.

use std::ops::Range;

use serde::Deserialize;
use serde_json::Value;

use super::definition::{above_zero, one_key, whole};
use crate::input::{Finite, InputError, Source, Spanned, schema};
use crate::sh::MAX_ORDER;

/// A study, its values checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// Names `studies/NAME.csv` and its figures.
    pub name: String,
    pub kind: StudyKind,
}

#[derive(Clone, Debug, PartialEq)]
pub enum StudyKind {
    /// Error of the disk light's formulas over where the receiver stands, all normals.
    DiskModels {
        /// Texels along a side of the tables.
        table_sizes: Vec<usize>,
        /// The maps' extent in height and offset, radii.
        reach: f64,
        /// Cells of a map along a side.
        cells: usize,
    },
    /// The wrap lobe and its SH reconstructions.
    WrapLobe { wraps: Vec<f64>, orders: Vec<usize> },
}

/// One `[[study]]`: a name and one kind.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyFile {
    name: Spanned<String>,
    disk_models: Option<Spanned<DiskModelsFile>>,
    wrap_lobe: Option<Spanned<WrapLobeFile>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct DiskModelsFile {
    table_sizes: Option<Spanned<Vec<Spanned<i64>>>>,
    reach: Option<Spanned<Finite>>,
    cells: Option<Spanned<i64>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrapLobeFile {
    wraps: Spanned<Vec<Spanned<Finite>>>,
    orders: Option<Spanned<Vec<Spanned<i64>>>>,
}

/// Whole numbers in a range, none twice, at least one.
fn wholes(
    source: &Source,
    list: &Spanned<Vec<Spanned<i64>>>,
    what: &str,
    range: std::ops::RangeInclusive<u32>,
) -> Result<Vec<usize>, InputError> {
    if list.get_ref().is_empty() {
        return Err(source.error(list.span(), "an empty list; leave it out for its default"));
    }
    let mut values = Vec::new();
    for value in list.get_ref() {
        let number = whole(source, value, what, range.clone())? as usize;
        if values.contains(&number) {
            return Err(source.error(value.span(), format!("{what} {number} twice")));
        }
        values.push(number);
    }
    Ok(values)
}

impl StudyFile {
    pub fn schema() -> Value {
        let list = |item: Value| schema::some(item);
        let disk = schema::table([
            schema::optional(
                "table_sizes",
                schema::described(list(schema::whole(2, 256)), "texels along a side of the tables"),
            ),
            schema::optional(
                "reach",
                schema::default(schema::described(schema::above(0.0), "extent of the maps, radii"), 3.0),
            ),
            schema::optional("cells", schema::default(schema::whole(2, 256), 48)),
        ]);
        let mut wrap = schema::number();
        wrap["minimum"] = 0.into();
        wrap["maximum"] = 1.into();
        let lobe = schema::table([
            schema::required("wraps", list(wrap)),
            schema::optional("orders", list(schema::whole(1, MAX_ORDER as u64))),
        ]);
        let mut name = schema::described(schema::text(), "names studies/NAME.csv and its figures");
        name["pattern"] = "^[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}$".into();
        schema::one_key([("disk_models", disk), ("wrap_lobe", lobe)], [schema::required("name", name)])
    }

    pub fn resolve(&self, source: &Source, span: Range<usize>) -> Result<Study, InputError> {
        let name = self.name.get_ref();
        let plain = name.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c));
        if !plain || name.is_empty() || name.starts_with('.') || name.len() > 100 {
            let message = format!(
                "study name `{name}`: it names a file; letters, digits, `-`, `_` and `.` (not first), at most 100"
            );
            return Err(source.error(self.name.span(), message));
        }
        let spans = [
            ("disk_models", self.disk_models.as_ref().map(Spanned::span)),
            ("wrap_lobe", self.wrap_lobe.as_ref().map(Spanned::span)),
        ];
        one_key(source, span, "study", spans)?;
        let kind = if let Some(disk) = &self.disk_models {
            let disk = disk.get_ref();
            StudyKind::DiskModels {
                table_sizes: match &disk.table_sizes {
                    None => vec![16, 32, 64],
                    Some(sizes) => wholes(source, sizes, "table size", 2..=256)?,
                },
                reach: disk.reach.as_ref().map_or(Ok(3.0), |reach| above_zero(source, reach, "reach"))?,
                cells: match &disk.cells {
                    None => 48,
                    Some(cells) => whole(source, cells, "cells", 2..=256)? as usize,
                },
            }
        } else {
            let lobe = self.wrap_lobe.as_ref().expect("one key is given").get_ref();
            if lobe.wraps.get_ref().is_empty() {
                return Err(source.error(lobe.wraps.span(), "an empty list; name at least one wrap"));
            }
            for wrap in lobe.wraps.get_ref() {
                if !(0.0..=1.0).contains(&wrap.get_ref().0) {
                    return Err(source.error(wrap.span(), format!("wrap {}; it lies in 0 to 1", wrap.get_ref().0)));
                }
            }
            StudyKind::WrapLobe {
                wraps: lobe.wraps.get_ref().iter().map(|wrap| wrap.get_ref().0).collect(),
                orders: match &lobe.orders {
                    None => (1..=MAX_ORDER).collect(),
                    Some(orders) => wholes(source, orders, "order", 1..=MAX_ORDER as u32)?,
                },
            }
        };
        Ok(Study { name: name.clone(), kind })
    }
}
