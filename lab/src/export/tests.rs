//! Tests of vehicle missions; over hills in `hills`, of logs in `logs`, of legs in `legs`, of fleets in `fleets`, of
//! DJI's format in `dji`.

mod dji;
mod fleets;
mod hills;
mod legs;
mod logs;

use std::path::Path;

use nalgebra::{Point2, Point3};
use proptest::prelude::*;
use skysink_common::geodata::projection::{GeodeticPosition, Projection};
use skysink_common::message::Mode;
use skysink_common::scenario::{Origin, Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{ByUav, UAV};
use skysink_mission::replay::RecordedRun;
use skysink_mission::trace::RecordedSlot;

use super::altitude::AltitudeReference;
use super::autopilot::{Autopilot, RampLimits};
use super::clearance::MissionClearance;
use super::duration::{MissionLeg, effort};
use super::ground::Ground;
use super::items::VehicleItem;
use super::mission_options::{MIN_ITEMS, VehicleMissionOptions};
use super::track::GeodeticTrack;
use super::vehicle::{VehicleMission, plan};
use super::{fence, summary, warnings};

/// A wall of 20 m × 100 m, from 40 m east of the start.
const WALL: &str = "[[area.no_fly]]\npolygon_m = [[40.0, -1.0], [60.0, -1.0], [60.0, 99.0], [40.0, 99.0]]\n";

const EQUATOR: Origin = Origin { lat_deg: 0.0, lon_deg: 0.0 };

/// A run over 10 km from the origin at 30 m/s at most, with a step along x [m] and the bits that SN 3 uploads in each
/// slot.
fn run_in(more: &str, list: &str, steps: &[(f64, Option<u64>)]) -> RecordedRun {
    let slots = steps.len().max(1);
    let text = format!(
        "name = \"a\"\nslots = {slots}\n[area]\nside_m = 1e4\n{more}[uav]\nstart_m = [0.0, 0.0]\n[link]\ncomm_s = 0.25"
    );
    let scenario = Scenario::parse(&text, Path::new("a"), Overrides::default()).unwrap();
    let list = SensorList::parse(list, Path::new("l"), &scenario).unwrap();
    let mut x_m = 0.0;
    let mut slot = |(index, &(step_m, bits)): (usize, &(f64, Option<u64>))| {
        x_m += step_m;
        ByUav::from_buf([RecordedSlot {
            slot: index as u64 + 1,
            uav: UAV,
            position: Point3::new(x_m, 0.0, 20.0),
            scheduled: if bits.is_some() { vec![3] } else { vec![] },
            delivered_bits: bits.unwrap_or(0),
            lost_bits: 0,
            queued_bits: 0,
            mode: Mode::Serve,
            refused: 0,
            energy_j: f64::INFINITY,
        }])
    };
    let slots = steps.iter().enumerate().map(&mut slot).collect();
    let uploads = |&(_, bits): &(f64, Option<u64>)| ByUav::from_buf([bits.into_iter().collect()]);
    let uploads_bits = steps.iter().map(uploads).collect();
    RecordedRun { scenario, list, strategy: "uts".to_owned(), slots, uploads_bits }
}

fn run(steps: &[(f64, Option<u64>)]) -> RecordedRun {
    run_in("", "x_m,y_m\n1,1\n2,2\n3,3\n4,4\n", steps)
}

fn track(run: &RecordedRun) -> GeodeticTrack<'_> {
    GeodeticTrack::new(run, UAV, EQUATOR).unwrap()
}

fn forever() -> VehicleMissionOptions {
    VehicleMissionOptions { ignore_endurance: true, ..VehicleMissionOptions::default() }
}

fn mission(run: &RecordedRun, options: &VehicleMissionOptions) -> VehicleMission {
    plan(&track(run), options).unwrap()
}

fn lines(run: &RecordedRun, options: &VehicleMissionOptions) -> Vec<String> {
    let mission = mission(run, options);
    summary::lines(&track(run), options, &mission, &clearance(run, &mission, None))
}

/// How near legs come to obstacles, and to the boundary with this `fence_margin_m` [m], if there is one.
fn clearance(run: &RecordedRun, mission: &VehicleMission, fence_margin_m: Option<f64>) -> MissionClearance {
    let fence = fence_margin_m.map(|margin_m| fence::border(&run.scenario.area, margin_m));
    MissionClearance::of(&track(run), mission, fence.as_deref(), 2.0)
}

/// The warnings about a mission, with a geofence that is so far outside of the area [m], if there is one.
fn warned(run: &RecordedRun, mission: &VehicleMission, fence_margin_m: Option<f64>) -> String {
    let corners = fence_margin_m.map(|margin_m| fence::border(&run.scenario.area, margin_m).len());
    warnings::of(&track(run), mission, &clearance(run, mission, fence_margin_m), corners).join("\n")
}

fn refusal(run: &RecordedRun, options: &VehicleMissionOptions) -> String {
    plan(&track(run), options).unwrap_err().to_string()
}

/// Position [m], altitude [m] and hold [s] of every waypoint of a part.
fn waypoints(items: &[VehicleItem]) -> Vec<(Point2<f64>, f64, f64)> {
    let projection = Projection::at(EQUATOR);
    let waypoint = |item: &VehicleItem| match item {
        VehicleItem::Waypoint { place, altitude_m, hold_s } => {
            Some((projection.project(place.lat_deg, place.lon_deg).unwrap(), *altitude_m, *hold_s))
        }
        _ => None,
    };
    items.iter().filter_map(waypoint).collect()
}

#[test]
fn straight_legs_and_holds_are_merged() {
    // On the equator x is a sin λ: 60 m are 60/6378137 · 180°/π = 0.000538989°.
    let served = Some(1);
    let run = run(&[(30.0, None), (30.0, None), (0.0, served), (10.0, served), (0.0, served), (9.0, None)]);
    let options = VehicleMissionOptions::default();
    let waypoint = |lon_deg: f64, hold_s| {
        let place = GeodeticPosition { lat_deg: 0.0, lon_deg };
        VehicleItem::Waypoint { place, altitude_m: 20.0, hold_s }
    };
    let expected = [
        VehicleItem::TakeOff { home: GeodeticPosition { lat_deg: 0.0, lon_deg: 0.0 }, altitude_m: 20.0 },
        VehicleItem::Speed { speed_mps: 30.0 },
        waypoint(0.000538989, 1.0), // two legs in one, and a slot of hovering
        VehicleItem::Speed { speed_mps: 10.0 },
        waypoint(0.000628821, 1.25), // τ_c at the end of the leg, and a slot
        waypoint(0.000709669, 0.0),  // 9 m/s are within a tenth of 30 m/s
        VehicleItem::Speed { speed_mps: 30.0 },
        waypoint(0.0, 0.0), // above home
        VehicleItem::Return,
    ];
    assert_eq!(mission(&run, &options).parts[0].items, expected);
    assert_eq!(
        lines(&run, &options)[0],
        "6 slots (3 serving) → 3 waypoints (2 serving), 3 changes of speed → 10 items → 1 file"
    );
}

#[test]
fn a_stay_on_the_ground_is_no_hold_at_the_end_and_said_before() {
    let there_and_back = [(30.0, Some(1)), (-30.0, None), (0.0, None), (0.0, None)];
    let with_stay = |after: &[(f64, Option<u64>)]| {
        let mut run = run(&[&there_and_back, after].concat());
        run.slots[2..4].iter_mut().for_each(|slot| slot[UAV].mode = Mode::Charge);
        let mission = mission(&run, &forever());
        let holds: Vec<f64> = waypoints(&mission.parts[0].items).iter().map(|(_, _, hold_s)| *hold_s).collect();
        (holds, warned(&run, &mission, None), lines(&run, &forever()).concat())
    };
    let (holds, warned, said) = with_stay(&[]);
    assert!(
        holds.iter().sum::<f64>() < 1.0 && !warned.contains("charges") && said.contains("(planned: 2 s)"),
        "{said}"
    );
    let (holds, warned, said) = with_stay(&[(30.0, Some(1))]);
    assert!(holds.contains(&2.0) && warned.contains("hovers for 2 s in which the plan charges"), "{holds:?}, {warned}");
    assert!(said.contains("(planned: 5 s)"), "{said}");
}

#[test]
fn ardupilot_holds_are_whole_seconds_and_px4_holds_exact() {
    let run = run(&[(30.0, Some(1)), (0.0, Some(1)), (20.0, None)]); // 0.25 s and a slot
    let holds = |autopilot| {
        let options = VehicleMissionOptions { autopilot: Some(autopilot), ..VehicleMissionOptions::default() };
        let holds = waypoints(&mission(&run, &options).parts[0].items);
        holds.iter().map(|(_, _, hold_s)| *hold_s).collect::<Vec<_>>()
    };
    assert_eq!(holds(Autopilot::Px4), [1.25, 0.0, 0.0]);
    assert_eq!(holds(Autopilot::Ardupilot), [2.0, 0.0, 0.0]);
    assert_eq!(Autopilot::Ardupilot.hold_s(0.1 + 0.2 + 0.7), 1.0, "a sum above 1 by rounding");
}

#[test]
fn speeds_are_whole_millimetres_per_second() {
    let mission = mission(&run(&[(15.000000000000002, Some(1))]), &VehicleMissionOptions::default());
    assert_eq!(mission.parts[0].items[1], VehicleItem::Speed { speed_mps: 15.0 });
}

/// 10, 20 and 30 m east of the start 8, 2 and 5 bits are collected. Without fewer than 3, the leg of 20 m is flown at
/// the speed of its legs, 10 m/s.
#[test]
fn passes_with_little_data_are_omitted() {
    let run = run(&[(10.0, Some(8)), (10.0, Some(2)), (10.0, Some(5))]);
    let at = |min_bits| {
        let options = VehicleMissionOptions { min_bits, ..VehicleMissionOptions::default() };
        let items = &mission(&run, &options).parts[0].items;
        let xs: Vec<f64> = waypoints(items).iter().map(|(at, ..)| at.x.round()).collect();
        (xs, lines(&run, &options).remove(1))
    };
    assert_eq!(at(0).0, [10.0, 20.0, 30.0, 0.0]);
    let omitted = "1 of 3 waypoints omitted, with 2 of 15 bits (13.33 %)".to_owned();
    assert_eq!(at(3), (vec![10.0, 30.0, 0.0], omitted));
    let options = VehicleMissionOptions { min_bits: 9, ..VehicleMissionOptions::default() };
    assert!(refusal(&run, &options).contains("--min-bits 9: no waypoint collects so many"));
}

#[test]
fn a_mission_beyond_endurance_or_battery_is_refused_with_both_numbers() {
    // 1000 m and back within 34 slots, from rest to rest: 64 s at 30 m/s and 2.5 m/s² and more.
    let steps: Vec<_> = std::iter::repeat_n((30.0, Some(1)), 34).collect();
    let far = run(&steps);
    let text = refusal(
        &RecordedRun { scenario: with_endurance(&far.scenario, 60.0), ..run(&steps) },
        &VehicleMissionOptions::default(),
    );
    assert!(
        text.contains("part 1 of 1 of the mission takes ") && text.contains("more than the endurance, 60 s"),
        "{text}"
    );
    let mut poor = with_endurance(&far.scenario, 1e4);
    let battery = "name = \"a\"\n[uav.battery]\ncapacity_j = 2000.0\n";
    poor.uav.battery = Scenario::parse(battery, Path::new("a"), Overrides::default()).unwrap().uav.battery;
    let text = refusal(&RecordedRun { scenario: poor, ..run(&steps) }, &VehicleMissionOptions::default());
    assert!(text.contains("more than the battery has without its reserve, 1800 J"), "{text}");
    assert_eq!(mission(&far, &forever()).parts.len(), 1);
}

fn with_endurance(scenario: &Scenario, endurance_s: f64) -> Scenario {
    let mut scenario = scenario.clone();
    scenario.uav.endurance_s = endurance_s;
    scenario
}

/// A wall of 20 m × 100 m between the start and the SNs, which a pass beyond it that is left flies around, and the way
/// home.
#[test]
fn added_legs_lead_around_zones() {
    let mut run = run_in(WALL, "x_m,y_m\n1,1\n2,2\n3,3\n90,4\n", &[(0.0, None); 12]);
    let around = [[20.0, 40.0], [30.0, 70.0], [40.0, 100.0], [60.0, 100.0], [70.0, 75.0], [80.0, 50.0], [90.0, 25.0]];
    for (slot, [x_m, y_m]) in run.slots.iter_mut().zip(around) {
        slot[UAV].position = Point3::new(x_m, y_m, 20.0);
    }
    for slot in &mut run.slots[7..] {
        slot[UAV].position = Point3::new(90.0, 0.0, 20.0);
        slot[UAV].scheduled = vec![3];
    }
    run.uploads_bits[11] = ByUav::from_buf([vec![7]]);
    let mission = mission(&run, &VehicleMissionOptions { min_bits: 1, ..VehicleMissionOptions::default() });
    let places = waypoints(&mission.parts[0].items);
    let airspace = run.scenario.airspace();
    let nodes: Vec<Point2<f64>> = std::iter::once(Point2::origin()).chain(places.iter().map(|(at, ..)| *at)).collect();
    assert!(nodes.windows(2).all(|pair| airspace.is_free(&pair[0], &pair[1])), "{nodes:?}");
    assert!((nodes[nodes.len() - 1] - Point2::origin()).norm() < 1e-3, "{nodes:?}");
    assert_eq!(places.iter().filter(|(at, ..)| (at.x - 90.0).abs() < 0.1).count(), 1, "one pass: {nodes:?}");
}

/// Home [m], and the legs of a file of waypoints, each held for `hold_s` [s].
fn legs_of(name: &str, hold_s: f64) -> (Point2<f64>, Vec<MissionLeg>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
    let text = std::fs::read_to_string(path).unwrap();
    let rows: Vec<Vec<f64>> =
        text.lines().skip(1).map(|line| line.split('\t').map(|cell| cell.parse().unwrap()).collect()).collect();
    let projection = Projection::at(Origin { lat_deg: rows[0][8], lon_deg: rows[0][9] });
    let mut speed_mps = 0.0;
    let mut legs = Vec::new();
    for row in &rows[1..] {
        match row[3] {
            178.0 => speed_mps = row[5],
            16.0 => {
                let at = projection.project(row[8], row[9]).unwrap();
                legs.push(MissionLeg { to: Point3::new(at.x, at.y, row[10]), speed_mps, hold_s });
            }
            _ => {}
        }
    }
    (Point2::origin(), legs)
}

/// ArduCopter 4.8 in software has flown tours over these two fields, with waypoints of the version of that day, 60 and
/// 300: the time from the first waypoint to the last [s], and from arming to the end of the landing [s]. 2.5 m/s² and 1
/// m/s³ are its defaults; holds of 0.1 s were stored as 0.
#[test]
fn the_estimated_time_is_within_15_percent_of_arducopter() {
    let default = Autopilot::Ardupilot.motion();
    for (file, motion, hold_s, waypoints, legs_s, whole_s) in [
        ("smoke-tour.waypoints", default, 0.0, 60.0, 248.0, 313.0),
        ("smoke-tour.waypoints", default.with(Some(10.0), Some(20.0)), 0.0, 60.0, 125.0, 180.0),
        ("smoke-tour.waypoints", default, 1.0, 60.0, 539.0, 606.0),
        ("letter-tour-1.waypoints", default, 0.0, 300.0, 1190.0, 1257.0),
    ] {
        let (home, legs) = legs_of(file, hold_s);
        let whole = effort(&motion, home, 20.0, &legs, None).duration_s;
        // Without the legs after the first waypoint.
        let ends = effort(&motion, home, 20.0, &legs[..1], None).duration_s;
        let per_leg_s = (whole - ends) / (legs.len() - 1) as f64;
        let ratio = per_leg_s * (waypoints - 1.0) / legs_s;
        assert!((0.85..1.15).contains(&ratio), "{file}, {motion:?}: {per_leg_s} s a leg, {ratio} of the flown");
        let ratio = (per_leg_s * (waypoints - 1.0) + ends) / whole_s;
        assert!((0.85..1.15).contains(&ratio), "{file}, {motion:?}: the whole is {ratio} of the flown");
    }
}

/// 90 m at 1 m/s² and 10 m/s, from rest to rest: 2 · √90 s = 18.974 s. 200 m reach 10 m/s: 20 s for 100 m, and 10 s.
#[test]
fn leg_times_without_jerk_limit_match_the_closed_form() {
    let mut motion = Autopilot::Px4.motion();
    motion.horizontal = RampLimits { acceleration_mps2: 1.0, jerk_mps3: None };
    (motion.response_s, motion.settling_s) = (0.0, 0.0);
    let leg = |x_m: f64, hold_s| MissionLeg { to: Point3::new(x_m, 0.0, 20.0), speed_mps: 10.0, hold_s };
    let start = Point3::new(0.0, 0.0, 20.0);
    let seconds = |x_m| super::duration::leg_s(&motion, &start, &leg(x_m, 0.0));
    assert!((seconds(90.0) - 2.0 * 90.0_f64.sqrt()).abs() < 1e-9, "{}", seconds(90.0));
    assert!((seconds(200.0) - 30.0).abs() < 1e-9, "{}", seconds(200.0));
    let whole = |legs: &[MissionLeg]| effort(&motion, Point2::origin(), 20.0, legs, None).duration_s;
    // Take-off 3 s + 20 m at 1.5 m/s, landing 2 s + 5 m at 0.7 m/s + 15 m at 1.5 m/s.
    let ends_s = 3.0 + 20.0 / 1.5 + 2.0 + 5.0 / 0.7 + 15.0 / 1.5;
    assert!((whole(&[leg(200.0, 4.0)]) - (ends_s + 30.0 + 4.0 + 30.0)).abs() < 1e-9);
    // A right angle passed at 2 m = √2 · (T/2)²/2 overlaps for T = 2 √(4/√2), twice: at 200 m east, and at 200 m north.
    let corner = MissionLeg { to: Point3::new(200.0, 200.0, 20.0), ..leg(200.0, 0.0) };
    let north = MissionLeg { to: Point3::new(0.0, 200.0, 20.0), ..corner };
    let overlaps_s = 2.0 * 2.0 * (4.0 / 2.0_f64.sqrt()).sqrt();
    let rounded_s = whole(&[leg(200.0, 0.0), corner, north]);
    assert!((rounded_s - (ends_s + 4.0 * 30.0 - overlaps_s)).abs() < 1e-9, "{rounded_s}");
}

/// 2 m/s² and 1 m/s³: 8 m/s take 2 s + 4 s over 24 m, so that 100 m take 12 s and 52 m at 8 m/s. 1 m/s takes 2 s over 1
/// m, without reaching 2 m/s², so that 2 m take 4 s.
#[test]
fn legs_with_jerk_take_as_long_as_worked_by_hand() {
    let mut motion = Autopilot::Px4.motion();
    motion.horizontal = RampLimits { acceleration_mps2: 2.0, jerk_mps3: Some(1.0) };
    motion.response_s = 0.0;
    for (x_m, expected_s) in [(100.0, 18.5), (2.0, 4.0)] {
        let leg = MissionLeg { to: Point3::new(x_m, 0.0, 20.0), speed_mps: 8.0, hold_s: 0.0 };
        let leg_s = super::duration::leg_s(&motion, &Point3::new(0.0, 0.0, 20.0), &leg);
        assert!((leg_s - expected_s).abs() < 1e-9, "{x_m} m: {leg_s} s");
    }
}

proptest! {
    #[test]
    fn the_mission_contains_every_service_in_order(
        steps in prop::collection::vec(
            (prop::sample::select(vec![0.0, 0.03, 7.0, 20.0]), prop::option::of(0..2_u64)), 1..80),
        most_items in MIN_ITEMS..60,
    ) {
        let run = run(&steps);
        let track = track(&run);
        let mission = mission(&run, &VehicleMissionOptions { most_items: Some(most_items as u32), ..forever() });
        let mut places = Vec::new();
        for part in &mission.parts {
            let items = &part.items;
            prop_assert!(items.len() < most_items, "{items:?}"); // and home
            prop_assert!(matches!(items[..], [VehicleItem::TakeOff { .. }, .., VehicleItem::Return]), "{items:?}");
            places.extend(waypoints(items).into_iter().map(|(at, ..)| at));
        }
        let mut places = places.iter().peekable();
        for (point, slot) in track.services() {
            let is_here = |at: &Point2<f64>| (at - point.position.xy()).norm() < 0.1;
            while places.next_if(|at| !is_here(at)).is_some() {}
            prop_assert!(places.peek().is_some(), "slot {slot}");
        }
        let services: usize = mission.stops.iter().map(|stop| stop.services.len()).sum();
        prop_assert_eq!(services, track.services().count());
    }
}

fn speeds(items: &[VehicleItem]) -> Vec<f64> {
    let speed = |item: &VehicleItem| match item {
        VehicleItem::Speed { speed_mps } => Some(*speed_mps),
        _ => None,
    };
    items.iter().filter_map(speed).collect()
}

#[test]
fn no_leg_is_slower_than_recorded_or_stationary() {
    // 1 cm/s, then 1 m/s, which is less than a tenth of 30 m/s more.
    let crawling = mission(&run(&[(0.06, Some(1)), (1.0, Some(1)), (1.05, Some(1))]), &forever());
    assert_eq!(speeds(&crawling.parts[0].items), [0.1, 1.0, 1.05, 30.0]);
    assert!(crawling.parts[0].effort.duration_s < 100.0);
    let mut resting = run(&[(6.0, Some(1)), (6.0, Some(1))]);
    resting.scenario.uav.acceleration_mps2 = Some(25.0);
    assert_eq!(speeds(&mission(&resting, &forever()).parts[0].items), [30.0], "from rest to rest");
}

#[test]
fn later_parts_fly_to_their_first_waypoint_at_maximum_speed() {
    let steps: Vec<_> = std::iter::repeat_n((2.0, Some(1)), 12).collect();
    let parts = mission(&run(&steps), &VehicleMissionOptions { most_items: Some(8), ..forever() }).parts;
    assert!(parts.len() > 2);
    assert_eq!(speeds(&parts[0].items)[0], 2.0);
    assert!(parts[1..].iter().all(|part| speeds(&part.items)[0] == 30.0), "{parts:?}");
}

#[test]
fn a_mission_through_ground_or_zone_is_refused() {
    let mut low = run(&[(10.0, Some(1)), (10.0, Some(1))]);
    low.slots[1][UAV].position.z = -0.5;
    let text = refusal(&low, &forever());
    assert!(text.contains("the mission would lead to (20.0 m, 0.0 m) at -0.5 m above the ground"), "{text}");
    let through = run_in(WALL, "x_m,y_m\n1,1\n", &[(30.0, Some(1)), (50.0, Some(1))]);
    let text = refusal(&through, &forever());
    assert!(text.contains("through a zone, a building or the boundary, on the way to (80.0 m, 0.0 m)"), "{text}");
}

/// A slot of rest, a climb with a service, and a leg.
#[test]
fn a_climb_at_the_start_sets_no_speed() {
    let mut run = run(&[(0.0, None), (0.0, Some(1)), (10.0, Some(1))]);
    for slot in &mut run.slots[1..] {
        slot[UAV].position.z = 40.0;
    }
    let mission = mission(&run, &VehicleMissionOptions { min_bits: 1, ..forever() });
    assert_eq!(speeds(&mission.parts[0].items), [10.0, 30.0]);
    assert!(mission.parts[0].effort.duration_s < 120.0, "{:?}", mission.parts[0].effort);
}

/// An L whose inner corner is at (60, 60).
#[test]
fn a_wider_fence_is_outside_of_the_boundary_by_the_margin() {
    let text = "boundary_m = [[0.0, 0.0], [90.0, 0.0], [90.0, 60.0], [60.0, 60.0], [60.0, 90.0], [0.0, 90.0]]\n";
    let area = run_in(text, "x_m,y_m\n1,1\n", &[(1.0, None)]).scenario.area;
    let wider: Vec<[f64; 2]> = fence::border(&area, 10.0).iter().map(|at| [at.x.round(), at.y.round()]).collect();
    for corner in [[-10.0, -10.0], [100.0, -10.0], [100.0, 70.0], [70.0, 70.0], [70.0, 100.0], [-10.0, 100.0]] {
        assert!(wider.contains(&corner), "{corner:?}: {wider:?}");
    }
    assert_eq!(wider.len(), 6, "{wider:?}");
}

/// The wall needs two bends each way.
#[test]
fn a_part_that_cannot_hold_one_waypoint_with_its_ways_is_refused() {
    let run = run_in(WALL, "x_m,y_m\n1,1\n", &[(90.0, Some(1))]);
    let text = refusal(&run, &VehicleMissionOptions { most_items: Some(7), ..forever() });
    assert!(text.contains("--most-items 7: expected more, because a single waypoint has so many"), "{text}");
}
