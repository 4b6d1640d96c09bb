use super::forward_to_shape;
use crate::light::{Disk, LightSample, Term, UniformEmitter, UnitGradient};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, basis, basis_gradient};

/// A disk by the form factor of Wallace et al. 1989: all of it in the direction of its centre,
/// E = pi A cos_e f(n.w)/(pi d^2 + A), A = pi R^2, cos_e the cosine at the disk.
///
/// Exact for a facing receiver on the axis; far too low beside it. Its SH are those of a single direction of that strength.
#[derive(Clone, Debug)]
pub struct Wallace<T>(pub Disk<T>);

impl<T: Real> Wallace<T> {
    /// Direction to the centre, distance, and the integral of radiance over solid angle; `None` behind the disk.
    #[inline(always)]
    fn seen_from(&self, p: Vector3<T>) -> Option<(Vector3<T>, T, T)> {
        let disk = &self.0;
        let to = disk.center - p;
        let height = -to.dot(disk.normal);
        if height <= T::zero() || !height.is_finite() {
            return None;
        }
        let distance = to.length();
        let area = T::PI() * disk.radius * disk.radius;
        // A/(pi d^2 + A) = s2/(1 + s2): nothing overflows
        let ratio = disk.radius / distance;
        let share = if ratio < T::one() {
            ratio * ratio / (T::one() + ratio * ratio)
        } else {
            area / (T::PI() * distance * distance + area)
        };
        Some((to / distance, distance, T::PI() * share * (height / distance)))
    }
}

impl<T: Real> UniformEmitter<T> for Wallace<T> {
    forward_to_shape!();

    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<T> {
        let strength = self.seen_from(p).map(|(w, _, strength)| strength * lobe.value(n.dot(w)));
        Term::regular(strength.unwrap_or(T::zero()))
    }

    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        Term::regular(match self.seen_from(p) {
            None => [T::zero(); C],
            Some((w, _, strength)) => basis::<T, C>(w).map(|y| y * strength),
        })
    }

    /// With S = pi A h/(d q), q = pi d^2 + A: grad S = S [m/h + w (3 pi d^2 + A)/(d q)], grad Y = -grad_S Y/d.
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        let mut sh = UnitGradient::zero();
        let Some((w, distance, strength)) = self.seen_from(p) else { return Term::regular(sh) };
        let disk = &self.0;
        let height = -(disk.center - p).dot(disk.normal);
        let ratio = disk.radius / distance;
        let s2 = ratio * ratio;
        let slope = disk.normal * (strength / height) + w * (strength / distance * (T::of(3.0) + s2) / (T::one() + s2));
        let (values, gradients) = basis_gradient::<T, C>(w);
        for i in 0..C {
            sh.value[i] = values[i] * strength;
            let surface = gradients[i] - w * gradients[i].dot(w);
            sh.gradient[i] = slope * values[i] - surface * (strength / distance);
        }
        Term::regular(sh)
    }
}
