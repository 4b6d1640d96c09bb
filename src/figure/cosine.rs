//! What an order of SH makes of the clamped cosine: irradiance under one distant light, and its ringing on the dark side.

use std::f64::consts::PI;

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke};
use super::panel::{Axis, Panel};
use super::scale::{Format, Scale};
use super::style::{GREY, INK, LABEL, MUTED, SERIES, TICK};
use super::table::Table;
use crate::math::gauss_legendre;
use crate::sh::{Lobe, MAX_ORDER, Window, legendre_polynomials};

/// Orders that are always shown; 4 equals 3 and 6 equals 5, because the clamped cosine has no third and fifth degree.
const ORDERS: [usize; 4] = [1, 2, 3, 5];
/// Steps of the curves, degrees.
const STEP: usize = 2;

/// The clamped cosine cut off after an order, each band damped by a window:
/// f_n(cos t) = sum over k < n of w_k (2k + 1)/(4 pi) A_k P_k(cos t), A as in [`Lobe::bands`].
fn approximation(order: usize, window: Window, cosine: f64) -> f64 {
    let legendre: [f64; MAX_ORDER] = legendre_polynomials(cosine);
    let (bands, damping) = (*Lobe::<f64>::lambert().bands(), window.bands());
    (0..order).map(|k| damping[k] * (2 * k + 1) as f64 / (4.0 * PI) * bands[k] * legendre[k]).sum()
}

/// The window that is shown for an order: Hann's, its zero one band beyond the last.
fn window_of(order: usize) -> Window {
    Window::Hann { width: (order + 1) as f64 }
}

/// RMS over the sphere of f_n - f, over the RMS of f; and the smallest value of f_n.
fn errors(order: usize, window: Window) -> (f64, f64) {
    // f has a kink at 0: a rule on either side
    let rule = gauss_legendre(12);
    let both_sides = |f: &dyn Fn(f64) -> f64| rule.integrate(-1.0, 0.0, f) + rule.integrate(0.0, 1.0, f);
    let square = both_sides(&|c| (approximation(order, window, c) - c.max(0.0)).powi(2));
    let whole = both_sides(&|c| c.max(0.0).powi(2));
    let smallest = (0..=1800).map(|i| approximation(order, window, (f64::from(i) * PI / 1800.0).cos()));
    ((square / whole).sqrt(), smallest.fold(f64::INFINITY, f64::min))
}

/// One panel: a title, the axis's label and its curves.
struct Part {
    title: &'static str,
    label: &'static str,
    curves: Vec<Curve>,
}

struct Curve {
    name: String,
    order: usize,
    window: Window,
    /// The approximation itself, or its difference from the truth.
    difference: bool,
}

const CELL: (f64, f64) = (372.0, 330.0);
const TOP: f64 = 66.0;
const LEGEND: f64 = 170.0;

/// The figure for the orders that an experiment uses; none where it uses no SH.
pub fn figure(used: &[usize]) -> Option<Figure> {
    used.first()?;
    let mut orders: Vec<usize> = ORDERS.to_vec();
    orders.extend(used.iter().copied().filter(|o| (1..=MAX_ORDER).contains(o)));
    orders.sort_unstable();
    orders.dedup();
    // what equals the order below is not drawn twice
    let same = |order: usize| order > 2 && order.is_multiple_of(2);
    let drawn: Vec<usize> = orders.iter().copied().filter(|o| !same(*o)).collect();
    let plain = |difference: bool| -> Vec<Curve> {
        let curve =
            |order: &usize| Curve { name: format!("order {order}"), order: *order, window: Window::None, difference };
        drawn.iter().map(curve).collect()
    };
    let windowed = drawn.iter().filter(|o| **o > 1).map(|order| Curve {
        name: format!("order {order}, Hann"),
        order: *order,
        window: window_of(*order),
        difference: false,
    });
    let parts = [
        Part { title: "cut off at an order", label: "irradiance", curves: plain(false) },
        Part { title: "the same, windowed", label: "irradiance", curves: windowed.collect() },
        Part {
            title: "ringing: approximation − truth",
            label: "difference",
            curves: plain(true).into_iter().filter(|c| c.order > 1).collect(),
        },
    ];
    let title = "Spherical harmonics of the clamped cosine";
    let subtitle = "irradiance under one distant light, 1 when facing it, by the angle between normal and light";
    let mut drawing = Drawing::new(
        3.0 * CELL.0 + 24.0,
        TOP + CELL.1 + LEGEND,
        format!("{title}. {subtitle}. Orders {drawn:?}, plain and windowed, and their differences from the truth."),
    );
    drawing.heading(title, subtitle);
    let mut data = Table::new(&["panel", "series", "order", "angle_degrees", "value"]);
    for (place, part) in parts.iter().enumerate() {
        let cell = Rect::new(12.0 + place as f64 * CELL.0, TOP, CELL.0, CELL.1);
        let value = |curve: &Curve, degrees: usize| {
            let cosine = (degrees as f64).to_radians().cos();
            let shift = if curve.difference { cosine.max(0.0) } else { 0.0 };
            approximation(curve.order, curve.window, cosine) - shift
        };
        let (low, high) = if place == 2 { (-0.29, 0.29) } else { (-0.29, 1.1) };
        let x = Axis {
            label: "angle, degrees".into(),
            scale: Scale::Linear { low: 0.0, high: 180.0 },
            format: Format::Count,
        };
        let y = Axis { label: part.label.into(), scale: Scale::Linear { low, high }, format: Format::Plain };
        let panel = Panel::in_cell(cell, part.title, x, y);
        panel.draw(&mut drawing, part.title);
        let line = |f: &dyn Fn(usize) -> f64| -> Vec<[f64; 2]> {
            (0..=180 / STEP).map(|i| panel.at((i * STEP) as f64, f(i * STEP).clamp(low, high))).collect()
        };
        let zero = Stroke::new(GREY, 1.0);
        drawing.line([panel.at(0.0, 0.0), panel.at(180.0, 0.0)], zero);
        let truth = |degrees: usize| (degrees as f64).to_radians().cos().max(0.0);
        if place < 2 {
            drawing.line(line(&truth), Stroke::dashed(INK, 2.0, 5.0, 3.0));
            for i in 0..=180 / STEP {
                data.push([
                    part.title.into(),
                    "truth".into(),
                    String::new(),
                    (i * STEP).to_string(),
                    truth(i * STEP).to_string(),
                ]);
            }
        }
        for curve in &part.curves {
            let index = drawn.iter().position(|o| *o == curve.order).unwrap_or(0);
            drawing.line(line(&|degrees| value(curve, degrees)), Stroke::new(SERIES[index % SERIES.len()], 1.8));
            for i in 0..=180 / STEP {
                let degrees = i * STEP;
                let cells = [curve.order.to_string(), degrees.to_string(), value(curve, degrees).to_string()];
                let [order, degrees, value] = cells;
                data.push([part.title.into(), curve.name.clone(), order, degrees, value]);
            }
        }
    }
    legend(&mut drawing, &orders, &drawn);
    Some(Figure::new(drawing, data))
}

/// What each curve is, with its error and its darkest ringing, plain and windowed.
fn legend(drawing: &mut Drawing, orders: &[usize], drawn: &[usize]) {
    let columns = [16.0, 56.0, 330.0, 450.0, 620.0, 830.0];
    let mut y = TOP + CELL.1 + 22.0;
    let heads = ["", "", "RMS error", "most negative", "RMS error, Hann's window", "most negative"];
    for (x, text) in columns.iter().zip(heads) {
        drawing.text([*x, y], text, TICK, MUTED, Anchor::Start);
    }
    y += 20.0;
    drawing.line([[16.0, y - 0.5 * CAP * LABEL], [44.0, y - 0.5 * CAP * LABEL]], Stroke::dashed(INK, 2.0, 5.0, 3.0));
    drawing.text([columns[1], y], "the clamped cosine itself", LABEL, INK, Anchor::Start);
    for order in orders {
        let Some(index) = drawn.iter().position(|o| o == order) else { continue };
        y += 20.0;
        drawing.line(
            [[16.0, y - 0.5 * CAP * LABEL], [44.0, y - 0.5 * CAP * LABEL]],
            Stroke::new(SERIES[index % SERIES.len()], 1.8),
        );
        let twin = if *order == 3 || *order == 5 { format!(" (and {})", order + 1) } else { String::new() };
        let name = format!("order {order}{twin}: {} coefficient{}", order * order, if *order == 1 { "" } else { "s" });
        let (plain, windowed) = (errors(*order, Window::None), errors(*order, window_of(*order)));
        let percent = |v: f64| Format::Percent.write(v);
        let mut texts = vec![name, percent(plain.0), percent(plain.1.min(0.0))];
        if *order > 1 {
            texts.extend([percent(windowed.0), percent(windowed.1.min(0.0))]);
        }
        for (x, text) in columns[1..].iter().zip(texts) {
            drawing.text([*x, y], text, LABEL, INK, Anchor::Start);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cut_off_cosine_is_ramamoorthis() {
        // order 3: 1/4 + c/2 + 5/32 (3 c^2 - 1) (Ramamoorthi and Hanrahan 2001, equation 24 in this normalisation)
        for i in 0..=20 {
            let c = f64::from(i) / 10.0 - 1.0;
            let expected = 0.25 + 0.5 * c + 5.0 / 32.0 * (3.0 * c * c - 1.0);
            assert!((approximation(3, Window::None, c) - expected).abs() < 1e-14);
            assert!((approximation(4, Window::None, c) - expected).abs() < 1e-14, "order 4 equals 3");
        }
        // order 1 is the mean 1/4: RMS error sqrt(1/6 - 1/16) over sqrt(1/6)
        let (rms, smallest) = errors(1, Window::None);
        assert!((rms - ((1.0f64 / 6.0 - 1.0 / 16.0) * 6.0).sqrt()).abs() < 1e-12 && (smallest - 0.25).abs() < 1e-12);
        // ringing: order 3 has its minimum -1/15 at c = -8/15; a window lifts it
        let (_, smallest) = errors(3, Window::None);
        let at = |c: f64| 0.25 + 0.5 * c + 5.0 / 32.0 * (3.0 * c * c - 1.0);
        assert!((smallest - at(-8.0 / 15.0)).abs() < 1e-5, "{smallest}");
        assert!(errors(3, window_of(3)).1 > smallest + 0.01);
        assert!(figure(&[]).is_none());
    }
}
