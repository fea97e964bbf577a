//! What the bridge asks of a vehicle: where it is, whether it is heard, and how far its mission is.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::{Phase, VehicleControl};
use crate::autopilot::ModeMeaning;
use crate::preflight::Beginning;
use crate::telemetry::{Fix, Order};

/// Time without a message after which a vehicle gets no heartbeats until it is heard [s].
const ABANDONED_S: f64 = 10.0;

/// How late heartbeats may come [s].
const LATE_S: f64 = 0.5;

/// Time after which a vehicle that does not return gets no heartbeats until it does [s].
const RETURN_S: f64 = 30.0;

/// Time between two calls of a vehicle that was never heard, longer than any dead-man switch waits (PX4: up to 300 s), and
/// how long one takes [s].
const CALL_EVERY_S: f64 = 310.0;
const CALL_S: f64 = 0.3;

/// Whether a vehicle gets heartbeats of the bridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heartbeats {
    /// It does, whoever else is at its address.
    Due,
    /// It does not, so that its dead-man switch acts.
    Withheld,
    /// It does, unless those of another on its connection are withheld.
    Idle,
}

/// What the bridge after this one has to know of a vehicle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct History {
    /// Whether it has been armed by an order, as far as is known: that may be on its way.
    pub was_armed: bool,
    /// Whether it was on the ground, disarmed, or is known not to have been armed by a bridge: if it was not armed by an
    /// order since, whoever flies it is somebody else.
    pub was_down: bool,
    /// Whether its last return was seen in effect: whoever stops it is no failure of the link.
    pub has_seen_return: bool,
    /// How far its mission has come.
    pub fate: Fate,
}

/// How far the mission of a vehicle has come.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fate {
    /// It goes on.
    #[default]
    Open,
    /// It has ended on the ground.
    Ended,
    /// It returns, or is to.
    Returns,
    /// Others fly it.
    Left,
    /// The bridge has given it up, and nobody is known to fly it.
    Abandoned,
}

impl VehicleControl {
    /// What the bridge after this one has to know of it.
    pub fn history(&self) -> History {
        History {
            was_armed: self.assignment.was_armed || self.takeover.is_arming(),
            was_down: self.assignment.is_unarmed || self.takeover.has_been_disarmed(),
            has_seen_return: self.has_seen_return || self.takeover.has_seen_return(),
            fate: self.fate(),
        }
    }

    /// How far its mission has come.
    pub fn fate(&self) -> Fate {
        match self.phase {
            Phase::TakenOver if self.is_abandoned => Fate::Abandoned,
            Phase::TakenOver => Fate::Left,
            Phase::Landed => Fate::Ended,
            Phase::Returning => Fate::Returns,
            Phase::Preflight if self.awaited_return.is_some() => Fate::Returns,
            _ => Fate::Open,
        }
    }

    /// Whether it gets nothing, as it may be another.
    pub(super) fn is_withheld(&self) -> bool {
        self.is_refused && self.phase == Phase::Preflight && self.assignment.beginning != Beginning::New
    }

    /// Whether it was armed, and says that it is not any more, believed or not: it did not land by an order to return, as no
    /// heartbeat since that said that it was armed.
    pub fn says_off(&self) -> bool {
        let was_on_after = |returns_s| self.vehicle.armed_s.is_some_and(|armed_s| armed_s >= returns_s + LATE_S);
        self.is_committed() && self.vehicle.says_off() && !self.returns_s.is_some_and(was_on_after)
    }

    /// Whether others have taken it over while this bridge flew it.
    pub fn is_taken_over(&self) -> bool {
        self.phase == Phase::TakenOver && !self.is_left
    }

    /// Whether it was heard at all, and not too long ago.
    pub fn is_heard(&self) -> bool {
        !self.is_lost && self.vehicle.autopilot.is_some()
    }

    /// Whether it gets heartbeats. A vehicle that may be in the air gets none if its dead-man switch has to bring it home:
    /// the bridge has given it up, and nobody is known to fly it, or it was not heard for long.
    pub fn heartbeats(&self, now_s: f64) -> Heartbeats {
        let may_fly = self.is_committed() || self.assignment.beginning != Beginning::New;
        let is_left = match self.phase {
            Phase::Landed if !self.vehicle.may_be_armed() => return Heartbeats::Idle,
            Phase::Landed => self.is_unflown(), // else somebody flies it again
            Phase::TakenOver => self.is_abandoned && self.is_unflown() && !self.is_called(now_s),
            Phase::Returning if self.does_not_return(now_s) => true,
            _ if self.is_withheld() => true,
            _ => may_fly && self.vehicle.unheard_s(now_s) >= ABANDONED_S && !self.is_called(now_s),
        };
        if is_left { Heartbeats::Withheld } else { Heartbeats::Due }
    }

    /// Whether the orders to return have had no effect for long.
    fn does_not_return(&self, now_s: f64) -> bool {
        let is_late = self.returns_s.is_some_and(|returns_s| now_s - returns_s >= RETURN_S);
        is_late && self.is_unflown() && (self.is_return_unclear || !self.takeover.has_seen_return())
    }

    /// Whether its mode, as far as it is known, is not one of others, nor a return.
    pub(super) fn is_unflown(&self) -> bool {
        matches!(self.vehicle.meaning(), ModeMeaning::FollowsOrders | ModeMeaning::Unknown)
    }

    /// Whether a vehicle that was never heard is called, so that it knows where to answer: more rarely than a dead-man
    /// switch waits.
    fn is_called(&self, now_s: f64) -> bool {
        self.vehicle.autopilot.is_none() && now_s % CALL_EVERY_S < CALL_S
    }

    /// Whether it is to return as soon as it is heard, or does, or is flown by others.
    pub fn has_ended_in_air(&self) -> bool {
        !matches!(self.fate(), Fate::Open | Fate::Ended)
    }

    /// The phase of its mission.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Whether its mission has begun: it has hovered at its start.
    pub fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// What it is waited for before take-off, in words after "waiting for it"; `None` if nothing is.
    pub fn missing(&self) -> Option<&'static str> {
        self.preflight.missing.filter(|_| matches!(self.phase, Phase::Preflight | Phase::Arming))
    }

    /// Why its mission is over, if it has never begun.
    pub fn unbegun_end(&self) -> Option<&str> {
        (!self.has_begun && self.phase == Phase::Landed).then_some(&*self.end)
    }

    /// Whether the bridge has ordered it to be armed, or has taken it over in the air.
    pub fn is_committed(&self) -> bool {
        self.takeover.has_armed() || !matches!(self.phase, Phase::Preflight | Phase::Arming)
    }

    /// Whether it has refused to fly to its target.
    pub fn has_refused(&self) -> bool {
        self.has_refused
    }

    /// Where it was sent last [m], if it may be on its way there.
    pub fn target(&self) -> Option<Point3<f64>> {
        self.target.filter(|_| self.phase == Phase::Flying)
    }

    /// Where it is [m]; `None` if that was never known.
    pub fn position(&self) -> Option<Point3<f64>> {
        self.frame.position(self.vehicle.fix()?)
    }

    /// Whether its position is current, and believed.
    pub fn has_current_position(&self, now_s: f64) -> bool {
        self.vehicle.has_current_fix(now_s) && !self.jumps.is_doubtful(now_s)
    }

    /// How far from its start a vehicle is [m].
    pub fn away_m(&self, fix: &Fix) -> Option<f64> {
        Some((self.frame.position(fix)?.xy() - self.assignment.start.xy()).norm())
    }

    /// Whether it flies home, as far as it says so, is flown by others, or has landed. A heartbeat since the order has said
    /// whether it is armed at all.
    pub fn is_homebound(&self) -> bool {
        let is_answered = !self.outbox.has(&Order::Return) && !self.is_return_unclear;
        let is_confirmed = is_answered || self.vehicle.meaning() == ModeMeaning::Returns;
        self.is_withheld()
            || matches!(self.phase, Phase::Landed | Phase::TakenOver)
            || self.phase == Phase::Returning
                && is_confirmed
                && self.vehicle.heartbeat_s >= self.returns_s.map(|returns_s| returns_s + LATE_S)
    }
}
