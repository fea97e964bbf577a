//! The constraints on every plan of a mission, published with the sensor nodes.

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "node")]
use iceoryx2::prelude::ZeroCopySend;

use crate::scenario::{Area, Scenario};

/// The constraints on every plan of a mission, so that a planner needs no scenario file.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "node", derive(ZeroCopySend), type_name("skysink.Limits.v2"))]
pub struct Limits {
    /// The area, 0 to this, east [m].
    pub width_m: f64,
    /// The area, 0 to this, north [m].
    pub height_m: f64,
    /// Horizontal distance that one slot reaches in every direction, `V_max τ` [m]; less with wind and acceleration.
    pub reach_m: f64,
    /// Farthest horizontal distance at which a sensor node can be served, `d_c` [m].
    pub comm_radius_m: f64,
    /// Length of a slot, `τ` [s].
    pub slot_s: f64,
    /// Time to communicate at the end of a slot, `τ_c` [s].
    pub comm_s: f64,
    /// Lowest altitude [m]; `H` where it is fixed.
    pub min_altitude_m: f64,
    /// Highest altitude [m]; `H` where it is fixed.
    pub max_altitude_m: f64,
    /// Farthest climb or descent in one slot [m]; 0 where the altitude is fixed.
    pub climb_m: f64,
    /// Slots of the mission, `T`.
    pub slots: u64,
    /// Resource blocks `n`: the most sensor nodes served in a slot.
    pub resource_blocks: u32,
    /// Zero.
    pub reserved: u32,
    /// Latitude of the south-west corner of the area [deg]; infinite without an origin.
    pub origin_lat_deg: f64,
    /// Longitude of the south-west corner of the area [deg]; infinite without an origin.
    pub origin_lon_deg: f64,
    /// Start of the first UAV, east, north, up [m].
    pub start_m: [f64; 3],
    /// Seed of the mission's draws.
    pub seed: u64,
}

impl Limits {
    /// The limits in a scenario.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        let climb = scenario.uav.climb();
        let altitude_m = scenario.uav.altitude_m;
        let origin = scenario.area.origin();
        Self {
            width_m: scenario.area.width_m(),
            height_m: scenario.area.height_m(),
            reach_m: scenario.reach_m(),
            comm_radius_m: scenario.link.comm_radius_m,
            slot_s: scenario.slot_s,
            comm_s: scenario.link.comm_s,
            min_altitude_m: climb.map_or(altitude_m, |climb| climb.min_altitude_m),
            max_altitude_m: climb.map_or(altitude_m, |climb| climb.max_altitude_m),
            climb_m: climb.map_or(0.0, |climb| climb.max_climb_mps * scenario.slot_s),
            slots: scenario.slots,
            resource_blocks: scenario.link.resource_blocks as u32, // at most MAX_RESOURCE_BLOCKS
            reserved: 0,
            origin_lat_deg: origin.map_or(f64::INFINITY, |origin| origin.lat_deg),
            origin_lon_deg: origin.map_or(f64::INFINITY, |origin| origin.lon_deg),
            start_m: scenario.start().into(),
            seed: scenario.seed,
        }
    }

    /// The area that the UAV must not leave.
    pub fn area(&self) -> Area {
        Area::new(self.width_m, self.height_m)
    }

    /// Resource blocks `n`, as a count.
    #[inline]
    pub fn blocks(&self) -> usize {
        self.resource_blocks as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Overrides;
    use std::path::Path;

    #[test]
    fn the_limits_are_those_of_the_scenario_in_its_units() {
        let text = "name = 'a'\nslots = 9\nslot_s = 0.5\n[area]\nwidth_m = 80.0\nheight_m = 60.0\n[link]\ncomm_s = 0.2\n\
                    comm_radius_m = 7.0\nresource_blocks = 3\n";
        let limits =
            |text: &str| Limits::of(&Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap());
        let fixed = Limits {
            width_m: 80.0,
            height_m: 60.0,
            reach_m: 15.0, // 30 m/s · 0.5 s
            comm_radius_m: 7.0,
            slot_s: 0.5,
            comm_s: 0.2,
            min_altitude_m: 20.0,
            max_altitude_m: 20.0,
            climb_m: 0.0,
            slots: 9,
            resource_blocks: 3,
            reserved: 0,
            origin_lat_deg: f64::INFINITY,
            origin_lon_deg: f64::INFINITY,
            start_m: [40.0, 30.0, 20.0],
            seed: 1,
        };
        assert_eq!(limits(text), fixed);
        assert_eq!((fixed.area(), fixed.blocks()), (Area::new(80.0, 60.0), 3));
        let climbing = "model = 'probabilistic-los'\nlos = { a = 9.61, b = 0.16 }\n[uav]\naltitude = 'free'\n\
                        min_altitude_m = 15.0\nmax_altitude_m = 90.0\nmax_climb_mps = 4.0\n";
        let free = Limits { min_altitude_m: 15.0, max_altitude_m: 90.0, climb_m: 2.0, ..fixed };
        assert_eq!(limits(&format!("{text}{climbing}")), free);
    }
}
