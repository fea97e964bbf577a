//! What the commands of mission items do to a flight.
//!
//! Codes and parameters: MAVLink, `MAV_CMD` of common.xml.

use skysink_common::geodata::check_geodetic;

/// Longest hold [s].
const MOST_HOLD_S: f64 = 1e6;

/// Highest speed [m/s].
const MOST_MPS: f64 = 1e3;

/// The last command that moves a vehicle, `MAV_CMD_NAV_LAST`.
const LAST_OF_NAVIGATION: u16 = 95;

/// Other commands that change the flight, with their names.
const STEERING: [(u16, &str); 6] = [
    (176, "DO_SET_MODE"),
    (177, "DO_JUMP"),
    (179, "DO_SET_HOME"),
    (192, "DO_REPOSITION"),
    (193, "DO_PAUSE_CONTINUE"),
    (601, "DO_JUMP_TAG"),
];

/// Names of further commands, for messages.
const NAMES: [(u16, &str); 24] = [
    (18, "NAV_LOITER_TURNS"),
    (30, "NAV_CONTINUE_AND_CHANGE_ALT"),
    (31, "NAV_LOITER_TO_ALT"),
    (92, "NAV_GUIDED_ENABLE"),
    (94, "NAV_PAYLOAD_PLACE"),
    (112, "CONDITION_DELAY"),
    (114, "CONDITION_DISTANCE"),
    (115, "CONDITION_YAW"),
    (181, "DO_SET_RELAY"),
    (183, "DO_SET_SERVO"),
    (189, "DO_LAND_START"),
    (195, "DO_SET_ROI_LOCATION"),
    (197, "DO_SET_ROI_NONE"),
    (201, "DO_SET_ROI"),
    (203, "DO_DIGICAM_CONTROL"),
    (205, "DO_MOUNT_CONTROL"),
    (206, "DO_SET_CAM_TRIGG_DIST"),
    (211, "DO_GRIPPER"),
    (530, "SET_CAMERA_MODE"),
    (2000, "IMAGE_START_CAPTURE"),
    (2001, "IMAGE_STOP_CAPTURE"),
    (2500, "VIDEO_START_CAPTURE"),
    (2501, "VIDEO_STOP_CAPTURE"),
    (4501, "CONDITION_GATE"),
];

/// An item of a mission with the codes of MAVLink.
#[derive(Debug, Clone, PartialEq)]
pub struct ForeignItem {
    /// Its location in the file, such as `item 4`.
    pub place: String,
    /// `MAV_CMD`.
    pub command: u16,
    /// `MAV_FRAME`.
    pub frame: u8,
    /// Parameters 1 to 7; NaN where the file has none.
    pub params: [f64; 7],
    /// The altitude above the ground from which a ground station computed that of the vehicle [m]; `None` otherwise.
    pub above_ground_m: Option<f64>,
}

/// What an item does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Maneuver {
    /// Climbs above home.
    TakeOff,
    /// Flies to a place and holds there [s].
    Fly { hold_s: f64 },
    /// Flies to a place by a spline.
    FlySpline { hold_s: f64 },
    /// Flies to a place and stays there without end.
    Stay,
    /// Flies home and lands.
    Return,
    /// Flies to a place and lands.
    Land,
    /// Holds [s] where it is.
    Hold { hold_s: f64 },
    /// Sets the speed over ground [m/s].
    Speed { speed_mps: f64 },
    /// Sets the speed of climbs [m/s].
    Climb { climb_mps: f64 },
    /// Sets the speed of descents [m/s].
    Descent { descent_mps: f64 },
    /// Sets the speed that the vehicle had before all others.
    DefaultSpeed,
    /// Delays the next command that does not move the vehicle.
    DelayNext,
    /// Nothing to the flight.
    Nothing,
}

impl ForeignItem {
    /// What it does.
    ///
    /// # Errors
    /// If it changes the flight in a way that is not known, or has an invalid parameter.
    pub fn maneuver(&self) -> Result<Maneuver, String> {
        let hold_s = || self.hold_s();
        Ok(match self.command {
            16 => Maneuver::Fly { hold_s: hold_s()? },
            17 => Maneuver::Stay,
            19 => Maneuver::Fly { hold_s: hold_s()? },
            20 => Maneuver::Return,
            21 | 85 => Maneuver::Land,
            22 | 84 => Maneuver::TakeOff,
            82 => Maneuver::FlySpline { hold_s: hold_s()? },
            93 if self.params[0] < 0.0 => {
                return Err(self.refusal("NAV_DELAY until a time of day: expected seconds"));
            }
            93 => Maneuver::Hold { hold_s: hold_s()? },
            112 | 114 => Maneuver::DelayNext,
            178 => self.speed()?,
            command if command <= LAST_OF_NAVIGATION => {
                let expected = "expected waypoints (16, 82), loiter (17, 19), delay (93), take-off, return and landing";
                return Err(self.refusal(&format!("command {}: {expected}", named(command))));
            }
            command if STEERING.iter().any(|(steering, _)| *steering == command) => {
                let expected = "expected a mission of waypoints that is flown once, from its first item to its last";
                return Err(self.refusal(&format!("command {}: {expected}", named(command))));
            }
            _ => Maneuver::Nothing,
        })
    }

    /// Latitude and longitude [°]; `None` for where the vehicle is, which 0, 0 means.
    ///
    /// # Errors
    /// If they are no such.
    pub fn position(&self) -> Result<Option<[f64; 2]>, String> {
        let position = [self.params[4], self.params[5]];
        if position == [0.0; 2] || position.iter().any(|degrees| degrees.is_nan()) {
            return Ok(None);
        }
        check_geodetic(position).map_err(|expected| self.refusal(&expected))?;
        Ok(Some(position))
    }

    /// The error for this item.
    pub fn refusal(&self, message: &str) -> String {
        format!("{}: {message}", self.place)
    }

    /// The first parameter as a hold [s]; 0 without one.
    fn hold_s(&self) -> Result<f64, String> {
        let hold_s = if self.params[0].is_nan() { 0.0 } else { self.params[0] };
        let is_hold = (0.0..=MOST_HOLD_S).contains(&hold_s);
        let refuse = || self.refusal(&format!("a hold of {hold_s} s: expected 0 to {MOST_HOLD_S} s"));
        is_hold.then_some(hold_s).ok_or_else(refuse)
    }

    /// `DO_CHANGE_SPEED`.
    fn speed(&self) -> Result<Maneuver, String> {
        let [kind, speed_mps, ..] = self.params;
        if speed_mps == -1.0 || speed_mps.is_nan() {
            return Ok(Maneuver::Nothing); // no change
        }
        if speed_mps == -2.0 {
            return Ok(Maneuver::DefaultSpeed);
        }
        if !(speed_mps > 0.0 && speed_mps <= MOST_MPS) {
            let expected = format!("expected above 0, at most {MOST_MPS} m/s");
            return Err(self.refusal(&format!("a speed of {speed_mps} m/s: {expected}")));
        }
        if kind == 2.0 {
            return Ok(Maneuver::Climb { climb_mps: speed_mps });
        }
        if kind == 3.0 {
            return Ok(Maneuver::Descent { descent_mps: speed_mps });
        }
        let is_level = kind.is_nan() || kind == 0.0 || kind == 1.0;
        let refuse = || self.refusal(&format!("speed type {kind}: expected 0 to 3"));
        is_level.then_some(Maneuver::Speed { speed_mps }).ok_or_else(refuse)
    }
}

/// A command with its name, if it is known.
pub fn named(command: u16) -> String {
    let name = STEERING.iter().chain(&NAMES).find(|(known, _)| *known == command);
    name.map_or_else(|| command.to_string(), |(_, name)| format!("{command} ({name})"))
}
