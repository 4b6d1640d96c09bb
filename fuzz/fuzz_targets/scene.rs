#![no_main]
//! Scene files; what loads is put to use.

use libfuzzer_sys::fuzz_target;
use rigbench::input::Source;
use rigbench::scene::{Pixels, Scene};

fuzz_target!(|text: &str| {
    let Ok(scene) = Scene::of_source(&Source::inline("fuzzed.toml", text)) else { return };
    for receiver in &scene.receivers {
        let bounds = receiver.oriented_box(0);
        assert!(bounds.center.is_finite() && bounds.half.iter().all(|h| h.is_finite() && *h >= 0.0));
        for point in receiver.area_points(scene.frames - 1, 16) {
            assert!(point.position.is_finite() && (point.normal.length() - 1.0).abs() < 1e-9, "{point:?}");
        }
    }
    for hit in Pixels::cast(&scene, 0, 8, 4).hits {
        assert!(hit.point.position.is_finite() && (hit.point.normal.length() - 1.0).abs() < 1e-9);
    }
});
