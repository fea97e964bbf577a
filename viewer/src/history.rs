//! The history of a mission: the bits lost by each sensor node (SN), and the last slot in which each cell of the area
//! was in range.
//!
//! Losses follow from the queues before a slot. A cell is in range if it is within the communication radius of the UAV
//! at the end of the slot. Losses in missed slots are not attributed to SNs.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::CheckpointError;
use skysink_common::geometry::{Position, distance_squared};
use skysink_common::loss_rate::LossRate;
use skysink_common::message::{FlightReport, Totals};
use skysink_common::nodes::Answer;
use skysink_common::sampling::Sampler;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;
use skysink_common::slot_record::uploads;
use skysink_common::told::Told;

use crate::zones::Raster;

/// Minimum and maximum number of cells of the coverage grid along the longer side of the area.
const CELLS: [f64; 2] = [40.0, 100.0];

/// Bits of a slot that are a burst, relative to their mean.
const BURST: f64 = 2.0;

/// Maximum number of cells of the grid. A side has one more cell than [`CELLS`] if the last one extends beyond the
/// area.
const MAX_CELLS: usize = (CELLS[1] as usize + 1).pow(2);

/// Maximum size of an encoded `u32` [byte], with seven bits per byte.
const U32_BYTES: usize = 5;

/// Maximum size of an encoded `u64` [byte].
const U64_BYTES: usize = 10;

/// The history of the sensor nodes and cells of a mission.
#[derive(Debug, Clone)]
pub(crate) struct SensorHistory {
    sensors: Arc<Sensors>,
    rate: LossRate,
    slot_s: f64,
    /// Lost in the last slot, by SN [bit].
    lost_now_bits: Vec<u64>,
    /// Those that died in it with data.
    died: Vec<u32>,
    /// Sampled in the last slot, by SN [bit]; empty if arrivals are constant.
    sampled_now_bits: Vec<u64>,
    /// Cells over the area, and the communication radius, within which they are in range [m].
    pub(crate) grid: Raster,
    radius_m: f64,
    pub(crate) sums: Sums,
}

/// The sums over all slots, which are saved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sums {
    /// The last slot; `None` before the first.
    pub(crate) slot: Option<u64>,
    /// The queues after it, by SN [bit].
    pub(crate) queues_bits: Vec<u32>,
    /// Lost so far in the slots that were seen, by SN [bit].
    pub(crate) lost_bits: Vec<u64>,
    /// By cell, the last slot in which it was in range, plus 1; 0 for never.
    in_range: Vec<u64>,
}

impl SensorHistory {
    /// The loss rate so far, `η`, of a mission with these `totals` (decisions D3 and D24).
    pub(crate) fn loss_rate(&self, totals: &Totals) -> f64 {
        self.rate.after(self.sums.slot.unwrap_or(0), totals)
    }

    /// The history before the first slot.
    pub(crate) fn new(scenario: &Scenario, sensors: &Arc<Sensors>) -> Self {
        let radius_m = scenario.link.comm_radius_m;
        let longer_m = scenario.area.width_m().max(scenario.area.height_m());
        let cells = (longer_m / (0.25 * radius_m)).clamp(CELLS[0], CELLS[1]).ceil();
        let grid = Raster::over(&scenario.area, cells as u32);
        let count = sensors.count();
        let in_range = vec![0; (grid.columns * grid.rows) as usize];
        let sums = Sums { slot: None, queues_bits: vec![0; count], lost_bits: vec![0; count], in_range };
        Self {
            sensors: Arc::clone(sensors),
            rate: LossRate::of(scenario, sensors.ids().map(|id| sensors.sampler(id).mean_bits)),
            slot_s: scenario.slot_s,
            lost_now_bits: vec![0; count],
            died: Vec::new(),
            sampled_now_bits: Vec::new(),
            grid,
            radius_m,
            sums,
        }
    }

    /// Adds a slot, after which queues and answers are as they are `told`, and the UAVs are above `uavs`. A dead SN
    /// loses what it holds and samples.
    pub(crate) fn add<'t>(&mut self, slot: u64, told: impl Into<Told<'t>>, uavs: impl IntoIterator<Item = Position>) {
        let told = told.into();
        let queues_bits = told.queues_bits;
        let Self { sensors, lost_now_bits, died, sampled_now_bits, grid, radius_m, sums, .. } = self;
        died.clear();
        let is_next = slot > 0 && sums.slot == Some(slot - 1);
        let losses = sums.queues_bits.iter().enumerate().zip(&mut sums.lost_bits).zip(lost_now_bits);
        for (((id, &before_bits), lost_bits), lost_now_bits) in losses {
            let is_dead = told.answer(id as u32) == Answer::Dead;
            let lost_bits_of = |id: usize| match is_dead {
                true => u64::from(before_bits) + sensors.sampling.bits(id, slot),
                false => sensors.sampling.overflow_bits(id, before_bits, slot),
            };
            if is_next && is_dead && before_bits > 0 {
                died.push(id as u32);
            }
            *lost_now_bits = if is_next { lost_bits_of(id) } else { 0 };
            *lost_bits += *lost_now_bits;
        }
        if sensors.sampling.is_drawn() && slot > 0 {
            *sampled_now_bits = (0..queues_bits.len()).map(|id| sensors.sampling.bits(id, slot)).collect();
        }
        sums.slot = Some(slot);
        sums.queues_bits.clear();
        sums.queues_bits.extend_from_slice(queues_bits);
        for cell in uavs.into_iter().flat_map(|uav| in_range(*grid, *radius_m, uav)) {
            sums.in_range[cell] = slot + 1;
        }
    }

    /// Takes back what SNs have uploaded by `flights` in the last slot, in which they died: it is not lost.
    pub(crate) fn credit(&mut self, flights: &[FlightReport]) {
        for link in uploads(flights).filter(|link| self.died.contains(&link.sensor)) {
            let id = link.sensor as usize;
            let buffer_bits = self.sensors.sampling.of(id).capacity_bits.into();
            let sent_bits = link.capacity_bits.min(buffer_bits).min(self.lost_now_bits[id]);
            self.lost_now_bits[id] -= sent_bits;
            self.sums.lost_bits[id] -= sent_bits;
        }
    }

    /// Whether each SN has lost data in the last slot.
    pub(crate) fn overflows(&self) -> impl Iterator<Item = bool> {
        self.lost_now_bits.iter().map(|&lost_bits| lost_bits > 0)
    }

    /// Bits sampled in the last slot by all SNs; `None` if arrivals are constant, or before slot 1.
    pub(crate) fn sampled_now_bits(&self) -> Option<u64> {
        (!self.sampled_now_bits.is_empty()).then(|| self.sampled_now_bits.iter().sum())
    }

    /// The SNs that have sampled at least [`BURST`] times their mean in the last slot.
    pub(crate) fn bursts(&self) -> impl Iterator<Item = usize> {
        let is_burst = |(id, bits): &(usize, &u64)| **bits as f64 > BURST * self.sensors.sampling.of(*id).mean_bits;
        self.sampled_now_bits.iter().enumerate().filter(is_burst).map(|(id, _)| id)
    }

    /// The time until the buffer of each SN is full without service [s]; infinite for an SN that does not sample.
    pub(crate) fn overflow_s(&self) -> impl Iterator<Item = f64> {
        (0..).zip(&self.sums.queues_bits).map(|(id, &queue_bits)| self.filled_s(id, queue_bits))
    }

    /// The maximum time to fill an empty buffer, over all SNs [s]; 0 if none samples.
    pub(crate) fn longest_fill_s(&self) -> f64 {
        let fills_s = self.sensors.ids().map(|id| self.filled_s(id, 0));
        fills_s.filter(|fill_s| fill_s.is_finite()).fold(0.0, f64::max)
    }

    /// The time until the buffer of SN `id` is full if it holds `queue_bits` [s].
    fn filled_s(&self, id: u32, queue_bits: u32) -> f64 {
        let Sampler { mean_bits, capacity_bits, .. } = self.sensors.sampler(id);
        let room_bits = f64::from(capacity_bits.saturating_sub(queue_bits));
        if room_bits == 0.0 { 0.0 } else { room_bits / mean_bits * self.slot_s }
    }

    /// The maximum that an SN can sample in this number of slots [bit].
    pub(crate) fn most_sampled_bits(&self, slots: u64) -> f64 {
        self.sensors.sampling.highest_mean_bits() * slots as f64
    }

    /// The number of slots since each cell was in range; `None` if it never was.
    pub(crate) fn ages(&self) -> impl Iterator<Item = Option<u64>> {
        let now = self.sums.slot.map_or(0, |slot| slot + 1);
        self.sums.in_range.iter().map(move |&last| (last > 0).then(|| now - last))
    }

    /// The fraction of the cells that have been in range.
    pub(crate) fn covered(&self) -> f64 {
        let seen = self.sums.in_range.iter().filter(|&&last| last > 0).count();
        seen as f64 / self.sums.in_range.len() as f64
    }

    /// Restores the sums of the same mission.
    ///
    /// # Errors
    /// If they belong to another field.
    pub(crate) fn restore(&mut self, sums: Sums) -> Result<(), CheckpointError> {
        let lengths = |sums: &Sums| [sums.queues_bits.len(), sums.lost_bits.len(), sums.in_range.len()];
        CheckpointError::ensure(lengths(&sums) == lengths(&self.sums), "sums of this field")?;
        let latest = sums.slot.map_or(0, |slot| slot.saturating_add(1));
        CheckpointError::ensure(sums.in_range.iter().all(|&last| last <= latest), "places in range up to the slot")?;
        self.sums = sums;
        Ok(())
    }
}

impl Sums {
    /// Maximum size of the encoded sums for `count` SNs [byte]: an optional slot, the lengths of three lists, and the
    /// lists.
    pub(crate) fn room(count: usize) -> usize {
        1 + 4 * U64_BYTES + count * (U32_BYTES + U64_BYTES) + MAX_CELLS * U64_BYTES
    }
}

/// The cells in range of a UAV above `uav`: those whose centre is in range, and the one below it.
fn in_range(grid: Raster, radius_m: f64, uav: Position) -> impl Iterator<Item = usize> {
    let index = |at_m: f64, count: u32| ((at_m / grid.cell_m).floor().max(0.0) as u32).min(count - 1);
    let south_m = grid.depth_m - uav.y;
    let here = [index(uav.x, grid.columns), index(south_m, grid.rows)];
    let columns = index(uav.x - radius_m, grid.columns)..=index(uav.x + radius_m, grid.columns);
    let rows = index(south_m - radius_m, grid.rows)..=index(south_m + radius_m, grid.rows);
    let is_in_range = move |&[column, row]: &[u32; 2]| {
        [column, row] == here || distance_squared(&grid.centre(column, row), &uav) <= radius_m * radius_m
    };
    rows.flat_map(move |row| columns.clone().map(move |column| [column, row]))
        .filter(is_in_range)
        .map(move |[column, row]| (row * grid.columns + column) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::{LinkReport, Mode, SensorNode};
    use skysink_common::scenario::Overrides;

    /// The letter's field of 100 m × 100 m with SNs that sample 100, 2.5 and 0 bit/s into 1 000 bit.
    fn history() -> SensorHistory {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let sensor = |sampling_bps: f64| SensorNode { sampling_bps, capacity_bits: 1_000, ..SensorNode::default() };
        SensorHistory::new(&scenario, &Arc::new(Sensors::of(&scenario, &[100.0, 2.5, 0.0].map(sensor))))
    }

    const MIDDLE: Position = Position::new(50.0, 50.0);

    #[test]
    fn the_loss_rate_is_of_what_the_sensor_nodes_sample_on_average() {
        let mut history = history();
        assert_eq!(history.loss_rate(&Totals::default()), 0.0);
        (0..=3).for_each(|slot| history.add(slot, &[0; 3], [MIDDLE]));
        // In three slots of 1 s 300, 7.5 and 0 bit, of which whole bits are 307.
        let totals = Totals { sampled_bits: 307, lost_bits: 123, ..Totals::default() };
        assert!((history.loss_rate(&totals) - 0.4).abs() < 1e-12);
    }

    #[test]
    fn a_sensor_node_that_dies_loses_what_it_has_not_uploaded() {
        let mut history = history();
        history.add(0, &[500, 400, 0], [MIDDLE]);
        let answers = [Answer::Dead, Answer::Silent, Answer::Queue];
        history.add(1, Told::new(&[0, 402, 0], &answers), [MIDDLE]);
        assert_eq!((history.sums.lost_bits[0], history.sums.queues_bits[1]), (600, 402));
        let mut flight = FlightReport::at([50.0, 50.0, 20.0], Mode::Serve);
        flight.links[0] = LinkReport { capacity_bits: 450, ..LinkReport::default() };
        flight.served = 1;
        history.credit(&[flight]);
        assert_eq!(history.sums.lost_bits, [150, 0, 0]);
        history.add(2, Told::new(&[0, 404, 0], &answers), [MIDDLE]);
        history.credit(&[flight]);
        assert_eq!(history.sums.lost_bits, [250, 0, 0], "the dead upload nothing");
    }

    #[test]
    fn bits_that_do_not_fit_into_a_buffer_are_lost() {
        let mut history = history();
        history.add(0, &[950, 999, 1_000], [MIDDLE]);
        assert_eq!(history.sums.lost_bits, [0, 0, 0]);
        history.add(1, &[1_000, 1_000, 1_000], [MIDDLE]); // 950 + 100, 999 + 2
        assert_eq!(history.sums.lost_bits, [50, 1, 0]);
        history.add(2, &[0, 1_000, 1_000], [MIDDLE]); // 1 000 + 100 before the upload, 1 000 + 3
        assert_eq!(history.sums.lost_bits, [150, 4, 0]);
        assert_eq!(history.overflows().collect::<Vec<_>>(), [true, true, false]);
        history.add(3, &[100, 1_000, 1_000], [MIDDLE]); // 1 000 + 2
        assert_eq!(history.sums.lost_bits, [150, 6, 0]);
        assert_eq!(history.overflows().collect::<Vec<_>>(), [false, true, false]);
    }

    #[test]
    fn losses_in_missed_slots_are_attributed_to_no_sn() {
        let mut history = history();
        history.add(0, &[1_000; 3], [MIDDLE]);
        history.add(5, &[1_000; 3], [MIDDLE]);
        assert_eq!(history.sums.lost_bits, [0, 0, 0]);
        history.add(6, &[1_000; 3], [MIDDLE]);
        assert_eq!(history.sums.lost_bits, [100, 3, 0]); // floor(15.0) − floor(12.5)
    }

    #[test]
    fn a_buffer_overflows_after_its_room_at_its_rate() {
        let mut history = history();
        history.add(0, &[250, 990, 400], [MIDDLE]);
        assert_eq!(history.overflow_s().collect::<Vec<_>>(), [7.5, 4.0, f64::INFINITY]);
        history.add(1, &[1_000; 3], [MIDDLE]);
        assert_eq!(history.overflow_s().collect::<Vec<_>>(), [0.0; 3]);
        assert_eq!(history.longest_fill_s(), 400.0);
        assert_eq!(history.most_sampled_bits(600), 60_000.0);
    }

    #[test]
    fn a_cell_is_in_range_if_its_centre_is() {
        let mut history = history();
        let Raster { columns, rows, cell_m, .. } = history.grid;
        assert_eq!((columns, rows, cell_m), (40, 40, 2.5));
        history.add(0, &[0; 3], [Position::new(0.0, 100.0)]); // the north-west corner, radius 10 m
        let seen: Vec<usize> =
            history.ages().enumerate().filter(|(_, age)| age.is_some()).map(|(cell, _)| cell).collect();
        // Centres at 1.25, 3.75, 6.25, 8.75 m: of the sixteen, those within 10 m of the corner.
        assert_eq!(seen, [0, 1, 2, 3, 40, 41, 42, 43, 80, 81, 82, 120, 121]);
        history.add(1, &[0; 3], [MIDDLE]);
        history.add(4, &[0; 3], [MIDDLE]);
        let ages: Vec<_> = history.ages().collect();
        assert_eq!((ages[0], ages[20 * 40 + 20], ages[39]), (Some(4), Some(0), None));
        history.add(5, &[0; 3], [MIDDLE, Position::new(100.0, 100.0)]);
        let ages: Vec<_> = history.ages().collect();
        assert_eq!((ages[20 * 40 + 20], ages[39]), (Some(0), Some(0)), "of several UAVs");
    }

    #[test]
    fn the_largest_sums_have_the_maximum_size() {
        for count in [0, 1, 300] {
            let sums = Sums {
                slot: Some(u64::MAX),
                queues_bits: vec![u32::MAX; count],
                lost_bits: vec![u64::MAX; count],
                in_range: vec![u64::MAX; MAX_CELLS],
            };
            let mut bytes = Vec::new();
            skysink_common::checkpoint::encode(&sums, &mut bytes);
            let room = Sums::room(count);
            assert!(bytes.len() <= room && room - bytes.len() < 30, "{count}: {} of {room}", bytes.len());
        }
    }

    #[test]
    fn the_sums_of_another_field_are_refused() {
        let mut begun = history();
        begun.add(7, &[1_000; 3], [MIDDLE]);
        let mut resumed = history();
        resumed.restore(begun.sums.clone()).unwrap();
        assert_eq!(resumed.sums, begun.sums);
        let other = Sums { lost_bits: vec![0; 2], ..begun.sums.clone() };
        let later = Sums { slot: Some(6), ..begun.sums.clone() };
        assert!(resumed.restore(other).is_err() && resumed.restore(later).is_err());
        resumed.add(8, &[1_000; 3], [MIDDLE]);
        assert_eq!(resumed.sums.lost_bits, [100, 3, 0]); // floor(20.0) − floor(17.5)
    }
}
