//! The slots of the strategies that remember: how a turn or the first slot of a plan becomes a message.
//!
//! What they remember and how they decide is left to [`crate::strategies::rounds`] and [`crate::horizon`].

use skysink_common::geometry::Position;
use skysink_common::message::{Mode, Plan, SolverOutcome};

use super::{Planner, Slot};
use crate::carried::Carried;
use crate::horizon::Next;
use crate::strategies::baselines::{serve_first, share_within};
use crate::waypoint::problem::Waypoint;

impl Planner {
    /// The baselines that take sensor nodes in turn; `None` for the other strategies.
    pub(super) fn in_turn(&mut self, slot: Slot) -> Option<Plan> {
        let waypoint = match &self.carried {
            Carried::Rounds(rounds) => rounds.waypoint(&self.table, slot.position),
            Carried::Ages(ages) => ages.waypoint(&self.table, slot.position, slot.queues_bits),
            Carried::Nothing | Carried::Horizon(_) => return None,
        };
        let ground = self.table.into_area(&waypoint);
        match &mut self.carried {
            Carried::Rounds(rounds) => {
                rounds.serve(&self.table, &ground, slot.queues_bits, &mut self.ids);
                rounds.advance(&self.ids);
            }
            Carried::Ages(ages) => {
                ages.serve(&self.table, &ground, slot.queues_bits, &mut self.ids);
                ages.advance(slot.number, &self.ids);
            }
            Carried::Nothing | Carried::Horizon(_) => return None,
        }
        let point = self.above(&ground, slot);
        Some(self.plan(&Waypoint { point, outcome: SolverOutcome::Rule }, Mode::Serve, slot))
    }

    /// The look-ahead; `None` if it has nowhere to fly, and for the other strategies.
    pub(super) fn look_ahead(&mut self, slot: Slot) -> Option<Plan> {
        let Carried::Horizon(horizon) = &mut self.carried else {
            return None;
        };
        let next = horizon.step(slot.number, slot.position, slot.queues_bits)?;
        let (waypoint, outcome) = self.on_the_way(&next, slot);
        let ground = self.table.into_area(&waypoint);
        serve_first(&self.table, &ground, &next.ids, slot.queues_bits, &mut self.ids);
        let point = self.above(&ground, slot);
        let plan = self.plan(&Waypoint { point, outcome }, Mode::Serve, slot);
        self.path.push([plan.x_m, plan.y_m, plan.z_m]);
        self.path.extend(next.path.iter().skip(1).map(|point| [point.x, point.y, plan.z_m]));
        Some(plan)
    }

    /// The waypoint of a planned slot: where its links limit what it collects, as far toward the best point to serve
    /// from (sP2*) as the next stop stays in reach in time.
    fn on_the_way(&mut self, next: &Next, slot: Slot) -> (Position, SolverOutcome) {
        self.ids.clear();
        self.ids.extend_from_slice(&next.ids);
        let above = self.above(&next.waypoint, slot);
        let queued_bits: u64 = self.ids.iter().map(|&id| u64::from(slot.queues_bits[id as usize])).sum();
        let expected_bits = self.table.expected_bits(&above, &self.ids, slot.queues_bits);
        if expected_bits == queued_bits {
            return (next.waypoint, SolverOutcome::Rule);
        }
        let Some(best) = self.waypoint_for_schedule(slot) else {
            return (next.waypoint, SolverOutcome::Rule);
        };
        let best_ground = best.point.xy();
        let Some((then, slots)) = next.then else {
            return (best_ground, best.outcome);
        };
        let share = share_within(&next.waypoint, &best_ground, &then, self.table.reach_m * f64::from(slots));
        (next.waypoint + (best_ground - next.waypoint) * share, best.outcome)
    }
}
