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
use skysink_kinematic_vehicle::options::Imitated;
use skysink_vehicle::autopilot::{Altitude, AutopilotKind, ModeMeaning, NamedModes};
use skysink_vehicle::bridge::{Beginning, Bridge, OwnSide, VehicleRefusal, start};
use skysink_vehicle::frame::AreaFrame;
use skysink_vehicle::saved::SavedVehicle;
use skysink_vehicle::table::State;
use skysink_vehicle::telemetry::{Fix, Order, Stream, Telemetry};

pub const HOME: Origin = Origin { lat_deg: 47.3977, lon_deg: 8.5456 };

/// Altitude of home above sea [m].
pub const HOME_M: f64 = 488.0;

pub const RESTARTED: Beginning = Beginning::Restarted { in_mission: true };
pub const BEFORE_SLOT: Beginning = Beginning::Restarted { in_mission: false };

pub const KINDS: [AutopilotKind; 2] = [AutopilotKind::ArduPilot, AutopilotKind::Px4];

/// Step of the vehicle [s].
pub const STEP_S: f64 = 0.02;

/// A bridge and its vehicle, which stands 3 m beside the start of the mission, as its operator has left it: in the mode
/// that follows commands.
pub struct ClosedLoop {
    pub bridge: Bridge,
    pub copter: Copter,
    pub random: ChaCha8Rng,
    /// Probabilities of a message to be lost and to come twice, and how late it comes [s], in each direction.
    pub loss: f64,
    pub copies: f64,
    pub delay_s: f64,
    /// Probability of an answer to be lost, and how late the others come, beside that [s].
    pub answer_loss: f64,
    pub answer_delay_s: f64,
    /// What is on its way, and when it comes [s].
    to_bridge: VecDeque<(f64, Telemetry)>,
    to_vehicle: VecDeque<(f64, Order)>,
    pub autopilot: AutopilotKind,
    pub now_s: f64,
    pub steps: u64,
    pub is_bridge_alive: bool,
    pub said: Vec<String>,
    pub reports: ByUav<FlightReport>,
    /// How often the parameter of the GCS failsafe was asked for.
    pub questions: u32,
    /// When orders other than for telemetry were given [s], and what.
    pub orders: Vec<(f64, Order)>,
    /// Those that have arrived.
    pub arrived: Vec<(f64, Order)>,
    /// Period of its heartbeats [s], and whether it keeps it, whatever it is asked for.
    pub heartbeat_s: f64,
    pub is_deaf: bool,
    /// The last mode that PX4 has said.
    said_mode: u32,
    /// The mode that its pilot chooses just before the next reposition arrives.
    pub crossing: Option<CopterMode>,
    /// What it says while its link is frozen.
    pub frozen: Option<Vec<Telemetry>>,
    /// What it says of its battery, unless it says its charge.
    pub says_battery: Option<Telemetry>,
    /// Whether it says that it is disarmed in its next heartbeat, whatever it is.
    pub is_odd: bool,
    /// Whether it says that a failsafe of it acts.
    pub is_critical: bool,
    /// How far north of where it is it says that it is [m].
    pub jump_m: f64,
    /// How much its altitude above home is wrong [m].
    pub drift_m: f64,
    pub says_no_position: bool,
    /// Whether it does not say whether it is in the air.
    pub is_silent_of_ground: bool,
    /// Whether it says neither its mode nor whether it is armed.
    pub says_no_mode: bool,
    /// Whether it stays armed on the ground.
    pub stays_armed: bool,
    /// Whether it accepts waypoints, and does not fly there.
    pub ignores_waypoints: bool,
    pub refusal: Option<VehicleRefusal>,
    /// A command that it refuses.
    pub refused: Option<u16>,
    /// A command that is lost.
    pub lost: Option<u16>,
    /// The parameter of the GCS failsafe; `None` if the vehicle does not tell it.
    pub gcs_failsafe: Option<f32>,
    /// That of what its failsafe depends on; `None` if it does not tell it.
    pub condition: Option<f32>,
    pub start_m: Position,
}

/// The mission, with these keys.
pub fn scenario(keys: &str) -> Scenario {
    let text = "name = 'x'\nslots = 20\nslot_s = 6.0\narea.side_m = 100.0\narea.origin_lat_deg = 47.3977\n\
                area.origin_lon_deg = 8.5456\nlink.comm_radius_m = 10.0\nuav.max_speed_mps = 10.0\nuav.acceleration_mps2 = 2.0\n";
    Scenario::parse(&format!("{text}{keys}"), std::path::Path::new("x.toml"), Overrides::default()).unwrap()
}

/// The sides of a bridge on the links to its vehicles; of an unknown autopilot, ArduCopter's modes are named.
pub fn own(uavs: usize) -> Vec<OwnSide> {
    let modes = NamedModes(vec![(ModeMeaning::Follows, 4), (ModeMeaning::Returns, 6), (ModeMeaning::Returns, 9)]);
    vec![OwnSide { system: 255, modes }; uavs]
}

pub fn options_of(autopilot: AutopilotKind) -> KinematicOptions {
    let imitated = if autopilot == AutopilotKind::Px4 { Imitated::Px4 } else { Imitated::Arducopter };
    KinematicOptions { autopilot: imitated, ..KinematicOptions::default() }
}

/// A vehicle of this autopilot that says its mode once a second, whatever it is asked for.
pub fn flight_over(autopilot: AutopilotKind) -> ClosedLoop {
    let mut flight = ClosedLoop::new(&options_of(autopilot), 0.0);
    flight.autopilot = autopilot;
    flight.is_deaf = true;
    flight
}

pub fn hovering(autopilot: AutopilotKind) -> ClosedLoop {
    let mut flight = flight_over(autopilot);
    flight.until(90.0, |flight| flight.bridge.has_begun());
    flight
}

pub fn count(flight: &ClosedLoop, words: &str) -> usize {
    flight.said.iter().filter(|line| line.contains(words)).count()
}

/// Number of commands to arm and to take off that were given.
pub fn arms(flight: &ClosedLoop) -> usize {
    flight.orders.iter().filter(|(_, order)| *order == Order::Arm).count()
}
pub fn take_offs(flight: &ClosedLoop) -> usize {
    flight.orders.iter().filter(|(_, order)| matches!(order, Order::TakeOff(_))).count()
}

/// Whether an order could overrule a pilot.
pub fn may_overrule(order: &Order) -> bool {
    matches!(order, Order::Arm | Order::TakeOff(_) | Order::Return)
}

/// Flies on for some slots; no order comes, and the pilot override is said once.
pub fn assert_left_alone(flight: &mut ClosedLoop, what: &str) {
    let since_s = flight.now_s;
    flight.advance(2.5); // two heartbeats
    for slot in 1..=6 {
        let report = flight.fly_slot(slot, Some(plan(50.0, 60.0 + slot as f64)));
        assert!([Mode::Return, Mode::Down].contains(&report.flown_mode()), "{what}: {report:?}, {:?}", flight.said);
    }
    flight.bridge.return_home("the mission is over");
    flight.advance(10.0);
    let late: Vec<_> = flight.orders.iter().filter(|(at_s, _)| *at_s > since_s).collect();
    assert!(late.iter().all(|(at_s, order)| !may_overrule(order) && *at_s < since_s + 2.5), "{what}: {late:?}");
    let ends = ["is overridden: ", "is left alone: ", "its mission is over: "];
    assert_eq!(ends.map(|words| count(flight, words)).iter().sum::<usize>(), 1, "{what}: {:?}", flight.said);
}

impl ClosedLoop {
    pub fn new(options: &KinematicOptions, loss: f64) -> Self {
        Self::over(&scenario(""), options, loss)
    }

    pub fn over(scenario: &Scenario, options: &KinematicOptions, loss: f64) -> Self {
        let reports = start(scenario);
        Self::after(scenario, options, loss, reports, Beginning::First, &[])
    }

    /// With a bridge that begins after the slot of `reports`, with what was `saved`.
    pub fn after(
        scenario: &Scenario,
        options: &KinematicOptions,
        loss: f64,
        reports: ByUav<FlightReport>,
        beginning: Beginning,
        saved: &[SavedVehicle],
    ) -> Self {
        Self {
            bridge: bridge(scenario, &reports, beginning, saved),
            copter: Copter::new(options),
            random: ChaCha8Rng::seed_from_u64(options.seed),
            loss,
            copies: 0.0,
            delay_s: 0.0,
            answer_loss: 0.0,
            answer_delay_s: 0.0,
            to_bridge: VecDeque::new(),
            to_vehicle: VecDeque::new(),
            autopilot: if options.is_px4() { AutopilotKind::Px4 } else { AutopilotKind::ArduPilot },
            now_s: 0.0,
            steps: 0,
            is_bridge_alive: true,
            said: Vec::new(),
            questions: 0,
            orders: Vec::new(),
            arrived: Vec::new(),
            heartbeat_s: 1.0,
            is_deaf: false,
            said_mode: u32::MAX,
            crossing: None,
            frozen: None,
            says_battery: None,
            is_odd: false,
            is_critical: false,
            jump_m: 0.0,
            drift_m: 0.0,
            is_silent_of_ground: false,
            says_no_position: false,
            says_no_mode: false,
            stays_armed: false,
            ignores_waypoints: false,
            refusal: None,
            refused: None,
            lost: None,
            start_m: reports[0].position().xy(),
            reports,
            gcs_failsafe: Some(f32::from(options.gcs_failsafe())),
            condition: None,
        }
    }

    /// The same flight under the next bridge, which knows what this one has saved.
    pub fn restart(&mut self, beginning: Beginning) {
        let saved = self.saved();
        let is_resumed = beginning == Beginning::First;
        let saved = saved.into_iter().map(|vehicle| if is_resumed { vehicle.resumed() } else { vehicle });
        self.restart_with(beginning, &saved.collect::<Vec<_>>());
    }

    pub fn restart_with(&mut self, beginning: Beginning, saved: &[SavedVehicle]) {
        self.bridge = bridge(&scenario(""), &self.reports, beginning, saved);
        self.to_bridge.clear();
        self.is_bridge_alive = true;
    }

    /// What the bridge has to save.
    pub fn saved(&self) -> Vec<SavedVehicle> {
        vec![SavedVehicle { was_flown: true, ..self.bridge.control(0).saved(None) }]
    }

    pub fn state(&self) -> State {
        self.bridge.control(0).state()
    }

    /// The vehicle's home: 3 m beside the start.
    pub fn home_m(&self) -> Position {
        Position::new(self.start_m.x + 3.0, self.start_m.y)
    }

    fn is_lost(&mut self) -> bool {
        self.random.random::<f64>() < self.loss
    }

    fn times(&mut self) -> usize {
        if self.is_lost() { 0 } else { 1 + usize::from(self.random.random::<f64>() < self.copies) }
    }

    /// Sends the bridge a message.
    pub fn hear(&mut self, telemetry: &Telemetry) {
        self.hear_late(telemetry, 0.0);
    }

    fn hear_late(&mut self, telemetry: &Telemetry, late_s: f64) {
        for copy in 0..self.times() {
            let at_s = self.now_s + self.delay_s + late_s + copy as f64 * self.random.random_range(0.0..0.3);
            self.to_bridge.push_back((at_s, telemetry.clone()));
        }
        self.deliver();
    }

    /// Hands over what has arrived.
    fn deliver(&mut self) {
        let now_s = self.now_s;
        let (due, waiting) = std::mem::take(&mut self.to_bridge).into_iter().partition(|(at_s, _)| *at_s <= now_s);
        self.to_bridge = waiting;
        let due: VecDeque<(f64, Telemetry)> = due;
        for (_, telemetry) in due {
            match &mut self.frozen {
                _ if !self.is_bridge_alive => {}
                Some(waiting) => waiting.push(telemetry),
                None => self.bridge.hear(0, &telemetry, now_s),
            }
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
            above_home_m: position_m.z + self.drift_m,
            above_sea_m: position_m.z + HOME_M,
            velocity_mps: self.copter.body.measured_mps().into(),
            heading_deg: f64::INFINITY,
            boot_s: self.copter.boot_s,
        })
    }

    /// The altitude of an order [m], which has to be measured as the autopilot does.
    pub fn above_home_m(&self, altitude: Altitude) -> f64 {
        match (self.autopilot, altitude) {
            (AutopilotKind::Px4, Altitude::AboveSea(z_m)) => z_m - HOME_M,
            (AutopilotKind::ArduPilot | AutopilotKind::Other, Altitude::AboveHome(z_m)) => z_m,
            other => panic!("{other:?}"),
        }
    }

    fn given(&self, order: &Order) -> Option<Given> {
        Some(match *order {
            Order::Arm => Given::Arm,
            Order::TakeOff(altitude) => Given::TakeOff(self.above_home_m(altitude)),
            Order::Speed(mps) => Given::Speed(mps),
            Order::Return => Given::Return,
            Order::Reposition { to, speed_mps } => {
                let place = Projection::at(HOME).project(to.lat_deg, to.lon_deg)? - self.home_m();
                Given::Reposition(place.push(self.above_home_m(to.altitude)), speed_mps)
            }
            _ => return None,
        })
    }

    fn obey(&mut self, order: &Order) {
        if let Order::Interval { stream: Stream::Heartbeat, period_s } = order
            && !self.is_deaf
            && self.autopilot != AutopilotKind::Px4
        {
            self.heartbeat_s = *period_s;
        } else if let Order::Parameter(name) = order {
            let is_switch = self.autopilot.gcs_failsafe().is_some_and(|failsafe| failsafe.parameter == *name);
            self.questions += u32::from(is_switch);
            if let Some(value) = if is_switch { self.gcs_failsafe } else { self.condition } {
                self.hear(&Telemetry::Parameter { name: (*name).to_owned(), value, is_integer: false });
            }
        } else if let (Some(given), Some(command)) = (self.given(order), order.command()) {
            if let Some(mode) = self.crossing.take_if(|_| matches!(order, Order::Reposition { .. })) {
                self.copter.change_to(mode);
            }
            self.arrived.push((self.now_s, *order));
            let result = if self.refused == Some(command) {
                MavResult::MAV_RESULT_FAILED
            } else if self.ignores_waypoints && matches!(order, Order::Reposition { .. }) {
                MavResult::MAV_RESULT_ACCEPTED
            } else {
                self.copter.obey(given)
            } as u8;
            if self.random.random::<f64>() >= self.answer_loss {
                self.hear_late(&Telemetry::Answer { command, result }, self.answer_delay_s);
            }
        }
    }

    /// Its heartbeat.
    pub fn heartbeat(&self, is_armed: bool) -> Telemetry {
        let mode = self.copter.mode_number();
        let is_critical = self.copter.is_critical() || self.is_critical;
        Telemetry::Heartbeat { autopilot: self.autopilot, mode, is_armed, is_critical }
    }

    fn every(&self, period_s: f64) -> bool {
        self.steps.is_multiple_of((period_s / STEP_S).round() as u64)
    }

    pub fn step(&mut self) {
        self.steps += 1;
        self.now_s += STEP_S;
        self.deliver();
        self.copter.step(STEP_S, &mut self.random);
        let mode = self.copter.mode_number();
        let is_px4 = self.autopilot == AutopilotKind::Px4;
        if is_px4 && !self.says_no_mode && (self.every(0.5) || mode != self.said_mode) {
            self.said_mode = mode;
            self.hear(&Telemetry::Mode(mode));
        }
        if self.every(self.heartbeat_s) && !self.says_no_mode {
            let is_armed = (self.copter.is_armed || self.stays_armed) && !std::mem::take(&mut self.is_odd);
            self.hear(&self.heartbeat(is_armed));
        }
        if self.every(1.0) {
            if !self.is_silent_of_ground {
                self.hear(&Telemetry::InAir(self.copter.is_in_air()));
            }
            let is_ready = Some(self.copter.is_ready());
            let battery = Telemetry::Status { left: Some(self.copter.battery), is_ready };
            self.hear(&self.says_battery.clone().unwrap_or(battery));
        }
        if self.every(0.24) && self.is_bridge_alive && self.is_heartbeat_sent() && !self.is_lost() {
            self.copter.hear_bridge(); // about four times in a second
        }
        if self.every(0.1) && !self.says_no_position {
            self.hear(&self.fix());
        }
        if self.is_bridge_alive {
            let mut orders = Vec::new();
            let said = &mut self.said;
            let polled = self.bridge.poll(self.now_s, |_, order| orders.push(*order), |_, line| said.push(line));
            self.refusal = self.refusal.take().or(polled.err());
            let given = orders.iter().filter(|order| order.command().is_some());
            self.orders.extend(given.map(|order| (self.now_s, *order)));
            for order in orders {
                let is_lost = order.command().is_some() && order.command() == self.lost;
                (0..self.times()).filter(|_| !is_lost).for_each(|copy| {
                    let at_s = self.now_s + self.delay_s + 0.1 * copy as f64;
                    self.to_vehicle.push_back((at_s, order));
                });
            }
        }
        let now_s = self.now_s;
        while let Some((_, order)) = self.to_vehicle.pop_front_if(|(at_s, _)| *at_s <= now_s) {
            self.obey(&order);
        }
    }

    fn is_heartbeat_sent(&self) -> bool {
        self.bridge.control(0).heartbeats(self.now_s) != skysink_vehicle::control::Heartbeats::Withheld
    }

    pub fn advance(&mut self, seconds: f64) {
        (0..(seconds / STEP_S).round() as u32).for_each(|_| self.step());
    }

    #[track_caller]
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

fn bridge(scenario: &Scenario, reports: &[FlightReport], beginning: Beginning, saved: &[SavedVehicle]) -> Bridge {
    let sensors = [SensorNode { x_m: 50.0, y_m: 60.0, gain: 1e-5, ..SensorNode::default() }];
    Bridge::new(scenario, &sensors, AreaFrame::at(HOME), reports, beginning, saved, &own(1))
}

pub fn plan(x_m: f64, y_m: f64) -> Plan {
    let mut plan = Plan::fly_to([x_m, y_m, 20.0], Mode::Serve);
    plan.schedule(&[0]);
    plan
}
