//! The metrics of a mission, which are the columns of a sweep's results.

use std::time::Duration;

use nalgebra::Point3;
use skysink_common::battery::Battery;
use skysink_common::message::{FlightReport, Mode};
use skysink_common::nodes::energy::NodeEnergyUse;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{ByUav, SlotRecord, UAV, uploads};
use skysink_planner::settings::Settings;
use strum::{EnumCount, VariantArray};

use crate::ages::{AgeCounts, Ages, Delivered, DeliveredData};
use crate::bounds::MissionBounds;
use crate::drive::{Observer, SlotSink};
use crate::origin::RunMode;
use crate::service_gaps::GapSums;
use crate::summary::{RunTiming, Summary, Tally};
use crate::trapped::Stay;
use crate::{MissionError, Plant};

/// The values of all metrics, in the order of [`Metric`].
pub type MetricValues = [f64; Metric::COUNT];

/// The range of a quantity and of its mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Support {
    /// Any number.
    Real,
    /// A number that is not negative.
    NonNegative,
    /// A fraction, from 0 to 1.
    Fraction,
    /// The difference of two fractions, from −1 to 1.
    FractionDifference,
}

impl Support {
    /// The range of the difference of two such quantities.
    pub fn of_difference(self) -> Self {
        match self {
            Self::Fraction => Self::FractionDifference,
            Self::Real | Self::NonNegative | Self::FractionDifference => Self::Real,
        }
    }

    /// Its least and its greatest value.
    pub fn ends(self) -> [f64; 2] {
        match self {
            Self::Real => [f64::NEG_INFINITY, f64::INFINITY],
            Self::NonNegative => [0.0, f64::INFINITY],
            Self::Fraction => [0.0, 1.0],
            Self::FractionDifference => [-1.0, 1.0],
        }
    }
}

/// What there is to know of a metric.
struct MetricRow {
    /// The name of its column.
    name: &'static str,
    /// Its description.
    words: &'static str,
    /// Its unit; empty for a fraction or an index.
    unit: &'static str,
    /// The range of its values that its confidence interval respects.
    support: Support,
    kind: MetricKind,
    /// Its value; NaN if the mission has none.
    of: fn(&MeteredMission<'_>) -> f64,
}

/// The kind of a metric's values.
#[derive(Clone, Copy, PartialEq, Eq)]
enum MetricKind {
    Real,
    /// A whole number.
    Count,
    /// A wall-clock time, which is not reproducible.
    WallClock,
}

/// A mission with all that its metrics are computed from.
struct MeteredMission<'a> {
    meter: &'a MissionMeter,
    summary: &'a Summary,
    /// The ages since the last service [slots].
    service_ages: AgeCounts,
    /// The ages of the delivered data [slots].
    data_ages: AgeCounts,
    /// The sums over the gaps between services.
    gaps: GapSums,
    /// The bits delivered by each sensor node.
    delivered_bits: &'a [u64],
    /// What is not delivered, by weight [bit].
    undelivered_bits: f64,
    /// The bounds; only `offline` has them.
    bounds: Option<MissionBounds>,
}

impl MeteredMission<'_> {
    /// The slots of SNs with an age above the limit, by weight; NaN without a limit.
    fn deadline_slots(&self) -> f64 {
        if self.meter.has_deadline { self.gaps.late } else { f64::NAN }
    }

    /// A figure of the batteries of the sensor nodes; NaN if it has none.
    fn of_nodes(&self, of: impl Fn(&NodeEnergyUse) -> Option<f64>) -> f64 {
        self.summary.node_energy.as_ref().and_then(of).unwrap_or(f64::NAN)
    }

    /// What the mission costs by `planner.objective` (decision D36).
    fn objective(&self) -> f64 {
        let MissionMeter { tally, is_collected, .. } = self.meter;
        let of_bits = if *is_collected { self.undelivered_bits } else { tally.lost_bits() };
        tally.objective().unwrap_or(of_bits)
    }
}

/// What the rows of real numbers, of fractions, and of wall-clock times have in common.
const REAL: MetricRow = MetricRow {
    name: "",
    words: "",
    unit: "",
    support: Support::NonNegative,
    kind: MetricKind::Real,
    of: |_| f64::NAN,
};
const FRACTION: MetricRow = MetricRow { support: Support::Fraction, ..REAL };
const COUNT: MetricRow = MetricRow { kind: MetricKind::Count, ..REAL };
const BITS: MetricRow = MetricRow { unit: "bit", ..REAL };
const BIT_COUNT: MetricRow = MetricRow { kind: MetricKind::Count, ..BITS };
const METRES: MetricRow = MetricRow { unit: "m", ..REAL };
const JOULES: MetricRow = MetricRow { unit: "J", ..REAL };
const SECONDS: MetricRow = MetricRow { unit: "s", ..REAL };
const WALL_CLOCK: MetricRow = MetricRow { kind: MetricKind::WallClock, unit: "µs", ..REAL };

/// Declares the metrics: definition (also for `docs/src/metrics.md`), kind of the row, name, description and value.
macro_rules! metrics {
    ($($(#[doc = $definition:literal])+ $variant:ident: $common:ident, $name:literal, $words:literal, $of:expr;)*) => {
        /// A metric, which is a column of the results.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, EnumCount, VariantArray)]
        pub enum Metric {
            $($(#[doc = $definition])+ $variant,)*
        }

        impl Metric {
            fn row(self) -> MetricRow {
                match self {
                    $(Self::$variant => MetricRow { name: $name, words: $words, of: $of, ..$common },)*
                }
            }
        }
    };
}

// NaN stands for a figure that the mission does not have.
metrics! {
    /// η = Σ_t Σ_i D_i(t) / (Σ_i s_i τ T), bits lost over bits sampled (decision D3).
    LossRate: FRACTION, "loss_rate", "data loss rate η", |m| m.summary.loss_rate;
    /// Σ_i Σ_t D_i(t) / (s_i τ T), the paper's figure, which grows with N (decision D3).
    EtaLetter: REAL, "eta_letter", "η as in the paper", |m| m.summary.eta_letter;
    /// η by the weights of the sensor list (decision D25); no value where all weights are equal.
    WeightedLossRate: FRACTION, "weighted_loss_rate", "weighted data loss rate η_w",
        |m| m.summary.weighted_loss_rate.unwrap_or(f64::NAN); // equal weights: it is then the loss rate
    /// Bits uploaded to the UAV.
    DeliveredBits: BIT_COUNT, "delivered_bits", "bits delivered",
        |m| m.summary.totals.delivered_bits as f64; // exact below 2^53
    /// Bits lost because they were older than `sensors.expiry_s` (decision D36), a part of all losses; no value without
    /// this key.
    ExpiredBits: BITS, "expired_bits", "bits lost because they were too old",
        |m| m.summary.expired_bits.map_or(f64::NAN, |bits| bits as f64);
    /// `delivered_bits` / T.
    BitsPerWaypoint: BITS, "bits_per_waypoint", "bits delivered per waypoint", |m| m.summary.bits_per_waypoint;
    /// SNs served per slot.
    MeanServed: REAL, "mean_served", "SNs served per slot", |m| m.summary.mean_served;
    /// Length of the flight, from waypoint to waypoint, including climb.
    FlownM: METRES, "flown_m", "flown distance", |m| m.meter.flown_m;
    /// Energy of the flight: what it takes from the battery (decision D10), without `uav.battery` Σ_t P(V_t) τ with the
    /// speed V_t along the slot's path, climb included. Hovering costs P(0), charging and being down cost nothing.
    EnergyJ: JOULES, "energy_j", "propulsion energy", |m| m.meter.energy_j;
    /// Energy in the battery at the end. No value without `uav.battery`, as for the next three.
    EnergyLeftJ: JOULES, "energy_left_j", "energy left in the battery",
        |m| m.summary.energy.map_or(f64::NAN, |energy| energy.left_j);
    /// Energy charged in the base.
    ChargedJ: JOULES, "charged_j", "energy charged", |m| m.summary.energy.map_or(f64::NAN, |energy| energy.charged_j);
    /// Time in the base in mode `charge`.
    ChargedS: SECONDS, "charged_s", "time charging", |m| m.summary.energy.map_or(f64::NAN, |energy| energy.charged_s);
    /// Time of waiting for a pad; no value without `[[base.site]]` (decision D34).
    PadWaitS: SECONDS, "pad_wait_s", "time waiting for a pad",
        |m| m.summary.energy.and_then(|energy| energy.pad_wait_s).unwrap_or(f64::NAN);
    /// End of the slot in which the first SN dies (decision D33); no value if none does. It and the next six have no
    /// value without `[sensors.energy]`.
    FirstDeathS: SECONDS, "first_death_s", "time of the first death of an SN", |m| m.of_nodes(|energy| energy.first_death_s);
    /// End of the slot from which on half of the SNs are dead; no value if fewer die.
    HalfDeadS: SECONDS, "half_dead_s", "time at which half of the SNs are dead", |m| m.of_nodes(|energy| energy.half_dead_s);
    /// SNs dead at the end.
    Dead: REAL, "dead", "dead SNs", |m| m.of_nodes(|energy| Some(energy.dead as f64));
    /// What dead SNs held and sampled, a part of all losses.
    LostToDeathBits: BITS, "lost_to_death_bits", "bits lost by dead SNs",
        |m| m.of_nodes(|energy| Some(energy.lost_to_death_bits as f64));
    /// Energy of all SNs over `delivered_bits`.
    EnergyPerBitJ: JOULES, "energy_per_bit_j", "energy of the SNs for a bit delivered",
        |m| m.of_nodes(|energy| energy.energy_per_bit_j);
    /// Least energy left in an SN, over the capacity.
    ResidualMin: FRACTION, "residual_min", "least energy left in an SN",
        |m| m.of_nodes(|energy| Some(energy.residual_min));
    /// Mean energy left, over the capacity.
    ResidualMean: FRACTION, "residual_mean", "mean energy left in the SNs",
        |m| m.of_nodes(|energy| Some(energy.residual_mean));
    /// Services refused for want of airtime (`link.duty_cycle`); no value without it.
    RefusedDuty: REAL, "refused_duty", "services refused because the SN had no airtime left",
        |m| m.summary.refused_duty.map_or(f64::NAN, |refused| refused as f64);
    /// Bits delivered over the bits before slot 1 and those sampled.
    CollectionRatio: FRACTION, "collection_ratio", "fraction of all bits collected", |m| m.summary.collection_ratio;
    /// End of the slot that delivers the last of the initial data; no value if some is left, or where an SN
    /// samples.
    CompletedS: SECONDS, "completed_s", "time at which all initial data is delivered",
        |m| m.summary.completed_s.unwrap_or(f64::NAN);
    /// T τ − `completed_s`, or 0 if data is left, plus 100 times the fraction delivered; no value where an SN
    /// samples, or without data.
    Score: REAL, "score", "seconds left when all is delivered, and 100 times the fraction delivered",
        |m| m.summary.score.unwrap_or(f64::NAN);
    /// 1 if the UAV is in the base after the last slot and not down, otherwise 0; no value without a base.
    Landed: FRACTION, "landed", "fraction of missions that end in the base", |m| landed(m.summary);
    /// `landed` · `collection_ratio`.
    LandedRatio: FRACTION, "landed_ratio", "collection ratio of those that end in the base, else 0",
        |m| landed(m.summary) * m.summary.collection_ratio;
    /// Time since the last service, including services of 0 bit: mean over all SNs and slots. 0 in the slot of the
    /// service; before the first service it is counted from the start of the mission.
    AoiMeanS: SECONDS, "aoi_mean_s", "mean time since the last service",
        |m| m.service_ages.mean() * m.meter.slot_s;
    /// 99th percentile of these N T ages: the smallest age that at most 1 % of them exceed (nearest rank).
    AoiP99S: SECONDS, "aoi_p99_s", "99th percentile of the time since the last service",
        |m| m.service_ages.quantile(0.99) as f64 * m.meter.slot_s;
    /// Mean of these ages with the weights w_i of the SNs: Σ_i w_i Σ_t age_i(t) / (T Σ_i w_i).
    AoiWeightedS: SECONDS, "aoi_weighted_s", "mean time since the last service, by weight",
        |m| m.gaps.ages * m.meter.slot_s / (m.meter.tally.gaps().weight() * m.meter.slot as f64);
    /// Age in the slot before a service, mean over all services; the end of the mission counts as a service of every
    /// SN.
    AoiPeakMeanS: SECONDS, "aoi_peak_mean_s", "mean age before a service",
        |m| m.gaps.peaks as f64 * m.meter.slot_s / m.gaps.gaps as f64;
    /// The largest of these ages.
    AoiPeakMaxS: SECONDS, "aoi_peak_max_s", "largest age before a service", |m| m.gaps.highest as f64 * m.meter.slot_s;
    /// Σ_i w_i times the slots with an age above `sensors.deadline_s` (w_i = 1 if all are equal); no value without it.
    DeadlineSlots: REAL, "deadline_slots", "slots of sensor nodes with an age above the limit", |m| m.deadline_slots();
    /// What the flight costs by `planner.objective`; for `"collect"` the bits that are not delivered.
    Objective: REAL, "objective", "cost by planner.objective", |m| m.objective();
    /// Time in which contacts were set up: `link.setup_s` for each service of an SN that the UAV has not served in the
    /// slot before; no value where they take no time.
    SetupS: SECONDS, "setup_s", "time in which contacts were set up", |m| m.meter.setups as f64 * m.meter.setup_s;
    /// Age of information of the delivered data, Δ_i(t), mean over all slots and all SNs that sample (s_i > 0); 0
    /// if there are none.
    DataAgeMeanS: SECONDS, "data_age_mean_s", "mean age of the delivered data",
        |m| m.data_ages.mean() * m.meter.slot_s;
    /// 99th percentile of these ages (nearest rank).
    DataAgeP99S: SECONDS, "data_age_p99_s", "99th percentile of the age of the delivered data",
        |m| m.data_ages.quantile(0.99) as f64 * m.meter.slot_s;
    /// Jain's fairness index of the bits delivered by each SN, (Σ x_i)² / (N Σ x_i²); 1 if nothing was delivered.
    Jain: FRACTION, "jain", "Jain's fairness index", |m| jain(m.delivered_bits);
    /// 1 if the UAV is trapped in one part of the area: more than a quarter of the SNs lie beyond the smallest box
    /// around the waypoints of the second half of the mission, enlarged by d_c; otherwise 0.
    Trapped: FRACTION, "trapped", "fraction of trapped fields", |m| f64::from(u8::from(m.meter.stay.is_trapped()));
    /// Lower bound on η of every flight of this mission; only for `offline`.
    LossBound: FRACTION, "loss_bound", "lower bound of the data loss rate",
        |m| m.bounds.map_or(f64::NAN, |bounds| bounds.loss_bound);
    /// Over a random channel: lower bound on the mean of η over the draws of the channel, for every planner that does
    /// not know them in advance; only for `offline`.
    ExpectedLossBound: FRACTION, "expected_loss_bound", "lower bound of the expected data loss rate",
        |m| m.bounds.and_then(|bounds| bounds.expected_loss_bound).unwrap_or(f64::NAN); // of a random channel
    /// Lower bound on `objective` of every flight; only for `offline` with an objective of ages or `"collect"`.
    ObjectiveBound: REAL, "objective_bound", "lower bound of the cost by planner.objective",
        |m| m.bounds.and_then(|bounds| bounds.objective_bound).unwrap_or(f64::NAN); // the loss has its own
    /// Upper bound on `score`; only for `offline` where no SN samples.
    ScoreBound: REAL, "score_bound", "upper bound of the score",
        |m| m.bounds.and_then(|bounds| bounds.score_bound).unwrap_or(f64::NAN);
    /// Slots in which a UAV held its position, without a plan in time or because its waypoint was refused; over all
    /// UAVs.
    HeldSlots: COUNT, "held_slots", "slots held", |m| m.summary.held_slots as f64;
    /// Requests of plans that were refused: waypoints, and sensor nodes to serve.
    Refused: COUNT, "refused", "requests refused", |m| m.summary.refused as f64;
    /// Median of the wall-clock planning times of the slots; in `timings.csv`.
    PlanP50Us: WALL_CLOCK, "plan_p50_us", "planning time", |m| m.summary.timing.plan_p50_us;
    /// 99th percentile of these times; in `timings.csv`.
    PlanP99Us: WALL_CLOCK, "plan_p99_us", "99th percentile of the planning time", |m| m.summary.timing.plan_p99_us;
}

impl Metric {
    /// All metrics.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::VARIANTS.iter().copied()
    }

    /// The name of its column.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Its unit; empty for a fraction or an index.
    pub fn unit(self) -> &'static str {
        self.row().unit
    }

    /// A description with its unit.
    pub fn label(self) -> String {
        let MetricRow { words, unit, .. } = self.row();
        if unit.is_empty() { words.to_owned() } else { format!("{words} [{unit}]") }
    }

    /// Whether it is a whole number.
    pub fn is_count(self) -> bool {
        self.row().kind == MetricKind::Count
    }

    /// Whether it is a wall-clock time, which is not reproducible.
    pub fn is_timing(self) -> bool {
        self.row().kind == MetricKind::WallClock
    }

    /// The range of its values that its confidence interval respects.
    pub fn support(self) -> Support {
        self.row().support
    }
}

/// A UAV after the last slot.
#[derive(Debug)]
struct MeteredUav {
    position: Point3<f64>,
    is_down: bool,
    /// The SNs that it has served in the last slot.
    contacts: Vec<u32>,
}

/// Computes the metrics of a mission, slot by slot.
#[derive(Debug)]
pub struct MissionMeter {
    tally: Tally,
    slot_s: f64,
    battery: Battery,
    uavs: ByUav<MeteredUav>,
    flown_m: f64,
    energy_j: f64,
    slot: u64,
    service_ages: Ages,
    /// Contacts that were set up, and the time of each [s]; NaN if they take none.
    setups: u64,
    setup_s: f64,
    has_deadline: bool,
    /// Whether what is delivered counts.
    is_collected: bool,
    data: DeliveredData,
    stay: Stay,
}

impl MissionMeter {
    /// The meter before slot 1.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        Self {
            tally: Tally::new(scenario, list, &RunMode::default()),
            slot_s: scenario.slot_s,
            battery: Battery::of(scenario),
            uavs: scenario
                .starts()
                .map(|position| MeteredUav { position, is_down: false, contacts: Vec::new() })
                .collect(),
            flown_m: 0.0,
            energy_j: 0.0,
            slot: 0,
            service_ages: Ages::new(list.sensors().len()),
            setups: 0,
            setup_s: scenario.link.setup_s.unwrap_or(f64::NAN),
            has_deadline: scenario.sensors.deadline_s.is_some(),
            is_collected: Settings::of(scenario).is_ok_and(|settings| settings.objective.is_collect()),
            data: DeliveredData::new(scenario, list),
            stay: Stay::new(scenario, list),
        }
    }

    /// The figures of the summary so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// The metrics so far, with the plant after the last slot; `timing` instead of the planning times of the slots.
    pub fn values(&self, plant: &Plant, timing: Option<&RunTiming>, bounds: Option<MissionBounds>) -> MetricValues {
        let mut summary = self.tally.summary(Duration::ZERO, 0);
        if let Some(timing) = timing {
            timing.clone_into(&mut summary.timing);
        }
        let field = plant.field();
        let left_bits = field.lost_bits().zip(field.queues_bits()).map(|(lost, queue)| lost as f64 + f64::from(*queue));
        let undelivered_bits = self.tally.gaps().weigh(left_bits);
        self.values_of(&summary, field.delivered_bits(), undelivered_bits, bounds)
    }

    /// The metrics of a mission with this summary; `delivered_bits` by sensor node.
    fn values_of(
        &self,
        summary: &Summary,
        delivered_bits: &[u64],
        undelivered_bits: f64,
        bounds: Option<MissionBounds>,
    ) -> MetricValues {
        let service_ages = self.service_ages.counts(self.slot, |_| true);
        let data_ages = self.data.counts(self.slot);
        let gaps = self.tally.gaps().sums(self.slot);
        let mission = MeteredMission {
            meter: self,
            summary,
            service_ages,
            data_ages,
            gaps,
            delivered_bits,
            undelivered_bits,
            bounds,
        };
        let mut values = [0.0; Metric::COUNT];
        for (value, metric) in values.iter_mut().zip(Metric::all()) {
            *value = (metric.row().of)(&mission);
        }
        values
    }

    /// Adds the flights of the next slot, after which served sensor nodes have delivered what `delivered` says,
    /// `None` if they did not answer.
    ///
    /// # Panics
    /// If the slot serves an unknown sensor node.
    fn add(&mut self, flights: &[FlightReport], delivered: impl Fn(u32) -> Option<Delivered>) {
        self.slot += 1;
        self.stay.add(self.slot, flights[UAV].position().xy());
        for (uav, flight) in self.uavs.iter_mut().zip(flights) {
            let step = flight.position() - uav.position;
            uav.position = flight.position();
            self.flown_m += step.norm();
            let links = flight.served_links();
            self.setups += links.iter().filter(|link| !uav.contacts.contains(&link.sensor)).count() as u64;
            uav.contacts.clear();
            uav.contacts.extend(links.iter().map(|link| link.sensor));
            // A UAV that goes down has flown in that slot.
            let was_down = std::mem::replace(&mut uav.is_down, flight.flown_mode() == Mode::Down);
            if flight.flown_mode() != Mode::Charge && !was_down {
                self.energy_j += self.battery.flight_j(&step);
            }
        }
        for link in uploads(flights) {
            let sensor = link.sensor as usize;
            if let Some(delivered) = delivered(link.sensor) {
                self.service_ages.refresh(sensor, self.slot, self.slot);
                self.data.add(sensor, self.slot, delivered);
            }
        }
    }
}

impl Observer for MissionMeter {
    fn begin(&mut self, plant: &Plant) -> Result<(), MissionError> {
        self.tally.begin(plant)
    }

    fn slot(&mut self, record: &SlotRecord, plant: &Plant) -> Result<(), MissionError> {
        self.tally.add(record)?;
        let field = plant.field();
        self.add(record.flights(), |id| field.has_answered(id).then(|| Delivered::of(field, id as usize)));
        Ok(())
    }
}

/// 1 if the mission has ended in the base, 0 if not; NaN without a base.
fn landed(summary: &Summary) -> f64 {
    summary.landed.map_or(f64::NAN, |landed| f64::from(u8::from(landed)))
}

/// Jain's fairness index, `(Σ x)² / (N Σ x²)`, at most 1 whatever the rounding; 1 if nothing was delivered.
fn jain(values: &[u64]) -> f64 {
    let sum: f64 = values.iter().map(|&value| value as f64).sum();
    let squares: f64 = values.iter().map(|&value| (value as f64).powi(2)).sum();
    if squares > 0.0 { (sum * sum / (values.len() as f64 * squares)).min(1.0) } else { 1.0 }
}

#[cfg(test)]
mod tests;
