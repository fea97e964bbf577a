//! The autopilots that missions are for, and how their vehicles move.

use clap::ValueEnum;
use strum::Display;

/// An autopilot, by its `MAV_AUTOPILOT`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Display)]
#[strum(serialize_all = "lowercase")]
pub enum Autopilot {
    /// PX4.
    Px4 = 12,
    /// ArduPilot, which holds for whole seconds only.
    Ardupilot = 3,
}

/// How a vehicle comes to its speed and to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RampLimits {
    /// Acceleration and braking [m/s²].
    pub acceleration_mps2: f64,
    /// Change of the acceleration [m/s³]; `None` for any.
    pub jerk_mps3: Option<f64>,
}

/// How a vehicle moves in a mission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleMotion {
    /// Over ground.
    pub horizontal: RampLimits,
    /// Up and down.
    pub vertical: RampLimits,
    /// Time to turn into the attitude of a leg [s].
    pub response_s: f64,
    /// Time to turn into the attitude of a leg that ends in a hold, which begins when the vehicle has settled [s].
    pub settling_s: f64,
    /// Climb [m/s].
    pub climb_mps: f64,
    /// Descent [m/s].
    pub descent_mps: f64,
    /// Distance within which a waypoint without hold is passed [m]; `None` if the vehicle stops at it.
    pub radius_m: Option<f64>,
    /// From arming to the first metre of altitude [s].
    spool_s: f64,
    /// Pause above home before the landing, and after touching down [s].
    pause_s: f64,
    /// Altitude of the last part of a landing [m].
    slow_m: f64,
    /// Descent there [m/s].
    touch_down_mps: f64,
}

/// Up and down, for both: `WPNAV_ACCEL_Z` of ArduCopter, and a jerk that fits what it has flown.
const VERTICAL: RampLimits = RampLimits { acceleration_mps2: 1.0, jerk_mps3: Some(1.0) };

/// ArduCopter: `WPNAV_ACCEL`, `WPNAV_JERK`, `WPNAV_SPEED_UP`, `WPNAV_SPEED_DN`, `WPNAV_RADIUS`, `RTL_LOIT_TIME`,
/// `LAND_SPEED` below 10 m by default. Response and the rest are fitted to what versions 4.7 and 4.8 have flown in
/// software.
const ARDUCOPTER: VehicleMotion = VehicleMotion {
    horizontal: RampLimits { acceleration_mps2: 2.5, jerk_mps3: Some(1.0) },
    vertical: VERTICAL,
    response_s: 0.3,
    settling_s: 0.7,
    climb_mps: 2.5,
    descent_mps: 1.5,
    radius_m: Some(2.0),
    spool_s: 4.8,
    pause_s: 11.0,
    slow_m: 10.0,
    touch_down_mps: 0.5,
};

/// PX4: the acceleration is that of legs from rest to rest that versions 1.15 to 1.18 have flown in their simulator,
/// with
/// `MPC_ACC_HOR` 3 m/s² by default; `MPC_JERK_AUTO`, `MPC_TKO_SPEED` for all climbs, `MPC_Z_V_AUTO_DN`,
/// `MPC_LAND_SPEED` by default; the rest is assumed.
const PX4: VehicleMotion = VehicleMotion {
    horizontal: RampLimits { acceleration_mps2: 1.7, jerk_mps3: Some(4.0) },
    vertical: VERTICAL,
    response_s: 0.3,
    settling_s: 0.3,
    climb_mps: 1.5,
    descent_mps: 1.5,
    radius_m: Some(2.0),
    spool_s: 3.0,
    pause_s: 2.0,
    slow_m: 5.0,
    touch_down_mps: 0.7,
};

/// DJI's aircraft: a stop at each waypoint. The rest is assumed to be that of ArduCopter, without a limit of jerk.
pub const DJI: VehicleMotion =
    VehicleMotion { horizontal: RampLimits { acceleration_mps2: 2.5, jerk_mps3: None }, radius_m: None, ..ARDUCOPTER };

impl Autopilot {
    /// The hold that it makes of `hold_s` [s], at least as long.
    pub fn hold_s(self, hold_s: f64) -> f64 {
        match self {
            Self::Px4 => hold_s,
            Self::Ardupilot => whole_s(hold_s),
        }
    }

    /// How its vehicles move by default.
    pub fn motion(self) -> VehicleMotion {
        match self {
            Self::Px4 => PX4,
            Self::Ardupilot => ARDUCOPTER,
        }
    }
}

/// Slack of a hold [s], so that sums of slots are not rounded up.
const HOLD_SLACK_S: f64 = 1e-9;

/// A hold [s] rounded up to whole seconds.
pub fn whole_s(hold_s: f64) -> f64 {
    if hold_s > HOLD_SLACK_S { (hold_s - HOLD_SLACK_S).ceil() } else { 0.0 }
}

impl VehicleMotion {
    /// The motion with another horizontal acceleration [m/s²] and jerk [m/s³].
    pub fn with(self, acceleration_mps2: Option<f64>, jerk_mps3: Option<f64>) -> Self {
        let acceleration_mps2 = acceleration_mps2.unwrap_or(self.horizontal.acceleration_mps2);
        Self {
            horizontal: RampLimits { acceleration_mps2, jerk_mps3: jerk_mps3.or(self.horizontal.jerk_mps3) },
            ..self
        }
    }

    /// Time from arming to the altitude `altitude_m` [m] above home [s].
    pub fn take_off_s(&self, altitude_m: f64) -> f64 {
        self.spool_s + altitude_m.max(0.0) / self.climb_mps
    }

    /// Time from `altitude_m` [m] above home to the end of the landing [s].
    pub fn landing_s(&self, altitude_m: f64) -> f64 {
        let slow_m = altitude_m.clamp(0.0, self.slow_m);
        self.pause_s + slow_m / self.touch_down_mps + (altitude_m - self.slow_m).max(0.0) / self.descent_mps
    }
}
