//! The UAV: its position, the waypoints that it can reach, and where it ends beside them.

use std::sync::Arc;

use nalgebra::{Point3, Vector2};
use skysink_common::airspace::Airspace;
use skysink_common::base::Base;
use skysink_common::battery::Battery;
use skysink_common::geometry::{Position, above};
use skysink_common::message::HoldReason;
use skysink_common::scenario::Scenario;
use skysink_common::slack::ALTITUDE_SLACK;

/// A UAV at a fixed altitude, or with a range of altitudes.
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle {
    /// Clones share it, so that many missions fit into a cache.
    scenario: Arc<Scenario>,
    /// Position [m].
    pub position: Point3<f64>,
    /// Energy in the battery [J]; infinite without one.
    pub energy_j: f64,
    /// Slots that a swap of the battery has taken so far; 0 outside of one.
    pub(crate) swapped_slots: u32,
    battery: Battery,
    base: Option<Base>,
    airspace: Arc<Airspace>,
}

impl Vehicle {
    /// The UAV of a scenario at its start.
    #[must_use]
    pub fn new(scenario: &Scenario) -> Self {
        let battery = Battery::of(scenario);
        Self {
            scenario: Arc::new(scenario.clone()),
            position: scenario.start(),
            energy_j: battery.initial_j,
            swapped_slots: 0,
            battery,
            base: scenario.landing_base(),
            airspace: Arc::new(scenario.airspace_of_slots()),
        }
    }

    /// Whether its energy has ended (decision D12).
    pub fn is_down(&self) -> bool {
        self.energy_j < 0.0
    }

    /// Replaces the energy of the model by a measured one [J], if there is a battery; otherwise the energy stays
    /// infinite.
    pub fn correct_energy(&mut self, energy_j: f64) {
        if !self.battery.is_endless() {
            self.energy_j = energy_j;
        }
    }

    /// Whether `ground` [m] lies in the base.
    pub fn is_base(&self, ground: &Position) -> bool {
        self.base.as_ref().is_some_and(|base| base.contains(ground))
    }

    /// Moves to `position` [m], wherever it lies, with the energy that the flight of a slot takes.
    pub fn move_to(&mut self, position: Point3<f64>) {
        self.energy_j = self.battery.flown_j(self.energy_j, &self.position, &position);
        self.position = position;
        self.swapped_slots = 0;
    }

    /// Charges for a slot, if it is in the base; otherwise hovers, and returns false.
    #[must_use]
    pub fn charge(&mut self) -> bool {
        if !self.is_base(&self.position.xy()) {
            self.move_to(self.position);
            return false;
        }
        let charger = self.base.as_ref().and_then(|base| base.charger_at(&self.position.xy()));
        let battery = charger.map_or(self.battery, |charger| self.battery.at(charger));
        let is_swapping = battery.is_swapped() && self.energy_j < battery.capacity_j;
        self.swapped_slots = if is_swapping { self.swapped_slots.saturating_add(1) } else { 0 };
        self.energy_j = match is_swapping {
            true => battery.charged_for_j(self.energy_j, self.swapped_slots.into()),
            false => battery.charged_j(self.energy_j),
        };
        true
    }

    /// The site of several bases on one of whose pads it would charge now: it is there, the site charges, and the
    /// battery is not full. `None` in a single base, which has a pad for everybody.
    pub(crate) fn pad_site(&self) -> Option<usize> {
        let base = self.base.as_ref()?;
        let site = base.site_at(&self.position.xy())?;
        let is_low = self.energy_j < self.battery.capacity_j;
        (is_low && base.sites()[site].charger.charges()).then_some(site)
    }

    /// Flies to `waypoint` [m] if it lies in the area and in reach of one slot (UTS eq. 3, and the climb), and if no
    /// zone is in the way (decision D14); otherwise hovers, and says why. At a fixed altitude, the altitude of the
    /// waypoint only has to be finite.
    ///
    /// With an error `error_m` [m] the slot ends beside the waypoint, but in the area, in reach (decision D29) and
    /// outside of zones.
    pub fn fly_to(&mut self, waypoint: Point3<f64>, error_m: Option<Vector2<f64>>) -> HoldReason {
        let area = &self.scenario.area;
        let border_m = area.border_slack_m();
        let ground = waypoint.xy();
        let is_in_reach = area.contains(&ground, border_m) && self.scenario.reaches(&self.position.xy(), &ground);
        let [lowest_m, highest_m] = self.scenario.altitudes_m(self.position.z);
        let z_m = match self.scenario.uav.climb() {
            None if waypoint.z.is_finite() => self.position.z,
            _ => waypoint.z,
        };
        let slack_m = ALTITUDE_SLACK * highest_m;
        let is_possible = is_in_reach && (lowest_m - slack_m..=highest_m + slack_m).contains(&z_m);
        let z_m = z_m.clamp(lowest_m, highest_m);
        let from = self.position.xy();
        let z_range_m = [self.position.z, z_m];
        let hold = if !is_possible || !self.airspace.is_move(&from, &ground) {
            HoldReason::Waypoint
        } else if self.airspace.entry(&from, &ground, z_range_m, border_m).is_some() {
            HoldReason::Zone
        } else {
            HoldReason::None
        };
        let end = if hold == HoldReason::None {
            let ground = error_m.map_or(ground, |error_m| self.end_beside(&(ground + error_m), z_range_m));
            above(&ground, z_m)
        } else {
            self.position
        };
        self.move_to(end);
        hold
    }

    /// Why [`Self::fly_to`] would refuse `waypoint` [m] from here; [`HoldReason::None`] if it would not. Where the
    /// altitude is fixed, that of the vehicle does not matter. One outside the area may come back from any distance.
    pub(crate) fn refusal(&self, waypoint: Point3<f64>) -> HoldReason {
        let mut trial = self.clone();
        trial.position.z = self.scenario.uav.fixed_altitude_m().unwrap_or(trial.position.z);
        if !self.scenario.area.contains(&self.position.xy(), 0.0)
            && waypoint.iter().all(|coordinate| coordinate.is_finite())
        {
            trial.position = above(&waypoint.xy(), trial.position.z);
        }
        trial.fly_to(waypoint, None)
    }

    /// The end of a slot toward `ground`: the nearest point of the area, as far as it is in reach and before a zone,
    /// between the altitudes `z_m` [m] at its ends.
    fn end_beside(&self, ground: &Position, z_m: [f64; 2]) -> Position {
        let area = &self.scenario.area;
        let inside = Position::new(ground.x.clamp(0.0, area.width_m()), ground.y.clamp(0.0, area.height_m()));
        let from = self.position.xy();
        let end = self.scenario.end_toward(&from, &inside); // between two points of the area, which is convex
        self.airspace.last_free(&from, &end, z_m)
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
    fn a_waypoint_in_reach_is_reached() {
        let mut vehicle = vehicle();
        assert_eq!(vehicle.fly_to(Point3::new(80.0, 50.0, 20.0), None), HoldReason::None);
        assert_eq!(vehicle.position, Point3::new(80.0, 50.0, 20.0));
        assert_eq!(vehicle.fly_to(Point3::new(100.0, 50.0, 20.0), None), HoldReason::None, "the area is closed");
    }

    #[test]
    fn a_climb_is_limited_by_its_speed_and_its_range() {
        let text =
            "name = \"x\"\n[link]\nmodel = \"probabilistic-los\"\n[uav]\naltitude = \"free\"\naltitude_m = 118.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        for (z_m, possible) in [(120.0, true), (120.1, false), (113.0, true), (112.9, false), (f64::NAN, false)] {
            let mut vehicle = Vehicle::new(&scenario); // 5 m a slot, from 20 to 120 m
            let is_flown = vehicle.fly_to(Point3::new(50.0, 50.0, z_m), None) == HoldReason::None;
            assert_eq!(is_flown, possible, "{z_m}");
            assert_eq!(vehicle.position.z, if possible { z_m } else { 118.0 });
        }
        let mut vehicle = Vehicle::new(&scenario);
        assert_eq!(vehicle.fly_to(Point3::new(50.0, 50.0, 120.0 + 1e-8), None), HoldReason::None);
        assert_eq!(vehicle.position.z, 120.0, "rounding leads no higher");
    }

    #[test]
    fn a_fixed_altitude_is_kept_for_any_waypoint() {
        let mut vehicle = vehicle();
        assert_eq!(vehicle.fly_to(Point3::new(50.0, 50.0, 99.0), None), HoldReason::None);
        assert_eq!(vehicle.position.z, 20.0);
        assert_eq!(vehicle.fly_to(Point3::new(50.0, 50.0, f64::INFINITY), None), HoldReason::Waypoint);
    }

    #[test]
    fn a_refused_plan_moves_no_uav_and_a_fixed_altitude_is_not_checked() {
        let mut vehicle = vehicle();
        vehicle.position.z = 19.7;
        let before = vehicle.clone();
        assert_eq!(vehicle.refusal(Point3::new(80.0, 50.0, 20.0)), HoldReason::None);
        assert_eq!(vehicle.refusal(Point3::new(80.1, 50.0, 20.0)), HoldReason::Waypoint);
        assert_eq!(vehicle, before);
        vehicle.position.x = 500.0;
        assert_eq!(vehicle.refusal(Point3::new(80.1, 50.0, 20.0)), HoldReason::None, "back into the area");
        assert_eq!(vehicle.refusal(Point3::new(100.1, 50.0, 20.0)), HoldReason::Waypoint);
    }

    #[test]
    fn an_impossible_waypoint_is_a_hold() {
        for waypoint in [[80.001, 50.0, 20.0], [f64::NAN, 50.0, 20.0], [50.0, f64::INFINITY, 20.0]] {
            let mut vehicle = vehicle();
            assert_eq!(vehicle.fly_to(Point3::from(waypoint), None), HoldReason::Waypoint, "{waypoint:?}");
            assert_eq!(vehicle.position, Point3::new(50.0, 50.0, 20.0));
        }
        let mut vehicle = vehicle();
        assert_eq!(vehicle.fly_to(Point3::new(80.0, 50.0, 20.0), None), HoldReason::None);
        assert_eq!(vehicle.fly_to(Point3::new(100.001, 50.0, 20.0), None), HoldReason::Waypoint, "outside the area");
    }

    /// At (50, 50) with a no-fly zone of 10 m × 10 m, 10 m to the east, and a building of 30 m to the west.
    fn hemmed_in(uav: &str) -> Vehicle {
        let text = format!(
            "name = 'x'\n[area]\nno_fly = [{{ polygon_m = [[60.0, 45.0], [70.0, 45.0], [70.0, 55.0], [60.0, 55.0]] }}]\n\
             building = [{{ polygon_m = [[30.0, 45.0], [40.0, 45.0], [40.0, 55.0], [30.0, 55.0]], height_m = 30.0 }}]\n\
             [uav]\n{uav}"
        );
        Vehicle::new(&Scenario::parse(&text, std::path::Path::new("x.toml"), Overrides::default()).unwrap())
    }

    #[test]
    fn a_waypoint_in_or_behind_a_zone_is_a_hold() {
        for (x_m, y_m, expected) in [
            (65.0, 50.0, HoldReason::Zone),
            (75.0, 50.0, HoldReason::Zone),
            (60.0, 50.0, HoldReason::None),
            (70.0, 60.0, HoldReason::None),
            (35.0, 50.0, HoldReason::Zone),
        ] {
            let mut vehicle = hemmed_in("");
            assert_eq!(vehicle.fly_to(Point3::new(x_m, y_m, 20.0), None), expected, "({x_m}, {y_m})");
            assert_eq!(vehicle.position.x, if expected == HoldReason::None { x_m } else { 50.0 });
        }
        assert_eq!(
            hemmed_in("altitude_m = 30.0\n").fly_to(Point3::new(35.0, 50.0, 30.0), None),
            HoldReason::None,
            "over it"
        );
    }

    #[test]
    fn a_position_error_does_not_enter_a_zone() {
        let mut vehicle = hemmed_in("position_error_m = 1.0\n");
        assert_eq!(vehicle.fly_to(Point3::new(59.0, 50.0, 20.0), Some(Vector2::new(5.0, 1.0))), HoldReason::None);
        assert!((60.0 - 1e-5..60.0).contains(&vehicle.position.x), "{}", vehicle.position);
    }

    #[test]
    fn a_uav_over_a_building_does_not_descend_into_it() {
        let text = "name = 'x'\n[area]\nbuilding = [{ polygon_m = [[40, 40], [60, 40], [60, 60], [40, 60]], height_m = 30.0 }]\n\
                    [link]\nmodel = 'probabilistic-los'\n[uav]\naltitude = 'free'\naltitude_m = 32.0\nstart_m = [70.0, 50.0]\n";
        let scenario = Scenario::parse(text, std::path::Path::new("x.toml"), Overrides::default()).unwrap();
        let mut vehicle = Vehicle::new(&scenario);
        assert_eq!(vehicle.fly_to(Point3::new(50.0, 50.0, 31.0), None), HoldReason::None, "over it");
        assert_eq!(vehicle.fly_to(Point3::new(50.0, 50.0, 29.0), None), HoldReason::Zone, "down into it");
        assert_eq!(vehicle.fly_to(Point3::new(70.0, 50.0, 29.0), None), HoldReason::Zone, "down beside it, through it");
        assert_eq!(vehicle.fly_to(Point3::new(70.0, 50.0, 30.0), None), HoldReason::None);
        assert_eq!(vehicle.fly_to(Point3::new(50.0, 50.0, 29.0), None), HoldReason::Zone, "from beside");
    }
}
