use std::marker::PhantomData;

use super::{Lane, LaneModel, Model, Rig, SampleRequest};
use crate::math::Real;

/// The gradient rig: l(q) = l(centre) + q . grad l(centre), outside the box too. Four SH vectors, one sample.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gradient {}

/// Weights 1, x, y, z.
#[derive(Clone, Debug)]
pub struct GradientModel<T>(PhantomData<T>);

impl Rig for Gradient {
    fn placement(&self, _half: [f64; 3]) -> Vec<SampleRequest> {
        vec![SampleRequest { position: [0.0; 3], derivatives: [true; 3] }]
    }
    fn model<T: Real>(&self, _half: [f64; 3]) -> Model<T> {
        Model::Gradient(GradientModel(PhantomData))
    }
    fn wgsl(&self, _half: [f64; 3]) -> String {
        include_str!("gradient.wgsl").to_owned()
    }
    fn reproduces(&self, _half: [f64; 3], exponents: [u32; 3]) -> bool {
        exponents.iter().sum::<u32>() <= 1
    }
}

impl<T: Real> LaneModel<T> for GradientModel<T> {
    #[inline(always)]
    fn lane_taps<L: Lane<Scalar = T>>(&self, [x, y, z]: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        let first = L::index(0);
        tap(first, 0, L::constant(1.0));
        tap(first, 1, x);
        tap(first, 2, y);
        tap(first, 3, z);
    }
}
