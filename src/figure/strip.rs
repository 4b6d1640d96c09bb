//! A strip of lettered pictures, as papers show it: one sample without and with its gradient, the reference, the places of the samples,
//! these samples without and with gradients; errors below.

use super::Figure;
use super::colour_map::ColourMap;
use super::contact_sheet::{ContactSheet, Shown};
use super::drawing::{Anchor, CAP, Drawing, Rect, Stroke, fitted};
use super::heat_map::ColourBar;
use super::scale::Format;
use super::style::{ACCENT, INK, LABEL, MUTED, PANEL_TITLE, TICK, WHITE};
use super::table::Table;
use crate::picture::Exposure;

/// A place of a sample in the picture: pixels from the left and the top, and metres from the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenSample {
    pub at: [f64; 2],
    pub distance: f64,
}

/// The sheet's candidates in the order of their letters, with what to call them; the reference and the samples stand in the middle.
#[derive(Clone, Debug)]
pub struct Strip {
    pub sheet: ContactSheet,
    /// What the samples' picture is called.
    pub samples_name: String,
    pub samples: Vec<SeenSample>,
}

const CELL: f64 = 196.0;
const GAP: f64 = 8.0;
const TOP: f64 = 112.0;

impl Strip {
    pub fn figure(&self) -> Figure {
        let sheet = &self.sheet;
        let crop = sheet.crop_holding(self.samples.iter().map(|sample| sample.at));
        let height = CELL * crop.1.len() as f64 / crop.0.len() as f64;
        // half of the candidates, reference and samples, the other half
        let before = sheet.candidates.len() / 2;
        let cells = sheet.candidates.len() + 2;
        let description =
            format!("{}. {}. A strip of pictures a to {}.", sheet.title, sheet.subtitle, letter(cells - 1));
        let mut drawing =
            Drawing::new(32.0 + cells as f64 * (CELL + GAP) - GAP, TOP + 2.0 * height + GAP + 16.0, description);
        drawing.heading(&sheet.title, &sheet.subtitle);
        let exposure = Exposure::of_reference(&sheet.reflected(&sheet.reference));
        let scale = sheet.error_scale();
        let map = ColourMap::Magnitude;
        let cell = |index: usize| Rect::new(16.0 + index as f64 * (CELL + GAP), TOP, CELL, height);
        let caption = |drawing: &mut Drawing, index: usize, name: &str, below: &str| {
            let [x, y] = [cell(index).x, TOP];
            let name = format!("({}) {name}", letter(index));
            drawing.text([x, y - 25.0], fitted(&name, PANEL_TITLE, CELL), PANEL_TITLE, INK, Anchor::Start);
            drawing.text([x, y - 8.0], fitted(below, TICK, CELL), TICK, MUTED, Anchor::Start);
        };
        let (columns, rows) = (crop.0.len(), crop.1.len());
        let mut data = Table::new(&["letter", "candidate", "run", "nrmse", "sh_vectors", "u", "v", "distance"]);
        for (place, shown) in sheet.candidates.iter().enumerate() {
            let index = if place < before { place } else { place + 2 };
            let mut below = Vec::new();
            below.extend(shown.nrmse.map(|v| format!("nRMSE {}", Format::Percent.write(v))));
            below.extend(shown.sh_vectors.map(|v| format!("{v} SH vector{}", if v == 1.0 { "" } else { "s" })));
            caption(&mut drawing, index, &spoken(&shown.name), &below.join(" · "));
            let area = cell(index);
            drawing.image(area, columns, rows, sheet.picture(&shown.irradiance, exposure, &crop));
            let errors = Rect::new(area.x, area.bottom() + GAP, CELL, height);
            drawing.image(errors, columns, rows, sheet.errors(&shown.irradiance, scale, map, &crop));
            let number = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
            data.push(row_of(index, shown, number(shown.nrmse), number(shown.sh_vectors)));
        }
        caption(&mut drawing, before, "reference", "traced");
        drawing.image(cell(before), columns, rows, sheet.picture(&sheet.reference, exposure, &crop));
        data.push([letter(before), "reference".into()].into_iter().chain((0..6).map(|_| String::new())));

        // the samples, those nearer to the eye larger and filled, over the paled reference
        let own = before + 1;
        caption(&mut drawing, own, &self.samples_name, "filled: nearer to the eye");
        let area = cell(own);
        let pale: Vec<[u8; 3]> = sheet
            .picture(&sheet.reference, exposure, &crop)
            .into_iter()
            .map(|c| c.map(|v| 255 - ((255 - u16::from(v)) * 2 / 5) as u8))
            .collect();
        drawing.image(area, columns, rows, pale);
        let at = |sample: &SeenSample| {
            let share = [
                (sample.at[0] - crop.0.start as f64) / columns as f64,
                (sample.at[1] - crop.1.start as f64) / rows as f64,
            ];
            [area.x + share[0] * area.width, area.y + share[1] * area.height]
        };
        // x runs fastest: neighbours differ in one bit
        if self.samples.len() == 8 {
            for (i, j) in
                (0..8usize).flat_map(|i| (0..3).filter(move |b| i >> b & 1 == 0).map(move |b| (i, i | 1 << b)))
            {
                drawing.line([at(&self.samples[i]), at(&self.samples[j])], Stroke::new(MUTED, 1.0));
            }
        }
        let distances = || self.samples.iter().map(|sample| sample.distance);
        let middle = 0.5 * (distances().fold(f64::INFINITY, f64::min) + distances().fold(0.0, f64::max));
        for (index, sample) in self.samples.iter().enumerate() {
            let near = sample.distance < middle;
            let (fill, stroke) = if near { (ACCENT, WHITE) } else { (WHITE, ACCENT) };
            drawing.circle(at(sample), if near { 6.0 } else { 4.5 }, Some(fill), Some(Stroke::new(stroke, 1.6)));
            data.push([
                letter(own),
                format!("sample {index}"),
                String::new(),
                String::new(),
                String::new(),
                sample.at[0].to_string(),
                sample.at[1].to_string(),
                sample.distance.to_string(),
            ]);
        }
        let [x, y] = [cell(before).x, TOP + height + GAP];
        drawing.text([x, y + 24.0], "|error|, RMS of the channels,", LABEL, INK, Anchor::Start);
        drawing.text([x, y + 41.0], "of the reference's RMS irradiance", TICK, MUTED, Anchor::Start);
        let bar = ColourBar { scale, map, format: Format::Percent, label: String::new() };
        bar.draw(&mut drawing, Rect::new(x + 8.0, y + 54.0 + CAP, 1.6 * CELL, 13.0));
        Figure::new(drawing, data)
    }
}

fn row_of(index: usize, shown: &Shown, nrmse: String, vectors: String) -> Vec<String> {
    let empty = String::new;
    vec![letter(index), shown.name.clone(), shown.run.clone(), nrmse, vectors, empty(), empty(), empty()]
}

fn letter(index: usize) -> String {
    char::from(b'a' + index as u8).to_string()
}

/// `LETTER-some-words`: its letter.
pub fn lettered(rig: &str) -> Option<char> {
    let (letter, rest) = rig.split_once('-')?;
    let letter = letter.chars().next().filter(|c| letter.len() == 1 && c.is_ascii_lowercase())?;
    (!rest.is_empty()).then_some(letter)
}

/// A lettered name without its letter, as words.
fn spoken(rig: &str) -> String {
    match lettered(rig) {
        Some(_) => rig[2..].replace('-', " "),
        None => rig.replace('-', " "),
    }
}
