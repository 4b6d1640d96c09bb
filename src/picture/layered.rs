use std::io::{self, Cursor};
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes, Layer,
    LayerAttributes, LineOrder, ReadChannels, ReadLayers, SmallVec, Text, Vec2, WritableImage, read,
};

use super::Picture;
use crate::output::write_whole;

/// An OpenEXR file of several RGB layers in one part: 32-bit float, ZIP (16 lines), lines from top to bottom.
///
/// Layers are told apart as OpenEXR tells them, by channel names `LAYER.R`, `LAYER.G`, `LAYER.B`; the layer without a name is plain RGB.
#[derive(Clone, Debug, PartialEq)]
pub struct LayeredImage {
    pub layers: Vec<(String, Picture)>,
    /// Header attribute `rigbench.key`: the key of the run.
    pub key: String,
    /// Header attribute `rigbench.configuration`: the resolved configuration, JSON.
    pub configuration: String,
    /// Header attribute `comments`: what the layers hold.
    pub comments: String,
}

const KEY: &str = "rigbench.key";
const CONFIGURATION: &str = "rigbench.configuration";
/// The relative error divides by no less than this share of the reference's mean over the lit pixels.
const RELATIVE_FLOOR: f64 = 0.01;

impl LayeredImage {
    /// The image of a run: irradiance of the candidate and of the reference, W m^-2 and unclamped, their difference, and the
    /// albedo where a picture is to be made of them (black where the camera sees no receiver).
    ///
    /// error = candidate - reference; relative_error = error / max(reference, 1 % of the reference's mean over its lit values).
    pub fn of_run(
        candidate: &Picture,
        reference: &Picture,
        albedo: Option<&Picture>,
        key: &str,
        configuration: &str,
    ) -> Self {
        assert_eq!(candidate.size(), reference.size(), "candidate and reference differ in size");
        let lit: Vec<f64> = reference.pixels.iter().flatten().map(|v| f64::from(*v)).filter(|v| *v > 0.0).collect();
        let floor = if lit.is_empty() { 0.0 } else { RELATIVE_FLOOR * lit.iter().sum::<f64>() / lit.len() as f64 };
        let both = |value: &dyn Fn(f32, f32) -> f32| {
            Picture::from_fn(reference.width, reference.height, |x, y| {
                let (c, r) = (candidate.at(x, y), reference.at(x, y));
                std::array::from_fn(|i| value(c[i], r[i]))
            })
        };
        let relative = |c: f32, r: f32| {
            let divisor = r.max(floor as f32);
            // all black: no difference is none, any other has no relative size
            if c == r { 0.0 } else { (c - r) / divisor }
        };
        let mut layers = vec![
            ("candidate".to_owned(), candidate.clone()),
            ("reference".to_owned(), reference.clone()),
            ("error".to_owned(), both(&|c, r| c - r)),
            ("relative_error".to_owned(), both(&relative)),
        ];
        layers.extend(albedo.map(|a| ("albedo".to_owned(), a.clone())));
        let comments = format!(
            "candidate, reference: irradiance, W m^-2, unclamped. error = candidate - reference. \
             relative_error = error / max(reference, {floor:e})."
        );
        Self { layers, key: key.to_owned(), configuration: configuration.to_owned(), comments }
    }

    pub fn layer(&self, name: &str) -> Option<&Picture> {
        self.layers.iter().find(|(n, _)| n == name).map(|(_, p)| p)
    }

    /// The file's bytes, the same for the same image.
    pub fn to_bytes(&self) -> io::Result<Vec<u8>> {
        let (width, height) = self.layers.first().map_or((0, 0), |(_, p)| p.size());
        if width == 0 || height == 0 || self.layers.iter().any(|(_, p)| p.size() != (width, height)) {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "an image needs layers of one size, not empty"));
        }
        let mut channels = SmallVec::new();
        for (name, picture) in &self.layers {
            for (c, letter) in ["R", "G", "B"].into_iter().enumerate() {
                let name = if name.is_empty() { letter.to_owned() } else { format!("{name}.{letter}") };
                let samples = picture.pixels.iter().map(|p| p[c]).collect();
                channels.push(AnyChannel::new(text(&name), FlatSamples::F32(samples)));
            }
        }
        let size = Vec2(width, height);
        // one attribute in each of the two maps: their order in the file is then fixed
        let attributes = LayerAttributes {
            software_name: Some(text(concat!("rigbench ", env!("CARGO_PKG_VERSION")))),
            comments: Some(text(&self.comments)),
            other: [(text(KEY), AttributeValue::Text(text(&self.key)))].into(),
            ..LayerAttributes::default()
        };
        let encoding =
            Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
        let layer = Layer::new(size, attributes, encoding, AnyChannels::sort(channels));
        let mut image = Image::from_layer(layer);
        image.attributes = ImageAttributes {
            other: [(text(CONFIGURATION), AttributeValue::Text(text(&self.configuration)))].into(),
            ..ImageAttributes::with_size(size)
        };
        let mut bytes = Cursor::new(Vec::new());
        image.write().non_parallel().to_buffered(&mut bytes).map_err(io::Error::other)?;
        Ok(bytes.into_inner())
    }

    /// Writes the file whole or not at all.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        write_whole(path, &self.to_bytes()?)
    }

    /// Reads the RGB layers of an OpenEXR file's first part; other channels are left out, and a missing colour is 0.
    pub fn read(path: &Path) -> io::Result<Self> {
        Self::of_bytes(&std::fs::read(path)?)
            .map_err(|why| io::Error::new(io::ErrorKind::InvalidData, format!("{}: {why}", path.display())))
    }

    /// The same from a file's bytes; the error says what is wrong with them.
    pub fn of_bytes(bytes: &[u8]) -> Result<Self, String> {
        super::exr_is_believable(bytes)?;
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
            .map_err(|e| e.to_string())?;
        let layer = image.layer_data;
        let (width, height) = (layer.size.width(), layer.size.height());
        let attribute = |name: &str| {
            let found = layer.attributes.other.get(&text(name)).or_else(|| image.attributes.other.get(&text(name)));
            match found {
                Some(AttributeValue::Text(value)) => string(value),
                _ => String::new(),
            }
        };
        let mut layers: Vec<(String, Picture)> = Vec::new();
        for channel in &layer.channel_data.list {
            let name = string(&channel.name);
            let (layer_name, letter) = name.rsplit_once('.').unwrap_or(("", &name));
            let Some(c) = ["R", "G", "B"].iter().position(|known| *known == letter) else { continue };
            let place = layers.iter().position(|(n, _)| n == layer_name).unwrap_or_else(|| {
                layers.push((layer_name.to_owned(), Picture::filled(width, height, [0.0; 3])));
                layers.len() - 1
            });
            let pixels = &mut layers[place].1.pixels;
            pixels.iter_mut().zip(channel.sample_data.values_as_f32()).for_each(|(p, v)| p[c] = v);
        }
        let comments = layer.attributes.comments.as_ref().map(string).unwrap_or_default();
        Ok(Self { layers, key: attribute(KEY), configuration: attribute(CONFIGURATION), comments })
    }
}

/// UTF-8 bytes, as OpenEXR's own tools write strings.
fn text(value: &str) -> Text {
    Text::from_bytes_unchecked(SmallVec::from_slice(value.as_bytes()))
}

fn string(value: &Text) -> String {
    String::from_utf8_lossy(value.as_slice()).into_owned()
}
