use std::fmt::Write as _;

use super::drawing::{Anchor, Drawing, Item, Stroke};
use super::raster::{encode_png, resampled};
use super::style::PNG_SCALE;

/// Raised when the same data would be drawn, or the same drawing rasterised, in another way: figures are then made again.
pub(super) const VERSION: u32 = 1;

/// SVG 1.1 text of a drawing; the same bytes for the same drawing.
pub fn svg(drawing: &Drawing) -> String {
    let (w, h) = (number(drawing.width), number(drawing.height));
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" width=\"{w}\" height=\"{h}\" \
         viewBox=\"0 0 {w} {h}\" role=\"img\" font-family=\"'DejaVu Sans', Verdana, sans-serif\">\n<!-- rigbench figure {VERSION} -->\n\
         <desc>{}</desc>\n<rect width=\"{w}\" height=\"{h}\" fill=\"#ffffff\"/>\n",
        escaped(&drawing.description)
    );
    for item in &drawing.items {
        write_item(&mut out, item);
    }
    out.push_str("</svg>\n");
    out
}

fn write_item(out: &mut String, item: &Item) {
    let fill = |colour: &Option<super::drawing::Colour>| colour.map_or("none".to_owned(), |c| c.hex());
    let written = match item {
        Item::Line { points, stroke } => {
            writeln!(out, "<polyline points=\"{}\" fill=\"none\"{}/>", list(points), stroke_attributes(stroke))
        }
        Item::Polygon { points, fill: f, stroke } => writeln!(
            out,
            "<polygon points=\"{}\" fill=\"{}\"{}/>",
            list(points),
            fill(f),
            stroke.as_ref().map_or(String::new(), stroke_attributes)
        ),
        Item::Circle { center, radius, fill: f, stroke } => writeln!(
            out,
            "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" fill=\"{}\"{}/>",
            number(center[0]),
            number(center[1]),
            number(*radius),
            fill(f),
            stroke.as_ref().map_or(String::new(), stroke_attributes)
        ),
        Item::Text { at, text, size, colour, anchor, upwards } => {
            let (x, y) = (number(at[0]), number(at[1]));
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let turn = if *upwards { format!(" transform=\"rotate(-90 {x} {y})\"") } else { String::new() };
            writeln!(
                out,
                "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" fill=\"{}\" text-anchor=\"{anchor}\"{turn}>{}</text>",
                number(*size),
                colour.hex(),
                escaped(text)
            )
        }
        Item::Image { rect, columns, rows, pixels } => {
            // no finer than the PNG of the drawing
            let most = |length: f64, own: usize| own.min((length * PNG_SCALE).ceil().max(1.0) as usize);
            let (wide, high) = (most(rect.width, *columns), most(rect.height, *rows));
            let data = base64(&match (wide, high) == (*columns, *rows) {
                true => encode_png(wide, high, pixels),
                false => encode_png(wide, high, &resampled((*columns, *rows), pixels, (wide, high))),
            });
            writeln!(
                out,
                "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" xlink:href=\"data:image/png;base64,{data}\"/>",
                number(rect.x),
                number(rect.y),
                number(rect.width),
                number(rect.height)
            )
        }
    };
    written.expect("writing to a string");
}

fn stroke_attributes(stroke: &Stroke) -> String {
    let dash =
        stroke.dash.map_or(String::new(), |(on, off)| format!(" stroke-dasharray=\"{} {}\"", number(on), number(off)));
    format!(
        " stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\"{dash}",
        stroke.colour.hex(),
        number(stroke.width)
    )
}

fn list(points: &[[f64; 2]]) -> String {
    points.iter().map(|p| format!("{},{}", number(p[0]), number(p[1]))).collect::<Vec<_>>().join(" ")
}

/// Two decimals at most: a hundredth of a pixel.
fn number(v: f64) -> String {
    let rounded = (v * 100.0).round() / 100.0;
    format!("{}", if rounded == 0.0 { 0.0 } else { rounded })
}

pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// RFC 4648, section 4.
pub(crate) fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0u32, |w, b| w << 8 | u32::from(*b)) << (8 * (3 - chunk.len()));
        for i in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * i)) as usize & 63] as char;
            out.push(if i <= chunk.len() { digit } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_as_in_the_standard() {
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([number(1.0), number(-0.001), number(2.346)], ["1", "0", "2.35"]);
    }
}
