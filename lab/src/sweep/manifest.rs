//! The manifest of a sweep's folder, and the names of the files.

use std::path::Path;

use serde::{Deserialize, Serialize};
use skysink_common::build::VERSION;
use skysink_common::error::InputError;
use skysink_common::nodes;
use skysink_common::scenario::{CHANNEL, RATES, TRACE};
use skysink_mission::error::FileContext;
use skysink_mission::files::{read_regular, write_whole};
use skysink_mission::folder::FolderLayout;

use super::definition::Definition;
use super::shard::Shard;
use crate::error::LabError;

// The names of the files.
pub(crate) const SCENARIO: &str = "scenario.toml";
pub(crate) const SENSORS: &str = "sensors.csv";
pub(crate) const TRACK: &str = "track.csv";
pub(crate) const ARRAYS: &str = "channel.npz"; // a map of links
pub(crate) const SWEEP: &str = "sweep.toml";
pub(crate) const MANIFEST: &str = "sweep.json";
/// File name of the standings of a comparison.
pub const STANDINGS: &str = "comparison.json";
/// File name of its recording.
pub const RECORDING: &str = "comparison.rrd";

/// The files of a sweep that has begun; the others follow the manifest.
pub(crate) static LAYOUT: FolderLayout = FolderLayout {
    lock: "lock",
    is_result: |name| name == MANIFEST,
    is_temporary: |name| RESULTS.contains(&name) || saved().any(|saved| saved == name),
};

/// The files of the definition, beside sources in Python.
pub(crate) fn saved() -> impl Iterator<Item = &'static str> {
    let of_features = nodes::files().map(|file| file.name);
    [SCENARIO, SENSORS, TRACE].into_iter().chain(of_features).chain([CHANNEL, ARRAYS, RATES, TRACK, SWEEP])
}

/// The files that are written when all missions are flown, and the one that the Python package makes of them.
pub(crate) const RESULTS: [&str; 4] = ["results.csv", "summary.csv", "timings.csv", "results.parquet"];

/// The content of `sweep.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The shard in the folder.
    pub shard: Shard,
    /// Commit, compiler and target of each program that flew missions of it, in order.
    pub builds: Vec<String>,
    /// The sweep.
    #[serde(flatten)]
    pub definition: Definition,
}

impl Manifest {
    /// Reads the manifest of the folder `path`; `None` if the sweep has not begun. `what` names the folder in errors.
    ///
    /// # Errors
    /// If the folder is not that of a sweep, or was written by another version.
    pub fn read(what: &'static str, path: &Path) -> Result<Option<Self>, LabError> {
        let refuse = |message: String| InputError::new(what, path, message);
        if path.is_file() {
            return Err(refuse("it is a file: expected the folder of a sweep".to_owned()).into());
        }
        let text = match read_regular(&path.join(MANIFEST)) {
            Err(_) if path.is_dir() && LAYOUT.content(path).at(path)?.is_empty() => return Ok(None),
            text => text.map_err(|error| refuse(format!("{MANIFEST}: {error}: expected the folder of a sweep")))?,
        };
        let manifest: Self = serde_json::from_slice(&text).map_err(|error| {
            refuse(format!("{MANIFEST}: {error}: expected that of a sweep: delete the folder and run the {what} again"))
        })?;
        let version = &manifest.definition.version;
        if version != VERSION {
            return Err(refuse(format!(
                "it was written by Skysink {version}: expected {VERSION}: run the {what} again"
            ))
            .into());
        }
        if manifest.definition.identity != manifest.definition.hash() {
            return Err(refuse(format!("its {MANIFEST} was modified: restore it, or run the {what} again")).into());
        }
        Ok(Some(manifest))
    }

    /// Writes it into the folder.
    pub(crate) fn write(&self, folder: &Path) -> Result<(), LabError> {
        let text = serde_json::to_string_pretty(self).expect("plain values") + "\n";
        Ok(write_whole(&folder.join(MANIFEST), text.as_bytes())?)
    }
}

/// Adds the builds that are not among them.
pub(crate) fn add_builds(to: &mut Vec<String>, builds: Vec<String>) {
    for build in builds {
        if !to.contains(&build) {
            to.push(build);
        }
    }
}
