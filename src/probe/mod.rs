//! Probe samples: the incident lighting at the places a rig asks for, as SH radiance coefficients with the derivatives asked for.

mod analytic;
mod captured;
mod cube;
mod device;
mod gradient_source;
mod prober;
mod traced;

pub use crate::trace::Depths;
pub use analytic::sample_lights;
pub use captured::{sample_captured, sample_captured_on};
pub use cube::{FACES, Texel, depths, texels};
pub use device::{CaptureTask, ProbeDevice, TraceTask};
pub use gradient_source::GradientSource;
pub use prober::{Prober, Probes};
pub use traced::{sample_traced, sample_traced_on};

use crate::sh::ShVectors;

/// A place where a rig wants a probe sample, with the derivatives that it asks for along the box's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleRequest {
    /// Box coordinates, metres from the centre.
    pub position: [f64; 3],
    /// Which of the box's axes it wants the derivative along.
    pub derivatives: [bool; 3],
}

impl SampleRequest {
    pub fn value_at(position: [f64; 3]) -> Self {
        Self { position, derivatives: [false; 3] }
    }
    /// SH vectors that this sample yields: its value, then its derivatives in the order of the axes.
    pub fn vectors(&self) -> usize {
        1 + self.derivatives.iter().filter(|d| **d).count()
    }
}

/// What sampling gave: the vectors in the order of the requests (value, then its derivatives) and what it took.
#[derive(Clone, Debug)]
pub struct Sampled<T> {
    /// Radiance coefficients; derivatives per metre along the box's axes.
    pub vectors: ShVectors<T>,
    /// Projections of one light at one place, those of central differences too.
    pub projections: u64,
    /// Terms dropped because a place is singular for a light.
    pub singular: u64,
}
