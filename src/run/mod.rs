//! The run store: what was computed, kept by content, and what has to be computed again and why.

mod arrays;
mod bake_log;
mod bakery;
mod block;
pub mod claims;
mod crew;
mod disk;
pub mod hard_cases;
pub mod interrupt;
mod progress;
pub mod recommend;
pub mod results;
mod shard;
mod slurm;
mod store;
pub mod study;
mod sweep;
mod timing;
mod walk;
mod worker;

use crate::experiment::TimingSettings;
pub use arrays::{ArrayCache, Arrays};
pub use bake_log::BakeLog;
pub use block::{Findings, Scores};
pub use crew::CrewOptions;
pub use disk::{Lock, StoreError, write_atomic};
pub use shard::{Shard, bring, shard_of};
pub use slurm::{SlurmOptions, run_task};
pub use store::{Change, Claim, Reason, Record, RunWriter, Store};
pub use sweep::{Ending, Engine, Only, Run, Sweep, SweepError, SweepOptions, recipe_of, sweep};
pub use timing::Times;
pub use worker::{limit_memory, serve};
