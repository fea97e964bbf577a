//! Fleets against one UAV: the plan of a slot, and a slot of the ring.

use std::hint::black_box;
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::pace::Pace;
use skysink_common::scenario::Coordination;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Plant;
use skysink_mission::drive::Pilot as _;
use skysink_mission::latency::{Spread, histogram};
use skysink_planner::fleet::FleetPlanner;
use skysink_planner::strategies::uts;
use skysink_ring::wait::Waiting;

use crate::error::BenchError;
use crate::hop::RingCase;
use crate::ring::run_ring;
use crate::setting::{BenchEffort, letter, median_by, nanoseconds};

/// Numbers of UAVs that are compared.
const UAVS: [u32; 4] = [1, 2, 4, 8];

/// Sensor nodes.
const SENSORS: u32 = 200;

/// Slots after which a flight begins again.
const SLOTS: u64 = 150;

/// A number of UAVs.
#[derive(Debug, Serialize)]
pub struct FleetRow {
    /// UAVs, which plan one after the other (`sequential`).
    pub uavs: u32,
    /// Sensor nodes.
    pub sensors: u32,
    /// The plans of all UAVs for a slot, by `uts`.
    pub plan: Spread,
    /// A slot of the ring.
    pub slot: Spread,
    /// Median of the plan over that of one UAV.
    pub plan_over_one: f64,
    /// Median of the slot over that of one UAV.
    pub slot_over_one: f64,
}

/// Measures the numbers of UAVs in turns.
pub fn measure(effort: BenchEffort, stop: &Stop) -> Result<Vec<FleetRow>, BenchError> {
    let mut plans = UAVS.map(|_| Vec::new());
    let mut slots = UAVS.map(|_| Vec::new());
    for _ in 0..effort.choose(5, 1) {
        for (index, uavs) in UAVS.into_iter().enumerate() {
            plans[index].push(plan_times(uavs, effort, stop)?);
            let case = RingCase {
                sensors: SENSORS,
                wait: Waiting::default(),
                pace: Pace::Max,
                slots: effort.choose(6_000, 100),
                uavs,
            };
            slots[index].push(run_ring(case, stop)?.latency.expect("a run without a link measures them").slot);
        }
    }
    let [plans, slots] = [plans, slots].map(|all| all.map(|spreads| median_by(spreads, |spread| spread.p50_us)));
    let row = |(uavs, (plan, slot)): (u32, (Spread, Spread))| FleetRow {
        uavs,
        sensors: SENSORS,
        plan,
        slot,
        plan_over_one: plan.p50_us / plans[0].p50_us,
        slot_over_one: slot.p50_us / slots[0].p50_us,
    };
    Ok(UAVS.into_iter().zip(plans.into_iter().zip(slots)).map(row).collect())
}

/// Times of the plans of all UAVs for a slot.
fn plan_times(uavs: u32, effort: BenchEffort, stop: &Stop) -> Result<Spread, BenchError> {
    let mut scenario = letter(SENSORS, uts::STRATEGY.name);
    scenario.uav.count = Some(uavs);
    scenario.uav.coordination = Some(Coordination::Sequential);
    let list = SensorList::of(&scenario)?;
    let begun =
        || Ok::<_, BenchError>((Plant::new(&scenario, &list), FleetPlanner::until(&scenario, &list.nodes(), stop)?));
    let (mut plant, mut planner) = begun()?;
    let mut times = histogram();
    let start = Instant::now();
    while start.elapsed() < effort.choose(Duration::from_secs(2), Duration::from_millis(20)) {
        stop.check()?;
        let begin = Instant::now();
        let orders = black_box(planner.orders(&plant)).expect("a planner of this process has no link to lose");
        times.saturating_record(nanoseconds(begin));
        plant.fly(&orders);
        if plant.slot() == SLOTS {
            (plant, planner) = begun()?;
        }
    }
    Ok(Spread::of(&times))
}
