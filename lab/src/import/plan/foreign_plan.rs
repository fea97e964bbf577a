//! The content of a plan's file, and the flight that follows from it.

use skysink_common::geodata::Zone;

use super::altitude::SAME_M;
use super::commands::ForeignItem;
use crate::export::Autopilot;

/// The content of a file, in its order.
#[derive(Debug)]
pub struct PlanFile {
    /// Whether it is a waypoint file, which QGroundControl reads in another way than the autopilot.
    pub is_waypoints: bool,
    /// The autopilot that it is for.
    pub autopilot: Autopilot,
    /// Where the vehicle starts and returns to; `None` if the file does not say so.
    pub home: Option<PlanHome>,
    /// Speed over ground until an item sets one [m/s]; `None` if the file has none.
    pub speed_mps: Option<f64>,
    pub items: Vec<ForeignItem>,
    pub fence: Vec<Zone>,
    /// What else it has, which is not used.
    pub unused: Vec<String>,
}

/// Home of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanHome {
    /// Latitude and longitude [°].
    pub position: [f64; 2],
    /// Above sea level [m]; `None` if the file does not say so.
    pub altitude_m: Option<f64>,
}

/// A flight by a plan, from above home to its end.
#[derive(Debug, Clone, PartialEq)]
pub struct ForeignPlan {
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

impl ForeignPlan {
    /// The lowest and the highest altitude above the ground [m]; equal if all legs have one altitude. A take-off to
    /// another altitude does not count then.
    pub fn altitudes_m(&self) -> [f64; 2] {
        let all = || self.legs.iter().map(|leg| leg.altitude_m);
        let [lowest_m, highest_m] = [all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max)];
        match highest_m - lowest_m <= SAME_M {
            true => [self.legs[0].altitude_m; 2],
            false => [lowest_m.min(self.start_m), highest_m.max(self.start_m)],
        }
    }
}
