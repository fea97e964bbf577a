//! Run folders: their writers, `--force`, and modified files.

use std::fs;
use std::os::unix::fs::symlink;

use expect_test::expect_file;

use crate::support::{Output, Place, wait};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn two_runs_that_replace_one_folder_leave_one_complete_mission() {
    let place = Place::new();
    place.write("force.toml", "name = \"force\"\nslots = 300\n[sensors]\ncount = 1000\n");
    let arguments = |seed, out| ["simulate", "force.toml", "--seed", seed, "--out", out, "--force"];
    let files = ["scenario.toml", "sensors.csv", "slots.csv", "run.toml"];
    let flown = |out: &str| files.map(|file| place.read(&format!("{out}/{file}")));
    let alone = ["1", "2"].map(|seed| {
        place.run_ok(&arguments(seed, seed));
        flown(seed)
    });
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for round in 0..25 {
        let first = place.skysink(&arguments("1", "both")).spawn().unwrap();
        std::thread::sleep(std::time::Duration::from_micros(random.random_range(0..20_000)));
        let second = place.skysink(&arguments("2", "both")).spawn().unwrap();
        let ended = [wait(first), wait(second)];
        for loser in ended.iter().filter(|ended| ended.code != Some(0)) {
            assert_eq!(loser.code, Some(2), "{loser:?}");
            assert!(loser.stderr.contains("a run is writing it"), "{loser:?}");
        }
        // If both succeeded, one of them was so late that it started after the other had ended.
        let left = flown("both");
        let is_whole = |(ended, alone): (&Output, &[String; 4])| ended.code == Some(0) && left == *alone;
        assert!(ended.iter().zip(&alone).any(is_whole), "round {round}: not a mission that succeeded: {ended:?}");
    }
}

#[test]
fn only_a_run_is_replaced() {
    let place = Place::new();
    let folders = ["mine", "sweep", "linked", "folder"];
    folders.iter().for_each(|name| fs::create_dir(place.path(name)).unwrap());
    place.write("mine/scenario.toml", "name = \"mine\"\n");
    place.write("sweep/sweep.json", "{}");
    place.write("sweep/slots.csv", "");
    place.write("file", "");
    symlink("nowhere", place.path("linked/slots.csv")).unwrap();
    fs::create_dir(place.path("folder/summary.json")).unwrap();
    place.write("folder/slots.csv", "");
    place.scenario("smoke");
    place.assert_transcript(&expect_file!["transcripts/folders.txt"]);
    fs::create_dir(place.path("new")).unwrap();
    place.flight("smoke").out("new").simulate();
    assert_eq!(place.read("mine/scenario.toml"), "name = \"mine\"\n");
    fs::create_dir(place.path("empty")).unwrap();
    place.flight("smoke").out("empty").force().simulate();
    for name in ["notes.md", ".notes.md.a1b2c3.new"] {
        place.write(&format!("empty/{name}"), "kept");
    }
    place.write("empty/.summary.json.a1b2c3.new", "{");
    place.flight("smoke").out("empty").force().simulate();
    assert_eq!(place.read("empty/notes.md") + &place.read("empty/.notes.md.a1b2c3.new"), "keptkept");
    assert!(!place.path("empty/.summary.json.a1b2c3.new").exists());
}

/// One change of a file: a bit, a digit, a cut, a byte less or more, a line twice or not at all.
fn spoil(bytes: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let at = random.random_range(0..bytes.len());
    let lines: Vec<_> = bytes.split_inclusive(|&byte| byte == b'\n').map(<[u8]>::to_vec).collect();
    let line = random.random_range(0..lines.len());
    match random.random_range(0..7) {
        1 if bytes.iter().any(u8::is_ascii_digit) => {
            let digits: Vec<_> = (0..bytes.len()).filter(|&at| bytes[at].is_ascii_digit()).collect();
            let digit = &mut bytes[digits[random.random_range(0..digits.len())]];
            *digit = b'0' + (*digit - b'0' + random.random_range(1..10)) % 10;
        }
        0 | 1 => bytes[at] ^= 1 << random.random_range(0..8),
        2 => bytes.truncate(at),
        3 => drop(bytes.remove(at)),
        4 => bytes.insert(at, b"0123456789.,-\n e\0\xff"[random.random_range(0..18)]),
        5 => return [&lines[..=line], &lines[line..]].concat().concat(),
        _ => return [&lines[..line], &lines[line + 1..]].concat().concat(),
    }
    bytes
}

/// A corrupted run that is resumed ends with the bytes of the undisturbed one, or is refused and left unchanged.
fn assert_never_silent(place: &Place, whole: &str, resume: &[&str], rounds: u32, seed: u64) {
    let names = ["scenario.toml", "sensors.csv", "slots.csv", "slots.csv", "run.toml", "slots.check"];
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let begun: Vec<_> = fs::read_dir(place.path("begun"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .map(|name| (fs::read(place.path(&format!("begun/{name}"))).unwrap(), name))
        .collect();
    let begin = || {
        let _ = fs::remove_dir_all(place.path("run"));
        fs::create_dir(place.path("run")).unwrap();
        begun.iter().for_each(|(bytes, name)| fs::write(place.path(&format!("run/{name}")), bytes).unwrap());
    };
    let mut refused = 0;
    for round in 0..rounds {
        begin();
        let name = names[random.random_range(0..names.len())];
        let Some((bytes, _)) = begun.iter().find(|(_, begun)| begun == name) else { continue };
        let spoilt = spoil(bytes, &mut random);
        fs::write(place.path(&format!("run/{name}")), &spoilt).unwrap();
        let ended = place.run(&[&["run", "--no-viewer", "--resume", "run"], resume].concat());
        let case = format!("seed {seed}, round {round}, {name}: {ended:?}");
        if ended.code == Some(0) {
            assert_eq!(place.trace("run"), whole, "{case}");
            continue;
        }
        refused += 1;
        assert_eq!(ended.code, Some(2), "{case}");
        assert_eq!(ended.stderr.lines().count(), 1, "{case}");
        for (bytes, begun) in &begun {
            let expected = if begun == name { &spoilt } else { bytes };
            assert!(fs::read(place.path(&format!("run/{begun}"))).unwrap() == *expected, "{begun} was changed: {case}");
        }
    }
    begin();
    place.run_ok(&[&["run", "--no-viewer", "--resume", "run"], resume].concat());
    assert_eq!(place.trace("run"), whole, "what was not spoilt");
    assert!(refused > rounds / 3, "{refused} of {rounds}");
    println!("{refused} of {rounds} refused, the others with the same bytes");
}

#[test]
fn a_corrupted_run_is_refused_or_resumed_to_the_same_bytes() {
    spoil_runs(120, 1);
}

#[test]
#[ignore = "takes some minutes"]
fn a_thousand_corrupted_runs_are_refused_or_resumed_to_the_same_bytes() {
    spoil_runs(1_000, 3);
}

fn spoil_runs(rounds: u32, seed: u64) {
    let place = Place::new();
    place.flight("smoke").out("begun").simulate();
    let whole = place.trace("begun");
    place.cut_trace("begun", 30);
    fs::remove_file(place.path("begun/summary.json")).unwrap();
    assert_never_silent(&place, &whole, &[], rounds, seed);
    place.assert_clean();
}

#[test]
fn a_corrupted_run_of_an_external_planner_is_refused_or_resumed_to_the_same_bytes() {
    let place = Place::new();
    let planner =
        concat!("sh -c 'exec ", env!("CARGO_BIN_EXE_planner"), " --scenario $SKYSINK_SCENARIO --ring $SKYSINK_RING'");
    let long = place.flight("long").set("slots", 1500);
    long.out("alone").simulate();
    let run = long.out("begun").without_viewer().planner(planner).start();
    run.until_slot(60);
    run.kill_launcher();
    assert_never_silent(&place, &place.trace("alone"), &["--planner", planner], 25, 2);
    place.assert_clean();
}

#[test]
fn a_truncated_paced_run_is_not_flown_differently() {
    let place = Place::new();
    let run = place.flight("paced").pace("50x").without_viewer().start();
    run.until_slot(60);
    run.kill_launcher();
    let trace = place.trace("run");
    place.cut_trace("run", 40);
    let cut = place.trace("run");
    place.run_refused(&["run", "--resume", "run", "--no-viewer"], "slots.csv: lines up to slot ");
    assert_eq!(place.trace("run"), cut);
    fs::write(place.path("run/slots.csv"), &trace).unwrap();
    let check = fs::read(place.path("run/slots.check")).unwrap();
    fs::remove_file(place.path("run/slots.check")).unwrap();
    place.run_refused(&["run", "--resume", "run", "--no-viewer"], "slots.check is missing");
    assert!(!place.path("run/slots.check").exists());
    fs::write(place.path("run/slots.check"), check).unwrap();
    place.resume("run");
    assert!(place.trace("run").starts_with(trace.rsplit_once('\n').unwrap().0));
}

/// Changes a file of a finished run: each command that reads it is refused, or says what it says of the run as it was.
fn spoil_finished_runs(rounds: usize, seed: u64) {
    let place = Place::new();
    place.flight("smoke").strategy("gfs").without_viewer().out("whole").run();
    place.flight("smoke").out("other").simulate();
    let names =
        ["scenario.toml", "sensors.csv", "slots.csv", "run.toml", "summary.json", "summary.json", "slots.check"];
    let commands = [
        ("", &["report", "run"][..]),
        ("", &["report", "run", "--json"]),
        ("run/sensors_out.csv", &["report", "run", "--sensors"]),
        ("", &["compare", "run", "other", "--no-record", "--json", "--out", "made"]),
        ("made", &["export", "run", "--format", "geojson", "--origin", "1,2", "--north", "true", "--out", "made"]),
        ("made/plans.csv", &["replay", "run", "--no-viewer", "--out", "made"]),
    ];
    let begin = || {
        for folder in ["run", "made"] {
            let path = place.path(folder);
            let _ = fs::remove_dir_all(&path).or_else(|_| fs::remove_file(&path));
        }
        fs::create_dir(place.path("run")).unwrap();
        for name in names {
            fs::copy(place.path(&format!("whole/{name}")), place.path(&format!("run/{name}"))).unwrap();
        }
    };
    let outcome = |made: &str, command: &[&str]| {
        let ended = place.run(command);
        let written = if made.is_empty() { None } else { fs::read(place.path(made)).ok() };
        (ended, written)
    };
    let expected = commands.map(|(made, command)| {
        begin();
        let (ended, written) = outcome(made, command);
        assert_eq!((ended.code, written.is_some()), (Some(0), !made.is_empty()), "{command:?}: {ended:?}");
        (ended.stdout, written)
    });
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut refused = 0;
    for round in 0..rounds {
        begin();
        let name = names[random.random_range(0..names.len())];
        let path = place.path(&format!("run/{name}"));
        let spoilt = spoil(&fs::read(&path).unwrap(), &mut random);
        fs::write(&path, &spoilt).unwrap();
        let which = random.random_range(0..commands.len());
        let (made, command) = commands[which];
        let (ended, written) = outcome(made, command);
        let case = format!("seed {seed}, round {round}, {name}, {command:?}: {ended:?}");
        if ended.code == Some(0) {
            assert!((&ended.stdout, &written) == (&expected[which].0, &expected[which].1), "other figures: {case}");
            continue;
        }
        refused += 1;
        assert_eq!((ended.code, ended.stdout.as_str(), written), (Some(2), "", None), "{case}");
        assert_eq!(ended.stderr.lines().count(), 1, "{case}");
    }
    assert!(refused > rounds / 2, "{refused} of {rounds}");
    println!("{refused} of {rounds} refused, the others with the same figures");
    place.assert_clean();
}

#[test]
fn a_corrupted_finished_run_is_refused_or_has_the_same_figures() {
    spoil_finished_runs(60, 4);
}

#[test]
#[ignore = "takes a minute"]
fn three_hundred_corrupted_finished_runs_are_refused_or_have_the_same_figures() {
    spoil_finished_runs(300, 5);
}

#[test]
fn a_modified_summary_is_not_printed_and_a_resumption_writes_it_again() {
    let place = Place::new();
    place.flight("smoke").simulate();
    let whole = place.summary("run");
    let text = place.read("run/summary.json");
    let loss = text.lines().find(|line| line.contains("loss_rate")).unwrap();
    place.write("run/summary.json", &text.replacen(loss, "  \"loss_rate\": 0.001,", 1));
    for arguments in [&["report", "run"][..], &["report", "run", "--json"], &["export", "run", "--format", "csv"]] {
        place
            .run_refused(arguments, "run/summary.json: it was modified, or written by an earlier version (skysink run");
    }
    place.resume("run");
    let again = place.summary("run");
    for key in ["loss_rate", "eta_letter", "delivered_bits", "mean_served", "trace_hash", "complete"] {
        assert_eq!(again[key], whole[key], "{key}");
    }
    place.run_ok(&["report", "run"]);
}
