//! The strategies: schedule and waypoint of a slot.
//!
//! A strategy is a file of this folder and a line of [`STRATEGIES`]. Messages, and transit without a decision, are left
//! to [`crate::planner`].

pub mod algorithm_1;
pub mod drift_plus_penalty;
pub mod edf;
pub mod exact;
pub mod gfs;
pub mod horizon;
pub mod max_age_first;
pub mod max_weight;
pub mod mes;
pub(crate) mod nearby;
pub mod offline;
mod planned_flight;
pub(crate) mod queue_weight;
pub mod rfs;
mod rivals;
mod rollout;
pub mod round_robin;
pub(crate) mod sampling;
pub mod serving;
pub mod tour;
pub mod transit;
pub(crate) mod turns;
pub mod uts;
pub mod uts_wide;
pub mod whittle;

use std::fmt::Display;

use arrayvec::ArrayVec;
use nalgebra::Point3;
use serde::de::{self, DeserializeOwned};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use skysink_common::checkpoint::Checkpoint;
use skysink_common::error::{InputError, did_you_mean};
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, MAX_SERVED, SensorNode, SolverOutcome};
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;
use toml::Table;

use crate::keys::Settings;
use crate::sensor_table::SensorTable;
use skysink_common::estimate::Estimate;

use algorithm_1::Winner;

/// All strategies, in the order in which they are listed.
pub static STRATEGIES: [&Registered; 15] = [
    &rfs::STRATEGY,
    &gfs::STRATEGY,
    &uts::STRATEGY,
    &uts_wide::STRATEGY,
    &exact::STRATEGY,
    &tour::STRATEGY,
    &round_robin::STRATEGY,
    &max_age_first::STRATEGY,
    &edf::STRATEGY,
    &mes::STRATEGY,
    &max_weight::STRATEGY,
    &drift_plus_penalty::STRATEGY,
    &whittle::STRATEGY,
    &horizon::STRATEGY,
    &offline::STRATEGY,
];

/// The names of all strategies.
#[must_use]
pub fn names() -> [&'static str; STRATEGIES.len()] {
    STRATEGIES.map(|strategy| strategy.name)
}

/// The names of the stateless strategies, whose plans do not depend on the plans before.
#[must_use]
pub fn stateless() -> Vec<&'static str> {
    STRATEGIES.iter().filter(|strategy| strategy.is_stateless).map(|strategy| strategy.name).collect()
}

/// A planning strategy: decides one slot from the state after the one before.
///
/// It reads no clock unless the mission is paced, draws random numbers only from [`skysink_common::random`], and saves
/// all its state in its checkpoint.
pub trait Strategy: Checkpoint {
    /// The decision for the slot of `view`; `None` if no sensor node is in reach, which leaves the slot to transit
    /// (decision D8).
    fn plan(&mut self, view: &View<'_>) -> Option<Decision>;

    /// Observes a flight, and the estimate after it; `None` if the queues are known.
    fn observe(&mut self, _report: &FlightReport, _estimate: Option<&Estimate>) {}

    /// The planned waypoints after the last decided one, from strategies that look ahead.
    fn path(&self) -> &[Point3<f64>] {
        &[]
    }
}

/// The input of a strategy for a slot.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// The slot to plan, t; the first is 1.
    pub slot: u64,
    /// Position of the UAV at its beginning, `L_u(t−1)` [m].
    pub position: Point3<f64>,
    /// Known or estimated queues at its beginning, `B_i(t−1)` [bit], by id.
    pub queues_bits: &'a [u32],
    /// The estimate of the queues; `None` if they are known.
    pub estimate: Option<&'a Estimate>,
    /// The SNs and the limits of the UAV.
    pub table: &'a SensorTable,
    /// Whether a search may read a clock.
    pub timing: Timing,
    /// Ends long searches; the decision is then not flown.
    pub stop: &'a Stop,
}

/// What paces a mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timing {
    /// The steps themselves: results do not depend on a clock.
    Free,
    /// A clock: late plans are void, and a search may end by time.
    Paced,
}

impl View<'_> {
    /// Horizontal position of the UAV.
    #[must_use]
    pub fn ground(&self) -> Position {
        self.position.xy()
    }
}

/// The decision of a strategy for a slot.
#[derive(Debug, Clone)]
pub struct Decision {
    /// The waypoint [m].
    pub waypoint: Point3<f64>,
    /// The sensor nodes (SNs) to serve from there, ascending by id.
    pub schedule: ArrayVec<u32, MAX_SERVED>,
    /// How the waypoint was found.
    pub outcome: SolverOutcome,
    /// How Algorithm 1 found the schedule, for display.
    pub winner: Option<Winner>,
}

/// The input for the construction of a strategy.
#[derive(Debug, Clone, Copy)]
pub struct Setup<'a> {
    /// The mission.
    pub scenario: &'a Scenario,
    /// The keys of its `[planner]` that apply to all strategies.
    pub settings: &'a Settings,
    /// Its sensor nodes (SNs), by id.
    pub sensors: &'a [SensorNode],
    /// The SNs and the limits of the UAV, as in every view.
    pub table: &'a SensorTable,
    /// The estimate of the queues before any contact; `None` if they are known.
    pub estimate: Option<&'a Estimate>,
}

/// Checks the named table of a scenario, and fills in its defaults.
pub type CheckKeys = fn(&Scenario, &str) -> Result<Table, InputError>;

/// An entry of the registry. It is serialized as its name.
#[derive(Debug, Clone, Copy)]
pub struct Registered {
    /// Its name in scenario files, folders and tables.
    pub name: &'static str,
    /// What it does, in a line.
    pub about: &'static str,
    /// Whether it keeps no state between slots.
    pub is_stateless: bool,
    /// Whether it plans beyond a slot ([`Strategy::path`]).
    pub has_path: bool,
    /// Checks its own keys, `[planner.<name>]`; `None` if it has none.
    pub keys: Option<CheckKeys>,
    /// Constructs it, for a scenario with checked keys.
    pub make: fn(&Setup<'_>) -> Box<dyn Strategy>,
}

impl Registered {
    /// The strategy called `name`, if there is one.
    #[must_use]
    pub fn find(name: &str) -> Option<&'static Self> {
        STRATEGIES.into_iter().find(|strategy| strategy.name == name)
    }

    /// The strategy of a scenario.
    ///
    /// # Errors
    /// If none has the name that the scenario gives.
    pub fn of(scenario: &Scenario) -> Result<&'static Self, InputError> {
        let name = scenario.planner.strategy.as_str();
        Self::find(name).ok_or_else(|| scenario.refusal("planner.strategy", &name.into(), &expected(name)))
    }

    /// Replaces its own keys in a scenario.
    pub fn set_keys(&self, scenario: &mut Scenario, keys: impl Serialize) {
        let keys = Table::try_from(keys).expect("keys are numbers and strings");
        scenario.planner.others.insert(self.name.to_owned(), keys.into());
    }
}

impl PartialEq for Registered {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Serialize for Registered {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

impl<'de> Deserialize<'de> for &'static Registered {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Registered::find(&name).ok_or_else(|| de::Error::custom(format!("{name:?}: expected {}", expected(&name))))
    }
}

/// The table `table` of a scenario, read as the keys `T` of a strategy, with all defaults.
fn checked<T: Serialize + DeserializeOwned>(scenario: &Scenario, table: &str) -> Result<Table, InputError> {
    let keys: T = scenario.planner_keys(table)?;
    Ok(Table::try_from(keys).expect("keys are numbers and strings"))
}

/// The expected names of strategies instead of the unknown `name`, for messages.
#[must_use]
pub fn expected(name: &str) -> String {
    let hint = did_you_mean(name, names()).map(|meant| format!("; did you mean `{meant}`?"));
    one_of(names()) + &hint.unwrap_or_default()
}

/// The expected names, for messages.
pub(crate) fn one_of<T: Display>(names: impl IntoIterator<Item = T>) -> String {
    let quoted: Vec<String> = names.into_iter().map(|name| format!("`{name}`")).collect();
    format!("one of {}", quoted.join(", "))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;
    use std::sync::LazyLock;

    /// The strategy of that name over SNs at `positions_m` [m], in the letter's scenario.
    pub(crate) fn made(name: &str, positions_m: &[[f64; 2]]) -> (SensorTable, Box<dyn Strategy>) {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let sensor = |&[x_m, y_m]: &[f64; 2]| SensorNode { x_m, y_m, gain: 10f64.powf(-5.2), ..SensorNode::default() };
        let sensors: Vec<SensorNode> = positions_m.iter().map(sensor).collect();
        let table = SensorTable::new(&scenario, &sensors);
        let settings = &Settings::of(&scenario).unwrap();
        let setup = Setup { scenario: &scenario, settings, sensors: &sensors, table: &table, estimate: None };
        let strategy = (Registered::find(name).unwrap().make)(&setup);
        (table, strategy)
    }

    /// Some SNs, and what a strategy is made of before it flies over them.
    pub(crate) struct FieldFixture {
        pub scenario: Scenario,
        settings: Settings,
        pub sensors: Vec<SensorNode>,
        pub table: SensorTable,
    }

    impl FieldFixture {
        pub(crate) fn over(scenario: Scenario, sensors: Vec<SensorNode>) -> Self {
            let settings = Settings::of(&scenario).unwrap();
            let table = SensorTable::new(&scenario, &sensors);
            Self { scenario, settings, sensors, table }
        }

        pub(crate) fn setup(&self) -> Setup<'_> {
            let Self { scenario, settings, sensors, table } = self;
            Setup { scenario, settings, sensors, table, estimate: None }
        }
    }

    /// SNs by position [m], rate [bit/s] and buffer [bit] in the letter's scenario.
    pub(crate) fn field(sensors: impl Iterator<Item = ([f64; 2], f64, u32)>) -> FieldFixture {
        let node = |([x_m, y_m], sampling_bps, capacity_bits): ([f64; 2], f64, u32)| SensorNode {
            x_m,
            y_m,
            sampling_bps,
            capacity_bits,
            gain: 10f64.powf(-5.2),
            ..SensorNode::default()
        };
        FieldFixture::over(Scenario::letter(Overrides::default()).unwrap(), sensors.map(node).collect())
    }

    /// What it sees from 20 m above `ground` [m].
    pub(crate) fn view<'a>(table: &'a SensorTable, slot: u64, ground: [f64; 2], queues_bits: &'a [u32]) -> View<'a> {
        let position = Point3::new(ground[0], ground[1], 20.0);
        static STOP: LazyLock<Stop> = LazyLock::new(Stop::default);
        View { slot, position, queues_bits, estimate: None, table, timing: Timing::Free, stop: &STOP }
    }

    #[test]
    fn every_strategy_is_registered_by_its_name_and_whether_it_is_stateless() {
        for strategy in STRATEGIES {
            let name = strategy.name;
            let overrides = Overrides { strategy: Some(name), ..Overrides::default() };
            assert_eq!(Registered::of(&Scenario::letter(overrides).unwrap()).unwrap().name, name);
            let mut bytes = Vec::new();
            made(name, &[[50.0, 50.0]]).1.save(&mut bytes);
            assert_eq!(bytes.is_empty(), strategy.is_stateless, "{name}");
        }
    }
}
