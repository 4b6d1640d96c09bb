use std::f64::consts::{PI, TAU};

use ab_glyph::{Font, PxScale, point};
use ab_glyph_rasterizer::Rasterizer;
use image::ImageEncoder as _;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};

use super::drawing::{Anchor, Colour, Drawing, FONT, Item, Rect, Stroke, text_width};

/// PNG bytes of a drawing at `scale` pixels a unit; the same bytes for the same drawing.
pub fn png(drawing: &Drawing, scale: f64) -> Vec<u8> {
    let canvas = Canvas::of(drawing, scale);
    encode_png(canvas.width, canvas.height, &canvas.pixels)
}

/// 8-bit sRGB as PNG.
pub(super) fn encode_png(width: usize, height: usize, pixels: &[[u8; 3]]) -> Vec<u8> {
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive)
        .write_image(pixels.as_flattened(), width as u32, height as u32, image::ExtendedColorType::Rgb8)
        .expect("PNG of an image in memory");
    out
}

/// Pixels that shapes are laid on with their exact coverage.
struct Canvas {
    width: usize,
    height: usize,
    scale: f64,
    pixels: Vec<[u8; 3]>,
    rasterizer: Rasterizer,
}

impl Canvas {
    fn of(drawing: &Drawing, scale: f64) -> Self {
        let (width, height) = ((drawing.width * scale).ceil() as usize, (drawing.height * scale).ceil() as usize);
        let pixels = vec![[255; 3]; width * height];
        let mut canvas = Self { width, height, scale, pixels, rasterizer: Rasterizer::new(1, 1) };
        for item in &drawing.items {
            canvas.draw(item);
        }
        canvas
    }

    fn draw(&mut self, item: &Item) {
        match item {
            Item::Line { points, stroke } => self.stroke(points, false, stroke),
            Item::Polygon { points, fill, stroke } => {
                if let Some(colour) = fill {
                    self.fill(&[self.scaled(points)], *colour);
                }
                if let Some(stroke) = stroke {
                    self.stroke(points, true, stroke);
                }
            }
            Item::Circle { center, radius, fill, stroke } => {
                let around: Vec<[f64; 2]> = circle(*center, *radius, self.scale);
                if let Some(colour) = fill {
                    self.fill(&[self.scaled(&around)], *colour);
                }
                if let Some(stroke) = stroke {
                    self.stroke(&around, true, stroke);
                }
            }
            Item::Text { at, text, size, colour, anchor, upwards } => {
                self.text(*at, text, *size, *colour, *anchor, *upwards)
            }
            Item::Image { rect, columns, rows, pixels } => self.image(rect, *columns, *rows, pixels),
        }
    }

    fn scaled(&self, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        points.iter().map(|p| p.map(|v| v * self.scale)).collect()
    }

    fn blend(&mut self, x: i64, y: i64, colour: Colour, coverage: f32) {
        if x < 0 || y < 0 || x >= self.width as i64 || y >= self.height as i64 {
            return;
        }
        let pixel = &mut self.pixels[y as usize * self.width + x as usize];
        for (v, c) in pixel.iter_mut().zip([colour.0, colour.1, colour.2]) {
            *v = (f32::from(*v) + (f32::from(c) - f32::from(*v)) * coverage.clamp(0.0, 1.0)).round() as u8;
        }
    }

    /// Lays a union of polygons of one orientation down, in pixels.
    fn fill(&mut self, polygons: &[Vec<[f64; 2]>], colour: Colour) {
        let all = || polygons.iter().flatten();
        let low = [0, 1].map(|a| all().fold(f64::MAX, |m, p| m.min(p[a])).floor() - 1.0);
        let high = [0, 1].map(|a| all().fold(f64::MIN, |m, p| m.max(p[a])).ceil() + 1.0);
        if !(high[0] > low[0] && high[1] > low[1] && high[0] - low[0] < 1e5 && high[1] - low[1] < 1e5) {
            return;
        }
        self.rasterizer.reset((high[0] - low[0]) as usize, (high[1] - low[1]) as usize);
        for polygon in polygons {
            for (i, from) in polygon.iter().enumerate() {
                let to = polygon[(i + 1) % polygon.len()];
                let local = |p: [f64; 2]| point((p[0] - low[0]) as f32, (p[1] - low[1]) as f32);
                self.rasterizer.draw_line(local(*from), local(to));
            }
        }
        let rasterizer = std::mem::replace(&mut self.rasterizer, Rasterizer::new(1, 1));
        rasterizer.for_each_pixel_2d(|x, y, coverage| {
            if coverage > 0.0 {
                self.blend(low[0] as i64 + i64::from(x), low[1] as i64 + i64::from(y), colour, coverage);
            }
        });
        self.rasterizer = rasterizer;
    }

    fn stroke(&mut self, points: &[[f64; 2]], closed: bool, stroke: &Stroke) {
        let mut path = self.scaled(points);
        if closed && !path.is_empty() {
            path.push(path[0]);
        }
        let half = 0.5 * stroke.width * self.scale;
        let pieces = match stroke.dash {
            None => vec![path],
            Some((on, off)) => dashes(&path, on * self.scale, off * self.scale),
        };
        let mut shapes = Vec::new();
        for piece in pieces {
            for pair in piece.windows(2) {
                let (from, to) = (pair[0], pair[1]);
                let d = [to[0] - from[0], to[1] - from[1]];
                let length = d[0].hypot(d[1]);
                if length == 0.0 {
                    continue;
                }
                let n = [-d[1] / length * half, d[0] / length * half];
                shapes.push(vec![
                    [from[0] - n[0], from[1] - n[1]],
                    [to[0] - n[0], to[1] - n[1]],
                    [to[0] + n[0], to[1] + n[1]],
                    [from[0] + n[0], from[1] + n[1]],
                ]);
            }
            // round joins, at the ends too where the path is closed; a thin line needs none
            if half > 0.6 {
                let joins =
                    if closed { &piece[..] } else { piece.get(1..piece.len().saturating_sub(1)).unwrap_or(&[]) };
                shapes.extend(joins.iter().map(|p| circle(*p, half, 1.0)));
            }
        }
        if !shapes.is_empty() {
            self.fill(&shapes, stroke.colour);
        }
    }

    fn text(&mut self, at: [f64; 2], text: &str, size: f64, colour: Colour, anchor: Anchor, upwards: bool) {
        let per_em = FONT.units_per_em().expect("an outline font");
        let pixels = (size * self.scale) as f32;
        let before = match anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5 * text_width(text, size),
            Anchor::End => text_width(text, size),
        } * self.scale;
        let [x, y] = at.map(|v| v * self.scale);
        // along the text and across it, downwards: (x, y), or (-y, x) where it runs upwards
        let (mut along, across) =
            if upwards { ((-y - before) as f32, x as f32) } else { ((x - before) as f32, y as f32) };
        let scale = PxScale::from(pixels * FONT.height_unscaled() / per_em);
        let mut previous = None;
        for c in text.chars() {
            let id = FONT.glyph_id(c);
            if let Some(left) = previous {
                along += FONT.kern_unscaled(left, id) * pixels / per_em;
            }
            if let Some(outline) = FONT.outline_glyph(id.with_scale_and_position(scale, point(along, across))) {
                let low = outline.px_bounds().min;
                outline.draw(|dx, dy, coverage| {
                    let (u, v) = (low.x as i64 + i64::from(dx), low.y as i64 + i64::from(dy));
                    let (px, py) = if upwards { (v, -u - 1) } else { (u, v) };
                    self.blend(px, py, colour, coverage);
                });
            }
            along += FONT.h_advance_unscaled(id) * pixels / per_em;
            previous = Some(id);
        }
    }

    fn image(&mut self, rect: &Rect, columns: usize, rows: usize, pixels: &[[u8; 3]]) {
        let start = [rect.x, rect.y].map(|v| (v * self.scale).round() as i64);
        let end = [rect.right(), rect.bottom()].map(|v| (v * self.scale).round() as i64);
        let size = [0, 1].map(|axis| (end[axis] - start[axis]).max(0) as usize);
        for (index, [r, g, b]) in resampled((columns, rows), pixels, (size[0], size[1])).into_iter().enumerate() {
            let (x, y) = ((index % size[0]) as i64, (index / size[0]) as i64);
            self.blend(start[0] + x, start[1] + y, Colour(r, g, b), 1.0);
        }
    }
}

/// An image in another size: bilinear between pixel centres where it is enlarged, the mean of the covered pixels where it is made smaller.
pub(super) fn resampled(
    (columns, rows): (usize, usize),
    pixels: &[[u8; 3]],
    (wide, high): (usize, usize),
) -> Vec<[u8; 3]> {
    let across = weights(wide, columns);
    let mut out = Vec::with_capacity(wide * high);
    for vertical in weights(high, rows) {
        for horizontal in &across {
            let mut sum = [0.0; 3];
            for (row, v) in &vertical {
                for (column, h) in horizontal {
                    let p = pixels[row * columns + column];
                    (0..3).for_each(|c| sum[c] += v * h * f64::from(p[c]));
                }
            }
            out.push(sum.map(|s| s.round() as u8));
        }
    }
    out
}

/// For each of `to` places, the pixels of `from` that it is made of, and their shares.
fn weights(to: usize, from: usize) -> Vec<Vec<(usize, f64)>> {
    let step = from as f64 / to as f64;
    (0..to)
        .map(|i| {
            if step < 1.0 {
                let center = ((i as f64 + 0.5) * step - 0.5).clamp(0.0, (from - 1) as f64);
                let left = (center as usize).min(from.saturating_sub(2));
                let share = center - left as f64;
                let right = (left + 1).min(from - 1);
                return vec![(left, 1.0 - share), (right, share)];
            }
            let (low, high) = (i as f64 * step, (i + 1) as f64 * step);
            (low as usize..(high.ceil() as usize).min(from))
                .map(|p| (p, ((p + 1) as f64).min(high) - (p as f64).max(low)))
                .map(|(p, w)| (p, w / step))
                .collect()
        })
        .collect()
}

/// A circle as a polygon, fine enough for its size in pixels; it runs the same way round as the quads of strokes.
fn circle(center: [f64; 2], radius: f64, scale: f64) -> Vec<[f64; 2]> {
    let corners = ((PI * (radius * scale).max(0.1).sqrt() * 4.0).ceil() as usize).clamp(12, 96);
    (0..corners)
        .map(|i| {
            let (s, c) = (TAU * i as f64 / corners as f64).sin_cos();
            [center[0] + radius * c, center[1] + radius * s]
        })
        .collect()
}

/// The drawn pieces of a broken line.
fn dashes(path: &[[f64; 2]], on: f64, off: f64) -> Vec<Vec<[f64; 2]>> {
    let mut pieces = Vec::new();
    let mut piece: Vec<[f64; 2]> = path.first().map(|p| vec![*p]).unwrap_or_default();
    let (mut drawing, mut left) = (true, on);
    for pair in path.windows(2) {
        let (mut from, to) = (pair[0], pair[1]);
        loop {
            let length = (to[0] - from[0]).hypot(to[1] - from[1]);
            // a place that is no number ends the line's dashes, not the program's patience
            if length.is_nan() || length <= left {
                left -= length;
                if drawing {
                    piece.push(to);
                }
                break;
            }
            let t = left / length;
            from = [from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])];
            if drawing {
                piece.push(from);
                pieces.push(std::mem::take(&mut piece));
            } else {
                piece = vec![from];
            }
            drawing = !drawing;
            left = if drawing { on } else { off };
        }
    }
    if drawing && piece.len() > 1 {
        pieces.push(piece);
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::super::style::INK;
    use super::*;

    fn darkness(drawing: &Drawing, scale: f64) -> f64 {
        let canvas = Canvas::of(drawing, scale);
        canvas.pixels.iter().map(|p| f64::from(255 - p[1]) / 255.0).sum::<f64>() / (scale * scale)
    }

    #[test]
    fn shapes_cover_their_area() {
        let black = Colour(0, 0, 0);
        let mut square = Drawing::new(40.0, 40.0, "");
        square.rect(Rect::new(3.3, 4.6, 10.5, 20.25), Some(black), None);
        assert!((darkness(&square, 2.0) - 10.5 * 20.25).abs() < 0.5);
        let mut disk = Drawing::new(40.0, 40.0, "");
        disk.circle([20.2, 19.7], 9.0, Some(black), None);
        assert!((darkness(&disk, 2.0) - PI * 81.0).abs() < 2.5);
        let mut line = Drawing::new(60.0, 60.0, "");
        line.line([[5.0, 5.0], [50.0, 41.0]], Stroke::new(black, 3.0));
        assert!((darkness(&line, 2.0) - 3.0 * 45f64.hypot(36.0)).abs() < 3.0);
        let mut broken = Drawing::new(60.0, 60.0, "");
        broken.line([[5.0, 5.0], [50.0, 41.0]], Stroke::dashed(black, 3.0, 4.0, 4.0));
        let share = darkness(&broken, 2.0) / darkness(&line, 2.0);
        assert!((share - 0.5).abs() < 0.06, "{share}");
    }

    #[test]
    fn images_keep_their_mean_at_any_size() {
        for (to, from) in [(7, 3), (3, 7), (5, 5), (1, 1), (9, 1)] {
            for place in weights(to, from) {
                assert!((place.iter().map(|p| p.1).sum::<f64>() - 1.0).abs() < 1e-12, "{to} from {from}");
            }
        }
        let mut drawing = Drawing::new(30.0, 10.0, "");
        drawing.image(Rect::new(0.0, 0.0, 30.0, 10.0), 3, 1, vec![[0; 3], [255; 3], [0; 3]]);
        assert!((darkness(&drawing, 2.0) - 200.0).abs() < 2.0);
    }

    #[test]
    fn text_is_where_its_box_is_upwards_too() {
        for upwards in [false, true] {
            for anchor in [Anchor::Start, Anchor::Middle, Anchor::End] {
                let mut drawing = Drawing::new(200.0, 200.0, "");
                let at = [100.0, 100.0];
                let text = "HEIGHT".to_owned();
                drawing.items.push(Item::Text { at, text, size: 14.0, colour: INK, anchor, upwards });
                let (_, rect) = drawing.text_boxes()[0].clone();
                let canvas = Canvas::of(&drawing, 2.0);
                let (mut inside, mut outside) = (0, 0);
                for (i, p) in canvas.pixels.iter().enumerate() {
                    if p[0] < 128 {
                        let at = [(i % 400) as f64 / 2.0, (i / 400) as f64 / 2.0];
                        *(if rect.grown(1.0).contains(at) { &mut inside } else { &mut outside }) += 1;
                    }
                }
                assert!(inside > 100 && outside == 0, "{upwards} {anchor:?}: {inside} in, {outside} out");
            }
        }
    }
}
