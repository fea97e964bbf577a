//! A slot's plan, with the grid and without, and the waypoint by both solvers.
//!
//! The UAV flies a mission, unmeasured between its plans.

use std::hint::black_box;
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_planner::Planner;
use skysink_planner::geometry::disks::{Disk, project};
use skysink_planner::geometry::grid::Grid;
use skysink_planner::sensor_table::SensorTable;
use skysink_planner::strategies::stateless;
use skysink_planner::waypoint::conic::ConicSolver;

use super::{Effort, Times, counts, letter};
use crate::error::Error;
use skysink_mission::Mission;
use skysink_mission::latency::Spread;

/// Slots after which a flight begins again: few enough that no queue far from the UAV is full.
const SLOTS: u64 = 150;

/// Solves of a waypoint that are timed together: one takes little longer than reading the clock.
const SOLVES: u64 = 64;

/// What was measured of the planner.
#[derive(Debug, Serialize)]
pub struct PlannerSpeeds {
    /// By number of SNs and strategy.
    pub plans: Vec<PlanRow>,
    /// The nearest point of five disks, reach and the ranges of four SNs, without a loop over candidates.
    pub waypoint_geometric: Spread,
    /// The same by Clarabel, with the solver kept.
    pub waypoint_clarabel: Spread,
}

/// A slot's plan.
#[derive(Debug, Serialize)]
pub struct PlanRow {
    /// Sensor nodes.
    pub sensors: u32,
    /// The strategy.
    pub strategy: String,
    /// With the grid.
    pub plan: Spread,
    /// Without it, in the slots between.
    pub undivided: Spread,
    /// Median without the grid over that with it.
    pub undivided_over_plan: f64,
}

/// Measures every strategy with every number of SNs.
///
/// # Errors
/// If the sensor list is refused, or on a stop.
pub fn measure(effort: Effort, stop: &Stop) -> Result<PlannerSpeeds, Error> {
    let mut plans = Vec::new();
    for &sensors in counts(effort) {
        let list = SensorList::of(&letter(sensors, "uts"))?;
        for strategy in stateless() {
            stop.check()?;
            plans.push(row(&letter(sensors, strategy), &list, effort)?);
        }
    }
    let problems = problems()?;
    let mut kept = ConicSolver::default();
    let (mut geometric, mut clarabel) = (Times::new(), Times::new());
    let mut next = problems.iter().cycle();
    let begin = Instant::now();
    while begin.elapsed() < effort.choose(Duration::from_secs(2), Duration::from_millis(50)) {
        let batch: Vec<_> = next.by_ref().take(SOLVES as usize).collect();
        let begin = Instant::now();
        for (target, disks) in &batch {
            let _ = black_box(project(target, disks));
        }
        geometric.add(begin, SOLVES);
        let begin = Instant::now();
        for (target, disks) in &batch {
            let _ = black_box(kept.project(target, disks));
        }
        clarabel.add(begin, SOLVES);
    }
    Ok(PlannerSpeeds { plans, waypoint_geometric: geometric.spread(), waypoint_clarabel: clarabel.spread() })
}

fn row(scenario: &Scenario, list: &SensorList, effort: Effort) -> Result<PlanRow, Error> {
    let nodes = list.nodes();
    let table = SensorTable::new(scenario, &nodes);
    let undivided = SensorTable { grid: Grid::new(&table.positions, f64::INFINITY), ..table };
    let mut without = Planner::over(scenario, &nodes, undivided)?;
    let mut mission = Mission::new(scenario, list)?;
    let budget = effort.choose(Duration::from_secs(2), Duration::from_millis(20));
    let mut plans = Times::new();
    let mut undivided = Times::new();
    let mut spent = Duration::ZERO;
    let start = Instant::now();
    while start.elapsed() < 2 * budget {
        let slot = mission.slot() + 1;
        // Whoever plans a slot a second time is quicker, by all that the processor has learned: the first is timed.
        let is_undivided = slot.is_multiple_of(2) && spent < budget;
        if is_undivided {
            let begin = Instant::now();
            let _ = black_box(without.step(slot, mission.last_flight().position(), mission.queues_bits()));
            undivided.add(begin, 1);
            spent += begin.elapsed();
        }
        let begin = Instant::now();
        let plan = black_box(mission.plan());
        if !is_undivided {
            plans.add(begin, 1);
        }
        mission.fly(Some(&plan));
        if mission.slot() == SLOTS {
            mission = Mission::new(scenario, list)?;
        }
    }
    let plan = plans.spread();
    let undivided = undivided.spread();
    Ok(PlanRow {
        sensors: nodes.len() as u32,
        strategy: scenario.planner.strategy.clone(),
        plan,
        undivided,
        undivided_over_plan: undivided.p50_us / plan.p50_us,
    })
}

/// Waypoint problems of the letter's mission: a target, and the disks that it is projected onto.
fn problems() -> Result<Vec<(Position, Vec<Disk>)>, Error> {
    let scenario = letter(200, "uts");
    let list = SensorList::of(&scenario)?;
    let nodes = list.nodes();
    let mut mission = Mission::new(&scenario, &list)?;
    let mut problems = Vec::new();
    for _ in 0..SLOTS {
        let plan = mission.plan();
        let place = |&id: &u32| Position::new(nodes[id as usize].x_m, nodes[id as usize].y_m);
        let places: Vec<Position> = plan.scheduled().iter().map(place).collect();
        if places.len() == 4 {
            let sum: nalgebra::Vector2<f64> = places.iter().map(|place| place.coords).sum();
            let disk = |centre| Disk { centre, radius_m: scenario.link.comm_radius_m };
            let position = mission.last_flight().position().xy();
            let mut disks = vec![Disk { centre: position, radius_m: scenario.reach_m() }];
            disks.extend(places.into_iter().map(disk));
            problems.push((Position::from(sum / 4.0), disks));
        }
        mission.fly(Some(&plan));
    }
    Ok(problems)
}
