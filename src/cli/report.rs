//! `skysink report`: prints the results of a finished run again, as its trace leads to them.

use std::path::PathBuf;

use clap::Args;
use skysink_common::stop::Stop;
use skysink_mission::Replay;
use skysink_mission::record::RunFolder;
use skysink_mission::sensor_results::{self, SensorTally};

use crate::error::Error;
use crate::report::{print, print_run};
use crate::unflown::warn_of_run;

/// Print the results of a run, simulated again from its trace.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink report runs/letter-uts-1
  skysink report runs/letter-uts-1 --sensors   also per sensor node")]
pub struct ReportCommand {
    /// Run folder.
    #[arg(value_name = "RUN")]
    folder: PathBuf,
    /// Write sensors_out.csv into the run folder: bits lost and delivered, service ages and service gaps of each
    /// sensor node.
    #[arg(long)]
    sensors: bool,
    /// Print summary.json, without its check value, instead of the table.
    #[arg(long)]
    json: bool,
}

impl ReportCommand {
    /// Prints the results, and writes those of each sensor node.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let folder = RunFolder::open_to_read(&self.folder)?;
        let mut replay = Replay::open(&self.folder)?;
        let mut sensors = self.sensors.then(|| SensorTally::new(replay.list().sensors().len()));
        match &mut sensors {
            Some(sensors) => replay.drive(&mut [sensors], stop)?,
            None => replay.add_up(stop)?,
        }
        let summary = replay.summary();
        warn_of_run(summary, replay.scenario());
        if self.json {
            print(serde_json::to_string_pretty(summary).expect("plain numbers and strings"))?;
        } else {
            print_run(&folder, summary)?;
        }
        if let Some(sensors) = sensors {
            let file = sensor_results::write(&self.folder, &replay, &sensors)?;
            if !self.json {
                print(format_args!("Sensor nodes:    {}", file.display()))?;
            }
        }
        Ok(())
    }
}
