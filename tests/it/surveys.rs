//! `skysink new` from what was surveyed: a flight log (decision D32), and the heights of the ground (D37).

use std::fmt::Write as _;

use expect_test::expect_file;
use skysink_common::airspace::Polygon;
use skysink_common::geometry::Position;
use skysink_common::scenario::{Overrides, Scenario};

use crate::support::{Place, scenarios};

fn read(place: &Place, name: &str) -> Scenario {
    scenarios::read(&place.path(name), Overrides::default())
}

const RATES: &str = "snr_db,rate_bps\n0,20000\n5,60000\n10,180000\n";

/// Two sensor nodes far from the origin, as in UTM.
const NODES: [[f64; 2]; 2] = [[500_100.0, 4_000_050.0], [500_300.0, 4_000_150.0]];

/// The SNR of a law, with shadows that stay.
fn snr_db(node: usize, [x_m, y_m]: [f64; 2]) -> f64 {
    let range_m = (x_m - NODES[node][0]).hypot(y_m - NODES[node][1]).hypot(30.0);
    let shadow_db = 6.0 * ((x_m - 500_000.0) / 40.0).sin() * ((y_m - 4_000_000.0) / 40.0 + node as f64).cos();
    60.0 - 25.0 * range_m.log10() + shadow_db
}

/// A flight of lanes 25 m apart over 400 m × 200 m at 10 m/s and 30 m, after a climb, with an SNR of each node a
/// second.
fn log() -> String {
    let mut rows = "time_s,x_m,y_m,z_m,sensor,snr_db\n-2,500000,4000000,5,,\n".to_owned();
    for second in 0..=360 {
        let [lane, along_m] = [second / 40, second % 40 * 10];
        let along_m = if lane % 2 == 0 { along_m } else { 400 - along_m };
        let at = [500_000.0 + f64::from(along_m), 4_000_000.0 + 25.0 * f64::from(lane)];
        for node in 0..2 {
            writeln!(rows, "{second},{},{},30,n{node},{:.2}", at[0], at[1], snr_db(node, at)).unwrap();
        }
    }
    rows
}

fn write_log(place: &Place) {
    std::fs::create_dir(place.path("logged")).unwrap();
    place.write("logged/log.csv", &log());
    place.write("logged/rates.csv", RATES);
    let row = |node: usize| format!("n{node},{},{},900,9000\n", NODES[node][0], NODES[node][1]);
    place.write("logged/sensors.csv", &format!("id,x_m,y_m,rate,buffer\n{}{}", row(0), row(1)));
}

#[test]
fn a_flight_log_becomes_a_map_and_a_fixed_flight() {
    let place = Place::new();
    write_log(&place);
    let into_its_folder = ["new", "aerial", "--log", "logged", "--out", "logged", "--force"];
    place
        .run_refused(&into_its_folder, "file logged/sensors.csv: the scenario is made from it: expected another --out");
    let printed = place.run_ok(&["new", "aerial", "--log", "logged"]).stdout;
    assert!(printed.contains("1 rows farther than 10 m from the altitude of 30 m are left out"), "{printed}");
    let errors: Vec<f64> = printed
        .lines()
        .find(|line| line.starts_with("links: "))
        .unwrap()
        .split(" dB")
        .filter_map(|part| part.rsplit(' ').next()?.parse().ok())
        .collect();
    assert!(errors.len() == 2 && errors[0] < 0.8 * errors[1] && errors[1] < 4.0, "{printed}");
    let scenario = read(&place, "aerial/aerial.toml");
    assert_eq!((scenario.slots, scenario.uav.altitude_m), (360, 30.0));
    let waypoints_m = scenario.uav.waypoints_m.as_ref().unwrap();
    // The area begins 10 m south and west of the flight.
    assert_eq!([waypoints_m[0], waypoints_m[39]], [[20.0, 10.0, 30.0], [410.0, 35.0, 30.0]]);
    let map = scenario.link.map.unwrap();
    let law_db = scenario.link.law_snr_db.unwrap();
    assert!((50.0..70.0).contains(&law_db), "{law_db}");
    // On the flown lanes the map is near what was measured.
    let sensor = Position::new(NODES[0][0] - 499_990.0, NODES[0][1] - 3_999_990.0);
    let errors = waypoints_m.iter().map(|[x_m, y_m, z_m]| {
        let level_db = map.level(&sensor, &[*x_m, *y_m, *z_m].into());
        (level_db - snr_db(0, [x_m + 499_990.0, y_m + 3_999_990.0])).powi(2)
    });
    let rms_db = (errors.sum::<f64>() / 360.0).sqrt();
    assert!(rms_db < 2.0, "{rms_db} dB");
    let checked = place.run_ok(&["check", "aerial/aerial.toml"]);
    assert!(!checked.stderr.contains("constant beyond"), "{checked:?}");
    place.run_ok(&["simulate", "aerial/aerial.toml", "--out", "run", "--set", "planner.horizon.iterations=100"]);
    assert!(place.summary("run")["delivered_bits"].as_u64().unwrap() > 0);
    place.assert_repeatable("run");
}

#[test]
fn positions_in_degrees_are_logged_over_a_georeferenced_area() {
    let place = Place::new();
    std::fs::create_dir(place.path("logged")).unwrap();
    let row = |second: i32| {
        format!("{second},{},-78.69,25,{},{}\n", 35.72 + f64::from(second) * 5e-5, second % 2, 12 - second)
    };
    let rows: String = (0..20).map(row).collect();
    place.write("logged/log.csv", &format!("time_s,lat_deg,lon_deg,z_m,sensor,snr_db\n{rows}"));
    place.write("logged/rates.csv", RATES);
    place.write("nodes.geojson", r#"{"type":"MultiPoint","coordinates":[[-78.691,35.7205],[-78.689,35.7205]]}"#);
    place.run_ok(&["new", "aerial", "--log", "logged", "--sensors", "nodes.geojson"]);
    let scenario = read(&place, "aerial/aerial.toml");
    // 5e-5° of latitude are 5.55 m.
    let waypoints_m = scenario.uav.waypoints_m.as_ref().unwrap();
    let step_m = waypoints_m[18][1] - waypoints_m[17][1];
    assert!(scenario.slots == 19 && (step_m - 5.55).abs() < 0.01, "{step_m} m");
    place.run_ok(&["simulate", "aerial/aerial.toml", "--out", "run"]);
}

/// A grid of 60 × 40 cells of 10 m from (1000, 2000), with the `height` [m] of each middle, and four sensor nodes.
fn write_ground(place: &Place, height: impl Fn(f64, f64) -> f64) {
    let mut text = "ncols 60\nnrows 40\nxllcorner 1000\nyllcorner 2000\ncellsize 10\nNODATA_value -9999\n".to_owned();
    for row in (0..40).rev() {
        let along =
            (0..60).map(|column| height(f64::from(column) * 10.0 + 5.0, f64::from(row) * 10.0 + 5.0).to_string());
        text += &(along.collect::<Vec<_>>().join(" ") + "\n");
    }
    place.write("ground.asc", &text);
    place.write("nodes.csv", "x_m,y_m\n1020,2030\n1580,2030\n1020,2370\n1580,2370\n");
}

/// 60 m high in the middle of the grid, 0.5 m lower each metre from there.
fn cone(x_m: f64, y_m: f64) -> f64 {
    (60.0 - 0.5 * (x_m - 300.0).hypot(y_m - 200.0)).max(0.0)
}

/// Over a start on the plain the UAV is 20 m high, so that the ground above 10 m is closed: within 100 m of the middle.
#[test]
fn the_contour_of_a_cone_becomes_a_zone() {
    let place = Place::new();
    write_ground(&place, cone);
    let new = ["new", "hill", "--sensors", "nodes.csv", "--terrain", "ground.asc", "--start", "1050,2050"];
    let printed = place.run_ok(&new).stdout;
    assert!(printed.contains("0.0 m at the start, 20.0 m in flight, 1 no-fly zones"), "{printed}");
    let scenario = read(&place, "hill/hill.toml");
    let [zone] = &scenario.area.no_fly.as_ref().unwrap()[..] else { panic!("one zone") };
    let corners_m = zone.corners();
    // The area begins 10 m beside the sensor nodes.
    let middle = Position::new(300.0 - 10.0, 200.0 - 20.0);
    let radii_m = corners_m.iter().map(|corner| (Position::from(*corner) - middle).norm());
    let farthest_m = radii_m.fold(0.0, f64::max);
    assert!((95.0..=100.0 + 2.0 * 10.0 * 2f64.sqrt()).contains(&farthest_m), "{farthest_m} m");
    let polygon = Polygon::of(corners_m, false).unwrap();
    for degrees in 0..360 {
        let (sine, cosine) = f64::from(degrees).to_radians().sin_cos();
        let rim = Position::new(middle.x + 99.0 * cosine, middle.y + 99.0 * sine);
        // A cell that is as high in its middle covers at most half a diagonal more or less.
        let inner = middle + (rim - middle) * ((99.0 - 7.1) / 99.0);
        assert!(polygon.encloses(&inner), "{degrees}°");
    }
    let list = place.read("hill/sensors.csv");
    assert!(list.starts_with("x_m,y_m,ground_m\n"), "{list}");
    let text = place.read("hill/hill.toml").replace("slots = 600", "slots = 60");
    place.write("hill/hill.toml", &text);
    for strategy in ["horizon", "uts"] {
        place.run_ok(&["simulate", "hill/hill.toml", "--strategy", strategy, "--out", "run", "--force"]);
    }
    place.assert_repeatable("run");
}

/// A wall of 15 m through the middle, above which the UAV is not let, and a radio that reaches over it.
#[test]
fn a_ridge_hides_what_lies_behind_it() {
    let place = Place::new();
    write_ground(&place, |x_m, _| if (x_m - 305.0).abs() < 1.0 { 15.0 } else { 0.0 });
    let new = [
        "new",
        "ridge",
        "--sensors",
        "nodes.csv",
        "--terrain",
        "ground.asc",
        "--clearance",
        "0",
        "--start",
        "1050,2200",
    ];
    let radio = ["--radio", "lora-sf7", "--drone", "x500"];
    let printed = place.run_ok(&[&new[..], &radio].concat()).stdout;
    assert!(printed.contains("30.0 m in flight, 0 no-fly zones where the ground is above 30.0 m"), "{printed}");
    let scenario = read(&place, "ridge/ridge.toml");
    let map = scenario.link.map.unwrap();
    // SN 0, 285 m west of the wall, sees 30 m high up to 285 · 30/15 = 570 m, x = 590 in the grid;
    // SN 1, 275 m east of it, up to 550 m, x = 30 in the grid, 20 in the area.
    let level = |sensor: [f64; 2], x_m: f64| map.level(&Position::from(sensor), &[x_m, 100.0, 30.0].into());
    assert!(level([10.0, 10.0], 560.0) > 0.0 && level([570.0, 10.0], 40.0) > 0.0);
    assert_eq!(level([570.0, 10.0], 5.0), f64::NEG_INFINITY);
    assert!(scenario.link.setup_s.is_some() && scenario.link.comm_radius_m > 4_000.0, "{:?}", scenario.link);
    place.run_ok(&["simulate", "ridge/ridge.toml", "--set", "slots=20", "--out", "run"]);
}

#[test]
fn flat_ground_changes_nothing() {
    let place = Place::new();
    write_ground(&place, |_, _| 250.0);
    place.run_ok(&["new", "plain", "--sensors", "nodes.csv"]);
    place.run_ok(&["new", "plain", "--sensors", "nodes.csv", "--terrain", "ground.asc", "--out", "flat"]);
    assert_eq!(place.read("plain/plain.toml"), place.read("flat/plain.toml"));
    for folder in ["plain", "flat"] {
        place.run_ok(&[
            "simulate",
            &format!("{folder}/plain.toml"),
            "--set",
            "slots=50",
            "--out",
            &format!("run-{folder}"),
        ]);
    }
    place.assert_same_trace("run-plain", "run-flat");
}

#[test]
fn an_invalid_survey_is_refused() {
    let place = Place::new();
    write_log(&place);
    write_ground(&place, cone);
    place.assert_transcript(&expect_file!["transcripts/surveys.txt"]);
}
