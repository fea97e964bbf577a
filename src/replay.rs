//! `skysink replay`: replays a recorded mission in the ring.
//!
//! field-sim, planner and viewer run as usual. flight-sim flies the recorded flight and ignores the plans. Every
//! process therefore receives the same messages as in the run, and the planner decides from each recorded state.

mod outcome;
pub(crate) mod process;

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::pace::Pace;
use skysink_common::scenario::{Overrides, Scenario, is_kept_file};
use skysink_common::stop::Stop;
use skysink_common::terminal::shell_path;
use skysink_mission::error::FileContext;
use skysink_mission::files::write_whole;
use skysink_mission::folder::FolderLayout;
use skysink_mission::origin::RunMode;
use skysink_mission::record::{RunFolder, is_recording};
use skysink_mission::replay::RecordedRun;
use skysink_mission::tally::Tally;
use skysink_planner::settings;
use skysink_ring::role::Role;

use crate::error::Error;
use crate::options::strategy;
use crate::report::{OutputForm, print};
use crate::run::options::{Launch, PlanSource, RecordedRing, RunOptions};
use crate::run::ring_mission::{RingMission, make_ring};
use crate::unflown::warn_of_counts;
use outcome::{PlanCounts, Replayed};

/// The decision of the planner in each slot.
const PLANS: &str = "plans.csv";

/// The outcome of the replay.
const OUTCOME: &str = "replay.json";

/// The files of a replay.
static LAYOUT: FolderLayout = FolderLayout {
    lock: "lock",
    is_result: |name| {
        let is_own = ["scenario.toml", "sensors.csv", PLANS, OUTCOME].contains(&name);
        is_own || is_kept_file(name) || is_recording(name)
    },
    is_temporary: |_| false,
};

/// Help of `--pace` for a replay, in which no deadline is missed.
const PACE: &str = "Maximum speed of the slots: max, realtime, or a factor, for example 10x [default: max]";

/// Replay a finished run in the ring, to make a new recording or to evaluate another planner on it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink replay runs/letter-uts-1                     makes a new recording
  skysink replay runs/letter-uts-1 --pace 10x --live   to watch it
  skysink replay runs/letter-uts-1 --strategy gfs      what gfs would have done
  skysink replay runs/letter-uts-1 --planner \"python3 mine.py\"

The UAV flies the recorded flight. plans.csv contains the planner's decision
for each slot, made from the recorded state.")]
#[command(mut_arg("pace", |pace| pace.help(PACE)))]
pub struct ReplayCommand {
    /// Folder of a finished run.
    run: PathBuf,
    /// Strategy to evaluate on the recorded states [default: that of the run].
    #[arg(long, value_parser = strategy())]
    strategy: Option<&'static str>,
    /// Output folder [default: RUN-replay].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace an existing replay in the folder.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    options: RunOptions,
    #[command(flatten)]
    form: OutputForm,
}

/// A finished run that is replayed.
struct ReplayedRun<'a> {
    command: &'a ReplayCommand,
    /// Locked for reading.
    _folder: RunFolder,
    recorded: RecordedRun,
    /// The scenario of the run, with the strategy to evaluate.
    scenario: Scenario,
    /// The label of an external planner to evaluate.
    external: Option<String>,
    plans: PlanSource,
}

/// The outcome of a replay, as in `replay.json`.
#[derive(Debug, Serialize)]
struct ReplayOutcome<'a> {
    /// The run.
    run: &'a Path,
    /// The strategy that flew it, or the label of an external planner.
    strategy: &'a str,
    /// The planner whose plans were compared.
    planner: &'a str,
    #[serde(flatten)]
    counts: PlanCounts,
    /// The hash of the trace, equal for the run and the replay.
    trace_hash: String,
    version: &'static str,
}

impl ReplayCommand {
    /// Replays the run and prints the outcome.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        self.check()?;
        let replay = ReplayedRun::read(&self, stop)?;
        let out = self.output_folder()?;
        let refuse = |message: &str| InputError::new("output folder", &out, message);
        let cannot_create = |error| refuse(&format!("{error}: expected the name of a folder")).into();
        let message = "another replay is writing it: stop that one, or choose another --out";
        let folder = LAYOUT.open(&out, cannot_create, || self.check_folder(&out))?.ok_or_else(|| refuse(message))?;
        let results = folder.begin()?;
        let outcome = replay.write(results.path(), stop)?;
        results.replace_earlier()?;
        if replay.plans == PlanSource::Planner {
            let PlanCounts { slots, held_slots, refused, .. } = outcome.counts;
            warn_of_counts(&replay.scenario, slots, [held_slots, refused]);
        }
        self.form.print(&outcome, || self.print(&outcome, replay.plans, folder.path()))
    }

    /// Refuses options that do not apply to a replay.
    fn check(&self) -> Result<(), Error> {
        let refuse = |message: &str| Err(Error::Usage(message.to_owned()));
        if self.options.external.contains(&Role::FlightSim) {
            return refuse("--external flight-sim: expected another role: the replay uses the recorded flight");
        }
        if self.options.vehicle.is_some() {
            return refuse("--vehicle: expected with skysink run: the replay uses the recorded flight");
        }
        if self.strategy.is_some() && self.options.has_external_planner() {
            return refuse("--strategy with --planner or --external planner: expected one of them");
        }
        Ok(())
    }

    /// The folder of the replay: `--out`, or a folder beside the run.
    fn output_folder(&self) -> Result<PathBuf, Error> {
        let run = fs::canonicalize(&self.run).at(&self.run)?;
        let beside = || {
            let mut name = run.file_name().unwrap_or_default().to_owned();
            name.push("-replay");
            run.with_file_name(name)
        };
        let out = self.out.clone().unwrap_or_else(|| match self.run.file_name() {
            Some(_) => self.run.with_file_name(beside().file_name().unwrap_or_default()),
            None => beside(), // `.` and the like
        });
        if std::path::absolute(&out).at(&out)?.starts_with(&run) {
            let message = "it is inside the run folder, which must not change: expected another --out";
            return Err(InputError::new("output folder", &out, message).into());
        }
        Ok(out)
    }

    /// Refuses a folder that holds a replay, without `--force`, or files of others.
    fn check_folder(&self, out: &Path) -> Result<(), Error> {
        let refuse = |message: &str| Err(InputError::new("output folder", out, message).into());
        let content = LAYOUT.content(out).at(out)?;
        let results = content.results.iter().filter(|_| content.lock.is_none()); // without a lock it is no replay
        if let Some(name) = content.foreign.iter().chain(results).next() {
            let path = out.join(name);
            return refuse(&format!("it contains {}: expected a separate folder, by --out", path.display()));
        }
        if !content.is_empty() && !self.force {
            return refuse("it exists: choose another --out, or pass --force to replace the replay");
        }
        Ok(())
    }

    fn print(&self, outcome: &ReplayOutcome, plans: PlanSource, out: &Path) -> Result<(), Error> {
        let ReplayOutcome { planner, strategy, counts, .. } = outcome;
        let PlanCounts { slots, same, undecided, first_difference, .. } = counts;
        print(format_args!("{}: replayed {slots} slots of {strategy}, all as recorded", self.run.display()))?;
        match plans {
            PlanSource::Record => {
                print("Plans:           as recorded; evaluate a planner with --planner or --strategy")?;
            }
            PlanSource::Planner => {
                let first =
                    first_difference.map_or_else(String::new, |slot| format!(", first difference in slot {slot}"));
                let decided = slots - undecided;
                print(format_args!(
                    "Plans of {planner}: equal to the recorded decision in {same} of {decided} slots{first}"
                ))?;
                if *undecided > 0 {
                    print(format_args!(
                        "                 ({undecided} slots have no decision: the UAV held its position)"
                    ))?;
                }
            }
        }
        print(format_args!("Replay folder:   {}", out.display()))?;
        if !self.options.no_viewer {
            print(format_args!("Open recording:  skysink view {}", shell_path(out)))?;
        }
        Ok(())
    }
}

impl<'a> ReplayedRun<'a> {
    /// Reads the run that `command` replays.
    fn read(command: &'a ReplayCommand, stop: &Stop) -> Result<Self, Error> {
        let recorded = RecordedRun::read(&command.run, stop)?;
        let folder = RunFolder::open_to_read(&command.run)?;
        let overrides = Overrides { strategy: command.strategy, ..Overrides::default() };
        let scenario = Scenario::read(&folder.scenario(), overrides).and_then(settings::resolve)?;
        let options = &command.options;
        if options.link.is_some() {
            return Err(Error::Usage("--link: expected with skysink run".to_owned()));
        }
        options.check(&recorded.list)?;
        let external = options.has_external_planner().then(|| options.label_or_default());
        let has_planner = command.strategy.is_some() || external.is_some();
        let plans = match &folder.run_mode().external_planner {
            Some(_) if !has_planner => PlanSource::Record,
            _ => PlanSource::Planner,
        };
        Ok(Self { command, _folder: folder, recorded, scenario, external, plans })
    }

    /// The planner whose plans are compared.
    fn planner(&self) -> &str {
        match self.plans {
            PlanSource::Record => &self.recorded.strategy,
            PlanSource::Planner => self.external.as_ref().unwrap_or(&self.scenario.planner.strategy),
        }
    }

    /// Replays the run in a ring, in lock-step at every pace, so that no deadline is missed. Writes the files of the
    /// replay into the folder `out`.
    fn write(&self, out: &Path, stop: &Stop) -> Result<ReplayOutcome<'_>, Error> {
        let Self { command, recorded, scenario, external, plans, .. } = self;
        write_whole(&out.join("scenario.toml"), scenario.to_toml_with_list("sensors.csv").as_bytes())?;
        write_whole(&out.join("sensors.csv"), recorded.list.to_csv().as_bytes())?;
        for (name, text) in recorded.list.files_beside(scenario) {
            write_whole(&out.join(name), text.as_bytes())?;
        }
        let pace = command.options.pace.unwrap_or_default();
        let launch = Launch {
            scenario: out.join("scenario.toml"),
            recording: out.join("mission.rrd"),
            label: Some(recorded.strategy.clone()),
            recorded: Some(RecordedRing { run: command.run.clone(), pace, plans: *plans }),
        };
        let run_mode = RunMode { pace: Some(Pace::Max), external_planner: external.clone(), ..RunMode::default() };
        let ring = make_ring(scenario, &command.options, &run_mode, pace)?;
        let mut replayed = Replayed::new(scenario, recorded, &out.join(PLANS))?;
        let mut tally = Tally::new(scenario, &recorded.list, &RunMode::default());
        let mission = RingMission { scenario, options: &command.options, launch: &launch, ring: &ring, stop };
        mission.record(&mut replayed, &mut tally)?;
        let (counts, hash) = replayed.finish()?;
        let outcome = ReplayOutcome {
            run: &command.run,
            strategy: &recorded.strategy,
            planner: self.planner(),
            counts,
            trace_hash: format!("{hash:016x}"),
            version: env!("CARGO_PKG_VERSION"),
        };
        let text = serde_json::to_string_pretty(&outcome).expect("plain numbers and strings") + "\n";
        write_whole(&out.join(OUTCOME), text.as_bytes())?;
        Ok(outcome)
    }
}
