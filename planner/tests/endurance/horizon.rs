//! Whole missions by the strategies that remember: never refused, continued byte for byte, and as good as foreseen.

use std::ops::ControlFlow;
use std::path::Path;

use crate::support::{TestMission, scenario_of};
use nalgebra::Point3;
use proptest::prelude::{Strategy as Generator, *};
use skysink_common::checkpoint::Checkpoint;
use skysink_common::sensors::{SensorList, Sensors};
use skysink_common::stop::Stop;
use skysink_planner::bound::mission_bound;
use skysink_planner::plan::long_search::{SearchOutcome, SearchProgress};
use skysink_planner::strategies::look_ahead::search_offline;
use skysink_planner::strategies::names;
use skysink_planner::strategy::{OwnedSetup, Setup, Strategy, Timing};
use skysink_planner::{FleetPlanner, Planner};

/// The strategies that carry something from slot to slot.
const REMEMBERING: [&str; 6] = ["tour", "round-robin", "max-age-first", "whittle", "horizon", "offline"];

/// Channels and vehicles at the edges: narrow and fading links, reach below range, range beyond the area, one SN, and
/// three dimensions.
fn texts() -> impl Generator<Value = String> {
    let link = prop_oneof![
        Just("".to_owned()),
        Just("gain = 'per-slot'".to_owned()),
        Just("model = 'probabilistic-los'\nenvironment = 'high-rise'".to_owned()),
    ];
    let fields = (1u32..60, prop_oneof![Just(60.0), Just(300.0), Just(2_000.0)], prop_oneof![Just(100.0), Just(900.0)]);
    let vehicle = (prop_oneof![Just(30.0), Just(6.0), Just(200.0)], prop_oneof![Just("fixed"), Just("free")]);
    let radio = (
        link,
        prop_oneof![Just(10.0), Just(60.0), Just(5_000.0)],
        prop_oneof![Just(5e6), Just(2e3)],
        prop_oneof![1u32..6, Just(64)],
    );
    (fields, vehicle, radio).prop_map(
        |((count, side_m, rate_bps), (speed, altitude), (link, radius_m, width_hz, n))| {
            let altitude = if link.starts_with("model") { altitude } else { "fixed" };
            format!(
                "slots = 20\n[area]\nside_m = {side_m:?}\n[sensors]\ncount = {count}\nsampling_bps = {rate_bps:?}\n\
             initial_queue_mean_bits = 20000.0\n[uav]\nmax_speed_mps = {speed:?}\naltitude = '{altitude}'\n\
             [link]\ncomm_radius_m = {radius_m:?}\nbandwidth_hz = {width_hz:?}\nresource_blocks = {n}\n{link}\n\
             [planner]\nhorizon.iterations = 60\noffline.steps = 2000\n"
            )
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn no_plan_is_refused_and_a_restart_does_not_change_the_flight(
        text in texts(), strategy in prop::sample::select(&REMEMBERING[..]), seed in 1u64..1_000, restart in 1u64..20,
    ) {
        let scenario = scenario_of(&text, strategy, seed);
        let mut mission = TestMission::new(&scenario);
        let mut restarted = TestMission::new(&scenario);
        for slot in 1..=scenario.slots {
            let plan = mission.advance();
            prop_assert_eq!(mission.last_flight().refused, 0, "slot {}: {:?}", slot, plan);
            let path = mission.planner.path(0);
            let waypoint = Point3::new(plan.x_m, plan.y_m, plan.z_m);
            prop_assert!((1..=64).contains(&path.len()) && path[0] == waypoint, "{:?}", path);
            prop_assert_eq!(format!("{plan:?}"), format!("{:?}", restarted.advance()));
            if slot == restart {
                restarted.restart();
                prop_assert_eq!(restarted.planner.slot(), slot);
            }
            prop_assert_eq!(mission.saved(), restarted.saved());
        }
        prop_assert!(mission.plant().field().totals().is_balanced());
    }
}

#[test]
fn a_truncated_or_foreign_checkpoint_is_refused_and_changes_nothing() {
    for strategy in REMEMBERING {
        let scenario =
            scenario_of("slots = 10\n[planner]\nhorizon.iterations = 10\noffline.steps = 400\n", strategy, 1);
        let mut mission = TestMission::new(&scenario);
        mission.advance();
        let saved = mission.saved();
        for length in 0..saved.len() {
            assert!(mission.planner.restore(&saved[..length]).is_err(), "{strategy:?}: cut after {length}");
        }
        assert!(mission.planner.restore(&[&saved[..], &[0]].concat()).is_err(), "{strategy:?}: too long");
        assert_eq!(mission.saved(), saved);
        let mut other = TestMission::new(&scenario_of("slots = 10\n", "uts", 1));
        other.advance();
        assert!(other.saved().is_empty());
        assert!(other.planner.restore(&saved).is_err(), "{strategy:?}: another strategy");
    }
}

#[test]
fn idle_sensor_nodes_are_served_but_not_waited_for() {
    let scenario = scenario_of("slots = 30\n[planner]\nhorizon.iterations = 50\n", "horizon", 1);
    let text = "x_m,y_m,queue_bits,sampling_bps\n20,20,20000,0\n30,20,100,900\n90,90,100,900\n50,50,7000,0\n";
    let list = SensorList::parse(text, Path::new("list.csv"), &scenario).unwrap();
    let mut mission = TestMission::over(&scenario, &list);
    let first = mission.advance();
    mission.by_ref().take(29).for_each(drop);
    assert_eq!(mission.lost_bits(), 0);
    assert!(first.scheduled().contains(&3) || mission.queues_bits()[3] == 0, "met on the way");
    // Where no SN samples, the UAV goes to the fullest queue (decision D8).
    let text = "x_m,y_m,queue_bits,sampling_bps\n20,50,20000,0\n";
    let list = SensorList::parse(text, Path::new("list.csv"), &scenario).unwrap();
    let mut mission = TestMission::over(&scenario, &list);
    let plan = mission.advance();
    assert_eq!((plan.x_m, plan.y_m, plan.scheduled()), (20.0, 50.0, &[0][..]));
}

#[test]
fn only_a_short_time_limit_changes_a_search() {
    let text = "slots = 40\n[area]\nside_m = 600.0\n[sensors]\nsampling_bps = 700.0\n";
    let fly = |steps: u32, budget: &str, timing| {
        let keys = format!("{text}[planner]\nhorizon.iterations = {steps}\n{budget}\n");
        let mut mission = TestMission::new(&scenario_of(&keys, "horizon", 1));
        mission.planner.set_timing(timing);
        (1..=40)
            .map(|slot| {
                let plan = mission.advance();
                assert_eq!(mission.last_flight().refused, 0, "slot {slot}");
                format!("{:.3} {:.3} {:?}", plan.x_m, plan.y_m, plan.scheduled())
            })
            .collect::<Vec<_>>()
    };
    // A thousand million steps would take half an hour a slot.
    fly(1_000_000_000, "horizon.budget_ms = 2.0", Timing::Paced);
    let unlimited = fly(500, "", Timing::Paced);
    assert_eq!(fly(500, "horizon.budget_ms = 3.6e6", Timing::Paced), unlimited);
    let at_once = "horizon.budget_ms = 1e-6";
    assert_eq!(fly(500, at_once, Timing::Free), unlimited, "no clock is read");
    assert_ne!(fly(500, at_once, Timing::Paced), unlimited);
}

#[test]
fn a_planner_started_in_mid_mission_plans_from_the_current_state() {
    let text = "slots = 200\n[area]\nside_m = 300.0\n[sensors]\ncount = 60\n[planner]\nhorizon.iterations = 200\n";
    let scenario = scenario_of(text, "horizon", 3);
    let mut mission = TestMission::new(&scenario);
    mission.by_ref().take(100).for_each(drop);
    let list = SensorList::of(&scenario).unwrap();
    mission.planner = Planner::new(&scenario, &list.nodes()).unwrap().into();
    (101..=200).for_each(|slot| {
        mission.advance();
        assert_eq!(mission.last_flight().refused, 0, "slot {slot}");
    });
    assert_eq!(mission.lost_bits(), 0);
}

/// Where the letter's strategy is trapped: 300 m, it loses more than half.
#[test]
fn the_look_ahead_loses_nothing_where_uts_is_trapped() {
    for seed in 1..=3 {
        let text = "slots = 500\n[area]\nside_m = 300.0\n[planner]\nhorizon.iterations = 100\n";
        let scenario = scenario_of(text, "horizon", seed);
        assert_eq!(TestMission::new(&scenario).loss_rate(), 0.0, "seed {seed}");
    }
}

#[test]
fn the_look_ahead_loses_less_than_every_other_strategy() {
    let settings = [
        "slots = 200\n[area]\nside_m = 500.0\n[sensors]\ncount = 60\n",
        "slots = 150\n[sensors]\ncount = 120\nsampling_bps = 900.0\n",
        "slots = 200\n[area]\nside_m = 150.0\n[sensors]\ncount = 100\nsampling_bps = 300.0\n[link]\nbandwidth_hz = 5e3\n",
    ];
    for setting in settings {
        let mean = |strategy| {
            let mission = |seed| {
                let scenario = scenario_of(&format!("{setting}[planner]\nhorizon.iterations = 300\n"), strategy, seed);
                TestMission::new(&scenario).loss_rate()
            };
            (1..=3).map(mission).sum::<f64>() / 3.0
        };
        let horizon = mean("horizon");
        for strategy in names().into_iter().filter(|strategy| !matches!(*strategy, "horizon" | "best-of" | "offline")) {
            let other = mean(strategy);
            assert!(horizon <= other, "{setting}: {horizon} against {other} of {}", strategy);
        }
    }
}

/// Links of line of sight as the cases below have them.
const SIGHT: &str = "comm_s = 0.2\nmodel = 'probabilistic-los'\ntx_power_w = 0.1\nnoise_dbm = -109.0\n";

/// Short missions of few SNs in which looking ahead once lost 0.79 and 0.48 where a strategy of one slot loses 0.53 and
/// 0.43: hovering low and right above an SN, or staying with the one that samples most, was not valued. It loses up to
/// 0.44 where the other loses 0.43; there are missions in which it still loses far more.
#[test]
fn the_look_ahead_is_hardly_worse_than_hovering_single_slot_strategies() {
    let free = "altitude = 'free'\nstart_m = [0.0, 0.0]\nendurance_s = 1e6\n";
    let cases = [
        (
            format!(
                "slots = 20\nslot_s = 2.0\n[area]\nside_m = 48.0\n[sensors]\nfile = 'list.csv'\ncapacity_bits = 300000\n\
                 sampling_bps = [7092.1986, 70921.9858]\ninitial_queue_mean_bits = [0.0, 300000]\n[uav]\n\
                 altitude_m = 20.0\nmax_speed_mps = 6.0\n{free}[link]\nbandwidth_hz = 43781.5\ncomm_radius_m = 22.0\n\
                 {SIGHT}environment = 'dense-urban'\n[planner]\nknowledge = 'estimated'\nrates = 'learnt'\n"
            ),
            "x_m,y_m,queue_bits,gain_db,sampling_bps\n\
             10.22,46.494,300000,-50.013,7092.1986\n\
             35.253,35.231,68213,-53.64,7092.1986\n\
             42.712,14.449,300000,-53.78,70921.9858\n\
             8.132,14.154,300000,-51.822,7092.1986\n\
             4.937,5.791,148589,-50.176,7092.1986\n",
        ),
        (
            "slots = 120\nslot_s = 0.5\n[area]\nside_m = 978.0\n[sensors]\nfile = 'list.csv'\n\
             sampling_bps = [963.8554, 9638.5542]\ninitial_queue_mean_bits = 9900.0\n[uav]\naltitude_m = 50.0\n\
             max_speed_mps = 41.8\nendurance_s = 1e6\n[link]\ncomm_radius_m = 7.8\ncomm_s = 0.05\n[planner]\n\
             knowledge = 'estimated'\n"
                .to_owned(),
            "x_m,y_m,queue_bits,gain_db,sampling_bps\n\
             349.753,680.629,9900,-50.728,963.8554\n\
             894.765,43.631,9900,-54.252,963.8554\n\
             975.117,301.22,9900,-51.773,9638.5542\n\
             122.606,309.232,9900,-52.309,963.8554\n\
             310.364,125.898,9900,-51.386,963.8554\n\
             690.032,757.382,9900,-52.32,963.8554\n\
             22.328,867.093,9900,-53.019,963.8554\n\
             529.589,819.13,9900,-50.228,963.8554\n\
             871.248,108.863,9900,-52.468,963.8554\n\
             479.037,571.463,9900,-53.118,963.8554\n\
             890.642,239.509,9900,-50.567,963.8554\n\
             224.439,377.74,9900,-52.555,963.8554\n",
        ),
    ];
    for (text, list) in cases {
        let mean = |strategy| {
            let mission = |seed| {
                let scenario = scenario_of(&text, strategy, seed);
                let list = SensorList::parse(list, Path::new("list.csv"), &scenario).unwrap();
                TestMission::over(&scenario, &list).loss_rate()
            };
            (2001..=2006).map(mission).sum::<f64>() / 6.0
        };
        let horizon = mean("horizon");
        for strategy in ["gfs", "uts", "exact", "edf"] {
            let other = mean(strategy);
            assert!(horizon <= other + 0.02, "{horizon} against {other} of {strategy}: {text}");
        }
    }
}

#[test]
fn an_offline_plan_has_its_predicted_loss_and_respects_the_bound() {
    for seed in 1..=4 {
        let text = "slots = 200\n[area]\nside_m = 600.0\n[sensors]\ncount = 50\nsampling_bps = 300.0\n\
                    [planner]\nhorizon.iterations = 0\noffline.steps = 20000\n";
        let scenario = scenario_of(text, "offline", seed);
        let list = SensorList::of(&scenario).unwrap();
        let nodes = list.nodes();
        let mut mission = TestMission::new(&scenario);
        let mut steps = Vec::new();
        let setup = OwnedSetup::new(scenario.clone(), &nodes).unwrap();
        let queues_bits = list.queues_bits();
        let found = search_offline(&setup.setup(), &queues_bits, &Stop::default(), &mut |progress| {
            steps.push(progress.steps);
            ControlFlow::Continue(())
        });
        let (offline, SearchOutcome { cost: predicted_bits, steps: done, is_optimal }) = found.unwrap();
        assert_eq!((done, is_optimal), (20_000, false), "seed {seed}");
        let mut offline = Some(offline);
        let mut make = |_: &Setup<'_>| -> Result<Box<dyn Strategy>, _> { Ok(offline.take().unwrap()) };
        mission.planner = FleetPlanner::by(&scenario, &nodes, &mut make, &Stop::default()).unwrap();
        assert!(steps.len() > 100 && steps.is_sorted() && steps[0] == 0, "{steps:?}");
        mission.by_ref().take(200).for_each(drop);
        let lost_bits = mission.lost_bits() as f64;
        assert!((lost_bits - predicted_bits).abs() < 1e-3, "seed {seed}: {lost_bits} against {predicted_bits}");
        let bound_bits =
            mission_bound(&scenario, &Sensors::of(&scenario, &nodes), &list.queues_bits(), u64::MAX).loss_bits as f64;
        assert!(bound_bits > 0.0 && bound_bits <= lost_bits, "seed {seed}: {lost_bits} against {bound_bits}");
        let unprepared = TestMission::new(&scenario).loss_rate();
        assert_eq!(unprepared, lost_bits / (50.0 * 300.0 * 200.0), "seed {seed}: made in slot 1 instead");
        let online = TestMission::new(&scenario_of(text, "horizon", seed)).loss_rate();
        assert!(unprepared <= online, "seed {seed}: without a search {online}");
    }
}

#[test]
fn an_interrupted_search_returns_no_plan() {
    let text = "slots = 50\n[sensors]\ncount = 60\nsampling_bps = 5000.0\n[planner]\noffline.steps = 2000\n";
    let scenario = scenario_of(text, "offline", 1);
    let list = SensorList::of(&scenario).unwrap();
    let setup = OwnedSetup::new(scenario, &list.nodes()).unwrap();
    let watch = &mut |progress: SearchProgress| match progress.steps {
        1_001.. => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let broken_off = search_offline(&setup.setup(), &list.queues_bits(), &Stop::default(), watch);
    assert!(broken_off.is_none());
}

/// Golden traces: waypoint [m] and schedule of the first slots.
#[test]
fn missions_are_stable() {
    let text = "slots = 60\n[area]\nside_m = 400.0\n[sensors]\ncount = 40\nsampling_bps = 900.0\n\
                [planner]\nhorizon.iterations = 200\noffline.steps = 5000\n";
    let trace = |strategy| {
        let mut mission = TestMission::new(&scenario_of(text, strategy, 1));
        (1..=3)
            .map(|_| {
                let plan = mission.advance();
                format!("{:.3} {:.3} {:?}", plan.x_m, plan.y_m, plan.scheduled())
            })
            .collect::<Vec<_>>()
    };
    let expected = [
        ["224.316 182.430 [31]", "245.083 173.235 []", "265.850 164.040 [18]"],
        ["181.229 223.402 []", "162.458 246.804 []", "143.687 270.206 []"],
        ["174.976 216.546 []", "149.951 233.092 []", "124.927 249.638 []"],
        ["174.976 216.546 []", "149.951 233.092 []", "124.927 249.638 []"],
        ["227.270 187.496 [31]", "227.155 213.305 []", "227.039 239.114 []"],
        ["206.699 226.918 []", "213.397 253.836 []", "220.096 280.754 [26]"],
    ];
    assert_eq!(REMEMBERING.map(trace), expected);
}
