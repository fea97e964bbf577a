//! Values of flights: what is compared, the best known ones, and those of the strategies of Skysink.

use std::borrow::Cow;
use std::fs::File;
use std::io;

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_common::file_locks::with_remedy;
use skysink_common::scenario::Scenario;
use skysink_mission::MissionError;
use skysink_mission::error::FileContext as _;
use skysink_mission::metrics::{Metric, MetricValues};
use skysink_planner::settings::Settings;
use xxhash_rust::xxh3::xxh3_64;

use crate::instance::{INDEX, Instance, LIBRARY, Library};

/// The values of strategies.
const STANDINGS: &str = "standings.csv";

/// By what flights over an instance are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    /// The loss rate η.
    LossRate,
    /// The weighted loss rate η_w, where weights differ (decision D25).
    WeightedLossRate,
    /// The cost by `planner.objective` (decision D36), where that is not the loss.
    Objective,
    /// The score, where nothing is sampled: the higher the better.
    Score,
}

impl Measure {
    /// The measure of a mission over this scenario with these metrics, and its value.
    pub(crate) fn of(scenario: &Scenario, values: &MetricValues) -> (Self, f64) {
        let is_loss = Settings::of(scenario).is_ok_and(|settings| settings.objective.is_loss());
        let choices = [
            (Self::Score, Metric::Score, true),
            (Self::Objective, Metric::Objective, !is_loss),
            (Self::WeightedLossRate, Metric::WeightedLossRate, true),
            (Self::LossRate, Metric::LossRate, true),
        ];
        let value = |metric: Metric| values[metric as usize];
        let has_value = |(_, metric, applies): &&(Self, Metric, bool)| *applies && !value(*metric).is_nan();
        let &(measure, metric, _) = choices.iter().find(has_value).expect("every mission has a loss rate");
        (measure, value(metric))
    }

    /// Whether one value is better than another.
    #[must_use]
    pub fn is_better(self, one: f64, other: f64) -> bool {
        if self == Self::Score { one > other } else { one < other }
    }

    /// Its name in tables.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::LossRate => "η",
            Self::WeightedLossRate => "η_w",
            Self::Objective => "cost",
            Self::Score => "score",
        }
    }
}

/// The fraction of a value that separates it from a reference: 1 − reference/value of losses and costs, 1 −
/// value/reference of scores. It is 0 where they are equal, at most 1, and negative where the value is better.
#[must_use]
pub fn gap(measure: Measure, value: f64, reference: f64) -> f64 {
    let (less, more) = if measure == Measure::Score { (value, reference) } else { (reference, value) };
    if less == more { 0.0 } else { 1.0 - less / more }
}

/// The best known flight of an instance, as in `best/NAME.toml`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BestFlight {
    /// What is compared.
    pub measure: Measure,
    /// Its value; the mean over the seeds of a policy instance.
    pub value: f64,
    /// The best known bound on the value of every flight.
    pub bound: Option<f64>,
    /// Who or what found it.
    pub by: String,
    /// What it cost, such as a computing time.
    pub cost: String,
    /// The version of Skysink that verified it.
    pub version: String,
    /// Hash (XXH3) of the file of its plans.
    pub plans: String,
}

/// An instance, its size, and its best known flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ListedInstance {
    /// The instance.
    #[serde(flatten)]
    pub instance: Instance,
    /// Number of sensor nodes, N.
    pub sensors: usize,
    /// Number of UAVs, U.
    pub uavs: usize,
    /// Number of slots, T.
    pub slots: u64,
    /// Its best known flight; `None` without one.
    pub best: Option<BestFlight>,
    /// The [`gap`] of the best known value to the bound.
    pub gap: Option<f64>,
}

/// The value of a strategy over an instance, a row of `standings.csv`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReferenceValue {
    /// The instance.
    pub instance: String,
    /// The strategy, with its budget.
    pub strategy: String,
    /// The version of Skysink.
    pub version: String,
    /// Its value; the mean over the seeds of a policy instance.
    pub value: f64,
}

impl ReferenceValue {
    /// The values over an instance by the last version in the file.
    pub fn latest<'a>(standings: &'a [Self], instance: &'a str) -> impl Iterator<Item = &'a Self> {
        let last = standings.last().map(|one| one.version.as_str());
        standings.iter().filter(move |one| one.instance == instance && Some(one.version.as_str()) == last)
    }
}

impl Library {
    /// The best known flight of an instance; `None` without one.
    ///
    /// # Errors
    /// If its files are malformed, or do not belong together.
    pub fn best(&self, instance: &Instance) -> Result<Option<BestFlight>, MissionError> {
        let _index = self.locked(File::lock_shared)?; // no submission is between its two files
        let Some(best) = self.recorded_best(instance)? else { return Ok(None) };
        self.plans_of(instance, &best)?;
        Ok(Some(best))
    }

    /// The index of a library in a folder, locked by `lock` until it is dropped.
    pub(crate) fn locked(&self, lock: fn(&File) -> io::Result<()>) -> Result<Option<File>, MissionError> {
        let Some(folder) = self.folder() else { return Ok(None) };
        let path = folder.join(INDEX);
        Ok(Some(File::open(&path).and_then(|index| lock(&index).map(|()| index).map_err(with_remedy)).at(&path)?))
    }

    /// Whether the plan file of the best known flight is there, and no other.
    pub(crate) fn has_plans(&self, instance: &Instance, best: &BestFlight) -> Result<bool, MissionError> {
        Ok(self.read(&best_file(instance, "csv.gz"))?.is_some_and(|bytes| hash(&bytes) == best.plans))
    }

    /// What is recorded of the best known flight of an instance, whether its plans are there or not.
    pub(crate) fn recorded_best(&self, instance: &Instance) -> Result<Option<BestFlight>, MissionError> {
        let name = best_file(instance, "toml");
        let Some(bytes) = self.read(&name)? else { return Ok(None) };
        let refuse = |message: &str| InputError::new(LIBRARY, &self.path(&name), message);
        let text = std::str::from_utf8(&bytes).map_err(|_| refuse("expected UTF-8 text"))?;
        let best: BestFlight =
            toml::from_str(text).map_err(|error| InputError::toml(LIBRARY, &self.path(&name), text, &error))?;
        if !best.value.is_finite() || best.bound.is_some_and(|bound| !bound.is_finite()) {
            return Err(refuse("value or bound: expected finite numbers").into());
        }
        Ok(Some(best))
    }

    /// The plan file of the best known flight, compressed.
    ///
    /// # Errors
    /// If it is missing, or that of another flight.
    pub(crate) fn plans_of(&self, instance: &Instance, best: &BestFlight) -> Result<Cow<'static, [u8]>, MissionError> {
        let name = best_file(instance, "csv.gz");
        let refuse = |what: String| InputError::new(LIBRARY, &self.path(&name), what);
        let bytes = self.read(&name)?.ok_or_else(|| refuse("it is missing".to_owned()))?;
        let found = hash(&bytes);
        if found != best.plans {
            return Err(refuse(format!("hash {found}: expected {}, of best/{}.toml", best.plans, instance.name)).into());
        }
        Ok(bytes)
    }

    /// The instance with its size and its best known flight.
    ///
    /// # Errors
    /// If one of its files is malformed.
    pub fn listed(&self, instance: Instance) -> Result<ListedInstance, MissionError> {
        let best = self.best(&instance)?;
        let gap = best.as_ref().and_then(|best| Some(gap(best.measure, best.value, best.bound?)));
        let open = self.open(instance)?;
        let sensors = open.list.sensors().len();
        let uavs = open.scenario.uav.uavs();
        let slots = open.scenario.slots;
        Ok(ListedInstance { sensors, uavs, slots, best, gap, instance: open.instance })
    }

    /// The values of the strategies of Skysink, the last version last; none without a file of them.
    ///
    /// # Errors
    /// If the file is malformed.
    pub fn standings(&self) -> Result<Vec<ReferenceValue>, MissionError> {
        let Some(bytes) = self.read(STANDINGS)? else { return Ok(Vec::new()) };
        let refuse = |what: String| InputError::new(LIBRARY, &self.path(STANDINGS), what);
        let rows = csv::Reader::from_reader(&bytes[..]).into_deserialize().collect::<Result<Vec<ReferenceValue>, _>>();
        let rows =
            rows.map_err(|error| refuse(format!("{error}: expected instance, strategy, version, and a value")))?;
        match rows.iter().find(|row| !row.value.is_finite()) {
            Some(row) => {
                Err(refuse(format!("value {} of {}: expected a finite number", row.value, row.instance)).into())
            }
            None => Ok(rows),
        }
    }
}

/// The name of a file of the best known flight.
pub(crate) fn best_file(instance: &Instance, extension: &str) -> String {
    format!("best/{}.{extension}", instance.name)
}

/// XXH3 of bytes, as 16 hexadecimal digits.
pub(crate) fn hash(bytes: &[u8]) -> String {
    format!("{:016x}", xxh3_64(bytes))
}
