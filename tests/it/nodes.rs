//! The nodes as threads of one process, written once for any iceoryx2 service.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::Barrier;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use iceoryx2::prelude::{Service, ipc, local};
use skysink::run::recorder::{ExternalTimeout, Recorder};
use skysink_common::message::{PathPoint, Plan};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::UAV;
use skysink_common::stop::{Stop, Stopped};
use skysink_mission::Mission;
use skysink_mission::drive::SlotSink;
use skysink_mission::folder::Earlier;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::tally::Tally;
use skysink_planner::plan::keys::HorizonKeys;
use skysink_planner::strategies::best_of::{self, BestOfKeys};
use skysink_planner::strategies::horizon;
use skysink_planner::strategies::look_ahead::{self, OfflineKeys};
use skysink_planner::strategies::names;
use skysink_planner::strategy::Registered;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::terms::Terms;
use skysink_ring::topics::Ring;
use skysink_ring::wait::Waiting;

use crate::support::scenarios;

fn smoke(strategy: &'static str, seed: u64) -> Scenario {
    let overrides = Overrides { seed: Some(seed), strategy: Some(strategy), ..Overrides::default() };
    let mut scenario = scenarios::read(Path::new(scenarios::SMOKE), overrides);
    look_ahead::OFFLINE.set_keys(&mut scenario, OfflineKeys { steps: 5_000 });
    horizon::STRATEGY.set_keys(&mut scenario, HorizonKeys::of(200));
    best_of::STRATEGY.set_keys(&mut scenario, BestOfKeys { iterations: 200, simulated_slots: 50, window: 20 });
    scenario
}

/// What an observer receives in each slot: the plan of the first UAV, and the paths that have arrived with it.
type Seen = Vec<(Plan, Option<Vec<PathPoint>>)>;

/// A mission's trace, its plans and paths, and the bits left in queues.
type Flown = (String, Seen, u64);

/// A mission in one process.
fn alone(scenario: &Scenario, out: &Path) -> Flown {
    let list = SensorList::of(scenario).unwrap();
    let folder = RunFolder::create(Some(out), Earlier::Kept, scenario, &list, &RunMode::default()).unwrap();
    let mut log = folder.slot_log().unwrap();
    let mut mission = Mission::new(scenario, &list).unwrap();
    let fly = || {
        let flown = mission.next()?;
        log.add(&flown).unwrap();
        assert!(flown.header.totals.is_balanced(), "{flown:?}");
        let paths: Vec<_> = flown.uavs().map(|row| row.path).filter(|path| path.len() > 1).flatten().copied().collect();
        Some((flown.plans()[UAV]?, Some(paths).filter(|paths| !paths.is_empty())))
    };
    let planned = std::iter::from_fn(fly).collect();
    (fs::read_to_string(out.join("slots.csv")).unwrap(), planned, mission.header().totals.queued_bits)
}

/// A node that runs as a thread.
type Node = fn(&Scenario, &RingFolder, &Stop) -> Result<(), NodeError>;

/// A mission in a ring of threads that start in the given order, with what an observer that starts before them
/// receives.
fn fly_in_threads<S: Service + 'static>(scenario: &Scenario, wait: Waiting, out: &Path, order: [usize; 3]) -> Flown {
    let list = SensorList::of(scenario).unwrap();
    let folder = RunFolder::create(Some(out), Earlier::Kept, scenario, &list, &RunMode::default()).unwrap();
    let ring_folder = RingFolder::create(Terms { wait, timeout_s: 60.0, ..Terms::default() }).unwrap();
    let stop = Stop::default();
    let (ring, wait) = Ring::<S>::join(&ring_folder, scenario, Role::Launcher, &stop).unwrap();
    let mut recorder = Recorder::new(&ring, wait, ExternalTimeout::default()).unwrap();
    let mut log = folder.slot_log().unwrap();
    let mut tally = Tally::new(scenario, &list, &RunMode::default());
    let nodes: [Node; 3] =
        [skysink_field_sim::node::run::<S>, skysink_flight_sim::node::run::<S>, skysink_planner::node::run::<S>];
    let there = Barrier::new(2);
    let seen = thread::scope(|scope| {
        let spectator = scope.spawn(|| spectate::<S>(scenario, &ring_folder, &stop, &there));
        there.wait();
        let threads = order.map(|node| {
            let stop = stop.clone();
            let path = ring_folder.path();
            scope.spawn(move || nodes[node](scenario, &RingFolder::open(path)?, &stop))
        });
        recorder.record(scenario, &mut log, &mut tally, &mut |_, _| Ok(0)).unwrap();
        recorder.release(scenario.slots, log.hash()).unwrap();
        while threads.iter().any(|thread| !thread.is_finished()) {
            recorder.pause(Duration::from_millis(1)).unwrap(); // serves those that ask late
        }
        for thread in threads {
            thread.join().unwrap().unwrap();
        }
        spectator.join().unwrap()
    });
    let ours = tally.summary(Duration::ZERO, log.hash());
    assert!(ours.complete);
    (fs::read_to_string(out.join("slots.csv")).unwrap(), seen, ours.queued_bits)
}

/// Observes a ring from before its nodes start.
fn spectate<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop, there: &Barrier) -> Seen {
    let folder = RingFolder::open(folder.path()).unwrap();
    let (ring, mut wait) = Ring::<S>::join(&folder, scenario, Role::Viewer, stop).unwrap();
    let mut paths = ring.path.reader().unwrap();
    let mut plans = ring.plan.reader().unwrap();
    there.wait();
    let see = |slot| {
        let plan = plans.wait_for_slot(&mut wait, slot).unwrap().unwrap();
        let path = paths.poll_slot(slot).unwrap().available();
        (plan[UAV], path.map(|path| path.payload().to_vec()))
    };
    (1..=scenario.slots).map(see).collect()
}

#[test]
fn local_and_ipc_nodes_match_plain_calls_in_any_starting_order() {
    let out = tempfile::tempdir().unwrap();
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    for (round, strategy) in names().into_iter().enumerate() {
        let scenario = smoke(strategy, 11);
        let name = |way: &str| out.path().join(format!("{way}-{strategy}"));
        let (trace, planned, queued_bits) = alone(&scenario, &name("alone"));
        let order = orders[round % orders.len()];
        let wait = Waiting::ALL[(round + round / orders.len()) % Waiting::ALL.len()];
        let local = fly_in_threads::<local::Service>(&scenario, wait, &name("local"), order);
        let ipc = fly_in_threads::<ipc::Service>(&scenario, wait, &name("ipc"), order);
        for (flown, seen, left_bits) in [local, ipc] {
            assert_eq!((flown, left_bits), (trace.clone(), queued_bits), "{strategy}, {wait}, {order:?}");
            assert_eq!(seen.len(), 60);
            for ((plan, path), (expected_plan, expected_path)) in seen.iter().zip(&planned) {
                assert_eq!(path, expected_path, "{strategy}, {plan:?}");
                let Some(first) = path.as_ref().map(|path| path[0]) else { continue };
                assert_eq!((first.x_m, first.y_m, first.z_m), (plan.x_m, plan.y_m, plan.z_m), "{strategy}");
                assert_eq!(
                    (first.x_m, first.y_m, first.z_m),
                    (expected_plan.x_m, expected_plan.y_m, expected_plan.z_m),
                    "{strategy}"
                );
            }
            let paths = seen.iter().filter(|(_, path)| path.is_some()).count();
            let expected = if Registered::find(strategy).unwrap().has_path { 41..=60 } else { 0..=0 };
            assert!(expected.contains(&paths), "{strategy}: {paths} paths");
        }
    }
}

#[test]
fn the_paths_of_all_uavs_arrive_with_their_plans() {
    let out = tempfile::tempdir().unwrap();
    let mut scenario = smoke("horizon", 11);
    scenario.uav.count = Some(3);
    let (trace, planned, _) = alone(&scenario, &out.path().join("alone"));
    let (flown, seen, _) =
        fly_in_threads::<local::Service>(&scenario, Waiting::default(), &out.path().join("ring"), [0, 1, 2]);
    assert_eq!(flown, trace);
    for (slot, (seen, planned)) in (1..).zip(seen.iter().zip(&planned)) {
        assert_eq!(seen.1, planned.1, "slot {slot}");
    }
    let uavs: BTreeSet<u32> =
        seen.iter().flat_map(|(_, paths)| paths.iter().flatten()).map(|point| point.uav).collect();
    assert_eq!(uavs, BTreeSet::from([0, 1, 2]));
}

#[test]
fn a_stop_request_ends_a_waiting_node() {
    let scenario = smoke("uts", 1);
    for &wait in Waiting::ALL {
        let ring_folder = RingFolder::create(Terms { wait, timeout_s: 60.0, ..Terms::default() }).unwrap();
        let _ring = Ring::<local::Service>::join(&ring_folder, &scenario, Role::Launcher, &Stop::default()).unwrap();
        let stop = Stop::default();
        thread::scope(|scope| {
            let node = scope.spawn(|| {
                let folder = RingFolder::open(ring_folder.path()).unwrap();
                skysink_planner::node::run::<local::Service>(&scenario, &folder, &stop)
            });
            stop.flag().store(15, Ordering::Relaxed); // as SIGTERM does
            assert!(matches!(node.join().unwrap(), Err(NodeError::Stopped(Stopped(15)))));
        });
    }
}

#[test]
fn a_recorder_without_a_ring_names_the_role_that_should_have_started() {
    let scenario = smoke("uts", 1);
    let place = tempfile::tempdir().unwrap();
    let list = SensorList::of(&scenario).unwrap();
    for &wait in Waiting::ALL {
        let out = place.path().join(wait.to_string());
        let folder = RunFolder::create(Some(&out), Earlier::Kept, &scenario, &list, &RunMode::default()).unwrap();
        let ring_folder = RingFolder::create(Terms { wait, timeout_s: 0.2, ..Terms::default() }).unwrap();
        let stop = Stop::default();
        let (ring, wait) = Ring::<local::Service>::join(&ring_folder, &scenario, Role::Launcher, &stop).unwrap();
        let mut recorder = Recorder::new(&ring, wait, ExternalTimeout::default()).unwrap();
        let mut log = folder.slot_log().unwrap();
        let mut tally = Tally::new(&scenario, &list, &RunMode::default());
        let mut overdue = Vec::new();
        let recorded = recorder.record(&scenario, &mut log, &mut tally, &mut |_, late| {
            overdue.extend(late.map(|late| late.from));
            Ok(0)
        });
        let error = recorded.unwrap_err().to_string();
        assert!(error.starts_with("field-sim has not sent queues(0) for 0.2 s"), "{error}");
        assert_eq!(overdue, [Role::FieldSim], "once, before the timeout");
    }
}

#[test]
fn a_ring_with_an_unknown_wait_mode_is_refused() {
    let ring_folder = RingFolder::create(Terms { wait: Waiting::Poll, ..Terms::default() }).unwrap();
    let file = ring_folder.path().join("ring.toml");
    let terms = fs::read_to_string(&file).unwrap();
    assert!(terms.contains("wait = \"poll\"\n"), "{terms}");
    fs::write(&file, terms.replace("poll", "spin")).unwrap();
    let error = RingFolder::open(ring_folder.path()).unwrap_err().to_string();
    assert!(
        error.ends_with("ring.toml: unknown variant `spin`, expected one of `adaptive`, `event`, `poll`"),
        "{error}"
    );
}

#[test]
fn a_node_with_another_scenario_is_refused() {
    let ring_folder = RingFolder::create(Terms::default()).unwrap();
    let _ring = Ring::<local::Service>::join(&ring_folder, &smoke("uts", 1), Role::Launcher, &Stop::default()).unwrap();
    let folder = RingFolder::open(ring_folder.path()).unwrap();
    let other = smoke("uts", 2);
    let error = skysink_flight_sim::node::run::<local::Service>(&other, &folder, &Stop::default()).unwrap_err();
    assert_eq!(error.exit_code(), 2);
    assert!(error.to_string().contains("scenario is"), "{error}");
}
