//! The output folder of a comparison. Different comparisons have different default folders.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::json;
use skysink_common::error::InputError;
use skysink_lab::sweep::manifest::{RECORDING, STANDINGS};
use skysink_lab::sweep::plan::Sweep;
use skysink_mission::MissionError;
use skysink_mission::error::FileContext;
use skysink_mission::files::{read_regular, write_whole};
use skysink_mission::folder::{Earlier, FolderLayout, OutputFolder};
use xxhash_rust::xxh3::xxh3_64;

use super::contenders::name_of;
use crate::error::Error;

/// Lists the compared runs by their absolute paths. For strategies, `sweep.json` is the manifest.
const MANIFEST: &str = "runs.json";

/// Its content.
#[derive(Debug, Serialize, Deserialize)]
struct Manifest {
    runs: Vec<PathBuf>,
}

/// The files of a comparison of runs.
static LAYOUT: FolderLayout = FolderLayout {
    lock: "lock",
    is_result: |name| [MANIFEST, STANDINGS, RECORDING].contains(&name) || is_scenario(name),
    is_temporary: |name| name == "comparison",
};

/// Maximum length of the names in the folder name [characters].
const MAX_NAME: usize = 120;

/// Whether a file of this name is the scenario of a compared run: `scenario-1.toml`, `scenario-2.toml` ...
fn is_scenario(name: &str) -> bool {
    let number = name.strip_prefix("scenario-").and_then(|rest| rest.strip_suffix(".toml"));
    number.is_some_and(|number| number.parse::<usize>().is_ok())
}

/// The runs that the comparison in `folder` compares; `None` if it is none of runs.
pub fn compared_runs(folder: &Path) -> Result<Option<Vec<PathBuf>>, Error> {
    let Ok(text) = read_regular(&folder.join(MANIFEST)) else { return Ok(None) };
    let refuse = |error| {
        InputError::new(
            "comparison",
            folder,
            format_args!("{MANIFEST}: {error}: expected that of a comparison of runs"),
        )
    };
    let Manifest { runs } = serde_json::from_slice(&text).map_err(refuse)?;
    Ok(Some(runs))
}

/// The default folder for a comparison of strategies.
pub fn of_strategies(sweep: &Sweep, scenario: &Path) -> PathBuf {
    let definition = &sweep.definition;
    let strategies = definition.strategies.iter().cloned();
    let names = [name_of(scenario)].into_iter().chain(strategies).chain([definition.seeds.len().to_string()]);
    default_folder(&names.collect::<Vec<_>>(), &definition.identity)
}

/// Creates and locks the folder for a comparison of these runs, `out` or the default one. Removes an earlier comparison
/// of the same runs, and with `earlier` replaced of any.
///
/// # Errors
/// If the folder contains other files, is in use by another process, or cannot be created.
pub fn make_for_runs(runs: &[PathBuf], out: Option<&Path>, earlier: Earlier) -> Result<OutputFolder, Error> {
    let absolute = |run: &PathBuf| Ok(fs::canonicalize(run).at(run)?.to_string_lossy().into_owned().into());
    let absolute = runs.iter().map(absolute).collect::<Result<_, Error>>()?;
    let text = format!("{:#}\n", json!(Manifest { runs: absolute }));
    let identity = format!("{:016x}", xxh3_64(text.as_bytes()));
    let default = || default_folder(&runs.iter().map(|run| name_of(run)).collect::<Vec<_>>(), &identity);
    let out = out.map_or_else(default, Path::to_owned);
    let refuse = |message: &str| Error::from(InputError::new("output folder", &out, message));
    if !out.is_dir() && fs::symlink_metadata(&out).is_ok() {
        return Err(refuse("it is no folder: choose another --out"));
    }
    let cannot_create = |source| MissionError::File { path: out.clone(), source }.into();
    let check = || -> Result<(), Error> {
        let content = LAYOUT.content(&out).at(&out)?;
        if !content.foreign.is_empty() {
            return Err(refuse("it contains other files than a comparison of runs: choose another --out"));
        }
        let is_kept = earlier == Earlier::Kept && !content.is_empty();
        if is_kept && read_regular(&out.join(MANIFEST)).ok().as_deref() != Some(text.as_bytes()) {
            return Err(refuse(
                "it contains a comparison of other runs: choose another --out, or pass --force to replace it",
            ));
        }
        Ok(())
    };
    let message = "another comparison is writing it: choose another --out";
    let folder = LAYOUT.open(&out, cannot_create, check)?.ok_or_else(|| refuse(message))?;
    folder.remove_results()?; // a run may have changed since
    write_whole(&out.join(MANIFEST), text.as_bytes())?;
    for (index, run) in runs.iter().enumerate() {
        let scenario = run.join("scenario.toml");
        write_whole(&out.join(format!("scenario-{}.toml", index + 1)), &read_regular(&scenario).at(&scenario)?)?;
    }
    Ok(folder)
}

/// The default folder of a comparison. `identity` makes it unique where the names do not.
fn default_folder(names: &[String], identity: &str) -> PathBuf {
    let name: String = names.join("-").replace('/', "-").chars().take(MAX_NAME).collect();
    Path::new("runs").join(format!("compare-{name}-{identity:.8}"))
}
