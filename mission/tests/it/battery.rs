//! Missions with a base and a battery (decisions D9 to D13): the return rule, and what flight-sim allows any planner.

use std::path::Path;

use crate::support::scenario_of;
use proptest::prelude::*;
use skysink_common::base::Base;
use skysink_common::message::{FlightReport, Mode, Plan};
use skysink_common::scenario::{BaseKeys, Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{SlotRecord, UAV};
use skysink_mission::drive::Observer;
use skysink_mission::origin::RunMode;
use skysink_mission::tally::Tally;
use skysink_mission::{Mission, Plant};
use skysink_planner::strategies::names;

/// Propulsion power [W] by the closed form of Zeng, Xu and Zhang (2019), table I.
fn power_w(v_mps: f64) -> f64 {
    let v2 = v_mps * v_mps;
    let induced = (1.0 + v2 * v2 / (4.0 * 4.03f64.powi(4))).sqrt() - v2 / (2.0 * 4.03f64.powi(2));
    79.86 * (1.0 + 3.0 * v2 / 14_400.0) + 88.63 * induced.sqrt() + 0.5 * 0.6 * 1.225 * 0.05 * 0.503 * v2 * v_mps
}

/// Checks the energy and the mode of each flight after its predecessor.
struct Books {
    side_m: f64,
    capacity_j: f64,
    charge_w: f64,
    base: Base,
    last: FlightReport,
}

impl Books {
    fn new(scenario: &Scenario, plant: &Plant) -> Self {
        let charge_w = scenario.base.as_ref().unwrap().charge_w;
        let capacity_j = scenario.uav.battery.unwrap().capacity_j;
        let side_m = scenario.area.width_m();
        Self { side_m, capacity_j, charge_w, base: scenario.landing_base().unwrap(), last: *plant.flight(UAV) }
    }

    fn is_home(&self) -> bool {
        let at = self.last.position().xy();
        match &self.base {
            Base::Disk { centre, .. } => (at - centre).norm() <= 1.0 + 1e-6,
            Base::Areas(_) | Base::Sites(_) => {
                // A triangle in the south-west corner, and a rectangle.
                let side_m = self.side_m;
                let is_in_triangle = at.x + at.y <= 0.1 * side_m + 2e-6;
                let away_m = (at.x - 0.85 * side_m).abs().max(2.0 * (at.y - 0.7 * side_m).abs());
                is_in_triangle || away_m <= 0.05 * side_m + 2e-6
            }
        }
    }

    fn add(&mut self, record: &SlotRecord, slot_s: f64) {
        let before = self.last;
        let now = record.flights()[UAV];
        let moved_m = now.position() - before.position();
        let mode = now.flown_mode();
        let expected_j = if before.energy_j < 0.0 {
            assert_eq!((mode, moved_m.norm(), now.served), (Mode::Down, 0.0, 0), "slot {}", record.slot());
            before.energy_j
        } else if mode == Mode::Charge {
            assert!(self.is_home() && moved_m.norm() == 0.0 && now.served == 0, "slot {}", record.slot());
            (before.energy_j + self.charge_w * slot_s).min(self.capacity_j)
        } else {
            before.energy_j - slot_s * power_w(moved_m.xy().norm() / slot_s) - 20.0 * moved_m.z.max(0.0)
        };
        assert!((now.energy_j - expected_j).abs() < 1e-6, "slot {}: {} {expected_j}", record.slot(), now.energy_j);
        assert_eq!(now.energy_j < 0.0, mode == Mode::Down, "slot {}", record.slot());
        self.last = now;
    }
}

/// A mission of some strategy with a battery that lasts for a part of it.
fn scenario(seed: u64) -> Scenario {
    let names = names();
    let strategy = names[seed as usize % names.len()];
    let side_m = [120.0, 300.0, 700.0, 1_500.0][seed as usize / 3 % 4];
    let capacity_j = [8_000.0, 15_000.0, 40_000.0][seed as usize / 5 % 3];
    let charge_w = [0.0, 200.0, 1_000.0][seed as usize / 7 % 3];
    let knowledge = ["oracle", "estimated"][seed as usize / 11 % 2];
    let objective = ["loss", "collect"][seed as usize / names.len() % 2];
    let must_land = seed.is_multiple_of(2);
    let areas = if seed % 4 < 2 {
        String::new()
    } else {
        let [a, b, c, d, e] = [0.1, 0.8, 0.9, 0.675, 0.725].map(|part| part * side_m);
        format!("areas_m = [[[0, 0], [{a}, 0], [0, {a}]], [[{b}, {d}], [{c}, {d}], [{c}, {e}], [{b}, {e}]]]\n")
    };
    let text = format!(
        "name = 'x'\nseed = {seed}\nslots = 150\n[area]\nside_m = {side_m:?}\n[sensors]\ncount = 40\n\
         sampling_bps = [100.0, 900.0]\n[base]\n{areas}charge_w = {charge_w:?}\n[uav]\nmust_land = {must_land}\n[uav.battery]\n\
         capacity_j = {capacity_j:?}\n[planner]\nknowledge = '{knowledge}'\nobjective = '{objective}'\n\
         horizon.iterations = 20\noffline.steps = 2000\nbest-of = {{ iterations = 100, window = 10 }}\n"
    );
    scenario_of(&text, strategy)
}

/// Flies the missions of these seeds: no UAV goes below its reserve, and those that have to land are in the base.
fn assert_all_come_home(seeds: impl Iterator<Item = u64>) {
    for seed in seeds {
        let scenario = scenario(seed);
        let list = SensorList::of(&scenario).unwrap();
        let mut tally = Tally::new(&scenario, &list, &RunMode::default());
        let plant = Plant::new(&scenario, &list);
        tally.begin(&plant).unwrap();
        let mut books = Books::new(&scenario, &plant);
        let reserve_j = 0.1 * books.capacity_j;
        for record in Mission::new(&scenario, &list).unwrap() {
            books.add(&record, 1.0);
            tally.slot(&record, &plant).unwrap();
            assert!(books.last.energy_j >= reserve_j - 1e-6, "seed {seed}, slot {}", record.slot());
        }
        let summary = tally.summary(std::time::Duration::ZERO, 0);
        let energy = summary.energy.unwrap();
        let balance_j = books.capacity_j + energy.charged_j - energy.used_j - energy.left_j;
        assert!(balance_j.abs() < 1e-6, "seed {seed}: {energy:?}");
        assert_eq!((summary.landed, energy.down_slot), (Some(books.is_home()), None), "seed {seed}");
        assert!(!scenario.must_land() || books.is_home(), "seed {seed}: {}", scenario.planner.strategy);
    }
}

#[test]
fn every_strategy_returns_with_its_reserve() {
    assert_all_come_home(1..=64);
}

#[test]
fn uavs_with_position_errors_reach_a_base_of_four_standard_deviations() {
    let mut charging = 0;
    for seed in 1..=names().len() as u64 {
        let mut scenario = scenario(seed);
        scenario.uav.position_error_m = Some(2.0);
        let charge_w = scenario.base.as_ref().unwrap().charge_w;
        scenario.base = Some(BaseKeys {
            position_m: Some([scenario.area.width_m() / 2.0; 2]),
            radius_m: Some(8.0),
            charge_w,
            ..BaseKeys::default()
        });
        let list = SensorList::of(&scenario).unwrap();
        let flights: Vec<FlightReport> =
            Mission::new(&scenario, &list).unwrap().map(|record| record.flights()[UAV]).collect();
        assert!(flights.iter().all(|flight| flight.energy_j > 0.0), "{}", scenario.planner.strategy);
        charging += usize::from(flights.iter().any(|flight| flight.flown_mode() == Mode::Charge));
    }
    assert!(charging > 4, "{charging} missions");
}

#[test]
#[ignore = "takes minutes"]
fn a_thousand_missions_return_home() {
    assert_all_come_home(1_000..2_000);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// Whatever is planned, energy is spent and charged by the rules.
    #[test]
    fn no_plan_charges_outside_the_base_or_flies_on_an_empty_battery(
        plans in prop::collection::vec((-50.0f64..50.0, -50.0f64..50.0, 0u32..9, prop::bool::weighted(0.9)), 60)
    ) {
        let text = "name = 'x'\nslots = 60\n[base]\ncharge_w = 300.0\n[uav.battery]\ncapacity_j = 4000.0\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        let mut plant = Plant::new(&scenario, &list);
        let mut books = Books::new(&scenario, &plant);
        let middle = scenario.start();
        for (x_m, y_m, mode, is_there) in plans {
            let here = plant.flight(UAV).position();
            // Often home, so that it may charge.
            let target = if mode % 3 == 0 { here + nalgebra::Vector3::new(x_m, y_m, 0.0) } else { middle };
            let mut plan = Plan { mode, ..Plan::fly_to(target, Mode::Serve) };
            plan.schedule(&[1, 2, 3]);
            plant.step(&[is_there.then_some(plan)]);
            books.add(plant.record(), 1.0);
        }
    }
}
