//! `skysink check`: its figures and warnings, compared with simulated missions.

use crate::support::{Output, Place};

/// Checks the paper's mission with these keys; the strategy is `uts` unless they set another.
fn checked(place: &Place, keys: &str) -> Output {
    place.write("a.toml", &format!("name = \"a\"\n{keys}"));
    place.run_ok(&["check", "a.toml"])
}

/// What a strategy loses in the mission checked last, as a fraction.
fn loss_rate(place: &Place, strategy: &str) -> f64 {
    place.flight("a").strategy(strategy).force().simulate();
    place.summary("run")["loss_rate"].as_f64().unwrap()
}

#[test]
fn check_shows_the_derived_figures_of_the_paper() {
    let place = Place::new();
    let printed = checked(&place, "");
    let lines: Vec<String> =
        printed.stdout.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect();
    for line in [
        "# reach in a slot, V τ 30 m",
        "# anchor radius of uts, V τ − d_c 20 m",
        "# visits to empty a full buffer 1 (at d_c 1)",
        "# slots to fill an empty buffer 300",
        "# offered load, N s τ 20 kbit per slot, 16.7 % of 4 visits",
        "# flight without loss yes: tour loses nothing",
    ] {
        assert!(lines.iter().any(|found| found == line), "{line:?} is missing in {}", printed.stdout);
    }
    assert_eq!(printed.stderr.lines().count(), 1, "{}", printed.stderr);
    assert!(
        printed.stderr.contains("no copter flies V τ from rest to rest in a slot: that takes 120 m/s²"),
        "{printed:?}"
    );
    assert_eq!(loss_rate(&place, "tour"), 0.0);
}

#[test]
fn the_figures_follow_the_keys() {
    let place = Place::new();
    let printed = checked(&place, "").stdout;
    let lines: Vec<&str> = printed.lines().collect();
    let figures = lines.iter().position(|line| line.starts_with("# a.toml: 200 sensor nodes")).unwrap();
    assert!(lines[figures..].iter().all(|line| line.starts_with('#')), "{printed}");
    assert!(lines[..figures].iter().all(|line| !line.starts_with('#')), "{printed}");
    assert!(lines.len() - figures < 20, "they fit on a screen: {printed}");
    assert!(lines.last().unwrap().contains("flight without loss"), "{printed}");
}

#[test]
fn the_figures_are_available_as_json() {
    let place = Place::new();
    place.write("a.toml", "name = \"a\"\nslots = 150\n[uav]\nacceleration_mps2 = 100.0\n");
    let ended = place.run_ok(&["check", "a.toml", "--json"]);
    let figures: serde_json::Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!((&figures["reach_m"], &figures["anchor_radius_m"]), (&21.0.into(), &11.0.into())); // 30 · (1 − 0.3)
    assert_eq!(figures["motion"]["demanded_mps2"], serde_json::Value::Null);
    assert_eq!(figures["fill_slots"]["mean"], 300.0);
    assert_eq!(figures["loss_free"]["answer"], "unserved");
    let warning = figures["warnings"][0].as_str().unwrap();
    assert_eq!(ended.stderr, "");
    let shown = place.run_ok(&["check", "a.toml"]);
    assert_eq!(shown.stderr, format!("skysink: warning: {warning}\n"));
}

#[test]
fn the_objective_is_collect_where_nothing_is_sampled() {
    let place = Place::new();
    place.write("a.toml", "name = \"a\"\nslots = 50\n[sensors]\nsampling_bps = 0.0\n");
    let ended = place.run_ok(&["check", "a.toml"]);
    assert!(ended.stderr.contains("no sensor node samples") && ended.stderr.contains("objective"), "{}", ended.stderr);
    assert!(!ended.stdout.contains("most data delivered"), "{}", ended.stdout);
    let collecting = place.run_ok(&["check", "a.toml", "--set", "planner.objective=collect"]);
    assert!(!collecting.stderr.contains("loses data"), "{}", collecting.stderr);
    assert!(collecting.stdout.contains("the most data delivered until the end"), "{}", collecting.stdout);
    let refused = place.run(&["optimize", "a.toml", "--steps", "10", "--set", "planner.objective=collect"]);
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("planner.objective=collect: expected \"loss\""), "{}", refused.stderr);
}

#[test]
fn uts_is_in_transit_where_its_anchor_radius_is_not_positive() {
    let place = Place::new();
    for (speed_mps, is_said) in [(8.0, true), (10.0, true), (20.0, false)] {
        let ended = checked(&place, &format!("[uav]\nmax_speed_mps = {speed_mps:?}\n"));
        assert_eq!(ended.stderr.contains("mostly fly in transit"), is_said, "{ended:?}");
        loss_rate(&place, "uts");
        let transit = place.summary("run")["transit_slots"].as_u64().unwrap();
        assert_eq!(transit > 300, is_said, "{transit} of 600 at {speed_mps} m/s");
    }
}

#[test]
fn check_warns_of_a_load_beyond_the_radio_and_of_slow_links() {
    let place = Place::new();
    let over = checked(&place, "[sensors]\nsampling_bps = 700.0\n");
    assert!(
        over.stderr.contains(
            "the load is 117 % of the maximum that 4 visits collect (140 kbit of 120 kbit per slot, limited by the buffer size)"
        ),
        "{over:?}"
    );
    assert!(over.stdout.contains("no: every flight loses at least"), "{over:?}");
    for strategy in ["tour", "exact", "uts-wide", "edf"] {
        assert!(loss_rate(&place, strategy) > 0.1, "{strategy}");
    }
    let slow = checked(&place, "[link]\nbandwidth_hz = 5e3\n");
    assert!(slow.stderr.contains("a full buffer takes 5 or more visits"), "{slow:?}");
    let dead = checked(&place, "[link]\nbandwidth_hz = 1e-3\n");
    assert!(dead.stderr.contains("nothing will be delivered"), "{dead:?}");
    loss_rate(&place, "uts");
    assert_eq!(place.summary("run")["delivered_bits"], 0);
}

#[test]
fn check_warns_of_missions_too_short_for_loss_or_for_the_field() {
    let place = Place::new();
    let short = checked(&place, "slots = 150\n");
    assert!(short.stderr.contains("no strategy loses data"), "{short:?}");
    assert_eq!(loss_rate(&place, "rfs"), 0.0);
    place.write("sensors.csv", "x_m,y_m\n500,500\n0,0\n");
    let far = checked(&place, "slots = 10\n[area]\nside_m = 1000.0\n[sensors]\nfile = \"sensors.csv\"\n");
    assert!(far.stderr.contains("1 of the 2 sensor nodes cannot be reached within the mission's 10 slots"), "{far:?}");
}

#[test]
fn check_shows_the_effects_of_wind_errors_and_acceleration() {
    let place = Place::new();
    let keys = "[uav]\nwind_mps = [3.0, 4.0]\nposition_error_m = 3.0\nacceleration_mps2 = 50.0\n";
    let printed = checked(&place, keys);
    let lines: Vec<String> =
        printed.stdout.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect();
    for line in [
        "# reach in a slot 12.5 m", // 50 m/s² · 1 s²/4; 25 m/s take 0.5 s
        "# ground speed 25 m/s upwind, 35 m/s downwind",
        "# anchor radius of uts, reach − d_c 2.5 m",
        "wind_mps = [3.0, 4.0]",
    ] {
        assert!(lines.iter().any(|found| found == line), "{line:?} is missing in {}", printed.stdout);
    }
    assert_eq!(printed.stderr, "");
    for line in printed.stdout.lines().filter(|line| line.starts_with("# ")) {
        assert!(line.chars().count() <= 80, "{line}");
    }
}
