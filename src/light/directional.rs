use super::{LightShape, ShGradient, Term};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, ShRgb, basis};

/// Light from one direction: L(w) = E_perp delta(w - towards). E = E_perp f(n . towards); L_i = E_perp Y_i(towards).
#[derive(Clone, Debug)]
pub struct Directional<T> {
    /// Unit vector to the light.
    pub towards: Vector3<T>,
    /// Irradiance of a surface that faces the light, W m^-2.
    pub irradiance: Rgb<T>,
}

impl Directional<f64> {
    pub fn relative_to<T: Real>(&self, _origin: glam::DVec3) -> Directional<T> {
        Directional { towards: Vector3::of(self.towards.to_double()), irradiance: Rgb::of(self.irradiance.to_array()) }
    }
}

impl<T: Real> LightShape<T> for Directional<T> {
    fn radiance(&self, _p: Vector3<T>, _direction: Vector3<T>) -> Rgb<T> {
        Rgb::zero()
    }

    fn irradiance(&self, _p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<Rgb<T>> {
        Term::regular(self.irradiance * lobe.value(n.dot(self.towards)))
    }

    fn projection<const C: usize>(&self, _p: Vector3<T>) -> Term<ShRgb<T, C>> {
        Term::regular(basis::<T, C>(self.towards).map(|y| self.irradiance * y))
    }

    fn projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<ShGradient<T, C>> {
        Term::regular(ShGradient { value: self.projection::<C>(p).value, ..ShGradient::zero() })
    }
}
