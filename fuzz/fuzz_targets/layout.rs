#![no_main]
//! Light layouts.

use libfuzzer_sys::fuzz_target;
use rigbench::input::Source;
use rigbench::scene::Layout;

fuzz_target!(|text: &str| {
    let _ = Layout::of_source(&Source::inline("fuzzed.toml", text));
});
