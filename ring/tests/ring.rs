//! A ring in one process: who may join it, who is waited for, and what ends a wait.

use std::fs;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use iceoryx2::prelude::local;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::home::running_rings;
use skysink_ring::role::Role;
use skysink_ring::terms::{LinkTerms, Terms};
use skysink_ring::topics::Ring;
use skysink_ring::wait::{WaitContext, Waiting};

/// Far beyond anything that these tests wait for.
const WATCHDOG: Duration = Duration::from_secs(60);

fn scenario(name: &str) -> Scenario {
    Scenario::parse(&format!("name = '{name}'\n"), Path::new("x.toml"), Overrides::default()).unwrap()
}

fn folder(timeout_s: f64) -> RingFolder {
    RingFolder::create(Terms { wait: Waiting::Event, timeout_s, ..Terms::default() }).unwrap()
}

fn join(folder: &RingFolder, role: Role, stop: &Stop) -> Result<(Ring<local::Service>, WaitContext), RingError> {
    Ring::join(folder, &scenario("x"), role, stop)
}

fn stopped_later(stop: &Stop) -> std::thread::JoinHandle<()> {
    let flag = stop.flag();
    std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(50));
        flag.store(15, Ordering::Relaxed);
    })
}

#[test]
fn a_process_of_another_scenario_is_refused_with_the_expected_one() {
    let folder = folder(60.0);
    let _launcher = join(&folder, Role::Launcher, &Stop::default()).unwrap();
    let theirs = RingFolder::open(folder.path()).unwrap();
    let refused = Ring::<local::Service>::join(&theirs, &scenario("y"), Role::Planner, &Stop::default());
    let error = refused.map(drop).unwrap_err();
    assert_eq!(error.exit_code(), 2);
    let error = error.to_string();
    assert!(error.contains("scenario is") && error.contains("pass the scenario.toml of the run's folder"), "{error}");
    assert!(join(&theirs, Role::Planner, &Stop::default()).is_ok());
}

#[test]
fn headers_carry_the_restart_count() {
    let folder = folder(60.0);
    let _launcher = join(&folder, Role::Launcher, &Stop::default()).unwrap();
    let theirs = RingFolder::open(folder.path()).unwrap();
    for restarts in 0..3 {
        let (ring, wait) = join(&theirs, Role::Planner, &Stop::default()).unwrap();
        assert_eq!((ring.restarts, ring.header(1, 0).epoch), (restarts, restarts));
        drop((ring, wait));
    }
}

#[test]
fn a_launcher_behind_a_link_has_its_own_writer() {
    let link = Some(LinkTerms { version: 0, scenario: 0 });
    let folder = RingFolder::create(Terms { link, ..Terms::default() }).unwrap();
    let (ring, _) = join(&folder, Role::Launcher, &Stop::default()).unwrap();
    assert!(!ring.has_process(Role::Launcher));
    let _commits = ring.commit.writer().unwrap();
    assert!(ring.has_process(Role::Launcher) && !ring.has_process(Role::Planner));
}

#[test]
fn a_missing_sample_ends_the_launchers_wait_and_is_named() {
    let folder = folder(0.05);
    let (ring, mut wait) = join(&folder, Role::Launcher, &Stop::default()).unwrap();
    let mut plans = ring.plan.reader().unwrap();
    let error = plans.wait_for_slot(&mut wait, 7).map(drop).unwrap_err();
    assert_eq!(
        error.to_string(),
        "planner has not sent plan(7) for 0.05 s: is it running? If it is slow, raise --timeout"
    );
}

#[test]
fn a_wait_ends_when_the_process_is_stopped() {
    let folder = folder(1e6);
    let stop = Stop::default();
    let (_ring, mut wait) = join(&folder, Role::Launcher, &stop).unwrap();
    let stopping = stopped_later(&stop);
    let error = wait.sleep_until(Instant::now() + WATCHDOG).unwrap_err();
    assert!(matches!(error, NodeError::Stopped(_)), "{error}");
    stopping.join().unwrap();
}

#[test]
fn a_wait_ends_with_its_launcher() {
    let folder = folder(1e6);
    let launcher = join(&folder, Role::Launcher, &Stop::default()).unwrap();
    let theirs = RingFolder::open(folder.path()).unwrap();
    let (_ring, mut wait) = join(&theirs, Role::Planner, &Stop::default()).unwrap();
    drop((launcher, folder));
    let error = wait.sleep_until(Instant::now() + WATCHDOG).unwrap_err();
    assert!(matches!(error, NodeError::Orphaned), "{error}");
}

#[test]
fn a_ring_runs_as_long_as_its_launcher() {
    let folder = folder(60.0);
    let path = folder.path().to_owned();
    assert!(running_rings().contains(&path));
    drop(folder);
    assert!(!running_rings().contains(&path));
}

#[test]
fn terms_with_an_invalid_timeout_are_refused() {
    let folder = folder(60.0);
    let file = folder.path().join("ring.toml");
    let text = fs::read_to_string(&file).unwrap();
    for timeout in ["-1.0", "nan", "inf"] {
        fs::write(&file, text.replace("timeout_s = 60.0", &format!("timeout_s = {timeout}"))).unwrap();
        let error = RingFolder::open(folder.path()).map(drop).unwrap_err().to_string();
        assert!(error.contains("timeout_s") && error.contains("expected seconds, 0 or above"), "{error}");
    }
}
