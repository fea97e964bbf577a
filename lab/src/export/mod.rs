//! A finished run as a file that other programs open.
//!
//! A format is a file of this folder and a line of [`FORMATS`], from which everything else knows it. [`track`] has the
//! flight in latitude and longitude, [`vehicle`] what a vehicle's mission is made of.

mod csv;
mod geojson;
mod gpx;
mod kml;
mod mcap;
mod parquet;
mod qgc_plan;
pub mod track;
pub mod vehicle;
mod waypoints;

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::scenario::{Origin, Scenario};
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::record::write_whole;
use skysink_mission::recorded::RecordedRun;

use crate::LabError;
use track::GeodeticTrack;
use vehicle::VehicleItem;

/// Every format, in the order in which they are listed to people.
pub static FORMATS: [&ExportFormat; 8] = [
    &qgc_plan::FORMAT,
    &waypoints::FORMAT,
    &geojson::FORMAT,
    &kml::FORMAT,
    &gpx::FORMAT,
    &csv::FORMAT,
    &mcap::FORMAT,
    &parquet::FORMAT,
];

/// Most items of a vehicle's mission, where none is asked for: PX4's limit; ArduPilot takes some 700.
pub const MOST_ITEMS: usize = 500;

/// A format as the registry knows it.
#[derive(Debug)]
pub struct ExportFormat {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it is for, in a line.
    pub about: &'static str,
    /// Ending of its files.
    pub extension: &'static str,
    /// How it is written.
    pub write: WriteFormat,
}

/// How a format is written.
#[derive(Debug)]
pub enum WriteFormat {
    /// The whole flight in one file.
    Flight(fn(&GeodeticTrack<'_>) -> Vec<u8>),
    /// The slots in the frame of the area, for which no place on the Earth is needed.
    Slots(fn(&RecordedRun) -> Vec<u8>),
    /// A vehicle's mission, a file for each part; and what people are told of it.
    Mission(fn(&GeodeticTrack<'_>, &[VehicleItem]) -> Vec<u8>, &'static str),
}

/// What to export, and where to.
#[derive(Debug)]
pub struct Export {
    /// The run folder.
    pub run: PathBuf,
    /// The format.
    pub format: &'static ExportFormat,
    /// Where the south-west corner of the area is, for scenarios without an origin.
    pub origin: Option<Origin>,
    /// The file; else it is beside the run folder and has its name.
    pub out: Option<PathBuf>,
    /// Whether files may be replaced.
    pub force: bool,
    /// Most items of a vehicle's mission; none asks for [`MOST_ITEMS`].
    pub most_items: Option<usize>,
}

/// What was written.
#[derive(Debug)]
pub struct Exported {
    /// What the files hold, and what they do not.
    pub summary: String,
    /// The files.
    pub files: Vec<PathBuf>,
}

/// Exports a run. Each file is written whole or not at all.
///
/// # Errors
/// If the folder, the origin, the output file or an option is refused, a file cannot be written, or on a stop.
pub fn export(export: &Export, stop: &Stop) -> Result<Exported, LabError> {
    let run = RecordedRun::read(&export.run, stop)?;
    let track = || Ok::<_, LabError>(GeodeticTrack::new(&run, origin(&run.scenario, export.origin)?)?);
    let has_items = matches!(export.format.write, WriteFormat::Mission(..));
    if export.most_items.is_some() && !has_items {
        let message = format_args!("--most-items: {} has no mission items: expected none", export.format.name);
        return Err(InputError::new("run folder", &export.run, message).into());
    }
    let counts = format!("{} slots, {} sensor nodes → 1 file", run.slots.len(), run.list.sensors().len());
    let (summary, texts) = match export.format.write {
        WriteFormat::Slots(_) if export.origin.is_some() => {
            let message = format_args!("--origin: {} has no places on the Earth: expected none", export.format.name);
            return Err(InputError::new("run folder", &export.run, message).into());
        }
        WriteFormat::Slots(write) => (counts, vec![write(&run)]),
        WriteFormat::Flight(write) => (counts, vec![write(&track()?)]),
        WriteFormat::Mission(write, note) => {
            let track = track()?;
            let mission = vehicle::plan(&track, export.most_items.unwrap_or(MOST_ITEMS));
            (mission.summary + note, mission.parts.iter().map(|part| write(&track, part)).collect())
        }
    };
    let out = out_file(export)?;
    let files = part_names(&out, texts.len());
    files.iter().try_for_each(|file| check_out(file, export.force))?;
    let other_parts = parts_of(&out).into_iter().filter(|part| !files.contains(part));
    for part in other_parts {
        if !export.force {
            let message =
                "it is a part of an export in other parts: choose another --out, or pass --force to remove it";
            return Err(InputError::new("output file", &part, message).into());
        }
        fs::remove_file(&part).at(&part)?;
    }
    for (file, text) in files.iter().zip(&texts) {
        write_whole(file, text)?;
    }
    Ok(Exported { summary, files })
}

/// The scenario's origin, or the one that is given where it has none.
fn origin(scenario: &Scenario, given: Option<Origin>) -> Result<Origin, InputError> {
    let refuse = |message| Err(InputError::new("scenario", &scenario.path, message));
    match (scenario.area.origin(), given) {
        (Some(origin), None) | (None, Some(origin)) => Ok(origin),
        (None, None) => refuse(
            "no area.origin_lat_deg, area.origin_lon_deg: expected --origin LAT,LON, where the south-west corner of the \
             area is [°]",
        ),
        (Some(_), Some(_)) => {
            refuse("area.origin_lat_deg, area.origin_lon_deg are where the area is: expected no --origin")
        }
    }
}

/// The file to write: `--out`, or the run folder's name with the ending of the format.
fn out_file(export: &Export) -> Result<PathBuf, InputError> {
    if let Some(out) = &export.out {
        return Ok(out.clone());
    }
    let run = &export.run;
    let whole = if run.file_name().is_some() { Ok(run.clone()) } else { fs::canonicalize(run) };
    let named = whole.ok().and_then(|whole| Some((whole.clone(), whole.file_name()?.to_owned())));
    let (whole, mut name) = named.ok_or_else(|| InputError::new("run folder", run, "no name: expected --out PATH"))?;
    name.push(".");
    name.push(export.format.extension);
    Ok(whole.with_file_name(name))
}

/// The names of the parts of a file: its own if it is the only one, else `NAME-part-1-of-3.EXT` ...
fn part_names(file: &Path, count: usize) -> Vec<PathBuf> {
    if count == 1 {
        return vec![file.to_owned()];
    }
    let name = |part: usize| {
        let mut name: OsString = file.file_stem().unwrap_or_default().to_owned();
        name.push(format!("-part-{part}-of-{count}"));
        if let Some(extension) = file.extension() {
            name.push(".");
            name.push(extension);
        }
        file.with_file_name(name)
    };
    (1..=count).map(name).collect()
}

/// The parts of the file `out` that are there, of whatever number.
fn parts_of(out: &Path) -> Vec<PathBuf> {
    let parent = out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let begin = format!("{}-part-", out.file_stem().unwrap_or_default().to_string_lossy());
    let entries =
        fs::read_dir(parent).into_iter().flatten().flatten().map(|entry| out.with_file_name(entry.file_name()));
    let is_part = |path: &PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let numbers = stem.strip_prefix(&begin).and_then(|rest| rest.split_once("-of-"));
        let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        path.extension() == out.extension() && numbers.is_some_and(|(part, of)| is_number(part) && is_number(of))
    };
    entries.filter(is_part).collect()
}

/// Refuses a file that cannot be, or exists and is not to be replaced.
fn check_out(file: &Path, force: bool) -> Result<(), InputError> {
    let refuse = |message: &str| Err(InputError::new("output file", file, message));
    let parent = file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match fs::symlink_metadata(file) {
        _ if file.file_name().is_none() => refuse("no name: expected a file"),
        _ if !parent.is_dir() => refuse("its folder is missing: expected one that exists"),
        Ok(found) if !found.is_file() => refuse("it is no regular file: choose another --out"),
        Ok(_) if !force => refuse("it exists: choose another --out, or pass --force to replace it"),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_numbered_before_the_ending() {
        let names = part_names(Path::new("a/b.1.plan"), 2);
        assert_eq!(names, ["a/b.1-part-1-of-2.plan", "a/b.1-part-2-of-2.plan"].map(PathBuf::from));
        assert_eq!(part_names(Path::new("b"), 1), [PathBuf::from("b")]);
    }

    #[test]
    fn names_and_endings_of_the_registry_differ() {
        for (index, format) in FORMATS.iter().enumerate() {
            assert!(FORMATS[..index].iter().all(|other| other.name != format.name));
            assert!(FORMATS[..index].iter().all(|other| other.extension != format.extension));
        }
    }
}
