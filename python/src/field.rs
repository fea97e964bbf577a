//! `skysink.Field`: the constant data of a mission.

use std::sync::Arc;

use nalgebra::Point3;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, ToPyArray};
use pyo3::prelude::*;
use skysink_common::airspace::Airspace;
use skysink_common::battery::BatteryState;
use skysink_common::belief::Belief;
use skysink_common::geometry::{Position, above};
use skysink_common::message::{FlightReport, Limits, MAX_SERVED, Mode, Plan, SensorNode};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::{SensorList, Sensors};
use skysink_planner::geometry::disks::toward;
use skysink_planner::home::{Home, Returning};
use skysink_planner::strategies::serving::fill_fullest_in_range;
use skysink_planner::strategies::transit::transit_goal;

use crate::errors::refused;
use crate::values::Reduced;

/// The sensor nodes of a mission and the limits of its plans.
pub struct FieldData {
    /// The limits of plans.
    pub limits: Limits,
    /// The sensor nodes.
    pub sensors: Sensors,
    /// Their buffers [bit], for observations.
    pub buffers_bits: Vec<f32>,
    /// The way home; `None` if the UAV need not come back, and in a ring.
    pub home: Option<Home>,
    /// Where the UAV may fly; in a ring everywhere.
    pub airspace: Arc<Airspace>,
    /// The same as published.
    nodes: Vec<SensorNode>,
}

impl FieldData {
    /// The field of a scenario as the UAV knows it by `belief`.
    pub fn of(scenario: &Scenario, list: &SensorList, belief: &Belief) -> Self {
        let field = Self::new(Limits::of(scenario), belief.known_nodes(list.nodes(), scenario.slot_s));
        let airspace = Arc::new(scenario.airspace());
        Self { home: Home::of(scenario, &airspace), airspace, ..field }
    }

    /// The field with these limits and sensor nodes.
    fn new(limits: Limits, nodes: Vec<SensorNode>) -> Self {
        let buffers_bits = nodes.iter().map(|node| node.capacity_bits as f32).collect();
        let sensors = Sensors::new(&limits, &nodes);
        Self { sensors, limits, buffers_bits, home: None, airspace: Arc::default(), nodes }
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

    /// Buffers of the sensor nodes [bit].
    pub fn capacities_bits(&self) -> impl Iterator<Item = u32> {
        self.nodes.iter().map(|node| node.capacity_bits)
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

    /// The plan to fly to `waypoint` [m] and serve these SNs, or the fullest in range.
    pub fn plan(&self, waypoint: Point3<f64>, serve: Option<&[u32]>, queues_bits: &[u32], mode: Mode) -> Plan {
        let mut plan = Plan::fly_to(waypoint, mode);
        match serve {
            Some(ids) => plan.schedule(ids),
            None => plan.schedule(&self.fullest(&waypoint.xy(), queues_bits)),
        }
        plan
    }

    /// The end of a slot toward `goal`: straight, or around zones.
    pub fn toward(&self, from: &Position, goal: &Position) -> Position {
        let reach_m = self.limits.reach_m;
        if self.airspace.is_open() { toward(reach_m, from, goal) } else { self.airspace.toward(from, goal, reach_m) }
    }

    /// What becomes of the plan for `slot`, after the flight `last`, by the rules that hold for all strategies: it
    /// flies around zones (decision D15), and home in time (decision D13).
    pub fn ruled(&self, slot: u64, last: &FlightReport, plan: Plan, queues_bits: &[u32]) -> Plan {
        let at = last.position();
        let waypoint = plan.waypoint();
        let end = self.airspace.slot_end(slot, &at.xy(), &waypoint.xy(), self.limits.reach_m);
        let plan = if end == waypoint.xy() {
            plan
        } else {
            let around = above(&end, waypoint.z);
            let mode = Mode::from_repr(plan.mode).unwrap_or_default();
            Plan { plan_ns: plan.plan_ns, ..self.plan(around, None, queues_bits, mode) }
        };
        let Some(home) = &self.home else { return plan };
        let state = BatteryState::after(last);
        let way = [&at, &plan.waypoint()];
        let returning = if home.charges_on(slot, &state) {
            Returning::Charges
        } else {
            home.rule(slot, &state, way, plan.served == 0)
        };
        let returned = match returning {
            Returning::Not => return plan,
            Returning::Charges => self.plan(at, Some(&[]), queues_bits, Mode::Charge),
            Returning::Flies(waypoint) => self.plan(waypoint, None, queues_bits, Mode::Return),
        };
        Plan { plan_ns: plan.plan_ns, ..returned }
    }

    /// The plan of the transit rule (decision D8).
    pub fn transit(&self, uav: Point3<f64>, queues_bits: &[u32]) -> Plan {
        let from = uav.xy();
        let goal = transit_goal(&self.sensors.positions, &from, queues_bits);
        let ground = goal.map_or(from, |goal| self.toward(&from, goal));
        self.plan(above(&self.clamp_to_area(ground), uav.z), None, queues_bits, Mode::Transit)
    }

    /// The n fullest queues within `d_c` of `ground`.
    pub fn fullest(&self, ground: &Position, queues_bits: &[u32]) -> Vec<u32> {
        let mut ids = Vec::with_capacity(MAX_SERVED);
        fill_fullest_in_range(&self.sensors.grid, &self.limits, ground, queues_bits, &mut ids);
        ids
    }

    /// The point of the area nearest to `ground`.
    pub fn clamp_to_area(&self, ground: Position) -> Position {
        Position::new(ground.x.clamp(0.0, self.limits.width_m), ground.y.clamp(0.0, self.limits.height_m))
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
    /// The field with these data.
    pub fn new(data: Arc<FieldData>) -> Self {
        let limits = data.limits;
        Self {
            capacity_bits: data.capacities_bits().max().unwrap_or(0),
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

    /// The field of a scenario as the UAV knows it by `belief`.
    pub fn of(scenario: &Scenario, list: &SensorList, belief: &Belief) -> Self {
        Self::new(Arc::new(FieldData::of(scenario, list, belief)))
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
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py, (Vec<u8>, Vec<u8>)>> {
        let field = &slf.get().data;
        let limits = bytemuck::bytes_of(&field.limits).to_vec();
        let nodes = bytemuck::cast_slice(&field.nodes).to_vec();
        Ok((slf.get_type().getattr("_from_messages")?, (limits, nodes)))
    }

    /// Creates a field from limits and sensor nodes in the layout of the messages of the ring.
    #[staticmethod]
    fn _from_messages(limits: &[u8], nodes: &[u8]) -> PyResult<Self> {
        let refuse = |_| refused("messages of another version: use the package of the running Skysink");
        let limits = bytemuck::try_pod_read_unaligned(limits).map_err(refuse)?;
        Ok(Self::new(Arc::new(FieldData::new(limits, bytemuck::pod_collect_to_vec(nodes)))))
    }

    fn __len__(&self) -> usize {
        self.data.count()
    }

    /// Positions of the SNs, east and north [m], [N, 2]. Every access creates a new array.
    #[getter]
    fn positions_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let positions = &self.data.sensors.positions;
        let array = Array2::from_shape_fn((positions.len(), 2), |(sensor, axis)| positions[sensor][axis]);
        read_only(array.into_pyarray(py))
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
        read_only(PyArray1::from_iter(py, self.data.capacities_bits()))
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

    /// Ids of the n SNs with the fullest queues within d_c of ``point``, ascending. Ties go to the lowest id.
    fn fullest<'py>(
        &self,
        py: Python<'py>,
        point: &Bound<'py, PyAny>,
        queues_bits: PyReadonlyArray1<'py, u32>,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        self.data.check(queues_bits.len()?)?;
        Ok(self.data.fullest(&ground(point)?, queues_bits.as_slice()?).into_pyarray(py))
    }

    /// The point that one slot at full speed reaches from ``from_`` toward ``to``, at most ``to`` [m], [2].
    fn toward<'py>(
        &self,
        py: Python<'py>,
        from: &Bound<'py, PyAny>,
        to: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let point = self.data.toward(&ground(from)?, &ground(to)?);
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
