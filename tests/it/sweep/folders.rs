//! Whose the folder of a sweep is.

use std::fs;

use rustix::process::{Pid, Signal, kill_process};

use super::write_sweep;
use crate::support::{Place, end, lines, until};

#[test]
fn a_folder_of_another_sweep_is_refused() {
    let place = Place::new();
    write_sweep(&place, 1);
    place.run_well(&["sweep", "sweep.toml", "--out", "out"]);
    let before = place.read("out/results.csv");
    write_sweep(&place, 2);
    let ended = place.run(&["sweep", "sweep.toml", "--out", "out"]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.stderr.contains("another sweep") && ended.stderr.lines().count() == 1, "{ended:?}");
    assert_eq!(place.read("out/results.csv"), before);
    fs::create_dir(place.path("mine")).unwrap();
    place.write("mine/notes.txt", "mine");
    assert_eq!(place.run(&["sweep", "sweep.toml", "--out", "mine"]).code, Some(2));
}

#[test]
fn a_folder_that_another_process_flies_is_refused_until_that_process_ends() {
    let place = Place::new();
    write_sweep(&place, 400);
    let first = place.skysink(&["sweep", "sweep.toml", "--out", "out"]).spawn().unwrap();
    until("mission", || (lines(&place.path("out/journal.csv")) > 3).then_some(()));
    let second = place.run(&["sweep", "sweep.toml", "--out", "out"]);
    assert_eq!(second.code, Some(2), "{second:?}");
    assert!(second.stderr.contains("another process is running this sweep"), "{second:?}");
    kill_process(Pid::from_raw(i32::try_from(first.id()).unwrap()).unwrap(), Signal::KILL).unwrap();
    assert_eq!(end(first).signal, Some(9));
    let third = place.skysink(&["sweep", "sweep.toml", "--out", "out"]).spawn().unwrap();
    let flown = lines(&place.path("out/journal.csv"));
    until("further mission", || (lines(&place.path("out/journal.csv")) > flown + 3).then_some(()));
    kill_process(Pid::from_raw(i32::try_from(third.id()).unwrap()).unwrap(), Signal::INT).unwrap();
    assert_eq!(end(third).code, Some(130));
}
