//! The planners of all UAVs of a mission, and how they share the field (decision D22).
//!
//! A strategy sees one UAV. With one UAV, its planner plans as if this were not here.

use std::f64::consts::FRAC_1_SQRT_2;
use std::time::Instant;

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use skysink_common::base::Base;
use skysink_common::belief::Belief;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::error::InputError;
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, LinkReport, MAX_SERVED, Mode, Plan, SensorNode};
use skysink_common::scenario::{Coordination, Scenario};
use skysink_common::slot_record::ByUav;
use skysink_common::stop::Stop;
use toml::Value;

use crate::mission_table::MissionTable;
use crate::partition;
use crate::planner::{Others, Planner};
use crate::separation::Apart;
use crate::settings;
use crate::strategy::{MakeStrategy, PlannedVisit, Registered, Timing};

/// A place that is near to none [m].
const NOWHERE: [f64; 2] = [f64::NEG_INFINITY; 2];

/// Moves by which UAVs that have to land and keep apart plan to be home before they must: they may lose them to each
/// other.
const SPARE_MOVES: u64 = 3;

/// The planners of the UAVs of a mission.
pub struct FleetPlanner {
    members: ByUav<Member>,
    coordination: Coordination,
    /// Least distance between the ends of slots of two UAVs [m]; 0 for any, or if they do not talk.
    separation_m: f64,
    /// Whether a place that a UAV leaves is kept clear for the slot: two moves around a corner of a grid, one after the
    /// other, would come too near.
    keeps_begins: bool,
    /// The SNs that each UAV is expected to serve before it has planned ahead; empty if none does.
    claims: Vec<Vec<u32>>,
    /// What is told to the next UAV; working memory.
    told: Told,
}

/// What the UAVs tell each other in a slot.
#[derive(Default)]
struct Told {
    /// The SNs that are scheduled.
    scheduled: Vec<u32>,
    /// What each UAV plans to serve.
    planned: Vec<Vec<PlannedVisit>>,
    /// What all but one plan to serve, by slot.
    visits: Vec<PlannedVisit>,
    /// Where the UAVs end that have planned, and where the others are [m].
    places: Vec<Position>,
    /// Where they begin [m].
    begins: Vec<Position>,
    /// Both for one of them.
    others: Vec<Position>,
    /// The base, which is exempt from their distance.
    base: Option<Base>,
    /// The last slot of each UAV.
    lasts: Vec<u64>,
}

impl Told {
    /// What is told to the UAV number `uav`, that keeps `separation_m` [m] and `stays` or gives way: where the others
    /// are, and in a `sequential` fleet what they serve.
    fn to<'a>(
        &'a mut self,
        uav: usize,
        flights: &'a [FlightReport],
        separation_m: f64,
        stays: bool,
        is_sequential: bool,
    ) -> Others<'a> {
        self.others.clear();
        self.others.extend_from_slice(&self.places[..uav]);
        self.others.extend_from_slice(&self.begins[..uav.min(self.begins.len())]);
        let lower = self.others.len();
        self.others.extend_from_slice(&self.places[uav + 1..]);
        let (base, last) = (self.base.as_ref(), self.lasts[uav]);
        let apart = Apart { separation_m, places: &self.others, lower, stays, base, last };
        if !is_sequential {
            return Others { scheduled: &[], visits: None, apart, uav, flights };
        }
        self.visits.clear();
        for (_, planned) in self.planned.iter().enumerate().filter(|(other, _)| *other != uav) {
            self.visits.extend_from_slice(planned);
        }
        self.visits.sort_by_key(|visit| (visit.slot, visit.sensor));
        Others { scheduled: &self.scheduled, visits: Some(&self.visits), apart, uav, flights }
    }
}

/// A UAV of a fleet.
struct Member {
    planner: Planner,
    /// The last slot of its mission; after it, it only rests ([`Planner::rest`]).
    last: u64,
    /// The SNs that it plans for, ascending; `None` for all of them.
    piece: Option<Piece>,
}

/// A part of the SNs: a planner numbers them from 0.
struct Piece {
    /// The id of each in the mission, ascending.
    ids: Vec<u32>,
    /// Their queues [bit]; working memory.
    queues_bits: Vec<u32>,
}

impl Piece {
    /// The queues of the piece [bit].
    fn select(&mut self, queues_bits: &[u32]) -> &[u32] {
        self.queues_bits.clear();
        self.queues_bits.extend(self.ids.iter().map(|&id| queues_bits[id as usize]));
        &self.queues_bits
    }

    /// The flight with the links to SNs of the piece, by their numbers in it.
    fn numbered(&self, flight: &FlightReport) -> FlightReport {
        let mut own = FlightReport { served: 0, links: [LinkReport::default(); MAX_SERVED], ..*flight };
        for link in flight.served_links() {
            if let Ok(number) = self.ids.binary_search(&link.sensor) {
                own.links[own.served as usize] = LinkReport { sensor: number as u32, ..*link };
                own.served += 1;
            }
        }
        own
    }
}

impl From<Planner> for FleetPlanner {
    /// The planner of a single UAV.
    fn from(planner: Planner) -> Self {
        let members = ByUav::from_iter([Member { planner, last: u64::MAX, piece: None }]);
        Self {
            members,
            coordination: Coordination::default(),
            separation_m: 0.0,
            keeps_begins: false,
            claims: Vec::new(),
            told: Told::default(),
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
            planners.claims = partition::pieces(&MissionTable::of(scenario, sensors), scenario, &slots, stop);
        }
        Ok(planners)
    }

    /// The same with the strategies that `make` makes, one for each UAV, instead of the scenario's. Where each UAV has a
    /// part of the field, the SNs of its setup are those of its part, numbered from 0.
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
            return Ok(Planner::by(scenario, sensors, make, stop)?.into());
        }
        let coordination = scenario.uav.coordination.unwrap_or_default();
        let talks = coordination != Coordination::Independent;
        let separation_m = scenario.uav.separation_m.filter(|_| talks).unwrap_or(0.0);
        let alone: Vec<Scenario> = (0..uavs).map(|uav| alone(scenario, uav, separation_m)).collect();
        let is_divided = coordination == Coordination::Partition;
        let slots: Vec<u64> = alone.iter().map(|alone| alone.slots).collect();
        let pieces = || partition::pieces(&MissionTable::of(scenario, sensors), scenario, &slots, stop);
        let mut pieces = if is_divided { pieces() } else { Vec::new() };
        pieces.reverse();
        let member = |alone: &Scenario| {
            let Some(ids) = pieces.pop() else {
                let planner = Planner::by(alone, sensors, make, stop)?;
                return Ok(Member { planner, last: alone.slots, piece: None });
            };
            let own: Vec<SensorNode> = ids.iter().map(|&id| sensors[id as usize]).collect();
            let planner = Planner::by(alone, &own, make, stop)?;
            Ok(Member { planner, last: alone.slots, piece: Some(Piece { ids, queues_bits: Vec::new() }) })
        };
        let mut members = alone.iter().map(member).collect::<Result<ByUav<Member>, InputError>>()?;
        if coordination == Coordination::Sequential {
            let firsts: Option<Vec<u32>> = members.iter().map(|member| member.planner.first_of_round()).collect();
            if let Some(firsts) = firsts {
                members.iter_mut().enumerate().for_each(|(uav, member)| member.planner.take_part(uav, &firsts));
            }
        }
        let planned = vec![Vec::new(); uavs];
        let lasts = (0..uavs).map(|uav| scenario.slots_of(uav)).collect();
        let is_wide = |cell_m: f64| separation_m > cell_m * FRAC_1_SQRT_2 && scenario.move_slots() > 1;
        let keeps_begins = scenario.uav.grid_m().is_some_and(is_wide);
        Ok(Self {
            members,
            coordination,
            separation_m,
            keeps_begins,
            claims: Vec::new(),
            told: Told { planned, base: scenario.landing_base(), lasts, ..Told::default() },
        })
    }

    /// Sets what paces the mission ([`Planner::set_timing`]).
    pub fn set_timing(&mut self, timing: Timing) {
        self.members.iter_mut().for_each(|member| member.planner.set_timing(timing));
    }

    /// Lets `stop` end long searches ([`Planner::set_stop`]).
    pub fn set_stop(&mut self, stop: &Stop) {
        self.members.iter_mut().for_each(|member| member.planner.set_stop(stop));
    }

    /// The stop request that ends long searches.
    #[must_use]
    pub fn stop(&self) -> &Stop {
        self.members[0].planner.stop()
    }

    /// Observes the flights of `slot`, and the queues after it [bit], by id ([`Planner::observe`]). UAVs that plan on
    /// their own have only their own contacts.
    ///
    /// # Panics
    /// If there is not one flight for each UAV.
    pub fn observe(&mut self, slot: u64, flights: &[FlightReport], queues_bits: &[u32]) {
        assert_eq!(flights.len(), self.members.len(), "expected a flight for each UAV");
        for (Member { planner, piece, .. }, flight) in self.members.iter_mut().zip(flights) {
            match (piece, self.coordination) {
                (Some(piece), _) => {
                    let own = piece.numbered(flight);
                    planner.observe(slot, &own, piece.select(queues_bits));
                }
                (None, Coordination::Independent) => planner.observe(slot, flight, queues_bits),
                (None, _) => planner.observe_with(slot, flight, flights, queues_bits),
            }
        }
    }

    /// Plans `slot` from where the UAVs are after `flights`, and the queues `B_i(t−1)` [bit], by id
    /// ([`Planner::step`]). The plans have the time that each of them took.
    ///
    /// # Panics
    /// If there is not one flight for each UAV.
    #[must_use]
    pub fn step(&mut self, slot: u64, flights: &[FlightReport], queues_bits: &[u32]) -> ByUav<Plan> {
        assert_eq!(flights.len(), self.members.len(), "expected a flight for each UAV");
        let Self { members, coordination, separation_m, keeps_begins, claims, told } = self;
        let is_several = members.len() > 1;
        let is_sequential = *coordination == Coordination::Sequential && is_several;
        let begin = Instant::now();
        told.scheduled.clear();
        let is_first = members[0].planner.slot() == 0;
        for (uav, planned) in told.planned.iter_mut().enumerate() {
            let Member { planner, last, .. } = &mut members[uav];
            planned.clear();
            if is_first {
                let claims = claims.get(uav).into_iter().flatten();
                planned.extend(claims.flat_map(|&id| planner.claimed_visits(slot, id)));
            } else if is_sequential && slot <= *last && !is_down(&flights[uav]) {
                planner.visits(slot, flights[uav].position(), queues_bits, planned);
            }
        }
        told.places.clear();
        told.places.extend(members.iter().zip(flights).map(|(member, flight)| {
            let ground = flight.position().xy();
            // One that has landed is in nobody's way.
            if slot > member.last.saturating_add(member.planner.move_slots()) && member.planner.is_home(&ground) {
                NOWHERE.into()
            } else {
                ground
            }
        }));
        told.begins.clear();
        if *keeps_begins {
            told.begins.extend_from_slice(&told.places);
        }
        let before = begin.elapsed() / members.len() as u32; // at most MAX_UAVS
        let mut plans = ByUav::with_capacity(members.len());
        for (uav, (Member { planner, last, piece }, flight)) in members.iter_mut().zip(flights).enumerate() {
            let begin = Instant::now();
            let position = flight.position();
            let mut plan = match piece {
                _ if is_several && is_down(flight) => {
                    told.planned[uav].clear();
                    planner.lie(slot, position, queues_bits)
                }
                _ if slot > *last => {
                    let stays = planner.stays(slot, uav);
                    let apart = told.to(uav, flights, *separation_m, stays, false).apart;
                    planner.rest(slot, position, queues_bits, &apart)
                }
                Some(piece) => {
                    let stays = planner.stays(slot, uav);
                    let others = Some(told.to(uav, flights, *separation_m, stays, false));
                    let mut plan = planner.step_beside(slot, position, piece.select(queues_bits), others);
                    plan.renumber(&piece.ids);
                    plan
                }
                None if is_sequential => {
                    let stays = planner.stays(slot, uav);
                    let others = Some(told.to(uav, flights, *separation_m, stays, true));
                    let plan = planner.step_beside(slot, position, queues_bits, others);
                    let planned = &mut told.planned[uav];
                    planned.clear();
                    planner.visits(slot, position, queues_bits, planned);
                    plan
                }
                None => planner.step(slot, position, queues_bits),
            };
            plan.plan_ns = u64::try_from((before + begin.elapsed()).as_nanos()).unwrap_or(u64::MAX);
            told.scheduled.extend_from_slice(plan.scheduled());
            if told.places[uav] != NOWHERE.into() {
                told.places[uav] = planner.end_of(slot, &position.xy(), &plan.waypoint().xy());
            }
            plans.push(plan);
        }
        if is_sequential {
            for member in members {
                member.planner.await_reports(slot, &told.scheduled, queues_bits);
            }
        }
        plans
    }

    /// Takes in that `plans`, one for each UAV, are flown in `slot` instead of those of the last [`Self::step`]. The
    /// queues are those before the slot [bit], by id.
    pub fn follow(&mut self, slot: u64, plans: &[Plan], queues_bits: &[u32]) {
        let is_known = |id: &u32| (*id as usize) < queues_bits.len();
        let scheduled_by = |plan: &Plan| plan.scheduled().iter().copied().filter(is_known).collect::<Vec<u32>>();
        let all: Vec<u32> = plans.iter().flat_map(scheduled_by).collect();
        for (Member { planner, piece, .. }, plan) in self.members.iter_mut().zip(plans) {
            let own = scheduled_by(plan);
            match piece {
                Some(piece) => {
                    let number = |id: &u32| piece.ids.binary_search(id).ok().map(|number| number as u32);
                    let own: Vec<u32> = own.iter().filter_map(number).collect();
                    planner.await_reports(slot, &own, piece.select(queues_bits));
                }
                None if self.coordination == Coordination::Sequential => planner.await_reports(slot, &all, queues_bits),
                None => planner.await_reports(slot, &own, queues_bits),
            }
        }
    }

    /// The last slot planned by these planners or their restored predecessors; 0 before the first.
    #[must_use]
    pub fn slot(&self) -> u64 {
        self.members[0].planner.slot()
    }

    /// Whether the plans of a slot depend on the slots before it.
    #[must_use]
    pub fn has_state(&self) -> bool {
        self.members.iter().any(|member| member.planner.has_state())
    }

    /// What the first UAV believes of the queues after the last observed slot.
    #[must_use]
    pub fn belief(&self) -> &Belief {
        self.members[0].planner.belief()
    }

    /// The waypoints of the last plan of the UAV number `uav` ([`Planner::path`]).
    ///
    /// # Panics
    /// If there is no such UAV.
    #[must_use]
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
    let move_m = scenario.uav.grid_m().unwrap_or_else(|| scenario.reach_m());
    let each = (separation_m / move_m) as u64; // saturates
    let behind = (scenario.uav.uavs() - 1 - uav) as u64;
    let moves = if each > 0 { each.saturating_add(SPARE_MOVES).saturating_mul(behind) } else { 0 };
    let early = |moves: u64| {
        let slots = alone.slots.saturating_sub(moves.saturating_mul(scenario.move_slots())).max(1);
        Some(Scenario { slots, ..alone.clone() }).filter(|early| settings::check(early).is_ok())
    };
    let found = early(moves.saturating_add(SPARE_MOVES)).or_else(|| early(SPARE_MOVES));
    found.unwrap_or(alone)
}

/// Whether the energy of the UAV has ended.
fn is_down(flight: &FlightReport) -> bool {
    flight.flown_mode() == Mode::Down
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

/// The checkpoint of a planner.
fn saved(planner: &Planner) -> Vec<u8> {
    let mut bytes = Vec::new();
    planner.save(&mut bytes);
    bytes
}

/// The checkpoint of several planners.
#[derive(Serialize, Deserialize)]
struct Saved(Vec<Vec<u8>>);

impl Checkpoint for FleetPlanner {
    /// That of the planner with one UAV. Appends nothing if no planner has a state.
    fn save(&self, bytes: &mut Vec<u8>) {
        if let [only] = &self.members[..] {
            return only.planner.save(bytes);
        }
        let all: Vec<Vec<u8>> = self.members.iter().map(|member| saved(&member.planner)).collect();
        if all.iter().any(|bytes| !bytes.is_empty()) {
            encode(&Saved(all), bytes);
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        if let [only] = &mut self.members[..] {
            return only.planner.restore(bytes);
        }
        let Saved(all) = if bytes.is_empty() { Saved(vec![Vec::new(); self.members.len()]) } else { decode(bytes)? };
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
