use std::time::{Duration, Instant};

use super::pass::{BoundPass, Grid, Parameters, PointPass};
use super::{Gpu, GpuError, Sample, ShaderText, Timing};
use crate::math::Rgb;
use crate::rig::{LocalPoints, Rig, ShVectors};
use crate::sh::coefficients;

/// A rig's evaluation from a buffer of SH vectors, compiled for one order and one box.
#[derive(Clone, Debug)]
pub struct Evaluator {
    gpu: Gpu,
    pass: PointPass,
    order: usize,
    /// Rows behind those of the vectors, for a model that reads them.
    behind: Vec<[f32; 4]>,
}

impl Evaluator {
    /// From a rig's WGSL ([`crate::rig::Rig::wgsl`]), which defines `rig_taps(q)`.
    pub fn new(gpu: &Gpu, model: &str, order: usize) -> Result<Self, GpuError> {
        let text = ShaderText::new()
            .with_points()
            .with_basis(order)
            .with(include_str!("shaders/taps.wgsl"))
            .with_dot(order)
            .with(model)
            .with(include_str!("passes/evaluate.wgsl"));
        Ok(Self {
            gpu: gpu.clone(),
            pass: PointPass::new(gpu, "evaluate", text, Parameters::Buffer, Grid::THREAD_A_POINT)?,
            order,
            behind: Vec::new(),
        })
    }

    /// A rig's evaluation over a box of these half extents.
    pub fn of_rig(gpu: &Gpu, rig: &impl Rig, half: [f64; 3], order: usize) -> Result<Self, GpuError> {
        Ok(Self::new(gpu, &rig.wgsl(half), order)?.with_rows(rig.wgsl_rows(half)))
    }

    /// The same pipeline with these rows behind the vectors: another box, another tree of cells.
    pub fn with_rows(self, behind: Vec<[f32; 4]>) -> Self {
        Self { behind, ..self }
    }

    /// What compiling the pipeline took: part of `once_us`.
    pub fn once(&self) -> Duration {
        self.pass.once
    }

    /// Bytes that these vectors take on the device.
    pub fn parameter_bytes(vectors: &ShVectors<f32>) -> u64 {
        (vectors.count() * coefficients(vectors.order) * 16) as u64
    }

    /// E at every point from irradiance coefficients ([`ShVectors::convolved`]) of this evaluator's order.
    pub fn evaluate(&self, vectors: &ShVectors<f32>, points: &LocalPoints<f32>) -> Result<Vec<Rgb<f32>>, GpuError> {
        self.prepare(vectors, points, points.len())?.evaluate()
    }

    /// Everything uploaded and bound, for timing over `total` points (the given ones repeated).
    pub fn prepare(
        &self,
        vectors: &ShVectors<f32>,
        points: &LocalPoints<f32>,
        total: usize,
    ) -> Result<PreparedEvaluation, GpuError> {
        let whole = [rows(vectors), bytemuck::cast_slice(&self.behind).to_vec()].concat();
        assert_eq!(vectors.order, self.order, "vectors of another order than the evaluator's");
        let buffer =
            self.gpu.checked("uploading SH vectors", || self.gpu.storage("the buffer of SH vectors", &whole))?;
        let bound = self.pass.bind(points, total, &[buffer.as_entire_binding()])?;
        let (gpu, bytes) = (self.gpu.clone(), buffer.size());
        let vectors = vectors.clone();
        let upload = Box::new(move || gpu.queue.write_buffer(&buffer, 0, &rows(&vectors)));
        Ok(PreparedEvaluation { gpu: self.gpu.clone(), bound, upload, parameter_bytes: bytes })
    }
}

/// One row of four floats a coefficient: red, green, blue, unused. A row is one aligned load.
fn rows(vectors: &ShVectors<f32>) -> Vec<u8> {
    let count = vectors.count() * coefficients(vectors.order);
    let mut bytes = Vec::with_capacity(count * 16);
    for channels in vectors.data.chunks_exact(3) {
        bytes.extend_from_slice(bytemuck::cast_slice(&[channels[0], channels[1], channels[2], 0.0]));
    }
    bytes
}

/// An evaluation with everything on the device: run it, time it, time its upload.
pub struct PreparedEvaluation {
    pub(super) gpu: Gpu,
    pub(super) bound: BoundPass,
    /// Brings the parameters to the device again, from what the rig's fit gives.
    pub(super) upload: Box<dyn Fn() + Send>,
    pub(super) parameter_bytes: u64,
}

impl PreparedEvaluation {
    /// Points of one run.
    pub fn points(&self) -> usize {
        self.bound.count()
    }

    /// Bytes that the parameters take on the device.
    pub fn parameter_bytes(&self) -> u64 {
        self.parameter_bytes
    }

    /// Runs once and brings E at every point back.
    pub fn evaluate(&mut self) -> Result<Vec<Rgb<f32>>, GpuError> {
        self.bound.run()?;
        let rows = self.bound.result()?;
        Ok(rows.iter().map(|row| Rgb::new(row[0], row[1], row[2])).collect())
    }

    /// Runs once untimed: the first run of a pipeline is slower, and it learns how large a tile may be.
    pub fn warm_up(&mut self) -> Result<(), GpuError> {
        self.bound.run()
    }

    /// One timed run over all points; interleave those of several candidates. Collect them with [`Timing::of`].
    pub fn sample(&mut self) -> Result<Sample, GpuError> {
        self.bound.sample()
    }

    /// What an engine pays every frame to bring new parameters over: packing, upload, texture build. Wall clock,
    /// less what waiting for an empty queue takes.
    pub fn setup_sample(&self) -> Result<Duration, GpuError> {
        let during = "uploading parameters";
        self.gpu.checked(during, || {
            self.gpu.queue.submit([]);
            let idle = self.gpu.timed_wait(during)?;
            let start = Instant::now();
            (self.upload)();
            self.gpu.queue.submit([]);
            let issued = start.elapsed();
            let waited = self.gpu.timed_wait(during)?;
            Ok(issued + waited.saturating_sub(idle))
        })
    }

    /// `warmup` untimed runs, then `repeat` samples in a row.
    pub fn time(&mut self, warmup: usize, repeat: usize) -> Result<Timing, GpuError> {
        for _ in 0..warmup.max(1) {
            self.warm_up()?;
        }
        let samples = (0..repeat).map(|_| self.sample()).collect::<Result<Vec<_>, _>>()?;
        Timing::of(&samples, self.points())
    }
}
