//! The link of a ring to other hosts: iceoryx2's own, over zenoh, as a process beside those of the ring.

use std::io::{BufRead, BufReader, pipe};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};
use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_mission::error::FileContext;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::terms::LinkTerms;
use skysink_ring::topics::{LinkedServices, SCHEMA};

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::run::options::is_command;
use crate::run::supervise::{LAST_LINES, REAP};

/// Programs that are iceoryx2's link over zenoh: the first that is found in the PATH is started. The first is in the
/// folder `link` of Skysink, the other is iceoryx2's own.
pub const PROGRAMS: [&str; 2] = ["skysink-link", "iox2-link-tunnel-zenoh"];

/// How often it scans for samples of which no wake-up has reached it [ms].
const POLL_MS: u64 = 10;

/// A first link that ends by itself sooner than this would do so again: its configuration is refused.
const LEAST_LIFE: Duration = Duration::from_secs(2);

/// What it finds in its environment if that has nothing else: the messages that matter; and threads enough that the
/// connection to a host that is gone, whose end may block one for 10 s, does not hold up those to the others.
const ENVIRONMENT: [(&str, &str); 2] = [
    ("IOX2_LOG_LEVEL", "error"),
    (
        "ZENOH_RUNTIME",
        "(tx: (worker_threads: 4), rx: (worker_threads: 4), acc: (worker_threads: 2), net: (worker_threads: 4))",
    ),
];

/// Between the end of a link and the start of the next.
const BACK_OFF: Duration = Duration::from_millis(500);

/// How long it may take to end.
const GRACE: Duration = Duration::from_secs(2);

/// What the hosts of a ring that flies `scenario` must agree on.
///
/// # Errors
/// If its sensor list is refused.
pub fn terms(scenario: &Scenario) -> Result<LinkTerms, InputError> {
    let list = SensorList::of(scenario)?;
    Ok(LinkTerms { version: SCHEMA, scenario: list.hash(scenario.hash()) })
}

/// The link that is installed.
fn program() -> Option<&'static str> {
    PROGRAMS.into_iter().find(|program| is_command(program))
}

fn missing() -> Error {
    let [ours, theirs] = PROGRAMS;
    let message = format!("--link: neither {ours} nor {theirs} is in the PATH: `cargo install --locked --path link`");
    Error::Usage(message)
}

/// Fails if there is no zenoh configuration of this name, or nothing that it configures.
///
/// # Errors
/// [`Error::Usage`].
pub fn check(config: &Path) -> Result<(), Error> {
    if !config.is_file() {
        let config = config.display();
        return Err(Error::Usage(format!("--link {config}: expected a zenoh configuration file, such as link.json5")));
    }
    program().map(drop).ok_or_else(missing)
}

/// A link to other hosts, which is started again when it ends.
#[derive(Debug)]
pub struct Link {
    program: &'static str,
    arguments: Vec<String>,
    ring: PathBuf,
    child: Option<Child>,
    /// Passes on what it says.
    messages: Option<JoinHandle<()>>,
    started: Instant,
    /// Whether one has lived for so long that its configuration is good.
    is_proven: bool,
}

impl Link {
    /// Starts the link of `ring` for the processes `here` on this host, with the zenoh configuration file `config`.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(ring: &RingFolder, config: &Path, here: &[Role], progress: &TerminalProgress) -> Result<Self, Error> {
        let program = program().ok_or_else(missing)?;
        let config = std::path::absolute(config).at(config)?;
        let LinkedServices { all, written_here } = LinkedServices::of(&ring.terms(), here);
        let mut arguments = vec!["--zenoh-config".to_owned(), config.display().to_string()];
        arguments.extend(["--reactive".to_owned(), "--poll".to_owned(), POLL_MS.to_string()]);
        arguments.extend(all.into_iter().flat_map(|service| ["--allow".to_owned(), service]));
        arguments.extend(written_here.into_iter().flat_map(|service| ["--listener".to_owned(), service]));
        let mut link = Self {
            program,
            arguments,
            ring: ring.path().to_owned(),
            child: None,
            messages: None,
            started: Instant::now(),
            is_proven: false,
        };
        link.spawn(progress)?;
        Ok(link)
    }

    /// Starts it again once it has ended.
    ///
    /// # Errors
    /// [`Error::LinkEnded`] if it has ended at once.
    pub fn supervise(&mut self, progress: &TerminalProgress) -> Result<(), Error> {
        let ended = self.child.as_mut().and_then(|child| child.try_wait().ok().flatten());
        if let Some(status) = ended {
            self.child = None;
            self.is_proven |= self.started.elapsed() >= LEAST_LIFE;
            if status.code().is_some() && !self.is_proven {
                self.wait_for_messages();
                return Err(Error::LinkEnded { program: self.program, status: status.to_string() });
            }
            progress.say(&format!("link: ended with {status}: starting it again"));
            self.started = Instant::now();
        }
        if self.child.is_none() && self.started.elapsed() >= BACK_OFF {
            self.spawn(progress)?;
        }
        Ok(())
    }

    /// It finds the ring's iceoryx2 domain in the folder where it runs.
    fn spawn(&mut self, progress: &TerminalProgress) -> Result<(), Error> {
        let program = Path::new(self.program);
        let (output, said) = pipe().at(program)?;
        let mut command = Command::new(program);
        command.args(&self.arguments).current_dir(&self.ring).stdin(Stdio::null());
        command.process_group(0); // Ctrl-C is for the launcher
        for (name, value) in ENVIRONMENT {
            if std::env::var_os(name).is_none() {
                command.env(name, value);
            }
        }
        // A link has no lock by which it would notice that the launcher has died.
        let end_with_launcher = || Ok(set_parent_process_death_signal(Some(Signal::TERM))?);
        // SAFETY: a system call, which neither allocates nor locks.
        unsafe { command.pre_exec(end_with_launcher) };
        let child = command.stdout(said.try_clone().at(program)?).stderr(said).spawn().at(program)?;
        let progress = progress.clone();
        let lines = BufReader::new(output).split(b'\n').map_while(Result::ok);
        let messages = std::thread::spawn(move || {
            lines.for_each(|line| progress.say(&format!("link: {}", String::from_utf8_lossy(&line).trim())));
        });
        self.child = Some(child);
        self.messages = Some(messages);
        self.started = Instant::now();
        Ok(())
    }

    /// Waits for the last lines of a link that has ended.
    fn wait_for_messages(&self) {
        let begin = Instant::now();
        while self.messages.as_ref().is_some_and(|messages| !messages.is_finished()) && begin.elapsed() < LAST_LINES {
            std::thread::sleep(REAP);
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        let id = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        let _ = id.map(|id| kill_process(id, Signal::TERM));
        let begin = Instant::now();
        while begin.elapsed() < GRACE {
            if matches!(child.try_wait(), Ok(Some(_))) {
                return;
            }
            std::thread::sleep(REAP);
        }
        let _ = child.kill();
        let _ = child.wait();
    }
}
