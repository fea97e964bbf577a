//! `tour`: a short round that touches the disks of radius `d_c` about all sensor nodes (SNs), flown repeatedly.
//!
//! The round is a close-enough travelling salesman tour ([`Disks::round`](crate::geometry::round::Disks::round)). Each
//! SN has its turn where the round touches its disk. The UAV flies from disk to disk, and serves the current SN as soon
//! as it is in range, with the n − 1 fullest of the others.

use skysink_common::geometry::Position;

use super::turns::InTurn;
use crate::geometry::disks::{Disk, nearest_in_both, slots_between};
use crate::geometry::turns::Turns;
use crate::mission_table::MissionTable;
use crate::strategy::{Registered, Setup};

/// The strategy in the registry.
pub const STRATEGY: Registered =
    Registered::new("tour", "a short round that passes in range of all sensor nodes, flown repeatedly", |setup| {
        Box::new(round(setup))
    })
    .with_state()
    .without_weights();

/// The round of a UAV.
pub(crate) fn round(setup: &Setup) -> InTurn {
    let turns = setup.table.turns(setup.stop).as_ref().clone();
    let begin = |turns: &Turns, start: &Position| turns.near(|at| setup.table.motion.distance_m2(at, start));
    InTurn::new(setup, turns, true, begin, waypoint)
}

/// Slots to the range of an SN from which on the UAV flies to the point of the round: over short legs whole slots count
/// more than metres.
const MANY_SLOTS: f64 = 3.0;

/// Where to fly from `position`: in as few slots as it takes to get in range of `current`, and to the point in range
/// that is nearest to `next`; on a long leg to `point`, where the round touches the range. Around zones it is the
/// shortest way into the range.
fn waypoint(table: &MissionTable, position: &Position, [current, next]: [&Position; 2], point: &Position) -> Position {
    let MissionTable { limits, .. } = table;
    let range = Disk { centre: *current, radius_m: limits.comm_radius_m };
    let slots = slots_between(position, &range, limits.reach_m);
    let airspace = &table.airspace;
    let around =
        || table.motion.path_into(position, &range).last().map_or(*position, |end| table.motion.toward(position, end));
    if slots >= MANY_SLOTS {
        return if airspace.is_free(position, point) { table.motion.toward(position, point) } else { around() };
    }
    let reach = Disk { centre: *position, radius_m: limits.reach_m * slots };
    let end = nearest_in_both(next, &reach, &range);
    if !airspace.is_free(position, &end) {
        return around();
    }
    position + (end - position) / slots
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;
    use crate::strategies::tests::{made, setup_of};
    use crate::strategy::Strategy;
    use crate::strategy::tests::view;
    use skysink_common::stop::Stop;

    /// From `position`, toward SN 0 with the last SN after it; the round touches SN 0 at (50, 99).
    fn from(position: [f64; 2], positions_m: &[[f64; 2]]) -> Position {
        let table = table_of(positions_m);
        let last = table.sensors.positions[table.sensors.positions.len() - 1];
        waypoint(&table, &position.into(), [&table.sensors.positions[0], &last], &Position::new(50.0, 99.0))
    }

    #[test]
    fn a_tour_turns_at_the_rim_toward_the_next_sensor_node() {
        let positions = [[50.0, 90.0], [90.0, 90.0]];
        // SN 0 is 40 m away, in range after 30 m; the one point there is (50, 80).
        assert!((from([50.0, 50.0], &positions) - Position::new(50.0, 80.0)).norm() < 1e-4);
        // From (50, 70) the whole disk around SN 0 is in reach; (60, 90) is nearest to SN 1.
        assert!((from([50.0, 70.0], &positions) - Position::new(60.0, 90.0)).norm() < 1e-9);
    }

    #[test]
    fn a_leg_of_two_slots_is_flown_in_equal_steps() {
        // 48 m away, 38 m to the rim, two slots; alone, its own next: (50, 98) is 24 m a slot.
        assert!((from([50.0, 50.0], &[[50.0, 98.0]]) - Position::new(50.0, 74.0)).norm() < 1e-9);
    }

    #[test]
    fn a_long_leg_is_flown_to_the_point_of_the_round() {
        // 85 m to the rim, three slots.
        assert!((from([50.0, 0.0], &[[50.0, 95.0]]) - Position::new(50.0, 30.0)).norm() < 1e-9);
        assert!((from([90.0, 19.0], &[[50.0, 99.0]]) - Position::new(90.0 - 13.4164, 19.0 + 26.8328)).norm() < 1e-3);
    }

    /// Least number of slots in which `strategy` serves one of `positions_m`, full of data, of 200 slots.
    fn least_visits(table: &MissionTable, strategy: &mut dyn Strategy, count: usize) -> usize {
        let mut ground = [50.0, 50.0];
        let mut visits = vec![0; count];
        for slot in 1..=200 {
            let decision = strategy.plan(&view(table, slot, ground, &vec![9; count])).unwrap();
            ground = [decision.waypoint.x, decision.waypoint.y];
            decision.schedule.iter().for_each(|&id| visits[id as usize] += 1);
        }
        visits.into_iter().min().unwrap()
    }

    #[test]
    fn a_tour_skips_sensor_nodes_served_in_passing() {
        let positions: Vec<[f64; 2]> =
            (0..40).map(|index| [f64::from(index * 37 % 100), f64::from(index * 53 % 97)]).collect();
        let (table, mut tour) = made("tour", &positions);
        let field = setup_of(&positions);
        let mut turns = field.table.turns(&Stop::default()).as_ref().clone();
        turns.begin_near(|point| field.table.motion.distance_m2(point, &Position::new(50.0, 50.0)));
        let mut forgetful = InTurn::new(&field.setup(), turns, false, |_, _| 0, waypoint);
        let [with, without] =
            [tour.as_mut(), &mut forgetful].map(|strategy| least_visits(&table, strategy, positions.len()));
        assert!(with > without, "{with} {without}");
    }

    #[test]
    fn the_tour_of_an_empty_field_stays_at_its_start() {
        let (table, mut tour) = made("tour", &[]);
        let decision = tour.plan(&view(&table, 1, [7.0, 8.0], &[])).unwrap();
        assert_eq!((decision.waypoint.xy(), decision.schedule.len()), (Position::new(7.0, 8.0), 0));
        let mut bytes = Vec::new();
        tour.save(&mut bytes);
        assert!(tour.restore(&bytes).is_ok());
    }
}
