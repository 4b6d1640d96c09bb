//! rigbench measures what each way of lighting dynamic objects with probes buys for its cost.
//!
//! Modules stand in one order, and a module uses only modules above it (`tests/architecture.rs` holds that):
//! knowledge, catalogue, flow. ARCHITECTURE.md has the picture.

// Knowledge: quantities, spherical harmonics, lights, scenes, rays.
pub mod input;
pub mod output;
pub mod light;
pub mod math;
pub mod picture;
pub mod scene;
pub mod trace;
pub mod probe;
pub mod sh;

// Catalogue: what can be measured and how.
pub mod metric;
pub mod rig;
pub mod volume;
pub mod cost;

// Flow: from an experiment to results.
pub mod experiment;
pub mod gpu;
pub mod reference;
pub mod candidate;
pub mod stability;
pub mod run;
pub mod figure;
pub mod gate;
pub mod report;
pub mod cli;
