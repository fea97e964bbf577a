//! `skysink replay`: a mission on record through the ring once more.
//!
//! field-sim, planner and viewer take part as in any run; flight-sim flies what is on record, whatever the plans say. So
//! every process gets what it got in the run, and a planner is asked what it would have done in each recorded state.

mod outcome;
pub mod process;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::pace::Pace;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::origin::Manner;
use skysink_mission::record::{RunFolder, write_whole};
use skysink_mission::recorded::RecordedRun;
use skysink_mission::summary::Tally;
use skysink_planner::settings;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;

use crate::error::Error;
use crate::report::print;
use crate::run::options::{Launch, PlansOf, RecordedRing, RunOptions};
use crate::run::supervise::ProcessTable;
use crate::run::{Flown, fly, resume, tidy};
use outcome::{PlanCounts, Replayed};

/// What the planner would have done, slot by slot.
const PLANS: &str = "plans.csv";

/// What the replay comes to.
const OUTCOME: &str = "replay.json";

/// The files of a replay, but for its recordings.
const FILES: [&str; 4] = ["scenario.toml", "sensors.csv", PLANS, OUTCOME];

/// What to replay, and how.
#[derive(Debug, Args)]
pub struct ReplayArguments {
    /// Folder of a finished run.
    run: PathBuf,
    /// Ask this strategy what it would have done, instead of the one that has flown.
    #[arg(long, value_parser = crate::cli::strategy_parser())]
    strategy: Option<&'static str>,
    /// Folder to write [default: RUN-replay].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the replay in the DIR, if there is one.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    options: RunOptions,
}

/// What a replay comes to, as in `replay.json`.
#[derive(Debug, Serialize)]
struct ReplayOutcome<'a> {
    /// The run.
    run: &'a Path,
    /// The strategy that flew it, or the label of an outside planner.
    strategy: &'a str,
    /// Whose plans were compared.
    planner: &'a str,
    #[serde(flatten)]
    counts: PlanCounts,
    /// That of the run, and of the replay.
    trace_hash: String,
    version: &'static str,
}

impl ReplayArguments {
    /// Replays the run, and prints what it comes to.
    ///
    /// # Errors
    /// If the run is unfinished or was changed, options contradict each other, a process ends for good or does not
    /// answer, something cannot be written, or on a stop.
    pub fn replay(mut self, stop: &Stop) -> Result<(), Error> {
        self.check()?;
        let recorded = RecordedRun::read(&self.run, stop)?;
        let folder = RunFolder::open_to_read(&self.run)?;
        let overrides = Overrides { strategy: self.strategy, ..Overrides::default() };
        let scenario = Scenario::read(&folder.scenario(), overrides).and_then(settings::resolve)?;
        self.options.check(&recorded.list)?;

        let is_asked = self.strategy.is_some() || self.options.has_outside_planner();
        let plans = match &folder.manner().outside_planner {
            Some(_) if !is_asked => PlansOf::Record,
            _ => PlansOf::Planner,
        };
        let outside = self.options.has_outside_planner().then(|| self.options.label_or_default());
        let planner = match plans {
            PlansOf::Record => recorded.strategy.clone(),
            PlansOf::Planner => outside.clone().unwrap_or_else(|| scenario.planner.strategy.clone()),
        };
        let out = self.make_folder()?;
        write_whole(&out.join("scenario.toml"), scenario.to_toml_with_list("sensors.csv").as_bytes())?;
        write_whole(&out.join("sensors.csv"), recorded.list.to_csv().as_bytes())?;
        let launch = Launch {
            scenario: out.join("scenario.toml"),
            recording: out.join("mission.rrd"),
            label: Some(recorded.strategy.clone()),
            recorded: Some(RecordedRing { run: self.run.clone(), pace: self.options.pace.unwrap_or_default(), plans }),
        };
        let manner = Manner { pace: Some(Pace::Max), outside_planner: outside };

        let mut replayed = Replayed::new(&scenario, &recorded, &out.join(PLANS))?;
        self.fly(&scenario, &launch, &manner, stop, &mut replayed)?;
        let (counts, hash) = replayed.finish()?;
        let version = env!("CARGO_PKG_VERSION");
        let trace_hash = format!("{hash:016x}");
        let outcome = ReplayOutcome {
            run: &self.run,
            strategy: &recorded.strategy,
            planner: &planner,
            counts,
            trace_hash,
            version,
        };
        let text = serde_json::to_string_pretty(&outcome).expect("plain numbers and strings") + "\n";
        write_whole(&out.join(OUTCOME), text.as_bytes())?;
        self.print(&outcome, plans, &out)
    }

    /// Fails where options make no sense for a flight on record.
    fn check(&self) -> Result<(), Error> {
        let refuse = |message: &str| Err(Error::Usage(message.to_owned()));
        if self.options.external.contains(&Role::FlightSim) {
            return refuse("--external flight-sim: expected another role: what was flown is on record");
        }
        if self.strategy.is_some() && self.options.has_outside_planner() {
            return refuse("--strategy with --planner or --external planner: expected one of them");
        }
        Ok(())
    }

    /// Flies it in a ring. The slots are in lock-step at every pace, so that nobody misses one.
    fn fly(
        &mut self,
        scenario: &Scenario,
        launch: &Launch,
        manner: &Manner,
        stop: &Stop,
        replayed: &mut Replayed,
    ) -> Result<(), Error> {
        let pace = self.options.pace.unwrap_or_default();
        let timeout_s = self.options.timeout_s(30.0, pace, scenario.slot_s);
        let told = resume::told(scenario, manner)?;
        let ring = RingFolder::create(Pace::Max, self.options.wait, timeout_s, !self.options.no_viewer, told)?;
        ring.install()?;
        let mut tally = Tally::new(scenario, replayed.list());
        let mission = Flown { scenario, options: &self.options, launch };
        let flown = fly(&mission, &ring, &ProcessTable::default(), stop, replayed, &mut tally);
        tidy(&launch.recording);
        flown.map(|_: Duration| ())
    }

    /// Makes the folder of the replay, or clears the one that is to be replaced.
    fn make_folder(&self) -> Result<PathBuf, Error> {
        let out = self.out.clone().unwrap_or_else(|| {
            let mut name = self.run.file_name().unwrap_or_default().to_owned();
            name.push("-replay");
            self.run.with_file_name(name)
        });
        let refuse = |message: String| Error::from(InputError::new("output folder", &out, message));
        fs::create_dir_all(&out).map_err(|error| refuse(format!("{error}: expected the name of a folder")))?;
        let is_ours = |path: &Path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            FILES.contains(&&*name) || name.starts_with("mission") && name.ends_with(".rrd")
        };
        let found: Vec<PathBuf> = fs::read_dir(&out).at(&out)?.flatten().map(|entry| entry.path()).collect();
        match found.iter().find(|path| !is_ours(path)) {
            Some(other) => {
                return Err(refuse(format!("it holds {}: expected a folder of its own, by --out", other.display())));
            }
            None if !found.is_empty() && !self.force => {
                return Err(refuse(
                    "it exists: choose another --out, or pass --force to replace the replay in it".to_owned(),
                ));
            }
            None => {}
        }
        found.iter().try_for_each(|path| fs::remove_file(path).at(path))?;
        Ok(out)
    }

    fn print(&self, outcome: &ReplayOutcome, plans: PlansOf, out: &Path) -> Result<(), Error> {
        let ReplayOutcome { planner, strategy, counts, .. } = outcome;
        let PlanCounts { slots, same, undecided, first_difference, .. } = counts;
        print(format_args!("{}: {slots} slots of {strategy} again, each as recorded", self.run.display()))?;
        match plans {
            PlansOf::Record => {
                print(format_args!("Plans:           those on record; ask a planner by --planner or --strategy"))?
            }
            PlansOf::Planner => {
                let first =
                    first_difference.map_or_else(String::new, |slot| format!(", another one first in slot {slot}"));
                print(format_args!(
                    "Plans of {planner}: the recorded decision in {same} of {} slots{first}",
                    slots - undecided
                ))?;
                if *undecided > 0 {
                    print(format_args!(
                        "                 ({undecided} slots have none: the UAV held without a plan to fly)"
                    ))?;
                }
            }
        }
        print(format_args!("Replay folder:   {}", out.display()))?;
        if !self.options.no_viewer {
            print(format_args!("Open recording:  skysink view {}", out.display()))?;
        }
        Ok(())
    }
}
