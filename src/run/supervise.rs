//! Supervises the processes of a run, and publishes every change of their state.
//!
//! | process | started by | sign of life | restarted after its end | stopped |
//! |---|---|---|---|---|
//! | worker, planner of `--planner` | this launcher | the heartbeat of its lock file, if it has one; a sample in time | by `--restart`, within [`OF_WORKERS`] | TERM, KILL |
//! | link | this launcher | | always, within [`OF_LINK`](crate::run::restart::OF_LINK) | TERM, KILL, after the workers |
//! | `--external` | the user, here or on another host | a writer of its topic, its notifications over the link, a sample in time | | with the ring |

use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use skysink_common::message::SlotHeader;
use skysink_mission::summary::Event;
use skysink_mission::tally::Tally;
use skysink_ring::folder::RingFolder;
use skysink_ring::health::{Health, ProcessEvent};
use skysink_ring::role::{Role, last_heartbeat, start_count};
use skysink_ring::topics::Ring;
use skysink_ring::writer::Writer;

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::run::external::ExternalProcess;
use crate::run::heartbeat::Heartbeat;
use crate::run::process::{Invocation, Process, ProcessChange, reap_others, stop};
use crate::run::restart::{OF_WORKERS, Restart, Restarts};

/// Time between two checks for dead external processes, and for ended children that no worker is.
const CLEAN_UP_EVERY: Duration = Duration::from_millis(500);

/// What a launcher supervises, and where it reports.
pub struct Supervision<'a, S: Service + 'static> {
    pub ring: &'a Ring<S>,
    pub folder: &'a RingFolder,
    /// Prints progress and events.
    pub progress: &'a TerminalProgress,
    /// The processes of the ring to be started.
    pub workers: Vec<Worker>,
    /// The roles of the processes that this launcher does not start.
    pub external: &'a [Role],
    /// The link to other hosts to be started, if any.
    pub link: Option<Process>,
    pub last_slot: u64,
}

/// A process of the ring that this launcher starts.
pub struct Worker {
    role: Role,
    process: Process,
    heartbeat: Heartbeat,
}

impl Worker {
    /// The process of `role`, not started yet.
    pub fn new(role: Role, invocation: Invocation, policy: Restart) -> Self {
        let process = Process::new(Some(role), invocation, Restarts::new(policy, &OF_WORKERS));
        Self { role, process, heartbeat: Heartbeat::after(None) }
    }
}

/// All processes of a run. Dropping it stops those that are still running.
pub struct Workers<'a, S: Service + 'static> {
    run: Supervision<'a, S>,
    external: Vec<ExternalProcess<S>>,
    cleaned_up: Instant,
    health: Writer<S, Health, SlotHeader>,
    begin: Instant,
    is_released: bool,
    /// The first slot; `None` before the first poll.
    first_slot: Option<u64>,
    /// Restart count of the current viewer, or of the next one if there is none.
    viewer: u32,
}

/// What the samples of a process show.
#[derive(Debug, Clone, Copy)]
pub struct SampleEvent {
    /// The sender.
    pub from: Role,
    pub event: ProcessEvent,
    /// Whether the process is hung, and must be restarted.
    pub is_hung: bool,
}

impl<'a, S: Service + 'static> Workers<'a, S> {
    /// Starts the link and the workers.
    ///
    /// # Errors
    /// If the topic `health` cannot be written, or a process cannot be started; the others are stopped.
    pub fn start(run: Supervision<'a, S>) -> Result<Self, Error> {
        let health = run.ring.health.writer()?;
        let external = run.external.iter().map(|&role| ExternalProcess::new(run.ring, role));
        let external = external.collect::<Result<_, _>>()?;
        let begin = Instant::now();
        let mut workers =
            Self { run, external, cleaned_up: begin, health, begin, is_released: false, first_slot: None, viewer: 0 };
        let Supervision { folder, progress, workers: started, link, .. } = &mut workers.run;
        if let Some(link) = link {
            link.start(progress)?;
        }
        for Worker { role, process, heartbeat } in started {
            *heartbeat = Heartbeat::after(last_heartbeat(folder.path(), *role));
            process.start(progress)?;
        }
        Ok(workers)
    }

    /// Polls the processes once; adds changes to the tally, prints them and publishes them on `health`. Returns the
    /// restart count of the current viewer.
    pub fn supervise(&mut self, tally: &mut Tally, sample: Option<SampleEvent>) -> Result<u32, Error> {
        self.run.progress.show_run(tally, self.run.last_slot);
        let slot = tally.sums.last_slot() + 1;
        for (role, event) in self.watch(slot, sample)? {
            let at_s = self.begin.elapsed().as_secs_f64();
            let is_restart = matches!(event, ProcessEvent::Restarted(_));
            tally
                .sums
                .add_event(Event { slot, at_s, process: role.name().into(), event: event.to_string() }, is_restart);
        }
        Ok(self.viewer)
    }

    /// Polls the processes once in `slot`; prints changes, publishes them on `health` and returns them.
    ///
    /// # Errors
    /// [`Error::WorkerEnded`] or [`Error::LinkEnded`] if a process has ended and is not restarted.
    pub fn watch(&mut self, slot: u64, sample: Option<SampleEvent>) -> Result<Vec<(Role, ProcessEvent)>, Error> {
        self.poll_link(slot)?;
        self.clean_up();
        let mut events = self.poll_workers(slot, sample.filter(|sample| sample.is_hung).map(|sample| sample.from))?;
        events.extend(self.poll_external(slot));
        events.extend(sample.filter(|sample| self.is_told(sample)).map(|sample| (sample.from, sample.event)));
        let Supervision { ring, folder, progress, .. } = self.run;
        let taken = start_count(folder.path(), Role::Viewer);
        self.viewer = self.viewer.max(taken.saturating_sub(1));
        for &(role, event) in &events {
            if let ProcessEvent::Killed(_) | ProcessEvent::Exited(_) = event {
                ring.remove_dead_nodes(); // frees its ports for the restarted process
                if role == Role::Viewer {
                    self.viewer = taken; // of the next viewer
                }
            }
            progress.say(&format!("slot {slot}: {} {event}", role.name()));
            self.health.send(ring.header(slot, 0), Health::of(role, event))?;
        }
        Ok(events)
    }

    /// Disables restarts: the mission is complete.
    pub fn release(&mut self) {
        self.is_released = true;
        self.run.workers.iter_mut().for_each(|worker| worker.process.cancel_restart());
    }

    /// Whether all workers with a role selected by `is_selected` have ended and will not be restarted.
    pub fn have_ended(&self, is_selected: impl Fn(Role) -> bool) -> bool {
        self.run.workers.iter().filter(|worker| is_selected(worker.role)).all(|worker| worker.process.has_ended())
    }

    /// Removes what dead external processes have left in the ring, and ended children that are no worker's, from time
    /// to time.
    fn clean_up(&mut self) {
        if self.cleaned_up.elapsed() < CLEAN_UP_EVERY {
            return;
        }
        self.cleaned_up = Instant::now();
        let Supervision { ring, workers, link, .. } = &self.run;
        let own: Vec<_> = workers.iter().map(|worker| &worker.process).chain(link).filter_map(Process::pid).collect();
        reap_others(&own);
        if !self.external.is_empty() {
            ring.remove_dead_nodes(); // a dead writer stays attached until then
        }
    }

    /// Polls the link.
    fn poll_link(&mut self, slot: u64) -> Result<(), Error> {
        let Supervision { link: Some(link), progress, .. } = &mut self.run else { return Ok(()) };
        if let Some(ProcessChange::Ended(status)) = link.advance(slot, progress, |_| false)? {
            progress.say(&format!("link: ended with {status}: restarting"));
        }
        Ok(())
    }

    /// Polls the workers: detects ended ones, restarts those that are due, kills hung ones. Returns the changes.
    fn poll_workers(&mut self, slot: u64, hung: Option<Role>) -> Result<Vec<(Role, ProcessEvent)>, Error> {
        let Supervision { ring, folder, progress, workers, last_slot, .. } = &mut self.run;
        let is_last_slot = slot >= *last_slot;
        let is_expected = |status: ExitStatus| self.is_released || status.success() && is_last_slot;
        let now = Instant::now();
        let mut events = Vec::new();
        for Worker { role, process, heartbeat } in workers {
            let beat = last_heartbeat(folder.path(), *role); // before a restart: that of the predecessor
            match process.advance(slot.min(*last_slot), progress, is_expected)? {
                Some(ProcessChange::Restarted(count)) => {
                    *heartbeat = Heartbeat::after(beat);
                    events.push((*role, ProcessEvent::Restarted(count)));
                }
                Some(ProcessChange::Ended(status)) if is_expected(status) => {
                    let is_bridge_lost = *role == Role::FlightSim && !status.success(); // while the vehicles return
                    let line = is_bridge_lost.then(|| format!("{} ended with {status} after the mission", role.name()));
                    line.iter().for_each(|line| progress.say(line));
                }
                Some(ProcessChange::Ended(status)) => {
                    let exited = ProcessEvent::Exited(status.code().unwrap_or_default());
                    events.push((*role, status.signal().map_or(exited, ProcessEvent::Killed)));
                }
                None if process.is_running() => {
                    events.extend(heartbeat.update(beat, now).map(|event| (*role, event)));
                    let is_silent = heartbeat.is_silent_for(ring.terms.silence_limit()) && !is_last_slot;
                    if (is_silent || hung == Some(*role)) && process.kill_hung() {
                        let name = role.name();
                        progress
                            .say(&format!("{name} is killed, as it does not answer; if it is slow, raise --timeout"));
                    }
                }
                None => {}
            }
        }
        Ok(events)
    }

    /// Whether there is a heartbeat from an external process on another host.
    pub fn is_external_alive(&self) -> bool {
        self.external.iter().any(ExternalProcess::is_heard)
    }

    /// Whether an external process on another host has sent no heartbeat for `limit`.
    pub fn is_external_silent_for(&self, limit: Duration) -> bool {
        self.external.iter().any(|external| external.is_silent_for(self.begin, limit))
    }

    /// Whether an event is more than a missing process already means.
    fn is_told(&self, sample: &SampleEvent) -> bool {
        let is_absent = |external: &ExternalProcess<S>| external.role == sample.from && !external.is_present();
        matches!(sample.event, ProcessEvent::Held(_)) || !self.external.iter().any(is_absent)
    }

    /// Polls the external processes: which joined, recovered, or are silent or missing. Returns the changes.
    fn poll_external(&mut self, slot: u64) -> Vec<(Role, ProcessEvent)> {
        let ring = self.run.ring;
        let now = Instant::now();
        let is_begun = slot > *self.first_slot.get_or_insert(slot);
        let mut events = Vec::new();
        for external in &mut self.external {
            events.extend(external.poll(ring, is_begun, now).map(|event| (external.role, event)));
        }
        if self.is_released || slot >= self.run.last_slot {
            events.clear(); // a regular end
        }
        events
    }
}

impl<S: Service + 'static> Drop for Workers<'_, S> {
    fn drop(&mut self) {
        stop(self.run.workers.iter_mut().map(|worker| &mut worker.process));
        stop(&mut self.run.link); // after those that it connects
    }
}
