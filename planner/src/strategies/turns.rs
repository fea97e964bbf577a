//! Cyclic service of sensor nodes (SNs) in a fixed order, the common part of `tour` and `round-robin`.

use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::geometry::{Position, within};

use super::nearby::fullest_first;
use super::serving::Serving;
use crate::mission_table::MissionTable;
use crate::strategy::{Decision, Setup, Strategy, View};

/// The waypoint from a position toward the current SN, `[0]`, given the next one, `[1]`.
type Waypoint = fn(&MissionTable, &Position, [&Position; 2]) -> Position;

/// A strategy that serves SNs in a fixed order. A turn ends with the slot that serves its SN.
pub(crate) struct InTurn {
    order: Vec<u32>,
    /// Index in `order` of the current SN.
    turn: usize,
    /// The same in the slot before.
    before: usize,
    waypoint: Waypoint,
    serving: Serving,
}

impl InTurn {
    /// Starts with the first SN of `order`.
    pub fn new(setup: &Setup, order: Vec<u32>, waypoint: Waypoint) -> Self {
        Self { order, turn: 0, before: 0, waypoint, serving: Serving::new(setup) }
    }

    /// Goes back to the first SN of the slot before that is out of range of where it ended, at `ground`: it was not
    /// served.
    fn go_back(&mut self, table: &MissionTable, ground: &Position) {
        while self.before != self.turn {
            let position = table.sensors.position(self.order[self.before]);
            if !within(position, ground, table.limits.comm_radius_m) {
                self.turn = self.before;
                return;
            }
            self.before = (self.before + 1) % self.order.len();
        }
    }

    /// Skips the SNs that a slot serves.
    fn advance(&mut self, served: &[u32]) {
        for _ in 0..self.order.len() {
            if !served.contains(&self.order[self.turn]) {
                return;
            }
            self.turn = (self.turn + 1) % self.order.len();
        }
    }
}

impl Strategy for InTurn {
    /// Serves the current SN, if it is in range, and the fullest queues, n in all. In an empty field the UAV holds its
    /// position.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        let ground = view.ground();
        self.go_back(view.table, &ground);
        self.before = self.turn;
        let current = self.order.get(self.turn).copied();
        let waypoint = current.map_or(ground, |current| {
            let next = self.order[(self.turn + 1) % self.order.len()];
            (self.waypoint)(view.table, &ground, [current, next].map(|id| view.table.sensors.position(id)))
        });
        let key = |id| (Some(id) != current, fullest_first(view.value(id), id));
        let decision = self.serving.serve_by(view, &waypoint, key);
        self.advance(&decision.schedule);
        Some(decision)
    }
}

impl Checkpoint for InTurn {
    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&(self.before, self.turn), bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let (before, turn): (usize, usize) = decode(bytes)?;
        CheckpointError::ensure(before.max(turn) < self.order.len().max(1), "a turn of this field")?;
        (self.before, self.turn) = (before, turn);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::strategies::tests::made;
    use crate::strategy::tests::view;

    #[test]
    fn a_slot_ends_the_turns_of_all_that_it_serves() {
        // SN 1 is within 10 m of (50, 80), where the slot toward SN 0 ends; SN 2 is beside SN 0.
        let (table, mut strategy) = made("round-robin", &[[50.0, 95.0], [50.0, 75.0], [50.0, 94.0]]);
        let mut served = |slot, ground| strategy.plan(&view(&table, slot, ground, &[9; 3])).unwrap().schedule;
        assert_eq!(served(1, [50.0, 50.0])[..], [1], "SN 1 was not at turn");
        assert_eq!(served(2, [50.0, 80.0])[..], [0, 2], "SN 2 was not at turn, either: it is SN 1's");
        assert_eq!(served(3, [50.0, 90.0])[..], [1]);
        assert_eq!(served(4, [50.0, 75.0])[..], [0, 2], "the turn of SN 2, and then of SN 0: both end with one slot");
        assert_eq!(served(5, [50.0, 94.0])[..], [1]);
    }

    #[test]
    fn an_sn_out_of_range_of_where_the_slot_ended_keeps_its_turn() {
        // SNs 0 and 1 are in range of (50, 80), and SN 2 is not.
        let (table, mut strategy) = made("round-robin", &[[50.0, 80.0], [50.0, 88.0], [50.0, 20.0]]);
        let mut served = |slot, ground| strategy.plan(&view(&table, slot, ground, &[9; 3])).unwrap().schedule;
        assert_eq!(served(1, [50.0, 51.0])[..], [0, 1]);
        assert_eq!(served(2, [50.0, 77.0])[..], [0, 1], "SN 1 was 11 m away: its turn, and SN 0 is in range again");
        assert_eq!(served(3, [50.0, 99.0])[..], [0, 1], "11 m again");
        assert_eq!(served(4, [50.0, 96.0])[..], [0; 0], "on the way to SN 2");
        assert_eq!(served(5, [50.0, 36.0])[..], [2]);
    }

    #[test]
    fn a_checkpoint_of_a_larger_field_is_refused() {
        let (table, mut strategy) = made("round-robin", &[[50.0, 70.0], [50.0, 30.0]]);
        assert!(
            strategy.restore(&[2, 0]).is_err()
                && strategy.restore(&[0, 2]).is_err()
                && strategy.restore(&[1, 1]).is_ok()
        );
        let decision = strategy.plan(&view(&table, 1, [50.0, 50.0], &[9; 2])).unwrap();
        assert_eq!(decision.schedule[..], [1]);
        assert!(made("round-robin", &[]).1.restore(&[0, 0]).is_ok(), "an empty field has one state");
    }
}
