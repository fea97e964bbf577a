//! The sensor nodes within a radius of the UAV: the candidates of both searches, fullest first.

use skysink_common::geometry::{Position, within};
use skysink_common::told::Told;

use crate::mission_table::MissionTable;
use skysink_common::sensors::grid::PRESELECTION_MARGIN;

/// A candidate sensor node (SN) in a slot.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Spot {
    /// Position, `L_i`.
    pub(crate) position: Position,
    /// Queue, `B_i(t−1)` [bit].
    pub(crate) queue_bits: u32,
    pub(crate) id: u32,
}

/// Sort key of an SN with `queue_bits` [bit]: larger queues come first, then lower indices (decision D7).
pub(crate) fn fullest_first(queue_bits: u32, id: u32) -> u64 {
    u64::from(u32::MAX - queue_bits) << 32 | u64::from(id)
}

/// The queue [bit] and the index of a sort key.
fn unpacked(key: u64) -> (u32, u32) {
    (u32::MAX - (key >> 32) as u32, key as u32)
}

/// The candidates of a slot, with working memory.
#[derive(Debug, Clone, Default)]
pub(crate) struct Nearby {
    /// Fullest first: the first n that pass a test are the n fullest that do.
    pub(crate) spots: Vec<Spot>,
    /// Their sort keys: sorting these instead of the candidates takes a third of the instructions.
    keys: Vec<u64>,
}

impl Nearby {
    /// Never allocates for up to `sensors` SNs.
    pub(crate) fn with_room_for(sensors: usize) -> Self {
        Self { spots: Vec::with_capacity(sensors), keys: Vec::with_capacity(sensors) }
    }

    /// Fills the candidates with the SNs that send within `radius_m` [m] of `position`, or a thousandth more.
    pub(crate) fn preselect<'t>(
        &mut self,
        table: &MissionTable,
        position: &Position,
        radius_m: f64,
        told: impl Into<Told<'t>>,
    ) {
        let told = told.into();
        let Self { spots, keys } = self;
        keys.clear();
        let is_open = table.airspace.is_open();
        table.sensors.grid.visit_within(position, radius_m * PRESELECTION_MARGIN, |node| {
            if told.answer(node.id).sends() && (is_open || table.may_serve_next(position, &node.position)) {
                keys.push(fullest_first(told.queues_bits[node.id as usize], node.id));
            }
        });
        keys.sort_unstable();
        spots.clear();
        spots.extend(keys.iter().map(|&key| {
            let (queue_bits, id) = unpacked(key);
            Spot { position: table.sensors.positions[id as usize], queue_bits, id }
        }));
    }

    /// Upper bound on what `count` more SNs add to a set: the `count` fullest queues [bit].
    pub(crate) fn most_bits(&self, count: usize) -> u64 {
        sum_bits(self.spots.iter().take(count))
    }
}

/// `Σ B_i` [bit].
pub(crate) fn sum_bits<'a>(spots: impl IntoIterator<Item = &'a Spot>) -> u64 {
    spots.into_iter().map(|spot| u64::from(spot.queue_bits)).sum()
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
        let mut nearby = Nearby { spots: vec![Spot::default()], keys: vec![7] };
        nearby.preselect(&table, &Position::new(50.0, 50.0), 10.0, &[3, 9, 0, 9, 99]);
        let spot = |queue_bits, id: u32| Spot { position: table.sensors.positions[id as usize], queue_bits, id };
        assert_eq!(nearby.spots, [spot(9, 1), spot(9, 3), spot(3, 0), spot(0, 2)]);
    }

    #[test]
    fn the_sort_key_orders_the_largest_numbers() {
        assert!(fullest_first(u32::MAX, u32::MAX) < fullest_first(u32::MAX - 1, 0));
        assert!(fullest_first(0, 0) < fullest_first(0, 1));
        assert_eq!(unpacked(fullest_first(7, u32::MAX)), (7, u32::MAX));
    }
}
