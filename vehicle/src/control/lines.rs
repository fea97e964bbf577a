//! What is said of a vehicle: of each transition one line, and of what it does not do, or does not say, while that
//! lasts.

use skysink_flight_sim::outside::REACHED_M;

use super::{HOME_SLACK_M, HOVER_MPS, VehicleControl};
use crate::autopilot::ModeMeaning;
use crate::table::{Checks, Ending, Failsafe, Height, Input, Left, SpokenLine, State, TakenBy};

/// Time after which it is said what a vehicle does not do [s], and that something is missing before take-off.
const SAID_S: f64 = 10.0;
const MISSING_S: f64 = 2.0;

/// The same of a return, and of a failsafe [s].
const SLOW_S: f64 = 60.0;

/// Silence up to which a vehicle is heard [s].
const HEARD_S: f64 = 1.0;

impl VehicleControl {
    /// Says how it goes on from the state in which the bridge before, or the run before, has saved it.
    pub fn say_restored(&mut self, saved: State) {
        match self.state {
            State::Check { .. } => {}
            State::Fly { .. } => {
                self.said.say("is flown on as soon as it reports the mode that follows commands".to_owned())
            }
            State::HandsOff => self.end_with("it was flown by others before this bridge began", "is left alone"),
            State::Silent if saved != State::Silent => self.say_line(SpokenLine::Silent(Left::Restarted)),
            State::Silent => {
                self.end_with("it was left to its GCS failsafe before this bridge began", "gets no heartbeats")
            }
            _ => self.end_with("its mission was over before this bridge began", "stays down"),
        }
    }

    pub(super) fn end_with(&mut self, why: &str, what: &str) {
        self.said.say(format!("{what}: {why}"));
        why.clone_into(&mut self.end);
    }

    /// Says what a transition means, and keeps why the mission ends.
    pub(super) fn say_line(&mut self, line: SpokenLine) {
        let what = match line {
            SpokenLine::Arming => {
                let findings = self.preflight.findings(&self.vehicle);
                findings.into_iter().for_each(|line| self.said.say(line));
                return self.said.say("is checked: arming".to_owned());
            }
            SpokenLine::HasTakenOff => {
                let at_m = self.position().map_or(0.0, |position| position.z);
                return self.said.say(format!("has taken off to {at_m:.1} m"));
            }
            SpokenLine::FliesOn => return self.said.say("is in the air: flying on".to_owned()),
            SpokenLine::IsAtStart => return self.said.say("hovers at its start".to_owned()),
            SpokenLine::Returns(_) => "returns",
            SpokenLine::HandsOff(TakenBy::Armed) if !self.preflight.was_down => "is not flown",
            SpokenLine::HandsOff(_) => "is overridden",
            SpokenLine::Silent(_) => "is left to its GCS failsafe",
            SpokenLine::Done(Ending::Landed) => return self.said.say("has landed".to_owned()),
            SpokenLine::Done(Ending::OverInArm) => "is not taken off, and may be armed for some seconds",
            SpokenLine::Done(Ending::Over | Ending::ChecksFailed | Ending::ArmingRefused | Ending::ArmingLost) => {
                "is not flown"
            }
            SpokenLine::Done(Ending::NoTakeOff) => "stays on the ground",
            SpokenLine::Done(_) if self.end.is_empty() => "its mission is over",
            SpokenLine::Done(_) => return self.said.say("is on the ground, disarmed".to_owned()),
        };
        let why = self.why(line);
        let more = match line {
            SpokenLine::HandsOff(TakenBy::Armed) if !self.preflight.was_down => "",
            SpokenLine::HandsOff(_) => {
                ". The bridge gives it no more commands in this run, which goes on; Ctrl-C ends it, and with it the \
                 heartbeats for which its GCS failsafe waits"
            }
            SpokenLine::Silent(_) => {
                ". The bridge gives it no commands, and no heartbeats unless another vehicle at its address needs them"
            }
            _ => "",
        };
        self.said.say(format!("{what}: {why}{more}"));
        if !matches!(line, SpokenLine::Returns(Ending::Over) | SpokenLine::Done(Ending::Over | Ending::OverInArm)) {
            self.end = why;
        }
    }

    /// Why a transition to the end of a mission is made.
    fn why(&self, line: SpokenLine) -> String {
        let mode = self.vehicle.mode_name();
        match line {
            SpokenLine::Returns(Ending::NoClimb) => "it does not reach its altitude within two minutes".to_owned(),
            SpokenLine::Returns(Ending::NoStart) => "it does not reach its start within ten minutes".to_owned(),
            SpokenLine::HandsOff(TakenBy::Armed) => format!(
                "it is armed ({mode}), by somebody else or by an earlier run: expected it on the ground, disarmed; try \
                 again when it has landed"
            ),
            SpokenLine::HandsOff(TakenBy::Mode) => format!("its mode changed to {mode}"),
            SpokenLine::HandsOff(TakenBy::Return) => {
                format!("it returns or lands by itself ({mode}): a failsafe, or a pilot")
            }
            SpokenLine::HandsOff(TakenBy::ReturnStopped) => {
                format!("its return was stopped ({mode}): a failsafe, or a pilot")
            }
            SpokenLine::Silent(Left::NoReturn) => "it does not return within half a minute".to_owned(),
            SpokenLine::Silent(Left::Restarted) => {
                "the bridge was restarted between its command to arm and its mission, or in its return".to_owned()
            }
            SpokenLine::Done(Ending::ChecksFailed) => self.preflight.missing.clone(),
            SpokenLine::Done(Ending::ArmingRefused) => {
                format!("it refuses to be armed: MAVLink result {}", self.outbox.result().unwrap_or_default())
            }
            SpokenLine::Done(Ending::ArmingLost) => {
                "it was not armed, or not ready to take off, 13 s after the command".to_owned()
            }
            SpokenLine::Done(Ending::NoTakeOff) => "it does not take off within two minutes".to_owned(),
            SpokenLine::Done(Ending::Disarmed) => "it has disarmed".to_owned(),
            _ => self.end.clone(),
        }
    }

    /// Says what a vehicle does not do, does not say, or is waited for, while that lasts.
    pub(super) fn say_what_lasts(&mut self, input: &Input, now_s: f64) {
        for (matter, is_so, after_s, line) in self.lasting(input, now_s) {
            let has_ended = self.said.say_while(matter, is_so.then_some(line), after_s, now_s);
            if has_ended && matter == "lost" {
                self.said.say("is heard again".to_owned());
            }
        }
        let missing = self.awaited(input, now_s);
        self.said.say_while("missing", missing, MISSING_S, now_s);
    }

    /// What may last: its name, whether it does, after how long it is said [s], and the line.
    fn lasting(&self, input: &Input, now_s: f64) -> [(&'static str, bool, f64, String); 9] {
        let is_lost = self.vehicle.is_lost(now_s);
        let is_in_flight = matches!(self.state, State::Climb | State::Fly { .. });
        let is_blind = is_in_flight && !is_lost && self.vehicle.fix().is_some() && !self.vehicle.has_current_fix(now_s);
        let is_on_ground = input.height == Height::Ground;
        let is_off = matches!(self.state, State::Home { .. } | State::Done);
        let does_not_agree = self.state.is_flown() && input.believed.is_none() && !is_lost && self.is_heard(now_s);
        let lost = match self.hearing.arrivals.silence_s(now_s) {
            Some(silence_s) if silence_s < HEARD_S => "does not say its mode any more, for 3 s",
            _ => "is not heard any more, for 3 s",
        };
        let progress = self.progress(input);
        let off_m = self.home_is_off_m().filter(|off_m| self.reads_above_sea() && *off_m >= HOME_SLACK_M);
        let follows = input.believed.is_some_and(|report| report.is_armed && report.mode == ModeMeaning::Follows);
        [
            ("lost", is_lost && self.state != State::Done, 0.0, lost.to_owned()),
            ("blind", is_blind, 0.0, "does not say where it is any more: it gets no waypoints meanwhile".to_owned()),
            (
                "home",
                is_in_flight && off_m.is_some(),
                0.0,
                format!(
                    "reports an altitude of its home that is {:.0} m from the one at its take-off: it gets no \
                     waypoints meanwhile",
                    off_m.unwrap_or_default()
                ),
            ),
            (
                "failsafe",
                is_in_flight && input.failsafe != Failsafe::Off,
                0.0,
                "says that a failsafe of it acts: it gets no waypoints meanwhile".to_owned(),
            ),
            (
                "doubt",
                does_not_agree,
                SAID_S,
                "its reports of mode and arming do not agree: it gets no commands, and no heartbeats".to_owned(),
            ),
            ("stands", is_off && input.says_armed && is_on_ground, SAID_S, "stands on the ground, armed".to_owned()),
            (
                "armed",
                self.state == State::Done && input.says_armed && !is_on_ground,
                MISSING_S,
                "is armed and in the air, though its mission is over: it gets no commands".to_owned(),
            ),
            (
                "left",
                self.state == State::Silent && follows && !is_on_ground,
                SLOW_S,
                format!(
                    "is in the air in {}, and nobody is known to fly it: its failsafe has not acted, or was ended",
                    self.vehicle.mode_name()
                ),
            ),
            ("progress", progress.is_some(), self.slow_after_s(), progress.unwrap_or_default()),
        ]
    }

    /// What a vehicle that is being checked is waited for.
    fn awaited(&self, input: &Input, now_s: f64) -> Option<String> {
        matches!(self.state, State::Check { .. }).then(|| match input.checks {
            _ if !self.is_heard(now_s) => "waiting for it to send heartbeats".to_owned(),
            Checks::Hold if self.state.may_fly() && input.believed.is_some() => {
                "waiting for it to be on the ground, or in the air in the mode that follows commands".to_owned()
            }
            Checks::Hold if input.believed.is_none() => "waiting for it to report the same twice in a row".to_owned(),
            Checks::Hold => "is checked, and waits for the others".to_owned(),
            Checks::Refused => format!("must not take off: {}", self.preflight.missing),
            Checks::Wait => format!("waiting for it {}", self.preflight.missing),
        })
    }

    /// Time after which it is said how far it is [s]: a return takes a while.
    fn slow_after_s(&self) -> f64 {
        if let State::Home { .. } = self.state { SLOW_S } else { SAID_S }
    }

    /// How far it is from where it has to be, for people; `None` if it is there, or on its way in a slot.
    fn progress(&self, input: &Input) -> Option<String> {
        let position = self.position()?;
        match self.state {
            State::Home { was_seen: true } if input.height != Height::Ground => {
                Some(format!("is on its way home, {:.1} m up", position.z))
            }
            State::Climb => Some(format!("climbs: at {:.1} m of {:.1} m", position.z, self.assignment.start.z)),
            State::Fly { has_begun: false } => {
                let away_m = (position - self.assignment.start).norm();
                Some(format!("is on its way to its start, {away_m:.1} m away: expected to hover within {REACHED_M} m"))
            }
            State::Fly { has_begun: true } if input.failsafe == Failsafe::Off => {
                let away_m = self.waypoint.map(|waypoint| (position - waypoint.at).norm())?;
                let stands = self.vehicle.speed_mps().is_some_and(|speed_mps| speed_mps <= HOVER_MPS);
                (stands && away_m > REACHED_M)
                    .then(|| format!("does not follow: it stands {away_m:.1} m from its waypoint"))
            }
            _ => None,
        }
    }
}
