//! The metrics of a mission, which are the columns of a sweep's results. Defined in `docs/src/metrics.md`.

use std::time::Duration;

use nalgebra::Point3;
use serde::Deserialize;
use skysink_common::message::{FlightReport, Plan, QueuesHeader};
use skysink_common::propulsion::power_w;
use skysink_common::scenario::{Propulsion, Scenario};
use skysink_common::sensors::SensorList;
use skysink_field_sim::Field;
use skysink_mission::ages::{Ages, DeliveredData};
use skysink_mission::summary::{RunTiming, Summary, Tally};
use strum::{EnumCount, IntoStaticStr, VariantArray};

use crate::optimize::LossBounds;
use crate::sweep::statistics::Support;

/// A metric, which is a column of the results; defined in `docs/src/metrics.md`.
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
    DataAgeMeanS,
    #[strum(serialize = "data_age_p99_s")]
    DataAgeP99S,
    Jain,
    /// NaN unless the strategy is `offline`.
    LossBound,
    /// NaN unless the strategy is `offline` and the channel is random.
    ExpectedLossBound,
    #[strum(serialize = "plan_p50_us")]
    PlanP50Us,
    #[strum(serialize = "plan_p99_us")]
    PlanP99Us,
}

/// The values of all metrics, in the order of [`Metric`].
pub type MetricValues = [f64; Metric::COUNT];

impl Metric {
    /// All metrics.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::VARIANTS.iter().copied()
    }

    /// The name of its column.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// A description with its unit.
    pub fn label(self) -> &'static str {
        match self {
            Self::LossRate => "data loss rate η",
            Self::EtaLetter => "η as in the paper",
            Self::DeliveredBits => "bits delivered [bit]",
            Self::BitsPerWaypoint => "bits delivered per waypoint [bit]",
            Self::MeanServed => "SNs served per slot",
            Self::FlownM => "flown distance [m]",
            Self::EnergyJ => "propulsion energy [J]",
            Self::AoiMeanS => "mean time since the last service [s]",
            Self::AoiP99S => "99th percentile of the time since the last service [s]",
            Self::DataAgeMeanS => "mean age of the delivered data [s]",
            Self::DataAgeP99S => "99th percentile of the age of the delivered data [s]",
            Self::Jain => "Jain's fairness index",
            Self::LossBound => "lower bound of the data loss rate",
            Self::ExpectedLossBound => "lower bound of the expected data loss rate",
            Self::PlanP50Us => "planning time [µs]",
            Self::PlanP99Us => "99th percentile of the planning time [µs]",
        }
    }

    /// Whether it is a wall-clock time, which is not reproducible.
    pub fn is_timing(self) -> bool {
        matches!(self, Self::PlanP50Us | Self::PlanP99Us)
    }

    /// The range of its values that its confidence interval respects.
    pub fn support(self) -> Support {
        match self {
            Self::LossRate | Self::LossBound | Self::ExpectedLossBound | Self::Jain => Support::Fraction,
            Self::EtaLetter => Support::NonNegative,
            Self::DeliveredBits | Self::BitsPerWaypoint | Self::MeanServed | Self::FlownM | Self::EnergyJ => {
                Support::Real
            }
            Self::AoiMeanS | Self::AoiP99S | Self::DataAgeMeanS | Self::DataAgeP99S => Support::Real,
            Self::PlanP50Us | Self::PlanP99Us => Support::Real,
        }
    }
}

/// Running sums of a mission, in addition to those of its summary.
#[derive(Debug, Clone)]
struct MissionSums {
    slot_s: f64,
    aircraft: Propulsion,
    position: Point3<f64>,
    flown_m: f64,
    energy_j: f64,
    slot: u64,
    service_ages: Ages,
    data: DeliveredData,
}

impl MissionSums {
    /// The sums before slot 1.
    fn new(scenario: &Scenario, list: &SensorList) -> Self {
        Self {
            slot_s: scenario.slot_s,
            aircraft: scenario.uav.propulsion,
            position: scenario.start(),
            flown_m: 0.0,
            energy_j: 0.0,
            slot: 0,
            service_ages: Ages::new(list.sensors().len()),
            data: DeliveredData::new(scenario, list),
        }
    }

    /// Adds the next slot. `queues_bits` are the queues after the slot, `delivered_bits` the bits delivered since the
    /// start, both by sensor node.
    ///
    /// # Panics
    /// If the slot serves an unknown sensor node.
    fn add(&mut self, flight: &FlightReport, queues_bits: &[u32], delivered_bits: &[u64]) {
        self.slot += 1;
        let position = flight.position();
        let step_m = (position - self.position).norm();
        self.position = position;
        self.flown_m += step_m;
        self.energy_j += power_w(&self.aircraft, step_m / self.slot_s) * self.slot_s;
        for link in flight.served_links() {
            let sensor = link.sensor as usize;
            self.service_ages.refresh(sensor, self.slot, self.slot);
            self.data.add(sensor, self.slot, delivered_bits[sensor], queues_bits[sensor].into());
        }
    }

    /// The metrics of a mission with this summary; `delivered_bits` by sensor node.
    fn values(&self, summary: &Summary, delivered_bits: &[u64], bounds: Option<LossBounds>) -> MetricValues {
        let service_ages = self.service_ages.counts(self.slot, |_| true);
        let data_ages = self.data.counts(self.slot);
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
                Metric::AoiMeanS => service_ages.mean() * self.slot_s,
                Metric::AoiP99S => service_ages.quantile(0.99) as f64 * self.slot_s,
                Metric::DataAgeMeanS => data_ages.mean() * self.slot_s,
                Metric::DataAgeP99S => data_ages.quantile(0.99) as f64 * self.slot_s,
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

/// Computes the metrics of a mission, slot by slot.
#[derive(Debug)]
pub struct MissionMeter {
    tally: Tally,
    sums: MissionSums,
}

impl MissionMeter {
    /// The meter before slot 1; `header` contains the ledger.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList, header: &QueuesHeader) -> Self {
        let mut tally = Tally::new(scenario, list);
        tally.start(header);
        Self { tally, sums: MissionSums::new(scenario, list) }
    }

    /// Adds the next slot. `header` and `field` are the ledger and the field after it. Without a plan, the slot has no
    /// planning time.
    ///
    /// # Panics
    /// If the slot serves an unknown sensor node.
    pub fn add(&mut self, plan: Option<&Plan>, flight: &FlightReport, header: &QueuesHeader, field: &Field) {
        self.tally.add(plan, flight, header);
        self.sums.add(flight, field.queues_bits(), field.delivered_bits());
    }

    /// The figures of the summary so far.
    #[must_use]
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// The metrics so far; `timing` instead of the planning times of the slots.
    #[must_use]
    pub fn values(&self, field: &Field, timing: Option<&RunTiming>, bounds: Option<LossBounds>) -> MetricValues {
        let mut summary = self.tally.summary(None, Duration::ZERO, 0);
        if let Some(timing) = timing {
            timing.clone_into(&mut summary.timing);
        }
        self.sums.values(&summary, field.delivered_bits(), bounds)
    }
}

/// Jain's fairness index, `(Σ x)² / (N Σ x²)`, at most 1 whatever the rounding; 1 if nothing was delivered.
fn jain(values: &[u64]) -> f64 {
    let sum: f64 = values.iter().map(|&value| value as f64).sum();
    let squares: f64 = values.iter().map(|&value| (value as f64).powi(2)).sum();
    if squares > 0.0 { (sum * sum / (values.len() as f64 * squares)).min(1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::message::{LinkReport, Mode};
    use skysink_common::scenario::Overrides;
    use std::path::Path;

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
                        aoi_p99_s data_age_mean_s data_age_p99_s jain loss_bound expected_loss_bound plan_p50_us \
                        plan_p99_us";
        assert_eq!(names.join(" "), expected);
    }

    #[test]
    fn a_service_without_a_bit_refreshes_no_data() {
        let text = "name = \"a\"\nslots = 4\n";
        let scenario = Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap();
        let list = "x_m,y_m,queue_bits,sampling_bps\n10,10,100,100\n";
        let list = SensorList::parse(list, Path::new("list.csv"), &scenario).unwrap();
        let mut metrics = MissionSums::new(&scenario, &list);
        // 200, 300, 400, 500 bits are there in slots 1 to 4; in slot 2 no bit is delivered, in slot 3 the initial 100
        // and the first 150 of those sampled, the last of them in slot 2.
        for (served, queue_bits, delivered_bits) in
            [(&[][..], 200, 0), (&[0], 300, 0), (&[0], 150, 250), (&[], 250, 250)]
        {
            metrics.add(&flight(50.0, served), &[queue_bits], &[delivered_bits]);
        }
        let ages = [Metric::AoiMeanS, Metric::AoiP99S, Metric::DataAgeMeanS, Metric::DataAgeP99S];
        // Since the service 1, 0, 0, 1; of the data 1, 2, 1, 2.
        assert_eq!(values(&metrics, ages), [0.5, 1.0, 1.5, 2.0]);
    }

    #[test]
    fn hovering_costs_energy_and_no_distance() {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let mut metrics = MissionSums::new(&scenario, &SensorList::of(&scenario).unwrap());
        metrics.add(&flight(50.0, &[]), &[], &[]);
        let [hover_m, hover_j] = values(&metrics, [Metric::FlownM, Metric::EnergyJ]);
        assert!((hover_j - 168.49).abs() < 1e-9);
        metrics.add(&flight(60.0, &[]), &[], &[]);
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
