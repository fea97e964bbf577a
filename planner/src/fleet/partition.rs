//! Pieces of a closed tour over all sensor nodes (SNs), one for each UAV: route first, cluster second (Frederickson,
//! Hecht and Kim, SIAM Journal on Computing 7(2), 1978).

use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use crate::geometry::turns::Turns;
use crate::mission_table::MissionTable;

/// The SNs of each UAV, ascending: consecutive pieces of the tour, whose durations are as the `slots` that the UAVs
/// have. SNs that cannot be served are in no piece.
#[must_use]
pub fn pieces(table: &MissionTable, scenario: &Scenario, slots: &[u64], stop: &Stop) -> Vec<Vec<u32>> {
    let mut turns = table.turns(stop).as_ref().clone();
    let starts: Vec<Position> = scenario.starts().map(|start| start.xy()).collect();
    turns.begin_near(|point| table.motion.distance_m2(point, &starts[0]));
    let uavs = starts.len();
    let durations = durations(table, &turns);
    // The UAVs in the order of the tour, beginning with the one that makes the ways to the first points shortest.
    let cut_from = |first: usize| {
        let order: Vec<usize> = (0..uavs).map(|index| (first + index) % uavs).collect();
        let shares: Vec<f64> = order.iter().map(|&uav| slots[uav] as f64).collect();
        let uav_of: Vec<usize> = cut(&durations, &shares).into_iter().map(|piece| order[piece]).collect();
        let way_m = |uav: usize| {
            let turn = uav_of.iter().position(|other| *other == uav)?;
            Some(table.motion.distance_m(&starts[uav], &turns.points[turn]))
        };
        let ways_m: f64 = (0..uavs).filter_map(way_m).sum();
        (ways_m, uav_of)
    };
    // Of equals that with the UAVs in the order of their numbers.
    let firsts = std::iter::once(0).chain((1..uavs).rev());
    let best = firsts.map(cut_from).min_by(|(a_m, _), (b_m, _)| a_m.total_cmp(b_m));
    let mut pieces = vec![Vec::new(); uavs];
    for (turn, uav) in best.into_iter().flat_map(|(_, uav_of)| uav_of).enumerate() {
        pieces[uav].push(turns.order[turn]);
    }
    pieces.iter_mut().for_each(|piece| piece.sort_unstable());
    pieces
}

/// The time of each turn [slots]: the way from the one before, and its part of a slot that serves n SNs.
fn durations(table: &MissionTable, turns: &Turns) -> Vec<f64> {
    let before = turns.points.iter().cycle().skip(turns.points.len().saturating_sub(1));
    let way_slots = |(from, to): (&Position, &Position)| table.motion.distance_m(from, to) / table.limits.reach_m;
    let served = 1.0 / table.limits.blocks() as f64;
    before.zip(&turns.points).map(|ends| way_slots(ends) + served).collect()
}

/// The piece of each turn, of consecutive ones whose durations are as `shares`: a turn belongs to the piece in which
/// its middle lies. The way to the first turn is in none.
fn cut(durations: &[f64], shares: &[f64]) -> Vec<usize> {
    let total: f64 = durations.iter().skip(1).sum();
    let all: f64 = shares.iter().sum();
    let ends: Vec<f64> =
        shares.iter().scan(0.0, |end, share| Some(std::mem::replace(end, *end + share) + share)).collect();
    let mut begun = 0.0;
    let piece = |(turn, duration): (usize, &f64)| {
        let duration = if turn == 0 { 0.0 } else { *duration };
        let middle = begun + duration / 2.0;
        begun += duration;
        if total > 0.0 {
            ends.partition_point(|end| *end <= middle / total * all).min(shares.len() - 1)
        } else {
            turn % shares.len()
        }
    };
    durations.iter().enumerate().map(piece).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    #[test]
    fn cuts_a_tour_into_pieces_of_equal_duration() {
        assert_eq!(cut(&[9.0, 1.0, 1.0, 1.0, 1.0], &[1.0; 2]), [0, 0, 0, 1, 1]);
        assert_eq!(cut(&[1.0, 4.0, 1.0, 1.0], &[1.0; 3]), [0, 1, 2, 2]);
        assert_eq!(cut(&[1.0; 9], &[10.0, 30.0]), [0, 0, 0, 1, 1, 1, 1, 1, 1], "of one that has less time");
        assert_eq!(cut(&[0.0; 4], &[1.0; 3]), [0, 1, 2, 0], "all in one place");
        assert_eq!(cut(&[], &[1.0; 3]), [0; 0]);
    }

    #[test]
    fn each_uav_gets_the_piece_that_begins_near_it() {
        // Two clusters, and a UAV at each.
        let table = table_of(&[[10.0, 10.0], [90.0, 90.0], [12.0, 10.0], [88.0, 90.0]]);
        let of = |starts_m: &str| {
            let text = format!("name = 'x'\n[uav]\ncount = 2\nstarts_m = {starts_m}\n");
            let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
            pieces(&table, &scenario, &[100; 2], &Stop::default())
        };
        assert_eq!(of("[[10.0, 20.0], [90.0, 80.0]]"), [[0, 2], [1, 3]]);
        assert_eq!(of("[[90.0, 80.0], [10.0, 20.0]]"), [[1, 3], [0, 2]]);
    }
}
