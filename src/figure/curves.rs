//! Line charts: a value against a parameter, one curve a series, with markers, bands and names at the curves' ends.

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke, text_width};
use super::panel::{Axis, Panel};
use super::scale::{Format, Scale};
use super::style::{SERIES, TICK, WHITE};
use super::table::Table;

/// One curve.
#[derive(Clone, Debug)]
pub struct Series {
    pub name: String,
    pub points: Vec<CurvePoint>,
}

/// A value at a parameter, with the ends of its interval where it has one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    pub x: f64,
    pub y: f64,
    pub interval: Option<(f64, f64)>,
}

/// What an axis of a chart says.
#[derive(Clone, Debug)]
pub struct Quantity {
    pub label: String,
    pub format: Format,
    pub log: bool,
}

#[derive(Clone, Debug)]
pub struct Curves {
    pub title: String,
    pub subtitle: String,
    pub x: Quantity,
    pub y: Quantity,
    pub series: Vec<Series>,
}

const PLOT: (f64, f64) = (560.0, 380.0);
const TOP: f64 = 66.0;

impl Curves {
    pub fn figure(&self) -> Figure {
        let names = self.series.iter().map(|s| text_width(&s.name, TICK)).fold(0.0, f64::max);
        let (width, height) = (PLOT.0 + names + 40.0, TOP + PLOT.1 + 14.0);
        let description = format!("{}. {}. {} against {}.", self.title, self.subtitle, self.y.label, self.x.label);
        let mut drawing = Drawing::new(width, height, description);
        drawing.heading(&self.title, &self.subtitle);

        let points = || self.series.iter().flat_map(|s| &s.points);
        let xs: Vec<f64> = points().map(|p| p.x).collect();
        let ys: Vec<f64> =
            points().flat_map(|p| [p.y].into_iter().chain(p.interval.into_iter().flat_map(|i| [i.0, i.1]))).collect();
        let axis = |q: &Quantity, values: &[f64]| Axis {
            label: q.label.clone(),
            scale: if q.log {
                Scale::log(values.iter().copied())
            } else {
                Scale::linear(values.iter().copied(), false)
            },
            format: q.format,
        };
        let panel = Panel::in_cell(Rect::new(12.0, TOP, PLOT.0, PLOT.1), "", axis(&self.x, &xs), axis(&self.y, &ys));
        panel.draw(&mut drawing, "");
        for (i, series) in self.series.iter().enumerate() {
            let band: Option<Vec<(f64, f64, f64)>> =
                series.points.iter().map(|p| p.interval.map(|(l, h)| (p.x, l, h))).collect();
            if let Some(band) = band.filter(|b| b.len() > 1) {
                let upper = band.iter().map(|(x, _, h)| panel.at(*x, *h));
                let lower = band.iter().rev().map(|(x, low, _)| panel.at(*x, *low));
                drawing.polygon(upper.chain(lower).collect::<Vec<_>>(), Some(colour(i).tint(0.16)), None);
            }
        }
        for (i, series) in self.series.iter().enumerate() {
            let line: Vec<[f64; 2]> = series.points.iter().map(|p| panel.at(p.x, p.y)).collect();
            let stroke = match i / SERIES.len() {
                0 => Stroke::new(colour(i), 1.8),
                1 => Stroke::dashed(colour(i), 1.8, 6.0, 4.0),
                _ => Stroke::dashed(colour(i), 1.8, 2.0, 3.0),
            };
            drawing.line(line.clone(), stroke);
            for at in line {
                drawing.circle(at, 3.6, Some(colour(i)), Some(Stroke::new(WHITE, 1.0)));
            }
        }
        self.name_ends(&mut drawing, &panel);

        let mut data = Table::new(&["series", "x", "y", "low", "high"]);
        for series in &self.series {
            for p in &series.points {
                let end = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
                data.push([
                    series.name.clone(),
                    p.x.to_string(),
                    p.y.to_string(),
                    end(p.interval.map(|i| i.0)),
                    end(p.interval.map(|i| i.1)),
                ]);
            }
        }
        Figure::new(drawing, data)
    }

    /// Names right of the plot, as near to their curves' ends as they can stand without touching.
    fn name_ends(&self, drawing: &mut Drawing, panel: &Panel) {
        let step = 1.35 * TICK;
        let mut ends: Vec<(usize, [f64; 2])> = self
            .series
            .iter()
            .enumerate()
            .filter_map(|(i, s)| s.points.last().map(|p| (i, panel.at(p.x, p.y))))
            .collect();
        ends.sort_by(|a, b| a.1[1].total_cmp(&b.1[1]));
        let wanted: Vec<f64> = ends.iter().map(|e| e.1[1]).collect();
        // the whole column of names stays beside the plot
        let mut places = spread(&wanted, step);
        let beyond = places.last().map_or(0.0, |y| (y - panel.area.bottom()).max(0.0));
        for (i, y) in places.iter_mut().enumerate() {
            *y = (*y - beyond).max(panel.area.y + i as f64 * step);
        }
        for ((i, end), y) in ends.into_iter().zip(places) {
            let x = panel.area.right() + 14.0;
            drawing.line([[end[0] + 6.0, end[1]], [x - 3.0, y]], Stroke::new(colour(i).tint(0.5), 0.75));
            drawing.text([x, y + 0.5 * CAP * TICK], &self.series[i].name, TICK, colour(i), Anchor::Start);
        }
    }
}

fn colour(series: usize) -> super::drawing::Colour {
    SERIES[series % SERIES.len()]
}

/// Ascending places at least `step` apart, each group of neighbours centred on what its members wanted.
pub(super) fn spread(wanted: &[f64], step: f64) -> Vec<f64> {
    // groups of (sum of wanted first places, members)
    let mut groups: Vec<(f64, usize)> = Vec::new();
    for w in wanted {
        groups.push((*w, 1));
        while groups.len() > 1 {
            let (last, before) = (groups[groups.len() - 1], groups[groups.len() - 2]);
            let first = |g: (f64, usize)| g.0 / g.1 as f64;
            if first(before) + before.1 as f64 * step <= first(last) {
                break;
            }
            // members wanted places; as if all wanted the place of the group's first
            groups.pop();
            let merged = (before.0 + last.0 - last.1 as f64 * before.1 as f64 * step, before.1 + last.1);
            *groups.last_mut().expect("the group before") = merged;
        }
    }
    groups.iter().flat_map(|g| (0..g.1).map(move |i| g.0 / g.1 as f64 + i as f64 * step)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_spread_and_stay_near() {
        let wanted = [10.0, 11.0, 12.0, 50.0, 51.0, 100.0];
        let got = spread(&wanted, 15.0);
        assert!(got.windows(2).all(|w| w[1] - w[0] >= 15.0 - 1e-9), "{got:?}");
        assert!(got.iter().zip(wanted).all(|(g, w)| (g - w).abs() < 20.0), "{got:?}");
        assert_eq!(got[5], 100.0);
        let sum: f64 = got[..3].iter().sum();
        assert!((sum - 33.0).abs() < 1e-9, "the group is centred: {got:?}");
    }
}
