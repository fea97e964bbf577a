//! `skysink export`: arguments.

use clap::Args;
use skysink_common::stop::Stop;
use skysink_lab::export::{Export, export};

use crate::error::Error;
use crate::report::print;

/// Convert a finished run to a format for maps, log viewers, ground stations or tables.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink export runs/chicago-uts-1 --format geojson
  skysink export runs/letter-uts-1 --format geojson --origin 47.3977,8.5456 \\
    --north true
  skysink export runs/farm-tour-1 --format qgc-plan --min-bits 1000

Vehicle missions (qgc-plan, waypoints, dji) are refused if a part takes longer
than uav.endurance_s, or more energy than uav.battery has, or if UAVs of a fleet
come within uav.separation_m. They assume still air. No aircraft has flown a
file of dji. The pilot in command is responsible.")]
pub struct ExportCommand {
    #[command(flatten)]
    export: Export,
}

impl ExportCommand {
    /// Writes the files and prints a summary of their content.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let exported = export(&self.export, stop)?;
        print(&exported.summary)?;
        exported.files.iter().try_for_each(|file| print(file.display()))
    }
}
