use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use serde_json::json;

use super::{BakeLog, Store, StoreError};
use crate::candidate::{GpuBench, Probes, Recipe, probe_device};
use crate::experiment::{ALGORITHMS, Candidate, Key};
use crate::light::Light;
use crate::probe::Prober;
use crate::trace::Transport;
use crate::volume::{BakedVolume, Journal, NoJournal, SamplePool, Volume, WithPool, bake_with};

/// The lights of a frame, and the static environment under them where there is one.
pub struct Surrounded<'a> {
    pub lights: &'a [Light<f64>],
    pub transport: Option<Transport<'a>>,
}

/// The volumes of a sweep, each baked once for all candidates of a scene under a layout, which may read one differently or on another
/// backend. Volumes under the same light share the samples that stand at the same place. What another scene or layout needed is dropped
/// when the next one comes: memory is that of one block of a sweep.
///
/// Samples by rays are written down as they are taken ([`BakeLog`]), so that a sweep that was killed, and another process of this one, goes on
/// with them. A sweep that comes to its end removes the logs.
pub struct Bakery {
    shelf: Mutex<Shelf>,
    logs: PathBuf,
}

/// What is there of a scene under a layout.
#[derive(Default)]
struct Shelf {
    of: Option<Key>,
    baked: HashMap<Key, Result<Arc<BakedVolume>, String>>,
    /// Samples under one light each (a frame's), whatever volume asked for them.
    pools: HashMap<Key, Arc<SamplePool>>,
}

impl Bakery {
    /// Its logs lie beside the runs of a store.
    pub fn of(store: &Store) -> Self {
        Self { shelf: Mutex::default(), logs: logs(store) }
    }

    /// Removes the logs of every bake for a store: what came of them is kept, or is not wanted any more.
    pub fn clear(store: &Store) -> Result<(), StoreError> {
        let folder = logs(store);
        match std::fs::remove_dir_all(&folder) {
            Err(cause) if cause.kind() != std::io::ErrorKind::NotFound => {
                Err(StoreError::new(&folder, "remove the folder", cause))
            }
            _ => Ok(()),
        }
    }

    /// The recipe with the volume of its candidate, where the rig is one: that of the frozen frame, that of all frames where no light
    /// moves, else one a frame. `frames` are the lights of every frame; `only`: what one frame reads, no more. A volume that is not there
    /// yet is baked now, with all threads: ask for volumes one after the other, so that the seconds of a bake are its own.
    pub fn stock(
        &self,
        recipe: Recipe,
        candidate: &Candidate,
        frames: &[Surrounded],
        only: Option<usize>,
        gpu: Option<&GpuBench>,
    ) -> Result<Recipe, String> {
        let Some(volume) = candidate.volume() else { return Ok(recipe) };
        self.clear_for(Key::of(&json!([
            candidate.scene.content,
            candidate.lights.name(),
            candidate.lights.layout.content
        ])));
        let moves = candidate.lights_move();
        let wanted: Vec<usize> = match (candidate.freeze_frame(), only) {
            (Some(frame), _) => vec![frame],
            (None, _) if !moves => vec![0],
            (None, Some(frame)) => vec![frame],
            (None, None) => (0..frames.len()).collect(),
        };
        let bake = |frame: &usize| self.baked(&recipe, candidate, volume, *frame, &frames[*frame], gpu);
        let baked: Vec<Arc<BakedVolume>> = wanted.iter().map(bake).collect::<Result<_, String>>()?;
        let every_frame = moves && candidate.freeze_frame().is_none();
        Ok(Recipe {
            volume: baked.first().cloned(),
            volume_of_frame: if wanted.len() > 1 { baked } else { Vec::new() },
            volume_every_frame: every_frame,
            ..recipe
        })
    }

    /// Drops what stands on the shelf for others.
    fn clear_for(&self, block: Key) {
        let mut shelf = self.shelf.lock().expect("no holder panics");
        if shelf.of != Some(block) {
            *shelf = Shelf { of: Some(block), ..Shelf::default() };
        }
    }

    /// A candidate's volume under the lights of a frame.
    fn baked(
        &self,
        recipe: &Recipe,
        candidate: &Candidate,
        volume: &Volume,
        frame: usize,
        around: &Surrounded,
        gpu: Option<&GpuBench>,
    ) -> Result<Arc<BakedVolume>, String> {
        let Surrounded { lights, transport } = around;
        let light = json!({
            "scene": candidate.scene.content,
            "lights": candidate.lights.name(),
            "layout": candidate.lights.layout.content,
            "frame": candidate.lights_move().then_some(frame),
            "effects": transport.as_ref().map(|transport| transport.effects().to_string()),
            "order": recipe.order,
            "probes": format!("{:?}", recipe.probes),
            "gradients": recipe.gradients,
            "window": recipe.window,
            "algorithms": ALGORITHMS.candidate,
        });
        let key = Key::of(&json!([volume, light]));
        if let Some(known) = self.shelf.lock().expect("no holder panics").baked.get(&key) {
            return known.clone();
        }
        let made = volume.bounds.resolve(&candidate.scene).and_then(|bounds| {
            let transport = transport.as_ref();
            let mut prober = Prober {
                bounds,
                order: recipe.order,
                lights,
                transport,
                device: None,
                probes: recipe.probes,
                gradients: recipe.gradients,
                window: recipe.window,
            };
            let device = probe_device(recipe.probes, prober.sampled(), gpu).map_err(|error| error.to_string())?;
            prober.device = device.as_deref();
            // derivatives go along the box's axes
            let under = Key::of(&json!([format!("{:?}", bounds.axes), light]));
            let pool = self.shelf.lock().expect("no holder panics").pools.entry(under).or_default().clone();
            let mut journal = WithPool { journal: self.journal(&key, &prober), pool };
            let tracks = volume.tracks(&candidate.scene);
            bake_with(volume, &prober, &tracks, &mut journal).map(Arc::new).map_err(|error| error.to_string())
        });
        if let Ok(volume) = &made {
            let counts = volume.counts;
            if counts.recalled > 0 && counts.recalled < counts.taken {
                eprintln!(
                    "{}: went on with a bake that was cut short: {} of its {} samples were there",
                    candidate.label(),
                    counts.recalled,
                    counts.taken
                );
            }
        }
        self.shelf.lock().expect("no holder panics").baked.insert(key, made.clone());
        made
    }

    /// The log of a bake by rays; what is computed faster than it is read, and what cannot be written down, has none.
    fn journal(&self, key: &Key, prober: &Prober) -> Box<dyn Journal> {
        if prober.sampled().is_none() || prober.probes == Probes::Analytic {
            return Box::new(NoJournal);
        }
        match BakeLog::open(&self.logs, key) {
            Ok(log) => Box::new(log),
            Err(error) => {
                tracing::warn!("the samples of this bake are not kept: {error}");
                Box::new(NoJournal)
            }
        }
    }
}

/// The folder of the logs.
fn logs(store: &Store) -> PathBuf {
    Path::join(store.root(), "bakes")
}
