//! Bits that expire (decision D36): the formula of a gap, what missions lose, bounds, and the objective of that name.

use crate::support::scenario_of;
use proptest::prelude::*;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::figures::Summary;
use skysink_mission::origin::RunMode;
use skysink_mission::tally::Tally;
use skysink_mission::trace::TraceHash;
use skysink_mission::{Mission, Plant};
use skysink_planner::bound::mission_bound;
use skysink_planner::gap_costs::GapCosts;
use skysink_planner::mission_table::MissionTable;
use skysink_planner::plan::gaps::Gaps;
use skysink_planner::plan::loss::Loss;
use skysink_planner::plan::model::PlanModel;
use skysink_planner::plan::objective::Objective;
use skysink_planner::settings::Settings;
use std::path::Path;
use std::time::Duration;

/// What a mission loses, and the hash of its trace.
fn flown(scenario: &Scenario) -> (Summary, u64) {
    flown_over(scenario, &SensorList::of(scenario).unwrap())
}

/// The same over the SNs of `list`.
fn flown_over(scenario: &Scenario, list: &SensorList) -> (Summary, u64) {
    let mut tally = Tally::new(scenario, list, &RunMode::default());
    let mut hash = TraceHash::default();
    let mut mission = Mission::new(scenario, list).unwrap();
    mission.drive(&mut [&mut tally, &mut hash], &Stop::default()).unwrap();
    (tally.summary(Duration::ZERO, hash.value()), hash.value())
}

/// A field of 60 SNs with these keys.
fn field(seed: u64, keys: &str) -> String {
    format!(
        "name = 'expiry'\nseed = {seed}\nslots = 120\narea.side_m = 300.0\nsensors.count = 60\n\
         sensors.sampling_bps = [100.0, 900.0]\nplanner.horizon.iterations = 300\n{keys}"
    )
}

/// Data that expire are not delivered, and are no loss in slots of sampling of a sensor node that does not sample.
#[test]
fn expired_data_complete_nothing() {
    let text = "name = 'x'\nslots = 30\narea.side_m = 200.0\nsensors.file = 's.csv'\nsensors.expiry_s = 2.0\n\
                link.comm_radius_m = 5.0\nuav.start_m = [5, 5]\n";
    let scenario = scenario_of(text, "gfs");
    let csv = "x_m,y_m,queue_bits,sampling_bps\n190,190,900,0\n180,190,700,0\n";
    let list = SensorList::parse(csv, Path::new("s.csv"), &scenario).unwrap();
    let (summary, _) = flown_over(&scenario, &list);
    assert_eq!((summary.lost_bits, summary.delivered_bits), (1_600, 0));
    assert_eq!((summary.completed_s, summary.score), (None, Some(0.0)));
    assert_eq!((summary.loss_rate, summary.eta_letter), (1.0, 0.0));
    let mixed = list_with_a_sampling_node(&scenario);
    let (summary, _) = flown_over(&scenario, &mixed);
    assert!(summary.eta_letter.is_finite() && summary.eta_letter > 0.0, "{summary:?}");
}

/// A node that does not sample beside one that does.
fn list_with_a_sampling_node(scenario: &Scenario) -> SensorList {
    let csv = "x_m,y_m,queue_bits,sampling_bps\n190,190,900,0\n180,190,0,700\n";
    SensorList::parse(csv, Path::new("s.csv"), scenario).unwrap()
}

/// What a gap of `gap` slots after a full service in slot `from` loses of bits of `scenario`, slot by slot.
fn simulated_bits(scenario: &Scenario, from: u64, gap: u64) -> u64 {
    let list = SensorList::of(scenario).unwrap();
    let mut ledger = list.ledger(scenario);
    let mut before_bits = 0;
    for slot in 1..=from + gap {
        ledger.sample(slot);
        if slot == from {
            let _ = ledger.upload(0, u64::MAX);
            before_bits = ledger.totals().lost_bits;
        }
    }
    ledger.totals().lost_bits - before_bits
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn the_formula_of_a_gap_is_what_its_slots_lose(
        slot_bits in 1u32..40, capacity_bits in 1u32..700, expiry_slots in 1u64..40, half_slots in any::<bool>(),
        overflow in prop_oneof![Just("newest"), Just("oldest")], from in 1u64..50, gap in 1u64..60,
    ) {
        let slot_s = if half_slots { 0.5 } else { 1.0 };
        let text = format!(
            "name = 'gap'\nslots = 150\nslot_s = {slot_s:?}\nsensors.count = 1\nsensors.capacity_bits = {capacity_bits}\n\
             sensors.sampling_bps = {:?}\nsensors.initial_queue_mean_bits = 0.0\nsensors.expiry_s = {:?}\n\
             sensors.overflow = '{overflow}'\nlink.comm_s = 0.1\nplanner.objective = {{ expiry = 1.0, age = 2.0 }}\n",
            f64::from(slot_bits) / slot_s, expiry_slots as f64 * slot_s,
        );
        let scenario = scenario_of(&text, "horizon");
        let weights = Settings::of(&scenario).unwrap().objective.weights().unwrap();
        let costs = GapCosts::new(&weights, slot_s, scenario.deadline_slots());
        let table = MissionTable::of(&scenario, &SensorList::of(&scenario).unwrap().nodes());
        let model = PlanModel::new::<Gaps>(&scenario, &table, &costs, false, &Stop::default());
        let sensor = &model.sensors[0];
        let lost_bits = simulated_bits(&scenario, from, gap) as f64;
        let [empty, end] = [from, from + gap].map(|slot| slot as f64);
        let found_bits = Loss::visit(sensor, empty, end, f64::INFINITY).0 * Loss::price(sensor);
        prop_assert!((found_bits - lost_bits).abs() < 1e-6, "{} instead of {}", found_bits, lost_bits);
        // A sum counts them beside the ages of the slots of the gap, 1 … g − 1.
        let level = Gaps::later(Gaps::begin(sensor, 0.0, 0.0), empty);
        let ages = slot_s * (gap * (gap - 1)) as f64;
        let cost = Gaps::visit(sensor, level, end, f64::INFINITY).0 * Gaps::price(sensor);
        prop_assert!((cost - lost_bits - ages).abs() < 1e-6, "{} instead of {} + {}", cost, lost_bits, ages);
    }
}

#[test]
fn what_expires_is_a_part_of_the_loss() {
    // An SN of 100 bit a slot out of reach, D = 12: 300 bit expire, and those of the slots 1 to 37 of 50; of 5 300 bit.
    let of_far = |keys: &str, weights: [u32; 2]| {
        let text = format!("name = 'far'\nslots = 50\narea.side_m = 3000.0\nsensors.sampling_bps = 100.0\n{keys}");
        let scenario = scenario_of(&text, "gfs");
        let [heavy, light] = weights;
        let rows = format!("x_m,y_m,queue_bits,sampling_bps,weight\n1,1,300,100,{heavy}\n1,1,0,0,{light}\n");
        let list = SensorList::parse(&rows, Path::new("list.csv"), &scenario).unwrap();
        flown_over(&scenario, &list).0
    };
    for weights in [[1, 1], [3, 1]] {
        let summary = of_far("sensors.expiry_s = 12.9\n", weights);
        assert_eq!((summary.lost_bits, summary.expired_bits), (300 + 3_700, Some(4_000)), "{weights:?}");
        assert_eq!((summary.queued_bits, summary.loss_rate), (1_300, 4_000.0 / 5_300.0));
    }
    let summary = of_far("sensors.expiry_s = 50.0\n", [1, 1]);
    assert_eq!((summary.lost_bits, summary.expired_bits), (0, Some(0)), "none in the mission");
    assert_eq!(of_far("", [1, 1]).expired_bits, None);
}

#[test]
fn expiry_is_the_loss_of_bits_that_expire() {
    for keys in ["sensors.expiry_s = 20.0\n", "sensors.expiry_s = 20.0\nsensors.overflow = 'oldest'\n"] {
        let [loss, expiry, sum] = ["'loss'", "'expiry'", "{ loss = 0.5, expiry = 0.5 }"].map(|objective| {
            flown(&scenario_of(&field(3, &format!("{keys}planner.objective = {objective}\n")), "horizon"))
        });
        assert!(loss.0.expired_bits.unwrap() > 0 && loss.1 == expiry.1 && loss.1 == sum.1, "{keys}");
    }
    let [newest, oldest] = ["newest", "oldest"]
        .map(|overflow| flown(&scenario_of(&field(3, &format!("sensors.overflow = '{overflow}'\n")), "horizon")).1);
    assert_eq!(newest, oldest, "without expiry it only changes ages of data");
}

/// What the plans for bits that do not expire lose of those that do.
fn lost_blindly(scenario: &Scenario) -> u64 {
    let list = SensorList::of(scenario).unwrap();
    let mut lasting = scenario.clone();
    lasting.sensors.expiry_s = None;
    let mut mission = Mission::new(&lasting, &list).unwrap();
    let mut plant = Plant::new(scenario, &list);
    for _ in 0..scenario.slots {
        let plan = mission.plan();
        mission.fly(Some(&plan));
        plant.step(&[Some(plan)]);
    }
    plant.header().totals.lost_bits
}

#[test]
fn a_plan_that_knows_the_expiry_loses_less() {
    let mut better = 0;
    for seed in 1..=5 {
        let keys = "sensors.initial_queue_mean_bits = 0.0\nsensors.expiry_s = 15.0\n";
        let scenario = scenario_of(&field(seed, keys), "horizon");
        better += u32::from(flown(&scenario).0.lost_bits < lost_blindly(&scenario));
    }
    assert!(better >= 4, "{better} of 5");
}

#[test]
fn no_flight_beats_the_bound_where_bits_expire() {
    let mut bounds = 0;
    for seed in 1..=8 {
        for (keys, strategy) in [
            ("sensors.expiry_s = 5.0\nsensors.capacity_bits = 9000\n", "tour"),
            ("sensors.expiry_s = 30.0\nsensors.capacity_bits = 3000\n", "horizon"),
            ("sensors.expiry_s = 30.0\nsensors.overflow = 'oldest'\n", "edf"),
        ] {
            let scenario = scenario_of(&field(seed, keys), strategy);
            let list = SensorList::of(&scenario).unwrap();
            let lost_bits = flown(&scenario).0.lost_bits;
            let bound = mission_bound(&scenario, &list.sensors_of(&scenario), &list.queues_bits(), u64::MAX);
            assert!(bound.loss_bits <= lost_bits, "{strategy}, seed {seed}: {} {lost_bits}", bound.loss_bits);
            bounds += usize::from(bound.loss_bits > 0);
        }
    }
    assert!(bounds > 8, "{bounds} bounds say something");
}
