//! What the launcher does while the ring turns: it looks after the processes, and tells everybody what becomes of them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use iceoryx2::prelude::Service;
use skysink_common::message::SlotHeader;
use skysink_ring::health::{Fate, Health};
use skysink_ring::role::{Role, times_taken};
use skysink_ring::topics::Ring;
use skysink_ring::writer::Writer;

use crate::error::Error;
use crate::report::RunProgress;
use crate::run::launch::Crew;
use skysink_mission::summary::{Event, Tally};

/// Events that are kept: a run that has more is beyond reading.
const MAX_EVENTS: usize = 10_000;

/// Tells that a child process has ended, before anybody asks.
#[derive(Debug, Clone, Default)]
pub struct Alarm(Arc<AtomicBool>);

impl Alarm {
    /// An alarm that SIGCHLD rings.
    ///
    /// # Panics
    /// If the operating system refuses a handler for it, which it never does.
    #[must_use]
    pub fn on_child() -> Self {
        let alarm = Self::default();
        signal_hook::flag::register(signal_hook::consts::SIGCHLD, Arc::clone(&alarm.0)).expect("a catchable signal");
        alarm
    }

    /// Whether it has rung since the last time.
    #[must_use]
    pub fn rung(&self) -> bool {
        self.0.load(Ordering::Relaxed) && self.0.swap(false, Ordering::Relaxed)
    }
}

/// The watch of a run.
pub struct Watch<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    crew: Crew,
    health: Writer<S, Health, SlotHeader>,
    progress: &'a RunProgress,
    begin: Instant,
    last_slot: u64,
    slot: Arc<AtomicU64>,
    /// What has become of the processes so far.
    pub events: Vec<Event>,
    /// How often one was started again.
    pub restarts: u64,
    /// Restart count of the viewer that is there, or will be there next.
    viewer: u32,
}

impl<'a, S: Service + 'static> Watch<'a, S> {
    /// The watch over `crew` until `last_slot` is flown; `slot` is told the one under way.
    ///
    /// # Errors
    /// If nobody can be told.
    pub fn new(
        ring: &'a Ring<S>,
        crew: Crew,
        progress: &'a RunProgress,
        last_slot: u64,
        slot: Arc<AtomicU64>,
    ) -> Result<Self, Error> {
        let health = ring.health.writer()?;
        let (begin, events) = (Instant::now(), Vec::new());
        Ok(Self { ring, crew, health, progress, begin, last_slot, slot, events, restarts: 0, viewer: 0 })
    }

    /// Supervises the processes; returns the restart count of the current viewer, by its seat.
    ///
    /// # Errors
    /// [`Error::WorkerEnded`] if a process has ended that is not started again.
    pub fn supervise(&mut self, tally: &Tally) -> Result<u32, Error> {
        self.progress.show(tally);
        let slot = tally.last_slot() + 1;
        self.slot.store(slot, Ordering::Relaxed);
        let fates = self.crew.tend(slot.min(self.last_slot), self.last_slot)?;
        let taken = times_taken(self.crew.ring(), Role::Viewer);
        self.viewer = self.viewer.max(taken.saturating_sub(1));
        for (role, fate) in fates {
            if let Fate::Killed(_) | Fate::Exited(_) = fate {
                self.ring.remove_dead_nodes(); // before the next one needs its place
                if role == Role::Viewer {
                    self.viewer = taken; // the next one's
                }
            }
            self.tell(slot, role, fate)?;
        }
        Ok(self.viewer)
    }

    /// Starts no process again: all have done their part.
    pub fn release(&mut self) {
        self.crew.release();
    }

    /// The processes under watch.
    #[must_use]
    pub fn crew(&self) -> &Crew {
        &self.crew
    }

    fn tell(&mut self, slot: u64, role: Role, fate: Fate) -> Result<(), Error> {
        let process = role.name();
        self.progress.say(&format!("slot {slot}: {process} {fate}"));
        self.restarts += u64::from(matches!(fate, Fate::Restarted(_)));
        if self.events.len() < MAX_EVENTS {
            let at_s = self.begin.elapsed().as_secs_f64();
            self.events.push(Event { slot, at_s, process, event: fate.to_string() });
        }
        Ok(self.health.send(self.ring.header(slot, 0), Health::of(role, fate))?)
    }
}
