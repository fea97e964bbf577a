//! Wind, acceleration and position errors (decisions D29 and D31): every strategy flies with them, and a process that
//! was killed draws the same errors again.

use std::path::Path;

use skysink_common::geometry::within;
use skysink_common::message::{HoldReason, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::{SensorList, Sensors};
use skysink_mission::Mission;
use skysink_planner::bound::mission_bound;
use skysink_planner::settings;
use skysink_planner::strategies::STRATEGIES;

use crate::support::Place;

/// Keys of `[uav]` for each kind of motion.
const MOTIONS: [&str; 4] = [
    "wind_mps = [3.0, -4.0]\n",
    "position_error_m = 3.0\n",
    "acceleration_mps2 = 30.0\n",
    "position_error_m = 3.0\nwind_mps = [-4.0, 3.0]\nacceleration_mps2 = 60.0\n",
];

/// Three fields: dense, sparse, and with a free altitude.
const FIELDS: [&str; 3] = [
    "[area]\nside_m = 100.0\n[sensors]\ncount = 60\nsampling_bps = 900.0\n[uav]\n",
    "[area]\nside_m = 500.0\n[sensors]\ncount = 25\nsampling_bps = 600.0\n[uav]\nmax_speed_mps = 20.0\n",
    "[area]\nside_m = 250.0\n[sensors]\ncount = 30\nsampling_bps = [300.0, 900.0]\n[link]\nmodel = \"probabilistic-los\"\n\
     comm_radius_m = 25.0\n[uav]\naltitude = \"free\"\n",
];

fn scenario(field: &str, motion: &str, strategy: &str) -> Scenario {
    let text = format!(
        "name = 'x'\nslots = 60\n{field}{motion}[planner]\nstrategy = '{strategy}'\n[planner.horizon]\niterations = 300\n\
         [planner.offline]\nsteps = 3000\n[planner.sca]\niterations = 2\n"
    );
    Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).and_then(settings::resolve).unwrap()
}

#[test]
fn every_strategy_stays_in_reach_in_every_motion_model_and_respects_the_bound() {
    for (field, motion) in FIELDS.iter().flat_map(|field| MOTIONS.map(|motion| (field, motion))) {
        let mut bound_bits = None; // the same for every strategy
        for strategy in STRATEGIES {
            let case = format!("{}, {motion:?}, {field:?}", strategy.name);
            let scenario = scenario(field, motion, strategy.name);
            let list = SensorList::of(&scenario).unwrap();
            let mut mission = Mission::new(&scenario, &list).unwrap();
            let mut beside = 0;
            while mission.slot() < scenario.slots {
                let from = mission.plant().flight(0).position();
                let plan = mission.plan();
                let record = mission.fly(Some(&plan));
                let flight = &record.flights()[0];
                assert!(within(&from.xy(), &plan.waypoint().xy(), scenario.reach_m()), "{case}: {plan:?}");
                assert_eq!(
                    (flight.hold, flight.mode == Mode::Hold as u32),
                    (HoldReason::default() as u32, false),
                    "{case}"
                );
                assert!(scenario.reaches(&from.xy(), &flight.position().xy()), "{case}: from {from} to {flight:?}");
                assert!(scenario.area.contains(&flight.position().xy(), 0.0), "{case}: {flight:?}");
                assert!(record.header.totals.is_balanced(), "{case}");
                beside += u32::from((flight.position() - plan.waypoint()).norm() > 0.1);
            }
            assert_eq!(beside > 0, scenario.uav.position_error_m.is_some(), "{case}: {beside}");
            let bound_bits = *bound_bits.get_or_insert_with(|| {
                let sensors = Sensors::of(&scenario, &list.nodes());
                mission_bound(&scenario, &sensors, &list.queues_bits(), u64::MAX).loss_bits
            });
            assert!(bound_bits <= mission.header().totals.lost_bits, "{case}: {bound_bits} bits");
        }
    }
}

#[test]
fn a_flight_with_wind_respects_its_bound() {
    // 65 m downwind, d_c = 10 m: 25 m/s and 30 m/s of wind lead into range in one slot, where the bound has to be 0.
    // Planned are 0 m/s more than the wind: in no slot.
    let text = "name = 'x'\nslots = 3\n[area]\nside_m = 200.0\n[sensors]\nfile = 's.csv'\nsampling_bps = 30000.0\n\
                [uav]\nmax_speed_mps = 30.0\nwind_mps = [25.0, 0.0]\nstart_m = [20.0, 100.0]\n";
    let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
    let list = SensorList::parse("x_m,y_m,queue_bits\n85,100,0\n", Path::new("s.csv"), &scenario).unwrap();
    let mut mission = Mission::new(&scenario, &list).unwrap();
    let mut plan = skysink_common::message::Plan::fly_to([75.0, 100.0, 20.0], Mode::Serve);
    plan.schedule(&[0]);
    for x_m in [75.0, 80.0, 85.0] {
        plan.x_m = x_m;
        mission.plan();
        assert_eq!(mission.fly(Some(&plan)).flights()[0].served, 1, "to {x_m}");
    }
    assert_eq!(mission.header().totals.lost_bits, 0);
    let bound = mission_bound(&scenario, &Sensors::of(&scenario, &list.nodes()), &list.queues_bits(), u64::MAX);
    assert_eq!(bound.loss_bits, 0);
}

#[test]
fn a_killed_flight_sim_draws_the_same_errors_again() {
    let place = Place::new();
    let run = place.flight("long").set("uav.position_error_m", 1.5).without_viewer().start();
    for _ in 0..2 {
        run.until_slots_later(20);
        run.kill_and_await("flight-sim");
    }
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    place.assert_clean();
}
