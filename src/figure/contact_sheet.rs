//! The reference beside candidates, their error maps below with one scale: a paper's first figure.

use super::Figure;
use super::colour_map::ColourMap;
use super::drawing::{Anchor, Drawing, Rect, fitted, text_width};
use super::heat_map::ColourBar;
use super::scale::{Format, Scale};
use super::style::{INK, LABEL, MUTED, PANEL_TITLE, TICK, TITLE};
use super::table::Table;
use crate::math::{Irradiance, Rgb};
use crate::picture::{Exposure, Picture};

/// A candidate of the sheet.
#[derive(Clone, Debug)]
pub struct Shown {
    pub name: String,
    pub run: String,
    /// Irradiance, unclamped.
    pub irradiance: Picture,
    pub nrmse: Option<f64>,
    pub sh_vectors: Option<f64>,
}

#[derive(Clone, Debug)]
pub struct ContactSheet {
    pub title: String,
    pub subtitle: String,
    /// Irradiance of the reference.
    pub reference: Picture,
    /// Black where the camera sees no receiver.
    pub albedo: Picture,
    pub candidates: Vec<Shown>,
    /// Errors with their sign instead of their size.
    pub signed: bool,
}

/// Most candidates in a line of the sheet.
const COLUMNS: usize = 4;
const GAP: f64 = 8.0;
const CAPTION: f64 = 44.0;
const TOP: f64 = 68.0;
/// The background of pictures, and of error maps where nothing is scored.
const GROUND: [u8; 3] = [0xf3, 0xf4, 0xf6];

impl ContactSheet {
    pub fn figure(&self) -> Figure {
        let crop = self.crop();
        let aspect = crop.1.len() as f64 / crop.0.len() as f64;
        let lines = self.candidates.len().div_ceil(COLUMNS).max(1);
        // lines of nearly the same length
        let across = self.candidates.len().div_ceil(lines).max(1);
        let cell_width = (1180.0 / (across + 1) as f64 - GAP).min(300.0);
        let cell = (cell_width, cell_width * aspect);
        let width = (32.0 + (across + 1) as f64 * (cell.0 + GAP)).max(text_width(&self.title, TITLE) + 32.0);
        let line_height = CAPTION + 2.0 * cell.1 + GAP + 18.0;
        let mut drawing = Drawing::new(width, TOP + lines as f64 * line_height + 4.0, self.description());
        drawing.heading(&self.title, &self.subtitle);

        let exposure = Exposure::of_reference(&self.reflected(&self.reference));
        let scale = self.error_scale();
        let map = if self.signed { ColourMap::Signed } else { ColourMap::Magnitude };
        let at = |column: usize, line: usize| {
            [16.0 + column as f64 * (cell.0 + GAP), TOP + line as f64 * line_height + CAPTION]
        };
        for line in 0..lines {
            let [x, y] = at(0, line);
            caption(&mut drawing, [x, y], cell.0, "reference", "");
            let pixels = self.picture(&self.reference, exposure, &crop);
            drawing.image(Rect::new(x, y, cell.0, cell.1), crop.0.len(), crop.1.len(), pixels);
            let bar = ColourBar { scale, map, format: Format::Percent, label: String::new() };
            let y = y + cell.1 + GAP + 24.0;
            let what = if self.signed { "error, largest channel" } else { "|error|, RMS of the channels" };
            drawing.text([x, y], what, LABEL, INK, Anchor::Start);
            drawing.text([x, y + 18.0], "of the reference's RMS irradiance", TICK, MUTED, Anchor::Start);
            bar.draw(&mut drawing, Rect::new(x + 8.0, y + 30.0, cell.0 - 32.0, 13.0));
        }
        let mut data = Table::new(&["candidate", "run", "nrmse", "sh_vectors", "colour_scale_max", "exposure"]);
        for (i, shown) in self.candidates.iter().enumerate() {
            let [x, y] = at(1 + i % across, i / across);
            let mut below = Vec::new();
            below.extend(shown.nrmse.map(|v| format!("nRMSE {}", Format::Percent.write(v))));
            below.extend(shown.sh_vectors.map(|v| format!("{v} SH vector{}", if v == 1.0 { "" } else { "s" })));
            caption(&mut drawing, [x, y], cell.0, &shown.name, &below.join(" · "));
            let size = (crop.0.len(), crop.1.len());
            let pixels = self.picture(&shown.irradiance, exposure, &crop);
            drawing.image(Rect::new(x, y, cell.0, cell.1), size.0, size.1, pixels);
            let errors = self.errors(&shown.irradiance, scale, map, &crop);
            drawing.image(Rect::new(x, y + cell.1 + GAP, cell.0, cell.1), size.0, size.1, errors);
            let number = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
            data.push([
                shown.name.clone(),
                shown.run.clone(),
                number(shown.nrmse),
                number(shown.sh_vectors),
                scale.ends().1.to_string(),
                exposure.0.to_string(),
            ]);
        }
        Figure::new(drawing, data)
    }

    fn description(&self) -> String {
        let names: Vec<&str> = self.candidates.iter().map(|c| c.name.as_str()).collect();
        format!("{}. {}. Reference beside {}; maps of their errors below.", self.title, self.subtitle, names.join(", "))
    }

    fn scored(&self, pixel: usize) -> bool {
        self.albedo.pixels[pixel].iter().any(|v| *v > 0.0)
    }

    /// Columns and rows around the receivers, with a margin: what else the camera sees is not scored.
    fn crop(&self) -> Crop {
        self.crop_holding(std::iter::empty())
    }

    /// The same, around these places too.
    pub(super) fn crop_holding(&self, places: impl Iterator<Item = [f64; 2]>) -> Crop {
        let (width, height) = self.albedo.size();
        let seen: Vec<usize> = (0..self.albedo.pixels.len()).filter(|i| self.scored(*i)).collect();
        let places: Vec<[f64; 2]> = places.collect();
        let range = |of: &dyn Fn(usize) -> usize, axis: usize, end: usize| {
            let places = || places.iter().map(|place| place[axis].clamp(0.0, end as f64) as usize);
            let low = seen.iter().map(|i| of(*i)).chain(places()).min().unwrap_or(0);
            let high = seen.iter().map(|i| of(*i) + 1).chain(places()).max().unwrap_or(end);
            let margin = 4 + (high - low) / 16;
            low.saturating_sub(margin)..(high + margin).min(end)
        };
        let (mut x, mut y) = (range(&|i| i % width, 0, width), range(&|i| i / width, 1, height));
        // neither a slit nor a tower
        widen(&mut x, y.len() * 9 / 10, width);
        widen(&mut y, x.len() * 5 / 10, height);
        (x, y)
    }

    /// Radiance max(0, albedo E / pi): what a camera sees of an irradiance.
    pub(super) fn reflected(&self, irradiance: &Picture) -> Picture {
        Picture::from_fn(irradiance.width, irradiance.height, |x, y| {
            Irradiance(Rgb::from_array(irradiance.at(x, y)))
                .reflected(Rgb::from_array(self.albedo.at(x, y)))
                .0
                .to_array()
        })
    }

    pub(super) fn picture(&self, irradiance: &Picture, exposure: Exposure, crop: &Crop) -> Vec<[u8; 3]> {
        let bytes = exposure.bytes(&self.reflected(irradiance));
        self.cropped(crop, |i| if self.scored(i) { bytes[i] } else { GROUND })
    }

    fn cropped<T>(&self, (columns, rows): &Crop, pixel: impl Fn(usize) -> T) -> Vec<T> {
        rows.clone()
            .flat_map(|y| columns.clone().map(move |x| (x, y)))
            .map(|(x, y)| pixel(y * self.albedo.width + x))
            .collect()
    }

    /// RMS of the reference over the pixels that are scored.
    fn rms(&self) -> f64 {
        let values =
            (0..self.reference.pixels.len()).filter(|i| self.scored(*i)).flat_map(|i| self.reference.pixels[i]);
        let (sum, count) = values.fold((0.0, 0usize), |(s, n), v| (s + f64::from(v) * f64::from(v), n + 1));
        (sum / count.max(1) as f64).sqrt()
    }

    /// The error of a pixel: the RMS of its channels, or the channel of the largest size with its sign.
    fn error(&self, candidate: &Picture, pixel: usize) -> f64 {
        let (c, r) = (candidate.pixels[pixel], self.reference.pixels[pixel]);
        let errors: [f64; 3] = std::array::from_fn(|i| f64::from(c[i]) - f64::from(r[i]));
        if errors.iter().any(|e| !e.is_finite()) {
            return f64::NAN;
        }
        if self.signed {
            errors.into_iter().fold(0.0, |m: f64, e| if e.abs() > m.abs() { e } else { m })
        } else {
            (errors.iter().map(|e| e * e).sum::<f64>() / 3.0).sqrt()
        }
    }

    /// One scale for all candidates: up to the 99th percentile of all errors, rounded up to a number that reads well.
    pub(super) fn error_scale(&self) -> Scale {
        let rms = self.rms();
        let mut all: Vec<f64> = self
            .candidates
            .iter()
            .flat_map(|c| {
                (0..c.irradiance.pixels.len()).filter(|i| self.scored(*i)).map(|i| self.error(&c.irradiance, i).abs())
            })
            .filter(|e| e.is_finite())
            .collect();
        let high = if all.is_empty() || rms == 0.0 {
            1.0
        } else {
            let rank = (all.len() - 1) * 99 / 100;
            *all.select_nth_unstable_by(rank, f64::total_cmp).1 / rms
        };
        let decade = 10f64.powf(high.max(1e-9).log10().floor());
        let round = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0].into_iter().find(|m| m * decade >= high);
        let high = round.unwrap_or(10.0) * decade;
        if self.signed { Scale::Linear { low: -high, high } } else { Scale::Root { high } }
    }

    pub(super) fn errors(&self, candidate: &Picture, scale: Scale, map: ColourMap, crop: &Crop) -> Vec<[u8; 3]> {
        let rms = self.rms();
        self.cropped(crop, |i| {
            if !self.scored(i) {
                return GROUND;
            }
            let error = self.error(candidate, i);
            // without a reference to be relative to, any error is beyond the scale
            let relative =
                if rms > 0.0 || error == 0.0 { error / rms.max(f64::MIN_POSITIVE) } else { error * f64::MAX };
            let colour = map.at(scale.position(relative));
            [colour.0, colour.1, colour.2]
        })
    }
}

pub(super) type Crop = (std::ops::Range<usize>, std::ops::Range<usize>);

fn widen(range: &mut std::ops::Range<usize>, length: usize, end: usize) {
    let missing = length.min(end).saturating_sub(range.len());
    let start = range.start.saturating_sub(missing / 2).min(end - length.min(end).max(range.len()));
    *range = start..start + range.len().max(length.min(end));
}

fn caption(drawing: &mut Drawing, [x, y]: [f64; 2], width: f64, name: &str, below: &str) {
    drawing.text([x, y - 25.0], fitted(name, PANEL_TITLE, width), PANEL_TITLE, INK, Anchor::Start);
    if !below.is_empty() {
        drawing.text([x, y - 8.0], fitted(below, TICK, width), TICK, MUTED, Anchor::Start);
    }
}
