use std::io;
use std::path::Path;

use rayon::prelude::*;

use super::captures;
use super::colour_map::ColourMap;
use super::contact_sheet::{ContactSheet, Shown};
use super::cosine;
use super::curves::{CurvePoint, Curves, Quantity, Series};
use super::dots::{Dot, DotPanel, Dots};
use super::fronts::{COSTS, Fronts, Point};
use super::hard_cases;
use super::heat_map::{ColumnGroup, HeatMap};
use super::latex::{Captioned, latex};
use super::near_far;
use super::scale::{Format, Scale};
use super::sections::{SectionPanel, Sections};
use super::split::{Split, SplitPanel, SplitRow};
use super::statistics::{mean_interval, ranks, wilson};
use super::strip::{self, SeenSample, Strip};
use super::study;
use super::svg::VERSION;
use super::table::{
    Group, Matrix, Row, Table, by_what_they_keep, family, groups, is_software, name, named_first, varying_axes,
};
use super::volumes;
use super::{FORMS, Figure, TABULAR};
use crate::cost::Samples;
use crate::output::write_whole;
use crate::picture::LayeredImage;

/// A quality that figures are drawn of: its column and what to call it.
const QUALITIES: [(&str, &str, &str); 2] = [
    ("nrmse", "nRMSE", "error"),
    ("interpolation_nrmse", "nRMSE of the interpolation", "what the rig adds to the error"),
];

/// Draws every figure that the data allow: DIR/figures/NAME.svg, .png and .csv, from the table (results.csv) and DIR/images.
/// Gives the names, in order. Where figures of the same data are there, nothing is drawn.
pub fn figures_of(table: &Table, folder: &Path) -> io::Result<Vec<String>> {
    let target = folder.join("figures");
    let source = fingerprint(table, folder)?;
    if let Some(names) = drawn_before(&target, &source) {
        return Ok(names);
    }
    redraw(table, folder, &target)
}

/// As [`figures_of`], into a folder of the caller's choice and whatever is there already. The same data give the same bytes.
pub fn redraw(table: &Table, folder: &Path, target: &Path) -> io::Result<Vec<String>> {
    let source = fingerprint(table, folder)?;
    let names = draw(table, folder, target)?;
    let record = std::iter::once(&source).chain(&names).map(|line| format!("{line}\n")).collect::<String>();
    write_whole(&target.join(DRAWN), record.as_bytes())?;
    Ok(names)
}

/// The file that says what the figures beside it were drawn from: a fingerprint, then the names of the figures.
const DRAWN: &str = ".drawn";
/// The file that includes them all in a paper.
const LATEX: &str = "figures.tex";

/// What figures depend on: this code's version, the table, and which images, places of samples and volumes there are (they are named by
/// their content's key).
fn fingerprint(table: &Table, folder: &Path) -> io::Result<String> {
    let mut files: Vec<String> = Vec::new();
    for inner in ["images", "samples", "volumes"] {
        let Ok(entries) = std::fs::read_dir(folder.join(inner)) else { continue };
        for entry in entries {
            files.push(format!("{inner}/{}", entry?.file_name().to_string_lossy()));
        }
    }
    files.sort_unstable();
    let studies: String =
        study::tables(folder)?.iter().map(|(name, table)| format!("{name}\n{}", table.to_csv())).collect();
    let whole = format!("{VERSION}\n{}\n{}\n{studies}", files.join("\n"), table.to_csv());
    Ok(blake3::hash(whole.as_bytes()).to_hex().to_string())
}

fn drawn_before(target: &Path, source: &str) -> Option<Vec<String>> {
    let record = std::fs::read_to_string(target.join(DRAWN)).ok()?;
    let mut lines = record.lines();
    let names: Vec<String> = (lines.next()? == source).then(|| lines.map(str::to_owned).collect())?;
    let there = |name: &String| FORMS.iter().all(|form| target.join(format!("{name}.{form}")).exists());
    let captions = std::fs::read_to_string(target.join(LATEX)).ok()?;
    let is_included = |name: &String| {
        let table = format!("{name}.{TABULAR}");
        !captions.contains(&format!("\\input{{{table}}}")) || target.join(table).exists()
    };
    names.iter().all(|name| there(name) && is_included(name)).then_some(names)
}

fn draw(table: &Table, folder: &Path, target: &Path) -> io::Result<Vec<String>> {
    if table.columns.iter().any(|column| column == "family") {
        return draw_hard_cases(table, target);
    }
    let pooled = table.pooled();
    let mut jobs = Jobs(Vec::new());
    let rows: Vec<Row> = pooled.rows().collect();
    let named = || rows.iter().copied().filter(|r| family(r.text("lights")).is_none());

    for group in groups(named(), &["scene", "lights", "backend", "adapter"]) {
        for (column, label, title) in QUALITIES {
            let parts =
                [&format!("front-{column}"), group.key[0], group.key[1], group.key[2], &short_adapter(&rows, &group)];
            let group = group.clone();
            jobs.add(&parts, move || fronts(&group, column, label, title));
        }
    }
    for group in groups(named(), &["backend", "adapter", "scene"]) {
        let parts = ["split", group.key[2], group.key[0], &short_adapter_of(&rows, group.key[0], group.key[1])];
        jobs.add(&parts, move || split(&group));
    }
    for group in groups(rows.iter().copied(), &["backend", "adapter"]) {
        let adapter = short_adapter_of(&rows, group.key[0], group.key[1]);
        for (column, label, _) in QUALITIES {
            let group = group.clone();
            let parts = [&format!("overview-{column}"), group.key[0], &adapter];
            jobs.add(&parts, move || overview(&group, column, label));
        }
        jobs.add(&["ranks", group.key[0], &adapter], move || rank_figure(&group));
    }
    for group in groups(named(), &["scene", "lights", "backend", "adapter"]) {
        let adapter = short_adapter(&rows, &group);
        let parts = ["order", group.key[0], group.key[1], group.key[2], &adapter];
        let same = group.clone();
        jobs.add(&parts, move || against_order(&same));
        let parts = ["near-and-far", group.key[0], group.key[1], group.key[2], &adapter];
        let same = group.clone();
        jobs.add(&parts, move || {
            let title = format!("{}, {}: lights near by evaluated directly", same.key[0], same.key[1]);
            near_far::figure(&same.rows, title, case_line(&same))
        });
        let parts = ["volumes", group.key[0], group.key[1], group.key[2], &adapter];
        let same = group.clone();
        jobs.add(&parts, move || volume_sections(&same, folder));
        if volumes::are_volumes(&group.rows) {
            let figures: [(&str, fn(&Group, String) -> Option<Figure>); 5] = [
                ("pops", volumes::pops),
                ("places", volumes::places),
                ("by-distance", volumes::by_distance),
                ("sizes", volumes::sizes),
                ("savings", volumes::savings),
            ];
            for (what, figure) in figures {
                let parts = [what, group.key[0], group.key[1], group.key[2], &adapter];
                let same = group.clone();
                jobs.add(&parts, move || figure(&same, case_line(&same)));
            }
            let parts = ["walks", group.key[0], group.key[1], group.key[2], &adapter];
            let same = group.clone();
            jobs.add(&parts, move || volumes::walks(&same, case_line(&same), folder));
            for (series, figure) in volumes::source_series(&group, &case_line(&group)) {
                let parts = ["by", &series, group.key[0], group.key[1], group.key[2], &adapter];
                jobs.add(&parts, move || Some(figure.clone()));
            }
        }
        let parts = ["frames", group.key[0], group.key[1], group.key[2], &adapter];
        let key = group.key.clone();
        jobs.add(&parts, move || against_frame(table, &key));
        let parts = ["contact-sheet", group.key[0], group.key[1], group.key[2], &adapter];
        // the same pictures again say nothing: the GPU's only where the CPU has none
        let on_cpu = |r: &Row| r.text("backend") == "cpu" && [r.text("scene"), r.text("lights")] == group.key[..2];
        if group.key[2] == "gpu" && rows.iter().any(on_cpu) {
            continue;
        }
        let same = group.clone();
        jobs.add(&parts, move || contact_sheet(&same, folder));
        let parts = ["strip", group.key[0], group.key[1], group.key[2], &adapter];
        jobs.add(&parts, move || strip(&group, folder));
    }
    // errors of both kinds of captures stand side by side, their times never
    for group in groups(named(), &["scene", "lights", "backend"]) {
        let parts = ["captures", group.key[0], group.key[1], group.key[2]];
        let same = group.clone();
        jobs.add(&parts, move || captures::faces(&same));
    }
    let families: Vec<Row> = rows.iter().copied().filter(|r| family(r.text("lights")).is_some()).collect();
    for group in groups(families.iter().copied(), &["scene", "backend", "adapter"]) {
        let mut names: Vec<&str> = group.rows.iter().filter_map(|r| family(r.text("lights"))).collect();
        names.sort_unstable();
        names.dedup();
        for lights in names {
            let members: Vec<Row> =
                group.rows.iter().copied().filter(|r| family(r.text("lights")) == Some(lights)).collect();
            let adapter = short_adapter_of(&rows, group.key[1], group.key[2]);
            let parts = ["family", group.key[0], lights, group.key[1], &adapter];
            let group = Group { key: vec![group.key[0], lights, group.key[1], group.key[2]], rows: members };
            let same = group.clone();
            jobs.add(&parts, move || family_figure(&same));
            let parts = ["wins", group.key[0], lights, group.key[2], &adapter];
            jobs.add(&parts, move || win_figure(&group));
        }
    }

    for (name, table) in study::tables(folder)? {
        for (what, figure) in study::figures(&table) {
            jobs.add(&["study", &name, what], move || Some(figure.clone()));
        }
    }
    let orders: Vec<usize> = rows.iter().filter_map(|r| r.number("order")).map(|o| o as usize).collect();
    jobs.add(&["cosine-by-order"], move || cosine::figure(&orders));

    let drawn: Vec<Option<Captioned>> = jobs
        .0
        .into_par_iter()
        .map(|(name, job)| job().map(|figure| written(figure, name, target)).transpose())
        .collect::<io::Result<_>>()?;
    captions(drawn.into_iter().flatten().collect(), target)
}

/// Of hard cases a figure a family.
fn draw_hard_cases(table: &Table, target: &Path) -> io::Result<Vec<String>> {
    let drawn: Vec<Option<Captioned>> = hard_cases::families(table)
        .into_par_iter()
        .map(|family| {
            let figure = hard_cases::family_figure(table, &family);
            figure.map(|figure| written(figure, family, target)).transpose()
        })
        .collect::<io::Result<_>>()?;
    captions(drawn.into_iter().flatten().collect(), target)
}

/// Writes a figure; what its caption says.
fn written(figure: Figure, name: String, target: &Path) -> io::Result<Captioned> {
    figure.write(target, &name)?;
    let [title, subtitle] = figure.drawing.headings;
    Ok(Captioned { name, title, subtitle, is_table: figure.tabular.is_some() })
}

/// Writes the LaTeX file of what was drawn; gives the names.
fn captions(drawn: Vec<Captioned>, target: &Path) -> io::Result<Vec<String>> {
    if !drawn.is_empty() {
        write_whole(&target.join(LATEX), latex(&drawn).as_bytes())?;
    }
    Ok(drawn.into_iter().map(|figure| figure.name).collect())
}

/// Figures to draw: a name, and what draws it where the data allow.
struct Jobs<'a>(Vec<(String, Job<'a>)>);
type Job<'a> = Box<dyn Fn() -> Option<Figure> + Send + Sync + 'a>;

impl<'a> Jobs<'a> {
    fn add(&mut self, parts: &[&str], job: impl Fn() -> Option<Figure> + Send + Sync + 'a) {
        let name = file_name(parts);
        // two names that differ in odd characters alone still get two files
        let taken = self.0.iter().filter(|(other, _)| *other == name || other.starts_with(&format!("{name}+"))).count();
        let name = if taken == 0 { name } else { format!("{name}+{}", taken + 1) };
        self.0.push((name, Box::new(job)));
    }
}

/// A file name of words: letters, digits, dots and hyphens.
fn file_name(parts: &[&str]) -> String {
    let joined = parts.iter().filter(|p| !p.is_empty()).copied().collect::<Vec<_>>().join("-");
    let mut name = String::new();
    for c in joined.chars() {
        let c = if c.is_ascii_alphanumeric() || c == '.' || c == '_' { c.to_ascii_lowercase() } else { '-' };
        if c != '-' || !name.ends_with('-') {
            name.push(c);
        }
    }
    name.trim_matches('-').to_owned()
}

/// An adapter in a file name: only where one backend has several.
fn short_adapter(rows: &[Row], group: &Group) -> String {
    short_adapter_of(rows, group.key[2], group.key[3])
}

fn short_adapter_of(rows: &[Row], backend: &str, adapter: &str) -> String {
    let several = rows.iter().any(|r| r.text("backend") == backend && r.text("adapter") != adapter);
    if several { adapter.to_owned() } else { String::new() }
}

/// Backend and adapter for a reader; a software adapter is called one.
pub(super) fn machine(backend: &str, adapter: &str) -> String {
    match (backend, adapter) {
        (_, "") => backend.to_owned(),
        ("cpu", _) => format!("cpu: {adapter}"),
        _ if is_software(adapter) => {
            let adapter = adapter.trim_end_matches("(software)").trim_end();
            format!("{backend}: {adapter}, a software adapter: no GPU timings")
        }
        _ => format!("{backend}: {adapter}"),
    }
}

fn case_line(group: &Group) -> String {
    format!("{} · {} · {}", group.key[0], group.key[1], machine(group.key[2], group.key[3]))
}

fn fronts(group: &Group, column: &str, label: &str, title: &str) -> Option<Figure> {
    let varying = varying_axes(&group.rows);
    let volumes = volumes::are_volumes(&group.rows);
    let points: Vec<Point> = group
        .rows
        .iter()
        .map(|r| Point {
            name: name(r, &varying),
            run: r.text("run").to_owned(),
            order: r.number("order").filter(|_| varying.contains(&"order")).map(|o| o as u32),
            error: r.number(column),
            costs: COSTS
                .iter()
                .map(|c| r.number(c.column).filter(|_| c.volumes.is_none_or(|of| of == volumes)))
                .collect(),
        })
        .collect();
    let usable = points.iter().filter(|p| p.error.is_some() && p.costs.iter().any(Option::is_some)).count();
    let noise = group.rows.iter().find_map(|r| r.number("ref_noise")).filter(|_| column == "nrmse");
    (usable >= 2).then(|| {
        let subtitle = format!("{} · {usable} candidates", case_line(group));
        let title = format!("{}, {}: {title} against cost", group.key[0], group.key[1]);
        let unresolved_below = noise.map(|n| 2.0 * n);
        Fronts { title, subtitle, error_label: label.into(), points, unresolved_below }.figure()
    })
}

fn split(group: &Group) -> Option<Figure> {
    let varying = varying_axes(&group.rows);
    let panels: Vec<SplitPanel> = groups(group.rows.iter().copied(), &["lights"])
        .into_iter()
        .map(|lights| SplitPanel {
            title: lights.key[0].to_owned(),
            rows: sorted(&lights.rows)
                .iter()
                .map(|r| SplitRow {
                    name: name(r, &varying),
                    truncation: r.number("truncation_nrmse"),
                    interpolation: r.number("interpolation_nrmse"),
                    total: r.number("nrmse"),
                })
                .collect(),
        })
        .collect();
    panels.iter().flat_map(|p| &p.rows).any(|r| r.interpolation.is_some()).then(|| {
        let scene = group.key[2];
        Split {
            title: format!("{scene}: where the error comes from"),
            subtitle: format!(
                "{} · irradiance at the area points, over the reference's RMS",
                machine(group.key[0], group.key[1])
            ),
            panels,
        }
        .figure()
    })
}

/// Candidates in the order in which figures list them.
fn sorted<'a>(rows: &[Row<'a>]) -> Vec<Row<'a>> {
    let mut rows = rows.to_vec();
    rows.sort_by(by_what_they_keep);
    rows
}

/// Every candidate in every case; a family of random layouts is one column, its median.
fn overview(group: &Group, column: &str, label: &str) -> Option<Figure> {
    let matrix = Matrix::new(&group.rows);
    let values = matrix.values(column);
    let columns: Vec<(&str, &str, Vec<usize>)> = {
        let mut columns: Vec<(&str, &str, Vec<usize>)> = Vec::new();
        for (i, (scene, lights)) in matrix.cases.iter().enumerate() {
            let lights = family(lights).unwrap_or(lights);
            match columns.iter_mut().find(|c| c.0 == *scene && c.1 == lights) {
                Some(column) => column.2.push(i),
                None => columns.push((scene, lights, vec![i])),
            }
        }
        columns.sort_by_key(|c| matrix.cases.iter().position(|(scene, _)| *scene == c.0));
        columns
    };
    let kept: Vec<usize> = (0..values.len()).filter(|r| values[*r].iter().any(Option::is_some)).collect();
    if kept.len() < 2 || columns.is_empty() {
        return None;
    }
    let cells: Vec<Vec<Option<f64>>> = kept
        .iter()
        .map(|r| {
            columns.iter().map(|c| Samples(c.2.iter().filter_map(|i| values[*r][*i]).collect()).median()).collect()
        })
        .collect();
    let mut scenes: Vec<ColumnGroup> = Vec::new();
    for (scene, lights, members) in &columns {
        let heading = if members.len() > 1 { format!("{lights} ({})", members.len()) } else { (*lights).to_owned() };
        match scenes.last_mut().filter(|g| g.name == *scene) {
            Some(group) => group.columns.push(heading),
            None => scenes.push(ColumnGroup { name: (*scene).to_owned(), columns: vec![heading] }),
        }
    }
    let vectors = matrix.values("sh_vectors");
    let families = columns.iter().any(|c| c.2.len() > 1);
    let all: Vec<f64> = cells.iter().flatten().flatten().copied().collect();
    Some(
        HeatMap {
            title: format!("{label} of every rig in every case"),
            subtitle: machine(group.key[0], group.key[1])
                + if families { " · (N): median of N random layouts" } else { "" },
            value_label: format!("{label}, %"),
            format: Format::Percent,
            scale: Scale::log_errors(all),
            map: ColourMap::Paper,
            groups: scenes,
            rows: kept.iter().map(|r| matrix.names[*r].clone()).collect(),
            values: cells,
            // direct is no rig: it would win wherever it is exact
            marked: kept.iter().map(|r| vectors[*r].iter().any(Option::is_some)).collect(),
            mark_label: "best rig of its column".into(),
        }
        .figure(),
    )
}

/// Ranks pooled over all cases, of the candidates that have a value in as many of them as any.
fn rank_figure(group: &Group) -> Option<Figure> {
    let matrix = Matrix::new(&named_first(&group.rows));
    let mut panels = Vec::new();
    let mut cases = 0;
    for (column, title) in [
        ("nrmse", "nRMSE"),
        ("interpolation_nrmse", "interpolation alone"),
        ("frame_us_1m", "frame time, a million points"),
    ] {
        let values = matrix.values(column);
        let kept = most_complete(&values);
        let ranked = ranks(&kept.iter().map(|r| values[*r].clone()).collect::<Vec<_>>());
        let complete = ranked.first().map_or(0, Vec::len);
        if kept.len() < 2 || complete < 2 {
            continue;
        }
        cases = cases.max(complete);
        let mut dots = vec![None; matrix.names.len()];
        for (r, ranks) in kept.iter().zip(ranked) {
            let (value, interval) = mean_interval(&ranks);
            dots[*r] = Some(Dot { value, interval, each: ranks });
        }
        let high = kept.len() as f64 + 0.5;
        panels.push(DotPanel {
            title: title.into(),
            label: "mean rank, 1 is best".into(),
            format: Format::Count,
            scale: Scale::Linear { low: 0.5, high },
            guide: None,
            absent: "no value".into(),
            dots,
        });
    }
    let first = panels.first()?;
    // best first, those without a value in any panel left out
    let mut order: Vec<usize> =
        (0..matrix.names.len()).filter(|i| panels.iter().any(|p| p.dots[*i].is_some())).collect();
    let key = |i: usize| first.dots[i].as_ref().map_or(f64::MAX, |d| d.value);
    order.sort_by(|a, b| key(*a).total_cmp(&key(*b)));
    for panel in &mut panels {
        panel.dots = order.iter().map(|i| panel.dots[*i].clone()).collect();
    }
    Some(
        Dots {
            title: "Ranks over all scenes and lights".into(),
            subtitle: format!(
                "{cases} cases · {} · dot: mean; line: its 95 % interval; strokes: single cases",
                machine(group.key[0], group.key[1])
            ),
            names: order.iter().map(|i| matrix.names[*i].clone()).collect(),
            panels,
        }
        .figure(),
    )
}

/// The candidates with a value in as many cases as any.
pub(super) fn most_complete(values: &[Vec<Option<f64>>]) -> Vec<usize> {
    let known = |r: usize| values[r].iter().flatten().count();
    let most = (0..values.len()).map(known).max().unwrap_or(0);
    (0..values.len()).filter(|r| most > 0 && known(*r) == most).collect()
}

fn against_order(group: &Group) -> Option<Figure> {
    let others: Vec<&str> = varying_axes(&group.rows).into_iter().filter(|a| *a != "order").collect();
    let mut series: Vec<Series> = Vec::new();
    for row in &group.rows {
        let (Some(x), Some(y)) = (row.number("order"), row.number("nrmse")) else { continue };
        let name = name(row, &others);
        let point = CurvePoint { x, y, interval: None };
        match series.iter_mut().find(|s| s.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series { name, points: vec![point] }),
        }
    }
    series.iter_mut().for_each(|s| s.points.sort_by(|a, b| a.x.total_cmp(&b.x)));
    series.retain(|s| s.points.len() > 1);
    (!series.is_empty()).then(|| {
        Curves {
            title: format!("{}, {}: what the order buys", group.key[0], group.key[1]),
            subtitle: case_line(group),
            x: Quantity { label: "order (bands of SH)".into(), format: Format::Count, log: false },
            y: Quantity { label: "nRMSE".into(), format: Format::Percent, log: true },
            series,
        }
        .figure()
    })
}

/// Error over the frames of an animation, from the rows as they are.
fn against_frame(table: &Table, key: &[&str]) -> Option<Figure> {
    let rows: Vec<Row> = table
        .rows()
        .filter(|r| ["scene", "lights", "backend", "adapter"].iter().zip(key).all(|(c, v)| r.text(c) == *v))
        .filter(|r| matches!(r.text("status"), "" | "ok"))
        .collect();
    let varying: Vec<&str> = varying_axes(&rows).into_iter().filter(|a| *a != "receiver").collect();
    let mut series: Vec<Series> = Vec::new();
    for row in &rows {
        let (Some(x), Some(y)) = (row.number("frame"), row.number("nrmse")) else { continue };
        let name = name(row, &varying);
        let point = CurvePoint { x, y, interval: None };
        match series.iter_mut().find(|s| s.name == name) {
            // of several receivers the pooled row stands first
            Some(series) if series.points.iter().any(|p| p.x == x) => {}
            Some(series) => series.points.push(point),
            None => series.push(Series { name, points: vec![point] }),
        }
    }
    series.retain(|s| s.points.len() > 1);
    (!series.is_empty()).then(|| {
        Curves {
            title: format!("{}, {}: error over the animation", key[0], key[1]),
            subtitle: format!("{} · {} · {}", key[0], key[1], machine(key[2], key[3])),
            x: Quantity { label: "frame".into(), format: Format::Count, log: false },
            y: Quantity { label: "nRMSE".into(), format: Format::Percent, log: true },
            series,
        }
        .figure()
    })
}

/// Within this factor of the error of the costliest rig a rig is close to it.
const CLOSE: f64 = 1.25;

/// A family of random layouts: the errors of each rig, and how often it comes close to, and beats, the rig that keeps most vectors.
fn family_figure(group: &Group) -> Option<Figure> {
    let matrix = Matrix::new(&group.rows);
    let errors = matrix.values("interpolation_nrmse");
    let vectors = matrix.values("sh_vectors");
    let layouts = matrix.cases.len();
    let most = |r: usize| vectors[r].iter().flatten().fold(f64::NEG_INFINITY, |m: f64, v| m.max(*v));
    let costliest = (0..matrix.names.len())
        .filter(|r| most(*r) > 0.0)
        .max_by(|a, b| most(*a).total_cmp(&most(*b)).then(b.cmp(a)))?;
    if layouts < 2 || matrix.names.len() < 2 {
        return None;
    }
    let share = |r: usize, factor: f64| {
        let pairs: Vec<bool> =
            (0..layouts).filter_map(|i| Some(errors[r][i]? <= factor * errors[costliest][i]?)).collect();
        let wins = pairs.iter().filter(|w| **w).count();
        (r != costliest && !pairs.is_empty()).then(|| {
            let (value, interval) = wilson(wins, pairs.len());
            Dot { value, interval: Some(interval), each: Vec::new() }
        })
    };
    let spread = |r: usize| {
        let samples = Samples(errors[r].iter().flatten().copied().collect());
        samples.median().map(|value| Dot { value, interval: samples.median_interval(), each: samples.0.clone() })
    };
    let candidates = || 0..matrix.names.len();
    let rate = |title: String, factor: f64| DotPanel {
        title,
        label: "share of the layouts".into(),
        format: Format::Percent,
        scale: Scale::Linear { low: -0.03, high: 1.03 },
        guide: Some(0.5),
        absent: "compared with".into(),
        dots: candidates().map(|r| share(r, factor)).collect(),
    };
    let largest = &matrix.names[costliest];
    let panels = vec![
        DotPanel {
            title: "nRMSE of the interpolation".into(),
            label: "median, its interval, every layout".into(),
            format: Format::Percent,
            scale: Scale::log_errors(errors.iter().flatten().flatten().copied().collect::<Vec<_>>()),
            guide: None,
            absent: "no value".into(),
            dots: candidates().map(spread).collect(),
        },
        rate(format!("within {CLOSE} × {largest}"), CLOSE),
        rate(format!("no worse than {largest}"), 1.0),
    ];
    Some(
        Dots {
            title: format!("{}, {layouts} random layouts of {}", group.key[0], group.key[1]),
            subtitle: format!("{} · lines: 95 % intervals (Wilson's for shares)", machine(group.key[2], group.key[3])),
            names: matrix.names.clone(),
            panels,
        }
        .figure(),
    )
}

/// Who beats whom in a family of random layouts.
fn win_figure(group: &Group) -> Option<Figure> {
    let matrix = Matrix::new(&group.rows);
    let errors = matrix.values("interpolation_nrmse");
    let n = matrix.names.len();
    if n < 2 || matrix.cases.len() < 2 {
        return None;
    }
    let rate = |a: usize, b: usize| {
        let pairs: Vec<bool> = (0..matrix.cases.len()).filter_map(|i| Some(errors[a][i]? < errors[b][i]?)).collect();
        (a != b && !pairs.is_empty()).then(|| pairs.iter().filter(|w| **w).count() as f64 / pairs.len() as f64)
    };
    Some(
        HeatMap {
            title: format!("{}, {}: how often the row beats the column", group.key[0], group.key[1]),
            subtitle: format!(
                "{} random layouts · interpolation alone · {}",
                matrix.cases.len(),
                machine(group.key[2], group.key[3])
            ),
            value_label: "share of the layouts, %".into(),
            format: Format::Percent,
            scale: Scale::Linear { low: 0.0, high: 1.0 },
            map: ColourMap::Paper,
            groups: vec![ColumnGroup { name: String::new(), columns: matrix.names.clone() }],
            rows: matrix.names.clone(),
            values: (0..n).map(|a| (0..n).map(|b| rate(a, b)).collect()).collect(),
            marked: Vec::new(),
            mark_label: String::new(),
        }
        .figure(),
    )
}

/// Most volumes of a figure of sections.
const SECTIONS: usize = 12;

/// Cells and samples of the volumes of a case, from the cuts that a run left in DIR/volumes.
fn volume_sections(group: &Group, folder: &Path) -> Option<Figure> {
    let varying = varying_axes(&group.rows);
    let mut panels: Vec<(f64, SectionPanel)> = Vec::new();
    for row in group.rows.iter().filter(|row| !row.text("run").is_empty()) {
        let path = folder.join("volumes").join(format!("{}.csv", row.text("run")));
        let Ok(cut) = Table::read(&path) else { continue };
        let items: Vec<(String, [f64; 4])> = cut
            .rows()
            .filter_map(|r| {
                let [a, b, c, d] = ["u0", "v0", "u1", "v1"].map(|column| r.number(column));
                Some((r.text("kind").to_owned(), [a?, b?, c?, d?]))
            })
            .collect();
        // the same samples read differently are one picture
        if items.is_empty() || panels.iter().any(|(_, other)| other.items == items) {
            continue;
        }
        let samples = row.number("samples").unwrap_or(0.0);
        let error = row.number("nrmse").map_or(String::new(), |e| format!(", nRMSE {}", Format::Percent.write(e)));
        let says = format!("{samples} samples{error}");
        panels
            .push((samples, SectionPanel { name: name(row, &varying), run: row.text("run").to_owned(), says, items }));
    }
    panels.sort_by(|a, b| a.0.total_cmp(&b.0));
    panels.truncate(SECTIONS);
    (!panels.is_empty()).then(|| {
        Sections {
            title: format!("{}, {}: cells and samples", group.key[0], group.key[1]),
            subtitle: format!("{} · cut at half height, seen from above", case_line(group)),
            panels: panels.into_iter().map(|(_, panel)| panel).collect(),
        }
        .figure()
    })
}

/// A strip of the rigs whose names begin with the letters of its pictures (`a-`, `b-`, `e-`, `f-`): reference and samples stand between.
fn strip(group: &Group, folder: &Path) -> Option<Figure> {
    let mut rows: Vec<Row> = group.rows.iter().copied().filter(|r| strip::lettered(r.text("rig")).is_some()).collect();
    rows.sort_by_key(|r| strip::lettered(r.text("rig")));
    let letters: Vec<char> = rows.iter().filter_map(|r| strip::lettered(r.text("rig"))).collect();
    // as many before the two in the middle as after them
    let half = letters.len() / 2;
    let expected: Vec<char> = ('a'..).take(half).chain(('a'..).skip(half + 2).take(half)).collect();
    if half == 0 || letters != expected {
        return None;
    }
    let sheet = sheet_of(group, folder, rows.clone(), "one sample, or more, with gradients or without")?;
    let places = rows.last().map(|r| folder.join("samples").join(format!("{}.csv", r.text("run"))))?;
    let places = Table::read(&places).ok()?;
    let samples: Vec<SeenSample> = places
        .rows()
        .filter_map(|r| {
            Some(SeenSample { at: [r.number("pixel_x")?, r.number("pixel_y")?], distance: r.number("distance")? })
        })
        .collect();
    let samples_name =
        format!("the {} positions", if samples.len() == 8 { "eight".to_owned() } else { samples.len().to_string() });
    Some(Strip { sheet, samples_name, samples }.figure())
}

/// Most candidates of a contact sheet.
const SHOWN: usize = 8;

/// The reference and candidates of a case from the images that were kept. Of several orders the commonest is shown; of too many
/// candidates the first of each number of SH vectors, and of these an even choice.
fn contact_sheet(group: &Group, folder: &Path) -> Option<Figure> {
    let path = |r: &Row| folder.join("images").join(format!("{}.exr", r.text("run")));
    let mut rows: Vec<Row> =
        group.rows.iter().copied().filter(|r| !r.text("run").is_empty() && path(r).exists()).collect();
    let orders = groups(rows.iter().copied().filter(|r| !r.text("order").is_empty()), &["order"]);
    if let Some(commonest) = orders.iter().rev().max_by_key(|g| g.rows.len()).map(|g| g.key[0]) {
        rows.retain(|r| matches!(r.text("order"), "") || r.text("order") == commonest);
    }
    rows.sort_by(by_what_they_keep);
    // those that were timed are those that were asked about
    if rows.len() > SHOWN && rows.iter().any(|r| r.number("frame_us_1m").is_some()) {
        rows.retain(|r| r.number("frame_us_1m").is_some());
    }
    if rows.len() > SHOWN {
        rows.dedup_by_key(|r| r.text("sh_vectors").to_owned());
    }
    if rows.len() > SHOWN {
        let last = rows.len() - 1;
        rows = (0..SHOWN).map(|i| rows[(i * last + (SHOWN - 1) / 2) / (SHOWN - 1)]).collect();
    }
    sheet_of(group, folder, rows, "reference, rigs and their errors").map(|sheet| sheet.figure())
}

/// The sheet of these rows.
fn sheet_of(group: &Group, folder: &Path, rows: Vec<Row>, what: &str) -> Option<ContactSheet> {
    let path = |r: &Row| folder.join("images").join(format!("{}.exr", r.text("run")));
    let varying = varying_axes(&rows);
    let images: Vec<(Row, LayeredImage)> =
        rows.iter().filter_map(|r| Some((*r, LayeredImage::read(&path(r)).ok()?))).collect();
    let (_, first) = images.first()?;
    let (reference, albedo) = (first.layer("reference")?.clone(), first.layer("albedo")?.clone());
    let candidates: Vec<Shown> = images
        .iter()
        .filter(|(_, image)| image.layer("candidate").is_some_and(|c| c.size() == reference.size()))
        .map(|(row, image)| Shown {
            name: name(row, &varying),
            run: row.text("run").to_owned(),
            irradiance: image.layer("candidate").expect("filtered").clone(),
            nrmse: row.number("nrmse"),
            sh_vectors: row.number("sh_vectors"),
        })
        .collect();
    (!candidates.is_empty()).then(|| ContactSheet {
        title: format!("{}, {}: {what}", group.key[0], group.key[1]),
        subtitle: format!("{} · pictures at the reference's exposure", case_line(group)),
        reference,
        albedo,
        candidates,
        signed: false,
    })
}
