//! One slot of planning: schedule, then waypoint.
//!
//! The rules live next door: [`crate::strategies::algorithm_1`] and [`crate::strategies::exact`] (whom),
//! [`crate::waypoint`] (where), [`crate::strategies::baselines`] (the baselines), [`crate::strategies::rounds`] (the
//! baselines that take turns), [`crate::horizon`] (many slots ahead). What is known of the queues is
//! [`crate::estimate`]'s.

mod remembering;

use std::ops::ControlFlow;
use std::time::Duration;

use nalgebra::Point3;
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, Mode, Plan, SensorNode, SolverOutcome};
use skysink_common::random::Streams;
use skysink_common::scenario::{Scenario, ScenarioError};

use crate::carried::Carried;
use crate::estimate::Estimate;
use crate::horizon::PATH;
use crate::horizon::optimize::Progress;
use crate::memory::{MemoryError, Reader, begin};
use crate::sensor_table::SensorTable;
use crate::settings::{Knowledge, Settings, Strategy};
use crate::strategies::algorithm_1::{Reach, Search};
use crate::strategies::baselines::{greedy_waypoint, random_waypoint, serve_fullest, transit_waypoint};
use crate::strategies::exact::ExactSearch;
use crate::waypoint::Solver;
use crate::waypoint::problem::Waypoint;

/// The planner of a mission.
///
/// What it carries from slot to slot is in [`Planner::memory`]; everything else it could rebuild from the scenario and the
/// sensor nodes. Most strategies carry nothing where the queues are known: their plan of a slot does not depend on the
/// slots planned before.
pub struct Planner {
    scenario: Scenario,
    settings: Settings,
    table: SensorTable,
    streams: Streams,
    search: Search,
    exact: ExactSearch,
    carried: Carried,
    /// What is believed of the queues; none where they are known.
    estimate: Option<Box<Estimate>>,
    /// Both as bytes, after the last slot.
    memory: Vec<u8>,
    /// Where the last plan leads.
    path: Vec<[f64; 3]>,
    solver: Solver,
    /// The schedule in the making; room for every SN, so that no slot allocates.
    ids: Vec<u32>,
}

/// What a slot starts from.
#[derive(Clone, Copy)]
struct Slot<'a> {
    number: u64,
    /// The UAV's position, `L_u(t−1)`.
    position: &'a Position,
    altitude_m: f64,
    /// `B_i(t−1)` [bit], by id.
    queues_bits: &'a [u32],
}

impl Slot<'_> {
    /// Where the UAV is.
    fn uav(&self) -> Point3<f64> {
        Point3::new(self.position.x, self.position.y, self.altitude_m)
    }
}

impl Planner {
    /// The planner of a scenario with the sensor nodes `sensors`, SN i at entry i.
    ///
    /// # Errors
    /// If `[planner]` of the scenario is refused; never for one that was read by [`crate::settings`].
    pub fn new(scenario: &Scenario, sensors: &[SensorNode]) -> Result<Self, ScenarioError> {
        Self::over(scenario, sensors, SensorTable::new(scenario, sensors))
    }

    /// The planner of a scenario over a field of its own, such as one with another grid.
    ///
    /// # Errors
    /// As [`Planner::new`].
    pub fn over(scenario: &Scenario, sensors: &[SensorNode], table: SensorTable) -> Result<Self, ScenarioError> {
        let settings = Settings::of(scenario)?;
        let estimate = (settings.knowledge == Knowledge::Estimated)
            .then(|| Box::new(Estimate::new(scenario, settings.rates, sensors)));
        Ok(Self {
            scenario: scenario.clone(),
            settings,
            streams: Streams::new(scenario.seed),
            search: Search::with_room_for(sensors.len()),
            exact: ExactSearch::new(&table),
            carried: Carried::new(scenario, &settings, sensors, &table, estimate.as_deref()),
            estimate,
            memory: Vec::new(),
            path: Vec::with_capacity(PATH),
            solver: Solver::new(scenario, &settings, &table),
            ids: Vec::with_capacity(sensors.len()),
            table,
        })
    }

    /// Takes in what was flown in `slot`, and the queues after it [bit], by id; to be done for every slot before the next
    /// one is planned. Where the queues are estimated, only those of the SNs that the flight serves are looked at, and a
    /// slot that is left out makes the estimate older, but not wrong; where they are known, nothing is done.
    pub fn observe(&mut self, slot: u64, flight: &FlightReport, queues_bits: &[u32]) {
        if let Some(estimate) = &mut self.estimate {
            estimate.observe(slot, flight, queues_bits);
            self.carried.learn(estimate, flight.served_links().iter().map(|link| link.sensor));
        }
    }

    /// Lets a search that looks ahead also end when `limit` has passed since its slot's step began; for runs paced by a
    /// clock only, because results then depend on time. Without a limit, as at first, no clock is read.
    pub fn limit(&mut self, limit: Option<Duration>) {
        if let Carried::Horizon(horizon) = &mut self.carried {
            horizon.limit(limit);
        }
    }

    /// Plans `slot` from where the UAV is, `L_u(t−1)` at the altitude `altitude_m` [m], and the queues `B_i(t−1)` [bit],
    /// by id. Where the queues are
    /// estimated, the plan is made from what is believed of them, see [`Planner::observe`]; of `queues_bits` is kept what
    /// those that it schedules will announce.
    ///
    /// It takes as long as there are SNs near the UAV, however many there are in all; only a slot of transit, and an
    /// estimate, look at every queue. `plan_ns` stays 0: a step reads no clock, unless
    /// [`Self::limit`] says so.
    ///
    /// # Panics
    /// If there is not one queue per sensor node.
    #[must_use]
    pub fn step(&mut self, slot: u64, position: &Position, altitude_m: f64, queues_bits: &[u32]) -> Plan {
        assert_eq!(queues_bits.len(), self.table.positions.len(), "expected one queue per sensor node");
        let mut estimate = self.estimate.take(); // lent to the slot
        if let Some(estimate) = &estimate {
            self.carried.doubt(slot.saturating_sub(1), estimate);
        }
        let believed_bits = estimate.as_mut().map(|estimate| estimate.believe(slot.saturating_sub(1)));
        let believed_bits = believed_bits.unwrap_or(queues_bits);
        let plan = self.plan_slot(Slot { number: slot, position, altitude_m, queues_bits: believed_bits });
        if let Some(estimate) = &mut estimate {
            estimate.announce(slot, plan.scheduled(), queues_bits);
        }
        self.estimate = estimate;
        self.remember(slot);
        plan
    }

    /// Plans a slot from the queues that are known or believed.
    fn plan_slot(&mut self, slot: Slot) -> Plan {
        let Slot { position, queues_bits, .. } = slot;
        self.path.clear();
        let own = match self.settings.strategy {
            Strategy::Uts => self.algorithm_1(Reach::Letter, slot),
            Strategy::UtsWide => self.algorithm_1(Reach::Wide, slot),
            Strategy::Exact => self.exact(slot),
            Strategy::Gfs => greedy_waypoint(&self.table, position, queues_bits)
                .map(|waypoint| self.fly_then_schedule(&waypoint, Mode::Serve, slot)),
            Strategy::Rfs => {
                let waypoint = random_waypoint(&self.table, &self.streams, slot.number, position);
                Some(self.fly_then_schedule(&waypoint, Mode::Serve, slot))
            }
            Strategy::Tour | Strategy::RoundRobin | Strategy::MaxAgeFirst => self.in_turn(slot),
            Strategy::Horizon | Strategy::Offline => self.look_ahead(slot),
        };
        let plan = own.unwrap_or_else(|| {
            let waypoint = transit_waypoint(&self.table, position, queues_bits);
            self.fly_then_schedule(&waypoint, Mode::Transit, slot)
        });
        if self.path.is_empty() {
            self.path.push([plan.x_m, plan.y_m, plan.z_m]);
        }
        plan
    }

    /// Makes the plan of `offline` now, before slot 1 and from the queues `queues_bits` [bit], by id, or what is believed of them, instead of in the first
    /// [`Planner::step`], which then flies the same; returns the loss [bit] that it leads to. `None` for the other
    /// strategies, if no sensor node that can lose data can be reached, or if `watch`, which is told now and then how far
    /// the search is, breaks it off.
    pub fn prepare(&mut self, queues_bits: &[u32], watch: &mut dyn FnMut(Progress) -> ControlFlow<()>) -> Option<f64> {
        let (strategy, start) = (self.settings.strategy, self.scenario.uav.start);
        let steps = (strategy == Strategy::Offline).then_some(self.settings.offline.steps.get())?;
        if let Some(estimate) = &self.estimate {
            self.carried.doubt(0, estimate);
        }
        let Carried::Horizon(horizon) = &mut self.carried else { return None };
        let believed_bits = self.estimate.as_mut().map(|estimate| estimate.believe(0));
        let loss_bits = horizon.prepare((1, steps), &start, believed_bits.unwrap_or(queues_bits), watch)?;
        self.remember(0);
        Some(loss_bits)
    }

    /// Puts down what the next slot has to know.
    fn remember(&mut self, slot: u64) {
        if self.settings.remembers() {
            begin(&mut self.memory, self.settings.strategy, slot, self.estimate.as_deref());
            self.carried.remember(&mut self.memory);
        }
    }

    /// What the next slot has to know of the slots so far: the state of the strategy, and what is believed of the queues.
    /// Empty for strategies that carry nothing where the queues are known.
    ///
    /// A planner that recalls it continues byte for byte as this one does.
    #[must_use]
    pub fn memory(&self) -> &[u8] {
        &self.memory
    }

    /// Goes on from the memory of a planner of the same scenario and sensor nodes that planned `slot` last.
    ///
    /// # Errors
    /// If the memory is of another slot, strategy or field; the planner then is as it was.
    pub fn recall(&mut self, slot: u64, memory: &[u8]) -> Result<(), MemoryError> {
        let strategy = self.settings.strategy;
        if self.settings.remembers() {
            let mut reader = Reader::new(memory, strategy, slot)?;
            let estimate = reader.estimate(self.estimate.as_deref())?;
            self.carried.recall(reader)?;
            self.estimate = estimate.map(Box::new);
            if let Some(estimate) = &self.estimate {
                self.carried.learn(estimate, self.table.ids());
            }
        } else if !memory.is_empty() {
            return Err(MemoryError::Malformed { bytes: memory.len(), strategy: strategy.name() });
        }
        self.memory.clear();
        self.memory.extend_from_slice(memory);
        Ok(())
    }

    /// Whether the plan of a slot depends on the slots before it: whether there is a memory.
    #[must_use]
    pub fn remembers(&self) -> bool {
        self.settings.remembers()
    }

    /// What is believed of the queues; `None` where they are known.
    #[must_use]
    pub fn estimate(&self) -> Option<&Estimate> {
        self.estimate.as_deref()
    }

    /// Where the last plan leads, its own waypoint first: at most 64 points [x, y, z] [m], more than one for `horizon`
    /// alone. Altitudes after the first are the first's.
    #[must_use]
    pub fn path(&self) -> &[[f64; 3]] {
        &self.path
    }

    /// The letter's strategy: sP1 by Algorithm 1, then the waypoint; `None` if there is no anchor in reach or no feasible
    /// point.
    fn algorithm_1(&mut self, reach: Reach, slot: Slot) -> Option<Plan> {
        let winner = self.search.best_set(reach, &self.table, slot.position, slot.queues_bits, &mut self.ids)?;
        let waypoint = self.waypoint_for_schedule(slot)?;
        let mut plan = self.plan_to_serve(&waypoint, slot);
        plan.anchor = winner.anchor;
        if let Some(pair) = winner.pair {
            plan.partner = pair.partner;
            plan.circles_m = pair.circles.map(|centre| centre.map_or([f64::NAN; 2], |centre| [centre.x, centre.y]));
            plan.chosen = pair.chosen;
        }
        Some(plan)
    }

    /// sP1 solved exactly, then the waypoint; `None` if no sensor node can be served from within reach.
    fn exact(&mut self, slot: Slot) -> Option<Plan> {
        let centre = self.exact.best_set(&self.table, slot.position, slot.queues_bits, &mut self.ids)?;
        // The centre keeps every constraint of sP2 up to the slack of decision D5. Where the set has no point in common
        // but for that slack, sP2* may find none, and the centre is flown to.
        let waypoint = self
            .waypoint_for_schedule(slot)
            .unwrap_or_else(|| Waypoint { point: self.above(&centre, slot), outcome: SolverOutcome::Fallback });
        Some(self.plan_to_serve(&waypoint, slot))
    }

    /// The waypoint for `self.ids`; `None` if no point in reach is in range of them all.
    fn waypoint_for_schedule(&mut self, slot: Slot) -> Option<Waypoint> {
        self.solver.solve(&self.table, &slot.uav(), &self.ids)
    }

    /// The point above `ground` that serves `self.ids` best.
    fn above(&mut self, ground: &Position, slot: Slot) -> Point3<f64> {
        self.solver.above(&self.table, ground, &slot.uav(), &self.ids)
    }

    /// The plan to serve `self.ids` from a solved waypoint.
    fn plan_to_serve(&self, waypoint: &Waypoint, slot: Slot) -> Plan {
        let ground = self.table.into_area(&waypoint.point.xy());
        let waypoint = Waypoint { point: Point3::new(ground.x, ground.y, waypoint.point.z), ..*waypoint };
        self.plan(&waypoint, Mode::Serve, slot)
    }

    /// The baselines and transit: a ground position by rule, the fullest queues in range of it, and the altitude that
    /// serves them best.
    fn fly_then_schedule(&mut self, waypoint: &Position, mode: Mode, slot: Slot) -> Plan {
        let ground = self.table.into_area(waypoint);
        serve_fullest(&self.table, &ground, slot.queues_bits, &mut self.ids);
        let point = self.above(&ground, slot);
        self.plan(&Waypoint { point, outcome: SolverOutcome::Rule }, mode, slot)
    }

    /// The plan to fly to `waypoint` and serve `self.ids`, which are ascending.
    fn plan(&self, waypoint: &Waypoint, mode: Mode, slot: Slot) -> Plan {
        let point = &waypoint.point;
        let mut plan = Plan::fly_to(point.x, point.y, point.z, mode);
        plan.schedule(&self.ids);
        plan.solver = waypoint.outcome.code();
        plan.expected_bits = self.table.expected_bits(point, &self.ids, slot.queues_bits);
        plan
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::WaypointSolver;
    use skysink_common::message::NOBODY;
    use skysink_common::scenario::Overrides;
    use skysink_common::sensors::SensorList;

    /// A planner over the letter's scenario with the SNs at `places_m` [m], gain −52 dB, and a top speed.
    fn planner_of(strategy: Strategy, places_m: &[[f64; 2]], max_speed_mps: f64) -> Planner {
        let overrides = Overrides { strategy: Some(strategy.name()), ..Overrides::default() };
        let mut scenario = Scenario::letter(overrides).unwrap();
        scenario.uav.max_speed_mps = max_speed_mps;
        let sensor = |&[x_m, y_m]: &[f64; 2]| SensorNode { x_m, y_m, gain: 10f64.powf(-5.2), ..SensorNode::default() };
        Planner::new(&scenario, &places_m.iter().map(sensor).collect::<Vec<_>>()).unwrap()
    }

    fn middle() -> Position {
        Position::new(50.0, 50.0)
    }

    #[test]
    #[should_panic(expected = "expected one queue per sensor node")]
    fn queues_of_another_field_are_refused() {
        let _ = planner_of(Strategy::Uts, &[[50.0, 50.0]], 30.0).step(1, &middle(), 20.0, &[1, 2]);
    }

    #[test]
    fn the_letters_plan_shows_how_it_came_about() {
        // Two SNs 12 m apart: C1 to C5 as in the search's own test; equal gains, so that the middle is the waypoint.
        let plan = planner_of(Strategy::Uts, &[[56.0, 50.0], [44.0, 50.0]], 30.0).step(1, &middle(), 20.0, &[700, 800]);
        assert!((Position::new(plan.x_m, plan.y_m) - middle()).norm() < 1e-12);
        assert_eq!((plan.z_m, plan.expected_bits, plan.plan_ns), (20.0, 1_500, 0));
        assert_eq!((plan.anchor, plan.partner, plan.chosen), (0, 1, 0));
        assert_eq!(plan.circles_m, [[50.0, 58.0], [50.0, 42.0], [54.0, 50.0], [46.0, 50.0], [50.0, 50.0]]);
        assert_eq!((plan.mode, plan.solver), (Mode::Serve.code(), SolverOutcome::Solved.code()));
        assert_eq!(plan.scheduled(), [0, 1]);
    }

    #[test]
    fn an_anchor_alone_has_neither_partner_nor_circles() {
        let plan = planner_of(Strategy::Uts, &[[50.0, 60.0]], 30.0).step(1, &middle(), 20.0, &[700]);
        assert_eq!((plan.anchor, plan.partner, plan.chosen), (0, NOBODY, NOBODY));
        assert!(plan.circles_m.iter().flatten().all(|coordinate| coordinate.is_nan()));
        assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (50.0, 60.0, &[0][..]));
    }

    #[test]
    fn without_an_anchor_the_uav_is_in_transit_and_serves_what_it_meets() {
        // The fullest queue is 50 m away, (30, 40): 30 m of that are (18, 24). SN 1 is no anchor
        // (24² + 16² = 28.8²), but it is exactly in range of the waypoint, 6² + 8² = 10².
        let mut planner = planner_of(Strategy::Uts, &[[80.0, 90.0], [74.0, 66.0], [0.0, 0.0]], 30.0);
        let plan = planner.step(1, &middle(), 20.0, &[900, 30, 800]);
        assert!((Position::new(plan.x_m, plan.y_m) - Position::new(68.0, 74.0)).norm() < 1e-12);
        assert_eq!((plan.mode, plan.solver), (Mode::Transit.code(), SolverOutcome::Rule.code()));
        assert_eq!((plan.scheduled(), plan.expected_bits, plan.anchor), (&[1][..], 30, NOBODY));
    }

    #[test]
    fn a_set_that_cannot_be_reached_together_is_replaced_by_transit() {
        // V τ = 5 m is below d_c = 10 m. Anchor 0 is 5 m away and its partner 1 another 19 m: nowhere within 5 m of the
        // UAV is in range of SN 1 (24 − 5 = 19 m), so the UAV flies 5 m toward SN 1 and serves SN 0 from there.
        for solver in [WaypointSolver::Geometric, WaypointSolver::Clarabel] {
            let mut planner = planner_of(Strategy::Uts, &[[55.0, 50.0], [74.0, 50.0]], 5.0);
            let settings = Settings { waypoint_solver: solver, ..planner.settings };
            planner.solver = Solver::new(&planner.scenario, &settings, &planner.table);
            let plan = planner.step(1, &middle(), 20.0, &[10, 100]);
            assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (55.0, 50.0, &[0][..]), "{solver:?}");
            assert_eq!((plan.mode, plan.anchor), (Mode::Transit.code(), NOBODY), "{solver:?}");
        }
    }

    #[test]
    fn a_wide_plan_leaves_out_the_circles_beyond_reach() {
        // As in the search's own test: only C2 = (50, 72) and C5 = (50, 80) are within 30 m. The waypoint, the middle
        // of the pair, is exactly in reach.
        let plan =
            planner_of(Strategy::UtsWide, &[[56.0, 80.0], [44.0, 80.0]], 30.0).step(1, &middle(), 20.0, &[700, 800]);
        assert!((Position::new(plan.x_m, plan.y_m) - Position::new(50.0, 80.0)).norm() < 1e-12);
        assert_eq!((plan.anchor, plan.partner, plan.chosen, plan.scheduled()), (0, 1, 1, &[0, 1][..]));
        assert_eq!(plan.circles_m.map(|[x_m, y_m]| x_m.is_nan() && y_m.is_nan()), [true, false, true, true, false]);
        assert_eq!((plan.circles_m[1], plan.circles_m[4]), ([50.0, 72.0], [50.0, 80.0]));
    }

    #[test]
    fn an_exact_plan_names_no_anchor_and_no_circle() {
        // 40 m away, V τ + d_c: served from the one point in reach that has it in range.
        let plan = planner_of(Strategy::Exact, &[[50.0, 90.0]], 30.0).step(1, &middle(), 20.0, &[700]);
        assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (50.0, 80.0, &[0][..]));
        assert_eq!((plan.mode, plan.solver), (Mode::Serve.code(), SolverOutcome::Solved.code()));
        assert_eq!((plan.anchor, plan.partner, plan.chosen), (NOBODY, NOBODY, NOBODY));
        assert!(plan.circles_m.iter().flatten().all(|coordinate| coordinate.is_nan()));
    }

    #[test]
    fn an_exact_plan_without_anybody_in_range_of_reach_is_transit() {
        let plan = planner_of(Strategy::Exact, &[[50.0, 91.0]], 30.0).step(1, &middle(), 20.0, &[700]);
        assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (50.0, 80.0, &[][..]));
        assert_eq!((plan.mode, plan.solver), (Mode::Transit.code(), SolverOutcome::Rule.code()));
    }

    #[test]
    fn a_set_that_only_the_slack_holds_together_is_served_from_where_it_was_found_and_says_so() {
        // SNs 0, 1, 2 surround (50, 50). SN 0 is exactly 10 m away, the others 0.9e-9 farther: decision D5 serves them
        // from there, but the three circles leave a gap, and where two of them cross, the third SN is out of range. The
        // crossing with SN 3's circle, exactly 10 m away, too, is at (50, 50).
        let slack = 1.0 + 0.9e-9;
        let at = |[x_m, y_m]: [f64; 2]| [50.0 + x_m * slack, 50.0 + y_m * slack];
        let diagonal_m = 50f64.sqrt();
        let places = [[50.0, 40.0], at([6.0, 8.0]), at([-8.0, 6.0]), [50.0 - diagonal_m, 50.0 + diagonal_m]];
        for solver in [WaypointSolver::Geometric, WaypointSolver::Clarabel] {
            let mut planner = planner_of(Strategy::Exact, &places, 30.0);
            planner.table.resource_blocks = 3;
            let settings = Settings { waypoint_solver: solver, ..planner.settings };
            planner.solver = Solver::new(&planner.scenario, &settings, &planner.table);
            let plan = planner.step(1, &Position::new(56.0, 60.0), 20.0, &[900, 950, 800, 700]);
            assert_eq!((plan.scheduled(), plan.mode), (&[0, 1, 2][..], Mode::Serve.code()), "{solver:?}");
            assert_eq!(plan.solver, SolverOutcome::Fallback.code(), "{solver:?}");
            assert!((Position::new(plan.x_m, plan.y_m) - middle()).norm() < 1e-9, "{solver:?}");
        }
    }

    #[test]
    fn greedy_flight_serves_what_is_in_range_of_its_goal_and_else_is_in_transit() {
        let places = [[50.0, 70.0], [55.0, 70.0], [50.0, 59.0], [50.0, 99.0]];
        let mut planner = planner_of(Strategy::Gfs, &places, 30.0);
        let plan = planner.step(1, &middle(), 20.0, &[80, 70, 60, 90]);
        assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (50.0, 70.0, &[0, 1][..]));
        assert_eq!((plan.mode, plan.solver), (Mode::Serve.code(), SolverOutcome::Rule.code()));
        let plan = planner.step(2, &Position::new(50.0, 0.0), 20.0, &[80, 70, 60, 90]);
        assert_eq!((plan.x_m, plan.y_m, plan.mode), (50.0, 30.0, Mode::Transit.code()));
    }

    #[test]
    fn random_flight_serves_nobody_where_nobody_is() {
        let plan = planner_of(Strategy::Rfs, &[[99.0, 99.0]], 30.0).step(1, &middle(), 20.0, &[80]);
        assert_eq!((plan.scheduled(), plan.mode), (&[][..], Mode::Serve.code()));
        assert_eq!((plan.anchor, plan.expected_bits), (NOBODY, 0));
    }

    /// Four slots of the letter's mission, at a top speed, without arrivals, queues emptied where they are served:
    /// waypoint [m] and schedule.
    fn trace_of(strategy: Strategy, max_speed_mps: f64) -> Vec<String> {
        let mut scenario =
            Scenario::letter(Overrides { strategy: Some(strategy.name()), ..Overrides::default() }).unwrap();
        scenario.uav.max_speed_mps = max_speed_mps;
        let list = SensorList::of(&scenario).unwrap();
        let mut planner = Planner::new(&scenario, &list.nodes(scenario.sensors.capacity_bits)).unwrap();
        let (mut position, mut queues_bits) = (scenario.uav.start, list.queues_bits());
        let fly = |slot| {
            let plan = planner.step(slot, &position, 20.0, &queues_bits);
            position = Position::new(plan.x_m, plan.y_m);
            plan.scheduled().iter().for_each(|&id| queues_bits[id as usize] = 0);
            format!("{:.3} {:.3} {:?}", plan.x_m, plan.y_m, plan.scheduled())
        };
        (1..=4).map(fly).collect()
    }

    #[test]
    fn the_letters_mission_stays_what_it_is() {
        let expected = [
            "49.282 69.589 [10, 53, 73, 115]",
            "76.835 70.328 [43, 93, 124, 186]",
            "68.056 89.593 [4, 74, 89, 174]",
            "65.173 78.760 [71, 87, 134, 151]",
        ];
        assert_eq!(trace_of(Strategy::Uts, 30.0), expected);
    }

    #[test]
    fn the_wide_mission_stays_what_it_is() {
        let expected = [
            "36.394 56.314 [23, 53, 84, 102]",
            "45.979 62.593 [6, 73, 115, 180]",
            "53.477 75.585 [10, 24, 87, 109]",
            "61.198 85.026 [71, 74, 165, 174]",
        ];
        assert_eq!(trace_of(Strategy::UtsWide, 15.0), expected);
    }

    #[test]
    fn the_exact_mission_stays_what_it_is() {
        let expected = [
            "46.006 62.602 [53, 73, 115, 180]",
            "59.073 69.968 [10, 43, 87, 151]",
            "73.992 71.526 [74, 93, 124, 186]",
            "64.033 82.743 [24, 71, 134, 174]",
        ];
        assert_eq!(trace_of(Strategy::Exact, 15.0), expected);
    }
}
