//! Tests of plans: what a flight is, what is refused, and its times.

use proptest::prelude::*;
use serde_json::{Value, json};
use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::geodata::{SourceText, ZoneKind};
use skysink_common::geometry::Position;
use skysink_common::scenario::{TimedPoint, slot_ends};

use super::route::follow;
use super::*;

/// Home of the tests.
const HOME: [f64; 2] = [47.3975, 8.545];

/// The flight of a waypoint file with home and these items.
fn of_waypoints(items: &[&str]) -> Result<ForeignPlan, String> {
    let mut text = format!("QGC WPL 110\n0 1 0 16 0 0 0 0 {} {} 488 1\n", HOME[0], HOME[1]);
    for (item, index) in items.iter().zip(1..) {
        text += &format!("{index}\t0\t{}\t1\n", item.replace(' ', "\t"));
    }
    follow(waypoints::parse(&SourceText { text: &text, ..SourceText::default() })?, None)
}

/// A plan of QGroundControl with these items.
fn plan(items: Value) -> Value {
    json!({
        "fileType": "Plan",
        "geoFence": { "circles": [], "polygons": [], "version": 2 },
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": 15, "firmwareType": 12, "globalPlanAltitudeMode": 1, "hoverSpeed": 5, "items": items,
            "plannedHomePosition": [HOME[0], HOME[1], 488], "vehicleType": 2, "version": 2
        },
        "rallyPoints": { "points": [], "version": 2 },
        "version": 1
    })
}

fn of_plan(plan: &Value) -> Result<ForeignPlan, String> {
    follow(qgc_plan::parse(&SourceText { text: &plan.to_string(), ..SourceText::default() })?, None)
}

fn simple(command: u16, frame: u8, params: Value) -> Value {
    json!({
        "autoContinue": true, "command": command, "doJumpId": 1, "frame": frame, "params": params, "type": "SimpleItem"
    })
}

/// A waypoint at home, so high [m].
fn over_home(frame: u8, altitude_m: f64) -> Value {
    simple(16, frame, json!([0, 0, 0, null, HOME[0], HOME[1], altitude_m]))
}

#[test]
fn items_are_legs_with_their_speeds_and_holds() {
    let flight = of_waypoints(&[
        "3 22 0 0 0 0 0 0 30",
        "3 16 5 0 0 0 47.398 8.545 30",
        "2 178 1 4 0 0 0 0 0",
        "3 82 0 0 0 0 47.398 8.546 30",
        "3 93 7.5 0 0 0 0 0 0",
        "3 19 10 0 0 0 0 0 0",
        "2 178 1 -2 0 0 0 0 0",
        "2 206 20 0 0 0 0 0 0",
        "3 20 0 0 0 0 0 0 0",
        "2 206 0 0 0 0 0 0 0",
    ])
    .unwrap();
    let legs: Vec<_> = flight.legs.iter().map(|leg| (&*leg.place, leg.to, leg.speed_mps, leg.hold_s)).collect();
    let expected = [
        ("item 2", [47.398, 8.545], 10.0, 5.0),
        ("item 4", [47.398, 8.546], 4.0, 7.5),
        ("item 6", [47.398, 8.546], 4.0, 10.0),
        ("item 9", HOME, 10.0, 0.0),
    ];
    assert_eq!(legs, expected);
    assert_eq!((flight.home, flight.altitudes_m()), (HOME, [30.0; 2]));
    let notes = [
        "splines are flown straight",
        "no speed before item 2: taken as 10 m/s, ArduCopter's WPNAV_SPEED by default; --speed sets another",
        "not used: 2 × command 206 (DO_SET_CAM_TRIGG_DIST)",
    ];
    assert_eq!(flight.notes, notes);
    assert_eq!(flight.altitudes, ["altitudes of 3 items: 30 m above home (frame 3), as all programs read them"]);
}

/// Home is 488 m above the sea: 518 m are 30 m above it. QGroundControl has computed 543 m from 50 m.
#[test]
fn altitudes_are_above_what_their_frames_say() {
    let mut computed = over_home(0, 543.0);
    computed["Altitude"] = json!(50.0);
    computed["AltitudeMode"] = json!(3);
    let flight =
        of_plan(&plan(json!([over_home(3, 30.0), over_home(0, 518.0), over_home(10, 35.0), computed]))).unwrap();
    let altitudes_m: Vec<f64> = flight.legs.iter().map(|leg| leg.altitude_m).collect();
    assert_eq!(altitudes_m, [30.0, 30.0, 35.0, 50.0]);
    assert_eq!(flight.altitudes_m(), [30.0, 50.0]);
    let expected = [
        "altitude of 1 item: 30 m above home (frame 3), as all programs read them",
        "altitude of 1 item: 518 m above sea level (frame 0), as all programs read them, less the 488 m of home",
        "altitude of 1 item: 35 m above the terrain (frame 10) by QGroundControl and ArduPilot; PX4 refuses them",
        "altitude of 1 item: 543 m above sea level (frame 0), computed from altitudes above the terrain, which are \
         taken",
    ];
    assert_eq!((&flight.altitudes[..], flight.warnings.len()), (&expected.map(str::to_owned)[..], 0));
    let terrain = of_waypoints(&["10 16 0 0 0 0 47.398 8.545 40"]).unwrap();
    assert!(terrain.altitudes[0].contains("by ArduPilot and Mission Planner, above sea level by QGroundControl"));
    assert!(terrain.warnings[0].contains("do not open it there"), "{:?}", terrain.warnings);
    assert!(!terrain.is_level && flight.is_level);
}

#[test]
fn px4_flies_to_the_place_of_a_take_off_and_ardupilot_does_not() {
    let take_off = simple(22, 3, json!([0, 0, 0, null, 47.398, 8.545, 20]));
    let mut plan = plan(json!([take_off, over_home(3, 30.0)]));
    let places = |plan: &Value| of_plan(plan).unwrap().legs.into_iter().map(|leg| leg.place).collect::<Vec<_>>();
    assert_eq!(places(&plan), ["item 1", "item 2"]);
    plan["mission"]["firmwareType"] = json!(3);
    assert_eq!(places(&plan), ["item 2"]);
    let notes = of_plan(&plan).unwrap().notes;
    assert!(notes[0].starts_with("item 1: ArduPilot takes off from home, 56 m from"), "{notes:?}");
}

/// Corners of a circle of 100 m: beyond it if it must not be entered, on it if it must not be left.
#[test]
fn a_fence_is_a_boundary_and_zones() {
    let mut plan = plan(json!([over_home(3, 30.0)]));
    let shape = json!({ "center": HOME, "radius": 100.0 });
    let circle = |is_inclusion: bool| json!({ "circle": shape, "inclusion": is_inclusion, "version": 1 });
    let ring = json!([[47.39, 8.54], [47.40, 8.54], [47.40, 8.55], [47.39, 8.55]]);
    plan["geoFence"]["polygons"] = json!([{ "inclusion": true, "polygon": ring, "version": 1 }]);
    plan["geoFence"]["circles"] = json!([circle(false)]);
    let fence = of_plan(&plan).unwrap().fence;
    let kinds: Vec<_> = fence.iter().map(|zone| (&*zone.place, zone.kind)).collect();
    assert_eq!(kinds, [("geoFence.polygons[0]", ZoneKind::Boundary), ("geoFence.circles[0]", ZoneKind::NoFly)]);
    let [boundary, zone] = &fence[..] else { panic!("{fence:?}") };
    // Wider by 1 cm, 9e-8 degrees of latitude.
    let south_deg = boundary.corners.iter().map(|corner| corner[0]).fold(90.0, f64::min);
    assert!((47.39 - south_deg - 9e-8).abs() < 1e-9, "{south_deg}");
    let projection = Projection::at(Origin { lat_deg: HOME[0], lon_deg: HOME[1] });
    let radius_m = |corner: &[f64; 2]| projection.project(corner[0], corner[1]).unwrap().coords.norm();
    let beyond_m = 100.0 / (std::f64::consts::PI / 36.0).cos();
    assert!(zone.corners.iter().all(|corner| (radius_m(corner) - beyond_m).abs() < 1e-6));
    plan["geoFence"]["polygons"] = json!([]);
    plan["geoFence"]["circles"] = json!([circle(true)]);
    let fence = of_plan(&plan).unwrap().fence;
    assert!(fence[0].corners.iter().all(|corner| (radius_m(corner) - 100.0).abs() < 1e-6));
    plan["geoFence"]["circles"] = json!([circle(true), circle(true)]);
    assert!(
        of_plan(&plan).unwrap_err().starts_with("geoFence.circles[1]: a second area that must not be left, beside")
    );
}

#[test]
fn what_changes_a_flight_in_an_unknown_way_is_refused_by_its_item() {
    let waypoint = "3 16 0 0 0 0 47.398 8.545 30";
    for (items, expected) in [
        (&[waypoint, "3 18 2 0 20 0 47.398 8.545 30"][..], "item 2: command 18 (NAV_LOITER_TURNS): expected waypoints"),
        (
            &[waypoint, "2 177 1 3 0 0 0 0 0"],
            "item 2: command 177 (DO_JUMP): expected a mission of waypoints that is flown once",
        ),
        (&["3 16 -1 0 0 0 47.398 8.545 30"], "item 1: a hold of -1 s: expected 0 to 1000000 s"),
        (&["3 16 0 0 0 0 98 8.545 30"], "item 1: latitude 98: expected -90 to 90"),
        (&["3 16 0 0 0 0 47.398 8.545 0"], "item 1: 0 m above the ground: expected above 0"),
        (&["0 16 0 0 0 0 47.398 8.545 400"], "item 1: -88 m above the ground, 400 m above sea level: expected above 0"),
        (&["1 16 0 0 0 0 47.398 8.545 30"], "item 1: frame 1: expected 0, 3 or 10"),
        (&["3 16 0 0 0 0 0 0 0"], "item 1: no altitude yet: expected one above 0 m"),
        (&["2 178 1 0 0 0 0 0 0", waypoint], "item 1: a speed of 0 m/s: expected above 0, at most 1000 m/s"),
        (&["2 178 9 5 0 0 0 0 0", waypoint], "item 1: speed type 9: expected 0 to 3"),
        (&[waypoint, "3 93 -1 12 0 0 0 0 0"], "item 2: NAV_DELAY until a time of day: expected seconds"),
        (&["2 112 9 0 0 0 0 0 0", "2 178 1 5 0 0 0 0 0", waypoint], "item 2: a speed that item 1 delays: expected"),
        (
            &[waypoint, "3 20 0 0 0 0 0 0 0", waypoint],
            "item 3: command 16 after item 2, which returns: expected a mission of one",
        ),
        (&[waypoint, "3 22 0 0 0 0 0 0 30"], "item 2: a take-off in flight: expected a mission of one flight"),
        (&["2 206 1 0 0 0 0 0 0"], "no item leads anywhere: expected at least one waypoint"),
        (&["3 x 0 0 0 0 47.398 8.545 30"], "item 1 (line 3): command = x: expected a number"),
        (&["3 16.5 0 0 0 0 47.398 8.545 30"], "item 1 (line 3): command = 16.5: expected a whole number up to 65535"),
        (&["3 16 0 0 0 0 47.398 8.545"], "item 1 (line 3): 11 columns: expected 12"),
    ] {
        let refused = of_waypoints(items).expect_err(expected);
        assert!(refused.starts_with(expected), "{refused}");
    }
    for (text, expected) in [
        ("", "line 1: ``: expected `QGC WPL 110`"),
        ("QGC WPL 120\n", "line 1: `QGC WPL 120`: expected `QGC WPL 110`"),
        ("QGC WPL 110\n1 1 0 16 0 0 0 0 1 1 1 1\n", "item 0 (line 2): index = 1: expected 0, the items in order"),
    ] {
        let refused = waypoints::parse(&SourceText { text, ..SourceText::default() }).unwrap_err();
        assert!(refused.starts_with(expected), "{refused}");
    }
}

#[test]
fn a_plan_of_another_form_is_refused_with_its_key() {
    let changed = |pointer: &str, value: Value| {
        let mut plan = plan(json!([over_home(3, 30.0)]));
        *plan.pointer_mut(pointer).unwrap() = value;
        of_plan(&plan).unwrap_err()
    };
    let complex = |kind: &str, transects: Value| {
        let item = json!({ "type": "ComplexItem", "complexItemType": kind, "TransectStyleComplexItem": transects });
        json!([item])
    };
    let none = json!({ "Items": [] });
    for (pointer, value, expected) in [
        ("/fileType", json!("GeoFence"), "fileType = `GeoFence`: expected `Plan`"),
        ("/mission/version", json!(1), "mission.version = 1: expected 2; open the file in QGroundControl"),
        ("/mission/hoverSpeed", json!(0), "mission.hoverSpeed = 0: expected a speed above 0 m/s"),
        ("/mission/hoverSpeed", json!("5"), "mission.hoverSpeed = \"5\": expected a number"),
        ("/mission/plannedHomePosition", json!([47]), "mission.plannedHomePosition: expected latitude, longitude"),
        ("/mission/plannedHomePosition", json!([97, 8.5, 0]), "mission.plannedHomePosition: latitude 97: expected"),
        ("/mission/items", json!({}), "mission.items = {}: expected a list"),
        ("/mission/items", json!([]), "no item leads anywhere: expected at least one waypoint"),
        ("/mission/items", json!([7]), "item 1: type = ``: expected `SimpleItem` or `ComplexItem`"),
        ("/mission/items/0/params", json!([0, 0]), "item 1: 2 params: expected 7"),
        ("/mission/items/0/params/4", json!("x"), "item 1: parameter 5 = \"x\": expected a number"),
        ("/mission/items/0/command", json!(null), "item 1: command = null: expected a number"),
        (
            "/mission/items",
            complex("StructureScan", json!(null)),
            "item 1: complexItemType = `StructureScan`: expected `survey`",
        ),
        (
            "/mission/items",
            complex("survey", none),
            "item 1 (survey): TransectStyleComplexItem.Items: none: expected its waypoints",
        ),
        (
            "/mission/items",
            complex("CorridorScan", json!({ "Items": [1] })),
            "item 1 (CorridorScan), its item 1: command = none",
        ),
        (
            "/geoFence/polygons",
            json!([{ "polygon": [[1, 2]] }]),
            "geoFence.polygons[0].inclusion: expected true or false",
        ),
        (
            "/geoFence/polygons",
            json!([{ "polygon": [[1]], "inclusion": true }]),
            "geoFence.polygons[0]: [1]: expected a latitude",
        ),
        (
            "/geoFence/circles",
            json!([{ "circle": { "center": HOME, "radius": -1 }, "inclusion": true }]),
            "geoFence.circles[0]: radius -1",
        ),
    ] {
        let refused = changed(pointer, value);
        assert!(refused.starts_with(expected), "{refused}");
    }
    let parsed = qgc_plan::parse(&SourceText { text: "{", ..SourceText::default() });
    assert!(parsed.unwrap_err().starts_with("expected JSON: EOF while parsing an object at line 1 column 1"));
}

#[test]
fn what_is_not_used_is_named() {
    let mut plan = plan(json!([over_home(3, 30.0), simple(530, 2, json!([0, 2, null, null, null, null, null]))]));
    plan["rallyPoints"]["points"] = json!([[47.0, 8.0, 50], [47.0, 8.1, 50]]);
    plan["geoFence"]["breachReturn"] = json!(HOME);
    plan["mission"]["items"][0]["autoContinue"] = json!(false);
    plan["own"] = json!(1);
    let notes = of_plan(&plan).unwrap().notes;
    let expected = [
        "the mission neither returns nor lands: the flight ends at item 1",
        "not used: own, geoFence.breachReturn, 2 × rally point, the pause after item 1 (autoContinue), 1 × command 530 \
         (SET_CAMERA_MODE)",
    ];
    assert_eq!(notes, expected);
}

/// A waypoint of a random plan: its place [m], hold [s], and the speed that is set before it [m/s].
type RandomItem = ([f64; 2], f64, Option<f64>);

fn random_items() -> impl Strategy<Value = Vec<RandomItem>> {
    let hold_s = prop_oneof![Just(0.0), 0.0..30.0f64];
    let along_m = -500.0..500.0f64;
    prop::collection::vec(([along_m.clone(), along_m], hold_s, prop::option::of(0.5..20.0f64)), 1..30)
}

proptest! {
    /// Legs take the time of their speed, exactly or to the end of a slot, and holds last what they say.
    #[test]
    fn no_flight_is_faster_than_its_speeds(items in random_items(), slot_s in prop_oneof![Just(1.0), 0.2..5.0f64]) {
        let projection = Projection::at(Origin { lat_deg: HOME[0], lon_deg: HOME[1] });
        let mut lines = Vec::new();
        for ([x_m, y_m], hold_s, speed_mps) in &items {
            let at = projection.unproject(&Position::new(*x_m, *y_m)).unwrap();
            lines.extend(speed_mps.map(|speed_mps| format!("2 178 1 {speed_mps:.3} 0 0 0 0 0")));
            lines.push(format!("3 16 {hold_s:.3} 0 0 0 {:.9} {:.9} 30", at.lat_deg, at.lon_deg));
        }
        let flight = of_waypoints(&lines.iter().map(String::as_str).collect::<Vec<_>>()).unwrap();
        prop_assert_eq!(flight.legs.len(), items.len());
        let places: Vec<Position> =
            flight.legs.iter().map(|leg| projection.project(leg.to[0], leg.to[1]).unwrap()).collect();
        for (place, ([x_m, y_m], ..)) in places.iter().zip(&items) {
            prop_assert!((place - Position::new(*x_m, *y_m)).norm() < 1e-3);
        }
        let exact = flight.walk(Position::origin(), &places, slot_s, |_| false);
        let by_slots = flight.walk(Position::origin(), &places, slot_s, |_| true);
        prop_assert_eq!(exact.len(), by_slots.len());
        for (points, faster) in [(&exact, 1.0), (&by_slots, 1.0 / 0.99)] {
            let mut fastest_mps: f64 = 0.0;
            for pair in points.windows(2) {
                let [from, to] = [pair[0], pair[1]];
                let leg = &flight.legs[to.leg.unwrap()];
                let took_s = to.point.time_s - from.point.time_s;
                let way_m = (to.point.at - from.point.at).norm();
                fastest_mps = fastest_mps.max(leg.speed_mps * faster);
                if from.leg == to.leg {
                    prop_assert!(way_m == 0.0 && (took_s - leg.hold_s).abs() < 2e-6, "{took_s} s at {}", leg.place);
                } else {
                    prop_assert!(way_m <= leg.speed_mps * faster * took_s * (1.0 + 1e-9), "{}", leg.place);
                    let late_s = took_s - way_m / leg.speed_mps;
                    prop_assert!(late_s < if faster > 1.0 { slot_s + 1e-6 } else { 3e-6 }, "{late_s} s late");
                }
            }
            let timed: Vec<TimedPoint> = points.iter().map(|point| point.point).collect();
            let slots = (timed[timed.len() - 1].time_s / slot_s).ceil() as u64;
            let ends = slot_ends(&timed, slot_s, slots);
            for pair in ends.windows(2) {
                prop_assert!((pair[1].1 - pair[0].1).norm() <= fastest_mps * slot_s * (1.0 + 1e-9));
            }
            prop_assert!((ends[slots as usize].1.xy() - places[places.len() - 1]).norm() < 1e-9);
        }
        for (point, place) in by_slots.iter().filter_map(|point| Some((point, places[point.leg?]))) {
            prop_assert_eq!(point.point.at.xy(), place);
        }
    }
}
