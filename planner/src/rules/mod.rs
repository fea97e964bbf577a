//! The rules between what a strategy proposes and what is flown. Each may replace what those before it have decided;
//! none asks a later one.
//!
//! | rule | decision |
//! |---|---|
//! | the airspace: a waypoint behind a zone, or beside the lines of a grid, is led around | D15, D17a |
//! | a fixed flight: the slot ends on the track, and serves whom the strategy chose there | D32 |
//! | the return: a slot that leaves no energy or no time for the way home is a part of it | D13 |
//! | other UAVs: a slot that would end too near to one ends elsewhere ([`apart`]) | D23 |
//! | the schedules of other UAVs: no SN is scheduled twice | D22 |

pub mod apart;

use skysink_common::geometry::above;
use skysink_common::message::Mode;

use crate::route::way_home::Returning;
use crate::serving::Serving;
use crate::serving::transit::transit_decision;
use crate::strategy::{Decision, Setup, View};

/// What a UAV has to do in a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Duty {
    /// To fly its mission.
    Mission,
    /// To fly home and stay there: its endurance has ended.
    Landing,
    /// Nothing: its energy has ended.
    Down,
}

/// What is flown in a slot.
#[derive(Debug, Clone)]
pub struct Ruled {
    /// Waypoint and schedule.
    pub decision: Decision,
    /// What the UAV does.
    pub mode: Mode,
}

/// A rule: it changes what those before it have decided.
type Apply = fn(&mut RuleBook, &View<'_>, Duty, &mut Ruled);

/// The rules of a mission.
pub struct RuleBook {
    /// Schedules and altitudes of waypoints.
    pub serving: Serving,
}

impl RuleBook {
    /// The rules in their order.
    const ORDER: [Apply; 5] =
        [Self::keep_to_airspace, Self::follow_track, Self::come_home, Self::keep_apart, Self::leave_scheduled];

    /// The rules of a mission.
    #[must_use]
    pub fn new(setup: &Setup<'_>) -> Self {
        Self { serving: Serving::new(setup) }
    }

    /// Decides the slot of `view` for a UAV with this duty: by what `propose` decides, by transit where that is `None`,
    /// or by the rules. `propose` is not called while the UAV charges, lands, or is down.
    pub fn decide(
        &mut self,
        view: &View<'_>,
        duty: Duty,
        propose: &mut dyn FnMut(&View<'_>) -> Option<Decision>,
    ) -> Ruled {
        let charges = view.table.home.charges_on(view.slot, &view.battery, &view.ground());
        let mut ruled = match duty {
            Duty::Down => return Ruled { decision: Decision::stay(view), mode: Mode::Hold },
            Duty::Landing => land(view),
            Duty::Mission if charges => Ruled { decision: Decision::stay(view), mode: Mode::Charge },
            Duty::Mission => match propose(view) {
                Some(decision) => Ruled { decision, mode: Mode::Serve },
                None => Ruled { decision: transit_decision(&mut self.serving, view), mode: Mode::Transit },
            },
        };
        Self::ORDER.iter().for_each(|apply| apply(self, view, duty, &mut ruled));
        ruled
    }

    /// Where a zone is in the way: to fly around it toward the same waypoint and serve the fullest queues in range. On
    /// a grid: to fly along its lines.
    fn keep_to_airspace(&mut self, view: &View<'_>, duty: Duty, ruled: &mut Ruled) {
        if view.table.airspace.is_open() || duty != Duty::Mission || ruled.mode == Mode::Charge {
            return;
        }
        let proposed = ruled.decision.waypoint.xy();
        let end = view.table.motion.slot_end(view.slot, &view.ground(), &proposed);
        if view.table.motion.is_same(&end, &proposed) {
            ruled.decision.waypoint.x = end.x;
            ruled.decision.waypoint.y = end.y;
        } else {
            ruled.decision = self.serving.serve_fullest(view, &end);
        }
    }

    /// Where the flight is fixed, a decision is only that whom to serve.
    fn follow_track(&mut self, view: &View<'_>, _: Duty, ruled: &mut Ruled) {
        if let Some(end) = view.fixed_end() {
            ruled.decision = self.serving.serve_at(view, end, &ruled.decision.schedule);
        }
    }

    /// A decision that leaves too little energy or time for the way home is replaced by a part of it; one that stays in
    /// the base and serves nobody charges.
    fn come_home(&mut self, view: &View<'_>, duty: Duty, ruled: &mut Ruled) {
        if duty != Duty::Mission || ruled.mode == Mode::Charge {
            return;
        }
        let Ruled { decision, mode } = ruled;
        let flight = [&view.position, &decision.waypoint];
        match view.table.home.rule(view.slot, &view.battery, flight, decision.schedule.is_empty()) {
            Returning::Not => {}
            Returning::Charges => (*decision, *mode) = (Decision::stay(view), Mode::Charge),
            Returning::Flies(waypoint) => {
                *decision = self.serving.serve_fullest(view, &waypoint.xy());
                *mode = Mode::Return;
                decision.waypoint.z = decision.waypoint.z.min(waypoint.z); // a climb would take energy
            }
        }
    }

    /// A slot that would end too near to another UAV ends elsewhere.
    fn keep_apart(&mut self, view: &View<'_>, duty: Duty, ruled: &mut Ruled) {
        let Some(neighbours) = view.neighbours.filter(|_| ruled.mode != Mode::Charge) else { return };
        let decision = &mut ruled.decision;
        let Some(end) = neighbours.reservations.end_instead_of(view, &decision.waypoint.xy()) else { return };
        if duty == Duty::Landing {
            decision.waypoint = above(&end, view.position.z);
        } else {
            *decision = self.serving.serve_fullest(view, &end);
            decision.waypoint.z = decision.waypoint.z.min(view.position.z); // a climb would take energy
        }
    }

    /// SNs that other UAVs have scheduled are left to them.
    fn leave_scheduled(&mut self, view: &View<'_>, _: Duty, ruled: &mut Ruled) {
        if let Some(neighbours) = view.neighbours {
            ruled.decision.schedule.retain(|id| !neighbours.scheduled.contains(id));
        }
    }
}

/// The slot of a UAV whose endurance has ended: it serves nobody, and flies home or stays there.
fn land(view: &View<'_>) -> Ruled {
    let table = view.table;
    let ground = view.ground();
    let flies = |end| Ruled {
        decision: Decision { waypoint: above(&end, view.position.z), ..Decision::stay(view) },
        mode: Mode::Return,
    };
    match table.motion.under_way(view.slot, &ground).filter(|end| *end != ground) {
        Some(end) => flies(end),
        None if table.is_home(&ground) => Ruled { decision: Decision::stay(view), mode: Mode::Charge },
        None => flies(table.home.landing_waypoint(view.slot, view.battery.energy_j, &ground)),
    }
}
