//! Light through the static environment: what blocks it, what reflects it, and how much arrives.
//!
//! Shading is f64, visibility f32 ([`Visibility`]). Every estimate carries its standard error, and its random numbers hang on
//! seed, purpose and place alone, so that it is the same on any thread.

mod effects;
mod geometry;
mod visibility;

pub use effects::{Bounces, Effects, EffectsChoice, SceneFacts};
pub use geometry::{TracedGeometry, TracedMaterial};
pub use visibility::{Hit, Visibility};
