//! The native part of `skysink.library`.

use std::path::PathBuf;

use pyo3::prelude::*;
use skysink_library::Library;

use crate::errors::of_mission;
use crate::signals::interruptible;
use crate::values::json;

/// The rows that `skysink library list` prints, as dictionaries.
#[pyfunction]
pub fn library_instances(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let library = Library::default();
    let instances = library.instances().map_err(of_mission)?.into_iter();
    let listed = instances.map(|instance| library.listed(instance)).collect::<Result<Vec<_>, _>>();
    json(py, &listed.map_err(of_mission)?)
}

/// Copies an instance into a folder, and returns the path of its scenario.
#[pyfunction]
pub fn library_copy(name: &str, folder: PathBuf) -> PyResult<PathBuf> {
    let library = Library::default();
    library.find(name).and_then(|instance| library.copy(&instance, &folder)).map_err(of_mission)
}

/// The placement that `skysink library verify` prints, as a dictionary.
#[pyfunction]
pub fn library_verify(py: Python<'_>, paths: Vec<PathBuf>, instance: Option<String>) -> PyResult<Bound<'_, PyAny>> {
    let placement = interruptible(py, |stop| {
        Library::default().verify(&paths, instance.as_deref(), stop).and_then(|flown| flown.placement())
    })?;
    json(py, &placement.map_err(of_mission)?)
}
