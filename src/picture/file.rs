//! Image files of any program's making: OpenEXR and Radiance HDR.

use std::io::Read;
use std::path::Path;

use exr::prelude::{ReadChannels, ReadLayers, read};

use super::Picture;
use super::guard::{exr_is_believable, hdr_is_believable};

/// Reads linear RGB from an .exr or .hdr file. The error says what is wrong with it, without the file's name.
///
/// An OpenEXR file may hold several layers, told apart by parts or by channel names `LAYER.R`; `layer` names the one that is
/// wanted. Without a name it is the layer of plain R, G, B (or Y alone, then grey), else the only one there is.
pub fn read_picture(path: &Path, layer: Option<&str>) -> Result<Picture, String> {
    picture_of(&picture_bytes(path)?, path, layer)
}

/// The most bytes of a picture's file.
const LARGEST_FILE: u64 = 1 << 32;

/// The bytes of a picture's file; a device that never ends is none.
pub fn picture_bytes(path: &Path) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| format!("cannot be read: {e}"))?;
    file.take(LARGEST_FILE + 1).read_to_end(&mut bytes).map_err(|e| format!("cannot be read: {e}"))?;
    match bytes.len() as u64 > LARGEST_FILE {
        true => Err(format!("a picture has at most {LARGEST_FILE} bytes; this one is larger")),
        false => Ok(bytes),
    }
}

/// As [`read_picture`], from the file's bytes; the path tells the kind of file by its ending.
pub fn picture_of(bytes: &[u8], path: &Path, layer: Option<&str>) -> Result<Picture, String> {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_lowercase();
    match (ending.as_str(), layer) {
        ("exr", _) => read_exr(bytes, layer),
        ("hdr", None) => read_hdr(bytes),
        ("hdr", Some(_)) => Err("a Radiance .hdr file has no layers".to_owned()),
        (other, _) => Err(format!("an image of the kind `.{other}`; allowed: `.exr`, `.hdr`")),
    }
}

fn read_hdr(bytes: &[u8]) -> Result<Picture, String> {
    hdr_is_believable(bytes)?;
    let image = image::load_from_memory_with_format(bytes, image::ImageFormat::Hdr)
        .map_err(|e| format!("not a whole Radiance .hdr file: {e}"))?
        .into_rgb32f();
    let (width, height) = (image.width() as usize, image.height() as usize);
    Ok(Picture { width, height, pixels: image.pixels().map(|p| p.0).collect() })
}

/// A layer on its way: its name and what was found of R, G, B and Y.
struct Found {
    name: String,
    size: (usize, usize),
    channels: [Option<Vec<f32>>; 4],
}

fn read_exr(bytes: &[u8], wanted: Option<&str>) -> Result<Picture, String> {
    exr_is_believable(bytes)?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(std::io::Cursor::new(bytes))
        .map_err(|e| format!("not a whole OpenEXR file: {e}"))?;
    let mut all: Vec<Found> = Vec::new();
    for part in &image.layer_data {
        let first = all.len();
        let part_name = part.attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
        for channel in &part.channel_data.list {
            let whole = channel.name.to_string();
            let (prefix, letter) = whole.rsplit_once('.').unwrap_or(("", &whole));
            let Some(index) = ["R", "G", "B", "Y"].iter().position(|known| *known == letter) else { continue };
            let name = if prefix.is_empty() { part_name.clone() } else { prefix.to_owned() };
            let place = all[first..].iter().position(|f| f.name == name).map_or_else(
                || {
                    all.push(Found {
                        name,
                        size: (part.size.width(), part.size.height()),
                        channels: Default::default(),
                    });
                    all.len() - 1
                },
                |place| first + place,
            );
            all[place].channels[index] = Some(channel.sample_data.values_as_f32().collect());
        }
    }
    all.retain(|f| f.channels[..3].iter().all(Option::is_some) || f.channels[3].is_some());
    let names = || all.iter().map(|f| format!("`{}`", f.name)).collect::<Vec<_>>().join(", ");
    let chosen = match wanted {
        Some(wanted) => all
            .iter()
            .position(|f| f.name == wanted)
            .ok_or_else(|| format!("no layer `{wanted}`; it has {}", names()))?,
        None => match all.iter().position(|f| f.name.is_empty()) {
            Some(plain) => plain,
            None if all.is_empty() => return Err("no layer with the channels R, G and B, or Y".to_owned()),
            // parts with a name each: the first is the picture; layers within one part say nothing of the kind
            None if all.len() == 1 || image.layer_data.len() > 1 => 0,
            None => return Err(format!("several layers and none without a name: say which of {}", names())),
        },
    };
    let Found { size: (width, height), channels: [r, g, b, y], .. } = all.swap_remove(chosen);
    let [r, g, b] = match (r, g, b, y) {
        (Some(r), Some(g), Some(b), _) => [r, g, b],
        (.., Some(y)) => [y.clone(), y.clone(), y],
        _ => unreachable!("such layers were not retained"),
    };
    if [&r, &g, &b].iter().any(|c| c.len() != width * height) {
        return Err("subsampled channels; R, G and B must have every pixel".to_owned());
    }
    Ok(Picture { width, height, pixels: (0..width * height).map(|k| [r[k], g[k], b[k]]).collect() })
}
