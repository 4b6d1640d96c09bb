//! Quality against cost: one panel a cost, dominated points grey, the front as a step line, points named.

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke};
use super::label::{self, Label, Obstacles};
use super::panel::{Axis, Panel};
use super::scale::{Format, Scale, next_to_nothing};
use super::style::{ACCENT, GREY, INK, LABEL, MUTED, TICK, WHITE};
use super::table::Table;
use crate::cost::pareto::{Halving, front, halving};

/// A cost that fronts are drawn against.
pub struct Cost {
    pub column: &'static str,
    pub label: &'static str,
    pub short: &'static str,
    pub format: Format,
    /// From the column's unit to the one that the format writes.
    pub factor: f64,
    /// Whether it is drawn where all candidates are volumes, or only where they are not; both where this says nothing.
    pub volumes: Option<bool>,
}

pub const COSTS: &[Cost] = &[
    Cost {
        column: "frame_us_vertices",
        label: "frame time, the receivers' vertices",
        short: "frame time (vertices)",
        format: Format::Unit("s"),
        factor: 1e-6,
        volumes: Some(false),
    },
    Cost {
        column: "frame_us_1m",
        label: "frame time, a million points",
        short: "frame time (a million points)",
        format: Format::Unit("s"),
        factor: 1e-6,
        volumes: Some(false),
    },
    Cost {
        column: "setup_us",
        label: "setup, each frame",
        short: "setup",
        format: Format::Unit("s"),
        factor: 1e-6,
        volumes: Some(false),
    },
    Cost {
        column: "samples",
        label: "samples of the volume",
        short: "samples",
        format: Format::Plain,
        factor: 1.0,
        volumes: Some(true),
    },
    Cost {
        column: "model_bytes",
        label: "model size",
        short: "model size",
        format: Format::Unit("B"),
        factor: 1.0,
        volumes: None,
    },
    Cost {
        column: "bake_s",
        label: "bake, all threads",
        short: "bake",
        format: Format::Unit("s"),
        factor: 1.0,
        volumes: Some(true),
    },
    Cost {
        column: "bake_rays",
        label: "rays of the bake",
        short: "rays",
        format: Format::Plain,
        factor: 1.0,
        volumes: Some(true),
    },
    Cost {
        column: "eval_ns_per_point",
        label: "lookup, a point",
        short: "lookup",
        format: Format::Unit("s"),
        factor: 1e-9,
        volumes: Some(true),
    },
    Cost {
        column: "sh_vectors",
        label: "SH vectors kept",
        short: "SH vectors",
        format: Format::Plain,
        factor: 1.0,
        volumes: Some(false),
    },
];

/// A candidate in a figure of fronts.
#[derive(Clone, Debug)]
pub struct Point {
    pub name: String,
    pub run: String,
    /// For the marker's shape.
    pub order: Option<u32>,
    pub error: Option<f64>,
    /// One for each of [`COSTS`], in the columns' units.
    pub costs: Vec<Option<f64>>,
}

/// What a figure of fronts shows.
#[derive(Clone, Debug)]
pub struct Fronts {
    pub title: String,
    pub subtitle: String,
    pub error_label: String,
    pub points: Vec<Point>,
    /// Errors below it are not resolved: twice the noise of the reference.
    pub unresolved_below: Option<f64>,
}

const CELL: (f64, f64) = (462.0, 318.0);
const TOP: f64 = 66.0;

impl Fronts {
    pub fn figure(&self) -> Figure {
        let costs: Vec<usize> = (0..COSTS.len())
            .filter(|c| self.points.iter().filter(|p| p.costs[*c].is_some() && p.error.is_some()).count() > 0)
            .collect();
        let cells = costs.len() + 1;
        let rows = cells.div_ceil(2);
        let mut drawing = Drawing::new(
            2.0 * CELL.0 + 24.0,
            TOP + rows as f64 * CELL.1 + 12.0,
            format!("{}. {}. {} against {}.", self.title, self.subtitle, self.error_label, listed(&costs)),
        );
        drawing.heading(&self.title, &self.subtitle);

        let cell = |i: usize| Rect::new(12.0 + (i % 2) as f64 * CELL.0, TOP + (i / 2) as f64 * CELL.1, CELL.0, CELL.1);
        let errors: Vec<f64> = self.points.iter().filter_map(|p| p.error).collect();
        let scale = Scale::log_errors(errors.iter().copied());
        let floor = next_to_nothing(errors.iter().copied());
        let mut data = Table::new(&["cost", "candidate", "run", "order", "cost_value", "error", "on_front"]);
        let mut prices = Vec::new();
        let mut unnamed = 0;
        for (place, c) in costs.iter().enumerate() {
            let pairs: Vec<_> = self.points.iter().map(|p| (p.costs[*c], p.error)).collect();
            let on_front = front(&pairs);
            for (p, on) in self.points.iter().zip(&on_front) {
                if let (Some(cost), Some(error)) = (p.costs[*c], p.error) {
                    let order = p.order.map_or(String::new(), |o| o.to_string());
                    data.push([
                        COSTS[*c].column.into(),
                        p.name.clone(),
                        p.run.clone(),
                        order,
                        cost.to_string(),
                        error.to_string(),
                        on.to_string(),
                    ]);
                }
            }
            let members: Vec<(f64, f64)> =
                pairs.iter().zip(&on_front).filter(|(_, on)| **on).filter_map(|(p, _)| Some((p.0?, p.1?))).collect();
            prices.push((*c, halving(&members, floor), members.len()));
            unnamed += self.panel(&mut drawing, cell(place), *c, scale, &on_front);
        }
        self.legend(&mut drawing, cell(cells - 1), &prices, unnamed > 0);
        Figure::new(drawing, data)
    }

    /// Draws the panel of a cost; gives the number of points that found no room for their name.
    fn panel(&self, drawing: &mut Drawing, cell: Rect, c: usize, y_scale: Scale, on_front: &[bool]) -> usize {
        let cost = &COSTS[c];
        let values: Vec<f64> = self
            .points
            .iter()
            .filter(|p| p.error.is_some())
            .filter_map(|p| p.costs[c])
            .map(|v| v * cost.factor)
            .collect();
        let x = Axis { label: cost.label.into(), scale: Scale::log(values.iter().copied()), format: cost.format };
        let y = Axis { label: self.error_label.clone(), scale: y_scale, format: Format::Percent };
        let panel = Panel::in_cell(cell, "", x, y);
        let a = panel.area;

        // what the front beats, faintly
        let place = |p: &Point| Some(panel.at(p.costs[c]? * cost.factor, p.error?));
        let mut steps: Vec<[f64; 2]> =
            (0..self.points.len()).filter(|i| on_front[*i]).filter_map(|i| place(&self.points[i])).collect();
        steps.sort_by(|p, q| p[0].total_cmp(&q[0]).then(q[1].total_cmp(&p[1])));
        let mut line: Vec<[f64; 2]> = Vec::new();
        for p in &steps {
            match line.last().copied() {
                None => line.push([p[0], a.y]),
                Some(last) => line.push([p[0], last[1]]),
            }
            line.push(*p);
        }
        if let Some(last) = line.last().copied() {
            line.push([a.right(), last[1]]);
            let mut beaten = line.clone();
            beaten.push([a.right(), a.y]);
            drawing.polygon(beaten, Some(ACCENT.tint(0.045)), None);
        }
        panel.draw(drawing, "");
        if let Some(limit) = self.unresolved_below.filter(|v| *v > 0.0) {
            let y = panel.at(1.0, limit)[1];
            if y > a.y && y < a.bottom() {
                drawing.line([[a.x, y], [a.right(), y]], Stroke::dashed(MUTED, 1.0, 2.0, 3.0));
            }
        }
        drawing.line(line.clone(), Stroke::new(ACCENT, 1.5));

        let mut labels = Vec::new();
        let mut obstacles =
            Obstacles { lines: line.windows(2).map(|w| [w[0], w[1]]).collect(), ..Obstacles::default() };
        // grey below, the front above
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        order.sort_by_key(|i| on_front[*i]);
        for i in order {
            let Some(at) = place(&self.points[i]) else { continue };
            marker(drawing, at, self.shape(i), on_front[i]);
            obstacles.markers.push((at, 5.0));
            labels.push(Label {
                point: at,
                text: self.points[i].name.clone(),
                size: TICK,
                colour: if on_front[i] { INK } else { MUTED },
                rank: usize::from(!on_front[i]),
                patience: if on_front[i] { label::ANY } else { label::LITTLE },
            });
        }
        let placed =
            label::place(&labels, &obstacles, &Rect::new(a.x + 2.0, a.y, cell.right() - a.x - 4.0, a.height - 2.0));
        label::draw(drawing, &labels, &placed);
        labels.len() - placed.len()
    }

    /// The order that a marker's shape says; 0 for none where others have one.
    fn shape(&self, point: usize) -> Option<u32> {
        let any = self.points.iter().any(|p| p.order.is_some());
        self.points[point].order.or(any.then_some(0))
    }

    fn legend(&self, drawing: &mut Drawing, cell: Rect, prices: &[(usize, Option<Halving>, usize)], unnamed: bool) {
        let x = cell.x + 58.0;
        let mut entries: Vec<(Sign, String)> = Vec::new();
        let on_front = |d: &mut Drawing, p: [f64; 2]| {
            d.line([[p[0] - 11.0, p[1]], [p[0] + 11.0, p[1]]], Stroke::new(ACCENT, 1.5));
            marker(d, p, None, true);
        };
        entries.push((Box::new(on_front), "on the front: none is cheaper and better".to_owned()));
        let beaten =
            if unnamed { "beaten; named where there is room, all in the CSV" } else { "beaten by one on the front" };
        entries.push((Box::new(|d, p| marker(d, p, None, false)), beaten.to_owned()));
        let mut orders: Vec<u32> = self.points.iter().filter_map(|p| p.order).collect();
        orders.sort_unstable();
        orders.dedup();
        if orders.len() > 1 {
            for order in orders {
                let text = format!("name /{order}: order {order}, {} coefficients", order * order);
                entries.push((Box::new(move |d, p| marker(d, p, Some(order), true)), text));
            }
            if self.points.iter().any(|p| p.order.is_none()) {
                let text = "keeps no spherical harmonics".to_owned();
                entries.push((Box::new(|d, p| marker(d, p, Some(0), true)), text));
            }
        }
        let floor = next_to_nothing(self.points.iter().filter_map(|p| p.error));
        if self.points.iter().any(|p| p.error.is_some_and(|e| e < floor)) {
            let near = |d: &mut Drawing, p: [f64; 2]| {
                d.text([p[0], p[1] + 0.5 * CAP * LABEL], "≈ 0", LABEL, MUTED, Anchor::Middle);
            };
            let text = format!("error under {}: below the broken axis", Format::Percent.write(floor));
            entries.push((Box::new(near), text));
        } else if self.points.iter().any(|p| p.error.is_some_and(|e| e <= 0.0)) {
            let zero = |d: &mut Drawing, p: [f64; 2]| {
                d.text([p[0], p[1] + 0.5 * CAP * LABEL], "0", LABEL, MUTED, Anchor::Middle);
            };
            entries.push((Box::new(zero), "no error at all: below the broken axis".to_owned()));
        }
        if self.unresolved_below.is_some_and(|v| v > 0.0) {
            let limit = |d: &mut Drawing, p: [f64; 2]| {
                d.line([[p[0] - 11.0, p[1]], [p[0] + 11.0, p[1]]], Stroke::dashed(MUTED, 1.0, 2.0, 3.0));
            };
            entries.push((Box::new(limit), "twice the reference's noise: not resolved below".to_owned()));
        }
        // closer together where there are many
        let room = cell.height - 30.0 - 45.0 - 20.0 * prices.len() as f64;
        let step = (room / entries.len() as f64).min(23.0);
        let mut y = cell.y + 30.0;
        for (sign, text) in &entries {
            sign(drawing, [x + 10.0, y]);
            drawing.text([x + 32.0, y + 0.5 * CAP * LABEL], text, LABEL, INK, Anchor::Start);
            y += step;
        }
        y += 12.0;
        drawing.text([x, y + 10.0], "Each halving of the error multiplies", LABEL, INK, Anchor::Start);
        y += 33.0;
        for (c, price, members) in prices {
            let text = match price {
                Some(price) => format!("× {}", Format::Plain.write((price.factor() * 100.0).round() / 100.0)),
                None => "–".into(),
            };
            let basis = match price {
                Some(Halving::Regression { points, .. }) => format!("fit over {points} points"),
                Some(Halving::Ends { .. }) => "two points only".into(),
                None => format!("front of {members}: cannot say"),
            };
            drawing.text([x, y], COSTS[*c].short, TICK, MUTED, Anchor::Start);
            drawing.text([x + 236.0, y], text, TICK, INK, Anchor::End);
            drawing.text([x + 250.0, y], basis, TICK, MUTED, Anchor::Start);
            y += 20.0;
        }
    }
}

/// Draws the sign of a legend's entry around a place.
type Sign = Box<dyn Fn(&mut Drawing, [f64; 2])>;

fn listed(costs: &[usize]) -> String {
    costs.iter().map(|c| COSTS[*c].label).collect::<Vec<_>>().join("; ")
}

/// A point: its shape tells the order, its colour whether it is on the front.
fn marker(drawing: &mut Drawing, [x, y]: [f64; 2], order: Option<u32>, on_front: bool) {
    let r = if on_front { 5.0 } else { 4.0 };
    let (fill, edge) = if on_front { (ACCENT, WHITE) } else { (WHITE, GREY) };
    let stroke = Stroke::new(edge, if on_front { 1.0 } else { 1.5 });
    let corners: &[[f64; 2]] = match order {
        Some(2) => &[[0.0, -1.15], [1.05, 0.75], [-1.05, 0.75]],
        Some(5) => &[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
        None | Some(3) => &[],
        Some(_) => &[[0.0, -1.2], [1.2, 0.0], [0.0, 1.2], [-1.2, 0.0]],
    };
    if corners.is_empty() {
        drawing.circle([x, y], r, Some(fill), Some(stroke));
    } else {
        let points: Vec<[f64; 2]> = corners.iter().map(|c| [x + r * c[0], y + r * c[1]]).collect();
        drawing.polygon(points, Some(fill), Some(stroke));
    }
}
