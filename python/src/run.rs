//! `skysink.Run`: a finished mission and its results.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use arrow_array::{ArrayRef, Float64Array, Int64Array, StringArray, UInt32Array};
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skysink_common::message::{FlightReport, Mode, Plan, QueuesHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_field_sim::Field;
use skysink_lab::metrics::{Metric, MissionMeter};
use skysink_mission::mission::Plant;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::Summary;
use skysink_mission::trace::{RecordedSlot, TraceHash};
use skysink_mission::{MissionError, Replay};

use crate::errors::{of_mission, refused};
use crate::field::PyField;
use crate::scenario::PyScenario;
use crate::signals::interruptible;
use crate::table::{PyTable, id_lists};
use crate::values::json;

/// A running mission.
pub struct RunRecorder {
    slots: Vec<RecordedSlot>,
    hash: TraceHash,
    meter: MissionMeter,
}

impl RunRecorder {
    /// The mission before slot 1; `start` contains the ledger.
    pub fn new(scenario: &Scenario, list: &SensorList, start: &QueuesHeader) -> Self {
        let meter = MissionMeter::new(scenario, list, start);
        Self { slots: Vec::new(), hash: TraceHash::default(), meter }
    }

    /// Adds the next slot. Without a plan, it has no planning time.
    pub fn add(
        &mut self,
        plan: Option<&Plan>,
        flight: &FlightReport,
        header: &QueuesHeader,
        field: &Field,
    ) -> Result<(), MissionError> {
        self.hash.write(flight, header)?;
        self.hash.add();
        self.meter.add(plan, flight, header, field);
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

    /// Finishes the mission, which took `wall`.
    pub fn end(
        self,
        scenario: PyScenario,
        list: SensorList,
        field: &Field,
        wall: Duration,
        label: Option<String>,
    ) -> PyRun {
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

/// A finished mission. ``len`` is its number of slots.
#[pyclass(name = "Run", module = "skysink", frozen)]
pub struct PyRun {
    scenario: PyScenario,
    list: SensorList,
    /// The name of the planner, if it is not a built-in strategy.
    label: Option<String>,
    slots: Vec<RecordedSlot>,
    summary: Summary,
    metrics: Vec<(&'static str, f64)>,
}

impl PyRun {
    /// Simulates the mission with its plans, and calls `on_slot` for each slot.
    fn fly_again<E>(&self, mut on_slot: impl FnMut(&Plant, &QueuesHeader) -> Result<(), E>) -> Result<(), E> {
        let mut plant = Plant::new(&self.scenario.scenario, &self.list);
        for slot in &self.slots {
            let plan = (!slot.is_missed()).then(|| slot.plan());
            let header = plant.fly(plan.as_ref());
            on_slot(&plant, &header)?;
        }
        Ok(())
    }

    fn numbers(&self, of: impl Fn(&RecordedSlot) -> f64) -> ArrayRef {
        Arc::new(Float64Array::from_iter_values(self.slots.iter().map(of)))
    }

    /// Signed, so that differences are correct. No count of a mission exceeds 2^63.
    fn counts(&self, of: impl Fn(&RecordedSlot) -> u64) -> ArrayRef {
        Arc::new(Int64Array::from_iter_values(self.slots.iter().map(|slot| of(slot) as i64)))
    }

    /// The mission flown by these plans, without planning times.
    pub fn of_plans(
        scenario: PyScenario,
        list: SensorList,
        plans: impl Iterator<Item = Plan>,
        label: String,
    ) -> Result<Self, MissionError> {
        let begin = Instant::now();
        let mut plant = Plant::new(&scenario.scenario, &list);
        let mut recorder = RunRecorder::new(&scenario.scenario, &list, &plant.header());
        for plan in plans {
            let header = plant.fly(Some(&plan));
            recorder.add(None, plant.last_flight(), &header, plant.field())?;
        }
        Ok(recorder.end(scenario, list, plant.field(), begin.elapsed(), Some(label)).untimed())
    }

    /// Without planning times.
    fn untimed(mut self) -> Self {
        self.metrics.retain(|(name, _)| !name.starts_with("plan_"));
        self
    }

    /// The lines of `slots.csv` without the header.
    fn trace(&self) -> Result<String, MissionError> {
        let mut text = String::new();
        let mut hash = TraceHash::default();
        self.fly_again(|plant, header| hash.write(plant.last_flight(), header).map(|line| text.push_str(line)))?;
        Ok(text)
    }
}

#[pymethods]
impl PyRun {
    /// Loads a run folder and checks every slot by simulation. Raises :class:`InputError` if it is invalid.
    #[staticmethod]
    fn load(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        let read = move |stop: &Stop| -> Result<_, MissionError> {
            let mut replay = Replay::open(&folder)?;
            let mut recorder = RunRecorder::new(replay.scenario(), replay.list(), &replay.mission().header());
            while let Some(flown) = replay.next_slot()? {
                stop.check()?;
                recorder.add(None, &flown.flight, &flown.header, replay.mission().field())?;
            }
            let label = replay.label().to_owned();
            let field = replay.mission().field().clone();
            Ok((replay.scenario().clone(), replay.list().clone(), label, replay.summary().clone(), field, recorder))
        };
        let (scenario, list, label, summary, field, recorder) = interruptible(py, read)?.map_err(of_mission)?;
        let scenario = PyScenario::on_record(&scenario)?;
        let label = Some(label).filter(|label| *label != scenario.scenario.planner.strategy);
        Ok(PyRun { summary, ..recorder.end(scenario, list, &field, Duration::ZERO, label).untimed() })
    }

    /// Data loss rate: lost bits as a fraction of the sampled bits.
    #[getter]
    fn loss_rate(&self) -> f64 {
        self.summary.loss_rate
    }

    #[getter]
    fn strategy(&self) -> &str {
        &self.summary.strategy
    }

    /// The content of ``summary.json``.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json(py, &self.summary)
    }

    /// All metrics, as in the results of a sweep (``docs/src/metrics.md``).
    #[getter]
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let metrics = PyDict::new(py);
        self.metrics.iter().try_for_each(|(name, value)| metrics.set_item(name, value))?;
        Ok(metrics)
    }

    #[getter]
    fn scenario(&self) -> PyScenario {
        self.scenario.clone()
    }

    #[getter]
    fn field(&self) -> PyField {
        PyField::of(&self.scenario.scenario, &self.list)
    }

    /// One row per slot with the columns of ``slots.csv``; ``scheduled`` contains lists of ids.
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

    /// The queue of every SN before slot 1 and after each slot [bit], [slots + 1, N]. Every access simulates the run.
    ///
    /// It is unsigned: use ``astype(np.int64)`` for differences.
    #[getter]
    fn queues<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let count = self.list.sensors().len();
        let mut queues_bits = Vec::with_capacity((self.slots.len() + 1) * count);
        queues_bits.extend(self.list.queues_bits());
        let add = |plant: &Plant, _: &QueuesHeader| -> Result<(), MissionError> {
            queues_bits.extend_from_slice(plant.field().queues_bits());
            Ok(())
        };
        py.detach(|| self.fly_again(add)).map_err(of_mission)?;
        let shape = (self.slots.len() + 1, count);
        let array = numpy::ndarray::Array2::from_shape_vec(shape, queues_bits).expect("a row for each slot");
        Ok(PyArray2::from_owned_array(py, array))
    }

    /// Writes a run folder like ``skysink simulate``, and returns its path. ``force`` replaces an existing run.
    ///
    /// Raises :class:`InputError` if the folder contains other files, :class:`OSError` if it cannot be written.
    #[pyo3(signature = (folder, force = false))]
    fn save(&self, py: Python<'_>, folder: PathBuf, force: bool) -> PyResult<PathBuf> {
        let write = || -> Result<PathBuf, MissionError> {
            let run_mode = RunMode { external_planner: self.label.clone(), ..RunMode::default() };
            let folder = RunFolder::create(Some(&folder), force, &self.scenario.scenario, &self.list, &run_mode)?;
            let mut log = folder.slot_log()?;
            self.fly_again(|plant, header| log.add(plant.last_flight(), header).map(|_| ()))?;
            folder.write_json("summary.json", &self.summary)?;
            Ok(folder.path().to_owned())
        };
        py.detach(write).map_err(of_mission)
    }

    /// Shows the run in the notebook, or in a window, with rerun (``pip install skysink[notebook]``).
    #[pyo3(signature = (width = None, height = None))]
    fn show<'py>(slf: &Bound<'py, Self>, width: Option<u32>, height: Option<u32>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("skysink.recording")?.call_method1("show", (slf, width, height))
    }

    /// For pickle and copy.
    #[allow(clippy::type_complexity)]
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (PyScenario, Option<String>, String, String))> {
        let run = slf.get();
        let trace = slf.py().detach(|| run.trace()).map_err(of_mission)?;
        let summary = serde_json::to_string(&run.summary).expect("plain numbers and strings");
        Ok((slf.get_type().getattr("_restore")?, (run.scenario.clone(), run.label.clone(), trace, summary)))
    }

    #[staticmethod]
    fn _restore(scenario: &Bound<'_, PyScenario>, label: Option<String>, trace: &str, summary: &str) -> PyResult<Self> {
        let scenario = scenario.get().clone();
        let list = scenario.list()?;
        let slots: Option<Vec<RecordedSlot>> =
            trace.split_inclusive('\n').map(|line| RecordedSlot::parse(line.as_bytes())).collect();
        let slots = slots.ok_or_else(|| refused("trace: expected that of a run"))?;
        let mut plant = Plant::new(&scenario.scenario, &list);
        let mut recorder = RunRecorder::new(&scenario.scenario, &list, &plant.header());
        for slot in &slots {
            let plan = (!slot.is_missed()).then(|| slot.plan());
            let header = plant.fly(plan.as_ref());
            recorder.add(None, plant.last_flight(), &header, plant.field()).map_err(of_mission)?;
        }
        let mut run = recorder.end(scenario, list, plant.field(), Duration::ZERO, label).untimed();
        run.summary = serde_json::from_str(summary).map_err(refused)?;
        Ok(run)
    }

    fn __len__(&self) -> usize {
        self.slots.len()
    }

    fn __repr__(&self) -> String {
        let Summary { name, strategy, seed, slots, loss_rate, .. } = &self.summary;
        format!("Run({name:?}, {strategy:?}, seed={seed}, slots={slots}, loss_rate={loss_rate:.4})")
    }
}
