//! Sweeps and comparisons whose missions any executor can run.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::Ordering;

use pyo3::prelude::*;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_lab::compare::{Contender, standings as of_contenders};
use skysink_lab::metrics::{MetricValues, MissionMeter};
use skysink_lab::progress::LabProgress;
use skysink_lab::sweep;
use skysink_lab::sweep::definition::MissionKey;
use skysink_lab::sweep::folder::SweepRecord;
use skysink_lab::sweep::journal::{MissionRow, MissionRows, SweepJournal};
use skysink_lab::sweep::manifest::STANDINGS;
use skysink_lab::sweep::plan::Sweep;
use skysink_lab::sweep::results::mission_columns;
use skysink_lab::sweep::settings::{ExternalStrategy, SweepBase, SweepChanges, SweepSettings};
use skysink_lab::sweep::shard::Shard;
use skysink_mission::files::write_whole;
use toml::Table;

use crate::errors::{of_lab, of_mission, refused};
use crate::held::HeldChannel;
use crate::run::{Sources, source_files};
use crate::scenario::PyScenario;
use crate::signals::{INTERRUPT, interruptible};
use crate::simulate::drive_python;
use crate::strategy::{PyStrategies, Raised};
use crate::table::PyTable;
use crate::values::json;

/// Point, index of the strategy, seed.
type Key = (usize, usize, u64);

/// Name, version and source files of a strategy in Python.
type External = (String, String, Sources);

/// A mission with its metrics, as it goes between processes.
type Row = (Key, Vec<f64>);

fn key((point, strategy, seed): Key) -> MissionKey {
    MissionKey { point, strategy, seed }
}

fn of_keys(keys: impl Iterator<Item = MissionKey>) -> Vec<Key> {
    keys.map(|MissionKey { point, strategy, seed }| (point, strategy, seed)).collect()
}

fn row((mission, values): Row) -> PyResult<MissionRow> {
    let values = MetricValues::try_from(values).map_err(|_| refused("metrics of another version of Skysink"))?;
    Ok(MissionRow { key: key(mission), values })
}

fn rows(all: Vec<Row>) -> PyResult<MissionRows> {
    all.into_iter().map(|one| row(one).map(|row| (row.key, row))).collect()
}

/// A sweep with its scenarios.
#[pyclass(name = "SweepPlan", module = "skysink", frozen)]
pub struct PySweepPlan(Sweep);

#[pymethods]
impl PySweepPlan {
    /// Reads a sweep file or the folder of a sweep; `external` are its Python strategies.
    #[staticmethod]
    fn read(path: PathBuf, external: Vec<External>, models: Vec<(String, String)>) -> PyResult<Self> {
        let changes = SweepChanges { models, ..SweepChanges::default() };
        Sweep::read(&path, strategies(external), changes).map(Self).map_err(of_lab)
    }

    /// The sweep of strategies over one scenario.
    #[staticmethod]
    fn compare(
        scenario: &Bound<'_, PyScenario>,
        names: Vec<String>,
        seeds: Vec<u64>,
        external: Vec<External>,
        models: Vec<(String, String)>,
    ) -> PyResult<Self> {
        let scenario = scenario.get();
        let base = SweepBase {
            path: scenario.scenario.path.clone(),
            table: scenario.table(),
            held: HeldChannel::of(&scenario.scenario).overrides(),
        };
        let settings = SweepSettings {
            base,
            axes: Table::new(),
            strategies: names,
            seeds,
            external: strategies(external),
            models,
        };
        let sweep = Sweep::new(Path::new("comparison"), settings);
        sweep.map(Self).map_err(of_lab)
    }

    #[getter]
    fn identity(&self) -> &str {
        &self.0.definition.identity
    }

    #[getter]
    fn missions(&self) -> Vec<Key> {
        of_keys(self.0.definition.missions(Shard::WHOLE))
    }

    /// Opens and locks the folder of the sweep.
    fn open(&self, out: PathBuf) -> PyResult<PySweepRecord> {
        SweepRecord::open(&self.0, &out, Shard::WHOLE).map(|record| PySweepRecord(Some(record))).map_err(of_lab)
    }

    /// Runs these missions one after another. `strategies` creates the Python strategies by name; `prepare` turns the
    /// scenario of a mission into that which is flown.
    fn fly(
        &self,
        py: Python<'_>,
        missions: Vec<Key>,
        strategies: HashMap<String, Py<PyAny>>,
        prepare: Option<Py<PyAny>>,
    ) -> PyResult<Vec<Row>> {
        let fly_one = |mission: Key| {
            let name = &self.0.definition.strategies[mission.1];
            let mut scenario = self.0.scenario(key(mission)).map_err(of_lab)?;
            if let Some(prepare) = &prepare {
                let prepared = prepare.call1(py, (PyScenario::on_record(&scenario)?,))?;
                scenario = prepared.bind(py).cast::<PyScenario>()?.get().scenario.clone();
            }
            let row = match strategies.get(name) {
                Some(make) => fly_python(py, &scenario, key(mission), make)?,
                None => {
                    interruptible(py, |stop| sweep::fly_scenario(&scenario, key(mission), stop))?.map_err(of_lab)?
                }
            };
            Ok((mission, row.values.to_vec()))
        };
        missions.into_iter().map(fly_one).collect()
    }

    /// Runs the missing missions on `threads` threads of this process, for built-in strategies only, and tells `progress`
    /// the number of finished and of all missions.
    fn fly_all(&self, py: Python<'_>, out: PathBuf, threads: usize, progress: Option<Py<PyAny>>) -> PyResult<PyTable> {
        let raised = OnceLock::new();
        let journal = interruptible(py, |stop| {
            sweep::sweep(&self.0, &out, Shard::WHOLE, threads, stop, &|LabProgress { done, of, .. }| {
                let told = progress.as_ref().map(|tell| Python::attach(|py| tell.call1(py, (done, of))));
                if let Some(Err(error)) = told {
                    let _ = raised.set(error);
                    stop.flag().store(INTERRUPT, Ordering::Relaxed);
                }
            })
        })?;
        if let Some(error) = raised.into_inner() {
            return Err(error);
        }
        self.table(&journal.map_err(of_lab)?)
    }

    /// A row per mission.
    fn rows(&self, all: Vec<Row>) -> PyResult<PyTable> {
        let rows: Vec<MissionRow> = rows(all)?.into_values().collect();
        PyTable::new(mission_columns(&self.0.definition, &rows))
    }

    /// All metrics of the strategies of a comparison.
    fn standings<'py>(&self, py: Python<'py>, all: Vec<Row>) -> PyResult<Bound<'py, PyAny>> {
        json(py, &of_contenders(&Contender::of_sweep(&self.0.definition, &rows(all)?)))
    }

    /// Writes the results into the folder of `record`, and returns them.
    fn finish(&self, py: Python<'_>, record: &Bound<'_, PySweepRecord>) -> PyResult<PyTable> {
        self.table(&finish(py, record)?)
    }

    /// The same for a comparison in the folder `out`, with its standings, which it writes, too.
    fn finish_comparison<'py>(
        &self,
        py: Python<'py>,
        record: &Bound<'_, PySweepRecord>,
        out: PathBuf,
    ) -> PyResult<(Bound<'py, PyAny>, PyTable)> {
        let journal = finish(py, record)?;
        let contenders = Contender::of_sweep(&self.0.definition, &journal.rows);
        let standings = of_contenders(&contenders);
        let text = serde_json::to_string_pretty(&standings).expect("plain numbers and strings");
        write_whole(&out.join(STANDINGS), (text + "\n").as_bytes()).map_err(of_mission)?;
        Ok((json(py, &standings)?, self.table(&journal)?))
    }
}

/// Writes the results into the folder of `record`.
fn finish(py: Python<'_>, record: &Bound<'_, PySweepRecord>) -> PyResult<SweepJournal> {
    let record = record.borrow_mut().0.take().ok_or_else(|| refused("the sweep is finished"))?;
    interruptible(py, |stop| record.finish(stop))?.map_err(of_lab)
}

impl PySweepPlan {
    fn table(&self, journal: &SweepJournal) -> PyResult<PyTable> {
        let rows: Vec<MissionRow> = journal.rows.values().copied().collect();
        let columns = mission_columns(&self.0.definition, &rows);
        PyTable::new(columns)
    }
}

/// Runs a mission of a sweep with the Python strategies that `make` makes.
fn fly_python(py: Python<'_>, scenario: &Scenario, key: MissionKey, make: &Py<PyAny>) -> PyResult<MissionRow> {
    let list = SensorList::of(scenario).map_err(refused)?;
    let mut meter = MissionMeter::new(scenario, &list);
    let strategies = PyStrategies::new(make.bind(py), scenario.uav.uavs(), &Raised::new(&Stop::default()))?;
    let plant = drive_python(py, scenario, &list, strategies, &mut meter)?;
    Ok(MissionRow { key, values: meter.values(&plant, None, None) })
}

/// The locked folder of a running sweep.
#[pyclass(name = "SweepRecord", module = "skysink")]
pub struct PySweepRecord(Option<SweepRecord>);

#[pymethods]
impl PySweepRecord {
    #[getter]
    fn missing(&self) -> Vec<Key> {
        of_keys(self.0.iter().flat_map(SweepRecord::missing))
    }

    /// Adds a mission. When this returns, it survives a crash of the process.
    fn add(&mut self, mission: Row) -> PyResult<()> {
        let row = row(mission)?;
        let record = self.0.as_mut().ok_or_else(|| refused("the sweep is finished: expected no more missions"))?;
        record.add(&row).map_err(of_lab)
    }

    /// Releases the folder. An unfinished sweep can be resumed.
    fn close(&mut self) {
        self.0 = None;
    }
}

fn strategies(external: Vec<External>) -> Vec<ExternalStrategy> {
    let strategy = |(name, version, sources)| ExternalStrategy { name, version, sources: source_files(sources) };
    external.into_iter().map(strategy).collect()
}
