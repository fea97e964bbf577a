//! The rewards of an environment.

use crate::episode::Episode;
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
            // What the loss rate divides by is known in the last slot: with its reward, the mean is minus the loss rate.
            Self::LossFraction if episode.plant.is_over() => {
                let loss = fraction(after.lost as f64, counted_bits(episode));
                slots * (loss - fraction(before.lost as f64, episode.expected_bits))
            }
            Self::LossFraction => slots * fraction((after.lost - before.lost) as f64, episode.expected_bits),
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
