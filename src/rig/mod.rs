//! Rig models, one file each: where a rig wants probe samples, how they become parameters, how parameters become light at a point.
//!
//! Every rig is linear in the SH vectors that it keeps: l(q) = sum_k w_k(q) v_k, where v_k are sampled values, sampled derivatives or
//! fitted coefficients and the weights depend on the place alone. A rig therefore says three things: its [`Rig::placement`],
//! its [`Rig::fit`] (by default the samples as they are), and its weights ([`RigModel::taps`]).
//! One evaluation loop serves them all ([`plain_irradiance`]), and fast ones those whose places have all the same taps ([`LaneModel`]) or find them in a table ([`TableModel`]).
//!
//! Coordinates: q is in metres along the axes of the receiver's oriented box, from the box's centre; `half` holds the half extents,
//! any of which may be 0. SH coefficients stay in the world's frame. A rig's WGSL twin lies beside it and defines
//! `fn rig_taps(q: vec3f)`, which calls `tap(vector: u32, weight: f32)` in the same order as the Rust.
//!
//! Adding a rig is one file here (with its WGSL beside it), its `mod` line and one line in [`rigs!`] at the end.

mod catalogue;
mod constant;
mod gradient;
mod grid;
pub mod interpolation;
mod lanes;
mod lattice;
mod mixed;
mod rbf;
mod wide;

pub use catalogue::{CatalogueEntry, catalogue};
pub use constant::Constant;
pub use gradient::Gradient;
pub use grid::{AxisNames, Grid, GridAxis, Nodes, grid_placement, tensor_taps, wgsl_number};
pub use interpolation::{Interpolation, InterpolationChoice};
pub use lanes::{Lane, LaneModel, MARK, OnePlace, TableModel, TableTaps};
pub use lattice::Lattice;
pub use mixed::{AxisModel, Mixed};
pub use rbf::{Centers, Kernel, Rbf, RbfSolver};
pub use wide::{Packed, available as wide_available, table_irradiance};

use std::ops::Range;

use serde::Deserialize;

use crate::input::{InputError, Source, Spanned};
use crate::math::{Real, Rgb, Vector3};
pub use crate::probe::SampleRequest;
pub use crate::sh::ShVectors;
use crate::sh::basis;
use constant::ConstantModel;
use gradient::GradientModel;
use lattice::{LatticeFile, LatticeModel};
use mixed::{MixedFile, MixedModel};
use rbf::{RbfFile, RbfModel};

/// What a fit gives.
#[derive(Clone, Debug)]
pub struct Fit<T> {
    /// The vectors that the rig keeps.
    pub vectors: ShVectors<T>,
    /// Largest over smallest singular value that was kept, of a system that was solved.
    pub condition: Option<f64>,
    /// Singular values that were cut: above 0, the answer is the one of least norm among many.
    pub cut: usize,
}

/// Points to light, structure of arrays: box coordinates and world normals.
#[derive(Clone, Debug, Default)]
pub struct LocalPoints<T> {
    pub q: [Vec<T>; 3],
    pub n: [Vec<T>; 3],
}

impl<T: Real> LocalPoints<T> {
    pub fn len(&self) -> usize {
        self.q[0].len()
    }
    pub fn is_empty(&self) -> bool {
        self.q[0].is_empty()
    }
    #[inline(always)]
    pub fn q(&self, i: usize) -> Vector3<T> {
        Vector3::new(self.q[0][i], self.q[1][i], self.q[2][i])
    }
    #[inline(always)]
    pub fn n(&self, i: usize) -> Vector3<T> {
        Vector3::new(self.n[0][i], self.n[1][i], self.n[2][i])
    }
    pub fn push(&mut self, q: glam::DVec3, n: glam::DVec3) {
        for axis in 0..3 {
            self.q[axis].push(T::of(q[axis]));
            self.n[axis].push(T::of(n[axis]));
        }
    }
}

/// A rig as an experiment configures it.
pub trait Rig {
    /// Where it wants samples in a box of these half extents.
    fn placement(&self, half: [f64; 3]) -> Vec<SampleRequest>;

    /// From the sampled vectors (per request: value, then derivatives asked for) to the vectors that are kept.
    fn fit<T: Real>(&self, half: [f64; 3], sampled: ShVectors<T>) -> Fit<T> {
        let _ = half;
        Fit { vectors: sampled, condition: None, cut: 0 }
    }

    /// The weights over a box of these half extents.
    fn model<T: Real>(&self, half: [f64; 3]) -> Model<T>;

    /// WGSL that defines `fn rig_taps(q: vec3f)` for boxes like this one: counts are printed into the text, lengths stand in rows behind the
    /// vectors ([`Rig::wgsl_rows`]), so that boxes of other sizes have the same text.
    fn wgsl(&self, half: [f64; 3]) -> String;

    /// The rows of numbers that the text reads for a box of these half extents.
    fn wgsl_rows(&self, half: [f64; 3]) -> Vec<[f32; 4]> {
        let _ = half;
        Vec::new()
    }

    /// The interpolation, of a rig that has one.
    fn interpolation(&self) -> Option<&Interpolation> {
        None
    }

    /// What the rig claims, and laws hold it to: whether the field x^a y^b z^c (with its derivatives) is exact
    /// everywhere in a box whose half extents are all above 0.
    fn reproduces(&self, half: [f64; 3], exponents: [u32; 3]) -> bool;
}

/// Where a rig's table stands while it is resolved.
pub struct Resolving<'s> {
    pub source: &'s Source,
    /// The rig's value in the file.
    pub span: Range<usize>,
    /// The matrix's interpolation, which takes the place of the rig's own.
    pub interpolation: Option<InterpolationChoice>,
}

impl Resolving<'_> {
    /// An error about the rig as a whole.
    pub fn error(&self, message: impl Into<String>) -> InputError {
        self.source.error(self.span.clone(), message)
    }
}

/// What stands under a rig's key in a file: shape and types checked, values not yet.
pub trait RigTable {
    type Rig;
    /// Its JSON schema.
    fn schema() -> serde_json::Value;
    fn resolve(&self, resolving: &Resolving) -> Result<Self::Rig, InputError>;
}

/// A rig without values to check is its own table.
macro_rules! table_is_rig {
    ($($rig:ident),+) => {
        $(impl RigTable for $rig {
            type Rig = Self;
            fn schema() -> serde_json::Value {
                crate::input::schema::table([])
            }
            fn resolve(&self, _resolving: &Resolving) -> Result<Self, InputError> {
                Ok(self.clone())
            }
        })+
    };
}

table_is_rig!(Constant, Gradient);

/// The weights of a rig at a place.
pub trait RigModel<T: Real> {
    /// Calls `tap(vector, weight)` for every vector that counts at `q`.
    fn taps(&self, q: Vector3<T>, tap: &mut impl FnMut(usize, T));

    /// E at every point from irradiance coefficients ([`ShVectors::convolved`]), order `C = order^2`.
    fn irradiance<const C: usize>(&self, vectors: &ShVectors<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        plain_irradiance::<T, Self, C>(self, vectors, points, out);
    }

    /// The same from vectors that were laid out beforehand.
    fn packed_irradiance<const C: usize>(&self, packed: &Packed<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        self.irradiance::<C>(packed.vectors(), points, out);
    }
}

/// The evaluation that every rig has, in its shortest correct form, one point at a time: basis at the normal, then
/// the weighted sum of dot products. Faster forms are measured and tested against it.
pub fn plain_irradiance<T: Real, M: RigModel<T> + ?Sized, const C: usize>(
    model: &M,
    vectors: &ShVectors<T>,
    points: &LocalPoints<T>,
    out: &mut [Rgb<T>],
) {
    for (i, e) in out.iter_mut().enumerate() {
        let y = basis::<T, C>(points.n(i));
        let mut sum = Rgb::zero();
        model.taps(points.q(i), &mut |vector, weight| {
            let v = &vectors.data[vector * C * 3..(vector + 1) * C * 3];
            let mut dot = Rgb::zero();
            for k in 0..C {
                dot += Rgb::new(v[3 * k], v[3 * k + 1], v[3 * k + 2]) * y[k];
            }
            sum += dot * weight;
        });
        *e = sum;
    }
}

/// Declares the closed set of rigs: key in files, configuration, its table in files, model.
macro_rules! rigs {
    ($($key:ident => $rig:ident / $table:ident / $model:ident),+ $(,)?) => {
        /// A rig of any kind.
        #[derive(Clone, Debug, PartialEq, serde::Serialize)]
        #[serde(rename_all = "snake_case")]
        pub enum AnyRig {
            $($rig($rig)),+
        }

        /// The weights of a rig of any kind.
        #[derive(Clone, Debug)]
        pub enum Model<T> {
            $($rig($model<T>)),+
        }

        /// A table `[rig.NAME]` of an experiment file: one key that says the kind of rig, with its parameters.
        #[derive(Clone, Debug, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct RigFile {
            $($key: Option<Spanned<$table>>),+
        }

        impl RigFile {
            /// The rig. `span` is the table's place; `interpolation` the matrix's, where it has one.
            pub fn resolve(
                &self,
                source: &Source,
                span: Range<usize>,
                interpolation: Option<InterpolationChoice>,
            ) -> Result<AnyRig, InputError> {
                let given: Vec<(&str, Range<usize>)> =
                    [$((stringify!($key), self.$key.as_ref().map(|table| table.span()))),+]
                        .into_iter()
                        .filter_map(|(key, span)| span.map(|span| (key, span)))
                        .collect();
                match given.as_slice() {
                    [] => Err(source.error(span, format!("no rig; give one key of {}", AnyRig::KEYS.join(", ")))),
                    [(_, span)] => {
                        let resolving = Resolving { source, span: span.clone(), interpolation };
                        $(if let Some(table) = &self.$key {
                            return table.get_ref().resolve(&resolving).map(AnyRig::$rig);
                        })+
                        unreachable!("one key is given");
                    }
                    [(first, _), (second, span), ..] => {
                        let message = format!("`{first}` and `{second}` in one rig; a rig has one key");
                        Err(source.error(span.clone(), message))
                    }
                }
            }
        }

        impl AnyRig {
            /// The keys that a rig's table may hold, one of them.
            pub const KEYS: &'static [&'static str] = &[$(stringify!($key)),+];

            /// The keys, each with the JSON schema of its table.
            pub fn schemas() -> Vec<(&'static str, serde_json::Value)> {
                vec![$((stringify!($key), <$table as RigTable>::schema())),+]
            }

            /// The key of this rig.
            pub fn key(&self) -> &'static str {
                match self { $(AnyRig::$rig(_) => stringify!($key)),+ }
            }
        }

        impl Rig for AnyRig {
            fn placement(&self, half: [f64; 3]) -> Vec<SampleRequest> {
                match self { $(AnyRig::$rig(rig) => rig.placement(half)),+ }
            }
            fn fit<T: Real>(&self, half: [f64; 3], sampled: ShVectors<T>) -> Fit<T> {
                match self { $(AnyRig::$rig(rig) => rig.fit(half, sampled)),+ }
            }
            fn model<T: Real>(&self, half: [f64; 3]) -> Model<T> {
                match self { $(AnyRig::$rig(rig) => rig.model(half)),+ }
            }
            fn wgsl(&self, half: [f64; 3]) -> String {
                match self { $(AnyRig::$rig(rig) => rig.wgsl(half)),+ }
            }
            fn wgsl_rows(&self, half: [f64; 3]) -> Vec<[f32; 4]> {
                match self { $(AnyRig::$rig(rig) => rig.wgsl_rows(half)),+ }
            }
            fn interpolation(&self) -> Option<&Interpolation> {
                match self { $(AnyRig::$rig(rig) => rig.interpolation()),+ }
            }
            fn reproduces(&self, half: [f64; 3], exponents: [u32; 3]) -> bool {
                match self { $(AnyRig::$rig(rig) => rig.reproduces(half, exponents)),+ }
            }
        }

        impl<T: Real> RigModel<T> for Model<T> {
            fn taps(&self, q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
                match self { $(Model::$rig(model) => model.taps(q, tap)),+ }
            }
            fn irradiance<const C: usize>(&self, vectors: &ShVectors<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
                match self { $(Model::$rig(model) => model.irradiance::<C>(vectors, points, out)),+ }
            }
            fn packed_irradiance<const C: usize>(&self, packed: &Packed<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
                match self { $(Model::$rig(model) => model.packed_irradiance::<C>(packed, points, out)),+ }
            }
        }
    };
}

rigs!(
    constant => Constant / Constant / ConstantModel,
    gradient => Gradient / Gradient / GradientModel,
    lattice => Lattice / LatticeFile / LatticeModel,
    mixed => Mixed / MixedFile / MixedModel,
    rbf => Rbf / RbfFile / RbfModel,
);

impl AnyRig {
    /// The rig of an inline table, as the command line gives it: `gradient = {}`.
    pub fn inline(text: &str) -> Result<Self, InputError> {
        let source = Source::inline("rig", text);
        source.parse::<RigFile>()?.resolve(&source, 0..text.len(), None)
    }
}
