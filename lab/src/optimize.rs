//! `skysink optimize`: the best flight that is known of a mission, beside the loss that no flight avoids.
//!
//! The candidates are the plan that a long search finds before take-off (`offline`), knowing the queues, and what every
//! strategy flies; the best is left as a run folder.

use std::ops::ControlFlow;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::error::InputError;
use skysink_common::scenario::{Count, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_planner::bound::{MissionBound, mission_bound};
use skysink_planner::settings::{Knowledge, Rates, change};
use skysink_planner::strategies::Registered;
use skysink_planner::strategies::offline::{self, Offline, OfflineKeys};

use crate::error::LabError;
use crate::progress::{LabProgress, OnProgress, SweepNumber};

/// Steps by which the speed of the search is measured.
const TRIAL_STEPS: u64 = 100_000;

/// Least time that a trial counts for: one that ends at once tells nothing of the speed.
const LEAST_TRIAL: Duration = Duration::from_millis(1);

/// Most search steps, as in scenarios.
pub const MAX_STEPS: u64 = 1_000_000_000_000;

/// How long the search may take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Budget {
    /// Search steps: the result is the same everywhere.
    Steps(u64),
    /// Time of this machine, turned into steps by a trial.
    Time(Duration),
}

/// What an optimisation comes to, and the flight that is the best known.
#[derive(Debug)]
pub struct BestKnown {
    /// Bound, best known, and every strategy.
    pub optimum: Optimum,
    /// The scenario of the best known flight.
    pub scenario: Scenario,
    /// The sensor nodes.
    pub list: SensorList,
    /// How long the search took.
    pub took: Duration,
    /// The plan of `offline`, if it is the best.
    plan: Option<Vec<u8>>,
}

impl BestKnown {
    /// The best known flight, before slot 1.
    ///
    /// # Errors
    /// Never for the scenario that was found.
    pub fn mission(&self) -> Result<Mission, InputError> {
        mission(&self.scenario, self.plan.as_deref(), &self.list)
    }
}

/// What a strategy loses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Standing {
    /// The strategy.
    pub strategy: &'static str,
    /// Its loss rate η.
    pub loss_rate: f64,
}

/// Why a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SearchEnd {
    /// All steps are done.
    AllSteps,
    /// The best known flight loses no more than the bound: none can be better.
    Optimal,
    /// Its plan loses no more than any plan in the search's own model of the mission, which has links at their expected
    /// rates.
    ModelOptimal,
    /// No sensor node that can lose data can be reached in time: there is nothing to search.
    NothingInReach,
}

/// What an optimisation comes to, as in `optimum.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Optimum {
    /// Name of the scenario.
    pub name: String,
    /// Seed.
    pub seed: u64,
    /// Most search steps of `offline`.
    pub steps: u64,
    /// Those of them that were done.
    pub steps_done: u64,
    /// Why the search ended.
    pub search_end: SearchEnd,
    /// Loss rate η that no flight avoids, even of somebody who knows every draw of the channel.
    pub loss_bound: f64,
    /// Where the channel is random: the mean of η over its draws that nobody avoids who does not know them in advance.
    pub expected_loss_bound: Option<f64>,
    /// The least loss rate of all strategies.
    pub best_known: Standing,
    /// All strategies, the least loss first.
    pub strategies: Vec<Standing>,
    /// Version of Skysink.
    pub version: &'static str,
}

/// Lower bounds on the loss rate η of a mission (`docs/src/look-ahead.md`); 0 where nothing is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LossBounds {
    /// Of every flight.
    pub loss_bound: f64,
    /// Of the mean over the draws of the channel, where it is random.
    pub expected_loss_bound: Option<f64>,
}

/// The bounds of a mission of which some flight loses `known_bits` [bit].
#[must_use]
pub fn loss_bounds(scenario: &Scenario, list: &SensorList, known_bits: u64) -> LossBounds {
    let MissionBound { loss_bits, expected_loss_bits } =
        mission_bound(scenario, &list.nodes(), &list.queues_bits(), known_bits);
    LossBounds {
        loss_bound: loss_rate(loss_bits as f64, scenario, list),
        expected_loss_bound: expected_loss_bits.map(|bits| loss_rate(bits, scenario, list)),
    }
}

/// Searches for the plan of `offline`, and flies every strategy. `scenarios` are the mission by each of them. A stop
/// leaves nothing.
///
/// # Errors
/// If the sensor list is refused, or on a stop.
///
/// # Panics
/// If no scenario is by `offline`.
pub fn optimize(
    scenarios: &[Scenario],
    budget: Budget,
    stop: &Stop,
    on_progress: OnProgress,
) -> Result<BestKnown, LabError> {
    let is_offline = |scenario: &&Scenario| scenario.planner.strategy == offline::STRATEGY.name;
    let rivals = || scenarios.iter().filter(|scenario| !is_offline(scenario));
    let offline = scenarios.iter().find(is_offline).expect("the mission by every strategy");
    let list = SensorList::of(offline)?;
    let steps = match budget {
        Budget::Steps(steps) => steps,
        Budget::Time(time) => steps_in(time, offline, &list, stop)?,
    };
    let offline = searching(offline, steps)?;
    let fly_rivals = || rivals().map(|scenario| standing(scenario, None, &list, stop)).collect();
    let (searched, took, flown) = std::thread::scope(|scope| {
        let flown = scope.spawn(fly_rivals);
        let begin = Instant::now();
        let searched = search(&offline, steps, &list, stop, on_progress);
        let took = begin.elapsed();
        let flown: Result<Vec<(Standing, u64)>, LabError> = flown.join().expect("a flight does not panic");
        (searched, took, flown)
    });
    let Searched { plan, steps_done, end } = searched?;
    let mut flown = flown?;
    flown.insert(0, standing(&offline, plan.as_deref(), &list, stop)?); // the first of equals
    flown.sort_by_key(|(_, lost_bits)| *lost_bits);
    let (best, known_bits) = flown[0];
    let standings = flown.into_iter().map(|(standing, _)| standing).collect();
    let LossBounds { loss_bound, expected_loss_bound } = loss_bounds(&offline, &list, known_bits);
    let best_rival = rivals().find(|scenario| scenario.planner.strategy == best.strategy);
    let scenario = best_rival.unwrap_or(&offline).clone();
    let plan = plan.filter(|_| best_rival.is_none());
    let optimum = Optimum {
        name: offline.name.clone(),
        seed: offline.seed,
        steps,
        steps_done,
        search_end: match end {
            SearchEnd::ModelOptimal if best.loss_rate <= loss_bound => SearchEnd::Optimal,
            end => end,
        },
        loss_bound,
        expected_loss_bound,
        best_known: best,
        strategies: standings,
        version: env!("CARGO_PKG_VERSION"),
    };
    Ok(BestKnown { optimum, scenario, list, took, plan })
}

/// About as many steps as this machine takes in `time`, by a trial, which is part of it.
fn steps_in(time: Duration, offline: &Scenario, list: &SensorList, stop: &Stop) -> Result<u64, LabError> {
    let trial = searching(offline, TRIAL_STEPS)?;
    let begin = Instant::now();
    let searching = OnceLock::new(); // before that the plans to start from are made
    search(&trial, TRIAL_STEPS, list, stop, &|_| {
        searching.get_or_init(Instant::now);
    })?;
    let took = searching.get().map_or(Duration::ZERO, Instant::elapsed).max(LEAST_TRIAL);
    let trials = time.saturating_sub(begin.elapsed()).as_secs_f64() / took.as_secs_f64();
    Ok(((TRIAL_STEPS as f64 * trials) as u64).clamp(TRIAL_STEPS, MAX_STEPS))
}

/// The mission with an offline search of `steps` steps that knows the queues.
fn searching(offline: &Scenario, steps: u64) -> Result<Scenario, InputError> {
    let mut scenario = offline.clone();
    offline::STRATEGY.set_keys(&mut scenario, OfflineKeys { steps: Count::clamped(steps) });
    change(scenario, |settings| {
        settings.knowledge = Knowledge::Oracle;
        settings.rates = Rates::Known;
    })
}

/// What a search comes to.
struct Searched {
    /// The plan of `offline`, as the checkpoint of the strategy before slot 1; none if no sensor node can be reached.
    plan: Option<Vec<u8>>,
    steps_done: u64,
    end: SearchEnd,
}

/// Searches for the plan of `offline`.
fn search(
    offline: &Scenario,
    steps: u64,
    list: &SensorList,
    stop: &Stop,
    on_progress: OnProgress,
) -> Result<Searched, LabError> {
    let nodes = list.nodes();
    let mut stopped = Ok(());
    let found = Offline::search(offline, &nodes, &list.queues_bits(), stop, &mut |search| {
        let loss_rate = Some(loss_rate(search.loss_bits, offline, list));
        on_progress(LabProgress { done: search.steps, of: steps, loss_rate, left: None, sweep: SweepNumber::ONLY });
        stopped = stop.check();
        if stopped.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    stopped?;
    let Some((planned, found)) = found? else {
        return Ok(Searched { plan: None, steps_done: 0, end: SearchEnd::NothingInReach });
    };
    let mut plan = Vec::new();
    planned.save(&mut plan);
    let end = if found.is_optimal && found.steps < steps { SearchEnd::ModelOptimal } else { SearchEnd::AllSteps };
    Ok(Searched { plan: Some(plan), steps_done: found.steps, end })
}

/// The mission before slot 1, with the plan of `offline` if there is one.
fn mission(scenario: &Scenario, plan: Option<&[u8]>, list: &SensorList) -> Result<Mission, InputError> {
    let Some(plan) = plan else {
        return Mission::new(scenario, list);
    };
    let mut planned = Offline::of(scenario, &list.nodes())?;
    planned.restore(plan).expect("the plan of this very mission");
    Mission::with_strategy(scenario, list, Box::new(planned))
}

/// What the strategy of a scenario loses, as a loss rate and in bits.
fn standing(
    scenario: &Scenario,
    plan: Option<&[u8]>,
    list: &SensorList,
    stop: &Stop,
) -> Result<(Standing, u64), LabError> {
    let strategy = Registered::of(scenario)?.name;
    let mut mission = mission(scenario, plan, list)?;
    mission.set_stop(stop);
    let lost_bits = mission.by_ref().last().map_or(0, |flown| flown.header.totals.lost_bits);
    stop.check()?;
    Ok((Standing { strategy, loss_rate: loss_rate(lost_bits as f64, scenario, list) }, lost_bits))
}

/// A loss [bit] as the fraction of what the mission samples (decision D3); 0 where nothing is sampled.
fn loss_rate(lost_bits: f64, scenario: &Scenario, list: &SensorList) -> f64 {
    let sampled_bps: f64 = list.sensors().iter().map(|sensor| sensor.sampling_bps).sum();
    let sampled_bits = sampled_bps * scenario.slot_s * scenario.slots as f64;
    if sampled_bits > 0.0 { lost_bits / sampled_bits } else { 0.0 }
}
