//! The trace of a resumed run: lines that must agree with the mission, and lines that only the trace can know.

use std::path::{Path, PathBuf};

use skysink::run::resume::resume;
use skysink_common::message::Plan;
use skysink_common::pace::Pace;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::drive::SlotSink;
use skysink_mission::folder::Earlier;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::tally::Tally;
use skysink_mission::{Mission, Plant};
use skysink_planner::settings;

use crate::support::{Place, pid, scenarios, until, wait};
use rustix::process::{Signal, kill_process};

/// Recorded slots.
const SLOTS: u64 = 30;

/// The planner of a recorded run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PlansBy {
    Planner,
    External,
}

/// The plan that is flown in a slot instead of the planner's own; `None` where it came too late.
type Substitute = fn(slot: u64, own: Plan) -> Option<Plan>;

/// Records the first slots in `out`, flown by the plans of `substitute`.
fn record(scenario: &Scenario, list: &SensorList, out: &Path, plans_by: PlansBy, substitute: Substitute) -> RunFolder {
    let external_planner = (plans_by == PlansBy::External).then(|| "external".to_owned());
    let run_mode = RunMode { pace: Some(Pace::Max), external_planner, ..RunMode::default() };
    let folder = RunFolder::create(Some(out), Earlier::Kept, scenario, list, &run_mode).unwrap();
    let mut log = folder.slot_log().unwrap();
    let mut mission = Mission::new(scenario, list).unwrap();
    for slot in 1..=SLOTS {
        let own = mission.plan();
        log.add(mission.fly(substitute(slot, own).as_ref())).unwrap();
    }
    folder
}

/// The last slot that a resumed run begins after, or why it is refused.
fn resumed(strategy: &'static str, plans_by: PlansBy, substitute: Substitute) -> Result<u64, String> {
    resumed_with("", strategy, plans_by, substitute)
}

/// The same with further `keys` of the scenario.
fn resumed_with(keys: &str, strategy: &'static str, plans_by: PlansBy, substitute: Substitute) -> Result<u64, String> {
    let place = tempfile::tempdir().unwrap();
    let out: PathBuf = place.path().join("run");
    let text = format!("{}{keys}", scenarios::text("smoke"));
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    let scenario = Scenario::parse(&text, Path::new("smoke.toml"), overrides).and_then(settings::resolve).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let folder = record(&scenario, &list, &out, plans_by, substitute);
    let mut tally = Tally::new(&scenario, &list, folder.run_mode());
    let resumed = resume(&folder, &scenario, &list, &mut tally, &Stop::default());
    resumed.map(|_| tally.sums.last_slot()).map_err(|error| error.to_string())
}

/// A plan that the UAV can fly and that no strategy makes: the waypoint is a millimetre off.
fn nudged(slot: u64, own: Plan) -> Option<Plan> {
    let y_m = if slot == 20 { own.y_m + 1e-3 * (50.0 - own.y_m).signum() } else { own.y_m };
    Some(Plan { y_m, ..own })
}

#[test]
fn an_unplanned_feasible_line_is_refused() {
    assert_eq!(resumed("uts", PlansBy::Planner, |_, own| Some(own)), Ok(SLOTS));
    let error = resumed("uts", PlansBy::Planner, nudged).unwrap_err();
    assert!(
        error.contains("slots.csv: line 21: `20,")
            && error.contains("`: it differs from the simulation of the scenario"),
        "{error}"
    );
}

#[test]
fn plans_of_an_external_planner_are_taken_from_the_trace() {
    assert_eq!(resumed("uts", PlansBy::External, nudged), Ok(SLOTS));
    let refused = |_, own: Plan| Some(Plan { x_m: f64::NAN, ..own });
    assert_eq!(resumed("uts", PlansBy::External, refused), Ok(SLOTS), "waypoints that were refused");
}

#[test]
fn a_late_plan_is_a_hold_with_any_strategy() {
    let late = |slot: u64, own| (slot % 7 != 3).then_some(own);
    for strategy in ["uts", "rfs", "tour", "max-age-first"] {
        assert_eq!(resumed(strategy, PlansBy::Planner, late), Ok(SLOTS), "{strategy:?}");
    }
}

#[test]
fn a_battery_may_end_while_plans_are_late() {
    let battery = "[uav.battery]\ncapacity_j = 3000.0\n";
    for strategy in ["uts", "rfs", "tour", "max-age-first"] {
        let resumed = |substitute| resumed_with(battery, strategy, PlansBy::Planner, substitute);
        assert_eq!(resumed(|slot, own| (slot < 5).then_some(own)), Ok(SLOTS), "{strategy}");
        assert_eq!(resumed(|_, _| None), Ok(SLOTS), "{strategy}: in the base, where its plan would be to charge");
    }
    let nudged = |slot, own| if slot < 5 { nudged(slot + 16, own) } else { None };
    let error = resumed_with(battery, "uts", PlansBy::Planner, nudged).unwrap_err();
    assert!(error.contains("slots.csv: line 5: "), "the plan of slot 4 was in time: {error}");
}

#[test]
fn plans_of_a_stateful_planner_after_a_hold_are_not_compared() {
    let late_and_nudged = |slot, own| if slot == 5 { None } else { nudged(slot, own) };
    assert_eq!(resumed("tour", PlansBy::Planner, late_and_nudged), Ok(SLOTS));
    assert!(resumed("uts", PlansBy::Planner, late_and_nudged).is_err(), "uts plans each slot by itself");
}

/// Records so many slots without a plan in time, paced, in the folder `out`, of a planner whose search takes hours.
fn record_holds(out: &Path, slots: u64, external_planner: Option<&str>) -> (Scenario, SensorList, RunFolder) {
    let text = format!("{}[planner.horizon]\niterations = 1000000000\n", scenarios::text("smoke"));
    let overrides = Overrides { strategy: Some("horizon"), ..Overrides::default() };
    let scenario = Scenario::parse(&text, Path::new("smoke.toml"), overrides).and_then(settings::resolve).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let external_planner = external_planner.map(str::to_owned);
    let run_mode = RunMode { pace: "10x".parse().ok(), external_planner, ..RunMode::default() };
    let folder = RunFolder::create(Some(out), Earlier::Kept, &scenario, &list, &run_mode).unwrap();
    let mut log = folder.slot_log().unwrap();
    let mut plant = Plant::new(&scenario, &list);
    for _ in 0..slots {
        log.add(plant.step(&[None])).unwrap();
    }
    (scenario, list, folder)
}

#[test]
fn a_complete_run_without_plans_is_not_planned_again() {
    let place = tempfile::tempdir().unwrap();
    let (scenario, list, folder) = record_holds(&place.path().join("run"), scenarios::smoke("uts").slots, Some("mine"));
    let mut tally = Tally::new(&scenario, &list, folder.run_mode());
    let stop = Stop::default();
    let flag = stop.flag();
    std::thread::spawn(move || {
        std::thread::sleep(std::time::Duration::from_secs(60));
        flag.store(2, std::sync::atomic::Ordering::Relaxed); // ends the search
    });
    let resumed = resume(&folder, &scenario, &list, &mut tally, &stop);
    assert!(resumed.is_ok(), "{:?}", resumed.err());
    assert_eq!((tally.sums.last_slot(), tally.sums.missed_deadlines()), (scenario.slots, scenario.slots));
}

#[test]
fn a_complete_run_keeps_its_times_when_it_is_resumed() {
    let place = Place::new();
    place.flight("smoke").without_viewer().run();
    let written = place.read("run/summary.json");
    let printed = place.run_ok(&["run", "--resume", "run", "--no-viewer", "--json"]).stdout;
    let printed: serde_json::Value = serde_json::from_str(&printed).unwrap();
    assert_eq!((&printed["timing"], place.read("run/summary.json")), (&place.summary("run")["timing"], written));
    assert!(printed["timing"]["plan_p50_us"].as_f64() > Some(0.0), "{printed}");
    assert_eq!(printed["resumed_after"], printed["planned_slots"]);
}

#[test]
fn whoever_flies_into_an_interrupted_run_learns_how_to_fly_on() {
    let place = Place::new();
    record_holds(&place.path("run"), 3, None);
    let begun = place.read("run/slots.csv");
    let scenario = place.scenario("smoke");
    place.run_refused(
        &["run", &scenario, "--out", "run", "--no-viewer"],
        "fly on with skysink run --resume, or pass --force",
    );
    assert_eq!(place.read("run/slots.csv"), begun);
}

#[test]
fn a_long_resumption_reports_its_progress() {
    let place = Place::new();
    record_holds(&place.path("run"), SLOTS, None);
    let stderr = place.path("stderr");
    let mut command = place.skysink(&["run", "--resume", "run", "--no-viewer"]);
    let child = command.stderr(std::fs::File::create(&stderr).unwrap()).spawn().unwrap();
    let said = || std::fs::read_to_string(&stderr).unwrap();
    until("a line", || said().contains("simulating the recorded slots again").then_some(()));
    kill_process(pid(&child), Signal::INT).unwrap();
    wait(child).assert_code(130);
    assert_eq!(said().lines().count(), 2, "{}", said());
    place.assert_clean();
}
