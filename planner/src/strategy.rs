//! What a strategy is: the trait, its input and output for a slot, and its entry in the registry.
//!
//! The strategies and their registry, [`crate::strategies`], are left to the modules above.

mod registered;

use arrayvec::ArrayVec;
use nalgebra::Point3;
use skysink_common::battery::BatteryState;
use skysink_common::belief::{Belief, Believed};
use skysink_common::channel::ChannelModel;
use skysink_common::checkpoint::Checkpoint;
use skysink_common::error::InputError;
use skysink_common::geometry::{Position, above};
use skysink_common::message::{FlightReport, MAX_SERVED, SensorNode, SolverOutcome};
use skysink_common::nodes::Answer;
use skysink_common::scenario::Scenario;
use skysink_common::stop::Stop;
use skysink_common::told::{Heard, Told};

use crate::keys::Settings;
use crate::mission_table::MissionTable;
use crate::neighbours::{Neighbours, PlannedVisit};
use crate::operator_counts::OperatorCounts;

pub use registered::{Registered, StrategyKeys};

/// A planning strategy: decides one slot from the state after the one before.
///
/// It reads no clock unless the mission is paced, draws random numbers only from [`skysink_common::random`], and saves
/// all its state in its checkpoint.
///
/// ```
/// use skysink_common::{checkpoint::Checkpoint, message::SolverOutcome};
/// use skysink_planner::strategy::{Decision, Strategy, View};
/// use skysink_planner::waypoint::problem::Waypoint;
/// struct Stay;
/// impl Checkpoint for Stay {} // it has no state
/// impl Strategy for Stay {
///     fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
///         Some(Decision::serve(view, &Waypoint { point: view.position, outcome: SolverOutcome::Rule }, &[]))
///     }
/// }
/// assert!(Stay.path().is_empty());
/// ```
pub trait Strategy: Checkpoint {
    /// The decision for the slot of `view`; `None` if no sensor node is in reach, which leaves the slot to transit
    /// (decision D8).
    fn plan(&mut self, view: &View<'_>) -> Option<Decision>;

    /// Observes the flights of `slot` that the UAV knows of, and what is believed after them: its own, and in a fleet
    /// that talks those of all UAVs, by their numbers. Their links are its contacts.
    fn observe(&mut self, _slot: u64, _flights: &[FlightReport], _belief: &Belief) {}

    /// The planned waypoints after the last decided one, from strategies that look ahead.
    fn path(&self) -> &[Point3<f64>] {
        &[]
    }

    /// What became of the changes that its searches proposed, by operator; nothing from strategies that do not search.
    fn counts(&self) -> Vec<(&'static str, OperatorCounts)> {
        Vec::new()
    }

    /// Appends what the plan of the slot of `view` serves from that slot on; before it is made, what the plan of the
    /// slot before would. Nothing from strategies that do not look ahead.
    fn visits(&mut self, _view: &View<'_>, _into: &mut Vec<PlannedVisit>) {}
}

/// Makes the strategy of a UAV from its setup. In a fleet it is called for one UAV after the other, by their numbers.
pub type MakeStrategy<'a> = dyn FnMut(&Setup<'_>) -> Result<Box<dyn Strategy>, InputError> + 'a;

/// A strategy without state, which decides each slot by the rule `decide`, as [`Strategy::plan`] does.
///
/// ```
/// use skysink_planner::strategy::{Registered, rule};
/// const WAIT: Registered = Registered::new("wait", "never serve", |_| rule(|_| None));
/// assert!(WAIT.is_stateless);
/// ```
#[must_use]
pub fn rule(decide: impl FnMut(&View<'_>) -> Option<Decision> + 'static) -> Box<dyn Strategy> {
    Box::new(ByRule(decide))
}

/// The strategy of [`rule`].
pub(crate) struct ByRule<F>(pub F);

impl<F> Checkpoint for ByRule<F> {}

impl<F: FnMut(&View<'_>) -> Option<Decision>> Strategy for ByRule<F> {
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        (self.0)(view)
    }
}

/// The input of a strategy for a slot.
///
/// ```
/// use skysink_common::{battery::BatteryState, belief::Believed, scenario::Scenario, sensors::SensorList};
/// use skysink_planner::strategy::{OwnedSetup, Timing, View};
/// let scenario = Scenario::letter(Default::default()).unwrap();
/// let list = SensorList::of(&scenario).unwrap();
/// let OwnedSetup { scenario, table, stop, .. } = &OwnedSetup::new(scenario, &list.nodes()).unwrap();
/// let position = scenario.start();
/// let battery = BatteryState::default();
/// let queues_bits = list.queues_bits();
/// let belief = Believed::known(0, &table.sensors, &queues_bits);
/// let timing = Timing::Free;
/// let heard = &skysink_common::told::Heard::NOTHING;
/// let neighbours = None;
/// let view = View { slot: 1, position, battery, belief, table, timing, heard, neighbours, stop };
/// assert_eq!((view.ground(), view.value(3)), ([50.0, 50.0].into(), queues_bits[3])); // all weights are equal
/// assert_eq!(view.values(&mut Vec::new()), queues_bits);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// The slot to plan, t; the first is 1.
    pub slot: u64,
    /// Position of the UAV at its beginning, `L_u(t−1)` [m].
    pub position: Point3<f64>,
    /// The battery at its beginning.
    pub battery: BatteryState,
    /// What is believed at its beginning: known or estimated queues, `B_i(t−1)`, and rates.
    pub belief: Believed<'a>,
    /// The SNs and the limits of the UAV.
    pub table: &'a MissionTable,
    /// Whether a search may read a clock.
    pub timing: Timing,
    /// What else it has received before the slot, such as the SNRs that it hears.
    pub heard: &'a Heard,
    /// What the other UAVs tell; `None` for a UAV that plans alone.
    pub neighbours: Option<&'a Neighbours<'a>>,
    /// Ends long searches; the decision is then not flown.
    pub stop: &'a Stop,
}

/// How far beside a fixed flight a UAV is on it [m].
const BESIDE_TRACK_M: f64 = 1e-6;

/// What paces a mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timing {
    /// The steps themselves: results do not depend on a clock.
    Free,
    /// A clock: late plans are void, and a search may end by time.
    Paced,
}

impl<'a> View<'a> {
    /// What a UAV that plans alone sees before slot 1, with known queues, `queues_bits` [bit] by id.
    pub(crate) fn at_start(setup: &Setup<'a>, queues_bits: &'a [u32], stop: &'a Stop) -> Self {
        let Setup { scenario, table, .. } = *setup;
        Self {
            slot: 1,
            position: scenario.start(),
            battery: BatteryState::initial(scenario),
            belief: Believed::known(0, &table.sensors, queues_bits),
            table,
            timing: Timing::Free,
            heard: &Heard::NOTHING,
            neighbours: None,
            stop,
        }
    }

    /// Whether links, arrivals, queues and rates are known: then a forecast is what comes.
    pub fn is_certain(&self) -> bool {
        !self.belief.belief.is_estimated() && !self.table.channel.is_random() && !self.table.arrivals.is_random()
    }

    /// What other UAVs plan to serve, by slot; `None` if none tells.
    pub fn intents(&self) -> Option<&'a [PlannedVisit]> {
        self.neighbours.and_then(|neighbours| neighbours.intents)
    }

    /// For each of several bases the slots before it has a pad for the UAV
    /// ([`Home::pad_waits`](crate::route::home::Home::pad_waits)), as far as others tell where they are; empty if none
    /// makes it wait.
    pub fn pad_waits(&self) -> Vec<u64> {
        let (uav, flights) = self.neighbours.map_or((0, &[][..]), |neighbours| (neighbours.uav, neighbours.flights));
        self.table.home.pad_waits(self.slot, uav, flights)
    }

    /// Horizontal position of the UAV.
    pub fn ground(&self) -> Position {
        self.position.xy()
    }

    /// Where a fixed flight ends the slot (`uav.track`), or toward there if the UAV is not where that begins it,
    /// because an earlier plan was late; `None` if strategies choose waypoints.
    #[inline]
    pub fn fixed_end(&self) -> Option<Point3<f64>> {
        self.track_end(self.table.track.as_ref()?)
    }

    fn track_end(&self, track: &[[f64; 3]]) -> Option<Point3<f64>> {
        let index = usize::try_from(self.slot.checked_sub(1)?).ok()?;
        let end = Point3::from(*track.get(index)?);
        let begin = index.checked_sub(1).map_or(self.position, |before| Point3::from(track[before]));
        if (begin - self.position).norm() < BESIDE_TRACK_M {
            return Some(end);
        }
        let climb_m = self.table.limits.climb_m;
        let z_m = end.z.clamp(self.position.z - climb_m, self.position.z + climb_m);
        Some(above(&self.table.motion.toward(&self.ground(), &end.xy()), z_m))
    }

    /// Where a slot ends for which a strategy decides `ground`: there, in the area, or where the flight is fixed.
    #[inline]
    pub fn end_for(&self, ground: &Position) -> Position {
        self.fixed_end().map_or_else(|| self.table.clamp_to_area(ground), |end| end.xy())
    }

    /// What SN `id` is known to do when it is served in the slot.
    #[inline]
    pub fn answer(&self, id: u32) -> Answer {
        self.belief.answer(id)
    }

    /// Whether there is a place in range of SN `id` that the UAV can fly to, and it is not known to be dead or without
    /// airtime.
    #[inline]
    pub fn is_servable(&self, id: u32) -> bool {
        self.table.is_reachable(id) && self.answer(id).sends()
    }

    /// The SNs that can be served, by id.
    pub fn servable(&self) -> impl Iterator<Item = u32> {
        self.table.sensors.ids().filter(|&id| self.is_servable(id))
    }

    /// Whether any SN cannot be served.
    #[inline]
    pub fn has_hidden(&self) -> bool {
        self.table.has_hidden() || self.belief.answers.iter().any(|answer| !answer.sends())
    }

    /// The value of the queue of SN `id` ([`MissionTable::value`]); 0 if it cannot be served.
    ///
    /// # Panics
    /// If the SN is unknown.
    #[inline]
    pub fn value(&self, id: u32) -> u32 {
        if self.answer(id).sends() { self.table.value(id, self.belief.queues_bits[id as usize]) } else { 0 }
    }

    /// The `values` of the queues, such as [`Self::values`], with what is known of the answers.
    pub(crate) fn told<'b>(&self, values: &'b [u32]) -> Told<'b>
    where
        'a: 'b,
    {
        Told::new(values, self.belief.answers)
    }

    /// The values of all queues, by id; `room` is memory for them.
    #[inline]
    pub fn values<'b>(&self, room: &'b mut Vec<u32>) -> &'b [u32]
    where
        'a: 'b,
    {
        if self.has_hidden() {
            room.clear();
            room.extend(self.table.sensors.ids().map(|id| self.value(id)));
            return room;
        }
        self.table.sensors.weights.values(self.belief.queues_bits, room)
    }
}

/// The decision of a strategy for a slot.
///
/// ```
/// let decision = skysink_planner::strategy::Decision {
///     waypoint: [50.0, 50.0, 20.0].into(),
///     schedule: [3, 17].into_iter().collect(),
///     outcome: skysink_common::message::SolverOutcome::Rule,
///     winner: None,
/// };
/// assert!(decision.schedule.is_sorted());
/// ```
#[derive(Debug, Clone)]
pub struct Decision {
    /// The waypoint [m].
    pub waypoint: Point3<f64>,
    /// The sensor nodes (SNs) to serve from there, ascending by id.
    pub schedule: ArrayVec<u32, MAX_SERVED>,
    /// How the waypoint was found.
    pub outcome: SolverOutcome,
    /// How Algorithm 1 found the schedule, for display.
    pub winner: Option<Winner>,
}

impl Decision {
    /// The decision to stay and serve nobody.
    #[must_use]
    pub fn stay(view: &View<'_>) -> Self {
        Self { waypoint: view.position, schedule: ArrayVec::new(), outcome: SolverOutcome::Rule, winner: None }
    }
}

/// Candidate circles of Algorithm 1 about one pair, C1 to C5.
pub const CIRCLES: usize = 5;

/// Origin of the set that Algorithm 1 finds.
///
/// ```
/// use skysink_planner::strategy::{CIRCLES, Pair, Winner};
/// let pair = Pair { partner: 17, circles: [Some([50.0, 50.0].into()); CIRCLES], chosen: 0 };
/// assert_ne!(Winner { anchor: 3, pair: Some(pair) }, Winner { anchor: 3, pair: None });
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Winner {
    /// Anchor SN i.
    pub anchor: u32,
    /// Its partner and their circles; `None` if the set is the anchor alone.
    pub pair: Option<Pair>,
}

/// An anchor's partner, and the circles about both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Partner SN k.
    pub partner: u32,
    /// Centres of C1 to C5; `None` where one is out of reach, in the wide search.
    pub circles: [Option<Position>; CIRCLES],
    /// Which circle won, from 0.
    pub chosen: u32,
}

/// The input for the construction of a strategy.
#[derive(Debug, Clone, Copy)]
pub struct Setup<'a> {
    /// The mission.
    pub scenario: &'a Scenario,
    /// The keys of its `[planner]` that apply to all strategies.
    pub settings: &'a Settings,
    /// The SNs and the limits of the UAV, as in every view.
    pub table: &'a MissionTable,
    /// The belief before any contact.
    pub belief: &'a Belief,
    /// The UAVs that share a field and its rounds; `None` for a UAV that plans alone, or for a part of the field.
    pub team: Option<Team<'a>>,
    /// Ends long preparations; the strategy is then not flown.
    pub stop: &'a Stop,
}

/// The UAVs that plan one after another for the same SNs.
#[derive(Debug, Clone, Copy)]
pub struct Team<'a> {
    /// The number of the UAV that plans.
    pub uav: usize,
    /// Where each UAV starts, by its number [m].
    pub starts: &'a [Position],
}

/// What a [`Setup`] with known queues refers to.
///
/// ```
/// use skysink_common::{scenario::Scenario, sensors::SensorList};
/// use skysink_planner::{strategies::STRATEGIES, strategy::OwnedSetup};
/// let scenario = Scenario::letter(Default::default()).unwrap();
/// let nodes = SensorList::of(&scenario).unwrap().nodes();
/// let owned = OwnedSetup::new(scenario, &nodes).unwrap();
/// let before_slot_1 = |make: &skysink_planner::strategy::Registered| (make.make)(&owned.setup());
/// assert!(STRATEGIES.iter().all(|strategy| before_slot_1(strategy).path().is_empty()));
/// ```
#[derive(Debug, Clone)]
pub struct OwnedSetup {
    /// The mission.
    pub scenario: Scenario,
    /// The keys of its `[planner]` that apply to all strategies.
    pub settings: Settings,
    /// The SNs and the limits of the UAV.
    pub table: MissionTable,
    /// Ends long preparations.
    pub stop: Stop,
}

impl OwnedSetup {
    /// The setup of a mission with these sensor nodes, by id.
    ///
    /// # Errors
    /// If a value of `[planner]` is refused; never for a scenario that was resolved.
    pub fn new(scenario: Scenario, nodes: &[SensorNode]) -> Result<Self, InputError> {
        let settings = Settings::of(&scenario)?;
        let table = MissionTable::of(&scenario, nodes);
        Ok(Self { scenario, settings, table, stop: Stop::default() })
    }

    /// The input for the construction of a strategy.
    pub fn setup(&self) -> Setup<'_> {
        let Self { scenario, settings, table, stop } = self;
        Setup { scenario, settings, table, belief: &Belief::Known, team: None, stop }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;
    use std::sync::LazyLock;

    /// What a strategy is made of before it flies over these SNs.
    pub(crate) fn over(scenario: Scenario, sensors: Vec<SensorNode>) -> OwnedSetup {
        OwnedSetup::new(scenario, &sensors).unwrap()
    }

    /// SNs by position [m], rate [bit/s] and buffer [bit] in the letter's scenario.
    pub(crate) fn field(sensors: impl Iterator<Item = ([f64; 2], f64, u32)>) -> OwnedSetup {
        let node = |([x_m, y_m], sampling_bps, capacity_bits): ([f64; 2], f64, u32)| SensorNode {
            x_m,
            y_m,
            sampling_bps,
            capacity_bits,
            gain: 10f64.powf(-5.2),
            ..SensorNode::default()
        };
        over(Scenario::letter(Overrides::default()).unwrap(), sensors.map(node).collect())
    }

    /// What it sees from 20 m above `ground` [m].
    pub(crate) fn view<'a>(table: &'a MissionTable, slot: u64, ground: [f64; 2], queues_bits: &'a [u32]) -> View<'a> {
        let position = Point3::new(ground[0], ground[1], 20.0);
        static STOP: LazyLock<Stop> = LazyLock::new(Stop::default);
        let belief = Believed::known(slot - 1, &table.sensors, queues_bits);
        let battery = BatteryState::default();
        let timing = Timing::Free;
        View { slot, position, battery, belief, table, timing, heard: &Heard::NOTHING, neighbours: None, stop: &STOP }
    }
}
