//! `rigbench doctor`: what is here, what is missing and how to get it.

use std::fmt::Write;
use std::process::Command;

use clap::Args;

use super::{Exit, Failure, print};
use crate::cost::{processor_name, software_versions};
use crate::gpu::{AdapterKind, Gpu};

/// Tell which adapters, features and tools are here, what is missing and how to get it
#[derive(Args, Debug)]
pub struct Doctor {}

/// Tools of other packages that only the tests need: name, package of Debian, what for.
const TOOLS: [(&str, &str, &str); 2] = [
    ("exrheader", "openexr", "the tests read written images with it"),
    ("exrinfo", "openexr", "the tests read written images with it"),
];

impl Doctor {
    pub fn run(self) -> Result<Exit, Failure> {
        let mut text = String::new();
        let broken = "a string takes every line";
        for (name, version) in software_versions() {
            writeln!(text, "{name}: {version}").expect(broken);
        }
        writeln!(text, "processor: {}", processor_name()).expect(broken);
        writeln!(text, "threads: {}", rayon::current_num_threads()).expect(broken);
        #[cfg(target_arch = "x86_64")]
        {
            let wide =
                if is_x86_feature_detected!("avx2") { "AVX2 code is used" } else { "no AVX2: portable code is used" };
            writeln!(text, "vector code: {wide}").expect(broken);
        }
        let adapters = Gpu::adapters();
        for adapter in &adapters {
            writeln!(text, "adapter: {}, driver {}", adapter.label(), adapter.driver).expect(broken);
        }
        match Gpu::open(AdapterKind::Any) {
            Ok(gpu) => {
                writeln!(text, "opened: {}", gpu.adapter().label()).expect(broken);
                writeln!(text, "features: {:?}", gpu.adapter().features).expect(broken);
                writeln!(text, "limits: {:?}", gpu.adapter().limits).expect(broken);
                if gpu.adapter().software {
                    writeln!(text, "note: a software adapter; its times say nothing about a GPU").expect(broken);
                }
            }
            Err(why) => writeln!(text, "no usable GPU: {why}").expect(broken),
        }
        for (tool, package, purpose) in TOOLS {
            let found = Command::new(tool).arg("--help").output().is_ok();
            let state =
                if found { "found".to_owned() } else { format!("missing: apt-get install {package} ({purpose})") };
            writeln!(text, "{tool}: {state}").expect(broken);
        }
        print(text)?;
        Ok(Exit::Ok)
    }
}
