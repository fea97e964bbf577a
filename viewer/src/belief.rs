//! The estimated queues compared with the true ones, if the UAV has to estimate them.
//!
//! The estimate is computed like that of the planner, from the contacts of every received slot. In a paced run, a
//! planner that has missed contacts has an older estimate.

use std::sync::Arc;

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::Scalars;
use skysink_common::belief::Belief;
use skysink_common::checkpoint::CheckpointError;
use skysink_common::estimate::{Rates, SavedEstimate};
use skysink_common::message::FlightReport;
use skysink_common::reported::ReportedQueues;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;
use skysink_common::slot_record::uploads;
use skysink_common::told::Told;

use crate::canvas::Canvas;
use crate::colour;
use crate::history::SensorHistory;
use crate::maps::{MapFrame, SteppedMap};
use crate::rhythm::Rhythm;
use crate::shapes::curve_style;
use crate::steps::Steps;

/// Map of the estimated queues.
pub const BELIEVED: &str = "belief/believed";
/// Map of the true queues.
pub const TRUE: &str = "belief/true";
/// Map of the difference of both.
pub const ERROR: &str = "belief/error";
/// Mean absolute error, as a fraction of the buffer.
pub const MEAN_ERROR: &str = "metrics/belief/mean_error";
/// Largest absolute error, as a fraction of the buffer.
pub const LARGEST_ERROR: &str = "metrics/belief/largest_error";

/// The estimated queues of the scene.
pub(crate) struct BeliefMaps {
    belief: Belief,
    sensors: Arc<Sensors>,
    /// Whether the estimate is valid, because the mission has been followed from its start.
    is_followed: bool,
    believed: SteppedMap,
    truth: SteppedMap,
    error: SteppedMap,
    rhythm: Rhythm,
}

impl BeliefMaps {
    /// Draws what stays.
    pub(crate) fn open(
        canvas: &Canvas,
        scenario: &Scenario,
        sensors: &Arc<Sensors>,
        rates: Rates,
        frame: &MapFrame,
    ) -> RecordingStreamResult<Self> {
        let curves = [(MEAN_ERROR, "mean", colour::FILL_MEAN), (LARGEST_ERROR, "largest", colour::FULLEST)];
        for (entity, name, colour) in curves {
            canvas.log_static(entity, &curve_style(name, colour))?;
        }
        Ok(Self {
            belief: Belief::new(scenario, sensors, Some(rates)),
            sensors: Arc::clone(sensors),
            is_followed: false,
            believed: SteppedMap::of_sensors(canvas, BELIEVED, frame, Steps::of_fill())?,
            truth: SteppedMap::of_sensors(canvas, TRUE, frame, Steps::of_fill())?,
            error: SteppedMap::of_sensors(canvas, ERROR, frame, Steps::of_errors())?,
            rhythm: Rhythm::of_sensors(sensors.count(), scenario.slots),
        })
    }

    /// Updates the estimate with the contacts of a slot, which follows `before`.
    pub(crate) fn observe(&mut self, before: &SensorHistory, slot: u64, told: Told<'_>, flights: &[FlightReport]) {
        self.is_followed |= slot == 0;
        if !self.is_followed {
            return;
        }
        let is_known = |id: &u32| (*id as usize) < told.queues_bits.len();
        let served = uploads(flights).map(|link| link.sensor).filter(is_known);
        let reported = match before.sums.slot {
            Some(last) if last + 1 == slot => self.belief.reported(slot, served, &before.sums.queues_bits),
            _ => ReportedQueues::default(),
        };
        self.belief.advance(slot, flights, &reported, told);
    }

    /// Draws the estimated and the true queues after the last observed slot. Draws nothing if the viewer has missed the
    /// start of the mission, because the initial estimate is then unknown.
    pub(crate) fn draw(&mut self, canvas: &Canvas, slot: u64, queues_bits: &[u32]) -> RecordingStreamResult<()> {
        if !self.is_followed {
            return Ok(());
        }
        let sampling = &self.sensors.sampling;
        let believed_bits = self.belief.at(slot, &self.sensors, queues_bits).queues_bits;
        let fraction =
            |bits: f64, capacity_bits: u32| if capacity_bits == 0 { 0.0 } else { bits / f64::from(capacity_bits) };
        let capacities_bits = (0..queues_bits.len()).map(|id| sampling.of(id).capacity_bits);
        let pairs = || believed_bits.iter().zip(queues_bits).zip(capacities_bits.clone());
        let errors = || {
            pairs().map(|((&believed_bits, &queue_bits), capacity_bits)| {
                fraction(f64::from(believed_bits) - f64::from(queue_bits), capacity_bits)
            })
        };
        let mean = errors().map(f64::abs).sum::<f64>() / queues_bits.len().max(1) as f64;
        canvas.append(MEAN_ERROR, &Scalars::single(mean))?;
        canvas.append(LARGEST_ERROR, &Scalars::single(errors().map(f64::abs).fold(0.0, f64::max)))?;
        if self.rhythm.is_due(slot) {
            let percent = |bits: u32, capacity_bits: u32| Some(100.0 * fraction(f64::from(bits), capacity_bits));
            self.believed.show_sensors(canvas, pairs().map(|((&bits, _), capacity)| percent(bits, capacity)))?;
            self.truth.show_sensors(canvas, pairs().map(|((_, &bits), capacity)| percent(bits, capacity)))?;
            self.error.show_sensors(canvas, errors().map(|error| Some(100.0 * error)))?;
        }
        Ok(())
    }

    /// The state to save; `None` if the viewer has missed the start of the mission.
    pub(crate) fn saved(&self) -> Option<SavedEstimate> {
        self.belief.saved().filter(|_| self.is_followed)
    }

    /// Restores the state after `slot`.
    ///
    /// # Errors
    /// If the state is invalid.
    pub(crate) fn restore(&mut self, slot: u64, saved: SavedEstimate) -> Result<(), CheckpointError> {
        self.belief = self.belief.restored(slot, Some(saved))?;
        self.is_followed = true;
        Ok(())
    }
}
