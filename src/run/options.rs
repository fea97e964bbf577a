//! The options of `skysink run`: how its processes work together, what contradicts itself, and how each is started.

use std::borrow::Cow;
use std::ffi::OsString;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use skysink_common::error::InputError;
use skysink_common::pace::Pace;
use skysink_common::sensors::SensorList;
use skysink_mission::error::FileContext;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::wait::Waiting;

use crate::error::Error;
use crate::programs;
use crate::run::limits;
use crate::run::link;
use crate::run::restart::{Rule, WORKERS, worker};
use crate::run::supervise::Invocation;

/// How the processes of a run work together.
#[derive(Debug, Default, Args)]
pub struct RunOptions {
    /// max, realtime, or a factor such as 10x [default: max; with --resume that of the run].
    #[arg(long, value_name = "PACE")]
    pub pace: Option<Pace>,
    /// How the processes wait for each other: event, asleep until they are woken; poll, which is quicker and keeps every
    /// core busy; or adaptive, which polls for some 50 µs and then sleeps.
    #[arg(long, default_value = "adaptive", value_name = "HOW", value_parser = PossibleValuesParser::new(Waiting::NAMES)
        .map(|name| name.parse::<Waiting>().expect("one of the possible values")))]
    pub wait: Waiting,
    /// Serve the recording live on 127.0.0.1, on port 9876 if none is given.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "9876")]
    pub live: Option<u16>,
    /// Leave the recording out.
    #[arg(long, conflicts_with_all = ["live", "record_every"])]
    pub no_viewer: bool,
    /// Draw one slot in so many in the recording, which is smaller for it; events are there at any rate [default: 1].
    #[arg(long, value_name = "SLOTS")]
    pub record_every: Option<NonZeroU64>,
    /// Leave this process to somebody else and wait for it (repeatable).
    #[arg(long, value_name = "ROLE", value_parser = PossibleValuesParser::new(WORKERS.map(Role::name))
        .map(|name| worker(&name).expect("one of the possible values")))]
    pub external: Vec<Role>,
    /// zenoh configuration of a link to other hosts, where skysink join runs the processes of --external.
    #[arg(long, value_name = "FILE", requires = "external")]
    pub link: Option<PathBuf>,
    /// Start and supervise this command as the planner, such as "python3 mine.py", without a shell; it finds the ring's
    /// folder in SKYSINK_RING and the scenario file in SKYSINK_SCENARIO.
    #[arg(long, value_name = "COMMAND", value_parser = command_line)]
    pub planner: Option<CommandLine>,
    /// Name of an outside planner in the results, instead of a strategy's [default: external].
    #[arg(long, value_name = "NAME", value_parser = label)]
    pub label: Option<String>,
    /// Whether a process that ends too early is restarted: never, or on-failure; planner=never for one of them
    /// (repeatable) [default: on-failure, at most 50 times in 10 s, and 8 times in a row in one slot].
    #[arg(long, value_name = "POLICY")]
    pub restart: Vec<Rule>,
    /// How long to wait for a sample [s; default 30, for those of --external 600].
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub timeout: Option<f64>,
}

/// What the processes of a ring are started with, beside their options.
#[derive(Debug)]
pub struct Launch {
    /// The scenario file.
    pub scenario: PathBuf,
    /// The first file of the recording.
    pub recording: PathBuf,
    /// What the mission is shown as; as the scenario's strategy if none.
    pub label: Option<String>,
    /// The run that is flown again.
    pub recorded: Option<RecordedRing>,
}

/// What is taken from a run on record, instead of being flown anew.
#[derive(Debug)]
pub struct RecordedRing {
    /// Its folder.
    pub run: PathBuf,
    /// How fast its slots follow each other at most.
    pub pace: Pace,
    /// Whose plans are sent.
    pub plans: PlansOf,
}

/// Whose plans are sent while a run is flown again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlansOf {
    /// Those on record.
    Record,
    /// Those of a planner, which are not flown.
    Planner,
}

impl Launch {
    /// That of a run of its own.
    #[must_use]
    pub fn of(folder: &RunFolder) -> Self {
        let label = folder.run_mode().external_planner.clone();
        Self { scenario: folder.scenario(), recording: folder.recording(), label, recorded: None }
    }

    /// The arguments by which the process of `role` repeats what is on record.
    fn recorded_arguments(&self, role: Role) -> Result<Vec<OsString>, Error> {
        let Some(RecordedRing { run, pace, plans }) = &self.recorded else { return Ok(Vec::new()) };
        let run = std::path::absolute(run).at(run)?;
        Ok(match (role, plans) {
            (Role::FlightSim, _) => vec!["--replay".into(), run.into(), "--pace".into(), pace.to_string().into()],
            (Role::Planner, PlansOf::Record) => vec!["--replay".into(), run.into()],
            _ => Vec::new(),
        })
    }
}

/// Reads a time [s] above 0 from an argument.
///
/// # Errors
/// If it is none.
pub fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e6 => Ok(seconds),
        _ => Err("expected seconds, above 0, at most 1000000".to_owned()),
    }
}

/// A command with its arguments.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CommandLine(pub Vec<String>);

/// Splits a command as a shell does, without expanding anything.
///
/// # Errors
/// If a quotation does not end, or there is nothing.
pub fn command_line(text: &str) -> Result<CommandLine, String> {
    let words = shlex::split(text).filter(|words| !words.is_empty());
    words.map(CommandLine).ok_or_else(|| "expected a command such as \"python3 mine.py\"".to_owned())
}

/// Whether there is a file to execute: of this path, or in a folder of the PATH.
pub(crate) fn is_command(program: &str) -> bool {
    if program.contains('/') {
        return is_executable(Path::new(program));
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).any(|folder| is_executable(&folder.join(program)))
}

fn is_executable(path: &Path) -> bool {
    path.is_file() && rustix::fs::access(path, rustix::fs::Access::EXEC_OK).is_ok()
}

/// Reads the name of a planner, which may become a part of the run folder's.
///
/// # Errors
/// If it could not.
pub fn label(text: &str) -> Result<String, String> {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-_.".contains(letter);
    let is_name = (1..=64).contains(&text.len()) && text.chars().all(is_plain) && !text.starts_with('.');
    is_name.then(|| text.to_owned()).ok_or_else(|| "expected up to 64 letters, digits, - _ and .".to_owned())
}

impl RunOptions {
    /// How long a sample is waited for [s]: as the user says or else `default_s`, and twice as long as a slot lasts by
    /// the clock, because half of it has to be longer than that: after half of it a process is taken to hang.
    pub(crate) fn timeout_s(&self, default_s: f64, pace: Pace, slot_s: f64) -> f64 {
        self.timeout.unwrap_or(default_s) + pace.period(slot_s).map_or(0.0, |period| 2.0 * period.as_secs_f64())
    }

    /// Whether the planner is not Skysink's.
    pub(crate) fn has_outside_planner(&self) -> bool {
        self.planner.is_some() || self.external.contains(&Role::Planner)
    }

    /// What the mission of an outside planner is booked as.
    pub(crate) fn label_or_default(&self) -> String {
        self.label.clone().unwrap_or_else(|| "external".to_owned())
    }

    /// How the run is flown; one that is resumed, as it was before where the options say nothing.
    pub(super) fn manner(&self, before: Option<&RunMode>) -> RunMode {
        let before = before.cloned().unwrap_or_default();
        RunMode {
            pace: Some(self.pace.or(before.pace).unwrap_or_default()),
            external_planner: before
                .external_planner
                .or_else(|| self.has_outside_planner().then(|| self.label_or_default())),
        }
    }

    /// Whether the process of `role` may be on another host and leave what it saves there.
    fn may_save_elsewhere(&self, role: Role) -> bool {
        self.link.is_some() && self.external.contains(&role) && matches!(role, Role::FieldSim | Role::FlightSim)
    }

    /// Fails if the planner of the run that is to be resumed was another one, or what is restored is not where it is
    /// needed.
    pub(super) fn check_resumed(&self, folder: &RunFolder) -> Result<(), Error> {
        let refuse = |message: &str| Err(InputError::new("run folder", folder.path(), message).into());
        if let Some(role) = self.external.iter().find(|&&role| self.may_save_elsewhere(role)) {
            let name = role.name();
            return refuse(&format!("{name} resumes from what is restored on this host: leave out --external {name}"));
        }
        match &folder.run_mode().external_planner {
            Some(name) if !self.has_outside_planner() => refuse(&format!(
                "it was flown by an outside planner, {name}: expected --external planner, or --planner with its command"
            )),
            Some(name) if self.label.as_ref().is_some_and(|label| label != name) => {
                refuse(&format!("it is booked as {name}: expected that --label, or none"))
            }
            None if self.has_outside_planner() => {
                refuse("it was flown by the scenario's strategy: expected neither --external planner nor --planner")
            }
            _ => Ok(()),
        }
    }

    /// The options by which a run of this kind is resumed.
    pub(super) fn resume_by(&self) -> String {
        let roles: Vec<_> = self.external.iter().filter(|&&role| !self.may_save_elsewhere(role)).collect();
        let command = self.planner.iter().filter_map(|CommandLine(words)| {
            let command = shlex::try_join(words.iter().map(String::as_str)).ok()?;
            Some(format!(" --planner {}", shlex::try_quote(&command).ok()?))
        });
        let link = self.link.iter().filter(|_| !roles.is_empty()).map(|config| {
            let config = config.to_string_lossy();
            format!(" --link {}", shlex::try_quote(&config).unwrap_or(Cow::Borrowed(&config)))
        });
        let words = roles.iter().map(|role| format!(" --external {}", role.name()));
        words.chain(link).chain(command).collect()
    }

    /// How the process of `role` is started.
    pub(crate) fn invocation(&self, role: Role, launch: &Launch, ring: &RingFolder) -> Result<Invocation, Error> {
        let absolute = |path: &Path| std::path::absolute(path).at(path);
        let scenario = absolute(&launch.scenario)?;
        if let (Role::Planner, Some(CommandLine(words))) = (role, &self.planner) {
            let (program, arguments) = words.split_first().expect("a command has words");
            return Ok(Invocation {
                program: program.into(),
                arguments: arguments.iter().map(Into::into).collect(),
                environment: vec![("SKYSINK_RING", ring.path().into()), ("SKYSINK_SCENARIO", scenario.into())],
            });
        }
        let (program, mut arguments) = programs::words(role.name()).at(Path::new("skysink"))?;
        if !program.is_file() {
            return Err(Error::ExecutableMissing(program));
        }
        arguments.extend(["--scenario".into(), scenario.into(), "--ring".into(), ring.path().into()]);
        if role == Role::Viewer {
            arguments.extend(["--save".into(), absolute(&launch.recording)?.into()]);
            arguments.extend(self.live.map(|port| format!("--live={port}").into()));
            arguments.extend(self.record_every.map(|slots| format!("--record-every={slots}").into()));
            arguments.extend(launch.label.iter().flat_map(|name| ["--label".into(), name.into()]));
        }
        arguments.extend(launch.recorded_arguments(role)?);
        Ok(Invocation { program, arguments, environment: Vec::new() })
    }

    /// Fails early where this build has no viewer, options contradict each other or the machine, or the shared memory
    /// would not do: writing beyond its end kills a process.
    ///
    /// # Errors
    /// [`Error::NoViewer`], [`Error::Usage`] or [`Error::Short`].
    pub fn check(&self, list: &SensorList) -> Result<(), Error> {
        if !self.no_viewer && !cfg!(feature = "viewer") {
            return Err(Error::NoViewer);
        }
        let refuse = |message: &str| Err(Error::Usage(message.to_owned()));
        if self.no_viewer && self.external.contains(&Role::Viewer) {
            return refuse("--external viewer and --no-viewer: expected one of them");
        }
        if self.planner.is_some() && self.external.contains(&Role::Planner) {
            return refuse("--external planner and --planner: expected one of them");
        }
        if let Some(CommandLine(words)) = self.planner.as_ref().filter(|CommandLine(words)| !is_command(&words[0])) {
            return refuse(&format!("--planner {}: expected an executable file or a command of the PATH", words[0]));
        }
        if let Some(port @ 1..) = self.live {
            let probe = std::net::TcpListener::bind(("127.0.0.1", port));
            if let Err(error) = probe {
                return refuse(&format!("--live={port}: port {port} of 127.0.0.1: {error}: expected a free port"));
            }
        }
        if let Some(config) = &self.link {
            link::check(config)?;
        }
        if self.label.is_some() && !self.has_outside_planner() {
            return refuse("--label: expected with --external planner or --planner");
        }
        limits::check(list, !self.no_viewer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_is_overdue_while_a_slot_lasts_by_the_clock() {
        let options = RunOptions::default();
        assert_eq!(options.timeout_s(30.0, Pace::Max, 600.0), 30.0);
        for slot_s in [1.0, 100.0, 600.0] {
            let timeout_s = options.timeout_s(30.0, "realtime".parse().unwrap(), slot_s);
            assert!(timeout_s / 2.0 > slot_s, "{timeout_s} s for slots of {slot_s} s");
        }
    }
}
