//! The owner of a sweep's folder.

use std::fs;

use rustix::process::Signal;

use super::{sweep_until, write_sweep};
use crate::support::{Place, lines, signal_and_wait};

#[test]
fn a_folder_of_another_sweep_is_refused() {
    let place = Place::new();
    write_sweep(&place, 2);
    place.run_ok(&["sweep", "sweep.toml", "--out", "out"]);
    let before = place.read("out/results.csv");
    write_sweep(&place, 1);
    place.run_refused(&["sweep", "sweep.toml", "--out", "out"], "another sweep, with seed 2: choose another --out");
    assert_eq!(place.read("out/results.csv"), before);
    fs::create_dir(place.path("mine")).unwrap();
    place.write("mine/notes.txt", "mine");
    assert_eq!(place.run(&["sweep", "sweep.toml", "--out", "mine"]).code, Some(2));
}

#[test]
fn a_folder_in_use_is_refused_until_its_process_ends() {
    let place = Place::new();
    write_sweep(&place, 400);
    let first = sweep_until(&place, "out", &[], 3);
    let second = place.run(&["sweep", "sweep.toml", "--out", "out"]).assert_code(2);
    assert!(second.stderr.contains("another process is running this sweep"), "{second:?}");
    assert_eq!(signal_and_wait(Signal::KILL, first).signal, Some(9));
    let flown = lines(&place.path("out/journal.csv"));
    let third = sweep_until(&place, "out", &[], flown + 3);
    signal_and_wait(Signal::INT, third).assert_code(130);
}
