//! `skysink export`: arguments.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use skysink_common::scenario::Origin;
use skysink_common::stop::Stop;
use skysink_lab::export::vehicle::MIN_ITEMS;
use skysink_lab::export::{Export, ExportFormat, FORMATS, export};
use skysink_mission::folder::Earlier;

use crate::error::Error;
use crate::report::print;

/// Convert a finished run to a format for maps, log viewers, ground stations or tables.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink export runs/chicago-uts-1 --format kml
  skysink export runs/letter-uts-1 --format qgc-plan --origin 47.3977,8.5456

Vehicle missions assume the UAV model, still air and flat ground. The pilot in
command is responsible.")]
pub struct ExportCommand {
    /// Folder of a finished run.
    run: PathBuf,
    /// Format of the file.
    #[arg(long, value_parser = format_parser())]
    format: &'static ExportFormat,
    /// Latitude and longitude of the south-west corner of the area [°]; required if the scenario does not set
    /// area.origin_lat_deg and area.origin_lon_deg.
    #[arg(long, value_name = "LAT,LON", value_parser = parse_origin, allow_hyphen_values = true)]
    origin: Option<Origin>,
    /// Output file [default: RUN with the extension of the format].
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Maximum number of items in a vehicle mission, including home; longer missions are split into several files
    /// [default: 500].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(MIN_ITEMS as i64..))]
    most_items: Option<u32>,
}

impl ExportCommand {
    /// Writes the files and prints a summary of their content.
    ///
    /// # Errors
    /// As [`export`].
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let Self { run, format, origin, out, force, most_items } = self;
        let earlier = Earlier::by_force(force);
        let most_items = most_items.map(|items| items as usize);
        let exported = export(&Export { run, format, origin, out, earlier, most_items }, stop)?;
        print(&exported.summary)?;
        exported.files.iter().try_for_each(|file| print(file.display()))
    }
}

/// Parses the name of a format.
fn format_parser() -> impl TypedValueParser<Value = &'static ExportFormat> {
    PossibleValuesParser::new(FORMATS.map(|format| PossibleValue::new(format.name).help(format.about)))
        .map(|name| FORMATS.into_iter().find(|format| format.name == name).expect("one of the possible values"))
}

/// Parses `LAT,LON` [°].
fn parse_origin(text: &str) -> Result<Origin, String> {
    let parts = text.split_once(',').and_then(|(lat, lon)| Some((lat.trim().parse().ok()?, lon.trim().parse().ok()?)));
    parts
        .map(|(lat_deg, lon_deg)| Origin { lat_deg, lon_deg })
        .filter(|origin| (-90.0..=90.0).contains(&origin.lat_deg) && (-180.0..=180.0).contains(&origin.lon_deg))
        .ok_or_else(|| {
            "expected a latitude, -90 to 90, and a longitude, -180 to 180, such as 47.3977,8.5456".to_owned()
        })
}
