//! The processes of a run: started, watched, started again, ended.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use rustix::process::{Pid, Signal, kill_process};
use skysink_ring::health::Fate;
use skysink_ring::role::{Role, last_heartbeat};

use crate::error::Error;
use crate::run::restart::{GivenUp, MAX_RESTARTS, Restart, Restarts, WINDOW};
use skysink_mission::error::FileContext;

/// How long a process may take to end after SIGTERM before it gets SIGKILL.
const GRACE: Duration = Duration::from_secs(3);

/// How often a process that is to end is looked at.
pub const REAP: Duration = Duration::from_millis(5);

/// A process that has shown itself and then gives no sign of life for so long is reported.
const SILENT_AFTER: Duration = Duration::from_secs(1);

/// A process to start.
#[derive(Debug)]
pub struct Job {
    /// Its part in the ring.
    pub role: Role,
    /// Its arguments.
    pub arguments: Vec<std::ffi::OsString>,
    /// What is done when it ends too early.
    pub restart: Restart,
}

/// Who takes what the processes write to standard error, line by line.
pub type Say = Arc<dyn Fn(&str) + Send + Sync>;

/// The process ids of the processes that live, by role. While it is locked none of them can become another's.
pub type Roster = Arc<Mutex<BTreeMap<&'static str, Pid>>>;

/// A process of the run.
#[derive(Debug)]
struct Worker {
    job: Job,
    path: PathBuf,
    child: Child,
    ended: Option<ExitStatus>,
    messages: Option<JoinHandle<()>>,
    restarts: Restarts,
    /// When it is to be started again.
    due: Option<Instant>,
    /// Whether it has done its part, however it ends.
    released: bool,
    pulse: Pulse,
}

/// The signs of life of a process.
#[derive(Debug)]
struct Pulse {
    beat: Option<SystemTime>,
    since: Instant,
    state: Sign,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sign {
    /// None yet: it is on its way.
    Awaited,
    Alive,
    Silent,
}

/// All processes of a run; those that still live are ended when it is dropped.
pub struct Crew {
    workers: Vec<Worker>,
    ring: PathBuf,
    patience: Duration,
    say: Say,
    roster: Roster,
}

impl Crew {
    /// Starts the jobs in the ring of the folder `ring`. One that gives no sign of life for `patience` is ended.
    ///
    /// # Errors
    /// If an executable is missing or cannot be started; those started already are ended.
    pub fn start(jobs: Vec<Job>, ring: &Path, patience: Duration, say: Say) -> Result<Self, Error> {
        let paths: Vec<PathBuf> = jobs.iter().map(|job| executable(job.role)).collect::<Result<_, _>>()?;
        let mut crew = Self { workers: Vec::new(), ring: ring.to_owned(), patience, say, roster: Roster::default() };
        for (job, path) in jobs.into_iter().zip(paths) {
            let (child, messages) = spawn(&path, &job, &crew.say, &crew.roster)?;
            let (restarts, pulse) = (Restarts::new(job.restart), Pulse::begin(None));
            crew.workers.push(Worker {
                job,
                path,
                child,
                ended: None,
                messages,
                restarts,
                due: None,
                released: false,
                pulse,
            });
        }
        Ok(crew)
    }

    /// The processes that live.
    #[must_use]
    pub fn roster(&self) -> Roster {
        Arc::clone(&self.roster)
    }

    /// Looks after the processes: notes who has ended, starts again what is due, and listens for signs of life. Returns
    /// what has become of whom. `slot` is the one under way; one that ends well in the last slot has done its part.
    ///
    /// # Errors
    /// [`Error::WorkerEnded`] if one has ended that is not started again.
    pub fn tend(&mut self, slot: u64, last_slot: u64) -> Result<Vec<(Role, Fate)>, Error> {
        let mut fates = Vec::new();
        let now = Instant::now();
        for worker in &mut self.workers {
            let role = worker.job.role;
            if let Some(due) = worker.due {
                if now >= due {
                    worker.start_again(&self.ring, &self.say, &self.roster)?;
                    fates.push((role, Fate::Restarted(worker.restarts.count)));
                }
                continue;
            }
            if worker.ended.is_some() {
                continue;
            }
            if let Some(status) = worker.look(&self.roster) {
                if worker.released || status.success() && slot >= last_slot {
                    continue;
                }
                fates.push((role, fate(status)));
                let refused = status.code() == Some(2);
                worker.due = Some(worker.restarts.next(now, refused).map_err(|why| ended(role, status, why, slot))?);
                continue;
            }
            if let Some(fate) = worker.pulse.feel(last_heartbeat(&self.ring, role), now) {
                fates.push((role, fate));
            }
            let hung = worker.pulse.silent_for(self.patience, now) && slot < last_slot;
            if hung && worker.job.restart == Restart::OnFailure {
                worker.signal(Signal::KILL);
            }
        }
        Ok(fates)
    }

    /// The folder in which the processes meet.
    #[must_use]
    pub fn ring(&self) -> &Path {
        &self.ring
    }

    /// All processes have done their part: none is started again.
    pub fn release(&mut self) {
        for worker in &mut self.workers {
            worker.released = true;
            worker.due = None;
        }
    }

    /// Whether the process of `role` has ended for good, if it is one of these.
    #[must_use]
    pub fn has_ended(&self, role: Role) -> bool {
        self.workers.iter().filter(|worker| worker.job.role == role).all(Worker::has_ended)
    }

    /// Whether all have.
    #[must_use]
    pub fn have_ended(&self) -> bool {
        self.workers.iter().all(Worker::has_ended)
    }
}

impl Worker {
    /// Whether it has ended and is not started again.
    fn has_ended(&self) -> bool {
        self.ended.is_some() && self.due.is_none()
    }

    /// Notes if it has ended, and says how.
    fn look(&mut self, roster: &Roster) -> Option<ExitStatus> {
        if self.ended.is_none() {
            let mut roster = roster.lock().unwrap_or_else(PoisonError::into_inner);
            self.ended = self.child.try_wait().ok().flatten();
            if self.ended.is_some() {
                roster.remove(self.job.role.name());
            }
        }
        self.ended
    }

    fn start_again(&mut self, ring: &Path, say: &Say, roster: &Roster) -> Result<(), Error> {
        self.join_messages();
        let pulse = Pulse::begin(last_heartbeat(ring, self.job.role));
        (self.child, self.messages) = spawn(&self.path, &self.job, say, roster)?;
        (self.ended, self.due, self.pulse) = (None, None, pulse);
        Ok(())
    }

    fn signal(&self, signal: Signal) {
        if let Some(pid) = pid(&self.child) {
            let _ = kill_process(pid, signal); // it may have ended at this moment
        }
    }

    fn join_messages(&mut self) {
        if let Some(messages) = self.messages.take() {
            let _ = messages.join();
        }
    }
}

impl Pulse {
    /// Nothing yet but `beat`, which the process before it has left.
    fn begin(beat: Option<SystemTime>) -> Self {
        Self { beat, since: Instant::now(), state: Sign::Awaited }
    }

    /// Takes notice of the last sign of life; returns what is new.
    fn feel(&mut self, beat: Option<SystemTime>, now: Instant) -> Option<Fate> {
        let silence = now.saturating_duration_since(self.since);
        let ms = u32::try_from(silence.as_millis()).unwrap_or(u32::MAX);
        if self.beat != beat {
            let before = std::mem::replace(&mut self.state, Sign::Alive);
            (self.beat, self.since) = (beat, now);
            return (before == Sign::Silent).then_some(Fate::Back(ms));
        }
        if self.state == Sign::Alive && silence >= SILENT_AFTER {
            self.state = Sign::Silent;
            return Some(Fate::Silent(ms));
        }
        None
    }

    /// Whether there has been no sign of life for so long.
    fn silent_for(&self, long: Duration, now: Instant) -> bool {
        self.state == Sign::Silent && now.saturating_duration_since(self.since) >= long
    }
}

impl Drop for Crew {
    fn drop(&mut self) {
        for worker in &mut self.workers {
            if worker.look(&self.roster).is_none() {
                worker.signal(Signal::TERM);
            }
        }
        let deadline = Instant::now() + GRACE;
        while self.workers.iter().any(|worker| worker.ended.is_none()) && Instant::now() < deadline {
            for worker in &mut self.workers {
                worker.look(&self.roster);
            }
            std::thread::sleep(REAP);
        }
        for worker in &mut self.workers {
            if worker.ended.is_none() {
                worker.signal(Signal::KILL);
                let _ = worker.child.wait();
            }
            worker.join_messages();
        }
    }
}

/// A process, and the thread that takes its messages.
type Spawned = (Child, Option<JoinHandle<()>>);

fn spawn(path: &Path, job: &Job, say: &Say, roster: &Roster) -> Result<Spawned, Error> {
    let mut child = Command::new(path)
        .args(&job.arguments)
        .stdin(Stdio::null())
        .stderr(Stdio::piped())
        .process_group(0) // Ctrl-C is for the launcher, which ends the others in order
        .spawn()
        .at(path)?;
    if let Some(pid) = pid(&child) {
        roster.lock().unwrap_or_else(PoisonError::into_inner).insert(job.role.name(), pid);
    }
    let messages = child.stderr.take().map(|stderr| {
        let say = Arc::clone(say);
        std::thread::spawn(move || BufReader::new(stderr).lines().map_while(Result::ok).for_each(|line| say(&line)))
    });
    Ok((child, messages))
}

fn pid(child: &Child) -> Option<Pid> {
    i32::try_from(child.id()).ok().and_then(Pid::from_raw)
}

/// The executable of a role, which lies beside this one.
fn executable(role: Role) -> Result<PathBuf, Error> {
    let own = std::env::current_exe().at(Path::new("skysink"))?;
    let path = own.with_file_name(role.name());
    if path.is_file() { Ok(path) } else { Err(Error::ExecutableMissing(path)) }
}

fn fate(status: ExitStatus) -> Fate {
    match status.signal() {
        Some(signal) => Fate::Killed(signal),
        None => Fate::Exited(status.code().unwrap_or_default()),
    }
}

fn ended(role: Role, status: ExitStatus, why: GivenUp, slot: u64) -> Error {
    let status = match status.signal() {
        Some(signal) => format!("signal {signal}"),
        None => format!("exit code {}", status.code().unwrap_or_default()),
    };
    let status = match why {
        GivenUp::AtOnce => status,
        GivenUp::TooOften => {
            format!("{status}, after {MAX_RESTARTS} restarts within {} s", WINDOW.as_secs())
        }
    };
    Error::WorkerEnded { role: role.name(), status, slot, whole: whole(slot) }
}

/// What is left of a run that ends in `slot`.
pub(crate) fn whole(slot: u64) -> String {
    match slot {
        0 => "nothing was flown".to_owned(),
        _ => format!("the run folder is whole up to slot {}", slot - 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_without_a_pulse_is_reported_once_and_welcomed_back() {
        let mut pulse = Pulse::begin(None);
        let start = pulse.since;
        let at = |ms| start + Duration::from_millis(ms);
        let beat = |ms| Some(SystemTime::UNIX_EPOCH + Duration::from_millis(ms));
        assert_eq!(pulse.feel(None, at(5_000)), None, "it may still be on its way");
        assert_eq!(pulse.feel(beat(1), at(5_100)), None);
        assert_eq!(pulse.feel(beat(1), at(6_000)), None);
        assert_eq!(pulse.feel(beat(1), at(6_200)), Some(Fate::Silent(1_100)));
        assert_eq!(pulse.feel(beat(1), at(7_000)), None);
        assert_eq!(pulse.feel(beat(2), at(7_600)), Some(Fate::Back(2_500)));
        assert_eq!(pulse.feel(beat(2), at(7_700)), None);
    }
}
