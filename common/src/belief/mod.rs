//! What the UAV believes of the queues: their lengths and the sampling rates, known or estimated.
//!
//! How they are estimated is left to [`crate::estimate`].

pub mod estimate;
pub mod reported;

use std::sync::Arc;

use crate::checkpoint::CheckpointError;
use crate::estimate::{Estimate, Rates, SavedEstimate, Uncertainty, uniform_sd};
use crate::message::{FlightReport, SensorNode};
use crate::nodes::Answer;
use crate::reported::ReportedQueues;
use crate::scenario::Scenario;
use crate::sensors::{SensorList, Sensors};
use crate::told::Told;

/// The belief of a UAV, which advances by one slot after the other. Its methods panic if an SN is unknown.
#[derive(Debug, Clone, PartialEq)]
pub enum Belief {
    /// It knows the queues and the rates. Nothing is stored.
    Known,
    /// It estimates the queues from its contacts.
    Estimated(Box<Estimate>),
}

impl Belief {
    /// The belief before slot 1 over the SNs of a scenario. If the UAV has to estimate the queues, `estimated` is what
    /// it knows of the rates.
    #[must_use]
    pub fn new(scenario: &Scenario, sensors: &Sensors, estimated: Option<Rates>) -> Self {
        estimated.map_or(Self::Known, |rates| Self::Estimated(Box::new(Estimate::new(scenario, rates, sensors))))
    }

    /// The belief before slot 1 over the SNs of a list.
    #[must_use]
    pub fn of(scenario: &Scenario, list: &SensorList, estimated: Option<Rates>) -> Self {
        let over_list = |rates| Self::new(scenario, &Sensors::of(scenario, &list.nodes()), Some(rates));
        estimated.map_or(Self::Known, over_list)
    }

    /// The estimate; `None` if the queues are known.
    fn estimate(&self) -> Option<&Estimate> {
        match self {
            Self::Known => None,
            Self::Estimated(estimate) => Some(estimate),
        }
    }

    /// The estimate of learnt rates; `None` if the rates are known.
    fn learnt(&self) -> Option<&Estimate> {
        self.estimate().filter(|estimate| estimate.has_learnt_rates())
    }

    /// Whether the queues are estimated.
    pub fn is_estimated(&self) -> bool {
        self.estimate().is_some()
    }

    /// The queues that the SNs `ids` report if they are served in `slot`, as they are `told` before it; nothing if they
    /// are known.
    pub fn reported<'t>(
        &self,
        slot: u64,
        ids: impl IntoIterator<Item = u32>,
        told: impl Into<Told<'t>>,
    ) -> ReportedQueues {
        self.estimate().map_or_else(ReportedQueues::default, |_| ReportedQueues::at(slot, ids, told))
    }

    /// Advances by `slot`: its flights, the queues [`Self::reported`] `before` it by at least the served SNs, and what
    /// is told `after` it, of which only queues and answers of the served SNs are read.
    ///
    /// A slot that was taken in already, or before a later one, is ignored. Slots may be skipped; an estimate is then
    /// older.
    pub fn advance<'t>(
        &mut self,
        slot: u64,
        flights: &[FlightReport],
        before: &ReportedQueues,
        after: impl Into<Told<'t>>,
    ) {
        if let Self::Estimated(estimate) = self {
            estimate.advance(slot, flights, before, after.into());
        }
    }

    /// What is known of an SN `id` whose answer in the next slot is `answer`: that, if queues are known. Otherwise only
    /// a contact shows a death, but UAVs know what each SN has sent, and so its silence.
    #[inline]
    pub fn answer(&self, id: u32, answer: Answer) -> Answer {
        let Some(estimate) = self.estimate() else { return answer };
        match answer {
            _ if estimate.is_dead(id) => Answer::Dead,
            Answer::Dead => Answer::Queue,
            answer => answer,
        }
    }

    /// What is known of the answers of all SNs, by id ([`Self::answer`]); `room` is memory for them.
    pub fn answers<'a>(&self, answers: &'a [Answer], room: &'a mut Vec<Answer>) -> &'a [Answer] {
        if !self.is_estimated() {
            return answers;
        }
        room.clear();
        room.extend((0..).zip(answers).map(|(id, &answer)| self.answer(id, answer)));
        room
    }

    /// Whether the rates are learnt.
    pub fn has_learnt_rates(&self) -> bool {
        self.learnt().is_some()
    }

    /// The learnt rates of all SNs [bit/s], by id, in slots of `slot_s` [s]; `None` if the rates are known.
    pub fn learnt_bps(&self, slot_s: f64) -> Option<impl Iterator<Item = f64>> {
        Some(self.learnt()?.means_bits().map(move |mean_bits| mean_bits / slot_s))
    }

    /// The SNs `nodes` as the UAV knows them: with the learnt rates instead of the true ones, if it has to learn them.
    pub fn known_nodes(&self, mut nodes: Vec<SensorNode>, slot_s: f64) -> Vec<SensorNode> {
        let learnt_bps = self.learnt_bps(slot_s).into_iter().flatten();
        nodes.iter_mut().zip(learnt_bps).for_each(|(node, learnt_bps)| node.sampling_bps = learnt_bps);
        nodes
    }

    /// The `sensors` with the rates that the UAV has learnt instead of the true ones; unchanged if it has learnt none.
    pub fn known_sensors(&self, sensors: Arc<Sensors>) -> Arc<Sensors> {
        let Some(estimate) = self.learnt() else { return sensors };
        let sampling = sensors.sampling.with_means(estimate.means_bits().collect());
        Arc::new(Sensors { sampling, ..Sensors::clone(&sensors) })
    }

    /// Bits that SN `id` of `sensors` samples per slot.
    #[inline]
    pub fn mean_bits(&self, sensors: &Sensors, id: u32) -> f64 {
        match self {
            Self::Known => sensors.sampler(id).mean_bits,
            Self::Estimated(estimate) => estimate.mean_bits(id),
        }
    }

    /// Estimates the queues at the end of `slot`. Takes O(N) for an estimate, and no time for known queues.
    pub fn predict(&mut self, slot: u64) {
        if let Self::Estimated(estimate) = self {
            estimate.predict(slot);
        }
    }

    /// The queues [bit] by id: as of the last [`Self::predict`], or `queues_bits` if they are known.
    pub fn queues_bits<'a>(&'a self, queues_bits: &'a [u32]) -> &'a [u32] {
        match self {
            Self::Known => queues_bits,
            Self::Estimated(estimate) => estimate.queues_bits(),
        }
    }

    /// What is believed at the end of `slot`, at which the queues of `sensors` are those of `known`, and whose answers
    /// are known to be its ([`Self::answers`]). Takes time as [`Self::predict`].
    pub fn at<'a>(&'a mut self, slot: u64, sensors: &'a Sensors, known: impl Into<Told<'a>>) -> Believed<'a> {
        self.predict(slot);
        self.predicted(slot, sensors, known)
    }

    /// What is believed at the end of `slot`, the one of the last [`Self::predict`].
    pub fn predicted<'a>(&'a self, slot: u64, sensors: &'a Sensors, known: impl Into<Told<'a>>) -> Believed<'a> {
        let Told { queues_bits, answers } = known.into();
        Believed { slot, sensors, queues_bits: self.queues_bits(queues_bits), answers, belief: self }
    }

    /// The state for a checkpoint; `None` if the queues are known.
    pub fn saved(&self) -> Option<SavedEstimate> {
        self.estimate().map(Estimate::saved)
    }

    /// This belief in a state that was saved after `slot` of the same mission.
    ///
    /// # Errors
    /// If the state is impossible, or of queues that are known here and estimated there, or the reverse.
    pub fn restored(&self, slot: u64, saved: Option<SavedEstimate>) -> Result<Self, CheckpointError> {
        match (self, saved) {
            (Self::Known, None) => Ok(Self::Known),
            (Self::Estimated(estimate), Some(saved)) => Ok(Self::Estimated(Box::new(estimate.restored(slot, saved)?))),
            _ => CheckpointError::ensure(false, "the same knowledge of the queues").map(|()| Self::Known),
        }
    }
}

/// What the UAV believes at the end of a slot. Its methods panic if an SN is unknown.
#[derive(Debug, Clone, Copy)]
pub struct Believed<'a> {
    slot: u64,
    sensors: &'a Sensors,
    /// The queues [bit], by id.
    pub queues_bits: &'a [u32],
    /// What is known of the answers, by id; empty if all SNs send.
    pub answers: &'a [Answer],
    /// The belief.
    pub belief: &'a Belief,
}

impl<'a> Believed<'a> {
    /// The known queues [bit] at the end of `slot`, by id, and the known answers, if SNs may refuse.
    #[must_use]
    pub fn known(slot: u64, sensors: &'a Sensors, told: impl Into<Told<'a>>) -> Self {
        let Told { queues_bits, answers } = told.into();
        Self { slot, sensors, queues_bits, answers, belief: &Belief::Known }
    }

    /// What SN `id` is known to do when it is served in the next slot.
    #[inline]
    pub fn answer(&self, id: u32) -> Answer {
        self.answers.get(id as usize).copied().unwrap_or_default()
    }

    /// Bits that SN `id` samples per slot.
    #[inline]
    pub fn mean_bits(&self, id: u32) -> f64 {
        self.belief.mean_bits(self.sensors, id)
    }

    /// Slots until SN `id` overflows, or its bits expire: the room for what it stores divided by its bits per slot;
    /// `None` if it does not sample.
    #[inline]
    pub fn deadline_slots(&self, id: u32) -> Option<f64> {
        let sampler = self.sensors.sampler(id);
        let room_bits = f64::from(sampler.stored_bits()) - f64::from(self.queues_bits[id as usize]);
        let mean_bits = match self.belief {
            Belief::Known => sampler.mean_bits,
            Belief::Estimated(estimate) => estimate.mean_bits(id),
        };
        (mean_bits > 0.0).then(|| room_bits / mean_bits)
    }

    /// How uncertain the queue and the rate of SN `id` are.
    pub fn uncertainty(&self, id: u32) -> Uncertainty {
        let known = || Uncertainty::none(self.queues_bits[id as usize]);
        self.belief.estimate().map_or_else(known, |estimate| estimate.uncertainty(self.slot, id))
    }

    /// Standard deviation of the queue of SN `id` [bit]; 0 if it is known.
    pub fn queue_sd_bits(&self, id: u32) -> f64 {
        self.uncertainty(id).queue_sd_bits(self.sensors.sampler(id).capacity_bits)
    }

    /// Standard deviation of the bits that SN `id` samples per slot, as the UAV knows its rate; 0 if it is known.
    pub fn mean_sd_bits(&self, id: u32) -> f64 {
        uniform_sd(self.uncertainty(id).rate * self.mean_bits(id))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Overrides;
    use std::path::Path;

    #[test]
    fn the_uav_knows_the_prior_mean_of_learnt_rates_and_the_truth_of_known_ones() {
        let text = "name = 'x'\nslot_s = 0.5\n[sensors]\nsampling_bps = [50.0, 150.0]\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let node = |sampling_bps| SensorNode { sampling_bps, capacity_bits: 1_000, ..SensorNode::default() };
        let nodes = [60.0, 140.0, 0.0].map(node).to_vec();
        let sensors = Arc::new(Sensors::of(&scenario, &nodes));
        for (estimated, known_bps) in
            [(None, [60.0, 140.0, 0.0]), (Some(Rates::Known), [60.0, 140.0, 0.0]), (Some(Rates::Learnt), [100.0; 3])]
        {
            let belief = Belief::new(&scenario, &sensors, estimated);
            let known = belief.known_nodes(nodes.clone(), scenario.slot_s);
            assert_eq!(known, known_bps.map(node), "{estimated:?}");
            let known = belief.known_sensors(Arc::clone(&sensors));
            assert_eq!([0, 1, 2].map(|id| known.sampler(id).mean_bits / scenario.slot_s), known_bps);
            assert_eq!(known.sampler(1).capacity_bits, 1_000);
            let is_learnt = estimated == Some(Rates::Learnt);
            assert_eq!(belief.learnt_bps(scenario.slot_s).map(Vec::from_iter), is_learnt.then(|| vec![100.0; 3]));
        }
    }
}
