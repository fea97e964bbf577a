//! What the folder of a sweep holds of it: it is repeated from there, and extended.

use std::fs;

use serde_json::Value;

use super::{FILES, assert_equal, write_sweep};
use crate::support::Place;

/// A sweep over a list, with an area that is swept and a base scenario in another folder. Its fields differ by seed.
fn write_listed(place: &Place) {
    fs::create_dir(place.path("fields")).unwrap();
    let rows: String = (0..12).map(|at| format!("{},{}\n", 3 * at, 37 - 3 * at)).collect();
    place.write("fields/points.csv", &format!("x_m,y_m\n{rows}"));
    let head = "name = \"listed\"\nslots = 40\n[area]\nside_m = 40.0\n[sensors]\nfile = \"points.csv\"\n";
    place.write("fields/base.toml", &format!("{head}sampling_bps = [100.0, 900.0]\ncapacity_bits = 12000\n"));
    let head = "scenario = \"fields/base.toml\"\nstrategies = [\"uts\", \"rfs\"]\nseeds = [2, 5]\n";
    place.write("listed.toml", &format!("{head}[axes]\n\"area.side_m\" = [40.0, 61.1]\nslots = [40]\n"));
}

fn table(place: &Place, file: &str) -> toml::Table {
    place.read(file).parse().unwrap()
}

fn builds(place: &Place, folder: &str) -> Vec<String> {
    let manifest: Value = serde_json::from_str(&place.read(&format!("{folder}/sweep.json"))).unwrap();
    serde_json::from_value(manifest["builds"].clone()).unwrap()
}

/// Writes another program than this one into the manifest of a folder.
fn forge_build(place: &Place, folder: &str, build: &str) {
    let file = format!("{folder}/sweep.json");
    let own = builds(place, folder).remove(0);
    place.write(&file, &place.read(&file).replace(&own, build));
}

#[test]
fn a_sweep_folder_alone_repeats_its_sweep() {
    let place = Place::new();
    write_listed(&place);
    place.run_ok(&["sweep", "listed.toml", "--out", "first"]);
    let scenario = table(&place, "first/scenario.toml");
    assert_eq!(scenario["sensors"]["file"].as_str(), Some("sensors.csv"));
    assert_eq!(place.read("first/sensors.csv"), place.read("fields/points.csv"));
    let is_full = scenario["link"].get("comm_radius_m").is_some() && scenario["planner"].get("horizon").is_some();
    assert!(is_full && scenario["uav"].get("start_m").is_none(), "the start is the centre of each area: {scenario}");
    fs::remove_dir_all(place.path("fields")).unwrap();
    fs::remove_file(place.path("listed.toml")).unwrap();

    place.run_ok(&["sweep", "first", "--out", "second"]);
    place.run_ok(&["sweep", "first/sweep.toml", "--out", "third"]);
    for other in ["second", "third"] {
        assert_equal(&place, "first", other);
        for name in ["scenario.toml", "sensors.csv", "sweep.toml", "sweep.json"] {
            let [one, two] = ["first", other].map(|folder| place.read(&format!("{folder}/{name}")));
            assert_eq!(one, two, "{name} of {other}");
        }
    }
    // In its own folder it is continued.
    let journal = place.read("second/journal.csv");
    place.write("second/journal.csv", &journal[..journal.len() / 2]);
    place.run_ok(&["sweep", "second"]);
    assert_equal(&place, "first", "second");
}

#[test]
fn a_folder_whose_definition_was_modified_is_not_repeated() {
    let place = Place::new();
    write_listed(&place);
    place.run_ok(&["sweep", "listed.toml", "--out", "out"]);
    for (name, one, other, says) in [
        ("scenario.toml", "12000", "12001", "was modified: restore it"),
        ("sensors.csv", "\n3,34", "\n3,35", "was modified: restore it"),
        ("sweep.json", "61.1", "61.2", "its sweep.json was modified: restore it"),
        ("sweep.toml", "61.1", "61.2", "or fly another one: skysink sweep out/sweep.toml --out DIR"),
    ] {
        let file = format!("out/{name}");
        let whole = place.read(&file);
        assert!(whole.contains(one), "{name}: {whole}");
        place.write(&file, &whole.replace(one, other));
        place.run_refused(&["sweep", "out", "--out", "again"], says);
        assert!(!place.path("again").exists());
        place.write(&file, &whole);
    }
    // The results beside modified values are not shown either, and neither is a point that lacks a value.
    let manifest = place.read("out/sweep.json");
    fs::remove_file(place.path("out/sweep.toml")).unwrap();
    let mut cut: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    cut["points"][0].as_array_mut().unwrap().pop();
    for modified in [manifest.replace("61.1", "61.2"), cut.to_string()] {
        place.write("out/sweep.json", &modified);
        let commands = [
            &["sweep", "out", "--out", "again"][..],
            &["plot", "out", "--x", "area.side_m"],
            &["merge", "out", "--out", "again"],
        ];
        for command in commands {
            place.run_refused(command, "its sweep.json was modified: restore it");
        }
    }
    place.write("out/sweep.json", &manifest);
    place.run_ok(&["sweep", "out", "--out", "again"]);
    // As an earlier version left it.
    fs::remove_file(place.path("out/scenario.toml")).unwrap();
    place.run_refused(&["sweep", "out"], "sweep out: it is a folder without scenario.toml");
    // As one that was killed while it began, which the sweep file completes.
    place.run_ok(&["sweep", "listed.toml", "--out", "out"]);
    place.run_ok(&["sweep", "out"]);
}

#[test]
fn a_sweep_is_extended_by_seeds_and_strategies_and_flies_only_what_is_missing() {
    let place = Place::new();
    write_sweep(&place, 2);
    place.run_ok(&["sweep", "sweep.toml", "--seeds", "4", "--out", "whole"]);
    place.run_ok(&["sweep", "sweep.toml", "--strategies", "uts,gfs", "--seeds", "2,3", "--out", "grown"]);
    let flown = place.read("grown/journal.csv");
    place.run_ok(&["sweep", "sweep.toml", "--seeds", "2,3,4", "--out", "grown"]);
    let more = place.read("grown/journal.csv");
    place.run_ok(&["sweep", "grown", "--seeds", "4"]);
    assert!(more.starts_with(&flown) && place.read("grown/journal.csv").starts_with(&more));
    assert_equal(&place, "whole", "grown");
    for name in ["scenario.toml", "sweep.toml", "sweep.json"] {
        assert_eq!(place.read(&format!("whole/{name}")), place.read(&format!("grown/{name}")), "{name}");
    }

    let manifest = place.read("grown/sweep.json");
    let results = place.read("grown/results.csv");
    let scenario = place.read("smoke.toml");
    for (option, value, says) in [
        ("--seeds", "3", "another sweep, with seed 4: choose another --out"),
        ("--strategies", "uts,gfs", "another sweep, with strategies [\"uts\", \"gfs\", \"rfs\"]: expected them first"),
        ("--strategies", "gfs,uts,rfs", "expected them first"),
        ("--strategies", "uts,gfs,rfs,xyz", "expected one of"),
        ("--seeds", "2,2", "seeds = [2, 2]: expected each once"),
        ("--seeds", "0", "seeds = 0: expected 1 or more"),
    ] {
        place.run_refused(&["sweep", "sweep.toml", option, value, "--out", "grown"], says);
    }
    place.write("smoke.toml", &scenario.replace("count = 40", "count = 41"));
    place.run_refused(&["sweep", "sweep.toml", "--seeds", "9", "--out", "grown"], "with another scenario, sensor list");
    assert_eq!((place.read("grown/sweep.json"), place.read("grown/results.csv")), (manifest, results));
}

#[test]
fn an_interrupted_extension_leaves_no_results_of_the_smaller_sweep() {
    let place = Place::new();
    write_sweep(&place, 60);
    place.run_ok(&["sweep", "sweep.toml", "--out", "whole"]);
    place.run_ok(&["sweep", "sweep.toml", "--seeds", "2", "--out", "cut"]);
    let extension = super::sweep_until(&place, "cut", &[], 3 * 2 * 3 * 2 + 20);
    crate::support::signal_and_wait(rustix::process::Signal::KILL, extension);
    assert!(FILES.iter().all(|name| !place.path("cut").join(name).exists()));
    place.run_ok(&["sweep", "cut"]);
    assert_equal(&place, "whole", "cut");
}

#[test]
fn extended_shards_merge_into_the_whole_sweep_which_can_be_repeated() {
    let place = Place::new();
    write_sweep(&place, 5);
    place.run_ok(&["sweep", "sweep.toml", "--out", "whole"]);
    for (out, shard) in [("a", "1/2"), ("b", "2/2")] {
        place.run_ok(&["sweep", "sweep.toml", "--seeds", "3", "--shard", shard, "--out", out]);
    }
    place.run_ok(&["sweep", "a", "--seeds", "5"]); // its own shard
    place.run_refused(&["merge", "a", "b", "--out", "merged"], "shard b: it belongs to another sweep than the first");
    place.run_ok(&["sweep", "b", "--seeds", "5"]);
    place.run_ok(&["merge", "a", "b", "--out", "merged"]);
    assert_equal(&place, "whole", "merged");
    place.run_ok(&["sweep", "merged", "--out", "again"]);
    assert_equal(&place, "whole", "again");
    place.write("b/scenario.toml", &place.read("b/scenario.toml").replace("count = 40", "count = 41"));
    place.run_refused(&["merge", "b", "a", "--out", "other"], "sweep b: its scenario.toml, sensors.csv");
}

#[test]
fn a_sweep_lists_the_builds_of_its_missions() {
    let place = Place::new();
    write_sweep(&place, 2);
    place.run_ok(&["sweep", "sweep.toml", "--out", "sweep"]);
    let said = place.run_ok(&["--version"]).stdout;
    let own = builds(&place, "sweep").remove(0);
    assert!(said.contains(&format!("({own})")), "{own}, not {said}");
    let other = "0123456789ab-dirty, another compiler";
    forge_build(&place, "sweep", other);
    place.run_ok(&["sweep", "sweep.toml", "--out", "sweep"]);
    assert_eq!(builds(&place, "sweep"), [other], "nothing was missing");
    place.run_ok(&["sweep", "sweep.toml", "--out", "sweep", "--seeds", "3"]);
    assert_eq!(builds(&place, "sweep"), [other, own.as_str()]);
    place.run_ok(&["plot", "sweep", "--x", "area.side_m", "--where", "link.gain=static", "--out", "plots"]);
    let commit = own.split(',').next().unwrap();
    let is_named = |file: fs::DirEntry| {
        let drawn = fs::read_to_string(file.path()).unwrap_or_default();
        drawn.contains(&format!("(0123456789ab-dirty, {commit})"))
            && drawn.contains(&format!("built from {other}; {own}"))
    };
    assert!(fs::read_dir(place.path("plots")).unwrap().flatten().any(is_named), "no figure names the builds");

    for (out, shard) in [("a", "1/2"), ("b", "2/2")] {
        place.run_ok(&["sweep", "sweep.toml", "--shard", shard, "--out", out]);
    }
    forge_build(&place, "a", other);
    let merged = place.run_ok(&["merge", "a", "b", "--out", "merged"]);
    assert!(merged.stdout.contains(&format!("The shards were flown by 2 builds: {other}; {own}\n")), "{merged:?}");
    assert_eq!(builds(&place, "merged"), [other, own.as_str()]);
}

/// The waypoints of a fixed flight follow from the slots, which are swept, and a map from its arrays.
#[test]
fn a_folder_keeps_the_track_and_the_map_of_its_base() {
    let place = Place::new();
    fs::create_dir(place.path("fields")).unwrap();
    place.write("fields/flight.csv", "t_s,x_m,y_m\n0,20,20\n40,35,25\n");
    place.write("fields/links.csv", "sensor,x_m,y_m,z_m,rate_bps\n,0,0,20,9e4\n,40,0,20,7e4\n");
    let head = "name = \"flown\"\nslots = 40\nsensors.count = 12\narea.side_m = 40.0\nuav.track = \"flight.csv\"\n";
    place.write("fields/base.toml", &format!("{head}[link]\nmodel = \"map\"\nfile = \"links.csv\"\n"));
    let head = "scenario = \"fields/base.toml\"\nstrategies = [\"gfs\"]\nseeds = 1\n";
    place.write("flown.toml", &format!("{head}[axes]\nslots = [20, 40]\n"));
    place.run_ok(&["sweep", "flown.toml", "--out", "flown"]);
    fs::remove_dir_all(place.path("fields")).unwrap();
    place.run_ok(&["sweep", "flown", "--out", "again"]);
    assert_equal(&place, "flown", "again");
}
