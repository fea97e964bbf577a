//! A slot's plan: with the grid, without, and a bare loop over the sensor nodes that could matter; and its waypoint by
//! both solvers, beside bare Clarabel.
//!
//! The UAV flies: queues grow and are emptied between the slots, unmeasured, as the letter's are.

use std::hint::black_box;
use std::path::Path;
use std::time::{Duration, Instant};

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use criterion::{Bencher, Criterion, criterion_group, criterion_main};
use skysink_common::geometry::{Position, above, within};
use skysink_common::message::Plan;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_planner::Planner;
use skysink_planner::geometry::disks::{Disk, project};
use skysink_planner::geometry::grid::Grid;
use skysink_planner::sensor_table::SensorTable;
use skysink_planner::strategies::stateless;
use skysink_planner::strategies::transit::transit_waypoint;
use skysink_planner::waypoint::conic::ConicSolver;
use skysink_planner::waypoint::plane;
use skysink_planner::waypoint::problem::Problem;

/// Slots after which a flight begins again: few enough that no queue far from the UAV is full.
const SLOTS: u64 = 150;

/// The letter's scenario with `count` sensor nodes (SNs) at its density.
fn letter(count: u32, strategy: &'static str) -> Scenario {
    let side_m = 100.0 * (f64::from(count) / 200.0).sqrt();
    let text = format!("name = \"bench\"\n[area]\nside_m = {side_m:?}\n[sensors]\ncount = {count}\n");
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    Scenario::parse(&text, Path::new("bench.toml"), overrides).expect("a valid scenario")
}

/// A UAV under way, and the queues under it.
struct Flight<'a> {
    scenario: &'a Scenario,
    initial_bits: &'a [u32],
    queues_bits: Vec<u32>,
    position: Position,
    slot: u64,
}

impl<'a> Flight<'a> {
    fn new(scenario: &'a Scenario, initial_bits: &'a [u32]) -> Self {
        Self { scenario, initial_bits, queues_bits: initial_bits.to_vec(), position: scenario.start().xy(), slot: 1 }
    }

    /// Advances by the slot of a plan, which empties what it serves.
    fn live(&mut self, plan: &Plan) {
        plan.scheduled().iter().for_each(|&id| self.queues_bits[id as usize] = 0);
        let capacity_bits = self.scenario.sensors.capacity_bits;
        self.queues_bits.iter_mut().for_each(|queue_bits| *queue_bits = (*queue_bits + 100).min(capacity_bits));
        self.position = Position::new(plan.x_m, plan.y_m);
        self.slot += 1;
        if self.slot.is_multiple_of(SLOTS) {
            self.queues_bits.copy_from_slice(self.initial_bits);
        }
    }
}

/// Times the steps of `planner` alone; what is measured includes reading the clock, some 30 ns.
fn fly(bencher: &mut Bencher, flight: &mut Flight, planner: &mut Planner) {
    bencher.iter_custom(|slots| {
        let mut taken = Duration::ZERO;
        for _ in 0..slots {
            let begin = Instant::now();
            let plan = black_box(planner.step(flight.slot, above(&flight.position, 20.0), &flight.queues_bits));
            taken += begin.elapsed();
            flight.live(&plan);
        }
        taken
    });
}

/// One look at each SN within `V τ + d_c` of the UAV, as little as any search over them can do.
fn look(bencher: &mut Bencher, flight: &mut Flight, table: &SensorTable, planner: &mut Planner) {
    bencher.iter_custom(|slots| {
        let mut taken = Duration::ZERO;
        for _ in 0..slots {
            let mut candidates = Vec::new();
            table.grid.visit_within(&flight.position, table.reach_m + table.comm_radius_m, |node| {
                candidates.push((node.position, flight.queues_bits[node.id as usize]));
            });
            let begin = Instant::now();
            let in_reach = candidates.iter().filter(|(position, _)| within(position, &flight.position, table.reach_m));
            black_box(in_reach.map(|&(_, queue_bits)| u64::from(queue_bits)).sum::<u64>());
            taken += begin.elapsed();
            flight.live(&planner.step(flight.slot, above(&flight.position, 20.0), &flight.queues_bits));
        }
        taken
    });
}

fn plans(criterion: &mut Criterion) {
    for count in [200, 10_000, 1_000_000] {
        let mut group = criterion.benchmark_group(format!("plan a slot, N = {count}"));
        group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2)).sample_size(20);
        for strategy in stateless() {
            let scenario = letter(count, strategy);
            let list = SensorList::of(&scenario).expect("drawn");
            let nodes = list.nodes();
            let initial_bits = list.queues_bits();
            let table = SensorTable::new(&scenario, &nodes);
            let mut planner = Planner::over(&scenario, &nodes, table.clone()).unwrap();
            let mut flight = Flight::new(&scenario, &initial_bits);
            group.bench_function(strategy, |bencher| fly(bencher, &mut flight, &mut planner));
            let undivided = SensorTable { grid: Grid::new(&table.positions, f64::INFINITY), ..table.clone() };
            let mut without = Planner::over(&scenario, &nodes, undivided).unwrap();
            let mut flight = Flight::new(&scenario, &initial_bits);
            group.bench_function(format!("{}, no grid", strategy), |bencher| {
                fly(bencher, &mut flight, &mut without);
            });
            if strategy == "uts" {
                let equal_bits = vec![30_000; count as usize];
                for (name, queues_bits) in [("transit", &initial_bits), ("transit, all queues equal", &equal_bits)] {
                    group.bench_function(name, |bencher| {
                        bencher.iter(|| {
                            black_box(transit_waypoint(
                                &table.positions,
                                table.reach_m,
                                &scenario.start().xy(),
                                queues_bits,
                            ))
                        });
                    });
                }
                let mut flight = Flight::new(&scenario, &initial_bits);
                group.bench_function("bare loop over the candidates", |bencher| {
                    look(bencher, &mut flight, &table, &mut planner);
                });
            }
        }
    }
}

/// Slots of the letter's mission: where the UAV is, and whom it serves.
struct Slots {
    table: SensorTable,
    slots: Vec<(Position, Vec<u32>)>,
    /// The same as projections of a target onto disks: reach, and the ranges of four SNs.
    problems: Vec<(Position, Vec<Disk>)>,
}

fn slots_with_four() -> Slots {
    let scenario = letter(200, "uts");
    let list = SensorList::of(&scenario).expect("drawn");
    let nodes = list.nodes();
    let initial_bits = list.queues_bits();
    let mut planner = Planner::new(&scenario, &nodes).unwrap();
    let mut flight = Flight::new(&scenario, &initial_bits);
    let (mut slots, mut problems) = (Vec::new(), Vec::new());
    while problems.len() < 500 {
        let plan = planner.step(flight.slot, above(&flight.position, 20.0), &flight.queues_bits);
        let place = |&id: &u32| Position::new(nodes[id as usize].x_m, nodes[id as usize].y_m);
        let places: Vec<Position> = plan.scheduled().iter().map(place).collect();
        if places.len() == 4 {
            let sum: nalgebra::Vector2<f64> = places.iter().map(|place| place.coords).sum();
            let disk = |centre| Disk { centre, radius_m: scenario.link.comm_radius_m };
            let mut disks = vec![Disk { centre: flight.position, radius_m: scenario.reach_m() }];
            disks.extend(places.into_iter().map(disk));
            problems.push((Position::from(sum / 4.0), disks));
            slots.push((flight.position, plan.scheduled().to_vec()));
        }
        flight.live(&plan);
    }
    Slots { table: SensorTable::new(&scenario, &nodes), slots, problems }
}

/// The data of a problem as Clarabel takes it, lengths in units of the communication radius.
fn cone_program((target, disks): &(Position, Vec<Disk>)) -> (Vec<f64>, Vec<f64>) {
    let unit_m = disks[1].radius_m;
    let column = || disks.iter().map(|disk| -unit_m / disk.radius_m);
    let offsets = disks.iter().flat_map(|disk| {
        let from_target = (disk.centre - target) / disk.radius_m;
        [1.0, -from_target.x, -from_target.y]
    });
    (column().chain(column()).collect(), offsets.collect())
}

/// A solver of five disks with the settings of [`ConicSolver`].
fn bare_solver() -> DefaultSolver<f64> {
    let rows = (0..5).map(|disk| 3 * disk + 1).chain((0..5).map(|disk| 3 * disk + 2)).collect();
    let constraints = CscMatrix::new(15, 2, vec![0, 5, 10], rows, vec![-1.0; 10]);
    let offsets: Vec<f64> = [1.0, 0.0, 0.0].repeat(5);
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .max_threads(1)
        .direct_solve_method("qdldl".to_owned())
        .presolve_enable(false)
        .equilibrate_enable(false)
        .tol_feas(1e-9)
        .tol_gap_abs(1e-11)
        .tol_gap_rel(1e-11)
        .build()
        .expect("every setting is one that Clarabel knows");
    let cones = [const { SupportedConeT::SecondOrderConeT(3) }; 5];
    DefaultSolver::new(&CscMatrix::identity(2), &[0.0; 2], &constraints, &offsets, &cones, settings)
        .expect("the shapes agree by construction")
}

fn waypoints(criterion: &mut Criterion) {
    let Slots { table, slots, problems } = slots_with_four();
    let mut group = criterion.benchmark_group("waypoint, n = 4");
    group.measurement_time(Duration::from_secs(3)).sample_size(50);
    let (mut problem, mut next) = (Problem::new(&table), slots.iter().cycle());
    group.bench_function("geometric, with its centroid", |bencher| {
        bencher.iter(|| {
            let (position, ids) = next.next().expect("endless");
            problem.pose(&table, position, [20.0; 2], ids);
            black_box(plane::solve(&problem, None, 1))
        });
    });
    let mut next = problems.iter().cycle();
    group.bench_function("geometric", |bencher| {
        bencher.iter(|| {
            let (target, disks) = next.next().expect("endless");
            black_box(project(target, disks))
        });
    });
    let mut kept = ConicSolver::default();
    group.bench_function("clarabel, kept", |bencher| {
        bencher.iter(|| {
            let (target, disks) = next.next().expect("endless");
            black_box(kept.project(target, disks))
        });
    });
    let programs: Vec<_> = problems.iter().map(cone_program).collect();
    let (mut bare, mut next) = (bare_solver(), programs.iter().cycle());
    group.bench_function("clarabel, bare update and solve", |bencher| {
        bencher.iter(|| {
            let (matrix, offsets) = next.next().expect("endless");
            bare.update_A(matrix).expect("the shape is the same");
            bare.update_b(offsets).expect("the shape is the same");
            bare.solve();
            assert_eq!(bare.solution.status, SolverStatus::Solved);
            black_box(bare.solution.x[0])
        });
    });
    group.finish();
}

criterion_group!(benches, waypoints, plans);
criterion_main!(benches);
