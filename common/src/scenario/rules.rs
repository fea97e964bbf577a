//! The rules between the keys of a scenario, and its alternative forms: groups of keys for the same quantity, of which
//! a scenario has one.
//!
//! The defaults of a form are not filled in beside the other form. A setting in one form removes the other form of the
//! file.

use nalgebra::Point3;
use toml::{Table, Value};

use super::mission::Scenario;
use super::motion::check_moves;
use super::uav::Climb;
use super::zones;
use crate::arrivals::MAX_SAMPLED_BITS;
use crate::channel::{Channel, ChannelModel, LinkModel, LosCurve, SHADOWING_DB};
use crate::error::InputError;
use crate::geometry::Position;
use crate::keys::dotted::{beside, is_below, value};
use crate::keys::{self, Keys, Only, Rule, Source};
use crate::nodes::NODE_ROWS;
use crate::nodes::keys::MAX_FIELD_BITS;
use crate::presets;
use crate::slack::TIME_SLACK;

/// Slack of a probability that has to be 1.
const CERTAIN_SLACK: f64 = 1e-9;

/// Checks the rules between the keys of `scenario`, which was read from `file`.
pub(crate) fn check(scenario: &Scenario, file: &Table) -> Result<(), InputError> {
    let value = |key: &str| value(file, key);
    let is_given = |key: &str| value(key).is_some();
    let rule = |holds: bool, key: &str, expected: &str| match value(key) {
        Some(value) if !holds => Err(scenario.refusal(key, value, expected)),
        _ => Ok(()),
    };

    check_forms(file, scenario.source())?;
    check_pairs(&is_given, &rule)?;
    check_sensors(scenario, &rule)?;
    check_uav(scenario, &rule)?;
    zones::check(scenario)?;
    check_channel(scenario, &rule)?;
    for (key, only) in conditional() {
        let other = value(&beside(&key, only.key)).and_then(Value::as_str);
        let holds = other.is_some_and(|other| only.values.contains(&other));
        if let Some(expected) = only.expected {
            rule(holds, &key, expected)?;
        }
    }
    check_contact(scenario, &rule)
}

/// Checks that keys that belong together are.
fn check_pairs(is_given: &dyn Fn(&str) -> bool, rule: Rule<'_>) -> Result<(), InputError> {
    rule(is_given("area.height_m"), "area.width_m", "width_m and height_m together, or side_m")?;
    rule(is_given("area.width_m"), "area.height_m", "width_m and height_m together, or side_m")?;
    for (key, other) in [("area.origin_lat_deg", "area.origin_lon_deg"), ("area.origin_lon_deg", "area.origin_lat_deg")]
    {
        rule(is_given(other), key, "origin_lat_deg and origin_lon_deg together")?;
    }
    Ok(())
}

/// Checks what the sensor nodes sample, and their features.
fn check_sensors(scenario: &Scenario, rule: Rule<'_>) -> Result<(), InputError> {
    let sensors = &scenario.sensors;
    let sampled_bits = sensors.sampling_bps.ends()[1] * scenario.slot_s * scenario.slots as f64;
    rule(sampled_bits <= MAX_SAMPLED_BITS, "sensors.sampling_bps", "at most 9e15 bits over the mission")?;
    let field_bits = sensors.count.map_or(1.0, f64::from) * sampled_bits;
    let expected = "at most 9e18 bits over the mission from all sensor nodes";
    rule(field_bits <= MAX_FIELD_BITS, "sensors.sampling_bps", expected)?;

    let of_arrivals = sensors
        .arrivals
        .iter()
        .flat_map(|arrivals| [("sensors.arrivals.on_s", arrivals.on_s), ("sensors.arrivals.off_s", arrivals.off_s)]);
    for (key, time_s) in of_arrivals {
        let expected = format!("at least the slot's {} s", scenario.slot_s);
        rule(time_s.is_none_or(|time_s| time_s >= scenario.slot_s), key, &expected)?;
    }
    let node_keys = scenario.node_keys();
    NODE_ROWS.iter().try_for_each(|row| (row.check)(&node_keys, rule))?;
    let has_file = scenario.sensors.arrivals.as_ref().is_none_or(|arrivals| arrivals.file.is_some());
    let expected = "another model, or a CSV file as sensors.arrivals.file";
    rule(!scenario.sensors.has_trace() || has_file, "sensors.arrivals.model", expected)
}

/// Checks the flights of the UAVs, their starts and the base.
fn check_uav(scenario: &Scenario, rule: Rule<'_>) -> Result<(), InputError> {
    let Scenario { area, uav, link, .. } = scenario;
    let flight_s = scenario.slots as f64 * scenario.slot_s;
    let expected = format!("at least the flight's {flight_s} s, slots × slot_s (T τ ≤ T_e)");
    let is_own = scenario.must_land() && scenario.own.as_ref().is_some_and(|own| own.has("uav.endurance_s"));
    let least_s = if is_own { scenario.slot_s } else { flight_s };
    rule(least_s <= uav.endurance_s * (1.0 + TIME_SLACK), "uav.endurance_s", &expected)?;
    let wind_mps = scenario.wind_mps().norm();
    let expected = format!("[x, y], a wind slower than uav.max_speed_mps = {} m/s", uav.max_speed_mps);
    rule(wind_mps < uav.max_speed_mps, "uav.wind_mps", &expected)?;
    let expected = format!("a position in the area, [0, {}] × [0, {}]", area.width_m(), area.height_m());
    rule(uav.start_m.is_none_or(|start_m| area.contains(&start_m.into(), 0.0)), "uav.start_m", &expected)?;
    check_lists(scenario, rule)?;
    if let Some([x_m, y_m]) = scenario.base.as_ref().and_then(|base| base.position_m) {
        let expected = format!("a position in the area, [0, {}] × [0, {}]", area.width_m(), area.height_m());
        rule(area.contains(&Position::new(x_m, y_m), 0.0), "base.position_m", &expected)?;
    }
    let has_own = scenario.base.as_ref().is_some_and(|base| base.site.is_some() && base.charge_w > 0.0);
    rule(!has_own, "base.charge_w", "none beside [[base.site]], whose tables have their own")?;
    check_moves(scenario, rule)?;
    let is_within = uav.waypoint_margin_m.is_none_or(|margin_m| margin_m < link.comm_radius_m);
    rule(is_within, "uav.waypoint_margin_m", "less than link.comm_radius_m")
}

/// Checks the channel model, and the altitudes at which it matters.
fn check_channel(scenario: &Scenario, rule: Rule<'_>) -> Result<(), InputError> {
    let Scenario { sensors, uav, link, .. } = scenario;
    let is_table = link.model == LinkModel::Table;
    let expected = "another model, or a CSV file as link.file";
    let is_map = link.model == LinkModel::Map;
    let has_file = link.file.is_some() || link.preset.is_some();
    rule(!(is_table || is_map) || has_file, "link.model", expected)?;
    rule(is_table || link.preset.is_none(), "link.model", "no model beside link.preset, whose rates are a \"table\"")?;
    rule(!is_table || link.fading.is_none(), "link.fading", "none with model = \"table\", whose rates have it")?;
    rule(!is_map || link.fading.is_none(), "link.fading", "none with model = \"map\", which has residual_db")?;
    let expected = "a height from 0, below uav.altitude_m, and only with link.model = \"buildings\"";
    let is_height = |height_m: f64| link.model == LinkModel::Buildings && (0.0..uav.altitude_m).contains(&height_m);
    rule(sensors.height_m.is_none_or(is_height), "sensors.height_m", expected)?;
    let are_levels = |sigmas_db: [f64; 2]| sigmas_db.iter().all(|sigma_db| SHADOWING_DB.contains(sigma_db));
    let expected = "[in, out of line of sight], standard deviations from 0 to 20 dB";
    rule(link.shadowing_db.is_none_or(are_levels), "link.shadowing_db", expected)?;
    let expected = "none with shadowing_db, which is instead of it";
    rule(link.shadowing_db.is_none() || link.fading.is_none(), "link.fading", expected)?;
    if let Some(Climb { min_altitude_m, max_altitude_m, .. }) = uav.climb() {
        let expected = "\"fixed\", or link.model = \"probabilistic-los\", in which altitude matters";
        rule(Channel::of(link).depends_on_elevation(), "uav.altitude", expected)?;
        let expected = format!("at least the lowest, uav.min_altitude_m = {min_altitude_m}");
        rule(min_altitude_m <= max_altitude_m, "uav.max_altitude_m", &expected)?;
        let is_in_range = (min_altitude_m..=max_altitude_m).contains(&uav.altitude_m);
        rule(is_in_range, "uav.altitude_m", &format!("a start from {min_altitude_m} to {max_altitude_m} m"))?;
    }
    Ok(())
}

/// Checks the probability of line of sight and the times of a contact.
fn check_contact(scenario: &Scenario, rule: Rule<'_>) -> Result<(), InputError> {
    let link = &scenario.link;
    if let Some(LosCurve::Logistic { b3, b4, .. }) = link.los {
        rule((b3 + b4 - 1.0).abs() < CERTAIN_SLACK, "link.los.b3", "1 − b4, so that the probability ends at 1")?;
    }
    let expected = format!("at most the slot's {} s", scenario.slot_s);
    rule(link.comm_s <= scenario.slot_s, "link.comm_s", &expected)?;
    let advice = if link.preset.is_some() { ", or setup_s = 0 beside the preset" } else { "" };
    let expected = format!("less than link.comm_s, {} s{advice}", link.comm_s);
    rule(link.setup_s.is_none_or(|setup_s| setup_s < link.comm_s), "link.setup_s", &expected)
}

/// Checks that `file` has no two forms of the same.
pub(crate) fn check_forms(file: &Table, source: Source) -> Result<(), InputError> {
    for Forms { forms: [one, other], expected } in FORMS {
        let is_other_given = other.iter().any(|key| value(file, key).is_some());
        let given = one.iter().filter(|_| is_other_given).find_map(|key| Some((key, value(file, key)?)));
        if let Some((key, value)) = given {
            return Err(source.refusal(key, value, expected));
        }
    }
    Ok(())
}

/// Checks the keys with a value for each UAV of `scenario`, which was read from `file`.
pub(crate) fn check_fleet(scenario: &Scenario, file: &Table) -> Result<(), InputError> {
    let source = Source { own: None, ..scenario.source() };
    check_lists(scenario, &|holds, key, expected| match value(file, key) {
        Some(value) if !holds => Err(source.refusal(key, value, expected)),
        _ => Ok(()),
    })
}

/// Checks the keys with a value for each UAV.
fn check_lists(scenario: &Scenario, rule: Rule<'_>) -> Result<(), InputError> {
    let Scenario { area, uav, .. } = scenario;
    let is_in_area = |start: Point3<f64>| area.contains(&start.xy(), 0.0);
    let starts_m = uav.starts_m.as_ref().map_or(uav.uavs(), Vec::len);
    let expected_starts = format!("{} positions in the area, one for each UAV (uav.count)", uav.uavs());
    let are_starts = starts_m == uav.uavs() && scenario.starts().all(is_in_area);
    rule(are_starts, "uav.starts_m", &expected_starts)?;
    let are_times = uav.endurances_s.as_ref().is_none_or(|endurances_s| {
        let is_time =
            |&endurance_s: &f64| endurance_s.is_finite() && endurance_s * (1.0 + TIME_SLACK) >= scenario.slot_s;
        uav.uavs() > 1 && endurances_s.len() == uav.uavs() && endurances_s.iter().all(is_time) && scenario.must_land()
    });
    let expected =
        format!("{} times of at least a slot, one for each of several UAVs, and must_land = true", uav.uavs());
    rule(are_times, "uav.endurances_s", &expected)
}

/// Two alternative forms: the keys of each, and what is expected if both are present.
struct Forms {
    forms: [&'static [&'static str]; 2],
    expected: &'static str,
}

/// All alternatives.
const FORMS: [Forms; 10] = [
    Forms {
        forms: [&["area.side_m"], &["area.width_m", "area.height_m"]],
        expected: "either side_m, or width_m and height_m",
    },
    Forms {
        forms: [&["base.areas_m"], &["base.position_m", "base.radius_m"]],
        expected: "either areas_m, or position_m and radius_m",
    },
    Forms {
        forms: [&["base.position_m", "base.radius_m", "base.areas_m"], &["base.site"]],
        expected: "either [[base.site]], or position_m and radius_m, or areas_m",
    },
    Forms { forms: [&presets::OF_RADIO, &["link.file"]], expected: "either preset or file, not both" },
    Forms { forms: [&["uav.track"], &["uav.waypoints_m"]], expected: "either track or waypoints_m, not both" },
    Forms {
        forms: [&["uav.count", "uav.track", "uav.waypoints_m"], &["uav.each"]],
        expected: "either [[uav.each]], or count, or a fixed flight of one UAV",
    },
    Forms { forms: [&["sensors.count"], &["sensors.file"]], expected: "either count or file, not both" },
    Forms {
        forms: [&["link.noise_dbm"], &["link.noise_dbm_per_hz"]],
        expected: "either noise_dbm or noise_dbm_per_hz, not both",
    },
    Forms { forms: [&["link.environment"], &["link.los"]], expected: "either environment or los, not both" },
    Forms {
        forms: [&["link.los.a", "link.los.b"], &["link.los.b1", "link.los.b2", "link.los.b3", "link.los.b4"]],
        expected: "either a and b, or b1 to b4",
    },
];

/// All keys that are refused unless another key of their table has a value, by their dotted names.
fn conditional() -> impl Iterator<Item = (String, Only)> {
    keys::all(Scenario::KEYS, "").into_iter().filter_map(|(name, key)| Some((name, key.only?)))
}

/// The keys of the other form, which must not be present beside `key` with this value.
pub(crate) fn displaced(key: &str, value: &Value) -> Vec<String> {
    let is_in = |form: &[&str]| form.iter().any(|own| *own == key || is_below(key, own));
    let of_other_form = FORMS.iter().flat_map(|forms| match forms.forms.map(is_in) {
        [true, false] => forms.forms[1],
        [false, true] => forms.forms[0],
        _ => &[],
    });
    let is_displaced = |(name, only): &(String, Only)| {
        only.expected.is_some()
            && beside(name, only.key) == key
            && value.as_str().is_some_and(|value| !only.values.contains(&value))
    };
    // The height of the SNs is a key of the channel in another table, and a radio by name is a table of rates.
    let model = value.as_str().filter(|_| key == "link.model");
    let height = model.filter(|&model| model != "buildings").map(|_| "sensors.height_m");
    let preset = model.filter(|&model| model != "table").map(|_| presets::OF_RADIO);
    let of_model = height.into_iter().chain(preset.into_iter().flatten()).map(str::to_owned);
    let of_other_value = conditional().filter(is_displaced).map(|(name, _)| name);
    of_other_form.map(|&other| other.to_owned()).chain(of_other_value).chain(of_model).collect()
}

/// The keys of other forms than those in `file`, whose defaults are not filled in.
pub(crate) fn displaced_in(file: &Table) -> Vec<String> {
    let keys = FORMS.iter().flat_map(|forms| forms.forms).flatten();
    let given = keys.filter_map(|key| Some((key, value(file, key)?)));
    given.flat_map(|(key, value)| displaced(key, value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The keys of a map of links.
    const OF_MAP: [&str; 6] =
        ["link.rates", "link.residual_db", "link.residual_m", "link.service", "link.law_snr_db", "link.law_exponent"];

    #[test]
    fn setting_one_form_of_a_key_removes_only_the_alternative_form() {
        let of = |key: &str, value: &str| displaced(key, &Value::String(value.to_owned()));
        assert_eq!(of("area.height_m", ""), ["area.side_m"]);
        assert_eq!(of("area.side_m", ""), ["area.width_m", "area.height_m"]);
        assert_eq!(of("sensors.file", ""), ["sensors.count"]);
        assert_eq!(of("link.los", ""), ["link.environment"]);
        assert_eq!(
            of("link.los.b", ""),
            ["link.environment", "link.los.b1", "link.los.b2", "link.los.b3", "link.los.b4"]
        );
        assert_eq!(
            of("link.model", "probabilistic-los"),
            [
                &["link.gain_db", "link.gain", "link.shadowing_db", "link.file"][..],
                &OF_MAP,
                &["sensors.height_m"],
                &presets::OF_RADIO
            ]
            .concat()
        );
        let line_of_sight = [
            "link.environment",
            "link.los",
            "link.reference_gain_db",
            "link.los_exponent",
            "link.nlos_exponent",
            "link.nlos_extra_db",
            "link.snr_gap_db",
            "link.shadowing_db",
            "link.los_correlation_m",
            "link.file",
        ];
        let of_several = ["link.beacon_radius_m", "sensors.height_m"];
        let others = [&line_of_sight[..], &OF_MAP, &of_several, &presets::OF_RADIO].concat();
        assert_eq!(of("link.model", "free-space"), others);
        for key in ["area", "area.origin_lat_deg", "link.los_exponent", "slots"] {
            assert_eq!(of(key, "free-space"), [""; 0], "{key}");
        }
    }

    #[test]
    fn a_setting_removes_the_other_form_of_the_file_but_not_another_setting() {
        let file = "[area]\nside_m = 9.0\n[sensors]\ncount = 3\n";
        let mut table: Table = file.parse().unwrap();
        let settings = ["area.width_m=5.0", "area.height_m=6.0", "sensors.count=4", "sensors.file=a.csv"]
            .map(|text| text.parse().unwrap());
        Scenario::apply(&settings, &mut table).unwrap();
        let expected = "[area]\nwidth_m = 5.0\nheight_m = 6.0\n[sensors]\ncount = 4\nfile = \"a.csv\"\n";
        assert_eq!(table, expected.parse().unwrap());
    }
}
