//! What a mission comes to: the columns of a sweep's results. Definitions in `docs/metrics.md`.

use nalgebra::Point3;
use serde::Deserialize;
use skysink_common::message::FlightReport;
use skysink_common::scenario::{Propulsion, Scenario};
use skysink_mission::summary::Summary;
use strum::{EnumCount, IntoStaticStr, VariantArray};

use crate::optimize::LossBounds;
use crate::propulsion::power_w;

/// A column of the results, by its name there; defined in `docs/metrics.md`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, EnumCount, IntoStaticStr, VariantArray)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
#[allow(missing_docs)]
pub enum Metric {
    LossRate,
    EtaLetter,
    DeliveredBits,
    BitsPerWaypoint,
    MeanServed,
    FlownM,
    EnergyJ,
    AoiMeanS,
    #[strum(serialize = "aoi_p99_s")]
    AoiP99S,
    Jain,
    /// NaN unless a plan of `offline` was flown.
    LossBound,
    /// NaN unless a plan of `offline` was flown over a random channel.
    ExpectedLossBound,
    #[strum(serialize = "plan_p50_us")]
    PlanP50Us,
    #[strum(serialize = "plan_p99_us")]
    PlanP99Us,
}

/// The values of all metrics, in their order.
pub type MetricValues = [f64; Metric::COUNT];

impl Metric {
    /// Its column.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Whether it is a time of the wall clock, and different each time.
    pub fn is_timing(self) -> bool {
        matches!(self, Self::PlanP50Us | Self::PlanP99Us)
    }
}

/// Running sums of a mission.
#[derive(Debug, Clone)]
pub struct MissionSums {
    slot_s: f64,
    aircraft: Propulsion,
    position: Point3<f64>,
    flown_m: f64,
    energy_j: f64,
    slot: u64,
    /// Slot of each SN's last service, 0 before the first.
    last_service: Vec<u64>,
    ages: Ages,
}

impl MissionSums {
    /// Nothing flown yet.
    pub fn new(scenario: &Scenario, sensors: usize) -> Self {
        Self {
            slot_s: scenario.slot_s,
            aircraft: scenario.uav.propulsion,
            position: scenario.start(),
            flown_m: 0.0,
            energy_j: 0.0,
            slot: 0,
            last_service: vec![0; sensors],
            ages: Ages::default(),
        }
    }

    /// Adds the next slot.
    ///
    /// # Panics
    /// If it serves a sensor node that the mission does not have.
    pub fn add(&mut self, flight: &FlightReport) {
        self.slot += 1;
        let position = flight.position();
        let step_m = (position - self.position).norm();
        self.position = position;
        self.flown_m += step_m;
        self.energy_j += power_w(&self.aircraft, step_m / self.slot_s) * self.slot_s;
        for link in flight.served_links() {
            let last = &mut self.last_service[link.sensor as usize];
            self.ages.add_gap(self.slot - *last - 1);
            self.ages.zeros += 1;
            *last = self.slot;
        }
    }

    /// The metrics of a mission that comes to `summary`; `delivered_bits` by sensor node.
    pub fn values(&self, summary: &Summary, delivered_bits: &[u64], bounds: Option<LossBounds>) -> MetricValues {
        let mut ages = self.ages.clone();
        for last in &self.last_service {
            ages.add_gap(self.slot - last);
        }
        let mut values = [0.0; Metric::COUNT];
        for (value, metric) in values.iter_mut().zip(Metric::VARIANTS) {
            *value = match metric {
                Metric::LossRate => summary.loss_rate,
                Metric::EtaLetter => summary.eta_letter,
                Metric::DeliveredBits => summary.totals.delivered_bits as f64, // exact below 2^53
                Metric::BitsPerWaypoint => summary.bits_per_waypoint,
                Metric::MeanServed => summary.mean_served,
                Metric::FlownM => self.flown_m,
                Metric::EnergyJ => self.energy_j,
                Metric::AoiMeanS => ages.mean() * self.slot_s,
                Metric::AoiP99S => ages.quantile(0.99) as f64 * self.slot_s,
                Metric::Jain => jain(delivered_bits),
                Metric::LossBound => bounds.map_or(f64::NAN, |bounds| bounds.loss_bound),
                Metric::ExpectedLossBound => bounds.and_then(|bounds| bounds.expected_loss_bound).unwrap_or(f64::NAN),
                Metric::PlanP50Us => summary.timing.plan_p50_us,
                Metric::PlanP99Us => summary.timing.plan_p99_us,
            };
        }
        values
    }
}

/// Ages in slots, counted: a gap of g slots without service holds the ages 1, 2, ..., g.
#[derive(Debug, Clone, Default)]
struct Ages {
    zeros: u64,
    /// By g: how many gaps of g slots.
    gaps: Vec<u64>,
}

impl Ages {
    fn add_gap(&mut self, slots: u64) {
        let slots = usize::try_from(slots).expect("a mission that fits in memory");
        if self.gaps.len() <= slots {
            self.gaps.resize(slots + 1, 0);
        }
        self.gaps[slots] += 1;
    }

    /// How many samples have each age: age a occurs once in every gap of at least a slots.
    fn counts(&self) -> Vec<u64> {
        let mut counts = vec![0; self.gaps.len().max(1)];
        let mut longer = 0;
        for age in (1..self.gaps.len()).rev() {
            longer += self.gaps[age];
            counts[age] = longer;
        }
        counts[0] = self.zeros;
        counts
    }

    fn mean(&self) -> f64 {
        let counts = self.counts();
        let samples: u64 = counts.iter().sum();
        let sum: u64 = (0..).zip(&counts).map(|(age, count): (u64, _)| age * count).sum();
        if samples == 0 { 0.0 } else { sum as f64 / samples as f64 }
    }

    /// The least age that is not exceeded by a fraction `q` of the samples (nearest rank).
    fn quantile(&self, q: f64) -> u64 {
        let counts = self.counts();
        let rank = (q * counts.iter().sum::<u64>() as f64).ceil() as u64;
        let mut seen = 0;
        for (age, count) in (0..).zip(&counts) {
            seen += count;
            if seen >= rank {
                return age;
            }
        }
        0
    }
}

/// Jain's fairness index, `(Σ x)² / (N Σ x²)`; 1 if nothing was delivered.
fn jain(values: &[u64]) -> f64 {
    let sum: f64 = values.iter().map(|&value| value as f64).sum();
    let squares: f64 = values.iter().map(|&value| (value as f64).powi(2)).sum();
    if squares > 0.0 { sum * sum / (values.len() as f64 * squares) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::{LinkReport, Mode};
    use skysink_common::scenario::Overrides;

    /// A flight to x [m] on the line y = 50 m that serves these SNs.
    fn flight(x_m: f64, served: &[u32]) -> FlightReport {
        let mut report = FlightReport::at([x_m, 50.0, 20.0], Mode::Serve);
        for (link, &sensor) in report.links.iter_mut().zip(served) {
            *link = LinkReport { sensor, ..LinkReport::default() };
        }
        report.served = u32::try_from(served.len()).unwrap();
        report
    }

    fn values<const N: usize>(sums: &MissionSums, metrics: [Metric; N]) -> [f64; N] {
        let values = sums.values(&Summary::default(), &[], None);
        metrics.map(|metric| values[metric as usize])
    }

    #[test]
    fn columns_have_the_names_of_the_documentation() {
        let names: Vec<&str> = Metric::VARIANTS.iter().map(|metric| metric.name()).collect();
        let expected = "loss_rate eta_letter delivered_bits bits_per_waypoint mean_served flown_m energy_j aoi_mean_s \
                        aoi_p99_s jain loss_bound expected_loss_bound plan_p50_us plan_p99_us";
        assert_eq!(names.join(" "), expected);
    }

    #[test]
    fn ages_count_slots_since_the_last_service() {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let mut metrics = MissionSums::new(&scenario, 2);
        for served in [&[][..], &[0], &[], &[0, 1]] {
            metrics.add(&flight(50.0, served));
        }
        // Ages after slots 1 to 4: SN 0: 1, 0, 1, 0; SN 1: 1, 2, 3, 0. Mean 8/8; the 99th percentile is the largest.
        assert_eq!(values(&metrics, [Metric::AoiMeanS, Metric::AoiP99S]), [1.0, 3.0]);
    }

    #[test]
    fn ages_agree_with_counting_one_by_one() {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let mut metrics = MissionSums::new(&scenario, 7);
        let (mut last, mut ages) = ([0u64; 7], Vec::new());
        for slot in 1..=300u64 {
            let served: Vec<u32> = (0..7).filter(|&sn| (slot * 31 + u64::from(sn) * 17) % 23 < 3).collect();
            metrics.add(&flight(50.0, &served));
            served.iter().for_each(|&sn| last[sn as usize] = slot);
            ages.extend(last.iter().map(|last| slot - last));
        }
        ages.sort_unstable();
        let mean = ages.iter().sum::<u64>() as f64 / ages.len() as f64;
        let p99 = ages[(ages.len() * 99).div_ceil(100) - 1] as f64;
        assert_eq!(values(&metrics, [Metric::AoiMeanS, Metric::AoiP99S]), [mean, p99]);
    }

    #[test]
    fn hovering_costs_energy_and_no_distance() {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let mut metrics = MissionSums::new(&scenario, 1);
        metrics.add(&flight(50.0, &[]));
        let [hover_m, hover_j] = values(&metrics, [Metric::FlownM, Metric::EnergyJ]);
        assert!((hover_j - 168.49).abs() < 1e-9);
        metrics.add(&flight(60.0, &[]));
        let [flown_m, flown_j] = values(&metrics, [Metric::FlownM, Metric::EnergyJ]);
        assert_eq!((hover_m, flown_m), (0.0, 10.0));
        assert!((flown_j - hover_j - power_w(&scenario.uav.propulsion, 10.0)).abs() < 1e-9);
    }

    #[test]
    fn fairness_is_one_for_equals_and_one_over_n_for_one_alone() {
        assert_eq!(jain(&[5, 5, 5, 5]), 1.0);
        assert_eq!(jain(&[8, 0, 0, 0]), 0.25);
        assert_eq!(jain(&[1, 2, 3]), 36.0 / 42.0);
    }
}
