//! The command line of `skysink`.

#[cfg(feature = "lab")]
mod export;
mod flight;
#[cfg(feature = "lab")]
mod job_array;
mod manual;
#[cfg(feature = "lab")]
mod plot;
#[cfg(feature = "lab")]
pub(crate) mod research;
pub(crate) mod values;

use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::builder::TypedValueParser;
use clap::{Args, Parser, Subcommand};
use skysink_common::scenario::{Overrides, Scenario, Setting};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_mission::record::RunFolder;
use skysink_mission::replay::checked_summary;
use skysink_mission::{Mission, sensor_results};
use skysink_planner::settings;
use skysink_ring::role::Role;
use skysink_ring::wait::{exit_on_second_signal, stop_on_signals};

#[cfg(feature = "lab")]
use crate::bench::BenchOptions;
use crate::check::check;
use crate::error::Error;
use crate::join::JoinOptions;
use crate::new::NewScenario;
use crate::replay::ReplayArguments;
use crate::report::OutputForm;
use crate::run::process::ProcessTable;
use crate::run::run;
use crate::simulate::{NewFolder, RecordingOptions, Simulation, simulate};
use crate::topics::TopicsOptions;
use crate::view::{PageOptions, ViewOptions};
use crate::{report, usage, worker};
use flight::{RunArguments, SoakArguments};

/// Plans and flies a UAV that collects data from wireless sensor nodes, slot by slot.
#[derive(Debug, Parser)]
#[command(
    name = "skysink",
    version,
    arg_required_else_help = true,
    after_help = "\
Examples:
  skysink run                                the paper's mission
  skysink run scenarios/sparse.toml --strategy gfs --pace 10x --live
  skysink simulate scenarios/letter.toml     the same in one process
  skysink check scenarios/letter.toml        every key and derived figures
  skysink new city --sensors nodes.csv       a scenario with your sensor nodes

The paper is the UTS letter, arXiv 2103.00753.

Exit codes: 0 success, 1 failure while running, 2 bad input or usage, 130 Ctrl-C, 143 SIGTERM."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Validate a scenario and print it with all defaults and derived figures.
    #[command(after_help = "\
Examples:
  skysink check scenarios/letter.toml
  skysink check city.toml > full.toml      the output is a valid scenario
  skysink check city.toml --json | jq .load

Warnings go to standard error and do not change the exit code.")]
    Check {
        /// Scenario file.
        scenario: PathBuf,
        #[command(flatten)]
        changes: Changes,
        /// Print only the derived figures and the warnings, as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Create a scenario file with the paper's values and a comment on each key.
    #[command(after_help = NEW_HELP)]
    New(NewScenario),
    /// Simulate a mission in one process.
    #[command(after_help = "\
Examples:
  skysink simulate scenarios/letter.toml
  skysink simulate scenarios/sparse.toml --strategy gfs --seed 3 --record
  skysink simulate scenarios/letter.toml --set link.bandwidth_hz=5e3")]
    Simulate {
        /// Scenario file.
        scenario: PathBuf,
        #[command(flatten)]
        choice: Choice,
        #[command(flatten)]
        recording: RecordingOptions,
        #[command(flatten)]
        form: OutputForm,
    },
    /// Fly a mission as a ring of processes over shared memory, and record it.
    #[command(after_help = "\
Examples:
  skysink run                          the paper's mission, unpaced
  skysink run --pace realtime --live   watch it with
                                       rerun rerun+http://127.0.0.1:9876/proxy
  skysink run --external planner       waits for a planner that you start
  skysink run --resume runs/letter-uts-1")]
    Run(RunArguments),
    /// Run processes on this host for a skysink run --link on another host.
    #[command(after_help = "\
Examples:
  skysink run city.toml --external planner --link link.json5    on one host
  skysink join planner --ring ring.toml --scenario scenario.toml \\
    --link link.json5                                           on another

Copy ring.toml and scenario.toml from the first host; skysink run prints
their paths there.")]
    Join(JoinOptions),
    /// Replay a finished run in the ring, to make a new recording or to evaluate another planner on it.
    #[command(after_help = "\
Examples:
  skysink replay runs/letter-uts-1                     makes a new recording
  skysink replay runs/letter-uts-1 --pace 10x --live   to watch it
  skysink replay runs/letter-uts-1 --strategy gfs      what gfs would have done
  skysink replay runs/letter-uts-1 --planner \"python3 mine.py\"

The UAV flies the recorded flight. plans.csv contains the planner's decision
for each slot, made from the recorded state.")]
    Replay(ReplayArguments),
    /// List the topics of a running ring with payloads, writers, readers and rates.
    #[command(after_help = "\
Examples:
  skysink topics                        the only running ring
  skysink topics runs/letter-uts-1      the ring of this run
  skysink topics --every 10 --json | jq '.[] | {service, rate_hz}'")]
    Topics(TopicsOptions),
    /// Show recordings in a browser.
    #[command(after_help = "\
Examples:
  skysink view                          the newest recording in runs/
  skysink view runs/letter-uts-1 runs/letter-gfs-1
  skysink view comparison/comparison.rrd
  skysink view --live                   a running mission of skysink run --live

The page loads nothing from other hosts. For a browser on another machine, the
command prints the ssh command that forwards the port.")]
    View(ViewOptions),
    /// Export a recording and its viewer as a static web page.
    #[command(after_help = "\
Examples:
  skysink page runs/letter-uts-1 page
  python3 -m http.server --directory page   then http://127.0.0.1:8000/")]
    Page(PageOptions),
    /// Print the results of a run.
    #[command(after_help = "\
Examples:
  skysink report runs/letter-uts-1
  skysink report runs/letter-uts-1 --sensors   also per sensor node")]
    Report {
        /// Run folder.
        #[arg(value_name = "RUN")]
        folder: PathBuf,
        /// Write sensors_out.csv into the run folder: bits lost and delivered, service ages and service gaps of each
        /// sensor node.
        #[arg(long)]
        sensors: bool,
        /// Print summary.json instead of the table.
        #[arg(long)]
        json: bool,
    },
    /// Fly a long mission, kill its processes at random, and check trace, ledger and memory.
    #[command(after_help = "\
Examples:
  skysink soak --kill-every 0.2                  a million slots, takes minutes
  skysink soak --anywhere --missions 20 --viewer")]
    Soak(SoakArguments),
    #[cfg(feature = "lab")]
    #[command(flatten)]
    Research(research::Research),
    #[cfg(feature = "lab")]
    /// Convert a finished run to a format for maps, log viewers, ground stations or tables.
    #[command(after_help = export::EXAMPLES)]
    Export(export::ExportOptions),
    #[cfg(feature = "lab")]
    /// Benchmark planner, field, missions and ring against their lower bounds.
    #[command(after_help = "\
Examples:
  skysink bench --quick               less accurate, takes seconds
  skysink bench --only ring           slot latency of the ring and of bare hops
  skysink bench --json > bench.json   all results as JSON, takes minutes")]
    Bench(BenchOptions),
    #[command(flatten)]
    Manual(manual::Manual),
}

/// Examples of `skysink new`.
#[cfg(feature = "lab")]
const NEW_HELP: &str = "\
Examples:
  skysink new city                       writes city/city.toml
  skysink new city --sensors nodes.geojson
  skysink new city --sensors nodes.csv --out scenarios/city

With --sensors, it also writes sensors.csv and sets the area to enclose the
sensor nodes. CSV columns are matched by name: x, y [m] or lat, lon [°], and
optionally sampling_bps, gain_db, queue_bits.";

/// Examples of `skysink new` in a build without imports.
#[cfg(not(feature = "lab"))]
const NEW_HELP: &str = "Example:\n  skysink new city    writes city/city.toml";

/// Options of every command that flies one mission.
#[derive(Debug, Args)]
struct Choice {
    /// Strategy [default: the scenario's].
    #[arg(long, value_parser = values::strategy())]
    strategy: Option<&'static str>,
    #[command(flatten)]
    changes: Changes,
    #[command(flatten)]
    folder: NewFolder,
}

impl Choice {
    fn overrides(&self) -> Overrides {
        Overrides { strategy: self.strategy, ..self.changes.overrides() }
    }
}

/// Options of every command that takes a scenario: changes of its keys.
#[derive(Debug, Clone, Args)]
struct Changes {
    /// Random seed [default: the scenario's].
    #[arg(long, value_parser = seed_parser())]
    seed: Option<u64>,
    /// Override a scenario key, for example link.bandwidth_hz=5e3 (repeatable).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    keys: Vec<Setting>,
}

impl Changes {
    fn overrides(&self) -> Overrides {
        Overrides { seed: self.seed, keys: self.keys.clone(), ..Overrides::default() }
    }
}

fn seed_parser() -> impl TypedValueParser<Value = u64> {
    clap::value_parser!(u64).range(..=i64::MAX as u64)
}

/// Runs a command line, program name first, and returns its exit code.
#[must_use]
pub fn execute(arguments: Vec<OsString>) -> u8 {
    worker::silence_iceoryx2();
    let stop = stop_on_signals();
    // Installed after the handler that requests the stop, so that the first signal is not lost. The launcher stops the
    // processes of its ring.
    exit_on_second_signal();
    let cli: Cli = match usage::parse(arguments) {
        Ok(cli) => cli,
        Err(message) => return print_usage_error(&message),
    };
    match run_command(cli.command, &stop) {
        Ok(()) => 0,
        Err(Error::Output(error)) if error.kind() == ErrorKind::BrokenPipe => 0, // the reader has closed the pipe
        Err(error) => {
            Role::Launcher.log(&error);
            error.exit_code()
        }
    }
}

/// Prints the requested help, or what is wrong with the arguments, and returns the exit code.
fn print_usage_error(message: &clap::Error) -> u8 {
    let printed =
        message.print().or_else(|error| if error.kind() == ErrorKind::BrokenPipe { Ok(()) } else { Err(error) });
    match printed {
        Err(error) if !message.use_stderr() => {
            Role::Launcher.log(Error::Output(error));
            1
        }
        _ => u8::try_from(message.exit_code()).unwrap_or(2),
    }
}

fn run_command(command: Command, stop: &Stop) -> Result<(), Error> {
    let (folder, summary, form) = match command {
        Command::Check { scenario, changes, json } => return check(&scenario, changes.overrides(), json),
        Command::New(new) => return new.write(),
        Command::Simulate { scenario, choice, recording, form } => {
            let scenario = Scenario::read(&scenario, choice.overrides()).and_then(settings::resolve)?;
            let list = SensorList::of(&scenario)?;
            let mission = Mission::new(&scenario, &list)?;
            let simulation = Simulation { scenario, folder: choice.folder, record: recording.every() };
            let (folder, summary) = simulate(&simulation, &list, mission, stop)?;
            (folder, summary, form)
        }
        Command::Report { folder, sensors, json } => return report(&folder, sensors, json, stop),
        Command::Replay(arguments) => return arguments.replay(stop),
        Command::Join(options) => return options.join(stop),
        Command::Topics(options) => return options.show(stop),
        Command::View(options) => return options.view(stop),
        Command::Page(options) => return options.write(stop),
        Command::Run(arguments) => {
            let form = arguments.form;
            let (folder, summary) = run(&arguments.run()?, stop, &ProcessTable::default())?;
            (folder, summary, form)
        }
        #[cfg(feature = "lab")]
        Command::Research(research) => return research.run(stop),
        Command::Manual(manual) => return manual.write(),
        Command::Soak(arguments) => return arguments.soak(stop),
        #[cfg(feature = "lab")]
        Command::Export(options) => return options.export(stop),
        #[cfg(feature = "lab")]
        Command::Bench(options) => return options.bench(stop),
    };
    form.print(&summary, || report::print_run(&folder, &summary))
}

fn report(path: &Path, sensors: bool, json: bool, stop: &Stop) -> Result<(), Error> {
    let folder = RunFolder::open_to_read(path)?;
    let summary = checked_summary(&folder)?;
    if json {
        report::print(serde_json::to_string_pretty(&summary).expect("plain numbers and strings"))?;
    } else {
        report::print_run(&folder, &summary)?;
    }
    if sensors {
        let file = sensor_results::write(path, stop)?;
        if !json {
            report::print(format_args!("Sensor nodes:    {}", file.display()))?;
        }
    }
    Ok(())
}
