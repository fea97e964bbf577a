//! Terminal output: progress bars, and tables of results.

use std::fmt;
use std::io::{IsTerminal, Write as _};
#[cfg(feature = "lab")]
use std::sync::{Arc, Mutex, PoisonError};
#[cfg(feature = "lab")]
use std::time::{Duration, Instant};

use clap::Args;
use comfy_table::{CellAlignment, ColumnConstraint, ContentArrangement, Table, Width, presets};
#[cfg(feature = "lab")]
use indicatif::HumanDuration;
use indicatif::{HumanCount, ProgressBar, ProgressState, ProgressStyle};
use serde::Serialize;
use skysink_common::nodes::energy::NodeEnergyUse;
use skysink_common::pace::Pace;
use skysink_common::terminal::{printable, shell_path};
#[cfg(feature = "lab")]
use skysink_lab::progress::LabProgress;
#[cfg(feature = "lab")]
use skysink_lab::statistics::Concentration;
use skysink_mission::latency::Spread;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::{EnergyUse, FleetUse, Summary, Tally};
#[cfg(feature = "lab")]
use skysink_ring::role::Role;

use crate::error::{Error, RERUN};

/// A progress bar on standard error, hidden unless that is a terminal. Dropping the last clone removes it.
#[derive(Debug, Clone)]
pub(crate) struct TerminalProgress(ProgressBar);

impl TerminalProgress {
    /// The bar of a run.
    pub fn of_slots() -> Self {
        let speed = |state: &ProgressState, text: &mut dyn fmt::Write| {
            let _ = write!(text, "{:.0}", state.per_sec());
        };
        Self::new(style("{bar:25} slot {pos}/{len}  {speed} slots/s  {msg}").with_key("speed", speed))
    }

    /// Returns a callback that shows the progress of a sweep. Dropping it removes the bar.
    #[cfg(feature = "lab")]
    pub fn of_missions() -> impl Fn(LabProgress) {
        let end = Arc::new(Mutex::new(None::<Instant>));
        let shown = Arc::clone(&end);
        let left = move |_: &ProgressState, text: &mut dyn fmt::Write| {
            let end = *shown.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(left) = end.and_then(|end| end.checked_duration_since(Instant::now())) {
                let _ = write!(text, "{} left", HumanDuration(left));
            }
        };
        let bar = Self::new(style("{bar:25} mission {pos}/{len}  {left}").with_key("left", left));
        move |progress| {
            let is_first = bar.0.length() == Some(0);
            let now = Instant::now();
            let ends = progress.left.and_then(|left| now.checked_add(left));
            *end.lock().unwrap_or_else(PoisonError::into_inner) = ends;
            bar.show(progress.done, progress.of, String::new());
            if is_first {
                bar.0.enable_steady_tick(Duration::from_secs(1)); // updates the remaining time between two missions
            }
        }
    }

    /// Returns a callback that shows the progress of a search. Dropping it removes the bar.
    #[cfg(feature = "lab")]
    pub fn of_steps() -> impl Fn(LabProgress) {
        let bar = Self::new(style("{bar:25} step {human_pos}/{human_len}  {msg}  {eta} left"));
        move |progress| {
            let message = progress.loss_rate.map_or_else(String::new, |loss_rate| format!("loss {loss_rate:.4}"));
            bar.show(progress.done, progress.of, message);
        }
    }

    fn new(style: ProgressStyle) -> Self {
        let is_visible = std::io::stderr().is_terminal();
        Self(if is_visible { ProgressBar::new(0).with_style(style) } else { ProgressBar::hidden() })
    }

    /// Sets the position of the bar to `done` of `total`, and its message.
    fn show(&self, done: u64, total: u64, message: String) {
        let Self(bar) = self;
        if bar.length() != Some(total) || done < bar.position() {
            bar.set_length(total); // a new sweep or mission
            bar.reset();
            bar.set_position(done);
            bar.reset_eta();
        }
        bar.set_position(done);
        bar.set_message(message);
    }

    /// Shows the progress of a run over `slots` slots.
    pub fn show_run(&self, tally: &Tally, slots: u64) {
        if self.0.is_hidden() {
            return;
        }
        let missed = match tally.missed_deadlines() {
            0 => String::new(),
            missed => format!("  {missed} deadlines missed"),
        };
        self.show(tally.last_slot(), slots, format!("loss {:.4}{missed}", tally.loss_rate()));
    }

    /// Writes a line to standard error without breaking the bar.
    pub fn say(&self, line: &str) {
        self.0.suspend(|| drop(writeln!(std::io::stderr(), "{line}"))); // an error is ignored: stderr may be closed
    }
}

/// The style of a bar.
fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("a valid template")
}

/// Writes a line, or several, to standard output, with control characters escaped.
///
/// # Errors
/// If standard output is closed or cannot be written.
pub fn print(line: impl fmt::Display) -> Result<(), Error> {
    writeln!(std::io::stdout(), "{}", printable(&line.to_string())).map_err(Error::Output)
}

/// How results are printed.
#[derive(Debug, Clone, Copy, Args)]
pub(crate) struct OutputForm {
    /// Print JSON instead of the table.
    #[arg(long, global = true)]
    pub json: bool,
}

impl OutputForm {
    /// Prints `figures` as JSON with `--json`, else calls `as_table`.
    pub fn print(self, figures: &impl Serialize, as_table: impl FnOnce() -> Result<(), Error>) -> Result<(), Error> {
        if self.json {
            return print(serde_json::to_string_pretty(figures).expect("plain numbers and strings"));
        }
        as_table()
    }
}

/// What bases, batteries and duty cycles add to the table of a summary.
fn energy_rows(summary: &Summary) -> Vec<(&'static str, String)> {
    let mut rows = Vec::new();
    if let Some(energy) = &summary.energy {
        let EnergyUse { used_j, charged_j, left_j, charged_s, pad_wait_s, return_slots, down_slot } = energy;
        rows.push(("energy used / charged", format!("{used_j:.0} J / {charged_j:.0} J")));
        rows.push(("energy left", format!("{left_j:.0} J")));
        rows.push(("time charging", format!("{charged_s:.0} s")));
        rows.extend(pad_wait_s.map(|pad_wait_s| ("time waiting for a pad", format!("{pad_wait_s:.0} s"))));
        rows.push(("slots of the way home", HumanCount(*return_slots).to_string()));
        rows.extend(down_slot.map(|slot| ("down in slot", slot.to_string())));
    }
    if let Some(nodes) = &summary.node_energy {
        let NodeEnergyUse { used_j, harvested_j, dead, first_death_s, .. } = nodes;
        rows.push(("energy of SNs used / harvested", format!("{} J / {} J", figure(*used_j), figure(*harvested_j))));
        let first = first_death_s.map_or_else(String::new, |death_s| format!(", the first after {death_s} s"));
        rows.push(("dead SNs", format!("{dead}{first}")));
    }
    rows.extend(summary.refused_duty.map(|refused| ("services without airtime", HumanCount(refused).to_string())));
    rows.extend(summary.landed.map(|landed| ("in the base at the end", if landed { "yes" } else { "no" }.to_owned())));
    rows
}

/// A number with six decimals, or fewer if it is large.
pub(crate) fn figure(number: f64) -> String {
    match number.abs() {
        ..10.0 => format!("{number:.6}"),
        10.0..1e4 => format!("{number:.2}"),
        1e4..1e9 => format!("{number:.0}"),
        _ => format!("{number:.4e}"),
    }
}

/// Prints the results of a run, its folder, and how to open the recording.
pub(crate) fn print_run(folder: &RunFolder, summary: &Summary) -> Result<(), Error> {
    let timing = &summary.timing;
    let pace = timing.pace.map_or_else(|| "in one process".to_owned(), |pace| format!("pace {pace}"));
    let title = format!("{} · {} · seed {}", summary.name, summary.strategy, summary.seed);
    match summary.slots {
        slots if summary.resumed_after == Some(slots) => {
            print(format_args!("{title}: all {slots} slots were already recorded"))?;
        }
        slots => {
            let flown = summary.resumed_after.map_or_else(String::new, |last| format!(", the last {}", slots - last));
            let planned = summary.planned_slots;
            let of = if summary.complete { String::new() } else { format!(" of {planned}, ended early") };
            print(format_args!("{title}: {slots} slots{of}{flown} in {:.3} s, {pace}", timing.wall_s))?;
        }
    }
    let mut table = table();
    let mut rows = vec![
        ("data loss rate η", format!("{:.6}", summary.loss_rate)),
        ("η as in the paper", format!("{:.6}", summary.eta_letter)),
        ("bits queued at start", HumanCount(summary.totals.initial_bits).to_string()),
        ("bits sampled", HumanCount(summary.totals.sampled_bits).to_string()),
        ("bits delivered", HumanCount(summary.totals.delivered_bits).to_string()),
        ("bits lost", HumanCount(summary.totals.lost_bits).to_string()),
        ("bits queued at end", HumanCount(summary.totals.queued_bits).to_string()),
        ("bits per waypoint", format!("{:.1}", summary.bits_per_waypoint)),
        ("SNs served per slot", format!("{:.3}", summary.mean_served)),
        ("slots in transit", HumanCount(summary.transit_slots).to_string()),
        ("slots held", HumanCount(summary.held_slots).to_string()),
        ("requests refused", HumanCount(summary.refused).to_string()),
        ("messages refused", HumanCount(summary.refused_messages).to_string()),
        ("processes restarted", HumanCount(summary.restarts).to_string()),
        ("plan time p50 / p99", format!("{:.1} µs / {:.1} µs", timing.plan_p50_us, timing.plan_p99_us)),
        ("slots per second", format!("{:.0}", timing.slots_per_s)),
    ];
    if let Some(weighted) = summary.weighted_loss_rate {
        rows.insert(1, ("weighted data loss rate η_w", format!("{weighted:.6}")));
    }
    if let Some(score) = summary.score {
        let completed = summary.completed_s.map_or_else(|| "never".to_owned(), |done_s| format!("{done_s} s"));
        rows.insert(1, ("all data delivered after", completed));
        rows.insert(1, ("score", figure(score)));
    }
    if let Some(objective) = summary.objective {
        rows.insert(0, ("cost by planner.objective", figure(objective)));
    }
    if let Some(FleetUse { uavs, contended, min_separation_m }) = &summary.fleet {
        rows.push(("UAVs", uavs.to_string()));
        rows.push(("requests contended", HumanCount(*contended).to_string()));
        rows.extend(min_separation_m.map(|least_m| ("least distance of two UAVs", format!("{least_m:.2} m"))));
    }
    rows.extend(energy_rows(summary));
    if timing.pace.is_some_and(|pace| pace != Pace::Max) {
        rows.push(("deadlines missed", HumanCount(timing.missed_deadlines).to_string()));
        rows.push(("late slots", HumanCount(timing.late_slots).to_string()));
    }
    if let Some(latency) = timing.latency.filter(|_| timing.pace != Some(Pace::Max)) {
        let spread = |spread: Spread| {
            let Spread { p50_us, p99_us, p999_us, max_us } = spread;
            format!("{p50_us:.0} / {p99_us:.0} / {p999_us:.0} / {max_us:.0} µs")
        };
        rows.push(("latency p50 / p99 / p99.9 / max", String::new()));
        rows.push(("  queues to plan", spread(latency.queues_to_plan)));
        rows.push(("  slot start to flight", spread(latency.to_flight)));
        rows.push(("  flight to queues", spread(latency.flight_to_queues)));
        rows.push(("  slot start to next plan", spread(latency.slot)));
        rows.extend(latency.jitter.map(|jitter| ("  jitter of the slot start", spread(jitter))));
    }
    for (name, value) in rows {
        table.add_row([name, &value]);
    }
    print(with_numbers_from(1, table))?;
    print(format_args!("Run folder:      {}", folder.path().display()))?;
    if let Some(recording) = folder.recording_pattern() {
        let mut label = "Open recording:";
        if cfg!(feature = "viewer") {
            print(format_args!("{label}  skysink view {}", shell_path(folder.path())))?;
            label = "            or:";
        }
        let names = recording.file_name().unwrap_or_default().display(); // a pattern for the shell, of several files
        print(format_args!("{label}  rerun {}/{names}", shell_path(folder.path())))?;
        print(format_args!("                 (install rerun with pip install rerun-sdk=={RERUN})"))?;
    }
    Ok(())
}

/// Most means that a warning names.
#[cfg(feature = "lab")]
const NAMED: usize = 4;

/// Warns of means of η, each with its name, that few fields determine.
#[cfg(feature = "lab")]
pub(crate) fn warn_of_few(few: impl Iterator<Item = (String, Concentration)>) {
    let (small, few): (Vec<_>, Vec<_>) = few.partition(|(_, concentration)| concentration.is_small());
    if let Some(n) = small.iter().map(|(_, concentration)| concentration.n).min() {
        Role::Launcher.log(format_args!(
            "warning: {n} seeds are few: the 95 % interval of the mean η may cover it less often; simulate more seeds \
             (docs/src/metrics.md)"
        ));
    }
    let mut few: Vec<String> = few
        .into_iter()
        .map(|(name, Concentration { nonzero, largest_fraction, .. })| match nonzero {
            1 => format!("{name} (1 field loses data)"),
            _ => format!("{name} ({nonzero} fields lose data, one {:.0} % of the sum)", 100.0 * largest_fraction),
        })
        .collect();
    if few.is_empty() {
        return;
    }
    let more = few.len().saturating_sub(NAMED);
    few.truncate(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    Role::Launcher.log(format_args!(
        "warning: few fields decide the mean η of {}{more}: the interval covers it less often than 95 %; simulate more \
         seeds (docs/src/metrics.md)",
        few.join(", ")
    ));
}

/// Maximum width of help, usage and tables [columns].
pub(crate) const TERMINAL_WIDTH: u16 = 80;

/// From this number of numeric columns on, they have less padding.
const CLOSE_COLUMNS: usize = 4;

/// An empty table with the terminal's width. Names and headings are wrapped if necessary.
#[must_use]
pub fn table() -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_BORDERS_ONLY);
    table.set_content_arrangement(ContentArrangement::Dynamic).set_width(TERMINAL_WIDTH);
    table
}

/// Aligns the columns from index `first` on to the right, and keeps their numbers on one line.
#[must_use]
pub fn with_numbers_from(first: usize, mut table: Table) -> Table {
    let last = table.column_count().saturating_sub(1);
    let gap = u16::from(last + 1 - first < CLOSE_COLUMNS);
    if let Some(names) = table.column_mut(0) {
        names.set_padding((1, gap));
    }
    for index in first..=last {
        let cells = table.column_cells_iter(index).flatten();
        let width = cells.map(|cell| cell.content().chars().count()).max().unwrap_or(0);
        if let Some(column) = table.column_mut(index) {
            let left = if index == 0 { 1 } else { gap };
            let right = u16::from(index == last);
            let width = u16::try_from(width).unwrap_or(TERMINAL_WIDTH).saturating_add(left + right);
            column.set_cell_alignment(CellAlignment::Right);
            column.set_padding((left, right));
            column.set_constraint(ColumnConstraint::LowerBoundary(Width::Fixed(width)));
        }
    }
    table
}
