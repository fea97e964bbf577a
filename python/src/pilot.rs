//! Python strategies: their view of a slot, their decision, and the resulting plan.

use std::sync::Arc;
use std::time::Instant;

use nalgebra::Point3;
use numpy::ndarray::ArrayView1;
use numpy::{PyArray1, PyArrayMethods, ToPyArray};
use pyo3::exceptions::PyRuntimeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use skysink_common::geometry::above;
use skysink_common::message::{MAX_SERVED, Mode, Plan};
use skysink_common::slot_record::Plans;
use skysink_common::slot_record::UAV;
use skysink_mission::Plant;
use skysink_mission::drive::{Ended, Pilot, elapsed_ns};

use crate::errors::{failed, refused};
use crate::field::{FieldData, PyField, coordinates, read_only};

/// Queues that are shared with Python.
#[pyclass(module = "skysink", frozen)]
struct HeldQueues(Arc<Vec<u32>>);

/// The input of a strategy in one slot.
#[pyclass(name = "View", module = "skysink", frozen)]
pub struct PyView {
    /// The slot to plan, t, from 1.
    #[pyo3(get)]
    slot: u64,
    /// Position of the UAV at the start of the slot, L_u(t-1) [m], [3], read-only.
    #[pyo3(get)]
    uav: Py<PyArray1<f64>>,
    /// Queues at the start of the slot, true or estimated, B_i(t-1) [bit], [N], read-only.
    ///
    /// The array shares memory with the field. In ``simulate`` and sweeps, a stored array does not change. In a ring,
    /// it is valid only during ``plan``; copy it to store it. It is unsigned: use ``astype(np.int64)`` for differences.
    #[pyo3(get)]
    queues_bits: Py<PyArray1<u32>>,
    /// What stays the same.
    #[pyo3(get)]
    field: Py<PyField>,
}

/// The decision of a strategy: ``Decision((x, y))`` or ``Decision((x, y, z), serve=[3, 7])``.
#[pyclass(name = "Decision", module = "skysink", frozen)]
pub struct PyDecision {
    waypoint_m: Vec<f64>,
    serve: Option<Vec<u32>>,
}

/// The components of a decision: waypoint [m] and schedule.
type Arguments = (Vec<f64>, Option<Vec<u32>>);

#[pymethods]
impl PyDecision {
    /// ``waypoint`` [m]; without z, the altitude is kept. ``serve`` contains ids, by default the n fullest in range.
    ///
    /// Raises :class:`InputError` for a waypoint of another shape or more than 64 SNs.
    #[new]
    #[pyo3(signature = (waypoint, serve = None))]
    fn new(waypoint: &Bound<'_, PyAny>, serve: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let waypoint_m = coordinates(waypoint)?;
        if !(2..=3).contains(&waypoint_m.len()) {
            return Err(refused(format!("waypoint {waypoint}: expected (x, y) or (x, y, z) [m]")));
        }
        let id = |id: PyResult<Bound<'_, PyAny>>| {
            let id = id?;
            id.extract::<u32>()
                .map_err(|_| refused(format!("serve: {id}: expected the id of a sensor node, 0 or above")))
        };
        let serve = serve.map(|serve| serve.try_iter()?.map(id).collect::<PyResult<Vec<u32>>>()).transpose()?;
        if let Some(ids) = serve.as_ref().filter(|ids| ids.len() > MAX_SERVED) {
            return Err(refused(format!("serve: {} sensor nodes: expected at most {MAX_SERVED}", ids.len())));
        }
        Ok(Self { waypoint_m, serve })
    }

    /// For pickle and copy.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> (Bound<'py, PyAny>, Arguments) {
        let this = slf.get();
        (slf.get_type().into_any(), (this.waypoint_m.clone(), this.serve.clone()))
    }

    #[getter]
    fn waypoint(&self) -> Vec<f64> {
        self.waypoint_m.clone()
    }

    #[getter]
    fn serve(&self) -> Option<Vec<u32>> {
        self.serve.clone()
    }

    fn __repr__(&self) -> String {
        let serve = self.serve.as_ref().map_or_else(|| "None".to_owned(), |ids| format!("{ids:?}"));
        format!("Decision(waypoint={:?}, serve={serve})", self.waypoint_m)
    }
}

impl PyDecision {
    /// The waypoint [m]; `altitude_m` if it has no z.
    pub fn waypoint_from(&self, altitude_m: f64) -> Point3<f64> {
        Point3::new(self.waypoint_m[0], self.waypoint_m[1], self.waypoint_m.get(2).copied().unwrap_or(altitude_m))
    }

    /// The schedule; `None` for the fullest in range.
    pub fn schedule(&self) -> Option<&[u32]> {
        self.serve.as_deref()
    }
}

/// A Python strategy with its field.
pub struct PythonPlanner {
    strategy: Py<PyAny>,
    field: Py<PyField>,
    data: Arc<FieldData>,
    ids: Vec<u32>,
}

impl PythonPlanner {
    /// Wraps this strategy and calls its `begin(field)`.
    pub fn new(py: Python<'_>, strategy: Py<PyAny>, field: PyField) -> PyResult<Self> {
        let data = Arc::clone(&field.0);
        let field = Py::new(py, field)?;
        strategy.call_method1(py, "begin", (&field,))?;
        Ok(Self { strategy, field, data, ids: Vec::new() })
    }

    /// The plan of a slot, from the position of the UAV and the queues [bit].
    pub fn plan<'py>(
        &mut self,
        py: Python<'py>,
        slot: u64,
        uav: Point3<f64>,
        queues_bits: &Bound<'py, PyArray1<u32>>,
    ) -> PyResult<Plan> {
        let view = PyView {
            slot,
            uav: read_only([uav.x, uav.y, uav.z].to_pyarray(py))?.unbind(),
            // A new array object, whose shape the strategy may change; the memory is shared.
            queues_bits: queues_bits.call_method0(intern!(py, "view"))?.cast_into()?.unbind(),
            field: self.field.clone_ref(py),
        };
        let decided = self.strategy.call_method1(py, "plan", (view,))?;
        let queues_bits = queues_bits.try_readonly()?;
        let queues_bits = queues_bits.as_slice()?;
        let Some(decision) = decided.extract::<Option<PyRef<'_, PyDecision>>>(py).map_err(|_| wrong(&decided))? else {
            let ground = self.data.clamp_to_area(self.data.transit(&uav, queues_bits));
            self.data.fill_fullest(&ground, queues_bits, &mut self.ids);
            return Ok(self.message(above(&ground, uav.z), Mode::Transit));
        };
        let waypoint = decision.waypoint_from(uav.z);
        match decision.schedule() {
            Some(ids) => ids.clone_into(&mut self.ids),
            None => self.data.fill_fullest(&waypoint.xy(), queues_bits, &mut self.ids),
        }
        Ok(self.message(waypoint, Mode::Serve))
    }

    fn message(&self, waypoint: Point3<f64>, mode: Mode) -> Plan {
        let mut plan = Plan::fly_to(waypoint, mode);
        plan.schedule(&self.ids);
        plan
    }

    /// The plan of the next slot of a mission. If the UAV has to estimate the queues from its contacts, the strategy
    /// gets the estimate.
    fn plan_next(&mut self, py: Python<'_>, plant: &Plant) -> PyResult<Plan> {
        let queues_bits = if plant.field().has_estimate() {
            plant.known_bits().to_pyarray(py)
        } else {
            held(py, plant.field().shared_queues_bits())?
        };
        self.plan(py, plant.slot() + 1, plant.flight(UAV).position(), &read_only(queues_bits)?)
    }
}

/// Plans a mission of this process with a Python strategy.
pub struct PythonPilot<'py> {
    pub py: Python<'py>,
    pub planner: PythonPlanner,
}

impl Pilot for PythonPilot<'_> {
    fn plans(&mut self, plant: &Plant) -> Result<Plans, Ended> {
        let Self { py, planner } = self;
        let begin = Instant::now();
        let planned = py.check_signals().and_then(|()| planner.plan_next(*py, plant));
        let mut plan = planned.map_err(|error| failed(in_slot(*py, plant.slot() + 1, error)))?;
        plan.plan_ns = elapsed_ns(begin);
        Ok(Plans::from_buf([Some(plan)]))
    }
}

/// The error of a strategy with the slot that it was planning.
fn in_slot(py: Python<'_>, slot: u64, error: PyErr) -> PyErr {
    let note = format!("while planning slot {slot}");
    match error.value(py).call_method1("add_note", (note,)) {
        Ok(_) => error,
        Err(_) => PyRuntimeError::new_err(error.to_string()),
    }
}

fn wrong(decided: &Py<PyAny>) -> PyErr {
    refused(format!("plan() returned {decided}: expected a skysink.Decision, or None for the transit rule"))
}

/// The queues as an array over the memory of the field. That memory is copied before a change only if the array is
/// still referenced.
fn held(py: Python<'_>, queues_bits: Arc<Vec<u32>>) -> PyResult<Bound<'_, PyArray1<u32>>> {
    let holder = Bound::new(py, HeldQueues(queues_bits))?;
    let queues_bits = ArrayView1::from(&holder.get().0[..]);
    // SAFETY: the array keeps `holder`, the owner of the vector, alive; the vector is not changed while it is shared.
    Ok(unsafe { PyArray1::borrow_from_array(&queues_bits, holder.clone().into_any()) })
}

/// A Python strategy that plans for a ring.
#[pyclass(name = "PlanMaker", module = "skysink", unsendable)]
pub struct PyPlanMaker(PythonPlanner);

#[pymethods]
impl PyPlanMaker {
    #[new]
    fn new(py: Python<'_>, strategy: Py<PyAny>, field: &Bound<'_, PyField>) -> PyResult<Self> {
        PythonPlanner::new(py, strategy, PyField(Arc::clone(&field.get().0))).map(Self)
    }

    /// The message of the plan for `slot`, from the position of the flight before it [m] and the queues [bit].
    fn plan<'py>(
        &mut self,
        py: Python<'py>,
        slot: u64,
        uav: [f64; 3],
        queues_bits: Bound<'py, PyArray1<u32>>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        self.0.data.check(queues_bits.len()?)?;
        let begin = Instant::now();
        let mut plan = self.0.plan(py, slot, Point3::from(uav), &queues_bits)?;
        plan.plan_ns = elapsed_ns(begin);
        Ok(PyBytes::new(py, bytemuck::bytes_of(&plan)))
    }
}
