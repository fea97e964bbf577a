//! The file `run.toml` of a run folder: what is needed to resume the run, and hashes that reveal later changes.

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};
use skysink_common::build::{VERSION, build};
use skysink_common::error::InputError;
use skysink_common::pace::Pace;
use xxhash_rust::xxh3::xxh3_64;

/// Name of the file.
pub(crate) const FILE: &str = "run.toml";

/// The files from which a run is flown, which do not change.
pub(crate) const INPUTS: [&str; 3] = ["scenario.toml", "sensors.csv", FILE];

/// Beginning of its last line, which holds the hash of the lines before it.
const CHECK: &str = "check = ";

/// How a mission is flown.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunMode {
    /// The pace of the ring; `None` in one process.
    pub pace: Option<Pace>,
    /// Label of an external planner; `None` if the scenario's strategy plans.
    pub external_planner: Option<String>,
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
        scenario: hash(scenario.as_bytes()),
        sensors: hash(sensors.as_bytes()),
    };
    let text = toml::to_string(&origin).expect("plain keys and values");
    let check = hash(text.as_bytes());
    format!("{text}{CHECK}\"{check}\"\n")
}

/// Reads `run.toml` in `folder`, and compares the scenario and the sensor list with it.
pub(crate) fn read(folder: &Path) -> Result<RunMode, InputError> {
    let refuse = |name: &str, message: &str| InputError::new("run folder", &folder.join(name), message);
    let bytes = |name: &str| fs::read(folder.join(name)).map_err(|error| refuse(name, &error.to_string()));
    let changed =
        |name: &str| refuse(name, "it was modified after the start of the run: restore it, or start a new run");

    let text = String::from_utf8(bytes(FILE)?).map_err(|_| changed(FILE))?;
    let (origin, check) = text.rfind(CHECK).map(|at| text.split_at(at)).ok_or_else(|| changed(FILE))?;
    if check != format!("{CHECK}\"{}\"\n", hash(origin.as_bytes())) {
        return Err(changed(FILE));
    }
    let origin: Origin = toml::from_str(origin).map_err(|error| {
        let message = format!("{}: expected the run.toml of Skysink {}", error.message(), VERSION);
        refuse(FILE, &message)
    })?;
    for (name, expected) in [("scenario.toml", origin.scenario), ("sensors.csv", origin.sensors)] {
        if hash(&bytes(name)?) != expected {
            return Err(changed(name));
        }
    }
    Ok(RunMode { pace: origin.pace, external_planner: origin.external_planner })
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
        folder
    }

    #[test]
    fn a_written_file_is_read_back() {
        let modes = [
            RunMode::default(),
            RunMode { pace: Some("10x".parse().unwrap()), external_planner: Some("mine \"1\"".to_owned()) },
        ];
        for mode in modes {
            assert_eq!(read(folder(&mode).path()).unwrap(), mode);
        }
    }

    #[test]
    fn a_changed_byte_of_any_file_is_refused_and_named() {
        for name in INPUTS {
            let folder = folder(&RunMode::default());
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
