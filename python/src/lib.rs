//! The native part of the Python package `skysink`: everything that must be fast or reproduce Skysink's results
//! exactly.
//!
//! Names, shapes and units are documented in the package's stubs, `skysink/_skysink.pyi`, and in its modules. Spaces,
//! registration and executors are implemented in Python.

mod batch;
mod belief;
mod control;
mod environment;
mod episode;
mod errors;
mod field;
mod held;
mod library;
mod observation;
mod reward;
mod ring;
mod route;
mod rules;
mod run;
mod scenario;
mod signals;
mod simulate;
mod strategy;
mod survey;
mod sweeps;
mod table;
mod tables;
mod unflown;
mod values;
mod vehicle;
mod view;
mod visits;

#[pyo3::pymodule]
mod _skysink {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::belief::PyBelief;
    #[pymodule_export]
    use super::environment::PyEnvironmentCore;
    #[pymodule_export]
    use super::errors::InputError;
    #[pymodule_export]
    use super::field::{PyBase, PyField};
    #[pymodule_export]
    use super::library::{library_copy, library_instances, library_verify};
    #[pymodule_export]
    use super::ring::{fly_ring, plan_ring};
    #[pymodule_export]
    use super::route::PyRoute;
    #[pymodule_export]
    use super::run::PyRun;
    #[pymodule_export]
    use super::scenario::PyScenario;
    #[pymodule_export]
    use super::simulate::simulate;
    #[pymodule_export]
    use super::strategy::PyDecision;
    #[pymodule_export]
    use super::survey::{expected_rates_bps, positions_m, simplified_polygons};
    #[pymodule_export]
    use super::sweeps::{PySweepPlan, PySweepRecord};
    #[pymodule_export]
    use super::table::PyTable;
    #[pymodule_export]
    use super::tables::{latex, table_of};
    #[pymodule_export]
    use super::view::{PyFlight, PyNeighbours, PyView};
    #[pymodule_export]
    use super::visits::visits_of;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // Initialise NumPy's interface on import, not on first use.
        let _ = numpy::PyArray1::<u32>::zeros(module.py(), 0, false);
        module.add("__version__", skysink_common::build::VERSION)?;
        skysink_common::build::identify(skysink::usage::BUILD);
        module.add("__build__", skysink::usage::BUILD)?;
        module.add("STRATEGIES", skysink_planner::strategies::names())
    }
}
