//! The steps of one slot, by themselves: planning by strategy and solver, the field, and a whole mission.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use skysink_common::geometry::{Position, above};
use skysink_common::message::{FlightReport, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_field_sim::Field;
use skysink_mission::mission::Mission;
use skysink_planner::Planner;
use skysink_planner::settings;

/// The letter's mission with another strategy and solver.
fn letter(strategy: &'static str, solver: &str) -> Scenario {
    let text = format!("name = \"bench\"\n[planner]\nwaypoint_solver = \"{solver}\"\n");
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    Scenario::parse(&text, Path::new("bench.toml"), overrides).and_then(settings::resolve).expect("a valid scenario")
}

/// The states of a mission: positions and queues before each slot.
fn states(scenario: &Scenario, list: &SensorList) -> Vec<(Position, f64, Vec<u32>)> {
    let mut mission = Mission::new(scenario, list).unwrap();
    let mut states = Vec::new();
    loop {
        let flight = mission.last_flight();
        states.push((flight.position().xy(), flight.z_m, mission.queues_bits().to_vec()));
        if mission.next().is_none() {
            return states;
        }
    }
}

fn plan(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("plan a slot, N = 200");
    for (name, strategy, solver) in [
        ("rfs", "rfs", "geometric"),
        ("gfs", "gfs", "geometric"),
        ("uts, geometric waypoint", "uts", "geometric"),
        ("uts, clarabel waypoint", "uts", "clarabel"),
    ] {
        let scenario = letter(strategy, solver);
        let list = SensorList::of(&scenario).expect("drawn");
        let states = states(&scenario, &list);
        let mut planner = Planner::new(&scenario, &list.nodes()).unwrap();
        let mut slots = (1..).zip(states.iter().take(600)).cycle();
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                let (slot, (position, altitude_m, queues)) = slots.next().expect("endless");
                black_box(planner.step(slot, above(position, *altitude_m), queues))
            });
        });
    }
}

fn field(criterion: &mut Criterion) {
    let scenario = letter("uts", "geometric");
    let list = SensorList::of(&scenario).expect("drawn");
    let mut field = Field::new(&scenario, &list);
    let nobody = FlightReport::at([50.0, 50.0, 20.0], Mode::Hold);
    let mut slot = 0;
    criterion.bench_function("live through a slot, N = 200", |bencher| {
        bencher.iter(|| {
            slot += 1;
            black_box(field.step(slot, &nobody))
        });
    });
}

fn mission(criterion: &mut Criterion) {
    let scenario = letter("uts", "geometric");
    let list = SensorList::of(&scenario).expect("drawn");
    criterion.bench_function("the letter's mission in one process, 600 slots", |bencher| {
        bencher.iter(|| {
            for flown in Mission::new(&scenario, &list).unwrap() {
                black_box(&flown);
            }
        });
    });
}

criterion_group!(benches, plan, field, mission);
criterion_main!(benches);
