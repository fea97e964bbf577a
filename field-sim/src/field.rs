//! One slot of the field: sample, overflow, upload (decision D1).

use std::borrow::Cow;
use std::mem::MaybeUninit;

use serde::{Deserialize, Serialize};
use skysink_common::belief::Belief;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode_first, encode};
use skysink_common::estimate::SavedEstimate;
use skysink_common::ledger::{Ledger, Totals};
use skysink_common::message::{FlightReport, NodeAnswer, QueuesHeader, SlotHeader};
use skysink_common::nodes::{Answer, NodeFeatures};
use skysink_common::queues::blocks;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{beacons, uploads};
use skysink_common::told::Told;

/// The sensor field and its queues after a slot.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    ledger: Ledger,
    /// What each sensor node does in the next slot, by id; empty if all send.
    answers: Vec<Answer>,
    /// Slots of the mission.
    slots: u64,
    slot: u64,
    slot_bits: SlotBits,
    /// What the UAV believes, for external planners.
    belief: Belief,
}

/// Bits delivered and lost in one slot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlotBits {
    /// Uploaded, `Σ Thr_i(t)`.
    pub delivered_bits: u64,
    /// Lost, `Σ D_i(t)`.
    pub lost_bits: u64,
}

/// An impossible flight: it serves an unknown sensor node.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("flight({slot}) serves SN {sensor}: expected ids below {count}")]
pub struct FieldError {
    /// The slot.
    pub slot: u64,
    /// The id.
    pub sensor: u32,
    /// Sensor nodes in the field.
    pub count: usize,
}

impl Field {
    /// The field before slot 1.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        Self::over(list.ledger(scenario), scenario.slots)
    }

    /// The field of this ledger before slot 1 of a mission of so many slots.
    #[must_use]
    pub fn over(ledger: Ledger, slots: u64) -> Self {
        let mut answers = Vec::new();
        ledger.fill_answers(&mut answers);
        Self { ledger, answers, slots, slot: 0, slot_bits: SlotBits::default(), belief: Belief::Known }
    }

    /// The field with what the UAV believes before slot 1, instead of known queues.
    #[must_use]
    pub fn with_belief(mut self, belief: Belief) -> Self {
        self.belief = belief;
        self.belief.predict(self.slot);
        self
    }

    /// What the UAV believes after the slot.
    pub fn belief(&self) -> &Belief {
        &self.belief
    }

    /// The queues after the slot as the UAV believes them to be [bit], by sensor node.
    pub fn believed_bits(&self) -> &[u32] {
        self.belief.queues_bits(self.queues_bits())
    }

    /// Advances by `slot`, from 1: all sensor nodes sample, full ones lose the excess, and served ones upload
    /// `Thr_i = min(floor(r_i τ_c), q)` (UTS eq. 7 in the order of decision D1). Of several UAVs that serve one, the
    /// first does (decision D19).
    ///
    /// # Errors
    /// If a UAV serves an unknown sensor node; the field is then unchanged.
    ///
    /// # Panics
    /// If `slot` is not the next slot, or there is no flight.
    pub fn step(&mut self, slot: u64, flights: &[FlightReport]) -> Result<SlotBits, FieldError> {
        self.step_into(slot, flights, None)
    }

    /// Advances by `slot` as [`Field::step`] does, and also writes the new queues [bit] to `queues_bits`, by sensor
    /// node, such as a message. It writes block by block, while a block is in the L1 cache: a copy afterwards would
    /// take 1.15 times as long per slot at 10^4 sensor nodes, and 1.5 times at 10^6.
    ///
    /// All of `queues_bits` is written, unless an error is returned.
    ///
    /// # Errors
    /// If a UAV serves an unknown sensor node; the field is then unchanged.
    ///
    /// # Panics
    /// If `slot` is not the next slot, there is no flight, or the length of `queues_bits` is not the number of sensor
    /// nodes.
    pub fn step_into(
        &mut self,
        slot: u64,
        flights: &[FlightReport],
        mut queues_bits: Option<&mut [MaybeUninit<u32>]>,
    ) -> Result<SlotBits, FieldError> {
        assert_eq!(slot, self.slot + 1, "expected the next slot");
        let count = self.queues_bits().len();
        assert!(queues_bits.as_ref().is_none_or(|copy| copy.len() == count), "expected one queue per sensor node");
        let links = || uploads(flights);
        if let Some(link) = links().find(|link| link.sensor as usize >= count) {
            return Err(FieldError { slot, sensor: link.sensor, count });
        }
        let reported = self.belief.reported(slot, links().map(|link| link.sensor), self.told());
        self.slot = slot;
        self.slot_bits = SlotBits::default();
        for sensors in blocks(count) {
            self.slot_bits.lost_bits += self.ledger.sample_block(sensors.clone(), slot);
            if let Some(copy) = &mut queues_bits {
                copy[sensors.clone()].write_copy_of_slice(&self.ledger.queues_bits()[sensors]);
            }
        }
        for link in links() {
            let sensor = link.sensor as usize;
            self.slot_bits.delivered_bits += self.ledger.serve(slot, sensor, link.capacity_bits, link.rate_bps);
            if let Some(copy) = &mut queues_bits {
                copy[sensor].write(self.ledger.queues_bits()[sensor]);
            }
        }
        if !self.ledger.features().is_empty() {
            self.slot_bits.lost_bits += self.ledger.end_slot(slot, &beacons(flights).collect::<Vec<_>>());
        }
        self.ledger.fill_answers(&mut self.answers);
        if self.ledger.may_refuse() {
            queues_bits.into_iter().for_each(|copy| _ = copy.write_copy_of_slice(self.ledger.queues_bits()));
        }
        self.belief.advance(slot, flights, &reported, Told::new(self.ledger.queues_bits(), &self.answers));
        self.belief.predict(slot);
        Ok(self.slot_bits)
    }

    /// The last slot; 0 before the first.
    pub fn slot(&self) -> u64 {
        self.slot
    }

    /// Queue lengths [bit], by sensor node.
    pub fn queues_bits(&self) -> &[u32] {
        self.ledger.queues_bits()
    }

    /// The queues after the slot, and the answers in the next one, as planners are told.
    pub fn told(&self) -> Told<'_> {
        Told::new(self.queues_bits(), &self.answers)
    }

    /// The answers in the next slot with what the UAV knows of them, by sensor node, as messages; none if all send.
    pub fn node_answers(&self) -> impl Iterator<Item = NodeAnswer> {
        let known = |id, answer| NodeAnswer { answer: answer as u8, known: self.belief.answer(id, answer) as u8 };
        (0..).zip(&self.answers).map(move |(id, &answer)| known(id, answer))
    }

    /// What the UAV knows the sensor node `sensor` to do when it is served in the next slot.
    pub fn known_answer(&self, sensor: u32) -> Answer {
        self.belief.answer(sensor, self.told().answer(sensor))
    }

    /// The same of all sensor nodes, by id; nothing if all send.
    pub fn known_answers(&self) -> Cow<'_, [Answer]> {
        if !self.belief.is_estimated() {
            return Cow::Borrowed(&self.answers);
        }
        let mut known = Vec::new();
        self.belief.answers(&self.answers, &mut known);
        Cow::Owned(known)
    }

    /// The queues after the slot as the UAV believes them to be [bit], by sensor node; 0 of those that it knows to be
    /// dead or silent.
    pub fn servable_bits(&self) -> Cow<'_, [u32]> {
        if self.answers.is_empty() {
            return Cow::Borrowed(self.believed_bits());
        }
        let servable = |(id, &bits): (u32, &u32)| if self.known_answer(id).sends() { bits } else { 0 };
        (0..).zip(self.believed_bits()).map(servable).collect()
    }

    /// Bits uploaded so far, by sensor node.
    pub fn delivered_bits(&self) -> &[u64] {
        self.ledger.delivered_bits()
    }

    /// Bits sampled so far by the sensor node `sensor`.
    ///
    /// # Panics
    /// If the sensor node is unknown.
    pub fn sampled_bits(&self, sensor: usize) -> u64 {
        self.ledger.sampled_bits(sensor, self.slot)
    }

    /// Bits lost so far, by sensor node.
    pub fn lost_bits(&self) -> impl Iterator<Item = u64> {
        self.ledger.lost_bits(self.slot)
    }

    /// The slot that has sampled the last bit that the sensor node `sensor` has uploaded, 0 before that; `None` where
    /// no bits expire.
    ///
    /// # Panics
    /// If the sensor node is unknown.
    pub fn freshest_slot(&self, sensor: usize) -> Option<u64> {
        self.ledger.features().freshest_slot(sensor)
    }

    /// Whether the sensor node `sensor`, which a UAV served in the last slot, has answered
    /// ([`Ledger::has_answered`]).
    pub fn has_answered(&self, sensor: u32) -> bool {
        self.ledger.has_answered(sensor)
    }

    /// The features of the sensor nodes.
    pub fn features(&self) -> &NodeFeatures {
        self.ledger.features()
    }

    /// Totals since the mission's start.
    pub fn totals(&self) -> Totals {
        self.ledger.totals()
    }

    /// The header of the message with these queues.
    pub fn header(&self, head: SlotHeader) -> QueuesHeader {
        let SlotBits { delivered_bits, lost_bits } = self.slot_bits;
        QueuesHeader { head, totals: self.totals(), delivered_bits, lost_bits }
    }
}

/// The checkpoint of a field: 12 bytes per sensor node, and those of the estimate. Those of the features follow.
#[derive(Serialize, Deserialize)]
struct State {
    slot: u64,
    slot_bits: SlotBits,
    /// `u32` by sensor node, in native byte order.
    #[serde(with = "serde_bytes")]
    queues_bits: Vec<u8>,
    /// `u64` by sensor node, in native byte order.
    #[serde(with = "serde_bytes")]
    delivered_bits: Vec<u8>,
    estimate: Option<SavedEstimate>,
    /// Bits sampled so far, by id, if arrivals are drawn.
    drawn_bits: Option<serde_bytes::ByteBuf>,
}

impl Checkpoint for Field {
    fn save(&self, bytes: &mut Vec<u8>) {
        let queues_bits = bytemuck::cast_slice(self.queues_bits()).to_vec();
        let delivered_bits = bytemuck::cast_slice(self.delivered_bits()).to_vec();
        let estimate = self.belief.saved();
        let drawn_bits = self.ledger.drawn_bits().map(|bits| serde_bytes::ByteBuf::from(bytemuck::cast_slice(bits)));
        let Self { slot, slot_bits, .. } = *self;
        encode(&State { slot, slot_bits, queues_bits, delivered_bits, estimate, drawn_bits }, bytes);
        self.features().save(bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let (state, features) = decode_first(bytes)?;
        let State { slot, slot_bits, queues_bits, delivered_bits, estimate, drawn_bits } = state;
        CheckpointError::ensure(slot <= self.slots, "a slot of this mission")?;
        let mut belief = self.belief.restored(slot, estimate)?;
        let queues_bits: Vec<u32> = bytemuck::pod_collect_to_vec(&queues_bits);
        let delivered_bits: Vec<u64> = bytemuck::pod_collect_to_vec(&delivered_bits);
        let drawn_bits: Option<Vec<u64>> = drawn_bits.map(|bytes| bytemuck::pod_collect_to_vec(&bytes));
        self.ledger.restore(slot, &queues_bits, &delivered_bits, drawn_bits.as_deref(), features)?;
        self.ledger.fill_answers(&mut self.answers);
        self.slot = slot;
        self.slot_bits = slot_bits;
        belief.predict(slot);
        self.belief = belief;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use skysink_common::arrivals::bits_between;
    use skysink_common::message::{LinkReport, Mode};
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    fn field(queue_bits: u32) -> Field {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let list = format!("x_m,y_m,queue_bits\n10,10,{queue_bits}\n20,20,5\n");
        let list = SensorList::parse(&list, Path::new("list.csv"), &scenario).unwrap();
        Field::new(&scenario, &list)
    }

    fn serving(sensor: u32, capacity_bits: u64) -> [FlightReport; 1] {
        let mut report = FlightReport::at([10.0, 10.0, 20.0], Mode::Serve);
        report.links[0] = LinkReport { sensor, capacity_bits, ..LinkReport::default() };
        report.served = 1;
        [report]
    }

    #[test]
    fn overflow_is_lost_in_the_slot_of_a_visit_too() {
        let mut field = field(29_950);
        let bits = field.step(1, &serving(0, 6_000_000)).unwrap();
        // sample: 29 950 + 100 = 30 050; overflow: 50 lost; upload: all of the 30 000
        assert_eq!(bits, SlotBits { delivered_bits: 30_000, lost_bits: 50 });
        assert_eq!(field.queues_bits(), [0, 105]);
        assert!(field.totals().is_balanced());
    }

    #[test]
    fn a_narrow_link_leaves_the_rest_in_the_queue() {
        let mut field = field(10_000);
        assert_eq!(field.step(1, &serving(0, 6_000)).unwrap().delivered_bits, 6_000);
        assert_eq!(field.queues_bits()[0], 4_100); // 10 000 + 100 − 6 000
    }

    #[test]
    fn a_link_to_an_unknown_sensor_node_is_refused_and_changes_nothing() {
        let mut field = field(10_000);
        let error = field.step(1, &serving(2, 1)).unwrap_err();
        assert_eq!(error.to_string(), "flight(1) serves SN 2: expected ids below 2");
        assert_eq!(field.queues_bits(), [10_000, 5]);
    }

    fn saved(field: &Field) -> Vec<u8> {
        let mut bytes = Vec::new();
        field.save(&mut bytes);
        bytes
    }

    #[test]
    fn a_state_of_another_field_or_slot_is_refused_and_changes_nothing() {
        let state = |slot, queues_bits: &[u32], delivered_bits: &[u64]| {
            let queues_bits = bytemuck::cast_slice(queues_bits).to_vec();
            let delivered_bits = bytemuck::cast_slice(delivered_bits).to_vec();
            let mut bytes = Vec::new();
            let slot_bits = SlotBits::default();
            encode(
                &State { slot, slot_bits, queues_bits, delivered_bits, estimate: None, drawn_bits: None },
                &mut bytes,
            );
            bytes
        };
        let mut restored = field(10_000);
        for refused in [
            state(1, &[10_100, 105, 0], &[0, 0, 0]),
            state(1, &[10_101, 105], &[0, 0]), // 10 000 + 100 before the upload
            state(1, &[10_000, 105], &[101, 0]),
            state(601, &[0, 0], &[0, 0]),
        ] {
            assert!(restored.restore(&refused).is_err());
            assert_eq!(restored, field(10_000));
        }
        restored.restore(&state(1, &[10_000, 105], &[100, 0])).unwrap();
        assert_eq!((restored.slot(), restored.totals().delivered_bits), (1, 100));
    }

    /// Up to more SNs than a block holds, with equal or different rates [bit/s], some of which fill their buffers.
    fn lists() -> impl Strategy<Value = (Scenario, SensorList)> {
        let rates = prop_oneof![
            prop::collection::vec(prop_oneof![Just(100.0), Just(2.5), 0.0..1e3, 0.0..4e9], 1..1_500),
            (prop_oneof![Just(100.0), Just(2.5), Just(4e9)], 1usize..3_000).prop_map(|(rate, count)| vec![rate; count]),
        ];
        (rates, prop_oneof![Just(u32::MAX), Just(30_000), 1u32..3_000]).prop_map(|(rates_bps, capacity_bits)| {
            let text = format!("name = 'a'\n[sensors]\ncapacity_bits = {capacity_bits}\n");
            let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
            let row =
                |(id, rate_bps): (u32, &f64)| format!("1,2,{},{rate_bps}\n", id.wrapping_mul(977) % capacity_bits);
            let rows: String = (0..).zip(&rates_bps).map(row).collect();
            let list = format!("x_m,y_m,queue_bits,sampling_bps\n{rows}");
            let list = SensorList::parse(&list, Path::new("list.csv"), &scenario).unwrap();
            (scenario, list)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]

        #[test]
        fn a_field_advances_like_single_sensor_nodes((scenario, list) in lists(), served in 0u32..3_000) {
            let count = list.sensors().len();
            let capacity_bits = scenario.sensors.capacity_bits.ends()[1];
            let mean_bits: Vec<f64> = list.sensors().iter().map(|sensor| sensor.sampling_bps * scenario.slot_s).collect();
            let mut singly = list.queues_bits();
            let mut in_place = Field::new(&scenario, &list);
            let mut into_message = Field::new(&scenario, &list);
            let report = serving(served % count as u32, 700);
            let mut lost_slots = 0.0;
            for slot in 1..=6 {
                let mut lost_bits = 0;
                for (queue_bits, &mean) in singly.iter_mut().zip(&mean_bits) {
                    let held_bits = u64::from(*queue_bits) + bits_between(mean, slot - 1, slot);
                    *queue_bits = held_bits.min(capacity_bits.into()) as u32;
                    let lost = held_bits - u64::from(*queue_bits);
                    lost_bits += lost;
                    lost_slots += if lost > 0 { lost as f64 / mean } else { 0.0 };
                }
                let uploading_bits = &mut singly[served as usize % count];
                let delivered_bits = 700.min(*uploading_bits);
                *uploading_bits -= delivered_bits;
                let delivered_bits = delivered_bits.into();
                let mut message = vec![MaybeUninit::new(u32::MAX); count];
                let bits = in_place.step(slot, &report).unwrap();
                prop_assert_eq!(bits, SlotBits { delivered_bits, lost_bits });
                prop_assert_eq!(into_message.step_into(slot, &report, Some(&mut message)).unwrap(), bits);
                prop_assert_eq!(in_place.queues_bits(), &singly[..]);
                prop_assert!(in_place.totals().is_balanced());
                prop_assert_eq!(&into_message, &in_place);
                let mut restored = Field::new(&scenario, &list);
                restored.restore(&saved(&in_place)).unwrap();
                prop_assert_eq!((&restored, restored.totals()), (&in_place, in_place.totals()));
                prop_assert!((in_place.totals().lost_slots - lost_slots).abs() <= 1e-12 * lost_slots);
                // SAFETY: all of it was initialised above.
                let written = message.iter().map(|queue_bits| unsafe { queue_bits.assume_init() });
                prop_assert_eq!(written.collect::<Vec<u32>>(), &singly[..]);
            }
        }
    }

    #[test]
    #[should_panic(expected = "expected one queue per sensor node")]
    fn a_message_of_another_length_is_refused() {
        let _ = field(10_000).step_into(1, &serving(0, 1), Some(&mut [MaybeUninit::uninit(); 3]));
    }
}
