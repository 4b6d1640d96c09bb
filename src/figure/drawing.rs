use std::sync::LazyLock;

use ab_glyph::{Font, FontRef};

use super::style::{INK, MUTED, SUBTITLE, TITLE};

/// An opaque sRGB colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(pub u8, pub u8, pub u8);

impl Colour {
    /// This colour over white, `share` of it.
    pub fn tint(self, share: f64) -> Self {
        let mix = |v: u8| (255.0 + (f64::from(v) - 255.0) * share).round() as u8;
        Self(mix(self.0), mix(self.1), mix(self.2))
    }

    pub fn hex(self) -> String {
        format!("#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }

    /// Whether dark text reads better on it than white text (relative luminance as in WCAG 2).
    pub fn is_light(self) -> bool {
        let linear = |v: u8| f64::from(crate::picture::linear_of_srgb(f32::from(v) / 255.0));
        0.2126 * linear(self.0) + 0.7152 * linear(self.1) + 0.0722 * linear(self.2) > 0.2
    }
}

/// A line's look: width in pixels at 1x, and dash and gap where it is broken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    pub colour: Colour,
    pub width: f64,
    pub dash: Option<(f64, f64)>,
}

impl Stroke {
    pub const fn new(colour: Colour, width: f64) -> Self {
        Self { colour, width, dash: None }
    }
    pub const fn dashed(colour: Colour, width: f64, dash: f64, gap: f64) -> Self {
        Self { colour, width, dash: Some((dash, gap)) }
    }
}

/// Where a text's given x lies in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// What a drawing is made of. Coordinates are pixels at 1x, y down, from the top left.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    Line {
        points: Vec<[f64; 2]>,
        stroke: Stroke,
    },
    Polygon {
        points: Vec<[f64; 2]>,
        fill: Option<Colour>,
        stroke: Option<Stroke>,
    },
    Circle {
        center: [f64; 2],
        radius: f64,
        fill: Option<Colour>,
        stroke: Option<Stroke>,
    },
    /// `at` is on the baseline; `upwards` text runs from bottom to top.
    Text {
        at: [f64; 2],
        text: String,
        size: f64,
        colour: Colour,
        anchor: Anchor,
        upwards: bool,
    },
    /// Pixels stretched over a rectangle, sRGB.
    Image {
        rect: Rect,
        columns: usize,
        rows: usize,
        pixels: Vec<[u8; 3]>,
    },
}

/// A rectangle in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rect {
    pub x: f64,
    pub y: f64,
    pub width: f64,
    pub height: f64,
}

impl Rect {
    pub const fn new(x: f64, y: f64, width: f64, height: f64) -> Self {
        Self { x, y, width, height }
    }
    pub fn right(&self) -> f64 {
        self.x + self.width
    }
    pub fn bottom(&self) -> f64 {
        self.y + self.height
    }
    pub fn center(&self) -> [f64; 2] {
        [self.x + 0.5 * self.width, self.y + 0.5 * self.height]
    }
    pub fn grown(&self, by: f64) -> Self {
        Self::new(self.x - by, self.y - by, self.width + 2.0 * by, self.height + 2.0 * by)
    }
    /// Area shared with another rectangle.
    pub fn overlap(&self, other: &Rect) -> f64 {
        let w = self.right().min(other.right()) - self.x.max(other.x);
        let h = self.bottom().min(other.bottom()) - self.y.max(other.y);
        w.max(0.0) * h.max(0.0)
    }
    pub fn contains(&self, [x, y]: [f64; 2]) -> bool {
        x >= self.x && x <= self.right() && y >= self.y && y <= self.bottom()
    }
    /// The point of the rectangle that is nearest to a point.
    pub fn nearest(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x.clamp(self.x, self.right()), y.clamp(self.y, self.bottom())]
    }
    pub fn corners(&self) -> Vec<[f64; 2]> {
        vec![[self.x, self.y], [self.right(), self.y], [self.right(), self.bottom()], [self.x, self.bottom()]]
    }
}

/// A figure's list of shapes, back to front: drawn once, then written as SVG and as PNG.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    pub width: f64,
    pub height: f64,
    /// What the figure shows, for readers that cannot see it.
    pub description: String,
    /// Title and subtitle, whole, for captions.
    pub headings: [String; 2],
    pub items: Vec<Item>,
}

impl Drawing {
    pub fn new(width: f64, height: f64, description: impl Into<String>) -> Self {
        Self { width, height, description: description.into(), headings: Default::default(), items: Vec::new() }
    }

    pub fn line(&mut self, points: impl Into<Vec<[f64; 2]>>, stroke: Stroke) {
        let mut points: Vec<[f64; 2]> = points.into();
        points.retain(|place| place.iter().all(|c| c.is_finite()));
        self.items.push(Item::Line { points, stroke });
    }

    pub fn polygon(&mut self, points: impl Into<Vec<[f64; 2]>>, fill: Option<Colour>, stroke: Option<Stroke>) {
        self.items.push(Item::Polygon { points: points.into(), fill, stroke });
    }

    pub fn rect(&mut self, rect: Rect, fill: Option<Colour>, stroke: Option<Stroke>) {
        self.polygon(rect.corners(), fill, stroke);
    }

    pub fn circle(&mut self, center: [f64; 2], radius: f64, fill: Option<Colour>, stroke: Option<Stroke>) {
        self.items.push(Item::Circle { center, radius, fill, stroke });
    }

    /// A text whose baseline starts, is centred or ends at a point.
    pub fn text(&mut self, at: [f64; 2], text: impl Into<String>, size: f64, colour: Colour, anchor: Anchor) {
        self.items.push(Item::Text { at, text: text.into(), size, colour, anchor, upwards: false });
    }

    /// Title and subtitle at the top left, cut where the figure is too narrow for them.
    pub fn heading(&mut self, title: &str, subtitle: &str) {
        self.headings = [title.to_owned(), subtitle.to_owned()];
        let width = self.width - 32.0;
        self.text([16.0, 30.0], fitted(title, TITLE, width), TITLE, INK, Anchor::Start);
        self.text([16.0, 51.0], fitted(subtitle, SUBTITLE, width), SUBTITLE, MUTED, Anchor::Start);
    }

    /// A text that runs from bottom to top, its baseline on the right of its letters' feet.
    pub fn text_upwards(&mut self, at: [f64; 2], text: impl Into<String>, size: f64, colour: Colour, anchor: Anchor) {
        self.items.push(Item::Text { at, text: text.into(), size, colour, anchor, upwards: true });
    }

    pub fn image(&mut self, rect: Rect, columns: usize, rows: usize, pixels: Vec<[u8; 3]>) {
        assert_eq!(columns * rows, pixels.len(), "an image of {columns} x {rows}");
        self.items.push(Item::Image { rect, columns, rows, pixels });
    }

    /// The boxes of all texts, for tests: labels must not lie on each other.
    pub fn text_boxes(&self) -> Vec<(String, Rect)> {
        let boxes = self.items.iter().filter_map(|item| match item {
            Item::Text { at: [x, y], text, size, anchor, upwards, .. } => {
                let length = text_width(text, *size);
                let before = match anchor {
                    Anchor::Start => 0.0,
                    Anchor::Middle => 0.5 * length,
                    Anchor::End => length,
                };
                let rect = if *upwards {
                    Rect::new(x - CAP * size, y + before - length, CAP * size, length)
                } else {
                    Rect::new(x - before, y - CAP * size, length, CAP * size)
                };
                Some((text.clone(), rect))
            }
            _ => None,
        });
        boxes.collect()
    }
}

/// Height of capitals and digits over the size of a font.
pub const CAP: f64 = 0.729;

/// The font of all figures, vendored so that a figure is the same on every machine.
pub static FONT: LazyLock<FontRef<'static>> = LazyLock::new(|| {
    FontRef::try_from_slice(include_bytes!("../../assets/fonts/DejaVuSans.ttf")).expect("the vendored font")
});

/// Pixels that a text takes along its baseline.
pub fn text_width(text: &str, size: f64) -> f64 {
    let per_em = f64::from(FONT.units_per_em().expect("an outline font"));
    let mut width = 0.0;
    let mut before = None;
    for c in text.chars() {
        let glyph = FONT.glyph_id(c);
        if let Some(left) = before {
            width += f64::from(FONT.kern_unscaled(left, glyph));
        }
        width += f64::from(FONT.h_advance_unscaled(glyph));
        before = Some(glyph);
    }
    width * size / per_em
}

/// A text cut to a width, with an ellipsis where something was cut.
pub fn fitted(text: &str, size: f64, width: f64) -> String {
    if text_width(text, size) <= width {
        return text.to_owned();
    }
    let mut kept: Vec<char> = text.chars().collect();
    while kept.pop().is_some() {
        let shorter: String = kept.iter().collect::<String>().trim_end().to_owned() + "…";
        if text_width(&shorter, size) <= width {
            return shorter;
        }
    }
    String::new()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_grow_with_text_and_size() {
        assert!(text_width("lattice", 12.0) < text_width("lattice 8x4x2", 12.0));
        assert!((text_width("mixed", 24.0) / text_width("mixed", 12.0) - 2.0).abs() < 1e-9);
        let cut = fitted("a very long name of a rig", 12.0, 60.0);
        assert!(cut.ends_with('…') && text_width(&cut, 12.0) <= 60.0);
        assert_eq!(fitted("short", 12.0, 60.0), "short");
        for c in "⁻⁰¹²³⁴⁵⁶⁷⁸⁹µ×−…≤".chars() {
            assert!(FONT.glyph_id(c).0 != 0, "the font lacks {c}");
        }
    }
}
