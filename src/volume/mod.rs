//! Irradiance volumes: rigs over a whole scene. A grid, a two-level grid or octrees of cells hold probe samples at their corners, and
//! moving objects read them by interpolation.
//!
//! A volume is linear in its samples like every rig: [`VolumeModel`] gives the weights at a place. What makes it more than a rig is its
//! bake ([`bake()`]): where samples stand may hang on what other samples saw ([`Criterion`]).
//!
//! Adding a heuristic is a variant of [`Criterion`], its key in `heuristic.rs` and what it says in `bake.rs`.

mod bake;
mod cells;
mod config;
mod forest;
mod heuristic;
mod journal;
mod model;
mod overlap;
mod pool;
mod section;
mod shader;

pub use bake::{
    BakeCounts, BakeError, BakedVolume, FaceJump, Layout, bake, bake_along, bake_with, resample, rms_over_normals,
};
pub use cells::{Cell, Cells, Face, LEAF, Locator, NONE, Place};
pub use config::{Bounds, Lookup, Structure, Volume, VolumeFile, VolumeSetting};
pub use heuristic::{Criterion, Evidence, Heuristic, HeuristicFile};
pub use journal::{Asked, Journal, NoJournal, STRETCH, Stretch, Took, WithPool};
pub use model::{Across, CellModel, VolumeModel, can_be_continuous};
pub use overlap::{NearestSurface, triangle_overlaps_box};
pub use pool::{Pooled, SamplePool};
pub use section::Section;
pub use shader::CellShader;
