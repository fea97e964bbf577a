//! A sensor node of a plan, in slots instead of bits.

use skysink_common::arrivals::ArrivalLaw;

use crate::gap_costs::GapCosts;

/// A sensor node (SN) of a plan, in slots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorModel {
    /// Slots in which its empty buffer fills or its oldest bits expire, `C_i = min(B/(s_i τ), D + 1)`.
    pub fill_slots: f64,
    /// Bits sampled per slot, and lost per slot when full, `s_i τ`; above 0 unless ages count.
    pub mean_bits: f64,
    /// What a slot of overflow costs [bit]: `w_i s_i τ`, by the weight of its bits (decision D25).
    pub cost_bits: f64,
    /// That weight, `w_i`; 0 of a dead or silent sensor, for which no stop is added to a plan.
    pub weight: f64,
    /// Whether it is dead: stops for it are left out.
    pub is_dead: bool,
    /// Its buffer [bit].
    pub capacity_bits: f64,
    /// Whether a visit from any point in range empties even a full queue.
    pub is_emptied: bool,
    /// Bits of a visit from straight above [bit]; infinite if any visit empties the queue.
    pub best_bits: f64,
    /// Half-width of the uniform distribution of the queue before its first visit [slots of sampling]; 0 if known.
    pub initial_half_slots: f64,
    /// Half-width of the uniform distribution of the rate, as a fraction of its estimate; 0 if known.
    pub rate_half_fraction: f64,
    /// Queue after the last contact before the window [slots of sampling]; it does not depend on the rate.
    pub left_slots: f64,
    /// Estimated queue beyond the buffer [slots of sampling]; 0 if known.
    pub overdue_slots: f64,
    /// Three times the variance of what is sampled in a slot [slots² of sampling]; 0 for constant arrivals.
    pub noise_slots2: f64,
    /// Three times the variance of the queue before the window, if that is estimated.
    pub noise_before_slots2: f64,
    /// What its gaps cost, where ages count.
    pub costs: GapCosts,
}

impl SensorModel {
    /// Whether queue and rate are known.
    #[inline]
    pub fn is_known(&self) -> bool {
        self.initial_half_slots == 0.0 && self.rate_half_fraction == 0.0 && self.noise_slots2 == 0.0
    }

    /// Expected overflow [slots of sampling] at the end of `slot`, if the estimated queue was empty in the slot
    /// `empty`.
    ///
    /// The overflow is uniform within a half-width h of `late` slots, clamped to 0: its mean is `(late + h)²/4h` for
    /// `|late| < h`. The first visit, after slot 0, ends the uncertainty of the initial queue. Before it, `left_slots`
    /// are certain. Arrivals at random widen it by the uniform distribution with their variance.
    #[inline]
    pub fn overflow_slots(&self, slot: f64, empty: f64) -> f64 {
        let gap = slot - empty;
        let late = gap - self.fill_slots;
        let mut half = if empty <= 0.0 {
            self.rate_half_fraction * (gap - self.left_slots).max(0.0) + self.initial_half_slots
        } else {
            self.rate_half_fraction * gap
        };
        if self.noise_slots2 > 0.0 {
            let noise_slots2 = if empty <= 0.0 {
                self.noise_before_slots2 + self.noise_slots2 * slot
            } else {
                self.noise_slots2 * gap
            };
            half = (half * half + noise_slots2).sqrt();
        }
        if late >= half {
            late
        } else if late <= -half {
            0.0
        } else {
            (late + half) * (late + half) / (4.0 * half)
        }
    }
}

/// [`SensorModel::noise_slots2`] of a sensor that samples `mean_bits` [bit] per slot by `law`, as a mean over the
/// `fill_slots` in which it fills.
pub fn noise_slots2(law: ArrivalLaw, mean_bits: f64, fill_slots: f64) -> f64 {
    if law.is_random() && mean_bits > 0.0 {
        3.0 * law.variance_bits2(mean_bits, fill_slots) / (mean_bits * mean_bits * fill_slots)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrivals_at_random_have_the_variance_of_their_law_in_slots_of_sampling() {
        // Packets of 6 bit, 3 bit in a mean slot: 18 bit² in a slot are 2 slots², of which three times count.
        let packets = ArrivalLaw::Packets { packet_bits: 6.0 };
        assert_eq!(noise_slots2(packets, 3.0, 10.0), 6.0);
        assert_eq!(noise_slots2(packets, 0.0, 10.0), 0.0);
        assert_eq!(noise_slots2(ArrivalLaw::Constant, 2.0, 10.0), 0.0);
    }
}
