//! Whole missions of the baselines that go by deadlines, queue weights and ages.

use crate::support::{TestMission, scenario_of};
use skysink_common::message::Mode;
use skysink_common::propulsion::power_w;
use skysink_common::scenario::Scenario;

const BASELINES: [&str; 5] = ["edf", "mes", "max-weight", "drift-plus-penalty", "whittle"];

/// A field with links that limit what is collected, and rates that differ.
const FIELD: &str = "slots = 60\n[area]\nside_m = 150.0\n[sensors]\ncount = 40\nsampling_bps = [100.0, 900.0]\n\
                     [link]\nbandwidth_hz = 1e4\n";

/// Mean propulsion power [W] of a mission.
fn mean_power_w(scenario: &Scenario) -> f64 {
    let mut mission = TestMission::new(scenario);
    let mut position = scenario.start();
    let mut energy_j = 0.0;
    for _ in 0..scenario.slots {
        mission.advance();
        let flown = mission.last_flight().position();
        energy_j += power_w(&scenario.uav.propulsion, (flown - position).norm() / scenario.slot_s) * scenario.slot_s;
        position = flown;
    }
    energy_j / (scenario.slots as f64 * scenario.slot_s)
}

#[test]
fn drift_plus_penalty_at_zero_price_equals_max_weight() {
    let price = |price: &str| format!("{FIELD}[planner]\ndrift-plus-penalty.price_bits2_per_j = {price}\n");
    for seed in 1..=5 {
        let mut plans = TestMission::new(&scenario_of(FIELD, "max-weight", seed));
        let mut free = TestMission::new(&scenario_of(&price("0.0"), "drift-plus-penalty", seed));
        for _ in 0..60 {
            assert_eq!(format!("{:?}", free.advance()), format!("{:?}", plans.advance()), "seed {seed}");
        }
        let power = |text: &str, strategy| mean_power_w(&scenario_of(text, strategy, seed));
        let costs_w = ["0.0", "3e5", "1e8"].map(|value| power(&price(value), "drift-plus-penalty"));
        assert_eq!(costs_w[0], power(FIELD, "max-weight"));
        assert!(costs_w.is_sorted_by(|dear, cheap| dear > cheap), "seed {seed}: {costs_w:?}");
    }
}

#[test]
fn deadline_strategies_fly_in_transit_over_idle_sensor_nodes() {
    let text = "slots = 20\n[area]\nside_m = 300.0\n[sensors]\ncount = 9\nsampling_bps = 0.0\n";
    for strategy in ["edf", "mes", "whittle"] {
        let mut mission = TestMission::new(&scenario_of(text, strategy, 3));
        let queued_bits =
            |mission: &TestMission| mission.queues_bits().iter().map(|&bits| u64::from(bits)).sum::<u64>();
        let before_bits = queued_bits(&mission);
        assert!((0..20).all(|_| mission.advance().mode == Mode::Transit as u32), "{strategy}");
        assert!(queued_bits(&mission) < before_bits, "{strategy}: transit serves whom it passes");
    }
}

#[test]
fn a_lone_sensor_node_loses_nothing_its_link_can_carry() {
    let text = "slots = 100\n[area]\nside_m = 200.0\n[sensors]\ncount = 1\ninitial_queue_mean_bits = 500.0\n\
                sampling_bps = 900.0\n";
    for strategy in BASELINES {
        for seed in 1..=5 {
            let loss_rate = TestMission::new(&scenario_of(text, strategy, seed)).loss_rate();
            assert_eq!(loss_rate, 0.0, "{strategy}, seed {seed}");
        }
    }
}

/// Golden traces: waypoint [m] and schedule of the first slots, and bits lost in the mission.
#[test]
fn missions_are_stable() {
    let trace = |strategy| {
        let mut mission = TestMission::new(&scenario_of(FIELD, strategy, 1));
        let mut plans: Vec<String> = (0..60)
            .map(|_| {
                let plan = mission.advance();
                format!("{:.3} {:.3} {:?}", plan.x_m, plan.y_m, plan.scheduled())
            })
            .collect();
        plans.truncate(3);
        (plans.join(", "), mission.lost_bits())
    };
    let expected = [
        ("76.266 45.027 [17], 64.692 17.349 [14], 59.010 3.761 [39]", 155_727),
        ("96.604 59.389 [18], 76.436 41.005 [17], 65.785 19.925 [14]", 57_147),
        ("45.053 76.779 [21, 23, 28], 29.503 102.434 [1, 37], 14.615 114.926 [25, 30]", 89_037),
        ("49.519 73.898 [21, 23, 28], 37.350 74.721 [11, 23, 28, 36], 29.190 98.778 [1, 37]", 111_226),
        ("76.266 45.027 [17], 64.692 17.349 [14], 59.010 3.761 [39]", 166_644),
    ];
    assert_eq!(BASELINES.map(trace), expected.map(|(plans, lost_bits)| (plans.to_owned(), lost_bits)));
}
