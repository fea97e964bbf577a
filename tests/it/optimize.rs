//! `skysink optimize`: the best known flight beats every strategy, is above the bound, and can be reproduced.

use std::fs;
use std::process::Child;

use crate::support::{Place, pid, until, wait};
use expect_test::expect_file;
use rustix::process::{Signal, kill_process};
use skysink_planner::strategies::STRATEGIES;

/// A field too large for strategies that look one slot ahead, in which no flight avoids all loss.
const SPARSE: &str = "name = \"far\"\nslots = 120\n[area]\nside_m = 500.0\n[sensors]\ncount = 40\nsampling_bps = 400.0\n\
                      [planner]\nhorizon.iterations = 50\n";

fn optimum(place: &Place, run: &str) -> serde_json::Value {
    serde_json::from_str(&place.read(&format!("{run}/optimum.json"))).unwrap()
}

#[test]
fn the_best_known_loss_lies_between_bound_and_strategies_and_is_reproducible() {
    let place = Place::new();
    place.write("far.toml", SPARSE);
    let printed = place.run_ok(&["optimize", "far.toml", "--steps", "200000", "--out", "best"]).stdout;
    for word in [
        "lower bound",
        "best known",
        "offline",
        "uts-wide",
        "horizon",
        "Searched 200,000 steps in ",
        ", the whole budget. Repeat the search with --steps 200000.",
    ] {
        assert!(printed.contains(word), "{word}: {printed}");
    }
    let optimum = optimum(&place, "best");
    let best = &optimum["best_known"];
    let bound = optimum["loss_bound"].as_f64().unwrap();
    let least = best["loss_rate"].as_f64().unwrap();
    assert_eq!((best["strategy"].as_str(), optimum["steps"].as_u64()), (Some("offline"), Some(200_000)));
    assert_eq!((optimum["steps_done"].as_u64(), optimum["search_end"].as_str()), (Some(200_000), Some("all-steps")));
    assert!(0.0 < bound && bound <= least && least < 1.0, "{optimum}");
    assert!(optimum["expected_loss_bound"].is_null() && !printed.contains("expected"), "the channel is not random");
    let standings = optimum["strategies"].as_array().unwrap();
    let losses: Vec<f64> = standings.iter().map(|standing| standing["loss_rate"].as_f64().unwrap()).collect();
    assert!(losses.is_sorted() && losses[0] == least && losses[losses.len() - 1] > least, "{optimum}");
    assert_eq!(losses.len(), STRATEGIES.len(), "{optimum}");
    // The figures are those of the flight in the folder, and of every strategy by itself.
    assert_eq!(place.summary("best")["loss_rate"].as_f64(), Some(least));
    place.flight("far").strategy("gfs").out("gfs").simulate();
    let gfs = standings.iter().find(|standing| standing["strategy"] == "gfs").unwrap();
    assert_eq!(gfs["loss_rate"], place.summary("gfs")["loss_rate"]);
    // The folder's scenario finds and flies it again, in one process and in the ring.
    place.flight("best/scenario").out("again").simulate();
    place.flight("best/scenario").out("ring").without_viewer().run();
    for again in ["again", "ring"] {
        place.assert_same_trace("best", again);
    }
    place.assert_clean();
}

#[test]
fn a_random_channel_has_a_separate_expected_bound() {
    let place = Place::new();
    // Two sensor nodes in range from everywhere, whose links are too slow for their sampling rates. By the gains of the
    // list every flight would lose at least 0.40; the gains of the slots are better.
    let text = "name = \"fading\"\nseed = 55\nslots = 100\n[area]\nside_m = 20.0\n[sensors]\ncount = 2\n\
                sampling_bps = 3000.0\n[link]\ngain = \"per-slot\"\ngain_db = [-70.0, -50.0]\nbandwidth_hz = 2000.0\n\
                resource_blocks = 2\ncomm_radius_m = 50.0\n[planner]\nhorizon.iterations = 50\n";
    place.write("fading.toml", text);
    let printed = place.run_ok(&["optimize", "fading.toml", "--steps", "1000", "--out", "best"]).stdout;
    assert!(printed.contains("expected lower bound"), "{printed}");
    let optimum = optimum(&place, "best");
    let [bound, expected] =
        ["loss_bound", "expected_loss_bound"].map(|name| optimum[name].as_f64().unwrap_or(f64::NAN));
    let least = optimum["best_known"]["loss_rate"].as_f64().unwrap();
    assert!(0.9 * least < bound && bound <= least && (0.1..0.4).contains(&expected), "{optimum}");
    assert_ne!(optimum["search_end"], "optimal", "it only is in the model of the search: {optimum}");
}

#[test]
fn a_time_budget_is_converted_to_steps() {
    let place = Place::new();
    place.write("far.toml", SPARSE);
    for budget in ["0.01", "0.01s", "10ms", "0.0001m", "0.00001h"] {
        place.run_ok(&["optimize", "far.toml", "--budget", budget, "--out", budget]);
        assert_eq!(optimum(&place, budget)["steps"], 100_000, "{budget}: no fewer than a trial takes");
    }
}

#[test]
fn a_search_that_ends_early_reports_its_steps_and_the_reason() {
    let place = Place::new();
    // 40 m: all sampled data can be collected.
    place.write("small.toml", "name = \"small\"\nslots = 50\n[area]\nside_m = 40.0\n[sensors]\ncount = 10\n");
    let printed = place.run_ok(&["optimize", "small.toml", "--steps", "100000000", "--out", "small"]).stdout;
    let last = printed.lines().find(|line| line.starts_with("Searched ")).unwrap();
    assert!(last.contains(" of up to 100,000,000 steps in "), "{last}");
    let reason = "the plan loses nothing, so it is optimal. Repeat the search with --steps 100000000.";
    assert!(last.ends_with(reason), "{last}");
    let optimum = optimum(&place, "small");
    assert!(optimum["search_end"] == "optimal" && optimum["steps_done"].as_u64().unwrap() < 100_000_000, "{optimum}");
    // Without a sampling sensor node there is nothing to search.
    let idle = "name = \"idle\"\nslots = 50\n[sensors]\ncount = 10\nsampling_bps = 0.0\n";
    place.write("idle.toml", idle);
    let printed = place.run_ok(&["optimize", "idle.toml", "--budget", "1", "--out", "idle"]).stdout;
    assert!(printed.contains("Nothing to search: no sensor node that can lose data"), "{printed}");
}

#[test]
fn the_flight_of_a_better_strategy_is_the_best_known() {
    let place = Place::new();
    place.write("far.toml", SPARSE);
    place.run_ok(&["optimize", "far.toml", "--steps", "0"]);
    let folder = fs::read_dir(place.path("runs")).unwrap().next().unwrap().unwrap().file_name();
    let folder = format!("runs/{}", folder.to_str().unwrap());
    let best = optimum(&place, &folder)["best_known"].clone();
    let strategy = best["strategy"].as_str().unwrap();
    assert!(strategy != "offline" && folder == format!("runs/far-{strategy}-1"), "{folder}: {best}");
    assert_eq!(place.summary(&folder)["strategy"], best["strategy"]);
    assert_eq!(place.summary(&folder)["loss_rate"], best["loss_rate"]);
}

/// For each objective: what its flight costs is in the folder, no strategy is better, and none is below the bound.
#[test]
fn the_best_known_flight_is_that_of_the_objective() {
    let place = Place::new();
    place.write("far.toml", SPARSE);
    for objective in ["\"age\"", "{ loss = 1.0, age = 90.0 }", "\"collect\""] {
        let set = format!("planner.objective={objective}");
        let arguments = ["optimize", "far.toml", "--steps", "20000", "--set", &set, "--out", "best", "--force"];
        let printed = place.run_ok(&arguments).stdout;
        assert!(printed.contains("objective"), "{printed}");
        let optimum = optimum(&place, "best");
        let costs = optimum["strategies"].as_array().unwrap().iter().map(|one| one["objective"].as_f64().unwrap());
        let costs: Vec<f64> = costs.collect();
        let best = optimum["best_known"]["objective"].as_f64().unwrap();
        assert!(costs.is_sorted() && costs[0] == best && costs[3] > best, "{optimum}");
        let summary = place.summary("best");
        match objective {
            "\"collect\"" => {
                let left = |name: &str| summary[name].as_f64().unwrap();
                assert_eq!(best, left("lost_bits") + left("queued_bits"));
                let bound = optimum["objective_bound"].as_f64().unwrap();
                assert!(0.0 < bound && bound <= best && optimum["score_bound"].is_null(), "{optimum}");
            }
            _ => {
                assert_eq!(summary["objective"].as_f64(), Some(best));
                let bound = optimum["objective_bound"].as_f64().unwrap();
                assert!(0.5 * best < bound && bound <= best, "{objective}: {optimum}");
            }
        }
    }
}

#[test]
fn invalid_budgets_and_existing_folders_are_refused_before_the_search() {
    let place = Place::new();
    place.write("far.toml", SPARSE);
    place.assert_transcript(&expect_file!["transcripts/optimize.txt"]);
}

#[test]
fn an_interrupted_search_leaves_no_files() {
    let place = Place::new();
    place.write("far.toml", SPARSE);
    let search = place.skysink(&["optimize", "far.toml", "--steps", "1000000000000", "--out", "best"]).spawn().unwrap();
    interrupt(&search);
    let ended = wait(search);
    assert_eq!(ended.code, Some(130));
    let left = "skysink: stopped by signal 2: nothing was written; run the command again";
    assert!(ended.stderr.starts_with(left) && ended.stderr.lines().count() == 1, "{ended:?}");
    assert!(!place.path("best").exists());
}

#[test]
fn offline_stops_on_request_during_the_search_before_slot_1() {
    let place = Place::new();
    // A month of search.
    place.write("far.toml", &format!("{SPARSE}offline.steps = 1000000000000\n"));
    let flight = place.skysink(&["simulate", "far.toml", "--strategy", "offline", "--out", "run"]).spawn().unwrap();
    until("run", || place.path("run/slots.csv").exists().then_some(()));
    interrupt(&flight);
    assert_eq!(wait(flight).code, Some(130));
    assert_eq!(place.read("run/slots.csv").lines().count(), 1, "no slot is flown by a plan that was cut short");
}

/// Sends SIGINT to a process as soon as it catches that.
fn interrupt(process: &Child) {
    let status = format!("/proc/{}/status", process.id());
    until("a process that catches SIGINT", || {
        let status = fs::read_to_string(&status).unwrap();
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap().trim();
        (u64::from_str_radix(caught, 16).unwrap() >> 1 & 1 == 1).then_some(())
    });
    kill_process(pid(process), Signal::INT).unwrap();
}
