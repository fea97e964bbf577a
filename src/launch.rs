//! The processes of a run: started, watched, ended.

use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use skysink_common::node::Role;

use crate::error::Error;

/// How long a process may take to end after SIGTERM before it gets SIGKILL.
const GRACE: Duration = Duration::from_secs(3);

/// How often a process that is to end is looked at.
const REAP: Duration = Duration::from_millis(5);

/// A process to start.
#[derive(Debug)]
pub struct Job {
    /// Its part in the ring.
    pub role: Role,
    /// Its arguments.
    pub arguments: Vec<std::ffi::OsString>,
}

/// A process of the run.
#[derive(Debug)]
struct Worker {
    role: Role,
    child: Child,
    ended: Option<ExitStatus>,
    messages: Option<JoinHandle<()>>,
}

/// All processes of a run; those that still live are ended when it is dropped.
#[derive(Debug, Default)]
pub struct Crew {
    workers: Vec<Worker>,
}

impl Crew {
    /// Starts the jobs; what they write to standard error goes to `say`, line by line.
    ///
    /// # Errors
    /// If an executable is missing or cannot be started; those started already are ended.
    pub fn start(jobs: Vec<Job>, say: impl Fn(&str) + Clone + Send + 'static) -> Result<Self, Error> {
        let paths: Vec<PathBuf> = jobs.iter().map(|job| executable(job.role)).collect::<Result<_, _>>()?;
        let mut crew = Self::default();
        for (job, path) in jobs.into_iter().zip(paths) {
            let mut child = Command::new(&path)
                .args(job.arguments)
                .stdin(Stdio::null())
                .stderr(Stdio::piped())
                .process_group(0) // Ctrl-C is for the launcher, which ends the others in order
                .spawn()
                .map_err(Error::file(&path))?;
            let messages = child.stderr.take().map(|stderr| {
                let say = say.clone();
                std::thread::spawn(move || {
                    BufReader::new(stderr).lines().map_while(Result::ok).for_each(|line| say(&line));
                })
            });
            crew.workers.push(Worker { role: job.role, child, ended: None, messages });
        }
        Ok(crew)
    }

    /// Fails if a process has ended otherwise than well. `slot` is the one under way.
    ///
    /// # Errors
    /// [`Error::WorkerEnded`].
    pub fn check(&mut self, slot: u64) -> Result<(), Error> {
        for worker in &mut self.workers {
            worker.look();
            if let Some(status) = worker.ended.filter(|status| !status.success()) {
                return Err(ended(worker.role, status, slot));
            }
        }
        Ok(())
    }

    /// Waits until all processes have ended by themselves, at most for `limit`.
    ///
    /// # Errors
    /// [`Error::WorkerEnded`] if one ends badly, or not at all.
    pub fn finish(
        mut self,
        limit: Duration,
        slot: u64,
        mut alive: impl FnMut() -> Result<(), Error>,
    ) -> Result<(), Error> {
        let deadline = Instant::now() + limit;
        loop {
            self.check(slot)?;
            let Some(slow) = self.workers.iter().find(|worker| worker.ended.is_none()) else { return Ok(()) };
            if Instant::now() > deadline {
                let status = format!("nothing: it did not end within {} s after the mission", limit.as_secs_f64());
                return Err(Error::WorkerEnded { role: slow.role.name(), status, slot, whole: whole(slot) });
            }
            alive()?;
            std::thread::sleep(REAP);
        }
    }
}

impl Worker {
    /// Notes if it has ended.
    fn look(&mut self) {
        if self.ended.is_none() {
            self.ended = self.child.try_wait().ok().flatten();
        }
    }

    fn signal(&self, signal: Signal) {
        if let Some(pid) = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw) {
            let _ = kill_process(pid, signal); // it may have ended at this moment
        }
    }
}

impl Drop for Crew {
    fn drop(&mut self) {
        for worker in &mut self.workers {
            worker.look();
            if worker.ended.is_none() {
                worker.signal(Signal::TERM);
            }
        }
        let deadline = Instant::now() + GRACE;
        while self.workers.iter().any(|worker| worker.ended.is_none()) && Instant::now() < deadline {
            self.workers.iter_mut().for_each(Worker::look);
            std::thread::sleep(REAP);
        }
        for worker in &mut self.workers {
            if worker.ended.is_none() {
                worker.signal(Signal::KILL);
                let _ = worker.child.wait();
            }
            if let Some(messages) = worker.messages.take() {
                let _ = messages.join();
            }
        }
    }
}

/// The executable of a role, which lies beside this one.
fn executable(role: Role) -> Result<PathBuf, Error> {
    let own = std::env::current_exe().map_err(Error::file(Path::new("skysink")))?;
    let path = own.with_file_name(role.name());
    if path.is_file() { Ok(path) } else { Err(Error::ExecutableMissing(path)) }
}

fn ended(role: Role, status: ExitStatus, slot: u64) -> Error {
    let status = match status.signal() {
        Some(signal) => format!("signal {signal}"),
        None => format!("exit code {}", status.code().unwrap_or_default()),
    };
    Error::WorkerEnded { role: role.name(), status, slot, whole: whole(slot) }
}

/// What is left of a run that ends in `slot`.
fn whole(slot: u64) -> String {
    match slot {
        0 => "nothing was flown".to_owned(),
        _ => format!("the run folder is whole up to slot {}", slot - 1),
    }
}
