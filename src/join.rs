//! `skysink join`: runs processes of a ring whose launcher is on another host.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser as _};
use iceoryx2::prelude::ipc;
use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_planner::settings;
use skysink_ring::cleanup::Janitor;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::topics::{Ring, is_release};

use crate::error::Error;
use crate::report::TerminalProgress;
use crate::run::commands::{CommandLine, VehicleOption};
use crate::run::limits;
use crate::run::link;
use crate::run::options::{Launch, RunOptions, seconds};
use crate::run::process::POLL_EVERY;
use crate::run::restart::{Rule, worker};
use crate::run::ring_mission::END_TIMEOUT;
use crate::run::supervise::{Supervision, Worker, Workers};

/// The roles that can run on another host than the launcher.
const ROLES: [Role; 3] = [Role::FieldSim, Role::FlightSim, Role::Planner];

/// Run processes on this host for a skysink run --link on another host.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink run city.toml --external planner --link link.json5    on one host
  skysink join planner --ring ring.toml --scenario scenario.toml \\
    --link link.json5                                           on another

Copy ring.toml and scenario.toml from the first host; skysink run prints
their paths there.")]
pub struct JoinCommand {
    /// Processes to run on this host.
    #[arg(value_name = "ROLE", required = true, value_parser = PossibleValuesParser::new(ROLES.map(Role::name))
        .map(|name| worker(&name).expect("one of the possible values")))]
    roles: Vec<Role>,
    /// Copy of ring.toml from the ring folder, whose path skysink run prints.
    #[arg(long, value_name = "FILE")]
    ring: PathBuf,
    /// Copy of scenario.toml from the run folder.
    #[arg(long, value_name = "FILE")]
    scenario: PathBuf,
    /// zenoh configuration file of the link to the other hosts.
    #[arg(long, value_name = "FILE")]
    link: PathBuf,
    /// Start and supervise this command as the planner, as in skysink run.
    #[arg(long, value_name = "COMMAND")]
    planner: Option<CommandLine>,
    /// Fly these vehicles as flight-sim, or start this command, as in skysink run.
    #[arg(long, value_name = "ADDRESS|COMMAND")]
    vehicle: Option<VehicleOption>,
    /// Whether to restart a process that ends before the mission: never or on-failure; ROLE=POLICY, such as
    /// planner=never, applies to one process (repeatable) [default: on-failure].
    #[arg(long, value_name = "POLICY")]
    restart: Vec<Rule>,
    /// Timeout for the launcher's heartbeat [s].
    #[arg(long, value_name = "SECONDS", default_value = "600", value_parser = seconds())]
    timeout: f64,
}

impl JoinCommand {
    /// Runs the processes until the launcher releases the ring.
    pub fn run(mut self, stop: &Stop) -> Result<(), Error> {
        let planner = self.planner.take();
        let options = RunOptions { planner, vehicle: self.vehicle.take(), ..RunOptions::default() };
        self.check(&options)?;
        let scenario = Scenario::read(&self.scenario, Overrides::default()).and_then(settings::resolve)?;
        limits::check(&SensorList::of(&scenario)?, false)?;
        let folder = RingFolder::join(&self.ring)?;
        let refuse = |message: &str| Error::from(InputError::new("ring", &self.ring, message));
        let theirs = folder.terms().link;
        let ours = link::terms(&scenario)?;
        if theirs.is_some_and(|theirs| theirs.version != ours.version) {
            return Err(refuse("it has another protocol version: use executables of the same version on all hosts"));
        }
        if theirs != Some(ours) {
            return Err(refuse(
                "it flies another scenario or sensor list: pass copies of scenario.toml and sensors.csv of the run \
                 folder",
            ));
        }
        folder.set_global_config()?;
        self.run_processes(&options, &scenario, &folder, stop)
    }

    fn check(&self, options: &RunOptions) -> Result<(), Error> {
        let twice = (1..self.roles.len()).find(|&index| self.roles[..index].contains(&self.roles[index]));
        if let Some(index) = twice {
            return Err(Error::Usage(format!("{}: expected each role once", self.roles[index].name())));
        }
        if let Some((role, option)) = options.replaced().find(|(role, _)| !self.roles.contains(role)) {
            return Err(Error::Usage(format!("{option}: expected with the role {}", role.name())));
        }
        options.check_replaced()?;
        link::check(&self.link)
    }

    fn run_processes(
        self,
        options: &RunOptions,
        scenario: &Scenario,
        folder: &RingFolder,
        stop: &Stop,
    ) -> Result<(), Error> {
        let timeout = Duration::from_secs_f64(self.timeout);
        let progress = TerminalProgress::of_slots();
        let (ring, mut wait) = Ring::<ipc::Service>::join(folder, scenario, Role::Launcher, stop)?;
        let _janitor = Janitor::start(folder);
        let mut commits = ring.commit.reader()?;
        options.check_vehicle(scenario, folder.terms().pace)?;
        let launch = Launch { scenario: self.scenario, recording: PathBuf::new(), label: None, recorded: None };
        let process = |&role: &Role| {
            Ok(Worker::new(role, options.invocation(role, &launch, folder)?, Rule::policy(&self.restart, role)))
        };
        let mut workers = Workers::start(Supervision {
            ring: &ring,
            folder,
            progress: &progress,
            workers: self.roles.iter().map(process).collect::<Result<_, Error>>()?,
            external: &[Role::Launcher],
            link: Some(link::process(folder, &self.link, &self.roles)?),
            last_slot: scenario.slots,
        })?;
        let mut slot = 0;
        let mut released: Option<Instant> = None;
        while released.is_none_or(|released| !workers.have_ended(|_| true) && released.elapsed() < END_TIMEOUT) {
            while let Some(commit) = commits.next_sample()? {
                slot = commit.user_header().slot;
                if is_release(commit.user_header()) {
                    released = released.or(Some(Instant::now()));
                    workers.release();
                }
            }
            workers.watch(slot + 1, None)?;
            if released.is_none() && workers.is_external_silent_for(timeout) {
                return Err(Error::LauncherSilent { seconds: self.timeout, slot });
            }
            wait.sleep_until(Instant::now() + POLL_EVERY)?;
        }
        drop(workers);
        ring.remove_dead_nodes();
        Ok(())
    }
}
