//! A slot's plan with line of sight by chance, four sensor nodes and a free altitude, by both solvers, beside one bare
//! Clarabel solve of a program of the same size: 11 variables, 5 + 4 second-order and 4 exponential cones.

use std::hint::black_box;
use std::path::Path;

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{ExponentialConeT, NonnegativeConeT, SecondOrderConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use criterion::{Criterion, criterion_group, criterion_main};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_mission::mission::Mission;
use skysink_planner::Planner;
use skysink_planner::settings;

/// Sensor nodes of the bare program, metres from the UAV, which is 60 m up.
const PLACES_M: [[f64; 2]; 4] = [[20.0, 0.0], [-25.0, 10.0], [5.0, -30.0], [-10.0, 35.0]];

fn plan(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("plan a slot in three dimensions, n = 4");
    for solver in ["geometric", "clarabel"] {
        let text = include_str!("../scenarios/plos-dense-urban.toml");
        let text = format!("{text}waypoint_solver = \"{solver}\"\n");
        let scenario = Scenario::parse(&text, Path::new("bench.toml"), Overrides::default())
            .and_then(settings::resolve)
            .expect("a valid scenario");
        let list = SensorList::of(&scenario).expect("drawn");
        let mut mission = Mission::new(&scenario, &list).unwrap();
        let mut states = Vec::new();
        while {
            let flight = *mission.last_flight();
            states.push((flight, mission.queues_bits().to_vec()));
            mission.next().is_some()
        } {}
        let mut planner = Planner::new(&scenario, &list.nodes()).unwrap();
        let mut slots = (1..).zip(states.iter().take(300)).cycle();
        group.bench_function(solver, |bencher| {
            bencher.iter(|| {
                let (slot, (flight, queues)) = slots.next().expect("endless");
                black_box(planner.step(slot, flight.position(), queues))
            });
        });
    }
    group.bench_function("one bare Clarabel solve of that size", |bencher| bencher.iter(|| black_box(bare())));
    group.finish();
}

/// One convex step's program, made and solved.
fn bare() -> f64 {
    let (mut rows, mut columns, mut values, mut offsets) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut row = |offset: f64, factors: &[(usize, f64)]| {
        for &(column, factor) in factors {
            rows.push(offsets.len());
            columns.push(column);
            values.push(factor);
        }
        offsets.push(offset);
    };
    let mut cones = vec![NonnegativeConeT(2)];
    row(1.0, &[(2, 1.0)]);
    row(0.6, &[(2, -1.0)]);
    let mut linear = vec![0.0; 11];
    for [x, y] in [[0.0, 0.0]].into_iter().chain(PLACES_M) {
        cones.push(SecondOrderConeT(3));
        row(1.0, &[]);
        row(-x / 60.0, &[(0, -1.0)]);
        row(-y / 60.0, &[(1, -1.0)]);
    }
    for (place, [x, y]) in PLACES_M.into_iter().enumerate() {
        let (v, w) = (3 + 2 * place, 4 + 2 * place);
        let distance = (x * x + y * y + 3600.0f64).sqrt();
        let (sine, cosine) = (60.0 / distance, x.hypot(y) / distance);
        let (tilt, growth) = (sine / distance, 0.11 * (1.0 / cosine).to_degrees());
        linear[w] = 0.05;
        cones.extend([SecondOrderConeT(5), ExponentialConeT()]);
        row(1.0, &[]);
        row(-tilt * x, &[(0, -tilt * 60.0)]);
        row(-tilt * y, &[(1, -tilt * 60.0)]);
        row(1.0 - tilt * 60.0, &[(2, tilt * 60.0)]);
        row(0.0, &[(v, -1.0)]);
        row(growth * sine, &[(v, growth)]);
        row(1.0, &[]);
        row(0.0, &[(w, -1.0)]);
    }
    let constraints = CscMatrix::new_from_triplets(offsets.len(), 11, rows, columns, values);
    let quadratic = CscMatrix::new_from_triplets(11, 11, vec![0, 1, 2], vec![0, 1, 2], vec![0.8; 3]);
    let settings = DefaultSettings { verbose: false, max_threads: 1, ..DefaultSettings::default() };
    let mut solver = DefaultSolver::new(&quadratic, &linear, &constraints, &offsets, &cones, settings)
        .expect("the shapes agree by construction");
    solver.solve();
    assert_eq!(solver.solution.status, SolverStatus::Solved);
    solver.solution.obj_val
}

criterion_group!(benches, plan);
criterion_main!(benches);
