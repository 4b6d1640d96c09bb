//! The wrap lobe and its SH reconstructions, a panel a wrap.

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke};
use super::panel::{Axis, Panel};
use super::scale::{Format, Scale};
use super::style::{GREY, INK, SERIES, TICK};
use super::table::{Row, Table};

const CELL: (f64, f64) = (330.0, 262.0);
const TOP: f64 = 66.0;
const COLUMNS: usize = 2;
const LEGEND: f64 = 120.0;

/// From rows with `wrap,order,angle,value`; a row without an order is the lobe itself.
pub fn figure(rows: &[Row]) -> Option<Figure> {
    let drawn: Vec<&Row> = rows.iter().filter(|r| r.number("angle").is_some() && r.number("value").is_some()).collect();
    let mut wraps: Vec<&str> = Vec::new();
    let mut orders: Vec<&str> = Vec::new();
    for row in &drawn {
        if !wraps.contains(&row.text("wrap")) {
            wraps.push(row.text("wrap"));
        }
        if !row.text("order").is_empty() && !orders.contains(&row.text("order")) {
            orders.push(row.text("order"));
        }
    }
    if wraps.is_empty() {
        return None;
    }
    let columns = wraps.len().min(COLUMNS);
    let lines = wraps.len().div_ceil(COLUMNS);
    let title = "The wrap lobe and its SH by order";
    let subtitle = "f over the angle to the normal; a = 0 is Lambert, a = 1 the squared half-Lambert";
    let width = 24.0 + CELL.0 * columns as f64 + LEGEND;
    let mut drawing =
        Drawing::new(width.max(620.0), TOP + CELL.1 * lines as f64 + 8.0, format!("{title}. {subtitle}."));
    drawing.heading(title, subtitle);
    let values = || drawn.iter().filter_map(|r| r.number("value"));
    let mut data = Table::new(&["wrap", "order", "angle", "value"]);
    for (i, wrap) in wraps.iter().enumerate() {
        let corner = [12.0 + CELL.0 * (i % COLUMNS) as f64, TOP + CELL.1 * (i / COLUMNS) as f64];
        let x = Axis {
            label: "angle, degrees".into(),
            scale: Scale::Linear { low: 0.0, high: 180.0 },
            format: Format::Plain,
        };
        let y = Axis { label: String::new(), scale: Scale::linear(values(), true), format: Format::Plain };
        let title = format!("a = {wrap}");
        let panel = Panel::in_cell(Rect::new(corner[0], corner[1], CELL.0 - 8.0, CELL.1), &title, x, y);
        panel.draw(&mut drawing, &title);
        let zero = [panel.at(0.0, 0.0), panel.at(180.0, 0.0)];
        drawing.line(zero, Stroke::new(GREY, 1.0));
        let mut curve = |order: &str, stroke: Stroke| {
            let mine = drawn.iter().filter(|r| r.text("wrap") == *wrap && r.text("order") == order);
            let points: Vec<(f64, f64)> = mine.filter_map(|r| Some((r.number("angle")?, r.number("value")?))).collect();
            drawing.line(points.iter().map(|(x, y)| panel.at(*x, *y)).collect::<Vec<_>>(), stroke);
            for (angle, value) in points {
                data.push([(*wrap).to_owned(), order.to_owned(), angle.to_string(), value.to_string()]);
            }
        };
        for (k, order) in orders.iter().enumerate() {
            curve(order, Stroke::new(SERIES[k % SERIES.len()], 1.4));
        }
        curve("", Stroke::dashed(INK, 2.0, 5.0, 3.0));
    }
    let x = 12.0 + CELL.0 * columns as f64 + 8.0;
    let mut y = TOP + 34.0;
    let mut entry = |name: String, stroke: Stroke, colour| {
        drawing.line([[x, y], [x + 26.0, y]], stroke);
        drawing.text([x + 34.0, y + 0.5 * CAP * TICK], name, TICK, colour, Anchor::Start);
        y += 20.0;
    };
    entry("the lobe".into(), Stroke::dashed(INK, 2.0, 5.0, 3.0), INK);
    for (k, order) in orders.iter().enumerate() {
        let colour = SERIES[k % SERIES.len()];
        entry(format!("order {order}"), Stroke::new(colour, 1.4), colour);
    }
    Some(Figure::new(drawing, data))
}
