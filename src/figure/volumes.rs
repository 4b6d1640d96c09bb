//! Figures of irradiance volumes: walks and popping, where errors sit, what iterations bring, what volumes keep.

use std::path::Path;

use super::Figure;
use super::curves::{CurvePoint, Curves, Quantity, Series};
use super::dots::{Dot, DotPanel, Dots};
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke, fitted, text_width};
use super::panel::{Axis, Panel};
use super::scale::{Format, Scale};
use super::style::{ACCENT, INK, LABEL, MUTED, PANEL_TITLE, SECOND, TICK};
use super::table::{Group, Row, Table, name, varying_axes};
use super::tabular::{Cell, Column, Line, Tabular};

/// Whether every row is a volume.
pub fn are_volumes(rows: &[Row]) -> bool {
    !rows.is_empty() && rows.iter().all(|row| row.number("samples").is_some())
}

/// A dot chart of some columns, those without any value left out; None where fewer than two rows have one.
fn columns_figure(
    group: &Group,
    title: String,
    subtitle: String,
    columns: &[(&str, &str, &str)],
    order: &str,
) -> Option<Figure> {
    let mut rows = group.rows.clone();
    let key = |row: &Row| row.number(order).unwrap_or(f64::INFINITY);
    rows.sort_by(|a, b| key(b).total_cmp(&key(a)));
    let varying = varying_axes(&rows);
    let panels: Vec<DotPanel> = columns
        .iter()
        .filter_map(|(column, title, label)| {
            let values: Vec<Option<f64>> = rows.iter().map(|row| row.number(column)).collect();
            (values.iter().flatten().count() >= 2).then(|| DotPanel {
                title: (*title).to_owned(),
                label: (*label).to_owned(),
                format: Format::Percent,
                scale: errors_from(values.iter().flatten().copied(), NOTHING),
                guide: None,
                absent: "none".into(),
                dots: values
                    .into_iter()
                    .map(|value| value.map(|value| Dot { value, interval: None, each: Vec::new() }))
                    .collect(),
            })
        })
        .collect();
    (panels.len() >= 2)
        .then(|| Dots { title, subtitle, names: rows.iter().map(|row| name(row, &varying)).collect(), panels }.figure())
}

/// Under this a jump is rounding.
const NOTHING: f64 = 1e-7;

/// A logarithmic scale on which what is under a floor counts as zero.
fn errors_from(values: impl Iterator<Item = f64>, floor: f64) -> Scale {
    let values: Vec<f64> = values.map(|v| if v < floor { 0.0 } else { v }).collect();
    Scale::log(values)
}

/// How far each scheme pops: on a walk, across faces, between levels.
pub fn pops(group: &Group, subtitle: String) -> Option<Figure> {
    let pops = |row: &Row| ["path_jump", "face_jump"].iter().any(|c| row.number(c).is_some_and(|v| v > NOTHING));
    if !group.rows.iter().any(pops) {
        return None;
    }
    columns_figure(
        group,
        format!("{}, {}: what pops", group.key[0], group.key[1]),
        subtitle,
        &[
            ("path_jump", "on the way", "largest pop on a slow walk"),
            ("face_jump", "across any face", "largest jump of a cell's face"),
            ("level_jump", "between levels", "faces between cells of two sizes"),
            ("nrmse", "error", "nRMSE"),
        ],
        "path_jump",
    )
}

/// Where volumes err.
pub fn places(group: &Group, subtitle: String) -> Option<Figure> {
    let any = group.rows.iter().any(|row| row.number("leak").is_some() || row.number("boundary_nrmse").is_some());
    if !any {
        return None;
    }
    columns_figure(
        group,
        format!("{}, {}: where volumes err", group.key[0], group.key[1]),
        subtitle,
        &[
            ("nrmse", "everywhere", "nRMSE"),
            ("boundary_nrmse", "at level boundaries", "nRMSE in cells that meet finer ones"),
            ("near_nrmse", "near geometry", "nRMSE, nearest quarter"),
            ("far_nrmse", "far from geometry", "nRMSE, farthest quarter"),
            ("leak", "leaked light", "mean E in the dark over the lit"),
        ],
        "nrmse",
    )
}

/// Most curves of a figure of errors by distance.
const CURVES: usize = 14;

/// Error by distance to static geometry, four quarters of the points.
pub fn by_distance(group: &Group, subtitle: String) -> Option<Figure> {
    let mut rows: Vec<Row> = group.rows.iter().copied().filter(|row| row.number("near_m").is_some()).collect();
    let varying = varying_axes(&rows);
    rows.sort_by(|a, b| a.number("samples").unwrap_or(0.0).total_cmp(&b.number("samples").unwrap_or(0.0)));
    if rows.len() > CURVES {
        let last = rows.len() - 1;
        rows = (0..CURVES).map(|i| rows[i * last / (CURVES - 1)]).collect();
    }
    let mut series: Vec<Series> = rows
        .iter()
        .map(|row| Series {
            name: name(row, &varying),
            points: ["near", "second", "third", "far"]
                .iter()
                .filter_map(|quarter| {
                    let number = |what: &str| row.number(&format!("{quarter}_{what}"));
                    Some(CurvePoint { x: number("m")?, y: number("nrmse")?, interval: None })
                })
                .collect(),
        })
        .collect();
    series.retain(|series| series.points.len() > 1);
    (series.len() > 1).then(|| {
        Curves {
            title: format!("{}, {}: error by distance to geometry", group.key[0], group.key[1]),
            subtitle,
            x: Quantity {
                label: "mean distance of a quarter of the points, nearest first, m".into(),
                format: Format::Plain,
                log: false,
            },
            y: Quantity { label: "nRMSE of these points".into(), format: Format::Percent, log: true },
            series,
        }
        .figure()
    })
}

/// What the number in names `SERIES-VALUE` of probe sources brings: a curve a rig; sources without a number as level lines.
pub fn source_series(group: &Group, subtitle: &str) -> Vec<(String, Figure)> {
    let split = |row: &Row| -> Option<(String, f64)> {
        let (series, value) = row.text("probe_source").rsplit_once('-')?;
        Some((series.to_owned(), value.parse().ok()?))
    };
    let others: Vec<&str> = varying_axes(&group.rows).into_iter().filter(|axis| *axis != "probe_source").collect();
    let mut names: Vec<String> = group.rows.iter().filter_map(|row| split(row).map(|(series, _)| series)).collect();
    names.sort_unstable();
    names.dedup();
    names
        .into_iter()
        .filter_map(|series_name| {
            let mut series: Vec<Series> = Vec::new();
            for row in &group.rows {
                let (Some((own, x)), Some(y)) = (split(row), row.number("nrmse")) else { continue };
                if own != series_name {
                    continue;
                }
                let name = name(row, &others);
                match series.iter_mut().find(|known| known.name == name) {
                    Some(known) => known.points.push(CurvePoint { x, y, interval: None }),
                    None => series.push(Series { name, points: vec![CurvePoint { x, y, interval: None }] }),
                }
            }
            series.iter_mut().for_each(|series| series.points.sort_by(|a, b| a.x.total_cmp(&b.x)));
            series.retain(|series| series.points.len() > 2);
            let ends = series.iter().flat_map(|series| &series.points).map(|point| point.x);
            let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
            if series.is_empty() {
                return None;
            }
            for row in group.rows.iter().filter(|row| split(row).is_none()) {
                let (source, Some(y)) = (row.text("probe_source"), row.number("nrmse")) else { continue };
                let points = [low, high].map(|x| CurvePoint { x, y, interval: None }).to_vec();
                series.push(Series { name: format!("{}, {source}", name(row, &others)), points });
            }
            let figure = Curves {
                title: format!("{}, {}: error by {series_name}", group.key[0], group.key[1]),
                subtitle: subtitle.to_owned(),
                x: Quantity { label: series_name.clone(), format: Format::Plain, log: low > 0.0 && high / low > 20.0 },
                y: Quantity { label: "nRMSE".into(), format: Format::Percent, log: true },
                series,
            }
            .figure();
            Some((series_name, figure))
        })
        .collect()
}

/// A candidate's walk.
struct WalkPanel {
    name: String,
    run: String,
    says: String,
    /// Metres and level.
    volume: Vec<[f64; 2]>,
    truth: Vec<[f64; 2]>,
    /// Metres and pop.
    pops: Vec<[f64; 2]>,
}

const WALK: (f64, f64) = (330.0, 215.0);
const WALK_COLUMNS: usize = 3;
const WALK_TOP: f64 = 92.0;
/// Most walks of a figure.
const WALKS: usize = 18;
/// A pop above this share of the mean is marked.
const SEEN: f64 = 0.005;

/// Light at the centre of what moves, along its path: each scheme beside the traced truth, and where it pops.
pub fn walks(group: &Group, subtitle: String, folder: &Path) -> Option<Figure> {
    let varying = varying_axes(&group.rows);
    let mut panels: Vec<WalkPanel> = Vec::new();
    for row in group.rows.iter().filter(|row| !row.text("run").is_empty()) {
        let path = folder.join("volumes").join(format!("{}-walk.csv", row.text("run")));
        let Ok(walk) = Table::read(&path) else { continue };
        // one object: the first that moves
        let first = walk.rows().next()?.text("object").to_owned();
        let of = |kind: &str, column: &str| -> Vec<[f64; 2]> {
            let rows = walk.rows().filter(|r| r.text("kind") == kind && r.text("object") == first);
            rows.filter_map(|r| Some([r.number("metres")?, r.number(column)?])).collect()
        };
        let jump = row.number("path_jump").map(|v| format!("largest pop {}", Format::Percent.write(v)));
        let error = row.number("nrmse").map(|v| format!("nRMSE {}", Format::Percent.write(v)));
        panels.push(WalkPanel {
            name: name(row, &varying),
            run: row.text("run").to_owned(),
            says: jump.into_iter().chain(error).collect::<Vec<_>>().join(" · "),
            volume: of("volume", "level"),
            truth: of("truth", "level"),
            pops: of("volume", "pop"),
        });
    }
    panels.retain(|panel| panel.volume.len() > 1);
    panels.truncate(WALKS);
    if panels.len() < 2 {
        return None;
    }
    let title = format!("{}, {}: light along the way", group.key[0], group.key[1]);
    let columns = panels.len().min(WALK_COLUMNS);
    let lines = panels.len().div_ceil(columns);
    let mut drawing = Drawing::new(
        24.0 + columns as f64 * WALK.0,
        WALK_TOP + lines as f64 * WALK.1 + 10.0,
        format!("{title}. {subtitle}. Mean irradiance at the centre of what moves against metres gone."),
    );
    drawing.heading(&title, &subtitle);
    let mut x = 16.0;
    for (colour, width, text) in [
        (INK.tint(0.55), 4.0, "traced truth"),
        (ACCENT, 1.6, "the volume"),
        (SECOND, 2.0, "pops above 0.5 % of the mean"),
    ] {
        drawing.line([[x, 76.0], [x + 20.0, 76.0]], Stroke::new(colour, width));
        drawing.text([x + 27.0, 76.0 + 0.5 * CAP * TICK], text, TICK, INK, Anchor::Start);
        x += 48.0 + text_width(text, LABEL);
    }
    let levels = || panels.iter().flat_map(|p| p.volume.iter().chain(&p.truth)).map(|p| p[1]);
    // what rings below zero, or nearly to it, does not take the axis from the rest; nor does what is beyond all truth
    let truth = || panels.iter().flat_map(|p| &p.truth).map(|p| p[1]);
    let most = truth().fold(0.0, f64::max);
    let most = if most > 0.0 { 10.0 * most } else { levels().fold(0.0, f64::max) };
    let kept: Vec<f64> = levels().filter(|v| *v > 1e-4 * most && *v <= most).collect();
    let (least, largest) = kept.iter().fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(*v), b.max(*v)));
    let level_scale = if largest > 4.0 * least { Scale::log(kept) } else { Scale::linear(kept.iter().copied(), false) };
    let metres = Scale::linear(panels.iter().flat_map(|p| &p.volume).map(|p| p[0]), true);
    let mut data = Table::new(&["candidate", "run", "kind", "metres", "value"]);
    for (index, panel) in panels.iter().enumerate() {
        let cell = Rect::new(
            12.0 + (index % columns) as f64 * WALK.0,
            WALK_TOP + (index / columns) as f64 * WALK.1 + 34.0,
            WALK.0 - 8.0,
            WALK.1 - 38.0,
        );
        let last_line = index + columns >= panels.len();
        let first_column = index % columns == 0;
        let axis = |label: &str, scale, format| Axis { label: label.into(), scale, format };
        let plot = Panel::in_cell(
            cell,
            "",
            axis(if last_line { "metres gone" } else { " " }, metres, Format::Plain),
            axis(if first_column { "mean E, W/m²" } else { " " }, level_scale, Format::Plain),
        );
        plot.draw(&mut drawing, "");
        let width = cell.right() - plot.area.x;
        drawing.text(
            [plot.area.x, cell.y - 16.0],
            fitted(&panel.name, PANEL_TITLE, width),
            PANEL_TITLE,
            INK,
            Anchor::Start,
        );
        drawing.text([plot.area.x, cell.y], fitted(&panel.says, TICK, width), TICK, MUTED, Anchor::Start);
        let line = |points: &[[f64; 2]]| -> Vec<[f64; 2]> {
            points.iter().map(|p| plot.at(p[0], p[1].clamp(level_scale.ends().0, level_scale.ends().1))).collect()
        };
        for [x, pop] in &panel.pops {
            if *pop > SEEN {
                let x = plot.at(*x, 1.0)[0];
                let height = (0.2 + 0.2 * (pop / SEEN).log10()).clamp(0.1, 1.0) * 26.0;
                let foot = plot.area.bottom();
                drawing.line([[x, foot], [x, foot - height]], Stroke::new(SECOND, 1.6));
            }
        }
        drawing.line(line(&panel.truth), Stroke::new(INK.tint(0.35), 4.0));
        drawing.line(line(&panel.volume), Stroke::new(ACCENT, 1.5));
        for (kind, points) in [("volume", &panel.volume), ("truth", &panel.truth), ("pop", &panel.pops)] {
            // every fourth row draws the same line
            for [x, y] in points.iter().step_by(if kind == "truth" { 1 } else { 4 }) {
                data.push([panel.name.clone(), panel.run.clone(), kind.into(), x.to_string(), y.to_string()]);
            }
        }
    }
    Some(Figure::new(drawing, data))
}

/// A column of the table of sizes: its heading, its name in the CSV, the number, and how that is written.
type SizeColumn = (&'static str, &'static str, fn(&Row) -> Option<f64>, Format);

const SIZES: [SizeColumn; 8] = [
    ("order", "order", |row| row.number("order"), Format::Count),
    ("samples", "samples", |row| row.number("samples"), Format::Count),
    ("floats a sample", "floats_a_sample", |row| Some(row.number("floats")? / row.number("samples")?), Format::Count),
    ("samples' bytes", "samples_bytes", |row| Some(4.0 * row.number("floats")?), Format::Unit("B")),
    ("with the tree", "model_bytes", |row| row.number("model_bytes"), Format::Unit("B")),
    ("nRMSE", "nrmse", |row| row.number("nrmse"), Format::Percent),
    ("the volume's share", "interpolation_nrmse", |row| row.number("interpolation_nrmse"), Format::Percent),
    ("bake", "bake_s", |row| row.number("bake_s"), Format::Unit("s")),
];

/// What was published for 4913 uniform samples with gradients, bytes by order.
const PUBLISHED: [(f64, f64); 2] = [(3.0, 2.0e6), (6.0, 8.2e6)];
const PUBLISHED_SAMPLES: f64 = 4913.0;

/// Sizes of volumes, beside the published ones: a table.
pub fn sizes(group: &Group, subtitle: String) -> Option<Figure> {
    let mut rows = group.rows.clone();
    if rows.len() < 2 || !varying_axes(&rows).contains(&"order") || !are_volumes(&rows) {
        return None;
    }
    let number = |row: &Row, column: &str| row.number(column).unwrap_or(0.0);
    rows.sort_by(|a, b| {
        let key = |row: &Row| [number(row, "order"), number(row, "samples")];
        key(a)[0].total_cmp(&key(b)[0]).then(key(b)[1].total_cmp(&key(a)[1]))
    });
    let others: Vec<&str> = varying_axes(&rows).into_iter().filter(|axis| *axis != "order").collect();
    // the smallest that errs no more than the largest uniform one, order by order
    let best = |order: f64| -> Option<&str> {
        let of = || rows.iter().filter(|row| row.number("order") == Some(order));
        let largest = of()
            .filter(|row| row.text("heuristic").is_empty())
            .max_by(|a, b| number(a, "samples").total_cmp(&number(b, "samples")))?;
        let limit = 1.05 * largest.number("interpolation_nrmse")?;
        of().filter(|row| !row.text("heuristic").is_empty() && number(row, "interpolation_nrmse") <= limit)
            .min_by(|a, b| number(a, "samples").total_cmp(&number(b, "samples")))
            .map(|row| row.text("run"))
    };
    let column = |heading: &str, name: &str, words| Column { heading: heading.into(), name: name.into(), words };
    let columns = std::iter::once(column("volume", "candidate", true))
        .chain(SIZES.iter().map(|(heading, name, ..)| column(heading, name, false)))
        .chain([column("published, 4913 samples", "published_bytes", false)]);
    let line = |(index, row): (usize, &Row)| {
        let order = number(row, "order");
        let name = name(row, &others);
        let mut cells = vec![Cell { shown: name.clone(), exact: name }];
        for (_, _, value, format) in &SIZES {
            let value = value(row);
            cells.push(Cell {
                shown: value.map_or(String::new(), |value| match format {
                    Format::Count => value.to_string(),
                    format => format.write(value),
                }),
                exact: value.map_or(String::new(), |value| value.to_string()),
            });
        }
        let known = PUBLISHED.iter().find(|(of, _)| *of == order && number(row, "samples") == PUBLISHED_SAMPLES);
        cells.push(known.map_or_else(Cell::default, |(_, bytes)| Cell {
            shown: format!("≈ {}", Format::Unit("B").write(*bytes)),
            exact: bytes.to_string(),
        }));
        Line {
            cells,
            run: row.text("run").to_owned(),
            marked: best(order) == Some(row.text("run")),
            begins: index > 0 && number(&rows[index - 1], "order") != order,
        }
    };
    let lines: Vec<Line> = rows.iter().enumerate().map(line).collect();
    let note =
        "marked: the smallest tree whose share of the error is at most that of the largest grid (5 % more allowed)";
    let note = if lines.iter().any(|line| line.marked) { note } else { "" };
    Some(
        Tabular {
            title: format!("{}, {}: what volumes keep", group.key[0], group.key[1]),
            subtitle,
            columns: columns.collect(),
            lines,
            note: note.to_owned(),
        }
        .figure(),
    )
}

/// `SERIES-NUMBER`: the series.
fn numbered(rig: &str) -> Option<&str> {
    let (series, number) = rig.rsplit_once('-')?;
    number.parse::<f64>().is_ok().then_some(series)
}

/// A cost of even grids at an error, straight between them in logarithms, and on beyond the last two. `grids`: error and cost.
fn cost_at(grids: &[(f64, f64)], error: f64) -> Option<f64> {
    let mut grids: Vec<(f64, f64)> =
        grids.iter().filter(|(e, c)| *e > 0.0 && *c > 0.0).map(|(e, c)| (e.ln(), c.ln())).collect();
    grids.sort_by(|a, b| a.0.total_cmp(&b.0));
    grids.dedup_by(|a, b| a.0 == b.0);
    let upper =
        grids.iter().position(|(e, _)| *e >= error.ln()).unwrap_or(grids.len()).clamp(1, grids.len().max(2) - 1);
    let (a, b) = (grids.get(upper - 1)?, grids.get(upper)?);
    Some((a.1 + (b.1 - a.1) * (error.ln() - a.0) / (b.0 - a.0)).exp())
}

/// What adaptive volumes save: costs of an even grid with the same error, over their own. Even grids are the rigs `SERIES-NUMBER`
/// without a heuristic, two at least.
pub fn savings(group: &Group, subtitle: String) -> Option<Figure> {
    const ERROR: &str = "interpolation_nrmse";
    let is_even = |row: &&Row| row.text("heuristic").is_empty() && numbered(row.text("rig")).is_some();
    let even: Vec<Row> = group.rows.iter().copied().filter(|row| is_even(&row)).collect();
    let mut rows: Vec<Row> = group.rows.iter().copied().filter(|row| !is_even(&row)).collect();
    if !are_volumes(&group.rows) || even.len() < 2 || rows.len() < 2 || varying_axes(&rows).contains(&"order") {
        return None;
    }
    rows.sort_by(|a, b| a.number(ERROR).unwrap_or(0.0).total_cmp(&b.number(ERROR).unwrap_or(0.0)));
    let varying = varying_axes(&rows);
    let factors = |column: &str| -> Vec<Option<f64>> {
        let grids: Vec<(f64, f64)> =
            even.iter().filter_map(|row| Some((row.number(ERROR)?, row.number(column)?))).collect();
        rows.iter()
            .map(|row| Some(cost_at(&grids, row.number(ERROR)?)? / row.number(column).filter(|own| *own > 0.0)?))
            .collect()
    };
    let mut panels: Vec<DotPanel> = [
        ("samples", "samples"),
        ("model_bytes", "bytes"),
        ("bake_s", "time of the bake"),
        ("eval_ns_per_point", "time of a lookup"),
    ]
    .into_iter()
    .filter_map(|(column, title)| {
        let found = factors(column);
        (found.iter().flatten().count() > 1).then(|| DotPanel {
            title: title.into(),
            label: "even grid of equal error, over its own".into(),
            format: Format::Plain,
            scale: Scale::log(found.iter().flatten().copied().chain([1.0]).collect::<Vec<_>>()),
            guide: Some(1.0),
            absent: "no value".into(),
            dots: found.into_iter().map(|v| v.map(|value| Dot { value, interval: None, each: Vec::new() })).collect(),
        })
    })
    .collect();
    let errors: Vec<Option<f64>> = rows.iter().map(|row| row.number(ERROR)).collect();
    panels.insert(
        0,
        DotPanel {
            title: "error".into(),
            label: "what the volume adds, nRMSE".into(),
            format: Format::Percent,
            scale: Scale::log(errors.iter().flatten().copied().collect::<Vec<_>>()),
            guide: None,
            absent: "no value".into(),
            dots: errors.into_iter().map(|v| v.map(|value| Dot { value, interval: None, each: Vec::new() })).collect(),
        },
    );
    let title = format!("{}, {}: what each heuristic buys", group.key[0], group.key[1]);
    let subtitle = format!("{subtitle} · above 1: better than an even grid of the same error");
    (panels.len() > 1)
        .then(|| Dots { title, subtitle, names: rows.iter().map(|row| name(row, &varying)).collect(), panels }.figure())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cost_of_an_even_grid_of_equal_error() {
        // error falls with the square of the cost
        let grids: Vec<(f64, f64)> = [10.0, 100.0, 1000.0].into_iter().map(|c: f64| (1.0 / (c * c), c)).collect();
        for cost in [3.0, 10.0, 31.0, 1000.0, 5000.0f64] {
            assert!((cost_at(&grids, 1.0 / (cost * cost)).unwrap() / cost - 1.0).abs() < 1e-9, "{cost}");
        }
        assert_eq!(cost_at(&grids[..1], 1.0), None);
    }
}
