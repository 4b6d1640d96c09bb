//! The table at the end of a run, as Markdown that also reads well in a terminal: what each candidate costs and what it buys, the
//! best quality per cost marked, and what each halving of the error costs.

use super::draw_all::{machine, most_complete};
use super::scale::{Format, next_to_nothing};
use super::statistics::ranks;
use super::table::{Matrix, Row, Table, groups, name, named_first, varying_axes};
use crate::cost::Samples;
use crate::cost::pareto::{Halving, front, halving};

/// The cost that candidates are ranked by, as in the column `pareto`: frame time at a million points; where nothing was timed, SH
/// vectors.
const FRAME: &str = "frame_us_1m";
const VECTORS: &str = "sh_vectors";

/// A rig that won something: its median error and cost over the cases.
#[derive(Clone, Debug, PartialEq)]
pub struct Champion {
    pub name: String,
    /// nRMSE.
    pub error: f64,
    /// Microseconds a million points; SH vectors where nothing was timed.
    pub cost: Option<f64>,
}

/// What the summary of one backend and adapter comes to.
#[derive(Clone, Debug)]
pub struct Verdict {
    pub heading: String,
    pub candidates: usize,
    pub cases: usize,
    pub timed: bool,
    /// Best quality per cost.
    pub best: Option<Champion>,
    /// The rig of the least error.
    pub least: Option<Champion>,
    /// What each halving of the error costs: a sentence.
    pub halving: String,
}

/// The verdict on each backend and adapter.
pub fn verdicts(table: &Table) -> Vec<Verdict> {
    let pooled = table.pooled();
    let rows = named_first(&pooled.rows().collect::<Vec<_>>());
    groups(rows, &["backend", "adapter"])
        .into_iter()
        .map(|group| part(&machine(group.key[0], group.key[1]), &comparable(&group.rows)).verdict)
        .collect()
}

/// One backend and adapter of the summary.
struct Part {
    heading: String,
    verdict: Verdict,
    header: Vec<String>,
    lines: Vec<Vec<String>>,
    notes: Vec<String>,
}

/// Markdown of the whole table of results.
pub fn summary(table: &Table) -> String {
    let pooled = table.pooled();
    let mut out = String::new();
    // a family of random layouts would outweigh the named ones: rates over it are figures and claims of their own
    let rows = named_first(&pooled.rows().collect::<Vec<_>>());
    for group in groups(rows, &["backend", "adapter"]) {
        let compared = comparable(&group.rows);
        let mut part = part(&machine(group.key[0], group.key[1]), &compared);
        let left_out = group.rows.len() - compared.len();
        if left_out > 0 {
            part.notes.push(format!(
                "{left_out} more rows, of candidates that were not timed or not measured in every case, are in results.csv and the figures."
            ));
        }
        out += &format!("### {}\n\n", part.heading);
        out += &aligned(&part.header, &part.lines);
        out.push('\n');
        for note in part.notes {
            out += &note;
            out += "\n\n";
        }
    }
    out.truncate(out.trim_end().len());
    out.push('\n');
    out
}

/// The rows of candidates that were timed (where any was) and measured in as many cases as the others: medians over
/// different cases do not compare.
fn comparable<'t>(rows: &[Row<'t>]) -> Vec<Row<'t>> {
    let varying = varying_axes(rows);
    let timed = rows.iter().any(|r| r.number(FRAME).is_some());
    let kept: Vec<Row> = rows.iter().copied().filter(|r| !timed || r.number(FRAME).is_some()).collect();
    let mut cases: std::collections::HashMap<String, usize> = Default::default();
    for row in &kept {
        *cases.entry(name(row, &varying)).or_default() += 1;
    }
    let most = cases.values().copied().max().unwrap_or(0);
    kept.into_iter().filter(|row| cases[&name(row, &varying)] == most).collect()
}

fn part(heading: &str, rows: &[Row]) -> Part {
    let matrix = Matrix::new(rows);
    let (candidates, cases) = (0..matrix.names.len(), matrix.cases.len());
    let of = |column: &str| matrix.values(column);
    let (nrmse, vectors) = (of("nrmse"), of(VECTORS));
    let timed = of(FRAME).iter().flatten().any(Option::is_some);
    let (cost, cost_name) = if timed { (of(FRAME), "frame time") } else { (of(VECTORS), "SH vectors") };

    // quality per cost: the least product of error and cost, ranked within each case. Direct evaluation is no rig and is not
    // ranked: where it is right up to rounding, any price would make it first
    let is_rig = |r: usize| vectors[r].iter().any(Option::is_some);
    let product = |r: usize| (0..cases).map(|c| Some(nrmse[r][c]? * cost[r][c]?)).collect::<Vec<Option<f64>>>();
    let products: Vec<_> = candidates.clone().map(|r| if is_rig(r) { product(r) } else { vec![None; cases] }).collect();
    let ranked = most_complete(&products);
    let ranks = ranks(&ranked.iter().map(|r| products[*r].clone()).collect::<Vec<_>>());
    let mean = |r: &Vec<f64>| r.iter().sum::<f64>() / r.len() as f64;
    let complete = ranks.first().map_or(0, Vec::len);
    let best = ranks.iter().filter(|r| !r.is_empty()).map(mean).reduce(f64::min);
    let is_best = |r: usize| ranked.iter().zip(&ranks).any(|(i, ranks)| *i == r && best == Some(mean(ranks)));

    let fronts: Vec<Vec<bool>> =
        (0..cases).map(|c| front(&candidates.clone().map(|r| (cost[r][c], nrmse[r][c])).collect::<Vec<_>>())).collect();

    let write = |value: Option<f64>, format: Format| value.map_or(String::new(), |v| format.write(v));
    let many = cases > 1;
    let mut header: Vec<String> = ["", "rig"].map(String::from).to_vec();
    header.extend(COLUMNS.iter().map(|(_, title, ..)| (*title).to_owned()));
    if many {
        header.push("worst".into());
    }
    header.push("on the front".into());
    let columns: Vec<_> = COLUMNS.iter().map(|(column, _, format, factor)| (of(column), *format, *factor)).collect();
    let lines = candidates
        .clone()
        .map(|r| {
            let mut line = vec![if is_best(r) { "★".to_owned() } else { String::new() }, matrix.names[r].clone()];
            for (values, format, factor) in &columns {
                let known: Vec<f64> = values[r].iter().flatten().map(|v| v * factor).collect();
                line.push(write(Samples(known).median(), *format));
            }
            if many {
                line.push(write(nrmse[r].iter().flatten().copied().reduce(f64::max), Format::Percent));
            }
            let known = (0..cases).filter(|c| nrmse[r][*c].is_some() && cost[r][*c].is_some()).count();
            let on = (0..cases).filter(|c| fronts[*c][r]).count();
            line.push(if known > 0 { format!("{on} of {known}") } else { String::new() });
            line
        })
        .collect();

    let mut notes = Vec::new();
    let mut note = String::new();
    if many {
        note += &format!("Medians and the worst over {cases} cases (scene × lights). ");
    }
    if best.is_some() {
        let over = if complete > 1 { format!(", by mean rank over {complete} cases") } else { String::new() };
        note += &format!("★ best quality per cost among the rigs: the least nRMSE × {cost_name}{over}.");
    }
    if !note.is_empty() {
        notes.push(note.trim_end().to_owned());
    }
    let floor = next_to_nothing(nrmse.iter().flatten().flatten().copied());
    let members: Vec<Vec<(f64, f64)>> = (0..cases)
        .map(|c| {
            let on_front = candidates.clone().filter(|r| fronts[c][*r]);
            on_front.filter_map(|r| Some((cost[r][c]?, nrmse[r][c]?))).collect()
        })
        .collect();
    let halving = halving_sentence(&members, floor, cost_name);
    notes.push(halving.clone());
    let middle =
        |values: &[Vec<Option<f64>>], r: usize| Samples(values[r].iter().flatten().copied().collect()).median();
    let champion =
        |r: usize| Some(Champion { name: matrix.names[r].clone(), error: middle(&nrmse, r)?, cost: middle(&cost, r) });
    let verdict = Verdict {
        heading: heading.to_owned(),
        candidates: matrix.names.len(),
        cases,
        timed,
        best: candidates.clone().find(|r| is_best(*r)).and_then(champion),
        least: candidates.filter(|r| is_rig(*r)).filter_map(champion).min_by(|a, b| a.error.total_cmp(&b.error)),
        halving,
    };
    Part { heading: heading.to_owned(), verdict, header, lines, notes }
}

/// Columns of the summary: of the results, title, how it is written, factor to the unit that is written.
const COLUMNS: [(&str, &str, Format, f64); 8] = [
    (VECTORS, "SH vectors", Format::Plain, 1.0),
    ("model_bytes", "size", Format::Unit("B"), 1.0),
    ("setup_us", "setup", Format::Unit("s"), 1e-6),
    ("eval_ns_per_point", "evaluation / point", Format::Unit("s"), 1e-9),
    ("frame_us_vertices", "frame, vertices", Format::Unit("s"), 1e-6),
    (FRAME, "frame, 1 M points", Format::Unit("s"), 1e-6),
    ("interpolation_nrmse", "interpolation", Format::Percent, 1.0),
    ("nrmse", "nRMSE", Format::Percent, 1.0),
];

/// The sentence a reader wants, from the fronts of all cases.
fn halving_sentence(fronts: &[Vec<(f64, f64)>], floor: f64, cost: &str) -> String {
    let prices: Vec<Halving> = fronts.iter().filter_map(|f| halving(f, floor)).collect();
    let fits: Vec<f64> =
        prices.iter().filter(|p| matches!(p, Halving::Regression { .. })).map(Halving::factor).collect();
    let short = fronts.len() - fits.len();
    let factor = |v: f64| format!("{v:.2}");
    if fits.is_empty() {
        return match prices.first() {
            Some(ends) if fronts.len() == 1 => format!(
                "The front has only two points: between them each halving of the error multiplies the {cost} by {}; two points \
                 are no trend.",
                factor(ends.factor())
            ),
            _ => format!(
                "What each halving of the error costs cannot be said: no front has three points with an error and a {cost} above zero."
            ),
        };
    }
    let low = fits.iter().copied().fold(f64::MAX, f64::min);
    let high = fits.iter().copied().fold(f64::MIN, f64::max);
    let median = Samples(fits.clone()).median().expect("not empty");
    let spread = if fits.len() > 1 {
        format!(", median of {} fronts, {} to {}", fits.len(), factor(low), factor(high))
    } else {
        String::new()
    };
    let nothing = fronts.iter().flatten().any(|(_, error)| *error < floor.max(f64::MIN_POSITIVE));
    let nothing =
        if nothing { format!("; errors under {} left out", Format::Percent.write(floor)) } else { String::new() };
    let left_out = match short {
        0 => String::new(),
        n => format!("; {n} front{} of fewer than three points left out", if n == 1 { "" } else { "s" }),
    };
    format!(
        "Each halving of the error multiplies the {cost} by {}{spread} (straight line in log-log over the front{left_out}{nothing}).",
        factor(median)
    )
}

/// A Markdown table whose columns are padded to line up; numbers to the right.
fn aligned(header: &[String], lines: &[Vec<String>]) -> String {
    let width = |i: usize| {
        std::iter::once(header)
            .chain(lines.iter().map(Vec::as_slice))
            .map(|l| l[i].chars().count())
            .max()
            .unwrap_or(0)
            .max(3)
    };
    let widths: Vec<usize> = (0..header.len()).map(width).collect();
    // empty columns say nothing
    let kept: Vec<usize> = (0..header.len()).filter(|i| *i < 2 || lines.iter().any(|l| !l[*i].is_empty())).collect();
    let row = |cells: &[String]| {
        let cell = |i: &usize| {
            let padding = " ".repeat(widths[*i] - cells[*i].chars().count());
            if *i < 2 { format!("{}{padding}", cells[*i]) } else { format!("{padding}{}", cells[*i]) }
        };
        format!("| {} |\n", kept.iter().map(cell).collect::<Vec<_>>().join(" | "))
    };
    let rule = |i: &usize| if *i < 2 { "-".repeat(widths[*i]) } else { format!("{}:", "-".repeat(widths[*i] - 1)) };
    let mut out = row(header);
    out += &format!("| {} |\n", kept.iter().map(rule).collect::<Vec<_>>().join(" | "));
    lines.iter().for_each(|l| out += &row(l));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_say_what_they_stand_on() {
        let line = |n: i32| -> Vec<(f64, f64)> { (0..n).map(|i| (3f64.powi(i), 0.5f64.powi(i))).collect() };
        let one = halving_sentence(&[line(4)], 0.0, "frame time");
        assert!(one.contains("multiplies the frame time by 3.00") && one.contains("log-log"), "{one}");
        let two = halving_sentence(&[line(2)], 0.0, "frame time");
        assert!(two.contains("only two points") && two.contains("3.00"), "{two}");
        let none = halving_sentence(&[line(1), vec![(1.0, 0.0)]], 0.0, "frame time");
        assert!(none.contains("cannot be said"), "{none}");
        let mixed = halving_sentence(&[line(4), line(5), line(1)], 0.0, "frame time");
        assert!(mixed.contains("median of 2 fronts") && mixed.contains("1 front of fewer"), "{mixed}");
    }
}
