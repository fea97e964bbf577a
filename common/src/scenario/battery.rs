//! The energy of a UAV (decisions D10 to D12).
//!
//! When to fly home is left to the planner.

use nalgebra::{Point3, Vector3};

use crate::base::Charger;
use crate::propulsion::{farthest_mps, power_w};
use crate::scenario::{Propulsion, Scenario};

/// Weight of a UAV whose scenario does not say, as that of `uav.battery.weight_n` [N].
const WEIGHT_N: f64 = 20.0;

/// The state of a battery between two slots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BatteryState {
    /// Its energy, `E(t)` [J]; infinite without a battery.
    pub energy_j: f64,
    /// Whether it has charged in the slot before, or waited for a pad.
    pub is_charging: bool,
}

impl Default for BatteryState {
    /// Without a battery.
    fn default() -> Self {
        Self { energy_j: f64::INFINITY, is_charging: false }
    }
}

impl BatteryState {
    /// Before slot 1 of a scenario.
    #[must_use]
    pub fn initial(scenario: &Scenario) -> Self {
        Self { energy_j: Battery::of(scenario).initial_j, is_charging: false }
    }
}

/// The battery of a UAV, and what a slot takes from it. Without `[uav.battery]` it has no end: its capacity is
/// infinite.
///
/// `E(t) = E(t−1) − τ P(v) − w max(0, Δz)`, with the propulsion power P of [`power_w`] at the horizontal speed v.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Battery {
    /// Energy when full [J]; infinite without end.
    pub capacity_j: f64,
    /// Energy before slot 1 [J].
    pub initial_j: f64,
    /// Energy that is left after the way home [J].
    pub reserve_j: f64,
    aircraft: Propulsion,
    weight_n: f64,
    slot_s: f64,
    charge_w: f64,
    swap_slots: Option<u64>,
}

impl Battery {
    /// The battery of a scenario.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        let endless = Self {
            capacity_j: f64::INFINITY,
            initial_j: f64::INFINITY,
            reserve_j: 0.0,
            aircraft: scenario.uav.propulsion,
            weight_n: WEIGHT_N,
            slot_s: scenario.slot_s,
            charge_w: 0.0,
            swap_slots: None,
        };
        let Some(keys) = scenario.uav.battery else { return endless };
        Self {
            capacity_j: keys.capacity_j,
            initial_j: keys.capacity_j * keys.initial,
            reserve_j: keys.capacity_j * keys.reserve,
            weight_n: keys.weight_n,
            charge_w: scenario.base.as_ref().map_or(0.0, |base| base.charge_w),
            ..endless
        }
    }

    /// The battery of a scenario; `None` without end, for what is said or exported of batteries.
    #[must_use]
    pub fn finite(scenario: &Scenario) -> Option<Self> {
        Some(Self::of(scenario)).filter(|battery| !battery.is_endless())
    }

    /// Whether it has no end.
    #[inline]
    pub fn is_endless(&self) -> bool {
        self.capacity_j == f64::INFINITY
    }

    /// It beside the charger of a site (decision D34). Nothing charges a battery without end.
    #[must_use]
    pub fn at(self, charger: &Charger) -> Self {
        if self.is_endless() {
            return self;
        }
        Self { charge_w: charger.charge_w, swap_slots: charger.swap_slots, ..self }
    }

    /// Energy [J] that a slot over the horizontal distance `distance_m` [m] takes from it: nothing without end.
    #[inline]
    pub fn slot_j(&self, distance_m: f64) -> f64 {
        if self.is_endless() { 0.0 } else { self.leg_j(self.slot_s, distance_m, 0.0) }
    }

    /// Energy [J] of a flight of `duration_s` [s] over the horizontal distance `distance_m` with the climb `climb_m`
    /// [m].
    pub fn leg_j(&self, duration_s: f64, distance_m: f64, climb_m: f64) -> f64 {
        let speed_mps = if duration_s > 0.0 { distance_m / duration_s } else { 0.0 };
        duration_s * power_w(&self.aircraft, speed_mps) + self.climb_j(climb_m)
    }

    /// Energy [J] of flying `step` [m] in a slot (decision D10), also without end: then with the weight that
    /// `uav.battery.weight_n` has by default.
    pub fn flight_j(&self, step: &Vector3<f64>) -> f64 {
        self.leg_j(self.slot_s, step.xy().norm(), step.z)
    }

    fn climb_j(&self, climb_m: f64) -> f64 {
        self.weight_n * climb_m.max(0.0)
    }

    /// Energy [J] after a slot that begins with `energy_j` at `from` and ends at `to` [m].
    pub fn flown_j(&self, energy_j: f64, from: &Point3<f64>, to: &Point3<f64>) -> f64 {
        energy_j - self.slot_j((to.xy() - from.xy()).norm()) - self.climb_j(to.z - from.z)
    }

    /// Energy [J] after a slot in the base that begins with `energy_j` (decision D11).
    pub fn charged_j(&self, energy_j: f64) -> f64 {
        self.charged_for_j(energy_j, 1.0)
    }

    /// Energy [J] after the first `slots` slots of a stay in the base.
    pub fn charged_for_j(&self, energy_j: f64, slots: f64) -> f64 {
        if let Some(swap_slots) = self.swap_slots {
            return if slots >= swap_slots as f64 { self.capacity_j.max(energy_j) } else { energy_j };
        }
        (energy_j + slots * self.slot_s * self.charge_w).min(self.capacity_j).max(energy_j)
    }

    /// Whether a base charges it.
    pub fn is_charged(&self) -> bool {
        self.charge_w > 0.0 || self.swap_slots.is_some()
    }

    /// Whether it is swapped, after a number of slots, instead of charged.
    pub fn is_swapped(&self) -> bool {
        self.swap_slots.is_some()
    }

    /// Distance of a slot [m] at the speed of least energy per metre, at most `reach_m`, which it is without end.
    pub fn thrifty_m(&self, reach_m: f64) -> f64 {
        if self.is_endless() {
            return reach_m;
        }
        farthest_mps(&self.aircraft, reach_m / self.slot_s) * self.slot_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Overrides;
    use std::path::Path;

    fn scenario(more: &str) -> Scenario {
        let text = format!("name = 'a'\nslots = 10\nslot_s = 2.0\n[uav.battery]\ncapacity_j = 1000.0\n{more}");
        Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap()
    }

    #[test]
    fn energy_of_a_slot_is_power_and_climb_work() {
        let battery = Battery::of(&scenario("weight_n = 30.0\n"));
        let at = |x_m: f64, z_m: f64| Point3::new(x_m, 7.0, z_m);
        // Two seconds of hovering: 2 · (79.86 + 88.63) J.
        assert!((battery.flown_j(900.0, &at(1.0, 20.0), &at(1.0, 20.0)) - (900.0 - 336.98)).abs() < 1e-9);
        // 20 m in 2 s is 10 m/s; 3 m up at 30 N.
        let climbed_j = battery.flown_j(900.0, &at(1.0, 20.0), &at(21.0, 23.0));
        assert!((climbed_j - (900.0 - battery.slot_j(20.0) - 90.0)).abs() < 1e-9);
        let sunk_j = battery.flown_j(900.0, &at(1.0, 20.0), &at(21.0, 17.0));
        assert!((sunk_j - (900.0 - battery.slot_j(20.0))).abs() < 1e-9, "a descent gives nothing back");
    }

    #[test]
    fn a_flight_takes_the_same_with_a_battery_and_without() {
        let scenario = scenario("");
        let battery = Battery::of(&scenario);
        let mut without = scenario.clone();
        without.uav.battery = None;
        let endless = Battery::of(&without);
        // 10 m in 2 s are 5 m/s, whatever the climb: x = 25/(2 · 16.2409) = 0.769662, and P = 79.86 · 1.0052083 +
        // 88.63/√(x + √(1 + x²)) + 0.0092426 · 125 = 80.2759 + 62.1822 + 1.1553 = 143.6135 W; 3 m up at 20 N are 60 J.
        let climb_j = endless.flight_j(&Vector3::new(8.0, 6.0, 3.0));
        assert!((climb_j - 2.0 * 143.6135 - 60.0).abs() < 1e-3, "{climb_j}");
        assert_eq!(endless.flight_j(&Vector3::new(8.0, 6.0, -3.0)), endless.flight_j(&Vector3::new(8.0, 6.0, 0.0)));
        for step in
            [Vector3::zeros(), Vector3::new(6.0, 8.0, 0.0), Vector3::new(6.0, 0.0, 8.0), Vector3::new(6.0, 0.0, -8.0)]
        {
            let given_j = 900.0 - battery.flown_j(900.0, &Point3::origin(), &(Point3::origin() + step));
            assert!((battery.flight_j(&step) - given_j).abs() < 1e-9, "{step}");
            assert_eq!(endless.flight_j(&step), battery.flight_j(&step), "{step}");
        }
    }

    #[test]
    fn charging_ends_at_the_capacity() {
        let battery = Battery::of(&scenario("[base]\ncharge_w = 30.0\n"));
        assert_eq!([900.0, 950.0, 1_000.0].map(|energy_j| battery.charged_j(energy_j)), [960.0, 1_000.0, 1_000.0]);
        let landed = Battery::of(&scenario(""));
        assert_eq!((landed.charged_j(900.0), landed.is_charged()), (900.0, false));
    }

    #[test]
    fn the_economic_speed_minimises_energy_per_metre() {
        let battery = Battery::of(&scenario(""));
        let thrifty_m = battery.thrifty_m(60.0);
        for step in 1..=600 {
            let slot_m = f64::from(step) / 10.0;
            assert!(battery.slot_j(slot_m) / slot_m >= battery.slot_j(thrifty_m) / thrifty_m - 1e-9, "{slot_m} m");
        }
        assert!((thrifty_m / 2.0 - 18.3).abs() < 0.5, "{thrifty_m}"); // m/s, as figure 4 of the paper has it
        assert!((battery.thrifty_m(8.0) - 8.0).abs() < 1e-9, "what the UAV reaches");
    }
}
