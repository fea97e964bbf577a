//! Whether a mission is trapped: whether its UAVs stay in one part of the area.

use skysink_common::geometry::{Position, within};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::ByUav;

/// Fraction of the sensor nodes that are beyond all flights of a trapped mission.
const TRAPPED: f64 = 0.25;

/// Where the UAVs have been in the second half of a mission.
#[derive(Debug)]
pub struct Stay {
    /// Positions of the sensor nodes, and what extends the flight [m].
    sensors: Vec<Position>,
    comm_radius_m: f64,
    /// The last slot of the first half of the mission.
    half: u64,
    /// By UAV: the corners of the smallest box around its waypoints after it; empty before.
    boxes: ByUav<[Position; 2]>,
}

impl Stay {
    /// Before slot 1.
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        Self {
            sensors: list.sensors().iter().map(|sensor| sensor.position).collect(),
            comm_radius_m: scenario.link.comm_radius_m,
            half: scenario.slots / 2,
            boxes: ByUav::new(),
        }
    }

    /// Adds the waypoints of `slot`, from 1, by UAV.
    pub fn add(&mut self, slot: u64, waypoints: impl Iterator<Item = Position>) {
        if slot <= self.half {
            return;
        }
        for (uav, waypoint) in waypoints.enumerate() {
            match self.boxes.get_mut(uav) {
                Some([low, high]) => [*low, *high] = [low.inf(&waypoint), high.sup(&waypoint)],
                None => self.boxes.push([waypoint; 2]),
            }
        }
    }

    /// Whether more than a quarter of the sensor nodes lie beyond the boxes of all UAVs, enlarged by `d_c`.
    pub fn is_trapped(&self) -> bool {
        if self.boxes.is_empty() {
            return false;
        }
        let is_near = |sensor: &Position, [low, high]: &[Position; 2]| {
            let nearest = Position::new(sensor.x.clamp(low.x, high.x), sensor.y.clamp(low.y, high.y));
            within(sensor, &nearest, self.comm_radius_m)
        };
        let is_beyond = |sensor: &&Position| !self.boxes.iter().any(|corners| is_near(sensor, corners));
        self.sensors.iter().filter(is_beyond).count() as f64 > TRAPPED * self.sensors.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    /// Whether a mission of four slots is trapped in which the UAVs fly to these x [m] on the line y = 50 m, over
    /// sensor nodes with a range of 10 m at x = 10, 30, 50, 60 and 91 m.
    fn is_trapped<const UAVS: usize>(xs_m: &[[f64; UAVS]]) -> bool {
        let scenario = Scenario::parse("name = \"a\"\nslots = 4\n", Path::new("a.toml"), Overrides::default()).unwrap();
        let list = "x_m,y_m\n10,50\n30,50\n50,50\n60,50\n91,50\n";
        let list = SensorList::parse(list, Path::new("list.csv"), &scenario).unwrap();
        let mut stay = Stay::new(&scenario, &list);
        for (slot, xs_m) in (1..).zip(xs_m) {
            stay.add(slot, xs_m.iter().map(|&x_m| Position::new(x_m, 50.0)));
        }
        stay.is_trapped()
    }

    #[test]
    fn a_uav_is_trapped_if_its_second_half_never_nears_a_quarter_of_the_sensor_nodes() {
        // From x = 40 to 50: 10 and 91 are beyond, 2 of 5. From 20 to 80: 91 is, 1 of 5.
        assert!(is_trapped(&[[10.0], [20.0], [40.0], [50.0]]));
        assert!(!is_trapped(&[[10.0], [20.0], [20.0], [80.0]]));
        assert!(!is_trapped(&[[10.0], [20.0]]), "the second half has not begun");
    }

    #[test]
    fn a_fleet_is_trapped_if_none_of_its_uavs_nears_a_quarter_of_the_sensor_nodes() {
        // The first alone, from x = 40 to 50, misses 10 and 91. The second, from 85 to 90, nears 91: 10 is left, 1 of 5.
        assert!(!is_trapped(&[[0.0, 0.0], [0.0, 0.0], [40.0, 85.0], [50.0, 90.0]]));
        // The second, from 50 to 60, nears 50 and 60, which the first nears, too: 10 and 91 are left, 2 of 5.
        assert!(is_trapped(&[[0.0, 0.0], [0.0, 0.0], [40.0, 50.0], [50.0, 60.0]]));
        // One box around both, from 30 to 90, would near 50 and 60: 10 is left, 1 of 5. Each alone nears neither.
        assert!(is_trapped(&[[0.0, 0.0], [0.0, 0.0], [30.0, 90.0], [30.0, 90.0]]));
    }
}
