use std::sync::Arc;

use serde_json::{Value, json};

use super::axis::Axis;
use super::definition::{Backend, LightModel, Precision, ProbeSource, Storage, Transition};
use super::identity::{ALGORITHMS, Identity, Key};
use crate::light::Light;
use crate::probe::GradientSource;
use crate::rig::AnyRig;
use crate::scene::{Layout, LayoutInstance, Scene};
use crate::sh::Window;
use crate::volume::{STRETCH, Volume};

/// The lights of a candidate: a layout, or one of the family that a random layout stands for.
#[derive(Clone, Debug)]
pub struct Lights {
    pub layout: Arc<Layout>,
    pub instance: LayoutInstance,
}

impl Lights {
    /// The name in the results: `NAME`, or `NAME#07`.
    pub fn name(&self) -> &str {
        &self.instance.name
    }

    /// The lights in a frame of the scene's `frames`.
    pub fn at(&self, frame: usize, frames: usize) -> Vec<Light<f64>> {
        self.instance.lights_at(frame, frames)
    }

    /// What a key sees of the lights.
    fn content(&self) -> String {
        match self.instance.index {
            Some(index) => format!("{}#{index}", self.layout.content),
            None => self.layout.content.clone(),
        }
    }
}

/// How a candidate lights a receiver.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// No rig: every light at every point.
    Direct,
    Rig {
        rig: Arc<AnyRig>,
        /// Fitted in this frame only, then carried along.
        freeze_frame: Option<usize>,
    },
    /// Samples over the whole scene, taken ahead of time; where lights move, again for every frame, or in the frozen one alone.
    Volume { volume: Arc<Volume>, freeze_frame: Option<usize> },
}

/// One configuration of the matrix, every name in it resolved. An axis without a meaning for it is `None`.
#[derive(Clone, Debug)]
pub struct Candidate {
    pub(super) columns: [Option<Arc<str>>; Axis::COUNT],
    pub scene: Arc<Scene>,
    pub lights: Arc<Lights>,
    pub method: Method,
    pub order: Option<usize>,
    pub light_model: LightModel,
    pub probe_source: Option<ProbeSource>,
    pub gradient_source: Option<GradientSource>,
    pub window: Option<Window>,
    pub transition: Option<Transition>,
    pub backend: Backend,
    pub storage: Option<Storage>,
    pub precision: Precision,
    /// What of the experiment changes the numbers of every candidate: seed, effects, image size, bounds of references.
    pub(super) shared: Arc<Value>,
}

impl Candidate {
    /// What stands in an axis's column; none where the axis has no meaning.
    pub fn column(&self, axis: Axis) -> Option<&str> {
        self.columns[axis.index()].as_deref()
    }

    /// The axes that have a meaning, with what stands in their columns.
    pub fn columns(&self) -> impl Iterator<Item = (Axis, &str)> {
        Axis::ALL.into_iter().filter_map(|axis| Some((axis, self.column(axis)?)))
    }

    /// The rig, but for `direct`.
    pub fn rig(&self) -> Option<&AnyRig> {
        match &self.method {
            Method::Direct | Method::Volume { .. } => None,
            Method::Rig { rig, .. } => Some(rig),
        }
    }

    /// The volume, where the rig is one.
    pub fn volume(&self) -> Option<&Arc<Volume>> {
        match &self.method {
            Method::Volume { volume, .. } => Some(volume),
            _ => None,
        }
    }

    /// The frame in which the rig is fitted once for all, if it is.
    pub fn freeze_frame(&self) -> Option<usize> {
        match self.method {
            Method::Direct => None,
            Method::Rig { freeze_frame, .. } | Method::Volume { freeze_frame, .. } => freeze_frame,
        }
    }

    /// Whether a GPU evaluates it or takes its probe samples.
    pub fn wants_gpu(&self) -> bool {
        self.backend == Backend::Gpu || self.probe_source.is_some_and(|source| source.on_gpu())
    }

    /// Whether its lights change from frame to frame.
    pub fn lights_move(&self) -> bool {
        self.scene.frames > 1 && self.lights.instance.lights.iter().any(|light| light.path.is_some())
    }

    /// For messages: the columns side by side, scene and lights first.
    pub fn label(&self) -> String {
        let words: Vec<&str> = self.columns().map(|(_, text)| text).collect();
        words.join(" ")
    }

    /// What the run is: the same for equal numbers, wherever, whenever and on whatever machine it runs.
    pub fn identity(&self) -> Identity {
        Identity {
            columns: self.columns().map(|(axis, text)| (axis.name().to_owned(), text.to_owned())).collect(),
            configuration: self.configuration(),
            scene: self.scene.content.clone(),
            lights: self.lights.content(),
            algorithms: ALGORITHMS,
        }
    }

    /// Definitions in place of their names. Members without a meaning are left out.
    fn configuration(&self) -> Value {
        let mut configuration = json!({
            "rig": match &self.method {
                Method::Rig { rig, .. } => json!(**rig),
                Method::Volume { volume, .. } => json!(**volume),
                Method::Direct => json!("direct"),
            },
            "freeze_frame": self.freeze_frame(),
            "order": self.order,
            "light_model": self.light_model,
            "probe_source": self.probe_source,
            // errors of a volume's samples are judged by the mean over as many
            "judged_together": match (&self.method, self.probe_source) {
                (Method::Volume { .. }, Some(ProbeSource::Traced { spp: None, .. })) => json!(STRETCH),
                _ => Value::Null,
            },
            "bakes": match self.method {
                Method::Volume { freeze_frame: None, .. } if self.lights_move() => json!("every_frame_and_walk"),
                _ => Value::Null,
            },
            "probes_draw": match self.probe_source {
                Some(source) if source.on_gpu() => json!("lights and maps by what passes"),
                _ => Value::Null,
            },
            "gradient_source": self.gradient_source,
            "window": self.window,
            "transition": self.transition,
            "backend": self.backend,
            "storage": self.storage,
            "precision": self.precision,
        });
        let members = configuration.as_object_mut().expect("it is an object");
        members.retain(|_, value| !value.is_null());
        for (name, value) in self.shared.as_object().into_iter().flatten() {
            members.insert(name.clone(), value.clone());
        }
        configuration
    }

    /// The key of a reference of this candidate's scene, lights and effects; `part` says which points and what of them. Candidates
    /// that differ in nothing else share it.
    pub fn reference_key(&self, part: &Value) -> Key {
        let shared = |name: &str| self.shared.get(name).cloned().unwrap_or_default();
        Key::of(&json!({
            "part": part,
            "scene": self.scene.content,
            "lights": self.lights.content(),
            "effects": shared("effects"),
            "seed": shared("seed"),
            "reference": shared("reference"),
            "algorithms": ALGORITHMS.reference,
        }))
    }
}
