//! The run store: what was computed, kept by content, and what has to be computed again and why.

mod arrays;
mod bakery;
mod block;
pub mod claims;
mod disk;
pub mod interrupt;
mod progress;
pub mod results;
mod store;
pub mod study;
mod sweep;
mod timing;

pub use arrays::{ArrayCache, Arrays};
pub use block::{Findings, Scores};
pub use disk::{Lock, StoreError, write_atomic};
pub use store::{Change, Claim, Reason, Record, RunWriter, Store};
pub use sweep::{Ending, Run, Sweep, SweepError, SweepOptions, sweep};
pub use timing::Times;
