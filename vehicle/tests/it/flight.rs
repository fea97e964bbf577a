//! A bridge and its vehicle in a loop, without sockets, clocks and processes.

use std::collections::VecDeque;

use mavlink::dialects::common::MavResult;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, Mode, Plan, SensorNode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::slot_record::ByUav;
use skysink_kinematic_vehicle::KinematicOptions;
use skysink_kinematic_vehicle::autopilot::{Copter, CopterMode, Given};
use skysink_vehicle::autopilot::{Altitude, AutopilotKind};
use skysink_vehicle::bridge::{Bridge, VehicleRefusal, start};
use skysink_vehicle::frame::AreaFrame;
use skysink_vehicle::preflight::Beginning;
use skysink_vehicle::telemetry::{Fix, Order, Stream, Telemetry};

pub const HOME: Origin = Origin { lat_deg: 47.3977, lon_deg: 8.5456 };

pub const RESTARTED: Beginning = Beginning::Restarted { in_mission: true };

/// Step of the vehicle [s].
pub const STEP_S: f64 = 0.02;

/// A bridge and its vehicle, which stands at the start of the mission.
pub struct ClosedLoop {
    pub bridge: Bridge,
    pub copter: Copter,
    pub random: ChaCha8Rng,
    pub loss: f64,
    /// Probability of an answer to be lost, and how late the others come [s].
    pub answer_loss: f64,
    pub answer_delay_s: f64,
    /// The answers on their way, and when they come [s].
    answers: VecDeque<(f64, Telemetry)>,
    pub autopilot: AutopilotKind,
    pub now_s: f64,
    pub steps: u64,
    pub is_bridge_alive: bool,
    /// Until then it says that it stands on the ground [s].
    pub says_on_ground_until_s: f64,
    pub said: Vec<String>,
    /// Take-offs that were ordered.
    pub take_offs: u32,
    pub reports: ByUav<FlightReport>,
    /// How often the parameter of the dead-man switch was asked for.
    pub questions: u32,
    /// When orders other than for telemetry were given [s], and what.
    pub orders: Vec<(f64, Order)>,
    /// Period of its heartbeats [s], and whether it keeps it, whatever it is asked for.
    pub heartbeat_s: f64,
    pub is_deaf: bool,
    /// Whether PX4 follows a reposition only if that may change its mode, as newer releases do.
    pub must_change_mode: bool,
    /// The mode that its pilot chooses just before the next reposition arrives.
    pub crossing: Option<CopterMode>,
    /// Period of reports of the mode alone [s], if it sends any.
    pub mode_s: Option<f64>,
    /// What it says while its link is frozen.
    pub frozen: Option<Vec<Telemetry>>,
    /// What it says of its battery, unless it says its charge.
    pub says_battery: Option<Telemetry>,
    /// Whether it says that it is disarmed in its next heartbeat, whatever it is.
    pub is_odd: bool,
    /// How far north of where it is it says that it is [m].
    pub jump_m: f64,
    pub says_no_position: bool,
    pub refusal: Option<VehicleRefusal>,
    /// A command that it refuses.
    pub refused: Option<u16>,
    /// The parameter of the dead-man switch; `None` if the vehicle does not tell it.
    pub dead_man: Option<f32>,
    /// That of what its switch depends on; `None` if it does not tell it.
    pub condition: Option<f32>,
    pub start_m: Position,
}

/// The mission, with these keys.
pub fn scenario(keys: &str) -> Scenario {
    let text = "name = 'x'\nslots = 20\nslot_s = 6.0\narea.side_m = 100.0\narea.origin_lat_deg = 47.3977\n\
                area.origin_lon_deg = 8.5456\nlink.comm_radius_m = 10.0\nuav.max_speed_mps = 10.0\nuav.acceleration_mps2 = 2.0\n";
    Scenario::parse(&format!("{text}{keys}"), std::path::Path::new("x.toml"), Overrides::default()).unwrap()
}

impl ClosedLoop {
    pub fn new(options: &KinematicOptions, loss: f64) -> Self {
        Self::over(&scenario(""), options, loss)
    }

    pub fn over(scenario: &Scenario, options: &KinematicOptions, loss: f64) -> Self {
        let reports = start(scenario);
        Self::after(scenario, options, loss, reports, Beginning::New)
    }

    /// With a bridge that begins after the slot of `reports`.
    pub fn after(
        scenario: &Scenario,
        options: &KinematicOptions,
        loss: f64,
        reports: ByUav<FlightReport>,
        beginning: Beginning,
    ) -> Self {
        let sensors = [SensorNode { x_m: 50.0, y_m: 60.0, gain: 1e-5, ..SensorNode::default() }];
        Self {
            bridge: Bridge::new(scenario, &sensors, AreaFrame::at(HOME), &reports, beginning, &[255]),
            copter: Copter::new(options),
            random: ChaCha8Rng::seed_from_u64(options.seed),
            loss,
            answer_loss: 0.0,
            answer_delay_s: 0.0,
            answers: VecDeque::new(),
            autopilot: AutopilotKind::ArduPilot,
            now_s: 0.0,
            steps: 0,
            is_bridge_alive: true,
            says_on_ground_until_s: 0.0,
            said: Vec::new(),
            take_offs: 0,
            questions: 0,
            orders: Vec::new(),
            heartbeat_s: 1.0,
            is_deaf: false,
            must_change_mode: true,
            crossing: None,
            mode_s: None,
            frozen: None,
            says_battery: None,
            is_odd: false,
            jump_m: 0.0,
            says_no_position: false,
            refusal: None,
            refused: None,
            start_m: reports[0].position().xy(),
            reports,
            dead_man: Some(f32::from(options.dead_man)),
            condition: None,
        }
    }

    /// Makes it a vehicle of this autopilot, which returns when the bridge is silent.
    pub fn is_a(&mut self, autopilot: AutopilotKind) {
        self.autopilot = autopilot;
        self.dead_man = Some(if autopilot == AutopilotKind::Px4 { 2.0 } else { 1.0 });
    }

    /// The vehicle's home: 3 m beside the start.
    pub fn home_m(&self) -> Position {
        Position::new(self.start_m.x + 3.0, self.start_m.y)
    }

    pub fn is_lost(&mut self) -> bool {
        self.random.random::<f64>() < self.loss
    }

    pub fn hear(&mut self, telemetry: &Telemetry) {
        if self.is_lost() || !self.is_bridge_alive {
            return;
        }
        match &mut self.frozen {
            Some(waiting) => waiting.push(telemetry.clone()),
            None => self.bridge.hear(0, telemetry, self.now_s),
        }
    }

    /// Lets the link go on: what has waited comes in two parts.
    pub fn thaw(&mut self) {
        let waiting = self.frozen.take().unwrap_or_default();
        for part in waiting.chunks(waiting.len().div_ceil(2).max(1)) {
            part.iter().for_each(|telemetry| self.bridge.hear(0, telemetry, self.now_s));
            self.step();
        }
    }

    pub fn fix(&self) -> Telemetry {
        let position_m = self.copter.body.position_m;
        let at_m = self.home_m() + position_m.xy() + nalgebra::Vector2::new(0.0, self.jump_m);
        let place = Projection::at(HOME).unproject(&at_m).unwrap();
        Telemetry::Position(Fix {
            lat_deg: place.lat_deg,
            lon_deg: place.lon_deg,
            above_home_m: position_m.z,
            above_sea_m: position_m.z + 488.0,
            velocity_mps: self.copter.body.measured_mps().into(),
            heading_deg: f64::INFINITY,
            boot_s: self.copter.boot_s,
        })
    }

    /// The altitude of an order [m], which has to be measured as the autopilot does.
    pub fn above_home_m(&self, altitude: Altitude) -> f64 {
        match (self.autopilot, altitude) {
            (AutopilotKind::Px4, Altitude::AboveSea(z_m)) => z_m - 488.0,
            (AutopilotKind::ArduPilot | AutopilotKind::Other, Altitude::AboveHome(z_m)) => z_m,
            other => panic!("{other:?}"),
        }
    }

    /// The number of the vehicle's mode.
    pub fn mode(&self) -> u32 {
        match (self.autopilot, self.copter.mode) {
            (AutopilotKind::Px4, CopterMode::Stabilize) => 7 << 16,
            (AutopilotKind::Px4, CopterMode::Loiter) => 3 << 16,
            (AutopilotKind::Px4, CopterMode::Guided) => 4 << 16 | 3 << 24,
            (AutopilotKind::Px4, CopterMode::Return) => 4 << 16 | 5 << 24,
            (AutopilotKind::Px4, CopterMode::Land) => 4 << 16 | 6 << 24,
            (_, mode) => mode as u32,
        }
    }

    pub fn given(&self, order: &Order) -> Option<Given> {
        Some(match *order {
            Order::Mode(mode) => Given::Mode(mode),
            Order::Arm => Given::Arm,
            Order::TakeOff(altitude) => Given::TakeOff(self.above_home_m(altitude)),
            Order::Speed(mps) => Given::Speed(mps),
            Order::Return => Given::Return,
            Order::Reposition { to, .. } => {
                let place = Projection::at(HOME).project(to.lat_deg, to.lon_deg)? - self.home_m();
                Given::Reposition(place.push(self.above_home_m(to.altitude)))
            }
            _ => return None,
        })
    }

    pub fn obey(&mut self, order: &Order) {
        if self.is_lost() {
            return;
        }
        self.take_offs += u32::from(matches!(order, Order::TakeOff(_)));
        if let Order::Interval { stream: Stream::Heartbeat, period_s } = order
            && !self.is_deaf
        {
            self.heartbeat_s = *period_s;
        } else if let Order::Parameter(name) = order {
            let is_switch = self.autopilot.dead_man_switch().is_some_and(|switch| switch.parameter == *name);
            self.questions += u32::from(is_switch);
            if let Some(value) = if is_switch { self.dead_man } else { self.condition } {
                self.hear(&Telemetry::Parameter { name: (*name).to_owned(), value, is_integer: false });
            }
        } else if let (Some(given), Some(command)) = (self.given(order), order.command()) {
            if let Some(mode) = self.crossing.take_if(|_| matches!(order, Order::Reposition { .. })) {
                self.copter.change_to(mode);
            }
            let changes_mode = matches!(order, Order::TakeOff(_) | Order::Reposition { may_change_mode: true, .. });
            if self.autopilot != AutopilotKind::ArduPilot && changes_mode && self.copter.is_armed {
                self.copter.mode = CopterMode::Guided;
            }
            let is_unsupported = self.autopilot == AutopilotKind::Px4
                && self.must_change_mode
                && matches!(order, Order::Reposition { may_change_mode: false, .. });
            let result = if is_unsupported {
                MavResult::MAV_RESULT_UNSUPPORTED
            } else if self.refused == Some(command) {
                MavResult::MAV_RESULT_FAILED
            } else {
                self.copter.obey(given)
            } as u8;
            if self.random.random::<f64>() >= self.answer_loss {
                self.answers.push_back((self.now_s + self.answer_delay_s, Telemetry::Answer { command, result }));
            }
            self.hear_answers();
        }
    }

    /// The answers that have arrived by now.
    fn hear_answers(&mut self) {
        while let Some((_, answer)) = self.answers.pop_front_if(|(at_s, _)| *at_s <= self.now_s) {
            self.hear(&answer);
        }
    }

    pub fn step(&mut self) {
        self.steps += 1;
        self.now_s += STEP_S;
        self.hear_answers();
        self.copter.step(STEP_S, &mut self.random);
        if self.steps.is_multiple_of((self.heartbeat_s / STEP_S).round() as u64) {
            let is_armed = self.copter.is_armed && !std::mem::take(&mut self.is_odd);
            let mode = self.mode();
            self.hear(&Telemetry::Heartbeat { autopilot: self.autopilot, mode, is_armed, is_booting: false });
        }
        if self.mode_s.is_some_and(|mode_s| self.steps.is_multiple_of((mode_s / STEP_S).round() as u64)) {
            self.hear(&Telemetry::Mode(self.mode()));
        }
        if self.steps.is_multiple_of(50) {
            let is_in_air = self.copter.is_in_air() && self.now_s > self.says_on_ground_until_s;
            self.hear(&Telemetry::InAir(is_in_air));
            let battery = Telemetry::Battery(Some(self.copter.battery));
            let battery = self.says_battery.clone().unwrap_or(battery);
            self.hear(&battery);
        }
        if self.steps.is_multiple_of(12) && self.is_bridge_alive && !self.is_lost() {
            self.copter.hear_bridge(); // about four times in a second
        }
        if self.steps.is_multiple_of(5) && !self.says_no_position {
            let fix = self.fix();
            self.hear(&fix);
        }
        if self.is_bridge_alive {
            let mut orders = Vec::new();
            let said = &mut self.said;
            let polled = self.bridge.poll(self.now_s, |_, order| orders.push(*order), |_, line| said.push(line));
            self.refusal = self.refusal.take().or(polled.err());
            let given = orders.iter().filter(|order| order.command().is_some());
            self.orders.extend(given.map(|order| (self.now_s, *order)));
            orders.iter().for_each(|order| self.obey(order));
        }
    }

    pub fn advance(&mut self, seconds: f64) {
        (0..(seconds / STEP_S) as u32).for_each(|_| self.step());
    }

    pub fn until(&mut self, limit_s: f64, is_so: impl Fn(&Self) -> bool) {
        let end_s = self.now_s + limit_s;
        while !is_so(self) {
            assert!(self.now_s < end_s, "not within {limit_s} s: {:?}, {:?}", self.copter, self.said);
            self.step();
        }
    }

    pub fn fly_slot(&mut self, slot: u64, plan: Option<Plan>) -> FlightReport {
        self.fly_slot_of(6.0, slot, plan)
    }

    pub fn fly_slot_of(&mut self, seconds: f64, slot: u64, plan: Option<Plan>) -> FlightReport {
        self.bridge.await_plan();
        self.bridge.begin(slot, 0.0);
        if let Some(plan) = plan {
            self.bridge.fly(&[plan], self.now_s);
        }
        self.advance(seconds);
        self.bridge.end(slot, &mut self.reports, self.now_s);
        self.reports[0]
    }
}

pub fn plan(x_m: f64, y_m: f64) -> Plan {
    let mut plan = Plan::fly_to([x_m, y_m, 20.0], Mode::Serve);
    plan.schedule(&[0]);
    plan
}
