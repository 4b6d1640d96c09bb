//! Maps of a disk light's error over the receiver's offset and height, a panel a formula, one colour scale.

use super::Figure;
use super::colour_map::ColourMap;
use super::drawing::{Anchor, Drawing, Rect, Stroke};
use super::heat_map::ColourBar;
use super::panel::{Axis, Panel};
use super::scale::{Format, Scale};
use super::style::{INK, TICK, WHITE};
use super::table::{Row, Table};

const CELL: (f64, f64) = (270.0, 262.0);
const TOP: f64 = 66.0;
const COLUMNS: usize = 3;

/// From rows with `model,offset,height,rms`; cells stand evenly in both.
pub fn figure(rows: &[Row]) -> Option<Figure> {
    struct Map<'a> {
        model: &'a str,
        cells: Vec<(f64, f64, f64)>,
    }
    let mut maps: Vec<Map> = Vec::new();
    for row in rows {
        let (Some(offset), Some(height), Some(rms)) = (row.number("offset"), row.number("height"), row.number("rms"))
        else {
            continue;
        };
        let model = row.text("model");
        match maps.iter_mut().find(|map| map.model == model) {
            Some(map) => map.cells.push((offset, height, rms)),
            None => maps.push(Map { model, cells: vec![(offset, height, rms)] }),
        }
    }
    maps.retain(|map| map.cells.len() >= 4);
    let first = maps.first()?;
    let side = (first.cells.len() as f64).sqrt().round() as usize;
    let reach = first.cells.iter().map(|c| c.0).fold(0.0, f64::max) * side as f64 / (side as f64 - 0.5);
    // a formula that is exact somewhere does not take the scale for itself
    let all = || maps.iter().flat_map(|map| &map.cells).map(|c| c.2);
    let largest = all().fold(f64::MIN_POSITIVE, f64::max);
    let scale = Scale::log(all().map(|rms| rms.max(1e-5 * largest)).collect::<Vec<_>>());
    let lines = maps.len().div_ceil(COLUMNS);
    let columns = maps.len().min(COLUMNS);
    let (width, plots) = (CELL.0 * columns as f64 + 24.0, CELL.1 * lines as f64);
    let subtitle = "RMS error of E/π over all normals, unit radiance; the disk is the dark bar";
    let title = "Disk light: error of each formula over where the receiver stands";
    let mut drawing = Drawing::new(width.max(640.0), TOP + plots + 56.0, format!("{title}. {subtitle}."));
    drawing.heading(title, subtitle);
    let mut data = Table::new(&["model", "offset", "height", "rms"]);
    for (i, map) in maps.iter().enumerate() {
        let corner = [12.0 + CELL.0 * (i % COLUMNS) as f64, TOP + CELL.1 * (i / COLUMNS) as f64];
        let axis = |label: &str| Axis {
            label: label.into(),
            scale: Scale::Linear { low: 0.0, high: reach },
            format: Format::Plain,
        };
        let panel = Panel::in_cell(
            Rect::new(corner[0], corner[1], CELL.0 - 8.0, CELL.1),
            map.model,
            axis("offset, radii"),
            axis(if i % COLUMNS == 0 { "height, radii" } else { "" }),
        );
        panel.draw(&mut drawing, map.model);
        let mut pixels = vec![[0; 3]; side * side];
        for (offset, height, rms) in &map.cells {
            let place = |v: f64| ((v / reach * side as f64) as usize).min(side - 1);
            let colour = ColourMap::Magnitude.at(scale.position(*rms));
            pixels[(side - 1 - place(*height)) * side + place(*offset)] = [colour.0, colour.1, colour.2];
            data.push([map.model.to_owned(), offset.to_string(), height.to_string(), rms.to_string()]);
        }
        drawing.image(panel.area, side, side, pixels);
        let (from, to) = (panel.at(0.0, 0.0), panel.at(1f64.min(reach), 0.0));
        drawing.line([from, to], Stroke::new(INK, 5.0));
        let worst = map.cells.iter().map(|c| c.2).fold(0.0, f64::max);
        let at = [panel.area.right() - 6.0, panel.area.y + 16.0];
        drawing.text(at, format!("at most {}", Format::Plain.write(worst)), TICK, WHITE, Anchor::End);
    }
    let bar = ColourBar { scale, map: ColourMap::Magnitude, format: Format::Plain, label: "RMS error of E/π".into() };
    bar.draw(&mut drawing, Rect::new(60.0, TOP + plots + 14.0, 260.0, 11.0));
    Some(Figure::new(drawing, data))
}
