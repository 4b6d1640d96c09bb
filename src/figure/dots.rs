//! Dot and whisker charts: one row a name, one panel a quantity; ranks, win rates, distributions.

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke, fitted, text_width};
use super::scale::{Format, Scale};
use super::style::{ACCENT, AXIS, GREY, GRID, INK, LABEL, MUTED, PANEL_TITLE, SUBTITLE, TICK, TITLE, WHITE};
use super::table::Table;

/// A dot, its whisker, and what it sums up.
#[derive(Clone, Debug, PartialEq)]
pub struct Dot {
    pub value: f64,
    pub interval: Option<(f64, f64)>,
    /// The single values, drawn as faint strokes.
    pub each: Vec<f64>,
}

/// One quantity of all rows.
#[derive(Clone, Debug)]
pub struct DotPanel {
    pub title: String,
    pub label: String,
    pub format: Format,
    pub scale: Scale,
    /// A line to compare with.
    pub guide: Option<f64>,
    /// What stands where there is no value.
    pub absent: String,
    /// One for each name; none where it has no value.
    pub dots: Vec<Option<Dot>>,
}

#[derive(Clone, Debug)]
pub struct Dots {
    pub title: String,
    pub subtitle: String,
    pub names: Vec<String>,
    pub panels: Vec<DotPanel>,
}

const ROW: f64 = 24.0;
const PANEL: f64 = 250.0;
const GAP: f64 = 34.0;
const TOP: f64 = 96.0;

impl Dots {
    pub fn figure(&self) -> Figure {
        let names = self.names.iter().map(|n| text_width(n, LABEL)).fold(40.0, f64::max).min(240.0);
        let left = names + 34.0;
        let bottom = TOP + ROW * self.names.len() as f64;
        let panels = self.panels.len() as f64;
        let head = text_width(&self.title, TITLE).max(text_width(&self.subtitle, SUBTITLE)) + 32.0;
        let width = (left + panels * PANEL + (panels - 1.0) * GAP + 28.0).max(head);
        let description = format!("{}. {}.", self.title, self.subtitle);
        let mut drawing = Drawing::new(width, bottom + 54.0, description);
        drawing.heading(&self.title, &self.subtitle);
        for (i, name) in self.names.iter().enumerate() {
            let y = row(i) + 0.5 * CAP * LABEL;
            drawing.text([left - 12.0, y], fitted(name, LABEL, names), LABEL, INK, Anchor::End);
        }
        for (p, panel) in self.panels.iter().enumerate() {
            let area = Rect::new(left + p as f64 * (PANEL + GAP), TOP, PANEL, bottom - TOP);
            panel.draw(&mut drawing, area);
        }
        let mut data = Table::new(&["panel", "name", "value", "low", "high", "each"]);
        for panel in &self.panels {
            for (name, dot) in self.names.iter().zip(&panel.dots) {
                let Some(dot) = dot else { continue };
                let end = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
                data.push([
                    panel.title.clone(),
                    name.clone(),
                    dot.value.to_string(),
                    end(dot.interval.map(|i| i.0)),
                    end(dot.interval.map(|i| i.1)),
                    dot.each.iter().map(|v| v.to_string()).collect::<Vec<_>>().join(" "),
                ]);
            }
        }
        Figure::new(drawing, data)
    }
}

fn row(i: usize) -> f64 {
    TOP + (i as f64 + 0.5) * ROW
}

impl DotPanel {
    fn draw(&self, drawing: &mut Drawing, area: Rect) {
        let x = |v: f64| area.x + area.width * self.scale.position(v).clamp(0.0, 1.0);
        drawing.text([area.x, area.y - 14.0], &self.title, PANEL_TITLE, INK, Anchor::Start);
        for tick in self.scale.ticks(area.width, self.format, true) {
            if let Some(label) = tick.label {
                let x = x(tick.value);
                drawing.line([[x, area.y], [x, area.bottom()]], Stroke::new(GRID, 1.0));
                drawing.text([x, area.bottom() + 7.0 + CAP * TICK], label, TICK, MUTED, Anchor::Middle);
            }
        }
        for i in 0..self.dots.len() {
            drawing.line([[area.x, row(i)], [area.right(), row(i)]], Stroke::new(GRID, 0.75));
        }
        drawing.line([[area.x, area.bottom()], [area.right(), area.bottom()]], Stroke::new(AXIS, 1.0));
        if let Some(guide) = self.guide {
            drawing.line([[x(guide), area.y], [x(guide), area.bottom()]], Stroke::dashed(MUTED, 1.0, 4.0, 3.0));
        }
        drawing.text([area.center()[0], area.bottom() + 40.0], &self.label, LABEL, INK, Anchor::Middle);
        for (i, dot) in self.dots.iter().enumerate() {
            let y = row(i);
            let Some(dot) = dot else {
                drawing.text([area.x + 4.0, y + 0.5 * CAP * TICK], &self.absent, TICK, GREY, Anchor::Start);
                continue;
            };
            for v in &dot.each {
                drawing.line([[x(*v), y - 4.0], [x(*v), y + 4.0]], Stroke::new(ACCENT.tint(0.35), 1.0));
            }
            if let Some((low, high)) = dot.interval {
                drawing.line([[x(low), y], [x(high), y]], Stroke::new(ACCENT, 2.0));
            }
            drawing.circle([x(dot.value), y], 5.0, Some(ACCENT), Some(Stroke::new(WHITE, 1.0)));
        }
    }
}
