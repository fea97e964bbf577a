//! The definition of a sweep: a grid of scenarios, by strategy and seed.

use std::collections::BTreeSet;
use std::fmt::{self, Display, Formatter};
use std::iter::zip;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use skysink_common::error::{InputError, read_text};
use skysink_common::scenario::{MAX_SEED, Overrides, Scenario, Setting, SettingOrigin};
use skysink_common::sensors::SensorList;
use skysink_planner::settings;
use skysink_planner::strategies::{Registered, expected};
use xxhash_rust::xxh3::Xxh3;

use crate::error::LabError;

/// A sweep file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    scenario: PathBuf,
    strategies: Vec<String>,
    seeds: Seeds,
    #[serde(default)]
    axes: toml::Table,
}

/// `20` for 1 to 20, or a list.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "expected a number of seeds or a list of seeds")]
enum Seeds {
    Count(u64),
    List(Vec<u64>),
}

/// Maximum number of missions of a sweep.
const MAX_MISSIONS: usize = 100_000_000;

/// Everything that the results of a sweep depend on, as in `sweep.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Definition {
    /// Hash of the other fields and of the scenarios.
    pub identity: String,
    /// Version of Skysink.
    pub version: String,
    /// Dotted names of the swept keys.
    pub keys: Vec<String>,
    /// The values of the keys, by point of the grid; the last key varies fastest.
    pub points: Vec<Vec<toml::Value>>,
    /// Names of the strategies, in the order of the results.
    pub strategies: Vec<String>,
    /// Seeds, ascending. All strategies use the same seeds and thus the same fields.
    pub seeds: Vec<u64>,
}

impl Definition {
    /// The number of fields: points of the grid times seeds.
    #[must_use]
    pub fn fields(&self) -> usize {
        self.points.len() * self.seeds.len()
    }

    /// The number of missions: fields times strategies.
    #[must_use]
    pub fn mission_count(&self) -> usize {
        self.fields() * self.strategies.len()
    }

    /// The missions of a shard, in the order of the results: those over every n-th field from the k-th, in the order of
    /// points and seeds. Empty if k exceeds the number of fields.
    pub fn missions(&self, shard: Shard) -> impl Iterator<Item = MissionKey> {
        let indices = (0..self.mission_count()).filter(move |&index| self.shard_of(index, shard.n()) == shard.k());
        indices.map(|index| {
            let group = index / self.seeds.len();
            let strategies = self.strategies.len();
            let seed = self.seeds[index % self.seeds.len()];
            MissionKey { point: group / strategies, strategy: group % strategies, seed }
        })
    }

    /// The shard, of `n`, that contains the mission with this index in the results of the whole sweep.
    pub(super) fn shard_of(&self, index: usize, n: usize) -> usize {
        let seeds = self.seeds.len();
        let point = index / seeds / self.strategies.len();
        (point * seeds + index % seeds) % n + 1
    }

    /// The index of a mission in the results of the whole sweep; `None` if it does not belong to the sweep.
    #[must_use]
    pub fn index(&self, MissionKey { point, strategy, seed }: MissionKey) -> Option<usize> {
        let seed = self.seeds.binary_search(&seed).ok()?;
        let exists = point < self.points.len() && strategy < self.strategies.len();
        exists.then(|| (point * self.strategies.len() + strategy) * self.seeds.len() + seed)
    }

    /// Whether the sweep contains this mission.
    #[must_use]
    pub fn contains(&self, mission: MissionKey) -> bool {
        self.index(mission).is_some()
    }
}

/// A sweep with its scenarios.
#[derive(Debug)]
pub struct Sweep {
    /// The definition.
    pub definition: Definition,
    base: SweepBase,
    external: Vec<ExternalStrategy>,
    /// Cache of the latest scenario, because the next mission usually differs only in its seed.
    latest: Mutex<Option<(MissionKey, Scenario)>>,
}

/// A strategy outside the registry, whose missions the caller simulates.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExternalStrategy {
    /// Its name in the sweep file and in the results.
    pub name: String,
    /// Identifies its version, for example by its source.
    pub version: String,
}

/// The base scenario of a sweep.
#[derive(Debug)]
pub struct SweepBase {
    /// Its path; files that it names are relative to it.
    pub path: PathBuf,
    /// Its keys.
    pub table: toml::Table,
}

/// Shard k of n of a sweep, k from 1 to n.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "(usize, usize)", into = "(usize, usize)")]
pub struct Shard {
    k: usize,
    n: usize,
}

impl Shard {
    /// The whole sweep.
    pub const WHOLE: Self = Self { k: 1, n: 1 };

    /// Shard `k` of `n`; `None` unless k is 1 to n.
    #[must_use]
    pub fn new(k: usize, n: usize) -> Option<Self> {
        (1..=n).contains(&k).then_some(Self { k, n })
    }

    /// The index of the shard, from 1.
    #[must_use]
    pub fn k(self) -> usize {
        self.k
    }

    /// The number of shards.
    #[must_use]
    pub fn n(self) -> usize {
        self.n
    }
}

impl TryFrom<(usize, usize)> for Shard {
    type Error = &'static str;

    fn try_from((k, n): (usize, usize)) -> Result<Self, Self::Error> {
        Self::new(k, n).ok_or("shard: expected [k, n] with k from 1 to n")
    }
}

impl From<Shard> for (usize, usize) {
    fn from(Shard { k, n }: Shard) -> Self {
        (k, n)
    }
}

impl Display for Shard {
    fn fmt(&self, formatter: &mut Formatter) -> fmt::Result {
        write!(formatter, "{} of {}", self.k, self.n)
    }
}

/// One mission of a sweep. The order is that of the results.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct MissionKey {
    /// Point of the grid.
    pub point: usize,
    /// Index of the strategy in the sweep's list.
    pub strategy: usize,
    /// The seed.
    pub seed: u64,
}

impl Sweep {
    /// Reads a sweep file and checks every point of its grid. The file may name strategies of the registry and
    /// `external` ones.
    ///
    /// # Errors
    /// If the file, its scenario, a strategy or a point is refused.
    pub fn read(path: &Path, external: Vec<ExternalStrategy>) -> Result<Self, LabError> {
        if path.is_dir() {
            let what = "it is a folder: expected a sweep file, and the folder as --out";
            return Err(InputError::new("sweep", path, what).into());
        }
        let text = read_text("sweep", path)?;
        let is_scenario = text.parse::<toml::Table>().is_ok_and(|table| table.contains_key("name"));
        if is_scenario {
            let what = "it is a scenario: expected a sweep (use skysink simulate for this file)";
            return Err(InputError::new("sweep", path, what).into());
        }
        let file: File = toml::from_str(&text).map_err(|error| InputError::toml("sweep", path, &text, &error))?;
        let base_path = path.parent().unwrap_or(Path::new("")).join(&file.scenario);
        Scenario::read(&base_path, Overrides::default()).and_then(settings::resolve)?;
        let text = read_text("scenario", &base_path)?;
        let table = text.parse().map_err(|error| InputError::toml("scenario", &base_path, &text, &error))?;
        let base = SweepBase { path: base_path, table };
        let seeds = match file.seeds {
            Seeds::Count(count) if count > MAX_MISSIONS as u64 => {
                let what = format!("seeds = {count}: expected at most {MAX_MISSIONS}");
                return Err(InputError::new("sweep", path, what).into());
            }
            Seeds::Count(0) => {
                let what = "seeds = 0: expected 1 or more, or a list of seeds";
                return Err(InputError::new("sweep", path, what).into());
            }
            Seeds::Count(count) => (1..=count).collect(),
            Seeds::List(list) => list,
        };
        Self::new(path, base, file.axes, file.strategies, seeds, external)
    }

    /// Checks a sweep and every point of its grid. `path` names the sweep in errors.
    ///
    /// # Errors
    /// If the axes, strategies or seeds, or a point of the grid is refused.
    pub fn new(
        path: &Path,
        base: SweepBase,
        axes: toml::Table,
        strategies: Vec<String>,
        seeds: Vec<u64>,
        external: Vec<ExternalStrategy>,
    ) -> Result<Self, LabError> {
        let refuse = |key: &str, expected: &str| InputError::new("sweep", path, format!("{key}: expected {expected}"));
        let names: Vec<&str> = strategies.iter().map(String::as_str).collect();
        let is_external = |name: &&&str| external.iter().any(|strategy| strategy.name == **name);
        let unknown = names.iter().find(|name| Registered::find(name).is_none() && !is_external(name));
        if let Some(name) = unknown {
            let is_python = name.starts_with("python:");
            let by_python = "a built-in strategy; use skysink.sweep() of the Python package for Python strategies";
            let expected = if is_python { by_python.to_owned() } else { expected(name) };
            return Err(refuse(&format!("strategies = {names:?}: {name:?}"), &expected).into());
        }
        distinct(&names).map_err(|expected| refuse(&format!("strategies = {names:?}"), expected))?;
        let ascending = distinct(&seeds).map_err(|expected| refuse(&format!("seeds = {seeds:?}"), expected))?;
        if let Some(seed) = ascending.last().filter(|&&seed| seed > MAX_SEED) {
            return Err(refuse(&format!("seeds: {seed}"), &format!("at most {MAX_SEED}")).into());
        }
        let axes = axes.into_iter().map(|(key, values)| match values {
            _ if key == "seed" => Err(refuse("axes.seed", "the seeds under `seeds`")),
            _ if key == "planner.strategy" => {
                Err(refuse("axes.\"planner.strategy\"", "the strategies under `strategies`"))
            }
            toml::Value::Array(values) if !values.is_empty() => {
                let texts: Vec<String> = values.iter().map(ToString::to_string).collect();
                let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
                match distinct(&texts) {
                    Ok(_) => Ok((key, values)),
                    Err(expected) => Err(refuse(&format!("axes.\"{key}\" = [{}]", texts.join(", ")), expected)),
                }
            }
            toml::Value::Table(_) => {
                let (key, value) = innermost(key, &values);
                Err(refuse(&format!("axes.{key} = {value}"), &format!("the key in quotes: \"{key}\" = {value}")))
            }
            _ => Err(refuse(&format!("axes.\"{key}\" = {values}"), "a list of one or more values")),
        });
        let axes: Vec<(String, Vec<toml::Value>)> = axes.collect::<Result<_, InputError>>()?;
        let of_point = ascending.len().saturating_mul(strategies.len());
        let missions = axes.iter().fold(of_point, |missions, (_, values)| missions.saturating_mul(values.len()));
        if missions > MAX_MISSIONS {
            return Err(refuse(&format!("axes make {missions} missions"), &format!("at most {MAX_MISSIONS}")).into());
        }
        let points = grid(&axes);
        let definition = Definition {
            identity: String::new(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            keys: axes.into_iter().map(|(key, _)| key).collect(),
            points,
            strategies,
            seeds: ascending.into_iter().collect(),
        };
        let mut sweep = Self { definition, base, external, latest: Mutex::default() };
        sweep.definition.identity = sweep.identity(path)?;
        Ok(sweep)
    }

    /// The scenario of a mission.
    ///
    /// # Errors
    /// If the point or the seed is refused; [`Sweep::new`] has checked every point.
    ///
    /// # Panics
    /// If the mission does not belong to this sweep.
    pub fn scenario(&self, mission: MissionKey) -> Result<Scenario, LabError> {
        let mut latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        let scenario = match latest.take() {
            Some((MissionKey { point, strategy, .. }, scenario))
                if (point, strategy) == (mission.point, mission.strategy) =>
            {
                Scenario { seed: mission.seed, ..scenario }
            }
            _ => self.read_scenario(mission)?,
        };
        *latest = Some((mission, scenario.clone()));
        Ok(scenario)
    }

    fn read_scenario(&self, mission: MissionKey) -> Result<Scenario, LabError> {
        let text = toml::to_string(&self.base.table).expect("a table that was read can be written");
        let overrides = Overrides {
            seed: Some(mission.seed),
            // For an external strategy, the scenario's own is not used.
            strategy: self.strategy(mission).map(|strategy| strategy.name),
            slots: None,
            keys: zip(&self.definition.keys, &self.definition.points[mission.point]).map(setting).collect(),
        };
        Ok(Scenario::parse(&text, &self.base.path, overrides).and_then(settings::resolve)?)
    }

    /// The strategy of a mission; `None` if it is external.
    ///
    /// # Panics
    /// If the mission does not belong to this sweep.
    #[must_use]
    pub fn strategy(&self, mission: MissionKey) -> Option<&'static Registered> {
        Registered::find(&self.definition.strategies[mission.strategy])
    }

    /// Hash of everything that the results depend on. Checks every point of the grid.
    fn identity(&self, path: &Path) -> Result<String, LabError> {
        let mut hash = Xxh3::new();
        let description = serde_json::to_string(&self.definition).expect("plain values");
        hash.update(description.as_bytes());
        self.external.iter().for_each(|strategy| hash.update(strategy.version.as_bytes()));
        for point in 0..self.definition.points.len() {
            let mission = MissionKey { point, strategy: 0, seed: self.definition.seeds[0] };
            let refuse = |error| InputError::new("sweep", path, format!("at {}: {error}", self.name(point)));
            let scenario = self.scenario(mission).map_err(refuse)?;
            hash.update(scenario.to_toml().as_bytes());
            if scenario.sensors.file.is_some() {
                hash.update(SensorList::of(&scenario)?.to_csv().as_bytes());
            }
        }
        Ok(format!("{:016x}", hash.digest()))
    }

    /// Describes a point, for messages.
    fn name(&self, point: usize) -> String {
        let values = self.definition.keys.iter().zip(&self.definition.points[point]);
        values.map(|(key, value)| format!("{key} = {value}")).collect::<Vec<_>>().join(", ")
    }
}

/// The setting of one key at a point of the grid.
fn setting((key, value): (&String, &toml::Value)) -> Setting {
    Setting { key: key.clone(), value: value.clone(), origin: SettingOrigin::Axis }
}

/// The values, ascending. The error is the expectation, if there is no value or a duplicate.
fn distinct<T: Ord + Copy>(values: &[T]) -> Result<BTreeSet<T>, &'static str> {
    let distinct: BTreeSet<T> = values.iter().copied().collect();
    match distinct.len() {
        0 => Err("one or more"),
        count if count < values.len() => Err("each once"),
        _ => Ok(distinct),
    }
}

/// The first value in nested tables, with its dotted key.
fn innermost(key: String, value: &toml::Value) -> (String, &toml::Value) {
    match value.as_table().and_then(|table| table.iter().next()) {
        Some((inner, value)) => innermost(format!("{key}.{inner}"), value),
        None => (key, value),
    }
}

/// All combinations of the values of the axes; the last axis varies fastest. Without axes, one point.
fn grid(axes: &[(String, Vec<toml::Value>)]) -> Vec<Vec<toml::Value>> {
    let mut points = vec![Vec::new()];
    for (_, values) in axes {
        let extend = |point: &Vec<toml::Value>| -> Vec<Vec<toml::Value>> {
            values.iter().map(|value| [point.as_slice(), std::slice::from_ref(value)].concat()).collect()
        };
        points = points.iter().flat_map(extend).collect();
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::LETTER;

    fn sweep(strategies: &[&str], version: &str) -> Result<Sweep, LabError> {
        let base = SweepBase { path: "letter.toml".into(), table: LETTER.parse().unwrap() };
        let names = strategies.iter().map(|&name| name.to_owned()).collect();
        let external = vec![ExternalStrategy { name: "python:mine.py:Mine".to_owned(), version: version.to_owned() }];
        Sweep::new(Path::new("x"), base, toml::Table::new(), names, vec![1, 2], external)
    }

    #[test]
    fn an_external_strategy_gets_the_same_field() {
        let sweep = sweep(&["uts", "python:mine.py:Mine"], "1").unwrap();
        let key = |strategy| MissionKey { point: 0, strategy, seed: 2 };
        assert_eq!(sweep.strategy(key(0)).unwrap().name, "uts");
        assert_eq!(sweep.strategy(key(1)), None);
        let fields = [0, 1].map(|strategy| SensorList::of(&sweep.scenario(key(strategy)).unwrap()).unwrap());
        assert_eq!(fields[0], fields[1]);
    }

    #[test]
    fn another_version_of_an_external_strategy_makes_another_sweep() {
        let identity = |version: &str| sweep(&["python:mine.py:Mine"], version).unwrap().definition.identity;
        assert_eq!(identity("1"), identity("1"));
        assert_ne!(identity("1"), identity("2"));
    }

    #[test]
    fn an_unknown_strategy_is_refused() {
        for (name, expected) in [("utz", "did you mean `uts`?"), ("python:other.py:X", "skysink.sweep()")] {
            let refusal = sweep(&["uts", name], "1").unwrap_err().to_string();
            assert!(refusal.contains(name) && refusal.contains(expected), "{refusal}");
        }
    }
}
