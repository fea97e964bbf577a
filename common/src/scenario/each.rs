//! `[[uav.each]]`: a fleet whose UAVs differ. The table of a UAV is merged over `[uav]` before it is read, so that
//! presets, defaults, limits and rules are those of one UAV.

use std::borrow::Cow;
use std::sync::Arc;

use serde::Serialize;
use toml::{Table, Value};

use super::mission::Scenario;
use super::rules;
use super::uav::{MAX_UAVS, UavKeys};
use crate::error::InputError;
use crate::keys::{self, Keys, OwnKeys, Setting, SettingOrigin, Source, dotted};
use crate::presets;
use crate::slack::TIME_SLACK;

/// The name of the list.
const EACH: &str = "uav.each";

/// The resource blocks of a UAV, in `[link]` where they are those of all.
const BLOCKS: &str = "link.resource_blocks";

/// The keys of `[uav]` that are those of the whole fleet.
const OF_FLEET: [&str; 10] = [
    "each",
    "starts_m",
    "endurances_s",
    "coordination",
    "separation_m",
    "must_land",
    "moves",
    "cell_m",
    "track",
    "waypoints_m",
];

/// The UAVs of a table of `[[uav.each]]`.
#[derive(Debug, Clone, PartialEq)]
struct UavKind {
    /// `[uav]` with its own keys over it, and with the starts of its UAVs.
    uav: UavKeys,
    resource_blocks: usize,
    own: Arc<OwnKeys>,
}

/// A fleet whose UAVs differ.
#[derive(Debug, Clone, PartialEq)]
pub struct MixedFleet {
    /// `[uav]` as it is written: with all defaults, and the tables of `[[uav.each]]`.
    uav: Table,
    resource_blocks: Option<Value>,
    kinds: Vec<UavKind>,
}

/// A table of `[[uav.each]]` before it is read.
pub(super) struct KindTable {
    /// The scenario file with its keys over `[uav]`, and all defaults.
    pub file: Table,
    own: OwnKeys,
    /// The table, with its preset expanded.
    table: Table,
}

impl KindTable {
    /// Its keys, of the scenario that `source` is of.
    pub fn source<'a>(&'a self, source: Source<'a>) -> Source<'a> {
        Source { own: Some(&self.own), ..source }
    }
}

/// The kinds of the UAVs of `file`, which has all defaults; none if all are equal.
///
/// # Errors
/// If `[[uav.each]]` is no list of tables, or a table has a key of the whole fleet.
pub(super) fn kind_tables(file: &Table, source: Source) -> Result<Vec<KindTable>, InputError> {
    let Some(value) = dotted::value(file, EACH) else { return Ok(Vec::new()) };
    rules::check_forms(file, source)?;
    let tables: Option<Vec<&Table>> = value.as_array().map(|all| all.iter().filter_map(Value::as_table).collect());
    let is_whole =
        |tables: &Vec<&Table>| !tables.is_empty() && value.as_array().is_some_and(|all| all.len() == tables.len());
    let expected = "a list of tables, [[uav.each]]";
    let tables = tables.filter(is_whole).ok_or_else(|| source.refusal(EACH, value, expected))?;
    let mut kinds = Vec::with_capacity(tables.len());
    let mut first = 0;
    for (index, table) in tables.into_iter().enumerate() {
        let name = format!("{EACH}[{index}]");
        let count = count(table, &name, source)?;
        kinds.push(kind_table(file, table, name, first..first + count, source)?);
        first += count;
    }
    match first <= MAX_UAVS as usize {
        true => Ok(kinds),
        false => Err(source.refusal(EACH, &format!("{first} UAVs").into(), &format!("at most {MAX_UAVS}"))),
    }
}

/// The number of UAVs of `table`, called `name`, which has no key of the whole fleet.
fn count(table: &Table, name: &str, source: Source) -> Result<usize, InputError> {
    let of_fleet = table.iter().find(|(key, _)| OF_FLEET.contains(&key.as_str()));
    if let Some((key, value)) = of_fleet {
        return Err(source.refusal(&format!("{name}.{key}"), value, "it in [uav], for all UAVs"));
    }
    let Some(value) = table.get("count") else { return Ok(1) };
    let count = value.as_integer().filter(|count| (1..=i64::from(MAX_UAVS)).contains(count));
    let refusal = || source.refusal(&format!("{name}.count"), value, &format!("1 to {MAX_UAVS}"));
    count.map(|count| count as usize).ok_or_else(refusal)
}

/// The `table` of the `uavs` of `file`.
fn kind_table(
    file: &Table,
    table: &Table,
    name: String,
    uavs: std::ops::Range<usize>,
    source: Source,
) -> Result<KindTable, InputError> {
    let mut own = OwnKeys { name, keys: vec!["uav.preset".to_owned()] };
    let mut alone = Table::from_iter([("uav".to_owned(), Value::Table(table.clone()))]);
    presets::expand(&mut alone, Source { own: Some(&own), ..source })?;
    let Some(Value::Table(table)) = alone.remove("uav") else { unreachable!("it was just inserted") };
    let mut settings = Vec::new();
    for (key, value) in table.iter().filter(|(key, _)| *key != "count") {
        let key = if key == "resource_blocks" { BLOCKS.to_owned() } else { dotted::join("uav", key) };
        leaves(key, value, &mut settings);
    }
    own.keys = settings.iter().map(|setting| setting.key.clone()).collect();
    let mut file = file.clone();
    Scenario::apply(&settings, &mut file)?;
    if let Some(Value::Table(uav)) = file.get_mut("uav") {
        uav.remove("each");
        uav.remove("endurances_s");
        uav.insert("count".to_owned(), (uavs.len() as i64).into());
        if let Some(Value::Array(starts_m)) = uav.get_mut("starts_m") {
            *starts_m = starts_m.iter().skip(uavs.start).take(uavs.len()).cloned().collect();
        }
    }
    let displaced = rules::displaced_in(&file);
    keys::fill(Scenario::KEYS, "", &mut file, &displaced);
    Ok(KindTable { file, own, table })
}

/// The settings of the values below `key`.
fn leaves(key: String, value: &Value, settings: &mut Vec<Setting>) {
    match value {
        Value::Table(inner) if !inner.is_empty() => {
            inner.iter().for_each(|(name, value)| leaves(dotted::join(&key, name), value, settings));
        }
        _ => settings.push(Setting { key, value: value.clone(), origin: SettingOrigin::Replacement }),
    }
}

impl MixedFleet {
    /// The fleet of `file`, whose UAVs are of the kinds `tables`, and the mission with the keys of its first UAV.
    ///
    /// # Errors
    /// If a key is refused.
    pub(super) fn read(file: &Table, tables: &[KindTable], source: Source) -> Result<Scenario, InputError> {
        let of_kind = |table: &KindTable| keys::read::<Scenario>(table.file.clone(), "", table.source(source));
        let read = tables.iter().map(of_kind).collect::<Result<Vec<_>, InputError>>()?;
        let kind = |(scenario, table): (&Scenario, &KindTable)| UavKind {
            uav: scenario.uav.clone(),
            resource_blocks: scenario.link.resource_blocks,
            own: Arc::new(table.own.clone()),
        };
        let kinds: Vec<UavKind> = read.iter().zip(tables).map(kind).collect();
        let mut uav = file.get("uav").and_then(Value::as_table).cloned().unwrap_or_default();
        uav.remove("each");
        let each = tables.iter().map(|table| Value::Table(table.table.clone())).collect();
        uav.insert("each".to_owned(), Value::Array(each));
        let resource_blocks = dotted::value(file, BLOCKS).cloned();
        let mut scenario = read.into_iter().next().expect("a fleet has a UAV");
        let of_fleet = |key: &str| uav.get(key).cloned();
        let [starts_m, endurances_s] = ["starts_m", "endurances_s"].map(of_fleet);
        scenario.uav.count = Some(kinds.iter().map(|kind| kind.uav.uavs() as u32).sum());
        scenario.uav.starts_m = starts_m.map(|value| of_list("uav.starts_m", value, source)).transpose()?;
        scenario.uav.endurances_s = endurances_s.map(|value| of_list("uav.endurances_s", value, source)).transpose()?;
        scenario.own = Some(Arc::clone(&kinds[0].own));
        scenario.fleet = Some(Arc::new(Self { uav, resource_blocks, kinds }));
        Ok(scenario)
    }

    /// The tables of `[[uav.each]]`, with the keys of their presets.
    pub fn tables(&self) -> Vec<Table> {
        let each = self.uav.get("each").and_then(Value::as_array).into_iter().flatten();
        each.filter_map(Value::as_table).cloned().collect()
    }

    /// Takes down where UAVs start that have no start of their own [m].
    pub(super) fn start_at(&mut self, start_m: [f64; 2]) {
        dotted::insert_missing(&mut self.uav, "start_m", Value::Array(start_m.map(Value::Float).to_vec()));
    }

    /// The fleet without presets, whose keys it has.
    pub(super) fn without_presets(&self) -> Self {
        let mut plain = self.clone();
        plain.uav.remove("preset");
        let each = plain.uav.get_mut("each").and_then(Value::as_array_mut).into_iter().flatten();
        each.filter_map(Value::as_table_mut).for_each(|own| drop(own.remove("preset")));
        plain
    }

    /// The table of `scenario`, whose UAVs are these.
    ///
    /// # Panics
    /// Never: a scenario consists of tables of numbers and strings.
    pub(super) fn table(&self, scenario: &impl Serialize) -> Table {
        let mut table = Table::try_from(scenario).expect("a scenario consists of tables of numbers and strings");
        table.insert("uav".to_owned(), Value::Table(self.uav.clone()));
        if let (Some(value), Some(blocks)) = (dotted::value_mut(&mut table, BLOCKS), &self.resource_blocks) {
            *value = blocks.clone();
        }
        table
    }

    /// The kind of the UAV number `uav`, and its number among those of the kind.
    fn kind_of(&self, uav: usize) -> (usize, usize) {
        let mut number = uav;
        for (index, kind) in self.kinds.iter().enumerate() {
            if number < kind.uav.uavs() {
                return (index, number);
            }
            number -= kind.uav.uavs();
        }
        (self.kinds.len() - 1, number)
    }
}

/// The list `value` of the whole fleet.
fn of_list<T: serde::de::DeserializeOwned>(key: &str, value: Value, source: Source) -> Result<T, InputError> {
    value.clone().try_into().map_err(|_| source.refusal(key, &value, "a list with an entry for each UAV"))
}

/// ```
/// use skysink_common::scenario::Scenario;
/// let text = "name = 'a'\n[uav]\nmax_speed_mps = 10.0\n[[uav.each]]\ncount = 2\n[[uav.each]]\nmax_speed_mps = 5.0\n\
///             altitude_m = 60.0\nresource_blocks = 1";
/// let scenario = Scenario::parse(text, "a.toml".as_ref(), Default::default()).unwrap();
/// assert_eq!((scenario.uav.uavs(), scenario.kinds().count()), (3, 2));
/// let speeds_mps = (0..3).map(|uav| scenario.uav_of(uav).max_speed_mps);
/// assert!(speeds_mps.eq([10.0, 10.0, 5.0]));
/// let last = scenario.of_uav(2);
/// assert_eq!((last.start().z, last.reach_m(), last.link.resource_blocks), (60.0, 5.0, 1));
/// ```
impl Scenario {
    /// The mission once for each kind of its UAVs, of those alone: fleets of equal UAVs, in the order of their numbers.
    /// The scenario itself if all are equal.
    pub fn kinds(&self) -> impl Iterator<Item = Cow<'_, Self>> {
        let count = self.fleet.as_ref().map_or(1, |fleet| fleet.kinds.len());
        (0..count)
            .map(|index| self.fleet.as_ref().map_or(Cow::Borrowed(self), |fleet| Cow::Owned(fleet.alone(self, index))))
    }

    /// What `of` makes of the mission of each UAV, by number.
    pub fn by_uav<T: Clone>(&self, of: impl Fn(&Self) -> T) -> impl Iterator<Item = T> {
        self.kinds().flat_map(move |kind| std::iter::repeat_n(of(&kind), kind.uav.uavs()))
    }

    /// `[uav]` of each kind of its UAVs.
    pub fn uav_kinds(&self) -> impl Iterator<Item = &UavKeys> {
        let own = self.fleet.iter().flat_map(|fleet| &fleet.kinds).map(|kind| &kind.uav);
        own.chain(Some(&self.uav).filter(|_| self.fleet.is_none()))
    }

    /// `[uav]` of the UAV number `uav`.
    pub fn uav_of(&self, uav: usize) -> &UavKeys {
        self.fleet.as_ref().map_or(&self.uav, |fleet| &fleet.kinds[fleet.kind_of(uav).0].uav)
    }

    /// The kind of the UAV number `uav`, in the order of [`Self::kinds`]; 0 if all are equal.
    pub fn kind_of(&self, uav: usize) -> usize {
        self.fleet.as_ref().map_or(0, |fleet| fleet.kind_of(uav).0)
    }

    /// The name of a kind, such as `uav.each[2]`, with that of its drone; `None` if all UAVs are equal.
    pub fn kind_name(&self, kind: usize) -> Option<String> {
        let UavKind { uav, own, .. } = &self.fleet.as_ref()?.kinds[kind];
        let drone = uav.preset.as_ref().map_or_else(String::new, |preset| format!(", {preset}"));
        Some(own.name.clone() + &drone)
    }

    /// The same fleet with `[uav]` of the UAV number `uav` instead of the first one.
    #[must_use]
    pub fn as_of(&self, uav: usize) -> Self {
        let Some(fleet) = &self.fleet else { return self.clone() };
        let UavKind { uav: keys, resource_blocks, own } = &fleet.kinds[fleet.kind_of(uav).0];
        let UavKeys { count, starts_m, endurances_s, .. } = self.uav.clone();
        let uav = UavKeys { count, starts_m, endurances_s, ..keys.clone() };
        let mut other = Self { uav, own: Some(Arc::clone(own)), ..self.clone() };
        other.link.resource_blocks = *resource_blocks;
        other
    }

    /// Start of the UAV number `uav` on the ground [m], if its own is known.
    pub(super) fn own_start_m(&self, uav: usize) -> Option<[f64; 2]> {
        let of = |keys: &UavKeys, number: usize| {
            let own_m = keys.starts_m.as_ref().and_then(|starts_m| starts_m.get(number)).copied();
            own_m.or(keys.start_m)
        };
        match &self.fleet {
            None => of(&self.uav, uav),
            Some(fleet) => {
                let (kind, number) = fleet.kind_of(uav);
                of(&fleet.kinds[kind].uav, number)
            }
        }
    }

    /// The own endurance of the UAV number `uav` [s], by its table of `[[uav.each]]`; `None` if it has none, or flies
    /// in all slots.
    pub(super) fn kind_endurance_s(&self, uav: usize) -> Option<f64> {
        let fleet = self.fleet.as_ref()?;
        let UavKind { uav: keys, own, .. } = &fleet.kinds[fleet.kind_of(uav).0];
        let is_own = own.has("uav.endurance_s") && self.must_land();
        let flight_s = self.slots as f64 * self.slot_s;
        Some(keys.endurance_s).filter(|endurance_s| is_own && flight_s > endurance_s * (1.0 + TIME_SLACK))
    }

    /// Changes `[uav]` of all kinds of UAVs; the key of its own table, if it has one, is told.
    pub(super) fn change_each(&mut self, mut change: impl FnMut(&mut UavKeys, Option<&OwnKeys>)) {
        change(&mut self.uav, self.own.as_deref());
        if let Some(fleet) = &mut self.fleet {
            Arc::make_mut(fleet).kinds.iter_mut().for_each(|kind| change(&mut kind.uav, Some(&kind.own)));
        }
    }

    /// It with the keys of the kind of the UAV number `uav`, for all.
    pub(super) fn with_kind_of(&self, uav: usize) -> Self {
        self.fleet.as_ref().map_or_else(|| self.clone(), |fleet| fleet.alone(self, fleet.kind_of(uav).0))
    }
}

impl MixedFleet {
    /// The mission of `scenario` with the UAVs of a kind alone.
    fn alone(&self, scenario: &Scenario, kind: usize) -> Scenario {
        let UavKind { uav, resource_blocks, own } = &self.kinds[kind];
        let mut alone = Scenario { fleet: None, own: Some(Arc::clone(own)), uav: uav.clone(), ..scenario.clone() };
        alone.link.resource_blocks = *resource_blocks;
        alone
    }
}
