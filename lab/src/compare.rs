//! Compares strategies over the same fields, or finished runs.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;
use skysink_mission::Replay;
use strum::VariantArray;

use crate::error::LabError;
use crate::statistics::{Concentration, MeanInterval, holm, paired_differences};
use crate::sweep::definition::Definition;
use crate::sweep::journal::{MissionRows, missions_of};
use crate::unflown::UnflownFlights;
use skysink_mission::meter::MissionMeter;
use skysink_mission::metrics::{Metric, MetricValues};

/// A strategy over several fields, or a run, in a comparison.
#[derive(Debug, Clone)]
pub struct Contender {
    /// The strategy, or the run folder.
    pub label: String,
    missions: BTreeMap<u64, MetricValues>,
}

/// One metric of one contender.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MetricStanding {
    /// The contender.
    pub label: String,
    /// The metric, as in `docs/src/metrics.md`.
    pub metric: &'static str,
    /// Number of missions.
    pub n: usize,
    /// Mean over the missions.
    pub mean: f64,
    /// Limits of the 95 % confidence interval of the mean; `None` for a single mission.
    pub ci95: Option<[f64; 2]>,
    /// Mean difference to the first contender, paired by seed; `None` for the first, or without a common seed.
    pub difference: Option<f64>,
    /// Limits of the 95 % confidence interval of the difference.
    pub difference_ci95: Option<[f64; 2]>,
    /// The p-value of the paired test that the difference is 0.
    pub difference_p: Option<f64>,
    /// The p-value, adjusted for the number of differences of this metric by Holm's method.
    pub difference_p_holm: Option<f64>,
    /// By how few missions the mean is determined.
    #[serde(flatten)]
    pub concentration: Concentration,
}

impl Contender {
    /// The strategies of a sweep with one point.
    #[must_use]
    pub fn of_sweep(definition: &Definition, rows: &MissionRows) -> Vec<Self> {
        let missions = |index| missions_of(rows, 0, index).map(|row| (row.key.seed, row.values)).collect();
        let strategies = definition.strategies.iter().enumerate();
        strategies.map(|(index, strategy)| Self { label: strategy.clone(), missions: missions(index) }).collect()
    }

    /// A finished run, from its trace. The planning times are taken from its summary.
    ///
    /// # Errors
    /// If the folder is not a run folder or was changed, the run ended early, or on a stop.
    pub fn of_run(folder: &Path, label: &str, stop: &Stop) -> Result<Self, LabError> {
        let mut replay = Replay::open(folder)?;
        let mut meter = MissionMeter::new(replay.scenario(), replay.list());
        replay.drive(&mut [&mut meter], stop)?;
        let planned = replay.scenario().slots;
        if meter.tally().sums.last_slot() != planned {
            let flown = meter.tally().sums.last_slot();
            let message = format_args!("it ended early, after slot {flown} of {planned}: expected a complete run");
            return Err(InputError::new("run folder", folder, message).into());
        }
        let values = meter.values(replay.plant(), Some(&replay.summary().timing), None);
        Ok(Self { label: label.to_owned(), missions: BTreeMap::from([(replay.scenario().seed, values)]) })
    }

    /// Its missions whose plans were not flown as they were decided, over `scenario` with any seed.
    #[must_use]
    pub fn unflown(&self, scenario: &Scenario) -> Option<UnflownFlights> {
        UnflownFlights::of(&self.label, scenario, self.missions.iter().map(|(seed, values)| (*seed, values)))
    }

    /// A metric of the mission with this seed.
    pub fn value(&self, seed: u64, metric: Metric) -> Option<f64> {
        self.missions.get(&seed).map(|values| values[metric as usize])
    }

    fn values(&self, metric: Metric) -> BTreeMap<u64, f64> {
        let value = |(seed, values): (&u64, &MetricValues)| Some((*seed, values[metric as usize]));
        self.missions.iter().filter_map(value).filter(|(_, value)| !value.is_nan()).collect()
    }

    /// Mean of a metric and its difference to `reference`; `None` if no mission has a value.
    pub fn standing(&self, metric: Metric, reference: Option<&Self>) -> Option<MetricStanding> {
        let values = self.values(metric);
        let numbers: Vec<f64> = values.values().copied().collect();
        let mean = (!numbers.is_empty()).then(|| MeanInterval::of(&numbers, metric.support()))?;
        let differences = reference.map(|other| paired_differences(&values, &other.values(metric)));
        let differences = differences.filter(|differences| !differences.is_empty());
        let difference =
            differences.map(|differences| MeanInterval::of(&differences, metric.support().of_difference()));
        Some(MetricStanding {
            label: self.label.clone(),
            metric: metric.name(),
            n: mean.n,
            mean: mean.mean,
            ci95: mean.limits,
            difference: difference.map(|difference| difference.mean),
            difference_ci95: difference.and_then(|difference| difference.limits),
            difference_p: difference.and_then(|difference| difference.p_of_zero(metric.support().of_difference())),
            difference_p_holm: None,
            concentration: Concentration::of(numbers.into_iter()),
        })
    }
}

/// All metrics of all contenders, with differences to the first.
#[must_use]
pub fn standings(contenders: &[Contender]) -> Vec<MetricStanding> {
    let of_contender = |(index, contender): (usize, &Contender)| {
        let reference = contenders.first().filter(|_| index > 0);
        Metric::VARIANTS.iter().filter_map(|&metric| contender.standing(metric, reference)).collect::<Vec<_>>()
    };
    let mut standings: Vec<MetricStanding> = contenders.iter().enumerate().flat_map(of_contender).collect();
    for metric in Metric::all() {
        let is_tested = |standing: &&mut MetricStanding| standing.metric == metric.name();
        let tested = standings.iter_mut().filter(is_tested).filter(|standing| standing.difference_p.is_some());
        let tested: Vec<&mut MetricStanding> = tested.collect();
        let p_values: Vec<f64> = tested.iter().filter_map(|standing| standing.difference_p).collect();
        for (standing, p) in tested.into_iter().zip(holm(&p_values)) {
            standing.difference_p_holm = Some(p);
        }
    }
    standings
}

#[cfg(test)]
mod tests {
    use super::*;
    use strum::EnumCount;

    fn contender(label: &str, losses: &[(u64, f64)]) -> Contender {
        let values = |loss_rate| {
            let mut values: MetricValues = [0.0; Metric::COUNT];
            values[Metric::LossRate as usize] = loss_rate;
            values[Metric::LossBound as usize] = f64::NAN;
            values
        };
        let missions = losses.iter().map(|&(seed, loss_rate)| (seed, values(loss_rate))).collect();
        Contender { label: label.to_owned(), missions }
    }

    #[test]
    fn differences_are_paired_by_seed() {
        let first = contender("uts", &[(1, 0.5), (2, 0.7), (3, 0.9)]);
        let second = contender("gfs", &[(2, 0.6), (3, 0.7), (4, 0.0)]);
        let standing = second.standing(Metric::LossRate, Some(&first)).unwrap();
        assert_eq!((standing.n, standing.metric), (3, "loss_rate"));
        assert!((standing.difference.unwrap() + 0.15).abs() < 1e-12); // (−0.1 − 0.2) / 2
        assert!(standing.difference_ci95.is_some());
        // t = −0.15/0.05 on the logit scale with 1 degree of freedom: atanh(0.15) (1 − 0.15²)/0.05 = 2.954796
        assert!((standing.difference_p.unwrap() - 0.207_750).abs() < 1e-6, "{standing:?}");
        assert_eq!(standing.concentration.nonzero, 2);
    }

    #[test]
    fn p_values_are_adjusted_for_the_number_of_differences_of_the_metric() {
        let first = contender("uts", &[(1, 0.5), (2, 0.7), (3, 0.9)]);
        let near = contender("gfs", &[(1, 0.5), (2, 0.6), (3, 0.8)]);
        let far = contender("rfs", &[(1, 0.1), (2, 0.3), (3, 0.4)]);
        let all = standings(&[first, near, far]);
        let of = |label| all.iter().find(|one| one.label == label && one.metric == "loss_rate").unwrap();
        let [none, near, far] = ["uts", "gfs", "rfs"].map(of);
        assert_eq!((none.difference_p, none.difference_p_holm), (None, None));
        assert_eq!(far.difference_p_holm, far.difference_p.map(|p| 2.0 * p));
        assert_eq!(near.difference_p_holm, near.difference_p, "it is the greater of two");
    }

    #[test]
    fn the_reference_has_no_difference_and_empty_metrics_are_omitted() {
        let all = standings(&[contender("uts", &[(1, 0.5)]), contender("gfs", &[(9, 0.5)])]);
        assert!(all.iter().all(|standing| standing.difference.is_none() && standing.ci95.is_none()));
        assert!(all.iter().all(|standing| standing.metric != "loss_bound"));
        assert_eq!(all.iter().filter(|standing| standing.label == "gfs").count(), Metric::VARIANTS.len() - 1);
    }
}
