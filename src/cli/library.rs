//! `skysink library`: arguments and printed results.

use std::collections::{BTreeSet, HashSet};
use std::path::PathBuf;

use clap::{Args, Subcommand};
use comfy_table::ColumnConstraint;
use skysink_common::error::InputError;
use skysink_common::scenario::{Overrides, Setting};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_common::terminal::shell_path;
use skysink_library::{Claim, FlownFlight, Library, ListedInstance, NamedValue, OpenInstance, Placement};
use skysink_mission::Mission;
use skysink_mission::record::{RunFolder, is_run_folder};

use crate::error::Error;
use crate::options::{NewFolder, strategy};
use crate::report::{OutputForm, print, table, with_numbers_from};
use crate::simulate::simulate;
use skysink_mission::numbers::figure;

/// Named instances with the best known flight of each, to compare planners on.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink library list --family paper
  skysink library fly sks-500-200 horizon --set planner.horizon.iterations=6000
  skysink library copy sks-500-200
  skysink run sks-500-200.toml --planner \"python3 mine.py\" --out mine
  skysink library verify mine                      its value and its place
  skysink library submit mine --library library --by \"A. Author\" --cost \"2 h\"

An instance fixes everything but [planner] (other than its objective),
uav.coordination and the seed. A policy instance is flown with each of its
seeds, and its value is the mean. What is verified is flown again, slot by slot,
in the exact model, and has to land where uav.must_land says so. That a planner
did not know what a policy instance draws cannot be verified.

A plan file is CSV, compressed by gzip or not, of any program, with a row for
each slot, from 1 on: where the UAV is after it, and the sensor nodes, from 0
on, ascending, that it serves there:

  # instance: sks-500-200
  slot,x_m,y_m,scheduled
  1,262.5,250,17 189
  2,270.123456789,238.25,

Positions that are rounded may be out of reach: write all digits. Of several
UAVs there is a column uav, from 0 on, and a row for each; z_m where altitudes
are free; seed of a policy instance; mode (serve, fly, transit, return, hold, or
charge, in the base) where it is not serve or fly. The slots.csv of a run is a
plan file, too.")]
pub struct LibraryCommand {
    #[command(subcommand)]
    action: LibraryAction,
    /// Folder of another library [default: that of this build].
    #[arg(long = "library", value_name = "DIR", global = true)]
    folder: Option<PathBuf>,
    #[command(flatten)]
    form: OutputForm,
}

#[derive(Debug, Subcommand)]
enum LibraryAction {
    /// Show the instances, with best known values and bounds.
    List {
        /// Only those of a family, such as `paper`.
        #[arg(long)]
        family: Option<String>,
    },
    /// Copy the scenario of an instance and its lists.
    Copy {
        /// The instance.
        name: String,
        /// The folder to copy to.
        #[arg(value_name = "DIR", default_value = ".")]
        to: PathBuf,
    },
    /// Fly an instance by a strategy, in one process.
    Fly {
        /// The instance.
        name: String,
        /// The strategy.
        #[arg(value_parser = strategy())]
        strategy: &'static str,
        /// Set a key of [planner] or uav.coordination (repeatable).
        #[arg(long = "set", value_name = "KEY=VALUE")]
        keys: Vec<Setting>,
        #[command(flatten)]
        folder: NewFolder,
    },
    /// Fly runs or plan files again, and show their value and place.
    Verify(Flights),
    /// Make a verified flight the best known one.
    Submit {
        #[command(flatten)]
        flights: Flights,
        /// Who or what found it [default: the strategy of an unchanged run].
        #[arg(long)]
        by: Option<String>,
        /// What it cost, such as a computing time.
        #[arg(long, default_value = "unknown")]
        cost: String,
    },
}

/// The flights to verify.
#[derive(Debug, Args)]
struct Flights {
    /// Run folder or plan file; of a policy instance one for each seed.
    #[arg(required = true, value_name = "RUN")]
    paths: Vec<PathBuf>,
    /// The instance of plan files that do not name it.
    #[arg(long, value_name = "NAME")]
    instance: Option<String>,
}

impl LibraryCommand {
    /// Does what is asked.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let Self { action, folder, form } = self;
        let library = Library::of(folder);
        match action {
            LibraryAction::List { family } => list(&library, family.as_deref(), form),
            LibraryAction::Copy { name, to } => {
                let path = library.copy(&library.find(&name)?, &to)?;
                form.print(&path, || {
                    let path = shell_path(&path);
                    print(format_args!(
                        "Copied. Fly it with your planner: skysink run {path} --planner COMMAND --out DIR"
                    ))
                })
            }
            LibraryAction::Fly { name, strategy, keys, folder } => {
                let is_given = |setting: &&Setting| ["seed", "planner.strategy"].contains(&setting.key.as_str());
                if let Some(setting) = keys.iter().find(is_given) {
                    return Err(setting
                        .refusal("expected another key: the strategy is given, and all seeds are flown")
                        .into());
                }
                let open = library.open(library.find(&name)?)?;
                let overrides = Overrides { strategy: Some(strategy), keys, ..Overrides::default() };
                let runs = fly(&open, &overrides, &folder, stop)?;
                print_placement(&library.verify(&runs, None, stop)?, form)?;
                if let [run, ..] = &runs[..]
                    && !form.json
                {
                    let more = if runs.len() > 1 { format!(" and {} more", runs.len() - 1) } else { String::new() };
                    return print(format_args!("Run folder:      {}{more}", run.display()));
                }
                Ok(())
            }
            LibraryAction::Verify(Flights { paths, instance }) => {
                print_placement(&library.verify(&paths, instance.as_deref(), stop)?, form)
            }
            LibraryAction::Submit { flights: Flights { paths, instance }, by, cost } => {
                let flown = library.verify(&paths, instance.as_deref(), stop)?;
                let by = by.or_else(|| flown.by.clone()).unwrap_or_else(|| "unknown".to_owned());
                let best = flown.submit(Claim { by, cost })?;
                let name = &flown.open.instance.name;
                form.print(&best, || {
                    let what = format!("{} {}", best.measure.label(), figure(best.value));
                    print(format_args!("{name}: {what} is the best known; commit best/{name}.toml and .csv.gz"))
                })
            }
        }
    }
}

/// Flies an instance with each of its seeds, and returns the run folders.
fn fly(open: &OpenInstance, overrides: &Overrides, folder: &NewFolder, stop: &Stop) -> Result<Vec<PathBuf>, Error> {
    let seeds = open.instance.seeds;
    let folder_of = |seed: u64| if seeds == 1 { folder.clone() } else { folder.of_seed(seed) };
    if let Some(out) = folder.out.as_deref().filter(|out| seeds > 1 && (out.is_file() || is_run_folder(out))) {
        return Err(InputError::new("output folder", out, "expected one for the runs of all seeds, not a run").into());
    }
    for seed in 1..=seeds {
        RunFolder::check(folder_of(seed).out.as_deref(), folder.earlier())?;
    }
    let of_seed = |seed: u64| {
        let scenario = open.flown_by(Overrides { seed: Some(seed), ..overrides.clone() })?;
        let list = SensorList::of(&scenario)?;
        let mission = Mission::until(&scenario, &list, stop)?;
        let (folder, _) = simulate(&scenario, &list, mission, &folder_of(seed), None, stop)?;
        Ok(folder.path().to_owned())
    };
    (1..=seeds).map(of_seed).collect()
}

/// Prints the instances.
fn list(library: &Library, family: Option<&str>, form: OutputForm) -> Result<(), Error> {
    let instances = library.instances()?;
    let mut families: Vec<String> = instances.iter().map(|instance| instance.family.clone()).collect();
    let mut seen = HashSet::new();
    families.retain(|family| seen.insert(family.clone()));
    if let Some(family) = family.filter(|family| families.iter().all(|known| known != family)) {
        let expected = format_args!("expected one of {}", families.join(", "));
        return Err(InputError::of_argument("family", family, expected).into());
    }
    let instances = instances.into_iter();
    let of_family = instances.filter(|instance| family.is_none_or(|family| instance.family == family));
    let rows = of_family.map(|instance| library.listed(instance)).collect::<Result<Vec<_>, _>>()?;
    form.print(&rows, || {
        let mut table = table();
        table.set_header(["instance", "SNs", "UAVs", "", "best", "bound", "gap"]);
        for ListedInstance { instance, sensors, uavs, best, gap, .. } in &rows {
            let best = best.as_ref();
            let value = |value: Option<f64>| value.map_or_else(String::new, figure);
            table.add_row([
                instance.name.clone(),
                sensors.to_string(),
                uavs.to_string(),
                best.map_or("", |best| best.measure.label()).to_owned(),
                value(best.map(|best| best.value)),
                value(best.and_then(|best| best.bound)),
                gap.map_or_else(String::new, percent),
            ]);
        }
        let names = table.column_mut(0).expect("it has a header");
        names.set_constraint(ColumnConstraint::ContentWidth); // they are copied from here
        print(with_numbers_from(1, table))?;
        if family.is_none() {
            print(format_args!("Families, for --family: {}", families.join(", ")))?;
        }
        let counts: BTreeSet<u64> = rows.iter().map(|row| row.instance.seeds).filter(|&seeds| seeds > 1).collect();
        match counts.last() {
            Some(seeds) if counts.len() == 1 => {
                print(format_args!("Policy instances are flown with each of the seeds 1 to {seeds}."))
            }
            _ => Ok(()),
        }
    })
}

/// Prints the value of a flight, and its place.
fn print_placement(flown: &FlownFlight, form: OutputForm) -> Result<(), Error> {
    let placement = flown.placement()?;
    form.print(&placement, || {
        let Placement { instance, measure, value, place, of, ahead, behind, best, gap_to_best, bound, gap_to_bound } =
            &placement;
        let seeds = flown.plans.len();
        let over = if seeds > 1 { format!(", mean of {seeds} seeds") } else { String::new() };
        print(format_args!("{instance}: {} {}{over}, verified", measure.label(), figure(*value)))?;
        print(format_args!("Place:           {place} of {of}"))?;
        for (label, other) in [("Next better:     ", ahead), ("Next worse:      ", behind)] {
            if let Some(NamedValue { by, value }) = other {
                print(format_args!("{label}{by} ({})", figure(*value)))?;
            }
        }
        let compared = [("Best known:      ", best, gap_to_best), ("Bound:           ", bound, gap_to_bound)];
        for (label, reference, gap) in compared {
            if let Some((reference, gap)) = reference.zip(*gap) {
                print(format_args!("{label}{} (gap {})", figure(reference), percent(gap)))?;
            }
        }
        Ok(())
    })
}

/// A fraction in percent.
fn percent(fraction: f64) -> String {
    format!("{:.1} %", 100.0 * fraction)
}
