//! The strategies or runs that are compared, each with its missions and the one that the recording shows.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_lab::compare::Contender;
use skysink_lab::sweep::definition::MissionKey;
use skysink_lab::sweep::plan::Sweep;
use skysink_lab::sweep::settings::{SweepBase, SweepSettings};
use skysink_lab::sweep::shard::Shard;
use skysink_lab::sweep::sweep;
use skysink_planner::settings;
use toml::Table;

use crate::error::{Error, ended_early, flown_in};
use crate::report::TerminalProgress;

/// A contender, and its mission in the recording.
#[cfg_attr(not(feature = "viewer"), expect(dead_code, reason = "only the recording simulates it"))]
pub struct ShownContender {
    pub contender: Contender,
    /// The scenario of the mission in the recording.
    pub scenario: Scenario,
    /// The folder of the run that is replayed; `None` for a mission that the strategy of the scenario plans.
    pub run: Option<PathBuf>,
}

/// The sweep of strategies over the scenario file `path` with these changes, and with consecutive seeds, as many as
/// `seeds`, from the scenario's on.
pub fn sweep_of(path: &Path, overrides: Overrides, strategies: Vec<String>, seeds: u64) -> Result<Sweep, Error> {
    let scenario = Scenario::read(path, overrides).and_then(settings::resolve)?;
    let table = scenario.to_toml().parse::<Table>().expect("it was just written");
    let base = SweepBase { path: path.to_owned(), table, held: Overrides::default() };
    let seeds = (scenario.seed..).take(seeds as usize).collect();
    let settings =
        SweepSettings { base, axes: Table::new(), strategies, seeds, external: Vec::new(), models: Vec::new() };
    Ok(Sweep::new(path, settings)?)
}

/// Runs or resumes the sweep `plan` over one scenario in the folder `out`.
pub fn fly_contenders(plan: &Sweep, out: &Path, stop: &Stop) -> Result<Vec<ShownContender>, Error> {
    let journal = sweep(plan, out, Shard::WHOLE, 0, stop, &TerminalProgress::of_missions());
    let journal = journal.map_err(|error| ended_early(error, &flown_in(out)))?;
    let contenders = Contender::of_sweep(&plan.definition, &journal.rows);
    let shown = |(strategy, contender): (usize, Contender)| {
        let scenario = plan.scenario(MissionKey { point: 0, strategy, seed: plan.definition.seeds[0] })?;
        Ok(ShownContender { contender, scenario, run: None })
    };
    contenders.into_iter().enumerate().map(shown).collect()
}

/// Reads the runs in these folders.
pub fn read_runs(folders: &[PathBuf], stop: &Stop) -> Result<Vec<ShownContender>, Error> {
    for (index, folder) in folders.iter().enumerate() {
        let same = |other: &PathBuf| fs::canonicalize(other).ok() == fs::canonicalize(folder).ok();
        if folder.is_dir() && folders[..index].iter().any(same) {
            return Err(InputError::new("run folder", folder, "it is given twice: expected each run once").into());
        }
    }
    let shown = |folder: &PathBuf| -> Result<ShownContender, Error> {
        let contender = Contender::of_run(folder, &label(folder, folders), stop)?;
        let path = folder.join("scenario.toml");
        let scenario = Scenario::read(&path, Overrides::default()).and_then(settings::resolve)?;
        Ok(ShownContender { contender, scenario, run: Some(folder.clone()) })
    };
    folders.iter().map(shown).collect()
}

/// The name of a run folder, or its path if another folder has the same name.
fn label(folder: &Path, folders: &[PathBuf]) -> String {
    let same = folders.iter().filter(|other| name_of(other) == name_of(folder)).count();
    if same > 1 { folder.display().to_string() } else { name_of(folder) }
}

/// The last component of a path; for a file, without its extension.
pub fn name_of(path: &Path) -> String {
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    name.map_or_else(|| "run".to_owned(), |name| name.to_string_lossy().into_owned())
}

/// The keys in which the scenarios of the contenders differ, with the value of each.
pub fn differing_keys(shown: &[ShownContender]) -> Vec<(String, Vec<String>)> {
    let keys = |one: &ShownContender| {
        let table = one.scenario.to_toml().parse::<Table>().expect("it was just written");
        let mut keys = Vec::new();
        flatten("", &table, &mut keys);
        keys
    };
    let all: Vec<Vec<(String, String)>> = shown.iter().map(keys).collect();
    let names: BTreeSet<&String> = all.iter().flatten().map(|(key, _)| key).collect();
    let values = |name: &String| -> Vec<String> {
        let find =
            |keys: &Vec<(String, String)>| keys.iter().find(|(key, _)| key == name).map(|(_, value)| value.clone());
        all.iter().map(|keys| find(keys).unwrap_or_else(|| "-".to_owned())).collect()
    };
    let pairs = names.into_iter().map(|name| (name.clone(), values(name)));
    pairs.filter(|(_, values)| values.iter().any(|value| *value != values[0])).collect()
}

/// The values of a table under their dotted keys.
fn flatten(prefix: &str, table: &Table, into: &mut Vec<(String, String)>) {
    for (key, value) in table {
        let key = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match value {
            toml::Value::Table(inner) => flatten(&key, inner, into),
            value => into.push((key, value.to_string())),
        }
    }
}
