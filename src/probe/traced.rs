use super::{SampleRequest, Sampled};
use crate::math::{Real, Rgb, StreamPurpose};
use crate::scene::OrientedBox;
use crate::sh::{ShVectors, coefficients};
use crate::trace::{Counters, Effort, Seed, Transport};

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
    let mut vectors = ShVectors { order, data: Vec::new() };
    let mut push = |vector: &[Rgb<f64>]| vectors.data.extend(vector.iter().flat_map(|v| v.to_array()).map(T::of));
    for (request, estimate) in requests.iter().zip(&estimates) {
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
