//! A plan does not take more instructions than it used to: see `instructions.txt`.

#[path = "../../tests/support/instructions.rs"]
mod instructions;

use std::hint::black_box;
use std::path::Path;

use instructions::{Case, counted};
use skysink_common::geometry::{Position, above};
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
    let (mut position, mut queues_bits) = (scenario.start().xy(), list.queues_bits());
    for slot in 1..=SLOTS {
        let plan = counted(|| planner.step(slot, above(&position, 20.0), &queues_bits));
        position = Position::new(plan.x_m, plan.y_m);
        plan.scheduled().iter().for_each(|&id| queues_bits[id as usize] = 0);
        queues_bits.iter_mut().for_each(|queue_bits| *queue_bits = (*queue_bits + 100).min(30_000));
    }
}

/// Projects points on a spiral onto five disks: inside all, onto one, and onto crossings.
fn waypoints() {
    let disk = |x_m: f64, y_m: f64, radius_m: f64| Disk { centre: Position::new(x_m, y_m), radius_m };
    let ranges = [[4.0, 1.0], [-3.0, 5.0], [0.0, -6.0], [7.0, 2.0]].map(|[x_m, y_m]| disk(x_m, y_m, 10.0));
    let disks = [[disk(-20.0, 3.0, 30.0)].as_slice(), &ranges].concat();
    for number in 0..WAYPOINTS {
        let (angle, radius_m) = (number as f64 * 0.7, number as f64 * 0.02);
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
        Case { name: "geometric waypoint", steps: WAYPOINTS, work: waypoints },
    ];
    instructions::main(&cases, &Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/instructions.txt"))
}
