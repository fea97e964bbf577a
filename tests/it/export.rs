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
    let mut export = place
        .skysink(&["export", "run", "--format", "geojson", "--origin", ORIGIN, "--north", "true"])
        .spawn()
        .unwrap();
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
    let geojson = ["export", "run", "--format", "geojson", "--origin", ORIGIN, "--north", "true"];
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
    let export = ["export", "run", "--format", "qgc-plan", "--ignore-endurance", "--origin", ORIGIN, "--north", "true"];
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
    place.run_ok(&["export", "run", "--format", "mcap", "--origin", ORIGIN, "--north", "true"]);
    place.run_ok(&["export", "run", "--format", "geojson", "--origin", ORIGIN, "--north", "true", "--out", "v1.2"]);
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
        let most =
            ["--most-items", "100", "--ignore-endurance", "--origin", "-33.9,18.4", "--north", "true", "--force"];
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

/// Two sensor nodes beyond the corner of a zone: the tour goes to and fro past it.
const BAY: &str = "name = \"bay\"\nslots = 30\nslot_s = 20.0\n[area]\nside_m = 200.0\norigin_lat_deg = 50.1\n\
    origin_lon_deg = 7.2\n[[area.no_fly]]\npolygon_m = [[80, 80], [199, 80], [199, 199], [80, 199]]\n[sensors]\n\
    file = \"nodes.csv\"\n[uav]\nstart_m = [40.0, 20.0]\nmax_speed_mps = 10.0\nacceleration_mps2 = 2.5\n[link]\n\
    comm_radius_m = 10.0\ncomm_s = 2.0\n";

#[test]
fn legs_past_the_corner_of_a_zone_are_counted() {
    let place = Place::new();
    place.write("nodes.csv", "x_m,y_m\n70,190\n190,70\n");
    place.write("bay.toml", BAY);
    place.flight("bay").strategy("tour").simulate();
    let export = ["export", "run", "--format", "qgc-plan", "--ignore-endurance", "--force"];
    let said = place.run_ok(&export).stdout;
    assert!(said.contains("legs pass within 2 m of a zone, 0.0 m at least"), "{said}");
    let said = place.run_ok(&[&export[..], &["--margin", "0"]].concat()).stdout;
    assert!(!said.contains("legs pass") && said.contains("0.0 m to a zone"), "{said}");
}

#[test]
fn waypoints_above_the_ground_are_not_for_qgroundcontrol() {
    let place = Place::new();
    place.write("nodes.csv", "x_m,y_m,ground_m\n70,190,560\n190,70,590\n");
    place.write("bay.toml", BAY);
    place.flight("bay").strategy("tour").simulate();
    let said = |format: &str, more: &[&str]| {
        let words = ["export", "run", "--format", format, "--ignore-endurance", "--force"];
        place.run_ok(&[&words[..], more].concat()).stdout
    };
    let warning =
        "warning: frame 10, above the ground below: QGroundControl reads it from this format as above sea level";
    assert!(said("waypoints", &[]).contains(warning));
    for (format, altitude) in [("waypoints", "relative"), ("waypoints", "msl"), ("qgc-plan", "terrain")] {
        assert!(!said(format, &["--altitude", altitude]).contains("QGroundControl reads"), "{format}, {altitude}");
    }
}

/// The reader of KMZ files takes the waypoints of the template for sensor nodes.
#[test]
fn a_route_file_of_dji_is_read_as_kmz() {
    let place = Place::new();
    place.write("nodes.csv", "x_m,y_m\n70,190\n190,70\n");
    place.write("bay.toml", BAY);
    place.flight("bay").strategy("tour").simulate();
    let said = place.run_ok(&["export", "run", "--format", "dji", "--drone", "m350", "--ignore-endurance"]).stdout;
    assert!(said.contains("warning: not flown") && said.contains("\nrun.kmz"), "{said}");
    let waypoints = said.split(" → ").nth(1).and_then(|text| text.split(' ').next()).unwrap().parse::<usize>().unwrap();
    place.run_ok(&["new", "back", "--sensors", "run.kmz"]);
    let rows = place.read("back/sensors.csv").lines().count() - 1;
    assert!((waypoints..=waypoints + 3).contains(&rows), "{rows} of {waypoints} and the way home");
}

#[test]
fn metres_are_exported_to_the_earth_if_y_is_true_north() {
    let place = Place::new();
    place.flight("smoke").simulate();
    let said = place.run_ok(&["export", "run", "--format", "csv", "--origin", ORIGIN, "--north", "true"]).stdout;
    assert!(said.contains("y is taken for true north"), "{said}");
}

#[test]
fn the_help_lists_every_format() {
    Place::new().assert_transcript(&expect_file!["transcripts/export-help.txt"]);
}
