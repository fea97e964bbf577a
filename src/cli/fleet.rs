//! `skysink fleet`: arguments and printed results.

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;
use skysink_common::option_value::{number, positive};
use skysink_common::scenario::Setting;
use skysink_common::stop::Stop;
use skysink_lab::least_fleet::{BOUND, FleetQuestion, LeastFleets, PricedFleet};
use skysink_mission::error::FileContext as _;

use crate::error::{Error, ended_early};
use crate::options::{Changes, strategy};
use crate::report::{OutputForm, TerminalProgress, print, table, with_numbers_from};
use crate::unflown::warn_of_flights;

/// Find the fewest or the cheapest UAVs that lose no data, or at most a fraction, by strategy and by a bound.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink fleet scenarios/sparse.toml
  skysink fleet scenarios/letter.toml --strategies tour,horizon --loss 0.01 \\
    --over area.side_m=300,600,1000,2000 --out fleets

  skysink fleet city/city.toml --prices 1500,9000 --loss 0.01    of two drones

Fleets are tried from one UAV on, all from uav.start_m, on fields of consecutive
seeds. Of a scenario with tables [[uav.each]] the cheapest fleet is looked for,
by a price for a UAV of each table. A scenario with uav.starts_m or
uav.endurances_s is refused. The bound is
the fewest UAVs that the lower bound on the loss of every flight does not
exclude: no strategy can do with less. With --over, the values of one key are
tried, and with --out a table and a figure are written.")]
pub struct FleetCommand {
    /// Scenario file.
    scenario: PathBuf,
    /// Strategies [default: the scenario's].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = strategy())]
    strategies: Vec<&'static str>,
    /// Most loss rate.
    #[arg(long, value_name = "LOSS", default_value_t = 0.0, allow_negative_numbers = true,
        value_parser = number("a fraction from 0 to 1", |loss| (0.0..=1.0).contains(&loss)))]
    loss: f64,
    /// Fields, with consecutive seeds starting at the scenario's.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    seeds: u64,
    /// Most UAVs that are tried.
    #[arg(long, value_name = "U", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64))]
    most: u32,
    /// The price of a UAV of each table [[uav.each]], in their order.
    #[arg(long, value_name = "PRICE,...", value_delimiter = ',', value_parser = positive())]
    prices: Vec<f64>,
    /// A key of the scenario with several values, for example area.side_m=300,1000.
    #[arg(long, value_name = "KEY=VALUE,...", value_parser = parse_over, default_value = "", hide_default_value = true)]
    over: Over,
    #[command(flatten)]
    changes: Changes,
    /// Write fleet.csv and, over a key of numbers, a figure into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    form: OutputForm,
}

/// Values of one key; none if they are not asked for.
#[derive(Debug, Clone)]
struct Over(Vec<Setting>);

impl FleetCommand {
    /// Finds the least fleets, prints them, and writes files.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let Self { scenario, strategies, loss, seeds, most, prices, over: Over(over), changes, out, form } = self;
        let changes = changes.overrides();
        let own = skysink_common::scenario::Scenario::read(&scenario, changes.clone())
            .and_then(skysink_planner::settings::resolve)?;
        let own = skysink_planner::strategy::Registered::of(&own)?.name;
        let mut strategies = if strategies.is_empty() { vec![own] } else { strategies };
        let mut seen = BTreeSet::new();
        strategies.retain(|strategy| seen.insert(*strategy));
        let question = FleetQuestion { scenario, changes, strategies, loss_rate: loss, seeds, most, prices, over };
        let fleets = question.answer(stop, &TerminalProgress::of_missions());
        let fleets = fleets.map_err(|error| ended_early(error, "nothing was written"))?;
        let files = match &out {
            Some(out) => {
                std::fs::create_dir_all(out).at(out)?;
                question.write(&fleets, out)?
            }
            None => Vec::new(),
        };
        warn_of_flights(&fleets.iter().filter_map(LeastFleets::unflown).collect::<Vec<_>>());
        form.print(&fleets, || {
            print_fleets(&question, &fleets)?;
            files.iter().try_for_each(|file| print(file.display()))
        })
    }
}

/// Prints the least fleets, a line for each value and strategy.
fn print_fleets(question: &FleetQuestion, fleets: &[LeastFleets]) -> Result<(), Error> {
    if !question.prices.is_empty() {
        return print_prices(question, fleets);
    }
    let mut table = table();
    let key = question.over.first().map_or("", |setting| setting.key.as_str());
    table.set_header([key, "", "least UAVs", "mean", "fields"]);
    for fleet in fleets {
        let known: Vec<u32> = fleet.uavs.values().flatten().copied().collect();
        let is_known = known.len() == fleet.uavs.len();
        let ends = [known.iter().min(), known.iter().max()];
        let range = match ends {
            [Some(least), Some(greatest)] if is_known && least == greatest => least.to_string(),
            [Some(least), Some(greatest)] if is_known => format!("{least} to {greatest}"),
            [Some(least), _] => format!("{least} to more than {}", question.most),
            _ => format!("more than {}", question.most),
        };
        let mean = known.iter().copied().map(f64::from).sum::<f64>() / known.len() as f64;
        let name = if fleet.strategy == BOUND { "at least, by the bound" } else { &fleet.strategy };
        table.add_row([
            fleet.value.as_ref().map_or_else(String::new, ToString::to_string),
            name.to_owned(),
            range,
            if is_known { format!("{mean:.2}") } else { String::new() },
            fleet.uavs.len().to_string(),
        ]);
    }
    print(with_numbers_from(2, table))
}

/// Prints the cheapest fleets, a line for each value and strategy.
fn print_prices(question: &FleetQuestion, fleets: &[LeastFleets]) -> Result<(), Error> {
    let mut table = table();
    let key = question.over.first().map_or("", |setting| setting.key.as_str());
    table.set_header([key, "", "price", "mean", "fields", "UAVs of each kind"]);
    for fleet in fleets {
        let known: Vec<&PricedFleet> = fleet.cheapest.values().flatten().collect();
        let is_known = known.len() == fleet.cheapest.len();
        let prices: Vec<f64> = known.iter().map(|fleet| fleet.price).collect();
        let least = prices.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = prices.iter().copied().fold(0.0, f64::max);
        let range = match (is_known, prices.is_empty()) {
            (true, _) if least == greatest => least.to_string(),
            (true, _) => format!("{least} to {greatest}"),
            (false, true) => format!("more than {} UAVs", question.most),
            (false, false) => format!("{least} to more than {} UAVs", question.most),
        };
        let mean = prices.iter().sum::<f64>() / prices.len() as f64;
        let kinds: BTreeSet<String> = known.iter().map(|fleet| fleet.of_each()).collect();
        let name = if fleet.strategy == BOUND { "at least, by the bound" } else { &fleet.strategy };
        table.add_row([
            fleet.value.as_ref().map_or_else(String::new, ToString::to_string),
            name.to_owned(),
            range,
            if is_known { format!("{mean:.2}") } else { String::new() },
            fleet.cheapest.len().to_string(),
            kinds.into_iter().collect::<Vec<_>>().join(", "),
        ]);
    }
    print(with_numbers_from(2, table))
}

/// Parses `KEY=VALUE,...`.
fn parse_over(text: &str) -> Result<Over, String> {
    if text.is_empty() {
        return Ok(Over(Vec::new()));
    }
    let (key, values) = text.split_once('=').ok_or("expected KEY=VALUE,..., such as area.side_m=300,1000")?;
    match key.trim() {
        "uav.count" => return Err("uav.count is what is looked for: expected another key".to_owned()),
        "seed" => return Err("seed: expected another key, and --seeds for several fields".to_owned()),
        "planner.strategy" => return Err("planner.strategy: expected another key, and --strategies".to_owned()),
        _ => {}
    }
    let setting = |value: &str| format!("{key}={value}").parse::<Setting>().map_err(str::to_owned);
    values.split(',').map(setting).collect::<Result<_, _>>().map(Over)
}
