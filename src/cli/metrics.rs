//! `rigbench metrics`: any two pictures against each other.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Map, Value, json};

use super::{Exit, Failure, print};
use crate::math::Rgb;
use crate::metric::{FlipMap, Scored, flip_hdr, flip_ldr, measure, metric};
use crate::picture::{LayeredImage, Picture, read_picture};

/// Measure an image against a reference: OpenEXR or Radiance HDR
#[derive(Args, Debug)]
pub struct Metrics {
    /// The image to be judged, .exr or .hdr
    #[arg(value_name = "IMAGE")]
    image: PathBuf,
    /// What it is judged by, of the same size
    #[arg(value_name = "REFERENCE")]
    reference: PathBuf,
    /// Layer of the image, where it has several
    #[arg(long, value_name = "LAYER")]
    layer: Option<String>,
    /// Layer of the reference, where it has several
    #[arg(long, value_name = "LAYER")]
    reference_layer: Option<String>,
    /// OpenEXR file that gets the error: plain RGB image - reference, layers `relative_error` and `flip`
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    Table,
    Json,
    Csv,
}

/// Metrics of points that have a meaning for pictures, a pixel being a point.
const OF_PIXELS: [&str; 6] = ["rmse", "nrmse", "nrmse_clamped", "bias", "p95", "max_abs"];

/// A metric of two pictures: a value, or why there is none.
struct Measured {
    key: &'static str,
    label: &'static str,
    unit: &'static str,
    value: Result<f64, String>,
}

impl Metrics {
    pub fn run(self) -> Result<Exit, Failure> {
        if let Some(out) = self.out.as_deref()
            && !out.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
        {
            return Err(Failure::usage(format!("{}: the error image is an .exr", out.display())));
        }
        let image = read(&self.image, self.layer.as_deref(), "--layer")?;
        let reference = read(&self.reference, self.reference_layer.as_deref(), "--reference-layer")?;
        if image.size() != reference.size() {
            let say = |path: &Path, p: &Picture| format!("{} is {} x {}", path.display(), p.width, p.height);
            let message = format!("{}, {}: sizes differ", say(&self.image, &image), say(&self.reference, &reference));
            return Err(Failure::new(Exit::InvalidInput, message));
        }
        let (measured, flip) = compare(&image, &reference);
        if let Some(out) = &self.out {
            let failed = |e: std::io::Error| Failure::internal(format!("{}: {e}", out.display()));
            error_image(&image, &reference, flip.as_ref()).write(out).map_err(failed)?;
        }
        print(match self.format {
            Format::Table => table(&measured),
            Format::Json => format!("{:#}\n", self.json(&measured, image.size())),
            Format::Csv => csv(&measured),
        })?;
        Ok(Exit::Ok)
    }

    fn json(&self, measured: &[Measured], (width, height): (usize, usize)) -> Value {
        let values: Map<String, Value> =
            measured.iter().map(|m| (m.key.to_owned(), json!(m.value.as_ref().ok()))).collect();
        let reasons: Map<String, Value> =
            measured.iter().filter_map(|m| Some((m.key.to_owned(), json!(m.value.as_ref().err()?)))).collect();
        json!({
            "image": self.image.display().to_string(),
            "reference": self.reference.display().to_string(),
            "width": width,
            "height": height,
            "metrics": values,
            "reasons": reasons,
        })
    }
}

fn read(path: &Path, layer: Option<&str>, option: &str) -> Result<Picture, Failure> {
    read_picture(path, layer).map_err(|why| {
        let hint = if why.contains("say which") { format!(" with {option}") } else { String::new() };
        Failure::new(Exit::InvalidInput, format!("{}: {why}{hint}", path.display()))
    })
}

fn compare(image: &Picture, reference: &Picture) -> (Vec<Measured>, Option<FlipMap>) {
    let points = |p: &Picture| p.pixels.iter().map(|v| Rgb::from_array(v.map(f64::from))).collect::<Vec<_>>();
    let (candidate, truth) = (points(image), points(reference));
    let scored = Scored { reference: &truth, standard_error: None, truncated: None, candidate: &candidate };
    let mut measured: Vec<Measured> = measure(&scored)
        .into_iter()
        .filter(|(key, _)| OF_PIXELS.contains(key))
        .filter_map(|(key, score)| {
            let metric = metric(key)?;
            let unit = if metric.unit.is_empty() { "" } else { "the image's" };
            let value = score.map(|s| s.value).map_err(|why| why.to_string());
            Some(Measured { key: metric.key, label: metric.label, unit, value })
        })
        .collect();
    let map = flip_ldr(reference, image);
    let mean = |map: &Result<FlipMap, _>| match map {
        Ok(map) => Ok(map.mean()),
        Err(why) => Err(ToString::to_string(why)),
    };
    let hdr = flip_hdr(reference, image);
    let label = "mean LDR FLIP at the reference's exposure";
    measured.push(Measured { key: "flip", label, unit: "", value: mean(&map) });
    measured.push(Measured { key: "flip_hdr", label: "mean HDR FLIP", unit: "", value: mean(&hdr) });
    (measured, map.ok())
}

/// Plain RGB: image - reference, so that any viewer shows the error.
fn error_image(image: &Picture, reference: &Picture, flip: Option<&FlipMap>) -> LayeredImage {
    let mut all = LayeredImage::of_run(image, reference, None, "", "");
    all.layers.retain(|(name, _)| name == "error" || name == "relative_error");
    for (name, _) in &mut all.layers {
        if name == "error" {
            name.clear();
        }
    }
    let map = flip.map(|map| Picture::from_fn(map.width, map.height, |x, y| [map.values[y * map.width + x]; 3]));
    all.layers.extend(map.map(|map| ("flip".to_owned(), map)));
    all
}

fn table(measured: &[Measured]) -> String {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::NOTHING);
    table.set_header(["metric", "value", "unit", ""]);
    for m in measured {
        let (value, note) = match &m.value {
            Ok(value) => (format!("{value:.6e}"), m.label.to_owned()),
            Err(why) => ("-".to_owned(), format!("{}: {why}", m.label)),
        };
        table.add_row([m.key.to_owned(), value, m.unit.to_owned(), note]);
    }
    format!("{table}\n")
}

fn csv(measured: &[Measured]) -> String {
    let mut out = "metric,value,reason\n".to_owned();
    for m in measured {
        let value = m.value.as_ref().map_or(String::new(), |v| format!("{v:?}"));
        let reason = m.value.as_ref().err().map_or(String::new(), |why| format!("\"{}\"", why.replace('"', "\"\"")));
        out += &format!("{},{value},{reason}\n", m.key);
    }
    out
}
