//! Sweeps in shards, and the estimate of `--plan`.

use std::fs;

use skysink_lab::sweep::journal::SweepJournal;
use skysink_lab::sweep::manifest::Manifest;
use skysink_mission::metrics::Metric;

use super::{assert_equal, write_sweep};
use crate::support::{Place, lines};

#[test]
fn merged_shards_are_the_whole_sweep() {
    let place = Place::new();
    write_sweep(&place, 3);
    place.run_ok(&["sweep", "sweep.toml", "--out", "whole"]);
    place.run_ok(&["sweep", "sweep.toml", "--out", "a", "--shard", "1/2"]);
    fs::create_dir(place.path("empty")).unwrap();
    place.run_refused(&["merge", "empty", "--out", "early"], "no shard contains a mission");
    fs::copy(place.path("a/sweep.json"), place.path("empty/sweep.json")).unwrap(); // killed before its first mission
    place.run_refused(&["merge", "empty", "--out", "early"], "0 of 54 missions");
    let says = "27 of 54 missions are present: run shards 2 of 2, for example by --array=2 and --shard $SLURM_ARRAY_TASK_ID/2, or pass --partial";
    place.run_refused(&["merge", "a", "--out", "early"], says);
    let part = place.run_ok(&["merge", "a", "empty", "--out", "part", "--partial"]);
    assert_eq!(lines(&place.path("part/results.csv")), 1 + 27);
    assert!(part.stdout.contains("Not all: 27 of 54 missions are present: run shards 2 of 2"), "{part:?}");
    place.run_refused(
        &["sweep", "sweep.toml", "--out", "a", "--shard", "1/3"],
        "it contains shard 1 of 2 of this sweep",
    );
    place.run_ok(&["sweep", "sweep.toml", "--out", "b", "--shard", "2/2"]);
    for out in ["merged", "part"] {
        let ended = place.run_ok(&["merge", "b", "a", "--out", out]);
        assert!(!ended.stdout.contains("Not all"), "{ended:?}");
        assert_equal(&place, "whole", out);
    }
    for (arguments, says) in [
        (&["merge", "a", "b", "./a", "--out", "twice"][..], "shard ./a: it is given twice: expected each shard once\n"),
        (&["merge", "sweep.toml", "--out", "file"], "shard sweep.toml: it is a file: expected the folder of a sweep\n"),
        (&["merge", ".", "--out", "file"], ": expected the folder of a sweep\n"),
        (&["merge", "none", "--out", "file"], ": expected the folder of a sweep\n"),
        (&["sweep", "none"], "sweep none: No such file or directory (os error 2)\n"),
        (&["sweep", "sweep.toml", "--out", "smoke.toml"], "smoke.toml: it is a file: choose another --out\n"),
    ] {
        let ended = place.run(arguments);
        assert_eq!((ended.code, ended.stderr.lines().count()), (Some(2), 1), "{ended:?}");
        assert!(ended.stderr.ends_with(says), "{ended:?}");
    }
}

#[test]
fn shards_of_different_counts_are_merged_unless_contradicting() {
    let place = Place::new();
    write_sweep(&place, 2);
    place.run_ok(&["sweep", "sweep.toml", "--out", "whole"]);
    for (out, shard) in [("a", "1/3"), ("b", "1/2"), ("c", "2/2")] {
        place.run_ok(&["sweep", "sweep.toml", "--out", out, "--shard", shard]);
    }
    place.run_refused(&["merge", "a", "b", "--out", "early"], "run shards 2-3 of 3, for example by");
    place.run_ok(&["merge", "a", "b", "c", "--out", "merged"]);
    assert_equal(&place, "whole", "merged");
    // As an executable with another C library might have it.
    let Manifest { definition, .. } = serde_json::from_str(&place.read("whole/sweep.json")).unwrap();
    let open = |shard: &str| SweepJournal::open(&place.path(shard).join("journal.csv"), &definition).unwrap();
    let mut row = *open("b").rows.values().next().unwrap();
    row.values[Metric::LossRate as usize] += 1e-16;
    open("c").add(&row).unwrap();
    place.run_refused(&["merge", "a", "b", "c", "--out", "contradiction"], "shard c: its results differ");
    assert!(!place.path("contradiction").exists());
}

#[test]
fn any_number_of_shards_partitions_any_sweep() {
    let place = Place::new();
    place.scenario("smoke");
    place.write("sweep.toml", "scenario = \"smoke.toml\"\nstrategies = [\"uts\", \"gfs\"]\nseeds = 5\n");
    place.run_ok(&["sweep", "sweep.toml", "--out", "whole"]);
    let folders: Vec<String> = (1..=7).map(|k| format!("s{k}")).collect();
    for (k, folder) in folders.iter().enumerate() {
        let ended = place.run_ok(&["sweep", "sweep.toml", "--out", folder, "--shard", &format!("{}/7", k + 1)]);
        let rows = lines(&place.path(&format!("{folder}/results.csv"))) - 1;
        let expected = if k < 5 { 2 } else { 0 };
        assert_eq!(rows, expected, "both strategies over one field, or none");
        let says = format!("No missions: shard {} of 7 is beyond the 5 fields", k + 1);
        assert_eq!(ended.stdout.contains(&says), k >= 5, "{ended:?}");
    }
    let arguments = |folders: &[String]| -> Vec<String> {
        let words = ["merge", "--out", "merged"].map(str::to_owned);
        words.into_iter().chain(folders.iter().cloned()).collect()
    };
    let some = [&folders[1..2], &folders[5..]].concat();
    let some = arguments(&some);
    place.run_refused(
        &some.iter().map(String::as_str).collect::<Vec<_>>(),
        "for example by --array=1,3-5 and --shard $SLURM_ARRAY_TASK_ID/7,",
    );
    let all = arguments(&folders);
    place.run_ok(&all.iter().map(String::as_str).collect::<Vec<_>>());
    assert_equal(&place, "whole", "merged");
}

#[test]
fn a_plan_estimates_the_sweep_without_flying() {
    let place = Place::new();
    write_sweep(&place, 5);
    let ended = place.run_ok(&["sweep", "sweep.toml", "--plan"]);
    for says in
        ["Points:    6, with 5 seeds: 30 fields\n", "Missions:  90, of 3 strategies\n", "  rfs  ", "Time:      about "]
    {
        assert!(ended.stdout.contains(says), "{ended:?}");
    }
    assert!(!place.path("runs").exists());
    assert_eq!(place.run(&["sweep", "sweep.toml", "--plan", "--shard", "1/2"]).code, Some(2));
}
