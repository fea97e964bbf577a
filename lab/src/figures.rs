//! `skysink figures`: the sweeps of the paper's figures, drawn as curves with confidence bands (`chart`) and trajectory
//! maps (`map`), and written as SVG, PDF and PNG. `skysink plot` uses the same charts.
//!
//! The same missions give the same bytes: the output depends on no system font, clock or random number.

mod axis;
pub mod chart;
pub mod choice;
pub(crate) mod curves;
mod map;
pub mod page;
pub(crate) mod study;
pub(crate) mod style;
mod table;
#[cfg(test)]
mod tests;
mod trajectories;

use std::fs;
use std::path::PathBuf;

use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;
use skysink_mission::record::write_whole;

use crate::error::LabError;
use crate::progress::{OnProgress, SweepNumber};
use choice::{Choice, FigurePart};
use study::Study;

/// Runs or resumes the sweeps, draws the figures and writes their tables. Returns the paths of the figures without
/// extensions.
///
/// # Errors
/// If a sweep is refused, a file cannot be written, or on a stop.
pub fn draw(choice: &Choice, stop: &Stop, on_progress: OnProgress) -> Result<Vec<PathBuf>, LabError> {
    fs::create_dir_all(&choice.out).at(&choice.out)?;
    let mut tables = head(choice);
    let mut seeds = String::new();
    let mut stems = Vec::new();
    let mut studies = study::studies();
    studies.retain(|study| choice.includes(study.part));
    let mut next = SweepNumber { number: 1, of: studies.iter().map(Study::sweeps).sum() };
    for study in &studies {
        let charts = study.charts(choice, next, stop, on_progress)?;
        next.number += study.sweeps();
        for (name, chart) in charts {
            stop.check()?;
            let stem = choice.out.join(name);
            chart.draw(&stem)?;
            if chart.seeds != seeds {
                seeds.clone_from(&chart.seeds);
                tables += &format!("\nBelow: {seeds}.\n");
            }
            tables += &chart.table().markdown();
            stems.push(stem);
        }
    }
    let sheets = if choice.includes(FigurePart::Maps) { trajectories::sheets(choice, stop)? } else { Vec::new() };
    for (name, sheet) in sheets {
        stop.check()?;
        let stem = choice.out.join(name);
        sheet.draw(&stem)?;
        stems.push(stem);
    }
    write_whole(&choice.out.join("tables.md"), tables.as_bytes())?;
    Ok(stems)
}

/// The text above the tables.
fn head(choice: &Choice) -> String {
    let intervals = "Means over fields with 95 % confidence intervals, by Student's t; those of fractions and of their \
                     differences on the logit scale of their range (docs/src/metrics.md). A difference is of the same \
                     field.";
    format!("Made by {}.\n\n{intervals}\n", choice.command())
}
