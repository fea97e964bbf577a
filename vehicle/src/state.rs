//! What is known of a vehicle from its messages.

use crate::autopilot::{AutopilotKind, ModeMeaning};
use crate::telemetry::{Fix, Order, Stream, Telemetry};

/// Age from which a position is not current any more [s].
const OLD_FIX_S: f64 = 2.0;

/// Altitude above home from which an armed vehicle is in the air, if it does not say so itself [m].
const IN_AIR_M: f64 = 1.0;

/// Time between two checks whether the vehicle sends what it should [s].
const STREAMS_S: f64 = 2.0;

/// The messages that a vehicle has to send, and their periods [s]; the first shows whether it does.
const STREAMS: [(Stream, f64); 4] =
    [(Stream::Position, 0.05), (Stream::Accuracy, 0.5), (Stream::Battery, 1.0), (Stream::InAir, 0.5)];

/// The last messages of a vehicle.
#[derive(Debug, Clone, Default)]
pub struct VehicleState {
    /// Its autopilot; `None` before the first heartbeat.
    pub autopilot: Option<AutopilotKind>,
    /// Whether its motors may run.
    pub is_armed: bool,
    /// Energy that is left, as a fraction of the battery's capacity.
    pub battery: Option<f64>,
    /// Standard deviations of the position [m], horizontal and vertical.
    pub accuracy_m: Option<[f64; 2]>,
    mode: u32,
    fix: Option<(Fix, f64)>,
    says_in_air: Option<bool>,
    /// Positions since the last check of the streams.
    positions: u32,
    streams_due_s: f64,
}

impl VehicleState {
    /// Takes in a message.
    pub fn hear(&mut self, telemetry: &Telemetry, now_s: f64) {
        match *telemetry {
            Telemetry::Heartbeat { autopilot, mode, is_armed } => {
                self.autopilot = Some(autopilot);
                self.mode = mode;
                self.is_armed = is_armed;
            }
            Telemetry::Position(fix) => {
                self.fix = Some((fix, now_s));
                self.positions += 1;
            }
            Telemetry::Accuracy(accuracy_m) => self.accuracy_m = Some(accuracy_m),
            Telemetry::Battery(fraction) => self.battery = Some(fraction),
            Telemetry::InAir(is_in_air) => self.says_in_air = Some(is_in_air),
            Telemetry::Answer { .. } | Telemetry::Text(_) | Telemetry::Parameter { .. } => {}
        }
    }

    /// The requests for all messages, if positions come more rarely than they should, or not at all. ArduPilot does not
    /// send its accuracy.
    pub fn requests(&mut self, now_s: f64) -> impl Iterator<Item = Order> + use<> {
        let autopilot = self.autopilot;
        let is_due = autopilot.is_some() && now_s >= self.streams_due_s;
        let is_slow = is_due && f64::from(self.positions) < STREAMS_S / STREAMS[0].1 / 2.0;
        if is_due {
            self.positions = 0;
            self.streams_due_s = now_s + STREAMS_S;
        }
        let is_sent = move |stream| stream != Stream::Accuracy || autopilot != Some(AutopilotKind::ArduPilot);
        let streams = STREAMS.iter().filter(move |(stream, _)| is_slow && is_sent(*stream));
        streams.map(|&(stream, period_s)| Order::Interval { stream, period_s })
    }

    /// What its mode means.
    #[must_use]
    pub fn meaning(&self) -> ModeMeaning {
        self.autopilot.map_or(ModeMeaning::Unknown, |autopilot| autopilot.meaning(self.mode))
    }

    /// Its mode, by the number that the autopilot gives it.
    #[must_use]
    pub fn mode(&self) -> u32 {
        self.mode
    }

    /// Its last position.
    #[must_use]
    pub fn fix(&self) -> Option<&Fix> {
        self.fix.as_ref().map(|(fix, _)| fix)
    }

    /// Whether its position is current.
    #[must_use]
    pub fn has_current_fix(&self, now_s: f64) -> bool {
        self.fix.as_ref().is_some_and(|(_, heard_s)| now_s - heard_s < OLD_FIX_S)
    }

    /// Whether it is in the air.
    #[must_use]
    pub fn is_in_air(&self) -> bool {
        let is_high = self.fix().is_some_and(|fix| fix.above_home_m > IN_AIR_M);
        self.is_armed && self.says_in_air.unwrap_or(is_high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn all_messages_are_requested_if_positions_are_rare() {
        let mut state = VehicleState::default();
        assert_eq!(state.requests(0.0).count(), 0, "nobody is there");
        state.hear(&Telemetry::Heartbeat { autopilot: AutopilotKind::Px4, mode: 0, is_armed: true }, 0.0);
        assert_eq!(state.requests(0.0).count(), 4);
        assert_eq!(state.requests(1.0).count(), 0);
        (0..10).for_each(|_| state.hear(&fix(), 1.0));
        assert_eq!(state.requests(2.0).count(), 4, "5 Hz instead of 20");
        (0..30).for_each(|_| state.hear(&fix(), 3.0));
        assert_eq!(state.requests(4.0).count(), 0);
        state.hear(&Telemetry::Heartbeat { autopilot: AutopilotKind::ArduPilot, mode: 4, is_armed: true }, 5.0);
        let is_accuracy = |order| matches!(order, Order::Interval { stream: Stream::Accuracy, .. });
        assert!(state.requests(6.0).count() == 3 && !state.requests(8.0).any(is_accuracy));
    }

    #[test]
    fn the_air_state_is_inferred_from_altitude_if_not_reported() {
        let mut state = VehicleState::default();
        state.hear(&Telemetry::Heartbeat { autopilot: AutopilotKind::Px4, mode: 0, is_armed: true }, 0.0);
        assert!(!state.is_in_air());
        state.hear(&fix(), 0.0);
        assert!(state.is_in_air());
        state.hear(&Telemetry::InAir(false), 0.0);
        assert!(!state.is_in_air());
        assert!(state.has_current_fix(1.9) && !state.has_current_fix(2.1));
    }
}
