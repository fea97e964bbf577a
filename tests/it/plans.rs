//! `skysink new --plan`: plans of other programs are flown as they say, and our own exports come back as they went.

use expect_test::expect_file;
use serde_json::Value;
use skysink_common::geodata::projection::Projection;
use skysink_common::geometry::Position;
use skysink_common::scenario::{Overrides, Scenario};

use crate::support::{Place, scenarios};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Sensor nodes around the flights of `examples/plans`.
const NODES: &str = "lat,lon,name\n47.3980,8.5455,a\n47.3985,8.5465,b\n47.3990,8.5472,c\n";

/// A field of 150 m with an airfield in it.
const FIELD: &str = "name = \"field\"\nslots = 60\n[area]\nside_m = 150.0\norigin_lat_deg = 47.3977\n\
    origin_lon_deg = 8.5456\n[[area.no_fly]]\npolygon_m = [[60.0, 60.0], [90.0, 50.0], [100.0, 90.0], [70.0, 95.0]]\n\
    [sensors]\ncount = 40\n[uav]\nmax_speed_mps = 12.0\nendurance_s = 6000.0\nstart_m = [0.0, 75.0]\n\
    altitude_m = 25.0\n[link]\ncomm_radius_m = 30.0\n";

/// A row of a track.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Row {
    time_s: f64,
    at: Position,
}

/// A waypoint of an exported mission: its place, the speed to it and the hold there.
struct Waypoint {
    place: [f64; 2],
    speed_mps: f64,
    hold_s: f64,
}

fn place() -> Place {
    let place = Place::new();
    for plan in ["survey.plan", "corridor.plan", "holds.waypoints"] {
        std::fs::copy(format!("{ROOT}/examples/plans/{plan}"), place.path(plan)).unwrap();
    }
    place.write("nodes.csv", NODES);
    place
}

fn read(place: &Place, name: &str) -> Scenario {
    scenarios::read(&place.path(name), Overrides::default())
}

/// The rows of a track.
fn rows(place: &Place, name: &str) -> Vec<Row> {
    let text = place.read(name);
    let row = |line: &str| {
        let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
        Row { time_s: numbers[0], at: Position::new(numbers[1], numbers[2]) }
    };
    text.lines().skip(1).map(row).collect()
}

/// Home and the waypoints of a mission of `skysink export`: commands 16 and 178.
fn waypoints(commands: impl Iterator<Item = (u64, Vec<f64>)>) -> Vec<Waypoint> {
    let mut speed_mps = f64::NAN;
    let mut waypoints = Vec::new();
    for (command, params) in commands {
        match command {
            178 => speed_mps = params[1],
            16 => waypoints.push(Waypoint { place: [params[4], params[5]], speed_mps, hold_s: params[0] }),
            20 | 22 => {}
            other => panic!("command {other}"),
        }
    }
    waypoints
}

fn of_plan(text: &str) -> ([f64; 2], Vec<Waypoint>) {
    let plan: Value = serde_json::from_str(text).unwrap();
    let numbers =
        |value: &Value| value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap_or(0.0)).collect();
    let items = plan["mission"]["items"].as_array().unwrap();
    let home: Vec<f64> = numbers(&plan["mission"]["plannedHomePosition"]);
    let items = items.iter().map(|item| (item["command"].as_u64().unwrap(), numbers(&item["params"])));
    ([home[0], home[1]], waypoints(items))
}

fn of_text(text: &str) -> ([f64; 2], Vec<Waypoint>) {
    let items = text.lines().skip(1).map(|line| {
        let columns: Vec<&str> = line.split('\t').collect();
        (columns[3].parse().unwrap(), columns[4..11].iter().map(|number| number.parse().unwrap()).collect())
    });
    let mut waypoints = waypoints(items);
    let home = waypoints.remove(0);
    (home.place, waypoints)
}

/// Each waypoint of the export is a row of the track at the time that its leg takes, and its hold another one. In
/// formats of nine digits behind the point of a degree places are 0.1 mm apart, in tracks of millimetres 1 mm.
#[test]
fn exported_missions_come_back_as_they_went() {
    let place = Place::new();
    place.write("field.toml", FIELD);
    for (format, strategy) in
        [("qgc-plan", "tour"), ("waypoints", "tour"), ("qgc-plan", "uts-wide"), ("waypoints", "edf")]
    {
        place.run_ok(&["simulate", "field.toml", "--strategy", strategy, "--out", "run", "--force"]);
        let extension = if format == "qgc-plan" { "plan" } else { "waypoints" };
        let file = format!("run.{extension}");
        place.run_ok(&["export", "run", "--format", format, "--force"]);
        let printed = place.run_ok(&["new", "back", "--force", "--plan", &file]).stdout;
        let first = read(&place, "field.toml");
        let back = read(&place, "back/back.toml");
        assert_eq!((back.uav.altitude_m, back.uav.waypoints_m.as_ref().unwrap()[0][2]), (25.0, 25.0));
        let projection = Projection::at(back.area.origin().unwrap());
        let in_area = |place: [f64; 2]| projection.project(place[0], place[1]).unwrap();
        let (home, waypoints) =
            if extension == "plan" { of_plan(&place.read(&file)) } else { of_text(&place.read(&file)) };
        let rows = rows(&place, "back/track.csv");
        assert!((rows[0].at - in_area(home)).norm() < 1e-3 && rows[0].time_s == 0.0);
        let is_by_slots = printed.contains("as legs end with slots");
        let mut next = 1;
        let mut before = rows[0];
        for Waypoint { place, speed_mps, hold_s } in &waypoints {
            let at = in_area(*place);
            let leg_m = (at - before.at).norm();
            if leg_m > 1e-3 {
                let arrival = rows[next];
                assert!((arrival.at - at).norm() < 1e-3, "{file}, {strategy}: {arrival:?} is not at {at}");
                let late_s = arrival.time_s - before.time_s - leg_m / speed_mps;
                let slowest_s = if is_by_slots { 1.0 } else { 1e-3 };
                assert!((-0.01 * leg_m / speed_mps - 1e-3..slowest_s).contains(&late_s), "{late_s} s late at {at}");
                before = arrival;
                next += 1;
            }
            if *hold_s > 0.0 {
                let end = rows[next];
                assert!((end.time_s - before.time_s - hold_s).abs() < 1e-5 && end.at == before.at, "{end:?}");
                before = end;
                next += 1;
            }
        }
        // What was flown lies on the track.
        let first_projection = Projection::at(first.area.origin().unwrap());
        let slots = place.read("run/slots.csv");
        for line in slots.lines().skip(1) {
            let columns: Vec<f64> = line.split(',').skip(1).take(3).map(|number| number.parse().unwrap()).collect();
            let flown = first_projection.unproject(&Position::new(columns[1], columns[2])).unwrap();
            let flown = in_area([flown.lat_deg, flown.lon_deg]);
            let away_m = rows.windows(2).map(|pair| distance_m(&flown, &pair[0].at, &pair[1].at)).fold(1e9, f64::min);
            assert!(away_m < 0.06, "{file}, {strategy}: {flown} is {away_m} m beside the track");
        }
        let zones = back.area.no_fly.as_ref().map_or(0, Vec::len);
        assert_eq!((zones, back.area.boundary_m.is_some()), if extension == "plan" { (1, true) } else { (0, false) });
        place.run_ok(&["simulate", "back/back.toml", "--out", "flown", "--force"]);
    }
}

/// Distance of a place from a leg.
fn distance_m(at: &Position, from: &Position, to: &Position) -> f64 {
    let along = to - from;
    let part = if along.norm() > 0.0 { (at - from).dot(&along) / along.norm_squared() } else { 0.0 };
    (from + along * part.clamp(0.0, 1.0) - at).norm()
}

/// The flight of `holds.waypoints`: 80 m at 8 m/s, 10 s, and a hold of 5 s; 60 m, 7.5 s, and 10 s; at 4 m/s 80 m, 20 s,
/// and a hold of 7.5 s; 60 m home, 15 s.
#[test]
fn holds_and_speeds_of_a_waypoint_file_are_flown() {
    let place = place();
    place.run_ok(&["new", "holds", "--plan", "holds.waypoints", "--sensors", "nodes.csv"]);
    let times_s: Vec<f64> = rows(&place, "holds/track.csv").iter().map(|row| row.time_s).collect();
    let expected_s = [0.0, 10.0, 15.0, 22.5, 32.5, 52.5, 60.0, 75.0];
    assert_eq!(times_s.len(), expected_s.len() + usize::from(times_s[times_s.len() - 1].fract() == 0.0));
    for (time_s, expected_s) in times_s.iter().zip(expected_s) {
        assert!((time_s - expected_s).abs() < 0.1, "{times_s:?}");
    }
    let scenario = read(&place, "holds/holds.toml");
    assert_eq!((scenario.uav.altitude_m, scenario.uav.max_speed_mps), (30.0, 8.0));
}

/// What a plan of each shape becomes, what it loses, and what is refused.
#[test]
fn plans_of_other_programs_become_missions() {
    let place = place();
    place.assert_transcript(&expect_file!["transcripts/plans.txt"]);
}
