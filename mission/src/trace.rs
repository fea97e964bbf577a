//! The trace of a mission, `slots.csv`: how a line is written, hashed and read.

use std::fmt::Write as _;

use nalgebra::Point3;
use skysink_common::message::{FlightReport, Mode, Plan, QueuesHeader};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::error::MissionError;

/// Header of `slots.csv`.
pub(crate) const SLOT_COLUMNS: &str = "slot,x_m,y_m,z_m,scheduled,delivered_bits,lost_bits,queued_bits,mode,refused\n";

/// Computes the hash of a trace, line by line.
#[derive(Debug, Default)]
pub struct TraceHash {
    line: String,
    hash: u64,
}

impl TraceHash {
    /// Formats the line of a slot, with its newline, without adding it to the hash.
    ///
    /// # Errors
    /// If the ledger does not balance.
    pub fn write(&mut self, flight: &FlightReport, header: &QueuesHeader) -> Result<&str, MissionError> {
        if !header.totals.is_balanced() {
            return Err(MissionError::Unbalanced { slot: header.head.slot, totals: header.totals });
        }
        self.line.clear();
        write_line(&mut self.line, flight, header).expect("a string takes everything");
        Ok(&self.line)
    }

    /// Adds the last formatted line to the hash.
    pub fn add(&mut self) {
        self.hash = chain_hash(self.hash, self.line.as_bytes());
    }

    /// The chained hash of all lines so far.
    #[must_use]
    pub fn value(&self) -> u64 {
        self.hash
    }
}

/// The hash of a trace after one more line, with its newline; 0 before the first line.
pub(crate) fn chain_hash(hash: u64, line: &[u8]) -> u64 {
    xxh3_64_with_seed(line, hash)
}

/// Writes one line of `slots.csv`. Floats round-trip exactly. The line holds no times of a clock.
fn write_line(line: &mut String, flight: &FlightReport, header: &QueuesHeader) -> std::fmt::Result {
    write!(line, "{},{},{},{},", header.head.slot, flight.x_m, flight.y_m, flight.z_m)?;
    for (i, link) in flight.served_links().iter().enumerate() {
        let separator = if i > 0 { " " } else { "" };
        write!(line, "{separator}{}", link.sensor)?;
    }
    let QueuesHeader { delivered_bits, lost_bits, totals, .. } = header;
    let mode = Mode::from_repr(flight.mode).unwrap_or_default();
    writeln!(line, ",{delivered_bits},{lost_bits},{},{mode},{}", totals.queued_bits, flight.refused)
}

/// A slot, as recorded in a line of the trace.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedSlot {
    /// The slot, from 1.
    pub slot: u64,
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
}

impl RecordedSlot {
    /// Parses a line of `slots.csv`, with its newline; `None` if it is malformed.
    #[must_use]
    pub fn parse(line: &[u8]) -> Option<Self> {
        let line = std::str::from_utf8(line).ok()?.strip_suffix('\n')?;
        let columns: Vec<&str> = line.split(',').collect();
        let &[slot, x_m, y_m, z_m, scheduled, delivered, lost, queued, mode, refused] = &columns[..] else {
            return None;
        };
        let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite());
        Some(Self {
            slot: slot.parse().ok()?,
            position: Point3::new(number(x_m)?, number(y_m)?, number(z_m)?),
            scheduled: scheduled.split_ascii_whitespace().map(|id| id.parse().ok()).collect::<Option<_>>()?,
            delivered_bits: delivered.parse().ok()?,
            lost_bits: lost.parse().ok()?,
            queued_bits: queued.parse().ok()?,
            mode: mode.parse().ok()?,
            refused: refused.parse().ok()?,
        })
    }

    /// Whether the UAV held its position because there was no plan in time.
    #[must_use]
    pub fn is_missed(&self) -> bool {
        self.mode == Mode::Hold && self.refused == 0
    }

    /// A plan that leads to the recorded flight, with as many refused requests as recorded.
    #[must_use]
    pub fn plan(&self) -> Plan {
        let mut plan = Plan::fly_to(self.position, self.mode);
        if self.mode == Mode::Hold {
            plan.x_m = f64::NAN; // the refused waypoint
            return plan;
        }
        plan.schedule(&self.scheduled[..self.scheduled.len().min(plan.ids.len())]);
        plan.served = plan.served.saturating_add(self.refused); // the ids after the schedule are `NOBODY`
        plan
    }
}
