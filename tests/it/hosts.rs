//! The ring across hosts: refusals before the start. The missions are in `tests/it/other_hosts.rs`.

use std::ffi::OsString;
use std::fs;
use std::os::unix::fs::PermissionsExt;

use expect_test::expect_file;

use crate::support::scenarios::{self, SMOKE};
use crate::support::{Output, Place, output, path_with};
use skysink::run::link;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_ring::topics::SCHEMA;

/// A folder with a link that exits at once, and a copy of a ring's `ring.toml`.
fn with_link_that_fails(version: u32, scenario: u64, section: &str) -> (Place, OsString) {
    let place = Place::new();
    let program = place.write("skysink-link", "#!/bin/sh\necho no such mode\nexit 7\n");
    fs::set_permissions(program, fs::Permissions::from_mode(0o755)).unwrap();
    place.write("link.json5", "{}");
    let terms = "mission = '00000000000000ab'\npace = 'max'\nwait = 'event'\ntimeout_s = 30.0\nviewer = false\n";
    let link = format!("[{section}]\nversion = {version}\nscenario = '{scenario:016x}'\n");
    place.write("ring.toml", &if section.is_empty() { terms.to_owned() } else { terms.to_owned() + &link });
    let path = path_with([&*place.path("")]);
    (place, path)
}

fn join(place: &Place, path: &OsString) -> Output {
    let arguments = ["join", "planner", "--ring", "ring.toml", "--scenario", SMOKE, "--link", "link.json5"];
    output(place.skysink(&arguments).env("PATH", path))
}

fn hash_of_smoke() -> u64 {
    link::terms(&scenarios::smoke("uts")).unwrap().scenario
}

#[test]
fn a_host_with_another_scenario_version_or_ring_is_refused_with_the_remedy() {
    let hash = hash_of_smoke();
    for (version, scenario, section, expected) in [
        (
            SCHEMA,
            hash + 1,
            "link",
            "it flies another scenario or sensor list: pass copies of scenario.toml and sensors.csv of the run folder",
        ),
        (SCHEMA + 1, hash, "link", "it has another protocol version: use executables of the same version on all hosts"),
        (SCHEMA, hash, "", "it has no link to other hosts: expected that of skysink run --link"),
    ] {
        let (place, path) = with_link_that_fails(version, scenario, section);
        let ended = join(&place, &path);
        assert_eq!(ended.code, Some(2), "{ended:?}");
        assert_eq!(ended.stderr, format!("skysink: ring ring.toml: {expected}\n"));
        place.assert_clean();
    }
}

#[test]
fn failing_links_and_contradicting_roles_end_a_command_with_the_reason() {
    let (place, _) = with_link_that_fails(SCHEMA, hash_of_smoke(), "link");
    place.scenario("smoke");
    place.assert_transcript(&expect_file!["transcripts/hosts.txt"]);
    place.assert_clean();
}

#[test]
fn another_sensor_list_is_another_ring() {
    let place = Place::new();
    let list = "x_m,y_m,queue_bits,gain_db\n10.0,10.0,500,-52.0\n20.0,20.0,500,-52.0\n";
    let hash = |list: &str| {
        place.write("list.csv", list);
        place.write("listed.toml", "name = 'listed'\n[sensors]\nfile = 'list.csv'\n");
        let scenario = Scenario::read(&place.path("listed.toml"), Overrides::default()).unwrap();
        link::terms(&scenario).unwrap().scenario
    };
    assert_eq!(hash(list), hash(&list.replace("10.0", "10.00")), "the same numbers");
    assert_ne!(hash(list), hash(&list.replace("20.0,20.0", "20.0,21.0")));
}
