//! Rollout: the predicted loss of a strategy from a slot to the mission's end, by simulation.
//!
//! Queues grow at known or estimated rates. Random channels are drawn from the rollout's own streams, because the
//! planner knows the channel, but not its draws. Sampling, overflow and upload are in whole bits, in the order of
//! decision D1: with known channel, queues and rates the prediction is exact.

use arrayvec::ArrayVec;
use nalgebra::Point3;
use rand::{Rng, RngExt};
use skysink_common::arrivals::bits_between;
use skysink_common::channel::Uplink;
use skysink_common::estimate::Estimate;
use skysink_common::message::{FlightReport, LinkReport, MAX_SERVED, Mode, SensorNode};
use skysink_common::random::{Purpose, Streams};
use skysink_common::scenario::Scenario;

use super::serving::Serving;
use super::transit::transit_waypoint;
use super::{Strategy, View};
use crate::horizon::choice::late_slots;

/// A simulation of the mission from the slot of a view on.
pub(super) struct Rollout<'a> {
    view: &'a View<'a>,
    sensors: &'a [SensorNode],
    /// Known or estimated bits sampled per slot, by SN.
    mean_bits: Vec<f64>,
    /// The last simulated slot.
    last_slot: u64,
    /// Slots of the mission after it.
    beyond_slots: f64,
    /// Expected slots to the next visit of an SN.
    round_slots: f64,
    streams: Streams,
    /// Number of random samples; 1 if all is known.
    pub futures: u32,
}

/// The window of a rollout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ahead {
    /// Simulated slots, at least 1.
    pub slots: u64,
    /// Slots of the mission after them.
    pub beyond_slots: f64,
    /// Expected slots to the next visit of an SN.
    pub round_slots: f64,
}

/// Most samples ("futures") of a rollout.
const MOST_FUTURES: f64 = 32.0;

/// Least number of slots of all samples together: one sample of a long mission has many draws.
const LEAST_SLOTS: f64 = 960.0;

/// Least number of samples if not all is known.
const LEAST_FUTURES: f64 = 3.0;

/// Approximate limit on the time of one sample [µs]: some 10^7 SNs times slots. Longer missions are not rolled out.
const MOST_US: f64 = 200_000.0;

/// Number of samples and cost of a rollout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Effort {
    /// Samples of links, queues and rates: as many as time allows; 1 if all are known.
    pub futures: u32,
    /// Estimated time of all samples [µs], by the SNs in reach; no clock is read.
    pub cost_us: f64,
    /// Whether one sample is within the time limit.
    pub is_affordable: bool,
}

impl Effort {
    /// Of a rollout over `slots` slots that may take `most_us` [µs] where there are several futures.
    pub fn of(view: &View, slots: u64, most_us: f64) -> Self {
        let table = view.table;
        let count = table.positions.len() as f64;
        let sight_m = table.reach_m + table.comm_radius_m;
        let sight =
            (std::f64::consts::PI * sight_m * sight_m / (table.area.width_m() * table.area.height_m())).min(1.0);
        let in_sight = count * sight;
        let searching_us =
            if table.channel.line_of_sight().is_some() { 40.0 * in_sight.min(1.0) } else { 0.1 * in_sight };
        let slot_us = 1.0 + count / 100.0 + searching_us;
        let future_us = slot_us * slots as f64;
        let futures = if is_certain(view) {
            1.0
        } else {
            (most_us / future_us).max(LEAST_SLOTS / slots as f64).clamp(LEAST_FUTURES, MOST_FUTURES).floor()
        };
        Self { futures: futures as u32, cost_us: future_us * futures, is_affordable: future_us <= MOST_US }
    }
}

/// A slot of a flight.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RolledSlot {
    /// Where it ends [m].
    pub waypoint: Point3<f64>,
    /// The SNs that it serves.
    pub ids: ArrayVec<u32, MAX_SERVED>,
}

impl<'a> Rollout<'a> {
    /// From the slot of `view` on.
    pub fn new(
        view: &'a View<'a>,
        scenario: &Scenario,
        sensors: &'a [SensorNode],
        ahead: &Ahead,
        futures: u32,
    ) -> Self {
        let mean_bits = |(id, sensor): (u32, &SensorNode)| {
            view.estimate.map_or(sensor.sampling_bps * scenario.slot_s, |estimate| estimate.mean_bits(id))
        };
        Self {
            view,
            sensors,
            mean_bits: (0..).zip(sensors).map(mean_bits).collect(),
            last_slot: view.slot.saturating_add(ahead.slots - 1),
            beyond_slots: ahead.beyond_slots,
            round_slots: ahead.round_slots,
            streams: Streams::new(scenario.seed),
            futures,
        }
    }

    /// Mean loss [bit] of `strategy` over all samples; `reset` restores its state before each. `None` as soon as the
    /// mean exceeds `most_bits`, or once `is_over`. `watch` is called with each slot of the first sample.
    pub fn mean_loss_bits(
        &self,
        strategy: &mut dyn Strategy,
        reset: impl Fn(&mut dyn Strategy),
        transit: &mut Serving,
        most_bits: f64,
        is_over: &dyn Fn() -> bool,
        mut watch: impl FnMut(RolledSlot),
    ) -> Option<f64> {
        let most_bits = most_bits * f64::from(self.futures);
        let mut lost_bits = 0.0;
        for future in 0..self.futures {
            reset(strategy);
            let watch = |slot| {
                if future == 0 {
                    watch(slot);
                }
            };
            lost_bits += self.fly(future, strategy, transit, most_bits - lost_bits, is_over, watch)?;
        }
        Some(lost_bits / f64::from(self.futures))
    }

    /// Loss [bit] of one sample; `watch` is called with each slot. `None` as soon as the loss exceeds `most_bits`, or
    /// once `is_over`.
    pub fn fly(
        &self,
        future: u32,
        strategy: &mut dyn Strategy,
        transit: &mut Serving,
        most_bits: f64,
        is_over: &dyn Fn() -> bool,
        mut watch: impl FnMut(RolledSlot),
    ) -> Option<f64> {
        let table = self.view.table;
        let mut random = self.streams.stream(Purpose::Rollout, 0, future);
        let streams = Streams::new(random.next_u64());
        let mut world = self.draw_world(&mut random);
        let mut estimate = self.view.estimate.cloned();
        let mut position = self.view.position;
        let mut lost_bits = 0.0;
        for slot in self.view.slot..=self.last_slot {
            if let Some(estimate) = &mut estimate {
                estimate.predict(slot.saturating_sub(1));
            }
            let estimated = estimate.as_ref();
            let queues_bits = estimated.map_or(&world.queues_bits[..], Estimate::queues_bits);
            let view = View { slot, position, queues_bits, estimate: estimated, ..*self.view };
            let decision = strategy.plan(&view).unwrap_or_else(|| {
                let waypoint = transit_waypoint(&table.positions, table.reach_m, &view.ground(), queues_bits);
                transit.serve_fullest(&view, &waypoint)
            });
            position = decision.waypoint;
            if let Some(estimate) = &mut estimate {
                estimate.record_before_contact(slot, &decision.schedule, &world.queues_bits);
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
            watch(RolledSlot { waypoint: position, ids: decision.schedule });
        }
        lost_bits += self.beyond_bits(&world);
        (lost_bits <= most_bits).then_some(lost_bits)
    }

    /// Queues and rates of a sample: known, or drawn from the estimate.
    fn draw_world(&self, random: &mut impl Rng) -> World {
        let mut world = World { queues_bits: self.view.queues_bits.to_vec(), mean_bits: self.mean_bits.clone() };
        let Some(estimate) = self.view.estimate else {
            return world;
        };
        for ((id, queue_bits), mean_bits) in (0..).zip(&mut world.queues_bits).zip(&mut world.mean_bits) {
            let uncertain = estimate.uncertainty(self.view.slot.saturating_sub(1), id);
            let [rate, initial] = random.random::<[f64; 2]>().map(|fraction| 2.0 * fraction - 1.0);
            if uncertain.rate == 0.0 && uncertain.initial_bits == 0.0 {
                continue;
            }
            let drawn_bits = uncertain.unbounded_bits
                + uncertain.since_contact_bits * uncertain.rate * rate
                + uncertain.initial_bits * initial;
            *queue_bits = drawn_bits.clamp(0.0, f64::from(estimate.capacity_bits(id))) as u32;
            *mean_bits *= 1.0 + uncertain.rate * rate;
        }
        world
    }

    /// Expected loss after the last simulated slot [bit].
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

/// Queues and rates of a sample, by SN.
struct World {
    queues_bits: Vec<u32>,
    mean_bits: Vec<f64>,
}

impl World {
    /// Samples at all SNs; returns the overflow [bit].
    fn sample(&mut self, slot: u64, sensors: &[SensorNode]) -> u64 {
        let mut lost_bits = 0;
        for ((queue_bits, mean_bits), sensor) in self.queues_bits.iter_mut().zip(&self.mean_bits).zip(sensors) {
            let all_bits = u64::from(*queue_bits) + bits_between(*mean_bits, slot.saturating_sub(1), slot);
            let stored_bits = all_bits.min(u64::from(sensor.capacity_bits));
            lost_bits += all_bits - stored_bits;
            *queue_bits = stored_bits as u32;
        }
        lost_bits
    }
}

/// Whether links, queues and rates are known.
pub(super) fn is_certain(view: &View) -> bool {
    view.estimate.is_none() && !view.table.channel.is_random()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    use skysink_common::checkpoint::Checkpoint;
    use skysink_common::estimate::Rates;
    use skysink_common::message::SolverOutcome;
    use skysink_common::scenario::Overrides;
    use skysink_common::stop::Stop;

    use crate::sensor_table::SensorTable;
    use crate::settings::Settings;
    use crate::strategies::{Decision, Registered, Setup, Timing};
    use crate::waypoint::problem::Waypoint;

    const NEVER: &dyn Fn() -> bool = &|| false;

    /// Rolls out `gfs` over `slots` slots of a scenario with one SN at (50, 50), where the UAV is, that holds
    /// `queue_bits`; returns the mean loss over `futures` futures.
    fn hovering(keys: &str, sampling_bps: f64, queue_bits: u32, [slots, beyond]: [u64; 2], futures: u32) -> f64 {
        let text = format!("name = 'x'\n{keys}");
        let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
        let sensors = [SensorNode {
            x_m: 50.0,
            y_m: 50.0,
            gain: 1e-5,
            sampling_bps,
            capacity_bits: 1_000,
            ..SensorNode::default()
        }];
        let table = &SensorTable::new(&scenario, &sensors);
        let settings = &Settings::of(&scenario).unwrap();
        let setup = Setup { scenario: &scenario, settings, sensors: &sensors, table, estimate: None };
        let is_learnt = keys.contains("learnt");
        let estimate = is_learnt.then(|| Estimate::new(&scenario, Rates::Learnt, &sensors));
        let position = scenario.start();
        let stop = &Stop::default();
        let estimate = estimate.as_ref();
        let queues_bits = &[queue_bits];
        let view = View { slot: 1, position, queues_bits, estimate, table, timing: Timing::Free, stop };
        let ahead = Ahead { slots, beyond_slots: beyond as f64, round_slots: 10.0 };
        let rollout = Rollout::new(&view, &scenario, &sensors, &ahead, futures);
        let mut gfs = (Registered::find("gfs").unwrap().make)(&setup);
        rollout.mean_loss_bits(gfs.as_mut(), |_| (), &mut Serving::new(&setup), f64::INFINITY, NEVER, |_| ()).unwrap()
    }

    #[test]
    fn what_does_not_fit_is_lost_before_the_upload() {
        // 950 bit and 100 a slot into 1 000: 50 are lost in slot 1, which then empties the queue; later none.
        assert_eq!(hovering("", 100.0, 950, [5, 0], 1), 50.0);
        // 2.5 bit a slot: A = 2, 5, 7, 10 (decision D2); 999 + 2 is 1 too many, and slot 1 empties it.
        assert_eq!(hovering("", 2.5, 999, [4, 0], 1), 1.0);
    }

    #[test]
    fn a_narrow_link_takes_whole_bits() {
        // γ = 10^−5 · 0.05/10^−13 = 5e6, x = 400: log2(12 501) = 13.6098; W τ_c = 10 · 0.1: 13 bit a slot. 1 000 full
        // and 100 more a slot: slot 1 loses 100, then 87 in each.
        assert_eq!(hovering("[link]\nbandwidth_hz = 10.0\n", 100.0, 1_000, [4, 0], 1), 100.0 + 3.0 * 87.0);
    }

    #[test]
    fn what_is_stored_at_the_end_counts_where_the_mission_goes_on() {
        // Emptied in slot 1, 5 slots of room of 200 bit are left; next visits within 10 slots: (10 − 5)²/20 slots.
        assert_eq!(hovering("", 200.0, 0, [1, 600], 1), 1.25 * 200.0);
        assert_eq!(hovering("", 200.0, 0, [1, 1], 1), 200.0, "at most what the rest of the mission samples");
    }

    #[test]
    fn drawn_links_lose_on_average_what_their_gain_loses() {
        // Gains of −70 to −50 dB: about 10 or 14 bit a slot. The mean over many futures lies between the ends.
        let keys = "[link]\nbandwidth_hz = 10.0\ngain = 'per-slot'\ngain_db = [-70.0, -50.0]\n";
        let lost_bits = hovering(keys, 100.0, 1_000, [40, 0], 32);
        let [least, most] = [100.0 + 39.0 * 86.0, 100.0 + 39.0 * 93.0];
        assert!(least < lost_bits && lost_bits < most, "{lost_bits} of {least} to {most}");
        assert_ne!(hovering(keys, 100.0, 1_000, [40, 0], 1), lost_bits, "each future has links of its own");
    }

    #[test]
    fn rates_that_are_not_known_are_drawn_from_what_is_believed() {
        // Rates of 0 to 200 bit/s, whatever the SN's own; 13 bit a slot go up. From a full queue at the mean rate
        // slots 2 to 40 lose 87 bit each; at the ends 0 or 187.
        let keys = "[sensors]\nsampling_bps = [0.0, 200.0]\ninitial_queue_mean_bits = 1000.0\n\
                    [link]\nbandwidth_hz = 10.0\n[planner]\nknowledge = 'estimated'\nrates = 'learnt'\n";
        let one = hovering(keys, 77.0, 1_000, [40, 0], 1);
        let lost_bits = hovering(keys, 77.0, 1_000, [40, 0], 32);
        assert_ne!(one, lost_bits);
        assert!((lost_bits / 39.0 - 87.0).abs() < 25.0, "{lost_bits}: a mean of 32 draws with a deviation of 58");
    }

    /// Serves nobody, and notes the queue of SN 0 that it is shown.
    #[derive(Default)]
    struct Watching {
        queues_bits: Vec<u32>,
    }

    impl Checkpoint for Watching {}

    impl Strategy for Watching {
        fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
            self.queues_bits.push(view.queues_bits[0]);
            Some(Decision::serve(view, &Waypoint { point: view.position, outcome: SolverOutcome::Rule }, &[]))
        }
    }

    #[test]
    fn a_strategy_is_shown_the_queues_expected_at_the_end_of_the_slot_before() {
        let text = "name = 'x'\n[sensors]\ninitial_queue_mean_bits = 0.0\n[planner]\nknowledge = 'estimated'\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let sensors = [SensorNode { sampling_bps: 100.0, capacity_bits: 250, ..SensorNode::default() }];
        let table = &SensorTable::new(&scenario, &sensors);
        let settings = &Settings::of(&scenario).unwrap();
        let estimate = &Estimate::new(&scenario, Rates::Known, &sensors);
        let setup = Setup { scenario: &scenario, settings, sensors: &sensors, table, estimate: Some(estimate) };
        let position = scenario.start();
        let stop = &Stop::default();
        let queues_bits = estimate.queues_bits();
        let view = View { slot: 1, position, queues_bits, estimate: Some(estimate), table, timing: Timing::Free, stop };
        let ahead = Ahead { slots: 5, beyond_slots: 0.0, round_slots: 1.0 };
        let rollout = Rollout::new(&view, &scenario, &sensors, &ahead, 1);
        let mut watching = Watching::default();
        let lost_bits = rollout.fly(0, &mut watching, &mut Serving::new(&setup), f64::INFINITY, NEVER, |_| ());
        assert_eq!(watching.queues_bits, [0, 100, 200, 250, 250]);
        assert_eq!(lost_bits, Some(250.0));
    }

    #[test]
    fn a_rollout_ends_as_soon_as_it_has_lost_too_much() {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let sensors =
            [SensorNode { x_m: 0.0, y_m: 0.0, sampling_bps: 100.0, capacity_bits: 500, ..SensorNode::default() }];
        let table = &SensorTable::new(&scenario, &sensors);
        let settings = &Settings::of(&scenario).unwrap();
        let setup = Setup { scenario: &scenario, settings, sensors: &sensors, table, estimate: None };
        let position = scenario.start();
        let stop = &Stop::default();
        let view = View { slot: 1, position, queues_bits: &[500], estimate: None, table, timing: Timing::Free, stop };
        let ahead = Ahead { slots: 2, beyond_slots: 0.0, round_slots: 1.0 };
        let rollout = Rollout::new(&view, &scenario, &sensors, &ahead, 1);
        let mut gfs = (Registered::find("gfs").unwrap().make)(&setup);
        let mut lost = |most_bits, is_over: &dyn Fn() -> bool| {
            let mut watched = 0;
            let transit = &mut Serving::new(&setup);
            let lost_bits = rollout.fly(0, gfs.as_mut(), transit, most_bits, is_over, |_| watched += 1);
            (lost_bits, watched)
        };
        // Two slots from the SN, 70 m away: both lose 100 bit.
        assert_eq!(lost(200.0, NEVER), (Some(200.0), 2));
        assert_eq!(lost(199.0, NEVER), (None, 1));
        assert_eq!(lost(f64::INFINITY, &|| true), (None, 0));
    }
}
