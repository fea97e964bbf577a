//! Compares every replayed slot and its plan with the trace.

use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use serde::Serialize;
use skysink_common::csv_cell::decimal;
use skysink_common::message::{FlightReport, Mode, Plan};
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::{SlotRecord, UAV};
use skysink_flight_sim::Flight;
use skysink_mission::MissionError;
use skysink_mission::drive::SlotSink;
use skysink_mission::error::FileContext;
use skysink_mission::files::write_unfinished;
use skysink_mission::recorded::slot_of;
use skysink_mission::replay::RecordedRun;
use skysink_mission::trace::{RecordedSlot, TraceHash};
use tempfile::NamedTempFile;

use crate::error::Error;
use crate::run::recorder::RingTrace;

/// Header of `plans.csv`.
const COLUMNS: &str = "slot,uav,x_m,y_m,z_m,scheduled,mode,refused,expected_bits,distance_m,same\n";

/// Comparison of the plans with the recorded decisions.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PlanCounts {
    /// Slots of the run.
    pub slots: u64,
    /// Slots in which the plan leads to the recorded position and serves the recorded sensor nodes.
    pub same: u64,
    /// Slots without a recorded decision: the UAV held its position because no plan was in time or feasible.
    pub undecided: u64,
    /// The first slot whose plan differs.
    pub first_difference: Option<u64>,
    /// Slots in which the plan would hold the UAV, because its waypoint is refused or there is no plan.
    pub held_slots: u64,
    /// Requests of the plans that would be refused.
    pub refused: u64,
    /// Mean distance from the recorded to the planned position, over the slots with a decision [m].
    pub mean_distance_m: f64,
}

/// The comparison of a running replay with its record.
pub struct Replayed<'a> {
    recorded: &'a RecordedRun,
    trace: TraceHash,
    /// Simulates each plan from the recorded state before its slot.
    flight: Flight,
    counts: PlanCounts,
    distance_m: f64,
    /// The final path of `plans.csv`.
    path: PathBuf,
    /// The plans so far, in a temporary file.
    csv: BufWriter<NamedTempFile>,
}

impl<'a> Replayed<'a> {
    /// Starts the comparison. [`Replayed::finish`] creates the file `path`.
    pub fn new(scenario: &Scenario, recorded: &'a RecordedRun, path: &Path) -> Result<Self, Error> {
        let csv = BufWriter::new(write_unfinished(path, COLUMNS.as_bytes()).at(path)?);
        Ok(Self {
            recorded,
            trace: TraceHash::default(),
            flight: Flight::new(scenario, &recorded.list.nodes()),
            counts: PlanCounts::default(),
            distance_m: 0.0,
            path: path.to_owned(),
            csv,
        })
    }

    /// Writes `plans.csv`, and returns the counts and the hash of the trace.
    pub fn finish(self) -> Result<(PlanCounts, u64), Error> {
        let csv = self.csv.into_inner().map_err(std::io::IntoInnerError::into_error).at(&self.path)?;
        csv.persist(&self.path).map_err(std::io::Error::from).at(&self.path)?;
        let decided = self.counts.slots - self.counts.undecided;
        let mean_distance_m = if decided > 0 { self.distance_m / decided as f64 } else { 0.0 };
        Ok((PlanCounts { mean_distance_m, ..self.counts }, self.trace.value()))
    }

    /// Compares the plan of a slot with the recorded decision and writes its row.
    fn compare(&mut self, recorded: &RecordedSlot, plan: Option<&Plan>) -> std::io::Result<()> {
        let RecordedSlot { slot, uav, .. } = *recorded;
        self.counts.slots += 1;
        let is_decided = recorded.mode != Mode::Hold;
        self.counts.undecided += u64::from(!is_decided);
        let planned = self.flight.step(slot, plan);
        self.counts.held_slots += u64::from(planned.flown_mode() == Mode::Hold);
        self.counts.refused += u64::from(planned.refused);
        let distance_m = (planned.position() - recorded.position).norm();
        let served = planned.served_links().iter().map(|link| link.sensor);
        let is_same = is_decided
            && distance_m == 0.0
            && served.clone().eq(recorded.scheduled.iter().copied())
            && Mode::from_repr(planned.mode) == Some(recorded.mode);
        if is_decided {
            self.counts.same += u64::from(is_same);
            self.distance_m += distance_m;
            if !is_same {
                self.counts.first_difference.get_or_insert(slot);
            }
        }
        let scheduled = served.map(|sensor| sensor.to_string()).collect::<Vec<_>>().join(" ");
        let mode = Mode::from_repr(planned.mode).unwrap_or_default();
        let expected_bits = plan.map_or(0, |plan| plan.expected_bits);
        let FlightReport { x_m, y_m, z_m, refused, .. } = planned;
        let distance_m = decimal(distance_m);
        let same = if is_decided { is_same.to_string() } else { String::new() };
        writeln!(
            self.csv,
            "{slot},{uav},{x_m},{y_m},{z_m},{scheduled},{mode},{refused},{expected_bits},{distance_m},{same}"
        )
    }
}

impl SlotSink for Replayed<'_> {
    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
        let recorded = slot_of(&self.recorded.slots, record.slot());
        let Some(recorded) = recorded.filter(|recorded| **recorded == RecordedSlot::by_uav(record)) else {
            return Err(Error::ReplayDiverged(record.slot()).into());
        };
        self.trace.add(record)?;
        self.compare(&recorded[UAV], record.plans()[UAV].as_ref()).at(&self.path)?;
        self.flight.restore(&record.flights()[UAV]);
        Ok(())
    }
}

impl RingTrace for Replayed<'_> {
    fn hash(&self) -> u64 {
        self.trace.value()
    }
}
