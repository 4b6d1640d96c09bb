//! Hard cases: error against the parameter of a family, a panel a model, a curve a backend.

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke, text_width};
use super::panel::{Axis, Panel};
use super::scale::{Format, Scale};
use super::style::{GREY, INK, SERIES, TICK};
use super::table::{Row, Table};

/// The curves: what the legend says, the column, the backend it is taken of (both where none).
const CURVES: [(&str, &str, Option<&str>); 4] = [
    ("f32 on the CPU, against f64", "error", Some("cpu")),
    ("f32 on the GPU, against f64", "error", Some("gpu")),
    ("f64, against an independent route", "f64_error", None),
    ("the naive form in f32, against f64", "naive_error", None),
];

const PANEL: (f64, f64) = (330.0, 250.0);
const TOP: f64 = 92.0;
const COLUMNS: usize = 3;

/// Errors below this are drawn at it: nothing is smaller than f64's rounding.
const LEAST: f64 = 1e-17;

/// The families of a table of hard cases, in its order.
pub fn families(table: &Table) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for row in table.rows() {
        let family = row.text("family");
        if !family.is_empty() && !names.iter().any(|name| name == family) {
            names.push(family.to_owned());
        }
    }
    names
}

/// The figure of a family; none where nothing was measured of it.
pub fn family_figure(table: &Table, family: &str) -> Option<Figure> {
    let rows: Vec<Row> = table.rows().filter(|r| r.text("family") == family && r.text("status") == "ok").collect();
    let first = rows.first()?;
    let mut models: Vec<&str> = Vec::new();
    for row in &rows {
        if !models.contains(&row.text("model")) {
            models.push(row.text("model"));
        }
    }
    let lines = models.len().div_ceil(COLUMNS);
    let columns = models.len().min(COLUMNS);
    let legend: f64 = CURVES.iter().map(|(name, ..)| text_width(name, TICK) + 48.0).sum();
    let width = (columns as f64 * PANEL.0 + 24.0).max(legend + 32.0);
    let title = format!("Hard cases: {}", family.replace(['-', '_'], " "));
    let subtitle =
        "relative error, the largest over points, channels and orders; a dot at the bottom is no error at all";
    let mut drawing = Drawing::new(width, TOP + lines as f64 * PANEL.1 + 12.0, format!("{title}. {subtitle}."));
    drawing.heading(&title, subtitle);
    let mut x = 16.0;
    for (i, (name, ..)) in CURVES.iter().enumerate() {
        drawing.line([[x, 76.0], [x + 24.0, 76.0]], stroke(i));
        drawing.circle([x + 12.0, 76.0], 3.0, Some(colour(i)), None);
        drawing.text([x + 31.0, 76.0 + 0.5 * CAP * TICK], *name, TICK, INK, Anchor::Start);
        x += text_width(name, TICK) + 48.0;
    }
    let mut data = Table::new(&["model", "curve", "t", "error"]);
    let values = |model: &str, (_, column, backend): (&str, &str, Option<&str>)| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = Vec::new();
        for row in rows.iter().filter(|r| r.text("model") == model && backend.is_none_or(|b| r.text("backend") == b)) {
            let (Some(t), Some(error)) = (row.number("t"), row.number(column)) else { continue };
            match points.iter_mut().find(|(known, _)| *known == t) {
                Some((_, most)) => *most = most.max(error),
                None => points.push((t, error)),
            }
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let all: Vec<f64> =
        models.iter().flat_map(|m| CURVES.iter().flat_map(|c| values(m, *c))).map(|(_, e)| e.max(LEAST)).collect();
    let ts: Vec<f64> = rows.iter().filter_map(|r| r.number("t")).collect();
    let positive = ts.iter().all(|t| *t >= 0.0) && ts.iter().any(|t| *t > 0.0);
    for (index, model) in models.iter().enumerate() {
        let cell = Rect::new(
            12.0 + (index % COLUMNS) as f64 * PANEL.0,
            TOP + (index / COLUMNS) as f64 * PANEL.1,
            PANEL.0 - 8.0,
            PANEL.1 - 8.0,
        );
        let x = Axis {
            label: first.text("parameter").to_owned(),
            scale: if positive { Scale::log(ts.iter().copied()) } else { Scale::linear(ts.iter().copied(), false) },
            format: Format::Plain,
        };
        let y = Axis { label: String::new(), scale: Scale::log(all.iter().copied()), format: Format::Plain };
        let panel = Panel::in_cell(cell, model, x, y);
        panel.draw(&mut drawing, model);
        for (i, curve) in CURVES.iter().enumerate().rev() {
            let points = values(model, *curve);
            for (t, error) in &points {
                data.push([(*model).to_owned(), curve.0.to_owned(), t.to_string(), error.to_string()]);
            }
            let line: Vec<[f64; 2]> = points.iter().map(|(t, e)| panel.at(*t, e.max(LEAST))).collect();
            drawing.line(line.clone(), stroke(i));
            for at in line {
                drawing.circle(at, 2.2, Some(colour(i)), None);
            }
        }
    }
    Some(Figure::new(drawing, data))
}

fn colour(curve: usize) -> super::drawing::Colour {
    if curve == 3 { GREY } else { SERIES[curve] }
}

fn stroke(curve: usize) -> Stroke {
    match curve {
        1 => Stroke::dashed(colour(1), 1.8, 6.0, 4.0),
        3 => Stroke::dashed(colour(3), 1.5, 2.0, 3.0),
        _ => Stroke::new(colour(curve), 1.8),
    }
}
