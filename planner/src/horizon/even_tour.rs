//! 2-opt repair of closed tours in which few legs are longer than a slot. A long leg costs an additional slot per
//! round.

/// Tours are repaired if at most one leg in this many is long. With more the search takes long and does not succeed.
const FEW: usize = 8;

/// Excess below this [slots] is rounding.
const ROUNDING: f64 = 1e-9;

/// Reverses parts of `tour` until no reversal reduces the total excess. `excess` is the time beyond one slot [slots] of
/// the leg between two stops, and symmetric.
pub fn even_out(tour: &mut [u32], excess: impl Fn(u32, u32) -> f64) {
    let count = tour.len();
    // Each exchange reduces the excess; far fewer are found.
    for _ in 0..count {
        let leg = |index: usize| excess(tour[index], tour[(index + 1) % count]);
        let long: Vec<usize> = (0..count).filter(|&index| leg(index) > ROUNDING).collect();
        if long.len() * FEW > count {
            return;
        }
        let mut best: Option<(f64, usize, usize)> = None;
        for long in long {
            for other in (0..count).filter(|&other| other != long) {
                let low = long.min(other);
                let high = long.max(other);
                let joined = excess(tour[low], tour[high]) + excess(tour[low + 1], tour[(high + 1) % count]);
                let gain = leg(low) + leg(high) - joined;
                if gain > ROUNDING && best.is_none_or(|(most, ..)| gain > most) {
                    best = Some((gain, low, high));
                }
            }
        }
        let Some((_, low, high)) = best else {
            return;
        };
        tour[low + 1..=high].reverse();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slots beyond one between two of 16 stops on a ring, one slot from each to the next.
    fn ring(a: u32, b: u32) -> f64 {
        let apart = a.abs_diff(b);
        (f64::from(apart.min(16 - apart)) - 1.0).max(0.0)
    }

    #[test]
    fn two_legs_that_are_too_long_are_exchanged_for_two_of_a_slot() {
        // 4 to 9 and 5 to 10 are five slots each.
        let mut tour = [0, 1, 2, 3, 4, 9, 8, 7, 6, 5, 10, 11, 12, 13, 14, 15];
        even_out(&mut tour, ring);
        let sum: f64 = (0..16).map(|index| ring(tour[index], tour[(index + 1) % 16])).sum();
        assert_eq!(sum, 0.0, "{tour:?}");
        tour.sort_unstable();
        assert_eq!(tour, std::array::from_fn(|stop| stop as u32));
    }

    #[test]
    fn a_tour_with_many_long_legs_is_not_changed() {
        let mut tour = [0, 2, 4, 6, 8, 10, 12, 14, 1, 3, 5, 7, 9, 11, 13, 15];
        let before = tour;
        even_out(&mut tour, ring);
        assert_eq!(tour, before);
    }

    #[test]
    fn a_tour_of_short_legs_and_one_of_few_stops_stay_as_they_are() {
        let mut tour = [3, 1, 2, 0];
        even_out(&mut tour, |_, _| 0.0);
        assert_eq!(tour, [3, 1, 2, 0]);
        let mut pair = [0, 1];
        even_out(&mut pair, |_, _| 5.0);
        assert_eq!(pair, [0, 1]);
        even_out(&mut [], |_, _| 5.0);
    }
}
