//! Plans of other programs: the mission of a vehicle as legs and holds, and its fence as zones.
//!
//! A format reads its file into items (`qgc_plan`, `waypoints`). `commands` says what their MAVLink commands do,
//! `fence` what a geofence forbids, `route` follows the items from home to the end of the flight, and `walk` gives each
//! place its time. What a scenario is made of them is left to the caller.

mod altitude;
mod commands;
mod fence;
mod foreign_plan;
mod qgc_plan;
mod route;
#[cfg(test)]
mod tests;
mod walk;
mod waypoints;

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::geodata::{self, ReadFormat};

use foreign_plan::PlanFile;
pub use foreign_plan::{ForeignPlan, PlanLeg};
pub use walk::PlannedPoint;

/// The kind of input in error messages.
pub const PLAN: &str = "plan";

/// File extensions with their readers.
const FORMATS: [(&str, ReadFormat<PlanFile>); 3] =
    [("plan", qgc_plan::parse), ("waypoints", waypoints::parse), ("txt", waypoints::parse)];

impl ForeignPlan {
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
}
