use clap::Args;
use clap_mangen::Man as Page;
use clap_mangen::roff::{Roff, bold, roman};

use super::{Exit, Failure, command, print};

/// Print the manual page (`rigbench man | man -l -`)
#[derive(Debug, Args)]
pub struct Man {}

impl Man {
    pub fn run(self) -> Result<Exit, Failure> {
        print(manual().map_err(Failure::internal)?)?;
        Ok(Exit::Ok)
    }
}

/// One page: the program, then every verb with its options, then the exit codes.
fn manual() -> std::io::Result<Vec<u8>> {
    let mut out = Vec::new();
    let program = command();
    let page = Page::new(program.clone());
    page.render_title(&mut out)?;
    page.render_name_section(&mut out)?;
    page.render_synopsis_section(&mut out)?;
    page.render_description_section(&mut out)?;
    for verb in program.get_subcommands() {
        let name = format!("rigbench {}", verb.get_name());
        let mut heading = Roff::new();
        heading.control("SH", [name.to_uppercase().as_str()]);
        heading.to_writer(&mut out)?;
        let page = Page::new(verb.clone().display_name(&name).bin_name(&name));
        let mut sections = Vec::new();
        page.render_synopsis_section(&mut sections)?;
        page.render_description_section(&mut sections)?;
        if verb.get_arguments().next().is_some() {
            page.render_options_section(&mut sections)?;
        }
        // sections of a verb stand one level below its heading
        out.extend(String::from_utf8_lossy(&sections).replace("\n.SH ", "\n.SS ").into_bytes());
    }
    let mut codes = Roff::new();
    codes.control("SH", ["EXIT STATUS"]);
    let mut numbers = Exit::PRECEDENCE;
    numbers.sort_by_key(|exit| exit.code());
    for exit in numbers {
        codes.control("TP", []);
        codes.text([bold(exit.code().to_string())]);
        codes.text([roman(exit.meaning())]);
    }
    codes.to_writer(&mut out)?;
    Ok(out)
}
