//! The native part of `skysink.plan_visits`.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use skysink_common::message::SensorNode;
use skysink_planner::plan::visits;
use skysink_planner::strategy::OwnedSetup;

use crate::errors::refused;
use crate::scenario::PyScenario;
use crate::signals::interruptible;

/// Slots, sensor nodes, x and y [m] of the visits; their cost, and a bound.
type Visits<'py> = (
    Bound<'py, PyArray1<u64>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    f64,
    f64,
);

/// The visits of `steps` search steps to sensor nodes at `positions_m` [N, 2] with these buffers [bit], rates [bit/s],
/// weights and queues [bit].
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "arrays of equal length")]
pub fn visits_of<'py>(
    py: Python<'py>,
    scenario: &PyScenario,
    positions_m: PyReadonlyArray2<'py, f64>,
    capacity_bits: PyReadonlyArray1<'py, u32>,
    sampling_bps: PyReadonlyArray1<'py, f64>,
    weights: PyReadonlyArray1<'py, f64>,
    queues_bits: PyReadonlyArray1<'py, u32>,
    steps: u64,
) -> PyResult<Visits<'py>> {
    let positions_m = positions_m.as_array();
    let nodes: Vec<SensorNode> = positions_m
        .outer_iter()
        .zip(capacity_bits.as_array())
        .zip(sampling_bps.as_array())
        .zip(weights.as_array())
        .map(|(((at, &capacity_bits), &sampling_bps), &weight)| SensorNode {
            x_m: at[0],
            y_m: at[1],
            gain: 1.0,
            sampling_bps,
            capacity_bits,
            weight,
            ..SensorNode::default()
        })
        .collect();
    let queues_bits: Vec<u32> = queues_bits.as_array().to_vec();
    let mut setup = OwnedSetup::new(scenario.scenario.clone(), &nodes).map_err(refused)?;
    let found = interruptible(py, |stop| {
        setup.stop = stop.clone();
        visits::plan_visits(&setup.setup(), &queues_bits, steps)
    })?;
    let (visits, cost, bound) = found.map_or((Vec::new(), 0.0, 0.0), |found| (found.visits, found.cost, found.bound));
    let column = |of: fn(&visits::TimedVisit) -> f64| visits.iter().map(of).collect::<Vec<f64>>();
    Ok((
        visits.iter().map(|visit| visit.slot).collect::<Vec<u64>>().into_pyarray(py),
        visits.iter().map(|visit| visit.sensor).collect::<Vec<u32>>().into_pyarray(py),
        column(|visit| visit.at.x).into_pyarray(py),
        column(|visit| visit.at.y).into_pyarray(py),
        cost,
        bound,
    ))
}
