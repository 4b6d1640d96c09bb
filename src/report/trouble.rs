//! What a reader must know before any success: runs that failed, were skipped, or gave numbers that do not hold.

use super::hard_cases::{HALF_OF_F32, HALF_OF_F64};
use super::stored::Stored;
use crate::figure::scale::Format;
use crate::figure::table::{Row, name, varying_axes};

/// One kind of trouble.
pub struct Trouble {
    pub title: String,
    /// Whether something went wrong, and not only something is to be known.
    pub bad: bool,
    pub rows: Vec<Troubled>,
}

/// A run, or many alike, in trouble.
pub struct Troubled {
    pub run: String,
    pub name: String,
    pub place: String,
    pub why: String,
    pub last_words: String,
}

/// All trouble, the worst first; empty where there is none.
pub fn trouble(stored: &Stored) -> Vec<Trouble> {
    let rows = stored.runs();
    let varying = varying_axes(&rows);
    let mut found = Vec::new();
    let mut kind = |title: &str, bad: bool, is: &dyn Fn(&Row) -> bool, why: &dyn Fn(&Row) -> String| {
        let troubled: Vec<Troubled> = rows
            .iter()
            .filter(|r| is(r))
            .map(|r| Troubled {
                run: r.text("run").to_owned(),
                name: name(r, &varying),
                place: [r.text("family"), r.text("scene"), r.text("lights"), r.text("backend")]
                    .into_iter()
                    .filter(|t| !t.is_empty())
                    .collect::<Vec<_>>()
                    .join(", "),
                why: why(r),
                last_words: stored.runs.get(r.text("run")).map(|f| f.last_words.clone()).unwrap_or_default(),
            })
            .collect();
        if !troubled.is_empty() {
            found.push(Trouble { title: title.to_owned(), bad, rows: troubled });
        }
    };
    let note = |r: &Row| r.text("note").to_owned();
    let positive = |r: &Row, column: &str| r.number(column).is_some_and(|v| v > 0.0);
    kind("failed", true, &|r| r.text("status") == "failed", &note);
    kind(
        "gave values that are not finite",
        true,
        &|r| r.text("status") != "failed" && positive(r, "non_finite"),
        &|r| format!("{} values are not finite", r.text("non_finite")),
    );
    if stored.points.is_some() {
        let over = |column: &'static str, limit: f64| move |r: &Row| r.number(column).is_some_and(|v| v > limit);
        let short = |r: &Row, column: &str| r.number(column).map_or(String::new(), |v| Format::Plain.write(v));
        let where_it_is =
            |r: &Row| format!("error {} at {} = {}", short(r, "error"), r.text("parameter"), short(r, "worst_t"));
        kind("unstable: f32 loses more than half of its digits", true, &over("error", HALF_OF_F32), &where_it_is);
        kind(
            "away from an independent route by more than half of f64's digits",
            true,
            &over("f64_error", HALF_OF_F64),
            &|r| format!("f64 differs by {}", short(r, "f64_error")),
        );
    }
    kind("did not come to an end", true, &|r| r.text("status") == "open", &|_| "interrupted before it".to_owned());
    kind("skipped", false, &|r| r.text("status") == "skipped", &note);
    let ill = 1e8;
    kind("solved an ill-conditioned system", false, &|r| r.number("condition").is_some_and(|c| c > ill), &|r| {
        format!("condition number {}", r.text("condition"))
    });
    kind("met a singular place", false, &|r| positive(r, "singular"), &|r| {
        format!("{} terms were dropped where a light is singular", r.text("singular"))
    });
    kind(
        "with numbers below the noise of the reference",
        false,
        &|r| r.text("status") == "ok" && r.text("note").contains("not resolved"),
        &note,
    );
    found
}
