use std::iter::Sum;
use std::ops::{Add, AddAssign};

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
