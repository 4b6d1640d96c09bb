use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke, text_width};
use super::scale::{Format, Scale};
use super::style::{AXIS, GRID, INK, LABEL, MUTED, PANEL_TITLE, TICK};

/// An axis of a panel.
#[derive(Clone, Debug)]
pub struct Axis {
    pub label: String,
    pub scale: Scale,
    pub format: Format,
}

/// One pair of axes in a figure.
#[derive(Clone, Debug)]
pub struct Panel {
    /// The plot area, inside the axes.
    pub area: Rect,
    pub x: Axis,
    pub y: Axis,
}

impl Panel {
    /// A panel that fills `cell`, its margins taken for title, ticks and labels.
    pub fn in_cell(cell: Rect, title: &str, x: Axis, y: Axis) -> Self {
        let top = if title.is_empty() { 8.0 } else { PANEL_TITLE + 14.0 };
        let bottom = TICK + 9.0 + if x.label.is_empty() { 0.0 } else { LABEL + 9.0 };
        let height = cell.height - top - bottom;
        let widest = y
            .scale
            .ticks(height, y.format, false)
            .iter()
            .filter_map(|t| t.label.as_ref())
            .map(|t| text_width(t, TICK))
            .fold(0.0, f64::max);
        let left = widest + 9.0 + if y.label.is_empty() { 0.0 } else { LABEL + 10.0 };
        Self { area: Rect::new(cell.x + left, cell.y + top, cell.width - left - 10.0, height), x, y }
    }

    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        [
            self.area.x + self.area.width * self.x.scale.position(x),
            self.area.bottom() - self.area.height * self.y.scale.position(y),
        ]
    }

    /// Grid and axes, to be drawn before the data.
    pub fn draw(&self, drawing: &mut Drawing, title: &str) {
        let a = &self.area;
        if !title.is_empty() {
            drawing.text([a.x, a.y - 10.0], title, PANEL_TITLE, INK, Anchor::Start);
        }
        for tick in self.x.scale.ticks(a.width, self.x.format, true) {
            let x = self.at(tick.value, 0.0)[0];
            match tick.label {
                Some(label) => {
                    drawing.line([[x, a.y], [x, a.bottom()]], Stroke::new(GRID, 1.0));
                    drawing.line([[x, a.bottom()], [x, a.bottom() + 4.0]], Stroke::new(AXIS, 1.0));
                    drawing.text([x, a.bottom() + 7.0 + CAP * TICK], label, TICK, MUTED, Anchor::Middle);
                }
                None => drawing.line([[x, a.bottom()], [x, a.bottom() + 2.5]], Stroke::new(AXIS, 0.75)),
            }
        }
        for tick in self.y.scale.ticks(a.height, self.y.format, false) {
            let y = self.at(0.0, tick.value)[1];
            match tick.label {
                Some(label) => {
                    drawing.line([[a.x, y], [a.right(), y]], Stroke::new(GRID, 1.0));
                    drawing.line([[a.x - 4.0, y], [a.x, y]], Stroke::new(AXIS, 1.0));
                    drawing.text([a.x - 7.0, y + 0.5 * CAP * TICK], label, TICK, MUTED, Anchor::End);
                }
                None => drawing.line([[a.x - 2.5, y], [a.x, y]], Stroke::new(AXIS, 0.75)),
            }
        }
        drawing.line([[a.x, a.y], [a.x, a.bottom()], [a.right(), a.bottom()]], Stroke::new(AXIS, 1.0));
        self.draw_breaks(drawing);
        if !self.x.label.is_empty() {
            let y = a.bottom() + 7.0 + TICK + 9.0 + CAP * LABEL;
            drawing.text([a.center()[0], y], &self.x.label, LABEL, INK, Anchor::Middle);
        }
        if !self.y.label.is_empty() {
            let widest = self.y.scale.ticks(a.height, self.y.format, false);
            let widest =
                widest.iter().filter_map(|t| t.label.as_ref()).map(|t| text_width(t, TICK)).fold(0.0, f64::max);
            drawing.text_upwards([a.x - widest - 16.0, a.center()[1]], &self.y.label, LABEL, INK, Anchor::Middle);
        }
    }

    /// Two strokes across an axis where a strip for zero is cut from a logarithmic scale.
    fn draw_breaks(&self, drawing: &mut Drawing) {
        let a = &self.area;
        let cut = |scale: &Scale| match scale {
            Scale::Log { zero, .. } if *zero > 0.0 => Some(0.8 * zero),
            _ => None,
        };
        if let Some(t) = cut(&self.x.scale) {
            let x = a.x + t * a.width;
            drawing.polygon(
                [
                    [x - 3.0, a.bottom() + 4.0],
                    [x + 1.0, a.bottom() - 4.0],
                    [x + 4.0, a.bottom() - 4.0],
                    [x, a.bottom() + 4.0],
                ],
                Some(super::style::WHITE),
                None,
            );
            for shift in [-3.0, 0.0] {
                drawing
                    .line([[x + shift, a.bottom() + 4.0], [x + shift + 4.0, a.bottom() - 4.0]], Stroke::new(AXIS, 1.0));
            }
        }
        if let Some(t) = cut(&self.y.scale) {
            let y = a.bottom() - t * a.height;
            drawing.polygon(
                [[a.x - 4.0, y + 3.0], [a.x + 4.0, y - 1.0], [a.x + 4.0, y - 4.0], [a.x - 4.0, y]],
                Some(super::style::WHITE),
                None,
            );
            for shift in [0.0, 3.0] {
                drawing.line([[a.x - 4.0, y + shift], [a.x + 4.0, y + shift - 4.0]], Stroke::new(AXIS, 1.0));
            }
        }
    }
}
