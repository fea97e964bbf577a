//! `horizon`: receding-horizon planning. Each slot it improves a plan for the rest of the mission and flies the first
//! slot of the plan.
//!
//! The search, by simulated annealing against a forecast of the loss, is left to [`crate::horizon`].

use std::ops::ControlFlow;
use std::time::Instant;

use nalgebra::Point3;
use skysink_common::checkpoint::{Checkpoint, CheckpointError};
use skysink_common::geometry::above;
use skysink_common::message::MAX_PATH_POINTS;

use super::collecting::Collecting;
use super::planned_flight::fly_slot;
use super::serving::Serving;
use crate::horizon::forecast::Forecast;
use crate::horizon::long_search::{SearchOutcome, SearchProgress};
use crate::horizon::{Horizon, HorizonKeys, planned_path};
use crate::keys::PlanningObjective;
use crate::neighbours::PlannedVisit;
use crate::strategy::{Decision, Registered, Setup, Strategy, View};

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("horizon", "receding horizon: a plan over many slots, improved in every slot", |setup| {
        let keys: HorizonKeys = setup.scenario.planner_keys("planner.horizon").expect("they were checked");
        match setup.settings.objective {
            PlanningObjective::Loss => Box::new(LookAhead::new(setup, keys)),
            PlanningObjective::Collect => {
                Box::new(Collecting::new(setup, keys, u64::from(keys.iterations) * FIRST_SEARCH))
            }
        }
    })
    .with_state()
    .with_path()
    .with_keys::<HorizonKeys>();

/// Steps of the first search for a plan that delivers most, divided by those of each later one.
const FIRST_SEARCH: u64 = 30;

/// End of the search, as a fraction of the budget; the rest is for the decision.
const SEARCH_END: f64 = 0.9;

/// The look-ahead strategy: a plan over many slots.
pub(crate) struct LookAhead {
    horizon: Horizon,
    serving: Serving,
    /// The planned waypoints after the last decided one.
    path: Vec<Point3<f64>>,
    /// For other UAVs: the last slot that was planned, and the visits of its plan.
    told: (u64, Vec<PlannedVisit>),
}

impl LookAhead {
    /// As [`Horizon::new`].
    pub fn new(setup: &Setup, keys: HorizonKeys) -> Self {
        Self {
            horizon: Horizon::new(setup, keys),
            serving: Serving::new(setup),
            path: Vec::with_capacity(MAX_PATH_POINTS),
            told: (0, Vec::new()),
        }
    }

    /// Searches the plan that [`LookAhead::follow`] flies from the slot of `view` on, in up to `steps` search steps.
    /// `watch` is called with the progress. `None`, without a plan, if no SN can lose data or `watch` ends the search.
    pub fn prepare(
        &mut self,
        view: &View,
        steps: u64,
        watch: &mut dyn FnMut(SearchProgress) -> ControlFlow<()>,
    ) -> Option<SearchOutcome> {
        let mut forecast = self.horizon.forecast(view)?;
        self.horizon.prepare(view, &mut forecast, steps, watch)
    }

    /// Decides the slot of `view` by the carried plan.
    pub fn follow(&mut self, view: &View) -> Option<Decision> {
        let mut forecast = self.horizon.forecast(view)?;
        self.horizon.search(view, &mut forecast, || true);
        self.decide(view, &forecast)
    }

    /// The first slot of the plan.
    fn decide(&mut self, view: &View, forecast: &Forecast) -> Option<Decision> {
        self.path.clear();
        if view.intents().is_some() {
            self.told = (view.slot, self.horizon.visits(view, forecast));
        }
        let model = &self.horizon.model;
        let decision = fly_slot(model, forecast, &mut self.serving, view)?;
        self.path.extend(planned_path(model, forecast).iter().map(|point| above(point, decision.waypoint.z)));
        Some(decision)
    }
}

impl Strategy for LookAhead {
    /// Improves the plan, and decides by it; `None` if no SN that can lose data is in reach.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        let budget = self.horizon.keys.budget(view).map(|budget| (Instant::now(), budget.mul_f64(SEARCH_END)));
        let is_over =
            || view.stop.requested().is_some() || budget.is_some_and(|(begin, budget)| begin.elapsed() >= budget);
        let mut forecast = self.horizon.forecast(view)?;
        self.horizon.search(view, &mut forecast, is_over);
        self.decide(view, &forecast)
    }

    fn path(&self) -> &[Point3<f64>] {
        &self.path
    }

    /// The visits of the carried plan, or of the one that was made for the slot of `view`.
    fn visits(&mut self, view: &View<'_>, into: &mut Vec<PlannedVisit>) {
        if self.told.0 == view.slot {
            into.extend_from_slice(&self.told.1);
        } else if self.horizon.has_plan()
            && let Some(forecast) = self.horizon.forecast(view)
        {
            into.extend(self.horizon.visits(view, &forecast));
        }
    }
}

impl Checkpoint for LookAhead {
    fn save(&self, bytes: &mut Vec<u8>) {
        self.horizon.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        self.horizon.restore(bytes)?;
        self.told = (0, Vec::new());
        Ok(())
    }
}
