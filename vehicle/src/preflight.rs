//! The checks before take-off, and before a vehicle in the air is taken over from an earlier bridge: position, battery,
//! dead-man switch, and the distance to the start.

use nalgebra::Point3;

use crate::autopilot::{AutopilotKind, ModeMeaning};
use crate::state::VehicleState;
use crate::takeover::Takeover;
use crate::telemetry::Order;

/// Time between two questions for a parameter [s].
const ASK_S: f64 = 1.0;

/// Time after the answer to the first parameter in which one is waited for that only some versions have [s].
const OPTIONAL_S: f64 = 5.0;

/// Time before the first line on what is missing, and between two [s].
const FIRST_LINE_S: f64 = 6.0;
const LINE_S: f64 = 10.0;

/// How far below the expected energy a battery may be, as a fraction of its capacity: what it says is rounded.
const BATTERY_SLACK: f64 = 0.05;

/// Farthest from its start at which a vehicle may take off [m].
const TAKE_OFF_RADIUS_M: f64 = 500.0;

/// How the mission of a bridge begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beginning {
    /// With a vehicle on the ground, disarmed.
    New,
    /// Where a stopped run has ended: the vehicle may be in the air.
    Resumed,
    /// After the end of the bridge before, in this run; the mission has begun if `in_mission`.
    Restarted {
        /// Whether slots were flown.
        in_mission: bool,
    },
}

/// What a vehicle has to do.
#[derive(Debug, Clone, Copy)]
pub struct Assignment {
    /// Where its mission begins [m].
    pub start: Point3<f64>,
    /// Its speed over ground [m/s].
    pub speed_mps: f64,
    /// Energy that its battery has to have before take-off, as a fraction of its capacity.
    pub battery: f64,
    /// Energy below which it returns, as a fraction of the capacity of its battery.
    pub low_battery: f64,
    /// How the mission begins.
    pub beginning: Beginning,
    /// The system of the bridge.
    pub own_system: u8,
    /// How far it may have flown from its start since that was reported [m].
    pub flown_m: f64,
    /// Whether a bridge before has armed it: it is not armed again.
    pub was_armed: bool,
    /// Whether it is known that no bridge before has armed it.
    pub is_unarmed: bool,
}

impl Assignment {
    /// Farthest from its start at which it may take off, or be taken over in the air [m].
    fn radius_m(&self) -> f64 {
        TAKE_OFF_RADIUS_M + self.flown_m
    }

    /// Whether it is so near its start that it may take off [m].
    pub(crate) fn is_near(&self, position: Option<Point3<f64>>) -> bool {
        position.is_some_and(|position| (position.xy() - self.start.xy()).norm() <= self.radius_m())
    }
}

/// A vehicle that must not take off. Its `Display` is one line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PreflightRefusal(pub String);

/// What follows from the checks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Clearance {
    /// Something is missing, in words after "waiting for it".
    Wait(&'static str),
    /// The vehicle may be armed.
    Arm,
    /// It is in the air, where an earlier bridge has left it.
    FlyOn {
        /// Its mode.
        mode: u32,
    },
    /// It is in the air, where an earlier bridge has left it, and must return, because of this.
    Return(String),
    /// Others fly it, in words after "is taken over:".
    GiveUp(String),
    /// It may be another vehicle, or take off by an order of an earlier bridge: why, in words.
    Abandon(String),
}

/// What is known before take-off.
#[derive(Debug, Clone, Default)]
pub struct Preflight {
    /// The parameter of the dead-man switch.
    dead_man: Option<f64>,
    /// That of what the switch depends on.
    condition: Option<f64>,
    /// When parameters are asked for next [s].
    ask_s: f64,
    /// When that of the dead-man switch was known [s].
    told_s: Option<f64>,
    /// What was missing last, in words after "waiting for it".
    pub missing: Option<&'static str>,
    /// When the next line on what is missing is due [s].
    line_s: Option<f64>,
}

impl Preflight {
    /// Takes in the parameter `name`.
    pub fn hear_parameter(&mut self, autopilot: AutopilotKind, name: &str, value: f64) {
        if autopilot.dead_man_switch().is_some_and(|switch| switch.parameter == name) {
            self.dead_man = Some(value);
        } else if autopilot.condition().is_some_and(|condition| condition.parameters.contains(&name)) {
            self.condition = Some(value);
        }
    }

    /// Whether it is time for another line on what is missing.
    pub fn is_line_due(&mut self, now_s: f64) -> bool {
        let is_due = self.line_s.is_some_and(|line_s| now_s >= line_s);
        if is_due {
            self.line_s = Some(now_s + LINE_S);
        }
        self.line_s.get_or_insert(now_s + FIRST_LINE_S);
        is_due
    }

    /// Checks whether the vehicle may take off from `position` [m], which is `None` unless it is current and believed, or
    /// whether it is in the air already. Adds questions for parameters to `orders`.
    ///
    /// # Errors
    /// If it must not take off.
    pub fn judge(
        &mut self,
        vehicle: &VehicleState,
        position: Option<Point3<f64>>,
        takeover: &mut Takeover,
        assignment: &Assignment,
        now_s: f64,
        orders: &mut Vec<Order>,
    ) -> Result<Clearance, PreflightRefusal> {
        let is_low = position.is_some() && !vehicle.is_high();
        let is_down = vehicle.is_armed() == Some(false) && (is_low || vehicle.has_disarmed(now_s));
        if is_down && assignment.was_armed {
            takeover.note_disarmed();
            return Ok(Clearance::GiveUp("it is on the ground, after it was armed".to_owned()));
        }
        let (Some(is_armed), Some(mode), Some(_)) = (vehicle.is_armed(), vehicle.mode(), position) else {
            return Ok(Clearance::Wait(match (vehicle.autopilot, position) {
                (None, _) => "to send heartbeats",
                (_, None) => "to know its position",
                _ => "to say the same mode twice in a row",
            }));
        };
        if is_armed {
            if takeover.has_been_disarmed() || assignment.is_unarmed {
                return Ok(Clearance::GiveUp("somebody else has armed it".to_owned()));
            }
            return self.judge_armed(vehicle, mode, position, assignment, now_s, orders);
        }
        if !is_down {
            return Ok(Clearance::Wait("to be on the ground, at the altitude of its home"));
        }
        takeover.note_disarmed();
        if let Some(why) = takeover.check(vehicle) {
            return Ok(Clearance::GiveUp(why));
        }
        let missing = self.check(vehicle, position, assignment, now_s, orders)?;
        Ok(missing.map_or(Clearance::Arm, Clearance::Wait))
    }

    /// Checks a vehicle in this mode that somebody has armed: only after an earlier bridge, in the air, it is flown on.
    fn judge_armed(
        &mut self,
        vehicle: &VehicleState,
        mode: u32,
        position: Option<Point3<f64>>,
        assignment: &Assignment,
        now_s: f64,
        orders: &mut Vec<Order>,
    ) -> Result<Clearance, PreflightRefusal> {
        let name = vehicle.mode_name();
        let is_in_air = vehicle.is_in_air();
        let is_left = is_in_air && vehicle.meaning() == ModeMeaning::FollowsOrders;
        let awaits_landing = match assignment.beginning {
            Beginning::Resumed => true,
            Beginning::Restarted { in_mission: false } => !assignment.was_armed, // as the bridge before did
            _ => false,
        };
        match assignment.beginning {
            Beginning::New => {
                let state = if is_in_air { "in the air" } else { "armed" };
                refuse(format!("it is {state} ({name}): expected it on the ground, disarmed"))
            }
            _ if awaits_landing && vehicle.meaning() == ModeMeaning::Returns => Ok(Clearance::Wait("to land")),
            Beginning::Resumed if !is_left => refuse(format!(
                "it is armed ({name}): expected it on the ground, or in the air in the mode that follows orders"
            )),
            Beginning::Restarted { .. } if !is_in_air => Ok(Clearance::Abandon(format!(
                "it is armed on the ground ({name}), and who has armed it is not known after a restart"
            ))),
            Beginning::Restarted { .. } if vehicle.meaning() == ModeMeaning::Unknown => {
                Ok(Clearance::Abandon(format!("who flies it is not known ({name})")))
            }
            Beginning::Restarted { .. } if !is_left => Ok(Clearance::GiveUp(format!("it is flown by others ({name})"))),
            Beginning::Resumed | Beginning::Restarted { .. } => {
                match self.check(vehicle, position, assignment, now_s, orders) {
                    Ok(missing) => Ok(missing.map_or(Clearance::FlyOn { mode }, Clearance::Wait)),
                    Err(refusal) if assignment.beginning == Beginning::Resumed => Err(refusal),
                    Err(PreflightRefusal(why)) if assignment.is_near(position) => Ok(Clearance::Return(why)),
                    Err(PreflightRefusal(why)) => Ok(Clearance::Abandon(why)),
                }
            }
        }
    }

    /// Says what is still missing, in words after "waiting for it"; `None` if the vehicle may take off from `position`
    /// [m]. Adds questions for parameters to `orders`.
    ///
    /// # Errors
    /// If it must not take off.
    pub(crate) fn check(
        &mut self,
        vehicle: &VehicleState,
        position: Option<Point3<f64>>,
        assignment: &Assignment,
        now_s: f64,
        orders: &mut Vec<Order>,
    ) -> Result<Option<&'static str>, PreflightRefusal> {
        let Some(autopilot) = vehicle.autopilot else { return Ok(Some("to send heartbeats")) };
        let Some(position) = position else { return Ok(Some("to know its position")) };
        if !assignment.is_near(Some(position)) {
            let away_m = (position.xy() - assignment.start.xy()).norm();
            let most_m = assignment.radius_m();
            return refuse(format!("it is {away_m:.0} m from its start: expected at most {most_m} m"));
        }
        let needed = if vehicle.is_in_air() { assignment.low_battery } else { assignment.battery - BATTERY_SLACK };
        if let Some(battery) = vehicle.battery.filter(|battery| *battery < needed) {
            let [has, needed] = [battery, needed].map(|fraction| (100.0 * fraction).round());
            let purpose = if vehicle.is_in_air() { "fly on" } else { "take off" };
            return refuse(format!("its battery is at {has} %: at least {needed} % is needed to {purpose}"));
        }
        if vehicle.is_high() && !vehicle.is_in_air() {
            return Ok(Some("to be on the ground, at the altitude of its home"));
        }
        let missing = self.check_parameters(autopilot, assignment.own_system, now_s, orders)?;
        Ok(missing.or((!vehicle.has_reported_battery).then_some("to report its battery")))
    }

    /// Says which parameter is missing; `None` if none is.
    fn check_parameters(
        &mut self,
        autopilot: AutopilotKind,
        own_system: u8,
        now_s: f64,
        orders: &mut Vec<Order>,
    ) -> Result<Option<&'static str>, PreflightRefusal> {
        let Some(switch) = autopilot.dead_man_switch() else { return Ok(None) };
        let parameter = switch.parameter;
        if let Some(value) = self.dead_man.filter(|value| switch.effect(*value).is_none()) {
            let expected = switch.expected();
            return refuse(format!("{parameter} = {value}: when the bridge is silent, expected {expected}"));
        }
        let condition = autopilot.condition();
        if let (Some(condition), Some(value)) = (condition, self.condition)
            && let Some(why) = (condition.refusal)(value, own_system)
        {
            return refuse(format!("{} = {value}: {why}", condition.parameters.join(" or ")));
        }
        if self.dead_man.is_some() {
            self.told_s.get_or_insert(now_s);
        }
        let awaited = condition.filter(|_| self.condition.is_none() && !self.is_patience_over(now_s));
        if now_s >= self.ask_s && (self.dead_man.is_none() || self.condition.is_none()) {
            self.ask_s = now_s + ASK_S;
            orders.extend(self.dead_man.is_none().then_some(Order::Parameter(parameter)));
            orders.extend(awaited.iter().flat_map(|condition| condition.parameters).map(|name| Order::Parameter(name)));
        }
        if self.dead_man.is_none() {
            return Ok(Some("to say what it does when the bridge is silent"));
        }
        Ok(awaited.map(|condition| condition.meaning))
    }

    fn is_patience_over(&self, now_s: f64) -> bool {
        self.told_s.is_some_and(|told_s| now_s - told_s >= OPTIONAL_S)
    }

    /// What was found, for people: what the vehicle does when the bridge is silent, and what could not be checked.
    pub fn findings(&self, vehicle: &VehicleState) -> Vec<String> {
        let mut lines = Vec::new();
        let switch = vehicle.autopilot.and_then(AutopilotKind::dead_man_switch);
        match switch.zip(self.dead_man) {
            Some((switch, value)) => {
                let effect = switch.effect(value).unwrap_or("is not known");
                lines.push(format!("{effect} when the bridge is silent ({} = {value})", switch.parameter));
            }
            None => lines.push("may stay in the air when the bridge is silent: its autopilot is not known".to_owned()),
        }
        if let Some(condition) =
            vehicle.autopilot.and_then(AutopilotKind::condition).filter(|_| self.condition.is_none())
        {
            lines.push(format!("does not tell {}: not checked", condition.parameters.join(" or ")));
        }
        if vehicle.battery.is_none() {
            lines.push("does not measure its battery: its charge is not checked".to_owned());
        }
        lines
    }
}

fn refuse<T>(message: String) -> Result<T, PreflightRefusal> {
    Err(PreflightRefusal(message))
}
