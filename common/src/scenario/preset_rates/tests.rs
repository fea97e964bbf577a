//! Presets against the rows by hand, and as keys of scenarios.

use std::path::Path;

use super::*;
use crate::channel::{Channel, ChannelModel};
use crate::keys::Accepts;
use crate::presets::drones::DRONES;
use crate::presets::radios::{self, Radio};
use crate::propulsion::power_w;
use crate::scenario::Overrides;

const LOSS: PathLoss = PathLoss { exponent: 2.5, margin_db: 15.0, sigma_db: 0.0 };

fn parsed(keys: &str, overrides: Overrides) -> Result<Scenario, String> {
    // The paper's slots are too short to set up a contact of most radios.
    let setup = if keys.contains("link.preset = ") { "link.setup_s = 0.05\n" } else { "" };
    let text = format!("name = 'a'\n{setup}{keys}");
    Scenario::parse(&text, Path::new("a.toml"), overrides).map_err(|error| error.to_string())
}

fn scenario(keys: &str) -> Scenario {
    parsed(keys, Overrides::default()).unwrap()
}

fn radio(name: &str) -> &'static Radio {
    RADIOS.iter().find(|radio| radio.name == name).unwrap()
}

#[test]
fn the_steps_of_each_radio_end_where_the_budget_does() {
    // 10^((P_tx − L1 − 15 − sensitivity)/10n) of the lowest and the highest rate; by hand, n = 2.5 and n = 2.
    // lora-sf7: 14 − 31.2 − 15 + 124 = 91.8 dB, 10^3.672 = 4699 m. 802154: 8 − 40.2 − 15 + 100 = 52.8 dB, 10^2.112 =
    // 129 m.
    for (name, lowest_m, highest_m, free_space_m) in [
        ("lora-sf7", 4699.0, 4699.0, 38_905.0),
        ("lora-sf8", 6194.0, 6194.0, 54_954.0),
        ("lora-sf9", 8166.0, 8166.0, 77_625.0),
        ("lora-sf10", 10_765.0, 10_765.0, 109_648.0),
        ("lora-sf11", 12_942.0, 12_942.0, 138_038.0),
        ("lora-sf12", 15_560.0, 15_560.0, 173_780.0),
        ("802154", 129.4, 129.4, 436.5),
        ("ble-1m", 81.7, 81.7, 245.5),
        ("ble-coded", 170.6, 170.6, 616.6),
        ("halow-1mhz", 428.5, 61.9, 1949.8),
        ("wifi-n20", 47.0, 8.954, 123.0),
        ("lte-1.4", 4729.0, 315.4, 39_220.0),
    ] {
        let radio = radio(name);
        let [low, high] = [radio.steps[0], radio.steps[radio.steps.len() - 1]];
        let free_space = PathLoss { exponent: 2.0, ..LOSS };
        for (found_m, expected_m) in [
            (radio.range_m(&LOSS, &low), lowest_m),
            (radio.range_m(&LOSS, &high), highest_m),
            (radio.range_m(&free_space, &low), free_space_m),
        ] {
            assert!((found_m / expected_m - 1.0).abs() < 5e-3, "{name}: {found_m} m, by hand {expected_m} m");
        }
        assert!(radio.steps.is_sorted_by(|a, b| a.sensitivity_dbm < b.sensitivity_dbm && a.rate_bps < b.rate_bps));
    }
    assert_eq!(radios::NAMES.len(), 12);
}

#[test]
fn the_rate_falls_by_a_step_within_a_millimetre_and_is_0_beyond_the_radius() {
    for name in radios::NAMES {
        let scenario = scenario(&format!("uav.altitude_m = 5.0\nlink.preset = '{name}'\n"));
        let channel = Channel::of(&scenario.link);
        let rate_bps = |d_m: f64| channel.expected_rate_bps(&channel.uplink_at(1.0, d_m * d_m, 5.0));
        let mut beyond_bps = 0.0;
        for step in radio(name).steps {
            let end_m = (radio(name).range_m(&LOSS, step).powi(2) - 25.0).sqrt();
            assert_eq!((rate_bps(end_m - 2e-3), rate_bps(end_m + 2e-3)), (step.rate_bps, beyond_bps), "{name}");
            beyond_bps = step.rate_bps;
        }
        let radius_m = scenario.link.comm_radius_m;
        assert_eq!((rate_bps(radius_m), rate_bps(radius_m + 1.0)), (radio(name).steps[0].rate_bps, 0.0), "{name}");
        assert_eq!(scenario.link.resource_blocks as u32, radio(name).resource_blocks);
        // The table is read back equal.
        let table = &**scenario.link.table.as_ref().unwrap();
        assert_eq!(&RateTable::parse(&table.to_csv(), Path::new("b.csv")).unwrap(), table);
    }
}

#[test]
fn shadowing_makes_rates_random_about_the_same_median() {
    // 6 dB at n = 2.5: half of the links of lora-sf7 carry its rate at 4699 m, 84 % at 10^(−6/25) = 0.575 of that.
    let shadowed = scenario("link.preset = 'lora-sf7'\nlink.preset_sigma_db = 6.0\n");
    let channel = Channel::of(&shadowed.link);
    let carried = |d_m: f64| channel.expected_rate_bps(&channel.uplink_at(1.0, d_m * d_m, 20.0)) / 4814.0;
    assert!(channel.is_random());
    assert!((carried(shadowed.link.comm_radius_m) - 0.5).abs() < 0.02);
    assert!((carried(0.575 * 4699.0) - 0.841).abs() < 0.02);
}

#[test]
fn a_uav_that_climbs_has_the_radius_of_its_lowest_altitude() {
    let keys = "uav.altitude = 'free'\nuav.min_altitude_m = 25.0\nuav.altitude_m = 30.0\nlink.preset = 'wifi-n20'\n";
    let climbing = scenario(keys);
    let table = climbing.link.table.unwrap();
    let [_, altitudes_m, _] = table.axes();
    assert_eq!(altitudes_m, [25.0, 48.75, 72.5, 96.25, 120.0]);
    assert!((climbing.link.comm_radius_m - (46.99f64.powi(2) - 625.0).sqrt()).abs() < 0.05);
}

#[test]
fn each_drone_hovers_as_long_as_its_row_says() {
    for drone in &DRONES {
        let scenario = scenario(&format!("uav.preset = '{}'\n", drone.name));
        let battery = scenario.uav.battery.unwrap();
        let hover_s = battery.capacity_j / power_w(&scenario.uav.propulsion, 0.0);
        assert!((hover_s / (60.0 * drone.hover_min) - 1.0).abs() < 0.03, "{}: {hover_s} s", drone.name);
        assert!((scenario.uav.endurance_s / (0.8 * hover_s) - 1.0).abs() < 0.03);
        assert!(drone.cruise_mps <= drone.max_speed_mps && scenario.uav.max_speed_mps == drone.cruise_mps);
        let cruise_w = power_w(&scenario.uav.propulsion, drone.cruise_mps);
        assert!(cruise_w < drone.hover_w, "{}: {cruise_w} W", drone.name);
    }
    // x500: 2.0 kg · 9.81 = 19.62 N; √(19.62/(2 · 1.225 · 0.2)) = 6.328 m/s; 0.53 · 280 = 148.4 W.
    let x500 = scenario("uav.preset = 'x500'\n").uav;
    let battery = x500.battery.unwrap();
    let propulsion = x500.propulsion;
    assert_eq!((battery.weight_n, propulsion.hover_induced_mps, propulsion.induced_w), (19.62, 6.328, 148.4));
    assert_eq!((x500.acceleration_mps2, x500.endurance_s, battery.reserve), (Some(2.5), 792.0, 0.2));
}

#[test]
fn keys_beside_a_preset_have_priority_and_a_copy_is_expanded() {
    let keys = "uav.preset = 'm30'\nuav.max_speed_mps = 5.0\nuav.battery.reserve = 0.3\nlink.preset = 'ble-1m'\n\
                link.comm_radius_m = 9.0\nlink.resource_blocks = 2\n";
    let read = scenario(keys);
    let battery = read.uav.battery.unwrap();
    assert_eq!((read.uav.max_speed_mps, battery.reserve, battery.capacity_j), (5.0, 0.3, 948e3));
    assert_eq!((read.link.comm_radius_m, read.link.resource_blocks), (9.0, 2));
    let again = Scenario::parse(&read.to_toml(), &read.path, Overrides::default()).unwrap();
    assert_eq!(again, read);
    // The copy of a run names no preset, and is the same mission.
    let copy = read.to_toml_with_list("sensors.csv");
    assert!(!copy.contains("preset"), "{copy}");
    let overrides = Overrides { table: read.link.table.clone(), ..Overrides::default() };
    assert_eq!(Scenario::parse(&copy, Path::new("run.toml"), overrides).unwrap().hash(), read.hash());
}

#[test]
fn a_setting_of_a_preset_replaces_what_the_file_says() {
    let set = |keys: &str, settings: &[&str]| {
        let keys_of = settings.iter().map(|setting| setting.parse().unwrap()).collect();
        parsed(keys, Overrides { keys: keys_of, ..Overrides::default() }).unwrap()
    };
    let full = scenario("uav.preset = 'x500'\nlink.preset = 'lora-sf7'\n").to_toml().replace("name = \"a\"", "");
    let other = set(&full, &["uav.preset=m30", "link.preset=lora-sf8", "link.setup_s=0.05"]);
    let named = scenario("uav.preset = 'm30'\nlink.preset = 'lora-sf8'\n");
    assert_eq!(other.hash(), named.hash());
    let plain = set("link.preset = 'lora-sf7'\n", &["link.model=free-space"]);
    assert_eq!((plain.link.preset, plain.link.table), (None, None));
    let free = set("link.model = 'free-space'\nlink.gain = 'static'\n", &["link.preset=802154"]);
    assert_eq!(free.link.gain, None);
}

#[test]
fn bad_presets_are_refused_with_the_names() {
    let names = Accepts::OneOf(radios::NAMES).expected();
    for (keys, expected) in [
        ("link.preset = 'lora'\n", format!("a.toml: link.preset = \"lora\": expected one of {names}")),
        ("uav.preset = 'x5000'\n", "uav.preset = \"x5000\": expected one of \"x500\", \"mavic-3e\", \"m30\"".into()),
        ("link.preset = 7\n", "link.preset = 7: expected a string".into()),
        (
            "link.preset = 'ble-1m'\nlink.model = 'free-space'\n",
            "link.model = \"free-space\": expected no model beside link.preset".into(),
        ),
        ("link.preset = 'ble-1m'\nlink.file = 'a.csv'\n", "expected either preset or file, not both".into()),
        ("link.preset_sigma_db = 3.0\n", "expected it only with a radio as preset".into()),
        ("link.preset = 'ble-1m'\nlink.preset_exponent = 0.0\n", "link.preset_exponent = 0.0: expected".into()),
        ("link.preset = 'ble-1m'\nlink.preset_margin_db = inf\n", "expected -100 to 100 dB".into()),
        ("link.preset = 'ble-1m'\nlink.gain = 'static'\n", "link.gain = \"static\": expected it only with".into()),
        (
            "link.preset = 'wifi-n20'\nuav.altitude_m = 60.0\n",
            "link.preset = \"wifi-n20\": expected a radio that reaches the ground from 60 m, for its range is 47 m"
                .into(),
        ),
        ("uav.preset = 'x500'\nuav.battery = 3\n", "uav.battery = 3: expected a table".into()),
        ("uav.preset = 'x500'\nslots = 800\n", "expected at least the flight's 800 s".into()),
    ] {
        let error = parsed(keys, Overrides::default()).unwrap_err();
        assert!(error.contains(&expected) && !error.contains('\n'), "{keys}{error}");
    }
}
