//! Loss of whole missions over seeded fields, by strategy, with the mean propulsion power and the time that planning
//! takes.
//!
//! `cargo run --release -p skysink-planner --example losses -- 1-20 horizon,uts 'slots = 500' '[area]' 'side_m = 1000.0'`
//!
//! With `EACH=1` in the environment it also prints the loss and the bound of each field.

use std::path::Path;

use rustix::time::{ClockId, clock_gettime};
use skysink_common::propulsion::power_w;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_mission::Mission;
use skysink_planner::bound::mission_bound;
use skysink_planner::settings;
use skysink_planner::strategies::names;

/// The results of one mission.
struct Outcome {
    loss_rate: f64,
    /// Lower bound on the loss rate; 0 if not requested.
    bound_rate: f64,
    refused: u64,
    /// Mean propulsion power [W].
    power_w: f64,
    setup_ms: f64,
    plan_ms: Vec<f64>,
}

/// CPU time of this thread [ms].
fn computed_ms() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6
}

fn fly(scenario: &Scenario) -> Outcome {
    let list = SensorList::of(scenario).expect("drawn");
    let begin_ms = computed_ms();
    let mut mission = Mission::new(scenario, &list).expect("the scenario is checked");
    let setup_ms = computed_ms() - begin_ms;
    let queues_bits = list.queues_bits();
    let mut outcome =
        Outcome { loss_rate: 0.0, bound_rate: 0.0, refused: 0, power_w: 0.0, setup_ms, plan_ms: Vec::new() };
    let mut position = scenario.start();
    while mission.slot() < scenario.slots {
        let begin_ms = computed_ms();
        let plan = mission.plan();
        outcome.plan_ms.push(computed_ms() - begin_ms);
        mission.fly(Some(&plan));
        outcome.refused += u64::from(mission.last_flight().refused);
        let flown_m = (mission.last_flight().position() - position).norm();
        outcome.power_w += power_w(&scenario.uav.propulsion, flown_m / scenario.slot_s) / scenario.slots as f64;
        position = mission.last_flight().position();
    }
    let lost_bits = mission.field().totals().lost_bits;
    let sampled: f64 = list.sensors().iter().map(|sensor| sensor.sampling_bps).sum::<f64>();
    let sampled_bits = sampled * scenario.slot_s * scenario.slots as f64;
    outcome.loss_rate = lost_bits as f64 / sampled_bits;
    if each() {
        let bound_bits = mission_bound(scenario, &list.nodes(), &queues_bits, lost_bits).loss_bits;
        outcome.bound_rate = bound_bits as f64 / sampled_bits;
    }
    outcome
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [seeds, strategies, lines @ ..] = &arguments[..] else {
        panic!("expected seeds (1-20), strategies (horizon,uts), and lines of a scenario")
    };
    let (first, last) = seeds.split_once('-').expect("seeds as 1-20");
    let seeds = first.parse::<u64>().expect("a seed")..=last.parse().expect("a seed");
    let text = format!("name = 'losses'\n{}\n", lines.join("\n"));
    for name in strategies.split(',') {
        let strategy = names().into_iter().find(|strategy| *strategy == name).expect("a strategy");
        let mut outcomes = Vec::new();
        for seed in seeds.clone() {
            let overrides = Overrides { seed: Some(seed), strategy: Some(strategy), ..Overrides::default() };
            let scenario = Scenario::parse(&text, Path::new("arguments"), overrides)
                .and_then(settings::resolve)
                .unwrap_or_else(|e| panic!("{e}"));
            outcomes.push(fly(&scenario));
        }
        report(name, &outcomes);
    }
}

fn report(name: &str, outcomes: &[Outcome]) {
    let count = outcomes.len() as f64;
    let mean = outcomes.iter().map(|outcome| outcome.loss_rate).sum::<f64>() / count;
    let square = |outcome: &Outcome| (outcome.loss_rate - mean).powi(2);
    let error = (outcomes.iter().map(square).sum::<f64>() / (count - 1.0).max(1.0) / count).sqrt();
    let mut plan_ms: Vec<f64> = outcomes.iter().flat_map(|outcome| outcome.plan_ms.iter().copied()).collect();
    plan_ms.sort_unstable_by(f64::total_cmp);
    let first_ms = outcomes.iter().map(|outcome| outcome.plan_ms[0]).fold(0.0, f64::max);
    let setup_ms = outcomes.iter().map(|outcome| outcome.setup_ms).fold(0.0, f64::max);
    let refused: u64 = outcomes.iter().map(|outcome| outcome.refused).sum();
    let power_w = outcomes.iter().map(|outcome| outcome.power_w).sum::<f64>() / count;
    let quantile = |fraction: f64| plan_ms[((plan_ms.len() - 1) as f64 * fraction) as usize];
    println!(
        "{name:14} η {mean:.5} ± {error:.5}  power {power_w:.1} W  refused {refused}  plan p50 {:.3} p99 {:.3} max {:.3} first {first_ms:.3} \
         setup {setup_ms:.1} ms",
        quantile(0.5),
        quantile(0.99),
        quantile(1.0),
    );
    if each() {
        let round = |rate: f64| (rate * 1e5).round() / 1e5;
        println!("  η {:?}", outcomes.iter().map(|outcome| round(outcome.loss_rate)).collect::<Vec<_>>());
        println!("  bound {:?}", outcomes.iter().map(|outcome| round(outcome.bound_rate)).collect::<Vec<_>>());
    }
}

/// Whether to print the loss of each field.
fn each() -> bool {
    std::env::var_os("EACH").is_some()
}
