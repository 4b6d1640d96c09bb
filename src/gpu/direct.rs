use std::time::Duration;

use super::pass::{Grid, Parameters, PointPass};
use super::{Gpu, GpuError, PreparedEvaluation, ShaderText};
use crate::light::{LightRows, ShaderLight, lights_wgsl, model_kinds, shader_kinds};
use crate::math::Rgb;
use crate::rig::LocalPoints;
use crate::sh::Lobe;

/// `direct`: no rig, every light at every point, compiled for the kinds of lights that occur and for one lobe.
#[derive(Clone, Debug)]
pub struct DirectEvaluator {
    gpu: Gpu,
    pass: PointPass,
    kinds: Vec<&'static str>,
}

impl DirectEvaluator {
    /// For the kinds that occur among `lights`.
    pub fn new(gpu: &Gpu, lights: &[impl ShaderLight], lobe: &Lobe<f32>) -> Result<Self, GpuError> {
        Self::with_model(gpu, lights, &Self::model(lights, lobe)?)
    }

    /// The WGSL of the lights: equal texts are equal pipelines.
    pub fn model(lights: &[impl ShaderLight], lobe: &Lobe<f32>) -> Result<String, GpuError> {
        let kinds = rows(lights)?.kinds;
        match kinds.iter().find(|kind| !shader_kinds(lobe).chain(model_kinds(lobe)).any(|known| known == **kind)) {
            Some(kind) => Err(no_twin(kind, " for the wrap lobe")),
            None => Ok(lights_wgsl(&kinds, lobe)),
        }
    }

    /// From a text of [`DirectEvaluator::model`] for lights of the same kinds.
    pub fn with_model(gpu: &Gpu, lights: &[impl ShaderLight], model: &str) -> Result<Self, GpuError> {
        let kinds = rows(lights)?.kinds;
        let text = ShaderText::new().with_points().with(model).with(include_str!("passes/direct.wgsl"));
        Ok(Self {
            gpu: gpu.clone(),
            pass: PointPass::new(gpu, "direct", text, Parameters::Buffer, Grid::THREAD_A_POINT)?,
            kinds,
        })
    }

    /// What compiling the pipeline took: part of `once_us`.
    pub fn once(&self) -> Duration {
        self.pass.once
    }

    /// E at every point. Lights and points are about one origin: the points' `q` are positions here, in the axes of the lights.
    pub fn evaluate(
        &self,
        lights: &[impl ShaderLight + Clone + Send + 'static],
        points: &LocalPoints<f32>,
    ) -> Result<Vec<Rgb<f32>>, GpuError> {
        self.prepare(lights, points, points.len())?.evaluate()
    }

    /// Everything uploaded and bound, for timing over `total` points (the given ones repeated).
    pub fn prepare(
        &self,
        lights: &[impl ShaderLight + Clone + Send + 'static],
        points: &LocalPoints<f32>,
        total: usize,
    ) -> Result<PreparedEvaluation, GpuError> {
        let packed = rows(lights)?;
        assert_eq!(packed.kinds, self.kinds, "lights of other kinds than the evaluator's");
        let buffer = self.gpu.checked("uploading lights", || {
            self.gpu.storage("the buffer of lights", bytemuck::cast_slice(&packed.rows))
        })?;
        let bound = self.pass.bind(points, total, &[buffer.as_entire_binding()])?;
        let (queue, lights) = (self.gpu.queue.clone(), lights.to_vec());
        let parameter_bytes = std::mem::size_of_val(&packed.rows[..]) as u64;
        let upload = Box::new(move || {
            if let Ok(packed) = LightRows::new(&lights) {
                queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&packed.rows));
            }
        });
        Ok(PreparedEvaluation { gpu: self.gpu.clone(), bound, upload, parameter_bytes })
    }
}

fn rows(lights: &[impl ShaderLight]) -> Result<LightRows, GpuError> {
    LightRows::new(lights).map_err(|kind| no_twin(kind, ""))
}

fn no_twin(kind: &str, of_what: &str) -> GpuError {
    GpuError::Refused {
        during: "direct lights".to_owned(),
        reason: format!("the shape `{kind}` has no WGSL twin{of_what}"),
    }
}
