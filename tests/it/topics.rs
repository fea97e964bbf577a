//! `skysink topics`: the topics of a running ring.

use crate::support::Place;
use rustix::process::Signal;
use serde_json::Value;

fn topics(place: &Place, arguments: &[&str]) -> Vec<Value> {
    let ended = place.run_ok(&[&["topics", "--json", "--every", "0.2"], arguments].concat());
    serde_json::from_str(&ended.stdout).unwrap()
}

#[test]
fn the_topics_of_a_running_ring_are_shown_with_their_types_readers_and_rates() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().pace("5x").start();
    run.until_slot(3);
    let found = topics(&place, &["run"]);
    let services: Vec<_> = found.iter().map(|topic| topic["service"].as_str().unwrap()).collect();
    let names = ["sensors", "queues", "tick", "path", "plan", "flight", "commit", "ready", "health"];
    assert_eq!(services, names.map(|name| format!("skysink/{name}")));
    let topic = |name: &str| &found[names.iter().position(|other| *other == name).unwrap()];
    for (name, payload, writer, readers) in [
        ("sensors", "[skysink.SensorNode.v2]", "field-sim", &["flight-sim", "planner"][..]),
        ("queues", "[u32]", "field-sim", &["planner", "skysink"]),
        ("plan", "[skysink.Plan.v1]", "planner", &["flight-sim", "skysink"]),
        ("flight", "[skysink.FlightReport.v4]", "flight-sim", &["field-sim", "planner", "skysink"]),
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

    assert_eq!(topics(&place, &[run.folder().to_str().unwrap()]).len(), found.len());
    let table = place.run_ok(&["topics", "--every", "0.01"]).stdout;
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");
    assert!(table.contains("[SensorNode]") && table.contains("planner skysink "), "{table}");
    run.terminate();
    place.assert_clean();
}

/// Slots of 0.1 s at a tenth of the speed, polled twice within 0.4 s: rates count from the samples before.
#[test]
fn slow_slots_have_a_rate_and_a_suspended_process_is_overdue() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().pace("0.1x").start();
    run.until_slot(3);
    let found = topics(&place, &["run"]);
    let of = |found: &[Value], name: &str| {
        found.iter().find(|topic| topic["service"] == format!("skysink/{name}")).unwrap().clone()
    };
    for name in ["queues", "tick", "plan", "flight", "commit"] {
        let topic = of(&found, name);
        let [rate_hz, age_s] = ["rate_hz", "age_s"].map(|key| topic[key].as_f64().unwrap());
        assert!((0.5..1.5).contains(&rate_hz) && age_s < 2.1, "{topic}");
        assert_eq!((&topic["period_s"], &topic["is_overdue"]), (&1.0.into(), &false.into()), "{topic}");
    }
    let sensors = of(&found, "sensors");
    assert_eq!((&sensors["period_s"], &sensors["is_overdue"]), (&Value::Null, &Value::Null));
    assert!(sensors["age_s"].as_f64().unwrap() > 2.0, "{sensors}");
    let table = place.run_ok(&["topics", "--every", "0.01"]).stdout;
    assert!(table.contains("A slot takes 1 s: 1.0/s expected; overdue: none"), "{table}");

    run.signal_worker("planner", Signal::STOP);
    run.until_slots_later(4);
    let found = topics(&place, &["run"]);
    let plan = of(&found, "plan");
    // A writer that is stopped sends late joiners nothing.
    assert_eq!((&plan["is_overdue"], &plan["slot"], &plan["rate_hz"]), (&true.into(), &Value::Null, &0.0.into()));
    assert_eq!(of(&found, "tick")["is_overdue"], false, "{found:?}");
    let table = place.run_ok(&["topics", "--every", "0.01"]).stdout;
    assert!(table.contains("overdue: plan\n"), "{table}");
    run.signal_worker("planner", Signal::CONT);
    run.signal_worker("field-sim", Signal::STOP);
    let table = place.run_ok(&["topics", "--every", "0.01"]).stdout;
    assert!(table.contains("No tick has arrived: slot 1 has not begun, or field-sim does not answer\n"), "{table}");
    run.signal_worker("field-sim", Signal::CONT);
    run.terminate();
    place.assert_clean();
}

#[test]
fn observing_a_lock_step_ring_does_not_change_its_flight() {
    let place = Place::new();
    let long = place.flight("long").without_viewer();
    let run = long.set("slots", 50_000_000).start();
    run.until_slot(3);
    for _ in 0..3 {
        place.run_ok(&["topics", "--every", "0.01"]);
    }
    run.until_slots_later(1);
    run.terminate();
    assert_eq!(place.summary("run")["restarts"], 0);
    long.set("slots", place.trace("run").lines().count() - 1).out("alone").simulate();
    place.assert_same_trace("alone", "run");
    place.assert_clean();
}

#[test]
fn a_ring_that_is_not_running_is_refused() {
    let place = Place::new();
    place.flight("long").set("slots", 10).simulate();
    for (arguments, says) in [
        (&["topics"][..], "no ring is running"),
        (&["topics", "nowhere"], "nowhere"),
        (&["topics", "run"], "run folder run: it is not running"),
    ] {
        place.run_refused(arguments, says);
    }
}
