//! Compares `horizon` with all other strategies over random missions.
//!
//! `cargo run --release -p skysink-lab --example random_missions -- 1-2000`
//!
//! A mission is drawn from its number. If links are random, or queues or rates are unknown to the planner, each mission
//! is simulated with several draws of these, and the means are compared. The arguments are the range of missions, the
//! number of these draws, the search steps of `horizon` per slot, and a folder for the missions that it loses.
//!
//! With `--models` one or two of the models that are off by default are added to each mission; where sensor nodes have
//! weights, weighted losses are compared. With `--write` nothing is flown, and all draws of all missions are written.

mod generator;
mod models;

use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_mission::Mission;
use skysink_planner::settings;
use skysink_planner::strategies::{STRATEGIES, best_of, horizon, look_ahead};

use generator::{Generator, RandomMission};

/// Loss rates that differ by less than this are considered equal.
const TIE: f64 = 1e-4;

/// A mission is clearly lost if the loss rate of `horizon` is larger by this amount and by this fraction.
const CLEARLY: [f64; 2] = [0.005, 0.05];

/// The mean loss rates of a mission, by strategy.
struct Outcome {
    number: u64,
    horizon: f64,
    /// The best of the others.
    best: (f64, &'static str),
    seconds: f64,
}

impl Outcome {
    fn is_clearly_lost(&self) -> bool {
        self.horizon > self.best.0 + CLEARLY[0] && self.horizon > self.best.0 * (1.0 + CLEARLY[1])
    }
}

/// Which missions are flown.
#[derive(Clone, Copy)]
struct Missions {
    has_models: bool,
}

impl Missions {
    fn draw(self, number: u64, draw: u64) -> RandomMission {
        let mission = Generator::new(number).mission(draw);
        if self.has_models { mission.with_models(number) } else { mission }
    }

    /// All draws of a mission: one if nothing of it is random.
    fn draws(self, number: u64, draws: u64) -> Vec<RandomMission> {
        let draws = if self.draw(number, 0).is_hidden { draws } else { 1 };
        (0..draws).map(|draw| self.draw(number, draw)).collect()
    }
}

/// The loss rate, weighted if sensor nodes have weights, of a flight with `strategy`.
fn fly(files: &RandomMission, strategy: &'static str, steps: u64) -> f64 {
    let overrides = Overrides { strategy: Some(strategy), ..Overrides::default() };
    let text = format!("{}horizon.iterations = {steps}\n", files.scenario);
    let scenario =
        Scenario::parse(&text, Path::new("random.toml"), overrides).and_then(settings::resolve).expect("a scenario");
    let list = SensorList::parse(&files.sensors, Path::new("sensors.csv"), &scenario).expect("a sensor list");
    let mut mission = Mission::new(&scenario, &list).expect("it was resolved");
    mission.by_ref().for_each(drop);
    let field = mission.plant().field();
    if !list.has_own_weights() {
        return field.totals().lost_bits as f64 / list.mission_bits(&scenario);
    }
    let weights = list.weights(&list.sampling(&scenario));
    let sampled_bits = (0..list.sensors().len()).map(|id| field.sampled_bits(id) as f64);
    weights.sum(field.lost_bits().map(|lost_bits| lost_bits as f64)) / weights.sum(sampled_bits)
}

fn compare(number: u64, missions: &[RandomMission], steps: u64) -> Outcome {
    let mean = |strategy| missions.iter().map(|files| fly(files, strategy, steps)).sum::<f64>() / missions.len() as f64;
    let ahead = [horizon::STRATEGY, best_of::STRATEGY, look_ahead::OFFLINE];
    let rivals = STRATEGIES.iter().filter(|other| !ahead.contains(other));
    let best = rivals.map(|other| (mean(other.name), other.name)).min_by(|a, b| a.0.total_cmp(&b.0));
    let begin = Instant::now();
    let horizon = mean(horizon::STRATEGY.name);
    Outcome { number, horizon, best: best.expect("other strategies"), seconds: begin.elapsed().as_secs_f64() }
}

fn main() {
    let (options, arguments): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|argument| argument.starts_with("--"));
    assert!(options.iter().all(|option| ["--models", "--write"].contains(&&**option)), "not an option: {options:?}");
    let missions = Missions { has_models: options.contains(&"--models".to_owned()) };
    let number = |index: usize, default| arguments.get(index).map_or(default, |text| text.parse().expect("a number"));
    let range = arguments.first().map_or("1-2000", String::as_str);
    let (first, last) = range.split_once('-').expect("missions as 1-2000");
    let first: u64 = first.parse().expect("a number");
    let last: u64 = last.parse().expect("a number");
    let draws = number(1, 6);
    let steps = number(2, 1_000);
    let lost_folder = arguments.get(3).map(PathBuf::from);
    if options.contains(&"--write".to_owned()) {
        let folder = lost_folder.expect("a folder to write to");
        for number in first..=last {
            for (draw, mission) in missions.draws(number, draws).iter().enumerate() {
                mission.write(&folder.join(format!("{number}/{draw}"))).expect("a folder to write to");
            }
        }
        return;
    }
    let flown = |number| compare(number, &missions.draws(number, draws), steps);
    let mut outcomes: Vec<Outcome> = (first..=last).into_par_iter().map(flown).collect();
    outcomes.sort_by(|a, b| (b.horizon - b.best.0).total_cmp(&(a.horizon - a.best.0)));
    for outcome in outcomes.iter().filter(|outcome| outcome.horizon > outcome.best.0 + TIE) {
        let Outcome { number, horizon, best: (loss_rate, name), seconds } = outcome;
        let mark = if outcome.is_clearly_lost() { "clearly" } else { "" };
        println!("{number:6}  horizon {horizon:.5}  {name:18} {loss_rate:.5}  {seconds:6.2} s  {mark}");
        if let Some(folder) = &lost_folder {
            missions.draw(*number, 0).write(&folder.join(number.to_string())).expect("a folder to write to");
        }
    }
    let count = |is: &dyn Fn(&Outcome) -> bool| outcomes.iter().filter(|outcome| is(outcome)).count();
    println!(
        "{} missions: won {}, tied {}, lost {} by more than {TIE}, of these {} clearly ({} and {} %); horizon {:.0} s",
        outcomes.len(),
        count(&|outcome| outcome.horizon < outcome.best.0 - TIE),
        count(&|outcome| (outcome.horizon - outcome.best.0).abs() <= TIE),
        count(&|outcome| outcome.horizon > outcome.best.0 + TIE),
        count(&Outcome::is_clearly_lost),
        CLEARLY[0],
        CLEARLY[1] * 100.0,
        outcomes.iter().map(|outcome| outcome.seconds).sum::<f64>(),
    );
}
