//! The altitudes of a plan above the ground, and what each program takes them for.

use crate::export::AltitudeReference;

use super::commands::ForeignItem;

/// Altitudes that differ by less are one [m].
pub const SAME_M: f64 = 0.01;

/// Highest altitude above the ground [m].
const MOST_M: f64 = 1e4;

/// What the altitudes of a plan are above, with their range.
#[derive(Debug, Default)]
pub struct Readings {
    readings: Vec<Reading>,
}

/// The altitudes of one reference.
#[derive(Debug)]
struct Reading {
    reference: AltitudeReference,
    /// Whether a ground station computed them from altitudes above the ground.
    is_computed: bool,
    /// Lowest and highest, as the file has them [m].
    range_m: [f64; 2],
    count: usize,
}

/// The altitude of an item above the ground [m]; `None` if it has none. Home is `home_m` [m] above the sea, and the
/// ground is taken as level with it.
///
/// # Errors
/// If its frame is not known, it is above the sea and home is not, or it is not above the ground.
pub fn above_ground_m(item: &ForeignItem, home_m: Option<f64>, readings: &mut Readings) -> Result<Option<f64>, String> {
    let given_m = item.params[6];
    if given_m.is_nan() {
        return Ok(None);
    }
    let reference = match item.frame {
        0 | 5 => AltitudeReference::Msl,
        3 | 6 => AltitudeReference::Relative,
        10 | 11 => AltitudeReference::Terrain,
        frame => {
            let expected = "expected 0, 3 or 10, above sea level, home or the terrain";
            return Err(item.refusal(&format!("frame {frame}: {expected}")));
        }
    };
    let altitude_m = match (item.above_ground_m, reference, home_m) {
        (Some(above_ground_m), _, _) => above_ground_m,
        (None, AltitudeReference::Msl, Some(home_m)) => given_m - home_m,
        (None, AltitudeReference::Msl, None) => {
            let expected = "expected the altitude of home, which the plan does not have";
            return Err(item.refusal(&format!("{given_m} m above sea level (frame 0): {expected}")));
        }
        _ => given_m,
    };
    let altitude_m = (altitude_m * 1e3).round() / 1e3;
    if !(altitude_m > 0.0 && altitude_m <= MOST_M) {
        let of =
            if reference == AltitudeReference::Msl { format!(", {given_m} m above sea level") } else { String::new() };
        let expected = format!("expected above 0, at most {MOST_M} m");
        return Err(item.refusal(&format!("{altitude_m} m above the ground{of}: {expected}")));
    }
    readings.add(reference, item.above_ground_m.is_some(), given_m);
    Ok(Some(altitude_m))
}

impl Readings {
    fn add(&mut self, reference: AltitudeReference, is_computed: bool, altitude_m: f64) {
        let is_same = |reading: &&mut Reading| (reading.reference, reading.is_computed) == (reference, is_computed);
        match self.readings.iter_mut().find(is_same) {
            Some(reading) => {
                let [lowest_m, highest_m] = reading.range_m;
                reading.range_m = [lowest_m.min(altitude_m), highest_m.max(altitude_m)];
                reading.count += 1;
            }
            None => self.readings.push(Reading { reference, is_computed, range_m: [altitude_m; 2], count: 1 }),
        }
    }

    /// Whether some are above home or the sea.
    pub fn are_level(&self) -> bool {
        self.readings.iter().any(|reading| reading.reference != AltitudeReference::Terrain && !reading.is_computed)
    }

    /// The altitudes as each program reads them, a line for each reference. Home is `home_m` [m] above the sea.
    pub fn lines(&self, home_m: Option<f64>, is_waypoints: bool) -> Vec<String> {
        let line = |reading: &Reading| {
            let Reading { reference, is_computed, range_m: [lowest_m, highest_m], count } = reading;
            let range = match highest_m - lowest_m <= SAME_M {
                true => format!("{lowest_m} m"),
                false => format!("{lowest_m} to {highest_m} m"),
            };
            let read = match reference {
                AltitudeReference::Relative => "above home (frame 3), as all programs read them".to_owned(),
                AltitudeReference::Msl if *is_computed => {
                    "above sea level (frame 0), computed from altitudes above the terrain, which are taken".to_owned()
                }
                AltitudeReference::Msl => {
                    let home = home_m.map_or_else(String::new, |home_m| format!(", less the {home_m} m of home"));
                    format!("above sea level (frame 0), as all programs read them{home}")
                }
                AltitudeReference::Terrain if is_waypoints => {
                    "above the terrain (frame 10) by ArduPilot and Mission Planner, above sea level by QGroundControl"
                        .to_owned()
                }
                AltitudeReference::Terrain => {
                    "above the terrain (frame 10) by QGroundControl and ArduPilot; PX4 refuses them".to_owned()
                }
            };
            let items =
                if *count == 1 { "altitude of 1 item".to_owned() } else { format!("altitudes of {count} items") };
            format!("{items}: {range} {read}")
        };
        self.readings.iter().map(line).collect()
    }

    /// What a program takes for another altitude.
    pub fn warning(&self, is_waypoints: bool) -> Option<String> {
        let is_terrain = |reading: &Reading| reading.reference == AltitudeReference::Terrain;
        (is_waypoints && self.readings.iter().any(is_terrain)).then(|| {
            "frame 10 in a waypoint file: QGroundControl takes these altitudes above the terrain as above sea level: \
             do not open it there"
                .to_owned()
        })
    }
}
