//! `skysink new`: creates a scenario file, and a sensor list if positions are imported.

#[cfg(feature = "lab")]
mod import;

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_mission::error::FileContext;
use skysink_mission::record::write_unfinished;
use skysink_planner::settings;

use crate::error::Error;
use crate::report::print;

/// The scenario file with the placeholders `{name}`, `{area}` and `{sensors}`.
const TEMPLATE: &str = include_str!("new/template.toml");

/// Keys of `[area]` without imported positions.
const AREA: &str = "side_m = 100.0                    # a square [m]; or width_m and height_m";

/// Keys of `[sensors]` without imported positions.
const SENSORS: &str = "count = 200                       # drawn uniformly from the seed; or file = \"sensors.csv\"";

/// The file name of the sensor list.
const LIST: &str = "sensors.csv";

/// Arguments of `skysink new`.
#[derive(Debug, Args)]
pub struct NewScenario {
    /// Name of the mission.
    name: String,
    /// Positions of the sensor nodes: CSV with columns x, y [m] or lat, lon [°], KML, GPX or GeoJSON.
    #[cfg(feature = "lab")]
    #[arg(long, value_name = "FILE")]
    sensors: Option<PathBuf>,
    /// Output folder [default: ./NAME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
}

/// The parts of a new scenario that depend on its field.
struct NewField {
    /// Keys of `[area]`.
    area: String,
    /// Keys of `[sensors]`.
    sensors: String,
    /// The sensor list, if there is one.
    list: Option<NewList>,
    /// Notes to print about the import.
    notes: Vec<String>,
}

/// The sensor list of a new scenario, converted from an imported file.
struct NewList {
    text: String,
    /// The location of each row in the imported file, for error messages.
    locations: Vec<String>,
    /// The imported file.
    source: PathBuf,
}

impl NewList {
    /// Checks the sensor nodes in `scenario`. Errors name the location in the imported file.
    fn sensors(&self, scenario: &Scenario) -> Result<SensorList, InputError> {
        SensorList::parse_rows(&self.text, &self.source, scenario, |row, _| self.locations[row].clone())
    }
}

impl NewScenario {
    /// Writes the scenario and its sensor list, both or none.
    ///
    /// # Errors
    /// If the name or the positions are refused, the folder is a file, a file exists, or a file cannot be
    /// written.
    pub fn write(&self) -> Result<(), Error> {
        let folder = self.out.clone().unwrap_or_else(|| PathBuf::from(&self.name));
        let path = folder.join(format!("{}.toml", self.name));
        scenario(&self.name, &NewField::drawn(), &path)?; // checks the name before the import
        let field = self.field()?;
        let text = text(&self.name, &field);
        let checked = scenario(&self.name, &field, &path)?;
        let sensors = match &field.list {
            Some(list) => list.sensors(&checked)?,
            None => SensorList::of(&checked)?,
        };
        let list = field.list.as_ref().map(|list| (folder.join(LIST), &list.text[..]));
        let files: Vec<(PathBuf, &str)> = list.into_iter().chain([(path.clone(), &text[..])]).collect();
        write_all(&folder, &files, self.force)?;
        field.notes.iter().try_for_each(print)?;
        let [width_m, height_m] = [checked.area.width_m(), checked.area.height_m()];
        let count = sensors.sensors().len();
        print(format_args!("{}: {count} sensor nodes in {width_m} m × {height_m} m", path.display()))?;
        print(format_args!("Next:  skysink check {}", shlex::try_quote(&path.to_string_lossy()).unwrap_or_default()))
    }

    #[cfg(feature = "lab")]
    fn field(&self) -> Result<NewField, Error> {
        self.sensors.as_deref().map_or_else(|| Ok(NewField::drawn()), |path| Ok(import::field(path)?))
    }

    #[cfg(not(feature = "lab"))]
    fn field(&self) -> Result<NewField, Error> {
        Ok(NewField::drawn())
    }
}

impl NewField {
    /// The paper's field.
    fn drawn() -> Self {
        Self { area: AREA.to_owned(), sensors: SENSORS.to_owned(), list: None, notes: Vec::new() }
    }
}

/// The text of the scenario.
fn text(name: &str, field: &NewField) -> String {
    let name = toml::Value::String(name.to_owned()).to_string();
    TEMPLATE.replace("{name}", &name).replace("{area}", &field.area).replace("{sensors}", &field.sensors)
}

/// Checks the scenario that will be written to `path`.
fn scenario(name: &str, field: &NewField, path: &Path) -> Result<Scenario, InputError> {
    Scenario::parse(&text(name, field), path, Overrides::default()).and_then(settings::resolve)
}

/// Writes files into `folder`, via temporary names, so that none is incomplete.
fn write_all(folder: &Path, files: &[(PathBuf, &str)], force: bool) -> Result<(), Error> {
    for (path, _) in files {
        if !force && fs::symlink_metadata(path).is_ok() {
            let message = "it exists: choose another --out, or pass --force to replace it";
            return Err(InputError::new("file", path, message).into());
        }
    }
    if folder.exists() && !folder.is_dir() {
        return Err(InputError::new("folder", folder, "it is not a folder: choose another --out").into());
    }
    fs::create_dir_all(folder).at(folder)?;
    let mut written = Vec::new();
    for (path, text) in files {
        written.push((path, write_unfinished(path, text.as_bytes()).at(path)?));
    }
    for (path, file) in written {
        file.persist(path).map_err(|error| error.error).at(path)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_scenario_equals_the_letter_except_for_its_name() {
        let path = Path::new("letter (built in)");
        let mut new = scenario("letter", &NewField::drawn(), path).unwrap();
        let letter = Scenario::letter(Overrides::default()).and_then(settings::resolve).unwrap();
        new.path.clone_from(&letter.path);
        assert_eq!(new, letter);
    }

    #[test]
    fn a_name_cannot_inject_toml() {
        let refused = scenario("a\"\nseed = 7", &NewField::drawn(), Path::new("a.toml")).unwrap_err();
        assert!(refused.to_string().contains("expected 1 to 100 of"), "{refused}");
    }

    #[test]
    fn the_template_fits_into_a_terminal() {
        for line in text("a", &NewField::drawn()).lines() {
            assert!(line.chars().count() <= 90, "{line}");
        }
    }
}
