//! `--set`, and the axes of a sweep: displaced keys and refusals.

use expect_test::expect_file;

use crate::support::Place;

/// A square field whose SNs are drawn, in surroundings that have a name.
const FILE: &str = "name = \"a\"\nslots = 30\n[area]\nside_m = 90.0\n[sensors]\ncount = 20\n[link]\n\
                    model = \"probabilistic-los\"\nenvironment = \"urban\"\n";

#[test]
fn a_refused_setting_names_the_option() {
    let place = Place::new();
    place.write("a.toml", "name = \"a\"\nslots = 30\n");
    place.write("list.csv", "x_m,y_m,sampling_bps\n1,2,300\n");
    place.write("links.csv", "sensor,x_m,y_m,z_m,rate_bps\n,0,0,20,9e4\n");
    place.assert_transcript(&expect_file!["transcripts/settings.txt"]);
    let told = ["check", "a.toml", "--set", "sensors.file=list.csv", "--set", "sensors.sampling_bps=[50, 400]"];
    place.run_ok(&[&told[..], &["--set", "planner.knowledge=estimated", "--set", "planner.rates=learnt"]].concat());
}

#[test]
fn a_setting_replaces_the_alternative_form_in_the_file() {
    let place = Place::new();
    place.write("a.toml", FILE);
    place.write("list.csv", "x_m,y_m\n1,2\n");
    for (set, kept, gone) in [
        (&["area.width_m=50", "area.height_m=60"][..], "width_m = 50.0\nheight_m = 60.0\n", "side_m"),
        (&["sensors.file=list.csv"], "file = \"list.csv\"", "count"),
        (&["link.los={a=9.61, b=0.16}"], "[link.los]\na = 9.61\n", "environment"),
        (&["link.los.a=9.61", "link.los.b=0.16"], "[link.los]\na = 9.61\n", "environment"),
        (&["link.model=free-space", "link.gain_db=-50"], "gain_db = -50.0\n", "environment"),
    ] {
        let mut arguments = vec!["check", "a.toml"];
        set.iter().for_each(|set| arguments.extend(["--set", set]));
        let ended = place.run_ok(&arguments);
        assert!(ended.stdout.contains(kept), "{set:?}: {ended:?}");
        assert!(!ended.stdout.lines().any(|line| line.starts_with(&format!("{gone} ="))), "{set:?}: {ended:?}");
        // And back again.
        place.write("b.toml", &ended.stdout);
        let file = ["--set", "area.side_m=90", "--set", "sensors.count=20", "--set", "link.model=probabilistic-los"];
        let start = ["--set", "link.environment=urban", "--set", "uav.start_m=[45, 45]"];
        let back = place.run_ok(&[&["check", "b.toml"], &file[..], &start].concat());
        let keys = |text: &str| text.lines().filter(|line| !line.starts_with('#')).collect::<Vec<_>>().join("\n");
        assert_eq!(keys(&back.stdout), keys(&place.run_ok(&["check", "a.toml"]).stdout), "{set:?}");
    }
}

#[cfg(feature = "lab")]
#[test]
fn an_axis_of_a_sweep_replaces_and_is_refused_like_a_setting() {
    let place = Place::new();
    place.write("a.toml", FILE);
    let sweep = |axes: &str| {
        let text = format!("scenario = \"a.toml\"\nstrategies = [\"gfs\"]\nseeds = 1\n[axes]\n{axes}\n");
        place.write("sweep.toml", &text);
        place.run(&["sweep", "sweep.toml", "--out", "swept"])
    };
    let refused = sweep("\"slots\" = [30, 0]");
    assert_eq!(refused.code, Some(2), "{refused:?}");
    let says = "sweep sweep.toml: at slots = 0: axis slots=0: expected 1 to 1000000000\n";
    assert!(refused.stderr.ends_with(says), "{refused:?}");
    place.write("list.csv", "x_m,y_m,capacity_bits\n1,2,300\n");
    let refused = sweep("\"sensors.file\" = [\"list.csv\"]\n\"sensors.capacity_bits\" = [5]");
    let says = "line 1: column `capacity_bits`: expected none, as it has priority over axis sensors.capacity_bits=5\n";
    assert!(refused.code == Some(2) && refused.stderr.ends_with(says), "{refused:?}");
    let flown = sweep("\"area.width_m\" = [50.0, 60.0]\n\"area.height_m\" = [70.0]");
    assert_eq!(flown.code, Some(0), "{flown:?}");
    assert_eq!(place.read("swept/results.csv").lines().count(), 3);
}
