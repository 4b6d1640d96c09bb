//! Figures: SVG and PNG from one list of shapes, each with the CSV of exactly what it shows. They are drawn from exported data
//! alone, so that anyone can draw them again.

mod captures;
pub mod colour_map;
pub mod contact_sheet;
pub mod cosine;
pub mod curves;
pub mod dots;
mod disk_error;
mod draw_all;
pub mod drawing;
pub mod fronts;
pub mod gallery;
pub mod hard_cases;
pub mod heat_map;
pub mod label;
mod latex;
mod near_far;
pub mod panel;
mod raster;
pub mod scale;
pub mod sections;
pub mod split;
pub mod statistics;
mod strip;
mod study;
pub mod style;
pub mod summary;
mod svg;
pub mod table;
pub mod tabular;
mod volumes;
mod wrap_lobe;

use std::io;
use std::path::Path;

use crate::output::write_whole;
pub use draw_all::{figures_of, redraw};
use drawing::Drawing;
pub(crate) use svg::base64;
use table::Table;

/// A drawing and the data that it was made of.
#[derive(Clone, Debug)]
pub struct Figure {
    pub drawing: Drawing,
    pub data: Table,
    /// LaTeX's `tabular` of a figure that is a table.
    pub tabular: Option<String>,
}

/// The forms in which every figure is there; a table is there as `tex` too.
pub const FORMS: [&str; 3] = ["csv", "png", "svg"];
/// What a table adds.
pub const TABULAR: &str = "tex";

impl Figure {
    pub fn new(drawing: Drawing, data: Table) -> Self {
        Self { drawing, data, tabular: None }
    }

    pub fn svg(&self) -> String {
        svg::svg(&self.drawing)
    }

    pub fn png(&self) -> Vec<u8> {
        raster::png(&self.drawing, style::PNG_SCALE)
    }

    /// Writes NAME.svg, NAME.png and NAME.csv, of a table NAME.tex; nothing where they are there and the drawing is the same.
    pub fn write(&self, folder: &Path, name: &str) -> io::Result<()> {
        let file = |extension: &str| folder.join(format!("{name}.{extension}"));
        let (svg, csv) = (self.svg(), self.data.to_csv());
        let same = |extension: &str, text: &str| std::fs::read(file(extension)).is_ok_and(|b| b == text.as_bytes());
        let same_table = self.tabular.as_ref().is_none_or(|tabular| same(TABULAR, tabular));
        if same("svg", &svg) && same("csv", &csv) && same_table && file("png").exists() {
            return Ok(());
        }
        // the SVG last: it is what says that the others are made
        if let Some(tabular) = &self.tabular {
            write_whole(&file(TABULAR), tabular.as_bytes())?;
        }
        write_whole(&file("csv"), csv.as_bytes())?;
        write_whole(&file("png"), &self.png())?;
        write_whole(&file("svg"), svg.as_bytes())
    }
}
