//! The baselines that take sensor nodes (SNs) in turn: `tour`, `round-robin` and `max-age-first`.
//!
//! Unlike the strategies of one slot they remember whose turn it is, or who was served when.

use skysink_common::geometry::Position;

use crate::geometry::tour::closed_tour;
use crate::horizon::flight::{aim, slots_for};
use crate::memory::{MemoryError, Reader};
use crate::sensor_table::SensorTable;
use crate::settings::Strategy;
use crate::strategies::baselines::toward;
use crate::strategies::nearby::fullest_first;

/// SNs in a fixed order, over and over: a turn ends with the slot that serves its SN.
#[derive(Debug, Clone)]
pub struct Rounds {
    strategy: Strategy,
    order: Vec<u32>,
    /// Whose turn it is, as an index of `order`.
    turn: usize,
}

impl Rounds {
    /// The rounds of `tour`, a short closed tour that starts at the SN nearest to `start`, or of `round-robin`, which
    /// goes by id.
    #[must_use]
    pub fn new(strategy: Strategy, table: &SensorTable, start: &Position) -> Self {
        let mut order: Vec<u32> = table.ids().collect();
        if strategy == Strategy::Tour {
            order = closed_tour(table.area, &table.positions);
            let away_m2 = |&id: &u32| (table.position(id) - start).norm_squared();
            let first = (0..order.len()).min_by(|&a, &b| away_m2(&order[a]).total_cmp(&away_m2(&order[b])));
            order.rotate_left(first.unwrap_or(0));
        }
        Self { strategy, order, turn: 0 }
    }

    /// The SN whose turn it is; none in an empty field.
    #[must_use]
    pub fn current(&self) -> Option<u32> {
        self.order.get(self.turn).copied()
    }

    /// Where to fly from `position`. `round-robin`: straight toward the SN, until above it. `tour`: in as few slots as
    /// it takes to get in range, and to the point in range that is nearest to the next SN.
    #[must_use]
    pub fn waypoint(&self, table: &SensorTable, position: &Position) -> Position {
        let Some(current) = self.current() else {
            return *position;
        };
        let goal = table.position(current);
        if self.strategy == Strategy::RoundRobin {
            return toward(table, position, goal);
        }
        let next = table.position(self.order[(self.turn + 1) % self.order.len()]);
        let slots = slots_for(position, table.reach_m, goal, table.comm_radius_m);
        let end = aim(position, table.reach_m * slots, goal, table.comm_radius_m, next);
        position + (end - position) / slots
    }

    /// Fills `ids` with the SN whose turn it is, if it is in range of `waypoint`, and the fullest queues, n in all,
    /// ascending by id.
    pub fn serve(&self, table: &SensorTable, waypoint: &Position, queues_bits: &[u32], ids: &mut Vec<u32>) {
        ids.clear();
        table.grid.visit_within(waypoint, table.comm_radius_m, |node| ids.push(node.id));
        ids.sort_unstable_by_key(|&id| (Some(id) != self.current(), fullest_first(queues_bits[id as usize], id)));
        ids.truncate(table.resource_blocks);
        ids.sort_unstable();
    }

    /// Ends the turns of those that a slot serves.
    pub fn advance(&mut self, served: &[u32]) {
        for _ in 0..self.order.len() {
            if !served.contains(&self.order[self.turn]) {
                return;
            }
            self.turn = (self.turn + 1) % self.order.len();
        }
    }

    /// Appends what the next slot has to know.
    pub(crate) fn remember(&self, bytes: &mut Vec<u8>) {
        bytes.extend(u32::try_from(self.turn).expect("a turn is below the number of ids").to_le_bytes());
    }

    /// Goes on from a memory.
    pub(crate) fn recall(&mut self, mut memory: Reader) -> Result<(), MemoryError> {
        let turn = memory.number(u32::try_from(self.order.len()).unwrap_or(u32::MAX).saturating_sub(1))?;
        if !memory.numbers(0)?.is_empty() {
            return Err(memory.malformed());
        }
        self.turn = turn as usize;
        Ok(())
    }
}

/// When each SN was scheduled last.
#[derive(Debug, Clone)]
pub struct Ages {
    /// Slot of the last service, 0 before the first, by id.
    last: Vec<u32>,
}

impl Ages {
    /// Nobody served yet.
    #[must_use]
    pub fn new(table: &SensorTable) -> Self {
        Self { last: vec![0; table.positions.len()] }
    }

    /// Sort key: those that wait longest come first, of these the fullest, then the lowest index.
    fn oldest_first(&self, queues_bits: &[u32], id: u32) -> (u32, u64) {
        (self.last[id as usize], fullest_first(queues_bits[id as usize], id))
    }

    /// Straight, at full speed, toward the SN that has waited longest, until above it.
    #[must_use]
    pub fn waypoint(&self, table: &SensorTable, position: &Position, queues_bits: &[u32]) -> Position {
        let oldest = table.ids().min_by_key(|&id| self.oldest_first(queues_bits, id));
        oldest.map_or(*position, |oldest| toward(table, position, table.position(oldest)))
    }

    /// Fills `ids` with the n in range of `waypoint` that have waited longest, ascending by id.
    pub fn serve(&self, table: &SensorTable, waypoint: &Position, queues_bits: &[u32], ids: &mut Vec<u32>) {
        ids.clear();
        table.grid.visit_within(waypoint, table.comm_radius_m, |node| ids.push(node.id));
        ids.sort_unstable_by_key(|&id| self.oldest_first(queues_bits, id));
        ids.truncate(table.resource_blocks);
        ids.sort_unstable();
    }

    /// Notes who is served in `slot`.
    pub fn advance(&mut self, slot: u64, served: &[u32]) {
        let slot = u32::try_from(slot).unwrap_or(u32::MAX);
        served.iter().for_each(|&id| self.last[id as usize] = slot);
    }

    /// Appends what the next slot has to know.
    pub(crate) fn remember(&self, bytes: &mut Vec<u8>) {
        self.last.iter().for_each(|slot| bytes.extend(slot.to_le_bytes()));
    }

    /// Goes on from a memory.
    pub(crate) fn recall(&mut self, mut memory: Reader) -> Result<(), MemoryError> {
        let last = memory.numbers(u32::MAX)?;
        if last.len() != self.last.len() {
            return Err(memory.malformed());
        }
        self.last = last;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory;
    use crate::sensor_table::tests::table_of;

    fn rounds(strategy: Strategy, places_m: &[[f64; 2]]) -> (SensorTable, Rounds) {
        let table = table_of(places_m);
        let rounds = Rounds::new(strategy, &table, &Position::new(50.0, 50.0));
        (table, rounds)
    }

    #[test]
    fn round_robin_flies_straight_over_each_in_turn() {
        let (table, mut rounds) = rounds(Strategy::RoundRobin, &[[80.0, 90.0], [50.0, 60.0]]);
        // (30, 40) is 50 m away: 30 m of it are (18, 24); then 20 m are left.
        assert_eq!(rounds.waypoint(&table, &Position::new(50.0, 50.0)), Position::new(68.0, 74.0));
        assert_eq!(rounds.waypoint(&table, &Position::new(68.0, 74.0)), table.positions[0]);
        rounds.advance(&[1]);
        assert_eq!(rounds.current(), Some(0), "SN 1 was not at turn");
        rounds.advance(&[0, 1]);
        assert_eq!(rounds.current(), Some(0), "both turns end with one slot");
        rounds.advance(&[0]);
        assert_eq!(rounds.current(), Some(1));
    }

    #[test]
    fn a_tour_turns_at_the_rim_and_looks_one_sensor_node_ahead() {
        let (table, rounds) = rounds(Strategy::Tour, &[[50.0, 90.0], [90.0, 90.0]]);
        // SN 0 is 40 m away, in range after 30 m; the one point there is (50, 80).
        assert_eq!(rounds.current(), Some(0));
        assert!((rounds.waypoint(&table, &Position::new(50.0, 50.0)) - Position::new(50.0, 80.0)).norm() < 1e-4);
        // From (50, 70) the whole disk around SN 0 is in reach; (60, 90) is nearest to SN 1.
        assert!((rounds.waypoint(&table, &Position::new(50.0, 70.0)) - Position::new(60.0, 90.0)).norm() < 1e-9);
    }

    #[test]
    fn a_leg_of_two_slots_is_flown_in_equal_steps() {
        let (table, rounds) = rounds(Strategy::Tour, &[[50.0, 98.0]]);
        // 48 m away, 38 m to the rim, two slots; alone, its own next: (50, 98) is 24 m a slot.
        assert!((rounds.waypoint(&table, &Position::new(50.0, 50.0)) - Position::new(50.0, 74.0)).norm() < 1e-9);
    }

    #[test]
    fn whose_turn_it_is_is_served_before_fuller_queues() {
        let places = [[50.0, 50.0], [51.0, 50.0], [52.0, 50.0], [53.0, 50.0], [54.0, 50.0]];
        let (table, mut rounds) = rounds(Strategy::RoundRobin, &places);
        let mut ids = Vec::new();
        rounds.serve(&table, &Position::new(50.0, 50.0), &[1, 9, 8, 7, 6], &mut ids);
        assert_eq!(ids, [0, 1, 2, 3]);
        rounds.advance(&[0]);
        rounds.serve(&table, &Position::new(50.0, 50.0), &[1, 9, 8, 7, 6], &mut ids);
        assert_eq!(ids, [1, 2, 3, 4]);
    }

    #[test]
    fn who_has_waited_longest_is_flown_to_and_served_first() {
        let table = table_of(&[[50.0, 50.0], [51.0, 50.0], [52.0, 50.0], [53.0, 50.0], [50.0, 70.0]]);
        let (mut ages, mut ids) = (Ages::new(&table), Vec::new());
        let (here, queues_bits) = (Position::new(50.0, 50.0), [5, 9, 5, 5, 8]);
        assert_eq!(ages.waypoint(&table, &here, &queues_bits), table.positions[1], "of equals the fullest");
        ages.advance(1, &[0, 1, 2]);
        ages.advance(2, &[4]);
        assert_eq!(ages.waypoint(&table, &here, &queues_bits), table.positions[3]);
        ages.advance(3, &[3]);
        ages.serve(&SensorTable { resource_blocks: 2, ..table.clone() }, &here, &queues_bits, &mut ids);
        assert_eq!(ids, [0, 1], "of SNs 0, 1 and 2 the fullest, then the lowest index");
    }

    #[test]
    fn a_memory_of_another_field_is_refused() {
        let (table, mut rounds) = rounds(Strategy::Tour, &[[50.0, 90.0], [90.0, 90.0]]);
        let mut bytes = Vec::new();
        memory::begin(&mut bytes, Strategy::Tour, 3, None);
        bytes.extend(2u32.to_le_bytes());
        assert!(rounds.recall(Reader::new(&bytes, Strategy::Tour, 3).unwrap()).is_err());
        memory::begin(&mut bytes, Strategy::MaxAgeFirst, 3, None);
        bytes.extend([0; 12]);
        assert!(Ages::new(&table).recall(Reader::new(&bytes, Strategy::MaxAgeFirst, 3).unwrap()).is_err());
    }
}
