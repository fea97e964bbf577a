//! The rules between the keys of a scenario.

use toml::{Table, Value};

use super::forms::{Conditional, FORMS, conditional};
use super::mission::Scenario;
use super::sensors::{MAX_FIELD_BITS, MAX_SAMPLED_BITS};
use super::uav::Climb;
use crate::channel::{Channel, ChannelModel, LosCurve};
use crate::error::InputError;
use crate::keys::dotted::value;

/// Checks the rules between the keys of `scenario`, which was read from `file`.
pub(crate) fn check(scenario: &Scenario, file: &Table) -> Result<(), InputError> {
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
    let flight_s = scenario.slots as f64 * scenario.slot_s;
    let sampled_bits = sensors.sampling_bps.ends()[1] * scenario.slot_s * scenario.slots as f64;
    rule(sampled_bits <= MAX_SAMPLED_BITS, "sensors.sampling_bps", "at most 9e15 bits over the mission")?;
    let field_bits = sensors.count.map_or(1.0, f64::from) * sampled_bits;
    let expected = "at most 9e18 bits over the mission from all sensor nodes";
    rule(field_bits <= MAX_FIELD_BITS, "sensors.sampling_bps", expected)?;

    let expected = format!("at least the flight's {flight_s} s, slots × slot_s (T τ ≤ T_e)");
    rule(flight_s <= uav.endurance_s * (1.0 + 1e-12), "uav.endurance_s", &expected)?;
    let expected = format!("a position in the area, [0, {}] × [0, {}]", area.width_m(), area.height_m());
    rule(area.contains(&scenario.start().xy(), 0.0), "uav.start_m", &expected)?;
    if let Some(Climb { min_altitude_m, max_altitude_m, .. }) = uav.climb() {
        let expected = "\"fixed\", or link.model = \"probabilistic-los\", in which altitude matters";
        rule(Channel::of(link).depends_on_elevation(), "uav.altitude", expected)?;
        let expected = format!("at least the lowest, uav.min_altitude_m = {min_altitude_m}");
        rule(min_altitude_m <= max_altitude_m, "uav.max_altitude_m", &expected)?;
        let is_in_range = (min_altitude_m..=max_altitude_m).contains(&uav.altitude_m);
        rule(is_in_range, "uav.altitude_m", &format!("a start from {min_altitude_m} to {max_altitude_m} m"))?;
    }

    for Conditional { key, other, value: of, expected } in conditional() {
        rule(value(&other).and_then(Value::as_str) == Some(of), &key, expected)?;
    }
    if let Some(LosCurve::Logistic { b3, b4, .. }) = link.los {
        rule((b3 + b4 - 1.0).abs() < 1e-9, "link.los.b3", "1 − b4, so that the probability ends at 1")?;
    }
    let expected = format!("at most the slot's {} s", scenario.slot_s);
    rule(link.comm_s <= scenario.slot_s, "link.comm_s", &expected)
}
