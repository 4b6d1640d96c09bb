//! The command line: one file a verb, and one line in [`verbs!`] below.
//!
//! Data goes to stdout, all else to stderr. A verb is a struct of arguments (clap) with `fn run(self) -> Result<Exit, Failure>`.

mod check;
mod compare;
mod completions;
mod doctor;
mod exit;
mod figures;
mod hard_cases;
mod man;
mod merge;
mod metrics;
mod plan;
mod query;
mod recommend;
mod report;
mod run;
mod schema;
mod selection;
mod worker;

pub use exit::{Exit, Failure};
pub use selection::{Selected, Selection};

use std::io::Write;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

/// Measures what each way of lighting dynamic objects with probes buys for its cost.
#[derive(Debug, Parser)]
#[command(name = "rigbench", version, arg_required_else_help = true, disable_help_subcommand = true)]
pub struct CommandLine {
    #[command(subcommand)]
    verb: Verb,
}

/// Declares the verbs: a variant each, forwarded to the struct of its file.
macro_rules! verbs {
    ($($verb:ident => $module:ident),+ $(,)?) => {
        #[derive(Debug, Subcommand)]
        enum Verb {
            $($verb($module::$verb)),+
        }

        impl Verb {
            fn run(self) -> Result<Exit, Failure> {
                match self {
                    $(Verb::$verb(verb) => verb.run()),+
                }
            }
        }
    };
}

verbs! {
    Plan => plan,
    Run => run,
    Check => check,
    Compare => compare,
    Merge => merge,
    Query => query,
    Report => report,
    Figures => figures,
    Metrics => metrics,
    Recommend => recommend,
    Doctor => doctor,
    Schema => schema,
    Completions => completions,
    Man => man,
    Worker => worker,
    Task => worker,
}

/// The whole command line, for completions, the manual and tests.
pub fn command() -> clap::Command {
    CommandLine::command()
}

/// The program: parses the arguments, runs the verb, says on stderr what went wrong.
pub fn main() -> ExitCode {
    log_to_stderr();
    let line = match CommandLine::try_parse() {
        Ok(line) => line,
        Err(error) => {
            // help and version go to stdout and are no error
            let _ = error.print();
            return ExitCode::from(error.exit_code() as u8);
        }
    };
    // a panic must not leave with Rust's own 101, which is a regression here
    let exit = match std::panic::catch_unwind(|| line.verb.run()) {
        Ok(Ok(exit)) => exit,
        Ok(Err(failure)) => {
            eprintln!("error: {failure}");
            failure.exit
        }
        Err(_) => Exit::Internal,
    };
    ExitCode::from(exit.code())
}

/// Writes data to stdout. A reader that has gone away (`rigbench plan ... | head`) is no error.
pub(crate) fn print(data: impl AsRef<[u8]>) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(data.as_ref()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::internal(format!("stdout: {error}")))
        }
        _ => Ok(()),
    }
}

/// Log lines go to stderr; `RIGBENCH_LOG` sets what is shown (`RIGBENCH_LOG=debug`). The graphics crates are noisy and kept low.
fn log_to_stderr() {
    use tracing_subscriber::EnvFilter;
    let filter = EnvFilter::try_from_env("RIGBENCH_LOG")
        .unwrap_or_else(|_| EnvFilter::new("warn,rigbench=info,wgpu_core=error,wgpu_hal=error,naga=error"));
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_target(false)
        .without_time()
        .try_init();
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_command_line_is_well_formed() {
        super::command().debug_assert();
    }
}
