//! What `skysink check` says of a mission, and that missions are as it says.

use crate::support::{Output, Place};

/// The paper's field with these keys, flown by `uts` unless they say otherwise.
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
fn check_shows_what_follows_from_the_letter() {
    let place = Place::new();
    let printed = checked(&place, "");
    let lines: Vec<String> =
        printed.stdout.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect();
    for line in [
        "# reach in a slot, V τ 30 m",
        "# anchor radius of uts, V τ − d_c 20 m, connects 200 of 200",
        "# visits to empty a full buffer 1 (at d_c 1)",
        "# slots to fill an empty buffer 300",
        "# offered load, N s τ 20 kbit per slot, 16.7 % of 4 visits",
        "# flight without loss yes: tour loses nothing",
    ] {
        assert!(lines.iter().any(|found| found == line), "{line:?} is missing in {}", printed.stdout);
    }
    assert_eq!(printed.stderr, "");
    assert_eq!(loss_rate(&place, "tour"), 0.0);
}

#[test]
fn the_figures_come_last_behind_the_keys() {
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
fn two_crowds_that_uts_cannot_leave_are_said() {
    let place = Place::new();
    let mut list = "x_m,y_m\n".to_owned();
    for id in 0..2_000 {
        let x_m = if id % 2 == 0 { 5.0 } else { 150.0 } + f64::from(id % 20) / 10.0;
        list += &format!("{x_m},{}\n", f64::from(id % 37) / 10.0);
    }
    place.write("crowds.csv", &list);
    let ended = checked(&place, "slots = 20\n[area]\nside_m = 200.0\n[sensors]\nfile = \"crowds.csv\"\n");
    assert!(ended.stdout.contains("20 m, connects 1000 of 2000"), "{}", ended.stdout);
    assert!(ended.stderr.contains("connect only 1000 of the 2000 sensor nodes"), "{ended:?}");
}

#[test]
fn the_figures_are_json_too() {
    let place = Place::new();
    place.write("a.toml", "name = \"a\"\n[area]\nside_m = 300.0\n");
    let ended = place.run_ok(&["check", "a.toml", "--json"]);
    let figures: serde_json::Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!(figures["anchor_radius_m"], 20.0);
    assert_eq!(figures["fill_slots"]["mean"], 300.0);
    assert_eq!(figures["loss_free"]["answer"], "flown");
    let warning = figures["warnings"][0].as_str().unwrap();
    assert_eq!(ended.stderr, "");
    let shown = place.run_ok(&["check", "a.toml"]);
    assert_eq!(shown.stderr, format!("skysink: warning: {warning}\n"));
}

#[test]
fn who_is_said_to_be_trapped_is_and_who_is_not_is_not() {
    let place = Place::new();
    let trapped = "is likely to be trapped";
    for (keys, strategy, is_trapped) in [
        ("[area]\nside_m = 100.0\n", "uts", false),
        ("[area]\nside_m = 150.0\n", "uts", false),
        ("[area]\nside_m = 200.0\n", "uts", true),
        ("[area]\nside_m = 300.0\n", "uts", true),
        ("[area]\nside_m = 300.0\n[uav]\nmax_speed_mps = 60.0\n", "uts", false),
        ("[area]\nside_m = 300.0\n", "uts-wide", false),
        ("[area]\nside_m = 400.0\n", "uts-wide", true),
        // V τ < 2 d_c: no anchor may be left in reach, and transit leads on.
        ("[uav]\nmax_speed_mps = 12.0\n", "uts", false),
    ] {
        let ended = checked(&place, &format!("{keys}[planner]\nstrategy = \"{strategy}\"\n"));
        assert_eq!(ended.stderr.contains(trapped), is_trapped, "{keys}: {ended:?}");
        let lost = loss_rate(&place, strategy);
        assert_eq!(lost > 0.05, is_trapped, "{keys} {strategy}: {lost}");
        assert_eq!(loss_rate(&place, "tour"), 0.0, "{keys}");
    }
}

#[test]
fn uts_is_in_transit_where_its_anchor_radius_is_none() {
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
fn a_load_beyond_the_radio_and_a_slow_one_are_said() {
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
fn a_mission_that_is_too_short_for_loss_or_for_the_field_is_said() {
    let place = Place::new();
    let short = checked(&place, "slots = 150\n");
    assert!(short.stderr.contains("no strategy loses data"), "{short:?}");
    assert_eq!(loss_rate(&place, "rfs"), 0.0);
    place.write("sensors.csv", "x_m,y_m\n500,500\n0,0\n");
    let far = checked(&place, "slots = 10\n[area]\nside_m = 1000.0\n[sensors]\nfile = \"sensors.csv\"\n");
    assert!(far.stderr.contains("1 of the 2 sensor nodes cannot be reached within the mission's 10 slots"), "{far:?}");
}
