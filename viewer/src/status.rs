//! The status text: results so far, from a slot and the history.

use skysink_common::markup::markdown;
use skysink_common::message::Totals;

use crate::history::SensorHistory;
use crate::names::SensorNames;
use crate::slot::SlotView;

/// The results of a mission after a slot, as two paragraphs of Markdown; the history includes the slot.
/// `clock` is its time.
pub(crate) fn status(view: &SlotView, history: &SensorHistory, names: &SensorNames, clock: &str) -> String {
    let Totals { sampled_bits, delivered_bits, lost_bits, .. } = view.header.totals;
    let loss_rate = history.loss_rate(&view.header.totals);
    let by_sensor = &history.sums.lost_bits;
    let losers = by_sensor.iter().filter(|&&lost_bits| lost_bits > 0).count();
    let overflowing = history.overflows().filter(|&overflows| overflows).count();
    let unseen = match lost_bits.saturating_sub(by_sensor.iter().sum()) {
        0 => String::new(),
        unseen_bits => format!(" ({unseen_bits} bits in slots that the viewer did not see)"),
    };
    let filling = history.overflow_s().enumerate().filter(|(_, full_s)| *full_s > 0.0 && full_s.is_finite());
    let next_full = filling.min_by(|(_, a_s), (_, b_s)| a_s.total_cmp(b_s));
    let next_full = next_full.map_or_else(String::new, |(id, full_s)| {
        format!(", next full: {} in {full_s:.0} s", markdown(&names.name(id)))
    });
    format!(
        "slot {} at {clock}: **η so far {loss_rate:.4}** ({lost_bits} of {sampled_bits} bits lost, {delivered_bits} \
         delivered)\n\n\
         **{losers} of {} SNs have lost data**{unseen}, {overflowing} lose some now{next_full}; {:.0} % of the area \
         was in range",
        view.slot,
        by_sensor.len(),
        100.0 * history.covered()
    )
}

/// The newest slot of a running mission of `slots` slots, as Markdown; `clock` is its time.
pub(crate) fn newest(slot: u64, slots: u64, clock: &str) -> String {
    format!("newest slot **{slot}** of {slots}, at {clock}")
}
