use super::forward_to_shape;
use crate::light::{LightSample, Term, Tube, UniformEmitter, UnitGradient};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::Lobe;

/// A tube by Picott's closed form (Akenine-Moller et al. 2018, eq. 10.12, with the length) and a clamp at each end in place of the horizon's clip:
/// E = |b - a| (max(0, n.a)/|a| + max(0, n.b)/|b|)/(|a||b| + a.b) per unit intensity. Exact while both ends are above the horizon.
#[derive(Clone, Debug)]
pub struct TwoPoints<T>(pub Tube<T>);

impl<T: Real> UniformEmitter<T> for TwoPoints<T> {
    forward_to_shape!();

    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, _lobe: &Lobe<T>) -> Term<T> {
        let (a, b) = (self.0.from - p, self.0.to - p);
        let (ra, rb, apart) = (a.length(), b.length(), a.dot(b));
        // where a and b point apart, the divisor would cancel
        let divisor = if apart < T::zero() {
            let sine = a.cross(b - a).length();
            sine / (ra * rb - apart) * sine
        } else {
            ra * rb + apart
        };
        let facing = n.dot(a).max(T::zero()) / ra + n.dot(b).max(T::zero()) / rb;
        let value = (b - a).length() * facing / divisor;
        if value.is_finite() { Term::regular(value) } else { Term::dropped(T::zero()) }
    }
    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        self.0.unit_projection(p)
    }
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        self.0.unit_projection_with_gradient(p)
    }
}
