use glam::{DAffine3, DVec3};
use serde::Deserialize;

use super::file::{direction, not_negative};
use super::{BoundingSphere, LightSample, LightShape, ShGradient, Term};
use crate::input::{Finite3, InputError, Source, Spanned, schema};
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

/// `directional = { towards, irradiance }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DirectionalFile {
    towards: Spanned<Finite3>,
    irradiance: Spanned<Finite3>,
}

impl DirectionalFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        schema::table([
            schema::required("towards", schema::described(schema::vector(), "to the light; any length but 0")),
            schema::required("irradiance", schema::described(schema::colour(), "on a surface that faces it, W m^-2")),
        ])
    }
    pub fn resolve(&self, source: &Source) -> Result<Directional<f64>, InputError> {
        Ok(Directional {
            towards: direction(source, &self.towards, "towards")?,
            irradiance: not_negative(source, &self.irradiance, "irradiance")?,
        })
    }
}

impl<S: Real> Directional<S> {
    pub fn relative_to<T: Real>(&self, _origin: DVec3) -> Directional<T> {
        Directional {
            towards: Vector3::of(self.towards.to_double()),
            irradiance: Rgb::of(self.irradiance.to_double().to_array()),
        }
    }
}

impl Directional<f64> {
    pub fn transformed(&self, motion: &DAffine3) -> Self {
        Self { towards: Vector3::of(motion.transform_vector3(self.towards.to_double())), ..self.clone() }
    }
    pub fn scaled_radiance(&self, factor: f64) -> Self {
        Self { irradiance: self.irradiance * factor, ..self.clone() }
    }
    pub fn bounds(&self) -> Option<BoundingSphere> {
        None
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

    fn sample(&self, _p: Vector3<T>, _u: [T; 2]) -> Option<LightSample<T>> {
        Some(LightSample {
            direction: self.towards,
            distance: T::infinity(),
            weight: self.irradiance,
            pdf_solid_angle: None,
            normal: None,
        })
    }

    fn pdf_solid_angle(&self, _p: Vector3<T>, _direction: Vector3<T>) -> T {
        T::zero()
    }
}
