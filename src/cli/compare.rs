//! `rigbench compare`: two result folders, run by run.

use std::path::PathBuf;

use clap::Args;

use super::{Exit, Failure, print};
use crate::gate::{self, Stored, TableFormat};

/// Compare two result folders run by run: what is significantly better or worse
#[derive(Args, Debug)]
pub struct Compare {
    /// Folder of results
    #[arg(value_name = "A")]
    a: PathBuf,
    /// Folder of results that is compared with it
    #[arg(value_name = "B")]
    b: PathBuf,
    /// How it is told; json and csv hold every value
    #[arg(long, value_name = "FORMAT", default_value = "table", value_parser = TableFormat::NAMES)]
    format: String,
    /// Show what is the same too
    #[arg(long)]
    all: bool,
    /// Factor from which a change of a time counts, beside its interval
    #[arg(long, value_name = "FACTOR", default_value = "1.05")]
    effect: f64,
}

impl Compare {
    pub fn run(self) -> Result<Exit, Failure> {
        if self.effect.is_nan() || self.effect < 1.0 {
            return Err(Failure::usage(format!("--effect {}: a factor from 1", self.effect)));
        }
        let (a, b) = (Stored::read(&self.a)?, Stored::read(&self.b)?);
        let comparison = gate::compare(&a, &b, self.effect);
        let format = TableFormat::named(&self.format).expect("clap allows no other");
        print(gate::changes(&comparison, format, self.all))?;
        Ok(Exit::Ok)
    }
}
