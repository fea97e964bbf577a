//! Replays missions that an independent program flew, slot by slot.
//!
//! The ring around the planner is written here a second time, as small as it can be: arrivals, ledger, and a channel
//! that carries the mean rate.

use std::path::Path;

use skysink_common::channel::{Channel, ChannelModel, Uplink};
use skysink_common::geometry::{Position, above, distance_squared, within};
use skysink_common::ledger::Ledger;
use skysink_common::message::SensorNode;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_planner::Planner;
use skysink_planner::settings::{WaypointSolver, change};

/// One line of an expected trace.
struct Slot {
    slot: u64,
    waypoint: Position,
    scheduled: String,
    delivered_bits: u64,
    lost_bits: u64,
    queued_bits: u64,
}

fn slot_of(line: &str) -> Slot {
    let [slot, x_m, y_m, _z_m, scheduled, delivered_bits, lost_bits, queued_bits] =
        line.split(',').collect::<Vec<_>>()[..]
    else {
        panic!("expected eight columns: {line}")
    };
    Slot {
        slot: slot.parse().unwrap(),
        waypoint: Position::new(x_m.parse().unwrap(), y_m.parse().unwrap()),
        scheduled: scheduled.to_owned(),
        delivered_bits: delivered_bits.parse().unwrap(),
        lost_bits: lost_bits.parse().unwrap(),
        queued_bits: queued_bits.parse().unwrap(),
    }
}

/// Samples slot `slot` at every SN (decision D2) and returns what overflows [bit].
fn sample(ledger: &mut Ledger, sensors: &[SensorNode], slot: u64, slot_s: f64) -> u64 {
    let sampled_bits =
        |sensor: &SensorNode, slots: u64| (sensor.sampling_bps * slot_s * slots as f64 + 1e-9).floor() as u64;
    let arrival = |sensor: &SensorNode| sampled_bits(sensor, slot) - sampled_bits(sensor, slot - 1);
    let before_bits = ledger.totals().sampled_bits;
    let lost_bits = ledger.sample(slot);
    let arrived_bits: u64 = sensors.iter().map(arrival).sum();
    assert_eq!(ledger.totals().sampled_bits - before_bits, arrived_bits, "slot {slot}");
    lost_bits
}

/// Uploads the SNs `ids` to the UAV at `waypoint` and returns what they deliver [bit]; each must be in range.
fn upload(ledger: &mut Ledger, sensors: &[SensorNode], scenario: &Scenario, waypoint: &Position, ids: &[u32]) -> u64 {
    let channel = Channel::of(&scenario.link);
    let mut delivered_bits = 0;
    for &id in ids {
        let sensor = &sensors[id as usize];
        let place = Position::new(sensor.x_m, sensor.y_m);
        assert!(within(&place, waypoint, scenario.link.comm_radius_m), "SN {id} is out of range of {waypoint}");
        let d2_m2 = distance_squared(&place, waypoint);
        let uplink = Uplink::at(sensor.gain, d2_m2, scenario.uav.altitude_m);
        let capacity_bits = channel.capacity_bits(channel.expected_rate_bps(&uplink));
        delivered_bits += ledger.upload(id as usize, capacity_bits);
    }
    delivered_bits
}

/// Flies the mission of fixture `name` and compares every slot; waypoints may differ by `tolerance_m`.
fn replay(name: &str, strategy: &'static str, solver: WaypointSolver, tolerance_m: f64) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/it/fixtures").join(name);
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    let scenario = Scenario::read(&folder.join("scenario.toml"), overrides).unwrap();
    let scenario = change(scenario, |settings| settings.waypoint_solver = solver).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let sensors = list.nodes();
    let mut ledger = Ledger::new(list.sampling(&scenario), list.queues_bits());
    let mut planner = Planner::new(&scenario, &sensors).unwrap();
    let mut position = scenario.start().xy();
    let expected = std::fs::read_to_string(folder.join(format!("expected_{strategy}.csv"))).unwrap();
    let mut slots = 0;
    for expected in expected.lines().skip(1).map(slot_of) {
        let Slot { slot, .. } = expected;
        let plan = planner.step(slot, above(&position, 20.0), ledger.queues_bits());
        let waypoint = Position::new(plan.x_m, plan.y_m);
        assert!(within(&waypoint, &position, scenario.reach_m()), "{name}, slot {slot}: {waypoint} is out of reach");
        let lost_bits = sample(&mut ledger, &sensors, slot, scenario.slot_s);
        let delivered_bits = upload(&mut ledger, &sensors, &scenario, &waypoint, plan.scheduled());
        let scheduled = plan.scheduled().iter().map(u32::to_string).collect::<Vec<_>>().join(" ");
        assert_eq!(scheduled, expected.scheduled, "{name}, slot {slot}");
        let off_m = (waypoint - expected.waypoint).norm();
        assert!(off_m <= tolerance_m, "{name}, slot {slot}: {waypoint} is {off_m} m from {}", expected.waypoint);
        let bits = (delivered_bits, lost_bits, ledger.totals().queued_bits);
        assert_eq!(bits, (expected.delivered_bits, expected.lost_bits, expected.queued_bits), "{name}, slot {slot}");
        assert!(ledger.totals().is_balanced(), "{name}, slot {slot}");
        position = waypoint;
        slots += 1;
    }
    assert_eq!(slots, scenario.slots, "{name}: the trace covers the mission");
}

/// All missions.
const MISSIONS: [&str; 4] = ["coincident-and-touching", "dense-paper", "link-limited", "sparse-trap"];

#[test]
fn uts_flies_like_the_reference_program() {
    for name in MISSIONS {
        replay(name, "uts", WaypointSolver::Geometric, 1e-6);
    }
}

#[test]
fn uts_flies_the_same_missions_with_the_conic_solver() {
    for name in MISSIONS {
        replay(name, "uts", WaypointSolver::Clarabel, 1e-3);
    }
}

#[test]
fn gfs_flies_like_the_reference_program() {
    for name in MISSIONS {
        replay(name, "gfs", WaypointSolver::Geometric, 1e-6);
    }
}
