//! The options of `skysink run`, their consistency checks, and the command of each process.

use std::ffi::OsString;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use skysink_common::error::InputError;
use skysink_common::option_value::number;
use skysink_common::pace::Pace;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_common::terminal::shell_path;
use skysink_mission::error::FileContext;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::wait::Waiting;

use crate::error::Error;
use crate::run::commands::{CommandLine, VehicleOption};
use crate::run::executables::{self, is_command};
use crate::run::limits;
use crate::run::link;
use crate::run::process::Invocation;
use crate::run::restart::{Rule, WORKERS, worker};

/// Options for the processes of a run.
#[derive(Debug, Default, Args)]
pub struct RunOptions {
    /// Speed of the slots relative to the wall clock: max (unpaced, lock-step), realtime, or a factor, for example 10x
    /// [default: max; with --resume, that of the run].
    #[arg(long, value_name = "PACE")]
    pub pace: Option<Pace>,
    /// How processes wait for messages: event sleeps until notified; poll spins, which is faster but keeps every core
    /// busy; adaptive spins for about 50 µs, then sleeps.
    #[arg(long, default_value = "adaptive", value_name = "HOW", value_parser = PossibleValuesParser::new(Waiting::NAMES)
        .map(|name| name.parse::<Waiting>().expect("one of the possible values")))]
    pub wait: Waiting,
    /// Serve the recording live on 127.0.0.1, on PORT or 9876.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "9876")]
    pub live: Option<u16>,
    /// Run without the viewer process; write no recording.
    #[arg(long, conflicts_with_all = ["live", "record_every"])]
    pub no_viewer: bool,
    /// Record only every K-th slot, for a smaller recording; events are always recorded [default: 1].
    #[arg(long, value_name = "K")]
    pub record_every: Option<NonZeroU64>,
    /// Wait for this process instead of starting it; you start it yourself (repeatable).
    #[arg(long, value_name = "ROLE", value_parser = PossibleValuesParser::new(WORKERS.map(Role::name))
        .map(|name| worker(&name).expect("one of the possible values")))]
    pub external: Vec<Role>,
    /// Link the ring to other hosts with this zenoh configuration file; skysink join runs the processes of --external
    /// there.
    #[arg(long, value_name = "FILE", requires = "external")]
    pub link: Option<PathBuf>,
    /// Start and supervise this command as the planner, for example "python3 mine.py". No shell is used. The
    /// environment variables SKYSINK_RING and SKYSINK_SCENARIO contain the ring folder and the scenario file.
    #[arg(long, value_name = "COMMAND")]
    pub planner: Option<CommandLine>,
    /// Fly these vehicles instead of simulated ones: MAVLink addresses, separated by commas, such as
    /// udpin:127.0.0.1:14540 or serial:/dev/ttyUSB0:57600. Anything else is a command that is started in the place of
    /// flight-sim, like that of --planner.
    #[arg(long, value_name = "ADDRESS|COMMAND")]
    pub vehicle: Option<VehicleOption>,
    /// Name of the external planner in the results [default: external].
    #[arg(long, value_name = "NAME", value_parser = parse_label)]
    pub label: Option<String>,
    /// Whether to restart a process that ends before the mission: never or on-failure; ROLE=POLICY, such as
    /// planner=never, applies to one process (repeatable) [default: on-failure, at most 50 restarts in 10 s and 8 in a
    /// row in one slot].
    #[arg(long, value_name = "POLICY")]
    pub restart: Vec<Rule>,
    /// Timeout for a message [s] [default: 30; from --external processes 600].
    #[arg(long, value_name = "SECONDS", value_parser = seconds())]
    pub timeout: Option<f64>,
}

/// The executable that flies vehicles over MAVLink.
const BRIDGE: &str = "mavlink";

/// Inputs and outputs of the processes of a ring.
#[derive(Debug)]
pub struct Launch {
    /// The scenario file.
    pub scenario: PathBuf,
    /// The first file of the recording.
    pub recording: PathBuf,
    /// Name of the planner in the recording; `None` for the scenario's strategy.
    pub label: Option<String>,
    /// The run to replay, if any.
    pub recorded: Option<RecordedRing>,
}

/// A run that is replayed.
#[derive(Debug)]
pub struct RecordedRing {
    /// The run folder.
    pub run: PathBuf,
    /// Maximum speed of the slots.
    pub pace: Pace,
    /// Source of the plans.
    pub plans: PlanSource,
}

/// Source of the plans in a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlanSource {
    /// The recorded plans.
    Record,
    /// A planner, whose plans are compared but not flown.
    Planner,
}

impl Launch {
    /// The launch of a new or resumed run.
    #[must_use]
    pub fn of(folder: &RunFolder) -> Self {
        let label = folder.run_mode().external_planner.clone();
        Self { scenario: folder.scenario(), recording: folder.recording(), label, recorded: None }
    }

    /// The arguments that make the process of `role` replay the trace.
    fn recorded_arguments(&self, role: Role) -> Result<Vec<OsString>, Error> {
        let Some(RecordedRing { run, pace, plans }) = &self.recorded else { return Ok(Vec::new()) };
        let run = std::path::absolute(run).at(run)?;
        Ok(match (role, plans) {
            (Role::FlightSim, _) => vec!["--replay".into(), run.into(), "--pace".into(), pace.to_string().into()],
            (Role::Planner, PlanSource::Record) => vec!["--replay".into(), run.into()],
            _ => Vec::new(),
        })
    }
}

/// A parser of times [s] above 0 and at most 10⁶.
pub fn seconds() -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    number("seconds, above 0, at most 1000000", |seconds| seconds > 0.0 && seconds <= 1e6)
}

/// Parses the name of a planner, which may become a part of the folder's name.
///
/// # Errors
/// If the name is not suited for a file name.
pub fn parse_label(text: &str) -> Result<String, String> {
    let is_plain = |character: char| character.is_ascii_alphanumeric() || "-_.".contains(character);
    let is_name = (1..=64).contains(&text.len()) && text.chars().all(is_plain) && !text.starts_with('.');
    is_name.then(|| text.to_owned()).ok_or_else(|| "expected up to 64 letters, digits, - _ and .".to_owned())
}

impl RunOptions {
    /// Timeout for a message [s]: `--timeout` or else `default_s`, plus two slot durations of a paced run. A process is
    /// considered hung after half the timeout, which therefore must be longer than a slot.
    pub(crate) fn timeout_s(&self, default_s: f64, pace: Pace, slot_s: f64) -> f64 {
        self.timeout.unwrap_or(default_s) + pace.period(slot_s).map_or(0.0, |period| 2.0 * period.as_secs_f64())
    }

    /// The roles that programs of the user or vehicles fill, with the options that say so.
    pub(crate) fn replaced(&self) -> impl Iterator<Item = (Role, &'static str)> {
        let planner = self.planner.as_ref().map(|_| (Role::Planner, "--planner"));
        let vehicle = self.vehicle.as_ref().map(|_| (Role::FlightSim, "--vehicle"));
        planner.into_iter().chain(vehicle)
    }

    /// The command of the user that fills `role`, if one does.
    fn command(&self, role: Role) -> Option<&CommandLine> {
        match (role, &self.vehicle) {
            (Role::Planner, _) => self.planner.as_ref(),
            (Role::FlightSim, Some(VehicleOption::Command(command))) => Some(command),
            _ => None,
        }
    }

    /// Refuses a replaced role that is left to the user, too, and a command that is none.
    pub(crate) fn check_replaced(&self) -> Result<(), Error> {
        for (role, option) in self.replaced() {
            let name = role.name();
            if self.external.contains(&role) {
                return Err(Error::Usage(format!("--external {name} and {option}: expected one of them")));
            }
            if let Some(CommandLine(words)) = self.command(role)
                && !is_command(&words[0])
            {
                let expected = "expected an executable file or a command of the PATH";
                return Err(Error::Usage(format!("{option} {}: {expected}", words[0])));
            }
        }
        Ok(())
    }

    /// Whether the planner is external: started by `--planner` or by the user.
    pub(crate) fn has_external_planner(&self) -> bool {
        self.planner.is_some() || self.external.contains(&Role::Planner)
    }

    /// The name of the external planner in the results.
    pub(crate) fn label_or_default(&self) -> String {
        self.label.clone().unwrap_or_else(|| "external".to_owned())
    }

    /// Pace and planner of the run. Options that are not given default to those of the run that is resumed, `before`.
    pub(crate) fn run_mode(&self, before: Option<&RunMode>) -> RunMode {
        let before = before.cloned().unwrap_or_default();
        RunMode {
            pace: Some(self.pace.or(before.pace).unwrap_or_default()),
            external_planner: before
                .external_planner
                .or_else(|| self.has_external_planner().then(|| self.label_or_default())),
            external: self.external_roles(before.external),
            sources: before.sources,
        }
    }

    /// The names of the roles with external processes, and those that had one `before`, each once.
    fn external_roles(&self, before: Vec<String>) -> Vec<String> {
        let replaced = self.replaced().map(|(role, _)| role);
        let mut roles = before;
        for role in self.external.iter().copied().chain(replaced).map(Role::name) {
            if !roles.iter().any(|other| other == role) {
                roles.push(role.to_owned());
            }
        }
        roles
    }

    /// Whether the process of `role` may be on another host, with its checkpoints.
    fn may_checkpoint_remotely(&self, role: Role) -> bool {
        self.link.is_some() && self.external.contains(&role) && matches!(role, Role::FieldSim | Role::FlightSim)
    }

    /// Fails if the run to resume was flown by another planner, or if a process could not restore its checkpoint
    /// because it may be on another host.
    pub(crate) fn check_resumed(&self, folder: &RunFolder) -> Result<(), Error> {
        let refuse = |message: &str| Err(InputError::new("run folder", folder.path(), message).into());
        if let Some(role) = self.external.iter().find(|&&role| self.may_checkpoint_remotely(role)) {
            let name = role.name();
            return refuse(&format!("{name} restores its checkpoint on this host: omit --external {name}"));
        }
        match &folder.run_mode().external_planner {
            Some(name) if !self.has_external_planner() => refuse(&format!(
                "it was flown by an external planner, {name}: expected --external planner, or --planner with its \
                 command"
            )),
            Some(name) if self.label.as_ref().is_some_and(|label| label != name) => {
                refuse(&format!("its planner is named {name}: expected that --label, or none"))
            }
            None if self.has_external_planner() => {
                refuse("it was flown by the scenario's strategy: expected neither --external planner nor --planner")
            }
            _ => Ok(()),
        }
    }

    /// The options to pass with `--resume` to continue this run.
    pub(crate) fn resume_options(&self) -> String {
        let roles: Vec<_> = self.external.iter().filter(|&&role| !self.may_checkpoint_remotely(role)).collect();
        let link = self.link.iter().filter(|_| !roles.is_empty());
        let link = link.map(|config| format!(" --link {}", shell_path(config)));
        let words = roles.iter().map(|role| format!(" --external {}", role.name()));
        let planner = self.planner.as_ref().and_then(CommandLine::quoted).map(|value| format!(" --planner {value}"));
        let vehicle = self.vehicle.as_ref().and_then(VehicleOption::quoted).map(|value| format!(" --vehicle {value}"));
        words.chain(link).chain(planner).chain(vehicle).collect()
    }

    /// The MAVLink addresses of the vehicles, if the bridge flies them.
    pub(crate) fn vehicle_addresses(&self) -> Option<&str> {
        self.vehicle.as_ref().and_then(VehicleOption::addresses)
    }

    /// The command that starts the process of `role`.
    pub(crate) fn invocation(&self, role: Role, launch: &Launch, ring: &RingFolder) -> Result<Invocation, Error> {
        let absolute = |path: &Path| std::path::absolute(path).at(path);
        let scenario = absolute(&launch.scenario)?;
        if let Some(command) = self.command(role) {
            return Ok(command.invocation(ring, &scenario));
        }
        let vehicles = self.vehicle_addresses().filter(|_| role == Role::FlightSim);
        let name = if vehicles.is_some() { BRIDGE } else { role.name() };
        let (program, mut arguments) = executables::command_of(name).at(Path::new("skysink"))?;
        arguments.extend(["--scenario".into(), scenario.into(), "--ring".into(), ring.path().into()]);
        if role == Role::Viewer {
            arguments.extend(["--save".into(), absolute(&launch.recording)?.into()]);
            arguments.extend(self.live.map(|port| format!("--live={port}").into()));
            arguments.extend(self.record_every.map(|slots| format!("--record-every={slots}").into()));
            arguments.extend(launch.label.iter().flat_map(|name| ["--label".into(), name.into()]));
        }
        arguments.extend(vehicles.iter().flat_map(|addresses| ["--connect".into(), addresses.into()]));
        arguments.extend(launch.recorded_arguments(role)?);
        Ok(Invocation { program, arguments, ..Invocation::default() })
    }

    /// Checks that the bridge to vehicles can fly `scenario` at this pace: by the clock, and with a place on Earth.
    pub(crate) fn check_vehicle(&self, scenario: &Scenario, pace: Pace) -> Result<(), Error> {
        let Some(addresses) = self.vehicle_addresses() else { return Ok(()) };
        if !cfg!(feature = "mavlink") {
            return Err(Error::NoBridge);
        }
        let refuse = |message: &str| Err(Error::Usage(format!("--vehicle {addresses}: {message}")));
        if pace == Pace::Max {
            return refuse("expected a paced run: --pace realtime, or a factor such as 5x if the vehicle runs as fast");
        }
        if scenario.area.origin().is_none() {
            return refuse("expected a scenario with area.origin_lat_deg and area.origin_lon_deg");
        }
        #[cfg(feature = "mavlink")]
        {
            let parsed = addresses.parse::<skysink_vehicle::wire::WireAddresses>();
            let checked = parsed.and_then(|all| skysink_vehicle::wire::check_addresses(&all.0, scenario.uav.uavs()));
            checked.or_else(|message| refuse(&message))?;
        }
        Ok(())
    }

    /// Checks the options before the run: against each other, the build, and the resources of the machine. Running out
    /// of shared memory later would kill a process.
    ///
    /// # Errors
    /// [`Error::NoViewer`], [`Error::Usage`] or [`Error::Insufficient`].
    pub fn check(&self, list: &SensorList) -> Result<(), Error> {
        if !self.no_viewer && !cfg!(feature = "viewer") {
            return Err(Error::NoViewer);
        }
        let refuse = |message: &str| Err(Error::Usage(message.to_owned()));
        if self.no_viewer && self.external.contains(&Role::Viewer) {
            return refuse("--external viewer and --no-viewer: expected one of them");
        }
        self.check_replaced()?;
        if let Some(port @ 1..) = self.live {
            let probe = std::net::TcpListener::bind(("127.0.0.1", port));
            if let Err(error) = probe {
                return refuse(&format!("--live={port}: port {port} of 127.0.0.1: {error}: expected a free port"));
            }
        }
        if let Some(config) = &self.link {
            link::check(config)?;
        }
        if self.label.is_some() && !self.has_external_planner() {
            return refuse("--label: expected with --external planner or --planner");
        }
        limits::check(list, !self.no_viewer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replacement_commands_are_printed_with_shell_quoting() {
        let planner = "python3 'my file.py'".parse().ok();
        let vehicle = "udpin:127.0.0.1:14540".parse().ok();
        let options = RunOptions { planner, vehicle, ..RunOptions::default() }.resume_options();
        assert_eq!(options, " --planner \"python3 'my file.py'\" --vehicle udpin:127.0.0.1:14540");
    }

    #[test]
    fn half_the_timeout_is_longer_than_a_paced_slot() {
        let options = RunOptions::default();
        assert_eq!(options.timeout_s(30.0, Pace::Max, 600.0), 30.0);
        for slot_s in [1.0, 100.0, 600.0] {
            let timeout_s = options.timeout_s(30.0, "realtime".parse().unwrap(), slot_s);
            assert!(timeout_s / 2.0 > slot_s, "{timeout_s} s for slots of {slot_s} s");
        }
    }
}
