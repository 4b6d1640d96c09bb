//! Weights at one place or at several at once, from one text: [`Lane`] is a scalar, or eight of them in a register.

use std::ops::{Add, Div, Mul, Sub};

use super::constant::ConstantModel;
use super::gradient::GradientModel;
use super::lattice::LatticeModel;
use super::mixed::MixedModel;
use super::rbf::RbfModel;
use super::{LocalPoints, Packed, RigModel, ShVectors, wide};
use crate::math::{Real, Rgb, Vector3};

/// A number, or several side by side, in the arithmetic that weights need.
pub trait Lane: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    type Scalar: Real;
    /// A whole number of at least 0 for each scalar.
    type Index: Copy;

    fn splat(value: Self::Scalar) -> Self;
    fn smaller(self, other: Self) -> Self;
    fn larger(self, other: Self) -> Self;
    fn root(self) -> Self;
    /// A function of each scalar.
    fn mapped(self, f: impl Fn(Self::Scalar) -> Self::Scalar) -> Self;
    /// `then` where this equals `other`, else `otherwise`.
    fn where_equal(self, other: Self, then: Self, otherwise: Self) -> Self;

    /// The whole part of a number of at least 0, at most `most`.
    fn whole(self, most: usize) -> Self::Index;
    /// 1 where this is above `threshold`, else 0.
    fn above(self, threshold: Self::Scalar) -> Self::Index;
    fn number(index: Self::Index) -> Self;
    fn index(value: usize) -> Self::Index;
    /// `a + b * times`
    fn index_sum(a: Self::Index, b: Self::Index, times: usize) -> Self::Index;

    /// A constant that is written in `f64`.
    #[inline(always)]
    fn constant(value: f64) -> Self {
        Self::splat(Self::Scalar::of(value))
    }
}

impl<T: Real> Lane for T {
    type Scalar = T;
    type Index = usize;

    #[inline(always)]
    fn splat(value: T) -> T {
        value
    }
    #[inline(always)]
    fn smaller(self, other: T) -> T {
        self.min(other)
    }
    #[inline(always)]
    fn larger(self, other: T) -> T {
        self.max(other)
    }
    #[inline(always)]
    fn root(self) -> T {
        self.sqrt()
    }
    #[inline(always)]
    fn mapped(self, f: impl Fn(T) -> T) -> T {
        f(self)
    }
    #[inline(always)]
    fn where_equal(self, other: T, then: T, otherwise: T) -> T {
        if self == other { then } else { otherwise }
    }
    #[inline(always)]
    fn whole(self, most: usize) -> usize {
        self.to_usize().unwrap_or(0).min(most)
    }
    #[inline(always)]
    fn above(self, threshold: T) -> usize {
        usize::from(self > threshold)
    }
    #[inline(always)]
    fn number(index: usize) -> T {
        T::of(index as f64)
    }
    #[inline(always)]
    fn index(value: usize) -> usize {
        value
    }
    #[inline(always)]
    fn index_sum(a: usize, b: usize, times: usize) -> usize {
        a + b * times
    }
}

/// A model whose places all have the same taps, counted from a first vector of each place's own: its weights are written for any
/// [`Lane`], and it is evaluated eight places at a time.
pub trait LaneModel<T: Real> {
    /// Calls `tap(first, offset, weight)` for every vector `first + offset` that counts at `q`. Offsets, and how many
    /// there are, do not depend on the place; every call gives the same `first`.
    ///
    /// Everything on the way is inlined into code that is compiled for the lanes' instructions, so it is `#[inline(always)]`
    /// and passes lanes through no closure but `tap` (the compiler gives other closures the plain instructions).
    fn lane_taps<L: Lane<Scalar = T>>(&self, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L));

    /// [`RigModel::irradiance`].
    fn lane_irradiance<const C: usize>(&self, vectors: &ShVectors<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>])
    where
        Self: Sized,
    {
        wide::irradiance::<T, Self, C>(self, vectors, points, out);
    }

    /// [`RigModel::packed_irradiance`].
    fn lane_packed<const C: usize>(&self, packed: &Packed<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>])
    where
        Self: Sized,
    {
        wide::packed_irradiance::<T, Self, C>(self, packed, points, out);
    }
}

/// A model's weights one place at a time, for the plain loop.
pub struct OneLane<'m, M>(pub &'m M);

impl<T: Real, M: LaneModel<T>> RigModel<T> for OneLane<'_, M> {
    #[inline(always)]
    fn taps(&self, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        self.0.lane_taps(q.to_array(), &mut |first: usize, offset, weight| tap(first + offset, weight));
    }
}

/// The weights of a [`LaneModel`] as those of any rig.
macro_rules! rig_models_of_lanes {
    ($($model:ident),+ $(,)?) => {
        $(impl<T: Real> RigModel<T> for $model<T> {
            #[inline(always)]
            fn taps(&self, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
                OneLane(self).taps(q, tap);
            }

            fn irradiance<const C: usize>(&self, vectors: &ShVectors<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
                self.lane_irradiance::<C>(vectors, points, out);
            }

            fn packed_irradiance<const C: usize>(&self, packed: &Packed<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
                self.lane_packed::<C>(packed, points, out);
            }
        })+
    };
}

rig_models_of_lanes!(ConstantModel, GradientModel, LatticeModel, MixedModel, RbfModel);
