//! One process of a run: starts it, polls its state, sends signals, and forwards its output.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, pipe};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};
use skysink_mission::error::FileContext;
use skysink_ring::role::{Role, last_heartbeat};

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::run::heartbeat::Heartbeat;
use crate::run::restart::{Restart, Restarts};

/// Time between two polls of a process that is about to end.
pub const POLL_EVERY: Duration = Duration::from_millis(5);

/// The state of a run that is shared with other threads.
#[derive(Debug, Default)]
pub struct ProcessTable {
    ids: Mutex<BTreeMap<&'static str, Pid>>,
    /// The current slot, at most a tenth of a second old.
    pub slot: AtomicU64,
    /// Prefix of the names of the run's shared memory; set once the ring exists.
    pub shared_prefix: OnceLock<String>,
}

impl ProcessTable {
    /// The ids of the running processes, by role. While the guard is held, no id is reused.
    pub fn ids(&self) -> MutexGuard<'_, BTreeMap<&'static str, Pid>> {
        self.ids.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Maximum wait for the last output of a process that has ended.
pub(crate) const OUTPUT_TIMEOUT: Duration = Duration::from_millis(200);

/// A program with its arguments and additions to its environment.
#[derive(Debug)]
pub struct Invocation {
    /// The executable, or its name in a folder of PATH.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<OsString>,
    /// Additional environment variables: name and value.
    pub environment: Vec<(&'static str, OsString)>,
}

/// A process of a run, which may be started several times.
#[derive(Debug)]
pub struct Process {
    pub(super) role: Role,
    invocation: Invocation,
    /// `None` before the start and after the end.
    pub(super) child: Option<Child>,
    /// Thread that forwards the output.
    messages: Option<JoinHandle<()>>,
    pub(super) restarts: Restarts,
    /// When to restart it, after it has ended.
    pub(super) due: Option<Instant>,
    pub(super) heartbeat: Heartbeat,
}

impl Process {
    /// The process of `role`, not started yet.
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

    /// Starts or restarts the process in the ring with the folder `ring`.
    pub(super) fn start(
        &mut self,
        ring: &Path,
        table: &ProcessTable,
        progress: &TerminalProgress,
    ) -> Result<(), Error> {
        self.join_messages();
        self.due = None;
        self.heartbeat = Heartbeat::after(last_heartbeat(ring, self.role));
        let Invocation { program, arguments, environment } = &self.invocation;
        let (output, input) = pipe().at(program)?;
        let child = Command::new(program)
            .args(arguments)
            .envs(environment.iter().map(|(name, value)| (name, value)))
            .stdin(Stdio::null())
            .stdout(input.try_clone().at(program)?) // standard output is reserved for the launcher
            .stderr(input)
            .process_group(0) // only the launcher receives Ctrl-C, and stops the others in order
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

    /// Whether the process has ended and will not be restarted.
    pub(super) fn has_ended(&self) -> bool {
        self.child.is_none() && self.due.is_none()
    }

    /// The exit status, if the process has ended since the last poll.
    pub(super) fn poll(&mut self, table: &ProcessTable) -> Option<ExitStatus> {
        let mut ids = table.ids();
        let status = self.child.as_mut()?.try_wait().ok().flatten()?;
        self.signal(Signal::KILL); // its descendants, before a restart
        ids.remove(self.role.name());
        self.child = None;
        Some(status)
    }

    /// Sends a signal to the process group, if the process is running.
    pub(super) fn signal(&self, signal: Signal) {
        if let Some(pid) = self.child.as_ref().and_then(pid) {
            let _ = kill_process_group(pid, signal); // it may have just ended
        }
    }

    /// Waits for the last output, at most [`OUTPUT_TIMEOUT`]: a descendant may keep the pipe open.
    pub(super) fn join_messages(&mut self) {
        let Some(messages) = self.messages.take() else { return };
        let begin = Instant::now();
        while !messages.is_finished() && begin.elapsed() < OUTPUT_TIMEOUT {
            std::thread::sleep(POLL_EVERY);
        }
        if messages.is_finished() {
            let _ = messages.join();
        }
    }

    /// The error of a process that is not restarted.
    pub(super) fn end_error(&self, status: ExitStatus, slot: u64) -> Error {
        let status = match status.signal() {
            Some(signal) => format!("signal {signal}"),
            None => format!("exit code {}", status.code().unwrap_or_default()),
        };
        Error::WorkerEnded { role: self.role.name(), status: status + &self.restarts.reached_limit(), slot }
    }
}

fn pid(child: &Child) -> Option<Pid> {
    i32::try_from(child.id()).ok().and_then(Pid::from_raw)
}
