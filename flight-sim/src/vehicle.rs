//! The UAV: where it is, and which waypoints it can reach.

use skysink_common::geometry::{Position, within};
use skysink_common::scenario::{Area, Scenario};

/// Slack at the area's border, relative to its longer side: a waypoint on the border may be rounded outside.
const BORDER_SLACK: f64 = 1e-9;

/// A UAV at a fixed altitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vehicle {
    position: Position,
    altitude_m: f64,
    reach_m: f64,
    area: Area,
}

impl Vehicle {
    /// The UAV of a scenario, where it starts.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            position: scenario.uav.start,
            altitude_m: scenario.uav.altitude_m,
            reach_m: scenario.reach_m(),
            area: scenario.area,
        }
    }

    /// Flies to `waypoint` if it lies in the area and in reach of one slot (UTS eq. 3); otherwise stays, and says false.
    #[must_use]
    pub fn fly_to(&mut self, waypoint: Position) -> bool {
        let slack_m = BORDER_SLACK * self.area.width_m.max(self.area.height_m);
        let possible = self.area.contains(&waypoint, slack_m) && within(&self.position, &waypoint, self.reach_m);
        if possible {
            self.position = waypoint;
        }
        possible
    }

    /// Where it is, on the ground.
    #[must_use]
    pub fn position(&self) -> Position {
        self.position
    }

    /// How high it is [m].
    #[must_use]
    pub fn altitude_m(&self) -> f64 {
        self.altitude_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;

    fn letter() -> Vehicle {
        Vehicle::new(&Scenario::letter(Overrides::default()).unwrap()) // at (50, 50), reach 30 m, area 100 m × 100 m
    }

    #[test]
    fn a_waypoint_in_reach_is_flown_to() {
        let mut vehicle = letter();
        assert!(vehicle.fly_to(Position::new(80.0, 50.0)));
        assert_eq!(vehicle.position(), Position::new(80.0, 50.0));
        assert!(vehicle.fly_to(Position::new(100.0, 50.0)), "the area is closed");
    }

    #[test]
    fn an_impossible_waypoint_is_a_hold() {
        for waypoint in [[80.001, 50.0], [f64::NAN, 50.0], [50.0, f64::INFINITY]] {
            let mut vehicle = letter();
            assert!(!vehicle.fly_to(Position::from(waypoint)), "{waypoint:?}");
            assert_eq!(vehicle.position(), Position::new(50.0, 50.0));
        }
        let mut vehicle = letter();
        assert!(vehicle.fly_to(Position::new(80.0, 50.0)));
        assert!(!vehicle.fly_to(Position::new(100.001, 50.0)), "outside the area");
    }
}
