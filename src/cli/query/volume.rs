//! A query of a volume: baked as a sweep bakes it, read as a sweep's receivers read it.

use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use super::projection::{coefficients_at, rows};
use super::values::Values;
use super::{Backend, Lighting, Precision, Quantity, Query, REPLICATES, in_replicates};
use crate::candidate::{Arithmetic, CandidateError, GpuBench, Reading, Surroundings, prepare_radiance, prepare_volume};
use crate::cli::{Exit, Failure};
use crate::gpu::{AdapterKind, Gpu};
use crate::input::{InputError, Source};
use crate::math::{Stream, StreamPurpose};
use crate::probe::{GradientSource, Prober, Probes};
use crate::scene::{OrientedBox, Receiver, Scene, SurfacePoint};
use crate::sh::Window;
use crate::trace::Transport;
use crate::volume::{BakedVolume, Layout, Lookup, Volume, bake_along, resample};

/// Steps of the gradient of what a volume reconstructs, as shares of the smallest edge of its cells: f64, and f32.
const STEPS: [f64; 2] = [1e-5, 1e-2];

pub(super) fn values(
    args: &Query,
    lighting: &Lighting,
    scene: &Scene,
    volume: &Volume,
    receiver: Option<&Receiver>,
    points: &[SurfacePoint],
) -> Result<Values, Failure> {
    let arithmetic = match (args.backend, args.precision) {
        (Backend::Gpu, _) => Arithmetic::GpuBuffer,
        (Backend::Cpu, Precision::F64) => Arithmetic::CpuF64,
        (Backend::Cpu, Precision::F32) => Arithmetic::CpuF32,
    };
    let bench = match args.backend {
        Backend::Cpu => None,
        Backend::Gpu => {
            let gpu = Gpu::open(AdapterKind::Any).map_err(|error| Failure::new(Exit::NoGpu, error.to_string()))?;
            Some(GpuBench::new(gpu))
        }
    };
    let bounds = volume.bounds.resolve(scene).map_err(|why| misplaced(args, why))?;
    let reader = Reader::new(args, lighting, scene, volume, receiver, bounds, arithmetic, bench)?;
    let tracks = volume.tracks(scene);
    let transport = Transport::new(lighting.tracer, lighting.lights, lighting.effects);
    let prober = Prober {
        bounds,
        order: usize::from(args.order),
        lights: lighting.lights,
        transport: (lighting.tracer.triangle_count() > 0).then_some(&transport),
        device: None,
        probes: Probes::Analytic,
        gradients: GradientSource::Analytic,
        window: Window::None,
    };
    if !lighting.is_sampled() {
        let baked = bake_along(volume, &prober, &tracks).map_err(invalid)?;
        return reader.read(&Arc::new(baked), points);
    }
    // where samples stand is decided once, by all the work that is allowed; then come independent estimates of what they hold
    let traced = |effort, seed| Prober { probes: Probes::Traced { effort, seed }, ..prober };
    let laid_out = match volume.heuristic() {
        Some(_) => Some(bake_along(volume, &traced(lighting.effort, lighting.seed), &tracks).map_err(invalid)?),
        None => None,
    };
    let replicates = (0..REPLICATES)
        .map(|k| {
            let seed = Stream::indexed(lighting.seed, StreamPurpose::Probe, k).next_u64();
            let prober = traced(in_replicates(lighting.effort), seed);
            let baked = match &laid_out {
                Some(laid_out) => resample(laid_out, &prober, &tracks),
                None => bake_along(volume, &prober, &tracks),
            };
            reader.read(&Arc::new(baked.map_err(invalid)?), points)
        })
        .collect::<Result<Vec<Values>, Failure>>()?;
    Ok(Values::mean_of(replicates))
}

/// The volume's table asks for what cannot be.
fn invalid(error: impl std::fmt::Display) -> Failure {
    Failure::new(Exit::InvalidInput, format!("--rig: {error}"))
}

/// The table's `bounds` name nothing, or an empty box.
fn misplaced(args: &Query, why: String) -> InputError {
    let source = Source::inline("rig", args.rig.as_deref().unwrap_or_default());
    let tree = DeTable::parse(&source.text).map(|tree| tree.into_inner()).unwrap_or_default();
    let span = tree.values().find_map(|table| match table.get_ref() {
        DeValue::Table(table) => table.get("bounds").map(|bounds| bounds.span()),
        _ => None,
    });
    source.error(span.unwrap_or(0..0), why)
}

/// How points are read of a volume.
struct Reader<'a> {
    args: &'a Query,
    around: Surroundings<'a>,
    arithmetic: Arithmetic,
    bench: Option<GpuBench>,
    mesh: Option<crate::scene::Mesh>,
    before: Vec<OrientedBox>,
    object: usize,
    frames: usize,
}

impl<'a> Reader<'a> {
    #[allow(clippy::too_many_arguments, reason = "what a query knows")]
    fn new(
        args: &'a Query,
        lighting: &Lighting<'a>,
        scene: &Scene,
        volume: &Volume,
        receiver: Option<&Receiver>,
        bounds: OrientedBox,
        arithmetic: Arithmetic,
        bench: Option<GpuBench>,
    ) -> Result<Self, Failure> {
        let own = |receiver: &Receiver| receiver.oriented_box(args.frame);
        if receiver.is_none() && volume.lookup != Lookup::PerPoint {
            let names: Vec<&str> = scene.receivers.iter().map(|r| r.name.as_str()).collect();
            return Err(Failure::usage(format!(
                "an object reads this volume; choose one with --receiver: {}",
                names.join(", ")
            )));
        }
        let with_mesh = scene.receivers.iter().filter(|r| r.mesh.is_some());
        let object = receiver.and_then(|own| with_mesh.into_iter().position(|r| r.name == own.name));
        if volume.is_path() && object.is_none() {
            return Err(Failure::usage("a path is that of an object with a surface; choose one with --receiver"));
        }
        Ok(Self {
            args,
            around: Surroundings {
                bounds: receiver.map_or(bounds, own),
                lights: lighting.lights,
                wrap: args.wrap,
                transport: None,
            },
            arithmetic,
            bench,
            mesh: receiver.and_then(|receiver| receiver.world_mesh(args.frame)),
            before: receiver.map_or_else(Vec::new, |r| (0..args.frame).map(|frame| r.oriented_box(frame)).collect()),
            object: object.unwrap_or(0),
            frames: scene.frames,
        })
    }

    fn read(&self, baked: &Arc<BakedVolume>, points: &[SurfacePoint]) -> Result<Values, Failure> {
        let reading = Reading {
            mesh: self.mesh.as_ref(),
            before: &self.before,
            object: self.object,
            frames: self.frames,
            ..Reading::default()
        };
        let (arithmetic, bench) = (self.arithmetic, self.bench.as_ref());
        if self.args.quantity == Quantity::Irradiance {
            let lit = prepare_volume(baked, arithmetic, &self.around, reading, bench).map_err(failed)?;
            return Ok(Values::Irradiance { value: lit.irradiance(points).map_err(failed)?, error: Vec::new() });
        }
        let lit = prepare_radiance(baked, arithmetic, &self.around, reading, bench).map_err(failed)?;
        let share = STEPS[usize::from(arithmetic != Arithmetic::CpuF64)];
        let step = (self.args.quantity == Quantity::ShGradient).then(|| share * smallest_edge(baked));
        let value = rows(step, points, |places| {
            coefficients_at(baked.values.order, places, |points| lit.irradiance(points).map_err(failed))
        })?;
        Ok(Values::Sh { value, error: Vec::new() })
    }
}

/// Metres.
fn smallest_edge(baked: &BakedVolume) -> f64 {
    let edges = match &baked.layout {
        Layout::Cells(cells) => {
            let size = cells.cells.iter().map(|cell| cell.size).min().unwrap_or(1);
            cells.unit().map(|unit| unit * f64::from(size))
        }
        Layout::Grid(samples) => {
            std::array::from_fn(|axis| 2.0 * baked.bounds.half[axis] / samples[axis].saturating_sub(1).max(1) as f64)
        }
        Layout::Path(_) => baked.bounds.half,
    };
    edges.into_iter().fold(f64::INFINITY, f64::min)
}

fn failed(error: CandidateError) -> Failure {
    match error {
        CandidateError::NoGpuVolume(_) => Failure::usage(format!("{error}; ask for --backend cpu")),
        other => Failure::internal(other),
    }
}
