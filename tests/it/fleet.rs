//! Several UAVs through the commands: a ring with deaths, a resumed run, a replay, exports and maps.

use crate::support::Place;

#[test]
fn a_fleet_with_estimated_queues_survives_the_death_of_every_process() {
    let place = Place::new();
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

/// Two bases with a pad each, of which the eastern swaps batteries.
const SITES: &str = "name = 'sites'\nslots = 240\n[area]\nside_m = 250.0\n[sensors]\ncount = 40\n\
    sampling_bps = [100.0, 900.0]\n[planner]\nhorizon.iterations = 20\n\
    [uav]\ncount = 3\nmust_land = true\ncoordination = 'sequential'\n[uav.battery]\ncapacity_j = 9000.0\n\
    [[base.site]]\nposition_m = [60, 125]\nradius_m = 10.0\ncharge_w = 400.0\npads = 1\n\
    [[base.site]]\narea_m = [[180, 115], [200, 115], [200, 135], [180, 135]]\nswap_s = 9.0\npads = 1\n";

#[test]
fn a_fleet_that_shares_pads_survives_deaths_and_is_resumed_replayed_and_mapped() {
    let place = Place::new();
    place.write("sites.toml", SITES);
    for strategy in ["horizon", "tour"] {
        let flight = place.flight("sites").strategy(strategy).force();
        flight.out("alone").simulate();
        let waited_s = |run: &str| place.summary(run)["energy"]["pad_wait_s"].as_f64().unwrap();
        assert!(waited_s("alone") > 0.0 && place.trace("alone").contains(",charge,1,"), "{strategy}");
        let running = flight.without_viewer().out("ring").start();
        for (slot, role) in [(60, "flight-sim"), (75, "planner"), (82, "flight-sim"), (95, "flight-sim")] {
            running.until_slot(slot);
            running.kill_and_await(role);
        }
        running.wait_for_success();
        place.assert_same_trace("alone", "ring");
        assert_eq!(waited_s("alone"), waited_s("ring"), "{strategy}");
    }
    let whole = place.trace("ring");
    std::fs::remove_file(place.path("ring/summary.json")).unwrap();
    place.cut_trace("ring", 3 * 150);
    place.resume("ring");
    assert_eq!(place.trace("ring"), whole);
    place.run_ok(&["replay", "alone", "--out", "again"]);
    place.run_ok(&["plot", "alone", "--out", "plots"]);
    let map = place.read("plots/map-alone.svg");
    assert!(["base 0: 1 pad", "base 1: 1 pad"].iter().all(|name| map.contains(name)));
    let checked = place.run_ok(&["check", "sites.toml"]).stdout;
    assert!(checked.contains("base.site[0], 55 m away, 1 pad"), "{checked}");
    place.assert_clean();
}

#[test]
fn a_run_of_a_fleet_is_replayed_exported_and_mapped() {
    let place = Place::new();
    place.flight("fleet").strategy("horizon").without_viewer().run();
    place.run_ok(&["replay", "run", "--out", "again"]);
    place.run_ok(&["export", "run", "--format", "csv"]);
    for format in ["qgc-plan", "geojson", "waypoints", "mcap"] {
        let out = format!("run.{format}");
        let has_endurance = ["qgc-plan", "waypoints"].contains(&format);
        let of_missions: &[&str] = if has_endurance { &["--ignore-endurance", "--stagger"] } else { &[] };
        let arguments = [&["export", "run", "--format", format, "--out", &out][..], of_missions].concat();
        let said = place.run_ok(&arguments).stdout;
        for uav in 0..3 {
            let file = format!("run-uav-{uav}.{format}");
            assert!(said.contains(&file) && std::fs::metadata(place.path(&file)).unwrap().len() > 100, "{said}");
        }
    }
    place.run_ok(&["plot", "run", "--out", "plots"]);
    let map = place.read("plots/map-run.svg");
    assert!(["path of UAV 0", "path of UAV 2"].iter().all(|path| map.contains(path)));
    let report = place.run_ok(&["report", "run"]).stdout;
    assert!(report.contains("UAVs") && report.contains("least distance of two UAVs"), "{report}");
}

/// UAVs at rest whose plans still fly the end of a move.
#[test]
fn a_fleet_with_limited_endurances_is_replayed() {
    let place = Place::new();
    place.write(
        "rest.toml",
        "name = 'rest'\nslots = 90\n[area]\nside_m = 1000.0\n[sensors]\ncount = 50\n[uav]\ncount = 4\n\
         coordination = 'partition'\nseparation_m = 5.0\nmoves = 'grid'\ncell_m = 100.0\nmust_land = true\n\
         endurances_s = [45.0, 53.0, 45.0, 53.0]\n[uav.battery]\ncapacity_j = 26200.0\n[base]\nareas_m = \
         [[[170, 70], [330, 70], [330, 230], [170, 230]], [[70, 270], [230, 270], [230, 430], [70, 430]]]\n",
    );
    place.flight("rest").out("alone").simulate();
    place.run_ok(&["report", "alone"]);
    let replayed = place.run_ok(&["replay", "alone", "--out", "again"]).stdout;
    assert!(replayed.contains("equal to the recorded decision in 90 of 90 slots"), "{replayed}");
    assert_eq!(place.summary("alone")["refused"], 0, "told to fly on, they rest");
}

/// A slow UAV, two with batteries and drones by name, and one that lands early.
const MIXED: &str = "name = 'mixed'\nslots = 240\n[area]\nside_m = 250.0\n[sensors]\ncount = 40\n\
    sampling_bps = [100.0, 900.0]\n[planner]\nhorizon.iterations = 20\n[base]\nradius_m = 10.0\ncharge_w = 400.0\n\
    [uav]\nmust_land = true\nseparation_m = 2.0\n[[uav.each]]\nmax_speed_mps = 6.0\naltitude_m = 40.0\n[[uav.each]]\n\
    preset = 'x500'\nacceleration_mps2 = 20.0\ncount = 2\nbattery.capacity_j = 40e3\n[[uav.each]]\nresource_blocks = 1\n\
    endurance_s = 150.0\n";

#[test]
fn a_fleet_of_uavs_that_differ_survives_deaths_and_is_resumed_replayed_and_exported() {
    let place = Place::new();
    place.write("mixed.toml", MIXED);
    for (strategy, coordination) in [("horizon", "sequential"), ("tour", "partition")] {
        let flight = place.flight("mixed").strategy(strategy).set("uav.coordination", coordination).force();
        flight.out("alone").simulate();
        let running = flight.without_viewer().out("ring").start();
        for (slot, role) in [(60, "flight-sim"), (75, "planner"), (82, "flight-sim"), (95, "field-sim")] {
            running.until_slot(slot);
            running.kill_and_await(role);
        }
        running.wait_for_success();
        place.assert_same_trace("alone", "ring");
        assert_eq!(place.reproducible_summary("alone")["energy"], place.reproducible_summary("ring")["energy"]);
    }
    let whole = place.trace("ring");
    assert!(place.summary("ring")["landed"] == true, "{}", place.summary("ring"));
    std::fs::remove_file(place.path("ring/summary.json")).unwrap();
    place.cut_trace("ring", 4 * 150);
    place.resume("ring");
    assert_eq!(place.trace("ring"), whole);
    place.run_ok(&["replay", "alone", "--out", "again"]);
    let said = place.run_ok(&["export", "ring", "--format", "csv", "--origin", "47,8", "--north", "true"]).stdout;
    assert!((0..4).all(|uav| said.contains(&format!("ring-uav-{uav}.csv"))), "{said}");
    let checked = place.run_ok(&["check", "mixed.toml"]).stdout;
    for expected in
        ["uav.each[1], x500", "2 at 20 m (n = 4)", "1 at 20 m (n = 1): uav.each[2]", "1 at 40 m (n = 4): uav.each[0]"]
    {
        assert!(checked.contains(expected), "{expected}: {checked}");
    }
    place.assert_clean();
}

#[test]
fn tables_that_repeat_that_of_all_leave_the_files_of_as_many_equal_uavs() {
    let place = Place::new();
    let each = "uav.each=[{count=2},{max_speed_mps=30.0}]";
    for (strategy, how) in [("horizon", "sequential"), ("uts", "partition")] {
        let flight = place.flight("smoke").strategy(strategy).set("slots", 40).set("uav.coordination", how).force();
        flight.set("uav.count", 3).out("counted").simulate();
        flight.settings(each).out("alone").simulate();
        flight.settings(each).without_viewer().out("ring").run();
        for run in ["alone", "ring"] {
            assert_eq!(place.trace("counted"), place.trace(run), "{strategy}: {run}");
            assert_eq!(place.reproducible_summary("counted"), place.reproducible_summary(run), "{strategy}: {run}");
        }
    }
    let whole = place.trace("ring");
    std::fs::remove_file(place.path("ring/summary.json")).unwrap();
    place.cut_trace("ring", 3 * 20);
    place.resume("ring");
    assert_eq!(place.trace("ring"), whole);
    place.run_ok(&["replay", "ring", "--out", "again"]);
    place.assert_clean();
}
