//! Every crash point: a mission of 20 slots in which a process is killed before its k-th system call, for every k,
//! every process and the launcher, which is then resumed; and two of them in one mission. Each mission ends with the
//! trace of the undisturbed one and with a recording that verifies, and leaves neither files nor shared memory behind.
//!
//! A second actor does not kill but deletes, cuts or replaces a file of the run there.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::os::unix::fs::FileExt as _;
use std::path::Path;
use std::thread::available_parallelism;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::anywhere::launcher_of;
use crate::support::flight::{FlightBuilder, RING};
use crate::support::{Place, output};
use crate::tracer::{CrashPoint, kill_at, trace};

const LAUNCHER: &str = "skysink";

/// One UAV, and three with batteries and a base.
const SCENARIOS: [&str; 2] = ["smoke", "fleet"];

/// Slots of the mission.
const SLOTS: usize = 20;

/// A mission of one of [`SCENARIOS`].
fn flight<'a>(place: &'a Place, scenario: &str) -> FlightBuilder<'a> {
    let home =
        if scenario == "fleet" { "uav.must_land=true uav.battery.capacity_j=9000 base.charge_w=500" } else { "" };
    place.flight(scenario).set("slots", SLOTS).settings(home)
}

/// A place with the undisturbed mission.
struct Missions {
    place: Place,
    scenario: &'static str,
    #[cfg(feature = "viewer")]
    recorded: crate::support::EntitySlots,
}

impl Missions {
    fn of(scenario: &'static str) -> Self {
        let place = Place::new();
        let flight = flight(&place, scenario);
        flight.out("undisturbed").simulate();
        #[cfg(feature = "viewer")]
        let recorded = {
            flight.out("recorded").options(&["--record"]).simulate();
            crate::support::verify(&place.path("recorded/mission.rrd"))
        };
        Self {
            place,
            scenario,
            #[cfg(feature = "viewer")]
            recorded,
        }
    }

    fn flight(&self) -> FlightBuilder<'_> {
        flight(&self.place, self.scenario)
    }

    /// The system calls of each process, each in a mission of its own, because a followed process makes the others
    /// wait.
    fn calls(&self) -> BTreeMap<String, u64> {
        let viewer = cfg!(feature = "viewer").then_some("viewer");
        let processes = RING.into_iter().chain(viewer).chain([LAUNCHER]);
        let calls = processes.flat_map(|process| {
            let never = [CrashPoint { process: process.to_owned(), call: u64::MAX }];
            let traced = kill_at(self.flight().launcher(), &never);
            assert_eq!(traced.code, Some(0), "{traced:?}");
            self.check(&never);
            traced.calls
        });
        calls.collect()
    }

    /// Flies a mission in which processes are killed at these points; returns the number of kills.
    fn fly(&self, points: &[CrashPoint]) -> usize {
        let traced = kill_at(self.flight().launcher(), points);
        if traced.reached.iter().any(|point| point.process == LAUNCHER) {
            assert_eq!(traced.signal, Some(9), "{traced:?}");
            let resumed = output(launcher_of(&self.place, &self.flight()));
            assert_eq!(resumed.code, Some(0), "{points:?}: {resumed:?}, after {}", traced.stderr);
        } else {
            assert_eq!(traced.code, Some(0), "{points:?}: {traced:?}");
        }
        self.check(points);
        traced.reached.len()
    }

    /// Checks what a mission has left, and removes it.
    fn check(&self, points: &[CrashPoint]) {
        assert_eq!(self.place.trace("run"), self.place.trace("undisturbed"), "{points:?}");
        #[cfg(feature = "viewer")]
        {
            println!("{points:?}"); // shown if the test fails
            crate::support::verify_all(&self.place.path("run"), &self.recorded);
        }
        let entries = fs::read_dir(self.place.path("run")).unwrap().map(|entry| entry.unwrap().file_name());
        let hidden: Vec<_> = entries.filter(|name| name.to_string_lossy().starts_with('.')).collect();
        assert!(hidden.is_empty(), "{points:?}: {hidden:?}");
        self.place.assert_clean();
        fs::remove_dir_all(self.place.path("run")).unwrap();
    }
}

/// What a second actor does to a file.
#[derive(Debug, Clone, Copy)]
enum Change {
    Delete,
    Cut,
    Overwrite,
    Replace,
}

impl Change {
    const ALL: [Self; 4] = [Self::Delete, Self::Cut, Self::Overwrite, Self::Replace];

    /// Changes the file, if it is there.
    fn apply(self, path: &Path) -> std::io::Result<()> {
        let other = path.with_extension("other");
        match self {
            Self::Delete => fs::remove_file(path),
            Self::Cut => File::options().write(true).open(path)?.set_len(fs::metadata(path)?.len() / 2),
            Self::Overwrite => File::options().write(true).open(path)?.write_all_at(b"#", 1),
            Self::Replace => fs::copy(path, &other).and_then(|_| fs::rename(other, path)),
        }
    }
}

impl Missions {
    /// Flies a mission in which a file of the run is changed at `point`; returns whether the mission said so, and
    /// `None` if it was not there. Before its last slot is on record, the mission either ends with the file that it
    /// would have written, or says which file was changed.
    fn fly_changed(&self, point: &CrashPoint, name: &str, change: Change) -> Option<bool> {
        let path = self.place.path("run").join(name);
        let mut changed_after = None;
        let traced = trace(self.flight().launcher(), std::slice::from_ref(point), |_| {
            let slots = fs::read_to_string(self.place.path("run/slots.csv")).map_or(0, |trace| trace.lines().count());
            changed_after = change.apply(&path).is_ok().then_some(slots.saturating_sub(1));
        });
        let context = format!("{name}, {change:?} at {point:?} after slot {changed_after:?}: {traced:?}");
        let is_late = changed_after == Some(SLOTS);
        if traced.code == Some(0) && !is_late {
            assert_eq!(self.place.trace("run"), self.place.trace("undisturbed"), "{context}");
            for given in ["scenario.toml", "sensors.csv"] {
                let read = |run: &str| fs::read(self.place.path(run).join(given)).unwrap();
                assert_eq!(read("run"), read("undisturbed"), "{context}");
            }
            self.place.run_ok(&["report", "run"]);
            #[cfg(feature = "viewer")]
            crate::support::verify_all(&self.place.path("run"), &self.recorded);
        } else if traced.code != Some(0) {
            assert_eq!(traced.code.is_some_and(|code| [1, 2].contains(&code)), changed_after.is_some(), "{context}");
            assert!(traced.stderr.contains(name), "{context}");
        }
        self.place.assert_clean();
        let _ = fs::remove_dir_all(self.place.path("run"));
        changed_after.map(|_| traced.code != Some(0))
    }
}

/// Every `stride`-th crash point of each process, by name.
fn every(calls: &BTreeMap<String, u64>, stride: usize) -> Vec<[CrashPoint; 1]> {
    let points = calls
        .iter()
        .flat_map(|(name, &calls)| (1..=calls).map(move |call| [CrashPoint { process: name.clone(), call }]));
    points.step_by(stride).collect()
}

/// Crash points of a worker and the launcher.
fn pairs(calls: &BTreeMap<String, u64>, count: usize, seed: u64) -> Vec<[CrashPoint; 2]> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let workers: Vec<_> = calls.keys().filter(|name| *name != LAUNCHER).collect();
    let mut point =
        |process: &str| CrashPoint { process: process.to_owned(), call: random.random_range(1..=calls[process]) };
    (0..count).map(|pair| [point(workers[pair % workers.len()]), point(LAUNCHER)]).collect()
}

/// Flies a mission of `scenario` for each of `points`, in several threads; returns the number of kills.
fn fly_all<const N: usize>(scenario: &'static str, points: &[[CrashPoint; N]], threads: usize) -> usize {
    let share = points.len().div_ceil(threads);
    std::thread::scope(|scope| {
        let fly = |points: &[[CrashPoint; N]]| {
            let missions = Missions::of(scenario);
            points.iter().map(|points| missions.fly(points)).sum::<usize>()
        };
        let threads: Vec<_> = points.chunks(share).map(|points| scope.spawn(move || fly(points))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).sum()
    })
}

/// Flies a sample of `singles` single crash points and `pairs` pairs of `scenario`.
fn sample(scenario: &'static str, singles: usize, pair_count: usize, threads: usize) {
    let calls = Missions::of(scenario).calls();
    let total: u64 = calls.values().sum();
    let points = every(&calls, (total as usize).div_ceil(singles));
    let kills = fly_all(scenario, &points, threads);
    let pair_kills = fly_all(scenario, &pairs(&calls, pair_count, 1), threads);
    println!("{scenario}: {calls:?}: {kills} kills at {} points, {pair_kills} at {pair_count} pairs", points.len());
    // Processes wait more or less often.
    assert!(kills * 4 >= points.len() * 3, "{kills} kills at {} points", points.len());
    assert!(pair_kills >= pair_count, "{pair_kills} kills at {pair_count} pairs");
}

#[test]
fn a_crash_before_any_system_call_does_not_change_the_trace() {
    for (scenario, singles, pairs) in [(SCENARIOS[0], 60, 12), (SCENARIOS[1], 20, 4)] {
        sample(scenario, singles, pairs, 1);
    }
}

#[test]
fn a_file_change_before_any_system_call_is_detected() {
    let missions = Missions::of(SCENARIOS[0]);
    let calls = missions.calls();
    let total: u64 = calls.values().sum();
    let files = ["slots.csv", "slots.check", "scenario.toml", "sensors.csv", "run.toml", "mission.rrd"];
    let files = &files[..if cfg!(feature = "viewer") { 6 } else { 5 }];
    let cases = files.iter().flat_map(|name| Change::ALL.map(|change| (*name, change)));
    let points = every(&calls, total as usize / 48);
    let fly = |([point], (name, change)): (&[CrashPoint; 1], (&str, Change))| missions.fly_changed(point, name, change);
    let changed: Vec<bool> = points.iter().zip(cases.cycle()).filter_map(fly).collect();
    let said = changed.iter().filter(|is_said| **is_said).count();
    println!("{} changes at {} points, {said} of them said", changed.len(), points.len());
    assert!(changed.len() * 2 >= points.len() && said * 2 >= changed.len(), "{said} of {}", changed.len());
}

/// The part of `points` that the environment variable `PART` names, such as `2/4`: every fourth, from the second.
fn part<T>(points: Vec<T>) -> Vec<T> {
    let part = std::env::var("PART").unwrap_or_else(|_| "1/1".to_owned());
    let (number, count) = part.split_once('/').expect("PART is NUMBER/COUNT");
    let [number, count] = [number, count].map(|text| text.parse::<usize>().expect("PART is NUMBER/COUNT"));
    points.into_iter().skip(number - 1).step_by(count).collect()
}

/// The crash points of a process in `range`, such as `viewer:390-400`: what a point has found is found again by those
/// around it, or by the same, several times.
fn points_of(range: &str) -> Vec<[CrashPoint; 1]> {
    let (process, calls) = range.split_once(':').expect("PROCESS:FIRST-LAST");
    let (first, last) = calls.split_once('-').expect("PROCESS:FIRST-LAST");
    let [first, last] = [first, last].map(|text| text.parse::<u64>().expect("PROCESS:FIRST-LAST"));
    (first..=last).map(|call| [CrashPoint { process: process.to_owned(), call }]).collect()
}

/// All cores.
fn threads() -> usize {
    available_parallelism().unwrap().get()
}

#[test]
#[ignore = "takes hours; PART=1/4 flies a quarter of the points, POINTS=viewer:390-400 these, POINTS=pairs only pairs"]
fn no_crash_point_changes_the_trace() {
    let scenario = SCENARIOS[0];
    let calls = Missions::of(scenario).calls();
    let all_pairs = || part(pairs(&calls, 1000, 2));
    let (points, pairs) = match std::env::var("POINTS").as_deref() {
        Ok("pairs") => (Vec::new(), all_pairs()),
        Ok(range) => (points_of(range), Vec::new()),
        Err(_) => (part(every(&calls, 1)), all_pairs()),
    };
    println!("{calls:?}: {} points", points.len());
    if !points.is_empty() {
        println!("{} kills", fly_all(scenario, &points, threads()));
    }
    if !pairs.is_empty() {
        println!("{} kills at {} pairs", fly_all(scenario, &pairs, threads()), pairs.len());
    }
}

#[test]
#[ignore = "takes half an hour"]
fn two_thousand_crash_points_of_a_fleet_change_no_trace() {
    sample(SCENARIOS[1], 1800, 200, threads());
}
