use glam::{DAffine3, DVec3};
use serde::Deserialize;

use super::arc::Arc;
use super::file::not_negative;
use super::{BoundingSphere, LightSample, Term, UniformEmitter, UnitGradient};
use crate::input::{Finite3, InputError, Source, Spanned, schema};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, basis, basis_gradient, order_of};

/// A line source from `from` to `to` whose every metre sends the same intensity in all directions.
///
/// E = integral of f(n.w)/r^2 ds and L_i = integral of Y_i(w)/r^2 ds per unit intensity. As seen from the point ds/r^2 = dpsi/h, with h
/// the distance to the line: the integrals are of trigonometric polynomials over an arc ([`Arc`]), exact to rounding however near.
/// On the line source itself the term is dropped and counted.
#[derive(Clone, Debug)]
pub struct Tube<T> {
    pub from: Vector3<T>,
    pub to: Vector3<T>,
    /// W sr^-1 m^-1.
    pub intensity: Rgb<T>,
}

/// `tube = { from, to, intensity }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TubeFile {
    from: Finite3,
    to: Spanned<Finite3>,
    intensity: Spanned<Finite3>,
}

impl TubeFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        schema::table([
            schema::required("from", schema::vector()),
            schema::required("to", schema::vector()),
            schema::required("intensity", schema::described(schema::colour(), "W sr^-1 m^-1")),
        ])
    }
    pub fn resolve(&self, source: &Source) -> Result<Tube<f64>, InputError> {
        let (from, to) = (self.from.vector(), self.to.get_ref().vector());
        if from == to {
            return Err(source.error(self.to.span(), "the tube ends where it starts; it needs a length"));
        }
        Ok(Tube {
            from: Vector3::of(from),
            to: Vector3::of(to),
            intensity: not_negative(source, &self.intensity, "intensity")?,
        })
    }
}

impl<S: Real> Tube<S> {
    pub fn relative_to<T: Real>(&self, origin: DVec3) -> Tube<T> {
        let moved = |v: &Vector3<S>| Vector3::of(v.to_double() - origin);
        Tube { from: moved(&self.from), to: moved(&self.to), intensity: Rgb::of(self.intensity.to_double().to_array()) }
    }
}

impl Tube<f64> {
    pub fn transformed(&self, motion: &DAffine3) -> Self {
        let moved = |v: &Vector3<f64>| Vector3::of(motion.transform_point3(v.to_double()));
        Self { from: moved(&self.from), to: moved(&self.to), ..self.clone() }
    }
    pub fn scaled_radiance(&self, factor: f64) -> Self {
        Self { intensity: self.intensity * factor, ..self.clone() }
    }
    pub fn bounds(&self) -> Option<BoundingSphere> {
        let (from, to) = (self.from.to_double(), self.to.to_double());
        Some(BoundingSphere { center: 0.5 * (from + to), radius: 0.5 * from.distance(to) })
    }
}

impl<T: Real> Tube<T> {
    /// The arc and the integral of ds/r^2; `None` on the tube and so near it that a gradient is not finite.
    fn seen_from(&self, p: Vector3<T>) -> Option<(Arc<T>, T)> {
        let side = self.to - self.from;
        let arc = Arc::new(self.from - p, side)?;
        let weight = arc.angle_over_cross * side.length();
        let nearest = arc.nearest_inverse();
        ((weight * nearest) * T::of(8.0) * self.intensity.max_abs().max(T::one())).is_finite().then_some((arc, weight))
    }
}

/// Integral of max(0, n.w)/r^2 ds, of which `weight` is the integral without the cosine: over the arc n.w = size cos(psi - phase), so that
/// between the ends from and to of its part above the horizon it is weight/angle size 2 cos((from + to)/2 - phase) sin((to - from)/2).
/// The ends at the horizon are known as angles; clipping the segment itself would lose them beside the tube.
fn lambert<T: Real>(arc: &Arc<T>, weight: T, n: Vector3<T>) -> T {
    let (x, y) = (n.dot(arc.start), n.dot(arc.across));
    if arc.angle <= T::epsilon() {
        return weight * x.max(T::zero());
    }
    let (size, half) = ((x * x + y * y).sqrt(), T::of(0.5));
    let turned = y.atan2(x);
    // the quarter turns about the phase in which the arc, from 0 to pi at most, may lie
    let phase = if turned < -T::FRAC_PI_2() { turned + T::TAU() } else { turned };
    let from = (phase - T::FRAC_PI_2()).max(T::zero());
    let to = (phase + T::FRAC_PI_2()).min(arc.angle);
    if to <= from {
        return T::zero();
    }
    let (middle, reach) = ((from + to) * half - phase, (to - from) * half);
    weight / arc.angle * size * T::of(2.0) * middle.cos().max(T::zero()) * reach.sin()
}

impl<T: Real> UniformEmitter<T> for Tube<T> {
    fn colour(&self) -> Rgb<T> {
        self.intensity
    }

    fn unit_radiance(&self, _p: Vector3<T>, _direction: Vector3<T>) -> T {
        T::zero()
    }

    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<T> {
        match self.seen_from(p) {
            None => Term::dropped(T::zero()),
            Some((arc, weight)) if lobe.is_lambert() => Term::regular(lambert(&arc, weight, n)),
            Some((arc, weight)) => {
                Term::regular(weight * arc.mean_over_cosine(n, lobe.wrap(), |cosine| lobe.value(cosine)))
            }
        }
    }

    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        let mut sh = [T::zero(); C];
        let Some((arc, weight)) = self.seen_from(p) else {
            return Term::dropped(sh);
        };
        arc.nodes(order_of(C) - 1, |w, share, _| {
            let values = basis::<T, C>(w);
            for i in 0..C {
                sh[i] += values[i] * (weight * share);
            }
        });
        Term::regular(sh)
    }

    /// grad_p L_i = integral of (2 w Y_i - grad_S Y_i)/r^3 ds: a point source's, along the tube.
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        let mut sh = UnitGradient::zero();
        let Some((arc, weight)) = self.seen_from(p) else {
            return Term::dropped(sh);
        };
        arc.nodes(order_of(C) + 1, |w, share, inverse| {
            let (values, gradients) = basis_gradient::<T, C>(w);
            let part = weight * share;
            for i in 0..C {
                sh.value[i] += values[i] * part;
                let surface = gradients[i] - w * gradients[i].dot(w);
                sh.gradient[i] += (w * (values[i] + values[i]) - surface) * (part * inverse);
            }
        });
        Term::regular(sh)
    }

    /// Uniform over the arc.
    fn unit_sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
        let (arc, weight) = self.seen_from(p)?;
        Some(LightSample {
            direction: arc.at(u[0] * arc.angle),
            distance: T::one() / arc.inverse_distance(u[0]),
            weight: Rgb::splat(weight),
            pdf_solid_angle: None,
            normal: None,
        })
    }

    fn unit_pdf_solid_angle(&self, _p: Vector3<T>, _direction: Vector3<T>) -> T {
        T::zero()
    }
}
