//! `rigbench report`: the answer for people, in one HTML file.

use std::path::{Path, PathBuf};

use clap::Args;

use super::{Exit, Failure};

/// Write report.html from stored results: one file that opens from disk
#[derive(Args, Debug)]
pub struct Report {
    /// Folder of results: the one that holds results.csv
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl Report {
    pub fn run(self) -> Result<Exit, Failure> {
        super::figures::read_results(&self.folder)?;
        write(&self.folder)?;
        Ok(Exit::Ok)
    }
}

/// Writes the report of a folder and says where it is.
pub(super) fn write(folder: &Path) -> Result<(), Failure> {
    let written = crate::report::write(folder).map_err(Failure::internal)?;
    eprintln!(
        "report: {} ({:.1} MB, {} pictures)",
        written.path.display(),
        written.bytes as f64 / 1e6,
        written.pictures
    );
    Ok(())
}
