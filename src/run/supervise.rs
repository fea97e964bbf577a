//! The processes of a run: started, supervised, started again, ended. What becomes of them is told to everybody.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, pipe};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use iceoryx2::prelude::Service;
use rustix::process::{Pid, Signal, kill_process_group};
use skysink_common::message::SlotHeader;
use skysink_mission::error::FileContext;
use skysink_mission::summary::{Event, Tally};
use skysink_ring::folder::RingFolder;
use skysink_ring::health::{Health, ProcessEvent};
use skysink_ring::role::{Role, last_heartbeat, start_count};
use skysink_ring::topics::Ring;
use skysink_ring::writer::Writer;

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::run::heartbeat::Heartbeat;
use crate::run::link::Link;
use crate::run::outside::Outside;
use crate::run::restart::{End, Restart, Restarts};

/// How long a process may take to end after SIGTERM before it gets SIGKILL.
const GRACE: Duration = Duration::from_secs(3);

/// How often a process that is to end is polled.
pub const REAP: Duration = Duration::from_millis(5);

/// What other threads may know of a run under way.
#[derive(Debug, Default)]
pub struct ProcessTable {
    ids: Mutex<BTreeMap<&'static str, Pid>>,
    /// The slot under way, a tenth of a second ago at most.
    pub slot: AtomicU64,
    /// Beginning of the names of its shared memory, once there is some.
    pub shared_prefix: OnceLock<String>,
}

impl ProcessTable {
    /// The ids of the processes that live, by role. While it is locked none of them can become another's.
    pub fn ids(&self) -> MutexGuard<'_, BTreeMap<&'static str, Pid>> {
        self.ids.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// How long the last lines of a process that has ended are waited for.
pub(crate) const LAST_LINES: Duration = Duration::from_millis(200);

/// How often a run looks for dead processes among those that the launcher did not start.
const CLEAN_UP_EVERY: Duration = Duration::from_millis(500);

/// A program with its arguments and what is added to its environment.
#[derive(Debug)]
pub struct Invocation {
    /// The executable, or a name to be found in the PATH.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<OsString>,
    /// Variables by name.
    pub environment: Vec<(&'static str, OsString)>,
}

/// A process of a run, which may be started several times.
#[derive(Debug)]
pub struct Process {
    role: Role,
    invocation: Invocation,
    /// None before it is started and once it has ended.
    child: Option<Child>,
    /// Passes on what it writes to standard error.
    messages: Option<JoinHandle<()>>,
    restarts: Restarts,
    /// When it is to be started again.
    due: Option<Instant>,
    heartbeat: Heartbeat,
}

/// All processes of a run; those that still live are ended when it is dropped.
pub struct Workers<'a, S: Service + 'static> {
    ring: &'a Ring<S>,
    folder: &'a RingFolder,
    table: &'a ProcessTable,
    progress: &'a TerminalProgress,
    processes: Vec<Process>,
    outside: Vec<Outside<S>>,
    /// What carries the samples to other hosts.
    link: Option<Link>,
    swept: Instant,
    health: Writer<S, Health, SlotHeader>,
    begin: Instant,
    last_slot: u64,
    is_released: bool,
    /// Restart count of the viewer that is there, or will be there next.
    viewer: u32,
}

impl<'a, S: Service + 'static> Workers<'a, S> {
    /// Starts the processes of a mission that ends with `last_slot`; the roles `outside` are somebody else's.
    ///
    /// # Errors
    /// If the topic `health` cannot be written, or a process cannot be started; those started already are ended.
    pub fn start(
        ring: &'a Ring<S>,
        folder: &'a RingFolder,
        table: &'a ProcessTable,
        progress: &'a TerminalProgress,
        processes: Vec<Process>,
        outside: &[Role],
        last_slot: u64,
    ) -> Result<Self, Error> {
        let health = ring.health.writer()?;
        let begin = Instant::now();
        let outside = outside.iter().map(|&role| Outside::new(ring, role));
        let mut workers = Self {
            outside: outside.collect::<Result<_, _>>()?,
            link: None,
            swept: begin,
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

    /// Supervises `link`, too, if there is one.
    #[must_use]
    pub fn with_link(mut self, link: Option<Link>) -> Self {
        self.link = link;
        self
    }

    /// Supervises the processes, of which one may be overdue, for so long. Tells the tally, the terminal and the ring
    /// what has become of whom, and returns the restart count of the current viewer, by its seat.
    ///
    /// # Errors
    /// [`Error::WorkerEnded`] if one has ended that is not started again.
    pub fn supervise(&mut self, tally: &mut Tally, overdue: Option<(Role, Duration)>) -> Result<u32, Error> {
        self.progress.show_run(tally, self.last_slot);
        let slot = tally.last_slot() + 1;
        for (role, fate) in self.watch(slot, overdue)? {
            let at_s = self.begin.elapsed().as_secs_f64();
            let is_restart = matches!(fate, ProcessEvent::Restarted(_));
            tally.add_event(Event { slot, at_s, process: role.name().into(), event: fate.to_string() }, is_restart);
        }
        Ok(self.viewer)
    }

    /// Supervises the processes in `slot`, of which one may be overdue, for so long. Tells the terminal and the ring
    /// what has become of whom, and returns it.
    ///
    /// # Errors
    /// [`Error::WorkerEnded`] or [`Error::LinkEnded`] if one has ended that is not started again.
    pub fn watch(&mut self, slot: u64, overdue: Option<(Role, Duration)>) -> Result<Vec<(Role, ProcessEvent)>, Error> {
        self.table.slot.store(slot, Ordering::Relaxed);
        if let Some(link) = &mut self.link {
            link.supervise(self.progress)?;
        }
        let mut fates = self.poll(slot, overdue)?;
        fates.extend(self.poll_outside(slot, overdue));
        let taken = start_count(self.folder.path(), Role::Viewer);
        self.viewer = self.viewer.max(taken.saturating_sub(1));
        for &(role, fate) in &fates {
            if let ProcessEvent::Killed(_) | ProcessEvent::Exited(_) = fate {
                self.ring.remove_dead_nodes(); // before the next one needs its place
                if role == Role::Viewer {
                    self.viewer = taken; // the next one's
                }
            }
            let process = role.name();
            self.progress.say(&format!("slot {slot}: {process} {fate}"));
            self.health.send(self.ring.header(slot, 0), Health::of(role, fate))?;
        }
        Ok(fates)
    }

    /// Starts no process again: all have done their part.
    pub fn release(&mut self) {
        self.is_released = true;
    }

    /// Whether all processes have ended for good that `is_meant`.
    #[must_use]
    pub fn have_ended(&self, is_meant: impl Fn(Role) -> bool) -> bool {
        self.processes.iter().filter(|process| is_meant(process.role)).all(Process::has_ended)
    }

    /// Notes who has ended, starts again what is due, ends what hangs, and returns what is new.
    fn poll(&mut self, slot: u64, overdue: Option<(Role, Duration)>) -> Result<Vec<(Role, ProcessEvent)>, Error> {
        let mut fates = Vec::new();
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
                    fates.push((process.role, ProcessEvent::Restarted(process.restarts.count)));
                }
            } else if let Some(status) = process.poll(self.table) {
                if self.is_released || status.success() && is_last_slot {
                    continue; // it has done its part
                }
                let end = match (status.code(), status.signal()) {
                    (Some(2), _) => End::Refused,
                    (None, Some(9 | 15)) => End::Killed, // SIGKILL, SIGTERM: by somebody else
                    _ => End::Exited(slot),
                };
                process.due = process.restarts.next(now, end);
                if process.due.is_none() {
                    return Err(process.given_up(status, slot.min(self.last_slot)));
                }
                let exited = ProcessEvent::Exited(status.code().unwrap_or_default());
                fates.push((process.role, status.signal().map_or(exited, ProcessEvent::Killed)));
            } else if process.child.is_some() {
                let fate = process.heartbeat.note(last_heartbeat(ring, process.role), now);
                fates.extend(fate.map(|fate| (process.role, fate)));
                let mut hangs = process.heartbeat.is_silent_for(self.ring.terms.silence_limit()) && !is_last_slot;
                if let Some((_, waited)) = overdue.filter(|(role, _)| *role == process.role) {
                    hangs = true;
                    fates.push((process.role, overdue_for(waited)));
                }
                if hangs && process.restarts.policy == Restart::OnFailure {
                    process.signal(Signal::KILL);
                }
            }
        }
        Ok(fates)
    }

    /// Whether a process of another host shows that it is alive.
    #[must_use]
    pub fn hears_others(&self) -> bool {
        self.outside.iter().any(Outside::is_heard)
    }

    /// Whether a process of another host has given no sign of life for so long.
    #[must_use]
    pub fn misses_others(&self, limit: Duration) -> bool {
        self.outside.iter().any(|outside| outside.is_missed(self.begin, limit))
    }

    /// Notes which process of somebody else has joined, has gone, is silent, or is overdue.
    fn poll_outside(&mut self, slot: u64, overdue: Option<(Role, Duration)>) -> Vec<(Role, ProcessEvent)> {
        let now = Instant::now();
        if !self.outside.is_empty() && self.swept.elapsed() >= CLEAN_UP_EVERY {
            self.swept = now;
            self.ring.remove_dead_nodes(); // a dead writer stays attached until then
        }
        let mut fates = Vec::new();
        for outside in &mut self.outside {
            fates.extend(outside.poll(self.ring, now).map(|fate| (outside.role, fate)));
            if let Some((_, waited)) = overdue.filter(|(role, _)| *role == outside.role && outside.is_there()) {
                fates.push((outside.role, overdue_for(waited)));
            }
        }
        if self.is_released || slot >= self.last_slot {
            fates.clear(); // they have done their part
        }
        fates
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
            std::thread::sleep(REAP);
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

impl Process {
    /// The process of `role`, to be started so.
    #[must_use]
    pub fn new(role: Role, invocation: Invocation, restart: Restart) -> Self {
        Self {
            role,
            invocation,
            child: None,
            messages: None,
            restarts: Restarts::new(restart),
            due: None,
            heartbeat: Heartbeat::after(None),
        }
    }

    /// Starts it, for the first time or again, in the ring of the folder `ring`.
    fn start(&mut self, ring: &Path, table: &ProcessTable, progress: &TerminalProgress) -> Result<(), Error> {
        self.join_messages();
        self.due = None;
        self.heartbeat = Heartbeat::after(last_heartbeat(ring, self.role));
        let Invocation { program, arguments, environment } = &self.invocation;
        let (output, said) = pipe().at(program)?;
        let child = Command::new(program)
            .args(arguments)
            .envs(environment.iter().map(|(name, value)| (name, value)))
            .stdin(Stdio::null())
            .stdout(said.try_clone().at(program)?) // standard output is the launcher's
            .stderr(said)
            .process_group(0) // Ctrl-C is for the launcher, which ends the others in order
            .spawn()
            .at(program)?;
        if let Some(pid) = pid(&child) {
            table.ids().insert(self.role.name(), pid);
        }
        let progress = progress.clone();
        let lines = BufReader::new(output).split(b'\n').map_while(Result::ok);
        self.messages = Some(std::thread::spawn(move || {
            lines.for_each(|line| progress.say(&String::from_utf8_lossy(&line)));
        }));
        self.child = Some(child);
        Ok(())
    }

    /// Whether it has ended and is not started again.
    fn has_ended(&self) -> bool {
        self.child.is_none() && self.due.is_none()
    }

    /// How it has ended, if it has since the last poll.
    fn poll(&mut self, table: &ProcessTable) -> Option<ExitStatus> {
        let mut ids = table.ids();
        let status = self.child.as_mut()?.try_wait().ok().flatten()?;
        self.signal(Signal::KILL); // what it had started: the next one takes its place
        ids.remove(self.role.name());
        self.child = None;
        Some(status)
    }

    /// Sends it, and what it has started, a signal, if it lives.
    fn signal(&self, signal: Signal) {
        if let Some(pid) = self.child.as_ref().and_then(pid) {
            let _ = kill_process_group(pid, signal); // it may have ended at this moment
        }
    }

    /// Waits for its last lines; not for long: what it has started may have inherited its output, and live on.
    fn join_messages(&mut self) {
        let Some(messages) = self.messages.take() else { return };
        let begin = Instant::now();
        while !messages.is_finished() && begin.elapsed() < LAST_LINES {
            std::thread::sleep(REAP);
        }
        if messages.is_finished() {
            let _ = messages.join();
        }
    }

    fn given_up(&self, status: ExitStatus, slot: u64) -> Error {
        let status = match status.signal() {
            Some(signal) => format!("signal {signal}"),
            None => format!("exit code {}", status.code().unwrap_or_default()),
        };
        Error::WorkerEnded { role: self.role.name(), status: status + &self.restarts.limit(), slot }
    }
}

fn overdue_for(waited: Duration) -> ProcessEvent {
    ProcessEvent::Overdue(i32::try_from(waited.as_millis()).unwrap_or(i32::MAX))
}

fn pid(child: &Child) -> Option<Pid> {
    i32::try_from(child.id()).ok().and_then(Pid::from_raw)
}
