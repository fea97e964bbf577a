//! What becomes of the processes of a ring: the message, and the same words for the terminal, the recording and the
//! summary.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use crate::role::Role;

/// What has become of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// It was ended by a signal.
    Killed(i32),
    /// It has ended by itself with this exit code, and too early.
    Exited(i32),
    /// It was started again, and so often by now.
    Restarted(i32),
    /// It has given no sign of life for so long [ms].
    Silent(i32),
    /// It gives signs of life again, after so long [ms].
    Back(i32),
    /// It has not sent, for so long [ms], what everybody waits for.
    Overdue(i32),
    /// Nobody writes its topic any more; the launcher did not start it, and waits.
    Gone,
    /// A process that the launcher did not start writes its topic.
    Joined,
}

/// Payload of `health`; the sample's slot is the one under way.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("skysink.Health.v1")]
pub struct Health {
    /// The process: 0 field-sim, 1 flight-sim, 2 planner, 3 viewer, 4 the launcher.
    pub process: u32,
    /// 0 killed, 1 exited, 2 restarted, 3 silent, 4 back, 5 overdue, 6 gone, 7 joined.
    pub fate: u32,
    /// The signal, the exit code, the number of restarts, or the time [ms]; 0 for gone and joined.
    pub detail: i32,
    /// Zero.
    pub reserved: u32,
}

/// Payload of `ready`: the process is connected to every writer; the sample's slot is the first that it has shown.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("skysink.Ready.v1")]
pub struct Ready {
    /// The process, by its number in [`Health`]: 3, the viewer.
    pub process: u32,
    /// How often the process was started before.
    pub restarts: u32,
}

impl Health {
    /// The message that `role` has met with `fate`.
    #[must_use]
    pub fn of(role: Role, fate: Fate) -> Self {
        let (fate, detail) = match fate {
            Fate::Killed(signal) => (0, signal),
            Fate::Exited(code) => (1, code),
            Fate::Restarted(times) => (2, times),
            Fate::Silent(ms) => (3, ms),
            Fate::Back(ms) => (4, ms),
            Fate::Overdue(ms) => (5, ms),
            Fate::Gone => (6, 0),
            Fate::Joined => (7, 0),
        };
        Self { process: role as u32, fate, detail, reserved: 0 }
    }

    /// Who has met with what; none if the numbers mean nothing.
    #[must_use]
    pub fn read(&self) -> Option<(Role, Fate)> {
        let fate = match self.fate {
            0 => Fate::Killed(self.detail),
            1 => Fate::Exited(self.detail),
            2 => Fate::Restarted(self.detail),
            3 => Fate::Silent(self.detail),
            4 => Fate::Back(self.detail),
            5 => Fate::Overdue(self.detail),
            6 => Fate::Gone,
            7 => Fate::Joined,
            _ => return None,
        };
        (self.detail >= 0).then_some((Role::from_repr(self.process)?, fate))
    }
}

impl Fate {
    /// Whether the process recovered.
    #[must_use]
    pub fn is_recovery(self) -> bool {
        matches!(self, Self::Restarted(_) | Self::Back(_) | Self::Joined)
    }
}

impl fmt::Display for Fate {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = |ms: i32| f64::from(ms) / 1e3;
        match *self {
            Self::Killed(signal) => write!(formatter, "was ended by signal {signal}"),
            Self::Exited(code) => write!(formatter, "has ended too early, with exit code {code}"),
            Self::Restarted(times) => write!(formatter, "was started again (restart {times})"),
            Self::Silent(ms) => write!(formatter, "has given no sign of life for {:.1} s", seconds(ms)),
            Self::Back(ms) => write!(formatter, "is back after {:.1} s", seconds(ms)),
            Self::Overdue(ms) => write!(formatter, "has not sent what is due for {:.1} s", seconds(ms)),
            Self::Gone => write!(formatter, "has gone: the run waits for it to be started again"),
            Self::Joined => write!(formatter, "has joined"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_says_what_was_put_into_it() {
        let fates = [
            Fate::Killed(9),
            Fate::Exited(1),
            Fate::Restarted(3),
            Fate::Silent(1_500),
            Fate::Back(i32::MAX),
            Fate::Overdue(22_500),
            Fate::Gone,
            Fate::Joined,
        ];
        for (number, fate) in (0..).zip(fates) {
            let role = Role::from_repr(number % 5).unwrap();
            assert_eq!(Health::of(role, fate).read(), Some((role, fate)));
        }
        assert_eq!(Fate::Silent(1_500).to_string(), "has given no sign of life for 1.5 s");
    }

    #[test]
    fn numbers_that_mean_nothing_are_nothing() {
        assert_eq!(Health { process: 5, ..Health::default() }.read(), None);
        assert_eq!(Health { fate: 8, ..Health::default() }.read(), None);
        assert_eq!(Health { detail: -1, ..Health::default() }.read(), None);
        assert_eq!(size_of::<Health>(), 16);
    }
}
