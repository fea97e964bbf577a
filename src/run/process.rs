//! One process of a run: starts it, forwards its output, notices its end, restarts it by its policy, and stops it.

use std::ffi::OsString;
use std::fs;
use std::io::{BufRead, BufReader, pipe};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, WaitOptions, kill_process_group, set_parent_process_death_signal, waitpid};
use skysink_mission::error::FileContext;
use skysink_ring::role::Role;

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::run::restart::{Restart, Restarts};

/// Time between two polls of a process that is about to end.
pub const POLL_EVERY: Duration = Duration::from_millis(5);

/// Maximum wait for the last output of a process that has ended.
const OUTPUT_TIMEOUT: Duration = Duration::from_millis(200);

/// Time from SIGTERM to SIGKILL.
const GRACE: Duration = Duration::from_secs(3);

/// A program with its arguments and surroundings.
#[derive(Debug, Default)]
pub struct Invocation {
    /// The executable, or its name in a folder of PATH.
    pub program: PathBuf,
    pub arguments: Vec<OsString>,
    /// Additional environment variables: name and value.
    pub environment: Vec<(&'static str, OsString)>,
    /// The folder in which it runs; `None` for that of the launcher.
    pub folder: Option<PathBuf>,
    /// What the lines of its output begin with in that of the launcher.
    pub prefix: &'static str,
    /// Whether it must be ended with the launcher, because it does not notice the end itself.
    pub ends_with_launcher: bool,
}

/// A process of a run, which may be started several times.
#[derive(Debug)]
pub struct Process {
    /// `None` for the link to other hosts.
    role: Option<Role>,
    invocation: Invocation,
    /// `None` before the start and after the end.
    child: Option<Child>,
    started: Instant,
    /// Thread that forwards the output.
    messages: Option<JoinHandle<()>>,
    restarts: Restarts,
    /// When to restart it, after it has ended.
    due: Option<Instant>,
    /// Whether it was killed because it did not answer.
    is_hung: bool,
}

/// A change of a process.
#[derive(Debug)]
pub enum ProcessChange {
    /// It has ended; it will be restarted unless its end was expected.
    Ended(ExitStatus),
    /// It was restarted; with the number of its restarts.
    Restarted(i32),
}

impl Process {
    /// The process of `role`, or the link to other hosts, not started yet.
    pub fn new(role: Option<Role>, invocation: Invocation, restarts: Restarts) -> Self {
        Self {
            role,
            invocation,
            child: None,
            started: Instant::now(),
            messages: None,
            restarts,
            due: None,
            is_hung: false,
        }
    }

    /// Starts or restarts the process.
    pub(crate) fn start(&mut self, progress: &TerminalProgress) -> Result<(), Error> {
        self.join_messages();
        self.due = None;
        let Invocation { program, arguments, environment, folder, prefix, ends_with_launcher } = &self.invocation;
        let (output, input) = pipe().at(program)?;
        let mut command = Command::new(program);
        command.args(arguments).envs(environment.iter().map(|(name, value)| (name, value)));
        if let Some(folder) = folder {
            command.current_dir(folder);
        }
        command.stdin(Stdio::null());
        command.stdout(input.try_clone().at(program)?); // standard output is reserved for the launcher
        command.stderr(input);
        command.process_group(0); // only the launcher receives Ctrl-C, and stops the others in order
        if *ends_with_launcher {
            let end_with_launcher = || Ok(set_parent_process_death_signal(Some(Signal::TERM))?);
            // SAFETY: the closure makes one system call; it neither allocates nor locks.
            unsafe { command.pre_exec(end_with_launcher) };
        }
        let child = command.spawn().at(program)?;
        let progress = progress.clone();
        let prefix = *prefix;
        let lines = BufReader::new(output).split(b'\n').map_while(Result::ok);
        self.messages = Some(std::thread::spawn(move || {
            lines.for_each(|line| progress.say(&format!("{prefix}{}", String::from_utf8_lossy(&line).trim_end())));
        }));
        self.child = Some(child);
        self.started = Instant::now();
        self.is_hung = false;
        Ok(())
    }

    /// Its process id while it is running, or has ended without being noticed.
    pub fn pid(&self) -> Option<Pid> {
        self.child.as_ref().and_then(pid)
    }

    /// Whether the process is running.
    pub fn is_running(&self) -> bool {
        self.child.is_some()
    }

    /// Whether the process has ended and will not be restarted.
    pub fn has_ended(&self) -> bool {
        self.child.is_none() && self.due.is_none()
    }

    /// Disables a restart that is due.
    pub fn cancel_restart(&mut self) {
        self.due = None;
    }

    /// Restarts the process in `slot` if that is due, or notices its end, and schedules a restart unless
    /// `is_expected`. Returns the change, if there is one.
    ///
    /// # Errors
    /// [`Error::WorkerEnded`] or [`Error::LinkEnded`] if it has ended and is not restarted, or if it cannot be started.
    pub(crate) fn advance(
        &mut self,
        slot: u64,
        progress: &TerminalProgress,
        is_expected: impl Fn(ExitStatus) -> bool,
    ) -> Result<Option<ProcessChange>, Error> {
        let now = Instant::now();
        if let Some(due) = self.due {
            if now < due {
                return Ok(None);
            }
            self.start(progress)?;
            return Ok(Some(ProcessChange::Restarted(self.restarts.count)));
        }
        let Some(status) = self.poll() else { return Ok(None) };
        if !is_expected(status) {
            let cause = self.restarts.cause(status, slot, self.started.elapsed());
            self.due = self.restarts.schedule(now, cause);
            if self.due.is_none() {
                return Err(self.end_error(status, slot));
            }
        }
        Ok(Some(ProcessChange::Ended(status)))
    }

    /// The exit status, if the process has ended since the last poll.
    fn poll(&mut self) -> Option<ExitStatus> {
        let status = self.child.as_mut()?.try_wait().ok().flatten()?;
        self.signal(Signal::KILL); // its descendants, before a restart
        self.child = None;
        Some(status)
    }

    /// Kills a process that does not answer, if its policy restarts it. Returns whether that is new.
    pub fn kill_hung(&mut self) -> bool {
        let is_killed = self.restarts.policy == Restart::OnFailure;
        if is_killed {
            self.signal(Signal::KILL);
        }
        is_killed && !std::mem::replace(&mut self.is_hung, true)
    }

    /// Sends a signal to the process group, if the process is running.
    fn signal(&self, signal: Signal) {
        if let Some(pid) = self.pid() {
            let _ = kill_process_group(pid, signal); // it may have just ended
        }
    }

    /// Waits for the last output, at most [`OUTPUT_TIMEOUT`]: a descendant may keep the pipe open.
    fn join_messages(&mut self) {
        let Some(messages) = self.messages.take() else { return };
        let begin = Instant::now();
        while !messages.is_finished() && begin.elapsed() < OUTPUT_TIMEOUT {
            std::thread::sleep(POLL_EVERY);
        }
        if messages.is_finished() {
            let _ = messages.join();
        }
    }

    /// The error of a process that is not restarted, after its last output.
    fn end_error(&mut self, status: ExitStatus, slot: u64) -> Error {
        self.join_messages();
        match self.role {
            None => {
                let program = self.invocation.program.display().to_string();
                Error::LinkEnded { program, status: status.to_string() }
            }
            Some(role) => {
                let status = match status.signal() {
                    Some(signal) => format!("signal {signal}"),
                    None => format!("exit code {}", status.code().unwrap_or_default()),
                };
                Error::WorkerEnded { role: role.name(), status: status + &self.restarts.reached_limit(), slot }
            }
        }
    }
}

/// Stops these processes: by SIGTERM, and by SIGKILL those that do not end in time.
pub fn stop<'a>(processes: impl IntoIterator<Item = &'a mut Process>) {
    let mut processes: Vec<_> = processes.into_iter().collect();
    processes.iter().for_each(|process| process.signal(Signal::TERM));
    let deadline = Instant::now() + GRACE;
    while processes.iter().any(|process| process.is_running()) && Instant::now() < deadline {
        for process in &mut processes {
            process.poll();
        }
        std::thread::sleep(POLL_EVERY);
    }
    for process in processes {
        process.signal(Signal::KILL);
        if let Some(mut child) = process.child.take() {
            let _ = child.wait();
        }
        process.join_messages();
    }
}

/// Reaps children that have ended and are not `own`: what a process leaves behind is handed to process 1 of a
/// container, which may be this launcher.
pub fn reap_others(own: &[Pid]) {
    let launcher = std::process::id();
    let children = fs::read_to_string(format!("/proc/{launcher}/task/{launcher}/children")).unwrap_or_default();
    let children = children.split_ascii_whitespace().filter_map(|number| Pid::from_raw(number.parse().ok()?));
    for child in children.filter(|child| !own.contains(child)) {
        let _ = waitpid(Some(child), WaitOptions::NOHANG); // one that runs stays
    }
}

fn pid(child: &Child) -> Option<Pid> {
    i32::try_from(child.id()).ok().and_then(Pid::from_raw)
}
