//! What a run comes to: tallied slot by slot, written as `summary.json`.

use std::time::Duration;

use hdrhistogram::Histogram;
use serde::Serialize;
use skysink_common::message::{FlightReport, HoldReason, Mode, Plan, QueuesHeader, SolverOutcome, Totals};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

use crate::latency::{Latencies, Latency, SlotTimes};

/// What has become of a process, as in `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Event {
    /// The slot under way.
    pub slot: u64,
    /// Wall time since the run began [s].
    pub at_s: f64,
    /// The process.
    pub process: &'static str,
    /// What has become of it.
    pub event: String,
}

/// The figures of a run, as in `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the scenario.
    pub name: String,
    /// Strategy flown.
    pub strategy: String,
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
    /// `Σ_i Σ_t D_i(t) / (s_i τ T)`, the letter's figure, which grows with N (decision D3).
    pub eta_letter: f64,
    /// Bits before slot 1.
    pub initial_bits: u64,
    /// Bits sampled.
    pub sampled_bits: u64,
    /// Bits uploaded.
    pub delivered_bits: u64,
    /// Bits lost.
    pub lost_bits: u64,
    /// Bits queued at the end.
    pub queued_bits: u64,
    /// Bits uploaded per slot.
    pub bits_per_waypoint: f64,
    /// Sensor nodes served per slot.
    pub mean_served: f64,
    /// Slots in which the UAV held its position.
    pub held_slots: u64,
    /// Slots in which it was on its way (decision D8).
    pub transit_slots: u64,
    /// Requests of plans that were refused.
    pub refused: u64,
    /// Waypoints found by the geometric solver because the chosen one failed.
    pub solver_fallbacks: u64,
    /// Samples of the ring that were refused: of another run, a second writer, or a slot that cannot be.
    pub refused_messages: u64,
    /// How often a process was started again.
    pub restarts: u64,
    /// What has become of the processes.
    pub events: Vec<Event>,
    /// The slot after which the run was resumed; counts of wall time begin there.
    pub resumed_after: Option<u64>,
    /// Chained hash (XXH3) of the lines of `slots.csv`: equal for equal traces.
    pub trace_hash: String,
    /// Whether all slots were flown.
    pub complete: bool,
    /// Version of Skysink.
    pub version: &'static str,
    /// By the wall clock; different each time.
    pub timing: Timing,
}

/// The wall-clock figures of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Timing {
    /// Pace, or none in one process.
    pub pace: Option<Pace>,
    /// Duration [s], from the first slot to the last.
    pub wall_s: f64,
    /// Slots per second.
    pub slots_per_s: f64,
    /// Slots whose plan was not there when they began.
    pub missed_deadlines: u64,
    /// Slots that began late, because the ring could not keep up with the clock.
    pub late_slots: u64,
    /// Planning time, median [µs].
    pub plan_p50_us: f64,
    /// Planning time, 99th percentile [µs].
    pub plan_p99_us: f64,
    /// Planning time, longest [µs].
    pub plan_max_us: f64,
    /// From sample to sample; none in one process.
    pub latency: Option<Latencies>,
}

/// Longest planning time that is told apart [ns].
const HOUR_NS: u64 = 3_600_000_000_000;

/// Running sums of a run.
#[derive(Debug)]
pub struct Tally {
    name: String,
    strategy: String,
    seed: u64,
    planned_slots: u64,
    sensors: usize,
    /// Bits that the field samples in a slot on average, `Σ_i s_i τ`.
    mean_bits: f64,
    slots: u64,
    served: u64,
    held_slots: u64,
    transit_slots: u64,
    refused: u64,
    solver_fallbacks: u64,
    missed_deadlines: u64,
    late_slots: u64,
    refused_messages: u64,
    resumed_after: Option<u64>,
    totals: Totals,
    plan_ns: Histogram<u64>,
    latency: Option<Latency>,
}

impl Tally {
    /// Nothing flown yet.
    ///
    /// # Panics
    /// Never: the histogram's bounds are valid.
    #[must_use]
    pub fn new(scenario: &Scenario, list: &SensorList) -> Self {
        Self {
            name: scenario.name.clone(),
            strategy: scenario.planner.strategy.clone(),
            seed: scenario.seed,
            planned_slots: scenario.slots,
            sensors: list.sensors().len(),
            mean_bits: list.sensors().iter().map(|sensor| sensor.sampling_bps * scenario.slot_s).sum(),
            slots: 0,
            served: 0,
            held_slots: 0,
            transit_slots: 0,
            refused: 0,
            solver_fallbacks: 0,
            missed_deadlines: 0,
            late_slots: 0,
            refused_messages: 0,
            resumed_after: None,
            totals: Totals::default(),
            plan_ns: Histogram::new_with_bounds(1, HOUR_NS, 3).expect("valid bounds and digits"),
            latency: None,
        }
    }

    /// Measures latencies, too, at a pace.
    #[must_use]
    pub fn with_latency(mut self, pace: Pace, slot_s: f64) -> Self {
        self.latency = Some(Latency::new(pace, slot_s));
        self
    }

    /// What was added so far was on record before this run.
    pub fn resume(&mut self) {
        self.resumed_after = Some(self.slots);
    }

    /// Takes over the state before slot 1.
    pub fn start(&mut self, header: &QueuesHeader) {
        self.totals = header.totals;
    }

    /// Adds a slot.
    pub fn add(&mut self, plan: Option<&Plan>, flight: &FlightReport, header: &QueuesHeader) {
        self.slots += 1;
        self.served += u64::from(flight.served);
        self.refused += u64::from(flight.refused);
        match Mode::of_code(flight.mode) {
            Mode::Hold => self.held_slots += 1,
            Mode::Transit => self.transit_slots += 1,
            Mode::Serve => {}
        }
        self.missed_deadlines += u64::from(HoldReason::of_code(flight.hold) == HoldReason::NoPlan);
        if let Some(plan) = plan {
            self.solver_fallbacks += u64::from(SolverOutcome::of_code(plan.solver) == SolverOutcome::Fallback);
            self.plan_ns.saturating_record(plan.plan_ns.max(1));
        }
        self.totals = header.totals;
    }

    /// Adds when the samples of the slot were sent.
    pub fn add_times(&mut self, times: SlotTimes) {
        if let Some(latency) = &mut self.latency {
            latency.add(times);
        }
    }

    /// Takes over how many samples were refused.
    pub fn set_refused_messages(&mut self, refused_messages: u64) {
        self.refused_messages = refused_messages;
    }

    /// Takes over how many slots have begun late.
    pub fn set_late_slots(&mut self, late_slots: u64) {
        self.late_slots = late_slots;
    }

    /// The last slot on record; 0 before the first.
    #[must_use]
    pub fn last_slot(&self) -> u64 {
        self.slots
    }

    /// Slots flown.
    #[must_use]
    pub fn slots(&self) -> u64 {
        self.slots
    }

    /// Slots whose plan was not there when they began.
    #[must_use]
    pub fn missed_deadlines(&self) -> u64 {
        self.missed_deadlines
    }

    /// The loss rate so far, `η` (decision D3); 0 where nothing is sampled.
    #[must_use]
    pub fn loss_rate(&self) -> f64 {
        ratio(self.totals.lost_bits as f64, self.mean_bits * self.slots as f64)
    }

    /// The figures of the run so far.
    #[must_use]
    pub fn summary(&self, pace: Option<Pace>, wall: Duration, trace_hash: u64) -> Summary {
        let (slots, totals) = (self.slots as f64, self.totals);
        let plan_us = |quantile| self.plan_ns.value_at_quantile(quantile) as f64 / 1e3;
        Summary {
            name: self.name.clone(),
            strategy: self.strategy.clone(),
            seed: self.seed,
            slots: self.slots,
            planned_slots: self.planned_slots,
            sensors: self.sensors,
            loss_rate: self.loss_rate(),
            eta_letter: ratio(totals.lost_slots, slots),
            initial_bits: totals.initial_bits,
            sampled_bits: totals.sampled_bits,
            delivered_bits: totals.delivered_bits,
            lost_bits: totals.lost_bits,
            queued_bits: totals.queued_bits,
            bits_per_waypoint: ratio(totals.delivered_bits as f64, slots),
            mean_served: ratio(self.served as f64, slots),
            held_slots: self.held_slots,
            transit_slots: self.transit_slots,
            refused: self.refused,
            solver_fallbacks: self.solver_fallbacks,
            refused_messages: self.refused_messages,
            restarts: 0,
            events: Vec::new(),
            resumed_after: self.resumed_after,
            trace_hash: format!("{trace_hash:016x}"),
            complete: self.slots == self.planned_slots,
            version: env!("CARGO_PKG_VERSION"),
            timing: Timing {
                pace,
                wall_s: wall.as_secs_f64(),
                slots_per_s: ratio(slots - self.resumed_after.unwrap_or(0) as f64, wall.as_secs_f64()),
                missed_deadlines: self.missed_deadlines,
                late_slots: self.late_slots,
                plan_p50_us: plan_us(0.5),
                plan_p99_us: plan_us(0.99),
                plan_max_us: self.plan_ns.max() as f64 / 1e3,
                latency: self.latency.as_ref().and_then(Latency::spreads),
            },
        }
    }
}

/// A share of something, 0 where there is nothing.
fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}
