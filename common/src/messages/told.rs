//! What is told of the sensor nodes (SNs) after a slot, and what UAVs sense: the input of planners.

use std::borrow::Cow;

use crate::message::{FlightReport, HeardLink};
use crate::nodes::Answer;
use crate::scenario::Scenario;

/// What is told of the SNs after a slot: their queues, and their answers in the next slot. It is made of queues alone
/// where all SNs send.
///
/// ```
/// use skysink_common::{nodes::Answer, told::Told};
/// let queues_bits = [700, 0];
/// assert_eq!(Told::from(&queues_bits).answer(1), Answer::Queue);
/// let told = Told::new(&queues_bits, &[Answer::Silent, Answer::Dead]);
/// assert_eq!((told.queues_bits[0], told.answer(0), told.answer(1)), (700, Answer::Silent, Answer::Dead));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Told<'a> {
    /// Queue lengths [bit], by id; 0 of a dead SN.
    pub queues_bits: &'a [u32],
    /// What each SN does in the next slot, by id; empty if all send their queues.
    pub answers: &'a [Answer],
}

impl<'a> Told<'a> {
    /// The queues [bit] and answers by id; no answers if all SNs send.
    ///
    /// # Panics
    /// If there are answers, but not one for each queue.
    #[must_use]
    pub fn new(queues_bits: &'a [u32], answers: &'a [Answer]) -> Self {
        assert!(answers.is_empty() || answers.len() == queues_bits.len(), "expected an answer of each sensor node");
        Self { queues_bits, answers }
    }

    /// What SN `id` does in the next slot.
    #[inline]
    pub fn answer(&self, id: u32) -> Answer {
        self.answers.get(id as usize).copied().unwrap_or_default()
    }
}

impl<'a> From<&'a [u32]> for Told<'a> {
    fn from(queues_bits: &'a [u32]) -> Self {
        Self { queues_bits, answers: &[] }
    }
}

impl<'a> From<&'a Vec<u32>> for Told<'a> {
    fn from(queues_bits: &'a Vec<u32>) -> Self {
        Self::from(&queues_bits[..])
    }
}

impl<'a, const N: usize> From<&'a [u32; N]> for Told<'a> {
    fn from(queues_bits: &'a [u32; N]) -> Self {
        Self::from(&queues_bits[..])
    }
}

impl<'a> From<&'a Cow<'_, [u32]>> for Told<'a> {
    fn from(queues_bits: &'a Cow<'_, [u32]>) -> Self {
        Self::from(&queues_bits[..])
    }
}

/// What the UAVs sense at the end of a slot: the input of the planners of a fleet.
#[derive(Debug, Clone, Copy)]
pub struct Sensed<'a> {
    /// The slot; 0 before the first.
    pub slot: u64,
    /// The flight of each UAV, by number.
    pub flights: &'a [FlightReport],
    /// Queues and answers after the slot.
    pub told: Told<'a>,
    /// What else they receive.
    pub received: &'a Received<'a>,
}

/// What the UAVs of a fleet receive at the end of a slot beside queues and answers.
#[derive(Debug, Clone, Default)]
pub struct Received<'a> {
    /// The links that they hear, by UAV and SN; nothing without `link.beacon_radius_m`.
    pub links: Cow<'a, [HeardLink]>,
}

impl Received<'_> {
    /// Nothing.
    pub const NOTHING: Self = Self { links: Cow::Borrowed(&[]) };
}

/// What one UAV has received ([`Received`]) at the end of the last slot, with the numbers of its own SNs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Heard {
    /// The links that it hears, by ascending SN; `None` without `link.beacon_radius_m`.
    pub links: Option<Vec<HeardLink>>,
}

impl Heard {
    /// Nothing, in a mission in which nothing is heard.
    pub const NOTHING: Self = Self { links: None };

    /// Nothing yet.
    #[must_use]
    pub fn of(scenario: &Scenario) -> Self {
        Self { links: scenario.link.beacon_radius_m.map(|_| Vec::new()) }
    }

    /// Takes in what the UAV number `uav` has `received`. `number` is the number of an SN, `None` of others than its
    /// own.
    pub fn receive(&mut self, received: &Received<'_>, uav: usize, number: impl Fn(u32) -> Option<u32>) {
        if let Some(links) = &mut self.links {
            let own = received.links.iter().filter(|link| link.uav as usize == uav);
            links.clear();
            links.extend(own.filter_map(|link| Some(HeardLink { sensor: number(link.sensor)?, ..*link })));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uav_hears_its_own_links_by_the_numbers_of_its_part() {
        let link = |uav, sensor| HeardLink { uav, sensor, snr_db: 3.0 };
        let received = Received { links: vec![link(0, 7), link(1, 5), link(1, 7), link(1, 9)].into() };
        let mut heard = Heard { links: Some(vec![link(1, 0)]) };
        heard.receive(&received, 1, |id| [5, 9].iter().position(|own| *own == id).map(|number| number as u32));
        assert_eq!(heard.links, Some(vec![link(1, 0), link(1, 1)]));
        let mut deaf = Heard::NOTHING;
        deaf.receive(&received, 1, Some);
        assert_eq!(deaf, Heard::NOTHING);
    }
}
