//! Missions for other objectives than the least loss, and with batteries of sensor nodes (decisions D33, D36 and D39),
//! in one process and in a ring.

use std::fs;

use crate::support::Place;
use crate::support::flight::RING;

#[test]
fn ring_and_single_process_lose_the_same_bits_by_expiry_through_kills_and_a_resumption() {
    let place = Place::new();
    for (objective, overflow) in [("\"expiry\"", "newest"), ("{ expiry = 1.0, age = 0.5 }", "oldest")] {
        let flight = place.flight("long").set("slots", 600).set("planner.objective", objective).force();
        let flight = flight.set("sensors.expiry_s", 8).set("sensors.overflow", overflow).strategy("horizon");
        let flight = flight.set("sensors.count", 30).set("sensors.sampling_bps", "[50.0, 900.0]");
        let run = flight.set("planner.horizon.iterations", 20).without_viewer().start();
        for slot in [100, 300] {
            run.until_slot(slot);
            RING.iter().for_each(|role| run.kill(role));
        }
        run.until_slot(400);
        run.terminate();
        place.resume("run");
        place.assert_trace_as_simulated("run");
        let [simulated, resumed] = ["run-simulated", "run"].map(|run| place.summary(run));
        assert!(simulated["expired_bits"].as_u64().unwrap() > 0, "{overflow}");
        for key in ["expired_bits", "lost_bits", "eta_letter"] {
            assert_eq!(simulated[key], resumed[key], "{overflow}: {key}");
        }
    }
    place.assert_clean();
}

#[test]
fn ring_and_single_process_agree_on_deaths_through_kills_and_a_resumption() {
    let place = Place::new();
    for (strategy, knowledge) in [("horizon", "oracle"), ("max-age-first", "estimated")] {
        let flight = place.flight("long").set("slots", 1100).force().strategy(strategy);
        let flight = flight.set("sensors.count", 30).set("sensors.sampling_bps", "[50.0, 900.0]");
        fs::write(place.path("harvest.csv"), "slot,sensor,harvest_w\n100,,0.004\n900,,0\n50,3,0.05\n").unwrap();
        let harvest = place.path("harvest.csv");
        let energy = "{ capacity_j = 20.0, sleep_w = 0.02, harvest_w = 0.001, wake_j = 0.5, harvest_file = ";
        let flight = flight.set("sensors.energy", format!("{energy}\"{}\" }}", harvest.display()));
        let flight = flight.set("link.duty_cycle", 2e-5).set("link.duty_window_s", 50.0);
        let flight = flight.set("planner.knowledge", format!("\"{knowledge}\""));
        let run = flight.set("planner.horizon.iterations", 20).without_viewer().start();
        for slot in [300, 700] {
            run.until_slot(slot);
            RING.iter().for_each(|role| run.kill(role));
        }
        run.until_slot(900);
        run.terminate();
        place.resume("run");
        place.assert_trace_as_simulated("run");
        let [simulated, resumed] = ["run-simulated", "run"].map(|run| place.summary(run));
        assert!(simulated["node_energy"]["dead"].as_u64().unwrap() > 0, "{strategy}: {simulated}");
        assert!(simulated["refused_duty"].is_u64(), "{simulated}");
        for key in ["node_energy", "refused_duty", "lost_bits", "eta_letter"] {
            assert_eq!(simulated[key], resumed[key], "{strategy}: {key}");
        }
    }
    place.assert_clean();
}
