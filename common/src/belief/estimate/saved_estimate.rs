//! The checkpoint of an estimate, from which a restarted planner resumes.

use std::mem::discriminant;

use crate::checkpoint::CheckpointError;
use crate::nodes::Answer;
use serde::{Deserialize, Serialize};

use super::{Contact, Estimate, Learnt};

/// Most bytes per SN of a checkpoint.
pub const BYTES_PER_SENSOR: usize = 58;

/// An estimate as saved in a checkpoint.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SavedEstimate {
    observed: u64,
    gapless_since: u64,
    /// The last contact with each SN that had one, ascending by id.
    contacted: Vec<Contact>,
}

impl Estimate {
    /// The state for a checkpoint.
    pub fn saved(&self) -> SavedEstimate {
        SavedEstimate {
            observed: self.observed,
            gapless_since: self.gapless_since,
            contacted: self.sensors.iter().map(|sensor| sensor.contact).filter(Contact::has_happened).collect(),
        }
    }

    /// This estimate in a state that was saved after `slot` of the same mission.
    ///
    /// # Errors
    /// If the state is impossible.
    pub fn restored(&self, slot: u64, saved: SavedEstimate) -> Result<Self, CheckpointError> {
        let SavedEstimate { observed, gapless_since, contacted } = saved;
        let is_known = |id: u32| (id as usize) < self.sensors.len();
        let is_in_order = gapless_since <= observed && observed <= slot;
        CheckpointError::ensure(is_in_order, "slots up to that of the checkpoint")?;
        let is_sorted = contacted.is_sorted_by(|a, b| a.id < b.id);
        CheckpointError::ensure(is_sorted && contacted.iter().all(|contact| is_known(contact.id)), "contacts by id")?;
        let mut sensors = self.sensors.clone();
        for sensor in &mut sensors {
            sensor.contact = self.without_contact(sensor.contact.id, sensor.capacity_bits, sensor.prior_mean_bits);
        }
        for contact in contacted {
            let sensor = &mut sensors[contact.id as usize];
            let kind = |contact: &Contact| contact.learnt.as_ref().map(discriminant);
            let is_possible = kind(&contact) == kind(&sensor.contact)
                && self.is_possible_last(&contact, observed, sensor.capacity_bits);
            CheckpointError::ensure(is_possible, "possible last contacts")?;
            sensor.contact = contact;
        }
        let queues_bits = self.queues_bits.clone();
        Ok(Self { observed, gapless_since, sensors, queues_bits, predicted: None, ..*self })
    }

    /// Whether `contact` is a possible last contact up to slot `observed`, for a buffer of `capacity_bits`.
    fn is_possible_last(&self, contact: &Contact, observed: u64, capacity_bits: u32) -> bool {
        let is_in_time = contact.has_happened() && contact.slot <= observed;
        // Gaps end by the last contact, and none adds more than the buffer holds.
        let learnt_is_possible = contact.learnt.is_none_or(|learnt| match learnt {
            Learnt::Random(posterior) => posterior.is_possible(),
            Learnt::Counted(learnt) => {
                learnt.slots <= contact.slot
                    && learnt.bits <= learnt.slots.saturating_mul(capacity_bits.into())
                    && (0.0..=f64::from(capacity_bits)).contains(&learnt.least_mean_bits)
            }
        });
        let is_queue = match contact.answer {
            Answer::Queue => contact.left_bits <= capacity_bits,
            Answer::Silent => false,
            Answer::Dead => self.may_refuse && contact.left_bits == 0,
        };
        is_in_time && is_queue && learnt_is_possible
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint::encode;
    use crate::estimate::{LearntRate, Rates};
    use crate::message::{FlightReport, LinkReport, Mode, SensorNode};
    use crate::reported::ReportedQueues;
    use crate::scenario::{Overrides, Scenario};
    use crate::sensors::Sensors;

    const ALL: [Rates; 2] = [Rates::Known, Rates::Learnt];

    /// Five SNs before slot 1.
    fn fresh(rates: Rates) -> Estimate {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let sensor = SensorNode { sampling_bps: 7.3, capacity_bits: 30_000, ..SensorNode::default() };
        Estimate::new(&scenario, rates, &Sensors::of(&scenario, &[sensor; 5]))
    }

    /// After 40 slots that served SN 1 or 3.
    fn advanced(rates: Rates) -> Estimate {
        let mut estimate = fresh(rates);
        let mut flight = FlightReport::at([0.0, 0.0, 20.0], Mode::Serve);
        flight.served = 1;
        for slot in 1..=40 {
            let sensor = if slot % 5 == 0 { 3 } else { 1 };
            let before = ReportedQueues::at(slot, [sensor], &[slot as u32 * 700; 5]);
            flight.links[0] = LinkReport { sensor, ..LinkReport::default() };
            estimate.advance(slot, &[flight], &before, &[slot as u32; 5]);
        }
        estimate
    }

    fn bytes_of(estimate: &Estimate) -> Vec<u8> {
        let mut bytes = Vec::new();
        encode(&estimate.saved(), &mut bytes);
        bytes
    }

    #[test]
    fn restoring_an_estimate_replaces_any_earlier_one() {
        for rates in ALL {
            let estimate = advanced(rates);
            for into in [fresh(rates), estimate.clone()] {
                let mut restored = into.restored(41, estimate.saved()).unwrap();
                assert_eq!(bytes_of(&restored), bytes_of(&estimate), "{rates:?}");
                assert_eq!(restored.sensors, estimate.sensors, "{rates:?}");
                assert_eq!(restored.predict(90), estimate.clone().predict(90), "{rates:?}");
            }
            let reset = estimate.restored(41, fresh(rates).saved()).unwrap();
            assert_eq!(reset.sensors, fresh(rates).sensors, "{rates:?}");
        }
    }

    #[test]
    fn a_gap_over_missed_slots_is_ignored_after_a_restart_too() {
        let mut estimate = advanced(Rates::Learnt);
        let mut flight = FlightReport::at([0.0, 0.0, 20.0], Mode::Serve);
        estimate.advance(44, &[flight], &ReportedQueues::default(), &[0; 5]); // slots 41 to 43 were missed, in which SN 1 may have been served
        let mut restored = fresh(Rates::Learnt).restored(44, estimate.saved()).unwrap();
        flight.served = 1;
        flight.links[0] = LinkReport { sensor: 1, ..LinkReport::default() };
        for estimate in [&mut estimate, &mut restored] {
            let before = estimate.mean_bits(1);
            let reported = ReportedQueues::at(45, [1], &[20_000; 5]);
            estimate.advance(45, &[flight], &reported, &[0; 5]);
            assert_eq!(estimate.mean_bits(1), before);
        }
    }

    #[test]
    fn the_bytes_per_sensor_node_hold_the_largest_numbers() {
        let mut estimate = fresh(Rates::Learnt);
        let empty = bytes_of(&estimate).len();
        for sensor in &mut estimate.sensors {
            let learnt =
                Some(Learnt::Counted(LearntRate { bits: u64::MAX, slots: u64::MAX, least_mean_bits: f64::MAX }));
            let answer = Answer::Dead;
            sensor.contact = Contact { id: u32::MAX, slot: u64::MAX, answer, left_bits: u32::MAX, learnt };
        }
        assert!(bytes_of(&estimate).len() - empty <= 5 * BYTES_PER_SENSOR);
    }

    #[test]
    fn a_checkpoint_of_the_other_rate_knowledge_is_refused() {
        let [known, learnt] = ALL.map(advanced);
        assert!(known.restored(41, learnt.saved()).is_err());
        assert!(learnt.restored(41, known.saved()).is_err());
    }

    #[test]
    fn an_impossible_estimate_is_refused() {
        type Spoil = fn(&mut SavedEstimate);
        let cases: [(&str, Spoil); 10] = [
            ("observed after slot 41", |saved| saved.observed = 42),
            ("gapless since a slot not observed", |saved| saved.gapless_since = 41),
            ("SN 5", |saved| saved.contacted[1].id = 5),
            ("SN 3 twice", |saved| saved.contacted[0].id = 3),
            ("a contact in no slot", |saved| saved.contacted[0].slot = 0),
            ("a contact in slot 41", |saved| saved.contacted[0].slot = 41),
            ("more left than the buffer", |saved| saved.contacted[0].left_bits = 30_001),
            ("a silent contact", |saved| saved.contacted[0].answer = Answer::Silent),
            ("dead where none may be", |saved| {
                saved.contacted[0] = Contact { answer: Answer::Dead, left_bits: 0, ..saved.contacted[0] }
            }),
            ("not of these rates", |saved| {
                saved.contacted[0].learnt = if saved.contacted[0].learnt.is_some() {
                    None
                } else {
                    Some(Learnt::Counted(LearntRate::default()))
                }
            }),
        ];
        let of_rates: [(&str, Spoil); 4] = [
            ("40 slots up to slot 39", |saved| learnt(saved).slots = 40),
            ("more bits than the buffer holds", |saved| learnt(saved).bits = u64::MAX),
            ("a rate that is no number", |saved| learnt(saved).least_mean_bits = f64::NAN),
            ("a rate below 0", |saved| learnt(saved).least_mean_bits = -1.0),
        ];
        for rates in ALL {
            let estimate = advanced(rates);
            let of_rates = if rates == Rates::Learnt { &of_rates[..] } else { &[] };
            for (what, spoil) in cases.iter().chain(of_rates) {
                let mut spoilt = estimate.saved();
                spoil(&mut spoilt);
                assert!(estimate.restored(41, spoilt).is_err(), "{rates:?}: {what}");
            }
        }
    }

    fn learnt(saved: &mut SavedEstimate) -> &mut LearntRate {
        match &mut saved.contacted[0].learnt {
            Some(Learnt::Counted(learnt)) => learnt,
            other => panic!("expected learnt rates of constant arrivals, found {other:?}"),
        }
    }
}
