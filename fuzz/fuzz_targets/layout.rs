#![no_main]
//! Light layouts; what loads is put to use.

use libfuzzer_sys::fuzz_target;
use rigbench::input::Source;
use rigbench::scene::{Layout, OrientedBox};

fuzz_target!(|text: &str| {
    let Ok(mut layout) = Layout::of_source(&Source::inline("fuzzed.toml", text)) else { return };
    if let Some(random) = &mut layout.random {
        (random.layouts, random.lights) = (random.layouts.min(3), random.lights.min(3));
    }
    let bounds = OrientedBox::aligned(Default::default(), [1.0; 3].into());
    for light in layout.instances(&[bounds]).iter().flat_map(|instance| instance.lights_at(1, 3)) {
        assert!(light.bounds().is_none_or(|sphere| sphere.center.is_finite() && sphere.radius >= 0.0));
    }
});
