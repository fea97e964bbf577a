//! An episode of the environment: a mission flown by actions.

mod expert;

use std::borrow::Cow;
use std::sync::{Arc, LazyLock};

use pyo3::prelude::*;
use skysink_common::arrivals::mean_bits;
use skysink_common::battery::BatteryState;
use skysink_common::belief::Belief;
use skysink_common::checkpoint::{Checkpoint, decode, encode};
use skysink_common::error::InputError;
use skysink_common::message::{FlightReport, Mode, Plan};
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::{ByUav, UAV};
use skysink_common::stop::Stop;
use skysink_common::told::Heard;
use skysink_mission::Plant;
use skysink_planner::fleet::require_one;
use skysink_planner::neighbours::{Neighbours, ReservationTable};
use skysink_planner::rules::{Duty, RuleBook, Ruled};
use skysink_planner::settings;
use skysink_planner::strategy::{Decision, Timing, View};

use crate::belief::{Contacts, believed};
use crate::errors::refused;
use crate::field::FieldData;
use crate::rules::{Kind, Reward, Rules};
use crate::scenario::PyScenario;
use crate::strategy::PyDecision;
use expert::Experts;

/// The field and the UAVs of a scenario, with what the UAVs believe of the queues.
pub fn plant(scenario: &Scenario, list: &SensorList) -> PyResult<Plant> {
    let estimated = settings::estimated(scenario).map_err(refused)?;
    Ok(Plant::new(scenario, list).with_belief(Belief::of(scenario, list, estimated)))
}

/// What the episodes of an environment have in common.
pub struct Course {
    /// The scenario; its seed is that of the first field.
    scenario: Scenario,
    rules: Arc<Rules>,
}

impl Course {
    /// The seed of the episode with this number.
    pub fn seed(&self, number: u64) -> u64 {
        self.rules.fields.map_or(number, |count| self.scenario.seed + number % count)
    }

    /// The same, if it is that of a scenario.
    pub fn checked_seed(&self, number: u64) -> PyResult<u64> {
        let seed = self.seed(number);
        if i64::try_from(seed).is_err() {
            let message = format!("{seed}: expected 0 to {}", i64::MAX);
            return Err(refused(InputError::of_argument("seed", &seed.to_string(), message)));
        }
        Ok(seed)
    }

    /// The mission of the episode with this number, with the models of its environment.
    pub fn prepared(&self, number: u64) -> PyResult<Scenario> {
        let scenario = Scenario { seed: self.checked_seed(number)?, ..self.scenario.clone() };
        let Some(prepare) = &self.rules.prepare else { return Ok(scenario) };
        Python::attach(|py| PyScenario::prepared(py, prepare, &scenario))
    }
}

/// The stop that nobody requests.
static NEVER: LazyLock<Stop> = LazyLock::new(Stop::default);

/// A running episode.
#[derive(Clone)]
pub struct Episode {
    pub course: Arc<Course>,
    /// In a vector of n, environment i has the numbers i, i + n, i + 2n and so on, plus that of the first.
    pub number: u64,
    /// Whether a reset has begun an episode of its environment.
    pub has_begun: bool,
    /// The UAV that observes and acts; [`Episode::act_as`] changes it.
    pub uav: usize,
    pub list: Arc<SensorList>,
    /// The field, with the limits of this UAV.
    pub field: Arc<FieldData>,
    /// The fields with the limits of each kind of UAVs.
    fields: Arc<[Arc<FieldData>]>,
    pub plant: Plant,
    /// The plant before slot 1.
    fresh: Arc<Plant>,
    pub contacts: Contacts,
    pub experts: Experts,
    decided: Vec<OwnRules>,
    /// Where the UAVs that plan before others end the slot.
    reservations: ReservationTable,
    /// Positions of the sensor nodes, x and y alternating, as fractions of the area; empty if they are not observed.
    pub positions: Arc<[f32]>,
    /// Weights of the sensor nodes, by id; empty if the reward is not weighted.
    pub weights: Arc<[f64]>,
    /// Mean of the bits that the field samples in the mission.
    pub expected_bits: f64,
    /// Whether what it samples is drawn.
    pub has_random_arrivals: bool,
    /// The highest mean that a sensor node can have [bit per slot].
    pub highest_mean_bits: f64,
}

/// What computes schedules and altitudes: made when it is first asked for, and not copied with an episode.
#[derive(Default)]
struct OwnRules(Option<Box<RuleBook>>);

impl Clone for OwnRules {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// The result of one slot of an episode.
#[derive(Clone, Copy, Default)]
pub struct Outcome {
    pub reward: f64,
    pub delivered_bits: u64,
    pub lost_bits: u64,
    /// Whether the mission is over.
    pub is_over: bool,
    /// Whether the UAV is down, which ends the episode, too.
    pub is_down: bool,
}

impl Episode {
    /// The first episode of an environment with these rules.
    pub fn first(scenario: &PyScenario, rules: &Arc<Rules>) -> PyResult<Self> {
        let scenario = scenario.scenario.clone();
        let fields = rules.fields;
        if fields.is_some_and(|count| scenario.seed.checked_add(count).is_none_or(|end| i64::try_from(end).is_err())) {
            return Err(refused(format!("fields = {}: expected fewer", fields.unwrap_or(0))));
        }
        if rules.kind != Kind::Agents {
            require_one(&scenario).map_err(refused)?;
        } else if (0..scenario.uav.uavs()).any(|uav| scenario.endurance_s_of(uav).is_some()) {
            return Err(refused("uav.endurances_s: expected none, because all agents have the same time"));
        }
        let is_free = scenario.uav.climb().is_some();
        if scenario.uav_kinds().any(|uav| uav.climb().is_some() != is_free) {
            return Err(refused(
                "uav.each: expected a free altitude of all agents or of none, whose spaces are the same",
            ));
        }
        let number = if fields.is_some() { 0 } else { scenario.seed };
        let first = Self::new(Arc::new(Course { scenario, rules: Arc::clone(rules) }), number)?;
        if let Some(nearest) = rules.observed.nearest.filter(|nearest| !(1..=first.field.count()).contains(nearest)) {
            let expected = format!("1 to {}, the sensor nodes of the scenario", first.field.count());
            return Err(refused(format!("nearest = {nearest}: expected {expected}")));
        }
        Ok(first)
    }

    /// The first episode over another scenario. Its observations and actions have the same shape.
    pub fn over(&self, scenario: &PyScenario) -> PyResult<Self> {
        let other = Self::first(scenario, &self.course.rules)?;
        let name = &scenario.scenario.name;
        let uavs = |episode: &Self| episode.plant.flights().len();
        if uavs(&other) != uavs(self) {
            return Err(refused(format!("scenario {name}: {} UAVs: expected {}", uavs(&other), uavs(self))));
        }
        let count = |episode: &Self| episode.field.count();
        let in_state = |episode: &Self| (self.rules().kind == Kind::Agents).then(|| count(episode));
        let spaces = |episode: &Self| (episode.boxes(), episode.action_size(), episode.axes(), in_state(episode));
        if spaces(&other) != spaces(self) {
            let altitude = |episode: &Self| if episode.axes() == 3 { "a free altitude" } else { "a fixed altitude" };
            let found = format!("{} sensor nodes, {}", count(&other), altitude(&other));
            let expected = format!("{} and {}, because spaces stay the same", count(self), altitude(self));
            return Err(refused(format!("scenario {name}: {found}: expected {expected}")));
        }
        Ok(other)
    }

    /// The episode with this number, before its first slot.
    fn new(course: Arc<Course>, number: u64) -> PyResult<Self> {
        let scenario = course.prepared(number)?;
        let list = SensorList::of(&scenario).map_err(refused)?;
        let plant = plant(&scenario, &list)?;
        let nodes = plant.field().belief().known_nodes(list.nodes(), scenario.slot_s);
        let of_kind = |kind: Cow<'_, Scenario>| FieldData::of(&kind, nodes.clone());
        let fields = scenario.kinds().map(of_kind).collect::<PyResult<Arc<[_]>>>()?;
        let field = Arc::clone(&fields[0]);
        let Rules { observed, reward, .. } = &*course.rules;
        let weights = list.sensors().iter().map(|sensor| sensor.weight);
        let known_bits = field.sensors.ids().map(|id| field.sensors.sampler(id).mean_bits);
        let highest_of_range = mean_bits(scenario.sensors.sampling_bps.ends()[1], scenario.slot_s);
        Ok(Self {
            number,
            has_begun: false,
            uav: UAV,
            experts: Experts::default(),
            decided: vec![OwnRules::default(); fields.len()],
            reservations: ReservationTable::of(&scenario),
            contacts: Contacts::none(if course.rules.keeps_contacts() { field.count() } else { 0 }),
            positions: if observed.has("positions") { field.position_fractions().collect() } else { Arc::default() },
            weights: if *reward == Reward::Weighted { weights.collect() } else { Arc::default() },
            has_random_arrivals: scenario.arrival_law().is_random(),
            expected_bits: list.slot_bits(&scenario) * scenario.slots as f64,
            highest_mean_bits: known_bits.fold(highest_of_range, f64::max),
            list: Arc::new(list),
            course,
            field,
            fields,
            fresh: Arc::new(plant.clone()),
            plant,
        })
    }

    /// The episode with this number. It reuses the sensor nodes if they are the same.
    pub fn begin(&mut self, number: u64) -> PyResult<()> {
        if self.course.seed(number) != self.seed() {
            let has_begun = self.has_begun;
            *self = Self { has_begun, ..Self::new(Arc::clone(&self.course), number)? };
            return Ok(());
        }
        self.plant = match self.course.rules.prepare {
            Some(_) => plant(&self.course.prepared(number)?, &self.list)?,
            None => Plant::clone(&self.fresh),
        };
        self.contacts = Contacts::none(self.contacts.slots().len());
        self.experts = Experts::default();
        self.number = number;
        Ok(())
    }

    /// The episode with this number, by a reset.
    pub fn reset(&mut self, number: u64) -> PyResult<()> {
        self.begin(number)?;
        self.has_begun = true;
        Ok(())
    }

    /// The number that a reset begins without a seed, in a vector of `count` environments.
    pub fn following(&self, count: u64) -> u64 {
        if self.has_begun { self.number + count } else { self.number }
    }

    pub fn rules(&self) -> &Rules {
        &self.course.rules
    }

    pub fn seed(&self) -> u64 {
        self.course.seed(self.number)
    }

    /// Lets the UAV number `uav` observe and act.
    pub fn act_as(&mut self, uav: usize) {
        self.uav = uav;
        self.field = Arc::clone(&self.fields[self.kind()]);
    }

    /// The kind of the UAV that observes and acts.
    fn kind(&self) -> usize {
        self.course.scenario.kind_of(self.uav)
    }

    /// The last flight of the UAV that observes and acts.
    pub fn flight(&self) -> &FlightReport {
        self.plant.flight(self.uav)
    }

    /// Flies the next slot by the plan of each UAV.
    pub fn fly(&mut self, plans: &[Option<Plan>]) -> Outcome {
        let reward = self.course.rules.reward;
        let before = self.plant.header().totals;
        let weighted = Reward::weighted_bits(self);
        self.experts.follow(&self.plant, plans);
        let header = self.plant.step(plans).header;
        if !self.contacts.slots().is_empty() {
            self.plant.flights().iter().for_each(|flight| self.contacts.add(self.plant.slot(), flight));
        }
        Outcome {
            reward: reward.of(self, &before, weighted),
            delivered_bits: header.delivered_bits,
            lost_bits: header.lost_bits,
            is_over: self.plant.is_over(),
            is_down: self.is_down(),
        }
    }

    /// What the UAV sees of the next slot.
    pub fn view(&self) -> View<'_> {
        let flight = self.flight();
        View {
            slot: self.plant.slot() + 1,
            position: flight.position(),
            battery: BatteryState::from(flight),
            belief: believed(&self.plant, &self.field),
            table: &self.field,
            timing: Timing::Free,
            heard: &Heard::NOTHING,
            neighbours: None,
            stop: &NEVER,
        }
    }

    /// Calls `work` with what the UAV sees, and with the rules for it.
    fn served<T>(&mut self, work: impl FnOnce(&View<'_>, &mut RuleBook) -> T) -> T {
        let kind = self.kind();
        let mut rules = self.decided[kind].0.take().unwrap_or_else(|| Box::new(self.field.rules()));
        let done = work(&self.view(), &mut rules);
        self.decided[kind].0 = Some(rules);
        done
    }

    /// The plan by a decision of a strategy in Python.
    pub fn decided(&mut self, decision: &PyDecision, mode: Mode) -> PyResult<Plan> {
        let decision = self.served(|view, rules| decision.decide(view, &mut rules.serving))?;
        Ok(self.ruled(decision, mode, None))
    }

    /// Begins the plans of a slot, of all UAVs by their numbers.
    pub fn begin_plans(&mut self) {
        self.reservations.begin(self.plant.flights().iter().map(|flight| Some(flight.position().xy())));
    }

    /// The plan of one of several UAVs by `decision`, after those of lower number.
    pub fn ruled_beside(&mut self, decision: Decision) -> Plan {
        let slot = self.plant.slot() + 1;
        let mut reservations = std::mem::take(&mut self.reservations);
        let last = self.field.limits.slots;
        let reserved = reservations.others_of(&self.field, slot, self.uav, last);
        let flights: ByUav<FlightReport> = self.plant.flights().iter().copied().collect();
        let neighbours =
            Neighbours { uav: self.uav, flights: &flights, scheduled: &[], intents: None, reservations: reserved };
        let plan = self.ruled(decision, Mode::Serve, Some(&neighbours));
        reservations.reserve(&self.field, slot, self.uav, &flights[self.uav].position().xy(), &plan);
        self.reservations = reservations;
        plan
    }

    /// The plan by `decision`. If the environment has the rules for strategies, what becomes of it by them.
    pub fn ruled(&mut self, decision: Decision, mode: Mode, neighbours: Option<&Neighbours<'_>>) -> Plan {
        let duty = if self.flight().flown_mode() == Mode::Down { Duty::Down } else { Duty::Mission };
        let ruled = match self.course.rules.has_return_rule {
            true => self.served(|view, rules| {
                let view = View { neighbours, ..*view };
                rules.decide(&view, duty, &mut |_| Some(decision.clone()))
            }),
            false => Ruled { decision, mode: Mode::Serve },
        };
        let Ruled { decision, mode: by_rule } = ruled;
        let mut plan = Plan::fly_to(decision.waypoint, if by_rule == Mode::Serve { mode } else { by_rule });
        plan.schedule(&decision.schedule);
        plan
    }

    /// Whether all UAVs are down (decision D12).
    fn is_down(&self) -> bool {
        self.plant.flights().iter().all(|flight| flight.flown_mode() == Mode::Down)
    }

    /// Whether no slot follows: the mission is over, or the UAV is down.
    pub fn is_over(&self) -> bool {
        self.plant.is_over() || self.is_down()
    }

    pub fn save(&self) -> Vec<u8> {
        let mut plant = Vec::new();
        self.plant.save(&mut plant);
        let mut bytes = Vec::new();
        encode(&(self.number, self.has_begun, plant, self.contacts.slots()), &mut bytes);
        bytes
    }

    /// Restores a state that [`Episode::save`] returned for the same environment. Refuses any other.
    pub fn restore(&mut self, bytes: &[u8]) -> PyResult<()> {
        let (number, has_begun, plant, contacts): (u64, bool, Vec<u8>, Vec<u64>) = decode(bytes).map_err(refused)?;
        let mut episode = Self { has_begun, ..self.clone() };
        episode.begin(number)?;
        episode.plant.restore(&plant).map_err(refused)?;
        let slot = episode.plant.slot();
        episode.contacts = Contacts::restored(contacts, episode.contacts.slots().len(), slot).map_err(refused)?;
        *self = episode;
        Ok(())
    }
}
