//! Results of kind `stability`: a row a curve and value of its parameter becomes one row a curve, its worst.

use maud::{Markup, html};

use super::answer::Answer;
use super::fronts::{SIZE, axes, listed};
use super::stored::Stored;
use crate::figure::drawing::Rect;
use crate::figure::panel::{Axis, Panel};
use crate::figure::scale::{Format, Scale};
use crate::figure::table::{Group, Row, Table, groups};

/// An f32 that keeps fewer than half of its digits: the root of its rounding unit, 2^-12; and the same of f64.
pub const HALF_OF_F32: f64 = 1.0 / 4096.0;
pub const HALF_OF_F64: f64 = 1.053_671_212_772_350_9e-8;

/// What is copied from a curve's first row, what is taken at its largest, and what is added up over it.
const WORDS: [&str; 9] = ["run", "experiment", "family", "parameter", "model", "order", "backend", "adapter", "status"];
const LARGEST: [&str; 5] = ["error", "error_with_inputs", "f64_error", "naive_error", "condition"];
const SUMS: [&str; 3] = ["non_finite", "naive_non_finite", "singular"];

/// The columns of a point that stand in the details of its curve.
pub const OF_POINT: [&str; 7] =
    ["t", "error", "error_with_inputs", "f64_error", "naive_error", "non_finite", "singular"];

/// A row a curve, if the table is one of hard cases.
pub fn curves(table: &Table) -> Option<Table> {
    let has = |name: &str| table.columns.iter().any(|c| c == name);
    if !(has("family") && has("t")) {
        return None;
    }
    let mut columns: Vec<&str> = WORDS.to_vec();
    columns.push("rig");
    columns.extend(LARGEST);
    columns.push("worst_t");
    columns.extend(SUMS);
    columns.push("note");
    let mut whole = Table::new(&columns);
    for curve in groups(table.rows(), &["run", "family", "model", "order", "backend"]) {
        let first = curve.rows[0];
        let numbers = |column: &'static str| curve.rows.iter().filter_map(move |r| r.number(column));
        let worst = curve.rows.iter().max_by(|a, b| {
            let of = |r: &Row| r.number("error").unwrap_or(f64::NEG_INFINITY);
            of(a).total_cmp(&of(b))
        });
        let cell = |column: &&'static str| match *column {
            "rig" => first.text("model").to_owned(),
            "worst_t" => worst.filter(|r| r.number("error").is_some()).map_or("", |r| r.text("t")).to_owned(),
            "note" => first.text("note").to_owned(),
            c if LARGEST.contains(&c) => numbers(c).reduce(f64::max).map_or(String::new(), |v| format!("{v:?}")),
            c if SUMS.contains(&c) => numbers(c).reduce(|a, b| a + b).map_or(String::new(), |v| v.to_string()),
            c => first.text(c).to_owned(),
        };
        whole.push(columns.iter().map(cell).collect::<Vec<_>>());
    }
    Some(whole)
}

/// How many cases hold, and which is the worst.
pub fn answer(stored: &Stored, question: String) -> Answer {
    let rows: Vec<Row> = stored.table.rows().collect();
    let measured: Vec<&Row> = rows.iter().filter(|r| r.number("error").is_some()).collect();
    let families = match groups(rows.iter().copied(), &["family"]).len() {
        1 => "one family".to_owned(),
        n => format!("{n} families"),
    };
    let finite = measured.iter().filter(|r| r.number("non_finite") == Some(0.0)).count();
    let kept = measured.iter().filter(|r| r.number("error").is_some_and(|e| e <= HALF_OF_F32)).count();
    let worst = measured.iter().max_by(|a, b| {
        let of = |r: &Row| r.number("error").unwrap_or(0.0);
        of(a).total_cmp(&of(b))
    });
    let first = format!(
        "Of {} curves in {families} {} measured, {finite} of them finite everywhere, and {kept} keep at least half of f32's digits wherever they go.",
        rows.len(),
        if measured.len() == rows.len() { "all were".to_owned() } else { format!("{} were", measured.len()) },
    );
    let second = match worst {
        Some(r) => format!(
            "The largest error of f32 is {}, of {} on {} in the family {} at {} = {}.",
            Format::Plain.write(r.number("error").unwrap_or(0.0)),
            curve_name(r),
            r.text("backend"),
            r.text("family"),
            r.text("parameter"),
            r.number("worst_t").map_or(String::new(), |t| Format::Plain.write(t)),
        ),
        None => "None has a number.".to_owned(),
    };
    Answer { question, parts: vec![(String::new(), format!("{first} {second}"))] }
}

fn curve_name(row: &Row) -> String {
    match row.text("order") {
        "" => row.text("model").to_owned(),
        order => format!("{} /{order}", row.text("model")),
    }
}

/// Error against the parameter, a plot a family, each with its title.
pub fn plots(points: &Table) -> Vec<(String, Markup)> {
    let rows = points.rows().filter(|r| r.number("error").is_some() && r.number("t").is_some());
    groups(rows, &["family"]).iter().map(|family| (family.key[0].to_owned(), plot(family))).collect()
}

fn plot(family: &Group) -> Markup {
    let number = |r: &Row, column: &str| r.number(column);
    let ts: Vec<f64> = family.rows.iter().filter_map(|r| number(r, "t")).collect();
    let scale = if ts.iter().all(|t| *t > 0.0) { Scale::log(ts) } else { Scale::linear(ts, false) };
    let errors: Vec<f64> =
        family.rows.iter().flat_map(|r| [number(r, "error"), number(r, "naive_error")]).flatten().collect();
    let label = family.rows[0].text("parameter").to_owned();
    let x = Axis { label: if label.is_empty() { "t".into() } else { label }, scale, format: Format::Plain };
    let y = Axis { label: "relative error".into(), scale: Scale::log(errors), format: Format::Plain };
    let panel = Panel::in_cell(Rect::new(0.0, 4.0, SIZE.0, SIZE.1 - 4.0), "", x, y);
    let line = |rows: &[Row], column: &str| -> Vec<[f64; 2]> {
        rows.iter().filter_map(|r| Some(panel.at(number(r, "t")?, number(r, column)?))).collect()
    };
    let curves = groups(family.rows.iter().copied(), &["run"]);
    let limit = panel.at(1.0, HALF_OF_F32)[1];
    html! {
        svg class="plot" viewBox=(format!("0 0 {} {}", SIZE.0, SIZE.1)) role="group"
            aria-label=(format!("relative error of f32 against {} for {} curves of {}", panel.x.label, curves.len(), family.key[0])) {
            (axes(&panel))
            @if limit > panel.area.y && limit < panel.area.bottom() {
                line class="limit" x1=(panel.area.x) x2=(panel.area.right()) y1=(limit) y2=(limit) {}
            }
            @for curve in &curves {
                @let first = curve.rows[0];
                @let worst = curve.rows.iter().filter_map(|r| number(r, "error")).fold(0.0, f64::max);
                @let says = format!("{} on {}: error up to {}", curve_name(&first), first.text("backend"), Format::Plain.write(worst));
                a href=(format!("#run-{}", curve.key[0])) aria-label=(says) {
                    @let naive = line(&curve.rows, "naive_error");
                    @if naive.len() > 1 { polyline class="curve naive" points=(listed(&naive)) {} }
                    polyline class=(format!("curve {}", first.text("backend"))) points=(listed(&line(&curve.rows, "error"))) {}
                    polyline class="reach" points=(listed(&line(&curve.rows, "error"))) {}
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_its_worst_point() {
        let text = "run,experiment,family,parameter,t,model,order,backend,adapter,status,non_finite,singular,error,f64_error,note\n\
            a,hard,touch,gap,1,constant,3,cpu,,ok,0,0,1e-7,,\na,hard,touch,gap,0.1,constant,3,cpu,,ok,2,1,3e-3,,\n\
            b,hard,touch,gap,,constant,3,gpu,,skipped,,,,,no adapter\n";
        let table = Table::parse(text).unwrap();
        let whole = curves(&table).unwrap();
        let rows: Vec<Row> = whole.rows().collect();
        assert_eq!(rows.len(), 2);
        let texts = ["rig", "error", "worst_t", "non_finite", "singular", "f64_error"].map(|c| rows[0].text(c));
        assert_eq!(texts, ["constant", "0.003", "0.1", "2", "1", ""]);
        assert_eq!(
            (rows[1].text("status"), rows[1].text("note"), rows[1].text("error")),
            ("skipped", "no adapter", "")
        );
        assert!(curves(&Table::parse("run,scene\na,b\n").unwrap()).is_none());
        assert_eq!(HALF_OF_F64, (f64::EPSILON / 2.0).sqrt());
        assert_eq!(plots(&table).len(), 1);
    }
}
