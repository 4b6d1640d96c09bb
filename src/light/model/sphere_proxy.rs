use super::forward_to_shape;
use crate::light::sphere::{cap_factor_slopes, cap_factors, cap_of, cap_projection, cap_response};
use crate::light::{Disk, LightSample, Term, UniformEmitter, UnitGradient};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, basis_gradient, degree_of};

/// A disk in place of which stands the sphere of the same vector irradiance F: a cap about F/|F| with sin^2(alpha) = |F|/pi.
///
/// Exact wherever the whole disk is above the horizon; only the clip is another shape's. Its SH are the cap's.
#[derive(Clone, Debug)]
pub struct SphereProxy<T>(pub Disk<T>);

impl<T: Real> SphereProxy<T> {
    /// Direction and sine of the cap; `None` behind the disk.
    #[inline(always)]
    fn cap(&self, p: Vector3<T>) -> Option<(Vector3<T>, T)> {
        let flux = self.0.vector_irradiance(p)?;
        let towards = flux.normalized()?;
        Some((towards, (flux.length() / T::PI()).sqrt().min(T::one())))
    }
}

impl<T: Real> UniformEmitter<T> for SphereProxy<T> {
    forward_to_shape!();

    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<T> {
        let value = self.cap(p).map(|(towards, sine)| cap_response(&cap_of(towards, sine), n, lobe));
        Term::regular(value.unwrap_or(T::zero()))
    }

    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        let value = self.cap(p).map(|(towards, sine)| cap_projection::<T, C>(&cap_of(towards, sine)));
        Term::regular(value.unwrap_or([T::zero(); C]))
    }

    /// L_i = Z_k(s2) Y_i(w) with s2 = |F|/pi, w = F/|F|; F and its derivatives are the disk's SH of degree 1.
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        let mut sh = UnitGradient::zero();
        let Some((towards, sine)) = self.cap(p) else { return Term::regular(sh) };
        let cap = cap_of(towards, sine);
        sh.value = cap_projection::<T, C>(&cap);
        let exact = self.0.unit_projection_with_gradient::<4>(p);
        let scale = T::of((4.0 * std::f64::consts::PI / 3.0).sqrt());
        let length = T::PI() * sine * sine;
        let (factors, slopes) = (cap_factors(&cap), cap_factor_slopes(&cap));
        if !slopes[0].is_finite() || length <= T::zero() {
            return Term::dropped(sh);
        }
        let (values, gradients) = basis_gradient::<T, C>(towards);
        for axis in 0..3 {
            let of = |i: usize| exact.value.gradient[i][axis] * scale;
            let flux_slope = Vector3::new(of(3), of(1), of(2));
            let along = towards.dot(flux_slope);
            let turn = (flux_slope - towards * along) / length;
            for i in 0..C {
                let degree = degree_of(i);
                let slope = slopes[degree] * (along / T::PI()) * values[i] + factors[degree] * gradients[i].dot(turn);
                match axis {
                    0 => sh.gradient[i].x = slope,
                    1 => sh.gradient[i].y = slope,
                    _ => sh.gradient[i].z = slope,
                }
            }
        }
        Term::regular(sh)
    }
}
