use std::time::Duration;

use super::pass::{BoundPass, Grid, Parameters, PointPass};
use super::{Gpu, GpuError, Sample, ShaderText, Timing};
use crate::light::{Light, LightRows, Sphere, lights_wgsl, sphere_projection_wgsl};
use crate::math::Vector3;
use crate::rig::LocalPoints;
use crate::sh::{Lobe, ShVectors, coefficients};

/// Sphere lights projected at samples on the GPU, values and derivatives along x, y and z: what setting up a rig with gradients takes.
#[derive(Clone, Debug)]
pub struct SphereProjector {
    gpu: Gpu,
    pass: PointPass,
    order: usize,
}

impl SphereProjector {
    pub fn new(gpu: &Gpu, order: usize) -> Result<Self, GpuError> {
        Self::with_model(gpu, order, &sphere_projection_wgsl())
    }

    /// With another model than [`sphere_projection_wgsl`]: for tests that break it.
    pub fn with_model(gpu: &Gpu, order: usize, model: &str) -> Result<Self, GpuError> {
        let numbers = 4 * coefficients(order) as u32;
        let rows = 3 * numbers / 4;
        // lights at a time: workgroup memory is 16 KiB everywhere
        let lights: u32 = if order > 5 { 16 } else { 32 };
        let text = ShaderText::new()
            .with_points()
            .with_basis(order)
            .with_basis_gradient()
            .with(&lights_wgsl(&["sphere"], &Lobe::lambert()))
            .with(model)
            .with_count("LIGHTS", lights)
            .with_count("NUMBERS", numbers)
            .with_count("UNIT_NUMBERS", numbers * lights)
            .with_count("ROWS", rows)
            .with_count("ROWS_A_THREAD", rows.div_ceil(lights))
            .with(include_str!("passes/project_spheres.wgsl"));
        let grid = Grid { points_a_group: 1, rows_a_point: rows };
        let pass = PointPass::new(gpu, "project_spheres", text, Parameters::Buffer, grid)?;
        Ok(Self { gpu: gpu.clone(), pass, order })
    }

    /// What compiling the pipeline took.
    pub fn once(&self) -> Duration {
        self.pass.once
    }

    /// Four vectors a sample: the sum of the projections at its place, then the sums of the derivatives along x, y and z.
    pub fn project(&self, lights: &[Sphere<f32>], places: &[Vector3<f32>]) -> Result<ShVectors<f32>, GpuError> {
        self.prepare(lights, places)?.project()
    }

    /// Lights and places uploaded and bound, for timing.
    pub fn prepare(&self, lights: &[Sphere<f32>], places: &[Vector3<f32>]) -> Result<PreparedProjection, GpuError> {
        let lights: Vec<Light<f32>> = lights.iter().cloned().map(Light::Sphere).collect();
        let mut rows = LightRows::new(&lights).expect("spheres have a twin").rows;
        if rows.is_empty() {
            // the header of no lights
            rows.push([1.0, 1.0, 0.0, 0.0]);
        }
        let mut points = LocalPoints::default();
        places.iter().for_each(|place| points.push(place.to_double(), glam::DVec3::ZERO));
        let buffer = self
            .gpu
            .checked("uploading lights", || self.gpu.storage("the buffer of lights", bytemuck::cast_slice(&rows)))?;
        let bound = self.pass.bind(&points, points.len(), &[buffer.as_entire_binding()])?;
        Ok(PreparedProjection { bound, order: self.order })
    }
}

/// A projection with everything on the device.
#[derive(Debug)]
pub struct PreparedProjection {
    bound: BoundPass,
    order: usize,
}

impl PreparedProjection {
    pub fn project(&mut self) -> Result<ShVectors<f32>, GpuError> {
        self.bound.run()?;
        let data = self.bound.result()?;
        Ok(ShVectors { order: self.order, data: data.into_iter().flatten().collect() })
    }

    /// One timed projection of all lights at all places.
    pub fn sample(&mut self) -> Result<Sample, GpuError> {
        self.bound.sample()
    }

    /// `warmup` untimed runs, then `repeat` samples: nanoseconds a place, all lights together.
    pub fn time(&mut self, warmup: usize, repeat: usize) -> Result<Timing, GpuError> {
        for _ in 0..warmup.max(1) {
            self.bound.run()?;
        }
        let samples = (0..repeat).map(|_| self.sample()).collect::<Result<Vec<_>, _>>()?;
        Timing::of(&samples, self.bound.count())
    }
}
