//! The checkpoint of an estimate, so that a planner that is started again believes the same.

use crate::checkpoint::CheckpointError;
use crate::message::MAX_SERVED;
use serde::{Deserialize, Serialize};

use super::{Contact, Estimate};

/// Most bytes of a checkpoint for an SN.
pub const BYTES_EACH: usize = 56;

/// What a checkpoint holds of an estimate.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Saved {
    observed: u64,
    whole_since: u64,
    announced_slot: u64,
    announced: Vec<(u32, u32)>,
    /// The last contacts with the SNs that were ever contacted, ascending.
    contacted: Vec<Contact>,
}

impl Estimate {
    /// What the next slot has to know.
    #[must_use]
    pub fn saved(&self) -> Saved {
        Saved {
            observed: self.observed,
            whole_since: self.whole_since,
            announced_slot: self.announced_slot,
            announced: self.announced.clone(),
            contacted: self.beliefs.iter().map(|belief| belief.contact).filter(Contact::is_past).collect(),
        }
    }

    /// The estimate that was saved after `slot` in the mission that this one is of.
    ///
    /// # Errors
    /// If it cannot have been.
    pub fn restored(&self, slot: u64, saved: Saved) -> Result<Self, CheckpointError> {
        let Saved { observed, whole_since, announced_slot, announced, contacted } = saved;
        let is_known = |id: u32| (id as usize) < self.beliefs.len();
        let is_in_order = whole_since <= observed && observed <= slot && announced_slot <= slot;
        CheckpointError::unless(is_in_order, "slots up to that of the checkpoint")?;
        let are_known = announced.len() <= MAX_SERVED && announced.iter().all(|(id, _)| is_known(*id));
        CheckpointError::unless(are_known, "announced sensor nodes of this field")?;
        let is_sorted = contacted.is_sorted_by(|a, b| a.id < b.id);
        CheckpointError::unless(is_sorted && contacted.iter().all(|contact| is_known(contact.id)), "contacts by id")?;
        let mut beliefs = self.beliefs.clone();
        for belief in &mut beliefs {
            belief.contact = self.before_any_contact(belief.contact.id, belief.capacity_bits);
        }
        for contact in contacted {
            let belief = &mut beliefs[contact.id as usize];
            let is_possible = self.can_be_last(&contact, observed, belief.capacity_bits);
            CheckpointError::unless(is_possible, "contacts that can have been the last")?;
            belief.contact = contact;
        }
        let queues_bits = self.queues_bits.clone();
        Ok(Self { observed, whole_since, announced_slot, announced, beliefs, queues_bits, ..*self })
    }

    /// Whether a contact can have been the last up to the slot `observed` with a buffer of `capacity_bits`.
    fn can_be_last(&self, contact: &Contact, observed: u64, capacity_bits: u32) -> bool {
        let is_in_time = contact.is_past() && contact.slot <= observed;
        // Gaps and contacts lie up to the last contact, and none brings more than the buffer holds.
        let learnt_is_possible = contact.learnt.is_none_or(|learnt| {
            learnt.slots <= contact.slot
                && learnt.bits <= learnt.slots.saturating_mul(capacity_bits.into())
                && (0.0..=f64::from(capacity_bits)).contains(&learnt.least_mean_bits)
        });
        is_in_time
            && contact.left_bits <= capacity_bits
            && contact.learnt.is_some() == self.has_learnt_rates()
            && learnt_is_possible
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint::encode;
    use crate::estimate::{Learnt, Rates};
    use crate::message::{FlightReport, LinkReport, Mode, SensorNode};
    use crate::scenario::{Overrides, Scenario};

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
        let mut flight = FlightReport::at([0.0, 0.0, 20.0], Mode::Serve);
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

    fn bytes_of(estimate: &Estimate) -> Vec<u8> {
        let mut bytes = Vec::new();
        encode(&estimate.saved(), &mut bytes);
        bytes
    }

    #[test]
    fn what_is_restored_is_what_was_believed_whatever_was_believed_before() {
        for rates in ALL {
            let estimate = lived(rates);
            for into in [fresh(rates), estimate.clone()] {
                let mut restored = into.restored(41, estimate.saved()).unwrap();
                assert_eq!(bytes_of(&restored), bytes_of(&estimate), "{rates:?}");
                assert_eq!(restored.beliefs, estimate.beliefs, "{rates:?}");
                assert_eq!(restored.believe(90), estimate.clone().believe(90), "{rates:?}");
            }
            let forgotten = estimate.restored(41, fresh(rates).saved()).unwrap();
            assert_eq!(forgotten.beliefs, fresh(rates).beliefs, "{rates:?}");
        }
    }

    #[test]
    fn a_gap_over_missed_slots_teaches_nothing_after_a_restart_either() {
        let mut estimate = lived(Rates::Learnt);
        let mut flight = FlightReport::at([0.0, 0.0, 20.0], Mode::Serve);
        estimate.observe(44, &flight, &[0; 5]); // slots 41 to 43 were missed, in which SN 1 may have been served
        let mut restored = fresh(Rates::Learnt).restored(44, estimate.saved()).unwrap();
        flight.served = 1;
        flight.links[0] = LinkReport { sensor: 1, ..LinkReport::default() };
        for estimate in [&mut estimate, &mut restored] {
            let before = estimate.mean_bits(1);
            estimate.announce(45, &[1], &[20_000; 5]);
            estimate.observe(45, &flight, &[0; 5]);
            assert_eq!(estimate.mean_bits(1), before);
        }
    }

    #[test]
    fn the_room_for_a_sensor_node_is_enough_for_the_largest_numbers() {
        let mut estimate = fresh(Rates::Learnt);
        let empty = bytes_of(&estimate).len();
        for belief in &mut estimate.beliefs {
            let learnt = Some(Learnt { bits: u64::MAX, slots: u64::MAX, least_mean_bits: f64::MAX });
            belief.contact = Contact { id: u32::MAX, slot: u64::MAX, left_bits: u32::MAX, learnt };
        }
        assert!(bytes_of(&estimate).len() - empty <= 5 * BYTES_EACH);
    }

    #[test]
    fn a_checkpoint_of_other_beliefs_is_refused() {
        let [known, learnt] = ALL.map(lived);
        assert!(known.restored(41, learnt.saved()).is_err());
        assert!(learnt.restored(41, known.saved()).is_err());
    }

    #[test]
    fn what_cannot_have_been_believed_is_refused() {
        type Spoil = fn(&mut Saved);
        let cases: [(&str, Spoil); 11] = [
            ("observed after slot 41", |saved| saved.observed = 42),
            ("whole since a slot not observed", |saved| saved.whole_since = 41),
            ("announced for slot 42", |saved| saved.announced_slot = 42),
            ("65 announce", |saved| saved.announced = vec![(0, 0); 65]),
            ("SN 5 announces", |saved| saved.announced[0].0 = 5),
            ("SN 5", |saved| saved.contacted[1].id = 5),
            ("SN 3 twice", |saved| saved.contacted[0].id = 3),
            ("a contact in no slot", |saved| saved.contacted[0].slot = 0),
            ("a contact in slot 41", |saved| saved.contacted[0].slot = 41),
            ("more left than the buffer", |saved| saved.contacted[0].left_bits = 30_001),
            ("not of these rates", |saved| {
                saved.contacted[0].learnt =
                    if saved.contacted[0].learnt.is_some() { None } else { Some(Learnt::default()) }
            }),
        ];
        let of_rates: [(&str, Spoil); 4] = [
            ("40 slots up to slot 39", |saved| learnt(saved).slots = 40),
            ("more bits than the buffer holds", |saved| learnt(saved).bits = u64::MAX),
            ("a rate that is no number", |saved| learnt(saved).least_mean_bits = f64::NAN),
            ("a rate below 0", |saved| learnt(saved).least_mean_bits = -1.0),
        ];
        for rates in ALL {
            let estimate = lived(rates);
            let of_rates = if rates == Rates::Learnt { &of_rates[..] } else { &[] };
            for (what, spoil) in cases.iter().chain(of_rates) {
                let mut spoilt = estimate.saved();
                spoil(&mut spoilt);
                assert!(estimate.restored(41, spoilt).is_err(), "{rates:?}: {what}");
            }
        }
    }

    fn learnt(saved: &mut Saved) -> &mut Learnt {
        saved.contacted[0].learnt.as_mut().expect("rates are learnt")
    }
}
