//! Volumes as an experiment configures them.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::DVec3;
use serde::Deserialize;
use serde_json::Value;

use super::heuristic::{Heuristic, HeuristicFile};
use super::model::{Across, can_be_continuous};
use crate::input::{Finite, Finite3, InputError, Source, Spanned, nearest_word, schema};
use crate::rig::InterpolationChoice;
use crate::rig::interpolation::Interpolation;
use crate::scene::{OrientedBox, Scene};

/// The most samples that a volume takes unless its table says otherwise.
const BUDGET: usize = 100_000;
/// The most that a table may allow.
const MOST_BUDGET: usize = 16_000_000;
/// Metres along an axis of a volume's box, least and most: beyond them no number has digits left for its cells.
const EXTENTS: [f64; 2] = [1e-6, 1e9];
/// The deepest octree.
const MOST_LEVEL: u32 = 12;

/// The box that a volume fills.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Bounds {
    /// A receiver of the scene by name, as it stands in the first frame.
    Receiver(String),
    /// Wherever the scene's moving objects go.
    Paths,
    /// World coordinates.
    Box { min: [f64; 3], max: [f64; 3] },
}

impl Bounds {
    /// The box in a scene. The error says what the scene has.
    pub fn resolve(&self, scene: &Scene) -> Result<OrientedBox, String> {
        let found = match self {
            Bounds::Box { min, max } => OrientedBox::aligned(DVec3::from_array(*min), DVec3::from_array(*max)),
            Bounds::Paths => OrientedBox::aligned(DVec3::NEG_ONE, DVec3::ONE),
            Bounds::Receiver(name) => match scene.receivers.iter().find(|receiver| receiver.name == *name) {
                Some(receiver) => receiver.oriented_box(0),
                None => {
                    let names: Vec<&str> = scene.receivers.iter().map(|r| r.name.as_str()).collect();
                    let quoted: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
                    let near =
                        nearest_word(name, names).map_or(String::new(), |near| format!("; did you mean `{near}`?"));
                    return Err(format!(
                        "scene `{}` has no receiver or bounds `{name}`; it has {}{near}",
                        scene.name,
                        quoted.join(", ")
                    ));
                }
            },
        };
        let [x, y, z] = found.half.map(|half| 2.0 * half);
        let [least, most] = EXTENTS;
        if [x, y, z].iter().any(|extent| *extent <= 0.0) {
            return Err(format!("{self} is empty: {x} x {y} x {z} m"));
        }
        if [x, y, z].iter().any(|extent| !(least..=most).contains(extent)) {
            return Err(format!("{self} is {x:?} x {y:?} x {z:?} m; allowed: {least:e} to {most:e} m along each axis"));
        }
        Ok(found)
    }
}

impl std::fmt::Display for Bounds {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Bounds::Receiver(name) => write!(f, "the box of `{name}`"),
            Bounds::Paths | Bounds::Box { .. } => f.write_str("the volume's box"),
        }
    }
}

/// How samples stand in the box.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Structure {
    /// Samples along the axes: at the box's ends and evenly between; one alone at the centre.
    Grid { samples: [usize; 3] },
    /// A grid whose cells that contain geometry hold an inner grid of `inner`^3 cells (Greger et al. 1998).
    TwoLevel { samples: [usize; 3], inner: u32 },
    /// Octrees side by side.
    Octree {
        roots: [u32; 3],
        min_level: u32,
        max_level: u32,
        heuristic: Heuristic,
        across: Across,
        /// Children that differ less from their parent are undone afterwards.
        cull: Option<f64>,
    },
    /// Samples along the path of every object, spread evenly over its time; read by time, not by place.
    Path { samples: usize },
}

/// How a moving object reads a volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lookup {
    /// At every point that is shaded.
    #[default]
    PerPoint,
    /// At the object's vertices; SH vectors are interpolated over its triangles.
    PerVertex,
    /// Once, at the centre of the object's box, with the gradient there.
    PerObject,
}

/// A volume over a scene.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Volume {
    pub bounds: Bounds,
    pub structure: Structure,
    pub interpolation: Interpolation,
    pub lookup: Lookup,
    /// Share of the way that a `per_object` lookup goes each frame from what it was towards what is read; 1 is all of it.
    pub smoothing: f64,
    /// Samples inside geometry are replaced by their neighbours.
    pub repair: bool,
    /// The most samples that a bake may take.
    pub budget: usize,
}

impl Volume {
    /// The key of its table.
    pub fn key(&self) -> &'static str {
        match self.structure {
            Structure::Grid { .. } => "grid",
            Structure::TwoLevel { .. } => "two_level",
            Structure::Octree { .. } => "octree",
            Structure::Path { .. } => "path",
        }
    }

    /// Whether it is read by time.
    pub fn is_path(&self) -> bool {
        matches!(self.structure, Structure::Path { .. })
    }

    pub fn heuristic(&self) -> Option<&Heuristic> {
        match &self.structure {
            Structure::Octree { heuristic, .. } => Some(heuristic),
            _ => None,
        }
    }

    /// Whether kept samples have derivatives.
    pub fn keeps_derivatives(&self) -> bool {
        self.interpolation.uses_derivatives() || self.lookup == Lookup::PerObject || self.is_path()
    }

    /// Whether taken samples have them.
    pub fn takes_derivatives(&self) -> bool {
        self.keeps_derivatives() || self.heuristic().is_some_and(Heuristic::uses_derivatives)
    }
}

/// What stands under `bounds`.
#[derive(Clone, Debug)]
enum BoundsFile {
    Name(String),
    Box(BoxFile),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct BoxFile {
    min: Finite3,
    max: Finite3,
}

impl<'de> Deserialize<'de> for BoundsFile {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrBox;
        impl<'de> serde::de::Visitor<'de> for NameOrBox {
            type Value = BoundsFile;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("the name of a receiver, or a table of `min` and `max`")
            }
            fn visit_str<E>(self, name: &str) -> Result<BoundsFile, E> {
                Ok(BoundsFile::Name(name.to_owned()))
            }
            fn visit_map<M: serde::de::MapAccess<'de>>(self, table: M) -> Result<BoundsFile, M::Error> {
                BoxFile::deserialize(serde::de::value::MapAccessDeserializer::new(table)).map(BoundsFile::Box)
            }
        }
        deserializer.deserialize_any(NameOrBox)
    }
}

/// What all kinds of volumes have.
macro_rules! volume_table {
    ($(#[$doc:meta])* $name:ident { $($field:ident: $type:ty),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Debug, Deserialize)]
        #[serde(deny_unknown_fields, expecting = "a table with `bounds`")]
        struct $name {
            bounds: Spanned<BoundsFile>,
            interpolation: Option<Spanned<String>>,
            power: Option<Spanned<Finite>>,
            lookup: Option<Spanned<Lookup>>,
            smoothing: Option<Spanned<Finite>>,
            #[serde(default)]
            repair: bool,
            budget: Option<Spanned<i64>>,
            $($field: $type),*
        }

        impl $name {
            fn common(&self) -> Common<'_> {
                Common {
                    bounds: &self.bounds,
                    interpolation: self.interpolation.as_ref(),
                    power: self.power.as_ref(),
                    lookup: self.lookup.as_ref(),
                    smoothing: self.smoothing.as_ref(),
                    repair: self.repair,
                    budget: self.budget.as_ref(),
                }
            }
        }
    };
}

volume_table!(GridFile { samples: Spanned<Vec<Spanned<i64>>> });
volume_table!(TwoLevelFile { samples: Spanned<Vec<Spanned<i64>>>, inner: Spanned<i64> });
volume_table!(OctreeFile {
    roots: Option<Spanned<Vec<Spanned<i64>>>>,
    min_level: Spanned<i64>,
    max_level: Spanned<i64>,
    heuristic: Option<Spanned<String>>,
    across: Option<Spanned<Across>>,
    cull: Option<Spanned<Finite>>,
});

struct Common<'f> {
    bounds: &'f Spanned<BoundsFile>,
    interpolation: Option<&'f Spanned<String>>,
    power: Option<&'f Spanned<Finite>>,
    lookup: Option<&'f Spanned<Lookup>>,
    smoothing: Option<&'f Spanned<Finite>>,
    repair: bool,
    budget: Option<&'f Spanned<i64>>,
}

/// A table `[rig.NAME]` that is a volume: one key.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeFile {
    grid: Option<Spanned<GridFile>>,
    two_level: Option<Spanned<TwoLevelFile>>,
    octree: Option<Spanned<OctreeFile>>,
    path: Option<Spanned<PathFile>>,
}

/// Samples along the paths of objects.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with `samples`")]
struct PathFile {
    samples: Spanned<i64>,
}

/// What an experiment puts in the place of what a volume's table says, and what names in the table stand for.
pub struct VolumeSetting<'s> {
    pub interpolation: Option<InterpolationChoice>,
    /// The matrix's.
    pub heuristic: Option<&'s Heuristic>,
    /// The meaning of a heuristic's name; the error is about the name.
    pub named: &'s dyn Fn(&Spanned<String>) -> Result<Heuristic, InputError>,
}

impl VolumeFile {
    /// The keys of volumes.
    pub const KEYS: [&'static str; 4] = ["grid", "two_level", "octree", "path"];

    /// The keys, each with the JSON schema of its table.
    pub fn schemas() -> Vec<(&'static str, Value)> {
        use schema::{above, between, default, described, either, exactly, flag, optional, required, table, text};
        use schema::{vector, whole, word};
        let bounds = || {
            let name = described(text(), "a receiver of the scene");
            required("bounds", either([name, table([required("min", vector()), required("max", vector())])]))
        };
        let common = || {
            let interpolation = default(word(Interpolation::KEYS.iter().copied()), "trilinear");
            let lookup = default(word(["per_point", "per_vertex", "per_object"]), "per_point");
            [
                bounds(),
                optional("interpolation", interpolation),
                optional("power", default(above(0.0), 1.0)),
                optional("lookup", lookup),
                optional("smoothing", default(described(between(0.0, 1.0), "share of the way each frame"), 1.0)),
                optional("repair", default(flag(), false)),
                optional("budget", default(described(whole(8, MOST_BUDGET as u64), "most samples"), BUDGET)),
            ]
        };
        let samples = || required("samples", exactly(3, whole(1, 4096)));
        let level = |name| required(name, whole(0, u64::from(MOST_LEVEL)));
        vec![
            ("grid", table(common().into_iter().chain([samples()]))),
            ("two_level", table(common().into_iter().chain([samples(), required("inner", whole(2, 64))]))),
            (
                "octree",
                table(common().into_iter().chain([
                    optional("roots", exactly(3, whole(1, 256))),
                    level("min_level"),
                    level("max_level"),
                    optional("heuristic", described(text(), "a [heuristic.NAME] of this file, or a built-in word")),
                    optional("across", default(word(["naive", "continuous"]), "continuous")),
                    optional("cull", above(0.0)),
                ])),
            ),
            ("path", table([required("samples", whole(1, 4096))])),
        ]
    }

    /// Where its table says `bounds`.
    pub fn bounds_place(&self) -> Option<Range<usize>> {
        let grid = self.grid.as_ref().map(|grid| &grid.get_ref().bounds);
        let two_level = self.two_level.as_ref().map(|two_level| &two_level.get_ref().bounds);
        let octree = self.octree.as_ref().map(|octree| &octree.get_ref().bounds);
        grid.or(two_level).or(octree).map(Spanned::span)
    }

    /// The name of its heuristic, as its table says it.
    pub fn heuristic_name(&self) -> Option<&str> {
        let octree = self.octree.as_ref()?.get_ref();
        Some(octree.heuristic.as_ref().map_or(Heuristic::WORDS[0], |name| name.get_ref()))
    }

    /// The volume. `span` is the table's place.
    pub fn resolve(&self, source: &Source, span: Range<usize>, setting: &VolumeSetting) -> Result<Volume, InputError> {
        let given: Vec<(&str, Range<usize>)> = [
            ("grid", self.grid.as_ref().map(Spanned::span)),
            ("two_level", self.two_level.as_ref().map(Spanned::span)),
            ("octree", self.octree.as_ref().map(Spanned::span)),
            ("path", self.path.as_ref().map(Spanned::span)),
        ]
        .into_iter()
        .filter_map(|(key, span)| span.map(|span| (key, span)))
        .collect();
        if let [(first, _), (second, place), ..] = given.as_slice() {
            let message = format!("`{first}` and `{second}` in one rig; a rig has one key");
            return Err(source.error(place.clone(), message));
        }
        if let Some(path) = &self.path {
            let samples = whole(source, &path.get_ref().samples, "samples", 1, 4096)? as usize;
            return Ok(Volume {
                bounds: Bounds::Paths,
                structure: Structure::Path { samples },
                interpolation: Interpolation::named("trilinear", 1.0).expect("a word of the list"),
                lookup: Lookup::PerObject,
                smoothing: 1.0,
                repair: false,
                budget: MOST_BUDGET,
            });
        }
        if let Some(grid) = &self.grid {
            let grid = grid.get_ref();
            let samples = counts(source, &grid.samples, 1, 4096)?;
            let volume = volume(source, grid.common(), Structure::Grid { samples }, setting)?;
            check_budget(source, grid.samples.span(), &volume, samples.iter().product())?;
            return Ok(volume);
        }
        if let Some(two_level) = &self.two_level {
            let two_level = two_level.get_ref();
            let samples = counts(source, &two_level.samples, 2, 4096)?;
            let inner = whole(source, &two_level.inner, "inner", 2, 64)? as u32;
            let structure = Structure::TwoLevel { samples, inner };
            let volume = volume(source, two_level.common(), structure, setting)?;
            check_budget(source, two_level.samples.span(), &volume, samples.iter().product())?;
            return Ok(volume);
        }
        let Some(octree) = &self.octree else {
            return Err(source.error(span, format!("no volume; give one key of {}", Self::KEYS.join(", "))));
        };
        let octree = octree.get_ref();
        let roots = match &octree.roots {
            Some(roots) => counts(source, roots, 1, 256)?.map(|n| n as u32),
            None => [1; 3],
        };
        let min_level = whole(source, &octree.min_level, "min_level", 0, i64::from(MOST_LEVEL))? as u32;
        let max_level = whole(source, &octree.max_level, "max_level", 0, i64::from(MOST_LEVEL))? as u32;
        if min_level > max_level {
            let message = format!("max_level {max_level} is below min_level {min_level}");
            return Err(source.error(octree.max_level.span(), message));
        }
        let heuristic = match (setting.heuristic, &octree.heuristic) {
            (Some(chosen), _) => chosen.clone(),
            (None, Some(name)) => (setting.named)(name)?,
            (None, None) => Heuristic::named(Heuristic::WORDS[0]).expect("a word of the list"),
        };
        let cull = match &octree.cull {
            None => None,
            Some(cull) if cull.get_ref().0 > 0.0 => Some(cull.get_ref().0),
            Some(cull) => {
                return Err(source.error(cull.span(), format!("cull {}; a tolerance is above 0", cull.get_ref().0)));
            }
        };
        let across = octree.across.as_ref().map_or(Across::default(), |across| *across.get_ref());
        let full = |level: u32| {
            roots.iter().map(|n| *n as usize * (1 << level) + 1).fold(1usize, |product, n| product.saturating_mul(n))
        };
        let prunes = heuristic.prune().is_some();
        let structure = Structure::Octree { roots, min_level, max_level, heuristic, across, cull };
        let volume = volume(source, octree.common(), structure, setting)?;
        if across == Across::Continuous && !can_be_continuous(&volume.interpolation) {
            let word = octree.interpolation.as_ref().map_or(octree.min_level.span(), Spanned::span);
            let place = octree.across.as_ref().map_or(word, Spanned::span);
            let message = format!(
                "across = \"continuous\" with `{}`, which jumps within one level already",
                volume.interpolation.key()
            );
            let help = "take across = \"naive\", or one of trilinear, gradient_corrected, half_gradient, tricubic";
            return Err(source.error(place, message).with_help(help));
        }
        check_budget(source, octree.min_level.span(), &volume, full(min_level))?;
        if prunes {
            check_budget(source, octree.max_level.span(), &volume, full(max_level))?;
        }
        Ok(volume)
    }
}

fn volume(
    source: &Source,
    common: Common,
    structure: Structure,
    setting: &VolumeSetting,
) -> Result<Volume, InputError> {
    let bounds = match common.bounds.get_ref() {
        BoundsFile::Name(name) => Bounds::Receiver(name.clone()),
        BoundsFile::Box(BoxFile { min, max }) => {
            let [min, max] = [min.vector().to_array(), max.vector().to_array()];
            if let Some(axis) = (0..3).find(|axis| max[*axis] <= min[*axis]) {
                let message = format!("an empty box: {} from {} to {}", ["x", "y", "z"][axis], min[axis], max[axis]);
                return Err(source.error(common.bounds.span(), message));
            }
            Bounds::Box { min, max }
        }
    };
    let (word, place) = match common.interpolation {
        Some(word) => (word.get_ref().as_str(), word.span()),
        None => ("trilinear", common.bounds.span()),
    };
    let own = InterpolationChoice::new(source, place, word, common.power)?;
    let power = common.power.map(|power| power.get_ref().0);
    let lookup = common.lookup.map_or(Lookup::default(), |lookup| *lookup.get_ref());
    let smoothing = match common.smoothing {
        None => 1.0,
        Some(given) => {
            let share = given.get_ref().0;
            if !(share > 0.0 && share <= 1.0) {
                let message = format!("smoothing {share}; the share of the way is above 0 and at most 1");
                return Err(source.error(given.span(), message));
            }
            if lookup != Lookup::PerObject {
                let message = "smoothing is for `lookup = \"per_object\"`: it remembers one vector an object";
                return Err(source.error(given.span(), message));
            }
            share
        }
    };
    let budget = common.budget.map_or(Ok(BUDGET as i64), |n| whole(source, n, "budget", 8, MOST_BUDGET as i64))?;
    let interpolation = setting.interpolation.unwrap_or(own).resolve(power);
    let budget = budget as usize;
    Ok(Volume { bounds, structure, interpolation, lookup, smoothing, repair: common.repair, budget })
}

/// The words that say how to go on where a volume wants too many samples.
pub fn budget_help(budget: usize) -> String {
    format!("raise it by `budget = N` in the volume's table (it is {budget}), or ask for fewer samples")
}

fn check_budget(source: &Source, place: Range<usize>, volume: &Volume, samples: usize) -> Result<(), InputError> {
    if samples <= volume.budget {
        return Ok(());
    }
    let message = format!("{samples} samples at least, and the volume's budget is {}", volume.budget);
    Err(source.error(place, message).with_help(budget_help(volume.budget)))
}

fn whole(source: &Source, value: &Spanned<i64>, what: &str, least: i64, most: i64) -> Result<i64, InputError> {
    match *value.get_ref() {
        number if (least..=most).contains(&number) => Ok(number),
        number => Err(source.error(value.span(), format!("{what} {number}; allowed: {least} to {most}"))),
    }
}

fn counts(source: &Source, list: &Spanned<Vec<Spanned<i64>>>, least: i64, most: i64) -> Result<[usize; 3], InputError> {
    let numbers: Vec<usize> = list
        .get_ref()
        .iter()
        .map(|n| whole(source, n, "count", least, most).map(|n| n as usize))
        .collect::<Result<_, _>>()?;
    numbers.try_into().map_err(|numbers: Vec<usize>| {
        source.error(list.span(), format!("{} counts where three belong", numbers.len()))
    })
}

/// An inline text of the command line: a volume's table, and beside it the heuristics that it names.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct InlineFile {
    grid: Option<Spanned<GridFile>>,
    two_level: Option<Spanned<TwoLevelFile>>,
    octree: Option<Spanned<OctreeFile>>,
    path: Option<Spanned<PathFile>>,
    #[serde(default)]
    heuristic: BTreeMap<Spanned<String>, Spanned<HeuristicFile>>,
}

impl Volume {
    /// The volume of an inline table, as the command line gives it: `octree = { ... }`, and where it names a heuristic of its own
    /// `heuristic.NAME = { any = [...] }` on another line.
    pub fn inline(text: &str) -> Result<Self, InputError> {
        let source = Source::inline("rig", text);
        let InlineFile { grid, two_level, octree, path, heuristic } = source.parse()?;
        for (name, table) in &heuristic {
            table.get_ref().resolve(&source, table.span())?;
            if Heuristic::WORDS.contains(&name.get_ref().as_str()) {
                let message = format!("`{}` is a built-in heuristic; give the table another name", name.get_ref());
                return Err(source.error(name.span(), message));
            }
        }
        let named = |name: &Spanned<String>| {
            let defined = heuristic.iter().find(|(known, _)| known.get_ref() == name.get_ref());
            match (Heuristic::named(name.get_ref()), defined) {
                (Some(word), _) => Ok(word),
                (None, Some((_, table))) => table.get_ref().resolve(&source, table.span()),
                (None, None) => {
                    let known = heuristic.keys().map(|name| name.get_ref().as_str());
                    let allowed = Heuristic::WORDS.into_iter().chain(known);
                    Err(source.unknown_word(name.span(), "heuristic", name.get_ref(), allowed))
                }
            }
        };
        let setting = VolumeSetting { interpolation: None, heuristic: None, named: &named };
        VolumeFile { grid, two_level, octree, path }.resolve(&source, 0..text.len(), &setting)
    }

    /// World places of its samples along the scene's moving objects, object after object; none for other structures.
    pub fn tracks(&self, scene: &Scene) -> Vec<DVec3> {
        let Structure::Path { samples } = self.structure else { return Vec::new() };
        let moving = scene.receivers.iter().filter(|receiver| receiver.mesh.is_some());
        moving.flat_map(|receiver| (0..samples).map(move |k| receiver.center_along(k, samples))).collect()
    }
}
