//! `skysink completions` and `skysink man`: shell completions and man pages, generated from the command line
//! definition.

use std::fs;
use std::io::{self, Write as _};
use std::path::PathBuf;

use clap::{Args, Command};
use clap_complete::Shell;
use skysink_mission::error::FileContext;

use crate::error::Error;
use crate::report::print;

/// Print a completion script for a shell.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink completions bash > ~/.local/share/bash-completion/completions/skysink
  skysink completions zsh > ~/.zfunc/_skysink    a folder of $fpath
  skysink completions fish > ~/.config/fish/completions/skysink.fish")]
pub struct CompletionsCommand {
    /// Shell.
    shell: Shell,
}

impl CompletionsCommand {
    /// Prints the completion script of the command line `skysink`.
    pub fn run(self, mut skysink: Command) -> Result<(), Error> {
        let mut text = Vec::new(); // clap_complete panics on a closed pipe
        clap_complete::generate(self.shell, &mut skysink, "skysink", &mut text);
        io::stdout().write_all(&text).map_err(Error::Output)
    }
}

/// Write a man page for each command.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink man ~/.local/share/man/man1    then: man skysink-run")]
pub struct ManCommand {
    /// Output folder; created if missing.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl ManCommand {
    /// Writes the man pages of the command line `skysink`.
    pub fn run(self, skysink: Command) -> Result<(), Error> {
        let Self { folder } = self;
        fs::create_dir_all(&folder).at(&folder)?;
        clap_mangen::generate_to(skysink, &folder).at(&folder)?;
        print(format_args!("Man pages: {}", folder.join("skysink.1").display()))
    }
}
