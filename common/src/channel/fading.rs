//! Fading of the power of a link: a gain `g`, drawn for every slot and sensor node (decision D27).
//!
//! With a dominant path of the share `K/(K + 1)` of the power (Rician; Rayleigh for `K = 0`),
//! `g = |√(K/(K+1)) + n/√(2(K+1))|²`, the parts of `n` standard normal, which has the mean 1. Behind obstacles
//! `g = 10^(σ n/10)` (log-normal shadowing), which has the median 1. Expected rates come from a table of
//! `E[log2(1 + γ g)]` over `ln γ`: the planner never uses the rate of the mean.

use std::collections::VecDeque;
use std::f64::consts::{LN_10, LOG2_E};
use std::fmt;
use std::ops::RangeInclusive;
use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use strum::VariantNames;

use crate::keys::{Accepts, Only};
use crate::random::{Purpose, Streams, normal_pair};
use crate::units::ratio_of_db;

/// Keys of Rician fading.
pub(crate) const ONLY: Only =
    Only { key: "fading", values: &["rician"], expected: Some("it only with fading = \"rician\"") };

/// Rician factors.
pub const K_DB: Accepts = Accepts::Number("-inf (Rayleigh), or -100 to 60 dB", |k_db| {
    k_db == f64::NEG_INFINITY || (-100.0..=60.0).contains(&k_db)
});

/// How the power of a link fades.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum FadingModel {
    /// A dominant path and many weak ones.
    Rician,
}

/// Standard deviations of shadowing.
pub(crate) const SHADOWING_DB: RangeInclusive<f64> = 0.0..=20.0;

/// Highest normal number of [`normal_pair`], `√(2 · 53 ln 2)`, rounded up.
const HIGHEST_NORMAL: f64 = 8.572;
/// Standard deviations that integrals extend to; beyond are 10^−18 of the draws.
const SPREADS: f64 = 9.0;
/// The table: `ln γ` of its first node, nodes for each unit of `ln γ`, and its last node (`γ` from 10^−6 to 10^13).
const FIRST_LN: f64 = -14.0;
const NODES_PER_LN: f64 = 16.0;
const LAST_NODE: usize = 44 * 16;
/// Arguments of the Bessel function from which its asymptotic series is used.
const LARGE: f64 = 500.0;
/// Steps in a mean over draws.
const STEPS: usize = 2_048;
/// Probability that the quadrature of the steps may have missed.
const QUADRATURE_MARGIN: f64 = 1e-9;

/// Tables that are kept, the newest ones: each takes thousands of integrals, and many channels have the same law.
const MOST_TABLES: usize = 64;

/// A law of fading.
#[derive(Clone)]
pub struct Fading {
    table: Arc<Table>,
}

impl PartialEq for Fading {
    fn eq(&self, other: &Self) -> bool {
        self.table.law == other.table.law
    }
}

impl fmt::Debug for Fading {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Fading({:?})", self.table.law)
    }
}

/// A gain of the power as a function that never falls of a number with a density.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Law {
    /// The square of a Rician amplitude, with the factor K.
    Rician(f64),
    /// `e^(σ n)` of a standard normal number.
    LogNormal(f64),
}

/// What is computed once for each law.
struct Table {
    law: Law,
    /// The mean of `g`.
    mean: f64,
    /// At each node `log2(1 + γ) − E[log2(1 + γ g)]`, and its slope by `ln γ`, of the gain relative to its mean.
    deficits: Vec<[f64; 2]>,
    /// Steps of `g`: the probability of each, and its upper end.
    steps: Vec<[f64; 2]>,
}

impl Law {
    /// Amplitude of the dominant path, and standard deviation of each part of the others.
    fn amplitudes(k: f64) -> [f64; 2] {
        [(k / (1.0 + k)).sqrt(), (0.5 / (1.0 + k)).sqrt()]
    }

    fn gain(self, number: f64) -> f64 {
        match self {
            Self::Rician(_) => number.powi(2),
            Self::LogNormal(sigma) => (sigma * number).exp(),
        }
    }

    /// The numbers that integrals extend over.
    fn range(self) -> [f64; 2] {
        match self {
            Self::Rician(k) => {
                let [dominant, spread] = Self::amplitudes(k);
                [(dominant - SPREADS * spread).max(0.0), dominant + SPREADS * spread]
            }
            Self::LogNormal(_) => [-SPREADS, SPREADS],
        }
    }

    /// The highest number that can be drawn.
    fn highest(self) -> f64 {
        match self {
            Self::Rician(k) => {
                let [dominant, spread] = Self::amplitudes(k);
                dominant + spread * HIGHEST_NORMAL
            }
            Self::LogNormal(_) => HIGHEST_NORMAL,
        }
    }

    /// Probability density of the number: of the amplitude `r = √g` (Rice), `r/s² e^{−(r−a)²/2s²} e^{−z} I0(z)`,
    /// `z = a r/s²`; or of a normal number.
    fn density(self, number: f64) -> f64 {
        let Self::Rician(k) = self else { return (-0.5 * number * number).exp() / std::f64::consts::TAU.sqrt() };
        let [dominant, spread] = Self::amplitudes(k);
        let variance = spread * spread;
        let away = (number - dominant) / spread;
        number / variance * (-0.5 * away * away).exp() * scaled_bessel(dominant * number / variance)
    }

    /// Nodes and weights of the trapezoid rule over `ln r`, as power gains; for integrands that are smooth in `ln r`
    /// the error falls exponentially with the number of nodes. Of normal numbers over themselves.
    fn weighted_gains(self) -> Vec<[f64; 2]> {
        let [lowest, highest] = self.range();
        let Self::Rician(k) = self else {
            let step = 1.0 / 16.0;
            let nodes = ((highest - lowest) / step) as u32;
            let number = |node: u32| lowest + step * f64::from(node);
            return (0..=nodes).map(|node| [self.gain(number(node)), self.density(number(node)) * step]).collect();
        };
        let [_, spread] = Self::amplitudes(k);
        let first = lowest.max(1e-9).ln();
        let last = highest.ln();
        let nodes = ((last - first) / (spread / 8.0).min(1.0 / 32.0)).ceil();
        let step = (last - first) / nodes;
        let weighted = |node: u32| {
            let amplitude = (first + step * f64::from(node)).exp();
            [amplitude * amplitude, self.density(amplitude) * amplitude * step]
        };
        (0..=nodes as u32).map(weighted).collect()
    }
}

impl Fading {
    /// Rician fading with the factor `k_db` [dB]; Rayleigh fading for −∞.
    #[must_use]
    pub fn rician(k_db: f64) -> Self {
        Self::of(Law::Rician(ratio_of_db(k_db)))
    }

    /// Log-normal shadowing with the standard deviation `sigma_db` [dB].
    #[must_use]
    pub fn log_normal(sigma_db: f64) -> Self {
        Self::of(Law::LogNormal(sigma_db * LN_10 / 10.0))
    }

    fn of(law: Law) -> Self {
        static TABLES: Mutex<VecDeque<Arc<Table>>> = Mutex::new(VecDeque::new());
        let mut tables = TABLES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(table) = tables.iter().find(|table| table.law == law) {
            return Self { table: Arc::clone(table) };
        }
        let table = Arc::new(Table::new(law));
        tables.truncate(MOST_TABLES - 1);
        tables.push_front(Arc::clone(&table));
        Self { table }
    }

    /// `E[log2(1 + γ g)]` [bit/s/Hz] of the signal-to-noise ratio `γ`, within 10^−6.
    pub fn mean(&self, snr: f64) -> f64 {
        let snr = self.table.mean * snr;
        (snr.ln_1p() * LOG2_E - self.table.deficit(snr)[0]).max(0.0)
    }

    /// Slope of [`Self::mean`] by `ln γ`.
    pub fn slope(&self, snr: f64) -> f64 {
        let snr = self.table.mean * snr;
        snr / (1.0 + snr) * LOG2_E - self.table.deficit(snr)[1]
    }

    /// The power gain of `sensor` in `slot`.
    pub fn draw(&self, streams: &Streams, slot: u64, sensor: u32) -> f64 {
        let [along, across] = normal_pair(&mut streams.stream(Purpose::Fading, slot, sensor));
        let Law::Rician(k) = self.table.law else { return self.table.law.gain(along) };
        let [dominant, spread] = Law::amplitudes(k);
        (dominant + spread * along).powi(2) + (spread * across).powi(2)
    }

    /// The highest power gain that can be drawn.
    pub fn highest(&self) -> f64 {
        self.table.law.gain(self.table.law.highest())
    }

    /// Mean of `value`, which never falls with the power gain: the value at the upper end of each of many steps, of
    /// `coarse` ones together.
    pub fn mean_of(&self, coarse: usize, value: impl Fn(f64) -> f64) -> f64 {
        let mean_of = |steps: &[[f64; 2]]| {
            let probability: f64 = steps.iter().map(|[probability, _]| probability).sum();
            if probability > 0.0 { probability * value(steps[steps.len() - 1][1]) } else { 0.0 }
        };
        self.table.steps.chunks(coarse).map(mean_of).sum::<f64>().min(value(self.highest()))
    }
}

impl Table {
    fn new(law: Law) -> Self {
        let mean = match law {
            Law::Rician(_) => 1.0,
            Law::LogNormal(sigma) => (0.5 * sigma * sigma).exp(),
        };
        let gains: Vec<[f64; 2]> = law.weighted_gains().iter().map(|[gain, weight]| [gain / mean, *weight]).collect();
        let deficits = (0..=LAST_NODE).map(|node| deficit(&gains, snr_of(node))).collect();
        Self { law, mean, deficits, steps: Self::steps(law) }
    }

    /// The steps of `g`, of the same width in the number, with a little more than all probability.
    fn steps(law: Law) -> Vec<[f64; 2]> {
        let [lowest, highest] = law.range();
        let width = (highest - lowest) / STEPS as f64;
        let end = |step: usize| lowest + width * step as f64;
        // Simpson's rule
        let probability = |step: usize| {
            let [low, middle, high] = [0.0, 0.5, 1.0].map(|part| law.density(end(step) + width * part));
            width / 6.0 * (low + 4.0 * middle + high)
        };
        let mut steps: Vec<[f64; 2]> = (0..STEPS).map(|step| [probability(step), law.gain(end(step + 1))]).collect();
        let left = 1.0 - steps.iter().map(|[probability, _]| probability).sum::<f64>();
        steps.push([left.max(0.0) + QUADRATURE_MARGIN, law.gain(law.highest().max(end(STEPS)))]);
        steps
    }

    /// The deficit at the ratio `snr` and its slope by `ln γ`, by cubic Hermite interpolation. Below the table it is
    /// proportional to `γ²`, above it is constant.
    fn deficit(&self, snr: f64) -> [f64; 2] {
        let place = (snr.ln() - FIRST_LN) * NODES_PER_LN;
        if place.is_nan() || place <= 0.0 {
            let deficit = self.deficits[0][0] * (snr / snr_of(0)).powi(2);
            return [deficit, 2.0 * deficit];
        }
        let node = place as usize;
        if node >= LAST_NODE {
            return [self.deficits[LAST_NODE][0], 0.0];
        }
        let x = place - node as f64;
        let [[from, slope_from], [to, slope_to]] = [self.deficits[node], self.deficits[node + 1]];
        let rise = to - from;
        let low = slope_from / NODES_PER_LN;
        let high = slope_to / NODES_PER_LN;
        let square = 3.0 * rise - 2.0 * low - high;
        let cube = low + high - 2.0 * rise;
        [from + x * (low + x * (square + x * cube)), (low + x * (2.0 * square + 3.0 * x * cube)) * NODES_PER_LN]
    }
}

fn snr_of(node: usize) -> f64 {
    (FIRST_LN + node as f64 / NODES_PER_LN).exp()
}

/// `log2(1 + γ) − E[log2(1 + γ g)]` and its slope by `ln γ`, over gains with their weights.
fn deficit(gains: &[[f64; 2]], snr: f64) -> [f64; 2] {
    let share = snr / (1.0 + snr);
    let value = |&[gain, weight]: &[f64; 2]| -weight * (share * (gain - 1.0)).ln_1p();
    let slope = |&[gain, weight]: &[f64; 2]| weight * share * (1.0 - gain) / (1.0 + snr * gain);
    [gains.iter().map(value).sum::<f64>() * LOG2_E, gains.iter().map(slope).sum::<f64>() * LOG2_E]
}

/// `e^{−z} I0(z)`, the mean of `e^{z (cos θ − 1)}` over all angles, by the trapezoid rule; for large `z` by its
/// asymptotic series, to 10^−11.
fn scaled_bessel(z: f64) -> f64 {
    if z > LARGE {
        let w = 1.0 / (8.0 * z);
        return (1.0 + w * (1.0 + w * (4.5 + w * 37.5))) / (std::f64::consts::TAU * z).sqrt();
    }
    let intervals = 16 + (5.0 * z.sqrt()).ceil() as u32;
    let at = |node: u32| (z * ((std::f64::consts::PI * f64::from(node) / f64::from(intervals)).cos() - 1.0)).exp();
    ((1..intervals).map(at).sum::<f64>() + 0.5 * (at(0) + at(intervals))) / f64::from(intervals)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Factors K [dB] of the tests.
    const FACTORS_DB: [f64; 4] = [f64::NEG_INFINITY, 0.0, 10.0, 20.0];

    /// Gains and their weights by another way than that of the table: with `J` a Poisson number of mean K, `(1 + K) g`
    /// is a Gamma number of the shape `J + 1`. The trapezoid rule over its logarithm.
    fn quadrature(k: f64) -> Vec<[f64; 2]> {
        const STEP: f64 = 1.0 / 64.0;
        let weighted = |step: i32| {
            let x = (f64::from(step) * STEP).exp();
            let mut term = (-k - x).exp();
            let mut density = term;
            for number in 1..600 {
                term *= k * x / f64::from(number).powi(2);
                density += term;
            }
            [x / (1.0 + k), density * x * STEP]
        };
        (-64 * 30..=64 * 6).map(weighted).collect()
    }

    #[test]
    fn the_expected_rate_agrees_with_quadrature() {
        for k_db in FACTORS_DB {
            let fading = Fading::rician(k_db);
            let gains = quadrature(ratio_of_db(k_db));
            for tenth in [-30, -17, -4, 3, 11, 24, 38, 51, 67, 90] {
                let snr = 10f64.powf(f64::from(tenth) / 10.0);
                let expected: f64 = gains.iter().map(|[gain, weight]| weight * (1.0 + snr * gain).log2()).sum();
                let found = fading.mean(snr);
                assert!((found - expected).abs() < 1e-6, "K = {k_db} dB, γ = {snr}: {found} and {expected}");
            }
        }
    }

    #[test]
    fn rayleigh_fading_loss_matches_the_closed_form() {
        // E[ln(1 + γ g)] = e^{1/γ} E1(1/γ). γ = 1: e · 0.219383934 = 0.596347362. γ → ∞: ln γ − 0.577215665.
        let rayleigh = Fading::rician(f64::NEG_INFINITY);
        assert!((rayleigh.mean(1.0) - 0.596_347_362 * LOG2_E).abs() < 1e-7, "{}", rayleigh.mean(1.0));
        let high = 1e9f64;
        assert!((rayleigh.mean(high) - (high.ln() - 0.577_215_665) * LOG2_E).abs() < 1e-6);
        assert_eq!((rayleigh.mean(0.0), rayleigh.slope(0.0)), (0.0, 0.0));
        assert!((Fading::rician(60.0).mean(100.0) - 101f64.log2()).abs() < 1e-5);
    }

    #[test]
    fn the_mean_rate_is_increasing_and_concave_with_the_right_derivative() {
        for k_db in [f64::NEG_INFINITY, 0.0, 10.0, 20.0, 45.0] {
            let fading = Fading::rician(k_db);
            let mut last = f64::INFINITY;
            for step in -400..=4_400 {
                let snr = (f64::from(step) / 100.0 - 7.0).exp();
                let numeric = (fading.mean(snr * 1.000_1) - fading.mean(snr / 1.000_1)) / (2.0 * 1.000_1f64.ln());
                assert!((fading.slope(snr) - numeric).abs() < 1e-6, "K = {k_db} dB, γ = {snr}");
                let slope = fading.slope(snr) / snr; // by γ
                assert!(slope > 0.0 && slope < last, "K = {k_db} dB, γ = {snr}: {slope} after {last}");
                last = slope;
            }
        }
    }

    #[test]
    fn series_and_asymptotic_bessel_functions_agree_at_the_switch() {
        // I0(z) e^{−z} falls by the factor 1 − 1/(2z) for each unit of z.
        let [below, above] = [LARGE - 1e-6, LARGE + 1e-6].map(scaled_bessel);
        assert!((above / below - 1.0 + 1e-6 / LARGE).abs() < 1e-10, "{below} {above}");
        // I0(1) = 1.266 065 877 752
        assert!((scaled_bessel(1.0) - 1.266_065_877_752 / std::f64::consts::E).abs() < 1e-12);
    }

    /// A million draws against their law: mean 1, variance `(1 + 2K)/(1 + K)²`, and Kolmogorov's test at 0.1 %.
    #[test]
    fn draws_follow_their_distribution() {
        const DRAWS: u32 = 1_000_000;
        for k_db in FACTORS_DB {
            let fading = Fading::rician(k_db);
            let streams = Streams::new(31);
            let mut gains: Vec<f64> =
                (0..DRAWS).map(|draw| fading.draw(&streams, u64::from(draw / 1_000), draw % 1_000)).collect();
            gains.sort_unstable_by(f64::total_cmp);
            assert!(gains[gains.len() - 1] <= fading.highest());
            let mean = gains.iter().sum::<f64>() / f64::from(DRAWS);
            let variance = gains.iter().map(|gain| (gain - 1.0).powi(2)).sum::<f64>() / f64::from(DRAWS);
            let k = ratio_of_db(k_db);
            let expected = (1.0 + 2.0 * k) / (1.0 + k).powi(2);
            assert!((mean - 1.0).abs() < 4e-3 && (variance / expected - 1.0).abs() < 1e-2, "{k_db}: {mean} {variance}");
            // The law by integration of the density of g = x² + y², over y for each of the draws' ranks.
            let mut below = 0.0;
            let mut at = 0.0;
            for (rank, gain) in (1..).zip(&gains) {
                let amplitude = gain.sqrt();
                let middle = fading.table.law.density(f64::midpoint(at, amplitude));
                below += (amplitude - at) * middle;
                at = amplitude;
                assert!((below - f64::from(rank) / f64::from(DRAWS)).abs() < 1.95e-3, "K = {k_db} dB, {gain}: {below}");
            }
            if k_db == f64::NEG_INFINITY {
                // 1 − e^{−g} in closed form
                let median = gains[gains.len() / 2];
                assert!((median - std::f64::consts::LN_2).abs() < 5e-3, "{median}");
            }
        }
    }

    /// A million draws: the levels are normal in dB with the standard deviation, and the mean rate is that of the
    /// table, which has its slope.
    #[test]
    fn shadowing_is_normal_in_decibels() {
        const DRAWS: u32 = 1_000_000;
        for sigma_db in [1.414, 8.0] {
            let shadowing = Fading::log_normal(sigma_db);
            let streams = Streams::new(5);
            let draw = |draw: u32| shadowing.draw(&streams, u64::from(draw / 1_000), draw % 1_000);
            let gains: Vec<f64> = (0..DRAWS).map(draw).collect();
            assert!(gains.iter().all(|gain| *gain <= shadowing.highest()));
            let mean =
                |value: &dyn Fn(f64) -> f64| gains.iter().map(|&gain| value(gain)).sum::<f64>() / f64::from(DRAWS);
            let db = |gain: f64| 10.0 * gain.log10();
            let [first, second] = [mean(&db), mean(&|gain| db(gain).powi(2))];
            assert!(first.abs() < 4e-3 * sigma_db && (second.sqrt() / sigma_db - 1.0).abs() < 3e-3, "{first} {second}");
            for snr in [0.01, 1.0, 30.0, 1e6] {
                let drawn = mean(&|gain| (1.0 + snr * gain).log2());
                let table = shadowing.mean(snr);
                assert!((drawn / table - 1.0).abs() < 0.02, "{sigma_db} dB, {snr}: {drawn}, not {table}");
                let numeric = (shadowing.mean(snr * 1.000_1) - shadowing.mean(snr / 1.000_1)) / (2.0 * 1.000_1f64.ln());
                assert!((shadowing.slope(snr) - numeric).abs() < 1e-5 * table.max(1.0), "{sigma_db} dB, {snr}");
                let steps = shadowing.mean_of(1, |gain| (1.0 + snr * gain).log2());
                assert!(
                    table <= steps * (1.0 + 1e-9) && steps < 1.03 * table,
                    "{sigma_db} dB, {snr}: {steps}, {table}"
                );
            }
        }
        // σ = 0 is no shadowing: log2(1 + γ).
        assert!((Fading::log_normal(0.0).mean(3.0) - 2.0).abs() < 1e-9);
    }

    #[test]
    fn the_stepwise_mean_is_an_upper_bound_near_the_mean() {
        for k_db in FACTORS_DB {
            let fading = Fading::rician(k_db);
            for snr in [0.1, 10.0, 1e4] {
                let [fine, coarse] = [1, 8].map(|coarse| fading.mean_of(coarse, |gain| (1.0 + snr * gain).log2()));
                let mean = fading.mean(snr);
                assert!(mean <= fine && fine < mean * 1.01 && fine <= coarse, "{k_db} {snr}: {mean} {fine} {coarse}");
            }
            assert_eq!(fading.mean_of(1, |_| 7.0), 7.0);
        }
    }
}
