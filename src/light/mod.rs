//! Light shapes, one file each: radiance along a ray, exact irradiance, SH projection and its gradient.
//!
//! A shape is a struct over the scalar type; [`Light`] is the closed set of them. Positions are relative to an origin that the
//! caller chooses ([`Light::relative_to`]), so that `f32` code works near the things that it lights.
//! Adding a shape is one file here and one line in [`light_shapes!`] below (and its WGSL twin beside it, if the GPU evaluates it directly).

mod constant;
mod directional;
mod point;

pub use constant::Constant;
pub use directional::Directional;
pub use point::Point;

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
}

/// Declares the closed set of light shapes and forwards [`LightShape`] to the one at hand.
macro_rules! light_shapes {
    ($($shape:ident),+ $(,)?) => {
        /// A light of any shape.
        #[derive(Clone, Debug)]
        pub enum Light<T> {
            $($shape($shape<T>)),+
        }

        impl Light<f64> {
            /// This light in coordinates about `origin`, rounded to the scalar `T`.
            pub fn relative_to<T: Real>(&self, origin: glam::DVec3) -> Light<T> {
                match self {
                    $(Light::$shape(shape) => Light::$shape(shape.relative_to(origin))),+
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
        }
    };
}

light_shapes!(Point, Directional, Constant);

/// Sum of the exact irradiance of several lights, and how many terms were dropped as singular.
pub fn irradiance<T: Real>(lights: &[Light<T>], p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<Rgb<T>> {
    let mut sum = Term::regular(Rgb::zero());
    for light in lights {
        let term = light.irradiance(p, n, lobe);
        sum.value += term.value;
        sum.singular += term.singular;
    }
    sum
}

/// Sum of the SH projections of several lights.
pub fn projection<T: Real, const C: usize>(lights: &[Light<T>], p: Vector3<T>) -> Term<ShRgb<T, C>> {
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
pub fn projection_with_gradient<T: Real, const C: usize>(lights: &[Light<T>], p: Vector3<T>) -> Term<ShGradient<T, C>> {
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
