//! `skysink.Route`: how the UAV gets somewhere.

use pyo3::prelude::*;
use skysink_planner::route::route::Route;

/// A route at full speed, straight or around zones, and on a grid along its lines.
#[pyclass(name = "Route", module = "skysink", frozen, get_all)]
pub struct PyRoute {
    /// Its length [m].
    length_m: f64,
    /// Its slots, at least 1.
    slots: u64,
    /// The energy that it takes [J]; 0 without a battery.
    energy_j: f64,
    /// Where it ends [m].
    end_m: (f64, f64),
}

impl PyRoute {
    pub fn of(route: &Route) -> Self {
        let end_m = (route.end().x, route.end().y);
        let slots = u64::from(route.slots()).max(1);
        Self { length_m: route.length_m(), slots, energy_j: route.energy_j(), end_m }
    }
}

#[pymethods]
impl PyRoute {
    fn __repr__(&self) -> String {
        let Self { length_m, slots, energy_j, .. } = self;
        format!("Route({length_m:.3} m, {slots} slots, {energy_j:.1} J)")
    }
}
