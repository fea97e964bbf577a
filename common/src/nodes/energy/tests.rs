//! Tests of the batteries of sensor nodes.

use super::*;
use crate::arrivals::Poisson;
use crate::ledger::Ledger;
use crate::nodes::expiry::{Cohorts, Expiry};
use crate::nodes::keys::Overflow;
use crate::nodes::{Answer, NodeFeature, NodeFeatures};
use crate::random::Streams;
use crate::sampling::Sampling;
use proptest::prelude::*;
use std::cmp::Ordering;

/// Batteries that take nothing.
const IDLE: NodeEnergyKeys = NodeEnergyKeys {
    capacity_j: None,
    initial: 1.0,
    harvest_w: 0.0,
    harvest_file: None,
    sleep_w: 0.0,
    sample_j_per_bit: 0.0,
    wake: None,
    listen_w: None,
    wake_j: None,
    tx_w: 0.0,
};

/// SNs that sample 100 bit a slot into 10 000 bit, 50 m apart, with batteries of `capacity_j`, in slots of 2 s.
fn ledger(keys: NodeEnergyKeys, capacity_j: f64, harvest_w: f64, queues_bits: &[u32]) -> Ledger {
    let count = queues_bits.len();
    let sampling = Sampling::new(vec![100.0; count], vec![10_000; count]);
    let batteries = vec![NodeBattery { capacity_j, harvest_w }; count];
    let positions = (0..count).map(|id| Position::new(50.0 * id as f64, 0.0));
    let charges = Charges::new(keys, 2.0, &batteries, None, positions, 10.0);
    Ledger::new(sampling, queues_bits.to_vec()).with_features([charges.into()].into_iter().collect())
}

/// The charges of SNs with batteries.
fn charges(ledger: &Ledger) -> &Charges {
    ledger.features().find::<Charges>().unwrap()
}

#[test]
fn an_unserved_sensor_node_dies_when_sleep_has_taken_its_battery() {
    // ⌈capacity/(sleep τ)⌉, τ = 2 s
    for (capacity_j, sleep_w, death) in [(10.0, 0.5, 10), (10.1, 0.5, 11), (1.0, 1.0, 1), (7.0, 0.25, 14)] {
        let mut ledger = ledger(NodeEnergyKeys { sleep_w, ..IDLE }, capacity_j, 0.0, &[30, 40]);
        for slot in 1..=20 {
            let lost_bits = ledger.sample(slot) + ledger.end_slot(slot, &[]);
            let held_bits = 2 * 100 * slot + 70;
            let expected_bits = match slot.cmp(&death) {
                Ordering::Less => 0,
                Ordering::Equal => held_bits,
                Ordering::Greater => 200,
            };
            assert_eq!(lost_bits, expected_bits, "slot {slot}");
        }
        let found = charges(&ledger).summed_up(0);
        assert_eq!((found.first_death_s, found.half_dead_s), (Some(2.0 * death as f64), Some(2.0 * death as f64)));
        assert_eq!((found.dead, found.energy_per_bit_j, found.residual_mean), (2, None, 0.0));
        let mut answers = Vec::new();
        ledger.fill_answers(&mut answers);
        assert_eq!((ledger.queues_bits(), answers), (&[0, 0][..], vec![Answer::Dead; 2]));
        assert!(ledger.totals().is_balanced() && charges(&ledger).is_balanced());
    }
}

#[test]
fn each_wake_mode_takes_what_its_slots_take() {
    // Sleep 1 W, listening 2 W, 0.01 J for each of 100 bit, slots of 2 s: 2 + 1 J in each slot. SN 0 is served in slot
    // 2 of 3 and sends 200 bit at 50 bit/s: 3 + 4 W · 4 s = 19 J. A UAV is in range of it in slots 2 and 3.
    let keys = NodeEnergyKeys { sleep_w: 1.0, sample_j_per_bit: 0.01, wake_j: Some(3.0), tx_w: 4.0, ..IDLE };
    for (wake, listen_w, used_j) in [
        (None, None, [9 + 19, 9]),
        (Some(WakeMode::Radio), None, [9 + 19, 9]),
        (Some(WakeMode::Always), Some(2.0), [9 + 19 + 12, 9 + 12]),
        (Some(WakeMode::Scheduled), Some(2.0), [9 + 19 + 8, 9]),
    ] {
        let mut ledger = ledger(NodeEnergyKeys { wake, listen_w, ..keys.clone() }, 100.0, 0.0, &[0, 0]);
        for slot in 1..=3 {
            ledger.sample(slot);
            if slot == 2 {
                assert_eq!(ledger.serve(slot, 0, 999, 50.0), 200);
            }
            let uav = if slot >= 2 { Position::new(0.0, 10.0) } else { Position::new(20.0, 0.0) };
            ledger.end_slot(slot, &[uav]);
        }
        let left_nj = used_j.map(|used_j| (100 - used_j) * 1_000_000_000);
        assert_eq!(charges(&ledger).charges_nj(), left_nj, "{wake:?}");
    }
}

#[test]
fn a_full_battery_spills_what_it_harvests_and_a_death_comes_before_the_harvest() {
    let keys = NodeEnergyKeys { sleep_w: 1.0, ..IDLE };
    let mut full = ledger(keys.clone(), 10.0, 1.5, &[0]);
    full.sample(1);
    full.end_slot(1, &[]);
    let NodeEnergyTotals { harvested_nj, spilled_nj, used_nj, .. } = charges(&full).totals();
    assert_eq!([harvested_nj, spilled_nj, used_nj], [3_000_000_000, 1_000_000_000, 2_000_000_000]);
    let mut poor = ledger(keys, 2.0, 1.5, &[7]);
    assert_eq!((poor.sample(1), poor.end_slot(1, &[])), (0, 107));
    assert_eq!((poor.serve(2, 0, 99, 1.0), charges(&poor).charges_nj()), (0, &[0][..]), "for good");
}

/// The SNs one by one: charge [nJ], and whether it is alive.
struct Single {
    charge_nj: u64,
    alive: bool,
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_000))]

    #[test]
    fn all_energy_and_all_bits_are_accounted_for(
        means in prop::collection::vec(prop_oneof![Just(0.0), Just(2.5), 0.0..90.0f64], 1..5),
        capacity_j in prop_oneof![Just(1e-9), 0.1..40.0f64],
        initial in 0.05..=1.0f64,
        harvest_w in prop_oneof![Just(0.0), 0.0..2.0f64],
        powers in [0.0..1.0f64, 0.0..0.01, 0.0..1.0, 0.0..3.0, 0.0..9.0],
        wake in prop_oneof![Just(None), Just(Some(WakeMode::Always)), Just(Some(WakeMode::Scheduled))],
        overflow in prop_oneof![Just(Overflow::Newest), Just(Overflow::Oldest)],
        expiry_slots in prop::option::of(1u64..9),
        seed in prop::option::of(any::<u64>()),
        rows in prop::collection::vec((1u64..40, prop::option::of(0u32..6), 0.0..3.0f64), 0..12),
        services in prop::collection::vec((0usize..6, 0u64..300, 0.0..90.0f64), 1..60),
    ) {
        let [sleep_w, sample_j_per_bit, listen_w, wake_j, tx_w] = powers;
        let keys = NodeEnergyKeys {
            capacity_j: None, initial, harvest_w, harvest_file: None, sleep_w, sample_j_per_bit, wake, listen_w: Some(listen_w),
            wake_j: Some(wake_j), tx_w,
        };
        let mut rows = rows;
        rows.sort_by_key(|&(slot, sensor, _)| (slot, sensor));
        rows.dedup_by_key(|&mut (slot, sensor, _)| (slot, sensor));
        let row = |&(slot, sensor, harvest_w): &(u64, Option<u32>, f64)| {
            format!("{slot},{},{harvest_w}\n", sensor.map_or_else(String::new, |sensor| sensor.to_string()))
        };
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(&file, "slot,sensor,harvest_w\n".to_owned() + &rows.iter().map(row).collect::<String>()).unwrap();
        let harvest = Some(HarvestTrace::read(file.path(), 6).unwrap());
        let harvested_w = |slot: u64, id: usize| {
            let of = |sensor: Option<u32>| rows.iter().filter(move |row| row.1 == sensor);
            let own = Some(id as u32);
            let sensor = if of(own).count() > 0 { own } else { None };
            of(sensor).rfind(|row| row.0 <= slot).map_or(harvest_w, |row| row.2)
        };
        let drawn = seed.map(|seed| Poisson::new(2.0, Streams::new(seed)).into());
        let sampling = Sampling::new(means.clone(), vec![200; means.len()]).with_arrivals(drawn);
        let batteries = vec![NodeBattery { capacity_j, harvest_w }; means.len()];
        let position = |id: usize| Position::new(30.0 * id as f64, 0.0);
        let full = Charges::new(keys, 1.0, &batteries, harvest.clone(), (0..means.len()).map(position), 40.0);
        let initial_bits = vec![50; means.len()];
        let cohorts = expiry_slots.map(|slots| Cohorts::new(Expiry { slots, overflow }, &initial_bits));
        let features: NodeFeatures =
            [full.clone().into()].into_iter().chain(cohorts.map(NodeFeature::from)).collect();
        let new = || Ledger::new(sampling.clone(), initial_bits.clone()).with_features(features.clone());
        let mut ledger = new();
        let mut singly: Vec<Single> = full.charges_nj().iter().map(|&charge_nj| Single { charge_nj, alive: true }).collect();
        for (slot, &(served, capacity_bits, rate_bps)) in (1u64..).zip(&services) {
            let before_bits = ledger.totals().lost_bits;
            let mut lost_bits = ledger.sample(slot);
            let mut sent_nj = 0;
            if served < means.len() {
                let bits = ledger.serve(slot, served, capacity_bits, rate_bps);
                prop_assert!(singly[served].alive || bits == 0);
                sent_nj = nanojoules(wake_j + if bits > 0 { tx_w * (bits as f64 / rate_bps) } else { 0.0 });
            }
            lost_bits += ledger.end_slot(slot, &[position(served)]);
            prop_assert_eq!(ledger.totals().lost_bits, before_bits + lost_bits);
            for (id, single) in singly.iter_mut().enumerate().filter(|(_, single)| single.alive) {
                let is_near = id.abs_diff(served) <= 1;
                let listens = wake == Some(WakeMode::Always) || wake == Some(WakeMode::Scheduled) && is_near;
                let use_nj = nanojoules(sleep_w)
                    .saturating_add(if listens { nanojoules(listen_w) } else { 0 })
                    .saturating_add(nanojoules(sample_j_per_bit * sampling.bits(id, slot) as f64))
                    .saturating_add(if id == served { sent_nj } else { 0 });
                single.charge_nj = single.charge_nj.saturating_sub(use_nj);
                single.alive = single.charge_nj > 0;
                let more_nj = if single.alive { nanojoules(harvested_w(slot, id)) } else { 0 };
                single.charge_nj = (single.charge_nj + more_nj).min(nanojoules(capacity_j).max(1));
            }
            let charges = charges(&ledger);
            prop_assert!(charges.is_balanced() && ledger.totals().is_balanced());
            prop_assert!(charges.charges_nj().iter().eq(singly.iter().map(|single| &single.charge_nj)));
            let dead = |id: usize| !singly[id].alive;
            prop_assert!((0..means.len()).all(|id| !dead(id) || ledger.queues_bits()[id] == 0));
            prop_assert!(charges.lost_bits <= ledger.totals().lost_bits);
            let mut bytes = Vec::new();
            ledger.features().save(&mut bytes);
            let mut again = new();
            prop_assert!(again
                .restore(slot, ledger.queues_bits(), ledger.delivered_bits(), ledger.drawn_bits(), &bytes)
                .is_ok());
            prop_assert_eq!(again.features(), ledger.features());
            let mut next = ledger.clone();
            prop_assert_eq!(again.sample(slot + 1), next.sample(slot + 1));
            prop_assert_eq!(&again, &next);
        }
    }
}
