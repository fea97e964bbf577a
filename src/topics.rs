//! `skysink topics`: lists the topics of a running ring with payloads, writers, readers, rates and ages.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use iceoryx2::prelude::ipc;
use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;
use skysink_ring::folder::{RingFolder, record_path};
use skysink_ring::home::running_rings;
use skysink_ring::survey::TopicState;
use skysink_ring::topics::{Ring, monotonic_ns};

use crate::error::Error;
use crate::report::{print, table, with_numbers_from};
use crate::run::options::parse_seconds;

/// Index of the first numeric column of the table.
const FIRST_NUMBERS: usize = 4;

/// A topic is overdue after this many slots without a sample: a sample may be sent at any time of its slot.
const OVERDUE_SLOTS: f64 = 2.0;

/// And this time more [s], for short slots.
const OVERDUE_S: f64 = 0.1;

/// From this slot on each topic has had a sample.
const UNDER_WAY: u64 = 3;

/// Time between two checks for a stop.
const PAUSE: Duration = Duration::from_millis(20);

/// List the topics of a running ring with payloads, writers, readers, rates and ages.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink topics                        the only running ring
  skysink topics runs/letter-uts-1      the ring of this run
  skysink topics --every 10 --json | jq '.[] | {service, rate_hz}'
  skysink topics --json | jq '.[] | select(.is_overdue) | .service'")]
pub struct TopicsCommand {
    /// Ring folder, or run folder of a running ring [default: the only running ring].
    #[arg(value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Time over which the rates are measured [s]; in a paced run at least one slot, by samples sent before.
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = parse_seconds)]
    every: f64,
    /// Print JSON instead of the table.
    #[arg(long)]
    json: bool,
}

/// A topic with its rate and its age.
#[derive(Debug, Serialize)]
struct RatedTopic {
    #[serde(flatten)]
    state: TopicState,
    /// Samples per second: slots between two samples, divided by the time between them. `None` for topics with several samples
    /// per slot.
    rate_hz: Option<f64>,
    /// Time from one sample to the next by the pace [s]; `None` in lock-step, and for topics without a sample in every slot.
    period_s: Option<f64>,
    /// Time since the newest sample was sent [s]; `None` without a sample, and behind a link, whose hosts have other clocks.
    age_s: Option<f64>,
    /// Whether more than two slots have passed since the newest sample, or there is none of a writer that should have sent some
    /// by now; `None` without a period, and behind a link.
    is_overdue: Option<bool>,
}

/// What a run demands of its topics.
struct RunClock {
    /// Time from one slot to the next [s]; `None` in lock-step.
    period_s: Option<f64>,
    /// The time of the clock of the samples [ns]; `None` behind a link.
    now_ns: Option<u64>,
    /// Whether each topic should have a sample.
    is_under_way: bool,
}

impl TopicsCommand {
    /// Polls the topics twice and prints them.
    ///
    /// # Errors
    /// If the ring does not exist or cannot be read, or on a stop.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let ring = self.open_ring()?;
        let begin = Instant::now();
        let first = ring.topic_states()?;
        while begin.elapsed().as_secs_f64() < self.every {
            stop.check()?;
            std::thread::sleep(PAUSE);
        }
        let second = ring.topic_states()?;
        let period_s = ring.period()?.map(|period| period.as_secs_f64());
        let now_ns = ring.terms.link.is_none().then(monotonic_ns);
        let slot = second.iter().filter_map(|topic| topic.slot).max();
        let clock = RunClock { period_s, now_ns, is_under_way: slot >= Some(UNDER_WAY) };
        let rated: Vec<_> = second.into_iter().zip(&first).map(|(now, before)| rate(now, before, &clock)).collect();
        if self.json {
            return print(serde_json::to_string_pretty(&rated).expect("plain numbers and strings"));
        }
        print_table(&rated)?;
        match period_s {
            Some(period_s) => print_pace(&rated, period_s),
            None if ring.terms.pace != Pace::Max => {
                print("No tick has arrived: slot 1 has not begun, or field-sim does not answer")
            }
            None => Ok(()),
        }
    }

    /// Opens the ring given by the argument, or the only running one.
    fn open_ring(&self) -> Result<Ring<ipc::Service>, Error> {
        let open = |path: &Path| Ok(Ring::observe(&RingFolder::open(path)?)?);
        let rings = running_rings();
        let Some(folder) = &self.folder else {
            return match &rings[..] {
                [ring] => open(ring),
                [] => Err(Error::Usage("no ring is running".to_owned())),
                rings => Err(Error::Usage(format!("several rings are running: expected one of {}", list_of(rings)))),
            };
        };
        let path = fs::canonicalize(folder).map_err(|error| InputError::new("run folder", folder, error))?;
        if path.join("ring.toml").exists() {
            return open(&path);
        }
        let Some(ring) = rings.iter().find(|ring| record_path(ring).as_ref() == Some(&path)) else {
            let others = if rings.is_empty() { String::new() } else { format!("; running: {}", list_of(&rings)) };
            let message = format!("it is not running: expected a running one, or its ring folder{others}");
            return Err(InputError::new("run folder", folder, message).into());
        };
        open(ring)
    }
}

/// The run folders of the rings, or the ring folders where there is none, separated by commas.
fn list_of(rings: &[PathBuf]) -> String {
    let name = |ring: &PathBuf| record_path(ring).unwrap_or_else(|| ring.clone()).display().to_string();
    rings.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// Rates a topic by its states at two polls.
fn rate(state: TopicState, before: &TopicState, clock: &RunClock) -> RatedTopic {
    let period_s = clock.period_s.filter(|_| state.is_in_every_slot);
    let age_s = state.sent_ns.zip(clock.now_ns).map(|(sent_ns, now_ns)| now_ns.saturating_sub(sent_ns) as f64 / 1e9);
    let is_overdue = period_s
        .filter(|_| clock.now_ns.is_some())
        .map(|period_s| age_s.map_or(clock.is_under_way, |age_s| age_s > OVERDUE_SLOTS * period_s + OVERDUE_S));
    let newest = state.slot.zip(state.sent_ns);
    // A slot may be longer than the time between the polls: then it counts from the samples before them.
    let is_between = state.slot > before.slot;
    let may_be_earlier = period_s.is_some() && is_overdue != Some(true);
    let begin = if !is_between && may_be_earlier { before.oldest } else { before.slot.zip(before.sent_ns) };
    let (slots, seconds) = newest.zip(begin).map_or((0.0, 0.0), |((slot, sent_ns), (from, from_ns))| {
        (slot.saturating_sub(from) as f64, sent_ns.saturating_sub(from_ns) as f64 / 1e9)
    });
    let rate_hz = if slots > 0.0 && seconds > 0.0 { slots / seconds } else { 0.0 };
    RatedTopic { rate_hz: state.is_once_a_slot.then_some(rate_hz), period_s, age_s, is_overdue, state }
}

fn print_table(topics: &[RatedTopic]) -> Result<(), Error> {
    let mut table = table();
    table.set_header(["topic", "payload", "writer", "readers", "slot", "1/s", "age"]);
    let number = |value: Option<String>| value.unwrap_or_default();
    for RatedTopic { state, rate_hz, age_s, .. } in topics {
        let TopicState { service, payload, writers, readers, slot, .. } = state;
        let short = |name: &str| {
            let name = name.replace("skysink/", "").replace("skysink.", "");
            name.split_once(".v").map_or(name.clone(), |(before, after)| {
                before.to_owned() + after.trim_start_matches(|digit: char| digit.is_ascii_digit())
            })
        };
        table.add_row([
            short(service),
            short(payload),
            writers.join(" "),
            readers.join(" "),
            number(slot.map(|slot| slot.to_string())),
            number(rate_hz.filter(|hz| *hz > 0.0).map(rate_text)),
            number(age_s.map(|age_s| format!("{age_s:.1} s"))),
        ]);
    }
    print(with_numbers_from(FIRST_NUMBERS, table))
}

/// Prints the rate that the pace demands, and which topics are behind it.
fn print_pace(topics: &[RatedTopic], period_s: f64) -> Result<(), Error> {
    let overdue = topics.iter().filter(|topic| topic.is_overdue == Some(true));
    let names: Vec<&str> = overdue.map(|topic| topic.state.service.trim_start_matches("skysink/")).collect();
    let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    print(format!("A slot takes {period_s} s: {}/s expected; overdue: {names}", rate_text(1.0 / period_s)))
}

fn rate_text(rate_hz: f64) -> String {
    if rate_hz < 1.0 { format!("{rate_hz:.3}") } else { format!("{rate_hz:.1}") }
}
