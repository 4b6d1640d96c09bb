use super::{LightShape, ShGradient, Term};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, ShRgb};

/// The same radiance from every direction, everywhere. E = A_0(a) L (pi L without wrap); L_0 = 2 sqrt(pi) L.
#[derive(Clone, Debug)]
pub struct Constant<T> {
    /// W sr^-1 m^-2.
    pub radiance: Rgb<T>,
}

impl Constant<f64> {
    pub fn relative_to<T: Real>(&self, _origin: glam::DVec3) -> Constant<T> {
        Constant { radiance: Rgb::of(self.radiance.to_array()) }
    }
}

impl<T: Real> LightShape<T> for Constant<T> {
    fn radiance(&self, _p: Vector3<T>, _direction: Vector3<T>) -> Rgb<T> {
        self.radiance
    }

    fn irradiance(&self, _p: Vector3<T>, _n: Vector3<T>, lobe: &Lobe<T>) -> Term<Rgb<T>> {
        Term::regular(self.radiance * lobe.bands()[0])
    }

    fn projection<const C: usize>(&self, _p: Vector3<T>) -> Term<ShRgb<T, C>> {
        let mut sh = [Rgb::zero(); C];
        sh[0] = self.radiance * T::of(2.0 * std::f64::consts::PI.sqrt());
        Term::regular(sh)
    }

    fn projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<ShGradient<T, C>> {
        Term::regular(ShGradient { value: self.projection::<C>(p).value, ..ShGradient::zero() })
    }
}
