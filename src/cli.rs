//! The command line of `skysink`: the registry of its commands. A command whose work is in another crate is a file of
//! `cli/`; the others are modules of this crate.

#[cfg(feature = "lab")]
mod export;
#[cfg(feature = "lab")]
mod fleet;
#[cfg(feature = "lab")]
mod library;
mod manual;
#[cfg(feature = "lab")]
mod merge;
#[cfg(feature = "lab")]
mod optimize;
#[cfg(feature = "lab")]
mod plot;
mod report;
#[cfg(feature = "lab")]
mod sweep;

use std::ffi::OsString;
use std::io::ErrorKind;

use clap::{CommandFactory as _, Parser, Subcommand};
use skysink_common::stop::Stop;
use skysink_ring::role::Role;
use skysink_ring::wait::{exit_on_second_signal, stop_on_signals};

#[cfg(feature = "lab")]
use crate::compare;
use crate::error::Error;
use crate::usage::VERSION;
use crate::{check, join, new, replay, run, simulate, topics, usage, view, worker};

/// Plans and flies a UAV that collects data from wireless sensor nodes, slot by slot.
#[derive(Debug, Parser)]
#[command(
    name = "skysink",
    version = VERSION,
    arg_required_else_help = true,
    after_help = "\
Examples:
  skysink run                                the paper's mission
  skysink run scenarios/sparse.toml --strategy gfs --pace 10x --live
  skysink simulate scenarios/letter.toml     the same in one process
  skysink check scenarios/letter.toml        every key and derived figures
  skysink new city --sensors nodes.csv       a scenario with your sensor nodes

The paper is the UTS letter, arXiv 2103.00753.

Exit codes: 0 success, 1 failure while running, 2 bad input or usage, 129 hang-up, 130 Ctrl-C, 143 SIGTERM."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Check(check::CheckCommand),
    New(new::NewCommand),
    Simulate(simulate::SimulateCommand),
    Run(run::RunCommand),
    Join(join::JoinCommand),
    Replay(replay::ReplayCommand),
    Topics(topics::TopicsCommand),
    View(view::ViewCommand),
    Page(view::PageCommand),
    Report(report::ReportCommand),
    #[cfg(feature = "lab")]
    Sweep(sweep::SweepCommand),
    #[cfg(feature = "lab")]
    Plot(plot::PlotCommand),
    #[cfg(feature = "lab")]
    Optimize(optimize::OptimizeCommand),
    #[cfg(feature = "lab")]
    Fleet(fleet::FleetCommand),
    #[cfg(feature = "lab")]
    Compare(compare::CompareCommand),
    #[cfg(feature = "lab")]
    Library(library::LibraryCommand),
    #[cfg(feature = "lab")]
    Merge(merge::MergeCommand),
    #[cfg(feature = "lab")]
    Export(export::ExportCommand),
    Completions(manual::CompletionsCommand),
    Man(manual::ManCommand),
}

impl Command {
    fn run(self, stop: &Stop) -> Result<(), Error> {
        match self {
            Self::Check(command) => command.run(stop),
            Self::New(command) => command.run(stop),
            Self::Simulate(command) => command.run(stop),
            Self::Run(command) => command.run(stop),
            Self::Join(command) => command.run(stop),
            Self::Replay(command) => command.run(stop),
            Self::Topics(command) => command.run(stop),
            Self::View(command) => command.run(stop),
            Self::Page(command) => command.run(stop),
            Self::Report(command) => command.run(stop),
            #[cfg(feature = "lab")]
            Self::Sweep(command) => command.run(stop),
            #[cfg(feature = "lab")]
            Self::Plot(command) => command.run(stop),
            #[cfg(feature = "lab")]
            Self::Optimize(command) => command.run(stop),
            #[cfg(feature = "lab")]
            Self::Fleet(command) => command.run(stop),
            #[cfg(feature = "lab")]
            Self::Compare(command) => command.run(stop),
            #[cfg(feature = "lab")]
            Self::Library(command) => command.run(stop),
            #[cfg(feature = "lab")]
            Self::Merge(command) => command.run(stop),
            #[cfg(feature = "lab")]
            Self::Export(command) => command.run(stop),
            Self::Completions(completions) => completions.run(command()),
            Self::Man(man) => man.run(command()),
        }
    }
}

/// The commands with their options.
#[must_use]
pub fn command() -> clap::Command {
    Cli::command()
}

/// Runs a command line, program name first, and returns its exit code.
#[must_use]
pub fn execute(arguments: Vec<OsString>) -> u8 {
    worker::silence_iceoryx2();
    let stop = stop_on_signals();
    // Installed after the handler that requests the stop, so that the first signal is not lost. The launcher stops the
    // processes of its ring.
    exit_on_second_signal();
    let cli: Cli = match usage::parse(arguments) {
        Ok(cli) => cli,
        Err(message) => return usage::print(Role::Launcher, message),
    };
    match cli.command.run(&stop) {
        Ok(()) => 0,
        Err(Error::Output(error)) if error.kind() == ErrorKind::BrokenPipe => 0, // the reader has closed the pipe
        Err(error) => {
            Role::Launcher.log(&error);
            error.exit_code()
        }
    }
}
