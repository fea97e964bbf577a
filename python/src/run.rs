//! `skysink.simulate` and `skysink.Run`: a mission flown, slot by slot, and what it comes to.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use arrow_array::{ArrayRef, Float64Array, StringArray, UInt32Array, UInt64Array};
use numpy::PyArray2;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use skysink_common::message::{FlightReport, Mode, Plan, QueuesHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_field_sim::Field;
use skysink_lab::metrics::{Metric, MissionMeter};
use skysink_mission::mission::World;
use skysink_mission::origin::Manner;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::Summary;
use skysink_mission::trace::{RecordedSlot, TraceHash};
use skysink_mission::{Mission, MissionError, Replay};

use crate::episode::world;
use crate::errors::of_mission;
use crate::field::PyField;
use crate::pilot::Pilot;
use crate::scenario::PyScenario;
use crate::signals::interruptible;
use crate::table::{PyTable, id_lists};
use crate::values::json;

/// A mission as it is flown.
struct Recorder {
    slots: Vec<RecordedSlot>,
    hash: TraceHash,
    meter: MissionMeter,
}

impl Recorder {
    fn new(scenario: &Scenario, list: &SensorList, start: &QueuesHeader) -> Self {
        let meter = MissionMeter::new(scenario, list, start);
        Self { slots: Vec::new(), hash: TraceHash::default(), meter }
    }

    fn add(
        &mut self,
        plan: &Plan,
        flight: &FlightReport,
        header: &QueuesHeader,
        field: &Field,
    ) -> Result<(), MissionError> {
        self.hash.write(flight, header)?;
        self.hash.add();
        self.meter.add(Some(plan), flight, header, field);
        self.slots.push(RecordedSlot {
            slot: header.head.slot,
            position: flight.position(),
            scheduled: flight.served_links().iter().map(|link| link.sensor).collect(),
            delivered_bits: header.delivered_bits,
            lost_bits: header.lost_bits,
            queued_bits: header.totals.queued_bits,
            mode: Mode::from_repr(flight.mode).unwrap_or_default(),
            refused: flight.refused,
        });
        Ok(())
    }

    /// The mission whose last slot was added after `wall`.
    fn end(self, scenario: Scenario, list: SensorList, field: &Field, wall: Duration, label: Option<String>) -> PyRun {
        let mut summary = self.meter.tally().summary(None, wall, self.hash.value());
        if let Some(label) = &label {
            label.clone_into(&mut summary.strategy);
        }
        let values = self.meter.values(field, None, None);
        let metrics = Metric::all().map(|metric| (metric.name(), values[metric as usize]));
        let metrics = metrics.filter(|(_, value)| !value.is_nan()).collect();
        PyRun { scenario, list, label, slots: self.slots, summary, metrics }
    }
}

/// A mission that was flown. ``len`` is its number of slots.
#[pyclass(name = "Run", module = "skysink", frozen)]
pub struct PyRun {
    scenario: Scenario,
    list: SensorList,
    /// The planner, if it is not Skysink's.
    label: Option<String>,
    slots: Vec<RecordedSlot>,
    summary: Summary,
    metrics: Vec<(&'static str, f64)>,
}

impl PyRun {
    /// The mission flown again by its plans, each slot shown to `look`.
    fn fly_again<E>(&self, mut look: impl FnMut(&World, &QueuesHeader) -> Result<(), E>) -> Result<(), E> {
        let mut world = World::new(&self.scenario, &self.list);
        for slot in &self.slots {
            let plan = (!slot.is_missed()).then(|| slot.plan());
            let header = world.fly(plan.as_ref());
            look(&world, &header)?;
        }
        Ok(())
    }

    fn numbers(&self, of: impl Fn(&RecordedSlot) -> f64) -> ArrayRef {
        Arc::new(Float64Array::from_iter_values(self.slots.iter().map(of)))
    }

    fn counts(&self, of: impl Fn(&RecordedSlot) -> u64) -> ArrayRef {
        Arc::new(UInt64Array::from_iter_values(self.slots.iter().map(of)))
    }

    /// The mission flown by these plans.
    pub fn of_plans(scenario: &Scenario, list: &SensorList, plans: &[Plan], label: &str) -> Result<Self, MissionError> {
        let begin = Instant::now();
        let mut world = World::new(scenario, list);
        let mut recorder = Recorder::new(scenario, list, &world.header());
        for plan in plans {
            let header = world.fly(Some(plan));
            recorder.add(plan, world.last_flight(), &header, world.field())?;
        }
        let label = Some(label.to_owned());
        Ok(recorder.end(scenario.clone(), list.clone(), world.field(), begin.elapsed(), label))
    }
}

#[pymethods]
impl PyRun {
    /// The run in a folder, flown again to check every slot. Raises :class:`InputError` if it is none or changed.
    #[staticmethod]
    fn load(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        let read = move |stop: &Stop| -> Result<Self, MissionError> {
            let mut replay = Replay::open(&folder)?;
            let mut recorder = Recorder::new(replay.scenario(), replay.list(), &replay.mission().header());
            while let Some(flown) = replay.next_slot()? {
                stop.check()?;
                recorder.add(&flown.plan, &flown.flight, &flown.header, replay.mission().field())?;
            }
            let (scenario, list) = (replay.scenario().clone(), replay.list().clone());
            let label = Some(replay.label().to_owned()).filter(|label| *label != scenario.planner.strategy);
            let mut run = recorder.end(scenario, list, replay.mission().field(), Duration::ZERO, label);
            run.summary = replay.summary().clone();
            run.metrics.retain(|(name, _)| !name.starts_with("plan_"));
            Ok(run)
        };
        interruptible(py, read)?.map_err(of_mission)
    }

    /// Data loss rate: lost bits as a fraction of those sampled.
    #[getter]
    fn loss_rate(&self) -> f64 {
        self.summary.loss_rate
    }

    #[getter]
    fn strategy(&self) -> &str {
        &self.summary.strategy
    }

    /// The figures of ``summary.json``.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json(py, &self.summary)
    }

    /// The columns of a sweep's results (``docs/metrics.md``).
    #[getter]
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let metrics = PyDict::new(py);
        self.metrics.iter().try_for_each(|(name, value)| metrics.set_item(name, value))?;
        Ok(metrics)
    }

    #[getter]
    fn scenario(&self) -> PyResult<PyScenario> {
        PyScenario::flown(&self.scenario)
    }

    #[getter]
    fn field(&self) -> PyField {
        PyField::of(&self.scenario, &self.list)
    }

    /// A row per slot, the columns of ``slots.csv``; ``scheduled`` holds lists of ids.
    #[getter]
    fn slots(&self) -> PyResult<PyTable> {
        let modes = self.slots.iter().map(|slot| <&str>::from(slot.mode));
        let refused = self.slots.iter().map(|slot| slot.refused);
        PyTable::new(vec![
            ("slot", self.counts(|slot| slot.slot)),
            ("x_m", self.numbers(|slot| slot.position.x)),
            ("y_m", self.numbers(|slot| slot.position.y)),
            ("z_m", self.numbers(|slot| slot.position.z)),
            ("scheduled", id_lists(self.slots.iter().map(|slot| &slot.scheduled[..]))),
            ("delivered_bits", self.counts(|slot| slot.delivered_bits)),
            ("lost_bits", self.counts(|slot| slot.lost_bits)),
            ("queued_bits", self.counts(|slot| slot.queued_bits)),
            ("mode", Arc::new(StringArray::from_iter_values(modes))),
            ("refused", Arc::new(UInt32Array::from_iter_values(refused))),
        ])
    }

    /// The queue of every SN before slot 1 and after each slot [bit], [slots + 1, N]; flown again for it: keep it.
    #[getter]
    fn queues<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let count = self.list.sensors().len();
        let mut queues_bits = Vec::with_capacity((self.slots.len() + 1) * count);
        queues_bits.extend(self.list.queues_bits());
        let add = |world: &World, _: &QueuesHeader| -> Result<(), MissionError> {
            queues_bits.extend_from_slice(world.field().queues_bits());
            Ok(())
        };
        py.detach(|| self.fly_again(add)).map_err(of_mission)?;
        let shape = (self.slots.len() + 1, count);
        let array = numpy::ndarray::Array2::from_shape_vec(shape, queues_bits).expect("a row for each slot");
        Ok(PyArray2::from_owned_array(py, array))
    }

    /// Writes a run folder as ``skysink simulate`` does, and returns it. ``force`` replaces a run that is there.
    ///
    /// Raises :class:`InputError` if something else is there, :class:`OSError` if it cannot be written.
    #[pyo3(signature = (folder, force = false))]
    fn save(&self, py: Python<'_>, folder: PathBuf, force: bool) -> PyResult<PathBuf> {
        let write = || -> Result<PathBuf, MissionError> {
            let manner = Manner { outside_planner: self.label.clone(), ..Manner::default() };
            let folder = RunFolder::create(Some(&folder), force, &self.scenario, &self.list, &manner)?;
            let mut log = folder.slot_log()?;
            self.fly_again(|world, header| log.add(world.last_flight(), header).map(|_| ()))?;
            folder.write_json("summary.json", &self.summary)?;
            Ok(folder.path().to_owned())
        };
        py.detach(write).map_err(of_mission)
    }

    /// Shows the run in the notebook, or elsewhere in a window, by rerun (``pip install skysink[notebook]``).
    #[pyo3(signature = (width = None, height = None))]
    fn show<'py>(slf: &Bound<'py, Self>, width: Option<u32>, height: Option<u32>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("skysink.recording")?.call_method1("show", (slf, width, height))
    }

    fn __len__(&self) -> usize {
        self.slots.len()
    }

    fn __repr__(&self) -> String {
        let Summary { name, strategy, seed, slots, loss_rate, .. } = &self.summary;
        format!("Run({name:?}, {strategy:?}, seed={seed}, slots={slots}, loss_rate={loss_rate:.4})")
    }
}

/// Flies a mission in this process: by a strategy of Skysink, given by its name, or by one in Python.
#[pyfunction]
#[pyo3(signature = (scenario, strategy = None, *, seed = None, label = None))]
pub fn simulate(
    py: Python<'_>,
    scenario: &Bound<'_, PyScenario>,
    strategy: Option<&Bound<'_, PyAny>>,
    seed: Option<u64>,
    label: Option<String>,
) -> PyResult<PyRun> {
    let name = strategy.and_then(|strategy| strategy.cast::<PyString>().ok()).map(|name| name.to_string());
    let seed = seed.map(|seed| ("seed".to_owned(), i64::try_from(seed).unwrap_or(-1).into()));
    let planner = name.as_ref().map(|name| ("planner.strategy".to_owned(), name.as_str().into()));
    let scenario = scenario.get().with(seed.into_iter().chain(planner))?;
    let list = scenario.list()?;
    match strategy.filter(|_| name.is_none()) {
        Some(strategy) => by_python(py, scenario.scenario, list, strategy, label),
        None => interruptible(py, |stop| by_registry(scenario.scenario, list, stop))?.map_err(of_mission),
    }
}

fn by_registry(scenario: Scenario, list: SensorList, stop: &Stop) -> Result<PyRun, MissionError> {
    let mut mission = Mission::new(&scenario, &list)?;
    mission.set_stop(stop);
    let mut recorder = Recorder::new(&scenario, &list, &mission.header());
    let begin = Instant::now();
    while let Some(flown) = mission.next() {
        recorder.add(&flown.plan, &flown.flight, &flown.header, mission.field())?;
    }
    stop.check()?;
    Ok(recorder.end(scenario, list, mission.field(), begin.elapsed(), None))
}

fn by_python(
    py: Python<'_>,
    scenario: Scenario,
    list: SensorList,
    strategy: &Bound<'_, PyAny>,
    label: Option<String>,
) -> PyResult<PyRun> {
    let mut world = world(&scenario, &list)?;
    let mut pilot = Pilot::new(py, strategy.clone().unbind(), PyField::of(&scenario, &list))?;
    let mut recorder = Recorder::new(&scenario, &list, &world.header());
    let begin = Instant::now();
    fly(py, &mut pilot, &mut world, |plan, world, header| {
        recorder.add(plan, world.last_flight(), header, world.field()).map_err(of_mission)
    })?;
    let label = label.map_or_else(|| strategy.get_type().name().map(|name| name.to_string()), Ok)?;
    Ok(recorder.end(scenario, list, world.field(), begin.elapsed(), Some(label)))
}

/// Flies a whole mission by a strategy in Python, each slot shown to `look`.
pub fn fly(
    py: Python<'_>,
    pilot: &mut Pilot,
    world: &mut World,
    mut look: impl FnMut(&Plan, &World, &QueuesHeader) -> PyResult<()>,
) -> PyResult<()> {
    while !world.is_over() {
        let begin = Instant::now();
        let mut plan = pilot.plan_next(py, world).map_err(|error| in_slot(py, world.slot() + 1, error))?;
        plan.plan_ns = u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let header = world.fly(Some(&plan));
        look(&plan, world, &header)?;
    }
    Ok(())
}

/// The error of a strategy with the slot that it was planning.
fn in_slot(py: Python<'_>, slot: u64, error: PyErr) -> PyErr {
    let note = format!("while planning slot {slot}");
    match error.value(py).call_method1("add_note", (note,)) {
        Ok(_) => error,
        Err(_) => PyRuntimeError::new_err(error.to_string()),
    }
}
