//! From the keys of a file to a scenario: defaults that depend on other keys, rules between keys, and SI units.

use std::path::Path;

use nalgebra::Point3;
use toml::{Table, Value};

use super::error::ScenarioError;
use super::keys::{AltitudeMode, Environment, GainMode, Keys, LinkKeys, LinkModel, LosKeys};
use super::value::{Count, Exponent, GainDb, GapDb, NonNegative, OneOrRange, Positive, refusal};
use super::{
    Area, Climb, LinkBudget, LosCurve, LosModel, MAX_FIELD_BITS, MAX_SAMPLED_BITS, Origin, Scenario, SensorSource,
    Sensors, Uav,
};
use crate::units::{ratio_of_db, watts_of_dbm};

/// Keys of the link that belong to one model only.
const FREE_SPACE: [&str; 2] = ["gain_db", "gain"];
const LINE_OF_SIGHT: [&str; 7] =
    ["environment", "los", "reference_gain_db", "los_exponent", "nlos_exponent", "nlos_extra_db", "snr_gap_db"];

/// The scenario of the keys of the file `path`.
pub(super) fn resolve(mut keys: Keys, path: &Path) -> Result<Scenario, ScenarioError> {
    fill(&mut keys);
    check(&keys, path)?;
    let area = area(&keys);
    let sensors = &keys.sensors;
    let source = match (&sensors.file, sensors.count) {
        (Some(file), _) => SensorSource::File(path.parent().unwrap_or(Path::new("")).join(file)),
        (None, count) => SensorSource::Drawn(count.expect("filled in where there is no file").get() as u32),
    };
    let origin = keys.area.origin_lat_deg.zip(keys.area.origin_lon_deg);
    Ok(Scenario {
        name: keys.name.0.clone(),
        seed: keys.seed.get(),
        slots: keys.slots.get(),
        slot_s: keys.slot_s.0,
        area,
        origin: origin.map(|(lat, lon)| Origin { lat_deg: lat.0, lon_deg: lon.0 }),
        sensors: Sensors {
            source,
            capacity_bits: sensors.capacity_bits.get() as u32,
            sampling_bps: sensors.sampling_bps.ends(),
            initial_queue_mean_bits: sensors.initial_queue_mean_bits.ends(),
        },
        uav: Uav {
            altitude_m: keys.uav.altitude_m.0,
            climb: climb(&keys),
            max_speed_mps: keys.uav.max_speed_mps.0,
            endurance_s: keys.uav.endurance_s.0,
            start: start(&keys, area),
            propulsion: keys.uav.propulsion,
        },
        link: link(&keys.link),
        planner: std::mem::take(&mut keys.planner),
        path: path.to_owned(),
        keys,
    })
}

/// Fills in every default that depends on another key; with both ways to say something, neither is touched.
fn fill(keys: &mut Keys) {
    let given = &mut keys.area;
    if given.width_m.is_none() && given.height_m.is_none() {
        given.side_m.get_or_insert(Positive(100.0));
    }
    if keys.sensors.file.is_none() {
        keys.sensors.count.get_or_insert(Count::of::<200>());
    }
    if keys.uav.altitude == AltitudeMode::Free {
        keys.uav.min_altitude_m.get_or_insert(Positive(20.0));
        keys.uav.max_altitude_m.get_or_insert(Positive(120.0));
        keys.uav.max_climb_mps.get_or_insert(NonNegative(5.0));
    }
    let Area { width_m, height_m } = area(keys);
    keys.uav.start_m.get_or_insert([width_m / 2.0, height_m / 2.0]);
    let link = &mut keys.link;
    match link.model {
        LinkModel::FreeSpace => {
            link.gain_db.get_or_insert(OneOrRange::Range([GainDb(-55.0), GainDb(-50.0)]));
            link.gain.get_or_insert(GainMode::Static);
        }
        LinkModel::ProbabilisticLos => {
            if link.los.is_none() {
                link.environment.get_or_insert(Environment::Urban);
            }
            link.reference_gain_db.get_or_insert(GainDb(-60.0));
            link.los_exponent.get_or_insert(Exponent(2.5));
            link.nlos_exponent.get_or_insert(Exponent(3.5));
            link.nlos_extra_db.get_or_insert(GainDb(-20.0));
            link.snr_gap_db.get_or_insert(GapDb(8.2));
        }
    }
}

/// The rules between keys.
fn check(keys: &Keys, path: &Path) -> Result<(), ScenarioError> {
    let written = Value::Table(Table::try_from(keys).expect("keys are plain tables of numbers and strings"));
    let value = |key: &str| key.split('.').try_fold(&written, |table, name| table.get(name));
    let given = |key: &str| value(key).is_some();
    let rule = |holds: bool, key: &str, expected: &str| match value(key) {
        Some(value) if !holds => Err(refusal(path, key, value, expected)),
        _ => Ok(()),
    };

    let sides = given("area.width_m") || given("area.height_m");
    rule(!sides, "area.side_m", "either side_m, or width_m and height_m")?;
    rule(given("area.height_m"), "area.width_m", "width_m and height_m together, or side_m")?;
    rule(given("area.width_m"), "area.height_m", "width_m and height_m together, or side_m")?;
    for (key, other) in [("area.origin_lat_deg", "area.origin_lon_deg"), ("area.origin_lon_deg", "area.origin_lat_deg")]
    {
        rule(given(other), key, "origin_lat_deg and origin_lon_deg together")?;
    }

    let sensors = &keys.sensors;
    rule(!given("sensors.file"), "sensors.count", "either count or file, not both")?;
    let named = sensors.file.as_ref().is_some_and(|file| !file.as_os_str().is_empty());
    rule(named, "sensors.file", "the path of a CSV file, relative to the scenario")?;
    let flight_s = keys.slots.get() as f64 * keys.slot_s.0;
    let sampled_bits = sensors.sampling_bps.ends()[1] * keys.slot_s.0 * keys.slots.get() as f64;
    rule(sampled_bits <= MAX_SAMPLED_BITS, "sensors.sampling_bps", "at most 9e15 bits over the mission")?;
    let field_bits = sensors.count.map_or(1.0, |count| count.get() as f64) * sampled_bits;
    let expected = "at most 9e18 bits over the mission from all sensor nodes";
    rule(field_bits <= MAX_FIELD_BITS, "sensors.sampling_bps", expected)?;

    let expected = format!("at least the flight's {flight_s} s, slots × slot_s (T τ ≤ T_e)");
    rule(flight_s <= keys.uav.endurance_s.0 * (1.0 + 1e-12), "uav.endurance_s", &expected)?;
    let area = area(keys);
    let expected = format!("a position in the area, [0, {}] × [0, {}]", area.width_m, area.height_m);
    rule(area.contains(&start(keys, area).xy(), 0.0), "uav.start_m", &expected)?;
    if let Some(Climb { min_altitude_m, max_altitude_m, .. }) = climb(keys) {
        let expected = "\"fixed\", or link.model = \"probabilistic-los\", in which altitude matters";
        rule(keys.link.model == LinkModel::ProbabilisticLos, "uav.altitude", expected)?;
        let expected = format!("at least the lowest, uav.min_altitude_m = {min_altitude_m}");
        rule(min_altitude_m <= max_altitude_m, "uav.max_altitude_m", &expected)?;
        let inside = (min_altitude_m..=max_altitude_m).contains(&keys.uav.altitude_m.0);
        rule(inside, "uav.altitude_m", &format!("a start from {min_altitude_m} to {max_altitude_m} m"))?;
    }

    let (foreign, expected) = match keys.link.model {
        LinkModel::FreeSpace => (&LINE_OF_SIGHT[..], "it only with model = \"probabilistic-los\""),
        LinkModel::ProbabilisticLos => {
            (&FREE_SPACE[..], "it only with model = \"free-space\"; here it is reference_gain_db for all")
        }
    };
    for key in foreign {
        rule(false, &format!("link.{key}"), expected)?;
    }
    rule(!given("link.los"), "link.environment", "either environment or los, not both")?;
    if let Some(los) = &keys.link.los {
        rule(los.curve().is_some(), "link.los", "{ a = , b = } or { b1 = , b2 = , b3 = , b4 = }")?;
    }
    if let Some(LosCurve::Logistic { b3, b4, .. }) = keys.link.los.and_then(|los| los.curve()) {
        rule((b3 + b4 - 1.0).abs() < 1e-9, "link.los.b3", "1 − b4, so that the chance ends at 1")?;
    }
    let expected = format!("at most the slot's {} s", keys.slot_s.0);
    rule(keys.link.comm_s.0 <= keys.slot_s.0, "link.comm_s", &expected)
}

/// The area; where width or height is left out, the side.
fn area(keys: &Keys) -> Area {
    let side_m = keys.area.side_m.unwrap_or(Positive(0.0));
    Area { width_m: keys.area.width_m.unwrap_or(side_m).0, height_m: keys.area.height_m.unwrap_or(side_m).0 }
}

/// Where the UAV starts: by default above the centre.
fn start(keys: &Keys, area: Area) -> Point3<f64> {
    let [x_m, y_m] = keys.uav.start_m.unwrap_or([area.width_m / 2.0, area.height_m / 2.0]);
    Point3::new(x_m, y_m, keys.uav.altitude_m.0)
}

/// The range of altitudes; none where the UAV stays at one.
fn climb(keys: &Keys) -> Option<Climb> {
    let uav = &keys.uav;
    Some(Climb {
        min_altitude_m: uav.min_altitude_m?.0,
        max_altitude_m: uav.max_altitude_m?.0,
        max_climb_mps: uav.max_climb_mps?.0,
    })
    .filter(|_| uav.altitude == AltitudeMode::Free)
}

fn link(keys: &LinkKeys) -> LinkBudget {
    let reference_db = keys.reference_gain_db.map(|gain| [gain.0; 2]);
    LinkBudget {
        los: los_model(keys),
        bandwidth_hz: keys.bandwidth_hz.0,
        tx_power_w: keys.tx_power_w.0,
        noise_w: watts_of_dbm(keys.noise_dbm.0),
        gain_db: keys.gain_db.map(OneOrRange::ends).or(reference_db).unwrap_or_default(),
        gain: keys.gain.unwrap_or(GainMode::Static),
        comm_radius_m: keys.comm_radius_m.0,
        comm_s: keys.comm_s.0,
        resource_blocks: keys.resource_blocks.get() as usize,
    }
}

/// The probabilistic model of a link whose defaults are filled in; none in free space.
fn los_model(keys: &LinkKeys) -> Option<LosModel> {
    let of_environment = || keys.environment.map(|environment| environment.sigmoid());
    Some(LosModel {
        curve: match keys.los {
            Some(los) => los.curve()?,
            None => of_environment().map(|(a, b)| LosCurve::Sigmoid { a, b })?,
        },
        reference_gain: ratio_of_db(keys.reference_gain_db?.0),
        los_exponent: keys.los_exponent?.0,
        nlos_exponent: keys.nlos_exponent?.0,
        nlos_extra: ratio_of_db(keys.nlos_extra_db?.0),
        snr_gap: ratio_of_db(keys.snr_gap_db?.0),
    })
}

impl LosKeys {
    /// The curve; `None` unless it is a and b, or b1 to b4.
    fn curve(&self) -> Option<LosCurve> {
        match *self {
            Self { a: Some(a), b: Some(b), b1: None, b2: None, b3: None, b4: None } => {
                Some(LosCurve::Sigmoid { a: a.0, b: b.0 })
            }
            Self { a: None, b: None, b1: Some(b1), b2: Some(b2), b3: Some(b3), b4: Some(b4) } => {
                Some(LosCurve::Logistic { b1: b1.0, b2: b2.0, b3: b3.0, b4: b4.0 })
            }
            _ => None,
        }
    }
}
