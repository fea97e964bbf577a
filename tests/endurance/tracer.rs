//! Follows the system calls of a launcher and of its workers, and kills a process, or does something else, just before
//! one of them. It uses ptrace, and so needs no other program.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Error;
use std::os::unix::process::CommandExt as _;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex, mpsc};

use libc::{c_int, pid_t};

use crate::support::WATCHDOG;

/// The `call`-th system call of a process, by the count of all its threads. Only the first process of this name has it:
/// the next one is started instead of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CrashPoint {
    pub process: String,
    pub call: u64,
}

/// A launcher that has ended, and with it all processes that it has started.
#[derive(Debug)]
pub struct Traced {
    pub code: Option<i32>,
    pub signal: Option<i32>,
    pub stderr: String,
    /// The system calls of the first process of each name that was followed.
    pub calls: BTreeMap<String, u64>,
    /// The points that were reached.
    pub reached: Vec<CrashPoint>,
}

/// A process that is followed.
#[derive(Debug)]
struct Process {
    name: String,
    calls: u64,
}

/// Runs a launcher until it and all of its descendants have ended. Fails if they do not. Of the processes of `points`
/// the system calls are counted, and they are killed at these points.
pub fn kill_at(command: Command, points: &[CrashPoint]) -> Traced {
    trace(command, points, kill)
}

/// As [`kill_at`], but calls `act` with the id of the process, which waits.
pub fn trace(mut command: Command, points: &[CrashPoint], act: impl FnMut(pid_t)) -> Traced {
    let stderr = tempfile::NamedTempFile::new().unwrap();
    command.stdout(Stdio::null()).stderr(stderr.reopen().unwrap());
    // SAFETY: the closure makes one system call; it neither allocates nor locks.
    unsafe { command.pre_exec(|| request(libc::PTRACE_TRACEME, 0, 0, 0)) };
    let launcher = pid_t::try_from(command.spawn().expect("a launcher that may be traced").id()).unwrap();
    let running = Arc::new(Mutex::new(BTreeMap::new()));
    let (ended, end) = mpsc::channel::<()>();
    let watched = Arc::clone(&running);
    let watchdog = std::thread::spawn(move || {
        let is_late = end.recv_timeout(WATCHDOG) == Err(mpsc::RecvTimeoutError::Timeout);
        let running = watched.lock().unwrap();
        let names = |process: &pid_t| fs::read_to_string(format!("/proc/{process}/comm")).unwrap_or_default();
        let late: BTreeSet<String> = running.values().map(names).filter(|_| is_late).collect();
        running.values().filter(|_| is_late).for_each(|&process| kill(process));
        late
    });
    let mut tracer =
        Tracer { points, act, running, followed: BTreeMap::new(), seen: BTreeSet::new(), reached: Vec::new() };
    let status = tracer.follow(launcher);
    drop(ended);
    let late = watchdog.join().unwrap();
    assert!(late.is_empty(), "{points:?}: {late:?} did not end within {WATCHDOG:?}");
    Traced {
        code: libc::WIFEXITED(status).then(|| libc::WEXITSTATUS(status)),
        signal: libc::WIFSIGNALED(status).then(|| libc::WTERMSIG(status)),
        stderr: fs::read_to_string(stderr.path()).unwrap(),
        calls: tracer.followed.into_values().map(|process| (process.name, process.calls)).collect(),
        reached: tracer.reached,
    }
}

struct Tracer<'a, A> {
    points: &'a [CrashPoint],
    act: A,
    /// The process of every thread that has stopped once and has not ended.
    running: Arc<Mutex<BTreeMap<pid_t, pid_t>>>,
    /// The followed processes, by id.
    followed: BTreeMap<pid_t, Process>,
    /// The names of processes so far.
    seen: BTreeSet<String>,
    reached: Vec<CrashPoint>,
}

impl<A: FnMut(pid_t)> Tracer<'_, A> {
    /// Serves the stops of all threads until the last one has ended; returns the status of the launcher.
    fn follow(&mut self, launcher: pid_t) -> c_int {
        let mut ended = 0;
        let mut is_set = false;
        loop {
            let mut status = 0;
            // The children of other threads, which are other tests, are none of this one.
            // SAFETY: `status` is written by the call.
            let thread = unsafe { libc::waitpid(-1, &raw mut status, libc::__WALL | libc::__WNOTHREAD) };
            if thread < 0 {
                let error = Error::last_os_error();
                match error.raw_os_error() {
                    Some(libc::ECHILD) => return ended,
                    Some(libc::EINTR) => continue,
                    _ => panic!("waitpid: {error}"),
                }
            }
            if !libc::WIFSTOPPED(status) {
                self.running.lock().unwrap().remove(&thread);
                ended = if thread == launcher { status } else { ended };
                continue;
            }
            if !is_set {
                is_set = true; // the first stop is that of the launcher after its exec
                let options = libc::PTRACE_O_EXITKILL
                    | libc::PTRACE_O_TRACESYSGOOD
                    | libc::PTRACE_O_TRACEEXEC
                    | libc::PTRACE_O_TRACEFORK
                    | libc::PTRACE_O_TRACEVFORK
                    | libc::PTRACE_O_TRACECLONE;
                let _ = request(libc::PTRACE_SETOPTIONS, thread, 0, options as usize);
                self.begin(launcher);
            }
            self.serve(thread, status);
        }
    }

    /// Serves the stop of a thread, and lets it go on.
    fn serve(&mut self, thread: pid_t, status: c_int) {
        let is_new = !self.running.lock().unwrap().contains_key(&thread);
        if is_new {
            self.running.lock().unwrap().insert(thread, process_of(thread));
        }
        let process = self.running.lock().unwrap()[&thread];
        let signal = libc::WSTOPSIG(status);
        let event = status >> 16;
        if event == libc::PTRACE_EVENT_EXEC {
            self.begin(thread);
        } else if signal == libc::SIGTRAP | 0x80 {
            self.count(thread, process);
        }
        let is_from_tracing = event != 0 || signal == libc::SIGTRAP | 0x80 || signal == libc::SIGTRAP;
        let delivered = if is_from_tracing || is_new && signal == libc::SIGSTOP { 0 } else { signal };
        let resume = if self.followed.contains_key(&process) { libc::PTRACE_SYSCALL } else { libc::PTRACE_CONT };
        let _ = request(resume, thread, 0, delivered as usize); // it may have been killed
    }

    /// Follows a process after its exec, if it is the first of its name and of one of the points.
    fn begin(&mut self, process: pid_t) {
        self.followed.remove(&process);
        let Ok(name) = fs::read_to_string(format!("/proc/{process}/comm")) else { return };
        let name = name.trim().to_owned();
        if self.seen.insert(name.clone()) && self.points.iter().any(|point| point.process == name) {
            self.followed.insert(process, Process { name, calls: 0 });
        }
    }

    /// Counts a system call of a thread that is about to begin, and acts if it is time to.
    fn count(&mut self, thread: pid_t, id: pid_t) {
        // SAFETY: all its members are numbers.
        let mut info: libc::ptrace_syscall_info = unsafe { std::mem::zeroed() };
        let size = size_of_val(&info);
        if request(libc::PTRACE_GET_SYSCALL_INFO, thread, size, &raw mut info as usize).is_err()
            || info.op != libc::PTRACE_SYSCALL_INFO_ENTRY
        {
            return;
        }
        let Some(process) = self.followed.get_mut(&id) else { return };
        process.calls += 1;
        let is_here = |point: &&CrashPoint| point.process == process.name && point.call == process.calls;
        if let Some(point) = self.points.iter().find(is_here) {
            (self.act)(id);
            self.reached.push(point.clone());
        }
    }
}

/// The process of a thread.
fn process_of(thread: pid_t) -> pid_t {
    let status = fs::read_to_string(format!("/proc/{thread}/status")).unwrap_or_default();
    let id = status.lines().find_map(|line| line.strip_prefix("Tgid:"));
    id.and_then(|id| id.trim().parse().ok()).unwrap_or(thread) // it was killed
}

fn kill(process: pid_t) {
    // SAFETY: it takes numbers only.
    let _ = unsafe { libc::kill(process, libc::SIGKILL) };
}

fn request(request: libc::c_uint, thread: pid_t, address: usize, data: usize) -> std::io::Result<()> {
    // SAFETY: of all requests made here only PTRACE_GET_SYSCALL_INFO writes, to the struct that it is given.
    match unsafe { libc::ptrace(request, thread, address, data) } {
        -1 => Err(Error::last_os_error()),
        _ => Ok(()),
    }
}
