//! A sweep with the scenarios of its missions.

use std::iter::zip;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario, Setting, SettingOrigin};
use skysink_common::sensors::SensorList;
use skysink_planner::settings;
use skysink_planner::strategies::STRATEGIES;
use skysink_planner::strategy::Registered;
use toml::Table;
use xxhash_rust::xxh3::Xxh3;

use super::definition::{Definition, MissionKey};
use super::saved;
use super::settings::{ExternalStrategy, SweepBase, SweepChanges, SweepSettings};
use crate::error::LabError;

/// A sweep with its scenarios.
#[derive(Debug)]
pub struct Sweep {
    /// The definition.
    pub definition: Definition,
    pub(crate) base: SweepBase,
    pub(crate) external: Vec<ExternalStrategy>,
    /// Cache of the latest scenario, because the next mission usually differs only in its seed.
    latest: Mutex<Option<(MissionKey, Scenario)>>,
}

impl Sweep {
    /// Reads a sweep file, or the sweep in a folder, and checks every point of its grid. It may name strategies of the
    /// registry and `external` ones.
    ///
    /// # Errors
    /// If the file, its scenario, a strategy or a point is refused, or what the folder holds of the sweep was modified.
    pub fn read(path: &Path, external: Vec<ExternalStrategy>, changes: SweepChanges) -> Result<Self, LabError> {
        if !path.is_dir() {
            return Self::new(path, SweepSettings::read(path, external)?.with(path, changes)?);
        }
        let (settings, definition) = saved::read(path, external)?;
        if definition.models != changes.models {
            let names: Vec<&str> = definition.models.iter().map(|(name, _)| name.as_str()).collect();
            let message = match &names[..] {
                [] => "it was flown without arrivals or a channel in Python: expected none".to_owned(),
                names => {
                    format!("it was flown with {} in Python: expected the same, in skysink.sweep()", names.join(", "))
                }
            };
            return Err(InputError::new("sweep", path, message).into());
        }
        let sweep = Self::new(path, settings)?;
        if sweep.definition != definition {
            let message = "its scenario.toml, sensors.csv, sweep.json or the source of a strategy was modified: \
                           restore it, or fly another sweep: skysink sweep FILE --out DIR";
            return Err(InputError::new("sweep", path, message).into());
        }
        if changes.strategies.is_none() && changes.seeds.is_none() {
            return Ok(sweep);
        }
        let Definition { strategies, seeds, .. } = definition;
        let Self { base, external, .. } = sweep;
        let models = changes.models.clone();
        let settings = SweepSettings { base, axes: sweep.definition.axes(), strategies, seeds, external, models };
        Self::new(path, settings.with(path, changes)?)
    }

    /// Checks a sweep and every point of its grid. `path` names the sweep in errors.
    ///
    /// # Errors
    /// If the axes, strategies or seeds, or a point of the grid is refused.
    pub fn new(path: &Path, settings: SweepSettings) -> Result<Self, LabError> {
        let definition = settings.define(path)?;
        let SweepSettings { base, external, .. } = settings;
        let mut sweep = Self { definition, base, external, latest: Mutex::default() };
        sweep.definition.grid = sweep.grid(path)?;
        sweep.definition.identity = sweep.definition.hash();
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
            // For an external strategy, the scenario's own is not used.
            _ => {
                let strategy = self.strategy(mission).map(|strategy| strategy.name);
                self.read_scenario(&self.base.table, mission.point, mission.seed, strategy)?
            }
        };
        *latest = Some((mission, scenario.clone()));
        Ok(scenario)
    }

    /// The scenario of a point over the base scenario `base`.
    fn read_scenario(
        &self,
        base: &Table,
        point: usize,
        seed: u64,
        strategy: Option<&'static str>,
    ) -> Result<Scenario, InputError> {
        let text = toml::to_string(base).expect("a table that was read can be written");
        let keys = zip(&self.definition.keys, &self.definition.points[point]).map(setting).collect();
        let overrides = Overrides { seed: Some(seed), strategy, keys, ..self.base.held.clone() };
        Scenario::parse(&text, &self.base.path, overrides).and_then(settings::resolve)
    }

    /// The scenario of a point, with a seed and a strategy that are the same for all sweeps.
    pub(crate) fn scenario_of_grid(&self, base: &Table, point: usize) -> Result<Scenario, InputError> {
        self.read_scenario(base, point, 0, Some(STRATEGIES[0].name))
    }

    /// The strategy of a mission; `None` if it is external.
    ///
    /// # Panics
    /// If the mission does not belong to this sweep.
    pub fn strategy(&self, mission: MissionKey) -> Option<&'static Registered> {
        Registered::find(&self.definition.strategies[mission.strategy])
    }

    /// The hash [`Definition::grid`]. Checks every point.
    fn grid(&self, path: &Path) -> Result<String, LabError> {
        let mut hash = Xxh3::new();
        let Definition { version, keys, points, .. } = &self.definition;
        hash.update(serde_json::to_string(&(version, keys, points)).expect("plain values").as_bytes());
        for point in 0..points.len() {
            let refuse = |error| InputError::new("sweep", path, format!("at {}: {error}", self.name(point)));
            let scenario = self.scenario_of_grid(&self.base.table, point).map_err(refuse)?;
            let has_channel = scenario.link.table.is_some() || scenario.link.map.is_some();
            if scenario.sensors.file.is_some() || scenario.sensors.has_trace() || has_channel {
                let list = SensorList::of(&scenario)?;
                hash.update(scenario.to_toml_with_list("").as_bytes());
                hash.update(list.to_csv().as_bytes());
                list.files_beside(&scenario).for_each(|(_, text)| hash.update(text.as_bytes()));
            } else {
                hash.update(scenario.to_toml().as_bytes());
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

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::LETTER;

    fn sweep(strategies: &[&str], version: &str) -> Result<Sweep, LabError> {
        let base = SweepBase { path: "letter.toml".into(), table: LETTER.parse().unwrap(), held: Overrides::default() };
        let names = strategies.iter().map(|&name| name.to_owned()).collect();
        let external = vec![ExternalStrategy {
            name: "python:mine.py:Mine".to_owned(),
            version: version.to_owned(),
            sources: Vec::new(),
        }];
        let axes = toml::Table::new();
        let settings = SweepSettings { base, axes, strategies: names, seeds: vec![1, 2], external, models: Vec::new() };
        Sweep::new(Path::new("x"), settings)
    }

    #[test]
    fn every_sweep_of_the_repository_is_accepted() {
        let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/sweeps"));
        let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let sweeps: Vec<Sweep> =
            files.map(|file| Sweep::read(&file, Vec::new(), SweepChanges::default()).unwrap()).collect();
        assert!(sweeps.len() > 10, "{}", sweeps.len());
        for sweep in sweeps {
            let files = sweep.files().unwrap();
            let (_, scenario) = files.iter().find(|(name, _)| name == Path::new("scenario.toml")).unwrap();
            let scenario: Table = str::from_utf8(scenario).unwrap().parse().unwrap();
            assert!(scenario["planner"].get("horizon").is_some(), "the keys of {} are not all there", sweep.name(0));
        }
    }

    #[test]
    fn external_strategies_get_the_same_field() {
        let sweep = sweep(&["uts", "python:mine.py:Mine"], "1").unwrap();
        let key = |strategy| MissionKey { point: 0, strategy, seed: 2 };
        assert_eq!(sweep.strategy(key(0)).unwrap().name, "uts");
        assert_eq!(sweep.strategy(key(1)), None);
        let fields = [0, 1].map(|strategy| SensorList::of(&sweep.scenario(key(strategy)).unwrap()).unwrap());
        assert_eq!(fields[0], fields[1]);
    }

    #[test]
    fn a_changed_external_strategy_changes_the_sweep() {
        let identity = |version: &str| sweep(&["python:mine.py:Mine"], version).unwrap().definition.identity;
        assert_eq!(identity("1"), identity("1"));
        assert_ne!(identity("1"), identity("2"));
    }

    #[test]
    fn strategies_are_appended_and_keep_their_sources() {
        let definition = |strategies: &[&str], version: &str| sweep(strategies, version).unwrap().definition;
        let mine = "python:mine.py:Mine";
        let small = definition(&["uts", mine], "1");
        assert_eq!(small.lacking_in(&definition(&["uts", mine, "gfs"], "1")), None);
        let lacking = |strategies: &[&str], version: &str| small.lacking_in(&definition(strategies, version)).unwrap();
        assert!(lacking(&[mine, "uts"], "1").contains("expected them first"));
        assert_eq!(lacking(&["uts", mine], "2"), "another source of python:mine.py:Mine");
    }

    #[test]
    fn an_unknown_strategy_is_refused() {
        for (name, expected) in [("utz", "did you mean `uts`?"), ("python:other.py:X", "skysink.sweep()")] {
            let refusal = sweep(&["uts", name], "1").unwrap_err().to_string();
            assert!(refusal.contains(name) && refusal.contains(expected), "{refusal}");
        }
    }
}
