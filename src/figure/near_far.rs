//! Near and far lights: what evaluating some lights directly buys, against how many they are.

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke};
use super::panel::{Axis, Panel};
use super::scale::{Format, Scale};
use super::style::{SERIES, TICK, WHITE};
use super::table::{Row, Table};

const CELL: (f64, f64) = (320.0, 300.0);
const TOP: f64 = 66.0;
const LEGEND: f64 = 210.0;

/// A panel: column, label, format.
const QUANTITIES: [(&str, &str, Format); 3] = [
    ("nrmse", "nRMSE", Format::Percent),
    ("jump", "largest jump between frames, over RMS", Format::Percent),
    ("frame_us_vertices", "time of a frame at the vertices", Format::Unit("s")),
];

/// A curve: all transitions of a rig whose names differ in what stands behind the last hyphen (`blend-0.02`, `blend-0.05`). A rig with
/// every light in it (`none`) begins each of its curves.
struct Series<'a> {
    rig: &'a str,
    family: &'a str,
    rows: Vec<Row<'a>>,
}

fn family(transition: &str) -> &str {
    transition.rsplit_once('-').map_or(transition, |(family, _)| family)
}

/// From the runs of one scene, layout and backend; nothing where no run has a transition.
pub fn figure(rows: &[Row<'_>], title: String, subtitle: String) -> Option<Figure> {
    let with_rig: Vec<Row> = rows.iter().copied().filter(|r| !r.text("transition").is_empty()).collect();
    let mut series: Vec<Series> = Vec::new();
    for row in with_rig.iter().filter(|r| r.text("transition") != "none") {
        let (rig, family) = (row.text("rig"), family(row.text("transition")));
        match series.iter_mut().find(|s| s.rig == rig && s.family == family) {
            Some(series) => series.rows.push(*row),
            None => series.push(Series { rig, family, rows: vec![*row] }),
        }
    }
    if series.is_empty() {
        return None;
    }
    for s in &mut series {
        let none = with_rig.iter().find(|r| r.text("rig") == s.rig && r.text("transition") == "none");
        s.rows.extend(none);
        let lights = |r: &Row| r.number("direct_lights").unwrap_or(0.0);
        s.rows.sort_by(|a, b| lights(a).total_cmp(&lights(b)));
    }
    let mut rigs: Vec<&str> = series.iter().map(|s| s.rig).collect();
    rigs.dedup();
    let mut families: Vec<&str> = Vec::new();
    for s in &series {
        if !families.contains(&s.family) {
            families.push(s.family);
        }
    }
    let points = |s: &Series, column: &str| -> Vec<(f64, f64)> {
        let factor = if column.contains("_us_") { 1e-6 } else { 1.0 };
        let lights = |r: &Row| r.number("direct_lights").unwrap_or(0.0);
        s.rows.iter().filter_map(|r| Some((lights(r), r.number(column)? * factor))).collect()
    };
    let panels: Vec<_> =
        QUANTITIES.iter().filter(|(column, ..)| series.iter().any(|s| points(s, column).len() > 1)).collect();
    let width = 24.0 + CELL.0 * panels.len() as f64 + LEGEND;
    let mut drawing = Drawing::new(width.max(700.0), TOP + CELL.1 + 10.0, format!("{title}. {subtitle}."));
    drawing.heading(&title, &subtitle);
    let mut data = Table::new(&["rig", "transition", "direct_lights", "quantity", "value"]);
    let stroke = |s: &Series| {
        let colour = SERIES[rigs.iter().position(|r| *r == s.rig).unwrap_or(0) % SERIES.len()];
        match families.iter().position(|f| *f == s.family).unwrap_or(0) {
            0 => Stroke::new(colour, 1.8),
            1 => Stroke::dashed(colour, 1.8, 6.0, 4.0),
            _ => Stroke::dashed(colour, 1.8, 2.0, 3.0),
        }
    };
    for (i, (column, label, format)) in panels.iter().enumerate() {
        let all: Vec<(f64, f64)> = series.iter().flat_map(|s| points(s, column)).collect();
        let x = Axis {
            label: "lights evaluated directly".into(),
            scale: Scale::linear(all.iter().map(|p| p.0), true),
            format: Format::Plain,
        };
        let y = Axis {
            label: (*label).into(),
            scale: Scale::log(all.iter().map(|p| p.1).collect::<Vec<_>>()),
            format: *format,
        };
        let panel = Panel::in_cell(Rect::new(12.0 + CELL.0 * i as f64, TOP, CELL.0 - 10.0, CELL.1), "", x, y);
        panel.draw(&mut drawing, "");
        for s in &series {
            let line: Vec<[f64; 2]> = points(s, column).into_iter().map(|(x, y)| panel.at(x, y)).collect();
            let stroke = stroke(s);
            drawing.line(line.clone(), stroke);
            for at in line {
                drawing.circle(at, 3.4, Some(stroke.colour), Some(Stroke::new(WHITE, 1.0)));
            }
            for row in &s.rows {
                let Some(value) = row.number(column) else { continue };
                let lights = row.text("direct_lights").to_owned();
                data.push([
                    s.rig.to_owned(),
                    row.text("transition").to_owned(),
                    lights,
                    (*column).to_owned(),
                    value.to_string(),
                ]);
            }
        }
    }
    let x = 12.0 + CELL.0 * panels.len() as f64 + 6.0;
    for (i, s) in series.iter().enumerate() {
        let y = TOP + 20.0 + 20.0 * i as f64;
        drawing.line([[x, y], [x + 30.0, y]], stroke(s));
        let name = format!("{}, {}", s.rig, s.family);
        drawing.text([x + 38.0, y + 0.5 * CAP * TICK], name, TICK, stroke(s).colour, Anchor::Start);
    }
    Some(Figure::new(drawing, data))
}
