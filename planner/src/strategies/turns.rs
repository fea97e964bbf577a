//! Cyclic service of sensor nodes (SNs) in a fixed order, the common part of `tour` and `round-robin`.

use std::collections::BTreeSet;

use nalgebra::Point3;
use skysink_common::checkpoint::{Checkpoint, CheckpointError, decode, encode};
use skysink_common::geometry::{Position, within};

use crate::geometry::turns::Turns;
use crate::mission_table::MissionTable;
use crate::serving::Serving;
use crate::strategy::{Decision, Setup, Strategy, Team, View};

/// The waypoint from a position toward the current SN, `[0]`, given the next one, `[1]`, and the current one's point of
/// the round.
type Waypoint = fn(&MissionTable, &Position, [&Position; 2], &Position) -> Position;

/// The turn of an SN that cannot be served.
const NO_TURN: usize = usize::MAX;

/// A strategy that serves SNs in a fixed order. A turn ends with the slot that serves its SN.
pub(crate) struct InTurn {
    turns: Turns,
    /// The turn of each SN.
    turn_of: Vec<usize>,
    /// Most turns before its own at which an SN is served instead of in it. `None`: all, but only if all turns between
    /// end in the same slot.
    early: Option<usize>,
    /// Whether only a slot that empties its queue ends the turn of an SN.
    drains: bool,
    waypoint: Waypoint,
    serving: Serving,
    /// The first turn, and the current one.
    first: usize,
    turn: usize,
    /// Later turns whose SNs have been served.
    served: BTreeSet<usize>,
    /// The schedule of the slot before.
    planned: Vec<u32>,
}

impl InTurn {
    /// A round of `turns` from where it begins for a UAV that starts at a point. With `remembers`, an SN that was
    /// served at most half a round before its turn loses it.
    ///
    /// The UAVs of a team begin at parts of the round of UAV 0, in the order of where each would begin along it.
    pub fn new(
        setup: &Setup,
        mut turns: Turns,
        remembers: bool,
        begin: impl Fn(&Turns, &Position) -> usize,
        waypoint: Waypoint,
    ) -> Self {
        turns.retain(|id| setup.table.is_reachable(id));
        let count = turns.order.len();
        let turn = match setup.team {
            Some(Team { uav, starts }) if count > 0 => {
                let firsts: Vec<usize> = starts.iter().map(|start| begin(&turns, start)).collect();
                let ahead = |other: usize| ((firsts[other] + count - firsts[0]) % count, other);
                let part = (0..starts.len()).filter(|&other| ahead(other) < ahead(uav)).count();
                (firsts[0] + part * count / starts.len()) % count
            }
            _ => begin(&turns, &setup.scenario.start().xy()),
        };
        let mut turn_of = vec![NO_TURN; setup.table.sensors.count()];
        turns.order.iter().enumerate().for_each(|(turn, &id)| turn_of[id as usize] = turn);
        let early = remembers.then_some(turns.order.len().saturating_sub(1) / 2);
        let serving = Serving::new(setup);
        let served = BTreeSet::new();
        let planned = Vec::new();
        Self { turns, turn_of, early, drains: false, waypoint, serving, first: turn, turn, served, planned }
    }

    /// Goes back to the first turn.
    pub fn restart(&mut self) {
        self.turn = self.first;
    }

    /// Begins anew with the turn of SN `id`, if it has one. With `drains`, a turn lasts until its SN's queue is empty,
    /// or cannot be emptied because it samples more than the link carries.
    pub fn begin_with(&mut self, id: Option<u32>, drains: bool) {
        let turn = id.map_or(NO_TURN, |id| self.turn_of[id as usize]);
        if turn != NO_TURN {
            self.turn = turn;
        }
        self.drains = drains;
        self.served.clear();
        self.planned.clear();
    }

    /// Whether the service of SN `id` from `uav` ends its turn.
    fn ends_turn(&self, view: &View, id: u32, uav: &Point3<f64>) -> bool {
        let needs_more = || {
            let carried_bits = view.table.capacity_bits(id, uav);
            carried_bits < view.belief.queues_bits[id as usize].into()
                && carried_bits as f64 > view.belief.mean_bits(id)
        };
        view.is_servable(id) && !(self.drains && needs_more())
    }

    /// Ends the turns of the SNs that the slot before served: those in range of where it ended.
    fn advance(&mut self, view: &View) {
        let table = view.table;
        let ground = &view.ground();
        let count = self.turns.order.len();
        let most = self.early.unwrap_or(count);
        for id in self.planned.drain(..) {
            let turn = self.turn_of[id as usize];
            let ahead = (turn + count - self.turn) % count;
            if ahead <= most && within(table.sensors.position(id), ground, table.limits.comm_radius_m) {
                self.served.insert(turn);
            }
        }
        for _ in 0..count {
            if !self.served.remove(&self.turn) && view.is_servable(self.turns.order[self.turn]) {
                break;
            }
            self.turn = (self.turn + 1) % count;
        }
        if self.early.is_none() {
            self.served.clear();
        }
    }

    /// The first turn after the current one that is not served, of a live SN; the current one if there is none.
    fn next_turn(&self, view: &View) -> usize {
        let count = self.turns.order.len();
        let mut others = (1..count).map(|ahead| (self.turn + ahead) % count);
        let is_due = |turn: &usize| !self.served.contains(turn) && view.is_servable(self.turns.order[*turn]);
        others.find(is_due).unwrap_or(self.turn)
    }
}

impl Strategy for InTurn {
    /// Serves the current SN, if it is in range, and the fullest queues, n in all. In an empty field the UAV holds its
    /// position.
    fn plan(&mut self, view: &View<'_>) -> Option<Decision> {
        let ground = view.ground();
        self.advance(view);
        let current = self.turns.order.get(self.turn).copied().filter(|&id| view.is_servable(id));
        let waypoint = current.map_or(ground, |current| {
            let ids = [current, self.turns.order[self.next_turn(view)]];
            let positions = ids.map(|id| view.table.sensors.position(id));
            (self.waypoint)(view.table, &ground, positions, &self.turns.points[self.turn])
        });
        let decision = self.serving.serve_first(view, &waypoint, |id| Some(id) == current);
        let mut planned = std::mem::take(&mut self.planned);
        planned.extend(decision.schedule.iter().filter(|id| self.ends_turn(view, **id, &decision.waypoint)));
        self.planned = planned;
        Some(decision)
    }
}

impl Checkpoint for InTurn {
    fn save(&self, bytes: &mut Vec<u8>) {
        encode(&(self.turn, &self.served, &self.planned), bytes);
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), CheckpointError> {
        let (turn, served, planned): (usize, BTreeSet<usize>, Vec<u32>) = decode(bytes)?;
        let count = self.turns.order.len();
        let is_turn = |turn: &usize| *turn < count;
        CheckpointError::ensure(is_turn(&turn) || turn == 0, "a turn of this field")?;
        CheckpointError::ensure(served.iter().all(is_turn) && !served.contains(&turn), "later turns of this field")?;
        let has_turn = |&id: &u32| self.turn_of.get(id as usize).is_some_and(|turn| *turn != NO_TURN);
        CheckpointError::ensure(planned.iter().all(has_turn), "sensor nodes of this field")?;
        self.turn = turn;
        self.served = served;
        self.planned = planned;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strategies::tests::{made, setup_of};
    use crate::strategy::tests::view;

    #[test]
    fn a_service_ends_the_turn() {
        // SN 1 is within 10 m of (50, 80), where the slot toward SN 0 ends; SN 2 is beside SN 0.
        let (table, mut strategy) = made("round-robin", &[[50.0, 95.0], [50.0, 75.0], [50.0, 94.0]]);
        let mut served = |slot, ground| strategy.plan(&view(&table, slot, ground, &[9; 3])).unwrap().schedule;
        assert_eq!(served(1, [50.0, 50.0])[..], [1], "SN 1 was not at turn");
        assert_eq!(served(2, [50.0, 80.0])[..], [0, 2], "SN 2 was not at turn, either: it is SN 1's");
        assert_eq!(served(3, [50.0, 90.0])[..], [1]);
        assert_eq!(served(4, [50.0, 75.0])[..], [0, 2], "the turn of SN 2, and then of SN 0: both end with one slot");
        assert_eq!(served(5, [50.0, 94.0])[..], [1]);
    }

    #[test]
    fn an_sn_out_of_range_keeps_its_turn() {
        // SNs 0 and 1 are in range of (50, 80), and SN 2 is not.
        let (table, mut strategy) = made("round-robin", &[[50.0, 80.0], [50.0, 88.0], [50.0, 20.0]]);
        let mut served = |slot, ground| strategy.plan(&view(&table, slot, ground, &[9; 3])).unwrap().schedule;
        assert_eq!(served(1, [50.0, 51.0])[..], [0, 1]);
        assert_eq!(served(2, [50.0, 77.0])[..], [0, 1], "SN 1 was 11 m away: its turn, and SN 0 is in range again");
        assert_eq!(served(3, [50.0, 99.0])[..], [0, 1], "11 m again");
        assert_eq!(served(4, [50.0, 96.0])[..], [0; 0], "on the way to SN 2");
        assert_eq!(served(5, [50.0, 36.0])[..], [2]);
    }

    #[test]
    fn an_sn_served_up_to_half_a_round_early_loses_its_turn() {
        // On the way to SN 0 the UAV passes SN 2, two turns early, and SN 4, four turns early.
        let positions = [[50.0, 90.0], [80.0, 90.0], [50.0, 40.0], [20.0, 90.0], [50.0, 62.0]];
        let field = setup_of(&positions);
        let turns = Turns { order: (0..5).collect(), points: positions.map(Position::from).to_vec() };
        let straight: Waypoint = |table, position, [current, _], _| table.motion.toward(position, current);
        let mut strategy = InTurn::new(&field.setup(), turns, true, |_, _| 0, straight);
        let mut ground = [50.0, 10.0];
        let mut flown = Vec::new();
        for slot in 1..=8 {
            let waypoint = strategy.plan(&view(&field.table, slot, ground, &[9; 5])).unwrap().waypoint;
            ground = [waypoint.x, waypoint.y];
            flown.push(ground);
        }
        assert_eq!(flown[..4], [[50.0, 40.0], [50.0, 70.0], [50.0, 90.0], [80.0, 90.0]]);
        assert_eq!(flown[4..6], [[50.0, 90.0], [20.0, 90.0]], "on to SN 3");
        assert_eq!(flown[7], [50.0, 62.0], "SN 4 keeps its turn");
    }

    #[test]
    fn a_round_that_is_restarted_begins_with_its_first_turn() {
        let positions = [[50.0, 90.0], [80.0, 90.0], [50.0, 40.0]];
        let field = setup_of(&positions);
        let turns = || Turns { order: (0..3).collect(), points: positions.map(Position::from).to_vec() };
        let straight: Waypoint = |table, position, [current, _], _| table.motion.toward(position, current);
        let mut strategy = InTurn::new(&field.setup(), turns(), true, |_, _| 1, straight);
        let next =
            |strategy: &mut InTurn| strategy.plan(&view(&field.table, 1, [80.0, 89.0], &[9; 3])).unwrap().waypoint;
        let [first, second] = [(); 2].map(|()| next(&mut strategy));
        strategy.begin_with(None, false);
        assert_eq!(next(&mut strategy), second, "it goes on");
        strategy.restart();
        strategy.begin_with(None, false);
        assert_eq!(next(&mut strategy), first);
        assert_ne!(first, second);
    }

    #[test]
    fn a_checkpoint_of_a_larger_field_is_refused() {
        let (table, mut strategy) = made("round-robin", &[[50.0, 70.0], [50.0, 30.0]]);
        // The turn, the turns that are served, and the schedule before.
        let refused: [&[u8]; 5] = [&[2, 0, 0], &[0, 1, 2, 0], &[1, 1, 1, 0], &[0, 0, 1, 2], &[0]];
        assert!(refused.iter().all(|bytes| strategy.restore(bytes).is_err()));
        assert!(strategy.restore(&[1, 0, 0]).is_ok());
        let decision = strategy.plan(&view(&table, 1, [50.0, 50.0], &[9; 2])).unwrap();
        assert_eq!(decision.schedule[..], [1]);
        assert!(made("round-robin", &[]).1.restore(&[0, 0, 0]).is_ok(), "an empty field has one state");
    }

    #[test]
    fn a_tour_continues_from_its_checkpoint() {
        let positions: Vec<[f64; 2]> =
            (0..9).map(|index| [f64::from(index * 37 % 90), f64::from(index * 53 % 90)]).collect();
        let (table, mut tour) = made("tour", &positions);
        let mut ground = [50.0, 50.0];
        for slot in 1..60 {
            let (_, mut resumed) = made("tour", &positions);
            let mut bytes = Vec::new();
            tour.save(&mut bytes);
            resumed.restore(&bytes).unwrap();
            let [decision, again] = [&mut tour, &mut resumed].map(|tour| {
                let decision = tour.plan(&view(&table, slot, ground, &[9; 9])).unwrap();
                (decision.waypoint, decision.schedule)
            });
            assert_eq!(decision, again, "slot {slot}");
            ground = [decision.0.x, decision.0.y];
        }
    }
}
