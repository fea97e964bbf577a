//! The link of a ring to other hosts: a process that runs iceoryx2's tunnel over zenoh.

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
use crate::programs::is_command;
use crate::report::TerminalProgress;
use crate::run::process::{OUTPUT_TIMEOUT, POLL_EVERY};

/// Link programs; the first one found in PATH is started. `skysink-link` is in the folder `link` of this repository,
/// `iox2-link-tunnel-zenoh` is part of iceoryx2.
pub const PROGRAMS: [&str; 2] = ["skysink-link", "iox2-link-tunnel-zenoh"];

/// Time between two scans of the link for samples without an event [ms].
const POLL_MS: u64 = 10;

/// If the first link exits sooner than this, its configuration is considered invalid and it is not restarted.
const MIN_LIFETIME: Duration = Duration::from_secs(2);

/// Environment variables of the link, unless they are set already. They limit the log to errors, and set enough threads
/// that closing the connection to a lost host, which can block a thread for 10 s, does not delay other connections.
const ENVIRONMENT: [(&str, &str); 2] = [
    ("IOX2_LOG_LEVEL", "error"),
    (
        "ZENOH_RUNTIME",
        "(tx: (worker_threads: 4), rx: (worker_threads: 4), acc: (worker_threads: 2), net: (worker_threads: 4))",
    ),
];

/// Minimum time between two starts of the link.
const BACK_OFF: Duration = Duration::from_millis(500);

/// Time from SIGTERM to SIGKILL.
const GRACE: Duration = Duration::from_secs(2);

/// The terms that all hosts of a ring with this scenario must agree on.
///
/// # Errors
/// If its sensor list is refused.
pub fn terms(scenario: &Scenario) -> Result<LinkTerms, InputError> {
    let list = SensorList::of(scenario)?;
    Ok(LinkTerms { version: SCHEMA, scenario: list.hash(scenario.hash()) })
}

/// The installed link program.
fn find_program() -> Option<&'static str> {
    PROGRAMS.into_iter().find(|program| is_command(program))
}

fn missing_program() -> Error {
    let [ours, theirs] = PROGRAMS;
    let message = format!("--link: neither {ours} nor {theirs} is in the PATH: `cargo install --locked --path link`");
    Error::Usage(message)
}

/// Checks that the configuration file exists and a link program is installed.
///
/// # Errors
/// [`Error::Usage`].
pub fn check(config: &Path) -> Result<(), Error> {
    if !config.is_file() {
        let config = config.display();
        return Err(Error::Usage(format!("--link {config}: expected a zenoh configuration file, such as link.json5")));
    }
    find_program().map(drop).ok_or_else(missing_program)
}

/// A link to other hosts. It is restarted when it ends.
#[derive(Debug)]
pub struct Link {
    program: &'static str,
    arguments: Vec<String>,
    ring: PathBuf,
    child: Option<Child>,
    /// Thread that forwards the output.
    messages: Option<JoinHandle<()>>,
    started: Instant,
    /// Whether a link has run long enough to consider its configuration valid.
    is_config_valid: bool,
}

impl Link {
    /// Starts the link of `ring` with the zenoh configuration file `config`. `local` are the roles of the processes on
    /// this host.
    ///
    /// # Errors
    /// If the link cannot be started.
    pub fn start(ring: &RingFolder, config: &Path, local: &[Role], progress: &TerminalProgress) -> Result<Self, Error> {
        let program = find_program().ok_or_else(missing_program)?;
        let config = std::path::absolute(config).at(config)?;
        let LinkedServices { all, written_here } = LinkedServices::of(&ring.terms(), local);
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
            is_config_valid: false,
        };
        link.spawn(progress)?;
        Ok(link)
    }

    /// Restarts the link if it has ended.
    ///
    /// # Errors
    /// [`Error::LinkEnded`] if the first link exits within `MIN_LIFETIME`.
    pub fn supervise(&mut self, progress: &TerminalProgress) -> Result<(), Error> {
        let ended = self.child.as_mut().and_then(|child| child.try_wait().ok().flatten());
        if let Some(status) = ended {
            self.child = None;
            self.is_config_valid |= self.started.elapsed() >= MIN_LIFETIME;
            if status.code().is_some() && !self.is_config_valid {
                self.wait_for_messages();
                return Err(Error::LinkEnded { program: self.program, status: status.to_string() });
            }
            progress.say(&format!("link: ended with {status}: restarting"));
            self.started = Instant::now();
        }
        if self.child.is_none() && self.started.elapsed() >= BACK_OFF {
            self.spawn(progress)?;
        }
        Ok(())
    }

    /// Starts the process in the ring folder, where it finds the iceoryx2 configuration of the ring.
    fn spawn(&mut self, progress: &TerminalProgress) -> Result<(), Error> {
        let program = Path::new(self.program);
        let (output, input) = pipe().at(program)?;
        let mut command = Command::new(program);
        command.args(&self.arguments).current_dir(&self.ring).stdin(Stdio::null());
        command.process_group(0); // only the launcher receives Ctrl-C
        for (name, value) in ENVIRONMENT {
            if std::env::var_os(name).is_none() {
                command.env(name, value);
            }
        }
        // Unlike the processes of the ring, the link does not detect the death of the launcher.
        let end_with_launcher = || Ok(set_parent_process_death_signal(Some(Signal::TERM))?);
        // SAFETY: the closure makes one system call; it neither allocates nor locks.
        unsafe { command.pre_exec(end_with_launcher) };
        let child = command.stdout(input.try_clone().at(program)?).stderr(input).spawn().at(program)?;
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

    /// Waits for the last output of a link that has ended.
    fn wait_for_messages(&self) {
        let begin = Instant::now();
        while self.messages.as_ref().is_some_and(|messages| !messages.is_finished()) && begin.elapsed() < OUTPUT_TIMEOUT
        {
            std::thread::sleep(POLL_EVERY);
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
            std::thread::sleep(POLL_EVERY);
        }
        let _ = child.kill();
        let _ = child.wait();
    }
}
