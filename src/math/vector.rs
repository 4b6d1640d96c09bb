use std::ops::{Add, AddAssign, Div, Index, Mul, Neg, Sub, SubAssign};

use super::Real;

/// A vector or point of three-space over a [`Real`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Vector3<T> {
    pub x: T,
    pub y: T,
    pub z: T,
}

impl<T: Real> Vector3<T> {
    #[inline(always)]
    pub const fn new(x: T, y: T, z: T) -> Self {
        Self { x, y, z }
    }

    #[inline(always)]
    pub fn zero() -> Self {
        Self::splat(T::zero())
    }

    #[inline(always)]
    pub fn splat(value: T) -> Self {
        Self::new(value, value, value)
    }

    /// Rounds a double-precision vector to this scalar.
    #[inline(always)]
    pub fn of(v: glam::DVec3) -> Self {
        Self::new(T::of(v.x), T::of(v.y), T::of(v.z))
    }

    #[inline(always)]
    pub fn to_double(self) -> glam::DVec3 {
        glam::DVec3::new(self.x.to_double(), self.y.to_double(), self.z.to_double())
    }

    #[inline(always)]
    pub fn to_array(self) -> [T; 3] {
        [self.x, self.y, self.z]
    }

    #[inline(always)]
    pub fn from_array([x, y, z]: [T; 3]) -> Self {
        Self::new(x, y, z)
    }

    #[inline(always)]
    pub fn dot(self, other: Self) -> T {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        Self::new(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )
    }

    #[inline(always)]
    pub fn length_squared(self) -> T {
        self.dot(self)
    }

    /// Euclidean length, safe against overflow and underflow of the squares.
    #[inline(always)]
    pub fn length(self) -> T {
        let squared = self.length_squared();
        if squared > T::min_positive_value() / T::epsilon() && squared < T::max_value() {
            return squared.sqrt();
        }
        let largest = self.max_abs();
        if largest == T::zero() || !largest.is_finite() {
            return largest;
        }
        (self / largest).length_squared().sqrt() * largest
    }

    /// The largest absolute component.
    #[inline(always)]
    pub fn max_abs(self) -> T {
        self.x.abs().max(self.y.abs()).max(self.z.abs())
    }

    /// The unit vector along this one; `None` where its length is zero or not finite.
    #[inline(always)]
    pub fn normalized(self) -> Option<Self> {
        let largest = self.max_abs();
        if largest > T::zero() && largest.is_finite() {
            let scaled = self / largest;
            Some(scaled / scaled.length_squared().sqrt())
        } else {
            None
        }
    }

    /// Two unit vectors that complete the unit vector `self` to a right-handed orthonormal frame
    /// `(tangent, bitangent, self)` (Duff et al. 2017).
    #[inline(always)]
    pub fn frame(self) -> (Self, Self) {
        let sign = if self.z < T::zero() { -T::one() } else { T::one() };
        let a = -T::one() / (sign + self.z);
        let b = self.x * self.y * a;
        (
            Self::new(T::one() + sign * self.x * self.x * a, sign * b, -sign * self.x),
            Self::new(b, sign + self.y * self.y * a, -self.y),
        )
    }

    #[inline(always)]
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }
}

impl<T: Real> Add for Vector3<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}
impl<T: Real> AddAssign for Vector3<T> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
impl<T: Real> Sub for Vector3<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}
impl<T: Real> SubAssign for Vector3<T> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}
impl<T: Real> Neg for Vector3<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}
impl<T: Real> Mul<T> for Vector3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, scale: T) -> Self {
        Self::new(self.x * scale, self.y * scale, self.z * scale)
    }
}
impl<T: Real> Div<T> for Vector3<T> {
    type Output = Self;
    #[inline(always)]
    fn div(self, scale: T) -> Self {
        Self::new(self.x / scale, self.y / scale, self.z / scale)
    }
}
impl<T: Real> Index<usize> for Vector3<T> {
    type Output = T;
    #[inline(always)]
    fn index(&self, axis: usize) -> &T {
        match axis {
            0 => &self.x,
            1 => &self.y,
            2 => &self.z,
            _ => panic!("axis {axis} of a three-vector"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_survive_squares_that_overflow_or_vanish() {
        for scale in [1e-40, 1e-30, 1e-20, 1.0, 1e20, 1e38] {
            let v = Vector3::<f32>::new(0.6 * scale as f32, 0.0, 0.8 * scale as f32);
            let expected = scale as f32;
            assert!((v.length() / expected - 1.0).abs() < 1e-4, "{scale}: {}", v.length());
            assert!((v.normalized().unwrap().length() - 1.0).abs() < 1e-6);
        }
        assert!(Vector3::<f32>::zero().normalized().is_none());
        assert!(Vector3::<f64>::new(f64::NAN, 0.0, 1.0).normalized().is_none_or(|v| !v.is_finite()));
    }

    #[test]
    fn frames_are_right_handed_and_orthonormal() {
        for n in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [0.0, 1.0, 0.0]] {
            let n = Vector3::<f64>::from_array(n);
            let (t, b) = n.frame();
            assert!((t.cross(b) - n).length() < 1e-15);
            assert!(t.dot(b).abs() < 1e-15 && (t.length() - 1.0).abs() < 1e-15);
        }
    }
}
