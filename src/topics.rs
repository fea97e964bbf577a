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
use skysink_ring::topic::SamplesPerSlot;
use skysink_ring::topics::{Ring, monotonic_ns};

use crate::error::Error;
use crate::report::{OutputForm, print, table, with_numbers_from};
use crate::run::options::seconds;

/// Index of the first numeric column of the table.
const FIRST_NUMBERS: usize = 4;

/// A topic is overdue after this many slots without a sample: a sample may be sent at any time of its slot.
const OVERDUE_SLOTS: f64 = 2.0;

/// And this time more [s], for short slots.
const OVERDUE_S: f64 = 0.1;

/// From this slot on each topic has had a sample.
const UNDER_WAY: u64 = 3;

/// How long a ring may take to create its topics.
const STARTING: Duration = Duration::from_secs(2);

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
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = seconds())]
    every: f64,
    #[command(flatten)]
    form: OutputForm,
}

/// A topic with its rate and its age.
#[derive(Debug, Serialize)]
struct RatedTopic {
    #[serde(flatten)]
    state: TopicState,
    /// Samples per second: slots between two samples, divided by the time between them. `None` for topics with any
    /// number of samples per slot.
    rate_hz: Option<f64>,
    /// Time from one sample to the next by the pace [s]; `None` in lock-step, and for topics without one in every slot.
    period_s: Option<f64>,
    /// Time since the newest sample was sent [s]; `None` without a sample, and behind a link: other hosts have other
    /// clocks.
    age_s: Option<f64>,
    /// Whether more than two slots have passed since the newest sample, or none has arrived of a topic that should have
    /// some by now; `None` without a period, and behind a link.
    is_overdue: Option<bool>,
}

/// What the topics of a run are rated by.
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
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let ring = self.open_ring(stop)?;
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
        self.form.print(&rated, || {
            print_table(&rated)?;
            match period_s {
                Some(period_s) => print(pace_line(&rated, period_s)),
                None if ring.terms.pace != Pace::Max => {
                    print("No tick has arrived: slot 1 has not begun, or field-sim does not answer")
                }
                None => Ok(()),
            }
        })
    }

    /// Opens the ring given by the argument, or the only running one.
    fn open_ring(&self, stop: &Stop) -> Result<Ring<ipc::Service>, Error> {
        let rings = running_rings();
        let Some(folder) = &self.folder else {
            return match &rings[..] {
                [ring] => observe(ring, stop),
                [] => Err(Error::Usage("no ring is running".to_owned())),
                rings => Err(Error::Usage(format!("several rings are running: expected one of {}", list_of(rings)))),
            };
        };
        let path = fs::canonicalize(folder).map_err(|error| InputError::new("run folder", folder, error))?;
        if path.join("ring.toml").exists() {
            return observe(&path, stop);
        }
        let Some(ring) = rings.iter().find(|ring| record_path(ring).as_ref() == Some(&path)) else {
            let others = if rings.is_empty() { String::new() } else { format!("; running: {}", list_of(&rings)) };
            let message = format!("it is not running: expected a running one, or its ring folder{others}");
            return Err(InputError::new("run folder", folder, message).into());
        };
        observe(ring, stop)
    }
}

/// Opens the ring of this folder. One that starts or ends may lack topics: it is tried again while the ring is running.
fn observe(folder: &Path, stop: &Stop) -> Result<Ring<ipc::Service>, Error> {
    let begin = Instant::now();
    loop {
        let failed = match RingFolder::open(folder).and_then(|folder| Ring::observe(&folder)) {
            Ok(ring) => return Ok(ring),
            Err(error) => error,
        };
        if !running_rings().iter().any(|ring| ring.file_name() == folder.file_name()) {
            return Err(InputError::new("ring", folder, "it is not running: expected a running one").into());
        }
        if begin.elapsed() > STARTING {
            return Err(failed.into());
        }
        stop.check()?;
        std::thread::sleep(PAUSE);
    }
}

/// The run folders of the rings, or the ring folders where there is none, separated by commas.
fn list_of(rings: &[PathBuf]) -> String {
    let name = |ring: &PathBuf| record_path(ring).unwrap_or_else(|| ring.clone()).display().to_string();
    rings.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// Rates a topic by its states at two polls.
fn rate(state: TopicState, before: &TopicState, clock: &RunClock) -> RatedTopic {
    let period_s = clock.period_s.filter(|_| state.samples == SamplesPerSlot::One);
    let age_s = clock.now_ns.zip(state.sent_ns).map(|(now_ns, sent_ns)| now_ns.saturating_sub(sent_ns) as f64 / 1e9);
    let is_late =
        |period_s: f64| age_s.map_or(clock.is_under_way, |age_s| age_s > OVERDUE_SLOTS * period_s + OVERDUE_S);
    let is_overdue = period_s.filter(|_| clock.now_ns.is_some()).map(is_late);
    // A slot may be longer than the time between the polls: then it counts from the samples before them.
    let has_new = state.slot > before.slot;
    let counts_earlier = !has_new && period_s.is_some() && is_overdue != Some(true);
    let begin = if counts_earlier { before.oldest } else { before.slot.zip(before.sent_ns) };
    let hz = begin.zip(state.slot.zip(state.sent_ns)).map_or(0.0, |(begin, end)| samples_per_s(begin, end));
    RatedTopic { rate_hz: (state.samples != SamplesPerSlot::Any).then_some(hz), period_s, age_s, is_overdue, state }
}

/// Slots per second between two samples, each with its slot and when it was sent [ns]; 0 for a sample and itself.
fn samples_per_s(begin: (u64, u64), end: (u64, u64)) -> f64 {
    let slots = end.0.saturating_sub(begin.0);
    let nanoseconds = end.1.saturating_sub(begin.1);
    if nanoseconds == 0 { 0.0 } else { slots as f64 * 1e9 / nanoseconds as f64 }
}

fn print_table(topics: &[RatedTopic]) -> Result<(), Error> {
    let mut table = table();
    table.set_header(["topic", "payload", "writer", "readers", "slot", "1/s", "age"]);
    let number = |value: Option<String>| value.unwrap_or_default();
    for RatedTopic { state, rate_hz, age_s, .. } in topics {
        let TopicState { service, payload, writers, readers, slot, .. } = state;
        table.add_row([
            without_prefix(service).to_owned(),
            short_type(payload),
            writers.join(" "),
            readers.join(" "),
            number(slot.map(|slot| slot.to_string())),
            number(rate_hz.filter(|hz| *hz > 0.0).map(rate_text)),
            number(age_s.map(|age_s| format!("{age_s:.1} s"))),
        ]);
    }
    print(with_numbers_from(FIRST_NUMBERS, table))
}

/// The rate that the pace demands, and which topics are behind it.
fn pace_line(topics: &[RatedTopic], period_s: f64) -> String {
    let is_known = topics.iter().any(|topic| topic.is_overdue.is_some());
    let overdue = topics.iter().filter(|topic| topic.is_overdue == Some(true));
    let names: Vec<&str> = overdue.map(|topic| without_prefix(&topic.state.service)).collect();
    let names = match (is_known, names.is_empty()) {
        (false, _) => "unknown behind a link".to_owned(),
        (true, true) => "none".to_owned(),
        (true, false) => names.join(", "),
    };
    format!("A slot takes {period_s} s: {}/s expected; overdue: {names}", rate_text(1.0 / period_s))
}

fn without_prefix(service: &str) -> &str {
    service.trim_start_matches("skysink/")
}

/// A payload type without prefix and version: `[Plan]` of `[skysink.Plan.v1]`.
fn short_type(payload: &str) -> String {
    let name = payload.replace("skysink.", "");
    let (name, version) = name.split_once(".v").unwrap_or((&name, ""));
    name.to_owned() + version.trim_start_matches(|digit: char| digit.is_ascii_digit())
}

fn rate_text(rate_hz: f64) -> String {
    if rate_hz < 1.0 { format!("{rate_hz:.3}") } else { format!("{rate_hz:.1}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn behind_a_link_no_topic_is_said_to_be_in_time() {
        let text = |now_ns: Option<u64>, sent_ns: u64| {
            let state = TopicState {
                service: "skysink/plan".to_owned(),
                payload: "[skysink.Plan.v1]".to_owned(),
                header: "skysink.SlotHeader.v1".to_owned(),
                writers: Vec::new(),
                readers: Vec::new(),
                slot: Some(7),
                sent_ns: Some(sent_ns),
                oldest: Some((6, 0)),
                samples: SamplesPerSlot::One,
            };
            let clock = RunClock { period_s: Some(1.0), now_ns, is_under_way: true };
            pace_line(&[rate(state.clone(), &state, &clock)], 1.0)
        };
        let line = "A slot takes 1 s: 1.0/s expected; overdue:";
        assert_eq!(text(Some(5_000_000_000), 4_000_000_000), format!("{line} none"));
        assert_eq!(text(Some(5_000_000_000), 2_000_000_000), format!("{line} plan"));
        assert_eq!(text(None, 2_000_000_000), format!("{line} unknown behind a link"));
    }
}
