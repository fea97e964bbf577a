//! `hover`: straight to the best fixed point, where the UAV stays.
//!
//! The point is chosen once, from what is known before slot 1: of the centres of all maximal sets of sensor nodes (SNs)
//! that fit into a disk of radius `d_c`, and the nearest points from which these sets are in range, the one where most
//! bits, by their weights, are predicted not to be lost. On the way and at the point the UAV serves the n most urgent
//! SNs in range.

use std::f64::consts::{PI, TAU};

use rustc_hash::FxHashMap;
use skysink_common::channel::{ChannelModel, Uplink};
use skysink_common::geometry::{Position, above, distance_squared};
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use crate::geometry::circle::Circle;
use crate::geometry::disks::{Disk, nearest_in_both};
use crate::mission_table::MissionTable;
use crate::serving::Serving;
use crate::serving::nearby::fullest_first;
use crate::strategy::{Decision, Registered, View, rule};

/// Distances at which visits over a random channel are valued.
const DISTANCES: usize = 33;

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("hover", "hover: straight to the best fixed point, to serve all in range in turns", |setup| {
        let mut serving = Serving::new(setup);
        let point = BestPoint::new(setup.table, setup.scenario).found(setup.stop);
        rule(move |view| Some(serve_urgent(&mut serving, view, &view.table.motion.toward(&view.ground(), &point))))
    });

/// The decision to fly to `ground` and serve the n most urgent SNs in range.
///
/// Urgent are those that overflow before all in range have had a turn, of them those whose links carry most; then the
/// earliest deadlines.
fn serve_urgent(serving: &mut Serving, view: &View, ground: &Position) -> Decision {
    let MissionTable { sensors, limits, .. } = view.table;
    let mut in_range = 0;
    sensors.grid.visit_within(ground, limits.comm_radius_m, |_| in_range += 1);
    let turns = f64::from(in_range) / limits.blocks() as f64;
    let uav = above(ground, view.position.z);
    serving.serve_by(view, ground, |id| {
        let queue_bits = view.belief.queues_bits[id as usize];
        let deadline_slots = view.belief.deadline_slots(id).unwrap_or(f64::INFINITY);
        let by_queue = fullest_first(queue_bits, id);
        if deadline_slots >= turns {
            // For non-negative floats the order of the bit patterns is the order of the numbers.
            return (true, deadline_slots.max(0.0).to_bits(), by_queue);
        }
        let carried_bits = view.table.capacity_bits(id, &uav).min(queue_bits.into());
        let value = sensors.weights.factor(id as usize) * carried_bits as f64;
        (false, u64::MAX - value.to_bits(), by_queue)
    })
}

struct BestPoint<'a> {
    table: &'a MissionTable,
    start: Position,
    altitude_m: f64,
    /// Predicted queue of every SN before slot 1 [bit].
    initial_bits: f64,
    /// Bits that a visit is expected to take over a random channel, at equal steps of distance up to `d_c`, by the gain
    /// of the link, the buffer, and whether it is in sight.
    taken_bits: FxHashMap<(u64, u32, bool), [f64; DISTANCES]>,
    /// The best point so far, and the bits, by their weights, that are not lost because the UAV hovers there.
    best: (f64, Position),
}

impl<'a> BestPoint<'a> {
    fn new(table: &'a MissionTable, scenario: &Scenario) -> Self {
        let start = scenario.start().xy();
        let initial_bits = scenario.sensors.initial_queue_mean_bits.mean();
        let altitude_m = scenario.uav.altitude_m;
        Self { table, start, altitude_m, initial_bits, taken_bits: FxHashMap::default(), best: (0.0, start) }
    }

    /// The best point, the start if nothing can be lost or saved; after `stop` the best so far.
    fn found(&mut self, stop: &Stop) -> Position {
        let away_m2 = |&id: &u32| distance_squared(self.table.sensors.position(id), &self.start);
        let mut ids: Vec<u32> = self.table.sensors.sampling_ids().collect();
        // A near point is often best, which ends most others early.
        ids.sort_by(|a, b| away_m2(a).total_cmp(&away_m2(b)));
        for id in ids {
            if stop.requested().is_some() {
                break;
            }
            self.sweep(id);
        }
        self.best.1
    }

    /// Tries all sets that fit into a disk with SN `id` on its rim and that no such disk nearby extends: its centre
    /// goes around the SN.
    fn sweep(&mut self, id: u32) {
        let table = self.table;
        let radius_m = table.limits.comm_radius_m;
        let position = table.sensors.position(id);
        // Every such centre is this far from the SN.
        let earliest = table.motion.slots_into(&self.start, &Disk { centre: *position, radius_m });
        let mut near: Vec<(u32, f64)> = Vec::new();
        table.sensors.grid.visit_within(position, 2.0 * radius_m, |node| {
            let savable_bits = self.savable_bits(node.id, earliest);
            if savable_bits > 0.0 {
                near.push((node.id, savable_bits));
            }
        });
        if self.most_bits(near.iter().copied(), earliest) <= self.best.0 {
            return;
        }
        // Where on the circle each comes into range, and where it leaves it.
        let mut is_in_range = vec![false; near.len()];
        let mut events: Vec<(f64, bool, usize)> = Vec::with_capacity(2 * near.len());
        for (index, &(other, _)) in near.iter().enumerate() {
            let apart = table.sensors.position(other) - position;
            let half = (apart.norm() / (2.0 * radius_m)).min(1.0).acos();
            if apart.norm_squared() == 0.0 {
                is_in_range[index] = true;
                continue;
            }
            let middle = apart.y.atan2(apart.x);
            let [begin, end] = [middle - half, middle + half].map(|angle| (angle + PI).rem_euclid(TAU));
            is_in_range[index] = end < begin;
            events.extend([(begin, false, index), (end, true, index)]);
        }
        events.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut has_grown = true;
        for (_, is_end, index) in events {
            if is_end && has_grown {
                self.try_set(&near, &is_in_range, earliest);
            }
            has_grown = !is_end;
            is_in_range[index] = !is_end;
        }
        if has_grown {
            self.try_set(&near, &is_in_range, earliest);
        }
    }

    /// Tries the points from which those of `near` that are `is_in_range` together are served.
    fn try_set(&mut self, near: &[(u32, f64)], is_in_range: &[bool], earliest: f64) {
        let members = || near.iter().zip(is_in_range).filter(|(_, is_in_range)| **is_in_range).map(|(near, _)| *near);
        if self.most_bits(members(), earliest) <= self.best.0 {
            return;
        }
        let points: Vec<Position> = members().map(|(id, _)| *self.table.sensors.position(id)).collect();
        let Circle { centre, radius_m2 } = Circle::around(&points);
        let spare_m = (self.table.limits.comm_radius_m - radius_m2.sqrt()).max(0.0);
        let nearest = Disk { centre, radius_m: spare_m };
        for point in [centre, nearest_in_both(&self.start, &nearest, &nearest)] {
            let point = self.table.airspace.nearest(&point);
            let saved_bits = self.saved_bits(&point);
            if saved_bits > self.best.0 {
                self.best = (saved_bits, point);
            }
        }
    }

    /// Slots that serve at the end of the slot `first` and later, and before the last sample.
    fn serving_slots(&self, first: f64) -> f64 {
        (self.table.limits.slots as f64 - first).max(0.0)
    }

    /// What SN `id` loses if it is never served, and not before the slot `first` [bit, weighted].
    fn savable_bits(&self, id: u32, first: f64) -> f64 {
        let sampler = self.table.sensors.sampler(id);
        let capacity_bits = f64::from(sampler.stored_bits());
        let lost_bits =
            |slots: f64| (self.initial_bits.min(capacity_bits) + sampler.mean_bits * slots - capacity_bits).max(0.0);
        let slots = self.table.limits.slots as f64;
        self.table.sensors.weights.factor(id as usize) * (lost_bits(slots) - lost_bits(first.min(slots)))
    }

    /// At most so much is saved of `sensors`, given with what each can lose [bit, weighted], from the slot `first` on:
    /// links carry all.
    fn most_bits(&self, sensors: impl Iterator<Item = (u32, f64)>, first: f64) -> f64 {
        let MissionTable { sensors: all, limits, .. } = self.table;
        let full_bits = |id: u32| all.weights.factor(id as usize) * f64::from(all.sampler(id).capacity_bits);
        let [sum_bits, largest_bits] = sensors.fold([0.0, 0.0], |[sum_bits, largest_bits]: [f64; 2], (id, bits)| {
            [sum_bits + bits, largest_bits.max(full_bits(id))]
        });
        sum_bits.min(largest_bits * self.serving_slots(first) * limits.blocks() as f64)
    }

    /// Weighted bits that are not lost because the UAV hovers at `point`: the resource blocks from its arrival on go to
    /// the links that carry most, each at most as often as its SN needs it.
    fn saved_bits(&mut self, point: &Position) -> f64 {
        let table = self.table;
        let MissionTable { sensors, limits, .. } = table;
        let first = table.motion.slots_into(&self.start, &Disk { centre: *point, radius_m: 0.0 });
        let slots = self.serving_slots(first);
        let mut visits: Vec<(f64, f64)> = Vec::new(); // bits of one, and how many
        sensors.grid.visit_within(point, limits.comm_radius_m, |node| {
            let savable_bits = self.savable_bits(node.id, first);
            let taken_bits = self.taken_bits(node.id, point);
            let taken_bits = sensors.weights.factor(node.id as usize) * taken_bits;
            if savable_bits > 0.0 && taken_bits > 0.0 {
                visits.push((taken_bits, (savable_bits / taken_bits).min(slots)));
            }
        });
        visits.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut blocks = slots * limits.blocks() as f64;
        let saved_bits = |&(taken_bits, needed): &(f64, f64)| {
            let visits = needed.min(blocks);
            blocks -= visits;
            taken_bits * visits
        };
        visits.iter().map(saved_bits).sum()
    }

    /// Bits that a visit from above `point` [m] is expected to take of SN `id`, of a full buffer at most. Over a random
    /// channel interpolated: a mean over draws takes thousands of rates.
    fn taken_bits(&mut self, id: u32, point: &Position) -> f64 {
        let MissionTable { sensors, channel, limits, .. } = self.table;
        let capacity_bits = sensors.sampler(id).capacity_bits;
        let gain = sensors.gains[id as usize];
        let uplink = channel.uplink(gain, sensors.position(id), &above(point, self.altitude_m));
        let taken = |rate_bps: f64| channel.capacity_bits(rate_bps).min(capacity_bits.into()) as f64;
        if !channel.is_random() || channel.map().is_some() {
            return channel.mean_over_draws(&uplink, &taken);
        }
        let Uplink { d2_m2, in_sight, .. } = uplink;
        let mean_bits = |d2_m2: f64| {
            channel.mean_over_draws(&Uplink { in_sight, ..channel.uplink_at(gain, d2_m2, self.altitude_m) }, &taken)
        };
        let step_m = limits.comm_radius_m / (DISTANCES - 1) as f64;
        let key = (if channel.has_own_gains() { gain.to_bits() } else { 0 }, capacity_bits, in_sight);
        let at_steps = || std::array::from_fn(|step| mean_bits((step as f64 * step_m).powi(2)));
        let bits = self.taken_bits.entry(key).or_insert_with(at_steps);
        let steps = (d2_m2.sqrt() / step_m).min((DISTANCES - 1) as f64);
        let step = (steps as usize).min(DISTANCES - 2);
        bits[step] + (steps - step as f64) * (bits[step + 1] - bits[step])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strategy::OwnedSetup;
    use crate::strategy::tests::{over, view};
    use skysink_common::message::SensorNode;
    use skysink_common::random::{Purpose, Streams, fraction};
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    /// SNs by position [m] and rate [bit/s] with buffers of 300 bit, empty at first, over `slots` of 1 s from (50, 50).
    fn field(slots: u64, keys: &str, sensors: &[([f64; 2], f64)]) -> OwnedSetup {
        let text = format!(
            "name = 'a'\nslots = {slots}\n[sensors]\ninitial_queue_mean_bits = 0.0\ncapacity_bits = 300\n{keys}"
        );
        let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
        let node = |&([x_m, y_m], sampling_bps): &([f64; 2], f64)| SensorNode {
            x_m,
            y_m,
            sampling_bps,
            capacity_bits: 300,
            gain: 10f64.powf(-5.2),
            ..SensorNode::default()
        };
        over(scenario, sensors.iter().map(node).collect())
    }

    fn best(field: &OwnedSetup) -> (f64, Position) {
        let mut search = BestPoint::new(&field.table, &field.scenario);
        let point = search.found(&Stop::default());
        (search.saved_bits(&point), point)
    }

    #[test]
    fn the_hover_point_maximises_the_savings() {
        // 20 slots. Each SN loses 2 000 − 300 bit unserved. In range of (50, 50) is one; of (80, 50), in one slot, two,
        // that lose nothing until served; of (5, 50), in two slots, three, and in the first two slots they lose
        // nothing.
        let near = [([50.0, 50.0], 100.0), ([72.0, 50.0], 100.0), ([88.0, 50.0], 100.0)];
        assert_eq!(best(&field(20, "", &near)), (2.0 * 1_700.0, Position::new(80.0, 50.0)));
        let far = [([5.0, 42.0], 100.0), ([5.0, 50.0], 100.0), ([5.0, 58.0], 100.0)];
        let all = [&near[..], &far].concat();
        let (saved_bits, point) = best(&field(20, "", &all));
        assert_eq!(saved_bits, 3.0 * 1_700.0);
        assert!((point - Position::new(5.0, 50.0)).norm() <= 2.0 + 1e-9, "in range of all three: {point}");
        // With one block, at most 300 bit in each of 19 and of 18 slots: more than 3 400 and 5 100.
        assert_eq!(best(&field(20, "[link]\nresource_blocks = 1\n", &all)).0, 3.0 * 1_700.0);
        // In 4 slots, the near two lose 100 bit each, and so do the far three.
        assert_eq!(best(&field(4, "", &all)).0, 300.0);
        // In 3 slots nobody loses anything: stay.
        assert_eq!(best(&field(3, "", &all)), (0.0, Position::new(50.0, 50.0)));
    }

    #[test]
    fn weights_change_the_hover_point_and_the_schedule() {
        // Two SNs within a slot, three farther away: by their bits the far ones count more, by weights of 4 the near
        // ones.
        let sensors = [[50.0, 50.0], [60.0, 50.0], [5.0, 42.0], [5.0, 50.0], [5.0, 58.0]];
        let weighted = |weights: [f64; 5]| {
            let plain = field(20, "[link]\nresource_blocks = 1\n", &sensors.map(|position| (position, 100.0)));
            let nodes = sensors.iter().zip(weights).map(|(&[x_m, y_m], weight)| {
                let gain = 10f64.powf(-5.2);
                SensorNode { x_m, y_m, sampling_bps: 100.0, capacity_bits: 300, gain, weight, ..SensorNode::default() }
            });
            over(plain.scenario, nodes.collect())
        };
        assert!((best(&weighted([1.0; 5])).1 - Position::new(5.0, 50.0)).norm() <= 2.0 + 1e-9);
        let field = weighted([4.0, 4.0, 1.0, 1.0, 1.0]);
        assert_eq!(best(&field).1, Position::new(55.0, 50.0));
        let field = weighted([1.0, 4.0, 1.0, 1.0, 1.0]);
        let mut serving = Serving::new(&field.setup());
        let full = [300; 5];
        let decision =
            serve_urgent(&mut serving, &view(&field.table, 1, [55.0, 50.0], &full), &Position::new(55.0, 50.0));
        assert_eq!(decision.schedule[..], [1], "both overflow, one weighs more");
    }

    #[test]
    fn savings_are_limited_by_the_capacity_of_the_link() {
        // One SN of 300 bit/s, and a silent one, over 21 slots: 20 visits of what W = 100 Hz carries from above.
        let field = field(21, "[link]\nbandwidth_hz = 100.0\n", &[([50.0, 50.0], 300.0), ([50.0, 51.0], 0.0)]);
        let uplink = Uplink::at(10f64.powf(-5.2), 0.0, 20.0);
        let channel = &field.table.channel;
        let carried_bits = channel.capacity_bits(channel.expected_rate_bps(&uplink));
        assert!((1..300).contains(&carried_bits));
        assert_eq!(best(&field), (20.0 * carried_bits as f64, Position::new(50.0, 50.0)));
    }

    #[test]
    fn capacities_of_a_random_channel_are_interpolated() {
        let link = "[link]\nmodel = 'probabilistic-los'\nbandwidth_hz = 300.0\ncomm_radius_m = 60.0\n";
        let field = field(21, link, &[([50.0, 50.0], 300.0), ([50.0, 51.0], 300.0)]);
        let mut search = BestPoint::new(&field.table, &field.scenario);
        for d_m in [0.0, 3.7, 20.2, 41.0, 59.9, 60.0] {
            let uplink = Uplink::at(10f64.powf(-5.2), d_m * d_m, 20.0);
            let channel = &field.table.channel;
            let taken = |rate_bps: f64| channel.capacity_bits(rate_bps).min(300) as f64;
            let [direct, found] =
                [channel.mean_over_draws(&uplink, &taken), search.taken_bits(1, &Position::new(50.0 + d_m, 51.0))];
            assert!(direct > 5.0 && (found / direct - 1.0).abs() < 0.03, "{found} and {direct} at {d_m} m");
        }
        assert_eq!(search.taken_bits.len(), 1, "one gain, one buffer");
    }

    #[test]
    fn no_point_of_a_fine_grid_has_larger_savings() {
        for seed in 0..40 {
            let mut random = Streams::new(seed).stream(Purpose::Position, 0, 0);
            let mut sensor =
                || ([100.0, 100.0].map(|side_m| side_m * fraction(&mut random)), 20.0 + 180.0 * fraction(&mut random));
            let sensors: Vec<_> = (0..3 + seed % 40).map(|_| sensor()).collect();
            // The whole area is in reach, and n links carry what few SNs or many sample.
            let field = field(30, "[uav]\nmax_speed_mps = 90.0\n[link]\nresource_blocks = 2\n", &sensors);
            let mut search = BestPoint::new(&field.table, &field.scenario);
            let (most_bits, _) = best(&field);
            let along = || (0..=200).map(|step| 0.5 * f64::from(step));
            for (x_m, y_m) in along().flat_map(|x_m| along().map(move |y_m| (x_m, y_m))) {
                let saved_bits = search.saved_bits(&Position::new(x_m, y_m));
                assert!(saved_bits <= most_bits * (1.0 + 1e-12), "seed {seed}: {saved_bits} at ({x_m}, {y_m})");
            }
        }
    }

    #[test]
    fn hover_flies_straight_to_its_point_and_serves_in_passing() {
        let sensors = [[10.0, 8.0], [10.0, 12.0], [50.0, 50.0], [90.0, 90.0]].map(|position| (position, 100.0));
        let field = field(60, "", &sensors);
        let mut hover = (STRATEGY.make)(&field.setup());
        // (10, 10) is 56.6 m away, in two slots.
        let full = [300; 4];
        let first = hover.plan(&view(&field.table, 1, [50.0, 50.0], &full)).unwrap();
        let goal = hover.plan(&view(&field.table, 2, first.waypoint.xy().into(), &full)).unwrap();
        assert_eq!(
            (first.schedule.len(), &goal.schedule[..]),
            (0, &[0, 1][..]),
            "30 m from the start nobody is in range"
        );
        let along = goal.waypoint - first.waypoint;
        let flown = first.waypoint.xy() - Position::new(50.0, 50.0);
        assert!((flown.norm() - 30.0).abs() < 1e-9 && along.xy().normalize().dot(&flown.normalize()) > 1.0 - 1e-9);
        let passing = hover.plan(&view(&field.table, 1, [78.0, 78.0], &full)).unwrap();
        assert_eq!(passing.schedule[..], [2], "30 m from (78, 78), on the way");
    }

    #[test]
    fn hover_serves_all_in_range_by_turns_without_loss_if_feasible() {
        // 300 bit fill in 3 slots, and n = 4 serve 12 SNs in 3 slots, each just in time.
        let sensors: Vec<_> = (0..12).map(|index| ([50.0 + 0.5 * f64::from(index), 50.0], 100.0)).collect();
        let field = field(60, "", &sensors);
        let mut hover = (STRATEGY.make)(&field.setup());
        let mut queues_bits = [0u32; 12];
        let mut ground = [50.0, 50.0];
        for slot in 1..=60 {
            let decision = hover.plan(&view(&field.table, slot, ground, &queues_bits)).unwrap();
            ground = decision.waypoint.xy().into();
            queues_bits.iter_mut().for_each(|queue_bits| *queue_bits += 100);
            assert!(queues_bits.iter().all(|queue_bits| *queue_bits <= 300), "slot {slot}: {queues_bits:?}");
            decision.schedule.iter().for_each(|&id| queues_bits[id as usize] = 0);
        }
    }

    #[test]
    fn a_stop_signal_ends_the_search() {
        let field = field(20, "", &[([72.0, 50.0], 100.0)]);
        let stop = Stop::default();
        stop.flag().store(2, std::sync::atomic::Ordering::Relaxed);
        assert_eq!(BestPoint::new(&field.table, &field.scenario).found(&stop), Position::new(50.0, 50.0));
    }
}
