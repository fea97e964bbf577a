//! A kinematic copter on a MAVLink connection, to try the bridge without an autopilot.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use skysink_kinematic_vehicle::{KinematicOptions, mission, server};
use skysink_ring::wait::stop_on_signals;

/// A copter without dynamics of its own that behaves towards a ground station as ArduCopter or PX4 does.
#[derive(Debug, Parser)]
struct Cli {
    #[command(flatten)]
    options: KinematicOptions,
    /// Fly the mission of this file (.plan, or QGC WPL 110) without a link, as fast as it can be computed; print how
    /// long it takes.
    #[arg(long, value_name = "FILE")]
    mission: Option<PathBuf>,
}

fn main() -> ExitCode {
    let Cli { options, mission } = Cli::parse();
    let flown = options.check().and_then(|()| match &mission {
        Some(path) => fly(path, &options),
        None => server::serve(&options, &stop_on_signals(), |_, _| {})
            .map_err(|error| format!("{}: {error}", options.connect)),
    });
    match flown {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("kinematic-vehicle: {message}");
            ExitCode::from(2)
        }
    }
}

fn fly(path: &std::path::Path, options: &KinematicOptions) -> Result<(), String> {
    let items = mission::read(path).map_err(|error| error.to_string())?;
    let times = mission::fly(&items, options)?;
    println!("waypoints:             {}", times.waypoints);
    println!("first to last [s]:     {:.1}", times.waypoints_s);
    println!("arming to landing [s]: {:.1}", times.whole_s);
    Ok(())
}
