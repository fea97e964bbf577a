//! field-sim as a process of the ring: publishes the queues, waits for the flight, keeps the slot clock.

use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use skysink_common::belief::Belief;
use skysink_common::message::{FLAG_END, FLAG_REPEAT, Limits, NodeAnswer, QueuesHeader, SensorsHeader, Tick};
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::ByUav;
use skysink_common::stop::Stop;
use skysink_ring::error::NodeError;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, is_release};

use crate::field::{Field, FieldError};
use crate::journal::{journal, resume, save};

impl From<FieldError> for NodeError {
    fn from(error: FieldError) -> Self {
        Self::ImpossibleSample(Box::new(error))
    }
}

/// Runs the slots until the mission ends. A restarted process resumes from its journal, and publishes the last two
/// saved slots again, which a peer may have missed.
///
/// # Errors
/// If a peer is missing or sends an impossible flight, the ring fails, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    let list = SensorList::of(scenario)?;
    let count = list.sensors().len();
    let (ring, mut wait) = Ring::<S>::join(folder, scenario, Role::FieldSim, stop)?;
    let sensors = ring.sensors.list_writer(count)?;
    let queues = ring.queues.list_writer(count)?;
    let beliefs = ring.belief.as_ref().map(|belief| belief.list_writer(count)).transpose()?;
    let rates = ring.rates.as_ref().map(|rates| rates.list_writer(count)).transpose()?;
    let answers = ring.answers.as_ref().map(|answers| answers.list_writer(count)).transpose()?;
    let ticks = ring.tick.writer()?;
    let mut flights = ring.flight.reader()?;
    let mut commits = ring.commit.reader()?;
    let mut clock = ring.terms.pace.period(scenario.slot_s).map(Clock::new);

    let belief = Belief::of(scenario, &list, ring.terms.belief);
    let known = belief.known_nodes(list.nodes(), scenario.slot_s);
    let mut field = Field::new(scenario, &list).with_belief(belief);
    let mut journal = journal(folder, &field, scenario.uav.uavs())?;
    let mut saved = resume(&mut journal, &mut field, scenario.uav.uavs())?;
    let header = |field: &Field, flags: u32| {
        let end = if field.slot() == scenario.slots { FLAG_END } else { 0 };
        field.header(ring.header(field.slot(), end | flags))
    };
    sensors.send_list(SensorsHeader { head: ring.header(0, 0), limits: Limits::of(scenario) }, &known)?;
    // What a process with the queues of a slot has, too.
    let send_before = |field: &Field, flags: u32| {
        let head = header(field, flags).head;
        if let Some(answers) = &answers {
            answers.send_list(head, &field.node_answers().collect::<Vec<NodeAnswer>>())?;
        }
        let Some(beliefs) = &beliefs else { return Ok(()) };
        if let (Some(rates), Some(learnt_bps)) = (&rates, field.belief().learnt_bps(scenario.slot_s)) {
            rates.send_list(head, &learnt_bps.collect::<Vec<_>>())?;
        }
        beliefs.send_list(QueuesHeader { head, ..QueuesHeader::default() }, field.believed_bits())
    };
    send_before(&field, 0)?;
    queues.send_list(header(&field, 0), field.queues_bits())?;

    for slot in field.slot() + 1..=scenario.slots {
        if let Some(clock) = clock.as_mut().filter(|_| saved.is_none()) {
            if clock.next.is_none() {
                commits.wait_until(&mut wait, slot - 1)?; // all processes have joined
            }
            wait.sleep_until(clock.next_slot())?;
            ticks.send(ring.header(slot, 0), Tick { period_ns: clock.period_ns() })?;
        }
        let reports = match saved.take() {
            Some(reports) => reports,
            None => match flights.wait_for_slot(&mut wait, slot)? {
                Some(reports) => ByUav::from_slice(&reports),
                None => return Err(NodeError::MissingSlot { topic: ring.flight.name(), slot }),
            },
        };
        let mut loaned = queues.loan(count)?;
        field.step_into(slot, &reports, Some(loaned.elements()))?;
        // Saved only after the last slot is committed: a restart before that publishes the last slot again, too.
        commits.wait_until(&mut wait, slot - 1)?;
        save(&mut journal, &reports, &field)?;
        send_before(&field, 0)?;
        // SAFETY: the step has not failed, so it has written every element.
        unsafe { loaned.send(header(&field, 0)) }?;
    }
    ring.wait_for_commit(&mut wait, is_release, || match ring.terms.pace {
        Pace::Max => Ok(()),
        // The buffer of a reader that lags may have been full.
        Pace::Factor(_) => {
            send_before(&field, FLAG_REPEAT)?;
            queues.send_list(header(&field, FLAG_REPEAT), field.queues_bits())
        }
    })
}

/// The periodic starts of the slots in wall time.
struct Clock {
    period: Duration,
    /// `None` before the first slot.
    next: Option<Instant>,
}

impl Clock {
    fn new(period: Duration) -> Self {
        Self { period, next: None }
    }

    fn period_ns(&self) -> u64 {
        u64::try_from(self.period.as_nanos()).unwrap_or(u64::MAX)
    }

    /// Start of the next slot. The first starts one period from now, so that its plan has as much time as the others.
    /// After a delay the clock does not catch up: later starts are shifted.
    fn next_slot(&mut self) -> Instant {
        let now = Instant::now();
        let slot = self.next.unwrap_or(now + self.period).max(now);
        self.next = Some(slot + self.period);
        slot
    }
}
