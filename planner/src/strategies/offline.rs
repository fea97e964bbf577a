//! `offline`: open-loop planning. One search before take-off plans the whole mission; the plan is flown without
//! changes.
//!
//! The search is that of [`horizon`](super::horizon), with more steps.

use std::ops::ControlFlow;

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode_first, encode};
use skysink_common::error::InputError;
use skysink_common::message::SensorNode;
use skysink_common::scenario::{Count, Scenario};
use skysink_common::stop::Stop;

use super::horizon::LookAhead;
use super::{Decision, Registered, Setup, Strategy, Timing, View, checked};
use crate::horizon::long_search::{SearchOutcome, SearchProgress};
use crate::keys::Settings;
use crate::sensor_table::SensorTable;

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered {
    name: "offline",
    about: "open loop: one plan for the whole mission, made before take-off",
    is_stateless: false,
    has_path: true,
    keys: Some(checked::<OfflineKeys>),
    make: |setup| Box::new(Offline::new(setup).expect("its keys were checked")),
};

/// `[planner.offline]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OfflineKeys {
    /// Search steps before the mission; the most take a month.
    pub steps: Count<0, 1_000_000_000_000>,
}

impl Default for OfflineKeys {
    fn default() -> Self {
        Self { steps: Count::of::<1_000_000>() }
    }
}

/// Longest planning window before take-off [slots].
const MOST_SLOTS: u64 = 10_000;

/// The plan of a mission.
pub struct Offline {
    ahead: LookAhead,
    /// Search steps for the plan.
    steps: u64,
    /// Whether the plan is made.
    is_planned: bool,
}

impl Offline {
    /// The strategy before its search.
    fn new(setup: &Setup) -> Result<Self, InputError> {
        let OfflineKeys { steps } = setup.scenario.planner_keys("planner.offline")?;
        Ok(Self { ahead: LookAhead::new(setup, MOST_SLOTS, 0, None), steps: steps.get(), is_planned: false })
    }

    /// The strategy before its search, of a mission whose queues are known.
    ///
    /// # Errors
    /// If a value of `[planner]` is refused; never for a scenario that was resolved.
    pub fn of(scenario: &Scenario, sensors: &[SensorNode]) -> Result<Self, InputError> {
        let settings = &Settings::of(scenario)?;
        let table = &SensorTable::new(scenario, sensors);
        Self::new(&Setup { scenario, settings, sensors, table, estimate: None })
    }

    /// Runs the search for a mission whose queues are known, `queues_bits` [bit] by id before slot 1; returns the
    /// strategy and what was found. Without this call the first slot runs it.
    ///
    /// `watch` is called with the progress. `None`, without a plan, if no sensor node can lose data or `watch` ends the
    /// search. `stop` ends the rollouts before and after the search.
    ///
    /// # Errors
    /// If a value of `[planner]` is refused; never for a scenario that was resolved.
    pub fn search(
        scenario: &Scenario,
        sensors: &[SensorNode],
        queues_bits: &[u32],
        stop: &Stop,
        watch: &mut dyn FnMut(SearchProgress) -> ControlFlow<()>,
    ) -> Result<Option<(Self, SearchOutcome)>, InputError> {
        let table = &SensorTable::new(scenario, sensors);
        let mut offline = Self::of(scenario, sensors)?;
        let position = scenario.start();
        let view = View { slot: 1, position, queues_bits, estimate: None, table, timing: Timing::Free, stop };
        Ok(offline.prepare(&view, watch).map(|found| (offline, found)))
    }

    /// Runs the search from `view` on.
    fn prepare(
        &mut self,
        view: &View,
        watch: &mut dyn FnMut(SearchProgress) -> ControlFlow<()>,
    ) -> Option<SearchOutcome> {
        let found = self.ahead.prepare(view, self.steps, watch)?;
        self.is_planned = true;
        Some(found)
    }
}

impl Strategy for Offline {
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        if !self.is_planned {
            self.prepare(view, &mut |_| match view.stop.requested() {
                Some(_) => ControlFlow::Break(()),
                None => ControlFlow::Continue(()),
            })?;
        }
        self.ahead.follow(view)
    }

    fn path(&self) -> &[Point3<f64>] {
        self.ahead.path()
    }
}

impl Checkpoint for Offline {
    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&self.is_planned, bytes);
        self.ahead.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let (is_planned, ahead) = decode_first(bytes)?;
        self.ahead.restore(ahead)?;
        self.is_planned = is_planned;
        Ok(())
    }
}
