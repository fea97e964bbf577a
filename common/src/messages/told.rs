//! What is told of the sensor nodes (SNs) after a slot, and what UAVs sense: the input of planners.

use std::borrow::Cow;

use crate::message::{FlightReport, HeardLink};
use crate::nodes::Answer;

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
    /// What the UAVs hear, by UAV and SN; nothing without `link.beacon_radius_m`.
    pub links: &'a [HeardLink],
}
