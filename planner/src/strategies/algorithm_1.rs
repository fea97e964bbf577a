//! The schedule: sP1 by Algorithm 1 of the paper, a search over circles about pairs of sensor nodes (SNs).
//!
//! It maximises `Σ B_i(t−1)` over the set (decision D6), with ties to the lowest index (decision D7). The waypoint is
//! left to [`crate::waypoint`].

use skysink_common::geometry::{Position, within};
use skysink_common::told::Told;

use crate::mission_table::MissionTable;
use crate::serving::nearby::{Nearby, Spot, may_share, sum_bits};
use crate::strategy::{CIRCLES, Pair, Winner};

/// The anchors and circles that Algorithm 1 considers reachable from `L_u(t−1)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// `uts`, as in the paper: anchors within `V τ − d_c`, so that all circles about them are in reach, or within `V τ`
    /// if that is not positive. The reach of circles is not checked.
    Letter,
    /// `uts-wide`: anchors within `V τ + d_c`, the farthest at which one can be served, and only circles whose centre
    /// is within `V τ`.
    Wide,
}

impl Reach {
    /// How far an anchor may be from the UAV [m].
    fn anchor_radius_m(self, table: &MissionTable) -> f64 {
        match self {
            Self::Letter if table.limits.reach_m <= table.limits.comm_radius_m => table.limits.reach_m,
            Self::Letter => table.limits.reach_m - table.limits.comm_radius_m,
            Self::Wide => table.limits.reach_m + table.limits.comm_radius_m,
        }
    }

    /// Whether a circle about `centre` is a candidate for the UAV at `position`.
    fn admits(self, table: &MissionTable, position: &Position, centre: &Position) -> bool {
        self == Self::Letter || within(centre, position, table.limits.reach_m)
    }
}

/// The search, with its working memory.
#[derive(Debug, Clone, Default)]
pub struct Search {
    /// The SNs that can be in a set of this slot.
    nearby: Nearby,
}

/// A candidate set: `Ω_opt(i)` of an anchor, without the SNs that its circle adds.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    /// `Σ B_i` of the whole set [bit].
    sum_bits: u64,
    winner: Winner,
}

impl Search {
    /// A search that never allocates for up to `sensors` SNs.
    #[must_use]
    pub fn with_room_for(sensors: usize) -> Self {
        Self { nearby: Nearby::with_room_for(sensors) }
    }

    /// Algorithm 1: the best set over all anchors that can be reached from `position`, `L_u(t−1)`.
    ///
    /// Fills `ids` with the set, ascending; `None` if there is no anchor.
    ///
    /// If `V τ > d_c`, the anchors of the paper are among the wide ones and all circles about them are in reach, so the
    /// wide search never finds less. If `V τ ≤ d_c`, circles of the paper's search can be out of reach, and its set
    /// worth more; such a set may still be served from a point that is not a centre.
    pub fn best_set<'t>(
        &mut self,
        reach: Reach,
        table: &MissionTable,
        position: &Position,
        told: impl Into<Told<'t>>,
        ids: &mut Vec<u32>,
    ) -> Option<Winner> {
        // Step 1: the anchors. Their partners, and everything within d_c of a circle's centre, are within 2 d_c of one.
        let anchor_radius_m = reach.anchor_radius_m(table);
        let radius_m = anchor_radius_m + 2.0 * table.limits.comm_radius_m;
        self.nearby.preselect(table, position, radius_m, told);
        let most_bits = self.nearby.most_bits(table.limits.blocks() - 1);
        let is_anchor = |spot: &&Spot| within(&spot.position, position, anchor_radius_m);
        let mut best: Option<Candidate> = None;
        // Step 2: for each anchor, fullest first, as long as one could be in a better set.
        for anchor in self.nearby.spots.iter().filter(is_anchor) {
            if best.is_some_and(|best| u64::from(anchor.queue_bits) + most_bits < best.sum_bits) {
                break;
            }
            // Step 3: its partner.
            let Some(partner) = self.partner(table, anchor) else {
                Candidate::alone(anchor).replace(&mut best);
                continue;
            };
            if !self.could_win(table, anchor, partner, &best) {
                continue;
            }
            // Step 4: the search region, covered by five circles.
            let circles = circles(&anchor.position, &partner.position, table.limits.comm_radius_m)
                .map(|centre| reach.admits(table, position, &centre).then_some(centre));
            // Step 5: the circle with the largest queues.
            let set = self.fullest_circle(table, anchor, partner, circles, &best);
            set.unwrap_or(Candidate::alone(anchor)).replace(&mut best);
        }
        // Output: the best of these sets.
        let winner = best?.winner;
        self.collect(table, &winner, ids);
        Some(winner)
    }

    /// The largest queue within `2 d_c` of `anchor`; none where only one SN can be served.
    fn partner(&self, table: &MissionTable, anchor: &Spot) -> Option<&Spot> {
        let in_range = |spot: &&Spot| {
            spot.id != anchor.id && within(&anchor.position, &spot.position, 2.0 * table.limits.comm_radius_m)
        };
        self.nearby.spots.iter().find(in_range).filter(|_| table.limits.blocks() > 1)
    }

    /// Upper-bound test: whether the set of `anchor` and `partner` could beat the best so far. A circle has both in
    /// range, so each of the at most n−2 SNs that it adds may share a waypoint with either, and the fullest of those
    /// are counted. Most pairs fail, and need no circles.
    fn could_win(&self, table: &MissionTable, anchor: &Spot, partner: &Spot, best: &Option<Candidate>) -> bool {
        let may_add = |spot: &Spot| may_share(table, partner, spot) && may_share(table, anchor, spot);
        let wins = |sum_bits| is_better(best, sum_bits, anchor.id);
        self.fullest_set(table, [anchor, partner], may_add, wins).is_some()
    }

    /// The set of the best of `circles`, the first of equals; `None` where no circle is left, or none is better than
    /// `best`.
    fn fullest_circle(
        &self,
        table: &MissionTable,
        anchor: &Spot,
        partner: &Spot,
        circles: [Option<Position>; CIRCLES],
        best: &Option<Candidate>,
    ) -> Option<Candidate> {
        let mut fullest: Option<Candidate> = None;
        for (chosen, centre) in (0..).zip(&circles) {
            let Some(centre) = centre else { continue };
            let is_in = |spot: &Spot| within(&spot.position, centre, table.limits.comm_radius_m);
            let wins = |sum_bits| match &fullest {
                Some(fullest) => sum_bits > fullest.sum_bits,
                None => is_better(best, sum_bits, anchor.id),
            };
            if let Some(sum_bits) = self.fullest_set(table, [anchor, partner], is_in, wins) {
                let pair = Some(Pair { partner: partner.id, circles, chosen });
                fullest = Some(Candidate { sum_bits, winner: Winner { anchor: anchor.id, pair } });
            }
        }
        fullest
    }

    /// `Σ B_i` [bit] of `pair` and the n−2 largest queues beside it that `may_add` admits, if it `wins`. The search
    /// ends as soon as an upper bound does not win.
    #[inline]
    fn fullest_set(
        &self,
        table: &MissionTable,
        pair: [&Spot; 2],
        may_add: impl Fn(&Spot) -> bool,
        wins: impl Fn(u64) -> bool,
    ) -> Option<u64> {
        let mut sum_bits = sum_bits(pair);
        let mut blocks = table.limits.blocks() as u64 - 2;
        for spot in &self.nearby.spots {
            if blocks == 0 || !wins(sum_bits + blocks * u64::from(spot.queue_bits)) {
                break;
            }
            if may_add(spot) && pair.iter().all(|member| member.id != spot.id) {
                sum_bits += u64::from(spot.queue_bits);
                blocks -= 1;
            }
        }
        wins(sum_bits).then_some(sum_bits)
    }

    /// Fills `ids` with the winner's set, ascending: beside the pair, the n−2 largest queues in its circle.
    fn collect(&self, table: &MissionTable, winner: &Winner, ids: &mut Vec<u32>) {
        ids.clear();
        ids.push(winner.anchor);
        if let Some(pair) = &winner.pair {
            ids.push(pair.partner);
            let centre = pair.circles[pair.chosen as usize].expect("only a circle in reach can win");
            let is_in = |spot: &&Spot| {
                ![winner.anchor, pair.partner].contains(&spot.id)
                    && within(&spot.position, &centre, table.limits.comm_radius_m)
            };
            ids.extend(self.nearby.spots.iter().filter(is_in).take(table.limits.blocks() - 2).map(|spot| spot.id));
        }
        ids.sort_unstable();
    }
}

/// Whether a set of `anchor` with `sum_bits` [bit] is better than the best so far: it holds more, or as much and the
/// anchor's index is lower (decision D7). Anchors come fullest first, not by index.
fn is_better(best: &Option<Candidate>, sum_bits: u64, anchor: u32) -> bool {
    best.is_none_or(|best| sum_bits > best.sum_bits || sum_bits == best.sum_bits && anchor < best.winner.anchor)
}

impl Candidate {
    /// The anchor alone.
    fn alone(anchor: &Spot) -> Self {
        Self { sum_bits: u64::from(anchor.queue_bits), winner: Winner { anchor: anchor.id, pair: None } }
    }

    /// Takes the place of `best` if it is better.
    fn replace(self, best: &mut Option<Self>) {
        if is_better(best, self.sum_bits, self.winner.anchor) {
            *best = Some(self);
        }
    }
}

/// Step 4 of Algorithm 1: centres of the five circles of radius `d_c` [m] about anchor i and partner k.
///
/// With `u = (L_i − L_k)/d` and `V = sqrt(|d_c² − d²/4|)`: C1 and C2 through both, at the midpoint `± V (−u_y, u_x)`;
/// C3 touching k, `L_k + d_c u`; C4 touching i, `L_i − d_c u`; C5 at the midpoint. Where both coincide, `u = (1, 0)`.
fn circles(anchor: &Position, partner: &Position, comm_radius_m: f64) -> [Position; CIRCLES] {
    let apart_m = (anchor - partner).norm();
    let along = if apart_m > 0.0 { (anchor - partner) / apart_m } else { nalgebra::Vector2::x() };
    let across = nalgebra::Vector2::new(-along.y, along.x);
    let middle = nalgebra::center(anchor, partner);
    let offset_m = (comm_radius_m * comm_radius_m - apart_m * apart_m / 4.0).abs().sqrt();
    [
        middle + across * offset_m,
        middle - across * offset_m,
        partner + along * comm_radius_m,
        anchor - along * comm_radius_m,
        middle,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;

    /// The set found from the middle of the area, and how.
    fn found(reach: Reach, table: &MissionTable, queues_bits: &[u32]) -> Option<(Winner, Vec<u32>)> {
        let mut ids = Vec::new();
        let winner = Search::default().best_set(reach, table, &Position::new(50.0, 50.0), queues_bits, &mut ids)?;
        Some((winner, ids))
    }

    /// The letter's search.
    fn search(table: &MissionTable, queues_bits: &[u32]) -> Option<(Winner, Vec<u32>)> {
        found(Reach::Letter, table, queues_bits)
    }

    /// The wide one.
    fn search_wide(table: &MissionTable, queues_bits: &[u32]) -> Option<(Winner, Vec<u32>)> {
        found(Reach::Wide, table, queues_bits)
    }

    #[test]
    fn the_fullest_circle_about_a_pair_wins() {
        // Anchor 0 with partner 1, 12 m apart; SN 2 is only in C1 about (50, 58), SN 3 only in C2 about (50, 42).
        let table = table_of(&[[56.0, 50.0], [44.0, 50.0], [50.0, 67.0], [50.0, 33.0]]);
        let (winner, ids) = search(&table, &[50, 100, 7, 8]).unwrap();
        assert_eq!((winner.anchor, winner.pair.unwrap().partner, winner.pair.unwrap().chosen), (0, 1, 1));
        assert_eq!(ids, [0, 1, 3]);
        let (winner, ids) = search(&table, &[50, 100, 8, 8]).unwrap();
        assert_eq!(winner.pair.unwrap().chosen, 0, "the first of equals");
        assert_eq!(ids, [0, 1, 2]);
    }

    #[test]
    fn no_more_than_the_resource_blocks_are_scheduled() {
        let mut table = table_of(&[[50.0, 50.0], [50.0, 51.0], [50.0, 52.0], [50.0, 53.0], [50.0, 54.0], [50.0, 55.0]]);
        for (resource_blocks, expected) in [(1, &[2][..]), (2, &[2, 5]), (3, &[2, 4, 5]), (64, &[0, 1, 2, 3, 4, 5])] {
            table.limits.resource_blocks = resource_blocks;
            assert_eq!(search(&table, &[1, 2, 9, 3, 7, 8]).unwrap().1, expected, "n = {resource_blocks}");
        }
    }

    #[test]
    fn an_anchor_without_partner_is_served_alone() {
        let mut table = table_of(&[[50.0, 50.0], [50.0, 70.1], [50.0, 52.0]]);
        assert_eq!(search(&table, &[0, 0, 0]).unwrap().1, [0, 2], "an empty queue is scheduled too");
        table.limits.resource_blocks = 1;
        let alone = (Winner { anchor: 2, pair: None }, vec![2]);
        assert_eq!(search(&table, &[3, 99, 7]), Some(alone));
    }

    #[test]
    fn anchors_are_limited_to_those_with_all_circles_in_reach() {
        // V τ − d_c = 20 m: the SN at 20 m is an anchor, the one at 20.1 m is not.
        assert_eq!(search(&table_of(&[[50.0, 70.0]]), &[1]).unwrap().1, [0]);
        assert_eq!(search(&table_of(&[[50.0, 70.1]]), &[1]), None);
        // V τ = 10 m = d_c: within V τ instead.
        let mut table = table_of(&[[50.0, 60.0], [50.0, 39.9]]);
        table.limits.reach_m = 10.0;
        assert_eq!(search(&table, &[1, 5]).unwrap().0.anchor, 0);
    }

    #[test]
    fn ties_between_anchors_and_partners_go_to_the_lowest_index() {
        let table = table_of(&[[40.0, 50.0], [60.0, 50.0], [50.0, 50.0], [50.0, 51.0]]);
        let (winner, _) = search(&table, &[5, 5, 5, 5]).unwrap();
        assert_eq!((winner.anchor, winner.pair.unwrap().partner), (0, 1));
    }

    #[test]
    fn a_fuller_queue_within_the_slack_is_found() {
        // SNs 0 and 1 are 20 (1 + 0.9e-9) m apart: partners by the slack. C1 about them is 4.2e-4 m off their middle,
        // by 10 (1 + 1.8e-9) m from either, and has SN 2 in range, 20 (1 + 2.7e-9) m from SN 0, whose partner it cannot
        // be.
        let apart_m = 20.0 * (1.0 + 0.9e-9);
        let offset_m = f64::sqrt(apart_m * apart_m / 4.0 - 100.0);
        let farther = 1.0 + 10.0 * (1.0 + 0.9e-9) / f64::hypot(apart_m / 2.0, offset_m);
        let beyond = [40.0 + apart_m / 2.0 * farther, 50.0 + offset_m * farther];
        // Anchors within 12 m of (30, 50): SNs 0, 3 and 4, which are too far away to meet SN 0.
        let mut table = table_of(&[[40.0, 50.0], [40.0 + apart_m, 50.0], beyond, [19.0, 50.0], [18.5, 50.0]]);
        table.limits.reach_m = 22.0;
        table.limits.resource_blocks = 3;
        let position = Position::new(30.0, 50.0);
        let mut ids = Vec::new();
        let winner = Search::default().best_set(Reach::Letter, &table, &position, &[5, 10, 500, 60, 40], &mut ids);
        assert_eq!((winner.unwrap().anchor, &ids[..]), (0, &[0, 1, 2][..]));
    }

    #[test]
    fn wide_anchors_extend_to_reach_plus_range() {
        // V τ + d_c = 40 m.
        let alone = (Winner { anchor: 0, pair: None }, vec![0]);
        assert_eq!(search_wide(&table_of(&[[50.0, 90.0]]), &[1]), Some(alone));
        assert_eq!(search_wide(&table_of(&[[50.0, 90.1]]), &[1]), None);
    }

    #[test]
    fn the_wide_search_drops_circles_out_of_reach() {
        // 30 m to the north, 12 m apart. C1 = (50, 88) is out of reach, and SN 2 in no other circle.
        let table = table_of(&[[56.0, 80.0], [44.0, 80.0], [50.0, 97.0]]);
        let (winner, ids) = search_wide(&table, &[50, 100, 7]).unwrap();
        let pair = winner.pair.unwrap();
        assert_eq!((winner.anchor, pair.partner, pair.chosen, &ids[..]), (0, 1, 1, &[0, 1][..]));
        // C2 and C5 are within 30 m; C3 and C4, at (54, 80) and (46, 80), are 30.3 m away.
        assert_eq!(pair.circles.map(|centre| centre.is_some()), [false, true, false, false, true]);
    }

    #[test]
    fn a_wide_anchor_with_no_circle_in_reach_is_scored_alone() {
        // 39 m to the north, 12 m apart: even C2 is 31 m away.
        let table = table_of(&[[56.0, 89.0], [44.0, 89.0]]);
        assert_eq!(search_wide(&table, &[7, 8]), Some((Winner { anchor: 1, pair: None }, vec![1])));
    }

    #[test]
    fn the_papers_set_can_exceed_the_wide_set_with_little_reach() {
        // V τ = 5 m: no circle about SNs 19 m apart is in reach. The letter does not ask; its set cannot be served.
        let mut table = table_of(&[[55.0, 50.0], [74.0, 50.0]]);
        table.limits.reach_m = 5.0;
        assert_eq!(search(&table, &[10, 100]).unwrap().1, [0, 1]);
        assert_eq!(search_wide(&table, &[10, 100]).unwrap().1, [0]);
        // V τ = 7 m: of the circles about SNs 0 and 1 only C3 at (56, 50) is in reach. SN 2 is not in it, but in C1 at
        // (58, 56). All three are in range of (56.3, 52), which is in reach: the letter's set can even be served.
        let mut table = table_of(&[[50.0, 50.0], [66.0, 50.0], [60.0, 59.2]]);
        table.limits.reach_m = 7.0;
        assert_eq!(search(&table, &[90, 80, 10]).unwrap().1, [0, 1, 2]);
        assert_eq!(search_wide(&table, &[90, 80, 10]).unwrap().1, [0, 1]);
    }

    fn assert_circles(anchor: [f64; 2], partner: [f64; 2], expected: [[f64; 2]; CIRCLES]) {
        let found = circles(&anchor.into(), &partner.into(), 10.0);
        for (number, (found, expected)) in (1..).zip(found.iter().zip(expected)) {
            assert!((found - Position::from(expected)).norm() < 1e-12, "C{number}: {found}");
        }
    }

    #[test]
    fn the_five_circles_match_the_paper() {
        // d = 12: V = sqrt(10² − 6²) = 8. u = (1, 0).
        let expected = [[46.0, 58.0], [46.0, 42.0], [50.0, 50.0], [42.0, 50.0], [46.0, 50.0]];
        assert_circles([52.0, 50.0], [40.0, 50.0], expected);
        // The same pair the other way round, u = (−1, 0): C1 and C2 change places.
        let expected = [[46.0, 42.0], [46.0, 58.0], [42.0, 50.0], [50.0, 50.0], [46.0, 50.0]];
        assert_circles([40.0, 50.0], [52.0, 50.0], expected);
        // u = (0, 1): C1 = (mx − V, my).
        let expected = [[42.0, 46.0], [58.0, 46.0], [50.0, 50.0], [50.0, 42.0], [50.0, 46.0]];
        assert_circles([50.0, 52.0], [50.0, 40.0], expected);
    }

    #[test]
    fn the_five_circles_merge_where_the_pair_is_two_radii_apart() {
        assert_circles([60.0, 50.0], [40.0, 50.0], [[50.0, 50.0]; CIRCLES]);
    }

    #[test]
    fn the_circles_of_a_distant_pair_use_the_magnitude_of_the_offset() {
        // d = 25: V = sqrt(|10² − 12.5²|) = 7.5.
        let expected = [[50.0, 57.5], [50.0, 42.5], [47.5, 50.0], [52.5, 50.0], [50.0, 50.0]];
        assert_circles([62.5, 50.0], [37.5, 50.0], expected);
    }

    #[test]
    fn a_coincident_pair_has_circles_on_all_four_sides() {
        assert_circles([5.0, 5.0], [5.0, 5.0], [[5.0, 15.0], [5.0, -5.0], [15.0, 5.0], [-5.0, 5.0], [5.0, 5.0]]);
    }
}
