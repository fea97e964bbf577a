//! Simulates a few fast strategies for their loss and the length of their first round.

use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{SlotRecord, uploads};
use skysink_common::stop::Stop;
use skysink_mission::drive::SlotSink;
use skysink_mission::{Mission, MissionError};
use skysink_planner::strategies::{edf, tour, uts_wide};
use skysink_planner::strategy::Registered;

/// Strategies to simulate, in this order, until one loses nothing. The first one determines the round.
const FAST: [&Registered; 3] = [&tour::STRATEGY, &uts_wide::STRATEGY, &edf::STRATEGY];

/// Maximum number of sensor nodes (SNs) of a simulated mission. Computing a tour over more takes too long.
pub const MAX_SENSORS: usize = 5_000;

/// Maximum number of SNs times slots of a simulated mission.
const MAX_SENSOR_SLOTS: u64 = 5_000_000;

/// The result of one strategy.
pub struct TrialFlight {
    pub strategy: &'static str,
    /// Bits lost by overflow.
    pub lost_bits: u64,
    /// Bits lost as a fraction of the bits sampled.
    pub loss_rate: f64,
    /// The slot at whose end every SN had been served; `None` if that did not happen.
    pub round_slots: Option<u64>,
}

/// Simulates the mission with the strategies up to the first that loses nothing. Returns nothing for a mission that is
/// too large.
///
/// # Errors
/// If `[planner]` is refused.
pub fn trial_flights(scenario: &Scenario, list: &SensorList) -> Result<Vec<TrialFlight>, MissionError> {
    let sensors = list.sensors().len();
    let mut flights: Vec<TrialFlight> = Vec::new();
    if sensors > MAX_SENSORS || (sensors as u64).saturating_mul(scenario.slots) > MAX_SENSOR_SLOTS {
        return Ok(flights);
    }
    for strategy in FAST {
        if flights.iter().all(|flight| flight.lost_bits > 0) {
            flights.push(TrialFlight::simulate(strategy.name, scenario, list)?);
        }
    }
    Ok(flights)
}

impl TrialFlight {
    /// Simulates the mission with `strategy`.
    fn simulate(strategy: &'static str, scenario: &Scenario, list: &SensorList) -> Result<Self, MissionError> {
        let mut scenario = scenario.clone();
        strategy.clone_into(&mut scenario.planner.strategy);
        let mut mission = Mission::new(&scenario, list)?;
        let sensors = list.sensors().len();
        let mut round = FirstRound { is_served: vec![false; sensors], unserved: sensors, slots: None };
        mission.drive(&mut [&mut round], &Stop::default())?;
        let totals = mission.header().totals;
        let loss_rate = list.loss_rate(&scenario).after(scenario.slots, &totals);
        Ok(Self { strategy, lost_bits: totals.lost_bits, loss_rate, round_slots: round.slots })
    }
}

/// Measures the length of the first round.
struct FirstRound {
    is_served: Vec<bool>,
    unserved: usize,
    slots: Option<u64>,
}

impl SlotSink for FirstRound {
    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
        for link in uploads(record.flights()) {
            self.unserved -= usize::from(!std::mem::replace(&mut self.is_served[link.sensor as usize], true));
        }
        if self.unserved == 0 {
            self.slots.get_or_insert(record.slot());
        }
        Ok(())
    }
}
