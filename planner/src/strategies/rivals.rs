//! The other strategies of the registry, as candidates for the rest of a mission.
//!
//! A strategy that is rolled out and predicted to lose less than the plan of the look-ahead is followed, slot by slot,
//! until another candidate is better: parallel rollout (Chang, Givan and Chong, "Parallel Rollout for Online Solution
//! of Partially Observable Markov Decision Processes", Discrete Event Dynamic Systems 14, 2004).

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::CheckpointError;
use skysink_common::geometry::Position;

use super::hover;
use super::rollout::{Ahead, Effort, Rollout, is_certain};
use super::serving::Serving;
use crate::strategy::{Decision, OwnedSetup, Registered, Setup, Strategy, View};

/// Flights that are offered to the search as initial plans.
const OFFERED: usize = 3;

/// Approximate time of a rollout with several samples before the first slot [µs].
const SURVEYED_US: f64 = 10_000.0;

/// Approximate mean time of the rollouts per slot [µs]: if links, queues and rates are certain, and otherwise.
const COMPARED_US: [f64; 2] = [6_000.0, 30_000.0];

/// Fewest rollouts of a comparison: of the plan, of the followed strategy, and of another.
const COMPARED: f64 = 3.0;

/// Factor of the period of comparisons after one in which the plan lost nothing.
const LOSSLESS_PERIOD: f64 = 3.0;

/// The candidates of a mission.
pub(crate) struct Rivals {
    /// What they are made of.
    owned: OwnedSetup,
    /// Constructed on first use; `hover` is the last.
    made: Vec<Rival>,
    transit: Option<Serving>,
    /// The state for a checkpoint.
    pub choice: RivalChoice,
}

/// The state carried from slot to slot.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct RivalChoice {
    /// Whether all were rolled out once.
    pub is_surveyed: bool,
    /// The followed strategy and its state; `None` while the look-ahead's own plan is flown.
    pub followed: Option<(&'static Registered, Vec<u8>)>,
    /// Whether the plan lost nothing when it was last compared.
    is_lossless: bool,
    /// Index of the last candidate that was rolled out, below the number of strategies.
    turn: usize,
}

/// A strategy, and its state before it has planned anything.
struct Rival {
    registered: &'static Registered,
    strategy: Box<dyn Strategy>,
    fresh: Vec<u8>,
}

impl Rivals {
    pub fn new(setup: &Setup) -> Self {
        Self { owned: setup.to_owned(), made: Vec::new(), transit: None, choice: RivalChoice::default() }
    }

    /// Constructs the strategies that do not look ahead.
    fn make(&mut self) {
        if self.transit.is_some() {
            return;
        }
        let setup = self.owned.setup();
        let rival = |registered: &'static Registered| {
            let strategy = (registered.make)(&setup);
            let mut fresh = Vec::new();
            strategy.save(&mut fresh);
            Rival { registered, strategy, fresh }
        };
        let others = self.owned.strategies.iter().copied().filter(|other| !other.has_path);
        let (last, others): (Vec<_>, Vec<_>) = others.partition(is_hover);
        self.made = others.into_iter().chain(last).map(rival).collect();
        self.transit = Some(Serving::new(&setup));
    }

    /// Restores a saved state.
    ///
    /// # Errors
    /// If the followed strategy is not a candidate, or its state is impossible.
    pub fn restore(&mut self, choice: RivalChoice) -> Result<(), CheckpointError> {
        CheckpointError::ensure(choice.turn < self.owned.strategies.len(), "the turn of a strategy")?;
        if let Some((followed, state)) = &choice.followed {
            self.make();
            let rival = self.made.iter_mut().find(|rival| rival.registered == *followed);
            CheckpointError::ensure(rival.is_some(), "a strategy that does not look ahead")?;
            rival.map_or(Ok(()), |rival| rival.strategy.restore(state))?;
        }
        self.choice = choice;
        Ok(())
    }

    /// Rolls out all candidates over `ahead`; returns the best few, best first, with their flights in one sample, as
    /// initial plans. `hover` is one of them only if no other is better.
    pub fn survey(&mut self, view: &View, ahead: &Ahead, is_over: &dyn Fn() -> bool) -> Vec<Surveyed> {
        self.make();
        self.choice.is_surveyed = true;
        let Self { owned, made, transit, .. } = self;
        let futures = Effort::of(view, ahead.slots, SURVEYED_US).futures;
        let rollout = Rollout::new(view, owned.scenario.seed, ahead, futures);
        let transit = transit.as_mut().expect("it was made");
        let mut surveyed: Vec<Surveyed> = Vec::new();
        for (rival, Rival { registered, strategy, fresh }) in made.iter_mut().enumerate() {
            let mut flight = Vec::new();
            let watch = |slot: &Decision| flight.push((slot.waypoint.xy(), slot.schedule.to_vec()));
            let offered = if is_hover(registered) { 1 } else { OFFERED };
            let most_bits = surveyed.get(offered - 1).map_or(f64::INFINITY, |last| last.loss_bits);
            let strategy = strategy.as_mut();
            let is_better = |loss_bits: &f64| *loss_bits < most_bits || !is_hover(registered);
            let loss_bits = rollout.mean_loss_bits(strategy, Some(fresh), transit, most_bits, is_over, watch);
            if let Some(loss_bits) = loss_bits.filter(is_better) {
                surveyed.push(Surveyed { rival, loss_bits, flight });
                surveyed.sort_by(|a, b| a.loss_bits.total_cmp(&b.loss_bits));
                surveyed.truncate(OFFERED);
            }
        }
        surveyed
    }

    /// Chooses the strategy for the slot of `view`: the look-ahead's `own` plan, the followed strategy, the best one
    /// `surveyed`, or else the next candidates in turn. A plan without loss is always chosen. If the comparison
    /// `is_over` early, the choice does not change.
    pub fn choose(
        &mut self,
        view: &View,
        ahead: &Ahead,
        own: &mut dyn Strategy,
        surveyed: Option<&Surveyed>,
        is_over: &dyn Fn() -> bool,
    ) {
        self.make();
        let compared_us = compared_us(view);
        let most_us = if surveyed.is_some() { SURVEYED_US } else { compared_us / COMPARED };
        let effort = Effort::of(view, ahead.slots, most_us);
        let candidates = match surveyed {
            Some(best) => vec![(best.rival, self.made[best.rival].fresh.clone())],
            None => self.candidates((compared_us / effort.cost_us - (COMPARED - 1.0)).max(1.0) as usize),
        };
        let Self { owned, made, transit, choice } = self;
        let rollout = Rollout::new(view, owned.scenario.seed, ahead, effort.futures);
        let transit = transit.as_mut().expect("it was made");
        let Some(mut least_bits) = rollout.mean_loss_bits(own, None, transit, f64::INFINITY, is_over, |_| ()) else {
            return;
        };
        let mut best = None;
        choice.is_lossless = least_bits == 0.0;
        for (rival, state) in candidates {
            if least_bits == 0.0 {
                break;
            }
            let strategy = made[rival].strategy.as_mut();
            if let Some(loss_bits) =
                rollout.mean_loss_bits(strategy, Some(&state), transit, least_bits, is_over, |_| ())
                && loss_bits < least_bits
            {
                least_bits = loss_bits;
                best = Some((made[rival].registered, state));
            }
        }
        if !is_over() {
            choice.followed = best;
        }
    }

    /// The followed strategy with its state, the next `turns` candidates with their initial states, and `hover`. It has
    /// no turn, because the rollout of a fixed point that is worse ends early.
    fn candidates(&mut self, turns: usize) -> Vec<(usize, Vec<u8>)> {
        let Self { made, choice, .. } = self;
        let index = |followed| made.iter().position(|rival| rival.registered == followed).expect("it was made");
        let followed = choice.followed.iter().map(|(followed, state)| (index(*followed), state.clone()));
        let mut candidates: Vec<(usize, Vec<u8>)> = followed.collect();
        let others = made.partition_point(|rival| !is_hover(&rival.registered));
        for _ in 0..turns.min(others) {
            choice.turn = (choice.turn + 1) % others;
            candidates.push((choice.turn, made[choice.turn].fresh.clone()));
        }
        candidates.extend((others..made.len()).map(|hover| (hover, made[hover].fresh.clone())));
        candidates
    }

    /// Whether candidates are compared in the slot of `view`. The period keeps the mean cost per slot constant.
    pub fn is_due(&self, view: &View, ahead: &Ahead) -> bool {
        let compared_us = compared_us(view);
        let cost_us = COMPARED * Effort::of(view, ahead.slots, compared_us / COMPARED).cost_us;
        let seldom = if self.choice.is_lossless { LOSSLESS_PERIOD } else { 1.0 };
        let period_slots = (cost_us / compared_us).ceil() * seldom;
        view.slot.is_multiple_of(period_slots as u64)
    }

    /// The decision of the followed strategy.
    pub fn plan(&mut self, view: &View) -> Option<Decision> {
        let (followed, state) = self.choice.followed.as_mut()?;
        let strategy = &mut self.made.iter_mut().find(|rival| rival.registered == *followed)?.strategy;
        strategy.restore(state).expect("a state of its own");
        let decision = strategy.plan(view);
        state.clear();
        strategy.save(state);
        decision
    }
}

/// Whether this is the strategy `hover`, which is compared beside the turns of the others.
fn is_hover(strategy: &&Registered) -> bool {
    **strategy == hover::STRATEGY
}

/// Mean time of the rollouts per slot [µs].
fn compared_us(view: &View) -> f64 {
    COMPARED_US[usize::from(!is_certain(view))]
}

/// A strategy rolled out.
pub(crate) struct Surveyed {
    rival: usize,
    loss_bits: f64,
    /// Waypoint and schedule of each slot.
    pub flight: Vec<(Position, Vec<u32>)>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strategies::{STRATEGIES, horizon, max_age_first};
    use crate::strategy::tests::view;
    use skysink_common::checkpoint::encode;
    use skysink_common::message::SensorNode;
    use skysink_common::scenario::{Overrides, Scenario};

    /// The strategies that a survey of 60 slots keeps, best first, over SNs at `positions` [m] that fill in 10 slots.
    fn surveyed(positions: &[[f64; 2]]) -> Vec<&'static str> {
        let text = "name = 'a'\nslots = 60\n[area]\nside_m = 400.0\n[sensors]\ninitial_queue_mean_bits = 0.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("a.toml"), Overrides::default()).unwrap();
        let sensor = |&[x_m, y_m]: &[f64; 2]| SensorNode {
            x_m,
            y_m,
            gain: 1e-5,
            sampling_bps: 3_000.0,
            capacity_bits: 30_000,
            ..SensorNode::default()
        };
        let nodes: Vec<SensorNode> = positions.iter().map(sensor).collect();
        let owned = OwnedSetup::new(scenario, &nodes, STRATEGIES).unwrap();
        let queues_bits = vec![0; nodes.len()];
        let view = view(&owned.table, 1, [200.0, 200.0], &queues_bits);
        let mut rivals = Rivals::new(&owned.setup());
        let ahead = Ahead { slots: 60, beyond_slots: 0.0, round_slots: 10.0 };
        let surveyed = rivals.survey(&view, &ahead, &|| false);
        surveyed.iter().map(|surveyed| rivals.made[surveyed.rival].registered.name).collect()
    }

    #[test]
    fn hover_is_a_candidate_only_where_it_loses_least() {
        // A cluster that n = 4 can just serve in turns, one SN near the start that traps, and two that lead away.
        let cluster = (0..40).map(|index| [300.0 + f64::from(index % 8), 300.0 + f64::from(index / 8)]);
        let crowded: Vec<[f64; 2]> = cluster.chain([[205.0, 200.0], [20.0, 380.0], [380.0, 20.0]]).collect();
        assert_eq!(surveyed(&crowded)[0], "hover");
        let spread: Vec<[f64; 2]> =
            (0..16).map(|index| [f64::from(index % 4), f64::from(index / 4)].map(|step| 170.0 + 20.0 * step)).collect();
        assert!(!surveyed(&spread).contains(&"hover"));
    }

    #[test]
    fn a_choice_of_another_mission_is_refused() {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let sensors = vec![SensorNode { x_m: 50.0, y_m: 50.0, gain: 1e-5, ..SensorNode::default() }; 2];
        let owned = OwnedSetup::new(scenario, &sensors, STRATEGIES).unwrap();
        let setup = owned.setup();
        let ages = |count: usize| {
            let mut state = Vec::new();
            encode(&vec![7u32; count], &mut state);
            state
        };
        let follow = |followed, state| RivalChoice { followed: Some((followed, state)), ..RivalChoice::default() };
        for choice in [
            follow(&max_age_first::STRATEGY, ages(3)), // of three SNs
            follow(&horizon::STRATEGY, Vec::new()),    // looks ahead itself
            RivalChoice { turn: usize::MAX, ..RivalChoice::default() },
        ] {
            let mut rivals = Rivals::new(&setup);
            assert!(rivals.restore(choice).is_err());
            assert_eq!(rivals.choice, RivalChoice::default());
        }
        let mut rivals = Rivals::new(&setup);
        rivals.restore(follow(&max_age_first::STRATEGY, ages(2))).unwrap();
        assert!(rivals.choice.followed.is_some());
    }
}
