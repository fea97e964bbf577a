//! The viewer process of the ring: writes the rerun recording.

use std::ffi::OsString;
use std::num::NonZeroU64;
use std::path::PathBuf;

use clap::Parser;
use iceoryx2::prelude::ipc;
use skysink_common::stop::Stop;
use skysink_ring::error::NodeError;
use skysink_ring::role::Role;
use skysink_ring::wait::stop_on_signals;
use skysink_viewer::Sinks;
use skysink_viewer::node::{ViewerOptions, run};

use crate::usage;
use crate::worker::{self, RingArguments};

/// The viewer process of the ring: records a run for rerun; skysink run starts and supervises it.
#[derive(Debug, Parser)]
#[command(version = usage::VERSION)]
#[group(id = "sinks", required = true, multiple = true, args = ["save", "live"])]
struct Cli {
    #[command(flatten)]
    ring: RingArguments,
    /// Write the recording to this file; if it exists, to FILE-2, FILE-3 and so on.
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    /// Serve the recording live on 127.0.0.1, on PORT or 9876.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "9876")]
    live: Option<u16>,
    /// Record only every K-th slot, and always the first, the last and all events [default: 1].
    #[arg(long, value_name = "K")]
    record_every: Option<NonZeroU64>,
    /// Name of the external planner in the recording.
    #[arg(long, value_name = "NAME")]
    label: Option<String>,
}

/// Runs viewer with these arguments, program name first, and returns its exit code.
#[must_use]
pub fn viewer(arguments: Vec<OsString>) -> u8 {
    let cli: Cli = match usage::parse(arguments) {
        Ok(cli) => cli,
        Err(message) => return usage::print(Role::Viewer, message),
    };
    // Without a subscriber, warnings of rerun would be lost.
    tracing_subscriber::fmt()
        .with_max_level(tracing_subscriber::filter::LevelFilter::WARN)
        .with_writer(std::io::stderr)
        .init();
    let stop = stop_on_signals();
    let result = record(&cli, &stop);
    worker::exit_code(Role::Viewer, result, &stop)
}

fn record(cli: &Cli, stop: &Stop) -> Result<(), NodeError> {
    let (scenario, folder) = worker::join(&cli.ring)?;
    let options = ViewerOptions {
        sinks: Sinks { save: cli.save.clone(), live: cli.live, every: cli.record_every },
        label: cli.label.clone(),
        estimated: skysink_planner::settings::estimated(&scenario)?,
    };
    let missed = run::<ipc::Service>(&scenario, &folder, stop, &options)?;
    if missed > 0 {
        Role::Viewer.log(format_args!("missed {missed} slots, marked in the recording"));
    }
    Ok(())
}
