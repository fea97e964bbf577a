//! The native part of `skysink.terrain` and `skysink.measured`: rates, positions in the area, and zones of few corners.

use numpy::ndarray::{Array2, ArrayView1};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use skysink_common::airspace::{KeptGround, Polygon, simplify};
use skysink_common::channel::{Channel, ChannelModel as _};
use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::geometry::Position;

use crate::errors::refused;
use crate::scenario::PyScenario;

/// The expected rates [bit/s] of the links of a sensor node with this `gain` to UAVs at the squares of horizontal
/// distances `d2_m2` [m²], `rise_m` [m] above it.
#[pyfunction]
pub fn expected_rates_bps<'py>(
    py: Python<'py>,
    scenario: &PyScenario,
    gain: f64,
    d2_m2: PyReadonlyArray1<'py, f64>,
    rise_m: f64,
) -> Bound<'py, PyArray1<f64>> {
    let channel = Channel::of(&scenario.scenario.link);
    let rate_bps = |&d2_m2: &f64| channel.expected_rate_bps(&channel.uplink_at(gain, d2_m2, rise_m));
    d2_m2.as_array().iter().map(rate_bps).collect::<Vec<f64>>().into_pyarray(py)
}

/// Latitudes and longitudes [°], [N, 2], as x and y [m] in the area whose south-west corner is at `origin_deg`.
#[pyfunction]
pub fn positions_m<'py>(
    py: Python<'py>,
    origin_deg: [f64; 2],
    positions_deg: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let [lat_deg, lon_deg] = origin_deg;
    let projection = Projection::at(Origin { lat_deg, lon_deg });
    let position = |at: ArrayView1<'_, f64>| {
        let beyond = || refused(format!("{}, {}: expected a place near {lat_deg}, {lon_deg}", at[0], at[1]));
        projection.project(at[0], at[1]).map(|at| [at.x, at.y]).ok_or_else(beyond)
    };
    let rows: Vec<[f64; 2]> = positions_deg.as_array().outer_iter().map(position).collect::<PyResult<_>>()?;
    Ok(Array2::from(rows).into_pyarray(py))
}

/// Polygons [m] that grow by at most `tolerance_m`, but not over the places `kept`, until they have at most `most`
/// corners altogether.
#[pyfunction]
pub fn simplified_polygons(
    polygons: Vec<Vec<[f64; 2]>>,
    most: usize,
    tolerance_m: f64,
    kept: Vec<[f64; 2]>,
) -> PyResult<Vec<Vec<(f64, f64)>>> {
    let polygons = polygons.iter().map(|corners| Polygon::of(corners, false));
    let mut polygons: Vec<Polygon> = polygons.collect::<Result<_, _>>().map_err(refused)?;
    let places: Vec<Position> = kept.into_iter().map(Position::from).collect();
    simplify(&mut polygons, most, tolerance_m, KeptGround { places: &places, areas: &[] });
    let corners = |polygon: &Polygon| polygon.corners().iter().map(|at| (at.x, at.y)).collect();
    Ok(polygons.iter().map(corners).collect())
}
