//! Where a UAV has to come home to, if it has to (decision D13).

use std::sync::Arc;

use nalgebra::Point3;
use skysink_common::airspace::Airspace;
use skysink_common::battery::BatteryState;
use skysink_common::geometry::Position;
use skysink_common::message::FlightReport;
use skysink_common::scenario::Scenario;

use super::route::Route;
use super::way_home::{Returning, WayHome};

/// The home of a UAV. One that need not come back has no way there: it is home everywhere, and has all time and energy.
#[derive(Debug, Clone, PartialEq)]
pub struct Home(Option<Box<WayHome>>);

impl Home {
    /// The home of the UAV of a scenario.
    #[must_use]
    pub fn of(scenario: &Scenario, airspace: &Arc<Airspace>) -> Self {
        Self(WayHome::of(scenario, airspace).map(Box::new))
    }

    /// The way there; `None` if the UAV need not come back.
    #[inline]
    pub fn way(&self) -> Option<&WayHome> {
        self.0.as_deref()
    }

    /// Whether `ground` [m] lies in the base; everywhere if the UAV need not come back.
    #[inline]
    pub fn contains(&self, ground: &Position) -> bool {
        self.way().is_none_or(|way| way.base.contains(ground))
    }

    /// Whether a UAV at `ground` [m] is where it charges.
    pub fn is_charger(&self, ground: &Position) -> bool {
        self.way().is_some_and(|way| !way.battery.is_endless() && way.base.contains(ground))
    }

    /// Places well inside of the base [m].
    pub fn places(&self) -> &[Position] {
        self.way().map_or(&[], |way| &way.places)
    }

    /// [`WayHome::route`]; `None` also if the UAV need not come back.
    pub fn route(&self, slot: u64, ground: &Position) -> Option<Route> {
        self.way()?.route(slot, ground)
    }

    /// [`WayHome::may_serve`].
    pub fn may_serve(&self, sensor: &Position) -> bool {
        self.way().is_none_or(|way| way.may_serve(sensor))
    }

    /// [`WayHome::is_in_reach`].
    pub fn is_in_reach(&self, slot: u64, energy_j: f64, ground: &Position) -> bool {
        self.way().is_none_or(|way| way.is_in_reach(slot, energy_j, ground))
    }

    /// The energy [J] beyond the way home and the reserve of a UAV with `energy_j` at `ground` [m] after `slot`;
    /// −∞ if it comes home too late, ∞ if it need not.
    #[inline]
    pub fn margin_j(&self, slot: u64, energy_j: f64, ground: &Position) -> f64 {
        self.way().map_or(f64::INFINITY, |way| way.margin_j(slot, energy_j, ground))
    }

    /// [`WayHome::spare_slots`].
    pub fn spare_slots(&self, slot: u64, ground: &Position) -> Option<i64> {
        self.way()?.spare_slots(slot, ground)
    }

    /// The next waypoint of the way home from `ground` [m] in `slot`; `ground` itself in the base.
    pub fn next_waypoint(&self, slot: u64, ground: &Position) -> Position {
        self.way().map_or(*ground, |way| way.next_waypoint(slot, ground))
    }

    /// [`WayHome::landing_waypoint`].
    pub fn landing_waypoint(&self, slot: u64, energy_j: f64, ground: &Position) -> Position {
        self.way().map_or(*ground, |way| way.landing_waypoint(slot, energy_j, ground))
    }

    /// What becomes of the decision to fly from `from` to `to` [m] in `slot`; `is_idle` if it serves nobody there.
    #[inline]
    pub fn rule(&self, slot: u64, state: &BatteryState, way: [&Point3<f64>; 2], is_idle: bool) -> Returning {
        self.way().map_or(Returning::Not, |home| home.rule(slot, state, way, is_idle))
    }

    /// [`WayHome::charges_on`].
    #[inline]
    pub fn charges_on(&self, slot: u64, state: &BatteryState, ground: &Position) -> bool {
        self.way().is_some_and(|way| way.charges_on(slot, state, ground))
    }

    /// [`WayHome::pad_waits`].
    pub fn pad_waits(&self, slot: u64, uav: usize, flights: &[FlightReport]) -> Vec<u64> {
        self.way().map_or_else(Vec::new, |way| way.pad_waits(slot, uav, flights))
    }
}
