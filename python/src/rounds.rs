//! `skysink.round_over_disks`: a short path that touches disks.

use std::time::Duration;

use numpy::ndarray::Array2;
use numpy::{AllowTypeChange, IntoPyArray, PyArray1, PyArray2, PyArrayLike2};
use pyo3::prelude::*;
use skysink_common::geometry::Position;
use skysink_planner::geometry::round::{Disks, RoundEffort};

use crate::errors::refused;
use crate::signals::interruptible;
use crate::values::read_only;

/// Most disks of a round: the first one takes time proportional to the square.
const MOST: usize = 100_000;

/// A path that touches disks.
#[pyclass(name = "DiskRound", module = "skysink", frozen)]
pub struct PyDiskRound {
    /// Its points in order, the start first if there is one [m], float64 [K, 2], read-only.
    #[pyo3(get)]
    points_m: Py<PyArray2<f64>>,
    /// The disk in which each point behind the start lies, uint32, read-only. All others are touched in passing.
    #[pyo3(get)]
    order: Py<PyArray1<u32>>,
    /// Its length [m], with the leg back to its first point if it is closed.
    #[pyo3(get)]
    length_m: f64,
    /// A lower bound on the length of every such path [m]. If it equals ``length_m`` within 1e-6 of it, none is
    /// shorter.
    #[pyo3(get)]
    bound_m: f64,
}

#[pymethods]
impl PyDiskRound {
    fn __repr__(&self, py: Python<'_>) -> String {
        let Self { length_m, bound_m, .. } = self;
        format!(
            "DiskRound({} points, {length_m:.6} m, at least {bound_m:.6} m)",
            self.points_m.bind(py).as_any().len().unwrap_or(0)
        )
    }
}

/// A short path that touches the disks of ``radius_m`` about ``positions_m``, and a lower bound on all of them.
///
/// It begins at ``start_m``, or anywhere, and ends there if it is ``closed``. ``seconds`` (1 by default) are spent on
/// the path, and as many on the bound, beside the first path, whose time grows with N²; with ``steps`` instead, results
/// repeat. A disk counts as touched within a billionth of the range of the coordinates. Raises ``InputError``.
#[pyfunction]
#[pyo3(signature = (positions_m, radius_m, start_m=None, *, closed=true, seconds=None, steps=None))]
pub fn round_over_disks(
    py: Python<'_>,
    positions_m: PyArrayLike2<'_, f64, AllowTypeChange>,
    radius_m: f64,
    start_m: Option<[f64; 2]>,
    closed: bool,
    seconds: Option<f64>,
    steps: Option<u64>,
) -> PyResult<PyDiskRound> {
    let positions_m = positions_m.as_array();
    if positions_m.ncols() != 2 || positions_m.nrows() > MOST {
        let (rows, columns) = (positions_m.nrows(), positions_m.ncols());
        return Err(refused(format!("positions_m of shape ({rows}, {columns}): expected (N, 2), N at most {MOST}")));
    }
    let is_position = |position: &[f64; 2]| position.iter().all(|coordinate_m| coordinate_m.abs() <= 1e9);
    let centres: Vec<[f64; 2]> = positions_m.rows().into_iter().map(|row| [row[0], row[1]]).collect();
    if let Some([x_m, y_m]) = centres.iter().chain(&start_m).find(|position| !is_position(position)) {
        return Err(refused(format!("position [{x_m}, {y_m}]: expected metres, -1e9 to 1e9")));
    }
    if !(0.0..=1e9).contains(&radius_m) {
        return Err(refused(format!("radius_m = {radius_m}: expected 0 to 1e9")));
    }
    let effort = match (seconds, steps) {
        (None, Some(steps)) => RoundEffort::Steps(steps),
        (Some(_), Some(_)) => return Err(refused("seconds and steps: expected one of them")),
        (seconds, None) => {
            let seconds = seconds.unwrap_or(1.0);
            if !(0.0..=1e6).contains(&seconds) {
                return Err(refused(format!("seconds = {seconds}: expected 0 to 1e6")));
            }
            RoundEffort::Time(Duration::from_secs_f64(seconds))
        }
    };
    let centres: Vec<Position> = centres.into_iter().map(Position::from).collect();
    let (round, bound_m) = interruptible(py, |stop| {
        let disks = Disks { centres: &centres, radius_m, start: start_m.map(Position::from), is_closed: closed };
        let round = disks.round(effort, stop);
        let bound_m = disks.bound_m(round.length_m, effort, stop);
        (round, bound_m)
    })?;
    let points = Array2::from_shape_fn((round.points.len(), 2), |(row, axis)| round.points[row][axis]);
    Ok(PyDiskRound {
        points_m: read_only(points.into_pyarray(py))?.unbind(),
        order: read_only(PyArray1::from_vec(py, round.order))?.unbind(),
        length_m: round.length_m,
        bound_m,
    })
}
