use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use glam::DVec3;
use serde_json::json;

use crate::candidate::Recipe;
use crate::experiment::{Candidate, Key};
use crate::light::Light;
use crate::probe::Prober;
use crate::trace::Transport;
use crate::volume::{BakedVolume, Structure, bake_along};

/// The volumes of a sweep, each baked once: numbers, times and images share them, and so do the candidates that read one differently
/// or on another backend.
#[derive(Default)]
pub struct Bakery {
    baked: Mutex<HashMap<Key, Result<Arc<BakedVolume>, String>>>,
}

impl Bakery {
    /// The recipe with the volume of its candidate, where the rig is one. A volume that is not there yet is baked now, with all threads:
    /// ask for volumes one after the other, so that the seconds of a bake are its own.
    pub fn stock(
        &self,
        recipe: Recipe,
        candidate: &Candidate,
        lights: &[Light<f64>],
        transport: Option<&Transport>,
    ) -> Result<Recipe, String> {
        let Some(volume) = candidate.volume() else { return Ok(recipe) };
        let key = Key::of(&json!({
            "volume": **volume,
            "scene": candidate.scene.content,
            "lights": candidate.lights.name(),
            "layout": candidate.lights.layout.content,
            "frame": candidate.freeze_frame(),
            "order": recipe.order,
            "probes": format!("{:?}", recipe.probes),
            "gradients": recipe.gradients,
            "window": recipe.window,
        }));
        let known = self.baked.lock().expect("no holder panics").get(&key).cloned();
        let baked = match known {
            Some(known) => known,
            None => {
                let made = volume.bounds.resolve(&candidate.scene).and_then(|bounds| {
                    let prober = Prober {
                        bounds,
                        order: recipe.order,
                        lights,
                        transport,
                        probes: recipe.probes,
                        gradients: recipe.gradients,
                        window: recipe.window,
                    };
                    let tracks: Vec<DVec3> = match volume.structure {
                        Structure::Path { samples } => candidate
                            .scene
                            .receivers
                            .iter()
                            .filter(|receiver| receiver.mesh.is_some())
                            .flat_map(|receiver| (0..samples).map(|k| receiver.center_along(k, samples)))
                            .collect(),
                        _ => Vec::new(),
                    };
                    bake_along(volume, &prober, &tracks).map(Arc::new).map_err(|error| error.to_string())
                });
                self.baked.lock().expect("no holder panics").insert(key, made.clone());
                made
            }
        }?;
        Ok(Recipe { volume: Some(baked), ..recipe })
    }
}
