//! Sphere lights by wrapped cosines: what the horizon does to a large sphere, imitated by a wider lobe.

use super::forward_to_shape;
use crate::light::{LightSample, Sphere, Term, UniformEmitter, UnitGradient};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::Lobe;

/// Forsyth's wrap for the clamped cosine: E = pi s^2 max(0, (c + k)/(1 + k)), c = n.w to the centre, s = R/d, with k = s:
/// 0 for a point, 1 for a light that fills the hemisphere, and light ends where the sphere sets (Akenine-Moller et al. 2018, 10.1.2).
#[derive(Clone, Debug)]
pub struct Forsyth<T>(pub Sphere<T>);

/// Valve's half-Lambert squared: E = pi s^2 ((c + 1)/2)^2, whatever the light's size (the same source).
#[derive(Clone, Debug)]
pub struct Valve<T>(pub Sphere<T>);

/// c and s, s at most 1; `None` at the centre.
#[inline(always)]
fn facing_and_sine<T: Real>(sphere: &Sphere<T>, p: Vector3<T>, n: Vector3<T>) -> Option<(T, T)> {
    let to = sphere.center - p;
    Some((n.dot(to.normalized()?), (sphere.radius / to.length()).min(T::one())))
}

macro_rules! wrapped {
    ($model:ident, $lobe:expr) => {
        impl<T: Real> UniformEmitter<T> for $model<T> {
            forward_to_shape!();

            fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, _lobe: &Lobe<T>) -> Term<T> {
                let value = facing_and_sine(&self.0, p, n).map(|(c, s)| T::PI() * s * s * $lobe(c, s));
                Term::regular(value.unwrap_or(T::PI()))
            }
            fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
                self.0.unit_projection(p)
            }
            fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
                self.0.unit_projection_with_gradient(p)
            }
        }
    };
}

wrapped!(Forsyth, |c: T, k: T| ((c + k) / (T::one() + k)).max(T::zero()));
wrapped!(Valve, |c: T, _: T| {
    let half = (c + T::one()) * T::of(0.5);
    half * half
});
