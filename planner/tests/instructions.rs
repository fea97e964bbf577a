//! A plan does not take more instructions than it used to: see `instructions.txt`.

#[path = "../../tests/support/instructions.rs"]
mod instructions;

use std::hint::black_box;
use std::path::Path;

use instructions::{Case, counted};
use skysink_common::geometry::{Position, above};
use skysink_common::message::{FlightReport, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_planner::Planner;
use skysink_planner::geometry::disks::{Disk, project};

/// Slots of the letter's mission that are flown.
const SLOTS: u64 = 150;

/// Waypoints that are found.
const WAYPOINTS: u64 = 1_000;

/// Flies over `count` sensor nodes at the letter's density, with queues emptied where they are served.
fn fly(strategy: &'static str, count: u32) {
    let side_m = 100.0 * (f64::from(count) / 200.0).sqrt();
    let text = format!("name = 'a'\n[area]\nside_m = {side_m:?}\n[sensors]\ncount = {count}\n");
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    let scenario = Scenario::parse(&text, Path::new("a.toml"), overrides).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let mut planner = Planner::new(&scenario, &list.nodes()).unwrap();
    let mut position = scenario.start().xy();
    let mut queues_bits = list.queues_bits();
    for slot in 1..=SLOTS {
        let plan = counted(|| planner.step(slot, above(&position, 20.0), &queues_bits));
        position = Position::new(plan.x_m, plan.y_m);
        plan.scheduled().iter().for_each(|&id| queues_bits[id as usize] = 0);
        queues_bits.iter_mut().for_each(|queue_bits| *queue_bits = (*queue_bits + 100).min(30_000));
    }
}

/// Slots that a look-ahead plans.
const AHEAD_SLOTS: u64 = 12;

/// Search steps in a slot.
const STEPS: &str = "planner.horizon.iterations = 40\n";

/// A battery, and a base where the UAV has to land.
const BATTERY: &str =
    "base.radius_m = 10.0\nbase.charge_w = 2000.0\nuav.battery.capacity_j = 30000.0\nuav.must_land = true\n";

/// A wall, and a hook.
const ZONES: &str = "area.no_fly = [{ polygon_m = [[100, 60], [120, 60], [120, 240], [100, 240]] }, \
                     { polygon_m = [[180, 90], [270, 90], [270, 120], [210, 120], [210, 190], [180, 190]] }]\n";

/// Plans slots by `horizon` for 200 sensor nodes in 300 m × 300 m, with queues emptied where they are served, and 300 J
/// of a battery taken in each slot.
fn look_ahead(keys: &str) {
    let text = format!("name = 'a'\narea.side_m = 300.0\nslots = 150\n{keys}");
    let overrides = Overrides { strategy: Some("horizon"), ..Overrides::default() };
    let scenario = Scenario::parse(&text, Path::new("a.toml"), overrides).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let mut planner = Planner::new(&scenario, &list.nodes()).unwrap();
    let mut at = scenario.start();
    let mut queues_bits = list.queues_bits();
    for slot in 1..=AHEAD_SLOTS + 1 {
        let plan = if slot == 1 {
            planner.step(slot, at, &queues_bits)
        } else {
            counted(|| planner.step(slot, at, &queues_bits))
        };
        at = plan.waypoint();
        plan.scheduled().iter().for_each(|&id| queues_bits[id as usize] = 0);
        queues_bits.iter_mut().for_each(|queue_bits| *queue_bits = (*queue_bits + 100).min(30_000));
        let energy_j = 30_000.0 - 300.0 * slot as f64;
        planner.observe(slot, &FlightReport { energy_j, ..FlightReport::at(at, Mode::Serve) }, &queues_bits);
    }
}

/// Projects points on a spiral onto five disks: inside all, onto one, and onto crossings.
fn waypoints() {
    let disk = |x_m: f64, y_m: f64, radius_m: f64| Disk { centre: Position::new(x_m, y_m), radius_m };
    let ranges = [[4.0, 1.0], [-3.0, 5.0], [0.0, -6.0], [7.0, 2.0]].map(|[x_m, y_m]| disk(x_m, y_m, 10.0));
    let disks = [[disk(-20.0, 3.0, 30.0)].as_slice(), &ranges].concat();
    for number in 0..WAYPOINTS {
        let angle = number as f64 * 0.7;
        let radius_m = number as f64 * 0.02;
        let target = Position::new(radius_m * angle.cos(), radius_m * angle.sin());
        black_box(counted(|| project(&target, &disks)));
    }
}

fn main() -> std::process::ExitCode {
    let cases = [
        Case { name: "uts, N = 200", steps: SLOTS, work: || fly("uts", 200) },
        Case { name: "uts, N = 10^4", steps: SLOTS, work: || fly("uts", 10_000) },
        Case { name: "exact, N = 200", steps: SLOTS, work: || fly("exact", 200) },
        Case { name: "gfs, N = 200", steps: SLOTS, work: || fly("gfs", 200) },
        Case { name: "horizon, open", steps: AHEAD_SLOTS, work: || look_ahead(STEPS) },
        Case { name: "horizon, battery", steps: AHEAD_SLOTS, work: || look_ahead(&format!("{STEPS}{BATTERY}")) },
        Case {
            name: "horizon, zones and battery",
            steps: AHEAD_SLOTS,
            work: || look_ahead(&format!("planner.horizon.iterations = 10\n{ZONES}{BATTERY}link.bandwidth_hz = 5e3\n")),
        },
        Case {
            name: "horizon, collect",
            steps: AHEAD_SLOTS,
            work: || look_ahead(&format!("{BATTERY}planner.objective = 'collect'\nplanner.horizon.iterations = 10\n")),
        },
        Case { name: "geometric waypoint", steps: WAYPOINTS, work: waypoints },
    ];
    instructions::main(&cases, &Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/instructions.txt"))
}
