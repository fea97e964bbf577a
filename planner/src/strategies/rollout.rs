//! Rollout: the predicted loss of a strategy from a slot to the mission's end, by simulation.
//!
//! Queues grow at known or estimated rates. Random channels are drawn from the rollout's own streams, because the
//! planner knows the channel, but not its draws. Sampling, overflow and upload are in whole bits, in the order of
//! decision D1: with known channel, queues and rates the prediction is exact.

use std::borrow::Cow;

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use skysink_common::arrivals::{Arrivals, Imagined};
use skysink_common::channel::{ChannelModel, DrawnChannel};
use skysink_common::message::{FlightReport, LinkReport, Mode};
use skysink_common::queues::{Queues, overflow_bits};
use skysink_common::random::{Purpose, Streams};
use skysink_common::sampling::{Sampler, Sampling};

use super::returning::{battery_after, decide};
use super::serving::Serving;
use crate::horizon::choice::late_slots;
use crate::strategy::{Decision, PlannedVisit, Strategy, View};

/// A simulation of the mission from the slot of a view on.
pub(crate) struct Rollout<'a> {
    view: &'a View<'a>,
    /// With known or estimated rates.
    sampling: Cow<'a, Sampling>,
    ahead: Ahead,
    streams: Streams,
    /// Number of random samples; 1 if all is known.
    pub futures: u32,
}

/// The window of a rollout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ahead {
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
pub(crate) struct Effort {
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
        let count = table.sensors.positions.len() as f64;
        let sight_m = table.limits.reach_m + table.limits.comm_radius_m;
        let sight = (std::f64::consts::PI * sight_m * sight_m
            / (table.limits.area().width_m() * table.limits.area().height_m()))
        .min(1.0);
        let in_sight = count * sight;
        let searching_us = if table.channel.depends_on_elevation() { 40.0 * in_sight.min(1.0) } else { 0.1 * in_sight };
        let drawing_us = if table.arrivals.is_random() { count / 60.0 } else { 0.0 };
        let slot_us = 1.0 + count / 100.0 + drawing_us + searching_us;
        let future_us = slot_us * slots as f64;
        let futures = if is_certain(view) {
            1.0
        } else {
            (most_us / future_us).max(LEAST_SLOTS / slots as f64).clamp(LEAST_FUTURES, MOST_FUTURES).floor()
        };
        Self { futures: futures as u32, cost_us: future_us * futures, is_affordable: future_us <= MOST_US }
    }
}

impl<'a> Rollout<'a> {
    /// From the slot of `view` on, with the random streams of `seed`.
    pub fn new(view: &'a View<'a>, seed: u64, ahead: &Ahead, futures: u32) -> Self {
        let sensors = &view.table.sensors;
        let sampling = if view.belief.belief.is_estimated() {
            let mean_bits = sensors.ids().map(|id| view.belief.mean_bits(id)).collect();
            Cow::Owned(sensors.sampling.with_means(mean_bits))
        } else {
            Cow::Borrowed(&sensors.sampling)
        };
        Self { view, sampling, ahead: *ahead, streams: Streams::new(seed), futures }
    }

    /// Mean loss [bit] of `strategy` over all samples; its `state` is restored before each, unless it has none. `None`
    /// as soon as the mean exceeds `most_bits`, or once `is_over`. `watch` is called with each slot of the first
    /// sample.
    pub fn mean_loss_bits(
        &self,
        strategy: &mut dyn Strategy,
        state: Option<&[u8]>,
        transit: &mut Serving,
        most_bits: f64,
        is_over: &dyn Fn() -> bool,
        mut watch: impl FnMut(&Decision),
    ) -> Option<f64> {
        let most_bits = most_bits * f64::from(self.futures);
        let mut lost_bits = 0.0;
        for future in 0..self.futures {
            if let Some(state) = state {
                strategy.restore(state).expect("a state of its own");
            }
            let watch = |slot: &Decision| {
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
        mut watch: impl FnMut(&Decision),
    ) -> Option<f64> {
        let table = self.view.table;
        let mut random = self.streams.stream(Purpose::Rollout, 0, future);
        let channel = DrawnChannel::new(table.channel, Streams::new(random.next_u64()));
        let mut world = self.draw_world(&mut random);
        let mut belief = self.view.belief.belief.clone();
        let mut position = self.view.position;
        let mut battery = self.view.battery;
        let mut lost_bits = 0.0;
        for slot in self.view.slot..=self.view.slot.saturating_add(self.ahead.slots - 1) {
            let believed = belief.at(slot.saturating_sub(1), &table.sensors, world.queues.bits());
            let view = View { slot, position, battery, belief: believed, ..*self.view };
            let (decision, mode) = decide(strategy, transit, &view);
            battery = battery_after(&view, &decision, mode);
            position = decision.waypoint;
            let before = belief.reported(slot, decision.schedule.iter().copied(), world.queues.bits());
            lost_bits += self.sample(&mut world, slot);
            if lost_bits > most_bits || is_over() {
                return None;
            }
            let mut report = FlightReport::at(position, Mode::Serve);
            for (&id, link) in decision.schedule.iter().zip(&mut report.links) {
                let sensor_at = table.sensors.position(id);
                let uplink = table.channel.uplink(table.sensors.gains[id as usize], sensor_at, &position);
                let rate_bps = channel.draw(&uplink, sensor_at, &position, slot, id).rate_bps;
                let capacity_bits = table.channel.capacity_bits(rate_bps);
                *link = LinkReport { sensor: id, rate_bps, capacity_bits, ..LinkReport::default() };
                world.queues.upload(id as usize, capacity_bits);
                report.served += 1;
            }
            for visit in visits_in(self.view.others, slot) {
                world.queues.upload(visit.sensor as usize, visit.bits as u64);
            }
            belief.advance(slot, &[report], &before, world.queues.bits());
            watch(&decision);
        }
        lost_bits += self.beyond_bits(&world);
        (lost_bits <= most_bits).then_some(lost_bits)
    }

    /// All SNs sample in `slot`; returns their loss [bit], weighted where weights differ (decision D25).
    fn sample(&self, world: &mut World, slot: u64) -> f64 {
        let weights = &self.view.table.sensors.weights;
        let weighted_bits = (!weights.are_equal()).then(|| {
            let lost_bits = |(id, &queue_bits): (usize, &u32)| {
                overflow_bits(&world.sampling.of(id), queue_bits, slot.saturating_sub(1), slot) as f64
            };
            weights.sum(world.queues.bits().iter().enumerate().map(lost_bits))
        });
        let lost_bits = world.queues.sample(&world.sampling, slot) as f64;
        weighted_bits.unwrap_or(lost_bits)
    }

    /// Queues and rates of a sample: known, or drawn from the estimate.
    fn draw_world(&self, random: &mut impl Rng) -> World<'_> {
        let View { belief, .. } = self.view;
        if !belief.belief.is_estimated() {
            let within = |(id, &queue_bits): (usize, &u32)| queue_bits.min(self.sampling.of(id).capacity_bits);
            let queues_bits = belief.queues_bits.iter().enumerate().map(within).collect();
            let sampling = self.draw_arrivals(random).map_or(Cow::Borrowed(&*self.sampling), |arrivals| {
                Cow::Owned(Sampling::clone(&self.sampling).with_arrivals(Some(arrivals.into())))
            });
            return World { queues: Queues::new(queues_bits), sampling };
        }
        let mut queues_bits = belief.queues_bits.to_vec();
        let mut means_bits = Vec::with_capacity(queues_bits.len());
        for (id, queue_bits) in (0..).zip(&mut queues_bits) {
            let Sampler { mean_bits, capacity_bits } = self.sampling.of(id as usize);
            let uncertain = belief.uncertainty(id);
            let [rate, initial] = random.random::<[f64; 2]>().map(|fraction| 2.0 * fraction - 1.0);
            if uncertain.rate == 0.0 && uncertain.initial_bits == 0.0 && uncertain.arrivals_bits == 0.0 {
                means_bits.push(mean_bits);
                continue;
            }
            let mut drawn_bits = uncertain.unbounded_bits
                + uncertain.since_contact_bits * uncertain.rate * rate
                + uncertain.initial_bits * initial;
            if uncertain.arrivals_bits > 0.0 {
                drawn_bits += uncertain.arrivals_bits * random.sample::<f64, _>(StandardNormal);
            }
            *queue_bits = drawn_bits.clamp(0.0, f64::from(capacity_bits)) as u32;
            means_bits.push(mean_bits * (1.0 + uncertain.rate * rate));
        }
        let arrivals = self.draw_arrivals(random).map(Arrivals::from);
        let sampling = Cow::Owned(self.sampling.with_means(means_bits).with_arrivals(arrivals));
        World { queues: Queues::new(queues_bits), sampling }
    }

    /// The arrivals of a sample; `None` if they are constant.
    fn draw_arrivals(&self, random: &mut impl Rng) -> Option<Imagined> {
        let table = self.view.table;
        let slots = self.view.slot..self.view.slot.saturating_add(self.ahead.slots);
        let streams = || Streams::new(random.next_u64());
        table
            .arrivals
            .is_random()
            .then(streams)
            .and_then(|streams| Imagined::new(table.arrivals, streams, table.sensors.count(), slots))
    }

    /// Expected loss after the last simulated slot [bit].
    fn beyond_bits(&self, world: &World) -> f64 {
        let Ahead { beyond_slots, round_slots, .. } = self.ahead;
        if beyond_slots == 0.0 {
            return 0.0;
        }
        let late_bits = |(id, &queue_bits): (usize, &u32)| {
            let Sampler { mean_bits, capacity_bits } = world.sampling.of(id);
            let left_slots = f64::from(capacity_bits - queue_bits) / mean_bits;
            let late = if mean_bits > 0.0 { late_slots(left_slots, round_slots) } else { 0.0 };
            late.min(beyond_slots) * mean_bits * self.view.table.sensors.weights.factor(id)
        };
        world.queues.bits().iter().enumerate().map(late_bits).sum()
    }
}

/// What other UAVs plan to serve in `slot`.
fn visits_in(others: Option<&[PlannedVisit]>, slot: u64) -> &[PlannedVisit] {
    let others = others.unwrap_or_default();
    let begin = others.partition_point(|visit| visit.slot < slot);
    let end = others.partition_point(|visit| visit.slot <= slot);
    &others[begin..end]
}

/// Queues and sampling of a sample.
struct World<'a> {
    queues: Queues,
    sampling: Cow<'a, Sampling>,
}

/// Whether links, arrivals, queues and rates are known.
pub(crate) fn is_certain(view: &View) -> bool {
    !view.belief.belief.is_estimated() && !view.table.channel.is_random() && !view.table.arrivals.is_random()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    use skysink_common::battery::BatteryState;
    use skysink_common::belief::{Belief, Believed};
    use skysink_common::checkpoint::Checkpoint;
    use skysink_common::estimate::Rates;
    use skysink_common::message::{SensorNode, SolverOutcome};
    use skysink_common::scenario::{Overrides, Scenario};
    use skysink_common::stop::Stop;

    use crate::strategy::tests::over;
    use crate::strategy::{OwnedSetup, Registered, Timing};
    use crate::waypoint::problem::Waypoint;

    const NEVER: &dyn Fn() -> bool = &|| false;

    /// Rolls out `gfs` over `slots` slots of a scenario with one SN at (50, 50), where the UAV is, that holds
    /// `queue_bits`; returns the mean loss over `futures` futures.
    fn hovering(keys: &str, sampling_bps: f64, queue_bits: u32, [slots, beyond]: [u64; 2], futures: u32) -> f64 {
        let text = format!("name = 'x'\n{keys}");
        let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
        let node = SensorNode { x_m: 50.0, y_m: 50.0, gain: 1e-5, sampling_bps, ..SensorNode::default() };
        let field = over(scenario, vec![SensorNode { capacity_bits: 1_000, ..node }]);
        let OwnedSetup { scenario, table, .. } = &field;
        let setup = field.setup();
        let is_learnt = keys.contains("learnt");
        let mut belief = Belief::new(scenario, &table.sensors, is_learnt.then_some(Rates::Learnt));
        let position = scenario.start();
        let stop = &Stop::default();
        let queues_bits = &[queue_bits];
        let belief = belief.at(0, &table.sensors, queues_bits);
        let view = View {
            slot: 1,
            position,
            battery: BatteryState::default(),
            belief,
            table,
            timing: Timing::Free,
            others: None,
            stop,
        };
        let ahead = Ahead { slots, beyond_slots: beyond as f64, round_slots: 10.0 };
        let rollout = Rollout::new(&view, scenario.seed, &ahead, futures);
        let mut gfs = (Registered::find("gfs").unwrap().make)(&setup);
        rollout.mean_loss_bits(gfs.as_mut(), None, &mut Serving::new(&setup), f64::INFINITY, NEVER, |_| ()).unwrap()
    }

    #[test]
    fn overflow_is_lost_before_the_upload() {
        // 950 bit and 100 a slot into 1 000: 50 are lost in slot 1, which then empties the queue; later none.
        assert_eq!(hovering("", 100.0, 950, [5, 0], 1), 50.0);
        // 2.5 bit a slot: A = 2, 5, 7, 10 (decision D2); 999 + 2 is 1 too many, and slot 1 empties it.
        assert_eq!(hovering("", 2.5, 999, [4, 0], 1), 1.0);
    }

    #[test]
    fn a_slow_link_carries_whole_bits() {
        // γ = 10^−5 · 0.05/10^−13 = 5e6, x = 400: log2(12 501) = 13.6098; W τ_c = 10 · 0.1: 13 bit a slot. 1 000 full
        // and 100 more a slot: slot 1 loses 100, then 87 in each.
        assert_eq!(hovering("[link]\nbandwidth_hz = 10.0\n", 100.0, 1_000, [4, 0], 1), 100.0 + 3.0 * 87.0);
    }

    #[test]
    fn bits_stored_at_the_end_of_the_window_count_by_their_expected_overflow() {
        // Emptied in slot 1, 5 slots of room of 200 bit are left; next visits within 10 slots: (10 − 5)²/20 slots.
        assert_eq!(hovering("", 200.0, 0, [1, 600], 1), 1.25 * 200.0);
        assert_eq!(hovering("", 200.0, 0, [1, 1], 1), 200.0, "at most what the rest of the mission samples");
    }

    #[test]
    fn random_links_lose_the_expected_bits_on_average() {
        // Gains of −70 to −50 dB: about 10 or 14 bit a slot. The mean over many futures lies between the ends.
        let keys = "[link]\nbandwidth_hz = 10.0\ngain = 'per-slot'\ngain_db = [-70.0, -50.0]\n";
        let lost_bits = hovering(keys, 100.0, 1_000, [40, 0], 32);
        let [least, most] = [100.0 + 39.0 * 86.0, 100.0 + 39.0 * 93.0];
        assert!(least < lost_bits && lost_bits < most, "{lost_bits} of {least} to {most}");
        assert_ne!(hovering(keys, 100.0, 1_000, [40, 0], 1), lost_bits, "each future has links of its own");
    }

    #[test]
    fn unknown_rates_are_drawn_from_the_belief() {
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
            self.queues_bits.push(view.belief.queues_bits[0]);
            Some(Decision::serve(view, &Waypoint { point: view.position, outcome: SolverOutcome::Rule }, &[]))
        }
    }

    #[test]
    fn strategies_see_the_queues_expected_at_the_end_of_the_previous_slot() {
        let text = "name = 'x'\n[sensors]\ninitial_queue_mean_bits = 0.0\n[planner]\nknowledge = 'estimated'\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let sensor = SensorNode { sampling_bps: 100.0, capacity_bits: 250, ..SensorNode::default() };
        let field = over(scenario, vec![sensor]);
        let OwnedSetup { scenario, table, .. } = &field;
        let mut belief = Belief::new(scenario, &table.sensors, Some(Rates::Known));
        let setup = field.setup();
        let position = scenario.start();
        let stop = &Stop::default();
        let belief = belief.at(0, &table.sensors, &[0]);
        let view = View {
            slot: 1,
            position,
            battery: BatteryState::default(),
            belief,
            table,
            timing: Timing::Free,
            others: None,
            stop,
        };
        let ahead = Ahead { slots: 5, beyond_slots: 0.0, round_slots: 1.0 };
        let rollout = Rollout::new(&view, scenario.seed, &ahead, 1);
        let mut watching = Watching::default();
        let lost_bits = rollout.fly(0, &mut watching, &mut Serving::new(&setup), f64::INFINITY, NEVER, |_| ());
        assert_eq!(watching.queues_bits, [0, 100, 200, 250, 250]);
        assert_eq!(lost_bits, Some(250.0));
    }

    #[test]
    fn a_rollout_ends_once_its_loss_exceeds_the_limit() {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let sensor =
            SensorNode { x_m: 0.0, y_m: 0.0, sampling_bps: 100.0, capacity_bits: 500, ..SensorNode::default() };
        let field = over(scenario, vec![sensor]);
        let OwnedSetup { scenario, table, .. } = &field;
        let setup = field.setup();
        let position = scenario.start();
        let stop = &Stop::default();
        let belief = Believed::known(0, &table.sensors, &[500]);
        let view = View {
            slot: 1,
            position,
            battery: BatteryState::default(),
            belief,
            table,
            timing: Timing::Free,
            others: None,
            stop,
        };
        let ahead = Ahead { slots: 2, beyond_slots: 0.0, round_slots: 1.0 };
        let rollout = Rollout::new(&view, scenario.seed, &ahead, 1);
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
