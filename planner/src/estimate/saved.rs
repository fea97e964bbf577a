//! The checkpoint of an estimate, so that a planner that is started again believes the same.

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::CheckpointError;
use skysink_common::message::MAX_SERVED;

use super::{Contact, Estimate};

/// Most bytes of a checkpoint for an SN.
pub const BYTES_EACH: usize = 56;

/// What a checkpoint holds of an estimate.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Saved {
    observed: u64,
    whole_since: u64,
    announced_slot: u64,
    announced: Vec<(u32, u32)>,
    /// The last contacts with the SNs that were ever contacted, ascending.
    contacted: Vec<Contact>,
}

impl Estimate {
    /// What the next slot has to know.
    pub(crate) fn saved(&self) -> Saved {
        Saved {
            observed: self.observed,
            whole_since: self.whole_since,
            announced_slot: self.announced_slot,
            announced: self.announced.clone(),
            contacted: self.beliefs.iter().map(|belief| belief.contact).filter(Contact::is_past).collect(),
        }
    }

    /// The estimate that was saved after `slot` in the mission that this one is of.
    pub(crate) fn restored(&self, slot: u64, saved: Saved) -> Result<Self, CheckpointError> {
        let Saved { observed, whole_since, announced_slot, announced, contacted } = saved;
        let sensors = self.beliefs.len();
        at_most("observed slot", observed, slot)?;
        at_most("first whole slot", whole_since, observed)?;
        at_most("announced slot", announced_slot, slot)?;
        at_most("announced sensor nodes", announced.len() as u64, MAX_SERVED as u64)?;
        for (id, _) in &announced {
            below("announced sensor node", *id, sensors)?;
        }
        let mut beliefs = self.beliefs.clone();
        for belief in &mut beliefs {
            belief.contact = self.before_any_contact(belief.contact.id, belief.capacity_bits);
        }
        if !contacted.is_sorted_by(|a, b| a.id < b.id) {
            return Err(CheckpointError::unexpected("contacts", "in another order", "ascending ids"));
        }
        for contact in contacted {
            below("sensor node", contact.id, sensors)?;
            let belief = &mut beliefs[contact.id as usize];
            self.check_contact(&contact, observed, belief.capacity_bits)?;
            belief.contact = contact;
        }
        let queues_bits = self.queues_bits.clone();
        Ok(Self { observed, whole_since, announced_slot, announced, beliefs, queues_bits, ..*self })
    }

    /// Refuses a contact that cannot have been the last, with a buffer of `capacity_bits`, up to the slot `observed`.
    fn check_contact(&self, contact: &Contact, observed: u64, capacity_bits: u32) -> Result<(), CheckpointError> {
        if !contact.is_past() || contact.learnt.is_some() != self.has_learnt_rates() {
            let expected = "a slot from 1, and a rate where rates are learnt";
            return Err(CheckpointError::unexpected("contact", format!("{contact:?}"), expected));
        }
        at_most("contact", contact.slot, observed)?;
        at_most("queue left [bit]", contact.left_bits.into(), capacity_bits.into())?;
        if let Some(learnt) = contact.learnt {
            // Gaps lie before the last contact, and none brings more than the buffer holds.
            at_most("slots of gaps", learnt.slots, contact.slot - 1)?;
            at_most("bits of gaps", learnt.bits, learnt.slots.saturating_mul(capacity_bits.into()))?;
            if !(0.0..=f64::from(capacity_bits)).contains(&learnt.least_mean_bits) {
                let expected = format!("0 to {capacity_bits}");
                return Err(CheckpointError::unexpected("least mean [bit]", learnt.least_mean_bits, expected));
            }
        }
        Ok(())
    }
}

fn at_most(key: &'static str, number: u64, most: u64) -> Result<(), CheckpointError> {
    if number <= most { Ok(()) } else { Err(CheckpointError::unexpected(key, number, format!("at most {most}"))) }
}

fn below(key: &'static str, id: u32, sensors: usize) -> Result<(), CheckpointError> {
    let is_known = (id as usize) < sensors;
    if is_known { Ok(()) } else { Err(CheckpointError::unexpected(key, id, format!("an id below {sensors}"))) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::{Learnt, Rates};
    use skysink_common::checkpoint::encode;
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
            ("39 slots of gaps before slot 39", |saved| learnt(saved).slots = 39),
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
