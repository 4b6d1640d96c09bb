//! The run store: what was computed, kept by content, and what has to be computed again and why.

mod arrays;
mod disk;
pub mod interrupt;
mod store;

pub use arrays::{ArrayCache, Arrays};
pub use disk::{Lock, StoreError, write_atomic};
pub use store::{Change, Claim, Reason, Record, RunWriter, Store};
