//! Pieces of a closed tour over all sensor nodes (SNs), one for each UAV: route first, cluster second (Frederickson, Hecht and
//! Kim, SIAM Journal on Computing 7(2), 1978).

use skysink_common::geometry::Position;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use crate::geometry::turns::Turns;
use crate::mission_table::MissionTable;

/// The SNs of each UAV, ascending: consecutive pieces of the tour that take about the same time. SNs that cannot be served are in
/// no piece.
#[must_use]
pub fn pieces(table: &MissionTable, scenario: &Scenario, stop: &Stop) -> Vec<Vec<u32>> {
    let mut turns = table.turns(stop).as_ref().clone();
    let starts: Vec<Position> = scenario.starts().map(|start| start.xy()).collect();
    turns.begin_near(|point| table.distance_m2(point, &starts[0]));
    let uavs = starts.len();
    let piece_of = cut(&durations(table, &turns), uavs);
    let mut pieces = vec![Vec::new(); uavs];
    let mut firsts = vec![None; uavs];
    for (turn, &piece) in piece_of.iter().enumerate() {
        pieces[piece].push(turns.order[turn]);
        firsts[piece].get_or_insert(turns.points[turn]);
    }
    pieces.iter_mut().for_each(|piece| piece.sort_unstable());
    // In the order of the tour, beginning with the piece that makes the ways to the first points shortest.
    let ways_m = |shift: usize| -> f64 {
        let first = |uav: usize| firsts[(uav + shift) % uavs];
        (0..uavs).filter_map(|uav| Some(table.distance_m(&starts[uav], &first(uav)?))).sum()
    };
    let shift = (0..uavs).min_by(|&a, &b| ways_m(a).total_cmp(&ways_m(b))).unwrap_or(0);
    pieces.rotate_left(shift);
    pieces
}

/// The time of each turn [slots]: the way from the one before, and its part of a slot that serves n SNs.
fn durations(table: &MissionTable, turns: &Turns) -> Vec<f64> {
    let before = turns.points.iter().cycle().skip(turns.points.len().saturating_sub(1));
    let way_slots = |(from, to): (&Position, &Position)| table.distance_m(from, to) / table.limits.reach_m;
    let served = 1.0 / table.limits.blocks() as f64;
    before.zip(&turns.points).map(|ends| way_slots(ends) + served).collect()
}

/// The piece of each turn, of `pieces` consecutive ones of about equal duration: a turn belongs to the piece in which its
/// middle lies. The way to the first turn is in none.
fn cut(durations: &[f64], pieces: usize) -> Vec<usize> {
    let total: f64 = durations.iter().skip(1).sum();
    let mut begun = 0.0;
    let piece = |(turn, duration): (usize, &f64)| {
        let duration = if turn == 0 { 0.0 } else { *duration };
        let middle = begun + duration / 2.0;
        begun += duration;
        if total > 0.0 { ((middle / total * pieces as f64) as usize).min(pieces - 1) } else { turn % pieces }
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
        assert_eq!(cut(&[9.0, 1.0, 1.0, 1.0, 1.0], 2), [0, 0, 0, 1, 1]);
        assert_eq!(cut(&[1.0, 4.0, 1.0, 1.0], 3), [0, 1, 2, 2]);
        assert_eq!(cut(&[0.0; 4], 3), [0, 1, 2, 0], "all in one place");
        assert_eq!(cut(&[], 3), [0; 0]);
    }

    #[test]
    fn each_uav_has_the_piece_that_begins_near_it() {
        // Two clusters, and a UAV at each.
        let table = table_of(&[[10.0, 10.0], [90.0, 90.0], [12.0, 10.0], [88.0, 90.0]]);
        let of = |starts_m: &str| {
            let text = format!("name = 'x'\n[uav]\ncount = 2\nstarts_m = {starts_m}\n");
            let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
            pieces(&table, &scenario, &Stop::default())
        };
        assert_eq!(of("[[10.0, 20.0], [90.0, 80.0]]"), [[0, 2], [1, 3]]);
        assert_eq!(of("[[90.0, 80.0], [10.0, 20.0]]"), [[1, 3], [0, 2]]);
    }
}
