//! What a bake has taken so far, written down as it goes, so that a bake that was killed goes on from there.

use std::ops::AddAssign;
use std::sync::Arc;

use super::pool::SamplePool;
use crate::probe::SampleRequest;
use crate::trace::Counters;

/// Samples that are taken, and written down, at once: what a killed bake may lose, and what it holds in memory beside the volume.
pub const STRETCH: usize = 64;

/// What some samples took.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Took {
    pub projections: u64,
    pub singular: u64,
    pub rays: Counters,
    pub seconds: f64,
}

impl AddAssign for Took {
    fn add_assign(&mut self, other: Self) {
        self.projections += other.projections;
        self.singular += other.singular;
        self.rays += other.rays;
        self.seconds += other.seconds;
    }
}

/// Some samples of a bake: what they are and what they took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stretch {
    /// Of each sample its value, then its derivatives; f64, so that a bake that goes on has the bits of one that was never killed.
    pub numbers: Vec<f64>,
    pub took: Took,
    /// What each took, where they were taken one by one for a pool: whoever reads the stretch again can give them back to it.
    pub each: Vec<Took>,
}

/// What was asked for in a stretch: where, which derivatives, and how often the volume was lit again before.
pub type Asked = [u8; 32];

/// Keeps the stretches of one bake. A bake asks for the same stretches in the same order however often it is begun.
pub trait Journal: Sync {
    /// The next stretch, if it is kept and answers just this.
    fn recall(&mut self, asked: &Asked) -> Option<Stretch>;
    fn note(&mut self, asked: &Asked, stretch: &Stretch);
    /// Samples that other bakes under the same light have taken, where someone keeps them.
    fn pool(&self) -> Option<Arc<SamplePool>> {
        None
    }
}

/// A journal beside a pool.
pub struct WithPool {
    pub journal: Box<dyn Journal>,
    pub pool: Arc<SamplePool>,
}

impl Journal for WithPool {
    fn recall(&mut self, asked: &Asked) -> Option<Stretch> {
        self.journal.recall(asked)
    }
    fn note(&mut self, asked: &Asked, stretch: &Stretch) {
        self.journal.note(asked, stretch);
    }
    fn pool(&self) -> Option<Arc<SamplePool>> {
        Some(self.pool.clone())
    }
}

/// Keeps nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoJournal;

impl Journal for NoJournal {
    fn recall(&mut self, _asked: &Asked) -> Option<Stretch> {
        None
    }
    fn note(&mut self, _asked: &Asked, _stretch: &Stretch) {}
}

/// The key of a stretch within its bake.
pub fn asked(requests: &[SampleRequest], iteration: u32) -> Asked {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&iteration.to_le_bytes());
    for request in requests {
        for x in request.position {
            hasher.update(&x.to_bits().to_le_bytes());
        }
        hasher.update(&request.derivatives.map(u8::from));
    }
    *hasher.finalize().as_bytes()
}

/// The members of each stretch of `count` samples: every one is spread over all of them, so that a mean over it is near the mean over
/// all, by which errors are judged.
pub fn stretches(count: usize) -> impl Iterator<Item = Vec<usize>> {
    let strides = count.div_ceil(STRETCH);
    (0..strides).map(move |first| (first..count).step_by(strides).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_hold_every_sample_once_and_are_small() {
        for count in [0, 1, 63, 64, 65, 128, 1000] {
            let mut seen: Vec<usize> =
                stretches(count).inspect(|s| assert!((1..=STRETCH).contains(&s.len()))).flatten().collect();
            seen.sort_unstable();
            assert!(seen.into_iter().eq(0..count), "{count}");
        }
    }

    #[test]
    fn what_is_asked_hangs_on_all_of_it() {
        let request = SampleRequest { position: [1.0, 2.0, 3.0], derivatives: [true, false, false] };
        let moved = SampleRequest { position: [1.0, 2.0, 3.0 + 1e-15], ..request };
        let other = SampleRequest { derivatives: [false; 3], ..request };
        assert_eq!(asked(&[request], 0), asked(&[request], 0));
        for different in [asked(&[request], 1), asked(&[moved], 0), asked(&[other], 0), asked(&[request, request], 0)] {
            assert_ne!(asked(&[request], 0), different);
        }
    }
}
