//! `skysink export`: refusals, and agreement of the exported flight with the run.

use std::fs::File;
use std::thread;
use std::time::Duration;

use crate::support::Place;
use expect_test::expect_file;
use skysink_common::geodata::projection::Projection;
use skysink_common::geometry::Position;
use skysink_common::scenario::Origin;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const ORIGIN: &str = "47.3977,8.5456";

/// A corridor of 100 m, with two sensor nodes at its end.
const CORRIDOR: &str = "name = \"corridor\"\nslots = 6\n[area]\nwidth_m = 100.0\nheight_m = 10.0\n\
    origin_lat_deg = 0.0\norigin_lon_deg = 0.0\n[sensors]\nfile = \"two.csv\"\n\
    [uav]\nmax_speed_mps = 20.0\nstart_m = [0.0, 5.0]\n";

/// Fails unless the command is refused with one line that holds `expected`.
fn refused(place: &Place, arguments: &[&str], expected: &str) {
    let ended = place.run(arguments).assert_code(2);
    assert!(ended.stderr.contains(expected), "{arguments:?}: {ended:?}");
}

/// The names of all files beside the run.
fn files(place: &Place) -> Vec<String> {
    let entries = std::fs::read_dir(place.path(".")).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<_> = entries.map(|name| name.into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn bad_input_is_refused_and_nothing_is_written() {
    let place = Place::new();
    place.flight("smoke").simulate();
    place.assert_transcript(&expect_file!["transcripts/export.txt"]);
}

#[test]
fn concurrent_exports_into_one_folder_are_serialised() {
    let place = Place::new();
    place.flight("smoke").simulate();
    let folder = File::open(place.path("")).unwrap();
    folder.lock().unwrap();
    let mut export = place.skysink(&["export", "run", "--format", "geojson", "--origin", ORIGIN]).spawn().unwrap();
    thread::sleep(Duration::from_millis(300));
    assert_eq!((export.try_wait().unwrap(), files(&place)), (None, vec!["run".to_owned(), "smoke.toml".to_owned()]));
    folder.unlock().unwrap();
    assert!(export.wait().unwrap().success());
    assert_eq!(files(&place), ["run", "run.geojson", "smoke.toml"]);
}

#[test]
fn a_modified_or_unfinished_trace_is_refused() {
    let place = Place::new();
    place.flight("smoke").simulate();
    let geojson = ["export", "run", "--format", "geojson", "--origin", ORIGIN];
    let whole = place.trace("run");
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    let without_last = lines[..lines.len() - 1].concat();
    let swapped = [&lines[..5], &[lines[6], lines[5]], &lines[7..]].concat().concat();
    for (spoilt, expected) in [
        (without_last.as_str(), "as in summary.json"),
        (&whole[..whole.len() - 5], "as in summary.json"),
        (&swapped, "expected slot 5"),
        (&whole.replace(",serve,0\n", ",transit,0\n"), "slots.csv"),
        ("a,b\n", "line 1"),
        ("", "as in summary.json"),
    ] {
        place.write("run/slots.csv", spoilt);
        refused(&place, &geojson, expected);
    }
    place.write("run/slots.csv", &whole);
    let summary = place.read("run/summary.json");
    std::fs::remove_file(place.path("run/summary.json")).unwrap();
    refused(&place, &geojson, "expected the folder of a run that has ended");
    place.write("run/summary.json", &summary);
    place.run_ok(&geojson);
    refused(&place, &geojson, "run.geojson: it exists");
    place.run_ok(&[&geojson[..], &["--force"]].concat());
    for own in ["run/slots.csv", "run/scenario.toml", "run/mission.rrd"] {
        refused(&place, &[&geojson[..], &["--force", "--out", own]].concat(), "it is a file of a run");
    }
    assert_eq!(place.read("run/slots.csv"), whole);
    place.write("run/scenario.toml", &place.read("run/scenario.toml").replace("seed = 1", "seed = 2"));
    refused(&place, &geojson, "it was modified after the start of the run");
}

#[test]
fn an_origin_is_refused_for_a_scenario_that_has_one() {
    let place = Place::new();
    place.write("two.csv", "x_m,y_m\n90,5\n92,5\n");
    place.write("corridor.toml", CORRIDOR);
    place.flight("corridor").simulate();
    refused(&place, &["export", "run", "--format", "geojson", "--origin", ORIGIN], "omit --origin");
}

/// Four slots of 20 m, the last of which serves (0.1 s): one waypoint, 80 m east. 11 m more, which is slower by more
/// than a tenth of 20 m/s, then a slot of hovering: 1.1 s. ArduPilot holds for whole seconds, 1 and 2. Then back above
/// home. East x is asin(x/6378137 m): 80 m are 0.000718652°, 91 m 0.000817467°. North 5 m are 5/6335439 · 180°/π =
/// 0.000045218°, by the radius b²/a of the meridian at the equator.
#[test]
fn a_short_mission_matches_the_expected_files() {
    let place = Place::new();
    place.write("two.csv", "x_m,y_m,queue_bits,gain_db,sampling_bps\n90,5,1000,-50,100\n92,5,1000,-50,100\n");
    place.write("corridor.toml", CORRIDOR);
    place.flight("corridor").simulate();
    for format in ["waypoints", "qgc-plan", "geojson", "csv"] {
        place.run_ok(&["export", "run", "--format", format, "--out", "corridor"]);
        expect_file![format!("{ROOT}/tests/golden/corridor.{format}")].assert_eq(&place.read("corridor"));
        std::fs::remove_file(place.path("corridor")).unwrap();
    }
}

#[test]
fn no_file_of_an_earlier_export_is_left() {
    let place = Place::new();
    place.flight("smoke").simulate();
    let export = ["export", "run", "--format", "qgc-plan", "--ignore-endurance", "--origin", ORIGIN];
    let in_parts = [&export[..], &["--most-items", "9"]].concat();
    place.run_ok(&export);
    refused(
        &place,
        &in_parts,
        "output file run.plan: it is of an earlier export: choose another --out, or pass --force",
    );
    assert_eq!(files(&place), ["run", "run.plan", "smoke.toml"]);
    place.run_ok(&[&in_parts[..], &["--force"]].concat());
    let parts = files(&place);
    assert!(parts.len() > 3 && !parts.contains(&"run.plan".to_owned()), "{parts:?}");
    refused(&place, &export, "it is of an earlier export");
    place.run_ok(&[&export[..], &["--force"]].concat());
    assert_eq!(files(&place), ["run", "run.plan", "smoke.toml"]);
}

#[test]
fn files_of_a_fleet_have_the_extension_of_the_format() {
    let place = Place::new();
    place.flight("smoke").set("uav.count", 2).simulate();
    place.run_ok(&["export", "run", "--format", "mcap", "--origin", ORIGIN]);
    place.run_ok(&["export", "run", "--format", "geojson", "--origin", ORIGIN, "--out", "v1.2"]);
    let expected = ["run", "run-uav-0.mcap", "run-uav-1.mcap", "smoke.toml", "v1-uav-0.2", "v1-uav-1.2"];
    assert_eq!(files(&place), expected);
}

/// Position [m] and altitude [m] of every waypoint of the files, in order.
fn waypoints(place: &Place, names: &[String], origin: Origin) -> Vec<(Position, f64)> {
    let projection = Projection::at(origin);
    let text: String = names.iter().map(|name| place.read(name)).collect();
    let rows = text.lines().map(|line| line.split('\t').collect::<Vec<_>>());
    let rows = rows.filter(|row| row.len() == 12 && row[3] == "16" && row[0] != "0");
    rows.map(|row| {
        let [lat_deg, lon_deg, altitude_m] = [8, 9, 10].map(|column: usize| row[column].parse::<f64>().unwrap());
        (projection.project(lat_deg, lon_deg).unwrap(), altitude_m)
    })
    .collect()
}

#[test]
fn every_service_point_is_in_the_mission_in_order() {
    let place = Place::new();
    let origin = Origin { lat_deg: -33.9, lon_deg: 18.4 };
    let missions = [("smoke", "rfs"), ("sparse", "gfs"), ("letter", "round-robin"), ("plos-suburban", "uts")];
    for (scenario, strategy) in
        missions.into_iter().flat_map(|(scenario, strategy)| [(scenario, strategy), (scenario, "rfs")])
    {
        place.flight(scenario).strategy(strategy).force().simulate();
        let most = ["--most-items", "100", "--ignore-endurance", "--origin", "-33.9,18.4", "--force"];
        let ended = place.run_ok(&[&["export", "run", "--format", "waypoints"][..], &most].concat());
        let names = ended.stdout.lines().filter(|line| line.ends_with(".waypoints"));
        let names: Vec<String> = names.map(str::to_owned).collect();
        for name in &names {
            assert!(place.read(name).lines().count() <= 101, "{name}: too long");
        }
        let mut waypoints = waypoints(&place, &names, origin).into_iter().peekable();
        for line in place.trace("run").lines().skip(1) {
            let columns: Vec<&str> = line.split(',').collect();
            let [x_m, y_m, z_m] = [2, 3, 4].map(|column: usize| columns[column].parse::<f64>().unwrap());
            let is_here = |&(position, altitude_m): &(Position, f64)| {
                (position - Position::new(x_m, y_m)).norm() < 0.1 && (altitude_m - z_m).abs() < 0.1
            };
            if !columns[5].is_empty() {
                while waypoints.next_if(|waypoint| !is_here(waypoint)).is_some() {}
                assert!(waypoints.peek().is_some(), "{scenario} {strategy}: not in the mission: {line}");
            }
        }
    }
}

#[test]
fn the_help_lists_every_format() {
    Place::new().assert_transcript(&expect_file!["transcripts/export-help.txt"]);
}
