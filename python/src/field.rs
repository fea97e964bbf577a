//! `skysink.Field`: the constant data of a mission.

use std::sync::Arc;

use nalgebra::Point3;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use skysink_common::geometry::Position;
use skysink_common::message::{Limits, SensorNode};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::{SensorList, Sensors};
use skysink_planner::strategies::serving::fill_fullest_in_range;
use skysink_planner::strategies::transit::{toward, transit_waypoint};

use crate::errors::refused;

/// The sensor nodes of a mission and the limits of its plans.
pub struct FieldData {
    /// The limits of plans.
    pub limits: Limits,
    /// The sensor nodes.
    pub sensors: Sensors,
    /// The same as published.
    nodes: Vec<SensorNode>,
}

impl FieldData {
    /// The field with these limits and sensor nodes.
    pub fn new(limits: Limits, nodes: Vec<SensorNode>) -> Self {
        Self { sensors: Sensors::new(&limits, &nodes), limits, nodes }
    }

    /// Refuses queues of another field.
    pub fn check(&self, count: usize) -> PyResult<()> {
        if count != self.count() {
            return Err(refused(format!("queues_bits of {count} sensor nodes: expected {}", self.count())));
        }
        Ok(())
    }

    /// Sensor nodes.
    pub fn count(&self) -> usize {
        self.nodes.len()
    }

    /// Buffer of every sensor node [bit].
    pub fn capacity_bits(&self) -> u32 {
        self.nodes.first().map_or(0, |node| node.capacity_bits)
    }

    /// Fills `ids` with the n fullest queues within `d_c` of `ground`.
    pub fn fill_fullest(&self, ground: &Position, queues_bits: &[u32], ids: &mut Vec<u32>) {
        fill_fullest_in_range(&self.sensors.grid, &self.limits, ground, queues_bits, ids);
    }

    /// The waypoint of the transit rule (decision D8).
    pub fn transit(&self, uav: &Point3<f64>, queues_bits: &[u32]) -> Position {
        transit_waypoint(&self.sensors.positions, self.limits.reach_m, &uav.xy(), queues_bits)
    }

    /// The point of the area nearest to `ground`.
    pub fn clamp_to_area(&self, ground: Position) -> Position {
        Position::new(ground.x.clamp(0.0, self.limits.width_m), ground.y.clamp(0.0, self.limits.height_m))
    }
}

/// Limits and sensor nodes in the layout of the messages of the ring.
type Messages<'py> = (Bound<'py, PyBytes>, Bound<'py, PyBytes>);

/// The constant data of a mission: sensor nodes (SNs) and limits. ``len`` is N.
#[pyclass(name = "Field", module = "skysink", frozen)]
pub struct PyField(pub Arc<FieldData>);

impl PyField {
    /// The field of a scenario.
    pub fn of(scenario: &Scenario, list: &SensorList) -> Self {
        Self(Arc::new(FieldData::new(Limits::of(scenario), list.nodes())))
    }

    fn column<'py>(&self, py: Python<'py>, of: impl Fn(&SensorNode) -> f64) -> PyResult<Bound<'py, PyArray1<f64>>> {
        read_only(self.0.nodes.iter().map(of).collect::<Vec<f64>>().into_pyarray(py))
    }
}

/// Makes the array read-only.
pub fn read_only<'py, T>(array: Bound<'py, T>) -> PyResult<Bound<'py, T>> {
    array.as_any().call_method1("setflags", (false,))?;
    Ok(array)
}

/// Parses a point on the ground: the first two coordinates.
pub fn ground(point: &Bound<'_, PyAny>) -> PyResult<Position> {
    let [x_m, y_m] = match coordinates(point)?[..] {
        [x_m, y_m, ..] => [x_m, y_m],
        _ => return Err(refused(format!("{point}: expected x and y [m]"))),
    };
    Ok(Position::new(x_m, y_m))
}

/// Parses the coordinates of a point, two or three [m].
pub fn coordinates(point: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    if let Ok(array) = point.extract::<PyReadonlyArray1<'_, f64>>() {
        return Ok(array.as_array().to_vec());
    }
    point.try_iter()?.map(|coordinate| coordinate?.extract()).collect()
}

#[pymethods]
impl PyField {
    /// For pickle and copy.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Messages<'py>)> {
        let field = &slf.get().0;
        let message = |bytes| PyBytes::new(slf.py(), bytes);
        let messages = (message(bytemuck::bytes_of(&field.limits)), message(bytemuck::cast_slice(&field.nodes)));
        Ok((slf.get_type().getattr("_from_messages")?, messages))
    }

    /// Creates a field from limits and sensor nodes in the layout of the messages of the ring.
    #[staticmethod]
    fn _from_messages(limits: &[u8], nodes: &[u8]) -> PyResult<Self> {
        let refuse = |_| refused("messages of another version: use the package of the running Skysink");
        let limits = bytemuck::try_pod_read_unaligned(limits).map_err(refuse)?;
        Ok(Self(Arc::new(FieldData::new(limits, bytemuck::pod_collect_to_vec(nodes)))))
    }

    fn __len__(&self) -> usize {
        self.0.count()
    }

    /// Positions of the SNs, east and north [m], [N, 2]. Every access creates a new array.
    #[getter]
    fn positions_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let positions = &self.0.sensors.positions;
        let array = Array2::from_shape_fn((positions.len(), 2), |(sensor, axis)| positions[sensor][axis]);
        read_only(array.into_pyarray(py))
    }

    /// Reference channel gain at 1 m, a linear ratio, [N].
    #[getter]
    fn gains<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |node| node.gain)
    }

    /// Sampling rates [bit/s], [N].
    #[getter]
    fn sampling_bps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.column(py, |node| node.sampling_bps)
    }

    /// Buffer B of each SN [bit].
    #[getter]
    fn capacity_bits(&self) -> u32 {
        self.0.capacity_bits()
    }

    /// Width and height of the area [m].
    #[getter]
    fn area_m(&self) -> (f64, f64) {
        (self.0.limits.width_m, self.0.limits.height_m)
    }

    /// Maximum horizontal distance flown in a slot, V_max tau [m].
    #[getter]
    fn reach_m(&self) -> f64 {
        self.0.limits.reach_m
    }

    /// Maximum horizontal distance for serving an SN, d_c [m].
    #[getter]
    fn comm_radius_m(&self) -> f64 {
        self.0.limits.comm_radius_m
    }

    /// Maximum number of SNs served in a slot, n.
    #[getter]
    fn resource_blocks(&self) -> u32 {
        self.0.limits.resource_blocks
    }

    /// Minimum and maximum altitude [m]; equal if the altitude is fixed.
    #[getter]
    fn altitudes_m(&self) -> (f64, f64) {
        (self.0.limits.min_altitude_m, self.0.limits.max_altitude_m)
    }

    /// Maximum climb or descent in a slot [m]; 0 if the altitude is fixed.
    #[getter]
    fn climb_m(&self) -> f64 {
        self.0.limits.climb_m
    }

    /// Number of slots of the mission, T.
    #[getter]
    fn slots(&self) -> u64 {
        self.0.limits.slots
    }

    /// Duration of a slot, tau [s].
    #[getter]
    fn slot_s(&self) -> f64 {
        self.0.limits.slot_s
    }

    /// Communication time in a slot, tau_c [s].
    #[getter]
    fn comm_s(&self) -> f64 {
        self.0.limits.comm_s
    }

    /// Ids of the SNs within ``radius_m`` [m] of ``point`` on the ground, ascending; tolerance as in decision D5.
    fn within<'py>(
        &self,
        py: Python<'py>,
        point: &Bound<'py, PyAny>,
        radius_m: f64,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let mut ids = Vec::new();
        self.0.sensors.grid.visit_within(&ground(point)?, radius_m, |node| ids.push(node.id));
        ids.sort_unstable();
        Ok(ids.into_pyarray(py))
    }

    /// Ids of the n SNs with the fullest queues within d_c of ``point``, ascending. Ties go to the lowest id.
    fn fullest<'py>(
        &self,
        py: Python<'py>,
        point: &Bound<'py, PyAny>,
        queues_bits: PyReadonlyArray1<'py, u32>,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let mut ids = Vec::new();
        self.0.check(queues_bits.len()?)?;
        self.0.fill_fullest(&ground(point)?, queues_bits.as_slice()?, &mut ids);
        Ok(ids.into_pyarray(py))
    }

    /// The point that one slot at full speed reaches from ``from_`` toward ``to``, at most ``to`` [m], [2].
    fn toward<'py>(
        &self,
        py: Python<'py>,
        from: &Bound<'py, PyAny>,
        to: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let point = toward(self.0.limits.reach_m, &ground(from)?, &ground(to)?);
        Ok([point.x, point.y].to_pyarray(py))
    }

    fn __repr__(&self) -> String {
        let Limits { width_m, height_m, reach_m, comm_radius_m, resource_blocks, .. } = self.0.limits;
        format!(
            "Field({} sensor nodes over {width_m} m x {height_m} m, reach_m={reach_m}, comm_radius_m={comm_radius_m}, \
             resource_blocks={resource_blocks})",
            self.0.count()
        )
    }
}
