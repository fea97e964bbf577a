//! What the autopilot of the vehicle does with orders: as ArduCopter or as PX4, with their traps.

use mavlink::dialects::common::MavResult;
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;

use crate::body::Body;
pub use crate::modes::CopterMode;
use crate::modes::Imitated;
use crate::options::KinematicOptions;

/// Time for which PX4 holds before a failsafe changes the mode [s].
const HOLDS_S: f64 = 5.0;

/// Time after which an armed vehicle on the ground disarms by itself [s].
const DISARM_S: f64 = 10.0;

/// Altitude to which it climbs before it flies home [m].
pub(crate) const RETURN_M: f64 = 15.0;

/// How near to home it begins to land, and how near to its altitude a climb ends [m].
const NEAR_M: f64 = 0.5;

/// An order that it was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Given {
    /// Change the mode, by its number.
    Mode(u32),
    /// Arm.
    Arm,
    /// Take off to this altitude [m].
    TakeOff(f64),
    /// Fly with this speed [m/s].
    Speed(f64),
    /// Fly there [m], relative to home, with this speed [m/s] or that of before.
    Reposition(Vector3<f64>, Option<f64>),
    /// Return and land.
    Return,
}

/// The vehicle.
#[derive(Debug, Clone)]
pub struct Copter {
    /// Its motion.
    pub body: Body,
    /// Its mode.
    pub mode: CopterMode,
    /// Whether it is armed.
    pub is_armed: bool,
    /// Time since its start [s].
    pub boot_s: f64,
    /// Energy that is left, as a fraction.
    pub battery: f64,
    options: KinematicOptions,
    speed_mps: f64,
    /// Where it flies to; `None` on the ground.
    target_m: Option<Vector3<f64>>,
    armed_s: f64,
    took_off_s: Option<f64>,
    heard_s: Option<f64>,
    refusals_left: u32,
    has_failed: bool,
    /// Whether the GCS failsafe has acted since the bridge was heard last.
    is_bridge_lost: bool,
    /// Since when a failsafe acts [s].
    failsafe_s: Option<f64>,
    complained_s: f64,
    said: Vec<&'static str>,
}

impl Copter {
    /// The vehicle at its home.
    #[must_use]
    pub fn new(options: &KinematicOptions) -> Self {
        Self {
            body: Body::default(),
            mode: options.mode,
            is_armed: false,
            boot_s: 0.0,
            battery: f64::from(options.battery) / 100.0,
            options: options.clone(),
            speed_mps: options.speed,
            target_m: None,
            armed_s: 0.0,
            took_off_s: None,
            heard_s: None,
            refusals_left: options.refuse_arming,
            has_failed: false,
            is_bridge_lost: false,
            failsafe_s: None,
            complained_s: 0.0,
            said: Vec::new(),
        }
    }

    /// Whether its own checks before arming pass.
    pub fn is_ready(&self) -> bool {
        self.boot_s >= self.options.ready_after
    }

    /// Whether a failsafe acts.
    pub fn is_critical(&self) -> bool {
        self.failsafe_s.is_some()
    }

    /// The number of its mode.
    pub fn mode_number(&self) -> u32 {
        self.mode.number(self.options.autopilot)
    }

    /// Whether it is in the air.
    pub fn is_in_air(&self) -> bool {
        self.target_m.is_some()
    }

    /// Takes the lines that it has said.
    pub fn take_said(&mut self) -> Vec<&'static str> {
        std::mem::take(&mut self.said)
    }

    /// Notes a heartbeat of the bridge.
    pub fn hear_bridge(&mut self) {
        self.heard_s = Some(self.boot_s);
        self.is_bridge_lost = false;
    }

    /// Does what it is told, or refuses.
    pub fn obey(&mut self, given: Given) -> MavResult {
        let is_guided = self.mode == CopterMode::Guided;
        let is_px4 = self.options.is_px4();
        match given {
            Given::Mode(mode) => CopterMode::of(self.options.autopilot, mode)
                .map_or(MavResult::MAV_RESULT_FAILED, |mode| self.change_to(mode)),
            Given::Return => self.change_to(CopterMode::Return),
            Given::Arm => self.arm(),
            Given::TakeOff(z_m) if (is_guided || is_px4) && self.is_armed && !self.is_in_air() => {
                if is_px4 {
                    let _ = self.change_to(CopterMode::TakeOff); // from whatever mode
                }
                self.target_m = Some(Vector3::new(self.body.position_m.x, self.body.position_m.y, z_m));
                self.took_off_s.get_or_insert(self.boot_s);
                MavResult::MAV_RESULT_ACCEPTED
            }
            Given::TakeOff(_) => MavResult::MAV_RESULT_FAILED,
            Given::Speed(speed_mps) => {
                if speed_mps > 0.0 {
                    self.speed_mps = speed_mps; // others keep it
                }
                MavResult::MAV_RESULT_ACCEPTED
            }
            Given::Reposition(target_m, speed_mps) if is_guided => {
                if self.is_in_air() {
                    self.target_m = Some(target_m);
                    self.speed_mps = speed_mps.unwrap_or(self.speed_mps);
                } // on the ground it is accepted, without effect
                if is_px4 { MavResult::MAV_RESULT_UNSUPPORTED } else { MavResult::MAV_RESULT_ACCEPTED }
            }
            Given::Reposition(..) if is_px4 => MavResult::MAV_RESULT_UNSUPPORTED,
            Given::Reposition(..) => MavResult::MAV_RESULT_DENIED,
        }
    }

    /// Changes to `mode`, as a pilot or a failsafe does.
    pub fn change_to(&mut self, mode: CopterMode) -> MavResult {
        if self.options.is_px4() && mode == CopterMode::Guided && self.mode != mode {
            self.speed_mps = self.options.speed; // PX4 forgets what it was asked for
        }
        self.mode = mode;
        self.failsafe_s = None; // somebody has taken control
        if let Some(target_m) = &mut self.target_m {
            *target_m = self.body.position_m; // stops where it is
            target_m.z = match mode {
                CopterMode::Return => target_m.z.max(RETURN_M),
                CopterMode::Land => -1.0,
                _ => target_m.z.max(0.0),
            };
        }
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// Disarms at once, also in the air: it falls.
    pub fn disarm(&mut self) {
        self.is_armed = false;
        self.target_m = None;
        self.body.position_m.z = 0.0;
        self.body.stand();
    }

    /// Is armed and taken off to `z_m` [m] by its pilot.
    pub fn take_off_by_hand(&mut self, z_m: f64) {
        self.change_to(CopterMode::Loiter);
        self.is_armed = true;
        self.armed_s = self.boot_s;
        self.target_m = Some(Vector3::new(self.body.position_m.x, self.body.position_m.y, z_m));
    }

    fn arm(&mut self) -> MavResult {
        if self.is_armed {
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        if !self.is_ready() || self.refusals_left > 0 {
            self.refusals_left = self.refusals_left.saturating_sub(u32::from(self.is_ready()));
            self.said.push("Arm: Need Position Estimate");
            return MavResult::MAV_RESULT_FAILED;
        }
        self.is_armed = true;
        self.armed_s = self.boot_s;
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// Advances by `dt_s` [s].
    pub fn step(&mut self, dt_s: f64, random: &mut ChaCha8Rng) {
        self.boot_s += dt_s;
        if !self.is_ready() && self.boot_s >= self.complained_s + 1.0 {
            self.complained_s = self.boot_s;
            self.said.push("PreArm: Need Position Estimate");
        }
        self.check_failsafes();
        let Some(target_m) = self.target_m else {
            if self.is_armed && self.boot_s - self.armed_s > DISARM_S {
                self.is_armed = false;
            }
            return;
        };
        self.battery = (self.battery - dt_s / self.options.endurance).max(0.0);
        let limits = self.options.limits(self.speed_mps);
        self.body.fly(&target_m, &limits, dt_s, random);
        if self.comes_down() {
            self.come_home(target_m);
        } else if self.mode == CopterMode::TakeOff && (self.body.position_m.z - target_m.z).abs() < NEAR_M {
            let _ = self.change_to(CopterMode::Guided);
            self.target_m = Some(target_m);
        }
    }

    fn comes_down(&self) -> bool {
        matches!(self.mode, CopterMode::Return | CopterMode::Land)
    }

    fn check_failsafes(&mut self) {
        if !self.is_in_air() || self.comes_down() {
            return;
        }
        let is_silent = self.heard_s.is_some_and(|heard_s| self.boot_s - heard_s > self.options.silence);
        let flown_s = self.took_off_s.map_or(0.0, |took_off_s| self.boot_s - took_off_s);
        let is_due = self.options.failsafe_at.is_some_and(|at_s| flown_s >= at_s) && !self.has_failed;
        if let Some(since_s) = self.failsafe_s {
            if self.boot_s - since_s >= HOLDS_S {
                self.change_to(CopterMode::Return);
                self.failsafe_s = Some(since_s);
            }
            return;
        }
        let text = match self.options.autopilot {
            _ if is_due => "Battery Failsafe",
            _ if !is_silent || self.is_bridge_lost || self.options.gcs_failsafe() == 0 => return,
            Imitated::Arducopter => "GCS Failsafe",
            Imitated::Px4 => "Failsafe activated: GCS connection loss, triggering Return in 5 seconds\t",
        };
        self.has_failed |= is_due;
        self.is_bridge_lost |= is_silent;
        self.said.push(text);
        self.change_to(if self.options.is_px4() { CopterMode::Guided } else { CopterMode::Return });
        self.failsafe_s = Some(self.boot_s);
    }

    /// The parts of a return: climb, home, down.
    fn come_home(&mut self, target_m: Vector3<f64>) {
        let position_m = self.body.position_m;
        let home_m = Vector3::new(0.0, 0.0, target_m.z);
        self.target_m = Some(if target_m.z <= 0.0 {
            target_m // landing
        } else if target_m.xy() == home_m.xy() && position_m.xy().norm() < NEAR_M {
            Vector3::new(0.0, 0.0, -1.0)
        } else if (position_m.z - target_m.z).abs() < NEAR_M {
            home_m
        } else {
            target_m
        });
        if position_m.z <= 0.0 {
            self.body.stand();
            self.target_m = None;
            self.is_armed = false;
            self.failsafe_s = None;
            if self.options.is_px4() {
                self.mode = CopterMode::Guided; // that of before
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;

    fn advance(copter: &mut Copter, seconds: f64) {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        (0..(seconds / 0.02) as u32).for_each(|_| copter.step(0.02, &mut random));
    }

    fn in_air() -> Copter {
        let mut copter = Copter::new(&KinematicOptions { refuse_arming: 2, ..KinematicOptions::default() });
        assert!(copter.obey(Given::Arm) == MavResult::MAV_RESULT_FAILED && !copter.is_ready(), "too early");
        advance(&mut copter, 3.0);
        let results = [Given::Mode(4), Given::Arm, Given::Arm, Given::Arm].map(|given| copter.obey(given));
        use MavResult::{MAV_RESULT_ACCEPTED, MAV_RESULT_FAILED};
        assert_eq!(results, [MAV_RESULT_ACCEPTED, MAV_RESULT_FAILED, MAV_RESULT_FAILED, MAV_RESULT_ACCEPTED]);
        assert_eq!(copter.obey(Given::TakeOff(20.0)), MAV_RESULT_ACCEPTED);
        advance(&mut copter, 12.0);
        assert!((copter.body.position_m.z - 20.0).abs() < 0.1, "{copter:?}");
        copter
    }

    #[test]
    fn the_autopilot_takes_off_only_armed_and_disarms_itself() {
        let mut copter = Copter::new(&KinematicOptions::default());
        advance(&mut copter, 3.0);
        assert_eq!(copter.obey(Given::TakeOff(20.0)), MavResult::MAV_RESULT_FAILED);
        copter.obey(Given::Mode(4));
        copter.obey(Given::Arm);
        assert_eq!(copter.obey(Given::Reposition(Vector3::new(5.0, 0.0, 20.0), None)), MavResult::MAV_RESULT_ACCEPTED);
        advance(&mut copter, 9.0);
        assert!(copter.is_armed && !copter.is_in_air(), "a reposition on the ground has no effect");
        advance(&mut copter, 2.0);
        assert!(!copter.is_armed);
    }

    #[test]
    fn the_autopilot_holds_its_target_and_returns_when_the_bridge_is_silent() {
        let mut copter = in_air();
        copter.obey(Given::Reposition(Vector3::new(30.0, 10.0, 20.0), None));
        advance(&mut copter, 60.0);
        assert!((copter.body.position_m - Vector3::new(30.0, 10.0, 20.0)).norm() < 0.1, "no bridge was ever heard");
        assert!((copter.battery - (1.0 - 72.0 / 1200.0)).abs() < 1e-9, "since it took off: {}", copter.battery);
        copter.hear_bridge();
        advance(&mut copter, 4.9);
        assert_eq!(copter.mode, CopterMode::Guided);
        advance(&mut copter, 0.3);
        assert_eq!(
            (copter.mode, copter.obey(Given::Reposition(Vector3::zeros(), None))),
            (CopterMode::Return, MavResult::MAV_RESULT_DENIED)
        );
        assert_eq!(copter.take_said().last(), Some(&"GCS Failsafe"));
        advance(&mut copter, 60.0);
        assert!(!copter.is_armed && copter.body.position_m.norm() < 0.6, "{copter:?}");
    }

    /// A PX4 that hovers at 20 m.
    fn px4() -> Copter {
        let options = KinematicOptions { autopilot: Imitated::Px4, ..KinematicOptions::default() };
        let mut copter = Copter::new(&options);
        advance(&mut copter, 3.0);
        assert_eq!(
            [Given::Arm, Given::TakeOff(20.0)].map(|given| copter.obey(given)),
            [MavResult::MAV_RESULT_ACCEPTED; 2]
        );
        assert_eq!(copter.mode, CopterMode::TakeOff);
        advance(&mut copter, 12.0);
        assert_eq!(copter.mode, CopterMode::Guided);
        copter
    }

    #[test]
    fn px4_flies_a_reposition_that_it_answers_unsupported_and_resets_its_speed_on_entering_hold() {
        let mut copter = px4();
        let there = Vector3::new(30.0, 0.0, 20.0);
        assert_eq!(copter.obey(Given::Reposition(there, Some(3.0))), MavResult::MAV_RESULT_UNSUPPORTED);
        advance(&mut copter, 5.0);
        assert!((copter.body.velocity_mps.norm() - 3.0).abs() < 0.1, "{copter:?}");
        let _ = copter.change_to(CopterMode::Loiter);
        assert_eq!(copter.obey(Given::Reposition(there, None)), MavResult::MAV_RESULT_UNSUPPORTED);
        advance(&mut copter, 5.0);
        assert!(copter.body.velocity_mps.norm() < 0.1, "{copter:?}");
        let _ = copter.change_to(CopterMode::Guided);
        assert_eq!(copter.speed_mps, 10.0);
    }

    #[test]
    fn a_failsafe_of_px4_holds_for_five_seconds_and_a_change_of_the_mode_ends_it() {
        let mut copter = px4();
        copter.hear_bridge();
        advance(&mut copter, 5.5);
        assert_eq!((copter.mode, copter.is_critical()), (CopterMode::Guided, true));
        let mut kept = copter.clone();
        advance(&mut copter, 5.0);
        assert_eq!((copter.mode, copter.is_critical()), (CopterMode::Return, true));
        advance(&mut copter, 60.0);
        assert_eq!((copter.mode, copter.is_armed, copter.is_critical()), (CopterMode::Guided, false, false), "landed");
        let _ = kept.change_to(CopterMode::Loiter);
        assert!(!kept.is_critical(), "a pilot");
    }
}
