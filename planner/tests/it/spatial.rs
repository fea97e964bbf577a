//! Plans in three dimensions: their limits, worked by hand, and what every one of them keeps.

use std::path::Path;

use proptest::prelude::{Strategy as Generator, *};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use skysink_common::channel::{Channel, ChannelModel, LineOfSight, Uplink};
use skysink_common::geometry::{Position, above, distance_squared, within};
use skysink_common::message::{Mode, Plan, SensorNode, SolverOutcome};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_planner::Planner;
use skysink_planner::settings::{WaypointSolver, change};
use skysink_planner::strategies::names;

const SOLVERS: [WaypointSolver; 2] = [WaypointSolver::Geometric, WaypointSolver::Clarabel];

/// Free altitude from 20 to 120 m, starting at 60 m, 100 m in a slot: nothing but its ends limits it.
const FREE: &str = "altitude = 'free'\nmax_climb_mps = 100.0\naltitude_m = 60.0";

/// A field of 200 m in dense urban surroundings with `d_c` = 60 m, `V τ` = 30 m and slots of 1 s; `uav` and `link` are
/// more lines of these tables.
fn scenario(strategy: &'static str, solver: WaypointSolver, uav: &str, link: &str) -> Scenario {
    let text = format!(
        "name = 'case'\n[area]\nside_m = 200.0\n[uav]\n{uav}\n[link]\nmodel = 'probabilistic-los'\n\
         tx_power_w = 0.1\nnoise_dbm = -109.0\n{link}\n"
    );
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    let scenario = Scenario::parse(&text, Path::new("case.toml"), overrides).unwrap();
    change(scenario, |settings| settings.waypoint_solver = solver).unwrap()
}

/// As most tests want it.
fn dense_urban(strategy: &'static str, solver: WaypointSolver, uav: &str) -> Scenario {
    scenario(strategy, solver, uav, "environment = 'dense-urban'\ncomm_radius_m = 60.0\nbandwidth_hz = 1e5")
}

fn nodes(places_m: &[[f64; 2]]) -> Vec<SensorNode> {
    places_m.iter().map(|&[x_m, y_m]| SensorNode { x_m, y_m, gain: 1e-6, ..SensorNode::default() }).collect()
}

/// The plan for SNs with endless queues and the UAV above (100, 100).
fn plan(scenario: &Scenario, places_m: &[[f64; 2]], altitude_m: f64) -> Plan {
    let queues_bits = vec![u32::MAX; places_m.len()];
    Planner::new(scenario, &nodes(places_m)).unwrap().step(
        1,
        above(&Position::new(100.0, 100.0), altitude_m),
        &queues_bits,
    )
}

fn link_of(scenario: &Scenario) -> LineOfSight {
    Channel::of(&scenario.link).line_of_sight().unwrap().clone()
}

fn ground(plan: &Plan) -> Position {
    Position::new(plan.x_m, plan.y_m)
}

#[test]
fn a_lone_sensor_node_is_served_from_straight_above_at_the_lowest_altitude() {
    for solver in SOLVERS {
        for strategy in ["uts", "uts-wide", "exact", "gfs"] {
            let found = plan(&dense_urban(strategy, solver, FREE), &[[100.0, 100.0]], 60.0);
            assert_eq!((found.x_m, found.y_m, found.z_m), (100.0, 100.0, 20.0), "{strategy:?}, {solver:?}");
            let slow = dense_urban(strategy, solver, "altitude = 'free'\nmax_climb_mps = 2.5\naltitude_m = 60.0");
            let found = plan(&slow, &[[107.0, 112.0]], 60.0);
            let off_m = (ground(&found) - Position::new(107.0, 112.0)).norm();
            assert!(off_m < 1e-9 && found.z_m == 57.5, "{strategy:?}, {solver:?}: {off_m} m, {} m", found.z_m);
        }
    }
}

#[test]
fn a_uav_that_cannot_climb_keeps_its_exact_altitude() {
    let places = [[90.0, 100.0], [130.0, 100.0], [95.0, 140.0]];
    let altitude_m = 60.1 + 0.2;
    let cannot = ["altitude = 'free'\nmax_climb_mps = 0.0\naltitude_m = 60.0", "altitude_m = 60.0"];
    for uav in cannot {
        for solver in SOLVERS {
            for strategy in names() {
                let found = plan(&dense_urban(strategy, solver, uav), &places, altitude_m);
                assert_eq!(found.z_m, altitude_m, "{strategy:?}, {solver:?}, {uav}");
                assert!(!found.scheduled().is_empty());
            }
        }
    }
}

#[test]
fn an_altitude_range_of_one_value_equals_a_fixed_altitude() {
    let uav = "altitude = 'free'\naltitude_m = 43.7\nmin_altitude_m = 43.7\nmax_altitude_m = 43.7";
    for solver in SOLVERS {
        let found = plan(&dense_urban("exact", solver, uav), &[[90.0, 100.0], [130.0, 100.0]], 43.7);
        assert_eq!((found.z_m, found.solver), (43.7, SolverOutcome::Solved as u32), "{solver:?}");
    }
}

/// The letter's geometry: H = 20 m, d_c = 10 m. In suburban surroundings at θ ≥ 63.4° the probability of line of sight
/// falls short of 1 by 4.88 e^{−0.43 · 58.5} = 6e-11, and with `α_L` = 2 the expected rate is that of free space over
/// Γ.
#[test]
fn the_waypoint_at_the_papers_geometry_equals_that_of_free_space() {
    let places = [[95.0, 100.0], [107.0, 103.0], [99.0, 91.0], [101.0, 105.0]];
    let free_text = "name = 'free'\n[area]\nside_m = 200.0\n[link]\ntx_power_w = 0.1\nnoise_dbm = -109.0\n\
                     [planner]\nsca_iterations = 1000\n";
    let overrides = Overrides { strategy: Some("exact"), ..Overrides::default() };
    let free = Scenario::parse(free_text, Path::new("free.toml"), overrides).unwrap();
    let settled = plan(&free, &places, 20.0);
    let one_step = change(free, |settings| settings.sca_iterations = 1).unwrap();
    let letter = plan(&one_step, &places, 20.0);
    for solver in SOLVERS {
        let at = |environment: &str, exponent: &str| {
            let link = format!("environment = '{environment}'\nlos_exponent = {exponent}");
            plan(&scenario("exact", solver, "altitude_m = 20.0", &link), &places, 20.0)
        };
        let off_m = |found: &Plan, from: &Plan| (ground(found) - ground(from)).norm();
        let suburban = at("suburban", "2.0");
        assert_eq!(suburban.scheduled(), settled.scheduled());
        assert!(off_m(&suburban, &settled) < 1e-3, "{solver:?}: {} m", off_m(&suburban, &settled));
        // With the literature's own 2.5, in urban surroundings, and against the letter's one step.
        assert!(off_m(&at("urban", "2.5"), &letter) < 0.1, "{solver:?}: {} m", off_m(&at("urban", "2.5"), &letter));
    }
}

#[test]
fn the_fallback_beyond_convexity_finds_the_same_and_is_reported() {
    let places = [[90.0, 100.0], [130.0, 100.0], [95.0, 140.0]];
    for link in ["los_exponent = 4.5", "los = { b1 = -0.4568, b2 = 0.0470, b3 = -0.63, b4 = 1.63 }"] {
        let link = format!("{link}\ncomm_radius_m = 60.0");
        let [ascent, conic] = SOLVERS.map(|solver| plan(&scenario("exact", solver, FREE, &link), &places, 60.0));
        let outcomes = (ascent.solver, conic.solver);
        assert_eq!(outcomes, (SolverOutcome::Solved as u32, SolverOutcome::Fallback as u32), "{link}");
        assert_eq!((ascent.x_m, ascent.y_m, ascent.z_m), (conic.x_m, conic.y_m, conic.z_m), "{link}");
    }
}

#[test]
fn both_solvers_are_used_where_convexity_holds() {
    let places = [[90.0, 100.0], [130.0, 100.0], [95.0, 140.0]];
    let [ascent, conic] = SOLVERS.map(|solver| plan(&dense_urban("exact", solver, FREE), &places, 60.0));
    assert_eq!((ascent.solver, conic.solver), (SolverOutcome::Solved as u32, SolverOutcome::Solved as u32));
    assert!(
        ascent.expected_bits.abs_diff(conic.expected_bits) <= 3,
        "{} {}",
        ascent.expected_bits,
        conic.expected_bits
    );
}

#[test]
fn baselines_choose_position_by_rule_and_altitude_by_expected_rate() {
    // Greedy flight goes to SN 0, the first of equals, and serves the others from there, 50 m away: it climbs for them.
    let scenario = dense_urban("gfs", WaypointSolver::Geometric, FREE);
    let found = plan(&scenario, &[[100.0, 110.0], [100.0, 60.0], [50.0, 110.0], [150.0, 110.0]], 60.0);
    assert_eq!((found.x_m, found.y_m, found.scheduled()), (100.0, 110.0, &[0, 1, 2, 3][..]));
    let rate_bps = |z_m| {
        [0.0, 2_500.0, 2_500.0, 2_500.0]
            .map(|d2_m2| link_of(&scenario).expected_rate_bps(&Uplink::at(1.0, d2_m2, z_m)))
            .iter()
            .sum::<f64>()
    };
    let best_bps = (0..=10_000).map(|step| rate_bps(20.0 + f64::from(step) / 100.0)).fold(0.0, f64::max);
    assert!(rate_bps(found.z_m) >= best_bps && found.z_m > 21.0, "{} m", found.z_m);
}

#[test]
fn a_set_feasible_only_with_slack_is_served_where_it_was_found_as_a_fallback() {
    // SNs 0, 1, 2 surround (100, 100): SN 0 is exactly 10 m away, the others 0.9e-9 farther, and SN 3's circle passes
    // there.
    let slack = 1.0 + 0.9e-9;
    let at = |[x_m, y_m]: [f64; 2]| [100.0 + x_m * slack, 100.0 + y_m * slack];
    let diagonal_m = 50f64.sqrt();
    let places = [[100.0, 90.0], at([6.0, 8.0]), at([-8.0, 6.0]), [100.0 - diagonal_m, 100.0 + diagonal_m]];
    for solver in SOLVERS {
        let mut scenario = dense_urban("exact", solver, FREE);
        scenario.link.comm_radius_m = 10.0;
        scenario.link.resource_blocks = 3;
        let queues_bits = [900, 950, 800, 700];
        let found = Planner::new(&scenario, &nodes(&places)).unwrap().step(
            1,
            above(&Position::new(106.0, 110.0), 60.0),
            &queues_bits,
        );
        assert_eq!((found.scheduled(), found.solver), (&[0, 1, 2][..], SolverOutcome::Fallback as u32), "{solver:?}");
        assert!((ground(&found) - Position::new(100.0, 100.0)).norm() < 1e-9, "{solver:?}");
        assert!((20.0..=120.0).contains(&found.z_m), "{solver:?}");
    }
}

#[test]
fn the_altitude_is_kept_without_service() {
    for strategy in names() {
        let found = plan(&dense_urban(strategy, WaypointSolver::Geometric, FREE), &[[0.0, 0.0]], 61.3);
        assert_eq!((found.scheduled(), found.z_m), (&[][..], 61.3), "{strategy:?}");
    }
}

#[test]
fn the_expected_bits_are_the_mean_of_many_draws() {
    const DRAWS: u32 = 100_000;
    for environment in ["suburban", "urban", "dense-urban", "high-rise"] {
        let link = format!("environment = '{environment}'\ncomm_radius_m = 60.0");
        let scenario = scenario("exact", WaypointSolver::Geometric, "altitude_m = 30.0", &link);
        let places = [[90.0, 100.0], [130.0, 100.0], [95.0, 140.0], [120.0, 80.0]];
        let found = plan(&scenario, &places, 30.0);
        let link = link_of(&scenario);
        let mut random = StdRng::seed_from_u64(7);
        let rates_bps = places.map(|place| {
            let d2_m2 = distance_squared(&place.into(), &ground(&found));
            let chance = link.los_probability(&Uplink::at(1.0, d2_m2, found.z_m));
            (chance, link.los_rate_bps(d2_m2, found.z_m), link.nlos_rate_bps(d2_m2, found.z_m))
        });
        let mut mean_off = 0.0;
        for _ in 0..DRAWS {
            let draw_bps = |&(chance, los_bps, nlos_bps): &(f64, f64, f64)| {
                if random.random::<f64>() < chance { los_bps } else { nlos_bps }
            };
            let bits = rates_bps.iter().map(draw_bps).sum::<f64>() * scenario.link.comm_s;
            mean_off += (bits - found.expected_bits as f64) / f64::from(DRAWS);
        }
        // Of a draw: Σ P_L (1 − P_L) (R_L − R_N)². In suburban surroundings no draw of all may be out of line of sight.
        let variance = |&(chance, los_bps, nlos_bps): &(f64, f64, f64)| {
            chance * (1.0 - chance) * ((los_bps - nlos_bps) * scenario.link.comm_s).powi(2)
        };
        let error = (rates_bps.iter().map(variance).sum::<f64>() / f64::from(DRAWS)).sqrt();
        // Four standard errors, and up to one bit for the floor of each link.
        assert!((-4.0 * error..4.0 * error + 4.0).contains(&mean_off), "{environment}: {mean_off} bits off, {error}");
    }
}

/// A field, and slots over it: position, altitude [m], queues [bit].
#[derive(Debug, Clone)]
struct Case {
    scenario: Scenario,
    sensors: Vec<SensorNode>,
    slots: Vec<(Position, f64, Vec<u32>)>,
}

fn cases() -> impl Generator<Value = Case> {
    let coordinate = || prop_oneof![0.0..200.0, (0u32..=20).prop_map(|step| f64::from(step) * 10.0)];
    let place = move || [coordinate(), coordinate()];
    let uav = prop::sample::select(vec![FREE, "altitude = 'free'\naltitude_m = 60.0", "altitude_m = 60.0"]);
    let link = prop::sample::select(vec![
        "environment = 'high-rise'\ncomm_radius_m = 60.0\nbandwidth_hz = 1e4",
        "environment = 'urban'\ncomm_radius_m = 10.0\nresource_blocks = 7",
        "environment = 'suburban'\nlos_exponent = 5.0\ncomm_radius_m = 30.0",
        "los = { b1 = -0.4568, b2 = 0.0470, b3 = -0.63, b4 = 1.63 }\ncomm_radius_m = 25.0",
    ]);
    let choice = (prop::sample::select(names().to_vec()), prop::sample::select(&SOLVERS[..]), uav, link);
    let scenario = choice.prop_map(|(strategy, solver, uav, link)| scenario(strategy, solver, uav, link));
    (scenario, prop::collection::vec(place(), 1..40)).prop_flat_map(move |(scenario, places)| {
        let queues = prop::collection::vec(prop_oneof![0u32..4, 0u32..30_000], places.len());
        let altitude = prop_oneof![20.0..120.0, Just(20.0), Just(120.0)];
        let slot =
            (place(), altitude, queues).prop_map(|(place, altitude_m, queues)| (place.into(), altitude_m, queues));
        prop::collection::vec(slot, 1..4).prop_map(move |slots| Case {
            scenario: scenario.clone(),
            sensors: nodes(&places),
            slots,
        })
    })
}

fn place(case: &Case, id: u32) -> Position {
    let sensor = &case.sensors[id as usize];
    Position::new(sensor.x_m, sensor.y_m)
}

/// Expected rate [bit/s] of a plan's schedule and ground position at another altitude.
fn rate_bps(case: &Case, plan: &Plan, z_m: f64) -> f64 {
    let d2_m2 = |&id: &u32| distance_squared(&place(case, id), &ground(plan));
    plan.scheduled().iter().map(|id| link_of(&case.scenario).expected_rate_bps(&Uplink::at(1.0, d2_m2(id), z_m))).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60 * crate::CASES_FACTOR))]

    #[test]
    fn spatial_plans_respect_all_limits_and_keep_no_hidden_state(case in cases()) {
        let mut planner = Planner::new(&case.scenario, &case.sensors).unwrap();
        for (number, (position, altitude_m, queues_bits)) in (1..).zip(&case.slots) {
            let plan = planner.step(number, above(position, *altitude_m), queues_bits);
            let at = ground(&plan);
            prop_assert!(within(&at, position, case.scenario.reach_m()), "slot {number}: reach, {at}");
            prop_assert!(case.scenario.area.contains(&at, 0.0), "slot {number}: area, {at}");
            let [low_m, high_m] = case.scenario.altitudes_m(*altitude_m);
            prop_assert!((low_m..=high_m).contains(&plan.z_m), "slot {number}: climb, {} m", plan.z_m);
            let mut bits = 0;
            for &id in plan.scheduled() {
                let place = place(&case, id);
                prop_assert!(within(&place, &at, case.scenario.link.comm_radius_m), "slot {number}: SN {id}, {at}");
                let link = link_of(&case.scenario);
                let d2_m2 = distance_squared(&place, &at);
                let rate_bps = link.expected_rate_bps(&Uplink::at(1.0, d2_m2, plan.z_m));
                let capacity_bits = Channel::of(&case.scenario.link).capacity_bits(rate_bps);
                bits += capacity_bits.min(u64::from(queues_bits[id as usize]));
            }
            prop_assert_eq!(plan.expected_bits, bits);
            if plan.solver == SolverOutcome::Rule as u32 {
                prop_assert!(!plan.scheduled().is_empty() || plan.z_m == *altitude_m, "slot {number}: {} m", plan.z_m);
            }
            // A price of energy is paid for climbing, too.
            let has_price = case.scenario.planner.strategy == "drift-plus-penalty";
            if plan.solver == SolverOutcome::Rule as u32 && !has_price {
                let best_bps = rate_bps(&case, &plan, plan.z_m) * (1.0 + 1e-9);
                let mut levels_m = (0..=50).map(|step| low_m + (high_m - low_m) * f64::from(step) / 50.0);
                prop_assert!(levels_m.all(|z_m| rate_bps(&case, &plan, z_m) <= best_bps), "slot {number}: altitude");
            }
            prop_assert!(plan.mode != Mode::Hold as u32);
            if planner.has_state() {
                continue;
            }
            let fresh = Planner::new(&case.scenario, &case.sensors).unwrap().step(number, above(position, *altitude_m), queues_bits);
            // As text, which tells every f64 apart and lets NaN equal NaN.
            prop_assert_eq!(format!("{plan:?}"), format!("{fresh:?}"), "slot {}", number);
        }
    }
}
