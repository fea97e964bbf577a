//! `skysink.Run`: a finished mission and its results.

use std::path::PathBuf;
use std::time::Instant;

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{ByUav, SlotRecord};
use skysink_common::stop::Stop;
use skysink_mission::drive::{Observer, Planned, SlotSink};
use skysink_mission::figures::Summary;
use skysink_mission::folder::Earlier;
use skysink_mission::meter::MissionMeter;
use skysink_mission::metrics::Metric;
use skysink_mission::origin::{RunMode, SourceFile};
use skysink_mission::record::RunFolder;
use skysink_mission::sensor_results::{SensorResult, SensorTally};
use skysink_mission::trace::{RecordedSlot, TraceHash};
use skysink_mission::{MissionError, Orders, Plant, Replay, drive};
use skysink_planner::strategies::PYTHON;

use crate::errors::{of_mission, refused};
use crate::field::PyField;
use crate::scenario::PyScenario;
use crate::signals::interruptible;
use crate::table::PyTable;
use crate::tables::{sensor_columns, slot_columns};
use crate::unflown::warn_of_run;
use crate::values::{Reduced, json};

/// Records a mission in memory.
pub struct RunRecorder {
    begin: Instant,
    slots: Vec<ByUav<RecordedSlot>>,
    hash: TraceHash,
    meter: MissionMeter,
}

impl RunRecorder {
    /// The mission before slot 1.
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        let meter = MissionMeter::new(scenario, list);
        Self { begin: Instant::now(), slots: Vec::new(), hash: TraceHash::default(), meter }
    }

    /// Finishes the mission, which left `plant`. Its wall time counts from the creation of the recorder.
    pub fn end(self, scenario: PyScenario, list: SensorList, plant: &Plant, mode: RunMode) -> PyRun {
        let mut summary = self.meter.tally().summary(self.begin.elapsed(), self.hash.value());
        if let Some(label) = &mode.external_planner {
            label.clone_into(&mut summary.strategy);
        }
        mode.external.clone_into(&mut summary.external);
        let values = self.meter.values(plant, None, None);
        let metrics = Metric::all().map(|metric| (metric, values[metric as usize]));
        let metrics = metrics.filter(|(_, value)| !value.is_nan()).collect();
        PyRun { scenario, list, mode, slots: self.slots, summary, metrics }
    }
}

impl Observer for RunRecorder {
    fn begin(&mut self, plant: &Plant) -> Result<(), MissionError> {
        self.meter.begin(plant)
    }

    fn slot(&mut self, record: &SlotRecord, plant: &Plant) -> Result<(), MissionError> {
        self.slots.add(record)?;
        self.hash.add(record)?;
        self.meter.slot(record, plant)
    }
}

/// Calls a function with each slot.
struct EachSlot<F>(F);

impl<F: FnMut(&SlotRecord, &Plant) -> Result<(), MissionError>> Observer for EachSlot<F> {
    fn slot(&mut self, record: &SlotRecord, plant: &Plant) -> Result<(), MissionError> {
        (self.0)(record, plant)
    }
}

/// The scenario, the mode, the lines of the trace and the summary of a run.
type SavedRun = (PyScenario, String, String, String);

/// The source files of a strategy: name in a run folder, and content.
pub type Sources = Vec<(String, Vec<u8>)>;

/// The source files, as in the folder of a run.
pub fn source_files(sources: Sources) -> Vec<SourceFile> {
    sources.into_iter().map(|(name, bytes)| SourceFile { name, bytes }).collect()
}

/// How a strategy in Python is flown under this label.
pub fn python_mode(label: String, sources: Sources) -> RunMode {
    let sources = source_files(sources);
    RunMode { external_planner: Some(label), external: vec!["planner".to_owned()], sources, ..RunMode::default() }
}

/// A finished mission. ``len`` is its number of slots.
#[pyclass(name = "Run", module = "skysink", frozen)]
pub struct PyRun {
    scenario: PyScenario,
    list: SensorList,
    /// Who planned and flew.
    mode: RunMode,
    slots: Vec<ByUav<RecordedSlot>>,
    pub summary: Summary,
    metrics: Vec<(Metric, f64)>,
}

impl PyRun {
    /// Simulates the mission with its plans, and returns the plant after it.
    fn fly_again(&self, observer: &mut dyn Observer) -> Result<Plant, MissionError> {
        let orders = self.slots.iter().map(|slots| self.mode.orders_of(slots));
        fly(&self.scenario.scenario, &self.list, orders, observer)
    }

    /// The mission flown by these plans, or orders, without planning times.
    pub fn of_plans(
        scenario: PyScenario,
        list: SensorList,
        plans: impl Iterator<Item: Into<Orders>>,
        mode: RunMode,
    ) -> Result<Self, MissionError> {
        let mut recorder = RunRecorder::new(&scenario.scenario, &list);
        let plant = fly(&scenario.scenario, &list, plans, &mut recorder)?;
        Ok(recorder.end(scenario, list, &plant, mode).untimed())
    }

    /// The scenario as in a run folder, which has the source of a strategy in Python in a file of its own.
    fn scenario_of_folder(&self) -> Scenario {
        let mut scenario = self.scenario.scenario.clone();
        let strategy = &mut scenario.planner.strategy;
        let class = strategy.strip_prefix(PYTHON).and_then(|file| file.rsplit_once(':')).map(|(_, class)| class);
        if let (Some(class), Some(source)) = (class, self.mode.sources.first()) {
            *strategy = format!("{PYTHON}{}:{class}", source.name);
        }
        scenario
    }

    /// Warns if more than 1 % of its slots are held or refused.
    pub fn warn(&self, py: Python<'_>) -> PyResult<()> {
        warn_of_run(py, &self.summary, &self.scenario.scenario)
    }

    /// Without planning times.
    fn untimed(mut self) -> Self {
        self.metrics.retain(|(metric, _)| !metric.is_timing());
        self
    }
}

/// Simulates a mission with these plans, or orders, and returns the plant after it.
fn fly(
    scenario: &Scenario,
    list: &SensorList,
    plans: impl Iterator<Item: Into<Orders>>,
    observer: &mut dyn Observer,
) -> Result<Plant, MissionError> {
    let mut plant = Plant::new(scenario, list);
    drive(&mut plant, &mut Planned(plans), &mut [observer], &Stop::default())?;
    Ok(plant)
}

#[pymethods]
impl PyRun {
    /// Loads a run folder and checks every slot by simulation. Raises :class:`InputError` if it is invalid.
    #[staticmethod]
    fn load(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        let read = move |stop: &Stop| -> Result<_, MissionError> {
            let mut replay = Replay::open(&folder)?;
            let mut recorder = RunRecorder::new(replay.scenario(), replay.list());
            replay.drive(&mut [&mut recorder], stop)?;
            Ok((replay, recorder))
        };
        let (replay, recorder) = interruptible(py, read)?.map_err(of_mission)?;
        let scenario = PyScenario::on_record(replay.scenario())?;
        let mode = RunMode { pace: None, ..replay.run_mode().clone() };
        let run = recorder.end(scenario, replay.list().clone(), replay.plant(), mode).untimed();
        Ok(PyRun { summary: replay.summary().clone(), ..run })
    }

    /// Refuses a run folder whose scenario, sensor list or source files were changed.
    #[staticmethod]
    fn _check(folder: PathBuf) -> PyResult<()> {
        RunFolder::open_to_read(&folder).map(drop).map_err(of_mission)
    }

    /// Data loss rate: lost bits as a fraction of the sampled bits.
    #[getter]
    fn loss_rate(&self) -> f64 {
        self.summary.loss_rate
    }

    /// The name of the strategy in the results: a built-in one, or the label of a Python strategy or an external
    /// planner.
    #[getter]
    fn strategy(&self) -> &str {
        &self.summary.strategy
    }

    /// The content of ``summary.json`` without its check value.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json(py, &self.summary)
    }

    /// All metrics, as in the results of a sweep (``docs/src/metrics.md``).
    #[getter]
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let metrics = PyDict::new(py);
        self.metrics.iter().try_for_each(|(metric, value)| metrics.set_item(metric.name(), value))?;
        Ok(metrics)
    }

    /// The scenario as flown; its ``planner.strategy`` names what flew.
    #[getter]
    fn scenario(&self) -> PyScenario {
        self.scenario.clone()
    }

    /// The sensor nodes, with their true sampling rates, and the limits of plans.
    #[getter]
    fn field(&self) -> PyResult<PyField> {
        PyField::of(&self.scenario.scenario, self.list.nodes())
    }

    /// One row per slot and UAV with the columns of ``slots.csv``; ``scheduled`` contains lists of ids.
    #[getter]
    fn slots(&self) -> PyResult<PyTable> {
        PyTable::new(slot_columns(&self.slots.iter().flatten().collect::<Vec<_>>()))
    }

    /// One row per SN with the columns of ``sensors_out.csv``. Every access simulates the run.
    #[getter]
    fn sensors(&self, py: Python<'_>) -> PyResult<PyTable> {
        let mut tally = SensorTally::new(self.list.sensors().len());
        let plant = py.detach(|| self.fly_again(&mut tally)).map_err(of_mission)?;
        let results: Vec<SensorResult> = tally.results(&plant, self.scenario.scenario.slot_s).collect();
        PyTable::new(sensor_columns(&self.list, &results))
    }

    /// The queue of every SN before slot 1 and after each slot [bit], [slots + 1, N]. Every access simulates the run.
    ///
    /// It is unsigned: use ``astype(np.int64)`` for differences.
    #[getter]
    fn queues<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let shape = (self.slots.len() + 1, self.list.sensors().len());
        let mut rows = Vec::with_capacity(shape.0 * shape.1);
        rows.extend(self.list.queues_bits());
        let mut add_row = EachSlot(|_: &SlotRecord, plant: &Plant| {
            rows.extend_from_slice(plant.field().queues_bits());
            Ok(())
        });
        py.detach(|| self.fly_again(&mut add_row)).map_err(of_mission)?;
        Ok(Array2::from_shape_vec(shape, rows).expect("a row for each slot").into_pyarray(py))
    }

    /// Writes a run folder like ``skysink simulate``, and returns its path. ``force`` replaces an existing run.
    ///
    /// Raises :class:`InputError` if the folder contains other files, :class:`OSError` if it cannot be written.
    #[pyo3(signature = (folder, force = false))]
    fn save(&self, py: Python<'_>, folder: PathBuf, force: bool) -> PyResult<PathBuf> {
        let write = || -> Result<PathBuf, MissionError> {
            let earlier = Earlier::by_force(force);
            let scenario = self.scenario_of_folder();
            let folder = RunFolder::create(Some(&folder), earlier, &scenario, &self.list, &self.mode)?;
            let mut log = folder.slot_log()?;
            self.fly_again(&mut log)?;
            folder.finish(&log, &mut self.summary.clone())?;
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
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py, SavedRun>> {
        let run = slf.get();
        let mut trace = String::new();
        let mut lines = TraceHash::default();
        let mut add_lines = EachSlot(|record: &SlotRecord, _: &Plant| {
            trace.push_str(lines.write(record.flights(), &record.header)?);
            Ok(())
        });
        slf.py().detach(|| run.fly_again(&mut add_lines)).map_err(of_mission)?;
        let summary = serde_json::to_string(&run.summary).expect("plain numbers and strings");
        let mode = serde_json::to_string(&run.mode).expect("plain numbers and strings");
        Ok((slf.get_type().getattr("_restore")?, (run.scenario.clone(), mode, trace, summary)))
    }

    #[staticmethod]
    fn _restore(scenario: &Bound<'_, PyScenario>, mode: &str, trace: &str, summary: &str) -> PyResult<Self> {
        let mode: RunMode = serde_json::from_str(mode).map_err(refused)?;
        let scenario = scenario.get().clone();
        let list = scenario.list()?;
        let slots: Option<Vec<RecordedSlot>> =
            trace.split_inclusive('\n').map(|line| RecordedSlot::parse(line.as_bytes())).collect();
        let slots = slots.ok_or_else(|| refused("trace: expected that of a run"))?;
        let uavs = scenario.scenario.uav.uavs();
        let orders = slots.chunks_exact(uavs).map(|slots| mode.orders_of(slots));
        let run = Self::of_plans(scenario, list, orders, mode.clone()).map_err(of_mission)?;
        Ok(Self { summary: serde_json::from_str(summary).map_err(refused)?, ..run })
    }

    fn __len__(&self) -> usize {
        self.slots.len()
    }

    fn __repr__(&self) -> String {
        let Summary { name, strategy, seed, slots, loss_rate, .. } = &self.summary;
        format!("Run({name:?}, {strategy:?}, seed={seed}, slots={slots}, loss_rate={loss_rate:.4})")
    }
}
