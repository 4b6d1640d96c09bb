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
    /// `a` without its last `by` bits.
    fn shifted(a: Self::Index, by: Self::Index) -> Self::Index;
    /// The bits of `a` that are set in `mask`.
    fn bits(a: Self::Index, mask: u32) -> Self::Index;
    /// The entry of a table at each place; of places beyond its end, its last.
    fn lookup(table: &[u32], at: Self::Index) -> Self::Index;
    /// Whether all are marked: [`MARK`] is set.
    fn all_marked(a: Self::Index) -> bool;
    /// `then` where `mark` is marked, else `otherwise`.
    fn index_where_marked(mark: Self::Index, then: Self::Index, otherwise: Self::Index) -> Self::Index;
    /// `then` where `mark` is marked, else `otherwise`.
    fn where_marked(mark: Self::Index, then: Self, otherwise: Self) -> Self;

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
    #[inline(always)]
    fn shifted(a: usize, by: usize) -> usize {
        a >> by
    }
    #[inline(always)]
    fn bits(a: usize, mask: u32) -> usize {
        a & mask as usize
    }
    #[inline(always)]
    fn lookup(table: &[u32], at: usize) -> usize {
        table[at.min(table.len() - 1)] as usize
    }
    #[inline(always)]
    fn all_marked(a: usize) -> bool {
        a & MARK as usize != 0
    }
    #[inline(always)]
    fn index_where_marked(mark: usize, then: usize, otherwise: usize) -> usize {
        if Self::all_marked(mark) { then } else { otherwise }
    }
    #[inline(always)]
    fn where_marked(mark: usize, then: T, otherwise: T) -> T {
        if Self::all_marked(mark) { then } else { otherwise }
    }
}

/// Marks an index: its highest bit.
pub const MARK: u32 = 1 << 31;

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

/// A model whose places find their vectors in a table: as many taps everywhere, whose vectors are the entries from a place's own first
/// entries on. It is evaluated eight places at a time, too.
pub trait TableModel<T: Real> {
    /// Vectors by number.
    fn table(&self) -> &[u32];

    /// Gives the taps at `q`. What is said of [`LaneModel::lane_taps`] on inlining holds.
    fn lane_taps<L: Lane<Scalar = T>>(&self, q: [L; 3], taps: &mut impl TableTaps<L>);
}

/// Takes the taps of a [`TableModel`]: at most 64 at a place, in at most 8 groups.
pub trait TableTaps<L: Lane> {
    /// Begins a group of taps whose entries are counted from `first` on; where `first` is marked the group does not count.
    fn group(&mut self, first: L::Index);
    /// Vector `table[first + offset] + slot` counts with this weight.
    fn tap(&mut self, offset: usize, slot: usize, weight: L);
}

/// Taps of one place, without those that weigh nothing, as vectors with weights.
pub struct OnePlace<'t, F> {
    table: &'t [u32],
    first: usize,
    tap: F,
}

impl<'t, F> OnePlace<'t, F> {
    pub fn new(table: &'t [u32], tap: F) -> Self {
        Self { table, first: MARK as usize, tap }
    }
}

impl<T: Real, F: FnMut(usize, T)> TableTaps<T> for OnePlace<'_, F> {
    #[inline(always)]
    fn group(&mut self, first: usize) {
        self.first = first;
    }
    #[inline(always)]
    fn tap(&mut self, offset: usize, slot: usize, weight: T) {
        if weight != T::zero() && !T::all_marked(self.first) {
            (self.tap)(self.table[self.first + offset] as usize + slot, weight);
        }
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

/// The weights of a [`TableModel`] as those of any rig.
#[macro_export]
macro_rules! rig_model_of_table {
    ($($model:ident),+ $(,)?) => {
        $(impl<T: $crate::math::Real> $crate::rig::RigModel<T> for $model<T> {
            #[inline]
            fn taps(&self, q: $crate::math::Vector3<T>, tap: &mut impl FnMut(usize, T)) {
                use $crate::rig::TableModel;
                self.lane_taps(q.to_array(), &mut $crate::rig::OnePlace::new(self.table(), tap));
            }

            fn irradiance<const C: usize>(
                &self,
                vectors: &$crate::rig::ShVectors<T>,
                points: &$crate::rig::LocalPoints<T>,
                out: &mut [$crate::math::Rgb<T>],
            ) {
                self.packed_irradiance::<C>(&$crate::rig::Packed::new(vectors.clone()), points, out);
            }

            fn packed_irradiance<const C: usize>(
                &self,
                packed: &$crate::rig::Packed<T>,
                points: &$crate::rig::LocalPoints<T>,
                out: &mut [$crate::math::Rgb<T>],
            ) {
                $crate::rig::table_irradiance::<T, Self, C>(self, packed, points, out);
            }
        })+
    };
}

rig_models_of_lanes!(ConstantModel, GradientModel, LatticeModel, MixedModel, RbfModel);
