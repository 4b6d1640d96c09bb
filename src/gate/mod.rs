//! Judging stored results: against thresholds and a baseline (`check`), and against other results (`compare`).

mod baseline;
mod check;
mod compare;
mod interval;
mod law;
mod say;
mod stored;

pub use baseline::{Accepted, Baseline, BaselineRow, accept};
pub use check::{Check, Kind, Options, Thresholds, Verdict, check, thresholds};
pub use compare::{Change, Comparison, Word, compare};
pub use interval::{Estimate, z_limit};
pub use law::Law;
pub use say::{Format, TableFormat, changes, checks, lines};
pub use stored::{Place, ResultKind, Stored, StoredRow, StoredTimes};
