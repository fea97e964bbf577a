//! What a vehicle says and what it is told, without the encoding of MAVLink, which is left to [`crate::codec`].

use crate::autopilot::{Altitude, AutopilotKind};

/// A position on Earth with an altitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlobalTarget {
    /// Geodetic latitude [°].
    pub lat_deg: f64,
    /// Longitude [°].
    pub lon_deg: f64,
    /// Altitude.
    pub altitude: Altitude,
}

/// Where a vehicle is, by its own estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fix {
    /// Geodetic latitude [°].
    pub lat_deg: f64,
    /// Longitude [°].
    pub lon_deg: f64,
    /// Altitude above its home position [m].
    pub above_home_m: f64,
    /// Altitude above mean sea level [m].
    pub above_sea_m: f64,
    /// Velocity, east, north, up [m/s].
    pub velocity_mps: [f64; 3],
    /// Heading, clockwise from north [°]; infinite if it is not known.
    pub heading_deg: f64,
    /// Time of the estimate since the start of its autopilot [s].
    pub boot_s: f64,
}

/// A message of a vehicle.
#[derive(Debug, Clone, PartialEq)]
pub enum Telemetry {
    /// It is there.
    Heartbeat {
        /// Its autopilot.
        autopilot: AutopilotKind,
        /// The flight mode, by the number that the autopilot gives it.
        mode: u32,
        /// Whether its motors may run.
        is_armed: bool,
        /// Whether one of its failsafes acts.
        is_critical: bool,
    },
    /// The flight mode, beside heartbeats.
    Mode(u32),
    /// Where it is.
    Position(Fix),
    /// Standard deviations of the position [m], horizontal and vertical.
    Accuracy([f64; 2]),
    /// Energy that is left, as a fraction of the battery's capacity; `None` if it does not measure it.
    Battery(Option<f64>),
    /// The same, and whether it passes its own checks before arming; `None` if it does not say so.
    Status {
        /// Energy that is left.
        left: Option<f64>,
        /// Whether it passes its checks.
        is_ready: Option<bool>,
    },
    /// Whether it is in the air, by its own judgement.
    InAir(bool),
    /// The answer to an order of the bridge.
    Answer {
        /// The command of the order ([`Order::command`]).
        command: u16,
        /// Result of MAVLink: 0 accepted.
        result: u8,
    },
    /// A line for people, or a part of one.
    Text {
        /// The text.
        text: String,
        /// The number of the line of which it is a part; 0 of a whole line.
        line: u16,
    },
    /// A parameter.
    Parameter {
        /// Its name.
        name: String,
        /// Its value as it was sent ([`AutopilotKind::parameter`]).
        value: f32,
        /// Whether it is an integer.
        is_integer: bool,
    },
}

/// A result of MAVLink: the order is executed.
pub const ACCEPTED: u8 = 0;

/// A result of MAVLink: it may be accepted later.
pub const TEMPORARILY_REJECTED: u8 = 1;

/// A result of MAVLink: it is not supported. PX4 1.14 to 1.17 answers so, and flies to the waypoint.
pub const UNSUPPORTED: u8 = 3;

/// A result of MAVLink: the order is being executed.
pub const IN_PROGRESS: u8 = 5;

/// A message that a vehicle sends periodically.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// [`Telemetry::Position`].
    Position,
    /// [`Telemetry::Accuracy`].
    Accuracy,
    /// [`Telemetry::Heartbeat`].
    Heartbeat,
    /// [`Telemetry::Mode`].
    Mode,
    /// [`Telemetry::Battery`], of each battery.
    Battery,
    /// [`Telemetry::Battery`], of the vehicle.
    Status,
    /// [`Telemetry::InAir`].
    InAir,
}

/// A message to a vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// Arm.
    Arm,
    /// Take off to this altitude.
    TakeOff(Altitude),
    /// Fly as fast as this over ground [m/s].
    Speed(f64),
    /// Fly there, and hold.
    Reposition {
        /// Where to.
        to: GlobalTarget,
        /// How fast [m/s]; `None` leaves the speed.
        speed_mps: Option<f64>,
    },
    /// Return to where it has taken off, and land.
    Return,
    /// Send a message periodically.
    Interval {
        /// The message.
        stream: Stream,
        /// The period [s].
        period_s: f64,
    },
    /// Say the value of a parameter.
    Parameter(&'static str),
}

impl Order {
    /// The command of MAVLink, which its answer repeats; `None` for a message without an answer.
    pub fn command(&self) -> Option<u16> {
        match self {
            Self::Return => Some(20),
            Self::TakeOff(_) => Some(22),
            Self::Speed(_) => Some(178),
            Self::Reposition { .. } => Some(192),
            Self::Arm => Some(400),
            Self::Interval { .. } | Self::Parameter(_) => None,
        }
    }
}
