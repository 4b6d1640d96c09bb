use super::{GradientSource, SampleRequest, Sampled, sample_lights, sample_traced};
use crate::light::Light;
use crate::scene::OrientedBox;
use crate::sh::Window;
use crate::trace::{Counters, Effort, Transport};

/// Where probe samples come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Probes {
    /// The closed form of each light, nothing blocks.
    Analytic,
    /// Rays through the static environment, taken ahead of time.
    Traced { effort: Effort, seed: u64 },
}

/// Takes probe samples in a box.
#[derive(Clone, Copy)]
pub struct Prober<'a> {
    pub bounds: OrientedBox,
    pub order: usize,
    /// World coordinates.
    pub lights: &'a [Light<f64>],
    /// The static environment under these lights.
    pub transport: Option<&'a Transport<'a>>,
    pub probes: Probes,
    pub gradients: GradientSource,
    pub window: Window,
}

impl Prober<'_> {
    /// The samples that are asked for. Without a static environment every source is analytic: nothing blocks.
    pub fn take(&self, requests: &[SampleRequest]) -> (Sampled<f64>, Counters) {
        match (self.probes, self.transport) {
            (Probes::Traced { effort, seed }, Some(transport)) => {
                sample_traced(transport, &self.bounds, requests, self.order, seed, effort)
            }
            _ => {
                let lights: Vec<Light<f64>> =
                    self.lights.iter().map(|light| light.relative_to(self.bounds.center)).collect();
                let sampled = sample_lights(&lights, &self.bounds, requests, self.order, self.gradients, self.window);
                (sampled, Counters::default())
            }
        }
    }
}
