//! A value a cell, rows by columns, with the numbers written in.

use super::Figure;
use super::colour_map::ColourMap;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke, fitted, text_width};
use super::scale::{Format, Scale};
use super::style::{AXIS, GREY, INK, LABEL, MUTED, SUBTITLE, TICK, TITLE, WHITE};
use super::table::Table;

/// A group of columns under one heading.
#[derive(Clone, Debug)]
pub struct ColumnGroup {
    pub name: String,
    pub columns: Vec<String>,
}

#[derive(Clone, Debug)]
pub struct HeatMap {
    pub title: String,
    pub subtitle: String,
    pub value_label: String,
    pub format: Format,
    pub scale: Scale,
    pub map: ColourMap,
    pub groups: Vec<ColumnGroup>,
    pub rows: Vec<String>,
    /// `values[row][column]`, columns counted over all groups.
    pub values: Vec<Vec<Option<f64>>>,
    /// The rows among which the smallest value of each column is marked, and what the mark means; no rows, no mark.
    pub marked: Vec<bool>,
    pub mark_label: String,
}

const CELL: (f64, f64) = (58.0, 28.0);
const GROUP_GAP: f64 = 10.0;
/// Length of the colour bar.
const BAR: f64 = 200.0;

impl HeatMap {
    pub fn figure(&self) -> Figure {
        let names: Vec<&String> = self.groups.iter().flat_map(|g| &g.columns).collect();
        let widest = self.rows.iter().map(|r| text_width(r, LABEL)).fold(40.0, f64::max).min(240.0);
        let tallest = names.iter().map(|n| text_width(n, TICK)).fold(20.0, f64::max).min(170.0);
        let left = widest + 30.0;
        let grouped = self.groups.len() > 1 || self.groups.first().is_some_and(|g| !g.name.is_empty());
        let top = 70.0 + tallest + if grouped { 30.0 } else { 8.0 };
        let gaps = GROUP_GAP * self.groups.len().saturating_sub(1) as f64;
        let plot = CELL.0 * names.len() as f64 + gaps;
        let head = text_width(&self.title, TITLE).max(text_width(&self.subtitle, SUBTITLE)) + 32.0;
        let marks = self.marked.contains(&true);
        let beside = |label: &str, extra: f64| if label.is_empty() { 0.0 } else { text_width(label, TICK) + extra };
        let legend = beside(&self.value_label, 14.0) + if marks { beside(&self.mark_label, 42.0) + 24.0 } else { 0.0 };
        let width = (left + plot + 24.0).max(head).max(left + BAR + legend + 16.0);
        let bottom = top + CELL.1 * self.rows.len() as f64;
        let description = format!("{}. {}. {}.", self.title, self.subtitle, self.value_label);
        let mut drawing = Drawing::new(width, bottom + 70.0, description);
        drawing.heading(&self.title, &self.subtitle);

        let mut data = Table::new(&["row", "group", "column", "value"]);
        let (mut x, mut column) = (left, 0);
        for group in &self.groups {
            let start = x;
            for name in &group.columns {
                let at = [x + 0.5 * CELL.0 + 0.5 * CAP * TICK, top - 8.0];
                drawing.text_upwards(at, fitted(name, TICK, tallest), TICK, MUTED, Anchor::Start);
                self.column(&mut drawing, [x, top], column);
                for (r, row) in self.rows.iter().enumerate() {
                    let value = self.values[r][column].map_or(String::new(), |v| v.to_string());
                    data.push([row.clone(), group.name.clone(), name.clone(), value]);
                }
                x += CELL.0;
                column += 1;
            }
            if grouped {
                let y = top - tallest - 16.0;
                drawing.line([[start + 2.0, y], [x - 2.0, y]], Stroke::new(AXIS, 1.0));
                let name = fitted(&group.name, LABEL, x - start);
                drawing.text([0.5 * (start + x), y - 6.0], name, LABEL, INK, Anchor::Middle);
            }
            x += GROUP_GAP;
        }
        for (r, row) in self.rows.iter().enumerate() {
            let y = top + (r as f64 + 0.5) * CELL.1 + 0.5 * CAP * LABEL;
            drawing.text([left - 10.0, y], fitted(row, LABEL, widest), LABEL, INK, Anchor::End);
        }
        let bar = ColourBar { scale: self.scale, map: self.map, format: self.format, label: self.value_label.clone() };
        bar.draw(&mut drawing, Rect::new(left, bottom + 18.0, BAR, 11.0));
        if marks {
            let x = left + BAR + 38.0 + text_width(&self.value_label, TICK);
            drawing.rect(Rect::new(x, bottom + 17.0, 18.0, 13.0), None, Some(Stroke::new(INK, 2.0)));
            drawing.text([x + 26.0, bottom + 28.0], &self.mark_label, TICK, MUTED, Anchor::Start);
        }
        Figure::new(drawing, data)
    }

    fn column(&self, drawing: &mut Drawing, [x, top]: [f64; 2], column: usize) {
        let is_marked = |r: usize| self.marked.get(r).is_some_and(|m| *m);
        let marked = (0..self.values.len()).filter(|r| is_marked(*r)).filter_map(|r| self.values[r][column]);
        let smallest = marked.fold(f64::MAX, f64::min);
        for (r, row) in self.values.iter().enumerate() {
            let cell = Rect::new(x, top + r as f64 * CELL.1, CELL.0, CELL.1).grown(-1.0);
            let [cx, cy] = cell.center();
            let baseline = [cx, cy + 0.5 * CAP * TICK];
            let Some(value) = row[column] else {
                drawing.text(baseline, "–", TICK, GREY, Anchor::Middle);
                continue;
            };
            let colour = self.map.at(self.scale.position(value));
            drawing.rect(cell, Some(colour), None);
            let ink = if colour.is_light() { INK } else { WHITE };
            // what stands in the scale's strip for zero has no digits that a reader needs
            let text = match value != 0.0 && value < self.scale.ends().0 {
                true => "≈ 0".to_owned(),
                false => self.format.write(two_digits(value)).replace(" %", ""),
            };
            drawing.text(baseline, text, TICK, ink, Anchor::Middle);
            if is_marked(r) && value == smallest {
                drawing.rect(cell.grown(-1.0), None, Some(Stroke::new(INK, 2.0)));
            }
        }
    }
}

/// Two significant digits, three from a tenth on: a cell has room for no more.
fn two_digits(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    let digits = 10f64.powf(1.0 - value.abs().log10().floor());
    (value * digits).round() / digits
}

/// What colours mean.
pub struct ColourBar {
    pub scale: Scale,
    pub map: ColourMap,
    pub format: Format,
    pub label: String,
}

impl ColourBar {
    pub fn draw(&self, drawing: &mut Drawing, bar: Rect) {
        const STEPS: usize = 128;
        let colours = (0..STEPS).map(|i| self.map.at((i as f64 + 0.5) / STEPS as f64));
        drawing.image(bar, STEPS, 1, colours.map(|c| [c.0, c.1, c.2]).collect());
        for tick in self.scale.ticks(bar.width, self.format, true) {
            let x = bar.x + bar.width * self.scale.position(tick.value);
            if let Some(label) = tick.label {
                drawing.line([[x, bar.bottom()], [x, bar.bottom() + 4.0]], Stroke::new(AXIS, 1.0));
                drawing.text([x, bar.bottom() + 7.0 + CAP * TICK], label, TICK, MUTED, Anchor::Middle);
            }
        }
        drawing.text([bar.right() + 14.0, bar.center()[1] + 0.5 * CAP * TICK], &self.label, TICK, INK, Anchor::Start);
    }
}
