//! `skysink.Scenario`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, UInt32Array};
use numpy::{PyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArray4};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use skysink_common::arrivals::{Arrival, ArrivalTrace, mean_bits};
use skysink_common::channel::{LinkMap, RateTable};
use skysink_common::error::read_text;
use skysink_common::scenario::{CHANNEL, LETTER, Overrides, RATES, Scenario, Setting, SettingOrigin, TRACE};
use skysink_common::sensors::{Sensor, SensorList};
use skysink_planner::settings;
use toml::{Table, Value};

use crate::errors::refused;
use crate::field::PyField;
use crate::held::Held;
use crate::table::PyTable;
use crate::values::{MAX_DEPTH, Reduced, json, to_toml};

/// The arguments of `Scenario.parse`: a text, its path, and the texts of the arrivals, of the channel and of its rates.
type Parsed = (String, PathBuf, Option<String>, Option<String>, Option<String>);

/// A validated scenario: mission, sensor field, channel and strategy.
///
/// The keys are those of a scenario file (``docs/src/scenario-keys.md``). Scenarios are immutable, compare equal if
/// their keys do, and can be pickled; a sensor list is stored as the path of its file.
#[pyclass(name = "Scenario", module = "skysink", frozen)]
#[derive(Clone)]
pub struct PyScenario {
    /// The text of the file.
    text: String,
    /// The parsed scenario.
    pub scenario: Scenario,
}

impl PyScenario {
    fn new(text: String, path: &Path, keys: Vec<Setting>, held: Held) -> PyResult<Self> {
        let overrides = Overrides { keys, ..held.overrides() };
        let mut scenario = Scenario::parse(&text, path, overrides).and_then(settings::resolve).map_err(refused)?;
        scenario.trace = held.arrivals.filter(|_| scenario.sensors.has_trace());
        Ok(Self { text, scenario })
    }

    /// A copy with changed keys. A key replaces earlier spellings of the same quantity.
    pub fn with(&self, changes: impl IntoIterator<Item = (String, Value)>) -> PyResult<Self> {
        let changes: Vec<(String, Value)> = changes.into_iter().collect();
        // A file that is named anew is read.
        let is_named = |file: &str| changes.iter().any(|(key, _)| key == file);
        let is_other = is_named("link.file") || is_named("link.rates");
        let held = if is_other { Held::default() } else { Held::of(&self.scenario) };
        let arrivals = self.scenario.trace.clone().filter(|_| !is_named("sensors.arrivals.file"));
        self.changed(changes, Held { arrivals, ..held })
    }

    /// A copy with changed keys, with what it holds of files.
    fn changed(&self, changes: impl IntoIterator<Item = (String, Value)>, held: Held) -> PyResult<Self> {
        let setting = |(key, value)| Setting { key, value, origin: SettingOrigin::Replacement };
        let settings: Vec<Setting> = changes.into_iter().map(setting).collect();
        let changed = Self::new(self.text.clone(), &self.scenario.path, settings.clone(), held)?;
        let mut table: Table = self.text.parse().expect("it has been parsed before");
        Scenario::apply(&settings, &mut table).map_err(refused)?;
        Ok(Self { text: toml::to_string(&table).expect("it has just been parsed"), ..changed })
    }

    /// A copy with another strategy.
    pub fn flown_by(&self, strategy: &str) -> PyResult<Self> {
        self.with([("planner.strategy".to_owned(), strategy.into())])
    }

    /// A scenario from a run folder.
    pub fn on_record(scenario: &Scenario) -> PyResult<Self> {
        Self::new(scenario.to_toml(), &scenario.path, Vec::new(), Held::of(scenario))
    }

    /// The scenario that `prepare`, a function in Python, returns for `scenario`.
    pub fn prepared(py: Python<'_>, prepare: &Py<PyAny>, scenario: &Scenario) -> PyResult<Scenario> {
        let prepared = prepare.call1(py, (Self::on_record(scenario)?,))?;
        Ok(prepared.bind(py).cast::<Self>()?.get().scenario.clone())
    }

    /// The sampling rates of its sensor nodes [bit/s], without reading their arrivals.
    fn sampling_bps(&self) -> PyResult<Vec<f64>> {
        let list = SensorList::without_arrivals(&self.scenario).map_err(refused)?;
        Ok(list.sensors().iter().map(|sensor| sensor.sampling_bps).collect())
    }

    pub fn list(&self) -> PyResult<SensorList> {
        SensorList::of(&self.scenario).map_err(refused)
    }

    /// All its keys, with defaults.
    pub fn table(&self) -> Table {
        self.scenario.to_toml().parse().expect("it has just been written")
    }
}

#[pymethods]
impl PyScenario {
    /// Reads and checks a file. Raises :class:`InputError`.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let text = read_text("scenario", &path).map_err(refused)?;
        Self::new(text, &std::path::absolute(&path)?, Vec::new(), Held::default())
    }

    /// The built-in mission of the UTS letter (arXiv 2103.00753).
    #[staticmethod]
    fn letter() -> PyResult<Self> {
        Self::new(LETTER.to_owned(), Path::new("letter.toml (built in)"), Vec::new(), Held::default())
    }

    /// Parses a scenario file's text. ``path`` is for errors and relative paths. ``arrivals``, ``channel`` and
    /// ``rates`` are the texts of the files of ``sensors.arrivals.file``, ``link.file`` and ``link.rates``, which are
    /// then not read. Raises :class:`InputError`.
    #[staticmethod]
    #[pyo3(signature = (text, path = PathBuf::from("scenario.toml"), arrivals = None, channel = None, rates = None))]
    fn parse(
        text: String,
        path: PathBuf,
        arrivals: Option<&str>,
        channel: Option<&str>,
        rates: Option<&str>,
    ) -> PyResult<Self> {
        let held = channel.map(|text| Held::parse_channel(text, rates)).transpose()?.unwrap_or_default();
        let mut parsed = Self::new(text, &std::path::absolute(&path)?, Vec::new(), held)?;
        if let Some(arrivals) = arrivals {
            let trace = ArrivalTrace::parse(arrivals, Path::new("arrivals"), &parsed.sampling_bps()?);
            parsed.scenario.trace = Some(trace.map_err(refused)?).filter(|_| parsed.scenario.sensors.has_trace());
        }
        Ok(parsed)
    }

    /// A copy with a channel of these rates [bit/s], by distance, altitude and probability (``docs/src/model.md``).
    /// Raises :class:`InputError`.
    fn with_channel(
        &self,
        distances_m: Vec<f64>,
        altitudes_m: Vec<f64>,
        probabilities: Vec<f64>,
        rates_bps: PyReadonlyArray3<'_, f64>,
    ) -> PyResult<Self> {
        let rates_bps = rates_bps.as_array().iter().copied().collect();
        let table = RateTable::new(distances_m, altitudes_m, probabilities, rates_bps);
        let table = table.map_err(|message| refused(format!("channel: {message}")))?.shared();
        let keys = [("link.model".to_owned(), "table".into()), ("link.file".to_owned(), CHANNEL.into())];
        self.changed(keys, Held { arrivals: self.scenario.trace.clone(), table: Some(table), map: None })
    }

    /// A copy with links by place (``docs/src/decisions.md``, D32): ``levels`` [N, z, y, x], for each SN, or with N = 1
    /// for all, at the positions ``x_m``, ``y_m`` and ``z_m`` of the UAV, NaN for no link. They are SNRs [dB], of which
    /// ``rates`` [steps, 2] has the SNR from which on each rate [bit/s] is carried, or without it rates. Raises
    /// :class:`InputError`.
    #[pyo3(signature = (x_m, y_m, z_m, levels, rates = None))]
    fn with_links(
        &self,
        x_m: Vec<f64>,
        y_m: Vec<f64>,
        z_m: Vec<f64>,
        levels: PyReadonlyArray4<'_, f64>,
        rates: Option<Vec<[f64; 2]>>,
    ) -> PyResult<Self> {
        let of_links = |message| refused(format!("links: {message}"));
        let rates = rates.map(LinkMap::checked_steps).transpose().map_err(of_links)?;
        let mut keys = vec![("link.model".to_owned(), "map".into()), ("link.file".to_owned(), CHANNEL.into())];
        keys.extend(rates.is_some().then(|| ("link.rates".to_owned(), RATES.into())));
        let levels = levels.as_array();
        let values: Vec<f64> = levels.iter().copied().collect();
        let map = LinkMap::of_arrays([x_m, y_m, z_m], levels.shape(), &values, rates).map_err(of_links)?;
        self.changed(keys, Held { arrivals: self.scenario.trace.clone(), table: None, map: Some(map.shared()) })
    }

    /// Mean bits that the SNs sample in a slot, [N], as a copy.
    fn mean_bits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let of_rate = |rate_bps| mean_bits(rate_bps, self.scenario.slot_s);
        Ok(PyArray1::from_iter(py, self.sampling_bps()?.into_iter().map(of_rate)))
    }

    /// A copy whose SNs sample ``bits`` [T, N], by slot and SN. The planner is told ``sensors.sampling_bps``, and
    /// ``dispersion_bits``: the variance of the bits in a slot divided by their mean. Raises :class:`InputError`.
    #[pyo3(signature = (bits, dispersion_bits = 1.0))]
    fn with_arrivals(&self, bits: PyReadonlyArray2<'_, u32>, dispersion_bits: f64) -> PyResult<Self> {
        let bits = bits.as_array();
        let expected = (self.scenario.slots as usize, self.sampling_bps()?.len());
        if bits.dim() != expected {
            return Err(refused(format!("bits of shape {:?}: expected {expected:?}, slots and SNs", bits.dim())));
        }
        let row = |((slot, sensor), &bits): ((usize, usize), &u32)| Arrival {
            slot: slot as u64 + 1,
            sensor: sensor as u32, // a scenario has at most 10^7 SNs
            bits,
        };
        let trace =
            ArrivalTrace::new(bits.indexed_iter().map(row).collect(), &self.sampling_bps()?).map_err(refused)?;
        let key = |name: &str, value: Value| (format!("sensors.arrivals.{name}"), value);
        let keys =
            [key("model", "trace".into()), key("file", TRACE.into()), key("dispersion_bits", dispersion_bits.into())];
        self.changed(keys, Held { arrivals: Some(trace), ..Held::of(&self.scenario) })
    }

    /// A copy with changed keys, for example ``{"area.side_m": 500.0}``. Raises :class:`InputError`.
    fn replace(&self, changes: &Bound<'_, PyAny>) -> PyResult<Self> {
        let pair = |pair: PyResult<Bound<'_, PyAny>>| {
            let (key, value): (String, Bound<'_, PyAny>) = pair?.extract()?;
            Ok((key, to_toml(&value, MAX_DEPTH)?))
        };
        self.with(changes.call_method0("items")?.try_iter()?.map(pair).collect::<PyResult<Vec<_>>>()?)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.scenario.name
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.scenario.seed
    }

    /// Number of slots of the mission, T.
    #[getter]
    fn slots(&self) -> u64 {
        self.scenario.slots
    }

    /// For each UAV a dictionary of its keys of ``[uav]``, and its ``resource_blocks``.
    #[getter]
    fn uavs<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let keys = |uav: usize| {
            let alone = self.scenario.of_uav(uav);
            let mut keys = Table::try_from(&alone.uav).expect("keys are plain tables of numbers and strings");
            keys.insert("resource_blocks".to_owned(), Value::Integer(alone.link.resource_blocks as i64));
            json(py, &keys)
        };
        (0..self.scenario.uav.uavs()).map(keys).collect()
    }

    /// The file, or what stands for it in errors. Files that the scenario names are relative to its folder.
    #[getter]
    fn path(&self) -> PathBuf {
        self.scenario.path.clone()
    }

    /// The strategy: a built-in one, ``"python:FILE:CLASS"``, or in a saved run ``"python:NAME"`` for an object that
    /// only its program has.
    #[getter]
    fn strategy(&self) -> &str {
        &self.scenario.planner.strategy
    }

    /// The value of a dotted key, or a table as a dictionary.
    fn __getitem__<'py>(&self, py: Python<'py>, key: &str) -> PyResult<Bound<'py, PyAny>> {
        let mut value = &Value::Table(self.table());
        for part in key.split('.') {
            value =
                value.get(part).ok_or_else(|| PyKeyError::new_err(format!("{key}: expected a key of a scenario")))?;
        }
        json(py, value)
    }

    /// All keys, including defaults.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        json(py, &self.table())
    }

    /// All keys, including defaults, as the text of a scenario file.
    fn to_toml(&self) -> String {
        self.scenario.to_toml()
    }

    /// The sensor nodes by id, with ``x_m``, ``y_m``, ``queue_bits``, ``gain_db``, ``sampling_bps``,
    /// ``capacity_bits`` and ``weight``; with ``[sensors.energy]`` also ``capacity_j`` and ``harvest_w``.
    fn sensors(&self) -> PyResult<PyTable> {
        let list = self.list()?;
        let numbers = |of: fn(&Sensor) -> f64| -> ArrayRef {
            Arc::new(Float64Array::from_iter_values(list.sensors().iter().map(of)))
        };
        let mut columns: Vec<(&str, ArrayRef)> = vec![
            ("x_m", numbers(|sensor| sensor.position.x)),
            ("y_m", numbers(|sensor| sensor.position.y)),
            ("queue_bits", Arc::new(UInt32Array::from(list.queues_bits()))),
            ("gain_db", numbers(|sensor| sensor.gain_db)),
            ("sampling_bps", numbers(|sensor| sensor.sampling_bps)),
            ("capacity_bits", Arc::new(UInt32Array::from_iter_values(list.sensors().iter().map(|s| s.capacity_bits)))),
            ("weight", numbers(|sensor| sensor.weight)),
        ];
        for column in list.columns() {
            columns.push((column.name, Arc::new(Float64Array::from_iter_values(column.values.iter().copied()))));
        }
        PyTable::new(columns)
    }

    /// The sensor nodes, with their true sampling rates, and the limits of plans.
    fn field(&self) -> PyResult<PyField> {
        PyField::of(&self.scenario, self.list()?.nodes())
    }

    /// The field with these sensor nodes, in the layout of their messages.
    fn _field(&self, nodes: &[u8]) -> PyResult<PyField> {
        PyField::of(&self.scenario, bytemuck::pod_collect_to_vec(nodes))
    }

    /// For pickle and copy: the text and the path.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py, Parsed>> {
        let PyScenario { text, scenario } = slf.get();
        let [arrivals, channel, rates] = Held::of(scenario).texts();
        let arguments = (text.clone(), scenario.path.clone(), arrivals, channel, rates);
        Ok((slf.get_type().getattr("parse")?, arguments))
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| {
            let other = &other.get().scenario;
            other.to_toml() == self.scenario.to_toml()
                && other.trace == self.scenario.trace
                && other.link.table == self.scenario.link.table
                && other.link.map == self.scenario.link.map
        })
    }

    fn __hash__(&self) -> u64 {
        self.scenario.hash()
    }

    fn __repr__(&self) -> String {
        let Scenario { name, seed, slots, .. } = &self.scenario;
        format!("Scenario({name:?}, seed={seed}, slots={slots}, strategy={:?})", self.scenario.planner.strategy)
    }
}
