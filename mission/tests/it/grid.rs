//! Missions on a grid (decision D17a): every strategy moves from the middle of a cell to that of a neighbour.

use std::ops::ControlFlow;
use std::path::Path;

use crate::support::scenario_of;
use nalgebra::Vector2;
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, HoldReason, Mode, Plan};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;
use skysink_common::stop::Stop;
use skysink_mission::{Mission, Plant};
use skysink_planner::geometry::disks::Disk;
use skysink_planner::mission_table::MissionTable;
use skysink_planner::plan::long_search::SearchProgress;
use skysink_planner::strategies::look_ahead::search_offline;
use skysink_planner::strategies::names;
use skysink_planner::strategy::OwnedSetup;

const CELL_M: f64 = 10.0;

/// A city of 12 × 9 cells; `speed_mps` is the top speed in slots of a second.
fn city(strategy: &'static str, speed_mps: f64, slots: u64, more: &str) -> Scenario {
    let text = format!(
        "name = 'city'\nslots = {slots}\n[area]\nwidth_m = 120.0\nheight_m = 94.0\n\
         no_fly = [{{ polygon_m = [[20, 20], [50, 20], [50, 60], [20, 60]] }}, {{ polygon_m = [[70, 0], [80, 0], [80, 70], [70, 70]] }}]\n\
         building = [{{ polygon_m = [[90, 30], [110, 30], [110, 50], [90, 50]], height_m = 50.0 }}]\n\
         [sensors]\ncount = 30\n[link]\ncomm_radius_m = 15.0\n[planner]\nhorizon.iterations = 50\noffline.steps = 2000\nbest-of = {{ iterations = 100, window = 10 }}\n\
         [uav]\nmoves = 'grid'\ncell_m = {CELL_M:?}\nmax_speed_mps = {speed_mps:?}\n{more}"
    );
    scenario_of(&text, strategy)
}

/// Whether a cell is forbidden, by column and row.
fn is_blocked([x, y]: [i64; 2]) -> bool {
    let is_in = |columns: std::ops::Range<i64>, rows: std::ops::Range<i64>| columns.contains(&x) && rows.contains(&y);
    !is_in(0..12, 0..9) || is_in(2..5, 2..6) || is_in(7..8, 0..7) || is_in(9..11, 3..5)
}

/// The cell whose middle this is.
fn cell(at: &Position) -> [i64; 2] {
    [at.x, at.y].map(|coordinate_m| {
        let index = coordinate_m / CELL_M - 0.5;
        assert!((index - index.round()).abs() < 1e-6, "{at} is no middle of a cell");
        index.round() as i64
    })
}

/// Checks that flights of moves of `n` slots begin and end in middles of neighbouring free cells; returns the moves.
fn assert_moves(start: Position, flights: &[FlightReport], n: usize) -> usize {
    let mut from = start;
    let mut moves = 0;
    for (index, slots) in flights.chunks(n).enumerate() {
        for (step, flight) in (1..).zip(slots) {
            assert_eq!(flight.hold, HoldReason::None as u32, "slot {}", index * n + step);
        }
        let Some(last) = slots.get(n - 1) else { break };
        let to = last.position().xy();
        let [begin, end] = [cell(&from), cell(&to)];
        let steps = (begin[0] - end[0]).abs() + (begin[1] - end[1]).abs();
        assert!(steps <= 1 && !is_blocked(end), "move {index}: {begin:?} to {end:?}");
        for (step, flight) in (1..).zip(slots) {
            let expected = from + (to - from) * (f64::from(step) / n as f64);
            assert!((flight.position().xy() - expected).norm() < 1e-6, "move {index}: {}", flight.position());
        }
        moves += steps as usize;
        from = to;
    }
    moves
}

fn fly(scenario: &Scenario) -> Vec<FlightReport> {
    let list = SensorList::of(scenario).unwrap();
    Mission::new(scenario, &list).unwrap().map(|record| record.flights()[UAV]).collect()
}

#[test]
fn every_strategy_moves_from_cell_to_cell() {
    let mut total = 0;
    for strategy in names() {
        for (speed_mps, n) in [(2.5, 4), (4.0, 3), (5.0, 2), (25.0, 1)] {
            let scenario = city(strategy, speed_mps, 120, "");
            let flights = fly(&scenario);
            let moves = assert_moves(scenario.start().xy(), &flights, n);
            // In two minutes nothing is lost, and `hover` stays.
            assert!(moves > 0 || strategy == "hover", "{strategy}, {n} slots a move");
            total += moves * n;
        }
    }
    // Of 120 slots.
    assert!(total > 40 * 4 * names().len(), "{total} slots of flight");
}

#[test]
fn every_strategy_lands_in_time_and_with_its_reserve() {
    for strategy in names() {
        for n in [1, 2, 4] {
            let base = "must_land = true\nbattery = { capacity_j = 9000.0 }\n[base]\ncharge_w = 600.0\n\
                        areas_m = [[[0, 0], [20, 0], [20, 10], [0, 10]], [[110, 80], [120, 80], [120, 90], [110, 90]]]\n";
            let scenario = city(strategy, CELL_M / f64::from(n), 120, base);
            let flights = fly(&scenario);
            assert_moves(scenario.start().xy(), &flights, n as usize);
            let last = flights.last().unwrap();
            let [x, y] = cell(&last.position().xy());
            assert!(y == 0 && x < 2 || [x, y] == [11, 8], "{strategy}, {n}: ends in {x}, {y}");
            let least_j = flights.iter().map(|flight| flight.energy_j).fold(f64::INFINITY, f64::min);
            assert!(least_j >= 900.0 - 1e-6, "{strategy}, {n}: {least_j} J");
            let charged = flights.iter().filter(|flight| flight.flown_mode() == Mode::Charge).count();
            assert!(charged > 0, "{strategy}, {n}");
        }
    }
}

#[test]
fn a_waypoint_beside_the_grid_is_refused() {
    let scenario = city("uts", 25.0, 10, "start_m = [15.0, 15.0]\n");
    let list = SensorList::of(&scenario).unwrap();
    for (x_m, y_m, reason) in [
        (25.0, 15.0, HoldReason::None),
        (15.0, 5.0, HoldReason::None),
        (18.0, 15.0, HoldReason::None),
        (20.0, 20.0, HoldReason::Waypoint),
        (25.0, 25.0, HoldReason::Waypoint),
        (35.0, 15.0, HoldReason::Waypoint),
        (15.0, 16.0, HoldReason::None),
        (15.1, 16.0, HoldReason::Waypoint),
    ] {
        let mut plant = Plant::new(&scenario, &list);
        let target = nalgebra::Point3::new(x_m, y_m, 20.0);
        plant.step(&[Some(Plan::fly_to(target, Mode::Serve))]);
        assert_eq!(plant.flight(UAV).hold, reason as u32, "({x_m}, {y_m})");
    }
}

#[test]
fn grids_that_cannot_be_flown_are_refused() {
    let refused = |keys: &str| {
        let text = format!("name = 'x'\n[uav]\n{keys}");
        Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap_err().to_string()
    };
    for (keys, expected) in [
        (
            "moves = 'grid'\nstart_m = [50.0, 55.0]\n",
            "uav.start_m = [50.0, 55.0]: expected the middle of a cell of 10 m",
        ),
        ("cell_m = 5.0\n", "uav.cell_m = 5.0: expected it only with moves = \"grid\""),
        (
            "moves = 'grid'\ncell_m = 0.5\n",
            "uav.cell_m = 0.5: expected a side of cells of which the area has 1 to 10000",
        ),
        ("moves = 'grid'\ncell_m = 101.0\n", "uav.cell_m = 101.0"),
        ("moves = 'grid'\nposition_error_m = 1.0\n", "uav.position_error_m = 1.0: expected none with moves = \"grid\""),
        ("moves = 'grid'\nmust_land = true\n[base]\nposition_m = [50.0, 50.0]\n", "a base with the middle of a cell"),
        ("moves = 'hex'\n", "uav.moves = \"hex\""),
    ] {
        let error = refused(keys);
        assert!(error.contains("x.toml") && error.contains(expected), "{error}");
    }
}

#[test]
fn a_hover_takes_as_many_slots_as_a_move() {
    for (speed_mps, n) in [(2.5, 4.0), (5.0, 2.0), (25.0, 1.0)] {
        let scenario = city("horizon", speed_mps, 20, "");
        let table = MissionTable::of(&scenario, &SensorList::of(&scenario).unwrap().nodes());
        let start = scenario.start().xy();
        let [here, next] =
            [0.0, CELL_M].map(|away_m| Disk { centre: start + Vector2::new(-away_m, 0.0), radius_m: 1.0 });
        assert_eq!([&here, &next].map(|disk| table.motion.slots_into(&start, disk)), [n, n], "{speed_mps} m/s");
    }
}

/// Between its stops and on the way home, too, which pass other sensor nodes.
#[test]
fn a_plan_of_collect_delivers_what_it_predicts() {
    let mut complete = 0;
    for (seed, speed_mps) in (1..=8).flat_map(|seed| [(seed, 10.0), (seed, 5.0)]) {
        let slots = 700.0 / speed_mps;
        let text = format!(
            "name = 'plan'\nseed = {seed}\nslots = {slots}\narea.side_m = 200.0\n\
             area.no_fly = [{{ polygon_m = [[60, 50], [140, 50], [140, 80], [60, 80]] }}]\nsensors.count = 12\n\
             sensors.sampling_bps = 0.0\nsensors.initial_queue_mean_bits = 9000.0\nlink.comm_radius_m = 60.0\n\
             link.bandwidth_hz = 1e3\nlink.resource_blocks = 1\nbase.position_m = [15, 15]\nbase.radius_m = 10.0\n\
             uav.start_m = [185, 185]\nuav.must_land = true\nuav.moves = 'grid'\nuav.cell_m = 10.0\n\
             uav.max_speed_mps = {speed_mps:?}\nplanner.objective = 'collect'\nplanner.offline.steps = 4000\n"
        );
        let scenario = scenario_of(&text, "offline");
        let list = SensorList::of(&scenario).unwrap();
        let setup = OwnedSetup::new(scenario.clone(), &list.nodes()).unwrap();
        let watch = &mut |_: SearchProgress| ControlFlow::Continue(());
        let (_, found) = search_offline(&setup.setup(), &list.queues_bits(), &Stop::default(), watch).unwrap();
        let records: Vec<_> = Mission::new(&scenario, &list).unwrap().collect();
        let totals = records.last().unwrap().header.totals;
        // Less a millionth of all for each slot in the air.
        let air_bits = totals.initial_bits as f64 * 1e-6 * slots;
        let predicted_bits = -found.cost..=-found.cost + air_bits;
        assert!(predicted_bits.contains(&(totals.delivered_bits as f64)), "seed {seed}: {found:?}, {totals:?}");
        complete += usize::from(totals.queued_bits == 0);
    }
    assert!(complete <= 8, "{complete} of 16: all is delivered, whatever the way");
}
