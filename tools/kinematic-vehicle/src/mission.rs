//! Missions of ground stations, and the time that the vehicle takes to fly one.

use std::path::Path;

use nalgebra::Vector3;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;
use skysink_common::error::InputError;
use skysink_common::geodata::projection::{Origin, Projection};

use crate::autopilot::RETURN_M;
use crate::body::{Body, MotionLimits};
use crate::options::KinematicOptions;

/// Step of the flight [s].
const STEP_S: f64 = 0.02;

/// Distance at which a waypoint without a hold is passed [m], and at which another is reached.
const PASS_M: f64 = 2.0;
const REACH_M: f64 = 0.1;

/// Greatest speed of a vehicle that has reached a waypoint with a hold [m/s].
const REST_MPS: f64 = 0.2;

/// Longest leg [s].
const MOST_LEG_S: f64 = 3_600.0;

/// Commands of items.
const WAYPOINT: u16 = 16;
const RETURN: u16 = 20;
const TAKE_OFF: u16 = 22;
const CHANGE_SPEED: u16 = 178;

/// An item of a mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionItem {
    /// The command of MAVLink.
    pub command: u16,
    /// Its parameters 1 to 7: 5 to 7 are latitude, longitude [deg] and altitude above home [m].
    pub params: [f64; 7],
}

/// How long the parts of a mission took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionTimes {
    /// From arming to disarming [s].
    pub whole_s: f64,
    /// From the first waypoint to the last [s].
    pub waypoints_s: f64,
    /// Waypoints that were reached.
    pub waypoints: usize,
}

#[derive(Deserialize)]
struct PlanFile {
    mission: PlanMission,
}

#[derive(Deserialize)]
struct PlanMission {
    items: Vec<PlanItem>,
}

#[derive(Deserialize)]
struct PlanItem {
    command: u16,
    params: [Option<f64>; 7],
}

/// Reads a plan of QGroundControl (`.plan`) or a list of waypoints (`QGC WPL 110`).
///
/// # Errors
/// If the file is neither.
pub fn read(path: &Path) -> Result<Vec<MissionItem>, InputError> {
    let refuse = |message: String| InputError::new("mission", path, message);
    let text = std::fs::read_to_string(path).map_err(|error| refuse(error.to_string()))?;
    if text.trim_start().starts_with('{') {
        let plan: PlanFile = serde_json::from_str(&text).map_err(|error| refuse(error.to_string()))?;
        let item = |item: PlanItem| MissionItem {
            command: item.command,
            params: item.params.map(|param| param.unwrap_or(f64::NAN)),
        };
        return Ok(plan.mission.items.into_iter().map(item).collect());
    }
    let mut lines = text.lines();
    if !lines.next().is_some_and(|line| line.starts_with("QGC WPL")) {
        return Err(refuse("expected a .plan of QGroundControl, or QGC WPL 110".to_owned()));
    }
    let home_and_items = lines.filter(|line| !line.trim().is_empty());
    let items = home_and_items.skip(1).map(|line| {
        let fields = line.split_whitespace().map(|field| field.parse().ok()).collect::<Option<Vec<f64>>>()?;
        let [_, _, _, command, params @ .., _] = <[f64; 12]>::try_from(fields).ok()?;
        Some(MissionItem { command: command as u16, params })
    });
    items.collect::<Option<Vec<_>>>().ok_or_else(|| refuse("expected 12 numbers in each line".to_owned()))
}

/// Flies `items` as ArduCopter does in AUTO: a hold of less than a second is none, and a waypoint without one is passed
/// within 2 m. The vehicle takes off at the first waypoint.
///
/// # Errors
/// If there is no waypoint, one is on the other side of the Earth, or a leg takes more than an hour.
pub fn fly(items: &[MissionItem], options: &KinematicOptions) -> Result<MissionTimes, String> {
    let first = items.iter().find(|item| item.command == WAYPOINT).ok_or("expected a waypoint in the mission")?;
    let [_, _, _, _, lat_deg, lon_deg, _] = first.params;
    let projection = Projection::at(Origin { lat_deg, lon_deg });
    let mut flight = MissionFlight::new(options);
    let mut times = MissionTimes { whole_s: 0.0, waypoints_s: 0.0, waypoints: 0 };
    let mut first_s = None;
    for item in items {
        let [hold_s, speed_mps, _, _, lat_deg, lon_deg, z_m] = item.params;
        match item.command {
            TAKE_OFF => flight.stop_at(Vector3::new(flight.body.position_m.x, flight.body.position_m.y, z_m))?,
            WAYPOINT => {
                let place =
                    projection.project(lat_deg, lon_deg).ok_or("expected waypoints on this side of the Earth")?;
                let target_m = Vector3::new(place.x, place.y, z_m);
                if hold_s.trunc() >= 1.0 {
                    flight.stop_at(target_m)?;
                    flight.time_s += hold_s.trunc();
                } else {
                    flight.fly_until(target_m, |body| (body.position_m - target_m).norm() < PASS_M)?;
                }
                times.waypoints += 1;
                times.waypoints_s = flight.time_s - *first_s.get_or_insert(flight.time_s);
            }
            CHANGE_SPEED if speed_mps > 0.0 => flight.limits.speed_mps = speed_mps, // others keep it
            RETURN => {
                let home_m = Vector3::new(0.0, 0.0, flight.body.position_m.z.max(RETURN_M));
                let up_m = Vector3::new(flight.body.position_m.x, flight.body.position_m.y, home_m.z);
                flight.stop_at(up_m)?;
                flight.stop_at(home_m)?;
                flight.fly_until(Vector3::new(0.0, 0.0, -1.0), |body| body.position_m.z <= 0.0)?;
            }
            _ => {}
        }
    }
    times.whole_s = flight.time_s;
    Ok(times)
}

/// A flight through a mission.
struct MissionFlight {
    body: Body,
    limits: MotionLimits,
    random: ChaCha8Rng,
    time_s: f64,
}

impl MissionFlight {
    fn new(options: &KinematicOptions) -> Self {
        let limits = options.limits(options.speed);
        Self { body: Body::default(), limits, random: ChaCha8Rng::seed_from_u64(options.seed), time_s: 0.0 }
    }

    fn stop_at(&mut self, target_m: Vector3<f64>) -> Result<(), String> {
        self.fly_until(target_m, |body| {
            (body.position_m - target_m).norm() < REACH_M && body.velocity_mps.norm() < REST_MPS
        })
    }

    fn fly_until(&mut self, target_m: Vector3<f64>, is_there: impl Fn(&Body) -> bool) -> Result<(), String> {
        let limit_s = self.time_s + MOST_LEG_S;
        while !is_there(&self.body) {
            if self.time_s > limit_s {
                return Err("a leg takes more than an hour, perhaps because of the wind".to_owned());
            }
            self.body.fly(&target_m, &self.limits, STEP_S, &mut self.random);
            self.time_s += STEP_S;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(command: u16, params: [f64; 7]) -> MissionItem {
        MissionItem { command, params }
    }

    #[test]
    fn a_mission_takes_the_time_of_its_legs_holds_and_landing() {
        let options = KinematicOptions::default(); // 2.5 m/s², 10 m/s
        let waypoint = |hold_s: f64, lat_deg: f64| item(WAYPOINT, [hold_s, 0.0, 0.0, f64::NAN, lat_deg, 0.0, 20.0]);
        let lat_deg = 40.0 / 110_574.0; // 40 m of a meridian at the equator
        let items = [
            item(TAKE_OFF, [0.0, 0.0, 0.0, f64::NAN, 0.0, 0.0, 20.0]),
            waypoint(1.0, 0.0),
            waypoint(2.5, lat_deg),
            item(RETURN, [0.0; 7]),
        ];
        let times = fly(&items, &options).unwrap();
        // 40 m: 2 √(40 / 2.5) = 8 s, and a hold of 2 s; up: 20 / 2.5 + 1 = 9 s; home: 8 s; down: 20 / 1.5 + 0.3 = 13.6
        // s.
        assert_eq!(times.waypoints, 2);
        assert!((times.waypoints_s - 10.0).abs() < 0.3, "{times:?}");
        assert!((times.whole_s - (9.0 + 1.0 + 10.0 + 8.0 + 13.6)).abs() < 1.0, "{times:?}");
        let passing = fly(&[items[0], waypoint(0.1, 0.0), waypoint(0.9, lat_deg), items[3]], &options).unwrap();
        assert!(passing.waypoints_s < 8.0, "holds below a second are none: {passing:?}");
        let keeping = |speed_mps: f64| item(CHANGE_SPEED, [1.0, speed_mps, -1.0, 0.0, 0.0, 0.0, 0.0]);
        let kept = fly(&[items[0], keeping(-1.0), items[1], keeping(f64::NAN), items[2], items[3]], &options);
        assert_eq!(kept, Ok(times), "-1 is no speed");
        let wind = KinematicOptions { wind: 12.0, ..KinematicOptions::default() };
        let west = item(WAYPOINT, [0.0, 0.0, 0.0, f64::NAN, 0.0, -lat_deg, 20.0]);
        assert!(fly(&[items[0], items[1], west], &wind).unwrap_err().contains("more than an hour"));
    }

    #[test]
    fn invalid_mission_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.plan");
        let item = "1 0 3 16 0 0 0 0 47.4 8.5";
        let home = format!("QGC WPL 110\n{item} 0 1\n");
        for text in
            ["", "{}", "QGC WPL 110\n0 1 2\n1 2\n", &format!("{home}{item} 20 1 one\n"), &format!("{home}{item} x 1\n")]
        {
            std::fs::write(&path, text).unwrap();
            assert!(read(&path).is_err(), "{text}");
        }
        assert!(fly(&[], &KinematicOptions::default()).is_err());
    }
}
