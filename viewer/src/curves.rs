//! The curves beside the scene: what the mission achieves and how fast it is computed.

use rerun::{RecordingStream, RecordingStreamResult, Scalars};

use crate::colour::{self, Rgb};
use crate::queues::Fill;
use crate::shapes::curve_style;
use crate::slot::SlotView;

/// Lost ÷ sampled bits since the start.
pub const LOSS: &str = "metrics/loss_rate";
/// A constant beside it, so that its axis never ends below 1 % and a mission without loss has a readable one.
pub const LOSS_MARK: &str = "metrics/loss_rate/mark";
/// Mean queue ÷ storage.
pub const FILL_MEAN: &str = "metrics/queue_fill/mean";
/// Fullest queue ÷ its storage.
pub const FILL_MAX: &str = "metrics/queue_fill/max";
/// Bits delivered in a slot, in kbit.
pub const DELIVERED: &str = "metrics/delivered";
/// Wall time of planning a slot, in ms.
pub const PLAN_LATENCY: &str = "metrics/plan_latency";
/// Slots per second of wall time.
pub const PACE: &str = "metrics/slots_per_second";
/// Slots that the viewer missed, counted in each file from its beginning.
pub const MISSED: &str = "metrics/missed_slots";

/// Entity, name with unit, colour.
const STYLES: [(&str, &str, Rgb); 8] = [
    (LOSS, "lost ÷ sampled", colour::LOSS),
    (LOSS_MARK, "1 % mark", colour::MISSED),
    (FILL_MAX, "fullest", colour::FULLEST),
    (FILL_MEAN, "mean", colour::MEAN),
    (DELIVERED, "delivered [kbit]", colour::DELIVERY),
    (PLAN_LATENCY, "plan [ms]", colour::CLOCK),
    (PACE, "pace [slot/s]", colour::ROTOR),
    (MISSED, "missed [slots]", colour::MISSED),
];

/// Names and colours, once.
pub(crate) fn open(stream: &RecordingStream) -> RecordingStreamResult<()> {
    for (entity, name, colour) in STYLES {
        stream.log_static(entity, &curve_style(name, colour))?;
    }
    Ok(())
}

/// One point per curve; those by the wall clock only where it was measured.
pub(crate) fn log_slot(
    stream: &RecordingStream,
    view: &SlotView,
    fill: Fill,
    missed_slots: u64,
) -> RecordingStreamResult<()> {
    let totals = &view.header.totals;
    let loss_rate = if totals.sampled_bits == 0 { 0.0 } else { totals.lost_bits as f64 / totals.sampled_bits as f64 };
    let points = [
        (LOSS, Some(loss_rate)),
        (LOSS_MARK, Some(0.01)),
        (FILL_MEAN, Some(fill.mean)),
        (FILL_MAX, Some(fill.max)),
        (DELIVERED, Some(view.header.delivered_bits as f64 / 1e3)),
        (PLAN_LATENCY, view.plan_ms),
        (PACE, view.slots_per_s),
        (MISSED, Some(missed_slots as f64)),
    ];
    for (entity, value) in points {
        if let Some(value) = value {
            stream.log(entity, &Scalars::single(value))?;
        }
    }
    Ok(())
}
