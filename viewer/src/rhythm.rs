//! Decides in which slots entities are drawn.

use crate::sizes::MAX_BARS;

/// Number of slots between two updates of the maps, for fields that are too large for bars.
const LARGE_EVERY: u64 = 10;

/// Draws in the first slot of a file, in the last slot of the mission, and once in every K slots.
#[derive(Debug)]
pub(crate) struct Rhythm {
    every: u64,
    last_slot: u64,
    /// The last drawn slot.
    drawn: Option<u64>,
}

impl Rhythm {
    /// Draws once in `every` slots, in a mission that ends with `last_slot`.
    pub(crate) fn every(every: u64, last_slot: u64) -> Self {
        Self { every, last_slot, drawn: None }
    }

    /// The rhythm of maps with `count` SNs: every slot, or once in [`LARGE_EVERY`] slots if there are too many for
    /// bars.
    pub(crate) fn of_sensors(count: usize, last_slot: u64) -> Self {
        Self::every(if count <= MAX_BARS { 1 } else { LARGE_EVERY }, last_slot)
    }

    /// Whether to draw in this slot. The caller must then draw.
    pub(crate) fn is_due(&mut self, slot: u64) -> bool {
        let is_due = self.drawn.is_none_or(|drawn| slot / self.every != drawn / self.every) || slot == self.last_slot;
        if is_due {
            self.drawn = Some(slot);
        }
        is_due
    }

    /// Draws in the next slot.
    pub(crate) fn restart(&mut self) {
        self.drawn = None;
    }
}
