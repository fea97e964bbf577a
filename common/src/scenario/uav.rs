//! `[uav]`: the vehicle.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use strum::VariantNames;
use toml::Table;

use super::base::BatteryKeys;
use crate::keys::{Accepts, NOT_NEGATIVE, Only, PATH, POSITIVE};
use crate::presets::drones;

/// Keys of a free altitude.
const FREE: Only = Only { key: "altitude", values: &["free"], expected: None };

/// Keys of a flight on a grid.
const GRID: Only = Only { key: "moves", values: &["grid"], expected: Some("it only with moves = \"grid\"") };

crate::keys! {
    /// `[uav]`: the vehicle.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct UavKeys {
        /// A drone by name, such as `"x500"`: speed, acceleration, climb, endurance, battery and propulsion of its row
        /// in "Which radio, which drone". Keys beside it have priority.
        preset: Option<String>, Accepts::OneOf(drones::NAMES);
        /// Whether the altitude may change; `"free"` needs `link.model = "probabilistic-los"`, or a `"table"` of
        /// several altitudes.
        altitude: AltitudeMode = "fixed", Accepts::OneOf(AltitudeMode::VARIANTS);
        /// Altitude, `H` [m]; the initial one if it is free.
        altitude_m: f64 = 20.0, POSITIVE;
        /// Lowest altitude, `H_min` [m].
        min_altitude_m: Option<f64> = 20.0, POSITIVE, FREE;
        /// Highest altitude, `H_max` [m].
        max_altitude_m: Option<f64> = 120.0, POSITIVE, FREE;
        /// Fastest climb and descent, `V_z` [m/s]; `max_speed_mps` is the horizontal limit.
        max_climb_mps: Option<f64> = 5.0, NOT_NEGATIVE, FREE;
        /// Whether waypoints are locked to a grid of four neighbours, `"grid"` (decision D17a); `"free"` if absent.
        moves: Option<Moves>, Accepts::OneOf(Moves::VARIANTS);
        /// Side of the cells of the grid [m].
        cell_m: Option<f64> = 10.0, POSITIVE, GRID;
        /// Top speed through the air, `V_max` [m/s]; without acceleration and wind the reach in a slot is `V_max τ`.
        max_speed_mps: f64 = 30.0, POSITIVE;
        /// Acceleration and braking, `a` [m/s²]: a slot is flown from rest to rest (decision D31). Without it a turn is
        /// instant.
        acceleration_mps2: Option<f64>, POSITIVE;
        /// Wind, `[x, y]` [m/s], toward the east and the north; slower than `max_speed_mps` (decision D29).
        wind_mps: Option<[f64; 2]>, Accepts::Rule("[x, y], slower than max_speed_mps");
        /// Standard deviation of where a slot ends about its waypoint, in x and in y [m] (decision D29).
        position_error_m: Option<f64>, NOT_NEGATIVE;
        /// How far within `d_c` of a sensor node waypoints are planned [m], for a vehicle that misses them by as much;
        /// less than `link.comm_radius_m`. The node is served up to `d_c`.
        waypoint_margin_m: Option<f64>, NOT_NEGATIVE;
        /// Longest flight, `T_e` [s], at least `slots × slot_s`.
        endurance_s: f64 = 600.0, POSITIVE;
        /// Start, `[x, y]` [m]; the default is the centre of the area, and a checked scenario has the key.
        start_m: Option<[f64; 2]>, Accepts::Rule("a position in the area");
        /// CSV file `t_s,x_m,y_m` (or `slot`, and optionally `z_m`) of a flight that is fixed, relative to the
        /// scenario's folder: waypoints are interpolated at the ends of slots, and strategies only schedule (decision
        /// D32). A run keeps the waypoints.
        track: Option<PathBuf>, PATH;
        /// The waypoint of each slot, `[[x, y, z], ...]` [m]; instead of `track`.
        waypoints_m: Option<Vec<[f64; 3]>>, Accepts::Rule("a waypoint for each slot, `[[x, y, z], ...]` [m]");
        /// Number of UAVs, `U`, equal but for their starts (decision D18); one if absent. UAVs that differ have `each`.
        count: Option<u32>, Accepts::Whole(1, MAX_UAVS as u64);
        /// Start of each UAV, `[[x, y], ...]` [m], instead of `start_m` for all.
        starts_m: Option<Vec<[f64; 2]>>, Accepts::Rule("a position in the area for each UAV");
        /// Longest flight of each UAV [s], `[s, s, ...]`, with `must_land`: it is in the base when its own ends, and
        /// stays there.
        endurances_s: Option<Vec<f64>>, Accepts::Rule("a time of at least a slot for each of several UAVs, with \
            must_land");
        /// How the UAVs share the field (decision D22); `"partition"` if absent.
        coordination: Option<Coordination>, Accepts::OneOf(Coordination::VARIANTS);
        /// A UAV may not fly to within this distance of where one of lower number ends the slot, outside of bases [m];
        /// those that are not `independent` plan for it (decision D23).
        separation_m: Option<f64>, POSITIVE;
        /// Whether the UAV has to be in the base at the end of the mission (decision D13).
        must_land: Option<bool>, Accepts::Rule("true or false");
        /// The energy that it carries; without this table it flies as long as the mission lasts.
        battery: Option<BatteryKeys>, Accepts::TableOf(BatteryKeys::KEYS);
        /// Parameters of the propulsion power.
        propulsion: Propulsion = {}, Accepts::TableOf(Propulsion::KEYS);
        /// `[[uav.each]]`: UAVs that differ, in the order of their numbers, instead of `count`. Each table has keys of
        /// `[uav]` that replace those of all, `resource_blocks`, and how many are equal, `count`.
        each: Option<Vec<Table>>, Accepts::Rule("a list of tables of keys of [uav], but of those of the whole fleet");
    }
}

/// Most UAVs of a mission.
pub const MAX_UAVS: u32 = 64;

/// How several UAVs share a field (decision D22).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Coordination {
    /// Each plans on the whole field as if it were alone.
    Independent,
    /// Each plans after those of lower number, and counts the SNs that they have just scheduled as empty; strategies
    /// that look ahead count what all others plan to serve.
    Sequential,
    /// Each plans for its piece of a closed tour over all SNs, alone.
    #[default]
    Partition,
}

/// Limits of a free altitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Climb {
    /// Lowest altitude `H_min` [m].
    pub min_altitude_m: f64,
    /// Highest altitude `H_max` [m].
    pub max_altitude_m: f64,
    /// Fastest climb and descent `V_z` [m/s].
    pub max_climb_mps: f64,
}

impl UavKeys {
    /// Number of UAVs.
    pub fn uavs(&self) -> usize {
        self.count.map_or(1, |count| count as usize)
    }

    /// The side of the cells of the grid [m]; `None` if the UAV flies freely.
    pub fn grid_m(&self) -> Option<f64> {
        self.cell_m.filter(|_| self.moves == Some(Moves::Grid))
    }

    /// The altitude of all waypoints [m]; `None` if it is free.
    pub fn fixed_altitude_m(&self) -> Option<f64> {
        self.climb().is_none().then_some(self.altitude_m)
    }

    /// The limits of a free altitude; `None` if the altitude is fixed.
    pub fn climb(&self) -> Option<Climb> {
        let climb = Climb {
            min_altitude_m: self.min_altitude_m?,
            max_altitude_m: self.max_altitude_m?,
            max_climb_mps: self.max_climb_mps?,
        };
        (self.altitude == AltitudeMode::Free).then_some(climb)
    }
}

crate::keys! {
    /// `[uav.propulsion]`: a rotary-wing aircraft in the model of Zeng, Xu and Zhang, "Energy Minimization for Wireless
    /// Communication With Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, with the values of its table I.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct Propulsion {
        /// Blade profile power in hovering, `P_0` [W].
        blade_profile_w: f64 = 79.86, POSITIVE;
        /// Induced power in hovering, `P_i` [W].
        induced_w: f64 = 88.63, POSITIVE;
        /// Speed of the rotor's blade tips, `U_tip` [m/s].
        tip_speed_mps: f64 = 120.0, POSITIVE;
        /// Mean rotor induced velocity in hovering, `v_0` [m/s].
        hover_induced_mps: f64 = 4.03, POSITIVE;
        /// Fuselage drag ratio, `d_0`.
        drag_ratio: f64 = 0.6, NOT_NEGATIVE;
        /// Air density, `ρ` [kg/m³].
        air_density_kgpm3: f64 = 1.225, POSITIVE;
        /// Rotor solidity, `s`.
        rotor_solidity: f64 = 0.05, POSITIVE;
        /// Rotor disc area, `A` [m²].
        rotor_disc_m2: f64 = 0.503, POSITIVE;
    }
}

/// Where waypoints may lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Moves {
    /// Anywhere in the area.
    Free,
    /// On the lines between the middles of neighbouring cells.
    Grid,
}

/// Whether the UAV may change its altitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum AltitudeMode {
    /// Constant altitude.
    Fixed,
    /// The UAV climbs and descends within a range.
    Free,
}
