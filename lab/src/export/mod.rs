//! Exports a finished run to the formats of other programs.
//!
//! A format is one file in this folder, which defines an [`ExportFormat`], and one line in [`FORMATS`]. `track`
//! converts the flight to latitude and longitude, `vehicle` to a vehicle mission: with waypoints of `stops`,
//! altitudes of `altitude` over the `ground`, and an estimate of its time by `duration`. `missions` checks those of all
//! UAVs, by the `clearance` of their legs and their `separation`.

mod altitude;
mod autopilot;
mod clearance;
mod csv;
mod dji;
mod dji_drone;
mod duration;
mod fence;
mod format;
mod geojson;
mod ground;
mod items;
mod mcap;
mod mission_options;
mod missions;
mod qgc_plan;
mod ros2;
mod scene;
mod separation;
mod stops;
mod summary;
#[cfg(test)]
mod tests;
mod track;
mod vehicle;
mod warnings;
mod waypoints;

use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use skysink_common::error::InputError;
use skysink_common::file_locks::with_remedy;
use skysink_common::scenario::{Origin, Scenario};
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::files::write_all;
use skysink_mission::record::is_of_run;
use skysink_mission::replay::RecordedRun;

use crate::LabError;
pub(crate) use altitude::AltitudeReference;
pub(crate) use autopilot::Autopilot;
pub use format::ExportFormat;
use format::{MissionFormat, WriteFormat};
use mission_options::VehicleMissionOptions;
use track::GeodeticTrack;

/// All formats, in the order of the help.
pub static FORMATS: [&ExportFormat; 6] =
    [&qgc_plan::FORMAT, &waypoints::FORMAT, &dji::FORMAT, &geojson::FORMAT, &csv::FORMAT, &mcap::FORMAT];

/// The parameters of an export.
#[derive(Debug, Args)]
pub struct Export {
    /// Folder of a finished run.
    pub run: PathBuf,
    /// Format of the file.
    #[arg(long, value_parser = format_parser())]
    pub format: &'static ExportFormat,
    /// Latitude and longitude of the south-west corner of the area [°]; required if the scenario does not set
    /// area.origin_lat_deg and area.origin_lon_deg.
    #[arg(long, value_name = "LAT,LON", allow_hyphen_values = true)]
    pub origin: Option<Origin>,
    /// Which north the y axis points to; required by --origin, because that of a map grid is another one.
    #[arg(long)]
    pub north: Option<North>,
    /// Output file [default: RUN with the extension of the format].
    #[arg(long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
    /// The options of vehicle missions.
    #[command(flatten)]
    pub mission: VehicleMissionOptions,
}

/// Which north the y axis of an area points to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum North {
    /// True north, that of the meridian. In UTM and national grids it is up to 5 degrees away.
    True,
}

/// The result of an export.
#[derive(Debug)]
pub struct Exported {
    /// A summary of the content of the files.
    pub summary: String,
    /// The files.
    pub files: Vec<PathBuf>,
}

/// The files of an export and what to say about them.
struct Rendered {
    /// A line for each fact.
    summary: Vec<String>,
    /// The output file of each UAV, with the bytes of its parts.
    outputs: Vec<(PathBuf, Vec<Vec<u8>>)>,
}

/// Exports a run. No file is left incomplete.
///
/// # Errors
/// If the folder, the origin, the output file or an option is refused, a vehicle must not or cannot fly the mission, a
/// file cannot be written, or on a stop.
pub fn export(export: &Export, stop: &Stop) -> Result<Exported, LabError> {
    let run = RecordedRun::read(&export.run, stop)?;
    let out = out_file(export)?;
    let Rendered { summary, outputs } = render(export, &run, &out)?;
    let folder = Some(folder_of(&out)).filter(|folder| folder.is_dir()).and_then(|folder| File::open(folder).ok());
    // Two exports to one file do not mix their parts. The lock ends with the handle.
    folder.as_ref().map_or(Ok(()), File::lock).map_err(with_remedy).at(&out)?;
    let files: Vec<PathBuf> = outputs.iter().flat_map(|(out, texts)| part_names(out, texts.len())).collect();
    files.iter().try_for_each(|file| check_out(file, export))?;
    let other_parts = outputs.iter().flat_map(|(out, _)| parts_of(out)).filter(|part| !files.contains(part));
    for part in other_parts {
        if !export.force {
            let message = "it is of an earlier export: choose another --out, or pass --force to remove it";
            return Err(InputError::new("output file", &part, message).into());
        }
        fs::remove_file(&part).at(&part)?;
    }
    let texts = outputs.iter().flat_map(|(_, texts)| texts).map(Vec::as_slice);
    write_all(&files.iter().cloned().zip(texts).collect::<Vec<_>>())?;
    Ok(Exported { summary: summary.join("\n"), files })
}

/// The content of the files of an export.
fn render(export: &Export, run: &RecordedRun, out: &Path) -> Result<Rendered, LabError> {
    let uavs = run.scenario.uav.uavs();
    if let (Some(option), WriteFormat::Flight(_)) = (export.mission.given(), &export.format.write) {
        return Err(refuse_option(export, option, "has no vehicle mission").into());
    }
    let origin = origin(export, &run.scenario)?;
    // Of UAVs that differ each has the run with its own keys.
    let own: Vec<RecordedRun> = match run.scenario.fleet {
        None => Vec::new(),
        Some(_) => (0..uavs).map(|uav| RecordedRun { scenario: run.scenario.as_of(uav), ..run.clone() }).collect(),
    };
    let run_of = |uav: usize| own.get(uav).unwrap_or(run);
    let tracks = (0..uavs).map(|uav| GeodeticTrack::new(run_of(uav), uav, origin)).collect::<Result<Vec<_>, _>>()?;
    let (mut summary, texts) = match &export.format.write {
        WriteFormat::Flight(write) => {
            let files = if uavs == 1 { "1 file".to_owned() } else { format!("{uavs} files, one for each UAV") };
            let [slots, sensors] = [run.slots.len(), run.list.sensors().len()];
            let line = format!("{slots} slots, {sensors} sensor nodes → {files}");
            (vec![line], tracks.iter().map(|track| vec![write(track)]).collect())
        }
        WriteFormat::Mission(format) => {
            let rendered = missions::render(format, &tracks, &mission_options(export, format)?)?;
            (rendered.lines, rendered.texts)
        }
    };
    summary.extend(export.north.map(|North::True| "y is taken for true north (--north true)".to_owned()));
    let files = (0..uavs).map(|uav| of_uav(out, export.format, uav, uavs));
    Ok(Rendered { summary, outputs: files.zip(texts).collect() })
}

/// The options of the mission for the format, which may be for one autopilot only, or without a geofence.
fn mission_options(export: &Export, format: &MissionFormat) -> Result<VehicleMissionOptions, InputError> {
    let autopilot = export.mission.autopilot.or(format.autopilot);
    let options = VehicleMissionOptions { autopilot, ..export.mission.clone() };
    if let Some(only) = format.autopilot.filter(|only| *only != options.autopilot()) {
        return Err(refuse_option(export, "--autopilot", &format!("is a format of {only}")));
    }
    if options.fence_margin > 0.0 && format.without_fence.is_some() {
        return Err(refuse_option(export, "--fence-margin", "has no geofence"));
    }
    Ok(options)
}

fn refuse_option(export: &Export, option: &str, why: &str) -> InputError {
    let message = format_args!("{option}: {} {why}: omit this option", export.format.name);
    InputError::new("run folder", &export.run, message)
}

/// The origin of the scenario, or the given one if the scenario has none.
fn origin(export: &Export, scenario: &Scenario) -> Result<Origin, InputError> {
    let refuse = |message| Err(InputError::new("scenario", &scenario.path, message));
    match (scenario.area.origin(), export.origin, export.north) {
        (Some(origin), None, None) | (None, Some(origin), Some(North::True)) => Ok(origin),
        (Some(_), _, _) => {
            refuse("it sets area.origin_lat_deg, area.origin_lon_deg, and its y is true north: omit --origin, --north")
        }
        (None, Some(_), None) => refuse(
            "--origin: expected --north true beside it, if y is true north; the y of UTM and national grids is not, by \
             up to 5 degrees: for those give skysink new the list in degrees, or with its --crs",
        ),
        (None, None, _) => refuse(
            "no area.origin_lat_deg, area.origin_lon_deg: expected --origin LAT,LON, the south-west corner of the area \
             [°], and --north true if y is true north",
        ),
    }
}

/// The output file: `--out`, or the name of the run folder with the extension of the format.
fn out_file(export: &Export) -> Result<PathBuf, InputError> {
    if let Some(out) = &export.out {
        return Ok(out.clone());
    }
    let run = &export.run;
    let whole = if run.file_name().is_some() { Ok(run.clone()) } else { fs::canonicalize(run) };
    let named = whole.ok().filter(|whole| whole.file_name().is_some());
    let named = named.ok_or_else(|| InputError::new("run folder", run, "no name: expected --out PATH"))?;
    Ok(named.with_added_extension(export.format.extension))
}

/// The file of the UAV number `uav` of `uavs`: the given name for a single UAV, else `NAME-uav-0.EXT` and so on.
fn of_uav(file: &Path, format: &ExportFormat, uav: usize, uavs: usize) -> PathBuf {
    let name = file.file_name().and_then(OsStr::to_str).unwrap_or_default();
    match name.strip_suffix(format.extension).and_then(|name| name.strip_suffix('.')) {
        _ if uavs == 1 => file.to_owned(),
        Some(stem) => file.with_file_name(format!("{stem}-uav-{uav}.{}", format.extension)),
        None => with_suffix(file, &format!("-uav-{uav}")),
    }
}

/// The file names of the parts: the given name for a single part, else `NAME-part-1-of-3.EXT` and so on.
fn part_names(file: &Path, count: usize) -> Vec<PathBuf> {
    if count == 1 {
        return vec![file.to_owned()];
    }
    (1..=count).map(|part| with_suffix(file, &format!("-part-{part}-of-{count}"))).collect()
}

/// The file with a suffix to its name, before the extension.
fn with_suffix(file: &Path, suffix: &str) -> PathBuf {
    let mut name: OsString = file.file_stem().unwrap_or_default().to_owned();
    name.push(suffix);
    file.with_file_name(name).with_added_extension(file.extension().unwrap_or_default())
}

/// The folder of a file.
fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The existing files of the mission `out`: in one part, or in any number.
fn parts_of(out: &Path) -> Vec<PathBuf> {
    let begin = format!("{}-part-", out.file_stem().unwrap_or_default().to_string_lossy());
    let entries =
        fs::read_dir(folder_of(out)).into_iter().flatten().flatten().map(|entry| out.with_file_name(entry.file_name()));
    let is_part = |path: &PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let numbers = stem.strip_prefix(&begin).and_then(|rest| rest.split_once("-of-"));
        let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        let is_one_of = numbers.is_some_and(|(part, of)| is_number(part) && is_number(of));
        path == out || path.extension() == out.extension() && is_one_of
    };
    entries.filter(is_part).collect()
}

/// Checks that the file can be created, and does not exist unless it may be replaced.
fn check_out(file: &Path, export: &Export) -> Result<(), InputError> {
    let refuse = |message: &str| Err(InputError::new("output file", file, message));
    match fs::symlink_metadata(file) {
        _ if file.file_name().is_none() => refuse("no name: expected a file"),
        _ if !folder_of(file).is_dir() => refuse("its folder does not exist: expected an existing folder"),
        Ok(found) if !found.is_file() => refuse("it is not a regular file: choose another --out"),
        _ if is_of_run(file) => refuse("it is a file of a run: choose another --out"),
        Ok(_) if !export.force => refuse("it exists: choose another --out, or pass --force to replace it"),
        _ => Ok(()),
    }
}

/// The format that the Python package writes.
const PARQUET: &str = "parquet";

/// Parses the name of a format.
fn format_parser() -> impl TypedValueParser<Value = &'static ExportFormat> {
    let names = FORMATS.map(|format| PossibleValue::new(format.name).help(format.about));
    let names = names.into_iter().chain([PossibleValue::new(PARQUET).hide(true)]);
    let find = |name: String| FORMATS.into_iter().find(|format| format.name == name);
    PossibleValuesParser::new(names).try_map(move |name| {
        find(name).ok_or("Python writes it: skysink.parquet(RUN), after pip install './python[frames]'")
    })
}

#[cfg(test)]
mod files {
    use super::*;

    #[test]
    fn parts_are_numbered_before_the_ending() {
        let names = part_names(Path::new("a/b.1.plan"), 2);
        assert_eq!(names, ["a/b.1-part-1-of-2.plan", "a/b.1-part-2-of-2.plan"].map(PathBuf::from));
        assert_eq!(part_names(Path::new("b"), 1), [PathBuf::from("b")]);
    }

    #[test]
    fn names_and_extensions_of_formats_are_unique() {
        for (index, format) in FORMATS.iter().enumerate() {
            assert!(FORMATS[..index].iter().all(|other| other.name != format.name));
            assert!(FORMATS[..index].iter().all(|other| other.extension != format.extension));
        }
    }
}
