//! `skysink optimize`: the best known flight of a mission, and bounds on the loss, the cost or the score of every
//! flight.
//!
//! The candidates are the plan of a long search before take-off (`offline`, with known queues) and the flights of all
//! strategies. The best one is written as a run.

use std::cmp::Ordering;
use std::iter;
use std::ops::ControlFlow;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;
use skysink_common::build::VERSION;
use skysink_common::error::InputError;
use skysink_common::loss_rate::fraction;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_planner::fleet::require_one;
use skysink_planner::settings::{Knowledge, Rates, Settings, change};
use skysink_planner::strategies::look_ahead::{self, MAX_STEPS, OfflineKeys, search_offline};
use skysink_planner::strategy::{OwnedSetup, Registered, Setup, Strategy};

use crate::error::LabError;
use crate::progress::{LabProgress, OnProgress};
use crate::unflown::UnflownFlights;
use skysink_mission::bounds::{MissionBounds, bounds, loss_rate};
use skysink_mission::meter::MissionMeter;
use skysink_mission::metrics::Metric;

/// Search steps of the trial that measures the speed of the search.
const TRIAL_STEPS: u64 = 100_000;

/// Minimum duration of the trial in the computation of the speed.
const MIN_TRIAL: Duration = Duration::from_millis(1);

/// Maximum search time [s].
const MAX_BUDGET_S: f64 = 1e6;

/// The budget of the search.
#[derive(Debug, Clone, Copy, PartialEq, Args)]
pub struct Budget {
    /// Search time in seconds, or with a unit, for example 500ms, 60s, 5m or 1h.
    #[arg(long = "budget", value_name = "TIME", default_value = "10s", value_parser = parse_time)]
    pub time: Duration,
    /// Number of search steps; replaces --budget.
    #[arg(long, value_name = "N", conflicts_with = "time", value_parser = clap::value_parser!(u64).range(..=MAX_STEPS))]
    pub steps: Option<u64>,
}

/// The result of the search, and the best known flight.
#[derive(Debug)]
pub struct BestKnown {
    /// Lower bound, best known loss, and the loss of every strategy.
    pub optimum: Optimum,
    /// The scenario of the best known flight.
    pub scenario: Scenario,
    /// The sensor nodes.
    pub list: SensorList,
    /// The flights whose plans were not flown as they were decided.
    pub unflown: Vec<UnflownFlights>,
    /// Duration of the search.
    pub took: Duration,
    /// The plan of `offline`, if it is the best flight.
    plan: Option<Vec<u8>>,
}

impl BestKnown {
    /// The best known flight, before slot 1.
    ///
    /// # Errors
    /// Never for the scenario of a search result.
    pub fn mission(&self) -> Result<Mission, InputError> {
        mission(&self.scenario, self.plan.as_deref(), &self.list)
    }
}

/// The loss of a strategy.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Standing {
    /// The strategy.
    pub strategy: &'static str,
    /// Its loss rate η.
    pub loss_rate: f64,
    /// Its weighted loss rate η_w (decision D25); only where weights differ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weighted_loss_rate: Option<f64>,
    /// What it costs by `planner.objective` (decision D36); only where that is not the loss.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objective: Option<f64>,
    /// Its score; only where no sensor node samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score: Option<f64>,
}

impl Standing {
    /// By which flights are compared: η, or η_w where weights differ, or the cost where the objective is not the loss.
    pub fn compared(&self) -> f64 {
        self.objective.or(self.weighted_loss_rate).unwrap_or(self.loss_rate)
    }

    /// Their order, the best first: by what is compared, and the higher score first of equals.
    fn order(&self, other: &Self) -> Ordering {
        let score = |standing: &Self| standing.score.unwrap_or(0.0);
        self.compared().total_cmp(&other.compared()).then(score(other).total_cmp(&score(self)))
    }
}

/// Why a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SearchEnd {
    /// The budget is used up.
    AllSteps,
    /// The best known flight reaches the lower bound, and is therefore optimal.
    Optimal,
    /// The plan is optimal in the model of the search, which has fractional bits and expected rates.
    ModelOptimal,
    /// No sensor node that can lose data can be reached in time.
    NothingInReach,
}

/// The result of the search, as in `optimum.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Optimum {
    /// Name of the scenario.
    pub name: String,
    /// Seed.
    pub seed: u64,
    /// Maximum number of search steps of `offline`.
    pub steps: u64,
    /// Search steps done.
    pub steps_done: u64,
    /// Why the search ended.
    pub search_end: SearchEnd,
    /// Lower bound of the loss rate η of every flight, even with all draws of the channel known in advance.
    pub loss_bound: f64,
    /// For a random channel: lower bound of the mean η over its draws, if they are not known in advance.
    pub expected_loss_bound: Option<f64>,
    /// Lower bound of the cost of every flight by `planner.objective`; only where that has one and is not the loss.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objective_bound: Option<f64>,
    /// Upper bound of the score of every flight; only where no sensor node samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score_bound: Option<f64>,
    /// The best of all strategies: of the least loss rate, weighted where weights differ, or of the least cost.
    pub best_known: Standing,
    /// All strategies, the best first.
    pub strategies: Vec<Standing>,
    /// Version of Skysink.
    pub version: &'static str,
}

/// Searches for the plan of `offline` and simulates every strategy. `scenarios` contains the mission once per strategy.
///
/// # Errors
/// If the sensor list is refused, or on a stop.
///
/// # Panics
/// If no scenario has the strategy `offline`.
pub fn optimize(
    scenarios: &[Scenario],
    budget: Budget,
    stop: &Stop,
    on_progress: OnProgress,
) -> Result<BestKnown, LabError> {
    let is_offline = |scenario: &&Scenario| scenario.planner.strategy == look_ahead::OFFLINE.name;
    let others = || scenarios.iter().filter(|scenario| !is_offline(scenario));
    let offline = scenarios.iter().find(is_offline).expect("the mission with every strategy");
    require_one(offline)?;
    let list = SensorList::of(offline)?;
    let steps = budget.steps.map_or_else(|| steps_in(budget.time, offline, &list, stop), Ok)?;
    let offline = with_search(offline, steps)?;
    let fly_others = || others().map(|scenario| standing(scenario, None, &list, stop)).collect();
    let (searched, took, flown) = std::thread::scope(|scope| {
        let flown = scope.spawn(fly_others);
        let begin = Instant::now();
        let searched = search(&offline, steps, &list, stop, on_progress);
        let took = begin.elapsed();
        let flown: Result<Vec<FlownStrategy>, LabError> = flown.join().expect("a flight does not panic");
        (searched, took, flown)
    });
    let SearchResult { plan, steps_done, end } = searched?;
    let mut flown = flown?;
    flown.insert(0, standing(&offline, plan.as_deref(), &list, stop)?); // stays first among equals
    flown.sort_by(|a, b| a.standing.order(&b.standing));
    let FlownStrategy { standing: best, lost_bits: known_bits, .. } = flown[0];
    let standings = flown.iter().map(|flown| flown.standing).collect();
    let unflown = flown.into_iter().filter_map(|flown| flown.unflown).collect();
    let MissionBounds { loss_bound, expected_loss_bound, objective_bound, score_bound } =
        bounds(&offline, &list, known_bits);
    let best_other = others().find(|scenario| scenario.planner.strategy == best.strategy);
    let scenario = best_other.unwrap_or(&offline).clone();
    let plan = plan.filter(|_| best_other.is_none());
    // A weighted loss has no bound.
    let reaches_loss_bound = best.weighted_loss_rate.is_none() && best.compared() <= loss_bound;
    let optimum = Optimum {
        name: offline.name.clone(),
        seed: offline.seed,
        steps,
        steps_done,
        search_end: match end {
            SearchEnd::ModelOptimal if objective_bound.map_or(reaches_loss_bound, |bound| best.compared() <= bound) => {
                SearchEnd::Optimal
            }
            end => end,
        },
        loss_bound,
        expected_loss_bound,
        objective_bound,
        score_bound,
        best_known: best,
        strategies: standings,
        version: VERSION,
    };
    Ok(BestKnown { optimum, scenario, list, unflown, took, plan })
}

/// The approximate number of search steps that this machine does in `time`, including the trial that measures it.
fn steps_in(time: Duration, offline: &Scenario, list: &SensorList, stop: &Stop) -> Result<u64, LabError> {
    let trial = with_search(offline, TRIAL_STEPS)?;
    let begin = Instant::now();
    let search_begin = OnceLock::new(); // after the initial plans have been made
    search(&trial, TRIAL_STEPS, list, stop, &|_| {
        search_begin.get_or_init(Instant::now);
    })?;
    let took = search_begin.get().map_or(Duration::ZERO, Instant::elapsed).max(MIN_TRIAL);
    let trials = time.saturating_sub(begin.elapsed()).as_secs_f64() / took.as_secs_f64();
    Ok(((TRIAL_STEPS as f64 * trials) as u64).clamp(TRIAL_STEPS, MAX_STEPS))
}

/// The mission with known queues and `steps` steps of the offline search.
fn with_search(offline: &Scenario, steps: u64) -> Result<Scenario, InputError> {
    let mut scenario = offline.clone();
    look_ahead::OFFLINE.set_keys(&mut scenario, OfflineKeys { steps });
    change(scenario, |settings| {
        settings.knowledge = Knowledge::Oracle;
        settings.rates = Rates::Known;
        settings.link = None;
    })
}

/// The result of the offline search.
struct SearchResult {
    /// The plan, as the checkpoint of the strategy before slot 1; `None` if no sensor node can be reached.
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
) -> Result<SearchResult, LabError> {
    let mut setup = OwnedSetup::new(offline.clone(), &list.nodes())?;
    setup.stop = stop.clone();
    let is_loss = setup.settings.objective.is_loss();
    let mut stopped = Ok(());
    let sampling = list.sampling(offline);
    let weights = list.weights(&sampling);
    let mean_bits = |id: usize| sampling.of(id).mean_bits * offline.slots as f64;
    let weighted_bits = (!weights.are_equal()).then(|| weights.sum((0..list.sensors().len()).map(mean_bits)));
    let sampled_bits = weighted_bits.unwrap_or_else(|| list.mission_bits(offline));
    let found = search_offline(&setup.setup(), &list.queues_bits(), stop, &mut |search| {
        let loss_rate = is_loss.then(|| fraction(search.cost, sampled_bits));
        on_progress(LabProgress { done: search.steps, of: steps, loss_rate, left: None });
        stopped = stop.check();
        if stopped.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    stopped?;
    let Some((planned, found)) = found else {
        return Ok(SearchResult { plan: None, steps_done: 0, end: SearchEnd::NothingInReach });
    };
    let mut plan = Vec::new();
    planned.save(&mut plan);
    let end = if found.is_optimal && found.steps < steps { SearchEnd::ModelOptimal } else { SearchEnd::AllSteps };
    Ok(SearchResult { plan: Some(plan), steps_done: found.steps, end })
}

/// The mission before slot 1, with the plan of `offline` if given.
fn mission(scenario: &Scenario, plan: Option<&[u8]>, list: &SensorList) -> Result<Mission, InputError> {
    let Some(plan) = plan else {
        return Mission::new(scenario, list);
    };
    let setup = OwnedSetup::new(scenario.clone(), &list.nodes())?;
    let mut planned = (look_ahead::OFFLINE.make)(&setup.setup());
    planned.restore(plan).expect("the plan of this mission");
    let mut planned = Some(planned);
    let mut make = |_: &Setup<'_>| -> Result<Box<dyn Strategy>, InputError> {
        Ok(planned.take().expect("the scenario has one UAV"))
    };
    Mission::by(scenario, list, &mut make, &Stop::default())
}

/// A strategy that was simulated.
struct FlownStrategy {
    standing: Standing,
    /// Its loss [bit].
    lost_bits: u64,
    unflown: Option<UnflownFlights>,
}

/// Simulates the strategy of a scenario.
fn standing(
    scenario: &Scenario,
    plan: Option<&[u8]>,
    list: &SensorList,
    stop: &Stop,
) -> Result<FlownStrategy, LabError> {
    let strategy = Registered::of(scenario)?.name;
    let mut mission = mission(scenario, plan, list)?;
    let mut meter = MissionMeter::new(scenario, list);
    mission.drive(&mut [&mut meter], stop)?.unless_stopped()?;
    let lost_bits = mission.plant().field().totals().lost_bits;
    let values = meter.values(mission.plant(), None, None);
    let value = |metric: Metric| Some(values[metric as usize]).filter(|value| !value.is_nan());
    let standing = Standing {
        strategy,
        loss_rate: loss_rate(lost_bits as f64, scenario, list),
        weighted_loss_rate: value(Metric::WeightedLossRate),
        objective: value(Metric::Objective)
            .filter(|_| !Settings::of(scenario).is_ok_and(|keys| keys.objective.is_loss())),
        score: value(Metric::Score),
    };
    let unflown = UnflownFlights::of(strategy, scenario, iter::once((scenario.seed, &values)));
    Ok(FlownStrategy { standing, lost_bits, unflown })
}

/// Parses a time with its unit; without a unit, in seconds.
fn parse_time(text: &str) -> Result<Duration, String> {
    let digits = text.trim_end_matches(|character: char| character.is_ascii_alphabetic());
    let unit_s = match &text[digits.len()..] {
        "ms" => 1e-3,
        "" | "s" => 1.0,
        "m" => 60.0,
        "h" => 3600.0,
        _ => f64::NAN,
    };
    let seconds = digits.parse().map_or(f64::NAN, |number: f64| number * unit_s);
    let is_allowed = seconds > 0.0 && seconds <= MAX_BUDGET_S;
    let expected = "expected a time above 0, such as 500ms, 60s, 5m or 1h, at most 1000000s; steps are --steps N";
    if is_allowed { Ok(Duration::from_secs_f64(seconds)) } else { Err(expected.to_owned()) }
}
