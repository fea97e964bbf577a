//! `skysink compare`: strategies over the same fields, and finished runs.

#[cfg(feature = "viewer")]
use crate::support::slots;
use crate::support::{Place, scenarios};
use expect_test::expect_file;
use serde_json::Value;
use skysink_mission::figures::Summary;
use skysink_mission::record::RunFolder;

/// A place with `small`, with another seed than the default.
fn with_small() -> Place {
    let place = Place::new();
    place.write("small.toml", &format!("seed = 3\n{}", scenarios::text("small")));
    place
}

/// The same with two runs of it, `a` by `uts` and `b` by `gfs`.
fn with_two_runs() -> Place {
    let place = with_small();
    place.flight("small").out("a").simulate();
    place.flight("small").strategy("gfs").out("b").simulate();
    place
}

/// The figures of `label` by `metric`.
fn standing<'a>(all: &'a Value, label: &str, metric: &str) -> &'a Value {
    let is_it = |one: &&Value| one["label"] == label && one["metric"] == metric;
    all.as_array().unwrap().iter().find(is_it).unwrap_or_else(|| panic!("{label}, {metric}: {all}"))
}

fn compared(place: &Place, arguments: &[&str]) -> Value {
    let ended = place.run_ok(&[&["compare"], arguments, &["--json", "--no-record"]].concat());
    serde_json::from_str(&ended.stdout).unwrap()
}

#[test]
fn strategies_are_compared_over_the_same_seeds() {
    let place = with_small();
    let all = compared(&place, &["small.toml", "uts", "gfs", "--seeds", "3", "--out", "both"]);
    let loss = |seed: u64, strategy: &str| {
        let out = format!("{strategy}-{seed}");
        place.flight("small").seed(seed).strategy(strategy).out(&out).simulate();
        place.summary(&out)["loss_rate"].as_f64().unwrap()
    };
    let losses: Vec<[f64; 2]> = [3, 4, 5].map(|seed| [loss(seed, "uts"), loss(seed, "gfs")]).to_vec();
    let mean = |of: &dyn Fn(&[f64; 2]) -> f64| losses.iter().map(of).sum::<f64>() / 3.0;
    let is_near = |value: &Value, expected: f64| (value.as_f64().unwrap() - expected).abs() < 1e-12;
    let gfs = standing(&all, "gfs", "loss_rate");
    assert!(is_near(&standing(&all, "uts", "loss_rate")["mean"], mean(&|[uts, _]| *uts)), "{all}");
    assert!(is_near(&gfs["mean"], mean(&|[_, gfs]| *gfs)), "{all}");
    assert!(is_near(&gfs["difference"], mean(&|[uts, gfs]| gfs - uts)), "{all}");
    assert_eq!(gfs["n"], 3);
    assert!(standing(&all, "uts", "loss_rate")["difference"].is_null(), "{all}");
    let again = compared(&place, &["small.toml", "uts", "gfs", "--seeds", "3", "--out", "both"]);
    assert_eq!(standing(&again, "gfs", "loss_rate"), gfs);
}

#[test]
fn another_comparison_is_replaced_if_asked_and_a_sweep_of_one_point_is_not() {
    let place = with_small();
    let sweep = "scenario = \"small.toml\"\nstrategies = [\"uts\", \"gfs\"]\nseeds = 2\n";
    place.write("sweep.toml", sweep);
    place.run_ok(&["sweep", "sweep.toml", "--out", "swept"]);
    let rows = place.read("swept/summary.csv");
    place.run_refused(
        &["compare", "small.toml", "uts", "edf", "--out", "swept", "--force"],
        "swept: it contains a sweep, or a comparison that is unfinished or of an earlier version: --force keeps these",
    );
    assert_eq!(place.read("swept/summary.csv"), rows);
    compared(&place, &["small.toml", "uts", "gfs", "--seeds", "2", "--out", "both"]);
    let other = ["small.toml", "uts", "edf", "--seeds", "2", "--out", "both"];
    place.run_refused(&[&["compare"], &other[..]].concat(), "both: its sweep.json describes another sweep");
    let replaced = compared(&place, &[&other[..], &["--force"]].concat());
    assert_eq!(standing(&replaced, "edf", "loss_rate")["n"], 2);
    std::fs::remove_file(place.path("both/comparison.json")).unwrap(); // as an interrupt leaves it
    assert_eq!(compared(&place, &[&other[..], &["--force"]].concat()), replaced);
}

#[test]
fn few_fields_are_warned_of_and_p_values_are_adjusted() {
    let place = with_small();
    let what = ["compare", "small.toml", "uts", "gfs", "rfs", "--seeds", "3", "--out", "all"];
    let ended = place.run_ok(&[&what[..], &["--holm", "--no-record"]].concat());
    assert!(ended.stderr.contains("warning: 3 seeds are few: the 95 % interval"), "{ended:?}");
    assert!(ended.stdout.contains("(Holm)") && ended.stdout.contains("p-values for all of them together"), "{ended:?}");
    let all = compared(&place, &what[1..]);
    let rfs = standing(&all, "rfs", "loss_rate");
    let gfs = standing(&all, "gfs", "loss_rate");
    let p = |one: &Value, key: &str| one[key].as_f64().unwrap();
    let least = p(gfs, "difference_p").min(p(rfs, "difference_p"));
    let least_adjusted = p(gfs, "difference_p_holm").min(p(rfs, "difference_p_holm"));
    assert!((least_adjusted - (2.0 * least).min(1.0)).abs() < 1e-12, "{gfs} {rfs}");
    let ci = rfs["difference_ci95"].as_array().unwrap().iter().map(|limit| limit.as_f64().unwrap()).collect::<Vec<_>>();
    assert_eq!(p(rfs, "difference_p") < 0.05, ci[0] > 0.0 || ci[1] < 0.0, "{rfs}");
    assert!(rfs["nonzero"].as_u64().unwrap() <= 3 && p(rfs, "largest_fraction") <= 1.0, "{rfs}");
    assert_eq!(standing(&all, "uts", "trapped")["n"], 3);
}

#[test]
fn means_dominated_by_few_fields_are_warned_of() {
    let place = with_small();
    let what = ["compare", "small.toml", "uts", "gfs", "rfs", "round-robin", "--seeds", "12", "--out", "all"];
    let ended = place.run_ok(&[&what[..], &["--no-record"]].concat());
    let all = compared(&place, &what[1..]);
    assert!(!ended.stderr.contains("seeds are few"), "{ended:?}");
    for strategy in ["uts", "gfs", "rfs", "round-robin"] {
        let standing = standing(&all, strategy, "loss_rate");
        let nonzero = standing["nonzero"].as_u64().unwrap();
        let is_few = nonzero > 0 && (nonzero < 5 || standing["largest_fraction"].as_f64().unwrap() > 0.2);
        assert_eq!(ended.stderr.contains(&format!("{strategy} (")), is_few, "{standing}: {ended:?}");
    }
    let lossless =
        ["--seeds", "12", "--set", "sensors.sampling_bps=1e-3", "--set", "sensors.initial_queue_mean_bits=0"];
    let ended =
        place.run_ok(&[&["compare", "small.toml", "uts", "gfs", "--out", "no", "--no-record"], &lossless[..]].concat());
    assert!(!ended.stderr.contains("few"), "{ended:?}");
}

#[test]
fn compared_runs_show_their_summaries_after_the_differing_keys() {
    let place = with_small();
    for (strategy, bandwidth) in [("uts", "5e6"), ("gfs", "5e3")] {
        place.flight("small").strategy(strategy).set("link.bandwidth_hz", bandwidth).out(strategy).simulate();
    }
    let all = compared(&place, &["uts", "gfs", "--out", "both"]);
    for strategy in ["uts", "gfs"] {
        let summary = place.summary(strategy);
        for metric in ["loss_rate", "bits_per_waypoint", "mean_served", "eta_letter"] {
            assert_eq!(standing(&all, strategy, metric)["mean"], summary[metric], "{strategy}: {metric}");
        }
        let timing = &standing(&all, strategy, "plan_p50_us")["mean"];
        assert_eq!(*timing, summary["timing"]["plan_p50_us"], "{strategy}");
    }
    let ended = place.run_ok(&["compare", "uts", "gfs", "--out", "both", "--no-record"]);
    assert!(ended.stdout.starts_with("link.bandwidth_hz: 5000000.0 | 5000.0\nplanner.strategy: "), "{ended:?}");
}

#[test]
fn a_modified_trace_is_refused_with_the_line_number() {
    let place = with_two_runs();
    let trace = place.read("b/slots.csv");
    let line = trace.lines().nth(100).unwrap();
    let queued = line.split(',').nth(8).unwrap();
    place.write("b/slots.csv", &trace.replacen(line, &line.replace(queued, "1"), 1));
    place.run_refused(&["compare", "a", "b", "--out", "both"], "b/slots.csv: line 101");
    assert!(!place.path("both").exists());
}

#[test]
fn other_strategies_and_seeds_have_their_own_folders() {
    let place = with_small();
    let folder = |more: &[&str]| {
        let ended = place.run_ok(&[&["compare", "small.toml", "gfs", "--no-record", "--seeds"], more].concat());
        let (_, rest) = ended.stdout.split_once("All metrics:     ").unwrap();
        rest.trim().to_owned()
    };
    let folders =
        [folder(&["2", "uts"]), folder(&["2", "rfs"]), folder(&["3", "uts"]), folder(&["2", "uts", "--seed=9"])];
    for (index, name) in folders.iter().enumerate() {
        assert!(!folders[..index].contains(name), "{folders:?}");
    }
    assert_eq!(folder(&["2", "uts"]), folders[0]);
}

#[test]
fn runs_of_the_same_names_in_other_folders_are_another_comparison() {
    let place = with_small();
    for (parent, seed) in [("one", 1), ("other", 2)] {
        for strategy in ["uts", "gfs"] {
            let out = format!("{parent}/{strategy}");
            place.flight("small").strategy(strategy).seed(seed).out(&out).simulate();
        }
    }
    let folder = |arguments: &[&str]| {
        let ended = place.run_ok(&[&["compare", "--no-record"], arguments].concat());
        ended.stdout.split_once("All metrics:     ").unwrap().1.trim().to_owned()
    };
    let first = folder(&["one/uts", "one/gfs"]);
    let standings = place.read(&first);
    let second = folder(&["other/uts", "other/gfs"]);
    assert_ne!(first, second);
    assert_eq!(place.read(&first), standings);
    assert_ne!(place.read(&second), standings);
    assert_eq!(folder(&["./one/../one/uts", "one/gfs/"]), first);
    // Nor does it replace one in the folder of --out; the same comparison does.
    assert_eq!(folder(&["one/uts", "one/gfs", "--out", "both"]), "both/comparison.json");
    let killed = place.path("both/.comparison.a1b2c3.new");
    std::fs::create_dir(&killed).unwrap();
    place.write("both/.comparison.a1b2c3.new/comparison.rrd", "half");
    assert_eq!(folder(&["one/uts", "one/gfs", "--out", "both"]), "both/comparison.json");
    assert!(!killed.exists());
    for other in [["other/uts", "other/gfs"], ["one/gfs", "one/uts"]] {
        place.run_refused(
            &["compare", other[0], other[1], "--out", "both", "--no-record"],
            "both: it contains a comparison of other runs: choose another --out, or pass --force to replace it",
        );
    }
    assert_eq!(place.read("both/comparison.json"), standings);
    assert_eq!(folder(&["other/uts", "other/gfs", "--out", "both", "--force"]), "both/comparison.json");
    assert_eq!(place.read("both/comparison.json"), place.read(&second));
}

#[test]
fn the_tables_of_many_strategies_and_of_long_names_fit_into_a_terminal() {
    let place = with_small();
    let names = [
        "uts",
        "gfs",
        "drift-plus-penalty",
        "max-age-first",
        "rfs",
        "uts-wide",
        "exact",
        "tour",
        "round-robin",
        "edf",
        "mes",
        "max-weight",
        "whittle",
    ];
    for count in [2, 4, 8, names.len()] {
        let many = [&["compare", "small.toml"], &names[..count], &["--seeds", "2", "--no-record", "--set", "slots=40"]];
        let ended = place.run_ok(&many.concat());
        let table = ended.stdout.lines().filter(|line| line.starts_with(['│', '┌', '╞', '└']));
        assert!(table.clone().count() >= 2 * count, "{ended:?}");
        table.for_each(|line| assert!(line.chars().count() <= 80, "{count}: {}", ended.stdout));
        for name in &names[..count] {
            let rows = ended.stdout.lines().filter(|line| line.starts_with(&format!("│ {name} ")));
            assert_eq!(rows.count(), 2, "{name}: {}", ended.stdout);
        }
    }
    let runs = ["uts", "gfs"].map(|strategy| {
        let out = format!("{}/a-run-with-a-long-name", ["deep"; 12].join("/") + strategy);
        place.flight("small").strategy(strategy).out(&out).simulate();
        out
    });
    let ended = place.run_ok(&["compare", &runs[0], &runs[1], "--no-record"]);
    let table = ended.stdout.lines().filter(|line| line.starts_with(['│', '┌', '╞', '└']));
    table.for_each(|line| assert!(line.chars().count() <= 80, "{}", ended.stdout));
}

#[test]
fn a_run_that_ended_early_is_reported_and_not_compared() {
    let place = with_two_runs();
    let trace = place.read("b/slots.csv");
    let cut: String = trace.split_inclusive('\n').take(101).collect();
    place.write("b/slots.csv", &cut);
    place.run_refused(&["compare", "a", "b", "--no-record"], "100 slots of hash");
    // As if the mission had ended there: a shorter mission has the same first slots, and so the same hash.
    place.flight("small").strategy("gfs").set("slots", 100).out("c").simulate();
    let hash = |run: &str| place.summary(run)["trace_hash"].as_str().unwrap().to_owned();
    let folder = RunFolder::reopen(&place.path("b")).unwrap();
    let summary = folder.summary().unwrap();
    let summary = Summary { slots: 100, complete: false, trace_hash: hash("c"), ..summary };
    folder.write_summary(&summary).unwrap();
    drop(folder);
    let report = place.run_ok(&["report", "b"]);
    assert!(report.stdout.contains("100 slots of 250, ended early"), "{report:?}");
}

#[test]
fn runs_that_cannot_be_compared_are_refused() {
    with_two_runs().assert_transcript(&expect_file!["transcripts/compare.txt"]);
}

#[test]
fn a_comparison_folder_alone_is_repeated_and_extended() {
    let place = with_small();
    let what = ["small.toml", "uts", "gfs", "--set", "slots=60", "--seeds"];
    let first = compared(&place, &[&what[..], &["2", "--out", "first"]].concat());
    let larger = compared(&place, &[&what[..], &["4", "--out", "larger"]].concat());
    std::fs::remove_file(place.path("small.toml")).unwrap();
    let without_times = |all: &Value| -> Vec<Value> {
        let is_time = |one: &Value| one["metric"].as_str().unwrap().ends_with("_us");
        all.as_array().unwrap().iter().filter(|one| !is_time(one)).cloned().collect()
    };
    assert_eq!(without_times(&compared(&place, &["first", "--out", "again"])), without_times(&first));
    assert_eq!(place.read("again/results.csv"), place.read("first/results.csv"));
    assert_eq!(without_times(&compared(&place, &["first", "--seeds", "4"])), without_times(&larger));
    assert_eq!(place.read("first/results.csv"), place.read("larger/results.csv"));
    place.run_refused(&["compare", "first", "--set=slots=5"], "--seed, --set: expected none of them");
    place.run_refused(&["compare", "first", "--seeds=3"], "another sweep, with seed 6");
    place.scenario("smoke");
    let text = "scenario = \"smoke.toml\"\nstrategies = [\"uts\", \"gfs\"]\nseeds = 1\n[axes]\nslots = [5, 6]\n";
    place.write("sweep.toml", text);
    place.run_ok(&["sweep", "sweep.toml", "--out", "swept"]);
    place.run_refused(&["compare", "swept"], "it is a sweep of several points");
}

#[test]
fn a_comparison_of_runs_contains_their_scenarios_and_can_be_repeated() {
    let place = with_two_runs();
    let first = compared(&place, &["a", "b", "--out", "both"]);
    for (number, run) in [("1", "a"), ("2", "b")] {
        let [ours, theirs] = [format!("both/scenario-{number}.toml"), format!("{run}/scenario.toml")];
        assert_eq!(place.read(&ours), place.read(&theirs));
    }
    assert_eq!(compared(&place, &["both"]), first);
    assert_eq!(compared(&place, &["both", "--out", "again"]), first);
    std::fs::remove_dir_all(place.path("b")).unwrap();
    place.run_refused(&["compare", "both"], "/b: ");
    place.write("both/runs.json", "{}");
    place.run_refused(&["compare", "both"], "comparison both: runs.json: ");
}

#[cfg(feature = "viewer")]
#[test]
fn one_recording_holds_every_slot_of_every_mission() {
    let place = with_small();
    let compare = ["compare", "small.toml", "uts", "gfs", "--seeds", "1", "--out", "both", "--set", "slots=60"];
    place.run_ok(&compare);
    let recording = place.path("both/comparison.rrd");
    assert!(skysink_viewer::has_footer(&recording).unwrap());
    for entity in ["/compare/loss_rate/1-uts", "/1-uts/world/uav_trail", "/compare/delivered/2-gfs", "/2-gfs/status"] {
        assert_eq!(slots(&recording, entity), (0..=60).collect(), "{entity}");
    }
    place.run_ok(&compare); // replaces it
    assert_eq!(slots(&recording, "/compare/loss_rate/1-uts"), (0..=60).collect());
    assert!(!place.path("both/comparison-2.rrd").exists());
}
