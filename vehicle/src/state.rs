//! What is known of a vehicle from its messages.

use std::collections::VecDeque;

use nalgebra::Vector3;

use crate::autopilot::{AutopilotKind, ModeMeaning, NamedModes};
use crate::belief::ReportBelief;
use crate::table::{Failsafe, Report};
use crate::telemetry::{Fix, Order, Stream, Telemetry};

/// Age from which a position is not current any more [s].
const OLD_FIX_S: f64 = 2.0;

/// Age from which it does not count any more what a vehicle says of the ground [s]: its altitude does, if it is
/// current.
const OLD_IN_AIR_S: f64 = 10.0;

/// Altitude above home from which a vehicle is in the air, if it does not say so itself [m].
const IN_AIR_M: f64 = 1.0;

/// Time between two checks whether the vehicle sends what it should [s].
const STREAMS_S: f64 = 2.0;

/// Requests for what a vehicle that sends its position does not send, or not as often as it should: it may be unable
/// to.
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

/// Time without a mode after which a vehicle is lost [s].
const LOST_S: f64 = 3.0;

/// Silence after which a link may have been frozen [s], and time after it in which messages may still have waited in
/// it.
const FROZEN_S: f64 = 1.5;
const SETTLED_S: f64 = 0.3;

/// What a low report of a battery counts, a sufficient one takes off, and makes it low: three low ones in a row, or
/// four of every other, as of two batteries.
const LOW_REPORT: u32 = 2;
const SUFFICIENT_REPORT: u32 = 1;
const LOW: u32 = 5;

/// Speed up to which a vehicle may have landed anywhere [m/s], and how long it has to say that it is disarmed there
/// [s].
const STANDS_MPS: f64 = 0.3;
const STANDS_S: f64 = 5.0;

/// Time after which a failsafe that acts has not changed the mode [s]: PX4 holds for 5 s, or up to 25, before.
const LASTS_S: f64 = 30.0;

/// Time after which a vehicle has made its own checks again in a new mode [s].
const CHECKED_S: f64 = 2.0;

/// Altitudes of home of which the median counts: those of some seconds; and how many settle one.
const HOMES: usize = 100;
const SETTLED_HOMES: usize = 10;

/// The energy that a vehicle reports.
#[derive(Debug, Clone, Copy, Default)]
pub struct Power {
    /// Energy that is left, as a fraction of the battery's capacity; `None` if that is not known.
    pub left: Option<f64>,
    /// Whether it has reported its battery, or that it does not measure it.
    pub is_reported: bool,
    /// What reports of a battery below its limit have counted.
    low_reports: u32,
}

impl Power {
    fn hear(&mut self, left: Option<f64>, low: f64) {
        self.is_reported = true;
        self.left = left.or(self.left); // of a battery monitor that is only there sometimes, the last value stays
        self.low_reports = match left {
            Some(left) if left < low => (self.low_reports + LOW_REPORT).min(LOW),
            Some(_) => self.low_reports.saturating_sub(SUFFICIENT_REPORT),
            None => self.low_reports,
        };
    }

    /// Whether it is low.
    pub fn is_low(&self) -> bool {
        self.low_reports >= LOW
    }
}

/// The messages that have come since they were checked last.
#[derive(Debug, Clone, Default)]
struct Streams {
    positions: u32,
    modes: u32,
    requests: u32,
    due_s: f64,
}

/// The last messages of a vehicle.
#[derive(Debug, Clone, Default)]
pub struct VehicleState {
    /// Its autopilot; `None` before the first heartbeat.
    pub autopilot: Option<AutopilotKind>,
    /// Its battery.
    pub power: Power,
    /// Standard deviations of the position [m], horizontal and vertical.
    pub accuracy_m: Option<[f64; 2]>,
    /// Whether it passes its own checks before arming, and when it said so [s]; `None` if it does not.
    ready: Option<(bool, f64)>,
    /// What it reports of its mode and its motors.
    pub belief: ReportBelief,
    /// The number of its last mode.
    mode: Option<u32>,
    /// Since when one of its failsafes acts [s].
    failsafe_s: Option<f64>,
    fix: Option<(Fix, f64)>,
    /// Whether it says that it is in the air, and when it said so [s].
    says_in_air: Option<(bool, f64)>,
    /// The last altitudes of its home above sea [m]; before take-off their median is the one that counts.
    homes_m: VecDeque<f64>,
    streams: Streams,
}

/// When messages of a vehicle have come.
#[derive(Debug, Clone, Copy, Default)]
pub struct LinkArrivals {
    /// The last one [s].
    heard_s: Option<f64>,
    /// Until when messages may have waited in the link [s].
    stale_until_s: f64,
}

impl LinkArrivals {
    /// Takes in that a message comes. Returns whether the link may have been frozen just before.
    pub fn hear(&mut self, now_s: f64) -> bool {
        let was_frozen = self.heard_s.replace(now_s).is_some_and(|heard_s| now_s - heard_s >= FROZEN_S);
        if was_frozen {
            self.stale_until_s = now_s + SETTLED_S;
        }
        was_frozen
    }

    /// How long nothing has come [s]; `None` if nothing ever has.
    pub fn silence_s(&self, now_s: f64) -> Option<f64> {
        self.heard_s.map(|heard_s| now_s - heard_s)
    }

    /// Whether what comes now may have waited in the link.
    pub fn is_stale(&self, now_s: f64) -> bool {
        now_s < self.stale_until_s
    }

    /// Notes that nobody listened until now: the vehicle was not silent.
    pub fn note_deafness(&mut self, now_s: f64) {
        self.heard_s = self.heard_s.map(|_| now_s);
    }
}

impl VehicleState {
    /// Takes in a message. Modes have the meanings of the autopilot, or those that are `named`; a battery below
    /// `low_battery`, as a fraction of its capacity, is low.
    pub fn hear(&mut self, telemetry: &Telemetry, named: &NamedModes, low_battery: f64, now_s: f64) {
        let has_current_fix = self.has_current_fix(now_s);
        self.says_in_air = self.says_in_air.filter(|(_, said_s)| now_s - said_s < OLD_IN_AIR_S || !has_current_fix);
        match *telemetry {
            Telemetry::Heartbeat { autopilot, mode, is_armed, is_critical } => {
                self.autopilot = Some(autopilot);
                self.failsafe_s = is_critical.then(|| self.failsafe_s.unwrap_or(now_s));
                self.mode = Some(mode);
                self.streams.modes += 1;
                self.belief.hear(Report { mode: named.meaning(autopilot, mode), is_armed }, now_s);
            }
            Telemetry::Mode(mode) => {
                if let Some(autopilot) = self.autopilot {
                    self.mode = Some(mode);
                    self.streams.modes += 1;
                    self.belief.hear_mode(named.meaning(autopilot, mode), !self.is_high() || self.is_low(), now_s);
                }
            }
            Telemetry::Position(fix) => {
                self.fix = Some((fix, now_s));
                self.streams.positions += 1;
                self.homes_m.truncate(HOMES - 1);
                self.homes_m.push_front(fix.above_sea_m - fix.above_home_m);
            }
            Telemetry::Accuracy(accuracy_m) => self.accuracy_m = Some(accuracy_m),
            Telemetry::Battery(left) => self.power.hear(left, low_battery),
            Telemetry::Status { left, is_ready } => {
                self.power.hear(left, low_battery);
                self.ready = is_ready.map(|is_ready| (is_ready, now_s));
            }
            Telemetry::InAir(is_in_air) => self.says_in_air = Some((is_in_air, now_s)),
            Telemetry::Answer { .. } | Telemetry::Text { .. } | Telemetry::Parameter { .. } => {}
        }
    }

    /// The requests for all messages, if no positions come, or no report of the battery, and up to a few times if they
    /// or reports of the mode come more rarely than they should. ArduPilot sends neither its accuracy nor, up to 4.6,
    /// its mode alone.
    pub fn requests(&mut self, now_s: f64) -> impl Iterator<Item = Order> + use<> {
        let Self { autopilot, streams, power, .. } = self;
        let is_due = autopilot.is_some() && now_s >= streams.due_s;
        let is_rare = |count: u32, period_s: f64| f64::from(count) < STREAMS_S / period_s / 2.0;
        let is_missing = streams.positions == 0 || !power.is_reported;
        let is_incomplete = is_rare(streams.positions, STREAMS[0].1) || is_rare(streams.modes, STREAMS[1].1);
        let is_slow = is_due && (is_missing || is_incomplete && streams.requests < MOST_REQUESTS);
        if is_slow {
            streams.requests = if streams.positions == 0 { 0 } else { streams.requests + 1 };
        }
        if is_due {
            *streams = Streams { requests: streams.requests, due_s: now_s + STREAMS_S, ..Streams::default() };
        }
        let autopilot = *autopilot;
        let is_sent = move |stream| {
            autopilot != Some(AutopilotKind::ArduPilot) || !matches!(stream, Stream::Accuracy | Stream::Mode)
        };
        let streams = STREAMS.iter().filter(move |(stream, _)| is_slow && is_sent(*stream));
        streams.map(|&(stream, period_s)| Order::Interval { stream, period_s })
    }

    /// The name of its last mode ([`AutopilotKind::mode_name`]); `unknown` before the first heartbeat.
    pub fn mode_name(&self) -> String {
        let named = self.autopilot.zip(self.mode);
        named.map_or_else(|| "unknown".to_owned(), |(autopilot, mode)| autopilot.mode_name(mode))
    }

    /// What it reports, if that is believed, and is not too old.
    pub fn believed(&self, now_s: f64) -> Option<Report> {
        self.belief.believed().filter(|_| !self.is_lost(now_s))
    }

    /// What its last mode means; `None` before the first.
    pub fn meaning(&self) -> Option<ModeMeaning> {
        self.belief.last().map(|report| report.mode)
    }

    /// Whether it is in a mode of its own for the take-off, in which it flies to no waypoint.
    pub fn takes_off(&self) -> bool {
        self.autopilot.zip(self.mode).is_some_and(|(autopilot, mode)| autopilot.takes_off_in(mode))
    }

    /// Whether it passes its own checks before arming, in the mode in which it is: they depend on that, and are made
    /// again in a second. One that does not report them passes.
    pub fn is_ready(&self) -> bool {
        self.ready.is_none_or(|(is_ready, said_s)| is_ready && said_s >= self.belief.since_s() + CHECKED_S)
    }

    /// Whether its last report says that it is armed.
    pub fn says_armed(&self) -> bool {
        self.belief.last().is_some_and(|report| report.is_armed)
    }

    /// Whether a failsafe of it acts.
    pub fn failsafe(&self, now_s: f64) -> Failsafe {
        match self.failsafe_s {
            None => Failsafe::Off,
            Some(since_s) if now_s - since_s < LASTS_S => Failsafe::Acts,
            Some(_) => Failsafe::Lasts,
        }
    }

    /// Its last position.
    pub fn fix(&self) -> Option<&Fix> {
        self.fix.as_ref().map(|(fix, _)| fix)
    }

    /// Its speed [m/s]; `None` if it has never said where it is.
    pub fn speed_mps(&self) -> Option<f64> {
        self.fix().map(|fix| Vector3::from(fix.velocity_mps).norm())
    }

    /// Whether its position is current.
    pub fn has_current_fix(&self, now_s: f64) -> bool {
        self.fix.as_ref().is_some_and(|(_, heard_s)| now_s - heard_s < OLD_FIX_S)
    }

    /// The altitude of its home above sea [m], as the median of the last seconds.
    pub fn home_m(&self) -> Option<f64> {
        let mut sorted: Vec<f64> = self.homes_m.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }

    /// The same, once it was reported some times.
    pub fn settled_home_m(&self) -> Option<f64> {
        self.home_m().filter(|_| self.homes_m.len() >= SETTLED_HOMES)
    }

    /// Whether it has not said its mode for too long, though it was heard.
    pub fn is_lost(&self, now_s: f64) -> bool {
        self.autopilot.is_some() && self.belief.silence_s(now_s) >= LOST_S
    }

    /// Whether it is above the ground, by its own judgement or by its altitude.
    pub fn is_high(&self) -> bool {
        let is_above_home = self.fix().is_some_and(|fix| fix.above_home_m > IN_AIR_M);
        self.says_in_air.map_or(is_above_home, |(is_in_air, _)| is_in_air)
    }

    /// Whether it is at the altitude of its home, so that it may have landed without having said so.
    fn is_low(&self) -> bool {
        self.fix().is_some_and(|fix| fix.above_home_m <= IN_AIR_M)
    }

    /// Whether it is on the ground: it says so, or is at the altitude of its home, or has stood somewhere for some
    /// seconds and says that it is disarmed.
    pub fn is_on_ground(&self, now_s: f64) -> bool {
        let says_so = !self.is_high() && (self.fix.is_some() || self.says_in_air.is_some());
        let may_stand = self.speed_mps().map_or(!self.is_high(), |speed_mps| speed_mps < STANDS_MPS);
        let stands = may_stand && !self.says_armed() && now_s - self.belief.since_s() >= STANDS_S;
        says_so || stands && self.belief.last().is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: f64 = 0.15;

    fn hear(state: &mut VehicleState, telemetry: &Telemetry, now_s: f64) {
        state.hear(telemetry, &NamedModes::default(), LIMIT, now_s);
    }

    fn fix(above_home_m: f64, above_sea_m: f64) -> Telemetry {
        Telemetry::Position(Fix {
            lat_deg: 47.0,
            lon_deg: 8.0,
            above_home_m,
            above_sea_m,
            velocity_mps: [0.0; 3],
            heading_deg: f64::INFINITY,
            boot_s: 0.0,
        })
    }

    fn heartbeat(autopilot: AutopilotKind, is_armed: bool) -> Telemetry {
        Telemetry::Heartbeat { autopilot, mode: 4, is_armed, is_critical: false }
    }

    #[test]
    fn all_messages_are_requested_if_positions_are_rare() {
        let mut state = VehicleState::default();
        assert_eq!(state.requests(0.0).count(), 0, "nobody is there");
        hear(&mut state, &heartbeat(AutopilotKind::Px4, true), 0.0);
        assert_eq!(state.requests(0.0).count(), 7);
        assert_eq!(state.requests(1.0).count(), 0);
        let hear_some = |state: &mut VehicleState, positions: u32, modes: u32, now_s: f64| {
            (0..positions).for_each(|_| hear(state, &fix(20.0, 420.0), now_s));
            (0..modes).for_each(|_| hear(state, &Telemetry::Mode(0), now_s));
        };
        hear(&mut state, &Telemetry::Battery(None), 1.0);
        hear_some(&mut state, 10, 10, 1.0);
        assert_eq!(state.requests(2.0).count(), 7, "5 Hz instead of 20");
        hear_some(&mut state, 30, 10, 3.0);
        assert_eq!(state.requests(4.0).count(), 0);
        hear(&mut state, &heartbeat(AutopilotKind::ArduPilot, true), 5.0);
        let is_unknown = |order| matches!(order, Order::Interval { stream: Stream::Accuracy | Stream::Mode, .. });
        assert!(state.requests(6.0).count() == 5 && !state.requests(8.0).any(is_unknown));
    }

    #[test]
    fn the_battery_is_requested_until_it_is_reported_and_modes_a_few_times() {
        let mut state = VehicleState::default();
        hear(&mut state, &heartbeat(AutopilotKind::Px4, false), 0.0);
        let requests = |state: &mut VehicleState, checks: u32| {
            let requests = (0..checks).map(|_| {
                (0..40).for_each(|_| hear(state, &fix(20.0, 420.0), 0.0));
                state.streams.due_s = 0.0;
                usize::from(state.requests(0.0).next().is_some())
            });
            requests.sum::<usize>()
        };
        assert_eq!(requests(&mut state, 20), 20, "without a battery");
        hear(&mut state, &Telemetry::Battery(Some(0.5)), 0.0);
        state.streams.requests = 0;
        assert_eq!(requests(&mut state, 20), 5, "it says its mode once a second, whatever is requested");
    }

    #[test]
    fn the_air_state_is_inferred_from_altitude_if_not_reported() {
        let mut state = VehicleState::default();
        assert!(!state.is_high() && !state.is_on_ground(0.0), "nothing is known");
        hear(&mut state, &fix(20.0, 420.0), 0.0);
        assert!(state.is_high());
        hear(&mut state, &Telemetry::InAir(false), 0.0);
        assert!(!state.is_high() && state.is_on_ground(0.0));
        assert!(state.has_current_fix(1.9) && !state.has_current_fix(2.1));
    }

    #[test]
    fn a_disarmed_vehicle_that_stands_on_a_roof_is_on_the_ground_after_some_seconds() {
        let mut state = VehicleState::default();
        hear(&mut state, &fix(20.0, 420.0), 0.0);
        hear(&mut state, &heartbeat(AutopilotKind::Px4, false), 0.0);
        assert!(!state.is_on_ground(4.9) && state.is_on_ground(5.0));
        hear(&mut state, &heartbeat(AutopilotKind::Px4, true), 5.0);
        assert!(!state.is_on_ground(20.0));
    }

    #[test]
    fn the_altitude_of_home_is_the_median_of_some_seconds() {
        let mut state = VehicleState::default();
        assert_eq!(state.home_m(), None);
        [400.0, 401.0, 402.0].iter().for_each(|home_m| hear(&mut state, &fix(5.0, home_m + 5.0), 0.0));
        assert_eq!(state.home_m(), Some(401.0));
        (0..HOMES).for_each(|_| hear(&mut state, &fix(5.0, 495.0), 0.0));
        assert_eq!((state.home_m(), state.homes_m.len()), (Some(490.0), HOMES));
    }

    #[test]
    fn a_failsafe_acts_and_then_lasts() {
        let mut state = VehicleState::default();
        let critical =
            |is_critical| Telemetry::Heartbeat { autopilot: AutopilotKind::Px4, mode: 0, is_armed: true, is_critical };
        hear(&mut state, &critical(true), 1.0);
        assert_eq!([1.0, 30.9, 31.0].map(|s| state.failsafe(s)), [Failsafe::Acts, Failsafe::Acts, Failsafe::Lasts]);
        hear(&mut state, &critical(false), 31.0);
        assert_eq!(state.failsafe(31.0), Failsafe::Off);
    }

    #[test]
    fn a_vehicle_whose_modes_stop_is_lost_though_it_says_where_it_is() {
        let mut state = VehicleState::default();
        (0..2).for_each(|_| hear(&mut state, &heartbeat(AutopilotKind::ArduPilot, true), 0.0));
        hear(&mut state, &fix(20.0, 420.0), 2.9);
        assert!(!state.is_lost(2.9) && state.believed(2.9).is_some());
        hear(&mut state, &fix(20.0, 420.0), 3.0);
        assert!(state.is_lost(3.0) && state.believed(3.0).is_none());
    }

    #[test]
    fn a_link_that_was_frozen_is_stale_for_a_moment() {
        let mut arrivals = LinkArrivals::default();
        assert!(!arrivals.hear(100.0) && !arrivals.hear(101.4));
        assert!(arrivals.hear(103.0) && arrivals.is_stale(103.2) && !arrivals.is_stale(103.4));
        arrivals.note_deafness(110.0);
        assert!(!arrivals.hear(110.1), "nobody listened");
    }

    #[test]
    fn three_low_reports_in_a_row_or_every_other_one_are_a_low_battery() {
        let mut power = Power::default();
        let mut low = |percent: u32| {
            power.hear(Some(f64::from(percent) / 100.0), LIMIT);
            power.is_low()
        };
        assert_eq!([14, 60, 60, 14, 60, 60].map(&mut low), [false; 6], "odd ones");
        assert_eq!([14, 14, 14].map(&mut low), [false, false, true]);
        let mut power = Power::default();
        let mut low = |percent: u32| {
            power.hear(Some(f64::from(percent) / 100.0), LIMIT);
            power.hear(None, LIMIT);
            power.is_low()
        };
        assert_eq!([14, 60, 14, 60, 14, 60, 14].map(&mut low), [false, false, false, false, false, false, true]);
    }
}
