//! Hard cases: families of small scenes that approach a singularity by a parameter, and what single precision, the GPU and the formulas
//! themselves make of them.
//!
//! A family is a table of a TOML file: lights, a box, points and perhaps rigs, any number of which may be an expression of the parameter
//! (`"=1 + t"`). For every value of the parameter, model (a rig, or `direct`) and order, [`measure`] compares `f32` with `f64`, `f64` with
//! an independent route ([`light_integrals`], [`rig_definitions`]), and the naive formulas ([`naive`]) with `f64`.

mod double_double;
mod expression;
mod file;
mod light_integrals;
mod measure;
mod naive;
mod rig_definitions;

pub use expression::Expression;
pub use file::{Bound, CHOICES, Case, Family, HardCases, Model, Place, is_stability};
pub use light_integrals::{Sample, irradiance as independent_irradiance, sample as independent_sample};
pub use measure::{COLUMNS, Curve, CurveId, Measured, curves};
