//! Going on with a run that has ended early: what is on record is flown once more, and compared. It is planned once more
//! only where the planner carries something from slot to slot.

use std::io::BufRead;

use skysink_common::message::{FlightReport, Mode, Plan, QueuesHeader, SlotHeader};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_field_sim::Field;
use skysink_field_sim::memory::{Memory as FieldMemory, Reached};
use skysink_flight_sim::Flight;
use skysink_flight_sim::memory::Memory as FlightMemory;
use skysink_planner::Planner;
use skysink_planner::recollection::Recollection;
use skysink_ring::ring_folder::RingFolder;

use skysink_mission::MissionError;

use crate::error::Error;
use skysink_mission::record::{RunFolder, SlotLog};
use skysink_mission::summary::Tally;

/// A run as far as it is on record.
pub struct Resumed {
    /// The trace, to go on with.
    pub log: SlotLog,
    field: Field,
    flight: FlightReport,
    /// Of a mission whose planner carries something from slot to slot.
    planner: Option<Planner>,
    reached: Reached,
}

/// What a line of the trace says of a slot.
#[derive(Debug, Clone, PartialEq)]
pub struct Flown {
    slot: u64,
    position_m: [f64; 3],
    scheduled: Vec<u32>,
    mode: Mode,
    refused: u32,
}

/// Reads what is on record in `folder` into `tally`. A last line that is cut is dropped: its slot is flown again.
///
/// # Errors
/// If a run is still writing it, or a line is not what the scenario leads to.
pub fn resume(folder: &RunFolder, scenario: &Scenario, list: &SensorList, tally: &mut Tally) -> Result<Resumed, Error> {
    let (mut log, mut trace) = folder.reopen_slot_log()?;
    let mut field = Field::new(scenario, list);
    let mut flight = Flight::new(scenario, &list.nodes(scenario.sensors.capacity_bits));
    let (mut report, mut reached) = (flight.start(), Reached::default());
    let mut planner =
        scenario.planner.remembers().then(|| Planner::new(scenario, &list.nodes(scenario.sensors.capacity_bits)));
    let header = |reached: Reached, field: &Field| QueuesHeader {
        head: SlotHeader { slot: reached.slot, ..SlotHeader::default() },
        totals: *field.totals(),
        delivered_bits: reached.bits.delivered_bits,
        lost_bits: reached.bits.lost_bits,
    };
    tally.start(&header(reached, &field));
    let mut line = Vec::new();
    loop {
        line.clear();
        trace.read_until(b'\n', &mut line).map_err(Error::file(&folder.slots()))?;
        if line.last() != Some(&b'\n') {
            break;
        }
        let slot = reached.slot + 1;
        let refuse = |what: &str| -> Error {
            MissionError::Trace { path: folder.slots(), line: slot + 1, what: what.to_owned() }.into()
        };
        let flown = Flown::parse(&line).ok_or_else(|| refuse("expected a slot as skysink run writes it"))?;
        if flown.slot != slot || slot > scenario.slots {
            return Err(refuse(&format!("slot {}: expected slot {slot} of {}", flown.slot, scenario.slots)));
        }
        if let Some(planner) = &mut planner {
            planner.observe(reached.slot, &report, field.queues_bits());
            let _ = planner.step(slot, &report.position(), report.z_m, field.queues_bits()); // for what it carries on
        }
        report = flown.repeat(&mut flight);
        let bits = field.step(slot, &report).map_err(|error| refuse(&error.to_string()))?;
        reached = Reached { slot, bits };
        let header = header(reached, &field);
        if !log.repeat(&line, &report, &header)? {
            return Err(refuse("the scenario does not lead to this line: was a file of the folder changed?"));
        }
        tally.add(None, &report, &header);
    }
    tally.resume();
    Ok(Resumed { log, field, flight: report, planner, reached })
}

impl Resumed {
    /// Lets the processes of a new ring begin after the last slot on record.
    ///
    /// # Errors
    /// If the ring's folder cannot be written.
    pub fn seed(&self, meeting: &RingFolder, scenario: &Scenario) -> Result<(), Error> {
        if self.reached.slot > 0 {
            if let Some(planner) = &self.planner {
                let plans = Recollection::open(meeting, scenario, self.field.queues_bits().len());
                plans.and_then(|mut plans| plans.after(self.reached.slot, planner))?;
            }
            let field = FieldMemory::open(meeting, self.field.queues_bits().len());
            field.and_then(|memory| memory.keep(self.reached, &self.field))?;
            let flight = FlightMemory::open(meeting);
            flight.and_then(|memory| memory.keep(self.reached.slot, &self.flight))?;
        }
        Ok(())
    }
}

impl Flown {
    /// Reads a line of `slots.csv`, with its end; none if it is no such line.
    #[must_use]
    pub fn parse(line: &[u8]) -> Option<Self> {
        let line = std::str::from_utf8(line).ok()?.strip_suffix('\n')?;
        let columns: Vec<&str> = line.split(',').collect();
        let &[slot, x_m, y_m, z_m, scheduled, _, _, _, mode, refused] = &columns[..] else { return None };
        let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite());
        Some(Self {
            slot: slot.parse().ok()?,
            position_m: [number(x_m)?, number(y_m)?, number(z_m)?],
            scheduled: scheduled.split_ascii_whitespace().map(|id| id.parse().ok()).collect::<Option<_>>()?,
            mode: [Mode::Serve, Mode::Transit, Mode::Hold].into_iter().find(|known| known.name() == mode)?,
            refused: refused.parse().ok()?,
        })
    }

    /// Flies it again: by the plan that flight-sim would have made this of.
    fn repeat(&self, flight: &mut Flight) -> FlightReport {
        let [x_m, y_m, z_m] = self.position_m;
        let mut plan = Plan::fly_to(x_m, y_m, z_m, self.mode);
        match (self.mode, self.refused) {
            (Mode::Hold, 0) => return flight.step(self.slot, None),
            (Mode::Hold, _) => plan.x_m = f64::NAN,
            (Mode::Serve | Mode::Transit, _) => {
                plan.schedule(&self.scheduled[..self.scheduled.len().min(plan.ids.len())]);
                plan.served = plan.served.saturating_add(self.refused); // nobody, in the places behind
            }
        }
        flight.step(self.slot, Some(&plan))
    }
}
