//! Sensor nodes (SNs) that are served in turn, over and over: what `tour` and `round-robin` have in common.

use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};

use super::nearby::fullest_first;
use super::serving::Serving;
use super::{Decision, View};
use skysink_common::geometry::Position;

/// SNs in a fixed order. A turn ends with the slot that serves its SN.
#[derive(Debug, Clone)]
pub(crate) struct Turns {
    order: Vec<u32>,
    /// Whose turn it is, as an index of `order`.
    turn: usize,
}

impl Turns {
    /// The first of `order` has the first turn.
    pub fn new(order: Vec<u32>) -> Self {
        Self { order, turn: 0 }
    }

    /// The SN whose turn it is; none in an empty field.
    pub fn current(&self) -> Option<u32> {
        self.order.get(self.turn).copied()
    }

    /// The SN whose turn it is next.
    pub fn next(&self) -> Option<u32> {
        self.order.get((self.turn + 1) % self.order.len().max(1)).copied()
    }

    /// Serves from `ground` the SN whose turn it is, if it is in range, and the fullest queues, n in all; ends the turns
    /// of those that are served.
    pub fn serve(&mut self, view: &View, serving: &mut Serving, ground: &Position) -> Decision {
        let current = self.current();
        let key = |id| (Some(id) != current, fullest_first(view.queues_bits[id as usize], id));
        let decision = serving.serve_by(view, ground, key);
        self.advance(&decision.schedule);
        decision
    }

    /// Ends the turns of those that a slot serves.
    fn advance(&mut self, served: &[u32]) {
        for _ in 0..self.order.len() {
            if !served.contains(&self.order[self.turn]) {
                return;
            }
            self.turn = (self.turn + 1) % self.order.len();
        }
    }
}

impl Checkpoint for Turns {
    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&self.turn, bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let turn: usize = decode(bytes)?;
        if turn >= self.order.len().max(1) {
            return Err(CheckpointError::unexpected("turn", turn, format!("less than {}", self.order.len().max(1))));
        }
        self.turn = turn;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slot_ends_the_turns_of_all_that_it_serves() {
        let mut turns = Turns::new(vec![0, 1]);
        turns.advance(&[1]);
        assert_eq!(turns.current(), Some(0), "SN 1 was not at turn");
        turns.advance(&[0, 1]);
        assert_eq!(turns.current(), Some(0), "both turns end with one slot");
        turns.advance(&[0]);
        assert_eq!((turns.current(), turns.next()), (Some(1), Some(0)));
    }

    #[test]
    fn a_checkpoint_of_a_larger_field_is_refused() {
        let mut turns = Turns::new(vec![0, 1]);
        assert!(turns.restore(&[2]).is_err() && turns.restore(&[1]).is_ok());
        assert_eq!(turns.current(), Some(1));
        assert!(Turns::new(Vec::new()).restore(&[0]).is_ok(), "an empty field has one state");
    }
}
