//! Fleets whose UAVs differ: the table of a UAV over `[uav]`, before either is read.

use std::path::Path;

use skysink_common::battery::Battery;
use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario, Setting};

fn set(text: &str, settings: &[&str]) -> Result<Scenario, InputError> {
    let keys: Vec<Setting> = settings.iter().map(|setting| setting.parse().unwrap()).collect();
    let text = format!("name = 'fleet'\n{text}");
    Scenario::parse(&text, Path::new("fleet.toml"), Overrides { keys, ..Overrides::default() })
}

fn parse(text: &str) -> Scenario {
    set(text, &[]).unwrap()
}

fn refusal(text: &str) -> String {
    set(text, &[]).unwrap_err().to_string()
}

/// A scenario of one UAV with these keys of `[uav]`.
fn alone(uav: &str) -> Scenario {
    parse(&format!("[uav]\n{uav}"))
}

/// Two kinds, three UAVs: an X500 at 30 m of which there are two, and an M350 at 60 m with two blocks.
const TWO_KINDS: &str = "slots = 300\n[uav]\nstart_m = [10, 20]\nmust_land = true\nbattery.initial = 0.5\n[[uav.each]]\n\
                         preset = 'x500'\ncount = 2\naltitude_m = 30\n[[uav.each]]\npreset = 'm350'\n\
                         altitude_m = 60.0\nresource_blocks = 2\nstart_m = [50, 60]\nbattery.reserve = 0.3\n";

#[test]
fn the_keys_of_a_uav_are_those_of_one_with_its_table_over_that_of_all() {
    let fleet = parse(TWO_KINDS);
    let all = "start_m = [10, 20]\nmust_land = true\nbattery.initial = 0.5\n";
    let x500 = alone(&format!("{all}preset = 'x500'\naltitude_m = 30\n"));
    let m350 = "start_m = [50, 60]\nmust_land = true\npreset = 'm350'\naltitude_m = 60.0\n";
    let m350 = alone(&format!("{m350}battery.initial = 0.5\nbattery.reserve = 0.3\n"));
    assert_eq!((fleet.uav.uavs(), fleet.kinds().count()), (3, 2));
    for (uav, expected, blocks) in [(0, &x500, 4), (1, &x500, 4), (2, &m350, 2)] {
        let own = fleet.of_uav(uav);
        assert_eq!(own.uav, expected.uav, "UAV {uav}");
        assert_eq!(own.start(), expected.start());
        assert_eq!((own.link.resource_blocks, own.reach_m()), (blocks, expected.reach_m()));
        assert_eq!(Battery::of(&own), Battery::of(expected));
        assert_eq!(fleet.start_of(uav), expected.start());
    }
    assert_eq!(
        (fleet.kind_name(0).unwrap(), fleet.kind_name(1).unwrap()),
        ("uav.each[0], x500".to_owned(), "uav.each[1], m350".to_owned())
    );
    // The base is where the first UAV starts, with whichever keys another has it.
    assert_eq!(fleet.of_uav(2).base, fleet.of_uav(0).base);
    assert_eq!(fleet.base.as_ref().unwrap().position_m, Some([10.0, 20.0]));
    let late = parse("[[uav.each]]\nstart_m = [5, 5]\n[[uav.each]]\nstart_m = [9, 9]\nbattery.capacity_j = 1e5\n");
    assert_eq!(late.base.as_ref().unwrap().position_m, Some([5.0, 5.0]));
    assert_eq!([0, 1].map(|uav| Battery::of(&late.of_uav(uav)).capacity_j), [f64::INFINITY, 1e5]);
}

#[test]
fn the_preset_of_a_uav_replaces_the_keys_of_all_that_it_has() {
    let fleet = parse(
        "slots = 60\n[uav]\npreset = 'm350'\nmax_speed_mps = 9.0\n[[uav.each]]\n[[uav.each]]\npreset = 'x500'\n\
                       [[uav.each]]\npreset = 'x500'\nmax_speed_mps = 5.0\n",
    );
    let speeds_mps = [0, 1, 2].map(|uav| fleet.uav_of(uav).max_speed_mps);
    assert_eq!(speeds_mps, [9.0, 8.0, 5.0]);
    assert_eq!(fleet.of_uav(1).uav.battery, alone("preset = 'x500'\n").uav.battery);
}

#[test]
fn what_is_written_reads_back_as_the_same_fleet() {
    let free = "slots = 60\n[link]\nmodel = 'probabilistic-los'\n[uav]\naltitude_m = 40.0\n[[uav.each]]\naltitude = 'free'\n\
                [[uav.each]]\nmax_climb_mps = 2.0\n";
    let starts = "slots = 60\n[uav]\nstarts_m = [[1, 2], [3, 4], [5, 6]]\nmust_land = true\n\
                  endurances_s = [60.0, 50.0, 40.0]\n[[uav.each]]\ncount = 2\nmax_speed_mps = 9.0\n[[uav.each]]\n";
    let radio = "slots = 60\nslot_s = 10.0\n[link]\npreset = 'lora-sf7'\ncomm_s = 5.0\n[uav]\naltitude_m = 60.0\n[[uav.each]]\n[[uav.each]]\naltitude_m = 90.0\n";
    for text in [TWO_KINDS, free, starts, radio] {
        let fleet = parse(text);
        let again = parse(&fleet.to_toml().replace("name = \"fleet\"\n", ""));
        assert_eq!(again.to_toml(), fleet.to_toml());
        assert!((0..fleet.uav.uavs()).all(|uav| again.of_uav(uav).uav == fleet.of_uav(uav).uav));
        assert_eq!(again.hash(), fleet.hash());
        let listed = fleet.to_toml_with_list("list.csv");
        assert!(!listed.contains("preset ="), "{listed}");
        if fleet.link.table.is_none() {
            let flown = parse(&listed.replace("name = \"fleet\"\n", ""));
            for uav in 0..fleet.uav.uavs() {
                let [mut flown, mut own] = [flown.of_uav(uav), fleet.of_uav(uav)].map(|one| one.uav);
                [flown.preset, own.preset] = [None, None];
                assert_eq!(flown, own);
            }
            assert_eq!(flown.hash(), fleet.hash());
        }
    }
}

#[test]
fn lists_of_the_whole_fleet_are_by_the_numbers_of_the_uavs() {
    let fleet = parse(
        "slots = 60\n[uav]\nstarts_m = [[1, 2], [3, 4], [5, 6]]\nmust_land = true\nendurances_s = [60.0, 50.0, 40.0]\n\
         [[uav.each]]\ncount = 2\n[[uav.each]]\naltitude_m = 30.0\n",
    );
    let starts: Vec<[f64; 3]> = fleet.starts().map(Into::into).collect();
    assert_eq!(starts, [[1.0, 2.0, 20.0], [3.0, 4.0, 20.0], [5.0, 6.0, 30.0]]);
    assert_eq!([0, 1, 2].map(|uav| fleet.slots_of(uav)), [60, 50, 40]);
    assert_eq!([0, 1, 2].map(|uav| fleet.of_uav(uav).start()), [0, 1, 2].map(|uav| fleet.start_of(uav)));
}

#[test]
fn a_uav_that_must_land_flies_as_long_as_its_own_endurance() {
    let text = "slots = 60\n[uav]\nmust_land = true\n[[uav.each]]\nendurance_s = 30.0\n[[uav.each]]\n";
    let fleet = parse(text);
    assert_eq!([0, 1].map(|uav| fleet.slots_of(uav)), [30, 60]);
    assert_eq!([0, 1].map(|uav| fleet.endurance_s_of(uav)), [Some(30.0), None]);
    let longer = Overrides { slots: Some(900), ..Overrides::default() };
    let longer = Scenario::parse(&format!("name = 'a'\n{text}"), Path::new("a.toml"), longer).unwrap();
    assert_eq!([0, 1].map(|uav| longer.slots_of(uav)), [30, 900]);
    let refused = refusal(&text.replace("must_land = true\n", ""));
    assert!(refused.contains("uav.each[0].endurance_s = 30.0: expected at least the flight's 60 s"), "{refused}");
}

#[test]
fn one_radio_has_the_rates_of_all_altitudes() {
    let text = "slots = 60\nslot_s = 10.0\n[link]\npreset = 'lora-sf7'\ncomm_s = 5.0\n[uav]\n";
    let [low, both] = ["altitude_m = 60.0\n", "[[uav.each]]\naltitude_m = 90.0\n[[uav.each]]\naltitude_m = 60.0\n"]
        .map(|uav| parse(&format!("{text}{uav}")));
    assert_eq!(both.link.table.as_ref().unwrap().axes()[1], [60.0, 90.0]);
    assert_eq!(both.link.comm_radius_m, low.link.comm_radius_m);
}

#[test]
fn settings_replace_keys_of_all_and_the_list_itself() {
    let text = "[[uav.each]]\nmax_speed_mps = 9.0\n[[uav.each]]\n";
    let fleet = set(text, &["uav.max_speed_mps=7"]).unwrap();
    assert_eq!([0, 1].map(|uav| fleet.uav_of(uav).max_speed_mps), [9.0, 7.0]);
    let equal = set(text, &["uav.count=3"]).unwrap();
    assert_eq!((equal.uav.uavs(), equal.kinds().count(), equal.fleet.is_none()), (3, 1, true));
    let listed = set("[uav]\ncount = 3\n", &["uav.each=[{max_speed_mps = 5.0}, {}]"]).unwrap();
    assert_eq!([0, 1].map(|uav| listed.uav_of(uav).max_speed_mps), [5.0, 30.0]);
    let refused = set(text, &["uav.each=[{max_speed_mps = -5.0}]"]).unwrap_err().to_string();
    assert!(
        refused.starts_with("--set uav.each=") && refused.contains("uav.each[0].max_speed_mps = -5.0"),
        "{refused}"
    );
}

#[test]
fn refusals_name_the_table_of_the_uav() {
    let three = |own: &str| refusal(&format!("slots = 60\n[[uav.each]]\n[[uav.each]]\n[[uav.each]]\n{own}"));
    for (own, expected) in [
        ("max_speed_mps = 0.0\n", "uav.each[2].max_speed_mps = 0.0: expected a finite number above 0"),
        ("wind_mps = [30, 0]\n", "uav.each[2].wind_mps = [30, 0]: expected [x, y], a wind slower"),
        ("preset = 'x5000'\n", "uav.each[2].preset = \"x5000\": expected one of"),
        ("count = 0\n", "uav.each[2].count = 0: expected 1 to 64"),
        ("count = 63\n", "uav.each = \"65 UAVs\": expected at most 64"),
        (
            "coordination = 'sequential'\n",
            "uav.each[2].coordination = \"sequential\": expected it in [uav], for all UAVs",
        ),
        ("cell_m = 9.0\n", "uav.each[2].cell_m = 9.0: expected it in [uav]"),
        ("each = []\n", "uav.each[2].each = []: expected it in [uav]"),
        ("resource_blocks = 65\n", "uav.each[2].resource_blocks = 65: expected 1 to 64"),
        ("start_m = [101, 0]\n", "uav.each[2].start_m = [101, 0]: expected a position in the area"),
        ("battery = 5\n", "uav.each[2].battery = 5: expected a table"),
        ("battery.reserve = 0.5\n", "uav.each[2].battery: missing `capacity_j`"),
        ("altitude = 'free'\n", "uav.each[2].altitude = \"free\": expected \"fixed\", or"),
        ("endurance_s = 50.0\n", "uav.each[2].endurance_s = 50.0: expected at least the flight's 60 s"),
        ("speed = 5\n", "uav.each[2].speed = 5: expected one of `preset`"),
    ] {
        let refused = three(own);
        assert!(refused.starts_with(&format!("scenario fleet.toml: {expected}")), "{refused}");
        assert!(!refused.contains('\n'), "{refused}");
    }
    for (text, expected) in [
        ("[uav]\ncount = 2\n[[uav.each]]\n", "uav.count = 2: expected either [[uav.each]], or count"),
        ("[uav]\neach = []\n", "uav.each = []: expected a list of tables, [[uav.each]]"),
        ("[uav]\neach = 3\n", "uav.each = 3: expected a list of tables"),
        ("[uav]\neach = [{}, 3]\n", "uav.each = [{}, 3]: expected a list of tables"),
        (
            "[uav]\nstarts_m = [[1, 2]]\n[[uav.each]]\n[[uav.each]]\n",
            "uav.starts_m = [[1, 2]]: expected 2 positions in",
        ),
        (
            "[uav]\nmust_land = true\nendurances_s = [50.0]\n[[uav.each]]\n[[uav.each]]\n",
            "uav.endurances_s = [50.0]: expected 2 times of at least a slot",
        ),
        (
            "[uav]\nmax_speed_mps = -1.0\n[[uav.each]]\n",
            "uav.max_speed_mps = -1.0: expected a finite number above 0 (for uav",
        ),
        (
            "[uav]\nwind_mps = [6, 0]\n[[uav.each]]\n[[uav.each]]\nmax_speed_mps = 5.0\n",
            "uav.wind_mps = [6, 0]: expected [x, y], a wind slower than uav.max_speed_mps = 5 m/s (for uav.each[1])",
        ),
        (
            "[link]\nmodel = 'buildings'\n[sensors]\nheight_m = 25.0\n[[uav.each]]\naltitude_m = 30.0\n[[uav.each]]\n",
            "sensors.height_m = 25.0: expected a height from 0, below uav.altitude_m",
        ),
    ] {
        let refused = refusal(text);
        assert!(refused.starts_with(&format!("scenario fleet.toml: {expected}")), "{refused}");
    }
}

#[test]
fn a_building_is_in_the_way_of_the_uavs_that_fly_below_its_roof() {
    let text = "[area]\nbuilding = [{ polygon_m = [[40, 0], [60, 0], [60, 100], [40, 100]], height_m = 30.0 }]\n[uav]\n\
                start_m = [10, 10]\n[[uav.each]]\naltitude_m = 50.0\n[[uav.each]]\n";
    let fleet = parse(text);
    let ends = [[10.0, 10.0].into(), [90.0, 10.0].into()];
    let is_free = |uav: usize| fleet.of_uav(uav).airspace_without_ways().is_free(&ends[0], &ends[1]);
    assert_eq!([0, 1].map(is_free), [true, false]);
    // Over the building, and in it.
    let over = text.replace("altitude_m = 50.0\n", "altitude_m = 50.0\nstart_m = [50, 50]\n");
    assert_eq!(parse(&over).start_of(0).x, 50.0);
    let inside = refusal(&(text.to_owned() + "start_m = [50, 50]\n"));
    assert!(inside.contains("uav.each[1].start_m = "), "{inside}");
}
