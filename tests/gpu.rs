//! The GPU against its Rust twins. Every test here runs on an adapter or says aloud that it did not;
//! with RIGBENCH_REQUIRE_GPU=1 the want of an adapter is a failure.

#[path = "gpu/candidates.rs"]
mod candidates;
#[path = "gpu/captures.rs"]
mod captures;
#[path = "gpu/device.rs"]
mod device;
#[path = "gpu/evaluation.rs"]
mod evaluation;
#[path = "gpu/lights.rs"]
mod lights;
#[path = "gpu/projection.rs"]
mod projection;
#[path = "gpu/query.rs"]
mod query;
#[path = "gpu/timing.rs"]
mod timing;
#[path = "gpu/tracing.rs"]
mod tracing;
#[path = "gpu/volume.rs"]
mod volume;

use std::io::Write;
use std::sync::{Mutex, OnceLock, PoisonError};

use rigbench::gpu::{AdapterKind, Gpu};

/// Runs a test on the shared device. A line on standard error, past the test harness's capture, says that it ran and on what,
/// or that it was skipped: `.ci/run` counts the lines.
fn on_gpu(name: &str, test: impl FnOnce(&Gpu)) {
    static GPU: OnceLock<Result<Gpu, rigbench::gpu::NoGpu>> = OnceLock::new();
    // One at a time: a software adapter takes every core, and timings want quiet.
    static TURN: Mutex<()> = Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    match GPU.get_or_init(|| Gpu::open(AdapterKind::Any)) {
        Ok(gpu) => {
            test(gpu);
            let adapter = gpu.adapter();
            let _ = writeln!(std::io::stderr(), "gpu test ran: {name} on {}, {}", adapter.label(), adapter.driver_info);
        }
        Err(error) if std::env::var_os("RIGBENCH_REQUIRE_GPU").is_some_and(|value| value == "1") => {
            panic!("RIGBENCH_REQUIRE_GPU=1 and {error}")
        }
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "gpu test SKIPPED: {name}: {error}");
        }
    }
}
