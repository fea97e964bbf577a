//! The sensor nodes as the bounds see them: those that sample, or that have data, in whole bits, with the first slot of
//! a possible service.

use skysink_common::airspace::Airspace;
use skysink_common::arrivals::sampled_bits;
use skysink_common::geometry::{Position, distance_squared, within};
use skysink_common::queues::overflow_bits;
use skysink_common::sampling::Sampler;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;

use super::margins::LENGTH_MARGIN;
use super::paths::legs::fewest_slots;

/// By how much the nearest place beside zones may be farther away than the range: it keeps clear of them.
const BESIDE_ZONES: f64 = 1.01;

/// A sensor node (SN).
#[derive(Debug, Clone, PartialEq)]
pub struct SensorBits {
    /// Its sampling.
    pub sampler: Sampler,
    /// Bits sampled up to the end of each slot, from slot 0, if they are drawn, of each slot at most a full buffer;
    /// constant ones are counted.
    pub drawn_bits: Option<Vec<u64>>,
    /// Its queue before slot 1 [bit].
    pub queue_bits: u32,
    /// The first slot at whose end the UAV can be in range, at least 1; `None` if zones leave no place in range.
    pub first_slot: Option<u64>,
}

impl SensorBits {
    /// Whether the UAV can be in range at the end of `slot`.
    #[inline]
    pub fn is_reached(&self, slot: u64) -> bool {
        self.first_slot.is_some_and(|first_slot| first_slot <= slot)
    }

    /// Its buffer [bit].
    pub fn buffer_bits(&self) -> u64 {
        self.sampler.capacity_bits.into()
    }

    /// Bits sampled up to the end of `slot`, of each slot at most a full buffer.
    pub fn sampled_bits(&self, slot: u64) -> u64 {
        let counted = || sampled_bits(self.sampler.mean_bits, slot);
        self.drawn_bits.as_ref().map_or_else(counted, |drawn_bits| drawn_bits[slot as usize])
    }

    /// Overflow up to the end of `slot` [bit], if the SN is never served after the slot `emptied`, which left it empty;
    /// or never at all if that is `None`.
    #[inline]
    pub fn overflow_bits(&self, emptied: Option<u64>, slot: u64) -> u64 {
        let (queue_bits, from) = emptied.map_or((self.queue_bits, 0), |emptied| (0, emptied.min(slot)));
        match &self.drawn_bits {
            None => overflow_bits(&self.sampler, queue_bits, from, slot),
            Some(drawn_bits) => {
                let held_bits = u64::from(queue_bits) + drawn_bits[slot as usize] - drawn_bits[from as usize];
                held_bits.saturating_sub(self.sampler.capacity_bits.into())
            }
        }
    }

    /// Overflow in `slot` [bit], under the same assumption.
    #[inline]
    pub fn lost_bits(&self, emptied: Option<u64>, slot: u64) -> u64 {
        self.overflow_bits(emptied, slot) - self.overflow_bits(emptied, slot - 1)
    }
}

/// The SNs that a bound is about, and the slots of the mission.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldBits {
    /// The SNs.
    pub sensors: Vec<SensorBits>,
    /// Slots of the mission.
    pub slots: u64,
    /// Resource blocks of all UAVs, `U n`.
    pub blocks: usize,
    /// Bits that no flight can save, beside the overflow of the SNs: what a slot samples of an SN beyond its buffer.
    pub beyond_buffers_bits: u64,
}

impl FieldBits {
    /// The SNs of a scenario that sample, with these queues [bit], by id.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &Sensors, queues_bits: &[u32]) -> Self {
        Self::over(scenario, sensors, queues_bits, sensors.sampling_ids())
    }

    /// The SNs `ids` of a scenario, with these queues [bit], by id.
    #[must_use]
    pub fn over(scenario: &Scenario, sensors: &Sensors, queues_bits: &[u32], ids: impl Iterator<Item = u32>) -> Self {
        let in_range_m = scenario.link.comm_radius_m * (1.0 + LENGTH_MARGIN);
        let kinds: Vec<FirstFlight> = scenario.kinds().map(|kind| FirstFlight::of(&kind)).collect();
        let blocks = scenario.kinds().map(|kind| kind.link.resource_blocks * kind.uav.uavs()).sum();
        let mut beyond_buffers_bits = 0;
        let bits = |id: u32| {
            let position = sensors.position(id);
            let able = kinds.iter().filter(|kind| kind.has_place(position, in_range_m));
            let slots = able.map(|kind| kind.slots(position, in_range_m)).reduce(f64::min);
            SensorBits {
                sampler: sensors.sampler(id),
                drawn_bits: sensors.sampling.is_drawn().then(|| {
                    let (bits, beyond_bits) = drawn_bits(sensors, id, scenario.slots);
                    beyond_buffers_bits += beyond_bits;
                    bits
                }),
                queue_bits: queues_bits[id as usize],
                first_slot: slots.map(|slots| (slots as u64).max(1)),
            }
        };
        Self { sensors: ids.map(bits).collect(), slots: scenario.slots, blocks, beyond_buffers_bits }
    }

    /// The largest buffer [bit].
    pub fn capacity_bits(&self) -> u64 {
        self.sensors.iter().map(|sensor| sensor.sampler.capacity_bits).max().unwrap_or(0).into()
    }
}

/// How soon the UAVs of a kind are in range of a sensor node.
struct FirstFlight {
    starts: Vec<Position>,
    /// Farthest flight in a slot [m].
    farthest_m: f64,
    airspace: Airspace,
}

impl FirstFlight {
    fn of(scenario: &Scenario) -> Self {
        let starts = scenario.starts().map(|start| start.xy()).collect();
        Self { starts, farthest_m: scenario.farthest_m(), airspace: scenario.airspace() }
    }

    /// Whether zones leave a place within `in_range_m` [m] of `position`.
    fn has_place(&self, position: &Position, in_range_m: f64) -> bool {
        self.airspace.is_open()
            || self.airspace.has_grid()
            || within(&self.airspace.nearest(position), position, BESIDE_ZONES * in_range_m)
    }

    /// The fewest slots until one of them is within `in_range_m` [m] of `position`.
    fn slots(&self, position: &Position, in_range_m: f64) -> f64 {
        let away_m2 = self.starts.iter().map(|start| distance_squared(start, position));
        let away_m = away_m2.fold(f64::INFINITY, f64::min).sqrt();
        fewest_slots(self.farthest_m, away_m - in_range_m)
    }
}

/// Bits that SN `id` samples up to the end of each slot from 0 to `slots`, of each slot at most a full buffer, and the
/// bits beyond. A slot that samples a buffer or more leaves it full, whatever it held.
fn drawn_bits(sensors: &Sensors, id: u32, slots: u64) -> (Vec<u64>, u64) {
    let buffer_bits = u64::from(sensors.sampler(id).capacity_bits);
    let mut beyond_bits = 0;
    let held_bits = (1..=slots).scan(0, |sum, slot| {
        let sampled_bits = sensors.sampling.bits(id as usize, slot);
        beyond_bits += sampled_bits.saturating_sub(buffer_bits);
        *sum += sampled_bits.min(buffer_bits);
        Some(*sum)
    });
    (std::iter::once(0).chain(held_bits).collect(), beyond_bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::SensorNode;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    #[test]
    fn overflow_is_counted_in_whole_bits_since_the_last_visit_or_the_start() {
        // Sampled up to slots 1 to 5: 2, 5, 7, 10 and 12 bit (decision D2), or as many that are drawn.
        for drawn_bits in [None, Some(vec![0, 2, 5, 7, 10, 12])] {
            let sensor = SensorBits {
                sampler: Sampler { mean_bits: 2.5, capacity_bits: 4, lasting_slots: f64::INFINITY },
                drawn_bits,
                queue_bits: 3,
                first_slot: Some(1),
            };
            assert_eq!([1, 2, 3, 4, 5].map(|slot| sensor.overflow_bits(None, slot)), [1, 4, 6, 9, 11]);
            assert_eq!([1, 2, 3, 4, 5].map(|slot| sensor.lost_bits(None, slot)), [1, 3, 2, 3, 2]);
            // Since slot 2: 2, 5 and 7 bit.
            assert_eq!([3, 4, 5].map(|slot| sensor.overflow_bits(Some(2), slot)), [0, 1, 3]);
            assert_eq!([3, 4, 5].map(|slot| sensor.lost_bits(Some(2), slot)), [0, 1, 2]);
        }
    }

    #[test]
    fn the_first_slot_of_a_service_is_that_of_the_flight_into_range() {
        // From (200, 200) with 30 m a slot and d_c = 10 m: 0 m, 70 m and 90 m to fly. SN 1 does not sample.
        let text = "name = 'x'\n[area]\nside_m = 400.0\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let node = |x_m: f64, sampling_bps: f64| SensorNode { x_m, y_m: 200.0, sampling_bps, ..SensorNode::default() };
        let nodes = [node(200.0, 9.0), node(230.0, 0.0), node(280.0, 9.0), node(100.0, 9.0)];
        let field = FieldBits::new(&scenario, &Sensors::of(&scenario, &nodes), &[1, 2, 3, 4]);
        let found: Vec<(Option<u64>, u32)> =
            field.sensors.iter().map(|sensor| (sensor.first_slot, sensor.queue_bits)).collect();
        assert_eq!(found, [(Some(1), 1), (Some(3), 3), (Some(3), 4)]);
    }
}
