//! The sensor nodes that can be served from within reach: the candidates of both searches, fullest first.

use skysink_common::geometry::{Position, within};

use crate::mission_table::MissionTable;
use skysink_common::sensors::grid::PRESELECTION_MARGIN;

/// A candidate sensor node (SN) in a slot.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Spot {
    /// Position, `L_i`.
    pub(crate) position: Position,
    /// Queue, `B_i(t−1)` [bit].
    pub(crate) queue_bits: u32,
    /// Its id.
    pub(crate) id: u32,
}

/// Sort key of an SN with `queue_bits` [bit]: larger queues come first, then lower indices (decision D7).
pub(crate) fn fullest_first(queue_bits: u32, id: u32) -> u64 {
    u64::from(u32::MAX - queue_bits) << 32 | u64::from(id)
}

/// Fills `spots` with the SNs within `radius_m` [m] of `position`, or a thousandth more, fullest first: the first n
/// that pass a test are the n fullest that do.
pub(crate) fn preselect(
    spots: &mut Vec<Spot>,
    table: &MissionTable,
    position: &Position,
    radius_m: f64,
    queues_bits: &[u32],
) {
    spots.clear();
    let is_open = table.airspace.is_open();
    table.sensors.grid.visit_within(position, radius_m * PRESELECTION_MARGIN, |node| {
        if !is_open && !table.may_serve_next(position, &node.position) {
            return;
        }
        spots.push(Spot { position: node.position, queue_bits: queues_bits[node.id as usize], id: node.id });
    });
    spots.sort_unstable_by_key(|spot| fullest_first(spot.queue_bits, spot.id));
}

/// Whether one waypoint may have both SNs in range, or a thousandth more.
pub(crate) fn may_share(table: &MissionTable, a: &Spot, b: &Spot) -> bool {
    within(&a.position, &b.position, 2.0 * table.limits.comm_radius_m * PRESELECTION_MARGIN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission_table::tests::table_of;

    #[test]
    fn candidates_are_sorted_by_queue_then_index() {
        let table = table_of(&[[50.0, 50.0], [52.0, 50.0], [54.0, 50.0], [56.0, 50.0], [61.0, 50.0]]);
        let mut spots = vec![Spot::default()];
        preselect(&mut spots, &table, &Position::new(50.0, 50.0), 10.0, &[3, 9, 0, 9, 99]);
        assert_eq!(
            spots.iter().map(|spot| (spot.queue_bits, spot.id)).collect::<Vec<_>>(),
            [(9, 1), (9, 3), (3, 0), (0, 2)]
        );
    }

    #[test]
    fn the_sort_key_orders_the_largest_numbers() {
        assert!(fullest_first(u32::MAX, u32::MAX) < fullest_first(u32::MAX - 1, 0));
        assert!(fullest_first(0, 0) < fullest_first(0, 1));
    }
}
