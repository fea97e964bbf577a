//! Invalid paths, and what the viewer records of them.

use iceoryx2::prelude::ipc;
use skysink_common::message::{MAX_PATH_POINTS, PathPoint, SlotHeader};
use skysink_ring::writer::Writer;

use super::audit::said;
use super::intruder::{Intruder, send_list};
use super::rogue::{LONG_S, Rogue, SHORT_S, Turn, open_folder};
use crate::support::flight::RunningFlight;
use crate::support::{Place, rows, slots, until, wait};

const NOWHERE: &str = "expected 1 to 64 points, finite and in the area";
const MISSION: &str = "it belongs to another run";
const OLD: &str = "its writer has already sent that slot or a later one";
const SECOND: &str = "another process is writing this topic already";

/// A run with a viewer and without a planner, whose role the test takes.
fn start_with_viewer(place: &Place) -> (RunningFlight<'_>, Rogue) {
    let run = place.flight("smoke").external("planner").timeout(LONG_S).start();
    let rogue = Rogue::join(&run);
    (run, rogue)
}

fn writer(rogue: &Rogue) -> Writer<ipc::Service, [PathPoint], SlotHeader> {
    rogue.ring.path.list_writer(1_000).unwrap()
}

/// The good waypoint, and so many points after it.
fn path(turn: &Turn, more: usize) -> Vec<PathPoint> {
    let mut path = vec![PathPoint::of(0, &turn.good.waypoint())];
    path.extend((0..more).map(|i| PathPoint::of(0, &[(i % 60) as f64, 30.0, 20.0].into())));
    path
}

/// Corrupts a path by the method of this number; 0 leaves it valid.
fn spoilt(turn: &Turn, number: u64) -> Vec<PathPoint> {
    let mut path = path(turn, 3);
    match number {
        0 => {}
        1 => path[2].x_m = f64::NAN,
        2 => path[3].y_m = f64::NEG_INFINITY,
        3 => path[1].z_m = 1e300,
        4 => path[1].x_m = 60.1,
        5 => path = vec![path[0]; MAX_PATH_POINTS + 1],
        6 => path.clear(),
        7 => path[1].uav = 1, // the run has one
        _ => path = vec![path[0]; 1_000],
    }
    path
}

/// The viewer has joined by this slot: the writer of paths serves no late joiners.
const THERE: u64 = 3;

/// Kinds of [`spoilt`].
const KINDS: u64 = 9;

#[test]
fn invalid_paths_are_refused_one_by_one_and_the_run_continues() {
    let place = Place::new();
    let (run, mut rogue) = start_with_viewer(&place);
    let paths = writer(&rogue);
    rogue.fly_to_end(|rogue, turn| {
        if turn.slot >= THERE {
            paths.send_list(rogue.header(turn.slot), &spoilt(turn, turn.slot % KINDS)).unwrap();
        }
    });
    let ended = run.wait_for_success();
    place.assert_trace_as_simulated("run");
    let recording = place.path("run/mission.rrd");
    assert_eq!(slots(&recording, "/metrics/loss_rate"), (0..=60).collect());
    let good = |slot: &i64| slot % KINDS as i64 == 0;
    assert_eq!(drawn(&recording), (1..=60).filter(good).collect::<Vec<_>>());
    // 51 refusals in 60 slots: the first and the tenth are reported.
    let lines = said(&ended.stderr, NOWHERE);
    assert_eq!(lines.len(), 2, "{ended:?}");
    assert_eq!(lines[0], format!("viewer: path(3) refused: {NOWHERE}"));
    assert_eq!(lines[1], format!("viewer: path(13) refused: {NOWHERE} (10 so far)"));
    drop((paths, rogue));
    place.assert_clean();
}

/// The slots in which a path is drawn.
fn drawn(recording: &std::path::Path) -> Vec<i64> {
    let is_drawn = |row: &String| row.contains("PrimitiveArray<Float32>");
    rows(recording, "/world/path").into_iter().filter(|(_, row)| is_drawn(row)).map(|(slot, _)| slot).collect()
}

#[test]
fn paths_of_another_run_slot_or_writer_are_refused_and_valid_ones_drawn() {
    let place = Place::new();
    let (run, mut rogue) = start_with_viewer(&place);
    let paths = writer(&rogue);
    let intruder = Intruder::join(&rogue.folder);
    let second = intruder.list_writer::<PathPoint, SlotHeader>("path", 4);
    rogue.fly_to_end(|rogue, turn| {
        let header = rogue.header(turn.slot);
        let good = path(turn, 3);
        if turn.slot >= THERE {
            paths.send_list(header, &good).unwrap();
        }
        if turn.slot % 6 == 0 {
            paths.send_list(SlotHeader { mission: 1, ..header }, &good).unwrap();
            paths.send_list(rogue.header(turn.slot - 1), &spoilt(turn, 1)).unwrap();
            paths.send_list(header, &spoilt(turn, 1)).unwrap();
            send_list(&second, header, &good);
        }
    });
    let ended = run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert_eq!(drawn(&place.path("run/mission.rrd")), (THERE as i64..=60).collect::<Vec<_>>());
    for refusal in [MISSION, OLD, SECOND] {
        let lines = said(&ended.stderr, refusal);
        assert!(lines.first().is_some_and(|line| line.starts_with("viewer: path(")), "{refusal}: {ended:?}");
    }
    assert!(said(&ended.stderr, NOWHERE).is_empty(), "{ended:?}");
    assert_eq!(place.summary("run")["refused_messages"], 0, "nobody but the viewer reads them");
    drop((second, intruder, paths, rogue));
    place.assert_clean();
}

#[test]
fn a_blocked_reader_of_paths_does_not_block_the_ring() {
    let place = Place::new();
    let flight = place.flight("smoke").strategy("horizon").set("planner.horizon.iterations", 100);
    let run = flight.without_viewer().external("planner").timeout(SHORT_S).start();
    let intruder = Intruder::join(&open_folder(&run));
    let deaf = intruder.reader::<[PathPoint], SlotHeader>("path");
    let planner = run.worker_command("planner").spawn().unwrap();
    let first = until("path", || deaf.receive().unwrap()); // from now on the writer knows that it is there
    wait(planner).assert_success();
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert_eq!(first.user_header().slot, 1, "there was room for it alone");
    drop((first, deaf, intruder));
    place.assert_clean();
}
