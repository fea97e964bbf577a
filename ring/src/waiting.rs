//! How the processes of a ring wait for messages: asleep until they are woken, or looking again and again.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// How a process waits for messages.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Waiting {
    /// Asleep, until the writer wakes it.
    #[default]
    Event,
    /// Looking again and again, which keeps a core busy for each process: for machines with cores to spare.
    Poll,
}

/// Longest sleep: somebody may have just joined, and a ring that stands still should not wait for long.
pub(crate) const LOOK_AROUND: Duration = Duration::from_millis(10);

/// Looks in a row before the core is offered to others: where there are fewer cores than processes, the one whose
/// message is awaited needs it.
const LOOKS: u32 = 64;

/// Why a way of waiting is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("wait {0}: expected event or poll")]
pub struct WaitingError(String);

impl Waiting {
    /// Every way, by its spelling.
    const ALL: [(Self, &'static str); 2] = [(Self::Event, "event"), (Self::Poll, "poll")];

    /// Waits a little for what `look` finds in `reader`: until its bell rings, or for some looks, at most for 10 ms.
    ///
    /// Whoever polls leaves the bell alone. Once it has rung, ringing it again costs its writer next to nothing.
    ///
    /// # Errors
    /// Those of `look`.
    pub fn look<S: Service, R, T, E>(
        self,
        reader: &mut R,
        bell: impl Fn(&R) -> &Listener<S>,
        mut look: impl FnMut(&mut R) -> Result<Option<T>, E>,
    ) -> Result<Option<T>, E> {
        match self {
            Self::Event => {
                let _ = bell(reader).timed_wait(|_| {}, LOOK_AROUND); // an interrupted wait is a short one
                look(reader)
            }
            Self::Poll => {
                for _ in 0..LOOKS {
                    if let Some(found) = look(reader)? {
                        return Ok(Some(found));
                    }
                    std::hint::spin_loop();
                }
                std::thread::yield_now();
                Ok(None)
            }
        }
    }
}

impl FromStr for Waiting {
    type Err = WaitingError;

    fn from_str(text: &str) -> Result<Self, WaitingError> {
        let found = Self::ALL.into_iter().find(|(_, name)| *name == text);
        found.map(|(waiting, _)| waiting).ok_or_else(|| WaitingError(text.to_owned()))
    }
}

impl fmt::Display for Waiting {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Event => "event",
            Self::Poll => "poll",
        })
    }
}

impl Serialize for Waiting {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Waiting {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_of_waiting_is_read_as_it_is_written() {
        for (waiting, text) in Waiting::ALL {
            assert_eq!(text.parse(), Ok(waiting));
            assert_eq!(waiting.to_string(), text);
        }
    }

    #[test]
    fn a_way_that_is_none_is_refused() {
        for text in ["", "Event", "spin", "events"] {
            assert_eq!(
                text.parse::<Waiting>().unwrap_err().to_string(),
                format!("wait {text}: expected event or poll")
            );
        }
    }
}
