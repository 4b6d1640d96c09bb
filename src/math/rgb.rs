use std::f64::consts::PI;
use std::ops::{Add, AddAssign, Mul, Sub};

use super::Real;

/// Three linear channels, Rec. 709 primaries.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Rgb<T> {
    pub r: T,
    pub g: T,
    pub b: T,
}

impl<T: Real> Rgb<T> {
    #[inline(always)]
    pub const fn new(r: T, g: T, b: T) -> Self {
        Self { r, g, b }
    }
    #[inline(always)]
    pub fn zero() -> Self {
        Self::splat(T::zero())
    }
    #[inline(always)]
    pub fn splat(value: T) -> Self {
        Self::new(value, value, value)
    }
    #[inline(always)]
    pub fn of(v: [f64; 3]) -> Self {
        Self::new(T::of(v[0]), T::of(v[1]), T::of(v[2]))
    }
    #[inline(always)]
    pub fn to_array(self) -> [T; 3] {
        [self.r, self.g, self.b]
    }
    #[inline(always)]
    pub fn from_array([r, g, b]: [T; 3]) -> Self {
        Self::new(r, g, b)
    }
    #[inline(always)]
    pub fn to_double(self) -> Rgb<f64> {
        Rgb::new(self.r.to_double(), self.g.to_double(), self.b.to_double())
    }
    /// Rec. 709 luminance.
    #[inline(always)]
    pub fn luminance(self) -> T {
        T::of(0.2126) * self.r + T::of(0.7152) * self.g + T::of(0.0722) * self.b
    }
    #[inline(always)]
    pub fn max_abs(self) -> T {
        self.r.abs().max(self.g.abs()).max(self.b.abs())
    }
    #[inline(always)]
    pub fn is_finite(self) -> bool {
        self.r.is_finite() && self.g.is_finite() && self.b.is_finite()
    }
}

impl<T: Real> Add for Rgb<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::new(self.r + other.r, self.g + other.g, self.b + other.b)
    }
}
impl<T: Real> AddAssign for Rgb<T> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
impl<T: Real> Sub for Rgb<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::new(self.r - other.r, self.g - other.g, self.b - other.b)
    }
}
impl<T: Real> Mul<T> for Rgb<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, scale: T) -> Self {
        Self::new(self.r * scale, self.g * scale, self.b * scale)
    }
}
impl<T: Real> Mul for Rgb<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self::new(self.r * other.r, self.g * other.g, self.b * other.b)
    }
}

/// Irradiance E, W m^-2 a channel. May be negative where a band-limited lobe rings: nothing clamps it but a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct Irradiance<T>(pub Rgb<T>);

/// Radiance L, W sr^-1 m^-2 a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct Radiance<T>(pub Rgb<T>);

impl<T: Real> Irradiance<T> {
    /// The radiance max(0, albedo E / pi) that a Lambertian surface sends out, for pictures.
    /// The only place that divides an irradiance by pi, and the only one that clamps it.
    #[inline]
    pub fn reflected(self, albedo: Rgb<T>) -> Radiance<T> {
        let scaled = self.0 * albedo * T::of(1.0 / PI);
        Radiance(Rgb::new(scaled.r.max(T::zero()), scaled.g.max(T::zero()), scaled.b.max(T::zero())))
    }
}
