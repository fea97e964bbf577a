//! How the mission of a vehicle begins: the checks before it is armed, and what an earlier bridge has left.

use super::{CLIMBED_M, Fate, History, Phase, VehicleControl};
use crate::autopilot::ModeMeaning;
use crate::preflight::{Beginning, Clearance, PreflightRefusal};
use crate::telemetry::Order;

/// Time after which a vehicle that an earlier bridge has left in the air returns if it has not passed the checks [s].
const CHECKS_S: f64 = 150.0;

impl VehicleControl {
    /// Goes on as the bridge before has left it, by its `history`, and by its last report, which `says_ended` if its mission
    /// has ended in the air; whether all bridges of its flight are of this run, so that no other has armed it. It is not armed
    /// twice.
    pub fn go_on(&mut self, history: History, says_ended: bool, is_new_run: bool) {
        self.assignment.was_armed |= history.was_armed;
        self.assignment.is_unarmed = (is_new_run || history.was_down) && !history.was_armed;
        self.has_seen_return = history.has_seen_return;
        if self.phase != Phase::Preflight {
            return; // it stays down
        }
        self.has_begun |= says_ended;
        match history.fate {
            Fate::Open if !says_ended => {}
            Fate::Returns => {
                self.has_begun |= self.assignment.beginning != Beginning::Restarted { in_mission: false };
                self.awaited_return = Some("it was on its way home before this bridge began".to_owned());
            }
            Fate::Ended => {
                self.has_begun |= self.assignment.beginning != Beginning::Restarted { in_mission: false };
                self.land("its mission was over before this bridge began");
            }
            Fate::Left => self.leave(false),
            Fate::Abandoned | Fate::Open => self.leave(true),
        }
    }

    /// Leaves a vehicle alone that had ended its mission before this bridge began; nobody is known to fly one that
    /// `is_abandoned`.
    pub fn leave(&mut self, is_abandoned: bool) {
        self.is_left = true;
        self.is_abandoned = is_abandoned;
        self.has_begun |= self.assignment.beginning != Beginning::Restarted { in_mission: false };
        self.give_up(if is_abandoned {
            "its mission was over before this bridge began. It gets no orders, and heartbeats only if somebody flies it"
        } else {
            "it was taken over before this bridge began"
        });
    }

    /// Ends its mission before it flies, because of `why`. One that an earlier bridge may have left in the air gets no
    /// orders, and no heartbeats.
    pub fn refuse(&mut self, why: &str, now_s: f64) {
        if self.takeover.is_arming() {
            self.return_home(why, now_s);
        } else if self.assignment.beginning == Beginning::New || self.takeover.has_been_disarmed() {
            self.said.say(format!("is not armed: {why}"));
            self.land(why);
        } else {
            self.abandon(why);
        }
    }

    /// Gives it no orders and no heartbeats from now on, as it may be another, unless it is flown already.
    pub fn withhold(&mut self) {
        self.is_refused = true;
    }

    /// Gives a vehicle up in the air: its dead-man switch brings it home, unless somebody flies it.
    fn abandon(&mut self, why: &str) {
        self.is_abandoned = self.is_unflown();
        self.give_up(why);
    }

    /// Ends the mission of a vehicle in the air, in the mode that follows orders, that is to return, or does not pass the
    /// checks. Returns whether.
    fn end_in_air(&mut self, now_s: f64) -> bool {
        // Where the mode is not known, it may still return.
        if self.has_seen_return && self.vehicle.meaning() == ModeMeaning::FollowsOrders {
            self.give_up("its return was stopped without an order of the bridge");
            return true;
        }
        let since_s = *self.checked_since_s.get_or_insert(now_s);
        let missing = self.preflight.missing.filter(|_| now_s - since_s > CHECKS_S);
        let late = missing.map(|missing| format!("the bridge has waited {CHECKS_S} s for it {missing}"));
        if !self.is_of_earlier_bridge(ModeMeaning::FollowsOrders) {
            late.iter().for_each(|why| self.abandon(why)); // it does not say where it is, or is far away
            return late.is_some();
        }
        let Some(why) = self.awaited_return.take().or(late) else { return false };
        self.return_home(&why, now_s);
        true
    }

    /// Leaves a vehicle on the ground that had ended its mission there, under an earlier bridge.
    pub fn stay_down(&mut self) {
        self.has_begun = true;
        self.said.say("was down before, and stays down".to_owned());
        self.land("it was down before");
    }

    /// Says that the mission goes on without it, unless it is ready after all.
    pub fn leave_behind(&mut self) {
        self.said.say("is not ready: the mission goes on without it until it is".to_owned());
    }

    /// Lets it be armed, as soon as it is checked itself.
    pub fn allow_arming(&mut self) {
        self.may_arm = true;
    }

    /// Checks whether the vehicle may take off, or is in the air already.
    pub(super) fn check(&mut self, now_s: f64, orders: &mut Vec<Order>) -> Result<(), PreflightRefusal> {
        if self.is_withheld() {
            return Ok(());
        }
        let stands = self.has_current_position(now_s) && !self.vehicle.is_high();
        let is_down = self.vehicle.is_armed() == Some(false) && (stands || self.vehicle.has_disarmed(now_s));
        if self.awaited_return.is_some() && is_down {
            self.takeover.note_disarmed();
            let why = self.awaited_return.take().unwrap_or_default();
            self.land(&why);
            return Ok(());
        }
        let may_fly = self.is_left_in_air(ModeMeaning::FollowsOrders) || self.is_left_unseen(now_s);
        if may_fly && self.end_in_air(now_s) {
            return Ok(());
        }
        self.has_seen_return |= self.is_left_in_air(ModeMeaning::Returns);
        if self.awaited_return.is_some() && self.is_of_earlier_bridge(ModeMeaning::Returns) {
            self.watch_return();
            return Ok(());
        }
        let is_armed = self.vehicle.is_armed() == Some(true); // on the ground, as far as is known
        if self.awaited_return.is_some() && is_armed && self.vehicle.meaning() == ModeMeaning::Returns {
            return Ok(()); // it has come home, and disarms soon
        }
        let position = self.position().filter(|_| self.has_current_position(now_s));
        let Self { preflight, vehicle, takeover, assignment, .. } = self;
        let clearance = preflight.judge(vehicle, position, takeover, assignment, now_s, orders)?;
        match clearance {
            Clearance::Wait(missing) => self.await_missing(missing, now_s),
            Clearance::GiveUp(why) => self.give_up(&why),
            Clearance::Arm if self.awaited_return.is_some() => {} // until it is known to be down
            Clearance::Arm => {
                if !std::mem::replace(&mut self.has_said_checked, true) {
                    self.say_findings();
                    self.said.say("is checked: arming".to_owned());
                }
                self.has_seen_return = false; // another flight begins
                self.phase = Phase::Arming;
                self.retry_s = now_s;
            }
            Clearance::FlyOn { mode } => {
                self.say_findings();
                self.said.say("is in the air: flying on".to_owned());
                self.takeover.adopt(mode);
                let is_low =
                    self.vehicle.fix().is_some_and(|fix| fix.above_home_m < self.assignment.start.z - CLIMBED_M);
                if self.assignment.beginning == (Beginning::Restarted { in_mission: false }) && is_low {
                    self.vehicle.recount_disarmed();
                    self.phase = Phase::TakeOff; // which goes on
                } else {
                    self.fly(now_s);
                }
            }
            Clearance::Return(why) => self.return_home(&why, now_s),
            Clearance::Abandon(why) => self.abandon(&why),
        }
        Ok(())
    }

    fn say_findings(&mut self) {
        for line in self.preflight.findings(&self.vehicle) {
            self.said.say(line);
        }
    }

    /// Checks whether the checks before take-off hold now: they may be minutes old. Otherwise it waits for what is missing,
    /// or is left on the ground; after an order to arm, it gets no other.
    pub(super) fn check_again(&mut self, now_s: f64, orders: &mut Vec<Order>) {
        let position = self.position().filter(|_| self.has_current_position(now_s));
        let checked = self.preflight.check(&self.vehicle, position, &self.assignment, now_s, orders);
        self.is_checked = checked == Ok(None);
        match checked {
            Ok(Some(_)) if !self.takeover.is_arming() => {
                self.outbox.clear();
                self.phase = Phase::Preflight; // which says what is missing
                self.may_arm = false;
            }
            Ok(Some(missing)) => self.await_missing(missing, now_s),
            Ok(None) => self.preflight.missing = None,
            Err(PreflightRefusal(why)) if !self.takeover.is_arming() || self.has_ignored_arming(now_s) => {
                self.said.say(format!("is not armed: {why}"));
                self.land(&why);
            }
            Err(_) => {}
        }
    }

    /// Whether the last order to arm has had no effect, nor an answer.
    fn has_ignored_arming(&self, now_s: f64) -> bool {
        self.takeover.armed_s().is_none() && !self.may_still_arm(now_s) && self.vehicle.says_disarmed()
    }

    /// Says from time to time what the vehicle is waited for.
    fn await_missing(&mut self, missing: &'static str, now_s: f64) {
        self.preflight.missing = Some(missing);
        if self.preflight.is_line_due(now_s) {
            self.said.say(format!("waiting for it {missing}"));
        }
    }

    /// Whether a vehicle that is not checked yet is in the air, in such a mode, and may be that of an earlier bridge.
    fn is_left_in_air(&self, meaning: ModeMeaning) -> bool {
        self.may_be_left(meaning) && self.vehicle.is_in_air()
    }

    /// Whether one that is armed, and does not say where it is, may be.
    fn is_left_unseen(&self, now_s: f64) -> bool {
        let is_unseen = self.vehicle.is_armed() == Some(true) && !self.has_current_position(now_s);
        let is_left = |meaning| self.may_be_left(meaning);
        is_unseen && [ModeMeaning::FollowsOrders, ModeMeaning::Unknown].into_iter().any(is_left)
    }

    fn may_be_left(&self, meaning: ModeMeaning) -> bool {
        let is_left = self.assignment.beginning != Beginning::New && !self.takeover.has_been_disarmed();
        is_left && !self.assignment.is_unarmed && self.vehicle.meaning() == meaning
    }

    /// Whether it is where an earlier bridge has left it, too.
    pub(super) fn is_of_earlier_bridge(&self, meaning: ModeMeaning) -> bool {
        self.is_left_in_air(meaning) && self.assignment.is_near(self.position())
    }

    /// Waits for the landing of a vehicle that is on its way home.
    fn watch_return(&mut self) {
        self.takeover.adopt(self.vehicle.mode().unwrap_or_default());
        self.takeover.order(&Order::Return); // that of the bridge before
        self.said.say("is on its way home".to_owned());
        self.note_end("it has returned");
        self.has_seen_return = true;
        self.phase = Phase::Returning;
    }
}
