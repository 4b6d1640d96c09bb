//! Figures of captured probes: what a finer cube map buys, on the CPU and on the GPU.

use super::Figure;
use super::curves::{CurvePoint, Curves, Quantity, Series};
use super::scale::Format;
use super::table::{Group, Row};

/// Error over the texels of a sample's cube maps, a curve a rig, kind of gradient and backend of the captures; none where no capture has
/// two sizes.
pub fn faces(group: &Group) -> Option<Figure> {
    let of = |row: &Row| -> Option<CurvePoint> {
        let x = row.number("bake_texels")? / row.number("samples_taken").filter(|taken| *taken > 0.0)?;
        Some(CurvePoint { x, y: row.number("nrmse")?, interval: None })
    };
    let mut series: Vec<Series> = Vec::new();
    for row in &group.rows {
        let Some(point) = of(row) else { continue };
        let on = if row.number("bake_draws").is_some() { "GPU" } else { "CPU" };
        let gradient = row.text("gradient_source");
        let words = [row.text("rig"), gradient, on];
        let name = words.iter().filter(|word| !word.is_empty()).copied().collect::<Vec<_>>().join(", ");
        match series.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(point),
            None => series.push(Series { name, points: vec![point] }),
        }
    }
    series.retain(|series| series.points.len() >= 2);
    series.sort_by(|a, b| a.name.cmp(&b.name));
    series.iter_mut().for_each(|series| series.points.sort_by(|a, b| a.x.total_cmp(&b.x)));
    (!series.is_empty()).then(|| {
        Curves {
            title: format!("{}, {}: what finer cube maps buy", group.key[0], group.key[1]),
            subtitle: "cube maps by rays on the CPU, and rasterised on the GPU".into(),
            x: Quantity { label: "texels a sample".into(), format: Format::Plain, log: true },
            y: Quantity { label: "nRMSE".into(), format: Format::Percent, log: true },
            series,
        }
        .figure()
    })
}
