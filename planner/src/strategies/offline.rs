//! `offline`: open-loop planning. One search before take-off plans the whole mission; the plan is flown without
//! changes.
//!
//! The search is that of [`horizon`](super::horizon), with more steps.

use std::ops::ControlFlow;

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::battery::BatteryState;
use skysink_common::belief::Believed;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode_first, encode};
use skysink_common::error::InputError;
use skysink_common::keys::Accepts;
use skysink_common::stop::Stop;

use super::collecting::{Collecting, LOSS_STEPS_PER_STEP};
use super::horizon::LookAhead;
use crate::horizon::HorizonKeys;
use crate::horizon::long_search::{SearchOutcome, SearchProgress};
use crate::keys::PlanningObjective;
use crate::neighbours::PlannedVisit;
use crate::strategy::{Decision, Registered, Setup, Strategy, Timing, View};

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("offline", "open loop: one plan for the whole mission, made before take-off", |setup| match setup
        .settings
        .objective
    {
        PlanningObjective::Loss => Box::new(Offline::new(setup).expect("its keys were checked")),
        PlanningObjective::Collect => {
            let OfflineKeys { steps } = setup.scenario.planner_keys("planner.offline").expect("they were checked");
            Box::new(Collecting::new(setup, open_loop(), steps.div_ceil(LOSS_STEPS_PER_STEP)))
        }
    })
    .with_state()
    .with_path()
    .with_keys::<OfflineKeys>();

/// Most search steps before the mission; they take a month.
pub const MAX_STEPS: u64 = 1_000_000_000_000;

skysink_common::keys! {
    /// `[planner.offline]`.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct OfflineKeys {
        /// Search steps before slot 1; a million take about two seconds.
        steps: u64 = 1000000, Accepts::Whole(0, MAX_STEPS);
    }
}

/// Longest planning window before take-off [slots].
const MOST_SLOTS: u64 = 10_000;

/// Those of a look-ahead that does not search after take-off.
fn open_loop() -> HorizonKeys {
    HorizonKeys { window: Some(MOST_SLOTS), ..HorizonKeys::of(0) }
}

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
    ///
    /// # Errors
    /// If a value of `[planner.offline]` is refused; never for a scenario that was resolved.
    pub fn new(setup: &Setup) -> Result<Self, InputError> {
        let OfflineKeys { steps } = setup.scenario.planner_keys("planner.offline")?;
        Ok(Self { ahead: LookAhead::new(setup, open_loop()), steps, is_planned: false })
    }

    /// Runs the search for a mission whose queues are known, `queues_bits` [bit] by id before slot 1; returns the
    /// strategy and what was found. Without this call the first slot runs it.
    ///
    /// `watch` is called with the progress. `None`, without a plan, if no sensor node can lose data or `watch` ends the
    /// search.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn search(
        setup: &Setup,
        queues_bits: &[u32],
        stop: &Stop,
        watch: &mut dyn FnMut(SearchProgress) -> ControlFlow<()>,
    ) -> Result<Option<(Self, SearchOutcome)>, InputError> {
        let mut offline = Self::new(setup)?;
        let Setup { scenario, table, .. } = *setup;
        let position = scenario.start();
        let view = View {
            slot: 1,
            position,
            battery: BatteryState::initial(scenario),
            belief: Believed::known(0, &table.sensors, queues_bits),
            table,
            timing: Timing::Free,
            neighbours: None,
            stop,
        };
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

    fn visits(&mut self, view: &View<'_>, into: &mut Vec<PlannedVisit>) {
        self.ahead.visits(view, into);
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
