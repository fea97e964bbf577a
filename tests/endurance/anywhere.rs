//! Short missions in which any process, the launcher included, is killed at any instant. A mission whose launcher was
//! killed is resumed. Each ends with the trace of the undisturbed mission and complete recordings, and leaves neither
//! files nor shared memory behind.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fs;
use std::process::{Child, Command};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Signal, kill_process};

use crate::support::flight::FlightBuilder;
use crate::support::{Output, Place, family, pid, wait};

/// Time between two polls of a mission.
const POLL_EVERY: Duration = Duration::from_millis(1);

/// Maximum delay of a kill after its trigger.
const MAX_DELAY: Duration = Duration::from_millis(10);

/// Maximum delay of a kill during start-up, about as long as the start-up.
const MAX_START: Duration = Duration::from_millis(150);

/// The kill of a random process, `delay` after the trace has reached a length of `bytes`.
#[derive(Debug)]
pub struct Kill {
    bytes: u64,
    delay: Duration,
}

impl Kill {
    /// Draws a kill: with equal probability during start-up, in the first nine tenths, or in the last tenth of a
    /// mission whose trace has `bytes`.
    pub fn draw(bytes: u64, random: &mut ChaCha8Rng) -> Self {
        let fraction = match random.random_range(0..3) {
            0 => 0.0,
            1 => random.random_range(0.0..0.9),
            _ => random.random_range(0.9..=1.0),
        };
        let max_delay = if fraction == 0.0 { MAX_START } else { MAX_DELAY };
        Self { bytes: (fraction * bytes as f64) as u64, delay: max_delay.mul_f64(random.random()) }
    }
}

/// The launcher of `flight` into `run`, or of the rest of it if some slots are on record.
pub fn launcher_of(place: &Place, flight: &FlightBuilder) -> Command {
    if place.path("run/slots.csv").exists() && place.trace("run").lines().count() > 1 {
        let viewer: &[&str] = if cfg!(feature = "viewer") { &[] } else { &["--no-viewer"] };
        return place.skysink(&[&["run", "--resume", "run"], viewer].concat());
    }
    let _ = fs::remove_dir_all(place.path("run")); // left by a launcher that was killed before slot 1
    flight.launcher()
}

/// Kills processes of a mission until it ends or its launcher is killed, and counts the kills by process.
fn disturb(
    place: &Place,
    mut launcher: Child,
    kills: &mut Vec<Kill>,
    random: &mut ChaCha8Rng,
    killed: &mut BTreeMap<String, u64>,
) -> Output {
    while launcher.try_wait().unwrap().is_none() {
        std::thread::sleep(POLL_EVERY);
        let flown = fs::metadata(place.path("run/slots.csv")).map_or(0, |file| file.len());
        let Some(kill) = kills.pop_if(|kill| kill.bytes <= flown) else {
            if kills.is_empty() {
                break;
            }
            continue;
        };
        std::thread::sleep(kill.delay);
        let processes = family(pid(&launcher));
        let (name, process) = &processes[random.random_range(0..processes.len())];
        if launcher.try_wait().unwrap().is_none() && kill_process(*process, Signal::KILL).is_ok() {
            *killed.entry(name.clone()).or_default() += 1;
        }
    }
    wait(launcher)
}

/// Flies a mission to its end, in which processes are killed, and which is resumed when its launcher was.
pub fn fly_killed(
    place: &Place,
    flight: &FlightBuilder,
    mut kills: Vec<Kill>,
    random: &mut ChaCha8Rng,
    killed: &mut BTreeMap<String, u64>,
) {
    kills.sort_by_key(|kill| Reverse(kill.bytes));
    loop {
        let ended = disturb(place, launcher_of(place, flight).spawn().unwrap(), &mut kills, random, killed);
        if ended.code == Some(0) {
            return;
        }
        assert_eq!(ended.signal, Some(9), "{ended:?}");
    }
}

/// Flies missions, each with at most `kills` kills, and returns the number of kills.
fn kill_anywhere(missions: u64, kills: u32, seed: u64) -> u64 {
    let place = Place::new();
    let flight = place.flight("long").set("slots", 2000);
    flight.out("undisturbed").simulate();
    let bytes = place.trace("undisturbed").len() as u64;
    #[cfg(feature = "viewer")]
    let undisturbed = {
        place.flight("long").set("slots", 20).out("recorded").options(&["--record"]).simulate();
        crate::support::verify(&place.path("recorded/mission.rrd"))
    };
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut killed = BTreeMap::new();
    for _ in 0..missions {
        let kills = (0..kills).map(|_| Kill::draw(bytes, &mut random)).collect();
        fly_killed(&place, &flight, kills, &mut random, &mut killed);
        place.assert_same_trace("undisturbed", "run");
        #[cfg(feature = "viewer")]
        {
            for recording in crate::support::recordings(&place.path("run")) {
                // The viewer of a killed launcher may take a moment to end.
                let is_whole = || skysink_viewer::has_footer(&recording).unwrap_or(false).then_some(());
                crate::support::until("footer", is_whole);
            }
            crate::support::verify_all(&place.path("run"), &undisturbed);
        }
        place.assert_clean();
        fs::remove_dir_all(place.path("run")).unwrap();
    }
    println!("{missions} missions, kills: {killed:?}");
    killed.values().sum()
}

#[test]
fn kills_of_any_process_at_any_time_do_not_change_the_trace() {
    let kills = kill_anywhere(6, 12, 1);
    assert!(kills >= 24, "{kills} kills"); // of 72, some of which come when the mission is over
}

#[test]
#[ignore = "takes minutes"]
fn a_thousand_kills_at_any_time_do_not_change_the_trace() {
    let kills = kill_anywhere(130, 10, 77);
    assert!(kills >= 1000, "{kills} kills");
}
