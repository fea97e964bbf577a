//! `skysink topics`: what a running ring carries.

use std::process::Child;

use crate::support::{Place, end, lines, until};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

const LONG: &str = "name = \"long\"\nslots = 6000\nslot_s = 0.1\n[uav]\nendurance_s = 1e8\n";

fn stop(child: Child) -> Option<i32> {
    kill_process(Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap(), Signal::TERM).unwrap();
    end(child).code
}

fn topics(place: &Place, arguments: &[&str]) -> Vec<Value> {
    let ended = place.run_well(&[&["topics", "--json", "--every", "0.5"], arguments].concat());
    serde_json::from_str(&ended.stdout).unwrap()
}

#[test]
fn the_topics_of_a_running_ring_are_shown_with_their_types_readers_and_rates() {
    let place = Place::new();
    place.write("long.toml", LONG);
    let run = place.skysink(&["run", "long.toml", "--no-viewer", "--pace", "1x", "--out", "run"]).spawn().unwrap();
    until("flight", || (lines(&place.path("run/slots.csv")) > 3).then_some(()));
    let found = topics(&place, &["run"]);
    let services: Vec<_> = found.iter().map(|topic| topic["service"].as_str().unwrap()).collect();
    let names = ["sensors", "queues", "tick", "path", "plan", "flight", "commit", "ready", "health"];
    assert_eq!(services, names.map(|name| format!("skysink/{name}")));
    let topic = |name: &str| &found[names.iter().position(|other| *other == name).unwrap()];
    for (name, payload, writer, readers) in [
        ("sensors", "[skysink.SensorNode.v1]", "field-sim", &["flight-sim", "planner"][..]),
        ("queues", "[u32]", "field-sim", &["planner", "skysink"]),
        ("plan", "skysink.Plan.v1", "planner", &["flight-sim", "skysink"]),
        ("flight", "skysink.FlightReport.v1", "flight-sim", &["field-sim", "planner", "skysink"]),
        ("commit", "skysink.Commit.v1", "skysink", &["field-sim"]),
    ] {
        let topic = topic(name);
        assert_eq!(topic["payload"], payload);
        assert_eq!(topic["writers"], Value::from(vec![writer]), "{name}");
        assert_eq!(topic["readers"], Value::from(readers.to_vec()), "{name}");
    }
    assert_eq!(topic("queues")["header"], "skysink.QueuesHeader.v1");
    for name in ["queues", "tick", "plan", "flight", "commit"] {
        assert!(topic(name)["rate_hz"].as_f64().unwrap() > 0.0, "{name}: {found:?}");
        assert!(topic(name)["slot"].as_u64().unwrap() > 2, "{name}: {found:?}");
    }
    assert_eq!((&topic("sensors")["slot"], &topic("sensors")["rate_hz"]), (&0.into(), &0.0.into()));
    assert_eq!((&topic("path")["slot"], &topic("health")["rate_hz"]), (&Value::Null, &Value::Null));

    let ring = place.rings().into_iter().next().unwrap();
    let folder = place.ring_file(&ring).parent().unwrap().to_owned();
    assert_eq!(topics(&place, &[folder.to_str().unwrap()]).len(), found.len());
    let table = place.run_well(&["topics", "--every", "0.5"]).stdout;
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");
    assert!(table.contains("[SensorNode]") && table.contains("field-sim planner "), "{table}");
    assert_eq!(stop(run), Some(143));
    place.assert_clean();
}

#[test]
fn a_ring_in_lock_step_flies_the_same_while_it_is_looked_at() {
    let place = Place::new();
    place.write("long.toml", LONG);
    let slots = |slots: usize| format!("slots={slots}");
    let endless = slots(50_000_000);
    let run = place.skysink(&["run", "long.toml", "--no-viewer", "--out", "run", "--set", &endless]).spawn().unwrap();
    let trace = place.path("run/slots.csv");
    until("flight", || (lines(&trace) > 3).then_some(()));
    for _ in 0..5 {
        place.run_well(&["topics", "--every", "0.01"]);
    }
    let looked_at = lines(&trace);
    until("flight after the last look", || (lines(&trace) > looked_at).then_some(()));
    assert_eq!(stop(run), Some(143));
    assert_eq!(place.summary("run")["restarts"], 0);
    place.run_well(&["simulate", "long.toml", "--out", "alone", "--set", &slots(lines(&trace) - 1)]);
    assert!(place.read("alone/slots.csv") == place.read("run/slots.csv"), "another flight");
    place.assert_clean();
}

#[test]
fn a_ring_that_does_not_run_is_refused() {
    let place = Place::new();
    place.write("long.toml", LONG);
    place.run_well(&["simulate", "long.toml", "--out", "run", "--set", "slots=10"]);
    for (arguments, says) in [
        (&["topics"][..], "no ring is running"),
        (&["topics", "nowhere"], "nowhere"),
        (&["topics", "run"], "run folder run: it is not running"),
    ] {
        let ended = place.run(arguments);
        assert_eq!((ended.code, ended.stderr.lines().count()), (Some(2), 1), "{ended:?}");
        assert!(ended.stderr.contains(says), "{ended:?}");
    }
}
