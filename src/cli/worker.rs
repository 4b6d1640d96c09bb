//! `rigbench worker` and `rigbench task`: what `run` starts, here and on a cluster. Hidden: nobody types them.

use std::path::PathBuf;

use clap::Args;

use super::{Exit, Failure};
use crate::experiment::{Experiment, Override};
use crate::run::{Store, interrupt, limit_memory, run_task, serve};

/// Carry out orders from standard input
#[derive(Args, Debug)]
#[command(hide = true)]
pub struct Worker {
    #[arg(value_name = "EXPERIMENT")]
    experiment: PathBuf,
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<Override>,
    #[arg(long, value_name = "N")]
    jobs: Option<u16>,
    /// Bytes
    #[arg(long)]
    memory: Option<u64>,
    #[arg(long)]
    force: bool,
}

impl Worker {
    pub fn run(self) -> Result<Exit, Failure> {
        interrupt::leave_to_the_giver().map_err(Failure::internal)?;
        if let Some(bytes) = self.memory {
            limit_memory(bytes)
                .map_err(|cause| Failure::internal(format!("memory limit of {bytes} bytes: {cause}")))?;
        }
        if let Some(jobs) = self.jobs {
            let built = rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs.max(1))).build_global();
            built.map_err(Failure::internal)?;
        }
        let experiment = Experiment::load_with(&self.experiment, &self.set)?;
        serve(&experiment, &Store::at(&self.out), self.force);
        Ok(Exit::Ok)
    }
}

/// Do one task of an array
#[derive(Args, Debug)]
#[command(hide = true)]
pub struct Task {
    #[arg(value_name = "TASKS")]
    file: PathBuf,
    #[arg(value_name = "N")]
    task: usize,
}

impl Task {
    pub fn run(self) -> Result<Exit, Failure> {
        interrupt::install().map_err(Failure::internal)?;
        run_task(&self.file, self.task).map_err(Failure::internal)?;
        Ok(if interrupt::interrupted() { Exit::Interrupted } else { Exit::Ok })
    }
}
