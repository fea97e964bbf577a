//! What an export format is.

use skysink_common::geodata::projection::GeodeticPosition;

use super::autopilot::Autopilot;
use super::mission_options::VehicleMissionOptions;
use super::track::GeodeticTrack;
use super::vehicle::{MissionPart, VehicleMission};

/// An export format.
#[derive(Debug)]
pub struct ExportFormat {
    /// Its name on the command line.
    pub name: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// File extension.
    pub extension: &'static str,
    /// The function that writes it.
    pub write: WriteFormat,
}

/// The function that writes a format.
#[derive(Debug)]
pub enum WriteFormat {
    /// The whole flight in one file.
    Flight(fn(&GeodeticTrack<'_>) -> Vec<u8>),
    /// A vehicle mission with one file per part.
    Mission(MissionFormat),
}

/// A format of vehicle missions.
#[derive(Debug)]
pub struct MissionFormat {
    /// Writes a part.
    pub write: fn(&ExportedMission<'_>, &MissionPart) -> Vec<u8>,
    /// The autopilot that reads it, if it is always the same.
    pub autopilot: Option<Autopilot>,
    /// What the summary says if it has no geofence.
    pub without_fence: Option<&'static str>,
    /// What the summary says about a mission in this format, or what the format does not hold, with the remedy.
    pub check: fn(&VehicleMission, &VehicleMissionOptions) -> Result<Vec<String>, String>,
}

/// A vehicle mission to write, and what else a file may hold.
#[derive(Debug)]
pub struct ExportedMission<'a> {
    pub track: &'a GeodeticTrack<'a>,
    pub mission: &'a VehicleMission,
    pub options: &'a VehicleMissionOptions,
    /// The corners of the geofence.
    pub fence: Vec<GeodeticPosition>,
}
