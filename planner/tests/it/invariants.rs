//! What every plan keeps, whatever the field: range, reach, area, a proper schedule, and no memory of other slots.

use std::cell::RefCell;
use std::path::Path;

use proptest::prelude::{Strategy as Generator, *};
use proptest::test_runner::TestRunner;
use skysink_common::channel::{Channel, ChannelModel, Uplink};
use skysink_common::geometry::{Position, above, within};
use skysink_common::ledger::{Ledger, Totals};
use skysink_common::message::{FlightReport, LinkReport, Mode, NOBODY, Plan, SensorNode, SolverOutcome};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::Sensors;
use skysink_planner::Planner;
use skysink_planner::settings::{WaypointSolver, change};
use skysink_planner::strategies::names;
use skysink_planner::strategies::stateless;

/// Slots of each mission.
const SLOTS: u64 = 8;

/// What the buffer of each SN holds.
const CAPACITY_BITS: u32 = 30_000;

/// One slot to plan.
#[derive(Debug, Clone)]
struct Slot {
    position: Position,
    queues_bits: Vec<u32>,
}

/// A field, its limits, and some slots over it.
#[derive(Debug, Clone)]
struct Case {
    scenario: Scenario,
    sensors: Vec<SensorNode>,
    slots: Vec<Slot>,
}

impl Case {
    /// The plan of slot `index` by a planner that has planned nothing before.
    fn fresh_plan(&self, index: usize) -> Plan {
        let slot = &self.slots[index];
        Planner::new(&self.scenario, &self.sensors).unwrap().step(
            index as u64 + 1,
            above(&slot.position, 20.0),
            &slot.queues_bits,
        )
    }

    /// The plan of slot `index` by `strategy`, and the queues [bit] that it schedules.
    fn plan_by(&self, strategy: &'static str, index: usize) -> (Plan, u64) {
        let mut case = self.clone();
        strategy.clone_into(&mut case.scenario.planner.strategy);
        let plan = case.fresh_plan(index);
        let queue_bits = |&id: &u32| u64::from(self.slots[index].queues_bits[id as usize]);
        let sum_bits = plan.scheduled().iter().map(queue_bits).sum();
        (plan, sum_bits)
    }
}

/// Coordinates [m] in an area of 60 m: anywhere, on its border, or on a lattice that makes SNs touch and coincide.
fn coordinates() -> impl Generator<Value = f64> {
    prop_oneof![3 => 0.0..60.0, 2 => (0u32..=12).prop_map(|step| f64::from(step) * 5.0)]
}

fn places() -> impl Generator<Value = [f64; 2]> {
    [coordinates(), coordinates()]
}

/// Queues [bit] of which many tie or are empty.
fn queues(sensors: usize) -> impl Generator<Value = Vec<u32>> {
    prop::collection::vec(prop_oneof![0u32..4, 0u32..CAPACITY_BITS], sensors)
}

fn scenario_of(strategy: &'static str, solver: WaypointSolver, reach_m: f64, blocks: u64, iterations: u32) -> Scenario {
    let text = format!(
        "name = 'case'\nslots = {SLOTS}\n[area]\nside_m = 60.0\n[uav]\nmax_speed_mps = {reach_m}\n[link]\n\
         bandwidth_hz = 5e3\nresource_blocks = {blocks}\n[sensors]\ncapacity_bits = {CAPACITY_BITS}\n[planner]\n\
         sca_iterations = {iterations}\n[planner.horizon]\niterations = 10\n[planner.offline]\nsteps = 100\n"
    );
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    let scenario = Scenario::parse(&text, Path::new("case.toml"), overrides).unwrap();
    change(scenario, |settings| settings.waypoint_solver = solver).unwrap()
}

fn cases(strategies: &[&'static str]) -> impl Generator<Value = Case> {
    let scenario = (
        prop::sample::select(strategies.to_vec()),
        prop_oneof![Just(WaypointSolver::Geometric), Just(WaypointSolver::Clarabel)],
        prop_oneof![Just(30.0), Just(20.0), Just(10.0), 1.0..60.0],
        prop_oneof![1u64..=6, Just(64)],
        prop_oneof![Just(1u32), 2u32..6],
    );
    let scenario = scenario.prop_map(|(strategy, solver, reach_m, blocks, iterations)| {
        scenario_of(strategy, solver, reach_m, blocks, iterations)
    });
    let rates = prop_oneof![1 => Just(0.0), 1 => Just(7_000.0), 2 => 100.0..15_000.0];
    let sensors = prop::collection::vec((places(), -55.0..-50.0, rates), 1..40);
    (scenario, sensors).prop_flat_map(|(scenario, sensors)| {
        let node = |([x_m, y_m], gain_db, sampling_bps): ([f64; 2], f64, f64)| SensorNode {
            x_m,
            y_m,
            gain: 10f64.powf(gain_db / 10.0),
            sampling_bps,
            capacity_bits: CAPACITY_BITS,
            ..SensorNode::default()
        };
        let sensors: Vec<SensorNode> = sensors.into_iter().map(node).collect();
        let slot = (places(), queues(sensors.len()))
            .prop_map(|(position, queues_bits)| Slot { position: position.into(), queues_bits });
        prop::collection::vec(slot, 1..6).prop_map(move |slots| Case {
            scenario: scenario.clone(),
            sensors: sensors.clone(),
            slots,
        })
    })
}

fn place(case: &Case, id: u32) -> Position {
    let sensor = &case.sensors[id as usize];
    Position::new(sensor.x_m, sensor.y_m)
}

/// Flies the mission of `case` from its first slot's position and queues, and says what came of it. Each plan keeps
/// range, reach and area.
fn flown(case: &Case) -> Result<Totals, TestCaseError> {
    let Case { scenario, sensors, slots } = case;
    let mut planner = Planner::new(scenario, sensors).unwrap();
    let channel = Channel::of(&scenario.link);
    let mut ledger = Ledger::new(Sensors::of(scenario, sensors).sampling, slots[0].queues_bits.clone());
    let mut report = FlightReport::at([slots[0].position.x, slots[0].position.y, 20.0], Mode::Hold);
    for number in 1..=SLOTS {
        let position = report.position().xy();
        planner.observe(number - 1, &report, ledger.queues_bits());
        let plan = planner.step(number, report.position(), ledger.queues_bits());
        let waypoint = Position::new(plan.x_m, plan.y_m);
        let in_reach = within(&waypoint, &position, scenario.reach_m());
        prop_assert!(in_reach, "slot {number}: reach, {waypoint}");
        prop_assert!(scenario.area.contains(&waypoint, 0.0), "slot {number}: area, {waypoint}");
        let ids = plan.scheduled();
        prop_assert!(ids.len() <= scenario.link.resource_blocks, "slot {number}: {ids:?}");
        prop_assert!(ids.is_sorted_by(|a, b| a < b), "slot {number}: ascending and unique, {ids:?}");
        for &id in ids {
            let planned_m = scenario.link.comm_radius_m - scenario.uav.waypoint_margin_m.unwrap_or_default();
            let in_range = within(&place(case, id), &waypoint, planned_m);
            prop_assert!(in_range, "slot {number}: SN {id}, {waypoint}");
        }
        let queued_bits: u64 = ids.iter().map(|&id| u64::from(ledger.queues_bits()[id as usize])).sum();
        prop_assert!(plan.expected_bits <= queued_bits, "slot {number}: {} bits", plan.expected_bits);
        prop_assert_eq!((plan.z_m, plan.plan_ns), (20.0, 0));

        let _ = ledger.sample(number);
        report = FlightReport::at([waypoint.x, waypoint.y, 20.0], Mode::Serve);
        report.served = plan.served;
        let before_bits = ledger.totals().delivered_bits;
        for (&id, link) in ids.iter().zip(&mut report.links) {
            let uplink = Uplink::new(sensors[id as usize].gain, &place(case, id), &above(&waypoint, 20.0));
            let capacity_bits = channel.capacity_bits(channel.expected_rate_bps(&uplink));
            *link = LinkReport { sensor: id, capacity_bits, ..LinkReport::default() };
            let _ = ledger.upload(id as usize, capacity_bits);
        }
        let delivered_bits = ledger.totals().delivered_bits - before_bits;
        prop_assert!(delivered_bits >= plan.expected_bits, "slot {number}: {delivered_bits} bits");
    }
    Ok(ledger.totals())
}

#[test]
fn plans_respect_range_reach_area_and_resource_blocks() {
    for strategy in names() {
        let cases_each = if ["horizon", "offline"].contains(&strategy) { 8 } else { 20 };
        let mut runner = TestRunner::new(ProptestConfig {
            failure_persistence: None,
            ..ProptestConfig::with_cases(cases_each * crate::CASES_FACTOR)
        });
        let sums = RefCell::new([0; 2]);
        runner
            .run(&(cases(&[strategy]), prop::option::of(0.0..4.0)), |(mut case, margin_m)| {
                case.scenario.uav.waypoint_margin_m = margin_m;
                let totals = flown(&case)?;
                let [delivered_bits, lost_bits] = &mut *sums.borrow_mut();
                *delivered_bits += totals.delivered_bits;
                *lost_bits += totals.lost_bits;
                Ok(())
            })
            .unwrap_or_else(|error| panic!("{strategy}: {error}"));
        let [delivered_bits, lost_bits] = sums.into_inner();
        assert!(delivered_bits > 0 && lost_bits > 0, "{strategy}: {delivered_bits} collected, {lost_bits} lost");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200 * crate::CASES_FACTOR))]

    #[test]
    fn a_uts_plan_serves_its_anchor_and_partner_from_a_solved_waypoint(case in cases(&["uts"])) {
        let plan = case.fresh_plan(0);
        let rule = plan.solver == SolverOutcome::Rule as u32;
        if plan.mode == Mode::Transit as u32 {
            prop_assert!(rule && plan.anchor == NOBODY && plan.partner == NOBODY && plan.chosen == NOBODY);
        } else {
            prop_assert!(!rule && plan.scheduled().contains(&plan.anchor));
            prop_assert_eq!(plan.partner == NOBODY, plan.scheduled().len() == 1);
            prop_assert_eq!(plan.partner == NOBODY, plan.circles_m.iter().flatten().any(|x_m| x_m.is_nan()));
            prop_assert!(plan.partner == NOBODY || plan.scheduled().contains(&plan.partner) && plan.chosen < 5);
        }
    }

    #[test]
    fn a_wide_plan_reports_its_circles_and_serves_from_one_of_them(case in cases(&["uts-wide"])) {
        let plan = case.fresh_plan(0);
        if plan.mode == Mode::Serve as u32 {
            prop_assert!(plan.solver != SolverOutcome::Rule as u32 && plan.scheduled().contains(&plan.anchor));
            prop_assert_eq!(plan.partner == NOBODY, plan.scheduled().len() == 1);
            prop_assert_eq!(plan.partner == NOBODY, plan.circles_m.iter().all(|[x_m, _]| x_m.is_nan()));
            prop_assert_eq!(plan.partner == NOBODY, plan.chosen == NOBODY);
            prop_assert!(plan.partner == NOBODY || !plan.circles_m[plan.chosen as usize][0].is_nan());
            for circle in plan.circles_m.into_iter().filter(|[x_m, _]| !x_m.is_nan()).map(Position::from) {
                prop_assert!(within(&circle, &case.slots[0].position, case.scenario.reach_m()), "{circle}");
            }
        }
    }

    #[test]
    fn exact_and_wide_plans_serve_if_any_sensor_node_can_be_served(
        case in cases(&["uts-wide", "exact"]),
    ) {
        let in_sight_m = case.scenario.reach_m() + case.scenario.link.comm_radius_m;
        let in_sight = |id: u32| within(&place(&case, id), &case.slots[0].position, in_sight_m);
        let anybody = (0..).zip(&case.sensors).any(|(id, _)| in_sight(id));
        let plan = case.fresh_plan(0);
        prop_assert_eq!(plan.mode, if anybody { Mode::Serve } else { Mode::Transit } as u32);
        prop_assert_eq!(plan.solver == SolverOutcome::Rule as u32, !anybody);
    }

    /// Where reach exceeds range, the letter's anchors are among the wide ones and all their circles in reach. Where it
    /// does not, no such thing holds: see the search's own tests.
    #[test]
    fn wide_plans_schedule_no_less_than_uts_plans_where_reach_exceeds_range(
        mut case in cases(&["uts"]),
        reach_m in prop_oneof![Just(10.5), Just(20.0), 10.5..40.0],
    ) {
        case.scenario.uav.max_speed_mps = reach_m; // slots of 1 s
        for index in 0..case.slots.len() {
            let (letter, letter_bits) = case.plan_by("uts", index);
            let (wide, wide_bits) = case.plan_by("uts-wide", index);
            if letter.mode == Mode::Serve as u32 {
                prop_assert_eq!(wide.mode, letter.mode);
                prop_assert!(wide_bits >= letter_bits, "slot {}: {} < {}", index + 1, wide_bits, letter_bits);
            }
        }
    }

    #[test]
    fn a_plan_does_not_depend_on_the_slots_planned_before(case in cases(&stateless())) {
        let mut planner = Planner::new(&case.scenario, &case.sensors).unwrap();
        for (index, slot) in case.slots.iter().enumerate() {
            let plan = planner.step(index as u64 + 1, above(&slot.position, 20.0), &slot.queues_bits);
            // As text, which tells every f64 apart and lets NaN equal NaN.
            prop_assert_eq!(format!("{plan:?}"), format!("{:?}", case.fresh_plan(index)));
        }
    }

    #[test]
    fn every_anchor_is_served_where_reach_exceeds_range(
        mut case in cases(&["uts"]),
        reach_m in prop_oneof![Just(10.5), Just(20.0), 10.5..40.0],
    ) {
        case.scenario.uav.max_speed_mps = reach_m; // slots of 1 s
        let slot = &case.slots[0];
        let is_anchor = |id: u32| within(&place(&case, id), &slot.position, reach_m - 10.0);
        let anchored = (0..).zip(&case.sensors).any(|(id, _)| is_anchor(id));
        prop_assert_eq!(case.fresh_plan(0).mode == Mode::Serve as u32, anchored);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10 * crate::CASES_FACTOR))]

    /// Whatever another strategy schedules is in range of its waypoint, which is in reach: a set that the exact search
    /// compares with its own.
    #[test]
    fn no_plan_schedules_more_than_the_exact_one(case in cases(&["exact"])) {
        for index in 0..case.slots.len() {
            let (exact, most_bits) = case.plan_by("exact", index);
            prop_assert!(exact.anchor == NOBODY && exact.partner == NOBODY && exact.chosen == NOBODY);
            prop_assert!(exact.circles_m.iter().flatten().all(|coordinate| coordinate.is_nan()));
            for strategy in names() {
                let (_, sum_bits) = case.plan_by(strategy, index);
                prop_assert!(sum_bits <= most_bits, "{} in slot {}: {}", strategy, index + 1, sum_bits);
            }
        }
    }
}
