//! Several UAVs through the commands: the ring, a resumed run, a replay, exports and maps.

use crate::support::Place;

const FLEET: &str = "name = 'fleet'\nslots = 60\n[area]\nside_m = 250.0\norigin_lat_deg = 47.0\norigin_lon_deg = 8.0\n\
    [sensors]\ncount = 60\nsampling_bps = [100.0, 900.0]\n[planner]\nhorizon.iterations = 60\n\
    [uav]\ncount = 3\nposition_error_m = 0.5\nseparation_m = 5.0\nstarts_m = [[20, 30], [220, 100], [125, 200]]\n";

fn place() -> Place {
    let place = Place::new();
    place.write("fleet.toml", FLEET);
    place
}

#[test]
fn processes_and_one_process_fly_the_same_fleet() {
    let place = place();
    for (strategy, coordination) in
        [("uts", "independent"), ("horizon", "sequential"), ("edf", "sequential"), ("tour", "partition")]
    {
        let flight = place.flight("fleet").strategy(strategy).set("uav.coordination", coordination).force();
        flight.out("alone").simulate();
        let flight = if strategy == "tour" { flight } else { flight.without_viewer() };
        flight.out("ring").run();
        assert_eq!(place.trace("alone"), place.trace("ring"), "{strategy}");
        assert_eq!(place.trace("ring").lines().count(), 1 + 60 * 3);
        assert_eq!(place.reproducible_summary("alone"), place.reproducible_summary("ring"), "{strategy}");
        let fleet = &place.summary("ring")["fleet"];
        assert_eq!(fleet["uavs"], 3);
        assert!(fleet["min_separation_m"].as_f64().unwrap() > 0.0, "{fleet}");
    }
    place.assert_clean();
}

#[test]
fn a_fleet_with_estimated_queues_survives_the_death_of_every_process() {
    let place = place();
    for coordination in ["sequential", "partition"] {
        let flight = place.flight("fleet").strategy("horizon").set("slots", 300).set("planner.knowledge", "estimated");
        let flight = flight.set("uav.coordination", coordination).set("planner.horizon.iterations", 20).force();
        flight.out("alone").simulate();
        let running = flight.without_viewer().out("ring").start();
        for (slot, role) in [(20, "planner"), (60, "flight-sim"), (100, "field-sim"), (140, "planner")] {
            running.until_slot(slot);
            running.kill_and_await(role);
        }
        running.wait_for_success();
        assert_eq!(place.trace("alone"), place.trace("ring"), "{coordination}");
    }
    place.assert_clean();
}

#[test]
fn a_run_of_a_fleet_is_resumed_replayed_exported_and_mapped() {
    let place = place();
    place.flight("fleet").strategy("horizon").out("whole").simulate();
    place.flight("fleet").strategy("horizon").without_viewer().run();
    place.assert_same_trace("whole", "run");
    place.run_ok(&["replay", "run", "--out", "again"]);
    for format in ["csv", "parquet"] {
        place.run_ok(&["export", "run", "--format", format]);
    }
    for format in ["qgc-plan", "kml", "gpx", "geojson", "waypoints", "mcap"] {
        let said = place.run_ok(&["export", "run", "--format", format, "--out", &format!("run.{format}")]).stdout;
        for uav in 0..3 {
            let file = format!("run-uav-{uav}.{format}");
            assert!(said.contains(&file) && std::fs::metadata(place.path(&file)).unwrap().len() > 100, "{said}");
        }
    }
    place.run_ok(&["plot", "run", "--out", "plots"]);
    place.run_ok(&["report", "run"]);
}
