//! What a plan delivers: its stops flown slot by slot, with expected rates.

use std::cmp::Ordering;
use std::sync::Arc;

use skysink_common::geometry::Position;

use super::places::{Links, Places, Way, is_there};
use crate::neighbours::PlannedVisit;
use crate::strategy::View;

/// What a slot in the air costs, as a fraction of all data: of plans that deliver the same the shortest is best.
const SLOT_COST: f64 = 1e-6;

/// Fraction of all data that is little.
const LITTLE: f64 = 0.05;

/// A stop of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedStop {
    /// Where the UAV stops [m].
    pub place: Position,
    /// The SN that it hovers for, until its queue is empty.
    pub sensor: u32,
    /// The most hovers there [moves]; a move takes one slot, or more on a grid.
    pub hovers: u32,
    /// Whether the UAV is on its way there: it then flies on, also if the SN was served in passing. Otherwise the
    /// flight would differ from the plan.
    pub is_begun: bool,
}

impl PlannedStop {
    /// A stop that the UAV has not set out for.
    #[must_use]
    pub fn new(place: Position, sensor: u32, hovers: u32) -> Self {
        Self { place, sensor, hovers, is_begun: false }
    }
}

/// What a plan does next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Next {
    /// Flies to this end of the next slot [m].
    Flies(Position),
    /// Flies home.
    Returns,
    /// Charges in the base.
    Charges,
}

/// The queue of an SN in a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Queue {
    /// At the end of `slot` [bit], without what was sampled in it.
    bits: f64,
    slot: u64,
}

/// An SN of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    /// Bits that it samples in a slot, in the mean.
    mean_bits: f64,
    capacity_bits: f64,
    /// How much its bits count.
    weight: f64,
}

/// The state at the beginning of a plan, and its end.
#[derive(Debug, Clone)]
pub struct Window {
    nodes: Vec<Node>,
    begun: Vec<Queue>,
    /// Before the first slot.
    begin: State,
    /// Last slot of the window.
    last: u64,
    /// Data that can be delivered, weighted [bit].
    all_bits: f64,
    /// Whether any SN samples.
    has_sampling: bool,
}

/// The state of a flight between two slots.
#[derive(Debug, Clone, Copy, PartialEq)]
struct State {
    at: Position,
    /// The last flown slot.
    slot: u64,
    energy_j: f64,
    /// Delivered so far, weighted [bit].
    delivered_bits: f64,
    /// Number of uploads so far.
    uploads: usize,
    /// Whether the stop before began with a way home.
    is_by_base: bool,
    /// Hovers at the stop before.
    hovers: u32,
}

/// An upload, and the queue after it.
#[derive(Debug, Clone, Copy)]
struct Upload {
    visit: PlannedVisit,
    left: Queue,
}

/// A plan as flown.
#[derive(Debug, Clone, Default)]
struct Trace {
    /// The state before each stop, and after the last.
    states: Vec<State>,
    /// The uploads, each with the queue after it.
    uploads: Vec<Upload>,
}

/// Flies plans.
pub struct PlanFlight<'a> {
    window: Window,
    /// Links and ways.
    pub places: &'a mut Places,
    queues: Vec<Queue>,
    state: State,
    /// The accepted plan.
    kept: Trace,
    tried: Trace,
    /// The served SNs of a slot with their uploads [bit]; working memory.
    served: Vec<(u32, f64)>,
}

impl Window {
    /// From the slot of `view` to `last`, for a UAV at `at` [m].
    #[must_use]
    pub fn of(view: &View, at: Position, last: u64) -> Self {
        let sensors = &view.table.sensors;
        let node = |id: u32| Node {
            mean_bits: view.belief.mean_bits(id),
            capacity_bits: f64::from(sensors.sampler(id).capacity_bits),
            weight: sensors.weights.factor(id as usize),
        };
        let nodes: Vec<Node> = sensors.ids().map(node).collect();
        let slot = view.slot - 1;
        let mut begun: Vec<Queue> =
            view.belief.queues_bits.iter().map(|&bits| Queue { bits: f64::from(bits), slot }).collect();
        // What other UAVs will take is theirs: a queue begins with what they leave.
        for visit in view.intents().unwrap_or_default() {
            let (node, queue) = (&nodes[visit.sensor as usize], &mut begun[visit.sensor as usize]);
            let waited = visit.slot.saturating_sub(1 + queue.slot);
            let bits = (queue.bits + waited as f64 * node.mean_bits).min(node.capacity_bits.max(queue.bits));
            // No more than there is now: the rest has not been sampled yet.
            *queue = Queue { bits: (bits - visit.bits).clamp(0.0, queue.bits), slot: queue.slot + waited };
        }
        let left_bits = |(node, queue): (&Node, &Queue)| {
            node.weight * (queue.bits + last.saturating_sub(queue.slot) as f64 * node.mean_bits)
        };
        let all_bits = nodes.iter().zip(&begun).map(left_bits);
        let begin = State {
            at,
            slot,
            energy_j: if view.table.home.as_ref().is_some_and(|home| home.battery.is_some()) {
                view.battery.energy_j
            } else {
                f64::INFINITY
            },
            delivered_bits: 0.0,
            uploads: 0,
            is_by_base: false,
            hovers: 0,
        };
        let has_sampling = nodes.iter().any(|node| node.mean_bits > 0.0);
        Self { all_bits: all_bits.sum(), nodes, begun, begin, last, has_sampling }
    }
}

impl<'a> PlanFlight<'a> {
    /// No stops.
    #[must_use]
    pub fn new(window: Window, places: &'a mut Places) -> Self {
        let queues = window.begun.clone();
        let state = window.begin;
        let kept = Trace { states: vec![state], uploads: Vec::new() };
        Self { window, places, queues, state, kept, tried: Trace::default(), served: Vec::new() }
    }

    /// Ids of the SNs that have, or will have, data.
    #[must_use]
    pub fn open(&self) -> Vec<u32> {
        let Window { nodes, begun, .. } = &self.window;
        let is_open = |id: &u32| begun[*id as usize].bits > 0.0 || nodes[*id as usize].mean_bits > 0.0;
        (0..nodes.len() as u32).filter(is_open).collect()
    }

    /// The queue of SN `sensor` at the beginning [bit].
    #[must_use]
    pub fn begun_bits(&self, sensor: u32) -> f64 {
        self.window.begun[sensor as usize].bits
    }

    /// Bits of an SN at the beginning, in the mean over those that have data, weighted.
    #[must_use]
    pub fn mean_bits(&self) -> f64 {
        self.window.all_bits / self.open().len().max(1) as f64
    }

    /// Whether any SN samples.
    #[must_use]
    pub fn has_sampling(&self) -> bool {
        self.window.has_sampling
    }

    /// Where it begins [m].
    #[must_use]
    pub fn begin(&self) -> Position {
        self.window.begin.at
    }

    /// Whether it begins at `place` [m].
    #[must_use]
    pub fn is_there(&self, place: &Position) -> bool {
        is_there(&self.window.begin.at, place)
    }

    /// Whether a plan of this value delivers all.
    #[must_use]
    pub fn is_complete(&self, value: f64) -> bool {
        let slots = (self.window.last - self.window.begin.slot) as f64;
        value >= self.window.all_bits * (1.0 - SLOT_COST * (slots + 1.0))
    }

    /// Whether a plan of this value leaves little of what it could deliver.
    #[must_use]
    pub fn leaves_little(&self, value: f64) -> bool {
        value >= self.window.all_bits * (1.0 - LITTLE)
    }

    /// The bits in the queue of an SN at the beginning of `slot`.
    fn queue_bits(&self, sensor: u32, slot: u64) -> f64 {
        let node = &self.window.nodes[sensor as usize];
        let queue = &self.queues[sensor as usize];
        let slots = (slot - 1).saturating_sub(queue.slot);
        if slots == 0 { queue.bits } else { (queue.bits + slots as f64 * node.mean_bits).min(node.capacity_bits) }
    }

    /// Flies a slot that ends with `links`, and serves those that upload most.
    fn serve(&mut self, links: &Links) {
        self.state.slot += 1;
        let slot = self.state.slot;
        let blocks = self.places.table.limits.blocks();
        let mut served = std::mem::take(&mut self.served);
        served.clear();
        let value = |sensor: u32, bits: f64| bits * self.window.nodes[sensor as usize].weight;
        let uploads = links.iter().map(|&(sensor, most_bits)| (sensor, self.queue_bits(sensor, slot).min(most_bits)));
        let order = |a: &(u32, f64), b: &(u32, f64)| -> Ordering {
            value(b.0, b.1).total_cmp(&value(a.0, a.1)).then(a.0.cmp(&b.0))
        };
        if blocks == 1 {
            served.extend(uploads.min_by(order));
        } else {
            served.extend(uploads);
            if served.len() > blocks {
                served.select_nth_unstable_by(blocks - 1, order);
                served.truncate(blocks);
            }
        }
        for &(sensor, bits) in served.iter().filter(|(_, bits)| *bits > 0.0) {
            let begun = self.queues[sensor as usize].slot;
            let left = Queue { bits: self.queue_bits(sensor, slot) - bits, slot: (slot - 1).max(begun) };
            self.queues[sensor as usize] = left;
            self.tried.uploads.push(Upload { visit: PlannedVisit { slot, sensor, bits }, left });
            self.state.delivered_bits += bits * self.window.nodes[sensor as usize].weight;
        }
        self.state.uploads = self.tried.uploads.len();
        self.served = served;
    }

    /// Flies along `leg`, which ends at `end`.
    fn fly(&mut self, leg: &Way, end: &Position) {
        for (_, links) in &leg.slots {
            self.serve(links);
        }
        self.state.at = leg.slots.last().map_or(*end, |(at, _)| *at);
        self.state.energy_j -= leg.energy_j;
    }

    /// Whether `leg` ends within the window, and leaves a way home from `end`.
    fn leaves_a_way_home(&mut self, leg: &Way, end: &Position) -> bool {
        let slot = self.state.slot + leg.slots.len() as u64;
        slot <= self.window.last && self.places.is_in_reach(slot, self.state.energy_j - leg.energy_j, end)
    }

    /// Flies to `stop` and hovers there; does nothing if that leaves no way home, even with charging first.
    fn fly_to(&mut self, stop: &PlannedStop) {
        (self.state.is_by_base, self.state.hovers) = (false, 0);
        // Of an SN that was served in passing there is nothing to fetch, unless the UAV is on its way.
        let mean_bits = self.window.nodes[stop.sensor as usize].mean_bits;
        let is_served = self.queue_bits(stop.sensor, self.state.slot + 1) < 2.0 * mean_bits;
        if is_served && !stop.is_begun {
            return;
        }
        let Some(leg) = self.places.leg(&self.state.at, &stop.place) else { return };
        if self.leaves_a_way_home(&leg, &stop.place) {
            self.fly(&leg, &stop.place);
        } else if !self.fly_by_base(stop) {
            return;
        }
        let links = self.places.links(&stop.place);
        let moves = self.places.table.airspace.move_slots();
        let battery = self.places.table.home.as_ref().and_then(|home| home.battery);
        let hover_j = battery.map_or(0.0, |battery| battery.slot_j(0.0) * moves as f64);
        let least_bits = 1.5 * self.window.nodes[stop.sensor as usize].mean_bits + 0.5;
        for _ in 0..stop.hovers {
            let slot = self.state.slot + moves;
            if self.queue_bits(stop.sensor, self.state.slot + 1) < least_bits
                || slot > self.window.last
                || !self.places.is_in_reach(slot, self.state.energy_j - hover_j, &stop.place)
            {
                break;
            }
            (0..moves).for_each(|_| self.serve(&links));
            self.state.energy_j -= hover_j;
            self.state.hovers += 1;
        }
    }

    /// Flies home, charges and flies to `stop`; whether that is possible.
    fn fly_by_base(&mut self, stop: &PlannedStop) -> bool {
        let Some(home) = self.places.table.home.clone() else { return false };
        let Some(battery) = home.battery.filter(|battery| battery.is_charged()) else { return false };
        let Some(way) = self.places.way_home(self.state.slot, &self.state.at) else { return false };
        let base = way.slots.last().map_or(self.state.at, |(end, _)| *end);
        let arrived = self.state.slot + way.slots.len() as u64;
        let arrived_j = self.state.energy_j - way.energy_j;
        let charged = home.charging_slots(arrived + 1, arrived_j);
        let Some(leg) = self.places.leg(&base, &stop.place) else { return false };
        let end = arrived.saturating_add(charged).saturating_add(leg.slots.len() as u64);
        let energy_j = battery.charged_for_j(arrived_j, charged as f64);
        if end > self.window.last || !self.places.is_in_reach(end, energy_j - leg.energy_j, &stop.place) {
            return false;
        }
        self.fly(&way, &base);
        self.state.slot += charged;
        self.state.energy_j = energy_j;
        self.state.is_by_base = true;
        self.fly(&leg, &stop.place);
        true
    }

    /// Ends a plan: flies home, and hovers as long as that delivers something, unless it charges. Returns its value.
    fn end(&mut self) -> f64 {
        let way = self.places.way_home(self.state.slot, &self.state.at);
        if let Some(way) = way {
            let end = self.state.at;
            self.fly(&way, &end);
        }
        let cost_bits = self.window.all_bits * SLOT_COST * (self.state.slot - self.window.begin.slot) as f64;
        if self.places.table.home.as_ref().is_none_or(|home| home.battery.is_none()) {
            let links = self.places.links(&self.state.at);
            while self.state.slot < self.window.last {
                let before_bits = self.state.delivered_bits;
                self.serve(&links);
                if self.state.delivered_bits == before_bits && !self.window.has_sampling {
                    break;
                }
            }
        }
        self.state.delivered_bits - cost_bits
    }

    /// The value of a plan of `stops`, of which the first `same` are those of the kept plan: what it delivers, weighted
    /// [bit], less a little for every slot.
    pub fn attempt(&mut self, stops: &[PlannedStop], same: usize) -> f64 {
        let state = self.kept.states[same];
        self.tried.states.clear();
        self.tried.states.extend_from_slice(&self.kept.states[..=same]);
        self.tried.uploads.clear();
        self.tried.uploads.extend_from_slice(&self.kept.uploads[..state.uploads]);
        self.queues.copy_from_slice(&self.window.begun);
        for Upload { visit, left } in &self.tried.uploads {
            self.queues[visit.sensor as usize] = *left;
        }
        self.state = state;
        for stop in &stops[same..] {
            self.fly_to(stop);
            self.tried.states.push(self.state);
        }
        self.end()
    }

    /// Keeps the plan of the last attempt, `stops`: without those that take no slot, and with the hovers that it takes.
    pub fn keep(&mut self, stops: &mut Vec<PlannedStop>) {
        std::mem::swap(&mut self.kept, &mut self.tried);
        let states = &mut self.kept.states;
        let mut kept = 0;
        for index in 0..stops.len() {
            let after = states[index + 1];
            if after.slot > states[kept].slot {
                stops[kept] = PlannedStop { hovers: after.hovers, ..stops[index] };
                states[kept + 1] = after;
                kept += 1;
            }
        }
        stops.truncate(kept);
        states.truncate(kept + 1);
    }

    /// What a plan of `stops` does first, and the index of the stop that it does it for; as many as there are for the
    /// way home.
    pub fn first(&mut self, stops: &[PlannedStop]) -> (Next, usize) {
        self.attempt(stops, 0);
        let begin = self.window.begin;
        for (index, stop) in stops.iter().enumerate() {
            let after = self.tried.states[index + 1];
            if after.slot == begin.slot {
                continue;
            }
            if after.is_by_base {
                let is_home = self.places.way_home(begin.slot, &begin.at).is_some_and(|way| way.slots.is_empty());
                return (if is_home { Next::Charges } else { Next::Returns }, index);
            }
            let leg: Option<Arc<Way>> = self.places.leg(&begin.at, &stop.place);
            let end = leg.and_then(|leg| leg.slots.first().map(|(end, _)| *end));
            return (Next::Flies(end.unwrap_or(begin.at)), index);
        }
        (Next::Returns, stops.len())
    }

    /// The uploads of the plan that was tried last.
    pub fn visits(&self) -> impl Iterator<Item = PlannedVisit> {
        self.tried.uploads.iter().map(|upload| upload.visit)
    }
}
