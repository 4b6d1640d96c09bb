//! Light through the static environment: what blocks it, what reflects it, and how much arrives.
//!
//! [`Tracer`] is the static geometry ready for rays, [`Transport`] that geometry under lights and [`Effects`]; it estimates irradiance
//! at surface points and SH radiance at points of space. Shading is f64, visibility f32 ([`Visibility`]). Every estimate carries
//! its standard error, and its random numbers hang on seed, purpose and place alone, so that it is the same on any thread.

mod capture;
mod counters;
mod effects;
mod emitters;
mod estimate;
mod gather;
mod geometry;
mod light_choice;
mod sampler;
mod transport;
mod visibility;

pub use capture::{Capture, CapturePlace, DepthSums, Depths, Reflected};
pub use counters::{CastRay, Counters};
pub use effects::{Bounces, Effects, EffectsChoice, SceneFacts};
pub use estimate::{Effort, Estimate, Projected, Seed};
pub use gather::SILHOUETTE_COSINE;
pub(crate) use gather::{Arrival, Gather, Origin, ProjectionGather};
pub use geometry::{TracedGeometry, TracedMaterial};
pub(crate) use light_choice::LightChoice;
pub use transport::{Sight, Tracer, Transport};
pub use visibility::{Hit, Visibility};
