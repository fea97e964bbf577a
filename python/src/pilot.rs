//! Python strategies: their view of a slot, their decision, and the resulting plan.

use std::sync::Arc;
use std::time::Instant;

use nalgebra::Point3;
use numpy::ndarray::ArrayView1;
use numpy::{PyArray1, PyArrayMethods, ToPyArray};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use skysink_common::message::{MAX_SERVED, Mode, Plan};
use skysink_common::slot_record::{Plans, UAV};
use skysink_mission::drive::{Ended, Pilot};
use skysink_mission::{MissionError, Plant};

use crate::belief::{Contacts, PyBelief, new_object};
use crate::errors::refused;
use crate::field::{FieldData, PyField, coordinates, read_only};
use crate::values::Reduced;

/// Queues that are shared with Python.
#[pyclass(module = "skysink", frozen)]
struct HeldQueues(Arc<Vec<u32>>);

/// The input of a strategy in one slot.
#[pyclass(name = "View", module = "skysink", frozen, get_all)]
pub struct PyView {
    /// The slot to plan, t, from 1.
    slot: u64,
    /// Position of the UAV at the start of the slot, L_u(t-1) [m], [3], read-only.
    uav: Py<PyArray1<f64>>,
    /// Queues at the start of the slot, true or estimated, B_i(t-1) [bit], [N], read-only.
    ///
    /// The array shares memory with the field. In ``simulate`` and sweeps, a stored array does not change. In a ring,
    /// it is valid only during ``plan``; copy it to store it. It is unsigned: use ``astype(np.int64)`` for differences.
    queues_bits: Py<PyArray1<u32>>,
    /// Sampling rates as known at the start of the slot, true or learnt [bit/s], [N], read-only.
    sampling_bps: Py<PyArray1<f64>>,
    /// Queues and rates as known at the start of the slot, each with its standard deviation, and the ages of the
    /// contacts. None in a ring.
    belief: Option<Py<PyBelief>>,
    /// What stays the same.
    field: Py<PyField>,
}

/// The decision of a strategy: ``Decision((x, y))`` or ``Decision((x, y, z), serve=[3, 7])``.
#[pyclass(name = "Decision", module = "skysink", frozen, get_all)]
pub struct PyDecision {
    waypoint: Vec<f64>,
    serve: Option<Vec<u32>>,
}

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
        Ok(Self { waypoint: waypoint_m, serve })
    }

    /// For pickle and copy.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> Reduced<'py, (Vec<f64>, Option<Vec<u32>>)> {
        let this = slf.get();
        (slf.get_type().into_any(), (this.waypoint.clone(), this.serve.clone()))
    }

    fn __repr__(&self) -> String {
        let serve = self.serve.as_ref().map_or_else(|| "None".to_owned(), |ids| format!("{ids:?}"));
        format!("Decision(waypoint={:?}, serve={serve})", self.waypoint)
    }
}

impl PyDecision {
    /// The plan that follows from it over `field`, from the position of the UAV and the queues [bit].
    pub fn plan(&self, field: &FieldData, uav: Point3<f64>, queues_bits: &[u32], mode: Mode) -> Plan {
        let altitude_m = self.waypoint.get(2).copied().unwrap_or(uav.z);
        let waypoint = Point3::new(self.waypoint[0], self.waypoint[1], altitude_m);
        field.plan(waypoint, self.serve.as_deref(), queues_bits, mode)
    }
}

/// A Python strategy with its field, which plans a mission of this process or for a ring.
#[pyclass(name = "PlanMaker", module = "skysink", frozen)]
pub struct PyPlanMaker {
    strategy: Py<PyAny>,
    field: Py<PyField>,
    /// The rates before slot 1, which stay unless they are learnt.
    sampling_bps: Py<PyArray1<f64>>,
    /// The contacts of the mission that it flies as a pilot.
    contacts: Contacts,
}

#[pymethods]
impl PyPlanMaker {
    /// Wraps a strategy and calls its `begin(field)`.
    #[new]
    pub fn new(py: Python<'_>, strategy: Py<PyAny>, field: Py<PyField>) -> PyResult<Self> {
        strategy.call_method1(py, "begin", (&field,))?;
        let sampling_bps = field.get().data.sampling_bps(py)?.unbind();
        let contacts = Contacts::none(field.get().data.count());
        Ok(Self { strategy, field, sampling_bps, contacts })
    }

    /// The message of the plan for `slot`, from the position of the flight before it [m], the queues [bit], and the
    /// learnt rates [bit/s] or None.
    #[pyo3(signature = (slot, uav, queues_bits, learnt_bps = None))]
    fn plan(
        &self,
        py: Python<'_>,
        slot: u64,
        uav: [f64; 3],
        queues_bits: &Bound<'_, PyArray1<u32>>,
        learnt_bps: Option<Bound<'_, PyArray1<f64>>>,
    ) -> PyResult<Vec<u8>> {
        let field = &self.field.get().data;
        field.check(queues_bits.len()?)?;
        learnt_bps.as_ref().map_or(Ok(()), |learnt_bps| field.check(learnt_bps.len()?))?;
        let plan = self.timed_plan(py, slot, Point3::from(uav), queues_bits, learnt_bps, None)?;
        Ok(bytemuck::bytes_of(&plan).to_vec())
    }
}

impl PyPlanMaker {
    /// The plan of a slot, from the position of the UAV, the queues [bit], the learnt rates [bit/s] and the belief,
    /// with the time that it took.
    fn timed_plan(
        &self,
        py: Python<'_>,
        slot: u64,
        uav: Point3<f64>,
        queues_bits: &Bound<'_, PyArray1<u32>>,
        learnt_bps: Option<Bound<'_, PyArray1<f64>>>,
        belief: Option<PyBelief>,
    ) -> PyResult<Plan> {
        let begin = Instant::now();
        let known_bps = || new_object(self.sampling_bps.bind(py));
        let view = PyView {
            slot,
            uav: read_only([uav.x, uav.y, uav.z].to_pyarray(py))?.unbind(),
            queues_bits: new_object(queues_bits)?.unbind(),
            sampling_bps: learnt_bps.map_or_else(known_bps, Ok)?.unbind(),
            belief: belief.map(|belief| Py::new(py, belief)).transpose()?,
            field: self.field.clone_ref(py),
        };
        let decided = self.strategy.call_method1(py, "plan", (view,))?;
        let decision: Option<PyRef<'_, PyDecision>> = decided.extract(py).map_err(|_| wrong(&decided))?;
        let field = &self.field.get().data;
        let queues_bits = queues_bits.try_readonly()?;
        let queues_bits = queues_bits.as_slice()?;
        let mut plan = match decision {
            Some(decision) => decision.plan(field, uav, queues_bits, Mode::Serve),
            None => field.transit(uav, queues_bits),
        };
        plan.plan_ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        Ok(plan)
    }

    /// The plan of the next slot of a mission. If the UAV has to estimate the queues from its contacts, the strategy
    /// gets the estimate.
    fn plan_next(&mut self, py: Python<'_>, plant: &Plant) -> PyResult<Plan> {
        py.check_signals()?;
        self.contacts.add(plant.slot(), plant.flight(UAV));
        let queues_bits = if plant.field().belief().is_estimated() {
            plant.field().believed_bits().to_pyarray(py)
        } else {
            held(py, plant.field().shared_queues_bits())?
        };
        let queues_bits = read_only(queues_bits)?;
        let field = &self.field.get().data;
        let learnt_bps =
            plant.field().belief().has_learnt_rates().then(|| believed_bps(py, plant, field)).transpose()?;
        let sampling_bps = learnt_bps.as_ref().unwrap_or_else(|| self.sampling_bps.bind(py));
        let belief = PyBelief::of(py, plant, field, &queues_bits, sampling_bps, self.contacts.clone())?;
        let slot = plant.slot() + 1;
        let flight = plant.flight(UAV);
        let plan = self.timed_plan(py, slot, flight.position(), &queues_bits, learnt_bps, Some(belief))?;
        Ok(field.ruled(slot, flight, plan, queues_bits.try_readonly()?.as_slice()?))
    }
}

impl Pilot for PyPlanMaker {
    fn plans(&mut self, plant: &Plant) -> Result<Plans, Ended> {
        let planned =
            Python::attach(|py| self.plan_next(py, plant).map_err(|error| in_slot(py, plant.slot() + 1, error)));
        let plan = planned.map_err(|error| MissionError::Foreign(Box::new(error)))?;
        Ok(Plans::from_buf([Some(plan)]))
    }
}

/// The sampling rates that the UAV of `plant` believes in over `field` [bit/s].
pub fn believed_bps<'py>(py: Python<'py>, plant: &Plant, field: &FieldData) -> PyResult<Bound<'py, PyArray1<f64>>> {
    match plant.field().belief().learnt_bps(field.limits.slot_s) {
        Some(learnt_bps) => read_only(PyArray1::from_iter(py, learnt_bps)),
        None => field.sampling_bps(py),
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
