//! Supervises the processes of a run: starts, restarts and stops them, and publishes every change of their state.

use std::os::unix::process::ExitStatusExt;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use rustix::process::Signal;
use skysink_common::message::SlotHeader;
use skysink_mission::summary::{Event, Tally};
use skysink_ring::folder::RingFolder;
use skysink_ring::health::{Health, ProcessEvent};
use skysink_ring::role::{Role, last_heartbeat, start_count};
use skysink_ring::topics::Ring;
use skysink_ring::writer::Writer;

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::run::external::ExternalProcess;
use crate::run::link::Link;
use crate::run::process::{POLL_EVERY, Process, ProcessTable};
use crate::run::restart::{EndCause, Restart};

/// Time from SIGTERM to SIGKILL.
const GRACE: Duration = Duration::from_secs(3);

/// Time between two checks for dead external processes.
const CLEAN_UP_EVERY: Duration = Duration::from_millis(500);

/// All processes of a run. Dropping it stops those that are still running.
pub struct Workers<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    folder: &'a RingFolder,
    table: &'a ProcessTable,
    progress: &'a TerminalProgress,
    processes: Vec<Process>,
    external: Vec<ExternalProcess<S>>,
    /// The link to other hosts, if there is one.
    link: Option<Link>,
    cleaned_up: Instant,
    health: Writer<S, Health, SlotHeader>,
    begin: Instant,
    last_slot: u64,
    is_released: bool,
    /// Restart count of the current viewer, or of the next one if there is none.
    viewer: u32,
}

impl<'a, S: Service + 'static> Workers<'a, S> {
    /// Starts the processes of a mission that ends with `last_slot`. The processes of the roles `external` are not
    /// started by this launcher.
    ///
    /// # Errors
    /// If the topic `health` cannot be written, or a process cannot be started; the others are stopped.
    pub fn start(
        ring: &'a Ring<S>,
        folder: &'a RingFolder,
        table: &'a ProcessTable,
        progress: &'a TerminalProgress,
        processes: Vec<Process>,
        external: &[Role],
        last_slot: u64,
    ) -> Result<Self, Error> {
        let health = ring.health.writer()?;
        let begin = Instant::now();
        let external = external.iter().map(|&role| ExternalProcess::new(ring, role));
        let mut workers = Self {
            external: external.collect::<Result<_, _>>()?,
            link: None,
            cleaned_up: begin,
            is_released: false,
            viewer: 0,
            ring,
            folder,
            table,
            progress,
            processes,
            health,
            begin,
            last_slot,
        };
        let mut processes = workers.processes.iter_mut();
        processes.try_for_each(|process| process.start(folder.path(), table, progress))?;
        Ok(workers)
    }

    /// Also supervises `link`, if there is one.
    #[must_use]
    pub fn with_link(mut self, link: Option<Link>) -> Self {
        self.link = link;
        self
    }

    /// Polls the processes once; adds changes to the tally, prints them and publishes them on `health`. `overdue` is
    /// the role whose message is late, and how long it has been awaited. Returns the restart count of the current
    /// viewer.
    ///
    /// # Errors
    /// As [`Workers::watch`].
    pub fn supervise(&mut self, tally: &mut Tally, overdue: Option<(Role, Duration)>) -> Result<u32, Error> {
        self.progress.show_run(tally, self.last_slot);
        let slot = tally.last_slot() + 1;
        for (role, event) in self.watch(slot, overdue)? {
            let at_s = self.begin.elapsed().as_secs_f64();
            let is_restart = matches!(event, ProcessEvent::Restarted(_));
            tally.add_event(Event { slot, at_s, process: role.name().into(), event: event.to_string() }, is_restart);
        }
        Ok(self.viewer)
    }

    /// Polls the processes once in `slot`; prints changes, publishes them on `health` and returns them. `overdue` is as
    /// in [`Workers::supervise`].
    ///
    /// # Errors
    /// [`Error::WorkerEnded`] or [`Error::LinkEnded`] if a process has ended and is not restarted.
    pub fn watch(&mut self, slot: u64, overdue: Option<(Role, Duration)>) -> Result<Vec<(Role, ProcessEvent)>, Error> {
        self.table.slot.store(slot, Ordering::Relaxed);
        if let Some(link) = &mut self.link {
            link.supervise(self.progress)?;
        }
        let mut events = self.poll(slot, overdue)?;
        events.extend(self.poll_external(slot, overdue));
        let taken = start_count(self.folder.path(), Role::Viewer);
        self.viewer = self.viewer.max(taken.saturating_sub(1));
        for &(role, event) in &events {
            if let ProcessEvent::Killed(_) | ProcessEvent::Exited(_) = event {
                self.ring.remove_dead_nodes(); // frees its ports for the restarted process
                if role == Role::Viewer {
                    self.viewer = taken; // of the next viewer
                }
            }
            let process = role.name();
            self.progress.say(&format!("slot {slot}: {process} {event}"));
            self.health.send(self.ring.header(slot, 0), Health::of(role, event))?;
        }
        Ok(events)
    }

    /// Disables restarts: the mission is complete.
    pub fn release(&mut self) {
        self.is_released = true;
    }

    /// Whether all processes with a role selected by `is_selected` have ended and will not be restarted.
    #[must_use]
    pub fn have_ended(&self, is_selected: impl Fn(Role) -> bool) -> bool {
        self.processes.iter().filter(|process| is_selected(process.role)).all(Process::has_ended)
    }

    /// Polls the processes of this launcher: detects ended ones, restarts those that are due, kills hung ones. Returns
    /// the changes.
    fn poll(&mut self, slot: u64, overdue: Option<(Role, Duration)>) -> Result<Vec<(Role, ProcessEvent)>, Error> {
        let mut events = Vec::new();
        let now = Instant::now();
        let ring = self.folder.path();
        let is_last_slot = slot >= self.last_slot;
        for process in &mut self.processes {
            if self.is_released {
                process.due = None;
            }
            if let Some(due) = process.due {
                if now >= due {
                    process.start(ring, self.table, self.progress)?;
                    events.push((process.role, ProcessEvent::Restarted(process.restarts.count)));
                }
            } else if let Some(status) = process.poll(self.table) {
                if self.is_released || status.success() && is_last_slot {
                    continue; // a regular end
                }
                let cause = match (status.code(), status.signal()) {
                    (Some(2), _) => EndCause::Refused,
                    (None, Some(9 | 15)) => EndCause::Killed, // SIGKILL or SIGTERM from another process
                    _ => EndCause::Exited(slot),
                };
                process.due = process.restarts.schedule(now, cause);
                if process.due.is_none() {
                    return Err(process.end_error(status, slot.min(self.last_slot)));
                }
                let exited = ProcessEvent::Exited(status.code().unwrap_or_default());
                events.push((process.role, status.signal().map_or(exited, ProcessEvent::Killed)));
            } else if process.child.is_some() {
                let event = process.heartbeat.update(last_heartbeat(ring, process.role), now);
                events.extend(event.map(|event| (process.role, event)));
                let mut is_hung = process.heartbeat.is_silent_for(self.ring.terms.silence_limit()) && !is_last_slot;
                if let Some((_, waited)) = overdue.filter(|(role, _)| *role == process.role) {
                    is_hung = true;
                    events.push((process.role, overdue_for(waited)));
                }
                if is_hung && process.restarts.policy == Restart::OnFailure {
                    process.signal(Signal::KILL);
                }
            }
        }
        Ok(events)
    }

    /// Whether there is a heartbeat from an external process on another host.
    #[must_use]
    pub fn is_external_alive(&self) -> bool {
        self.external.iter().any(ExternalProcess::is_heard)
    }

    /// Whether an external process on another host has sent no heartbeat for `limit`.
    #[must_use]
    pub fn is_external_silent_for(&self, limit: Duration) -> bool {
        self.external.iter().any(|external| external.is_silent_for(self.begin, limit))
    }

    /// Polls the external processes: which joined, recovered, or are silent, overdue or missing. Returns the changes.
    fn poll_external(&mut self, slot: u64, overdue: Option<(Role, Duration)>) -> Vec<(Role, ProcessEvent)> {
        let now = Instant::now();
        if !self.external.is_empty() && self.cleaned_up.elapsed() >= CLEAN_UP_EVERY {
            self.cleaned_up = now;
            self.ring.remove_dead_nodes(); // a dead writer stays attached until then
        }
        let mut events = Vec::new();
        for external in &mut self.external {
            events.extend(external.poll(self.ring, now).map(|event| (external.role, event)));
            if let Some((_, waited)) = overdue.filter(|(role, _)| *role == external.role && external.is_present()) {
                events.push((external.role, overdue_for(waited)));
            }
        }
        if self.is_released || slot >= self.last_slot {
            events.clear(); // a regular end
        }
        events
    }
}

impl<S: Service + 'static> Drop for Workers<'_, S> {
    fn drop(&mut self) {
        self.processes.iter().for_each(|process| process.signal(Signal::TERM));
        let deadline = Instant::now() + GRACE;
        while self.processes.iter().any(|process| process.child.is_some()) && Instant::now() < deadline {
            for process in &mut self.processes {
                process.poll(self.table);
            }
            std::thread::sleep(POLL_EVERY);
        }
        for process in &mut self.processes {
            process.signal(Signal::KILL);
            if let Some(mut child) = process.child.take() {
                let _ = child.wait();
            }
            process.join_messages();
        }
    }
}

fn overdue_for(waited: Duration) -> ProcessEvent {
    ProcessEvent::Overdue(i32::try_from(waited.as_millis()).unwrap_or(i32::MAX))
}
