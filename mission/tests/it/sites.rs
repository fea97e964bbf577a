//! Missions with several bases, each with a charger of its own (decision D34).

use std::time::Duration;

use crate::support::scenario_of;
use rayon::prelude::*;
use skysink_common::base::{Base, Charger};
use skysink_common::battery::Battery;
use skysink_common::message::{FlightReport, HoldReason, Mode, Plan};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::SlotRecord;
use skysink_mission::drive::{Observer, SlotSink};
use skysink_mission::figures::Summary;
use skysink_mission::origin::RunMode;
use skysink_mission::summary::{EnergyUse, RunTiming};
use skysink_mission::tally::Tally;
use skysink_mission::trace::TraceHash;
use skysink_mission::{Mission, Plant};

/// The slots of a mission and its summary.
fn flown(scenario: &Scenario) -> (Vec<SlotRecord>, Summary) {
    let list = SensorList::of(scenario).unwrap();
    let mut tally = Tally::new(scenario, &list, &RunMode::default());
    let plant = Plant::new(scenario, &list);
    tally.begin(&plant).unwrap();
    let mut hash = TraceHash::default();
    let mut slots = Vec::new();
    for record in Mission::new(scenario, &list).unwrap() {
        tally.add(&record).unwrap();
        hash.add(&record).unwrap();
        slots.push(record);
    }
    let summary = tally.summary(Duration::ZERO, hash.value());
    (slots, Summary { timing: RunTiming::default(), ..summary })
}

#[test]
fn the_time_before_a_pad_counts_as_waiting_not_as_charging() {
    // Two UAVs on one pad, slots of 2 s: the first charges 200 J in each of slots 1 to 3, and the second in slots 4 to
    // 6.
    let text = "name = 'x'\nslots = 7\nslot_s = 2.0\n[sensors]\ncount = 2\n[uav]\ncount = 2\n\
                [uav.battery]\ncapacity_j = 1000.0\ninitial = 0.5\n\
                [[base.site]]\nposition_m = [50, 50]\ncharge_w = 100.0\npads = 1\n";
    let scenario = scenario_of(text, "tour");
    let list = SensorList::of(&scenario).unwrap();
    let mut plant = Plant::new(&scenario, &list);
    let mut tally = Tally::new(&scenario, &list, &RunMode::default());
    tally.begin(&plant).unwrap();
    let charge = Some(Plan::fly_to([50.0, 50.0, 20.0], Mode::Charge));
    for _ in 0..7 {
        plant.step(&[charge; 2]);
        tally.slot(plant.record(), &plant).unwrap();
    }
    let summary = tally.summary(Duration::ZERO, 0);
    let energy = summary.energy.unwrap();
    let expected = EnergyUse {
        charged_j: 1_000.0,
        left_j: 2_000.0,
        charged_s: 14.0 + 8.0, // all 7 slots, and the last 4
        pad_wait_s: Some(6.0),
        ..EnergyUse::default()
    };
    assert_eq!((energy, summary.refused, summary.held_slots), (expected, 3, 0));
}

#[test]
fn one_site_is_the_base() {
    let mut charged = 0;
    for (number, strategy) in ["tour", "edf", "mes", "horizon", "offline"].into_iter().enumerate() {
        for (uav, place, keys) in [
            ("must_land = true\n", "position_m = [40, 60]\nradius_m = 9.0\n", "charge_w = 900.0\n"),
            ("count = 3\n", "position_m = [150, 150]\nradius_m = 15.0\n", "charge_w = 400.0\n"),
            (
                "count = 2\ncoordination = 'sequential'\nposition_error_m = 2.0\n",
                "position_m = [90, 90]\nradius_m = 9.0\n",
                "charge_w = 900.0\n",
            ),
            ("", "areas_m = [[[0, 0], [60, 0], [0, 40]]]\n", "charge_w = 500.0\n"),
        ] {
            let text = |base: &str| {
                format!(
                    "name = 'x'\nseed = {number}\nslots = 90\n[area]\nside_m = 300.0\n[sensors]\ncount = 40\n\
                     sampling_bps = [100.0, 900.0]\n[uav]\n{uav}[uav.battery]\ncapacity_j = 9000.0\n[planner]\n\
                     horizon.iterations = 30\noffline.steps = 3000\n{base}"
                )
            };
            let (_, single) = flown(&scenario_of(&text(&format!("[base]\n{place}{keys}")), strategy));
            let place = place.replace("areas_m = [", "area_m = ").replace("]]]", "]]");
            let (_, site) = flown(&scenario_of(&text(&format!("[[base.site]]\n{place}{keys}")), strategy));
            let energy = site.energy.map(|energy| EnergyUse { pad_wait_s: None, ..energy });
            assert_eq!(site.energy.unwrap().pad_wait_s, Some(0.0));
            charged += u32::from(single.energy.unwrap().charged_j > 0.0);
            assert_eq!((&single, single.energy), (&Summary { energy, ..site.clone() }, energy), "{strategy}, {uav}");
        }
    }
    assert!(charged >= 12, "{charged} missions with a charge");
}

/// A mission of a fleet that has two sites of different kinds.
fn scenario(seed: u64) -> Scenario {
    let strategy = ["horizon", "tour"][seed as usize % 2];
    let side_m = [200.0, 400.0, 800.0][seed as usize / 2 % 3];
    let coordination = ["partition", "sequential", "independent"][seed as usize / 6 % 3];
    let pads = 1 + seed / 3 % 2;
    let count = 1 + seed / 5 % 4;
    let [low, high, east, north] = [0.2, 0.3, 0.75, 0.6].map(|part| part * side_m);
    let charger = ["charge_w = 1500.0", "swap_s = 6.0", "charge_w = 300.0"][seed as usize / 4 % 3];
    let keys = format!(
        "name = 'x'\nseed = {seed}\nslots = 60\n[area]\nside_m = {side_m:?}\n[sensors]\ncount = 30\n\
         sampling_bps = [100.0, 900.0]\n[uav]\ncount = {count}\ncoordination = '{coordination}'\nmust_land = true\n\
         [uav.battery]\ncapacity_j = 14000.0\n[planner]\nhorizon.iterations = 10\n\
         [[base.site]]\narea_m = [[{low}, {low}], [{high}, {low}], [{high}, {high}]]\n{charger}\npads = {pads}\n\
         [[base.site]]\nposition_m = [{east}, {north}]\nradius_m = 9.0\nswap_s = 4.0\npads = {pads}\n"
    );
    scenario_of(&keys, strategy)
}

/// What the sites allow a slot.
struct Sites {
    base: Base,
    battery: Battery,
}

impl Sites {
    /// Checks the energy of `now` after `before`, which has been swapped for `swapped` slots; returns these with the
    /// slot.
    fn check(&self, before: &FlightReport, now: &FlightReport, swapped: u64, at: &str) -> u64 {
        let ground = now.position().xy();
        let charger: Option<&Charger> = self.base.charger_at(&ground);
        let Battery { capacity_j, .. } = self.battery;
        let (swapped, expected_j) = match now.flown_mode() {
            Mode::Charge if now.hold == HoldReason::Pad as u32 => (0, before.energy_j),
            Mode::Charge => {
                assert!(charger.is_some() && now.position() == before.position(), "{at}");
                let Charger { charge_w, swap_slots, .. } = *charger.unwrap();
                match swap_slots {
                    Some(_) if before.energy_j == capacity_j => (0, capacity_j),
                    Some(slots) if swapped + 1 >= slots => (swapped + 1, capacity_j),
                    Some(_) => (swapped + 1, before.energy_j),
                    None => (0, (before.energy_j + charge_w).min(capacity_j)),
                }
            }
            _ => (0, self.battery.flown_j(before.energy_j, &before.position(), &now.position())),
        };
        assert!((now.energy_j - expected_j).abs() < 1e-6, "{at}: {} J, expected {expected_j} J", now.energy_j);
        swapped
    }
}

#[test]
fn two_sites_keep_fleets_in_the_air_and_their_energy_in_balance() {
    let missions: Vec<[bool; 3]> = (1..=60).into_par_iter().map(keep_sites).collect();
    let [waits, charges, both] = [0, 1, 2].map(|what| missions.iter().filter(|has| has[what]).count());
    let counts = format!("{waits} missions with waits, {charges} with charges, {both} with both sites");
    assert!(waits > 3 && charges > 25 && both > 12, "{counts}");
}

/// Checks a mission, and whether a UAV waited for a pad, and charged, and whether both sites were visited.
fn keep_sites(seed: u64) -> [bool; 3] {
    let scenario = scenario(seed);
    let sites = Sites { base: scenario.landing_base().unwrap(), battery: Battery::of(&scenario) };
    let list = SensorList::of(&scenario).unwrap();
    let uavs = scenario.uav.uavs();
    let mut before = Plant::new(&scenario, &list).flights().clone();
    let mut swapped = vec![0; uavs];
    let (slots, summary) = flown(&scenario);
    let mut visited = [false; 2];
    for record in &slots {
        let mut taken = [0; 2];
        let begun = swapped.clone();
        let charges_at = |uav: usize| {
            let now = &record.flights()[uav];
            let is_low = before[uav].energy_j < sites.battery.capacity_j;
            let charges = is_low && now.flown_mode() == Mode::Charge && now.hold != HoldReason::Pad as u32;
            sites.base.site_at(&now.position().xy()).filter(|_| charges)
        };
        for (uav, now) in record.flights().iter().enumerate() {
            let at = format!("seed {seed}, slot {}, UAV {uav}", record.slot());
            assert!(now.energy_j >= 0.0, "{at}: down");
            swapped[uav] = sites.check(&before[uav], now, swapped[uav], &at);
            if now.flown_mode() == Mode::Charge {
                let site = sites.base.site_at(&now.position().xy()).unwrap();
                let is_waiting = now.hold == HoldReason::Pad as u32;
                taken[site] += u32::from(charges_at(uav) == Some(site));
                visited[site] = true;
                // Only behind as many UAVs as there are pads, of lower number or in a swap that they have begun, and
                // never in a swap of its own.
                let swapping = (uav + 1..uavs).filter(|&other| begun[other] > 0 && charges_at(other) == Some(site));
                let ahead = taken[site] + swapping.count() as u32;
                let has_swap = begun[uav] > 0 && sites.base.site_at(&before[uav].position().xy()) == Some(site);
                assert!(!is_waiting || ahead == sites.base.sites()[site].charger.pads && !has_swap, "{at}");
            }
        }
        assert!((0..2).all(|site| taken[site] <= sites.base.sites()[site].charger.pads), "seed {seed}");
        before.clone_from(record.flights());
    }
    let energy = summary.energy.unwrap();
    let balance_j = uavs as f64 * 14_000.0 + energy.charged_j - energy.used_j - energy.left_j;
    assert!(balance_j.abs() < 1e-5, "seed {seed}: {energy:?}");
    assert_eq!((summary.landed, energy.down_slot), (Some(true), None), "seed {seed}");
    [energy.pad_wait_s.unwrap() > 0.0, energy.charged_j > 0.0, visited == [true; 2]]
}
