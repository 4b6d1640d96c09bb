use clap::Args;
use clap_complete::Shell;

use super::{Exit, Failure, command, print};

/// Print the completion script of a shell
#[derive(Debug, Args)]
pub struct Completions {
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

impl Completions {
    pub fn run(self) -> Result<Exit, Failure> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut command(), "rigbench", &mut script);
        print(script)?;
        Ok(Exit::Ok)
    }
}
