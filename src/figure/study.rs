//! Figures of studies, from `studies/NAME.csv` alone; a table's columns say what it is.

use std::io;
use std::path::{Path, PathBuf};

use super::Figure;
use super::curves::{CurvePoint, Curves, Quantity, Series};
use super::scale::Format;
use super::table::{Row, Table};
use super::{disk_error, wrap_lobe};

/// The tables of a results folder's studies, by name.
pub fn tables(folder: &Path) -> io::Result<Vec<(String, Table)>> {
    let Ok(entries) = std::fs::read_dir(folder.join("studies")) else { return Ok(Vec::new()) };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.map(|e| e.path())).collect::<io::Result<_>>()?;
    paths.retain(|path| path.extension().is_some_and(|e| e == "csv"));
    paths.sort();
    let named = paths.iter().map(|path| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok((name, Table::read(path)?))
    });
    named.collect()
}

/// Every figure of a study: what its name gets behind it, and the figure.
pub fn figures(table: &Table) -> Vec<(&'static str, Figure)> {
    let rows: Vec<Row> = table.rows().collect();
    let mut figures = Vec::new();
    if rows.iter().any(|r| !r.text("model").is_empty()) {
        figures.extend(disk_error::figure(&rows).map(|figure| ("map", figure)));
        figures.extend(by_distance(&rows).map(|figure| ("distance", figure)));
    }
    if rows.iter().any(|r| !r.text("wrap").is_empty()) {
        figures.extend(wrap_lobe::figure(&rows).map(|figure| ("shape", figure)));
        figures.extend(by_order(&rows).map(|figure| ("error", figure)));
    }
    figures
}

/// One curve a value of `by`, over the rows that have both numbers.
fn series(rows: &[Row], by: &str, prefix: &str, x: &str, y: &str) -> Vec<Series> {
    let mut series: Vec<Series> = Vec::new();
    for row in rows {
        let (Some(x), Some(y)) = (row.number(x), row.number(y)) else { continue };
        let name = format!("{prefix}{}", row.text(by));
        let point = CurvePoint { x, y, interval: None };
        match series.iter_mut().find(|s| s.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series { name, points: vec![point] }),
        }
    }
    series
}

fn by_distance(rows: &[Row]) -> Option<Figure> {
    let series = series(rows, "model", "", "distance", "rms");
    let named = |name: &str| series.iter().find(|s| s.name.starts_with(name));
    let takes_over = named("wallace").zip(named("table")).and_then(|(wallace, table)| crossing(wallace, table));
    let overtaken =
        takes_over.map_or(String::new(), |distance| format!(" · Wallace's is the better from {distance:.2} R on"));
    (!series.is_empty()).then(|| {
        Curves {
            title: "Disk light: which formula, how far away".into(),
            subtitle: format!("receivers on the front hemisphere, all normals{overtaken}"),
            x: Quantity { label: "distance from the centre, radii".into(), format: Format::Plain, log: true },
            y: Quantity { label: "RMS error of E/π, unit radiance".into(), format: Format::Plain, log: true },
            series,
        }
        .figure()
    })
}

/// The last x from which on the first curve lies below the second; both on the same x, straight lines in logarithms between.
fn crossing(first: &Series, second: &Series) -> Option<f64> {
    let gaps: Vec<(f64, f64)> =
        first.points.iter().zip(&second.points).map(|(a, b)| (a.x.ln(), a.y.ln() - b.y.ln())).collect();
    let place = gaps.windows(2).rposition(|pair| pair[0].1 > 0.0 && pair[1].1 <= 0.0)?;
    let [(x0, g0), (x1, g1)] = [gaps[place], gaps[place + 1]];
    Some((x0 + (x1 - x0) * g0 / (g0 - g1)).exp())
}

fn by_order(rows: &[Row]) -> Option<Figure> {
    let series = series(rows, "wrap", "a = ", "order", "rms");
    (!series.is_empty()).then(|| {
        Curves {
            title: "Wrap lobe: what an order of SH leaves out".into(),
            subtitle: "RMS over the sphere, over the lobe's RMS".into(),
            x: Quantity { label: "order (bands of SH)".into(), format: Format::Count, log: false },
            y: Quantity { label: "relative RMS error".into(), format: Format::Percent, log: true },
            series,
        }
        .figure()
    })
}
