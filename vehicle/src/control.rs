//! The bridge's side of one vehicle: gets it ready, takes off, flies it from target to target, and brings it home.
//!
//! Messages in, orders out. The clock is passed in, in seconds of the vehicle. The pilot wins: what the orders of the
//! bridge do not explain ends them ([`crate::takeover`]), and a doubt holds them back.

mod answers;
mod beginning;
mod flight;

pub use answers::{Fate, Heartbeats, History};

use nalgebra::Point3;

use crate::autopilot::AutopilotKind;
use crate::frame::AreaFrame;
use crate::jumps::{Jumps, Plausibility};
use crate::outbox::Outbox;
use crate::preflight::{Assignment, Preflight, PreflightRefusal};
use crate::said::Said;
use crate::state::VehicleState;
use crate::takeover::Takeover;
use crate::telemetry::{ACCEPTED, Fix, Order, Telemetry};

/// Time between two attempts of an order that the vehicle refuses [s].
const RETRY_S: f64 = 1.0;

/// Time after which an accepted take-off or return that has no effect is ordered again [s]: longer than motors take to
/// spool up.
const REORDER_S: f64 = 6.0;

/// Time after which a vehicle that has accepted to be armed, and is not, has disarmed [s]: longer than two heartbeats.
const DISARMED_S: f64 = 3.0;

/// Time after which a climb that does not end is given up [s].
const CLIMB_S: f64 = 120.0;

/// Time after which positions far from the first one are believed before take-off: that one was wrong [s].
const MOVED_S: f64 = 3.0;

/// Time after a silence of the link in which messages may still have waited in it [s].
const SETTLED_S: f64 = 0.3;

/// Altitude below that of the start at which a take-off is over [m].
const CLIMBED_M: f64 = 1.0;

/// Time after which a flight to the start that does not end is given up [s].
const TO_START_S: f64 = 600.0;

/// Greatest speed of a vehicle that hovers [m/s].
const HOVER_MPS: f64 = 0.5;

/// The temporary refusal of MAVLink: the order may be accepted later.
const TEMPORARILY_REJECTED: u8 = 1;

/// The result of an order that a vehicle does not support.
const UNSUPPORTED: u8 = 3;

/// The phase of a vehicle's mission.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// On the ground, not checked yet.
    Preflight,
    /// Checked, and to be armed.
    Arming,
    /// Armed, and climbing to its start.
    TakeOff,
    /// Flies to its targets.
    Flying,
    /// Flies home by an order of the bridge.
    Returning,
    /// Flown by others, for the rest of the mission.
    TakenOver,
    /// On the ground, for the rest of the mission.
    Landed,
}

/// The bridge's side of one vehicle.
#[derive(Debug, Clone)]
pub struct VehicleControl {
    /// What is known of the vehicle.
    pub vehicle: VehicleState,
    assignment: Assignment,
    frame: AreaFrame,
    preflight: Preflight,
    takeover: Takeover,
    phase: Phase,
    outbox: Outbox,
    jumps: Jumps,
    /// Whether it has refused its target.
    has_refused: bool,
    /// Whether it follows a reposition only if that may change its mode.
    must_change_mode: bool,
    /// Whether it has hovered at its start, or was in its mission before.
    has_begun: bool,
    /// Why its mission is over, in a sentence about "it"; empty before.
    end: String,
    /// When it began to climb, and to fly to its start [s].
    climbs_s: Option<f64>,
    to_start_s: Option<f64>,
    /// When it was ordered to return [s].
    returns_s: Option<f64>,
    /// The commands of which it was said that it refuses them.
    said_refused: Vec<u16>,
    /// When an order that was refused, or that has no effect, may be tried again [s].
    retry_s: f64,
    is_lost: bool,
    /// Until when messages may have waited in the link [s].
    stale_until_s: f64,
    /// When an order to arm was sent last [s], and whether there was one before it, without an answer.
    arming_s: f64,
    has_ordered_arming: bool,
    /// Whether it is left alone because its mission was over before the bridge was restarted.
    is_left: bool,
    /// Whether it may be another, so that it must not be flown.
    is_refused: bool,
    /// Whether the bridge itself has given it up: nobody else is known to fly it.
    is_abandoned: bool,
    /// Where it was sent last [m].
    target: Option<Point3<f64>>,
    /// Since when it is checked in the air [s].
    checked_since_s: Option<f64>,
    /// Why it returns as soon as it is known to be in the air: its mission has ended before it was heard.
    awaited_return: Option<String>,
    /// Whether a return was in effect before.
    has_seen_return: bool,
    /// Whether the checks before take-off hold now.
    is_checked: bool,
    /// Whether it was said that it is checked.
    has_said_checked: bool,
    /// Whether a return had no effect, so that it was ordered again.
    has_repeated_return: bool,
    /// Whether a return was not answered, and the mode of an unknown autopilot has changed, whatever to.
    is_return_unclear: bool,
    /// Whether it has said where it is, and does not any more.
    is_blind: bool,
    /// Whether all vehicles are checked, so that it may be armed.
    may_arm: bool,
    said: Said,
}

impl VehicleControl {
    /// A vehicle of which nothing is known yet.
    #[must_use]
    pub fn new(assignment: Assignment, frame: AreaFrame) -> Self {
        Self {
            vehicle: VehicleState::default(),
            jumps: Jumps::at_most(assignment.speed_mps),
            assignment,
            frame,
            preflight: Preflight::default(),
            takeover: Takeover::default(),
            phase: Phase::Preflight,
            outbox: Outbox::default(),
            has_refused: false,
            must_change_mode: false,
            has_begun: false,
            end: String::new(),
            climbs_s: None,
            to_start_s: None,
            returns_s: None,
            said_refused: Vec::new(),
            retry_s: 0.0,
            is_lost: false,
            stale_until_s: 0.0,
            arming_s: f64::NEG_INFINITY,
            has_ordered_arming: false,
            is_left: false,
            is_refused: false,
            is_abandoned: false,
            target: None,
            checked_since_s: None,
            awaited_return: None,
            has_seen_return: false,
            is_checked: false,
            has_said_checked: false,
            has_repeated_return: false,
            is_return_unclear: false,
            is_blind: false,
            may_arm: false,
            said: Said::default(),
        }
    }

    /// Whether it flies to the waypoints of plans, as far as is known.
    pub fn follows_plans(&self, now_s: f64) -> bool {
        self.phase == Phase::Flying && !self.has_refused && self.has_current_position(now_s)
    }

    /// Believes nothing that was heard before: the bridge was stopped meanwhile.
    pub fn doubt(&mut self, now_s: f64) {
        self.vehicle.doubt(now_s);
    }

    /// Notes that the last order to arm was not sent.
    pub fn forget_arming(&mut self) {
        if !self.has_ordered_arming {
            self.takeover.answer_arming(false);
        }
    }

    /// Takes the lines for people that have come up.
    pub fn take_said(&mut self) -> Vec<String> {
        self.said.take()
    }

    /// Takes in a message of the vehicle.
    pub fn hear(&mut self, telemetry: &Telemetry, now_s: f64) {
        if self.is_lost {
            self.is_lost = false;
            self.said.say("is heard again".to_owned());
        }
        if self.vehicle.was_silent(now_s) {
            self.vehicle.doubt(now_s);
            self.stale_until_s = now_s + SETTLED_S;
        }
        if now_s < self.stale_until_s {
            return; // it has waited in the link
        }
        if let Telemetry::Position(fix) = telemetry
            && !self.admit_fix(fix, now_s)
        {
            return;
        }
        self.vehicle.hear(telemetry, self.assignment.low_battery, now_s);
        match telemetry {
            Telemetry::Answer { command, result } => self.hear_answer(*command, *result, now_s),
            Telemetry::Text(text) => self.said.quote(text, now_s),
            Telemetry::Parameter { name, value, is_integer } => {
                if let Some(autopilot) = self.vehicle.autopilot {
                    self.preflight.hear_parameter(autopilot, name, autopilot.parameter(*value, *is_integer));
                }
            }
            _ => {}
        }
    }

    /// Notes, and says, whether the vehicle can be at `fix`.
    fn admit_fix(&mut self, fix: &Fix, now_s: f64) -> bool {
        if self.phase == Phase::Preflight && self.jumps.away_for_s(now_s) >= MOVED_S {
            self.jumps = Jumps::at_most(self.assignment.speed_mps);
        }
        let plausibility = self.jumps.admit(self.frame.position(fix), now_s);
        let Fix { lat_deg, lon_deg, .. } = fix;
        match plausibility {
            Plausibility::Plausible => {}
            Plausibility::Again => self.said.say(format!("is believed again to be at {lat_deg}, {lon_deg}")),
            Plausibility::Jump { away_m } => {
                let km = away_m.map_or("far".to_owned(), |away_m| format!("{:.1} km", away_m / 1e3));
                self.said.say(format!(
                    "is not believed to be at {lat_deg}, {lon_deg}, {km} from where it was: it gets no waypoints meanwhile"
                ));
            }
            Plausibility::StillAway => {}
        }
        matches!(plausibility, Plausibility::Plausible | Plausibility::Again)
    }

    fn hear_answer(&mut self, command: u16, result: u8, now_s: f64) {
        let Some(order) = self.outbox.answer(command, result, now_s) else { return };
        if order == Order::Arm {
            self.takeover.answer_arming(result == ACCEPTED);
            if result == ACCEPTED {
                self.note_arming(now_s);
            }
        }
        if result == ACCEPTED {
            if matches!(order, Order::TakeOff(_) | Order::Return) {
                self.retry_s = now_s + REORDER_S;
            }
            return;
        }
        self.retry_s = now_s + RETRY_S;
        let refused = match order {
            Order::Arm => Some(["to be armed", "while the checks hold"]),
            Order::TakeOff(_) => Some(["to take off", "for two minutes"]),
            Order::Return => Some(["to return", "and gets no heartbeats after half a minute"]),
            _ => None,
        };
        let is_new = !self.said_refused.contains(&command);
        if let Some([what, how_long]) = refused.filter(|_| is_new) {
            self.said_refused.push(command);
            self.said.say(format!("refuses {what}: MAVLink result {result}; it is asked again {how_long}"));
        }
        match order {
            Order::Return => self.outbox.send(order, self.retry_s),
            Order::Reposition { .. } if result == TEMPORARILY_REJECTED => self.outbox.send(order, self.retry_s),
            Order::Reposition { to, may_change_mode: false }
                if result == UNSUPPORTED && self.vehicle.autopilot.is_some_and(AutopilotKind::may_change_mode) =>
            {
                self.must_change_mode = true;
                self.outbox.send(Order::Reposition { to, may_change_mode: true }, now_s);
            }
            Order::Reposition { .. } => {
                self.has_refused = true;
                self.said.say(format!("refuses its waypoint: MAVLink result {result}"));
            }
            Order::Speed(speed_mps) => self.said.say(format!("keeps its own speed, not {speed_mps} m/s")),
            _ => {} // tried again
        }
    }

    /// Notes that the vehicle was armed by an order.
    fn note_arming(&mut self, now_s: f64) {
        if self.takeover.note_armed(now_s) {
            self.vehicle.recount_disarmed();
        }
    }

    /// Advances to `now_s` [s]; adds the orders that are due to `orders`.
    ///
    /// # Errors
    /// If the vehicle must not take off.
    pub fn poll(&mut self, now_s: f64, orders: &mut Vec<Order>) -> Result<(), PreflightRefusal> {
        if !matches!(self.phase, Phase::TakenOver | Phase::Landed) {
            orders.extend(self.vehicle.requests(now_s));
        }
        let [has_new_mode, has_new_heartbeat] = self.vehicle.take_new_reports();
        self.notice_silence(now_s);
        match self.phase {
            Phase::Preflight => self.check(now_s, orders)?,
            Phase::Arming => self.arm(now_s, orders),
            Phase::TakeOff => self.climb(now_s),
            Phase::Flying => self.watch(now_s),
            Phase::Returning => self.come_home(now_s),
            Phase::TakenOver => self.await_landing(now_s),
            Phase::Landed => {}
        }
        let says_disarmed = self.is_committed() && self.vehicle.is_armed() == Some(false);
        let is_in_doubt = self.vehicle.is_in_doubt() || says_disarmed;
        let is_astray = self.jumps.is_doubtful(now_s) || self.is_blind;
        let (is_placed, is_checked) = (self.has_current_position(now_s), self.is_checked);
        // What could undo the decision of a pilot follows at once a report of the mode that leaves no doubt; before it is
        // in the air, one that says whether it is armed, too.
        let may_overrule = |order: &Order| self.vehicle.autopilot.is_none_or(|autopilot| order.may_overrule(autopilot));
        let may_send = |order: &Order| {
            let may_fly = match order {
                Order::Reposition { .. } => !is_astray,
                Order::Arm => is_placed && is_checked,
                Order::TakeOff(_) => is_placed,
                _ => true,
            };
            let is_before_flight = matches!(order, Order::Mode(_) | Order::Arm | Order::TakeOff(_));
            let is_told = if is_before_flight { has_new_heartbeat } else { has_new_mode };
            !is_in_doubt && may_fly && (is_told || !may_overrule(order))
        };
        let due: Vec<Order> = self.outbox.due(now_s, may_send).collect();
        for order in due {
            if order == Order::Arm {
                self.has_ordered_arming = self.takeover.is_arming();
                self.vehicle.recount_disarmed();
                self.arming_s = now_s;
            }
            self.takeover.order(&order);
            orders.push(order);
        }
        Ok(())
    }

    /// Says once that the vehicle is not heard any more.
    fn notice_silence(&mut self, now_s: f64) {
        if let Some(silence_s) = self.vehicle.silence_s(now_s).filter(|_| !self.is_lost && self.phase != Phase::Landed)
        {
            self.is_lost = true;
            self.said.say(format!("is not heard any more, for {silence_s:.0} s"));
        }
        let was_blind = std::mem::replace(&mut self.is_blind, !self.vehicle.has_current_fix(now_s));
        let is_heard = !self.is_lost && !self.vehicle.is_in_doubt();
        if self.is_blind && !was_blind && is_heard && self.phase == Phase::Flying {
            self.said.say("does not say where it is any more: it gets no waypoints meanwhile".to_owned());
        }
    }

    /// Ends the orders if somebody else flies the vehicle. Returns whether.
    fn end_if_taken_over(&mut self) -> bool {
        let why = self.takeover.check(&self.vehicle);
        let is_on_ground = match self.phase {
            Phase::Arming | Phase::TakeOff => self.takeover.has_armed(),
            Phase::Returning => self.vehicle.is_armed() == Some(true),
            _ => false,
        };
        let is_armed_again = is_on_ground && self.vehicle.is_armed_again();
        let why = why.or_else(|| is_armed_again.then(|| "somebody else has armed it".to_owned()));
        if let Some(why) = &why {
            self.give_up(why);
        }
        why.is_some()
    }

    /// Ends the mission of a vehicle that has disarmed. Returns whether.
    fn end_if_disarmed(&mut self, now_s: f64) -> bool {
        let is_down = self.vehicle.has_disarmed(now_s);
        if is_down {
            self.said.say("has disarmed: its mission is over".to_owned());
            self.land("it has disarmed");
        }
        is_down
    }

    /// Ends its mission on the ground, because of `why` unless it had ended before.
    fn land(&mut self, why: &str) {
        self.note_end(why);
        self.outbox.clear();
        self.phase = Phase::Landed;
    }

    fn note_end(&mut self, why: &str) {
        if self.end.is_empty() {
            why.clone_into(&mut self.end);
        }
    }
}
