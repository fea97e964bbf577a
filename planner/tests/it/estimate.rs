//! Whole missions of planners that do not see the queues: what they believe against what is, and their restarts.

use std::path::Path;

use crate::support::{TestMission, scenario_of};
use proptest::prelude::{Strategy as Generator, *};
use skysink_common::arrivals::sampled_bits;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::sensors::SensorList;
use skysink_common::told::{Received, Sensed, Told};
use skysink_planner::strategies::names;

/// Links that empty queues and links that do not, gains that change, and three dimensions; storages that fill and
/// others that do not; rates of whole bits and others.
fn texts(rates: &'static str) -> impl Generator<Value = String> {
    let link = prop_oneof![
        Just("bandwidth_hz = 5e6"),
        Just("bandwidth_hz = 3e3\ngain = 'per-slot'"),
        Just("model = 'probabilistic-los'\nenvironment = 'high-rise'\nbandwidth_hz = 2e4"),
    ];
    let field = (1u32..40, prop_oneof![Just(50.0), Just(200.0)], prop_oneof![Just(6_000), Just(1_000_000)]);
    let sampling = prop_oneof![Just("[50.0, 150.0]"), Just("33.3"), Just("[0.0, 700.0]"), Just("0.0")];
    (link, field, sampling, prop_oneof![Just(1.0), Just(0.3)]).prop_map(
        move |(link, (count, side_m, capacity_bits), sampling, slot_s)| {
            format!(
                "slots = 60\nslot_s = {slot_s:?}\n[area]\nside_m = {side_m:?}\n[sensors]\ncount = {count}\n\
                 capacity_bits = {capacity_bits}\nsampling_bps = {sampling}\ninitial_queue_mean_bits = [0.0, 9000.0]\n\
                 [link]\n{link}\n[planner]\nhorizon.iterations = 40\noffline.steps = 1000\nknowledge = 'estimated'\nrates = '{rates}'\n"
            )
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20 * crate::CASES_FACTOR))]

    #[test]
    fn contacted_queues_are_known_exactly_with_known_rates(
        text in texts("known"), strategy in prop::sample::select(names().to_vec()), seed in 1u64..10_000,
        void in 1u64..60,
    ) {
        let scenario = scenario_of(&text, strategy, seed);
        let mut mission = TestMission::new(&scenario);
        let mut contacted = vec![false; mission.nodes.len()];
        for slot in 1..=scenario.slots {
            let plan = mission.plan();
            for (id, &queue_bits) in (0..).zip(mission.queues_bits()) {
                let believed_bits = mission.estimate().queues_bits()[id as usize];
                let is_contacted = mission.estimate().uncertainty(slot, id).initial_bits == 0.0;
                prop_assert_eq!(is_contacted, contacted[id as usize]);
                if contacted[id as usize] {
                    prop_assert_eq!(believed_bits, queue_bits, "seed {}, slot {}, SN {}", seed, slot, id);
                } else {
                    let prior_bits = 4_500 + sampled_bits(mission.mean_bits(id), slot - 1);
                    let capacity_bits = u64::from(scenario.sensors.capacity_bits.ends()[1]);
                    prop_assert_eq!(u64::from(believed_bits), prior_bits.min(capacity_bits), "slot {}, SN {}", slot, id);
                }
            }
            let expected_bits: u64 =
                plan.scheduled().iter().map(|&id| u64::from(mission.estimate().queues_bits()[id as usize])).sum();
            prop_assert!(plan.expected_bits <= expected_bits, "the planner expects what it believes");
            mission.fly(Some(&plan).filter(|_| slot != void)); // once the plan comes too late
            prop_assert_eq!(mission.last_flight().refused, 0);
            mission.last_flight().served_links().iter().for_each(|link| contacted[link.sensor as usize] = true);
        }
    }

    #[test]
    fn learnt_rates_are_exact_to_a_bit_per_slot_and_bounded(
        text in texts("learnt"), strategy in prop::sample::select(names().to_vec()), seed in 1u64..10_000,
    ) {
        let scenario = scenario_of(&text, strategy, seed);
        let mut mission = TestMission::new(&scenario);
        let prior_bits = mission.estimate().mean_bits(0);
        // The last contact of each SN, and whether a gap between two contacts revealed its rate.
        let mut contacts = vec![(0, false); mission.nodes.len()];
        for slot in 1..=scenario.slots {
            let before_bits = mission.queues_bits().to_vec();
            mission.advance();
            for link in mission.last_flight().served_links() {
                let (last, told) = &mut contacts[link.sensor as usize];
                let room = before_bits[link.sensor as usize] < scenario.sensors.capacity_bits.ends()[1];
                *told |= *last > 0 && *last + 1 < slot && room;
                *last = slot;
            }
            let flight = *mission.last_flight();
            let queues_bits = mission.queues_bits().to_vec();
            let told = Told::from(&queues_bits);
            mission.planner.observe(&Sensed { slot, flights: &[flight], told, received: &Received::NOTHING });
            for (id, &(_, told)) in (0..).zip(&contacts) {
                let believed_bits = mission.estimate().mean_bits(id);
                let true_bits = mission.mean_bits(id);
                let off_bits = believed_bits - true_bits;
                // Of each gap the rounding to whole bits takes or adds less than one.
                prop_assert!(!told || off_bits.abs() < 1.0 + 1e-6, "seed {seed}, slot {slot}, SN {id}: {believed_bits}");
                prop_assert!(believed_bits <= prior_bits || off_bits < 1.0 + 1e-6, "slot {slot}, SN {id}");
            }
        }
    }

    #[test]
    fn a_restarted_planner_has_the_same_belief_and_flight(
        text in prop_oneof![texts("known"), texts("learnt")], strategy in prop::sample::select(names().to_vec()),
        seed in 1u64..10_000, restart in 1u64..60,
    ) {
        let scenario = scenario_of(&text, strategy, seed);
        let mut mission = TestMission::new(&scenario);
        let mut restarted = TestMission::new(&scenario);
        for slot in 1..=scenario.slots {
            prop_assert_eq!(format!("{:?}", mission.advance()), format!("{:?}", restarted.advance()), "slot {}", slot);
            if slot == restart {
                restarted.restart();
            }
            prop_assert_eq!(mission.saved(), restarted.saved(), "slot {}", slot);
        }
    }
}

#[test]
fn a_missed_contact_keeps_the_older_belief() {
    let text = "slots = 150\n[sensors]\nsampling_bps = [50.0, 150.0]\n[planner]\nknowledge = 'estimated'\n";
    let scenario = scenario_of(text, "gfs", 3);
    let mut mission = TestMission::new(&scenario);
    // Whether the last contact of an SN was missed.
    let mut missed = vec![false; mission.nodes.len()];
    let mut older = 0;
    let mut recovered = 0;
    let mut slot = 1;
    while slot <= scenario.slots {
        let plan = mission.plan();
        for (id, &queue_bits) in (0..).zip(mission.queues_bits()) {
            let believed_bits = mission.estimate().queues_bits()[id as usize];
            if missed[id as usize] {
                older += u32::from(believed_bits > queue_bits);
            } else if mission.estimate().uncertainty(slot, id).initial_bits == 0.0 {
                assert_eq!(believed_bits, queue_bits, "slot {slot}, SN {id}");
            }
        }
        mission.fly(Some(&plan));
        let unseen = slot % 7 == 0;
        for link in mission.last_flight().served_links() {
            recovered += u32::from(missed[link.sensor as usize] && !unseen);
            missed[link.sensor as usize] = unseen;
        }
        if unseen {
            slot += 1;
            mission.fly(None); // the planner lags: nobody observes this flight's slot, nor the one before it
        }
        slot += 1;
    }
    assert!(older > 100 && recovered > 10, "{older} beliefs older, {recovered} recovered");
}

#[test]
fn learnt_rates_equal_known_ones_where_all_are_equal() {
    for strategy in ["horizon", "uts", "exact"] {
        let text = |rates: &str| {
            format!(
                "slots = 80\n[area]\nside_m = 150.0\n[sensors]\ncount = 60\nsampling_bps = 400.0\n[planner]\n\
                 horizon.iterations = 100\nknowledge = 'estimated'\nrates = '{rates}'\n"
            )
        };
        let [mut known, mut learnt] =
            ["known", "learnt"].map(|rates| TestMission::new(&scenario_of(&text(rates), strategy, 5)));
        for slot in 1..=80 {
            assert_eq!(format!("{:?}", known.advance()), format!("{:?}", learnt.advance()), "{strategy:?}, {slot}");
        }
    }
}

#[test]
fn the_look_ahead_flies_over_idle_sensor_nodes_of_unknown_rate() {
    let text = "slots = 60\n[sensors]\nsampling_bps = 0.0\n[planner]\nhorizon.iterations = 50\nknowledge = 'estimated'\n\
                rates = 'learnt'\n";
    let scenario = scenario_of(text, "horizon", 1);
    // The scenario's rate is 0, so no SN is believed to sample before a contact; SNs 1 and 2 do.
    let list = "x_m,y_m,sampling_bps\n20,20,0\n30,20,900\n90,90,900\n50,50,0\n";
    let list = SensorList::parse(list, Path::new("list.csv"), &scenario).unwrap();
    let mut mission = TestMission::over(&scenario, &list);
    for slot in 1..=scenario.slots {
        mission.advance();
        assert_eq!(mission.last_flight().refused, 0, "slot {slot}");
    }
    let believed_bits = [0, 1, 2, 3].map(|id| mission.estimate().mean_bits(id));
    assert_eq!(believed_bits, [0.0, 900.0, 900.0, 0.0]);
}

#[test]
fn a_planner_with_known_queues_saves_no_belief() {
    let scenario = scenario_of("slots = 10\n", "uts", 1);
    let mut mission = TestMission::new(&scenario);
    mission.advance();
    assert!(!mission.planner.belief().is_estimated() && mission.saved().is_empty());
    let text = "slots = 10\n[planner]\nknowledge = 'estimated'\n";
    let mut believing = TestMission::new(&scenario_of(text, "uts", 1));
    believing.advance();
    assert!(mission.planner.restore(&believing.saved()).is_err());
    assert!(believing.planner.restore(&[]).is_err());
}

#[test]
fn the_checkpoint_of_another_strategy_is_refused() {
    let text = "slots = 10\n[planner]\nknowledge = 'estimated'\n";
    let [mut uts, mut gfs, mut again] =
        ["uts", "gfs", "uts"].map(|strategy| TestMission::new(&scenario_of(text, strategy, 1)));
    uts.advance();
    assert!(gfs.planner.restore(&uts.saved()).is_err());
    assert!(again.planner.restore(&uts.saved()).is_ok());
}

#[test]
fn uncertain_queues_are_visited_early_enough() {
    let text = "slots = 300\n[area]\nside_m = 250.0\n[sensors]\ncount = 100\nsampling_bps = [50.0, 150.0]\n\
                initial_queue_mean_bits = [0.0, 20000.0]\n[planner]\nknowledge = 'estimated'\nrates = 'learnt'\n\
                horizon.iterations = 300\n";
    for seed in 1..=u64::from(crate::CASES_FACTOR) {
        // a mission takes a second
        let mut mission = TestMission::new(&scenario_of(text, "horizon", seed));
        mission.by_ref().take(300).for_each(drop);
        let totals = mission.plant().field().totals();
        let loss_rate = totals.lost_bits as f64 / totals.sampled_bits as f64;
        assert!(loss_rate < 1e-4, "seed {seed}: {loss_rate}; some fill within 70 slots");
    }
}
