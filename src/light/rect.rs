use glam::{DAffine3, DVec3};
use serde::Deserialize;

use super::file::not_negative;
use super::polygon::Facet;
use super::{BoundingSphere, LightSample, Term, UniformEmitter, UnitGradient};
use crate::input::{Finite3, InputError, Source, Spanned, schema};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::Lobe;

/// A rectangle (or parallelogram) that radiates L uniformly towards u x v: a polygon of the corners center +-u +-v.
#[derive(Clone, Debug)]
pub struct Rect<T> {
    center: Vector3<T>,
    u: Vector3<T>,
    v: Vector3<T>,
    normal: Vector3<T>,
    /// W sr^-1 m^-2.
    radiance: Rgb<T>,
}

/// `rect = { center, u, v, radiance }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RectFile {
    center: Finite3,
    u: Spanned<Finite3>,
    v: Spanned<Finite3>,
    radiance: Spanned<Finite3>,
}

impl RectFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        schema::table([
            schema::required("center", schema::vector()),
            schema::required("u", schema::described(schema::vector(), "half an edge")),
            schema::required("v", schema::described(schema::vector(), "half an edge; it emits towards u x v")),
            schema::required("radiance", schema::described(schema::colour(), "W sr^-1 m^-2")),
        ])
    }
    pub fn resolve(&self, source: &Source) -> Result<Rect<f64>, InputError> {
        let radiance = not_negative(source, &self.radiance, "radiance")?;
        let half_edge = |value: &Spanned<Finite3>, name: &str| {
            let vector = value.get_ref().vector();
            match vector == DVec3::ZERO {
                false => Ok(vector),
                true => Err(source.error(value.span(), format!("{name} is the zero vector; it is half an edge"))),
            }
        };
        let (u, v) = (half_edge(&self.u, "u")?, half_edge(&self.v, "v")?);
        Rect::new(self.center.vector(), u, v, radiance)
            .ok_or_else(|| source.error(self.v.span(), "v is along u; the rectangle has no area"))
    }
}

impl<S: Real> Rect<S> {
    pub fn relative_to<T: Real>(&self, origin: DVec3) -> Rect<T> {
        Rect {
            center: Vector3::of(self.center.to_double() - origin),
            u: Vector3::of(self.u.to_double()),
            v: Vector3::of(self.v.to_double()),
            normal: Vector3::of(self.normal.to_double()),
            radiance: Rgb::of(self.radiance.to_double().to_array()),
        }
    }
}

impl Rect<f64> {
    /// From the centre and half edges; `None` without area.
    pub fn new(center: DVec3, u: DVec3, v: DVec3, radiance: Rgb<f64>) -> Option<Self> {
        let cross = u.cross(v);
        let area = cross.length();
        (area > 1e-9 * u.length() * v.length() && area.is_finite()).then(|| Self {
            center: Vector3::of(center),
            u: Vector3::of(u),
            v: Vector3::of(v),
            normal: Vector3::of(cross / area),
            radiance,
        })
    }
    pub fn transformed(&self, motion: &DAffine3) -> Self {
        let turned = |v: &Vector3<f64>| Vector3::of(motion.transform_vector3(v.to_double()));
        Self {
            center: Vector3::of(motion.transform_point3(self.center.to_double())),
            u: turned(&self.u),
            v: turned(&self.v),
            normal: turned(&self.normal),
            radiance: self.radiance,
        }
    }
    pub fn scaled_radiance(&self, factor: f64) -> Self {
        Self { radiance: self.radiance * factor, ..self.clone() }
    }
    pub fn bounds(&self) -> Option<BoundingSphere> {
        Some(BoundingSphere { center: self.center.to_double(), radius: self.extent() })
    }
}

impl<T: Real> Rect<T> {
    pub fn center(&self) -> Vector3<T> {
        self.center
    }
    /// Half edges.
    pub fn half_edges(&self) -> [Vector3<T>; 2] {
        [self.u, self.v]
    }
    pub fn normal(&self) -> Vector3<T> {
        self.normal
    }
    /// Radiance of the side that emits, W sr^-1 m^-2.
    pub fn front_radiance(&self) -> Rgb<T> {
        self.radiance
    }
    fn extent(&self) -> T {
        (self.u + self.v).length().max((self.u - self.v).length())
    }
    /// Corners, counter-clockwise as seen from the lit side.
    pub fn corners(&self) -> [Vector3<T>; 4] {
        let (c, u, v) = (self.center, self.u, self.v);
        [c - u - v, c + u - v, c + u + v, c - u + v]
    }
    #[inline(always)]
    pub(super) fn with_facet<R>(&self, f: impl FnOnce(Facet<'_, T>) -> R) -> R {
        let (u, v) = (self.u, self.v);
        let offsets = [-u - v, u - v, u + v, v - u];
        f(Facet { offsets: &offsets, normal: self.normal, center: self.center, extent: self.extent() })
    }
}

impl<T: Real> UniformEmitter<T> for Rect<T> {
    fn colour(&self) -> Rgb<T> {
        self.radiance
    }
    fn unit_radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
        let hit = self.with_facet(|facet| facet.hit(p, direction));
        if hit.is_some() { T::one() } else { T::zero() }
    }
    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<T> {
        Term::regular(self.with_facet(|facet| facet.irradiance(p, n, lobe)))
    }
    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        Term::regular(self.with_facet(|facet| facet.projection(p)))
    }
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        Term::regular(self.with_facet(|facet| facet.projection_with_gradient(p)))
    }
    /// Uniform over the area.
    fn unit_sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
        let [s, t] = u.map(|x| x + x - T::one());
        let to = self.center - p + self.u * s + self.v * t;
        self.with_facet(|facet| facet.sample_at(p, to, facet.area()))
    }
    fn unit_pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
        self.with_facet(|facet| facet.pdf_solid_angle(p, direction))
    }
}
