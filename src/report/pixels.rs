//! The pictures of a report: half floats, packed, in text that the page unpacks where it shows them.

use half::f16;
use rayon::prelude::*;

use super::stored::Stored;
use crate::figure::base64;
use crate::figure::table::{Row, family, groups};
use crate::math::{Irradiance, Rgb};
use crate::metric::flip_ldr;
use crate::picture::{Exposure, LayeredImage, Picture};

/// Pictures are not wider or higher than this.
const LARGEST: (usize, usize) = (480, 270);
/// Characters that all pictures of a report may take.
const BUDGET: usize = 46 << 20;

/// All pictures of a report.
pub struct Pictures {
    pub cases: Vec<Case>,
}

/// The pictures of one scene under one layout, in one frame.
pub struct Case {
    pub scene: String,
    pub lights: String,
    /// The frame of an animation.
    pub frame: Option<usize>,
    /// Whether it is another frame than the one that is shown first.
    pub is_other: bool,
    /// Of the case that is shown first: the places of its other frames among all cases, in their order, its own among them.
    pub frames: Vec<usize>,
    pub width: usize,
    pub height: usize,
    /// As they were rendered.
    pub full: (usize, usize),
    /// From scene radiance to display light.
    pub exposure: f32,
    /// RMS of the reference over the lit pixels, W m^-2.
    pub rms: f64,
    /// The error map's end: near the 99th percentile of all errors of the case over `rms`.
    pub error_high: f64,
    pub reference: Packed,
    pub albedo: Packed,
    pub candidates: Vec<Candidate>,
}

/// One candidate's error, and its FLIP map where there is one.
pub struct Candidate {
    pub run: String,
    pub error: Packed,
    pub has_flip: bool,
}

/// Halves of an RGB picture (and what follows them), zlib'ed, base64.
///
/// The bytes: for each of the 6 x pixels bytes of the halves the upper bytes of the three planes, then the lower ones; each plane holds
/// differences from the pixel before, modulo 2^16. Values were multiplied by 2^-exponent first, so that they use the range of a half.
pub struct Packed {
    pub text: String,
    pub exponent: i32,
}

impl Packed {
    fn of(picture: &Picture, more: &[u8]) -> Self {
        let largest = picture.pixels.iter().flatten().filter(|v| v.is_finite()).fold(0.0f32, |m, v| m.max(v.abs()));
        // the largest value lands between 2^13 and 2^14: far from infinity, and 2^-28 of it is still a normal half
        let exponent = if largest > 0.0 { largest.log2().floor() as i32 - 13 } else { 0 };
        let scale = (-f64::from(exponent)).exp2();
        let count = picture.pixels.len();
        let mut bytes = vec![0; 6 * count];
        for channel in 0..3 {
            let mut before = 0u16;
            for (i, pixel) in picture.pixels.iter().enumerate() {
                let bits = f16::from_f64(f64::from(pixel[channel]) * scale).to_bits();
                let difference = bits.wrapping_sub(before);
                before = bits;
                let [low, high] = difference.to_le_bytes();
                bytes[channel * count + i] = high;
                bytes[(3 + channel) * count + i] = low;
            }
        }
        bytes.extend_from_slice(more);
        Self { text: base64(&miniz_oxide::deflate::compress_to_vec_zlib(&bytes, 6)), exponent }
    }
}

/// A case before it is packed: its rows with images.
#[derive(Clone)]
struct Wanted<'a> {
    scene: &'a str,
    lights: &'a str,
    frame: Option<usize>,
    is_other: bool,
    rows: Vec<Row<'a>>,
}

impl Pictures {
    pub fn of(stored: &Stored) -> Self {
        Self::within(stored, BUDGET)
    }

    /// The pictures in at most so many characters: with fewer pixels where they would take more.
    fn within(stored: &Stored, budget: usize) -> Self {
        let rows = stored.runs();
        let pictured = rows.iter().copied().filter(|r| {
            family(r.text("lights")).is_none() && stored.runs.get(r.text("run")).is_some_and(|files| files.has_image)
        });
        let frames_of = |row: &Row| stored.runs.get(row.text("run")).map_or(&[][..], |files| &files.frames);
        let mut wanted: Vec<Wanted> = Vec::new();
        for group in groups(pictured, &["scene", "lights"]) {
            let frame = group.rows.iter().find_map(|row| stored.picture_frame(row.text("run")));
            let own = Wanted { scene: group.key[0], lights: group.key[1], frame, is_other: false, rows: group.rows };
            let mut frames: Vec<usize> = own.rows.iter().flat_map(frames_of).copied().collect();
            frames.sort_unstable();
            frames.dedup();
            wanted.push(own.clone());
            wanted.extend(frames.into_iter().map(|frame| {
                let rows = own.rows.iter().copied().filter(|row| frames_of(row).contains(&frame)).collect();
                Wanted { frame: Some(frame), is_other: true, rows, ..own.clone() }
            }));
        }
        let images = stored.folder.join("images");
        let read = |row: &Row, other: Option<usize>| {
            let frame = other.map_or(String::new(), |frame| format!(".f{frame:02}"));
            LayeredImage::read(&images.join(format!("{}{frame}.exr", row.text("run")))).ok()
        };
        let mut largest = LARGEST;
        loop {
            let cases: Vec<Case> = wanted
                .par_iter()
                .filter_map(|w| Case::of(w, largest, &|row: &Row| read(row, w.frame.filter(|_| w.is_other))))
                .collect();
            let mut pictures = Self { cases };
            pictures.join_frames();
            let size = pictures.size();
            if size <= budget || largest.0 < 32 {
                return pictures;
            }
            // fewer pixels; what was packed once tells how many
            let shown = pictures.cases.iter().map(|c| c.width).max().unwrap_or(largest.0);
            let factor = (budget as f64 / size as f64).sqrt() * 0.96;
            let width = (shown as f64 * factor) as usize;
            largest = (width.max(16), (width * LARGEST.1 / LARGEST.0).max(9));
        }
    }

    /// Finds the frames of each case, and shows them all as the first: at one exposure, with one scale of errors.
    fn join_frames(&mut self) {
        let mut first = 0;
        while first < self.cases.len() {
            let end = (first + 1..self.cases.len()).find(|i| !self.cases[*i].is_other).unwrap_or(self.cases.len());
            let film = &mut self.cases[first..end];
            let error_high = film.iter().map(|case| case.error_high).fold(0.0, f64::max);
            let (exposure, rms) = (film[0].exposure, film[0].rms);
            for case in film.iter_mut() {
                (case.exposure, case.rms, case.error_high) = (exposure, rms, error_high);
            }
            if film.len() > 1 {
                let mut order: Vec<usize> = (first..end).collect();
                order.sort_by_key(|i| self.cases[*i].frame);
                self.cases[first].frames = order;
            }
            first = end;
        }
    }

    /// Characters of all pictures.
    fn size(&self) -> usize {
        let of_case = |c: &Case| {
            c.reference.text.len()
                + c.albedo.text.len()
                + c.candidates.iter().map(|candidate| candidate.error.text.len()).sum::<usize>()
        };
        self.cases.iter().map(of_case).sum()
    }

    /// Pictures of candidates, one a frame.
    pub fn count(&self) -> usize {
        self.cases.iter().map(|c| c.candidates.len()).sum()
    }
}

impl Case {
    fn of(
        wanted: &Wanted,
        largest: (usize, usize),
        read: &(dyn Fn(&Row) -> Option<LayeredImage> + Sync),
    ) -> Option<Self> {
        // the reference is the same in every image: it is taken from the first that can be read
        let first = wanted.rows.iter().find_map(read)?;
        let whole = first.layer("reference")?;
        let full = whole.size();
        let size = fitting(full, largest);
        let reference = shrunk(whole, size);
        let albedo = match first.layer("albedo") {
            Some(albedo) => shrunk(albedo, size),
            None => Picture::filled(size.0, size.1, [1.0; 3]),
        };
        let scored: Vec<bool> = albedo.pixels.iter().map(|p| p.iter().any(|v| *v > 0.0)).collect();
        let picture = reflected(&reference, &albedo);
        let rms = rms(&reference, &scored);
        let mut packed: Vec<(Candidate, f64)> = wanted
            .rows
            .par_iter()
            .filter_map(|row| {
                let image = read(row)?;
                let candidate = shrunk(image.layer("candidate").filter(|c| c.size() == full)?, size);
                let error = Picture::from_fn(size.0, size.1, |x, y| {
                    let (c, r) = (candidate.at(x, y), reference.at(x, y));
                    std::array::from_fn(|i| c[i] - r[i])
                });
                let map = flip_ldr(&picture, &reflected(&candidate, &albedo)).ok();
                let bytes: Vec<u8> = map.iter().flat_map(|m| &m.values).map(|v| (v * 255.0).round() as u8).collect();
                let high = percentile(&error, &scored);
                let run = row.text("run").to_owned();
                Some((Candidate { run, error: Packed::of(&error, &bytes), has_flip: map.is_some() }, high))
            })
            .collect();
        let worst = packed.iter().map(|(_, high)| *high).fold(0.0, f64::max);
        let error_high = if rms > 0.0 && worst > 0.0 { rounded_up(worst / rms) } else { 1.0 };
        let candidates: Vec<Candidate> = packed.drain(..).map(|(candidate, _)| candidate).collect();
        (!candidates.is_empty()).then(|| Self {
            scene: wanted.scene.to_owned(),
            lights: wanted.lights.to_owned(),
            frame: wanted.frame,
            is_other: wanted.is_other,
            frames: Vec::new(),
            width: size.0,
            height: size.1,
            full,
            exposure: Exposure::of_reference(&picture).0,
            rms,
            error_high,
            reference: Packed::of(&reference, &[]),
            albedo: Packed::of(&albedo, &[]),
            candidates,
        })
    }
}

/// The size with the aspect of `full` that fits into `largest`; never larger than `full`.
fn fitting(full: (usize, usize), largest: (usize, usize)) -> (usize, usize) {
    let factor = (largest.0 as f64 / full.0 as f64).min(largest.1 as f64 / full.1 as f64).min(1.0);
    let side = |v: usize| ((v as f64 * factor).round() as usize).max(1);
    (side(full.0), side(full.1))
}

/// A picture of fewer pixels, each the mean of the area that it covers.
fn shrunk(picture: &Picture, (width, height): (usize, usize)) -> Picture {
    if picture.size() == (width, height) {
        return picture.clone();
    }
    // shares of the source pixels along one axis
    let shares = |from: usize, to: usize| -> Vec<Vec<(usize, f32)>> {
        let step = from as f64 / to as f64;
        let cover = |i: usize| {
            let (start, end) = (i as f64 * step, ((i + 1) as f64 * step).min(from as f64));
            (start as usize..(end.ceil() as usize).min(from))
                .map(|k| (k, ((end.min((k + 1) as f64) - start.max(k as f64)) / step) as f32))
                .filter(|(_, share)| *share > 0.0)
                .collect()
        };
        (0..to).map(cover).collect()
    };
    let (columns, rows) = (shares(picture.width, width), shares(picture.height, height));
    Picture::from_fn(width, height, |x, y| {
        let mut sum = [0.0; 3];
        for (row, of_row) in &rows[y] {
            for (column, of_column) in &columns[x] {
                let pixel = picture.at(*column, *row);
                (0..3).for_each(|c| sum[c] += pixel[c] * of_row * of_column);
            }
        }
        sum
    })
}

/// Radiance max(0, albedo E / pi).
fn reflected(irradiance: &Picture, albedo: &Picture) -> Picture {
    Picture::from_fn(irradiance.width, irradiance.height, |x, y| {
        Irradiance(Rgb::from_array(irradiance.at(x, y))).reflected(Rgb::from_array(albedo.at(x, y))).0.to_array()
    })
}

fn rms(picture: &Picture, scored: &[bool]) -> f64 {
    let values = picture.pixels.iter().zip(scored).filter(|(_, s)| **s).flat_map(|(p, _)| *p);
    let (sum, count) = values.fold((0.0, 0usize), |(s, n), v| (s + f64::from(v) * f64::from(v), n + 1));
    (sum / count.max(1) as f64).sqrt()
}

/// The 99th percentile over the lit pixels of the RMS of an error's channels.
fn percentile(error: &Picture, scored: &[bool]) -> f64 {
    let size = |p: &[f32; 3]| (p.iter().map(|v| f64::from(*v) * f64::from(*v)).sum::<f64>() / 3.0).sqrt();
    let mut sizes: Vec<f64> = error.pixels.iter().zip(scored).filter(|(_, s)| **s).map(|(p, _)| size(p)).collect();
    sizes.retain(|v| v.is_finite());
    if sizes.is_empty() {
        return 0.0;
    }
    let rank = (sizes.len() - 1) * 99 / 100;
    *sizes.select_nth_unstable_by(rank, f64::total_cmp).1
}

/// The next number that reads well.
fn rounded_up(value: f64) -> f64 {
    let decade = 10f64.powf(value.max(1e-9).log10().floor());
    let round = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0].into_iter().find(|m| m * decade >= value);
    round.unwrap_or(10.0) * decade
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::table::Table;
    use crate::math::{Stream, StreamPurpose};

    #[test]
    fn a_shrunk_picture_keeps_its_mean() {
        let picture = Picture::from_fn(37, 23, |x, y| [x as f32, (y * y) as f32, 1.0]);
        let mean =
            |p: &Picture, c: usize| p.pixels.iter().map(|v| f64::from(v[c])).sum::<f64>() / p.pixels.len() as f64;
        for size in [(16, 9), (12, 23), (37, 23), (1, 1)] {
            let small = shrunk(&picture, size);
            for c in 0..3 {
                assert!((mean(&small, c) - mean(&picture, c)).abs() < 1e-4 * mean(&picture, c), "{size:?} {c}");
            }
        }
        assert_eq!(fitting((320, 180), (160, 160)), (160, 90));
        assert_eq!(fitting((32, 18), (480, 270)), (32, 18));
    }

    #[test]
    fn pictures_that_do_not_shrink_get_fewer_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let mut table = Table::new(&["run", "scene", "lights", "rig", "backend", "status"]);
        let mut stream = Stream::indexed(3, StreamPurpose::Test, 1);
        let mut noise = || Picture::from_fn(160, 90, |_, _| [(); 3].map(|()| stream.uniform() as f32));
        let reference = noise();
        for i in 0..4 {
            let run = format!("{i:012x}");
            table.push([&run, "ball", "lamp", "rig", "cpu", "ok"].map(str::to_owned));
            let image = LayeredImage::of_run(&noise(), &reference, None, &run, "{}");
            image.write(&folder.path().join("images").join(format!("{run}.exr"))).unwrap();
        }
        std::fs::write(folder.path().join("results.csv"), table.to_csv()).unwrap();
        let stored = Stored::read(folder.path()).unwrap();
        let whole = Pictures::of(&stored);
        assert_eq!((whole.count(), whole.cases[0].width), (4, 160));
        // noise does not compress: at least the low bytes of every half stay
        assert!(whole.size() > 4 * 3 * 160 * 90);
        let budget = whole.size() / 5;
        let small = Pictures::within(&stored, budget);
        assert_eq!(small.count(), 4);
        assert!(small.size() <= budget && small.size() > budget / 3, "{} of {budget}", small.size());
        assert!(small.cases[0].width < 80 && small.cases[0].full == (160, 90));
    }

    #[test]
    fn packed_values_read_back_as_halves() {
        let picture = Picture::from_fn(40, 3, |x, y| {
            [1e-9 * x as f32, -3e5 * (y as f32 + 1.0), if x == 7 { f32::NAN } else { 0.25 }]
        });
        let packed = Packed::of(&picture, &[1, 2, 3]);
        // as the page does it
        let count = 120;
        let alphabet = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        let digits: Vec<u32> = packed
            .text
            .bytes()
            .filter(|b| *b != b'=')
            .map(|b| alphabet.iter().position(|a| *a == b).unwrap() as u32)
            .collect();
        let mut bytes = Vec::new();
        for chunk in digits.chunks(4) {
            let word = chunk.iter().fold(0, |w, d| w << 6 | d) << (6 * (4 - chunk.len()));
            bytes.extend([(word >> 16) as u8, (word >> 8) as u8, word as u8].into_iter().take(chunk.len() - 1));
        }
        let bytes = miniz_oxide::inflate::decompress_to_vec_zlib(&bytes).unwrap();
        assert_eq!(&bytes[6 * count..], [1, 2, 3]);
        for c in 0..3 {
            let mut bits = 0u16;
            for i in 0..count {
                bits = bits.wrapping_add(u16::from_le_bytes([bytes[(3 + c) * count + i], bytes[c * count + i]]));
                let got = f16::from_bits(bits).to_f64() * f64::from(packed.exponent).exp2();
                let wanted = f64::from(picture.pixels[i][c]);
                assert!(got.is_nan() == wanted.is_nan());
                // 11 bits of mantissa, and an absolute floor far below the largest value
                assert!(
                    wanted.is_nan() || (got - wanted).abs() <= 5e-4 * wanted.abs() + 1e-8 * 3e5 * 3.0,
                    "{got} {wanted}"
                );
            }
        }
    }
}
