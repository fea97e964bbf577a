//! The other strategies of the registry, as candidates for the rest of a mission.
//!
//! A strategy that is rolled out and predicted to lose less than the plan of the look-ahead is followed, slot by slot,
//! until another candidate is better: parallel rollout (Chang, Givan and Chong, "Parallel Rollout for Online Solution
//! of Partially Observable Markov Decision Processes", Discrete Event Dynamic Systems 14, 2004).

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::CheckpointError;
use skysink_common::geometry::Position;
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;

use super::rollout::{Ahead, Effort, FlownSlot, Rollout, is_certain};
use super::serving::Serving;
use super::{Decision, STRATEGIES, Setup, Strategy, View};
use crate::keys::Settings;
use crate::sensor_table::SensorTable;

/// Flights that are offered to the search as plans to start from.
const OFFERED: usize = 3;

/// Most that the futures of a rollout take together before the first slot [µs], about, where there are several.
const SURVEYED_US: f64 = 10_000.0;

/// What rollouts may take in a slot on average [µs], about: where all is known, and else.
const COMPARED_US: [f64; 2] = [6_000.0, 30_000.0];

/// Rollouts in a slot at least: of the plan, of the strategy that is followed, and of another.
const COMPARED: f64 = 3.0;

/// The candidates of a mission.
pub(super) struct Rivals {
    scenario: Scenario,
    sensors: Vec<SensorNode>,
    /// Made when they are first asked for.
    made: Vec<Rival>,
    transit: Option<Serving>,
    choice: RivalChoice,
}

/// What is carried from slot to slot.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct RivalChoice {
    /// Which one is followed, and its state; none while the look-ahead's own plan is flown.
    followed: Option<(usize, Vec<u8>)>,
    /// Which one is rolled out next.
    turn: usize,
}

/// A strategy, and its state before it has planned anything.
struct Rival {
    strategy: Box<dyn Strategy>,
    fresh: Vec<u8>,
}

impl Rivals {
    pub fn new(setup: &Setup) -> Self {
        Self {
            scenario: setup.scenario.clone(),
            sensors: setup.sensors.to_vec(),
            made: Vec::new(),
            transit: None,
            choice: RivalChoice::default(),
        }
    }

    /// Makes the strategies that do not look ahead.
    fn make(&mut self) {
        if self.transit.is_some() {
            return;
        }
        let settings = Settings::of(&self.scenario).expect("its keys were checked");
        let table = SensorTable::new(&self.scenario, &self.sensors);
        let Self { scenario, sensors, .. } = self;
        let setup = Setup { scenario, settings: &settings, sensors, table: &table, estimate: None };
        let rival = |make: fn(&Setup<'_>) -> Box<dyn Strategy>| {
            let strategy = make(&setup);
            let mut fresh = Vec::new();
            strategy.save(&mut fresh);
            Rival { strategy, fresh }
        };
        self.made = STRATEGIES.iter().filter(|other| !other.has_path).map(|other| rival(other.make)).collect();
        self.transit = Some(Serving::new(&setup));
    }

    /// What is to be saved.
    pub fn choice(&self) -> &RivalChoice {
        &self.choice
    }

    /// Restores what was saved.
    ///
    /// # Errors
    /// If it follows nobody known, or in a state that cannot be.
    pub fn restore(&mut self, choice: RivalChoice) -> Result<(), CheckpointError> {
        if let Some((index, state)) = &choice.followed {
            self.make();
            let rival = self.made.get_mut(*index);
            CheckpointError::unless(rival.is_some(), "a strategy of the registry")?;
            rival.map_or(Ok(()), |rival| rival.strategy.restore(state))?;
        }
        self.choice = choice;
        Ok(())
    }

    /// No longer follows anybody.
    pub fn leave(&mut self) {
        self.choice.followed = None;
    }

    /// Rolls out all of them over `ahead`; the best few, the best first, with their flights in one future, to start
    /// plans from.
    pub fn survey(&mut self, view: &View, ahead: &Ahead, is_over: &dyn Fn() -> bool) -> Vec<Surveyed> {
        self.make();
        let Self { scenario, sensors, made, transit, .. } = self;
        let futures = Effort::of(view, ahead.slots, SURVEYED_US).futures;
        let rollout = Rollout::new(view, scenario, sensors, ahead, futures);
        let transit = transit.as_mut().expect("it was made");
        let mut surveyed: Vec<Surveyed> = Vec::new();
        for (rival, Rival { strategy, fresh }) in made.iter_mut().enumerate() {
            let reset = |strategy: &mut dyn Strategy| strategy.restore(fresh).expect("a state of its own");
            let mut flight = Vec::new();
            let watch = |slot: FlownSlot| flight.push((slot.waypoint.xy(), slot.ids.to_vec()));
            let most_bits = surveyed.get(OFFERED - 1).map_or(f64::INFINITY, |last| last.loss_bits);
            let strategy = strategy.as_mut();
            if let Some(loss_bits) = rollout.mean_loss_bits(strategy, reset, transit, most_bits, is_over, watch) {
                surveyed.push(Surveyed { rival, loss_bits, flight });
                surveyed.sort_by(|a, b| a.loss_bits.total_cmp(&b.loss_bits));
                surveyed.truncate(OFFERED);
            }
        }
        surveyed
    }

    /// Chooses who flies the slot of `view`: the look-ahead's `own` plan, who was followed before, the best of those
    /// `surveyed`, or whose turn it is to be compared. Where the plan loses nothing, that is flown.
    pub fn choose(
        &mut self,
        view: &View,
        ahead: &Ahead,
        own: &mut dyn Strategy,
        surveyed: Option<&Surveyed>,
        is_over: &dyn Fn() -> bool,
    ) {
        self.make();
        let Self { scenario, sensors, made, transit, choice } = self;
        let compared_us = compared_us(view);
        let most_us = if surveyed.is_some() { SURVEYED_US } else { compared_us / COMPARED };
        let effort = Effort::of(view, ahead.slots, most_us);
        let rollout = Rollout::new(view, scenario, sensors, ahead, effort.futures);
        let transit = transit.as_mut().expect("it was made");
        let Some(mut least_bits) = rollout.mean_loss_bits(own, |_| (), transit, f64::INFINITY, is_over, |_| ()) else {
            return;
        };
        let mut best = None;
        if least_bits > 0.0 {
            if let Some((rival, state)) = choice.followed.take() {
                let reset = |strategy: &mut dyn Strategy| strategy.restore(&state).expect("a state of its own");
                let strategy = made[rival].strategy.as_mut();
                if let Some(loss_bits) = rollout.mean_loss_bits(strategy, reset, transit, least_bits, is_over, |_| ())
                    && loss_bits < least_bits
                {
                    least_bits = loss_bits;
                    best = Some((rival, state));
                }
            }
            if let Some(Surveyed { rival, loss_bits, .. }) = surveyed {
                if *loss_bits < least_bits {
                    best = Some((*rival, made[*rival].fresh.clone()));
                }
            } else {
                let compared = (compared_us / effort.cost_us - 2.0).clamp(1.0, made.len() as f64) as usize;
                for _ in 0..compared {
                    choice.turn = (choice.turn + 1) % made.len();
                    let Rival { strategy, fresh } = &mut made[choice.turn];
                    let reset = |strategy: &mut dyn Strategy| strategy.restore(fresh).expect("a state of its own");
                    let strategy = strategy.as_mut();
                    if let Some(loss_bits) =
                        rollout.mean_loss_bits(strategy, reset, transit, least_bits, is_over, |_| ())
                        && loss_bits < least_bits
                    {
                        least_bits = loss_bits;
                        best = Some((choice.turn, fresh.clone()));
                    }
                }
            }
        }
        choice.followed = best;
    }

    /// Whether candidates are compared in the slot of `view`: so seldom that rollouts cost about as much in every slot.
    pub fn is_due(&self, view: &View, ahead: &Ahead) -> bool {
        let compared_us = compared_us(view);
        let cost_us = COMPARED * Effort::of(view, ahead.slots, compared_us / COMPARED).cost_us;
        let period_slots = (cost_us / compared_us).ceil();
        view.slot.is_multiple_of(period_slots as u64)
    }

    /// Whether one of them flies the next slot.
    pub fn is_following(&self) -> bool {
        self.choice.followed.is_some()
    }

    /// The decision of the one that is followed.
    pub fn plan(&mut self, view: &View) -> Option<Decision> {
        let (rival, state) = self.choice.followed.as_mut()?;
        let strategy = &mut self.made[*rival].strategy;
        strategy.restore(state).expect("a state of its own");
        let decision = strategy.plan(view);
        state.clear();
        strategy.save(state);
        decision
    }
}

/// What rollouts may take in a slot on average [µs].
fn compared_us(view: &View) -> f64 {
    COMPARED_US[usize::from(!is_certain(view))]
}

/// A strategy rolled out.
pub(super) struct Surveyed {
    rival: usize,
    loss_bits: f64,
    /// Where its slots end, and whom they serve.
    pub flight: Vec<(Position, Vec<u32>)>,
}
