//! One process and a ring of processes leave the same files: a table of missions, each flown both ways.

use std::collections::BTreeSet;
use std::fs;

use crate::arrivals::{MODELS, bursts};
use crate::channel_map::{LAW, MAP, links, rates};
use crate::channel_table::{TABLE, table};
use crate::support::flight::FlightBuilder;
use crate::support::{Place, assert_balanced, scenarios};
use crate::track::track;

/// Missions that differ by their strategy. Settings are `key=value`, with a space between two.
struct Row {
    /// As [`Place::flight`] names it.
    scenario: &'static str,
    settings: &'static str,
    /// More settings, without which the trace must be another.
    decisive: &'static str,
    /// Strategies, each with settings of its own after its name.
    strategies: &'static [&'static str],
    /// What the ring has that one process has not.
    ring: fn(FlightBuilder) -> FlightBuilder,
    /// Fails unless the run in `ring` shows what the row is about.
    check: fn(place: &Place, case: &str),
}

/// Settings of all rows, before their own.
const QUICK: &str = "slots=40 planner.horizon.iterations=20";

/// What a row is unless it says otherwise.
const ROW: Row = Row {
    scenario: "smoke",
    settings: "",
    decisive: "",
    strategies: &["uts"],
    ring: |flight| flight.without_viewer(),
    check: |_, _| (),
};

/// A ring with the viewer, which records.
const WITH_VIEWER: fn(FlightBuilder) -> FlightBuilder = |flight| flight;

/// A name, and what writes the content.
type File = (&'static str, fn() -> String);

/// Files that the scenarios and settings name.
const FILES: [File; 6] = [
    ("bursts.csv", bursts),
    ("links.csv", links),
    ("list.csv", || scenarios::list(|id| Some(1 + id % 4 * 5))),
    ("rates.csv", rates),
    ("table.csv", table),
    ("track.csv", track),
];

const PLAIN: &[Row] = &[
    Row { settings: "slots=60", strategies: &["uts", "gfs", "rfs"], ring: WITH_VIEWER, ..ROW },
    Row { decisive: "seed=2", strategies: &["uts", "gfs", "rfs"], ..ROW },
    Row { decisive: "seed=3", strategies: &["uts", "gfs", "rfs"], ..ROW },
    Row { scenario: "small", settings: "slots=250", ..ROW },
    Row { ring: |flight| flight.without_viewer().options(&["--wait", "event"]), ..ROW },
    Row { ring: |flight| flight.without_viewer().options(&["--wait", "poll"]), ..ROW },
];

const ARRIVAL: Row = Row {
    settings: "sensors.sampling_bps=[100.0,500.0]",
    strategies: &["uts", "horizon planner.knowledge=estimated planner.rates=learnt"],
    ..ROW
};

const ARRIVALS: &[Row] = &[
    Row { decisive: MODELS[0], ..ARRIVAL },
    Row { decisive: MODELS[1], ring: WITH_VIEWER, ..ARRIVAL },
    Row { decisive: MODELS[2], ..ARRIVAL },
    Row { decisive: MODELS[3], ..ARRIVAL },
];

const LINKS: &[Row] = &[
    Row { decisive: TABLE, strategies: &["uts", "horizon"], check: check_rates, ..ROW },
    Row {
        settings: MAP,
        strategies: &["uts link.service=observed", "horizon link.residual_m=30.0", "gfs planner.links=map"],
        ..ROW
    },
    Row { settings: MAP, decisive: LAW, strategies: &["horizon"], ..ROW },
    Row {
        settings: "link.bandwidth_hz=5e3 link.fading=rician",
        decisive: "planner.link.snr_offset_db=-20 planner.link.k_db=-10",
        strategies: &["uts", "horizon uav.count=2 uav.coordination=sequential"],
        ..ROW
    },
    Row { settings: MAP, decisive: LAW, strategies: &["uts uav.count=2 uav.coordination=sequential"], ..ROW },
    Row { settings: MAP, decisive: LAW, strategies: &["max-weight uav.count=2 uav.coordination=partition"], ..ROW },
];

const PLANS: &[Row] = &[
    Row {
        settings: "sensors.sampling_bps=[50.0,800.0]",
        decisive: "planner.knowledge=estimated planner.rates=learnt",
        strategies: &["uts", "horizon"],
        ..ROW
    },
    Row { scenario: "listed", strategies: &["uts", "max-weight", "horizon"], check: check_weights, ..ROW },
    Row {
        settings: "slots=30 link.bandwidth_hz=1e4 sensors.deadline_s=9",
        decisive: "link.setup_s=0.02 link.sharing=equal",
        strategies: &[
            "horizon planner.objective=age",
            "horizon planner.objective={loss=1.0,age=0.5,peak_age=1e-6,deadline=10.0} uav.count=2",
        ],
        ..ROW
    },
];

const TRACK: &str = "uav.track=track.csv";

const ERRORS: &str = "uav.position_error_m=3.0 uav.wind_mps=[3.0,-4.0]";

const MOTION: &[Row] = &[
    Row { decisive: TRACK, strategies: &["gfs", "horizon"], check: check_refusals, ..ROW },
    Row { decisive: ERRORS, strategies: &["uts", "tour", "horizon"], ..ROW },
    Row {
        settings: "slot_s=2 link.comm_s=1.5",
        decisive: "link.preset=halow-1mhz link.preset_sigma_db=6 uav.preset=mavic-3e",
        ..ROW
    },
    Row { scenario: "home", settings: "slots=80", strategies: &["tour", "horizon"], check: check_battery, ..ROW },
    Row {
        scenario: "plos-high-rise",
        strategies: &["uts", "gfs", "rfs", "uts-wide", "exact"],
        check: check_altitudes,
        ..ROW
    },
];

const FLEET: Row = Row { scenario: "fleet", check: check_fleet, ..ROW };

/// Three UAVs that differ.
const MIXED: &str = "uav.each=[{max_speed_mps=18.0,resource_blocks=2},{altitude_m=35.0,battery={capacity_j=2e4}},{}]";

const FLEETS: &[Row] = &[
    Row { strategies: &["uts uav.coordination=independent"], ..FLEET },
    Row { settings: "uav.coordination=sequential", strategies: &["horizon", "edf"], ..FLEET },
    Row { strategies: &["tour uav.coordination=partition"], ring: WITH_VIEWER, ..FLEET },
    Row { decisive: MIXED, strategies: &["horizon uav.coordination=sequential", "tour"], ring: WITH_VIEWER, ..FLEET },
];

fn check_rates(place: &Place, case: &str) {
    let delivered = place.summary("ring")["delivered_bits"].as_u64().unwrap();
    assert!(delivered < 40 * 3 * 18_000, "{case}: {delivered}: at most 180 kbit/s for 0.1 s, 3 SNs a slot");
}

fn check_weights(place: &Place, case: &str) {
    let header = "x_m,y_m,queue_bits,gain_db,sampling_bps,capacity_bits,weight\n";
    assert!(place.read("ring/sensors.csv").starts_with(header), "{case}");
    let summary = place.summary("ring");
    let [plain, weighted] = ["loss_rate", "weighted_loss_rate"].map(|key| summary[key].as_f64().unwrap());
    assert!(plain > 0.0 && weighted > 0.0 && plain != weighted, "{case}: {plain}, {weighted}");
}

fn check_refusals(place: &Place, case: &str) {
    assert_eq!(place.summary("ring")["refused"], 0, "{case}");
}

fn check_battery(place: &Place, case: &str) {
    let trace = place.trace("ring");
    assert!(trace.contains(",return,") && trace.contains(",charge,"), "{case}");
    let summary = place.summary("ring");
    assert!(summary["landed"] == true && summary["energy"]["down_slot"].is_null(), "{case}: {summary}");
    let left_j: f64 = trace.trim_end().rsplit(',').next().unwrap().parse().unwrap();
    assert_eq!(summary["energy"]["left_j"].as_f64(), Some(left_j), "{case}");
}

fn check_altitudes(place: &Place, case: &str) {
    let trace = place.trace("ring");
    let altitudes: BTreeSet<_> = trace.lines().skip(1).filter_map(|line| line.split(',').nth(4)).collect();
    assert!(altitudes.len() > 1, "{case}: {altitudes:?}");
}

fn check_fleet(place: &Place, case: &str) {
    let fleet = &place.summary("ring")["fleet"];
    assert!(fleet["uavs"] == 3 && fleet["min_separation_m"].as_f64() > Some(0.0), "{case}: {fleet}");
    assert_eq!(place.trace("ring").lines().count(), 1 + 40 * 3, "{case}");
}

/// Fails unless `run` has the files of `alone`, a run of one process, and its figures but for the times.
fn assert_same_run(place: &Place, run: &str, case: &str) {
    place.assert_same_trace("alone", run);
    let entries = fs::read_dir(place.path("alone")).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    for name in names.filter(|name| name != "run.toml" && name != "summary.json") {
        let [alone, other] = ["alone", run].map(|folder| place.read(&format!("{folder}/{name}")));
        assert!(alone == other, "{case}: {run}/{name}");
    }
    assert_eq!(place.reproducible_summary("alone"), place.reproducible_summary(run), "{case}: {run}");
}

/// A place with the [`FILES`].
fn place() -> Place {
    let place = Place::new();
    for (name, text) in FILES {
        place.write(name, &text());
    }
    place
}

/// Flies the rows in one process, in a ring, and again as the ring's folder says.
fn fly(rows: &[Row]) {
    let place = place();
    for row in rows {
        for flown in row.strategies {
            let case = format!("{flown}, {}, {} {}", row.scenario, row.settings, row.decisive);
            let (strategy, own) = flown.split_once(' ').unwrap_or((flown, ""));
            let plain = place.flight(row.scenario).strategy(strategy).force();
            let plain = plain.settings(QUICK).settings(row.settings).settings(own);
            let flight = plain.settings(row.decisive);
            flight.out("alone").simulate();
            (row.ring)(flight.out("ring")).run();
            place.flight("ring/scenario").out("copy").force().simulate();
            for run in ["alone", "ring", "copy"] {
                place.run_ok(&["report", run, "--sensors"]);
            }
            assert_same_run(&place, "ring", &case);
            assert_same_run(&place, "copy", &case);
            if !row.decisive.is_empty() {
                plain.out("plain").simulate();
                assert!(place.trace("plain") != place.trace("ring"), "{case}: the same without {}", row.decisive);
            }
            let summary = place.summary("ring");
            assert_balanced(&summary);
            assert!(summary["delivered_bits"].as_u64() > Some(0), "{case}: {summary}");
            (row.check)(&place, &case);
        }
    }
    place.assert_clean();
}

#[test]
fn ring_and_single_process_leave_the_same_files() {
    fly(PLAIN);
}

#[test]
fn ring_and_single_process_have_the_same_arrivals() {
    fly(ARRIVALS);
}

#[test]
fn ring_and_single_process_draw_the_same_links() {
    fly(LINKS);
}

#[test]
fn ring_and_single_process_make_the_same_plans() {
    fly(PLANS);
}

#[test]
fn ring_and_single_process_move_and_spend_the_same() {
    fly(MOTION);
}

#[test]
fn ring_and_single_process_fly_the_same_fleets() {
    fly(FLEETS);
}

/// Repeated are the flight, the rest of it after a resumption, and its plans.
#[test]
fn a_run_folder_is_repeated_without_the_files_of_its_scenario() {
    let by_law = format!("{MAP} {LAW} uav.count=2");
    for (strategy, settings, copy, value, other) in [
        ("uts", MODELS[3], "arrivals.csv", "900", "901"),
        ("horizon", TABLE, "channel.csv", "60000", "60001"),
        ("max-weight", by_law.as_str(), "rates.csv", "60000", "60001"),
        ("horizon", TRACK, "scenario.toml", "30.0", "31.0"),
        ("uts", ERRORS, "scenario.toml", "30.0", "31.0"),
        ("tour", ERRORS, "scenario.toml", "30.0", "31.0"),
        ("horizon", ERRORS, "scenario.toml", "30.0", "31.0"),
    ] {
        let place = place();
        place.flight("smoke").settings(QUICK).settings(settings).strategy(strategy).simulate();
        FILES.iter().for_each(|(name, _)| fs::remove_file(place.path(name)).unwrap());
        place.assert_repeatable("run");
        place.run_ok(&["report", "run"]);
        let copy = format!("run/{copy}");
        place.write(&copy, &place.read(&copy).replacen(value, other, 1));
        place.run_refused(&["report", "run"], &format!("{copy}: it was modified after the start of the run"));
        place.assert_clean();
    }
}
