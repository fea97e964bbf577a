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
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use serde::Serialize;
use skysink_common::figure::ReportRow;
use skysink_common::terminal::{printable, shell_path};
#[cfg(feature = "lab")]
use skysink_lab::progress::LabProgress;
#[cfg(feature = "lab")]
use skysink_lab::statistics::Concentration;
use skysink_mission::figures::Summary;
use skysink_mission::record::RunFolder;
use skysink_mission::tally::Tally;
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
        let missed = match tally.sums.missed_deadlines() {
            0 => String::new(),
            missed => format!("  {missed} deadlines missed"),
        };
        self.show(tally.sums.last_slot(), slots, format!("loss {:.4}{missed}", tally.sums.loss_rate()));
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
    for ReportRow { heading, value } in Summary::FIGURES.iter().flat_map(|figure| figure.rows(summary)) {
        table.add_row([heading, &value]);
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
