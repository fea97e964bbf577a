//! In which slots something is drawn.

use crate::sizes::MAX_BARS;

/// Slots after which the SNs of a field that is too large for bars are drawn again on maps.
const LARGE_EVERY: u64 = 10;

/// When something is drawn: in the first slot of a file, in the last of the mission, and once in every so many.
#[derive(Debug)]
pub(crate) struct Rhythm {
    every: u64,
    last_slot: u64,
    /// The slot in which it was drawn last.
    drawn: Option<u64>,
}

impl Rhythm {
    /// That of what is drawn once in `every` slots, of a mission that ends with `last_slot`.
    pub(crate) fn every(every: u64, last_slot: u64) -> Self {
        Self { every, last_slot, drawn: None }
    }

    /// That of maps of so many SNs: every slot, or now and then if there are too many for bars.
    pub(crate) fn of_sensors(count: usize, last_slot: u64) -> Self {
        Self::every(if count <= MAX_BARS { 1 } else { LARGE_EVERY }, last_slot)
    }

    /// Whether to draw in this slot, which the caller then does.
    pub(crate) fn is_due(&mut self, slot: u64) -> bool {
        let is_due = self.drawn.is_none_or(|drawn| slot / self.every != drawn / self.every) || slot == self.last_slot;
        if is_due {
            self.drawn = Some(slot);
        }
        is_due
    }

    /// Draws in the next slot, whichever it is.
    pub(crate) fn restart(&mut self) {
        self.drawn = None;
    }
}
