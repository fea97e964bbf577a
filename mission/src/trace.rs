//! The trace of a mission, `slots.csv`: how a line is written, hashed and read.

use std::fmt::Write as _;

use nalgebra::Point3;
use skysink_common::message::{FlightReport, Mode, Plan, QueuesHeader};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use crate::error::MissionError;

/// Header of `slots.csv`.
pub(crate) const SLOT_COLUMNS: &str = "slot,x_m,y_m,z_m,scheduled,delivered_bits,lost_bits,queued_bits,mode,refused\n";

/// Hash of the lines of a trace, without the trace.
#[derive(Debug, Default)]
pub struct TraceHash {
    line: String,
    hash: u64,
}

impl TraceHash {
    /// Writes the line of a slot, with its end; it is not in the hash yet.
    ///
    /// # Errors
    /// If a bit of the ledger is unaccounted for.
    pub fn write(&mut self, flight: &FlightReport, header: &QueuesHeader) -> Result<&str, MissionError> {
        if !header.totals.is_balanced() {
            return Err(MissionError::Unbalanced { slot: header.head.slot, totals: header.totals });
        }
        self.line.clear();
        write_line(&mut self.line, flight, header).expect("a string takes everything");
        Ok(&self.line)
    }

    /// Adds the line that was written last.
    pub fn add(&mut self) {
        self.hash = chained(self.hash, self.line.as_bytes());
    }

    /// The hash of all lines so far, chained.
    #[must_use]
    pub fn value(&self) -> u64 {
        self.hash
    }
}

/// The hash of a trace after one more line, with its end; before the first it is 0.
pub(crate) fn chained(hash: u64, line: &[u8]) -> u64 {
    xxh3_64_with_seed(line, hash)
}

/// One line of `slots.csv`. Floats read back exactly, and no clock is in it.
fn write_line(line: &mut String, flight: &FlightReport, header: &QueuesHeader) -> std::fmt::Result {
    write!(line, "{},{},{},{},", header.head.slot, flight.x_m, flight.y_m, flight.z_m)?;
    for (i, link) in flight.served_links().iter().enumerate() {
        let separator = if i > 0 { " " } else { "" };
        write!(line, "{separator}{}", link.sensor)?;
    }
    let (delivered, lost, queued) = (header.delivered_bits, header.lost_bits, header.totals.queued_bits);
    let mode = Mode::from_repr(flight.mode).unwrap_or_default();
    writeln!(line, ",{delivered},{lost},{queued},{mode},{}", flight.refused)
}

/// What a line of the trace says of a slot.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedSlot {
    /// The slot, from 1.
    pub slot: u64,
    /// The UAV's position after it [m].
    pub position: Point3<f64>,
    /// The served sensor nodes, ascending.
    pub scheduled: Vec<u32>,
    /// Uploaded in the slot [bit].
    pub delivered_bits: u64,
    /// Lost in the slot [bit].
    pub lost_bits: u64,
    /// The sum of all queues after it [bit].
    pub queued_bits: u64,
    /// What the UAV did.
    pub mode: Mode,
    /// Requests of the plan that were refused.
    pub refused: u32,
}

impl RecordedSlot {
    /// Reads a line of `slots.csv`, with its end; `None` if it is no such line.
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

    /// A plan that leads to the recorded flight: where requests were refused, with as many that are.
    #[must_use]
    pub fn plan(&self) -> Plan {
        let mut plan = Plan::fly_to(self.position, self.mode);
        if self.mode == Mode::Hold {
            plan.x_m = f64::NAN; // the refused waypoint
            return plan;
        }
        plan.schedule(&self.scheduled[..self.scheduled.len().min(plan.ids.len())]);
        plan.served = plan.served.saturating_add(self.refused); // ids behind the schedule are nobody's
        plan
    }
}
