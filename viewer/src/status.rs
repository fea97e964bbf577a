//! The status text: results so far, from a slot and the history.

use skysink_common::message::Totals;

use crate::curves;
use crate::history::SensorHistory;
use crate::slot::SlotView;

/// The results of a mission after a slot, as two paragraphs of Markdown; the history includes the slot.
/// `names` are those of the sensor nodes, or none.
pub(crate) fn status(view: &SlotView, history: &SensorHistory, names: &[String]) -> String {
    let Totals { sampled_bits, delivered_bits, lost_bits, .. } = view.header.totals;
    let loss_rate = curves::loss_rate(&view.header.totals);
    let by_sensor = &history.sums.lost_bits;
    let losers = by_sensor.iter().filter(|&&lost_bits| lost_bits > 0).count();
    let overflowing = history.overflows().filter(|&overflows| overflows).count();
    let unseen = match lost_bits.saturating_sub(by_sensor.iter().sum()) {
        0 => String::new(),
        unseen_bits => format!(" ({unseen_bits} bits in slots that the viewer did not see)"),
    };
    let filling = history.overflow_s().enumerate().filter(|(_, full_s)| *full_s > 0.0 && full_s.is_finite());
    let next_full = filling.min_by(|(_, a_s), (_, b_s)| a_s.total_cmp(b_s));
    let label = |id: usize| names.get(id).filter(|name| !name.is_empty()).map_or(format!("SN {id}"), String::clone);
    let next_full =
        next_full.map_or_else(String::new, |(id, full_s)| format!(", next full: {} in {full_s:.0} s", label(id)));
    format!(
        "slot {}: **η so far {loss_rate:.4}** ({lost_bits} of {sampled_bits} bits lost, {delivered_bits} delivered)\n\n\
         **{losers} of {} SNs have lost data**{unseen}, {overflowing} lose some now{next_full}; {:.0} % of the area was in \
         range",
        view.slot,
        by_sensor.len(),
        100.0 * history.covered()
    )
}
