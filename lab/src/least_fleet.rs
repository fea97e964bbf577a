//! The least fleet of a mission: the fewest UAVs with which at most a fraction of the data is lost, or of several kinds
//! of UAVs the cheapest ones, and a number or a price below which no fleet of any strategy can do it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::message::Mode;
use skysink_common::scenario::{Overrides, Scenario, Setting, SettingOrigin};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_mission::files::write_whole;
use skysink_planner::bound::mission_bound;
use skysink_planner::settings;
use toml::{Table, Value};

use crate::drawing::chart::{Chart, Scale};
use crate::drawing::curves::CurveValues;
use crate::drawing::page::Look;
use crate::drawing::style::{BEST_KNOWN_STYLE, styles_of};
use crate::error::LabError;
use crate::progress::{LabProgress, OnProgress};
use crate::sweep::results::{AxisType, number};
use crate::unflown::UnflownFlights;
use skysink_common::figure::Support;
use skysink_mission::unflown::UnflownPlans;

/// What is asked.
#[derive(Debug, Clone)]
pub struct FleetQuestion {
    /// The scenario file.
    pub scenario: PathBuf,
    /// Its changes; `uav.count` is replaced.
    pub changes: Overrides,
    /// The strategies.
    pub strategies: Vec<&'static str>,
    /// Most loss rate.
    pub loss_rate: f64,
    /// Number of fields, with consecutive seeds.
    pub seeds: u64,
    /// Most UAVs that are tried.
    pub most: u32,
    /// The price of a UAV of each table of `[[uav.each]]`; none if all UAVs are equal.
    pub prices: Vec<f64>,
    /// Values of one key; none for the scenario as it is.
    pub over: Vec<Setting>,
}

/// The least fleets over the fields of a value of the key.
#[derive(Debug, Clone, Serialize)]
pub struct LeastFleets {
    /// The value of the key.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<Value>,
    /// A strategy, or [`BOUND`].
    pub strategy: String,
    /// By seed: the least number of UAVs; null if more than the most are needed.
    pub uavs: BTreeMap<u64, Option<u32>>,
    /// By seed: the cheapest fleet of several kinds; absent if all UAVs are equal, null if more than the most UAVs are
    /// needed.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub cheapest: BTreeMap<u64, Option<PricedFleet>>,
    /// By seed: the plans of these fleets that were not flown as they were decided.
    #[serde(skip)]
    unflown: Vec<(u64, Option<UnflownPlans>)>,
}

/// A fleet of several kinds of UAVs.
#[derive(Debug, Clone, PartialEq, PartialOrd, Serialize)]
pub struct PricedFleet {
    /// The sum of the prices of its UAVs.
    pub price: f64,
    /// UAVs of each kind, in the order of `[[uav.each]]`.
    pub uavs: Vec<u32>,
}

impl PricedFleet {
    /// The number of its UAVs.
    fn count(&self) -> u32 {
        self.uavs.iter().sum()
    }

    /// The numbers of UAVs of each kind, such as `2 + 1`.
    #[must_use]
    pub fn of_each(&self) -> String {
        self.uavs.iter().map(u32::to_string).collect::<Vec<_>>().join(" + ")
    }
}

/// All numbers of UAVs of so many kinds, at most `most` together.
fn counts(kinds: usize, most: u32) -> Vec<Vec<u32>> {
    let Some(others) = kinds.checked_sub(1) else { return vec![Vec::new()] };
    let with = |own: u32| counts(others, most - own).into_iter().map(move |rest| [vec![own], rest].concat());
    (0..=most).flat_map(with).collect()
}

impl LeastFleets {
    /// The flights of these fleets whose plans were not flown as they were decided.
    #[must_use]
    pub fn unflown(&self) -> Option<UnflownFlights> {
        let value = self.value.as_ref().map_or_else(String::new, |value| format!(" at {value}"));
        UnflownFlights::of_plans(&format!("{}{value}", self.strategy), self.unflown.iter().copied())
    }
}

/// The least fleet, `None` if the most are too few, and its plans that were not flown as they were decided.
type Least = (Option<PricedFleet>, Option<UnflownPlans>);

/// Whether a fleet is enough, and its plans that were not flown as they were decided.
type Tried = (bool, Option<UnflownPlans>);

/// The name of the bound in results.
pub const BOUND: &str = "bound";

/// The number of UAVs as a setting.
fn count(uavs: u32) -> Setting {
    format!("uav.count={uavs}").parse().expect("a key and a number")
}

/// The UAVs of each kind, with these tables, as a setting.
fn each(tables: &[Table], uavs: &[u32]) -> Setting {
    let flown = tables.iter().zip(uavs).filter(|(_, uavs)| **uavs > 0);
    let table = |(table, uavs): (&Table, &u32)| {
        let mut table = table.clone();
        table.insert("count".to_owned(), i64::from(*uavs).into());
        Value::Table(table)
    };
    let value = Value::Array(flown.map(table).collect());
    Setting { key: "uav.each".to_owned(), value, origin: SettingOrigin::Option }
}

/// The fleets that are tried, in the order in which they are.
struct Candidates {
    tables: Vec<Table>,
    fleets: Vec<PricedFleet>,
}

impl Candidates {
    /// The changes that make a fleet of the mission.
    fn setting(&self, fleet: &PricedFleet) -> Setting {
        if self.tables.is_empty() { count(fleet.count()) } else { each(&self.tables, &fleet.uavs) }
    }
}

/// A mission whose least fleet is looked for.
struct Case<'a> {
    value: Option<&'a Setting>,
    /// `None` for the bound.
    strategy: Option<&'static str>,
    seed: u64,
}

impl FleetQuestion {
    /// The missions of all values, strategies and fields; the first curve of a value is the bound.
    fn cases(&self, seed: u64) -> Vec<Case<'_>> {
        let none = self.over.is_empty().then_some(None);
        let values = self.over.iter().map(Some).chain(none);
        let strategies = || std::iter::once(None).chain(self.strategies.iter().copied().map(Some));
        let of_value = |value| strategies().map(move |strategy| (value, strategy));
        let curves = values.flat_map(of_value);
        curves
            .flat_map(|(value, strategy)| (seed..seed + self.seeds).map(move |seed| Case { value, strategy, seed }))
            .collect()
    }

    /// The fleets of the scenario `given`, the cheapest first; those of equal UAVs cost as many as they are.
    fn candidates(&self, given: &Scenario) -> Candidates {
        let tables = given.fleet.as_ref().map_or_else(Vec::new, |fleet| fleet.tables());
        let prices = if self.prices.is_empty() { &[1.0][..] } else { &self.prices };
        let fleet = |uavs: Vec<u32>| {
            let price = uavs.iter().zip(prices).map(|(uavs, price)| f64::from(*uavs) * price).sum();
            PricedFleet { price, uavs }
        };
        let mut fleets: Vec<PricedFleet> =
            counts(prices.len(), self.most).into_iter().map(fleet).filter(|fleet| fleet.count() > 0).collect();
        fleets.sort_by(|one, other| {
            one.price.total_cmp(&other.price).then(one.count().cmp(&other.count())).then(other.uavs.cmp(&one.uavs))
        });
        Candidates { tables, fleets }
    }

    /// The scenario of a case with a fleet by this setting.
    fn scenario(&self, case: &Case, fleet: Setting) -> Result<Scenario, LabError> {
        let mut changes = self.changes.clone();
        changes.keys.extend(case.value.cloned());
        changes.keys.push(fleet);
        changes.seed = Some(case.seed);
        changes.strategy = case.strategy.or(changes.strategy);
        Ok(Scenario::read(&self.scenario, changes).and_then(settings::resolve)?)
    }

    /// Whether a fleet loses no more than asked; for the bound whether it is not excluded.
    fn is_enough(&self, case: &Case, fleet: Setting, stop: &Stop) -> Result<Tried, LabError> {
        let scenario = self.scenario(case, fleet)?;
        let list = SensorList::of(&scenario)?;
        let most_bits = self.loss_rate * list.mission_bits(&scenario);
        if case.strategy.is_none() {
            let bound = mission_bound(&scenario, &list.sensors_of(&scenario), &list.queues_bits(), u64::MAX);
            return Ok((bound.loss_bits as f64 <= most_bits, None));
        }
        let mut mission = Mission::until(&scenario, &list, stop)?;
        let mut lost_bits = 0;
        let [mut held_slots, mut refused] = [0; 2];
        for record in &mut mission {
            stop.check()?;
            for flight in record.uavs().map(|row| row.flight).filter(|flight| !flight.awaits_pad()) {
                held_slots += u64::from(flight.flown_mode() == Mode::Hold);
                refused += u64::from(flight.refused);
            }
            lost_bits = record.header.totals.lost_bits;
            if lost_bits as f64 > most_bits {
                break;
            }
        }
        stop.check()?;
        let unflown = UnflownPlans::of(&scenario, mission.slot(), [held_slots, refused], None);
        Ok((lost_bits as f64 <= most_bits, unflown))
    }

    /// The least fleet of a case; `None` if the most are too few.
    fn least(&self, case: &Case, all: &Candidates, stop: &Stop) -> Result<Least, LabError> {
        for fleet in &all.fleets {
            if let (true, unflown) = self.is_enough(case, all.setting(fleet), stop)? {
                return Ok((Some(fleet.clone()), unflown));
            }
        }
        Ok((None, None))
    }

    /// Refuses a scenario whose UAVs have lists of their own, or no prices.
    fn check(&self, given: &Scenario) -> Result<(), LabError> {
        let refuse = |message: String| Err(InputError::new("scenario", &self.scenario, message).into());
        for (key, is_given) in
            [("uav.starts_m", given.uav.starts_m.is_some()), ("uav.endurances_s", given.uav.endurances_s.is_some())]
        {
            if is_given {
                return refuse(format!("{key}: expected none, because the number of UAVs is what is looked for"));
            }
        }
        let kinds = given.fleet.as_ref().map_or(0, |fleet| fleet.tables().len());
        match (kinds, self.prices.len()) {
            (kinds, prices) if kinds == prices => Ok(()),
            (0, _) => refuse("--prices: expected tables [[uav.each]], of which each has a price".to_owned()),
            _ => refuse(format!("uav.each: expected --prices with {kinds} prices, one for each table")),
        }
    }

    /// Finds the least fleets. Fleets are tried in ascending order, because a larger one may lose more.
    ///
    /// # Errors
    /// If a scenario is refused, or on a stop.
    pub fn answer(&self, stop: &Stop, on_progress: OnProgress) -> Result<Vec<LeastFleets>, LabError> {
        let given = Scenario::read(&self.scenario, self.changes.clone())?;
        self.check(&given)?;
        let all = self.candidates(&given);
        let seed = given.seed;
        let alone = self.over.is_empty().then_some(None);
        for value in self.over.iter().map(Some).chain(alone) {
            let first = all.setting(&all.fleets[0]);
            self.scenario(&Case { value, strategy: None, seed }, first)?; // refused before anything is flown
        }
        let cases = self.cases(seed);
        let done = AtomicU64::new(0);
        let progress = |done: u64| LabProgress { done, of: cases.len() as u64, loss_rate: None, left: None };
        on_progress(progress(0));
        let least = |case: &Case| {
            let least = self.least(case, &all, stop)?;
            on_progress(progress(done.fetch_add(1, Ordering::Relaxed) + 1));
            Ok(least)
        };
        let found = cases.par_iter().map(least).collect::<Result<Vec<_>, LabError>>()?;
        let mut fleets: Vec<LeastFleets> = Vec::new();
        for (case, (least, unflown)) in cases.iter().zip(found) {
            if case.seed == seed {
                let strategy = case.strategy.unwrap_or(BOUND).to_owned();
                fleets.push(LeastFleets {
                    value: case.value.map(|setting| setting.value.clone()),
                    strategy,
                    uavs: BTreeMap::new(),
                    cheapest: BTreeMap::new(),
                    unflown: Vec::new(),
                });
            }
            let fleet = fleets.last_mut().expect("the first seed begins one");
            fleet.uavs.insert(case.seed, least.as_ref().map(PricedFleet::count));
            if !self.prices.is_empty() {
                fleet.cheapest.insert(case.seed, least);
            }
            fleet.unflown.push((case.seed, unflown));
        }
        Ok(fleets)
    }

    /// Writes `fleet.csv`, and over a key of numbers the figure `fleet.svg`, `.pdf` and `.png`, into the folder `out`;
    /// returns the files.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, fleets: &[LeastFleets], out: &Path) -> Result<Vec<PathBuf>, LabError> {
        let key = self.over.first().map_or("value", |setting| setting.key.as_str());
        let of_prices = if self.prices.is_empty() { "" } else { ",price,of_each" };
        let mut table = format!("{key},strategy,seed,uavs{of_prices}\n");
        let axis = AxisType::of_values(self.over.iter().map(|setting| &setting.value));
        for fleet in fleets {
            for (seed, uavs) in &fleet.uavs {
                let value = fleet.value.as_ref().map_or_else(String::new, |value| axis.cell(value));
                let uavs = uavs.map_or_else(String::new, |uavs| uavs.to_string());
                table += &format!("{value},{},{seed},{uavs}", fleet.strategy);
                if let Some(cheapest) = fleet.cheapest.get(seed) {
                    let cells = cheapest.as_ref().map(|fleet| format!(",{},{}", fleet.price, fleet.of_each()));
                    table += &cells.unwrap_or_else(|| ",,".to_owned());
                }
                table += "\n";
            }
        }
        let csv = out.join("fleet.csv");
        write_whole(&csv, table.as_bytes())?;
        let mut files = vec![csv];
        let xs: Option<Vec<f64>> = self.over.iter().map(|setting| number(&setting.value)).collect();
        if let Some(xs) = xs.filter(|xs| xs.len() > 1) {
            files.extend(self.chart(fleets, key, &xs).draw(&out.join("fleet"))?);
        }
        Ok(files)
    }

    /// By seed: the number of UAVs, or their price; more than the most count as one more, or as the dearest.
    fn sizes(&self, fleets: &LeastFleets) -> BTreeMap<u64, f64> {
        let number = |uavs: &Option<u32>| f64::from(uavs.unwrap_or(self.most + 1));
        let dearest = self.prices.iter().copied().fold(0.0, f64::max) * f64::from(self.most);
        let price = |fleet: &Option<PricedFleet>| fleet.as_ref().map_or(dearest, |fleet| fleet.price);
        match self.prices.is_empty() {
            true => fleets.uavs.iter().map(|(seed, uavs)| (*seed, number(uavs))).collect(),
            false => fleets.cheapest.iter().map(|(seed, fleet)| (*seed, price(fleet))).collect(),
        }
    }

    /// The mean number of UAVs, or their price, over the key.
    fn chart(&self, fleets: &[LeastFleets], key: &str, xs: &[f64]) -> Chart {
        let names: Vec<String> =
            fleets.iter().take(1 + self.strategies.len()).map(|fleet| fleet.strategy.clone()).collect();
        let styles = styles_of(&names[1..]);
        let what = if self.prices.is_empty() { "UAVs" } else { "price" };
        let curve = |(place, name): (usize, &String)| {
            let own = fleets.iter().filter(|fleet| fleet.strategy == *name);
            let style = place.checked_sub(1).map_or(BEST_KNOWN_STYLE, |place| styles[place]);
            let points = own.map(|fleets| self.sizes(fleets));
            let label = if name == BOUND { "lower bound".to_owned() } else { name.clone() };
            CurveValues { label, style, reference: None, points: points.collect() }.means(xs, Support::NonNegative)
        };
        let description = format!("least fleet · loss rate at most {} · {} fields", self.loss_rate, self.seeds);
        Chart {
            look: Look { title: String::new(), footer: String::new(), description, width_mm: None },
            x_label: key.to_owned(),
            x_words: Vec::new(),
            y_label: format!("{what} for a loss rate of at most {}", self.loss_rate),
            series: names.iter().enumerate().map(curve).collect(),
            support: Support::NonNegative,
            y_scale: Scale::Linear,
        }
    }
}
