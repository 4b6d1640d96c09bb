//! Scalars, vectors, colours, quadrature and random streams: what the lighting mathematics is written in.
//!
//! glam's vectors are tied to one scalar type each. The formulas of this crate must run in `f32` and in `f64`
//! from one text (a precision difference is then rounding and nothing else), so they use [`Vector3`];
//! scene handling, which is `f64` only, uses glam.

mod quadrature;
mod random;
mod real;
mod rgb;
mod vector;

pub use quadrature::{GaussLegendre, gauss_legendre};
pub use random::{Stream, StreamPurpose};
pub use real::Real;
pub use rgb::{Irradiance, Radiance, Rgb};
pub use vector::Vector3;
