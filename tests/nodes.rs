//! The nodes as threads of one process, written once for any iceoryx2 service.

use std::fs;
use std::path::Path;
use std::thread;
use std::time::Duration;

use iceoryx2::prelude::{Service, ipc, local};
use skysink::mission::Mission;
use skysink::record::RunFolder;
use skysink::recorder::Recorder;
use skysink::summary::Tally;
use skysink::watch::{Alarm, ViewerState};
use skysink_common::node::{NodeError, Stop};
use skysink_common::pace::Pace;
use skysink_common::ring::Ring;
use skysink_common::ring_folder::RingFolder;
use skysink_common::scenario::{Overrides, Scenario, Strategy};
use skysink_common::sensors::SensorList;
use skysink_common::waiting::Waiting;
use skysink_field_sim::SlotBits;

fn smoke(strategy: Strategy, seed: u64) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/smoke.toml");
    let overrides = Overrides { seed: Some(seed), strategy: Some(strategy), slots: None };
    let mut scenario = Scenario::read(&path, overrides).unwrap();
    scenario.planner.offline_steps = 5_000;
    scenario
}

/// The trace of a mission in one process.
fn alone(scenario: &Scenario, out: &Path) -> String {
    let list = SensorList::of(scenario).unwrap();
    let folder = RunFolder::create(Some(out), false, scenario, &list).unwrap();
    let (mut log, mut mission) = (folder.slot_log().unwrap(), Mission::new(scenario, &list));
    while let Some(turn) = mission.turn().unwrap() {
        log.add(&turn.flight, &turn.header).unwrap();
        assert!(turn.header.totals.balanced(), "{turn:?}");
    }
    fs::read_to_string(out.join("slots.csv")).unwrap()
}

/// A node that runs as a thread.
type Node = fn(&Scenario, &RingFolder, &Stop) -> Result<(), NodeError>;

/// The same as a ring of threads, started in the given order.
fn ring<S: Service + 'static>(scenario: &Scenario, wait: Waiting, out: &Path, order: [usize; 3]) -> String {
    let list = SensorList::of(scenario).unwrap();
    let folder = RunFolder::create(Some(out), false, scenario, &list).unwrap();
    let meeting = RingFolder::create(Pace::Max, wait, 60.0, false).unwrap();
    let ring = Ring::<S>::create(&meeting, scenario).unwrap();
    let stop = Stop::default();
    let mut recorder = Recorder::new(&ring, scenario.slot_s, Alarm::default(), &stop).unwrap();
    let (mut log, mut tally) = (folder.slot_log().unwrap(), Tally::new(scenario, &list));
    let nodes: [Node; 3] =
        [skysink_field_sim::node::run::<S>, skysink_flight_sim::node::run::<S>, skysink_planner::node::run::<S>];
    thread::scope(|scope| {
        let threads = order.map(|node| {
            let (stop, path) = (stop.clone(), meeting.path());
            scope.spawn(move || nodes[node](scenario, &RingFolder::open(path)?, &stop))
        });
        let mut patience = ring.patience(&meeting, None, &stop).unwrap();
        recorder.record(scenario.slots, &mut patience, &mut log, &mut tally, |_| Ok(ViewerState::There)).unwrap();
        recorder.release(scenario.slots, log.hash()).unwrap();
        for thread in threads {
            thread.join().unwrap().unwrap();
        }
    });
    let mut mission = Mission::new(scenario, &list);
    while mission.turn().unwrap().is_some() {}
    let ours = tally.summary(None, Duration::ZERO, log.hash());
    assert_eq!(ours.queued_bits, mission.header(SlotBits::default()).totals.queued_bits);
    assert!(ours.complete);
    fs::read_to_string(out.join("slots.csv")).unwrap()
}

#[test]
fn local_and_ipc_nodes_leave_the_trace_of_the_plain_calls() {
    let out = tempfile::tempdir().unwrap();
    for (round, strategy) in Strategy::ALL.into_iter().enumerate() {
        let scenario = smoke(strategy, 11);
        let name = |way: &str| out.path().join(format!("{way}-{round}"));
        let trace = alone(&scenario, &name("alone"));
        for wait in [Waiting::Event, Waiting::Poll] {
            let name = |way: &str| name(&format!("{way}-{wait}"));
            let flown = ring::<local::Service>(&scenario, wait, &name("local"), [0, 1, 2]);
            assert_eq!(flown, trace, "{strategy:?}, {wait}");
            let flown = ring::<ipc::Service>(&scenario, wait, &name("ipc"), [0, 1, 2]);
            assert_eq!(flown, trace, "{strategy:?}, {wait}");
        }
    }
}

#[test]
fn nodes_may_start_in_any_order() {
    let out = tempfile::tempdir().unwrap();
    let scenario = smoke(Strategy::Uts, 12);
    let trace = alone(&scenario, &out.path().join("alone"));
    for (round, order) in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]].into_iter().enumerate() {
        let name = |way: &str| out.path().join(format!("{way}-{round}"));
        let wait = Waiting::Event;
        assert_eq!(ring::<local::Service>(&scenario, wait, &name("local"), order), trace, "{order:?}");
        assert_eq!(ring::<ipc::Service>(&scenario, wait, &name("ipc"), order), trace, "{order:?}");
    }
}

#[test]
fn a_requested_stop_ends_a_waiting_node() {
    let scenario = smoke(Strategy::Uts, 1);
    for wait in [Waiting::Event, Waiting::Poll] {
        let meeting = RingFolder::create(Pace::Max, wait, 60.0, false).unwrap();
        let _ring = Ring::<local::Service>::create(&meeting, &scenario).unwrap();
        let stop = Stop::default();
        thread::scope(|scope| {
            let node = scope.spawn(|| {
                let folder = RingFolder::open(meeting.path()).unwrap();
                skysink_planner::node::run::<local::Service>(&scenario, &folder, &stop)
            });
            stop.request();
            assert!(matches!(node.join().unwrap(), Err(NodeError::Stopped(15))));
        });
    }
}

#[test]
fn a_node_whose_peer_does_not_come_says_which() {
    let scenario = smoke(Strategy::Uts, 1);
    for wait in [Waiting::Event, Waiting::Poll] {
        let meeting = RingFolder::create(Pace::Max, wait, 0.2, false).unwrap();
        let _ring = Ring::<local::Service>::create(&meeting, &scenario).unwrap();
        let folder = RingFolder::open(meeting.path()).unwrap();
        let error = skysink_planner::node::run::<local::Service>(&scenario, &folder, &Stop::default()).unwrap_err();
        assert_eq!(error.to_string(), "waited 0.2 s for sensors(0): is field-sim running?");
    }
}

#[test]
fn a_ring_that_waits_in_an_unknown_way_is_refused() {
    let meeting = RingFolder::create(Pace::Max, Waiting::Poll, 0.2, false).unwrap();
    let file = meeting.path().join("ring.toml");
    let terms = fs::read_to_string(&file).unwrap();
    assert!(terms.contains("wait = \"poll\"\n"), "{terms}");
    fs::write(&file, terms.replace("poll", "spin")).unwrap();
    let error = RingFolder::open(meeting.path()).unwrap_err().to_string();
    assert!(error.ends_with("ring.toml: wait spin: expected event or poll"), "{error}");
}

#[test]
fn a_node_with_another_scenario_is_refused() {
    let meeting = RingFolder::create(Pace::Max, Waiting::Event, 0.2, false).unwrap();
    let _ring = Ring::<local::Service>::create(&meeting, &smoke(Strategy::Uts, 1)).unwrap();
    let folder = RingFolder::open(meeting.path()).unwrap();
    let other = smoke(Strategy::Uts, 2);
    let error = skysink_flight_sim::node::run::<local::Service>(&other, &folder, &Stop::default()).unwrap_err();
    assert_eq!(error.exit_code(), 2);
    assert!(error.to_string().contains("scenario is"), "{error}");
}
