//! Plan times by strategy and number of sensor nodes (SNs).

use std::hint::black_box;
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_mission::latency::{Spread, histogram};
use skysink_planner::strategies::{stateless, uts};

use crate::error::BenchError;
use crate::setting::{BenchEffort, letter, nanoseconds};

/// Slots after which a flight begins again: few enough that no queue far from the UAV is full.
const SLOTS: u64 = 150;

/// A slot's plan.
#[derive(Debug, Serialize)]
pub struct PlanRow {
    /// Sensor nodes.
    pub sensors: u32,
    /// The strategy.
    pub strategy: &'static str,
    /// Time of the plan; the flight between two plans is not timed.
    pub plan: Spread,
}

/// Measures every strategy that plans one slot, with every number of SNs.
pub fn measure(effort: BenchEffort, stop: &Stop) -> Result<Vec<PlanRow>, BenchError> {
    let mut rows = Vec::new();
    for &sensors in effort.counts() {
        let list = SensorList::of(&letter(sensors, uts::STRATEGY.name))?;
        for strategy in stateless() {
            stop.check()?;
            rows.push(PlanRow { sensors, strategy, plan: plan_times(strategy, &list, effort)? });
        }
    }
    Ok(rows)
}

fn plan_times(strategy: &'static str, list: &SensorList, effort: BenchEffort) -> Result<Spread, BenchError> {
    let scenario = letter(list.sensors().len() as u32, strategy);
    let mut mission = Mission::new(&scenario, list)?;
    let mut times = histogram();
    let start = Instant::now();
    while start.elapsed() < effort.choose(Duration::from_secs(2), Duration::from_millis(20)) {
        let begin = Instant::now();
        let plan = black_box(mission.plan());
        times.saturating_record(nanoseconds(begin));
        mission.fly(Some(&plan));
        if mission.slot() == SLOTS {
            mission = Mission::new(&scenario, list)?;
        }
    }
    Ok(Spread::of(&times))
}
