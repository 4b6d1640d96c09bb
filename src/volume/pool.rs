//! Samples that bakes under the same light have taken, by place: a tree reads what a grid over the same box took, and the other way round.
//! Streams of random numbers hang on the place alone, so that a volume has the same bits with a pool and without.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use glam::DVec3;

use super::journal::Took;

/// A sample with what it took, so that a bake that finds it here counts what it would have taken itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Pooled {
    /// Value, then derivatives.
    pub numbers: Vec<f64>,
    /// Its seconds are its share of those in which it was taken with others.
    pub took: Took,
}

/// Numbers that a pool keeps at most, 1 GB: what comes later is taken whenever it is asked for.
const MOST_NUMBERS: usize = 1 << 27;

type Place = ([u64; 3], bool);

/// All samples of one scene, light, order and way of sampling.
#[derive(Debug, Default)]
pub struct SamplePool {
    known: Mutex<(HashMap<Place, Arc<Pooled>>, usize)>,
}

impl SamplePool {
    fn place(world: DVec3, derivatives: bool) -> Place {
        (world.to_array().map(f64::to_bits), derivatives)
    }

    pub fn get(&self, world: DVec3, derivatives: bool) -> Option<Arc<Pooled>> {
        self.known.lock().expect("no holder panics").0.get(&Self::place(world, derivatives)).cloned()
    }

    pub fn len(&self) -> usize {
        self.known.lock().expect("no holder panics").0.len()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub fn keep(&self, world: DVec3, derivatives: bool, sample: Pooled) {
        let mut known = self.known.lock().expect("no holder panics");
        if known.1 + sample.numbers.len() <= MOST_NUMBERS {
            known.1 += sample.numbers.len();
            known.0.insert(Self::place(world, derivatives), Arc::new(sample));
        }
    }
}
