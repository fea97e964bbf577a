//! The least fleet of a mission: the fewest UAVs with which at most a fraction of the data is lost, and a number of
//! UAVs below which no fleet of any strategy can do it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::message::Mode;
use skysink_common::scenario::{Overrides, Scenario, Setting};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_mission::files::write_whole;
use skysink_planner::bound::mission_bound;
use skysink_planner::settings;
use toml::Value;

use crate::drawing::chart::{Chart, Scale};
use crate::drawing::curves::CurveValues;
use crate::drawing::page::Look;
use crate::drawing::style::{BEST_KNOWN_STYLE, styles_of};
use crate::error::LabError;
use crate::progress::{LabProgress, OnProgress};
use crate::sweep::results::{AxisType, number};
use crate::unflown::UnflownFlights;
use skysink_mission::metrics::Support;
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
    /// By seed: the plans of these fleets that were not flown as they were decided.
    #[serde(skip)]
    unflown: Vec<(u64, Option<UnflownPlans>)>,
}

impl LeastFleets {
    /// The flights of these fleets whose plans were not flown as they were decided.
    #[must_use]
    pub fn unflown(&self) -> Option<UnflownFlights> {
        let value = self.value.as_ref().map_or_else(String::new, |value| format!(" at {value}"));
        UnflownFlights::of_plans(&format!("{}{value}", self.strategy), self.unflown.iter().copied())
    }
}

/// Whether a fleet is enough, and its plans that were not flown as they were decided.
type Tried = (bool, Option<UnflownPlans>);

/// The name of the bound in results.
pub const BOUND: &str = "bound";

/// The number of UAVs as a setting.
fn count(uavs: u32) -> Setting {
    format!("uav.count={uavs}").parse().expect("a key and a number")
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

    /// The scenario of a case with `uavs` UAVs.
    fn scenario(&self, case: &Case, uavs: u32) -> Result<Scenario, LabError> {
        let mut changes = self.changes.clone();
        changes.keys.extend(case.value.cloned());
        changes.keys.push(count(uavs));
        changes.seed = Some(case.seed);
        changes.strategy = case.strategy.or(changes.strategy);
        Ok(Scenario::read(&self.scenario, changes).and_then(settings::resolve)?)
    }

    /// Whether `uavs` UAVs lose no more than asked; for the bound whether it is not excluded.
    fn is_enough(&self, case: &Case, uavs: u32, stop: &Stop) -> Result<Tried, LabError> {
        let scenario = self.scenario(case, uavs)?;
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
    fn least(&self, case: &Case, stop: &Stop) -> Result<(Option<u32>, Option<UnflownPlans>), LabError> {
        for uavs in 1..=self.most {
            if let (true, unflown) = self.is_enough(case, uavs, stop)? {
                return Ok((Some(uavs), unflown));
            }
        }
        Ok((None, None))
    }

    /// Finds the least fleets. Fleets are tried in ascending order, because a larger one may lose more.
    ///
    /// # Errors
    /// If a scenario is refused, or on a stop.
    pub fn answer(&self, stop: &Stop, on_progress: OnProgress) -> Result<Vec<LeastFleets>, LabError> {
        let given = Scenario::read(&self.scenario, self.changes.clone())?;
        for (key, is_given) in
            [("uav.starts_m", given.uav.starts_m.is_some()), ("uav.endurances_s", given.uav.endurances_s.is_some())]
        {
            if is_given {
                let message = format!("{key}: expected none, because the number of UAVs is what is looked for");
                return Err(InputError::new("scenario", &self.scenario, message).into());
            }
        }
        let seed = given.seed;
        let alone = self.over.is_empty().then_some(None);
        for value in self.over.iter().map(Some).chain(alone) {
            self.scenario(&Case { value, strategy: None, seed }, 1)?; // refused before anything is flown
        }
        let cases = self.cases(seed);
        let done = AtomicU64::new(0);
        let progress = |done: u64| LabProgress { done, of: cases.len() as u64, loss_rate: None, left: None };
        on_progress(progress(0));
        let least = |case: &Case| {
            let least = self.least(case, stop)?;
            on_progress(progress(done.fetch_add(1, Ordering::Relaxed) + 1));
            Ok(least)
        };
        let found = cases.par_iter().map(least).collect::<Result<Vec<_>, LabError>>()?;
        let mut fleets: Vec<LeastFleets> = Vec::new();
        for (case, (uavs, unflown)) in cases.iter().zip(found) {
            if case.seed == seed {
                let strategy = case.strategy.unwrap_or(BOUND).to_owned();
                fleets.push(LeastFleets {
                    value: case.value.map(|setting| setting.value.clone()),
                    strategy,
                    uavs: BTreeMap::new(),
                    unflown: Vec::new(),
                });
            }
            let fleet = fleets.last_mut().expect("the first seed begins one");
            fleet.uavs.insert(case.seed, uavs);
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
        let mut table = format!("{key},strategy,seed,uavs\n");
        let axis = AxisType::of_values(self.over.iter().map(|setting| &setting.value));
        for fleet in fleets {
            for (seed, uavs) in &fleet.uavs {
                let value = fleet.value.as_ref().map_or_else(String::new, |value| axis.cell(value));
                let uavs = uavs.map_or_else(String::new, |uavs| uavs.to_string());
                table += &format!("{value},{},{seed},{uavs}\n", fleet.strategy);
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

    /// The mean number of UAVs over the key; more than the most count as one more.
    fn chart(&self, fleets: &[LeastFleets], key: &str, xs: &[f64]) -> Chart {
        let names: Vec<String> =
            fleets.iter().take(1 + self.strategies.len()).map(|fleet| fleet.strategy.clone()).collect();
        let styles = styles_of(&names[1..]);
        let number = |uavs: &Option<u32>| f64::from(uavs.unwrap_or(self.most + 1));
        let curve = |(place, name): (usize, &String)| {
            let own = fleets.iter().filter(|fleet| fleet.strategy == *name);
            let style = place.checked_sub(1).map_or(BEST_KNOWN_STYLE, |place| styles[place]);
            let points = own.map(|fleet| fleet.uavs.iter().map(|(seed, uavs)| (*seed, number(uavs))).collect());
            let label = if name == BOUND { "lower bound".to_owned() } else { name.clone() };
            CurveValues { label, style, reference: None, points: points.collect() }.means(xs, Support::NonNegative)
        };
        let description = format!("least fleet · loss rate at most {} · {} fields", self.loss_rate, self.seeds);
        Chart {
            look: Look { title: String::new(), footer: String::new(), description, width_mm: None },
            x_label: key.to_owned(),
            x_words: Vec::new(),
            y_label: format!("UAVs for a loss rate of at most {}", self.loss_rate),
            series: names.iter().enumerate().map(curve).collect(),
            support: Support::NonNegative,
            y_scale: Scale::Linear,
        }
    }
}
