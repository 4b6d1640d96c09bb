//! Volumes of one scene cut across, side by side: cells, samples and the geometry around them.

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke, fitted};
use super::style::{ACCENT, GREY, INK, LABEL, MUTED, PANEL_TITLE, SECOND, TICK};
use super::table::Table;

/// One volume.
#[derive(Clone, Debug)]
pub struct SectionPanel {
    pub name: String,
    pub run: String,
    /// What stands under its name.
    pub says: String,
    /// kind, u0, v0, u1, v1; kinds are cell, sample, inside and wall.
    pub items: Vec<(String, [f64; 4])>,
}

#[derive(Clone, Debug)]
pub struct Sections {
    pub title: String,
    pub subtitle: String,
    pub panels: Vec<SectionPanel>,
}

const SIDE: f64 = 250.0;
const GAP: f64 = 22.0;
const HEAD: f64 = 46.0;
const TOP: f64 = 92.0;

impl Sections {
    pub fn figure(&self) -> Figure {
        let all =
            || self.panels.iter().flat_map(|panel| &panel.items).flat_map(|(_, [a, b, c, d])| [[*a, *b], [*c, *d]]);
        let bound = |axis: usize, pick: fn(f64, f64) -> f64, start: f64| all().map(|p| p[axis]).fold(start, pick);
        let low = [bound(0, f64::min, f64::INFINITY), bound(1, f64::min, f64::INFINITY)];
        let high = [bound(0, f64::max, f64::NEG_INFINITY), bound(1, f64::max, f64::NEG_INFINITY)];
        let extent = [high[0] - low[0], high[1] - low[1]];
        // long rooms lie down
        let turned = extent[1] > 1.6 * extent[0];
        let [wide, tall] = if turned { [extent[1], extent[0]] } else { extent };
        let columns = if wide > 2.0 * tall { 2 } else { 4 };
        let width = if columns == 2 { 2.0 * SIDE + GAP } else { SIDE };
        let scale = (width / wide).min(SIDE / tall);
        let height = tall * scale;
        let rows = self.panels.len().div_ceil(columns);
        let used = self.panels.len().min(columns).max(if columns == 2 { 1 } else { 3 });
        let mut drawing = Drawing::new(
            32.0 + used as f64 * (width + GAP) - GAP,
            TOP + rows as f64 * (height + HEAD),
            format!("{}. {}.", self.title, self.subtitle),
        );
        drawing.heading(&self.title, &self.subtitle);
        legend(&mut drawing);
        let mut data = Table::new(&["panel", "run", "kind", "u0", "v0", "u1", "v1"]);
        for (index, panel) in self.panels.iter().enumerate() {
            let x = 16.0 + (index % columns) as f64 * (width + GAP);
            let y = TOP + (index / columns) as f64 * (height + HEAD);
            drawing.text([x, y + 14.0], fitted(&panel.name, PANEL_TITLE, width), PANEL_TITLE, INK, Anchor::Start);
            drawing.text([x, y + 31.0], fitted(&panel.says, TICK, width), TICK, MUTED, Anchor::Start);
            let at = |u: f64, v: f64| {
                let [u, v] = [(u - low[0]) * scale, (v - low[1]) * scale];
                if turned { [x + v, y + HEAD - 6.0 + u] } else { [x + u, y + HEAD - 6.0 + v] }
            };
            for (kind, [a, b, c, d]) in &panel.items {
                data.push(
                    [panel.name.clone(), panel.run.clone(), kind.clone()]
                        .into_iter()
                        .chain([a, b, c, d].map(|number| number.to_string())),
                );
                let (p, q) = (at(*a, *b), at(*c, *d));
                match kind.as_str() {
                    "wall" => drawing.line([p, q], Stroke::new(INK, 2.2)),
                    "cell" => {
                        let rect = Rect::new(p[0].min(q[0]), p[1].min(q[1]), (q[0] - p[0]).abs(), (q[1] - p[1]).abs());
                        drawing.rect(rect, None, Some(Stroke::new(GREY, 0.7)));
                    }
                    "inside" => drawing.circle(p, 2.2, Some(SECOND), None),
                    _ => drawing.circle(p, 1.7, Some(ACCENT), None),
                }
            }
        }
        Figure::new(drawing, data)
    }
}

fn legend(drawing: &mut Drawing) {
    let y = 76.0;
    let mut x = 16.0;
    for (colour, text) in [(ACCENT, "sample"), (SECOND, "sample inside geometry")] {
        drawing.circle([x + 4.0, y], 3.5, Some(colour), None);
        drawing.text([x + 14.0, y + 0.5 * CAP * TICK], text, TICK, INK, Anchor::Start);
        x += 30.0 + super::drawing::text_width(text, LABEL);
    }
    drawing.line([[x, y], [x + 18.0, y]], Stroke::new(INK, 2.2));
    drawing.text([x + 25.0, y + 0.5 * CAP * TICK], "static geometry", TICK, INK, Anchor::Start);
}
