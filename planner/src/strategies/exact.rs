//! `exact`: the optimal schedule of sP1 by a bounded search, then the waypoint by sP2.
//!
//! Algorithm 1 tests five circles per pair of sensor nodes (SNs); `exact` finds the maximum over all points in reach.
//! The best set has the largest `Σ B_i(t−1)` (decision D6) of all sets of at most n SNs that are in range of one point
//! within `V τ` of the UAV. Ties go to the lexicographically smallest ascending list of ids (decision D7), in which a
//! free resource block counts as an SN with an empty queue and an id above all others.
//!
//! The waypoint for the set is left to [`crate::waypoint`].
//!
//! Two facts make the search finite and fast. (They hold up to the slack of decision D5: a set whose disks have a point
//! in common only thanks to more than half of the slack may be found or missed.)
//!
//! 1. *It suffices to try the points where the disks of radius `d_c` about one or two SNs come nearest to the UAV.* Let
//!    S be the best set, and p the point nearest to the UAV of those that have all of S in range. If any of these
//!    points is in reach, p is. It is the UAV's own position, or on the rim of one disk, or on the rims of several. In
//!    the last case two of the disks already determine p, because the direction from p to the UAV is a sum of at most
//!    two of their outward normals with weights not below 0. So p is the point of the disks about one or two SNs of S
//!    that is nearest to the UAV. The n fullest queues in range of p are at least as good as S (fact 2), hence S. SN
//!    positions and intersections with the rim of reach need not be tried.
//! 2. *The n fullest of more SNs are never a worse set.* Elementwise they are at least as full, and where equally full,
//!    their ids are not higher. So the n fullest neighbours of an SN, or of two, bound every set with that SN, or both,
//!    from above. The search skips what this bound excludes.

use skysink_common::geometry::{Position, RANGE_SLACK, distance_squared, within};
use skysink_common::message::SolverOutcome;
use skysink_common::told::Told;

use crate::geometry::disks::{Disk, crossings, project};
use crate::mission_table::MissionTable;
use crate::serving::Serving;
use crate::serving::nearby::{Nearby, Spot, may_share, sum_bits};
use crate::strategy::{Decision, Registered, rule};
use crate::waypoint::problem::Waypoint;

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("exact", "sP1 solved exactly instead of by Algorithm 1, then sP2", |setup| {
        let mut search = ExactSearch::new(setup.table);
        let mut serving = Serving::new(setup);
        let mut ids = Vec::with_capacity(setup.table.limits.blocks());
        let mut room = Vec::new();
        rule(move |view| {
            let centre = search.best_set(view.table, &view.ground(), view.told(view.values(&mut room)), &mut ids)?;
            // The centre satisfies every constraint of sP2 up to the slack of decision D5. If the disks of the set have
            // a point in common only thanks to that slack, sP2* may find none, and the centre is the waypoint.
            let waypoint = serving.waypoint(view, &ids).unwrap_or_else(|| Waypoint {
                point: serving.above(view, &centre, &ids),
                outcome: SolverOutcome::Fallback,
            });
            Some(Decision::serve(view, &waypoint, &ids))
        })
    });

/// The search, with its working memory.
#[derive(Debug, Clone)]
pub struct ExactSearch {
    /// The SNs that can be served from within reach, fullest first.
    nearby: Nearby,
    /// Those of `nearby`, in the same order, that one waypoint may serve together with the SN under consideration.
    around: Vec<Spot>,
    /// The best set so far; at first the empty set, which any other beats.
    best: Schedule,
    /// A point that has it in range.
    centre: Option<Position>,
    /// The set under consideration.
    trial: Schedule,
}

/// At most n sensor nodes.
#[derive(Debug, Clone)]
struct Schedule {
    /// `Σ B_i(t−1)` [bit].
    sum_bits: u64,
    /// The ids; ascending in the best set, and after a comparison by [`Schedule::beats`].
    ids: Vec<u32>,
}

impl ExactSearch {
    /// A search over the SNs of `table` that never allocates in a slot.
    #[must_use]
    pub fn new(table: &MissionTable) -> Self {
        let sensors = table.sensors.positions.len();
        let empty = || Schedule { sum_bits: 0, ids: Vec::with_capacity(table.limits.blocks()) };
        Self {
            nearby: Nearby::with_room_for(sensors),
            around: Vec::with_capacity(sensors),
            best: empty(),
            centre: None,
            trial: empty(),
        }
    }

    /// The best set that can be served from within reach of `position`, `L_u(t−1)`, and a point that has it in range.
    ///
    /// Fills `ids` with the set, ascending; `None` if no SN can be served. The point is within `V τ`, and every SN of
    /// the set within `d_c` of it (decision D5).
    pub fn best_set<'t>(
        &mut self,
        table: &MissionTable,
        position: &Position,
        told: impl Into<Told<'t>>,
        ids: &mut Vec<u32>,
    ) -> Option<Position> {
        let radius_m = table.limits.reach_m + table.limits.comm_radius_m;
        self.nearby.preselect(table, position, radius_m, told);
        let most_bits = self.nearby.most_bits(table.limits.blocks() - 1);
        self.best.fill([].iter());
        self.centre = None;
        for index in 0..self.nearby.spots.len() {
            let i = self.nearby.spots[index];
            if u64::from(i.queue_bits) + most_bits < self.best.sum_bits {
                break; // and so do all others, which are less full
            }
            if self.trial.could_beat(&self.best, table, [&i], &self.nearby.spots) {
                self.search_around(table, position, &i);
            }
        }
        ids.clear();
        ids.extend(&self.best.ids);
        self.centre
    }

    /// Tries the points of the disk of i, and of its lenses with the disks of all less full SNs, that are nearest to
    /// the UAV.
    fn search_around(&mut self, table: &MissionTable, position: &Position, i: &Spot) {
        self.around.clear();
        self.around.extend(self.nearby.spots.iter().filter(|other| may_share(table, i, other)));
        let reach = Disk { centre: *position, radius_m: table.limits.reach_m };
        let disk = Disk { centre: i.position, radius_m: table.limits.comm_radius_m };
        if let Some(centre) = project(position, &[reach, disk]) {
            self.try_centre(table, &centre);
        }
        if table.limits.blocks() < 2 {
            return;
        }
        let own = self.around.iter().position(|spot| spot.id == i.id).expect("an SN is where it is itself");
        let most_bits = u64::from(i.queue_bits) + sum_bits(self.around.iter().take(table.limits.blocks() - 2));
        for index in own + 1..self.around.len() {
            let k = self.around[index];
            if u64::from(k.queue_bits) + most_bits < self.best.sum_bits {
                break;
            }
            if !self.trial.could_beat(&self.best, table, [i, &k], &self.around) {
                continue;
            }
            for slack in slacks(i, &k, table) {
                self.try_corner(table, position, [i, &k], *slack);
            }
        }
    }

    /// Tries the nearer corner of the lens of two SNs, with disks enlarged by `slack`. If another point of the lens is
    /// nearer, it is the nearest point of one of the disks, which is tried separately.
    fn try_corner(&mut self, table: &MissionTable, position: &Position, pair: [&Spot; 2], slack: f64) {
        let radius_m = table.limits.comm_radius_m * (1.0 + slack);
        let [a, b] = pair.map(|spot| Disk { centre: spot.position, radius_m });
        let [a, b] = crossings(&a, &b);
        let a_is_nearer = distance_squared(&a, position) <= distance_squared(&b, position);
        let corner = if a_is_nearer { a } else { b };
        if within(&corner, position, table.limits.reach_m) {
            self.try_centre(table, &corner);
        }
    }

    /// Tries the n fullest queues in range of `centre`.
    fn try_centre(&mut self, table: &MissionTable, centre: &Position) {
        let in_range = |spot: &&Spot| within(&spot.position, centre, table.limits.comm_radius_m);
        self.trial.fill(self.around.iter().filter(in_range).take(table.limits.blocks()));
        if self.trial.beats(&self.best) {
            std::mem::swap(&mut self.best, &mut self.trial);
            self.best.ids.sort_unstable();
            self.centre = Some(*centre);
        }
    }
}

/// Two disks nearly touch if the distance of their centres is below `2 d_c` by less than this fraction.
const NEARLY_TOUCHING: f64 = 1e-6;

/// Enlargements, relative to `d_c`, of the disks of two SNs for the corners of their lens.
///
/// If the circles nearly touch, the corners move with the square root of the slack: half the slack of decision D5 moves
/// them by 10⁻⁴ m instead of 10⁻⁸ m. A third SN on the circle of radius `d_c` through the two can then be served from
/// these corners, but not from the point where the circles touch: rounding puts it 10⁻⁶ m out of range there.
fn slacks(i: &Spot, k: &Spot, table: &MissionTable) -> &'static [f64] {
    let are_near = within(&i.position, &k.position, 2.0 * table.limits.comm_radius_m * (1.0 - NEARLY_TOUCHING));
    if are_near { &[0.0] } else { &[0.0, RANGE_SLACK / 2.0] }
}

impl Schedule {
    fn fill<'a>(&mut self, spots: impl Iterator<Item = &'a Spot>) {
        self.sum_bits = 0;
        self.ids.clear();
        spots.for_each(|spot| self.add(spot));
    }

    fn add(&mut self, spot: &Spot) {
        self.sum_bits += u64::from(spot.queue_bits);
        self.ids.push(spot.id);
    }

    /// Sets this schedule to an upper bound on all sets that contain `members`: `members` and the fullest of `others`
    /// that may share a waypoint with the last member. Returns whether the bound beats `best`.
    fn could_beat<const M: usize>(
        &mut self,
        best: &Self,
        table: &MissionTable,
        members: [&Spot; M],
        others: &[Spot],
    ) -> bool {
        self.fill(members.into_iter());
        let mut blocks = (table.limits.blocks() - M) as u64;
        for other in others {
            // Queues are in descending order. A set of equal sum may still win by its ids (decision D7).
            if blocks == 0 || self.sum_bits + blocks * u64::from(other.queue_bits) < best.sum_bits {
                break;
            }
            let is_member = members.iter().any(|member| member.id == other.id);
            if !is_member && may_share(table, members[M - 1], other) {
                self.add(other);
                blocks -= 1;
            }
        }
        self.beats(best)
    }

    /// Whether this set is better than `other`, whose ids are ascending.
    ///
    /// The larger sum wins, then the lexicographically smaller list of ids, with an id above all others per free block.
    fn beats(&mut self, other: &Self) -> bool {
        if self.sum_bits != other.sum_bits {
            return self.sum_bits > other.sum_bits;
        }
        self.ids.sort_unstable();
        let first_difference = self.ids.iter().zip(&other.ids).find(|(own, others)| own != others);
        first_difference.map_or(self.ids.len() > other.ids.len(), |(own, others)| own < others)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;

    /// The set found from the middle of the area, and from where.
    fn search(table: &MissionTable, queues_bits: &[u32]) -> Option<(Position, Vec<u32>)> {
        let mut ids = vec![77];
        let centre = ExactSearch::new(table).best_set(table, &Position::new(50.0, 50.0), queues_bits, &mut ids);
        assert_eq!(centre.is_none(), ids.is_empty());
        centre.map(|centre| (centre, ids))
    }

    fn assert_found(table: &MissionTable, queues_bits: &[u32], centre: [f64; 2], ids: &[u32]) {
        let (from, found) = search(table, queues_bits).expect("somebody can be served");
        assert_eq!(found, ids, "from {from}");
        assert!((from - Position::from(centre)).norm() < 1e-9, "{from}");
    }

    #[test]
    fn no_set_is_found_beyond_reach_and_range() {
        // V τ + d_c = 40 m.
        assert_eq!(search(&table_of(&[[50.0, 90.1], [9.0, 50.0]]), &[9, 9]), None);
        assert_eq!(search(&table_of(&[]), &[]), None);
    }

    #[test]
    fn nan_positions_give_no_set() {
        let table = table_of(&[[50.0, 50.0]]);
        let nowhere = Position::new(f64::NAN, 50.0);
        assert_eq!(ExactSearch::new(&table).best_set(&table, &nowhere, &[9], &mut Vec::new()), None);
    }

    #[test]
    fn a_lone_sensor_node_is_served_from_where_its_disk_is_nearest() {
        assert_found(&table_of(&[[57.0, 50.0]]), &[9], [50.0, 50.0], &[0]);
        // 40 m away: where the disk and reach touch, 30 m and 10 m; (24, 32) is 40 m, too.
        assert_found(&table_of(&[[50.0, 90.0]]), &[9], [50.0, 80.0], &[0]);
        assert_found(&table_of(&[[74.0, 82.0]]), &[9], [68.0, 74.0], &[0]);
    }

    #[test]
    fn two_sensor_nodes_are_served_from_the_near_corner_of_their_lens() {
        // 12 m apart, 36 m to the north: the corners are 8 m to either side of the middle, 10² = 6² + 8².
        assert_found(&table_of(&[[44.0, 86.0], [56.0, 86.0]]), &[9, 9], [50.0, 78.0], &[0, 1]);
        // At 39 m the near corner is 31 m away, and reach is 30 m: only one can be served, the fuller.
        let table = table_of(&[[44.0, 89.0], [56.0, 89.0]]);
        assert_eq!(search(&table, &[8, 9]).unwrap().1, [1]);
        assert_eq!(search(&table, &[9, 9]).unwrap().1, [0]);
    }

    #[test]
    fn three_sensor_nodes_on_one_circle_are_served_from_its_centre() {
        // All 10 m from (50, 70), and any two of them at most 20 m apart: (±6, 8) and (0, −10).
        assert_found(&table_of(&[[56.0, 78.0], [44.0, 78.0], [50.0, 60.0]]), &[1, 1, 1], [50.0, 70.0], &[0, 1, 2]);
    }

    #[test]
    fn sensor_nodes_that_touch_or_coincide_are_served_together() {
        // 20 m apart, twice on the same spot.
        let table = table_of(&[[40.0, 60.0], [60.0, 60.0], [40.0, 60.0]]);
        assert_found(&table, &[1, 1, 1], [50.0, 60.0], &[0, 1, 2]);
        assert_found(&table_of(&[[50.0, 70.0]; 5]), &[1, 2, 3, 4, 5], [50.0, 60.0], &[1, 2, 3, 4]);
    }

    #[test]
    fn a_reach_smaller_than_range_keeps_sensor_nodes_in_range_of_all_of_it() {
        let mut table = table_of(&[[56.0, 50.0], [44.0, 50.0], [50.0, 62.0]]);
        table.limits.reach_m = 1.0;
        assert_found(&table, &[1, 1, 99], [50.0, 50.0], &[0, 1]);
    }

    #[test]
    fn a_larger_sum_without_the_fullest_queue_wins() {
        // SN 0 is the partner of every anchor of Algorithm 1, more than 19.6 m from the others, and no circle of radius
        // 10 m has two of them in it as well. The other three are in range of (70, 50).
        let mut table = table_of(&[[50.0, 50.0], [69.8, 50.0], [68.0, 58.0], [68.0, 42.0]]);
        table.limits.resource_blocks = 3;
        assert_eq!(search(&table, &[100, 60, 60, 60]).unwrap().1, [1, 2, 3]);
        let mut ids = Vec::new();
        let reach = crate::strategies::algorithm_1::Reach::Wide;
        let position = Position::new(50.0, 50.0);
        crate::strategies::algorithm_1::Search::default().best_set(
            reach,
            &table,
            &position,
            &[100, 60, 60, 60],
            &mut ids,
        );
        assert_eq!(ids, [0, 1]);
    }

    #[test]
    fn ties_of_sum_go_to_the_lexicographically_smallest_ids() {
        // Three pairs that no point serves together.
        let mut table = table_of(&[[50.0, 70.0], [25.0, 50.0], [75.0, 50.0], [76.0, 50.0], [26.0, 50.0], [50.0, 71.0]]);
        assert_eq!(search(&table, &[5, 5, 5, 5, 5, 5]).unwrap().1, [0, 5]);
        assert_eq!(search(&table, &[5, 6, 5, 6, 5, 5]).unwrap().1, [1, 4]);
        // Found after a set as full whose fullest queue is fuller, also where its bound is no higher.
        assert_eq!(search(&table, &[5, 0, 4, 6, 0, 5]).unwrap().1, [0, 5]);
        table.limits.resource_blocks = 2;
        assert_eq!(search(&table, &[5, 0, 4, 6, 0, 5]).unwrap().1, [0, 5]);
    }

    #[test]
    fn empty_queues_are_served_while_blocks_are_free() {
        // SN 0 can be served alone, or with the empty SN 2.
        assert_eq!(search(&table_of(&[[50.0, 50.0], [95.0, 50.0], [50.0, 65.0]]), &[5, 9, 0]).unwrap().1, [0, 2]);
        // With the empty SN 1, or with the empty SNs 2 and 3: ids count, not how many.
        let table = table_of(&[[50.0, 50.0], [66.0, 50.0], [34.0, 50.0], [34.0, 51.0]]);
        assert_eq!(search(&table, &[5, 0, 0, 0]).unwrap().1, [0, 1]);
        // Nobody has anything.
        assert_eq!(search(&table_of(&[[90.1, 50.0], [50.0, 60.0]]), &[0, 0]).unwrap().1, [1]);
    }
}
