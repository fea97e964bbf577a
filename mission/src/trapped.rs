//! Whether a UAV is trapped: whether it stays in one part of the area.

use skysink_common::geometry::{Position, within};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

/// Fraction of the sensor nodes that are beyond the flight of a trapped UAV.
const TRAPPED: f64 = 0.25;

/// Where the UAV has been in the second half of a mission.
#[derive(Debug)]
pub struct Stay {
    /// Positions of the sensor nodes, and what extends the flight [m].
    sensors: Vec<Position>,
    comm_radius_m: f64,
    /// The last slot of the first half of the mission.
    half: u64,
    /// The corners of the smallest box around the waypoints after it; `None` before.
    corners: Option<[Position; 2]>,
}

impl Stay {
    /// Before slot 1.
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        Self {
            sensors: list.sensors().iter().map(|sensor| sensor.position).collect(),
            comm_radius_m: scenario.link.comm_radius_m,
            half: scenario.slots / 2,
            corners: None,
        }
    }

    /// Adds the waypoint of `slot`, from 1.
    pub fn add(&mut self, slot: u64, waypoint: Position) {
        if slot > self.half {
            let [low, high] = self.corners.unwrap_or([waypoint; 2]);
            self.corners = Some([low.inf(&waypoint), high.sup(&waypoint)]);
        }
    }

    /// Whether more than a quarter of the sensor nodes lie beyond the box, enlarged by `d_c`.
    pub fn is_trapped(&self) -> bool {
        let Some([low, high]) = self.corners else { return false };
        let is_beyond = |sensor: &&Position| {
            let nearest = Position::new(sensor.x.clamp(low.x, high.x), sensor.y.clamp(low.y, high.y));
            !within(sensor, &nearest, self.comm_radius_m)
        };
        self.sensors.iter().filter(is_beyond).count() as f64 > TRAPPED * self.sensors.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    #[test]
    fn a_uav_is_trapped_if_its_second_half_never_nears_a_quarter_of_the_sensor_nodes() {
        let scenario = Scenario::parse("name = \"a\"\nslots = 4\n", Path::new("a.toml"), Overrides::default()).unwrap();
        let list = "x_m,y_m\n10,50\n30,50\n50,50\n60,50\n91,50\n";
        let list = SensorList::parse(list, Path::new("list.csv"), &scenario).unwrap();
        let is_trapped = |xs_m: &[f64]| {
            let mut stay = Stay::new(&scenario, &list);
            (1..).zip(xs_m).for_each(|(slot, &x_m)| stay.add(slot, Position::new(x_m, 50.0)));
            stay.is_trapped()
        };
        // From x = 40 to 50, with a range of 10 m: 10 and 91 are beyond, 2 of 5. From 20 to 80: 91 is, 1 of 5.
        assert!(is_trapped(&[10.0, 20.0, 40.0, 50.0]));
        assert!(!is_trapped(&[10.0, 20.0, 20.0, 80.0]));
        assert!(!is_trapped(&[10.0, 20.0]), "the second half has not begun");
    }
}
