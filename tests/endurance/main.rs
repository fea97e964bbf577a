//! Tests that take minutes: runs whose processes are killed, stopped and restarted with the same results, the
//! book's tables, and large fields.

mod anywhere;
#[cfg(feature = "mavlink")]
mod autopilots;
mod crashes;
mod hostile;
mod kills;
mod large;
mod paced;
#[path = "../../mission/tests/it/random_fleets.rs"]
mod random_fleets;
mod reproduce;
mod resumed;
mod silence;
mod soaks;
#[path = "../support/mod.rs"]
mod support;
mod tracer;
#[cfg(feature = "mavlink")]
mod vehicle;
#[cfg(feature = "viewer")]
mod viewers;

use support::Place;
use support::flight::FlightBuilder;

/// `long` with time for many kills: 9000 slots.
fn longer(place: &Place) -> FlightBuilder<'_> {
    place.flight("long").set("slots", 9000)
}

/// The events of the processes in the summary of `run`: process and event.
fn events(place: &Place) -> Vec<(String, String)> {
    let summary = place.summary("run");
    let events = summary["events"].as_array().unwrap().iter();
    events.map(|event| ["process", "event"].map(|key| event[key].as_str().unwrap().to_owned()).into()).collect()
}

/// The first 30 fly in the other tests, too.
#[test]
fn a_thousand_random_fleets_keep_to_the_limits_of_each_uav() {
    random_fleets::check_all(30..1_000);
}
