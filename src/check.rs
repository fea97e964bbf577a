//! `skysink check`: prints the scenario with every default, derived figures and warnings.
//!
//! [`figures`] computes the figures and [`warnings`] evaluates them; this module prints both.

mod arrivals;
mod doubts;
mod energy;
mod figures;
mod flights;
mod links;
mod motion;
mod quantity;
mod radio;
pub(crate) mod shortfalls;
mod track;
mod verdict;
mod warnings;

use clap::Args;
use serde::Serialize;
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_planner::strategies::STRATEGIES;
use skysink_ring::role::Role;

use crate::error::Error;
use crate::options::{Changes, ScenarioFile};
use crate::report::print;
use energy::EnergyFigures;
use figures::{Figures, KindFigures};
use motion::MotionFigures;
use quantity::{joined, percent, scaled};
use verdict::LossFree;

/// The output of `--json`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    scenario: &'a str,
    #[serde(flatten)]
    figures: &'a Figures,
    /// How models are planned for where strategies ignore a part.
    planned: &'a [String],
    warnings: &'a [String],
}

/// Validate a scenario and print it with all defaults and derived figures.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink check scenarios/letter.toml
  skysink check city.toml > full.toml      the output is a valid scenario
  skysink check city.toml --json | jq .load

Warnings go to standard error and do not change the exit code.")]
pub struct CheckCommand {
    #[command(flatten)]
    scenario: ScenarioFile,
    #[command(flatten)]
    changes: Changes,
    /// Print only the derived figures and the warnings, as JSON.
    #[arg(long)]
    json: bool,
}

impl CheckCommand {
    /// Prints all keys of the scenario, with the figures as comments, or only the figures as JSON. Prints warnings on
    /// standard error.
    pub fn run(self, _: &Stop) -> Result<(), Error> {
        let scenario = self.scenario.read(self.changes.overrides())?;
        let list = SensorList::of(&scenario)?;
        let figures = Figures::of(&scenario, &list)?;
        let mut warnings = doubts::of(&scenario, &list);
        warnings.extend(warnings::of(&scenario, &figures));
        let all: Vec<&str> = STRATEGIES.iter().map(|strategy| strategy.name).collect();
        let planned = shortfalls::of(&scenario, &list, &all);
        if self.json {
            let report = Report { scenario: &scenario.name, figures: &figures, planned: &planned, warnings: &warnings };
            return print(serde_json::to_string_pretty(&report).expect("plain keys and numbers"));
        }
        // The figures come last, so that they and the warnings stay visible.
        print(format_args!("{}\n", scenario.to_toml().trim_end()))?;
        print(format_args!("# {}: {} sensor nodes", self.scenario, list.sensors().len()))?;
        print(commented(&figures).trim_end())?;
        planned.iter().try_for_each(|sentence| print(format_args!("# planned: {sentence}")))?;
        warnings.iter().for_each(|warning| Role::Launcher.log(format_args!("warning: {warning}")));
        Ok(())
    }
}

/// The figures as comment lines of a scenario file, aligned.
fn commented(figures: &Figures) -> String {
    let rows = rows(figures);
    let width = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let line = |(name, value): &(&str, String)| format!("#   {name:width$}  {value}\n");
    rows.iter().map(line).collect()
}

/// Name and value of each figure.
fn rows(figures: &Figures) -> Vec<(&'static str, String)> {
    let metres = |length_m: f64| scaled(length_m, "m");
    let none = || "none".to_owned();
    let bits = |bits: u64| scaled(bits as f64, "bit");
    let rates = |rates_bps: [f64; 2]| joined(rates_bps.map(|rate_bps| scaled(rate_bps, "bit/s")));
    let visits = |visits: [Option<u64>; 2]| {
        joined(visits.map(|visits| visits.map_or_else(|| "infinite".to_owned(), |visits| visits.to_string())))
    };
    let Figures { above, rim, round, motion, .. } = figures;
    let is_plain = motion.is_plain();
    let mut rows = Vec::new();
    if figures.kinds.is_empty() {
        rows.extend(of_uav(figures.reach_m, motion, figures.energy.as_ref()));
    }
    for KindFigures { name, uavs, resource_blocks, reach_m, altitude_m, motion, energy } in &figures.kinds {
        let at = format!("{uavs} at {} (n = {resource_blocks}): {name}", metres(*altitude_m));
        rows.push(("UAVs", at));
        rows.extend(of_uav(*reach_m, motion, energy.as_ref()));
    }
    rows.extend(figures.track.iter().flat_map(|track| track.rows()));
    rows.extend([
        ("communication radius, d_c", metres(figures.comm_radius_m)),
        (
            if is_plain { "anchor radius of uts, V τ − d_c" } else { "anchor radius of uts, reach − d_c" },
            metres(figures.anchor_radius_m),
        ),
        ("mean distance to the nearest SN", figures.neighbour_m.map_or_else(none, metres)),
    ]);
    let outside = figures.outside.map(|outside| format!("{outside} of {}", figures.sensors));
    rows.extend(outside.map(|outside| ("SNs outside the boundary", outside)));
    rows.extend(figures.radio.rows());
    rows.extend([
        ("rate straight below the UAV", rates(above.rates_bps)),
        ("rate at distance d_c", rates(rim.rates_bps)),
        ("bits per visit straight below", joined(above.visit_bits.map(bits))),
        ("bits per visit at distance d_c", joined(rim.visit_bits.map(bits))),
        ("visits to empty a full buffer", format!("{} (at d_c {})", visits(above.visits), visits(rim.visits))),
        ("slots to fill an empty buffer", figures.fill_slots.map_or_else(none, |fill| fill.to_string())),
        ("slots to serve every SN", round.to_string()),
        ("offered load, N s τ", figures.load.to_string()),
        ("flight without loss", loss_free(&figures.loss_free)),
    ]);
    let objective = figures.objective.map(|objective| format!("{}, by horizon and offline", objective.words()));
    rows.extend(objective.map(|objective| ("objective", objective)));
    rows.extend(figures.arrivals.map(|arrivals| ("arrivals", arrivals.to_string())));
    let weights = figures.weights.map(|weights| joined(weights.map(|weight| weight.to_string())));
    rows.extend(weights.map(|weights| ("weights of SNs", weights)));
    let buffers =
        figures.buffers_bits.map(|buffers_bits| joined(buffers_bits.map(|buffer_bits| bits(buffer_bits.into()))));
    rows.extend(buffers.map(|buffers| ("buffers of SNs", buffers)));
    rows
}

/// The rows of a UAV.
fn of_uav(reach_m: f64, motion: &MotionFigures, energy: Option<&EnergyFigures>) -> Vec<(&'static str, String)> {
    let name = if motion.is_plain() { "reach in a slot, V τ" } else { "reach in a slot" };
    let mut rows = vec![(name, scaled(reach_m, "m"))];
    rows.extend(motion.rows());
    rows.extend(energy.into_iter().flat_map(EnergyFigures::rows));
    rows
}

/// Whether a flight without loss exists, in a few words.
fn loss_free(known: &LossFree) -> String {
    match known {
        LossFree::Unserved => "yes: no buffer overflows in the mission".to_owned(),
        LossFree::Flown { strategy } => format!("yes: {strategy} loses nothing"),
        LossFree::Impossible { lost_bits } => {
            format!("no: every flight loses at least {}", scaled(*lost_bits as f64, "bit"))
        }
        LossFree::Open { strategy, loss_rate } => format!("unknown: {strategy} loses {}", percent(*loss_rate)),
        LossFree::NotFlown => "unknown: not simulated, the field is large".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use skysink_common::scenario::{Overrides, Scenario};

    use super::*;

    #[test]
    fn the_figures_of_every_field_fit_into_a_terminal_and_are_comments() {
        for text in ["name = 'a'\n", "name = 'a'\n[area]\nside_m = 30000.0\n[link]\nbandwidth_hz = 3.0\n"] {
            let scenario = Scenario::parse(text, Path::new("a.toml"), Overrides::default()).unwrap();
            let list = SensorList::of(&scenario).unwrap();
            let lines = commented(&Figures::of(&scenario, &list).unwrap());
            for line in lines.lines() {
                assert!(line.starts_with("# ") && line.chars().count() <= 80, "{line}");
            }
        }
    }
}
