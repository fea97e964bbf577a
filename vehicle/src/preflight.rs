//! The checks before take-off: position, battery, GCS failsafe, mode, and the distance to the start.

use nalgebra::Point3;

use crate::autopilot::{AutopilotKind, ModeMeaning, NamedModes};
use crate::frame::AreaFrame;
use crate::state::VehicleState;
use crate::table::{Checks, Failsafe};
use crate::telemetry::Order;

/// Time between two questions for a parameter [s].
const ASK_S: f64 = 1.0;

/// Time after the answer to the first parameter in which one is waited for that only some versions have [s].
const OPTIONAL_S: f64 = 5.0;

/// Time after which it is said that a vehicle answers nothing, and after which it is given up [s].
const UNANSWERED_S: f64 = 10.0;
const GIVEN_UP_S: f64 = 60.0;

/// How far below the expected energy a battery may be, as a fraction of its capacity: what it says is rounded.
const BATTERY_SLACK: f64 = 0.05;

/// Farthest from its start at which a vehicle may take off [m].
const TAKE_OFF_RADIUS_M: f64 = 500.0;

/// What a vehicle has to do.
#[derive(Debug, Clone)]
pub struct Assignment {
    /// Where the area is on Earth.
    pub frame: AreaFrame,
    /// Where its mission begins [m].
    pub start: Point3<f64>,
    /// Its speed over ground [m/s].
    pub speed_mps: f64,
    /// Energy that its battery has to have before take-off, as a fraction of its capacity.
    pub battery: f64,
    /// Energy below which it returns, as a fraction of the capacity of its battery.
    pub low_battery: f64,
    /// The system of the bridge.
    pub own_system: u8,
    /// The modes that its address names.
    pub modes: NamedModes,
}

/// A vehicle that must not fly. Its `Display` is one line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PreflightRefusal(pub String);

/// What is known before take-off.
#[derive(Debug, Clone, Default)]
pub struct Preflight {
    /// The parameter of the GCS failsafe.
    failsafe: Option<f64>,
    /// That of what the failsafe depends on.
    condition: Option<f64>,
    /// When parameters were asked for first [s], and are next.
    asked_s: Option<f64>,
    ask_s: f64,
    /// When the parameter of the failsafe was known [s].
    told_s: Option<f64>,
    /// Why the checks do not hold, in words after "waiting for it", or of the refusal; empty if they hold.
    pub missing: String,
    /// Whether they held when they were made last.
    pub holds: bool,
    /// Whether the vehicle was believed disarmed before take-off, or was flown, in this run. One that was not is
    /// somebody else's, or an earlier run's, and its failsafe is not to wait for this one.
    pub was_down: bool,
}

impl Preflight {
    /// Nothing is known yet but [`was_down`](Self::was_down).
    pub fn of(was_down: bool) -> Self {
        Self { was_down, ..Self::default() }
    }

    /// Takes in the parameter `name`.
    pub fn hear_parameter(&mut self, autopilot: AutopilotKind, name: &str, value: f64) {
        if autopilot.gcs_failsafe().is_some_and(|failsafe| failsafe.parameter == name) {
            self.failsafe = Some(value);
        } else if autopilot.condition().is_some_and(|condition| condition.parameters.contains(&name)) {
            self.condition = Some(value);
        }
    }

    /// Checks whether the vehicle may take off from `position` [m], which is `None` unless it is current and believed.
    /// Adds questions for parameters to `orders`.
    pub fn check(
        &mut self,
        vehicle: &VehicleState,
        position: Option<Point3<f64>>,
        assignment: &Assignment,
        now_s: f64,
        orders: &mut Vec<Order>,
    ) -> Checks {
        let checked = self.first_missing(vehicle, position, assignment, now_s, orders);
        let checks = match &checked {
            Err(_) => Checks::Refused,
            Ok(Some(_)) => Checks::Wait,
            Ok(None) => Checks::Hold,
        };
        self.holds = checks == Checks::Hold;
        self.missing = checked.unwrap_or_else(|PreflightRefusal(why)| Some(why)).unwrap_or_default();
        checks
    }

    /// What is missing first, in words after "waiting for it".
    fn first_missing(
        &mut self,
        vehicle: &VehicleState,
        position: Option<Point3<f64>>,
        assignment: &Assignment,
        now_s: f64,
        orders: &mut Vec<Order>,
    ) -> Result<Option<String>, PreflightRefusal> {
        let wait = |what: &str| Ok(Some(what.to_owned()));
        let Some(autopilot) = vehicle.autopilot.filter(|_| !vehicle.is_lost(now_s)) else {
            // What comes next may be another one, or have been changed meanwhile.
            *self = Self::of(self.was_down);
            return wait("to send heartbeats");
        };
        let names_both = [ModeMeaning::Follows, ModeMeaning::Returns].iter().all(|mode| assignment.modes.names(*mode));
        if autopilot == AutopilotKind::Other && !names_both {
            let expected = "expected ArduPilot or PX4, or ?modes=follow:N,return:N with the numbers of its modes \
                            behind the address";
            let mode = vehicle.mode_name();
            return refuse(format!("its autopilot is not known, and is in {mode}: {expected}"));
        }
        let parameter = self.check_parameters(autopilot, assignment.own_system, now_s, orders)?;
        let Some(position) = position else { return wait("to know its position") };
        let away_m = (position.xy() - assignment.start.xy()).norm();
        if away_m > TAKE_OFF_RADIUS_M {
            return refuse(format!("it is {away_m:.0} m from its start: expected at most {TAKE_OFF_RADIUS_M} m"));
        }
        let needed = assignment.battery - BATTERY_SLACK;
        if let Some(battery) = vehicle.power.left.filter(|battery| *battery < needed) {
            let [has, needed] = [battery, needed].map(|fraction| (100.0 * fraction).round());
            return refuse(format!("its battery is at {has} %: at least {needed} % is needed to take off"));
        }
        if vehicle.is_high() {
            return wait("to be on the ground, at the altitude of its home");
        }
        if let Some(missing) = parameter {
            return Ok(Some(missing));
        }
        if !vehicle.power.is_reported {
            return wait("to report its battery");
        }
        if vehicle.meaning() != Some(ModeMeaning::Follows) {
            let wanted = autopilot.follow_name();
            let is = vehicle.mode_name();
            return Ok(Some(format!("to be put into {wanted} by its operator: it is in {is}")));
        }
        if vehicle.failsafe(now_s) != Failsafe::Off {
            return wait("to report no failsafe");
        }
        if !vehicle.is_ready() {
            return wait("to pass its own checks before arming");
        }
        Ok(None)
    }

    /// Says which parameter is missing; `None` if none is.
    fn check_parameters(
        &mut self,
        autopilot: AutopilotKind,
        own_system: u8,
        now_s: f64,
        orders: &mut Vec<Order>,
    ) -> Result<Option<String>, PreflightRefusal> {
        let Some(failsafe) = autopilot.gcs_failsafe() else { return Ok(None) };
        let parameter = failsafe.parameter;
        if let Some(value) = self.failsafe.filter(|value| failsafe.effect(*value).is_none()) {
            let expected = failsafe.expected();
            return refuse(format!("{parameter} = {value}: when the bridge is silent, expected {expected}"));
        }
        let condition = autopilot.condition();
        if let (Some(condition), Some(value)) = (condition, self.condition)
            && let Some(why) = (condition.refusal)(value, own_system)
        {
            return refuse(format!("{} = {value}: {why}", condition.parameters.join(" or ")));
        }
        if self.failsafe.is_some() {
            self.told_s.get_or_insert(now_s);
        }
        let awaited = condition.filter(|_| self.condition.is_none() && !self.is_patience_over(now_s));
        let asked_for_s = now_s - *self.asked_s.get_or_insert(now_s);
        if now_s >= self.ask_s && (self.failsafe.is_none() || self.condition.is_none()) {
            self.ask_s = now_s + ASK_S;
            orders.extend(self.failsafe.is_none().then_some(Order::Parameter(parameter)));
            orders.extend(awaited.iter().flat_map(|condition| condition.parameters).map(|name| Order::Parameter(name)));
        }
        if self.failsafe.is_some() {
            return Ok(awaited.map(|condition| condition.meaning.to_owned()));
        }
        let unheard = format!(
            "to say what it does when the bridge is silent ({parameter}): it is heard and answers nothing: a link in \
             one direction, a wrong address, or an autopilot that wants signed messages, which the bridge does not send"
        );
        match asked_for_s {
            UNANSWERED_S.. if asked_for_s >= GIVEN_UP_S => refuse(format!("waited {GIVEN_UP_S} s for it {unheard}")),
            UNANSWERED_S.. => Ok(Some(unheard)),
            _ => Ok(Some("to say what it does when the bridge is silent".to_owned())),
        }
    }

    fn is_patience_over(&self, now_s: f64) -> bool {
        self.told_s.is_some_and(|told_s| now_s - told_s >= OPTIONAL_S)
    }

    /// What was found, for people: what the vehicle does when the bridge is silent, and what could not be checked.
    pub fn findings(&self, vehicle: &VehicleState) -> Vec<String> {
        let mut lines = Vec::new();
        let failsafe = vehicle.autopilot.and_then(AutopilotKind::gcs_failsafe);
        match failsafe.zip(self.failsafe) {
            Some((failsafe, value)) => {
                let effect = failsafe.effect(value).unwrap_or("is not known");
                lines.push(format!("{effect} when the bridge is silent ({} = {value})", failsafe.parameter));
            }
            None => lines.push("may stay in the air when the bridge is silent: its autopilot is not known".to_owned()),
        }
        if let Some(condition) =
            vehicle.autopilot.and_then(AutopilotKind::condition).filter(|_| self.condition.is_none())
        {
            lines.push(format!("does not tell {}: not checked", condition.parameters.join(" or ")));
        }
        if vehicle.power.left.is_none() {
            lines.push("does not measure its battery: its charge is not checked".to_owned());
        }
        lines
    }
}

fn refuse<T>(message: String) -> Result<T, PreflightRefusal> {
    Err(PreflightRefusal(message))
}
