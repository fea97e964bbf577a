//! From the raw scenario to the checked one, in one conversion. Comparisons are written so that NaN fails.

use std::fmt::Debug;
use std::path::Path;

use super::raw::{self, AltitudeMode, LinkModel, OneOrRange, letter};
use super::{
    Area, Climb, LinkBudget, MAX_FIELD_BITS, MAX_RESOURCE_BLOCKS, Origin, Scenario, ScenarioError, SensorSource,
    Sensors, Uav,
};
use crate::geometry::Position;
use crate::units::watts_of_dbm;

/// Most sensor nodes of a field.
const MAX_SENSORS: u64 = 10_000_000;

/// Slots of the longest mission.
const MAX_SLOTS: u64 = 1_000_000_000;

/// Names become folders; file systems end at 255 bytes.
const MAX_NAME_BYTES: usize = 100;

/// Bits that one sensor node may sample in a mission: counted through `f64`, exact up to 2^53.
const MAX_SAMPLED_BITS: f64 = 9.0e15;

/// Checks the raw scenario of the file `path`, and fills in every default that depends on another key.
pub(super) fn check(mut raw: raw::Scenario, path: &Path) -> Result<Scenario, ScenarioError> {
    let checker = Checker { path };
    checker.name(&raw.name)?;
    checker.that("seed", raw.seed, i64::try_from(raw.seed).is_ok(), "at most 9223372036854775807, TOML's largest")?;
    checker.that("slots", raw.slots, (1..=MAX_SLOTS).contains(&raw.slots), "1 to 1000000000")?;
    checker.positive("slot_s", raw.slot_s)?;
    let area = checker.area(&mut raw.area)?;
    let origin = checker.origin(&raw.area)?;
    let sensors = checker.sensors(&mut raw)?;
    let uav = checker.uav(&mut raw, area)?;
    let link = checker.link(&mut raw)?;
    Ok(Scenario {
        name: raw.name.clone(),
        seed: raw.seed,
        slots: raw.slots,
        slot_s: raw.slot_s,
        area,
        origin,
        sensors,
        uav,
        link,
        planner: std::mem::take(&mut raw.planner),
        path: path.to_owned(),
        resolved: raw,
    })
}

/// The checks of one file.
pub(super) struct Checker<'a> {
    path: &'a Path,
}

impl Checker<'_> {
    /// Refuses `value` of `key` unless `holds`.
    pub(super) fn that(
        &self,
        key: &'static str,
        value: impl Debug,
        holds: bool,
        expected: &str,
    ) -> Result<(), ScenarioError> {
        if holds {
            return Ok(());
        }
        let (value, expected) = (format!("{value:?}"), expected.to_owned());
        Err(ScenarioError::Value { path: self.path.to_owned(), key: key.to_owned(), value, expected })
    }

    pub(super) fn positive(&self, key: &'static str, value: f64) -> Result<(), ScenarioError> {
        self.that(key, value, value > 0.0 && value.is_finite(), "a finite number above 0")
    }

    pub(super) fn not_negative(&self, key: &'static str, value: f64) -> Result<(), ScenarioError> {
        self.that(key, value, value >= 0.0 && value.is_finite(), "a finite number, 0 or above")
    }

    fn name(&self, name: &str) -> Result<(), ScenarioError> {
        let allowed = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
        let holds = !name.is_empty()
            && name.len() <= MAX_NAME_BYTES
            && name.bytes().all(allowed)
            && !name.bytes().all(|byte| byte == b'.');
        self.that("name", name, holds, "1 to 100 of A-Z a-z 0-9 . _ - (it becomes a folder)")
    }

    fn area(&self, raw: &mut raw::Area) -> Result<Area, ScenarioError> {
        let (width_m, height_m) = match (raw.side_m, raw.width_m, raw.height_m) {
            (None, None, None) => {
                raw.side_m = Some(letter::SIDE_M);
                (letter::SIDE_M, letter::SIDE_M)
            }
            (Some(side_m), None, None) => {
                self.positive("area.side_m", side_m)?;
                (side_m, side_m)
            }
            (None, Some(width_m), Some(height_m)) => {
                self.positive("area.width_m", width_m)?;
                self.positive("area.height_m", height_m)?;
                (width_m, height_m)
            }
            (Some(side_m), _, _) => {
                self.that("area.side_m", side_m, false, "either side_m, or width_m and height_m")?;
                unreachable!("the check above fails")
            }
            (None, width_m, height_m) => {
                let (key, value) =
                    if width_m.is_some() { ("area.width_m", width_m) } else { ("area.height_m", height_m) };
                self.that(key, value.unwrap_or(f64::NAN), false, "width_m and height_m together, or side_m")?;
                unreachable!("the check above fails")
            }
        };
        Ok(Area { width_m, height_m })
    }

    fn origin(&self, raw: &raw::Area) -> Result<Option<Origin>, ScenarioError> {
        let together = "origin_lat_deg and origin_lon_deg together";
        let origin = match (raw.origin_lat_deg, raw.origin_lon_deg) {
            (None, None) => return Ok(None),
            (Some(lat_deg), Some(lon_deg)) => Origin { lat_deg, lon_deg },
            (Some(lat_deg), None) => {
                self.that("area.origin_lat_deg", lat_deg, false, together)?;
                unreachable!("the check above fails")
            }
            (None, Some(lon_deg)) => {
                self.that("area.origin_lon_deg", lon_deg, false, together)?;
                unreachable!("the check above fails")
            }
        };
        let Origin { lat_deg, lon_deg } = origin;
        self.that("area.origin_lat_deg", lat_deg, lat_deg.abs() <= 90.0, "a latitude, -90 to 90")?;
        self.that("area.origin_lon_deg", lon_deg, lon_deg.abs() <= 180.0, "a longitude, -180 to 180")?;
        Ok(Some(origin))
    }

    fn sensors(&self, raw: &mut raw::Scenario) -> Result<Sensors, ScenarioError> {
        let (slots, slot_s, sensors) = (raw.slots, raw.slot_s, &mut raw.sensors);
        if let (Some(count), Some(_)) = (sensors.count, &sensors.file) {
            self.that("sensors.count", count, false, "either count or file, not both")?;
        }
        let source = if let Some(file) = &sensors.file {
            let named = !file.as_os_str().is_empty();
            self.that("sensors.file", file, named, "the path of a CSV file, relative to the scenario")?;
            SensorSource::File(self.path.parent().unwrap_or(Path::new("")).join(file))
        } else {
            let count = *sensors.count.get_or_insert(letter::COUNT);
            self.that("sensors.count", count, (1..=MAX_SENSORS).contains(&count), "1 to 10000000 sensor nodes")?;
            SensorSource::Drawn(u32::try_from(count).expect("at most MAX_SENSORS"))
        };
        let capacity_bits = u32::try_from(sensors.capacity_bits).ok().filter(|&bits| bits > 0);
        self.that("sensors.capacity_bits", sensors.capacity_bits, capacity_bits.is_some(), "1 to 4294967295 bits")?;
        let (rates, [slowest_bps, fastest_bps]) = (sensors.sampling_bps, sensors.sampling_bps.ends());
        let holds = slowest_bps >= 0.0 && slowest_bps <= fastest_bps && fastest_bps.is_finite();
        let expected = match rates {
            OneOrRange::One(_) => "a finite number, 0 or above",
            OneOrRange::Range(_) => "finite numbers, 0 or above, the lower first",
        };
        self.that("sensors.sampling_bps", rates, holds, expected)?;
        let sampled_bits = fastest_bps * slot_s * slots as f64;
        let expected = "at most 9e15 bits over the mission";
        self.that("sensors.sampling_bps", rates, sampled_bits <= MAX_SAMPLED_BITS, expected)?;
        let drawn = if let SensorSource::Drawn(count) = source { f64::from(count) } else { 1.0 };
        let expected = "at most 9e18 bits over the mission from all sensor nodes";
        self.that("sensors.sampling_bps", rates, drawn * sampled_bits <= MAX_FIELD_BITS, expected)?;
        let (means, [least_bits, most_bits]) =
            (sensors.initial_queue_mean_bits, sensors.initial_queue_mean_bits.ends());
        let holds = least_bits >= 0.0 && least_bits <= most_bits && most_bits <= f64::from(u32::MAX);
        let expected = match means {
            OneOrRange::One(_) => "0 to 4294967295 bits",
            OneOrRange::Range(_) => "0 to 4294967295 bits, the lower first",
        };
        self.that("sensors.initial_queue_mean_bits", means, holds, expected)?;
        Ok(Sensors {
            source,
            capacity_bits: capacity_bits.expect("checked above"),
            sampling_bps: rates.ends(),
            initial_queue_mean_bits: means.ends(),
        })
    }

    fn uav(&self, raw: &mut raw::Scenario, area: Area) -> Result<Uav, ScenarioError> {
        let uav = &mut raw.uav;
        self.positive("uav.altitude_m", uav.altitude_m)?;
        self.positive("uav.max_speed_mps", uav.max_speed_mps)?;
        self.positive("uav.endurance_s", uav.endurance_s)?;
        let flight_s = raw.slots as f64 * raw.slot_s;
        let expected = format!("at least the flight's {flight_s} s, slots × slot_s (T τ ≤ T_e)");
        self.that("uav.endurance_s", uav.endurance_s, flight_s <= uav.endurance_s * (1.0 + 1e-12), &expected)?;
        let propulsion = &uav.propulsion;
        self.positive("uav.propulsion.blade_profile_w", propulsion.blade_profile_w)?;
        self.positive("uav.propulsion.induced_w", propulsion.induced_w)?;
        self.positive("uav.propulsion.tip_speed_mps", propulsion.tip_speed_mps)?;
        self.positive("uav.propulsion.hover_induced_mps", propulsion.hover_induced_mps)?;
        self.not_negative("uav.propulsion.drag_ratio", propulsion.drag_ratio)?;
        self.positive("uav.propulsion.air_density_kgpm3", propulsion.air_density_kgpm3)?;
        self.positive("uav.propulsion.rotor_solidity", propulsion.rotor_solidity)?;
        self.positive("uav.propulsion.rotor_disc_m2", propulsion.rotor_disc_m2)?;
        let [x_m, y_m] = *uav.start_m.get_or_insert([area.width_m / 2.0, area.height_m / 2.0]);
        let start = Position::new(x_m, y_m);
        let expected = format!("a position in the area, [0, {}] × [0, {}]", area.width_m, area.height_m);
        self.that("uav.start_m", [x_m, y_m], area.contains(&start, 0.0), &expected)?;
        let (altitude_m, max_speed_mps, endurance_s, propulsion) =
            (uav.altitude_m, uav.max_speed_mps, uav.endurance_s, uav.propulsion);
        let climb = self.climb(raw)?;
        Ok(Uav { altitude_m, climb, max_speed_mps, endurance_s, start, propulsion })
    }

    /// The range of altitudes; none where the UAV stays at one.
    fn climb(&self, raw: &mut raw::Scenario) -> Result<Option<Climb>, ScenarioError> {
        let (model, uav) = (raw.link.model, &mut raw.uav);
        if let Some(height_m) = uav.min_altitude_m {
            self.positive("uav.min_altitude_m", height_m)?;
        }
        if let Some(height_m) = uav.max_altitude_m {
            self.positive("uav.max_altitude_m", height_m)?;
        }
        if let Some(speed_mps) = uav.max_climb_mps {
            self.not_negative("uav.max_climb_mps", speed_mps)?;
        }
        if uav.altitude == AltitudeMode::Fixed {
            return Ok(None);
        }
        let expected = "\"fixed\", or link.model = \"probabilistic-los\", in which altitude matters";
        self.that("uav.altitude", "free", model == LinkModel::ProbabilisticLos, expected)?;
        let climb = Climb {
            min_altitude_m: *uav.min_altitude_m.get_or_insert(20.0),
            max_altitude_m: *uav.max_altitude_m.get_or_insert(120.0),
            max_climb_mps: *uav.max_climb_mps.get_or_insert(5.0),
        };
        let range = climb.min_altitude_m <= climb.max_altitude_m;
        let expected = format!("at least the lowest, uav.min_altitude_m = {}", climb.min_altitude_m);
        self.that("uav.max_altitude_m", climb.max_altitude_m, range, &expected)?;
        let inside = (climb.min_altitude_m..=climb.max_altitude_m).contains(&uav.altitude_m);
        let expected = format!("a start from {} to {} m", climb.min_altitude_m, climb.max_altitude_m);
        self.that("uav.altitude_m", uav.altitude_m, inside, &expected)?;
        Ok(Some(climb))
    }

    fn link(&self, raw: &mut raw::Scenario) -> Result<LinkBudget, ScenarioError> {
        let los = super::channel::los(self, &mut raw.link)?;
        let link = &raw.link;
        self.positive("link.bandwidth_hz", link.bandwidth_hz)?;
        self.positive("link.tx_power_w", link.tx_power_w)?;
        let level = link.noise_dbm < 0.0 && link.noise_dbm >= -300.0;
        self.that("link.noise_dbm", link.noise_dbm, level, "a finite level below 0 dBm (and not below -300)")?;
        let gain_db = match (link.gain_db, link.reference_gain_db) {
            (Some(gain_db), _) => gain_db.ends(),
            (None, Some(gain_db)) => [gain_db; 2],
            (None, None) => unreachable!("the channel has one of them"),
        };
        let [lowest_db, highest_db] = gain_db;
        let gains = lowest_db >= -300.0 && lowest_db <= highest_db && highest_db <= 0.0;
        self.that("link.gain_db", gain_db, gains, "levels from -300 to 0 dB, the lower first")?;
        self.positive("link.comm_radius_m", link.comm_radius_m)?;
        self.positive("link.comm_s", link.comm_s)?;
        let expected = format!("at most the slot's {} s", raw.slot_s);
        self.that("link.comm_s", link.comm_s, link.comm_s <= raw.slot_s, &expected)?;
        let blocks = usize::try_from(link.resource_blocks).ok().filter(|n| (1..=MAX_RESOURCE_BLOCKS).contains(n));
        self.that("link.resource_blocks", link.resource_blocks, blocks.is_some(), "1 to 64 resource blocks")?;
        Ok(LinkBudget {
            bandwidth_hz: link.bandwidth_hz,
            tx_power_w: link.tx_power_w,
            noise_w: watts_of_dbm(link.noise_dbm),
            los,
            gain_db,
            gain: link.gain.unwrap_or(letter::GAIN),
            comm_radius_m: link.comm_radius_m,
            comm_s: link.comm_s,
            resource_blocks: blocks.expect("checked above"),
        })
    }
}
