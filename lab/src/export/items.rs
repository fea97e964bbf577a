//! The items of a vehicle mission, and their codes in MAVLink.

use skysink_common::geodata::projection::GeodeticPosition;

use super::altitude::AltitudeReference;

/// An item of a vehicle mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VehicleItem {
    /// `MAV_CMD_NAV_TAKEOFF`: above home [m].
    TakeOff { home: GeodeticPosition, altitude_m: f64 },
    /// `MAV_CMD_DO_CHANGE_SPEED`: over ground [m/s].
    Speed { speed_mps: f64 },
    /// `MAV_CMD_NAV_WAYPOINT`: in the altitude reference of the mission [m], held for a time [s].
    Waypoint { place: GeodeticPosition, altitude_m: f64, hold_s: f64 },
    /// `MAV_CMD_NAV_RETURN_TO_LAUNCH`.
    Return,
}

/// An item with the codes of MAVLink.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MavlinkItem {
    /// `MAV_CMD`.
    pub command: u16,
    /// `MAV_FRAME`.
    pub frame: u8,
    /// Parameters 1 to 7; NaN lets the vehicle choose the heading.
    pub params: [f64; 7],
}

/// How near to a waypoint the vehicle has been at it [m]: by default a PX4 passes 10 m away in some releases,
/// ArduCopter 2.
const ACCEPTANCE_M: f64 = 2.0;

/// `MAV_FRAME_MISSION`, of items without a position.
const NO_POSITION: u8 = 2;

impl VehicleItem {
    /// Converts the item to the codes of MAVLink (`MAV_CMD` and `MAV_FRAME` of common.xml).
    pub fn mavlink(&self, reference: AltitudeReference) -> MavlinkItem {
        let at = |command, frame, hold_s, place: GeodeticPosition, altitude_m| MavlinkItem {
            command,
            frame,
            params: [hold_s, 0.0, 0.0, f64::NAN, place.lat_deg, place.lon_deg, altitude_m],
        };
        match *self {
            Self::TakeOff { home, altitude_m } => at(22, AltitudeReference::Relative as u8, 0.0, home, altitude_m),
            Self::Waypoint { place, altitude_m, hold_s } => {
                let mut item = at(16, reference as u8, hold_s, place, altitude_m);
                item.params[1] = ACCEPTANCE_M;
                item
            }
            Self::Speed { speed_mps } => {
                MavlinkItem { command: 178, frame: NO_POSITION, params: [1.0, speed_mps, -1.0, 0.0, 0.0, 0.0, 0.0] }
            }
            Self::Return => MavlinkItem { command: 20, frame: NO_POSITION, params: [0.0; 7] },
        }
    }
}
