//! `skysink.Field`: the constant data of a mission.

use std::ops::Deref;
use std::sync::Arc;

use nalgebra::Point3;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray1, ToPyArray};
use pyo3::prelude::*;
use skysink_common::base::Base;
use skysink_common::geometry::Position;
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;
use skysink_common::told::Told;
use skysink_planner::geometry::disks::Disk;
use skysink_planner::mission_table::MissionTable;
use skysink_planner::route::route::Route;
use skysink_planner::rules::RuleBook;
use skysink_planner::serving::{fill_fullest_in_range, fill_most_in_range};
use skysink_planner::strategy::{OwnedSetup, Setup};

use crate::errors::refused;
use crate::held::Held;
use crate::route::PyRoute;
use crate::values::{Reduced, read_only};

/// The sensor nodes of a mission and the limits of its plans, as a planner knows them.
pub struct FieldData {
    /// The mission without what a UAV is not told.
    mission: OwnedSetup,
    /// The buffers of the sensor nodes [bit], for observations.
    pub buffers_bits: Vec<f32>,
    /// The sensor nodes as published.
    nodes: Vec<SensorNode>,
}

impl Deref for FieldData {
    type Target = MissionTable;

    fn deref(&self) -> &MissionTable {
        &self.mission.table
    }
}

impl FieldData {
    /// The field of a scenario with these sensor nodes, as the UAV knows them.
    ///
    /// # Errors
    /// If `[planner]` of the scenario is refused.
    pub fn of(scenario: &Scenario, nodes: Vec<SensorNode>) -> PyResult<Arc<Self>> {
        Ok(Self::new(OwnedSetup::new(scenario.clone(), &nodes).map_err(refused)?, nodes))
    }

    /// The field of a strategy.
    pub fn of_setup(setup: &Setup<'_>) -> Arc<Self> {
        let sensors = &setup.table.sensors;
        let node = |id: u32| {
            let at = sensors.position(id);
            let sampler = sensors.sampler(id);
            SensorNode {
                x_m: at.x,
                y_m: at.y,
                gain: sensors.gains[id as usize],
                sampling_bps: sampler.mean_bits / setup.scenario.slot_s,
                capacity_bits: sampler.capacity_bits,
                reserved: 0,
                weight: sensors.weights.of(id as usize),
            }
        };
        let mission = OwnedSetup {
            scenario: setup.scenario.clone(),
            settings: *setup.settings,
            table: setup.table.clone(),
            stop: Stop::default(),
        };
        Self::new(mission, sensors.ids().map(node).collect())
    }

    fn new(mut mission: OwnedSetup, nodes: Vec<SensorNode>) -> Arc<Self> {
        let told = &mut mission.scenario;
        told.sensors.file = None;
        told.sensors.arrivals = None;
        told.trace = None;
        told.seed = 0; // by which rates and queues are drawn
        Arc::new(Self { mission, buffers_bits: nodes.iter().map(|node| node.capacity_bits as f32).collect(), nodes })
    }

    /// The rules for decisions, which also compute schedules and altitudes.
    pub fn rules(&self) -> RuleBook {
        RuleBook::new(&self.mission.setup())
    }

    pub fn count(&self) -> usize {
        self.nodes.len()
    }

    /// Sampling rates of the sensor nodes [bit/s], as the UAV knows them before slot 1, read-only.
    pub fn sampling_bps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        read_only(PyArray1::from_iter(py, self.nodes.iter().map(|node| node.sampling_bps)))
    }

    /// Positions of the sensor nodes, x and y alternating, as fractions of the area.
    pub fn position_fractions(&self) -> impl Iterator<Item = f32> {
        let fractions = |position: &Position| [position.x / self.limits.width_m, position.y / self.limits.height_m];
        self.sensors.positions.iter().flat_map(fractions).map(|fraction| fraction as f32)
    }

    /// The sensor nodes that a UAV at `uav` [m] serves by default, of those that send.
    pub fn fullest(&self, uav: &Point3<f64>, told: Told<'_>) -> Vec<u32> {
        let mut ids = Vec::new();
        if self.mission.settings.objective.is_collect() {
            fill_most_in_range(self, uav, told, &mut ids);
        } else {
            fill_fullest_in_range(self, &uav.xy(), told, &mut ids);
        }
        ids
    }

    /// The route from `from` into the disk of `radius_m` about `centre` [m]; `None` if there is none.
    pub fn route_into(&self, from: &Position, centre: &Position, radius_m: f64) -> Option<Route> {
        self.motion.shortest_into(from, &Disk { centre: *centre, radius_m })
    }
}

/// The constant data of a mission: sensor nodes (SNs) and limits. ``len`` is N.
#[pyclass(name = "Field", module = "skysink", frozen)]
pub struct PyField {
    /// The data, shared with the missions over this field.
    pub data: Arc<FieldData>,
    /// The largest buffer of an SN, B [bit].
    #[pyo3(get)]
    capacity_bits: u32,
    /// Width and height of the area [m].
    #[pyo3(get)]
    area_m: (f64, f64),
    /// Maximum horizontal distance flown in a slot, V_max tau [m].
    #[pyo3(get)]
    reach_m: f64,
    /// Maximum horizontal distance for serving an SN, d_c [m].
    #[pyo3(get)]
    comm_radius_m: f64,
    /// Maximum number of SNs served in a slot, n.
    #[pyo3(get)]
    resource_blocks: u32,
    /// Minimum and maximum altitude [m]; equal if the altitude is fixed.
    #[pyo3(get)]
    altitudes_m: (f64, f64),
    /// Maximum climb or descent in a slot [m]; 0 if the altitude is fixed.
    #[pyo3(get)]
    climb_m: f64,
    /// Number of slots of the mission, T.
    #[pyo3(get)]
    slots: u64,
    /// Duration of a slot, tau [s].
    #[pyo3(get)]
    slot_s: f64,
    /// Communication time in a slot, tau_c [s].
    #[pyo3(get)]
    comm_s: f64,
}

impl PyField {
    pub fn new(data: Arc<FieldData>) -> Self {
        let limits = data.limits;
        Self {
            capacity_bits: data.nodes.iter().map(|node| node.capacity_bits).max().unwrap_or(0),
            area_m: (limits.width_m, limits.height_m),
            reach_m: limits.reach_m,
            comm_radius_m: limits.comm_radius_m,
            resource_blocks: limits.resource_blocks,
            altitudes_m: (limits.min_altitude_m, limits.max_altitude_m),
            climb_m: limits.climb_m,
            slots: limits.slots,
            slot_s: limits.slot_s,
            comm_s: limits.comm_s,
            data,
        }
    }

    /// The field of a scenario with these sensor nodes.
    pub fn of(scenario: &Scenario, nodes: Vec<SensorNode>) -> PyResult<Self> {
        FieldData::of(scenario, nodes).map(Self::new)
    }

    /// Whether zones leave a place to serve a sensor node from.
    pub fn is_reachable(&self, id: u32) -> bool {
        self.data.is_reachable(id)
    }

    /// The values of queues [bit], by the numbers of answers.
    pub fn values<'py>(
        &self,
        py: Python<'py>,
        queues_bits: &Bound<'py, PyArray1<u32>>,
        answers: &Bound<'py, PyArray1<u8>>,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let queues_bits = queues_bits.try_readonly()?;
        let answers = answers.try_readonly()?;
        let nodes = (0..).zip(queues_bits.as_slice()?).zip(answers.as_slice()?);
        let value =
            |((id, &bits), &answer): ((u32, &u32), &u8)| if answer == 0 { self.data.value(id, bits) } else { 0 };
        read_only(PyArray1::from_iter(py, nodes.map(value)))
    }

    /// The sensor nodes that send, by the numbers of `answers`, and that one slot from `from` may serve.
    pub fn reachable<'py>(
        &self,
        py: Python<'py>,
        from: &Bound<'py, PyAny>,
        answers: &Bound<'py, PyArray1<u8>>,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let from = ground(from)?;
        let answers = answers.try_readonly()?;
        let answers = answers.as_slice()?;
        let mut ids = Vec::new();
        self.data.sensors.grid.visit_within(&from, self.reach_m, |node| {
            if answers[node.id as usize] == 0 && self.data.may_serve_next(&from, &node.position) {
                ids.push(node.id);
            }
        });
        ids.sort_unstable();
        Ok(ids.into_pyarray(py))
    }
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
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py, (Vec<u8>,)>> {
        let FieldData { mission, nodes, .. } = &*slf.get().data;
        let scenario = &mission.scenario;
        let [arrivals, channel, rates] = Held::of(scenario).texts();
        let text = (scenario.to_toml(), &scenario.path, arrivals, channel, rates);
        let scenario = slf.py().import("skysink")?.getattr("Scenario")?.call_method1("parse", text)?;
        Ok((scenario.getattr("_field")?, (bytemuck::cast_slice(nodes).to_vec(),)))
    }

    fn __len__(&self) -> usize {
        self.data.count()
    }

    /// Positions of the SNs, east and north [m], [N, 2]. Every access creates a new array.
    #[getter]
    fn positions_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let positions: Vec<[f64; 2]> = self.data.sensors.positions.iter().map(|&position| position.into()).collect();
        read_only(Array2::from(positions).into_pyarray(py))
    }

    /// Reference channel gain at 1 m, a linear ratio, [N].
    #[getter]
    fn gains<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        read_only(PyArray1::from_slice(py, &self.data.sensors.gains))
    }

    /// Sampling rates [bit/s], [N]. In a mission where they are learnt, all are the scenario's mean.
    #[getter]
    fn sampling_bps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.data.sampling_bps(py)
    }

    /// Buffers B_i of the SNs [bit], [N].
    #[getter]
    fn capacities_bits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<u32>>> {
        read_only(PyArray1::from_iter(py, self.data.nodes.iter().map(|node| node.capacity_bits)))
    }

    /// Weights w_i of the bits of the SNs, [N]; 1 without weights in the sensor list.
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        read_only(PyArray1::from_iter(py, self.data.nodes.iter().map(|node| node.weight)))
    }

    /// Ids of the SNs within ``radius_m`` [m] of ``point`` on the ground, ascending; tolerance as in decision D5.
    fn within<'py>(
        &self,
        py: Python<'py>,
        point: &Bound<'py, PyAny>,
        radius_m: f64,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let mut ids = Vec::new();
        self.data.sensors.grid.visit_within(&ground(point)?, radius_m, |node| ids.push(node.id));
        ids.sort_unstable();
        Ok(ids.into_pyarray(py))
    }

    /// Whether each SN has a place in its range that the UAV can fly to, and so can be served, [N]. Zones hide others.
    #[getter]
    fn servable<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let ids = self.data.sensors.ids();
        read_only(PyArray1::from_iter(py, ids.map(|id| self.data.is_reachable(id))))
    }

    /// The base that the UAV has to come back to; None if it need not.
    #[getter]
    fn base(&self) -> Option<PyBase> {
        self.data.home.way().map(|way| PyBase(way.base.clone()))
    }

    /// Slots of a move on a grid; 1 without one.
    #[getter]
    fn move_slots(&self) -> u64 {
        self.data.airspace.move_slots()
    }

    /// Ids of the n SNs with the fullest queues within d_c of ``point``, by their values, ascending. Ties go to the
    /// lowest id.
    fn fullest<'py>(
        &self,
        py: Python<'py>,
        point: &Bound<'py, PyAny>,
        queues_bits: PyReadonlyArray1<'py, u32>,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let count = queues_bits.len()?;
        if count != self.data.count() {
            return Err(refused(format!("queues_bits of {count} sensor nodes: expected {}", self.data.count())));
        }
        let mut ids = Vec::new();
        fill_fullest_in_range(&self.data, &ground(point)?, queues_bits.as_slice()?, &mut ids);
        Ok(ids.into_pyarray(py))
    }

    /// The route from ``from_`` to ``goal``: a point [m], or the id of an SN, into whose range it leads. None if there
    /// is none.
    pub fn route(&self, from: &Bound<'_, PyAny>, goal: &Bound<'_, PyAny>) -> PyResult<Option<PyRoute>> {
        let from = ground(from)?;
        if goal.hasattr("__len__")? {
            return Ok(self.data.route_into(&from, &ground(goal)?, 0.0).as_ref().map(PyRoute::of));
        }
        let id: u32 =
            goal.extract().map_err(|_| refused(format!("goal {goal}: expected a point, or the id of an SN")))?;
        if id as usize >= self.data.count() {
            return Err(refused(format!("goal {id}: expected the id of a sensor node, below {}", self.data.count())));
        }
        let route = self.data.route_into(&from, self.data.sensors.position(id), self.comm_radius_m);
        Ok(route.as_ref().map(PyRoute::of))
    }

    /// The point that one slot at full speed reaches from ``from_`` toward ``to``, at most ``to`` [m], [2].
    fn toward<'py>(
        &self,
        py: Python<'py>,
        from: &Bound<'py, PyAny>,
        to: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let point = self.data.motion.toward(&ground(from)?, &ground(to)?);
        Ok([point.x, point.y].to_pyarray(py))
    }

    fn __repr__(&self) -> String {
        let Self { area_m: (width_m, height_m), reach_m, comm_radius_m, resource_blocks, .. } = self;
        format!(
            "Field({} sensor nodes over {width_m} m x {height_m} m, reach_m={reach_m}, comm_radius_m={comm_radius_m}, \
             resource_blocks={resource_blocks})",
            self.data.count()
        )
    }
}

/// Where UAVs land and charge (decision D9).
#[pyclass(name = "Base", module = "skysink", frozen)]
pub struct PyBase(Base);

#[pymethods]
impl PyBase {
    /// A place well inside of each of its areas [m], [K, 2]; the centre of a disk.
    #[getter]
    fn places_m(&self) -> Vec<(f64, f64)> {
        self.0.places().map(|place| (place.x, place.y)).collect()
    }

    /// Its radius [m]; None if it is made of polygons or of several sites.
    #[getter]
    fn radius_m(&self) -> Option<f64> {
        match &self.0 {
            Base::Disk { radius_m, .. } => Some(*radius_m),
            Base::Areas(_) | Base::Sites(_) => None,
        }
    }

    /// Whether ``point`` [m] lies in it.
    fn contains(&self, point: &Bound<'_, PyAny>) -> PyResult<bool> {
        Ok(self.0.contains(&ground(point)?))
    }

    fn __repr__(&self) -> String {
        format!("Base({:?}, radius_m={:?})", self.places_m(), self.radius_m())
    }
}
