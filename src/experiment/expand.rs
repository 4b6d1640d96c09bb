//! From lists of values to candidates.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use serde_json::Value;

use super::axis::{Axis, AxisEntry};
use super::candidate::{Candidate, Lights, Method};
use super::definition::{Backend, Choice, LightModel, Precision, ProbeSource, Storage, Transition, resolve};
use super::file::Named;
use crate::input::{InputError, Source, Spanned};
use crate::probe::GradientSource;
use crate::rig::interpolation::Interpolation;
use crate::rig::{AnyRig, InterpolationChoice, Rig, RigFile};
use crate::scene::{Layout, Scene};
use crate::sh::Window;
use crate::volume::{Heuristic, HeuristicFile, Lookup, Volume, VolumeFile, VolumeSetting};

/// The most candidates of an experiment.
const MOST_CANDIDATES: usize = 1_000_000;

/// A `[rig.NAME]` before its interpolation is known.
#[derive(Debug)]
pub struct RigDefinition {
    pub name: Spanned<String>,
    pub file: DefinitionFile,
    /// The table's place.
    pub span: Range<usize>,
    pub freeze_frame: Option<Spanned<usize>>,
}

/// What stands in a `[rig.NAME]`.
#[derive(Debug)]
pub enum DefinitionFile {
    Rig(RigFile),
    Volume(VolumeFile),
}

/// A layout of the matrix, or one of its random instances where the word names it.
#[derive(Clone, Debug)]
pub struct LayoutWord {
    pub layout: Arc<Layout>,
    pub only: Option<usize>,
}

/// The values of an axis.
#[derive(Clone, Debug)]
pub enum List<V> {
    Values(Vec<Choice<V>>),
    /// The axis is left out and takes what the rig or the program has.
    Default,
    /// An include leaves the axis out and the matrix has several values: an error where the axis has a meaning.
    Open,
}

/// The lists of all axes: of the matrix, or of an include.
#[derive(Clone, Debug)]
pub struct Lists {
    pub scene: List<Arc<Scene>>,
    pub lights: List<LayoutWord>,
    /// None is `direct`.
    pub rig: List<Option<Arc<RigDefinition>>>,
    pub order: List<usize>,
    pub interpolation: List<InterpolationChoice>,
    pub heuristic: List<Heuristic>,
    pub light_model: List<LightModel>,
    pub probe_source: List<ProbeSource>,
    pub gradient_source: List<GradientSource>,
    pub window: List<Window>,
    pub transition: List<Transition>,
    pub backend: List<Backend>,
    pub storage: List<Storage>,
    pub precision: List<Precision>,
}

/// Whether an axis has a meaning for a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meaning {
    /// Its values make different candidates.
    Chosen,
    /// It has this one value whatever the list says.
    Only(&'static str),
    None,
}

/// The one place that says which axis has a meaning where. An axis looks at axes before it alone.
fn meaning(axis: Axis, draft: &Draft) -> Meaning {
    let rig = draft.rig.as_deref();
    let is_volume = rig.is_some_and(|rig| matches!(rig.method, Placed::Volume(_)));
    let chosen_if = |meant: bool| if meant { Meaning::Chosen } else { Meaning::None };
    match axis {
        Axis::Scene | Axis::Lights | Axis::Rig | Axis::Backend => Meaning::Chosen,
        // a volume's samples are of the shapes themselves, and its lights stay in it
        Axis::LightModel if is_volume => Meaning::Only("exact"),
        Axis::LightModel => Meaning::Chosen,
        Axis::Transition if is_volume => Meaning::None,
        // `direct` has no SH and no probe samples
        Axis::Order | Axis::ProbeSource | Axis::Window => chosen_if(rig.is_some()),
        // lights that rays have mixed with shadows cannot be taken out of the rig
        Axis::Transition => chosen_if(rig.is_some() && draft.probe_source == Some(ProbeSource::Analytic)),
        Axis::Interpolation => chosen_if(rig.is_some_and(|rig| rig.has_interpolation)),
        Axis::GradientSource if !rig.is_some_and(|rig| rig.asks_derivatives) => Meaning::None,
        Axis::GradientSource => Meaning::Chosen,
        Axis::Heuristic => chosen_if(rig.is_some_and(|rig| rig.heuristic.is_some())),
        Axis::Storage => {
            chosen_if(draft.backend == Some(Backend::Gpu) && rig.is_some_and(|rig| rig.filtered_by_hardware))
        }
        Axis::Precision => match draft.backend {
            Some(Backend::Gpu) => Meaning::Only("f32"),
            _ => Meaning::Chosen,
        },
    }
}

/// What the axes ask of a rig.
#[derive(Debug)]
struct RigFacts {
    method: Placed,
    has_interpolation: bool,
    /// The interpolation's word, of a rig that has one.
    interpolation: Option<&'static str>,
    /// The name of the heuristic in a volume's own table.
    heuristic: Option<String>,
    asks_derivatives: bool,
    /// The GPU's texture units can do its interpolation.
    filtered_by_hardware: bool,
}

impl RigFacts {
    fn new(rig: AnyRig) -> Self {
        // derivatives are asked for or not whatever the size of the box, as long as it has extent
        let asks_derivatives = rig.placement([1.0; 3]).iter().any(|request| request.derivatives.contains(&true));
        Self {
            has_interpolation: rig.interpolation().is_some(),
            interpolation: rig.interpolation().map(Interpolation::key),
            heuristic: None,
            filtered_by_hardware: matches!(rig.interpolation(), Some(Interpolation::Trilinear(_))),
            asks_derivatives,
            method: Placed::Rig(Arc::new(rig)),
        }
    }

    fn of_volume(volume: Volume, heuristic: Option<&str>) -> Self {
        Self {
            has_interpolation: !volume.is_path(),
            interpolation: Some(volume.interpolation.key()).filter(|_| !volume.is_path()),
            heuristic: heuristic.map(str::to_owned),
            filtered_by_hardware: volume.key() == "grid"
                && volume.lookup == Lookup::PerPoint
                && matches!(volume.interpolation, Interpolation::Trilinear(_)),
            asks_derivatives: volume.takes_derivatives(),
            method: Placed::Volume(Arc::new(volume)),
        }
    }
}

/// A rig about each receiver, or a volume over the scene.
#[derive(Debug)]
enum Placed {
    Rig(Arc<AnyRig>),
    Volume(Arc<Volume>),
}

/// A candidate of which the axes up to some point are chosen.
#[derive(Clone, Debug, Default)]
struct Draft {
    columns: [Option<Arc<str>>; Axis::COUNT],
    scene: Option<Arc<Scene>>,
    lights: Option<Arc<Lights>>,
    definition: Option<Arc<RigDefinition>>,
    rig: Option<Arc<RigFacts>>,
    /// The matrix's interpolation and heuristic, where they take the place of the rig's own.
    interpolation: Option<Choice<InterpolationChoice>>,
    order: Option<usize>,
    light_model: Option<LightModel>,
    probe_source: Option<ProbeSource>,
    gradient_source: Option<GradientSource>,
    window: Option<Window>,
    transition: Option<Transition>,
    backend: Option<Backend>,
    storage: Option<Storage>,
    precision: Option<Precision>,
}

/// Expands lists; what several candidates share is made once.
pub struct Expansion<'s> {
    source: &'s Source,
    shared: Arc<Value>,
    heuristics: &'s Named<HeuristicFile>,
    rigs: HashMap<(*const RigDefinition, Option<String>, Option<String>), Arc<RigFacts>>,
    instances: HashMap<(*const Scene, *const Layout), Arc<Vec<Arc<Lights>>>>,
    candidates: Vec<Candidate>,
}

impl<'s> Expansion<'s> {
    pub fn new(source: &'s Source, shared: Arc<Value>, heuristics: &'s Named<HeuristicFile>) -> Self {
        Self { source, shared, heuristics, rigs: HashMap::new(), instances: HashMap::new(), candidates: Vec::new() }
    }

    /// Every candidate of the lists' product, each once; `place` is where the lists stand.
    pub fn product(&mut self, lists: &Lists, place: &Range<usize>) -> Result<Vec<Candidate>, InputError> {
        self.step(0, lists, &Draft::default(), place)?;
        Ok(std::mem::take(&mut self.candidates))
    }

    /// Chooses the axis at this place of [`Axis::ALL`] in every way, then those behind it.
    fn step(&mut self, at: usize, lists: &Lists, draft: &Draft, place: &Range<usize>) -> Result<(), InputError> {
        let Some(axis) = Axis::ALL.get(at).copied() else {
            if self.candidates.len() >= MOST_CANDIDATES {
                let message = format!("more than {MOST_CANDIDATES} candidates; make the matrix smaller");
                return Err(self.source.error(place.clone(), message));
            }
            self.candidates.push(self.finish(draft));
            return Ok(());
        };
        match meaning(axis, draft) {
            Meaning::None => self.step(at + 1, lists, draft, place),
            Meaning::Only(text) => {
                let mut next = draft.clone();
                next.columns[axis.index()] = Some(text.into());
                self.step(at + 1, lists, &next, place)
            }
            Meaning::Chosen => {
                for next in self.choose(axis, lists, draft, place)? {
                    self.step(at + 1, lists, &next, place)?;
                }
                Ok(())
            }
        }
    }

    /// The draft with each value of an axis.
    fn choose(
        &mut self,
        axis: Axis,
        lists: &Lists,
        draft: &Draft,
        place: &Range<usize>,
    ) -> Result<Vec<Draft>, InputError> {
        let source = self.source;
        let open = || {
            let message = format!("`{axis}` is left out and the matrix has several values for it; say which");
            source.error(place.clone(), message)
        };
        let missing = || source.error(place.clone(), format!("no `{axis}`; the matrix needs a list of them"));
        /// Every value of a list, or the default one, put into the field of its name.
        macro_rules! each {
            ($field:ident, $default:expr) => {
                match &lists.$field {
                    List::Open => Err(open()),
                    List::Default => Ok(vec![draft.with(axis, $default.0, |next| next.$field = Some($default.1))]),
                    List::Values(choices) => Ok(choices
                        .iter()
                        .map(|choice| draft.with(axis, &choice.text, |next| next.$field = Some(choice.value.clone())))
                        .collect()),
                }
            };
        }
        match axis {
            Axis::Scene => match &lists.scene {
                List::Open => Err(open()),
                List::Default => Err(missing()),
                List::Values(scenes) => Ok(scenes
                    .iter()
                    .map(|scene| draft.with(axis, &scene.text, |next| next.scene = Some(scene.value.clone())))
                    .collect()),
            },
            Axis::Lights => match &lists.lights {
                List::Open => Err(open()),
                List::Default => Err(missing()),
                List::Values(layouts) => {
                    let scene = draft.scene.clone().expect("the scene is chosen before the lights");
                    let mut drafts = Vec::new();
                    for layout in layouts {
                        let LayoutWord { layout, only } = &layout.value;
                        for lights in self.instances(&scene, layout).iter() {
                            if only.is_none_or(|index| lights.instance.index == Some(index)) {
                                drafts.push(draft.with(axis, lights.name(), |next| next.lights = Some(lights.clone())));
                            }
                        }
                    }
                    Ok(drafts)
                }
            },
            Axis::Rig => match &lists.rig {
                List::Open => Err(open()),
                List::Default => Err(missing()),
                List::Values(rigs) => {
                    let mut drafts = Vec::new();
                    for choice in rigs {
                        let mut next = draft.with(axis, &choice.text, |next| next.definition = choice.value.clone());
                        if let Some(definition) = &choice.value {
                            next.rig = Some(self.rig(definition, None, None)?);
                            self.check_frame(definition, &next)?;
                            self.check_bounds(definition, &next)?;
                        }
                        drafts.push(next);
                    }
                    Ok(drafts)
                }
            },
            Axis::Interpolation => {
                let definition = draft.definition.clone().expect("the rig is chosen before its interpolation");
                match &lists.interpolation {
                    List::Open => Err(open()),
                    List::Default => {
                        let own = draft.rig.as_ref().and_then(|facts| facts.interpolation);
                        let own = own.expect("the axis has a meaning");
                        Ok(vec![draft.with(axis, own, |_| {})])
                    }
                    List::Values(choices) => {
                        let mut drafts = Vec::new();
                        for choice in choices {
                            let rig = self.rig(&definition, Some(choice), None)?;
                            drafts.push(draft.with(axis, &choice.text, |next| {
                                next.rig = Some(rig);
                                next.interpolation = Some(choice.clone());
                            }));
                        }
                        Ok(drafts)
                    }
                }
            }
            Axis::Heuristic => {
                let definition = draft.definition.clone().expect("the rig is chosen before its heuristic");
                match &lists.heuristic {
                    List::Open => Err(open()),
                    List::Default => {
                        let own = draft.rig.as_ref().and_then(|facts| facts.heuristic.clone());
                        Ok(vec![draft.with(axis, &own.expect("the axis has a meaning"), |_| {})])
                    }
                    List::Values(choices) => {
                        let mut drafts = Vec::new();
                        for choice in choices {
                            let rig = self.rig(&definition, draft.interpolation.as_ref(), Some(choice))?;
                            drafts.push(draft.with(axis, &choice.text, |next| next.rig = Some(rig)));
                        }
                        Ok(drafts)
                    }
                }
            }
            Axis::Order => each!(order, ("3", 3)),
            Axis::LightModel => {
                let drafts: Vec<Draft> = each!(light_model, ("exact", LightModel::EXACT))?;
                if draft.rig.is_none() {
                    return Ok(drafts);
                }
                // a rig samples SH: a model in which no formula has any says nothing about it and is left out
                let sampled = |mut next: Draft| {
                    let stated = next.light_model.expect("just chosen");
                    next.light_model = Some(stated.for_rigs());
                    (stated == LightModel::EXACT || next.light_model != Some(LightModel::EXACT)).then_some(next)
                };
                let drafts: Vec<Draft> = drafts.into_iter().filter_map(sampled).collect();
                if drafts.is_empty() {
                    let message = "no light model of the list has SH for a rig to sample; add `exact`";
                    return Err(source.error(place.clone(), message));
                }
                Ok(drafts)
            }
            Axis::ProbeSource => each!(probe_source, ("analytic", ProbeSource::Analytic)),
            Axis::GradientSource => {
                // rays and texels bring their derivatives with them: their formula has a name of its own
                let formula = match draft.probe_source {
                    Some(ProbeSource::Analytic) | None => "analytic",
                    Some(_) => "semi_analytic",
                };
                let mut drafts: Vec<Draft> = each!(gradient_source, (formula, GradientSource::Analytic))?;
                for draft in drafts.iter_mut().filter(|d| d.gradient_source == Some(GradientSource::Analytic)) {
                    draft.columns[axis.index()] = Some(formula.into());
                }
                let mut seen = std::collections::HashSet::new();
                drafts.retain(|draft| seen.insert(draft.columns[axis.index()].clone()));
                Ok(drafts)
            }
            Axis::Window => each!(window, ("none", Window::None)),
            Axis::Transition => each!(transition, ("none", Transition::None)),
            Axis::Backend => each!(backend, ("cpu", Backend::Cpu)),
            Axis::Storage => each!(storage, ("buffer", Storage::Buffer)),
            Axis::Precision => each!(precision, ("f32", Precision::F32)),
        }
    }

    /// A definition with an interpolation and a heuristic of the matrix in place of its own.
    fn rig(
        &mut self,
        definition: &Arc<RigDefinition>,
        interpolation: Option<&Choice<InterpolationChoice>>,
        heuristic: Option<&Choice<Heuristic>>,
    ) -> Result<Arc<RigFacts>, InputError> {
        let text = |choice: Option<&String>| choice.cloned();
        let key = (
            Arc::as_ptr(definition),
            text(interpolation.map(|choice| &choice.text)),
            text(heuristic.map(|choice| &choice.text)),
        );
        if let Some(known) = self.rigs.get(&key) {
            return Ok(known.clone());
        }
        let choice = interpolation.map(|choice| choice.value);
        let facts = match &definition.file {
            DefinitionFile::Rig(file) => RigFacts::new(file.resolve(self.source, definition.span.clone(), choice)?),
            DefinitionFile::Volume(file) => {
                let chosen = heuristic.map(|choice| &choice.value);
                let volume =
                    resolve_volume(file, definition.span.clone(), self.source, self.heuristics, choice, chosen)?;
                RigFacts::of_volume(volume, file.heuristic_name())
            }
        };
        let facts = Arc::new(facts);
        self.rigs.insert(key, facts.clone());
        Ok(facts)
    }

    /// A volume's box must be one of the scene.
    fn check_bounds(&self, definition: &RigDefinition, draft: &Draft) -> Result<(), InputError> {
        if let (Some(Placed::Volume(volume)), Some(scene)) = (draft.rig.as_ref().map(|rig| &rig.method), &draft.scene) {
            let place = match &definition.file {
                DefinitionFile::Volume(file) => file.bounds_place(),
                DefinitionFile::Rig(_) => None,
            };
            let place = place.unwrap_or_else(|| definition.span.clone());
            volume.bounds.resolve(scene).map_err(|why| self.source.error(place, why))?;
        }
        Ok(())
    }

    /// A frozen frame must be one of the scene's.
    fn check_frame(&self, definition: &RigDefinition, draft: &Draft) -> Result<(), InputError> {
        if let (Some(frame), Some(scene)) = (&definition.freeze_frame, &draft.scene)
            && *frame.get_ref() >= scene.frames
        {
            let message = format!("frame {}; scene `{}` has {} (from 0)", frame.get_ref(), scene.name, scene.frames);
            return Err(self.source.error(frame.span(), message));
        }
        Ok(())
    }

    /// A layout in a scene: itself, or every random layout that it stands for, placed about the scene's receivers.
    fn instances(&mut self, scene: &Arc<Scene>, layout: &Arc<Layout>) -> Arc<Vec<Arc<Lights>>> {
        let known = self.instances.entry((Arc::as_ptr(scene), Arc::as_ptr(layout))).or_insert_with(|| {
            let boxes: Vec<_> = scene.receivers.iter().map(|receiver| receiver.oriented_box(0)).collect();
            let instances = layout.instances(&boxes).into_iter();
            Arc::new(instances.map(|instance| Arc::new(Lights { layout: layout.clone(), instance })).collect())
        });
        known.clone()
    }

    fn finish(&self, draft: &Draft) -> Candidate {
        let chosen = "every axis with a meaning is chosen";
        let method = match (&draft.definition, &draft.rig) {
            (Some(definition), Some(facts)) => {
                let freeze_frame = definition.freeze_frame.as_ref().map(|frame| *frame.get_ref());
                match &facts.method {
                    Placed::Rig(rig) => Method::Rig { rig: rig.clone(), freeze_frame },
                    Placed::Volume(volume) => Method::Volume { volume: volume.clone(), freeze_frame },
                }
            }
            _ => Method::Direct,
        };
        Candidate {
            columns: draft.columns.clone(),
            scene: draft.scene.clone().expect(chosen),
            lights: draft.lights.clone().expect(chosen),
            method,
            order: draft.order,
            light_model: draft.light_model.unwrap_or(LightModel::EXACT),
            probe_source: draft.probe_source,
            gradient_source: draft.gradient_source,
            window: draft.window,
            transition: draft.transition,
            backend: draft.backend.expect(chosen),
            storage: draft.storage,
            precision: draft.precision.unwrap_or(Precision::F32),
            shared: self.shared.clone(),
        }
    }
}

/// A volume's table with what the matrix puts in place of its own.
pub fn resolve_volume(
    file: &VolumeFile,
    span: Range<usize>,
    source: &Source,
    heuristics: &Named<HeuristicFile>,
    interpolation: Option<InterpolationChoice>,
    heuristic: Option<&Heuristic>,
) -> Result<Volume, InputError> {
    let named = |name: &Spanned<String>| -> Result<Heuristic, InputError> {
        let word = Spanned::new(name.span(), super::AxisValue::Text(name.get_ref().clone()));
        Ok(resolve::<Heuristic>(&word, heuristics, source)?.value)
    };
    file.resolve(source, span, &VolumeSetting { interpolation, heuristic, named: &named })
}

impl Draft {
    fn with(&self, axis: Axis, text: &str, put: impl FnOnce(&mut Draft)) -> Draft {
        let mut next = self.clone();
        next.columns[axis.index()] = Some(text.into());
        put(&mut next);
        next
    }
}

/// The candidates of an include, and an error where one of its axes has a meaning for none of them.
pub fn check_include(entries: &[AxisEntry], candidates: &[Candidate], source: &Source) -> Result<(), InputError> {
    for entry in entries {
        if candidates.iter().all(|candidate| candidate.column(entry.axis).is_none()) {
            let message = format!("`{}` has no meaning for this candidate", entry.axis);
            return Err(source.error(entry.key.clone(), message));
        }
    }
    Ok(())
}
