//! Processes of a run that its launcher has not started: somebody else starts them, on this host or on another.

use std::time::{Duration, Instant, SystemTime};

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::Service;
use skysink_ring::error::RingError;
use skysink_ring::health::ProcessEvent;
use skysink_ring::role::Role;
use skysink_ring::topics::Ring;

use crate::run::heartbeat::{Heartbeat, SILENT_AFTER};

/// A process that takes part in a run and that the launcher has not started.
#[derive(Debug)]
pub struct Outside<S: Service> {
    /// What it does.
    pub role: Role,
    /// Whether it is on this host.
    is_here: bool,
    distant: Option<Distant<S>>,
}

/// The signs of life of a process that may be on another host: a link brings the wake-ups that it sends whenever it
/// waits.
#[derive(Debug)]
struct Distant<S: Service> {
    listener: Listener<S>,
    heard: Option<SystemTime>,
    heartbeat: Heartbeat,
}

impl<S: Service + 'static> Outside<S> {
    /// The process of `role`; on another host, too, if the ring has a link to one.
    ///
    /// # Errors
    /// If its wake-ups cannot be listened for.
    pub fn new(ring: &Ring<S>, role: Role) -> Result<Self, RingError> {
        let listener = ring.terms.link.map(|_| ring.listener_of(role)).transpose()?;
        let distant = listener.map(|listener| Distant { listener, heard: None, heartbeat: Heartbeat::after(None) });
        Ok(Self { role, is_here: false, distant })
    }

    /// Looks whether it is there; returns what is new.
    pub fn poll(&mut self, ring: &Ring<S>, now: Instant) -> Option<ProcessEvent> {
        let was_here = std::mem::replace(&mut self.is_here, ring.has_writer(self.role));
        let heard = self.distant.as_mut().and_then(|distant| distant.listen(now));
        match (was_here, self.is_here) {
            (false, true) => Some(ProcessEvent::Joined),
            (true, false) => {
                if let Some(Distant { heard, heartbeat, .. }) = &mut self.distant {
                    (*heard, *heartbeat) = (None, Heartbeat::after(None));
                }
                Some(ProcessEvent::Gone)
            }
            (true, true) => None,
            (false, false) => heard,
        }
    }

    /// Whether it is there, as far as is known.
    #[must_use]
    pub fn is_there(&self) -> bool {
        self.is_here || self.is_heard()
    }

    /// Whether it shows that it is alive on another host.
    #[must_use]
    pub fn is_heard(&self) -> bool {
        self.distant
            .as_ref()
            .is_some_and(|distant| distant.heard.is_some() && !distant.heartbeat.is_silent_for(SILENT_AFTER))
    }

    /// Whether it has given no sign of life for so long, or none at all since `begin`.
    #[must_use]
    pub fn is_missed(&self, begin: Instant, limit: Duration) -> bool {
        self.distant.as_ref().is_some_and(|distant| match distant.heard {
            Some(_) => distant.heartbeat.is_silent_for(limit),
            None => begin.elapsed() >= limit,
        })
    }
}

impl<S: Service> Distant<S> {
    /// Listens for wake-ups; returns what is new.
    fn listen(&mut self, now: Instant) -> Option<ProcessEvent> {
        let mut wake_ups = 0;
        let _ = self.listener.try_wait(|_| wake_ups += 1); // in vain is silence
        let is_first = wake_ups > 0 && self.heard.is_none();
        if wake_ups > 0 {
            self.heard = Some(SystemTime::now());
        }
        let fate = self.heartbeat.note(self.heard, now);
        if is_first { Some(ProcessEvent::Joined) } else { fate }
    }
}
