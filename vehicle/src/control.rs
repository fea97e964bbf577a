//! The bridge's side of one vehicle: gets it ready, takes off, flies it from target to target, and brings it home.
//!
//! Messages in, orders out. The clock is passed in, in seconds of the vehicle.

use nalgebra::{Point3, Vector3};
use skysink_flight_sim::outside::{ASTRAY_M, REACHED_M};

use crate::autopilot::ModeMeaning;
use crate::frame::AreaFrame;
use crate::outbox::Outbox;
use crate::preflight::{Assignment, Preflight, PreflightRefusal};
use crate::state::VehicleState;
use crate::telemetry::{ACCEPTED, Fix, GlobalTarget, Order, Telemetry};

/// Time between two attempts of an order that the vehicle refuses [s].
const RETRY_S: f64 = 1.0;

/// Time after which an accepted take-off or return that has no effect is ordered again [s]: longer than motors take to
/// spool up.
const REORDER_S: f64 = 6.0;

/// Altitude below that of the start at which a take-off is over [m].
const CLIMBED_M: f64 = 1.0;

/// Greatest speed of a vehicle that hovers [m/s].
const HOVER_MPS: f64 = 0.5;

/// What is said of a vehicle that others fly.
const TAKEN_OVER: &str = "has left the mode that follows orders: a pilot or a failsafe flies it";

/// The temporary refusal of MAVLink: the order may be accepted later.
const TEMPORARILY_REJECTED: u8 = 1;

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
    /// Flies home, or is flown by others.
    Returning,
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
    phase: Phase,
    outbox: Outbox,
    /// Whether it has refused its target.
    has_refused: bool,
    /// Whether it has been in the mode that follows orders since it was armed.
    has_followed: bool,
    /// Whether it has hovered at its start, or was in its mission before.
    has_begun: bool,
    /// Whether the bridge has ordered the return, and not a pilot or a failsafe.
    has_ordered_return: bool,
    /// When an order that was refused, or that has no effect, may be tried again [s].
    retry_s: f64,
    /// Its last line for people.
    text: String,
    /// Whether its last position was not believed.
    is_astray: bool,
    said: Vec<String>,
}

impl VehicleControl {
    /// A vehicle of which nothing is known yet.
    #[must_use]
    pub fn new(assignment: Assignment, frame: AreaFrame) -> Self {
        Self {
            vehicle: VehicleState::default(),
            assignment,
            frame,
            preflight: Preflight::default(),
            phase: Phase::Preflight,
            outbox: Outbox::default(),
            has_refused: false,
            has_followed: false,
            has_begun: false,
            has_ordered_return: false,
            retry_s: 0.0,
            text: String::new(),
            is_astray: false,
            said: Vec::new(),
        }
    }

    /// The phase of its mission.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Whether its mission has begun: it has hovered at its start.
    #[must_use]
    pub fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Whether it has refused to fly to its target.
    #[must_use]
    pub fn has_refused(&self) -> bool {
        self.has_refused
    }

    /// Where it is [m]; `None` if that was never known.
    #[must_use]
    pub fn position(&self) -> Option<Point3<f64>> {
        self.frame.position(self.vehicle.fix()?)
    }

    /// Whether it flies home, as far as it says so, or has landed.
    #[must_use]
    pub fn is_homebound(&self) -> bool {
        let is_confirmed = !self.outbox.has(&Order::Return) || self.vehicle.meaning() == ModeMeaning::Returns;
        self.phase == Phase::Landed || self.phase == Phase::Returning && is_confirmed
    }

    /// Takes the lines for people that have come up.
    pub fn take_said(&mut self) -> Vec<String> {
        std::mem::take(&mut self.said)
    }

    /// Takes in a message of the vehicle.
    pub fn hear(&mut self, telemetry: &Telemetry, now_s: f64) {
        if let Telemetry::Position(fix) = telemetry
            && !self.admit_fix(fix)
        {
            return;
        }
        self.vehicle.hear(telemetry, now_s);
        match telemetry {
            Telemetry::Answer { command, result } => self.hear_answer(*command, *result, now_s),
            Telemetry::Text(text) if *text == self.text => {} // ArduPilot repeats them
            Telemetry::Text(text) => {
                self.said.push(format!("says: {text}"));
                self.text.clone_from(text);
            }
            Telemetry::Parameter { name, value } => {
                let switch = self.vehicle.autopilot.and_then(|autopilot| autopilot.dead_man_switch());
                if switch == Some(name) {
                    self.preflight.hear_dead_man_switch(*value);
                }
            }
            _ => {}
        }
    }

    /// Notes, and says, whether a vehicle that was checked can be at `fix`.
    fn admit_fix(&mut self, fix: &Fix) -> bool {
        let away_m = self.frame.position(fix).map(|at| (at - self.assignment.start).norm());
        let was_astray = self.is_astray;
        self.is_astray = self.phase != Phase::Preflight && !away_m.is_some_and(|away_m| away_m <= ASTRAY_M);
        if self.is_astray && !was_astray {
            let Fix { lat_deg, lon_deg, .. } = fix;
            let km = ASTRAY_M / 1e3;
            self.said.push(format!("is not believed to be at {lat_deg}, {lon_deg}: more than {km} km from its start"));
        }
        !self.is_astray
    }

    fn hear_answer(&mut self, command: u16, result: u8, now_s: f64) {
        let Some(order) = self.outbox.answer(command, result) else { return };
        if result == ACCEPTED {
            if matches!(order, Order::TakeOff(_) | Order::Return) {
                self.retry_s = now_s + REORDER_S;
            }
            return;
        }
        self.retry_s = now_s + RETRY_S;
        match order {
            Order::Return => self.outbox.send(order, self.retry_s),
            Order::Reposition { .. } if result == TEMPORARILY_REJECTED => self.outbox.send(order, self.retry_s),
            Order::Reposition { .. } => {
                self.has_refused = true;
                self.said.push(format!("refuses its waypoint: MAVLink result {result}"));
            }
            Order::Speed(speed_mps) => self.said.push(format!("keeps its own speed, not {speed_mps} m/s")),
            _ => {} // tried again
        }
    }

    /// Advances to `now_s` [s]; adds the orders that are due to `orders`.
    ///
    /// # Errors
    /// If the vehicle must not take off.
    pub fn poll(&mut self, now_s: f64, orders: &mut Vec<Order>) -> Result<(), PreflightRefusal> {
        orders.extend(self.vehicle.requests(now_s));
        match self.phase {
            Phase::Preflight => self.check(now_s, orders)?,
            Phase::Arming => self.arm(now_s),
            Phase::TakeOff => self.climb(now_s),
            Phase::Flying => self.watch(now_s),
            Phase::Returning => self.come_home(now_s),
            Phase::Landed => {}
        }
        orders.extend(self.outbox.due(now_s));
        Ok(())
    }

    /// Checks whether the vehicle may take off, or is in the air already.
    fn check(&mut self, now_s: f64, orders: &mut Vec<Order>) -> Result<(), PreflightRefusal> {
        let position = self.position().filter(|_| self.vehicle.has_current_fix(now_s));
        if self.vehicle.is_in_air() && position.is_some() {
            match self.vehicle.meaning() {
                ModeMeaning::FollowsOrders | ModeMeaning::Unknown => {
                    self.said.push("is in the air: flying on".to_owned());
                    self.fly(now_s);
                }
                _ if self.assignment.is_restart => self.give_up("is flown by others"),
                _ => self.say_waiting("to be on the ground, or in the mode that follows orders", now_s),
            }
            return Ok(());
        }
        if self.assignment.is_restart && position.is_some() && self.vehicle.autopilot.is_some() {
            self.give_up("is on the ground in the middle of the mission");
            return Ok(());
        }
        match self.preflight.check(&self.vehicle, position, &self.assignment, now_s, orders)? {
            Some(missing) => self.say_waiting(missing, now_s),
            None => {
                self.said.push("is checked: arming".to_owned());
                self.phase = Phase::Arming;
                self.retry_s = now_s;
            }
        }
        Ok(())
    }

    fn say_waiting(&mut self, missing: &str, now_s: f64) {
        if self.preflight.is_line_due(now_s) {
            self.said.push(format!("waiting for it {missing}"));
        }
    }

    /// Arms in the mode that follows orders.
    fn arm(&mut self, now_s: f64) {
        let guided = self.vehicle.autopilot.and_then(|autopilot| autopilot.guided_mode());
        let must_change = guided.filter(|&mode| mode != self.vehicle.mode());
        if self.vehicle.is_armed && must_change.is_none() {
            self.outbox.clear();
            self.phase = Phase::TakeOff;
            self.has_followed = false;
            self.retry_s = now_s;
            return;
        }
        let order = must_change.map_or(Order::Arm, Order::Mode);
        if now_s >= self.retry_s && !self.outbox.has(&order) {
            self.retry_s = now_s + RETRY_S;
            self.outbox.send(order, now_s);
        }
    }

    /// Takes off, until the altitude of the start is reached.
    fn climb(&mut self, now_s: f64) {
        let Some(fix) = self.vehicle.fix() else { return };
        let altitude_m = self.assignment.start.z;
        self.has_followed |= self.vehicle.meaning() == ModeMeaning::FollowsOrders;
        if self.vehicle.is_armed && self.has_followed && self.is_taken_over() {
            self.give_up(TAKEN_OVER);
        } else if fix.above_home_m > altitude_m - CLIMBED_M {
            self.said.push(format!("has taken off to {:.1} m", fix.above_home_m));
            self.fly(now_s);
        } else if !self.vehicle.is_armed {
            self.outbox.clear();
            self.phase = Phase::Arming; // disarmed by itself
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
    fn fly(&mut self, now_s: f64) {
        self.outbox.clear();
        self.phase = Phase::Flying;
        self.outbox.send(Order::Speed(self.assignment.speed_mps), now_s);
        if self.assignment.is_restart {
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
        let altitude = autopilot.altitude(target.z, fix.above_sea_m - fix.above_home_m);
        let to = GlobalTarget { lat_deg: place.lat_deg, lon_deg: place.lon_deg, altitude };
        let order = Order::Reposition { to, may_change_mode: autopilot.needs_mode_change() };
        self.outbox.send(order, now_s);
    }

    /// Notices the arrival at the start, and whoever takes the vehicle out of the bridge's hands.
    fn watch(&mut self, now_s: f64) {
        if !self.vehicle.is_armed {
            self.said.push("has disarmed: its mission is over".to_owned());
            self.outbox.clear();
            self.phase = Phase::Landed;
        } else if self.is_taken_over() {
            self.give_up(TAKEN_OVER);
        } else if !self.has_begun && self.hovers_at(self.assignment.start, now_s) {
            self.has_begun = true;
            self.said.push("hovers at its start".to_owned());
        }
    }

    /// Whether it is in a mode of a pilot, a mission or a failsafe.
    fn is_taken_over(&self) -> bool {
        matches!(self.vehicle.meaning(), ModeMeaning::Returns | ModeMeaning::IsFlownByOthers)
    }

    fn hovers_at(&self, place: Point3<f64>, now_s: f64) -> bool {
        let is_near = self.position().is_some_and(|at| (at - place).norm() <= REACHED_M);
        let is_slow = self.vehicle.fix().is_some_and(|fix| Vector3::from(fix.velocity_mps).norm() <= HOVER_MPS);
        is_near && is_slow && self.vehicle.has_current_fix(now_s)
    }

    /// Leaves the vehicle to whoever flies it.
    fn give_up(&mut self, why: &str) {
        self.said.push(format!("{why} (mode {}): the bridge gives no more orders", self.vehicle.mode()));
        self.outbox.clear();
        self.phase = Phase::Returning;
        self.has_ordered_return = false;
    }

    /// Ends its mission, because of `why`: it flies home, or does not take off.
    pub fn return_home(&mut self, why: &str, now_s: f64) {
        match self.phase {
            Phase::Returning | Phase::Landed => return,
            Phase::Preflight | Phase::Arming if !self.vehicle.is_in_air() => self.phase = Phase::Landed,
            _ => {
                self.phase = Phase::Returning;
                self.has_ordered_return = true;
                self.said.push(format!("returns: {why}"));
            }
        }
        self.outbox.clear();
        if self.phase == Phase::Returning {
            self.outbox.send(Order::Return, now_s);
        }
    }

    /// Notices the landing; orders the return again if it has no effect.
    fn come_home(&mut self, now_s: f64) {
        if !self.vehicle.is_armed {
            self.said.push("has landed".to_owned());
            self.outbox.clear();
            self.phase = Phase::Landed;
            return;
        }
        let is_ignored = self.vehicle.meaning() == ModeMeaning::FollowsOrders && !self.outbox.has(&Order::Return);
        if self.has_ordered_return && is_ignored && now_s >= self.retry_s {
            self.outbox.send(Order::Return, now_s);
        }
    }
}
