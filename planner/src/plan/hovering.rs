//! Plans that hover: they stop at points, hover there until nothing is left, and end at home. Legs depend on the
//! buffers, so all that follows a change is flown.

use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use super::anneal::SearchStyle;
use super::carried_plan::{CarriedPlan, PlanStyle, SavedPoint};
use super::decoder::{Buffers, Candidate, Decoder, DecoderStyle, Visit};
use super::forecast::{Change, Forecast, ForecastStyle};
use super::groups::PlannedStop;
use super::model::{ModelStyle, PlanModel};
use super::objective::Objective;
use super::operators::{OF_POINTS, Operator};
use super::planned::PathStyle;
use super::points::is_there;
use super::sensor::SensorModel;
use super::start;
use super::states::HoverStore;
use super::window::PlanningWindow;
use crate::geometry::disks::Disk;
use crate::mission_table::MissionTable;
use crate::route::route::Route;
use crate::route::way_home::WayHome;
use crate::strategy::View;

/// How often the steps of a search are halved, at most, after searches in vain.
const MOST_HALVINGS: u32 = 4;

/// Standard deviations of position errors within which a UAV has arrived.
const MOST_DEVIATIONS: f64 = 6.0;

/// The style of plans that hover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hovering;

impl<O: Objective<Style = Self>> ModelStyle<O> for Hovering {
    /// All SNs that can be served.
    fn includes(_: &MissionTable, _: u32) -> bool {
        true
    }

    /// None; but the turns are found, as a first plan may begin with them.
    fn add_stops(model: &mut PlanModel, _: u64, _: bool, stop: &Stop) {
        model.table.turns(stop);
    }
}

impl<O: Objective<Style = Self>> DecoderStyle<O> for Hovering {
    fn enter(model: &PlanModel, from: &Position, disk: &Disk, _: &Position) -> Option<Route> {
        model.route_to_point(from, disk)
    }

    fn served_first(_: &PlanModel, _: PlannedStop) -> &[u32] {
        &[]
    }

    /// Hovers at `stop` until its sensor has nothing left, as often as the stop says, and as a way home is left.
    fn stay(
        decoder: &mut Decoder,
        model: &PlanModel,
        stop: PlannedStop,
        last: i32,
        buffers: &mut impl Buffers<O>,
        visits: &mut Vec<Visit>,
    ) -> f64 {
        let index = model.disks[stop.disk as usize].members[0] as usize;
        let sensor = &model.sensors[index];
        let least_bits = 1.5 * sensor.mean_bits + 0.5;
        let wait = model.table.motion.wait(&decoder.at);
        let mut cost = 0.0;
        for _ in 0..stop.hovers {
            let there_bits = O::queue_bits(sensor, buffers.level(index), f64::from(decoder.slot + 1));
            let margin_j = decoder.next_margin_j::<O>(model, &wait);
            if there_bits < least_bits || wait.slots() as i32 > last - decoder.slot || margin_j < 0.0 {
                break;
            }
            decoder.margin_j = margin_j;
            decoder.hovered += wait.slots() as i32;
            cost += decoder.fly_along::<O>(model, &wait, &[], buffers, visits);
        }
        cost
    }

    fn margin_j(model: &PlanModel, home: &WayHome, slot: u64, energy_j: f64, at: &Position) -> f64 {
        model.margin_j(home, slot, energy_j, at)
    }

    fn in_range(model: &PlanModel, _: &[u32], at: &Position, found: &mut Vec<Candidate>) {
        found.extend(model.links(at).iter().map(|&(sensor, bits)| Candidate::new(sensor, bits)));
    }

    /// Of an empty buffer there is nothing to fetch.
    fn is_visit(cost: f64) -> bool {
        cost != 0.0
    }
}

impl<O: Objective<Style = Self>> ForecastStyle<O> for Hovering {
    type Store = HoverStore<O>;

    fn open(model: &PlanModel, window: &PlanningWindow<O>) -> Vec<(u32, f64)> {
        let queue_bits = |(sensor, level): (&SensorModel, &O::Level)| O::queue_bits(sensor, *level, 1.0);
        let all = (0..).zip(model.sensors.iter().zip(&window.levels).map(queue_bits)).zip(&model.sensors);
        let open = all.filter(|((_, bits), sensor)| *bits > 0.0 || sensor.mean_bits > 0.0);
        open.map(|(open, _)| open).collect()
    }

    /// Whether its sensor was served in passing, and the UAV is not on its way there.
    fn is_idle(forecast: &Forecast<O>, model: &PlanModel, change: &Change, stop: PlannedStop) -> bool {
        let Forecast { decoder, store, window, .. } = forecast;
        let is_first = change.from == 0 && change.trace.legs.is_empty();
        let index = model.disks[stop.disk as usize].members[0] as usize;
        if model.is_out(stop.disk) {
            return model.is_dead(stop.disk); // a silent one may send again
        }
        let sensor = &model.sensors[index];
        let level = store.levels[index];
        // Of one that was not served what there is when the UAV has come: now it may have sampled nothing yet.
        let away = if O::since(level) > 0.0 {
            1.0
        } else {
            model.table.motion.least_slots_into(&decoder.at, model.disk(stop.disk))
        };
        let there_bits = O::queue_bits(sensor, level, f64::from(decoder.slot) + away);
        let is_little = there_bits < sensor.capacity_bits.min(2.0 * sensor.mean_bits);
        is_little && !(is_first && window.under_way == Some(stop.disk))
    }

    /// A stop that cannot be reached in time is left out.
    fn cost_of_leg(_: &Forecast<O>, _: &Change, _: i32, flown: Option<f64>) -> Option<f64> {
        Some(flown.unwrap_or(0.0))
    }

    fn keeps(store: &HoverStore<O>, slots: i32) -> bool {
        store.keeps_idle || slots > 0
    }

    /// Flies home, and stays there as long as that delivers something, unless the UAV charges. Each slot in the air
    /// costs a little.
    fn end(forecast: &mut Forecast<O>, model: &PlanModel) -> f64 {
        let Forecast { decoder, window, store: HoverStore { levels, slot_cost, tail, .. }, .. } = forecast;
        let last = window.slots;
        tail.clear();
        let mut cost = 0.0;
        if let Some(route) = model.route_home(decoder.flown_slots + decoder.slot as u64, &decoder.at)
            && i64::from(route.slots()) <= i64::from(last - decoder.slot)
        {
            cost += decoder.fly_along::<O>(model, &route, &[], levels, tail);
        }
        cost += *slot_cost * f64::from(decoder.slot);
        if model.table.home.way().is_none_or(|home| home.battery.is_endless()) {
            while decoder.slot < last {
                decoder.slot += 1;
                let more = decoder.serve_in_range::<O>(model, &[], levels, tail);
                cost += more;
                if more == 0.0 && !model.has_sampling {
                    break;
                }
            }
        }
        cost
    }

    fn tail(store: &HoverStore<O>) -> &[Visit] {
        &store.tail
    }
}

impl<O: Objective<Style = Self>> SearchStyle<O> for Hovering {
    const OPERATORS: &'static [Operator] = OF_POINTS;
}

impl PathStyle for Hovering {
    /// The way home.
    fn way_after(model: &PlanModel, flown_slots: u64, last: &Position) -> Vec<Position> {
        let home = model.route_home(flown_slots, last);
        home.iter().flat_map(|route| model.table.airspace.way(last, &route.end())).collect()
    }
}

impl<O: Objective<Style = Self>> PlanStyle<O> for Hovering {
    fn beside_m(scenario: &Scenario) -> f64 {
        MOST_DEVIATIONS * scenario.uav.position_error_m.unwrap_or(0.0)
    }

    /// With the point that the UAV is on its way to, and without what other UAVs will take.
    fn complete(plan: &CarriedPlan<O>, view: &View, window: &mut PlanningWindow<O>) {
        let CarriedPlan { model, stops, state, .. } = plan;
        window.under_way = stops.first().filter(|_| state.is_under_way).map(|stop| stop.disk);
        for visit in view.intents().unwrap_or_default() {
            if let Ok(sensor) = model.ids.binary_search(&visit.sensor) {
                let slot = (visit.slot + 1).saturating_sub(view.slot) as f64;
                window.levels[sensor] = O::leave(&model.sensors[sensor], window.levels[sensor], slot, visit.bits);
            }
        }
    }

    fn forecast(plan: &mut CarriedPlan<O>, view: &View) -> Option<Forecast<O>> {
        let mut forecast = Forecast::new(&plan.model, plan.window(view));
        forecast.load(&plan.model, plan.stops.iter().copied());
        Some(forecast)
    }

    fn has_plan(plan: &CarriedPlan<O>) -> bool {
        plan.state.has_begun
    }

    /// The first search takes `first_steps`, one after searches in vain fewer than the others.
    fn search(
        plan: &mut CarriedPlan<O>,
        view: &View,
        forecast: &mut Forecast<O>,
        first_steps: u64,
        is_over: &dyn Fn() -> bool,
    ) {
        let is_first = !plan.state.has_begun;
        let steps = u64::from(plan.keys.iterations);
        let halved = steps >> plan.state.vain_searches.min(MOST_HALVINGS);
        let steps = if is_first { first_steps } else { halved.max(steps.min(1)) };
        plan.state.has_begun = true;
        plan.improve_points(view.slot, steps, is_first, forecast, is_over);
    }

    /// Carries all stops that are left.
    fn carry(plan: &mut CarriedPlan<O>, forecast: &Forecast<O>, waypoint: &Position) {
        let legs = &forecast.trace.legs;
        let first = legs.partition_point(|leg| leg.end == 0);
        plan.stops.clear();
        plan.stops.extend(legs[first..].iter().map(|leg| leg.stop));
        plan.state.is_under_way = legs.get(first).is_some_and(|leg| leg.via.is_none());
        if let Some(stop) = plan.stops.first_mut().filter(|_| plan.state.is_under_way)
            && is_there(&forecast.window.start, waypoint)
        {
            stop.hovers = stop.hovers.saturating_sub(1);
        }
        plan.state.waypoint = (plan.beside_m > 0.0 && plan.state.is_under_way).then_some((*waypoint).into());
        plan.model.keep_points(&mut plan.stops);
    }

    fn saved_points(model: &PlanModel) -> Vec<SavedPoint> {
        model.disks.iter().map(|point| (point.disk.centre.into(), point.members[0])).collect()
    }

    fn count_stops(_: &PlanModel, points: &[SavedPoint]) -> usize {
        points.len()
    }

    fn restore_points(model: &mut PlanModel, points: &[SavedPoint]) {
        model.disks.clear();
        for (point, sensor) in points {
            model.add_point(*sensor, (*point).into(), 0);
        }
    }
}

impl<O: Objective<Style = Hovering>> CarriedPlan<O> {
    /// Loads a first plan: see [`start::begin_at_points`]. `offered` are points, each with a sensor by its id.
    pub fn begin_at_points(
        &mut self,
        view: &View,
        forecast: &mut Forecast<O>,
        offered: &[(Position, u32)],
        is_over: &dyn Fn() -> bool,
    ) {
        let mut turns = self.model.table.turns(view.stop).as_ref().clone();
        turns.begin_near(|point| self.model.table.motion.distance_m2(point, &forecast.window.start));
        let number = |id: &u32| self.model.ids.binary_search(id).ok();
        let offered: Vec<(Position, u32)> =
            offered.iter().filter_map(|(at, id)| number(id).map(|sensor| (*at, sensor as u32))).collect();
        let offered = offered.into_iter().map(|(at, sensor)| self.model.add_point(sensor, at, 0)).collect();
        start::begin_at_points(&mut self.model, forecast, &turns, offered, is_over);
    }

    /// Keeps the plan of `forecast`, of which nothing is flown yet, for the slot that it begins with.
    pub(crate) fn keep(&mut self, forecast: &Forecast<O>) {
        self.stops = forecast.stops();
        self.model.keep_points(&mut self.stops);
    }
}
