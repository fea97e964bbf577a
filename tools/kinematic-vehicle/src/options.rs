//! The options of the vehicle.

use clap::{Args, Parser};
use skysink_common::geodata::projection::Origin;
use skysink_common::option_value::{number, positive};
use skysink_vehicle::wire::WireAddress;

use crate::body::MotionLimits;
use crate::modes::CopterMode;
pub use crate::modes::Imitated;

/// What the vehicle can do, and what goes wrong.
#[derive(Debug, Clone, PartialEq, Args)]
pub struct KinematicOptions {
    /// Address of the link.
    #[arg(long, value_name = "ADDRESS", default_value = "udpout:127.0.0.1:14540")]
    pub connect: WireAddress,
    /// The autopilot that it imitates.
    #[arg(long, value_enum, default_value_t)]
    pub autopilot: Imitated,
    /// The mode in which its operator has left it; the bridge waits for `guided` (GUIDED, or Hold of PX4).
    #[arg(long, value_enum, default_value = "guided")]
    pub mode: CopterMode,
    /// Home: latitude and longitude of the first vehicle [deg].
    #[arg(long, value_name = "LAT,LON", default_value = "47.3977,8.5456", allow_hyphen_values = true)]
    pub home: Origin,
    /// Number of vehicles on the link: the systems 1 to N, with homes 5 m apart, to the east.
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u8).range(1..=254))]
    pub count: u8,
    /// Seconds of the vehicle in a second.
    #[arg(long, value_name = "X", default_value = "1", value_parser = positive())]
    pub speed_factor: f64,
    /// Greatest horizontal acceleration [m/s²].
    #[arg(long, value_name = "MPS2", default_value = "2.5", value_parser = positive())]
    pub acceleration: f64,
    /// Speed unless the bridge asks for another [m/s].
    #[arg(long, value_name = "MPS", default_value = "10", value_parser = positive())]
    pub speed: f64,
    /// Time constant of the velocity [s].
    #[arg(long, value_name = "S", default_value = "0", value_parser = least())]
    pub lag: f64,
    /// Standard deviation of the reported position [m].
    #[arg(long, value_name = "M", default_value = "0", value_parser = least())]
    pub noise: f64,
    /// Wind toward the east [m/s]; its gusts have 0.3 of that as standard deviation.
    #[arg(long, value_name = "MPS", default_value = "0", value_parser = least())]
    pub wind: f64,
    /// Probability of a message to be lost, in both directions.
    #[arg(long, value_name = "P", default_value = "0", value_parser = probability())]
    pub loss: f64,
    /// Refuse to arm this many times, though its own checks pass.
    #[arg(long, value_name = "N", default_value = "0")]
    pub refuse_arming: u32,
    /// Time after its start from which its own checks before arming pass [s].
    #[arg(long, value_name = "S", default_value = "2", value_parser = least())]
    pub ready_after: f64,
    /// Time after take-off at which a failsafe returns the vehicle [s].
    #[arg(long, value_name = "S", value_parser = positive())]
    pub failsafe_at: Option<f64>,
    /// FS_GCS_ENABLE or, of PX4, NAV_DLL_ACT: it returns when the bridge is silent, unless it is 0 [default: 1, of PX4
    /// 2].
    #[arg(long, value_name = "0..7", value_parser = clap::value_parser!(u8).range(0..=7))]
    pub gcs_failsafe: Option<u8>,
    /// FS_GCS_TIMEOUT, or COM_DL_LOSS_T: how long the bridge is silent before it returns [s].
    #[arg(long, value_name = "S", default_value = "5", value_parser = positive())]
    pub silence: f64,
    /// Time that it hovers with a full battery [s].
    #[arg(long, value_name = "S", default_value = "1200", value_parser = positive())]
    pub endurance: f64,
    /// Charge of the battery at the start [%].
    #[arg(long, value_name = "PERCENT", default_value = "100", value_parser = clap::value_parser!(u8).range(0..=100))]
    pub battery: u8,
    /// Seed of noise, gusts and losses.
    #[arg(long, default_value = "1")]
    pub seed: u64,
}

/// The options alone, to get their defaults.
#[derive(Parser)]
struct OptionsAlone {
    #[command(flatten)]
    options: KinematicOptions,
}

impl Default for KinematicOptions {
    fn default() -> Self {
        OptionsAlone::parse_from([""]).options
    }
}

impl KinematicOptions {
    /// Checks that its autopilot has the mode.
    ///
    /// # Errors
    /// A line that names the mode.
    pub fn check(&self) -> Result<(), String> {
        if self.mode.is_of(self.autopilot) {
            Ok(())
        } else {
            Err("--mode take-off: expected --autopilot px4".to_owned())
        }
    }

    /// The parameter of its GCS failsafe.
    pub fn gcs_failsafe(&self) -> u8 {
        self.gcs_failsafe.unwrap_or(if self.is_px4() { 2 } else { 1 })
    }

    /// Whether it imitates PX4.
    pub fn is_px4(&self) -> bool {
        self.autopilot == Imitated::Px4
    }

    /// The limits of the body at this greatest speed [m/s].
    pub(crate) fn limits(&self, speed_mps: f64) -> MotionLimits {
        MotionLimits { acceleration_mps2: self.acceleration, speed_mps, lag_s: self.lag, wind_mps: self.wind }
    }
}

fn probability() -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    number("a probability, from 0 to 1", |number| (0.0..=1.0).contains(&number))
}

fn least() -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    number("a number, at least 0", |number| number >= 0.0 && number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_px4_has_a_mode_for_its_take_off() {
        let check = |autopilot, mode| KinematicOptions { autopilot, mode, ..KinematicOptions::default() }.check();
        assert!(check(Imitated::Px4, CopterMode::TakeOff).is_ok());
        assert!(check(Imitated::Arducopter, CopterMode::Guided).is_ok());
        let refused = check(Imitated::Arducopter, CopterMode::TakeOff).unwrap_err();
        assert_eq!(refused, "--mode take-off: expected --autopilot px4");
    }
}
