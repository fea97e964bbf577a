//! The draws of the arrival models against their laws.

use statrs::distribution::{DiscreteCDF, Poisson as PoissonLaw};

use super::*;

/// Number of draws of a test.
const DRAWS: usize = 1_000_000;

/// Critical value of the test of Kolmogorov and Smirnov at 1 %.
fn critical() -> f64 {
    1.628 / (DRAWS as f64).sqrt()
}

/// The largest distance of the distribution of `bits`, which are multiples of `packet_bits`, from `cumulative` of
/// packets.
fn distance(bits: impl Iterator<Item = u64>, packet_bits: u64, cumulative: impl Fn(u64) -> f64) -> f64 {
    let mut counts = std::collections::BTreeMap::new();
    for bits in bits {
        assert_eq!(bits % packet_bits, 0);
        *counts.entry(bits / packet_bits).or_insert(0usize) += 1;
    }
    let mut below = 0;
    let distances = counts.into_iter().map(|(packets, count)| {
        below += count;
        (below as f64 / DRAWS as f64 - cumulative(packets)).abs()
    });
    distances.fold(0.0, f64::max)
}

/// Mean and variance.
fn moments(values: impl Iterator<Item = f64> + Clone) -> [f64; 2] {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    [mean, values.map(|value| (value - mean).powi(2)).sum::<f64>() / count]
}

#[test]
fn packet_counts_are_poisson_in_every_slot() {
    for (mean_bits, packet_bits) in [(100.0, 1.0), (100.0, 50.0), (3.5, 7.0), (0.02, 1.0)] {
        let arrivals = Poisson::new(packet_bits, Streams::new(3));
        let draws: Vec<u64> =
            (0..DRAWS).map(|draw| arrivals.bits(1 + draw as u64 / 1_000, draw as u32 % 1_000, mean_bits)).collect();
        let law = PoissonLaw::new(mean_bits / packet_bits).unwrap();
        let distance = distance(draws.iter().copied(), packet_bits as u64, |packets| law.cdf(packets));
        assert!(distance < critical(), "{distance} at a mean of {mean_bits} bit in packets of {packet_bits}");
        let [mean, variance] = moments(draws.iter().map(|&bits| bits as f64));
        let law = ArrivalLaw::Packets { packet_bits };
        let error = (law.variance_bits2(mean_bits, 1.0) / DRAWS as f64).sqrt();
        assert!((mean - mean_bits).abs() < 4.0 * error, "{mean}");
        assert!((variance / law.variance_bits2(mean_bits, 1.0) - 1.0).abs() < 0.02, "{variance}");
    }
    assert_eq!(Poisson::new(1.0, Streams::new(3)).bits(1, 0, 0.0), 0, "an SN that does not sample");
}

/// On-off chains with mean times of 5 and 15 slots: 1 000 SNs over 1 000 slots.
fn chains() -> (OnOff, ArrivalLaw) {
    let law = ArrivalLaw::OnOff { on_slots: 5.0, off_slots: 15.0 };
    (OnOff::new([5.0, 15.0], Streams::new(9), 1_000, 1..1_001), law)
}

#[test]
fn on_off_bits_have_the_moments_and_autocorrelation_of_the_markov_chain() {
    let (arrivals, law) = chains();
    let bits = |sensor: u32, slot: u64| arrivals.bits(slot, sensor, 10.0) as f64;
    // On, 40 bit a slot, a quarter of the time.
    let all = || (0..1_000).flat_map(|sensor| (1..=1_000).map(move |slot| (sensor, slot)));
    assert!(all().all(|(sensor, slot)| [0.0, 40.0].contains(&bits(sensor, slot))));
    let draws: Vec<f64> = all().map(|(sensor, slot)| bits(sensor, slot)).collect();
    let [mean, variance] = moments(draws.iter().copied());
    // The variance of the mean is that of many slots: dispersion · mean / slots.
    let error = (law.dispersion_bits(10.0) * 10.0 / DRAWS as f64).sqrt();
    assert!((mean - 10.0).abs() < 4.0 * error, "{mean}, error {error}");
    assert!((variance / 300.0 - 1.0).abs() < 0.02, "{variance}");
    for lag in [1, 2, 5, 10, 30] {
        let pairs = (0..1_000).flat_map(|sensor| (1..=1_000 - lag).map(move |slot| (sensor, slot)));
        let products = pairs.map(|(sensor, slot)| (bits(sensor, slot) - 10.0) * (bits(sensor, slot + lag) - 10.0));
        let correlation = products.sum::<f64>() / (1_000.0 * (1_000 - lag) as f64) / 300.0;
        let expected = (1.0f64 - 1.0 / 5.0 - 1.0 / 15.0).powi(lag as i32);
        assert!((correlation - expected).abs() < 0.01, "{correlation} instead of {expected} at lag {lag}");
    }
    for slots in [1, 4, 20, 100] {
        let sums = (0..1_000)
            .flat_map(|sensor| (0..1_000 / slots).map(move |part| (part * slots + 1..=(part + 1) * slots, sensor)));
        let sums: Vec<f64> = sums.map(|(slots, sensor)| slots.map(|slot| bits(sensor, slot)).sum()).collect();
        let [_, variance] = moments(sums.iter().copied());
        let expected = law.variance_bits2(10.0, slots as f64);
        assert!((variance / expected - 1.0).abs() < 0.08, "{variance} instead of {expected} over {slots} slots");
    }
}

#[test]
fn arrivals_of_a_shorter_mission_begin_those_of_a_longer_one() {
    for law in [ArrivalLaw::OnOff { on_slots: 2.0, off_slots: 3.0 }, ArrivalLaw::Packets { packet_bits: 5.0 }] {
        let [short, long] = [50, 80].map(|slots| Arrivals::of(law, None, Streams::new(9), 100, slots).unwrap());
        for (sensor, slot) in (0..100).flat_map(|sensor| (1..=50).map(move |slot| (sensor, slot))) {
            assert_eq!(short.bits(slot, sensor, 10.0), long.bits(slot, sensor, 10.0), "SN {sensor}, slot {slot}");
        }
    }
    assert!(Arrivals::of(ArrivalLaw::Constant, None, Streams::new(9), 100, 50).is_none());
}

#[test]
fn on_and_off_times_are_exponential_with_their_means() {
    let (arrivals, _) = chains();
    for (is_on, mean) in [(true, 5.0), (false, 15.0)] {
        let mut lasted = Vec::new();
        for sensor in 0..1_000 {
            let on: Vec<bool> = (1..=1_000).map(|slot| arrivals.bits(slot, sensor, 10.0) > 0).collect();
            let runs: Vec<usize> =
                on.chunk_by(|a, b| a == b).filter(|run| run[0] == is_on).map(<[bool]>::len).collect();
            lasted.extend(runs.iter().skip(1).rev().skip(1).map(|&run| run as f64)); // whole ones
        }
        let [found, variance] = moments(lasted.iter().copied());
        assert!((found / mean - 1.0).abs() < 0.03, "{found}");
        assert!((variance / (mean * (mean - 1.0)) - 1.0).abs() < 0.1, "{variance}"); // geometric
    }
    let on = (0..1_000).filter(|&sensor| arrivals.bits(1, sensor, 10.0) > 0).count();
    assert!((200..=300).contains(&on), "{on} of 1000 begin on: a quarter");
}

#[test]
fn on_and_off_times_alternate_within_a_slot() {
    let arrivals = OnOff::new([1.0, 1.0], Streams::new(1), 4, 1..100);
    for sensor in 0..4 {
        assert!((1..99).all(|slot| arrivals.bits(slot, sensor, 3.0) + arrivals.bits(slot + 1, sensor, 3.0) == 6));
    }
}

#[test]
fn times_longer_than_any_mission_do_not_end() {
    let arrivals = OnOff::new([1e300, 1e300], Streams::new(1), 50, 1..1_000_000_000);
    let is_on = |sensor: u32| [1, 7, 999_999_998].map(|slot| arrivals.bits(slot, sensor, 10.0));
    let on = (0..50).filter(|&sensor| is_on(sensor) == [20; 3]).count();
    let off = (0..50).filter(|&sensor| is_on(sensor) == [0; 3]).count();
    assert!(on + off == 50 && on > 10 && off > 10, "{on} on, {off} off");
}

#[test]
fn draws_are_independent_of_each_other() {
    let streams = Streams::new(5);
    let drawn: [Arrivals; 2] =
        [Poisson::new(2.0, streams).into(), OnOff::new([3.0, 4.0], streams, 3_000, 1..400).into()];
    for arrivals in drawn {
        let mut bits = [0; 2_000];
        arrivals.fill(77, 1_000..3_000, &PerSensor::Equal(9.5), &mut bits);
        for sensor in [1_000, 1_001, 2_999] {
            assert_eq!(bits[sensor - 1_000], arrivals.bits(77, sensor as u32, 9.5));
        }
    }
    // A mission that is longer begins in the same way.
    let [short, long] = [100, 5_000].map(|slots| OnOff::new([3.0, 4.0], streams, 10, 1..slots));
    assert!((1..99).all(|slot| (0..10).all(|sensor| short.bits(slot, sensor, 9.5) == long.bits(slot, sensor, 9.5))));
}
