//! Rollout: what a strategy is predicted to lose from a slot to the mission's end, by flying it ahead.
//!
//! Queues grow as is known or believed, links carry what their channel is drawn to in futures of the rollout's own: the
//! planner knows the channel, never its draws. Sampling, overflow and upload are in whole bits, in the order of decision
//! D1. So where channel, queues and rates are known, the prediction is what the mission will be.

use arrayvec::ArrayVec;
use nalgebra::Point3;
use rand::{Rng, RngExt};
use skysink_common::arrivals::bits_between;
use skysink_common::channel::{Channel, Uplink};
use skysink_common::estimate::Estimate;
use skysink_common::message::{FlightReport, LinkReport, MAX_SERVED, Mode, SensorNode};
use skysink_common::random::{Purpose, Streams};
use skysink_common::scenario::Scenario;

use super::serving::Serving;
use super::transit::transit_waypoint;
use super::{Strategy, View};
use crate::horizon::choice::late_slots;

/// A mission from the slot of a view on, as far as it can be foreseen.
pub(super) struct Rollout<'a> {
    view: &'a View<'a>,
    sensors: &'a [SensorNode],
    /// Sampled by each SN per slot, known or believed [bit].
    mean_bits: Vec<f64>,
    /// The last slot that is flown.
    last_slot: u64,
    /// Slots of the mission behind it.
    beyond_slots: f64,
    /// Slots in which every SN may expect its next visit.
    round_slots: f64,
    streams: Streams,
    /// Futures of the links; one where they are known.
    pub futures: u32,
}

/// How far a rollout goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ahead {
    /// Slots that are flown, at least 1.
    pub slots: u64,
    /// Slots of the mission behind them.
    pub beyond_slots: f64,
    /// Slots in which every SN may expect its next visit.
    pub round_slots: f64,
}

/// Slots that all futures of a rollout have together, about: short missions have many futures.
const FUTURE_SLOTS: u64 = 600;

/// Most futures.
const MOST_FUTURES: u64 = 16;

/// Futures of a rollout over `slots` slots; one where the links are known.
pub(super) fn futures(view: &View, slots: u64) -> u32 {
    let is_certain = view.estimate.is_none() && !is_random(&view.table.channel);
    if !is_certain { (FUTURE_SLOTS / slots).clamp(1, MOST_FUTURES) as u32 } else { 1 }
}

/// A slot of a flight.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FlownSlot {
    /// Where it ends [m].
    pub waypoint: Point3<f64>,
    /// The SNs that it serves.
    pub ids: ArrayVec<u32, MAX_SERVED>,
}

impl<'a> Rollout<'a> {
    /// From the slot of `view` on.
    pub fn new(view: &'a View<'a>, scenario: &Scenario, sensors: &'a [SensorNode], ahead: &Ahead) -> Self {
        let mean_bits = |(id, sensor): (u32, &SensorNode)| {
            view.estimate.map_or(sensor.sampling_bps * scenario.slot_s, |estimate| estimate.mean_bits(id))
        };
        Self {
            view,
            sensors,
            mean_bits: (0..).zip(sensors).map(mean_bits).collect(),
            last_slot: view.slot + ahead.slots - 1,
            beyond_slots: ahead.beyond_slots,
            round_slots: ahead.round_slots,
            streams: Streams::new(scenario.seed),
            futures: futures(view, ahead.slots),
        }
    }

    /// Mean loss [bit] over all futures if `strategy` flies from here on, which `reset` brings to its present state
    /// before each; `None` as soon as that is more than `most_bits`, or once `is_over`.
    pub fn mean_loss_bits(
        &self,
        strategy: &mut dyn Strategy,
        reset: impl Fn(&mut dyn Strategy),
        transit: &mut Serving,
        most_bits: f64,
        is_over: &dyn Fn() -> bool,
    ) -> Option<f64> {
        let most_bits = most_bits * f64::from(self.futures);
        let mut lost_bits = 0.0;
        for future in 0..self.futures {
            reset(strategy);
            lost_bits += self.fly(future, strategy, transit, most_bits - lost_bits, is_over, |_| ())?;
        }
        Some(lost_bits / f64::from(self.futures))
    }

    /// Loss [bit] in one future; every slot is shown to `watch`. `None` as soon as it is more than `most_bits`, or once
    /// `is_over`.
    pub fn fly(
        &self,
        future: u32,
        strategy: &mut dyn Strategy,
        transit: &mut Serving,
        most_bits: f64,
        is_over: &dyn Fn() -> bool,
        mut watch: impl FnMut(FlownSlot),
    ) -> Option<f64> {
        let table = self.view.table;
        let mut random = self.streams.stream(Purpose::Rollout, self.view.slot, future);
        let streams = Streams::new(random.next_u64());
        let mut world = self.draw_world(&mut random);
        let mut estimate = self.view.estimate.cloned();
        let mut position = self.view.position;
        let mut lost_bits = 0.0;
        for slot in self.view.slot..=self.last_slot {
            if let Some(estimate) = &mut estimate {
                estimate.believe(slot - 1);
            }
            let estimated = estimate.as_ref();
            let queues_bits = estimated.map_or(&world.queues_bits[..], Estimate::queues_bits);
            let view = View { slot, position, queues_bits, estimate: estimated, ..*self.view };
            let decision = strategy.plan(&view).unwrap_or_else(|| {
                let waypoint = transit_waypoint(table, &view.ground(), queues_bits);
                transit.serve_fullest(&view, &waypoint)
            });
            position = decision.waypoint;
            if let Some(estimate) = &mut estimate {
                estimate.announce(slot, &decision.schedule, &world.queues_bits);
            }
            lost_bits += world.sample(slot, self.sensors) as f64;
            if lost_bits > most_bits || is_over() {
                return None;
            }
            let mut report = FlightReport::at(position, Mode::Serve);
            for (&id, link) in decision.schedule.iter().zip(&mut report.links) {
                let uplink = Uplink::new(table.gains[id as usize], table.position(id), &position);
                let rate_bps = table.channel.draw(&uplink, &streams, slot, id).rate_bps;
                let capacity_bits = table.channel.capacity_bits(rate_bps);
                *link = LinkReport { sensor: id, rate_bps, capacity_bits, ..LinkReport::default() };
                let queue_bits = &mut world.queues_bits[id as usize];
                *queue_bits -= capacity_bits.min(u64::from(*queue_bits)) as u32;
                report.served += 1;
            }
            if let Some(estimate) = &mut estimate {
                estimate.observe(slot, &report, &world.queues_bits);
            }
            watch(FlownSlot { waypoint: position, ids: decision.schedule });
        }
        lost_bits += self.beyond_bits(&world);
        (lost_bits <= most_bits).then_some(lost_bits)
    }

    /// Queues and rates as they may be: as is known, or drawn from what is believed.
    fn draw_world(&self, random: &mut impl Rng) -> World {
        let mut world = World { queues_bits: self.view.queues_bits.to_vec(), mean_bits: self.mean_bits.clone() };
        let Some(estimate) = self.view.estimate else {
            return world;
        };
        for ((id, queue_bits), mean_bits) in (0..).zip(&mut world.queues_bits).zip(&mut world.mean_bits) {
            let uncertain = estimate.uncertainty(self.view.slot - 1, id);
            let [rate, initial] = random.random::<[f64; 2]>().map(|fraction| 2.0 * fraction - 1.0);
            if uncertain.rate == 0.0 && uncertain.initial_bits == 0.0 {
                continue;
            }
            let drawn_bits = uncertain.endless_bits
                + uncertain.since_bits * uncertain.rate * rate
                + uncertain.initial_bits * initial;
            *queue_bits = drawn_bits.clamp(0.0, f64::from(estimate.capacity_bits(id))) as u32;
            *mean_bits *= 1.0 + uncertain.rate * rate;
        }
        world
    }

    /// What the queues after the last slot are expected to lose behind it [bit].
    fn beyond_bits(&self, world: &World) -> f64 {
        if self.beyond_slots == 0.0 {
            return 0.0;
        }
        let late_bits = |((queue_bits, mean_bits), sensor): ((&u32, &f64), &SensorNode)| {
            let left_slots = f64::from(sensor.capacity_bits - queue_bits) / mean_bits;
            let late = if *mean_bits > 0.0 { late_slots(left_slots, self.round_slots) } else { 0.0 };
            late.min(self.beyond_slots) * mean_bits
        };
        world.queues_bits.iter().zip(&world.mean_bits).zip(self.sensors).map(late_bits).sum()
    }
}

/// Queues and rates of a future, by SN.
struct World {
    queues_bits: Vec<u32>,
    mean_bits: Vec<f64>,
}

impl World {
    /// All SNs sample; returns what overflows [bit].
    fn sample(&mut self, slot: u64, sensors: &[SensorNode]) -> u64 {
        let mut lost_bits = 0;
        for ((queue_bits, mean_bits), sensor) in self.queues_bits.iter_mut().zip(&self.mean_bits).zip(sensors) {
            let all_bits = u64::from(*queue_bits) + bits_between(*mean_bits, slot - 1, slot);
            let stored_bits = all_bits.min(u64::from(sensor.capacity_bits));
            lost_bits += all_bits - stored_bits;
            *queue_bits = stored_bits as u32;
        }
        lost_bits
    }
}

/// Whether what a link carries is drawn in every slot.
pub(super) fn is_random(channel: &Channel) -> bool {
    match channel {
        Channel::FreeSpace(model) => model.redrawn_db.is_some(),
        Channel::LineOfSight(_) => true,
    }
}
