//! The trace of a mission, `slots.csv`: how a line is written, hashed and read.

use std::fmt::Write as _;

use nalgebra::Point3;
use skysink_common::message::{FlightReport, Mode, Plan, QueuesHeader};
use skysink_common::slot_record::{ByUav, SlotRecord, UavSlot};
use skysink_flight_sim::ReportedFlight;
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::drive::SlotSink;
use crate::error::MissionError;

/// Headers of `slots.csv`: without a battery, and with one.
pub(crate) const SLOT_COLUMNS: [&str; 2] = [
    "slot,uav,x_m,y_m,z_m,scheduled,delivered_bits,lost_bits,queued_bits,mode,refused\n",
    "slot,uav,x_m,y_m,z_m,scheduled,delivered_bits,lost_bits,queued_bits,mode,refused,energy_j\n",
];

/// Computes the hash of a trace, slot by slot.
#[derive(Debug, Default)]
pub struct TraceHash {
    lines: String,
    hash: u64,
}

impl TraceHash {
    /// The hash of the lines of `slots.csv` behind the header.
    #[must_use]
    pub fn of(text: &str) -> u64 {
        chain_hashes(0, text.split_once('\n').map_or("", |(_, lines)| lines).as_bytes())
    }

    /// Formats the lines of a slot, one for each UAV, without adding them to the hash.
    ///
    /// # Errors
    /// If the ledger does not balance.
    pub fn write(&mut self, flights: &[FlightReport], header: &QueuesHeader) -> Result<&str, MissionError> {
        if !header.totals.is_balanced() {
            return Err(MissionError::Unbalanced { slot: header.head.slot, totals: header.totals });
        }
        self.lines.clear();
        let has_battery = flights.iter().any(|flight| flight.energy_j.is_finite());
        for (uav, flight) in flights.iter().enumerate() {
            write_line(&mut self.lines, uav, flight, header, has_battery).expect("a string takes everything");
        }
        Ok(&self.lines)
    }

    /// Adds the last formatted slot to the hash.
    pub fn chain(&mut self) {
        self.hash = chain_hashes(self.hash, self.lines.as_bytes());
    }

    /// The chained hash of all lines so far.
    pub fn value(&self) -> u64 {
        self.hash
    }
}

impl SlotSink for TraceHash {
    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
        self.write(record.flights(), &record.header)?;
        self.chain();
        Ok(())
    }
}

/// The hash of a trace after more lines, each with its newline; 0 before the first line.
fn chain_hashes(hash: u64, lines: &[u8]) -> u64 {
    lines.split_inclusive(|&byte| byte == b'\n').fold(hash, |hash, line| xxh3_64_with_seed(line, hash))
}

/// Writes one line of `slots.csv`: the slot of the UAV number `uav`. Floats round-trip exactly. The line holds no times
/// of a clock. The energy is empty for a UAV without a battery beside one that has one.
fn write_line(
    line: &mut String,
    uav: usize,
    flight: &FlightReport,
    header: &QueuesHeader,
    has_battery: bool,
) -> std::fmt::Result {
    write!(line, "{},{uav},{},{},{},", header.head.slot, flight.x_m, flight.y_m, flight.z_m)?;
    for (i, link) in flight.served_links().iter().enumerate() {
        let separator = if i > 0 { " " } else { "" };
        write!(line, "{separator}{}", link.sensor)?;
    }
    let QueuesHeader { delivered_bits, lost_bits, totals, .. } = header;
    let mode = flight.flown_mode();
    write!(line, ",{delivered_bits},{lost_bits},{},{mode},{}", totals.queued_bits, flight.refused)?;
    match (has_battery, flight.energy_j.is_finite()) {
        (false, _) => writeln!(line),
        (true, false) => writeln!(line, ","),
        (true, true) => writeln!(line, ",{}", flight.energy_j),
    }
}

/// The slot of a UAV, as recorded in a line of the trace.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedSlot {
    /// The slot, from 1.
    pub slot: u64,
    /// The number of the UAV.
    pub uav: usize,
    /// Position of the UAV after the slot [m].
    pub position: Point3<f64>,
    /// The served sensor nodes, ascending.
    pub scheduled: Vec<u32>,
    /// Bits uploaded in the slot.
    pub delivered_bits: u64,
    /// Bits lost in the slot.
    pub lost_bits: u64,
    /// Sum of all queues after the slot [bit].
    pub queued_bits: u64,
    /// Mode of the UAV.
    pub mode: Mode,
    /// Requests of the plan that were refused.
    pub refused: u32,
    /// Energy in the battery after the slot [J]; infinite without one.
    pub energy_j: f64,
}

impl SlotSink for Vec<ByUav<RecordedSlot>> {
    fn add(&mut self, record: &SlotRecord) -> Result<(), MissionError> {
        self.push(RecordedSlot::by_uav(record));
        Ok(())
    }
}

impl RecordedSlot {
    /// The slot of each UAV, as its line has it.
    #[must_use]
    pub fn by_uav(record: &SlotRecord) -> ByUav<Self> {
        let QueuesHeader { delivered_bits, lost_bits, totals, .. } = record.header;
        let recorded = |UavSlot { uav, flight, .. }: UavSlot<'_>| Self {
            slot: record.slot(),
            uav,
            position: flight.position(),
            scheduled: flight.served_links().iter().map(|link| link.sensor).collect(),
            delivered_bits,
            lost_bits,
            queued_bits: totals.queued_bits,
            mode: flight.flown_mode(),
            refused: flight.refused,
            energy_j: flight.energy_j,
        };
        record.uavs().map(recorded).collect()
    }

    /// Parses a line of `slots.csv`, with its newline; `None` if it is malformed.
    #[must_use]
    pub fn parse(line: &[u8]) -> Option<Self> {
        let line = std::str::from_utf8(line).ok()?.strip_suffix('\n')?;
        let columns: Vec<&str> = line.split(',').collect();
        let &[slot, uav, x_m, y_m, z_m, scheduled, delivered, lost, queued, mode, refused, ref energy @ ..] =
            &columns[..]
        else {
            return None;
        };
        let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite());
        let energy_j = match energy {
            [] | [""] => f64::INFINITY,
            [energy] => number(energy)?,
            _ => return None,
        };
        Some(Self {
            slot: slot.parse().ok()?,
            uav: uav.parse().ok()?,
            position: Point3::new(number(x_m)?, number(y_m)?, number(z_m)?),
            scheduled: scheduled.split_ascii_whitespace().map(|id| id.parse().ok()).collect::<Option<_>>()?,
            delivered_bits: delivered.parse().ok()?,
            lost_bits: lost.parse().ok()?,
            queued_bits: queued.parse().ok()?,
            mode: mode.parse().ok()?,
            refused: refused.parse().ok()?,
            energy_j,
        })
    }

    /// Whether the UAV held its position because there was no plan in time.
    pub fn is_missed(&self) -> bool {
        self.mode == Mode::Hold && self.refused == 0
    }

    /// A plan that leads to the recorded flight; `None` if there was none in time.
    pub fn decision(&self) -> Option<Plan> {
        (!self.is_missed()).then(|| self.plan())
    }

    /// A plan that leads to the recorded flight, with as many refused requests as recorded.
    pub fn plan(&self) -> Plan {
        match self.mode {
            // The refused waypoint.
            Mode::Hold => Plan { x_m: f64::NAN, ..Plan::fly_to(self.position, self.mode) },
            Mode::Down if self.refused > 0 => Plan { x_m: f64::NAN, ..Plan::fly_to(self.position, self.mode) },
            _ => self.report().plan(),
        }
    }

    /// The recorded flight as it was reported.
    pub fn report(&self) -> ReportedFlight {
        let Self { position, mode, refused, energy_j, .. } = *self;
        ReportedFlight { position, mode, served: self.scheduled.clone(), refused, energy_j }
    }
}
