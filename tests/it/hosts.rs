//! The ring across hosts: refusals before the start, and missions over three hosts, which are network namespaces.
//!
//! The missions need root, `ip netns`, and a link in the PATH (`cargo install --locked --path link`); without them they
//! say so and pass.

use std::env;
use std::ffi::OsString;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::support::scenarios::{self, SMOKE};
use crate::support::{Output, Place, output};
use skysink::run::link;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_ring::topics::SCHEMA;

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/hosts/three_hosts.sh");
const LONG: &str = "name = 'long'\nslots = 400\nuav.endurance_s = 1e6\n";

/// The PATH with `folder` in front.
fn path_with(folder: &Path) -> OsString {
    let rest = env::var_os("PATH").unwrap_or_default();
    env::join_paths([folder.to_owned()].into_iter().chain(env::split_paths(&rest))).unwrap()
}

/// The reason why this machine cannot have the hosts, if any.
fn missing() -> Option<&'static str> {
    let works = |program: &str, arguments: &[&str]| {
        Command::new(program)
            .args(arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|status| status.success())
    };
    let name = format!("skytest{}", std::process::id());
    if !rustix::process::getuid().is_root() {
        return Some("not root");
    }
    if !["skysink-link", "iox2-link-tunnel-zenoh"].iter().any(|link| works(link, &["--help"])) {
        return Some("no skysink-link in the PATH");
    }
    if !works("ip", &["netns", "add", &name]) {
        return Some("no network namespaces");
    }
    works("ip", &["netns", "del", &name]);
    None
}

/// Flies `scenario` over three hosts with these arguments; `None` if this machine cannot have them.
fn fly(scenario: &str, arguments: &[&str]) -> Option<Output> {
    if let Some(missing) = missing() {
        eprintln!("skipped: {missing}");
        return None;
    }
    let place = Place::new();
    let file = place.write("long.toml", scenario);
    let executables = Path::new(env!("CARGO_BIN_EXE_skysink")).parent().unwrap();
    let arguments = [&[file.to_str().unwrap()], arguments].concat();
    let ended = output(place.command(SCRIPT, &arguments).env("PATH", path_with(executables)));
    Some(ended)
}

#[test]
fn a_disconnected_host_is_reported_and_waited_for_and_the_trace_is_that_of_one_process() {
    for host in ["a", "b", "c"] {
        let Some(ended) = fly(LONG, &["--cut", host, "4"]) else { return };
        assert_eq!(ended.code, Some(0), "host {host}: {ended:?}");
        assert!(ended.stdout.contains("the trace is that of one process"), "host {host}: {ended:?}");
        let said = |text: &str| ended.stderr.lines().chain(ended.stdout.lines()).any(|line| line.contains(text));
        let cut = if host == "c" { "flight-sim" } else { "planner" };
        assert!(said(&format!("{cut} has sent no heartbeat for 1.0 s")), "host {host}: {ended:?}");
        assert!(said(&format!("{cut} recovered after ")), "host {host}: {ended:?}");
        assert!(ended.stdout.contains("messages refused"), "{ended:?}");
    }
}

#[test]
fn a_paced_run_continues_without_the_planners_host_and_counts_missed_slots() {
    let Some(ended) = fly(LONG, &["--cut", "b", "3", "--pace", "20x"]) else { return };
    assert_eq!(ended.code, Some(3), "a trace with misses is another one: {ended:?}");
    let missed = ended.stdout.lines().find(|line| line.contains("deadlines missed")).unwrap();
    let missed: u64 = missed.split_whitespace().find_map(|word| word.parse().ok()).unwrap();
    assert!(missed >= 40, "{missed} slots of 0.05 s in 3 s: {ended:?}");
}

/// A folder with a link that exits at once, and a copy of a ring's `ring.toml`.
fn with_link_that_fails(version: u32, scenario: u64, section: &str) -> (Place, OsString) {
    let place = Place::new();
    let program = place.write("skysink-link", "#!/bin/sh\necho no such mode\nexit 7\n");
    fs::set_permissions(program, fs::Permissions::from_mode(0o755)).unwrap();
    place.write("link.json5", "{}");
    let terms = "mission = '00000000000000ab'\npace = 'max'\nwait = 'event'\ntimeout_s = 30.0\nviewer = false\n";
    let link = format!("[{section}]\nversion = {version}\nscenario = '{scenario:016x}'\n");
    place.write("ring.toml", &if section.is_empty() { terms.to_owned() } else { terms.to_owned() + &link });
    let path = path_with(&place.path(""));
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
        (SCHEMA + 1, hash, "link", "it has another protocol version: use executables of the same build"),
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
fn a_link_that_exits_at_once_ends_its_command_with_the_reason() {
    let (place, path) = with_link_that_fails(SCHEMA, hash_of_smoke(), "link");
    let run = ["run", SMOKE, "--no-viewer", "--external", "planner", "--link", "link.json5", "--out", "run"];
    let launcher = output(place.skysink(&run).env("PATH", &path));
    for ended in [launcher, join(&place, &path)] {
        assert_eq!(ended.code, Some(1), "{ended:?}");
        assert!(ended.stderr.contains("link: no such mode\n"), "{ended:?}");
        let expected = "skysink-link ended with exit status: 7: expected a valid zenoh configuration and a free port";
        assert!(ended.stderr.contains(expected), "{ended:?}");
    }
    place.assert_clean();
    let resumed = ["run", "--resume", "run", "--no-viewer", "--external", "planner", "--external", "flight-sim"];
    let resumed = [&resumed[..], &["--link", "link.json5"]].concat();
    let ended = output(place.skysink(&resumed).env("PATH", &path));
    assert_eq!(ended.code, Some(2), "{ended:?}");
    let expected = "flight-sim restores its checkpoint on this host: omit --external flight-sim";
    assert!(ended.stderr.contains(expected), "{ended:?}");
}

#[test]
fn a_link_needs_its_configuration_and_an_external_role() {
    let (place, path) = with_link_that_fails(SCHEMA, 0, "link");
    let run = |arguments: &[&str]| {
        let arguments = [&["run", SMOKE, "--no-viewer"], arguments].concat();
        output(place.skysink(&arguments).env("PATH", &path))
    };
    let ended = run(&["--external", "planner", "--link", "none.json5"]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.stderr.contains("--link none.json5: expected a zenoh configuration file"), "{ended:?}");
    let ended = run(&["--link", "link.json5"]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.stderr.contains("--external"), "{ended:?}");
}

#[test]
fn roles_that_contradict_each_other_are_refused() {
    let (place, path) = with_link_that_fails(SCHEMA, hash_of_smoke(), "link");
    for (roles, expected) in [
        (&["planner", "flight-sim", "planner"][..], "planner: expected each role once"),
        (&["flight-sim", "--planner", "true"], "--planner: expected with the role planner"),
    ] {
        let files = ["--ring", "ring.toml", "--scenario", SMOKE, "--link", "link.json5"];
        let ended = output(place.skysink(&[&["join"], roles, &files].concat()).env("PATH", &path));
        assert!(ended.code == Some(2) && ended.stderr.contains(expected), "{ended:?}");
    }
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
