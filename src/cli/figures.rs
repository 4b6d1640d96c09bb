//! `rigbench figures`: every figure again, from stored results alone.

use std::path::PathBuf;

use clap::Args;

use super::{Exit, Failure, print};
use crate::figure::table::Table;
use crate::figure::{gallery, redraw};

/// Draw every figure again from stored results: SVG, PNG, CSV and a LaTeX file
#[derive(Args, Debug)]
pub struct Figures {
    /// Folder of results: the one that holds results.csv
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Folder that gets the figures; by default DIR/figures
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Take this figure into the committed gallery, with the command that makes it
    #[arg(long, value_name = "NAME")]
    keep: Vec<String>,
    /// The committed gallery
    #[arg(long, value_name = "FOLDER", default_value = "results/gallery")]
    gallery: PathBuf,
}

impl Figures {
    pub fn run(self) -> Result<Exit, Failure> {
        let invalid = |error: std::io::Error| Failure::new(Exit::InvalidInput, error.to_string());
        let table = read_results(&self.folder)?;
        let target = self.out.clone().unwrap_or_else(|| self.folder.join("figures"));
        let names = redraw(&table, &self.folder, &target).map_err(Failure::internal)?;
        for name in &self.keep {
            if !names.contains(name) {
                let near = crate::input::nearest_word(name, names.iter().map(String::as_str));
                let near = near.map_or(String::new(), |n| format!("; did you mean `{n}`?"));
                return Err(Failure::usage(format!("no figure `{name}` comes from these results{near}")));
            }
            let command = crate::run::results::command(&self.folder);
            gallery::keep(&target, name, &self.gallery, &command).map_err(invalid)?;
        }
        eprintln!("{} figures in {}", names.len(), target.display());
        print(names.iter().map(|name| format!("{name}\n")).collect::<String>())?;
        Ok(if names.is_empty() { Exit::NothingSelected } else { Exit::Ok })
    }
}

/// results.csv of a folder; a folder without one is a mistake of the caller's.
pub(super) fn read_results(folder: &std::path::Path) -> Result<Table, Failure> {
    let path = folder.join("results.csv");
    let help = "\n  help: `rigbench run` writes it";
    let table = Table::read(&path).map_err(|error| {
        let text = error.to_string();
        let text =
            if text.contains(&path.display().to_string()) { text } else { format!("{}: {text}", path.display()) };
        Failure::new(Exit::InvalidInput, format!("{text}{help}"))
    })?;
    // a file of another program, or one that was cut
    match table.columns.iter().any(|column| column == "run") && !table.rows.is_empty() {
        true => Ok(table),
        false => {
            let text = format!("{}: holds no run of this program{help}", path.display());
            Err(Failure::new(Exit::InvalidInput, text))
        }
    }
}
