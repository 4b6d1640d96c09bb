use std::fmt::{Debug, Display};
use std::iter::Sum;

use num_traits::{Float, FloatConst, NumAssign};

/// A real scalar: `f32` or `f64`. Every lighting formula is written once over it.
pub trait Real: Float + FloatConst + NumAssign + Sum + Default + Debug + Display + Send + Sync + bytemuck::Pod {
    /// The nearest value to a constant that is written in `f64`.
    fn of(value: f64) -> Self;
    /// This value in `f64`, exactly.
    fn to_double(self) -> f64;
    /// Name as in the `precision` axis: `f32` or `f64`.
    const NAME: &'static str;
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn to_double(self) -> f64 {
        f64::from(self)
    }
    const NAME: &'static str = "f32";
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn to_double(self) -> f64 {
        self
    }
    const NAME: &'static str = "f64";
}
