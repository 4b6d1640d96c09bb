//! Light layouts: named lights, or a family of random ones, kept apart from the scene.

use std::ops::Range;
use std::path::Path;

use serde::Deserialize;

use super::file::{Names, PathFile, check_version, content_hash, stem};
use super::random::{RandomFile, RandomLayouts};
use super::{MotionPath, OrientedBox};
use crate::input::{InputError, Source, Spanned};
use crate::light::{Light, LightFile};

/// A light with its name, and how it moves.
#[derive(Clone, Debug)]
pub struct NamedLight {
    pub name: String,
    /// Where the file puts it.
    pub light: Light<f64>,
    pub path: Option<MotionPath>,
}

impl NamedLight {
    /// The light in `frame` of `frames`: a path carries its centre from place to place.
    pub fn at(&self, frame: usize, frames: usize) -> Light<f64> {
        match (&self.path, self.light.bounds()) {
            (Some(path), Some(bounds)) => self.light.translated(path.position(frame, frames) - bounds.center),
            _ => self.light.clone(),
        }
    }
}

/// A named list of lights, or a family of them.
#[derive(Clone, Debug)]
pub struct Layout {
    /// The file's name without its ending.
    pub name: String,
    /// Hash of the file and of every asset that it reads.
    pub content: String,
    /// Empty where the layout is random.
    pub lights: Vec<NamedLight>,
    pub random: Option<RandomLayouts>,
}

/// One list of lights: a layout's own, or one of its random ones.
#[derive(Clone, Debug)]
pub struct LayoutInstance {
    /// The layout's name; for a random one with its number, `NAME#07`.
    pub name: String,
    /// Which of the random ones.
    pub index: Option<usize>,
    pub lights: Vec<NamedLight>,
}

impl LayoutInstance {
    pub fn lights_at(&self, frame: usize, frames: usize) -> Vec<Light<f64>> {
        self.lights.iter().map(|light| light.at(frame, frames)).collect()
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LayoutFile {
    #[allow(dead_code, reason = "checked before the rest of the file")]
    schema_version: i64,
    #[allow(dead_code, reason = "for the reader of the file")]
    title: Option<String>,
    #[serde(default)]
    light: Vec<Spanned<LightFile<Spanned<PathFile>>>>,
    random: Option<Spanned<RandomFile>>,
}

impl Layout {
    /// The JSON schema of a layout file.
    pub fn schema() -> serde_json::Value {
        use crate::input::schema::{document, list, one_key, optional, required, table, text, whole};
        let light = one_key(Light::schemas(), [optional("name", text()), optional("path", PathFile::schema())]);
        let mut file = table([
            required("schema_version", whole(1, 1)),
            optional("title", text()),
            optional("light", list(light)),
            optional("random", RandomFile::schema()),
        ]);
        file["not"] =
            serde_json::json!({ "required": ["light", "random"], "properties": { "light": { "minItems": 1 } } });
        document("rigbench light layout", file)
    }

    pub fn load(path: &Path) -> Result<Self, InputError> {
        Self::of_source(&Source::read(path)?)
    }

    /// The layout of a text; relative paths resolve against the source's folder.
    pub fn of_source(source: &Source) -> Result<Self, InputError> {
        check_version(source)?;
        let file: LayoutFile = source.parse()?;
        let mut names = Names::default();
        let mut lights = Vec::new();
        for (light, number) in file.light.iter().zip(1..) {
            lights.push(named_light(source, light.get_ref(), light.span(), number, &mut names)?);
        }
        let random = match &file.random {
            Some(table) if !lights.is_empty() => {
                return Err(source.error(table.span(), "[random] beside [[light]]; a layout has one of them"));
            }
            Some(table) => Some(table.get_ref().resolve(source)?),
            None => None,
        };
        let assets: Vec<Vec<u8>> = lights.iter().filter_map(|l| Some(l.light.asset()?.as_bytes().to_vec())).collect();
        Ok(Self { name: stem(&source.path), content: content_hash(&source.text, &assets), lights, random })
    }

    /// The lights in `frame` of a scene's `frames`; none where the layout is random.
    pub fn lights_at(&self, frame: usize, frames: usize) -> Vec<Light<f64>> {
        self.lights.iter().map(|light| light.at(frame, frames)).collect()
    }

    /// The lists of lights for receivers with these boxes: one, or as many as the family has.
    pub fn instances(&self, receivers: &[OrientedBox]) -> Vec<LayoutInstance> {
        let Some(random) = &self.random else {
            return vec![LayoutInstance { name: self.name.clone(), index: None, lights: self.lights.clone() }];
        };
        let digits = (random.layouts - 1).to_string().len().max(2);
        (0..random.layouts)
            .map(|index| LayoutInstance {
                name: format!("{}#{index:0digits$}", self.name),
                index: Some(index),
                lights: random.lights(index, receivers),
            })
            .collect()
    }
}

fn named_light(
    source: &Source,
    file: &LightFile<Spanned<PathFile>>,
    span: Range<usize>,
    number: usize,
    names: &mut Names,
) -> Result<NamedLight, InputError> {
    let name = match &file.name {
        Some(name) => names.add(source, name, "light")?,
        None => format!("light-{number}"),
    };
    let light = file.resolve(source, span)?;
    let path = match &file.path {
        Some(path) if light.bounds().is_none() => {
            let message = format!("a path on a {} light, which stands nowhere", light.kind_name());
            return Err(source.error(path.span(), message));
        }
        Some(path) => Some(path.get_ref().resolve(source)?),
        None => None,
    };
    Ok(NamedLight { name, light, path })
}
