//! Strategies in Python: a class becomes a [`Strategy`] of the planner, in a mission of this process and in a ring.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Point3;
use numpy::PyArray1;
use pyo3::exceptions::PyRuntimeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use skysink_common::belief::Belief;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::error::InputError;
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, MAX_SERVED, SolverOutcome};
use skysink_common::stop::Stop;
use skysink_planner::node::ROOM;
use skysink_planner::serving::Serving;
use skysink_planner::strategy::{Decision, Setup, Strategy, View};

use crate::belief::Contacts;
use crate::errors::refused;
use crate::field::{FieldData, PyField, coordinates};
use crate::signals::INTERRUPT;
use crate::values::Reduced;
use crate::view::{PyFlight, PyView};

/// The decision of a strategy: ``Decision((x, y))`` or ``Decision((x, y, z), serve=[3, 7])``.
#[pyclass(name = "Decision", module = "skysink", frozen, get_all)]
pub struct PyDecision {
    waypoint: Vec<f64>,
    serve: Option<Vec<u32>>,
}

#[pymethods]
impl PyDecision {
    /// ``waypoint`` [m]; without z, a free altitude is that which is best for the SNs that are served. ``serve``
    /// contains ids, by default those of the n fullest in range, by weight and queue.
    ///
    /// Raises :class:`InputError` for a waypoint of another shape, or with NaN or infinity, and for more than 64 SNs.
    #[new]
    #[pyo3(signature = (waypoint, serve = None))]
    fn new(waypoint: &Bound<'_, PyAny>, serve: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let waypoint_m = coordinates(waypoint)?;
        if !(2..=3).contains(&waypoint_m.len()) {
            return Err(refused(format!("waypoint {waypoint}: expected (x, y) or (x, y, z) [m]")));
        }
        if waypoint_m.iter().any(|coordinate| !coordinate.is_finite()) {
            return Err(refused(format!("waypoint {waypoint_m:?}: expected finite coordinates [m]")));
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
    /// The same for the planner. A waypoint outside the area stays there, so that it is refused.
    ///
    /// # Errors
    /// If it names an unknown sensor node.
    pub fn decide(&self, view: &View, serving: &mut Serving) -> PyResult<Decision> {
        let count = view.table.sensors.count();
        if let Some(id) = self.serve.iter().flatten().find(|&&id| id as usize >= count) {
            return Err(refused(format!("serve: {id}: expected the id of a sensor node, below {count}")));
        }
        let ground = Position::new(self.waypoint[0], self.waypoint[1]);
        let is_inside = view.table.limits.area().contains(&ground, 0.0);
        let mut decision = match &self.serve {
            None if is_inside => serving.serve_fullest(view, &ground),
            serve => {
                let ids = serve.as_deref().unwrap_or_default();
                let at = if is_inside { serving.above(view, &ground, ids) } else { view.position };
                let schedule = ids.iter().copied().collect();
                Decision { waypoint: at, schedule, outcome: SolverOutcome::Rule, winner: None }
            }
        };
        let z_m = self.waypoint.get(2).copied().unwrap_or(decision.waypoint.z);
        decision.waypoint = Point3::new(ground.x, ground.y, z_m);
        Ok(decision)
    }
}

/// The first exception of the Python code that plans or flies a mission, which ends it.
#[derive(Clone, Default)]
pub struct Raised {
    error: Arc<Mutex<Option<PyErr>>>,
    /// Ends the mission.
    pub stop: Stop,
}

impl Raised {
    /// For a mission that `stop` ends.
    pub fn new(stop: &Stop) -> Self {
        Self { error: Arc::default(), stop: stop.clone() }
    }

    /// Keeps the exception, unless there is an earlier one, and requests the stop.
    pub fn keep(&self, error: PyErr) {
        self.error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        self.stop.flag().store(INTERRUPT, std::sync::atomic::Ordering::Relaxed);
    }

    /// The same with a note that names the slot.
    pub fn keep_in_slot(&self, py: Python<'_>, slot: u64, error: PyErr) {
        let note = format!("while planning slot {slot}");
        match error.value(py).call_method1("add_note", (note,)) {
            Ok(_) => self.keep(error),
            Err(_) => self.keep(PyRuntimeError::new_err(error.to_string())),
        }
    }

    /// Raises the exception, if there is one.
    pub fn check(&self) -> PyResult<()> {
        self.error.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

/// Makes the strategies of a mission in Python, one for each UAV.
pub struct PyStrategies {
    /// In the order of the UAVs.
    objects: std::vec::IntoIter<Py<PyAny>>,
    /// The class of the first.
    pub class: String,
    /// The first.
    pub first: Py<PyAny>,
    /// The first exception of all of them.
    pub raised: Raised,
}

impl PyStrategies {
    /// The strategies of `uavs` UAVs: `maker`, if it is an object, or what it returns, called once for each UAV.
    ///
    /// # Errors
    /// If it is an object, or returns the same twice, and there are several UAVs; if it returns something else.
    pub fn new(maker: &Bound<'_, PyAny>, uavs: usize, raised: &Raised) -> PyResult<Self> {
        let py = maker.py();
        let base = py.import("skysink.strategy")?.getattr("Strategy")?;
        let make = |_: usize| if maker.is_instance(&base)? { Ok(maker.clone()) } else { maker.call0() };
        let objects = (0..uavs).map(make).collect::<PyResult<Vec<_>>>()?;
        if let Some(other) = objects.iter().find(|object| !object.is_instance(&base).is_ok_and(|is| is)) {
            return Err(refused(format!("strategy {other}: expected a skysink.Strategy")));
        }
        let is_again =
            |(index, object): (usize, &Bound<'_, PyAny>)| objects[..index].iter().any(|other| other.is(object));
        if objects.iter().enumerate().any(is_again) {
            let expected = format!("expected a class, so that each of the {uavs} UAVs has an object of its own");
            return Err(refused(format!("strategy {}: {expected}", objects[0])));
        }
        let first = objects[0].clone().unbind();
        let class = objects[0].get_type().name()?.to_string();
        let objects: Vec<Py<PyAny>> = objects.into_iter().map(Bound::unbind).collect();
        Ok(Self { objects: objects.into_iter(), class, first, raised: raised.clone() })
    }

    /// The strategy of the next UAV, which has begun.
    ///
    /// # Errors
    /// If its `begin` raises an exception, which is kept.
    pub fn next(&mut self, setup: &Setup<'_>) -> Result<Box<dyn Strategy>, InputError> {
        let object = self.objects.next().expect("an object for each UAV");
        let begun = Python::attach(|py| PyStrategy::begin(py, object, setup, &self.raised));
        begun.map(|strategy| Box::new(strategy) as Box<dyn Strategy>).map_err(|error| {
            self.raised.keep(error);
            InputError::of_argument("strategy", &self.class, "its begin() failed")
        })
    }
}

/// A strategy in Python. The thread that plans calls it.
struct PyStrategy {
    object: Py<PyAny>,
    field: Py<PyField>,
    /// The rates before slot 1, which stay unless they are learnt.
    sampling_bps: Py<PyArray1<f64>>,
    contacts: Contacts,
    serving: Serving,
    /// Whether its class has an `observe`.
    observes: bool,
    raised: Raised,
}

impl PyStrategy {
    /// The strategy of this object, whose `begin(field)` is called.
    fn begin(py: Python<'_>, object: Py<PyAny>, setup: &Setup<'_>, raised: &Raised) -> PyResult<Self> {
        let field = FieldData::of_setup(setup);
        let sampling_bps = field.sampling_bps(py)?.unbind();
        let contacts = Contacts::none(field.count());
        let field = Py::new(py, PyField::new(field))?;
        object.call_method1(py, "begin", (&field,))?;
        let base = py.import("skysink.strategy")?.getattr("Strategy")?;
        let observes = !object.bind(py).get_type().getattr("observe")?.is(&base.getattr("observe")?);
        let serving = Serving::new(setup);
        let raised = raised.clone();
        Ok(Self { object, field, sampling_bps, contacts, serving, observes, raised })
    }

    /// What it decides; `None` for transit.
    fn decide(&mut self, py: Python<'_>, view: &View<'_>) -> PyResult<Option<Decision>> {
        let seen = PyView::of(py, view, &self.field, &self.sampling_bps, &self.contacts)?;
        let decided = self.object.call_method1(py, intern!(py, "plan"), (seen,))?;
        let decision: Option<PyRef<'_, PyDecision>> = decided.extract(py).map_err(|_| {
            refused(format!("plan() returned {decided}: expected a skysink.Decision, or None for the transit rule"))
        })?;
        decision.map(|decision| decision.decide(view, &mut self.serving)).transpose()
    }

    /// Checks for signals, and lets it observe flights, if it does.
    fn take_in(&self, py: Python<'_>, slot: u64, flights: &[FlightReport]) -> PyResult<()> {
        py.check_signals()?;
        if self.observes {
            let flights = flights.iter().map(|flight| PyFlight::of(py, flight)).collect::<PyResult<Vec<_>>>()?;
            self.object.call_method1(py, intern!(py, "observe"), (slot, flights))?;
        }
        Ok(())
    }

    /// Its state.
    fn state(&self) -> PyResult<Vec<u8>> {
        Python::attach(|py| {
            let state = self.object.bind(py).call_method0(intern!(py, "save"))?;
            let returned = "save() of the strategy returned";
            let Ok(bytes) = state.cast::<PyBytes>() else {
                return Err(refused(format!("{returned} {}: expected bytes", state.get_type().name()?)));
            };
            let bytes = bytes.as_bytes();
            if bytes.len() > ROOM / 2 {
                return Err(refused(format!("{returned} {} bytes: expected at most {}", bytes.len(), ROOM / 2)));
            }
            Ok(bytes.to_vec())
        })
    }
}

impl Strategy for PyStrategy {
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        if view.stop.requested().is_some() {
            return None; // it is not flown
        }
        Python::attach(|py| {
            self.decide(py, view).unwrap_or_else(|error| {
                self.raised.keep_in_slot(py, view.slot, error);
                None
            })
        })
    }

    fn observe(&mut self, slot: u64, flights: &[FlightReport], _belief: &Belief) {
        flights.iter().for_each(|flight| self.contacts.add(slot, flight));
        Python::attach(|py| {
            if let Err(error) = self.take_in(py, slot, flights) {
                self.raised.keep_in_slot(py, slot + 1, error);
            }
        });
    }
}

impl Checkpoint for PyStrategy {
    /// Appends nothing if there was no contact, and the object has no state.
    fn save(&self, bytes: &mut Vec<u8>) {
        match self.state() {
            Ok(state) if state.is_empty() && self.contacts.slots().iter().all(|slot| *slot == 0) => {}
            Ok(state) => encode(&(self.contacts.slots(), state), bytes),
            Err(error) => self.raised.keep(error),
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let (slots, state): (Vec<u64>, Vec<u8>) = if bytes.is_empty() { Default::default() } else { decode(bytes)? };
        let count = self.contacts.slots().len();
        let slots = if bytes.is_empty() { vec![0; count] } else { slots };
        self.contacts = Contacts::restored(slots, count, u64::MAX)?;
        if !state.is_empty() {
            let restored = Python::attach(|py| self.object.call_method1(py, "restore", (PyBytes::new(py, &state),)));
            restored.map_or_else(|error| self.raised.keep(error), drop);
        }
        Ok(())
    }
}
