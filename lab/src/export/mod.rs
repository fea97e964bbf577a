//! Exports a finished run to the formats of other programs.
//!
//! A format is one file in this folder, which defines an [`ExportFormat`], and one line in [`FORMATS`]. `track`
//! converts the flight to latitude and longitude, `vehicle` to a vehicle mission: with waypoints of `stops`,
//! altitudes of `altitude` over the `ground`, and an estimate of its time by `duration`.

mod altitude;
mod autopilot;
mod csv;
mod duration;
mod fence;
mod format;
mod geojson;
mod ground;
mod items;
mod mcap;
mod mission_options;
mod parquet;
mod qgc_plan;
mod ros2;
mod scene;
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

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use skysink_common::error::InputError;
use skysink_common::scenario::{Origin, Scenario};
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::files::write_all;
use skysink_mission::record::is_of_run;
use skysink_mission::replay::RecordedRun;

use crate::LabError;
use autopilot::Autopilot;
pub use format::ExportFormat;
use format::{ExportedMission, WriteFormat};
use mission_options::VehicleMissionOptions;
use track::GeodeticTrack;
use vehicle::MissionPart;

/// All formats, in the order of the help.
pub static FORMATS: [&ExportFormat; 6] =
    [&qgc_plan::FORMAT, &waypoints::FORMAT, &geojson::FORMAT, &csv::FORMAT, &mcap::FORMAT, &parquet::FORMAT];

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
    folder.as_ref().map_or(Ok(()), File::lock).at(&out)?;
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
    let track = |uav: usize| Ok::<_, LabError>(GeodeticTrack::new(run, uav, origin(&run.scenario, export.origin)?)?);
    let has_mission = matches!(export.format.write, WriteFormat::Mission { .. });
    if let Some(option) = export.mission.given().filter(|_| !has_mission) {
        return Err(refuse_option(export, option, "has no vehicle mission").into());
    }
    let files = if uavs == 1 { "1 file".to_owned() } else { format!("{uavs} files, one for each UAV") };
    let counts =
        |files: &str| format!("{} slots, {} sensor nodes → {files}", run.slots.len(), run.list.sensors().len());
    let mut rendered = Rendered { summary: Vec::new(), outputs: Vec::new() };
    match export.format.write {
        WriteFormat::Slots(_) if export.origin.is_some() => {
            return Err(refuse_option(export, "--origin", "has no coordinates").into());
        }
        WriteFormat::Slots(write) => {
            rendered.summary.push(counts("1 file"));
            rendered.outputs.push((out.to_owned(), vec![write(run)]));
        }
        WriteFormat::Flight(write) => {
            rendered.summary.push(counts(&files));
            for uav in 0..uavs {
                rendered.outputs.push((of_uav(out, export.format, uav, uavs), vec![write(&track(uav)?)]));
            }
        }
        WriteFormat::Mission { write, autopilot, without_fence } => {
            let options = mission_options(export, autopilot, without_fence.is_none())?;
            for uav in 0..uavs {
                let (lines, texts) = render_mission(write, without_fence, &track(uav)?, &options)?;
                let prefix = if uavs == 1 { String::new() } else { format!("UAV {uav}: ") };
                rendered.summary.extend(lines.iter().map(|line| prefix.clone() + line));
                rendered.outputs.push((of_uav(out, export.format, uav, uavs), texts));
            }
        }
    }
    Ok(rendered)
}

/// The options of the mission for the format, which may be for one autopilot only, or without a geofence.
fn mission_options(
    export: &Export,
    only: Option<Autopilot>,
    has_fence: bool,
) -> Result<VehicleMissionOptions, InputError> {
    let options = VehicleMissionOptions { autopilot: export.mission.autopilot.or(only), ..export.mission.clone() };
    if let Some(only) = only.filter(|only| *only != options.autopilot()) {
        return Err(refuse_option(export, "--autopilot", &format!("is a format of {only}")));
    }
    if options.fence_margin > 0.0 && !has_fence {
        return Err(refuse_option(export, "--fence-margin", "has no geofence"));
    }
    Ok(options)
}

fn refuse_option(export: &Export, option: &str, why: &str) -> InputError {
    let message = format_args!("{option}: {} {why}: omit this option", export.format.name);
    InputError::new("run folder", &export.run, message)
}

/// The lines about the mission of a UAV, and the content of its files.
fn render_mission(
    write: fn(&ExportedMission<'_>, &MissionPart) -> Vec<u8>,
    without_fence: Option<&'static str>,
    track: &GeodeticTrack<'_>,
    options: &VehicleMissionOptions,
) -> Result<(Vec<String>, Vec<Vec<u8>>), LabError> {
    let mission = vehicle::plan(track, options)?;
    let corners = fence::border(&track.run.scenario.area, options.fence_margin);
    let mut lines = summary::lines(track, options, &mission);
    lines.extend(without_fence.map(str::to_owned));
    let warnings = warnings::of(track, &mission, without_fence.is_none().then_some(&corners[..]));
    lines.extend(warnings.into_iter().map(|text| format!("warning: {text}")));
    let fence = corners.iter().map(|corner| track.place(corner)).collect::<Result<_, _>>()?;
    let exported = ExportedMission { track, mission: &mission, options, fence };
    Ok((lines, mission.parts.iter().map(|part| write(&exported, part)).collect()))
}

/// The origin of the scenario, or the `given` one if the scenario has none.
fn origin(scenario: &Scenario, given: Option<Origin>) -> Result<Origin, InputError> {
    let refuse = |message| Err(InputError::new("scenario", &scenario.path, message));
    match (scenario.area.origin(), given) {
        (Some(origin), None) | (None, Some(origin)) => Ok(origin),
        (None, None) => refuse(
            "no area.origin_lat_deg, area.origin_lon_deg: expected --origin LAT,LON, the south-west corner of the area \
             [°]",
        ),
        (Some(_), Some(_)) => refuse("it sets area.origin_lat_deg and area.origin_lon_deg: omit --origin"),
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

/// Parses the name of a format.
fn format_parser() -> impl TypedValueParser<Value = &'static ExportFormat> {
    PossibleValuesParser::new(FORMATS.map(|format| PossibleValue::new(format.name).help(format.about)))
        .map(|name| FORMATS.into_iter().find(|format| format.name == name).expect("one of the possible values"))
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
