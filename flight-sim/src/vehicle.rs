//! The UAV: its position, the waypoints that it can reach, and where it ends beside them.

use std::sync::Arc;

use nalgebra::{Point3, Vector2};
use skysink_common::battery::{Base, Battery};
use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;

/// Relative slack at the border of the area and at the limits of a climb, for waypoints that are rounded outside.
const SLACK: f64 = 1e-9;

/// A UAV at a fixed altitude, or with a range of altitudes.
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle {
    /// Clones share it, so that many missions fit into a cache.
    scenario: Arc<Scenario>,
    /// Position [m].
    pub position: Point3<f64>,
    /// Energy in the battery [J]; infinite without one.
    pub energy_j: f64,
    battery: Option<Battery>,
    base: Option<Base>,
}

impl Vehicle {
    /// The UAV of a scenario at its start.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let battery = Battery::of(scenario);
        Self {
            scenario: Arc::new(scenario.clone()),
            position: scenario.start(),
            energy_j: battery.map_or(f64::INFINITY, |battery| battery.initial_j),
            battery,
            base: Base::of(scenario),
        }
    }

    /// Whether its energy has ended (decision D12).
    #[must_use]
    pub fn is_down(&self) -> bool {
        self.energy_j < 0.0
    }

    /// Moves to `position` [m], wherever it lies, with the energy that the flight of a slot takes.
    pub fn move_to(&mut self, position: Point3<f64>) {
        if let Some(battery) = &self.battery {
            self.energy_j = battery.flown_j(self.energy_j, &self.position, &position);
        }
        self.position = position;
    }

    /// Charges for a slot, if it is in the base; otherwise hovers, and returns false.
    #[must_use]
    pub fn charge(&mut self) -> bool {
        let is_in_base = self.base.is_some_and(|base| base.contains(&self.position.xy()));
        match &self.battery {
            Some(battery) if is_in_base => self.energy_j = battery.charged_j(self.energy_j),
            _ => self.move_to(self.position),
        }
        is_in_base
    }

    /// Flies to `waypoint` [m] if it lies in the area and in reach of one slot (UTS eq. 3, and the climb); otherwise
    /// hovers and returns false. At a fixed altitude, the altitude of the waypoint only has to be finite.
    ///
    /// With an error `error_m` [m] the slot ends beside the waypoint, but in the area and in reach (decision D29).
    #[must_use]
    pub fn fly_to(&mut self, waypoint: Point3<f64>, error_m: Option<Vector2<f64>>) -> bool {
        let area = self.scenario.area;
        let border_m = SLACK * area.width_m().max(area.height_m());
        let ground = waypoint.xy();
        let is_in_reach = area.contains(&ground, border_m) && self.scenario.reaches(&self.position.xy(), &ground);
        let [lowest_m, highest_m] = self.scenario.altitudes_m(self.position.z);
        let z_m = match self.scenario.uav.climb() {
            None if waypoint.z.is_finite() => self.position.z,
            _ => waypoint.z,
        };
        let slack_m = SLACK * highest_m;
        let is_possible = is_in_reach && (lowest_m - slack_m..=highest_m + slack_m).contains(&z_m);
        let end = if is_possible {
            let ground = error_m.map_or(ground, |error_m| self.end_beside(&(ground + error_m)));
            Point3::new(ground.x, ground.y, z_m.clamp(lowest_m, highest_m))
        } else {
            self.position
        };
        self.move_to(end);
        is_possible
    }

    /// The end of a slot toward `ground`: the nearest point of the area, as far as it is in reach.
    fn end_beside(&self, ground: &Position) -> Position {
        let area = self.scenario.area;
        let inside = Position::new(ground.x.clamp(0.0, area.width_m()), ground.y.clamp(0.0, area.height_m()));
        self.scenario.end_toward(&self.position.xy(), &inside) // between two points of the area, which is convex
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;

    fn vehicle() -> Vehicle {
        Vehicle::new(&Scenario::letter(Overrides::default()).unwrap()) // at (50, 50), reach 30 m, area 100 m × 100 m
    }

    #[test]
    fn a_waypoint_in_reach_is_flown_to() {
        let mut vehicle = vehicle();
        assert!(vehicle.fly_to(Point3::new(80.0, 50.0, 20.0), None));
        assert_eq!(vehicle.position, Point3::new(80.0, 50.0, 20.0));
        assert!(vehicle.fly_to(Point3::new(100.0, 50.0, 20.0), None), "the area is closed");
    }

    #[test]
    fn a_climb_is_limited_by_its_speed_and_its_range() {
        let text =
            "name = \"x\"\n[link]\nmodel = \"probabilistic-los\"\n[uav]\naltitude = \"free\"\naltitude_m = 118.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        for (z_m, possible) in [(120.0, true), (120.1, false), (113.0, true), (112.9, false), (f64::NAN, false)] {
            let mut vehicle = Vehicle::new(&scenario); // 5 m a slot, from 20 to 120 m
            assert_eq!(vehicle.fly_to(Point3::new(50.0, 50.0, z_m), None), possible, "{z_m}");
            assert_eq!(vehicle.position.z, if possible { z_m } else { 118.0 });
        }
        let mut vehicle = Vehicle::new(&scenario);
        assert!(vehicle.fly_to(Point3::new(50.0, 50.0, 120.0 + 1e-8), None));
        assert_eq!(vehicle.position.z, 120.0, "rounding leads no higher");
    }

    #[test]
    fn a_fixed_altitude_is_kept_for_any_waypoint() {
        let mut vehicle = vehicle();
        assert!(vehicle.fly_to(Point3::new(50.0, 50.0, 99.0), None));
        assert_eq!(vehicle.position.z, 20.0);
        assert!(!vehicle.fly_to(Point3::new(50.0, 50.0, f64::INFINITY), None));
    }

    #[test]
    fn an_impossible_waypoint_is_a_hold() {
        for waypoint in [[80.001, 50.0, 20.0], [f64::NAN, 50.0, 20.0], [50.0, f64::INFINITY, 20.0]] {
            let mut vehicle = vehicle();
            assert!(!vehicle.fly_to(Point3::from(waypoint), None), "{waypoint:?}");
            assert_eq!(vehicle.position, Point3::new(50.0, 50.0, 20.0));
        }
        let mut vehicle = vehicle();
        assert!(vehicle.fly_to(Point3::new(80.0, 50.0, 20.0), None));
        assert!(!vehicle.fly_to(Point3::new(100.001, 50.0, 20.0), None), "outside the area");
    }
}
