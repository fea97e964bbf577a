//! Processes of the ring are killed and restarted, and the trace is that of the undisturbed mission.

use std::fs::{self, File};
use std::os::unix::fs::OpenOptionsExt as _;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Signal, kill_process};

use crate::support::flight::{RING, RunningFlight};
use crate::support::{Place, output, signal_and_wait, until, until_exited};
use crate::{events, longer};

/// Kills workers at random instants while the run lasts, and returns the number of kills. Between two rounds of kills
/// the ring runs some slots, however long a restart takes on this machine.
fn kill_at_random(run: &mut RunningFlight, random: &mut ChaCha8Rng) -> u64 {
    let mut kills = 0;
    let pause = |random: &mut ChaCha8Rng| {
        std::thread::sleep(std::time::Duration::from_micros(random.random_range(0..60_000)));
    };
    while !run.has_ended() {
        pause(random);
        // Several at once, the same one twice, one that is just starting.
        for _ in 0..random.random_range(1..=4) {
            let role = RING[random.random_range(0..RING.len())];
            if let Some(worker) = run.worker_now(role) {
                kills += u64::from(kill_process(worker, Signal::KILL).is_ok());
            }
            pause(random);
        }
        let before = run.slots();
        until("flight", || (run.slots() > before || run.has_ended()).then_some(()));
    }
    kills
}

#[test]
fn kills_at_any_time_do_not_change_the_trace() {
    let place = Place::new();
    let mut kills = 0;
    let fleets = [(1, "independent"); 3].into_iter().chain([(2, "sequential"), (4, "partition"), (8, "sequential")]);
    for (seed, (strategy, (uavs, coordination))) in (1..).zip(["uts", "gfs", "rfs"].into_iter().cycle().zip(fleets)) {
        let out = format!("killed-by-seed-{seed}");
        let mut flight = longer(&place).strategy(strategy).out(&out).without_viewer();
        if uavs > 1 {
            flight = flight
                .set("slots", 2000)
                .set("uav.count", uavs)
                .set("uav.coordination", coordination)
                .set("uav.separation_m", 2);
        }
        let mut run = flight.start();
        kills += kill_at_random(&mut run, &mut ChaCha8Rng::seed_from_u64(seed));
        run.wait_for_success();
        place.assert_trace_as_simulated(&out);
        let [simulated, killed] = [format!("{out}-simulated"), out].map(|run| place.summary(&run));
        for key in ["trace_hash", "lost_bits", "delivered_bits", "queued_bits", "eta_letter", "mean_served", "complete"]
        {
            assert_eq!(simulated[key], killed[key], "seed {seed}: {key}");
        }
    }
    assert!(kills >= 80, "{kills} kills"); // usually more than a hundred
    place.assert_clean();
}

#[test]
fn processes_end_after_their_launcher_though_one_died_while_it_created_memory() {
    let place = Place::new();
    let run = place.flight("paced").without_viewer().pace("10x").start();
    run.until_slot(10);
    let others = ["field-sim", "planner"].map(|role| run.worker(role));
    let creator = run.worker("flight-sim");
    run.kill_launcher();
    kill_process(creator, Signal::KILL).unwrap();
    for path in place.shared_memory() {
        if path.extension().is_some_and(|extension| extension == "connection") {
            fs::remove_file(&path).unwrap();
            File::options().write(true).create_new(true).mode(0o200).open(&path).unwrap(); // its size is not set yet
        }
    }
    others.into_iter().for_each(until_exited);
}

#[test]
fn a_restarted_planner_restores_its_state() {
    let place = Place::new();
    let few = place
        .flight("long")
        .set("slots", 1500)
        .set("sensors.count", 30)
        .set("sensors.sampling_bps", "[50.0, 900.0]")
        .set("area.side_m", 300)
        .set("planner.horizon.iterations", 200)
        .force();
    let oracle = few.clone();
    let known = few.set("planner.knowledge", "estimated");
    let learnt = known.set("planner.rates", "learnt");
    let packets = learnt.set("sensors.arrivals.model", "poisson").set("sensors.arrivals.packet_bits", 300);
    let bursts = learnt.set("sensors.arrivals.model", "on-off");
    let stays = oracle.set("link.model", "probabilistic-los").set("link.los_correlation_m", 40.0);
    let hearing = stays.set("link.bandwidth_hz", 5e3).set("link.beacon_radius_m", 60.0);
    for (strategy, flight) in [
        ("horizon", &oracle),
        ("max-age-first", &oracle),
        ("tour", &oracle),
        ("uts", &known),
        ("exact", &learnt),
        ("horizon", &learnt),
        ("uts", &packets),
        ("horizon", &bursts),
        ("horizon", &hearing),
        ("uts", &hearing),
    ] {
        let run = flight.strategy(strategy).without_viewer().start();
        for kill in 1..=4 {
            run.until_slot(250 * kill);
            RING[kill % 3..].iter().for_each(|role| run.kill(role));
        }
        run.wait_for_success();
        place.assert_trace_as_simulated("run");
        // And after its launcher.
        place.cut_trace("run", 400);
        place.resume("run");
        place.assert_same_trace("run-simulated", "run");
    }
    place.assert_clean();
}

#[test]
fn killed_processes_recover_in_a_polling_ring() {
    let place = Place::new();
    let run = longer(&place).without_viewer().options(&["--wait", "poll"]).start();
    for role in RING {
        run.until_slots_later(20);
        run.kill(role);
    }
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert_eq!(place.summary("run")["restarts"], 3);
    place.assert_clean();
}

#[test]
fn every_restart_is_recorded() {
    let place = Place::new();
    let run = longer(&place).without_viewer().pace("1000x").start();
    for role in RING {
        run.until_slots_later(20);
        run.kill_and_await(role);
        run.until_slots_later(20);
    }
    let ended = run.wait_for_success();
    let summary = place.summary("run");
    assert_eq!(summary["restarts"], 3);
    let expected: Vec<_> = RING
        .iter()
        .flat_map(|role| [("was killed by signal 9", role), ("was restarted (restart 1)", role)])
        .map(|(event, role)| ((*role).to_owned(), event.to_owned()))
        .collect();
    // On a busy machine a plan or a flight is late, too.
    let is_restart = |event: &str| event.contains("killed") || event.contains("restarted");
    let restarts: Vec<_> = events(&place).into_iter().filter(|(_, event)| is_restart(event)).collect();
    assert_eq!(restarts, expected);
    for (process, event) in expected {
        assert!(ended.stderr.contains(&format!("{process} {event}")), "{ended:?}");
    }
    assert_eq!(summary["slots"], 9000);
    place.assert_clean();
}

#[test]
fn a_manually_started_process_can_be_restarted_by_hand() {
    let place = Place::new();
    let run = longer(&place).without_viewer().external("planner").start();
    for kill in 1..=3 {
        let planner = run.worker_command("planner").spawn().unwrap();
        run.until_slots_later(50);
        assert_eq!(signal_and_wait(Signal::KILL, planner).signal, Some(9), "kill {kill}");
    }
    output(run.worker_command("planner")).assert_success();
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    place.assert_clean();
}
