//! What an export format is.

use skysink_mission::replay::RecordedRun;

use super::track::GeodeticTrack;
use super::vehicle::VehicleItem;

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
    /// A vehicle mission with one file per part, and a note for the summary.
    Mission(fn(&GeodeticTrack<'_>, &[VehicleItem]) -> Vec<u8>, &'static str),
}
