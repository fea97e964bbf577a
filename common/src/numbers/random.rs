//! Counter-based random numbers: one stream per (seed, purpose, slot, sensor node).
//!
//! The generator is ChaCha8 with these four numbers as its key. The order of calls, threads, processes and restarts
//! cannot change a draw.

use std::f64::consts::PI;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Purpose of a stream. The numbers are part of the results: never change or reuse one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// Position of a sensor node.
    Position = 1,
    /// Initial queue of a sensor node.
    InitialQueue = 2,
    /// Reference channel gain of a sensor node, for the mission (slot 0) or for a slot.
    Gain = 3,
    /// Waypoint of the random flight strategy in a slot.
    RandomFlight = 4,
    /// Whether the link of a sensor node is in line of sight in a slot.
    LineOfSight = 5,
    /// Search of the look-ahead strategy in a slot.
    Horizon = 6,
    /// Search of the look-ahead strategy for groups of sensor nodes, before the mission.
    Groups = 7,
    /// Sampling rate of a sensor node.
    SamplingRate = 8,
    /// Mean of the initial queue of a sensor node.
    InitialQueueMean = 9,
    /// Fading of the link of a sensor node in a slot.
    Fading = 11,
    /// A wave of the line of sight that stays for the mission.
    FrozenLineOfSight = 12,
    /// Rate of a link in a slot, from a table.
    TableDraw = 13,
    /// Where a slot really ends.
    PositionError = 14,
    /// Buffer of a sensor node.
    Capacity = 15,
    /// Bits that a sensor node samples in a slot, or its times on and off (slot 0).
    Arrivals = 16,
    /// Search for a round over disks.
    Round = 17,
    /// Search for a plan that delivers most.
    Collect = 18,
    /// Residual of the link of a sensor node in a slot, about a map.
    LinkResidual = 19,
    /// Seed of a simulated mission, in a comparison of strategies.
    Comparison = 20,
}

/// The family of streams of one mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Streams {
    seed: u64,
}

impl Streams {
    /// The streams of a mission's seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// The stream for `purpose` in `slot` (0 before the first) of `sensor` (0 if there is none), from its start.
    pub fn stream(&self, purpose: Purpose, slot: u64, sensor: u32) -> ChaCha8Rng {
        let mut key = [0; 32];
        let words = [self.seed, purpose as u64, slot, u64::from(sensor)];
        for (bytes, word) in key.chunks_exact_mut(8).zip(words) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        ChaCha8Rng::from_seed(key)
    }
}

/// A random number below `count`, which is at least 1 and below 2^32, from one 32-bit word of the stream.
#[inline]
#[must_use]
pub fn below(random: &mut ChaCha8Rng, count: usize) -> usize {
    ((u64::from(random.next_u32()) * count as u64) >> 32) as usize
}

/// A random fraction in (0, 1], from one word as well.
#[inline]
#[must_use]
pub fn fraction(random: &mut ChaCha8Rng) -> f64 {
    (f64::from(random.next_u32()) + 1.0) / 4_294_967_296.0
}

/// Probability that a standard normal number is below `x`, by its series (Marsaglia, 2004); exact to 10^−14.
#[must_use]
pub fn normal_cdf(x: f64) -> f64 {
    if x.abs() > 7.0 {
        return if x > 0.0 { 1.0 } else { 0.0 };
    }
    let mut term = x;
    let mut sum = x;
    let mut power = 1.0;
    while term.abs() > 1e-17 {
        power += 2.0;
        term *= x * x / power;
        sum += term;
    }
    0.5 + sum * (-0.5 * x * x).exp() / (2.0 * PI).sqrt()
}

/// Two independent standard normal numbers (Box and Muller), none beyond `√(2 · 53 ln 2)`.
#[must_use]
pub fn normal_pair(random: &mut ChaCha8Rng) -> [f64; 2] {
    let [above_zero, turn] = [1.0, 0.0].map(|least| ((random.next_u64() >> 11) as f64 + least) / (1u64 << 53) as f64);
    let radius = (-2.0 * above_zero.ln()).sqrt();
    let (sine, cosine) = (std::f64::consts::TAU * turn).sin_cos();
    [radius * cosine, radius * sine]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, RngExt};

    #[test]
    fn a_draw_depends_only_on_its_coordinates() {
        let streams = Streams::new(7);
        let first = streams.stream(Purpose::Gain, 3, 5).next_u64();
        let _ = streams.stream(Purpose::Gain, 3, 4).random::<[f64; 4]>();
        assert_eq!(streams.stream(Purpose::Gain, 3, 5).next_u64(), first);
        for other in [
            streams.stream(Purpose::Position, 3, 5),
            streams.stream(Purpose::Gain, 2, 5),
            streams.stream(Purpose::Gain, 3, 4),
            Streams::new(8).stream(Purpose::Gain, 3, 5),
        ] {
            let mut other = other;
            assert_ne!(other.next_u64(), first);
        }
    }

    /// A golden sequence: seeded results of published missions depend on these numbers.
    #[test]
    fn random_streams_are_stable() {
        let mut stream = Streams::new(1).stream(Purpose::Position, 0, 0);
        assert_eq!([stream.next_u64(), stream.next_u64()], [4_344_717_217_939_160_907, 15_305_578_173_110_765_368]);
    }
}
