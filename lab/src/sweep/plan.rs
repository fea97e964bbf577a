//! A sweep with the scenarios of its missions.

use std::iter::zip;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario, Setting, SettingOrigin};
use skysink_common::sensors::SensorList;
use skysink_planner::settings;
use skysink_planner::strategy::Registered;
use xxhash_rust::xxh3::Xxh3;

use super::definition::{Definition, MissionKey};
use super::settings::{ExternalStrategy, SweepBase, SweepSettings};
use crate::error::LabError;

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

impl Sweep {
    /// Reads a sweep file and checks every point of its grid. The file may name strategies of the registry and
    /// `external` ones.
    ///
    /// # Errors
    /// If the file, its scenario, a strategy or a point is refused.
    pub fn read(path: &Path, external: Vec<ExternalStrategy>) -> Result<Self, LabError> {
        Self::new(path, SweepSettings::read(path, external)?)
    }

    /// Checks a sweep and every point of its grid. `path` names the sweep in errors.
    ///
    /// # Errors
    /// If the axes, strategies or seeds, or a point of the grid is refused.
    pub fn new(path: &Path, settings: SweepSettings) -> Result<Self, LabError> {
        let definition = settings.define(path)?;
        let SweepSettings { base, external, .. } = settings;
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

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::LETTER;

    fn sweep(strategies: &[&str], version: &str) -> Result<Sweep, LabError> {
        let base = SweepBase { path: "letter.toml".into(), table: LETTER.parse().unwrap() };
        let names = strategies.iter().map(|&name| name.to_owned()).collect();
        let external = vec![ExternalStrategy { name: "python:mine.py:Mine".to_owned(), version: version.to_owned() }];
        let settings = SweepSettings { base, axes: toml::Table::new(), strategies: names, seeds: vec![1, 2], external };
        Sweep::new(Path::new("x"), settings)
    }

    #[test]
    fn every_sweep_of_the_repository_is_accepted() {
        let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/sweeps"));
        let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let sweeps: Vec<Sweep> = files.map(|file| Sweep::read(&file, Vec::new()).unwrap()).collect();
        assert!(sweeps.len() > 10, "{}", sweeps.len());
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
