//! Light shapes, one file each: radiance along a ray, exact irradiance, SH projection and its gradient, sampling, and the
//! TOML table that describes one.
//!
//! A shape is a struct over the scalar type; [`Light`] is the closed set of them. Positions are relative to an origin that the
//! caller chooses ([`Light::relative_to`]), so that `f32` code works near the things that it lights.
//! Adding a shape is one file here and one line in [`light_shapes!`] below (and its WGSL twin beside it, if the GPU evaluates it directly).

mod arc;
mod batch;
mod constant;
mod directional;
mod disk;
mod environment;
mod file;
mod integral;
mod model;
mod point;
mod polygon;
mod rect;
mod shader;
mod sphere;
mod tube;

pub use batch::SphereBatch;
pub use constant::{Constant, ConstantFile};
pub use directional::{Directional, DirectionalFile};
pub use disk::{Disk, DiskFile};
pub use environment::{Environment, EnvironmentFile, EnvironmentMap};
pub use model::{
    DIRECT_ORDER, DiskTable, Forsyth, LIGHT_MODELS, LightModel, ModelWord, ModelledLight, RepresentativePoint,
    SphereProxy, SphereTable, TABLE_SIZE, TabulatedDisk, TabulatedSphere, TwoPoints, Valve, Wallace,
};
pub use point::{Point, PointFile};
pub use polygon::{Polygon, PolygonFile};
pub use rect::{Rect, RectFile};
pub use shader::{LightRows, ShaderLight, lights_wgsl, model_kinds, shader_kinds, sphere_projection_wgsl};
pub use sphere::{Sphere, SphereFile};
pub use tube::{Tube, TubeFile};

use std::ops::Range;

use glam::{DAffine3, DVec3};
use serde::Deserialize;

use crate::input::{InputError, Source, Spanned};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, ShRgb};

/// A light's answer, with the number of terms that were dropped because the place is singular for this light
/// (a point light at the receiver, a receiver on a tube, the gradient at a sphere's surface). Values are always finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term<V> {
    pub value: V,
    pub singular: u32,
}

impl<V> Term<V> {
    pub fn regular(value: V) -> Self {
        Self { value, singular: 0 }
    }
    pub fn dropped(value: V) -> Self {
        Self { value, singular: 1 }
    }
    #[inline(always)]
    pub fn map<W>(self, f: impl FnOnce(V) -> W) -> Term<W> {
        Term { value: f(self.value), singular: self.singular }
    }
}

/// SH radiance coefficients at a point and their derivatives along x, y and z (per metre).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShGradient<T, const C: usize> {
    pub value: ShRgb<T, C>,
    pub gradient: [ShRgb<T, C>; 3],
}

impl<T: Real, const C: usize> ShGradient<T, C> {
    pub fn zero() -> Self {
        Self { value: [Rgb::zero(); C], gradient: [[Rgb::zero(); C]; 3] }
    }
}

/// SH coefficients for unit radiance (or intensity) and their spatial gradients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnitGradient<T, const C: usize> {
    pub value: [T; C],
    pub gradient: [Vector3<T>; C],
}

impl<T: Real, const C: usize> UnitGradient<T, C> {
    pub fn zero() -> Self {
        Self { value: [T::zero(); C], gradient: [Vector3::zero(); C] }
    }
}

/// A direction drawn towards a light: for any g, the integral of L(p, w) g(w) dw is the mean of `weight * g(direction)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample<T> {
    /// Unit vector from the point to the light.
    pub direction: Vector3<T>,
    /// Metres to the place on the light; infinite for directional, constant and environment lights.
    pub distance: T,
    /// Radiance over density. For lights without extent, whose radiance is a distribution, the distribution's weight.
    pub weight: Rgb<T>,
    /// Density of `direction` per steradian, [`LightShape::pdf_solid_angle`]; `None` for lights without extent.
    pub pdf_solid_angle: Option<T>,
    /// Unit normal of the light's surface at that place, on the side that is seen; `None` where there is no surface (lights without
    /// extent, and at infinity).
    pub normal: Option<Vector3<T>>,
}

impl<T: Real> LightSample<T> {
    /// Radiance along the sampled direction; `None` for lights without extent.
    pub fn radiance(&self) -> Option<Rgb<T>> {
        self.pdf_solid_angle.map(|pdf| self.weight * pdf)
    }
}

/// What every light shape answers. `p` is a point in the light's coordinates, metres.
pub trait LightShape<T: Real> {
    /// Radiance that reaches `p` from the unit direction `direction`; 0 for lights without extent (point, directional, tube),
    /// whose radiance is a distribution.
    fn radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> Rgb<T>;

    /// E(p, n) = integral of L(p, w) f(n . w) dw, exact, with the receiver's horizon; W m^-2.
    fn irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<Rgb<T>>;

    /// L_i = integral of L(p, w) Y_i(w) dw over the whole sphere.
    fn projection<const C: usize>(&self, p: Vector3<T>) -> Term<ShRgb<T, C>>;

    /// The projection and its spatial gradient.
    fn projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<ShGradient<T, C>>;

    /// A direction towards the light from two numbers in [0, 1); `None` where the light does not reach `p` at all.
    fn sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>>;

    /// The density per steradian with which [`LightShape::sample`] draws `direction`; 0 for lights without extent.
    fn pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T;
}

/// A shape whose radiance (or intensity) is one colour: everything is that colour times a scalar answer.
/// Such a shape becomes a [`LightShape`] by `uniform_emitters!` below.
pub trait UniformEmitter<T: Real> {
    /// Radiance, or intensity.
    fn colour(&self) -> Rgb<T>;
    fn unit_radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> T;
    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<T>;
    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]>;
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>>;
    fn unit_sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>>;
    fn unit_pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T;
}

/// Makes [`LightShape`]s of [`UniformEmitter`]s.
macro_rules! uniform_emitters {
    ($($shape:ident),+ $(,)?) => {$(
        impl<T: Real> LightShape<T> for $shape<T> {
            #[inline]
            fn radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> Rgb<T> {
                self.colour() * self.unit_radiance(p, direction)
            }
            #[inline]
            fn irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<Rgb<T>> {
                self.unit_irradiance(p, n, lobe).map(|e| self.colour() * e)
            }
            #[inline]
            fn projection<const C: usize>(&self, p: Vector3<T>) -> Term<ShRgb<T, C>> {
                let colour = self.colour();
                self.unit_projection::<C>(p).map(|sh| sh.map(|c| colour * c))
            }
            #[inline]
            fn projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<ShGradient<T, C>> {
                let colour = self.colour();
                self.unit_projection_with_gradient::<C>(p).map(|unit| {
                    let mut sh = ShGradient::zero();
                    for i in 0..C {
                        sh.value[i] = colour * unit.value[i];
                        sh.gradient[0][i] = colour * unit.gradient[i].x;
                        sh.gradient[1][i] = colour * unit.gradient[i].y;
                        sh.gradient[2][i] = colour * unit.gradient[i].z;
                    }
                    sh
                })
            }
            #[inline]
            fn sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
                self.unit_sample(p, u).map(|sample| LightSample { weight: self.colour() * sample.weight, ..sample })
            }
            #[inline]
            fn pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
                self.unit_pdf_solid_angle(p, direction)
            }
        }
    )+};
}

use uniform_emitters;

uniform_emitters!(Sphere, Disk, Rect, Polygon, Tube);

/// The smallest sphere about a light that its shape knows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingSphere {
    pub center: DVec3,
    pub radius: f64,
}

/// Declares the closed set of light shapes, the TOML table that names one of them, and forwards to the shape at hand.
/// Each shape brings, on its `f64` form: `relative_to`, `transformed`, `scaled_radiance` and `bounds`.
macro_rules! light_shapes {
    ($($key:ident: $shape:ident / $file:ident),+ $(,)?) => {
        /// A light of any shape.
        #[derive(Clone, Debug)]
        pub enum Light<T> {
            $($shape($shape<T>)),+
        }

        impl Light<f64> {
            /// The TOML keys of the shapes.
            pub const KINDS: &'static [&'static str] = &[$(stringify!($key)),+];

            /// The shapes' keys, each with the JSON schema of its table.
            pub fn schemas() -> Vec<(&'static str, serde_json::Value)> {
                vec![$((stringify!($key), $file::schema())),+]
            }

            /// This light moved by a rigid motion (a proper rotation, then a translation).
            pub fn transformed(&self, motion: &DAffine3) -> Self {
                match self {
                    $(Light::$shape(shape) => Light::$shape(shape.transformed(motion))),+
                }
            }

            /// This light with its radiance, intensity or irradiance times `factor`.
            pub fn scaled_radiance(&self, factor: f64) -> Self {
                match self {
                    $(Light::$shape(shape) => Light::$shape(shape.scaled_radiance(factor))),+
                }
            }

            /// A sphere around the light; `None` for lights at infinity.
            pub fn bounds(&self) -> Option<BoundingSphere> {
                match self {
                    $(Light::$shape(shape) => shape.bounds()),+
                }
            }
        }

        impl<S: Real> Light<S> {
            /// This light in coordinates about `origin`, rounded to the scalar `T`.
            pub fn relative_to<T: Real>(&self, origin: DVec3) -> Light<T> {
                match self {
                    $(Light::$shape(shape) => Light::$shape(shape.relative_to(origin))),+
                }
            }
        }

        impl<T> Light<T> {
            /// The shape's TOML key.
            pub fn kind_name(&self) -> &'static str {
                match self {
                    $(Light::$shape(_) => stringify!($key)),+
                }
            }
        }

        impl<T: Real> LightShape<T> for Light<T> {
            #[inline]
            fn radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> Rgb<T> {
                match self {
                    $(Light::$shape(shape) => shape.radiance(p, direction)),+
                }
            }
            #[inline]
            fn irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<Rgb<T>> {
                match self {
                    $(Light::$shape(shape) => shape.irradiance(p, n, lobe)),+
                }
            }
            #[inline]
            fn projection<const C: usize>(&self, p: Vector3<T>) -> Term<ShRgb<T, C>> {
                match self {
                    $(Light::$shape(shape) => shape.projection::<C>(p)),+
                }
            }
            #[inline]
            fn projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<ShGradient<T, C>> {
                match self {
                    $(Light::$shape(shape) => shape.projection_with_gradient::<C>(p)),+
                }
            }
            #[inline]
            fn sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
                match self {
                    $(Light::$shape(shape) => shape.sample(p, u)),+
                }
            }
            #[inline]
            fn pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
                match self {
                    $(Light::$shape(shape) => shape.pdf_solid_angle(p, direction)),+
                }
            }
        }

        /// One `[[light]]` of a layout: a name, a shape (exactly one of the keys) and, for a light that moves, a path,
        /// whose form `P` is the layout's business.
        #[derive(Clone, Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct LightFile<P> {
            pub name: Option<Spanned<String>>,
            pub path: Option<P>,
            $(pub $key: Option<Spanned<$file>>),+
        }

        impl<P> LightFile<P> {
            /// The light that this table describes. `span` is the place of the whole table.
            pub fn resolve(&self, source: &Source, span: Range<usize>) -> Result<Light<f64>, InputError> {
                let mut given: Vec<(&str, Range<usize>)> = [
                    $((stringify!($key), self.$key.as_ref().map(|table| table.span()))),+
                ]
                .into_iter()
                .filter_map(|(key, span)| Some((key, span?)))
                .collect();
                given.sort_by_key(|(_, span)| span.start);
                match given.as_slice() {
                    [_] => {}
                    [] => {
                        let allowed = Light::KINDS.join("`, `");
                        return Err(source.error(span, format!("a light without a shape; allowed: one of `{allowed}`")));
                    }
                    [first, second, ..] => {
                        let message = format!("`{}` beside `{}`; a light has one shape", second.0, first.0);
                        return Err(source.error(second.1.clone(), message));
                    }
                }
                $(if let Some(table) = &self.$key {
                    return table.get_ref().resolve(source).map(Light::$shape);
                })+
                unreachable!("one shape was given")
            }
        }
    };
}

light_shapes!(
    sphere: Sphere / SphereFile,
    disk: Disk / DiskFile,
    rect: Rect / RectFile,
    polygon: Polygon / PolygonFile,
    tube: Tube / TubeFile,
    point: Point / PointFile,
    directional: Directional / DirectionalFile,
    constant: Constant / ConstantFile,
    environment: Environment / EnvironmentFile,
);

impl Light<f64> {
    /// Hash of the file that the light reads beside its table, where there is one.
    pub fn asset(&self) -> Option<&str> {
        match self {
            Light::Environment(environment) => Some(environment.map().content()),
            _ => None,
        }
    }

    /// This light moved by `offset`.
    pub fn translated(&self, offset: DVec3) -> Self {
        self.transformed(&DAffine3::from_translation(offset))
    }
}

/// Sum of the irradiance of several lights, and how many terms were dropped as singular.
pub fn irradiance<T: Real>(
    lights: &[impl LightShape<T>],
    p: Vector3<T>,
    n: Vector3<T>,
    lobe: &Lobe<T>,
) -> Term<Rgb<T>> {
    let mut sum = Term::regular(Rgb::zero());
    for light in lights {
        let term = light.irradiance(p, n, lobe);
        sum.value += term.value;
        sum.singular += term.singular;
    }
    sum
}

/// Sum of the SH projections of several lights.
pub fn projection<T: Real, const C: usize>(lights: &[impl LightShape<T>], p: Vector3<T>) -> Term<ShRgb<T, C>> {
    let mut sum = Term::regular([Rgb::zero(); C]);
    for light in lights {
        let term = light.projection::<C>(p);
        for i in 0..C {
            sum.value[i] += term.value[i];
        }
        sum.singular += term.singular;
    }
    sum
}

/// Sum of the SH projections of several lights with their gradients.
pub fn projection_with_gradient<T: Real, const C: usize>(
    lights: &[impl LightShape<T>],
    p: Vector3<T>,
) -> Term<ShGradient<T, C>> {
    let mut sum = Term::regular(ShGradient::zero());
    for light in lights {
        let term = light.projection_with_gradient::<C>(p);
        for i in 0..C {
            sum.value.value[i] += term.value.value[i];
            for axis in 0..3 {
                sum.value.gradient[axis][i] += term.value.gradient[axis][i];
            }
        }
        sum.singular += term.singular;
    }
    sum
}
