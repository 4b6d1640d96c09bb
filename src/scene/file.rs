//! The scene file: its form, the checks of its values, and the scene that comes of it.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Deserialize;
use serde_json::json;

use super::mesh::{MESH_EXTENSIONS, Mesh};
use super::{Camera, Material, MotionPath, Receiver, Shape, StaticObject, Transform};
use crate::input::{Finite, Finite3, InputError, Source, Spanned, nearest_word};

/// The version of scene and layout files that this program reads.
const VERSION: i64 = 1;

/// World coordinates beyond this (metres) are a mistake.
const LARGEST_WORLD: f64 = 1e12;

/// Scale factors lie between this and its inverse.
const SMALLEST_SCALE: f64 = 1e-12;

/// Objects that are smaller than this (metres) are a mistake.
const SMALLEST_OBJECT: f64 = 1e-12;

/// The most frames of an animation.
const MOST_FRAMES: i64 = 1 << 20;

/// Geometry, materials and camera, with the receivers apart from the static environment.
#[derive(Clone, Debug)]
pub struct Scene {
    pub path: PathBuf,
    /// The file's name without its ending.
    pub name: String,
    pub title: String,
    pub camera: Option<Camera>,
    /// Objects that are receivers, then bounds, each in the file's order.
    pub receivers: Vec<Receiver>,
    pub statics: Vec<StaticObject>,
    /// 1 without animation.
    pub frames: usize,
    /// Hash of the file and of every asset that it reads.
    pub content: String,
}

/// A scene file as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    #[allow(dead_code, reason = "checked before the rest of the file")]
    schema_version: i64,
    title: Option<String>,
    camera: Option<CameraFile>,
    #[serde(default)]
    material: BTreeMap<String, MaterialFile>,
    #[serde(default)]
    object: Vec<Spanned<ObjectFile>>,
    #[serde(default)]
    receiver: Vec<ReceiverFile>,
    animation: Option<AnimationFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    eye: Spanned<Finite3>,
    target: Spanned<Finite3>,
    up: Option<Spanned<Finite3>>,
    fov_y: Spanned<Finite>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialFile {
    albedo: Option<Spanned<Finite3>>,
    wrap: Option<Spanned<Finite>>,
    emission: Option<Spanned<Finite3>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectFile {
    name: Spanned<String>,
    #[serde(default)]
    receiver: bool,
    material: Option<Spanned<String>>,
    mesh: Option<Spanned<String>>,
    shape: Option<Spanned<ShapeFile>>,
    transform: Option<TransformFile>,
    path: Option<Spanned<PathFile>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ShapeFile {
    quad: Option<Spanned<QuadFile>>,
    #[serde(rename = "box")]
    cuboid: Option<Spanned<BoundsFile>>,
    sphere: Option<Spanned<SphereFile>>,
    cylinder: Option<Spanned<CylinderFile>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct QuadFile {
    center: Finite3,
    u: Finite3,
    v: Spanned<Finite3>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct BoundsFile {
    min: Spanned<Finite3>,
    max: Finite3,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SphereFile {
    center: Finite3,
    radius: Spanned<Finite>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CylinderFile {
    base: Finite3,
    top: Spanned<Finite3>,
    radius: Spanned<Finite>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TransformFile {
    scale: Option<Spanned<ScaleFile>>,
    rotate: Option<Finite3>,
    translate: Option<Finite3>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ReceiverFile {
    name: Spanned<String>,
    bounds: BoundsFile,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AnimationFile {
    frames: Spanned<i64>,
}

/// `path = { points = [[...], ...], spline = true }`, on an object or a light.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathFile {
    points: Spanned<Vec<Finite3>>,
    #[serde(default)]
    spline: bool,
}

impl PathFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        use crate::input::schema::{default, flag, optional, required, some, table, vector};
        table([required("points", some(vector())), optional("spline", default(flag(), false))])
    }

    pub(super) fn resolve(&self, source: &Source) -> Result<MotionPath, InputError> {
        let points: Vec<DVec3> = self.points.get_ref().iter().map(|p| p.vector()).collect();
        if points.is_empty() {
            return Err(source.error(self.points.span(), "a path without points; it needs one or more"));
        }
        if let Some(far) = points.iter().find(|p| p.abs().max_element() > LARGEST_WORLD) {
            return Err(source.error(self.points.span(), format!("the point {far} lies beyond {LARGEST_WORLD:e} m")));
        }
        Ok(MotionPath { points, spline: self.spline })
    }
}

/// One factor for all axes, or three.
#[derive(Debug, Clone, Copy)]
struct ScaleFile(DVec3);

impl<'de> Deserialize<'de> for ScaleFile {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> serde::de::Visitor<'de> for Visitor {
            type Value = ScaleFile;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a number or three numbers")
            }
            fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<ScaleFile, E> {
                match value.is_finite() {
                    true => Ok(ScaleFile(DVec3::splat(value))),
                    false => Err(E::custom(format!("{value} is no finite number"))),
                }
            }
            fn visit_i64<E: serde::de::Error>(self, value: i64) -> Result<ScaleFile, E> {
                self.visit_f64(value as f64)
            }
            fn visit_seq<A: serde::de::SeqAccess<'de>>(self, values: A) -> Result<ScaleFile, A::Error> {
                Finite3::deserialize(serde::de::value::SeqAccessDeserializer::new(values))
                    .map(|v| ScaleFile(v.vector()))
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

/// Reads the version alone, so that a file of a later one is not blamed for its new keys.
pub(super) fn check_version(source: &Source) -> Result<(), InputError> {
    #[derive(Deserialize)]
    struct Version {
        schema_version: Option<Spanned<i64>>,
    }
    match source.parse::<Version>()?.schema_version {
        Some(version) if *version.get_ref() == VERSION => Ok(()),
        Some(version) => {
            let message = format!("unknown schema_version {}; this program reads {VERSION}", version.get_ref());
            Err(source.error(version.span(), message))
        }
        None => Err(source.error(0..0, format!("no schema_version; write `schema_version = {VERSION}`"))),
    }
}

/// A file's name without its ending.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Hash of a file's text and of the assets that it reads, in their order.
pub(super) fn content_hash(text: &str, assets: &[Vec<u8>]) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in std::iter::once(text.as_bytes()).chain(assets.iter().map(Vec::as_slice)) {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    hasher.finalize().to_hex().to_string()
}

/// Names that were given, to find the second of two.
#[derive(Default)]
pub(super) struct Names(HashSet<String>);

impl Names {
    pub fn add(&mut self, source: &Source, name: &Spanned<String>, what: &str) -> Result<String, InputError> {
        let text = name.get_ref().clone();
        if text.trim().is_empty() {
            return Err(source.error(name.span(), format!("{what} needs a name that is not empty")));
        }
        match self.0.insert(text.clone()) {
            true => Ok(text),
            false => {
                Err(source.error(name.span(), format!("the name `{text}` is given twice; every {what} needs its own")))
            }
        }
    }
}

impl Scene {
    /// The JSON schema of a scene file.
    pub fn schema() -> serde_json::Value {
        use crate::input::schema::{above, between, colour, default, described, document, either, exactly, flag};
        use crate::input::schema::{list, named, number, one_key, optional, required, table, text, vector, whole};
        let camera = table([
            required("eye", vector()),
            required("target", vector()),
            optional("up", default(vector(), vec![0.0, 1.0, 0.0])),
            required(
                "fov_y",
                described(json!({ "type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 180 }), "degrees"),
            ),
        ]);
        let material = table([
            optional("albedo", exactly(3, between(0.0, 1.0))),
            optional("wrap", default(described(between(0.0, 1.0), "a of the wrap lobe; 0 is Lambert"), 0.0)),
            optional("emission", described(colour(), "radiance of the front side, W sr^-1 m^-2")),
        ]);
        let bounds = || table([required("min", vector()), required("max", vector())]);
        let shape = one_key(
            [
                ("quad", table([required("center", vector()), required("u", vector()), required("v", vector())])),
                ("box", bounds()),
                ("sphere", table([required("center", vector()), required("radius", above(0.0))])),
                (
                    "cylinder",
                    table([required("base", vector()), required("top", vector()), required("radius", above(0.0))]),
                ),
            ],
            [],
        );
        let transform = table([
            optional("scale", either([number(), vector()])),
            optional("rotate", described(vector(), "about x, then y, then z, degrees")),
            optional("translate", vector()),
        ]);
        let object = one_key(
            [("mesh", described(text(), ".obj, .ply, .gltf or .glb, relative to this file")), ("shape", shape)],
            [
                required("name", text()),
                optional("receiver", default(flag(), false)),
                optional("material", text()),
                optional("transform", transform),
                optional("path", PathFile::schema()),
            ],
        );
        let file = table([
            required("schema_version", whole(1, 1)),
            optional("title", text()),
            optional("camera", camera),
            optional("material", named(material)),
            optional("object", list(object)),
            optional("receiver", list(table([required("name", text()), required("bounds", bounds())]))),
            optional("animation", table([required("frames", whole(1, MOST_FRAMES as u64))])),
        ]);
        document("rigbench scene", file)
    }

    pub fn load(path: &Path) -> Result<Self, InputError> {
        Self::of_source(&Source::read(path)?)
    }

    /// The scene of a text; relative paths resolve against the source's folder.
    pub fn of_source(source: &Source) -> Result<Self, InputError> {
        check_version(source)?;
        let file: SceneFile = source.parse()?;
        let frames = match &file.animation {
            None => 1,
            Some(animation) => match *animation.frames.get_ref() {
                frames if (1..=MOST_FRAMES).contains(&frames) => frames as usize,
                frames => {
                    let message = format!("{frames} frames; an animation has 1 to {MOST_FRAMES}");
                    return Err(source.error(animation.frames.span(), message));
                }
            },
        };
        let mut loader = Loader {
            source,
            animated: file.animation.is_some(),
            frames,
            materials: materials(source, &file.material)?,
            meshes: HashMap::new(),
            assets: Vec::new(),
        };
        let mut names = Names::default();
        let (mut receivers, mut statics) = (Vec::new(), Vec::new());
        for object in &file.object {
            let name = names.add(source, &object.get_ref().name, "object")?;
            match object.get_ref().receiver {
                true => receivers.push(loader.receiver(name, object)?),
                false => statics.push(loader.static_object(name, object)?),
            }
        }
        for receiver in &file.receiver {
            let name = names.add(source, &receiver.name, "receiver")?;
            let bounds = bounds(source, &receiver.bounds)?;
            receivers.push(Receiver {
                name,
                material: Material::grey(),
                mesh: None,
                transform: Transform::default(),
                path: None,
                frames,
                bounds,
            });
        }
        if receivers.len() > usize::from(u16::MAX) {
            return Err(InputError::of_file(
                &source.path,
                format!("{} receivers; at most {}", receivers.len(), u16::MAX),
            ));
        }
        let name = stem(&source.path);
        Ok(Self {
            path: source.path.clone(),
            title: file.title.unwrap_or_else(|| name.clone()),
            name,
            camera: file.camera.as_ref().map(|camera| resolve_camera(source, camera)).transpose()?,
            receivers,
            statics,
            frames,
            content: content_hash(&source.text, &loader.assets),
        })
    }
}

fn resolve_camera(source: &Source, file: &CameraFile) -> Result<Camera, InputError> {
    let fov = file.fov_y.get_ref().0;
    if fov <= 0.0 || fov >= 180.0 {
        return Err(source.error(file.fov_y.span(), format!("fov_y {fov}; it must be above 0 and below 180 degrees")));
    }
    let (eye, target) = (file.eye.get_ref().vector(), file.target.get_ref().vector());
    for (place, span) in [(eye, file.eye.span()), (target, file.target.span())] {
        if place.abs().max_element() > LARGEST_WORLD {
            return Err(source.error(span, format!("{place} lies beyond {LARGEST_WORLD:e} m")));
        }
    }
    if (target - eye).try_normalize().is_none() {
        return Err(source.error(file.target.span(), "the camera's target is its eye; it must lie elsewhere"));
    }
    let up = file.up.as_ref().map_or(DVec3::Y, |up| up.get_ref().vector());
    let span = file.up.as_ref().map_or(file.target.span(), |up| up.span());
    if up == DVec3::ZERO {
        return Err(source.error(span, "the camera's up is the zero vector; it needs a direction"));
    }
    Camera::looking_at(eye, target, up, fov)
        .ok_or_else(|| source.error(span, "the camera's up is parallel to its view; turn one of them"))
}

fn materials(source: &Source, file: &BTreeMap<String, MaterialFile>) -> Result<BTreeMap<String, Material>, InputError> {
    let resolve = |(name, file): (&String, &MaterialFile)| {
        let mut material = Material { name: name.clone(), ..Material::grey() };
        if let Some(albedo) = &file.albedo {
            material.albedo = albedo.get_ref().0;
            if let Some(wrong) = material.albedo.iter().find(|c| !(0.0..=1.0).contains(*c)) {
                return Err(source.error(albedo.span(), format!("albedo {wrong}; every channel lies in 0 to 1")));
            }
        }
        if let Some(wrap) = &file.wrap {
            material.wrap = wrap.get_ref().0;
            if !(0.0..=1.0).contains(&material.wrap) {
                return Err(source.error(wrap.span(), format!("wrap {}; it lies in 0 to 1", material.wrap)));
            }
        }
        if let Some(emission) = &file.emission {
            material.emission = emission.get_ref().0;
            if let Some(wrong) = material.emission.iter().find(|c| **c < 0.0) {
                return Err(source.error(emission.span(), format!("emission {wrong}; no channel may be negative")));
            }
        }
        Ok((name.clone(), material))
    };
    file.iter().map(resolve).collect()
}

fn bounds(source: &Source, file: &BoundsFile) -> Result<(DVec3, DVec3), InputError> {
    let (min, max) = (file.min.get_ref().vector(), file.max.vector());
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        if min[axis] > max[axis] {
            let message = format!("min {} above max {} on {name}; min may not exceed max", min[axis], max[axis]);
            return Err(source.error(file.min.span(), message));
        }
    }
    if min.abs().max(max.abs()).max_element() > LARGEST_WORLD {
        return Err(source.error(file.min.span(), format!("bounds beyond {LARGEST_WORLD:e} m")));
    }
    Ok((min, max))
}

fn positive(source: &Source, value: &Spanned<Finite>, what: &str) -> Result<f64, InputError> {
    match value.get_ref().0 {
        number if number > 0.0 => Ok(number),
        number => Err(source.error(value.span(), format!("{what} {number}; it must be above 0"))),
    }
}

fn shape(source: &Source, file: &Spanned<ShapeFile>) -> Result<Shape, InputError> {
    let ShapeFile { quad, cuboid, sphere, cylinder } = file.get_ref();
    let mut given = Vec::new();
    given.extend(quad.as_ref().map(|t| ("quad", t.span())));
    given.extend(cuboid.as_ref().map(|t| ("box", t.span())));
    given.extend(sphere.as_ref().map(|t| ("sphere", t.span())));
    given.extend(cylinder.as_ref().map(|t| ("cylinder", t.span())));
    given.sort_by_key(|(_, span)| span.start);
    match given.as_slice() {
        [_] => {}
        [] => return Err(source.error(file.span(), "an empty shape; one of `quad`, `box`, `sphere`, `cylinder`")),
        [first, second, ..] => {
            let message = format!("`{}` beside `{}`; an object has one shape", second.0, first.0);
            return Err(source.error(second.1.clone(), message));
        }
    }
    if let Some(file) = quad {
        let QuadFile { center, u, v } = file.get_ref();
        if u.vector().cross(v.get_ref().vector()).try_normalize().is_none() {
            return Err(source.error(v.span(), "u and v are parallel or zero; the quad has no area"));
        }
        return Ok(Shape::Quad { center: center.vector(), u: u.vector(), v: v.get_ref().vector() });
    }
    if let Some(file) = cuboid {
        let (min, max) = bounds(source, file.get_ref())?;
        return Ok(Shape::Box { min, max });
    }
    if let Some(file) = sphere {
        let radius = positive(source, &file.get_ref().radius, "radius")?;
        return Ok(Shape::Sphere { center: file.get_ref().center.vector(), radius });
    }
    let file = cylinder.as_ref().expect("one shape was given").get_ref();
    let (base, top) = (file.base.vector(), file.top.get_ref().vector());
    if (top - base).try_normalize().is_none() {
        return Err(source.error(file.top.span(), "the cylinder's top is its base; it needs a height"));
    }
    Ok(Shape::Cylinder { base, top, radius: positive(source, &file.radius, "radius")? })
}

fn transform(source: &Source, file: &TransformFile) -> Result<Transform, InputError> {
    let mut transform = Transform::default();
    if let Some(scale) = &file.scale {
        transform.scale = scale.get_ref().0;
        let size = transform.scale.abs();
        if size.min_element() == 0.0 {
            return Err(source.error(scale.span(), "a scale of 0; every factor must differ from 0"));
        }
        if size.min_element() < SMALLEST_SCALE || size.max_element() > 1.0 / SMALLEST_SCALE {
            let allowed = format!("{SMALLEST_SCALE:e} to {:e}", 1.0 / SMALLEST_SCALE);
            return Err(
                source.error(scale.span(), format!("a scale of {}; its size lies in {allowed}", transform.scale))
            );
        }
    }
    if let Some(rotate) = file.rotate {
        transform.rotate = rotate.vector();
    }
    if let Some(translate) = file.translate {
        transform.translate = translate.vector();
    }
    Ok(transform)
}

struct Loader<'a> {
    source: &'a Source,
    animated: bool,
    frames: usize,
    materials: BTreeMap<String, Material>,
    /// Files that several objects share are read once.
    meshes: HashMap<PathBuf, Mesh>,
    assets: Vec<Vec<u8>>,
}

/// What receivers and static objects have in common.
struct Placed {
    material: Material,
    mesh: Mesh,
    transform: Transform,
    path: Option<MotionPath>,
}

impl Loader<'_> {
    fn receiver(&mut self, name: String, object: &Spanned<ObjectFile>) -> Result<Receiver, InputError> {
        let Placed { material, mesh, transform, path } = self.place(object)?;
        let bounds = mesh.bounds();
        Ok(Receiver { name, material, mesh: Some(mesh), transform, path, frames: self.frames, bounds })
    }

    fn static_object(&mut self, name: String, object: &Spanned<ObjectFile>) -> Result<StaticObject, InputError> {
        if let Some(path) = &object.get_ref().path {
            let error =
                self.source.error(path.span(), "a path on an object of the static environment, which stands still");
            return Err(error.with_help("write `receiver = true` if the object is dynamic"));
        }
        let Placed { material, mesh, transform, .. } = self.place(object)?;
        Ok(StaticObject { name, material, mesh: mesh.transformed(&transform.world_from_object()) })
    }

    fn place(&mut self, object: &Spanned<ObjectFile>) -> Result<Placed, InputError> {
        let source = self.source;
        let file = object.get_ref();
        let material = match &file.material {
            None => Material::grey(),
            Some(name) => self.materials.get(name.get_ref()).cloned().ok_or_else(|| {
                let known = self.materials.keys().map(String::as_str);
                source.unknown_word(name.span(), "material", name.get_ref(), known)
            })?,
        };
        let mesh = match (&file.mesh, &file.shape) {
            (Some(mesh), None) => self.mesh(mesh)?,
            (None, Some(table)) => {
                shape(source, table)?.mesh().map_err(|message| source.error(table.span(), message))?
            }
            (Some(_), Some(shape)) => {
                return Err(source.error(shape.span(), "`shape` beside `mesh`; an object has one of them"));
            }
            (None, None) => {
                return Err(source.error(object.span(), "an object without geometry; it needs `mesh` or `shape`"));
            }
        };
        let transform = file.transform.as_ref().map(|t| transform(source, t)).transpose()?.unwrap_or_default();
        let path = match &file.path {
            Some(path) if !self.animated => {
                let error = source.error(path.span(), "a path in a scene without frames");
                return Err(error.with_help("say how many: `[animation]` with `frames = 24`"));
            }
            Some(path) => Some(path.get_ref().resolve(source)?),
            None => None,
        };
        let map = transform.world_from_object();
        let (min, max) = mesh.bounds();
        let placed = super::OrientedBox::aligned(min, max).carried(&map);
        let near = |corner: DVec3| corner.is_finite() && corner.abs().max_element() <= LARGEST_WORLD;
        if !placed.corners().into_iter().all(near) {
            return Err(source.error(object.span(), format!("the object reaches beyond {LARGEST_WORLD:e} m")));
        }
        if placed.half_diagonal() < SMALLEST_OBJECT {
            return Err(source.error(object.span(), format!("the object is smaller than {SMALLEST_OBJECT:e} m")));
        }
        Ok(Placed { material, mesh, transform, path })
    }

    fn mesh(&mut self, word: &Spanned<String>) -> Result<Mesh, InputError> {
        let path = self.source.folder().join(word.get_ref());
        if let Some(mesh) = self.meshes.get(&path) {
            return Ok(mesh.clone());
        }
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if !MESH_EXTENSIONS.contains(&extension.as_str()) {
            return Err(self.source.unknown_word(
                word.span(),
                "mesh format",
                &extension,
                MESH_EXTENSIONS.iter().copied(),
            ));
        }
        if !path.is_file() {
            let error = self.source.error(word.span(), format!("there is no mesh `{}`", word.get_ref()));
            return Err(match nearest_file(&path) {
                Some(near) => error.with_help(format!("did you mean `{near}`?")),
                None => error,
            });
        }
        let mesh = Mesh::read(&path, &mut self.assets)?;
        self.meshes.insert(path, mesh.clone());
        Ok(mesh)
    }
}

/// The file of a missing one's folder with the nearest name, beside the folder as it was written.
fn nearest_file(missing: &Path) -> Option<String> {
    let folder = missing.parent()?;
    let names: Vec<String> = std::fs::read_dir(folder)
        .ok()?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| MESH_EXTENSIONS.iter().any(|e| name.to_lowercase().ends_with(&format!(".{e}"))))
        .collect();
    let wanted = missing.file_name()?.to_string_lossy().into_owned();
    nearest_word(&wanted, names.iter().map(String::as_str)).map(str::to_owned)
}
