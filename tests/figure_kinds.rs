//! Every kind of figure from plain data. Set RIGBENCH_GALLERY=DIR to keep the files and look at them.

use rigbench::figure::Figure;
use rigbench::figure::colour_map::ColourMap;
use rigbench::figure::contact_sheet::{ContactSheet, Shown};
use rigbench::figure::curves::{CurvePoint, Curves, Quantity, Series};
use rigbench::figure::dots::{Dot, DotPanel, Dots};
use rigbench::figure::drawing::{Anchor, Drawing, Item, Rect};
use rigbench::figure::fronts::{COSTS, Fronts, Point};
use rigbench::figure::heat_map::{ColumnGroup, HeatMap};
use rigbench::figure::scale::{Format, Scale};
use rigbench::figure::split::{Split, SplitPanel, SplitRow};
use rigbench::figure::style::INK;
use rigbench::figure::table::Table;
use rigbench::math::{Stream, StreamPurpose};
use rigbench::picture::Picture;

/// Texts that lie on each other or leave the drawing.
fn misplaced(figure: &Figure) -> Vec<String> {
    let boxes = figure.drawing.text_boxes();
    let page = Rect::new(0.0, 0.0, figure.drawing.width, figure.drawing.height);
    let mut found = Vec::new();
    for (i, (text, rect)) in boxes.iter().enumerate() {
        if rect.overlap(&page) < 0.999 * rect.width * rect.height {
            found.push(format!("`{text}` leaves the page"));
        }
        let others = boxes[..i].iter().filter(|(_, other)| rect.overlap(other) > 0.0);
        found.extend(others.map(|(other, _)| format!("`{text}` lies on `{other}`")));
    }
    found
}

/// Checks a figure, and writes it where the gallery is asked for.
fn keep(figure: &Figure, name: &str) {
    assert_eq!(misplaced(figure), Vec::<String>::new(), "{name}");
    let smallest =
        figure.drawing.items.iter().filter_map(|i| if let Item::Text { size, .. } = i { Some(*size) } else { None });
    assert!(smallest.fold(f64::MAX, f64::min) >= 12.0, "{name} has text that is too small");
    assert!(!figure.data.rows.is_empty(), "{name} has no data");
    assert_eq!(figure.svg(), figure.clone().svg());
    if let Some(folder) = std::env::var_os("RIGBENCH_GALLERY") {
        figure.write(std::path::Path::new(&folder), name).unwrap();
    }
}

#[test]
fn a_misplaced_text_is_seen() {
    let mut drawing = Drawing::new(200.0, 100.0, "");
    drawing.text([10.0, 50.0], "lattice", 12.0, INK, Anchor::Start);
    drawing.text([10.0, 70.0], "mixed", 12.0, INK, Anchor::Start);
    let mut figure = Figure::new(drawing, Table::new(&["a"]));
    assert!(misplaced(&figure).is_empty());
    figure.drawing.text([30.0, 52.0], "gradient", 12.0, INK, Anchor::Start);
    figure.drawing.text([180.0, 90.0], "constant", 12.0, INK, Anchor::Start);
    assert_eq!(misplaced(&figure).len(), 2);
}

/// Rigs as (name, SH vectors, error); times follow from the vectors as they do on a processor.
fn points(orders: &[u32], with_zero: bool) -> Vec<Point> {
    let rigs = [
        ("direct", 0.0, 0.031),
        ("constant", 1.0, 0.31),
        ("gradient", 4.0, 0.124),
        ("lattice 2x2x2", 8.0, 0.092),
        ("lattice 3x2x2", 12.0, 0.074),
        ("lattice 3x3x3", 27.0, 0.0435),
        ("lattice 8x4x2", 64.0, 0.0381),
        ("mixed lgc", 6.0, 0.0702),
        ("mixed lcg", 6.0, 0.0815),
        ("mixed best", 6.0, 0.0613),
    ];
    let mut points = Vec::new();
    for &order in orders {
        for (i, (name, vectors, error)) in rigs.into_iter().enumerate() {
            if name == "direct" && order != orders[0] {
                continue;
            }
            let direct = name == "direct";
            let size = f64::from(order * order) / 9.0;
            let error = error * (0.6 + 1.2 / f64::from(order)) * (1.0 + 0.02 * i as f64);
            let setup = 3.0 + 1.9 * vectors * size;
            let eval = if direct { 0.09 } else { 0.006 + 0.0016 * vectors.min(8.0) * size };
            points.push(Point {
                name: if orders.len() > 1 && !direct { format!("{name} /{order}") } else { name.into() },
                run: format!("{:012x}", 7919 * (i as u64 + 100 * u64::from(order))),
                order: (!direct).then_some(order),
                error: Some(if with_zero && i == 6 { 0.0 } else { error }),
                costs: COSTS
                    .iter()
                    .map(|cost| match cost.column {
                        "frame_us_vertices" => Some(if direct { 0.0 } else { setup } + 2400.0 * eval),
                        "frame_us_1m" => Some(if direct { 0.0 } else { setup } + 1e6 * eval),
                        "setup_us" => Some(if direct { 0.0 } else { setup }),
                        "model_bytes" => (!direct).then_some(vectors * 108.0 * size),
                        "sh_vectors" => (!direct).then_some(vectors),
                        // of a bake, which no rig around an object has
                        _ => None,
                    })
                    .collect(),
            });
        }
    }
    points
}

#[test]
fn fronts() {
    for (orders, with_zero, name) in [(&[3][..], false, "front"), (&[2, 3, 5], true, "front-orders")] {
        let figure = Fronts {
            title: "Car beside three lamps: error against cost".into(),
            subtitle: "car · three-lamps · cpu · 10 candidates".into(),
            error_label: "nRMSE".into(),
            points: points(orders, with_zero),
            unresolved_below: with_zero.then_some(0.02),
        }
        .figure();
        keep(&figure, name);
    }
}

/// Numbers that look like measurements: the same each time.
fn noise(i: usize) -> f64 {
    Stream::indexed(3, StreamPurpose::Test, i as u64).uniform()
}

#[test]
fn split() {
    let panel = |title: &str, seed: usize| SplitPanel {
        title: title.into(),
        rows: points(&[3], false)
            .into_iter()
            .enumerate()
            .map(|(i, p)| {
                let error = p.error.unwrap() * (0.7 + 0.6 * noise(seed + i));
                let direct = p.name == "direct";
                SplitRow {
                    name: p.name,
                    truncation: (!direct).then_some(0.043),
                    interpolation: (!direct).then_some(error),
                    total: (i != 4).then_some(if direct { 0.031 } else { (error * error + 0.0018).sqrt() }),
                }
            })
            .collect(),
    };
    let titles = ["three-lamps", "coloured-emitters", "far-lights", "near-emitters"];
    let figure = Split {
        title: "Car: where the error comes from".into(),
        subtitle: "scene car · cpu · irradiance at the area points, over the reference's RMS".into(),
        panels: titles.iter().enumerate().map(|(i, t)| panel(t, 50 * i)).collect(),
    }
    .figure();
    keep(&figure, "split");
}

#[test]
fn dots() {
    let names: Vec<String> = points(&[3], false).into_iter().map(|p| p.name).collect();
    let panel = |title: &str, seed: usize| {
        let dots = (0..names.len()).map(|i| {
            let each: Vec<f64> = (0..16)
                .map(|k| (1.0 + i as f64 + 4.0 * (noise(seed + 16 * i + k) - 0.5)).round().clamp(1.0, 10.0))
                .collect();
            let mean = each.iter().sum::<f64>() / 16.0;
            (i != 3).then_some(Dot { value: mean, interval: Some((mean - 0.6, mean + 0.6)), each })
        });
        DotPanel {
            title: title.into(),
            label: "mean rank, 1 is best".into(),
            format: Format::Plain,
            scale: Scale::Linear { low: 0.5, high: 10.5 },
            guide: None,
            absent: "no value".into(),
            dots: dots.collect(),
        }
    };
    let figure = Dots {
        title: "Ranks over all scenes and lights".into(),
        subtitle: "16 cases · cpu · dot: mean, line: its 95 % interval, strokes: single cases".into(),
        names: names.clone(),
        panels: vec![panel("nRMSE", 0), panel("interpolation alone", 700), panel("frame time", 1400)],
    }
    .figure();
    keep(&figure, "dots");
}

#[test]
fn heat_map() {
    let rows: Vec<String> = points(&[3], false).into_iter().map(|p| p.name).collect();
    let values: Vec<Vec<Option<f64>>> = (0..rows.len())
        .map(|r| (0..16).map(|c| (r * c != 12).then(|| 0.4 / (1.0 + r as f64) * (0.3 + noise(97 * r + c)))).collect())
        .collect();
    let lights: Vec<String> =
        ["three-lamps", "coloured-emitters", "far-lights", "near-emitters"].map(String::from).to_vec();
    let figure = HeatMap {
        title: "nRMSE of every rig in every case".into(),
        subtitle: "order 3 · cpu".into(),
        value_label: "nRMSE, %".into(),
        format: Format::Percent,
        scale: Scale::log(values.iter().flatten().flatten().copied().collect::<Vec<_>>()),
        map: ColourMap::Paper,
        groups: ["car", "body", "head", "teapot"]
            .map(|n| ColumnGroup { name: n.into(), columns: lights.clone() })
            .to_vec(),
        rows,
        values,
        marked: vec![true; 10],
        mark_label: "best of its column".into(),
    }
    .figure();
    keep(&figure, "heat-map");
}

#[test]
fn curves() {
    let series = |name: &str, i: usize| Series {
        name: name.into(),
        points: (1..8)
            .map(|k| {
                let x = 0.25 * 2f64.powi(k);
                let y = 0.3 / (x * x + 0.4) * (1.0 + 0.3 * i as f64) + 1e-3;
                CurvePoint { x, y, interval: (i < 2).then_some((0.8 * y, 1.3 * y)) }
            })
            .collect(),
    };
    let names =
        ["gradient", "mixed lgc", "mixed lcg", "lattice 2x2x2", "lattice 3x2x2", "lattice 3x3x3", "constant", "direct"];
    let figure = Curves {
        title: "Error against the distance of the light".into(),
        subtitle: "car · one lamp · cpu · band: 95 % interval".into(),
        x: Quantity { label: "distance over the half diagonal".into(), format: Format::Plain, log: true },
        y: Quantity { label: "nRMSE".into(), format: Format::Percent, log: true },
        series: names.iter().enumerate().map(|(i, n)| series(n, i)).collect(),
    }
    .figure();
    keep(&figure, "curves");
}

/// Three balls under two lamps: normal, or nothing, for every pixel.
fn balls(x: usize, y: usize) -> Option<[f64; 3]> {
    [(60.0, 74.0, 34.0), (120.0, 60.0, 48.0), (176.0, 84.0, 26.0)].iter().find_map(|(cx, cy, r)| {
        let (dx, dy) = ((x as f64 - cx) / r, (cy - y as f64) / r);
        let squared = dx * dx + dy * dy;
        (squared < 1.0).then(|| [dx, dy, (1.0 - squared).sqrt()])
    })
}

fn irradiance(error: impl Fn([f64; 3], usize) -> f64) -> Picture {
    Picture::from_fn(240, 135, |x, y| {
        let Some(n) = balls(x, y) else { return [0.0; 3] };
        let lamp = |d: [f64; 3]| (n[0] * d[0] + n[1] * d[1] + n[2] * d[2]).max(0.0);
        let (key, fill) = (lamp([0.48, 0.6, 0.64]), lamp([-0.8, 0.0, 0.6]));
        std::array::from_fn(|c| (0.15 + [4.0, 3.4, 2.6][c] * key + [0.4, 0.8, 1.6][c] * fill + error(n, x)) as f32)
    })
}

#[test]
fn contact_sheet() {
    let albedo = Picture::from_fn(240, 135, |x, y| if balls(x, y).is_some() { [0.7, 0.6, 0.5] } else { [0.0; 3] });
    let rigs: [(&str, f64, f64); 5] = [
        ("constant", 1.0, 0.31),
        ("gradient", 4.0, 0.124),
        ("mixed lgc", 6.0, 0.07),
        ("lattice 3x2x2", 12.0, 0.074),
        ("lattice 8x4x2", 64.0, 0.038),
    ];
    let candidates: Vec<Shown> = rigs
        .iter()
        .map(|(name, vectors, error)| Shown {
            name: (*name).into(),
            run: "0123456789ab".into(),
            irradiance: irradiance(|n, x| 6.0 * error * ((5.0 * n[0]).sin() * (x as f64 / 90.0 - 1.0) + 0.3 * n[1])),
            nrmse: Some(*error),
            sh_vectors: Some(*vectors),
        })
        .collect();
    for (signed, name, count) in [(false, "contact-sheet", 5), (true, "contact-sheet-signed", 3)] {
        let sheet = ContactSheet {
            title: "Three balls under two lamps".into(),
            subtitle: "order 3 · cpu · pictures at the reference's exposure".into(),
            reference: irradiance(|_, _| 0.0),
            albedo: albedo.clone(),
            candidates: candidates[..count].to_vec(),
            signed,
        };
        keep(&sheet.figure(), name);
    }
}
