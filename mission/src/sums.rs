//! The running sums of a mission, slot by slot, from which its figures are computed.

use std::time::Duration;

use hdrhistogram::Histogram;
use skysink_common::base::Base;
use skysink_common::battery::Battery;
use skysink_common::loss_rate::LossRate;
use skysink_common::message::{FlightReport, Mode, Plan, Totals};
use skysink_common::nodes::energy::NodeEnergyUse;
use skysink_common::nodes::{Airtime, Charges, Cohorts, NodeFeatures};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{ByUav, SlotRecord, uploads};
use skysink_planner::settings::{ObjectiveWeights, PlanningObjective, Settings};

use crate::ages::AgeCounts;
use crate::bounds::MissionBounds;
use crate::latency::{Latency, SlotTimes, Spread, histogram};
use crate::losses::Losses;
use crate::origin::RunMode;
use crate::service_gaps::{GapSums, ServiceGaps};
use crate::summary::{EnergyUse, Event, FleetUse, RunTiming, is_late, score};

/// Most events in a summary.
const MAX_EVENTS: usize = 10_000;

/// What is known of a mission before slot 1.
#[derive(Debug)]
pub struct MissionLabels {
    /// Name of the scenario.
    pub name: String,
    /// Strategy, or the label of an external planner.
    pub strategy: String,
    /// Roles of external processes.
    pub external: Vec<String>,
    /// Seed.
    pub seed: u64,
    /// Slots of the scenario.
    pub planned_slots: u64,
    /// Sensor nodes.
    pub sensors: usize,
}

/// Running sums that follow from the records of the slots.
#[derive(Debug)]
pub struct RunSums {
    /// What is known before slot 1.
    pub labels: MissionLabels,
    /// Slots so far.
    pub slots: u64,
    /// The ledger so far.
    pub totals: Totals,
    /// The first time at whose end all initial data is delivered [s].
    pub completed_s: Option<f64>,
    /// Whether all UAVs are in the base and none is down; `None` without a base.
    pub landed: Option<bool>,
    /// What several UAVs did together; `None` with one.
    pub fleet: Option<FleetUse>,
    /// Samples of the ring that were refused.
    pub refused_messages: u64,
    /// Restarts of processes.
    pub restarts: u64,
    /// The first events of the processes.
    pub events: Vec<Event>,
    /// The slot after which the run was resumed.
    pub resumed_after: Option<u64>,
    rate: LossRate,
    expires: bool,
    losses: Option<Losses>,
    gaps: ServiceGaps,
    /// Whether all data is there before slot 1.
    is_initial: bool,
    /// Of what the costs of ages are a part; `None` where only bits count.
    objective: Option<ObjectiveWeights>,
    served: u64,
    uavs: usize,
    /// By UAV; `None` without a battery.
    energy: ByUav<Option<EnergyUse>>,
    base: Option<Base>,
    slot_s: f64,
    pace: Option<Pace>,
    missed_deadlines: u64,
    plan_ns: Histogram<u64>,
    latency: Option<Latency>,
}

/// Sums of a mission that need its field.
#[derive(Debug)]
pub struct FieldSums<'a> {
    /// Length of a slot [s].
    pub slot_s: f64,
    /// Length of the flights [m].
    pub flown_m: f64,
    /// Energy of the flights [J].
    pub energy_j: f64,
    /// Time in which contacts were set up [s]; NaN if they take none.
    pub setup_s: f64,
    /// Whether the UAVs stay in one part of the area.
    pub is_trapped: bool,
    /// Whether ages have a limit.
    pub has_deadline: bool,
    /// The ages since the last service [slots].
    pub service_ages: AgeCounts,
    /// The ages of the delivered data [slots].
    pub data_ages: AgeCounts,
    /// The sums over the gaps between services.
    pub gaps: GapSums,
    /// The bits delivered by each sensor node.
    pub delivered_bits: &'a [u64],
    /// What the mission costs where only bits count, by weight [bit]: those lost, or not delivered.
    pub cost_of_bits: f64,
    /// The bounds; only `offline` has them.
    pub bounds: Option<MissionBounds>,
}

/// What the figures of a mission are computed from.
#[derive(Debug)]
pub struct MissionSums<'a> {
    /// The sums that follow from the records of the slots.
    pub run: &'a RunSums,
    /// Those that need the field, which only a mission in one process has.
    pub field: Option<FieldSums<'a>>,
    /// The wall-clock figures.
    pub timing: RunTiming,
    /// Chained hash of the trace.
    pub trace_hash: u64,
}

impl MissionSums<'_> {
    /// A figure of the field; `None` without it.
    pub fn of_field(&self, of: impl Fn(&FieldSums<'_>) -> f64) -> Option<f64> {
        self.field.as_ref().map(of)
    }

    /// A figure of the batteries of the sensor nodes; `None` if they have none.
    pub fn of_nodes<T>(&self, of: impl Fn(&NodeEnergyUse) -> Option<T>) -> Option<T> {
        self.run.node_energy().as_ref().and_then(of)
    }

    /// A figure of the batteries of the UAVs; `None` without them.
    pub fn of_batteries<T>(&self, of: impl Fn(&EnergyUse) -> T) -> Option<T> {
        self.run.energy().as_ref().map(of)
    }

    /// A bound of the mission; `None` if it has none.
    pub fn of_bounds(&self, of: impl Fn(&MissionBounds) -> Option<f64>) -> Option<f64> {
        self.field.as_ref()?.bounds.as_ref().and_then(of)
    }
}

/// A slot for the figures that are counted.
#[derive(Debug)]
pub struct CountedSlot<'a> {
    /// The slot.
    pub record: &'a SlotRecord,
}

impl CountedSlot<'_> {
    /// Number of UAVs that flew in this mode.
    pub fn flown(&self, mode: Mode) -> u64 {
        self.record.flights().iter().filter(|flight| flight.flown_mode() == mode).count() as u64
    }

    /// Requests that were refused.
    pub fn refused(&self) -> u64 {
        self.record.flights().iter().map(|flight| u64::from(flight.refused)).sum()
    }

    /// The plans that were there when the slot began.
    pub fn plans(&self) -> impl Iterator<Item = &Plan> {
        self.record.uavs().filter(|row| !is_late(row.flight)).filter_map(|row| row.plan)
    }
}

impl RunSums {
    /// The sums before slot 1 of a run flown like `mode`. A run with a pace also measures latencies.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList, mode: &RunMode) -> Self {
        let uavs = scenario.uav.uavs();
        let objective = Settings::of(scenario).ok().map(|settings| settings.objective);
        let base = scenario.landing_base();
        let pad_wait_s = base.as_ref().filter(|base| !base.sites().is_empty()).map(|_| 0.0);
        let full = |battery: Battery| {
            let full = EnergyUse { left_j: battery.initial_j, pad_wait_s, ..EnergyUse::default() };
            (!battery.is_endless()).then_some(full)
        };
        Self {
            labels: MissionLabels {
                name: scenario.name.clone(),
                strategy: mode.external_planner.as_ref().unwrap_or(&scenario.planner.strategy).clone(),
                external: mode.external.clone(),
                seed: scenario.seed,
                planned_slots: scenario.slots,
                sensors: list.sensors().len(),
            },
            slots: 0,
            totals: Totals::default(),
            completed_s: None,
            landed: base.as_ref().map(|base| scenario.starts().all(|start| base.contains(&start.xy()))),
            fleet: (uavs > 1).then(|| FleetUse { uavs, ..FleetUse::default() }),
            refused_messages: 0,
            restarts: 0,
            events: Vec::new(),
            resumed_after: None,
            rate: list.loss_rate(scenario),
            expires: scenario.sensors.expiry_s.is_some(),
            losses: Losses::new(scenario, list),
            gaps: ServiceGaps::of(scenario, list),
            is_initial: list.sensors().iter().all(|sensor| sensor.sampling_bps == 0.0),
            objective: objective.filter(|objective| !objective.is_loss()).and_then(PlanningObjective::weights),
            served: 0,
            uavs,
            energy: scenario.by_uav(Battery::of).map(full).collect(),
            base,
            slot_s: scenario.slot_s,
            pace: mode.pace,
            missed_deadlines: 0,
            plan_ns: histogram(),
            latency: mode.pace.map(|pace| Latency::new(pace, scenario.slot_s)),
        }
    }

    /// Marks the slots added so far as recorded by an earlier run that is now resumed.
    pub(crate) fn resume(&mut self) {
        if let Some(fleet) = &mut self.fleet {
            fleet.contended = 0;
        }
        self.plan_ns.reset();
        self.resumed_after = Some(self.slots);
    }

    /// Adds the send times of the samples of a slot.
    pub fn add_times(&mut self, times: SlotTimes) {
        if let Some(latency) = &mut self.latency {
            latency.add(times);
        }
    }

    /// Sets the number of samples refused so far.
    pub fn set_refused_messages(&mut self, refused_messages: u64) {
        self.refused_messages = refused_messages;
    }

    /// Adds an event of a process. After the first 10 000 events only restarts are counted.
    pub fn add_event(&mut self, event: Event, is_restart: bool) {
        self.restarts += u64::from(is_restart);
        if self.events.len() < MAX_EVENTS {
            self.events.push(event);
        }
    }

    /// The last recorded slot; 0 before the first.
    pub fn last_slot(&self) -> u64 {
        self.slots
    }

    /// Slots whose plan had not arrived when they began.
    pub fn missed_deadlines(&self) -> u64 {
        self.missed_deadlines
    }

    /// The sums over the gaps between the services so far.
    pub fn gaps(&self) -> &ServiceGaps {
        &self.gaps
    }

    /// The loss rate so far, `η` (decisions D3 and D24); 0 without sampling.
    pub fn loss_rate(&self) -> f64 {
        self.rate.after(self.slots, &self.totals)
    }

    /// The loss rate so far by the weights of the sensor nodes; `None` where all are equal.
    pub fn weighted_loss_rate(&self) -> Option<f64> {
        let losses = self.losses.as_ref()?;
        Some(ratio(losses.weighted_bits()?, losses.weighted_sampled_bits()))
    }

    /// The loss rate of the paper so far; 0 before slot 1.
    pub fn eta_letter(&self) -> f64 {
        ratio(self.totals.lost_slots, self.slots as f64)
    }

    /// Bits lost so far, by the weights of the sensor nodes where they differ.
    pub fn lost_bits(&self) -> f64 {
        let weighted_bits = self.losses.as_ref().and_then(Losses::weighted_bits);
        weighted_bits.unwrap_or(self.totals.lost_bits as f64)
    }

    /// Bits lost so far because of their age; `None` where none expire.
    pub fn expired_bits(&self) -> Option<u64> {
        let cohorts = || self.features()?.find::<Cohorts>();
        self.expires.then(|| cohorts().map_or(0, Cohorts::expired_bits))
    }

    /// What the slots so far cost by `planner.objective` (decision D36); `None` where only bits count.
    pub fn objective(&self) -> Option<f64> {
        let objective = self.objective.as_ref()?;
        let of_ages = self.gaps.cost(objective, self.slots, self.slot_s);
        Some(objective.of_bits() * self.lost_bits() + of_ages)
    }

    /// Bits delivered per slot and UAV.
    pub fn bits_per_waypoint(&self) -> f64 {
        ratio(self.totals.delivered_bits as f64, self.slots as f64 * self.uavs as f64)
    }

    /// Sensor nodes served per slot.
    pub fn mean_served(&self) -> f64 {
        ratio(self.served as f64, self.slots as f64)
    }

    /// The fraction of all bits that is delivered; 0 if there were none.
    pub fn collection_ratio(&self) -> f64 {
        let Totals { initial_bits, sampled_bits, delivered_bits, .. } = self.totals;
        ratio(delivered_bits as f64, initial_bits as f64 + sampled_bits as f64)
    }

    /// The score so far; `None` where sensor nodes sample, or hold nothing.
    pub fn score(&self) -> Option<f64> {
        let planned_slots = self.labels.planned_slots as f64;
        let left_s = self.completed_s.map_or(0.0, |done_s| planned_slots * self.slot_s - done_s);
        self.has_score().then(|| score(left_s, self.collection_ratio()))
    }

    /// What the batteries of the UAVs gave and took so far; `None` without them.
    pub fn energy(&self) -> Option<EnergyUse> {
        let uses: ByUav<EnergyUse> = self.energy.iter().copied().flatten().collect();
        (!uses.is_empty()).then(|| EnergyUse::sum(&uses))
    }

    /// What the batteries of the sensor nodes gave so far; `None` without them.
    pub fn node_energy(&self) -> Option<NodeEnergyUse> {
        Some(self.features()?.find::<Charges>()?.summed_up(self.totals.delivered_bits))
    }

    /// Services refused so far for want of airtime; `None` where it has no limit.
    pub fn refused_duty(&self) -> Option<u64> {
        Some(self.features()?.find::<Airtime>()?.refused())
    }

    /// The wall-clock figures so far, after the wall time `wall`.
    pub(crate) fn timing(&self, wall: Duration) -> RunTiming {
        let plan = Spread::of(&self.plan_ns);
        let slots = self.slots as f64 - self.resumed_after.unwrap_or(0) as f64;
        RunTiming {
            pace: self.pace,
            wall_s: wall.as_secs_f64(),
            slots_per_s: ratio(slots, wall.as_secs_f64()),
            missed_deadlines: self.missed_deadlines,
            late_slots: self.latency.as_ref().map_or(0, |latency| latency.late_slots),
            plan_p50_us: plan.p50_us,
            plan_p99_us: plan.p99_us,
            plan_p999_us: plan.p999_us,
            plan_max_us: plan.max_us,
            latency: self.latency.as_ref().and_then(Latency::spreads),
        }
    }

    /// Adds a slot.
    pub(crate) fn add(&mut self, slot: &CountedSlot<'_>) {
        let record = slot.record;
        self.totals = record.header.totals;
        self.slots += 1;
        if self.has_score() && self.totals.delivered_bits == self.totals.initial_bits {
            self.completed_s.get_or_insert(self.slots as f64 * self.slot_s);
        }
        if let Some(losses) = &mut self.losses {
            losses.add(record);
        }
        self.add_services(record.flights());
        for (energy, flight) in self.energy.iter_mut().zip(record.flights()) {
            energy.iter_mut().for_each(|energy| energy.add(self.slots, self.slot_s, flight));
        }
        self.missed_deadlines += record.flights().iter().filter(|flight| is_late(flight)).count() as u64;
        slot.plans().for_each(|plan| self.plan_ns.saturating_record(plan.plan_ns));
        let has_landed = |flight: &FlightReport, base: &Base| {
            base.contains(&flight.position().xy()) && flight.flown_mode() != Mode::Down
        };
        let base = self.base.as_ref();
        self.landed = base.map(|base| record.flights().iter().all(|flight| has_landed(flight, base)));
        if let Some(fleet) = &mut self.fleet {
            fleet.add(record, base);
        }
    }

    fn features(&self) -> Option<&NodeFeatures> {
        self.losses.as_ref().map(|losses| losses.ledger.features())
    }

    /// Whether all data is there before slot 1, and there is some.
    fn has_score(&self) -> bool {
        self.is_initial && self.totals.initial_bits > 0
    }

    /// Adds the services of a slot that were answered.
    fn add_services(&mut self, flights: &[FlightReport]) {
        let ledger = self.losses.as_ref().map(|losses| &losses.ledger);
        let has_answered = |sensor: u32| ledger.is_none_or(|ledger| ledger.has_answered(sensor));
        for link in uploads(flights).filter(|link| has_answered(link.sensor)) {
            self.served += 1;
            self.gaps.serve(link.sensor as usize, self.slots);
        }
    }
}

/// `part / whole`; 0 if `whole` is not positive.
fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}
