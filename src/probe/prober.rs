use glam::DVec3;

use super::{
    GradientSource, ProbeDevice, SampleRequest, Sampled, sample_captured, sample_captured_on, sample_lights,
    sample_traced, sample_traced_on,
};
use crate::light::Light;
use crate::math::Rgb;
use crate::scene::OrientedBox;
use crate::sh::{ShVectors, Window};
use crate::trace::{Counters, Effects, Effort, Reflected, Transport};

/// Where probe samples come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Probes {
    /// The closed form of each light, nothing blocks.
    Analytic,
    /// Rays through the static environment, taken ahead of time.
    Traced { effort: Effort, seed: u64 },
    /// The same by the prober's device, in f32 and with other random numbers.
    TracedOnGpu { effort: Effort, seed: u64 },
    /// Cube maps of the scene around the sample, `face` texels along an edge, `paths` paths a texel for what surfaces reflect;
    /// rasterised by the prober's device where `on_gpu` says so.
    Captured { face: u32, paths: u32, seed: u64, on_gpu: bool },
    /// Cube maps of a scene that the volume of the iteration before lights (Nijasure et al. 2005); iteration 0 sees lights and emissive
    /// surfaces alone. A rig has no iteration before: it stays there.
    Relit { face: u32, iterations: u32, seed: u64 },
}

impl Probes {
    /// Whether a device takes the samples.
    pub fn on_gpu(&self) -> bool {
        matches!(self, Probes::Captured { on_gpu: true, .. } | Probes::TracedOnGpu { .. })
    }
}

/// Takes probe samples in a box.
#[derive(Clone, Copy)]
pub struct Prober<'a> {
    pub bounds: OrientedBox,
    pub order: usize,
    /// World coordinates.
    pub lights: &'a [Light<f64>],
    /// The static environment under these lights. Where none of its effects is on, samples are analytic, and yet its geometry tells
    /// volumes which cells hold any.
    pub transport: Option<&'a Transport<'a>>,
    /// Takes the samples of [`Probes::on_gpu`], in that environment under those lights.
    pub device: Option<&'a dyn ProbeDevice>,
    pub probes: Probes,
    pub gradients: GradientSource,
    pub window: Window,
}

impl<'a> Prober<'a> {
    /// The static environment, where it blocks light or sends any.
    pub fn sampled(&self) -> Option<&'a Transport<'a>> {
        self.transport.filter(|transport| transport.effects() != Effects::NONE)
    }

    /// The samples that are asked for. Where the static environment does nothing to light, every source is analytic.
    pub fn take(&self, requests: &[SampleRequest]) -> Result<(Sampled<f64>, Counters), String> {
        match (self.probes, self.sampled()) {
            (Probes::Traced { effort, seed }, Some(transport)) => match self.gradients {
                GradientSource::Analytic => {
                    Ok(sample_traced(transport, &self.bounds, requests, self.order, seed, effort))
                }
                GradientSource::Central { step } => differences(requests, step, |places, _| {
                    Ok(sample_traced(transport, &self.bounds, places, self.order, seed, effort))
                }),
            },
            (Probes::TracedOnGpu { effort, .. }, Some(_)) => {
                let device = self.device.ok_or("the rays want a GPU and none was opened")?;
                match self.gradients {
                    GradientSource::Analytic => sample_traced_on(device, &self.bounds, requests, self.order, effort),
                    GradientSource::Central { step } => differences(requests, step, |places, _| {
                        sample_traced_on(device, &self.bounds, places, self.order, effort)
                    }),
                }
            }
            (Probes::Captured { face, paths, seed, on_gpu }, Some(transport)) => {
                let device = match on_gpu {
                    true => Some(self.device.ok_or("the captures want a GPU and none was opened")?),
                    false => None,
                };
                let take = |places: &[SampleRequest], numbers_of: &[[f64; 3]]| match device {
                    Some(device) => {
                        sample_captured_on(device, &self.bounds, places, numbers_of, self.order, face, paths)
                    }
                    None => {
                        let (face, paths) = (face as usize, Reflected::Paths(paths));
                        let bounds = &self.bounds;
                        Ok(sample_captured(transport, bounds, places, numbers_of, self.order, face, paths, seed))
                    }
                };
                match self.gradients {
                    GradientSource::Analytic => {
                        let own: Vec<[f64; 3]> = requests.iter().map(|request| request.position).collect();
                        take(requests, &own)
                    }
                    GradientSource::Central { step } => differences(requests, step, take),
                }
            }
            (Probes::Relit { .. }, Some(_)) => self.take_relit(requests, &|_, _| Rgb::zero()),
            _ => {
                let lights: Vec<Light<f64>> =
                    self.lights.iter().map(|light| light.relative_to(self.bounds.center)).collect();
                let sampled = sample_lights(&lights, &self.bounds, requests, self.order, self.gradients, self.window);
                Ok((sampled, Counters::default()))
            }
        }
    }
}

impl Prober<'_> {
    /// Captures of a scene whose surfaces reflect this irradiance, by place and normal in world coordinates.
    pub fn take_relit(
        &self,
        requests: &[SampleRequest],
        irradiance: &(dyn Fn(DVec3, DVec3) -> Rgb<f64> + Sync),
    ) -> Result<(Sampled<f64>, Counters), String> {
        let (Probes::Relit { face, seed, .. }, Some(transport)) = (self.probes, self.sampled()) else {
            return self.take(requests);
        };
        let own: Vec<[f64; 3]> = requests.iter().map(|request| request.position).collect();
        let from = Reflected::From(irradiance);
        Ok(sample_captured(transport, &self.bounds, requests, &own, self.order, face as usize, from, seed))
    }
}

/// Values where they are asked for and derivatives from two more samples an axis, (l(q + h) - l(q - h)) / 2h. `take` gets places without
/// derivatives and the places whose random numbers they use: the requests' own, so that differences share their noise where a source can.
fn differences(
    requests: &[SampleRequest],
    step: f64,
    take: impl Fn(&[SampleRequest], &[[f64; 3]]) -> Result<(Sampled<f64>, Counters), String>,
) -> Result<(Sampled<f64>, Counters), String> {
    let mut places = Vec::new();
    let mut numbers_of = Vec::new();
    for request in requests {
        let mut add = |position| {
            places.push(SampleRequest::value_at(position));
            numbers_of.push(request.position);
        };
        add(request.position);
        for axis in (0..3).filter(|axis| request.derivatives[*axis]) {
            for side in [step, -step] {
                let mut position = request.position;
                position[axis] += side;
                add(position);
            }
        }
    }
    let (sampled, counters) = take(&places, &numbers_of)?;
    let mut vectors = ShVectors { order: sampled.vectors.order, data: Vec::new() };
    let mut at = 0;
    for request in requests {
        vectors.data.extend_from_slice(sampled.vectors.vector(at));
        at += 1;
        for _ in 1..request.vectors() {
            let (above, below) = (sampled.vectors.vector(at), sampled.vectors.vector(at + 1));
            vectors.data.extend(above.iter().zip(below).map(|(a, b)| (a - b) / (2.0 * step)));
            at += 2;
        }
    }
    Ok((Sampled { vectors, ..sampled }, counters))
}
