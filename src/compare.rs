//! `skysink compare`: missions side by side, as a table and as one recording.

#[cfg(feature = "viewer")]
mod recording;

use std::fs;
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_lab::compare::{Contender, MetricStanding, standings};
use skysink_lab::metrics::Metric;
use skysink_lab::sweep::plan::{Shard, Sweep, SweepBase};
use skysink_lab::sweep::sweep;
use skysink_mission::error::FileContext;
use skysink_mission::record::write_whole;
use skysink_planner::settings;
use skysink_planner::strategies::Registered;
use toml::Table;
use xxhash_rust::xxh3::xxh3_64;

use crate::cli::research::{ended_early, flown_in};
use crate::error::Error;
use crate::report::{TerminalProgress, print, table, with_numbers_right};

/// The standings, beside the recording.
const STANDINGS: &str = "comparison.json";

/// Most letters of a folder's name that are those of what is compared.
const MOST_LETTERS: usize = 120;

/// The recording.
const RECORDING: &str = "comparison.rrd";

/// What is compared, and where it is put.
#[derive(Debug)]
pub struct Compare {
    /// What is compared.
    pub what: Compared,
    /// Folder to write, instead of the usual one.
    pub out: Option<PathBuf>,
    /// Whether to leave a recording.
    pub record: bool,
    /// Whether the standings are printed for machines.
    pub json: bool,
}

/// What is compared.
#[derive(Debug)]
pub enum Compared {
    /// Strategies over the fields of a scenario.
    Strategies {
        /// The scenario file.
        scenario: PathBuf,
        /// What is changed in it.
        overrides: Overrides,
        /// The strategies.
        strategies: Vec<&'static Registered>,
        /// How many seeds, from the scenario's on.
        seeds: u64,
    },
    /// Runs on record.
    Runs(Vec<PathBuf>),
}

/// One that is compared, as far as it is shown.
#[cfg_attr(not(feature = "viewer"), expect(dead_code, reason = "only recordings fly it again"))]
struct Shown {
    contender: Contender,
    /// The seed of the mission that the recording shows.
    seed: u64,
    flight: Flight,
}

/// How the mission of the recording is flown.
#[cfg_attr(not(feature = "viewer"), expect(dead_code, reason = "only recordings fly it again"))]
enum Flight {
    /// By the strategy of a scenario.
    Planned(Box<Scenario>),
    /// As on record.
    OnRecord(PathBuf),
}

/// Flies what is missing, prints how it stands, and leaves a recording.
///
/// # Errors
/// If an input is refused, something cannot be written, or on a stop.
pub fn compare(compare: &Compare, stop: &Stop) -> Result<(), Error> {
    #[cfg(not(feature = "viewer"))]
    if compare.record {
        return Err(Error::NoViewer);
    }
    let (out, shown, differing) = match &compare.what {
        Compared::Strategies { scenario, overrides, strategies, seeds } => {
            let sweep = one_point(scenario, overrides, strategies, *seeds)?;
            let out = compare.out.clone().unwrap_or_else(|| folder_of_strategies(&sweep, scenario, overrides, *seeds));
            (out.clone(), fly(&sweep, strategies, scenario, overrides, &out, stop)?, Vec::new())
        }
        Compared::Runs(folders) => {
            let shown = on_record(folders, stop)?;
            let names: Vec<String> = shown.iter().map(|shown| shown.contender.label.clone()).collect();
            let out = compare.out.clone().unwrap_or_else(|| default_folder(&names.join("-")));
            make_folder(&out)?;
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
    print_standings(&contenders, &standings)?;
    print(format_args!("All metrics:     {}", out.join(STANDINGS).display()))?;
    if compare.record {
        print(format_args!("Open recording:  rerun {}", out.join(RECORDING).display()))?;
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
    Ok(Sweep::new(path, base, Table::new(), strategies.to_vec(), seeds)?)
}

/// Flies a sweep in `out` as far as it is not yet flown.
fn fly(
    plan: &Sweep,
    strategies: &[&'static Registered],
    path: &Path,
    overrides: &Overrides,
    out: &Path,
    stop: &Stop,
) -> Result<Vec<Shown>, Error> {
    let rows = sweep(plan, out, Shard::WHOLE, 0, stop, &TerminalProgress::of_missions());
    let rows = rows.map_err(|error| ended_early(error, &flown_in(out)))?;
    let contenders = Contender::of_sweep(&plan.definition, &rows);
    let shown = |(contender, strategy): (Contender, &&'static Registered)| {
        let overrides = Overrides { strategy: Some(strategy.name), ..overrides.clone() };
        let scenario = Scenario::read(path, overrides).and_then(settings::resolve)?;
        Ok(Shown { contender, seed: scenario.seed, flight: Flight::Planned(Box::new(scenario)) })
    };
    contenders.into_iter().zip(strategies).map(shown).collect()
}

/// The runs in these folders.
fn on_record(folders: &[PathBuf], stop: &Stop) -> Result<Vec<Shown>, Error> {
    for (index, folder) in folders.iter().enumerate() {
        let same = |other: &PathBuf| fs::canonicalize(other).ok() == fs::canonicalize(folder).ok();
        if folder.is_dir() && folders[..index].iter().any(same) {
            return Err(InputError::new("run folder", folder, "it is named twice: expected each once").into());
        }
    }
    let shown = |folder: &PathBuf| -> Result<Shown, Error> {
        let contender = Contender::of_run(folder, &label(folder, folders), stop)?;
        let scenario = Scenario::read(&folder.join("scenario.toml"), Overrides::default())?;
        Ok(Shown { contender, seed: scenario.seed, flight: Flight::OnRecord(folder.clone()) })
    };
    folders.iter().map(shown).collect()
}

/// The name of a run's folder; its whole path if another has the same name.
fn label(folder: &Path, folders: &[PathBuf]) -> String {
    let same = folders.iter().filter(|other| name_of(other) == name_of(folder)).count();
    if same > 1 { folder.display().to_string() } else { name_of(folder) }
}

/// The last part of a path, without its ending.
fn name_of(path: &Path) -> String {
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    name.map_or_else(|| "run".to_owned(), |name| name.to_string_lossy().into_owned())
}

/// The usual folder of these strategies over a scenario: another one for other seeds and other keys.
fn folder_of_strategies(sweep: &Sweep, scenario: &Path, overrides: &Overrides, seeds: u64) -> PathBuf {
    let definition = &sweep.definition;
    let mut name = name_of(scenario);
    definition.strategies.iter().for_each(|strategy| name += &format!("-{}", strategy.name));
    name += &format!("-{seeds}");
    if *overrides != Overrides::default() {
        name += &format!("-{:.8}", definition.identity);
    }
    default_folder(&name)
}

/// The usual folder of a comparison of this name, which is cut where a file system would.
fn default_folder(name: &str) -> PathBuf {
    let name = name.replace('/', "-");
    let short: String = name.chars().take(MOST_LETTERS).collect();
    let name = if short == name { name } else { format!("{short}-{:08x}", xxh3_64(name.as_bytes()) as u32) };
    Path::new("runs").join(format!("compare-{name}"))
}

/// Makes the folder of a comparison of runs, or takes one that holds nothing else.
fn make_folder(out: &Path) -> Result<(), Error> {
    fs::create_dir_all(out).at(out)?;
    for entry in fs::read_dir(out).at(out)?.flatten() {
        let ours = [STANDINGS, RECORDING, ".comparison.json.new", ".comparison.new.rrd"];
        if !ours.iter().any(|name| entry.file_name() == *name) {
            let message = "it holds something else than a comparison: choose another --out";
            return Err(InputError::new("output folder", out, message).into());
        }
    }
    Ok(())
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
        let of =
            |keys: &Vec<(String, String)>| keys.iter().find(|(key, _)| key == name).map(|(_, value)| value.clone());
        all.iter().map(|keys| of(keys).unwrap_or_else(|| "-".to_owned())).collect()
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

/// A line of the table: its name, the metric, what it is multiplied by, and its decimals.
type Line = (&'static str, Metric, f64, usize);

const LINES: [Line; 8] = [
    ("data loss rate η", Metric::LossRate, 1.0, 4),
    ("delivered [Mbit]", Metric::DeliveredBits, 1e-6, 3),
    ("SNs served per slot", Metric::MeanServed, 1.0, 3),
    ("flown [km]", Metric::FlownM, 1e-3, 2),
    ("energy [kJ]", Metric::EnergyJ, 1e-3, 1),
    ("service age [s]", Metric::AoiMeanS, 1.0, 1),
    ("data age [s]", Metric::DataAgeMeanS, 1.0, 1),
    ("plan p50 [µs]", Metric::PlanP50Us, 1.0, 1),
];

/// The lines of η with a 95 % confidence interval and the differences from the first, then those of other metrics.
fn print_standings(contenders: &[Contender], standings: &[MetricStanding]) -> Result<(), Error> {
    let find = |contender: &Contender, metric: Metric| {
        standings.iter().find(|standing| standing.label == contender.label && standing.metric == metric.name())
    };
    let mut table = table();
    let labels = contenders.iter().map(|contender| contender.label.clone());
    table.set_header([String::new()].into_iter().chain(labels));
    let mut row = |name: String, cell: &dyn Fn(&Contender) -> Option<String>| {
        let cells: Vec<String> = contenders.iter().map(|contender| cell(contender).unwrap_or_default()).collect();
        if cells.iter().any(|cell| !cell.is_empty()) {
            table.add_row([name].into_iter().chain(cells));
        }
    };
    for (name, metric, factor, decimals) in LINES {
        row(name.to_owned(), &|contender| Some(format!("{:.decimals$}", find(contender, metric)?.mean * factor)));
        if metric == Metric::LossRate {
            row("  95 % interval".to_owned(), &|contender| interval(find(contender, metric)?.ci95?));
            let first = &contenders[0].label;
            row(format!("  minus that of {first}"), &|contender| {
                Some(format!("{:+.4}", find(contender, metric)?.difference?))
            });
            row("  95 % interval".to_owned(), &|contender| interval(find(contender, metric)?.difference_ci95?));
        }
    }
    print(with_numbers_right(table))?;
    let missions =
        contenders.iter().filter_map(|contender| find(contender, Metric::LossRate)).map(|standing| standing.n);
    match missions.max() {
        Some(missions) if missions > 1 => print(format_args!("{missions} missions each; differences by seed.")),
        _ => Ok(()),
    }
}

fn interval([low, high]: [f64; 2]) -> Option<String> {
    Some(format!("[{low:.3}, {high:.3}]"))
}
