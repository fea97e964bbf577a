//! The field from outside: what it tells the UAV, what it counts, and which states it resumes from.

use std::path::Path;

use skysink_common::belief::Belief;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::estimate::Rates;
use skysink_common::message::{FlightReport, LinkReport, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_field_sim::{Field, SlotBits};

/// A scenario of `slots` slots of `slot_s` [s].
fn scenario(slots: u64, slot_s: f64) -> Scenario {
    let text = format!(
        "name = 'a'\nslots = {slots}\nslot_s = {slot_s:?}\n[uav]\nendurance_s = 1e7\n[sensors]\ncapacity_bits = 30_000\n"
    );
    Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap()
}

/// Two SNs with these queues [bit] and rates [bit/s].
fn list(scenario: &Scenario, sensors: [(u32, f64); 2]) -> SensorList {
    let rows: String = sensors.iter().map(|(queue, rate_bps)| format!("10,10,{queue},{rate_bps:?}\n")).collect();
    let list = format!("x_m,y_m,queue_bits,sampling_bps\n{rows}");
    SensorList::parse(&list, Path::new("list.csv"), scenario).unwrap()
}

fn field(sensors: [(u32, f64); 2]) -> Field {
    let scenario = scenario(600, 1.0);
    Field::new(&scenario, &list(&scenario, sensors))
}

/// The same with an account of what the UAV knows, which learns the rates.
fn telling(sensors: [(u32, f64); 2]) -> Field {
    let scenario = scenario(600, 1.0);
    let list = list(&scenario, sensors);
    Field::new(&scenario, &list).with_belief(Belief::of(&scenario, &list, Some(Rates::Learnt)))
}

fn serving_nobody() -> [FlightReport; 1] {
    [FlightReport::at([10.0, 10.0, 20.0], Mode::Serve)]
}

fn serving_first(capacity_bits: u64) -> [FlightReport; 1] {
    let [mut report] = serving_nobody();
    report.links[0] = LinkReport { capacity_bits, ..LinkReport::default() };
    report.served = 1;
    [report]
}

fn saved(field: &Field) -> Vec<u8> {
    let mut bytes = Vec::new();
    field.save(&mut bytes);
    bytes
}

#[test]
fn the_belief_has_the_remaining_queue_and_infers_the_rate_on_the_next_visit() {
    let mut field = telling([(10_000, 700.0), (0, 100.0)]);
    field.step(1, &serving_first(6_000)).unwrap();
    assert_eq!(field.believed_bits()[0], 4_700, "10 000 + 700 − 6 000");
    field.step(2, &serving_nobody()).unwrap();
    field.step(3, &serving_first(60_000)).unwrap();
    assert_eq!(field.believed_bits()[0], 0);
    field.step(4, &serving_nobody()).unwrap();
    assert_eq!(field.believed_bits()[0], 700, "5 400 were found when slot 3 began: 700 in slot 2");
}

#[test]
fn a_state_with_inconsistent_reports_is_refused() {
    let sensors = [(1, 2.0), (3, 4.0)];
    assert!(telling(sensors).restore(&saved(&field(sensors))).is_err());
    assert!(field(sensors).restore(&saved(&telling(sensors))).is_err());
    assert!(telling(sensors).restore(&saved(&telling(sensors))).is_ok());
}

#[test]
fn only_states_up_to_the_last_slot_are_restored() {
    let flown = |slots| {
        let scenario = scenario(slots, 1.0);
        let mut field = Field::new(&scenario, &list(&scenario, [(1, 2.0), (3, 4.0)]));
        (1..=slots).for_each(|slot| assert!(field.step(slot, &serving_nobody()).is_ok()));
        field
    };
    let mut restored = field([(1, 2.0), (3, 4.0)]);
    restored.restore(&saved(&flown(600))).unwrap();
    assert_eq!(restored.slot(), 600);
    assert!(restored.restore(&saved(&flown(601))).is_err());
}

#[test]
fn a_single_lost_bit_counts_in_slots_of_sampling() {
    let mut field = field([(29_997, 4.0), (0, 5.0)]);
    let bits = field.step(1, &serving_nobody()).unwrap();
    assert_eq!(bits, SlotBits { delivered_bits: 0, lost_bits: 1 });
    assert_eq!(field.totals().lost_slots, 0.25);
}

#[test]
fn bits_beyond_the_fast_conversion_are_counted_exactly() {
    let scenario = scenario(1_300, 1_000.0);
    let sensors = [(0, 1.0), (0, 4e9 + 0.001)];
    let mut field = Field::new(&scenario, &list(&scenario, sensors));
    (1..=1_300).for_each(|slot| assert!(field.step(slot, &serving_nobody()).is_ok()));
    // 4e12 + 1 bits in each slot, so many that their number exceeds 2^52 from slot 1126 on.
    let sampled_bits = 1_300 * (1_000 + 4_000_000_000_001u64);
    assert_eq!(field.totals().sampled_bits, sampled_bits);
    assert_eq!(field.totals().lost_bits, sampled_bits - 2 * 30_000);
    assert_eq!(field.lost_bits().collect::<Vec<_>>(), [1_270_000, 1_300 * 4_000_000_000_001 - 30_000]);
}
