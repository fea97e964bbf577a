//! Whom to serve: sP1 by Algorithm 1, the letter's search over circles about pairs of sensor nodes.
//!
//! It maximises `Σ B_i(t−1)` over the set (decision D6), with ties to the lowest index everywhere (decision D7). Where
//! exactly the UAV then flies is left to [`crate::waypoint`].

use skysink_common::geometry::{Position, within};

use crate::field::Field;
use crate::strategy::fullest_first;

/// Candidate circles about one pair, C1 to C5.
pub const CIRCLES: usize = 5;

/// Margin of the preselection over every test that follows it; it changes what is looked at, never what is found.
const PRESELECTION_MARGIN: f64 = 1.001;

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
    /// Centres of C1 to C5.
    pub circles: [Position; CIRCLES],
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
    pub fn best_set(
        &mut self,
        field: &Field,
        position: &Position,
        queues_bits: &[u32],
        ids: &mut Vec<u32>,
    ) -> Option<Winner> {
        let anchor_radius_m = anchor_radius_m(field);
        self.preselect(field, position, queues_bits, anchor_radius_m);
        let mut best: Option<(u64, Winner)> = None;
        for anchor in field.ids_within(position, anchor_radius_m) {
            let (sum_bits, winner) = self.best_around(field, queues_bits, anchor);
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

    /// Steps 3 to 5: the set of one anchor and its sum of queues [bit].
    fn best_around(&self, field: &Field, queues_bits: &[u32], anchor: u32) -> (u64, Winner) {
        let queue_bits = |id: u32| u64::from(queues_bits[id as usize]);
        let Some(partner) = self.partner(field, anchor) else {
            return (queue_bits(anchor), Winner { anchor, pair: None });
        };
        let circles = circles(field.position(anchor), field.position(partner), field.comm_radius_m);
        let (mut chosen, mut best_bits) = (0, None);
        for (circle, centre) in (0..).zip(&circles) {
            let others_bits: u64 = self.others(field, anchor, partner, centre).map(queue_bits).sum();
            if best_bits.is_none_or(|bits| others_bits > bits) {
                (chosen, best_bits) = (circle, Some(others_bits));
            }
        }
        let sum_bits = queue_bits(anchor) + queue_bits(partner) + best_bits.unwrap_or(0);
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
            ids.extend(self.others(field, winner.anchor, pair.partner, &pair.circles[pair.chosen as usize]));
        }
        ids.sort_unstable();
    }
}

/// How far an anchor may be from the UAV [m]: `V τ − d_c`, from where every circle about it is in reach, or `V τ` when
/// that is not above 0.
fn anchor_radius_m(field: &Field) -> f64 {
    if field.reach_m <= field.comm_radius_m { field.reach_m } else { field.reach_m - field.comm_radius_m }
}

/// Step 4: centres of the five circles of radius `d_c` [m] about anchor i and partner k.
///
/// With `u = (L_i − L_k)/d` and `V = sqrt(|d_c² − d²/4|)`: C1 and C2 through both, at the midpoint `± V (−u_y, u_x)`;
/// C3 touching k, `L_k + d_c u`; C4 touching i, `L_i − d_c u`; C5 at the midpoint. Where both coincide, `u = (1, 0)`.
#[must_use]
pub fn circles(anchor: &Position, partner: &Position, comm_radius_m: f64) -> [Position; CIRCLES] {
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
    use crate::field::tests::field_of;
    use proptest::prelude::*;

    fn assert_circles(anchor: [f64; 2], partner: [f64; 2], expected: [[f64; 2]; CIRCLES]) {
        let found = circles(&anchor.into(), &partner.into(), 10.0);
        for (number, (found, expected)) in (1..).zip(found.iter().zip(expected)) {
            assert!((found - Position::from(expected)).norm() < 1e-12, "C{number}: {found}");
        }
    }

    /// The set found from the middle of the area, and how.
    fn search(field: &Field, queues_bits: &[u32]) -> Option<(Winner, Vec<u32>)> {
        let mut ids = Vec::new();
        let winner = Search::default().best_set(field, &Position::new(50.0, 50.0), queues_bits, &mut ids)?;
        Some((winner, ids))
    }

    #[test]
    fn the_five_circles_stand_where_the_letter_puts_them() {
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
    fn a_coincident_pair_has_circles_on_all_four_sides() {
        assert_circles([5.0, 5.0], [5.0, 5.0], [[5.0, 15.0], [5.0, -5.0], [15.0, 5.0], [-5.0, 5.0], [5.0, 5.0]]);
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

    /// Algorithm 1 once more, as directly as it can be written: the best of all (sum, anchor, set), over all SNs.
    fn enumerate(field: &Field, position: &Position, queues_bits: &[u32]) -> Option<(u32, Vec<u32>)> {
        let (d_c, n) = (field.comm_radius_m, field.resource_blocks);
        let queue = |id: u32| u64::from(queues_bits[id as usize]);
        let close = |a: &Position, b: &Position, limit_m: f64| (a - b).norm() <= limit_m * (1.0 + 1e-9);
        let limit_m = if field.reach_m > d_c { field.reach_m - d_c } else { field.reach_m };
        let mut best: Option<(u64, u32, Vec<u32>)> = None;
        for i in field.ids().filter(|&i| close(field.position(i), position, limit_m)) {
            let mut set = vec![i];
            let mut partners: Vec<u32> =
                field.ids().filter(|&j| j != i && close(field.position(j), field.position(i), 2.0 * d_c)).collect();
            partners.sort_by_key(|&j| queue(j)); // stable: of equals, the lowest index comes first
            let fullest = partners.last().map(|&last| queue(last));
            let partner = partners.into_iter().find(|&j| Some(queue(j)) == fullest);
            if let Some(k) = partner.filter(|_| n >= 2) {
                let ([xi, yi], [xk, yk]) = (field.position(i).coords.into(), field.position(k).coords.into());
                let d = f64::hypot(xi - xk, yi - yk);
                let (ux, uy) = if d == 0.0 { (1.0, 0.0) } else { ((xi - xk) / d, (yi - yk) / d) };
                let (mx, my, v) = ((xi + xk) / 2.0, (yi + yk) / 2.0, (d_c * d_c - d * d / 4.0).abs().sqrt());
                let centres = [
                    [mx - v * uy, my + v * ux],
                    [mx + v * uy, my - v * ux],
                    [xk + d_c * ux, yk + d_c * uy],
                    [xi - d_c * ux, yi - d_c * uy],
                    [mx, my],
                ];
                let others = centres.map(|centre| {
                    let in_circle = |&j: &u32| j != i && j != k && close(field.position(j), &centre.into(), d_c);
                    let mut others: Vec<u32> = field.ids().filter(in_circle).collect();
                    others.sort_by_key(|&j| (std::cmp::Reverse(queue(j)), j));
                    others.truncate(n - 2);
                    others
                });
                let sum = |others: &[u32]| others.iter().map(|&j| queue(j)).sum::<u64>();
                let most = others.iter().map(|others| sum(others)).max();
                set.push(k);
                set.extend(others.iter().find(|others| Some(sum(others)) == most).unwrap());
            }
            let sum = set.iter().map(|&j| queue(j)).sum();
            set.sort_unstable();
            if best.as_ref().is_none_or(|(best, ..)| sum > *best) {
                best = Some((sum, i, set));
            }
        }
        best.map(|(_, anchor, set)| (anchor, set))
    }

    /// Coordinates [m], on a lattice of 5 m (touching and coincident SNs, SNs on circles) or anywhere.
    fn coordinates() -> impl Strategy<Value = f64> {
        prop_oneof![10.0..90.0, (4u32..=16).prop_map(|step| f64::from(step) * 5.0)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]

        #[test]
        fn the_search_finds_what_a_direct_enumeration_finds(
            sensors in prop::collection::vec((coordinates(), coordinates(), 0u32..12), 1..40),
            position in (coordinates(), coordinates()),
            resource_blocks in prop_oneof![1usize..6, Just(64)],
            reach_m in prop_oneof![Just(30.0), Just(10.0), Just(7.5), Just(20.0)],
        ) {
            let places: Vec<[f64; 2]> = sensors.iter().map(|&(x_m, y_m, _)| [x_m, y_m]).collect();
            let queues_bits: Vec<u32> = sensors.iter().map(|&(.., queue_bits)| queue_bits).collect();
            let field = Field { reach_m, resource_blocks, ..field_of(&places) };
            let position = Position::new(position.0, position.1);
            let mut ids = Vec::new();
            let found = Search::default().best_set(&field, &position, &queues_bits, &mut ids);
            let found = found.map(|winner| (winner.anchor, ids));
            prop_assert_eq!(found, enumerate(&field, &position, &queues_bits));
        }
    }
}
