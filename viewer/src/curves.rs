//! The plotted curves: loss, queue fill, deliveries, planning time and pace.

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{Scalars, SeriesLines};
use re_sdk_types::components::InterpolationMode;
use skysink_common::scenario::Scenario;

use crate::canvas::Canvas;
use crate::colour::{self, Rgb};
use crate::queues::Fill;
use crate::readout::capacities_j;
use crate::rhythm::Rhythm;
use crate::shapes::curve_style;
use crate::slot::SlotView;
use crate::uav::name_of;

/// Lost ÷ sampled bits since the start.
pub const LOSS: &str = "metrics/loss_rate";
/// A constant at 1 %, so that the axis of the loss rate is readable for a mission without loss.
pub const LOSS_MARK: &str = "metrics/loss_rate/mark";
/// Mean queue ÷ buffer.
pub const FILL_MEAN: &str = "metrics/queue_fill/mean";
/// Fullest queue ÷ its buffer.
pub const FILL_MAX: &str = "metrics/queue_fill/max";
/// Bits delivered in a slot, in kbit.
pub const DELIVERED: &str = "metrics/delivered";
/// Bits sampled in a slot, in kbit; only of arrivals at random.
pub const SAMPLED: &str = "metrics/sampled";
/// Energy in the battery of the first UAV, in per cent of its capacity, and below it, by number, in those of the
/// others; only with a battery.
pub const BATTERY: &str = "metrics/battery";
/// Wall time of planning a slot, in ms.
pub const PLAN_LATENCY: &str = "metrics/plan_latency";
/// Slots per second of wall time.
pub const PACE: &str = "metrics/slots_per_second";
/// Slots that the viewer has missed since the start of the file.
pub const MISSED: &str = "metrics/missed_slots";

/// Entity, name with unit, colour, and the value in a slot, from its fill and the number of missed slots; `None` if it
/// was not measured.
type Curve = (&'static str, &'static str, Rgb, fn(&SlotView, Fill, u64) -> Option<f64>);

const CURVES: [Curve; 8] = [
    (LOSS, "lost ÷ sampled", colour::LOSS, |_, fill, _| Some(fill.loss_rate)),
    (LOSS_MARK, "1 % mark", colour::MISSED, |_, _, _| Some(0.01)),
    (FILL_MAX, "fullest", colour::FULLEST, |_, fill, _| Some(fill.max)),
    (FILL_MEAN, "mean", colour::FILL_MEAN, |_, fill, _| Some(fill.mean)),
    (DELIVERED, "delivered [kbit]", colour::DELIVERY, |view, _, _| Some(view.header.delivered_bits as f64 / 1e3)),
    (PLAN_LATENCY, "plan [ms]", colour::CLOCK, |view, _, _| view.plan_ms),
    (PACE, "pace [slot/s]", colour::CLOCK, |view, _, _| view.slots_per_s),
    (MISSED, "missed [slots]", colour::MISSED, |_, _, missed_slots| Some(missed_slots as f64)),
];

/// The entities of the batteries of a mission, UAV by UAV, and their colours; none without batteries.
pub(crate) fn batteries(scenario: &Scenario) -> Vec<(String, Rgb)> {
    let uavs = scenario.uav.uavs();
    let paint = |uav| if uavs == 1 { colour::CHARGE } else { colour::of_uav(uav) };
    (0..uavs)
        .filter(|&uav| scenario.uav_of(uav).battery.is_some())
        .map(|uav| (name_of(BATTERY, uav), paint(uav)))
        .collect()
}

/// Curves that rarely change.
const RARE: [&str; 2] = [LOSS_MARK, MISSED];

/// Number of slots between two points of [`RARE`] curves.
const RARE_EVERY: u64 = 10;

/// The curves of a mission.
#[derive(Debug)]
pub(crate) struct Curves {
    /// Missed slots up to the last drawn slot.
    missed_slots: Option<u64>,
    rare: Rhythm,
    /// By UAV: energy of the full battery [J]; `None` without one.
    capacities_j: Vec<Option<f64>>,
}

impl Curves {
    /// Logs names and colours of the curves of a mission.
    pub(crate) fn open(canvas: &Canvas, scenario: &Scenario, has_random_arrivals: bool) -> RecordingStreamResult<Self> {
        let capacities_j = capacities_j(scenario);
        let numbers = capacities_j.iter().enumerate().filter_map(|(uav, capacity_j)| capacity_j.map(|_| uav));
        for (uav, (entity, paint)) in numbers.zip(batteries(scenario)) {
            let name = if scenario.uav.uavs() == 1 { "battery [%]".to_owned() } else { format!("UAV {uav} [%]") };
            canvas.log_static(entity, &curve_style(&name, paint))?;
        }
        if has_random_arrivals {
            canvas.log_static(SAMPLED, &curve_style("sampled [kbit]", colour::BURST))?;
        }
        for (entity, name, colour, _) in CURVES {
            canvas.log_static(entity, &curve_style(name, colour))?;
        }
        let steps = SeriesLines::update_fields().with_interpolation_mode(InterpolationMode::StepAfter);
        canvas.log_static(MISSED, &steps)?; // whatever slots have points
        Ok(Self { missed_slots: None, rare: Rhythm::every(RARE_EVERY, scenario.slots), capacities_j })
    }

    /// Logs one point per curve.
    pub(crate) fn log_slot(
        &mut self,
        canvas: &Canvas,
        view: &SlotView,
        fill: Fill,
        missed_slots: u64,
        sampled_bits: Option<u64>,
    ) -> RecordingStreamResult<()> {
        if self.missed_slots.replace(missed_slots) != Some(missed_slots) {
            self.rare.restart();
        }
        let has_rare = self.rare.is_due(view.slot);
        let is_due = |entity| has_rare || !RARE.contains(&entity);
        for (entity, _, _, number) in CURVES.into_iter().filter(|(entity, ..)| is_due(*entity)) {
            if let Some(number) = number(view, fill, missed_slots) {
                canvas.append(entity, &Scalars::single(number))?;
            }
        }
        for (row, capacity_j) in view.uavs().zip(&self.capacities_j) {
            let Some(capacity_j) = capacity_j else { continue };
            canvas.append(name_of(BATTERY, row.uav), &Scalars::single(100.0 * row.flight.energy_j / capacity_j))?;
        }
        if let Some(sampled_bits) = sampled_bits {
            canvas.append(SAMPLED, &Scalars::single(sampled_bits as f64 / 1e3))?;
        }
        Ok(())
    }
}
