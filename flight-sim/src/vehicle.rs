//! The UAV: where it is, and which waypoints it can reach.

use skysink_common::geometry::{Position, within};
use skysink_common::scenario::Scenario;

/// Slack at the area's border and at the ends of a climb, relative to them: a waypoint on them may be rounded outside.
const SLACK: f64 = 1e-9;

/// A UAV at a fixed altitude, or with a range of altitudes.
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle {
    scenario: Scenario,
    position: Position,
    altitude_m: f64,
}

impl Vehicle {
    /// The UAV of a scenario, where it starts.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let (position, altitude_m) = (scenario.uav.start, scenario.uav.altitude_m);
        Self { scenario: scenario.clone(), position, altitude_m }
    }

    /// Flies to `waypoint` at `altitude_m` [m] if it lies in the area and in reach of one slot (UTS eq. 3, and the climb);
    /// otherwise stays, and says false. At a fixed altitude only a number is asked for, and it stays at its own.
    #[must_use]
    pub fn fly_to(&mut self, waypoint: Position, altitude_m: f64) -> bool {
        let area = self.scenario.area;
        let border_m = SLACK * area.width_m.max(area.height_m);
        let over = area.contains(&waypoint, border_m) && within(&self.position, &waypoint, self.scenario.reach_m());
        let [lowest_m, highest_m] = self.scenario.altitudes_m(self.altitude_m);
        let altitude_m = match self.scenario.uav.climb {
            None if altitude_m.is_finite() => self.altitude_m,
            _ => altitude_m,
        };
        let slack_m = SLACK * highest_m;
        let possible = over && (lowest_m - slack_m..=highest_m + slack_m).contains(&altitude_m);
        if possible {
            self.position = waypoint;
            self.altitude_m = altitude_m.clamp(lowest_m, highest_m);
        }
        possible
    }

    /// Puts it where it has been before, wherever it is now.
    pub fn take_over(&mut self, position: Position, altitude_m: f64) {
        (self.position, self.altitude_m) = (position, altitude_m);
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
        assert!(vehicle.fly_to(Position::new(80.0, 50.0), 20.0));
        assert_eq!(vehicle.position(), Position::new(80.0, 50.0));
        assert!(vehicle.fly_to(Position::new(100.0, 50.0), 20.0), "the area is closed");
    }

    #[test]
    fn a_climb_ends_at_its_speed_and_its_range() {
        let text =
            "name = \"x\"\n[link]\nmodel = \"probabilistic-los\"\n[uav]\naltitude = \"free\"\naltitude_m = 118.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        let here = Position::new(50.0, 50.0);
        for (altitude_m, possible) in [(120.0, true), (120.1, false), (113.0, true), (112.9, false), (f64::NAN, false)]
        {
            let mut vehicle = Vehicle::new(&scenario); // 5 m a slot, from 20 to 120 m
            assert_eq!(vehicle.fly_to(here, altitude_m), possible, "{altitude_m}");
            assert_eq!(vehicle.altitude_m(), if possible { altitude_m } else { 118.0 });
        }
    }

    #[test]
    fn a_fixed_altitude_stays_whatever_is_asked_for() {
        let mut vehicle = letter();
        assert!(vehicle.fly_to(Position::new(50.0, 50.0), 99.0));
        assert_eq!(vehicle.altitude_m(), 20.0);
        assert!(!vehicle.fly_to(Position::new(50.0, 50.0), f64::INFINITY));
    }

    #[test]
    fn an_impossible_waypoint_is_a_hold() {
        for waypoint in [[80.001, 50.0], [f64::NAN, 50.0], [50.0, f64::INFINITY]] {
            let mut vehicle = letter();
            assert!(!vehicle.fly_to(Position::from(waypoint), 20.0), "{waypoint:?}");
            assert_eq!(vehicle.position(), Position::new(50.0, 50.0));
        }
        let mut vehicle = letter();
        assert!(vehicle.fly_to(Position::new(80.0, 50.0), 20.0));
        assert!(!vehicle.fly_to(Position::new(100.001, 50.0), 20.0), "outside the area");
    }
}
