//! `horizon`: receding-horizon planning. A plan over many slots is improved in every slot, and its first slot is flown.
//!
//! The search, simulated annealing against a forecast of the loss, is left to [`crate::horizon`]. In some slots the
//! plan is compared with the other strategies by rollout, and one that is predicted to lose less is followed instead.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use nalgebra::Point3;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode_first, encode};
use skysink_common::geometry::above;
use skysink_common::message::MAX_PATH_POINTS;

use super::collecting::Collecting;
use super::planned_flight::planned_flight;
use super::rivals::{Rivals, Surveyed};
use super::rollout::{Ahead, Effort, is_certain};
use super::serving::Serving;
use crate::horizon::forecast::{Forecast, PlanningWindow};
use crate::horizon::long_search::{SearchOutcome, SearchProgress};
use crate::horizon::{Horizon, HorizonKeys, LookAheadPart, planned_path};
use crate::keys::PlanningObjective;
use crate::strategy::{Decision, PlannedVisit, Registered, Setup, Strategy, View};

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

/// Steps of the search before the mission, divided by the steps of each search that compares initial plans.
const COMPARED_STEPS: u64 = 100;

/// End of the rollouts before the first search, as a fraction of the budget.
const SURVEY_END: f64 = 0.3;

/// End of the search, as a fraction of the budget; the rest is for the comparison.
const SEARCH_END: f64 = 0.7;

/// The look-ahead strategy: a plan over many slots, and the other strategies as alternatives.
pub(crate) struct LookAhead {
    horizon: Horizon,
    rivals: Rivals,
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
            rivals: Rivals::new(setup),
            serving: Serving::new(setup),
            path: Vec::with_capacity(MAX_PATH_POINTS),
            told: (0, Vec::new()),
        }
    }

    /// The visits of the carried plan, or of the one that was made for the slot of `view`; none while another strategy
    /// is flown.
    pub fn visits(&mut self, view: &View, into: &mut Vec<PlannedVisit>) {
        if self.rivals.choice.followed.is_some() {
            return;
        }
        if self.told.0 == view.slot {
            into.extend_from_slice(&self.told.1);
        } else if !self.horizon.carried.is_empty()
            && let Some(forecast) = self.horizon.forecast(view)
        {
            into.extend(self.horizon.visits(view, &forecast));
        }
    }

    /// Searches the plan that [`LookAhead::follow`] flies from the slot of `view` on, in up to `steps` search steps, or
    /// chooses another strategy. `watch` is called with the progress. `None`, without a plan, if no SN can lose data or
    /// `watch` ends the search.
    pub fn prepare(
        &mut self,
        view: &View,
        steps: u64,
        watch: &mut dyn FnMut(SearchProgress) -> ControlFlow<()>,
    ) -> Option<SearchOutcome> {
        let is_over = || view.stop.requested().is_some();
        let mut forecast = self.horizon.forecast(view)?;
        let compared_steps = u32::try_from(steps / COMPARED_STEPS).unwrap_or(u32::MAX); // enough to compare by
        let surveyed = self.survey(view, &mut forecast, compared_steps, &is_over);
        let found = self.horizon.prepare(view, &mut forecast, steps, watch)?;
        self.compare(view, &forecast, surveyed.as_ref(), &is_over);
        Some(found)
    }

    /// Decides the slot of `view` by the carried plan or strategy.
    pub fn follow(&mut self, view: &View) -> Option<Decision> {
        let mut forecast = self.horizon.forecast(view)?;
        self.horizon.search(view, &mut forecast, || true);
        self.decide(view, &forecast)
    }

    /// Whether strategies are rolled out: not if the plan is known to be optimal, because its loss equals the lower
    /// bound, and links and queues are certain; nor in missions of too many SNs and slots, or if they are left out.
    fn has_rollouts(&self, view: &View, forecast: &Forecast) -> bool {
        if self.horizon.keys.without == Some(LookAheadPart::Rollouts) {
            return false;
        }
        let is_settled = view.table.home.is_none() && is_certain(view) && self.horizon.is_optimal(forecast);
        !is_settled && Effort::of(view, self.ahead(forecast).slots, 0.0).is_affordable
    }

    fn ahead(&self, forecast: &Forecast) -> Ahead {
        let PlanningWindow { slots, beyond_slots, .. } = forecast.window;
        Ahead { slots: slots as u64, beyond_slots, round_slots: self.horizon.model.round_slots }
    }

    /// Rolls out the other strategies, offers the best flights as initial plans, which are compared after searches of
    /// `steps` steps, and returns the best strategy.
    fn survey(
        &mut self,
        view: &View,
        forecast: &mut Forecast,
        steps: u32,
        is_over: &dyn Fn() -> bool,
    ) -> Option<Surveyed> {
        if !self.has_rollouts(view, forecast) {
            return None;
        }
        let surveyed = self.rivals.survey(view, &self.ahead(forecast), is_over);
        if self.horizon.keys.without != Some(LookAheadPart::Offers) {
            let flights = surveyed.iter().map(|rival| &rival.flight[..]);
            self.horizon.offer(view, forecast, flights, steps, is_over);
        }
        surveyed.into_iter().next()
    }

    /// Chooses between the plan and the other strategies; `surveyed` is the best of them after a survey.
    fn compare(&mut self, view: &View, forecast: &Forecast, surveyed: Option<&Surveyed>, is_over: &dyn Fn() -> bool) {
        if !self.has_rollouts(view, forecast) {
            self.rivals.choice.followed = None;
            return;
        }
        let ahead = self.ahead(forecast);
        if surveyed.is_some() || self.rivals.is_due(view, &ahead) {
            let Self { horizon, rivals, serving, .. } = self;
            let mut own = planned_flight(&horizon.model, forecast, view.slot, serving);
            rivals.choose(view, &ahead, &mut own, surveyed, is_over);
        }
    }

    /// The first slot of the plan, or the decision of the followed strategy.
    fn decide(&mut self, view: &View, forecast: &Forecast) -> Option<Decision> {
        self.path.clear();
        if view.others.is_some() {
            self.told = (view.slot, self.horizon.visits(view, forecast));
        }
        if self.rivals.choice.followed.is_some() {
            self.horizon.carried = forecast.stops(); // all of them, because another strategy flies the next slot
            return self.rivals.plan(view);
        }
        let Self { horizon, serving, .. } = self;
        let mut own = planned_flight(&horizon.model, forecast, view.slot, serving);
        let decision = own.plan(view)?;
        self.path.extend(planned_path(&horizon.model, forecast).iter().map(|point| above(point, decision.waypoint.z)));
        Some(decision)
    }
}

impl Strategy for LookAhead {
    /// Improves the plan, and decides by it or by a strategy that is predicted to lose less; `None` if no SN that can
    /// lose data is in reach.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        // The budget is divided among the survey, the search, and the comparison.
        let budget = self.horizon.keys.budget(view).map(|budget| (Instant::now(), budget));
        let is_over_at = |fraction: f64| {
            let is_late = move |(begin, budget): (Instant, Duration)| begin.elapsed() >= budget.mul_f64(fraction);
            move || view.stop.requested().is_some() || budget.is_some_and(is_late)
        };
        let mut forecast = self.horizon.forecast(view)?;
        let steps = self.horizon.keys.iterations;
        let surveyed = if self.rivals.choice.is_surveyed {
            None
        } else {
            self.survey(view, &mut forecast, steps, &is_over_at(SURVEY_END))
        };
        self.horizon.search(view, &mut forecast, is_over_at(SEARCH_END));
        self.compare(view, &forecast, surveyed.as_ref(), &is_over_at(1.0));
        self.decide(view, &forecast)
    }

    fn path(&self) -> &[Point3<f64>] {
        &self.path
    }

    fn visits(&mut self, view: &View<'_>, into: &mut Vec<PlannedVisit>) {
        self.visits(view, into);
    }
}

impl Checkpoint for LookAhead {
    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&self.rivals.choice, bytes);
        self.horizon.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let (choice, horizon) = decode_first(bytes)?;
        let mut restored = self.horizon.clone();
        restored.restore(horizon)?;
        self.rivals.restore(choice)?;
        self.horizon = restored;
        self.told = (0, Vec::new());
        Ok(())
    }
}
