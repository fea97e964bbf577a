//! The lower bound of a slot: its messages passed around three processes, by themselves.
//!
//! The processes are this executable again. Each waits for the message of the one before it and sends its own, as large
//! as the ring's: queues, plan, flight. Nothing is planned, flown or saved.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use clap::Args;
use serde::{Deserialize, Serialize};
use skysink_common::message::{FlightReport, Plan};
use skysink_common::pace::Pace;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::latency::Spread;
use skysink_ring::folder::RingFolder;
use skysink_ring::wait::Waiting;

use super::Times;
use super::medium::{Ends, HOPS, Medium, SharedEnds, SocketEnds, TIMEOUT, create_services, node};
use crate::error::Error;
use crate::report::print;

/// What is passed around, and how often.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct HopRounds {
    /// By what.
    pub medium: Medium,
    /// How the processes wait for each other.
    pub wait: Waiting,
    /// Sensor nodes, whose queues the first message holds.
    pub sensors: u32,
    /// Rounds that count.
    pub rounds: u64,
    /// Time between the beginnings of two rounds; zero if each begins with the end of the one before.
    pub period: Duration,
}

/// A process among the three: its arguments.
#[derive(Debug, Args)]
pub struct HopProcess {
    /// The folder in which they meet.
    folder: PathBuf,
    /// Which one it is, from 0; the first begins the rounds.
    index: usize,
    /// What it takes part in, as JSON.
    #[arg(value_parser = |text: &str| serde_json::from_str::<HopRounds>(text))]
    rounds: HopRounds,
}

impl HopRounds {
    /// Length of the message that the process `index` sends.
    fn message_bytes(self, index: usize) -> usize {
        match index {
            0 => self.sensors as usize * size_of::<u32>(),
            1 => size_of::<Plan>(),
            _ => size_of::<FlightReport>(),
        }
    }

    /// Passes the messages around, and returns the times of the rounds.
    ///
    /// # Errors
    /// If a process cannot be started or fails.
    pub fn time(self, stop: &Stop) -> Result<Spread, Error> {
        stop.check()?;
        let folder = RingFolder::create(Pace::Max, self.wait, TIMEOUT.as_secs_f64(), false)?;
        let node = node(&folder)?;
        let services = (0..HOPS).map(|index| create_services(&node, index)).collect::<Result<Vec<_>, Error>>()?;
        let program = std::env::current_exe().at(Path::new("skysink"))?;
        let rounds = serde_json::to_string(&self).expect("plain keys and values");
        let command = |index: usize| {
            let mut command = Command::new(&program);
            command.arg("hop").arg(folder.path()).args([&index.to_string(), &rounds]);
            command.stdin(Stdio::null()).stdout(Stdio::null());
            command
        };
        let mut others = Vec::new();
        for index in 1..HOPS {
            others.push(command(index).spawn().at(&program)?);
        }
        let first = command(0).stdout(Stdio::piped()).output().at(&program)?;
        for other in &mut others {
            let _ = other.wait(); // where it fails the first one does, too
        }
        drop(services);
        serde_json::from_slice(&first.stdout).map_err(|error| Error::Bench(format!("hop: {}: {error}", first.status)))
    }
}

impl HopProcess {
    /// Takes part in all rounds; the first process prints their times.
    ///
    /// # Errors
    /// If another one is missing.
    pub fn run(&self, stop: &Stop) -> Result<(), Error> {
        let folder = RingFolder::open(&self.folder)?;
        let node = node(&folder)?;
        let HopRounds { medium, wait, rounds, period, .. } = self.rounds;
        let message = vec![7; self.rounds.message_bytes(self.index)];
        let received_bytes = self.rounds.message_bytes((self.index + HOPS - 1) % HOPS);
        let mut ends: Box<dyn Ends> = match medium {
            Medium::SharedMemory => Box::new(SharedEnds::open(&node, self.index, message.len(), wait)?),
            Medium::Socket => Box::new(SocketEnds::open(&folder, self.index, received_bytes, wait)?),
        };
        let warm_up = rounds / 10 + 1;
        let mut times = Times::new();
        let mut next = Instant::now();
        for round in 0..rounds + warm_up {
            stop.check()?;
            if self.index != 0 {
                ends.receive()?;
                ends.send(&message)?;
                continue;
            }
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
            let begin = Instant::now();
            next = next.max(begin) + period;
            ends.send(&message)?;
            ends.receive()?;
            if round >= warm_up {
                times.add(begin, 1);
            }
        }
        if self.index == 0 {
            print(serde_json::to_string(&times.spread()).expect("plain keys and values"))?;
        }
        Ok(())
    }
}
