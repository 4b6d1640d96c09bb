//! The experiment file: parse, validate with positions, expand to candidates, key by content.
//!
//! An axis is a variant of [`Axis`], its words and tables in `definition.rs`, and a line in `expand.rs` that says where it has a meaning.

mod axis;
mod candidate;
mod columns;
mod definition;
mod document;
mod expand;
mod file;
mod identity;
mod schema;
mod select;
mod study;
mod settings;

pub use axis::{Axis, AxisValue, AxisValues};
pub use candidate::{Candidate, Lights, Method};
pub use columns::{COLUMNS, CONTRACT_COLUMNS, Column, ColumnKind, column_named, metrics};
pub use definition::{Backend, LightModel, Precision, ProbeSource, Storage, Transition};
pub use document::{Document, Override, take_table};
pub use identity::{ALGORITHMS, Algorithms, Identity, Key, TimingIdentity};
pub use select::{Filter, Selection};
pub use settings::{CheckSettings, LimitSettings, SlurmSettings};
pub use study::{Study, StudyKind};

use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::json;
use toml::de::DeValue;

use crate::input::{InputError, Source, Spanned};
use crate::rig::{AnyRig, InterpolationChoice, RigFile};
use crate::scene::{Layout, Scene, resolve_layout, resolve_scene, root};
use crate::sh::Window;
use crate::trace::{Bounces, Effects, EffectsChoice};
use crate::volume::{Heuristic, VolumeFile};
use axis::{AxisEntry, entries};
use definition::{Choice, above_zero, check_definitions, resolve, resolve_order, whole};
use expand::{DefinitionFile, Expansion, LayoutWord, List, Lists, RigDefinition, check_include, resolve_volume};
use file::{EffectsMode, ExperimentFile, Named};
use select::KnownValues;

/// The version of experiment files that this program reads.
const VERSION: i64 = 1;

/// What a rig's name must not be: it stands for no rig.
const DIRECT: &str = "direct";

/// Which images are kept after a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    All,
    /// Those on a Pareto front, and one of each rig.
    Front,
    None,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageSettings {
    /// Pixels.
    pub width: u32,
    pub height: u32,
    pub keep: Keep,
    /// The frame of an animation of which pictures and times are taken; absent: the middle one.
    pub frame: Option<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimingSettings {
    /// Rounds that are thrown away.
    pub warmup: u32,
    /// Rounds that are kept.
    pub repeat: u32,
}

/// Bounds on the cost of a sampled reference. Exact references need none.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ReferenceSettings {
    pub points: u32,
    /// Standard error over the value at which a point is done.
    pub relative_error: f64,
    pub seconds: f64,
}

/// What some runs must hold.
#[derive(Clone, Debug)]
pub struct Threshold {
    pub selection: Selection,
    pub metric: &'static Column,
    /// The value is a ratio to that of the run of the same scene, lights and backend that this picks.
    pub per: Option<Selection>,
    pub max: Option<f64>,
    pub min: Option<f64>,
    /// Line of the experiment file, for messages.
    pub line: usize,
}

/// A statement about rigs that an experiment puts to the test: the error of the best of `rigs` is at most `within` times that of the best of
/// `against`, by `interpolation_nrmse`, on each scene x lights. Families of random layouts give it a rate and an interval.
#[derive(Clone, Debug, PartialEq)]
pub struct Claim {
    pub name: String,
    /// The statement in words.
    pub says: String,
    pub rigs: Vec<String>,
    pub against: Vec<String>,
    /// 1 is "beats".
    pub within: f64,
}

/// An experiment: its settings and every candidate, all names resolved and all values checked.
#[derive(Clone, Debug)]
pub struct Experiment {
    pub path: PathBuf,
    /// Changes of the command line, `key=value`, that made this of the file.
    pub changes: Vec<String>,
    /// The folder that holds `scenes/` and `results/`; the experiment's own where no folder above it has scenes.
    pub root: PathBuf,
    pub name: String,
    pub title: String,
    pub seed: u64,
    pub image: ImageSettings,
    pub timing: TimingSettings,
    /// Which runs are timed; absent: all.
    pub timed: Option<Selection>,
    pub reference: ReferenceSettings,
    pub effects: EffectsChoice,
    pub thresholds: Vec<Threshold>,
    pub claims: Vec<Claim>,
    /// Numbers beside the sweep.
    pub studies: Vec<Study>,
    pub limits: LimitSettings,
    pub slurm: SlurmSettings,
    pub check: CheckSettings,
    /// In the order of the matrix, the last axis fastest; then the includes.
    pub candidates: Vec<Candidate>,
}

impl Experiment {
    pub fn load(path: &Path) -> Result<Self, InputError> {
        Self::load_with(path, &[])
    }

    /// With changes of the command line applied to the file before it is looked at.
    pub fn load_with(path: &Path, changes: &[Override]) -> Result<Self, InputError> {
        let document = Document::read(path, changes)?;
        document.with_tree(|mut tree, source| {
            check_version(tree.get_ref(), source)?;
            let rigs = rig_definitions(tree.get_mut(), source)?;
            let file: ExperimentFile =
                serde::Deserialize::deserialize(toml::Deserializer::from(tree)).map_err(|e| source.toml_error(&e))?;
            let experiment = Reader::new(source, rigs, &file).experiment()?;
            Ok(Self { changes: changes.iter().map(|c| c.text().to_owned()).collect(), ..experiment })
        })
    }

    /// Where results lie unless the command line says otherwise.
    pub fn results_folder(&self) -> PathBuf {
        self.root.join("results").join(&self.name)
    }

    /// Where references are kept for all experiments that write to their usual place.
    pub fn cache_folder(&self) -> PathBuf {
        self.root.join("results").join(".cache")
    }
}

/// The version comes first, so that a file of a later one is not blamed for its new keys.
fn check_version(tree: &toml::de::DeTable<'_>, source: &Source) -> Result<(), InputError> {
    let Some(version) = tree.get("schema_version") else {
        return Err(source.error(0..0, format!("no schema_version; write `schema_version = {VERSION}`")));
    };
    match version.get_ref().as_integer().map(|number| number.as_str().parse::<i64>()) {
        Some(Ok(VERSION)) => Ok(()),
        _ => {
            let message =
                format!("unknown schema_version {}; this program reads {VERSION}", source.text[version.span()].trim());
            Err(source.error(version.span(), message))
        }
    }
}

/// `[rig.NAME]`: taken out of the tree so that `freeze_frame` can stand beside the one key of any rig.
fn rig_definitions(tree: &mut toml::de::DeTable<'_>, source: &Source) -> Result<Vec<Arc<RigDefinition>>, InputError> {
    let mut definitions = Vec::new();
    for (name, mut table) in take_table(tree, "rig", source)? {
        let span = table.span();
        if name.get_ref() == DIRECT {
            let message = "`direct` is built in (every light at every point); give the rig another name";
            return Err(source.error(name.span(), message));
        }
        let freeze_frame = match table.get_mut() {
            DeValue::Table(keys) => keys.remove("freeze_frame"),
            _ => None,
        };
        let freeze_frame = match freeze_frame {
            None => None,
            Some(value) => {
                let place = value.span();
                let frame = u32::deserialize_value(value).map_err(|e| source.toml_error(&e))?;
                Some(Spanned::new(place, frame as usize))
            }
        };
        let is_volume = match table.get_ref() {
            DeValue::Table(keys) => {
                let among = |known: &[&str]| keys.keys().find(|key| known.contains(&key.get_ref().as_ref()));
                let known = AnyRig::KEYS.iter().chain(&VolumeFile::KEYS).copied();
                let stranger = keys.keys().find(|key| known.clone().all(|known| known != key.get_ref().as_ref()));
                if let Some(stranger) = stranger {
                    return Err(source.unknown_word(stranger.span(), "rig", stranger.get_ref(), known));
                }
                match (among(&VolumeFile::KEYS), among(AnyRig::KEYS)) {
                    (Some(volume), Some(rig)) => {
                        let message =
                            format!("`{}` and `{}` in one rig; a rig has one key", volume.get_ref(), rig.get_ref());
                        return Err(source.error(rig.span(), message));
                    }
                    (volume, _) => volume.is_some(),
                }
            }
            _ => false,
        };
        // every definition is checked, used or not; volumes once their heuristics are known
        let file = if is_volume {
            DefinitionFile::Volume(VolumeFile::deserialize_value(table).map_err(|e| source.toml_error(&e))?)
        } else {
            let file = RigFile::deserialize_value(table).map_err(|e| source.toml_error(&e))?;
            file.resolve(source, span.clone(), None)?;
            DefinitionFile::Rig(file)
        };
        let name = Spanned::new(name.span(), name.into_inner().into_owned());
        definitions.push(Arc::new(RigDefinition { name, file, span, freeze_frame }));
    }
    Ok(definitions)
}

/// Serde from a part of a TOML tree; errors have their places.
trait DeserializeValue: for<'de> serde::Deserialize<'de> {
    fn deserialize_value(value: Spanned<DeValue<'_>>) -> Result<Self, toml::de::Error> {
        Self::deserialize(toml::de::ValueDeserializer::from(value))
    }
}

impl<V: for<'de> serde::Deserialize<'de>> DeserializeValue for V {}

/// The second stage: values, names, files.
struct Reader<'f> {
    source: &'f Source,
    file: &'f ExperimentFile,
    rigs: Vec<Arc<RigDefinition>>,
    scenes: HashMap<PathBuf, Arc<Scene>>,
    layouts: HashMap<PathBuf, Arc<Layout>>,
    /// Words of the file whose column reads otherwise.
    aliases: Vec<(Axis, String, String)>,
}

impl<'f> Reader<'f> {
    fn new(source: &'f Source, rigs: Vec<Arc<RigDefinition>>, file: &'f ExperimentFile) -> Self {
        Self { source, file, rigs, scenes: HashMap::new(), layouts: HashMap::new(), aliases: Vec::new() }
    }

    fn experiment(mut self) -> Result<Experiment, InputError> {
        let (source, file) = (self.source, self.file);
        check_definitions::<InterpolationChoice>(&file.interpolation, source)?;
        check_definitions::<Heuristic>(&file.heuristic, source)?;
        for definition in &self.rigs {
            if let DefinitionFile::Volume(volume) = &definition.file {
                resolve_volume(volume, definition.span.clone(), source, &file.heuristic, None, None)?;
            }
        }
        check_definitions::<LightModel>(&file.light_model, source)?;
        check_definitions::<ProbeSource>(&file.probe_source, source)?;
        check_definitions::<crate::probe::GradientSource>(&file.gradient_source, source)?;
        check_definitions::<Window>(&file.window, source)?;
        check_definitions::<Transition>(&file.transition, source)?;
        if let Some(kind) = &file.kind {
            check_kind(source, kind)?;
        }
        let seed = match &file.seed {
            None => 1,
            Some(seed) => u64::try_from(*seed.get_ref())
                .map_err(|_| source.error(seed.span(), format!("seed {}; it is not negative", seed.get_ref())))?,
        };
        let name = folder_name(source, &file.name)?;
        let image = self.image()?;
        let timing = self.timing()?;
        let reference = self.reference()?;
        let effects = self.effects()?;
        let shared = Arc::new(json!({
            "seed": seed,
            "effects": effects_words(effects),
            "image": match image.frame {
                None => json!({ "width": image.width, "height": image.height }),
                Some(frame) => json!({ "width": image.width, "height": image.height, "frame": frame }),
            },
            "reference": reference,
        }));
        let candidates = self.candidates(shared)?;
        if let Some(frame) = file.image.as_ref().and_then(|image| image.frame.as_ref())
            && let Some(short) = candidates.iter().find(|c| c.scene.frames as i64 <= *frame.get_ref())
        {
            let (name, frames) = (&short.scene.name, short.scene.frames);
            let message = format!("frame {}; scene `{name}` has {frames} (from 0)", frame.get_ref());
            return Err(source.error(frame.span(), message));
        }
        let timed = self.timed(&candidates)?;
        let thresholds = self.thresholds(&candidates)?;
        let claims = self.claims(&candidates)?;
        let studies = self.studies()?;
        Ok(Experiment {
            path: source.path.clone(),
            changes: Vec::new(),
            root: root(source.folder()).unwrap_or_else(|| source.folder().to_owned()),
            name,
            title: if file.title.is_empty() { file.name.get_ref().clone() } else { file.title.clone() },
            seed,
            image,
            timing,
            timed,
            reference,
            effects,
            thresholds,
            claims,
            studies,
            limits: LimitSettings::resolve(file.limits.as_ref(), source)?,
            slurm: SlurmSettings::resolve(file.slurm.as_ref(), source)?,
            check: CheckSettings::resolve(file.check.as_ref(), source)?,
            candidates,
        })
    }

    fn image(&self) -> Result<ImageSettings, InputError> {
        let source = self.source;
        let mut settings = ImageSettings { width: 320, height: 180, keep: Keep::Front, frame: None };
        let Some(image) = &self.file.image else { return Ok(settings) };
        if let Some(width) = &image.width {
            settings.width = whole(source, width, "width", 1..=8192)?;
        }
        if let Some(height) = &image.height {
            settings.height = whole(source, height, "height", 1..=8192)?;
        }
        if let Some(frame) = &image.frame {
            settings.frame = Some(whole(source, frame, "frame", 0..=1_000_000)? as usize);
        }
        if let Some(keep) = &image.keep {
            settings.keep = match keep.get_ref().as_str() {
                "all" => Keep::All,
                "front" => Keep::Front,
                "none" => Keep::None,
                word => return Err(source.unknown_word(keep.span(), "keep", word, ["all", "front", "none"])),
            };
        }
        Ok(settings)
    }

    fn timing(&self) -> Result<TimingSettings, InputError> {
        let source = self.source;
        let mut settings = TimingSettings { warmup: 3, repeat: 15 };
        let Some(timing) = &self.file.timing else { return Ok(settings) };
        if let Some(warmup) = &timing.warmup {
            settings.warmup = whole(source, warmup, "warmup", 0..=1000)?;
        }
        if let Some(repeat) = &timing.repeat {
            settings.repeat = whole(source, repeat, "repeat", 1..=10_000)?;
        }
        Ok(settings)
    }

    fn reference(&self) -> Result<ReferenceSettings, InputError> {
        let source = self.source;
        let mut settings = ReferenceSettings { points: 2048, relative_error: 0.005, seconds: 60.0 };
        let Some(reference) = &self.file.reference else { return Ok(settings) };
        if let Some(points) = &reference.points {
            settings.points = whole(source, points, "points", 1..=1_000_000)?;
        }
        if let Some(error) = &reference.relative_error {
            settings.relative_error = above_zero(source, error, "relative_error")?;
        }
        if let Some(seconds) = &reference.seconds {
            settings.seconds = above_zero(source, seconds, "seconds")?;
        }
        Ok(settings)
    }

    fn effects(&self) -> Result<EffectsChoice, InputError> {
        let source = self.source;
        let Some(mode) = self.file.effects.as_ref().and_then(|effects| effects.mode.as_ref()) else {
            return Ok(EffectsChoice::Auto);
        };
        let parse = |words: &str, span: Range<usize>| {
            EffectsChoice::parse(words).map_err(|message| source.error(span, message))
        };
        match mode.get_ref() {
            EffectsMode::Words(words) => parse(words, mode.span()),
            EffectsMode::List(list) if list.is_empty() => {
                Err(source.error(mode.span(), "an empty list; write \"none\" for no effects"))
            }
            EffectsMode::List(list) => {
                for word in list {
                    parse(word.get_ref(), word.span())?;
                }
                let words: Vec<&str> = list.iter().map(|word| word.get_ref().as_str()).collect();
                parse(&words.join(","), mode.span())
            }
            EffectsMode::Table(table) => {
                let bounces = match &table.bounces {
                    None => None,
                    Some(bounces) => match bounces.get_ref() {
                        AxisValue::Text(word) if word == "inf" => Some(Bounces::Infinite),
                        AxisValue::Integer(count) if u32::try_from(*count).is_ok() => {
                            Some(Bounces::Count(*count as u32))
                        }
                        other => {
                            let message = format!("bounces {other}: a whole number from 0, or \"inf\"");
                            return Err(source.error(bounces.span(), message));
                        }
                    },
                };
                Ok(EffectsChoice::Fixed(Effects { shadows: table.shadows || bounces.is_some(), bounces }))
            }
        }
    }

    /// The product, less the excludes, plus the includes.
    fn candidates(&mut self, shared: Arc<serde_json::Value>) -> Result<Vec<Candidate>, InputError> {
        let source = self.source;
        let matrix = &self.file.matrix;
        let matrix_entries = entries(matrix.get_ref(), source)?;
        if let Some(entry) = matrix_entries.iter().find(|entry| !entry.is_list) {
            let value = source.text[entry.span.clone()].trim();
            let message = format!("`{}` is a list in the matrix: [{value}]", entry.axis);
            return Err(source.error(entry.span.clone(), message));
        }
        let matrix_lists = self.lists(&matrix_entries, None)?;
        let mut expansion = Expansion::new(source, shared, &self.file.heuristic);
        let mut candidates = expansion.product(&matrix_lists, &matrix.span())?;
        let mut included = Vec::new();
        for include in &self.file.include {
            let include_entries = entries(include.get_ref(), source)?;
            let lists = self.lists(&include_entries, Some((&matrix_entries, &matrix_lists)))?;
            let own = expansion.product(&lists, &include.span())?;
            check_include(&include_entries, &own, source)?;
            included.extend(own.into_iter().map(|candidate| (candidate, include.span())));
        }
        let known = KnownValues::of(&candidates, self.aliases.clone());
        for exclude in &self.file.exclude {
            let selection = Selection::of_table(exclude.get_ref(), source, &known)?;
            let before = candidates.len();
            candidates.retain(|candidate| !selection.matches(candidate));
            if candidates.len() == before {
                return Err(source.error(exclude.span(), "this exclude removes nothing").with_help(
                    "a candidate on which an axis has no meaning appears once and does not match a value of that axis",
                ));
            }
        }
        merge(candidates, included, matrix.span(), source)
    }

    /// The lists of the matrix; or of an include, whose missing axes come from lists of the matrix that have one value.
    fn lists(&mut self, given: &[AxisEntry], matrix: Option<(&[AxisEntry], &Lists)>) -> Result<Lists, InputError> {
        let (source, file) = (self.source, self.file);
        macro_rules! words {
            ($axis:ident, $field:ident, $defined:expr) => {
                self.list(Axis::$axis, given, matrix.map(|(entries, lists)| (entries, &lists.$field)), |_, value| {
                    resolve(value, $defined, source)
                })?
            };
        }
        Ok(Lists {
            scene: self.list(Axis::Scene, given, matrix.map(|(e, lists)| (e, &lists.scene)), Self::scene)?,
            lights: self.list(Axis::Lights, given, matrix.map(|(e, lists)| (e, &lists.lights)), Self::layout)?,
            rig: self.list(Axis::Rig, given, matrix.map(|(e, lists)| (e, &lists.rig)), Self::rig)?,
            order: self.list(Axis::Order, given, matrix.map(|(e, lists)| (e, &lists.order)), |_, value| {
                resolve_order(value, source)
            })?,
            interpolation: words!(Interpolation, interpolation, &file.interpolation),
            heuristic: words!(Heuristic, heuristic, &file.heuristic),
            light_model: words!(LightModel, light_model, &file.light_model),
            probe_source: words!(ProbeSource, probe_source, &file.probe_source),
            gradient_source: words!(GradientSource, gradient_source, &file.gradient_source),
            window: words!(Window, window, &file.window),
            transition: words!(Transition, transition, &file.transition),
            backend: words!(Backend, backend, &Named::new()),
            storage: words!(Storage, storage, &Named::new()),
            precision: words!(Precision, precision, &Named::new()),
        })
    }

    fn list<V: Clone>(
        &mut self,
        axis: Axis,
        given: &[AxisEntry],
        matrix: Option<(&[AxisEntry], &List<V>)>,
        mut resolve: impl FnMut(&mut Self, &Spanned<AxisValue>) -> Result<Choice<V>, InputError>,
    ) -> Result<List<V>, InputError> {
        if let Some(entry) = given.iter().find(|entry| entry.axis == axis) {
            let mut choices: Vec<Choice<V>> = Vec::with_capacity(entry.values.len());
            for value in &entry.values {
                let choice = resolve(self, value)?;
                if choices.iter().any(|before| before.text == choice.text) {
                    let message =
                        format!("`{}` twice on the axis `{axis}`: two candidates equal in every column", choice.text);
                    return Err(self.source.error(choice.span, message));
                }
                choices.push(choice);
            }
            return Ok(List::Values(choices));
        }
        Ok(match matrix {
            Some((entries, _)) if entries.iter().any(|entry| entry.axis == axis && entry.values.len() > 1) => {
                List::Open
            }
            Some((_, list)) => list.clone(),
            None => List::Default,
        })
    }

    fn scene(&mut self, value: &Spanned<AxisValue>) -> Result<Choice<Arc<Scene>>, InputError> {
        let source = self.source;
        let span = value.span();
        let word = value.get_ref().text(Axis::Scene, source, &span)?;
        let path = resolve_scene(word, source.folder()).map_err(|e| at(source, &span, e))?;
        let scene = match self.scenes.get(&path) {
            Some(known) => known.clone(),
            None => Arc::new(Scene::load(&path)?),
        };
        if scene.receivers.is_empty() {
            return Err(source.error(span, format!("scene `{word}` has no receiver: nothing would be lit")));
        }
        self.scenes.insert(path, scene.clone());
        self.alias(Axis::Scene, word, &scene.name);
        Ok(Choice { text: scene.name.clone(), span, value: scene })
    }

    /// A layout; `NAME#07` is one of its random layouts.
    fn layout(&mut self, value: &Spanned<AxisValue>) -> Result<Choice<LayoutWord>, InputError> {
        let source = self.source;
        let span = value.span();
        let word = value.get_ref().text(Axis::Lights, source, &span)?;
        let (file_word, index) = match word.rsplit_once('#').map(|(name, digits)| (name, digits.parse::<usize>())) {
            Some((name, Ok(index))) => (name, Some(index)),
            _ => (word, None),
        };
        let path = resolve_layout(file_word, source.folder()).map_err(|e| at(source, &span, e))?;
        let layout = match self.layouts.get(&path) {
            Some(known) => known.clone(),
            None => Arc::new(Layout::load(&path)?),
        };
        self.layouts.insert(path, layout.clone());
        if let Some(index) = index
            && layout.random.as_ref().is_none_or(|random| index >= random.layouts)
        {
            let count = layout.random.as_ref().map_or(0, |random| random.layouts);
            return Err(
                source.error(span, format!("`{word}`: layout `{}` stands for {count} random layouts", layout.name))
            );
        }
        let text = match index {
            Some(index) => format!("{}#{index}", layout.name),
            None => layout.name.clone(),
        };
        self.alias(Axis::Lights, file_word, &layout.name);
        Ok(Choice { text, span, value: LayoutWord { layout, only: index } })
    }

    fn alias(&mut self, axis: Axis, word: &str, column: &str) {
        if word != column {
            self.aliases.push((axis, word.to_owned(), column.to_owned()));
        }
    }

    fn rig(&mut self, value: &Spanned<AxisValue>) -> Result<Choice<Option<Arc<RigDefinition>>>, InputError> {
        let source = self.source;
        let span = value.span();
        let word = value.get_ref().text(Axis::Rig, source, &span)?;
        let definition = self.rigs.iter().find(|rig| rig.name.get_ref() == word).cloned();
        if definition.is_none() && word != DIRECT {
            let names = self.rigs.iter().map(|rig| rig.name.get_ref().as_str());
            return Err(source.unknown_word(span, "rig", word, [DIRECT].into_iter().chain(names)));
        }
        Ok(Choice { text: word.to_owned(), span, value: definition })
    }

    /// `[timing] only = { ... }`: axes and values as in an exclude.
    fn timed(&self, candidates: &[Candidate]) -> Result<Option<Selection>, InputError> {
        let Some(only) = self.file.timing.as_ref().and_then(|timing| timing.only.as_ref()) else { return Ok(None) };
        let known = KnownValues::of(candidates, self.aliases.clone());
        let selection = Selection::of_table(only.get_ref(), self.source, &known)?;
        match candidates.iter().any(|candidate| selection.matches(candidate)) {
            true => Ok(Some(selection)),
            false => Err(self.source.error(only.span(), "`only` matches no run: nothing would be timed")),
        }
    }

    fn studies(&self) -> Result<Vec<Study>, InputError> {
        let mut studies: Vec<Study> = Vec::new();
        for file in &self.file.study {
            let study = file.get_ref().resolve(self.source, file.span())?;
            if studies.iter().any(|other| other.name == study.name) {
                return Err(self.source.error(file.span(), format!("a second study `{}`", study.name)));
            }
            studies.push(study);
        }
        Ok(studies)
    }

    fn claims(&self, candidates: &[Candidate]) -> Result<Vec<Claim>, InputError> {
        let source = self.source;
        let mut known: Vec<&str> = candidates.iter().filter_map(|c| c.column(Axis::Rig)).collect();
        known.sort_unstable();
        known.dedup();
        let rigs = |list: &Spanned<Vec<Spanned<String>>>| -> Result<Vec<String>, InputError> {
            if list.get_ref().is_empty() {
                return Err(source.error(list.span(), "an empty list; name at least one rig of the matrix"));
            }
            list.get_ref()
                .iter()
                .map(|name| match known.contains(&name.get_ref().as_str()) {
                    true => Ok(name.get_ref().clone()),
                    false => Err(source.unknown_word(name.span(), "rig", name.get_ref(), known.iter().copied())),
                })
                .collect()
        };
        let mut claims: Vec<Claim> = Vec::new();
        for claim in &self.file.claim {
            let claim = claim.get_ref();
            if claims.iter().any(|other| other.name == *claim.name.get_ref()) {
                return Err(source.error(claim.name.span(), format!("a second claim `{}`", claim.name.get_ref())));
            }
            claims.push(Claim {
                name: claim.name.get_ref().clone(),
                says: claim.says.clone(),
                rigs: rigs(&claim.rig)?,
                against: rigs(&claim.against)?,
                within: claim.within.as_ref().map_or(Ok(1.0), |w| above_zero(source, w, "within"))?,
            });
        }
        Ok(claims)
    }

    fn thresholds(&self, candidates: &[Candidate]) -> Result<Vec<Threshold>, InputError> {
        let source = self.source;
        let known = KnownValues::of(candidates, self.aliases.clone());
        let mut thresholds = Vec::new();
        for threshold in &self.file.threshold {
            let (place, threshold) = (threshold.span(), threshold.get_ref());
            let name = threshold.metric.get_ref();
            let metric = metrics().find(|metric| metric.name == name).ok_or_else(|| {
                source.unknown_word(threshold.metric.span(), "metric", name, metrics().map(|metric| metric.name))
            })?;
            let bound = |bound: &Option<Spanned<crate::input::Finite>>| bound.as_ref().map(|b| b.get_ref().0);
            let (max, min) = (bound(&threshold.max), bound(&threshold.min));
            match (max, min) {
                (None, None) => return Err(source.error(place, "a threshold needs `max` or `min`")),
                (Some(max), Some(min)) if min > max => {
                    return Err(source.error(place, format!("min {min} is above max {max}: no value can hold")));
                }
                _ => {}
            }
            let selection = Selection::of_table(threshold.selection.get_ref(), source, &known)?;
            if !candidates.iter().any(|candidate| selection.matches(candidate)) {
                return Err(source.error(threshold.selection.span(), "this threshold matches no run"));
            }
            let per = match &threshold.per {
                None => None,
                Some(per) => {
                    let per_selection = Selection::of_table(per.get_ref(), source, &known)?;
                    if !candidates.iter().any(|candidate| per_selection.matches(candidate)) {
                        return Err(source.error(per.span(), "`per` matches no run"));
                    }
                    Some(per_selection)
                }
            };
            let line = source.error(place, "").place.map_or(0, |(line, _)| line);
            thresholds.push(Threshold { selection, metric, per, max, min, line });
        }
        Ok(thresholds)
    }
}

/// Includes join those that are left; a duplicate appears once. Equal columns with different meaning are an error.
fn merge(
    mut candidates: Vec<Candidate>,
    included: Vec<(Candidate, Range<usize>)>,
    matrix: Range<usize>,
    source: &Source,
) -> Result<Vec<Candidate>, InputError> {
    let same = |label: String| format!("two candidates equal in every column: {label}");
    let mut seen = HashMap::with_capacity(candidates.len());
    for (index, candidate) in candidates.iter().enumerate() {
        if seen.insert(candidate.columns.clone(), index).is_some() {
            return Err(source.error(matrix, same(candidate.label())));
        }
    }
    for (candidate, span) in included {
        match seen.get(&candidate.columns) {
            None => {
                seen.insert(candidate.columns.clone(), candidates.len());
                candidates.push(candidate);
            }
            Some(before) if candidates[*before].identity() == candidate.identity() => {}
            Some(_) => return Err(source.error(span, same(candidate.label()))),
        }
    }
    Ok(candidates)
}

fn check_kind(source: &Source, kind: &Spanned<String>) -> Result<(), InputError> {
    match kind.get_ref().as_str() {
        "sweep" => Ok(()),
        "stability" => Err(source.error(kind.span(), "kind `stability`: hard cases, which only `run` and `plan` know")),
        word => Err(source.unknown_word(kind.span(), "kind", word, ["sweep", "stability"])),
    }
}

/// The name of an experiment is a folder's under `results/`.
pub fn folder_name(source: &Source, name: &Spanned<String>) -> Result<String, InputError> {
    let text = name.get_ref();
    let plain = text.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c));
    if plain && !text.is_empty() && !text.starts_with('.') && text.len() <= 100 {
        return Ok(text.clone());
    }
    let message =
        format!("name `{text}`: it names a folder; letters, digits, `-`, `_` and `.` (not first), at most 100");
    Err(source.error(name.span(), message))
}

/// An error about a name, at the place that says it.
fn at(source: &Source, span: &Range<usize>, error: InputError) -> InputError {
    InputError { help: error.help, ..source.error(span.clone(), error.message) }
}

/// The words of effects, one text for one choice.
pub fn effects_words(effects: EffectsChoice) -> String {
    match effects {
        EffectsChoice::Auto => "auto".to_owned(),
        EffectsChoice::Fixed(effects) => effects.to_string(),
    }
}
