//! `skysink new`: creates a scenario file, with zones if they are imported, and a sensor list if positions are.

mod additions;
#[cfg(feature = "lab")]
mod area;
#[cfg(feature = "lab")]
mod degrees;
mod field;
#[cfg(feature = "lab")]
mod geodetic_area;
#[cfg(feature = "lab")]
mod import;
#[cfg(feature = "lab")]
mod moved;
#[cfg(feature = "lab")]
mod plan;
mod presets;

#[cfg(feature = "lab")]
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use skysink_common::error::InputError;
#[cfg(feature = "lab")]
use skysink_common::geodata::ReferenceSystem;
use skysink_common::geodata::projection::{GeodeticPosition, Projection};
use skysink_common::geometry::Position;
use skysink_common::keys::{self, Accepts, Key, Keys, dotted};
#[cfg(feature = "lab")]
use skysink_common::option_value;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_common::terminal::shell_path;
#[cfg(feature = "lab")]
use skysink_lab::import::Frame;
use skysink_mission::error::FileContext;
use skysink_mission::files::write_all;
use skysink_mission::folder::Earlier;
use skysink_planner::settings;
use skysink_ring::role::Role;
use toml::{Table, Value};

use crate::error::Error;
use crate::report::print;
#[cfg(not(feature = "lab"))]
use additions::Additions;
use field::{LIST, NewField};
#[cfg(feature = "lab")]
use import::Sources;
#[cfg(feature = "lab")]
use plan::PlannedFlight;
use presets::{Hardware, Lines, commented};

/// The beginning of the scenario file.
const HEADER: &str = "\
# A mission for Skysink. Omitted keys have the values of the paper, the UTS
# letter (arXiv 2103.00753), like all values below. Next:
#   skysink check FILE       prints every key, derived figures and warnings
#   skysink simulate FILE    simulates it
";

/// The key that names the sensor list.
const LIST_LINE: &str = "file = \"sensors.csv\"              # a row for each; metres, or degrees about the origin\n";

/// Examples of `skysink new`.
#[cfg(feature = "lab")]
const EXAMPLES: &str = "\
Examples:
  skysink new city                       writes city/city.toml
  skysink new city --sensors nodes.geojson
  skysink new city --sensors nodes.csv --out scenarios/city
  skysink new city --sensors nodes.kml --zones zones.geojson
  skysink new city --sensors utm.csv --crs EPSG:25832
  skysink new city --sensors nodes.csv --radio lora-sf7 --drone x500
  skysink new city --drone x500 --drone m350 --count 2,1
  skysink new city --plan survey.plan --sensors nodes.csv

With --sensors, it also writes sensors.csv and sets the area to enclose the
sensor nodes. CSV columns are matched by name: x, y [m] or lat, lon [°], and
optionally sampling_bps, gain_db, queue_bits, capacity_bits, weight, ground_m,
name. Metres of a map become latitudes and longitudes by --crs, a file .prj or a
member crs. Altitudes of points are ignored: name those of the ground ground_m.

With --zones, each polygon becomes a no-fly zone; one with a property `height`
[m] a building; one whose `kind` or `name` is `boundary`, or which encloses all
sensor nodes, the boundary of the area. Without --sensors, the sensor nodes are
drawn at random.

With --plan, the flight is that of QGroundControl's .plan or ArduPilot's
.waypoints, with its holds, speeds, fence and home: simulate says what it loses.

With --radio and --drone, links, flight and battery are those of the named
hardware, and slots suit both. Of several drones each has --count UAVs.

Python makes scenarios over hills, and of measured links and flights:
  python -m skysink.terrain city --sensors nodes.csv --terrain dem.tif
  python -m skysink.measured city --log flights/monday";

/// Examples of `skysink new` in a build without imports.
#[cfg(not(feature = "lab"))]
const EXAMPLES: &str = "Example:
  skysink new city                                  writes city/city.toml
  skysink new city --radio lora-sf7 --drone x500";

/// Create a scenario file with the paper's values and a comment on each key.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct NewCommand {
    /// Name of the mission.
    name: String,
    /// Positions of the sensor nodes: CSV with columns x, y [m] or lat, lon [°], KML, KMZ, GPX or GeoJSON.
    #[cfg(feature = "lab")]
    #[arg(long, value_name = "FILE")]
    sensors: Option<PathBuf>,
    /// No-fly zones, buildings and a boundary of the area: polygons of a KML, KMZ or GeoJSON file.
    #[cfg(feature = "lab")]
    #[arg(long, value_name = "FILE")]
    zones: Option<PathBuf>,
    /// Reference system of positions and zones in metres or feet of a map, such as EPSG:25832 for UTM 32N.
    #[cfg(feature = "lab")]
    #[arg(long, value_name = "EPSG:CODE")]
    crs: Option<String>,
    /// Where the UAV starts, in the coordinates of the positions: x,y [m] or lat,lon [°].
    #[cfg(feature = "lab")]
    #[arg(long, value_name = "X,Y", value_parser = place, allow_hyphen_values = true)]
    start: Option<[f64; 2]>,
    /// Plan of a flight that is fixed, with its fence and home: QGroundControl's .plan, or .waypoints of ArduPilot.
    #[cfg(feature = "lab")]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["zones", "start", "drone"])]
    plan: Option<PathBuf>,
    /// Speed over ground until the plan sets one [m/s] [default: that of the plan; 10 of .waypoints].
    #[cfg(feature = "lab")]
    #[arg(long, value_name = "M/S", requires = "plan", value_parser = option_value::positive())]
    speed: Option<f64>,
    #[cfg(feature = "lab")]
    #[command(flatten)]
    moved: moved::MovedOptions,
    #[command(flatten)]
    hardware: Hardware,
    /// Output folder [default: ./NAME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
}

impl NewCommand {
    /// Writes the scenario and its sensor list, both or none.
    pub fn run(self, _: &Stop) -> Result<(), Error> {
        let folder = self.out.clone().unwrap_or_else(|| PathBuf::from(&self.name));
        let path = folder.join(format!("{}.toml", self.name));
        let scenario = |text: &str, overrides| Scenario::parse(text, &path, overrides).and_then(settings::resolve);
        self.hardware.check()?;
        // Checks the name before the import.
        let plain = scenario(&text(&self.name, None, &self.hardware.lines()), Overrides::default())?;
        let sources = self.sources(plain.link.comm_radius_m)?;
        let mut field = sources.field()?;
        let sensors_of = |field: Option<&NewField>, scenario: &Scenario| {
            field.map_or_else(|| SensorList::of(scenario), |field| field.sensors(scenario))
        };
        let draft = scenario(&text(&self.name, field.as_ref(), &self.hardware.lines()), Overrides::default())?;
        let list = sensors_of(field.as_ref(), &draft)?;
        let mut lines = self.hardware.lines_with_slots(&draft, &list);
        let additions = sources.additions(field.as_mut(), &draft, &list, &mut lines)?;
        let field = field.as_ref();
        let text = text(&self.name, field, &lines);
        let checked = scenario(&text, additions.overrides)?;
        let sensors = sensors_of(field, &checked)?;
        let list = field.and_then(|field| Some((folder.join(LIST), field.list.as_ref()?.as_bytes())));
        let added = additions.files.iter().map(|(name, text)| (folder.join(name), text.as_bytes()));
        let files: Vec<_> = list.into_iter().chain(added).chain([(path.clone(), text.as_bytes())]).collect();
        write_into(&folder, &files, &self.inputs(), Earlier::by_force(self.force))?;
        field.iter().flat_map(|field| &field.notes).chain(&additions.notes).try_for_each(print)?;
        let warnings = field.iter().flat_map(|field| &field.warnings).chain(&additions.warnings);
        warnings.for_each(|warning| Role::Launcher.log(format_args!("warning: {warning}")));
        let [width_m, height_m] = [checked.area.width_m(), checked.area.height_m()];
        let count = sensors.sensors().len();
        if let Some(centre) = centre_deg(&checked) {
            print(format_args!(
                "Centre of the area:  {:.6}, {:.6} (latitude, longitude)",
                centre.lat_deg, centre.lon_deg
            ))?;
        }
        print(format_args!("{}: {count} sensor nodes in {width_m} m × {height_m} m", path.display()))?;
        print(format_args!("Next:  skysink check {}", shell_path(&path)))
    }

    /// The files that it is made from.
    #[cfg(feature = "lab")]
    fn inputs(&self) -> Vec<PathBuf> {
        [&self.sensors, &self.zones, &self.plan].into_iter().flatten().cloned().collect()
    }

    #[cfg(not(feature = "lab"))]
    fn inputs(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// What the scenario is made from: reads the plan.
    #[cfg(feature = "lab")]
    fn sources(&self, comm_radius_m: f64) -> Result<Sources<'_>, InputError> {
        self.moved.check(&self.name, &self.others())?;
        Ok(Sources {
            sensors: self.sensors.as_deref(),
            zones: self.zones.as_deref(),
            start: self.start,
            crs: self.crs.as_deref().map(crs).transpose()?,
            plan: self.plan.as_deref().map(|path| PlannedFlight::read(path, self.speed)).transpose()?,
            comm_radius_m,
        })
    }

    /// The options with a value that commands of the Python package have, too.
    #[cfg(feature = "lab")]
    fn others(&self) -> [(&'static str, Option<OsString>); 7] {
        let [radio, drone] = self.hardware.names();
        let path = |path: &Option<PathBuf>| path.clone().map(PathBuf::into_os_string);
        [
            ("--sensors", path(&self.sensors)),
            ("--zones", path(&self.zones)),
            ("--crs", self.crs.clone().map(OsString::from)),
            ("--start", self.start.map(|[x, y]| OsString::from(format!("{x},{y}")))),
            ("--radio", radio.map(OsString::from)),
            ("--drone", drone.map(OsString::from)),
            ("--out", path(&self.out)),
        ]
    }

    #[cfg(not(feature = "lab"))]
    fn sources(&self, _: f64) -> Result<Sources, InputError> {
        Ok(Sources)
    }
}

/// What a new scenario is made from: nothing.
#[cfg(not(feature = "lab"))]
struct Sources;

#[cfg(not(feature = "lab"))]
impl Sources {
    fn field(&self) -> Result<Option<NewField>, InputError> {
        Ok(None)
    }

    fn additions(
        &self,
        _: Option<&mut NewField>,
        _: &Scenario,
        _: &SensorList,
        _: &mut Lines,
    ) -> Result<Additions, InputError> {
        Ok(Additions::default())
    }
}

/// The reference system of the option.
#[cfg(feature = "lab")]
fn crs(name: &str) -> Result<ReferenceSystem, InputError> {
    ReferenceSystem::of_name(name).map_err(|message| InputError::of_argument("option", "--crs", message))
}

/// Parses the two numbers of a place.
#[cfg(feature = "lab")]
fn place(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|number| number.trim().parse().ok().filter(|number: &f64| number.is_finite())).collect();
    let place = numbers.and_then(|numbers| numbers.try_into().ok()).ok_or("expected two numbers, X,Y")?;
    Frame::Plane.check(place).map(|()| place)
}

/// Latitude and longitude of the centre of the area; `None` without an origin.
fn centre_deg(scenario: &Scenario) -> Option<GeodeticPosition> {
    let [width_m, height_m] = [scenario.area.width_m(), scenario.area.height_m()];
    Projection::at(scenario.area.origin()?).unproject(&Position::new(width_m / 2.0, height_m / 2.0))
}

/// The text of the scenario: every key that has a default beside the other defaults, with its meaning as a comment.
fn text(name: &str, field: Option<&NewField>, lines: &Lines) -> String {
    let mut defaults = Table::new();
    keys::fill(Scenario::KEYS, "", &mut defaults, &[]);
    let mut text = format!("{}name = {}\n", lines.header().unwrap_or(HEADER), Value::String(name.to_owned()));
    let line_of = |dotted: &str, key: &Key, table: &Table| match lines.instead_of(dotted) {
        Some(line) => Some(line.to_owned()),
        None => line(key, table),
    };
    for key in Scenario::KEYS {
        let (Accepts::TableOf(inner), Some(Value::Table(defaults))) = (key.accepts, defaults.get(key.name)) else {
            text.extend(line_of(key.name, key, &defaults));
            continue;
        };
        text += &format!("\n[{}]\n", key.name);
        for inner in inner {
            match (key.name, inner.name, field) {
                ("area", "side_m", Some(field)) if !field.area.is_empty() => text += &format!("{}\n", field.area),
                ("sensors", "count", Some(NewField { list: Some(_), .. })) => text += LIST_LINE,
                _ => text.extend(line_of(&dotted::join(key.name, inner.name), inner, defaults)),
            }
        }
        if key.name == "uav" {
            text += field.map_or("", |field| &field.uav);
            text += lines.each();
        }
    }
    text + field.map_or("", |field| &field.zones)
}

/// The line of a key that is no table and has a default in `table`, with the first clause of its meaning.
fn line(key: &Key, table: &Table) -> Option<String> {
    table.get(key.name).filter(|default| !default.is_table())?;
    let setting = format!("{} = {}", key.name, key.default?);
    let sentence = key.words.split(". ").next()?.replace('`', "");
    let clause = sentence.split("; ").next()?.trim_end_matches('.');
    Some(commented(&setting, clause))
}

/// Writes files into `folder`, all or none, and none in the place of one of the `inputs`.
fn write_into(folder: &Path, files: &[(PathBuf, &[u8])], inputs: &[PathBuf], earlier: Earlier) -> Result<(), Error> {
    let inputs: Vec<PathBuf> = inputs.iter().filter_map(|path| path.canonicalize().ok()).collect();
    let is_input = |path: &Path| path.canonicalize().is_ok_and(|path| inputs.contains(&path));
    if let Some((path, _)) = files.iter().find(|(path, _)| is_input(path)) {
        let message = "the scenario is made from it: expected another --out";
        return Err(InputError::new("file", path, message).into());
    }
    let existing = files.iter().find(|(path, _)| fs::symlink_metadata(path).is_ok());
    if let Some((path, _)) = existing.filter(|_| earlier == Earlier::Kept) {
        let message = "it exists: choose another --out, or pass --force to replace it";
        return Err(InputError::new("file", path, message).into());
    }
    if folder.exists() && !folder.is_dir() {
        return Err(InputError::new("folder", folder, "it is not a folder: choose another --out").into());
    }
    fs::create_dir_all(folder).at(folder)?;
    Ok(write_all(files)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scenario(name: &str) -> Result<Scenario, InputError> {
        let text = text(name, None, &Lines::default());
        Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).and_then(settings::resolve)
    }

    #[test]
    fn a_new_scenario_equals_the_papers_except_for_its_name() {
        let mut new = scenario("letter").unwrap();
        let letter = Scenario::letter(Overrides::default()).and_then(settings::resolve).unwrap();
        new.path.clone_from(&letter.path);
        assert_eq!(new, letter);
    }

    #[test]
    fn a_name_cannot_inject_toml() {
        let refused = scenario("a\"\nseed = 7").unwrap_err();
        assert!(refused.to_string().contains("expected 1 to 100 of"), "{refused}");
    }

    #[test]
    fn the_template_fits_into_a_terminal() {
        for line in text("a", None, &Lines::default()).lines() {
            assert!(line.chars().count() <= 90, "{line}");
        }
    }
}
