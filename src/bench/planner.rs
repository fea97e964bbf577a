//! A slot's plan, with the grid and without, and the waypoint by both solvers.
//!
//! The UAV flies: queues grow and are emptied between the slots, unmeasured, as the letter's are.

use skysink_planner::strategies::stateless;
use std::hint::black_box;
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::geometry::{Position, above};
use skysink_common::message::{Plan, SensorNode};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_planner::Planner;
use skysink_planner::geometry::disks::{Disk, project};
use skysink_planner::geometry::grid::Grid;
use skysink_planner::sensor_table::SensorTable;
use skysink_planner::settings::Settings;
use skysink_planner::waypoint::conic::ConicSolver;

use super::{Effort, Times, counts, letter};
use crate::error::Error;
use skysink_mission::latency::Spread;

/// Slots after which a flight begins again: few enough that no queue far from the UAV is full.
const SLOTS: u64 = 150;

/// Slots before the first that counts.
const WARM_UP: u64 = 10;

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
    pub strategy: &'static str,
    /// With the grid.
    pub plan: Spread,
    /// The same slots without it.
    pub undivided: Spread,
    /// Median without the grid over that with it.
    pub undivided_over_plan: f64,
}

/// A UAV under way, and the queues under it.
struct Flight<'a> {
    scenario: &'a Scenario,
    initial_bits: &'a [u32],
    queues_bits: Vec<u32>,
    position: Position,
    slot: u64,
}

impl<'a> Flight<'a> {
    fn new(scenario: &'a Scenario, initial_bits: &'a [u32]) -> Self {
        Self { scenario, initial_bits, queues_bits: initial_bits.to_vec(), position: scenario.start().xy(), slot: 1 }
    }

    fn plan(&self, planner: &mut Planner) -> Plan {
        black_box(planner.step(self.slot, above(&self.position, self.scenario.uav.altitude_m), &self.queues_bits))
    }

    /// Advances by the slot of a plan, which empties what it serves.
    fn advance(&mut self, plan: &Plan) {
        plan.scheduled().iter().for_each(|&id| self.queues_bits[id as usize] = 0);
        let capacity_bits = self.scenario.sensors.capacity_bits;
        self.queues_bits.iter_mut().for_each(|queue_bits| *queue_bits = (*queue_bits + 100).min(capacity_bits));
        self.position = Position::new(plan.x_m, plan.y_m);
        self.slot += 1;
        if self.slot.is_multiple_of(SLOTS) {
            self.queues_bits.copy_from_slice(self.initial_bits);
        }
    }
}

/// Measures every strategy with every number of SNs.
///
/// # Errors
/// If the sensor list is refused, or on a stop.
pub fn measure(effort: Effort, stop: &Stop) -> Result<PlannerSpeeds, Error> {
    let mut plans = Vec::new();
    for &sensors in counts(effort) {
        let scenario = letter(sensors, "uts");
        let list = SensorList::of(&scenario)?;
        let (nodes, initial_bits) = (list.nodes(), list.queues_bits());
        for strategy in stateless() {
            stop.check()?;
            plans.push(row(&letter(sensors, strategy), &nodes, &initial_bits, effort)?);
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

fn row(scenario: &Scenario, nodes: &[SensorNode], initial_bits: &[u32], effort: Effort) -> Result<PlanRow, Error> {
    let table = SensorTable::new(scenario, nodes);
    let undivided = SensorTable { grid: Grid::undivided(&table.positions), ..table.clone() };
    let (mut with, mut without) = (Planner::over(scenario, nodes, table)?, Planner::over(scenario, nodes, undivided)?);
    let mut flight = Flight::new(scenario, initial_bits);
    for _ in 0..WARM_UP {
        let plan = flight.plan(&mut with);
        flight.advance(&plan);
    }
    let budget = effort.choose(Duration::from_secs(2), Duration::from_millis(20));
    let (mut plans, mut undivided, mut spent) = (Times::new(), Times::new(), Duration::ZERO);
    let start = Instant::now();
    while start.elapsed() < 2 * budget {
        let begin = Instant::now();
        let plan = flight.plan(&mut with);
        plans.add(begin, 1);
        if spent < budget {
            let begin = Instant::now();
            let same = flight.plan(&mut without);
            undivided.add(begin, 1);
            spent += begin.elapsed();
            assert_eq!(plan.scheduled(), same.scheduled(), "the grid finds whom a loop over all finds");
        }
        flight.advance(&plan);
    }
    let (plan, undivided) = (plans.spread(), undivided.spread());
    let (sensors, strategy) = (nodes.len() as u32, Settings::of(scenario)?.strategy.name);
    Ok(PlanRow { sensors, strategy, plan, undivided, undivided_over_plan: undivided.p50_us / plan.p50_us })
}

/// Waypoint problems of the letter's mission: a target, and the disks that it is projected onto.
fn problems() -> Result<Vec<(Position, Vec<Disk>)>, Error> {
    let scenario = letter(200, "uts");
    let list = SensorList::of(&scenario)?;
    let (nodes, initial_bits) = (list.nodes(), list.queues_bits());
    let mut planner = Planner::new(&scenario, &nodes)?;
    let (mut flight, mut problems) = (Flight::new(&scenario, &initial_bits), Vec::new());
    for _ in 0..SLOTS {
        let plan = flight.plan(&mut planner);
        let place = |&id: &u32| Position::new(nodes[id as usize].x_m, nodes[id as usize].y_m);
        let places: Vec<Position> = plan.scheduled().iter().map(place).collect();
        if places.len() == 4 {
            let sum: nalgebra::Vector2<f64> = places.iter().map(|place| place.coords).sum();
            let disk = |centre| Disk { centre, radius_m: scenario.link.comm_radius_m };
            let mut disks = vec![Disk { centre: flight.position, radius_m: scenario.reach_m() }];
            disks.extend(places.into_iter().map(disk));
            problems.push((Position::from(sum / 4.0), disks));
        }
        flight.advance(&plan);
    }
    Ok(problems)
}
