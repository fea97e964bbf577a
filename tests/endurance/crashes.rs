//! Every crash point: a mission of 20 slots in which a process is killed before its k-th system call, for every k,
//! every process and the launcher, which is then resumed; and two of them in one mission. Each mission ends with the trace of
//! the undisturbed one and with a recording that verifies, and leaves neither files nor shared memory behind.

use std::collections::BTreeMap;
use std::fs;
use std::thread::available_parallelism;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::anywhere::launcher_of;
use crate::support::flight::{FlightBuilder, RING};
use crate::support::{Place, output};
use crate::tracer::{CrashPoint, trace};

const LAUNCHER: &str = "skysink";

/// A place with the undisturbed mission.
struct Missions {
    place: Place,
    #[cfg(feature = "viewer")]
    recorded: crate::support::EntitySlots,
}

impl Missions {
    fn new() -> Self {
        let place = Place::new();
        Self::flight(&place).out("undisturbed").simulate();
        #[cfg(feature = "viewer")]
        let recorded = {
            Self::flight(&place).out("recorded").options(&["--record"]).simulate();
            crate::support::verify(&place.path("recorded/mission.rrd"))
        };
        Self {
            place,
            #[cfg(feature = "viewer")]
            recorded,
        }
    }

    fn flight(place: &Place) -> FlightBuilder<'_> {
        place.flight("smoke").set("slots", 20)
    }

    /// The system calls of each process, each in a mission of its own, because a followed process makes the others wait.
    fn calls(&self) -> BTreeMap<String, u64> {
        let viewer = cfg!(feature = "viewer").then_some("viewer");
        let processes = RING.into_iter().chain(viewer).chain([LAUNCHER]);
        let calls = processes.flat_map(|process| {
            let never = [CrashPoint { process: process.to_owned(), call: u64::MAX }];
            let traced = trace(Self::flight(&self.place).launcher(), &never);
            assert_eq!(traced.code, Some(0), "{traced:?}");
            self.check(&never);
            traced.calls
        });
        calls.collect()
    }

    /// Flies a mission in which processes are killed at these points; returns the number of kills.
    fn fly(&self, points: &[CrashPoint]) -> usize {
        let traced = trace(Self::flight(&self.place).launcher(), points);
        if traced.killed.iter().any(|point| point.process == LAUNCHER) {
            assert_eq!(traced.signal, Some(9), "{traced:?}");
            let resumed = output(launcher_of(&self.place, &Self::flight(&self.place)));
            assert_eq!(resumed.code, Some(0), "{points:?}: {resumed:?}, after {}", traced.stderr);
        } else {
            assert_eq!(traced.code, Some(0), "{points:?}: {traced:?}");
        }
        self.check(points);
        traced.killed.len()
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

/// Flies a mission for each of `points`, in several threads; returns the number of kills.
fn fly_all<const N: usize>(points: &[[CrashPoint; N]], threads: usize) -> usize {
    let share = points.len().div_ceil(threads);
    std::thread::scope(|scope| {
        let fly = |points: &[[CrashPoint; N]]| {
            let missions = Missions::new();
            points.iter().map(|points| missions.fly(points)).sum::<usize>()
        };
        let threads: Vec<_> = points.chunks(share).map(|points| scope.spawn(move || fly(points))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).sum()
    })
}

/// Flies a sample of `singles` single crash points and `pairs` pairs.
fn sample(singles: usize, pair_count: usize) {
    let calls = Missions::new().calls();
    let total: u64 = calls.values().sum();
    let points = every(&calls, (total as usize).div_ceil(singles));
    let kills = fly_all(&points, 1);
    let pair_kills = fly_all(&pairs(&calls, pair_count, 1), 1);
    println!("{calls:?}: {kills} kills at {} points, {pair_kills} kills at {pair_count} pairs", points.len());
    // Processes wait more or less often.
    assert!(kills * 4 >= points.len() * 3, "{kills} kills at {} points", points.len());
    assert!(pair_kills >= pair_count, "{pair_kills} kills at {pair_count} pairs");
}

#[test]
fn a_process_may_die_before_any_of_its_system_calls() {
    sample(120, 24);
}

#[test]
#[ignore = "takes hours"]
fn every_crash_point_changes_nothing() {
    let calls = Missions::new().calls();
    let threads = available_parallelism().unwrap().get();
    let points = every(&calls, 1);
    println!("{calls:?}: {} points", points.len());
    println!("{} kills", fly_all(&points, threads));
    println!("{} kills at 1000 pairs", fly_all(&pairs(&calls, 1000, 2), threads));
}
