//! The search of `max-weight` and `drift-plus-penalty`: maximises queue-weighted service less a price for energy.
//!
//! The objective is `Σ Q_i b_i − V E` over candidate waypoints and all sets of at most n sensor nodes (SNs) in range of
//! them. `Q_i = B_i(t−1)` is the known or estimated queue [bit], `E = P(v) τ` the propulsion energy [J] of a slot at
//! the speed v that it takes to get there, with `P` of [`skysink_common::propulsion`], and `b_i` the [`Service`], of
//! the (expected) rate `r_i` from the waypoint. Where weights differ, `w_i Q_i` is in place of `Q_i` (decision D25).
//! For a given waypoint the best set is found exactly: the n largest terms.
//!
//! Without a price, and with the upload as the service, the candidate waypoints are:
//! - the position of the UAV;
//! - for every SN that can be served from within reach, the point in reach nearest to the SN (above it, if that is in
//!   reach) and the point in range of the SN nearest to the UAV;
//! - the centre of the set of [`exact`](super::exact).
//!
//! With a free altitude, these are compared at the UAV's altitude; the best then gets the altitude that serves its set
//! best, as in `gfs`. The solution of sP2 for that set replaces it if its objective is higher. A set of other points
//! may be better still.
//!
//! Otherwise the candidates are those of [`peaks`], which include the maximum of the objective where links empty the
//! queues, and searches from the best of them where they do not.
//!
//! If more than [`MOST_NEARBY`] SNs can be served from within reach, only the fullest of them give candidates.

mod objective;
mod peaks;

use std::cmp::Reverse;

use skysink_common::checkpoint::Checkpoint;
use skysink_common::geometry::{Position, above, within};
use skysink_common::message::SolverOutcome;
use skysink_common::propulsion::least_power_mps;

use self::objective::QueueWeightObjective;
pub(crate) use self::objective::Service;
use self::peaks::Best;
use super::exact::ExactSearch;
use crate::geometry::disks::{Disk, project};
use crate::serving::Serving;
use crate::serving::nearby::fullest_first;
use crate::strategy::{Decision, Setup, Strategy, View};

/// Most SNs that give candidate waypoints. It keeps the time of a slot linear, not quadratic, in the SNs near the UAV.
pub(crate) const MOST_NEARBY: usize = 64;

/// Both strategies: they differ in service and price only.
pub(crate) struct QueueWeight {
    objective: QueueWeightObjective,
    exact: ExactSearch,
    serving: Serving,
    /// The SNs that can be served from within reach, ascending by id.
    nearby: Vec<u32>,
    /// The set of the exact search.
    exact_ids: Vec<u32>,
    /// Memory for the values of queues.
    room: Vec<u32>,
    /// Distance of least propulsion energy in a slot [m].
    slow_m: f64,
}

impl QueueWeight {
    /// Constructs the strategy for a price of energy V [bit²/J], 0 or above.
    pub fn new(setup: &Setup, price_bits2_per_j: f64, service: Service) -> Self {
        let sensors = setup.table.sensors.positions.len();
        let uav = &setup.scenario.uav;
        let objective = QueueWeightObjective { price_bits2_per_j, service, terms: Vec::with_capacity(sensors) };
        Self {
            objective,
            exact: ExactSearch::new(setup.table),
            serving: Serving::new(setup),
            nearby: Vec::with_capacity(sensors),
            exact_ids: Vec::with_capacity(setup.table.limits.blocks()),
            room: Vec::new(),
            slow_m: least_power_mps(&uav.propulsion, uav.max_speed_mps) * setup.scenario.slot_s,
        }
    }

    /// Finds the SNs that can be served from within reach, at most [`MOST_NEARBY`], and returns whether any holds data.
    fn find_nearby(&mut self, view: &View) -> bool {
        let Self { nearby, .. } = self;
        let in_sight_m = view.table.limits.reach_m + view.table.limits.comm_radius_m;
        let value = |id: u32| view.value(id);
        nearby.clear();
        view.table.sensors.grid.visit_within(&view.ground(), in_sight_m, |node| nearby.push(node.id));
        if nearby.len() > MOST_NEARBY {
            nearby.select_nth_unstable_by_key(MOST_NEARBY, |&id| fullest_first(value(id), id));
            nearby.truncate(MOST_NEARBY);
        }
        nearby.sort_unstable();
        nearby.iter().any(|&id| value(id) > 0)
    }

    /// The best candidate, as a point on the ground, compared at the UAV's altitude. Of equals the first wins, in the
    /// order of the module's list and by id (decision D7).
    fn best_ground(&mut self, view: &View) -> Position {
        let Self { objective, exact, nearby, exact_ids, room, .. } = self;
        let ground = view.ground();
        let table = view.table;
        let mut best = (objective.best_value(view, &view.position), ground);
        let mut offer = |candidate: Position| {
            let candidate = table.clamp_to_area(&candidate);
            if !table.airspace.is_free(&ground, &candidate) {
                return;
            }
            let value = objective.best_value(view, &above(&candidate, view.position.z));
            if value > best.0 {
                best = (value, candidate);
            }
        };
        let reach = Disk { centre: ground, radius_m: table.limits.reach_m };
        for &id in &*nearby {
            let position = table.sensors.position(id);
            offer(table.motion.toward(&ground, position));
            let range = Disk { centre: *position, radius_m: table.limits.comm_radius_m };
            if !within(position, &ground, table.limits.comm_radius_m)
                && let Some(nearest) = project(&ground, &[reach, range])
            {
                offer(nearest);
            }
        }
        if let Some(centre) = exact.best_set(table, &ground, view.told(view.values(room)), exact_ids) {
            offer(centre);
        }
        best.1
    }

    /// The decision for the best candidate of [`peaks`], or the end of a search from the best of them.
    fn peak(&mut self, view: &View) -> Decision {
        self.nearby.sort_unstable_by_key(|&id| fullest_first(view.value(id), id));
        let Self { objective, exact, nearby, exact_ids, slow_m, room, .. } = self;
        let ground = view.ground();
        let table = view.table;
        let mut best = Best::default();
        let mut offer = |candidate: Position| {
            let candidate = table.clamp_to_area(&candidate);
            if within(&candidate, &ground, table.limits.reach_m) && table.airspace.is_free(&ground, &candidate) {
                let point = above(&candidate, view.position.z);
                best.offer((objective.best_value(view, &point), point));
            }
        };
        peaks::visit(view, *slow_m, nearby, &mut offer);
        if let Some(centre) = exact.best_set(table, &ground, view.told(view.values(room)), exact_ids) {
            offer(centre);
        }
        let peak = if objective.is_level(view, nearby) {
            best.first()
        } else {
            best.climbed(view, |point| objective.best_value(view, point))
        };
        let waypoint = peak.map_or(view.position, |(_, point)| point);
        let schedule = objective.best_set(view, &waypoint);
        Decision { waypoint, schedule, outcome: SolverOutcome::Rule, winner: None }
    }
}

impl Checkpoint for QueueWeight {}

impl Strategy for QueueWeight {
    /// `None` if no SN that can be served from within reach holds data.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        if !self.find_nearby(view) {
            return None;
        }
        if !self.objective.is_plain() {
            return Some(self.peak(view));
        }
        let ground = self.best_ground(view);
        let uav = above(&ground, view.position.z);
        let key = |id: u32| (Reverse(self.objective.term_bits2(view, &uav, id)), id);
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
        QueueWeight::new(&field.setup(), price, Service::Upload).plan(&view(&field.table, 1, [50.0, 50.0], queues_bits))
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
    fn queue_weights_are_limited_by_the_capacity_of_the_link() {
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
    fn a_price_on_energy_reduces_speed() {
        // 25 m/s cost P = 90.258 + 14.282 + 144.416 = 248.96 W (profile, induced and drag power), 15 m/s, to where it
        // is in range, 83.603 + 23.750 + 31.194 = 138.55 W, and to hover 168.49 W.
        let field = field_of(&[[50.0, 75.0]], 5e6);
        let waypoint = |price, queue_bits| decided(&field, price, &[queue_bits]).unwrap().waypoint.y;
        assert_eq!(waypoint(0.0, 1_000), 75.0, "of equals the first: above it");
        assert!((waypoint(1.0, 1_000) - 65.0).abs() < 1e-9, "in range it is worth the same, for 110 J less");
        // 10.213 m/s, which cost least, take 126.007 W, 12.540 J less: 1 000² bit² are worth it up to V = 79 745.
        assert!((waypoint(7.97e4, 1_000) - 65.0).abs() < 1e-9);
        assert!((waypoint(7.98e4, 1_000) - 60.213).abs() < 1e-3, "dearer, it flies slowly");
        // SN 0 below, SN 1 40 m away: 30 m/s to it cost 94.834 + 11.904 + 249.551 = 356.289 W, 230.255 J more than 10
        // m/s to the rim of SN 0's range, for 1 000² − 500² = 750 000 bit² more: worth it up to V = 750 000 / 230.255 =
        // 3 257.3.
        let field = field_of(&[[50.0, 50.0], [50.0, 90.0]], 5e6);
        let schedule = |price| decided(&field, price, &[500, 1_000]).unwrap().schedule.to_vec();
        assert_eq!(schedule(3_257.0), [1]);
        assert_eq!(schedule(3_258.0), [0]);
    }

    #[test]
    fn a_high_price_gives_the_speed_of_least_power_toward_and_past_the_fullest() {
        // 10.213 m/s cost 126.007 W, and nothing costs less.
        let field = field_of(&[[50.0, 20.0], [50.0, 80.0], [50.0, 54.0]], 5e6);
        let far = decided(&field, 1e9, &[7, 9, 0]).unwrap();
        assert!((far.waypoint.y - 60.213).abs() < 1e-3 && far.waypoint.x == 50.0, "{far:?}");
        assert_eq!(far.schedule[..], [2], "an empty queue in range");
        // SN 2, 4 m away, is still in range 6.213 m beyond it.
        let near = decided(&field, 1e9, &[7, 0, 8]).unwrap();
        assert!(((near.waypoint.xy() - Position::new(50.0, 50.0)).norm() - 10.213).abs() < 1e-3, "{near:?}");
        assert_eq!(near.schedule[..], [2]);
    }

    #[test]
    fn capacity_weights_do_not_depend_on_the_queue() {
        // A link carries about 6.7e6 bit from wherever it is in range: two of 60 bit outweigh one of 100.
        let field = field_of(&[[50.0, 75.0], [25.0, 50.0], [25.0, 52.0]], 5e6);
        let queues_bits = [100, 60, 60];
        let schedule = |service| {
            let mut strategy = QueueWeight::new(&field.setup(), 0.0, service);
            strategy.plan(&view(&field.table, 1, [50.0, 50.0], &queues_bits)).unwrap().schedule.to_vec()
        };
        assert_eq!(schedule(Service::Upload), [0]);
        assert_eq!(schedule(Service::Capacity), [1, 2]);
    }

    #[test]
    fn empty_queues_in_reach_give_no_decision() {
        assert!(decided(&field_of(&[[50.0, 90.1]], 5e6), 0.0, &[9]).is_none(), "40.1 m away");
        assert!(decided(&field_of(&[[50.0, 90.0]], 5e6), 0.0, &[9]).is_some(), "40 m away");
        assert!(decided(&field_of(&[[50.0, 60.0]], 5e6), 0.0, &[0]).is_none(), "empty");
        assert!(decided(&field_of(&[], 5e6), 0.0, &[]).is_none());
    }

    #[test]
    fn the_emptiest_candidates_beyond_the_limit_are_dropped() {
        let positions: Vec<[f64; 2]> = (0..MOST_NEARBY + 50).map(|id| [40.0 + 0.05 * id as f64, 50.0]).collect();
        let field = field_of(&positions, 5e6);
        let mut strategy = QueueWeight::new(&field.setup(), 0.0, Service::Upload);
        let queues_bits: Vec<u32> = (0..positions.len() as u32).map(|id| id % 300).collect();
        assert!(strategy.find_nearby(&view(&field.table, 1, [50.0, 50.0], &queues_bits)));
        assert_eq!(strategy.nearby.len(), MOST_NEARBY);
        assert!(strategy.nearby.is_sorted() && strategy.nearby.iter().all(|&id| queues_bits[id as usize] >= 44));
    }

    /// The objective of all sets of at most n SNs in range of `ground`, by enumeration.
    fn best_by_enumeration(objective: &QueueWeightObjective, view: &View, ground: &Position) -> f64 {
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
        fn no_other_candidate_or_set_is_better(
            sensors in prop::collection::vec(([20.0..80.0, 20.0..80.0], 0u32..9_000), 1..8),
            blocks in 1usize..5, bandwidth_hz in prop_oneof![Just(5e6), Just(2e3)],
            price in prop_oneof![Just(0.0), 1e2..1e6],
        ) {
            let (positions, queues_bits): (Vec<[f64; 2]>, Vec<u32>) = sensors.into_iter().unzip();
            let mut field = field_of(&positions, bandwidth_hz);
            field.table.limits.resource_blocks = blocks as u32;
            field.scenario.link.resource_blocks = blocks;
            let mut strategy = QueueWeight::new(&field.setup(), price, Service::Upload);
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
