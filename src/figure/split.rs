//! Where the error comes from: what the order cuts off, what the rig adds, and both together, a row a candidate.

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke, fitted, text_width};
use super::scale::{Format, Scale};
use super::style::{ACCENT, AXIS, GREY, GRID, INK, LABEL, MUTED, PANEL_TITLE, SECOND, TICK, TITLE};
use super::table::Table;

/// The three errors of a candidate; none where one has no meaning.
#[derive(Clone, Debug, PartialEq)]
pub struct SplitRow {
    pub name: String,
    pub truncation: Option<f64>,
    pub interpolation: Option<f64>,
    pub total: Option<f64>,
}

/// One case: a light layout, say.
#[derive(Clone, Debug)]
pub struct SplitPanel {
    pub title: String,
    pub rows: Vec<SplitRow>,
}

#[derive(Clone, Debug)]
pub struct Split {
    pub title: String,
    pub subtitle: String,
    pub panels: Vec<SplitPanel>,
}

const ROW: f64 = 27.0;
const BAR: f64 = 8.0;
const PLOT: f64 = 290.0;
const HEAD: f64 = 34.0;
const FOOT: f64 = 34.0;
const TOP: f64 = 92.0;

impl Split {
    pub fn figure(&self) -> Figure {
        let rows = || self.panels.iter().flat_map(|p| &p.rows);
        let names = rows().map(|r| text_width(&r.name, LABEL)).fold(40.0, f64::max).min(220.0);
        let column = names + 30.0 + PLOT;
        let columns = self.panels.len().clamp(1, 2);
        let heights: Vec<f64> = self
            .panels
            .chunks(columns)
            .map(|line| HEAD + FOOT + ROW * line.iter().map(|p| p.rows.len()).max().unwrap_or(0) as f64)
            .collect();
        let width = (columns as f64 * (column + 24.0) + 16.0).max(text_width(&self.title, TITLE) + 32.0).max(560.0);
        let description = format!("{}. {}.", self.title, self.subtitle);
        let mut drawing = Drawing::new(width, TOP + heights.iter().sum::<f64>(), description);
        drawing.heading(&self.title, &self.subtitle);
        legend(&mut drawing);

        let mut data = Table::new(&["panel", "candidate", "truncation_nrmse", "interpolation_nrmse", "nrmse"]);
        let mut top = TOP;
        for (line, height) in self.panels.chunks(columns).zip(heights) {
            for (i, panel) in line.iter().enumerate() {
                let x = 16.0 + i as f64 * (column + 24.0) + names + 12.0;
                let area = Rect::new(x, top + HEAD, PLOT, ROW * panel.rows.len() as f64);
                panel.draw(&mut drawing, area, names);
                for row in &panel.rows {
                    let cell = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
                    data.push([
                        panel.title.clone(),
                        row.name.clone(),
                        cell(row.truncation),
                        cell(row.interpolation),
                        cell(row.total),
                    ]);
                }
            }
            top += height;
        }
        Figure::new(drawing, data)
    }
}

fn legend(drawing: &mut Drawing) {
    let mut x = 16.0;
    let y = 76.0;
    for (colour, text) in [(SECOND, "truncation: what the order costs"), (ACCENT, "interpolation: what the rig costs")]
    {
        drawing.rect(Rect::new(x, y - 4.0, 20.0, BAR), Some(colour), None);
        drawing.text([x + 27.0, y + 0.5 * CAP * TICK], text, TICK, INK, Anchor::Start);
        x += 27.0 + text_width(text, TICK) + 24.0;
    }
    drawing.line([[x + 2.0, y - 8.0], [x + 2.0, y + 8.0]], Stroke::new(INK, 2.0));
    drawing.text([x + 12.0, y + 0.5 * CAP * TICK], "nRMSE: both together", TICK, INK, Anchor::Start);
}

impl SplitPanel {
    fn draw(&self, drawing: &mut Drawing, area: Rect, names: f64) {
        let values = self.rows.iter().flat_map(|r| [r.truncation, r.interpolation, r.total]).flatten();
        let scale = Scale::linear(values, true);
        let x = |v: f64| area.x + area.width * scale.position(v);
        drawing.text([area.x, area.y - 10.0], &self.title, PANEL_TITLE, INK, Anchor::Start);
        for tick in scale.ticks(area.width, Format::Percent, true) {
            if let Some(label) = tick.label {
                let x = x(tick.value);
                drawing.line([[x, area.y], [x, area.bottom()]], Stroke::new(GRID, 1.0));
                drawing.text([x, area.bottom() + 6.0 + CAP * TICK], label, TICK, MUTED, Anchor::Middle);
            }
        }
        for (i, row) in self.rows.iter().enumerate() {
            let y = area.y + (i as f64 + 0.5) * ROW;
            let name = fitted(&row.name, LABEL, names);
            drawing.text([area.x - 9.0, y + 0.5 * CAP * LABEL], name, LABEL, INK, Anchor::End);
            for (value, colour, top) in [(row.truncation, SECOND, y - BAR - 0.5), (row.interpolation, ACCENT, y + 0.5)]
            {
                if let Some(value) = value {
                    drawing.rect(Rect::new(area.x, top, x(value) - area.x, BAR), Some(colour), None);
                }
            }
            match row.total {
                Some(total) => {
                    drawing.line([[x(total), y - 11.0], [x(total), y + 11.0]], Stroke::new(INK, 2.0));
                }
                None => {
                    let after = x(row.truncation.unwrap_or(0.0).max(row.interpolation.unwrap_or(0.0))) + 8.0;
                    drawing.text([after, y + 0.5 * CAP * TICK], "nRMSE: no value", TICK, GREY, Anchor::Start);
                }
            }
        }
        drawing.line([[area.x, area.y], [area.x, area.bottom()]], Stroke::new(AXIS, 1.0));
    }
}
