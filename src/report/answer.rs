//! What was asked and the answer, in two sentences.

use super::hard_cases;
use super::stored::Stored;
use crate::figure::scale::Format;
use crate::figure::summary::{Verdict, verdicts};
use crate::figure::table::is_software;

/// The question, and the answer of each backend: two sentences.
pub struct Answer {
    pub question: String,
    /// Backend and adapter, and what they say; the one to read first stands first.
    pub parts: Vec<(String, String)>,
}

impl Answer {
    pub fn of(stored: &Stored) -> Self {
        let question = match stored.text("/title") {
            "" => stored.name(),
            title => title.to_owned(),
        };
        if stored.points.is_some() {
            return hard_cases::answer(stored, question);
        }
        let mut verdicts = verdicts(&stored.table);
        // what a software adapter takes is nobody's frame time
        verdicts.sort_by_key(|v| is_software(&v.heading));
        let mut parts: Vec<(String, String)> =
            verdicts.iter().map(|verdict| (verdict.heading.clone(), sentences(verdict))).collect();
        if parts.is_empty() {
            let text = "No run gave a number that could be compared. What went wrong stands below.";
            parts.push((String::new(), text.to_owned()));
        }
        Self { question, parts }
    }
}

fn sentences(verdict: &Verdict) -> String {
    let percent = |v: f64| Format::Percent.write(v);
    let cases = format!("{} case{}", verdict.cases, if verdict.cases == 1 { "" } else { "s" });
    let cost = |value: Option<f64>| match (value, verdict.timed) {
        (Some(v), true) => format!(" at {} a million points", Format::Unit("s").write(v * 1e-6)),
        (Some(v), false) => format!(" with {} SH vectors", Format::Plain.write(v)),
        (None, _) => String::new(),
    };
    let of = format!("Of {} candidates in {cases}", verdict.candidates);
    let first = match (&verdict.best, &verdict.least) {
        (Some(best), Some(least)) if best.name == least.name => {
            format!(
                "{of}, {} has both the best quality per cost and the least error (nRMSE {}{}).",
                best.name,
                percent(best.error),
                cost(best.cost)
            )
        }
        (Some(best), Some(least)) => format!(
            "{of}, {} buys most quality per cost (nRMSE {}{}), and {} has the least error of the rigs ({}{}).",
            best.name,
            percent(best.error),
            cost(best.cost),
            least.name,
            percent(least.error),
            cost(least.cost),
        ),
        _ => format!("{of}, none could be ranked by quality per cost."),
    };
    format!("{first} {}", verdict.halving)
}
