//! The summary of a run, collected slot by slot and written as `summary.json`.

mod uses;

use std::borrow::Cow;
use std::time::Duration;

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use skysink_common::base::Base;
use skysink_common::battery::Battery;
use skysink_common::build::{VERSION, build};
use skysink_common::message::{FlightReport, HoldReason, Mode, QueuesHeader, SolverOutcome, Totals};
use skysink_common::nodes::energy::NodeEnergyUse;
use skysink_common::nodes::{Airtime, Charges, Cohorts};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{ByUav, SlotRecord, UavSlot, uploads};
use skysink_planner::settings::{ObjectiveWeights, PlanningObjective, Settings};

use crate::drive::SlotSink;
use crate::error::MissionError;
use crate::latency::{Latencies, Latency, SlotTimes, Spread, histogram};
use crate::losses::Losses;
use crate::origin::RunMode;
use crate::service_gaps::ServiceGaps;

pub use uses::{EnergyUse, FleetUse, OperatorUse, score};

/// Most events in a summary.
const MAX_EVENTS: usize = 10_000;

/// An event of a process, as in `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// The current slot.
    pub slot: u64,
    /// Wall time since the run began [s].
    pub at_s: f64,
    /// The process.
    pub process: Cow<'static, str>,
    /// Description of the event.
    pub event: String,
}

/// The results of a run, as in `summary.json`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Name of the scenario.
    pub name: String,
    /// Strategy, or the label of an external planner.
    pub strategy: String,
    /// Roles of external processes; a strategy in Python is an external planner.
    #[serde(default)] // runs of older builds do not say
    pub external: Vec<String>,
    /// Seed.
    pub seed: u64,
    /// Slots flown.
    pub slots: u64,
    /// Slots of the scenario.
    pub planned_slots: u64,
    /// Sensor nodes.
    pub sensors: usize,
    /// `η = Σ_t Σ_i D_i(t) / (Σ_i s_i τ T)` (decision D3).
    pub loss_rate: f64,
    /// `Σ_i Σ_t D_i(t) / (s_i τ T)`, the loss rate of the paper, which grows with N (decision D3).
    pub eta_letter: f64,
    /// `η_w = Σ_t Σ_i w_i D_i(t) / (Σ_i w_i s_i τ T)` (decision D25); `None` where all weights are equal: it is then
    /// `η`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weighted_loss_rate: Option<f64>,
    /// What the flight costs by `planner.objective` (decision D36); `None` where that is the loss, or what is
    /// collected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub objective: Option<f64>,
    /// Bits before slot 1, sampled, uploaded, lost, and queued at the end.
    #[serde(flatten)]
    pub totals: Totals,
    /// Bits lost because they were older than `sensors.expiry_s`, a part of `lost_bits`; `None` without that key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expired_bits: Option<u64>,
    /// What the batteries of the sensor nodes gave, and which are dead (decision D33); `None` without
    /// `[sensors.energy]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node_energy: Option<NodeEnergyUse>,
    /// Services that were refused because the sensor node had no airtime left; `None` without `link.duty_cycle`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused_duty: Option<u64>,
    /// The time at whose end all initial data is delivered [s]; `None` if some is left, or where sensor nodes sample.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completed_s: Option<f64>,
    /// 100 times the fraction delivered, and the seconds left after `completed_s`; `None` where sensor nodes sample, or
    /// hold nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub score: Option<f64>,
    /// Bits uploaded per slot.
    pub bits_per_waypoint: f64,
    /// Sensor nodes served per slot.
    pub mean_served: f64,
    /// Delivered ÷ (initial + sampled) bits; 0 if there were none.
    #[serde(default)] // runs of older builds have none
    pub collection_ratio: f64,
    /// Whether all UAVs are in the base at the end, and none is down (decision D9); `None` without a base.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub landed: Option<bool>,
    /// What the battery gave and took; `None` without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub energy: Option<EnergyUse>,
    /// What several UAVs did together; `None` with one. All other figures are sums over them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fleet: Option<FleetUse>,
    /// What became of the changes that the searches of `horizon` and `offline` proposed, by operator; empty without a
    /// search, and from a planner on another host.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub search: Vec<OperatorUse>,
    /// Slots in which the UAV held its position.
    pub held_slots: u64,
    /// Slots in transit (decision D8).
    pub transit_slots: u64,
    /// Requests of plans that were refused.
    pub refused: u64,
    /// Waypoints that the chosen solver did not find: those of the geometric solver, or the centre that `exact` found.
    pub solver_fallbacks: u64,
    /// Refused samples of the ring: of another run, a second writer, or an impossible slot.
    pub refused_messages: u64,
    /// Restarts of processes.
    pub restarts: u64,
    /// Events of the processes.
    pub events: Vec<Event>,
    /// The slot after which the run was resumed; wall times count from there.
    pub resumed_after: Option<u64>,
    /// Chained hash (XXH3) of the lines of `slots.csv`: equal for equal traces.
    pub trace_hash: String,
    /// Whether all slots were flown.
    pub complete: bool,
    /// Version of Skysink.
    pub version: Cow<'static, str>,
    /// Commit, compiler and target of the program that has written it.
    #[serde(default)] // runs of older builds have none
    pub build: Cow<'static, str>,
    /// Wall-clock figures; not reproducible.
    pub timing: RunTiming,
}

impl Summary {
    /// Replaces the figures that follow from the scenario and the trace by those of `again`, which has flown the trace
    /// again.
    pub(crate) fn recompute(&mut self, again: Self) {
        let run = std::mem::take(self);
        let contended = run.fleet.map_or(0, |fleet| fleet.contended);
        *self = Self {
            fleet: again.fleet.map(|fleet| FleetUse { contended, ..fleet }),
            // What only the run could know, or decides which figures it has.
            solver_fallbacks: run.solver_fallbacks,
            refused_messages: run.refused_messages,
            restarts: run.restarts,
            search: run.search,
            events: run.events,
            resumed_after: run.resumed_after,
            complete: run.complete,
            version: run.version,
            build: run.build,
            timing: run.timing,
            ..again
        };
    }
}

/// The wall-clock figures of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RunTiming {
    /// Pace; `None` in one process.
    pub pace: Option<Pace>,
    /// Duration [s], from the first slot to the last.
    pub wall_s: f64,
    /// Slots per second.
    pub slots_per_s: f64,
    /// Slots whose plan had not arrived when they began, including those before a resumption.
    pub missed_deadlines: u64,
    /// Slots that began late, because the ring did not keep up with the clock.
    pub late_slots: u64,
    /// Planning time, median [µs].
    pub plan_p50_us: f64,
    /// Planning time, 99th percentile [µs].
    pub plan_p99_us: f64,
    /// Planning time, 99.9th percentile [µs].
    #[serde(default)] // runs of older builds have none
    pub plan_p999_us: f64,
    /// Planning time, longest [µs].
    pub plan_max_us: f64,
    /// Latencies between samples; `None` in one process.
    pub latency: Option<Latencies>,
}

/// Running sums from which the summary of a run is computed.
#[derive(Debug)]
pub struct Tally {
    summary: Summary,
    /// Mean bits sampled per slot by the field, `Σ_i s_i τ`; `None` if arrivals are drawn.
    mean_bits: Option<f64>,
    /// Bits of the initial queues that may expire.
    expiring_bits: f64,
    losses: Option<Losses>,
    gaps: ServiceGaps,
    /// Whether all data is there before slot 1.
    is_initial: bool,
    /// Of what the costs of ages are a part; `None` where only bits count.
    objective: Option<ObjectiveWeights>,
    served: u64,
    uavs: usize,
    /// By UAV; empty without batteries.
    energy: ByUav<EnergyUse>,
    base: Option<Base>,
    slot_s: f64,
    plan_ns: Histogram<u64>,
    latency: Option<Latency>,
}

impl Tally {
    /// The sums before slot 1 of a run flown like `mode`. A run with a pace also measures latencies.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList, mode: &RunMode) -> Self {
        let uavs = scenario.uav.uavs();
        let objective = Settings::of(scenario).ok().map(|settings| settings.objective);
        let base = scenario.landing_base();
        let pad_wait_s = base.as_ref().filter(|base| !base.sites().is_empty()).map(|_| 0.0);
        let battery = Battery::of(scenario);
        let full = EnergyUse { left_j: battery.initial_j, pad_wait_s, ..EnergyUse::default() };
        let energy = ByUav::from_elem(full, if battery.is_endless() { 0 } else { uavs });
        let summary = Summary {
            name: scenario.name.clone(),
            strategy: mode.external_planner.as_ref().unwrap_or(&scenario.planner.strategy).clone(),
            external: mode.external.clone(),
            seed: scenario.seed,
            planned_slots: scenario.slots,
            sensors: list.sensors().len(),
            expired_bits: scenario.sensors.expiry_s.map(|_| 0),
            version: VERSION.into(),
            build: build().into(),
            landed: base.as_ref().map(|base| scenario.starts().all(|start| base.contains(&start.xy()))),
            fleet: (uavs > 1).then(|| FleetUse { uavs, ..FleetUse::default() }),
            energy: (!energy.is_empty()).then(|| EnergyUse::sum(&energy)),
            timing: RunTiming { pace: mode.pace, ..RunTiming::default() },
            ..Summary::default()
        };
        Self {
            summary,
            mean_bits: (!scenario.arrival_law().is_random()).then(|| list.slot_bits(scenario)),
            expiring_bits: list.expiring_bits(scenario).sum(),
            losses: Losses::new(scenario, list),
            gaps: ServiceGaps::of(scenario, list),
            is_initial: list.sensors().iter().all(|sensor| sensor.sampling_bps == 0.0),
            objective: objective.filter(|objective| !objective.is_loss()).and_then(PlanningObjective::weights),
            served: 0,
            uavs,
            energy,
            base,
            slot_s: scenario.slot_s,
            plan_ns: histogram(),
            latency: mode.pace.map(|pace| Latency::new(pace, scenario.slot_s)),
        }
    }

    /// Marks the slots added so far as recorded by an earlier run that is now resumed. Figures of the solver and of
    /// planning times are those of the slots after them.
    pub fn resume(&mut self) {
        self.summary.solver_fallbacks = 0;
        if let Some(fleet) = &mut self.summary.fleet {
            fleet.contended = 0;
        }
        self.plan_ns.reset();
        self.summary.resumed_after = Some(self.summary.slots);
    }

    /// Adds the flight of the UAV number `uav` in a slot.
    fn add_flight(&mut self, uav: usize, flight: &FlightReport) {
        let summary = &mut self.summary;
        summary.refused += u64::from(flight.refused);
        match flight.flown_mode() {
            Mode::Hold => summary.held_slots += 1,
            Mode::Transit => summary.transit_slots += 1,
            _ => {}
        }
        if let Some(energy) = self.energy.get_mut(uav) {
            energy.add(summary.slots, self.slot_s, flight);
        }
        summary.timing.missed_deadlines += u64::from(is_late(flight));
    }

    /// Bits lost so far, by the weights of the sensor nodes where they differ.
    pub fn lost_bits(&self) -> f64 {
        let weighted_bits = self.losses.as_ref().and_then(Losses::weighted_bits);
        weighted_bits.unwrap_or(self.summary.totals.lost_bits as f64)
    }

    /// The sums over the gaps between the services so far.
    pub fn gaps(&self) -> &ServiceGaps {
        &self.gaps
    }

    /// What the slots so far cost by `planner.objective` (decision D36); `None` where only bits count.
    pub fn objective(&self) -> Option<f64> {
        let objective = self.objective.as_ref()?;
        let of_ages = self.gaps.cost(objective, self.summary.slots, self.slot_s);
        Some(objective.of_bits() * self.lost_bits() + of_ages)
    }

    /// Adds the send times of the samples of a slot.
    pub fn add_times(&mut self, times: SlotTimes) {
        if let Some(latency) = &mut self.latency {
            latency.add(times);
        }
    }

    /// Sets the number of samples refused so far.
    pub fn set_refused_messages(&mut self, refused_messages: u64) {
        self.summary.refused_messages = refused_messages;
    }

    /// Adds an event of a process. After the first 10 000 events only restarts are counted.
    pub fn add_event(&mut self, event: Event, is_restart: bool) {
        self.summary.restarts += u64::from(is_restart);
        if self.summary.events.len() < MAX_EVENTS {
            self.summary.events.push(event);
        }
    }

    /// The last recorded slot; 0 before the first.
    pub fn last_slot(&self) -> u64 {
        self.summary.slots
    }

    /// The ledger so far.
    pub(crate) fn totals(&self) -> Totals {
        self.summary.totals
    }

    /// Slots whose plan had not arrived when they began.
    pub fn missed_deadlines(&self) -> u64 {
        self.summary.timing.missed_deadlines
    }

    /// The loss rate so far, `η` (decisions D3 and D24); 0 without sampling.
    pub fn loss_rate(&self) -> f64 {
        let Totals { lost_bits, sampled_bits, .. } = self.summary.totals;
        let mean_bits = self.mean_bits.map(|slot_bits| slot_bits * self.summary.slots as f64);
        ratio(lost_bits as f64, mean_bits.unwrap_or(sampled_bits as f64) + self.expiring_bits)
    }

    /// The summary of the run so far, after the wall time `wall`.
    pub fn summary(&self, wall: Duration, trace_hash: u64) -> Summary {
        let mut summary = self.summary.clone();
        let slots = summary.slots as f64;
        summary.loss_rate = self.loss_rate();
        let losses = self.losses.as_ref();
        let weighted_rate = |losses: &Losses| Some(ratio(losses.weighted_bits()?, losses.weighted_sampled_bits()));
        summary.weighted_loss_rate = losses.and_then(weighted_rate);
        let features = losses.map(|losses| losses.ledger.features());
        let cohorts = features.and_then(|features| features.find::<Cohorts>());
        summary.expired_bits = summary.expired_bits.map(|none| cohorts.map_or(none, Cohorts::expired_bits));
        let charges = features.and_then(|features| features.find::<Charges>());
        summary.node_energy = charges.map(|charges| charges.summed_up(summary.totals.delivered_bits));
        let airtime = features.and_then(|features| features.find::<Airtime>());
        summary.refused_duty = airtime.map(Airtime::refused);
        summary.objective = self.objective();
        summary.eta_letter = ratio(summary.totals.lost_slots, slots);
        let Totals { initial_bits, sampled_bits, delivered_bits, .. } = summary.totals;
        summary.collection_ratio = ratio(delivered_bits as f64, initial_bits as f64 + sampled_bits as f64);
        if self.is_initial && initial_bits > 0 {
            let left_s = summary.completed_s.map_or(0.0, |done_s| summary.planned_slots as f64 * self.slot_s - done_s);
            summary.score = Some(score(left_s, summary.collection_ratio));
        }
        summary.bits_per_waypoint = ratio(summary.totals.delivered_bits as f64, slots * self.uavs as f64);
        summary.mean_served = ratio(self.served as f64, slots);
        summary.trace_hash = format!("{trace_hash:016x}");
        summary.complete = summary.slots == summary.planned_slots;
        let plan = Spread::of(&self.plan_ns);
        summary.timing = RunTiming {
            wall_s: wall.as_secs_f64(),
            slots_per_s: ratio(slots - summary.resumed_after.unwrap_or(0) as f64, wall.as_secs_f64()),
            plan_p50_us: plan.p50_us,
            plan_p99_us: plan.p99_us,
            plan_p999_us: plan.p999_us,
            plan_max_us: plan.max_us,
            late_slots: self.latency.as_ref().map_or(0, |latency| latency.late_slots),
            latency: self.latency.as_ref().and_then(Latency::spreads),
            ..summary.timing
        };
        summary
    }
}

impl SlotSink for Tally {
    fn start(&mut self, header: &QueuesHeader) {
        self.summary.totals = header.totals;
    }

    /// Adds a slot.
    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
        self.summary.totals = record.header.totals;
        self.summary.slots += 1;
        let Totals { initial_bits, delivered_bits, .. } = record.header.totals;
        if self.is_initial && initial_bits > 0 && delivered_bits == initial_bits {
            self.summary.completed_s.get_or_insert(self.summary.slots as f64 * self.slot_s);
        }
        if let Some(losses) = &mut self.losses {
            losses.add(record);
        }
        let losses = self.losses.as_ref();
        let has_answered = |sensor: u32| losses.is_none_or(|losses| losses.ledger.has_answered(sensor));
        for link in uploads(record.flights()).filter(|link| has_answered(link.sensor)) {
            self.served += 1;
            self.gaps.serve(link.sensor as usize, self.summary.slots);
        }
        for UavSlot { uav, plan, flight, .. } in record.uavs() {
            self.add_flight(uav, flight);
            if let Some(plan) = plan.filter(|_| !is_late(flight)) {
                self.summary.solver_fallbacks += u64::from(plan.solver == SolverOutcome::Fallback as u32);
                self.plan_ns.saturating_record(plan.plan_ns);
            }
        }
        let has_landed = |flight: &FlightReport, base: &Base| {
            base.contains(&flight.position().xy()) && flight.flown_mode() != Mode::Down
        };
        let base = self.base.as_ref();
        self.summary.landed = base.map(|base| record.uavs().all(|row| has_landed(row.flight, base)));
        if !self.energy.is_empty() {
            self.summary.energy = Some(EnergyUse::sum(&self.energy));
        }
        if let Some(fleet) = &mut self.summary.fleet {
            fleet.add(record, base);
        }
        Ok(())
    }
}

/// Whether the plan of this flight was not there when the slot began.
fn is_late(flight: &FlightReport) -> bool {
    flight.hold == HoldReason::NoPlan as u32
}

/// `part / whole`; 0 if `whole` is not positive.
fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Plant;
    use crate::drive::Observer;
    use skysink_common::scenario::Overrides;
    use std::path::Path;

    /// The loss rates after four slots in which nobody is served, of SNs with 50 bit per slot.
    fn loss_rates(rows: &str) -> (f64, Option<f64>) {
        let text = "name = 'x'\nslots = 4\n[sensors]\nsampling_bps = 50.0\n";
        let scenario = Scenario::parse(text, Path::new("x.toml"), Overrides::default()).unwrap();
        let text = format!("x_m,y_m,queue_bits,capacity_bits,weight\n{rows}");
        let list = SensorList::parse(&text, Path::new("l.csv"), &scenario).unwrap();
        let mut plant = Plant::new(&scenario, &list);
        let mut tally = Tally::new(&scenario, &list, &RunMode::default());
        tally.begin(&plant).unwrap();
        for _ in 0..4 {
            plant.step(&[None]);
            tally.slot(plant.record(), &plant).unwrap();
        }
        let summary = tally.summary(Duration::ZERO, 0);
        (summary.loss_rate, summary.weighted_loss_rate)
    }

    #[test]
    fn lost_bits_are_weighted_by_sensor_node() {
        // The first SN loses all its 200 bit, the second none: 200 of 400, and 3 · 200 of (3 + 1) · 200.
        assert_eq!(loss_rates("1,2,100,100,3\n3,4,0,1000,1\n"), (0.5, Some(0.75)));
        assert_eq!(loss_rates("1,2,0,1000,3\n3,4,100,100,1\n"), (0.5, Some(0.25)));
        assert_eq!(loss_rates("1,2,100,100,3\n3,4,0,1000,3\n"), (0.5, None), "equal weights are η");
    }
}
