//! What is known of a vehicle from its messages.

use nalgebra::Vector3;

use crate::autopilot::{AutopilotKind, ModeMeaning};
use crate::telemetry::{Fix, Order, Stream, Telemetry};

/// Age from which a position is not current any more [s].
const OLD_FIX_S: f64 = 2.0;

/// Altitude above home from which an armed vehicle is in the air, if it does not say so itself [m].
const IN_AIR_M: f64 = 1.0;

/// Time between two checks whether the vehicle sends what it should [s].
const STREAMS_S: f64 = 2.0;

/// Requests for what a vehicle that sends its position does not send, or not as often as it should: it may be unable to.
const MOST_REQUESTS: u32 = 5;

/// The messages that a vehicle has to send, and their periods [s]; the first shows whether it does.
const STREAMS: [(Stream, f64); 7] = [
    (Stream::Position, 0.05),
    (Stream::Heartbeat, 0.2),
    (Stream::Mode, 0.2),
    (Stream::Accuracy, 0.5),
    (Stream::Battery, 1.0),
    (Stream::Status, 1.0),
    (Stream::InAir, 0.5),
];

/// Time after which a vehicle that says nothing is lost [s].
const LOST_S: f64 = 3.0;

/// Silence after which a link may have been frozen [s].
const FROZEN_S: f64 = 1.5;

/// What a low report of a battery counts, a sufficient one takes off, and makes it low: three low ones in a row, or four
/// of every other, as of two batteries.
const LOW_REPORT: u32 = 2;
const SUFFICIENT_REPORT: u32 = 1;
const LOW: u32 = 5;

/// Speed up to which a vehicle may have landed anywhere [m/s], and how long it has to be disarmed there [s].
const STANDS_MPS: f64 = 0.3;
const STANDS_S: f64 = 5.0;

/// Time after which a vehicle that says that it is disarmed is believed [s].
const DOWN_S: f64 = 1.5;

/// Heartbeats in a row that say so, and over what time [s], after which one that then says that it is armed was armed again:
/// those that come late come at once. The second is that of vehicles with one heartbeat a second.
const OFF: [(u32, f64); 2] = [(3, 0.3), (2, 0.9)];

/// A state that is believed when two reports in a row agree on it.
#[derive(Debug, Clone, Copy, Default)]
struct Confirmed<T> {
    believed: Option<T>,
    last: Option<T>,
    /// Whether the last two reports agree.
    is_certain: bool,
}

impl<T: Copy + PartialEq> Confirmed<T> {
    fn hear(&mut self, report: T) {
        self.is_certain = self.last.replace(report) == Some(report);
        if self.is_certain {
            self.believed = Some(report);
        }
    }
}

/// The last messages of a vehicle.
#[derive(Debug, Clone, Default)]
pub struct VehicleState {
    /// Its autopilot; `None` before the first heartbeat.
    pub autopilot: Option<AutopilotKind>,
    /// Energy that is left, as a fraction of the battery's capacity; `None` if that is not known.
    pub battery: Option<f64>,
    /// Whether it has reported its battery, or that it does not measure it.
    pub has_reported_battery: bool,
    /// Standard deviations of the position [m], horizontal and vertical.
    pub accuracy_m: Option<[f64; 2]>,
    /// When its last heartbeat came [s].
    pub heartbeat_s: Option<f64>,
    /// When the last one came that said that it is armed [s].
    pub armed_s: Option<f64>,
    mode: Confirmed<u32>,
    is_armed: Confirmed<bool>,
    /// Since when it says that it is disarmed [s].
    disarmed_s: Option<f64>,
    /// Whether it has said since its heartbeats were counted anew that it is armed, and then, on the ground, for longer than
    /// heartbeats that come late at once, that it is not.
    was_on: bool,
    was_off: bool,
    is_booting: bool,
    /// Whether a report of the mode has come since the last poll.
    has_new_mode: bool,
    /// Whether a heartbeat has come since the last poll, which says whether it is armed, too.
    has_new_heartbeat: bool,
    fix: Option<(Fix, f64)>,
    says_in_air: Option<bool>,
    heard_s: Option<f64>,
    /// What reports of a battery below `low_battery` have counted.
    low_reports: u32,
    /// Heartbeats in a row that say it is disarmed.
    disarmed_reports: u32,
    /// Positions and reports of the mode since the last check of the streams.
    positions: u32,
    modes: u32,
    requests: u32,
    streams_due_s: f64,
}

impl VehicleState {
    /// Takes in a message. A battery below `low_battery`, as a fraction of its capacity, is low.
    pub fn hear(&mut self, telemetry: &Telemetry, low_battery: f64, now_s: f64) {
        self.heard_s = Some(now_s);
        match *telemetry {
            Telemetry::Heartbeat { autopilot, mode, is_armed, is_booting } => {
                self.autopilot = Some(autopilot);
                self.is_booting = is_booting;
                self.is_armed.hear(is_armed);
                self.disarmed_reports = if is_armed { 0 } else { self.disarmed_reports.saturating_add(1) };
                self.disarmed_s = (!is_armed).then(|| self.disarmed_s.unwrap_or(now_s));
                let off_s = self.disarmed_s.map_or(0.0, |disarmed_s| now_s - disarmed_s);
                let is_off = OFF.iter().any(|&(reports, for_s)| self.disarmed_reports >= reports && off_s >= for_s);
                self.was_on |= is_armed;
                self.was_off |= self.was_on && is_off && !self.is_high();
                self.has_new_heartbeat = true;
                self.heartbeat_s = Some(now_s);
                self.armed_s = if is_armed { Some(now_s) } else { self.armed_s };
                self.hear_mode(mode);
            }
            Telemetry::Mode(mode) => self.hear_mode(mode),
            Telemetry::Position(fix) => {
                self.fix = Some((fix, now_s));
                self.positions += 1;
            }
            Telemetry::Accuracy(accuracy_m) => self.accuracy_m = Some(accuracy_m),
            Telemetry::Battery(battery) => {
                self.has_reported_battery = true;
                // Of a battery monitor that is only there sometimes, the last value stays.
                self.battery = battery.or(self.battery);
                self.low_reports = match battery {
                    Some(battery) if battery < low_battery => (self.low_reports + LOW_REPORT).min(LOW),
                    Some(_) => self.low_reports.saturating_sub(SUFFICIENT_REPORT),
                    None => self.low_reports,
                };
            }
            Telemetry::InAir(is_in_air) => self.says_in_air = Some(is_in_air),
            Telemetry::Answer { .. } | Telemetry::Text(_) | Telemetry::Parameter { .. } => {}
        }
    }

    fn hear_mode(&mut self, mode: u32) {
        self.mode.hear(mode);
        self.has_new_mode = true;
        self.modes += 1;
    }

    /// The requests for all messages, if no positions come, or no report of the battery, and up to a few times if they or
    /// reports of the mode come more rarely than they should. ArduPilot does not send its accuracy.
    pub fn requests(&mut self, now_s: f64) -> impl Iterator<Item = Order> + use<> {
        let autopilot = self.autopilot;
        let is_due = autopilot.is_some() && now_s >= self.streams_due_s;
        let is_rare = |count: u32, period_s: f64| f64::from(count) < STREAMS_S / period_s / 2.0;
        let is_missing = self.positions == 0 || !self.has_reported_battery;
        let is_incomplete = is_rare(self.positions, STREAMS[0].1) || is_rare(self.modes, STREAMS[1].1);
        let is_slow = is_due && (is_missing || is_incomplete && self.requests < MOST_REQUESTS);
        if is_slow {
            self.requests = if self.positions == 0 { 0 } else { self.requests + 1 };
        }
        if is_due {
            self.positions = 0;
            self.modes = 0;
            self.streams_due_s = now_s + STREAMS_S;
        }
        let is_sent = move |stream| stream != Stream::Accuracy || autopilot != Some(AutopilotKind::ArduPilot);
        let streams = STREAMS.iter().filter(move |(stream, _)| is_slow && is_sent(*stream));
        streams.map(|&(stream, period_s)| Order::Interval { stream, period_s })
    }

    /// Its mode, by the number that the autopilot gives it, once two reports agree.
    pub fn mode(&self) -> Option<u32> {
        self.mode.believed
    }

    /// The name of its mode ([`AutopilotKind::mode_name`]); `unknown` before two reports agree.
    pub fn mode_name(&self) -> String {
        let named = self.autopilot.zip(self.mode.believed);
        named.map_or_else(|| "unknown".to_owned(), |(autopilot, mode)| autopilot.mode_name(mode))
    }

    /// What its mode means.
    pub fn meaning(&self) -> ModeMeaning {
        let meaning = |(autopilot, mode): (AutopilotKind, u32)| autopilot.meaning(mode);
        self.autopilot.zip(self.mode.believed).map_or(ModeMeaning::Unknown, meaning)
    }

    /// Whether its autopilot is still starting: then it changes its mode itself.
    pub fn is_booting(&self) -> bool {
        self.is_booting
    }

    /// Whether its motors may run, once two heartbeats agree on it.
    pub fn is_armed(&self) -> Option<bool> {
        self.is_armed.believed
    }

    /// Whether the last heartbeat says that it is armed.
    pub fn may_be_armed(&self) -> bool {
        self.is_armed.last == Some(true)
    }

    /// Whether the last report of its mode, or of whether it is armed, differs from the one before.
    pub fn is_in_doubt(&self) -> bool {
        !self.mode.is_certain || !self.is_armed.is_certain
    }

    /// Forgets how it was, at `now_s` [s]: two new reports have to agree on its mode, and on whether it is armed.
    pub fn doubt(&mut self, now_s: f64) {
        self.heard_s = self.heard_s.map(|_| now_s); // it was not silent, but nobody listened
        self.disarmed_reports = 0;
        self.disarmed_s = None;
        self.mode = Confirmed { last: None, is_certain: false, ..self.mode };
        self.is_armed = Confirmed { last: None, is_certain: false, ..self.is_armed };
        self.has_new_mode = false;
        self.has_new_heartbeat = false;
    }

    /// Counts anew the heartbeats that say it is disarmed.
    pub fn recount_disarmed(&mut self) {
        self.disarmed_reports = 0;
        self.was_off = false;
        self.was_on = self.may_be_armed();
    }

    /// Whether two heartbeats in a row, since they were counted anew, say that it is disarmed.
    pub fn says_disarmed(&self) -> bool {
        self.disarmed_reports >= 2
    }

    /// Whether a report of its mode, and whether a heartbeat has come since the last call: what may change the mode, or
    /// arms, is sent only then.
    pub fn take_new_reports(&mut self) -> [bool; 2] {
        [&mut self.has_new_mode, &mut self.has_new_heartbeat].map(std::mem::take)
    }

    /// Whether it has disarmed on the ground: it says so, longer than copies of old heartbeats that come late, and where
    /// it is agrees with that.
    pub fn has_disarmed(&self, now_s: f64) -> bool {
        let says_so_for = |seconds: f64| self.disarmed_s.is_some_and(|disarmed_s| now_s - disarmed_s >= seconds);
        let is_low = !self.is_high() && (self.fix.is_some() || self.says_in_air.is_some());
        let stands = || {
            let may_stand =
                self.fix().map_or(!self.is_high(), |fix| Vector3::from(fix.velocity_mps).norm() < STANDS_MPS);
            may_stand && says_so_for(STANDS_S)
        };
        self.is_armed.believed == Some(false) && self.says_disarmed() && says_so_for(DOWN_S) && (is_low || stands())
    }

    /// Whether its last heartbeat says that it is disarmed.
    pub fn says_off(&self) -> bool {
        self.disarmed_s.is_some()
    }

    /// Whether it was off on the ground since its heartbeats were counted anew, and is armed again.
    pub fn is_armed_again(&self) -> bool {
        self.was_off && self.may_be_armed()
    }

    /// Its last position.
    pub fn fix(&self) -> Option<&Fix> {
        self.fix.as_ref().map(|(fix, _)| fix)
    }

    /// Whether its position is current.
    pub fn has_current_fix(&self, now_s: f64) -> bool {
        self.fix.as_ref().is_some_and(|(_, heard_s)| now_s - heard_s < OLD_FIX_S)
    }

    /// How long it has said nothing [s], if that is too long.
    pub fn silence_s(&self, now_s: f64) -> Option<f64> {
        self.heard_s.map(|heard_s| now_s - heard_s).filter(|silence_s| *silence_s >= LOST_S)
    }

    /// How long nothing was heard of it [s], since time 0 if nothing ever was.
    pub fn unheard_s(&self, now_s: f64) -> f64 {
        now_s - self.heard_s.unwrap_or(0.0)
    }

    /// Whether nothing was heard of it for so long that what comes now may have waited in the link.
    pub fn was_silent(&self, now_s: f64) -> bool {
        self.heard_s.is_some_and(|heard_s| now_s - heard_s >= FROZEN_S)
    }

    /// Whether its battery is low.
    pub fn is_battery_low(&self) -> bool {
        self.low_reports >= LOW
    }

    /// Whether it is in the air.
    pub fn is_in_air(&self) -> bool {
        self.is_armed.believed == Some(true) && self.is_high()
    }

    /// Whether it is above the ground, by its own judgement or by its altitude.
    pub fn is_high(&self) -> bool {
        let is_above_home = self.fix().is_some_and(|fix| fix.above_home_m > IN_AIR_M);
        self.says_in_air.unwrap_or(is_above_home)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: f64 = 0.15;

    fn fix() -> Telemetry {
        Telemetry::Position(Fix {
            lat_deg: 47.0,
            lon_deg: 8.0,
            above_home_m: 20.0,
            above_sea_m: 420.0,
            velocity_mps: [0.0; 3],
            heading_deg: f64::INFINITY,
            boot_s: 0.0,
        })
    }

    fn heartbeat(autopilot: AutopilotKind, mode: u32, is_armed: bool) -> Telemetry {
        Telemetry::Heartbeat { autopilot, mode, is_armed, is_booting: false }
    }

    #[test]
    fn all_messages_are_requested_if_positions_are_rare() {
        let mut state = VehicleState::default();
        assert_eq!(state.requests(0.0).count(), 0, "nobody is there");
        state.hear(&heartbeat(AutopilotKind::Px4, 0, true), LIMIT, 0.0);
        assert_eq!(state.requests(0.0).count(), 7);
        assert_eq!(state.requests(1.0).count(), 0);
        let hear = |state: &mut VehicleState, positions: u32, modes: u32, now_s: f64| {
            (0..positions).for_each(|_| state.hear(&fix(), LIMIT, now_s));
            (0..modes).for_each(|_| state.hear(&Telemetry::Mode(0), LIMIT, now_s));
        };
        state.hear(&Telemetry::Battery(None), LIMIT, 1.0);
        hear(&mut state, 10, 10, 1.0);
        assert_eq!(state.requests(2.0).count(), 7, "5 Hz instead of 20");
        hear(&mut state, 30, 10, 3.0);
        assert_eq!(state.requests(4.0).count(), 0);
        state.hear(&heartbeat(AutopilotKind::ArduPilot, 4, true), LIMIT, 5.0);
        let is_accuracy = |order| matches!(order, Order::Interval { stream: Stream::Accuracy, .. });
        assert!(state.requests(6.0).count() == 6 && !state.requests(8.0).any(is_accuracy));
    }

    #[test]
    fn the_battery_is_requested_until_it_is_reported_and_modes_a_few_times() {
        let mut state = VehicleState::default();
        state.hear(&heartbeat(AutopilotKind::Px4, 0, false), LIMIT, 0.0);
        let requests = |state: &mut VehicleState, checks: u32| {
            let requests = (0..checks).map(|_| {
                (0..40).for_each(|_| state.hear(&fix(), LIMIT, 0.0));
                state.streams_due_s = 0.0;
                usize::from(state.requests(0.0).next().is_some())
            });
            requests.sum::<usize>()
        };
        assert_eq!(requests(&mut state, 20), 20, "without a battery");
        state.hear(&Telemetry::Battery(Some(0.5)), LIMIT, 0.0);
        state.requests = 0;
        assert_eq!(requests(&mut state, 20), 5, "it says its mode once a second, whatever is requested");
    }

    #[test]
    fn the_air_state_is_inferred_from_altitude_if_not_reported() {
        let mut state = VehicleState::default();
        (0..2).for_each(|_| state.hear(&heartbeat(AutopilotKind::Px4, 0, true), LIMIT, 0.0));
        assert!(!state.is_in_air());
        state.hear(&fix(), LIMIT, 0.0);
        assert!(state.is_in_air());
        state.hear(&Telemetry::InAir(false), LIMIT, 0.0);
        assert!(!state.is_in_air());
        assert!(state.has_current_fix(1.9) && !state.has_current_fix(2.1));
    }

    #[test]
    fn one_odd_heartbeat_is_a_doubt_and_two_are_believed() {
        let mut state = VehicleState::default();
        let mut hear = |mode: u32, is_armed: bool| {
            state.hear(&heartbeat(AutopilotKind::ArduPilot, mode, is_armed), LIMIT, 0.0);
            (state.mode(), state.is_armed(), state.is_in_doubt())
        };
        assert_eq!(hear(4, true), (None, None, true));
        assert_eq!(hear(4, true), (Some(4), Some(true), false));
        assert_eq!(hear(0, false), (Some(4), Some(true), true));
        assert_eq!(hear(4, true), (Some(4), Some(true), true), "which of them was odd?");
        assert_eq!(hear(4, true), (Some(4), Some(true), false));
        assert_eq!(hear(0, true), (Some(4), Some(true), true));
        assert_eq!(hear(0, true), (Some(0), Some(true), false));
    }

    #[test]
    fn a_disarmed_vehicle_is_believed_where_its_position_agrees() {
        let mut state = VehicleState::default();
        let says = |state: &mut VehicleState, now_s| state.hear(&heartbeat(AutopilotKind::Px4, 0, false), LIMIT, now_s);
        state.hear(&fix(), LIMIT, 0.0);
        says(&mut state, 0.0);
        says(&mut state, 1.0);
        assert!(!state.has_disarmed(1.0), "20 m up");
        assert!(!state.has_disarmed(4.9) && state.has_disarmed(5.0), "it stands on a roof");
        state.hear(&Telemetry::InAir(false), LIMIT, 1.0);
        assert!(!state.has_disarmed(1.4) && state.has_disarmed(1.5), "it says that it is on the ground");
        state.hear(&heartbeat(AutopilotKind::Px4, 0, true), LIMIT, 2.0);
        (0..3).for_each(|_| says(&mut state, 2.1));
        assert!(!state.has_disarmed(2.1), "old ones that come late");
    }

    #[test]
    fn three_low_reports_in_a_row_or_every_other_one_are_a_low_battery() {
        let mut state = VehicleState::default();
        let mut low = |percent: u32| {
            state.hear(&Telemetry::Battery(Some(f64::from(percent) / 100.0)), LIMIT, 0.0);
            state.is_battery_low()
        };
        assert_eq!([14, 60, 60, 14, 60, 60].map(&mut low), [false; 6], "odd ones");
        assert_eq!([14, 14, 14].map(&mut low), [false, false, true]);
        let mut state = VehicleState::default();
        let mut low = |percent: u32| {
            state.hear(&Telemetry::Battery(Some(f64::from(percent) / 100.0)), LIMIT, 0.0);
            state.hear(&Telemetry::Battery(None), LIMIT, 0.0);
            state.is_battery_low()
        };
        assert_eq!([14, 60, 14, 60, 14, 60, 14].map(&mut low), [false, false, false, false, false, false, true]);
    }
}
