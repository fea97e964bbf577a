//! External processes of a run: the user starts them, on this host or on another.

use std::time::{Duration, Instant, SystemTime};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use skysink_common::pace::Pace;
use skysink_ring::error::RingError;
use skysink_ring::health::ProcessEvent;
use skysink_ring::role::Role;
use skysink_ring::topics::Ring;

use crate::run::heartbeat::{Heartbeat, SILENT_AFTER};

/// A process of the run that the launcher does not start.
#[derive(Debug)]
pub struct ExternalProcess<S: Service> {
    pub role: Role,
    /// Whether it runs on this host.
    is_local: bool,
    /// The events that the process sends while it waits, which the link forwards; `None` if the ring has no link.
    listener: Option<Listener<S>>,
    /// The last event.
    heard: Option<SystemTime>,
    /// Its heartbeat over the link.
    heartbeat: Heartbeat,
}

impl<S: Service + 'static> ExternalProcess<S> {
    /// The process of `role`, which may be on another host if the ring has a link.
    pub fn new(ring: &Ring<S>, role: Role) -> Result<Self, RingError> {
        let listener = ring.terms.link.map(|_| ring.heartbeat_listener(role)).transpose()?;
        Ok(Self { role, is_local: false, listener, heard: None, heartbeat: Heartbeat::after(None) })
    }

    /// Checks whether the process is present; returns the change since the last poll. `is_begun` says whether a slot
    /// was flown: a paced run, too, waits for the first plan.
    pub fn poll(&mut self, ring: &Ring<S>, is_begun: bool, now: Instant) -> Option<ProcessEvent> {
        let was_local = std::mem::replace(&mut self.is_local, ring.has_process(self.role));
        let heard = self.listen(now);
        match (was_local, self.is_local) {
            (false, true) => Some(ProcessEvent::Joined),
            (true, false) => {
                self.heard = None;
                self.heartbeat = Heartbeat::after(None);
                let is_spared = ring.terms.pace != Pace::Max && matches!(self.role, Role::Planner | Role::Viewer);
                Some(ProcessEvent::Missing { is_awaited: !(is_begun && is_spared) })
            }
            (true, true) => None,
            (false, false) => heard,
        }
    }

    /// Takes the events that have arrived over the link; returns the change since the last poll.
    fn listen(&mut self, now: Instant) -> Option<ProcessEvent> {
        let mut events = 0;
        let _ = self.listener.as_ref()?.try_wait(|_| events += 1); // an error counts as silence
        let is_first = events > 0 && self.heard.is_none();
        if events > 0 {
            self.heard = Some(SystemTime::now());
        }
        let event = self.heartbeat.update(self.heard, now);
        if is_first { Some(ProcessEvent::Joined) } else { event }
    }

    /// Whether the process is known to run, on this host or on another.
    pub fn is_present(&self) -> bool {
        self.is_local || self.is_heard()
    }

    /// Whether the process sends heartbeats from another host.
    pub fn is_heard(&self) -> bool {
        self.heard.is_some() && !self.heartbeat.is_silent_for(SILENT_AFTER)
    }

    /// Whether the process has sent no heartbeat over the link for `limit`, or none since `begin`.
    pub fn is_silent_for(&self, begin: Instant, limit: Duration) -> bool {
        self.listener.is_some()
            && match self.heard {
                Some(_) => self.heartbeat.is_silent_for(limit),
                None => begin.elapsed() >= limit,
            }
    }
}
