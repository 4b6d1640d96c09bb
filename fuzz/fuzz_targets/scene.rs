#![no_main]
//! Scene files.

use libfuzzer_sys::fuzz_target;
use rigbench::input::Source;
use rigbench::scene::Scene;

fuzz_target!(|text: &str| {
    if let Ok(scene) = Scene::of_source(&Source::inline("fuzzed.toml", text)) {
        for receiver in &scene.receivers {
            let bounds = receiver.oriented_box(0);
            assert!(bounds.center.is_finite() && bounds.half.iter().all(|h| h.is_finite() && *h >= 0.0));
        }
    }
});
