//! The checks before take-off: position, battery, dead-man switch, and the distance to the start.

use nalgebra::Point3;

use crate::state::VehicleState;
use crate::telemetry::Order;

/// Time between two questions for a parameter [s].
const ASK_S: f64 = 1.0;

/// Time before the first line on what is missing, and between two [s].
const FIRST_LINE_S: f64 = 3.0;
const LINE_S: f64 = 10.0;

/// How far below the expected energy a battery may be, as a fraction of its capacity: what it says is rounded.
const BATTERY_SLACK: f64 = 0.05;

/// Farthest from its start at which a vehicle may take off [m].
const TAKE_OFF_RADIUS_M: f64 = 500.0;

/// What a vehicle has to do.
#[derive(Debug, Clone, Copy)]
pub struct Assignment {
    /// Where its mission begins [m].
    pub start: Point3<f64>,
    /// Its speed over ground [m/s].
    pub speed_mps: f64,
    /// Energy that its battery has to have before take-off, as a fraction of its capacity.
    pub battery: f64,
    /// Whether the bridge was restarted: a vehicle in the air is in its mission.
    pub is_restart: bool,
}

/// A vehicle that must not take off. Its `Display` is one line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PreflightRefusal(pub String);

/// What is known before take-off.
#[derive(Debug, Clone, Default)]
pub struct Preflight {
    /// The parameter of the dead-man switch.
    dead_man: Option<f32>,
    /// When it is asked for next [s].
    ask_s: f64,
    /// When the next line on what is missing is due [s].
    line_s: Option<f64>,
}

impl Preflight {
    /// Takes in the parameter of the dead-man switch.
    pub fn hear_dead_man_switch(&mut self, value: f32) {
        self.dead_man = Some(value);
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

    /// Says what is still missing, in words after "waiting for it"; `None` if the vehicle may take off from `position`
    /// [m]. Adds a question for a parameter to `orders`.
    ///
    /// # Errors
    /// If it must not take off.
    pub fn check(
        &mut self,
        vehicle: &VehicleState,
        position: Option<Point3<f64>>,
        assignment: &Assignment,
        now_s: f64,
        orders: &mut Vec<Order>,
    ) -> Result<Option<&'static str>, PreflightRefusal> {
        let Some(autopilot) = vehicle.autopilot else { return Ok(Some("to send heartbeats")) };
        let Some(position) = position else { return Ok(Some("to know its position")) };
        let away_m = (position.xy() - assignment.start.xy()).norm();
        if away_m > TAKE_OFF_RADIUS_M {
            return refuse(format!("it is {away_m:.0} m from its start: expected at most {TAKE_OFF_RADIUS_M} m"));
        }
        if let Some(battery) = vehicle.battery.filter(|battery| *battery < assignment.battery - BATTERY_SLACK) {
            let [has, needs] = [battery, assignment.battery].map(|fraction| (100.0 * fraction).round());
            return refuse(format!("its battery is at {has} %: expected {needs} %"));
        }
        let Some(switch) = autopilot.dead_man_switch() else { return Ok(None) };
        match self.dead_man {
            Some(0.0) => refuse(format!(
                "{switch} = 0: expected a value with which it returns when the bridge is silent, such as 1 of ArduPilot, 2 of PX4"
            )),
            Some(_) => Ok(None),
            None => {
                if now_s >= self.ask_s {
                    self.ask_s = now_s + ASK_S;
                    orders.push(Order::Parameter(switch));
                }
                Ok(Some("to say what it does when the bridge is silent"))
            }
        }
    }
}

fn refuse<T>(message: String) -> Result<T, PreflightRefusal> {
    Err(PreflightRefusal(message))
}
