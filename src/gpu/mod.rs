//! The rigs on the GPU: a headless device, shaders put together from the rigs' WGSL twins, evaluation at given points, timing.
//!
//! wgpu is used here and nowhere else. A WGSL function lies beside its Rust twin (rigs, lights) or in `shaders/` (the SH basis,
//! the sum over taps); entry points lie in `passes/`. [`ShaderText`] puts whole files and printed constants one after the other.
//! What the device reports is the error of the piece of work that caused it; nothing here panics for want of a driver.
//!
//! A software adapter gives the same answers within rounding; its timings are no GPU timings, and its label says so.

mod capture;
mod device;
mod direct;
mod evaluate;
mod expression;
mod pass;
mod points;
mod project;
mod shader;
mod timing;
mod trace;
mod volume;

pub use capture::{CaptureShaders, CubeCapturer};
pub use device::{AdapterDescription, AdapterKind, Gpu, GpuError, GpuFeatures, GpuLimits, NoGpu};
pub use direct::DirectEvaluator;
pub use evaluate::{Evaluator, PreparedEvaluation};
pub use expression::WgslExpression;
pub use project::{PreparedProjection, SphereProjector};
pub use shader::ShaderText;
pub use timing::{Sample, Timer, Timing};
pub use trace::{ProbeEstimate, ProbeTracer};
pub use volume::{VolumeEvaluator, VolumeFormat, VolumeShape};
