use super::shader::{self, ShaderText};
use super::{Gpu, GpuError};

/// One WGSL expression by itself, over rows of numbers: what the twin tests compare with the Rust function.
///
/// ```text
/// WgslExpression { functions: ShaderText::new().with("fn half(x: f32) -> f32 { return 0.5 * x; }"),
///                  body: "output(0u, half(input(0u)));", inputs: 1, outputs: 1 }
/// ```
/// The body reads `input(k)` or `input_vec3(k)` and writes `output(k, value)` or `output_vec3(k, value)`.
#[derive(Clone, Debug)]
pub struct WgslExpression<'a> {
    pub functions: ShaderText,
    pub body: &'a str,
    /// Numbers a row that go in.
    pub inputs: usize,
    /// Numbers a row that come out.
    pub outputs: usize,
}

impl WgslExpression<'_> {
    /// The outputs of every row, row after row.
    pub fn run(&self, gpu: &Gpu, rows: &[f32]) -> Result<Vec<f32>, GpuError> {
        assert_eq!(rows.len() % self.inputs, 0, "whole rows of {} numbers", self.inputs);
        let count = rows.len() / self.inputs;
        let during = "a WGSL expression";
        let text = self
            .functions
            .clone()
            .with_count("INPUTS", self.inputs as u32)
            .with_count("OUTPUTS", self.outputs as u32)
            .with(include_str!("passes/expression.wgsl"))
            .with(&format!("fn expression() {{ {} }}", self.body));
        let layout = gpu.checked(during, || Ok(shader::storage_layout(gpu, during, 1, 1)))?;
        let pipeline = shader::pipeline(gpu, "expression_rows", &text, &layout)?;
        gpu.checked(during, || {
            let inputs = gpu.storage("the rows of an expression", bytemuck::cast_slice(rows))?;
            let bytes = (count * self.outputs * 4) as u64;
            let outputs = gpu.output("the results of an expression", bytes)?;
            let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(during),
                layout: &layout,
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: inputs.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 1, resource: outputs.as_entire_binding() },
                ],
            });
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &bindings, &[]);
            pass.dispatch_workgroups((count as u32).div_ceil(64), 1, 1);
            drop(pass);
            gpu.queue.submit([encoder.finish()]);
            Ok(bytemuck::pod_collect_to_vec(&gpu.read(&outputs, bytes, during)?))
        })
    }
}
