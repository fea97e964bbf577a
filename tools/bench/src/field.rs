//! A slot of the field, written into a message, against a copy of its queues.

use std::hint::black_box;
use std::mem::MaybeUninit;
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::message::{FlightReport, Mode};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_field_sim::Field;
use skysink_mission::latency::{Spread, histogram};
use skysink_planner::strategies::uts;

use crate::error::BenchError;
use crate::setting::{BenchEffort, letter, nanoseconds};

/// SNs whose slots are timed together: a slot of few SNs takes no longer than reading the clock.
const BATCH: u64 = 100_000;

/// A slot with so many sensor nodes.
#[derive(Debug, Serialize)]
pub struct FieldRow {
    /// Sensor nodes.
    pub sensors: u32,
    /// Sampling, losses and the ledger, and the new queues into a message.
    pub step: Spread,
    /// A copy of the queues.
    pub copy: Spread,
    /// Median of the step over that of the copy.
    pub step_over_copy: f64,
}

/// Measures slots and copies in turns.
pub fn measure(effort: BenchEffort, stop: &Stop) -> Result<Vec<FieldRow>, BenchError> {
    effort
        .counts()
        .iter()
        .map(|&sensors| stop.check().map_err(BenchError::from).and_then(|()| row(sensors, effort)))
        .collect()
}

fn row(sensors: u32, effort: BenchEffort) -> Result<FieldRow, BenchError> {
    let scenario = letter(sensors, uts::STRATEGY.name);
    let list = SensorList::of(&scenario)?;
    let mut field = Field::new(&scenario, &list);
    let idle = [FlightReport::at([50.0, 50.0, 20.0], Mode::Hold)];
    let mut message = vec![MaybeUninit::new(0); sensors as usize];
    let queues_bits = list.queues_bits();
    let mut copied_bits = queues_bits.clone();
    let batch = (BATCH / u64::from(sensors)).max(1);
    let [mut copies, mut steps] = [(); 2].map(|()| histogram());
    let mut slot = 0;
    let start = Instant::now();
    while start.elapsed() < effort.choose(Duration::from_secs(2), Duration::from_millis(50)) {
        let begin = Instant::now();
        for _ in 0..batch {
            black_box(&mut copied_bits).copy_from_slice(black_box(&queues_bits));
        }
        copies.saturating_record((nanoseconds(begin) / batch).max(1));
        let begin = Instant::now();
        for _ in 0..batch {
            slot += 1;
            black_box(field.step_into(slot, &idle, Some(black_box(&mut message))).expect("a flight without uploads"));
        }
        steps.saturating_record((nanoseconds(begin) / batch).max(1));
    }
    let [copy, step] = [copies, steps].map(|times| Spread::of(&times));
    Ok(FieldRow { sensors, step, copy, step_over_copy: step.p50_us / copy.p50_us })
}
