//! One slot of planning: schedule, then waypoint.
//!
//! The rules live next door: [`crate::search`] (whom), [`crate::waypoint`] (where), [`crate::strategy`] (the baselines).

use skysink_common::geometry::Position;
use skysink_common::message::{Mode, Plan, SensorNode, SolverOutcome};
use skysink_common::random::Streams;
use skysink_common::scenario::{Scenario, Strategy};

use crate::field::Field;
use crate::search::Search;
use crate::strategy::{greedy_waypoint, random_waypoint, serve_fullest, transit_waypoint};
use crate::waypoint::{Problem, Solver};

/// The planner of a mission.
///
/// It holds nothing that it could not rebuild from the scenario and the sensor nodes: a slot's plan does not depend on
/// the slots planned before.
pub struct Planner {
    field: Field,
    strategy: Strategy,
    sca_iterations: u32,
    streams: Streams,
    search: Search,
    problem: Problem,
    solver: Solver,
    /// The schedule in the making; room for every SN, so that no slot allocates.
    ids: Vec<u32>,
}

impl Planner {
    /// The planner of a scenario with the sensor nodes `sensors`, SN i at entry i.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &[SensorNode]) -> Self {
        let field = Field::new(scenario, sensors);
        Self {
            strategy: scenario.planner.strategy,
            sca_iterations: scenario.planner.sca_iterations,
            streams: Streams::new(scenario.seed),
            search: Search::with_room_for(sensors.len()),
            problem: Problem::new(&field),
            solver: Solver::new(scenario.planner.waypoint_solver),
            ids: Vec::with_capacity(sensors.len()),
            field,
        }
    }

    /// Plans `slot` from where the UAV is, `L_u(t−1)`, and the queues `B_i(t−1)` [bit], by id.
    ///
    /// `plan_ns` stays 0: a step reads no clock.
    ///
    /// # Panics
    /// If there is not one queue per sensor node.
    #[must_use]
    pub fn step(&mut self, slot: u64, position: &Position, queues_bits: &[u32]) -> Plan {
        assert_eq!(queues_bits.len(), self.field.positions.len(), "expected one queue per sensor node");
        let own = match self.strategy {
            Strategy::Uts => self.schedule_then_fly(position, queues_bits),
            Strategy::Gfs => greedy_waypoint(&self.field, position, queues_bits)
                .map(|waypoint| self.fly_then_schedule(&waypoint, Mode::Serve, queues_bits)),
            Strategy::Rfs => {
                let waypoint = random_waypoint(&self.field, &self.streams, slot, position);
                Some(self.fly_then_schedule(&waypoint, Mode::Serve, queues_bits))
            }
        };
        own.unwrap_or_else(|| {
            let waypoint = transit_waypoint(&self.field, position, queues_bits);
            self.fly_then_schedule(&waypoint, Mode::Transit, queues_bits)
        })
    }

    /// The letter's strategy: sP1 by Algorithm 1, then sP2*; `None` if there is no anchor in reach or no feasible point.
    fn schedule_then_fly(&mut self, position: &Position, queues_bits: &[u32]) -> Option<Plan> {
        let winner = self.search.best_set(&self.field, position, queues_bits, &mut self.ids)?;
        self.problem.pose(&self.field, position, &self.ids);
        let waypoint = self.problem.solve(&mut self.solver, self.sca_iterations)?;
        let place = self.field.into_area(&waypoint.position);
        let mut plan = self.plan(&place, Mode::Serve, waypoint.outcome, queues_bits);
        plan.anchor = winner.anchor;
        if let Some(pair) = winner.pair {
            plan.partner = pair.partner;
            plan.circles_m = pair.circles.map(|centre| [centre.x, centre.y]);
            plan.chosen = pair.chosen;
        }
        Some(plan)
    }

    /// The baselines and transit: a waypoint by rule, then the fullest queues in range of it.
    fn fly_then_schedule(&mut self, waypoint: &Position, mode: Mode, queues_bits: &[u32]) -> Plan {
        let waypoint = self.field.into_area(waypoint);
        serve_fullest(&self.field, &waypoint, queues_bits, &mut self.ids);
        self.plan(&waypoint, mode, SolverOutcome::Rule, queues_bits)
    }

    /// The plan to fly to `waypoint` and serve `self.ids`, which are ascending.
    fn plan(&self, waypoint: &Position, mode: Mode, outcome: SolverOutcome, queues_bits: &[u32]) -> Plan {
        let mut plan = Plan::fly_to(waypoint.x, waypoint.y, self.field.link.altitude_m, mode);
        plan.schedule(&self.ids);
        plan.solver = outcome.code();
        plan.expected_bits = self.field.expected_bits(waypoint, &self.ids, queues_bits);
        plan
    }
}
