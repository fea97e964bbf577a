//! The constant data of a mission for planning: the sensor nodes, their channel and the UAV's limits.

use std::ops::Range;

use nalgebra::Point3;
use skysink_common::channel::{Channel, Uplink};
use skysink_common::geometry::Position;
use skysink_common::message::SensorNode;
use skysink_common::scenario::{Area, Scenario};

use crate::geometry::grid::Grid;

/// The sensor nodes (SNs) and the constraints on a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorTable {
    /// Positions of the SNs, `L_i`, by id.
    pub positions: Vec<Position>,
    /// Spatial index of `positions`, in cells of the side `d_c`. Must be rebuilt if they change.
    pub grid: Grid,
    /// Their reference channel gains at 1 m, `α_i`, as linear ratios, by id.
    pub gains: Vec<f64>,
    /// The channel of all uplinks.
    pub channel: Channel,
    /// The area that the UAV must not leave.
    pub area: Area,
    /// Farthest flight in one slot, `V_max τ` [m].
    pub reach_m: f64,
    /// Communication radius on the ground, `d_c` [m].
    pub comm_radius_m: f64,
    /// Resource blocks, `n`: the most SNs served in a slot, at least 1.
    pub resource_blocks: usize,
}

impl SensorTable {
    /// The table of a scenario with these SNs.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &[SensorNode]) -> Self {
        let positions: Vec<Position> = sensors.iter().map(|sensor| Position::new(sensor.x_m, sensor.y_m)).collect();
        Self {
            grid: Grid::new(&positions, scenario.link.comm_radius_m),
            positions,
            gains: sensors.iter().map(|sensor| sensor.gain).collect(),
            channel: Channel::of(scenario),
            area: scenario.area,
            reach_m: scenario.reach_m(),
            comm_radius_m: scenario.link.comm_radius_m,
            resource_blocks: scenario.link.resource_blocks,
        }
    }

    /// The ids of all SNs, ascending.
    ///
    /// # Panics
    /// If there are more SNs than ids; a scenario has at most 10^7 SNs.
    #[must_use]
    pub fn ids(&self) -> Range<u32> {
        0..u32::try_from(self.positions.len()).expect("a scenario has at most 10^7 sensor nodes")
    }

    /// Position of SN `id`.
    #[must_use]
    pub fn position(&self, id: u32) -> &Position {
        &self.positions[id as usize]
    }

    /// Expected bits collected from the SNs `ids` with the UAV at `uav`: `Σ min(floor(r_i τ_c), B_i(t−1))`, with the
    /// expected rates `r_i`.
    #[must_use]
    pub fn expected_bits(&self, uav: &Point3<f64>, ids: &[u32], queues_bits: &[u32]) -> u64 {
        let uplink = |id: u32| Uplink::new(self.gains[id as usize], self.position(id), uav);
        let capacity_bits = |id: u32| self.channel.capacity_bits(self.channel.expected_rate_bps(&uplink(id)));
        ids.iter().map(|&id| capacity_bits(id).min(u64::from(queues_bits[id as usize]))).sum()
    }

    /// The point of the area nearest to `position`.
    ///
    /// The area is convex and contains the SNs and the UAV, so the result is nearer to each of them: a waypoint that
    /// rounding put outside stays in range and in reach.
    #[must_use]
    pub fn clamp_to_area(&self, position: &Position) -> Position {
        Position::new(position.x.clamp(0.0, self.area.width_m()), position.y.clamp(0.0, self.area.height_m()))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::path::Path;

    use skysink_common::message::Limits;
    use skysink_common::scenario::Overrides;

    /// The paper's field (d_c = 10 m, V τ = 30 m, n = 4) of 100 m × 100 m with SNs of gain −52 dB at `positions_m` [m].
    pub(crate) fn table_of(positions_m: &[[f64; 2]]) -> SensorTable {
        let sensor = |&[x_m, y_m]: &[f64; 2]| SensorNode { x_m, y_m, gain: 10f64.powf(-5.2), ..SensorNode::default() };
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        SensorTable::new(&scenario, &positions_m.iter().map(sensor).collect::<Vec<_>>())
    }

    #[test]
    fn a_scenario_becomes_a_table_in_its_units() {
        let text = "name = 'a'\nslot_s = 0.5\n[area]\nwidth_m = 80.0\nheight_m = 60.0\n[link]\ncomm_radius_m = 7.0\n";
        let scenario = Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap();
        let table =
            SensorTable::new(&scenario, &[SensorNode { x_m: 1.0, y_m: 2.0, gain: 1e-5, ..SensorNode::default() }]);
        assert_eq!((table.reach_m, table.comm_radius_m, table.resource_blocks), (15.0, 7.0, 4)); // 30 m/s · 0.5 s
        assert_eq!((table.positions[0], table.gains[0]), (Position::new(1.0, 2.0), 1e-5));
        assert_eq!(table.area, Area::new(80.0, 60.0));
    }

    #[test]
    fn the_limits_that_the_ring_carries_are_those_of_the_table() {
        let scenarios = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios");
        for name in ["letter", "smoke", "sparse", "plos-suburban"] {
            let path = format!("{scenarios}/{name}.toml");
            let scenario = Scenario::read(Path::new(&path), Overrides::default()).unwrap();
            let limits = Limits::of(&scenario);
            let table = SensorTable::new(&scenario, &[]);
            assert_eq!((limits.reach_m, limits.comm_radius_m), (table.reach_m, table.comm_radius_m), "{name}");
            assert_eq!(limits.resource_blocks as usize, table.resource_blocks, "{name}");
            assert_eq!([limits.width_m, limits.height_m], [table.area.width_m(), table.area.height_m()], "{name}");
            let lowest_m = limits.min_altitude_m;
            let reached_m = [lowest_m, (lowest_m + limits.climb_m).min(limits.max_altitude_m)];
            assert_eq!(scenario.altitudes_m(lowest_m), reached_m, "{name}");
        }
    }

    #[test]
    fn a_visit_is_expected_to_collect_the_queue_or_what_the_link_carries() {
        let mut table = table_of(&[[50.0, 50.0], [50.0, 60.0]]);
        let waypoint = Point3::new(50.0, 50.0, 20.0);
        // The letter's links carry about 6 Mbit in a slot: both queues are emptied.
        assert_eq!(table.expected_bits(&waypoint, &[0, 1], &[9_000, 12_000]), 21_000);
        // W = 5 kHz, γ = 10^−5.2 · 0.05/10^−13 = 3.1548e6. SN 0: x = 400, 500 · log2(1 + 7886.98) = 500 · 12.94545 =
        // 6472.7 bit; SN 1: x = 500, 500 · log2(1 + 6309.57) = 500 · 12.62357 = 6311.8 bit, but it holds only 100.
        let Channel::FreeSpace(model) = &mut table.channel else { panic!("the letter's channel is free space") };
        model.bandwidth_hz = 5e3;
        assert_eq!(table.expected_bits(&waypoint, &[0, 1], &[9_000, 12_000]), 6_472 + 6_311);
        assert_eq!(table.expected_bits(&waypoint, &[0, 1], &[9_000, 100]), 6_472 + 100);
    }

    #[test]
    fn a_point_outside_the_area_moves_to_its_border() {
        let table = table_of(&[[50.0, 50.0]]);
        assert_eq!(table.clamp_to_area(&Position::new(-1e-9, 100.1)), Position::new(0.0, 100.0));
        assert_eq!(table.clamp_to_area(&Position::new(3.0, 4.0)), Position::new(3.0, 4.0));
    }
}
