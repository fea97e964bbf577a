//! Shell completions and man pages, both generated from the command line definition.

use std::fs;
use std::io;
use std::path::PathBuf;

use clap::{CommandFactory, Subcommand};
use clap_complete::Shell;
use skysink_mission::error::FileContext;

use super::Cli;
use crate::error::Error;
use crate::report::print;

/// Commands that document the command line.
#[derive(Debug, Subcommand)]
pub enum Manual {
    /// Print a completion script for a shell.
    #[command(after_help = "\
Examples:
  skysink completions bash > ~/.local/share/bash-completion/completions/skysink
  skysink completions zsh > ~/.zfunc/_skysink    a folder of $fpath
  skysink completions fish > ~/.config/fish/completions/skysink.fish")]
    Completions {
        /// Shell.
        shell: Shell,
    },
    /// Write a man page for each command.
    #[command(after_help = "\
Examples:
  skysink man ~/.local/share/man/man1    then: man skysink-run")]
    Man {
        /// Output folder; created if missing.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

impl Manual {
    /// Writes the completion script or the man pages.
    ///
    /// # Errors
    /// If the output cannot be written.
    pub fn write(self) -> Result<(), Error> {
        let mut command = Cli::command();
        match self {
            Self::Completions { shell } => {
                let mut text = Vec::new(); // clap_complete panics on a closed pipe
                clap_complete::generate(shell, &mut command, "skysink", &mut text);
                io::Write::write_all(&mut io::stdout(), &text).map_err(Error::Output)
            }
            Self::Man { folder } => {
                fs::create_dir_all(&folder).at(&folder)?;
                clap_mangen::generate_to(command, &folder).at(&folder)?;
                print(format_args!("Man pages: {}", folder.join("skysink.1").display()))
            }
        }
    }
}
