//! The rewards of an environment.

use skysink_common::geometry::within;
use skysink_common::message::{Mode, Plan};
use skysink_common::slot_record::Plans;

use crate::episode::{Episode, Outcome};
use crate::rules::Reward;

/// Bits since the mission's start.
#[derive(Clone, Copy)]
pub struct Bits {
    sampled: u64,
    lost: u64,
    /// Sampled and lost bits times the weights of their sensor nodes, if the reward is weighted.
    weighted: [f64; 2],
}

impl Reward {
    /// Bits up to the last slot of `episode`.
    pub fn bits(self, episode: &Episode) -> Bits {
        let totals = episode.plant.header().totals;
        let weighted = if self == Self::Weighted { weighted_bits(episode) } else { [0.0; 2] };
        Bits { sampled: totals.sampled_bits, lost: totals.lost_bits, weighted }
    }

    /// The reward of the last slot of `episode`, before which the bits were `before`.
    pub fn of(self, episode: &Episode, before: Bits) -> f64 {
        let after = self.bits(episode);
        let slots = episode.field.limits.slots as f64;
        match self {
            Self::Lost => fraction((after.lost - before.lost) as f64, (after.sampled - before.sampled) as f64),
            Self::Weighted => {
                let [sampled, lost] = [0, 1].map(|of| after.weighted[of] - before.weighted[of]);
                fraction(lost, sampled)
            }
            Self::Age => {
                let ages_slots: u64 = episode.contacts.ages_slots(episode.plant.slot()).sum();
                -(ages_slots as f64 / episode.field.count() as f64)
            }
            // What the loss rate divides by is known in the last slot: with its reward, the mean is minus the loss
            // rate.
            Self::LossFraction if episode.plant.is_over() => {
                let loss = fraction(after.lost as f64, counted_bits(episode));
                slots * (loss - fraction(before.lost as f64, episode.expected_bits))
            }
            Self::LossFraction => slots * fraction((after.lost - before.lost) as f64, episode.expected_bits),
            Self::Difference => 0.0, // each agent has its own
        }
    }
}

/// What the loss rate of the mission of `episode` divides by [bit]: the bits sampled on average (decision D3), or those
/// sampled, if arrivals are at random (decision D24).
fn counted_bits(episode: &Episode) -> f64 {
    if episode.has_random_arrivals { episode.plant.header().totals.sampled_bits as f64 } else { episode.expected_bits }
}

/// Sampled and lost bits up to the last slot of `episode`, times the weights of their sensor nodes.
fn weighted_bits(episode: &Episode) -> [f64; 2] {
    let field = episode.plant.field();
    let weights = &episode.weights;
    let sampled = weights.iter().enumerate().map(|(id, weight)| weight * field.sampled_bits(id) as f64).sum();
    let lost = weights.iter().zip(field.lost_bits()).map(|(weight, lost)| weight * lost as f64).sum();
    [sampled, lost]
}

/// Minus `lost` as a fraction of `sampled`; 0 if nothing was sampled.
fn fraction(lost: f64, sampled: f64) -> f64 {
    if sampled > 0.0 { -(lost / sampled) } else { 0.0 }
}

/// Flies the next slot of `episode`, and writes the difference reward of each UAV: the bits that are delivered because
/// of it, as a fraction of the mean bits that are sampled in a slot. What another UAV would have collected in its place
/// does not count.
pub fn differences(episode: &mut Episode, plans: &Plans, rewards: &mut [f32]) -> Outcome {
    let delivered_bits = |episode: &Episode, id: u32| episode.plant.field().delivered_bits()[id as usize];
    let scheduled = |plan: &Option<Plan>| plan.as_ref().map_or(&[][..], |plan| plan.scheduled()).to_vec();
    let ids: Vec<Vec<u32>> = plans.iter().map(scheduled).collect();
    let before: Vec<Vec<u64>> =
        ids.iter().map(|ids| ids.iter().map(|&id| delivered_bits(episode, id)).collect()).collect();
    let outcome = episode.fly(plans);
    let slot_bits = (episode.expected_bits / episode.field.limits.slots as f64).max(f64::MIN_POSITIVE);
    let reaches = |uav: usize, id: u32| {
        let flight = episode.plant.flight(uav);
        let serves = !matches!(flight.flown_mode(), Mode::Hold | Mode::Charge | Mode::Down);
        let (sensor, radius_m) = (episode.field.sensors.position(id), episode.field.limits.comm_radius_m);
        serves && ids[uav].contains(&id) && within(sensor, &flight.position().xy(), radius_m)
    };
    for (uav, reward) in rewards.iter_mut().enumerate() {
        let own = ids[uav].iter().zip(&before[uav]).filter(|(id, _)| {
            let is_served = episode.plant.flight(uav).serves(**id);
            is_served && !(0..ids.len()).any(|other| other != uav && reaches(other, **id))
        });
        let bits: u64 = own.map(|(id, before)| delivered_bits(episode, *id) - before).sum();
        *reward = (bits as f64 / slot_bits) as f32;
    }
    outcome
}
