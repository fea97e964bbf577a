//! Files of a run that another process changes while it is flown: the run says so and ends.

use std::fs::{self, OpenOptions};
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use crate::support::{Place, lines, until, wait};

/// Changes a file.
type Change = fn(&Path);

#[test]
fn a_file_that_changes_under_a_paced_run_ends_it() {
    let place = Place::new();
    let changes: [(&str, &str, Change); 4] = [
        ("slots.csv", "it was replaced during the run", |file| {
            let whole = fs::read(file).unwrap(); // a copy of the whole may still be complete
            fs::write(file.with_extension("copy"), &whole[..whole.len() / 2]).unwrap();
            fs::rename(file.with_extension("copy"), file).unwrap();
        }),
        ("slots.check", "it was deleted or moved during the run", |file| fs::remove_file(file).unwrap()),
        ("scenario.toml", "it was deleted or moved during the run", |file| {
            fs::rename(file, file.with_extension("moved")).unwrap();
        }),
        ("sensors.csv", "it was overwritten during the run", |file| {
            OpenOptions::new().write(true).open(file).unwrap().write_all_at(b"#", 100).unwrap();
        }),
    ];
    let flight = place.flight("paced").pace("10x").without_viewer();
    let runs = changes.map(|(name, says, change)| {
        let run = flight.out(name).start();
        run.until_slot(10);
        change(&run.path(name));
        (run, name, says)
    });
    for (run, name, says) in runs {
        let flown = run.slots();
        let ended = run.wait().assert_code(1);
        let line = ended.stderr.lines().last().unwrap();
        assert!(line.starts_with(&format!("skysink: {name}/{name}: {says}")), "{ended:?}");
        assert!(line.contains(&format!("`skysink run --resume {name}` continues it")), "{ended:?}");
        assert_eq!(place.summary(name)["complete"], false, "{name}: after slot {flown}");
    }
    place.run_refused(&["report", "slots.csv"], "slots.csv/slots.csv");
    place.run_refused(&["report", "scenario.toml"], "scenario.toml is missing");
    fs::rename(place.path("scenario.toml/scenario.moved"), place.path("scenario.toml/scenario.toml")).unwrap();
    place.run_ok(&["report", "scenario.toml"]);
    place.run_ok(&["run", "--resume", "scenario.toml", "--no-viewer", "--pace", "max"]);
    assert_eq!(place.summary("scenario.toml")["complete"], true);
    place.assert_clean();
}

#[test]
fn a_trace_that_is_deleted_or_cut_under_a_simulation_ends_it() {
    let place = Place::new();
    place.scenario("endless");
    let changes: [(&str, Change); 2] = [
        ("it was deleted or moved during the run", |file| fs::remove_file(file).unwrap()),
        ("it was truncated or extended during the run", |file| {
            OpenOptions::new().write(true).open(file).unwrap().set_len(500).unwrap();
        }),
    ];
    for (says, change) in changes {
        let child = place.skysink(&["simulate", "endless.toml", "--out", "run", "--force"]).spawn().unwrap();
        let trace = place.path("run/slots.csv");
        until("slots", || (lines(&trace) > 20).then_some(()));
        change(&trace);
        wait(child).assert_code(1).assert_one_line(&["skysink: run/slots.csv: ", says, "`skysink run --resume run`"]);
        assert_eq!(place.summary("run")["complete"], false);
        let _ = fs::remove_dir_all(place.path("run"));
    }
}

#[cfg(feature = "viewer")]
#[test]
fn a_recording_that_is_deleted_under_a_run_is_noticed_at_its_end() {
    let place = Place::new();
    let run = place.flight("paced").pace("30x").start();
    run.until_slot(10);
    until("recording", || fs::remove_file(run.path("mission.rrd")).ok());
    let ended = run.wait().assert_code(1);
    assert!(ended.stderr.contains("mission.rrd: it was deleted or moved during the run"), "{ended:?}");
    assert!(ended.stderr.contains("viewer ended with exit code 2 in slot 160"), "{ended:?}");
    place.resume("run");
    place.run_ok(&["report", "run"]);
    place.assert_clean();
}
