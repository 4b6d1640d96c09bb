use std::fmt::Write;
use std::time::Duration;

use super::pass::{Grid, Parameters, PointPass};
use super::{Gpu, GpuError, PreparedEvaluation, ShaderText};
use crate::math::Rgb;
use crate::rig::{AnyRig, Interpolation, LocalPoints, ShVectors};
use crate::sh::coefficients;

/// How a volume texture stores numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum VolumeFormat {
    /// 16-bit floats, 11 bits of significance: what engines ship, filtered at full rate everywhere.
    #[serde(rename = "rgba16float")]
    Rgba16Float,
    /// 32-bit floats, filtered only where the adapter can.
    #[serde(rename = "rgba32float")]
    Rgba32Float,
}

impl VolumeFormat {
    /// As in results and in WebGPU.
    pub fn name(self) -> &'static str {
        match self {
            VolumeFormat::Rgba16Float => "rgba16float",
            VolumeFormat::Rgba32Float => "rgba32float",
        }
    }

    fn bytes(self) -> usize {
        match self {
            VolumeFormat::Rgba16Float => 8,
            VolumeFormat::Rgba32Float => 16,
        }
    }
}

/// A trilinear lattice as a volume texture: SH vectors in the lattice's order (x fastest), one a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeShape {
    /// Samples on each axis of the box; at least 1.
    pub counts: [usize; 3],
    /// Half extents of the box, metres.
    pub half: [f64; 3],
    pub order: usize,
    pub format: VolumeFormat,
}

/// Texels by which z stays away from a neighbouring group. More than the rounding of a normalised coordinate (2^-13 texels at the
/// largest size, 2048), less than half a step of 8-bit filter weights (2^-9): it changes no more than the hardware's own rounding.
const GUARD: f32 = 1.0 / 1024.0;

impl VolumeShape {
    /// The volume of a rig over a box of these half extents. `None` for a rig that a filter cannot evaluate: only a trilinear
    /// lattice is.
    pub fn of_rig(rig: &AnyRig, half: [f64; 3], order: usize, format: VolumeFormat) -> Option<Self> {
        match rig {
            AnyRig::Lattice(lattice) if matches!(lattice.interpolation, Interpolation::Trilinear(_)) => {
                Some(Self { counts: lattice.counts(half), half, order, format })
            }
            _ => None,
        }
    }

    /// Texels of four numbers that an SH vector takes.
    pub fn groups(&self) -> usize {
        (3 * coefficients(self.order)).div_ceil(4)
    }

    /// Texels of the texture on each axis.
    pub fn size(&self) -> [usize; 3] {
        [self.counts[0], self.counts[1], self.counts[2] * self.groups()]
    }

    pub fn bytes(&self) -> u64 {
        self.size().iter().product::<usize>() as u64 * self.format.bytes() as u64
    }

    /// WGSL that defines `volume_place(q)` and `volume_dot(place)`.
    pub fn wgsl(&self) -> String {
        let vector = |values: [f32; 3]| format!("vec3f({:?}, {:?}, {:?})", values[0], values[1], values[2]);
        let per_spacing = std::array::from_fn(|axis| {
            let intervals = self.counts[axis] - 1;
            if intervals == 0 || self.half[axis] == 0.0 {
                0.0
            } else {
                (intervals as f64 / (2.0 * self.half[axis])) as f32
            }
        });
        let mut text = String::new();
        for (name, values) in [
            ("VOLUME_COUNT", self.counts.map(|n| n as f32)),
            ("VOLUME_SIZE", self.size().map(|n| n as f32)),
            ("VOLUME_HALF", self.half.map(|h| h as f32)),
            ("VOLUME_PER_SPACING", per_spacing),
        ] {
            writeln!(text, "const {name} = {};", vector(values)).unwrap();
        }
        writeln!(text, "const VOLUME_GUARD: f32 = {GUARD:?}f;").unwrap();
        text.push_str(include_str!("shaders/volume.wgsl"));
        // number 3 k + channel of a vector is component (3 k + channel) % 4 of group (3 k + channel) / 4
        text.push_str("fn volume_dot(place: vec3f) -> vec3f {\n    var sum = vec3f(0.0);\n");
        for group in 0..self.groups() {
            writeln!(text, "    let g{group} = volume_group(place, {group}.0);").unwrap();
        }
        for k in 0..coefficients(self.order) {
            let number =
                |channel: usize| format!("g{}.{}", (3 * k + channel) / 4, ["x", "y", "z", "w"][(3 * k + channel) % 4]);
            writeln!(text, "    sum += sh_y[{k}] * vec3f({}, {}, {});", number(0), number(1), number(2)).unwrap();
        }
        text.push_str("    return sum;\n}\n");
        text
    }

    /// The texels of vectors divided by a power of two that brings them under 1, and that power: 16-bit floats then neither
    /// overflow nor lose large parts of small lights.
    fn texels(&self, vectors: &ShVectors<f32>) -> (Vec<u8>, f32) {
        let largest = vectors.data.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        let exponent =
            if largest > 0.0 && largest.is_finite() { largest.log2().ceil().clamp(-126.0, 127.0) } else { 0.0 };
        let scale = exponent.exp2();
        let stride = 3 * coefficients(self.order);
        let mut bytes = Vec::with_capacity(self.bytes() as usize);
        for group in 0..self.groups() {
            for vector in vectors.data.chunks_exact(stride) {
                for number in 4 * group..4 * group + 4 {
                    let value = vector.get(number).map_or(0.0, |v| v / scale);
                    match self.format {
                        VolumeFormat::Rgba16Float => bytes.extend(half::f16::from_f32(value).to_le_bytes()),
                        VolumeFormat::Rgba32Float => bytes.extend(value.to_le_bytes()),
                    }
                }
            }
        }
        (bytes, scale)
    }
}

/// A lattice's evaluation from a hardware-filtered volume texture, compiled for one shape.
#[derive(Clone, Debug)]
pub struct VolumeEvaluator {
    gpu: Gpu,
    pass: PointPass,
    shape: VolumeShape,
    sampler: wgpu::Sampler,
}

impl VolumeEvaluator {
    pub fn new(gpu: &Gpu, shape: VolumeShape) -> Result<Self, GpuError> {
        Self::with_model(gpu, shape, &shape.wgsl())
    }

    /// With another model than [`VolumeShape::wgsl`]: for tests that break it.
    pub fn with_model(gpu: &Gpu, shape: VolumeShape, model: &str) -> Result<Self, GpuError> {
        assert!(shape.counts.iter().all(|n| *n > 0), "a lattice has a sample on every axis, got {:?}", shape.counts);
        if shape.format == VolumeFormat::Rgba32Float && !gpu.adapter().features.float32_filterable {
            return Err(GpuError::Refused {
                during: "a volume texture".to_owned(),
                reason: "this adapter does not filter rgba32float; use rgba16float".to_owned(),
            });
        }
        let limit = u64::from(gpu.device.limits().max_texture_dimension_3d);
        let needed = shape.size().into_iter().max().unwrap_or(0) as u64;
        if needed > limit {
            return Err(GpuError::TooLarge { what: "a side of the volume texture, in texels,", needed, limit });
        }
        let text = ShaderText::new()
            .with_points()
            .with_basis(shape.order)
            .with(model)
            .with(include_str!("passes/evaluate_volume.wgsl"));
        let pass = PointPass::new(gpu, "evaluate_volume", text, Parameters::Volume, Grid::THREAD_A_POINT)?;
        let sampler = gpu.checked("the sampler of volumes", || {
            Ok(gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("volume"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }))
        })?;
        Ok(Self { gpu: gpu.clone(), pass, shape, sampler })
    }

    /// What compiling the pipeline took: part of `once_us`.
    pub fn once(&self) -> Duration {
        self.pass.once
    }

    pub fn shape(&self) -> &VolumeShape {
        &self.shape
    }

    /// E at every point from irradiance coefficients, one vector a sample.
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
        let shape = self.shape;
        assert_eq!(vectors.order, shape.order, "vectors of another order than the evaluator's");
        assert_eq!(vectors.count(), shape.counts.iter().product::<usize>(), "one vector a sample");
        let (upload, bound) = self.gpu.checked("the volume texture", || {
            let texture = self.gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("volume"),
                size: extent(shape.size()),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D3,
                format: match shape.format {
                    VolumeFormat::Rgba16Float => wgpu::TextureFormat::Rgba16Float,
                    VolumeFormat::Rgba32Float => wgpu::TextureFormat::Rgba32Float,
                },
                usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            });
            let scale = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("volume scale"),
                size: 16,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let view = texture.create_view(&Default::default());
            let resources = [
                wgpu::BindingResource::TextureView(&view),
                wgpu::BindingResource::Sampler(&self.sampler),
                scale.as_entire_binding(),
            ];
            let bound = self.pass.bind(points, total, &resources)?;
            let (queue, vectors) = (self.gpu.queue.clone(), vectors.clone());
            let upload = move || {
                let (texels, largest) = shape.texels(&vectors);
                let [width, height, _] = shape.size();
                let layout = wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some((width * shape.format.bytes()) as u32),
                    rows_per_image: Some(height as u32),
                };
                queue.write_texture(texture.as_image_copy(), &texels, layout, extent(shape.size()));
                queue.write_buffer(&scale, 0, bytemuck::cast_slice(&[largest, 0.0, 0.0, 0.0]));
            };
            upload();
            Ok((upload, bound))
        })?;
        let parameter_bytes = shape.bytes();
        Ok(PreparedEvaluation { gpu: self.gpu.clone(), bound, upload: Box::new(upload), parameter_bytes })
    }
}

fn extent([width, height, depth]: [usize; 3]) -> wgpu::Extent3d {
    wgpu::Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: depth as u32 }
}
