//! Where a comparison is put: in a folder that is its own, and that no other comparison replaces.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_lab::sweep::plan::Sweep;
use skysink_mission::error::FileContext;
use skysink_mission::record::{is_unfinished, write_whole};
use xxhash_rust::xxh3::xxh3_64;

use super::{RECORDING, STANDINGS, name_of};
use crate::error::Error;

/// What says which runs a comparison is of; `sweep.json` does where it is of strategies.
const MANIFEST: &str = "runs.json";

/// Most letters of a folder's name that are those of what is compared.
const MOST_LETTERS: usize = 120;

/// The runs that are compared, by the paths of their folders from the root.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct ComparedRuns {
    runs: Vec<String>,
}

impl ComparedRuns {
    fn of(folders: &[PathBuf]) -> Result<Self, Error> {
        let whole = |folder: &PathBuf| Ok(fs::canonicalize(folder).at(folder)?.to_string_lossy().into_owned());
        Ok(Self { runs: folders.iter().map(whole).collect::<Result<_, Error>>()? })
    }

    fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("plain strings") + "\n"
    }
}

/// The usual folder of strategies over a scenario.
pub(super) fn of_strategies(sweep: &Sweep, scenario: &Path) -> PathBuf {
    let definition = &sweep.definition;
    let strategies = definition.strategies.iter().cloned();
    let names = [name_of(scenario)].into_iter().chain(strategies).chain([definition.seeds.len().to_string()]);
    usual(&names.collect::<Vec<_>>(), &definition.identity)
}

/// Makes the folder of a comparison of these runs, `out` or the usual one. An earlier comparison of them is replaced.
///
/// # Errors
/// If it holds something else, or cannot be made.
pub(super) fn make_for_runs(runs: &[PathBuf], out: Option<&Path>) -> Result<PathBuf, Error> {
    let text = ComparedRuns::of(runs)?.to_json();
    let identity = format!("{:016x}", xxh3_64(text.as_bytes()));
    let usual = || usual(&runs.iter().map(|run| name_of(run)).collect::<Vec<_>>(), &identity);
    let out = out.map_or_else(usual, Path::to_owned);
    let refuse = |message: &str| Error::from(InputError::new("output folder", &out, message));
    let is_folder = out.is_dir();
    if !is_folder && fs::symlink_metadata(&out).is_ok() {
        return Err(refuse("it is no folder: choose another --out"));
    }
    fs::create_dir_all(&out).at(&out)?;
    let mut is_empty = true;
    for entry in fs::read_dir(&out).at(&out)? {
        let name = entry.at(&out)?.file_name();
        is_empty &= is_unfinished(&name);
        if ![MANIFEST, STANDINGS, RECORDING].iter().any(|ours| name == *ours) && !is_unfinished(&name) {
            return Err(refuse("it holds something else than a comparison of runs: choose another --out"));
        }
    }
    let manifest = out.join(MANIFEST);
    if !is_empty && fs::read(&manifest).ok().as_deref() != Some(text.as_bytes()) {
        return Err(refuse("it holds a comparison of other runs: choose another --out"));
    }
    // A run may have been flown anew since: nothing of the earlier comparison stays beside what is written now.
    for file in [STANDINGS, RECORDING].map(|name| out.join(name)) {
        if fs::symlink_metadata(&file).is_ok() {
            fs::remove_file(&file).at(&file)?;
        }
    }
    write_whole(&manifest, text.as_bytes())?;
    Ok(out)
}

/// The usual folder of a comparison of what has these names: whatever they are, `identity` keeps it from those of
/// others.
fn usual(names: &[String], identity: &str) -> PathBuf {
    let name: String = names.join("-").replace('/', "-").chars().take(MOST_LETTERS).collect();
    Path::new("runs").join(format!("compare-{name}-{identity:.8}"))
}
