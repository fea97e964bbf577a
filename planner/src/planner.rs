//! One slot of planning: the known or estimated queues, the strategy's decision, and the message.
//!
//! Decisions are left to [`crate::strategies`], what the UAV believes to [`skysink_common::belief`].

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::battery::BatteryState;
use skysink_common::belief::{Belief, Believed};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode_first, encode};
use skysink_common::estimate::SavedEstimate;
use skysink_common::geometry::above;
use skysink_common::message::{FlightReport, MAX_PATH_POINTS, Mode, Plan};
use skysink_common::nodes::Answer;
use skysink_common::reported::ReportedQueues;
use skysink_common::stop::Stop;
use skysink_common::told::{Heard, Received, Told};

use crate::mission_table::MissionTable;
use crate::neighbours::{Neighbours, PlannedVisit};
use crate::rules::{Duty, RuleBook, Ruled};
use crate::strategy::{Decision, Setup, Strategy, Timing, View};

/// The planner of a mission.
///
/// Its checkpoint holds the state of the strategy and the estimate of the queues; the rest is rebuilt from the scenario
/// and the sensor nodes. With known queues most strategies are stateless: a plan does not depend on the slots before.
pub struct Planner {
    /// The name in the scenario.
    pub(crate) strategy_name: String,
    pub(crate) table: MissionTable,
    pub(crate) strategy: Box<dyn Strategy>,
    rules: RuleBook,
    /// Of the queues after the last observed slot.
    pub(crate) belief: Belief,
    /// After the last observed flight.
    battery: BatteryState,
    /// The queues that the SNs of the last plan report if they are served.
    reported: ReportedQueues,
    pub(crate) timing: Timing,
    /// Ends long searches.
    pub(crate) stop: Stop,
    /// The last planned slot; 0 before the first.
    slot: u64,
    /// What this UAV has received before the slot to plan.
    heard: Heard,
    /// The waypoints of the last plan.
    path: Vec<Point3<f64>>,
    room: Room,
}

/// Working memory of what is believed.
#[derive(Default)]
struct Room {
    /// The queues without those that other UAVs have scheduled [bit].
    left_bits: Vec<u32>,
    /// What is known of the answers.
    answers: Vec<Answer>,
}

/// Time between the visits of an SN that another UAV is expected to serve, as a fraction of that in which its buffer
/// fills.
const CLAIMED_FILL: f64 = 0.5;

/// Most visits, about, that are expected of an SN.
const MOST_CLAIMED: u64 = 64;

/// Beginning of a checkpoint; the state of the strategy follows.
#[derive(Serialize, Deserialize)]
struct Head {
    slot: u64,
    strategy: String,
    reported: ReportedQueues,
    estimate: Option<SavedEstimate>,
}

impl Planner {
    /// The planner of this setup, with this strategy.
    pub(crate) fn with(setup: &Setup<'_>, strategy: Box<dyn Strategy>) -> Self {
        let Setup { scenario, table, belief, stop, .. } = *setup;
        Self {
            strategy,
            rules: RuleBook::new(setup),
            strategy_name: scenario.planner.strategy.clone(),
            belief: belief.clone(),
            battery: BatteryState::initial(scenario),
            reported: ReportedQueues::default(),
            timing: Timing::Free,
            stop: stop.clone(),
            slot: 0,
            heard: Heard::of(scenario),
            path: Vec::with_capacity(MAX_PATH_POINTS),
            room: Room::default(),
            table: table.clone(),
        }
    }

    /// Begins a simulation at what `view` sees.
    pub(crate) fn begin_at(&mut self, view: &View<'_>) {
        self.belief = view.belief.belief.clone();
        self.battery = view.battery;
        self.reported = ReportedQueues::default();
        self.heard.clone_from(view.heard);
        self.stop = view.stop.clone();
    }

    /// Observes the flight of `slot`, and what is told after it. Must be called for every slot before the next is
    /// planned. If the queues are estimated, only what is told of served SNs is read, and a skipped slot only makes the
    /// estimate older.
    pub fn observe<'t>(&mut self, slot: u64, flight: &FlightReport, told: impl Into<Told<'t>>) {
        self.observe_with(slot, flight, std::slice::from_ref(flight), told.into());
    }

    /// Takes in what this UAV, number `uav`, receives at the end of a slot, before that is observed; `number` is that
    /// of an SN of its own.
    pub(crate) fn receive(&mut self, received: &Received<'_>, uav: usize, number: impl Fn(u32) -> Option<u32>) {
        let count = self.table.sensors.count();
        self.heard.receive(received, uav, |id| number(id).filter(|number| (*number as usize) < count));
    }

    /// The same with the contacts of all `flights`, of which `flight` is that of this UAV.
    pub(crate) fn observe_with(&mut self, slot: u64, flight: &FlightReport, flights: &[FlightReport], told: Told<'_>) {
        self.belief.advance(slot, flights, &self.reported, told);
        self.battery = BatteryState::from(flight);
        self.strategy.observe(slot, flights, &self.belief);
    }

    /// Plans `slot` from the position of the UAV, `L_u(t−1)` [m], and what is `told` before it: the queues `B_i(t−1)`
    /// [bit], and the answers of SNs that may refuse. If the queues are estimated, the plan is based on the estimate,
    /// and queues are read only of the scheduled SNs, which report them on contact.
    ///
    /// Takes time by the number of SNs near the UAV. Transit, an estimate, and the strategies `edf`, `mes`, `whittle`,
    /// `max-age-first`, `horizon` and `offline` read all queues. `plan_ns` stays 0; the caller measures. A clock is
    /// read only with [`Timing::Paced`].
    ///
    /// # Panics
    /// If there is not one queue per sensor node.
    #[must_use]
    pub fn step<'t>(&mut self, slot: u64, position: Point3<f64>, told: impl Into<Told<'t>>) -> Plan {
        self.plan(slot, position, told.into(), Duty::Mission, None)
    }

    /// The plan of a UAV with this duty beside other UAVs: the SNs that they have scheduled in this slot count as
    /// empty, and are not scheduled.
    pub(crate) fn plan(
        &mut self,
        slot: u64,
        position: Point3<f64>,
        told: Told<'_>,
        duty: Duty,
        neighbours: Option<&Neighbours<'_>>,
    ) -> Plan {
        self.plan_by(slot, position, told, duty, neighbours, |strategy, view| strategy.plan(view))
    }

    /// The same, decided by what `decide` makes of its strategy.
    pub(crate) fn plan_by(
        &mut self,
        slot: u64,
        position: Point3<f64>,
        told: Told<'_>,
        duty: Duty,
        neighbours: Option<&Neighbours<'_>>,
        mut decide: impl FnMut(&mut dyn Strategy, &View<'_>) -> Option<Decision>,
    ) -> Plan {
        let scheduled = neighbours.map_or(&[][..], |neighbours| neighbours.scheduled);
        assert_eq!(told.queues_bits.len(), self.table.sensors.positions.len(), "expected one queue per sensor node");
        let Self { strategy, rules, table, stop, room, heard, .. } = self;
        let belief = believed(&mut self.belief, slot, table, told, scheduled, room);
        let battery = self.battery;
        let timing = self.timing;
        let view = View { slot, position, battery, belief, table, timing, heard, neighbours, stop };
        let Ruled { decision, mode } = rules.decide(&view, duty, &mut |view| decide(&mut **strategy, view));
        let plan = message(&view, &decision, mode);
        self.path.clear();
        self.path.push(decision.waypoint);
        let most = MAX_PATH_POINTS - 1;
        match mode {
            _ if table.track.is_some() => {
                let later = table.track.iter().flat_map(|track| track.iter()).skip(slot as usize).take(most);
                self.path.extend(later.map(|at| Point3::from(*at)));
            }
            Mode::Serve => self.path.extend(strategy.path().iter().take(most)),
            Mode::Return => {
                let from = decision.waypoint.xy();
                let route = table.home.route(slot, &from).filter(|route| route.slots() > 0);
                let path = route.map(|route| table.airspace.way(&from, &route.end())).unwrap_or_default();
                self.path.extend(path.iter().take(most).map(|bend| above(bend, decision.waypoint.z)));
            }
            _ => {}
        }
        self.await_reports(slot, plan.scheduled(), told);
        self.slot = slot;
        plan
    }

    /// Appends what its strategy plans to serve from `slot` on ([`Strategy::visits`]), beside `neighbours` without
    /// intents.
    pub(crate) fn visits(
        &mut self,
        slot: u64,
        position: Point3<f64>,
        told: Told<'_>,
        neighbours: &Neighbours<'_>,
        into: &mut Vec<PlannedVisit>,
    ) {
        let Self { strategy, belief, table, stop, room, heard, .. } = self;
        let belief = believed(belief, slot, table, told, &[], room);
        let battery = self.battery;
        let timing = self.timing;
        let neighbours = Some(neighbours);
        strategy.visits(&View { slot, position, battery, belief, table, timing, heard, neighbours, stop }, into);
    }

    /// Visits that keep the SN `id` from losing data from `slot` on, as the plan of a UAV that is yet to be made.
    pub(crate) fn claimed_visits(&self, slot: u64, id: u32) -> impl Iterator<Item = PlannedVisit> {
        let last = self.table.limits.slots.max(slot);
        let gap = self.table.sensors.sampler(id).lossless_slots() * CLAIMED_FILL;
        let gap = (gap as u64).max((last - slot) / MOST_CLAIMED).max(1); // saturates where it never fills
        let slots = (slot..=last).step_by(usize::try_from(gap).unwrap_or(usize::MAX));
        slots.map(move |slot| PlannedVisit { slot, sensor: id, bits: f64::INFINITY })
    }

    /// Notes the SNs that report their queues in `slot` if they are served, and what is `told` before it.
    pub(crate) fn await_reports(&mut self, slot: u64, scheduled: &[u32], told: Told<'_>) {
        self.reported = self.belief.reported(slot, scheduled.iter().copied(), told);
    }

    /// The last slot planned by this planner or its restored predecessor; 0 before the first.
    pub fn slot(&self) -> u64 {
        self.slot
    }

    /// Whether the plan of a slot depends on the slots before it.
    pub fn has_state(&self) -> bool {
        let mut bytes = Vec::new();
        self.save(&mut bytes);
        !bytes.is_empty()
    }

    /// The waypoints of the last plan [m], that of its slot first; at most [`MAX_PATH_POINTS`], and more than one only
    /// from strategies that look ahead. On the way home its bends, and its end.
    pub fn path(&self) -> &[Point3<f64>] {
        &self.path
    }
}

impl Checkpoint for Planner {
    /// Appends nothing if the queues are known and the strategy is stateless.
    fn save(&self, bytes: &mut Vec<u8>) {
        let begin = bytes.len();
        let estimate = self.belief.saved();
        let is_stateless = estimate.is_none();
        let strategy = self.strategy_name.clone();
        encode(&Head { slot: self.slot, strategy, reported: self.reported.clone(), estimate }, bytes);
        let head = bytes.len();
        self.strategy.save(bytes);
        if is_stateless && bytes.len() == head {
            bytes.truncate(begin);
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        if bytes.is_empty() && !self.belief.is_estimated() {
            return self.strategy.restore(bytes);
        }
        let (Head { slot, strategy, reported, estimate }, state) = decode_first(bytes)?;
        CheckpointError::ensure(strategy == self.strategy_name, "this strategy")?;
        reported.check(slot, self.table.sensors.count())?;
        let belief = self.belief.restored(slot, estimate)?;
        self.strategy.restore(state)?;
        self.belief = belief;
        self.reported = reported;
        self.slot = slot;
        Ok(())
    }
}

/// What is believed before `slot`, in which SNs are as they are `told`. The queues of those that other UAVs have
/// scheduled, and of those that are known to be dead or silent, are empty.
fn believed<'a>(
    belief: &'a mut Belief,
    slot: u64,
    table: &'a MissionTable,
    told: Told<'a>,
    scheduled: &[u32],
    room: &'a mut Room,
) -> Believed<'a> {
    belief.predict(slot.saturating_sub(1));
    let belief = &*belief;
    let Room { left_bits, answers } = room;
    let answers = belief.answers(told.answers, answers);
    let known = Told::new(told.queues_bits, answers);
    let mut believed = belief.predicted(slot.saturating_sub(1), &table.sensors, known);
    if !scheduled.is_empty() || !answers.is_empty() {
        left_bits.clear();
        left_bits.extend_from_slice(believed.queues_bits);
        let refusing = left_bits.iter_mut().zip(answers).filter(|(_, answer)| !answer.sends());
        refusing.for_each(|(bits, _)| *bits = 0);
        scheduled.iter().for_each(|&id| left_bits[id as usize] = 0);
        believed.queues_bits = left_bits;
    }
    believed
}

fn message(view: &View, decision: &Decision, mode: Mode) -> Plan {
    let Decision { waypoint, schedule, outcome, winner } = decision;
    let mut plan = Plan::fly_to(*waypoint, mode);
    plan.schedule(schedule);
    plan.solver = *outcome as u32;
    plan.expected_bits = view.table.expected_bits(waypoint, schedule, view.belief.queues_bits);
    if let Some(winner) = winner {
        plan.anchor = winner.anchor;
        if let Some(pair) = winner.pair {
            plan.partner = pair.partner;
            plan.circles_m = pair.circles.map(|centre| centre.map_or([f64::NAN; 2], |centre| [centre.x, centre.y]));
            plan.chosen = pair.chosen;
        }
    }
    plan
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{self, WaypointSolver, change};
    use skysink_common::geometry::Position;
    use skysink_common::message::{NOBODY, SensorNode, SolverOutcome};
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::sensors::SensorList;

    /// A planner for the paper's scenario with SNs at `positions_m` [m], gain −52 dB, and a top speed.
    fn planner_of(strategy: &'static str, positions_m: &[[f64; 2]], max_speed_mps: f64) -> Planner {
        changed(strategy, positions_m, |scenario| scenario.uav.max_speed_mps = max_speed_mps)
    }

    /// The same with other changes.
    fn changed(strategy: &'static str, positions_m: &[[f64; 2]], adapt: impl Fn(&mut Scenario)) -> Planner {
        let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
        let mut scenario = Scenario::letter(overrides).and_then(settings::resolve).unwrap();
        adapt(&mut scenario);
        let sensor = |&[x_m, y_m]: &[f64; 2]| SensorNode { x_m, y_m, gain: 10f64.powf(-5.2), ..SensorNode::default() };
        Planner::new(&scenario, &positions_m.iter().map(sensor).collect::<Vec<_>>()).unwrap()
    }

    /// Over the middle of the area.
    fn here() -> Point3<f64> {
        above(&middle(), 20.0)
    }

    fn middle() -> Position {
        Position::new(50.0, 50.0)
    }

    #[test]
    #[should_panic(expected = "expected one queue per sensor node")]
    fn queues_of_another_field_are_refused() {
        let _ = planner_of("uts", &[[50.0, 50.0]], 30.0).step(1, here(), &[1, 2]);
    }

    #[test]
    fn a_plan_of_the_papers_strategy_reports_its_winning_circle() {
        // Two SNs 12 m apart: C1 to C5 as in the search's own test; equal gains, so that the middle is the waypoint.
        let plan = planner_of("uts", &[[56.0, 50.0], [44.0, 50.0]], 30.0).step(1, here(), &[700, 800]);
        assert!((Position::new(plan.x_m, plan.y_m) - middle()).norm() < 1e-12);
        assert_eq!((plan.z_m, plan.expected_bits, plan.plan_ns), (20.0, 1_500, 0));
        assert_eq!((plan.anchor, plan.partner, plan.chosen), (0, 1, 0));
        assert_eq!(plan.circles_m, [[50.0, 58.0], [50.0, 42.0], [54.0, 50.0], [46.0, 50.0], [50.0, 50.0]]);
        assert_eq!((plan.mode, plan.solver), (Mode::Serve as u32, SolverOutcome::Solved as u32));
        assert_eq!(plan.scheduled(), [0, 1]);
    }

    #[test]
    fn a_single_anchor_has_no_partner_and_no_circles() {
        let plan = planner_of("uts", &[[50.0, 60.0]], 30.0).step(1, here(), &[700]);
        assert_eq!((plan.anchor, plan.partner, plan.chosen), (0, NOBODY, NOBODY));
        assert!(plan.circles_m.iter().flatten().all(|coordinate| coordinate.is_nan()));
        assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (50.0, 60.0, &[0][..]));
    }

    #[test]
    fn a_uav_without_anchor_is_in_transit_and_serves_in_passing() {
        // The fullest queue is 50 m away, (30, 40): 30 m of that are (18, 24). SN 1 is no anchor
        // (24² + 16² = 28.8²), but it is exactly in range of the waypoint, 6² + 8² = 10².
        let mut planner = planner_of("uts", &[[80.0, 90.0], [74.0, 66.0], [0.0, 0.0]], 30.0);
        let plan = planner.step(1, here(), &[900, 30, 800]);
        assert!((Position::new(plan.x_m, plan.y_m) - Position::new(68.0, 74.0)).norm() < 1e-12);
        assert_eq!((plan.mode, plan.solver), (Mode::Transit as u32, SolverOutcome::Rule as u32));
        assert_eq!((plan.scheduled(), plan.expected_bits, plan.anchor), (&[1][..], 30, NOBODY));
    }

    #[test]
    fn an_unreachable_set_is_replaced_by_transit() {
        // V τ = 5 m is below d_c = 10 m. Anchor 0 is 5 m away and its partner 1 another 19 m: nowhere within 5 m of the
        // UAV is in range of SN 1 (24 − 5 = 19 m), so the UAV flies 5 m toward SN 1 and serves SN 0 from there.
        for solver in [WaypointSolver::Geometric, WaypointSolver::Clarabel] {
            let mut planner = changed("uts", &[[55.0, 50.0], [74.0, 50.0]], |scenario| {
                scenario.uav.max_speed_mps = 5.0;
                *scenario = change(scenario.clone(), |settings| settings.waypoint_solver = solver).unwrap();
            });
            let plan = planner.step(1, here(), &[10, 100]);
            assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (55.0, 50.0, &[0][..]), "{solver:?}");
            assert_eq!((plan.mode, plan.anchor), (Mode::Transit as u32, NOBODY), "{solver:?}");
        }
    }

    #[test]
    fn a_wide_plan_leaves_out_the_circles_beyond_reach() {
        // As in the search's own test: only C2 = (50, 72) and C5 = (50, 80) are within 30 m. The waypoint, the middle
        // of the pair, is exactly in reach.
        let plan = planner_of("uts-wide", &[[56.0, 80.0], [44.0, 80.0]], 30.0).step(1, here(), &[700, 800]);
        assert!((Position::new(plan.x_m, plan.y_m) - Position::new(50.0, 80.0)).norm() < 1e-12);
        assert_eq!((plan.anchor, plan.partner, plan.chosen, plan.scheduled()), (0, 1, 1, &[0, 1][..]));
        assert_eq!(plan.circles_m.map(|[x_m, y_m]| x_m.is_nan() && y_m.is_nan()), [true, false, true, true, false]);
        assert_eq!((plan.circles_m[1], plan.circles_m[4]), ([50.0, 72.0], [50.0, 80.0]));
    }

    #[test]
    fn an_exact_plan_has_no_anchor_and_no_circle() {
        // 40 m away, V τ + d_c: served from the one point in reach that has it in range.
        let plan = planner_of("exact", &[[50.0, 90.0]], 30.0).step(1, here(), &[700]);
        assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (50.0, 80.0, &[0][..]));
        assert_eq!((plan.mode, plan.solver), (Mode::Serve as u32, SolverOutcome::Solved as u32));
        assert_eq!((plan.anchor, plan.partner, plan.chosen), (NOBODY, NOBODY, NOBODY));
        assert!(plan.circles_m.iter().flatten().all(|coordinate| coordinate.is_nan()));
    }

    #[test]
    fn an_exact_plan_with_no_sensor_node_in_reach_is_transit() {
        let plan = planner_of("exact", &[[50.0, 91.0]], 30.0).step(1, here(), &[700]);
        assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (50.0, 80.0, &[][..]));
        assert_eq!((plan.mode, plan.solver), (Mode::Transit as u32, SolverOutcome::Rule as u32));
    }

    #[test]
    fn a_set_feasible_only_with_slack_is_served_from_its_centre_as_a_fallback() {
        // SNs 0, 1, 2 surround (50, 50). SN 0 is exactly 10 m away, the others 0.9e-9 farther: decision D5 serves them
        // from there, but the three circles leave a gap, and where two of them cross, the third SN is out of range. The
        // crossing with SN 3's circle, exactly 10 m away, too, is at (50, 50).
        let slack = 1.0 + 0.9e-9;
        let at = |[x_m, y_m]: [f64; 2]| [50.0 + x_m * slack, 50.0 + y_m * slack];
        let diagonal_m = 50f64.sqrt();
        let positions = [[50.0, 40.0], at([6.0, 8.0]), at([-8.0, 6.0]), [50.0 - diagonal_m, 50.0 + diagonal_m]];
        for solver in [WaypointSolver::Geometric, WaypointSolver::Clarabel] {
            let mut planner = changed("exact", &positions, |scenario| {
                scenario.link.resource_blocks = 3;
                *scenario = change(scenario.clone(), |settings| settings.waypoint_solver = solver).unwrap();
            });
            let plan = planner.step(1, above(&Position::new(56.0, 60.0), 20.0), &[900, 950, 800, 700]);
            assert_eq!((plan.scheduled(), plan.mode), (&[0, 1, 2][..], Mode::Serve as u32), "{solver:?}");
            assert_eq!(plan.solver, SolverOutcome::Fallback as u32, "{solver:?}");
            assert!((Position::new(plan.x_m, plan.y_m) - middle()).norm() < 1e-9, "{solver:?}");
        }
    }

    #[test]
    fn greedy_flight_serves_queues_in_range_of_its_goal_or_is_in_transit() {
        let positions = [[50.0, 70.0], [55.0, 70.0], [50.0, 59.0], [50.0, 99.0]];
        let mut planner = planner_of("gfs", &positions, 30.0);
        let plan = planner.step(1, here(), &[80, 70, 60, 90]);
        assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (50.0, 70.0, &[0, 1][..]));
        assert_eq!((plan.mode, plan.solver), (Mode::Serve as u32, SolverOutcome::Rule as u32));
        let plan = planner.step(2, above(&Position::new(50.0, 0.0), 20.0), &[80, 70, 60, 90]);
        assert_eq!((plan.x_m, plan.y_m, plan.mode), (50.0, 30.0, Mode::Transit as u32));
    }

    #[test]
    fn the_path_of_a_returning_uav_leads_home() {
        // A wall between the UAV and its base at (50, 50), and 17 slots for some 150 m at 10 m a slot.
        let overrides = Overrides { strategy: Some("gfs"), ..Overrides::default() };
        let text = "name = 'a'\nslots = 17\n[base]\nposition_m = [50.0, 50.0]\n[uav]\nmust_land = true\n\
                    max_speed_mps = 10.0\n[area]\nno_fly = [{ polygon_m = [[20, 60], [80, 60], [80, 62], [20, 62]] }]\n";
        let scenario = Scenario::parse(text, std::path::Path::new("a.toml"), overrides).and_then(settings::resolve);
        let mut planner = Planner::new(&scenario.unwrap(), &[]).unwrap();
        let ends = |planner: &Planner| planner.path().iter().map(|at| at.xy()).collect::<Vec<_>>();
        let plan = planner.step(11, above(&Position::new(50.0, 99.0), 20.0), &[]);
        let path = ends(&planner);
        assert_eq!((plan.mode, path.len()), (Mode::Return as u32, 4), "{path:?}");
        let corner = |at: Position, y_m| (at.x - 50.0).abs() >= 30.0 && (at - Position::new(at.x, y_m)).norm() < 1e-3;
        assert!(corner(path[1], 62.0) && corner(path[2], 60.0) && path[3] == middle(), "{path:?}");
        let plan = planner.step(1, above(&Position::new(50.0, 52.0), 20.0), &[]);
        assert_eq!((plan.mode == Mode::Return as u32, planner.path().len()), (false, 1));
    }

    #[test]
    fn random_flight_serves_no_sensor_node_out_of_range() {
        let plan = planner_of("rfs", &[[99.0, 99.0]], 30.0).step(1, here(), &[80]);
        assert_eq!((plan.scheduled(), plan.mode), (&[][..], Mode::Serve as u32));
        assert_eq!((plan.anchor, plan.expected_bits), (NOBODY, 0));
    }

    /// Four slots of the paper's mission, at a top speed, without arrivals, queues emptied where they are served:
    /// waypoint [m] and schedule.
    fn trace_of(strategy: &'static str, max_speed_mps: f64) -> Vec<String> {
        let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
        let mut scenario = Scenario::letter(overrides).and_then(settings::resolve).unwrap();
        scenario.uav.max_speed_mps = max_speed_mps;
        let list = SensorList::of(&scenario).unwrap();
        let mut planner = Planner::new(&scenario, &list.nodes()).unwrap();
        let mut position = scenario.start().xy();
        let mut queues_bits = list.queues_bits();
        let fly = |slot| {
            let plan = planner.step(slot, above(&position, 20.0), &queues_bits);
            position = Position::new(plan.x_m, plan.y_m);
            plan.scheduled().iter().for_each(|&id| queues_bits[id as usize] = 0);
            format!("{:.3} {:.3} {:?}", plan.x_m, plan.y_m, plan.scheduled())
        };
        (1..=4).map(fly).collect()
    }

    #[test]
    fn the_papers_mission_is_stable() {
        let expected = [
            "49.282 69.589 [10, 53, 73, 115]",
            "76.835 70.328 [43, 93, 124, 186]",
            "68.056 89.593 [4, 74, 89, 174]",
            "65.173 78.760 [71, 87, 134, 151]",
        ];
        assert_eq!(trace_of("uts", 30.0), expected);
    }

    #[test]
    fn the_wide_mission_is_stable() {
        let expected = [
            "36.394 56.314 [23, 53, 84, 102]",
            "45.979 62.593 [6, 73, 115, 180]",
            "53.477 75.585 [10, 24, 87, 109]",
            "61.198 85.026 [71, 74, 165, 174]",
        ];
        assert_eq!(trace_of("uts-wide", 15.0), expected);
    }

    #[test]
    fn the_exact_mission_is_stable() {
        let expected = [
            "46.006 62.602 [53, 73, 115, 180]",
            "59.073 69.968 [10, 43, 87, 151]",
            "73.992 71.526 [74, 93, 124, 186]",
            "64.033 82.743 [24, 71, 134, 174]",
        ];
        assert_eq!(trace_of("exact", 15.0), expected);
    }
}
