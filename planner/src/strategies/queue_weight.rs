//! The search of `max-weight` and `drift-plus-penalty`: maximises queue-weighted service less a price for energy.
//!
//! The objective is `Σ Q_i min(Q_i, floor(r_i τ_c)) − V E` over candidate waypoints and all sets of at most n sensor
//! nodes (SNs) in range of them. `Q_i = B_i(t−1)` is the known or estimated queue [bit], `r_i` the (expected) rate from
//! the waypoint, and `E = P(v) τ` the propulsion energy [J] of a slot at the speed v that it takes to get there, with
//! `P` of [`skysink_common::propulsion`]. For a given waypoint the best set is found exactly: the n largest terms.
//!
//! The candidate waypoints:
//! - the position of the UAV;
//! - for every SN that can be served from within reach, the point in reach nearest to the SN (above it, if that is in
//!   reach) and the point in range of the SN nearest to the UAV;
//! - the centre of the set of [`exact`](super::exact).
//!
//! If more than [`MOST_NEARBY`] SNs can be served from within reach, only the fullest of them give candidates. With a
//! free altitude, candidates are compared at the UAV's altitude; the best then gets the altitude that serves its set
//! best, as in `gfs`. The solution of sP2 for that set replaces it if its objective is higher.

use std::cmp::Reverse;

use nalgebra::Point3;
use skysink_common::channel::{ChannelModel, Uplink};
use skysink_common::checkpoint::Checkpoint;
use skysink_common::geometry::{Position, above, within};
use skysink_common::propulsion::power_w;
use skysink_common::scenario::Propulsion;

use super::exact::ExactSearch;
use super::nearby::fullest_first;
use super::serving::Serving;
use super::transit::toward;
use crate::geometry::disks::{Disk, project};
use crate::strategy::{Decision, Setup, Strategy, View};

/// Most SNs that give candidate waypoints. It keeps the time of a slot linear, not quadratic, in the SNs near the UAV.
pub(crate) const MOST_NEARBY: usize = 64;

/// Both strategies: they differ in the price for energy only.
pub(crate) struct QueueWeight {
    objective: Objective,
    exact: ExactSearch,
    serving: Serving,
    /// The SNs that can be served from within reach, ascending by id.
    nearby: Vec<u32>,
    /// The set of the exact search.
    exact_ids: Vec<u32>,
}

/// The objective.
struct Objective {
    /// Price of energy, V [bit²/J].
    price_bits2_per_j: f64,
    aircraft: Propulsion,
    slot_s: f64,
    /// The terms of the SNs in range [bit²], with their ids; working memory.
    terms: Vec<(Reverse<u64>, u32)>,
}

impl QueueWeight {
    /// Constructs the strategy for a price of energy V [bit²/J], 0 or above.
    pub fn new(setup: &Setup, price_bits2_per_j: f64) -> Self {
        let sensors = setup.table.sensors.positions.len();
        let objective = Objective {
            price_bits2_per_j,
            aircraft: setup.scenario.uav.propulsion,
            slot_s: setup.scenario.slot_s,
            terms: Vec::with_capacity(sensors),
        };
        Self {
            objective,
            exact: ExactSearch::new(setup.table),
            serving: Serving::new(setup),
            nearby: Vec::with_capacity(sensors),
            exact_ids: Vec::with_capacity(setup.table.limits.blocks()),
        }
    }

    /// Finds the SNs that can be served from within reach, at most [`MOST_NEARBY`], and returns whether any holds data.
    fn find_nearby(&mut self, view: &View) -> bool {
        let Self { nearby, .. } = self;
        let in_sight_m = view.table.limits.reach_m + view.table.limits.comm_radius_m;
        let queue_bits = |id: u32| view.belief.queues_bits[id as usize];
        nearby.clear();
        view.table.sensors.grid.visit_within(&view.ground(), in_sight_m, |node| nearby.push(node.id));
        if nearby.len() > MOST_NEARBY {
            nearby.select_nth_unstable_by_key(MOST_NEARBY, |&id| fullest_first(queue_bits(id), id));
            nearby.truncate(MOST_NEARBY);
        }
        nearby.sort_unstable();
        nearby.iter().any(|&id| queue_bits(id) > 0)
    }

    /// The best candidate, as a point on the ground, compared at the UAV's altitude. Of equals the first wins, in the
    /// order of the module's list and by id (decision D7).
    fn best_ground(&mut self, view: &View) -> Position {
        let Self { objective, exact, nearby, exact_ids, .. } = self;
        let ground = view.ground();
        let table = view.table;
        let mut best = (objective.best_value(view, &view.position), ground);
        let mut offer = |candidate: Position| {
            let candidate = table.clamp_to_area(&candidate);
            let value = objective.best_value(view, &above(&candidate, view.position.z));
            if value > best.0 {
                best = (value, candidate);
            }
        };
        let reach = Disk { centre: ground, radius_m: table.limits.reach_m };
        for &id in &*nearby {
            let position = table.sensors.position(id);
            offer(toward(table.limits.reach_m, &ground, position));
            let range = Disk { centre: *position, radius_m: table.limits.comm_radius_m };
            if !within(position, &ground, table.limits.comm_radius_m)
                && let Some(nearest) = project(&ground, &[reach, range])
            {
                offer(nearest);
            }
        }
        if let Some(centre) = exact.best_set(table, &ground, view.belief.queues_bits, exact_ids) {
            offer(centre);
        }
        best.1
    }
}

impl Objective {
    /// The term of SN `id` with the UAV at `uav` [bit²]: `Q_i min(Q_i, floor(r_i τ_c))`.
    fn term_bits2(view: &View, uav: &Point3<f64>, id: u32) -> u64 {
        let table = view.table;
        let queue_bits = u64::from(view.belief.queues_bits[id as usize]);
        let uplink = Uplink::new(table.sensors.gains[id as usize], table.sensors.position(id), uav);
        // Both factors are below 2^32.
        queue_bits * table.channel.capacity_bits(table.channel.expected_rate_bps(&uplink)).min(queue_bits)
    }

    /// The energy [J] of flying to `uav` in the slot.
    fn energy_j(&self, view: &View, uav: &Point3<f64>) -> f64 {
        power_w(&self.aircraft, (uav - view.position).norm() / self.slot_s) * self.slot_s
    }

    /// The objective [bit²] at `uav`, with the SNs that contribute `terms_bits2`.
    fn value(&self, view: &View, uav: &Point3<f64>, terms_bits2: impl Iterator<Item = u64>) -> f64 {
        let sum_bits2: u128 = terms_bits2.map(u128::from).sum();
        let price = if self.price_bits2_per_j > 0.0 { self.price_bits2_per_j * self.energy_j(view, uav) } else { 0.0 };
        sum_bits2 as f64 - price
    }

    /// The objective [bit²] at `uav` with the SNs `ids`.
    fn value_of(&self, view: &View, uav: &Point3<f64>, ids: &[u32]) -> f64 {
        self.value(view, uav, ids.iter().map(|&id| Self::term_bits2(view, uav, id)))
    }

    /// The objective [bit²] at `uav` with the best set of SNs in range.
    fn best_value(&mut self, view: &View, uav: &Point3<f64>) -> f64 {
        let mut terms = std::mem::take(&mut self.terms);
        terms.clear();
        view.table.sensors.grid.visit_within(&uav.xy(), view.table.limits.comm_radius_m, |node| {
            terms.push((Reverse(Self::term_bits2(view, uav, node.id)), node.id));
        });
        if terms.len() > view.table.limits.blocks() {
            terms.select_nth_unstable(view.table.limits.blocks());
            terms.truncate(view.table.limits.blocks());
        }
        let value = self.value(view, uav, terms.iter().map(|(Reverse(term), _)| *term));
        self.terms = terms;
        value
    }
}

impl Checkpoint for QueueWeight {}

impl Strategy for QueueWeight {
    /// `None` if no SN that can be served from within reach holds data.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        if !self.find_nearby(view) {
            return None;
        }
        let ground = self.best_ground(view);
        let uav = above(&ground, view.position.z);
        let key = |id: u32| (Reverse(Objective::term_bits2(view, &uav, id)), id);
        let decision = self.serving.serve_by(view, &ground, key);
        if decision.schedule.is_empty() {
            return Some(decision);
        }
        let value = self.objective.value_of(view, &decision.waypoint, &decision.schedule);
        let solved = self.serving.waypoint(view, &decision.schedule);
        let solved = solved.map(|waypoint| Decision::serve(view, &waypoint, &decision.schedule));
        let is_better = |other: &Decision| self.objective.value_of(view, &other.waypoint, &other.schedule) > value;
        Some(solved.filter(is_better).unwrap_or(decision))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strategy::tests::{field, view};
    use crate::strategy::{OwnedSetup, Strategy};
    use proptest::prelude::*;
    use skysink_common::channel::Channel;
    use skysink_common::message::SolverOutcome;

    /// The field of SNs at these positions [m], with links of `bandwidth_hz`.
    fn field_of(positions_m: &[[f64; 2]], bandwidth_hz: f64) -> OwnedSetup {
        let mut field = field(positions_m.iter().map(|&position_m| (position_m, 100.0, 30_000)));
        let Channel::FreeSpace(model) = &mut field.table.channel else { panic!("the letter's channel is free space") };
        model.bandwidth_hz = bandwidth_hz;
        field.scenario.link.bandwidth_hz = bandwidth_hz;
        field
    }

    /// The decision from (50, 50).
    fn decided(field: &OwnedSetup, price: f64, queues_bits: &[u32]) -> Option<Decision> {
        QueueWeight::new(&field.setup(), price).plan(&view(&field.table, 1, [50.0, 50.0], queues_bits))
    }

    #[test]
    fn a_long_queue_outweighs_several_short_ones() {
        // 300² = 90 000 against 3 · 150² = 67 500, though 450 bit are more than 300.
        let field = field_of(&[[50.0, 75.0], [25.0, 50.0], [25.0, 51.0], [25.0, 52.0]], 5e6);
        let decision = decided(&field, 0.0, &[300, 150, 150, 150]).unwrap();
        assert_eq!((decision.waypoint.xy(), &decision.schedule[..]), (field.table.sensors.positions[0], &[0][..]));
        // 3 · 180² = 97 200.
        let decision = decided(&field, 0.0, &[300, 180, 180, 180]).unwrap();
        assert_eq!(decision.schedule[..], [1, 2, 3]);
    }

    #[test]
    fn where_links_limit_it_the_queue_weighs_what_the_link_carries() {
        // From straight above a link of 5 kHz carries 6 472 bit (see `mission_table`), so that SN 0 is worth 20 000 · 6
        // 472 = 1.29e8, and each of the pair, in range of one point and 10 m from it, at most 8 000 · 6 472 = 5.2e7,
        // both 1.04e8.
        let field = field_of(&[[50.0, 75.0], [25.0, 45.0], [25.0, 55.0]], 5e3);
        let decision = decided(&field, 0.0, &[20_000, 8_000, 8_000]).unwrap();
        assert_eq!((decision.waypoint.xy(), &decision.schedule[..]), (field.table.sensors.positions[0], &[0][..]));
        // Above SN 1, 10 m from SN 2, they are worth 15 000 (6 472 + 6 311) = 1.92e8.
        let decision = decided(&field, 0.0, &[20_000, 15_000, 15_000]).unwrap();
        assert_eq!(decision.schedule[..], [1, 2]);
        assert_ne!(decision.outcome, SolverOutcome::Rule, "between them sP2 finds a better point than above one");
    }

    #[test]
    fn a_price_on_energy_keeps_it_from_flying_fast() {
        // 25 m/s cost P = 90.258 + 14.282 + 144.416 = 248.96 W (profile, induced and drag power), 15 m/s, to where it
        // is in range, 83.603 + 23.750 + 31.194 = 138.55 W, and to hover 168.49 W.
        let field = field_of(&[[50.0, 75.0]], 5e6);
        let waypoint = |price, queue_bits| decided(&field, price, &[queue_bits]).unwrap().waypoint.y;
        assert_eq!(waypoint(0.0, 1_000), 75.0, "of equals the first: above it");
        assert!((waypoint(1.0, 1_000) - 65.0).abs() < 1e-9, "in range it is worth the same, for 110 J less");
        assert!((waypoint(1e9, 1_000) - 65.0).abs() < 1e-9, "and less than to hover");
        // SN 0 below, SN 1 40 m away: 30 m/s to it cost 94.834 + 11.904 + 249.551 = 356.29 W, 187.80 J more than to
        // hover, for 1 000² − 500² = 750 000 bit² more: worth it up to V = 750 000 / 187.80 = 3 993.6.
        let field = field_of(&[[50.0, 50.0], [50.0, 90.0]], 5e6);
        let schedule = |price| decided(&field, price, &[500, 1_000]).unwrap().schedule.to_vec();
        assert_eq!(schedule(3_993.0), [1]);
        assert_eq!(schedule(3_994.0), [0]);
    }

    #[test]
    fn with_nothing_to_collect_in_reach_nothing_is_decided() {
        assert!(decided(&field_of(&[[50.0, 90.1]], 5e6), 0.0, &[9]).is_none(), "40.1 m away");
        assert!(decided(&field_of(&[[50.0, 90.0]], 5e6), 0.0, &[9]).is_some(), "40 m away");
        assert!(decided(&field_of(&[[50.0, 60.0]], 5e6), 0.0, &[0]).is_none(), "empty");
        assert!(decided(&field_of(&[], 5e6), 0.0, &[]).is_none());
    }

    #[test]
    fn more_sensor_nodes_than_are_compared_lose_the_emptiest() {
        let positions: Vec<[f64; 2]> = (0..MOST_NEARBY + 50).map(|id| [40.0 + 0.05 * id as f64, 50.0]).collect();
        let field = field_of(&positions, 5e6);
        let mut strategy = QueueWeight::new(&field.setup(), 0.0);
        let queues_bits: Vec<u32> = (0..positions.len() as u32).map(|id| id % 300).collect();
        assert!(strategy.find_nearby(&view(&field.table, 1, [50.0, 50.0], &queues_bits)));
        assert_eq!(strategy.nearby.len(), MOST_NEARBY);
        assert!(strategy.nearby.is_sorted() && strategy.nearby.iter().all(|&id| queues_bits[id as usize] >= 44));
    }

    /// The objective of all sets of at most n SNs in range of `ground`, by enumeration.
    fn best_by_enumeration(objective: &Objective, view: &View, ground: &Position) -> f64 {
        let uav = above(ground, view.position.z);
        let in_range = |id: &u32| within(view.table.sensors.position(*id), ground, view.table.limits.comm_radius_m);
        let ids: Vec<u32> = view.table.sensors.ids().filter(in_range).collect();
        let sets = (0u32..1 << ids.len()).filter(|set| set.count_ones() as usize <= view.table.limits.blocks());
        let value = |set: u32| {
            let members: Vec<u32> = (0..).zip(&ids).filter(|(bit, _)| set >> bit & 1 == 1).map(|(_, &id)| id).collect();
            objective.value_of(view, &uav, &members)
        };
        sets.map(value).fold(f64::NEG_INFINITY, f64::max)
    }

    proptest! {
        /// Against every set of SNs in range of every SN in reach and of where the UAV is; and, where a slot serves one
        /// SN whose queue it empties, against the fullest queue that can be served.
        #[test]
        fn no_candidate_and_no_set_is_better(
            sensors in prop::collection::vec(([20.0..80.0, 20.0..80.0], 0u32..9_000), 1..8),
            blocks in 1usize..5, bandwidth_hz in prop_oneof![Just(5e6), Just(2e3)],
            price in prop_oneof![Just(0.0), 1e2..1e6],
        ) {
            let (positions, queues_bits): (Vec<[f64; 2]>, Vec<u32>) = sensors.into_iter().unzip();
            let mut field = field_of(&positions, bandwidth_hz);
            field.table.limits.resource_blocks = blocks as u32;
            field.scenario.link.resource_blocks = blocks;
            let mut strategy = QueueWeight::new(&field.setup(), price);
            let view = view(&field.table, 1, [50.0, 50.0], &queues_bits);
            let Some(decision) = strategy.plan(&view) else {
                let reachable = |id: &u32| within(view.table.sensors.position(*id), &view.ground(), 40.0);
                prop_assert!(!view.table.sensors.ids().filter(reachable).any(|id| queues_bits[id as usize] > 0));
                return Ok(());
            };
            let own = strategy.objective.value_of(&view, &decision.waypoint, &decision.schedule);
            let tolerance = 1e-9 * own.abs().max(1.0);
            for id in view.table.sensors.ids().filter(|id| within(view.table.sensors.position(*id), &view.ground(), 30.0)) {
                let other = best_by_enumeration(&strategy.objective, &view, view.table.sensors.position(id));
                prop_assert!(own >= other - tolerance, "above SN {id}: {other} against {own}");
            }
            let hovering = best_by_enumeration(&strategy.objective, &view, &view.ground());
            prop_assert!(own >= hovering - tolerance, "hovering: {hovering} against {own}");
            prop_assert!(within(&decision.waypoint.xy(), &view.ground(), 30.0));
            if blocks == 1 && price == 0.0 && bandwidth_hz == 5e6 {
                // One SN per slot and links that empty queues: the square of the fullest queue within 40 m.
                let reachable = |id: &u32| within(view.table.sensors.position(*id), &view.ground(), 40.0);
                let fullest = view.table.sensors.ids().filter(reachable).map(|id| queues_bits[id as usize]).max().unwrap();
                prop_assert_eq!(own, f64::from(fullest) * f64::from(fullest));
            }
        }
    }
}
