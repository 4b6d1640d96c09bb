use glam::{DAffine3, DVec3};
use serde::Deserialize;

use super::file::not_negative;
use super::{BoundingSphere, LightSample, LightShape, ShGradient, Term};
use crate::input::{Finite3, InputError, Source, Spanned, schema};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, ShRgb, basis, basis_gradient};

/// A point source: E = I f(n . w) / d^2 with w = (position - p)/d; L_i = I Y_i(w) / d^2.
/// At the source itself the term is dropped and counted.
#[derive(Clone, Debug)]
pub struct Point<T> {
    pub position: Vector3<T>,
    /// Radiant intensity, W sr^-1.
    pub intensity: Rgb<T>,
}

/// `point = { position, intensity }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointFile {
    position: Finite3,
    intensity: Spanned<Finite3>,
}

impl PointFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        schema::table([
            schema::required("position", schema::vector()),
            schema::required("intensity", schema::described(schema::colour(), "W sr^-1")),
        ])
    }
    pub fn resolve(&self, source: &Source) -> Result<Point<f64>, InputError> {
        Ok(Point {
            position: Vector3::of(self.position.vector()),
            intensity: not_negative(source, &self.intensity, "intensity")?,
        })
    }
}

impl<S: Real> Point<S> {
    pub fn relative_to<T: Real>(&self, origin: DVec3) -> Point<T> {
        Point {
            position: Vector3::of(self.position.to_double() - origin),
            intensity: Rgb::of(self.intensity.to_double().to_array()),
        }
    }
}

impl Point<f64> {
    pub fn transformed(&self, motion: &DAffine3) -> Self {
        Self { position: Vector3::of(motion.transform_point3(self.position.to_double())), ..self.clone() }
    }
    pub fn scaled_radiance(&self, factor: f64) -> Self {
        Self { intensity: self.intensity * factor, ..self.clone() }
    }
    pub fn bounds(&self) -> Option<BoundingSphere> {
        Some(BoundingSphere { center: self.position.to_double(), radius: 0.0 })
    }
}

impl<T: Real> Point<T> {
    /// Unit direction to the source and 1/d; `None` where 1/d^2 is not finite.
    #[inline(always)]
    fn seen_from(&self, p: Vector3<T>) -> Option<(Vector3<T>, T)> {
        let to = self.position - p;
        let inverse = T::one() / to.length();
        let direction = to.normalized()?;
        ((inverse * inverse) * inverse * self.intensity.max_abs()).is_finite().then_some((direction, inverse))
    }
}

impl<T: Real> LightShape<T> for Point<T> {
    fn radiance(&self, _p: Vector3<T>, _direction: Vector3<T>) -> Rgb<T> {
        Rgb::zero()
    }

    fn irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<Rgb<T>> {
        match self.seen_from(p) {
            Some((w, inverse)) => Term::regular(self.intensity * (inverse * inverse * lobe.value(n.dot(w)))),
            None => Term::dropped(Rgb::zero()),
        }
    }

    fn projection<const C: usize>(&self, p: Vector3<T>) -> Term<ShRgb<T, C>> {
        match self.seen_from(p) {
            Some((w, inverse)) => {
                let scale = self.intensity * (inverse * inverse);
                Term::regular(basis::<T, C>(w).map(|y| scale * y))
            }
            None => Term::dropped([Rgb::zero(); C]),
        }
    }

    /// grad_p L_i = I/d^3 (2 w Y_i - grad_S Y_i), grad_S Y = g - (g . w) w with g the polynomial's gradient.
    fn projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<ShGradient<T, C>> {
        let Some((w, inverse)) = self.seen_from(p) else {
            return Term::dropped(ShGradient::zero());
        };
        let (values, gradients) = basis_gradient::<T, C>(w);
        let mut sh = ShGradient::zero();
        let scale = self.intensity * (inverse * inverse);
        for i in 0..C {
            sh.value[i] = scale * values[i];
            let surface = gradients[i] - w * gradients[i].dot(w);
            let slope = (w * (T::of(2.0) * values[i]) - surface) * inverse;
            for axis in 0..3 {
                sh.gradient[axis][i] = scale * slope[axis];
            }
        }
        Term::regular(sh)
    }

    fn sample(&self, p: Vector3<T>, _u: [T; 2]) -> Option<LightSample<T>> {
        let (direction, inverse) = self.seen_from(p)?;
        Some(LightSample {
            direction,
            distance: T::one() / inverse,
            weight: self.intensity * (inverse * inverse),
            pdf_solid_angle: None,
            normal: None,
        })
    }

    fn pdf_solid_angle(&self, _p: Vector3<T>, _direction: Vector3<T>) -> T {
        T::zero()
    }
}
