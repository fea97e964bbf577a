//! What a person sees in the terminal: the progress of a run, and the table at its end.

use std::io::IsTerminal;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use comfy_table::{CellAlignment, Table, presets};
use indicatif::{ProgressBar, ProgressStyle};

use skysink_common::pace::Pace;

#[cfg(feature = "lab")]
use skysink_lab::{optimize::Optimum, progress::LabProgress};
use skysink_mission::latency::Spread;
use skysink_mission::record::RunFolder;
use skysink_mission::summary::{Summary, Tally};

/// Version of the rerun viewer whose recordings these are.
const RERUN: &str = "0.36.3";

/// The progress bar of a run; nothing at all where standard error is not a terminal.
#[derive(Debug, Clone)]
pub struct RunProgress {
    bar: ProgressBar,
    /// When and where the run was first seen under way.
    begin: Arc<OnceLock<(Instant, u64)>>,
}

impl RunProgress {
    /// A bar over `slots` slots.
    ///
    /// # Panics
    /// Never: the template is valid.
    #[must_use]
    pub fn new(slots: u64) -> Self {
        Self { bar: bar(slots, "{bar:25} slot {pos}/{len}  {msg}"), begin: Arc::default() }
    }

    /// Shows how far the run is.
    pub fn show(&self, tally: &Tally) {
        if self.bar.is_hidden() {
            return;
        }
        let slots = tally.last_slot();
        if slots == 0 {
            return;
        }
        let begin = *self.begin.get_or_init(|| (Instant::now(), slots));
        let slots_per_s = (slots - begin.1) as f64 / begin.0.elapsed().as_secs_f64().max(f64::MIN_POSITIVE);
        let missed = match tally.missed_deadlines() {
            0 => String::new(),
            missed => format!("  {missed} deadlines missed"),
        };
        self.bar.set_message(format!("loss {:.4}  {slots_per_s:.0} slots/s{missed}", tally.loss_rate()));
        self.bar.set_position(slots);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// Writes a line to standard error without breaking the bar.
    pub fn say(&self, line: &str) {
        self.bar.suspend(|| eprintln!("{line}"));
    }

    /// The same for another thread.
    pub fn speaker(&self) -> impl Fn(&str) + Clone + Send + 'static {
        let progress = self.clone();
        move |line| progress.say(line)
    }
}

/// A progress bar on standard error; nothing at all where that is not a terminal.
fn bar(length: u64, template: &str) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    ProgressBar::new(length).with_style(ProgressStyle::with_template(template).expect("a valid template"))
}

/// The progress bar of a sweep or a search, or of several in a row. It is removed with this value.
#[cfg(feature = "lab")]
pub struct LabBar(ProgressBar);

#[cfg(feature = "lab")]
impl LabBar {
    /// The bar of a sweep.
    pub fn of_missions() -> Self {
        Self(bar(0, "{bar:25} mission {pos}/{len}  {eta} left"))
    }

    /// The bar of a search.
    pub fn of_steps() -> Self {
        Self(bar(0, "{bar:25} step {human_pos}/{human_len}  {msg}  {eta} left"))
    }

    /// Shows how far it is.
    pub fn show(&self, progress: LabProgress) {
        let Self(bar) = self;
        if bar.length() != Some(progress.of) || progress.done < bar.position() {
            bar.reset(); // another one begins
            bar.set_length(progress.of);
            bar.set_position(progress.done);
            bar.reset_eta();
        }
        bar.set_position(progress.done);
        if let Some(loss_rate) = progress.loss_rate {
            bar.set_message(format!("loss {loss_rate:.4}"));
        }
    }
}

#[cfg(feature = "lab")]
impl Drop for LabBar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Prints what an optimisation came to: the bound, the best known, and what every strategy loses.
#[cfg(feature = "lab")]
pub fn print_optimum(optimum: &Optimum) {
    let best = optimum.best_known;
    let mut table = table();
    table.set_header(["", "η", "of the best known"]);
    let ratio = |loss_rate: f64| match loss_rate / best.loss_rate {
        ratio if ratio.is_finite() => format!("{ratio:.3}"),
        _ => String::new(),
    };
    let mut row = |name: &str, loss_rate: f64| {
        table.add_row([name.to_owned(), format!("{loss_rate:.6}"), ratio(loss_rate)]);
    };
    row("lower bound", optimum.loss_bound);
    row("best known", best.loss_rate);
    for standing in &optimum.strategies {
        row(standing.strategy, standing.loss_rate);
    }
    println!("{}", with_numbers_right(table));
    println!("Searched {} steps; --budget {} finds the same again.", grouped(optimum.steps), optimum.steps);
}

/// Prints the figures of a run and what to do next.
pub fn print(folder: &RunFolder, summary: &Summary) {
    let timing = &summary.timing;
    let pace = timing.pace.map_or_else(|| "in one process".to_owned(), |pace| format!("pace {pace}"));
    let title = format!("{} · {} · seed {}", summary.name, summary.strategy, summary.seed);
    println!("{title}: {} slots in {:.3} s, {pace}", summary.slots, timing.wall_s);
    let mut table = table();
    let mut rows = vec![
        ("data loss rate η", format!("{:.6}", summary.loss_rate)),
        ("η as in the letter", format!("{:.6}", summary.eta_letter)),
        ("bits sampled", grouped(summary.sampled_bits)),
        ("bits delivered", grouped(summary.delivered_bits)),
        ("bits lost", grouped(summary.lost_bits)),
        ("bits per waypoint", format!("{:.1}", summary.bits_per_waypoint)),
        ("SNs served per slot", format!("{:.3}", summary.mean_served)),
        ("slots in transit", grouped(summary.transit_slots)),
        ("slots held", grouped(summary.held_slots)),
        ("requests refused", grouped(summary.refused)),
        ("messages refused", grouped(summary.refused_messages)),
        ("processes restarted", grouped(summary.restarts)),
        ("plan time p50 / p99", format!("{:.1} µs / {:.1} µs", timing.plan_p50_us, timing.plan_p99_us)),
        ("slots per second", format!("{:.0}", timing.slots_per_s)),
    ];
    if timing.pace.is_some_and(|pace| pace != Pace::Max) {
        rows.push(("deadlines missed", grouped(timing.missed_deadlines)));
        rows.push(("slots begun late", grouped(timing.late_slots)));
    }
    if let Some(latency) = timing.latency.filter(|_| timing.pace != Some(Pace::Max)) {
        let spread = |spread: Spread| {
            let Spread { p50_us, p99_us, p999_us, max_us } = spread;
            format!("{p50_us:.0} / {p99_us:.0} / {p999_us:.0} / {max_us:.0} µs")
        };
        rows.push(("latency p50 / p99 / p99.9 / max", String::new()));
        rows.push(("  queues to plan", spread(latency.queues_to_plan)));
        rows.push(("  slot's begin to flight", spread(latency.to_flight)));
        rows.push(("  flight to queues", spread(latency.flight_to_queues)));
        rows.push(("  slot's begin to next plan", spread(latency.slot)));
        rows.extend(latency.jitter.map(|jitter| ("  jitter of the slots", spread(jitter))));
    }
    for (name, value) in rows {
        table.add_row([name, &value]);
    }
    println!("{}", with_numbers_right(table));
    println!("Run folder:      {}", folder.path().display());
    if let Some(recording) = folder.recording_pattern() {
        println!("Open recording:  rerun {}", recording.display());
        println!("                 (the viewer: pip install rerun-sdk=={RERUN})");
    }
}

/// An empty table.
#[must_use]
pub fn table() -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_BORDERS_ONLY);
    table
}

/// The table with every column but the first aligned to the right.
#[must_use]
pub fn with_numbers_right(mut table: Table) -> Table {
    for column in 1..table.column_count() {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

/// A whole number with its thousands apart.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::grouped;

    #[test]
    fn thousands_stand_apart() {
        assert_eq!([0, 999, 1000, 12_345_678].map(grouped), ["0", "999", "1 000", "12 345 678"]);
    }
}
