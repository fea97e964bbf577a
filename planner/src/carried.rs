//! What a planner carries from slot to slot, by strategy.

use skysink_common::message::SensorNode;
use skysink_common::scenario::{Scenario, Strategy};

use crate::field::Field;
use crate::horizon::Horizon;
use crate::memory::{MemoryError, Reader, begin};
use crate::rounds::{Ages, Rounds};

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
    /// The state of a scenario's strategy before its first slot.
    pub fn new(scenario: &Scenario, sensors: &[SensorNode], field: &Field) -> Self {
        match scenario.planner.strategy {
            Strategy::Rfs | Strategy::Gfs | Strategy::Uts | Strategy::UtsWide | Strategy::Exact => Self::Nothing,
            strategy @ (Strategy::Tour | Strategy::RoundRobin) => {
                Self::Rounds(Rounds::new(strategy, field, &scenario.uav.start))
            }
            Strategy::MaxAgeFirst => Self::Ages(Ages::new(field)),
            Strategy::Horizon | Strategy::Offline => Self::Horizon(Box::new(Horizon::new(scenario, sensors))),
        }
    }

    /// Writes the state after `slot`; nothing where there is none.
    pub fn remember(&self, strategy: Strategy, slot: u64, bytes: &mut Vec<u8>) {
        bytes.clear();
        match self {
            Self::Nothing => {}
            Self::Rounds(rounds) => {
                begin(bytes, strategy, slot);
                rounds.remember(bytes);
            }
            Self::Ages(ages) => {
                begin(bytes, strategy, slot);
                ages.remember(bytes);
            }
            Self::Horizon(horizon) => {
                begin(bytes, strategy, slot);
                horizon.remember(bytes);
            }
        }
    }

    /// Reads the state after `slot`; on an error it stays as it was.
    pub fn recall(&mut self, strategy: Strategy, slot: u64, bytes: &[u8]) -> Result<(), MemoryError> {
        match self {
            Self::Nothing if bytes.is_empty() => Ok(()),
            Self::Nothing => Err(MemoryError::Malformed { bytes: bytes.len(), strategy: strategy.name() }),
            Self::Rounds(rounds) => rounds.recall(Reader::new(bytes, strategy, slot)?),
            Self::Ages(ages) => ages.recall(Reader::new(bytes, strategy, slot)?),
            Self::Horizon(horizon) => horizon.recall(Reader::new(bytes, strategy, slot)?),
        }
    }
}
