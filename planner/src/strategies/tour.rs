//! `tour`: a short closed tour over all sensor nodes (SNs), flown round and round.

use skysink_common::checkpoint::{Checkpoint, CheckpointError};
use skysink_common::geometry::Position;

use super::serving::Serving;
use super::turns::Turns;
use super::{Decision, Registered, Setup, Strategy, View};
use crate::geometry::tour::closed_tour;
use crate::horizon::flight::{aim, slots_for};
use crate::sensor_table::SensorTable;

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered {
    name: "tour",
    about: "a short tour over all sensor nodes, flown round and round",
    is_stateless: false,
    has_path: false,
    make: |setup| Box::new(Tour::new(setup)),
};

struct Tour {
    turns: Turns,
    serving: Serving,
}

impl Tour {
    fn new(setup: &Setup) -> Self {
        let order = order(setup.table, &setup.scenario.start().xy());
        Self { turns: Turns::new(order), serving: Serving::new(setup) }
    }
}

/// A closed tour that starts at the SN nearest to `start`.
fn order(table: &SensorTable, start: &Position) -> Vec<u32> {
    let mut order = closed_tour(table.area, &table.positions);
    let away_m2 = |&id: &u32| (table.position(id) - start).norm_squared();
    let first = (0..order.len()).min_by(|&a, &b| away_m2(&order[a]).total_cmp(&away_m2(&order[b])));
    order.rotate_left(first.unwrap_or(0));
    order
}

/// Where to fly from `position`: in as few slots as it takes to get in range of the SN whose turn it is, and to the point
/// in range that is nearest to the next one.
fn waypoint(turns: &Turns, table: &SensorTable, position: &Position) -> Position {
    let (Some(current), Some(next)) = (turns.current(), turns.next()) else {
        return *position;
    };
    let goal = table.position(current);
    let slots = slots_for(position, table.reach_m, goal, table.comm_radius_m);
    let end = aim(position, table.reach_m * slots, goal, table.comm_radius_m, table.position(next));
    position + (end - position) / slots
}

impl Strategy for Tour {
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        let waypoint = waypoint(&self.turns, view.table, &view.ground());
        Some(self.turns.serve(view, &mut self.serving, &waypoint))
    }
}

impl Checkpoint for Tour {
    fn save(&self, bytes: &mut Vec<u8>) {
        self.turns.save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        self.turns.restore(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor_table::tests::table_of;

    fn turns(places_m: &[[f64; 2]]) -> (SensorTable, Turns) {
        let table = table_of(places_m);
        let turns = Turns::new(order(&table, &Position::new(50.0, 50.0)));
        (table, turns)
    }

    #[test]
    fn a_tour_turns_at_the_rim_and_looks_one_sensor_node_ahead() {
        let (table, turns) = turns(&[[50.0, 90.0], [90.0, 90.0]]);
        // SN 0 is 40 m away, in range after 30 m; the one point there is (50, 80).
        assert_eq!(turns.current(), Some(0));
        assert!((waypoint(&turns, &table, &Position::new(50.0, 50.0)) - Position::new(50.0, 80.0)).norm() < 1e-4);
        // From (50, 70) the whole disk around SN 0 is in reach; (60, 90) is nearest to SN 1.
        assert!((waypoint(&turns, &table, &Position::new(50.0, 70.0)) - Position::new(60.0, 90.0)).norm() < 1e-9);
    }

    #[test]
    fn a_leg_of_two_slots_is_flown_in_equal_steps() {
        let (table, turns) = turns(&[[50.0, 98.0]]);
        // 48 m away, 38 m to the rim, two slots; alone, its own next: (50, 98) is 24 m a slot.
        assert!((waypoint(&turns, &table, &Position::new(50.0, 50.0)) - Position::new(50.0, 74.0)).norm() < 1e-9);
    }
}
