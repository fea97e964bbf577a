//! planner as a process of the ring: receives the queues after a slot, and publishes the plan of the next.

use std::fs;

use iceoryx2::prelude::Service;
use iceoryx2::sample::Sample;
use skysink_common::checkpoint::{decode, encode};
use skysink_common::message::{
    FLAG_END, FlightReport, HeardLink, MAX_PATH_POINTS, NodeAnswer, PathPoint, Plan, QueuesHeader, SlotHeader,
};
use skysink_common::nodes::Answer;
use skysink_common::pace::Pace;
use skysink_common::possible::are_known_links;
use skysink_common::scenario::Scenario;
use skysink_common::slot_record::ByUav;
use skysink_common::stop::Stop;
use skysink_common::told::{Received, Sensed, Told};
use skysink_ring::error::{NodeError, RingError};
use skysink_ring::folder::RingFolder;
use skysink_ring::journal::{Journal, Policy};
use skysink_ring::reader::{Reader, SlotSample};
use skysink_ring::refusals::Refusal;
use skysink_ring::role::Role;
use skysink_ring::topic::Topic;
use skysink_ring::topics::{Ring, is_release};
use skysink_ring::wait::WaitContext;

use crate::fleet::FleetPlanner;
use crate::operator_counts::OperatorCounts;
use crate::strategy::{MakeStrategy, Registered, Timing};
use skysink_common::estimate::BYTES_PER_SENSOR;

/// States in the journal: those of the three slots that may be planned again, and one that may be cut.
const STATES: u64 = 4;

/// Most bytes of a checkpoint besides those per sensor node.
pub const ROOM: usize = 1 << 23;

/// Most bytes of the slot of the last contact with a sensor node, which a strategy may keep.
const BYTES_PER_CONTACT: usize = 5;

/// The journal in the ring's folder of a planner for `uavs` UAVs over `count` sensor nodes.
///
/// # Errors
/// If the file cannot be opened.
pub fn journal(folder: &RingFolder, count: usize, uavs: usize) -> Result<Journal, RingError> {
    let state_bytes = (ROOM + (BYTES_PER_SENSOR + BYTES_PER_CONTACT) * count) * uavs;
    let policy = Policy { state_every: 1, states: STATES, state_bytes, input_bytes: None };
    Journal::open(&folder.journal("plans"), policy)
}

/// The file of the ring's folder with what became of the changes that the searches of a mission proposed.
const COUNTS: &str = "operators";

/// What became of the changes that the searches of the ring's planner proposed, by operator, after a whole mission;
/// nothing from another planner, or one on another host.
#[must_use]
pub fn counts(folder: &RingFolder) -> Vec<(String, OperatorCounts)> {
    let bytes = fs::read(folder.path().join(COUNTS)).unwrap_or_default();
    decode(&bytes).unwrap_or_default()
}

/// Writes the file that [`counts`] reads.
fn write_counts(folder: &RingFolder, planner: &FleetPlanner) -> Result<(), RingError> {
    let mut bytes = Vec::new();
    encode(&planner.counts(), &mut bytes);
    let path = folder.path().join(COUNTS);
    fs::write(&path, bytes).map_err(|source| RingError::Journal { path, source })
}

/// The planned paths of `uavs` UAVs, of those that plan more than the next waypoint.
fn path_points(planner: &FleetPlanner, uavs: usize) -> Vec<PathPoint> {
    let leading = (0..uavs).map(|uav| (uav, planner.path(uav))).filter(|(_, path)| path.len() > 1);
    leading.flat_map(|(uav, path)| path.iter().map(move |point| PathPoint::of(uav, point))).collect()
}

/// A planner whose state is saved after each slot that it plans.
struct Journaled {
    planner: FleetPlanner,
    journal: Journal,
}

impl Journaled {
    /// Restores a new planner to the last recorded state before `slot`. In paced runs, in which slots may be skipped,
    /// that may be several slots before.
    fn resume(&mut self, slot: u64) -> Result<(), RingError> {
        if self.planner.slot() == 0 {
            self.journal.restore_before(slot, &mut self.planner)?;
        }
        Ok(())
    }

    /// Observes what is `sensed` after a slot, plans the next, and saves the state before the plan is published. After
    /// a requested stop the plan is neither saved nor published.
    fn plan(&mut self, sensed: &Sensed<'_>) -> Result<ByUav<Plan>, NodeError> {
        let slot = sensed.slot + 1;
        self.resume(slot)?;
        self.planner.observe(sensed);
        let plans = self.planner.step(sensed);
        self.planner.stop().check()?;
        self.planner.require_finite(slot, &plans)?;
        self.journal.save(slot, &[], &self.planner)?;
        self.planner.stop().check()?; // a strategy that cannot be saved has failed
        Ok(plans)
    }
}

/// What a planner receives in each slot.
struct Inputs<S: Service + 'static> {
    queues: Reader<S, [u32], QueuesHeader>,
    flights: Reader<S, [FlightReport], SlotHeader>,
    links: Option<Reader<S, [HeardLink], SlotHeader>>,
    answers: Option<Reader<S, [NodeAnswer], SlotHeader>>,
}

/// The answers of a message, if it has one of each of `count` sensor nodes.
fn answers_of(nodes: &[NodeAnswer], count: usize) -> Option<Vec<Answer>> {
    let answers = nodes.iter().map(|node| Answer::from_repr(node.answer)).collect::<Option<Vec<Answer>>>()?;
    Some(answers).filter(|answers| answers.len() == count)
}

impl<S: Service + 'static> Inputs<S> {
    /// The queues of the newest slot; `state` are those of an older one. Only that slot is planned, because plans for
    /// past slots are void. The contacts of the others, from `next` on, still update the estimate.
    fn catch_up(
        &mut self,
        journaled: &mut Journaled,
        mut state: Sample<S, [u32], QueuesHeader>,
        next: u64,
        are_known: &dyn Fn(u64, &[HeardLink]) -> bool,
    ) -> Result<Sample<S, [u32], QueuesHeader>, NodeError> {
        while let Some(newer) = self.queues.next_sample()? {
            let older = std::mem::replace(&mut state, newer);
            let slot = older.user_header().head.slot;
            if slot >= next
                && let SlotSample::Available(flights) = self.flights.poll_slot(slot)?
            {
                journaled.resume(slot + 1)?;
                let heard = self.links.as_mut().map(|links| links.poll_slot(slot)).transpose()?;
                let heard = heard.and_then(SlotSample::available).filter(|heard| are_known(slot, heard));
                let received = Received { links: heard.as_deref().unwrap_or_default().into() };
                let answers = match &mut self.answers {
                    Some(answers) => answers.poll_slot(slot)?.available(),
                    None => None,
                };
                let answers = answers.and_then(|nodes| answers_of(&nodes, older.payload().len()));
                if self.answers.is_none() || answers.is_some() {
                    let told = Told::new(older.payload(), answers.as_deref().unwrap_or_default());
                    journaled.planner.observe(&Sensed { slot, flights: &flights, told, received: &received });
                }
            }
        }
        Ok(state)
    }

    /// What the `count` sensor nodes do after `slot`, which was sent before the queues; nothing if all send, and `None`
    /// if a message has not one answer of each.
    fn answers(&mut self, wait: &mut WaitContext, slot: u64, count: usize) -> Result<Option<Vec<Answer>>, NodeError> {
        let Some(answers) = &mut self.answers else { return Ok(Some(Vec::new())) };
        let Some(nodes) = answers.wait_for_slot(wait, slot)? else { return Ok(None) };
        let found = answers_of(&nodes, count);
        if found.is_none() {
            answers.refuse(slot, Refusal::Length);
        }
        Ok(found)
    }

    /// What the UAVs hear after `slot`; `None` if that has passed, or they hear nothing.
    fn heard(
        &mut self,
        wait: &mut WaitContext,
        slot: u64,
    ) -> Result<Option<Sample<S, [HeardLink], SlotHeader>>, NodeError> {
        self.links.as_mut().map_or(Ok(None), |links| links.wait_for_slot(wait, slot))
    }
}

/// Plans until the mission ends. A restarted process resumes from its journal, and repeats its plans.
///
/// # Errors
/// If a peer is missing, the ring fails, or `stop` is requested.
pub fn run<S: Service + 'static>(scenario: &Scenario, folder: &RingFolder, stop: &Stop) -> Result<(), NodeError> {
    run_with::<S>(scenario, folder, stop, None)
}

/// As [`run`], with the strategies that `make` makes, one for each UAV, instead of the scenario's.
///
/// # Errors
/// As [`run`], and those of `make`.
pub fn run_by<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    make: &mut MakeStrategy<'_>,
) -> Result<(), NodeError> {
    run_with::<S>(scenario, folder, stop, Some(make))
}

fn run_with<S: Service + 'static>(
    scenario: &Scenario,
    folder: &RingFolder,
    stop: &Stop,
    own: Option<&mut MakeStrategy<'_>>,
) -> Result<(), NodeError> {
    let has_path = own.is_some() || Registered::of(scenario)?.has_path || scenario.landing_base().is_some();
    let (ring, mut wait) = Ring::<S>::join(folder, scenario, Role::Planner, stop)?;
    wait.beat_while_computing();
    // Before that of the plans, so that a process that has a plan finds the writer of its path.
    let paths = has_path.then(|| ring.path.list_writer(scenario.uav.uavs() * MAX_PATH_POINTS)).transpose()?;
    let uavs = scenario.uav.uavs();
    let plans = ring.plan.list_writer(uavs)?;
    let mut inputs = Inputs {
        queues: ring.queues.reader()?, // the planner maintains its own estimate
        flights: ring.flight.reader()?,
        links: ring.links.as_ref().map(Topic::reader).transpose()?,
        answers: ring.answers.as_ref().map(Topic::reader).transpose()?,
    };

    let mut sensors = ring.sensors.reader()?;
    let nodes = sensors.wait_for_next(&mut wait, 0)?;
    let _sensors = ring.terms.link.is_none().then_some(sensors); // behind a link its repeats would pile up
    let mut planner = match own {
        Some(make) => FleetPlanner::by(scenario, nodes.payload(), make, stop)?,
        None => FleetPlanner::until(scenario, nodes.payload(), stop)?,
    };
    let is_paced = ring.terms.pace != Pace::Max;
    if is_paced {
        planner.set_timing(Timing::Paced);
    }
    let mut journaled = Journaled { planner, journal: journal(folder, nodes.payload().len(), uavs)? };
    let are_known = |slot: u64, heard: &[HeardLink]| {
        let are_known = are_known_links(heard, uavs, nodes.payload().len());
        ring.refusals.add("links", slot, Refusal::Links, u64::from(!are_known));
        are_known
    };
    let mut next = 0;
    loop {
        let mut state = inputs.queues.wait_for_next(&mut wait, next)?;
        if is_paced {
            state = inputs.catch_up(&mut journaled, state, next, &are_known)?;
        }
        let SlotHeader { slot, flags, .. } = state.user_header().head;
        if flags & FLAG_END != 0 {
            journaled.resume(slot + 1)?; // a planner that was restarted after its last plan has none
            write_counts(folder, &journaled.planner)?;
            break;
        }
        if slot < next {
            continue; // repeated by a restarted field-sim
        }
        if state.payload().len() != nodes.payload().len() {
            ring.refusals.add("queues", slot, Refusal::Length, 1);
            continue;
        }
        // The flight may arrive after the queues, if its writer waits for another reader. A flight that has passed was
        // sent before this process joined, and the ring has its plan.
        let Some(flown) = inputs.flights.wait_for_slot(&mut wait, slot)? else { continue };
        let heard = inputs.heard(&mut wait, slot)?.filter(|heard| are_known(slot, heard));
        let Some(answers) = inputs.answers(&mut wait, slot, state.payload().len())? else { continue };
        next = slot + 1;
        let told = Told::new(state.payload(), &answers);
        let received = Received { links: heard.as_deref().unwrap_or_default().into() };
        let planned = journaled.plan(&Sensed { slot, flights: &flown, told, received: &received })?;
        let points = path_points(&journaled.planner, uavs);
        if let Some(paths) = paths.as_ref().filter(|_| !points.is_empty()) {
            paths.send_list(ring.header(next, 0), &points)?; // before the plan, so that its readers have the paths
        }
        inputs.flights.receive_all()?; // repeated flights must not fill the buffer
        inputs.links.iter_mut().try_for_each(Reader::receive_all)?;
        inputs.answers.iter_mut().try_for_each(Reader::receive_all)?;
        plans.send_list(ring.header(next, 0), &planned)?;
    }
    ring.wait_for_commit(&mut wait, is_release, || Ok(()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_those_of_each_sensor_node_or_refused() {
        let nodes = [[0, 0], [1, 1], [2, 0]].map(|[answer, known]| NodeAnswer { answer, known });
        assert_eq!(answers_of(&nodes, 3), Some(vec![Answer::Queue, Answer::Silent, Answer::Dead]));
        assert_eq!([answers_of(&nodes, 2), answers_of(&nodes, 4), answers_of(&[], 1)], [None, None, None]);
        assert_eq!(answers_of(&[NodeAnswer { answer: 7, known: 0 }], 1), None);
    }

    use crate::planner::Planner;
    use crate::settings::{self, Knowledge, Rates, change};
    use crate::strategy::{Decision, Setup, Strategy, View};
    use crate::waypoint::problem::Waypoint;
    use nalgebra::Point3;
    use skysink_common::belief::Belief;
    use skysink_common::checkpoint::{Checkpoint, CheckpointError};
    use skysink_common::message::{FlightReport, LinkReport, Mode, Plan, SensorNode, SolverOutcome};
    use skysink_common::scenario::Overrides;
    use skysink_common::slot_record::UAV;
    use skysink_ring::terms::Terms;
    use std::path::Path;

    fn nodes() -> Vec<SensorNode> {
        let node = |i: u32| SensorNode {
            x_m: 8.0 * f64::from(i),
            y_m: 90.0 - 7.0 * f64::from(i),
            gain: 1e-5,
            sampling_bps: 100.0,
            capacity_bits: 30_000,
            ..SensorNode::default()
        };
        (0..12).map(node).collect()
    }

    /// The queues before `slot` [bit].
    fn queues(slot: u64) -> Vec<u32> {
        (0..12).map(|i| (i * 977 + slot as u32 * 331) % 30_000).collect()
    }

    /// The flight that does what a plan says.
    fn flown(plan: &Plan) -> FlightReport {
        let mut report = FlightReport::at(plan.waypoint(), Mode::Serve);
        for (link, &sensor) in report.links.iter_mut().zip(plan.scheduled()) {
            *link = LinkReport { sensor, ..LinkReport::default() };
        }
        report.served = plan.served;
        report
    }

    /// A planner process that joins the ring.
    fn process(scenario: &Scenario, folder: &RingFolder) -> Journaled {
        let planner = Planner::new(scenario, &nodes()).unwrap().into();
        Journaled { planner, journal: journal(folder, 12, 1).unwrap() }
    }

    fn saved(planner: &impl Checkpoint) -> Vec<u8> {
        let mut bytes = Vec::new();
        planner.save(&mut bytes);
        bytes
    }

    /// Every planner that carries something from slot to slot.
    fn scenarios() -> impl Iterator<Item = Scenario> {
        let seen = [
            (Knowledge::Oracle, Rates::Known),
            (Knowledge::Estimated, Rates::Known),
            (Knowledge::Estimated, Rates::Learnt),
        ];
        let all = crate::strategies::names()
            .into_iter()
            .flat_map(move |strategy| seen.map(|knowledge| (strategy, knowledge)));
        let scenario = |(strategy, (knowledge, rates)): (&'static str, _)| {
            let text = "name = 'x'\n[planner]\nhorizon.iterations = 200\n";
            let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
            let scenario = Scenario::parse(text, Path::new("x.toml"), overrides).and_then(settings::resolve).unwrap();
            change(scenario, |settings| {
                settings.knowledge = knowledge;
                settings.rates = rates;
            })
            .unwrap()
        };
        let carries = |scenario: &Scenario| {
            let mut planner = Planner::new(scenario, &nodes()).unwrap();
            let _ = planner.step(1, Point3::new(50.0, 50.0, 20.0), &queues(1));
            !saved(&planner).is_empty()
        };
        all.map(scenario).filter(carries)
    }

    /// The plan of `slot` after these flights.
    fn planned(planner: &mut Journaled, slot: u64, flights: &[FlightReport]) -> Plan {
        let queues_bits = queues(slot);
        let sensed = Sensed { slot: slot - 1, flights, told: Told::from(&queues_bits), received: &Received::NOTHING };
        planner.plan(&sensed).unwrap()[UAV]
    }

    #[test]
    fn a_restarted_planner_repeats_the_plans_of_the_last_slots() {
        for scenario in scenarios() {
            let folder = RingFolder::create(Terms::default()).unwrap();
            let mut flights = vec![FlightReport::at(scenario.start(), Mode::Hold)];
            let mut first = process(&scenario, &folder);
            for slot in 1..=9 {
                let plan = planned(&mut first, slot, &flights[slot as usize - 1..slot as usize]);
                flights.push(flown(&plan));
            }
            for from in [7, 8, 9] {
                let mut again = process(&scenario, &folder);
                for slot in from..=9 {
                    let plan = planned(&mut again, slot, &flights[slot as usize - 1..slot as usize]);
                    assert_eq!(flown(&plan), flights[slot as usize], "{:?}, slot {slot} from {from}", scenario.planner);
                }
                assert_eq!(saved(&again.planner), saved(&first.planner), "{:?}, from {from}", scenario.planner);
            }
        }
    }

    /// Flies east by 1 m for every slot that it has planned: its plan depends on all slots before.
    struct Counting(u64);

    impl Checkpoint for Counting {
        fn save(&self, bytes: &mut Vec<u8>) {
            encode(&self.0, bytes);
        }

        fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
            self.0 = decode(bytes)?;
            Ok(())
        }
    }

    impl Strategy for Counting {
        fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
            self.0 += 1;
            let point = Point3::new(self.0 as f64, 0.0, view.position.z);
            Some(Decision::serve(view, &Waypoint { point, outcome: SolverOutcome::Rule }, &[]))
        }
    }

    #[test]
    fn a_custom_strategy_is_restored_with_its_state() {
        let scenario = Scenario::letter(Overrides::default()).and_then(settings::resolve).unwrap();
        let folder = RingFolder::create(Terms::default()).unwrap();
        let process = || {
            let mut make = |_: &Setup<'_>| -> Result<Box<dyn Strategy>, _> { Ok(Box::new(Counting(0))) };
            let planner = FleetPlanner::by(&scenario, &nodes(), &mut make, &Stop::default()).unwrap();
            Journaled { planner, journal: journal(&folder, 12, 1).unwrap() }
        };
        let flight = FlightReport::at(scenario.start(), Mode::Hold);
        let mut first = process();
        for slot in 1..=9 {
            assert_eq!(planned(&mut first, slot, &[flight]).x_m, slot as f64);
        }
        let mut again = process();
        for slot in 8..=10 {
            assert_eq!(planned(&mut again, slot, &[flight]).x_m, slot as f64);
        }
    }

    #[test]
    fn a_planner_restarted_late_has_its_last_estimate() {
        let letter = Scenario::letter(Overrides::default()).and_then(settings::resolve).unwrap();
        let scenario = change(letter, |settings| settings.knowledge = Knowledge::Estimated).unwrap();
        let folder = RingFolder::create(Terms::default()).unwrap();
        let mut first = process(&scenario, &folder);
        let mut flight = FlightReport::at([50.0, 50.0, 20.0], Mode::Hold);
        for slot in 1..=9 {
            flight = flown(&planned(&mut first, slot, &[flight]));
        }
        let mut late = process(&scenario, &folder);
        let hold = FlightReport::at([50.0, 50.0, 20.0], Mode::Hold);
        let _ = planned(&mut late, 15, &[hold]);
        let uncertainties = |planner: &FleetPlanner| {
            let Belief::Estimated(estimate) = planner.belief() else { panic!("the queues are estimated") };
            (0..12).map(|id| estimate.uncertainty(15, id)).collect::<Vec<_>>()
        };
        assert!(uncertainties(&first.planner).iter().any(|sensor| sensor.initial_bits == 0.0), "a contact");
        assert_eq!(uncertainties(&late.planner), uncertainties(&first.planner));
    }
}
