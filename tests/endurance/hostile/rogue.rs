//! A planner of the test in a ring of real processes: it has the valid plan of each slot, and may send others.

use iceoryx2::prelude::ipc;
use skysink::worker::silence_iceoryx2;
use skysink_common::message::{FLAG_END, FlightReport, Limits, NodeAnswer, Plan, QueuesHeader, SensorNode, SlotHeader};
use skysink_common::nodes::Answer;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::slot_record::UAV;
use skysink_common::stop::Stop;
use skysink_common::told::Told;
use skysink_planner::Planner;
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::reader::Reader;
use skysink_ring::role::Role;
use skysink_ring::topics::Ring;
use skysink_ring::wait::WaitContext;
use skysink_ring::writer::Writer;

use crate::support::flight::{FlightBuilder, RunningFlight};
use crate::support::{scenarios, until};

/// Timeout of the processes of a run that is to succeed [s].
pub const LONG_S: &str = "60";

/// Timeout of the processes of a run that is to time out [s].
pub const SHORT_S: &str = "5";

/// The planner.
pub struct Rogue {
    pub scenario: Scenario,
    pub folder: RingFolder,
    pub ring: Ring<ipc::Service>,
    pub sensors: Vec<SensorNode>,
    /// The limits, which came with the sensor nodes.
    pub limits: Limits,
    planner: Planner,
    wait: WaitContext,
    plans: Writer<ipc::Service, [Plan], SlotHeader>,
    queues: Reader<ipc::Service, [u32], QueuesHeader>,
    flights: Reader<ipc::Service, [FlightReport], SlotHeader>,
    answers: Option<Reader<ipc::Service, [NodeAnswer], SlotHeader>>,
    next: u64,
}

/// A slot that waits for its plan.
pub struct Turn {
    pub slot: u64,
    /// The plan of the real planner.
    pub good: Plan,
    /// The position of the UAV.
    pub flight: FlightReport,
    /// What the topic `queues` said.
    pub queues_bits: Vec<u32>,
}

/// Starts a flight without viewer and planner, whose place the test takes; its processes wait `timeout_s` for each
/// other.
pub fn start_with_rogue<'a>(flight: &FlightBuilder<'a>, timeout_s: &str) -> (RunningFlight<'a>, Rogue) {
    let run = flight.without_viewer().external("planner").timeout(timeout_s).start();
    let rogue = Rogue::join(&run);
    (run, rogue)
}

/// The folder of a ring, once all its topics are there.
pub fn open_folder(run: &RunningFlight) -> RingFolder {
    silence_iceoryx2();
    run.until_topics();
    until("terms of the ring", || RingFolder::open(&run.folder()).ok())
}

impl Rogue {
    pub fn join(run: &RunningFlight) -> Self {
        let folder = open_folder(run);
        let scenario = scenarios::read(&run.path("scenario.toml"), Overrides::default());
        let stop = Stop::default();
        let open = || Ring::<ipc::Service>::join(&folder, &scenario, Role::Planner, &stop).ok();
        let (ring, mut wait) = until("topics", open);
        let plans = ring.plan.list_writer(2).unwrap();
        let mut nodes = ring.sensors.reader().unwrap();
        let queues = ring.belief.as_ref().unwrap_or(&ring.queues).reader().unwrap();
        let flights = ring.flight.reader().unwrap();
        let answers = ring.answers.as_ref().map(|answers| answers.reader().unwrap());
        let nodes = nodes.wait_for_next(&mut wait, 0).unwrap();
        let sensors = nodes.payload().to_vec();
        let limits = nodes.user_header().limits;
        let planner = Planner::new(&scenario, &sensors).unwrap();
        Self { scenario, folder, ring, sensors, limits, planner, wait, plans, queues, flights, answers, next: 0 }
    }

    /// Waits for the next slot that needs a plan; none after the last.
    pub fn next(&mut self) -> Option<Turn> {
        self.try_next().unwrap()
    }

    /// The same; fails if the run ends too early.
    pub fn try_next(&mut self) -> Result<Option<Turn>, NodeError> {
        loop {
            let state = self.queues.wait_for_next(&mut self.wait, self.next)?;
            let SlotHeader { slot, flags, .. } = state.user_header().head;
            if flags & FLAG_END != 0 {
                return Ok(None);
            }
            if slot < self.next {
                continue; // a restarted field-sim repeats itself
            }
            self.next = slot + 1;
            // A paced run may have left this planner behind.
            let Some(flight) = self.flights.wait_for_slot(&mut self.wait, slot)? else { continue };
            let flight = flight[UAV];
            let nodes = self.answers.as_mut().map(|answers| answers.wait_for_slot(&mut self.wait, slot)).transpose()?;
            let nodes = nodes.flatten().map(|nodes| nodes.payload().to_vec()).unwrap_or_default();
            let answers: Vec<Answer> = nodes.iter().map(|node| Answer::from_repr(node.answer).unwrap()).collect();
            let good = self.planner.step(slot + 1, flight.position(), Told::new(state.payload(), &answers));
            let queues_bits = state.payload().to_vec();
            return Ok(Some(Turn { slot: slot + 1, good, flight, queues_bits }));
        }
    }

    /// The header that the plan of `slot` should have.
    pub fn header(&self, slot: u64) -> SlotHeader {
        self.ring.header(slot, 0)
    }

    pub fn send(&self, header: SlotHeader, plan: Plan) {
        self.try_send(header, plan).unwrap();
    }

    /// Sends plans for any number of UAVs.
    pub fn send_list(&self, header: SlotHeader, plans: &[Plan]) {
        self.plans.send_list(header, plans).unwrap();
    }

    /// The same; fails if a reader does not take it.
    pub fn try_send(&self, header: SlotHeader, plan: Plan) -> Result<(), RingError> {
        self.plans.send_list(header, &[plan])
    }

    /// Flies to the end with valid plans; before each it calls `disturb`.
    pub fn fly_to_end(&mut self, mut disturb: impl FnMut(&Self, &Turn)) {
        while let Some(turn) = self.next() {
            disturb(self, &turn);
            self.send(self.header(turn.slot), turn.good);
        }
    }
}
