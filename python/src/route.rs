//! `skysink.Route`: how the UAV gets somewhere.

use pyo3::prelude::*;
use skysink_common::geometry::Position;

/// A route at full speed, straight or around zones, and on a grid along its lines.
#[pyclass(name = "Route", module = "skysink", frozen, get_all)]
pub struct PyRoute {
    /// Its length [m].
    pub length_m: f64,
    /// Its slots, at least 1.
    pub slots: u64,
    /// The energy that it takes [J]; 0 without a battery.
    pub energy_j: f64,
    /// Where it ends [m].
    pub end_m: (f64, f64),
}

impl PyRoute {
    /// Where it ends.
    pub fn end(&self) -> Position {
        Position::new(self.end_m.0, self.end_m.1)
    }
}

#[pymethods]
impl PyRoute {
    fn __repr__(&self) -> String {
        let Self { length_m, slots, energy_j, .. } = self;
        format!("Route({length_m:.3} m, {slots} slots, {energy_j:.1} J)")
    }
}
