//! A flight that is flown in advance, with the mean of what is sampled and expected rates.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::arrivals::sampled_bits;
use skysink_common::belief::Believed;
use skysink_common::geometry::Position;
use skysink_common::interpolation::interpolate;
use skysink_common::told::Heard;

use super::stops::{FlownService, TimedStop, range};
use crate::geometry::disks::{Disk, project};
use crate::serving::Serving;
use crate::strategies::turns::InTurn;
use crate::strategy::{Decision, Strategy, Timing, View};

/// Part of a slot by which the point of a stop may be missed.
const MISSED_SLOTS: f64 = 1e-4;

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct FlightPlan {
    /// Its first slot.
    pub first: u64,
    /// Where its slots end [m].
    pub ends: Vec<[f64; 2]>,
    /// Whom they serve first, ascending.
    pub served: Vec<Vec<u32>>,
}

impl FlightPlan {
    /// The slot `slot` of the plan, from 0; `None` if it does not plan it.
    pub fn index(&self, slot: u64) -> Option<usize> {
        let index = usize::try_from(slot.checked_sub(self.first)?).ok()?;
        (index < self.ends.len()).then_some(index)
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct FlownSlot {
    pub end: Position,
    pub services: Vec<FlownService>,
}

/// A flight in advance, with the queues after it.
pub(super) struct Rehearsal<'a> {
    /// What was seen before it.
    pub view: View<'a>,
    /// Slots that it has to fly.
    pub slots: u64,
    /// Whether what is left in the queues is lost, too.
    pub collects: bool,
    /// The slots that it has flown.
    pub flown: Vec<FlownSlot>,
    position: Point3<f64>,
    /// The queues after them [bit], by id.
    queues_bits: Vec<u32>,
    /// What was lost in them [bit, weighted].
    lost_bits: f64,
}

impl<'a> Rehearsal<'a> {
    /// The flight of `slots` slots from `view` on, before it begins.
    pub fn new(view: &View<'a>, slots: u64, collects: bool) -> Self {
        let queues_bits = view.belief.queues_bits.to_vec();
        let position = view.position;
        let flown = Vec::with_capacity(slots as usize);
        Self { view: *view, slots, collects, position, queues_bits, lost_bits: 0.0, flown }
    }

    /// Predicted bits that are lost, by their weights.
    pub fn cost(&self) -> f64 {
        let weights = &self.view.table.sensors.weights;
        let left_bits = (0..).zip(&self.queues_bits).map(|(id, bits)| weights.factor(id) * f64::from(*bits));
        self.lost_bits + if self.collects { left_bits.sum() } else { 0.0 }
    }

    /// The slot to be flown next.
    fn slot(&self) -> u64 {
        self.view.slot.saturating_add(self.flown.len() as u64)
    }

    fn is_over(&self) -> bool {
        self.flown.len() as u64 >= self.slots || self.view.stop.requested().is_some()
    }

    /// What a strategy sees in the next slot.
    fn now(&self) -> View<'_> {
        let slot = self.slot();
        let told = self.view.told(&self.queues_bits);
        let belief = Believed::known(slot.saturating_sub(1), &self.view.table.sensors, told);
        View {
            slot,
            position: self.position,
            belief,
            timing: Timing::Free,
            heard: &Heard::NOTHING,
            neighbours: None,
            ..self.view
        }
    }

    /// Flies a slot: SNs sample and overflow, then the scheduled ones upload.
    fn fly(&mut self, decision: &Decision) {
        let sensors = &self.view.table.sensors;
        let slot = self.slot();
        for id in sensors.ids() {
            let sampler = sensors.sampler(id);
            let index = id as usize;
            let sampled =
                sampled_bits(sampler.mean_bits, slot) - sampled_bits(sampler.mean_bits, slot.saturating_sub(1));
            let full_bits = u64::from(self.queues_bits[index]) + sampled;
            let kept_bits = full_bits.min(sampler.stored_bits().into());
            self.lost_bits += sensors.weights.factor(index) * (full_bits - kept_bits) as f64;
            self.queues_bits[index] = kept_bits as u32; // a buffer's
        }
        let queues_bits = &mut self.queues_bits;
        let services = decision.schedule.iter().map(|&id| {
            let carried_bits = self.view.table.capacity_bits(id, &decision.waypoint);
            let queue_bits = &mut queues_bits[id as usize];
            let bits = carried_bits.min((*queue_bits).into());
            *queue_bits -= bits as u32;
            FlownService { id, bits, carried_bits }
        });
        let services = services.collect();
        self.position = decision.waypoint;
        self.flown.push(FlownSlot { end: decision.waypoint.xy(), services });
    }

    /// Flies along a round in the slots that are left.
    pub fn follow(&mut self, round: &mut InTurn) {
        while !self.is_over() {
            let decision = round.plan(&self.now()).expect("a round decides every slot");
            self.fly(&decision);
        }
    }

    /// Flies a slot to `end`, and serves first the SNs `first` and then the fullest in range.
    fn fly_to(&mut self, serving: &mut Serving, end: &Position, first: &[u32]) {
        let decision = serving.serve_first(&self.now(), end, |id| first.contains(&id));
        self.fly(&decision);
    }

    /// Flies to a stop and stays there, as long as there are slots left. With `hurries` it ends in range of its SNs as
    /// soon as it can.
    pub fn visit(&mut self, serving: &mut Serving, stop: &TimedStop, hurries: bool) {
        self.approach(serving, stop, hurries);
        let stays = |flight: &Self, stayed: u64| {
            stayed < stop.whole_slots() || (flight.flown.len() as f64) < stop.end_slots.round()
        };
        let mut stayed = 1;
        while !self.is_over() && stays(self, stayed) {
            let here = self.position.xy();
            self.fly_to(serving, &here, &stop.ids());
            stayed += 1;
        }
    }

    /// Flies to the point of a stop; with `hurries` into the range of all its SNs in the fewest slots, as near to the
    /// point as they allow. Around zones it is the point.
    fn approach(&mut self, serving: &mut Serving, stop: &TimedStop, hurries: bool) {
        let table = self.view.table;
        let from = self.position.xy();
        let reach_m = table.limits.reach_m;
        let ranges = stop.services.iter().map(|service| range(table, service.id));
        let mut disks: Vec<Disk> = ranges.collect();
        disks.push(Disk { centre: from, radius_m: 0.0 });
        let farthest = ((stop.point - from).norm() / reach_m - MISSED_SLOTS).ceil().max(1.0);
        let mut slots = if hurries { 1.0 } else { farthest };
        let end = loop {
            disks.last_mut().expect("it has the reach").radius_m = reach_m * slots;
            match project(&stop.point, &disks) {
                Some(end) => break end,
                None if slots > farthest => break stop.point,
                None => slots += 1.0,
            }
        };
        let end = table.clamp_to_area(&end);
        if !table.airspace.is_free(&from, &end) {
            return self.fly_around(serving, stop);
        }
        for slot in 1..=slots as u64 {
            if self.is_over() {
                break;
            }
            let is_last = slot as f64 == slots;
            let at = if is_last { end } else { interpolate(from, end, slot as f64 / slots) };
            self.fly_to(serving, &at, &if is_last { stop.ids() } else { Vec::new() });
        }
    }

    /// Flies to the point of a stop around zones.
    fn fly_around(&mut self, serving: &mut Serving, stop: &TimedStop) {
        let goal = self.view.table.airspace.nearest(&stop.point);
        while !self.is_over() {
            let from = self.position.xy();
            let end = self.view.table.motion.toward(&from, &goal);
            self.fly_to(serving, &end, &stop.ids());
            if end == goal || end == from {
                break;
            }
        }
    }

    /// The SN that overflows soonest.
    pub fn most_urgent(&self) -> Option<u32> {
        let now = self.now();
        let deadlines = now.servable().filter_map(|id| Some((now.belief.deadline_slots(id)?, id)));
        deadlines.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, id)| id)
    }

    pub fn into_plan(self) -> FlightPlan {
        FlightPlan {
            first: self.view.slot,
            ends: self.flown.iter().map(|slot| slot.end.into()).collect(),
            served: self.flown.iter().map(|slot| slot.services.iter().map(|service| service.id).collect()).collect(),
        }
    }
}
