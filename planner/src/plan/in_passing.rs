//! Plans that serve in passing: they stop anywhere in a disk, for a slot, and end with the last stop. Parts of a plan
//! that a change does not affect are repeated: see [`Timelines`].

use std::borrow::Cow;
use std::ops::ControlFlow;

use skysink_common::channel::ChannelModel;
use skysink_common::geometry::{Position, distance_squared};
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use super::anneal::SearchStyle;
use super::capacities::{CapacityTable, best_capacities_bits, with_margin};
use super::carried_plan::{CarriedPlan, PlanStyle};
use super::decoder::{Candidate, DecoderStyle, Trace};
use super::forecast::{Change, Forecast, ForecastStyle};
use super::groups::PlannedStop;
use super::model::{ModelStyle, PlanModel};
use super::objective::Objective;
use super::operators::{OF_DISKS, Operator};
use super::other_visits::OtherVisits;
use super::planned::PathStyle;
use super::start;
use super::timelines::Timelines;
use crate::geometry::disks::Disk;
use crate::mission_table::MissionTable;
use crate::route::route::Route;
use crate::route::way_home::WayHome;
use crate::strategy::View;

/// Slack of range, relative to the communication radius: half that of decision D5, which flight-sim applies.
const RANGE_SLACK: f64 = 0.5e-9;

/// Most stops in sequence that are left out because the battery does not reach them; a plan ends with more.
const MOST_LEFT_OUT: usize = 64;

/// Most slots for which a long search before the first of them makes all but one in [`LEFT`] of the steps, where all is
/// known.
const ADVANCE_SLOTS: u64 = 500;
const LEFT: u32 = 4;

/// Most steps of the long search: some seconds, counted and not timed. Fewer where a step takes longer: by the factor
/// of a battery, of zones, and of other UAVs, which search as long, and by the number of sensors beyond so many.
const MOST_ADVANCED: u64 = 600_000;
const BATTERY_EFFORT: u64 = 10;
const ZONES_EFFORT: u64 = 3;
const FLEET_EFFORT: u64 = 4;
const EASY_SENSORS: usize = 200;

/// The style of plans that serve in passing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InPassing;

impl<O: Objective<Style = Self>> ModelStyle<O> for InPassing {
    fn scenario(scenario: &Scenario) -> Cow<'_, Scenario> {
        with_margin(scenario)
    }

    /// SNs that can lose data, or all where ages count.
    fn includes(mission: &MissionTable, id: u32) -> bool {
        O::COUNTS_AGES || mission.sensors.sampler(id).mean_bits > 0.0
    }

    fn capacities_bits(scenario: &Scenario, table: &MissionTable) -> Option<Box<CapacityTable>> {
        let is_tabulated = table.channel.depends_on_elevation() || table.channel.depends_on_place();
        is_tabulated.then(|| Box::new(best_capacities_bits(scenario, table)))
    }

    fn add_stops(model: &mut PlanModel, seed: u64, may_group: bool, stop: &Stop) {
        model.add_disks::<O>(seed, may_group, stop);
    }
}

impl<O: Objective<Style = Self>> DecoderStyle<O> for InPassing {
    #[inline]
    fn enter(model: &PlanModel, from: &Position, disk: &Disk, near: &Position) -> Option<Route> {
        model.table.motion.enter(from, disk, near)
    }

    #[inline]
    fn served_first(model: &PlanModel, stop: PlannedStop) -> &[u32] {
        &model.disks[stop.disk as usize].members
    }

    #[inline]
    fn margin_j(_: &PlanModel, home: &WayHome, slot: u64, energy_j: f64, at: &Position) -> f64 {
        home.margin_j(slot, energy_j, at)
    }

    #[inline]
    fn in_range(model: &PlanModel, first: &[u32], at: &Position, found: &mut Vec<Candidate>) {
        let PlanModel { table: MissionTable { sensors, limits, .. }, .. } = model;
        let linked = |sensor: u32, d2_m2: f64| Candidate::new(sensor, model.capacity_at::<O>(sensor, d2_m2, at));
        if first.len() == limits.blocks() {
            let away_m2 = |&sensor: &u32| distance_squared(sensors.position(sensor), at);
            found.extend(first.iter().map(|sensor| linked(*sensor, away_m2(sensor))));
        } else {
            let range_m = limits.comm_radius_m * (1.0 + RANGE_SLACK);
            sensors.grid.visit(at, range_m, |node, d2_m2| found.push(linked(node.id, d2_m2)));
        }
    }
}

impl<O: Objective<Style = Self>> ForecastStyle<O> for InPassing {
    type Store = Timelines<O>;

    #[inline]
    fn is_as_before(
        forecast: &Forecast<O>,
        model: &PlanModel,
        change: &Change,
        old: u32,
        next: Option<u32>,
        follows: bool,
    ) -> bool {
        let Forecast { decoder, trace: Trace { legs, .. }, .. } = forecast;
        let index = old as usize;
        let next_old = next.map_or(legs.len(), |next| next as usize);
        let (at, slot, energy_j) = forecast.begin(index);
        if next_old != index + 1 || at != decoder.at {
            return false;
        }
        if let Some(home) = model.table.home.way()
            && ((home.must_land || !model.pad_waits.is_empty()) && slot != decoder.slot
                || forecast.least_margin_j(index) < energy_j - decoder.energy_j)
        {
            return false; // the way home may come earlier, or a pad be free
        }
        let leg = &legs[index];
        follows || (leg.end > slot && !forecast.is_met(model, change, leg.stop))
    }

    fn is_idle(forecast: &Forecast<O>, model: &PlanModel, change: &Change, stop: PlannedStop) -> bool {
        forecast.is_met(model, change, stop)
    }

    fn cost_of_leg(forecast: &Forecast<O>, change: &Change, begin: i32, flown: Option<f64>) -> Option<f64> {
        let is_left_out = forecast.decoder.slot == begin;
        flown.filter(|_| !is_left_out || forecast.left_out(change) < MOST_LEFT_OUT)
    }

    #[inline]
    fn end(forecast: &mut Forecast<O>, model: &PlanModel) -> f64 {
        let rest = forecast.rest();
        forecast.store.added_cost(model, rest)
    }
}

impl<O: Objective<Style = Self>> SearchStyle<O> for InPassing {
    const OPERATORS: &'static [Operator] = OF_DISKS;
}

impl<O: Objective<Style = Self>> PlanStyle<O> for InPassing {
    fn forecast(plan: &mut CarriedPlan<O>, view: &View) -> Option<Forecast<O>> {
        let model = &mut plan.model;
        model.others = OtherVisits::of(view.intents().unwrap_or_default(), &model.ids, &model.sensors, view.slot);
        if model.sensors.is_empty() {
            return None;
        }
        let mut forecast = Forecast::new(&plan.model, plan.window(view));
        if plan.stops.is_empty() {
            start::begin(&plan.model, &mut forecast);
        } else {
            forecast.load(&plan.model, plan.stops.iter().copied());
            start::extend(&plan.model, &mut forecast);
        }
        Some(forecast)
    }

    fn has_plan(plan: &CarriedPlan<O>) -> bool {
        !plan.stops.is_empty()
    }

    /// Where all is known, the first search makes most of the steps of the slots after it, which have fewer then.
    fn search(plan: &mut CarriedPlan<O>, view: &View, forecast: &mut Forecast<O>, _: u64, is_over: &dyn Fn() -> bool) {
        let steps = plan.keys.iterations;
        let left = steps.div_ceil(LEFT);
        if !plan.state.has_begun && view.is_certain() {
            let advanced = u64::from(steps - left);
            let most = (plan.most_advanced(view) / advanced.max(1)).min(forecast.window.slots as u64);
            let slots = most.min(ADVANCE_SLOTS);
            let watch = &mut |_| if is_over() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
            if plan.prepare(view, forecast, advanced * slots, watch).is_some() {
                plan.state.advanced = view.slot + slots;
            }
        }
        plan.state.has_begun = true;
        plan.improve(view.slot, if view.slot < plan.state.advanced { left } else { steps }, forecast, is_over);
    }

    fn carry(plan: &mut CarriedPlan<O>, forecast: &Forecast<O>, _: &Position) {
        plan.stops.clear();
        plan.stops.extend(forecast.trace.legs.iter().filter(|leg| leg.end > 1).map(|leg| leg.stop));
    }
}

/// The way ends with the last stop.
impl PathStyle for InPassing {}

impl<O: Objective<Style = InPassing>> Forecast<O> {
    /// Whether the last slot of `change` serves all live members of `stop` without a stop for them.
    fn is_met(&self, model: &PlanModel, change: &Change, stop: PlannedStop) -> bool {
        let slot = self.decoder.slot;
        let Self { trace: Trace { legs, visits }, .. } = self;
        let visits = change.trace.visits.iter().rev().chain(visits[..self.trace.first_visit(change.from)].iter().rev());
        let legs = change.trace.legs.iter().rev().chain(legs[..change.from].iter().rev());
        let served = visits.take_while(|visit| visit.slot == slot);
        let stopped = legs.take_while(|leg| leg.end == slot);
        model.disks[stop.disk as usize].members.iter().all(|member| {
            if model.sensors[*member as usize].weight == 0.0 {
                return true;
            }
            let is_served = served.clone().any(|visit| visit.sensor == *member);
            is_served && !stopped.clone().any(|leg| model.disks[leg.stop.disk as usize].members.contains(member))
        })
    }

    /// Least margin [J] of the legs from `leg` to the next visit to the base. How long that charges is not adapted to
    /// the energy of a changed plan before it, until the plan is loaded again.
    fn least_margin_j(&self, leg: usize) -> f64 {
        let legs = self.trace.legs[leg..].iter().take_while(|leg| leg.via.is_none());
        legs.map(|leg| leg.margin_j).fold(f64::INFINITY, f64::min)
    }

    /// The number of legs that end in the last slot of `change`.
    fn left_out(&self, change: &Change) -> usize {
        let legs = change.trace.legs.iter().rev().chain(self.trace.legs[..change.from].iter().rev());
        legs.take_while(|leg| leg.end == self.decoder.slot).count()
    }
}

impl<O: Objective<Style = InPassing>> CarriedPlan<O> {
    /// Most steps of the long search.
    fn most_advanced(&self, view: &View) -> u64 {
        let table = &self.model.table;
        let sensors = self.model.sensors.len().div_ceil(EASY_SENSORS).max(1) as u64;
        let zones = if table.airspace.is_open() { 1 } else { ZONES_EFFORT };
        let battery = if table.home.way().is_some() { BATTERY_EFFORT } else { 1 };
        let fleet = if view.intents().is_some() { FLEET_EFFORT } else { 1 };
        MOST_ADVANCED / (sensors * zones * battery * fleet)
    }
}
