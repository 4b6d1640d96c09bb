use glam::DVec3;

use super::{CaptureTask, ProbeDevice, SampleRequest, Sampled, texels};
use crate::math::{Rgb, StreamPurpose};
use crate::scene::OrientedBox;
use crate::sh::{ShVectors, coefficients};
use crate::trace::{Capture, CapturePlace, Counters, Projected, Reflected, Seed, Transport};

/// Samples from cube maps with `face` texels along an edge, derivatives from the depth and normal of what each texel sees.
/// `numbers_of` are the places whose random numbers each request uses, in box coordinates. The random streams are the probes' own.
#[allow(clippy::too_many_arguments, reason = "a request and how to answer it")]
pub fn sample_captured(
    transport: &Transport,
    bounds: &OrientedBox,
    requests: &[SampleRequest],
    numbers_of: &[[f64; 3]],
    order: usize,
    face: usize,
    reflected: Reflected,
    seed: u64,
) -> (Sampled<f64>, Counters) {
    let texels: Vec<(DVec3, f64)> = texels(face).iter().map(|texel| (texel.direction, texel.solid_angle)).collect();
    let seed = Seed { seed, purpose: StreamPurpose::Probe };
    let places = places_of(bounds, requests, numbers_of);
    sampled(bounds, requests, order, &transport.capture(&places, &texels, order, asks(requests), reflected, seed))
}

/// The same from cube maps that a device takes.
pub fn sample_captured_on(
    device: &dyn ProbeDevice,
    bounds: &OrientedBox,
    requests: &[SampleRequest],
    numbers_of: &[[f64; 3]],
    order: usize,
    face: u32,
    paths: u32,
) -> Result<(Sampled<f64>, Counters), String> {
    let task = CaptureTask { face, paths, order, gradient: asks(requests) };
    Ok(sampled(bounds, requests, order, &device.capture(&places_of(bounds, requests, numbers_of), task)?))
}

fn asks(requests: &[SampleRequest]) -> bool {
    requests.iter().any(|request| request.derivatives.contains(&true))
}

fn places_of(bounds: &OrientedBox, requests: &[SampleRequest], numbers_of: &[[f64; 3]]) -> Vec<CapturePlace> {
    requests
        .iter()
        .zip(numbers_of)
        .map(|(request, own)| CapturePlace { position: bounds.world(request.position), numbers_of: bounds.world(*own) })
        .collect()
}

fn sampled(
    bounds: &OrientedBox,
    requests: &[SampleRequest],
    order: usize,
    captures: &[Capture],
) -> (Sampled<f64>, Counters) {
    let mut vectors = ShVectors { order, data: Vec::new() };
    for (request, capture) in requests.iter().zip(captures) {
        push_projected(&mut vectors, &capture.projected, request, bounds);
    }
    let sampled = Sampled {
        vectors,
        projections: requests.len() as u64,
        singular: captures.iter().map(|c| u64::from(c.singular)).sum(),
    };
    (sampled, captures.iter().map(|c| c.counters).sum())
}

/// A value and the derivatives that were asked for, along the box's axes.
fn push_projected(vectors: &mut ShVectors<f64>, projected: &Projected, request: &SampleRequest, bounds: &OrientedBox) {
    let mut push = |vector: &[Rgb<f64>]| vectors.data.extend(vector.iter().flat_map(|v| v.to_array()));
    push(&projected.value);
    for axis in (0..3).filter(|a| request.derivatives[*a]) {
        let gradient = projected.gradient.as_ref().expect("a gradient was asked for");
        let along = bounds.axes[axis];
        let slope: Vec<Rgb<f64>> = (0..coefficients(vectors.order))
            .map(|i| gradient[0][i] * along.x + gradient[1][i] * along.y + gradient[2][i] * along.z)
            .collect();
        push(&slope);
    }
}
