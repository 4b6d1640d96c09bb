use std::fmt::Write;

use super::{Gpu, GpuError};
use crate::sh::{coefficients, normalisation};

/// Threads a workgroup of the passes over points.
pub(super) const WORKGROUP: u32 = 64;

/// A WGSL module put together from whole files and printed constants. Nothing is replaced inside a file.
#[derive(Clone, Debug, Default)]
pub struct ShaderText {
    text: String,
}

impl ShaderText {
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends a file or a printed function.
    pub fn with(mut self, part: &str) -> Self {
        self.text.push_str(part);
        if !part.ends_with('\n') {
            self.text.push('\n');
        }
        self
    }

    /// `const NAME: u32`.
    pub fn with_count(mut self, name: &str, value: u32) -> Self {
        writeln!(self.text, "const {name}: u32 = {value}u;").unwrap();
        self
    }

    /// `const NAME: f32`, with as many digits as read back to the same value.
    pub fn with_number(mut self, name: &str, value: f32) -> Self {
        assert!(value.is_finite(), "a shader constant is finite, {name} is {value}");
        writeln!(self.text, "const {name}: f32 = {value:?}f;").unwrap();
        self
    }

    /// The SH basis of an order: its constants, then `sh_basis(direction)`, which fills `sh_y`.
    pub fn with_basis(self, order: usize) -> Self {
        let mut part = self.with_count("ORDER", order as u32).with_count("COEFFICIENTS", coefficients(order) as u32);
        for degree in 0..crate::sh::MAX_ORDER {
            for m in 0..=degree {
                part = part.with_number(&format!("SH_N{degree}{m}"), normalisation(degree, m) as f32);
            }
        }
        part.with(include_str!("shaders/sh.wgsl"))
    }

    /// `sh_basis_gradient(direction)` after [`ShaderText::with_basis`]: fills `sh_gradient` too.
    pub fn with_basis_gradient(self) -> Self {
        self.with(include_str!("shaders/sh_gradient.wgsl"))
    }

    /// `sh_dot(first) -> vec3f`: the sum over coefficients of `sh_y[k]` times the row `vectors[first + k]`, in the order of k.
    pub(super) fn with_dot(mut self, order: usize) -> Self {
        self.text.push_str("fn sh_dot(first: u32) -> vec3f {\n    var sum = sh_y[0] * vectors[first].rgb;\n");
        for k in 1..coefficients(order) {
            writeln!(self.text, "    sum += sh_y[{k}] * vectors[first + {k}u].rgb;").unwrap();
        }
        self.with("    return sum;\n}\n")
    }

    /// The points, and where their results go.
    pub(super) fn with_points(self) -> Self {
        self.with_count("WORKGROUP", WORKGROUP).with(include_str!("shaders/points.wgsl"))
    }

    pub fn text(&self) -> &str {
        &self.text
    }

    /// Compiles the module with all of wgpu's checks. They bound every loop, which may keep a compiler from unrolling it:
    /// the sums over coefficients, which every point pays, are therefore printed without a loop.
    pub(super) fn compile(&self, gpu: &Gpu, label: &str) -> Result<wgpu::ShaderModule, GpuError> {
        gpu.checked(&format!("the shader {label}"), || {
            Ok(gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source: wgpu::ShaderSource::Wgsl(self.text.as_str().into()),
            }))
        })
    }
}

/// Storage buffers alone: `read` of them to read, then `written` of them to write.
pub(super) fn storage_layout(gpu: &Gpu, name: &str, read: u32, written: u32) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = (0..read + written).map(|binding| storage_entry(binding, binding < read)).collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(name), entries: &entries })
}

pub(super) fn storage_entry(binding: u32, read_only: bool) -> wgpu::BindGroupLayoutEntry {
    let ty = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    layout_entry(binding, ty)
}

pub(super) fn layout_entry(binding: u32, ty: wgpu::BindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::COMPUTE, ty, count: None }
}

/// The compute pipeline of the entry point `name`.
pub(super) fn pipeline(
    gpu: &Gpu,
    name: &str,
    text: &ShaderText,
    layout: &wgpu::BindGroupLayout,
) -> Result<wgpu::ComputePipeline, GpuError> {
    let module = text.compile(gpu, name)?;
    gpu.checked(&format!("the pipeline {name}"), || {
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(layout)],
            immediate_size: 0,
        });
        Ok(gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: Some(&layout),
            module: &module,
            entry_point: Some(name),
            compilation_options: Default::default(),
            cache: None,
        }))
    })
}
