//! `rigbench query`: the reference, or a rig, at points of the user's own. The same code as the renders use.

mod gpu;
mod points;
mod projection;
mod values;
mod volume;

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use toml::de::DeTable;

use self::points::read_points;
use self::values::{Values, write_csv};
use super::{Exit, Failure, print};
use crate::candidate::{FittedRig, RigStage, local_points};
use crate::input::{InputError, Source};
use crate::light::{self, Light, LightModel};
use crate::math::{Real, Rgb, Stream, StreamPurpose, Vector3};
use crate::probe::{GradientSource, Probes};
use crate::reference;
use crate::rig::AnyRig;
use crate::scene::{Layout, OrientedBox, Receiver, Scene, SurfacePoint, resolve_layout, resolve_scene};
use crate::sh::{Lobe, MAX_ORDER, Window};
use crate::trace::{Effects, EffectsChoice, Effort, Projected, SceneFacts, Seed, TracedGeometry, Tracer, Transport};
use crate::volume::{Volume, VolumeFile};
use crate::with_order;

/// Evaluate the reference, or a rig, at points of your own; CSV to stdout
#[derive(Args, Debug)]
pub struct Query {
    /// Scene: a file's path, or a name under scenes/
    pub scene: String,
    /// CSV of points with the header x,y,z,nx,ny,nz (nx,ny,nz only where irradiance is asked for)
    #[arg(long, value_name = "CSV")]
    pub points: PathBuf,
    /// Light layout: a file's path, or a name under scenes/lights/ (NAME#07 for one of a random family)
    #[arg(long, value_name = "LAYOUT")]
    pub lights: Option<String>,
    /// Inline TOML rig or volume, e.g. 'gradient = {}' or 'grid = { bounds = "room", samples = [5, 4, 5] }', or `direct`; absent: the
    /// reference. A volume may bring heuristics of its own on further lines: heuristic.NAME = { any = [...] }
    #[arg(long, value_name = "TOML")]
    pub rig: Option<String>,
    /// Whose box the rig spans; needed where the scene has several receivers
    #[arg(long, value_name = "NAME")]
    pub receiver: Option<String>,
    /// What to evaluate
    #[arg(long, value_enum, default_value_t = Quantity::Irradiance)]
    pub quantity: Quantity,
    /// SH order, 1 to 6
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=MAX_ORDER as i64))]
    pub order: u8,
    /// a of the wrap lobe, 0 to 1; 0 is Lambert
    #[arg(long, default_value_t = 0.0, value_parser = parse_wrap)]
    pub wrap: f64,
    /// none, auto, or a comma list of shadows, bounces=N, bounces=inf
    #[arg(long, default_value = "none")]
    pub effects: String,
    /// Arithmetic
    #[arg(long, value_enum, default_value_t = Precision::F64)]
    pub precision: Precision,
    /// Where it is evaluated; the GPU computes in f32
    #[arg(long, value_enum, default_value_t = Backend::Cpu)]
    pub backend: Backend,
    /// Rays or paths a point, where sampling is needed
    #[arg(long)]
    pub spp: Option<u64>,
    /// Frame of an animated scene, from 0
    #[arg(long, default_value_t = 0)]
    pub frame: usize,
    /// Seed of the random streams
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// What a query evaluates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Quantity {
    /// E at points with normals
    Irradiance,
    /// SH radiance coefficients
    Sh,
    /// Their derivatives along x, y and z
    ShGradient,
}

/// Arithmetic of a query.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Precision {
    F32,
    F64,
}

/// Where a query is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    Cpu,
    Gpu,
}

fn parse_wrap(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(a) if (0.0..=1.0).contains(&a) => Ok(a),
        _ => Err(format!("a wrap is a number from 0 to 1, got `{word}`")),
    }
}

impl Query {
    pub fn run(self) -> Result<Exit, Failure> {
        let mut csv = Vec::new();
        answer(&self, &mut csv)?;
        print(csv)?;
        Ok(Exit::Ok)
    }
}

/// What is asked.
enum Model {
    /// No model: the light itself.
    Reference,
    Rig(AnyRig),
    Volume(Volume),
}

impl Model {
    /// The rig or the volume of an inline text.
    fn inline(text: &str) -> Result<Self, InputError> {
        let source = Source::inline("rig", text);
        let tree = DeTable::parse(text).map_err(|error| source.toml_error(&error))?;
        let is_volume = |key: &str| VolumeFile::KEYS.contains(&key);
        if tree.get_ref().keys().any(|key| is_volume(key.get_ref())) {
            return Volume::inline(text).map(Self::Volume);
        }
        let known = AnyRig::KEYS.iter().chain(&VolumeFile::KEYS).copied();
        let stranger = tree.get_ref().keys().find(|key| !AnyRig::KEYS.contains(&key.get_ref().as_ref()));
        match stranger {
            Some(key) => Err(source.unknown_word(key.span(), "rig", key.get_ref(), known)),
            None => AnyRig::inline(text).map(Self::Rig),
        }
    }
}

/// Runs the query and writes its CSV.
fn answer(args: &Query, out: &mut dyn Write) -> Result<(), Failure> {
    let folder = Path::new("");
    let scene = Scene::load(&resolve_scene(&args.scene, folder)?)?;
    let lights = match &args.lights {
        Some(word) => load_lights(word, &scene, args)?,
        None => Vec::new(),
    };
    if args.frame >= scene.frames {
        return Err(Failure::usage(format!("frame {} of a scene with {} frames (from 0)", args.frame, scene.frames)));
    }
    let with_normals = args.quantity == Quantity::Irradiance;
    let points = read_points(&args.points, with_normals)?;
    let model = match args.rig.as_deref().map(str::trim) {
        None | Some("direct") => Model::Reference,
        Some(text) => Model::inline(text)?,
    };
    let receiver = receiver(&scene, args, &model)?;
    let bounds = receiver.map(|receiver| receiver.oriented_box(args.frame));
    let choice = EffectsChoice::parse(&args.effects).map_err(Failure::usage)?;
    let effects = choice.resolve(&SceneFacts::of(&scene, lights.len())).0;
    // geometry that does nothing to light still tells volumes which cells hold any
    let is_met = effects != Effects::NONE || matches!(model, Model::Volume(_));
    let statics = if is_met { &scene.statics[..] } else { &[][..] };
    let tracer = Tracer::new(&TracedGeometry::of_statics(statics));
    let lighting = Lighting {
        lights: &lights,
        tracer: &tracer,
        effects,
        effort: args.spp.map_or(Effort::ACCURATE, |spp| Effort::Samples(spp.max(1))),
        seed: args.seed,
    };
    let rig = match &model {
        Model::Rig(rig) => Some(rig),
        Model::Reference | Model::Volume(_) => None,
    };
    let values = match (&model, args.backend, args.precision) {
        (Model::Volume(volume), ..) => volume::values(args, &lighting, &scene, volume, receiver, &points.points)?,
        (_, Backend::Gpu, _) => gpu::values(args, &lighting, rig, &points.points, bounds)?,
        (_, Backend::Cpu, Precision::F64) => evaluate::<f64>(args, &lighting, rig, &points.points, bounds)?,
        (_, Backend::Cpu, Precision::F32) => evaluate::<f32>(args, &lighting, rig, &points.points, bounds)?,
    };
    write_csv(args.quantity, &points, &values, out).map_err(Failure::internal)
}

/// The lights of a layout; of a random family the one that `NAME#index` names.
fn load_lights(word: &str, scene: &Scene, args: &Query) -> Result<Vec<Light<f64>>, Failure> {
    let (name, index) = match word.rsplit_once('#') {
        Some((name, index)) => match index.parse::<usize>() {
            Ok(index) => (name, Some(index)),
            Err(_) => return Err(Failure::usage(format!("`{word}`: what follows # is the number of a layout"))),
        },
        None => (word, None),
    };
    let layout = Layout::load(&resolve_layout(name, Path::new(""))?)?;
    if layout.random.is_none() {
        return match index {
            None => Ok(layout.lights_at(args.frame, scene.frames)),
            Some(_) => Err(Failure::usage(format!("`{name}` is no random family; leave the # out"))),
        };
    }
    let boxes: Vec<OrientedBox> = scene.receivers.iter().map(|r| r.oriented_box(args.frame)).collect();
    let instances = layout.instances(&boxes);
    let Some(index) = index else {
        return Err(Failure::usage(format!(
            "`{name}` is a family of {} random layouts; name one as `{name}#0`",
            instances.len()
        )));
    };
    let count = instances.len();
    match instances.into_iter().find(|instance| instance.index == Some(index)) {
        Some(instance) => Ok(instance.lights_at(args.frame, scene.frames)),
        None => Err(Failure::usage(format!("`{name}` has layouts 0 to {}, not {index}", count.saturating_sub(1)))),
    }
}

/// The named receiver, else the only one. `None` where the scene has none or several and no rig needs one.
fn receiver<'s>(scene: &'s Scene, args: &Query, model: &Model) -> Result<Option<&'s Receiver>, Failure> {
    let names: Vec<&str> = scene.receivers.iter().map(|r| r.name.as_str()).collect();
    let chosen: Option<&Receiver> = match (&args.receiver, &scene.receivers[..]) {
        (Some(name), receivers) => match receivers.iter().find(|r| r.name == *name) {
            Some(receiver) => Some(receiver),
            None => {
                let mut message = crate::input::unknown_word_message("receiver", name, &names);
                if let Some(near) = crate::input::nearest_word(name, names.iter().copied()) {
                    message += &format!("; did you mean `{near}`?");
                }
                return Err(Failure::usage(message));
            }
        },
        (None, [only]) => Some(only),
        (None, _) => None,
    };
    if args.rig.is_some() && !matches!(model, Model::Volume(_)) && chosen.is_none() {
        return Err(Failure::usage(match names.is_empty() {
            true => "a rig spans a receiver's box, and the scene has no receiver".to_owned(),
            false => format!("the scene has several receivers; choose one with --receiver: {}", names.join(", ")),
        }));
    }
    Ok(chosen)
}

/// Central-difference step of a rig's own gradient, as a share of the box's half diagonal: second-order error about 1e-10
/// of the third derivative, rounding about 1e-11 in f64.
const RIG_GRADIENT_STEP: f64 = 1e-5;

/// A rig on traced samples is fitted so many times from independent streams; the spread of its values is their standard error.
const REPLICATES: u64 = 16;

/// The lights and the static environment that a query sees.
struct Lighting<'a> {
    lights: &'a [Light<f64>],
    tracer: &'a Tracer,
    effects: Effects,
    effort: Effort,
    seed: u64,
}

impl Lighting<'_> {
    /// Whether anything has to be sampled: an effect is on and there is geometry for it.
    fn is_sampled(&self) -> bool {
        self.effects != Effects::NONE && self.tracer.triangle_count() > 0
    }
}

fn evaluate<T: Real>(
    args: &Query,
    lighting: &Lighting,
    rig: Option<&AnyRig>,
    points: &[SurfacePoint],
    bounds: Option<OrientedBox>,
) -> Result<Values, Failure> {
    match (rig, lighting.is_sampled()) {
        (None, false) => Ok(exact_values::<T>(args, lighting.lights, points, bounds)),
        (None, true) => Ok(traced_values(args, lighting, points)),
        (Some(rig), _) => {
            let bounds = bounds.expect("a rig was refused without a box");
            let read = |fitted: &FittedRig<T>| Ok(read_rig(args, fitted, &bounds, points));
            rig_values::<T>(args, lighting, rig, bounds, read)
        }
    }
}

/// The reference of lights that nothing blocks.
fn exact_values<T: Real>(
    args: &Query,
    lights: &[Light<f64>],
    points: &[SurfacePoint],
    bounds: Option<OrientedBox>,
) -> Values {
    let origin = bounds.map_or_else(|| mean_position(points), |b| b.center);
    if args.quantity == Quantity::Irradiance {
        let values = reference::exact(lights, points, &Lobe::<T>::new(args.wrap), origin);
        return Values::Irradiance { value: values.irradiance, error: Vec::new() };
    }
    let local: Vec<Light<T>> = lights.iter().map(|light| light.relative_to(origin)).collect();
    let at = |point: &SurfacePoint| {
        let p = Vector3::of(point.position - origin);
        with_order!(usize::from(args.order), C => match args.quantity {
            Quantity::ShGradient => {
                light::projection_with_gradient::<T, C>(&local, p).value.gradient.map(|g| doubles(&g)).to_vec()
            }
            _ => vec![doubles(&light::projection::<T, C>(&local, p).value)],
        })
    };
    Values::Sh { value: points.iter().map(at).collect(), error: Vec::new() }
}

/// The reference with shadows and bounces.
fn traced_values(args: &Query, lighting: &Lighting, points: &[SurfacePoint]) -> Values {
    let transport = Transport::new(lighting.tracer, lighting.lights, lighting.effects);
    if args.quantity == Quantity::Irradiance {
        let lobe = Lobe::new(args.wrap);
        let values = reference::traced(&transport, points, &lobe, lighting.seed, lighting.effort);
        return Values::Irradiance { value: values.irradiance, error: values.standard_error };
    }
    let gradient = args.quantity == Quantity::ShGradient;
    let places: Vec<glam::DVec3> = points.iter().map(|p| p.position).collect();
    let seed = Seed { seed: lighting.seed, purpose: StreamPurpose::Reference };
    let estimates = transport.projection(&places, usize::from(args.order), gradient, seed, lighting.effort);
    let rows = |projected: Projected| match projected.gradient {
        Some(gradient) => gradient.to_vec(),
        None => vec![projected.value],
    };
    let (value, error) = estimates.into_iter().map(|e| (rows(e.value), rows(e.standard_error))).unzip();
    Values::Sh { value, error }
}

/// What a fitted rig gives at the points.
fn read_rig<T: Real>(args: &Query, fitted: &FittedRig<T>, bounds: &OrientedBox, points: &[SurfacePoint]) -> Values {
    let at = |position: glam::DVec3| doubles(&fitted.sh_at(Vector3::of(bounds.local(position))));
    match args.quantity {
        Quantity::Irradiance => {
            let mut out = vec![Rgb::zero(); points.len()];
            fitted.irradiance(&local_points(bounds, points), &mut out);
            Values::Irradiance { value: doubles(&out), error: Vec::new() }
        }
        Quantity::Sh => {
            let value = points.iter().map(|point| vec![at(point.position)]).collect();
            Values::Sh { value, error: Vec::new() }
        }
        Quantity::ShGradient => {
            let step = gradient_step::<T>(bounds);
            let value = points.iter().map(|point| differences(step, |offset| at(point.position + offset))).collect();
            Values::Sh { value, error: Vec::new() }
        }
    }
}

/// The work of one of several replicates whose mean is to be as good as all of the work would make one.
fn in_replicates(effort: Effort) -> Effort {
    match effort {
        Effort::Samples(count) => Effort::Samples(count.div_ceil(REPLICATES)),
        Effort::Error { relative, most_samples, deadline } => Effort::Error {
            relative: relative * (REPLICATES as f64).sqrt(),
            most_samples: most_samples.div_ceil(REPLICATES),
            deadline,
        },
    }
}

/// What a rig makes of the lights, or of traced samples of them. `read` evaluates it.
fn rig_values<T: Real>(
    args: &Query,
    lighting: &Lighting,
    rig: &AnyRig,
    bounds: OrientedBox,
    read: impl Fn(&FittedRig<T>) -> Result<Values, Failure>,
) -> Result<Values, Failure> {
    let lobe = Lobe::<T>::new(args.wrap);
    let order = usize::from(args.order);
    let stage = RigStage::<T>::new(
        rig,
        bounds,
        order,
        lighting.lights,
        LightModel::EXACT,
        lobe,
        GradientSource::Analytic,
        Window::None,
    );
    if !lighting.is_sampled() {
        return read(&stage.fit());
    }
    let transport = Transport::new(lighting.tracer, lighting.lights, lighting.effects);
    let effort = in_replicates(lighting.effort);
    let replicates = (0..REPLICATES)
        .map(|k| {
            let seed = Stream::indexed(lighting.seed, StreamPurpose::Probe, k).next_u64();
            let mut stage = stage.clone();
            stage.bake(&transport, Probes::Traced { effort, seed }, None).expect("rays on the CPU need no device");
            read(&stage.fit())
        })
        .collect::<Result<Vec<Values>, Failure>>()?;
    Ok(Values::mean_of(replicates))
}

/// Step of the gradient of what a rig reconstructs, metres: balances the differences' own error against rounding.
fn gradient_step<T: Real>(bounds: &OrientedBox) -> f64 {
    let scale = bounds.half_diagonal();
    let share = if T::NAME == "f64" { RIG_GRADIENT_STEP } else { 1e-2 };
    share * if scale > 0.0 { scale } else { 1.0 }
}

/// Central differences of coefficients along the world's axes; `at` gives them at an offset, metres.
fn differences(step: f64, at: impl Fn(glam::DVec3) -> Vec<Rgb<f64>>) -> Vec<Vec<Rgb<f64>>> {
    glam::DVec3::AXES
        .map(|axis| {
            let (above, below) = (at(axis * step), at(axis * -step));
            above.into_iter().zip(below).map(|(a, b)| (a - b) * (0.5 / step)).collect()
        })
        .into()
}

fn doubles<T: Real>(values: &[Rgb<T>]) -> Vec<Rgb<f64>> {
    values.iter().map(|v| v.to_double()).collect()
}

fn mean_position(points: &[SurfacePoint]) -> glam::DVec3 {
    let count = points.len().max(1) as f64;
    points.iter().map(|p| p.position / count).sum()
}
