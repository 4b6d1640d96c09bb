use std::marker::PhantomData;

use super::{Model, Rig, RigModel, SampleRequest};
use crate::math::{Real, Vector3};

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

impl<T: Real> RigModel<T> for ConstantModel<T> {
    #[inline(always)]
    fn taps(&self, _q: Vector3<T>, tap: &mut impl FnMut(usize, T)) {
        tap(0, T::one());
    }
}
