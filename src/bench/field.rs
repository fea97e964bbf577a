//! A slot of the field, written into a message, beside a copy of its queues.

use std::hint::black_box;
use std::mem::MaybeUninit;
use std::time::{Duration, Instant};

use serde::Serialize;
use skysink_common::message::{FlightReport, Mode};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_field_sim::Field;

use super::{Effort, Times, counts, letter};
use crate::error::Error;
use skysink_mission::latency::Spread;

/// Sensor nodes whose slots are timed together: few of them take no longer than reading the clock.
const TOGETHER: u64 = 100_000;

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

/// Measures slots and copies alternately.
///
/// # Errors
/// If the sensor list is refused, or on a stop.
pub fn measure(effort: Effort, stop: &Stop) -> Result<Vec<FieldRow>, Error> {
    let row = |&sensors: &u32| {
        stop.check()?;
        row(sensors, effort)
    };
    counts(effort).iter().map(row).collect()
}

fn row(sensors: u32, effort: Effort) -> Result<FieldRow, Error> {
    let scenario = letter(sensors, "uts");
    let list = SensorList::of(&scenario)?;
    let mut field = Field::new(&scenario, &list);
    let idle = FlightReport::at([50.0, 50.0, 20.0], Mode::Hold);
    let mut message = vec![MaybeUninit::new(0); sensors as usize];
    let (queues_bits, mut copy) = (list.queues_bits(), vec![0; sensors as usize]);
    let (mut steps, mut copies, mut slot) = (Times::new(), Times::new(), 0);
    let together = (TOGETHER / u64::from(sensors)).max(1);
    let budget = effort.choose(Duration::from_secs(2), Duration::from_millis(50));
    let start = Instant::now();
    while start.elapsed() < budget {
        let begin = Instant::now();
        for _ in 0..together {
            black_box(&mut copy).copy_from_slice(black_box(&queues_bits));
        }
        copies.add(begin, together);
        let begin = Instant::now();
        for _ in 0..together {
            slot += 1;
            black_box(
                field.step_into(slot, &idle, Some(black_box(&mut message))).expect("a flight that serves nobody"),
            );
        }
        steps.add(begin, together);
    }
    let (step, copy) = (steps.spread(), copies.spread());
    Ok(FieldRow { sensors, step, copy, step_over_copy: step.p50_us / copy.p50_us })
}
