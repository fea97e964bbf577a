//! The planners of all UAVs of a mission, and how they share the field (decision D22).
//!
//! A strategy sees one UAV. With one UAV, its planner plans as if this were not here.

mod finite;
mod partition;

use std::sync::Arc;
use std::time::Instant;

use nalgebra::Point3;
use skysink_common::belief::Belief;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::error::InputError;
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, LinkReport, MAX_SERVED, Mode, Plan, SensorNode};
use skysink_common::nodes::Answer;
use skysink_common::scenario::{Coordination, Scenario};
use skysink_common::sensors::Sensors;
use skysink_common::slot_record::ByUav;
use skysink_common::stop::Stop;
use skysink_common::told::{Sensed, Told};
use toml::Value;

use crate::neighbours::{Neighbours, PlannedVisit, ReservationTable};
use crate::operator_counts::OperatorCounts;
use crate::planner::Planner;
use crate::rules::Duty;
use crate::settings;
use crate::strategy::{MakeStrategy, Registered, Team, Timing};

/// Moves by which UAVs that have to land and keep apart plan to be home before they must: they may lose them to each
/// other.
const SPARE_MOVES: u64 = 3;

/// The planners of the UAVs of a mission.
pub struct FleetPlanner {
    members: ByUav<Member>,
    coordination: Coordination,
    reservations: ReservationTable,
    /// The SNs that each UAV is expected to serve before it has planned ahead; empty if none does.
    claims: Vec<Vec<u32>>,
    /// What each UAV plans to serve.
    intents: Vec<Vec<PlannedVisit>>,
    shared: Shared,
}

/// What the UAVs tell each other in a slot.
#[derive(Default)]
struct Shared {
    /// The SNs that are scheduled.
    scheduled: Vec<u32>,
    /// What all but one UAV plan to serve, by slot.
    intents: Vec<PlannedVisit>,
}

impl Shared {
    /// Fills in what is told to the UAV number `uav`.
    fn tell(&mut self, uav: usize, intents: &[Vec<PlannedVisit>]) {
        self.intents.clear();
        for (_, planned) in intents.iter().enumerate().filter(|(other, _)| *other != uav) {
            self.intents.extend_from_slice(planned);
        }
        self.intents.sort_by_key(|visit| (visit.slot, visit.sensor));
    }
}

/// A UAV of a fleet.
struct Member {
    planner: Planner,
    /// The last slot in which it serves; after it, it flies home.
    last: u64,
    /// The last slot of its endurance.
    endurance: u64,
    /// The SNs that it plans for; `None` for all of them.
    subfield: Option<Subfield>,
}

/// A part of the SNs: a planner numbers them from 0.
struct Subfield {
    /// The id of each in the mission, ascending.
    ids: Vec<u32>,
    /// Their queues [bit], and their answers; working memory.
    queues_bits: Vec<u32>,
    answers: Vec<Answer>,
}

impl Subfield {
    /// The number of the SN `id`, if it is one of them.
    fn number(&self, id: u32) -> Option<u32> {
        self.ids.binary_search(&id).ok().map(|number| number as u32)
    }

    /// What is told of its SNs.
    fn select(&mut self, told: Told<'_>) -> Told<'_> {
        self.queues_bits.clear();
        self.queues_bits.extend(self.ids.iter().map(|&id| told.queues_bits[id as usize]));
        self.answers.clear();
        if !told.answers.is_empty() {
            self.answers.extend(self.ids.iter().map(|&id| told.answer(id)));
        }
        Told::new(&self.queues_bits, &self.answers)
    }

    /// The flight with the links to its SNs, by their numbers.
    fn numbered(&self, flight: &FlightReport) -> FlightReport {
        let mut own = FlightReport { served: 0, links: [LinkReport::default(); MAX_SERVED], ..*flight };
        for link in flight.served_links() {
            if let Some(sensor) = self.number(link.sensor) {
                own.links[own.served as usize] = LinkReport { sensor, ..*link };
                own.served += 1;
            }
        }
        own
    }
}

impl From<Planner> for FleetPlanner {
    /// The planner of a single UAV.
    fn from(planner: Planner) -> Self {
        let members = ByUav::from_iter([Member { planner, last: u64::MAX, endurance: u64::MAX, subfield: None }]);
        Self {
            members,
            coordination: Coordination::Independent,
            reservations: ReservationTable::default(),
            claims: Vec::new(),
            intents: Vec::new(),
            shared: Shared::default(),
        }
    }
}

impl FleetPlanner {
    /// The planners of a scenario with the sensor nodes `sensors`, SN i at entry i. `stop` ends long preparations and
    /// searches; a plan made after the request must not be flown.
    ///
    /// # Errors
    /// As [`Planner::new`].
    pub fn until(scenario: &Scenario, sensors: &[SensorNode], stop: &Stop) -> Result<Self, InputError> {
        let Registered { make, has_path, .. } = Registered::of(scenario)?;
        let mut planners = Self::by(scenario, sensors, &mut |setup| Ok(make(setup)), stop)?;
        if *has_path && planners.members.len() > 1 && planners.coordination == Coordination::Sequential {
            let slots: Vec<u64> = planners.members.iter().map(|member| member.last).collect();
            planners.claims = partition::pieces(scenario, sensors, &slots, stop);
        }
        Ok(planners)
    }

    /// The same with the strategies that `make` makes, one for each UAV, instead of the scenario's. Where each UAV has
    /// a part of the field, the SNs of its setup are those of its part, numbered from 0.
    ///
    /// # Errors
    /// As [`Planner::new`], and those of `make`.
    pub fn by(
        scenario: &Scenario,
        sensors: &[SensorNode],
        make: &mut MakeStrategy<'_>,
        stop: &Stop,
    ) -> Result<Self, InputError> {
        let uavs = scenario.uav.uavs();
        if uavs == 1 {
            let mut fleet = Self::from(Planner::by(&scenario.of_uav(0), sensors, make, stop)?);
            if scenario.endurance_s_of(0).is_some() {
                let slots = scenario.slots_of(0);
                fleet.members[0].last = slots;
                fleet.members[0].endurance = slots;
            }
            return Ok(fleet);
        }
        let coordination = scenario.uav.coordination.unwrap_or_default();
        let reservations = ReservationTable::of(scenario);
        let separation_m = reservations.nothing(scenario.slots).separation_m;
        let alone: Vec<Scenario> = (0..uavs).map(|uav| alone(scenario, uav, separation_m)).collect();
        let slots: Vec<u64> = alone.iter().map(|alone| alone.slots).collect();
        let cut = || partition::pieces(scenario, sensors, &slots, stop);
        let mut parts = (coordination == Coordination::Partition).then(cut).into_iter().flatten();
        let starts: Vec<Position> = scenario.starts().map(|start| start.xy()).collect();
        let member = |(uav, alone): (usize, &Scenario)| {
            let subfield = parts.next().map(|ids| Subfield { ids, queues_bits: Vec::new(), answers: Vec::new() });
            let nodes = |subfield: &Subfield| subfield.ids.iter().map(|&id| sensors[id as usize]).collect();
            let own: Option<Vec<SensorNode>> = subfield.as_ref().map(nodes);
            let own = Arc::new(Sensors::of(alone, own.as_deref().unwrap_or(sensors)));
            let team = (coordination == Coordination::Sequential).then_some(Team { uav, starts: &starts });
            let planner = Planner::over(alone, own, make, team, stop)?;
            Ok(Member { planner, last: alone.slots, endurance: scenario.slots_of(uav), subfield })
        };
        let members = alone.iter().enumerate().map(member).collect::<Result<ByUav<Member>, InputError>>()?;
        Ok(Self {
            members,
            coordination,
            reservations,
            claims: Vec::new(),
            intents: vec![Vec::new(); uavs],
            shared: Shared::default(),
        })
    }

    /// Sets what paces the mission; [`Timing::Free`] by default. In a paced mission a search may end by time, so that
    /// results depend on time.
    pub fn set_timing(&mut self, timing: Timing) {
        self.members.iter_mut().for_each(|member| member.planner.timing = timing);
    }

    /// Lets `stop` end long searches. A plan made after the request must not be flown.
    pub fn set_stop(&mut self, stop: &Stop) {
        self.members.iter_mut().for_each(|member| member.planner.stop = stop.clone());
    }

    /// The stop request that ends long searches.
    pub fn stop(&self) -> &Stop {
        &self.members[0].planner.stop
    }

    /// Observes the flights of a slot, what is told after it, and what the UAVs receive ([`Planner::observe`]). UAVs
    /// that plan on their own have only their own contacts.
    ///
    /// # Panics
    /// If there is not one flight for each UAV.
    pub fn observe(&mut self, sensed: &Sensed<'_>) {
        let Sensed { slot, flights, told, received } = *sensed;
        assert_eq!(flights.len(), self.members.len(), "expected a flight for each UAV");
        for (uav, (Member { planner, subfield, .. }, flight)) in self.members.iter_mut().zip(flights).enumerate() {
            match (subfield, self.coordination) {
                (Some(subfield), _) => {
                    planner.receive(received, uav, |id| subfield.number(id));
                    let own = subfield.numbered(flight);
                    planner.observe(slot, &own, subfield.select(told));
                }
                (None, coordination) => {
                    planner.receive(received, uav, Some);
                    let is_alone = coordination == Coordination::Independent;
                    let known = if is_alone { std::slice::from_ref(flight) } else { flights };
                    planner.observe_with(slot, flight, known, told);
                }
            }
        }
    }

    /// Plans the slot after that of `sensed` from where the UAVs are after its flights, and the queues `B_i(t−1)` and
    /// answers that are told ([`Planner::step`]). The plans have the time that each of them took. What the UAVs receive
    /// is that of the last [`Self::observe`].
    ///
    /// # Panics
    /// If there is not one flight for each UAV.
    #[must_use]
    pub fn step(&mut self, sensed: &Sensed<'_>) -> ByUav<Plan> {
        let Sensed { flights, told, .. } = *sensed;
        let slot = sensed.slot + 1;
        assert_eq!(flights.len(), self.members.len(), "expected a flight for each UAV");
        let begin = Instant::now();
        let duties = self.duties(slot, flights);
        self.begin_slot(slot, flights, told, &duties);
        let Self { members, coordination, reservations, intents, shared, .. } = self;
        let is_sequential = *coordination == Coordination::Sequential;
        let before = begin.elapsed() / members.len() as u32; // at most MAX_UAVS
        let mut plans = ByUav::with_capacity(members.len());
        for (uav, (Member { planner, endurance, subfield, .. }, flight)) in members.iter_mut().zip(flights).enumerate()
        {
            let begin = Instant::now();
            shared.tell(uav, intents);
            let scheduled: &[u32] = if is_sequential { &shared.scheduled } else { &[] };
            let intended = is_sequential.then_some(&shared.intents[..]);
            let reserved = reservations.others_of(&planner.table, slot, uav, *endurance);
            let neighbours = Neighbours { uav, flights, scheduled, intents: intended, reservations: reserved };
            let neighbours = Some(&neighbours).filter(|_| *coordination != Coordination::Independent);
            let own = subfield.as_mut().map_or(told, |subfield| subfield.select(told));
            let mut plan = planner.plan(slot, flight.position(), own, duties[uav], neighbours);
            subfield.iter().for_each(|subfield| plan.renumber(&subfield.ids));
            if is_sequential {
                intents[uav].clear();
                if duties[uav] == Duty::Mission {
                    let intending = neighbours.expect("they talk");
                    planner.visits(slot, flight.position(), told, intending, &mut intents[uav]);
                }
            }
            plan.plan_ns = u64::try_from((before + begin.elapsed()).as_nanos()).unwrap_or(u64::MAX);
            shared.scheduled.extend_from_slice(plan.scheduled());
            reservations.reserve(&planner.table, slot, uav, &flight.position().xy(), &plan);
            plans.push(plan);
        }
        if is_sequential {
            for member in members {
                member.planner.await_reports(slot, &shared.scheduled, told);
            }
        }
        plans
    }

    /// What each UAV has to do in `slot`.
    fn duties(&self, slot: u64, flights: &[FlightReport]) -> ByUav<Duty> {
        let duty = |(member, flight): (&Member, &FlightReport)| match () {
            () if flight.flown_mode() == Mode::Down => Duty::Down,
            () if slot > member.last => Duty::Landing,
            () => Duty::Mission,
        };
        self.members.iter().zip(flights).map(duty).collect()
    }

    /// Takes down where the UAVs are, and what they plan to serve before they plan `slot`.
    fn begin_slot(&mut self, slot: u64, flights: &[FlightReport], told: Told<'_>, duties: &[Duty]) {
        let Self { members, coordination, reservations, claims, intents, shared } = self;
        let is_first = members[0].planner.slot() == 0;
        shared.scheduled.clear();
        for (uav, planned) in intents.iter_mut().enumerate() {
            let Member { planner, endurance, .. } = &mut members[uav];
            planned.clear();
            if is_first {
                let claims = claims.get(uav).into_iter().flatten();
                planned.extend(claims.flat_map(|&id| planner.claimed_visits(slot, id)));
            } else if *coordination == Coordination::Sequential && duties[uav] == Duty::Mission {
                let reservations = reservations.nothing(*endurance);
                let neighbours = Neighbours { uav, flights, scheduled: &[], intents: Some(&[]), reservations };
                planner.visits(slot, flights[uav].position(), told, &neighbours, planned);
            }
        }
        reservations.begin(members.iter().zip(flights).map(|(member, flight)| {
            let table = &member.planner.table;
            let ground = flight.position().xy();
            let has_ended = slot > member.last.saturating_add(table.motion.move_slots());
            (!has_ended || !table.is_home(&ground)).then_some(ground)
        }));
    }

    /// Takes in that `plans`, one for each UAV, are flown in the slot after that of `sensed` instead of those of the
    /// last [`Self::step`].
    pub fn follow(&mut self, sensed: &Sensed<'_>, plans: &[Plan]) {
        let slot = sensed.slot + 1;
        let told = sensed.told;
        let is_known = |id: &u32| (*id as usize) < told.queues_bits.len();
        let scheduled_by = |plan: &Plan| plan.scheduled().iter().copied().filter(is_known).collect::<Vec<u32>>();
        let all: Vec<u32> = plans.iter().flat_map(scheduled_by).collect();
        for (Member { planner, subfield, .. }, plan) in self.members.iter_mut().zip(plans) {
            let own = scheduled_by(plan);
            match subfield {
                Some(subfield) => {
                    let own: Vec<u32> = own.into_iter().filter_map(|id| subfield.number(id)).collect();
                    planner.await_reports(slot, &own, subfield.select(told));
                }
                None if self.coordination == Coordination::Sequential => planner.await_reports(slot, &all, told),
                None => planner.await_reports(slot, &own, told),
            }
        }
    }

    /// The last slot planned by these planners or their restored predecessors; 0 before the first.
    pub fn slot(&self) -> u64 {
        self.members[0].planner.slot()
    }

    /// Whether the plans of a slot depend on the slots before it.
    pub fn has_state(&self) -> bool {
        self.members.iter().any(|member| member.planner.has_state())
    }

    /// What became of the changes that the searches of all UAVs proposed, by operator; empty without a search.
    pub fn counts(&self) -> Vec<(&'static str, OperatorCounts)> {
        let mut all: Vec<(&'static str, OperatorCounts)> = Vec::new();
        for (name, counts) in self.members.iter().flat_map(|member| member.planner.strategy.counts()) {
            match all.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => sum.add(&counts),
                None => all.push((name, counts)),
            }
        }
        all
    }

    /// What the first UAV believes of the queues after the last observed slot.
    pub fn belief(&self) -> &Belief {
        &self.members[0].planner.belief
    }

    /// The waypoints of the last plan of the UAV number `uav` ([`Planner::path`]).
    ///
    /// # Panics
    /// If there is no such UAV.
    pub fn path(&self, uav: usize) -> &[Point3<f64>] {
        self.members[uav].planner.path()
    }
}

/// The scenario of the UAV number `uav`, which plans to be home early if it keeps `separation_m` [m] and has to land.
fn alone(scenario: &Scenario, uav: usize, separation_m: f64) -> Scenario {
    let alone = scenario.of_uav(uav);
    if separation_m == 0.0 || !scenario.must_land() {
        return alone;
    }
    // Into the base one after the other, those of lower number first, which those of higher number await beyond the
    // distance.
    let each = (separation_m / alone.move_m()) as u64; // saturates
    let behind = (scenario.uav.uavs() - 1 - uav) as u64;
    let moves = if each > 0 { each.saturating_add(SPARE_MOVES).saturating_mul(behind) } else { 0 };
    let early = |moves: u64| {
        let slots = alone.slots.saturating_sub(moves.saturating_mul(alone.move_slots())).max(1);
        Some(Scenario { slots, ..alone.clone() }).filter(|early| settings::check(early).is_ok())
    };
    let found = early(moves.saturating_add(SPARE_MOVES)).or_else(|| early(SPARE_MOVES));
    found.unwrap_or(alone)
}

/// Refuses a scenario with several UAVs.
///
/// # Errors
/// If it has several.
pub fn require_one(scenario: &Scenario) -> Result<(), InputError> {
    match scenario.uav.count {
        None | Some(1) => Ok(()),
        Some(count) => Err(scenario.refusal("uav.count", &Value::Integer(count.into()), "1: this plans for one UAV")),
    }
}

fn saved(planner: &Planner) -> Vec<u8> {
    let mut bytes = Vec::new();
    planner.save(&mut bytes);
    bytes
}

impl Checkpoint for FleetPlanner {
    /// That of the planner with one UAV. Appends nothing if no planner has a state.
    fn save(&self, bytes: &mut Vec<u8>) {
        if let [only] = &self.members[..] {
            return only.planner.save(bytes);
        }
        let all: Vec<Vec<u8>> = self.members.iter().map(|member| saved(&member.planner)).collect();
        if all.iter().any(|bytes| !bytes.is_empty()) {
            encode(&all, bytes);
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        if let [only] = &mut self.members[..] {
            return only.planner.restore(bytes);
        }
        let all: Vec<Vec<u8>> = if bytes.is_empty() { vec![Vec::new(); self.members.len()] } else { decode(bytes)? };
        CheckpointError::ensure(all.len() == self.members.len(), "a state of each UAV")?;
        let before: Vec<Vec<u8>> = self.members.iter().map(|member| saved(&member.planner)).collect();
        let restored = self.members.iter_mut().zip(&all).try_for_each(|(member, bytes)| member.planner.restore(bytes));
        if restored.is_err() {
            let back = |(member, bytes): (&mut Member, &Vec<u8>)| member.planner.restore(bytes);
            self.members.iter_mut().zip(&before).try_for_each(back).expect("it was just saved");
        }
        restored
    }
}
