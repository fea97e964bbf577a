//! Sweeps and comparisons whose missions any executor can run.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_lab::compare::{Contender, MetricStanding, standings};
use skysink_lab::progress::LabProgress;
use skysink_lab::sweep;
use skysink_lab::sweep::definition::MissionKey;
use skysink_lab::sweep::folder::SweepRecord;
use skysink_lab::sweep::journal::{MissionRow, MissionRows};
use skysink_lab::sweep::manifest::STANDINGS;
use skysink_lab::sweep::plan::Sweep;
use skysink_lab::sweep::settings::{ExternalStrategy, SweepBase, SweepChanges, SweepSettings};
use skysink_lab::sweep::shard::Shard;
use skysink_mission::files::write_whole;
use skysink_mission::meter::MissionMeter;
use skysink_mission::metrics::MetricValues;
use toml::Table;

use crate::errors::{of_lab, of_mission, refused};
use crate::held::Held;
use crate::run::{Sources, source_files};
use crate::scenario::PyScenario;
use crate::signals::interruptible;
use crate::simulate::drive_python;
use crate::strategy::{PyStrategies, Raised};
use crate::table::PyTable;
use crate::tables::mission_columns;
use crate::unflown::warn_of_sweep;
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
            held: Held::of(&scenario.scenario).overrides(),
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
                scenario = PyScenario::prepared(py, prepare, &scenario)?;
            }
            let values = match strategies.get(name) {
                Some(make) => fly_python(py, &scenario, make)?,
                None => {
                    let flown = interruptible(py, |stop| sweep::fly_scenario(&scenario, key(mission), stop))?;
                    flown.map_err(of_lab)?.values
                }
            };
            Ok((mission, values.to_vec()))
        };
        missions.into_iter().map(fly_one).collect()
    }

    /// Runs the missing missions on `threads` threads of this process, for built-in strategies only, and tells
    /// `progress` the number of finished and of all missions.
    fn fly_all(&self, py: Python<'_>, out: PathBuf, threads: usize, progress: Option<Py<PyAny>>) -> PyResult<PyTable> {
        let (journal, raised) = interruptible(py, |stop| {
            let raised = Raised::new(stop);
            let journal =
                sweep::sweep(&self.0, &out, Shard::WHOLE, threads, stop, &|LabProgress { done, of, .. }| {
                    let told = progress.as_ref().map(|tell| Python::attach(|py| tell.call1(py, (done, of))));
                    if let Some(Err(error)) = told {
                        raised.keep(error);
                    }
                });
            (journal, raised)
        })?;
        raised.check()?;
        self.table(py, &journal.map_err(of_lab)?.rows)
    }

    /// A row per mission.
    fn rows(&self, py: Python<'_>, all: Vec<Row>) -> PyResult<PyTable> {
        self.table(py, &rows(all)?)
    }

    /// All metrics of the strategies of a comparison.
    fn standings<'py>(&self, py: Python<'py>, all: Vec<Row>) -> PyResult<Bound<'py, PyAny>> {
        json(py, &self.standings_of(&rows(all)?))
    }

    /// Writes the results into the folder of `record`, and returns them, after the standings of a comparison, which it
    /// writes into its folder, too.
    fn finish<'py>(
        &self,
        py: Python<'py>,
        record: &Bound<'py, PySweepRecord>,
        comparison: Option<PathBuf>,
    ) -> PyResult<(Option<Bound<'py, PyAny>>, PyTable)> {
        let record = record.borrow_mut().0.take().ok_or_else(|| refused("the sweep is finished"))?;
        let rows = interruptible(py, |stop| record.finish(stop))?.map_err(of_lab)?.rows;
        let write = |folder: PathBuf| {
            let standings = self.standings_of(&rows);
            let text = serde_json::to_string_pretty(&standings).expect("plain numbers and strings");
            write_whole(&folder.join(STANDINGS), (text + "\n").as_bytes()).map_err(of_mission)?;
            json(py, &standings)
        };
        Ok((comparison.map(write).transpose()?, self.table(py, &rows)?))
    }
}

impl PySweepPlan {
    /// The table of all missions, after a warning if many plans were not flown as they were decided.
    fn table(&self, py: Python<'_>, rows: &MissionRows) -> PyResult<PyTable> {
        warn_of_sweep(py, &self.0, rows)?;
        let rows: Vec<MissionRow> = rows.values().copied().collect();
        PyTable::new(mission_columns(&self.0.definition, &rows))
    }

    fn standings_of(&self, rows: &MissionRows) -> Vec<MetricStanding> {
        standings(&Contender::of_sweep(&self.0.definition, rows))
    }
}

/// Runs a mission of a sweep with the Python strategies that `make` makes.
fn fly_python(py: Python<'_>, scenario: &Scenario, make: &Py<PyAny>) -> PyResult<MetricValues> {
    let list = SensorList::of(scenario).map_err(refused)?;
    let mut meter = MissionMeter::new(scenario, &list);
    let strategies = PyStrategies::new(make.bind(py), scenario.uav.uavs(), &Raised::new(&Stop::default()))?;
    let plant = drive_python(py, scenario, &list, strategies, &mut meter)?;
    Ok(meter.values(&plant, None, None))
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
