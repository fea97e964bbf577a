//! All slots of a finished run, read from its folder.

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;

use crate::error::MissionError;
use crate::replay::Replay;
use crate::trace::RecordedSlot;

/// A run that has flown all its slots.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedRun {
    /// The scenario as flown.
    pub scenario: Scenario,
    /// The sensor nodes as flown.
    pub list: SensorList,
    /// The strategy, or the label of an external planner.
    pub strategy: String,
    /// Slot t is entry t − 1.
    pub slots: Vec<RecordedSlot>,
    /// By slot: bits uploaded by each served sensor node, in the order of `scheduled`.
    pub uploads_bits: Vec<Vec<u64>>,
}

impl RecordedRun {
    /// Reads the run in `folder`, and flies it again to check it.
    ///
    /// # Errors
    /// If `folder` is not a run folder, the run is not over or ended early, the scenario, the sensor list or the trace
    /// was changed, or on a stop.
    pub fn read(folder: &Path, stop: &Stop) -> Result<Self, MissionError> {
        let mut replay = Replay::open(folder)?;
        let mut slots: Vec<RecordedSlot> = Vec::new();
        let mut uploads_bits = Vec::new();
        let mut before_bits = vec![0; replay.list().sensors().len()];
        while replay.next_slot()?.is_some() {
            stop.check()?;
            slots.extend(replay.last_recorded().cloned());
            let delivered_bits = replay.mission().field().delivered_bits();
            let served = slots.last().map_or(&[][..], |slot| &slot.scheduled);
            let upload_bits = |&sensor: &u32| {
                let sensor = sensor as usize;
                delivered_bits[sensor] - std::mem::replace(&mut before_bits[sensor], delivered_bits[sensor])
            };
            uploads_bits.push(served.iter().map(upload_bits).collect());
        }
        let expected = replay.scenario().slots;
        if slots.len() as u64 != expected {
            let last = slots.len();
            let resume = folder.display();
            let message = format_args!(
                "it ends after slot {last}: expected {expected} slots, of a run that has ended (a run of the ring is \
                 resumed by skysink run --resume {resume})"
            );
            return Err(InputError::new("trace", &folder.join("slots.csv"), message).into());
        }
        let strategy = replay.label().to_owned();
        Ok(Self { scenario: replay.scenario().clone(), list: replay.list().clone(), strategy, slots, uploads_bits })
    }
}
