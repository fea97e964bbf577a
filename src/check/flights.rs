//! A few quick strategies, flown to see what they lose and how long they take to serve everybody.

use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_mission::Mission;

/// Strategies that are flown until one loses nothing. The first is that of the round.
const FLOWN: [&str; 3] = ["tour", "uts-wide", "edf"];

/// Most sensor nodes (SNs) whose mission is flown: a tour over more takes long to make.
pub const MOST_FLOWN: usize = 5_000;

/// Most SNs times slots of a mission that is flown.
const MOST_FLOWN_SLOTS: u64 = 5_000_000;

/// What one strategy makes of the mission.
pub struct TrialFlight {
    /// Its name.
    pub strategy: &'static str,
    /// What overflowed [bit].
    pub lost_bits: u64,
    /// The same as a fraction of what was sampled.
    pub loss_rate: f64,
    /// The slot by whose end every SN was served.
    pub round_slots: Option<u64>,
}

/// The flights of a mission, up to the first that loses nothing; none of a mission that takes long to fly.
///
/// # Errors
/// If `[planner]` is refused.
pub fn fly(scenario: &Scenario, list: &SensorList) -> Result<Vec<TrialFlight>, InputError> {
    let sensors = list.sensors().len();
    let mut flights: Vec<TrialFlight> = Vec::new();
    if sensors > MOST_FLOWN || (sensors as u64).saturating_mul(scenario.slots) > MOST_FLOWN_SLOTS {
        return Ok(flights);
    }
    for strategy in FLOWN {
        if flights.iter().all(|flight| flight.lost_bits > 0) {
            flights.push(TrialFlight::by(strategy, scenario, list)?);
        }
    }
    Ok(flights)
}

impl TrialFlight {
    /// Flies the mission by `strategy`.
    fn by(strategy: &'static str, scenario: &Scenario, list: &SensorList) -> Result<Self, InputError> {
        let mut scenario = scenario.clone();
        strategy.clone_into(&mut scenario.planner.strategy);
        let mut mission = Mission::new(&scenario, list)?;
        let mut is_served = vec![false; list.sensors().len()];
        let mut unserved = is_served.len();
        let mut round_slots = None;
        for flown in &mut mission {
            for link in flown.flight.served_links() {
                unserved -= usize::from(!std::mem::replace(&mut is_served[link.sensor as usize], true));
            }
            if unserved == 0 {
                round_slots.get_or_insert(flown.header.head.slot);
            }
        }
        let totals = mission.header().totals;
        let loss_rate = totals.lost_bits as f64 / (totals.sampled_bits as f64).max(1.0);
        Ok(Self { strategy, lost_bits: totals.lost_bits, loss_rate, round_slots })
    }
}
