//! The checked scenario: its keys and tables, and what follows from them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::area::Area;
use super::base::BaseKeys;
use super::fleet::MixedFleet;
use super::simplified::SharedZones;
use super::uav::UavKeys;
use crate::arrivals::{ArrivalKeys, ArrivalLaw, ArrivalTrace};
use crate::channel::{LinkBudget, LinkModel};
use crate::error::InputError;
use crate::geodata::plausible::NamedPolygon;
use crate::keys::{self, Accepts, Keys, OwnKeys, POSITIVE, Setting, Source};
use crate::nodes::{self, NODE_ROWS, SensorKeys};
use crate::slack::TIME_SLACK;

/// The file of the arrivals in a run folder.
pub const TRACE: &str = "arrivals.csv";

/// The file of a channel in a run folder.
pub const CHANNEL: &str = "channel.csv";

/// The rates of the SNRs of a map of links, in the folder of a run.
pub const RATES: &str = "rates.csv";

/// Whether a run folder keeps under this name a file that its scenario reads besides the sensor list: arrivals, a file
/// of a feature of the sensor nodes, a channel.
#[must_use]
pub fn is_kept_file(name: &str) -> bool {
    [TRACE, CHANNEL, RATES].contains(&name) || nodes::files().any(|file| file.name == name)
}

/// Largest seed: the largest integer of TOML.
pub const MAX_SEED: u64 = i64::MAX as u64;

/// Between the seeds of the planners of UAVs, so that random flights differ.
const SEED_STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Slots of the longest mission.
const MAX_SLOTS: u64 = 1_000_000_000;

/// Longest name of a mission [bytes]: names become folders, whose names end at 255 bytes.
const MAX_NAME_BYTES: usize = 100;

/// Names that folders can have.
const NAME: Accepts = Accepts::Text("1 to 100 of A-Z a-z 0-9 . _ - (it becomes a folder)", |name| {
    let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
    let is_dots = name.bytes().all(|byte| byte == b'.');
    (1..=MAX_NAME_BYTES).contains(&name.len()) && name.bytes().all(is_allowed) && !is_dots
});

/// What is expected instead of the name of a mission; `None` if it can be one.
#[must_use]
pub fn name_refusal(name: &str) -> Option<String> {
    NAME.refusal(&name.into())
}

crate::keys! {
    /// A checked scenario: the keys of its file with all defaults.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct Scenario {
        /// Name of the mission; required. It is part of the name of the run folder.
        name: String, NAME;
        /// Seed of every random number of the mission.
        seed: u64 = 1, Accepts::Whole(0, MAX_SEED);
        /// Number of slots, `T`.
        slots: u64 = 600, Accepts::Whole(1, MAX_SLOTS);
        /// Length of a slot, `τ` [s].
        slot_s: f64 = 1.0, POSITIVE;
        /// The area that is flown over.
        area: Area = {}, Accepts::TableOf(Area::KEYS);
        /// The sensor nodes.
        sensors: SensorKeys = {}, Accepts::TableOf(SensorKeys::KEYS);
        /// The vehicle.
        uav: UavKeys = {}, Accepts::TableOf(UavKeys::KEYS);
        /// Where the UAV lands and charges; `uav.battery` and `uav.must_land` imply it.
        base: Option<BaseKeys>, Accepts::TableOf(BaseKeys::KEYS);
        /// The radio and the channel model.
        link: LinkBudget = {}, Accepts::TableOf(LinkBudget::KEYS);
        /// The strategy and its keys, which the planner checks.
        planner: PlannerKeys = {}, Accepts::TableOf(PlannerKeys::KEYS);
        also {
            /// The file that it was read from, for messages.
            #[serde(skip)]
            pub path: PathBuf,
            /// Arrivals that are held in memory instead of the file `sensors.arrivals.file`.
            #[serde(skip)]
            pub trace: Option<ArrivalTrace>,
            /// The settings that replaced values of the file, for messages.
            #[serde(skip)]
            pub settings: Vec<Setting>,
            /// The polygons of zones, buildings and the boundary, with their keys or their files, for messages.
            #[serde(skip)]
            pub polygons: Vec<NamedPolygon>,
            /// What was ignored in its files, for messages.
            #[serde(skip)]
            pub notes: Vec<String>,
            /// The kinds of its UAVs, if they differ; `uav` then has the keys of the first UAV and of the whole fleet.
            #[serde(skip)]
            pub fleet: Option<Arc<MixedFleet>>,
            /// The keys of the first UAV that are those of its own table, for messages.
            #[serde(skip)]
            pub own: Option<Arc<OwnKeys>>,
            /// Its simplified zones, once they were asked for.
            #[serde(skip)]
            pub shared_zones: SharedZones,
        }
    }
}

crate::keys! {
    /// `[planner]`. The planner reads it with [`Scenario::planner_keys`](super::Scenario::planner_keys) and writes it
    /// back with all defaults by [`Scenario::with_planner_keys`](super::Scenario::with_planner_keys).
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(expecting = "a table")]
    pub struct PlannerKeys {
        /// Strategy, one of those in `skysink simulate --help`.
        strategy: String = "uts", Accepts::Rule("the name of a strategy");
        also {
            /// Every other key.
            #[serde(flatten)]
            pub others: Table,
        }
    }
}

/// ```
/// use skysink_common::scenario::Scenario;
/// let text = "name = 'a'\nsensors.file = 'nodes.csv'\n\
///             [uav]\ncount = 2\nmust_land = true\nstarts_m = [[5, 5], [95, 95]]\nendurances_s = [600.0, 90.0]";
/// let scenario = Scenario::parse(text, "fields/a.toml".as_ref(), Default::default()).unwrap();
/// assert_eq!(scenario.sensor_file().unwrap(), std::path::Path::new("fields/nodes.csv"));
/// assert!(scenario.trace_file().is_none() && !scenario.arrival_law().is_random() && scenario.must_land());
/// assert!(scenario.starts().eq([scenario.start(), scenario.start_of(1)]));
/// assert_eq!((scenario.slots_of(1), scenario.of_uav(1).start()), (90, scenario.start_of(1)));
/// assert_eq!(scenario.altitudes_m(20.0), [20.0, 20.0]); // it does not climb
///
/// let again = Scenario::parse(&scenario.to_toml(), &scenario.path, Default::default()).unwrap();
/// assert_eq!(again.hash(), scenario.hash());
/// assert!(again.to_toml_with_list("b.csv").contains("file = \"b.csv\""));
///
/// let error = scenario.refusal("uav.speed", &(-1.0).into(), "a speed above 0").to_string();
/// assert!(error.ends_with("uav.speed = -1.0: expected a speed above 0"), "{error}");
/// let greedy = scenario.with_planner_keys(&toml::toml! { strategy = "gfs" }).unwrap();
/// assert_eq!(greedy.planner.strategy, "gfs");
/// ```
impl Scenario {
    /// The origin of its values, for messages.
    pub(super) fn source(&self) -> Source<'_> {
        Source { path: &self.path, settings: &self.settings, own: self.own.as_deref() }
    }

    /// The scenario as a TOML file with all keys.
    ///
    /// # Panics
    /// Never: a scenario consists of tables of numbers and strings.
    pub fn to_toml(&self) -> String {
        let text =
            self.fleet.as_ref().map_or_else(|| toml::to_string(self), |fleet| toml::to_string(&fleet.table(self)));
        text.expect("a scenario consists of tables of numbers and strings")
    }

    /// The scenario as a TOML file, with the sensor list in the file `list` of the same folder, a trace of arrivals in
    /// [`TRACE`], files of features by their names, and a table of rates or a map of links in [`CHANNEL`], with
    /// [`RATES`]. Presets are expanded.
    pub fn to_toml_with_list(&self, list: &str) -> String {
        let mut sensors = SensorKeys { count: None, file: Some(list.into()), ..self.sensors.clone() };
        if let Some(ArrivalKeys { file: Some(file), .. }) = &mut sensors.arrivals {
            *file = TRACE.into();
        }
        for file in NODE_ROWS.into_iter().filter_map(|row| row.file) {
            if let Some(path) = (file.of_keys)(&mut sensors) {
                *path = file.name.into();
            }
        }
        let mut link = self.link.clone();
        if link.table.is_some() {
            link.file = Some(CHANNEL.into());
            link.preset = None;
            link.preset_exponent = None;
            link.preset_margin_db = None;
            link.preset_sigma_db = None;
        }
        if link.map.is_some() {
            link.file = Some(CHANNEL.into());
            link.rates = link.rates.map(|_| RATES.into());
        }
        let uav = UavKeys { preset: None, ..self.uav.clone() };
        let fleet = self.fleet.as_ref().map(|fleet| Arc::new(fleet.without_presets()));
        Self { sensors, link, uav, fleet, ..self.clone() }.to_toml()
    }

    /// Hash (XXH3) of all keys except the origin of the sensor list, which is published on the topic `sensors`.
    pub fn hash(&self) -> u64 {
        let hash = |seed, text: String| xxhash_rust::xxh3::xxh3_64_with_seed(text.as_bytes(), seed);
        let keys = hash(0, self.to_toml_with_list(""));
        let keys = self.link.table.iter().fold(keys, |seed, table| hash(seed, table.to_csv()));
        self.link.map.iter().fold(keys, |seed, map| {
            let (levels, rates) = map.to_csv();
            let levels = levels.replace("\n#", "\n"); // equal maps have equal hashes
            rates.into_iter().fold(hash(seed, levels), hash)
        })
    }

    /// The file of the channel; `None` if it is not that of a file.
    pub(crate) fn channel_file(&self) -> Option<PathBuf> {
        let is_own = self.link.model == LinkModel::Table && self.link.preset.is_none();
        let file = self.link.file.as_ref().filter(|_| is_own);
        file.map(|file| self.beside(file))
    }

    /// The file of the sensor list; `None` if the list is drawn.
    pub fn sensor_file(&self) -> Option<PathBuf> {
        self.sensors.file.as_ref().map(|file| self.beside(file))
    }

    /// The file of the arrivals; `None` if they are not those of a file.
    pub fn trace_file(&self) -> Option<PathBuf> {
        self.sensors.arrivals.as_ref()?.file.as_ref().map(|file| self.beside(file))
    }

    /// The law of the arrivals, which a planner knows.
    pub fn arrival_law(&self) -> ArrivalLaw {
        ArrivalLaw::of(self.sensors.arrivals.as_ref(), self.slot_s)
    }

    /// A path that is relative to the scenario.
    pub(crate) fn beside(&self, file: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(file)
    }

    /// Start of the first UAV [m].
    pub fn start(&self) -> Point3<f64> {
        self.start_of(0)
    }

    /// Start of the UAV number `uav` [m].
    pub fn start_of(&self, uav: usize) -> Point3<f64> {
        let [x_m, y_m] = self.own_start_m(uav).unwrap_or([f64::NAN; 2]);
        Point3::new(x_m, y_m, self.uav_of(uav).altitude_m)
    }

    /// The starts of all UAVs [m].
    pub fn starts(&self) -> impl Iterator<Item = Point3<f64>> {
        (0..self.uav.uavs()).map(|uav| self.start_of(uav))
    }

    /// The own endurance of the UAV number `uav` [s]; `None` if it has that of all.
    pub fn endurance_s_of(&self, uav: usize) -> Option<f64> {
        let given_s = self.uav.endurances_s.as_ref().and_then(|endurances_s| endurances_s.get(uav)).copied();
        given_s.or_else(|| self.kind_endurance_s(uav))
    }

    /// The last slot that the UAV number `uav` flies in: that of the mission, or where its own endurance ends.
    pub fn slots_of(&self, uav: usize) -> u64 {
        let own =
            self.endurance_s_of(uav).map(|endurance_s| (endurance_s / self.slot_s * (1.0 + TIME_SLACK)).floor() as u64);
        own.map_or(self.slots, |own| own.min(self.slots))
    }

    /// The mission of the UAV number `uav` alone, with its own start, endurance and random numbers; the scenario itself
    /// for one UAV without an endurance of its own.
    #[must_use]
    pub fn of_uav(&self, uav: usize) -> Self {
        let mut alone = self.with_kind_of(uav);
        if self.uav.uavs() > 1 || self.endurance_s_of(uav).is_some() {
            let start = self.start_of(uav);
            let start_m = Some([start.x, start.y]);
            let endurance_s = self.endurance_s_of(uav).unwrap_or(alone.uav.endurance_s);
            alone.uav = UavKeys { count: None, starts_m: None, start_m, endurances_s: None, endurance_s, ..alone.uav };
            alone.slots = self.slots_of(uav);
            alone.seed = self.seed.wrapping_add(SEED_STEP.wrapping_mul(uav as u64)) & MAX_SEED;
        }
        alone
    }

    /// Whether the UAV has to be in the base at the end of the mission.
    pub fn must_land(&self) -> bool {
        self.uav.must_land == Some(true)
    }

    /// The lowest and the highest altitude that can be reached in one slot from `altitude_m` [m].
    pub fn altitudes_m(&self, altitude_m: f64) -> [f64; 2] {
        self.uav.climb().map_or([altitude_m; 2], |climb| {
            let step_m = climb.max_climb_mps * self.slot_s;
            [(altitude_m - step_m).max(climb.min_altitude_m), (altitude_m + step_m).min(climb.max_altitude_m)]
        })
    }

    /// Reads `[planner]` as a `T`, with all defaults: `table` is `"planner"`, or the dotted name of one of its tables,
    /// such as `"planner.horizon"`. A missing table is read as an empty one.
    ///
    /// # Errors
    /// If `T` refuses a key or its value; the error names it.
    ///
    /// ```
    /// use serde::{Deserialize, Serialize};
    /// use skysink_common::{keys::POSITIVE, scenario::Scenario};
    /// skysink_common::keys! {
    ///     #[derive(Serialize, Deserialize)]
    ///     pub struct NearestKeys { /** Radius [m]. */ radius_m: f64 = 25.0, POSITIVE; }
    /// }
    /// let scenario = Scenario::letter(Default::default()).unwrap();
    /// assert_eq!(scenario.planner_keys::<NearestKeys>("planner.nearest").unwrap().radius_m, 25.0);
    /// ```
    pub fn planner_keys<T: Keys>(&self, table: &str) -> Result<T, InputError> {
        let mut keys = match table.strip_prefix("planner.").map(|name| self.planner.others.get(name)) {
            Some(Some(Value::Table(keys))) => keys.clone(),
            Some(Some(other)) => return Err(self.refusal(table, other, "a table")),
            Some(None) => Table::new(),
            None => Table::try_from(&self.planner).expect("it was read from TOML"),
        };
        keys::fill(T::KEYS, table, &mut keys, &[]);
        keys::read(keys, table, self.source())
    }

    /// This scenario with `keys` as `[planner]`, such as the checked keys with all defaults.
    ///
    /// # Errors
    /// If `keys` have no strategy.
    ///
    /// # Panics
    /// If `keys` cannot be written as TOML.
    pub fn with_planner_keys(mut self, keys: &impl Serialize) -> Result<Self, InputError> {
        let keys = Table::try_from(keys).expect("keys are plain tables of numbers and strings");
        self.planner = keys::read(keys, "planner", self.source())?;
        Ok(self)
    }

    /// The error for the `value` of `key`.
    pub fn refusal(&self, key: &str, value: &Value, expected: &str) -> InputError {
        self.source().refusal(key, value, expected)
    }
}
