//! What a mission comes to for each sensor node (SN): `sensors_out.csv`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use skysink_common::message::FlightReport;
use skysink_common::stop::Stop;
use skysink_field_sim::Field;

use crate::error::MissionError;
use crate::record::write_whole;
use crate::replay::Replay;

/// The file, in the run's folder.
pub(crate) const FILE: &str = "sensors_out.csv";

/// Its header.
const COLUMNS: &str = "sensor,x_m,y_m,sampled_bits,delivered_bits,lost_bits,queued_bits,loss_rate,served_slots,\
                       mean_age_s,longest_gap_s,first_loss_slot\n";

/// Running sums of one SN.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct SensorSums {
    served_slots: u64,
    /// Slot of the last service; 0 before the first.
    last_served: u64,
    /// Sum of the ages after every slot up to that service [slots].
    ages: u64,
    longest_gap: u64,
    lost_bits: u64,
    first_loss: Option<u64>,
}

impl SensorSums {
    /// The service in `slot`: the age was 1, 2, ... up to the slot before, and is 0 after it.
    fn serve(&mut self, slot: u64) {
        self.pass_until(slot - 1);
        self.longest_gap = self.longest_gap.max(slot - self.last_served);
        self.last_served = slot;
        self.served_slots += 1;
    }

    /// Adds the ages after the slots behind the last service, up to `slot`.
    fn pass_until(&mut self, slot: u64) {
        let slots = slot.saturating_sub(self.last_served);
        self.ages += slots * (slots + 1) / 2;
        self.longest_gap = self.longest_gap.max(slots);
    }
}

/// The sums of all SNs of a mission.
#[derive(Debug, Default)]
struct SensorTally(Vec<SensorSums>);

impl SensorTally {
    /// Adds a slot, after which the field is `field`.
    fn add(&mut self, slot: u64, flight: &FlightReport, field: &Field) {
        for link in flight.served_links() {
            self.0[link.sensor as usize].serve(slot);
        }
        for (sums, lost_bits) in self.0.iter_mut().zip(field.lost_bits()) {
            if lost_bits > sums.lost_bits {
                sums.first_loss.get_or_insert(slot);
                sums.lost_bits = lost_bits;
            }
        }
    }
}

/// Flies the run in `folder` again, and writes what it comes to for each SN beside its trace. Returns the file.
///
/// # Errors
/// If the folder is none of a run or was changed, the file cannot be written, or on a stop.
pub fn write(folder: &Path, stop: &Stop) -> Result<PathBuf, MissionError> {
    let mut replay = Replay::open(folder)?;
    let mut tally = SensorTally(vec![SensorSums::default(); replay.list().sensors().len()]);
    while let Some(flown) = replay.next_slot()? {
        stop.check()?;
        tally.add(flown.header.head.slot, &flown.flight, replay.mission().field());
    }
    let path = folder.join(FILE);
    write_whole(&path, csv(&replay, tally).as_bytes())?;
    Ok(path)
}

/// The file's text.
fn csv(replay: &Replay, tally: SensorTally) -> String {
    let slots = replay.mission().slot();
    let slot_s = replay.scenario().slot_s;
    let field = replay.mission().field();
    let mut text = COLUMNS.to_owned();
    for (id, mut sums) in tally.0.into_iter().enumerate() {
        sums.pass_until(slots);
        let node = &replay.list().sensors()[id];
        let delivered_bits = field.delivered_bits()[id];
        let queued_bits = field.queues_bits()[id];
        let sampled_bits = field.sampled_bits(id);
        let lost_bits = sums.lost_bits;
        let loss_rate = if sampled_bits == 0 { 0.0 } else { lost_bits as f64 / sampled_bits as f64 };
        let mean_age_s = if slots == 0 { 0.0 } else { sums.ages as f64 / slots as f64 * slot_s };
        let longest_gap_s = sums.longest_gap as f64 * slot_s;
        let first_loss = sums.first_loss.map_or_else(String::new, |slot| slot.to_string());
        writeln!(
            text,
            "{id},{},{},{sampled_bits},{delivered_bits},{lost_bits},{queued_bits},{loss_rate},{},{mean_age_s},\
             {longest_gap_s},{first_loss}",
            node.position.x, node.position.y, sums.served_slots
        )
        .expect("a string takes everything");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ages_and_gaps_follow_the_services() {
        // Served in slots 2 and 5 of 7: ages after each slot 1, 0, 1, 2, 0, 1, 2; gaps 2, 3 and, to the end, 2.
        let mut sums = SensorSums::default();
        sums.serve(2);
        sums.serve(5);
        sums.pass_until(7);
        assert_eq!((sums.ages, sums.longest_gap, sums.served_slots), (7, 3, 2));
    }

    #[test]
    fn who_is_never_served_grows_old_from_the_start() {
        let mut sums = SensorSums::default();
        sums.pass_until(4);
        assert_eq!((sums.ages, sums.longest_gap), (1 + 2 + 3 + 4, 4));
    }
}
