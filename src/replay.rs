//! `skysink replay`: replays a recorded mission in the ring.
//!
//! field-sim, planner and viewer run as usual. flight-sim flies the recorded flight and ignores the plans. Every
//! process therefore receives the same messages as in the run, and the planner decides from each recorded state.

mod outcome;
pub mod process;

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::pace::Pace;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::origin::RunMode;
use skysink_mission::record::{RunFolder, is_unfinished, write_whole};
use skysink_mission::recorded::RecordedRun;
use skysink_mission::summary::Tally;
use skysink_planner::settings;
use skysink_ring::role::Role;
use tempfile::TempDir;

use crate::error::Error;
use crate::report::{OutputForm, print};
use crate::run::options::{Launch, PlanSource, RecordedRing, RunOptions};
use crate::run::process::ProcessTable;
use crate::run::{RingMission, fly, make_ring};
use outcome::{PlanCounts, Replayed};

/// The decision of the planner in each slot.
const PLANS: &str = "plans.csv";

/// The outcome of the replay.
const OUTCOME: &str = "replay.json";

/// Locked by the process that writes the folder.
const LOCK: &str = "lock";

/// Prefix of the temporary folder for an earlier replay that is being replaced.
const BACKUP: &str = ".earlier-";

/// The files of a replay, except its recordings and the lock.
const FILES: [&str; 4] = ["scenario.toml", "sensors.csv", PLANS, OUTCOME];

/// Help of `--pace` for a replay, in which no deadline is missed.
const PACE: &str = "Maximum speed of the slots: max, realtime, or a factor, for example 10x [default: max]";

/// Arguments of `skysink replay`.
#[derive(Debug, Args)]
#[command(mut_arg("pace", |pace| pace.help(PACE)))]
pub struct ReplayArguments {
    /// Folder of a finished run.
    run: PathBuf,
    /// Strategy to evaluate on the recorded states [default: that of the run].
    #[arg(long, value_parser = crate::cli::values::strategy())]
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

impl ReplayArguments {
    /// Replays the run and prints the outcome.
    ///
    /// # Errors
    /// If the run is unfinished or was changed, options contradict each other, a process ends and is not restarted or
    /// does not answer, a file cannot be written, or on a stop.
    pub fn replay(mut self, stop: &Stop) -> Result<(), Error> {
        self.check()?;
        let recorded = RecordedRun::read(&self.run, stop)?;
        let folder = RunFolder::open_to_read(&self.run)?;
        let overrides = Overrides { strategy: self.strategy, ..Overrides::default() };
        let scenario = Scenario::read(&folder.scenario(), overrides).and_then(settings::resolve)?;
        if self.options.link.is_some() {
            return Err(Error::Usage("--link: expected with skysink run".to_owned()));
        }
        self.options.check(&recorded.list)?;

        let has_planner = self.strategy.is_some() || self.options.has_external_planner();
        let plans = match &folder.run_mode().external_planner {
            Some(_) if !has_planner => PlanSource::Record,
            _ => PlanSource::Planner,
        };
        let external = self.options.has_external_planner().then(|| self.options.label_or_default());
        let planner = match plans {
            PlanSource::Record => recorded.strategy.clone(),
            PlanSource::Planner => external.clone().unwrap_or_else(|| scenario.planner.strategy.clone()),
        };
        let out = self.output_folder()?;
        let earlier = self.prepare(&out)?;
        write_whole(&out.join("scenario.toml"), scenario.to_toml_with_list("sensors.csv").as_bytes())?;
        write_whole(&out.join("sensors.csv"), recorded.list.to_csv().as_bytes())?;
        let launch = Launch {
            scenario: out.join("scenario.toml"),
            recording: out.join("mission.rrd"),
            label: Some(recorded.strategy.clone()),
            recorded: Some(RecordedRing { run: self.run.clone(), pace: self.options.pace.unwrap_or_default(), plans }),
        };
        let run_mode = RunMode { pace: Some(Pace::Max), external_planner: external };

        let mut replayed = Replayed::new(&scenario, &recorded, &out.join(PLANS))?;
        let flown = self.fly(&scenario, &launch, &run_mode, stop, &mut replayed).and_then(|()| replayed.finish());
        if flown.is_err() {
            earlier.restore()?;
        }
        let (counts, hash) = flown?;
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
        self.form.print(&outcome, || self.print(&outcome, plans, &out))
    }

    /// Refuses options that do not apply to a replay.
    fn check(&self) -> Result<(), Error> {
        let refuse = |message: &str| Err(Error::Usage(message.to_owned()));
        if self.options.external.contains(&Role::FlightSim) {
            return refuse("--external flight-sim: expected another role: the replay uses the recorded flight");
        }
        if self.strategy.is_some() && self.options.has_external_planner() {
            return refuse("--strategy with --planner or --external planner: expected one of them");
        }
        Ok(())
    }

    /// Flies the mission in a ring. It is in lock-step at every pace, so that no deadline is missed.
    fn fly(
        &mut self,
        scenario: &Scenario,
        launch: &Launch,
        run_mode: &RunMode,
        stop: &Stop,
        replayed: &mut Replayed,
    ) -> Result<(), Error> {
        let ring = make_ring(scenario, &self.options, run_mode, self.options.pace.unwrap_or_default())?;
        let mut tally = Tally::new(scenario, replayed.list());
        let mission = RingMission { scenario, options: &self.options, launch };
        fly(&mission, &ring, &ProcessTable::default(), stop, replayed, &mut tally).map(drop)
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

    /// Creates and locks the folder `out`, and moves an earlier replay to a backup folder.
    fn prepare(&self, out: &Path) -> Result<EarlierReplay, Error> {
        let refuse = |message: &str| InputError::new("output folder", out, message);
        fs::create_dir_all(out).map_err(|error| refuse(&format!("{error}: expected the name of a folder")))?;
        self.earlier_files(out)?; // refuses the folder before the lock file is created
        let path = out.join(LOCK);
        let lock = File::options().write(true).create(true).truncate(false).open(&path).at(&path)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(refuse("another replay is writing it: stop that one, or choose another --out").into());
            }
            Err(TryLockError::Error(error)) => Err(error).at(&path)?,
        }
        let files = self.earlier_files(out)?;
        let backup = tempfile::Builder::new().prefix(BACKUP).tempdir_in(out).at(out)?;
        for path in &files {
            fs::rename(path, backup.path().join(path.file_name().unwrap_or_default())).at(path)?;
        }
        Ok(EarlierReplay { out: out.to_owned(), is_empty: files.is_empty(), backup, _lock: lock })
    }

    /// The files of an earlier replay in `out`. Fails if there are some without `--force`, or the folder contains other
    /// files.
    fn earlier_files(&self, out: &Path) -> Result<Vec<PathBuf>, Error> {
        let refuse = |message: &str| Err(InputError::new("output folder", out, message).into());
        let mut paths = Vec::new();
        let is_replay = out.join(LOCK).exists();
        for entry in fs::read_dir(out).at(out)? {
            let entry = entry.at(out)?;
            let name = entry.file_name();
            let text = name.to_string_lossy();
            let is_recording = text.starts_with("mission") && text.ends_with(".rrd");
            if is_backup(&name) {
                continue; // of a killed replay
            }
            let is_file_of_replay = FILES.contains(&&*text) || is_recording || is_unfinished(&name);
            if text != LOCK && !(is_replay && is_file_of_replay) {
                let path = entry.path();
                return refuse(&format!("it contains {}: expected a separate folder, by --out", path.display()));
            }
            if text != LOCK {
                paths.push(entry.path());
            }
        }
        if !paths.is_empty() && !self.force {
            return refuse("it exists: choose another --out, or pass --force to replace the replay");
        }
        Ok(paths)
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
            print(format_args!("Open recording:  skysink view {}", out.display()))?;
        }
        Ok(())
    }
}

/// The backup of an earlier replay until the new one is complete, and the lock of the folder. The lock is released on
/// drop or when the process ends.
struct EarlierReplay {
    out: PathBuf,
    /// Whether there was no earlier replay.
    is_empty: bool,
    backup: TempDir,
    _lock: File,
}

impl EarlierReplay {
    /// Replaces the incomplete new replay by the earlier one, if there was one.
    fn restore(self) -> Result<(), Error> {
        if self.is_empty {
            return Ok(());
        }
        for entry in fs::read_dir(&self.out).at(&self.out)?.flatten() {
            let name = entry.file_name();
            if name != LOCK && !is_backup(&name) {
                fs::remove_file(entry.path()).at(&entry.path())?;
            }
        }
        for entry in fs::read_dir(self.backup.path()).at(self.backup.path())?.flatten() {
            fs::rename(entry.path(), self.out.join(entry.file_name())).at(&entry.path())?;
        }
        Ok(())
    }
}

/// Whether this is the name of a backup of an earlier replay.
fn is_backup(name: &OsStr) -> bool {
    name.as_encoded_bytes().starts_with(BACKUP.as_bytes())
}
