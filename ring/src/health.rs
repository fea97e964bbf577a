//! Events of the processes of a ring: the message, and its text in the terminal, the recording and the summary.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use skysink_common::possible::Message;

use crate::role::Role;

/// An event of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProcessEvent {
    /// Killed by this signal.
    Killed(i32),
    /// Exited before the end of the mission, with this exit code.
    Exited(i32),
    /// Restarted; the number of restarts so far.
    Restarted(i32),
    /// No heartbeat for this time [ms].
    Silent(i32),
    /// Sends heartbeats again, after this time [ms] without one.
    Recovered(i32),
    /// Has not sent the sample that the others wait for, or in a paced run its plan, for this time [ms].
    Overdue(i32),
    /// An external process, one that the launcher did not start, no longer writes its topic.
    Missing {
        /// Whether the run waits for another one. A paced run continues without planner or viewer.
        is_awaited: bool,
    },
    /// An external process, one that the launcher did not start, writes its topic.
    Joined,
    /// Has sent no plan in time for this number of slots in a row, in which the UAV held its position.
    Held(i32),
}

/// Payload of `health`; the sample's slot is the one under way.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("skysink.Health.v1")]
pub struct Health {
    /// The process: 0 field-sim, 1 flight-sim, 2 planner, 3 viewer, 4 the launcher.
    pub process: u32,
    /// 0 killed, 1 exited, 2 restarted, 3 silent, 4 recovered, 5 overdue, 6 missing, 7 joined, 8 held.
    pub event: u32,
    /// The signal, the exit code, the number of restarts or held slots, or the time [ms]; of a missing process 0 if the
    /// run waits for it, else 1; 0 for joined.
    pub detail: i32,
    /// Zero.
    pub reserved: u32,
}

/// Payload of `ready`: the process is connected to all writers; the sample's slot is the first that it has drawn.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("skysink.Ready.v1")]
pub struct Ready {
    /// The process, by its number in [`Health`]: 3, the viewer.
    pub process: u32,
    /// Restart count of the process.
    pub restarts: u32,
}

impl Message for Health {}
impl Message for Ready {}

impl Health {
    /// The message for an event of the process `role`.
    #[must_use]
    pub fn of(role: Role, event: ProcessEvent) -> Self {
        let (event, detail) = match event {
            ProcessEvent::Killed(signal) => (0, signal),
            ProcessEvent::Exited(code) => (1, code),
            ProcessEvent::Restarted(times) => (2, times),
            ProcessEvent::Silent(ms) => (3, ms),
            ProcessEvent::Recovered(ms) => (4, ms),
            ProcessEvent::Overdue(ms) => (5, ms),
            ProcessEvent::Missing { is_awaited } => (6, i32::from(!is_awaited)),
            ProcessEvent::Joined => (7, 0),
            ProcessEvent::Held(slots) => (8, slots),
        };
        Self { process: role as u32, event, detail, reserved: 0 }
    }

    /// The process and its event; `None` for unknown numbers.
    pub fn decode(&self) -> Option<(Role, ProcessEvent)> {
        let event = match self.event {
            0 => ProcessEvent::Killed(self.detail),
            1 => ProcessEvent::Exited(self.detail),
            2 => ProcessEvent::Restarted(self.detail),
            3 => ProcessEvent::Silent(self.detail),
            4 => ProcessEvent::Recovered(self.detail),
            5 => ProcessEvent::Overdue(self.detail),
            6 => ProcessEvent::Missing { is_awaited: self.detail == 0 },
            7 => ProcessEvent::Joined,
            8 => ProcessEvent::Held(self.detail),
            _ => return None,
        };
        (self.detail >= 0).then_some((Role::from_repr(self.process)?, event))
    }
}

impl ProcessEvent {
    /// Whether the process recovered.
    #[must_use]
    pub fn is_recovery(self) -> bool {
        matches!(self, Self::Restarted(_) | Self::Recovered(_) | Self::Joined)
    }
}

impl fmt::Display for ProcessEvent {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = |ms: i32| f64::from(ms) / 1e3;
        match *self {
            Self::Killed(signal) => write!(formatter, "was killed by signal {signal}"),
            Self::Exited(code) => write!(formatter, "exited early, with code {code}"),
            Self::Restarted(times) => write!(formatter, "was restarted (restart {times})"),
            Self::Silent(ms) => write!(formatter, "has sent no heartbeat for {:.1} s", seconds(ms)),
            Self::Recovered(ms) => write!(formatter, "recovered after {:.1} s", seconds(ms)),
            Self::Overdue(ms) => write!(formatter, "has sent no sample for {:.1} s", seconds(ms)),
            Self::Missing { is_awaited: true } => {
                write!(formatter, "is missing: the run waits for it to be started again")
            }
            Self::Missing { is_awaited: false } => {
                write!(formatter, "is missing: the run continues without it until it is started again")
            }
            Self::Joined => write!(formatter, "joined"),
            Self::Held(slots) => write!(formatter, "has sent no plan in time for {slots} slots in a row: the UAV held"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_decodes_to_its_event() {
        let events = [
            ProcessEvent::Killed(9),
            ProcessEvent::Exited(1),
            ProcessEvent::Restarted(3),
            ProcessEvent::Silent(1_500),
            ProcessEvent::Recovered(i32::MAX),
            ProcessEvent::Overdue(22_500),
            ProcessEvent::Missing { is_awaited: true },
            ProcessEvent::Missing { is_awaited: false },
            ProcessEvent::Joined,
            ProcessEvent::Held(12),
        ];
        for (number, event) in (0..).zip(events) {
            let role = Role::from_repr(number % 5).unwrap();
            assert_eq!(Health::of(role, event).decode(), Some((role, event)));
        }
        assert_eq!(ProcessEvent::Silent(1_500).to_string(), "has sent no heartbeat for 1.5 s");
    }

    #[test]
    fn unknown_numbers_decode_to_none() {
        assert_eq!(Health { process: 5, ..Health::default() }.decode(), None);
        assert_eq!(Health { event: 9, ..Health::default() }.decode(), None);
        assert_eq!(Health { detail: -1, ..Health::default() }.decode(), None);
        assert_eq!(size_of::<Health>(), 16);
    }
}
