//! Pieces of a closed tour over all sensor nodes (SNs), one for each UAV: route first, cluster second (Frederickson,
//! Hecht and Kim, SIAM Journal on Computing 7(2), 1978).

use skysink_common::geometry::Position;
use skysink_common::message::SensorNode;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;

use crate::geometry::turns::Turns;
use crate::mission_table::MissionTable;

/// The SNs of each UAV, ascending: consecutive pieces of the tour, each as long as its UAV flies in its `slots`. SNs
/// that cannot be served are in no piece.
#[must_use]
pub fn pieces(scenario: &Scenario, sensors: &[SensorNode], slots: &[u64], stop: &Stop) -> Vec<Vec<u32>> {
    let tables: Vec<MissionTable> = scenario.kinds().map(|kind| MissionTable::of(&kind, sensors)).collect();
    let table = |uav: usize| &tables[scenario.kind_of(uav)];
    let mut turns = tables[0].turns(stop).as_ref().clone();
    let starts: Vec<Position> = scenario.starts().map(|start| start.xy()).collect();
    turns.begin_near(|point| tables[0].motion.distance_m2(point, &starts[0]));
    let uavs = starts.len();
    let durations = durations(&tables[0], &turns);
    let times = times(&tables, &turns);
    // The UAVs in the order of the tour, beginning with the one that makes the ways to the first points shortest.
    let cut_from = |first: usize| {
        let order: Vec<usize> = (0..uavs).map(|index| (first + index) % uavs).collect();
        let shares: Vec<f64> = order.iter().map(|&uav| slots[uav] as f64 * times[scenario.kind_of(uav)]).collect();
        let uav_of: Vec<usize> = cut(&durations, &shares).into_iter().map(|piece| order[piece]).collect();
        let way_m = |uav: usize| {
            let turn = uav_of.iter().position(|other| *other == uav)?;
            Some(table(uav).motion.distance_m(&starts[uav], &turns.points[turn]))
        };
        let ways_m: f64 = (0..uavs).filter_map(way_m).sum();
        (ways_m, uav_of)
    };
    // Of equals that with the UAVs in the order of their numbers.
    let firsts = std::iter::once(0).chain((1..uavs).rev());
    let best = firsts.map(cut_from).min_by(|(a_m, _), (b_m, _)| a_m.total_cmp(b_m));
    let mut owners: Vec<Option<usize>> = vec![None; sensors.len()];
    for (turn, uav) in best.into_iter().flat_map(|(_, uav_of)| uav_of).enumerate() {
        owners[turns.order[turn] as usize] = Some(uav);
    }
    let mut pieces = vec![Vec::new(); uavs];
    for (id, owner) in (0..).zip(owners) {
        // What its owner cannot serve, as behind buildings, is left to the first UAV that can.
        let owner = owner.filter(|&uav| table(uav).is_reachable(id));
        let owner = owner.or_else(|| (0..uavs).find(|&uav| table(uav).is_reachable(id)));
        owner.into_iter().for_each(|uav| pieces[uav].push(id));
    }
    pieces
}

/// By kind of UAVs: how much more of the tour it flies in a time than the first one, by the time of the whole tour.
fn times(tables: &[MissionTable], turns: &Turns) -> Vec<f64> {
    let round_slots = |table: &MissionTable| durations(table, turns).iter().sum::<f64>();
    let first_slots = round_slots(&tables[0]);
    let faster = |table: &MissionTable| first_slots / round_slots(table);
    tables.iter().map(faster).map(|times| if times.is_finite() { times } else { 1.0 }).collect()
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
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    fn scenario(uav: &str) -> Scenario {
        Scenario::parse(&format!("name = 'x'\n[uav]\n{uav}"), Path::new("x.toml"), Overrides::default()).unwrap()
    }

    fn nodes(positions_m: &[[f64; 2]]) -> Vec<SensorNode> {
        positions_m.iter().map(|&[x_m, y_m]| SensorNode { x_m, y_m, gain: 1e-5, ..SensorNode::default() }).collect()
    }

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
        let nodes = nodes(&[[10.0, 10.0], [90.0, 90.0], [12.0, 10.0], [88.0, 90.0]]);
        let of = |starts_m: &str| {
            let scenario = scenario(&format!("count = 2\nstarts_m = {starts_m}\n"));
            pieces(&scenario, &nodes, &[100; 2], &Stop::default())
        };
        assert_eq!(of("[[10.0, 20.0], [90.0, 80.0]]"), [[0, 2], [1, 3]]);
        assert_eq!(of("[[90.0, 80.0], [10.0, 20.0]]"), [[1, 3], [0, 2]]);
    }

    #[test]
    fn a_faster_uav_gets_as_much_more_as_it_flies_in_the_same_time() {
        // On a line of 40 SNs, 25 m apart: the second flies 20 m in a slot, the first 10 m.
        let nodes = nodes(&(0..40).map(|step| [25.0 * f64::from(step), 500.0]).collect::<Vec<_>>());
        let of = |each: &str| {
            let text = format!("name = 'x'\n[area]\nside_m = 1000.0\n[uav]\nmax_speed_mps = 10.0\n{each}");
            let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
            pieces(&scenario, &nodes, &[100; 2], &Stop::default()).iter().map(Vec::len).collect::<Vec<_>>()
        };
        let equal = of("[[uav.each]]\n[[uav.each]]\n");
        assert_eq!(equal, of("count = 2\n"));
        let faster = of("[[uav.each]]\n[[uav.each]]\nmax_speed_mps = 20.0\n");
        assert!(equal[1].abs_diff(20) <= 1 && (24..=28).contains(&faster[1]), "{equal:?} {faster:?}");
    }

    #[test]
    fn a_sensor_node_that_its_uav_cannot_serve_is_left_to_one_that_can() {
        // Between the buildings of 50 m only the second UAV, at 60 m, is in range.
        let text = "name = 'x'\n[uav]\nstart_m = [5, 5]\n[[uav.each]]\n[[uav.each]]\naltitude_m = 60.0\n\
                    [[area.building]]\npolygon_m = [[30, 30], [70, 30], [70, 70], [30, 70]]\nheight_m = 50.0\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let nodes = nodes(&[[50.0, 50.0], [10.0, 10.0], [90.0, 90.0]]);
        let pieces = pieces(&scenario, &nodes, &[100; 2], &Stop::default());
        assert!(pieces[1].contains(&0), "{pieces:?}");
    }
}
