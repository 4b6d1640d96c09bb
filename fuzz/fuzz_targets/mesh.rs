#![no_main]
//! Meshes; the first byte says of which kind.

use libfuzzer_sys::fuzz_target;
use std::path::Path;

use rigbench::scene::Mesh;

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    let name = ["a.obj", "a.ply", "a.gltf", "a.glb"][usize::from(kind % 4)];
    if let Ok(mesh) = Mesh::of_bytes(Path::new(name), bytes, &mut Vec::new()) {
        assert!(!mesh.triangles.is_empty() && mesh.area() > 0.0);
    }
});
