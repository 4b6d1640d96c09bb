use super::{ProbeDevice, SampleRequest, Sampled, TraceTask};
use crate::math::{Real, Rgb, StreamPurpose};
use crate::scene::OrientedBox;
use crate::sh::{ShVectors, coefficients};
use crate::trace::{Counters, Effort, Estimate, Projected, Seed, Transport};

/// Samples by rays: shadows and bounces as the transport's effects say, derivatives from what each ray sees (Annen et al. 2004).
/// The random streams are the probes' own, apart from the reference's.
pub fn sample_traced<T: Real>(
    transport: &Transport,
    bounds: &OrientedBox,
    requests: &[SampleRequest],
    order: usize,
    seed: u64,
    effort: Effort,
) -> (Sampled<T>, Counters) {
    let gradient = requests.iter().any(|r| r.derivatives.contains(&true));
    let places: Vec<glam::DVec3> = requests.iter().map(|r| bounds.world(r.position)).collect();
    let seed = Seed { seed, purpose: StreamPurpose::Probe };
    let estimates = transport.projection(&places, order, gradient, seed, effort);
    sampled(bounds, requests, order, &estimates)
}

/// The same by a device.
pub fn sample_traced_on<T: Real>(
    device: &dyn ProbeDevice,
    bounds: &OrientedBox,
    requests: &[SampleRequest],
    order: usize,
    effort: Effort,
) -> Result<(Sampled<T>, Counters), String> {
    let gradient = requests.iter().any(|r| r.derivatives.contains(&true));
    let places: Vec<glam::DVec3> = requests.iter().map(|r| bounds.world(r.position)).collect();
    let estimates = device.trace(&places, TraceTask { order, gradient, effort })?;
    Ok(sampled(bounds, requests, order, &estimates))
}

/// Values, and derivatives along the box's axes.
fn sampled<T: Real>(
    bounds: &OrientedBox,
    requests: &[SampleRequest],
    order: usize,
    estimates: &[Estimate<Projected>],
) -> (Sampled<T>, Counters) {
    let mut vectors = ShVectors { order, data: Vec::new() };
    let mut push = |vector: &[Rgb<f64>]| vectors.data.extend(vector.iter().flat_map(|v| v.to_array()).map(T::of));
    for (request, estimate) in requests.iter().zip(estimates) {
        push(&estimate.value.value);
        for axis in (0..3).filter(|a| request.derivatives[*a]) {
            let gradient = estimate.value.gradient.as_ref().expect("a gradient was asked for");
            let along = bounds.axes[axis];
            let slope: Vec<Rgb<f64>> = (0..coefficients(order))
                .map(|i| gradient[0][i] * along.x + gradient[1][i] * along.y + gradient[2][i] * along.z)
                .collect();
            push(&slope);
        }
    }
    let sampled = Sampled {
        vectors,
        projections: requests.len() as u64,
        singular: estimates.iter().map(|e| u64::from(e.singular)).sum(),
    };
    (sampled, estimates.iter().map(|e| e.counters).sum())
}
