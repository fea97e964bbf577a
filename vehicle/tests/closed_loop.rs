//! The bridge and kinematic vehicles, without sockets, clocks and processes: messages are lost at random.

use mavlink::dialects::common::MavResult;
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use skysink_common::geodata::projection::{Origin, Projection};
use skysink_common::geometry::Position;
use skysink_common::message::{FlightReport, HoldReason, Mode, Plan, SensorNode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::slot_record::ByUav;
use skysink_flight_sim::outside::REACHED_M;
use skysink_vehicle::autopilot::{Altitude, AutopilotKind};
use skysink_vehicle::bridge::{Bridge, start};
use skysink_vehicle::frame::AreaFrame;
use skysink_vehicle::kinematic::KinematicOptions;
use skysink_vehicle::kinematic::autopilot::{Copter, CopterMode, Given};
use skysink_vehicle::telemetry::{Fix, Order, Telemetry};

const HOME: Origin = Origin { lat_deg: 47.3977, lon_deg: 8.5456 };

/// Step of the vehicle [s].
const STEP_S: f64 = 0.02;

/// A bridge and its vehicle, which stands at the start of the mission.
struct ClosedLoop {
    bridge: Bridge,
    copter: Copter,
    random: ChaCha8Rng,
    loss: f64,
    autopilot: AutopilotKind,
    now_s: f64,
    steps: u64,
    is_bridge_alive: bool,
    /// Until then it says that it stands on the ground [s].
    says_on_ground_until_s: f64,
    said: Vec<String>,
    /// Take-offs that were ordered.
    take_offs: u32,
    reports: ByUav<FlightReport>,
    /// Parameters that were asked for.
    questions: u32,
    /// A command that it refuses.
    refused: Option<u16>,
    /// The parameter of the dead-man switch; `None` if the vehicle does not tell it.
    dead_man: Option<f32>,
    start_m: Position,
}

/// The mission, with these keys.
fn scenario(keys: &str) -> Scenario {
    let text = "name = 'x'\nslots = 20\nslot_s = 6.0\narea.side_m = 100.0\narea.origin_lat_deg = 47.3977\n\
                area.origin_lon_deg = 8.5456\nlink.comm_radius_m = 10.0\nuav.max_speed_mps = 10.0\nuav.acceleration_mps2 = 2.0\n";
    Scenario::parse(&format!("{text}{keys}"), std::path::Path::new("x.toml"), Overrides::default()).unwrap()
}

impl ClosedLoop {
    fn new(options: &KinematicOptions, loss: f64) -> Self {
        Self::over(&scenario(""), options, loss)
    }

    fn over(scenario: &Scenario, options: &KinematicOptions, loss: f64) -> Self {
        let reports = start(scenario);
        Self::after(scenario, options, loss, reports, false)
    }

    /// With a bridge that begins after the slot of `reports`, as the successor of another one if `is_restart`.
    fn after(
        scenario: &Scenario,
        options: &KinematicOptions,
        loss: f64,
        reports: ByUav<FlightReport>,
        is_restart: bool,
    ) -> Self {
        let sensors = [SensorNode { x_m: 50.0, y_m: 60.0, gain: 1e-5, ..SensorNode::default() }];
        Self {
            bridge: Bridge::new(scenario, &sensors, AreaFrame::at(HOME), &reports, is_restart),
            copter: Copter::new(options),
            random: ChaCha8Rng::seed_from_u64(options.seed),
            loss,
            autopilot: AutopilotKind::ArduPilot,
            now_s: 0.0,
            steps: 0,
            is_bridge_alive: true,
            says_on_ground_until_s: 0.0,
            said: Vec::new(),
            take_offs: 0,
            questions: 0,
            refused: None,
            start_m: reports[0].position().xy(),
            reports,
            dead_man: Some(f32::from(options.dead_man)),
        }
    }

    /// The vehicle's home: 3 m beside the start.
    fn home_m(&self) -> Position {
        Position::new(self.start_m.x + 3.0, self.start_m.y)
    }

    fn is_lost(&mut self) -> bool {
        self.random.random::<f64>() < self.loss
    }

    fn hear(&mut self, telemetry: &Telemetry) {
        if !self.is_lost() && self.is_bridge_alive {
            self.bridge.hear(0, telemetry, self.now_s);
        }
    }

    fn fix(&self) -> Telemetry {
        let position_m = self.copter.body.position_m;
        let place = Projection::at(HOME).unproject(&(self.home_m() + position_m.xy())).unwrap();
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
    fn above_home_m(&self, altitude: Altitude) -> f64 {
        match (self.autopilot, altitude) {
            (AutopilotKind::Px4, Altitude::AboveSea(z_m)) => z_m - 488.0,
            (AutopilotKind::ArduPilot | AutopilotKind::Other, Altitude::AboveHome(z_m)) => z_m,
            other => panic!("{other:?}"),
        }
    }

    /// The number of the vehicle's mode.
    fn mode(&self) -> u32 {
        match (self.autopilot, self.copter.mode) {
            (AutopilotKind::Px4, CopterMode::Stabilize) => 7 << 16,
            (AutopilotKind::Px4, CopterMode::Guided) => 4 << 16 | 3 << 24,
            (AutopilotKind::Px4, CopterMode::Return) => 4 << 16 | 5 << 24,
            (_, mode) => mode as u32,
        }
    }

    fn given(&self, order: &Order) -> Option<Given> {
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

    fn obey(&mut self, order: &Order) {
        if self.is_lost() {
            return;
        }
        self.take_offs += u32::from(matches!(order, Order::TakeOff(_)));
        if let Order::Parameter(name) = order {
            self.questions += 1;
            if let Some(value) = self.dead_man {
                self.hear(&Telemetry::Parameter { name: (*name).to_owned(), value });
            }
        } else if let (Some(given), Some(command)) = (self.given(order), order.command()) {
            let changes_mode = matches!(order, Order::TakeOff(_) | Order::Reposition { may_change_mode: true, .. });
            if self.autopilot != AutopilotKind::ArduPilot && changes_mode && self.copter.is_armed {
                self.copter.mode = CopterMode::Guided;
            }
            let is_refused = self.refused == Some(command);
            let result = if is_refused { MavResult::MAV_RESULT_FAILED } else { self.copter.obey(given) } as u8;
            self.hear(&Telemetry::Answer { command, result });
        }
    }

    fn step(&mut self) {
        self.steps += 1;
        self.now_s += STEP_S;
        self.copter.step(STEP_S, &mut self.random);
        let is_second = self.steps.is_multiple_of(50);
        if is_second {
            let is_armed = self.copter.is_armed;
            let mode = self.mode();
            self.hear(&Telemetry::Heartbeat { autopilot: self.autopilot, mode, is_armed });
            let is_in_air = self.copter.is_in_air() && self.now_s > self.says_on_ground_until_s;
            self.hear(&Telemetry::InAir(is_in_air));
            self.hear(&Telemetry::Battery(self.copter.battery));
        }
        if self.steps.is_multiple_of(12) && self.is_bridge_alive && !self.is_lost() {
            self.copter.hear_bridge(); // about four times in a second
        }
        if self.steps.is_multiple_of(5) {
            let fix = self.fix();
            self.hear(&fix);
        }
        if self.is_bridge_alive {
            let mut orders = Vec::new();
            let said = &mut self.said;
            self.bridge.poll(self.now_s, |_, order| orders.push(*order), |_, line| said.push(line)).unwrap();
            orders.iter().for_each(|order| self.obey(order));
        }
    }

    fn advance(&mut self, seconds: f64) {
        (0..(seconds / STEP_S) as u32).for_each(|_| self.step());
    }

    fn until(&mut self, limit_s: f64, is_so: impl Fn(&Self) -> bool) {
        let end_s = self.now_s + limit_s;
        while !is_so(self) {
            assert!(self.now_s < end_s, "not within {limit_s} s: {:?}, {:?}", self.copter, self.said);
            self.step();
        }
    }

    fn fly_slot(&mut self, slot: u64, plan: Option<Plan>) -> FlightReport {
        self.bridge.await_plan();
        self.bridge.begin(slot, 0.0);
        if let Some(plan) = plan {
            self.bridge.fly(&[plan], self.now_s);
        }
        self.advance(6.0);
        self.bridge.end(slot, &mut self.reports, self.now_s);
        self.reports[0]
    }
}

fn plan(x_m: f64, y_m: f64) -> Plan {
    let mut plan = Plan::fly_to([x_m, y_m, 20.0], Mode::Serve);
    plan.schedule(&[0]);
    plan
}

#[test]
fn a_slot_reports_where_the_vehicle_is_and_what_it_serves_from_there() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let report = flight.fly_slot(1, Some(plan(50.0, 62.0)));
    assert_eq!((report.mode, report.served), (Mode::Serve as u32, 1));
    assert!((report.position() - nalgebra::Point3::new(50.0, 62.0, 20.0)).norm() < REACHED_M, "{report:?}");
    assert!((report.time_s - 6.0).abs() < 0.2, "{report:?}");

    let report = flight.fly_slot(2, None);
    assert_eq!((report.mode, report.hold), (Mode::Hold as u32, HoldReason::NoPlan as u32));
    assert!((report.y_m - 62.0).abs() < REACHED_M && report.served == 0, "it holds: {report:?}");

    for (x_m, y_m) in [(f64::NAN, 60.0), (50.0, 101.0), (50.0, 20.0)] {
        let report = flight.fly_slot(3, Some(plan(x_m, y_m)));
        assert_eq!((report.hold, report.refused), (HoldReason::Waypoint as u32, 1), "({x_m}, {y_m})");
        assert!((report.y_m - 62.0).abs() < REACHED_M, "outside, or out of reach: {report:?}");
    }
}

#[test]
fn a_slot_that_began_before_the_bridge_noticed_is_that_much_longer() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    flight.bridge.begin(1, 0.75);
    flight.advance(5.0);
    flight.bridge.end(1, &mut flight.reports, flight.now_s);
    assert!((flight.reports[0].time_s - 5.75).abs() < 0.2, "{:?}", flight.reports[0]);
}

#[test]
fn a_vehicle_that_was_never_heard_ends_its_slots_on_time() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 1.0);
    let report = flight.fly_slot(3, Some(plan(50.0, 62.0)));
    assert_eq!((report.time_s, report.mode), (18.0, Mode::Hold as u32));
}

#[test]
fn a_vehicle_on_the_ground_does_not_take_off_to_return() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.advance(1.0);
    flight.bridge.return_home("the test is over", flight.now_s);
    assert!(flight.bridge.has_landed());
    flight.advance(10.0);
    assert!(!flight.copter.is_armed && flight.take_offs == 0, "{:?}", flight.said);
}

#[test]
fn charging_is_refused_also_in_the_base() {
    let scenario = scenario("uav.battery.capacity_j = 4e5\nbase.radius_m = 5.0\n");
    let mut flight = ClosedLoop::over(&scenario, &KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let report = flight.fly_slot(1, Some(Plan { mode: Mode::Charge as u32, ..plan(50.0, 50.0) }));
    let refused = (Mode::Hold as u32, HoldReason::Base as u32, 1);
    assert_eq!((report.mode, report.hold, report.refused), refused);
    assert_eq!(flight.bridge.ends.flown, 0);
}

#[test]
fn a_waypoint_is_not_reached_too_low() {
    let keys = "link.model = 'probabilistic-los'\nlink.environment = 'suburban'\nuav.altitude = 'free'\n\
                uav.min_altitude_m = 20.0\nuav.max_altitude_m = 90.0\nuav.max_climb_mps = 5.0\n";
    let scenario = scenario(keys);
    let mut flight = ClosedLoop::over(&scenario, &KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let report = flight.fly_slot(1, Some(Plan { z_m: 45.0, ..plan(50.0, 50.0) })); // it climbs 15 m in a slot
    assert_eq!((report.mode, report.hold), (Mode::EnRoute as u32, HoldReason::None as u32), "{report:?}");
    let reached = flight.bridge.ends;
    assert!((reached.flown, reached.reached) == (1, 0) && reached.farthest_m > 8.0, "{reached:?}");
}

#[test]
fn a_missed_waypoint_is_pursued_in_the_next_slot() {
    let mut flight = ClosedLoop::new(&KinematicOptions { acceleration: 0.3, ..KinematicOptions::default() }, 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let report = flight.fly_slot(1, Some(plan(50.0, 66.0)));
    assert_eq!(report.mode, Mode::EnRoute as u32, "{report:?}");
    assert!(report.y_m > 51.0 && report.y_m < 64.0 && report.velocity_mps[1] > 0.5, "{report:?}");
    assert_eq!(report.served, u32::from((report.y_m - 60.0).abs() < 10.0), "in range of where it is: {report:?}");
}

#[test]
fn a_vehicle_whose_dead_man_switch_is_unknown_does_not_take_off() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.dead_man = None;
    flight.advance(60.0);
    assert!((55..=60).contains(&flight.questions), "one a second: {}", flight.questions);
    assert!(!flight.copter.is_armed, "{:?}", flight.said);
    assert!(flight.said.iter().any(|line| line.contains("to say what it does when the bridge is silent")));
}

#[test]
fn a_vehicle_too_far_from_its_start_does_not_take_off() {
    let scenario = scenario("");
    let refusal = |away_m: f64| {
        let mut flight = ClosedLoop::over(&scenario, &KinematicOptions::default(), 0.0);
        flight.start_m.x += away_m - 3.0; // home is 3 m beside
        let fix = flight.fix();
        flight.hear(&Telemetry::Heartbeat { autopilot: AutopilotKind::ArduPilot, mode: 0, is_armed: false });
        flight.hear(&fix);
        flight.bridge.poll(0.0, |_, _| {}, |_, _| {}).err().map(|refusal| refusal.why.to_string())
    };
    let far = |away_m: u32| Some(format!("it is {away_m} m from its start: expected at most 500 m"));
    assert_eq!([4.0, 499.4, 501.0, 900.0].map(refusal), [None, None, far(501), far(900)]);
}

#[test]
fn a_restarted_bridge_leaves_a_vehicle_that_others_fly_and_keeps_one_in_guided_mode() {
    for (mode, is_kept) in [(CopterMode::Stabilize, false), (CopterMode::Return, false), (CopterMode::Guided, true)] {
        let mut before = ClosedLoop::new(&KinematicOptions::default(), 0.0);
        before.until(60.0, |flight| flight.bridge.has_begun());
        before.fly_slot(1, Some(plan(50.0, 62.0)));
        let mut flight =
            ClosedLoop::after(&scenario(""), &KinematicOptions::default(), 0.0, before.reports.clone(), true);
        flight.copter = before.copter;
        flight.copter.mode = mode;
        flight.advance(5.0);
        let has_given_up = flight.said.iter().any(|line| line.contains("is flown by others"));
        assert_eq!((has_given_up, flight.copter.mode), (!is_kept, mode), "{:?}", flight.said);
        if is_kept {
            let report = flight.fly_slot(2, Some(plan(50.0, 66.0)));
            assert!((report.y_m - 66.0).abs() < REACHED_M, "{report:?}");
        }
    }
}

#[test]
fn a_report_has_the_accuracy_and_the_energy_that_the_vehicle_tells() {
    let scenario = scenario("uav.battery.capacity_j = 4e5\nbase.radius_m = 5.0\n");
    let mut flight = ClosedLoop::over(&scenario, &KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    flight.hear(&Telemetry::Accuracy([0.5, 3.0]));
    let report = flight.fly_slot(1, None);
    assert_eq!(report.covariance_m2, [0.25, 0.0, 0.0, 0.25, 0.0, 9.0]);
    let told_j = 4e5 * flight.copter.battery;
    assert!((report.energy_j - told_j).abs() < 4e5 / 1200.0 && told_j < 4e5, "{report:?}"); // told every second
}

#[test]
fn an_accepted_take_off_is_not_ordered_again_while_motors_spool_up() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.says_on_ground_until_s = 7.5;
    flight.until(60.0, |flight| flight.bridge.has_begun());
    assert_eq!(flight.take_offs, 1);
}

#[test]
fn repeated_lines_of_the_vehicle_are_printed_once() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    for text in ["ready", "ready", "EKF variance", "ready"] {
        flight.hear(&Telemetry::Text(text.to_owned()));
    }
    flight.step();
    assert_eq!(flight.said, ["says: ready", "says: EKF variance", "says: ready"]);
}

#[test]
fn a_position_far_from_the_field_is_ignored() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let before = flight.fly_slot(1, Some(plan(50.0, 62.0)));
    let Telemetry::Position(fix) = flight.fix() else { panic!("not a position") };
    let report = |flight: &mut ClosedLoop| {
        flight.bridge.end(2, &mut flight.reports, flight.now_s);
        flight.reports[0].position()
    };
    (0..3).for_each(|_| flight.hear(&Telemetry::Position(Fix { lat_deg: 0.0, lon_deg: 0.001, ..fix })));
    assert!((report(&mut flight) - before.position()).norm() < 0.5);
    flight.step();
    let lines = flight.said.iter().filter(|line| line.contains("is not believed to be at 0, 0.001"));
    assert_eq!(lines.count(), 1, "{:?}", flight.said);
}

#[test]
fn a_pilot_who_takes_over_in_the_climb_keeps_the_vehicle() {
    for autopilot in [AutopilotKind::ArduPilot, AutopilotKind::Px4] {
        let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
        flight.autopilot = autopilot;
        flight.until(60.0, |flight| flight.copter.body.position_m.z > 10.0);
        flight.copter.mode = CopterMode::Stabilize;
        flight.until(10.0, |flight| flight.said.iter().any(|line| line.contains("gives no more orders")));
        flight.advance(20.0);
        assert_eq!(flight.copter.mode, CopterMode::Stabilize, "{autopilot:?}: {:?}", flight.said);
    }
}

#[test]
fn without_plans_the_vehicle_returns_and_lands() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let modes: Vec<u32> = (1..=20).map(|slot| flight.fly_slot(slot, None).mode).collect();
    let [hold, back, down] = [Mode::Hold, Mode::Return, Mode::Down].map(|mode| mode as u32);
    assert_eq!(modes[..5], [hold; 5]);
    assert!(modes[5] == back && modes[19] == down, "after 30 s: {modes:?}");
    assert!(flight.bridge.has_landed() && !flight.copter.is_armed);
}

#[test]
fn without_a_link_slots_report_the_last_position_as_holds() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    let before = flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.loss = 1.0;
    let report = flight.fly_slot(2, Some(plan(50.0, 68.0)));
    assert_eq!((report.mode, report.hold, report.served), (Mode::Hold as u32, HoldReason::NoPlan as u32, 0));
    assert!((report.position() - before.position()).norm() < 0.5, "{report:?}");
    flight.advance(10.0);
    assert_eq!(flight.copter.mode, CopterMode::Return, "by its dead-man switch");
    flight.loss = 0.0;
    let report = flight.fly_slot(3, Some(plan(50.0, 62.0)));
    assert_eq!(report.mode, Mode::Return as u32);
    assert!(flight.said.iter().any(|line| line.contains("gives no more orders")), "{:?}", flight.said);
}

#[test]
fn a_vehicle_is_homebound_once_it_says_so_and_has_landed_once_it_is_disarmed() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    assert!(!flight.bridge.is_homebound() && !flight.bridge.has_landed());
    flight.until(60.0, |flight| flight.bridge.has_begun());
    assert!(!flight.bridge.is_homebound() && !flight.bridge.has_landed());
    flight.loss = 1.0; // the order does not arrive
    flight.bridge.return_home("the test is over", flight.now_s);
    flight.advance(3.0);
    assert!(!flight.bridge.is_homebound(), "nobody has confirmed it");
    flight.loss = 0.0;
    flight.until(10.0, |flight| flight.bridge.is_homebound());
    assert!(flight.copter.mode == CopterMode::Return && !flight.bridge.has_landed());
    flight.until(120.0, |flight| flight.bridge.has_landed());
    assert!(!flight.copter.is_armed && flight.bridge.is_homebound());
}

#[test]
fn a_vehicle_that_refuses_another_speed_is_said_to_keep_its_own() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.refused = Order::Speed(10.0).command();
    flight.until(60.0, |flight| flight.said.iter().any(|line| line.contains("has taken off")));
    flight.advance(0.1);
    assert!(flight.said.iter().any(|line| line == "keeps its own speed, not 10 m/s"), "{:?}", flight.said);
}

#[test]
fn a_mission_begins_once_the_vehicle_hovers_at_its_start() {
    // It takes off 3 m beside, and is there and slow at different times.
    for lag in [0.0, 0.3] {
        let mut flight = ClosedLoop::new(&KinematicOptions { lag, ..KinematicOptions::default() }, 0.0);
        flight.until(60.0, |flight| flight.bridge.has_begun());
        let away_m = flight.home_m() + flight.copter.body.position_m.xy() - flight.start_m;
        assert!(away_m.norm() < REACHED_M + 0.2, "{away_m:?}");
        assert!(flight.copter.body.velocity_mps.norm() < 1.2, "{:?}", flight.copter);
    }
}

#[test]
fn the_vehicle_returns_itself_when_the_bridge_is_dead() {
    let mut flight = ClosedLoop::new(&KinematicOptions::default(), 0.0);
    flight.until(60.0, |flight| flight.bridge.has_begun());
    flight.fly_slot(1, Some(plan(50.0, 62.0)));
    flight.is_bridge_alive = false;
    flight.advance(7.0);
    assert_eq!(flight.copter.mode, CopterMode::Return);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_mission_with_message_losses_ends_on_the_ground(
        seed in 0u64..1_000, loss in 0.0..0.4, refuse_arming in 0u32..5, lag in 0.0..0.3, kill in any::<bool>(),
        autopilot in prop::sample::select(vec![AutopilotKind::ArduPilot, AutopilotKind::Px4, AutopilotKind::Other]),
    ) {
        let options = KinematicOptions { seed, refuse_arming, lag, ..KinematicOptions::default() };
        let mut flight = ClosedLoop::new(&options, loss);
        flight.autopilot = autopilot;
        flight.until(180.0, |flight| flight.bridge.has_begun());
        for slot in 1..=4 {
            let _ = flight.fly_slot(slot, Some(plan(50.0 + 3.0 * slot as f64, 60.0)));
        }
        flight.is_bridge_alive = !kill;
        let now_s = flight.now_s;
        flight.bridge.return_home("the test is over", now_s);
        flight.until(180.0, |flight| !flight.copter.is_armed);
        prop_assert!(flight.copter.body.position_m.norm() < 1.0, "at home: {:?}", flight.copter);
        if !kill {
            flight.until(60.0, |flight| flight.bridge.has_landed());
        }
    }

    #[test]
    fn a_vehicle_taken_over_by_a_pilot_gets_no_more_orders(seed in 0u64..100, loss in 0.0..0.3) {
        let mut flight = ClosedLoop::new(&KinematicOptions { seed, ..KinematicOptions::default() }, loss);
        flight.until(120.0, |flight| flight.bridge.has_begun());
        flight.copter.obey(Given::Mode(0));
        flight.until(20.0, |flight| flight.said.iter().any(|line| line.contains("gives no more orders")));
        let _ = flight.fly_slot(1, Some(plan(50.0, 62.0)));
        prop_assert_eq!(flight.copter.mode, CopterMode::Stabilize, "{:?}", flight.copter);
    }
}
