//! The native part of `skysink.plan_visits`.

use numpy::ndarray::{Array2, ArrayView1};
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use skysink_common::message::SensorNode;
use skysink_planner::plan::visits;
use skysink_planner::strategy::OwnedSetup;

use crate::errors::refused;
use crate::scenario::PyScenario;
use crate::signals::interruptible;

/// The visits of `steps` search steps to `places` [N, 6], of which each is x and y [m], buffer [bit], rate [bit/s],
/// weight and queue [bit]. Returns them [M, 4], of which each is slot, place, x and y [m]; their cost, and a bound.
#[pyfunction]
pub fn visits_of<'py>(
    py: Python<'py>,
    scenario: &PyScenario,
    places: PyReadonlyArray2<'py, f64>,
    steps: u64,
) -> PyResult<(Bound<'py, PyArray2<f64>>, f64, f64)> {
    let places = places.as_array();
    let node = |place: ArrayView1<'_, f64>| SensorNode {
        x_m: place[0],
        y_m: place[1],
        gain: 1.0,
        capacity_bits: place[2] as u32,
        sampling_bps: place[3],
        weight: place[4],
        ..SensorNode::default()
    };
    let nodes: Vec<SensorNode> = places.outer_iter().map(node).collect();
    let queues_bits: Vec<u32> = places.column(5).iter().map(|&bits| bits as u32).collect();
    let mut setup = OwnedSetup::new(scenario.scenario.clone(), &nodes).map_err(refused)?;
    let found = interruptible(py, |stop| {
        setup.stop = stop.clone();
        visits::plan_visits(&setup.setup(), &queues_bits, steps)
    })?;
    let (visits, cost, bound) = found.map_or((Vec::new(), 0.0, 0.0), |found| (found.visits, found.cost, found.bound));
    let row = |visit: &visits::TimedVisit| [visit.slot as f64, visit.sensor.into(), visit.at.x, visit.at.y];
    let rows: Vec<[f64; 4]> = visits.iter().map(row).collect();
    Ok((Array2::from(rows).into_pyarray(py), cost, bound))
}
