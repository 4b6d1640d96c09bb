use std::iter::Sum;
use std::ops::{Add, AddAssign};

use glam::DVec3;

/// What was computed, counted where it is computed: what an effect costs, and proof that one left out cost nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Counters {
    /// Rays for the nearest surface.
    pub closest_rays: u64,
    /// Rays that ask whether a light or an emitter is seen.
    pub shadow_rays: u64,
    /// Reflections: surface points that a path reached and at which light was gathered to be reflected.
    pub bounces: u64,
    /// Samples of emissive geometry.
    pub emitter_samples: u64,
    /// Evaluations of a receiver's lobe that is not the clamped cosine.
    pub wrap_evaluations: u64,
    /// Gradient terms whose 1/cos at a silhouette was clamped, and all such terms.
    pub clamped_gradients: u64,
    pub gradient_terms: u64,
    /// Texels of captures.
    #[serde(default)]
    pub texels: u64,
    /// Faces of captures that were rasterised: the geometry was drawn once for each.
    #[serde(default)]
    pub draws: u64,
}

/// A ray that was cast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CastRay {
    pub origin: DVec3,
    /// Unit.
    pub direction: DVec3,
    /// Metres within which anything at all was asked for; `None`: the nearest surface was.
    pub within: Option<f64>,
}

/// Looks on while an estimate is made.
pub(super) trait Observer {
    fn counters(&mut self) -> &mut Counters;
    fn ray(&mut self, _ray: CastRay) {}
}

impl Observer for Counters {
    #[inline(always)]
    fn counters(&mut self) -> &mut Counters {
        self
    }
}

/// Counts, and keeps every ray.
#[derive(Debug, Default)]
pub(super) struct RayLog {
    pub rays: Vec<CastRay>,
    counters: Counters,
}

impl Observer for RayLog {
    fn counters(&mut self) -> &mut Counters {
        &mut self.counters
    }
    fn ray(&mut self, ray: CastRay) {
        self.rays.push(ray);
    }
}

impl Counters {
    pub fn rays(&self) -> u64 {
        self.closest_rays + self.shadow_rays
    }
}

impl AddAssign for Counters {
    fn add_assign(&mut self, other: Self) {
        self.closest_rays += other.closest_rays;
        self.shadow_rays += other.shadow_rays;
        self.bounces += other.bounces;
        self.emitter_samples += other.emitter_samples;
        self.wrap_evaluations += other.wrap_evaluations;
        self.clamped_gradients += other.clamped_gradients;
        self.gradient_terms += other.gradient_terms;
        self.texels += other.texels;
        self.draws += other.draws;
    }
}

impl Add for Counters {
    type Output = Self;
    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

impl Sum for Counters {
    fn sum<I: Iterator<Item = Self>>(counters: I) -> Self {
        counters.fold(Self::default(), Add::add)
    }
}
