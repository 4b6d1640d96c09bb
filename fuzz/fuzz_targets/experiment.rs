#![no_main]
//! Experiment files of both kinds, in a folder with one scene and one layout.

use std::path::PathBuf;
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use rigbench::experiment::Experiment;
use rigbench::stability::HardCases;

static PLACE: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap().keep();
    std::fs::create_dir_all(folder.join("scenes/lights")).unwrap();
    std::fs::write(
        folder.join("scenes/slab.toml"),
        "schema_version = 1\n[[object]]\nname = \"slab\"\nreceiver = true\n\
         shape = { box = { min = [-1, -1, -1], max = [1, 1, 1] } }\n",
    )
    .unwrap();
    std::fs::write(
        folder.join("scenes/lights/bulb.toml"),
        "schema_version = 1\n[[light]]\npoint = { position = [0, 2, 0], intensity = [1, 1, 1] }\n",
    )
    .unwrap();
    folder.join("fuzzed.toml")
});

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(&*PLACE, bytes).unwrap();
    for why in [Experiment::load(&PLACE).err(), HardCases::load(&PLACE).err()].into_iter().flatten() {
        assert!(!why.message.is_empty());
    }
});
