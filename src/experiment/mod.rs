//! The experiment file: parse, validate with positions, expand to candidates, key by content.

mod identity;

pub use identity::{ALGORITHMS, Algorithms, Identity, Key, TimingIdentity};
