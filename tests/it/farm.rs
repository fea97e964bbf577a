//! Missions over the hills of the farm: what the exported files clear, and what they say.

use skysink_common::geodata::projection::Projection;
use skysink_common::geometry::Position;
use skysink_common::scenario::Origin;

use crate::support::Place;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

const ORIGIN: Origin = Origin { lat_deg: 47.40, lon_deg: 8.55 };

/// The altitude of the model above the ground [m].
const ALTITUDE_M: f64 = 40.0;

/// The ground of `scenarios/farm`, whose file has the same formula [m].
fn ground_m(at: &Position) -> f64 {
    let wave = |along_m: f64, length_m: f64| std::f64::consts::TAU * along_m / length_m;
    520.0 + 60.0 * wave(at.x, 1400.0).sin() * wave(at.y, 1700.0).cos() + 40.0 * wave(at.x + at.y, 1100.0).sin()
}

/// A mission of `strategy` over the farm, in `run`.
fn farm(strategy: &str) -> Place {
    let place = Place::new();
    for file in ["farm.toml", "sensors.csv"] {
        std::fs::copy(format!("{ROOT}/scenarios/farm/{file}"), place.path(file)).unwrap();
    }
    place.flight("farm").strategy(strategy).simulate();
    place
}

/// Position [m] and altitude [m] of home and every waypoint of a file of waypoints, and its frames but for home and
/// take-off.
fn waypoints(place: &Place, name: &str) -> (Vec<(Position, f64)>, Vec<u8>) {
    let projection = Projection::at(ORIGIN);
    let text = place.read(name);
    let rows =
        text.lines().skip(1).map(|line| line.split('\t').map(|cell| cell.parse().unwrap()).collect::<Vec<f64>>());
    let rows: Vec<Vec<f64>> = rows.filter(|row| [16.0, 22.0].contains(&row[3])).collect();
    let nodes = rows.iter().map(|row| (projection.project(row[8], row[9]).unwrap(), row[10])).collect();
    (nodes, rows[2..].iter().map(|row| row[2] as u8).collect())
}

/// The same nodes from the plan of QGroundControl.
fn plan(place: &Place, name: &str) -> (Vec<(Position, f64)>, Vec<u8>) {
    let projection = Projection::at(ORIGIN);
    let plan: serde_json::Value = serde_json::from_str(&place.read(name)).unwrap();
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let home = &plan["mission"]["plannedHomePosition"];
    let home = (projection.project(number(&home[0]), number(&home[1])).unwrap(), number(&home[2]));
    let items = plan["mission"]["items"].as_array().unwrap();
    let items: Vec<_> = items.iter().filter(|item| [16, 22].contains(&item["command"].as_u64().unwrap())).collect();
    let at = |item: &&serde_json::Value| {
        let params = &item["params"];
        (projection.project(number(&params[4]), number(&params[5])).unwrap(), number(&params[6]))
    };
    let nodes = std::iter::once(home).chain(items.iter().map(at)).collect();
    (nodes, items[1..].iter().map(|item| item["frame"].as_u64().unwrap() as u8).collect())
}

/// The least clearance of the straight legs between these altitudes above the level of `ground_m` [m].
fn least_clearance_m(nodes: &[(Position, f64)]) -> f64 {
    let on_leg = |pair: &[(Position, f64)]| {
        let [(from, from_m), (to, to_m)] = [pair[0], pair[1]];
        let at = |step: i32| {
            let fraction = f64::from(step) / 200.0;
            from_m + (to_m - from_m) * fraction - ground_m(&(from + (to - from) * fraction))
        };
        (0..=200).map(at).fold(f64::INFINITY, f64::min)
    };
    nodes.windows(2).map(on_leg).fold(f64::INFINITY, f64::min)
}

#[test]
fn every_leg_of_an_exported_mission_clears_the_hills() {
    let relative_frame = 3;
    for strategy in ["tour", "horizon"] {
        let place = farm(strategy);
        for (format, read) in [("qgc-plan", plan as fn(&_, &_) -> _), ("waypoints", waypoints)] {
            let export = |more: &[&str]| {
                let out = format!("run.{format}");
                place.run_ok(&[&["export", "run", "--force", "--format", format, "--out", &out], more].concat());
                read(&place, &out)
            };
            // For ArduPilot, the ground below is the default over hills; PX4 refuses that frame.
            let (_, frames) = export(&[]);
            let default = if format == "waypoints" { 10 } else { relative_frame };
            assert!(frames.iter().all(|&frame| frame == default), "{format}: {frames:?}");
            let (nodes, frames) = export(&["--altitude", "terrain"]);
            assert!(frames.iter().all(|&frame| frame == 10), "{frames:?}");
            assert!(nodes[1..].iter().all(|(_, altitude_m)| *altitude_m == ALTITUDE_M), "{nodes:?}");

            let (mut nodes, frames) = export(&["--altitude", "msl", "--min-bits", "2000", "--ignore-endurance"]);
            assert!(frames.iter().all(|&frame| frame == 0), "{frames:?}");
            nodes[1].1 += ground_m(&nodes[1].0); // the take-off is above home
            let clearance_m = least_clearance_m(&nodes[1..]);
            assert!(clearance_m >= ALTITUDE_M, "{strategy}, {format}: {clearance_m} m above the ground");

            let (mut nodes, frames) = export(&["--altitude", "relative", "--ignore-endurance"]);
            assert!(frames.iter().all(|&frame| frame == relative_frame), "{frames:?}");
            let home_m = ground_m(&nodes[0].0);
            assert!(nodes[0].1 <= home_m, "home is not taken for higher than it is: {}", nodes[0].1);
            nodes.iter_mut().for_each(|(_, altitude_m)| *altitude_m += home_m);
            let clearance_m = least_clearance_m(&nodes[1..]);
            assert!(clearance_m >= ALTITUDE_M, "{strategy}, {format}: {clearance_m} m above the ground");
        }
    }
}

#[test]
fn an_export_prints_home_altitudes_time_and_warnings() {
    let place = farm("tour");
    let export =
        |more: &[&str]| place.run_ok(&[&["export", "run", "--format", "qgc-plan", "--force"], more].concat()).stdout;
    let text = export(&["--altitude", "terrain"]);
    assert!(text.contains("\nhome 47.4005392"), "{text}");
    assert!(text.contains("40 m above the ground below (the autopilot needs terrain data)"), "{text}");
    assert!(text.contains(" s with 2.5 m/s² and 4 m/s³ (planned: 1500 s)"), "{text}");
    assert!(!text.contains("warning"), "{text}");
    let plan: serde_json::Value = serde_json::from_str(&place.read("run.plan")).unwrap();
    assert_eq!(plan["mission"]["firmwareType"], 12);
    export(&["--autopilot", "ardupilot", "--fence-margin", "25"]);
    let wider: serde_json::Value = serde_json::from_str(&place.read("run.plan")).unwrap();
    assert_eq!(wider["mission"]["firmwareType"], 3);
    let corner = |plan: &serde_json::Value| {
        let corner = &plan["geoFence"]["polygons"][0]["polygon"][0];
        Projection::at(ORIGIN).project(corner[0].as_f64().unwrap(), corner[1].as_f64().unwrap()).unwrap()
    };
    assert!((corner(&plan) - Position::origin()).norm() < 1e-3);
    assert!((corner(&wider) - Position::new(-25.0, -25.0)).norm() < 1e-3, "{}", corner(&wider));

    place.run_refused(
        &["export", "run", "--format", "qgc-plan", "--force", "--acceleration", "0.5"],
        "more than the endurance, 2400 s",
    );
    let scenario = place.read("farm.toml").replace("acceleration_mps2", "#").replace("max_speed_mps", "#");
    let (before, rest) = scenario.split_once("[link]").unwrap();
    let (_, after) = rest.split_once("[uav]").unwrap();
    place.write("paper.toml", &format!("{before}[uav]{after}"));
    place.flight("paper").out("paper").simulate();
    let text = place.run_ok(&["export", "paper", "--format", "qgc-plan", "--ignore-endurance"]).stdout;
    assert!(
        text.contains("warning: uav.max_speed_mps = 30, at 40 m and without acceleration and [link] as in"),
        "{text}"
    );
}

#[test]
fn a_new_scenario_prints_its_centre() {
    let place = Place::new();
    place.write("two.csv", "lat,lon,ground_m\n47.40,8.55,512.5\n47.41,8.56,530\n");
    let text = place.run_ok(&["new", "two", "--sensors", "two.csv"]).stdout;
    assert!(text.contains("Centre of the area:  47.405"), "{text}");
    assert_eq!(place.read("two/sensors.csv"), "lat_deg,lon_deg,ground_m\n47.4,8.55,512.5\n47.41,8.56,530\n");
}

/// The vehicle accelerates with 2.5 m/s² without jerk, as the scenario says. It neither waits above home nor lands more
/// slowly near the ground, some 25 s of more than 1900 s.
#[cfg(feature = "mavlink")]
#[test]
fn the_estimated_time_is_within_a_tenth_of_the_kinematic_vehicle() {
    use skysink_kinematic_vehicle::{KinematicOptions, mission};

    for strategy in ["tour", "horizon"] {
        let place = farm(strategy);
        for (format, more) in [
            ("qgc-plan", &["--autopilot", "ardupilot", "--jerk", "1e3"][..]),
            ("waypoints", &["--jerk", "1e3"]),
            ("waypoints", &["--jerk", "1e3", "--altitude", "relative", "--min-bits", "4000"]),
        ] {
            let words = ["export", "run", "--force", "--ignore-endurance", "--format", format];
            let text = place.run_ok(&[&words[..], more].concat()).stdout;
            let estimated = text.split("from take-off to landing: ").nth(1).unwrap().split(" s").next().unwrap();
            let path = place.path(if format == "qgc-plan" { "run.plan" } else { "run.waypoints" });
            let options = KinematicOptions { speed: 12.0, ..KinematicOptions::default() };
            let flown = mission::fly(&mission::read(&path).unwrap(), &options).unwrap();
            let ratio = estimated.parse::<f64>().unwrap() / flown.whole_s;
            assert!((0.9..1.1).contains(&ratio), "{strategy}, {format}, {more:?}: {estimated} s of {flown:?}");
        }
    }
}
