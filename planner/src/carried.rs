//! What a planner carries from slot to slot, by strategy; what it believes of the queues is [`crate::estimate`]'s.

use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;

use crate::estimate::Estimate;
use crate::horizon::Horizon;
use crate::memory::{MemoryError, Reader};
use crate::sensor_table::SensorTable;
use crate::settings::{Settings, Strategy};
use crate::strategies::rounds::{Ages, Rounds};

/// The state of the strategies that have one.
#[derive(Debug, Clone)]
pub(crate) enum Carried {
    /// The strategies of one slot.
    Nothing,
    /// Whose turn it is: `tour`, `round-robin`.
    Rounds(Rounds),
    /// Who was served when: `max-age-first`.
    Ages(Ages),
    /// The plan: `horizon`.
    Horizon(Box<Horizon>),
}

impl Carried {
    /// The state of a scenario's strategy before its first slot; `estimate` is what it believes of the queues, if it does
    /// not know them.
    pub fn new(
        scenario: &Scenario,
        settings: &Settings,
        sensors: &[SensorNode],
        table: &SensorTable,
        estimate: Option<&Estimate>,
    ) -> Self {
        match settings.strategy {
            Strategy::Rfs | Strategy::Gfs | Strategy::Uts | Strategy::UtsWide | Strategy::Exact => Self::Nothing,
            strategy @ (Strategy::Tour | Strategy::RoundRobin) => {
                Self::Rounds(Rounds::new(strategy, table, &scenario.uav.start))
            }
            Strategy::MaxAgeFirst => Self::Ages(Ages::new(table)),
            Strategy::Horizon | Strategy::Offline => {
                Self::Horizon(Box::new(match estimate.filter(|estimate| estimate.learns()) {
                    Some(estimate) => Horizon::learning(scenario, settings, sensors, estimate),
                    None => Horizon::new(scenario, settings, sensors),
                }))
            }
        }
    }

    /// Takes over the rates that are believed of the sensor nodes `ids`, where they are learnt.
    pub fn learn(&mut self, estimate: &Estimate, ids: impl Iterator<Item = u32>) {
        if let Self::Horizon(horizon) = self
            && estimate.learns()
        {
            ids.for_each(|id| horizon.learn(id, estimate));
        }
    }

    /// Takes over how sure the queues at the end of `slot` are.
    pub fn doubt(&mut self, slot: u64, estimate: &Estimate) {
        if let Self::Horizon(horizon) = self {
            horizon.doubt(slot, estimate);
        }
    }

    /// Appends the state.
    pub fn remember(&self, bytes: &mut Vec<u8>) {
        match self {
            Self::Nothing => {}
            Self::Rounds(rounds) => rounds.remember(bytes),
            Self::Ages(ages) => ages.remember(bytes),
            Self::Horizon(horizon) => horizon.remember(bytes),
        }
    }

    /// Reads the state, with which a memory ends; on an error it stays as it was.
    pub fn recall(&mut self, memory: Reader) -> Result<(), MemoryError> {
        match self {
            Self::Nothing => memory.end(),
            Self::Rounds(rounds) => rounds.recall(memory),
            Self::Ages(ages) => ages.recall(memory),
            Self::Horizon(horizon) => horizon.recall(memory),
        }
    }
}
