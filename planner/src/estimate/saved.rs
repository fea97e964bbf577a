//! What is believed as a checkpoint, so that a planner that is started again believes it, too.

use serde::{Deserialize, Serialize};
use skysink_common::checkpoint::CheckpointError;
use skysink_common::message::MAX_SERVED;

use super::{Belief, Estimate, Learnt};

/// Most bytes of a checkpoint for an SN.
pub const BYTES_EACH: usize = 56;

/// What a checkpoint holds of an estimate.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Saved {
    observed: u64,
    whole_since: u64,
    announced_slot: u64,
    announced: Vec<(u32, u32)>,
    /// The SNs that were ever contacted, ascending.
    contacted: Vec<Contact>,
}

/// What a checkpoint holds of an SN.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Contact {
    id: u32,
    /// Slot of the last contact.
    slot: u64,
    left_bits: u32,
    /// Where rates are learnt.
    learnt: Option<Learnt>,
}

impl Estimate {
    /// What the next slot has to know.
    pub(crate) fn saved(&self) -> Saved {
        let contact = |(id, belief): (u32, &Belief)| {
            let learnt = self.learns().then_some(belief.learnt);
            Contact { id, slot: belief.contact, left_bits: belief.left_bits, learnt }
        };
        let contacted = (0..).zip(&self.beliefs).filter(|(_, belief)| belief.contact > 0).map(contact).collect();
        Saved {
            observed: self.observed,
            whole_since: self.whole_since,
            announced_slot: self.announced.0,
            announced: self.announced.1.clone(),
            contacted,
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
        let before =
            |known: &Belief| Belief::before_any_contact(known.capacity_bits, known.prior_mean_bits, self.initial_bits);
        let mut beliefs: Vec<Belief> = self.beliefs.iter().map(before).collect();
        if !contacted.is_sorted_by(|a, b| a.id < b.id) {
            return Err(CheckpointError::unexpected("contacts", "in another order", "ascending ids"));
        }
        for contact in contacted {
            below("sensor node", contact.id, sensors)?;
            self.restore_contact(&mut beliefs[contact.id as usize], observed, contact)?;
        }
        let announced = (announced_slot, announced);
        Ok(Self { observed, whole_since, announced, beliefs, queues_bits: self.queues_bits.clone(), ..*self })
    }

    /// Fills a belief in, which is of the slot `observed` at the latest.
    fn restore_contact(&self, belief: &mut Belief, observed: u64, contact: Contact) -> Result<(), CheckpointError> {
        if contact.slot == 0 || contact.learnt.is_some() != self.learns() {
            let expected = "a slot from 1, and a rate where rates are learnt";
            return Err(CheckpointError::unexpected("contact", format!("{contact:?}"), expected));
        }
        at_most("contact", contact.slot, observed)?;
        at_most("queue left [bit]", contact.left_bits.into(), belief.capacity_bits.into())?;
        if let Some(learnt) = contact.learnt {
            // Gaps lie before the last contact, and none brings more than the buffer holds.
            at_most("slots of gaps", learnt.slots, contact.slot - 1)?;
            at_most("bits of gaps", learnt.bits, learnt.slots.saturating_mul(belief.capacity_bits.into()))?;
            if !(0.0..=f64::from(belief.capacity_bits)).contains(&learnt.least_mean_bits) {
                let expected = format!("0 to {}", belief.capacity_bits);
                return Err(CheckpointError::unexpected("least mean [bit]", learnt.least_mean_bits, expected));
            }
            belief.learnt = learnt;
        }
        belief.contact = contact.slot;
        belief.left_bits = contact.left_bits;
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
    use crate::settings::Rates;
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
            belief.contact = u64::MAX;
            belief.left_bits = u32::MAX;
            belief.learnt = Learnt { bits: u64::MAX, slots: u64::MAX, least_mean_bits: f64::MAX };
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
