//! The flight of a vehicle: arms, climbs, flies to targets, comes home, and gives up.

use nalgebra::{Point3, Vector3};
use skysink_flight_sim::outside::REACHED_M;

use super::{CLIMB_S, CLIMBED_M, DISARMED_S, HOVER_MPS, Phase, RETRY_S, TO_START_S, VehicleControl};
use crate::autopilot::ModeMeaning;
use crate::preflight::Beginning;
use crate::telemetry::{GlobalTarget, Order};

impl VehicleControl {
    /// Arms in the mode that follows orders, while the checks hold.
    pub(super) fn arm(&mut self, now_s: f64, orders: &mut Vec<Order>) {
        if self.end_if_taken_over() {
            return;
        }
        self.check_again(now_s, orders);
        if self.phase != Phase::Arming {
            return;
        }
        let guided = self.vehicle.autopilot.and_then(|autopilot| autopilot.guided_mode());
        let must_change = guided.filter(|&mode| self.vehicle.mode() != Some(mode));
        if self.vehicle.is_armed() == Some(true) && must_change.is_none() {
            self.outbox.clear();
            self.phase = Phase::TakeOff;
            self.retry_s = now_s;
            return;
        }
        if self.vehicle.may_be_armed() && self.outbox.has(&Order::Arm) {
            self.note_arming(now_s); // its answer is lost
            self.takeover.answer_arming(true);
            self.outbox.clear();
        }
        if !self.may_arm {
            return; // the other vehicles are not checked yet
        }
        if let Some(armed_s) = self.takeover.armed_s() {
            if now_s - armed_s > DISARMED_S && self.vehicle.says_disarmed() {
                self.end_if_disarmed(now_s);
            }
            return; // it is not armed a second time
        }
        let order = must_change.map_or(Order::Arm, Order::Mode);
        if now_s >= self.retry_s && !self.vehicle.is_in_doubt() && !self.outbox.has(&order) {
            self.retry_s = now_s + RETRY_S;
            self.outbox.send(order, now_s);
        }
    }

    /// Takes off, until the altitude of the start is reached.
    pub(super) fn climb(&mut self, now_s: f64) {
        if self.end_if_taken_over() || self.end_if_disarmed(now_s) {
            return;
        }
        if self.return_if_low(now_s) {
            return;
        }
        let climbs_s = *self.climbs_s.get_or_insert(now_s);
        if now_s - climbs_s > CLIMB_S {
            let is_known = self.vehicle.has_current_fix(now_s) && !self.is_lost && !self.vehicle.is_in_doubt();
            if self.vehicle.is_in_air() || !is_known {
                self.return_home(&format!("it does not reach its altitude within {CLIMB_S} s"), now_s);
            } else {
                let why = format!("it does not take off within {CLIMB_S} s");
                self.said.say(format!("stays on the ground: {why}"));
                self.land(&why);
            }
            return;
        }
        let Some(fix) = self.vehicle.fix() else { return };
        let altitude_m = self.assignment.start.z;
        if fix.above_home_m > altitude_m - CLIMBED_M {
            self.said.say(format!("has taken off to {:.1} m", fix.above_home_m));
            self.fly(now_s);
        } else if now_s >= self.retry_s
            && !self.vehicle.is_in_air()
            && let Some(autopilot) = self.vehicle.autopilot
        {
            let order = Order::TakeOff(autopilot.altitude(altitude_m, fix.above_sea_m - fix.above_home_m));
            if !self.outbox.has(&order) {
                self.outbox.send(order, now_s);
            }
        }
    }

    /// Begins to follow targets.
    pub(super) fn fly(&mut self, now_s: f64) {
        self.outbox.clear();
        self.phase = Phase::Flying;
        self.outbox.send(Order::Speed(self.assignment.speed_mps), now_s);
        if self.assignment.beginning == (Beginning::Restarted { in_mission: true }) {
            self.has_begun = true;
        } else {
            self.fly_to(self.assignment.start, now_s);
        }
    }

    /// Flies to `target` [m] and holds there. Without effect before take-off and on the way home.
    pub fn fly_to(&mut self, target: Point3<f64>, now_s: f64) {
        self.has_refused = false;
        let (Some(place), Some(fix), Some(autopilot)) =
            (self.frame.geodetic(&target), self.vehicle.fix(), self.vehicle.autopilot)
        else {
            return;
        };
        if self.phase != Phase::Flying {
            return;
        }
        self.target = Some(target);
        let altitude = autopilot.altitude(target.z, fix.above_sea_m - fix.above_home_m);
        let to = GlobalTarget { lat_deg: place.lat_deg, lon_deg: place.lon_deg, altitude };
        let keeps_mode = self.vehicle.mode().is_some_and(|mode| autopilot.may_keep_mode(mode));
        let order = Order::Reposition { to, may_change_mode: self.must_change_mode || !keeps_mode };
        self.outbox.send(order, now_s);
    }

    /// Notices the arrival at the start, whoever takes the vehicle out of the bridge's hands, and a low battery.
    pub(super) fn watch(&mut self, now_s: f64) {
        if self.end_if_taken_over() || self.end_if_disarmed(now_s) {
            return;
        }
        if self.return_if_low(now_s) || self.has_begun {
            return;
        }
        if now_s - *self.to_start_s.get_or_insert(now_s) > TO_START_S {
            self.return_home(&format!("it does not reach its start within {TO_START_S} s"), now_s);
        } else if self.hovers_at(self.assignment.start, now_s) {
            self.has_begun = true;
            self.said.say("hovers at its start".to_owned());
            self.takeover.begin(self.vehicle.mode().unwrap_or_default());
        }
    }

    /// Sends the vehicle home if its battery is low. Returns whether.
    fn return_if_low(&mut self, now_s: f64) -> bool {
        let is_low = self.vehicle.is_battery_low();
        if is_low {
            let [has, limit] = [self.vehicle.battery.unwrap_or_default(), self.assignment.low_battery];
            self.return_home(&format!("its battery is at {:.0} %, below {:.0} %", 100.0 * has, 100.0 * limit), now_s);
        }
        is_low
    }

    fn hovers_at(&self, place: Point3<f64>, now_s: f64) -> bool {
        let is_near = self.position().is_some_and(|at| (at - place).norm() <= REACHED_M);
        let is_slow = self.vehicle.fix().is_some_and(|fix| Vector3::from(fix.velocity_mps).norm() <= HOVER_MPS);
        is_near && is_slow && self.has_current_position(now_s) && !self.vehicle.is_in_doubt()
    }

    /// Leaves the vehicle to whoever flies it.
    pub(super) fn give_up(&mut self, why: &str) {
        let (line, end) = if self.is_left {
            (format!("is left alone: {why}"), why.to_owned())
        } else if self.is_abandoned {
            let line =
                format!("is left to its dead-man switch: {why}. The bridge gives it no orders and no heartbeats");
            (line, format!("it was left to its dead-man switch: {why}"))
        } else {
            let line = format!(
                "is taken over: {why}. The bridge gives it no more orders in this run, which goes on until it has \
                 landed; Ctrl-C ends the run, and with it the heartbeats for which its dead-man switch waits"
            );
            (line, format!("it was taken over: {why}"))
        };
        self.said.say(line);
        self.note_end(&end);
        self.vehicle.recount_disarmed(); // it may have been armed since
        self.outbox.clear();
        self.phase = Phase::TakenOver;
    }

    /// Ends its mission, because of `why`: it flies home, or does not take off.
    pub fn return_home(&mut self, why: &str, now_s: f64) {
        let is_disarmed = if self.takeover.is_arming() {
            self.vehicle.has_disarmed(now_s) && !self.may_still_arm(now_s)
        } else {
            self.vehicle.is_armed() != Some(true) && !self.vehicle.may_be_armed()
        };
        match self.phase {
            Phase::Returning | Phase::TakenOver | Phase::Landed => return,
            Phase::Preflight if self.is_withheld() => return,
            Phase::Preflight if !self.has_seen_return && self.is_of_earlier_bridge(ModeMeaning::FollowsOrders) => {
                self.takeover.adopt(self.vehicle.mode().unwrap_or_default());
            }
            Phase::Preflight if self.assignment.beginning != Beginning::New && !self.takeover.has_been_disarmed() => {
                self.awaited_return.get_or_insert(why.to_owned());
                return;
            }
            Phase::Preflight => return self.land(why), // it is not the bridge's
            Phase::Arming | Phase::TakeOff if is_disarmed => return self.land(why),
            Phase::Arming | Phase::TakeOff | Phase::Flying => {}
        }
        self.phase = Phase::Returning;
        self.returns_s = Some(now_s);
        self.note_end(&format!("it has returned: {why}"));
        self.said.say(format!("returns: {why}"));
        self.outbox.clear();
        self.outbox.send(Order::Return, now_s);
    }

    /// Whether an order to arm may still be on its way, or its effect.
    pub(super) fn may_still_arm(&self, now_s: f64) -> bool {
        now_s - self.arming_s < DISARMED_S
    }

    /// Notices the landing, and who stops the return; orders it again if it has no effect.
    pub(super) fn come_home(&mut self, now_s: f64) {
        if self.vehicle.has_disarmed(now_s) && !self.may_still_arm(now_s) {
            self.said.say("has landed".to_owned());
            self.land("it has landed");
            return;
        }
        if self.vehicle.is_armed() == Some(false) && self.vehicle.says_disarmed() {
            return; // PX4 changes its mode when it disarms
        }
        if self.end_if_taken_over() {
            return;
        }
        let is_in_effect = self.vehicle.meaning() == ModeMeaning::Returns || self.takeover.has_seen_return();
        if is_in_effect && !self.vehicle.is_in_doubt() {
            self.is_return_unclear |= self.takeover.is_return_unclear() && self.outbox.has(&Order::Return);
            self.outbox.clear(); // a return that is repeated could undo the landing of a pilot, or of a failsafe
        }
        let is_ignored = self.vehicle.meaning() == ModeMeaning::FollowsOrders && !self.outbox.has(&Order::Return);
        if is_ignored && !self.vehicle.is_in_doubt() && now_s >= self.retry_s {
            if self.retry_s > 0.0 && !self.has_repeated_return {
                self.has_repeated_return = true;
                self.said.say("does not return yet: it is told again".to_owned());
            }
            self.outbox.send(Order::Return, now_s);
        }
    }

    /// Notices the landing of a vehicle that others fly.
    pub(super) fn await_landing(&mut self, now_s: f64) {
        self.is_abandoned &= self.is_unflown();
        if self.vehicle.has_disarmed(now_s) {
            self.said.say("is on the ground, disarmed".to_owned());
            self.land("it is on the ground");
        }
    }
}
