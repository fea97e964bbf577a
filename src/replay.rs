//! `skysink replay`: a mission on record through the ring once more.
//!
//! field-sim, planner and viewer take part as in any run; flight-sim flies what is on record, whatever the plans say. So
//! every process gets what it got in the run, and a planner is asked what it would have done in each recorded state.

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
use crate::run::options::{Launch, PlansOf, RecordedRing, RunOptions};
use crate::run::supervise::ProcessTable;
use crate::run::{Flown, fly, make_ring};
use outcome::{PlanCounts, Replayed};

/// What the planner would have done, slot by slot.
const PLANS: &str = "plans.csv";

/// What the replay comes to.
const OUTCOME: &str = "replay.json";

/// Held locked by the process that writes the folder.
const LOCK: &str = "lock";

/// Begin of the name of the folder into which a replay is put that another is to replace.
const ASIDE: &str = ".earlier-";

/// The files of a replay, but for its recordings and the lock.
const FILES: [&str; 4] = ["scenario.toml", "sensors.csv", PLANS, OUTCOME];

/// What `--pace` means here: nobody misses a slot.
const PACE: &str =
    "How fast the slots follow each other at most: max, realtime, or a factor such as 10x [default: max]";

/// What to replay, and how.
#[derive(Debug, Args)]
#[command(mut_arg("pace", |pace| pace.help(PACE)))]
pub struct ReplayArguments {
    /// Folder of a finished run.
    run: PathBuf,
    /// Ask this strategy what it would have done, instead of the one that flew.
    #[arg(long, value_parser = crate::cli::values::strategy())]
    strategy: Option<&'static str>,
    /// Folder to write [default: RUN-replay].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the replay in the folder, if there is one.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    options: RunOptions,
    #[command(flatten)]
    form: OutputForm,
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
        if self.options.link.is_some() {
            return Err(Error::Usage("--link: expected with skysink run".to_owned()));
        }
        self.options.check(&recorded.list)?;

        let is_asked = self.strategy.is_some() || self.options.has_outside_planner();
        let plans = match &folder.run_mode().external_planner {
            Some(_) if !is_asked => PlansOf::Record,
            _ => PlansOf::Planner,
        };
        let outside = self.options.has_outside_planner().then(|| self.options.label_or_default());
        let planner = match plans {
            PlansOf::Record => recorded.strategy.clone(),
            PlansOf::Planner => outside.clone().unwrap_or_else(|| scenario.planner.strategy.clone()),
        };
        let out = self.folder()?;
        let earlier = self.clear(&out)?;
        write_whole(&out.join("scenario.toml"), scenario.to_toml_with_list("sensors.csv").as_bytes())?;
        write_whole(&out.join("sensors.csv"), recorded.list.to_csv().as_bytes())?;
        let launch = Launch {
            scenario: out.join("scenario.toml"),
            recording: out.join("mission.rrd"),
            label: Some(recorded.strategy.clone()),
            recorded: Some(RecordedRing { run: self.run.clone(), pace: self.options.pace.unwrap_or_default(), plans }),
        };
        let manner = RunMode { pace: Some(Pace::Max), external_planner: outside };

        let mut replayed = Replayed::new(&scenario, &recorded, &out.join(PLANS))?;
        let flown = self.fly(&scenario, &launch, &manner, stop, &mut replayed).and_then(|()| replayed.finish());
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
        manner: &RunMode,
        stop: &Stop,
        replayed: &mut Replayed,
    ) -> Result<(), Error> {
        let ring = make_ring(scenario, &self.options, manner, self.options.pace.unwrap_or_default())?;
        let mut tally = Tally::new(scenario, replayed.list());
        let mission = Flown { scenario, options: &self.options, launch };
        fly(&mission, &ring, &ProcessTable::default(), stop, replayed, &mut tally).map(drop)
    }

    /// The folder of the replay: beside the run, unless the user says otherwise.
    fn folder(&self) -> Result<PathBuf, Error> {
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
            let message = "it is in the run, which stays as it is: expected another --out";
            return Err(InputError::new("output folder", &out, message).into());
        }
        Ok(out)
    }

    /// Makes the folder `out`, locks it, and puts the replay aside that is to be replaced.
    fn clear(&self, out: &Path) -> Result<EarlierReplay, Error> {
        let refuse = |message: &str| InputError::new("output folder", out, message);
        fs::create_dir_all(out).map_err(|error| refuse(&format!("{error}: expected the name of a folder")))?;
        self.replaced(out)?; // before a lock file is made
        let path = out.join(LOCK);
        let lock = File::options().write(true).create(true).truncate(false).open(&path).at(&path)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(refuse("another replay is writing it: end that one, or choose another --out").into());
            }
            Err(TryLockError::Error(error)) => Err(error).at(&path)?,
        }
        let files = self.replaced(out)?;
        let aside = tempfile::Builder::new().prefix(ASIDE).tempdir_in(out).at(out)?;
        for path in &files {
            fs::rename(path, aside.path().join(path.file_name().unwrap_or_default())).at(path)?;
        }
        Ok(EarlierReplay { out: out.to_owned(), is_none: files.is_empty(), aside, _lock: lock })
    }

    /// The files of the replay in `out` that is to be replaced; an error if it is not to be, or something else is there.
    fn replaced(&self, out: &Path) -> Result<Vec<PathBuf>, Error> {
        let refuse = |message: &str| Err(InputError::new("output folder", out, message).into());
        let mut paths = Vec::new();
        let is_replay = out.join(LOCK).exists();
        for entry in fs::read_dir(out).at(out)? {
            let entry = entry.at(out)?;
            let name = entry.file_name();
            let text = name.to_string_lossy();
            let is_recording = text.starts_with("mission") && text.ends_with(".rrd");
            if is_earlier(&name) {
                continue; // of a replay that was killed
            }
            let is_file_of_replay = FILES.contains(&&*text) || is_recording || is_unfinished(&name);
            if text != LOCK && !(is_replay && is_file_of_replay) {
                let path = entry.path();
                return refuse(&format!("it holds {}: expected a folder of its own, by --out", path.display()));
            }
            if text != LOCK {
                paths.push(entry.path());
            }
        }
        if !paths.is_empty() && !self.force {
            return refuse("it exists: choose another --out, or pass --force to replace the replay in it");
        }
        Ok(paths)
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

/// The replay that another is to replace, put aside until that one is whole; and the lock of their folder, which the
/// system releases when it is dropped or the process ends.
struct EarlierReplay {
    out: PathBuf,
    /// Whether there was none.
    is_none: bool,
    aside: TempDir,
    _lock: File,
}

impl EarlierReplay {
    /// Puts it back in place of what has become of the other; does nothing without one.
    fn restore(self) -> Result<(), Error> {
        if self.is_none {
            return Ok(());
        }
        for entry in fs::read_dir(&self.out).at(&self.out)?.flatten() {
            let name = entry.file_name();
            if name != LOCK && !is_earlier(&name) {
                fs::remove_file(entry.path()).at(&entry.path())?;
            }
        }
        for entry in fs::read_dir(self.aside.path()).at(self.aside.path())?.flatten() {
            fs::rename(entry.path(), self.out.join(entry.file_name())).at(&entry.path())?;
        }
        Ok(())
    }
}

/// Whether something of this name is a replay that was put aside.
fn is_earlier(name: &OsStr) -> bool {
    name.as_encoded_bytes().starts_with(ASIDE.as_bytes())
}
