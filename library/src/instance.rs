//! Instances: where their files are, and their scenarios.

use std::borrow::Cow;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use rust_embed::RustEmbed;
use serde::{Deserialize, Serialize};
use skysink_common::error::{InputError, did_you_mean, quoted, read_bytes};
use skysink_common::scenario::{Overrides, Scenario, name_refusal};
use skysink_common::sensors::SensorList;
use skysink_mission::MissionError;
use skysink_mission::error::FileContext as _;
use skysink_mission::files::{read_regular, write_all};
use skysink_planner::settings;
use tempfile::TempDir;

/// The instances, by name.
pub(crate) const INDEX: &str = "instances.toml";

/// Most seeds of an instance.
const MOST_SEEDS: u64 = 1000;

/// The kind of input in messages.
pub(crate) const LIBRARY: &str = "library";

/// The files of the library of this build.
#[derive(RustEmbed)]
#[folder = "."]
#[include = "*.toml"]
#[include = "*.csv"]
#[include = "*.csv.gz"]
#[exclude = "Cargo.toml"]
struct BuiltFiles;

/// A library of instances: that of this build, or one in a folder, such as `library` of a checkout.
#[derive(Debug, Clone, Default)]
pub struct Library {
    folder: Option<PathBuf>,
}

/// A named instance.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Instance {
    /// Its name, as papers cite it.
    pub name: String,
    /// What it is, in a sentence.
    pub about: String,
    /// What it is an example of.
    pub family: String,
    /// Number of seeds, from 1, over which a policy is compared by its mean; 1 where nothing is drawn.
    pub seeds: u64,
}

/// What `instances.toml` says of an instance.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct IndexEntry {
    about: String,
    family: String,
    #[serde(default = "one")]
    seeds: u64,
}

fn one() -> u64 {
    1
}

impl Library {
    /// The library in `folder`; without one that of this build.
    #[must_use]
    pub fn of(folder: Option<PathBuf>) -> Self {
        Self { folder }
    }

    /// Its folder; `None` for that of this build.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// All instances, in the order of `instances.toml`.
    ///
    /// # Errors
    /// If the file is missing or malformed.
    pub fn instances(&self) -> Result<Vec<Instance>, MissionError> {
        let path = self.path(INDEX);
        let refuse = |message: &str| InputError::new(LIBRARY, &path, message);
        let bytes = self.read(INDEX)?.ok_or_else(|| refuse("it is missing: expected the folder of a library"))?;
        let text = std::str::from_utf8(&bytes).map_err(|_| refuse("expected UTF-8 text"))?;
        let index: toml::Table =
            toml::from_str(text).map_err(|error| InputError::toml(LIBRARY, &path, text, &error))?;
        let instance = |(name, entry): (String, toml::Value)| {
            let entry = entry.try_into::<IndexEntry>();
            let IndexEntry { about, family, seeds } =
                entry.map_err(|error| refuse(&format!("[{name}]: {}", error.message().trim().replace('\n', ", "))))?;
            if let Some(expected) = name_refusal(&name) {
                return Err(refuse(&format!("[{}]: expected {expected}", quoted(&name))).into());
            }
            if !(1..=MOST_SEEDS).contains(&seeds) {
                return Err(refuse(&format!("[{name}]: seeds = {seeds}: expected 1 to {MOST_SEEDS}")).into());
            }
            Ok(Instance { name, about, family, seeds })
        };
        index.into_iter().map(instance).collect()
    }

    /// The instance of this name.
    ///
    /// # Errors
    /// If there is none.
    pub fn find(&self, name: &str) -> Result<Instance, MissionError> {
        let instances = self.instances()?;
        let names = instances.iter().map(|instance| instance.name.as_str());
        let meant = did_you_mean(name, names).map(|meant| format!("; did you mean `{meant}`?"));
        let found = instances.iter().find(|instance| instance.name == name).cloned();
        found.ok_or_else(|| {
            let message = "expected an instance, as `skysink library list` shows them";
            InputError::of_argument("instance", &quoted(name), format_args!("{message}{}", meant.unwrap_or_default()))
                .into()
        })
    }

    /// Copies the scenario of an instance and its lists into a folder, and returns the path of the scenario.
    ///
    /// # Errors
    /// If a file exists and differs, or cannot be written.
    pub fn copy(&self, instance: &Instance, to: &Path) -> Result<PathBuf, MissionError> {
        fs::create_dir_all(to).at(to)?;
        let names = self.names_of(instance)?;
        let scenario = scenario_file(instance);
        if !names.contains(&scenario) {
            return Err(InputError::new(LIBRARY, &self.path(&scenario), "it is missing").into());
        }
        let mut missing = Vec::new();
        for name in &names {
            let path = to.join(name);
            let bytes = self.read(name)?.unwrap_or_default();
            match read_regular(&path) {
                Ok(found) if found == *bytes => {}
                Err(error) if error.kind() == ErrorKind::NotFound => missing.push((path, bytes)),
                Ok(_) => return Err(InputError::new("file", &path, "it exists, with another content").into()),
                Err(error) => return Err(error).at(&path),
            }
        }
        write_all(&missing.iter().map(|(path, bytes)| (path.clone(), &bytes[..])).collect::<Vec<_>>())?;
        Ok(to.join(scenario))
    }

    /// Opens an instance to fly it.
    ///
    /// # Errors
    /// If its files are missing or refused.
    pub fn open(&self, instance: Instance) -> Result<OpenInstance, MissionError> {
        let (path, copied) = match &self.folder {
            Some(folder) => (folder.join(scenario_file(&instance)), None),
            None => {
                let folder = tempfile::tempdir().at(Path::new("temporary folder"))?;
                (self.copy(&instance, folder.path())?, Some(folder))
            }
        };
        let scenario = Scenario::read(&path, Overrides::default()).and_then(settings::resolve)?;
        let list = SensorList::of(&scenario)?;
        Ok(OpenInstance { library: self.clone(), instance, scenario, list, path, _copied: copied })
    }

    /// The names of the files of an instance, but its best known flight.
    fn names_of(&self, instance: &Instance) -> Result<Vec<String>, MissionError> {
        let all: Vec<String> = match &self.folder {
            None => BuiltFiles::iter().map(Cow::into_owned).collect(),
            Some(folder) => {
                let entries = fs::read_dir(folder).at(folder)?;
                entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
            }
        };
        let is_of = |name: &String| {
            let rest = name.strip_prefix(&instance.name).and_then(|rest| rest.strip_prefix('.'));
            rest.is_some_and(|rest| !rest.contains('/'))
        };
        Ok(all.into_iter().filter(is_of).collect())
    }

    /// The content of a file; `None` if it does not exist.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Cow<'static, [u8]>>, MissionError> {
        let Some(folder) = &self.folder else {
            return Ok(BuiltFiles::get(name).map(|file| file.data));
        };
        let path = folder.join(name);
        match fs::metadata(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            _ => Ok(Some(read_bytes(LIBRARY, &path)?.into())),
        }
    }

    /// The path of a file in messages.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.as_deref().unwrap_or(Path::new(LIBRARY)).join(name)
    }
}

fn scenario_file(instance: &Instance) -> String {
    format!("{}.toml", instance.name)
}

/// An instance with its scenario and its sensor nodes.
#[derive(Debug)]
pub struct OpenInstance {
    /// The library that it is from.
    pub library: Library,
    /// The instance.
    pub instance: Instance,
    /// Its scenario, of seed 1 and with the default strategy.
    pub scenario: Scenario,
    /// Its sensor nodes.
    pub list: SensorList,
    path: PathBuf,
    /// Removed at the end.
    _copied: Option<TempDir>,
}

impl OpenInstance {
    /// The scenario, flown in some way: with another strategy, keys of `[planner]` or seed.
    ///
    /// # Errors
    /// If a key is refused, or is part of the instance.
    pub fn flown_by(&self, overrides: Overrides) -> Result<Scenario, MissionError> {
        let scenario = Scenario::read(&self.path, overrides).and_then(settings::resolve)?;
        let path = self.library.path(&scenario_file(&self.instance));
        self.require_same(&scenario, &SensorList::of(&scenario)?, &path)?;
        Ok(scenario)
    }

    /// The scenario of a seed.
    pub(crate) fn of_seed(&self, seed: u64) -> Result<Scenario, MissionError> {
        self.flown_by(Overrides { seed: Some(seed), ..Overrides::default() })
    }

    /// Refuses a scenario, read from `path`, that differs from that of the instance in anything but how it is flown.
    ///
    /// # Errors
    /// If a key or a line of a list differs.
    pub fn require_same(&self, scenario: &Scenario, list: &SensorList, path: &Path) -> Result<(), MissionError> {
        let name = &self.instance.name;
        let refuse = |what: String| Err(InputError::new("scenario", path, what).into());
        if !(1..=self.instance.seeds).contains(&scenario.seed) && self.instance.seeds > 1 {
            return refuse(format!("seed = {}: expected 1 to {}, of {name}", scenario.seed, self.instance.seeds));
        }
        let [own, other] = [&self.scenario, scenario].map(what_is_fixed);
        if let Some((key, [expected, found])) = difference(&own, &other, "") {
            return refuse(format!("{key} = {found}: expected {expected}, as in {name}"));
        }
        let files = |scenario: &Scenario, list: &SensorList| {
            let beside = list.files_beside(scenario).map(|(name, text)| (name.to_owned(), text.to_string()));
            [("sensors.csv".to_owned(), list.to_csv())].into_iter().chain(beside).collect::<Vec<_>>()
        };
        let [own, other] = [files(&self.scenario, &self.list), files(scenario, list)];
        if own.len() != other.len() {
            return refuse(format!("{} lists: expected {}, as in {name}", other.len(), own.len()));
        }
        for ((file, expected), (_, found)) in own.iter().zip(&other) {
            if expected != found {
                let at = expected.lines().zip(found.lines()).take_while(|(expected, found)| expected == found).count();
                let line = |text: &str| text.lines().nth(at).map_or("no line".to_owned(), |line| format!("`{line}`"));
                let [expected, found] = [line(expected), line(found)];
                return refuse(format!("{file} line {}: {found}: expected {expected}, as in {name}", at + 1));
            }
        }
        Ok(())
    }
}

/// The keys that an instance fixes: all but the seed, how it is planned, and how UAVs share the field.
fn what_is_fixed(scenario: &Scenario) -> toml::Value {
    let mut keys: toml::Table = scenario.to_toml_with_list("sensors.csv").parse().expect("a scenario is TOML");
    keys.remove("seed");
    if let Some(planner) = keys.get_mut("planner").and_then(toml::Value::as_table_mut) {
        planner.retain(|key, _| key == "objective");
    }
    if let Some(uav) = keys.get_mut("uav").and_then(toml::Value::as_table_mut) {
        uav.remove("coordination");
    }
    keys.into()
}

/// The first key in which two scenarios differ, with both values.
fn difference(own: &toml::Value, other: &toml::Value, key: &str) -> Option<(String, [String; 2])> {
    let (Some(own_table), Some(other_table)) = (own.as_table(), other.as_table()) else {
        return (own != other).then(|| (key.to_owned(), [own, other].map(toml::Value::to_string)));
    };
    let names = own_table.keys().chain(other_table.keys().filter(|name| !own_table.contains_key(*name)));
    names.into_iter().find_map(|name| {
        let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
        let values = [own_table, other_table].map(|table| table.get(name));
        let [Some(own), Some(other)] = values else {
            let words = values.map(|value| value.map_or("no such key".to_owned(), toml::Value::to_string));
            return Some((key, words));
        };
        difference(own, other, &key)
    })
}
