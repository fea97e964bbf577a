//! Plans of other programs: the mission of a vehicle as legs and holds, and its fence as zones.
//!
//! A format reads its file into items (`qgc_plan`, `waypoints`). `commands` says what their MAVLink commands do,
//! `fence` what a geofence forbids, `route` follows the items from home to the end of the flight, and `walk` gives each
//! place its time. What a scenario is made of them is left to the caller.

mod altitude;
mod commands;
mod fence;
mod qgc_plan;
mod route;
#[cfg(test)]
mod tests;
mod walk;
mod waypoints;

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::geodata::{self, ReadFormat, Zone};

use crate::export::Autopilot;
use commands::MissionItem;
pub use walk::PlannedPoint;

/// The kind of input in error messages.
pub const PLAN: &str = "plan";

/// File extensions with their readers.
const FORMATS: [(&str, ReadFormat<PlanFile>); 3] =
    [("plan", qgc_plan::parse), ("waypoints", waypoints::parse), ("txt", waypoints::parse)];

/// The content of a file, in its order.
#[derive(Debug)]
struct PlanFile {
    /// Whether it is a waypoint file, which QGroundControl reads in another way than the autopilot.
    is_waypoints: bool,
    /// The autopilot that it is for.
    autopilot: Autopilot,
    /// Where the vehicle starts and returns to; `None` if the file does not say so.
    home: Option<PlanHome>,
    /// Speed over ground until an item sets one [m/s]; `None` if the file has none.
    speed_mps: Option<f64>,
    items: Vec<MissionItem>,
    fence: Vec<Zone>,
    /// What else it has, which is not used.
    unused: Vec<String>,
}

/// Home of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PlanHome {
    /// Latitude and longitude [°].
    position: [f64; 2],
    /// Above sea level [m]; `None` if the file does not say so.
    altitude_m: Option<f64>,
}

/// A flight by a plan, from above home to its end.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightPlan {
    /// Latitude and longitude of home [°], above which the flight begins.
    pub home: [f64; 2],
    /// The altitude at which it begins, above the ground [m].
    pub start_m: f64,
    /// The legs, at least one.
    pub legs: Vec<PlanLeg>,
    /// The fence: at most one boundary, and no-fly zones.
    pub fence: Vec<Zone>,
    /// What the altitudes are above, as each program reads them.
    pub altitudes: Vec<String>,
    /// Whether altitudes are above home or the sea, so that hills change the height above the ground.
    pub is_level: bool,
    /// What is assumed, and what is not used.
    pub notes: Vec<String>,
    /// What is probably unintended.
    pub warnings: Vec<String>,
}

/// A leg of a plan, and the hold at its end.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanLeg {
    /// Its item in the file, such as `item 4`.
    pub place: String,
    /// Latitude and longitude of its end [°].
    pub to: [f64; 2],
    /// Altitude of its end above the ground [m].
    pub altitude_m: f64,
    /// Speed over ground [m/s].
    pub speed_mps: f64,
    /// Climb and descent [m/s].
    pub vertical_mps: [f64; 2],
    /// Hold at its end [s].
    pub hold_s: f64,
}

impl FlightPlan {
    /// Reads the file `path`. Its extension determines the format. Until an item sets a speed, it is `speed_mps` [m/s],
    /// or that of the file.
    ///
    /// # Errors
    /// If the format is unknown, the file cannot be read, an item is invalid or changes the flight in a way that is not
    /// known, the fence is no boundary with zones, or the vehicle flies nowhere.
    pub fn read(path: &Path, speed_mps: Option<f64>) -> Result<Self, InputError> {
        let file = geodata::read(PLAN, path, None, &FORMATS)?;
        route::follow(file, speed_mps).map_err(|message| InputError::new(PLAN, path, message))
    }

    /// The lowest and the highest altitude above the ground [m]; equal if all legs have one altitude. A take-off to
    /// another altitude does not count then.
    pub fn altitudes_m(&self) -> [f64; 2] {
        let all = || self.legs.iter().map(|leg| leg.altitude_m);
        let [lowest_m, highest_m] = [all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max)];
        match highest_m - lowest_m <= altitude::SAME_M {
            true => [self.legs[0].altitude_m; 2],
            false => [lowest_m.min(self.start_m), highest_m.max(self.start_m)],
        }
    }
}
