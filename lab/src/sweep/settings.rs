//! The settings of a sweep, as in a sweep file, and their checks.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use skysink_common::build::VERSION;
use skysink_common::error::{InputError, read_text};
use skysink_common::scenario::{MAX_SEED, Overrides, Scenario};
use skysink_mission::origin::SourceFile;
use skysink_planner::settings;
use skysink_planner::strategies::{PYTHON, expected};
use skysink_planner::strategy::Registered;

use super::definition::Definition;
use crate::error::LabError;

/// Maximum number of missions of a sweep.
const MAX_MISSIONS: usize = 100_000_000;

/// What a sweep is made of, unchecked.
#[derive(Debug)]
pub struct SweepSettings {
    /// The base scenario.
    pub base: SweepBase,
    /// The swept keys with their values.
    pub axes: toml::Table,
    /// Names of the strategies, in the order of the results.
    pub strategies: Vec<String>,
    /// The seeds.
    pub seeds: Vec<u64>,
    /// The strategies outside the registry that `strategies` may name.
    pub external: Vec<ExternalStrategy>,
    /// The arrivals and the channel that the caller brings: what they are, and a hash of their source.
    pub models: Vec<(String, String)>,
}

/// A strategy outside the registry, whose missions the caller simulates.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExternalStrategy {
    /// Its name in the sweep file and in the results.
    pub name: String,
    /// Identifies its version, for example by its source.
    pub version: String,
    /// Its source files, as in the folder of a run.
    pub sources: Vec<SourceFile>,
}

/// Changes of a sweep from the command line.
#[derive(Debug, Default)]
pub struct SweepChanges {
    /// Replaces the strategies.
    pub strategies: Option<Vec<String>>,
    /// Replaces the seeds.
    pub seeds: Option<Seeds>,
    /// The models of [`SweepSettings`].
    pub models: Vec<(String, String)>,
}

/// The base scenario of a sweep.
#[derive(Debug)]
pub struct SweepBase {
    /// Its path; files that it names are relative to it.
    pub path: PathBuf,
    /// Its keys.
    pub table: toml::Table,
    /// The table of rates or the map that it holds instead of files, without axes over these.
    pub held: Overrides,
}

impl SweepBase {
    /// Reads and checks a scenario file.
    ///
    /// # Errors
    /// If it is refused.
    pub fn read(path: PathBuf) -> Result<Self, InputError> {
        Scenario::read(&path, Overrides::default()).and_then(settings::resolve)?;
        let text = read_text("scenario", &path)?;
        let table = text.parse().map_err(|error| InputError::toml("scenario", &path, &text, &error))?;
        Ok(Self { path, table, held: Overrides::default() })
    }
}

/// A sweep file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SweepFile {
    pub(crate) scenario: PathBuf,
    pub(crate) strategies: Vec<String>,
    pub(crate) seeds: Seeds,
    #[serde(default)]
    pub(crate) axes: toml::Table,
}

/// `20` for 1 to 20, or a list.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number of seeds or a list of seeds")]
pub enum Seeds {
    /// 1 to this number.
    Count(u64),
    /// These.
    List(Vec<u64>),
}

impl Seeds {
    /// All of them. `path` names the sweep in errors.
    fn list(self, path: &Path) -> Result<Vec<u64>, InputError> {
        match self {
            Self::Count(count) if count > MAX_MISSIONS as u64 => {
                Err(refusal(path, &format!("seeds = {count}"), &format!("at most {MAX_MISSIONS}")))
            }
            Self::Count(0) => Err(refusal(path, "seeds = 0", "1 or more, or a list of seeds")),
            Self::Count(count) => Ok((1..=count).collect()),
            Self::List(list) => Ok(list),
        }
    }
}

impl SweepSettings {
    /// Reads a sweep file. It may name strategies of the registry and `external` ones.
    ///
    /// # Errors
    /// If the file, its scenario or the number of seeds is refused.
    pub fn read(path: &Path, external: Vec<ExternalStrategy>) -> Result<Self, LabError> {
        let refuse = |what: &str| Err(InputError::new("sweep", path, what).into());
        let text = read_text("sweep", path)?;
        let is_scenario = text.parse::<toml::Table>().is_ok_and(|table| table.contains_key("name"));
        if is_scenario {
            return refuse("it is a scenario: expected a sweep (use skysink simulate for this file)");
        }
        let file: SweepFile = toml::from_str(&text).map_err(|error| InputError::toml("sweep", path, &text, &error))?;
        let base_path = path.parent().unwrap_or(Path::new("")).join(&file.scenario);
        let base = SweepBase::read(base_path)?;
        let seeds = file.seeds.list(path)?;
        Ok(Self { base, axes: file.axes, strategies: file.strategies, seeds, external, models: Vec::new() })
    }

    /// The sweep with these changes. `path` names it in errors.
    ///
    /// # Errors
    /// If the number of seeds is refused.
    pub(crate) fn with(self, path: &Path, changes: SweepChanges) -> Result<Self, InputError> {
        let seeds = changes.seeds.map_or(Ok(self.seeds), |seeds| seeds.list(path))?;
        let strategies = changes.strategies.unwrap_or(self.strategies);
        Ok(Self { strategies, seeds, models: changes.models, ..self })
    }

    /// The definition of the sweep, without its identity. `path` names the sweep in errors.
    ///
    /// # Errors
    /// If the axes, strategies or seeds are refused.
    pub fn define(&self, path: &Path) -> Result<Definition, InputError> {
        let refuse = |key: &str, expected: &str| refusal(path, key, expected);
        let names: Vec<&str> = self.strategies.iter().map(String::as_str).collect();
        let is_external = |name: &&&str| self.external.iter().any(|strategy| strategy.name == **name);
        let unknown = names.iter().find(|name| Registered::find(name).is_none() && !is_external(name));
        if let Some(name) = unknown {
            let is_python = name.starts_with(PYTHON);
            let by_python = "a built-in strategy; use skysink.sweep() of the Python package for Python strategies";
            let expected = if is_python { by_python.to_owned() } else { expected(name) };
            return Err(refuse(&format!("strategies = {names:?}: {name:?}"), &expected));
        }
        distinct(&names).map_err(|expected| refuse(&format!("strategies = {names:?}"), expected))?;
        let ascending =
            distinct(&self.seeds).map_err(|expected| refuse(&format!("seeds = {:?}", self.seeds), expected))?;
        if let Some(seed) = ascending.last().filter(|&&seed| seed > MAX_SEED) {
            return Err(refuse(&format!("seeds: {seed}"), &format!("at most {MAX_SEED}")));
        }
        let axes: Vec<(String, Vec<toml::Value>)> =
            self.axes.iter().map(|(key, values)| axis(path, key, values)).collect::<Result<_, _>>()?;
        let of_point = ascending.len().saturating_mul(self.strategies.len());
        let missions = axes.iter().fold(of_point, |missions, (_, values)| missions.saturating_mul(values.len()));
        if missions > MAX_MISSIONS {
            return Err(refuse(&format!("axes make {missions} missions"), &format!("at most {MAX_MISSIONS}")));
        }
        let is_flown = |strategy: &&ExternalStrategy| self.strategies.contains(&strategy.name);
        let flown = self.external.iter().filter(is_flown);
        let sources = flown.map(|strategy| (strategy.name.clone(), strategy.version.clone()));
        Ok(Definition {
            identity: String::new(),
            grid: String::new(),
            version: VERSION.to_owned(),
            points: grid(&axes),
            keys: axes.into_iter().map(|(key, _)| key).collect(),
            strategies: self.strategies.clone(),
            sources: sources.collect(),
            models: self.models.clone(),
            seeds: ascending.into_iter().collect(),
        })
    }
}

/// Checks the values of the key `key`.
fn axis(path: &Path, key: &str, values: &toml::Value) -> Result<(String, Vec<toml::Value>), InputError> {
    match values {
        _ if key == "seed" => Err(refusal(path, "axes.seed", "the seeds under `seeds`")),
        _ if key == "planner.strategy" => {
            Err(refusal(path, "axes.\"planner.strategy\"", "the strategies under `strategies`"))
        }
        toml::Value::Array(values) if !values.is_empty() => {
            let texts: Vec<String> = values.iter().map(ToString::to_string).collect();
            let real = |value: &toml::Value| value.as_integer().map(|whole| toml::Value::Float(whole as f64));
            let reals =
                values.iter().zip(&texts).map(|(value, text)| real(value).map_or(text.clone(), |it| it.to_string()));
            let reals: Vec<String> = reals.collect();
            match distinct(&reals.iter().map(String::as_str).collect::<Vec<_>>()) {
                Ok(_) => Ok((key.to_owned(), values.clone())),
                Err(expected) => Err(refusal(path, &format!("axes.\"{key}\" = [{}]", texts.join(", ")), expected)),
            }
        }
        toml::Value::Table(_) => {
            let (key, value) = innermost(key.to_owned(), values);
            let expected = format!("the key in quotes: \"{key}\" = {value}");
            Err(refusal(path, &format!("axes.{key} = {value}"), &expected))
        }
        _ => Err(refusal(path, &format!("axes.\"{key}\" = {values}"), "a list of one or more values")),
    }
}

/// The error for a key of the sweep file.
fn refusal(path: &Path, key: &str, expected: &str) -> InputError {
    InputError::new("sweep", path, format!("{key}: expected {expected}"))
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
