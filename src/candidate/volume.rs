//! A volume read by a receiver.

use std::sync::Arc;

use glam::DVec3;

use super::local_points;
use super::prepared::{
    CandidateError, Counts, CpuTimes, GpuBench, Lit, Pipeline, Surroundings, Timed, TimedGpu, rounds,
};
use crate::cost::{Samples, seconds_of};
use crate::gpu::{Evaluator, PreparedEvaluation};
use crate::math::{Real, Rgb, Vector3};
use crate::rig::{AnyRig, Gradient, Lane, LocalPoints, Model, Packed, Rig, RigModel, ShVectors, TableModel, TableTaps};
use crate::scene::{Mesh, OrientedBox, SurfacePoint};
use crate::sh::{MAX_ORDER, coefficients};
use crate::volume::{BakedVolume, CellShader, Lookup, VolumeModel};
use crate::with_order;

/// What of a moving receiver a volume's lookup may need.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reading<'a> {
    /// World coordinates.
    pub mesh: Option<&'a Mesh>,
    /// Its boxes in the frames before this one, from the first on.
    pub before: &'a [OrientedBox],
    /// The volumes of those frames, where each has its own.
    pub volumes_before: &'a [Arc<BakedVolume>],
    /// Its place among the scene's objects.
    pub object: usize,
    /// Frames of the animation.
    pub frames: usize,
    /// The volume is baked again every frame: a part of each frame's set-up.
    pub baked_every_frame: bool,
}

/// What a receiver makes of a volume in a frame.
#[derive(Clone, Debug)]
pub(super) enum Read<T: Real> {
    /// The volume itself, at every point.
    PerPoint { model: VolumeModel<T>, vectors: Packed<T> },
    /// Vectors at the vertices.
    PerVertex(VertexLight<T>),
    /// One vector with its gradient over the receiver's box.
    PerObject { model: Model<T>, vectors: Packed<T> },
}

/// A volume on the CPU.
pub(super) struct CpuVolume<T: Real> {
    baked: Arc<BakedVolume>,
    bounds: OrientedBox,
    bands: [T; MAX_ORDER],
    way: Way,
    mesh: Option<Mesh>,
    baked_every_frame: bool,
    read: Read<T>,
}

impl<T: Real> CpuVolume<T> {
    /// `bands`: factors of the SH bands, those of the receiver's lobe.
    pub fn new(baked: Arc<BakedVolume>, bounds: OrientedBox, bands: [T; MAX_ORDER], reading: Reading) -> Self {
        let way = Way::new(&reading, bounds);
        let mesh = reading.mesh.filter(|_| baked.volume.lookup == Lookup::PerVertex).cloned();
        let read = read(&baked, &way, way.first(&baked), mesh.as_ref(), &bands);
        Self { baked, bounds, bands, way, mesh, baked_every_frame: reading.baked_every_frame, read }
    }

    fn local(&self, points: &[SurfacePoint]) -> LocalPoints<T> {
        match &self.read {
            Read::PerPoint { .. } => local_points(&self.baked.bounds, points),
            Read::PerObject { .. } => local_points(&self.bounds, points),
            Read::PerVertex(light) => light.local(points),
        }
    }
}

/// A receiver in the frames up to one.
struct Way {
    object: usize,
    /// Its boxes, the frame's own last.
    boxes: Vec<OrientedBox>,
    /// The volumes of the frames before, where each has its own.
    volumes: Vec<Arc<BakedVolume>>,
    /// The number of the animation's last frame.
    end: f64,
}

impl Way {
    fn new(reading: &Reading, bounds: OrientedBox) -> Self {
        Self {
            object: reading.object,
            boxes: reading.before.iter().copied().chain([bounds]).collect(),
            volumes: reading.volumes_before.to_vec(),
            end: reading.frames.saturating_sub(1).max(1) as f64,
        }
    }

    /// The first frame that counts: where all of the way is gone each frame, the last alone.
    fn first(&self, baked: &BakedVolume) -> usize {
        if baked.volume.smoothing < 1.0 { 0 } else { self.last() }
    }

    fn last(&self) -> usize {
        self.boxes.len() - 1
    }
}

/// Radiance vectors at the centre of a receiver's box: value, then its derivatives along the receiver's axes; smoothed over the frames
/// from `first` on, each read in its own volume and at its own time.
fn object_vectors(baked: &BakedVolume, way: &Way, first: usize) -> ShVectors<f64> {
    let read = |frame: usize| -> Vec<f64> {
        let baked = way.volumes.get(frame).map_or(baked, |own| own);
        let bounds = &way.boxes[frame];
        let [value, x, y, z] = match baked.volume.is_path() {
            true => baked.along_path(way.object, frame as f64 / way.end),
            false => baked.value_and_slopes(baked.bounds.local(bounds.center).to_array()),
        };
        // from the volume's axes to the receiver's
        let turned = bounds.axes.iter().flat_map(|axis| {
            let [a, b, c] = baked.bounds.axes.map(|own| own.dot(*axis));
            (0..value.len()).map(|k| x[k] * a + y[k] * b + z[k] * c).collect::<Vec<_>>()
        });
        value.iter().copied().chain(turned).collect()
    };
    let smoothing = baked.volume.smoothing;
    let mut state = read(first);
    for frame in first + 1..=way.last() {
        state.iter_mut().zip(read(frame)).for_each(|(s, r)| *s += smoothing * (r - *s));
    }
    ShVectors { order: baked.values.order, data: state }
}

/// Radiance vectors at an object's centre, step after step through all of its animation: by time where the volume is read by time, else
/// at `places`; smoothed where objects read it so, a step being a frame. `volumes`: one for all of the animation, or where lights move
/// one a frame; between two frames the light goes evenly from one's to the other's, as it would in a film of many more frames.
pub fn along_path(volumes: &[Arc<BakedVolume>], places: &[DVec3], object: usize) -> Vec<Vec<f64>> {
    let last_step = places.len().saturating_sub(1).max(1) as f64;
    let last_frame = volumes.len().saturating_sub(1) as f64;
    let mut seen: Vec<Vec<f64>> = vec![Vec::new(); places.len()];
    for (frame, baked) in volumes.iter().enumerate() {
        let reader = (!baked.volume.is_path()).then(|| (baked.model::<f64>(), baked.vectors()));
        for (k, (place, sum)) in places.iter().zip(&mut seen).enumerate() {
            let time = k as f64 / last_step;
            let share = 1.0 - (time * last_frame - frame as f64).abs();
            if share <= 0.0 {
                continue;
            }
            sum.resize(baked.stride(), 0.0);
            match &reader {
                None => {
                    let [value, ..] = baked.along_path(object, time);
                    sum.iter_mut().zip(value).for_each(|(s, v)| *s += share * v);
                }
                Some((model, vectors)) => {
                    model.taps(Vector3::of(baked.bounds.local(*place)), &mut |vector, weight| {
                        sum.iter_mut().zip(vectors.vector(vector)).for_each(|(s, v)| *s += share * weight * v);
                    });
                }
            }
        }
    }
    let smoothing = volumes.first().map_or(1.0, |baked| baked.volume.smoothing);
    for k in 1..seen.len() {
        let (before, rest) = seen.split_at_mut(k);
        for (now, last) in rest[0].iter_mut().zip(&before[k - 1]) {
            *now = last + smoothing * (*now - last);
        }
    }
    seen
}

fn read<T: Real>(baked: &BakedVolume, way: &Way, first: usize, mesh: Option<&Mesh>, bands: &[T; MAX_ORDER]) -> Read<T> {
    match (baked.volume.lookup, mesh) {
        (Lookup::PerObject, _) => {
            let half = way.boxes[way.last()].half;
            Read::PerObject {
                model: AnyRig::Gradient(Gradient {}).model(half),
                vectors: Packed::new(object_vectors(baked, way, first).rounded::<T>().convolved(bands)),
            }
        }
        (Lookup::PerVertex, Some(mesh)) => {
            let vectors = baked.vectors().rounded::<T>().convolved(bands);
            Read::PerVertex(VertexLight::new(baked, &vectors, mesh))
        }
        // an object without a surface has no vertices
        (Lookup::PerPoint | Lookup::PerVertex, _) => {
            let vectors = baked.vectors().rounded::<T>().convolved(bands);
            Read::PerPoint { model: baked.model(), vectors: Packed::new(vectors) }
        }
    }
}

impl<T: Real> Read<T> {
    fn irradiance(&self, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        let order = match self {
            Read::PerPoint { vectors, .. } | Read::PerObject { vectors, .. } => vectors.vectors().order,
            Read::PerVertex(light) => light.vectors.vectors().order,
        };
        with_order!(order, C => match self {
            Read::PerPoint { model, vectors } => model.packed_irradiance::<C>(vectors, points, out),
            Read::PerObject { model, vectors } => model.packed_irradiance::<C>(vectors, points, out),
            Read::PerVertex(light) => light.packed_irradiance::<C>(&light.vectors, points, out),
        });
    }
}

/// Vectors at a mesh's vertices, interpolated over its triangles.
#[derive(Clone, Debug)]
pub(super) struct VertexLight<T: Real> {
    vectors: Packed<T>,
    finder: crate::scene::SurfaceFinder,
}

impl<T: Real> VertexLight<T> {
    fn new(baked: &BakedVolume, vectors: &ShVectors<T>, mesh: &Mesh) -> Self {
        let model = baked.model::<T>();
        let stride = vectors.stride();
        let mut data = vec![T::zero(); stride * mesh.positions.len()];
        for (position, sum) in mesh.positions.iter().zip(data.chunks_exact_mut(stride)) {
            model.taps(Vector3::of(baked.bounds.local(*position)), &mut |vector, weight| {
                sum.iter_mut().zip(vectors.vector(vector)).for_each(|(s, v)| *s += weight * *v);
            });
        }
        let vectors = Packed::new(ShVectors { order: vectors.order, data });
        Self { vectors, finder: crate::scene::SurfaceFinder::new(mesh) }
    }

    /// A row a triangle: its vertices.
    fn triangles(&self) -> Vec<[f32; 4]> {
        let row = |index: usize| {
            let [a, b, c] = self.finder.triangle(index);
            [a as f32, b as f32, c as f32, 0.0]
        };
        (0..self.finder.len()).map(row).collect()
    }

    /// The triangle's place in the list and two barycentric weights stand where coordinates would.
    fn local(&self, points: &[SurfacePoint]) -> LocalPoints<T> {
        let mut local = LocalPoints::default();
        for point in points {
            let (triangle, [u, v]) = self.finder.find(point.position);
            local.push(glam::DVec3::new(triangle as f64, u, v), point.normal);
        }
        local
    }
}

impl<T: Real> TableModel<T> for VertexLight<T> {
    fn table(&self) -> &[u32] {
        self.finder.vertices()
    }

    /// By a triangle's place in the list and two barycentric weights.
    #[inline(always)]
    fn lane_taps<L: Lane<Scalar = T>>(&self, [triangle, u, v]: [L; 3], taps: &mut impl TableTaps<L>) {
        let triangle = triangle.whole(self.finder.len().saturating_sub(1));
        taps.group(L::index_sum(L::index(0), triangle, 3));
        taps.tap(0, 0, L::constant(1.0) - u - v);
        taps.tap(1, 0, u);
        taps.tap(2, 0, v);
    }
}

crate::rig_model_of_table!(VertexLight);

/// What a volume keeps and took.
pub(super) fn volume_counts(baked: &BakedVolume, bytes: u64) -> Counts {
    Counts {
        sh_vectors: Some((baked.values.count() + baked.slopes.as_ref().map_or(0, ShVectors::count)) as u64),
        projections: Some(baked.counts.projections),
        model_bytes: Some(bytes),
        singular: baked.counts.singular,
        rays: baked.counts.rays,
        ..Counts::default()
    }
}

impl<T: Real> Lit for CpuVolume<T> {
    fn irradiance(&self, points: &[SurfacePoint]) -> Result<Vec<Rgb<f64>>, CandidateError> {
        let mut out = vec![Rgb::zero(); points.len()];
        self.read.irradiance(&self.local(points), &mut out);
        Ok(out.iter().map(|e| e.to_double()).collect())
    }

    fn counts(&self) -> Counts {
        let bytes = self.baked.bytes() / 4 * std::mem::size_of::<T>() as u64;
        volume_counts(&self.baked, bytes)
    }

    fn timed<'a>(&'a self, points: &[SurfacePoint], total: usize) -> Result<Box<dyn Timed + 'a>, CandidateError> {
        Ok(Box::new(TimedVolume {
            volume: self,
            read: self.read.clone(),
            points: self.local(points),
            out: vec![Rgb::zero(); points.len()],
            rounds: rounds(points, total),
            times: CpuTimes::default(),
        }))
    }
}

struct TimedVolume<'a, T: Real> {
    volume: &'a CpuVolume<T>,
    read: Read<T>,
    points: LocalPoints<T>,
    out: Vec<Rgb<T>>,
    rounds: usize,
    times: CpuTimes,
}

impl<T: Real> Timed for TimedVolume<'_, T> {
    /// Where it is not baked again, a volume is there already; each frame its object or its vertices read it.
    fn setup(&mut self) -> Result<f64, CandidateError> {
        let volume = self.volume;
        let read = &mut self.read;
        let bake = if volume.baked_every_frame { volume.baked.counts.seconds } else { 0.0 };
        Ok(bake
            + seconds_of(|| {
                if !matches!(read, Read::PerPoint { .. }) {
                    let way = &volume.way;
                    *read = self::read(&volume.baked, way, way.last(), volume.mesh.as_ref(), &volume.bands);
                }
            }))
    }

    fn evaluate(&mut self) -> Result<(), CandidateError> {
        let seconds = seconds_of(|| {
            for _ in 0..self.rounds {
                self.read.irradiance(&self.points, &mut self.out);
                std::hint::black_box(&mut self.out);
            }
        });
        self.times.push(seconds, self.rounds * self.out.len());
        Ok(())
    }

    fn evaluations(&self) -> Result<(Samples, &'static str), CandidateError> {
        Ok((self.times.0.clone(), "monotonic"))
    }

    fn forget(&mut self) {
        self.times.0.0.clear();
    }

    /// The bake.
    fn once(&self) -> Option<f64> {
        (!self.volume.baked_every_frame).then_some(self.volume.baked.counts.seconds)
    }
}

/// How the GPU reads a volume.
enum GpuRead {
    /// A rig's pipeline: a grid is a lattice over the volume's box, what an object reads once a gradient rig over its own.
    Rig { pipeline: Pipeline, vectors: ShVectors<f32>, bounds: OrientedBox },
    /// Cells: the tree stands behind the vectors.
    Cells { evaluator: Evaluator, shader: CellShader, vectors: ShVectors<f32> },
    /// Vectors at vertices: the triangles stand behind them.
    Vertices { evaluator: Evaluator, rows: Vec<[f32; 4]>, light: VertexLight<f32>, mesh: Mesh, samples: ShVectors<f32> },
}

/// The twin of [`VertexLight::irradiance`], where the rows of the triangles stand behind so many of the vectors.
fn vertex_taps(vector_rows: usize) -> String {
    format!("const VERTEX_TRIANGLES = {vector_rows}u;\n{}", include_str!("vertex_taps.wgsl"))
}

/// A volume that the GPU evaluates.
pub(super) struct GpuVolume {
    baked: Arc<BakedVolume>,
    baked_every_frame: bool,
    read: GpuRead,
}

impl GpuVolume {
    pub fn new(
        baked: Arc<BakedVolume>,
        around: &Surroundings,
        reading: Reading,
        bench: &GpuBench,
        texture: bool,
        bands: &[f32; MAX_ORDER],
    ) -> Result<Self, CandidateError> {
        let order = baked.values.order;
        // an object without a surface has no vertices
        let lookup = match (baked.volume.lookup, reading.mesh) {
            (Lookup::PerVertex, None) => Lookup::PerPoint,
            (lookup, _) => lookup,
        };
        let read = match (lookup, baked.lattice()) {
            (Lookup::PerObject, _) => {
                let way = Way::new(&reading, around.bounds);
                let vectors = object_vectors(&baked, &way, way.first(&baked));
                GpuRead::Rig {
                    pipeline: bench.pipeline(&AnyRig::Gradient(Gradient {}), around.bounds.half, order, false)?,
                    vectors: vectors.rounded::<f32>().convolved(bands),
                    bounds: around.bounds,
                }
            }
            (Lookup::PerPoint, Some(lattice)) => GpuRead::Rig {
                pipeline: bench.pipeline(&lattice, baked.bounds.half, order, texture)?,
                vectors: baked.vectors().rounded::<f32>().convolved(bands),
                bounds: baked.bounds,
            },
            (Lookup::PerPoint, None) => {
                let vectors = baked.vectors().rounded::<f32>().convolved(bands);
                let shader = baked
                    .cell_shader(vectors.count() * coefficients(order))
                    .ok_or(CandidateError::NoGpuVolume(baked.volume.key()))?;
                let evaluator = Evaluator::new(&bench.gpu, &shader.wgsl, order)?.with_rows(shader.rows.clone());
                GpuRead::Cells { evaluator, shader, vectors }
            }
            (Lookup::PerVertex, _) => {
                let mesh = reading.mesh.expect("an object without a surface is read at every point");
                let vectors = baked.vectors().rounded::<f32>().convolved(bands);
                let light = VertexLight::new(&baked, &vectors, mesh);
                let rows = light.triangles();
                let wgsl = vertex_taps(light.vectors.vectors().count() * coefficients(order));
                let evaluator = Evaluator::new(&bench.gpu, &wgsl, order)?.with_rows(rows.clone());
                GpuRead::Vertices { evaluator, rows, light, mesh: mesh.clone(), samples: vectors }
            }
        };
        Ok(Self { baked, baked_every_frame: reading.baked_every_frame, read })
    }

    fn prepared(&self, points: &[SurfacePoint], total: usize) -> Result<PreparedEvaluation, CandidateError> {
        Ok(match &self.read {
            GpuRead::Rig { pipeline, vectors, bounds } => {
                pipeline.prepare(vectors, &local_points(bounds, points), total)?
            }
            GpuRead::Cells { evaluator, vectors, .. } => {
                evaluator.prepare(vectors, &local_points(&self.baked.bounds, points), total)?
            }
            GpuRead::Vertices { evaluator, light, .. } => {
                evaluator.prepare(light.vectors.vectors(), &light.local(points), total)?
            }
        })
    }
}

impl Lit for GpuVolume {
    fn irradiance(&self, points: &[SurfacePoint]) -> Result<Vec<Rgb<f64>>, CandidateError> {
        let values = match &self.read {
            GpuRead::Rig { pipeline, vectors, bounds } => pipeline.evaluate(vectors, &local_points(bounds, points))?,
            GpuRead::Cells { .. } | GpuRead::Vertices { .. } => self.prepared(points, points.len())?.evaluate()?,
        };
        Ok(values.iter().map(|e| e.to_double()).collect())
    }

    fn counts(&self) -> Counts {
        let bytes = match &self.read {
            GpuRead::Rig { pipeline, vectors, .. } => pipeline.parameter_bytes(vectors),
            GpuRead::Cells { shader, vectors, .. } => {
                Evaluator::parameter_bytes(vectors) + 16 * shader.rows.len() as u64
            }
            GpuRead::Vertices { rows, light, .. } => {
                Evaluator::parameter_bytes(light.vectors.vectors()) + 16 * rows.len() as u64
            }
        };
        volume_counts(&self.baked, bytes)
    }

    fn timed<'a>(&'a self, points: &[SurfacePoint], total: usize) -> Result<Box<dyn Timed + 'a>, CandidateError> {
        let once = match &self.read {
            GpuRead::Rig { pipeline, .. } => pipeline.once(),
            GpuRead::Cells { evaluator, .. } | GpuRead::Vertices { evaluator, .. } => evaluator.once(),
        };
        let seconds = self.baked.counts.seconds;
        let (bake, first) = if self.baked_every_frame { (seconds, 0.0) } else { (0.0, seconds) };
        let once = once + std::time::Duration::from_secs_f64(first);
        let fit: Box<dyn Fn() + 'a> = match &self.read {
            GpuRead::Vertices { mesh, samples, .. } => {
                Box::new(|| drop(std::hint::black_box(VertexLight::new(&self.baked, samples, mesh))))
            }
            GpuRead::Rig { .. } | GpuRead::Cells { .. } => Box::new(|| ()),
        };
        Ok(Box::new(TimedGpu { fit, bake, prepared: self.prepared(points, total)?, samples: Vec::new(), once }))
    }
}
