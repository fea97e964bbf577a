//! The status text: results so far, from a slot and the history.

use std::fmt::{self, Display, Formatter};

use skysink_common::message::Totals;

use crate::curves;
use crate::history::SensorHistory;
use crate::slot::SlotView;

/// The results of a mission after a slot.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MissionStatus {
    slot: u64,
    totals: Totals,
    sensors: usize,
    /// Sensor nodes (SNs) that have lost data.
    losers: usize,
    /// SNs that lost data in the slot.
    overflowing: usize,
    /// Bits lost in slots that the viewer has missed.
    unseen_bits: u64,
    /// The SN whose buffer is full next, and the time until then [s].
    next_full: Option<(usize, f64)>,
    /// The fraction of the area that has been in range.
    covered: f64,
}

impl MissionStatus {
    /// Computes the results; the history includes the slot.
    pub(crate) fn of(view: &SlotView, history: &SensorHistory) -> Self {
        let totals = view.header.totals;
        let lost_bits = history.lost_bits();
        let filling = history.overflow_s().enumerate().filter(|(_, full_s)| *full_s > 0.0 && full_s.is_finite());
        Self {
            slot: view.slot,
            totals,
            sensors: lost_bits.len(),
            losers: lost_bits.iter().filter(|&&lost_bits| lost_bits > 0).count(),
            overflowing: history.overflows().filter(|&overflows| overflows).count(),
            unseen_bits: totals.lost_bits.saturating_sub(lost_bits.iter().sum()),
            next_full: filling.min_by(|(_, a_s), (_, b_s)| a_s.total_cmp(b_s)),
            covered: history.covered(),
        }
    }
}

impl Display for MissionStatus {
    /// Formats two paragraphs of Markdown.
    fn fmt(&self, text: &mut Formatter<'_>) -> fmt::Result {
        let Totals { sampled_bits, delivered_bits, lost_bits, .. } = self.totals;
        let loss_rate = curves::loss_rate(&self.totals);
        write!(text, "slot {}: **η so far {loss_rate:.4}** ", self.slot)?;
        write!(text, "({lost_bits} of {sampled_bits} bits lost, {delivered_bits} delivered)\n\n")?;
        write!(text, "**{} of {} SNs have lost data**", self.losers, self.sensors)?;
        if self.unseen_bits > 0 {
            write!(text, " ({} bits in slots that the viewer did not see)", self.unseen_bits)?;
        }
        write!(text, ", {} lose some now", self.overflowing)?;
        if let Some((id, full_s)) = self.next_full {
            write!(text, ", next full: SN {id} in {full_s:.0} s")?;
        }
        write!(text, "; {:.0} % of the area was in range", 100.0 * self.covered)
    }
}
