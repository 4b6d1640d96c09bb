use std::marker::PhantomData;

use super::{Lane, LaneModel, LocalPoints, Model, Rig, SampleRequest, ShVectors, wide};
use crate::math::{Real, Rgb};

/// The constant rig: l(q) = l(centre). One SH vector.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Constant {}

/// Weight 1 on the one vector.
#[derive(Clone, Debug)]
pub struct ConstantModel<T>(PhantomData<T>);

impl Rig for Constant {
    fn placement(&self, _half: [f64; 3]) -> Vec<SampleRequest> {
        vec![SampleRequest::value_at([0.0; 3])]
    }
    fn model<T: Real>(&self, _half: [f64; 3]) -> Model<T> {
        Model::Constant(ConstantModel(PhantomData))
    }
    fn wgsl(&self, _half: [f64; 3]) -> String {
        include_str!("constant.wgsl").to_owned()
    }
    fn reproduces(&self, _half: [f64; 3], exponents: [u32; 3]) -> bool {
        exponents == [0; 3]
    }
}

impl<T: Real> LaneModel<T> for ConstantModel<T> {
    #[inline(always)]
    fn lane_taps<L: Lane<Scalar = T>>(&self, _q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        tap(L::index(0), 0, L::constant(1.0));
    }

    fn lane_irradiance<const C: usize>(&self, vectors: &ShVectors<T>, points: &LocalPoints<T>, out: &mut [Rgb<T>]) {
        wide::constant_irradiance::<T, Self, C>(self, vectors, points, out);
    }
}
