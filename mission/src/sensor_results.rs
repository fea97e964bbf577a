//! The results of each sensor node (SN) of a mission: `sensors_out.csv`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use skysink_common::csv_cell::decimal;
use skysink_common::message::LinkReport;
use skysink_common::slot_record::{SlotRecord, uploads};

use crate::ages::{AgeRun, sum};
use crate::drive::Observer;
use crate::error::MissionError;
use crate::files::write_whole;
use crate::plant::Plant;
use crate::record::SENSOR_RESULTS;
use crate::replay::Replay;

/// Its header.
const COLUMNS: &str = "sensor,x_m,y_m,sampled_bits,delivered_bits,lost_bits,queued_bits,loss_rate,served_slots,\
                       mean_age_s,longest_gap_s,first_loss_slot";

/// Running sums of one SN.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SensorSums {
    served_slots: u64,
    /// The age since the last service.
    age: AgeRun,
    /// Sum of the ages [slots] after all slots before that service.
    ages: u64,
    longest_gap: u64,
    lost_bits: u64,
    first_loss: Option<u64>,
}

impl SensorSums {
    const NONE: Self =
        Self { served_slots: 0, age: AgeRun::FIRST, ages: 0, longest_gap: 0, lost_bits: 0, first_loss: None };

    /// Adds a service in `slot`, after which the age is 0.
    fn serve(&mut self, slot: u64) {
        let ages = self.age.refresh(slot, slot);
        self.longest_gap = self.longest_gap.max(ages.end);
        self.ages += sum(&ages);
        self.served_slots += 1;
    }

    /// Sum of the ages after all slots, and the longest gap [slots], if `slot` is the last slot.
    fn totals_after(&self, slot: u64) -> [u64; 2] {
        let ages = self.age.ages(slot + 1);
        let last_gap = ages.end.saturating_sub(1);
        [self.ages + sum(&ages), self.longest_gap.max(last_gap)]
    }
}

/// The sums of all SNs of a mission.
#[derive(Debug)]
pub struct SensorTally(Vec<SensorSums>);

/// The results of one SN, as in a line of the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorResult {
    /// Bits that it has sampled.
    pub sampled_bits: u64,
    /// Bits that it has uploaded.
    pub delivered_bits: u64,
    /// Bits that it has lost.
    pub lost_bits: u64,
    /// Its queue at the end [bit].
    pub queued_bits: u32,
    /// Lost bits as a fraction of the sampled bits; 0 where nothing is sampled.
    pub loss_rate: f64,
    /// Slots in which it was served.
    pub served_slots: u64,
    /// Mean time since its last service, over the slots [s].
    pub mean_age_s: f64,
    /// Longest time without service [s].
    pub longest_gap_s: f64,
    /// The first slot in which it lost data.
    pub first_loss_slot: Option<u64>,
}

impl SensorTally {
    /// The sums of `count` SNs before slot 1.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self(vec![SensorSums::NONE; count])
    }

    /// The results of the SNs, by id, of a mission with slots of `slot_s` [s] that left `plant`.
    pub fn results(&self, plant: &Plant, slot_s: f64) -> impl Iterator<Item = SensorResult> {
        let slots = plant.slot();
        let field = plant.field();
        self.0.iter().enumerate().map(move |(id, sums)| {
            let [ages, longest_gap] = sums.totals_after(slots);
            let sampled_bits = field.sampled_bits(id);
            SensorResult {
                sampled_bits,
                delivered_bits: field.delivered_bits()[id],
                lost_bits: sums.lost_bits,
                queued_bits: field.queues_bits()[id],
                loss_rate: if sampled_bits == 0 { 0.0 } else { sums.lost_bits as f64 / sampled_bits as f64 },
                served_slots: sums.served_slots,
                mean_age_s: if slots == 0 { 0.0 } else { ages as f64 / slots as f64 * slot_s },
                longest_gap_s: longest_gap as f64 * slot_s,
                first_loss_slot: sums.first_loss,
            }
        })
    }
}

impl Observer for SensorTally {
    fn slot(&mut self, record: &SlotRecord, plant: &Plant) -> Result<(), MissionError> {
        let slot = record.slot();
        let has_answered = |link: &&LinkReport| plant.field().has_answered(link.sensor);
        for link in uploads(record.flights()).filter(has_answered) {
            self.0[link.sensor as usize].serve(slot);
        }
        for (sums, lost_bits) in self.0.iter_mut().zip(plant.field().lost_bits()) {
            if lost_bits > sums.lost_bits {
                sums.first_loss.get_or_insert(slot);
                sums.lost_bits = lost_bits;
            }
        }
        Ok(())
    }
}

/// Writes the results of each SN to the folder of a run that was flown again, with `tally` as an observer. Returns the
/// path of the file.
///
/// # Errors
/// If the file cannot be written.
pub fn write(folder: &Path, replay: &Replay, tally: &SensorTally) -> Result<PathBuf, MissionError> {
    let path = folder.join(SENSOR_RESULTS);
    write_whole(&path, csv(replay, tally).as_bytes())?;
    Ok(path)
}

/// The file's text.
fn csv(replay: &Replay, tally: &SensorTally) -> String {
    let list = replay.list();
    let mut text = COLUMNS.to_owned();
    let has_weights = list.has_own_weights();
    if has_weights {
        text.push_str(",weight");
    }
    list.end_line(&mut text, "name");
    let results = tally.results(replay.plant(), replay.scenario().slot_s);
    for ((id, sensor), result) in list.sensors().iter().enumerate().zip(results) {
        let SensorResult { sampled_bits, delivered_bits, lost_bits, queued_bits, loss_rate, .. } = result;
        let SensorResult { served_slots, mean_age_s, longest_gap_s, first_loss_slot, .. } = result;
        let [x_m, y_m] = [sensor.position.x, sensor.position.y].map(decimal);
        let [loss_rate, mean_age_s, longest_gap_s] = [loss_rate, mean_age_s, longest_gap_s].map(decimal);
        let first_loss_slot = first_loss_slot.map_or_else(String::new, |slot| slot.to_string());
        write!(
            text,
            "{id},{x_m},{y_m},{sampled_bits},{delivered_bits},{lost_bits},{queued_bits},{loss_rate},{served_slots},\
             {mean_age_s},{longest_gap_s},{first_loss_slot}"
        )
        .expect("a string takes everything");
        if has_weights {
            write!(text, ",{}", decimal(sensor.weight)).expect("a string takes everything");
        }
        list.end_line(&mut text, list.name(id).unwrap_or_default());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ages_and_gaps_follow_the_services() {
        // Served in slots 2 and 5 of 7: ages after each slot 1, 0, 1, 2, 0, 1, 2; gaps 2, 3 and, to the end, 2.
        let mut sums = SensorSums::NONE;
        sums.serve(2);
        sums.serve(5);
        assert_eq!((sums.totals_after(7), sums.served_slots), ([7, 3], 2));
    }

    #[test]
    fn the_age_of_an_unserved_sensor_node_counts_from_the_start() {
        assert_eq!(SensorSums::NONE.totals_after(4), [1 + 2 + 3 + 4, 4]);
        assert_eq!(SensorSums::NONE.totals_after(0), [0, 0]);
    }

    #[test]
    fn the_age_of_an_always_served_sensor_node_is_0() {
        let mut sums = SensorSums::NONE;
        (1..=4).for_each(|slot| sums.serve(slot));
        assert_eq!(sums.totals_after(4), [0, 1]);
    }
}
