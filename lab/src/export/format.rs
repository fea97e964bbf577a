//! What an export format is.

use skysink_common::geodata::projection::GeodeticPosition;
use skysink_mission::replay::RecordedRun;

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
    /// The slots in the frame of the area; needs no origin.
    Slots(fn(&RecordedRun) -> Vec<u8>),
    /// A vehicle mission with one file per part.
    Mission {
        /// Writes a part.
        write: fn(&ExportedMission<'_>, &MissionPart) -> Vec<u8>,
        /// The autopilot that reads it, if it is always the same.
        autopilot: Option<Autopilot>,
        /// What the summary says if it has no geofence.
        without_fence: Option<&'static str>,
    },
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
