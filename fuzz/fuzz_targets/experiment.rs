#![no_main]
//! Experiment files of both kinds, in a folder with one scene and one layout.

use libfuzzer_sys::fuzz_target;
use rigbench::experiment::Experiment;
use rigbench::stability::HardCases;

fuzz_target!(|bytes: &[u8]| {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("scenes/lights")).unwrap();
    std::fs::write(
        folder.path().join("scenes/slab.toml"),
        "schema_version = 1\n[[object]]\nname = \"slab\"\nreceiver = true\n\
         shape = { box = { min = [-1, -1, -1], max = [1, 1, 1] } }\n",
    )
    .unwrap();
    std::fs::write(
        folder.path().join("scenes/lights/bulb.toml"),
        "schema_version = 1\n[[light]]\npoint = { position = [0, 2, 0], intensity = [1, 1, 1] }\n",
    )
    .unwrap();
    let path = folder.path().join("fuzzed.toml");
    std::fs::write(&path, bytes).unwrap();
    let _ = Experiment::load(&path);
    let _ = HardCases::load(&path);
});
