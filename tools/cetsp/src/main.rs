//! Rounds over disks, and lower bounds on their length: a request in each line of standard input, as JSON, and its
//! answer in a line of standard output. `python/benchmarks/cetsp.py` asks.

mod bound;

use std::io::{self, Write as _};
use std::process::ExitCode;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use skysink_common::geometry::Position;
use skysink_common::stop::Stop;
use skysink_planner::geometry::round::{Disks, RoundEffort};

/// Largest radius and coordinate [m].
const MOST_M: f64 = 1e9;

/// Longest search [s].
const MOST_S: f64 = 1e6;

/// What a round has to touch, and how long it is searched.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    centres_m: Vec<[f64; 2]>,
    radius_m: f64,
    /// Where it begins; anywhere if absent.
    start_m: Option<[f64; 2]>,
    /// Whether it ends where it begins.
    is_closed: bool,
    /// Seed of the random numbers of the search; 0 if absent.
    #[serde(default)]
    seed: u64,
    round: Effort,
    /// The effort for the bound, which is not computed if absent.
    bound: Option<Effort>,
}

/// An effort: equal steps give equal answers.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Effort {
    Steps(u64),
    Seconds(f64),
}

impl Effort {
    fn checked(self) -> Result<RoundEffort, String> {
        match self {
            Self::Steps(steps) => Ok(RoundEffort::Steps(steps)),
            Self::Seconds(seconds) if (0.0..=MOST_S).contains(&seconds) => {
                Ok(RoundEffort::Time(Duration::from_secs_f64(seconds)))
            }
            Self::Seconds(seconds) => Err(format!("seconds = {seconds}: expected 0 to {MOST_S}")),
        }
    }
}

/// The round that was found.
#[derive(Debug, Serialize)]
struct Answer {
    /// Its points, the start first if there is one [m].
    points_m: Vec<[f64; 2]>,
    /// The disk in which each point after the start lies. All others are touched in passing.
    order: Vec<u32>,
    length_m: f64,
    /// A lower bound on the length of every round [m]. If it equals `length_m` within 1e-6 of it, none is shorter.
    bound_m: Option<f64>,
}

fn answer(request: &Request) -> Result<Answer, String> {
    let Request { centres_m, radius_m, start_m, is_closed, .. } = request;
    let is_far = |position_m: &&[f64; 2]| !position_m.iter().all(|along_m| along_m.abs() <= MOST_M);
    if let Some([x_m, y_m]) = centres_m.iter().chain(start_m).find(is_far) {
        return Err(format!("position [{x_m}, {y_m}]: expected metres, -{MOST_M} to {MOST_M}"));
    }
    if !(0.0..=MOST_M).contains(radius_m) {
        return Err(format!("radius_m = {radius_m}: expected 0 to {MOST_M}"));
    }
    let centres: Vec<Position> = centres_m.iter().copied().map(Position::from).collect();
    let start = start_m.map(Position::from);
    let disks = Disks { centres: &centres, radius_m: *radius_m, start, is_closed: *is_closed };
    let round = disks.seeded_round(request.seed, request.round.checked()?, &Stop::default());
    let effort = request.bound.map(Effort::checked).transpose()?;
    let bound_m = effort.map(|effort| bound::bound_m(&disks.field(), round.length_m, effort));
    let points_m = round.points.iter().map(|&point| point.into()).collect();
    Ok(Answer { points_m, order: round.order, length_m: round.length_m, bound_m })
}

fn answer_all() -> Result<(), String> {
    for line in io::stdin().lines() {
        let line = line.map_err(|error| format!("standard input: {error}"))?;
        let request = serde_json::from_str(&line).map_err(|error| error.to_string())?;
        let answer = serde_json::to_string(&answer(&request)?).expect("plain keys and values");
        writeln!(io::stdout(), "{answer}").map_err(|error| format!("standard output: {error}"))?;
    }
    Ok(())
}

fn main() -> ExitCode {
    match answer_all() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("skysink-cetsp: {message}");
            ExitCode::from(2)
        }
    }
}
