//! The file `run.toml` of a run folder: what is needed to resume the run, and hashes that reveal later changes.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};
use skysink_common::build::{VERSION, build};
use skysink_common::error::InputError;
use skysink_common::pace::Pace;
use skysink_common::scenario::is_kept_file;
use skysink_flight_sim::Orders;
use xxhash_rust::xxh3::xxh3_64;

use crate::trace::RecordedSlot;

/// Name of the file.
pub(crate) const FILE: &str = "run.toml";

/// The files from which a run is flown, which do not change.
pub(crate) const INPUTS: [&str; 3] = ["scenario.toml", "sensors.csv", FILE];

/// Beginning of its last line, which holds the hash of the lines before it.
const CHECK: &str = "check = ";

/// How a mission is flown.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RunMode {
    /// The pace of the ring; `None` in one process.
    pub pace: Option<Pace>,
    /// Label of an external planner or of a strategy in Python; `None` if the scenario's strategy plans.
    pub external_planner: Option<String>,
    /// The roles whose processes the launcher has not started, or that a command of the user fills, by name.
    pub external: Vec<String>,
    /// The source of the strategy in Python that flies.
    pub sources: Vec<SourceFile>,
}

/// A file of a strategy's source code, or of the arrivals, as in the run folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SourceFile {
    /// `strategy.py`, or `strategy.NAME.py` for a module NAME that it imports; `arrivals.csv`, `harvest.csv`,
    /// `channel.csv`, `rates.csv`.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

impl RunMode {
    /// Whether the flights were reported by an external flight-sim, such as a bridge to a vehicle.
    pub fn has_reported_flights(&self) -> bool {
        self.external.iter().any(|role| role == "flight-sim")
    }

    /// The orders that repeat a recorded slot of each UAV.
    pub fn orders_of(&self, slots: &[RecordedSlot]) -> Orders {
        match self.has_reported_flights() {
            true => Orders::Reports(slots.iter().map(RecordedSlot::report).collect()),
            false => Orders::Plans(slots.iter().map(RecordedSlot::decision).collect()),
        }
    }
}

/// Whether a file of this name holds the source of a strategy, arrivals or a channel.
#[must_use]
pub fn is_source(name: &str) -> bool {
    let rest = name.strip_prefix("strategy.").filter(|rest| !rest.contains('/'));
    is_kept_file(name) || rest.is_some_and(|rest| rest == "py" || rest.ends_with(".py"))
}

/// The names of the sources that the run in `folder` has written, as its `run.toml` lists them.
pub(crate) fn source_names(folder: &Path) -> Vec<String> {
    let text = fs::read_to_string(folder.join(FILE)).unwrap_or_default();
    let origin = text.rsplit_once(CHECK).and_then(|(origin, _)| toml::from_str::<Origin>(origin).ok());
    let names = origin.into_iter().flat_map(|origin| origin.sources).map(|(name, _)| name);
    names.filter(|name| is_source(name)).collect()
}

/// The content of `run.toml`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Origin {
    version: String,
    #[serde(default)] // runs of older builds have none
    build: String,
    pace: Option<Pace>,
    #[serde(rename = "outside_planner")]
    external_planner: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    external: Vec<String>,
    /// Names of the source files, and XXH3 of their bytes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    sources: Vec<(String, String)>,
    /// XXH3 of the bytes of `scenario.toml`.
    scenario: String,
    /// XXH3 of the bytes of `sensors.csv`.
    sensors: String,
}

/// The text of `run.toml`.
pub(crate) fn write(mode: &RunMode, scenario: &str, sensors: &str) -> String {
    let origin = Origin {
        version: VERSION.to_owned(),
        build: build().to_owned(),
        pace: mode.pace,
        external_planner: mode.external_planner.clone(),
        external: mode.external.clone(),
        sources: mode.sources.iter().map(|source| (source.name.clone(), hash(&source.bytes))).collect(),
        scenario: hash(scenario.as_bytes()),
        sensors: hash(sensors.as_bytes()),
    };
    text_of(&origin)
}

/// The text of the `run.toml` in `folder` with other external roles. Its build stays that of the program that has begun
/// the run.
pub(crate) fn with_external(folder: &Path, external: &[String]) -> Result<String, InputError> {
    Ok(text_of(&Origin { external: external.to_vec(), ..read_origin(folder)? }))
}

/// The text of `run.toml`.
fn text_of(origin: &Origin) -> String {
    let text = toml::to_string(origin).expect("plain keys and values");
    let check = hash(text.as_bytes());
    format!("{text}{CHECK}\"{check}\"\n")
}

/// The refusal of a file in `folder`.
fn refuse(folder: &Path, name: &str, message: &str) -> InputError {
    InputError::new("run folder", &folder.join(name), message)
}

fn changed(folder: &Path, name: &str) -> InputError {
    refuse(folder, name, "it was modified after the start of the run: restore it, or start a new run")
}

fn bytes(folder: &Path, name: &str) -> Result<Vec<u8>, InputError> {
    fs::read(folder.join(name)).map_err(|error| refuse(folder, name, &error.to_string()))
}

/// Reads `run.toml` in `folder`.
fn read_origin(folder: &Path) -> Result<Origin, InputError> {
    let changed = || changed(folder, FILE);
    let text = String::from_utf8(bytes(folder, FILE)?).map_err(|_| changed())?;
    let (origin, check) = text.rfind(CHECK).map(|at| text.split_at(at)).ok_or_else(changed)?;
    if check != format!("{CHECK}\"{}\"\n", hash(origin.as_bytes())) {
        return Err(changed());
    }
    toml::from_str(origin).map_err(|error| {
        let message = format!("{}: expected the run.toml of Skysink {}", error.message(), VERSION);
        refuse(folder, FILE, &message)
    })
}

/// Reads `run.toml` in `folder`, and compares the scenario, the sensor list and the sources with it.
pub(crate) fn read(folder: &Path) -> Result<RunMode, InputError> {
    let origin = read_origin(folder)?;
    for (name, expected) in [("scenario.toml", origin.scenario), ("sensors.csv", origin.sensors)] {
        if hash(&bytes(folder, name)?) != expected {
            return Err(changed(folder, name));
        }
    }
    let source = |(name, expected): (String, String)| {
        let bytes = bytes(folder, &name)?;
        if !is_source(&name) || hash(&bytes) != expected {
            return Err(changed(folder, &name));
        }
        Ok(SourceFile { name, bytes })
    };
    let sources = origin.sources.into_iter().map(source).collect::<Result<_, _>>()?;
    let Origin { pace, external_planner, external, .. } = origin;
    Ok(RunMode { pace, external_planner, external, sources })
}

/// XXH3 of bytes, as 16 hexadecimal digits.
pub(crate) fn hash(bytes: &[u8]) -> String {
    format!("{:016x}", xxh3_64(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(mode: &RunMode) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [("scenario.toml", "a"), ("sensors.csv", "b"), (FILE, &write(mode, "a", "b")[..])] {
            fs::write(folder.path().join(name), text).unwrap();
        }
        for SourceFile { name, bytes } in &mode.sources {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        folder
    }

    /// A run of a strategy in Python with a module beside it.
    fn in_python() -> RunMode {
        let source = |name: &str| SourceFile { name: name.to_owned(), bytes: format!("# {name}").into() };
        RunMode {
            external_planner: Some("GFS".to_owned()),
            external: vec!["planner".to_owned()],
            sources: ["strategy.py", "strategy.near.py"].map(source).to_vec(),
            ..RunMode::default()
        }
    }

    #[test]
    fn a_written_file_is_read_back() {
        let paced = RunMode {
            pace: Some("10x".parse().unwrap()),
            external_planner: Some("mine \"1\"".to_owned()),
            external: vec!["planner".to_owned(), "flight-sim".to_owned()],
            ..RunMode::default()
        };
        assert_eq!([&paced, &in_python()].map(RunMode::has_reported_flights), [true, false]);
        for mode in [RunMode::default(), paced, in_python()] {
            assert_eq!(read(folder(&mode).path()).unwrap(), mode);
        }
    }

    #[test]
    fn the_first_build_is_kept_when_external_roles_change() {
        let folder = folder(&in_python());
        let begun =
            Origin { build: "0123456789ab, another compiler".to_owned(), ..read_origin(folder.path()).unwrap() };
        fs::write(folder.path().join(FILE), text_of(&begun)).unwrap();
        let external = ["planner".to_owned(), "flight-sim".to_owned()];
        fs::write(folder.path().join(FILE), with_external(folder.path(), &external).unwrap()).unwrap();
        assert_eq!(read_origin(folder.path()).unwrap().build, begun.build);
        assert_eq!(read(folder.path()).unwrap(), RunMode { external: external.to_vec(), ..in_python() });
    }

    #[test]
    fn only_source_file_names_are_read_as_sources() {
        assert!(["strategy.py", "strategy.near.py"].into_iter().all(is_source));
        let others = ["strategy.", "strategypy", "mine.py", "strategy.toml", "strategy./../a.py"];
        assert!(!others.into_iter().any(is_source));
        let mut mode = in_python();
        mode.sources[1].name = "../near.py".to_owned();
        let inner = tempfile::tempdir().unwrap();
        let path = inner.path().join("run");
        fs::rename(folder(&mode).keep(), &path).unwrap();
        fs::write(inner.path().join("near.py"), &mode.sources[1].bytes).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("was modified"));
    }

    #[test]
    fn a_changed_byte_of_any_file_is_refused_and_named() {
        for name in INPUTS.into_iter().chain(["strategy.py", "strategy.near.py"]) {
            let folder = folder(&in_python());
            let path = folder.path().join(name);
            let whole = fs::read(&path).unwrap();
            for at in 0..whole.len() {
                let mut bytes = whole.clone();
                bytes[at] ^= 1;
                fs::write(&path, bytes).unwrap();
                let error = read(folder.path()).unwrap_err().to_string();
                assert!(error.contains(name) && error.contains("was modified"), "{error}");
            }
            fs::write(&path, &whole[..whole.len() - 1]).unwrap();
            assert!(read(folder.path()).is_err(), "cut");
            fs::remove_file(&path).unwrap();
            assert!(read(folder.path()).unwrap_err().to_string().contains(name));
        }
    }
}
