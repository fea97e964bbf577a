//! The options of vehicle missions.

use clap::Args;
use skysink_common::option_value::{number, positive};
use skysink_common::scenario::Scenario;

use super::altitude::AltitudeReference;
use super::autopilot::{self, Autopilot, VehicleMotion};
use super::dji_drone::DjiDrone;

/// Minimum number of items of a mission: home, take-off, speed, waypoint, speed, waypoint above home, return.
pub const MIN_ITEMS: usize = 7;

/// Default for the maximum number of items. This is the limit of PX4; ArduPilot allows about 700.
pub const MOST_ITEMS: usize = 500;

/// Default for how near a leg may come to what it must not touch [m].
const MARGIN_M: f64 = 2.0;

/// Options of the formats that hold a vehicle mission.
#[derive(Debug, Clone, Default, Args)]
pub struct VehicleMissionOptions {
    /// Maximum number of items in a vehicle mission, including home; at least 7; longer missions are split into several
    /// files [default: 500].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(MIN_ITEMS as i64..))]
    pub most_items: Option<u32>,
    /// What the altitudes of a vehicle mission are above [default: terrain for ardupilot if the ground_m of the sensor
    /// list differ, otherwise relative].
    #[arg(long, value_name = "ABOVE")]
    pub altitude: Option<AltitudeReference>,
    /// The ground at home [m], above what the ground_m of the sensor list are above [default: as low as they allow].
    #[arg(long, value_name = "M", allow_negative_numbers = true,
        value_parser = number("metres, -1e4 to 1e4", |ground_m| (-1e4..=1e4).contains(&ground_m)))]
    pub home_ground: Option<f64>,
    /// Height of the geoid above the WGS84 ellipsoid at the field [m], for dji with --altitude msl.
    #[arg(long, value_name = "M", allow_negative_numbers = true,
        value_parser = number("metres, -150 to 150", |geoid_m| (-150.0..=150.0).contains(&geoid_m)))]
    pub geoid: Option<f64>,
    /// Autopilot of a vehicle mission [default: px4; of waypoints ardupilot].
    #[arg(long)]
    pub autopilot: Option<Autopilot>,
    /// Aircraft of a file of dji, which needs it.
    #[arg(long)]
    pub drone: Option<DjiDrone>,
    /// Omit the waypoints of a vehicle mission that collect fewer bits.
    #[arg(long, value_name = "BITS", default_value_t = 0, hide_default_value = true, value_parser = parse_bits)]
    pub min_bits: u64,
    /// Widen the geofence of a vehicle mission beyond the area by this [m] [default: 0].
    #[arg(long, value_name = "M", default_value_t = 0.0, hide_default_value = true,
        value_parser = number("metres, 0 to 10000", |margin_m| (0.0..=1e4).contains(&margin_m)))]
    pub fence_margin: f64,
    /// Warn of legs that come nearer than this to the geofence, a zone, a building or the ground [m] [default: 2].
    #[arg(long, value_name = "M",
        value_parser = number("metres, 0 to 10000", |margin_m| (0.0..=1e4).contains(&margin_m)))]
    pub margin: Option<f64>,
    /// Delay the starts of a fleet, so that its UAVs stay uav.separation_m apart by the estimated times.
    #[arg(long)]
    pub stagger: bool,
    /// Acceleration of the vehicle for the estimate of the duration [m/s²] [default: uav.acceleration_mps2, or that of
    /// the autopilot].
    #[arg(long, value_name = "M/S2", value_parser = positive())]
    pub acceleration: Option<f64>,
    /// Jerk of the vehicle for the estimate of the duration [m/s³] [default: that of the autopilot].
    #[arg(long, value_name = "M/S3", value_parser = positive())]
    pub jerk: Option<f64>,
    /// Export vehicle missions that take longer, or more energy, than the UAV has.
    #[arg(long)]
    pub ignore_endurance: bool,
}

impl VehicleMissionOptions {
    /// The first option that was given; `None` without any.
    pub fn given(&self) -> Option<&'static str> {
        let given = [
            (self.most_items.is_some(), "--most-items"),
            (self.altitude.is_some(), "--altitude"),
            (self.home_ground.is_some(), "--home-ground"),
            (self.geoid.is_some(), "--geoid"),
            (self.autopilot.is_some(), "--autopilot"),
            (self.drone.is_some(), "--drone"),
            (self.min_bits > 0, "--min-bits"),
            (self.fence_margin > 0.0, "--fence-margin"),
            (self.margin.is_some(), "--margin"),
            (self.stagger, "--stagger"),
            (self.acceleration.is_some(), "--acceleration"),
            (self.jerk.is_some(), "--jerk"),
            (self.ignore_endurance, "--ignore-endurance"),
        ];
        given.into_iter().find(|(is_given, _)| *is_given).map(|(_, name)| name)
    }

    /// Refuses the options for DJI alone.
    ///
    /// # Errors
    /// If one was given.
    pub fn check_no_dji(&self) -> Result<(), String> {
        let given = [(self.geoid.is_some(), "--geoid"), (self.drone.is_some(), "--drone")];
        let given = given.into_iter().find(|(is_given, _)| *is_given);
        given.map_or(Ok(()), |(_, name)| Err(format!("{name}: expected it only with --format dji")))
    }

    /// How near a leg may come to what it must not touch, without a warning [m].
    pub fn margin_m(&self) -> f64 {
        self.margin.unwrap_or(MARGIN_M)
    }

    /// The most items of a part, with home.
    pub fn most_items(&self) -> usize {
        self.most_items.map_or(MOST_ITEMS, |most_items| most_items as usize)
    }

    /// The autopilot that the mission is for.
    pub fn autopilot(&self) -> Autopilot {
        self.autopilot.unwrap_or(Autopilot::Px4)
    }

    /// How the vehicle of a scenario moves.
    pub fn motion(&self, scenario: &Scenario) -> VehicleMotion {
        let acceleration_mps2 = self.acceleration.or(scenario.uav.acceleration_mps2);
        let motion = if self.drone.is_some() { autopilot::DJI } else { self.autopilot().motion() };
        motion.with(acceleration_mps2, self.jerk)
    }

    /// The hold that the vehicle makes of `hold_s` [s], at least as long. DJI takes whole seconds, against its
    /// documentation.
    pub fn hold_s(&self, hold_s: f64) -> f64 {
        if self.drone.is_some() { autopilot::whole_s(hold_s) } else { self.autopilot().hold_s(hold_s) }
    }
}

/// Parses whole bits, such as 1e6.
fn parse_bits(text: &str) -> Result<u64, String> {
    let is_count = |bits: &f64| (0.0..=9e15).contains(bits) && bits.fract() == 0.0;
    let bits = text.parse().ok().filter(is_count).map(|bits| bits as u64);
    bits.ok_or_else(|| "expected whole bits, 0 to 9e15".to_owned())
}
