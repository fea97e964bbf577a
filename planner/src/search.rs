//! Whom to serve: sP1 by Algorithm 1, the letter's search over circles about pairs of sensor nodes.
//!
//! It maximises `Σ B_i(t−1)` over the set (decision D6), with ties to the lowest index everywhere (decision D7). Where
//! exactly the UAV then flies is left to [`crate::waypoint`].

use skysink_common::geometry::{Position, within};

use crate::circles::{CIRCLES, circles};
use crate::field::{Field, PRESELECTION_MARGIN};
use crate::strategy::fullest_first;

/// Which anchors and circles Algorithm 1 takes for reachable from `L_u(t−1)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// `uts`, the letter's: anchors within `V τ − d_c`, from where every circle about them is in reach, or within `V τ`
    /// when that is not above 0. Circles are taken unseen.
    Letter,
    /// `uts-wide`: anchors within `V τ + d_c`, which is as far as the UAV can serve one, and only the circles whose
    /// centre is within `V τ`.
    Wide,
}

impl Reach {
    /// How far an anchor may be from the UAV [m].
    fn anchor_radius_m(self, field: &Field) -> f64 {
        match self {
            Self::Letter if field.reach_m <= field.comm_radius_m => field.reach_m,
            Self::Letter => field.reach_m - field.comm_radius_m,
            Self::Wide => field.reach_m + field.comm_radius_m,
        }
    }

    /// Whether a circle about `centre` is a candidate for the UAV at `position`.
    fn admits(self, field: &Field, position: &Position, centre: &Position) -> bool {
        self == Self::Letter || within(centre, position, field.reach_m)
    }
}

/// The search, with its working memory.
#[derive(Debug, Clone, Default)]
pub struct Search {
    /// The SNs that this slot's anchors could meet, fullest first: the first n that pass a test are the n largest.
    nearby: Vec<u32>,
}

/// How the winning set came about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Winner {
    /// Anchor SN i.
    pub anchor: u32,
    /// Its partner and their circles; `None` if the set is the anchor alone.
    pub pair: Option<Pair>,
}

/// An anchor's partner, and the circles about both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Partner SN k.
    pub partner: u32,
    /// Centres of C1 to C5; `None` where one is out of reach ([`Reach::Wide`]).
    pub circles: [Option<Position>; CIRCLES],
    /// Which circle won, from 0.
    pub chosen: u32,
}

impl Search {
    /// A search that never allocates for up to `sensors` SNs.
    #[must_use]
    pub fn with_room_for(sensors: usize) -> Self {
        Self { nearby: Vec::with_capacity(sensors) }
    }

    /// Algorithm 1: the best set over all anchors that can be reached from `position`, `L_u(t−1)`.
    ///
    /// Fills `ids` with the set, ascending; `None` if there is no anchor.
    ///
    /// Where `V τ > d_c`, the letter's anchors are among the wide ones and all five circles about them are in reach, so
    /// that the wide search never finds less. Where `V τ ≤ d_c`, the letter's circles can be out of reach and its set
    /// worth more: on paper, or even in the air, when the set can also be served from a point that is no centre.
    pub fn best_set(
        &mut self,
        reach: Reach,
        field: &Field,
        position: &Position,
        queues_bits: &[u32],
        ids: &mut Vec<u32>,
    ) -> Option<Winner> {
        let anchor_radius_m = reach.anchor_radius_m(field);
        self.preselect(field, position, queues_bits, anchor_radius_m);
        let mut best: Option<(u64, Winner)> = None;
        for anchor in field.ids_within(position, anchor_radius_m) {
            let (sum_bits, winner) = self.best_around(reach, field, position, queues_bits, anchor);
            if best.is_none_or(|(best_bits, _)| sum_bits > best_bits) {
                best = Some((sum_bits, winner));
            }
        }
        let (_, winner) = best?;
        self.collect(field, &winner, ids);
        Some(winner)
    }

    /// Keeps the SNs within an anchor's `2 d_c`: partners, and everything within `d_c` of a circle's centre.
    fn preselect(&mut self, field: &Field, position: &Position, queues_bits: &[u32], anchor_radius_m: f64) {
        let radius_m = (anchor_radius_m + 2.0 * field.comm_radius_m) * PRESELECTION_MARGIN;
        self.nearby.clear();
        self.nearby.extend(field.ids_within(position, radius_m));
        self.nearby.sort_unstable_by_key(|&id| fullest_first(queues_bits, id));
    }

    /// Steps 3 to 5: the set of one anchor and its sum of queues [bit]; the anchor alone where no circle is left.
    fn best_around(
        &self,
        reach: Reach,
        field: &Field,
        position: &Position,
        queues_bits: &[u32],
        anchor: u32,
    ) -> (u64, Winner) {
        let queue_bits = |id: u32| u64::from(queues_bits[id as usize]);
        let alone = (queue_bits(anchor), Winner { anchor, pair: None });
        let Some(partner) = self.partner(field, anchor) else {
            return alone;
        };
        let circles = circles(field.position(anchor), field.position(partner), field.comm_radius_m)
            .map(|centre| reach.admits(field, position, &centre).then_some(centre));
        let mut best: Option<(u64, u32)> = None;
        for (circle, centre) in (0..).zip(&circles) {
            let Some(centre) = centre else { continue };
            let others_bits = self.others(field, anchor, partner, centre).map(queue_bits).sum();
            if best.is_none_or(|(best_bits, _)| others_bits > best_bits) {
                best = Some((others_bits, circle));
            }
        }
        let Some((others_bits, chosen)) = best else {
            return alone;
        };
        let sum_bits = queue_bits(anchor) + queue_bits(partner) + others_bits;
        (sum_bits, Winner { anchor, pair: Some(Pair { partner, circles, chosen }) })
    }

    /// Step 3: the largest queue within `2 d_c` of the anchor; `None` if there is none, or no second resource block.
    fn partner(&self, field: &Field, anchor: u32) -> Option<u32> {
        if field.resource_blocks < 2 {
            return None;
        }
        let in_range = |id: u32| within(field.position(id), field.position(anchor), 2.0 * field.comm_radius_m);
        self.nearby.iter().copied().find(|&id| id != anchor && in_range(id))
    }

    /// Step 5: the n−2 largest queues in the circle about `centre`, other than the pair's.
    fn others(&self, field: &Field, anchor: u32, partner: u32, centre: &Position) -> impl Iterator<Item = u32> {
        let in_circle = |id: u32| within(field.position(id), centre, field.comm_radius_m);
        let wanted = move |&id: &u32| id != anchor && id != partner && in_circle(id);
        self.nearby.iter().copied().filter(wanted).take(field.resource_blocks - 2)
    }

    /// Fills `ids` with the winner's set, ascending.
    fn collect(&self, field: &Field, winner: &Winner, ids: &mut Vec<u32>) {
        ids.clear();
        ids.push(winner.anchor);
        if let Some(pair) = &winner.pair {
            ids.push(pair.partner);
            let centre = pair.circles[pair.chosen as usize].expect("only a circle in reach can win");
            ids.extend(self.others(field, winner.anchor, pair.partner, &centre));
        }
        ids.sort_unstable();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::tests::field_of;

    /// The set found from the middle of the area, and how.
    fn found(reach: Reach, field: &Field, queues_bits: &[u32]) -> Option<(Winner, Vec<u32>)> {
        let mut ids = Vec::new();
        let winner = Search::default().best_set(reach, field, &Position::new(50.0, 50.0), queues_bits, &mut ids)?;
        Some((winner, ids))
    }

    /// The letter's search.
    fn search(field: &Field, queues_bits: &[u32]) -> Option<(Winner, Vec<u32>)> {
        found(Reach::Letter, field, queues_bits)
    }

    /// The wide one.
    fn search_wide(field: &Field, queues_bits: &[u32]) -> Option<(Winner, Vec<u32>)> {
        found(Reach::Wide, field, queues_bits)
    }

    #[test]
    fn the_fullest_circle_about_a_pair_wins() {
        // Anchor 0 with partner 1, 12 m apart; SN 2 is only in C1 about (50, 58), SN 3 only in C2 about (50, 42).
        let field = field_of(&[[56.0, 50.0], [44.0, 50.0], [50.0, 67.0], [50.0, 33.0]]);
        let (winner, ids) = search(&field, &[50, 100, 7, 8]).unwrap();
        assert_eq!((winner.anchor, winner.pair.unwrap().partner, winner.pair.unwrap().chosen), (0, 1, 1));
        assert_eq!(ids, [0, 1, 3]);
        let (winner, ids) = search(&field, &[50, 100, 8, 8]).unwrap();
        assert_eq!(winner.pair.unwrap().chosen, 0, "the first of equals");
        assert_eq!(ids, [0, 1, 2]);
    }

    #[test]
    fn no_more_than_the_resource_blocks_are_scheduled() {
        let mut field = field_of(&[[50.0, 50.0], [50.0, 51.0], [50.0, 52.0], [50.0, 53.0], [50.0, 54.0], [50.0, 55.0]]);
        for (resource_blocks, expected) in [(1, &[2][..]), (2, &[2, 5]), (3, &[2, 4, 5]), (64, &[0, 1, 2, 3, 4, 5])] {
            field.resource_blocks = resource_blocks;
            assert_eq!(search(&field, &[1, 2, 9, 3, 7, 8]).unwrap().1, expected, "n = {resource_blocks}");
        }
    }

    #[test]
    fn an_anchor_without_a_partner_is_served_alone() {
        let mut field = field_of(&[[50.0, 50.0], [50.0, 70.1], [50.0, 52.0]]);
        assert_eq!(search(&field, &[0, 0, 0]).unwrap().1, [0, 2], "an empty queue is scheduled too");
        field.resource_blocks = 1;
        let alone = (Winner { anchor: 2, pair: None }, vec![2]);
        assert_eq!(search(&field, &[3, 99, 7]), Some(alone));
    }

    #[test]
    fn anchors_are_sought_where_every_circle_about_them_is_in_reach() {
        // V τ − d_c = 20 m: the SN at 20 m is an anchor, the one at 20.1 m is not.
        assert_eq!(search(&field_of(&[[50.0, 70.0]]), &[1]).unwrap().1, [0]);
        assert_eq!(search(&field_of(&[[50.0, 70.1]]), &[1]), None);
        // V τ = 10 m = d_c: within V τ instead.
        let mut field = field_of(&[[50.0, 60.0], [50.0, 39.9]]);
        field.reach_m = 10.0;
        assert_eq!(search(&field, &[1, 5]).unwrap().0.anchor, 0);
    }

    #[test]
    fn ties_between_anchors_and_partners_go_to_the_lowest_index() {
        let field = field_of(&[[40.0, 50.0], [60.0, 50.0], [50.0, 50.0], [50.0, 51.0]]);
        let (winner, _) = search(&field, &[5, 5, 5, 5]).unwrap();
        assert_eq!((winner.anchor, winner.pair.unwrap().partner), (0, 1));
    }

    #[test]
    fn wide_anchors_are_sought_as_far_as_the_uav_can_serve() {
        // V τ + d_c = 40 m.
        let alone = (Winner { anchor: 0, pair: None }, vec![0]);
        assert_eq!(search_wide(&field_of(&[[50.0, 90.0]]), &[1]), Some(alone));
        assert_eq!(search_wide(&field_of(&[[50.0, 90.1]]), &[1]), None);
    }

    #[test]
    fn the_wide_search_drops_circles_out_of_reach() {
        // 30 m to the north, 12 m apart. C1 = (50, 88) is out of reach, and SN 2 in no other circle.
        let field = field_of(&[[56.0, 80.0], [44.0, 80.0], [50.0, 97.0]]);
        let (winner, ids) = search_wide(&field, &[50, 100, 7]).unwrap();
        let pair = winner.pair.unwrap();
        assert_eq!((winner.anchor, pair.partner, pair.chosen, &ids[..]), (0, 1, 1, &[0, 1][..]));
        // C2 and C5 are within 30 m; C3 and C4, at (54, 80) and (46, 80), are 30.3 m away.
        assert_eq!(pair.circles.map(|centre| centre.is_some()), [false, true, false, false, true]);
    }

    #[test]
    fn a_wide_anchor_with_no_circle_in_reach_counts_alone() {
        // 39 m to the north, 12 m apart: even C2 is 31 m away.
        let field = field_of(&[[56.0, 89.0], [44.0, 89.0]]);
        assert_eq!(search_wide(&field, &[7, 8]), Some((Winner { anchor: 1, pair: None }, vec![1])));
    }

    #[test]
    fn below_range_the_letters_set_can_be_worth_more_than_the_wide_one() {
        // V τ = 5 m: no circle about SNs 19 m apart is in reach. The letter does not ask; its set cannot be served.
        let mut field = field_of(&[[55.0, 50.0], [74.0, 50.0]]);
        field.reach_m = 5.0;
        assert_eq!(search(&field, &[10, 100]).unwrap().1, [0, 1]);
        assert_eq!(search_wide(&field, &[10, 100]).unwrap().1, [0]);
        // V τ = 7 m: of the circles about SNs 0 and 1 only C3 at (56, 50) is in reach. SN 2 is not in it, but in C1 at
        // (58, 56). All three are in range of (56.3, 52), which is in reach: the letter's set can even be served.
        let mut field = field_of(&[[50.0, 50.0], [66.0, 50.0], [60.0, 59.2]]);
        field.reach_m = 7.0;
        assert_eq!(search(&field, &[90, 80, 10]).unwrap().1, [0, 1, 2]);
        assert_eq!(search_wide(&field, &[90, 80, 10]).unwrap().1, [0, 1]);
    }
}
