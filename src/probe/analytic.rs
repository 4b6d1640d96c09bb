use super::{GradientSource, SampleRequest, Sampled};
use crate::light::{self, LightShape};
use crate::math::{Real, Rgb, Vector3};
use crate::scene::OrientedBox;
use crate::sh::{ShRgb, ShVectors, Window, coefficients, degree_of};
use crate::with_order;

/// Projects all lights at every place that was asked for, nothing blocking them.
///
/// `lights` are relative to the box's centre ([`Light::relative_to`]). The window damps the bands of every sample; its
/// derivatives are damped by the value's factors.
pub fn sample_lights<T: Real>(
    lights: &[impl LightShape<T>],
    bounds: &OrientedBox,
    requests: &[SampleRequest],
    order: usize,
    gradients: GradientSource,
    window: Window,
) -> Sampled<T> {
    with_order!(order, C => sample_of_order::<T, C>(lights, bounds, requests, gradients, window))
}

fn sample_of_order<T: Real, const C: usize>(
    lights: &[impl LightShape<T>],
    bounds: &OrientedBox,
    requests: &[SampleRequest],
    gradients: GradientSource,
    window: Window,
) -> Sampled<T> {
    let axes = bounds.axes.map(Vector3::<T>::of);
    let order = crate::sh::order_of(C);
    let capacity = requests.iter().map(SampleRequest::vectors).sum::<usize>() * coefficients(order) * 3;
    let mut vectors = ShVectors { order, data: Vec::with_capacity(capacity) };
    let (mut projected, mut singular) = (0u64, 0u64);
    for request in requests {
        let [x, y, z] = request.position.map(T::of);
        let p = axes[0] * x + axes[1] * y + axes[2] * z;
        let asks = request.derivatives.iter().any(|d| *d);
        projected += lights.len() as u64;
        if !asks || matches!(gradients, GradientSource::Central { .. }) {
            let term = light::projection::<T, C>(lights, p);
            singular += u64::from(term.singular);
            let bands = bands_of(&window, &term.value);
            vectors.push(&damped(term.value, &bands));
            if let GradientSource::Central { step } = gradients {
                for axis in (0..3).filter(|a| request.derivatives[*a]) {
                    let h = T::of(step);
                    let above = light::projection::<T, C>(lights, p + axes[axis] * h);
                    let below = light::projection::<T, C>(lights, p - axes[axis] * h);
                    projected += 2 * lights.len() as u64;
                    singular += u64::from(above.singular + below.singular);
                    let scale = T::one() / (h + h);
                    let slope = std::array::from_fn(|i| (above.value[i] - below.value[i]) * scale);
                    vectors.push(&damped(slope, &bands));
                }
            }
        } else {
            let term = light::projection_with_gradient::<T, C>(lights, p);
            singular += u64::from(term.singular);
            let bands = bands_of(&window, &term.value.value);
            vectors.push(&damped(term.value.value, &bands));
            let gradient = &term.value.gradient;
            for axis in (0..3).filter(|a| request.derivatives[*a]) {
                let a = axes[axis];
                let slope = std::array::from_fn(|i| gradient[0][i] * a.x + gradient[1][i] * a.y + gradient[2][i] * a.z);
                vectors.push(&damped(slope, &bands));
            }
        }
    }
    Sampled { vectors, projections: projected, singular }
}

/// The window's factor a coefficient, or none where the window changes nothing.
fn bands_of<T: Real, const C: usize>(window: &Window, signal: &ShRgb<T, C>) -> Option<[T; C]> {
    (*window != Window::None).then(|| {
        let bands = window.bands_for(signal);
        std::array::from_fn(|i| T::of(bands[degree_of(i)]))
    })
}

fn damped<T: Real, const C: usize>(mut signal: [Rgb<T>; C], factors: &Option<[T; C]>) -> [Rgb<T>; C] {
    if let Some(factors) = factors {
        for i in 0..C {
            signal[i] = signal[i] * factors[i];
        }
    }
    signal
}
