//! The plots of the page, inline SVG coloured by the page's style: a link on every point, and its name for who cannot see it.

use maud::{Markup, html};

use crate::cost::pareto::front;
use crate::figure::drawing::{Rect, text_width};
use crate::figure::label::{self, Label, Obstacles};
use crate::figure::panel::{Axis, Panel};
use crate::figure::scale::{Format, Scale};
use crate::figure::style::INK;
use crate::figure::table::{Group, Row, by_what_they_keep, name, varying_axes};

/// A cost that a plot stands against: column, label, format, factor to the format's unit.
type Cost = (&'static str, &'static str, Format, f64);
const COSTS: [Cost; 2] = [
    ("frame_us_1m", "frame time, a million points", Format::Unit("s"), 1e-6),
    ("sh_vectors", "SH vectors kept", Format::Plain, 1.0),
];
pub(super) const SIZE: (f64, f64) = (520.0, 340.0);
const TEXT: f64 = 12.0;

/// One candidate in a plot.
struct Point {
    run: String,
    name: String,
    cost: f64,
    error: f64,
}

/// Error against cost, by a column of errors; none where fewer than two candidates have both.
pub fn plot(group: &Group, column: &str, title: &str) -> Option<Markup> {
    let varying = varying_axes(&group.rows);
    let (points, (_, label, format, _)) = COSTS.iter().find_map(|cost| {
        let points: Vec<Point> = group
            .rows
            .iter()
            .filter_map(|r| {
                let (cost, error) = (r.number(cost.0)? * cost.3, r.number(column)?);
                Some(Point { run: r.text("run").to_owned(), name: name(r, &varying), cost, error })
            })
            .collect();
        (points.len() >= 2).then_some((points, *cost))
    })?;
    let on_front = front(&points.iter().map(|p| (Some(p.cost), Some(p.error))).collect::<Vec<_>>());
    let x =
        Axis { label: label.to_owned(), scale: Scale::log(points.iter().map(|p| p.cost).collect::<Vec<_>>()), format };
    let errors: Vec<f64> = points.iter().map(|p| p.error).collect();
    let y = Axis { label: title.to_owned(), scale: Scale::log_errors(errors), format: Format::Percent };
    let panel = Panel::in_cell(Rect::new(0.0, 4.0, SIZE.0, SIZE.1 - 4.0), "", x, y);
    let a = panel.area;

    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|i, j| {
        points[*i].cost.total_cmp(&points[*j].cost).then(points[*j].error.total_cmp(&points[*i].error))
    });
    let mut steps: Vec<[f64; 2]> = Vec::new();
    for i in order.iter().copied().filter(|i| on_front[*i]) {
        let at = panel.at(points[i].cost, points[i].error);
        steps.push([at[0], steps.last().map_or(a.y, |p: &[f64; 2]| p[1])]);
        steps.push(at);
    }
    if let Some(last) = steps.last().copied() {
        steps.push([a.right(), last[1]]);
    }
    let mut obstacles = Obstacles { lines: steps.windows(2).map(|w| [w[0], w[1]]).collect(), ..Obstacles::default() };
    let mut labels = Vec::new();
    for (point, on) in points.iter().zip(&on_front) {
        let at = panel.at(point.cost, point.error);
        obstacles.markers.push((at, 5.0));
        if *on {
            let text = point.name.clone();
            labels.push(Label { point: at, text, size: TEXT, colour: INK, rank: 0, patience: label::ANY });
        }
    }
    let placed = label::place(&labels, &obstacles, &Rect::new(a.x + 2.0, a.y, SIZE.0 - a.x - 4.0, a.height - 2.0));
    // beaten points below, the front above
    order.sort_by_key(|i| on_front[*i]);
    let say =
        |p: &Point| format!("{}: {title} {}, {label} {}", p.name, Format::Percent.write(p.error), format.write(p.cost));
    let beaten = points.len() - on_front.iter().filter(|on| **on).count();
    let description = format!(
        "{title} against {label} of {} candidates: {} on the front ({}), {beaten} beaten.",
        points.len(),
        points.len() - beaten,
        points
            .iter()
            .zip(&on_front)
            .filter(|(_, on)| **on)
            .map(|(p, _)| p.name.as_str())
            .collect::<Vec<_>>()
            .join(", "),
    );
    Some(html! {
        svg class="plot" viewBox=(format!("0 0 {} {}", SIZE.0, SIZE.1)) role="group" aria-label=(description) {
            (axes(&panel))
            polyline class="front" points=(listed(&steps)) {}
            @for i in order {
                @let p = &points[i];
                @let [x, y] = panel.at(p.cost, p.error);
                a href=(format!("#run-{}", p.run)) aria-label=(say(p)) {
                    circle class=(if on_front[i] { "point on" } else { "point" }) cx=(short(x)) cy=(short(y))
                        r=(if on_front[i] { "5.5" } else { "4.5" }) {}
                }
            }
            g class="names" aria-hidden="true" {
                @for p in &placed {
                    @if let Some([from, to]) = p.leader {
                        polyline class="leader" points=(listed(&[from, to])) {}
                    }
                    text x=(short(p.rect.x + 2.0)) y=(short(p.rect.y + 2.0 + 0.73 * TEXT)) { (labels[p.label].text) }
                }
            }
        }
    })
}

/// Where the error of each candidate comes from: a bar for the order, one for the rig, a mark for both together.
pub fn split(group: &Group) -> Option<Markup> {
    let mut rows: Vec<Row> = group.rows.iter().copied().filter(|r| r.number("interpolation_nrmse").is_some()).collect();
    if rows.is_empty() {
        return None;
    }
    rows.sort_by(by_what_they_keep);
    let varying = varying_axes(&group.rows);
    let names: Vec<String> = rows.iter().map(|r| name(r, &varying)).collect();
    let left = names.iter().map(|n| text_width(n, TEXT)).fold(0.0, f64::max).min(200.0) + 14.0;
    let columns = ["truncation_nrmse", "interpolation_nrmse", "nrmse"];
    let value = |r: &Row, c: usize| r.number(columns[c]).unwrap_or(0.0);
    let high = rows.iter().flat_map(|r| (0..3).map(|c| value(r, c))).fold(0.0, f64::max);
    let high = if high > 0.0 { 1.04 * high } else { 1.0 };
    let (line, top) = (26.0, 8.0);
    let height = top + line * rows.len() as f64 + 40.0;
    let scale = Scale::Linear { low: 0.0, high };
    let width = SIZE.0 - left - 14.0;
    let at = |v: f64| left + width * scale.position(v);
    let bottom = top + line * rows.len() as f64 + 2.0;
    let percent = |v: f64| Format::Percent.write(v);
    let say = |i: usize, r: &Row| {
        let [truncation, interpolation, both] = [0, 1, 2].map(|c| percent(value(r, c)));
        format!("{}: order {truncation}, rig {interpolation}, together {both}", names[i])
    };
    Some(html! {
        svg class="plot split" viewBox=(format!("0 0 {} {}", SIZE.0, short(height))) role="group"
            aria-label="error of each candidate, by what the order costs and what the rig costs" {
            @for tick in scale.ticks(width, Format::Percent, true) {
                line class="grid" x1=(short(at(tick.value))) x2=(short(at(tick.value))) y1=(top) y2=(short(bottom)) {}
                text class="tick" text-anchor="middle" x=(short(at(tick.value))) y=(short(bottom + 15.0)) { (tick.label.unwrap_or_default()) }
            }
            text class="label" text-anchor="middle" x=(short(left + 0.5 * width)) y=(short(bottom + 33.0)) { "nRMSE" }
            @for (i, r) in rows.iter().enumerate() {
                @let y = top + line * i as f64;
                a href=(format!("#run-{}", r.text("run"))) aria-label=(say(i, r)) {
                    rect class="hit" x="0" y=(short(y)) width=(SIZE.0) height=(line) {}
                    text class="name" text-anchor="end" x=(short(left - 8.0)) y=(short(y + 0.5 * line + 4.0)) { (names[i]) }
                    rect class="truncation" x=(short(left)) y=(short(y + 4.0)) width=(short(at(value(r, 0)) - left)) height="7.5" {}
                    rect class="interpolation" x=(short(left)) y=(short(y + 13.0)) width=(short(at(value(r, 1)) - left)) height="7.5" {}
                    line class="both" x1=(short(at(value(r, 2)))) x2=(short(at(value(r, 2)))) y1=(short(y + 2.0)) y2=(short(y + 22.5)) {}
                }
            }
        }
    })
}

pub(super) fn axes(panel: &Panel) -> Markup {
    let a = &panel.area;
    let horizontal = panel.x.scale.ticks(a.width, panel.x.format, true);
    let vertical = panel.y.scale.ticks(a.height, panel.y.format, false);
    html! {
        @for tick in horizontal.iter().filter(|t| t.label.is_some()) {
            @let x = panel.at(tick.value, 1.0)[0];
            line class="grid" x1=(short(x)) x2=(short(x)) y1=(short(a.y)) y2=(short(a.bottom())) {}
            text class="tick" text-anchor="middle" x=(short(x)) y=(short(a.bottom() + 17.0)) { (tick.label.clone().unwrap_or_default()) }
        }
        @for tick in vertical.iter().filter(|t| t.label.is_some()) {
            @let y = panel.at(1.0, tick.value)[1];
            line class="grid" x1=(short(a.x)) x2=(short(a.right())) y1=(short(y)) y2=(short(y)) {}
            text class="tick" text-anchor="end" x=(short(a.x - 6.0)) y=(short(y + 4.0)) { (tick.label.clone().unwrap_or_default()) }
        }
        polyline class="axis" points=(listed(&[[a.x, a.y], [a.x, a.bottom()], [a.right(), a.bottom()]])) {}
        text class="label" text-anchor="middle" x=(short(a.center()[0])) y=(short(a.bottom() + 36.0)) { (panel.x.label) }
        text class="label" text-anchor="middle" transform=(format!("translate(13 {}) rotate(-90)", short(a.center()[1]))) { (panel.y.label) }
    }
}

pub(super) fn listed(points: &[[f64; 2]]) -> String {
    points.iter().map(|p| format!("{},{}", short(p[0]), short(p[1]))).collect::<Vec<_>>().join(" ")
}

fn short(v: f64) -> String {
    format!("{}", (v * 10.0).round() / 10.0)
}
