//! The table at the end of a run, as Markdown that also reads well in a terminal: what each candidate costs and what it buys, the
//! best quality per cost marked, and what each halving of the error costs.

use super::draw_all::machine;
use super::pareto::{Halving, front, halving};
use super::scale::{Format, next_to_nothing};
use super::statistics::{CASE, ranks};
use super::table::{Row, Table, family, groups, name, varying_axes};
use crate::cost::Samples;

/// The cost that candidates are ranked by: frame time for the receivers' own vertices; where nothing was timed, SH vectors.
const FRAME: &str = "frame_us_vertices";
const VECTORS: &str = "sh_vectors";

/// For every row of a table whether it is on the front of nrmse against frame time (the receivers' vertices) of its scene, lights,
/// backend, adapter and frame: `true` or `false`, empty for rows without the two and for the rows of single receivers.
pub fn pareto_column(table: &Table) -> Vec<String> {
    let mut column = vec![String::new(); table.rows.len()];
    let rows: Vec<(usize, Row)> = table.rows().enumerate().collect();
    let mut seen = std::collections::HashSet::new();
    let mut cases: std::collections::BTreeMap<Vec<&str>, Vec<usize>> = Default::default();
    for (i, row) in &rows {
        let first = row.text("run").is_empty() || seen.insert((row.text("run"), row.text("frame")));
        if first && matches!(row.text("status"), "" | "ok") {
            let key = ["scene", "lights", "backend", "adapter", "frame"].map(|c| row.text(c));
            cases.entry(key.to_vec()).or_default().push(*i);
        }
    }
    for members in cases.values() {
        let points: Vec<_> = members.iter().map(|i| (rows[*i].1.number(FRAME), rows[*i].1.number("nrmse"))).collect();
        for ((i, point), on) in members.iter().zip(&points).zip(front(&points)) {
            if point.0.is_some() && point.1.is_some() {
                column[*i] = on.to_string();
            }
        }
    }
    column
}

/// One backend and adapter of the summary.
struct Part {
    heading: String,
    header: Vec<String>,
    lines: Vec<Vec<String>>,
    notes: Vec<String>,
}

/// Markdown of the whole table of results.
pub fn summary(table: &Table) -> String {
    let pooled = table.pooled();
    let mut out = String::new();
    // a family of random layouts would outweigh the named ones: rates over it are figures and claims of their own
    let named: Vec<Row> = pooled.rows().filter(|r| family(r.text("lights")).is_none()).collect();
    let rows = if named.is_empty() { pooled.rows().collect() } else { named };
    for group in groups(rows.into_iter(), &["backend", "adapter"]) {
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
    let varying = varying_axes(rows);
    let cases = groups(rows.iter().copied(), &CASE);
    let mut names: Vec<String> = Vec::new();
    for row in rows {
        let name = name(row, &varying);
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let of = |candidate: &str, column: &str| -> Vec<Option<f64>> {
        let row = |rows: &[Row]| rows.iter().find(|r| name(r, &varying) == candidate).and_then(|r| r.number(column));
        cases.iter().map(|c| row(&c.rows)).collect()
    };
    let median =
        |candidate: &str, column: &str| Samples(of(candidate, column).into_iter().flatten().collect()).median();

    // quality per cost: the least product of error and cost, ranked within each case. Direct evaluation is no rig and is not
    // ranked: where it is right up to rounding, any price would make it first
    let timed = rows.iter().any(|r| r.number(FRAME).is_some());
    let (cost, cost_name) = if timed { (FRAME, "frame time") } else { (VECTORS, "SH vectors") };
    let product = |candidate: &str| -> Vec<Option<f64>> {
        of(candidate, "nrmse").into_iter().zip(of(candidate, cost)).map(|(e, c)| Some(e? * c?)).collect()
    };
    let is_rig = |candidate: &str| of(candidate, VECTORS).iter().any(Option::is_some);
    let products: Vec<(usize, Vec<Option<f64>>)> = names
        .iter()
        .enumerate()
        .filter(|(_, n)| is_rig(n))
        .map(|(i, n)| (i, product(n)))
        .filter(|(_, p)| p.iter().any(Option::is_some))
        .collect();
    let ranked = ranks(&products.iter().map(|p| p.1.clone()).collect::<Vec<_>>());
    let mean = |r: &Vec<f64>| (!r.is_empty()).then(|| r.iter().sum::<f64>() / r.len() as f64);
    let mean_ranks: Vec<(usize, f64)> =
        products.iter().zip(&ranked).filter_map(|(p, r)| Some((p.0, mean(r)?))).collect();
    let best = mean_ranks.iter().map(|r| r.1).reduce(f64::min);
    let complete = ranked.first().map_or(0, Vec::len);

    let fronts: Vec<(Vec<&Row>, Vec<bool>)> = cases
        .iter()
        .map(|c| {
            let points: Vec<_> = c.rows.iter().map(|r| (r.number(cost), r.number("nrmse"))).collect();
            (c.rows.iter().collect(), front(&points))
        })
        .collect();
    let times_on_front = |candidate: &str| -> usize {
        let on = |(rows, on): &(Vec<&Row>, Vec<bool>)| {
            rows.iter().zip(on).any(|(r, on)| *on && name(r, &varying) == candidate)
        };
        fronts.iter().filter(|f| on(f)).count()
    };

    let write = |value: Option<f64>, format: Format| value.map_or(String::new(), |v| format.write(v));
    let time = |value: Option<f64>, seconds: f64| write(value.map(|v| v * seconds), Format::Unit("s"));
    let many = cases.len() > 1;
    let mut header: Vec<String> =
        ["", "rig", "SH vectors", "size", "setup", "evaluation / point", "frame, vertices", "nRMSE"]
            .map(String::from)
            .to_vec();
    if many {
        header.push("worst".into());
    }
    header.extend(["interpolation", "on the front"].map(String::from));
    let lines = names
        .iter()
        .enumerate()
        .map(|(i, n)| {
            let marked = mean_ranks.iter().any(|(r, rank)| *r == i && Some(*rank) == best);
            let mut line = vec![
                if marked { "★".to_owned() } else { String::new() },
                n.clone(),
                write(median(n, VECTORS), Format::Plain),
                write(median(n, "model_bytes"), Format::Unit("B")),
                time(median(n, "setup_us"), 1e-6),
                time(median(n, "eval_ns_per_point"), 1e-9),
                time(median(n, FRAME), 1e-6),
                write(median(n, "nrmse"), Format::Percent),
            ];
            if many {
                line.push(write(of(n, "nrmse").into_iter().flatten().reduce(f64::max), Format::Percent));
            }
            line.push(write(median(n, "interpolation_nrmse"), Format::Percent));
            line.push(format!("{} of {}", times_on_front(n), cases.len()));
            line
        })
        .collect();

    let mut notes = Vec::new();
    let medians = if many { format!("Medians over {} cases (scene × lights). ", cases.len()) } else { String::new() };
    if best.is_some() {
        notes.push(format!(
            "{medians}★ best quality per cost among the rigs: the lowest {}nRMSE × {cost_name}{}.",
            if complete > 1 { "mean rank by " } else { "" },
            if complete > 1 { format!(" over {complete} cases") } else { String::new() }
        ));
    }
    let floor = next_to_nothing(rows.iter().filter_map(|r| r.number("nrmse")));
    let members: Vec<Vec<(f64, f64)>> = fronts
        .iter()
        .map(|(rows, on)| {
            rows.iter()
                .zip(on)
                .filter(|(_, on)| **on)
                .filter_map(|(r, _)| Some((r.number(cost)?, r.number("nrmse")?)))
                .collect()
        })
        .collect();
    notes.push(halving_sentence(&members, floor, cost_name));
    Part { heading: heading.to_owned(), header, lines, notes }
}

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
