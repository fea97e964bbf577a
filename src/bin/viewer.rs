//! Everything to rerun, as a process of the ring.

use std::num::NonZeroU64;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use iceoryx2::prelude::ipc;
use skysink::usage;
use skysink::worker::{self, RingArguments};
use skysink_common::stop::Stop;
use skysink_ring::error::NodeError;
use skysink_ring::role::Role;
use skysink_ring::wait::stop_on_signals;
use skysink_viewer::Sinks;
use skysink_viewer::node::run;

/// Records a run that skysink run supervises.
#[derive(Debug, Parser)]
#[command(version)]
#[group(id = "sinks", required = true, multiple = true, args = ["save", "live"])]
struct Cli {
    #[command(flatten)]
    place: RingArguments,
    /// Write the recording to this file, or to the next of FILE-2, FILE-3 ... if it is begun.
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    /// Serve it live on 127.0.0.1.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "9876")]
    live: Option<u16>,
    /// Draw one slot in so many, the first, the last and what happens in between.
    #[arg(long, value_name = "SLOTS")]
    record_every: Option<NonZeroU64>,
    /// What the mission of an outside planner is booked as.
    #[arg(long, value_name = "NAME")]
    label: Option<String>,
}

fn main() -> ExitCode {
    let cli: Cli = usage::parse(std::env::args_os()).unwrap_or_else(|message| message.exit());
    // What rerun has to say would be lost otherwise.
    tracing_subscriber::fmt()
        .with_max_level(tracing_subscriber::filter::LevelFilter::WARN)
        .with_writer(std::io::stderr)
        .init();
    let stop = stop_on_signals();
    let ended = record(&cli, &stop);
    worker::exit(Role::Viewer, ended).into()
}

fn record(cli: &Cli, stop: &Stop) -> Result<(), NodeError> {
    let (scenario, folder) = worker::join(&cli.place)?;
    let sinks = Sinks { save: cli.save.clone(), live: cli.live, every: cli.record_every };
    let estimated = skysink_planner::settings::estimated(&scenario)?;
    let missed = run::<ipc::Service>(&scenario, &folder, stop, &sinks, cli.label.as_deref(), estimated)?;
    if missed > 0 {
        Role::Viewer.log(format_args!("missed {missed} slots, marked in the recording"));
    }
    Ok(())
}
