//! What arrivals at random do to the buffers and to the load (decision D24).

use std::fmt;

use serde::Serialize;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

use super::quantity::{percent, scaled};

/// Most draws for the figures of this mission: slots times sensor nodes.
const MOST_DRAWS: f64 = 5e6;

/// The arrivals of a mission.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ArrivalFigures {
    /// Standard deviation of the bits of an SN in a slot, divided by their mean.
    pub slot_spread: f64,
    /// Standard deviation of the bits of an SN, divided by their mean, over the slots in which an empty buffer fills.
    pub fill_spread: f64,
    /// Variance of the bits of a slot divided by their mean, as the planner is told of a trace [bit].
    pub told_dispersion_bits: Option<f64>,
    /// What this mission samples; `None` if that were too many draws.
    pub mission: Option<SampledFigures>,
}

/// The bits that a mission samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SampledFigures {
    /// All of them.
    pub sampled_bits: u64,
    /// Divided by their mean, `Σ s_i τ T`.
    pub of_mean: f64,
    /// The bits of the slot with most of them.
    pub busiest_bits: u64,
    /// Variance of the bits of an SN in a slot, divided by their mean, over all SNs [bit].
    pub dispersion_bits: f64,
}

impl ArrivalFigures {
    /// The figures of a mission; `None` if its arrivals are constant.
    pub fn of(scenario: &Scenario, list: &SensorList) -> Option<Self> {
        let law = scenario.arrival_law();
        let sampling = list.sampling(scenario);
        let ids = || (0..list.sensors().len()).filter(|&id| sampling.of(id).mean_bits > 0.0);
        let count = ids().count() as f64;
        let mean_bits = ids().map(|id| sampling.of(id).mean_bits).sum::<f64>() / count;
        let fill_slots = ids().map(|id| sampling.of(id).fill_slots()).sum::<f64>() / count;
        let spread = |slots: f64| law.variance_bits2(mean_bits, slots).sqrt() / (mean_bits * slots);
        let is_counted = count * scenario.slots as f64 <= MOST_DRAWS;
        (law.is_random() && count > 0.0).then(|| Self {
            slot_spread: spread(1.0),
            fill_spread: spread(fill_slots),
            told_dispersion_bits: scenario.trace.is_some().then(|| law.dispersion_bits(mean_bits)),
            mission: is_counted.then(|| {
                let mut squares_bits2 = 0.0;
                let slot_bits = (1..=scenario.slots).map(|slot| {
                    let bits = ids().map(|id| sampling.bits(id, slot));
                    bits.inspect(|&bits| squares_bits2 += (bits as f64).powi(2)).sum::<u64>()
                });
                let slot_bits: Vec<u64> = slot_bits.collect();
                let sampled_bits: u64 = slot_bits.iter().sum();
                let draws = count * scenario.slots as f64;
                let drawn_mean_bits = sampled_bits as f64 / draws;
                SampledFigures {
                    sampled_bits,
                    of_mean: sampled_bits as f64 / (mean_bits * draws),
                    busiest_bits: slot_bits.into_iter().max().unwrap_or(0),
                    dispersion_bits: squares_bits2 / draws / drawn_mean_bits - drawn_mean_bits,
                }
            }),
        })
    }
}

impl fmt::Display for ArrivalFigures {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [slot, fill] = [self.slot_spread, self.fill_spread].map(percent);
        write!(formatter, "a slot of an SN varies by {slot}, a full buffer by {fill}")?;
        let Some(mission) = &self.mission else { return Ok(()) };
        let [sampled, busiest] = [mission.sampled_bits, mission.busiest_bits].map(|bits| scaled(bits as f64, "bit"));
        let of_mean = percent(mission.of_mean);
        write!(formatter, "; this mission samples {sampled}, {of_mean} of the mean, at most {busiest} in a slot")
    }
}
