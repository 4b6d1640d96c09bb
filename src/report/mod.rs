//! report.html: the answer of an experiment for people, in one file that opens from disk without a network. It is made from stored
//! results alone: results.csv and results.json, what the runs' folders hold, and the images.

mod answer;
mod fronts;
mod hard_cases;
mod held;
mod page;
mod pixels;
mod stored;
mod trouble;

use std::io;
use std::path::{Path, PathBuf};

use crate::output::write_whole;
use pixels::Pictures;
use stored::Stored;

/// What was written.
#[derive(Clone, Debug)]
pub struct Written {
    pub path: PathBuf,
    pub bytes: usize,
    /// Pictures of candidates in it.
    pub pictures: usize,
}

/// Writes DIR/report.html from the results in DIR.
pub fn write(folder: &Path) -> io::Result<Written> {
    let stored = Stored::read(folder)?;
    let pictures = Pictures::of(&stored);
    let html = page::page(&stored, &pictures);
    let path = folder.join("report.html");
    write_whole(&path, html.as_bytes())?;
    Ok(Written { path, bytes: html.len(), pictures: pictures.count() })
}
