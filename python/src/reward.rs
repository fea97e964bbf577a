//! The rewards of an environment.

use skysink_common::geometry::within;
use skysink_common::ledger::Totals;
use skysink_common::message::{Mode, Plan};
use skysink_common::slot_record::Plans;

use crate::episode::{Episode, Outcome};
use crate::rules::Reward;

impl Reward {
    /// The reward of the last slot of `episode`, before which these were the totals, and the weighted bits.
    pub fn of(self, episode: &Episode, before: &Totals, weighted: [f64; 2]) -> f64 {
        let after = episode.plant.header().totals;
        let lost_bits = (after.lost_bits - before.lost_bits) as f64;
        let slots = episode.field.limits.slots as f64;
        match self {
            Self::Lost => fraction(lost_bits, (after.sampled_bits - before.sampled_bits) as f64),
            Self::Weighted => {
                let [sampled, lost] = Self::weighted_bits(episode);
                fraction(lost - weighted[1], sampled - weighted[0])
            }
            Self::Age => {
                let ages_slots: u64 = episode.contacts.ages_slots(episode.plant.slot()).sum();
                -(ages_slots as f64 / episode.field.count() as f64)
            }
            // What the loss rate divides by is known in the last slot: with its reward, the mean is minus the loss
            // rate.
            Self::LossFraction if episode.plant.is_over() => {
                // On average (decision D3), or as sampled, if arrivals are at random (decision D24).
                let sampled_bits =
                    if episode.has_random_arrivals { after.sampled_bits as f64 } else { episode.expected_bits };
                let loss = fraction(after.lost_bits as f64, sampled_bits);
                slots * (loss - fraction(before.lost_bits as f64, episode.expected_bits))
            }
            Self::LossFraction => slots * fraction(lost_bits, episode.expected_bits),
            Self::Difference => 0.0, // each agent has its own
        }
    }

    /// Sampled and lost bits up to the last slot of `episode`, times the weights of their sensor nodes, if the reward
    /// is weighted.
    pub fn weighted_bits(episode: &Episode) -> [f64; 2] {
        let field = episode.plant.field();
        let weights = &episode.weights;
        let sampled = weights.iter().enumerate().map(|(id, weight)| weight * field.sampled_bits(id) as f64).sum();
        let lost = weights.iter().zip(field.lost_bits()).map(|(weight, lost)| weight * lost as f64).sum();
        [sampled, lost]
    }
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
        let sensor = episode.field.sensors.position(id);
        let radius_m = episode.field.limits.comm_radius_m;
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
