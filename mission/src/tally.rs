//! The running sums of a run with the figures that are counted slot by slot, and the summary of both.

use std::time::Duration;

use skysink_common::message::QueuesHeader;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::SlotRecord;

use crate::drive::SlotSink;
use crate::error::MissionError;
use crate::figures::{SlotCounts, Summary};
use crate::origin::RunMode;
use crate::sums::{CountedSlot, MissionSums, RunSums};

/// All from which the summary of a run is computed.
#[derive(Debug)]
pub struct Tally {
    /// The sums.
    pub sums: RunSums,
    /// The figures that are counted slot by slot.
    pub counts: SlotCounts,
}

impl Tally {
    /// The tally before slot 1 of a run flown like `mode`. A run with a pace also measures latencies.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList, mode: &RunMode) -> Self {
        Self { sums: RunSums::new(scenario, list, mode), counts: SlotCounts::default() }
    }

    /// Marks the slots added so far as recorded by an earlier run that is now resumed. Figures of the solver and of
    /// planning times are those of the slots after them.
    pub fn resume(&mut self) {
        self.counts.restart();
        self.sums.resume();
    }

    /// The summary of the run so far, after the wall time `wall`.
    pub fn summary(&self, wall: Duration, trace_hash: u64) -> Summary {
        let timing = self.sums.timing(wall);
        Summary::of(&MissionSums { run: &self.sums, field: None, timing, trace_hash }, &self.counts)
    }
}

impl SlotSink for Tally {
    fn start(&mut self, header: &QueuesHeader) {
        self.sums.totals = header.totals;
    }

    /// Adds a slot.
    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
        let slot = CountedSlot { record };
        self.sums.add(&slot);
        self.counts.add(&slot);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Plant;
    use crate::drive::Observer;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    /// The loss rates after four slots in which nobody is served, of SNs with 50 bit per slot.
    fn loss_rates(rows: &str) -> (f64, Option<f64>) {
        let text = "name = 'x'\nslots = 4\n[sensors]\nsampling_bps = 50.0\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let text = format!("x_m,y_m,queue_bits,capacity_bits,weight\n{rows}");
        let list = SensorList::parse(&text, Path::new("l.csv"), &scenario).unwrap();
        let mut plant = Plant::new(&scenario, &list);
        let mut tally = Tally::new(&scenario, &list, &RunMode::default());
        tally.begin(&plant).unwrap();
        for _ in 0..4 {
            plant.step(&[None]);
            tally.slot(plant.record(), &plant).unwrap();
        }
        let summary = tally.summary(Duration::ZERO, 0);
        (summary.loss_rate, summary.weighted_loss_rate)
    }

    #[test]
    fn lost_bits_are_weighted_by_sensor_node() {
        // The first SN loses all its 200 bit, the second none: 200 of 400, and 3 · 200 of (3 + 1) · 200.
        assert_eq!(loss_rates("1,2,100,100,3\n3,4,0,1000,1\n"), (0.5, Some(0.75)));
        assert_eq!(loss_rates("1,2,0,1000,3\n3,4,100,100,1\n"), (0.5, Some(0.25)));
        assert_eq!(loss_rates("1,2,100,100,3\n3,4,0,1000,3\n"), (0.5, None), "equal weights are η");
    }
}
