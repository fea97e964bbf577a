//! `gfs`: the greedy flight strategy, a baseline of the UTS letter (arXiv 2103.00753).
//!
//! The waypoint is the sensor node with the fullest queue in reach; the n fullest queues in range of it are served.

use skysink_common::geometry::Position;
use skysink_common::told::Told;

use crate::mission_table::MissionTable;
use crate::serving::Serving;
use crate::serving::nearby::fullest_first;
use crate::strategy::{Registered, rule};

/// The strategy in the registry.
pub const STRATEGY: Registered = Registered::new("gfs", "greedy flight to the fullest queue in reach", |setup| {
    let mut serving = Serving::new(setup);
    let mut room = Vec::new();
    rule(move |view| {
        let waypoint = greedy_waypoint(view.table, &view.ground(), view.told(view.values(&mut room)))?;
        Some(serving.serve_fullest(view, &waypoint))
    })
});

/// The SN with the largest queue within `V τ`, ties to the lowest index (decision D7); `None` if there is none. Among
/// zones only SNs whose range one slot leads into.
fn greedy_waypoint<'t>(table: &MissionTable, position: &Position, told: impl Into<Told<'t>>) -> Option<Position> {
    let told = told.into();
    let mut fullest: Option<(u64, Position)> = None;
    table.sensors.grid.visit_within(position, table.limits.reach_m, |node| {
        let key = fullest_first(told.queues_bits[node.id as usize], node.id);
        let is_fuller = fullest.is_none_or(|(least, _)| key < least);
        if is_fuller && told.answer(node.id).sends() && table.may_serve_next(position, &node.position) {
            fullest = Some((key, node.position));
        }
    });
    fullest.map(|(_, position)| position)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;

    #[test]
    fn gfs_takes_the_fullest_queue_in_reach_then_the_lowest_index() {
        let table = table_of(&[[50.0, 81.0], [50.0, 80.0], [20.0, 50.0], [60.0, 50.0]]);
        let position = Position::new(50.0, 50.0);
        // SN 0 is 31 m away, out of reach; SNs 1 and 2 exactly 30 m.
        assert_eq!(greedy_waypoint(&table, &position, &[9, 7, 7, 6]), Some(table.sensors.positions[1]));
        assert_eq!(greedy_waypoint(&table, &position, &[9, 7, 8, 6]), Some(table.sensors.positions[2]));
        assert_eq!(greedy_waypoint(&table, &Position::new(50.0, 0.0), &[9, 7, 7, 6]), None);
    }
}
