use glam::{DAffine3, DVec3};
use serde::Deserialize;

use super::file::not_negative;
use super::{BoundingSphere, LightSample, LightShape, ShGradient, Term};
use crate::input::{Finite3, InputError, Source, Spanned, schema};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, ShRgb};

/// The same radiance from every direction, everywhere. E = A_0(a) L (pi L without wrap); L_0 = 2 sqrt(pi) L.
#[derive(Clone, Debug)]
pub struct Constant<T> {
    /// W sr^-1 m^-2.
    pub radiance: Rgb<T>,
}

/// `constant = { radiance }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstantFile {
    radiance: Spanned<Finite3>,
}

impl ConstantFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        schema::table([schema::required("radiance", schema::described(schema::colour(), "W sr^-1 m^-2"))])
    }
    pub fn resolve(&self, source: &Source) -> Result<Constant<f64>, InputError> {
        Ok(Constant { radiance: not_negative(source, &self.radiance, "radiance")? })
    }
}

impl<S: Real> Constant<S> {
    pub fn relative_to<T: Real>(&self, _origin: DVec3) -> Constant<T> {
        Constant { radiance: Rgb::of(self.radiance.to_double().to_array()) }
    }
}

impl Constant<f64> {
    pub fn transformed(&self, _motion: &DAffine3) -> Self {
        self.clone()
    }
    pub fn scaled_radiance(&self, factor: f64) -> Self {
        Self { radiance: self.radiance * factor }
    }
    pub fn bounds(&self) -> Option<BoundingSphere> {
        None
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

    /// Uniform over the sphere.
    fn sample(&self, _p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
        let z = T::one() - T::of(2.0) * u[0];
        let sine = ((T::one() - z) * (T::one() + z)).max(T::zero()).sqrt();
        let (sin_phi, cos_phi) = (T::TAU() * u[1]).sin_cos();
        let whole = T::of(4.0) * T::PI();
        Some(LightSample {
            direction: Vector3::new(sine * cos_phi, sine * sin_phi, z),
            distance: T::infinity(),
            weight: self.radiance * whole,
            pdf_solid_angle: Some(T::one() / whole),
            normal: None,
        })
    }

    fn pdf_solid_angle(&self, _p: Vector3<T>, _direction: Vector3<T>) -> T {
        T::one() / (T::of(4.0) * T::PI())
    }
}
