#![no_main]
//! OpenEXR and Radiance pictures; the first byte says of which kind.

use libfuzzer_sys::fuzz_target;
use std::path::Path;

use rigbench::light::EnvironmentMap;
use rigbench::picture::LayeredImage;

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    match kind % 3 {
        0 => drop(EnvironmentMap::of_bytes(Path::new("a.exr"), bytes)),
        1 => drop(EnvironmentMap::of_bytes(Path::new("a.hdr"), bytes)),
        _ => drop(LayeredImage::of_bytes(bytes)),
    }
});
