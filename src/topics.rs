//! `skysink topics`: lists the topics of a running ring with payloads, writers, readers and rates.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use iceoryx2::prelude::ipc;
use serde::Serialize;
use skysink_common::error::InputError;
use skysink_common::stop::Stop;
use skysink_ring::folder::{RingFolder, record_path};
use skysink_ring::home::running_rings;
use skysink_ring::survey::TopicState;
use skysink_ring::topics::Ring;

use crate::error::Error;
use crate::report::{print, table, with_numbers_from};
use crate::run::options::parse_seconds;

/// Index of the first numeric column of the table.
const FIRST_NUMBERS: usize = 4;

/// Time between two checks for a stop.
const PAUSE: Duration = Duration::from_millis(20);

/// List the topics of a running ring with payloads, writers, readers and rates.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink topics                        the only running ring
  skysink topics runs/letter-uts-1      the ring of this run
  skysink topics --every 10 --json | jq '.[] | {service, rate_hz}'")]
pub struct TopicsCommand {
    /// Ring folder, or run folder of a running ring [default: the only running ring].
    #[arg(value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Time over which the rates are measured [s].
    #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = parse_seconds)]
    every: f64,
    /// Print JSON instead of the table.
    #[arg(long)]
    json: bool,
}

/// A topic with its rate.
#[derive(Debug, Serialize)]
struct RatedTopic {
    #[serde(flatten)]
    state: TopicState,
    /// Samples per second: slots between the newest samples of two polls, divided by the time between these samples.
    /// `None` for topics with several samples per slot.
    rate_hz: Option<f64>,
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
        let rated: Vec<_> = second.into_iter().zip(&first).map(|(now, before)| rate(now, before)).collect();
        if self.json {
            return print(serde_json::to_string_pretty(&rated).expect("plain numbers and strings"));
        }
        print_table(&rated)
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

fn rate(state: TopicState, before: &TopicState) -> RatedTopic {
    let between = |now: Option<u64>, before: Option<u64>| match (now, before) {
        (Some(now), Some(before)) => now.saturating_sub(before) as f64,
        _ => 0.0,
    };
    let slots = between(state.slot, before.slot);
    let seconds = between(state.sent_ns, before.sent_ns) / 1e9;
    let rate_hz = if slots > 0.0 && seconds > 0.0 { slots / seconds } else { 0.0 };
    RatedTopic { rate_hz: state.is_once_a_slot.then_some(rate_hz), state }
}

fn print_table(topics: &[RatedTopic]) -> Result<(), Error> {
    let mut table = table();
    table.set_header(["topic", "payload", "writer", "readers", "slot", "1/s"]);
    for RatedTopic { state, rate_hz } in topics {
        let TopicState { service, payload, writers, readers, slot, .. } = state;
        let short =
            |name: &str| name.replace("skysink/", "").replace("skysink.", "").replace(".v1", "").replace(".v2", "");
        let number = |value: Option<String>| value.unwrap_or_default();
        table.add_row([
            short(service),
            short(payload),
            writers.join(" "),
            readers.join(" "),
            number(slot.map(|slot| slot.to_string())),
            number(rate_hz.filter(|rate| *rate > 0.0).map(|rate| format!("{rate:.1}"))),
        ]);
    }
    print(with_numbers_from(FIRST_NUMBERS, table))
}
