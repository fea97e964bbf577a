//! `skysink compare`: compares missions in tables and in one recording.

mod folder;
#[cfg(feature = "viewer")]
mod recording;
mod standings;

use std::fs;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_lab::compare::{Contender, standings};
use skysink_lab::sweep::plan::{Shard, Sweep, SweepBase};
use skysink_lab::sweep::sweep;
use skysink_mission::record::write_whole;
use skysink_planner::settings;
use skysink_planner::strategies::Registered;
use toml::Table;

use crate::error::{Error, ended_early, flown_in};
use crate::report::{TerminalProgress, print};

/// File name of the standings.
const STANDINGS: &str = "comparison.json";

/// File name of the recording.
const RECORDING: &str = "comparison.rrd";

/// A comparison and its outputs.
#[derive(Debug)]
pub struct Compare {
    /// The strategies or runs.
    pub what: Compared,
    /// Output folder; `None` for the default.
    pub out: Option<PathBuf>,
    /// Whether to write a recording.
    pub record: bool,
    /// Whether to print the standings as JSON.
    pub json: bool,
}

/// The strategies or runs to compare.
#[derive(Debug)]
pub enum Compared {
    /// Strategies over the fields of a scenario.
    Strategies {
        /// The scenario file.
        scenario: PathBuf,
        /// Changes of its keys.
        overrides: Overrides,
        /// The strategies.
        strategies: Vec<&'static Registered>,
        /// Number of consecutive seeds, starting at the scenario's.
        seeds: u64,
    },
    /// Finished runs.
    Runs(Vec<PathBuf>),
}

/// A contender, and its mission in the recording.
#[cfg_attr(not(feature = "viewer"), expect(dead_code, reason = "only the recording simulates it"))]
struct ShownContender {
    contender: Contender,
    /// The seed of the mission in the recording.
    seed: u64,
    flight: FlightSource,
}

/// The source of the mission in the recording.
#[cfg_attr(not(feature = "viewer"), expect(dead_code, reason = "only the recording simulates it"))]
enum FlightSource {
    /// Planned by the strategy of a scenario.
    Planned(Box<Scenario>),
    /// Replayed from a run folder.
    Recorded(PathBuf),
}

/// Simulates missing missions, prints the standings, and writes a recording.
///
/// # Errors
/// If an input is refused, a file cannot be written, or on a stop.
pub fn compare(compare: &Compare, stop: &Stop) -> Result<(), Error> {
    #[cfg(not(feature = "viewer"))]
    if compare.record {
        return Err(Error::NoViewer);
    }
    let (out, shown, differing) = match &compare.what {
        Compared::Strategies { scenario, overrides, strategies, seeds } => {
            let sweep = one_point(scenario, overrides, strategies, *seeds)?;
            let out = compare.out.clone().unwrap_or_else(|| folder::of_strategies(&sweep, scenario));
            (out.clone(), fly(&sweep, strategies, scenario, overrides, &out, stop)?, Vec::new())
        }
        Compared::Runs(folders) => {
            let shown = read_runs(folders, stop)?;
            let out = folder::make_for_runs(folders, compare.out.as_deref())?;
            (out, shown, differing_keys(folders)?)
        }
    };
    let contenders: Vec<Contender> = shown.iter().map(|shown| shown.contender.clone()).collect();
    let standings = standings(&contenders);
    let text = serde_json::to_string_pretty(&standings).expect("plain numbers and strings");
    write_whole(&out.join(STANDINGS), (text.clone() + "\n").as_bytes())?;
    #[cfg(feature = "viewer")]
    if compare.record {
        recording::record(&shown, &out.join(RECORDING), stop)?;
    }
    if compare.json {
        return print(text);
    }
    for (key, values) in differing {
        print(format_args!("{key}: {}", values.join(" | ")))?;
    }
    standings::print_tables(&contenders, &standings)?;
    print(format_args!("All metrics:     {}", out.join(STANDINGS).display()))?;
    if compare.record {
        print(format_args!("Open recording:  skysink view {}", out.join(RECORDING).display()))?;
    }
    Ok(())
}

/// The sweep of the strategies over one scenario.
fn one_point(
    path: &Path,
    overrides: &Overrides,
    strategies: &[&'static Registered],
    seeds: u64,
) -> Result<Sweep, Error> {
    let scenario = Scenario::read(path, overrides.clone()).and_then(settings::resolve)?;
    let table = scenario.to_toml().parse::<Table>().expect("it was just written");
    let base = SweepBase { path: path.to_owned(), table };
    let seeds = (scenario.seed..).take(seeds as usize).collect();
    let strategies = strategies.iter().map(|strategy| strategy.name.to_owned()).collect();
    Ok(Sweep::new(path, base, Table::new(), strategies, seeds, Vec::new())?)
}

/// Runs or resumes the sweep in `out`.
fn fly(
    plan: &Sweep,
    strategies: &[&'static Registered],
    path: &Path,
    overrides: &Overrides,
    out: &Path,
    stop: &Stop,
) -> Result<Vec<ShownContender>, Error> {
    let journal = sweep(plan, out, Shard::WHOLE, 0, stop, &TerminalProgress::of_missions());
    let rows = journal.and_then(|journal| journal.all()).map_err(|error| ended_early(error, &flown_in(out)))?;
    let contenders = Contender::of_sweep(&plan.definition, &rows);
    let shown = |(contender, strategy): (Contender, &&'static Registered)| {
        let overrides = Overrides { strategy: Some(strategy.name), ..overrides.clone() };
        let scenario = Scenario::read(path, overrides).and_then(settings::resolve)?;
        Ok(ShownContender { contender, seed: scenario.seed, flight: FlightSource::Planned(Box::new(scenario)) })
    };
    contenders.into_iter().zip(strategies).map(shown).collect()
}

/// Reads the runs in these folders.
fn read_runs(folders: &[PathBuf], stop: &Stop) -> Result<Vec<ShownContender>, Error> {
    for (index, folder) in folders.iter().enumerate() {
        let same = |other: &PathBuf| fs::canonicalize(other).ok() == fs::canonicalize(folder).ok();
        if folder.is_dir() && folders[..index].iter().any(same) {
            return Err(InputError::new("run folder", folder, "it is given twice: expected each run once").into());
        }
    }
    let shown = |folder: &PathBuf| -> Result<ShownContender, Error> {
        let contender = Contender::of_run(folder, &label(folder, folders), stop)?;
        let scenario = Scenario::read(&folder.join("scenario.toml"), Overrides::default())?;
        Ok(ShownContender { contender, seed: scenario.seed, flight: FlightSource::Recorded(folder.clone()) })
    };
    folders.iter().map(shown).collect()
}

/// The name of a run folder, or its path if another folder has the same name.
fn label(folder: &Path, folders: &[PathBuf]) -> String {
    let same = folders.iter().filter(|other| name_of(other) == name_of(folder)).count();
    if same > 1 { folder.display().to_string() } else { name_of(folder) }
}

/// The last component of a path; for a file, without its extension.
fn name_of(path: &Path) -> String {
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    name.map_or_else(|| "run".to_owned(), |name| name.to_string_lossy().into_owned())
}

/// The keys in which the scenarios of the runs differ, with the value of each.
fn differing_keys(folders: &[PathBuf]) -> Result<Vec<(String, Vec<String>)>, Error> {
    let keys = |folder: &PathBuf| -> Result<Vec<(String, String)>, Error> {
        let scenario = Scenario::read(&folder.join("scenario.toml"), Overrides::default())?;
        let table = scenario.to_toml().parse::<Table>().expect("it was just written");
        let mut keys = Vec::new();
        flatten("", &table, &mut keys);
        Ok(keys)
    };
    let all = folders.iter().map(keys).collect::<Result<Vec<_>, _>>()?;
    let mut names: Vec<&String> = all.iter().flatten().map(|(key, _)| key).collect();
    names.sort_unstable();
    names.dedup();
    let values = |name: &String| -> Vec<String> {
        let find =
            |keys: &Vec<(String, String)>| keys.iter().find(|(key, _)| key == name).map(|(_, value)| value.clone());
        all.iter().map(|keys| find(keys).unwrap_or_else(|| "-".to_owned())).collect()
    };
    let pairs = names.into_iter().map(|name| (name.clone(), values(name)));
    Ok(pairs.filter(|(_, values)| values.iter().any(|value| *value != values[0])).collect())
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
