//! The ranges of the numbers of a scenario, and the rules between keys.

use toml::{Table, Value};

use super::forms::{FORMS, FREE_SPACE, LINE_OF_SIGHT, value};
use super::keys::{Climb, LinkModel, LosCurve};
use super::{MAX_FIELD_BITS, MAX_SAMPLED_BITS, Scenario};
use crate::error::InputError;

/// Description, test (false for NaN) and keys of a range.
type Range = (&'static str, fn(f64) -> bool, &'static str);

/// The ranges of all numbers of a scenario. Both ends of an interval are tested.
const RANGES: [Range; 10] = [
    (
        "a finite number above 0",
        |number| number > 0.0 && number.is_finite(),
        "slot_s area.side_m area.width_m area.height_m uav.altitude_m uav.min_altitude_m uav.max_altitude_m \
         uav.max_speed_mps uav.endurance_s uav.propulsion.blade_profile_w uav.propulsion.induced_w \
         uav.propulsion.tip_speed_mps uav.propulsion.hover_induced_mps uav.propulsion.air_density_kgpm3 \
         uav.propulsion.rotor_solidity uav.propulsion.rotor_disc_m2 link.bandwidth_hz link.tx_power_w \
         link.comm_radius_m link.comm_s link.los.a link.los.b link.los.b2 link.los.b4",
    ),
    (
        "a finite number, 0 or above",
        |number| number >= 0.0 && number.is_finite(),
        "sensors.sampling_bps uav.max_climb_mps uav.propulsion.drag_ratio",
    ),
    ("a finite number", f64::is_finite, "link.los.b1 link.los.b3"),
    ("a latitude, -90 to 90", |number| number.abs() <= 90.0, "area.origin_lat_deg"),
    ("a longitude, -180 to 180", |number| number.abs() <= 180.0, "area.origin_lon_deg"),
    ("0 to 4294967295 bits", |number| (0.0..=4_294_967_295.0).contains(&number), "sensors.initial_queue_mean_bits"),
    (
        "a level from -300 to 0 dB",
        |number| (-300.0..=0.0).contains(&number),
        "link.gain_db link.reference_gain_db link.nlos_extra_db",
    ),
    ("0 to 100 dB", |number| (0.0..=100.0).contains(&number), "link.snr_gap_db"),
    ("a finite level below 0 dBm (and not below -300)", |number| (-300.0..0.0).contains(&number), "link.noise_dbm"),
    ("an exponent from 1 to 10", |number| (1.0..=10.0).contains(&number), "link.los_exponent link.nlos_exponent"),
];

/// Checks the numbers of `scenario`, which was read from `file`.
fn check_numbers(scenario: &Scenario, file: &Table) -> Result<(), InputError> {
    for (expected, is_accepted, keys) in RANGES {
        for key in keys.split_whitespace() {
            let Some(value) = value(file, key) else { continue };
            let ends = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
            let number = |value: &Value| value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64));
            let numbers: Vec<f64> = ends.iter().filter_map(number).collect();
            if !numbers.iter().copied().all(is_accepted) || !numbers.is_sorted() {
                let order = if numbers.len() > 1 { ", the lower first" } else { "" };
                return Err(scenario.refusal(key, value, &format!("{expected}{order}")));
            }
        }
    }
    Ok(())
}

/// Checks the numbers of `scenario`, which was read from `file`, and the rules between its keys.
pub(super) fn check(scenario: &Scenario, file: &Table) -> Result<(), InputError> {
    check_numbers(scenario, file)?;
    let value = |key: &str| value(file, key);
    let is_given = |key: &str| value(key).is_some();
    let rule = |holds: bool, key: &str, expected: &str| match value(key) {
        Some(value) if !holds => Err(scenario.refusal(key, value, expected)),
        _ => Ok(()),
    };

    for forms in FORMS {
        let [one, other] = forms.forms;
        let is_other_given = other.iter().any(|key| is_given(key));
        one.iter().try_for_each(|key| rule(!is_other_given, key, forms.expected))?;
    }
    rule(is_given("area.height_m"), "area.width_m", "width_m and height_m together, or side_m")?;
    rule(is_given("area.width_m"), "area.height_m", "width_m and height_m together, or side_m")?;
    for (key, other) in [("area.origin_lat_deg", "area.origin_lon_deg"), ("area.origin_lon_deg", "area.origin_lat_deg")]
    {
        rule(is_given(other), key, "origin_lat_deg and origin_lon_deg together")?;
    }

    let Scenario { area, sensors, uav, link, .. } = scenario;
    let is_named = sensors.file.as_ref().is_some_and(|file| !file.as_os_str().is_empty());
    rule(is_named, "sensors.file", "the path of a CSV file, relative to the scenario")?;
    let flight_s = scenario.slots as f64 * scenario.slot_s;
    let sampled_bits = sensors.sampling_bps.ends()[1] * scenario.slot_s * scenario.slots as f64;
    rule(sampled_bits <= MAX_SAMPLED_BITS, "sensors.sampling_bps", "at most 9e15 bits over the mission")?;
    let field_bits = sensors.count.map_or(1.0, |count| count.get() as f64) * sampled_bits;
    let expected = "at most 9e18 bits over the mission from all sensor nodes";
    rule(field_bits <= MAX_FIELD_BITS, "sensors.sampling_bps", expected)?;

    let expected = format!("at least the flight's {flight_s} s, slots × slot_s (T τ ≤ T_e)");
    rule(flight_s <= uav.endurance_s * (1.0 + 1e-12), "uav.endurance_s", &expected)?;
    let expected = format!("a position in the area, [0, {}] × [0, {}]", area.width_m(), area.height_m());
    rule(area.contains(&scenario.start().xy(), 0.0), "uav.start_m", &expected)?;
    if let Some(Climb { min_altitude_m, max_altitude_m, .. }) = uav.climb() {
        let expected = "\"fixed\", or link.model = \"probabilistic-los\", in which altitude matters";
        rule(link.model == LinkModel::ProbabilisticLos, "uav.altitude", expected)?;
        let expected = format!("at least the lowest, uav.min_altitude_m = {min_altitude_m}");
        rule(min_altitude_m <= max_altitude_m, "uav.max_altitude_m", &expected)?;
        let is_in_range = (min_altitude_m..=max_altitude_m).contains(&uav.altitude_m);
        rule(is_in_range, "uav.altitude_m", &format!("a start from {min_altitude_m} to {max_altitude_m} m"))?;
    }

    let (foreign, expected) = match link.model {
        LinkModel::FreeSpace => (&LINE_OF_SIGHT[..], "it only with model = \"probabilistic-los\""),
        LinkModel::ProbabilisticLos => {
            (&FREE_SPACE[..], "it only with model = \"free-space\"; here it is reference_gain_db for all")
        }
    };
    foreign.iter().try_for_each(|key| rule(false, key, expected))?;
    if let Some(LosCurve::Logistic { b3, b4, .. }) = link.los {
        rule((b3 + b4 - 1.0).abs() < 1e-9, "link.los.b3", "1 − b4, so that the probability ends at 1")?;
    }
    let expected = format!("at most the slot's {} s", scenario.slot_s);
    rule(link.comm_s <= scenario.slot_s, "link.comm_s", &expected)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scenario::Overrides;

    /// Adds the dotted names of all floats.
    fn add_numbers(table: &Table, prefix: &str, numbers: &mut Vec<String>) {
        for (key, value) in table {
            let key = format!("{prefix}{key}");
            match value {
                Value::Table(inner) => add_numbers(inner, &format!("{key}."), numbers),
                Value::Float(_) => numbers.push(key),
                _ => {}
            }
        }
    }

    #[test]
    fn every_number_has_a_range() {
        let los = "[link]\nmodel = 'probabilistic-los'\n";
        let texts = [
            "name = 'x'\n[area]\norigin_lat_deg = 0.0\norigin_lon_deg = 0.0\n[link]\ngain_db = -50.0\n".to_owned(),
            "name = 'x'\n[area]\nwidth_m = 90.0\nheight_m = 60.0\n".to_owned(),
            format!("name = 'x'\n[uav]\naltitude = 'free'\n{los}los = {{ a = 9.61, b = 0.16 }}\n"),
            format!("name = 'x'\n{los}los = {{ b1 = -0.4568, b2 = 0.047, b3 = -0.63, b4 = 1.63 }}\n"),
        ];
        for text in texts {
            let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
            let mut numbers = Vec::new();
            add_numbers(&scenario.to_toml().parse().unwrap(), "", &mut numbers);
            assert!(numbers.len() > 20, "{numbers:?}");
            for number in numbers {
                let of = RANGES.iter().filter(|(_, _, keys)| keys.split_whitespace().any(|key| key == number)).count();
                assert_eq!(of, 1, "{number}");
            }
        }
    }
}
