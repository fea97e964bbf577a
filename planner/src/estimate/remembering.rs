//! What is believed as bytes, so that a planner that is started again believes it, too.
//!
//! Little-endian: the slot observed last, the one since which no contact was missed, and the one whose schedule has
//! announced its queues, `u64` each; how many announce, `u32`, and of each id and queue, `u32` each; how many SNs were
//! ever contacted, `u32`, and of each, ascending, its id `u32`, the slot of the contact `u64`, what it left `u32`, and
//! where rates are learnt the slots and bits counted, `u64` each, and the least mean, `f64`.

use skysink_common::message::MAX_SERVED;

use super::{Belief, Estimate, Learnt};
use crate::memory::{MemoryError, Reader};

/// Most bytes for an SN.
pub(crate) const BYTES_EACH: usize = 40;

impl Estimate {
    /// Appends what the next slot has to know.
    pub(crate) fn remember(&self, bytes: &mut Vec<u8>) {
        let (announced_slot, announced) = &self.announced;
        for slot in [self.observed, self.whole_since, *announced_slot] {
            bytes.extend(slot.to_le_bytes());
        }
        bytes.extend(length(announced.len()).to_le_bytes());
        for (id, queue_bits) in announced {
            bytes.extend([id.to_le_bytes(), queue_bits.to_le_bytes()].as_flattened());
        }
        let contacted = self.beliefs.iter().filter(|belief| belief.contact > 0).count();
        bytes.extend(length(contacted).to_le_bytes());
        for (id, belief) in (0u32..).zip(&self.beliefs).filter(|(_, belief)| belief.contact > 0) {
            bytes.extend(id.to_le_bytes());
            bytes.extend(belief.contact.to_le_bytes());
            bytes.extend(belief.left_bits.to_le_bytes());
            if self.learns() {
                let Learnt { bits, slots, least_mean_bits } = belief.learnt;
                bytes.extend([slots.to_le_bytes(), bits.to_le_bytes(), least_mean_bits.to_le_bytes()].as_flattened());
            }
        }
    }

    /// What a memory after `slot` holds of the mission that this estimate is of.
    pub(crate) fn recalled(&self, slot: u64, memory: &mut Reader) -> Result<Self, MemoryError> {
        let observed = memory.long(slot)?;
        let (whole_since, announced_slot) = (memory.long(observed)?, memory.long(slot)?);
        let last = length(self.beliefs.len().saturating_sub(1));
        let mut announced = Vec::with_capacity(MAX_SERVED);
        for _ in 0..memory.number(length(MAX_SERVED))? {
            announced.push((memory.number(last)?, memory.number(u32::MAX)?));
        }
        let before =
            |known: &Belief| Belief::before_any_contact(known.capacity_bits, known.prior_mean_bits, self.initial_bits);
        let mut beliefs: Vec<Belief> = self.beliefs.iter().map(before).collect();
        let mut least_id = 0;
        for _ in 0..memory.number(length(beliefs.len()))? {
            let id = memory.number(last)?;
            if id < least_id {
                return Err(memory.malformed());
            }
            least_id = id + 1;
            self.recall_contact(&mut beliefs[id as usize], observed, memory)?;
        }
        let announced = (announced_slot, announced);
        Ok(Self { observed, whole_since, announced, beliefs, queues_bits: self.queues_bits.clone(), ..*self })
    }

    /// Fills a belief in, which is of the slot `observed` at the latest.
    fn recall_contact(&self, belief: &mut Belief, observed: u64, memory: &mut Reader) -> Result<(), MemoryError> {
        belief.contact = memory.long(observed)?;
        belief.left_bits = memory.number(belief.capacity_bits)?;
        if belief.contact == 0 {
            return Err(memory.malformed());
        }
        if self.learns() {
            // Gaps lie before the last contact, and none brings more than the storage holds.
            let slots = memory.long(belief.contact - 1)?;
            let bits = memory.long(slots.saturating_mul(belief.capacity_bits.into()))?;
            belief.learnt = Learnt { bits, slots, least_mean_bits: memory.real(f64::from(belief.capacity_bits))? };
        }
        Ok(())
    }
}

/// A length as it is written.
fn length(length: usize) -> u32 {
    u32::try_from(length).expect("a scenario has at most 10^7 sensor nodes")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::begin;
    use crate::settings::{Rates, Strategy};
    use skysink_common::message::{FlightReport, LinkReport, Mode, SensorNode};
    use skysink_common::scenario::{Overrides, Scenario};

    const ALL: [Rates; 2] = [Rates::Known, Rates::Learnt];

    /// Five SNs before slot 1.
    fn fresh(rates: Rates) -> Estimate {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let sensor = SensorNode { sampling_bps: 7.3, capacity_bits: 30_000, ..SensorNode::default() };
        Estimate::new(&scenario, rates, &[sensor; 5])
    }

    /// The same after 40 slots in which SNs 1 and 3 were served by turns.
    fn lived(rates: Rates) -> Estimate {
        let mut estimate = fresh(rates);
        let mut flight = FlightReport::at(0.0, 0.0, 20.0, Mode::Serve);
        flight.served = 1;
        for slot in 1..=40 {
            let sensor = if slot % 5 == 0 { 3 } else { 1 };
            estimate.announce(slot, &[sensor], &[slot as u32 * 700; 5]);
            flight.links[0] = LinkReport { sensor, ..LinkReport::default() };
            estimate.observe(slot, &flight, &[slot as u32; 5]);
        }
        estimate.announce(41, &[2, 4], &[9, 8, 7, 6, 5]);
        estimate
    }

    fn memory_of(estimate: &Estimate) -> Vec<u8> {
        let mut bytes = Vec::new();
        begin(&mut bytes, Strategy::Uts, 41, Some(estimate));
        bytes
    }

    fn recall(into: &Estimate, bytes: &[u8]) -> Result<Estimate, MemoryError> {
        let mut memory = Reader::new(bytes, Strategy::Uts, 41)?;
        let recalled = memory.estimate(Some(into))?.expect("one was given");
        memory.end().map(|()| recalled)
    }

    #[test]
    fn what_is_recalled_is_what_was_believed_whatever_was_believed_before() {
        for rates in ALL {
            let estimate = lived(rates);
            for into in [fresh(rates), estimate.clone()] {
                let mut recalled = recall(&into, &memory_of(&estimate)).unwrap();
                assert_eq!(memory_of(&recalled), memory_of(&estimate), "{rates:?}");
                assert_eq!(recalled.beliefs, estimate.beliefs, "{rates:?}");
                assert_eq!(recalled.believe(90), estimate.clone().believe(90), "{rates:?}");
            }
            let forgotten = recall(&estimate, &memory_of(&fresh(rates))).unwrap();
            assert_eq!(forgotten.beliefs, fresh(rates).beliefs, "{rates:?}");
        }
    }

    #[test]
    fn the_room_for_a_sensor_node_is_what_it_takes() {
        let mut estimate = fresh(Rates::Learnt);
        let (empty, slots) = (memory_of(&estimate).len(), 40);
        estimate.beliefs.iter_mut().for_each(|belief| belief.contact = slots);
        assert_eq!(memory_of(&estimate).len() - empty, 5 * BYTES_EACH);
    }

    #[test]
    fn a_memory_of_other_beliefs_is_refused() {
        let [known, learnt] = ALL.map(lived);
        assert!(recall(&known, &memory_of(&learnt)).is_err());
        assert!(recall(&learnt, &memory_of(&known)).is_err());
        let mut none = Vec::new();
        begin(&mut none, Strategy::Uts, 41, None);
        assert!(recall(&known, &none).is_err(), "something was believed after slot 41");
        assert!(Reader::new(&memory_of(&known), Strategy::Uts, 41).unwrap().estimate(None).is_err());
    }

    #[test]
    fn a_malformed_memory_is_refused() {
        for rates in ALL {
            let (estimate, bytes) = (lived(rates), memory_of(&lived(rates)));
            for length in 0..bytes.len() {
                assert!(recall(&estimate, &bytes[..length]).is_err(), "{rates:?}: cut after {length}");
            }
            assert!(recall(&estimate, &[&bytes[..], &[0]].concat()).is_err(), "{rates:?}: too long");
            // Head 11; observed, whole since, announced slot: 8 each; 2 announce 8 each; then how many were contacted.
            let contacts = 11 + 24 + 4 + 16;
            let entry = contacts + 4;
            let cases = [
                ("observed after slot 41", 11, 42u64.to_le_bytes().to_vec()),
                ("whole since a slot not observed", 19, 41u64.to_le_bytes().to_vec()),
                ("announced for slot 42", 27, 42u64.to_le_bytes().to_vec()),
                ("65 announce", 35, 65u32.to_le_bytes().to_vec()),
                ("SN 5 announces", 39, 5u32.to_le_bytes().to_vec()),
                ("6 of 5 SNs", contacts, 6u32.to_le_bytes().to_vec()),
                ("SN 5", entry, 5u32.to_le_bytes().to_vec()),
                ("SN 3 twice", entry, 3u32.to_le_bytes().to_vec()),
                ("a contact in no slot", entry + 4, 0u64.to_le_bytes().to_vec()),
                ("a contact in slot 41", entry + 4, 41u64.to_le_bytes().to_vec()),
                ("more left than the storage", entry + 12, 30_001u32.to_le_bytes().to_vec()),
            ];
            let of_rates = [
                ("39 slots of gaps before slot 39", entry + 16, 39u64.to_le_bytes().to_vec()),
                ("more bits than the storage holds", entry + 24, u64::MAX.to_le_bytes().to_vec()),
                ("a rate that is no number", entry + 32, f64::NAN.to_le_bytes().to_vec()),
                ("a rate below 0", entry + 32, (-1.0f64).to_le_bytes().to_vec()),
            ];
            let learnt = if rates == Rates::Learnt { &of_rates[..] } else { &[] };
            for (what, place, new) in cases.iter().chain(learnt) {
                let mut spoilt = bytes.clone();
                spoilt[*place..place + new.len()].copy_from_slice(new);
                assert!(recall(&estimate, &spoilt).is_err(), "{rates:?}: {what}");
            }
        }
    }
}
