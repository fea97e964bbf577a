//! `planner.objective = "collect"`: the plan that delivers most until the mission's end, and is home then.
//!
//! A plan is a sequence of stops: a place, the sensor node (SN) that the UAV hovers for, and how long at most. It is
//! flown slot by slot in a model of expected rates, in which stops that leave no way home are left out, and improved by
//! simulated annealing. The decision for a slot is left to [`crate::strategies::collecting`].
//!
//! | module | contents |
//! |---|---|
//! | [`places`] | links and ways of places, and places to serve an SN from |
//! | [`flight`] | what a plan delivers |
//! | [`search`] | the search for a plan |

pub mod flight;
pub mod places;
pub mod search;

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::geometry::{Position, within};
use skysink_common::random::{Purpose, Streams};

use crate::neighbours::PlannedVisit;
use crate::strategy::{Setup, View};
use flight::{Next, PlanFlight, PlannedStop, Window};
use places::Places;
use search::PlanSearch;

/// Temperature of the first search, in parts of the mean data of an SN.
const FIRST_TEMPERATURE: f64 = 0.3;

/// The same of a search that improves a plan.
const LATER_TEMPERATURE: f64 = 0.02;

/// How often the steps of a search are halved, at most, after searches in vain.
const MOST_HALVINGS: u32 = 4;

/// Standard deviations of position errors within which a UAV has arrived.
const MOST_DEVIATIONS: f64 = 6.0;

/// Longest planning window [slots] unless the scenario has another.
const MOST_SLOTS: u64 = 2_400;

/// The plan of a mission, and what it is made from.
pub struct Collector {
    places: Places,
    streams: Streams,
    /// Longest planning window [slots].
    window_slots: u64,
    /// The remaining stops; `None` before the first search.
    stops: Option<Vec<PlannedStop>>,
    /// Searches in vain in a row: each next one takes half as many steps.
    vain_searches: u32,
    /// Where the last planned slot should have ended, if slots end beside their waypoints [m].
    told: Option<Position>,
    /// How far from its waypoint a slot may end [m].
    beside_m: f64,
    /// For other UAVs: the last slot that was planned, and the uploads of its plan.
    told_others: (u64, Vec<PlannedVisit>),
}

/// A stop as it is saved: place [m], SN, most hovers, and whether the UAV is on its way there.
type SavedStop = ([f64; 2], u32, u32, bool);

/// The checkpoint of a plan.
#[derive(Serialize, Deserialize)]
struct Saved {
    stops: Option<Vec<SavedStop>>,
    vain_searches: u32,
    told: Option<[f64; 2]>,
}

impl Collector {
    /// No plan yet.
    #[must_use]
    pub fn new(setup: &Setup, window_slots: Option<u64>) -> Self {
        Self {
            places: Places::new(setup.scenario, setup.table),
            streams: Streams::new(setup.scenario.seed),
            window_slots: window_slots.unwrap_or(MOST_SLOTS),
            stops: None,
            vain_searches: 0,
            told: None,
            beside_m: MOST_DEVIATIONS * setup.scenario.uav.position_error_m.unwrap_or(0.0),
            told_others: (0, Vec::new()),
        }
    }

    /// The uploads of the carried plan, or of the one that was made for the slot of `view`.
    pub fn visits(&mut self, view: &View, into: &mut Vec<PlannedVisit>) {
        if self.told_others.0 == view.slot {
            into.extend_from_slice(&self.told_others.1);
        } else if let Some(stops) = self.stops.as_ref() {
            let mut flight = PlanFlight::new(Window::of(view, view.ground(), self.last(view)), &mut self.places);
            flight.first(stops);
            into.extend(flight.visits());
        }
    }

    /// The last slot of the window that begins with the slot of `view`.
    fn last(&self, view: &View) -> u64 {
        view.table.limits.slots.min(view.slot.saturating_add(self.window_slots - 1))
    }

    /// Whether there is a plan.
    #[must_use]
    pub fn is_planned(&self) -> bool {
        self.stops.is_some()
    }

    /// Searches in up to `steps` steps for a plan from the slot of `view` on, or improves the one there is; returns
    /// what it does first, and keeps the rest. The first search may begin with the stops of `offered`; after searches
    /// in vain the next ones take fewer steps. The result depends only on the view and the plan,
    /// unless `is_over` ends the search.
    pub fn plan(
        &mut self,
        view: &View,
        steps: u64,
        offered: impl FnOnce() -> Vec<PlannedStop>,
        is_over: &dyn Fn() -> bool,
    ) -> Next {
        let last = self.last(view);
        // A UAV beside the place that it was told has arrived: otherwise a stop would never be over.
        let ground = view.ground();
        let at = self.told.filter(|told| within(told, &ground, self.beside_m)).unwrap_or(ground);
        let mut flight = PlanFlight::new(Window::of(view, at, last), &mut self.places);
        let mut random = self.streams.stream(Purpose::Collect, view.slot, 0);
        let (begun, steps, temperature) = match self.stops.take() {
            Some(stops) => {
                (Some(stops), (steps >> self.vain_searches.min(MOST_HALVINGS)).max(steps.min(1)), LATER_TEMPERATURE)
            }
            None => (None, steps, FIRST_TEMPERATURE),
        };
        let mut search = PlanSearch { flight: &mut flight, random: &mut random, is_over };
        let begun = begun.unwrap_or_else(|| search.insert_all(offered(), view.stop));
        let (mut stops, is_vain) = search.anneal(begun, steps, temperature);
        self.vain_searches = if is_vain { self.vain_searches.saturating_add(1) } else { 0 };
        let (next, first) = flight.first(&stops);
        if view.intents().is_some() {
            self.told_others = (view.slot, flight.visits().collect());
        }
        stops.drain(..first);
        stops.iter_mut().for_each(|stop| stop.is_begun = false);
        if let (Next::Flies(end), Some(stop)) = (next, stops.first_mut()) {
            stop.is_begun = true;
            if flight.is_there(&end) {
                stop.hovers = stop.hovers.saturating_sub(1);
            }
        }
        self.stops = Some(stops);
        self.told = None;
        match next {
            Next::Flies(end) if self.beside_m > 0.0 => {
                self.told = Some(end);
                Next::Flies(view.table.motion.toward(&ground, &end))
            }
            _ => next,
        }
    }

    /// The places of the plan [m], and the bends around zones between them, after `from`.
    #[must_use]
    pub fn path(&self, view: &View, from: &Position, most: usize) -> Vec<Position> {
        let airspace = &view.table.airspace;
        let mut path: Vec<Position> = Vec::new();
        let mut before = *from;
        for stop in self.stops.iter().flatten() {
            if path.len() >= most {
                break;
            }
            path.extend(airspace.way(&before, &stop.place));
            before = stop.place;
        }
        let home = view.table.home.as_ref().and_then(|home| home.route_within(&before, u64::MAX));
        path.extend(home.iter().flat_map(|route| airspace.way(&before, &route.end())));
        path.dedup();
        path.truncate(most);
        path
    }
}

impl Checkpoint for Collector {
    fn save(&self, bytes: &mut Vec<u8>) {
        let saved = |stop: &PlannedStop| (stop.place.into(), stop.sensor, stop.hovers, stop.is_begun);
        let stops = self.stops.as_ref().map(|stops| stops.iter().map(saved).collect());
        encode(&Saved { stops, vain_searches: self.vain_searches, told: self.told.map(Into::into) }, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let Saved { stops, vain_searches, told } = decode(bytes)?;
        let count = self.places.count();
        let is_known = |(place, sensor, ..): &SavedStop| {
            (*sensor as usize) < count && place.iter().all(|coordinate_m| coordinate_m.is_finite())
        };
        CheckpointError::ensure(stops.iter().flatten().all(is_known), "stops of this field")?;
        CheckpointError::ensure(told.iter().flatten().all(|coordinate_m| coordinate_m.is_finite()), "a place")?;
        self.vain_searches = vain_searches;
        self.told = told.map(Into::into);
        self.told_others = (0, Vec::new());
        let stop = |(place, sensor, hovers, is_begun): SavedStop| PlannedStop {
            is_begun,
            ..PlannedStop::new(place.into(), sensor, hovers)
        };
        self.stops = stops.map(|stops| stops.into_iter().map(stop).collect());
        Ok(())
    }
}
