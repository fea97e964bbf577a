//! The scenario: the mission, its field, channel and strategy.
//!
//! A [`Scenario`] is valid by construction. It is read from TOML: a file for each table declares its keys, and
//! `rules` handles alternative keys and checks what holds between keys. [`Scenario::to_toml`] writes it back with all
//! defaults. Sensor lists are read by [`crate::sensors`], `[planner]` by the planner.

mod area;
mod base;
pub mod battery;
mod each;
mod fleet;
pub mod limits;
pub mod loss_rate;
mod mission;
mod motion;
mod preset_rates;
pub mod propulsion;
mod rules;
mod simplified;
mod sites;
mod track;
mod uav;
mod zones;

use std::path::Path;
use std::sync::Arc;

use toml::{Table, Value};

pub use crate::geodata::projection::Origin;
pub use crate::keys::{Interval, Setting, SettingOrigin, WholeInterval};
pub use crate::nodes::SensorKeys;
pub use area::{Area, BuildingKeys, NoFlyKeys};
pub use base::{BaseKeys, BatteryKeys, SiteKeys};
pub use fleet::MixedFleet;
pub use mission::{CHANNEL, MAX_SEED, PlannerKeys, RATES, Scenario, TRACE, is_kept_file, name_refusal};
pub use simplified::{SharedZones, SimplifiedZones};
pub use track::{MOST_TRACK_SLOTS, TimedPoint, slot_ends};
pub use uav::{AltitudeMode, Climb, Coordination, MAX_UAVS, Moves, Propulsion, UavKeys};
pub use zones::LEAST_FILLED;

use crate::channel::{LinkMap, LinkModel, RateTable};
use crate::error::{InputError, read_text};
use crate::keys::{self, Keys, Source, dotted};
use crate::nodes::{NodeKeys, NodeTraits};
use crate::presets;
use crate::terminal::shell_path;

/// The built-in `letter.toml`: the mission of the UTS letter (arXiv 2103.00753, section V).
pub const LETTER: &str = include_str!("../letter.toml");

/// Extensions of files that are no scenarios, but become one by an option of `skysink new`.
const IMPORTED: [(&str, &str); 8] = [
    ("csv", "--sensors"),
    ("kml", "--sensors"),
    ("kmz", "--sensors"),
    ("gpx", "--sensors"),
    ("geojson", "--sensors"),
    ("json", "--sensors"),
    ("plan", "--plan"),
    ("waypoints", "--plan"),
];

/// Changes to a scenario from the command line, made before it is checked.
///
/// ```
/// use skysink_common::scenario::{Overrides, Scenario};
/// let overrides = Overrides { seed: Some(7), strategy: Some("gfs"), ..Overrides::default() };
/// let scenario = Scenario::letter(overrides).unwrap();
/// assert_eq!((scenario.seed, scenario.planner.strategy.as_str()), (7, "gfs"));
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Overrides {
    /// Replaces `seed`.
    pub seed: Option<u64>,
    /// Replaces `planner.strategy`.
    pub strategy: Option<&'static str>,
    /// Replaces `slots`; `uav.endurance_s` is raised to the length of the mission if it is less.
    pub slots: Option<u64>,
    /// Replaces any keys, before the replacements above.
    pub keys: Vec<Setting>,
    /// Replaces the content of the file `link.file`, which is then not read.
    pub table: Option<Arc<RateTable>>,
    /// Replaces the content of the files `link.file` and `link.rates` of a map, which are then not read. Where it has
    /// no places of sensor nodes, they are those of the list.
    pub map: Option<Arc<LinkMap>>,
    /// Replaces the content of the file `uav.track`, which is then not read.
    pub track: Option<String>,
}

/// ```
/// use skysink_common::scenario::{Overrides, Scenario};
/// let letter = Scenario::letter(Overrides::default()).unwrap();
/// assert_eq!(Scenario::read("letter.toml".as_ref(), Overrides::default()).unwrap().hash(), letter.hash());
/// let error = Scenario::parse("name = 'a'\nslots = 0", "a.toml".as_ref(), Overrides::default()).unwrap_err();
/// assert!(error.to_string().starts_with("scenario a.toml: slots = 0: expected"));
/// let mut table = toml::toml! { sensors.file = "nodes.csv" };
/// Scenario::apply(&["sensors.count=9".parse().unwrap()], &mut table).unwrap();
/// assert_eq!(table, toml::toml! { sensors.count = 9 });
/// ```
impl Scenario {
    /// What the features of the SNs read of the mission.
    pub fn node_keys(&self) -> NodeKeys<'_> {
        let Self { sensors, link, slot_s, slots, .. } = self;
        NodeKeys { sensors, link, slot_s: *slot_s, slots: *slots, uavs: self.uav.uavs() }
    }

    /// What follows from the features of the SNs together.
    pub fn node_traits(&self) -> NodeTraits {
        self.node_keys().traits()
    }

    /// The slots that an SN may wait for a service, by `sensors.deadline_s` (decision D36).
    pub fn deadline_slots(&self) -> Option<u64> {
        self.sensors.deadline_s.map(|deadline_s| self.node_keys().whole_slots(deadline_s))
    }

    /// Reads and checks a file. A relative sensor list is relative to the file's folder.
    ///
    /// # Errors
    /// If the file cannot be read, is not a scenario, or has a value out of range.
    pub fn read(path: &Path, overrides: Overrides) -> Result<Self, InputError> {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_lowercase();
        let imported = IMPORTED.iter().find(|(imported, _)| *imported == extension);
        if let Some((_, option)) = imported.filter(|_| path.is_file()) {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            let is_name = name_refusal(&stem).is_none() && !stem.starts_with('-');
            let name = if is_name { &*stem } else { "mission" };
            let command = format!("skysink new {name} {option} {}", shell_path(path));
            let message = format!("expected a scenario, TOML, as `{command}` makes one of this file");
            return Err(InputError::new("scenario", path, message));
        }
        let text = read_text("scenario", path)?;
        Self::parse(&text, path, overrides)
    }

    /// The mission of the paper, [`LETTER`].
    ///
    /// # Errors
    /// If an override is out of range.
    pub fn letter(overrides: Overrides) -> Result<Self, InputError> {
        Self::parse(LETTER, Path::new("letter.toml (built in)"), overrides)
    }

    /// Applies settings to the table of a scenario. A setting in one form removes the alternative form of the table.
    ///
    /// # Errors
    /// If a part of a key exists, but is not a table.
    pub fn apply(settings: &[Setting], table: &mut Table) -> Result<(), InputError> {
        let displaced = settings.iter().flat_map(|setting| rules::displaced(&setting.key, &setting.value));
        displaced.for_each(|key| dotted::remove(table, &key));
        for setting in settings {
            presets::written(&setting.key).into_iter().for_each(|key| dotted::remove(table, key));
            if setting.key == "link.preset" {
                let of_others = rules::displaced("link.model", &"table".into());
                of_others.iter().for_each(|key| dotted::remove(table, key));
            }
        }
        settings.iter().try_for_each(|setting| setting.apply(table))
    }

    /// Checks the text of the scenario file `path`.
    ///
    /// # Errors
    /// If the text is not a scenario or has a value out of range.
    pub fn parse(text: &str, path: &Path, overrides: Overrides) -> Result<Self, InputError> {
        let mut table: Table = text.parse().map_err(|error| InputError::toml("scenario", path, text, &error))?;
        if table.contains_key("axes") || table.contains_key("strategies") {
            let message = "it is a sweep: expected a scenario (skysink sweep flies this file)";
            return Err(InputError::new("scenario", path, message));
        }
        Self::apply(&overrides.keys, &mut table)?;
        for (key, number) in [("seed", overrides.seed), ("slots", overrides.slots)] {
            if let Some(number) = number {
                // A number beyond TOML's range is beyond that of either key; -1 is refused.
                table.insert(key.to_owned(), Value::Integer(i64::try_from(number).unwrap_or(-1)));
            }
        }
        let source = Source { path, settings: &overrides.keys, own: None };
        presets::expand(&mut table, source)?;
        let has_radius = dotted::value(&table, "link.comm_radius_m").is_some();
        let displaced = rules::displaced_in(&table);
        keys::fill(Self::KEYS, "", &mut table, &displaced);
        let kinds = each::kind_tables(&table, source)?;
        let mut scenario: Self = match &kinds[..] {
            [] => keys::read(table.clone(), "", source)?,
            kinds => MixedFleet::read(&table, kinds, source)?,
        };
        path.clone_into(&mut scenario.path);
        scenario.settings = overrides.keys;
        zones::read_files(&mut scenario)?;
        scenario.read_link(has_radius, overrides.table, overrides.map)?;
        if let Some(strategy) = overrides.strategy {
            strategy.clone_into(&mut scenario.planner.strategy);
        }
        if let Some(slots) = overrides.slots {
            let flight_s = slots as f64 * scenario.slot_s;
            let must_land = scenario.must_land();
            scenario.change_each(|uav, own| {
                let ends_early = must_land && own.is_some_and(|own| own.has("uav.endurance_s"));
                uav.endurance_s = if ends_early { uav.endurance_s } else { uav.endurance_s.max(flight_s) };
            });
        }
        let track = track::read_file(&mut scenario, overrides.track)?;
        scenario.settle();
        match &kinds[..] {
            [] => rules::check(&scenario, &table)?,
            kinds => {
                rules::check_fleet(&scenario, &table)?;
                let mut tables = scenario.kinds().zip(kinds);
                tables.try_for_each(|(alone, kind)| rules::check(&alone, &kind.file))?;
            }
        }
        track::check(&scenario, track.as_ref())?;
        Ok(scenario)
    }

    /// Reads the files and presets of `[link]` that `table` and `map` do not replace. The radius of a preset counts
    /// unless the scenario `has_radius`.
    fn read_link(
        &mut self,
        has_radius: bool,
        table: Option<Arc<RateTable>>,
        map: Option<Arc<LinkMap>>,
    ) -> Result<(), InputError> {
        self.link.table = match (self.channel_file(), table) {
            (None, _) => None,
            (Some(_), Some(table)) => Some(table),
            (Some(path), None) => Some(RateTable::read(&path)?.shared()),
        };
        if let Some((rates, radius_m)) = preset_rates::rates(self)? {
            self.link.table = Some(rates);
            self.link.comm_radius_m = if has_radius { self.link.comm_radius_m } else { radius_m };
        }
        if let Some(file) = self.link.file.as_ref().filter(|_| self.link.model == LinkModel::Map) {
            let rates = self.link.rates.as_ref().map(|rates| self.beside(rates));
            self.link.map = Some(match map {
                Some(map) => map,
                None => LinkMap::read(&self.beside(file), rates.as_deref())?,
            });
        }
        self.link.buildings = (self.link.model == LinkModel::Buildings).then(|| self.buildings().shared());
        Ok(())
    }

    /// Fills in where UAVs start, and the base, by default.
    fn settle(&mut self) {
        let middle_m = self.middle_m();
        self.change_each(|uav, _| {
            let first_m = uav.starts_m.as_ref().and_then(|starts_m| starts_m.first()).copied();
            uav.start_m.get_or_insert(first_m.unwrap_or(middle_m));
        });
        self.fleet.iter_mut().for_each(|fleet| Arc::make_mut(fleet).start_at(middle_m));
        let has_battery = self.uav_kinds().any(|uav| uav.battery.is_some());
        if has_battery || self.must_land() {
            self.base.get_or_insert_default();
        }
        let start_m = self.uav.start_m;
        if let Some(base) = self.base.as_mut().filter(|base| base.areas_m.is_none() && base.site.is_none()) {
            base.position_m = base.position_m.or(start_m);
        }
    }
}
