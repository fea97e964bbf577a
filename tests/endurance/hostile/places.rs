//! Roles that are taken, and rings of other versions.

use iceoryx2::prelude::*;
use skysink_common::message::{SensorNode, SensorsHeader};
use skysink_ring::folder::RingFolder;
use skysink_ring::terms::Terms;

use super::rogue::{LONG_S, start_with_rogue};
use crate::support::flight::{RING, executable};
use crate::support::scenarios::{self, SMOKE};
use crate::support::{Place, output};

#[test]
fn a_second_process_of_a_role_is_refused_and_the_run_is_undisturbed() {
    let place = Place::new();
    let (run, mut rogue) = start_with_rogue(&place.flight("smoke"), LONG_S);
    let folder = run.folder().display().to_string();
    rogue.fly_to_end(|_, turn| {
        for role in RING.iter().filter(|_| turn.slot % 20 == 0) {
            let second = output(run.worker_command(role)).assert_code(2);
            assert_eq!(second.stderr, format!("{role}: ring {folder}: there is a {role} already: end it first\n"));
        }
    });
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    let summary = place.summary("run");
    assert_eq!((&summary["refused_messages"], &summary["restarts"]), (&0.into(), &0.into()));
    place.assert_clean();
}

/// A ring whose first topic has these attributes, and messages of other types.
fn ring_with_terms(terms: &[(&str, &str)]) -> (RingFolder, impl Sized) {
    skysink::worker::silence_iceoryx2();
    let folder = RingFolder::create(Terms::default()).unwrap();
    let node = NodeBuilder::new().config(&folder.config().unwrap()).create::<ipc::Service>().unwrap();
    let name = ServiceName::new("skysink/sensors").unwrap();
    let mut attributes = AttributeSpecifier::new();
    for &(key, value) in terms {
        attributes = attributes.define(&key.try_into().unwrap(), &value.try_into().unwrap()).unwrap();
    }
    let sensors = node.service_builder(&name).publish_subscribe::<[SensorNode]>().user_header::<SensorsHeader>();
    let sensors = sensors.create_with_attributes(&attributes).unwrap();
    let event = node.service_builder(&name).event().create().unwrap();
    (folder, (sensors, event, node))
}

#[test]
fn a_ring_of_another_version_or_scenario_is_refused_with_the_remedy() {
    let place = Place::new();
    let scenario = scenarios::smoke("uts");
    let hash = format!("{:016x}", scenario.hash());
    let number = skysink_ring::topics::SCHEMA.to_string();
    let version = &*number;
    let program = env!("CARGO_PKG_VERSION");
    let build = "use the executables of one build";
    let file = "pass the scenario.toml of the run's folder";
    for (terms, what, remedy) in [
        (
            [("version", "1"), ("program", program), ("scenario", &*hash)],
            format!("version is 1, here {version}"),
            build,
        ),
        (
            [("other", version), ("program", program), ("scenario", &hash)],
            format!("version is missing, here {version}"),
            build,
        ),
        (
            [("version", version), ("program", "0.0.9"), ("scenario", &hash)],
            format!("program is 0.0.9, here {program}"),
            build,
        ),
        ([("version", version), ("program", program), ("scenario", "0")], format!("scenario is 0, here {hash}"), file),
    ] {
        let (folder, _ring) = ring_with_terms(&terms);
        let folder = folder.path().display().to_string();
        for role in RING {
            let arguments = ["--scenario", SMOKE, "--ring", &folder];
            let ended = output(place.command(executable(role), &arguments)).assert_code(2);
            assert_eq!(ended.stderr, format!("{role}: ring {folder}: {what}: {remedy}\n"));
        }
    }
}
